#include "server/import/gltf/gltf_animation.h"

#include "server/import/gltf/gltf_accessor.h"

#include <stdlib.h>
#include <string.h>

/* The animation that moves a path of a node or a light already: its index + 1, or 0. */
struct claims {
    uint32_t animation[LW_CHANNEL_FACTOR + 1]; /* per enum lw_channel_path */
};

struct conversion {
    struct lw_gltf_document *document;
    struct lw_scene *scene;
    const uint32_t *node_of;
    struct claims *claims;       /* per scene node */
    struct claims *light_claims; /* per light of the document */
    uint64_t key_total;
    uint32_t animation; /* current */
};

static enum lw_status read_interpolation(const json_t *sampler, uint8_t *out, struct lw_error *err) {
    const char *name = "LINEAR";
    if (lw_gltf_json_string(sampler, "interpolation", &name, err)) return err->status;
    if (strcmp(name, "STEP") == 0)
        *out = LW_INTERPOLATION_STEP;
    else if (strcmp(name, "LINEAR") == 0)
        *out = LW_INTERPOLATION_LINEAR;
    else if (strcmp(name, "CUBICSPLINE") == 0)
        *out = LW_INTERPOLATION_CUBIC;
    else
        return lw_status_fail(err, LW_BAD_DATA, "interpolation: must be STEP, LINEAR or CUBICSPLINE");
    return LW_OK;
}

static enum lw_status read_times(const struct lw_gltf_accessor *input, float *time, struct lw_error *err) {
    for (uint32_t i = 0; i < input->count; i++) {
        float v[4];
        lw_gltf_accessor_read(input, i, v);
        time[i] = v[0];
        if (!isfinite(v[0]) || v[0] < 0 || (i > 0 && v[0] <= time[i - 1]))
            return lw_status_fail(
                err, LW_BAD_DATA,
                "input: accessor %u: times must be finite, not negative and strictly increasing; "
                "element %u is not",
                input->index, i);
    }
    return LW_OK;
}

static bool normalize_quaternion(float q[4]) {
    double length = sqrt((double)q[0] * (double)q[0] + (double)q[1] * (double)q[1] +
                         (double)q[2] * (double)q[2] + (double)q[3] * (double)q[3]);
    if (!(length > 1e-10)) return false;
    for (int c = 0; c < 4; c++) q[c] = (float)((double)q[c] / length);
    return true;
}

static enum lw_status read_values(const struct lw_gltf_accessor *output, const struct lw_channel *channel,
                                  float *value, struct lw_error *err) {
    bool cubic = channel->interpolation == LW_INTERPOLATION_CUBIC,
         rotation = channel->path == LW_CHANNEL_ROTATION;
    unsigned components = lw_channel_width(channel);
    for (uint32_t i = 0; i < output->count; i++) {
        float v[4];
        lw_gltf_accessor_read(output, i, v);
        for (unsigned c = 0; c < components; c++)
            if (!isfinite(v[c]))
                return lw_status_fail(err, LW_BAD_DATA,
                                      "output: accessor %u: element %u is not a finite number", output->index,
                                      i);
        if (rotation && (!cubic || i % 3 == 1) && !normalize_quaternion(v)) /* tangents have any length */
            return lw_status_fail(err, LW_BAD_DATA, "output: accessor %u: element %u is not a rotation",
                                  output->index, i);
        memcpy(value + (size_t)i * components, v, components * sizeof *v);
    }
    return LW_OK;
}

