#include "server/solve/transport/bounces.h"

#include "common/base/colour.h"
#include "common/base/invariant.h"
#include "common/base/sampling.h"
#include "common/base/wide.h"
#include "common/light/direction.h"
#include "server/solve/surface/wall_sides.h"
#include "server/solve/transport/hit_gloss.h"
#include "server/solve/transport/hit_sun.h"
#include "server/solve/transport/ray_hit.h"

#include <math.h>

#define LANES LW_TRACE_WIDTH
/* This many bounce rays in a row start at the same place of their texel: finding it
 * costs as much as half a ray. */
#define PLACE_SHARE 2u
/* Its rays meet transparent surfaces by chances of their own. */
#define REFLECTOR_SALT 0x5a000000u
/* Texels ahead of the current one whose ray hits are prefetched. */
#define GATHER_AHEAD 12u
/* One rare bright sample among few makes a texel shine like a lamp, and what lies close by reads that again
 * and again while the mean forgets it. So a texel of n frames sends on by itself at most RARE + n times
 * its block's mean. The whole block sends the rest: light stays. */
#define RARE        2.0f
#define RARE_MEAN   4.0f
#define RARE_FRAMES 64u /* from here on each sends what it has */

/* Nearly the same direction about each lane's normal. */
LW_WIDE static void aim(const struct lw_points16 *restrict at, const float point[2], float t_far,
                        struct lw_ray16 *restrict rays) {
    struct lw_vec3 local[LANES];
    for (uint32_t lane = 0; lane < LANES; lane++) {
        float own[2];
        lw_sampling_spread(point, lane, own);
        local[lane] = lw_direction_cosine(own);
    }
    for (uint32_t lane = 0; lane < LANES; lane++) {
        const struct lw_vec3 normal = lw_vec3(at->nx[lane], at->ny[lane], at->nz[lane]);
        const struct lw_vec3 d = lw_direction_about(normal, local[lane]);
        rays->dir_x[lane] = d.x;
        rays->dir_y[lane] = d.y;
        rays->dir_z[lane] = d.z;
        rays->t_far[lane] = t_far;
    }
}

/* A packet's bounce rays on their way to the texels that they end on. Every step reads memory that lies
 * anywhere: it is sent for while the next packets are traced. */
struct flight {
    struct lw_ray16 rays;
    struct lw_hit16 hits;
    uint32_t texel[LANES], hit[LANES];
    uint32_t sample; /* number within the frame */
    uint16_t active;
    bool has_moments; /* its texels read directions */
    unsigned flags;
};
#define FLIGHTS 3u /* traced; ended; about to be noted */
struct flights {
    struct flight flight[FLIGHTS];
    uint32_t count;
};

static struct lw_vec3 origin_of(const struct lw_ray16 *rays, uint32_t lane) {
    return lw_vec3(rays->org_x[lane], rays->org_y[lane], rays->org_z[lane]);
}

/* Where a lane's ray ended, if it met something; not yet the texel that stands for it. Reflectors have rays
 * of their own. */
static uint32_t hit_of(const struct lw_transport *t, const struct flight *f, uint32_t lane) {
    const struct lw_hit16 *hits = &f->hits;
    if (hits->object[lane] == LW_TRACE_MISS) return LW_RAY_HIT_NOTHING;
    if (t->reflectors->count && hits->t[lane] <= t->tracing_range_m &&
        lw_reflectors_have(t->reflectors, origin_of(&f->rays, lane), hits->object[lane],
                           hits->triangle[lane]))
        return LW_RAY_HIT_NOTHING;
    return lw_texels_under(t->texels, hits->object[lane], hits->triangle[lane], hits->u[lane], hits->v[lane],
                           hits->back[lane]);
}

/* Chooses a probe for a ray that has reached the tracing range; false if none sees where it stands.
 * random: a word of the ray's own. */
static bool ask_probes(const struct lw_transport *t, const struct lw_ray16 *rays, uint32_t lane,
                       uint32_t random, uint32_t *out_hit) {
    const struct lw_vec3 d = lw_vec3(rays->dir_x[lane], rays->dir_y[lane], rays->dir_z[lane]);
    const struct lw_vec3 point = lw_vec3_mad(origin_of(rays, lane), d, rays->t_far[lane]);
    /* Outside the box there are only objects that have moved there: a ray that costs next to nothing. */
    if (!lw_cells_contain(&t->probes->grid, point)) return false;
    *out_hit = lw_probes_ask(t->probes, point, d, random);
    return *out_hit != LW_PROBES_UNSEEN;
}

