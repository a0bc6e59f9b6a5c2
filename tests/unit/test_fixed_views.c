#include "tests/support/support.h"

#include "client/measure/sides/fixed_views.h"
#include "client/measure/sides/path_world.h"
#include "client/measure/sides/views.h"
#include "common/builtin/builtin.h"
#include "common/open/scene_open.h"
#include "common/scene/scene_motion.h"

#include <math.h>
#include <string.h>

#define WIDTH  48u
#define HEIGHT 27u
#define LAMP_M 0.3f /* its own surface is not in the way */
#define NEAR_M 8.0f

static struct lw_scene *build(const char *name) {
    struct lw_scene *scene;
    struct lw_error err = {0};
    lw_support_ok(lw_builtin_build(name, &scene, &err), &err);
    return scene;
}

/* The number of pixels of a small picture that show something. */
static double render(const struct lw_path_world *world, const struct lw_camera_view *camera,
                     uint32_t *out_pixels) {
    struct lw_path_film film;
    float rgb[WIDTH * HEIGHT * 3];
    double sum = 0;
    lw_support_ok(lw_path_film_init(&film, WIDTH, HEIGHT, NULL), NULL);
    lw_path_world_render(world, &(struct lw_path_view){.camera = *camera, .seed = 3}, 4, &film);
    lw_path_film_resolve(&film, rgb);
    *out_pixels = 0;
    for (uint32_t i = 0; i < WIDTH * HEIGHT; i++) {
        *out_pixels += rgb[3 * i] + rgb[3 * i + 1] + rgb[3 * i + 2] > 0;
        sum += (double)(0.2126f * rgb[3 * i] + 0.7152f * rgb[3 * i + 1] + 0.0722f * rgb[3 * i + 2]);
    }
    lw_path_film_finish(&film);
    return sum / (WIDTH * HEIGHT);
}

static float sight(const struct lw_path_world *world, const struct lw_camera_view *camera) {
    struct lw_ray16 rays = {.salt = 0};
    struct lw_hit16 hits;
    lw_trace_set_ray(&rays, 0, camera->position, camera->forward, INFINITY);
    lw_trace_closest16(world->trace, LW_TRACE_VIEW, 1, &rays, &hits);
    return hits.object[0] == LW_TRACE_MISS ? INFINITY : hits.t[0];
}

/* Free where they stand and where they drift to, something that is lit in sight, from dark to bright. */
static void check(const struct lw_scene *scene, const struct lw_fixed_views *views) {
    struct lw_path_world world;
    struct lw_error err = {0};
    lw_support_ok(lw_path_world_init(&world, scene, 2, 0, &err), &err);
    double darkest = (double)INFINITY, brightest = 0;
    for (uint32_t i = 0; i < LW_FIXED_VIEWS_COUNT; i++) {
        for (int k = 0; k < 4; k++) {
            const struct lw_camera_view camera = lw_fixed_views_at(views, i, k);
            if (!lw_views_is_free(world.trace, camera.position, 0.25f, i))
                fail_msg("%s: view %u: no free place at %d s", scene->name, i, k);
        }
        const struct lw_camera_view camera = lw_fixed_views_at(views, i, 0);
        uint32_t pixels;
        const double luminance = render(&world, &camera, &pixels);
        if (!(sight(&world, &camera) >= 1.49f)) fail_msg("%s: view %u: nose at a wall", scene->name, i);
        if (pixels < WIDTH * HEIGHT / 4) fail_msg("%s: view %u: black", scene->name, i);
        darkest = fmin(darkest, luminance);
        brightest = fmax(brightest, luminance);
    }
    if (!(brightest > 5 * darkest)) fail_msg("%s: from %g to %g alone", scene->name, darkest, brightest);
    lw_path_world_finish(&world);
}

