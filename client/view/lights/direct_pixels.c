#include "client/view/lights/direct_pixels.h"

#include "client/view/lights/emitter_clusters.h"
#include "common/base/colour.h"
#include "common/base/sampling.h"
#include "common/base/wide.h"
#include "common/light/lights16.h"

#include <float.h>
#include <stdlib.h>
#include <string.h>

#define LANES  LW_TRACE_WIDTH
#define BLOCKS LW_DIRECT_PIXELS_BLOCKS
#define SIDE   (4u * LW_DIRECT_PIXELS_SIDE) /* pixels of a tile */
#define KEPT   LW_DIRECT_PIXELS_LIGHTS_MAX

/* A pixel takes one shadow ray. It takes FEW or SOME where its neighbours' rays differ, and SAMPLES in a
 * penumbra that is too narrow for a mean over neighbours. */
#define FEW     2u
#define SOME    4u
#define SAMPLES 8u
/* Shares of the light at hand in all light that a pixel has by then. From SHARE_SEEN on a pixel has rays of
 * its own, from SHARE_NOISY on up to SAMPLES of them. */
#define SHARE_FAINT 0.005f /* from here on 2 x 2 pixels have one ray */
#define SHARE_SEEN  0.02f
#define SHARE_NOISY 0.06f
/* A block counts as one point for lights that are farther than this many of its radii. */
#define EVEN_RADII 8.0f
/* Sequences of random numbers that blocks choose from. */
#define VARIANTS 8u

/* Lights that may give less than this share of the tile's light together have no shadow ray. */
#define TAIL_MIN 1e-3f
/* A light that gives less than this share of a block's has a ray there by chance, and counts more then. */
#define SHARE_CHANCE 1e-3f

/* Half the side of the window over which a wide penumbra is averaged, at most, pixels. */
#define WINDOW 3

/* What draws a light. */
enum kind { KIND_SUN, KIND_NEAR, KIND_CLUSTER };

/* All lights, structure of arrays, for the choice of those that count. */
struct candidates {
    uint32_t count;
    float *x, *y, *z; /* m */
    float *radius_m;
    float *intensity; /* luminance, W/sr, the most in any direction; suns: W/m^2 */
    float *axis_x, *axis_y, *axis_z, *cos_reach, *sin_reach; /* a spot's; cos_reach -1: all around */
    uint32_t *index;                                         /* the scene's light or the cluster */
    uint8_t *kind;
};

struct box {
    struct lw_vec3 low, high;
};

struct lw_direct_pixels {
    struct lw_direct_pixels_desc desc;
    struct lw_client_lights drawn; /* desc.drawn, by value: its owner may move */
    struct lw_lights lights;
    struct lw_emitter_clusters clusters;
    bool ready; /* lights and clusters are there */
    bool fresh; /* the latter have not been placed yet */
    struct candidates candidates;
    float *memory;           /* holds the candidates' numbers */
    uint32_t capacity;       /* in candidates */
    struct lw_affine *place; /* per object: where its emitters were at the last picture */
    bool *hidden;
    struct box *box;      /* per mesh, object space */
    bool *dirty;          /* per cluster: it has to be placed again */
    float (*emission)[3]; /* per material */
    bool blends;          /* there are surfaces that let part of the light pass */
    float white;
    float point[VARIANTS][SAMPLES][LANES][2];
    struct lw_vec3 (*sun)[VARIANTS][SAMPLES][LANES]; /* directions; one per candidate that is a sun */
    uint32_t seed;
};

/* ---- setting up ---- */

static bool has_blend(const struct lw_scene *scene) {
    for (uint32_t m = 0; m < scene->material_count; m++)
        if (scene->material[m].alpha_mode == LW_ALPHA_BLEND) return true;
    return false;
}

static void note_materials(struct lw_direct_pixels *d) {
    for (uint32_t m = 0; m < d->desc.scene->material_count; m++)
        memcpy(d->emission[m], d->desc.scene->material[m].emission, sizeof d->emission[m]);
}

static bool materials_differ(const struct lw_direct_pixels *d) {
    for (uint32_t m = 0; m < d->desc.scene->material_count; m++)
        if (d->desc.drawn->material[m] &&
            memcmp(d->emission[m], d->desc.scene->material[m].emission, sizeof d->emission[m]) != 0)
            return true;
    return false;
}

static struct lw_vec3 least(struct lw_vec3 a, struct lw_vec3 b) {
    return lw_vec3(fminf(a.x, b.x), fminf(a.y, b.y), fminf(a.z, b.z));
}
static struct lw_vec3 most(struct lw_vec3 a, struct lw_vec3 b) {
    return lw_vec3(fmaxf(a.x, b.x), fmaxf(a.y, b.y), fmaxf(a.z, b.z));
}

static struct box mesh_box(const struct lw_mesh *mesh) {
    struct box box = {mesh->position[0], mesh->position[0]};
    for (uint32_t v = 1; v < mesh->vertex_count; v++)
        box = (struct box){least(box.low, mesh->position[v]), most(box.high, mesh->position[v])};
    return box;
}

/* Whether a mesh at a place may come within a distance of a point. */
static bool is_close(const struct box *box, const struct lw_affine *to_world, struct lw_vec3 point, float m) {
    struct lw_vec3 low = {INFINITY, INFINITY, INFINITY}, high = {-INFINITY, -INFINITY, -INFINITY};
    for (int k = 0; k < 8; k++) {
        const struct lw_vec3 corner = lw_affine_point(to_world, lw_vec3(k & 1 ? box->high.x : box->low.x,
                                                                        k & 2 ? box->high.y : box->low.y,
                                                                        k & 4 ? box->high.z : box->low.z));
        low = least(low, corner), high = most(high, corner);
    }
    return point.x >= low.x - m && point.y >= low.y - m && point.z >= low.z - m && point.x <= high.x + m &&
           point.y <= high.y + m && point.z <= high.z + m;
}

/* Marks the clusters that an object was or is part of, or close to. */
static void mark_close(struct lw_direct_pixels *d, uint32_t object, const struct lw_affine *now) {
    const struct box *box = &d->box[d->desc.scene->object[object].mesh];
    for (uint32_t i = 0; i < d->clusters.count; i++) {
        const struct lw_emitter_cluster *c = &d->clusters.cluster[i];
        const uint32_t own = d->lights.emitter[d->clusters.side[c->first].emitter].object;
        if (d->dirty[i] || (own != object && !is_close(box, &d->place[object], c->centre, c->reach_m) &&
                            !is_close(box, now, c->centre, c->reach_m)))
            continue;
        d->dirty[i] = true;
    }
}

/* Notes where objects are, and places the clusters again for which that matters. */
static void update_places(struct lw_direct_pixels *d, const struct lw_pose *pose, bool all) {
    bool moved = all;
    for (uint32_t i = 0; i < d->clusters.count; i++) d->dirty[i] = all;
    for (uint32_t o = 0; o < d->desc.scene->object_count; o++) {
        const struct lw_affine *now = &pose->object_to_world[o];
        if (pose->object_hidden[o] == d->hidden[o] && memcmp(&d->place[o], now, sizeof *now) == 0) continue;
        if (!all) mark_close(d, o, now);
        d->place[o] = *now;
        d->hidden[o] = pose->object_hidden[o];
        moved = true;
    }
    if (!moved) return;
    lw_lights_set_pose(&d->lights, pose);
#pragma omp parallel for schedule(dynamic) num_threads(d->desc.threads)
    for (uint32_t i = 0; i < d->clusters.count; i++)
        if (d->dirty[i]) lw_emitter_clusters_place(&d->clusters, i, d->desc.trace);
}

static bool allocate_candidates(struct lw_direct_pixels *d) {
    struct candidates *c = &d->candidates;
    enum { PLANES = 10 };
    const size_t count = (size_t)d->desc.scene->light_count + d->clusters.count + LANES;
    if (count <= d->capacity) return true;
    free(d->memory), free(c->index), free(c->kind);
    d->capacity = 0;
    d->memory = calloc(count * PLANES, sizeof *d->memory);
    c->index = calloc(count, sizeof *c->index);
    c->kind = calloc(count, sizeof *c->kind);
    if (!d->memory || !c->index || !c->kind) return false;
    d->capacity = (uint32_t)count;
    float **plane[PLANES] = {&c->x,      &c->y,      &c->z,      &c->radius_m,  &c->intensity,
                             &c->axis_x, &c->axis_y, &c->axis_z, &c->cos_reach, &c->sin_reach};
    for (size_t k = 0; k < PLANES; k++) *plane[k] = d->memory + k * count;
    return true;
}

