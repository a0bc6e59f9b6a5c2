#include "server/solve/passes.h"

#include "common/colour.h"
#include "common/light/direction.h"
#include "common/sampling.h"
#include "common/wide.h"
#include "server/solve/correction.h"
#include "server/solve/direct.h"
#include "server/solve/transport.h"

#include <string.h>

#define LANES LW_TRACE_WIDTH
/* So many bounce rays in a row start at the same place of their texel: finding it costs as much as half a ray. */
#define PLACE_SHARE 2u
/* Texels ahead of the one at hand whose ends are sent for. */
#define GATHER_AHEAD 12u
/* So many samples without light count as an error of 1; a full tile rests after some 25 frames at 0.02. */
#define DARK_SAMPLES 2000.0
/* What is known of a block's noise holds while its light is within this factor of what it was. */
#define LIKE 4.0
/* Of a block's estimated noise, what each frame brings. */
#define NOISE_WEIGHT 0.125f
/* The same direction about each lane's normal. */
LW_WIDE static void aim(const struct lw_points16 *restrict at, struct lw_vec3 local, float t_far,
                        struct lw_ray16 *restrict rays) {
    for (uint32_t lane = 0; lane < LANES; lane++) {
        const struct lw_vec3 d = lw_direction_about(lw_vec3(at->nx[lane], at->ny[lane], at->nz[lane]), local);
        rays->dir_x[lane] = d.x;
        rays->dir_y[lane] = d.y;
        rays->dir_z[lane] = d.z;
        rays->t_far[lane] = t_far;
    }
}

static void blend(float *const dst[3], uint32_t texel, struct lw_vec3 value, float weight) {
    /* One estimate beyond float's range would stay in the mean for good. */
    if (!lw_vec3_is_finite(value)) return;
    dst[0][texel] += (value.x - dst[0][texel]) * weight;
    dst[1][texel] += (value.y - dst[1][texel]) * weight;
    dst[2][texel] += (value.z - dst[2][texel]) * weight;
}

static struct lw_vec3 lane_of(const float e[3][LANES], uint32_t lane) {
    return lw_vec3(e[0][lane], e[1][lane], e[2][lane]);
}

static void store(float *const dst[3], uint32_t texel, struct lw_vec3 value) {
    dst[0][texel] = value.x;
    dst[1][texel] = value.y;
    dst[2][texel] = value.z;
}

/* The estimate that a texel's direct light has had last. */
static void store_direct(const struct lw_passes *p, uint32_t texel, const struct lw_direct_estimate *e,
                         uint32_t lane) {
    store(p->tiles->estimate[LW_TILES_ESTIMATE_DIRECT], texel, lane_of(e->all, lane));
    if (p->drawn) store(p->tiles->drawn_estimate, texel, lane_of(e->drawn, lane));
}

void lw_passes_direct(const struct lw_passes *p, struct lw_solve_tile *tile, struct lw_passes_count *count) {
    struct lw_launch launch[LW_PACKETS_MAX];
    struct lw_launch_site site;
    lw_footprint_frame_init(&site.frame, &p->pose->object_to_world[tile->object]);
    LW_TILES_EACH_BLOCK (tile, block) {
        if (!block->due) continue;
        lw_launch_block(tile, block, p->texels->usable, p->seed, block->frames * p->direct_samples, launch);
        for (uint32_t set = 0; set < block->packet_count; set++) {
            struct lw_direct_estimate e;
            lw_direct_light(p, tile, &launch[set], &site, &e, count);
            for (uint32_t lane = 0; lane < block->packet[set].count; lane++) {
                const uint32_t texel = tile->first + launch[set].texel[lane];
                const struct lw_vec3 now = lane_of(e.all, lane);
                if (p->drawn && lw_vec3_is_finite(now))
                    blend(p->tiles->drawn, texel, lane_of(e.drawn, lane), block->direct.weight);
                blend(p->tiles->direct, texel, now, block->direct.weight);
                store_direct(p, texel, &e, lane);
            }
        }
    }
}

/* A packet's bounce rays on their way to the texels that they end on. Every step reads memory that lies anywhere: it is sent for while
 * the next packets are traced. */
