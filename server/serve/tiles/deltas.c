#include "server/serve/tiles/deltas.h"

#include "common/base/invariant.h"

#include <stdlib.h>
#include <string.h>

/* A session that is to get coarse tiles goes on with finer ones while their deltas are under this share of
 * the tile whole: the coarse form whole, with which it would begin, is no smaller. */
#define FINE_SHARE (1.0f / 3)

enum lw_status lw_deltas_init(struct lw_deltas *deltas, uint32_t tile_count,
                              struct lw_transcoder *transcoder) {
    *deltas = (struct lw_deltas){.tile_count = tile_count,
                                 .transcoder = transcoder,
                                 .tile = calloc((size_t)tile_count + 1, sizeof *deltas->tile),
                                 .coarse = calloc((size_t)tile_count + 1, sizeof *deltas->coarse)};
    if (deltas->tile && deltas->coarse) return LW_OK;
    lw_deltas_finish(deltas);
    return LW_NO_MEMORY;
}

/* They lead to what was the newest. */
static void forget_jumps(struct lw_deltas_of_tile *of) {
    for (uint32_t i = 0; i < of->count; i++) {
        lw_blob_unref(of->base[i].jump);
        of->base[i].jump = NULL;
        of->base[i].is_asked = of->base[i].is_known = false;
    }
}

static void drop_oldest(struct lw_deltas_of_tile *of, uint32_t count) {
    LW_INVARIANT(count <= of->count && of->count <= LW_DELTAS_KEPT);
    for (uint32_t i = 0; i < count; i++) {
        lw_blob_unref(of->base[i].whole);
        lw_blob_unref(of->base[i].delta);
        lw_blob_unref(of->base[i].jump);
    }
    of->count -= count;
    if (count) memmove(of->base, of->base + count, of->count * sizeof of->base[0]);
}

static void free_tiles(struct lw_deltas_of_tile *tile, uint32_t tile_count) {
    for (uint32_t t = 0; tile && t < tile_count; t++) {
        drop_oldest(&tile[t], tile[t].count);
        lw_blob_unref(tile[t].whole);
        free(tile[t].base);
    }
    free(tile);
}

void lw_deltas_finish(struct lw_deltas *deltas) {
    free_tiles(deltas->tile, deltas->tile_count);
    free_tiles(deltas->coarse, deltas->tile_count);
    *deltas = (struct lw_deltas){0};
}

/* Each version is newer than the one before, and the newest than all. */
static bool is_ascending(const struct lw_deltas_of_tile *of) {
    for (uint32_t i = 0; i < of->count; i++)
        if (of->base[i].version >= (i + 1 < of->count ? of->base[i + 1].version : of->version)) return false;
    return true;
}

static void add(struct lw_deltas_of_tile *of, uint64_t version, struct lw_blob *whole, uint64_t base,
                struct lw_blob *delta) {
    bool goes_on = delta && of->whole && of->version == base;
    LW_INVARIANT(version > of->version);
    /* without memory for the way there is none */
    if (goes_on && !of->base) goes_on = (of->base = malloc(LW_DELTAS_KEPT * sizeof *of->base)) != NULL;
    forget_jumps(of);
    if (!goes_on)
        drop_oldest(of, of->count);
    else if (of->count == LW_DELTAS_KEPT)
        drop_oldest(of, 1);
    if (goes_on)
        of->base[of->count++] =
            (struct lw_delta_base){.version = of->version, .whole = of->whole, .delta = lw_blob_ref(delta)};
    else
        lw_blob_unref(of->whole);
    of->version = version;
    of->whole = lw_blob_ref(whole);
    LW_INVARIANT_DEAR(is_ascending(of));
}

void lw_deltas_add(struct lw_deltas *deltas, uint32_t tile, const struct lw_snapshot_tile *version) {
    LW_INVARIANT(tile < deltas->tile_count);
    add(&deltas->tile[tile], version->version, version->blob, version->base, version->delta);
}

static void begin_life(struct lw_deltas_of_tile *of) {
    drop_oldest(of, of->count);
    lw_blob_unref(of->whole);
    free(of->base);
    *of = (struct lw_deltas_of_tile){.life = of->life + 1};
}

void lw_deltas_forget(struct lw_deltas *deltas, uint32_t tile) {
    LW_INVARIANT(tile < deltas->tile_count);
    begin_life(&deltas->tile[tile]);
    begin_life(&deltas->coarse[tile]);
}

static struct lw_delta_base *find(struct lw_deltas_of_tile *of, uint64_t version) {
    for (uint32_t i = of->count; i-- > 0;)
        if (of->base[i].version == version) return &of->base[i];
    return NULL;
}

