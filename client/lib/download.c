#include "client/lib/download.h"

#include "common/base/invariant.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>
#include <zstd.h>

#define CAPACITY_START (256u << 10) /* bytes */

/* Without a list the package is one part, whose hash is its own. */
static void list_parts(struct lw_download *d, const struct lw_message_package *package) {
    uint64_t end = 0, compressed_end = 0;
    for (size_t i = 0; i < package->part_count; i++) {
        end += package->part_size[i];
        compressed_end += package->part_compressed_size[i];
        d->part[i] = (struct lw_download_part){
            .end = end, .compressed_end = compressed_end, .hash = package->part_hash[i]};
    }
    LW_INVARIANT(!package->part_count ||
                 (end == package->size && compressed_end == package->compressed_size));
    if (!package->part_count)
        d->part[0] = (struct lw_download_part){
            .end = package->size, .compressed_end = package->compressed_size, .hash = package->hash};
}

enum lw_status lw_download_init(struct lw_download *download, const char *what,
                                const struct lw_message_package *package, lw_download_find *find,
                                void *where) {
    const size_t count = package->part_count ? package->part_count : 1;
    *download = (struct lw_download){.zstd = ZSTD_createDCtx(),
                                     .package_size = package->size,
                                     .what = what,
                                     .compressed_size = package->compressed_size,
                                     .hash = package->hash,
                                     .part = calloc(count, sizeof *download->part),
                                     .part_count = count};
    if (!download->zstd || !download->part) {
        lw_download_finish(download);
        return LW_NO_MEMORY;
    }
    list_parts(download, package);
    if (find && package->part_count) lw_download_find_held(download, find, where);
    return LW_OK;
}

void lw_download_find_held(struct lw_download *d, lw_download_find *find, void *where) {
    LW_INVARIANT(d->parts_done <= d->part_count);
    for (size_t i = d->parts_done; i < d->part_count; i++) {
        struct lw_download_part *part = &d->part[i];
        const bool has_begun = i == d->parts_done && d->received > (i ? d->part[i - 1].compressed_end : 0);
        if (part->held || has_begun) continue;
        part->held = find(where, &part->hash, part->end - (i ? d->part[i - 1].end : 0));
        part->was_held = part->held;
    }
}

void lw_download_finish(struct lw_download *download) {
    ZSTD_freeDCtx(download->zstd);
    for (size_t i = 0; download->part && i < download->part_count; i++) free(download->part[i].held);
    free(download->part);
    free(download->bytes);
    download->zstd = NULL;
    download->part = NULL;
    download->bytes = NULL;
}

enum lw_status lw_download_request(const struct lw_download *d,
                                   struct lw_message_package_request *out_request, uint8_t **out_held) {
    const size_t size = (d->part_count + 7) / 8;
    uint8_t *held = NULL;
    for (size_t i = 0; i < d->part_count; i++) {
        if (!d->part[i].was_held) continue;
        if (!held && !(held = calloc(size, 1))) return LW_NO_MEMORY;
        held[i / 8] |= (uint8_t)(1 << (i % 8));
    }
    LW_INVARIANT(d->received <= d->compressed_size);
    *out_request = (struct lw_message_package_request){d->received, held, held ? size : 0};
    *out_held = held;
    return LW_OK;
}

/* Room for `size` bytes in all, some more, and no more than the package has. */
static enum lw_status reserve(struct lw_download *d, uint64_t size, struct lw_error *err) {
    if (size <= d->capacity) return LW_OK;
    uint64_t capacity = d->capacity ? 2 * (uint64_t)d->capacity : CAPACITY_START;
    if (capacity < size) capacity = size;
    if (capacity > d->package_size) capacity = d->package_size;
    LW_INVARIANT(capacity >= size); /* no part ends past the package */
    uint8_t *grown = realloc(d->bytes, (size_t)capacity);
    if (!grown)
        return lw_status_fail(err, LW_NO_MEMORY, "%s: out of memory after %zu bytes", d->what, d->size);
    d->bytes = grown;
    d->capacity = (size_t)capacity;
    return LW_OK;
}

static enum lw_status check_whole(struct lw_download *d, struct lw_error *err) {
    struct lw_package_hash hash;
    lw_package_hash(d->bytes, d->size, &hash);
    if (memcmp(hash.bytes, d->hash.bytes, sizeof hash.bytes) != 0)
        return lw_status_fail(err, LW_PROTOCOL, "%s: its hash is not the one promised", d->what);
    return LW_OK;
}