static void take_hit(struct lw_hit16 *to, const struct lw_hit16 *from, uint32_t lane) {
    to->t[lane] = from->t[lane];
    to->u[lane] = from->u[lane];
    to->v[lane] = from->v[lane];
    to->object[lane] = from->object[lane];
    to->triangle[lane] = from->triangle[lane];
    to->back[lane] = from->back[lane];
}

/* Ends of a packet's rays: what they hit, else what a probe knows, else what they hit further on. */
static void find_hits(const struct lw_transport *t, struct flight *f, struct lw_ray_count *count) {
    uint16_t unseen = 0;
    for (uint32_t lane = 0; lane < LANES; lane++) {
        if (!(f->active >> lane & 1)) continue;
        f->hit[lane] = hit_of(t, f, lane);
        if (f->hits.object[lane] != LW_TRACE_MISS || !t->probes) continue;
        const uint32_t random =
            lw_random_hash3(t->seed, f->texel[lane], f->rays.salt ^ LW_SAMPLING_PROBE << 24);
        if (ask_probes(t, &f->rays, lane, random, &f->hit[lane])) continue;
        f->rays.t_near[lane] = f->rays.t_far[lane];
        f->rays.t_far[lane] = INFINITY;
        unseen |= (uint16_t)(1u << lane);
    }
    if (unseen) {
        struct lw_hit16 further;
        lw_trace_closest16(t->trace, f->flags, unseen, &f->rays, &further);
        for (uint32_t lane = 0; lane < LANES; lane++) {
            if (!(unseen >> lane & 1)) continue;
            take_hit(&f->hits, &further, lane);
            f->hit[lane] = hit_of(t, f, lane);
        }
        count->bounce += (uint64_t)__builtin_popcount(unseen);
    }
    for (uint32_t lane = 0; lane < LANES; lane++)
        if (f->active >> lane & 1 && !(f->hit[lane] & LW_RAY_HIT_PROBE)) {
            __builtin_prefetch(&t->texels->source[f->hit[lane]]);
            __builtin_prefetch(&t->texels->walls[f->hit[lane]]);
        }
}
_Static_assert((LW_RAY_HIT_NOTHING & LW_RAY_HIT_PROBE) != 0 && LW_TEXEL_NONE == LW_RAY_HIT_NOTHING,
               "no texels either");

/* A probe, nothing, or a texel with light. */
static bool can_be_read(const struct lw_transport *t, uint32_t hit) {
    if (hit & LW_RAY_HIT_PROBE) return hit == LW_RAY_HIT_NOTHING || lw_ray_hit_probe(hit) < t->probes->count;
    return hit < t->tiles->texel_count && t->tiles->covered[hit];
}

static struct lw_vec3 end_of(const struct flight *f, uint32_t lane) {
    return lw_vec3_mad(origin_of(&f->rays, lane),
                       lw_vec3(f->rays.dir_x[lane], f->rays.dir_y[lane], f->rays.dir_z[lane]),
                       f->hits.t[lane]);
}

/* The texel for a ray that sees none of those around its end, as in a deep reveal: that of the ray of the
 * packet which ends nearest, of those that start on the same side of walls. Black would take light from all
 * that is rougher than its texels. */
static uint32_t read_beside(const struct lw_transport *t, const struct flight *f, uint16_t seen,
                            uint32_t lane) {
    const struct lw_vec3 end = end_of(f, lane);
    const uint32_t side = t->texels->side[f->texel[lane]];
    uint32_t best = LW_TEXEL_NONE;
    float least = INFINITY;
    for (uint32_t k = 0; k < LANES; k++) {
        if (!(seen >> k & 1) || t->texels->side[f->texel[k]] != side) continue;
        const struct lw_vec3 apart = lw_vec3_sub(end_of(f, k), end);
        const float square = lw_vec3_dot(apart, apart);
        if (!(square < least)) continue;
        least = square;
        best = f->hit[k];
    }
    return best;
}

