/* The tiles of finer levels that liblightwell's views want, against those that the composer's pixels need. */
#include "tests/support/support.h"

#include "client/lib/live_survey.h"
#include "client/view/compose/compose.h"
#include "common/open/scene_open.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { WIDTH = 1280, HEIGHT = 720, FINER = 4, SLOTS = 1024 };

/* The light of level 0 is a checkerboard of texels, but where fill() makes it even. */
static struct {
    struct lw_scene *scene;
    struct lw_pose pose;
    struct lw_atlas_map map;
    float **level0; /* per object */
    float *texel_m; /* per mesh */
    float error;    /* of all tiles */
    uint32_t hidden;
} world;

static bool is_nothing_missing = true;

/* ---- the client, as the survey sees it ---- */

const struct lw_scene *__wrap_lw_client_scene(const struct lw_client *client);
const struct lw_atlas_map *__wrap_lw_client_atlas_map(const struct lw_client *client);
const struct lw_affine *__wrap_lw_client_object_to_world(const struct lw_client *client, uint32_t object);
bool __wrap_lw_client_object_hidden(const struct lw_client *client, uint32_t object);
struct lw_client_level __wrap_lw_client_get_level(const struct lw_client *client, uint32_t object,
                                                  uint32_t level);
struct lw_client_tile __wrap_lw_client_get_tile(const struct lw_client *client, lw_tile_id tile);
void __wrap_lw_client_get_stats(const struct lw_client *client, struct lw_client_stats *out_stats);

const struct lw_scene *__wrap_lw_client_scene(const struct lw_client *client) {
    (void)client;
    return world.scene;
}

const struct lw_atlas_map *__wrap_lw_client_atlas_map(const struct lw_client *client) {
    (void)client;
    return &world.map;
}

const struct lw_affine *__wrap_lw_client_object_to_world(const struct lw_client *client, uint32_t object) {
    (void)client;
    return &world.pose.object_to_world[object];
}

bool __wrap_lw_client_object_hidden(const struct lw_client *client, uint32_t object) {
    (void)client;
    return object == world.hidden;
}

struct lw_client_level __wrap_lw_client_get_level(const struct lw_client *client, uint32_t object,
                                                  uint32_t level) {
    (void)client;
    const struct lw_atlas *atlas = world.map.atlas[object];
    if (level != 0 || atlas->level_count == 0) return (struct lw_client_level){0};
    return (struct lw_client_level){atlas->level[0].width, atlas->level[0].height, world.level0[object],
                                    NULL};
}

struct lw_client_tile __wrap_lw_client_get_tile(const struct lw_client *client, lw_tile_id tile) {
    (void)client;
    const bool is_there = is_nothing_missing && tile.v < world.map.plain_count;
    return (struct lw_client_tile){.version = is_there, .bounces = 1, .error = world.error};
}

void __wrap_lw_client_get_stats(const struct lw_client *client, struct lw_client_stats *out_stats) {
    (void)client;
    *out_stats = (struct lw_client_stats){.noise_shown = 1};
}

/* ---- and the composer ---- */

static struct lw_client_level compose_level(const void *context, uint32_t object, uint32_t level) {
    (void)context;
    return __wrap_lw_client_get_level(NULL, object, level);
}

static struct lw_client_tile compose_tile(const void *context, lw_tile_id tile) {
    (void)context;
    return __wrap_lw_client_get_tile(NULL, tile);
}

/* ---- the world ---- */

static void fill(uint32_t o, bool even) {
    const struct lw_atlas *atlas = world.map.atlas[o];
    if (atlas->level_count == 0) return;
    const uint32_t width = atlas->level[0].width, height = atlas->level[0].height;
    for (uint32_t i = 0; i < width * height * 3; i++)
        world.level0[o][i] = (float)(1 + (even ? 0 : (i / 3 % width + i / 3 / width) % 2));
}

static struct lw_vec3 middle_of(const struct lw_mesh *mesh) {
    struct lw_vec3 low = mesh->position[0], high = low;
    for (uint32_t v = 0; v < mesh->vertex_count; v++) {
        low = lw_vec3_min(low, mesh->position[v]);
        high = lw_vec3_max(high, mesh->position[v]);
    }
    return lw_vec3_scale(lw_vec3_add(low, high), 0.5f);
}

