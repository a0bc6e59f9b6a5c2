#include "server/solve/passes.h"

#include "common/colour.h"
#include "common/light/direction.h"
#include "common/wide.h"
#include "server/solve/sampling.h"
#include "server/solve/transport.h"

#include <string.h>

#define LANES LW_TRACE_WIDTH
/* So many bounce rays in a row start at the same place of their texel: finding it costs as much as half a ray. */
#define PLACE_SHARE 2u
/* So many samples without light count as an error of 1; a full tile rests after some 25 frames at 0.02. */
#define DARK_SAMPLES 2000.0
/* Packets whose normals agree to this cosine run parallel enough for Embree's coherent traversal. */
#define COHERENT_COSINE 0.95f

/* The texels of a packet (packets.h), in world space. */
struct packet {
    uint32_t lane_texel[LANES]; /* within the tile */
    uint16_t active;
    bool coherent;
    uint32_t block, set;             /* of the numbers that it draws (sampling.h) */
    struct lw_footprint_frame frame; /* of the tile's object */
    struct lw_footprint_lanes at;    /* where rays start; lanes that are not active repeat one that is */
};

static struct lw_vec3 origin_of(const struct packet *packet, uint32_t lane) {
    return lw_vec3(packet->at.x[lane], packet->at.y[lane], packet->at.z[lane]);
}

static struct lw_vec3 normal_of(const struct packet *packet, uint32_t lane) {
    return lw_vec3(packet->at.nx[lane], packet->at.ny[lane], packet->at.nz[lane]);
}

/* How many packets a tile's block has. */
static uint32_t packets_of(const struct lw_solve_tile *tile, uint32_t block) {
    return tile->packet_of_block[block + 1] - tile->packet_of_block[block];
}

/* Takes up packet `set` of a block, which are numbered row by row. Needs a frame. */
static void load_packet(const struct lw_solve_tile *tile, uint32_t block, uint32_t set,
                        struct packet *packet) {
    const struct lw_packet *from = &tile->packet[tile->packet_of_block[block] + set];
    const uint32_t columns = (tile->width + LW_TILE_BLOCK - 1) / LW_TILE_BLOCK, x = block % columns,
                   y = block / columns;
    packet->set = set;
    /* Numbered over the whole atlas, so that no two blocks of an object share a sequence. */
    packet->block = (tile->y * LW_TILE_BLOCKS + y) << 16 | (tile->x * LW_TILE_BLOCKS + x);
    packet->active = (uint16_t)((1u << from->count) - 1);
    for (uint32_t lane = 0; lane < LANES; lane++) {
        const uint32_t texel = from->texel[lane < from->count ? lane : 0];
        packet->lane_texel[lane] = (y * LW_TILE_BLOCK + texel / LW_TILE_BLOCK) * tile->width +
                                   x * LW_TILE_BLOCK + texel % LW_TILE_BLOCK;
    }
}

/* Whether a packet's normals agree so far that its rays run parallel enough. */
LW_WIDE static bool agree(const struct lw_footprint_lanes *at) {
    int32_t apart = 0;
    for (uint32_t lane = 0; lane < LANES; lane++)
        apart |=
            at->nx[0] * at->nx[lane] + at->ny[0] * at->ny[lane] + at->nz[0] * at->nz[lane] > COHERENT_COSINE
                ? 0
                : -1;
    return apart == 0;
}

/* What lw_footprint_choose() wants beside the number of the sample. */
static uint32_t turn_of(const struct lw_passes *p, const struct lw_solve_tile *tile,
                        const struct packet *packet, uint32_t sample) {
    return lw_random_hash4(p->seed ^ tile->object, packet->block, sample / LW_FOOTPRINT_PLACES,
                           LW_SAMPLING_FOOTPRINT << 8 | packet->set);
}

/* Sends for the places that place_packet() will read in a block: a line of memory each, and no two together. */
static void prefetch_places(const struct lw_passes *p, const struct lw_solve_tile *tile, uint32_t block,
                            uint32_t sample) {
    const struct lw_footprint *footprint = &tile->mesh->footprint;
    for (uint32_t set = 0; set < packets_of(tile, block); set++) {
        struct packet packet;
        load_packet(tile, block, set, &packet);
        const uint32_t turn = turn_of(p, tile, &packet, sample);
        for (uint32_t lane = 0; lane < LANES; lane++) {
            if (!(packet.active >> lane & 1)) continue;
            const uint32_t i = packet.lane_texel[lane];
            __builtin_prefetch(
                &footprint->place[footprint->first[tile->local + i] +
                                  lw_footprint_choose(p->texels->usable[tile->first + i], sample, turn)]);
        }
    }
}