/* Reads texels for the ends of a packet's rays on surfaces. */
static void read_surfaces(const struct lw_transport *t, struct flight *f, struct lw_ray_count *count) {
    const struct lw_wall_sides sides = {.texels = t->texels, .pose = t->pose, .trace = t->trace};
    uint16_t surfaces = 0, seen = 0;
    for (uint32_t lane = 0; lane < LANES; lane++)
        if (f->active >> lane & 1 && !(f->hit[lane] & LW_RAY_HIT_PROBE)) surfaces |= (uint16_t)(1u << lane);
    lw_wall_sides_read16(&sides, surfaces, &f->rays, &f->hits, f->hit);
    for (uint32_t lane = 0; lane < LANES; lane++)
        if (surfaces >> lane & 1 && f->hit[lane] != LW_TEXEL_NONE) seen |= (uint16_t)(1u << lane);
    lw_hit_sun_read16(t, seen, f->texel, f->rays.salt, &f->hits, f->hit, count);
    for (uint32_t lane = 0; seen && lane < LANES; lane++)
        if (surfaces >> lane & 1 && f->hit[lane] == LW_TEXEL_NONE)
            f->hit[lane] = read_beside(t, f, seen, lane);
}

static uint16_t pack_direction(const struct lw_ray16 *rays, uint32_t lane) {
    return lw_ray_direction_pack(lw_vec3(rays->dir_x[lane], rays->dir_y[lane], rays->dir_z[lane]));
}

/* Notes the texels that a packet's rays read. */
static void note_hits(const struct lw_transport *t, struct flight *f, struct lw_ray_count *count) {
    read_surfaces(t, f, count);
    for (uint32_t lane = 0; lane < LANES; lane++)
        LW_INVARIANT_DEAR(!(f->active >> lane & 1) || can_be_read(t, f->hit[lane]));
    for (uint32_t lane = 0; lane < LANES; lane++)
        if (f->active >> lane & 1)
            t->ray_hit[(size_t)f->texel[lane] * t->indirect_samples + f->sample] = f->hit[lane];
    for (uint32_t lane = 0; t->ray_gloss && lane < LANES; lane++)
        if (f->active >> lane & 1)
            t->ray_gloss[(size_t)f->texel[lane] * t->indirect_samples + f->sample] =
                f->hit[lane] & LW_RAY_HIT_PROBE
                    ? LW_HIT_GLOSS_ONE
                    : lw_hit_gloss(t, &f->rays, &f->hits, lane, f->texel[lane], f->hit[lane]);
    for (uint32_t lane = 0; f->has_moments && lane < LANES; lane++)
        if (f->active >> lane & 1)
            t->ray_direction[(size_t)f->texel[lane] * t->indirect_samples + f->sample] =
                pack_direction(&f->rays, lane);
}

/* One step for the two packets before the one that has been traced last. */
static void move_on(const struct lw_transport *t, struct flights *flights, struct lw_ray_count *count) {
    if (flights->count > 1) find_hits(t, &flights->flight[(flights->count - 2) % FLIGHTS], count);
    if (flights->count > 2) note_hits(t, &flights->flight[(flights->count - 3) % FLIGHTS], count);
}

/* The steps that are left. */
static void land(const struct lw_transport *t, struct flights *flights, struct lw_ray_count *count) {
    if (flights->count > 0) find_hits(t, &flights->flight[(flights->count - 1) % FLIGHTS], count);
    for (uint32_t k = flights->count < 2 ? flights->count : 2; k > 0; k--)
        note_hits(t, &flights->flight[(flights->count - k) % FLIGHTS], count);
    flights->count = 0;
}

/* ---- rays to reflectors (reflectors.h) ---- */

/* The random numbers of a packet's rays to one of them. */
static void draw(const struct lw_transport *t, const struct lw_solve_tile *tile,
                 const struct lw_ray_launch *launch, uint32_t use, float out[2]) {
    lw_sampling_point(lw_sampling_seed(t->seed, tile->object, launch->block, use), launch->frames,
                      launch->set, out);
}

/* From the middle of a packet's places. */
static struct lw_vec3 middle_of(const struct lw_points16 *at, uint16_t active) {
    struct lw_vec3 sum = {0};
    for (uint32_t lane = 0; lane < LANES; lane++)
        if (active >> lane & 1) sum = lw_vec3_add(sum, lw_vec3(at->x[lane], at->y[lane], at->z[lane]));
    return lw_vec3_scale(sum, 1 / (float)__builtin_popcount(active));
}

