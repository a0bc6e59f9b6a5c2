#include "server/import/gltf/gltf_document.h"

#include "common/base/file_read.h"
#include "common/base/log.h"
#include "server/import/gltf/gltf_meshopt.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static const char *const list_key[LW_GLTF_LIST_COUNT] = {
#define X(name, key) [LW_GLTF_##name] = key,
    LW_GLTF_LIST_MAP(X)
#undef X
};

static const char *const warning_text[LW_GLTF_WARNING_COUNT] = {
#define X(name, text) [LW_GLTF_WARN_##name] = text,
    LW_GLTF_WARNING_MAP(X)
#undef X
};

static const char *const supported_extensions[] = {
    "EXT_lights_image_based",
    "EXT_mesh_gpu_instancing",
    "EXT_meshopt_compression",
    "EXT_texture_avif",
    "EXT_texture_webp",
    "KHR_animation_pointer",
    "KHR_draco_mesh_compression",
    "KHR_lights_punctual",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_specular",
    "KHR_mesh_quantization",
    "KHR_node_visibility",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_texture_transform",
    "MSFT_lod",
};

/* Extensions ignored even where required: without them a surface has the same light, or nearly. */
static const char *const harmless_extensions[] = {
    "KHR_materials_anisotropy", "KHR_materials_clearcoat",   "KHR_materials_diffuse_transmission",
    "KHR_materials_dispersion", "KHR_materials_iridescence", "KHR_materials_sheen",
    "KHR_materials_variants",   "KHR_materials_volume",      "KHR_xmp_json_ld",
};

#define EXTENSIONS_TOLD_MAX 10 /* ignored ones in a warning, by name */

void lw_gltf_document_warn(struct lw_gltf_document *document, enum lw_gltf_warning warning) {
    if (document->warned & 1u << warning) return;
    document->warned |= 1u << warning;
    lw_log(LW_LOG_WARNING, "%s: %s", document->name, warning_text[warning]);
}

/* ---- files and URIs ---- */

static int hex_digit(char c) {
    if (c >= '0' && c <= '9') return c - '0';
    if (c >= 'a' && c <= 'f') return c - 'a' + 10;
    if (c >= 'A' && c <= 'F') return c - 'A' + 10;
    return -1;
}

/* Percent-decoding. out has room for strlen(uri) + 1. */
static bool decode_percent(const char *uri, char *out) {
    for (; *uri; uri++) {
        if (*uri != '%') {
            *out++ = *uri;
            continue;
        }
        int high = hex_digit(uri[1]), low = high < 0 ? -1 : hex_digit(uri[2]);
        if (low < 0 || high * 16 + low == 0) return false;
        *out++ = (char)(high * 16 + low);
        uri += 2;
    }
    *out = 0;
    return true;
}

/* Whether a relative path stays below where it starts, at every step. */
static bool stays_inside(const char *path) {
    int depth = 0;
    while (*path) {
        size_t length = strcspn(path, "/");
        if (length == 2 && path[0] == '.' && path[1] == '.')
            depth--;
        else if (length > 0 && !(length == 1 && path[0] == '.'))
            depth++;
        if (depth < 0) return false;
        path += length;
        path += *path == '/';
    }
    return true;
}

static enum lw_status fetch_file(const struct lw_gltf_document *document, const char *uri, uint64_t size_max,
                                 bool whole, uint8_t **out_storage, size_t *out_size, struct lw_error *err) {
    size_t length = strlen(uri);
    if (length == 0 || length > LW_GLTF_URI_LENGTH_MAX)
        return lw_status_fail(err, LW_BAD_DATA, "uri: must have 1 to %u bytes", LW_GLTF_URI_LENGTH_MAX);
    size_t scheme = strcspn(uri, ":/?#");
    if (uri[scheme] == ':')
        return lw_status_fail(
            err, LW_BAD_DATA,
            "uri \"%.200s\": only data: and relative paths are read; put the file beside the scene", uri);
    char decoded[LW_GLTF_URI_LENGTH_MAX + 1];
    if (!decode_percent(uri, decoded))
        return lw_status_fail(err, LW_BAD_DATA, "uri \"%.200s\": has a wrong %%-escape", uri);
    if (decoded[0] == '/' || decoded[0] == '\\' || !stays_inside(decoded))
        return lw_status_fail(err, LW_BAD_DATA, "uri \"%.200s\": leaves the folder of the scene", uri);
    if (!document->folder)
        return lw_status_fail(err, LW_BAD_DATA, "uri \"%.200s\": a scene in memory can name no file", uri);

    enum lw_status status =
        lw_file_read_beneath(document->folder, decoded, size_max, whole, out_storage, out_size, err);
    if (status == LW_OK) return LW_OK;
    lw_status_context(err, "uri \"%.200s\"", uri);
    if (err->status != LW_NO_MEMORY) err->status = LW_NO_INPUT;
    return err->status;
}

