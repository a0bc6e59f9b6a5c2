#include "server/import/foreign/foreign_animation.h"

#include <assimp/cimport.h>
#include <stdlib.h>
#include <string.h>

#define TICKS_PER_SECOND 25.0 /* where the file does not say: Assimp's own default */

/* Entries of a matrix that differ less after taking it apart are rounding. */
#define SHEAR_TOLERANCE 1e-3f

struct conversion {
    struct lw_foreign_import *import;
    const struct lw_foreign_nodes *nodes;
    uint8_t *claimed; /* per node of the scene */
    uint64_t key_total;
    double ticks_per_second, first; /* the animation's: seconds are (tick - first) / ticks_per_second */
};

/* The keys of one property, behind one interface. */
struct keys {
    const struct aiVectorKey *vector;
    const struct aiQuatKey *rotation; /* or */
    unsigned count;
};

static double tick_of(const struct keys *keys, unsigned i) {
    return keys->rotation ? keys->rotation[i].mTime : keys->vector[i].mTime;
}

static void value_of(const struct keys *keys, unsigned i, float out[4]) {
    if (keys->rotation) {
        const struct aiQuaternion *q = &keys->rotation[i].mValue;
        memcpy(out, (const float[]){q->x, q->y, q->z, q->w}, 4 * sizeof *out);
    } else {
        const struct aiVector3D *v = &keys->vector[i].mValue;
        memcpy(out, (const float[]){v->x, v->y, v->z, 0}, 4 * sizeof *out);
    }
}

static bool normalise(float q[4]) {
    double length = sqrt((double)q[0] * (double)q[0] + (double)q[1] * (double)q[1] +
                         (double)q[2] * (double)q[2] + (double)q[3] * (double)q[3]);
    if (!(length > 1e-10) || !isfinite(length)) return false;
    for (int c = 0; c < 4; c++) q[c] = (float)((double)q[c] / length);
    return true;
}

/* The node's own place, as parts that can be animated. */
static void take_apart(struct conversion *conversion, struct lw_node *node) {
    const float(*m)[4] = node->matrix.m;
    struct aiMatrix4x4 matrix = {m[0][0], m[0][1], m[0][2], m[0][3], m[1][0], m[1][1], m[1][2], m[1][3],
                                 m[2][0], m[2][1], m[2][2], m[2][3], 0,       0,       0,       1};
    struct aiVector3D scale, position;
    struct aiQuaternion rotation;
    aiDecomposeMatrix(&matrix, &scale, &rotation, &position);
    float q[4] = {rotation.x, rotation.y, rotation.z, rotation.w};
    if (!normalise(q)) memcpy(q, (const float[]){0, 0, 0, 1}, sizeof q);
    memcpy(node->translation, (const float[]){position.x, position.y, position.z}, sizeof node->translation);
    memcpy(node->scale, (const float[]){scale.x, scale.y, scale.z}, sizeof node->scale);
    memcpy(node->rotation, q, sizeof node->rotation);
    node->has_matrix = false;
    /* columns of a matrix without shear are at right angles */
    struct lw_vec3 x = lw_vec3(m[0][0], m[1][0], m[2][0]), y = lw_vec3(m[0][1], m[1][1], m[2][1]),
                   z = lw_vec3(m[0][2], m[1][2], m[2][2]);
    float most = SHEAR_TOLERANCE * fmaxf(lw_vec3_dot(x, x), fmaxf(lw_vec3_dot(y, y), lw_vec3_dot(z, z)));
    if (fabsf(lw_vec3_dot(x, y)) > most || fabsf(lw_vec3_dot(y, z)) > most || fabsf(lw_vec3_dot(z, x)) > most)
        lw_foreign_import_warn(conversion->import, LW_FOREIGN_WARN_SHEAR);
    node->matrix = LW_AFFINE_IDENTITY;
}

/* Keys at the same time: the last counts. Returns how many are left. */
static enum lw_status copy_keys(const struct conversion *conversion, const struct keys *keys, float *time_s,
                                float *value, uint32_t *out_count, struct lw_error *err) {
    unsigned width = keys->rotation ? 4 : 3;
    uint32_t count = 0;
    for (unsigned i = 0; i < keys->count; i++) {
        double seconds = (tick_of(keys, i) - conversion->first) / conversion->ticks_per_second;
        float v[4];
        value_of(keys, i, v);
        if (!(seconds >= 0 && seconds <= (double)LW_SCENE_DURATION_MAX))
            return lw_status_fail(err, LW_BAD_DATA, "key %u is at %g s", i, seconds);
        for (unsigned c = 0; c < width; c++)
            if (!(fabsf(v[c]) <= LW_SCENE_COORDINATE_MAX))
                return lw_status_fail(err, LW_BAD_DATA, "key %u holds %g", i, (double)v[c]);
        if (keys->rotation && !normalise(v))
            return lw_status_fail(err, LW_BAD_DATA, "key %u is no rotation", i);
        if (count > 0 && (float)seconds < time_s[count - 1])
            return lw_status_fail(err, LW_BAD_DATA, "key %u is before the one in front of it", i);
        if (count > 0 && (float)seconds == time_s[count - 1]) count--;
        time_s[count] = (float)seconds;
        memcpy(value + (size_t)count++ * width, v, width * sizeof *v);
    }
    *out_count = count;
    return LW_OK;
}

static bool is_constant(const struct lw_channel *channel) {
    unsigned width = channel->path == LW_CHANNEL_ROTATION ? 4 : 3;
    for (uint32_t i = 1; i < channel->key_count; i++)
        if (memcmp(channel->value, channel->value + (size_t)i * width, width * sizeof(float)) != 0)
            return false;
    return true;
}