/* Of all frames, in how many a packet sends rays to them; what these find counts as many times more. The same
 * when rays are traced again. */
static float share_of_frames(const struct lw_transport *t, uint32_t texel, struct lw_vec3 place) {
    const float own = t->tiles->block[t->tiles->block_of_texel[texel]].traced_luminance;
    return own > 0 ? fminf(1, lw_reflectors_most(t->reflectors, place) / own) : 1;
}

/* What a point on a reflector gives a lane, if nothing lies between them; false: nothing. */
static bool aim_at(const struct lw_transport *t, const struct lw_reflector *reflector,
                   const struct lw_reflector_point *point, const struct lw_ray_launch_site *site,
                   uint32_t lane, struct lw_ray16 *rays, struct lw_reflected *out) {
    const struct lw_points16 *at = &site->lanes.at;
    const struct lw_vec3 from = lw_vec3(at->x[lane], at->y[lane], at->z[lane]),
                         normal = lw_vec3(at->nx[lane], at->ny[lane], at->nz[lane]),
                         way = lw_vec3_sub(point->position_ws, from);
    const float square = lw_vec3_dot(way, way), here = lw_vec3_dot(way, normal),
                there = lw_vec3_dot(way, point->normal_ws);
    if (!(here > 0) || !(square > 0) || sqrtf(square) > t->tracing_range_m ||
        !lw_reflectors_have(t->reflectors, from, reflector->object, point->triangle))
        return false;
    out->texel =
        lw_texels_under(t->texels, reflector->object, point->triangle, point->u, point->v, there > 0);
    out->weight = here * fabsf(there) / (square * square) * point->area_m2;
    lw_trace_set_ray(rays, lane, from, way, LW_TRACE_SHORT);
    return out->texel != LW_TEXEL_NONE && t->texels->source[out->texel] != LW_TEXEL_NONE;
}

/* Puts the texels that are read in the place of those in which rays to a reflector end; lanes that read none
 * are left out. A housing may go through a wall, as a recessed lamp does. */
static uint16_t read_reflector(const struct lw_transport *t, uint32_t object, uint16_t seen,
                               const struct lw_ray16 *rays, struct lw_reflected found[LANES]) {
    const struct lw_wall_sides sides = {.texels = t->texels, .pose = t->pose, .trace = t->trace};
    struct lw_hit16 ends;
    uint32_t texel[LANES];
    uint16_t reads = 0;
    for (uint32_t lane = 0; lane < LANES; lane++) {
        ends.object[lane] = object;
        ends.t[lane] = 1; /* the whole way there */
        texel[lane] = found[lane].texel;
    }
    lw_wall_sides_read16(&sides, seen, rays, &ends, texel);
    for (uint32_t lane = 0; lane < LANES; lane++) {
        found[lane].texel = texel[lane];
        if (seen >> lane & 1 && texel[lane] != LW_TEXEL_NONE) reads |= (uint16_t)(1u << lane);
    }
    return reads;
}

/* Looks for a reflector's light from a packet's sample points: once a frame. */
static void reach(const struct lw_transport *t, const struct lw_solve_tile *tile,
                  const struct lw_ray_launch *launch, const struct lw_ray_launch_site *site,
                  struct lw_ray_count *count) {
    for (uint32_t lane = 0; lane < LANES; lane++) t->reflected[tile->first + launch->texel[lane]].weight = 0;
    if (!t->reflectors->count) return;
    const struct lw_vec3 place = middle_of(&site->lanes.at, launch->active);
    const float share = share_of_frames(t, tile->first + launch->texel[0], place);
    float pick[2], point[2], probability;
    draw(t, tile, launch, LW_SAMPLING_REFLECTOR_PICK, pick);
    if (!(pick[0] < share)) return;
    draw(t, tile, launch, LW_SAMPLING_REFLECTOR, point);
    const struct lw_reflector *reflector =
        lw_reflectors_pick(t->reflectors, place, pick[0] / share, &probability);
    if (t->pose->object_hidden[reflector->object]) return;
    struct lw_ray16 rays = {.salt = launch->frames ^ REFLECTOR_SALT};
    struct lw_reflected found[LANES] = {0};
    uint16_t active = 0;
    for (uint32_t lane = 0; lane < LANES; lane++) {
        struct lw_reflector_point end;
        float own[2], triangle[2];
        if (!(launch->active >> lane & 1)) continue;
        lw_sampling_spread(point, lane, own);
        lw_sampling_spread(pick, lane, triangle);
        lw_reflectors_point(t->reflectors, reflector, t->pose, (float[3]){triangle[1], own[0], own[1]}, &end);
        if (aim_at(t, reflector, &end, site, lane, &rays, &found[lane])) active |= (uint16_t)(1u << lane);
    }
    if (!active) return;
    uint16_t seen = active & (uint16_t)~lw_trace_occluded16(t->trace, LW_TRACE_LIGHT, active, &rays);
    count->bounce += (uint64_t)__builtin_popcount(active);
    seen = read_reflector(t, reflector->object, seen, &rays, found);
    for (uint32_t lane = 0; lane < LANES; lane++) {
        if (!(seen >> lane & 1)) continue;
        found[lane].weight /= probability * share;
        LW_INVARIANT_DEAR(found[lane].weight >= 0 && can_be_read(t, found[lane].texel));
        t->reflected[tile->first + launch->texel[lane]] = found[lane];
        if (lw_tiles_has_moments(t->tiles, tile))
            t->reflected_direction[tile->first + launch->texel[lane]] = pack_direction(&rays, lane);
    }
}

