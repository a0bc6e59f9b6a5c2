#include "common/light/direct16.h"

#include "common/base/sampling.h"
#include "common/base/wide.h"
#include "common/light/lights16.h"

#include <string.h>

#define LANES LW_TRACE_WIDTH

static uint32_t seed_of(const struct lw_direct16 *d, uint32_t use) {
    return lw_sampling_seed(d->seed, d->object, d->block, use);
}

/* Short of the lamp itself, which would be in its own way. */
LW_WIDE static void aim(const struct lw_light_sample16 *restrict sample, struct lw_ray16 *restrict rays) {
    memcpy(rays->dir_x, sample->dir_x, sizeof rays->dir_x);
    memcpy(rays->dir_y, sample->dir_y, sizeof rays->dir_y);
    memcpy(rays->dir_z, sample->dir_z, sizeof rays->dir_z);
    for (int i = 0; i < LANES; i++) rays->t_far[i] = sample->distance_m[i] * LW_TRACE_SHORT;
}

LW_WIDE static void add_lit(uint16_t lit, const struct lw_light_sample16 *restrict sample, float weight,
                            float (*restrict sum)[LANES]) {
    for (int i = 0; i < LANES; i++) {
        const float w = lit >> i & 1 ? weight : 0;
        sum[0][i] += sample->e[0][i] * w;
        sum[1][i] += sample->e[1][i] * w;
        sum[2][i] += sample->e[2][i] * w;
    }
}

LW_WIDE static void add_moment(uint16_t lit, const struct lw_light_sample16 *restrict sample, float weight,
                               float (*restrict sum)[LANES]) {
    for (int i = 0; i < LANES; i++) {
        const float luminance =
            0.2126f * sample->e[0][i] + 0.7152f * sample->e[1][i] + 0.0722f * sample->e[2][i];
        const float w = lit >> i & 1 ? weight * luminance : 0;
        sum[0][i] += lit >> i & 1 ? sample->dir_x[i] * w : 0;
        sum[1][i] += lit >> i & 1 ? sample->dir_y[i] * w : 0;
        sum[2][i] += lit >> i & 1 ? sample->dir_z[i] * w : 0;
    }
}

static void add(struct lw_direct16 *d, uint16_t lit, const struct lw_light_sample16 *sample, float weight) {
    add_lit(lit, sample, weight, d->e);
    if (d->moment) add_moment(lit, sample, weight, d->moment);
}

/* Shadow rays through what colours light; its colours go into the sample. */
static uint16_t find_tinted(const struct lw_direct16 *d, uint16_t active, const struct lw_ray16 *rays,
                            const struct lw_light_sample16 *sample, struct lw_light_sample16 *tinted) {
    float tint[3][LANES];
    const uint16_t occluded =
        lw_trace_tinted16(d->trace, d->coherent ? LW_TRACE_COHERENT : LW_TRACE_LIGHT, active, rays, tint);
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < LANES; i++) tinted->e[c][i] = sample->e[c][i] * tint[c][i];
    return occluded;
}

/* Adds what arrives of a sample's light: a shadow ray for each lane that any could reach. */
static void add_visible(struct lw_direct16 *d, const struct lw_light_sample16 *sample, float weight) {
    struct lw_ray16 rays;
    const uint16_t active = lw_light_sample16_lit(sample) & d->active;
    if (!active) return;
    memcpy(rays.org_x, d->points->x, sizeof rays.org_x);
    memcpy(rays.org_y, d->points->y, sizeof rays.org_y);
    memcpy(rays.org_z, d->points->z, sizeof rays.org_z);
    memset(rays.t_near, 0, sizeof rays.t_near);
    aim(sample, &rays);
    rays.salt = d->salt;
    d->rays += (uint64_t)__builtin_popcount(active);
    if (lw_trace_tints(d->trace)) {
        struct lw_light_sample16 tinted = *sample;
        const uint16_t stopped = find_tinted(d, active, &rays, sample, &tinted);
        add(d, active & (uint16_t)~stopped, &tinted, weight);
        return;
    }
    const uint16_t occluded =
        lw_trace_occluded16(d->trace, d->coherent ? LW_TRACE_COHERENT : LW_TRACE_LIGHT, active, &rays);
    add(d, active & (uint16_t)~occluded, sample, weight);
}

