#include "common/scene/scene_motion.h"

#include "common/scene/pose.h"

#include <stdlib.h>
#include <string.h>

#define LOOP_S 4.0f
#define KEYS   32u /* per turn: the chords of a circle are within 0.5 % of it */
/* Of the scene's longest side: a light's circle, and the smallest to which it shrinks to keep away from surfaces. */
#define CIRCLE_SHARE       0.05f
#define CIRCLE_SHARE_LEAST 0.005f
/* So many times nearer than its radius a circle may come to a surface: there the light of a point has no bound. */
#define CIRCLE_NEAREST 10.0f
#define SWING          (5.0f * LW_PI / 180)
#define OBJECT_SHARE   0.5f

enum { CARRIES_LIGHT = 1, CARRIES_OBJECT = 2, CARRIES_CAMERA = 4 };

/* ---- what there is ---- */

static float emission_of(const struct lw_scene *scene, uint32_t object) {
    const struct lw_mesh *mesh = &scene->mesh[scene->object[object].mesh];
    float strongest = 0;
    for (uint32_t t = 0; t < mesh->triangle_count; t++)
        for (int c = 0; c < 3; c++)
            strongest = fmaxf(strongest, scene->material[mesh->material[t]].emission[c]);
    return strongest;
}

/* What each node and its descendants carry. */
static uint8_t *list_loads(const struct lw_scene *scene) {
    uint8_t *load = calloc((size_t)scene->node_count + 1, 1);
    if (!load) return NULL;
    for (uint32_t o = 0; o < scene->object_count; o++)
        if (!lw_scene_is_spare(scene, o))
            load[scene->object[o].node] |= emission_of(scene, o) > 0 ? CARRIES_LIGHT : CARRIES_OBJECT;
    for (uint32_t l = 0; l < scene->light_count; l++) load[scene->light[l].node] |= CARRIES_LIGHT;
    for (uint32_t c = 0; c < scene->camera_count; c++) load[scene->camera[c].node] |= CARRIES_CAMERA;
    for (uint32_t n = scene->node_count; n-- > 0;) /* children come after their parents */
        if (scene->node[n].parent != LW_SCENE_NONE) load[scene->node[n].parent] |= load[n];
    return load;
}

static bool belongs(uint8_t load, enum lw_scene_motion motion) {
    bool light = load & CARRIES_LIGHT, object = load & CARRIES_OBJECT;
    if (light) return motion == LW_SCENE_MOTION_LIGHT || motion == LW_SCENE_MOTION_ALL;
    if (object) return motion == LW_SCENE_MOTION_OBJECT || motion == LW_SCENE_MOTION_ALL;
    return true; /* cameras, and nodes that carry nothing */
}

static float luminance(const float rgb[3]) { return 0.2126f * rgb[0] + 0.7152f * rgb[1] + 0.0722f * rgb[2]; }

/* ---- making movers ---- */

/* A copy with room for some more at its end. */
static void *grow(struct lw_scene *scene, const void *array, size_t count, size_t more, size_t size) {
    void *grown = lw_scene_alloc(scene, count + more, size);
    if (grown && count) memcpy(grown, array, count * size);
    return grown;
}

static struct lw_node node_below(const char *name, uint32_t parent) {
    return (struct lw_node){.name = name, .parent = parent, .rotation = {0, 0, 0, 1}, .scale = {1, 1, 1}};
}

/* Two more nodes, the second below the first, and one channel on the first, with its keys. Whoever hangs on the second
 * moves about the point that the nodes' translations name. */
static enum lw_status add_channel(struct lw_scene *scene, uint32_t parent, enum lw_channel_path path,
                                  unsigned width, uint32_t *out_node, float **out_value) {
    if (!(scene->duration_s > 0)) scene->duration_s = LOOP_S;
    uint32_t turns = (uint32_t)fmaxf(1, roundf(scene->duration_s / LOOP_S)), keys = KEYS;
    if (turns > 256) turns = 256;
    keys = turns * KEYS + 1;
    struct lw_node *node = grow(scene, scene->node, scene->node_count, 2, sizeof *node);
    struct lw_channel *channel = grow(scene, scene->channel, scene->channel_count, 1, sizeof *channel);
    float *time_s = lw_scene_alloc(scene, keys, sizeof *time_s),
          *value = lw_scene_alloc(scene, (size_t)keys * width, sizeof *value);
    if (!node || !channel || !time_s || !value) return LW_NO_MEMORY;
    for (uint32_t k = 0; k < keys; k++) time_s[k] = scene->duration_s * (float)k / (float)(keys - 1);
    uint32_t first = scene->node_count;
    node[first] = node_below("mover", parent);
    node[first + 1] = node_below("moved", first);
    channel[scene->channel_count] = (struct lw_channel){.node = first,
                                                        .path = (uint8_t)path,
                                                        .interpolation = LW_INTERPOLATION_LINEAR,
                                                        .key_count = keys,
                                                        .time_s = time_s,
                                                        .value = value};
    scene->node = node;
    scene->node_count += 2;
    scene->channel = channel;
    scene->channel_count++;
    *out_node = first;
    *out_value = value;
    return LW_OK;
}

