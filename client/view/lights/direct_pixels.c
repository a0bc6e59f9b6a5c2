#include "client/view/lights/direct_pixels.h"

#include "client/view/lights/direct_private.h"
#include "common/base/colour.h"
#include "common/base/sampling.h"

#include <stdlib.h>
#include <string.h>

#define LANES LW_DIRECT_LANES

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

static struct lw_box mesh_box(const struct lw_mesh *mesh) {
    struct lw_box box = LW_BOX_EMPTY;
    for (uint32_t v = 0; v < mesh->vertex_count; v++) lw_box_add_point(&box, mesh->position[v]);
    return box;
}

/* Whether a mesh at a place may come within a distance of a point. */
static bool is_close(const struct lw_box *box, const struct lw_affine *to_world, struct lw_vec3 point,
                     float m) {
    const struct lw_box box_ws = lw_box_moved(to_world, box);
    return lw_box_holds(&box_ws, point, m);
}

/* Marks the clusters of an object as out of date, and those close to its old or new place. */
static void mark_close(struct lw_direct_pixels *d, uint32_t object, const struct lw_affine *now) {
    const struct lw_box *box = &d->box[d->desc.scene->object[object].mesh];
    for (uint32_t i = 0; i < d->clusters.count; i++) {
        const struct lw_emitter_cluster *c = &d->clusters.cluster[i];
        const uint32_t own = d->lights.emitter[d->clusters.side[c->first].emitter].object;
        if (d->dirty[i] || (own != object && !is_close(box, &d->place[object], c->centre, c->reach_m) &&
                            !is_close(box, now, c->centre, c->reach_m)))
            continue;
        d->dirty[i] = true;
    }
}

/* Takes over the poses of objects, and updates the clusters near to those that have moved. */
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
    struct lw_direct_candidates *c = &d->candidates;
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

static void add_candidate(struct lw_direct_candidates *c, enum lw_direct_kind kind, uint32_t index,
                          struct lw_vec3 centre, float radius_m, float intensity) {
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

static void aim_spot(struct lw_direct_candidates *c, const struct lw_light *light, struct lw_vec3 direction) {
    const uint32_t i = c->count - 1;
    c->axis_x[i] = direction.x, c->axis_y[i] = direction.y, c->axis_z[i] = direction.z;
    c->cos_reach[i] = cosf(light->outer_cone);
    c->sin_reach[i] = sinf(light->outer_cone);
}

static void aim_sun(struct lw_direct_pixels *d, uint32_t sun, uint32_t light) {
    for (uint32_t v = 0; v < LW_DIRECT_VARIANTS; v++)
        for (uint32_t k = 0; k < LW_DIRECT_SAMPLES; k++)
            for (uint32_t i = 0; i < LANES; i++)
                d->sun[sun][v][k][i] = lw_lights_sample_punctual(&d->lights, light, d->point[v][k][i][0],
                                                                 d->point[v][k][i][1], lw_vec3(0, 0, 0))
                                           .direction;
}

/* Suns come first: their candidate's number is that of their directions. */
static void list_candidates(struct lw_direct_pixels *d, const struct lw_pose *pose) {
    const struct lw_scene *scene = d->desc.scene;
    struct lw_direct_candidates *c = &d->candidates;
    c->count = 0;
    for (int suns = 1; suns >= 0; suns--) {
        for (uint32_t l = 0; l < scene->light_count; l++) {
            const struct lw_light *light = &scene->light[l];
            const struct lw_light_state *state = &pose->light[l];
            const bool is_sun = light->kind == LW_LIGHT_DIRECTIONAL;
            if (!d->desc.drawn->light[l] || is_sun != (suns == 1)) continue;
            const uint32_t before = c->count;
            add_candidate(c, is_sun ? LW_DIRECT_SUN : LW_DIRECT_NEAR, l,
                          is_sun ? lw_vec3(0, 0, 0) : state->position_ws, 0,
                          lw_colour_luminance(state->intensity));
            if (c->count == before) continue;
            if (is_sun) aim_sun(d, before, l);
            if (light->kind == LW_LIGHT_SPOT) aim_spot(c, light, state->direction_ws);
        }
    }
    for (uint32_t i = 0; i < d->clusters.count; i++) {
        const struct lw_emitter_cluster *cluster = &d->clusters.cluster[i];
        add_candidate(c, LW_DIRECT_CLUSTER, i, cluster->centre, cluster->radius_m, cluster->intensity);
    }
}

void lw_direct_pixels_begin(struct lw_direct_pixels *d, const struct lw_pose *pose, float white,
                            uint32_t sample) {
    d->white = white > 0 && white < INFINITY ? white : 0;
    d->seed = lw_random_hash2(sample, 0x5eed);
    for (uint32_t v = 0; v < LW_DIRECT_VARIANTS; v++)
        for (uint32_t k = 0; k < LW_DIRECT_SAMPLES; k++)
            for (uint32_t i = 0; i < LANES; i++)
                lw_sampling_point(lw_random_hash2(d->seed, v), k, i, d->point[v][k][i]);
    if (materials_differ(d) || !d->ready) build(d, pose);
    if (!d->ready) return;
    update_places(d, pose, d->fresh);
    d->fresh = false;
    d->lights.punctual = pose->light;
    list_candidates(d, pose);
}
