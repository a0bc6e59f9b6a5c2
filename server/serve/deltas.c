#include "server/serve/deltas.h"

#include <stdlib.h>
#include <string.h>

enum lw_status lw_deltas_init(struct lw_deltas *deltas, uint32_t tile_count, struct lw_recoder *recoder) {
    *deltas = (struct lw_deltas){.tile_count = tile_count, .recoder = recoder};
    deltas->tile = calloc((size_t)tile_count + 1, sizeof *deltas->tile);
    return deltas->tile ? LW_OK : LW_NO_MEMORY;
}

/* They lead to what was the newest. */
static void forget_jumps(struct lw_deltas_of_tile *of) {
    for (uint32_t i = 0; i < of->count; i++) {
        lw_blob_unref(of->base[i].jump);
        of->base[i].jump = NULL;
        of->base[i].is_asked = of->base[i].is_known = false;
    }
}

static void forget(struct lw_deltas_of_tile *of, uint32_t count) {
    for (uint32_t i = 0; i < count; i++) {
        lw_blob_unref(of->base[i].whole);
        lw_blob_unref(of->base[i].delta);
        lw_blob_unref(of->base[i].jump);
    }
    of->count -= count;
    memmove(of->base, of->base + count, of->count * sizeof of->base[0]);
}

void lw_deltas_finish(struct lw_deltas *deltas) {
    for (uint32_t t = 0; deltas->tile && t < deltas->tile_count; t++) {
        forget(&deltas->tile[t], deltas->tile[t].count);
        lw_blob_unref(deltas->tile[t].whole);
    }
    free(deltas->tile);
    deltas->tile = NULL;
}

void lw_deltas_add(struct lw_deltas *deltas, uint32_t tile, const struct lw_snapshot_tile *version) {
    struct lw_deltas_of_tile *of = &deltas->tile[tile];
    const bool goes_on = version->delta && of->whole && of->version == version->base;
    forget_jumps(of);
    if (!goes_on)
        forget(of, of->count);
    else if (of->count == LW_DELTAS_KEPT)
        forget(of, 1);
    if (goes_on)
        of->base[of->count++] = (struct lw_delta_base){
            .version = of->version, .whole = of->whole, .delta = lw_blob_ref(version->delta)};
    else
        lw_blob_unref(of->whole);
    of->version = version->version;
    of->whole = lw_blob_ref(version->blob);
}

static struct lw_delta_base *find(struct lw_deltas_of_tile *of, uint64_t version) {
    for (uint32_t i = of->count; i-- > 0;)
        if (of->base[i].version == version) return &of->base[i];
    return NULL;
}

/* Of the last one the snapshot had it. */
static bool may_be_jumped(const struct lw_deltas *deltas, const struct lw_deltas_of_tile *of,
                          const struct lw_delta_base *base) {
    return deltas->recoder && base && base + 1 < of->base + of->count;
}

/* False if the recoder has too much to do. */
static bool ask(struct lw_deltas *deltas, uint32_t tile, struct lw_delta_base *base) {
    const struct lw_deltas_of_tile *of = &deltas->tile[tile];
    if (!base->is_asked)
        base->is_asked =
            lw_recoder_ask(deltas->recoder, &(struct lw_recoder_job){tile, base->version, of->version,
                                                                     base->whole, of->whole});
    return base->is_asked;
}

void lw_deltas_prepare(struct lw_deltas *deltas, uint32_t tile, uint64_t from) {
    struct lw_deltas_of_tile *of = &deltas->tile[tile];
    struct lw_delta_base *base = find(of, from);
    if (may_be_jumped(deltas, of, base)) (void)ask(deltas, tile, base);
}

bool lw_deltas_collect(struct lw_deltas *deltas) {
    bool any = false;
    for (struct lw_recoder_result result; deltas->recoder && lw_recoder_collect(deltas->recoder, &result);
         any = true) {
        struct lw_deltas_of_tile *of = &deltas->tile[result.tile];
        struct lw_delta_base *base = of->version == result.version ? find(of, result.base) : NULL;
        if (!base) { /* too late */
            lw_blob_unref(result.blob);
            continue;
        }
        base->is_known = true;
        base->jump = result.blob;
    }
    return any;
}

enum lw_deltas_way lw_deltas_next(struct lw_deltas *deltas, uint32_t tile, uint64_t from,
                                  struct lw_delta *out_delta) {
    struct lw_deltas_of_tile *of = &deltas->tile[tile];
    struct lw_delta_base *base = find(of, from), *end = of->base + of->count;
    if (!base) return LW_DELTAS_WHOLE;
    if (may_be_jumped(deltas, of, base) && !base->is_known && ask(deltas, tile, base)) return LW_DELTAS_WAIT;
    size_t chain = 0;
    for (const struct lw_delta_base *b = base; b < end; b++) chain += b->delta->size;
    if (base->jump && base->jump->size <= chain) { /* always smaller than the whole */
        *out_delta = (struct lw_delta){of->version, base->jump};
        return LW_DELTAS_DELTA;
    }
    if (base + 1 < end && chain >= of->whole->size) return LW_DELTAS_WHOLE;
    *out_delta = (struct lw_delta){base + 1 < end ? base[1].version : of->version, base->delta};
    return LW_DELTAS_DELTA;
}