/* Moves a packet's rays to the places of its texels that sample number `sample` takes. */
static void place_packet(const struct lw_passes *p, const struct lw_solve_tile *tile, struct packet *packet,
                         uint32_t sample) {
    const uint32_t turn = turn_of(p, tile, packet, sample);
    for (uint32_t lane = 0; lane < LANES; lane++) {
        const uint32_t i = packet->lane_texel[lane];
        const uint32_t place = lw_footprint_choose(p->texels->usable[tile->first + i], sample, turn);
        lw_footprint_load(&tile->mesh->footprint, tile->local + i, place,
                          lw_texels_vector(tile->mesh->position, tile->local + i), &packet->at, lane);
    }
    lw_footprint_to_world(&packet->frame, &packet->at);
    packet->coherent = agree(&packet->at);
}

/* The same direction about each lane's normal. */
LW_WIDE static void aim(const struct lw_footprint_lanes *restrict at, struct lw_vec3 local, float t_far,
                        struct lw_ray16 *restrict rays) {
    memcpy(rays->org_x, at->x, sizeof rays->org_x);
    memcpy(rays->org_y, at->y, sizeof rays->org_y);
    memcpy(rays->org_z, at->z, sizeof rays->org_z);
    for (uint32_t lane = 0; lane < LANES; lane++) {
        const struct lw_vec3 d = lw_direction_about(lw_vec3(at->nx[lane], at->ny[lane], at->nz[lane]), local);
        rays->dir_x[lane] = d.x;
        rays->dir_y[lane] = d.y;
        rays->dir_z[lane] = d.z;
        rays->t_near[lane] = 0;
        rays->t_far[lane] = t_far;
    }
}

/* Light samples for the lanes of a packet: traces their shadow rays and adds what arrives. */
struct shadow_batch {
    struct lw_ray16 rays;
    struct lw_vec3 arriving[LANES]; /* E if nothing is in the way */
    uint16_t active;
};

static void start_batch(struct shadow_batch *batch, uint16_t active, uint32_t sample) {
    batch->active = active;
    batch->rays.salt = sample;
}

/* cosine: of the sample's direction with the lane's normal */
static void add_light(struct shadow_batch *batch, const struct packet *packet, uint32_t lane,
                      const struct lw_light_sample *sample, float cosine, float weight) {
    struct lw_vec3 e = lw_vec3_scale(sample->irradiance_normal, cosine * weight);
    if (!(cosine > 0) || !(e.x + e.y + e.z > 0)) return;
    batch->arriving[lane] = e;
    /* Short of the lamp itself, which would be in its own way. */
    lw_trace_set_ray(&batch->rays, lane, origin_of(packet, lane), sample->direction,
                     sample->distance_m * 0.9999f);
    batch->active |= (uint16_t)(1u << lane);
}

static void add_sample(struct shadow_batch *batch, const struct packet *packet, uint32_t lane,
                       const struct lw_light_sample *sample, float weight) {
    add_light(batch, packet, lane, sample, lw_vec3_dot(normal_of(packet, lane), sample->direction), weight);
}

static void trace_batch(const struct lw_passes *p, const struct shadow_batch *batch, bool coherent,
                        struct lw_vec3 sum[LANES], struct lw_passes_count *count) {
    if (!batch->active) return;
    uint16_t occluded =
        lw_trace_occluded16(p->trace, coherent ? LW_TRACE_COHERENT : 0, batch->active, &batch->rays);
    uint16_t lit = batch->active & (uint16_t)~occluded;
    count->shadow += (uint64_t)__builtin_popcount(batch->active);
    for (uint32_t lane = 0; lane < LANES; lane++)
        if (lit >> lane & 1) sum[lane] = lw_vec3_add(sum[lane], batch->arriving[lane]);
}

/* Whether points and spots are so many that a few of them stand for all. */
static bool is_many(const struct lw_lights *lights) { return lights->near_count > LW_LIGHTS_EXACT_MAX; }