struct flight {
    struct lw_ray16 rays;
    struct lw_hit16 hits;
    uint32_t texel[LANES], end[LANES];
    uint32_t sample; /* of the frame */
    uint16_t active;
    unsigned flags;
};
#define FLIGHTS 3u /* traced; ended; about to be noted */
struct flights {
    struct flight flight[FLIGHTS];
    uint32_t count;
};

/* Where a lane's ray ended, if it met something; not yet the texel that stands for it. */
static uint32_t end_of(const struct lw_passes *p, const struct lw_hit16 *hits, uint32_t lane) {
    if (hits->object[lane] == LW_TRACE_MISS) return LW_END_NOTHING;
    return lw_texels_under(p->texels, hits->object[lane], hits->triangle[lane], hits->u[lane], hits->v[lane],
                           hits->back[lane]);
}

/* Asks a probe about a ray that has run as far as the tracing range; false if none sees where it stands. random: a
 * word of the ray's own. */
static bool ask_probes(const struct lw_passes *p, const struct lw_ray16 *rays, uint32_t lane, uint32_t random,
                       uint32_t *out_end) {
    const struct lw_vec3 d = lw_vec3(rays->dir_x[lane], rays->dir_y[lane], rays->dir_z[lane]);
    const struct lw_vec3 point =
        lw_vec3_mad(lw_vec3(rays->org_x[lane], rays->org_y[lane], rays->org_z[lane]), d, rays->t_far[lane]);
    /* Outside the box there is nothing but what has moved there: a ray that costs next to nothing. */
    if (!lw_cells_contain(&p->probes->grid, point)) return false;
    *out_end = lw_probes_ask(p->probes, point, d, random);
    return *out_end != LW_PROBES_UNSEEN;
}

/* Ends of a packet's rays: what they hit, else what a probe knows, else what they hit further on. */
static void find_ends(const struct lw_passes *p, struct flight *f, struct lw_passes_count *count) {
    uint16_t unseen = 0;
    for (uint32_t lane = 0; lane < LANES; lane++) {
        if (!(f->active >> lane & 1)) continue;
        f->end[lane] = end_of(p, &f->hits, lane);
        if (f->hits.object[lane] != LW_TRACE_MISS || !p->probes) continue;
        const uint32_t random =
            lw_random_hash3(p->seed, f->texel[lane], f->rays.salt ^ LW_SAMPLING_PROBE << 24);
        if (ask_probes(p, &f->rays, lane, random, &f->end[lane])) continue;
        f->rays.t_near[lane] = f->rays.t_far[lane];
        f->rays.t_far[lane] = INFINITY;
        unseen |= (uint16_t)(1u << lane);
    }
    if (unseen) {
        lw_trace_closest16(p->trace, f->flags, unseen, &f->rays, &f->hits);
        for (uint32_t lane = 0; lane < LANES; lane++)
            if (unseen >> lane & 1) f->end[lane] = end_of(p, &f->hits, lane);
        count->bounce += (uint64_t)__builtin_popcount(unseen);
    }
    for (uint32_t lane = 0; lane < LANES; lane++)
        if (f->active >> lane & 1 && !(f->end[lane] & LW_END_PROBE))
            __builtin_prefetch(&p->texels->source[f->end[lane]]);
}
_Static_assert((LW_END_NOTHING & LW_END_PROBE) != 0 && LW_TEXEL_NONE == LW_END_NOTHING, "no texels either");

/* Notes the texels that stand for those that a packet's rays have met. */
static void note_ends(const struct lw_passes *p, const struct flight *f) {
    for (uint32_t lane = 0; lane < LANES; lane++)
        if (f->active >> lane & 1)
            p->end[(size_t)f->texel[lane] * p->indirect_samples + f->sample] =
                f->end[lane] & LW_END_PROBE ? f->end[lane] : p->texels->source[f->end[lane]];
}

/* One step for the two packets before the one that has been traced last. */
static void move_on(const struct lw_passes *p, struct flights *flights, struct lw_passes_count *count) {
    if (flights->count > 1) find_ends(p, &flights->flight[(flights->count - 2) % FLIGHTS], count);
    if (flights->count > 2) note_ends(p, &flights->flight[(flights->count - 3) % FLIGHTS]);
}

