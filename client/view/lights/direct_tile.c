#include "client/view/lights/direct_tile.h"

#include "client/view/lights/direct_job.h"
#include "client/view/lights/direct_rays.h"
#include "client/view/lights/direct_unshadowed.h"
#include "client/view/lights/direct_weak.h"
#include "common/base/colour.h"
#include "common/base/wide.h"

#include <float.h>
#include <stdlib.h>
#include <string.h>

#define LANES  LW_DIRECT_LANES
#define BLOCKS LW_DIRECT_BLOCKS

enum lw_status lw_direct_tile_create(struct lw_direct_tile **out_tile) {
    struct lw_direct_tile *tile = aligned_alloc(64, (sizeof *tile + 63) / 64 * 64);
    struct lw_direct_work *work = aligned_alloc(64, (sizeof *work + 63) / 64 * 64);
    if (!tile || !work) {
        free(work);
        free(tile);
        return LW_NO_MEMORY;
    }
    memset(tile, 0, sizeof *tile);
    memset(work, 0, sizeof *work);
    tile->work = work;
    *out_tile = tile;
    return LW_OK;
}

void lw_direct_tile_destroy(struct lw_direct_tile *tile) {
    if (!tile) return;
    free(tile->work->bound);
    free(tile->work->order);
    free(tile->work);
    free(tile);
}

static void clear_light(struct lw_direct_tile *tile) {
    tile->work->finished = false;
    for (uint32_t b = 0; b < BLOCKS; b++) {
        struct lw_direct_block *block = &tile->block[b];
        memset(block->e, 0, sizeof block->e);
        if (!block->finished) continue;
        memset(block->mirrored, 0, sizeof block->mirrored);
        tile->work->finished = true;
    }
}

/* Adds light that all pixels of a block have. A pixel without a surface has none, nor one whose sum has
 * overflowed. */
LW_WIDE static void add_even_light(struct lw_direct_block *restrict block, float red, float green,
                                   float blue) {
    const float more[3] = {red, green, blue};
    for (uint32_t c = 0; c < 3; c++)
        for (uint32_t i = 0; i < LANES; i++) {
            const float e = block->e[c][i] + more[c];
            block->e[c][i] = (block->active >> i & 1u) && e >= 0 && e <= FLT_MAX ? e : 0;
        }
    for (uint32_t c = 0; block->finished && c < 3; c++)
        for (uint32_t i = 0; i < LANES; i++) {
            const float m = block->mirrored[c][i];
            block->mirrored[c][i] = m >= 0 && m <= FLT_MAX ? m : 0;
        }
}

static void note_flat(const struct lw_direct_tile *tile, uint32_t b) {
    struct lw_direct_work *w = tile->work;
    w->flat[b] = tile->block[b].active && !tile->listed ? lw_direct_rays_find_flat(&tile->block[b]) : 0;
    w->whole[b] = w->flat[b] == 0xffff && lw_direct_rays_is_flat(&tile->block[b]);
}

/* Fills the outlook of the lights that have rays of their own, and orders them by the light expected of
 * them. */
static void order_lights(const struct lw_direct_pixels *d, const struct lw_direct_tile *tile,
                         const struct lw_direct_choice *choice, uint32_t turn[LW_DIRECT_TILE_LIGHTS_MAX]) {
    struct lw_direct_work *w = tile->work;
    float sum[LW_DIRECT_TILE_LIGHTS_MAX];
    for (uint32_t i = 0; i < choice->kept; i++) {
        const uint32_t candidate = w->order[i].candidate;
        uint32_t at = i;
        sum[i] = d->candidates.kind[candidate] == LW_DIRECT_SUN
                     ? INFINITY
                     : lw_direct_weak_expect(d, &w->summary, candidate,
                                             lw_colour_luminance(lw_direct_unshadowed_colour(d, candidate)),
                                             &w->outlook[i]);
        for (; at > 0 && sum[turn[at - 1]] < sum[i]; at--) turn[at] = turn[at - 1];
        turn[at] = i;
    }
}

void lw_direct_tile_light(const struct lw_direct_pixels *d, struct lw_direct_tile *tile) {
    struct lw_direct_work *w = tile->work;
    struct lw_direct_region region;
    uint32_t turn[LW_DIRECT_TILE_LIGHTS_MAX];
    clear_light(tile);
    if (!d->ready || !d->candidates.count || !lw_direct_choice_region(tile, &region)) return;
    const struct lw_direct_choice choice = lw_direct_choice_make(d, w, &region);
    for (uint32_t b = 0; b < BLOCKS; b++) {
        note_flat(tile, b);
        lw_direct_weak_summarise(&tile->block[b], b, &w->summary);
    }
    memset(w->weak, 0, sizeof w->weak);
    order_lights(d, tile, &choice, turn);
    for (uint32_t i = 0; i < choice.kept; i++) {
        const uint32_t candidate = w->order[turn[i]].candidate;
        const bool is_sun = d->candidates.kind[candidate] == LW_DIRECT_SUN;
        lw_direct_job_add_light(d, tile, &region, candidate, is_sun ? NULL : &w->outlook[turn[i]]);
    }
    if (choice.count > choice.kept) lw_direct_job_add_rest(d, tile, &choice);
    for (uint32_t b = 0; b < BLOCKS; b++)
        add_even_light(&tile->block[b], w->weak[0][b], w->weak[1][b], w->weak[2][b]);
}