/* The middle of sixteen numbers' range, and half its length. */
LW_WIDE static float middle_of(const float v[LANES], float *out_half) {
    float low = v[0], high = v[0];
    for (uint32_t lane = 1; lane < LANES; lane++) {
        low = v[lane] < low ? v[lane] : low;
        high = v[lane] > high ? v[lane] : high;
    }
    *out_half = 0.5f * (high - low);
    return 0.5f * (high + low);
}

/* Where a packet's texels lie and face; lanes that are not active repeat one that is. */
LW_WIDE static struct lw_light_region region_of(const struct lw_footprint_lanes *at) {
    struct lw_vec3 half, normal = {0};
    const struct lw_vec3 centre =
        lw_vec3(middle_of(at->x, &half.x), middle_of(at->y, &half.y), middle_of(at->z, &half.z));
    for (uint32_t lane = 0; lane < LANES; lane++)
        normal = lw_vec3_add(normal, lw_vec3(at->nx[lane], at->ny[lane], at->nz[lane]));
    normal = lw_vec3_normalize(normal);
    float cosine = 1;
    for (uint32_t lane = 0; lane < LANES; lane++) {
        const float c = at->nx[lane] * normal.x + at->ny[lane] * normal.y + at->nz[lane] * normal.z;
        cosine = c < cosine ? c : cosine;
    }
    return (struct lw_light_region){centre, normal, lw_vec3_length(half), cosine};
}

/* One sample of a group of lights: of one light for the whole packet where the group is far, else each lane chooses. */
static void light_by_group(const struct lw_passes *p, const struct packet *packet,
                           const struct lw_light_region *region, uint32_t group, float pick,
                           const float point[2], struct shadow_batch *batch) {
    const struct lw_light_tree *tree = &p->lights->tree;
    const bool far = lw_light_tree_is_far(tree, group, region);
    float probability = 0;
    uint32_t light = UINT32_MAX;
    if (far) light = lw_light_tree_choose(tree, group, region, pick, &probability);
    for (uint32_t lane = 0; lane < LANES; lane++) {
        if (!(packet->active >> lane & 1)) continue;
        const struct lw_light_region here = {origin_of(packet, lane), normal_of(packet, lane), 0, 1};
        if (!far) light = lw_light_tree_choose(tree, group, &here, pick, &probability);
        if (light == UINT32_MAX) continue;
        const struct lw_light_sample sample = lw_lights_sample_near(p->lights, light, probability, point[0],
                                                                    point[1], here.centre_ws, here.normal_ws);
        add_sample(batch, packet, lane, &sample, 1.0f / (float)p->direct_samples);
    }
}

/* Emitters, and points and spots where they are many. */
static void light_by_groups(const struct lw_passes *p, const struct lw_solve_tile *tile,
                            struct packet *packet, struct lw_vec3 sum[LANES], struct lw_passes_count *count) {
    if (!p->lights->tree.count) return;
    const uint32_t seed = lw_sampling_seed(p->seed, tile->object, packet->block, LW_SAMPLING_EMITTER);
    const uint32_t pick_seed =
        lw_sampling_seed(p->seed, tile->object, packet->block, LW_SAMPLING_EMITTER_PICK);
    for (uint32_t s = 0; s < p->direct_samples; s++) {
        const uint32_t index = tile->frames * p->direct_samples + s;
        if (p->direct_samples > 1) place_packet(p, tile, packet, index);
        const struct lw_light_region region = region_of(&packet->at);
        uint32_t group[LW_LIGHTS_EXACT_MAX];
        const uint32_t groups = lw_lights_split(p->lights, &region, group);
        for (uint32_t g = 0; g < groups; g++) {
            float point[2], pick[2]; /* of a sequence of the group's own: most groups stay over the frames */
            lw_sampling_point(lw_random_hash2(seed, group[g]), index, packet->set, point);
            lw_sampling_point(lw_random_hash2(pick_seed, group[g]), index, packet->set, pick);
            struct shadow_batch batch;
            start_batch(&batch, 0, index);
            light_by_group(p, packet, &region, group[g], pick[0], point, &batch);
            trace_batch(p, &batch, packet->coherent, sum, count);
        }
    }
}

