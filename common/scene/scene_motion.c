#include "common/scene/scene_motion.h"

#include "common/scene/pose.h"

#include <stdlib.h>
#include <string.h>

#define LOOP_S 4.0f
#define KEYS   32u /* per turn: the chords of a circle are within 0.5 % of it */
/* Shares of the scene's longest side: a light's circle, and the smallest to which it shrinks to keep away
 * from surfaces. */
#define CIRCLE_SHARE       0.05f
#define CIRCLE_SHARE_LEAST 0.005f
/* A circle's distance to a surface is at least its radius over this: close to a point light, light has no
 * bound. */
#define CIRCLE_NEAREST 10.0f
#define SWING          (5.0f * LW_PI / 180)
#define OBJECT_SHARE   0.5f
/* For the motions that replace the scene's own. */
#define ROW_S        16.0f /* to and fro */
#define ROW_LEAST_S  12.0f /* an animation shorter than this would turn its mover round too early */
#define CARRY_SIDE_M 3.0f
#define WAY_MARGIN_M 0.3f
#define WAYS         16u
#define SHRUNK       1e-3f
#define FAR_AWAY     1000.0f /* times the scene's longest side */

enum { CARRIES_LIGHT = 1, CARRIES_OBJECT = 2, CARRIES_CAMERA = 4 };

/* ---- objects and lights ---- */

static float emission_of(const struct lw_scene *scene, uint32_t object) {
    const struct lw_mesh *mesh = &scene->mesh[scene->object[object].mesh];
    float strongest = 0;
    for (uint32_t t = 0; t < mesh->triangle_count; t++)
        for (int c = 0; c < 3; c++)
            strongest = fmaxf(strongest, scene->material[mesh->material[t]].emission[c]);
    return strongest;
}

/* Contents of each node and its descendants. */
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
static void *copy_with_room(struct lw_scene *scene, const void *array, size_t count, size_t more,
                            size_t size) {
    void *grown = lw_scene_alloc(scene, count + more, size);
    if (grown && count) memcpy(grown, array, count * size);
    return grown;
}

static struct lw_node node_below(const char *name, uint32_t parent) {
    return (struct lw_node){.name = name, .parent = parent, .rotation = {0, 0, 0, 1}, .scale = {1, 1, 1}};
}

/* One more channel, of a node that is there already; its keys are the caller's to fill. */
static enum lw_status push_channel(struct lw_scene *scene, uint32_t node, enum lw_channel_path path,
                                   enum lw_interpolation interpolation, uint32_t keys, float **out_time_s,
                                   float **out_value) {
    const unsigned width = path == LW_CHANNEL_ROTATION ? 4 : 3;
    struct lw_channel *channel =
        copy_with_room(scene, scene->channel, scene->channel_count, 1, sizeof *channel);
    float *time_s = lw_scene_alloc(scene, keys, sizeof *time_s),
          *value = lw_scene_alloc(scene, (size_t)keys * width, sizeof *value);
    if (!channel || !time_s || !value) return LW_NO_MEMORY;
    channel[scene->channel_count] = (struct lw_channel){.node = node,
                                                        .path = (uint8_t)path,
                                                        .interpolation = (uint8_t)interpolation,
                                                        .key_count = keys,
                                                        .time_s = time_s,
                                                        .value = value};
    scene->channel = channel;
    scene->channel_count++;
    *out_time_s = time_s;
    *out_value = value;
    return LW_OK;
}

/* Two more nodes, the second below the first. Children of the second move with the first. */
static enum lw_status add_mover(struct lw_scene *scene, uint32_t parent, uint32_t *out_node) {
    struct lw_node *node = copy_with_room(scene, scene->node, scene->node_count, 2, sizeof *node);
    if (!node) return LW_NO_MEMORY;
    const uint32_t first = scene->node_count;
    node[first] = node_below("mover", parent);
    node[first + 1] = node_below("moved", first);
    scene->node = node;
    scene->node_count += 2;
    *out_node = first;
    return LW_OK;
}

/* A mover and one channel on it, with its keys' times. What hangs on its second node moves about the point
 * that the nodes' translations name. */