static bool build(struct lw_direct_pixels *d, const struct lw_pose *pose) {
    lw_emitter_clusters_finish(&d->clusters);
    lw_lights_finish(&d->lights);
    const struct lw_lights_part part = lw_client_lights_part(d->desc.drawn, true);
    d->ready = lw_lights_init_part(&d->lights, d->desc.scene, pose, &part) == LW_OK &&
               lw_emitter_clusters_init(&d->clusters, &d->lights) == LW_OK && allocate_candidates(d);
    free(d->dirty);
    d->dirty = calloc(d->clusters.count + 1ul, sizeof *d->dirty);
    d->ready = d->ready && d->dirty;
    if (!d->ready) d->candidates.count = 0;
    note_materials(d);
    d->fresh = true;
    return d->ready;
}

enum lw_status lw_direct_pixels_create(const struct lw_direct_pixels_desc *desc, const struct lw_pose *pose,
                                       struct lw_direct_pixels **out_direct, struct lw_error *err) {
    const struct lw_scene *scene = desc->scene;
    struct lw_direct_pixels *d = calloc(1, sizeof *d);
    if (d) {
        size_t suns = 0;
        for (uint32_t l = 0; l < scene->light_count; l++)
            suns += desc->drawn->light[l] && scene->light[l].kind == LW_LIGHT_DIRECTIONAL;
        d->desc = *desc;
        d->drawn = *desc->drawn;
        d->desc.drawn = &d->drawn;
        d->blends = has_blend(scene);
        d->place = calloc(scene->object_count + 1ul, sizeof *d->place);
        d->hidden = calloc(scene->object_count + 1ul, sizeof *d->hidden);
        d->box = calloc(scene->mesh_count + 1ul, sizeof *d->box);
        d->emission = calloc(scene->material_count + 1ul, sizeof *d->emission);
        d->sun = calloc(suns + 1, sizeof *d->sun);
        for (uint32_t m = 0; d->box && m < scene->mesh_count; m++) d->box[m] = mesh_box(&scene->mesh[m]);
        if (d->place && d->hidden && d->box && d->emission && d->sun && build(d, pose)) {
            *out_direct = d;
            return LW_OK;
        }
    }
    lw_direct_pixels_destroy(d);
    return lw_status_fail(err, LW_NO_MEMORY, "no memory for the lights of the view");
}

void lw_direct_pixels_destroy(struct lw_direct_pixels *d) {
    if (!d) return;
    lw_emitter_clusters_finish(&d->clusters);
    lw_lights_finish(&d->lights);
    free(d->candidates.kind);
    free(d->candidates.index);
    free(d->memory);
    free(d->sun);
    free(d->emission);
    free(d->dirty);
    free(d->box);
    free(d->hidden);
    free(d->place);
    free(d);
}

/* ---- a picture ---- */

static void add_candidate(struct candidates *c, enum kind kind, uint32_t index, struct lw_vec3 centre,
                          float radius_m, float intensity) {
    if (!(intensity > 0 && intensity < INFINITY) || !lw_vec3_is_finite(centre)) return;
    const uint32_t i = c->count++;
    c->x[i] = centre.x, c->y[i] = centre.y, c->z[i] = centre.z;
    c->radius_m[i] = radius_m;
    c->intensity[i] = intensity;
    c->axis_x[i] = c->axis_y[i] = c->axis_z[i] = 0;
    c->cos_reach[i] = -1;
    c->sin_reach[i] = 0;
    c->index[i] = index;
    c->kind[i] = (uint8_t)kind;
}

static void aim_spot(struct candidates *c, const struct lw_light *light, struct lw_vec3 direction) {
    const uint32_t i = c->count - 1;
    c->axis_x[i] = direction.x, c->axis_y[i] = direction.y, c->axis_z[i] = direction.z;
    c->cos_reach[i] = cosf(light->outer_cone);
    c->sin_reach[i] = sinf(light->outer_cone);
}

static void aim_sun(struct lw_direct_pixels *d, uint32_t sun, uint32_t light) {
    for (uint32_t v = 0; v < VARIANTS; v++)
        for (uint32_t k = 0; k < SAMPLES; k++)
            for (uint32_t i = 0; i < LANES; i++)
                d->sun[sun][v][k][i] = lw_lights_sample_punctual(&d->lights, light, d->point[v][k][i][0],
                                                                 d->point[v][k][i][1], lw_vec3(0, 0, 0))
                                           .direction;
}

/* Suns come first: their candidate's number is that of their directions. */
static void list_candidates(struct lw_direct_pixels *d, const struct lw_pose *pose) {
    const struct lw_scene *scene = d->desc.scene;
    struct candidates *c = &d->candidates;
    c->count = 0;
    for (int suns = 1; suns >= 0; suns--) {
        for (uint32_t l = 0; l < scene->light_count; l++) {
            const struct lw_light *light = &scene->light[l];
            const struct lw_light_state *state = &pose->light[l];
            const bool is_sun = light->kind == LW_LIGHT_DIRECTIONAL;
            if (!d->desc.drawn->light[l] || is_sun != (suns == 1)) continue;
            const uint32_t before = c->count;
            add_candidate(c, is_sun ? KIND_SUN : KIND_NEAR, l, is_sun ? lw_vec3(0, 0, 0) : state->position_ws,
                          0, lw_colour_luminance(state->intensity));
            if (c->count == before) continue;
            if (is_sun) aim_sun(d, before, l);
            if (light->kind == LW_LIGHT_SPOT) aim_spot(c, light, state->direction_ws);
        }
    }
    for (uint32_t i = 0; i < d->clusters.count; i++) {
        const struct lw_emitter_cluster *cluster = &d->clusters.cluster[i];
        add_candidate(c, KIND_CLUSTER, i, cluster->centre, cluster->radius_m, cluster->intensity);
    }
}

void lw_direct_pixels_begin(struct lw_direct_pixels *d, const struct lw_pose *pose, float white,
                            uint32_t sample) {
    d->white = white > 0 && white < INFINITY ? white : 0;
    d->seed = lw_random_hash2(sample, 0x5eed);
    for (uint32_t v = 0; v < VARIANTS; v++)
        for (uint32_t k = 0; k < SAMPLES; k++)
            for (uint32_t i = 0; i < LANES; i++)
                lw_sampling_point(lw_random_hash2(d->seed, v), k, i, d->point[v][k][i]);
    if (materials_differ(d) || !d->ready) build(d, pose);
    if (!d->ready) return;
    update_places(d, pose, d->fresh);
    d->fresh = false;
    d->lights.punctual = pose->light;
    list_candidates(d, pose);
}

/* ---- a tile ---- */

struct chosen {
    uint32_t candidate;
    float bound; /* upper bound of its E within the tile */
};

/* Blocks of a tile, each as one point. */
struct summary {
    struct lw_points16 middle[BLOCKS / LANES]; /* mean points and normals; any finite ones of empty blocks */
    float radius_m[BLOCKS];                    /* how far points lie from the middle, at most */
    float spread[BLOCKS];                      /* how far normals differ from the mean, at most */
    float found[BLOCKS];                       /* E so far, luminance, mean */
    float filled[BLOCKS];                      /* 0: no point is active; else 1 */
};

/* A light at the blocks of a tile; luminance, W/m^2. */
struct outlook {
    float full[BLOCKS];     /* E at the middle of what faces the light */
    float expected[BLOCKS]; /* E at the middle */
    float most[BLOCKS];     /* E anywhere in the block, as far as the middle tells */
    float near[BLOCKS];     /* distance over the block's radius */
};

/* Pixels of a tile are numbered block by block: 16 block + lane. */
struct lw_direct_work {
    float e[BLOCKS][LANES];  /* E of the light at hand without shadows, over its colour */
    uint16_t facing[BLOCKS]; /* bit i: e > 0 */
    /* bit i: e is at least SHARE_FAINT, SHARE_SEEN, SHARE_NOISY of all */
    uint16_t faint[BLOCKS], seen[BLOCKS], noisy[BLOCKS];
    /* blocks with a finish: what pixels mirror of the light at hand's e, lw_gloss_lamp16() */
    float dv[BLOCKS][LANES], rim[BLOCKS][LANES];
    uint16_t reached[BLOCKS];                           /* blocks with a finish: bit i: e > 0 */
    uint16_t flat[BLOCKS];                              /* bit i: pixel i belongs to a quad on one surface */
    bool finished;                                      /* some pixels of the tile have a finish */
    bool whole[BLOCKS];                                 /* the block lies on one flat piece of surface */
    uint8_t lit[BLOCKS * LANES], taken[BLOCKS * LANES]; /* shadow rays */
    float share[BLOCKS * LANES];
    uint8_t state[BLOCKS];                  /* what rays of the block have found: LIT, DARK */
    uint32_t lit_row[SIDE], dark_row[SIDE]; /* bit x: a ray of that pixel has found light, shadow */
    float
        part[BLOCKS]
            [LW_EMITTER_CLUSTERS_POINTS]; /* lw_emitter_clusters_share() of blocks, or of all in the first */
    uint32_t shared[BLOCKS];              /* the number of the job that has filled it */
    uint32_t jobs;
    struct lw_ray16 rays;
    uint16_t pixel[LANES]; /* the rays' pixels */
    uint32_t waiting;
    struct summary summary;
    struct outlook outlook[KEPT]; /* as in work->order */
    float weak[3][BLOCKS];        /* E of weak lights, W/m^2 */
    float *bound;                 /* per candidate */
    struct chosen *order;
    uint32_t bound_capacity;
};

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