static enum lw_status read_sampler(struct conversion *conversion, const json_t *sampler,
                                   struct lw_channel *channel, struct lw_error *err) {
    const struct lw_gltf_document *document = conversion->document;
    uint32_t input_index = 0, output_index = 0;
    struct lw_gltf_accessor input, output;
    unsigned components = lw_channel_width(channel);
    if (read_interpolation(sampler, &channel->interpolation, err) ||
        lw_gltf_json_require(sampler, "input", err) ||
        lw_gltf_document_index(document, sampler, "input", LW_GLTF_ACCESSORS, &input_index, err) ||
        lw_gltf_json_require(sampler, "output", err) ||
        lw_gltf_document_index(document, sampler, "output", LW_GLTF_ACCESSORS, &output_index, err) ||
        lw_gltf_accessor_open(document, input_index, 1, 1, LW_GLTF_ACCEPT_FLOAT, &input, err) ||
        lw_gltf_accessor_open(document, output_index, components, components,
                              LW_GLTF_ACCEPT_FLOAT | LW_GLTF_ACCEPT_NORMALIZED_UNSIGNED |
                                  LW_GLTF_ACCEPT_NORMALIZED_SIGNED,
                              &output, err))
        return err->status;
    bool cubic = channel->interpolation == LW_INTERPOLATION_CUBIC;
    if (output.count != (uint64_t)input.count * (cubic ? 3 : 1))
        return lw_status_fail(err, LW_BAD_DATA, "output: accessor %u has %u elements for %u keys",
                              output_index, output.count, input.count);
    if (cubic && input.count < 2)
        return lw_status_fail(err, LW_BAD_DATA, "input: CUBICSPLINE needs two keys, accessor %u has one",
                              input_index);
    conversion->key_total += output.count;
    if (conversion->key_total > LW_GLTF_KEYS_MAX)
        return lw_status_fail(err, LW_BAD_DATA, "the animations together have more than %u keys",
                              LW_GLTF_KEYS_MAX);
    float *time = lw_scene_alloc(conversion->scene, input.count, sizeof *time);
    float *value = lw_scene_alloc(conversion->scene, (size_t)output.count * components, sizeof *value);
    if (!time || !value) return lw_status_fail(err, LW_NO_MEMORY, "out of memory for %u keys", input.count);
    if (read_times(&input, time, err) || read_values(&output, channel, value, err)) return err->status;
    channel->key_count = input.count;
    channel->time_s = time;
    channel->value = value;
    return LW_OK;
}

/* Takes a path for the animation at hand. *out_use stays false if an earlier one has it. */
static enum lw_status claim(struct conversion *conversion, uint32_t *claim, const char *path,
                            const char *list, uint32_t index, bool *out_use, struct lw_error *err) {
    if (*claim == conversion->animation + 1)
        return lw_status_fail(err, LW_BAD_DATA, "target: the %s of %s[%u] is animated twice", path, list,
                              index);
    if (*claim) {
        lw_gltf_document_warn(conversion->document, LW_GLTF_WARN_CHANNEL_TWICE);
        return LW_OK;
    }
    *claim = conversion->animation + 1;
    *out_use = true;
    return LW_OK;
}

static enum lw_status read_node_target(struct conversion *conversion, uint32_t node, const char *path,
                                       struct lw_channel *channel, bool *out_use, struct lw_error *err) {
    static const char *const paths[] = {"translation", "rotation", "scale"};
    channel->node = conversion->node_of[node];
    if (channel->node == LW_SCENE_NONE) return LW_OK;
    if (conversion->document->moves_skin[node])
        lw_gltf_document_warn(conversion->document, LW_GLTF_WARN_SKIN);
    while (channel->path < 3 && strcmp(path, paths[channel->path]) != 0) channel->path++;
    if (channel->path == 3) {
        lw_gltf_document_warn(conversion->document, strcmp(path, "weights") == 0
                                                        ? LW_GLTF_WARN_CHANNEL_WEIGHTS
                                                        : LW_GLTF_WARN_CHANNEL_OTHER);
        return LW_OK;
    }
    if (conversion->scene->node[channel->node].has_matrix)
        return lw_status_fail(err, LW_BAD_DATA, "target: nodes[%u] has a matrix and cannot be animated",
                              node);
    return claim(conversion, &conversion->claims[channel->node].animation[channel->path], path, "nodes", node,
                 out_use, err);
}

/* The index behind `start` of a pointer, and what follows its slash; false: the pointer is another one. */
static bool read_pointer(const char *pointer, const char *start, uint32_t count, uint32_t *out_index,
                         const char **out_rest) {
    const size_t length = strlen(start);
    if (strncmp(pointer, start, length) != 0) return false;
    uint64_t index = 0;
    const char *at = pointer + length;
    for (; *at >= '0' && *at <= '9'; at++) {
        index = 10 * index + (uint64_t)(*at - '0');
        if (index >= count) return false;
    }
    if (at == pointer + length || *at != '/') return false;
    *out_index = (uint32_t)index;
    *out_rest = at + 1;
    return true;
}

