#include "tests/support/support.h"

#include <string.h>

#define COUNT(array) ((uint32_t)(sizeof(array) / sizeof *(array)))
/* A copy of a constant array in the scene's storage. */
#define KEEP(scene, array) keep(scene, array, sizeof(array))

static void *keep(struct lw_scene *scene, const void *data, size_t size) {
    void *copy = lw_scene_alloc(scene, size, 1);
    assert_non_null(copy);
    memcpy(copy, data, size);
    return copy;
}

static void add_textures(struct lw_scene *scene) {
    static const uint8_t checker[2 * 2 * 4] = {255, 0, 0,   255, 0,   255, 0,   128,
                                               0,   0, 255, 64,  255, 255, 255, 0};
    static const uint8_t grey[4] = {188, 188, 188, 255};
    static const uint8_t ramp[3 * 1 * 4] = {0, 1, 2, 3, 100, 101, 102, 103, 250, 251, 252, 253};
    const struct lw_texture textures[] = {
        {"checker", 2, 2, KEEP(scene, checker), LW_WRAP_REPEAT, LW_WRAP_CLAMP, LW_CONTENT_COLOUR},
        {"", 1, 1, KEEP(scene, grey), LW_WRAP_MIRROR, LW_WRAP_REPEAT, LW_CONTENT_COLOUR},
        {"Rampe größer", 3, 1, KEEP(scene, ramp), LW_WRAP_CLAMP, LW_WRAP_MIRROR, LW_CONTENT_COLOUR},
    };
    scene->texture = KEEP(scene, textures);
    scene->texture_count = COUNT(textures);
}

static void add_materials(struct lw_scene *scene) {
    const struct lw_texture_use none = {LW_SCENE_NONE, 0, {1, 0, 0, 0, 1, 0}};
    const struct lw_material materials[] = {
        {"plain", {0.25f, 0.5f, 0.75f, 1}, none, {0, 0, 0}, none, 0.5f, LW_ALPHA_OPAQUE, 0, 0, 0, {0}, NULL},
        {"leaf 葉",
         {1, 1, 1, 1},
         {0, 1, {2, 0, 0.5f, 0, -1, 1}},
         {0, 0, 0},
         none,
         0.25f,
         LW_ALPHA_MASK,
         1,
         0,
         0,
         {0},
         NULL},
        {"lamp",
         {0, 0, 0, 0.5f},
         {2, 0, {1, 0, 0, 0, 1, 0}},
         {10, 5, 2.5f},
         {1, 1, {0, 1, 0, 1, 0, 0}},
         0,
         LW_ALPHA_BLEND,
         0,
         0,
         0,
         {0},
         NULL},
    };
    scene->material = KEEP(scene, materials);
    scene->material_count = COUNT(materials);
}

static void add_meshes(struct lw_scene *scene) {
    static const struct lw_vec3 square[] = {{-1, 0, -1}, {1, 0, -1}, {-1, 0, 1}, {1, 0, 1}};
    static const struct lw_vec3 up[] = {{0, 1, 0}, {0, 1, 0}, {0, 1, 0}, {0, 1, 0}};
    static const struct lw_vec2 uv0[] = {{0, 0}, {1, 0}, {0, 1}, {1, 1}};
    static const struct lw_vec2 uv1[] = {{0, 0}, {0.5f, 0}, {0, 0.5f}, {0.5f, 0.5f}};
    static const struct lw_vec4 colour[] = {{1, 1, 1, 1}, {1, 0.5f, 1, 1}, {1, 1, 0.5f, 0.5f}, {0, 0, 0, 1}};
    static const struct lw_vec2 lightmap[] = {{2, 2}, {10, 2}, {2, 10}, {10, 10}};
    static const uint32_t square_triangle[][3] = {{0, 2, 1}, {1, 2, 3}}, square_material[] = {1, 2};
    static const struct lw_vec3 corner[] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
    static const struct lw_vec3 front[] = {{0, 0, 1}, {0, 0, 1}, {0, 0, 1}};
    static const uint32_t corner_triangle[][3] = {{0, 1, 2}}, corner_material[] = {0};
    const struct lw_mesh meshes[] = {
        {.name = "full",
         .vertex_count = 4,
         .triangle_count = 2,
         .position = KEEP(scene, square),
         .normal = KEEP(scene, up),
         .uv = {KEEP(scene, uv0), KEEP(scene, uv1)},
         .colour = KEEP(scene, colour),
         .triangle = KEEP(scene, square_triangle),
         .material = KEEP(scene, square_material),
         .lightmap_uv = KEEP(scene, lightmap),
         .atlas_width = 12,
         .atlas_height = 24,
         .back_offset = 12},
        {.name = "\xF0\x9F\x94\xBA",
         .vertex_count = 3,
         .triangle_count = 1,
         .position = KEEP(scene, corner),
         .normal = KEEP(scene, front),
         .triangle = KEEP(scene, corner_triangle),
         .material = KEEP(scene, corner_material)},
    };
    scene->mesh = KEEP(scene, meshes);
    scene->mesh_count = COUNT(meshes);
}