/* The steps that are left. */
static void land(const struct lw_passes *p, struct flights *flights, struct lw_passes_count *count) {
    if (flights->count > 0) find_ends(p, &flights->flight[(flights->count - 1) % FLIGHTS], count);
    for (uint32_t k = flights->count < 2 ? flights->count : 2; k > 0; k--)
        note_ends(p, &flights->flight[(flights->count - k) % FLIGHTS]);
    flights->count = 0;
}

/* Where the rays of a packet's texels end in one frame. Needs its places for the first of them. */
static void trace_packet(const struct lw_passes *p, const struct lw_solve_tile *tile,
                         struct lw_launch *launch, struct lw_launch_site *site, struct flights *flights,
                         struct lw_passes_count *count) {
    const uint32_t seed = lw_sampling_seed(p->seed, tile->object, launch->block, LW_SAMPLING_BOUNCE);
    for (uint32_t s = 0; s < p->indirect_samples; s++) {
        const uint32_t sample = launch->frames * p->indirect_samples + s;
        if (s > 0 && s % PLACE_SHARE == 0)
            lw_launch_choose(launch, tile, p->texels->usable, p->seed, sample / PLACE_SHARE);
        if (s % PLACE_SHARE == 0) lw_launch_place(launch, tile, site);
        struct flight *f = &flights->flight[flights->count++ % FLIGHTS];
        float point[2];
        for (uint32_t lane = 0; lane < LANES; lane++) f->texel[lane] = tile->first + launch->texel[lane];
        f->sample = s;
        f->active = launch->active;
        f->flags = site->coherent ? LW_TRACE_COHERENT : LW_TRACE_LIGHT;
        lw_sampling_point(seed, sample, launch->set, point);
        lw_launch_start(site, &f->rays);
        aim(&site->lanes.at, lw_direction_cosine(point), p->tracing_range_m, &f->rays);
        f->rays.salt = sample;
        lw_trace_closest16(p->trace, f->flags, f->active, &f->rays, &f->hits);
        count->bounce += (uint64_t)__builtin_popcount(f->active);
        for (uint32_t lane = 0; lane < LANES; lane++)
            if (f->hits.object[lane] != LW_TRACE_MISS)
                __builtin_prefetch(
                    lw_texels_triangle(p->texels, f->hits.object[lane], f->hits.triangle[lane]));
        move_on(p, flights, count);
    }
}

void lw_passes_trace_ends(const struct lw_passes *p, const struct lw_solve_tile *tile,
                          struct lw_passes_count *count) {
    struct lw_launch launch[LW_PACKETS_MAX];
    struct lw_launch_site site;
    struct flights flights = {.count = 0};
    lw_footprint_frame_init(&site.frame, &p->pose->object_to_world[tile->object]);
    LW_TILES_EACH_BLOCK (tile, block) {
        if (!block->due) continue;
        lw_launch_block(tile, block, p->texels->usable, p->seed,
                        block->frames * p->indirect_samples / PLACE_SHARE, launch);
        for (uint32_t set = 0; set < block->packet_count; set++)
            trace_packet(p, tile, &launch[set], &site, &flights, count);
    }
    land(p, &flights, count);
}

static struct lw_vec3 radiance_at(const struct lw_passes *p, uint32_t end, uint32_t bounce) {
    if (end == LW_END_NOTHING) return lw_vec3(0, 0, 0);
    if (end & LW_END_PROBE)
        return lw_probes_radiance(p->probes, bounce - 1, lw_end_probe(end), lw_end_direction(end));
    const float *l = p->tiles->radiance[bounce - 1] + (size_t)end * 4;
    return lw_vec3(l[0], l[1], l[2]);
}

/* One frame's estimate of one bounce order. */
static struct lw_vec3 gather_texel(const struct lw_passes *p, uint32_t texel, uint32_t bounce) {
    const uint32_t n = p->indirect_samples;
    const uint32_t *end = p->end + (size_t)texel * n;
    struct lw_vec3 sum = {0};
    for (uint32_t s = 0; s < n; s++) sum = lw_vec3_add(sum, radiance_at(p, end[s], bounce));
    return lw_vec3_scale(sum, LW_PI / (float)n);
}