static int base64_digit(char c) {
    if (c >= 'A' && c <= 'Z') return c - 'A';
    if (c >= 'a' && c <= 'z') return c - 'a' + 26;
    if (c >= '0' && c <= '9') return c - '0' + 52;
    return c == '+' ? 62 : c == '/' ? 63 : -1;
}

/* RFC 4648, padding optional. Returns false on a character or a length that cannot be. */
static bool decode_base64(const char *text, size_t length, uint8_t *out, size_t *out_size) {
    for (int padding = 0; padding < 2 && length > 0 && text[length - 1] == '='; padding++) length--;
    if (length % 4 == 1) return false;
    uint32_t bits = 0;
    unsigned bit_count = 0;
    size_t size = 0;
    for (size_t i = 0; i < length; i++) {
        int digit = base64_digit(text[i]);
        if (digit < 0) return false;
        bits = bits << 6 | (uint32_t)digit;
        bit_count += 6;
        if (bit_count < 8) continue;
        bit_count -= 8;
        out[size++] = (uint8_t)(bits >> bit_count);
    }
    *out_size = size;
    return true;
}

static enum lw_status fetch_data(const char *uri, uint64_t size_max, uint8_t **out_storage, size_t *out_size,
                                 struct lw_error *err) {
    const char *comma = strchr(uri, ',');
    if (!comma || comma - uri < 7 || strncasecmp(comma - 7, ";base64", 7) != 0)
        return lw_status_fail(err, LW_BAD_DATA, "uri \"%.40s...\": must be data:TYPE;base64,...", uri);
    size_t length = strlen(comma + 1);
    if (length / 4 * 3 > size_max)
        return lw_status_fail(err, LW_BAD_DATA, "uri \"%.40s...\": holds more than %llu bytes", uri,
                              (unsigned long long)size_max);
    uint8_t *bytes = malloc(length / 4 * 3 + 4);
    if (!bytes) return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    if (!decode_base64(comma + 1, length, bytes, out_size)) {
        free(bytes);
        return lw_status_fail(err, LW_BAD_DATA, "uri \"%.40s...\": is not base64", uri);
    }
    *out_storage = bytes;
    return LW_OK;
}

enum lw_status lw_gltf_document_fetch(const struct lw_gltf_document *document, const char *uri,
                                      uint64_t size_min, uint64_t size_max, bool whole, uint8_t **out_storage,
                                      size_t *out_size, struct lw_error *err) {
    uint8_t *storage = NULL;
    size_t size = 0;
    bool is_data = strncasecmp(uri, "data:", 5) == 0;
    /* base64 comes in groups of 3 bytes: a buffer's data may be padded past its length */
    enum lw_status status = is_data ? fetch_data(uri, size_max + 3, &storage, &size, err)
                                    : fetch_file(document, uri, size_max, whole, &storage, &size, err);
    if (status) return status;
    if (size < size_min) {
        free(storage);
        return lw_status_fail(err, LW_BAD_DATA, "uri \"%.*s\": has %zu bytes, %llu are declared",
                              is_data ? 40 : 200, uri, size, (unsigned long long)size_min);
    }
    *out_storage = storage;
    *out_size = size;
    return LW_OK;
}

/* ---- container ---- */

static uint32_t little_endian(const uint8_t *bytes) {
    return (uint32_t)bytes[0] | (uint32_t)bytes[1] << 8 | (uint32_t)bytes[2] << 16 | (uint32_t)bytes[3] << 24;
}

#define GLB_MAGIC      0x46546C67u /* "glTF" */
#define GLB_CHUNK_JSON 0x4E4F534Au
#define GLB_CHUNK_BIN  0x004E4942u