struct region {
    struct lw_vec3 low, high, middle;
    float radius_m;
};

static bool find_region(const struct lw_direct_tile *tile, struct region *out) {
    struct lw_vec3 low = {INFINITY, INFINITY, INFINITY}, high = {-INFINITY, -INFINITY, -INFINITY};
    bool any = false;
    for (uint32_t b = 0; b < BLOCKS; b++) {
        const struct lw_direct_block *block = &tile->block[b];
        for (uint32_t i = 0; block->active && i < LANES; i++) {
            if (!(block->active >> i & 1u)) continue;
            const float x = block->points.x[i], y = block->points.y[i], z = block->points.z[i];
            low = lw_vec3(x < low.x ? x : low.x, y < low.y ? y : low.y, z < low.z ? z : low.z);
            high = lw_vec3(x > high.x ? x : high.x, y > high.y ? y : high.y, z > high.z ? z : high.z);
            any = true;
        }
    }
    out->low = low, out->high = high;
    out->middle = lw_vec3_scale(lw_vec3_add(low, high), 0.5f);
    out->radius_m = 0.5f * lw_vec3_length(lw_vec3_sub(high, low));
    return any;
}

/* The most that each candidate may give within a region; and what the near ones give there, roughly,
 * together. */
LW_WIDE static void bound_all(const struct candidates *restrict c, uint32_t first, uint32_t count,
                              struct region at, float *restrict bound, float *restrict typical) {
    for (uint32_t i = first; i < count; i++) {
        const float dx = c->x[i] - at.middle.x, dy = c->y[i] - at.middle.y, dz = c->z[i] - at.middle.z;
        const float bx = fmaxf(0, fmaxf(at.low.x - c->x[i], c->x[i] - at.high.x)),
                    by = fmaxf(0, fmaxf(at.low.y - c->y[i], c->y[i] - at.high.y)),
                    bz = fmaxf(0, fmaxf(at.low.z - c->z[i], c->z[i] - at.high.z));
        const float d2 = dx * dx + dy * dy + dz * dz, apart = sqrtf(bx * bx + by * by + bz * bz);
        const float beyond = apart - c->radius_m[i],
                    nearest = beyond > c->radius_m[i] ? beyond : c->radius_m[i];
        const float near2 = nearest * nearest > 1e-4f ? nearest * nearest : 1e-4f;
        /* a spot: whether the region's ball lies off its cone. Along the axis and aside: */
        const float along = -(dx * c->axis_x[i] + dy * c->axis_y[i] + dz * c->axis_z[i]),
                    aside2 = d2 - along * along, aside = sqrtf(aside2 > 0 ? aside2 : 0);
        const bool outside = aside * c->cos_reach[i] - along * c->sin_reach[i] > at.radius_m;
        const bool none = outside & (c->cos_reach[i] > -1);
        bound[i] = none ? 0 : c->intensity[i] / near2;
        typical[i] = none ? 0 : c->intensity[i] / (d2 + at.radius_m * at.radius_m + near2);
    }
}

static int by_bound(const void *left, const void *right) {
    const struct chosen *a = left, *b = right;
    if (a->bound != b->bound) return a->bound > b->bound ? -1 : 1;
    return a->candidate < b->candidate ? -1 : a->candidate > b->candidate;
}

/* The lights that may count, those first that may give most; behind the first KEPT those that share a ray. */
struct choice {
    uint32_t kept, count; /* lengths in work->order; lights from `kept` on share a ray */
    float rest;           /* sum of their bounds */
};

static struct choice choose(const struct lw_direct_pixels *d, struct lw_direct_work *w,
                            const struct region *region) {
    const struct candidates *c = &d->candidates;
    struct choice choice = {0};
    if (w->bound_capacity < c->count) {
        free(w->bound), free(w->order);
        w->bound = malloc(2ul * c->count * sizeof *w->bound);
        w->order = malloc(c->count * sizeof *w->order);
        w->bound_capacity = w->bound && w->order ? c->count : 0;
        if (!w->bound_capacity) return choice;
    }
    float *typical = w->bound + c->count, white = d->white, tail = 0;
    uint32_t suns = 0;
    while (suns < c->count && c->kind[suns] == KIND_SUN) w->bound[suns] = c->intensity[suns], suns++;
    bound_all(c, suns, c->count, *region, w->bound, typical);
    for (uint32_t i = suns; i < c->count; i++) white += typical[i];
    for (uint32_t i = 0; i < c->count; i++)
        if (w->bound[i] > 0) w->order[choice.count++] = (struct chosen){i, w->bound[i]};
    qsort(w->order, choice.count, sizeof *w->order, by_bound);
    while (choice.count > 0 && tail + w->order[choice.count - 1].bound <= TAIL_MIN * white)
        tail += w->order[--choice.count].bound;
    choice.kept = choice.count < KEPT ? choice.count : KEPT;
    for (uint32_t i = choice.kept; i < choice.count; i++) choice.rest += w->order[i].bound;
    return choice;
}

LW_WIDE static uint32_t find_positive(const float *restrict e) {
    uint32_t bits = 0;
    for (uint32_t k = 0; k < LANES; k++) bits |= e[k] > 0 ? 1u << k : 0;
    return bits;
}

/* E without shadows of a light, over its colour; returns the bits of points that it reaches. */
static uint16_t light_points(const struct lw_direct_pixels *d, uint32_t candidate,
                             const struct lw_points16 *points, float e[LANES]) {
    const uint32_t index = d->candidates.index[candidate];
    if (d->candidates.kind[candidate] == KIND_CLUSTER) {
        lw_emitter_clusters_light16(&d->clusters.cluster[index], points, e);
    } else {
        struct lw_light_sample16 sample;
        lw_lights_sample_punctual16(&d->lights, index, 0, 0, points, &sample);
        const struct lw_vec3 i = d->lights.punctual[index].intensity;
        const float scale = 1 / (i.x + i.y + i.z);
        for (uint32_t k = 0; k < LANES; k++)
            e[k] = (sample.e[0][k] + sample.e[1][k] + sample.e[2][k]) * scale;
    }
    return (uint16_t)find_positive(e);
}

static struct lw_vec3 colour_of(const struct lw_direct_pixels *d, uint32_t candidate) {
    const uint32_t index = d->candidates.index[candidate];
    return d->candidates.kind[candidate] == KIND_CLUSTER ? d->clusters.cluster[index].colour
                                                         : d->lights.punctual[index].intensity;
}

/* ---- finishes ---- */

/* Points with their bumped normals. */
LW_WIDE static void bump_points(const struct lw_direct_block *restrict block,
                                struct lw_points16 *restrict out) {
    for (uint32_t i = 0; i < LANES; i++) {
        const bool finished = block->finished >> i & 1u;
        out->x[i] = block->points.x[i], out->y[i] = block->points.y[i], out->z[i] = block->points.z[i];
        out->nx[i] = finished ? block->seen.normal[0][i] : block->points.nx[i];
        out->ny[i] = finished ? block->seen.normal[1][i] : block->points.ny[i];
        out->nz[i] = finished ? block->seen.normal[2][i] : block->points.nz[i];
    }
}

/* The points whose plain surface a lamp is above. */
LW_WIDE static uint32_t find_above(const struct lw_points16 *restrict p, struct lw_vec3 at, float at_point,
                                   float radius) {
    uint32_t bits = 0;
    for (uint32_t i = 0; i < LANES; i++) {
        const float x = at.x - at_point * p->x[i], y = at.y - at_point * p->y[i],
                    z = at.z - at_point * p->z[i];
        bits |= p->nx[i] * x + p->ny[i] * y + p->nz[i] * z > -radius ? 1u << i : 0;
    }
    return bits;
}

/* A cluster looks like a disc that is smaller than the ball around it. */
#define DISC_SHARE 0.6f

static struct lw_gloss_lamp lamp_of(const struct lw_direct_pixels *d, uint32_t candidate) {
    const struct candidates *c = &d->candidates;
    const uint32_t index = c->index[candidate];
    if (c->kind[candidate] != KIND_SUN)
        return (struct lw_gloss_lamp){.at = lw_vec3(c->x[candidate], c->y[candidate], c->z[candidate]),
                                      .radius = DISC_SHARE * c->radius_m[candidate]};
    return (struct lw_gloss_lamp){.at = lw_vec3_scale(d->lights.punctual[index].direction_ws, -1),
                                  .radius = tanf(0.5f * d->desc.scene->light[index].angular_diameter),
                                  .is_sun = true};
}

