/* test_lightmap_density.c: how many texels a scene and each of its objects get. */
#include "tests/support/lightmap_case.h"

#include "common/lightmap/lightmap_things.h"

#include <string.h>

static void the_largest_instance_decides(void **state) {
    struct lightmap_case_shape *s = lightmap_case_fresh(state);
    lightmap_case_add_quad(s, lw_vec3(0, 0, 0), lw_vec3(1, 0, 0), lw_vec3(0, 1, 0));
    struct lw_scene *scene = lightmap_case_scene_of(s, (float[]){1, 3, 0.5f}, 3);
    struct lw_lightmap_report r = lightmap_case_build(scene, 16, 0);
    assert_int_equal(r.texels_covered, 48 * 48);
    assert_true(fabsf(r.texels_per_metre - 16) < 1e-3f);
    lw_scene_destroy(scene);
}

static void too_much_is_capped(void **state) {
    struct lightmap_case_shape *s = lightmap_case_fresh(state);
    lightmap_case_add_cube(s, 1);
    struct lw_scene *scene = lightmap_case_scene_of(s, NULL, 1);
    struct lw_lightmap_report r = lightmap_case_build(scene, 1000, 256);
    assert_true(r.capped);
    assert_true(r.atlas_width <= 256 && r.atlas_height <= 256);
    assert_true(r.texels_per_metre < 1000 && r.texels_per_metre > 60);
    lightmap_case_check_layout(scene->mesh, &r, 1.4f);
    lw_scene_destroy(scene);
}

static void what_cannot_fit_is_named(void **state) {
    struct lightmap_case_shape *s = lightmap_case_fresh(state);
    for (int i = 0; i < 1000; i++)
        lightmap_case_add_quad(s, lw_vec3((float)i * 3, 0, 0), lw_vec3(1, 0, 0), lw_vec3(0, 1, 0));
    struct lw_scene *scene = lightmap_case_scene_of(s, NULL, 1);
    struct lw_error err = {0};
    struct lw_lightmap_desc desc = {.texels_per_metre = 4, .atlas_side_max = 16, .threads = 1};
    assert_int_equal(lw_lightmap_build(scene, &desc, NULL, &err), LW_BAD_DATA);
    assert_non_null(strstr(err.text, "shape"));
    assert_non_null(strstr(err.text, "1000 charts"));
    assert_null(scene->mesh->lightmap_uv);
    lw_scene_destroy(scene);
}

static struct lw_lightmap_report build_default(struct lw_scene *scene, uint32_t texels_max) {
    struct lw_lightmap_report r;
    struct lw_error err = {0};
    const struct lw_lightmap_desc desc = {.texels_max = texels_max, .threads = 1};
    lw_support_ok(lw_lightmap_build(scene, &desc, &r, &err), &err);
    return r;
}

static struct lw_scene *cube_of_side(void **state, float side_m) {
    struct lightmap_case_shape *s = lightmap_case_fresh(state);
    lightmap_case_add_cube(s, 1);
    return lightmap_case_scene_of(s, &side_m, 1);
}

static void the_default_is_a_density(void **state) {
    const float side_m[] = {30, 60};
    for (int i = 0; i < 2; i++) {
        struct lw_scene *scene = cube_of_side(state, side_m[i]);
        struct lw_lightmap_report r = build_default(scene, 0);
        const double texels = 6 * pow((double)side_m[i] * LW_LIGHTMAP_DENSITY_DEFAULT, 2);
        assert_in_range(r.texels_covered, (uint32_t)(texels * 0.97), (uint32_t)(texels * 1.05));
        assert_float_equal(r.texels_per_metre, LW_LIGHTMAP_DENSITY_DEFAULT, 1e-4);
        assert_float_equal(r.density_wanted, LW_LIGHTMAP_DENSITY_DEFAULT, 1e-6);
        assert_int_equal(r.texels_max, LW_LIGHTMAP_TEXELS_MAX);
        assert_false(r.bounded);
        lw_scene_destroy(scene);
    }
}

static void a_small_scene_has_texels_enough(void **state) {
    const float side_m[] = {1e-3f, 1, 10};
    for (int i = 0; i < 3; i++) {
        struct lw_scene *scene = cube_of_side(state, side_m[i]);
        struct lw_lightmap_report r = build_default(scene, 0);
        assert_in_range(r.texels_covered, (uint32_t)(LW_LIGHTMAP_TEXELS_MIN * 0.9),
                        (uint32_t)(LW_LIGHTMAP_TEXELS_MIN * 1.1));
        assert_false(r.bounded);
        lw_scene_destroy(scene);
    }
    struct lw_scene *scene = cube_of_side(state, 1); /* the bound is stronger */
    struct lw_lightmap_report r = build_default(scene, 10000);
    assert_in_range(r.texels_covered, 9000, 11000);
    lw_scene_destroy(scene);
}