/* ---- all rays of a packet ---- */

/* Where the rays of a packet's texels end in one frame. Needs its sample points for the first of them. */
static void trace_packet(const struct lw_transport *t, const struct lw_solve_tile *tile,
                         struct lw_ray_launch *launch, struct lw_ray_launch_site *site,
                         struct flights *flights, struct lw_ray_count *count) {
    const uint32_t seed = lw_sampling_seed(t->seed, tile->object, launch->block, LW_SAMPLING_BOUNCE);
    for (uint32_t s = 0; s < t->indirect_samples; s++) {
        const uint32_t sample = launch->frames * t->indirect_samples + s;
        if (s > 0 && s % PLACE_SHARE == 0)
            lw_ray_launch_choose(launch, tile, t->texels->usable, t->seed, sample / PLACE_SHARE);
        if (s % PLACE_SHARE == 0) lw_ray_launch_place(launch, tile, site);
        if (s == 0) reach(t, tile, launch, site, count);
        struct flight *f = &flights->flight[flights->count++ % FLIGHTS];
        float point[2];
        for (uint32_t lane = 0; lane < LANES; lane++) f->texel[lane] = tile->first + launch->texel[lane];
        f->sample = s;
        f->active = launch->active;
        f->has_moments = lw_tiles_has_moments(t->tiles, tile);
        f->flags = site->coherent ? LW_TRACE_COHERENT : LW_TRACE_LIGHT;
        lw_sampling_point(seed, sample, launch->set, point);
        lw_ray_launch_start(site, &f->rays);
        aim(&site->lanes.at, point, t->tracing_range_m, &f->rays);
        f->rays.salt = sample;
        lw_trace_closest16(t->trace, f->flags, f->active, &f->rays, &f->hits);
        count->bounce += (uint64_t)__builtin_popcount(f->active);
        for (uint32_t lane = 0; lane < LANES; lane++)
            if (f->hits.object[lane] != LW_TRACE_MISS)
                __builtin_prefetch(
                    lw_texels_triangle(t->texels, f->hits.object[lane], f->hits.triangle[lane]));
        move_on(t, flights, count);
    }
}

void lw_bounces_trace(const struct lw_transport *t, const struct lw_solve_tile *tile,
                      struct lw_ray_count *count) {
    struct lw_ray_launch launch[LW_PACKETS_MAX];
    struct lw_ray_launch_site site;
    struct flights flights = {.count = 0};
    lw_sample_points_frame_init(&site.frame, &t->pose->object_to_world[tile->object]);
    LW_TILES_EACH_BLOCK (tile, block) {
        if (!block->due) continue;
        block->traced_luminance = block->reference_luminance;
        lw_ray_launch_block(tile, block, t->texels->usable, t->seed,
                            block->sample_count * t->indirect_samples / PLACE_SHARE, launch);
        for (uint32_t set = 0; set < block->packet_count; set++)
            trace_packet(t, tile, &launch[set], &site, &flights, count);
    }
    land(t, &flights, count);
}