/* Binary glTF: glTF 2.0, 4.4. */
static enum lw_status open_container(struct lw_gltf_document *document, struct lw_gltf_bytes bytes,
                                     struct lw_gltf_bytes *out_json, struct lw_error *err) {
    if (bytes.size < 4 || little_endian(bytes.data) != GLB_MAGIC) {
        *out_json = bytes;
        return LW_OK;
    }
    if (bytes.size < 20)
        return lw_status_fail(err, LW_BAD_DATA, "is truncated: a .glb has at least 20 bytes");
    if (little_endian(bytes.data + 4) != 2)
        return lw_status_fail(err, LW_BAD_DATA, "is binary glTF %u; only version 2 is read",
                              little_endian(bytes.data + 4));
    uint32_t length = little_endian(bytes.data + 8);
    if (length > bytes.size)
        return lw_status_fail(err, LW_BAD_DATA, "has %zu bytes, its header says %u: it is truncated",
                              bytes.size, length);
    if (length < 20)
        return lw_status_fail(err, LW_BAD_DATA, "its header says %u bytes: it is truncated", length);
    if (length < bytes.size) {
        lw_log(LW_LOG_WARNING, "%s: %zu bytes after its end are ignored", document->name,
               bytes.size - length);
        bytes.size = length;
    }
    size_t at = 12;
    for (unsigned chunk = 0; at < bytes.size; chunk++) {
        if (bytes.size - at < 8)
            return lw_status_fail(err, LW_BAD_DATA, "chunk %u: its header is truncated", chunk);
        uint32_t size = little_endian(bytes.data + at), type = little_endian(bytes.data + at + 4);
        at += 8;
        if (size > bytes.size - at)
            return lw_status_fail(err, LW_BAD_DATA, "chunk %u: its %u bytes reach past the end of the file",
                                  chunk, size);
        if (size % 4)
            return lw_status_fail(err, LW_BAD_DATA, "chunk %u: its size is not a multiple of 4", chunk);
        if ((chunk == 0) != (type == GLB_CHUNK_JSON))
            return lw_status_fail(err, LW_BAD_DATA, "chunk %u: the first chunk, and no other, must be JSON",
                                  chunk);
        if (type == GLB_CHUNK_BIN && chunk != 1)
            return lw_status_fail(err, LW_BAD_DATA, "chunk %u: a BIN chunk must be the second", chunk);
        if (type == GLB_CHUNK_JSON) *out_json = (struct lw_gltf_bytes){bytes.data + at, size};
        if (type == GLB_CHUNK_BIN) document->binary = (struct lw_gltf_bytes){bytes.data + at, size};
        at += size;
    }
    return LW_OK;
}

static enum lw_status parse_json(struct lw_gltf_document *document, struct lw_gltf_bytes json,
                                 struct lw_error *err) {
    if (json.size > LW_GLTF_JSON_SIZE_MAX)
        return lw_status_fail(err, LW_BAD_DATA, "its JSON has %zu bytes; the limit is %llu", json.size,
                              (unsigned long long)LW_GLTF_JSON_SIZE_MAX);
    json_error_t cause;
    if (json.size >= 3 && memcmp(json.data, "\xEF\xBB\xBF", 3) == 0) {
        lw_log(LW_LOG_WARNING, "%s: its JSON starts with a byte order mark, which is ignored",
               document->name);
        json = (struct lw_gltf_bytes){json.data + 3, json.size - 3};
    }
    document->root = json_loadb((const char *)json.data, json.size, JSON_REJECT_DUPLICATES, &cause);
    if (!document->root && json_error_code(&cause) == json_error_out_of_memory)
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory for its JSON");
    if (!document->root)
        return lw_status_fail(err, LW_BAD_DATA, "line %d, column %d: %s", cause.line, cause.column,
                              cause.text);
    if (!json_is_object(document->root))
        return lw_status_fail(err, LW_BAD_DATA, "is not glTF: its JSON is not an object");
    return LW_OK;
}

/* ---- top level ---- */

static enum lw_status check_asset(const json_t *root, struct lw_error *err) {
    const json_t *asset = NULL;
    const char *version = NULL, *version_min = "2.0";
    if (lw_gltf_json_require(root, "asset", err) || lw_gltf_json_object(root, "asset", &asset, err))
        return err->status;
    if (lw_gltf_json_require(asset, "version", err) || lw_gltf_json_string(asset, "version", &version, err) ||
        lw_gltf_json_string(asset, "minVersion", &version_min, err)) {
        lw_status_context(err, "asset");
        return err->status;
    }
    if (strncmp(version, "2.", 2) != 0 || strcmp(version_min, "2.0") != 0)
        return lw_status_fail(err, LW_BAD_DATA, "asset: is glTF %.20s; only 2.0 is read",
                              strcmp(version_min, "2.0") ? version_min : version);
    return LW_OK;
}