static float texel_of(const struct lw_mesh *mesh) {
    double texels = 0, m2 = 0;
    for (uint32_t t = 0; mesh->lightmap_uv && t < mesh->triangle_count; t++) {
        const uint32_t *v = mesh->triangle[t];
        const struct lw_vec3 *p = mesh->position;
        texels += (double)fabsf(
            lw_vec2_twice_area(mesh->lightmap_uv[v[0]], mesh->lightmap_uv[v[1]], mesh->lightmap_uv[v[2]]));
        m2 += (double)lw_vec3_length(
            lw_vec3_cross(lw_vec3_sub(p[v[1]], p[v[0]]), lw_vec3_sub(p[v[2]], p[v[0]])));
    }
    return texels > 0 ? (float)sqrt(m2 / texels) : 0;
}

static int open_scene(struct lw_scene *scene) {
    world.scene = scene;
    lw_support_ok(lw_pose_init(&world.pose, world.scene), NULL);
    lw_support_ok(lw_atlas_map_init_finer(&world.map, world.scene, FINER, 4 * SLOTS), NULL);
    world.level0 = calloc(world.scene->object_count, sizeof *world.level0);
    world.texel_m = calloc(world.scene->mesh_count, sizeof *world.texel_m);
    world.hidden = UINT32_MAX;
    assert_true(world.level0 && world.texel_m);
    for (uint32_t m = 0; m < world.scene->mesh_count; m++) world.texel_m[m] = texel_of(&world.scene->mesh[m]);
    for (uint32_t o = 0; o < world.scene->object_count; o++) {
        const struct lw_atlas_level *l = &world.map.atlas[o]->level[0];
        world.level0[o] = calloc((size_t)l->width * l->height * 3 + 1, sizeof(float));
        assert_non_null(world.level0[o]);
        fill(o, false);
    }
    return 0;
}

static int open_world(void **state) {
    (void)state;
    struct lw_error err = {0};
    struct lw_scene *scene;
    lw_support_ok(lw_scene_open(&(struct lw_scene_open){.path = "builtin:cornell",
                                                        .texels_per_metre = 8,
                                                        .sun_angle_deg = LW_SCENE_OPEN_SUN_DIAMETER_DEG},
                                &scene, &err),
                  &err);
    return open_scene(scene);
}

static int close_world(void **state) {
    (void)state;
    for (uint32_t o = 0; o < world.scene->object_count; o++) free(world.level0[o]);
    free(world.level0);
    free(world.texel_m);
    lw_atlas_map_finish(&world.map);
    lw_pose_finish(&world.pose);
    lw_scene_destroy(world.scene);
    return 0;
}

static struct lw_camera_view camera(void) { return lw_camera_of_scene(world.scene, &world.pose, 0); }

/* Column by column, as OpenGL's; z is not read. */
static struct lw_live_view view_of(const struct lw_camera_view *c, uint32_t width, uint32_t height) {
    const float up = 1 / tanf(c->fov_y / 2), right = up * (float)height / (float)width;
    struct lw_live_view view = {.struct_size = sizeof view, .width = width, .height = height};
    const struct lw_vec3 axis[4] = {c->right, c->up, c->forward, c->forward};
    const float scale[4] = {right, up, 1, 1};
    for (int r = 0; r < 4; r++) {
        const float n[3] = {axis[r].x, axis[r].y, axis[r].z};
        for (int k = 0; k < 3; k++) view.view_projection[4 * k + r] = scale[r] * n[k];
        view.view_projection[12 + r] = -scale[r] * lw_vec3_dot(axis[r], c->position);
    }
    return view;
}

static uint32_t survey(const struct lw_live_view *view, uint32_t views, uint32_t most, lw_tile_id *out) {
    struct lw_live_survey s;
    lw_support_ok(lw_live_survey_init(&s, NULL, false, world.texel_m), NULL);
    const uint32_t count = lw_live_survey_list(&s, view, views, most, out);
    for (uint32_t i = 0; i < count; i++) {
        assert_true(out[i].v >= world.map.plain_count);
        assert_true(lw_atlas_map_is_used(&world.map, out[i]));
        for (uint32_t j = 0; j < i; j++) assert_int_not_equal(out[i].v, out[j].v);
    }
    lw_live_survey_finish(&s);
    return count;
}

static void release_all(void) {
    for (uint32_t t = world.map.plain_count; t < world.map.tile_count; t++)
        if (lw_atlas_map_is_used(&world.map, (lw_tile_id){t}))
            lw_atlas_map_release(&world.map, (lw_tile_id){t});
}