/* KHR_animation_pointer: what a node's channel could say as well, and lights. */
static enum lw_status read_pointer_target(struct conversion *conversion, const json_t *target,
                                          struct lw_channel *channel, bool *out_use, struct lw_error *err) {
    const struct lw_gltf_document *document = conversion->document;
    const json_t *extension = NULL;
    const char *pointer = "", *rest;
    uint32_t index;
    if (lw_gltf_json_extension(target, "KHR_animation_pointer", &extension, err) ||
        (extension && lw_gltf_json_string(extension, "pointer", &pointer, err)))
        return err->status;
    if (read_pointer(pointer, "/nodes/", document->count[LW_GLTF_NODES], &index, &rest))
        return read_node_target(conversion, index, rest, channel, out_use, err);
    if (read_pointer(pointer, "/extensions/KHR_lights_punctual/lights/", document->count[LW_GLTF_LIGHTS],
                     &index, &rest) &&
        (strcmp(rest, "color") == 0 || strcmp(rest, "intensity") == 0)) {
        channel->path = *rest == 'c' ? LW_CHANNEL_INTENSITY : LW_CHANNEL_FACTOR;
        channel->node = index;
        return claim(conversion, &conversion->light_claims[index].animation[channel->path], rest, "lights",
                     index, out_use, err);
    }
    lw_gltf_document_warn(conversion->document, LW_GLTF_WARN_CHANNEL_OTHER);
    return LW_OK;
}

/* Target of a channel: node and path, or a light of the document. *out_use is false if the channel is to
 * be left out. */
static enum lw_status read_target(struct conversion *conversion, const json_t *object,
                                  struct lw_channel *channel, bool *out_use, struct lw_error *err) {
    const json_t *target = NULL;
    const char *path = "";
    uint32_t node = LW_SCENE_NONE;
    *out_use = false;
    if (lw_gltf_json_require(object, "target", err) || lw_gltf_json_object(object, "target", &target, err) ||
        lw_gltf_document_index(conversion->document, target, "node", LW_GLTF_NODES, &node, err) ||
        lw_gltf_json_require(target, "path", err) || lw_gltf_json_string(target, "path", &path, err))
        return err->status;
    if (strcmp(path, "pointer") == 0) return read_pointer_target(conversion, target, channel, out_use, err);
    if (node == LW_SCENE_NONE) return LW_OK;
    return read_node_target(conversion, node, path, channel, out_use, err);
}

/* A light of the document may hang on several nodes. */
static void add_light_channel(struct conversion *conversion, const struct lw_channel *channel) {
    struct lw_scene *scene = conversion->scene;
    for (uint32_t l = 0; l < scene->light_count; l++) {
        if (conversion->document->light_of[l] != channel->node) continue;
        scene->light_channel[scene->light_channel_count] = *channel;
        scene->light_channel[scene->light_channel_count++].node = l;
    }
}

static enum lw_status add_channel(struct conversion *conversion, const json_t *object, const json_t *samplers,
                                  struct lw_error *err) {
    struct lw_channel channel = {0};
    struct lw_scene *scene = conversion->scene;
    uint64_t sampler = 0;
    bool use;
    if (lw_gltf_json_require(object, "sampler", err) ||
        lw_gltf_json_integer(object, "sampler", 0, UINT32_MAX, &sampler, err))
        return err->status;
    if (!json_is_object(json_array_get(samplers, sampler)))
        return lw_status_fail(err, LW_BAD_DATA, "sampler: %llu is not one of the animation's %zu samplers",
                              (unsigned long long)sampler, json_array_size(samplers));
    if (read_target(conversion, object, &channel, &use, err)) return err->status;
    if (!use) return LW_OK;
    if (read_sampler(conversion, json_array_get(samplers, sampler), &channel, err)) {
        lw_status_context(err, "samplers[%llu]", (unsigned long long)sampler);
        return err->status;
    }
    float end = channel.time_s[channel.key_count - 1];
    if (end > scene->duration_s) scene->duration_s = end;
    if (channel.path >= LW_CHANNEL_INTENSITY)
        add_light_channel(conversion, &channel);
    else
        scene->channel[scene->channel_count++] = channel;
    return LW_OK;
}