/* Sixteen numbers as one, in halves: in a row each would wait for the one before. */
#define FOLD(name, of_two)                                                                                   \
    LW_WIDE_INLINE float name(const float v[LANES]) {                                                        \
        float half[LANES / 2];                                                                               \
        for (int i = 0; i < 8; i++) half[i] = of_two(v[i], v[i + 8]);                                        \
        for (int i = 0; i < 4; i++) half[i] = of_two(half[i], half[i + 4]);                                  \
        for (int i = 0; i < 2; i++) half[i] = of_two(half[i], half[i + 2]);                                  \
        return of_two(half[0], half[1]);                                                                     \
    }
#define LESS(a, b) ((a) < (b) ? (a) : (b))
#define MORE(a, b) ((a) > (b) ? (a) : (b))
#define PLUS(a, b) ((a) + (b))
FOLD(least_of, LESS)
FOLD(most_of, MORE)
FOLD(sum_of, PLUS)

/* Where the points lie and face. */
LW_WIDE static struct lw_light_region region_of(const struct lw_points16 *at) {
    const struct lw_vec3 low = lw_vec3(least_of(at->x), least_of(at->y), least_of(at->z)),
                         high = lw_vec3(most_of(at->x), most_of(at->y), most_of(at->z)),
                         normal = lw_vec3_normalize(lw_vec3(sum_of(at->nx), sum_of(at->ny), sum_of(at->nz)));
    float cosine[LANES];
    for (int i = 0; i < LANES; i++)
        cosine[i] = LESS(1, at->nx[i] * normal.x + at->ny[i] * normal.y + at->nz[i] * normal.z);
    return (struct lw_light_region){lw_vec3_scale(lw_vec3_add(low, high), 0.5f), normal,
                                    0.5f * lw_vec3_length(lw_vec3_sub(high, low)), least_of(cosine)};
}

/* The lanes that have chosen the same light as the first of `lanes`. */
static uint16_t alike(const uint32_t light[LANES], uint16_t lanes) {
    const uint32_t first = light[__builtin_ctz(lanes)];
    uint16_t same = 0;
    for (uint32_t lane = 0; lane < LANES; lane++) same |= (uint16_t)((light[lane] == first) << lane);
    return same & lanes;
}

/* Samples of a near group, of which each lane chooses a light. */
static void sample_near_group(const struct lw_direct16 *d, uint32_t group, float pick, const float point[2],
                              struct lw_light_sample16 *out) {
    const struct lw_lights *lights = d->lights;
    const struct lw_points16 *at = d->points;
    uint32_t light[LANES];
    float probability[LANES];
    uint16_t lanes = d->active;
    lw_light_tree_choose16(&lights->tree, group, at, pick, lanes, light, probability);
    while (lanes) {
        const uint16_t same = alike(light, lanes);
        const uint32_t chosen = light[__builtin_ctz(same)];
        if (chosen != UINT32_MAX)
            lw_lights_sample_near16(lights, chosen, probability, point[0], point[1], at, same, out);
        lanes &= (uint16_t)~same;
    }
}

/* The groups that light a packet. A far group has one light chosen for all of it. */
struct groups {
    struct lw_light_choice choice[LW_LIGHTS_EXACT_MAX];
    struct lw_light_group_sample sampled[LW_LIGHTS_EXACT_MAX]; /* the group of each choice */
    uint32_t count, far_count;                                 /* far ones are the first */
};

