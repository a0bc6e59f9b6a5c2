/* Which side of double-sided charts a baked file shows: by cameras, by light, by choice. */
#include "tests/support/support.h"

#include "common/lightmap/lightmap.h"
#include "server/bake/sides.h"

#include <stdlib.h>
#include <string.h>

/* A mesh of two squares apart, both at z = 0: of the first the front looks at +z, of the second the back. A
 * camera in front of them at z = 2. */
struct fixture {
    struct lw_scene *scene;
    struct lw_pose pose;
    struct lw_map map;
};

static void add_square(struct lw_vec3 *position, struct lw_vec3 *normal, uint32_t (*triangle)[3], float x,
                       bool turned) {
    const uint32_t first = x > 0 ? 4 : 0;
    for (uint32_t i = 0; i < 4; i++) {
        position[first + i] = lw_vec3(x + (float)(i & 1), (float)(i >> 1), 0);
        normal[first + i] = lw_vec3(0, 0, turned ? -1 : 1);
    }
    const uint32_t up[2][3] = {{0, 1, 2}, {2, 1, 3}};
    for (uint32_t t = 0; t < 2; t++)
        for (uint32_t k = 0; k < 3; k++) triangle[first / 2 + t][k] = first + up[t][turned ? 2 - k : k];
}

static void set_up(struct fixture *f, bool with_camera, bool double_sided) {
    struct lw_scene *scene;
    struct lw_error err = {0};
    lw_support_ok(lw_scene_create(&scene), NULL);
    struct lw_vec3 *position = lw_scene_alloc(scene, 8, sizeof *position);
    struct lw_vec3 *normal = lw_scene_alloc(scene, 8, sizeof *normal);
    uint32_t(*triangle)[3] = lw_scene_alloc(scene, 4, sizeof *triangle);
    add_square(position, normal, triangle, -2, false);
    add_square(position, normal, triangle, 1, true);
    scene->name = "two";
    scene->mesh = lw_scene_alloc(scene, 1, sizeof *scene->mesh);
    scene->material = lw_scene_alloc(scene, 1, sizeof *scene->material);
    scene->node = lw_scene_alloc(scene, 2, sizeof *scene->node);
    scene->object = lw_scene_alloc(scene, 1, sizeof *scene->object);
    scene->camera = lw_scene_alloc(scene, 1, sizeof *scene->camera);
    scene->mesh_count = scene->material_count = scene->object_count = 1;
    scene->node_count = 2;
    scene->camera_count = with_camera;
    scene->mesh[0] = (struct lw_mesh){.name = "two",
                                      .vertex_count = 8,
                                      .triangle_count = 4,
                                      .position = position,
                                      .normal = normal,
                                      .triangle = (const uint32_t(*)[3])triangle,
                                      .material = lw_scene_alloc(scene, 4, sizeof *scene->mesh->material)};
    scene->material[0] = (struct lw_material){.name = "",
                                              .base_colour = {0.5f, 0.5f, 0.5f, 1},
                                              .base_colour_texture = {.texture = LW_SCENE_NONE},
                                              .emission_texture = {.texture = LW_SCENE_NONE},
                                              .double_sided = double_sided};
    for (uint32_t n = 0; n < 2; n++)
        scene->node[n] = (struct lw_node){.name = "",
                                          .parent = LW_SCENE_NONE,
                                          .rotation = {0, 0, 0, 1},
                                          .scale = {1, 1, 1},
                                          .matrix = LW_AFFINE_IDENTITY};
    scene->node[1].translation[2] = 2;
    scene->object[0] = (struct lw_object){.name = "two", .mesh = 0, .node = 0};
    scene->camera[0] = (struct lw_camera){.name = "", .node = 1, .fov_y = 1};
    lw_support_ok(lw_lightmap_build(scene, &(struct lw_lightmap_desc){.texels_per_metre = 8}, NULL, &err),
                  &err);
    const struct lw_mesh *mesh = scene->mesh;
    *f = (struct fixture){.scene = scene,
                          .map = {.width = mesh->atlas_width,
                                  .height = mesh->atlas_height,
                                  .back_offset = mesh->back_offset,
                                  .rgba = calloc((size_t)mesh->atlas_width * mesh->atlas_height * 4, 4)}};
    assert_true(double_sided == (mesh->back_offset > 0));
    lw_support_ok(lw_pose_init(&f->pose, scene), NULL);
}