/* light_points() of a block with finishes, and what it mirrors of that. */
static uint16_t light_finished(const struct lw_direct_pixels *d, uint32_t candidate,
                               const struct lw_direct_block *block, float e[LANES], float dv[LANES],
                               float rim[LANES]) {
    const struct lw_gloss_lamp lamp = lamp_of(d, candidate);
    struct lw_points16 bumped;
    bump_points(block, &bumped);
    const uint32_t reached = light_points(d, candidate, &bumped, e);
    const uint32_t above =
        find_above(&block->points, lamp.at, lamp.is_sun ? 0 : 1, lamp.is_sun ? 0 : lamp.radius);
    lw_gloss_lamp16(&block->seen, &block->points, &lamp, dv, rim);
    return (uint16_t)(reached & (above | ~(uint32_t)block->finished));
}

static uint16_t light_block(const struct lw_direct_pixels *d, uint32_t candidate, struct lw_direct_work *w,
                            const struct lw_direct_block *block, uint32_t b) {
    return block->finished ? light_finished(d, candidate, block, w->e[b], w->dv[b], w->rim[b])
                           : light_points(d, candidate, &block->points, w->e[b]);
}

/* Adds what pixels mirror of e to the radiance that they send out. colour: of e */
LW_WIDE static void add_mirrored(const float *restrict e, const float *restrict dv, const float *restrict rim,
                                 struct lw_vec3 colour, struct lw_direct_block *restrict block) {
    const float tint[3] = {colour.x, colour.y, colour.z};
    for (uint32_t c = 0; c < 3; c++)
        for (uint32_t i = 0; i < LANES; i++) {
            const float f = block->seen.mirror[c][i] + block->seen.rim[c][i] * rim[i];
            block->mirrored[c][i] += block->finished >> i & 1u ? e[i] * dv[i] * tint[c] * f : 0;
        }
}

/* What of a light counts as much as matt white would, over its e: how bright it makes a pixel, beside what
 * the pixel sends back of light from everywhere. */
LW_WIDE static void weigh_mirrored(const struct lw_direct_block *restrict block, const float *restrict dv,
                                   const float *restrict rim, float *restrict out) {
    const struct lw_gloss_seen16 *restrict g = &block->seen;
    for (uint32_t i = 0; i < LANES; i++) {
        const float diffuse =
            0.2126f * g->diffuse[0][i] + 0.7152f * g->diffuse[1][i] + 0.0722f * g->diffuse[2][i];
        const float mirror =
            0.2126f * g->mirror[0][i] + 0.7152f * g->mirror[1][i] + 0.0722f * g->mirror[2][i];
        const float edge = 0.2126f * g->rim[0][i] + 0.7152f * g->rim[1][i] + 0.0722f * g->rim[2][i];
        const float all =
            0.2126f * g->mirrored[0][i] + 0.7152f * g->mirrored[1][i] + 0.0722f * g->mirrored[2][i];
        const float shown = diffuse + LW_PI * dv[i] * (mirror + edge * rim[i]);
        out[i] = block->finished >> i & 1u ? shown / (diffuse + all + 1e-6f) : 1;
    }
}

/* Whether a point lies on the flat piece of surface around another. */
static bool is_flat(const struct lw_points16 *p, uint32_t a, uint32_t b) {
    const float dx = p->x[b] - p->x[a], dy = p->y[b] - p->y[a], dz = p->z[b] - p->z[a];
    const float off = dx * p->nx[a] + dy * p->ny[a] + dz * p->nz[a];
    return p->nx[a] * p->nx[b] + p->ny[a] * p->ny[b] + p->nz[a] * p->nz[b] > 0.97f &&
           off * off <= 0.03f * (dx * dx + dy * dy + dz * dz);
}

/* Which quads of 2 x 2 pixels lie on one flat piece of surface. */
static uint16_t find_flat(const struct lw_direct_block *block) {
    const struct lw_points16 *p = &block->points;
    uint16_t flat = 0;
    for (uint32_t q = 0; q < 4; q++) {
        const uint32_t first = (q & 1) * 2 + (q >> 1) * 8;
        const uint16_t quad = (uint16_t)(0x33u << first);
        if ((block->active & quad) == quad && is_flat(p, first, first + 1) && is_flat(p, first, first + 4) &&
            is_flat(p, first, first + 5))
            flat |= quad;
    }
    return flat;
}

/* Whether a block whose quads are flat is so as a whole. */
static bool is_whole(const struct lw_direct_block *block) {
    const struct lw_points16 *p = &block->points;
    return is_flat(p, 0, 2) && is_flat(p, 0, 8) && is_flat(p, 0, 10) && is_flat(p, 0, 3) &&
           is_flat(p, 0, 12) && is_flat(p, 0, 15) && is_flat(p, 15, 3) && is_flat(p, 15, 12);
}

static int column_of(uint32_t pixel) { return (int)(pixel / LANES % LW_DIRECT_PIXELS_SIDE * 4 + pixel % 4); }
static int row_of(uint32_t pixel) {
    return (int)(pixel / LANES / LW_DIRECT_PIXELS_SIDE * 4 + pixel % LANES / 4);
}

/* What rays have found. */
enum { DARK = 1, LIT = 2 };

/* The light at hand, for one tile. */
struct job {
    const struct lw_direct_pixels *direct;
    struct lw_direct_tile *tile;
    struct lw_direct_work *work;
    uint32_t candidate;
    uint32_t seed;
    bool wide;       /* shadow rays of a pixel may differ */
    bool far;        /* the tile is small, seen from the light */
    bool finished;   /* some of its pixels have a finish */
    uint32_t number; /* this job's number in the tile's memory */
};

/* Notes what a pixel's ray has found. */
static void note_shadow_ray(struct lw_direct_work *w, uint32_t pixel, bool lit) {
    const uint32_t bit = 1u << column_of(pixel);
    w->lit[pixel] += lit;
    w->state[pixel / LANES] |= lit ? LIT : DARK;
    (lit ? w->lit_row : w->dark_row)[row_of(pixel)] |= bit;
}

static void flush(struct job *job) {
    struct lw_direct_work *w = job->work;
    if (!w->waiting) return;
    const uint16_t active = (uint16_t)((1u << w->waiting) - 1u);
    const uint16_t occluded =
        lw_trace_occluded16(job->direct->desc.trace, LW_TRACE_COHERENT, active, &w->rays);
    for (uint32_t i = 0; i < w->waiting; i++) note_shadow_ray(w, w->pixel[i], !(occluded >> i & 1u));
    job->tile->rays += w->waiting;
    w->waiting = 0;
}

/* Which parts of a cluster a block sees: once for a tile that is small from there. */
static const float *share_of(struct job *job, uint32_t block, struct lw_vec3 point) {
    struct lw_direct_work *w = job->work;
    const uint32_t slot = job->far ? 0 : block;
    if (w->shared[slot] != job->number) {
        w->shared[slot] = job->number;
        const struct lw_direct_pixels *d = job->direct;
        lw_emitter_clusters_share(&d->clusters.cluster[d->candidates.index[job->candidate]], point,
                                  w->part[slot]);
    }
    return w->part[slot];
}

/* Puts a pixel's shadow ray number k into the packet. */
static void shoot(struct job *job, uint32_t pixel, uint32_t k) {
    struct lw_direct_work *w = job->work;
    const struct lw_direct_pixels *d = job->direct;
    const uint32_t block = pixel / LANES, lane = pixel % LANES, index = d->candidates.index[job->candidate];
    const uint32_t variant = lw_random_hash2(job->seed, block) % VARIANTS;
    const struct lw_points16 *p = &job->tile->block[block].points;
    const struct lw_vec3 origin = lw_vec3(p->x[lane], p->y[lane], p->z[lane]);
    const float *point = d->point[variant][k][lane];
    struct lw_vec3 way;
    float end = LW_TRACE_SHORT;
    w->taken[pixel]++;
    switch ((enum kind)d->candidates.kind[job->candidate]) {
    case KIND_SUN:
        way = d->sun[job->candidate][variant][k][lane];
        end = INFINITY;
        break;
    case KIND_NEAR:
        way = lw_vec3_sub(d->lights.punctual[index].position_ws, origin);
        break;
    case KIND_CLUSTER:
    default:
        if (!lw_emitter_clusters_aim(&d->clusters, &d->clusters.cluster[index], share_of(job, block, origin),
                                     origin, lw_vec3(p->nx[lane], p->ny[lane], p->nz[lane]), point[0],
                                     point[1], &way, &end)) {
            note_shadow_ray(w, pixel, false);
            return;
        }
        break;
    }
    w->pixel[w->waiting] = (uint16_t)pixel;
    lw_trace_set_ray(&w->rays, w->waiting, origin, way, end);
    if (++w->waiting == LANES) flush(job);
}