static void tables_show_something(void **state) {
    (void)state;
    static const char *const name[] = {"builtin:atrium-matt", "builtin:city"};
    for (size_t i = 0; i < sizeof name / sizeof *name; i++) {
        struct lw_scene *scene = build(name[i]);
        struct lw_fixed_views views;
        struct lw_error err = {0};
        lw_support_ok(lw_fixed_views_init(&views, scene, 0, &err), &err);
        assert_true(views.from_table);
        check(scene, &views);
        lw_scene_destroy(scene);
    }
}

/* Whether a view has a point in its middle part, with nothing before it. */
static bool sees(const struct lw_path_world *world, const struct lw_camera_view *camera, struct lw_vec3 at) {
    const struct lw_vec3 way = lw_vec3_sub(at, camera->position);
    const float length = lw_vec3_length(way), ahead = lw_vec3_dot(way, camera->forward);
    if (!(ahead > length * cosf(25 * LW_PI / 180))) return false;
    struct lw_ray16 rays = {.salt = 0};
    lw_trace_set_ray(&rays, 0, camera->position, lw_vec3_scale(way, 1 / length), length - LAMP_M);
    return !lw_trace_occluded16(world->trace, 0, 1, &rays);
}

/* Rows are judged at 2 s and compared with the light of 1 s: the lamp must be near by then, in some views. */
static void the_atriums_lamp_walks_by(void **state) {
    (void)state;
    struct lw_scene *scene = build("builtin:atrium-matt");
    struct lw_fixed_views views;
    struct lw_path_world world;
    struct lw_scene_motion_way way;
    struct lw_error err = {0};
    lw_support_ok(lw_fixed_views_init(&views, scene, 0, &err), &err);
    lw_support_ok(lw_scene_motion_find_way(scene, LW_SCENE_MOTION_LAMP_WALK, &way, &err), &err);
    lw_support_ok(lw_path_world_init(&world, scene, 0, 0, &err), &err);
    const struct lw_vec3 step =
        lw_vec3_scale(lw_vec3_normalize(lw_vec3_sub(way.to_ws, way.from_ws)), LW_SCENE_MOTION_WALK_M_S);
    unsigned see = 0;
    for (uint32_t v = 0; v < LW_FIXED_VIEWS_COUNT; v++) {
        bool near = false;
        for (uint32_t k = 0; k <= 40; k++) { /* to 8 s */
            const float time_s = 0.2f * (float)k;
            const struct lw_camera_view camera = lw_fixed_views_at(&views, v, (double)time_s);
            const struct lw_vec3 at = lw_vec3_mad(way.from_ws, step, time_s);
            const float distance = lw_vec3_length(lw_vec3_sub(at, camera.position));
            if (distance < 1) fail_msg("view %u: the lamp comes as near as %g m", v, (double)distance);
            near |= k >= 5 && k <= 10 && distance < NEAR_M && sees(&world, &camera, at);
        }
        see += near;
    }
    if (see < 3) fail_msg("only %u views see the lamp from 1 to 2 s", see);
    lw_path_world_finish(&world);
    lw_scene_destroy(scene);
}

static void sponza_has_a_table(void **state) {
    (void)state;
    const struct lw_scene_open open = {.path = lw_support_scene("sponza/Sponza_lit.gltf"),
                                       .sun_angle_deg = LW_SCENE_OPEN_SUN_DIAMETER_DEG,
                                       .texels_per_metre = 2};
    struct lw_scene *scene;
    struct lw_fixed_views views;
    struct lw_error err = {0};
    lw_support_ok(lw_scene_open(&open, &scene, &err), &err);
    lw_support_ok(lw_fixed_views_init(&views, scene, 0, &err), &err);
    assert_true(views.from_table);
    check(scene, &views);
    lw_scene_destroy(scene);
}

/* Which the long test compares with the rule. */
static void cornell_has_a_table(void **state) {
    (void)state;
    struct lw_scene *scene = build("builtin:cornell");
    struct lw_fixed_views views;
    struct lw_error err = {0};
    lw_support_ok(lw_fixed_views_init(&views, scene, 0, &err), &err);
    assert_true(views.from_table);
    lw_scene_destroy(scene);
}

