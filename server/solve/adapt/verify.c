#include "server/solve/adapt/verify.h"

#include "common/base/invariant.h"
#include "server/solve/adapt/control_variate.h"
#include "server/solve/adapt/gradient.h"
#include "server/solve/transport/bounces.h"
#include "server/solve/transport/direct_light.h"
#include "server/solve/transport/ray_hit.h"

#include <string.h>

#define LANES LW_TRACE_WIDTH
/* How many times its block's light, or the others' difference, one texel's may be:
 * single bright ends are no news. */
#define DIFFERENCE_MAX 4.0f

/* By how much an estimate differs from the packed one of before: not at all if the light is the same. An
 * estimate beyond float's range is in no mean (lw_tiles_blend()), and tells nothing. */
static struct lw_vec3 difference(struct lw_vec3 now, struct lw_vec3 then) {
    const struct lw_vec3 off = lw_vec3_sub(lw_packed_light_rounded(now, LW_PACKED_LIGHT_SIGNED), then);
    return lw_vec3_is_finite(off) ? off : lw_vec3(0, 0, 0);
}

/* Rounds sums as lw_bounces_gather() does. */
static struct lw_vec3 gather_order(const struct lw_transport *t, uint32_t texel, int order) {
    const uint32_t last = order == LW_CHANGE_FIRST ? 1 : t->tiles->bounces;
    struct lw_vec3 e = {0};
    for (uint32_t bounce = order == LW_CHANGE_FIRST ? 1 : 2; bounce <= last && bounce <= t->tiles->bounces;
         bounce++)
        e = lw_packed_light_rounded(lw_vec3_add(e, lw_bounces_at(t, texel, bounce)), LW_PACKED_LIGHT_SIGNED);
    return e;
}

/* direct: estimated again; all: so are the block's other packets. Returns whether
 * the light has been corrected. */
static bool compare_direct(const struct lw_transport *t, const struct lw_solve_tile *tile,
                           struct lw_solve_block *block, uint32_t set, const struct lw_ray_launch *launch,
                           const struct lw_direct_light *direct, bool all) {
    const uint32_t lanes = (uint32_t)__builtin_popcount(launch->active);
    float *square = &block->change.packet[set].direct_square;
    struct lw_vec3 off[LANES], off_drawn[LANES];
    *square = 0;
    for (uint32_t lane = 0; lane < lanes; lane++) {
        const uint32_t texel = tile->first + launch->texel[lane];
        off[lane] = difference(lw_direct_light_lane(direct->all, lane),
                               lw_tiles_estimate(t->tiles, LW_TILES_ESTIMATE_DIRECT, texel));
        if (t->drawn)
            off_drawn[lane] = difference(lw_direct_light_lane(direct->drawn, lane),
                                         lw_tiles_drawn_estimate(t->tiles, texel));
        const float weighted = block->weight[t->tiles->region_of_texel[texel]] * lw_vec3_max_abs(off[lane]);
        *square += weighted * weighted;
    }
    if (!all || !(*square > 0)) return false;
    lw_control_variate_direct(t->tiles, tile, block, set, launch, off, t->drawn ? off_drawn : NULL);
    return true;
}

static void compare_indirect(const struct lw_transport *t, const struct lw_solve_tile *tile,
                             struct lw_solve_block *block, uint32_t set, const struct lw_ray_launch *launch) {
    struct lw_change_packet found = block->change.packet[set];
    const uint32_t lanes = (uint32_t)__builtin_popcount(launch->active);
    LW_INVARIANT(lanes == block->packet[set].count && block->sample_count > 0);
    struct lw_vec3 off[LANES], of_order[LW_CHANGE_ORDERS][LANES];
    float sum = 0;
    memset(found.indirect, 0, sizeof found.indirect);
    memset(found.indirect_square, 0, sizeof found.indirect_square);
    for (uint32_t lane = 0; lane < lanes; lane++) {
        const uint32_t texel = tile->first + launch->texel[lane];
        off[lane] = lw_vec3(0, 0, 0);
        for (int order = 0; order < LW_CHANGE_ORDERS; order++) {
            of_order[order][lane] =
                difference(gather_order(t, texel, order),
                           lw_tiles_estimate(t->tiles, LW_TILES_ESTIMATE_BOUNCES + order, texel));
            off[lane] = lw_vec3_add(off[lane], of_order[order][lane]);
        }
        sum += lw_vec3_max_abs(off[lane]);
    }
    for (uint32_t lane = 0; lane < lanes; lane++) {
        const float size = lw_vec3_max_abs(off[lane]);
        const float others = lanes > 1 ? (sum - size) / (float)(lanes - 1) : size;
        const uint32_t region = t->tiles->region_of_texel[tile->first + launch->texel[lane]];
        const float bound =
            DIFFERENCE_MAX * fmaxf(block->reference_luminance / block->weight[region], others);
        const float share = size > bound ? bound / size : 1;
        for (int order = 0; order < LW_CHANGE_ORDERS; order++)
            found.indirect[order][region] =
                lw_vec3_mad(found.indirect[order][region], of_order[order][lane], share);
        found.indirect_square[region] += share * share * lw_vec3_dot(off[lane], off[lane]);
        LW_INVARIANT_DEAR(region < LW_REGIONS && share >= 0 && share <= 1);
    }
    block->change.packet[set] = found;
}