/* Ends lie anywhere in memory: what a few texels from here will read is sent for. */
static void prefetch_ends(const struct lw_passes *p, uint32_t texel, uint32_t bounce) {
    const uint32_t *end = p->end + (size_t)texel * p->indirect_samples;
    for (uint32_t s = 0; s < p->indirect_samples; s++)
        if (!(end[s] & LW_END_PROBE)) __builtin_prefetch(p->tiles->radiance[bounce - 1] + (size_t)end[s] * 4);
}

/* Where a bounce's estimates are summed. */
static int estimate_of(uint32_t bounce) {
    return LW_TILES_ESTIMATE_BOUNCES + (bounce == 1 ? LW_CHANGE_FIRST : LW_CHANGE_LATER);
}

void lw_passes_gather(const struct lw_passes *p, const struct lw_solve_tile *tile, uint32_t bounce) {
    float *const *estimate = p->tiles->estimate[estimate_of(bounce)];
    const uint32_t count = tile->width * tile->height;
    for (uint32_t i = 0; i < count; i++) {
        const uint32_t texel = tile->first + i;
        if (i + GATHER_AHEAD < count) prefetch_ends(p, texel + GATHER_AHEAD, bounce);
        const struct lw_solve_block *block = lw_tiles_block(tile, i % tile->width, i / tile->width);
        if (!block->due || !p->tiles->covered[texel]) continue;
        const struct lw_vec3 e = gather_texel(p, texel, bounce);
        blend(p->tiles->order[bounce - 1], texel, e, block->indirect.weight);
        store(estimate, texel, bounce <= 2 ? e : lw_vec3_add(lw_texels_vector(estimate, texel), e));
    }
}

/* ---- comparing ---- */

/* How many times its block's light, or the others' difference, one texel's may be: single bright ends are no news. */
#define DIFFERENCE_MAX 4.0f

/* Of a block; texel: within the tile. */
static uint32_t quarter_of(const struct lw_solve_tile *tile, uint32_t texel) {
    return lw_change_region(texel % tile->width, texel / tile->width);
}

/* An estimate beyond float's range is in no mean (blend()), and tells nothing. */
static struct lw_vec3 difference(struct lw_vec3 now, struct lw_vec3 then) {
    const struct lw_vec3 off = lw_vec3_sub(now, then);
    return lw_vec3_is_finite(off) ? off : lw_vec3(0, 0, 0);
}

/* Takes the samples of direct light of a packet's last solve again. Needs the site's frame. */
static void repeat_direct(const struct lw_passes *p, const struct lw_solve_tile *tile,
                          struct lw_launch *launch, struct lw_launch_site *site,
                          struct lw_direct_estimate *out_direct, struct lw_passes_count *count) {
    launch->frames--; /* the numbers of that solve */
    lw_launch_choose(launch, tile, p->texels->usable, p->seed, launch->frames * p->direct_samples);
    lw_direct_light(p, tile, launch, site, out_direct, count);
    launch->frames++;
}

/* Likewise its bounce rays, up to where they end. */
static void repeat_bounces(const struct lw_passes *p, const struct lw_solve_tile *tile,
                           struct lw_launch *launch, struct lw_launch_site *site,
                           struct lw_passes_count *count) {
    if (!p->tiles->bounces) return;
    launch->frames--;
    lw_launch_choose(launch, tile, p->texels->usable, p->seed,
                     launch->frames * p->indirect_samples / PLACE_SHARE);
    struct flights flights = {.count = 0};
    trace_packet(p, tile, launch, site, &flights, count);
    land(p, &flights, count);
    launch->frames++;
}

static struct lw_vec3 gather_order(const struct lw_passes *p, uint32_t texel, int order) {
    const uint32_t last = order == LW_CHANGE_FIRST ? 1 : p->tiles->bounces;
    struct lw_vec3 e = {0};
    for (uint32_t bounce = order == LW_CHANGE_FIRST ? 1 : 2; bounce <= last && bounce <= p->tiles->bounces;
         bounce++)
        e = lw_vec3_add(e, gather_texel(p, texel, bounce));
    return e;
}

