#include "server/import/gltf/gltf_accessor.h"

#include <string.h>

static size_t component_size(enum lw_gltf_component type) {
    switch (type) {
    case LW_GLTF_INT8:
    case LW_GLTF_UINT8:
        return 1;
    case LW_GLTF_INT16:
    case LW_GLTF_UINT16:
        return 2;
    default:
        return 4;
    }
}

static unsigned components_of(const char *type) {
    static const char *const names[] = {"SCALAR", "VEC2", "VEC3", "VEC4"};
    for (unsigned i = 0; i < 4; i++)
        if (strcmp(type, names[i]) == 0) return i + 1;
    return strcmp(type, "MAT4") == 0 ? 16 : 0;
}

static unsigned class_of(enum lw_gltf_component type, bool normalized) {
    switch (type) {
    case LW_GLTF_FLOAT:
        return LW_GLTF_ACCEPT_FLOAT;
    case LW_GLTF_UINT8:
    case LW_GLTF_UINT16:
        return normalized ? LW_GLTF_ACCEPT_NORMALIZED_UNSIGNED
                          : LW_GLTF_ACCEPT_UNSIGNED | LW_GLTF_ACCEPT_INDEX;
    case LW_GLTF_INT8:
    case LW_GLTF_INT16:
        return normalized ? LW_GLTF_ACCEPT_NORMALIZED_SIGNED : LW_GLTF_ACCEPT_SIGNED;
    case LW_GLTF_UINT32:
        return normalized ? 0 : LW_GLTF_ACCEPT_INDEX;
    }
    return 0;
}

/* All multi-byte numbers of glTF are little-endian, as this machine is. Elements may lie unaligned. */
_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "the accessors are read as they lie");

static uint32_t load_unsigned(const uint8_t *at, enum lw_gltf_component type) {
    uint32_t wide;
    uint16_t narrow;
    switch (type) {
    case LW_GLTF_UINT8:
        return *at;
    case LW_GLTF_UINT16:
        memcpy(&narrow, at, 2);
        return narrow;
    default:
        memcpy(&wide, at, 4);
        return wide;
    }
}

/* glTF 2.0, 3.11: normalised integers. */
static float load_real(const uint8_t *at, enum lw_gltf_component type, bool normalized) {
    float real;
    int16_t narrow;
    switch (type) {
    case LW_GLTF_INT8:
        real = (float)(int8_t)*at;
        return normalized ? (real < -127 ? -1.0f : real / 127.0f) : real;
    case LW_GLTF_INT16:
        memcpy(&narrow, at, 2);
        real = (float)narrow;
        return normalized ? (real < -32767 ? -1.0f : real / 32767.0f) : real;
    case LW_GLTF_UINT8:
        return normalized ? (float)*at / 255.0f : (float)*at;
    case LW_GLTF_UINT16:
        real = (float)load_unsigned(at, type);
        return normalized ? real / 65535.0f : real;
    case LW_GLTF_UINT32:
        return (float)load_unsigned(at, type);
    case LW_GLTF_FLOAT:
        break;
    }
    memcpy(&real, at, 4);
    return real;
}

/* Where `count` elements of `size` bytes lie in a view, `stride` bytes apart. */
static enum lw_status locate(const struct lw_gltf_document *document, const json_t *object, const char *what,
                             uint64_t count, size_t size, bool strided, const uint8_t **out_data,
                             size_t *out_stride, struct lw_error *err) {
    uint32_t view_index = 0;
    uint64_t offset = 0;
    if (lw_gltf_document_index(document, object, "bufferView", LW_GLTF_BUFFER_VIEWS, &view_index, err) ||
        lw_gltf_json_integer(object, "byteOffset", 0, LW_GLTF_FILE_SIZE_MAX, &offset, err))
        return err->status;
    const struct lw_gltf_buffer_view *view = &document->view[view_index];
    size_t stride = strided && view->stride ? view->stride : size;
    if (stride < size)
        return lw_status_fail(err, LW_BAD_DATA,
                              "its elements of %zu bytes overlap: bufferView %u has byteStride %zu", size,
                              view_index, stride);
    if (offset + (count - 1) * stride + size > view->bytes.size) /* each term below 2^40: no overflow */
        return lw_status_fail(err, LW_BAD_DATA, "%sreaches past bufferView %u", what, view_index);
    *out_data = view->bytes.data + offset;
    *out_stride = stride;
    return LW_OK;
}