static uint32_t keys_of_last(const struct lw_scene *scene) {
    return scene->channel[scene->channel_count - 1].key_count;
}

static float phase_of(uint32_t key) { return 2 * LW_PI * (float)(key % KEYS) / (float)KEYS; }

/* A vector of world space in the space below a node. Directions only: the linear part, transposed cofactors over the
 * determinant. */
static struct lw_vec3 into_node(const struct lw_affine *to_world, struct lw_vec3 v) {
    float determinant = lw_affine_determinant(to_world);
    if (fabsf(determinant) < 1e-30f) return lw_vec3(0, 0, 0);
    struct lw_vec3 column[3];
    for (int c = 0; c < 3; c++) column[c] = lw_vec3(to_world->m[0][c], to_world->m[1][c], to_world->m[2][c]);
    float scale = 1 / determinant;
    return lw_vec3(lw_vec3_dot(lw_vec3_cross(column[1], column[2]), v) * scale,
                   lw_vec3_dot(lw_vec3_cross(column[2], column[0]), v) * scale,
                   lw_vec3_dot(lw_vec3_cross(column[0], column[1]), v) * scale);
}

static enum lw_status circle(struct lw_scene *scene, const struct lw_pose *pose, uint32_t parent,
                             float radius_m, uint32_t *out_node) {
    uint32_t mover;
    float *value;
    enum lw_status status = add_channel(scene, parent, LW_CHANNEL_TRANSLATION, 3, &mover, &value);
    if (status != LW_OK) return status;
    for (uint32_t k = 0; k < keys_of_last(scene); k++) {
        struct lw_vec3 at = lw_vec3(radius_m * cosf(phase_of(k)), 0, radius_m * sinf(phase_of(k)));
        at = into_node(&pose->node_to_world[parent], at);
        value[3 * k] = at.x, value[3 * k + 1] = at.y, value[3 * k + 2] = at.z;
    }
    *out_node = mover + 1;
    return LW_OK;
}

/* Turns about the world's vertical through `pivot`, a point of the space below `parent`; by a full turn, or to and fro. */
static enum lw_status turn(struct lw_scene *scene, const struct lw_pose *pose, uint32_t parent,
                           struct lw_vec3 pivot, bool fully, uint32_t *out_node) {
    uint32_t mover;
    float *value;
    struct lw_vec3 axis = into_node(&pose->node_to_world[parent], lw_vec3(0, 1, 0));
    enum lw_status status = add_channel(scene, parent, LW_CHANNEL_ROTATION, 4, &mover, &value);
    if (status != LW_OK) return status;
    axis = lw_vec3_normalize(axis);
    for (uint32_t k = 0; k < keys_of_last(scene); k++) {
        float angle = fully ? phase_of(k) : SWING * sinf(phase_of(k)), s = sinf(0.5f * angle);
        value[4 * k] = axis.x * s, value[4 * k + 1] = axis.y * s, value[4 * k + 2] = axis.z * s;
        value[4 * k + 3] = cosf(0.5f * angle);
    }
    const float to[3] = {pivot.x, pivot.y, pivot.z}, back[3] = {-pivot.x, -pivot.y, -pivot.z};
    memcpy(scene->node[mover].translation, to, sizeof to);
    memcpy(scene->node[mover + 1].translation, back, sizeof back);
    *out_node = mover + 1;
    return LW_OK;
}

/* From a point to the nearest of a segment. */
static float distance_to_edge(struct lw_vec3 p, struct lw_vec3 a, struct lw_vec3 b) {
    const struct lw_vec3 ab = lw_vec3_sub(b, a);
    const float length2 = lw_vec3_dot(ab, ab);
    const float t = length2 > 0 ? fminf(1, fmaxf(0, lw_vec3_dot(lw_vec3_sub(p, a), ab) / length2)) : 0;
    return lw_vec3_length(lw_vec3_sub(p, lw_vec3_mad(a, ab, t)));
}