/* One ray for each quad of a block that has none yet, and for each pixel of those that are not flat. */
static void shoot_quads(struct job *job, uint32_t b) {
    struct lw_direct_work *w = job->work;
    const uint32_t turn = lw_random_hash2(job->seed, b) >> 8;
    for (uint32_t q = 0; q < 4; q++) {
        const uint32_t first = (q & 1) * 2 + (q >> 1) * 8, at = b * LANES + first;
        const uint16_t quad = (uint16_t)(0x33u << first);
        if ((w->facing[b] & w->flat[b] & quad) == quad) {
            const uint32_t k = turn >> 2 * q & 3;
            if (!(w->taken[at] | w->taken[at + 1] | w->taken[at + 4] | w->taken[at + 5]))
                shoot(job, at + (k & 1) + (k >> 1) * 4, 0);
            continue;
        }
        for (uint32_t k = 0; k < 4; k++) {
            const uint32_t i = first + (k & 1) + (k >> 1) * 4;
            if (!(w->facing[b] >> i & 1u)) continue;
            shoot(job, b * LANES + i, 0);
            if (!(w->seen[b] & quad) && !job->tile->listed) break; /* weak light: one is enough */
        }
    }
}

/* One ray for each flat block, or flat quad, and for each pixel elsewhere. Rays of blocks in a row or
 * column go through all rows and columns of pixels, so that a straight shadow of a pixel's width is found
 * somewhere. */
static void shoot_sparsely(struct job *job, bool divided[BLOCKS]) {
    struct lw_direct_work *w = job->work;
    for (uint32_t b = 0; b < BLOCKS; b++) {
        const uint32_t u = b % LW_DIRECT_PIXELS_SIDE, v = b / LW_DIRECT_PIXELS_SIDE;
        divided[b] = w->facing[b] != 0xffff || !w->whole[b];
        if (w->facing[b] && !w->faint[b] && !job->tile->listed) { /* one will do, wherever it starts */
            shoot(job, b * LANES + (uint32_t)__builtin_ctz(w->facing[b]), 0);
            divided[b] = true;
            continue;
        }
        if (!divided[b]) {
            const uint32_t x = (v + 2 * u + (job->seed >> 8)) & 3, y = (u + 2 * v + (job->seed >> 12)) & 3;
            shoot(job, b * LANES + 4 * y + x, 0);
        } else if (w->facing[b]) {
            shoot_quads(job, b);
        }
    }
    flush(job);
}

/* All states of a block and of those around it. */
static unsigned states_around(const struct lw_direct_work *w, uint32_t b) {
    const int side = (int)LW_DIRECT_PIXELS_SIDE, x = (int)b % side, y = (int)b / side;
    unsigned states = 0;
    for (int j = y > 0 ? y - 1 : 0; j <= (y + 1 < side ? y + 1 : y); j++)
        for (int i = x > 0 ? x - 1 : 0; i <= (x + 1 < side ? x + 1 : x); i++)
            states |= w->state[j * side + i];
    return states;
}

/* Where blocks disagree with those around them they have a ray for each quad; what these find may lead on. */
static void divide(struct job *job, bool divided[BLOCKS]) {
    struct lw_direct_work *w = job->work;
    for (bool again = true; again;) {
        again = false;
        for (uint32_t b = 0; b < BLOCKS; b++) {
            if (divided[b] || !w->faint[b] || states_around(w, b) != (DARK | LIT)) continue;
            shoot_quads(job, b);
            divided[b] = again = true;
        }
        flush(job);
    }
}

static uint32_t pixel_at(int x, int y) {
    const uint32_t u = (uint32_t)x, v = (uint32_t)y;
    return ((v / 4 * LW_DIRECT_PIXELS_SIDE + u / 4) * 16) + v % 4 * 4 + u % 4;
}

static bool is_partial(const struct lw_direct_work *w, uint32_t pixel) {
    return w->lit[pixel] > 0 && w->lit[pixel] < w->taken[pixel];
}

/* A row of pixels, or each that is up to r columns from one of it. */
static uint32_t widen(uint32_t row, int r) {
    for (int k = 0; k < r; k++) row |= row << 1 | row >> 1;
    return row;
}

/* The pixels that have both light and shadow in the square window of half side r around them. */
static void find_mixed(const struct lw_direct_work *w, int r, uint32_t out_row[SIDE]) {
    uint32_t lit[SIDE], dark[SIDE];
    for (uint32_t y = 0; y < SIDE; y++) lit[y] = widen(w->lit_row[y], r), dark[y] = widen(w->dark_row[y], r);
    for (int y = 0; y < (int)SIDE; y++) {
        uint32_t any_lit = 0, any_dark = 0;
        for (int j = y > r ? y - r : 0; j <= y + r && j < (int)SIDE; j++)
            any_lit |= lit[j], any_dark |= dark[j];
        out_row[y] = any_lit & any_dark;
    }
}

/* The pixels of a block, of rows of the tile. */
static uint16_t of_block(const uint32_t row[SIDE], uint32_t b) {
    const uint32_t x = b % LW_DIRECT_PIXELS_SIDE * 4, y = b / LW_DIRECT_PIXELS_SIDE * 4;
    uint32_t bits = 0;
    for (uint32_t k = 0; k < 4; k++) bits |= (row[y + k] >> x & 15u) << 4 * k;
    return (uint16_t)bits;
}

/* Pixels close to others that disagree have rays of their own. Rays of quads side by side are up to three
 * pixels apart. */
static void shoot_pixels(struct job *job) {
    struct lw_direct_work *w = job->work;
    for (int pass = 0; pass < 2; pass++) {
        uint32_t mixed[SIDE];
        find_mixed(w, 3, mixed);
        for (uint32_t b = 0; b < BLOCKS; b++) {
            uint32_t left = w->seen[b] ? w->seen[b] & of_block(mixed, b) : 0;
            for (; left; left &= left - 1) {
                const uint32_t pixel = b * LANES + (uint32_t)__builtin_ctz(left);
                if (!w->taken[pixel]) shoot(job, pixel, 0);
            }
        }
        flush(job);
    }
}

/* Whether a neighbourhood lies within a penumbra: enough of its pixels have found both light and shadow.
 * The wider the window, the more of them, as the mean over a bend is no pixel's own. r: half the window's
 * side */
static bool is_wide(uint32_t partial, uint32_t all, uint32_t r) {
    return 100 * partial >= (30 + 15 * r) * all;
}

/* Whether a pixel lies at the edge of a penumbra that is too narrow for a mean over neighbours. */
static bool is_narrow(const struct lw_direct_work *w, uint32_t pixel) {
    const int x = column_of(pixel), y = row_of(pixel);
    const uint32_t window = widen(1u << x, 1);
    uint32_t partial = 0, all = 0;
    for (int j = y > 0 ? y - 1 : 0; j <= y + 1 && j < (int)SIDE; j++) {
        partial += (uint32_t)__builtin_popcount(w->lit_row[j] & w->dark_row[j] & window);
        all += (uint32_t)__builtin_popcount((w->lit_row[j] | w->dark_row[j]) & window);
    }
    return partial > 0 && !is_wide(partial, all, 1);
}

/* The pixels of a block that take more than `taken` rays. mixed: those close to light and shadow */
static uint16_t find_wanting(const struct job *job, const uint32_t mixed[SIDE], uint32_t b, uint32_t taken) {
    const struct lw_direct_work *w = job->work;
    const bool listed = job->tile->listed; /* its blocks are no neighbourhoods: a mixed one is enough */
    if (listed && (w->state[b] != (DARK | LIT) || taken >= SOME)) return 0;
    uint32_t wanting = 0, left = taken == 1 ? w->seen[b] : w->noisy[b];
    if (left && !listed) left &= of_block(mixed, b);
    for (; left; left &= left - 1) {
        const uint32_t i = (uint32_t)__builtin_ctz(left), pixel = b * LANES + i;
        if (w->taken[pixel] == taken && (taken < SOME || is_narrow(w, pixel))) wanting |= 1u << i;
    }
    return (uint16_t)wanting;
}

/* Brings pixels that have `taken` rays, and whose neighbourhood is mixed, to `count`. reach: half its side */
static void refine(struct job *job, int reach, uint32_t taken, uint32_t count) {
    struct lw_direct_work *w = job->work;
    uint16_t more[BLOCKS]; /* by the rays of before */
    uint32_t mixed[SIDE];
    find_mixed(w, reach, mixed);
    for (uint32_t b = 0; b < BLOCKS; b++) more[b] = find_wanting(job, mixed, b, taken);
    for (uint32_t k = taken; k < count; k++) {
        w->rays.salt = lw_random_hash2(job->seed, k);
        for (uint32_t b = 0; b < BLOCKS; b++)
            for (uint32_t left = more[b]; left; left &= left - 1)
                shoot(job, b * LANES + (uint32_t)__builtin_ctz(left), k);
        flush(job);
    }
}