static void light_by_punctual(const struct lw_passes *p, const struct lw_solve_tile *tile,
                              const struct packet *packet, struct lw_vec3 sum[LANES],
                              struct lw_passes_count *count) {
    for (uint32_t l = 0; l < p->scene->light_count; l++) {
        if (is_many(p->lights) && p->scene->light[l].kind != LW_LIGHT_DIRECTIONAL) continue;
        float point[2];
        lw_sampling_point(lw_sampling_seed(p->seed, tile->object, packet->block, LW_SAMPLING_PUNCTUAL + l),
                          tile->frames, packet->set, point);
        /* The sun's is the same for all. */
        const bool sun = p->scene->light[l].kind == LW_LIGHT_DIRECTIONAL;
        struct lw_light_sample sample;
        if (sun) sample = lw_lights_sample_punctual(p->lights, l, point[0], point[1], lw_vec3(0, 0, 0));
        struct shadow_batch batch;
        start_batch(&batch, 0, tile->frames);
        for (uint32_t lane = 0; lane < LANES; lane++) {
            if (!(packet->active >> lane & 1)) continue;
            if (!sun)
                sample = lw_lights_sample_punctual(p->lights, l, point[0], point[1], origin_of(packet, lane));
            add_sample(&batch, packet, lane, &sample, 1);
        }
        trace_batch(p, &batch, packet->coherent, sum, count);
    }
}

static void light_by_sky(const struct lw_passes *p, const struct lw_solve_tile *tile, struct packet *packet,
                         struct lw_vec3 sum[LANES], struct lw_passes_count *count) {
    if (!(p->lights->sky_luminance > 0)) return;
    uint32_t seed = lw_sampling_seed(p->seed, tile->object, packet->block, LW_SAMPLING_SKY);
    for (uint32_t s = 0; s < p->direct_samples; s++) {
        if (p->direct_samples > 1) place_packet(p, tile, packet, tile->frames * p->direct_samples + s);
        float point[2];
        lw_sampling_point(seed, tile->frames * p->direct_samples + s, packet->set, point);
        const struct lw_sky_draw draw = lw_lights_draw_sky(p->lights, point[0], point[1]);
        struct shadow_batch batch;
        start_batch(&batch, 0, tile->frames * p->direct_samples + s);
        for (uint32_t lane = 0; lane < LANES; lane++) {
            if (!(packet->active >> lane & 1)) continue;
            float cosine;
            struct lw_light_sample sample =
                lw_lights_place_sky(p->lights, &draw, normal_of(packet, lane), &cosine);
            add_light(&batch, packet, lane, &sample, cosine, 1.0f / (float)p->direct_samples);
        }
        trace_batch(p, &batch, packet->coherent, sum, count);
    }
}

static void blend(float *const dst[3], uint32_t texel, struct lw_vec3 value, float weight) {
    /* One estimate beyond float's range would stay in the mean for good. */
    if (!lw_vec3_is_finite(value)) return;
    dst[0][texel] += (value.x - dst[0][texel]) * weight;
    dst[1][texel] += (value.y - dst[1][texel]) * weight;
    dst[2][texel] += (value.z - dst[2][texel]) * weight;
}

void lw_passes_direct(const struct lw_passes *p, struct lw_solve_tile *tile, float *cdf,
                      struct lw_passes_count *count) {
    (void)cdf; /* the light tree needs none */
    struct packet packet;
    lw_footprint_frame_init(&packet.frame, &p->pose->object_to_world[tile->object]);
    for (uint32_t block = 0; block < tile->block_count; block++) {
        prefetch_places(p, tile, block, tile->frames * p->direct_samples);
        for (uint32_t set = 0; set < packets_of(tile, block); set++) {
            struct lw_vec3 sum[LANES] = {0};
            load_packet(tile, block, set, &packet);
            place_packet(p, tile, &packet, tile->frames * p->direct_samples);
            light_by_punctual(p, tile, &packet, sum, count);
            light_by_groups(p, tile, &packet, sum, count);
            light_by_sky(p, tile, &packet, sum, count);
            for (uint32_t lane = 0; lane < LANES; lane++) {
                if (!(packet.active >> lane & 1)) continue;
                uint32_t texel = tile->first + packet.lane_texel[lane];
                blend(p->tiles->direct, texel, sum[lane], tile->weight_direct);
                p->tiles->estimate[texel] = lw_colour_luminance(sum[lane]);
            }
        }
    }
}

/* Where lane's ray ended, if it met something; not yet the texel that stands for it (read_sources). */
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