/* Light on the front and on the back of both squares. */
static void light(struct fixture *f, float front, float back) {
    for (uint32_t y = 0; y < f->map.height; y++)
        for (uint32_t i = 0; i < f->map.width * 4; i++)
            f->map.rgba[(size_t)y * f->map.width * 4 + i] = y < f->map.back_offset ? front : back;
}

static void tear_down(struct fixture *f) {
    lw_pose_finish(&f->pose);
    lw_scene_destroy(f->scene);
    free(f->map.rgba);
}

/* shown: "front", "back" or "mixed"; both: whether the other sides matter too. */
static void expect(struct fixture *f, enum lw_sides_choice choice, const char *shown, double both_m2) {
    struct lw_sides sides;
    struct lw_sides_shown got;
    struct lw_error err = {0};
    lw_support_ok(lw_sides_init(&sides, f->scene, &f->pose, choice, &err), &err);
    lw_support_ok(lw_sides_choose(&sides, &f->map, &got, &err), &err);
    assert_string_equal(lw_sides_name(&got), shown);
    assert_float_equal(got.both_m2, both_m2, 1e-6);
    if (strcmp(shown, "mixed") == 0)
        for (uint32_t i = 0; i < 8; i++) assert_int_equal(got.back[i], f->scene->mesh[0].position[i].x > 0);
    lw_sides_release(&got);
    lw_sides_finish(&sides);
}

static void what_cameras_see_is_shown(void **state) {
    (void)state;
    struct fixture f;
    set_up(&f, true, true);
    light(&f, 1, 0.5f); /* the light would choose the fronts */
    expect(&f, LW_SIDES_AUTO, "mixed", 0);
    expect(&f, LW_SIDES_FRONT, "front", 2); /* then no ray is sent: half of the light is not shown */
    expect(&f, LW_SIDES_BACK, "back", 2);
    tear_down(&f);
}

static void without_a_camera_light_decides(void **state) {
    (void)state;
    struct fixture f;
    set_up(&f, false, true);
    light(&f, 0, 2);
    expect(&f, LW_SIDES_AUTO, "back", 0);
    light(&f, 0.15f, 2);
    expect(&f, LW_SIDES_AUTO, "back", 0);
    light(&f, 0.25f, 2); /* an eighth of the other's */
    expect(&f, LW_SIDES_AUTO, "back", 2);
    light(&f, 2, 0.25f);
    expect(&f, LW_SIDES_AUTO, "front", 2);
    light(&f, 0, 0);
    expect(&f, LW_SIDES_AUTO, "front", 0);
    tear_down(&f);
}

/* A camera that sees a chart by chance only does not choose. */
static void a_camera_far_away_does_not_choose(void **state) {
    (void)state;
    struct fixture f;
    set_up(&f, true, true);
    f.scene->node[1].translation[2] = 5000;
    lw_pose_evaluate(&f.pose, f.scene, 0);
    light(&f, 0, 2);
    expect(&f, LW_SIDES_AUTO, "back", 0);
    tear_down(&f);
}

static void single_sided_meshes_show_their_fronts(void **state) {
    (void)state;
    struct fixture f;
    set_up(&f, true, false);
    light(&f, 0, 2);
    expect(&f, LW_SIDES_AUTO, "front", 0);
    expect(&f, LW_SIDES_BACK, "front", 0);
    tear_down(&f);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_cameras_see_is_shown),
        cmocka_unit_test(without_a_camera_light_decides),
        cmocka_unit_test(a_camera_far_away_does_not_choose),
        cmocka_unit_test(single_sided_meshes_show_their_fronts),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
