#include "server/import/new_root.h"

enum lw_status lw_new_root_add(struct lw_scene *scene, const char *name, const struct lw_affine *place,
                               struct lw_error *err) {
    if (scene->node_count >= LW_SCENE_NODES_MAX)
        return lw_status_fail(err, LW_BAD_DATA, "has %u nodes: there is no room for another root",
                              scene->node_count);
    struct lw_node *node = lw_scene_alloc(scene, scene->node_count + 1ul, sizeof *node);
    if (!node) return lw_status_fail(err, LW_NO_MEMORY, "out of memory for %u nodes", scene->node_count);
    node[0] = (struct lw_node){.name = lw_scene_string(scene, name),
                               .parent = LW_SCENE_NONE,
                               .rotation = {0, 0, 0, 1},
                               .scale = {1, 1, 1},
                               .matrix = *place,
                               .has_matrix = true};
    if (!node[0].name)
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory for %u nodes", scene->node_count);
    for (uint32_t i = 0; i < scene->node_count; i++) {
        node[i + 1] = scene->node[i];
        node[i + 1].parent = scene->node[i].parent == LW_SCENE_NONE ? 0 : scene->node[i].parent + 1;
    }
    scene->node = node;
    scene->node_count++;
    for (uint32_t i = 0; i < scene->object_count; i++) scene->object[i].node++;
    for (uint32_t i = 0; i < scene->light_count; i++) scene->light[i].node++;
    for (uint32_t i = 0; i < scene->camera_count; i++) scene->camera[i].node++;
    for (uint32_t i = 0; i < scene->channel_count; i++) scene->channel[i].node++;
    return LW_OK;
}