/* Ends of a packet's rays of finite range: what they hit, else what a probe knows, else what they hit further on. */
static void find_ends(const struct lw_passes *p, const struct lw_solve_tile *tile,
                      const struct packet *packet, struct lw_ray16 *rays, struct lw_hit16 *hits,
                      uint32_t out_end[LANES], struct lw_passes_count *count) {
    uint16_t unseen = 0;
    for (uint32_t lane = 0; lane < LANES; lane++) {
        if (!(packet->active >> lane & 1)) continue;
        out_end[lane] = end_of(p, hits, lane);
        if (hits->object[lane] != LW_TRACE_MISS || !p->probes) continue;
        const uint32_t random = lw_random_hash3(p->seed, tile->first + packet->lane_texel[lane],
                                                rays->salt ^ LW_SAMPLING_PROBE << 24);
        if (ask_probes(p, rays, lane, random, &out_end[lane])) continue;
        rays->t_near[lane] = rays->t_far[lane];
        rays->t_far[lane] = INFINITY;
        unseen |= (uint16_t)(1u << lane);
    }
    if (!unseen) return;
    lw_trace_closest16(p->trace, packet->coherent ? LW_TRACE_COHERENT : 0, unseen, rays, hits);
    for (uint32_t lane = 0; lane < LANES; lane++)
        if (unseen >> lane & 1) out_end[lane] = end_of(p, hits, lane);
    count->bounce += (uint64_t)__builtin_popcount(unseen);
}

/* Puts the texel that stands for it in the place of each that a ray of the tile has met. They lie anywhere in memory: here
 * the processor waits for many at a time, in the midst of tracing it would for each. */
static void read_sources(const struct lw_passes *p, const struct lw_solve_tile *tile) {
    const uint32_t n = p->indirect_samples;
    for (uint32_t i = tile->first; i < tile->first + tile->width * tile->height; i++) {
        if (!p->tiles->covered[i]) continue;
        for (uint32_t *end = p->end + (size_t)i * n; end < p->end + ((size_t)i + 1) * n; end++)
            if (!(*end & LW_END_PROBE)) *end = p->texels->source[*end];
    }
}
_Static_assert((LW_END_NOTHING & LW_END_PROBE) != 0 && LW_TEXEL_NONE == LW_END_NOTHING, "no texels either");

void lw_passes_trace_ends(const struct lw_passes *p, const struct lw_solve_tile *tile,
                          struct lw_passes_count *count) {
    struct packet packet;
    lw_footprint_frame_init(&packet.frame, &p->pose->object_to_world[tile->object]);
    for (uint32_t block = 0; block < tile->block_count; block++) {
        prefetch_places(p, tile, block, tile->frames * p->indirect_samples / PLACE_SHARE);
        for (uint32_t set = 0; set < packets_of(tile, block); set++) {
            load_packet(tile, block, set, &packet);
            uint32_t seed = lw_sampling_seed(p->seed, tile->object, packet.block, LW_SAMPLING_BOUNCE);
            for (uint32_t s = 0; s < p->indirect_samples; s++) {
                float point[2];
                if (s % PLACE_SHARE == 0)
                    place_packet(p, tile, &packet, (tile->frames * p->indirect_samples + s) / PLACE_SHARE);
                lw_sampling_point(seed, tile->frames * p->indirect_samples + s, set, point);
                struct lw_vec3 local = lw_direction_cosine(point);
                struct lw_ray16 rays;
                struct lw_hit16 hits;
                rays.salt = tile->frames * p->indirect_samples + s;
                aim(&packet.at, local, p->tracing_range_m, &rays);
                lw_trace_closest16(p->trace, packet.coherent ? LW_TRACE_COHERENT : 0, packet.active, &rays,
                                   &hits);
                uint32_t end[LANES];
                find_ends(p, tile, &packet, &rays, &hits, end, count);
                for (uint32_t lane = 0; lane < LANES; lane++)
                    if (packet.active >> lane & 1)
                        p->end[(size_t)(tile->first + packet.lane_texel[lane]) * p->indirect_samples + s] =
                            end[lane];
                count->bounce += (uint64_t)__builtin_popcount(packet.active);
            }
        }
    }
    read_sources(p, tile);
}

