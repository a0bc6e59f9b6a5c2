#include "client/lib/download.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>
#include <zstd.h>

#define CAPACITY_START (256u << 10) /* bytes */

enum lw_status lw_download_init(struct lw_download *download, const struct lw_message_welcome *welcome) {
    *download = (struct lw_download){.zstd = ZSTD_createDCtx(),
                                     .package_size = welcome->package_size,
                                     .compressed_size = welcome->package_compressed_size,
                                     .hash = welcome->package_hash};
    return download->zstd ? LW_OK : LW_NO_MEMORY;
}

void lw_download_finish(struct lw_download *download) {
    ZSTD_freeDCtx(download->zstd);
    free(download->bytes);
    download->zstd = NULL;
    download->bytes = NULL;
}

static enum lw_status grow(struct lw_download *d, struct lw_error *err) {
    uint64_t capacity = d->capacity ? 2 * (uint64_t)d->capacity : CAPACITY_START;
    if (capacity > d->package_size) capacity = d->package_size;
    uint8_t *grown = realloc(d->bytes, (size_t)capacity);
    if (!grown)
        return lw_status_fail(err, LW_NO_MEMORY, "scene package: out of memory after %zu bytes", d->size);
    d->bytes = grown;
    d->capacity = (size_t)capacity;
    return LW_OK;
}

static enum lw_status decompress(struct lw_download *d, const uint8_t *data, size_t size,
                                 struct lw_error *err) {
    ZSTD_inBuffer in = {data, size, 0};
    for (;;) {
        if (d->stream_ended && in.pos < in.size)
            return lw_status_fail(err, LW_PROTOCOL, "scene package: bytes after its end");
        if (d->stream_ended) return LW_OK;
        if (d->size == d->capacity && d->capacity < d->package_size) {
            enum lw_status status = grow(d, err);
            if (status != LW_OK) return status;
        }
        ZSTD_outBuffer out = {d->bytes, d->capacity, d->size};
        size_t before = in.pos, result = ZSTD_decompressStream(d->zstd, &out, &in);
        if (ZSTD_isError(result))
            return lw_status_fail(err, LW_PROTOCOL, "scene package: %s", ZSTD_getErrorName(result));
        bool advanced = out.pos > d->size || in.pos > before, full = out.pos == d->capacity;
        d->size = out.pos;
        d->stream_ended = result == 0;
        /* input used up and room left: zstd has nothing more to give */
        if (!d->stream_ended && in.pos == in.size && !full) return LW_OK;
        if (!d->stream_ended && !advanced && d->capacity == d->package_size) {
            if (in.pos == in.size) return LW_OK;
            return lw_status_fail(err, LW_PROTOCOL, "scene package: more than the %" PRIu64 " bytes promised",
                                  d->package_size);
        }
    }
}

static enum lw_status check_whole(struct lw_download *d, struct lw_error *err) {
    if (!d->stream_ended || d->size != d->package_size)
        return lw_status_fail(err, LW_PROTOCOL, "scene package: %zu bytes where %" PRIu64 " were promised",
                              d->size, d->package_size);
    struct lw_package_hash hash;
    lw_package_hash(d->bytes, d->size, &hash);
    if (memcmp(hash.bytes, d->hash.bytes, sizeof hash.bytes) != 0)
        return lw_status_fail(err, LW_PROTOCOL, "scene package: its hash is not the one promised");
    return LW_OK;
}

enum lw_status lw_download_add(struct lw_download *d, const struct lw_message_package_chunk *chunk,
                               struct lw_error *err) {
    if (chunk->offset != d->received)
        return lw_status_fail(err, LW_PROTOCOL,
                              "scene package: chunk at %" PRIu64 " where %" PRIu64 " was expected",
                              chunk->offset, d->received);
    if (chunk->size > d->compressed_size - d->received)
        return lw_status_fail(err, LW_PROTOCOL, "scene package: more than the %" PRIu64 " bytes promised",
                              d->compressed_size);
    d->received += chunk->size;
    enum lw_status status = decompress(d, chunk->data, chunk->size, err);
    if (status != LW_OK || d->received < d->compressed_size) return status;
    return check_whole(d, err);
}

bool lw_download_is_complete(const struct lw_download *d) {
    return d->received == d->compressed_size && d->stream_ended && d->size == d->package_size;
}