static enum lw_status add_channel(struct lw_scene *scene, uint32_t parent, enum lw_channel_path path,
                                  uint32_t *out_node, float **out_value) {
    if (!(scene->duration_s > 0)) scene->duration_s = LOOP_S;
    uint32_t turns = (uint32_t)fmaxf(1, roundf(scene->duration_s / LOOP_S));
    if (turns > 256) turns = 256;
    const uint32_t keys = turns * KEYS + 1;
    float *time_s;
    enum lw_status status = add_mover(scene, parent, out_node);
    if (status == LW_OK)
        status = push_channel(scene, *out_node, path, LW_INTERPOLATION_LINEAR, keys, &time_s, out_value);
    for (uint32_t k = 0; status == LW_OK && k < keys; k++)
        time_s[k] = scene->duration_s * (float)k / (float)(keys - 1);
    return status;
}

static uint32_t keys_of_last(const struct lw_scene *scene) {
    return scene->channel[scene->channel_count - 1].key_count;
}

static float phase_of(uint32_t key) { return 2 * LW_PI * (float)(key % KEYS) / (float)KEYS; }

/* A vector of world space in the space below a node. Directions only: the linear part, transposed cofactors
 * over the determinant. */
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
    enum lw_status status = add_channel(scene, parent, LW_CHANNEL_TRANSLATION, &mover, &value);
    if (status != LW_OK) return status;
    for (uint32_t k = 0; k < keys_of_last(scene); k++) {
        struct lw_vec3 at = lw_vec3(radius_m * cosf(phase_of(k)), 0, radius_m * sinf(phase_of(k)));
        at = into_node(&pose->node_to_world[parent], at);
        value[3 * k] = at.x, value[3 * k + 1] = at.y, value[3 * k + 2] = at.z;
    }
    *out_node = mover + 1;
    return LW_OK;
}

/* Turns about the world's vertical through `pivot`, a point of the space below `parent`; by a full turn, or
 * to and fro. */
static enum lw_status add_turn(struct lw_scene *scene, const struct lw_pose *pose, uint32_t parent,
                               struct lw_vec3 pivot, bool fully, uint32_t *out_node) {
    uint32_t mover;
    float *value;
    struct lw_vec3 axis = into_node(&pose->node_to_world[parent], lw_vec3(0, 1, 0));
    enum lw_status status = add_channel(scene, parent, LW_CHANNEL_ROTATION, &mover, &value);
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
        return add_turn(scene, pose, scene->light[sun].node, lw_vec3(0, 0, 0), false,
                        &scene->light[sun].node);
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
        e.low = lw_vec3_min(e.low, p);
        e.high = lw_vec3_max(e.high, p);
        low = lw_vec3_min(low, w);
        high = lw_vec3_max(high, w);
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
    return add_turn(scene, pose, scene->object[best].node, pivot, true, &scene->object[best].node);
}

/* ---- one mover of a stated speed ---- */

/* Ways in scenes that measurements name. Their longest side tells them from others of that name. */
static const struct known_way {
    const char *scene;
    enum lw_scene_motion motion;
    float longest_m;
    float from_ws[3], to_ws[3];
} known_ways[] = {
    /* along the wall of the gallery in the shade, where the scene itself has its lantern */
    {"atrium", LW_SCENE_MOTION_LAMP_WALK, 31.2f, {-7.5f, 1.5f, 8.3f}, {4.5f, 1.5f, 8.3f}},
    {"atrium", LW_SCENE_MOTION_CARRY, 31.2f, {7.0f, 1.2f, 1.5f}, {-1.0f, 1.2f, 1.5f}},
    /* the aisle beside the nave, along its curtains: the sun, which is far stronger, does not get there */
    {"Sponza", LW_SCENE_MOTION_LAMP_WALK, 37.2f, {-6.0f, 1.5f, 2.9f}, {6.0f, 1.5f, 2.9f}},
};

static float longest_side(const struct lw_scene *scene, const struct lw_pose *pose) {
    struct lw_vec3 low, high;
    if (!lw_pose_bounds(pose, scene, &low, &high)) return 1;
    return fmaxf(high.x - low.x, fmaxf(high.y - low.y, high.z - low.z));
}

static bool node_moves(const struct lw_pose *pose, uint32_t node) {
    return node != LW_SCENE_NONE && pose->node_moves[node];
}