/* Behind a part: those that are held, up to the next that is not. */
static enum lw_status take_held(struct lw_download *d, struct lw_error *err) {
    for (; d->parts_done < d->part_count && d->part[d->parts_done].held; d->parts_done++) {
        struct lw_download_part *part = &d->part[d->parts_done];
        enum lw_status status = reserve(d, part->end, err);
        if (status != LW_OK) return status;
        LW_INVARIANT(d->size == (d->parts_done ? part[-1].end : 0) && part->end <= d->capacity);
        memcpy(d->bytes + d->size, part->held, (size_t)part->end - d->size);
        free(part->held);
        part->held = NULL;
        d->size = (size_t)part->end;
        d->received = part->compressed_end;
    }
    return d->parts_done == d->part_count ? check_whole(d, err) : LW_OK;
}

enum lw_status lw_download_begin(struct lw_download *d, struct lw_error *err) { return take_held(d, err); }

/* Bytes of the part that is being received: *out_ended: its frame is complete. */
static enum lw_status decompress(struct lw_download *d, const uint8_t *data, size_t size, bool *out_ended,
                                 struct lw_error *err) {
    const struct lw_download_part *part = &d->part[d->parts_done];
    ZSTD_inBuffer in = {data, size, 0};
    *out_ended = false;
    for (;;) {
        if (*out_ended && in.pos < in.size)
            return lw_status_fail(err, LW_PROTOCOL, "%s: bytes after its end", d->what);
        if (*out_ended) return LW_OK;
        if (d->size == d->capacity && d->size < part->end) {
            enum lw_status status = reserve(d, (uint64_t)d->size + 1, err);
            if (status != LW_OK) return status;
        }
        ZSTD_outBuffer out = {d->bytes, d->capacity < part->end ? d->capacity : (size_t)part->end, d->size};
        size_t before = in.pos, result = ZSTD_decompressStream(d->zstd, &out, &in);
        if (ZSTD_isError(result))
            return lw_status_fail(err, LW_PROTOCOL, "%s: %s", d->what, ZSTD_getErrorName(result));
        bool advanced = out.pos > d->size || in.pos > before, full = out.pos == out.size;
        LW_INVARIANT(out.pos >= d->size && out.pos <= d->capacity && out.pos <= part->end);
        d->size = out.pos;
        *out_ended = result == 0;
        /* input used up and room left: zstd has nothing more to give */
        if (!*out_ended && in.pos == in.size && !full) return LW_OK;
        if (!*out_ended && !advanced && d->size == part->end) {
            if (in.pos == in.size) return LW_OK;
            return lw_status_fail(err, LW_PROTOCOL, "%s: more than the %" PRIu64 " bytes promised", d->what,
                                  d->package_size);
        }
    }
}

enum lw_status lw_download_add(struct lw_download *d, const struct lw_message_package_chunk *chunk,
                               struct lw_error *err) {
    if (chunk->offset != d->received)
        return lw_status_fail(err, LW_PROTOCOL, "%s: chunk at %" PRIu64 " where %" PRIu64 " was expected",
                              d->what, chunk->offset, d->received);
    if (d->parts_done == d->part_count || chunk->size > d->part[d->parts_done].compressed_end - d->received)
        return lw_status_fail(err, LW_PROTOCOL, "%s: more than the %" PRIu64 " bytes promised", d->what,
                              d->compressed_size);
    const struct lw_download_part *part = &d->part[d->parts_done];
    LW_INVARIANT(!part->held); /* held parts are taken, and never asked for */
    d->received += chunk->size;
    bool ended;
    enum lw_status status = decompress(d, chunk->data, chunk->size, &ended, err);
    if (status != LW_OK) return status;
    const bool is_all = d->received == part->compressed_end;
    if (ended && !is_all) return lw_status_fail(err, LW_PROTOCOL, "%s: bytes after its end", d->what);
    if (!is_all) return LW_OK;
    if (!ended || d->size != part->end)
        return lw_status_fail(err, LW_PROTOCOL, "%s: %zu bytes where %" PRIu64 " were promised", d->what,
                              d->size, part->end);
    d->parts_done++;
    return take_held(d, err);
}

bool lw_download_is_complete(const struct lw_download *d) { return d->parts_done == d->part_count; }