static enum lw_status open_sparse(const struct lw_gltf_document *document, const json_t *sparse,
                                  struct lw_gltf_accessor *out, struct lw_error *err) {
    const json_t *indices = NULL, *values = NULL;
    uint64_t count = 0, type = 0;
    size_t stride;
    if (lw_gltf_json_require(sparse, "count", err) ||
        lw_gltf_json_integer(sparse, "count", 1, out->count, &count, err) ||
        lw_gltf_json_require(sparse, "indices", err) ||
        lw_gltf_json_object(sparse, "indices", &indices, err) ||
        lw_gltf_json_require(sparse, "values", err) || lw_gltf_json_object(sparse, "values", &values, err) ||
        lw_gltf_json_require(indices, "bufferView", err) || lw_gltf_json_require(values, "bufferView", err) ||
        lw_gltf_json_require(indices, "componentType", err) ||
        lw_gltf_json_integer(indices, "componentType", LW_GLTF_INT8, LW_GLTF_FLOAT, &type, err))
        return err->status;
    if (type != LW_GLTF_UINT8 && type != LW_GLTF_UINT16 && type != LW_GLTF_UINT32)
        return lw_status_fail(err, LW_BAD_DATA, "indices.componentType: must be 5121, 5123 or 5125");
    out->sparse_type = (enum lw_gltf_component)type;
    if (locate(document, indices, "indices ", count, component_size(out->sparse_type), false,
               &out->sparse_index, &stride, err) ||
        locate(document, values, "values ", count, component_size(out->type) * out->components, false,
               &out->sparse_value, &stride, err))
        return err->status;
    size_t size = component_size(out->sparse_type);
    for (uint32_t i = 0; i < count; i++) {
        uint32_t element = load_unsigned(out->sparse_index + i * size, out->sparse_type);
        if (element >= out->count)
            return lw_status_fail(err, LW_BAD_DATA, "indices: %u is past the accessor's %u elements", element,
                                  out->count);
        if (i > 0 && element <= load_unsigned(out->sparse_index + (i - 1) * size, out->sparse_type))
            return lw_status_fail(err, LW_BAD_DATA, "indices: must be strictly increasing, element %u is not",
                                  i);
    }
    out->sparse_count = (uint32_t)count;
    return LW_OK;
}

static enum lw_status open_accessor(const struct lw_gltf_document *document, const json_t *object,
                                    unsigned components_min, unsigned components_max, unsigned accept,
                                    struct lw_gltf_accessor *out, struct lw_error *err) {
    const char *type_name = "";
    uint64_t count = 0, type = 0;
    const json_t *sparse = NULL;
    if (lw_gltf_json_require(object, "count", err) ||
        lw_gltf_json_integer(object, "count", 1, LW_GLTF_ELEMENTS_MAX, &count, err) ||
        lw_gltf_json_require(object, "type", err) || lw_gltf_json_string(object, "type", &type_name, err) ||
        lw_gltf_json_require(object, "componentType", err) ||
        lw_gltf_json_integer(object, "componentType", LW_GLTF_INT8, LW_GLTF_FLOAT, &type, err) ||
        lw_gltf_json_flag(object, "normalized", &out->normalized, err) ||
        lw_gltf_json_object(object, "sparse", &sparse, err))
        return err->status;
    out->count = (uint32_t)count;
    out->components = (uint8_t)components_of(type_name);
    out->type = (enum lw_gltf_component)type;
    if (out->components < components_min || out->components > components_max)
        return lw_status_fail(err, LW_BAD_DATA, "type %.12s cannot be used here", type_name);
    if (!(class_of(out->type, out->normalized) & accept))
        return lw_status_fail(err, LW_BAD_DATA, "componentType %llu%s cannot be used here",
                              (unsigned long long)type, out->normalized ? ", normalized," : "");
    if (json_object_get(object, "bufferView")) {
        if (locate(document, object, "", count, component_size(out->type) * out->components, true, &out->data,
                   &out->stride, err))
            return err->status;
    } else if (count > LW_GLTF_UNBACKED_MAX && !(accept & LW_GLTF_ACCEPT_UNBACKED)) {
        return lw_status_fail(err, LW_BAD_DATA,
                              "count: an accessor without bufferView has at most %u elements",
                              LW_GLTF_UNBACKED_MAX);
    }
    if (sparse && open_sparse(document, sparse, out, err)) {
        lw_status_context(err, "sparse");
        return err->status;
    }
    return LW_OK;
}

enum lw_status lw_gltf_accessor_open(const struct lw_gltf_document *document, uint32_t index,
                                     unsigned components_min, unsigned components_max, unsigned accept,
                                     struct lw_gltf_accessor *out, struct lw_error *err) {
    struct lw_gltf_accessor accessor = {.index = index};
    if (open_accessor(document, lw_gltf_document_item(document, LW_GLTF_ACCESSORS, index), components_min,
                      components_max, accept, &accessor, err)) {
        lw_status_context(err, "accessor %u", index);
        return err->status;
    }
    *out = accessor;
    return LW_OK;
}

static const uint8_t *element(const struct lw_gltf_accessor *accessor, uint32_t i) {
    size_t size = component_size(accessor->sparse_type);
    for (uint32_t low = 0, high = accessor->sparse_count; low < high;) {
        uint32_t middle = low + (high - low) / 2;
        uint32_t at = load_unsigned(accessor->sparse_index + middle * size, accessor->sparse_type);
        if (at == i)
            return accessor->sparse_value +
                   (size_t)middle * component_size(accessor->type) * accessor->components;
        if (at < i)
            low = middle + 1;
        else
            high = middle;
    }
    return accessor->data ? accessor->data + (size_t)i * accessor->stride : NULL;
}

void lw_gltf_accessor_read(const struct lw_gltf_accessor *accessor, uint32_t i, float *out) {
    const uint8_t *at = element(accessor, i);
    size_t size = component_size(accessor->type);
    for (unsigned c = 0; c < accessor->components; c++)
        out[c] = at ? load_real(at + c * size, accessor->type, accessor->normalized) : 0.0f;
}

uint32_t lw_gltf_accessor_integer(const struct lw_gltf_accessor *accessor, uint32_t i) {
    const uint8_t *at = element(accessor, i);
    return at ? load_unsigned(at, accessor->type) : 0;
}
