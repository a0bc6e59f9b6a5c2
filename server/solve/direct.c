#include "server/solve/direct.h"

#include "common/light/lights16.h"
#include "common/wide.h"
#include "server/solve/sampling.h"

#include <string.h>

#define LANES LW_TRACE_WIDTH

/* A packet at work. */
struct work {
    const struct lw_passes *passes;
    const struct lw_solve_tile *tile;
    struct lw_launch *launch;
    struct lw_launch_site *site;
    float (*sum)[LANES];
    struct lw_passes_count *count;
};

/* Number of a sample in the block's sequence. */
static uint32_t number_of(const struct work *w, uint32_t s) {
    return w->launch->frames * w->passes->direct_samples + s;
}

static uint32_t seed_of(const struct work *w, uint32_t use) {
    return lw_sampling_seed(w->passes->seed, w->tile->object, w->launch->block, use);
}

/* Where the frame's sample s starts. */
static void move_to(const struct work *w, uint32_t s) {
    if (w->passes->direct_samples == 1) return; /* there already */
    lw_launch_choose(w->launch, w->tile, w->passes->texels->usable, w->passes->seed, number_of(w, s));
    lw_launch_place(w->launch, w->tile, w->site);
}

/* Short of the lamp itself, which would be in its own way. */
LW_WIDE static void aim(const struct lw_light_sample16 *restrict sample, struct lw_ray16 *restrict rays) {
    memcpy(rays->dir_x, sample->dir_x, sizeof rays->dir_x);
    memcpy(rays->dir_y, sample->dir_y, sizeof rays->dir_y);
    memcpy(rays->dir_z, sample->dir_z, sizeof rays->dir_z);
    for (int i = 0; i < LANES; i++) rays->t_far[i] = sample->distance_m[i] * 0.9999f;
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

/* Adds what arrives of a sample's light: a shadow ray for each lane that any could reach. */
static void add_visible(const struct work *w, const struct lw_light_sample16 *sample, uint32_t salt,
                        float weight) {
    struct lw_ray16 rays;
    const uint16_t active = lw_light_sample16_lit(sample) & w->launch->active;
    if (!active) return;
    lw_launch_start(w->site, &rays);
    aim(sample, &rays);
    rays.salt = salt;
    const uint16_t occluded = lw_trace_occluded16(
        w->passes->trace, w->site->coherent ? LW_TRACE_COHERENT : LW_TRACE_LIGHT, active, &rays);
    w->count->shadow += (uint64_t)__builtin_popcount(active);
    add_lit(active & (uint16_t)~occluded, sample, weight, w->sum);
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

/* Where a packet's texels lie and face. */
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
static void sample_near_group(const struct work *w, uint32_t group, float pick, const float point[2],
                              struct lw_light_sample16 *out) {
    const struct lw_lights *lights = w->passes->lights;
    const struct lw_points16 *at = &w->site->lanes.at;
    uint32_t light[LANES];
    float probability[LANES];
    uint16_t lanes = w->launch->active;
    lw_light_tree_choose16(&lights->tree, group, at, pick, lanes, light, probability);
    while (lanes) {
        const uint16_t same = alike(light, lanes);
        const uint32_t chosen = light[__builtin_ctz(same)];
        if (chosen != UINT32_MAX)
            lw_lights_sample_near16(lights, chosen, probability, point[0], point[1], at, same, out);
        lanes &= (uint16_t)~same;
    }
}

/* The groups that light a packet. Of those that are far one light is chosen for all of it. */
struct cut {
    struct lw_light_choice far[LW_LIGHTS_EXACT_MAX], near[LW_LIGHTS_EXACT_MAX];
    uint32_t far_count, near_count;
};

static void cut_tree(const struct work *w, uint32_t index, struct cut *cut) {
    const struct lw_lights *lights = w->passes->lights;
    const uint32_t seed = seed_of(w, LW_SAMPLING_EMITTER_PICK);
    const struct lw_light_region region = region_of(&w->site->lanes.at);
    uint32_t group[LW_LIGHTS_EXACT_MAX];
    const uint32_t count = lw_lights_split(lights, &region, group);
    cut->far_count = cut->near_count = 0;
    for (uint32_t g = 0; g < count; g++) {
        float pick[2]; /* of a sequence of the group's own: most groups stay over the frames */
        lw_sampling_point(lw_random_hash2(seed, group[g]), index, w->launch->set, pick);
        const bool far = lw_light_tree_is_far(&lights->tree, group[g], &region);
        *(far ? &cut->far[cut->far_count++] : &cut->near[cut->near_count++]) =
            (struct lw_light_choice){.group = group[g], .pick = pick[0]};
    }
    lw_light_tree_choose_each(&lights->tree, &region, cut->far, cut->far_count);
}

/* Emitters, and points and spots where they are many. */
static void light_by_groups(const struct work *w) {
    const struct lw_passes *p = w->passes;
    if (!p->lights->tree.count) return;
    const uint32_t seed = seed_of(w, LW_SAMPLING_EMITTER);
    const float weight = 1.0f / (float)p->direct_samples;
    for (uint32_t s = 0; s < p->direct_samples; s++) {
        const uint32_t index = number_of(w, s), set = w->launch->set;
        float point[2], probability[LANES];
        struct lw_light_sample16 sample = {.e = {{0}}};
        struct cut cut;
        move_to(w, s);
        cut_tree(w, index, &cut);
        for (const struct lw_light_choice *c = cut.far; c < cut.far + cut.far_count; c++) {
            if (c->light == UINT32_MAX) continue;
            lw_sampling_point(lw_random_hash2(seed, c->group), index, set, point);
            for (uint32_t lane = 0; lane < LANES; lane++) probability[lane] = c->probability;
            lw_lights_sample_near16(p->lights, c->light, probability, point[0], point[1], &w->site->lanes.at,
                                    w->launch->active, &sample);
            add_visible(w, &sample, index, weight);
        }
        for (const struct lw_light_choice *c = cut.near; c < cut.near + cut.near_count; c++) {
            memset(sample.e, 0, sizeof sample.e);
            lw_sampling_point(lw_random_hash2(seed, c->group), index, set, point);
            sample_near_group(w, c->group, c->pick, point, &sample);
            add_visible(w, &sample, index, weight);
        }
    }
}

/* Whether points and spots are so many that a few of them stand for all. */
static bool is_many(const struct lw_lights *lights) { return lights->near_count > LW_LIGHTS_EXACT_MAX; }

static void light_by_punctual(const struct work *w) {
    const struct lw_passes *p = w->passes;
    for (uint32_t l = 0; l < p->scene->light_count; l++) {
        if (is_many(p->lights) && p->scene->light[l].kind != LW_LIGHT_DIRECTIONAL) continue;
        float point[2];
        struct lw_light_sample16 sample;
        lw_sampling_point(seed_of(w, LW_SAMPLING_PUNCTUAL + l), w->launch->frames, w->launch->set, point);
        lw_lights_sample_punctual16(p->lights, l, point[0], point[1], &w->site->lanes.at, &sample);
        add_visible(w, &sample, w->launch->frames, 1);
    }
}

static void light_by_sky(const struct work *w) {
    const struct lw_passes *p = w->passes;
    if (!(p->lights->sky_luminance > 0)) return;
    const uint32_t seed = seed_of(w, LW_SAMPLING_SKY);
    for (uint32_t s = 0; s < p->direct_samples; s++) {
        float point[2];
        struct lw_light_sample16 sample;
        move_to(w, s);
        lw_sampling_point(seed, number_of(w, s), w->launch->set, point);
        const struct lw_sky_draw draw = lw_lights_draw_sky(p->lights, point[0], point[1]);
        lw_lights_place_sky16(p->lights, &draw, &w->site->lanes.at, &sample);
        add_visible(w, &sample, number_of(w, s), 1.0f / (float)p->direct_samples);
    }
}

void lw_direct_light(const struct lw_passes *passes, const struct lw_solve_tile *tile,
                     struct lw_launch *launch, struct lw_launch_site *site, float out_e[3][LANES],
                     struct lw_passes_count *count) {
    const struct work w = {passes, tile, launch, site, out_e, count};
    memset(out_e, 0, 3 * sizeof *out_e);
    lw_launch_place(launch, tile, site);
    light_by_punctual(&w);
    light_by_groups(&w);
    light_by_sky(&w);
}