/* direct: estimated anew; all: so are the block's other packets. Returns whether the light has been corrected. */
static bool compare_direct(const struct lw_passes *p, const struct lw_solve_tile *tile,
                           struct lw_solve_block *block, uint32_t set, const struct lw_launch *launch,
                           const struct lw_direct_estimate *direct, bool all) {
    const uint32_t lanes = (uint32_t)__builtin_popcount(launch->active);
    float *square = &block->change.packet[set].direct_square;
    struct lw_vec3 off[LANES], off_drawn[LANES];
    *square = 0;
    for (uint32_t lane = 0; lane < lanes; lane++) {
        const uint32_t texel = tile->first + launch->texel[lane];
        off[lane] = difference(lane_of(direct->all, lane),
                               lw_texels_vector(p->tiles->estimate[LW_TILES_ESTIMATE_DIRECT], texel));
        if (p->drawn)
            off_drawn[lane] =
                difference(lane_of(direct->drawn, lane), lw_texels_vector(p->tiles->drawn_estimate, texel));
        *square += lw_vec3_max_abs(off[lane]) * lw_vec3_max_abs(off[lane]);
    }
    if (!all || !(*square > 0)) return false;
    lw_correction_direct(p->tiles, tile, block, set, launch, off, p->drawn ? off_drawn : NULL);
    return true;
}

static void compare_indirect(const struct lw_passes *p, const struct lw_solve_tile *tile,
                             struct lw_solve_block *block, uint32_t set, const struct lw_launch *launch) {
    struct lw_change_packet found = block->change.packet[set];
    const uint32_t lanes = (uint32_t)__builtin_popcount(launch->active);
    struct lw_vec3 off[LANES], of_order[LW_CHANGE_ORDERS][LANES];
    float sum = 0;
    memset(found.indirect, 0, sizeof found.indirect);
    memset(found.indirect_square, 0, sizeof found.indirect_square);
    for (uint32_t lane = 0; lane < lanes; lane++) {
        const uint32_t texel = tile->first + launch->texel[lane];
        off[lane] = lw_vec3(0, 0, 0);
        for (int order = 0; order < LW_CHANGE_ORDERS; order++) {
            of_order[order][lane] =
                difference(gather_order(p, texel, order),
                           lw_texels_vector(p->tiles->estimate[LW_TILES_ESTIMATE_BOUNCES + order], texel));
            off[lane] = lw_vec3_add(off[lane], of_order[order][lane]);
        }
        sum += lw_vec3_max_abs(off[lane]);
    }
    for (uint32_t lane = 0; lane < lanes; lane++) {
        const float size = lw_vec3_max_abs(off[lane]);
        const float others = lanes > 1 ? (sum - size) / (float)(lanes - 1) : size;
        const float bound = DIFFERENCE_MAX * fmaxf(block->light, others);
        const uint32_t region = quarter_of(tile, launch->texel[lane]);
        const float share = size > bound ? bound / size : 1;
        for (int order = 0; order < LW_CHANGE_ORDERS; order++)
            found.indirect[order][region] =
                lw_vec3_mad(found.indirect[order][region], of_order[order][lane], share);
        found.indirect_square[region] += share * share * lw_vec3_dot(off[lane], off[lane]);
    }
    block->change.packet[set] = found;
}

bool lw_passes_compare(const struct lw_passes *p, struct lw_solve_tile *tile, struct lw_passes_count *count) {
    struct lw_launch launch;
    struct lw_launch_site site;
    bool corrected = false;
    lw_footprint_frame_init(&site.frame, &p->pose->object_to_world[tile->object]);
    LW_TILES_EACH_BLOCK (tile, block) {
        const struct lw_change_block *change = &block->change;
        const bool all = change->direct == lw_change_all_packets(block);
        for (uint32_t set = 0; set < block->packet_count; set++) {
            const uint16_t bit = (uint16_t)(1u << set);
            if (!((change->compare | change->direct) & bit)) continue;
            struct lw_direct_estimate direct;
            lw_launch_init(&launch, tile, block, set);
            if (change->direct & bit) {
                repeat_direct(p, tile, &launch, &site, &direct, count);
                corrected |= compare_direct(p, tile, block, set, &launch, &direct, all);
            }
            if (change->retrace & bit) repeat_bounces(p, tile, &launch, &site, count);
            if (change->compare & bit) compare_indirect(p, tile, block, set, &launch);
        }
    }
    if (corrected) lw_correction_doubt_direct(tile);
    return corrected;
}

