#include "server/import/gltf/draco_mesh.h"

#include <cstring>
#include <draco/compression/decode.h>
#include <exception>
#include <memory>
#include <new>
#include <vector>

struct lw_draco_mesh {
    std::unique_ptr<draco::Mesh> mesh;
    std::vector<uint32_t> index;
    std::vector<std::unique_ptr<uint8_t[]>> attribute;
};

namespace {

/* Header of a stream: Draco bitstream specification 2.2, section 5; LEB128 as in section 3. */
const size_t header_size = 11;
const unsigned flag_metadata = 0x8000, triangular_mesh = 1, sequential = 0, edgebreaker = 1;

bool read_varint(const uint8_t **at, const uint8_t *end, uint64_t *out) {
    *out = 0;
    for (unsigned shift = 0; shift < 35 && *at < end; shift += 7) {
        const uint8_t byte = *(*at)++;
        *out |= (uint64_t)(byte & 0x7f) << shift;
        if (!(byte & 0x80)) return true;
    }
    return false;
}

enum lw_status check_header(const uint8_t *bytes, size_t size, uint32_t triangles_max, uint32_t vertices_max,
                            struct lw_error *err) {
    if (size < header_size || memcmp(bytes, "DRACO", 5) != 0)
        return lw_status_fail(err, LW_BAD_DATA, "is no Draco stream");
    if (bytes[5] != 2 || bytes[6] != 2)
        return lw_status_fail(err, LW_BAD_DATA, "is a Draco stream of version %u.%u; only 2.2 is read",
                              bytes[5], bytes[6]);
    const unsigned method = bytes[8], flags = bytes[9] | (unsigned)bytes[10] << 8;
    if (bytes[7] != triangular_mesh || method > edgebreaker || flags & flag_metadata)
        return lw_status_fail(err, LW_BAD_DATA, "is a Draco stream of %s; only plain meshes are read",
                              flags & flag_metadata ? "metadata" : "points");
    const uint8_t *at = bytes + header_size, *end = bytes + size;
    uint64_t triangles = 0, vertices = 0;
    if (method == edgebreaker) at++; /* how its symbols are coded */
    const bool whole = method == sequential
                           ? read_varint(&at, end, &triangles) && read_varint(&at, end, &vertices)
                           : read_varint(&at, end, &vertices) && read_varint(&at, end, &triangles);
    if (!whole) return lw_status_fail(err, LW_BAD_DATA, "is a Draco stream that is truncated");
    if (triangles > triangles_max || vertices > vertices_max || triangles / LW_DRACO_MESH_RATIO_MAX > size ||
        vertices / LW_DRACO_MESH_RATIO_MAX > size)
        return lw_status_fail(
            err, LW_BAD_DATA,
            "is a Draco stream of %llu triangles and %llu vertices in %zu bytes; its accessors "
            "have %u and %u",
            (unsigned long long)triangles, (unsigned long long)vertices, size, triangles_max, vertices_max);
    return LW_OK;
}

enum lw_status decode(const uint8_t *bytes, size_t size, struct lw_draco_mesh *out, struct lw_error *err) {
    draco::DecoderBuffer buffer;
    buffer.Init((const char *)bytes, size);
    draco::Decoder decoder;
    auto decoded = decoder.DecodeMeshFromBuffer(&buffer);
    if (!decoded.ok())
        return lw_status_fail(err, LW_BAD_DATA, "is a Draco stream that is corrupt: %s",
                              decoded.status().error_msg());
    out->mesh = std::move(decoded).value();
    out->index.resize(3 * (size_t)out->mesh->num_faces());
    for (uint32_t t = 0; t < out->mesh->num_faces(); t++)
        for (int k = 0; k < 3; k++)
            out->index[3 * (size_t)t + k] = out->mesh->face(draco::FaceIndex(t))[k].value();
    return LW_OK;
}

template <typename T>
bool copy(const draco::PointAttribute &from, uint32_t count, unsigned components, uint8_t *out) {
    T *values = reinterpret_cast<T *>(out);
    for (uint32_t i = 0; i < count; i++) {
        const draco::AttributeValueIndex at = from.mapped_index(draco::PointIndex(i));
        if (at.value() >= from.size() ||
            !from.ConvertValue<T>(at, (int8_t)components, values + (size_t)i * components))
            return false;
    }
    return true;
}

bool copy_as(enum lw_draco_mesh_type type, const draco::PointAttribute &from, uint32_t count,
             unsigned components, uint8_t *out) {
    switch (type) {
    case LW_DRACO_INT8:
        return copy<int8_t>(from, count, components, out);
    case LW_DRACO_UINT8:
        return copy<uint8_t>(from, count, components, out);
    case LW_DRACO_INT16:
        return copy<int16_t>(from, count, components, out);
    case LW_DRACO_UINT16:
        return copy<uint16_t>(from, count, components, out);
    case LW_DRACO_UINT32:
        return copy<uint32_t>(from, count, components, out);
    case LW_DRACO_FLOAT:
        return copy<float>(from, count, components, out);
    }
    return false;
}

} // namespace

extern "C" enum lw_status lw_draco_mesh_create(const uint8_t *bytes, size_t size, uint32_t triangles_max,
                                               uint32_t vertices_max, struct lw_draco_mesh **out,
                                               struct lw_error *err) {
    enum lw_status status = check_header(bytes, size, triangles_max, vertices_max, err);
    if (status) return status;
    try {
        auto mesh = std::make_unique<lw_draco_mesh>();
        status = decode(bytes, size, mesh.get(), err);
        if (status == LW_OK) *out = mesh.release();
        return status;
    } catch (const std::bad_alloc &) {
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory for a Draco stream of %zu bytes", size);
    } catch (const std::exception &e) {
        return lw_status_fail(err, LW_BAD_DATA, "is a Draco stream that is corrupt: %s", e.what());
    }
}

extern "C" void lw_draco_mesh_destroy(struct lw_draco_mesh *mesh) { delete mesh; }

extern "C" uint32_t lw_draco_mesh_triangle_count(const struct lw_draco_mesh *mesh) {
    return mesh->mesh->num_faces();
}

extern "C" uint32_t lw_draco_mesh_vertex_count(const struct lw_draco_mesh *mesh) {
    return mesh->mesh->num_points();
}

extern "C" const uint32_t *lw_draco_mesh_indices(const struct lw_draco_mesh *mesh) {
    return mesh->index.data();
}

extern "C" enum lw_status lw_draco_mesh_attribute(struct lw_draco_mesh *mesh, uint32_t id,
                                                  enum lw_draco_mesh_type type, unsigned components,
                                                  const uint8_t **out, struct lw_error *err) {
    const draco::PointAttribute *from = mesh->mesh->GetAttributeByUniqueId(id);
    if (!from || from->num_components() != (int)components)
        return lw_status_fail(err, LW_BAD_DATA, "the Draco stream has no attribute %u of %u components", id,
                              components);
    const uint32_t count = mesh->mesh->num_points();
    try {
        mesh->attribute.emplace_back(new uint8_t[4 * (size_t)components * count + 1]);
    } catch (const std::bad_alloc &) {
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory for %u vertices", count);
    }
    uint8_t *values = mesh->attribute.back().get();
    if (!copy_as(type, *from, count, components, values))
        return lw_status_fail(err, LW_BAD_DATA, "attribute %u of the Draco stream is corrupt", id);
    *out = values;
    return LW_OK;
}