static struct lw_vec3 radiance_at(const struct lw_transport *t, uint32_t hit, uint32_t bounce) {
    if (hit == LW_RAY_HIT_NOTHING) return lw_vec3(0, 0, 0);
    if (hit & LW_RAY_HIT_PROBE)
        return lw_probes_radiance(t->probes, bounce - 1, lw_ray_hit_probe(hit), lw_ray_hit_direction(hit));
    return lw_tiles_radiance(t->tiles, bounce - 1, hit);
}

/* What a texel's ray brings of a bounce. The first one knows which way glossy surfaces send it. */
static struct lw_vec3 along(const struct lw_transport *t, size_t ray, uint32_t bounce) {
    const struct lw_vec3 even = radiance_at(t, t->ray_hit[ray], bounce);
    if (bounce > 1 || !t->ray_gloss) return even;
    return lw_vec3_scale(even, (float)t->ray_gloss[ray] * (1.0f / LW_HIT_GLOSS_ONE));
}

struct lw_vec3 lw_bounces_at(const struct lw_transport *t, uint32_t texel, uint32_t bounce) {
    const uint32_t n = t->indirect_samples;
    const size_t first = (size_t)texel * n;
    struct lw_vec3 sum = {0};
    for (uint32_t s = 0; s < n; s++) sum = lw_vec3_add(sum, along(t, first + s, bounce));
    const struct lw_reflected *reflected = &t->reflected[texel];
    sum = lw_vec3_scale(sum, LW_PI / (float)n);
    if (!(reflected->weight > 0)) return sum;
    return lw_vec3_mad(sum, radiance_at(t, reflected->texel, bounce), reflected->weight);
}

/* The cosine moment of the same estimate, by luminance. */
static struct lw_vec3 moment_at(const struct lw_transport *t, uint32_t texel, uint32_t bounce) {
    const uint32_t n = t->indirect_samples;
    const size_t first = (size_t)texel * n;
    struct lw_vec3 sum = {0};
    for (uint32_t s = 0; s < n; s++)
        sum = lw_vec3_mad(sum, lw_ray_direction_unpack(t->ray_direction[first + s]),
                          lw_colour_luminance(along(t, first + s, bounce)));
    const struct lw_reflected *reflected = &t->reflected[texel];
    sum = lw_vec3_scale(sum, LW_PI / (float)n);
    if (!(reflected->weight > 0)) return sum;
    return lw_vec3_mad(sum, lw_ray_direction_unpack(t->reflected_direction[texel]),
                       reflected->weight * lw_colour_luminance(radiance_at(t, reflected->texel, bounce)));
}

/* Blends the estimate of a bounce into the mean of the sum of all bounces. Every order has the same weight:
 * the mean forgets once, with the first. */
static void blend_sum(float *const mean[3], uint32_t texel, uint32_t bounce, struct lw_vec3 estimate,
                      float weight) {
    if (bounce == 1) lw_tiles_blend(mean, texel, lw_vec3(0, 0, 0), weight);
    if (!lw_vec3_is_finite(estimate)) return;
    lw_tiles_store(mean, texel, lw_vec3_mad(lw_texels_vector(mean, texel), estimate, weight));
}

/* Ends lie anywhere in memory: what a few texels from here will read is sent for. */
static void prefetch_hits(const struct lw_transport *t, uint32_t texel, uint32_t bounce) {
    const uint32_t *hit = t->ray_hit + (size_t)texel * t->indirect_samples;
    for (uint32_t s = 0; s < t->indirect_samples; s++)
        if (!(hit[s] & LW_RAY_HIT_PROBE)) __builtin_prefetch(&t->tiles->radiance[bounce - 1][hit[s]]);
}

/* Where a bounce's estimates are summed. */
static int estimate_of(uint32_t bounce) {
    return LW_TILES_ESTIMATE_BOUNCES + (bounce == 1 ? LW_CHANGE_FIRST : LW_CHANGE_LATER);
}