/* Over one version there is a delta already. False if there is nothing to wait for. */
static bool wait_for_jump(struct lw_deltas *deltas, uint32_t tile, bool coarse, struct lw_delta_base *base) {
    const struct lw_deltas_of_tile *of = coarse ? &deltas->coarse[tile] : &deltas->tile[tile];
    if (!deltas->transcoder || !base || base + 1 == of->base + of->count || base->is_known) return false;
    if (!base->is_asked)
        base->is_asked =
            lw_transcoder_ask(deltas->transcoder, &(struct lw_transcoder_job){.tile = tile,
                                                                              .coarse = coarse,
                                                                              .life = of->life,
                                                                              .base = base->version,
                                                                              .version = of->version,
                                                                              .from = base->whole,
                                                                              .to = of->whole});
    return base->is_asked;
}

static uint64_t coarse_version(const struct lw_deltas *deltas, uint32_t tile) {
    return lw_snapshot_coarse_version(deltas->tile[tile].version);
}

/* The same for the coarse form of the newest version. */
static bool wait_for_coarse(struct lw_deltas *deltas, uint32_t tile) {
    const struct lw_deltas_of_tile *fine = &deltas->tile[tile];
    struct lw_deltas_of_tile *of = &deltas->coarse[tile];
    const uint64_t version = coarse_version(deltas, tile);
    if (!deltas->transcoder || of->known >= version) return false;
    if (of->asked < version &&
        lw_transcoder_ask(
            deltas->transcoder,
            &(struct lw_transcoder_job){
                .tile = tile, .coarse = true, .life = of->life, .version = version, .to = fine->whole}))
        of->asked = version;
    LW_INVARIANT(of->known <= of->asked);
    return of->asked >= version;
}

static enum lw_deltas_way next_of(struct lw_deltas *deltas, uint32_t tile, uint64_t from, bool coarse,
                                  struct lw_delta *out_delta) {
    struct lw_deltas_of_tile *of = coarse ? &deltas->coarse[tile] : &deltas->tile[tile];
    struct lw_delta_base *base = find(of, from), *end = base ? of->base + of->count : NULL;
    LW_INVARIANT_DEAR(of->version >= from); /* ways lead to newer versions */
    if (wait_for_jump(deltas, tile, coarse, base)) return LW_DELTAS_WAIT;
    size_t chain = 0;
    for (const struct lw_delta_base *b = base; b && b < end; b++) chain += b->delta->size;
    if (base && base->jump && base->jump->size <= chain) { /* always smaller than the whole */
        *out_delta = (struct lw_delta){of->version, base->jump};
        return LW_DELTAS_DELTA;
    }
    if (!base || (base + 1 < end && chain >= of->whole->size)) {
        *out_delta = (struct lw_delta){of->version, of->whole};
        return LW_DELTAS_WHOLE;
    }
    *out_delta = (struct lw_delta){base + 1 < end ? base[1].version : of->version, base->delta};
    return LW_DELTAS_DELTA;
}

enum lw_deltas_way lw_deltas_next(struct lw_deltas *deltas, uint32_t tile, uint64_t from, bool coarse,
                                  struct lw_delta *out_delta) {
    LW_INVARIANT_DEAR(tile < deltas->tile_count);
    const enum lw_deltas_way way = !coarse || find(&deltas->tile[tile], from)
                                       ? next_of(deltas, tile, from, false, out_delta)
                                       : LW_DELTAS_WHOLE;
    if (!coarse || way == LW_DELTAS_WAIT) return way;
    if (way == LW_DELTAS_DELTA &&
        (float)out_delta->blob->size < FINE_SHARE * (float)deltas->tile[tile].whole->size)
        return way;
    if (wait_for_coarse(deltas, tile)) return LW_DELTAS_WAIT;
    return next_of(deltas, tile, from, deltas->coarse[tile].version == coarse_version(deltas, tile),
                   out_delta);
}

void lw_deltas_prepare(struct lw_deltas *deltas, uint32_t tile, uint64_t from, bool coarse) {
    struct lw_delta delta;
    (void)lw_deltas_next(deltas, tile, from, coarse, &delta);
}

/* Takes over what it keeps. */
static void take_result(struct lw_deltas_of_tile *of, struct lw_transcoder_result *r) {
    struct lw_delta_base *base = of->version == r->version ? find(of, r->base) : NULL;
    if (r->coarse && !r->base) {
        LW_INVARIANT(r->version > of->known && r->version <= of->asked); /* in the order of asking */
        of->known = r->version;
        if (r->blob) add(of, r->version, r->blob, r->delta_base, r->delta);
    } else if (base) {                                                  /* else too late */
        LW_INVARIANT(base->is_asked && !base->is_known && !base->jump); /* answered once */
        base->is_known = true;
        base->jump = r->blob;
        r->blob = NULL;
    }
}

bool lw_deltas_collect(struct lw_deltas *deltas) {
    bool any = false;
    for (struct lw_transcoder_result r; deltas->transcoder && lw_transcoder_collect(deltas->transcoder, &r);
         any = true) {
        LW_INVARIANT(r.tile < deltas->tile_count);
        struct lw_deltas_of_tile *of = r.coarse ? &deltas->coarse[r.tile] : &deltas->tile[r.tile];
        if (r.life == of->life) take_result(of, &r);
        lw_blob_unref(r.blob);
        lw_blob_unref(r.delta);
    }
    return any;
}
