#include "server/serve/deltas.h"

#include <stdlib.h>
#include <string.h>

enum lw_status lw_deltas_init(struct lw_deltas *deltas, uint32_t tile_count) {
    *deltas = (struct lw_deltas){.tile_count = tile_count};
    deltas->tile = calloc((size_t)tile_count + 1, sizeof *deltas->tile);
    return deltas->tile ? LW_OK : LW_NO_MEMORY;
}

static void forget(struct lw_deltas_of_tile *of, uint32_t count) {
    for (uint32_t i = 0; i < count; i++) lw_blob_unref(of->delta[i].blob);
    of->count -= count;
    memmove(of->delta, of->delta + count, of->count * sizeof of->delta[0]);
}

void lw_deltas_finish(struct lw_deltas *deltas) {
    for (uint32_t t = 0; deltas->tile && t < deltas->tile_count; t++)
        forget(&deltas->tile[t], deltas->tile[t].count);
    free(deltas->tile);
    deltas->tile = NULL;
}

void lw_deltas_add(struct lw_deltas *deltas, uint32_t tile, const struct lw_snapshot_tile *version) {
    struct lw_deltas_of_tile *of = &deltas->tile[tile];
    const bool goes_on = version->delta && of->count && of->delta[of->count - 1].version == version->base;
    if (!goes_on)
        forget(of, of->count);
    else if (of->count == LW_DELTAS_KEPT)
        forget(of, 1);
    if (version->delta)
        of->delta[of->count++] =
            (struct lw_delta){version->base, version->version, lw_blob_ref(version->delta)};
}

const struct lw_delta *lw_deltas_next(const struct lw_deltas *deltas, uint32_t tile, uint64_t from,
                                      size_t whole_bytes) {
    const struct lw_deltas_of_tile *of = &deltas->tile[tile];
    size_t bytes = 0;
    for (uint32_t i = of->count; i-- > 0;) {
        const struct lw_delta *delta = &of->delta[i];
        bytes += delta->blob->size;
        if (delta->base != from) continue;
        return i + 1 == of->count || bytes < whole_bytes ? delta : NULL;
    }
    return NULL;
}