/* Gives pixels without a ray what their quad's ray, or the block's, has found. */
static void spread(struct lw_direct_work *w, uint32_t b) {
    if (w->state[b] != (DARK | LIT)) {
        for (uint32_t i = 0; i < LANES; i++) w->share[b * LANES + i] = w->state[b] == LIT ? 1 : 0;
        return;
    }
    float of_block = 0;
    for (uint32_t p = b * LANES; p < (b + 1) * LANES; p++)
        if (w->taken[p]) of_block = (float)w->lit[p] / (float)w->taken[p];
    for (uint32_t q = 0; q < 4; q++) {
        const uint32_t first = b * LANES + (q & 1) * 2 + (q >> 1) * 8;
        const uint32_t at[4] = {first, first + 1, first + 4, first + 5};
        float share = of_block;
        for (int k = 0; k < 4; k++)
            if (w->taken[at[k]]) share = (float)w->lit[at[k]] / (float)w->taken[at[k]];
        for (int k = 0; k < 4; k++)
            w->share[at[k]] = w->taken[at[k]] ? (float)w->lit[at[k]] / (float)w->taken[at[k]] : share;
    }
}

static bool is_one_surface(const struct lw_direct_tile *tile, uint32_t a, uint32_t b) {
    const struct lw_points16 *p = &tile->block[a / LANES].points, *q = &tile->block[b / LANES].points;
    const uint32_t i = a % LANES, j = b % LANES;
    const float dx = q->x[j] - p->x[i], dy = q->y[j] - p->y[i], dz = q->z[j] - p->z[i];
    const float off = dx * p->nx[i] + dy * p->ny[i] + dz * p->nz[i];
    return p->nx[i] * q->nx[j] + p->ny[i] * q->ny[j] + p->nz[i] * q->nz[j] > 0.95f &&
           off * off <= 0.05f * (dx * dx + dy * dy + dz * dz);
}

/* The mean over the widest window around a pixel that lies within a penumbra on one surface. */
static float smooth(const struct job *job, uint32_t pixel) {
    const struct lw_direct_work *w = job->work;
    const int x = column_of(pixel), y = row_of(pixel), side = (int)SIDE;
    uint32_t near = 0;
    for (int j = y > 0 ? y - 1 : 0; j <= y + 1 && j < side; j++) near |= w->lit_row[j] & w->dark_row[j];
    if (!(near & widen(1u << x, 1))) return w->share[pixel];
    float mean = w->share[pixel], sum = mean;
    uint32_t partial = is_partial(w, pixel), all = 1;
    for (int r = 1; r <= WINDOW; r++) {
        for (int j = -r; j <= r; j++)
            for (int i = -r; i <= r; i += j == -r || j == r ? 1 : 2 * r) {
                if (x + i < 0 || y + j < 0 || x + i >= side || y + j >= side) continue;
                const uint32_t p = pixel_at(x + i, y + j);
                if (!w->taken[p] || !is_one_surface(job->tile, pixel, p)) continue;
                sum += w->share[p];
                partial += is_partial(w, p);
                all++;
            }
        if (!is_wide(partial, all, (uint32_t)r)) break;
        mean = sum / (float)all;
    }
    return mean;
}

/* Adds a share of the light at hand to a block. */
LW_WIDE static void add_matt_part(const float *restrict share, const float *restrict e, struct lw_vec3 colour,
                                  uint16_t facing, float (*restrict out)[LANES]) {
    for (uint32_t i = 0; i < LANES; i++) {
        const float part = facing >> i & 1u ? e[i] * share[i] : 0;
        out[0][i] += part * colour.x, out[1][i] += part * colour.y, out[2][i] += part * colour.z;
    }
}

static void add_part(const struct job *job, uint32_t b, const float share[LANES], struct lw_vec3 colour) {
    const struct lw_direct_work *w = job->work;
    struct lw_direct_block *block = &job->tile->block[b];
    add_matt_part(share, w->e[b], colour, w->facing[b], block->e);
    if (!block->finished) return;
    float e[LANES];
    for (uint32_t i = 0; i < LANES; i++) e[i] = w->facing[b] >> i & 1u ? w->e[b][i] * share[i] : 0;
    add_mirrored(e, w->dv[b], w->rim[b], colour, block);
}

static bool is_mixed(const struct lw_direct_work *w) {
    unsigned states = 0;
    for (uint32_t b = 0; b < BLOCKS; b++) states |= w->state[b];
    return states == (DARK | LIT);
}

static void resolve(const struct job *job) {
    struct lw_direct_work *w = job->work;
    const struct lw_vec3 colour = colour_of(job->direct, job->candidate);
    if (!is_mixed(w)) { /* all of the tile is lit, or dark */
        static const float all[LANES] = {1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1};
        for (uint32_t b = 0; b < BLOCKS; b++)
            if (w->facing[b] && w->state[b] == LIT) add_part(job, b, all, colour);
        return;
    }
    for (uint32_t b = 0; b < BLOCKS; b++)
        if (w->facing[b]) spread(w, b);
    for (uint32_t b = 0; b < BLOCKS; b++) {
        if (!w->facing[b]) continue;
        float share[LANES];
        memcpy(share, w->share + b * LANES, sizeof share);
        for (uint32_t left = job->tile->listed ? 0 : w->facing[b]; left; left &= left - 1) {
            const uint32_t i = (uint32_t)__builtin_ctz(left);
            if (w->taken[b * LANES + i] > 1) share[i] = smooth(job, b * LANES + i);
        }
        add_part(job, b, share, colour);
    }
}

static bool has_extent(const struct lw_direct_pixels *d, uint32_t candidate) {
    switch ((enum kind)d->candidates.kind[candidate]) {
    case KIND_SUN:
        return d->desc.scene->light[d->candidates.index[candidate]].angular_diameter > 0;
    case KIND_NEAR:
        return false;
    case KIND_CLUSTER:
        break;
    }
    return true;
}

/* Whether all of a region sees a light from much the same direction. */
static bool is_far(const struct candidates *c, uint32_t i, const struct region *region) {
    const struct lw_vec3 way = lw_vec3_sub(lw_vec3(c->x[i], c->y[i], c->z[i]), region->middle);
    return lw_vec3_length(way) > 6 * region->radius_m;
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
        w.faint |= own >= SHARE_FAINT * all ? 1u << i : 0;
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
        weigh_mirrored(block, w->dv[b], w->rim[b], e);
        for (uint32_t i = 0; i < LANES; i++) e[i] *= w->e[b][i];
        weight = find_weights(e, block->base, block->e, luminance);
    } else if (w->facing[b]) {
        weight = find_weights(w->e[b], block->base, block->e, luminance);
    }
    w->faint[b] = (uint16_t)weight.faint & w->facing[b];
    w->seen[b] = (uint16_t)weight.seen & w->facing[b];
    w->noisy[b] = (uint16_t)weight.noisy & w->facing[b];
}

/* ---- blocks as one point ---- */

LW_WIDE static void summarise_block(const struct lw_direct_block *restrict block, uint32_t b,
                                    struct summary *restrict out) {
    const struct lw_points16 *restrict p = &block->points;
    float weight[LANES], count = 0, x = 0, y = 0, z = 0, nx = 0, ny = 0, nz = 0, base = 0;
    for (uint32_t i = 0; i < LANES; i++) weight[i] = block->active >> i & 1u ? 1 : 0;
    for (uint32_t i = 0; i < LANES; i++) {
        const float k = weight[i];
        count += k, base += k * block->base[i];
        x += k * p->x[i], y += k * p->y[i], z += k * p->z[i];
        nx += k * p->nx[i], ny += k * p->ny[i], nz += k * p->nz[i];
    }
    const float scale = count > 0 ? 1 / count : 0;
    x *= scale, y *= scale, z *= scale, nx *= scale, ny *= scale, nz *= scale;
    float far2 = 0, spread2 = 0;
    for (uint32_t i = 0; i < LANES; i++) {
        const float k = weight[i], dx = k * (p->x[i] - x), dy = k * (p->y[i] - y), dz = k * (p->z[i] - z);
        const float ox = k * (p->nx[i] - nx), oy = k * (p->ny[i] - ny), oz = k * (p->nz[i] - nz);
        const float d2 = dx * dx + dy * dy + dz * dz, o2 = ox * ox + oy * oy + oz * oz;
        far2 = far2 > d2 ? far2 : d2, spread2 = spread2 > o2 ? spread2 : o2;
    }
    struct lw_points16 *at = &out->middle[b / LANES];
    const uint32_t lane = b % LANES;
    at->x[lane] = x, at->y[lane] = y, at->z[lane] = z;
    at->nx[lane] = nx, at->ny[lane] = ny, at->nz[lane] = nz;
    out->radius_m[b] = sqrtf(far2), out->spread[b] = sqrtf(spread2);
    out->found[b] = base * scale;
    out->filled[b] = count > 0 ? 1 : 0;
}