static struct lw_vec3 radiance_at(const struct lw_passes *p, uint32_t end, uint32_t bounce) {
    if (end == LW_END_NOTHING) return lw_vec3(0, 0, 0);
    if (end & LW_END_PROBE)
        return lw_probes_radiance(p->probes, bounce - 1, lw_end_probe(end), lw_end_direction(end));
    const float *l = p->tiles->radiance[bounce - 1] + (size_t)end * 4;
    return lw_vec3(l[0], l[1], l[2]);
}

void lw_passes_gather(const struct lw_passes *p, const struct lw_solve_tile *tile, uint32_t bounce) {
    const uint32_t n = p->indirect_samples;
    for (uint32_t i = 0; i < tile->width * tile->height; i++) {
        const uint32_t texel = tile->first + i;
        if (!p->tiles->covered[texel]) continue;
        const uint32_t *end = p->end + (size_t)texel * n;
        struct lw_vec3 sum = {0};
        for (uint32_t s = 0; s < n; s++) sum = lw_vec3_add(sum, radiance_at(p, end[s], bounce));
        struct lw_vec3 e = lw_vec3_scale(sum, LW_PI / (float)n);
        blend(p->tiles->order[bounce - 1], texel, e, tile->weight_indirect);
        p->tiles->estimate[texel] += lw_colour_luminance(e);
    }
}

void lw_passes_radiate(const struct lw_passes *p, const struct lw_solve_tile *tile, uint32_t bounce) {
    float *const *e = bounce == 0 ? p->tiles->direct : p->tiles->order[bounce - 1];
    float *const *albedo = tile->mesh->albedo;
    for (uint32_t i = 0; i < tile->width * tile->height; i++)
        for (int c = 0; c < 3; c++)
            p->tiles->radiance[bounce][(size_t)(tile->first + i) * 4 + (size_t)c] =
                e[c][tile->first + i] * albedo[c][tile->local + i] * (1 / LW_PI);
}

/* Running mean and spread of the frames' estimates (Welford 1962), forgetting as the sums do. */
static void note_estimate(struct lw_tiles *tiles, uint32_t texel, float weight) {
    float x = tiles->estimate[texel], off = x - tiles->mean[texel];
    tiles->mean[texel] += off * weight;
    tiles->spread[texel] = (1 - weight) * (tiles->spread[texel] + weight * off * off);
}

/* A tile that has seen no light yet: what light it may have missed falls with the samples that found none, as 1/N. A
 * scene that casts no light on it at all is found dark as soon as one that hides its light behind a pinhole could be. */
static float error_of_darkness(const struct lw_passes *p, const struct lw_solve_tile *tile) {
    uint32_t per_frame = p->direct_samples > p->indirect_samples ? p->direct_samples : p->indirect_samples;
    double samples = (double)tile->frames * per_frame * tile->covered_count;
    return (float)fmin(1.0, DARK_SAMPLES / fmax(1, samples));
}

void lw_passes_finish_tile(const struct lw_passes *p, struct lw_solve_tile *tile) {
    struct lw_tiles *tiles = p->tiles;
    double variance = 0, luminance = 0;
    for (uint32_t i = 0; i < tile->width * tile->height; i++) {
        const uint32_t texel = tile->first + i;
        if (!tiles->covered[texel]) continue;
        for (int c = 0; c < 3; c++) {
            float sum = 0;
            for (uint32_t k = 0; k < tiles->bounces; k++) sum += tiles->order[k][c][texel];
            tiles->indirect[c][texel] = sum;
            tiles->light[c][texel] = tiles->direct[c][texel] + sum;
        }
        note_estimate(tiles, texel, tile->weight_indirect);
        variance += (double)tiles->spread[texel];
        luminance += (double)tiles->mean[texel];
    }
    tile->frames++;
    if (tile->history < UINT32_MAX) tile->history++;
    /* spread is the variance of one estimate; the mean of h of them has 1/(h-1) of it (Bessel's correction in it). */
    uint32_t remembered = tile->history < tile->history_max ? tile->history : tile->history_max;
    tile->remembered = remembered;
    tile->error = 1;
    if (remembered >= 2 && tile->covered_count) {
        double mean = luminance / tile->covered_count;
        double mean_variance = variance / tile->covered_count / (remembered - 1);
        tile->error = mean > 0 ? (float)fmin(1.0, sqrt(mean_variance) / mean) : error_of_darkness(p, tile);
    }
}