/* Gives a light whose colour or intensity alone is animated the missing one: a channel of one key. */
static enum lw_status complete_light(struct conversion *conversion, uint32_t light, struct lw_error *err) {
    const uint32_t *claimed = conversion->light_claims[light].animation;
    const bool colours = claimed[LW_CHANNEL_INTENSITY], factors = claimed[LW_CHANNEL_FACTOR];
    if (colours == factors) return LW_OK;
    const json_t *object = lw_gltf_document_item(conversion->document, LW_GLTF_LIGHTS, light);
    float *key = lw_scene_alloc(conversion->scene, 4, sizeof *key), *value = key + 1; /* at 0 s */
    if (!key) return lw_status_fail(err, LW_NO_MEMORY, "out of memory for a light");
    value[0] = value[1] = value[2] = 1;
    if (factors ? lw_gltf_json_reals(object, "color", 3, 0, HUGE_VAL, value, err)
                : lw_gltf_json_real(object, "intensity", 0, HUGE_VAL, value, err))
        return err->status;
    add_light_channel(conversion,
                      &(struct lw_channel){.node = light,
                                           .path = factors ? LW_CHANNEL_INTENSITY : LW_CHANNEL_FACTOR,
                                           .interpolation = LW_INTERPOLATION_STEP,
                                           .key_count = 1,
                                           .time_s = key,
                                           .value = value});
    return LW_OK;
}

static enum lw_status add_animation(struct conversion *conversion, const json_t *object,
                                    struct lw_error *err) {
    const json_t *channels = NULL, *samplers = NULL, *channel;
    size_t i;
    if (lw_gltf_json_require(object, "channels", err) ||
        lw_gltf_json_array(object, "channels", &channels, err) ||
        lw_gltf_json_require(object, "samplers", err) ||
        lw_gltf_json_array(object, "samplers", &samplers, err))
        return err->status;
    json_array_foreach(channels, i, channel) {
        if (!json_is_object(channel))
            return lw_status_fail(err, LW_BAD_DATA, "channels[%zu]: must be an object", i);
        if (add_channel(conversion, channel, samplers, err)) {
            lw_status_context(err, "channels[%zu]", i);
            return err->status;
        }
    }
    return LW_OK;
}

static size_t count_channels(const struct lw_gltf_document *document) {
    size_t count = 0;
    for (uint32_t i = 0; i < document->count[LW_GLTF_ANIMATIONS]; i++)
        count += json_array_size(
            json_object_get(lw_gltf_document_item(document, LW_GLTF_ANIMATIONS, i), "channels"));
    return count;
}

static enum lw_status convert(struct conversion *conversion, struct lw_error *err) {
    const struct lw_gltf_document *document = conversion->document;
    for (; conversion->animation < document->count[LW_GLTF_ANIMATIONS]; conversion->animation++)
        if (add_animation(conversion,
                          lw_gltf_document_item(document, LW_GLTF_ANIMATIONS, conversion->animation), err)) {
            lw_status_context(err, "animations[%u]", conversion->animation);
            return err->status;
        }
    for (uint32_t light = 0; light < document->count[LW_GLTF_LIGHTS]; light++)
        if (complete_light(conversion, light, err)) return err->status;
    return LW_OK;
}

enum lw_status lw_gltf_animation_convert(struct lw_gltf_document *document, const uint32_t *node_of,
                                         struct lw_scene *scene, struct lw_error *err) {
    size_t channel_count = count_channels(document);
    if (channel_count == 0) return LW_OK;
    if (channel_count > LW_SCENE_CHANNELS_MAX)
        return lw_status_fail(err, LW_BAD_DATA, "animations: have %zu channels; the limit is %u",
                              channel_count, LW_SCENE_CHANNELS_MAX);
    struct conversion conversion = {.document = document, .scene = scene, .node_of = node_of};
    conversion.claims = calloc(scene->node_count + 1ul, sizeof *conversion.claims);
    conversion.light_claims = calloc(document->count[LW_GLTF_LIGHTS] + 1ul, sizeof *conversion.light_claims);
    scene->channel = lw_scene_alloc(scene, channel_count, sizeof *scene->channel);
    /* each of them has at most one channel for its colour, and one for its intensity */
    scene->light_channel = lw_scene_alloc(scene, 2ul * scene->light_count, sizeof *scene->light_channel);
    if (!conversion.claims || !conversion.light_claims || !scene->channel || !scene->light_channel)
        lw_status_fail(err, LW_NO_MEMORY, "out of memory for %zu animation channels", channel_count);
    else
        (void)convert(&conversion, err);
    free(conversion.light_claims);
    free(conversion.claims);
    return err->status;
}
