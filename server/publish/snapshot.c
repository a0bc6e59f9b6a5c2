#include "server/publish/snapshot.h"

#include "common/base/invariant.h"

#include <stdlib.h>

enum lw_status lw_blob_create(size_t size, struct lw_blob **out_blob) {
    if (size > SIZE_MAX - sizeof(struct lw_blob)) return LW_NO_MEMORY;
    struct lw_blob *blob = malloc(sizeof *blob + size);
    if (!blob) return LW_NO_MEMORY;
    atomic_init(&blob->references, 1);
    blob->size = size;
    *out_blob = blob;
    return LW_OK;
}

enum lw_status lw_blob_from_message(const struct lw_message *message, struct lw_blob **out_blob) {
    struct lw_blob *blob;
    const size_t size = lw_message_size(message);
    enum lw_status status = lw_blob_create(size, &blob);
    if (status != LW_OK) return status;
    status = lw_message_encode(message, blob->bytes, size, &blob->size);
    LW_INVARIANT(status != LW_OK || blob->size == size);
    if (status == LW_OK)
        *out_blob = blob;
    else
        lw_blob_unref(blob);
    return status;
}

/* Taking a reference needs no memory order: the caller holds one already. Dropping one is a release of this
 * thread's writes; dropping the last one acquires the writes of all threads before it frees. */
static void add_reference(_Atomic uint32_t *references) {
    uint32_t before = atomic_fetch_add_explicit(references, 1, memory_order_relaxed);
    LW_INVARIANT(before - 1 < UINT32_MAX - 1); /* above 0, and there is one more */
    (void)before;
}

static bool drop_reference(_Atomic uint32_t *references) {
    uint32_t before = atomic_fetch_sub_explicit(references, 1, memory_order_acq_rel);
    LW_INVARIANT(before > 0);
    return before == 1;
}

struct lw_blob *lw_blob_ref(struct lw_blob *blob) {
    add_reference(&blob->references);
    return blob;
}

void lw_blob_unref(struct lw_blob *blob) {
    if (blob && drop_reference(&blob->references)) free(blob);
}

enum lw_status lw_snapshot_create(uint32_t tile_count, uint32_t channels, struct lw_snapshot **out_snapshot) {
    struct lw_snapshot *snapshot = calloc(1, sizeof *snapshot);
    LW_INVARIANT(channels >> LW_TILE_CHANNELS_MAX == 0);
    if (!snapshot) return LW_NO_MEMORY;
    atomic_init(&snapshot->references, 1);
    snapshot->channels = channels;
    snapshot->tile_count = tile_count;
    for (unsigned c = 0; c < LW_TILE_CHANNELS_MAX; c++) {
        if (!lw_snapshot_has(snapshot, c)) continue;
        if ((snapshot->tile[c] = calloc((size_t)tile_count + 1, sizeof *snapshot->tile[c]))) continue;
        lw_snapshot_unref(snapshot);
        return LW_NO_MEMORY;
    }
    *out_snapshot = snapshot;
    return LW_OK;
}

struct lw_snapshot *lw_snapshot_ref(struct lw_snapshot *snapshot) {
    add_reference(&snapshot->references);
    return snapshot;
}

void lw_snapshot_unref(struct lw_snapshot *snapshot) {
    if (!snapshot || !drop_reference(&snapshot->references)) return;
    lw_blob_unref(snapshot->frame_delta);
    lw_blob_unref(snapshot->frame_full);
    lw_blob_unref(snapshot->settled);
    for (unsigned c = 0; c < LW_TILE_CHANNELS_MAX; c++) {
        for (uint32_t i = 0; snapshot->tile[c] && i < snapshot->tile_count; i++) {
            lw_blob_unref(snapshot->tile[c][i].blob);
            lw_blob_unref(snapshot->tile[c][i].delta);
        }
        free(snapshot->tile[c]);
    }
    free(snapshot->holds_fine);
    free(snapshot);
}