static void add_nodes(struct lw_scene *scene) {
    const struct lw_node nodes[] = {
        {.name = "root",
         .parent = LW_SCENE_NONE,
         .translation = {1, 2, 3},
         .rotation = {0, 0, 0, 1},
         .scale = {1, 1, 1}},
        {.name = "mirror",
         .parent = 0,
         .matrix = {{{-1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 5}}},
         .has_matrix = 1},
        {.name = "turned", .parent = 1, .rotation = {0, 0.70710678f, 0, 0.70710678f}, .scale = {1, 2, 1}},
        {.name = "",
         .parent = 0,
         .translation = {0, 10, 0},
         .rotation = {0.6f, 0, 0, 0.8f},
         .scale = {1, 1, 1}},
    };
    scene->node = KEEP(scene, nodes);
    scene->node_count = COUNT(nodes);
    const struct lw_object objects[] = {{"first", 0, 2}, {"second", 0, 3}, {"", 1, 0}};
    scene->object = KEEP(scene, objects);
    scene->object_count = COUNT(objects);
    const struct lw_light lights[] = {
        {"point", 3, LW_LIGHT_POINT, {1, 2, 3}, 0, 0, 0, 0},
        {"spot", 2, LW_LIGHT_SPOT, {4, 5, 6}, 0.1f, 0.75f, 0, 0},
        {"sun", 0, LW_LIGHT_DIRECTIONAL, {100000, 90000, 80000}, 0, 0, 0.0093f, 0},
    };
    scene->light = KEEP(scene, lights);
    scene->light_count = COUNT(lights);
    const struct lw_camera cameras[] = {{"main", 3, 1.0f, 0}, {"камера", 0, 0.5f, 0}};
    scene->camera = KEEP(scene, cameras);
    scene->camera_count = COUNT(cameras);
}

static void add_channels(struct lw_scene *scene) {
    static const float times[] = {0, 1, 2}, late[] = {0.5f, 4};
    static const float step[] = {0, 0, 0, 1, 0, 0, 2, 2, 2};
    static const float turn[] = {0, 0, 0, 1, 0, 0.70710678f, 0, 0.70710678f, 0, 1, 0, 0};
    static const float grow[] = {0, 0, 0, 1, 1, 1, 0.5f, 0, 0, 0, -0.5f, 0, 2, 2, 2, 0, 0, 0};
    static const float roll[] = {0, 0, 0,      0, 0, 0, 0, 1, 0, 0, 0.25f, 0,
                                 0, 0, 0.125f, 0, 0, 0, 1, 0, 0, 0, 0,     0};
    const struct lw_channel channels[] = {
        {0, LW_CHANNEL_TRANSLATION, LW_INTERPOLATION_STEP, 3, KEEP(scene, times), KEEP(scene, step)},
        {2, LW_CHANNEL_ROTATION, LW_INTERPOLATION_LINEAR, 3, KEEP(scene, times), KEEP(scene, turn)},
        {2, LW_CHANNEL_SCALE, LW_INTERPOLATION_CUBIC, 2, KEEP(scene, late), KEEP(scene, grow)},
        {3, LW_CHANNEL_ROTATION, LW_INTERPOLATION_CUBIC, 2, KEEP(scene, late), KEEP(scene, roll)},
        {3, LW_CHANNEL_TRANSLATION, LW_INTERPOLATION_LINEAR, 1, KEEP(scene, late), KEEP(scene, step)},
    };
    scene->channel = KEEP(scene, channels);
    scene->channel_count = COUNT(channels);
    scene->duration_s = 4;
}

/* Two materials; each content, one texture that two uses share, tangents of one mesh. */
void lw_support_add_finishes(struct lw_scene *scene) {
    static const uint8_t bumps[2 * 2 * 4] = {128, 128, 255, 255, 200, 100, 233, 255,
                                             0,   128, 128, 255, 128, 255, 128, 255};
    static const uint8_t surface[3 * 1 * 4] = {255, 10, 0, 255, 200, 100, 128, 255, 0, 255, 255, 255};
    static const uint8_t colour[1 * 2 * 4] = {1, 2, 3, 4, 250, 251, 252, 253};
    const struct lw_texture textures[] = {
        {"bumps", 2, 2, KEEP(scene, bumps), LW_WRAP_REPEAT, LW_WRAP_CLAMP, LW_CONTENT_NORMAL},
        {"", 3, 1, KEEP(scene, surface), LW_WRAP_MIRROR, LW_WRAP_REPEAT, LW_CONTENT_SURFACE},
        {"Glanz größer", 1, 2, KEEP(scene, colour), LW_WRAP_CLAMP, LW_WRAP_MIRROR, LW_CONTENT_COLOUR},
    };
    const struct lw_texture_use none = {LW_SCENE_NONE, 0, {1, 0, 0, 0, 1, 0}};
    const struct lw_finish finishes[] = {
        {0.25f,
         0.5f,
         {1, 1, {2, 0, 0.5f, 0, -1, 1}},
         0.75f,
         {1, 0.5f, 2},
         none,
         1.33f,
         0.875f,
         {1, 0, {1, 0, 0, 0, 1, 0}},
         -1.5f,
         {0, 0, {0, 1, 0, 1, 0, 0}}},
        {1, 0, none, 1, {1, 1, 1}, {2, 1, {1, 0, 0, 0, 1, 0}}, 1.5f, 0, none, 1, none},
    };
    static const uint16_t tangents[] = {0, 0x8000, 0x7fff, 1, 0xffff, 12345};
    const struct lw_finish *kept = KEEP(scene, finishes);
    scene->finish_texture = KEEP(scene, textures);
    scene->finish_texture_count = COUNT(textures);
    scene->material[1].finish = &kept[0];
    scene->material[2].finish = &kept[1];
    scene->mesh[0].tangent = KEEP(scene, tangents);
}

struct lw_scene *lw_support_everything(void) {
    struct lw_scene *scene;
    lw_support_ok(lw_scene_create(&scene), NULL);
    scene->name = lw_scene_string(scene, "everything, even ünïcode");
    add_textures(scene);
    add_materials(scene);
    add_meshes(scene);
    add_nodes(scene);
    add_channels(scene);
    scene->sky[0] = 0.5f;
    scene->sky[1] = 0.75f;
    scene->sky[2] = 1;
    return scene;
}