static bool is_among(const char *extension, const char *const *names, size_t count) {
    for (size_t i = 0; i < count; i++)
        if (strcmp(extension, names[i]) == 0) return true;
    return false;
}

static bool is_supported(const char *extension) {
    return is_among(extension, supported_extensions,
                    sizeof supported_extensions / sizeof *supported_extensions);
}

static enum lw_status check_required(const char *extension, struct lw_error *err) {
    if (is_supported(extension) ||
        is_among(extension, harmless_extensions, sizeof harmless_extensions / sizeof *harmless_extensions))
        return LW_OK;
    if (strcmp(extension, "KHR_texture_basisu") == 0)
        return lw_status_fail(err, LW_BAD_DATA,
                              "requires the extension KHR_texture_basisu (KTX2 textures), which is not "
                              "supported; convert it: gltf-transform ktxdecompress IN.glb OUT.glb");
    return lw_status_fail(
        err, LW_BAD_DATA,
        "requires the extension %.100s, which is not supported; export the scene without it", extension);
}

static enum lw_status check_extensions(struct lw_gltf_document *document, struct lw_error *err) {
    const json_t *required = NULL, *used = NULL, *item;
    size_t i, ignored = 0;
    if (lw_gltf_json_array(document->root, "extensionsRequired", &required, err) ||
        lw_gltf_json_array(document->root, "extensionsUsed", &used, err))
        return err->status;
    json_array_foreach(required, i, item) {
        if (!json_is_string(item))
            return lw_status_fail(err, LW_BAD_DATA, "extensionsRequired[%zu]: must be a string", i);
        if (check_required(json_string_value(item), err)) return err->status;
        document->quantized |= strcmp(json_string_value(item), "KHR_mesh_quantization") == 0;
    }
    json_array_foreach(used, i, item) {
        if (!json_is_string(item))
            return lw_status_fail(err, LW_BAD_DATA, "extensionsUsed[%zu]: must be a string", i);
        document->quantized |= strcmp(json_string_value(item), "KHR_mesh_quantization") == 0;
        if (is_supported(json_string_value(item)) || ++ignored > EXTENSIONS_TOLD_MAX) continue;
        lw_log(LW_LOG_WARNING, "%s: the extension %.100s is ignored", document->name,
               json_string_value(item));
    }
    if (ignored > EXTENSIONS_TOLD_MAX)
        lw_log(LW_LOG_WARNING, "%s: %zu more extensions are ignored", document->name,
               ignored - EXTENSIONS_TOLD_MAX);
    return LW_OK;
}

static enum lw_status open_list(struct lw_gltf_document *document, enum lw_gltf_list list,
                                struct lw_error *err) {
    const json_t *array = NULL, *item;
    size_t i;
    if (list == LW_GLTF_LIGHTS) {
        const json_t *extension = NULL;
        if (lw_gltf_json_extension(document->root, "KHR_lights_punctual", &extension, err))
            return err->status;
        if (extension && lw_gltf_json_array(extension, "lights", &array, err)) {
            lw_status_context(err, "extensions.KHR_lights_punctual");
            return err->status;
        }
    } else if (lw_gltf_json_array(document->root, list_key[list], &array, err)) {
        return err->status;
    }
    json_array_foreach(array, i, item) {
        if (!json_is_object(item))
            return lw_status_fail(err, LW_BAD_DATA, "%s[%zu]: must be an object", list_key[list], i);
    }
    document->list[list] = array;
    document->count[list] = (uint32_t)json_array_size(array); /* fits: each takes bytes of JSON */
    return LW_OK;
}

/* ---- buffers ---- */