/* Another scene of a table's name gets no views that stand somewhere in it: the rule finds none here. */
static void a_name_is_not_enough(void **state) {
    (void)state;
    struct lw_scene *scene = lw_support_squares(1, 1);
    struct lw_fixed_views views;
    struct lw_error err = {0};
    scene->name = "atrium";
    lw_support_fails(lw_fixed_views_init(&views, scene, 0, &err), LW_BAD_DATA, &err, "of 12 views found");
    lw_scene_destroy(scene);
}

/* By one thread as by all; and the table of builtin:cornell is what the rule gives, to half a centimetre. */
static void the_rule_gives_the_same_views_again(void **state) {
    (void)state;
    struct lw_scene *scene = build("builtin:cornell");
    struct lw_fixed_views views, again, table;
    struct lw_error err = {0};
    lw_support_ok(lw_fixed_views_init(&table, scene, 0, &err), &err);
    assert_true(table.from_table);
    lw_support_ok(lw_fixed_views_pick(&views, scene, 0, &err), &err);
    lw_support_ok(lw_fixed_views_pick(&again, scene, 1, &err), &err);
    for (uint32_t i = 0; i < LW_FIXED_VIEWS_COUNT; i++) {
        const struct lw_fixed_view *a = &views.view[i], *t = &table.view[i];
        assert_memory_equal(&a->position, &again.view[i].position, sizeof again.view[i].position);
        assert_true(lw_vec3_length(lw_vec3_sub(a->position, t->position)) < 0.009f);
        assert_true(lw_vec3_length(lw_vec3_sub(a->target, t->target)) < 0.009f);
    }
    lw_scene_destroy(scene);
}

static void every_second_view_drifts(void **state) {
    (void)state;
    struct lw_fixed_views views = {.drift_m = 0.3f};
    for (uint32_t i = 0; i < LW_FIXED_VIEWS_COUNT; i++)
        views.view[i] = (struct lw_fixed_view){{0, 1, 0}, {0, 1, -4}, ""};
    for (uint32_t i = 0; i < LW_FIXED_VIEWS_COUNT; i++) {
        float farthest = 0, fastest = 0;
        for (int k = 0; k < 400; k++) {
            const struct lw_vec3 at = lw_fixed_views_at(&views, i, 0.01 * k).position,
                                 next = lw_fixed_views_at(&views, i, 0.01 * (k + 1)).position;
            assert_float_equal(at.z, 0, 1e-6f);
            farthest = fmaxf(farthest, fabsf(at.x));
            fastest = fmaxf(fastest, lw_vec3_length(lw_vec3_sub(next, at)) / 0.01f);
        }
        assert_float_equal(farthest, lw_fixed_views_drifts(i) ? 0.3f : 0, 1e-4f);
        assert_true(fastest < 0.5f);
        assert_int_equal(fastest > 0.4f, lw_fixed_views_drifts(i));
    }
}

static void a_scene_with_nothing_to_see_is_refused(void **state) {
    (void)state;
    struct lw_scene *scene = lw_support_squares(1, 1); /* a square in the void: sky alone */
    struct lw_fixed_views views;
    struct lw_error err = {0};
    lw_support_fails(lw_fixed_views_init(&views, scene, 0, &err), LW_BAD_DATA, &err, "of 12 views found");
    lw_scene_destroy(scene);
}

/* With an argument: the long test alone. */
int main(int argc, char **argv) {
    const struct CMUnitTest long_tests[] = {cmocka_unit_test(the_rule_gives_the_same_views_again)};
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(tables_show_something),
        cmocka_unit_test(the_atriums_lamp_walks_by),
        cmocka_unit_test(sponza_has_a_table),
        cmocka_unit_test(cornell_has_a_table),
        cmocka_unit_test(a_name_is_not_enough),
        cmocka_unit_test(every_second_view_drifts),
        cmocka_unit_test(a_scene_with_nothing_to_see_is_refused),
    };
    (void)argv;
    if (argc > 1) return cmocka_run_group_tests(long_tests, NULL, NULL);
    return cmocka_run_group_tests(tests, NULL, NULL);
}