/* The middles as points that face a light; the cosine there, the most anywhere in the block, and the distance
 * over the radius. */
LW_WIDE static void turn_to(const struct lw_points16 *restrict p, const float *restrict radius_m,
                            const float *restrict spread, struct lw_vec3 light, float light_radius_m,
                            struct lw_points16 *restrict out, float *restrict cosine, float *restrict most,
                            float *restrict near) {
    for (uint32_t i = 0; i < LANES; i++) {
        const float x = light.x - p->x[i], y = light.y - p->y[i], z = light.z - p->z[i];
        const float m = sqrtf(x * x + y * y + z * z + 1e-20f), scale = 1 / m;
        const float apart = m - light_radius_m;
        out->x[i] = p->x[i], out->y[i] = p->y[i], out->z[i] = p->z[i];
        out->nx[i] = x * scale, out->ny[i] = y * scale, out->nz[i] = z * scale;
        const float c = (p->nx[i] * x + p->ny[i] * y + p->nz[i] * z) * scale;
        const float limit = c + spread[i] + (radius_m[i] + light_radius_m) * scale;
        cosine[i] = c > 0 ? c : 0;
        most[i] = limit > 1 ? 1 : limit > 0 ? limit : 0;
        near[i] = (apart > 0 ? apart : 0) / (radius_m[i] + 1e-20f);
    }
}

/* What a light may give to each block; returns the sum of what it is expected to give. */
static float look_out(const struct lw_direct_pixels *d, const struct summary *summary, uint32_t candidate,
                      float luminance, struct outlook *out) {
    const struct candidates *c = &d->candidates;
    const struct lw_vec3 light = lw_vec3(c->x[candidate], c->y[candidate], c->z[candidate]);
    float sum = 0;
    for (uint32_t k = 0; k < BLOCKS / LANES; k++) {
        struct lw_points16 at;
        float cosine[LANES], e[LANES];
        turn_to(&summary->middle[k], summary->radius_m + k * LANES, summary->spread + k * LANES, light,
                c->radius_m[candidate], &at, cosine, out->most + k * LANES, out->near + k * LANES);
        light_points(d, candidate, &at, e);
        for (uint32_t i = 0; i < LANES; i++) {
            out->full[k * LANES + i] = e[i] * luminance;
            out->expected[k * LANES + i] = e[i] * cosine[i] * luminance;
            out->most[k * LANES + i] *= summary->filled[k * LANES + i] * e[i] * luminance;
            sum += out->expected[k * LANES + i];
        }
    }
    return sum;
}

/* ---- a light ---- */

/* The mean of what a block has. */
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

/* How blocks take a light. Weak: it is so far and such a small part of what arrives that one place will do
 * for all of a block, but for normals. */
struct parts {
    float weak[BLOCKS]; /* the most that it may add, over all; 0: not weak */
    uint32_t full[BLOCKS];
};

/* Returns bit 0: some are weak, bit 1: some are full. */
LW_WIDE static uint32_t part_blocks(const struct outlook *restrict outlook, const float *restrict found,
                                    struct parts *restrict out) {
    uint32_t any = 0;
    for (uint32_t b = 0; b < BLOCKS; b++) {
        const float most = outlook->most[b], all = found[b] + most;
        const bool even = outlook->near[b] > EVEN_RADII, weak = even & (most < SHARE_FAINT * all);
        out->weak[b] = (weak & (most > 0)) ? most / all : 0;
        out->full[b] = (weak | (even & !(most > 0))) ? 0 : 1;
        any |= (out->weak[b] > 0 ? 1u : 0u) | out->full[b] << 1;
    }
    return any;
}

/* A block that mirrors more of a light than its share of e is not weak there. Returns the bits
 * that are left. */
static uint32_t part_finished(const struct job *job, const struct outlook *outlook, uint32_t any,
                              struct parts *out) {
    const struct lw_direct_work *w = job->work;
    for (uint32_t b = 0; b < BLOCKS; b++) {
        const struct lw_direct_block *block = &job->tile->block[b];
        float gain[LANES], greatest = 1;
        if (!block->finished || !(out->weak[b] > 0)) continue;
        weigh_mirrored(block, w->dv[b], w->rim[b], gain);
        for (uint32_t i = 0; i < LANES; i++) greatest = fmaxf(greatest, gain[i]);
        const float bright = greatest * outlook->most[b];
        if (bright < SHARE_FAINT * (w->summary.found[b] + bright)) continue;
        out->weak[b] = 0, out->full[b] = 1;
        any |= 2;
    }
    return any;
}

/* Each pixel for itself: the edge of a spot may cross a block. */
static uint32_t part_light(const struct job *job, const struct outlook *outlook, struct parts *out) {
    if (outlook && !job->tile->listed && !(job->direct->candidates.cos_reach[job->candidate] > -1)) {
        const uint32_t any = part_blocks(outlook, job->work->summary.found, out);
        return any & 1u && job->finished ? part_finished(job, outlook, any, out) : any;
    }
    for (uint32_t b = 0; b < BLOCKS; b++) out->weak[b] = 0, out->full[b] = 1;
    return 2;
}

/* Adds E to a block's pixels by their own normals. way: to the light, unit length */
LW_WIDE static void add_by_normals(struct lw_direct_block *restrict block,
                                   const struct lw_points16 *restrict p, struct lw_vec3 way,
                                   struct lw_vec3 e) {
    for (uint32_t i = 0; i < LANES; i++) {
        const float cosine = p->nx[i] * way.x + p->ny[i] * way.y + p->nz[i] * way.z;
        const float k = cosine > 0 ? cosine : 0;
        block->e[0][i] += k * e.x, block->e[1][i] += k * e.y, block->e[2][i] += k * e.z;
    }
}

/* Blocks, two by two. */
enum { GROUP_SIDE = LW_DIRECT_PIXELS_SIDE / 2, GROUPS = GROUP_SIDE * GROUP_SIDE };

static uint32_t block_of(uint32_t group, uint32_t k) {
    const uint32_t x = group % GROUP_SIDE * 2 + (k & 1), y = group / GROUP_SIDE * 2 + (k >> 1);
    return y * LW_DIRECT_PIXELS_SIDE + x;
}

/* A shadow ray for a group of which this light is a small part; returns its pixel. */
static uint32_t shoot_weakly(struct job *job, const struct parts *parts, uint32_t group, uint32_t random) {
    struct lw_direct_work *w = job->work;
    uint32_t from = block_of(group, 0), lane = random % LANES;
    for (uint32_t k = 1; k < 4; k++)
        if (parts->weak[block_of(group, k)] > parts->weak[from]) from = block_of(group, k);
    while (!(job->tile->block[from].active >> lane & 1u)) lane = (lane + 1) % LANES;
    w->lit[from * LANES + lane] = 0;
    shoot(job, from * LANES + lane, 0);
    return from * LANES + lane;
}

static void add_finished(struct lw_direct_block *block, struct lw_vec3 way, struct lw_vec3 e,
                         const float dv[LANES], const float rim[LANES]) {
    struct lw_points16 bumped;
    float cosine[LANES];
    bump_points(block, &bumped);
    add_by_normals(block, &bumped, way, e);
    for (uint32_t i = 0; i < LANES; i++)
        cosine[i] = fmaxf(bumped.nx[i] * way.x + bumped.ny[i] * way.y + bumped.nz[i] * way.z, 0);
    add_mirrored(cosine, dv, rim, e, block);
}

/* weight: what the group's ray counts for */
static void add_to_block(const struct job *job, const struct outlook *outlook, uint32_t b, float weight,
                         struct lw_vec3 colour) {
    struct lw_direct_work *w = job->work;
    struct lw_direct_block *block = &job->tile->block[b];
    w->summary.found[b] += weight * outlook->expected[b];
    if (w->whole[b] && !block->finished) {
        const float e = weight * outlook->expected[b];
        w->weak[0][b] += e * colour.x, w->weak[1][b] += e * colour.y, w->weak[2][b] += e * colour.z;
        return;
    }
    const struct candidates *c = &job->direct->candidates;
    const struct lw_points16 *at = &w->summary.middle[b / LANES];
    const uint32_t i = b % LANES, from = job->candidate;
    const struct lw_vec3 way =
        lw_vec3_sub(lw_vec3(c->x[from], c->y[from], c->z[from]), lw_vec3(at->x[i], at->y[i], at->z[i]));
    const struct lw_vec3 unit = lw_vec3_normalize(way), e = lw_vec3_scale(colour, weight * outlook->full[b]);
    if (block->finished)
        add_finished(block, unit, e, w->dv[b], w->rim[b]);
    else
        add_by_normals(block, &block->points, unit, e);
}