static enum lw_status open_buffer(struct lw_gltf_document *document, uint32_t index, uint64_t *total,
                                  struct lw_error *err) {
    const json_t *object = lw_gltf_document_item(document, LW_GLTF_BUFFERS, index);
    const json_t *meshopt = NULL;
    const char *uri = NULL;
    uint64_t size = 0;
    bool fallback = false;
    if (lw_gltf_json_extension(object, "EXT_meshopt_compression", &meshopt, err) ||
        (meshopt && lw_gltf_json_flag(meshopt, "fallback", &fallback, err)) ||
        lw_gltf_json_require(object, "byteLength", err) ||
        lw_gltf_json_integer(object, "byteLength", 1, LW_GLTF_FILE_SIZE_MAX, &size, err) ||
        lw_gltf_json_string(object, "uri", &uri, err))
        return err->status;
    if (fallback) {
        document->buffer[index] = (struct lw_gltf_bytes){NULL, size};
        return LW_OK;
    }
    *total += size;
    if (*total > LW_GLTF_BUFFERS_SIZE_MAX)
        return lw_status_fail(err, LW_BAD_DATA, "the buffers together have more than %llu bytes",
                              (unsigned long long)LW_GLTF_BUFFERS_SIZE_MAX);
    if (!uri) {
        if (index > 0 || !document->binary.data)
            return lw_status_fail(err, LW_BAD_DATA, "uri: is missing, and there is no BIN chunk for it");
        if (document->binary.size < size)
            return lw_status_fail(err, LW_BAD_DATA,
                                  "byteLength: %llu bytes are declared, the BIN chunk has %zu",
                                  (unsigned long long)size, document->binary.size);
        document->buffer[index] = (struct lw_gltf_bytes){document->binary.data, size};
        return LW_OK;
    }
    size_t got;
    if (lw_gltf_document_fetch(document, uri, size, size, false, &document->buffer_storage[index], &got,
                               err)) {
        /* the scene is there, a part of it is not: that is a broken scene */
        if (err->status == LW_NO_INPUT) err->status = LW_BAD_DATA;
        return err->status;
    }
    document->buffer[index] = (struct lw_gltf_bytes){document->buffer_storage[index], size};
    return LW_OK;
}

/* Where a compressed view's stream is. */
static enum lw_status read_compressed(const struct lw_gltf_document *document, const json_t *extension,
                                      struct lw_gltf_bytes *out, struct lw_error *err) {
    uint32_t buffer = 0;
    uint64_t offset = 0, size = 0;
    if (lw_gltf_json_require(extension, "buffer", err) ||
        lw_gltf_document_index(document, extension, "buffer", LW_GLTF_BUFFERS, &buffer, err) ||
        lw_gltf_json_integer(extension, "byteOffset", 0, LW_GLTF_FILE_SIZE_MAX, &offset, err) ||
        lw_gltf_json_require(extension, "byteLength", err) ||
        lw_gltf_json_integer(extension, "byteLength", 1, LW_GLTF_FILE_SIZE_MAX, &size, err))
        return err->status;
    const struct lw_gltf_bytes *source = &document->buffer[buffer];
    if (!source->data)
        return lw_status_fail(err, LW_BAD_DATA, "buffer: buffers[%u] is a fallback and has no bytes", buffer);
    if (offset > source->size || size > source->size - offset)
        return lw_status_fail(err, LW_BAD_DATA, "reaches past the end of buffers[%u]", buffer);
    *out = (struct lw_gltf_bytes){source->data + offset, size};
    return LW_OK;
}

static enum lw_status open_compressed_view(struct lw_gltf_document *document, uint32_t index,
                                           const json_t *extension, uint64_t size, uint64_t *total,
                                           struct lw_error *err) {
    size_t stride = 0;
    *total += size;
    if (*total > LW_GLTF_BUFFERS_SIZE_MAX)
        return lw_status_fail(err, LW_BAD_DATA,
                              "the buffers together, decompressed, have more than %llu bytes",
                              (unsigned long long)LW_GLTF_BUFFERS_SIZE_MAX);
    struct lw_gltf_bytes source = {0};
    if (read_compressed(document, extension, &source, err) ||
        lw_gltf_meshopt_decode(extension, source.data, source.size, size, &document->view_storage[index],
                               &stride, err)) {
        lw_status_context(err, "EXT_meshopt_compression");
        return err->status;
    }
    document->view[index] = (struct lw_gltf_buffer_view){{document->view_storage[index], size}, stride};
    return LW_OK;
}