static float distance_to_triangle(struct lw_vec3 p, const struct lw_vec3 v[3]) {
    const struct lw_vec3 n = lw_vec3_cross(lw_vec3_sub(v[1], v[0]), lw_vec3_sub(v[2], v[0]));
    float nearest = INFINITY;
    bool above = true; /* inside the prism over it */
    for (int k = 0; k < 3; k++) {
        const struct lw_vec3 a = v[k], b = v[(k + 1) % 3];
        nearest = fminf(nearest, distance_to_edge(p, a, b));
        above &= lw_vec3_dot(lw_vec3_cross(n, lw_vec3_sub(b, a)), lw_vec3_sub(p, a)) > 0;
    }
    return above ? fabsf(lw_vec3_dot(n, lw_vec3_sub(p, v[0]))) / lw_vec3_length(n) : nearest;
}

/* m in world space, to any surface. */
static float distance_to_scene(const struct lw_scene *scene, const struct lw_pose *pose, struct lw_vec3 p) {
    float nearest = INFINITY;
    for (uint32_t o = 0; o < scene->object_count; o++) {
        if (pose->object_hidden[o]) continue;
        const struct lw_mesh *mesh = &scene->mesh[scene->object[o].mesh];
        for (uint32_t t = 0; t < mesh->triangle_count; t++) {
            struct lw_vec3 v[3];
            for (int k = 0; k < 3; k++)
                v[k] = lw_affine_point(&pose->object_to_world[o], mesh->position[mesh->triangle[t][k]]);
            nearest = fminf(nearest, distance_to_triangle(p, v));
        }
    }
    return nearest;
}

/* All of the circle around a point stays clear of surfaces, if there is room for any. */
static float clear_radius(const struct lw_scene *scene, const struct lw_pose *pose, struct lw_vec3 centre,
                          float longest_m) {
    const float room = distance_to_scene(scene, pose, centre) * CIRCLE_NEAREST / (CIRCLE_NEAREST + 1);
    return fminf(CIRCLE_SHARE * longest_m, fmaxf(CIRCLE_SHARE_LEAST * longest_m, room));
}

static enum lw_status move_a_light(struct lw_scene *scene, const struct lw_pose *pose, float longest_m,
                                   const char **out_name, struct lw_error *err) {
    uint32_t best = LW_SCENE_NONE, sun = LW_SCENE_NONE, lamp = LW_SCENE_NONE;
    for (uint32_t l = 0; l < scene->light_count; l++) {
        float power = luminance(scene->light[l].intensity);
        uint32_t *of_kind = scene->light[l].kind == LW_LIGHT_DIRECTIONAL ? &sun : &best;
        if (power > 0 && (*of_kind == LW_SCENE_NONE || power > luminance(scene->light[*of_kind].intensity)))
            *of_kind = l;
    }
    float strongest = 0;
    for (uint32_t o = 0; o < scene->object_count; o++) {
        float emission = emission_of(scene, o);
        if (!(emission > strongest) || lw_scene_is_spare(scene, o)) continue;
        lamp = o;
        strongest = emission;
    }
    if (best != LW_SCENE_NONE) {
        *out_name = scene->light[best].name;
        const float radius = clear_radius(scene, pose, pose->light[best].position_ws, longest_m);
        return circle(scene, pose, scene->light[best].node, radius, &scene->light[best].node);
    }
    if (lamp != LW_SCENE_NONE) {
        *out_name = scene->object[lamp].name;
        return circle(scene, pose, scene->object[lamp].node, CIRCLE_SHARE * longest_m,
                      &scene->object[lamp].node);
    }
    if (sun != LW_SCENE_NONE) {
        *out_name = scene->light[sun].name;
        return turn(scene, pose, scene->light[sun].node, lw_vec3(0, 0, 0), false, &scene->light[sun].node);
    }
    return lw_status_fail(err, LW_BAD_DATA, "%s: no light of it moves, and it has none that could be moved",
                          scene->name);
}

struct extent {
    struct lw_vec3 low, high; /* object space */
    float longest_m, area_m2; /* world space */
};