bool lw_verify_compare(const struct lw_transport *t, struct lw_solve_tile *tile, struct lw_ray_count *count) {
    struct lw_ray_launch launch;
    struct lw_ray_launch_site site;
    bool corrected = false;
    lw_sample_points_frame_init(&site.frame, &t->pose->object_to_world[tile->object]);
    LW_TILES_EACH_BLOCK (tile, block) {
        const struct lw_change_block *change = &block->change;
        const bool all = change->direct == lw_change_all_packets(block);
        LW_INVARIANT(!((change->compare | change->direct | change->retrace) & ~lw_change_all_packets(block)));
        for (uint32_t set = 0; set < block->packet_count; set++) {
            const uint16_t bit = (uint16_t)(1u << set);
            if (!((change->compare | change->direct) & bit)) continue;
            struct lw_direct_light direct;
            lw_ray_launch_init(&launch, tile, block, set);
            if (change->direct & bit) {
                lw_direct_light_repeat(t, tile, &launch, &site, &direct, count);
                corrected |= compare_direct(t, tile, block, set, &launch, &direct, all);
            }
            if (change->retrace & bit) lw_bounces_repeat(t, tile, &launch, &site, count);
            if (change->compare & bit) compare_indirect(t, tile, block, set, &launch);
        }
    }
    if (corrected) lw_control_variate_note_error(tile);
    return corrected;
}

void lw_verify_reread(const struct lw_transport *t, struct lw_solve_tile *tile) {
    struct lw_ray_count none = {0};
    LW_TILES_EACH_BLOCK (tile, block) {
        struct lw_change_block *change = &block->change;
        change->retrace = change->direct = 0;
        change->compare = change->uncorrected = change->verified =
            block->due && block->sample_count ? lw_change_all_packets(block) : 0;
    }
    (void)lw_verify_compare(t, tile, &none);
    (void)lw_control_variate_indirect(t->tiles, tile, t->target_error, false);
    LW_TILES_EACH_BLOCK (tile, block)
        if (block->due) lw_gradient_note_staleness(block);
}

/* By how much a texel's region of its block sends out more than in the frame before, of bounces from the
 * first on. */
static struct lw_vec3 change_of(const struct lw_transport *t, uint32_t texel) {
    const uint32_t region = LW_REGIONS * t->tiles->block_of_texel[texel] + t->tiles->region_of_texel[texel];
    struct lw_vec3 sum = {0};
    for (uint32_t bounce = 1; bounce < t->tiles->bounces; bounce++)
        sum = lw_vec3_add(sum, t->tiles->radiance_change[bounce][region]);
    return sum;
}

/* The mean by which what arrives along a texel's rays of bounces from the second on
 * differs from the frame before. */
static struct lw_vec3 change_at(const struct lw_transport *t, uint32_t texel) {
    const uint32_t n = t->indirect_samples;
    const uint32_t *hit = t->ray_hit + (size_t)texel * n;
    const struct lw_reflected *reflected = &t->reflected[texel];
    struct lw_vec3 sum = {0};
    for (uint32_t s = 0; s < n; s++)
        if (!(hit[s] & LW_RAY_HIT_PROBE)) /* or nothing */
            sum = lw_vec3_mad(sum, change_of(t, hit[s]), LW_PI / (float)n);
    return reflected->weight > 0 ? lw_vec3_mad(sum, change_of(t, reflected->texel), reflected->weight) : sum;
}

/* weight: of the mean that is stale by the change found. */
static void note_arrival(const struct lw_transport *t, const struct lw_solve_tile *tile,
                         struct lw_solve_block *block, float weight) {
    LW_INVARIANT(weight >= 0 && weight < 1);
    for (uint32_t set = 0; set < block->packet_count; set++) {
        struct lw_change_packet *found = &block->change.packet[set];
        struct lw_ray_launch launch;
        lw_ray_launch_init(&launch, tile, block, set);
        *found = (struct lw_change_packet){0};
        for (uint32_t lane = 0; lane < block->packet[set].count; lane++) {
            const uint32_t texel = tile->first + launch.texel[lane],
                           region = t->tiles->region_of_texel[texel];
            const struct lw_vec3 off = lw_vec3_scale(change_at(t, texel), weight);
            struct lw_vec3 *sum = &found->indirect[LW_CHANGE_LATER][region];
            *sum = lw_vec3_add(*sum, off);
            found->indirect_square[region] += lw_vec3_dot(off, off);
        }
    }
    block->change.uncorrected = block->change.verified = lw_change_all_packets(block);
}

void lw_verify_add_indirect_change(const struct lw_transport *t, struct lw_solve_tile *tile) {
    LW_TILES_EACH_BLOCK (tile, block)
        if (block->due) note_arrival(t, tile, block, 1 - block->indirect.weight);
    (void)lw_control_variate_indirect(t->tiles, tile, t->target_error, false);
    LW_TILES_EACH_BLOCK (tile, block)
        if (block->due) lw_gradient_note_staleness(block);
}

void lw_verify_restore_estimates(const struct lw_transport *t, const struct lw_solve_tile *tile,
                                 struct lw_ray_count *count) {
    struct lw_ray_launch launch;
    struct lw_ray_launch_site site;
    lw_sample_points_frame_init(&site.frame, &t->pose->object_to_world[tile->object]);
    LW_TILES_EACH_BLOCK (tile, block) {
        block->traced_luminance = block->reference_luminance;
        for (uint32_t set = 0; block->sample_count && set < block->packet_count; set++) {
            struct lw_direct_light direct;
            lw_ray_launch_init(&launch, tile, block, set);
            lw_direct_light_repeat(t, tile, &launch, &site, &direct, count);
            lw_bounces_repeat(t, tile, &launch, &site, count);
            for (uint32_t lane = 0; lane < block->packet[set].count; lane++) {
                const uint32_t texel = tile->first + launch.texel[lane];
                lw_direct_light_keep(t, texel, &direct, lane);
                for (int order = 0; order < LW_CHANGE_ORDERS; order++)
                    lw_tiles_keep_estimate(t->tiles, LW_TILES_ESTIMATE_BOUNCES + order, texel,
                                           gather_order(t, texel, order));
            }
        }
    }
}
