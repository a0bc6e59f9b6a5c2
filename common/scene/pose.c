#include "common/scene/pose.h"

#include "common/base/invariant.h"

#include <stdlib.h>
#include <string.h>

/* A node's place relative to its parent. */
struct lw_pose_local {
    uint32_t node;
    float translation[3], rotation[4], scale[3];
};

static void find_movers(struct lw_pose *pose, const struct lw_scene *scene) {
    for (uint32_t i = 0; i < scene->channel_count; i++) pose->node_moves[scene->channel[i].node] = true;
    for (uint32_t i = 0; i < scene->node_count; i++) { /* parents come before their children */
        uint32_t parent = scene->node[i].parent;
        if (parent != LW_SCENE_NONE && pose->node_moves[parent]) pose->node_moves[i] = true;
    }
}

static int compare_nodes(const void *a, const void *b) {
    const uint32_t x = ((const struct lw_pose_local *)a)->node, y = ((const struct lw_pose_local *)b)->node;
    return (x > y) - (x < y);
}

/* Lists the nodes with channels, in order. */
static void list_locals(struct lw_pose *pose, const struct lw_scene *scene) {
    for (uint32_t i = 0; i < scene->channel_count; i++) pose->local[i].node = scene->channel[i].node;
    qsort(pose->local, scene->channel_count, sizeof *pose->local, compare_nodes);
    for (uint32_t i = 0; i < scene->channel_count; i++)
        if (!i || pose->local[i].node != pose->local[i - 1].node)
            pose->local[pose->local_count++].node = pose->local[i].node;
}

/* calloc of 0 elements may be NULL: one more of each keeps NULL for "out of memory" */
static bool allocate_state(struct lw_pose *pose, const struct lw_scene *scene) {
    const size_t objects = (size_t)scene->object_count + 1;
    pose->object_to_world = calloc(objects, sizeof *pose->object_to_world);
    pose->object_hidden = calloc(objects, sizeof *pose->object_hidden);
    pose->object_spare = calloc(objects, sizeof *pose->object_spare);
    pose->object_dynamic = calloc(objects, sizeof *pose->object_dynamic);
    pose->light = calloc((size_t)scene->light_count + 1, sizeof *pose->light);
    pose->material = calloc((size_t)scene->material_count + 1, sizeof *pose->material);
    pose->node_moves = calloc((size_t)scene->node_count + 1, sizeof *pose->node_moves);
    return pose->object_to_world && pose->object_hidden && pose->object_spare && pose->object_dynamic &&
           pose->light && pose->material && pose->node_moves;
}

static bool allocate_nodes(struct lw_pose *pose, const struct lw_scene *scene) {
    pose->node_to_world = calloc((size_t)scene->node_count + 1, sizeof *pose->node_to_world);
    pose->local = calloc((size_t)scene->channel_count + 1, sizeof *pose->local);
    return pose->node_to_world && pose->local;
}

enum lw_status lw_pose_init(struct lw_pose *pose, const struct lw_scene *scene) {
    memset(pose, 0, sizeof *pose);
    if (!allocate_state(pose, scene) || !allocate_nodes(pose, scene)) {
        lw_pose_finish(pose);
        return LW_NO_MEMORY;
    }
    find_movers(pose, scene);
    list_locals(pose, scene);
    for (uint32_t i = 0; i < scene->object_count; i++) pose->object_dynamic[i] = lw_scene_is_spare(scene, i);
    lw_pose_evaluate(pose, scene, 0);
    return LW_OK;
}

enum lw_status lw_pose_init_copy(struct lw_pose *pose, const struct lw_pose *from,
                                 const struct lw_scene *scene) {
    memset(pose, 0, sizeof *pose);
    if (!allocate_state(pose, scene)) {
        lw_pose_finish(pose);
        return LW_NO_MEMORY;
    }
    memcpy(pose->node_moves, from->node_moves, scene->node_count * sizeof *pose->node_moves);
    lw_pose_copy(pose, from, scene);
    return LW_OK;
}

void lw_pose_finish(struct lw_pose *pose) {
    free(pose->node_moves);
    free(pose->local);
    free(pose->node_to_world);
    free(pose->material);
    free(pose->light);
    free(pose->object_dynamic);
    free(pose->object_spare);
    free(pose->object_hidden);
    free(pose->object_to_world);
    memset(pose, 0, sizeof *pose);
}

static double wrap_time(double time_s, double duration_s) {
    if (!(duration_s > 0) || !isfinite(time_s)) return 0;
    double wrapped = fmod(time_s, duration_s);
    if (wrapped < 0) wrapped += duration_s;
    return wrapped < duration_s ? wrapped : 0; /* a tiny negative time rounds up to the duration */
}

