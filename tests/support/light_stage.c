#include "tests/support/light_stage.h"

#include <math.h>
#include <string.h>

struct lw_scene *light_stage_create(void) {
    struct lw_scene *scene;
    lw_support_ok(lw_scene_create(&scene), NULL);
    scene->name = "stage";
    scene->mesh = lw_scene_alloc(scene, LIGHT_STAGE_MAX, sizeof *scene->mesh);
    scene->material = lw_scene_alloc(scene, LIGHT_STAGE_MAX, sizeof *scene->material);
    scene->object = lw_scene_alloc(scene, LIGHT_STAGE_MAX, sizeof *scene->object);
    scene->node = lw_scene_alloc(scene, 1 + LIGHT_STAGE_MAX, sizeof *scene->node);
    scene->light = lw_scene_alloc(scene, LIGHT_STAGE_MAX, sizeof *scene->light);
    scene->node[0] =
        (struct lw_node){.name = "", .parent = LW_SCENE_NONE, .rotation = {0, 0, 0, 1}, .scale = {1, 1, 1}};
    scene->node_count = 1;
    return scene;
}

void light_stage_add_quad(struct lw_scene *scene, struct lw_vec3 corner, struct lw_vec3 u, struct lw_vec3 v,
                          float emission, bool double_sided) {
    const uint32_t i = scene->object_count;
    assert_true(i < LIGHT_STAGE_MAX);
    struct lw_vec3 *position = lw_scene_alloc(scene, 4, sizeof *position),
                   *normal = lw_scene_alloc(scene, 4, sizeof *normal);
    uint32_t(*triangle)[3] = lw_scene_alloc(scene, 2, sizeof *triangle);
    uint32_t *material = lw_scene_alloc(scene, 2, sizeof *material);
    position[0] = corner;
    position[1] = lw_vec3_add(corner, u);
    position[2] = lw_vec3_add(position[1], v);
    position[3] = lw_vec3_add(corner, v);
    for (int k = 0; k < 4; k++) normal[k] = lw_vec3_normalize(lw_vec3_cross(u, v));
    memcpy(triangle, (uint32_t[2][3]){{0, 1, 2}, {0, 2, 3}}, sizeof(uint32_t[2][3]));
    material[0] = material[1] = i;
    scene->mesh[i] = (struct lw_mesh){.name = "quad",
                                      .vertex_count = 4,
                                      .triangle_count = 2,
                                      .position = position,
                                      .normal = normal,
                                      .triangle = triangle,
                                      .material = material};
    scene->material[i] = (struct lw_material){
        .name = "lamp",
        .base_colour = {1, 1, 1, 1},
        .emission = {emission, emission, emission},
        .double_sided = double_sided,
        .base_colour_texture = {.texture = LW_SCENE_NONE, .transform = {1, 0, 0, 0, 1, 0}},
        .emission_texture = {.texture = LW_SCENE_NONE, .transform = {1, 0, 0, 0, 1, 0}}};
    scene->object[i] = (struct lw_object){.name = "quad", .mesh = i, .node = 0};
    scene->object_count = scene->mesh_count = scene->material_count = i + 1;
}

void light_stage_add_light(struct lw_scene *scene, struct lw_light light, struct lw_vec3 position) {
    assert_true(scene->light_count < LIGHT_STAGE_MAX);
    struct lw_node *node = &scene->node[scene->node_count];
    *node = (struct lw_node){.name = "",
                             .parent = LW_SCENE_NONE,
                             .rotation = {-sqrtf(0.5f), 0, 0, sqrtf(0.5f)}, /* -Z turned to -Y */
                             .scale = {1, 1, 1},
                             .translation = {position.x, position.y, position.z}};
    light.name = "light";
    light.node = scene->node_count++;
    scene->light[scene->light_count++] = light;
}