void lw_bounces_gather(const struct lw_transport *t, const struct lw_solve_tile *tile, uint32_t bounce) {
    LW_INVARIANT(bounce > 0 && bounce <= t->tiles->bounces);
    const int which = estimate_of(bounce);
    const uint32_t count = tile->width * tile->height;
    const bool has_moments = lw_tiles_has_moments(t->tiles, tile);
    for (uint32_t i = 0; i < count; i++) {
        const uint32_t texel = tile->first + i;
        if (i + GATHER_AHEAD < count) prefetch_hits(t, texel + GATHER_AHEAD, bounce);
        const struct lw_solve_block *block = lw_tiles_block(tile, i % tile->width, i / tile->width);
        LW_INVARIANT_DEAR(!block->due || (block->indirect.weight > 0 && block->indirect.weight <= 1));
        if (!block->due || !t->tiles->covered[texel]) continue;
        const struct lw_vec3 e = lw_bounces_at(t, texel, bounce);
        if (bounce < t->tiles->bounces)
            lw_tiles_blend(t->tiles->order[bounce - 1], texel, e, block->indirect.weight);
        blend_sum(t->tiles->indirect, texel, bounce, e, block->indirect.weight);
        lw_tiles_keep_estimate(t->tiles, which, texel,
                               bounce <= 2 ? e : lw_vec3_add(lw_tiles_estimate(t->tiles, which, texel), e));
        if (has_moments)
            blend_sum(t->tiles->moment[LW_TILES_INDIRECT], texel, bounce, moment_at(t, texel, bounce),
                      block->indirect.weight);
    }
}

void lw_bounces_repeat(const struct lw_transport *t, const struct lw_solve_tile *tile,
                       struct lw_ray_launch *launch, struct lw_ray_launch_site *site,
                       struct lw_ray_count *count) {
    if (!t->tiles->bounces) return;
    LW_INVARIANT(launch->frames > 0); /* it was solved */
    launch->frames--;
    lw_ray_launch_choose(launch, tile, t->texels->usable, t->seed,
                         launch->frames * t->indirect_samples / PLACE_SHARE);
    struct flights flights = {.count = 0};
    trace_packet(t, tile, launch, site, &flights, count);
    land(t, &flights, count);
    launch->frames++;
}

/* What the texels of one block and one side (texels.h) send on of one order. */
struct sending {
    uint32_t side, count;
    double sum;                /* luminance of E, all texels */
    float most;                /* luminance of E that a texel sends on by itself, at most */
    struct lw_vec3 kept, back; /* radiance that texels send by themselves; radiance beyond that */
    struct lw_vec3 spread;     /* radiance beyond, per unit of luminance sent */
};
struct senders {
    float *const *e;
    const struct lw_mesh_texels *mesh;
    uint32_t count; /* 0: each texel sends what it has */
    struct sending sending[LW_TILE_BLOCK * LW_TILE_BLOCK];
};

static struct lw_vec3 reflected(const struct senders *senders, uint32_t texel, uint32_t local) {
    return lw_vec3_scale(lw_vec3_mul(lw_texels_vector(senders->e, texel),
                                     lw_packed_albedo_unpack(senders->mesh->albedo[local])),
                         1 / LW_PI);
}

/* The share of its reflected light that a texel sends on by itself. */
static float share_alone(const struct sending *sending, float luminance) {
    return luminance > sending->most ? sending->most / luminance : 1;
}

/* The entry of a side, made if there is none. Neighbours are mostly on one side: last is tried first. */
static struct sending *sending_of(struct senders *senders, uint32_t side, struct sending *last) {
    if (last && last->side == side) return last;
    for (uint32_t k = 0; k < senders->count; k++)
        if (senders->sending[k].side == side) return &senders->sending[k];
    LW_INVARIANT(senders->count < LW_TILE_BLOCK * LW_TILE_BLOCK);
    struct sending *fresh = &senders->sending[senders->count++];
    *fresh = (struct sending){.side = side, .most = INFINITY};
    return fresh;
}

/* The mean that most is a multiple of counts no texel by more than RARE_MEAN times the mean of all, so that a
 * rare one does not lift it. */
static void find_most(const struct lw_transport *t, const struct lw_solve_tile *tile, uint32_t column,
                      uint32_t row, float sample_count, struct senders *senders) {
    struct sending *sending = NULL;
    for (int round = 0; round < 2; round++) {
        LW_TILES_EACH_TEXEL (tile, column, row, x, y) {
            const uint32_t texel = tile->first + y * tile->width + x;
            if (!t->tiles->covered[texel]) continue;
            sending = sending_of(senders, t->tiles->side[texel], sending);
            sending->count += round == 0;
            sending->sum +=
                (double)fminf(sending->most, lw_colour_luminance(lw_texels_vector(senders->e, texel)));
        }
        for (uint32_t k = 0; k < senders->count; k++) {
            struct sending *each = &senders->sending[k];
            each->most = (float)(each->sum / each->count) * (round ? RARE + sample_count : RARE_MEAN);
            LW_INVARIANT(each->count > 0);
            each->sum = 0;
        }
    }
}