static void normalize_quaternion(float q[4]) {
    float length = sqrtf(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    if (length > 1e-12f)
        for (int i = 0; i < 4; i++) q[i] /= length;
    else
        q[0] = q[1] = q[2] = 0, q[3] = 1; /* a cubic curve may pass through 0, which is no rotation */
}

/* The last key at or before the time; the first key if there is none. */
static uint32_t find_key(const struct lw_channel *channel, double time_s) {
    uint32_t low = 0, high = channel->key_count;
    while (high - low > 1) {
        uint32_t middle = low + (high - low) / 2;
        if ((double)channel->time_s[middle] <= time_s)
            low = middle;
        else
            high = middle;
    }
    return low;
}

static void slerp(const float a[4], const float b[4], float t, float out[4]) {
    float dot = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3];
    float sign = dot < 0 ? -1.0f : 1.0f; /* q and -q are one rotation: take the one that is nearer */
    float weight_a = 1 - t, weight_b = t;
    dot = fminf(dot * sign, 1);
    if (dot <
        0.9995f) { /* nearer than 1.8 degrees, sin(angle) loses digits and a chord is as good as an arc */
        float angle = acosf(dot);
        weight_a = sinf((1 - t) * angle) / sinf(angle);
        weight_b = sinf(t * angle) / sinf(angle);
    }
    for (int i = 0; i < 4; i++) out[i] = weight_a * a[i] + sign * weight_b * b[i];
}

/* glTF 2.0, appendix C.5: Hermite spline with tangents per second. Keys hold in-tangent, value,
 * out-tangent. */
static void hermite(const float *key, const float *next, unsigned width, float t, float interval_s,
                    float *out) {
    float t2 = t * t, t3 = t2 * t;
    float value = 2 * t3 - 3 * t2 + 1, tangent = interval_s * (t3 - 2 * t2 + t);
    float next_value = 3 * t2 - 2 * t3, next_tangent = interval_s * (t3 - t2);
    for (unsigned i = 0; i < width; i++)
        out[i] = value * key[width + i] + tangent * key[2 * width + i] + next_value * next[width + i] +
                 next_tangent * next[i];
}

static void evaluate_channel(const struct lw_channel *channel, double time_s, float *out) {
    unsigned width = lw_channel_width(channel);
    bool cubic = channel->interpolation == LW_INTERPOLATION_CUBIC;
    size_t stride = cubic ? 3 * width : width;
    uint32_t k = find_key(channel, time_s);
    const float *key = channel->value + k * stride, *next = key + stride;
    double start_s = (double)channel->time_s[k];
    if (time_s <= start_s || k + 1 == channel->key_count || channel->interpolation == LW_INTERPOLATION_STEP) {
        memcpy(out, cubic ? key + width : key, width * sizeof *out);
    } else {
        double interval_s = (double)channel->time_s[k + 1] - start_s;
        float t = (float)((time_s - start_s) / interval_s);
        if (cubic)
            hermite(key, next, width, t, (float)interval_s, out);
        else if (width == 4)
            slerp(key, next, t, out);
        else
            for (unsigned i = 0; i < width; i++) out[i] = (1 - t) * key[i] + t * next[i];
    }
    if (width == 4) normalize_quaternion(out);
}

static struct lw_affine compose(const struct lw_pose_local *local) {
    const float *q = local->rotation, *s = local->scale, *p = local->translation;
    float x = q[0], y = q[1], z = q[2], w = q[3];
    return (struct lw_affine){{
        {(1 - 2 * (y * y + z * z)) * s[0], 2 * (x * y - z * w) * s[1], 2 * (x * z + y * w) * s[2], p[0]},
        {2 * (x * y + z * w) * s[0], (1 - 2 * (x * x + z * z)) * s[1], 2 * (y * z - x * w) * s[2], p[1]},
        {2 * (x * z - y * w) * s[0], 2 * (y * z + x * w) * s[1], (1 - 2 * (x * x + y * y)) * s[2], p[2]},
    }};
}

/* Where a node is without channels. */
static struct lw_pose_local at_rest(const struct lw_scene *scene, uint32_t node) {
    const struct lw_node *from = &scene->node[node];
    struct lw_pose_local local = {.node = node};
    memcpy(local.translation, from->translation, sizeof local.translation);
    memcpy(local.rotation, from->rotation, sizeof local.rotation);
    memcpy(local.scale, from->scale, sizeof local.scale);
    normalize_quaternion(local.rotation);
    return local;
}

