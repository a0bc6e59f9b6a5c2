#include "tests/support/support.h"

#include "common/lightmap/lightmap.h"
#include "server/bake/map.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* A solver whose light is what the test says: E = (x, y, 1) * gain in texels of the atlas, on a disc of the
 * atlas. */
struct fake {
    struct lw_solver base;
    const struct lw_atlas_map *map;
    uint32_t radius;
    float gain;
    bool everywhere; /* no disc */
    float light[3][LW_TILE_TEXELS_MAX];
    struct lw_packed_albedo albedo[LW_TILE_TEXELS_MAX];
    uint8_t covered[LW_TILE_TEXELS_MAX];
};

static bool fake_covers(const struct fake *fake, uint32_t x, uint32_t y) {
    if (fake->everywhere) return true;
    const double dx = (double)x - fake->radius, dy = (double)y - fake->radius;
    return dx * dx + dy * dy < (double)fake->radius * fake->radius;
}

static void fake_read_tile(const struct lw_solver *solver, lw_tile_id id, struct lw_solver_tile *out) {
    struct fake *fake = (struct fake *)(uintptr_t)solver;
    const struct lw_tile_place *place = &fake->map->place[id.v];
    for (uint32_t i = 0; i < place->width * place->height; i++) {
        const uint32_t x = place->x * LW_TILE_SIDE + i % place->width,
                       y = place->y * LW_TILE_SIDE + i / place->width;
        fake->covered[i] = fake_covers(fake, x, y);
        const float e[3] = {(float)x, (float)y, 1};
        for (int c = 0; c < 3; c++) {
            fake->light[c][i] = fake->covered[i] ? e[c] * fake->gain : 0;
        }
        fake->albedo[i] = lw_packed_albedo(fake->covered[i] ? lw_vec3(0.2f, 0.4f, 0.6f) : lw_vec3(0, 0, 0));
    }
    *out = (struct lw_solver_tile){.covered = fake->covered,
                                   .width = place->width,
                                   .height = place->height,
                                   .error = place->x ? 0.3f : 0.1f,
                                   .sample_count = 7 + place->x};
    for (int c = 0; c < 3; c++) {
        out->shown[LW_TILE_CHANNEL_FULL][c] = fake->light[c];
    }
    out->albedo = fake->albedo;
}

static const struct lw_solver_ops fake_ops = {.name = "fake", .read_tile = fake_read_tile};

static struct fake fake;
static struct lw_scene *scene;
static struct lw_atlas_map atlas_map;

static int set_up(void **state) {
    (void)state;
    scene = lw_support_squares(1, 1);
    struct lw_error err = {0};
    lw_support_ok(lw_lightmap_build(scene, &(struct lw_lightmap_desc){.texels_per_metre = 120}, NULL, &err),
                  &err);
    lw_support_ok(lw_atlas_map_init(&atlas_map, scene), NULL);
    fake = (struct fake){.base.ops = &fake_ops, .map = &atlas_map, .radius = 50, .gain = 1};
    assert_true(scene->mesh[0].atlas_width > 110); /* several tiles */
    return 0;
}

static int tear_down(void **state) {
    (void)state;
    lw_atlas_map_finish(&atlas_map);
    lw_scene_destroy(scene);
    return 0;
}

static void build(struct lw_map *map, enum lw_convention_kind kind) {
    struct lw_error err = {0};
    lw_support_ok(lw_map_build(map, scene, &atlas_map, &fake.base, LW_TILE_CHANNEL_FULL, 0,
                               lw_convention_get(kind), &err),
                  &err);
}

static void texels_are_where_they_belong(void **state) {
    (void)state;
    struct lw_map map;
    build(&map, LW_CONVENTION_IRRADIANCE);
    assert_int_equal(map.width, scene->mesh[0].atlas_width);
    uint32_t covered = 0;
    for (uint32_t y = 0; y < map.height; y++)
        for (uint32_t x = 0; x < map.width; x++) {
            const float *p = map.rgba + ((size_t)y * map.width + x) * 4;
            const bool surface = fake_covers(&fake, x, y);
            covered += surface;
            assert_true(p[3] == (surface ? 1 : 0));
            if (surface) assert_true(p[0] == (float)x && p[1] == (float)y);
            assert_true(fabsf(p[2] - 1) < 1e-6f); /* beyond the surface it is continued, to the last corner */
        }
    assert_int_equal(map.covered, covered);
    assert_int_equal(map.samples, 7);
    assert_true(map.error > 0.1f && map.error < 0.3f && map.error_worst == 0.3f);
    assert_true(map.largest == 99); /* x of the disc's right end */
    assert_true(map.fits_half);
    lw_map_finish(&map);
}

static void conventions_are_as_documented(void **state) {
    (void)state;
    static const struct {
        double factor;
        bool albedo;
    } want[LW_CONVENTION_COUNT] = {[LW_CONVENTION_IRRADIANCE] = {1, false},
                                   [LW_CONVENTION_RADIOSITY] = {1, true},
                                   [LW_CONVENTION_THREE] = {1, false},
                                   [LW_CONVENTION_GODOT] = {1 / M_PI, false},
                                   [LW_CONVENTION_BABYLON] = {1 / M_PI, true}};
    for (int kind = 0; kind < LW_CONVENTION_COUNT; kind++) {
        struct lw_map map;
        build(&map, (enum lw_convention_kind)kind);
        const float *p = map.rgba + ((size_t)50 * map.width + 60) * 4;
        const double e[3] = {60, 50, 1};
        for (int c = 0; c < 3; c++)
            assert_true(fabs((double)p[c] - e[c] * want[kind].factor *
                                                (want[kind].albedo ? 0.2 * (c + 1) : 1)) < 1e-5 * e[c]);
        lw_map_finish(&map);
    }
    const char *choices = LW_CONVENTION_CHOICES; /* the option's words are the table's */
    for (int kind = 0; kind < LW_CONVENTION_COUNT; kind++) {
        const char *name = lw_convention_get((enum lw_convention_kind)kind)->name;
        assert_memory_equal(choices, name, strlen(name));
        choices += strlen(name) + 1;
    }
}

