#include "client/view/lights/direct_job.h"

#include "client/view/lights/direct_rays.h"
#include "client/view/lights/direct_resolve.h"
#include "client/view/lights/direct_unshadowed.h"
#include "client/view/lights/direct_weak.h"
#include "common/base/colour.h"
#include "common/base/random.h"
#include "common/base/wide.h"

#include <string.h>

#define LANES  LW_DIRECT_LANES
#define BLOCKS LW_DIRECT_BLOCKS

/* Shares of the light at hand in all light that a pixel has so far. From SHARE_SEEN on a pixel has rays of
 * its own, from SHARE_NOISY on up to LW_DIRECT_SAMPLES of them. */
#define SHARE_SEEN  0.02f
#define SHARE_NOISY 0.06f

/* Mean luminance of the light of a block's pixels. */
LW_WIDE static float mean_found(const struct lw_direct_block *restrict block) {
    float sum = 0, count = 0;
    for (uint32_t i = 0; i < LANES; i++) {
        const float k = block->active >> i & 1u ? 1 : 0;
        sum += k * (block->base[i] +
                    lw_colour_luminance(lw_vec3(block->e[0][i], block->e[1][i], block->e[2][i])));
        count += k;
    }
    return count > 0 ? sum / count : 0;
}

/* The pixels where the light at hand is at least a share of all. */
struct weight {
    uint32_t faint, seen, noisy;
};
LW_WIDE static struct weight find_weights(const float *restrict e, const float *restrict base,
                                          const float (*restrict sum)[LANES], float luminance) {
    struct weight w = {0};
    for (uint32_t i = 0; i < LANES; i++) {
        const float own = e[i] * luminance;
        const float all = base[i] + lw_colour_luminance(lw_vec3(sum[0][i], sum[1][i], sum[2][i])) + own;
        w.faint |= own >= LW_DIRECT_SHARE_FAINT * all ? 1u << i : 0;
        w.seen |= own >= SHARE_SEEN * all ? 1u << i : 0;
        w.noisy |= own >= SHARE_NOISY * all ? 1u << i : 0;
    }
    return w;
}

static void weigh(struct lw_direct_work *w, uint32_t b, const struct lw_direct_block *block,
                  float luminance) {
    struct weight weight = {0};
    if (w->facing[b] && block->finished) {
        float e[LANES];
        lw_direct_unshadowed_weigh_mirrored(block, &w->gloss[b], e);
        for (uint32_t i = 0; i < LANES; i++) e[i] *= w->e[b][i];
        weight = find_weights(e, block->base, block->e, luminance);
    } else if (w->facing[b]) {
        weight = find_weights(w->e[b], block->base, block->e, luminance);
    }
    w->faint[b] = (uint16_t)weight.faint & w->facing[b];
    w->seen[b] = (uint16_t)weight.seen & w->facing[b];
    w->noisy[b] = (uint16_t)weight.noisy & w->facing[b];
}

static void add_full(struct lw_direct_job *job) {
    struct lw_direct_work *w = job->work;
    lw_direct_rays_trace(job);
    lw_direct_resolve_tile(job);
    for (uint32_t b = 0; b < BLOCKS; b++)
        if (w->facing[b]) w->summary.found[b] = mean_found(&job->tile->block[b]);
}

void lw_direct_job_add_light(const struct lw_direct_pixels *d, struct lw_direct_tile *tile,
                             const struct lw_direct_region *region, uint32_t candidate,
                             const struct lw_direct_outlook *outlook) {
    struct lw_direct_work *w = tile->work;
    struct lw_direct_job job = {.direct = d,
                                .tile = tile,
                                .work = w,
                                .candidate = candidate,
                                .number = ++w->jobs,
                                .far = lw_direct_choice_is_far(&d->candidates, candidate, region),
                                .finished = w->finished,
                                .seed = lw_random_hash4(d->seed, tile->x, tile->y, candidate),
                                .wide = d->blends || lw_direct_choice_has_extent(d, candidate)};
    const struct lw_vec3 colour = lw_direct_unshadowed_colour(d, candidate);
    const float luminance = lw_colour_luminance(colour);
    struct lw_direct_parts parts;
    bool full = false;
    for (uint32_t b = 0; w->finished && b < BLOCKS;
         b++) /* first: blocks that mirror the light are not weak */
        if (tile->block[b].finished)
            w->reached[b] = lw_direct_unshadowed_block(d, candidate, w, &tile->block[b], b);
    const uint32_t any = lw_direct_weak_part(&job, outlook, &parts);
    for (uint32_t b = 0; (any & 2u) && b < BLOCKS; b++) {
        const struct lw_direct_block *block = &tile->block[b];
        w->facing[b] = 0;
        if (parts.full[b] && block->active)
            w->facing[b] =
                block->active &
                (block->finished ? w->reached[b]
                                 : lw_direct_unshadowed_points(d, candidate, &block->points, w->e[b]));
        weigh(w, b, &tile->block[b], luminance);
        full |= w->facing[b] != 0;
    }
    if (full) add_full(&job);
    if (any & 1u) lw_direct_weak_add(&job, outlook, &parts, lw_vec3_scale(colour, 1 / luminance));
}

void lw_direct_job_add_rest(const struct lw_direct_pixels *d, struct lw_direct_tile *tile,
                            const struct lw_direct_choice *choice) {
    struct lw_direct_work *w = tile->work;
    for (uint32_t b = 0; b < BLOCKS; b++) {
        struct lw_direct_block *block = &tile->block[b];
        if (!block->active) continue;
        const uint32_t seed = lw_random_hash4(d->seed, tile->x, tile->y, b);
        float pick = lw_random_unit(seed) * choice->rest;
        uint32_t at = choice->kept;
        while (at + 1 < choice->count && pick >= w->order[at].bound) pick -= w->order[at++].bound;
        struct lw_direct_job job = {.direct = d,
                                    .tile = tile,
                                    .work = w,
                                    .candidate = w->order[at].candidate,
                                    .seed = seed,
                                    .number = ++w->jobs};
        w->facing[b] = lw_direct_unshadowed_block(d, job.candidate, w, block, b) & block->active;
        if (!w->facing[b]) continue;
        const struct lw_vec3 colour =
            lw_vec3_scale(lw_direct_unshadowed_colour(d, job.candidate), choice->rest / w->order[at].bound);
        memset(w->lit + b * LANES, 0, LANES);
        w->rays.salt = seed;
        for (uint32_t i = 0; i < LANES; i++)
            if (w->facing[b] >> i & 1u) lw_direct_rays_shoot(&job, b * LANES + i, 0);
        lw_direct_rays_flush(&job);
        float share[LANES];
        for (uint32_t i = 0; i < LANES; i++) share[i] = w->lit[b * LANES + i] ? 1 : 0;
        lw_direct_resolve_add(&job, b, share, colour);
    }
}