static void draw_groups(const struct lw_direct16 *d, uint32_t index, struct groups *groups) {
    const struct lw_light_tree *tree = &d->lights->tree;
    const uint32_t seed = seed_of(d, LW_SAMPLING_EMITTER_PICK);
    const struct lw_light_region region = region_of(d->points);
    struct lw_light_group_sample *sampled = groups->sampled;
    float pick[2];
    lw_sampling_point(seed, index, d->set, pick);
    groups->count = lw_lights_sample_groups(d->lights, &region, pick[0], sampled);
    groups->far_count = 0;
    for (uint32_t g = 0; g < groups->count; g++) {
        if (!lw_light_tree_is_far(tree, sampled[g].node, &region)) continue;
        const struct lw_light_group_sample far = sampled[g];
        sampled[g] = sampled[groups->far_count];
        sampled[groups->far_count++] = far;
    }
    for (uint32_t g = 0; g < groups->count; g++) {
        /* shifted by the group's own number: groups that are always sampled have one pick in common */
        const float shifted = sampled[g].pick + lw_random_unit(lw_random_hash2(seed, sampled[g].node));
        groups->choice[g] =
            (struct lw_light_choice){.group = sampled[g].node, .pick = shifted < 1 ? shifted : shifted - 1};
    }
    lw_light_tree_choose_each(tree, &region, groups->choice, groups->far_count);
}

void lw_direct16_groups(struct lw_direct16 *d, uint32_t sample, float weight) {
    if (!d->lights->tree.count) return;
    const uint32_t seed = seed_of(d, LW_SAMPLING_EMITTER);
    float point[2], probability[LANES];
    struct lw_light_sample16 light = {.e = {{0}}};
    struct groups groups;
    draw_groups(d, sample, &groups);
    for (uint32_t g = 0; g < groups.count; g++) {
        const struct lw_light_choice *c = &groups.choice[g];
        lw_sampling_point(lw_random_hash2(seed, groups.sampled[g].number), sample, d->set, point);
        if (g >= groups.far_count) {
            memset(light.e, 0, sizeof light.e);
            sample_near_group(d, c->group, c->pick, point, &light);
        } else if (c->light != UINT32_MAX) {
            for (uint32_t lane = 0; lane < LANES; lane++) probability[lane] = c->probability;
            lw_lights_sample_near16(d->lights, c->light, probability, point[0], point[1], d->points,
                                    d->active, &light);
        } else {
            continue; /* none of the group can give anything */
        }
        add_visible(d, &light, weight / groups.sampled[g].probability);
    }
}

/* Whether there are too many points and spots for a shadow ray each: a few of them stand for all. */
static bool is_many(const struct lw_lights *lights) { return lights->near_count > LW_LIGHTS_EXACT_MAX; }

void lw_direct16_punctual(struct lw_direct16 *d, uint32_t sample, float weight) {
    const struct lw_scene *scene = d->lights->scene;
    for (uint32_t l = 0; l < scene->light_count; l++) {
        if (!lw_lights_includes(d->lights, l)) continue;
        if (is_many(d->lights) && scene->light[l].kind != LW_LIGHT_DIRECTIONAL) continue;
        float point[2];
        struct lw_light_sample16 light;
        lw_sampling_point(seed_of(d, LW_SAMPLING_PUNCTUAL + l), sample, d->set, point);
        lw_lights_sample_punctual16(d->lights, l, point[0], point[1], d->points, &light);
        add_visible(d, &light, weight);
    }
}

void lw_direct16_sky(struct lw_direct16 *d, uint32_t sample, float weight) {
    if (!(d->lights->sky_luminance > 0)) return;
    float point[2];
    struct lw_light_sample16 light;
    lw_sampling_point(seed_of(d, LW_SAMPLING_SKY), sample, d->set, point);
    struct lw_sky_sample sky[LANES];
    for (uint32_t lane = 0; lane < LANES; lane++) {
        float own[2];
        lw_sampling_spread(point, lane, own);
        sky[lane] = lw_lights_sample_sky(d->lights, own[0], own[1]);
    }
    lw_lights_place_sky16(d->lights, sky, d->points, &light);
    add_visible(d, &light, weight);
}
