#include "tests/bench/bench_shift.h"

#include <math.h>
#include <string.h>

static float width_of(const struct lw_mesh *mesh) {
    float lo = INFINITY, hi = -INFINITY;
    for (uint32_t v = 0; v < mesh->vertex_count; v++) {
        lo = fminf(lo, mesh->position[v].x);
        hi = fmaxf(hi, mesh->position[v].x);
    }
    return hi - lo;
}

static uint32_t find_object(const struct lw_scene *scene, const char *name) {
    for (uint32_t o = 0; o < scene->object_count; o++)
        if (strcmp(scene->object[o].name, name) == 0) return o;
    return LW_SCENE_NONE;
}

enum lw_status bench_shift(struct lw_scene *scene, const char *name, float widths, uint32_t *out_object,
                           struct lw_error *err) {
    const uint32_t o = find_object(scene, name);
    if (o == LW_SCENE_NONE) return lw_status_fail(err, LW_USAGE, "--object: there is no \"%s\"", name);
    struct lw_node *node = lw_scene_alloc(scene, (size_t)scene->node_count + 1, sizeof *node);
    struct lw_channel *channel = lw_scene_alloc(scene, 1, sizeof *channel);
    float *time_s = lw_scene_alloc(scene, 2, sizeof *time_s),
          *value = lw_scene_alloc(scene, 6, sizeof *value);
    if (!node || !channel || !time_s || !value) return lw_status_fail(err, LW_NO_MEMORY, "nodes");
    memcpy(node, scene->node, scene->node_count * sizeof *node);
    node[scene->node_count] = (struct lw_node){
        .name = "moved", .parent = scene->object[o].node, .rotation = {0, 0, 0, 1}, .scale = {1, 1, 1}};
    time_s[1] = 1;
    value[3] = widths * width_of(&scene->mesh[scene->object[o].mesh]);
    *channel = (struct lw_channel){.node = scene->node_count,
                                   .path = LW_CHANNEL_TRANSLATION,
                                   .interpolation = LW_INTERPOLATION_STEP,
                                   .key_count = 2,
                                   .time_s = time_s,
                                   .value = value};
    scene->object[o].node = scene->node_count;
    scene->node = node;
    scene->node_count++;
    scene->channel = channel;
    scene->channel_count = 1;
    scene->duration_s = 2;
    if (out_object) *out_object = o;
    return LW_OK;
}