static struct extent measure(const struct lw_scene *scene, const struct lw_pose *pose, uint32_t object) {
    const struct lw_mesh *mesh = &scene->mesh[scene->object[object].mesh];
    const struct lw_affine *to_world = &pose->object_to_world[object];
    struct extent e = {.low = lw_vec3(INFINITY, INFINITY, INFINITY),
                       .high = lw_vec3(-INFINITY, -INFINITY, -INFINITY)};
    struct lw_vec3 low = e.low, high = e.high;
    for (uint32_t v = 0; v < mesh->vertex_count; v++) {
        struct lw_vec3 p = mesh->position[v], w = lw_affine_point(to_world, p);
        e.low = lw_vec3(fminf(e.low.x, p.x), fminf(e.low.y, p.y), fminf(e.low.z, p.z));
        e.high = lw_vec3(fmaxf(e.high.x, p.x), fmaxf(e.high.y, p.y), fmaxf(e.high.z, p.z));
        low = lw_vec3(fminf(low.x, w.x), fminf(low.y, w.y), fminf(low.z, w.z));
        high = lw_vec3(fmaxf(high.x, w.x), fmaxf(high.y, w.y), fmaxf(high.z, w.z));
    }
    e.longest_m = fmaxf(high.x - low.x, fmaxf(high.y - low.y, high.z - low.z));
    for (uint32_t t = 0; t < mesh->triangle_count; t++) {
        const uint32_t *v = mesh->triangle[t];
        struct lw_vec3 a = lw_affine_point(to_world, mesh->position[v[0]]);
        struct lw_vec3 u = lw_vec3_sub(lw_affine_point(to_world, mesh->position[v[1]]), a);
        struct lw_vec3 w = lw_vec3_sub(lw_affine_point(to_world, mesh->position[v[2]]), a);
        e.area_m2 += 0.5f * lw_vec3_length(lw_vec3_cross(u, w));
    }
    return e;
}

static enum lw_status move_an_object(struct lw_scene *scene, const struct lw_pose *pose, float longest_m,
                                     const char **out_name, struct lw_error *err) {
    uint32_t best = LW_SCENE_NONE;
    struct extent of_best = {.area_m2 = 0};
    for (uint32_t o = 0; o < scene->object_count; o++) {
        if (lw_scene_is_spare(scene, o) || emission_of(scene, o) > 0) continue;
        struct extent e = measure(scene, pose, o);
        if (!(e.longest_m <= OBJECT_SHARE * longest_m) || !(e.area_m2 > of_best.area_m2)) continue;
        best = o;
        of_best = e;
    }
    if (best == LW_SCENE_NONE)
        return lw_status_fail(err, LW_BAD_DATA,
                              "%s: no object of it moves, and none is small enough to be moved (half the "
                              "scene's longest side)",
                              scene->name);
    struct lw_vec3 pivot = lw_vec3_scale(lw_vec3_add(of_best.low, of_best.high), 0.5f);
    *out_name = scene->object[best].name;
    return turn(scene, pose, scene->object[best].node, pivot, true, &scene->object[best].node);
}

/* ---- the whole ---- */

enum lw_status lw_scene_motion_set(struct lw_scene *scene, enum lw_scene_motion motion,
                                   struct lw_scene_motion_report *out_report, struct lw_error *err) {
    struct lw_scene_motion_report report = {0};
    struct lw_pose pose;
    uint8_t *load = list_loads(scene);
    enum lw_status status = load ? lw_pose_init(&pose, scene) : LW_NO_MEMORY;
    if (status != LW_OK) {
        free(load);
        return lw_status_fail(err, status, "no memory for the scene's motion");
    }
    bool lights = false, objects = false;
    for (uint32_t c = 0; c < scene->channel_count; c++) {
        uint8_t carried = load[scene->channel[c].node];
        if (!belongs(carried, motion)) continue;
        lights |= (carried & CARRIES_LIGHT) != 0;
        objects |= (carried & (CARRIES_LIGHT | CARRIES_OBJECT)) == CARRIES_OBJECT;
        scene->channel[report.kept++] = scene->channel[c];
    }
    report.dropped = scene->channel_count - report.kept;
    scene->channel_count = report.kept;

    struct lw_vec3 low, high;
    float longest_m = 1;
    if (lw_pose_bounds(&pose, scene, &low, &high))
        longest_m = fmaxf(high.x - low.x, fmaxf(high.y - low.y, high.z - low.z));
    bool wants_light = motion == LW_SCENE_MOTION_LIGHT || motion == LW_SCENE_MOTION_ALL;
    bool wants_object = motion == LW_SCENE_MOTION_OBJECT || motion == LW_SCENE_MOTION_ALL;
    /* the object first: it is chosen among those that the pose knows */
    if (wants_object && !objects) status = move_an_object(scene, &pose, longest_m, &report.object, err);
    if (status == LW_OK && wants_light && !lights)
        status = move_a_light(scene, &pose, longest_m, &report.light, err);
    if (status == LW_NO_MEMORY) lw_status_fail(err, status, "no memory for the scene's motion");
    lw_pose_finish(&pose);
    free(load);
    if (status == LW_OK) *out_report = report;
    return status;
}