static bool lists(const lw_tile_id *list, uint32_t count, uint32_t tile) {
    for (uint32_t i = 0; i < count; i++)
        if (list[i].v == tile) return true;
    return false;
}

static uint32_t finest_of(const lw_tile_id *list, uint32_t count) {
    uint32_t finest = 0;
    for (uint32_t i = 0; i < count; i++) {
        const uint32_t k = lw_atlas_finer(world.map.place[list[i].v].level);
        if (k > finest) finest = k;
    }
    return finest;
}

/* ---- tests ---- */

/* The composer's pixels need almost the same tiles. The survey looks a little beyond the picture's edges. */
static void test_wants_what_pixels_need(void **state) {
    (void)state;
    struct lw_error err = {0};
    struct lw_trace *trace;
    struct lw_compose *compose;
    struct lw_compose_report report;
    static lw_tile_id list[SLOTS];
    const struct lw_compose_source source = {
        .level = compose_level, .tile = compose_tile, .bounces = 1, .target_error = 1, .noise_shown = 1};
    const struct lw_compose_view view = {.camera = camera(), .width = WIDTH, .height = HEIGHT};
    float *rgb = malloc(3 * sizeof *rgb * WIDTH * HEIGHT);
    assert_non_null(rgb);
    lw_support_ok(lw_trace_create(world.scene, &world.pose, &trace, &err), &err);
    lw_support_ok(
        lw_compose_create(&(struct lw_compose_desc){.scene = world.scene, .map = &world.map, .trace = trace},
                          &compose, &err),
        &err);
    lw_compose_render(compose, &source, &world.pose, &view, rgb, &report);
    const struct lw_live_view same = view_of(&view.camera, WIDTH, HEIGHT);
    const uint32_t count = survey(&same, 1, SLOTS, list);
    uint32_t needed = 0, found = 0;
    for (uint32_t t = world.map.plain_count; t < world.map.tile_count; t++)
        if (lw_compose_needed(compose)[t]) {
            needed++;
            found += lists(list, count, t);
        }
    print_message("the composer needs %u tiles, the survey has %u of them, and %u in all\n", needed, found,
                  count);
    assert_true(needed > 20);
    assert_true(20 * found >= 19 * needed);
    assert_true(count <= 2 * needed);
    lw_compose_destroy(compose);
    lw_trace_destroy(trace);
    free(rgb);
    release_all();
}

/* Light that is even is the same in finer tiles; light that is noisy, or has not come, may be. Small
 * triangles, as the lamp's, want finer tiles all the same. */
static void test_wants_nothing_of_what_is_even(void **state) {
    (void)state;
    static lw_tile_id list[SLOTS];
    const struct lw_camera_view from = camera();
    const struct lw_live_view view = view_of(&from, WIDTH, HEIGHT);
    const uint32_t all = survey(&view, 1, SLOTS, list);
    assert_true(all > 20);
    world.error = 0.2f;
    const uint32_t small = survey(&view, 1, SLOTS, list);
    assert_true(small < all / 5);
    world.error = 0;
    is_nothing_missing = false;
    assert_int_equal(survey(&view, 1, SLOTS, list), small);
    is_nothing_missing = true;
    for (uint32_t o = 0; o < world.scene->object_count; o++) fill(o, true);
    assert_int_equal(survey(&view, 1, SLOTS, list), small);
    for (uint32_t o = 0; o < world.scene->object_count; o++) fill(o, false);
    assert_int_equal(survey(&view, 1, SLOTS, list), all);
    release_all();
}

/* A picture of fewer pixels, and one from further away, want coarser levels, or none. */
static void test_pixels_choose_the_level(void **state) {
    (void)state;
    static lw_tile_id list[SLOTS];
    struct lw_camera_view from = camera();
    const struct lw_live_view large = view_of(&from, 2 * WIDTH, 2 * HEIGHT),
                              view = view_of(&from, WIDTH, HEIGHT),
                              small = view_of(&from, WIDTH / 16, HEIGHT / 16);
    const uint32_t of_large = finest_of(list, survey(&large, 1, SLOTS, list)),
                   of_view = finest_of(list, survey(&view, 1, SLOTS, list)),
                   of_small = finest_of(list, survey(&small, 1, SLOTS, list));
    print_message("finest levels: %u, %u, %u\n", of_large, of_view, of_small);
    assert_true(of_large > of_view && of_view > of_small);
    from.position = lw_vec3_mad(from.position, from.forward, -1000);
    const struct lw_live_view far = view_of(&from, WIDTH, HEIGHT);
    assert_int_equal(survey(&far, 1, SLOTS, list), 0);
    release_all();
}