/* Radiant power, W. A spot has it within the middle of its cone's edge. */
static float power_of(const struct lw_light *light) {
    const float cone =
        light->kind == LW_LIGHT_SPOT ? 1 - cosf(0.5f * (light->inner_cone + light->outer_cone)) : 2;
    return 2 * LW_PI * cone * luminance(light->intensity);
}

static enum lw_status choose_lamp(const struct lw_scene *scene, const struct lw_pose *pose,
                                  struct lw_scene_motion_way *way, struct lw_error *err) {
    /* four kinds, the ones that move first */
    uint32_t glowing[2] = {LW_SCENE_NONE, LW_SCENE_NONE}, light[2] = {LW_SCENE_NONE, LW_SCENE_NONE};
    float brightest[2] = {0, 0}, strongest[2] = {0, 0};
    for (uint32_t o = 0; o < scene->object_count; o++) {
        const float emission = lw_scene_is_spare(scene, o) ? 0 : emission_of(scene, o);
        const bool still = !node_moves(pose, scene->object[o].node);
        if (emission > brightest[still]) brightest[still] = emission, glowing[still] = o;
    }
    for (uint32_t l = 0; l < scene->light_count; l++) {
        const float power = power_of(&scene->light[l]);
        const bool still = !node_moves(pose, scene->light[l].node);
        if (scene->light[l].kind != LW_LIGHT_DIRECTIONAL && power > strongest[still])
            strongest[still] = power, light[still] = l;
    }
    way->light = way->object = LW_SCENE_NONE;
    if (glowing[0] != LW_SCENE_NONE)
        way->object = glowing[0];
    else if (light[0] != LW_SCENE_NONE)
        way->light = light[0];
    else if (light[1] != LW_SCENE_NONE)
        way->light = light[1];
    else if (glowing[1] != LW_SCENE_NONE)
        way->object = glowing[1];
    else
        return lw_status_fail(err, LW_BAD_DATA,
                              "%s: it has no lamp: no point or spot light, and no object that shines",
                              scene->name);
    return LW_OK;
}

static enum lw_status choose_burden(const struct lw_scene *scene, const struct lw_pose *pose, float longest_m,
                                    struct lw_scene_motion_way *way, struct lw_error *err) {
    const float side_m = fminf(CARRY_SIDE_M, OBJECT_SHARE * longest_m);
    float largest_m2 = 0;
    bool moves = false;
    way->light = way->object = LW_SCENE_NONE;
    for (uint32_t o = 0; o < scene->object_count; o++) {
        if (lw_scene_is_spare(scene, o) || emission_of(scene, o) > 0) continue;
        const bool it_moves = node_moves(pose, scene->object[o].node);
        if (moves && !it_moves) continue;
        const struct extent e = measure(scene, pose, o);
        if (!(e.longest_m <= side_m) || !(e.area_m2 > (it_moves == moves ? largest_m2 : 0))) continue;
        way->object = o;
        largest_m2 = e.area_m2;
        moves = it_moves;
    }
    if (way->object != LW_SCENE_NONE) return LW_OK;
    return lw_status_fail(
        err, LW_BAD_DATA,
        "%s: no object of it is small enough to be carried (%g m, half the scene's longest side)",
        scene->name, (double)side_m);
}

static struct lw_vec3 middle_of(const struct lw_scene *scene, const struct lw_pose *pose,
                                const struct lw_scene_motion_way *way) {
    if (way->light != LW_SCENE_NONE) return pose->light[way->light].position_ws;
    const struct extent e = measure(scene, pose, way->object);
    return lw_affine_point(&pose->object_to_world[way->object],
                           lw_vec3_scale(lw_vec3_add(e.low, e.high), 0.5f));
}

/* The t where a line p + t d meets a triangle: p + t d = a + u (b - a) + w (c - a). NAN: it does not. */
static float intersect(struct lw_vec3 p, struct lw_vec3 d, const struct lw_vec3 v[3]) {
    const struct lw_vec3 e = lw_vec3_sub(v[1], v[0]), f = lw_vec3_sub(v[2], v[0]), q = lw_vec3_sub(p, v[0]);
    const struct lw_vec3 df = lw_vec3_cross(d, f), qe = lw_vec3_cross(q, e);
    const float determinant = lw_vec3_dot(df, e);
    if (fabsf(determinant) < 1e-12f) return NAN;
    const float u = lw_vec3_dot(df, q) / determinant, w = lw_vec3_dot(qe, d) / determinant;
    return u >= 0 && w >= 0 && u + w <= 1 ? lw_vec3_dot(qe, f) / determinant : NAN;
}