static enum lw_status add_channel(struct conversion *conversion, uint32_t node, enum lw_channel_path path,
                                  struct keys keys, struct lw_error *err) {
    struct lw_scene *scene = conversion->import->scene;
    unsigned width = path == LW_CHANNEL_ROTATION ? 4 : 3;
    if (keys.count == 0) return LW_OK;
    conversion->key_total += keys.count;
    if (conversion->key_total > LW_FOREIGN_KEYS_MAX)
        return lw_status_fail(err, LW_BAD_DATA, "the animations together have more than %u keys",
                              LW_FOREIGN_KEYS_MAX);
    float *time_s = lw_scene_alloc(scene, keys.count, sizeof *time_s);
    float *value = lw_scene_alloc(scene, (size_t)keys.count * width, sizeof *value);
    if (!time_s || !value) return lw_status_fail(err, LW_NO_MEMORY, "out of memory for %u keys", keys.count);
    struct lw_channel channel = {.node = node,
                                 .path = (uint8_t)path,
                                 .interpolation = LW_INTERPOLATION_LINEAR,
                                 .time_s = time_s,
                                 .value = value};
    if (copy_keys(conversion, &keys, time_s, value, &channel.key_count, err)) return err->status;
    if (is_constant(&channel)) { /* Assimp keys all three where one moves */
        struct lw_node *at = &scene->node[node];
        memcpy(path == LW_CHANNEL_TRANSLATION ? at->translation
               : path == LW_CHANNEL_SCALE     ? at->scale
                                              : at->rotation,
               value, width * sizeof *value);
        return LW_OK;
    }
    if (scene->channel_count >= LW_SCENE_CHANNELS_MAX)
        return lw_status_fail(err, LW_BAD_DATA, "has more than %u animated properties",
                              LW_SCENE_CHANNELS_MAX);
    scene->duration_s = fmaxf(scene->duration_s, time_s[channel.key_count - 1]);
    scene->channel[scene->channel_count++] = channel;
    return LW_OK;
}

static enum lw_status add_node(struct conversion *conversion, const struct aiNodeAnim *from,
                               struct lw_error *err) {
    struct lw_scene *scene = conversion->import->scene;
    uint32_t node = lw_foreign_nodes_find(conversion->nodes, &from->mNodeName);
    if (node == LW_SCENE_NONE || conversion->claimed[node]) {
        lw_foreign_import_warn(conversion->import, node == LW_SCENE_NONE ? LW_FOREIGN_WARN_CHANNEL_LOST
                                                                         : LW_FOREIGN_WARN_CHANNEL_TWICE);
        return LW_OK;
    }
    conversion->claimed[node] = 1;
    take_apart(conversion, &scene->node[node]);
    const struct keys position = {.vector = from->mPositionKeys, .count = from->mNumPositionKeys},
                      rotation = {.rotation = from->mRotationKeys, .count = from->mNumRotationKeys},
                      scale = {.vector = from->mScalingKeys, .count = from->mNumScalingKeys};
    if (add_channel(conversion, node, LW_CHANNEL_TRANSLATION, position, err) ||
        add_channel(conversion, node, LW_CHANNEL_ROTATION, rotation, err) ||
        add_channel(conversion, node, LW_CHANNEL_SCALE, scale, err))
        lw_status_context(err, "node \"%.80s\"", scene->node[node].name);
    return err->status;
}

/* Timelines may begin before 0, where ours begin: then all of the animation moves. */
static double first_tick(const struct aiAnimation *animation) {
    double first = HUGE_VAL;
    for (unsigned i = 0; i < animation->mNumChannels; i++) {
        const struct aiNodeAnim *node = animation->mChannels[i];
        if (node->mNumPositionKeys) first = fmin(first, node->mPositionKeys[0].mTime);
        if (node->mNumRotationKeys) first = fmin(first, node->mRotationKeys[0].mTime);
        if (node->mNumScalingKeys) first = fmin(first, node->mScalingKeys[0].mTime);
    }
    return isfinite(first) ? fmin(first, 0) : 0;
}

static enum lw_status convert(struct conversion *conversion, struct lw_error *err) {
    const struct aiScene *ai = conversion->import->ai;
    for (unsigned i = 0; i < ai->mNumAnimations; i++) {
        const struct aiAnimation *animation = ai->mAnimations[i];
        conversion->ticks_per_second =
            animation->mTicksPerSecond > 0 ? animation->mTicksPerSecond : TICKS_PER_SECOND;
        conversion->first = first_tick(animation);
        for (unsigned n = 0; n < animation->mNumChannels; n++)
            if (add_node(conversion, animation->mChannels[n], err)) {
                lw_status_context(err, "animation %u", i);
                return err->status;
            }
    }
    return LW_OK;
}

enum lw_status lw_foreign_animation_convert(struct lw_foreign_import *import,
                                            const struct lw_foreign_nodes *nodes, struct lw_error *err) {
    size_t channels = 0;
    for (unsigned i = 0; i < import->ai->mNumAnimations; i++)
        channels += 3 * (size_t)import->ai->mAnimations[i]->mNumChannels;
    if (channels == 0) return LW_OK;
    if (channels > LW_SCENE_CHANNELS_MAX) channels = LW_SCENE_CHANNELS_MAX;
    struct conversion conversion = {.import = import, .nodes = nodes};
    conversion.claimed = calloc(import->scene->node_count + 1ul, 1);
    import->scene->channel = lw_scene_alloc(import->scene, channels, sizeof *import->scene->channel);
    if (!conversion.claimed || !import->scene->channel)
        lw_status_fail(err, LW_NO_MEMORY, "out of memory for animations");
    else
        (void)convert(&conversion, err);
    free(conversion.claimed);
    return err->status;
}