/* Where there are fewer slots than tiles that are shown, all are wanted coarser; then most pixels count. */
static void test_fewer_slots_mean_coarser_tiles(void **state) {
    (void)state;
    static lw_tile_id list[SLOTS];
    const struct lw_camera_view from = camera();
    const struct lw_live_view view = view_of(&from, 2 * WIDTH, 2 * HEIGHT);
    const uint32_t all = survey(&view, 1, SLOTS, list), finest = finest_of(list, all);
    print_message("%u tiles\n", all);
    assert_true(all > 40);
    const uint32_t some = survey(&view, 1, all / 2, list);
    assert_true(some > 0 && some <= all / 2);
    assert_true(finest_of(list, some) < finest);
    assert_int_equal(survey(&view, 1, 3, list), 3);
    assert_int_equal(finest_of(list, 3), 1);
    assert_int_equal(survey(&view, 1, 0, list), 0);
    release_all();
    /* the same when ids are short: tiles without one are left out */
    const struct lw_atlas_map whole = world.map;
    lw_support_ok(lw_atlas_map_init_finer(&world.map, world.scene, FINER, 5), NULL);
    assert_int_equal(survey(&view, 1, SLOTS, list), 5);
    lw_atlas_map_finish(&world.map);
    world.map = whole;
}

/* What an object hides is not wanted; where it is hidden itself, that is. */
static void test_knows_what_is_hidden(void **state) {
    (void)state;
    static lw_tile_id with[SLOTS], without[SLOTS];
    bool any = false;
    for (uint32_t o = 0; o < world.scene->object_count; o++) {
        const struct lw_affine *to_world = &world.pose.object_to_world[o];
        const struct lw_vec3 at =
            lw_affine_point(to_world, middle_of(&world.scene->mesh[world.scene->object[o].mesh]));
        const struct lw_camera_view from = lw_camera_look_at(camera().position, at, 0.04f); /* a close look */
        const struct lw_live_view view = view_of(&from, WIDTH, HEIGHT);
        world.hidden = o;
        const uint32_t count = survey(&view, 1, SLOTS, without);
        for (uint32_t i = 0; i < count; i++) assert_int_not_equal(world.map.place[without[i].v].object, o);
        world.hidden = UINT32_MAX;
        const uint32_t all = survey(&view, 1, SLOTS, with);
        for (uint32_t i = 0; i < count; i++) any |= !lists(with, all, without[i].v);
        if (!strstr(world.scene->object[o].name, "block")) continue;
        for (uint32_t i = 0; i < all; i++) assert_int_equal(world.map.place[with[i].v].object, o);
        assert_true(all > 0); /* it fills the picture */
    }
    assert_true(any);
    release_all();
}

static struct lw_vec3 middle_of_object(const char *name) {
    for (uint32_t o = 0; o < world.scene->object_count; o++)
        if (strcmp(world.scene->object[o].name, name) == 0)
            return lw_affine_point(&world.pose.object_to_world[o],
                                   middle_of(&world.scene->mesh[world.scene->object[o].mesh]));
    fail_msg("there is no %s", name);
    return lw_vec3(0, 0, 0);
}

/* Two blocks stand in a line: the nearer one is seen, in either order of drawing. */
static void test_the_nearer_one_counts(void **state) {
    (void)state;
    static lw_tile_id list[SLOTS];
    const char *name[2] = {"short block", "tall block"};
    for (int near = 0; near < 2; near++) {
        const struct lw_vec3 at = middle_of_object(name[near]), other = middle_of_object(name[!near]),
                             eye = lw_vec3_mad(at, lw_vec3_normalize(lw_vec3_sub(at, other)), 1.2f);
        const struct lw_camera_view from = lw_camera_look_at(eye, at, 0.04f);
        const struct lw_live_view view = view_of(&from, WIDTH, HEIGHT);
        const uint32_t count = survey(&view, 1, SLOTS, list);
        assert_true(count > 0);
        for (uint32_t i = 0; i < count; i++)
            assert_string_equal(world.scene->object[world.map.place[list[i].v].object].name, name[near]);
    }
    release_all();
}