/* Distance that the mover's middle has either way before it meets another object. */
static void free_line(const struct lw_scene *scene, const struct lw_pose *pose, uint32_t but,
                      struct lw_vec3 p, struct lw_vec3 d, float out_free_m[2]) {
    for (uint32_t o = 0; o < scene->object_count; o++) {
        if (pose->object_hidden[o] || o == but) continue;
        const struct lw_mesh *mesh = &scene->mesh[scene->object[o].mesh];
        for (uint32_t t = 0; t < mesh->triangle_count; t++) {
            struct lw_vec3 v[3];
            for (int k = 0; k < 3; k++)
                v[k] = lw_affine_point(&pose->object_to_world[o], mesh->position[mesh->triangle[t][k]]);
            const float at = intersect(p, d, v);
            if (at >= 0) out_free_m[1] = fminf(out_free_m[1], at);
            if (at < 0) out_free_m[0] = fminf(out_free_m[0], -at);
        }
    }
}

static enum lw_status find_free_way(const struct lw_scene *scene, const struct lw_pose *pose, float longest_m,
                                    struct lw_scene_motion_way *way, struct lw_error *err) {
    const struct lw_vec3 middle = middle_of(scene, pose, way);
    const float enough_m = fminf(way->speed_m_s * 0.5f * ROW_S, longest_m),
                margin_m = fminf(WAY_MARGIN_M, 0.02f * longest_m);
    float longest = 0, best[2] = {0, 0};
    struct lw_vec3 direction = lw_vec3(1, 0, 0);
    for (uint32_t i = 0; i < WAYS && longest < enough_m; i++) {
        const float angle = LW_PI * (float)i / (float)WAYS;
        const struct lw_vec3 d = lw_vec3(cosf(angle), 0, sinf(angle));
        float room[2] = {enough_m + margin_m, enough_m + margin_m};
        free_line(scene, pose, way->object, middle, d, room);
        for (int k = 0; k < 2; k++) room[k] = fmaxf(0, room[k] - margin_m);
        if (!(room[0] + room[1] > longest)) continue;
        longest = room[0] + room[1];
        memcpy(best, room, sizeof best);
        direction = d;
    }
    if (!(longest > margin_m))
        return lw_status_fail(
            err, LW_BAD_DATA, "%s: there is no room in which %s could be moved", scene->name,
            way->light != LW_SCENE_NONE ? scene->light[way->light].name : scene->object[way->object].name);
    const float length = fminf(longest, enough_m),
                back = fminf(best[0], fmaxf(0.5f * length, length - best[1]));
    way->from_ws = lw_vec3_mad(middle, direction, -back);
    way->to_ws = lw_vec3_mad(middle, direction, length - back);
    return LW_OK;
}

static enum lw_status find_way(const struct lw_scene *scene, const struct lw_pose *pose,
                               enum lw_scene_motion motion, struct lw_scene_motion_way *way,
                               struct lw_error *err) {
    const float longest_m = longest_side(scene, pose);
    const bool lamp = motion != LW_SCENE_MOTION_CARRY;
    enum lw_status status =
        lamp ? choose_lamp(scene, pose, way, err) : choose_burden(scene, pose, longest_m, way, err);
    if (status != LW_OK) return status;
    way->speed_m_s = lamp ? LW_SCENE_MOTION_WALK_M_S : LW_SCENE_MOTION_CARRY_M_S;
    for (size_t i = 0; i < sizeof known_ways / sizeof *known_ways; i++) {
        const struct known_way *k = &known_ways[i];
        if ((k->motion == LW_SCENE_MOTION_CARRY) == lamp || strcmp(k->scene, scene->name) != 0 ||
            fabsf(k->longest_m - longest_m) > 0.05f * longest_m)
            continue;
        way->from_ws = lw_vec3(k->from_ws[0], k->from_ws[1], k->from_ws[2]);
        way->to_ws = lw_vec3(k->to_ws[0], k->to_ws[1], k->to_ws[2]);
        return LW_OK;
    }
    return find_free_way(scene, pose, longest_m, way, err);
}