void lw_passes_reread(const struct lw_passes *p, struct lw_solve_tile *tile) {
    struct lw_passes_count none = {0};
    LW_TILES_EACH_BLOCK (tile, block) {
        struct lw_change_block *change = &block->change;
        change->retrace = change->direct = 0;
        change->compare = change->told = change->asked =
            block->due && block->frames ? lw_change_all_packets(block) : 0;
    }
    (void)lw_passes_compare(p, tile, &none);
    (void)lw_correction_indirect(p->tiles, tile, p->target_error, false);
    LW_TILES_EACH_BLOCK (tile, block)
        if (block->due) lw_change_note_rest(block);
}

/* The mean by which what arrives along a texel's rays of bounces from the second on differs from the frame before. */
static struct lw_vec3 change_at(const struct lw_passes *p, uint32_t texel) {
    const uint32_t n = p->indirect_samples;
    const uint32_t *end = p->end + (size_t)texel * n;
    struct lw_vec3 sum = {0};
    for (uint32_t s = 0; s < n; s++) {
        if (end[s] & LW_END_PROBE) continue; /* or nothing */
        const uint32_t block = p->tiles->block_of_texel[end[s]];
        for (uint32_t bounce = 2; bounce <= p->tiles->bounces; bounce++)
            sum = lw_vec3_add(sum, p->tiles->radiance_change[bounce - 1][block]);
    }
    return lw_vec3_scale(sum, LW_PI / (float)n);
}

/* weight: of the mean that is out of date by what is found. */
static void note_arrival(const struct lw_passes *p, const struct lw_solve_tile *tile,
                         struct lw_solve_block *block, float weight) {
    for (uint32_t set = 0; set < block->packet_count; set++) {
        struct lw_change_packet *found = &block->change.packet[set];
        struct lw_launch launch;
        lw_launch_init(&launch, tile, block, set);
        *found = (struct lw_change_packet){0};
        for (uint32_t lane = 0; lane < block->packet[set].count; lane++) {
            const uint32_t region = quarter_of(tile, launch.texel[lane]);
            const struct lw_vec3 off = lw_vec3_scale(change_at(p, tile->first + launch.texel[lane]), weight);
            struct lw_vec3 *sum = &found->indirect[LW_CHANGE_LATER][region];
            *sum = lw_vec3_add(*sum, off);
            found->indirect_square[region] += lw_vec3_dot(off, off);
        }
    }
    block->change.told = block->change.asked = lw_change_all_packets(block);
}

void lw_passes_arrive(const struct lw_passes *p, struct lw_solve_tile *tile) {
    LW_TILES_EACH_BLOCK (tile, block)
        if (block->due) note_arrival(p, tile, block, 1 - block->indirect.weight);
    (void)lw_correction_indirect(p->tiles, tile, p->target_error, false);
    LW_TILES_EACH_BLOCK (tile, block)
        if (block->due) lw_change_note_rest(block);
}

void lw_passes_recall(const struct lw_passes *p, const struct lw_solve_tile *tile,
                      struct lw_passes_count *count) {
    struct lw_launch launch;
    struct lw_launch_site site;
    lw_footprint_frame_init(&site.frame, &p->pose->object_to_world[tile->object]);
    LW_TILES_EACH_BLOCK (tile, block)
        for (uint32_t set = 0; block->frames && set < block->packet_count; set++) {
            struct lw_direct_estimate direct;
            lw_launch_init(&launch, tile, block, set);
            repeat_direct(p, tile, &launch, &site, &direct, count);
            repeat_bounces(p, tile, &launch, &site, count);
            for (uint32_t lane = 0; lane < block->packet[set].count; lane++) {
                const uint32_t texel = tile->first + launch.texel[lane];
                store_direct(p, texel, &direct, lane);
                for (int order = 0; order < LW_CHANGE_ORDERS; order++)
                    store(p->tiles->estimate[LW_TILES_ESTIMATE_BOUNCES + order], texel,
                          gather_order(p, texel, order));
            }
        }
}