static void evaluate_locals(struct lw_pose *pose, const struct lw_scene *scene) {
    for (uint32_t i = 0; i < pose->local_count; i++) pose->local[i] = at_rest(scene, pose->local[i].node);
    for (uint32_t i = 0; i < scene->channel_count; i++) {
        const struct lw_channel *channel = &scene->channel[i];
        const struct lw_pose_local of = {.node = channel->node};
        struct lw_pose_local *local = bsearch(&of, pose->local, pose->local_count, sizeof of, compare_nodes);
        LW_INVARIANT(local);
        switch ((enum lw_channel_path)channel->path) {
        case LW_CHANNEL_TRANSLATION:
            evaluate_channel(channel, pose->time_s, local->translation);
            break;
        case LW_CHANNEL_ROTATION:
            evaluate_channel(channel, pose->time_s, local->rotation);
            break;
        case LW_CHANNEL_SCALE:
            evaluate_channel(channel, pose->time_s, local->scale);
            break;
        case LW_CHANNEL_INTENSITY:
        case LW_CHANNEL_FACTOR:
            break; /* no node has one */
        }
    }
}

static void evaluate_nodes(struct lw_pose *pose, const struct lw_scene *scene) {
    evaluate_locals(pose, scene);
    for (uint32_t i = 0, k = 0; i < scene->node_count; i++) {
        const struct lw_node *node = &scene->node[i];
        const bool animated = k < pose->local_count && pose->local[k].node == i;
        const struct lw_pose_local place = animated ? pose->local[k++] : at_rest(scene, i);
        struct lw_affine local = node->has_matrix ? node->matrix : compose(&place);
        pose->node_to_world[i] = node->parent == LW_SCENE_NONE
                                     ? local
                                     : lw_affine_multiply(&pose->node_to_world[node->parent], &local);
    }
}

/* A cubic curve may leave the range of its keys. */
static float intensity_of(float x) { return fminf(fmaxf(x, 0), LW_SCENE_RADIANCE_MAX); }

static void evaluate_lights(struct lw_pose *pose, const struct lw_scene *scene) {
    for (int factors = 0; factors < 2; factors++)
        for (uint32_t i = 0; i < scene->light_channel_count; i++) {
            const struct lw_channel *channel = &scene->light_channel[i];
            struct lw_vec3 *light = &pose->light[channel->node].intensity;
            float v[3];
            if ((channel->path == LW_CHANNEL_FACTOR) != (factors == 1)) continue;
            evaluate_channel(channel, pose->time_s, v);
            const struct lw_vec3 x = factors ? lw_vec3_scale(*light, v[0]) : lw_vec3(v[0], v[1], v[2]);
            *light = lw_vec3(intensity_of(x.x), intensity_of(x.y), intensity_of(x.z));
        }
}

void lw_pose_evaluate(struct lw_pose *pose, const struct lw_scene *scene, double time_s) {
    LW_INVARIANT(pose->node_to_world);
    pose->time_s = wrap_time(time_s, (double)scene->duration_s);
    evaluate_nodes(pose, scene);
    for (uint32_t i = 0; i < scene->object_count; i++) {
        const bool spare = lw_scene_is_spare(scene, i);
        pose->object_to_world[i] = spare ? LW_AFFINE_IDENTITY : pose->node_to_world[scene->object[i].node];
        pose->object_hidden[i] = pose->object_spare[i] = spare;
    }
    for (uint32_t i = 0; i < scene->light_count; i++) {
        const struct lw_light *light = &scene->light[i];
        const struct lw_affine *to_world = &pose->node_to_world[light->node];
        pose->light[i] = (struct lw_light_state){
            .position_ws = lw_affine_point(to_world, lw_vec3(0, 0, 0)),
            .direction_ws = lw_vec3_normalize(lw_affine_vector(to_world, lw_vec3(0, 0, -1))),
            .intensity = lw_vec3(light->intensity[0], light->intensity[1], light->intensity[2])};
    }
    evaluate_lights(pose, scene);
    for (uint32_t i = 0; i < scene->material_count; i++) {
        const struct lw_material *material = &scene->material[i];
        memcpy(pose->material[i].base_colour, material->base_colour, sizeof pose->material[i].base_colour);
        memcpy(pose->material[i].emission, material->emission, sizeof pose->material[i].emission);
    }
    memcpy(pose->sky, scene->sky, sizeof pose->sky);
}