enum lw_status lw_scene_motion_find_way(const struct lw_scene *scene, enum lw_scene_motion motion,
                                        struct lw_scene_motion_way *out_way, struct lw_error *err) {
    struct lw_pose pose;
    struct lw_scene_motion_way way = {0};
    if (lw_pose_init(&pose, scene) != LW_OK)
        return lw_status_fail(err, LW_NO_MEMORY, "no memory for the scene's motion");
    enum lw_status status = find_way(scene, &pose, motion, &way, err);
    lw_pose_finish(&pose);
    if (status == LW_OK) *out_way = way;
    return status;
}

/* Number of round trips of the mover in the animation. */
static uint32_t rounds_of(const struct lw_scene *scene) {
    return (uint32_t)fmaxf(1, roundf(scene->duration_s / ROW_S));
}

/* The topmost animated node above one: a mover takes along all that hangs there. */
static uint32_t root_of(const struct lw_scene *scene, const struct lw_pose *was, uint32_t node) {
    uint32_t root = LW_SCENE_NONE;
    for (; node_moves(was, node); node = scene->node[node].parent) root = node;
    return root;
}

static uint32_t *node_of(struct lw_scene *scene, const struct lw_scene_motion_way *way) {
    return way->light != LW_SCENE_NONE ? &scene->light[way->light].node : &scene->object[way->object].node;
}

/* was: which nodes the scene animated; now: the pose without that animation. */
static enum lw_status go_along(struct lw_scene *scene, const struct lw_pose *was, const struct lw_pose *now,
                               struct lw_scene_motion_way *way) {
    const uint32_t rounds = rounds_of(scene), keys = 2 * rounds + 1;
    const float half_s = scene->duration_s / (float)(2 * rounds),
                length = lw_vec3_length(lw_vec3_sub(way->to_ws, way->from_ws));
    way->speed_m_s = fminf(way->speed_m_s, length / half_s);
    way->to_ws =
        lw_vec3_mad(way->from_ws, lw_vec3_sub(way->to_ws, way->from_ws), way->speed_m_s * half_s / length);
    uint32_t *hangs_on = node_of(scene, way), mover = root_of(scene, was, *hangs_on), parent;
    const struct lw_vec3 middle = middle_of(scene, now, way);
    float base[3] = {0, 0, 0}, *time_s, *value;
    if (mover != LW_SCENE_NONE) {
        memcpy(base, scene->node[mover].translation, sizeof base);
        parent = scene->node[mover].parent;
    } else {
        parent = *hangs_on;
        enum lw_status status = add_mover(scene, parent, &mover);
        if (status != LW_OK) return status;
        *hangs_on = mover + 1;
    }
    enum lw_status status =
        push_channel(scene, mover, LW_CHANNEL_TRANSLATION, LW_INTERPOLATION_LINEAR, keys, &time_s, &value);
    if (status != LW_OK) return status;
    const struct lw_affine *to_world =
        parent == LW_SCENE_NONE ? &LW_AFFINE_IDENTITY : &now->node_to_world[parent];
    for (uint32_t k = 0; k < keys; k++) {
        const struct lw_vec3 at = k % 2 ? way->to_ws : way->from_ws,
                             off = into_node(to_world, lw_vec3_sub(at, middle));
        time_s[k] = scene->duration_s * (float)k / (float)(keys - 1);
        value[3 * k] = base[0] + off.x, value[3 * k + 1] = base[1] + off.y,
                  value[3 * k + 2] = base[2] + off.z;
    }
    return LW_OK;
}

