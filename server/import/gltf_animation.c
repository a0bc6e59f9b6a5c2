#include "server/import/gltf_animation.h"

#include "server/import/gltf_accessor.h"

#include <stdlib.h>
#include <string.h>

/* What moves a path of a node already: index of its animation + 1, or 0. */
struct claims {
    uint32_t animation[3]; /* per enum lw_channel_path */
};

struct conversion {
    struct lw_gltf_document *document;
    struct lw_scene *scene;
    const uint32_t *node_of;
    struct claims *claims; /* per scene node */
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
    unsigned components = rotation ? 4 : 3;
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
    unsigned components = channel->path == LW_CHANNEL_ROTATION ? 4 : 3;
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

/* Which node and path a channel moves. *out_use is false if the channel is to be left out. */
static enum lw_status read_target(struct conversion *conversion, const json_t *object,
                                  struct lw_channel *channel, bool *out_use, struct lw_error *err) {
    static const char *const paths[] = {"translation", "rotation", "scale"};
    const json_t *target = NULL;
    const char *path = "";
    uint32_t node = LW_SCENE_NONE;
    *out_use = false;
    if (lw_gltf_json_require(object, "target", err) || lw_gltf_json_object(object, "target", &target, err) ||
        lw_gltf_document_index(conversion->document, target, "node", LW_GLTF_NODES, &node, err) ||
        lw_gltf_json_require(target, "path", err) || lw_gltf_json_string(target, "path", &path, err))
        return err->status;
    if (node == LW_SCENE_NONE || conversion->node_of[node] == LW_SCENE_NONE) return LW_OK;
    channel->node = conversion->node_of[node];
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
    uint32_t *claim = &conversion->claims[channel->node].animation[channel->path];
    if (*claim == conversion->animation + 1)
        return lw_status_fail(err, LW_BAD_DATA, "target: the %s of nodes[%u] is animated twice", path, node);
    if (*claim) {
        lw_gltf_document_warn(conversion->document, LW_GLTF_WARN_CHANNEL_TWICE);
        return LW_OK;
    }
    *claim = conversion->animation + 1;
    *out_use = true;
    return LW_OK;
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
    scene->channel[scene->channel_count++] = channel;
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

enum lw_status lw_gltf_animation_convert(struct lw_gltf_document *document, const uint32_t *node_of,
                                         struct lw_scene *scene, struct lw_error *err) {
    size_t channel_count = count_channels(document);
    if (channel_count == 0) return LW_OK;
    if (channel_count > LW_SCENE_CHANNELS_MAX)
        return lw_status_fail(err, LW_BAD_DATA, "animations: have %zu channels; the limit is %u",
                              channel_count, LW_SCENE_CHANNELS_MAX);
    struct conversion conversion = {.document = document, .scene = scene, .node_of = node_of};
    conversion.claims = calloc(scene->node_count + 1ul, sizeof *conversion.claims);
    scene->channel = lw_scene_alloc(scene, channel_count, sizeof *scene->channel);
    if (!conversion.claims || !scene->channel) {
        free(conversion.claims);
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory for %zu animation channels", channel_count);
    }
    for (; conversion.animation < document->count[LW_GLTF_ANIMATIONS]; conversion.animation++)
        if (add_animation(&conversion,
                          lw_gltf_document_item(document, LW_GLTF_ANIMATIONS, conversion.animation), err)) {
            lw_status_context(err, "animations[%u]", conversion.animation);
            break;
        }
    free(conversion.claims);
    return err->status;
}