/* ---- radiance ---- */

void lw_passes_radiate(const struct lw_passes *p, const struct lw_solve_tile *tile, uint32_t bounce) {
    float *const *e = bounce == 0 ? p->tiles->direct : p->tiles->order[bounce - 1];
    float *const *albedo = tile->mesh->albedo;
    struct lw_vec3 *change = p->tiles->radiance_change[bounce];
    for (uint32_t i = 0; i < tile->width * tile->height; i++) {
        const uint32_t texel = tile->first + i;
        float *l = p->tiles->radiance[bounce] + (size_t)texel * 4;
        const struct lw_vec3 now = lw_vec3_scale(
            lw_vec3_mul(lw_texels_vector(e, texel), lw_texels_vector(albedo, tile->local + i)), 1 / LW_PI);
        if (p->tiles->covered[texel]) {
            const uint32_t block = p->tiles->block_of_texel[texel];
            change[block] = lw_vec3_mad(change[block], lw_vec3_sub(now, lw_vec3(l[0], l[1], l[2])),
                                        1 / (float)p->tiles->block[block].covered_count);
        }
        l[0] = now.x;
        l[1] = now.y;
        l[2] = now.z;
    }
}

/* ---- sums ---- */

/* What the last solve had of one part of a texel's light. */
static struct lw_vec3 estimate_at(const struct lw_tiles *tiles, int part, uint32_t texel) {
    if (part == LW_TILES_DIRECT) return lw_texels_vector(tiles->estimate[LW_TILES_ESTIMATE_DIRECT], texel);
    struct lw_vec3 e = {0};
    for (int order = 0; order < LW_CHANGE_ORDERS; order++)
        e = lw_vec3_add(e, lw_texels_vector(tiles->estimate[LW_TILES_ESTIMATE_BOUNCES + order], texel));
    return e;
}

/* Running mean and spread (Welford 1962), forgetting as the sums do. */
static void note_luminance(float *mean, float *spread, float x, float weight) {
    const float off = x - *mean;
    *mean += off * weight;
    *spread = (1 - weight) * (*spread + weight * off * off);
}

/* Of the frames' estimates. */
static void note_estimate(struct lw_tiles *tiles, uint32_t texel, float weight) {
    const struct lw_vec3 e =
        lw_vec3_add(estimate_at(tiles, LW_TILES_DIRECT, texel), estimate_at(tiles, LW_TILES_INDIRECT, texel));
    note_luminance(&tiles->mean[texel], &tiles->spread[texel], lw_colour_luminance(e), weight);
    if (!tiles->split_mean) return;
    const struct lw_vec3 split = lw_vec3_sub(e, lw_texels_vector(tiles->drawn_estimate, texel));
    note_luminance(&tiles->split_mean[texel], &tiles->split_spread[texel], lw_colour_luminance(split),
                   weight);
}

/* What has seen no light yet: what light it may have missed falls with the samples that found none, as 1/N. A scene that
 * casts no light on it at all is found dark as soon as one that hides its light behind a pinhole could be. */
static float error_of_darkness(double samples) { return (float)fmin(1.0, DARK_SAMPLES / fmax(1, samples)); }

/* What an estimate is off the mean that it has entered with weight 1/m is (m-1)/m of what it is off the others' mean, which
 * has a noise of its own: V (m-1)/m in the mean of squares. */
static void note_noise(float *noise, double off_square, double light, const struct lw_memory *memory) {
    if (memory->frames < 2 || !(light > 0)) return;
    const float now = (float)(off_square / (light * light)) * memory->frames / (memory->frames - 1);
    *noise = *noise < 0 ? now : *noise + (now - *noise) * NOISE_WEIGHT;
}