/* From behind a wall that has one side alone the room is seen, and not the wall. */
static void test_backs_are_left_out(void **state) {
    (void)state;
    static lw_tile_id list[SLOTS];
    bool wall = false, floor = false;
    const struct lw_camera_view front = camera();
    const struct lw_vec3 behind = lw_vec3_mad(front.position, front.forward, 7);
    const struct lw_camera_view from = lw_camera_look_at(behind, front.position, front.fov_y);
    const struct lw_live_view view = view_of(&from, 2 * WIDTH, 2 * HEIGHT);
    const uint32_t count = survey(&view, 1, SLOTS, list);
    for (uint32_t i = 0; i < count; i++) {
        const char *name = world.scene->object[world.map.place[list[i].v].object].name;
        wall |= strcmp(name, "back wall") == 0;
        floor |= strcmp(name, "floor") == 0;
    }
    assert_true(floor && !wall);
    release_all();
}

/* Views that are no pictures in perspective, or show nothing, want nothing. */
static void test_odd_views(void **state) {
    (void)state;
    static lw_tile_id list[SLOTS];
    const struct lw_camera_view from = camera();
    struct lw_live_view view[2] = {view_of(&from, WIDTH, HEIGHT), view_of(&from, WIDTH, HEIGHT)};
    const uint32_t one = survey(view, 1, SLOTS, list);
    assert_int_equal(survey(view, 2, SLOTS, list), one); /* the same twice */
    for (int k = 0; k < 4; k++) view[1].view_projection[4 * k + 3] = k == 3;
    assert_int_equal(survey(&view[1], 1, SLOTS, list), 0); /* orthographic */
    memset(view[1].view_projection, 0, sizeof view[1].view_projection);
    assert_int_equal(survey(&view[1], 1, SLOTS, list), 0);
    view[1] = view_of(&from, WIDTH, HEIGHT);
    for (int k = 0; k < 16; k++) view[1].view_projection[k] *= 1e30f;
    (void)survey(&view[1], 1, SLOTS, list);
    view[1] = view_of(&from, 1, 1);
    assert_true(survey(&view[1], 1, SLOTS, list) < one);
    view[1] = view_of(&from, UINT32_MAX, 1);
    (void)survey(&view[1], 1, SLOTS, list);
    release_all();
}

/* Squares that all fill the picture, each nearer than the one before. */
static struct lw_scene *pile(uint32_t count) {
    struct lw_scene *scene = lw_support_squares(count, 4);
    struct lw_mesh *mesh = &scene->mesh[0];
    struct lw_vec2 *uv = lw_scene_alloc(scene, 4, sizeof *uv);
    for (int i = 0; i < 4; i++) uv[i] = (struct lw_vec2){mesh->uv[0][i].x * 32, mesh->uv[0][i].y * 32};
    mesh->lightmap_uv = uv;
    mesh->atlas_width = mesh->atlas_height = 32;
    for (uint32_t i = 0; i < count; i++) {
        scene->node[i].translation[0] = 0;
        scene->node[i].translation[1] = 0.001f * (float)i;
    }
    return scene;
}

/* A picture costs no more than WORK_MAX cells: later triangles are left out. */
static void test_work_is_bounded(void **state) {
    (void)state;
    static lw_tile_id list[SLOTS];
    const uint32_t fits = LW_LIVE_SURVEY_WORK_MAX / (2 * LW_LIVE_SURVEY_SIDE * LW_LIVE_SURVEY_SIDE);
    const struct lw_camera_view from = lw_camera_look_at(lw_vec3(0, 2, 0.001f), lw_vec3(0, 0, 0), 0.5f);
    (void)close_world(NULL);
    for (uint32_t more = 0; more < 2; more++) {
        (void)open_scene(pile(fits + more));
        const struct lw_live_view view = view_of(&from, HEIGHT, HEIGHT);
        const uint32_t count = survey(&view, 1, SLOTS, list);
        assert_true(count > 0);
        for (uint32_t i = 0; i < count; i++)
            assert_int_equal(world.map.place[list[i].v].object, fits - 1); /* the nearest that is drawn */
        (void)close_world(NULL);
    }
    (void)open_world(NULL);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_wants_what_pixels_need),  cmocka_unit_test(test_wants_nothing_of_what_is_even),
        cmocka_unit_test(test_pixels_choose_the_level), cmocka_unit_test(test_fewer_slots_mean_coarser_tiles),
        cmocka_unit_test(test_knows_what_is_hidden),    cmocka_unit_test(test_odd_views),
        cmocka_unit_test(test_the_nearer_one_counts),   cmocka_unit_test(test_backs_are_left_out),
        cmocka_unit_test(test_work_is_bounded),
    };
    return cmocka_run_group_tests(tests, open_world, close_world);
}