/* On, off from LW_SCENE_MOTION_OFF_S to LW_SCENE_MOTION_ON_S; in every round. */
static enum lw_status switch_lamp(struct lw_scene *scene, const struct lw_pose *now, float longest_m,
                                  const struct lw_scene_motion_way *way, float *out_far_m) {
    const uint32_t rounds = rounds_of(scene), keys = 3 * rounds;
    const bool shrinks = way->object != LW_SCENE_NONE;
    uint32_t *hangs_on = node_of(scene, way), mover;
    const uint32_t parent = *hangs_on;
    float *time_s, *value;
    enum lw_status status = add_mover(scene, parent, &mover);
    if (status == LW_OK)
        status = push_channel(scene, mover, shrinks ? LW_CHANNEL_SCALE : LW_CHANNEL_TRANSLATION,
                              LW_INTERPOLATION_STEP, keys, &time_s, &value);
    if (status != LW_OK) return status;
    *hangs_on = mover + 1;
    /* the middle of the way is where it stands; it shrinks about its own middle */
    const struct lw_affine *to_parent = &now->node_to_world[parent];
    struct lw_vec3 middle = middle_of(scene, now, way),
                   place = lw_vec3_scale(lw_vec3_add(way->from_ws, way->to_ws), 0.5f);
    const struct lw_vec3 off = into_node(to_parent, lw_vec3_sub(place, middle));
    struct lw_vec3 pivot = lw_vec3(0, 0, 0), lit = off, dark = off;
    *out_far_m = 0;
    if (shrinks) {
        const struct extent e = measure(scene, now, way->object);
        pivot = lw_vec3_scale(lw_vec3_add(e.low, e.high), 0.5f);
        lit = lw_vec3(1, 1, 1), dark = lw_vec3(SHRUNK, SHRUNK, SHRUNK);
    } else {
        *out_far_m = FAR_AWAY * longest_m;
        dark = lw_vec3_add(off, into_node(to_parent, lw_vec3(0, *out_far_m, 0)));
    }
    const struct lw_vec3 to = lw_vec3_add(pivot, off);
    scene->node[mover].translation[0] = to.x, scene->node[mover].translation[1] = to.y,
    scene->node[mover].translation[2] = to.z;
    scene->node[mover + 1].translation[0] = -pivot.x, scene->node[mover + 1].translation[1] = -pivot.y,
                        scene->node[mover + 1].translation[2] = -pivot.z;
    static const float moment_s[3] = {0, LW_SCENE_MOTION_OFF_S, LW_SCENE_MOTION_ON_S};
    for (uint32_t k = 0; k < keys; k++) {
        const struct lw_vec3 v = k % 3 == 1 ? dark : lit;
        time_s[k] = scene->duration_s * (float)(k / 3) / (float)rounds + moment_s[k % 3];
        value[3 * k] = v.x, value[3 * k + 1] = v.y, value[3 * k + 2] = v.z;
    }
    return LW_OK;
}

static enum lw_status swing_sun(struct lw_scene *scene, const struct lw_pose *now,
                                struct lw_scene_motion_report *report, struct lw_error *err) {
    uint32_t sun = LW_SCENE_NONE;
    for (uint32_t l = 0; l < scene->light_count; l++) {
        const float power = luminance(scene->light[l].intensity);
        if (scene->light[l].kind == LW_LIGHT_DIRECTIONAL && power > 0 &&
            (sun == LW_SCENE_NONE || power > luminance(scene->light[sun].intensity)))
            sun = l;
    }
    if (sun == LW_SCENE_NONE)
        return lw_status_fail(err, LW_BAD_DATA, "%s: it has no sun: no directional light", scene->name);
    const uint32_t rounds = rounds_of(scene), keys = 2 * rounds + 1, parent = scene->light[sun].node;
    const float half_s = scene->duration_s / (float)(2 * rounds),
                swing = LW_SCENE_MOTION_SWING_DEG_S * LW_PI / 180 * half_s;
    /* across the direction, as upright as can be: the way is level in its middle */
    const struct lw_vec3 d = now->light[sun].direction_ws;
    struct lw_vec3 axis = lw_vec3_mad(lw_vec3(0, 1, 0), d, -d.y);
    axis = lw_vec3_length(axis) > 1e-3f ? lw_vec3_normalize(axis) : lw_vec3(1, 0, 0);
    axis = lw_vec3_normalize(into_node(&now->node_to_world[parent], axis));
    uint32_t mover;
    float *time_s, *value;
    enum lw_status status = add_mover(scene, parent, &mover);
    if (status == LW_OK)
        status =
            push_channel(scene, mover, LW_CHANNEL_ROTATION, LW_INTERPOLATION_LINEAR, keys, &time_s, &value);
    if (status != LW_OK) return status;
    scene->light[sun].node = mover + 1;
    for (uint32_t k = 0; k < keys; k++) {
        const float angle = k % 2 ? 0.5f * swing : -0.5f * swing, s = sinf(0.5f * angle);
        time_s[k] = scene->duration_s * (float)k / (float)(keys - 1);
        value[4 * k] = axis.x * s, value[4 * k + 1] = axis.y * s, value[4 * k + 2] = axis.z * s;
        value[4 * k + 3] = cosf(0.5f * angle);
    }
    report->light = scene->light[sun].name;
    report->speed_deg_s = LW_SCENE_MOTION_SWING_DEG_S;
    return LW_OK;
}