static void half_is_left_where_it_loses_light(void **state) {
    (void)state;
    struct lw_map map;
    fake.gain = 700; /* 99 * 700 > 65504 */
    build(&map, LW_CONVENTION_IRRADIANCE);
    assert_false(map.fits_half);
    lw_map_finish(&map);
    fake.gain = 1e-8f; /* under half's smallest step */
    build(&map, LW_CONVENTION_IRRADIANCE);
    assert_false(map.fits_half);
    lw_map_finish(&map);
    fake.gain = 0;
    build(&map, LW_CONVENTION_IRRADIANCE);
    assert_true(map.fits_half);
    lw_map_finish(&map);
    const float exact[] = {1, 65504, 0x1p-24f, 0.5f}, off[] = {1 + 0x1p-11f}, large[] = {1, 65505};
    assert_true(lw_map_half_loss(exact, 4) == 0);
    assert_true(fabs(lw_map_half_loss(off, 1) - 0x1p-11) < 1e-6);
    assert_true(isinf(lw_map_half_loss(large, 2)));
}

static void light_that_is_not_finite_is_never_written(void **state) {
    (void)state;
    struct lw_map map;
    struct lw_error err = {0};
    fake.gain = NAN;
    lw_support_fails(lw_map_build(&map, scene, &atlas_map, &fake.base, LW_TILE_CHANNEL_FULL, 0,
                                  lw_convention_get(LW_CONVENTION_THREE), &err),
                     LW_INTERNAL, &err, "not finite");
}

static void eight_bits_keep_the_light_in_the_mean(void **state) {
    (void)state;
    struct lw_map map;
    uint8_t *rgb;
    float scale;
    build(&map, LW_CONVENTION_IRRADIANCE);
    lw_support_ok(lw_map_to_8_bit(&map, &rgb, &scale), NULL);
    double want = 0, got = 0, steps = 0;
    unsigned clipped = 0;
    for (size_t i = 0; i < (size_t)map.width * map.height; i++) {
        if (map.rgba[i * 4 + 3] != 1) continue;
        for (size_t c = 0; c < 2; c++) {
            clipped += map.rgba[i * 4 + c] > scale;
            want += (double)fminf(map.rgba[i * 4 + c], scale);
            got += (double)rgb[i * 3 + c] / 255 * (double)scale;
        }
        assert_true(abs((int)rgb[i * 3 + 2] - (int)(255 / (double)scale)) <= 1);
        steps += (double)rgb[i * 3 + 2];
    }
    assert_true(scale <= map.largest && scale > 0.9f * map.largest);
    assert_true(clipped <= map.covered / 1000 * 2 + 2);
    assert_true(fabs(got / want - 1) < 0.002);
    /* blue lies between two steps everywhere: dithering must give its mean. 3 sigma of a coin of variance
     * under 1/4. */
    assert_true(fabs(steps / map.covered - 255 / (double)scale) < 3 * 0.5 / sqrt(map.covered));
    free(rgb);
    lw_map_finish(&map);
}

/* A square that faces up, and its back, turned so that it faces x. */
static void normals_are_the_worlds_and_their_backs(void **state) {
    (void)state;
    struct lw_error err = {0};
    struct lw_pose pose;
    struct lw_map map;
    lw_atlas_map_finish(&atlas_map);
    lw_scene_destroy(scene);
    scene = lw_support_squares(1, 1);
    for (uint32_t m = 0; m < scene->material_count; m++) scene->material[m].double_sided = true;
    lw_support_ok(lw_lightmap_build(scene, &(struct lw_lightmap_desc){.texels_per_metre = 60}, NULL, &err),
                  &err);
    lw_support_ok(lw_atlas_map_init(&atlas_map, scene), NULL);
    lw_support_ok(lw_pose_init(&pose, scene), NULL);
    pose.object_to_world[0] =
        (struct lw_affine){.m = {{0, 2, 0, 5}, {-3, 0, 0, 6}, {0, 0, 1, 7}}}; /* stretched, too */
    fake.everywhere = true;
    lw_support_ok(lw_map_build_normals(&map, scene, &atlas_map, &pose, &fake.base, 0, &err), &err);
    const uint32_t back = scene->mesh[0].back_offset, x = map.width / 2, y = back / 2;
    assert_true(back > 0);
    for (int side = 0; side < 2; side++) {
        const float *n = map.rgba + ((size_t)(y + (side ? back : 0)) * map.width + x) * 4;
        assert_true(fabsf(n[0] - (side ? -1.0f : 1.0f)) < 1e-5f && fabsf(n[1]) + fabsf(n[2]) < 1e-5f);
    }
    lw_map_finish(&map);
    lw_pose_finish(&pose);
}

int main(void) {
#define T(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)
    const struct CMUnitTest tests[] = {
        T(texels_are_where_they_belong),          T(conventions_are_as_documented),
        T(half_is_left_where_it_loses_light),     T(light_that_is_not_finite_is_never_written),
        T(eight_bits_keep_the_light_in_the_mean), T(normals_are_the_worlds_and_their_backs),
    };
#undef T
    return cmocka_run_group_tests(tests, NULL, NULL);
}