static enum lw_status open_view(struct lw_gltf_document *document, uint32_t index, uint64_t *total,
                                struct lw_error *err) {
    const json_t *object = lw_gltf_document_item(document, LW_GLTF_BUFFER_VIEWS, index), *compressed = NULL;
    uint32_t buffer = 0;
    uint64_t offset = 0, size = 0, stride = 0;
    if (lw_gltf_json_require(object, "buffer", err) ||
        lw_gltf_document_index(document, object, "buffer", LW_GLTF_BUFFERS, &buffer, err) ||
        lw_gltf_json_integer(object, "byteOffset", 0, LW_GLTF_FILE_SIZE_MAX, &offset, err) ||
        lw_gltf_json_require(object, "byteLength", err) ||
        lw_gltf_json_integer(object, "byteLength", 1, LW_GLTF_FILE_SIZE_MAX, &size, err) ||
        lw_gltf_json_integer(object, "byteStride", 4, 252, &stride, err) ||
        lw_gltf_json_extension(object, "EXT_meshopt_compression", &compressed, err))
        return err->status;
    if (compressed) return open_compressed_view(document, index, compressed, size, total, err);
    if (!document->buffer[buffer].data)
        return lw_status_fail(err, LW_BAD_DATA, "buffer: buffers[%u] is a fallback and has no bytes", buffer);
    if (offset > document->buffer[buffer].size || size > document->buffer[buffer].size - offset)
        return lw_status_fail(err, LW_BAD_DATA, "reaches past the end of buffers[%u]", buffer);
    if (stride % 4) return lw_status_fail(err, LW_BAD_DATA, "byteStride: must be a multiple of 4");
    document->view[index] =
        (struct lw_gltf_buffer_view){{document->buffer[buffer].data + offset, size}, stride};
    return LW_OK;
}

static enum lw_status open_buffers(struct lw_gltf_document *document, struct lw_error *err) {
    uint32_t buffer_count = document->count[LW_GLTF_BUFFERS],
             view_count = document->count[LW_GLTF_BUFFER_VIEWS];
    uint64_t total = 0;
    document->buffer = calloc(buffer_count + 1ul, sizeof *document->buffer);
    document->buffer_storage = calloc(buffer_count + 1ul, sizeof *document->buffer_storage);
    document->view = calloc(view_count + 1ul, sizeof *document->view);
    document->view_storage = calloc(view_count + 1ul, sizeof *document->view_storage);
    if (!document->buffer || !document->buffer_storage || !document->view || !document->view_storage)
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory for its buffers");
    for (uint32_t i = 0; i < buffer_count; i++)
        if (open_buffer(document, i, &total, err)) {
            lw_status_context(err, "buffers[%u]", i);
            return err->status;
        }
    for (uint32_t i = 0; i < view_count; i++)
        if (open_view(document, i, &total, err)) {
            lw_status_context(err, "bufferViews[%u]", i);
            return err->status;
        }
    return LW_OK;
}

enum lw_status lw_gltf_document_init(struct lw_gltf_document *document, const char *name, const char *folder,
                                     struct lw_gltf_bytes bytes, struct lw_error *err) {
    *document = (struct lw_gltf_document){.name = name};
    if (folder && !(document->folder = strdup(folder)))
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    struct lw_gltf_bytes json = {0};
    if (open_container(document, bytes, &json, err) || parse_json(document, json, err) ||
        check_asset(document->root, err) || check_extensions(document, err))
        return err->status;
    for (int list = 0; list < LW_GLTF_LIST_COUNT; list++)
        if (open_list(document, (enum lw_gltf_list)list, err)) return err->status;
    return open_buffers(document, err);
}

void lw_gltf_document_finish(struct lw_gltf_document *document) {
    for (uint32_t i = 0; document->buffer_storage && i < document->count[LW_GLTF_BUFFERS]; i++)
        free(document->buffer_storage[i]);
    for (uint32_t i = 0; document->view_storage && i < document->count[LW_GLTF_BUFFER_VIEWS]; i++)
        free(document->view_storage[i]);
    free(document->view_storage);
    free(document->view);
    free(document->buffer_storage);
    free(document->buffer);
    json_decref(document->root);
    free(document->moves_skin);
    free(document->light_of);
    free(document->folder);
    *document = (struct lw_gltf_document){0};
}

const json_t *lw_gltf_document_item(const struct lw_gltf_document *document, enum lw_gltf_list list,
                                    uint32_t index) {
    return json_array_get(document->list[list], index);
}

enum lw_status lw_gltf_document_index(const struct lw_gltf_document *document, const json_t *object,
                                      const char *key, enum lw_gltf_list list, uint32_t *out,
                                      struct lw_error *err) {
    const json_t *value = json_object_get(object, key);
    if (!value) return LW_OK;
    uint64_t index;
    if (!lw_gltf_json_whole(value, &index) || index >= document->count[list])
        return lw_status_fail(err, LW_BAD_DATA, "%s: must be an index into %s, which has %u elements", key,
                              list_key[list], document->count[list]);
    *out = (uint32_t)index;
    return LW_OK;
}