void lw_pose_copy(struct lw_pose *dst, const struct lw_pose *src, const struct lw_scene *scene) {
    dst->time_s = src->time_s;
    memcpy(dst->object_to_world, src->object_to_world, scene->object_count * sizeof *src->object_to_world);
    memcpy(dst->object_hidden, src->object_hidden, scene->object_count * sizeof *src->object_hidden);
    memcpy(dst->object_spare, src->object_spare, scene->object_count * sizeof *src->object_spare);
    memcpy(dst->object_dynamic, src->object_dynamic, scene->object_count * sizeof *src->object_dynamic);
    memcpy(dst->light, src->light, scene->light_count * sizeof *src->light);
    memcpy(dst->material, src->material, scene->material_count * sizeof *src->material);
    memcpy(dst->sky, src->sky, sizeof dst->sky);
    if (dst->node_to_world && src->node_to_world)
        memcpy(dst->node_to_world, src->node_to_world, scene->node_count * sizeof *src->node_to_world);
}

bool lw_pose_object_moves(const struct lw_pose *pose, const struct lw_scene *scene, uint32_t object) {
    return lw_scene_is_spare(scene, object) || pose->object_dynamic[object] ||
           pose->node_moves[scene->object[object].node];
}

static bool other_objects_move(const struct lw_pose *a, const struct lw_pose *b,
                               const struct lw_scene *scene) {
    if (memcmp(a->object_dynamic, b->object_dynamic, scene->object_count * sizeof *a->object_dynamic) == 0)
        return false;
    for (uint32_t i = 0; i < scene->object_count; i++)
        if (lw_pose_object_moves(a, scene, i) != lw_pose_object_moves(b, scene, i)) return true;
    return false;
}

/* None of these structs has padding. */
unsigned lw_pose_difference(const struct lw_pose *a, const struct lw_pose *b, const struct lw_scene *scene) {
    const size_t objects = scene->object_count;
    unsigned difference = 0;
    if (memcmp(a->object_to_world, b->object_to_world, objects * sizeof *a->object_to_world) ||
        memcmp(a->object_hidden, b->object_hidden, objects * sizeof *a->object_hidden) ||
        memcmp(a->object_spare, b->object_spare, objects * sizeof *a->object_spare))
        difference |= LW_POSE_OBJECTS;
    if (other_objects_move(a, b, scene)) difference |= LW_POSE_DYNAMIC;
    if (memcmp(a->light, b->light, scene->light_count * sizeof *a->light)) difference |= LW_POSE_LIGHTS;
    if (memcmp(a->material, b->material, scene->material_count * sizeof *a->material))
        difference |= LW_POSE_MATERIALS;
    if (memcmp(a->sky, b->sky, sizeof a->sky)) difference |= LW_POSE_SKY;
    return difference;
}

bool lw_pose_object_differs(const struct lw_pose *a, const struct lw_pose *b, uint32_t object) {
    return memcmp(&a->object_to_world[object], &b->object_to_world[object], sizeof *a->object_to_world) !=
               0 ||
           a->object_hidden[object] != b->object_hidden[object];
}

bool lw_pose_equal(const struct lw_pose *a, const struct lw_pose *b, const struct lw_scene *scene) {
    return lw_pose_difference(a, b, scene) == 0;
}

/* By comparisons, which take one instruction each: fminf() and fmaxf() are calls. */
static void widen(float *low, float *high, float at) {
    *low = at < *low ? at : *low;
    *high = at > *high ? at : *high;
}

void lw_pose_object_bounds(const struct lw_pose *pose, const struct lw_scene *scene, uint32_t object,
                           struct lw_vec3 *min, struct lw_vec3 *max) {
    const struct lw_mesh *mesh = &scene->mesh[scene->object[object].mesh];
    const struct lw_affine to_world = pose->object_to_world[object];
    struct lw_vec3 low = *min, high = *max;
    for (uint32_t i = 0; i < mesh->vertex_count; i++) {
        const struct lw_vec3 p = lw_affine_point(&to_world, mesh->position[i]);
        widen(&low.x, &high.x, p.x);
        widen(&low.y, &high.y, p.y);
        widen(&low.z, &high.z, p.z);
    }
    *min = low;
    *max = high;
}

bool lw_pose_bounds(const struct lw_pose *pose, const struct lw_scene *scene, struct lw_vec3 *out_min,
                    struct lw_vec3 *out_max) {
    struct lw_vec3 low = lw_vec3(INFINITY, INFINITY, INFINITY),
                   high = lw_vec3(-INFINITY, -INFINITY, -INFINITY);
    bool any = false;
    for (uint32_t i = 0; i < scene->object_count; i++) {
        if (pose->object_dynamic[i]) continue;
        lw_pose_object_bounds(pose, scene, i, &low, &high);
        any |= scene->mesh[scene->object[i].mesh].vertex_count > 0;
    }
    if (!any) return false;
    *out_min = low;
    *out_max = high;
    return true;
}