/* was: the pose before channels were dropped. */
static enum lw_status make_row(struct lw_scene *scene, enum lw_scene_motion motion, const struct lw_pose *was,
                               struct lw_scene_motion_way *way, struct lw_scene_motion_report *report,
                               struct lw_error *err) {
    if (report->kept == 0 || scene->duration_s < ROW_LEAST_S) scene->duration_s = ROW_S;
    struct lw_pose now;
    enum lw_status status = lw_pose_init(&now, scene);
    if (status != LW_OK) return status;
    if (motion == LW_SCENE_MOTION_SUN_SWING) {
        status = swing_sun(scene, &now, report, err);
    } else {
        const char *name =
            way->light != LW_SCENE_NONE ? scene->light[way->light].name : scene->object[way->object].name;
        status = motion == LW_SCENE_MOTION_LAMP_SWITCH
                     ? switch_lamp(scene, &now, longest_side(scene, &now), way, &report->switch_m)
                     : go_along(scene, was, &now, way);
        *(motion == LW_SCENE_MOTION_CARRY ? &report->object : &report->light) = name;
        if (motion != LW_SCENE_MOTION_LAMP_SWITCH) report->speed_m_s = way->speed_m_s;
        report->from_ws = way->from_ws;
        report->to_ws = way->to_ws;
    }
    lw_pose_finish(&now);
    return status;
}

/* ---- the whole ---- */

static const char *const names[] = {"static",    "light",     "object",      "all",
                                    "lamp-walk", "sun-swing", "lamp-switch", "carry"};
_Static_assert(sizeof names / sizeof *names == LW_SCENE_MOTION_COUNT, "each motion has a name");

const char *lw_scene_motion_name(enum lw_scene_motion motion) { return names[motion]; }

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
    const bool row = motion >= LW_SCENE_MOTION_LAMP_WALK;
    struct lw_scene_motion_way way = {0};
    if (row && motion != LW_SCENE_MOTION_SUN_SWING) status = find_way(scene, &pose, motion, &way, err);
    bool lights = false, objects = false;
    for (uint32_t c = 0; status == LW_OK && c < scene->channel_count; c++) {
        uint8_t carried = load[scene->channel[c].node];
        if (!belongs(carried, motion)) continue;
        lights |= (carried & CARRIES_LIGHT) != 0;
        objects |= (carried & (CARRIES_LIGHT | CARRIES_OBJECT)) == CARRIES_OBJECT;
        scene->channel[report.kept++] = scene->channel[c];
    }
    if (status == LW_OK) {
        report.dropped = scene->channel_count - report.kept;
        scene->channel_count = report.kept;
        lights |= belongs(CARRIES_LIGHT, motion) && scene->light_channel_count;
        if (!belongs(CARRIES_LIGHT, motion)) { /* nor does a light dim that is to stand still */
            report.dropped += scene->light_channel_count;
            scene->light_channel_count = 0;
        }
    }

    struct lw_vec3 low, high;
    float longest_m = 1;
    if (lw_pose_bounds(&pose, scene, &low, &high))
        longest_m = fmaxf(high.x - low.x, fmaxf(high.y - low.y, high.z - low.z));
    bool wants_light = motion == LW_SCENE_MOTION_LIGHT || motion == LW_SCENE_MOTION_ALL;
    bool wants_object = motion == LW_SCENE_MOTION_OBJECT || motion == LW_SCENE_MOTION_ALL;
    if (status == LW_OK && row) status = make_row(scene, motion, &pose, &way, &report, err);
    /* the object first: it is chosen among those that the pose knows */
    if (status == LW_OK && wants_object && !objects)
        status = move_an_object(scene, &pose, longest_m, &report.object, err);
    if (status == LW_OK && wants_light && !lights)
        status = move_a_light(scene, &pose, longest_m, &report.light, err);
    if (status == LW_NO_MEMORY) lw_status_fail(err, status, "no memory for the scene's motion");
    lw_pose_finish(&pose);
    free(load);
    if (status == LW_OK) *out_report = report;
    return status;
}
