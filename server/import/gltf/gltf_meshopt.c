#include "server/import/gltf/gltf_meshopt.h"

#include <meshoptimizer.h>
#include <stdlib.h>
#include <string.h>

#define COUNT_MAX  (1ull << 31)
#define STRIDE_MAX 256
/* A stream of vertices has at least two bits for 16 bytes of each; the others
 * are longer for what they hold. */
#define RATIO_MAX 64

enum mode { MODE_ATTRIBUTES, MODE_TRIANGLES, MODE_INDICES, MODE_COUNT };
static const char *const mode_name[MODE_COUNT] = {"ATTRIBUTES", "TRIANGLES", "INDICES"};
static const uint8_t mode_magic[MODE_COUNT] = {0xa0, 0xe0, 0xd0}; /* high four bits of the first byte */
static const unsigned version_max[MODE_COUNT] = {0, 1, 1};        /* the low four */

enum filter { FILTER_NONE, FILTER_OCTAHEDRAL, FILTER_QUATERNION, FILTER_EXPONENTIAL, FILTER_COUNT };
static const char *const filter_name[FILTER_COUNT] = {"NONE", "OCTAHEDRAL", "QUATERNION", "EXPONENTIAL"};

struct stream {
    const uint8_t *data;
    size_t size;
    uint64_t count, stride;
    unsigned mode, filter;
};

static unsigned find_name(const char *const *names, unsigned count, const char *name) {
    unsigned i = 0;
    while (i < count && strcmp(names[i], name) != 0) i++;
    return i;
}

/* The extension's rules for strides and counts, which the decoders assert. */
static enum lw_status check_layout(const struct stream *stream, uint64_t size, struct lw_error *err) {
    if (stream->mode == MODE_ATTRIBUTES ? stream->stride % 4 != 0
                                        : stream->stride != 2 && stream->stride != 4)
        return lw_status_fail(err, LW_BAD_DATA, "byteStride: must be %s for %s",
                              stream->mode == MODE_ATTRIBUTES ? "a multiple of 4" : "2 or 4",
                              mode_name[stream->mode]);
    if (stream->mode == MODE_TRIANGLES && stream->count % 3)
        return lw_status_fail(err, LW_BAD_DATA, "count: must be a multiple of 3 for TRIANGLES");
    bool fits = stream->filter == FILTER_OCTAHEDRAL   ? stream->stride == 4 || stream->stride == 8
                : stream->filter == FILTER_QUATERNION ? stream->stride == 8
                                                      : true;
    if (!fits || (stream->filter && stream->mode != MODE_ATTRIBUTES))
        return lw_status_fail(err, LW_BAD_DATA, "filter: %s cannot be used with %s of %llu bytes",
                              filter_name[stream->filter], mode_name[stream->mode],
                              (unsigned long long)stream->stride);
    if (stream->count * stream->stride != size)
        return lw_status_fail(err, LW_BAD_DATA, "count x byteStride is %llu bytes, the view has %llu",
                              (unsigned long long)(stream->count * stream->stride), (unsigned long long)size);
    if (size / RATIO_MAX > stream->size)
        return lw_status_fail(err, LW_BAD_DATA, "byteLength: %zu bytes cannot hold %llu", stream->size,
                              (unsigned long long)size);
    return LW_OK;
}

static enum lw_status check_version(const struct stream *stream, struct lw_error *err) {
    uint8_t first = stream->data[0];
    if ((first & 0xf0) != mode_magic[stream->mode])
        return lw_status_fail(err, LW_BAD_DATA, "mode: the stream is none of %s", mode_name[stream->mode]);
    if ((first & 0x0fu) > version_max[stream->mode])
        return lw_status_fail(err, LW_BAD_DATA,
                              "the stream of %s has version %u of meshoptimizer's format; up to %u is read",
                              mode_name[stream->mode], first & 0x0fu, version_max[stream->mode]);
    return LW_OK;
}

static enum lw_status open_stream(const json_t *extension, uint64_t size, struct stream *out,
                                  struct lw_error *err) {
    const char *mode = "", *filter = "NONE";
    if (lw_gltf_json_require(extension, "count", err) ||
        lw_gltf_json_integer(extension, "count", 1, COUNT_MAX, &out->count, err) ||
        lw_gltf_json_require(extension, "byteStride", err) ||
        lw_gltf_json_integer(extension, "byteStride", 1, STRIDE_MAX, &out->stride, err) ||
        lw_gltf_json_require(extension, "mode", err) || lw_gltf_json_string(extension, "mode", &mode, err) ||
        lw_gltf_json_string(extension, "filter", &filter, err))
        return err->status;
    out->mode = find_name(mode_name, MODE_COUNT, mode);
    out->filter = find_name(filter_name, FILTER_COUNT, filter);
    if (out->mode == MODE_COUNT)
        return lw_status_fail(err, LW_BAD_DATA, "mode: must be ATTRIBUTES, TRIANGLES or INDICES");
    if (out->filter == FILTER_COUNT)
        return lw_status_fail(err, LW_BAD_DATA,
                              "filter: must be NONE, OCTAHEDRAL, QUATERNION or EXPONENTIAL");
    return check_layout(out, size, err) ? err->status : check_version(out, err);
}

static bool decode(const struct stream *stream, uint8_t *out) {
    size_t count = stream->count, stride = stream->stride;
    int failed = 0;
    switch (stream->mode) {
    case MODE_ATTRIBUTES:
        failed = meshopt_decodeVertexBuffer(out, count, stride, stream->data, stream->size);
        break;
    case MODE_TRIANGLES:
        failed = meshopt_decodeIndexBuffer(out, count, stride, stream->data, stream->size);
        break;
    default:
        failed = meshopt_decodeIndexSequence(out, count, stride, stream->data, stream->size);
        break;
    }
    if (failed) return false;
    if (stream->filter == FILTER_OCTAHEDRAL) meshopt_decodeFilterOct(out, count, stride);
    if (stream->filter == FILTER_QUATERNION) meshopt_decodeFilterQuat(out, count, stride);
    if (stream->filter == FILTER_EXPONENTIAL) meshopt_decodeFilterExp(out, count, stride);
    return true;
}

enum lw_status lw_gltf_meshopt_decode(const json_t *extension, const uint8_t *data, size_t data_size,
                                      uint64_t size, uint8_t **out_storage, size_t *out_stride,
                                      struct lw_error *err) {
    struct stream stream = {.data = data, .size = data_size};
    if (open_stream(extension, size, &stream, err)) return err->status;
    uint8_t *storage = malloc(size);
    if (!storage)
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory for %llu bytes", (unsigned long long)size);
    if (!decode(&stream, storage)) {
        free(storage);
        return lw_status_fail(err, LW_BAD_DATA, "its stream of %zu bytes is corrupt", stream.size);
    }
    *out_storage = storage;
    *out_stride = stream.mode == MODE_ATTRIBUTES ? stream.stride : 0;
    return LW_OK;
}