/* Cubes of 1 m have what a thing of 1 m wants, while that is affordable. */
static void small_things_have_finer_texels(void **state) {
    const uint32_t cubes[] = {50, 500};
    for (int i = 0; i < 2; i++) {
        struct lightmap_case_shape *s = lightmap_case_fresh(state);
        lightmap_case_add_cube(s, 1);
        struct lw_scene *scene = lightmap_case_scene_of(s, NULL, cubes[i]);
        struct lw_lightmap_report r = build_default(scene, 0);
        const double wanted = fmin(LW_LIGHTMAP_ACROSS, sqrt(LW_LIGHTMAP_TEXELS_FINE / (6.0 * cubes[i])));
        assert_float_equal(r.density_wanted, wanted, 1e-4);
        lw_scene_destroy(scene);
        scene = lightmap_case_scene_of(s, NULL, cubes[i]);
        r = build_default(scene, 150 * cubes[i]); /* the bound is stronger */
        assert_in_range(r.texels_covered, 100, 160);
        lw_scene_destroy(scene);
    }
}

/* An open cylinder of radius 0.5 and height 2: its two rims, and a full turn along its height, in right

 * angles. */
static void round_things_have_one_size(void **state) {
    for (unsigned columns = 12; columns <= 96; columns *= 2) {
        struct lightmap_case_shape *s = lightmap_case_fresh(state);
        lightmap_case_add_grid(s, lightmap_case_cylinder, columns, 4);
        struct lw_scene *scene = lightmap_case_scene_of(s, NULL, 1);
        double length;
        lw_support_ok(lw_lightmap_things_edges(scene->mesh, &length), NULL);
        const double rims = 2 * columns * sin((double)LW_PI / columns), turn = 4 * 2;
        assert_true(fabs(length - (rims + turn)) < 1e-3);
        lw_scene_destroy(scene);
    }
}

static void texels_bound_the_density(void **state) {
    struct lw_scene *scene = cube_of_side(state, 1e5f);
    struct lw_lightmap_report r = build_default(scene, 0);
    assert_in_range(r.texels_covered, (uint32_t)(LW_LIGHTMAP_TEXELS_MAX * 0.95),
                    (uint32_t)(LW_LIGHTMAP_TEXELS_MAX * 1.05));
    assert_true(r.bounded);
    lw_scene_destroy(scene);

    scene = cube_of_side(state, 60);
    r = build_default(scene, 50000);
    assert_in_range(r.texels_covered, 47500, 52500);
    assert_true(r.bounded);
    assert_int_equal(r.texels_max, 50000);
    lw_scene_destroy(scene);

    /* one that is asked for has no bound but its own */
    for (uint32_t most = 0; most <= 50000; most += 50000) {
        struct lw_error err = {0};
        scene = cube_of_side(state, 60);
        const struct lw_lightmap_desc desc = {.texels_per_metre = 12, .texels_max = most, .threads = 1};
        lw_support_ok(lw_lightmap_build(scene, &desc, &r, &err), &err);
        assert_int_equal(r.bounded, most > 0);
        assert_float_equal(r.density_wanted, 12, 1e-6);
        if (most)
            assert_in_range(r.texels_covered, 47500, 52500);
        else
            assert_float_equal(r.texels_per_metre, 12, 1e-4);
        lw_scene_destroy(scene);
    }
}

/* A grid of 3,200 triangles, 3,000 times, on cylinders large enough to be bounded: what suffices for fewer
 * would be under half a texel for each. */
static void many_triangles_get_texels(void **state) {
    struct lightmap_case_shape *s = lightmap_case_fresh(state);
    lightmap_case_add_grid(s, lightmap_case_cylinder, 40, 40);
    struct lw_scene *scene = lightmap_case_scene_of(s, NULL, 3000);
    for (uint32_t n = 0; n < scene->node_count; n++)
        for (int k = 0; k < 3; k++) scene->node[n].scale[k] = 100;
    struct lw_lightmap_report r = build_default(scene, 0);
    assert_true(r.bounded);
    assert_in_range(r.texels_covered, (uint32_t)(1600 * 0.95), (uint32_t)(1600 * 1.05));
    lw_scene_destroy(scene);
}

/* A square plate on a ground of this side; mesh 0 is the ground. */
static struct lw_scene *plate_on_a_ground(void **state, float ground_m, float plate_m) {
    struct lightmap_case_shape *s = lightmap_case_fresh(state);
    lightmap_case_add_quad(s, lw_vec3(0, 0, 0), lw_vec3(ground_m, 0, 0), lw_vec3(0, ground_m, 0));
    struct lw_scene *scene = lightmap_case_scene_of(s, NULL, 2);
    struct lw_mesh *mesh = lw_scene_alloc(scene, 2, sizeof *mesh);
    struct lw_vec3 *small = lw_scene_alloc(scene, s->vertex_count, sizeof *small);
    for (uint32_t v = 0; v < s->vertex_count; v++)
        small[v] = lw_vec3_scale(s->position[v], plate_m / ground_m);
    mesh[0] = mesh[1] = scene->mesh[0];
    mesh[1].position = small;
    scene->mesh = mesh;
    scene->mesh_count = 2;
    scene->object[1].mesh = 1;
    return scene;
}