/* colour: of unit luminance */
static void add_weak(struct job *job, const struct outlook *outlook, const struct parts *parts,
                     struct lw_vec3 colour) {
    float weight[GROUPS];
    uint32_t group[GROUPS], pixel[GROUPS], count = 0;
    for (uint32_t g = 0; g < GROUPS; g++) {
        const float *at = parts->weak + block_of(g, 0), *below = at + LW_DIRECT_PIXELS_SIDE;
        const float chance = fmaxf(fmaxf(at[0], at[1]), fmaxf(below[0], below[1])) * (1 / SHARE_CHANCE);
        const uint32_t random = lw_random_hash2(job->seed, g);
        if (!(lw_random_unit(random) < chance)) continue;
        weight[count] = chance < 1 ? 1 / chance : 1;
        group[count] = g;
        pixel[count++] = shoot_weakly(job, parts, g, random);
    }
    flush(job);
    for (uint32_t n = 0; n < count; n++) {
        if (!job->work->lit[pixel[n]]) continue;
        for (uint32_t k = 0; k < 4; k++) {
            const uint32_t b = block_of(group[n], k);
            if (parts->weak[b] > 0) add_to_block(job, outlook, b, weight[n], colour);
        }
    }
}

static void add_full(struct job *job) {
    struct lw_direct_work *w = job->work;
    memset(w->lit, 0, sizeof w->lit);
    memset(w->taken, 0, sizeof w->taken);
    memset(w->state, 0, sizeof w->state);
    memset(w->lit_row, 0, sizeof w->lit_row);
    memset(w->dark_row, 0, sizeof w->dark_row);
    w->rays.salt = job->seed;
    bool divided[BLOCKS];
    shoot_sparsely(job, divided);
    if (is_mixed(w)) {
        if (!job->tile->listed) {
            divide(job, divided);
            shoot_pixels(job);
        }
        if (job->wide) {
            refine(job, 1, 1, FEW);
            refine(job, 1, 1, FEW); /* what only these have shown to be close to a penumbra */
            refine(job, 1, FEW, SOME);
            refine(job, 2, SOME, SAMPLES);
        }
    }
    resolve(job);
    for (uint32_t b = 0; b < BLOCKS; b++)
        if (w->facing[b]) w->summary.found[b] = mean_found(&job->tile->block[b]);
}

/* outlook: NULL where it has none */
static void add_light(const struct lw_direct_pixels *d, struct lw_direct_tile *tile,
                      const struct region *region, uint32_t candidate, const struct outlook *outlook) {
    struct lw_direct_work *w = tile->work;
    struct job job = {.direct = d,
                      .tile = tile,
                      .work = w,
                      .candidate = candidate,
                      .number = ++w->jobs,
                      .far = is_far(&d->candidates, candidate, region),
                      .finished = w->finished,
                      .seed = lw_random_hash4(d->seed, tile->x, tile->y, candidate),
                      .wide = d->blends || has_extent(d, candidate)};
    const struct lw_vec3 colour = colour_of(d, candidate);
    const float luminance = lw_colour_luminance(colour);
    struct parts parts;
    bool full = false;
    for (uint32_t b = 0; w->finished && b < BLOCKS; b++) /* first: they say which blocks are weak */
        if (tile->block[b].finished) w->reached[b] = light_block(d, candidate, w, &tile->block[b], b);
    const uint32_t any = part_light(&job, outlook, &parts);
    for (uint32_t b = 0; (any & 2u) && b < BLOCKS; b++) {
        const struct lw_direct_block *block = &tile->block[b];
        w->facing[b] = 0;
        if (parts.full[b] && block->active)
            w->facing[b] =
                block->active &
                (block->finished ? w->reached[b] : light_points(d, candidate, &block->points, w->e[b]));
        weigh(w, b, &tile->block[b], luminance);
        full |= w->facing[b] != 0;
    }
    if (full) add_full(&job);
    if (any & 1u) add_weak(&job, outlook, &parts, lw_vec3_scale(colour, 1 / luminance));
}

/* One of the weak lights for each block, by what it may give. */
static void add_rest(const struct lw_direct_pixels *d, struct lw_direct_tile *tile,
                     const struct choice *choice) {
    struct lw_direct_work *w = tile->work;
    for (uint32_t b = 0; b < BLOCKS; b++) {
        struct lw_direct_block *block = &tile->block[b];
        if (!block->active) continue;
        const uint32_t seed = lw_random_hash4(d->seed, tile->x, tile->y, b);
        float pick = lw_random_unit(seed) * choice->rest;
        uint32_t at = choice->kept;
        while (at + 1 < choice->count && pick >= w->order[at].bound) pick -= w->order[at++].bound;
        struct job job = {.direct = d,
                          .tile = tile,
                          .work = w,
                          .candidate = w->order[at].candidate,
                          .seed = seed,
                          .number = ++w->jobs};
        w->facing[b] = light_block(d, job.candidate, w, block, b) & block->active;
        if (!w->facing[b]) continue;
        const struct lw_vec3 colour =
            lw_vec3_scale(colour_of(d, job.candidate), choice->rest / w->order[at].bound);
        memset(w->lit + b * LANES, 0, LANES);
        w->rays.salt = seed;
        for (uint32_t i = 0; i < LANES; i++)
            if (w->facing[b] >> i & 1u) shoot(&job, b * LANES + i, 0);
        flush(&job);
        float share[LANES];
        for (uint32_t i = 0; i < LANES; i++) share[i] = w->lit[b * LANES + i] ? 1 : 0;
        add_part(&job, b, share, colour);
    }
}

static void clear(struct lw_direct_tile *tile) {
    tile->work->finished = false;
    for (uint32_t b = 0; b < BLOCKS; b++) {
        struct lw_direct_block *block = &tile->block[b];
        memset(block->e, 0, sizeof block->e);
        if (!block->finished) continue;
        memset(block->mirrored, 0, sizeof block->mirrored);
        tile->work->finished = true;
    }
}

/* Adds what all of a block gets. Where nothing is, and what overflowed, is no light. */
LW_WIDE static void finish(struct lw_direct_block *restrict block, float red, float green, float blue) {
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
    w->flat[b] = tile->block[b].active && !tile->listed ? find_flat(&tile->block[b]) : 0;
    w->whole[b] = w->flat[b] == 0xffff && is_whole(&tile->block[b]);
}

/* Looks at the lights kept, and brings them into the order of what they are expected to give. */
static void look_at_lights(const struct lw_direct_pixels *d, const struct lw_direct_tile *tile,
                           const struct choice *choice, uint32_t turn[KEPT]) {
    struct lw_direct_work *w = tile->work;
    float sum[KEPT];
    for (uint32_t i = 0; i < choice->kept; i++) {
        const uint32_t candidate = w->order[i].candidate;
        uint32_t at = i;
        sum[i] = d->candidates.kind[candidate] == KIND_SUN
                     ? INFINITY
                     : look_out(d, &w->summary, candidate, lw_colour_luminance(colour_of(d, candidate)),
                                &w->outlook[i]);
        for (; at > 0 && sum[turn[at - 1]] < sum[i]; at--) turn[at] = turn[at - 1];
        turn[at] = i;
    }
}

void lw_direct_pixels_light(const struct lw_direct_pixels *d, struct lw_direct_tile *tile) {
    struct lw_direct_work *w = tile->work;
    struct region region;
    uint32_t turn[KEPT];
    clear(tile);
    if (!d->ready || !d->candidates.count || !find_region(tile, &region)) return;
    const struct choice choice = choose(d, w, &region);
    for (uint32_t b = 0; b < BLOCKS; b++) {
        note_flat(tile, b);
        summarise_block(&tile->block[b], b, &w->summary);
    }
    memset(w->weak, 0, sizeof w->weak);
    look_at_lights(d, tile, &choice, turn);
    for (uint32_t i = 0; i < choice.kept; i++) {
        const uint32_t candidate = w->order[turn[i]].candidate;
        const bool is_sun = d->candidates.kind[candidate] == KIND_SUN;
        add_light(d, tile, &region, candidate, is_sun ? NULL : &w->outlook[turn[i]]);
    }
    if (choice.count > choice.kept) add_rest(d, tile, &choice);
    for (uint32_t b = 0; b < BLOCKS; b++)
        finish(&tile->block[b], w->weak[0][b], w->weak[1][b], w->weak[2][b]);
}