static void spread_rare(const struct lw_transport *t, const struct lw_solve_tile *tile, uint32_t column,
                        uint32_t row, float sample_count, struct senders *senders) {
    struct sending *sending = NULL;
    find_most(t, tile, column, row, sample_count, senders);
    LW_TILES_EACH_TEXEL (tile, column, row, x, y) {
        const uint32_t i = y * tile->width + x, texel = tile->first + i;
        if (!t->tiles->covered[texel]) continue;
        sending = sending_of(senders, t->tiles->side[texel], sending);
        const float luminance = lw_colour_luminance(lw_texels_vector(senders->e, texel));
        const struct lw_vec3 all = reflected(senders, texel, tile->local + i),
                             own = lw_vec3_scale(all, share_alone(sending, luminance));
        sending->kept = lw_vec3_add(sending->kept, own);
        sending->back = lw_vec3_add(sending->back, lw_vec3_sub(all, own));
    }
    for (uint32_t k = 0; k < senders->count; k++) {
        struct sending *each = &senders->sending[k];
        const float luminance = lw_colour_luminance(each->kept);
        if (!(luminance > 0)) continue;
        /* no reciprocal: of the faintest light it is infinite */
        each->spread = lw_vec3(each->back.x / luminance, each->back.y / luminance, each->back.z / luminance);
    }
}

static void radiate_block(const struct lw_transport *t, const struct lw_solve_tile *tile, uint32_t column,
                          uint32_t row, uint32_t bounce) {
    const struct lw_solve_block *block = &tile->block[row * tile->block_columns + column];
    struct senders senders;
    struct sending *sending = NULL;
    senders.e = bounce == 0 ? t->tiles->direct : t->tiles->order[bounce - 1];
    senders.mesh = tile->mesh;
    senders.count = 0;
    struct lw_vec3 change[LW_REGIONS] = {{0}};
    uint32_t texels[LW_REGIONS] = {0};
    if (bounce && block->covered_count && block->indirect.sample_count < RARE_FRAMES)
        spread_rare(t, tile, column, row, (float)block->indirect.sample_count, &senders);
    LW_TILES_EACH_TEXEL (tile, column, row, x, y) {
        const uint32_t i = y * tile->width + x, texel = tile->first + i;
        const struct lw_vec3 before = lw_tiles_radiance(t->tiles, bounce, texel);
        struct lw_vec3 now = reflected(&senders, texel, tile->local + i);
        if (senders.count && t->tiles->covered[texel]) {
            sending = sending_of(&senders, t->tiles->side[texel], sending);
            now = lw_vec3_scale(
                now, share_alone(sending, lw_colour_luminance(lw_texels_vector(senders.e, texel))));
            now = lw_vec3_mad(now, sending->spread, lw_colour_luminance(now));
        }
        LW_INVARIANT_DEAR(!t->tiles->covered[texel] || lw_vec3_is_finite(now));
        t->tiles->radiance[bounce][texel] = lw_packed_light(now, LW_PACKED_LIGHT_POSITIVE);
        now = lw_tiles_radiance(t->tiles, bounce, texel);
        if (t->tiles->covered[texel]) {
            const uint32_t region = t->tiles->region_of_texel[texel];
            change[region] = lw_vec3_add(change[region], lw_vec3_sub(now, before));
            texels[region]++;
        }
    }
    struct lw_vec3 *sum = &t->tiles->radiance_change[bounce][(block - t->tiles->block) * LW_REGIONS];
    for (uint32_t r = 0; r < LW_REGIONS; r++)
        if (texels[r]) sum[r] = lw_vec3_mad(sum[r], change[r], 1 / (float)texels[r]);
}

void lw_bounces_radiate(const struct lw_transport *t, const struct lw_solve_tile *tile, uint32_t bounce) {
    LW_INVARIANT(bounce < t->tiles->bounces);
    if (tile->fine_pair) return; /* rays read level 0 */
    for (uint32_t row = 0; row < tile->block_rows; row++)
        for (uint32_t column = 0; column < tile->block_columns; column++)
            radiate_block(t, tile, column, row, bounce);
}