/* A ground of 3 km and a plate of 10 m: even densities would leave the plate 11 of the 1,000,000 texels. */
static void a_ground_does_not_starve_the_rest(void **state) {
    struct lw_scene *scene = plate_on_a_ground(state, 3000, 10);
    struct lw_lightmap_report r[2];
    struct lw_error err = {0};
    lw_support_ok(lw_lightmap_build(scene, &(struct lw_lightmap_desc){0}, r, &err), &err);
    assert_in_range(r[0].texels_covered + r[1].texels_covered, (uint32_t)(LW_LIGHTMAP_TEXELS_MAX * 0.95),
                    (uint32_t)(LW_LIGHTMAP_TEXELS_MAX * 1.05));
    /* The plate has the density that is wanted; the ground has what that leaves. */
    assert_float_equal(r[1].texels_per_metre, LW_LIGHTMAP_DENSITY_DEFAULT, 0.2);
    assert_false(r[1].bounded);
    assert_true(r[0].bounded);
    assert_true(r[0].texels_per_metre > 0.28f && r[0].texels_per_metre < 0.36f);
    lw_scene_destroy(scene);
}

static void density_of(struct lw_scene *scene, const char *text, const char *error,
                       struct lw_lightmap_report *out_report) {
    struct lw_error err = {0};
    const struct lw_lightmap_desc desc = {
        .texels_per_metre = 8, .threads = 1, .density_of = text, .texels_max = error ? 0 : 3000};
    if (error)
        lw_support_fails(lw_lightmap_build(scene, &desc, out_report, &err), LW_USAGE, &err, error);
    else
        lw_support_ok(lw_lightmap_build(scene, &desc, out_report, &err), &err);
}

/* Two cubes of 1 m, whose objects have names; a name may hold an equals sign. */
static void named_objects_have_their_own_density(void **state) {
    struct lightmap_case_shape *s = lightmap_case_fresh(state);
    struct lw_lightmap_report r;
    lightmap_case_add_cube(s, 1);
    struct lw_scene *scene = lightmap_case_scene_of(s, NULL, 1);
    scene->object[0].name = lw_scene_string(scene, "a=b");
    density_of(scene, "a=b", "\"a=b\" wants a factor from 1/64 to 8", &r);
    density_of(scene, "a", "\"a\" is no NAME=FACTOR", &r);
    density_of(scene, "=2", "\"=2\" is no NAME=FACTOR", &r);
    density_of(scene, "", "\"\" is no NAME=FACTOR", &r);
    density_of(scene, "a=b=9", "wants a factor", &r);
    density_of(scene, "a=b=nan", "wants a factor", &r);
    density_of(scene, "a=b=2x", "wants a factor", &r);
    density_of(scene, "a=b=2,c=1", "no object called \"c\"", &r);
    density_of(scene, "a=b=2,", "\"\" is no NAME=FACTOR", &r);
    density_of(scene, "a=b=2", NULL, &r);
    assert_float_equal(r.texels_per_metre, 16, 0.01f);
    assert_int_equal(r.texels_covered, 6 * 16 * 16);
    assert_false(r.bounded);
    lw_scene_destroy(scene);
    scene = lightmap_case_scene_of(s, NULL, 1);
    scene->object[0].name = lw_scene_string(scene, "cube");
    density_of(scene, "cube=8", NULL, &r); /* 6 * 64 * 64 would be past the bound of 3000 */
    assert_true(r.bounded && r.texels_covered < 3600 && r.density_wanted == 64);
    lw_scene_destroy(scene);
}

/* The ground, far larger, counts as a second plate: of its area and its share of the ground's edges. */
static void a_ground_does_not_coarsen_the_rest(void **state) {
    struct lw_scene *scene = plate_on_a_ground(state, 30, 2);
    struct lw_lightmap_report r[2];
    struct lw_error err = {0};
    lw_support_ok(lw_lightmap_build(scene, &(struct lw_lightmap_desc){0}, r, &err), &err);
    const double edges_m = 4 * 2 + 4 * 30 / 225.0, things_m = 2 * (4 + 4) / edges_m;
    for (int i = 0; i < 2; i++)
        assert_float_equal(r[i].density_wanted, (float)(LW_LIGHTMAP_ACROSS / things_m), 1e-4f);
    lw_scene_destroy(scene);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_largest_instance_decides),
        cmocka_unit_test(too_much_is_capped),
        cmocka_unit_test(what_cannot_fit_is_named),
        cmocka_unit_test(the_default_is_a_density),
        cmocka_unit_test(a_small_scene_has_texels_enough),
        cmocka_unit_test(small_things_have_finer_texels),
        cmocka_unit_test(round_things_have_one_size),
        cmocka_unit_test(texels_bound_the_density),
        cmocka_unit_test(many_triangles_get_texels),
        cmocka_unit_test(a_ground_does_not_starve_the_rest),
        cmocka_unit_test(a_ground_does_not_coarsen_the_rest),
        cmocka_unit_test(named_objects_have_their_own_density),
    };
    return cmocka_run_group_tests(tests, lightmap_case_set_up, lightmap_case_tear_down);
}