static void add_up_block(struct lw_tiles *tiles, const struct lw_solve_tile *tile, uint32_t column,
                         uint32_t row) {
    struct lw_solve_block *block = &tile->block[row * tile->block_columns + column];
    const uint32_t right = (column + 1) * LW_TILE_BLOCK, below = (row + 1) * LW_TILE_BLOCK;
    double variance = 0, luminance = 0, square[LW_TILES_PARTS] = {0};
    float drift[LW_TILES_PARTS][LW_CHANGE_REGIONS] = {{0}};
    uint32_t texels[LW_CHANGE_REGIONS] = {0};
    float *const *const sum[LW_TILES_PARTS] = {tiles->direct, tiles->indirect};
    for (uint32_t y = row * LW_TILE_BLOCK; y < below && y < tile->height; y++)
        for (uint32_t x = column * LW_TILE_BLOCK; x < right && x < tile->width; x++) {
            const uint32_t texel = tile->first + y * tile->width + x;
            if (!tiles->covered[texel]) continue;
            note_estimate(tiles, texel, block->indirect.weight);
            variance += (double)tiles->judged_spread[texel];
            luminance += (double)tiles->mean[texel];
            texels[lw_change_region(x, y)]++;
            for (int part = 0; part < LW_TILES_PARTS; part++) {
                const float off = lw_colour_luminance(
                    lw_vec3_sub(estimate_at(tiles, part, texel), lw_texels_vector(sum[part], texel)));
                square[part] += (double)off * (double)off;
                drift[part][lw_change_region(x, y)] += off;
            }
        }
    const double each = 1.0 / block->covered_count;
    note_noise(&block->noise[LW_TILES_DIRECT], square[LW_TILES_DIRECT] * each, luminance * each,
               &block->direct);
    note_noise(&block->noise[LW_TILES_INDIRECT], square[LW_TILES_INDIRECT] * each, luminance * each,
               &block->indirect);
    for (uint32_t r = 0; r < LW_CHANGE_REGIONS; r++)
        for (int part = 0; texels[r] && part < LW_TILES_PARTS; part++)
            lw_change_note_drift(block, part, r, drift[part][r] / (float)texels[r]);
    block->frames++;
    block->variance = variance;
    block->luminance = luminance;
}

void lw_passes_judge(const struct lw_passes *p, struct lw_solve_tile *tile) {
    if (!tile->covered_count) return;
    const uint32_t samples =
        p->direct_samples > p->indirect_samples ? p->direct_samples : p->indirect_samples;
    double luminance = 0, looks = 0, square = 0;
    LW_TILES_EACH_BLOCK (tile, block) {
        luminance += block->luminance;
        looks += (double)block->frames * samples * block->covered_count;
    }
    const double tile_mean = luminance / tile->covered_count;
    LW_TILES_EACH_BLOCK (tile, block) {
        const double n = block->covered_count, light = n > 0 ? fmax(block->luminance / n, tile_mean) : 0;
        if (!(n > 0)) continue;
        if (!(light < LIKE * (double)block->light && (double)block->light < LIKE * light))
            block->noise[LW_TILES_DIRECT] = block->noise[LW_TILES_INDIRECT] = -1;
        block->light = (float)light;
        /* variance is that of one estimate; the mean of h of them has 1/(h-1) of it (Bessel's correction in it). */
        const double others = (double)block->indirect.frames - 1;
        if (others < 1)
            block->error = 1;
        else if (light > 0)
            block->error =
                (float)fmin(1, sqrt(block->variance / n / others) / (light + (double)block->beside));
        else
            block->error = error_of_darkness(looks);
        square += n * (double)block->error * (double)block->error;
    }
    tile->error = (float)sqrt(square / tile->covered_count);
}

void lw_passes_finish_tile(const struct lw_passes *p, struct lw_solve_tile *tile) {
    struct lw_tiles *tiles = p->tiles;
    for (uint32_t i = 0; i < tile->width * tile->height; i++) {
        const uint32_t texel = tile->first + i;
        if (!tiles->covered[texel]) continue;
        for (int c = 0; c < 3; c++) {
            float sum = 0;
            for (uint32_t k = 0; k < tiles->bounces; k++) sum += tiles->order[k][c][texel];
            tiles->indirect[c][texel] = sum;
        }
    }
    for (uint32_t row = 0; row < tile->block_rows; row++)
        for (uint32_t column = 0; column < tile->block_columns; column++) {
            const struct lw_solve_block *block = &tile->block[row * tile->block_columns + column];
            if (block->due && block->covered_count) add_up_block(tiles, tile, column, row);
        }
    lw_passes_judge(p, tile);
}
