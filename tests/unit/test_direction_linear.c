/* Light with a direction as a line, as Godot's and Unity's shaders read it: closed forms, bounds. */
#include "common/base/random.h"
#include "common/light/direction_linear.h"
#include "server/bake/direction_maps.h"
#include "tests/support/support.h"
#include "tests/support/unit_vector.h"

#include <stdlib.h>
#include <string.h>

static const struct lw_vec3 up = {0, 1, 0};

/* Light of an even part and one source. */
static struct lw_direction_source source_of(uint32_t seed, struct lw_vec3 n) {
    struct lw_vec3 d = lw_support_unit_vector(seed);
    if (lw_vec3_dot(d, n) < 0) d = lw_vec3_scale(d, -1);
    const float share = (float)(seed % 16) / 15;
    return lw_direction_source_of(lw_vec3_mad(lw_vec3_scale(n, (1 - share) * LW_DIRECTION_EVEN), d, share),
                                  n);
}

static void test_even_light_is_exact(void **state) {
    (void)state;
    const struct lw_direction_source source =
        lw_direction_source_of(lw_vec3_scale(up, LW_DIRECTION_EVEN), up);
    for (float ratio = 1; ratio <= 4; ratio += 3)
        for (uint32_t i = 0; i < 100; i++) {
            const struct lw_direction_linear line = lw_direction_linear_of(&source, up, ratio);
            const struct lw_vec3 m = lw_support_unit_vector(i);
            assert_true(fabsf(lw_direction_linear_factor(&line, m) - 0.5f * (1 + m.y)) < 1e-3f);
        }
}

static void test_a_lamp(void **state) {
    (void)state;
    for (uint32_t i = 0; i < 400; i++) {
        const struct lw_vec3 d = lw_support_unit_vector(i), m = lw_support_unit_vector(i + 5000);
        if (d.y < 0.3f) continue;
        const struct lw_direction_source source = lw_direction_source_of(d, up);
        for (float ratio = 1; ratio <= 4; ratio += 3) {
            const struct lw_direction_linear line = lw_direction_linear_of(&source, up, ratio);
            const float wanted = (1 + ratio * lw_vec3_dot(d, m)) / (1 + ratio * d.y);
            assert_true(fabsf(lw_direction_linear_factor(&line, m) - wanted) < 4e-3f);
        }
    }
}

/* Where nothing is cut, it is the form's formula, not its first order alone. */
static void test_it_is_the_form_in_front_of_the_source(void **state) {
    (void)state;
    uint32_t compared = 0;
    for (uint32_t i = 0; i < 4000; i++) {
        const struct lw_vec3 n = lw_support_unit_vector(i), m = lw_support_unit_vector(i + 999);
        const struct lw_direction_source source = source_of(i + 31, n);
        const struct lw_direction_linear line = lw_direction_linear_of(&source, n, 1000);
        const float wanted = lw_direction_factor(&source, n, m);
        if (lw_vec3_length(line.slope) > 900 * line.even || lw_vec3_dot(source.direction, m) < 0 ||
            lw_vec3_dot(source.direction, n) < 0.06f || wanted <= 0 || wanted >= LW_DIRECTION_FACTOR_MAX)
            continue;
        assert_true(fabsf(lw_direction_linear_factor(&line, m) - wanted) < 0.01f);
        compared++;
    }
    assert_true(compared > 500);
}

/* Any bits: E at the plain normal stays, and slopes fit their packing. */
static void test_bounds(void **state) {
    (void)state;
    for (uint32_t i = 0; i < 100000; i++) {
        const uint32_t bits[3] = {lw_random_hash2(i, 1), lw_random_hash2(i, 2), lw_random_hash2(i, 3)};
        float r[3];
        memcpy(r, bits, sizeof r);
        if (i % 3)
            for (int k = 0; k < 3; k++) r[k] = (float)(bits[k] % 4001) / 1000 - 2;
        const struct lw_vec3 n = lw_support_unit_vector(i), m = lw_support_unit_vector(i + 77);
        const struct lw_direction_source source = lw_direction_source_of(lw_vec3(r[0], r[1], r[2]), n);
        for (float ratio = 1; ratio <= 4; ratio += 3) {
            const struct lw_direction_linear line = lw_direction_linear_of(&source, n, ratio);
            assert_true(line.even > 0 && lw_vec3_length(line.slope) <= ratio * line.even * 1.0001f);
            assert_true(fabsf(lw_direction_linear_factor(&line, n) - 1) < 2e-5f);
            if (ratio == 1) assert_true(lw_direction_linear_factor(&line, m) > -1e-4f);
        }
    }
}

/* ---- maps, read as the engines' shaders do ---- */

#define SIDE 8u
#define AREA (SIDE * SIDE)

struct texels {
    struct lw_map map, normals, irradiance;
};

static struct lw_map map_of(void) {
    float *rgba = calloc(AREA, 4 * sizeof *rgba);
    assert_non_null(rgba);
    return (struct lw_map){.width = SIDE, .height = SIDE, .rgba = rgba, .fits_half = true};
}

static void put(struct lw_map *map, size_t i, struct lw_vec3 v) {
    map->rgba[4 * i] = v.x, map->rgba[4 * i + 1] = v.y, map->rgba[4 * i + 2] = v.z, map->rgba[4 * i + 3] = 1;
}

static struct lw_vec3 get(const struct lw_map *map, size_t i) {
    return lw_vec3(map->rgba[4 * i], map->rgba[4 * i + 1], map->rgba[4 * i + 2]);
}

/* Texel 0 has no normal, and no light. */
static struct texels texels_of(void) {
    struct texels t = {map_of(), map_of(), map_of()};
    for (uint32_t i = 1; i < AREA; i++) {
        const struct lw_vec3 n = lw_support_unit_vector(i);
        const struct lw_direction_source source = source_of(i, n);
        put(&t.normals, i, lw_vec3_scale(n, i % 2 ? 1 : 0.5f)); /* means are shorter */
        put(&t.map, i,
            lw_vec3_mad(lw_vec3_scale(n, (1 - source.share) * LW_DIRECTION_EVEN), source.direction,
                        source.share));
        put(&t.irradiance, i, lw_vec3((float)i, 2, 0.5f));
    }
    return t;
}

static void texels_finish(struct texels *t) {
    lw_map_finish(&t->map);
    lw_map_finish(&t->normals);
    lw_map_finish(&t->irradiance);
}

/* Godot's ambient light of normal m. */
static struct lw_vec3 read_sh(const struct lw_map *map, size_t i, struct lw_vec3 m) {
    const struct lw_vec3 l0 = get(map, i);
    const float along[3] = {m.y, m.z, m.x};
    struct lw_vec3 sum = l0;
    for (size_t l = 0; l < 3; l++) {
        const struct lw_vec3 l1 =
            lw_vec3_scale(lw_vec3_sub(get(map, (l + 1) * AREA + i), lw_vec3(0.5f, 0.5f, 0.5f)), 2);
        sum = lw_vec3_add(sum, lw_vec3_scale(lw_vec3_mul(l1, l0), 4 * along[l]));
    }
    return sum;
}

/* Unity's share of the light map. */
static float read_dominant(const struct lw_map *map, size_t i, struct lw_vec3 m) {
    const struct lw_vec3 halved = lw_vec3_sub(get(map, i), lw_vec3(0.5f, 0.5f, 0.5f));
    return (lw_vec3_dot(m, halved) + 0.5f) / fmaxf(1e-4f, map->rgba[4 * i + 3]);
}

static struct lw_direction_linear line_of(const struct texels *t, size_t i, const struct lw_vec3 r,
                                          float ratio) {
    const struct lw_vec3 n = lw_vec3_normalize(get(&t->normals, i));
    const struct lw_direction_source source = lw_direction_source_of(r, n);
    return lw_direction_linear_of(&source, n, ratio);
}

static void test_godot_reads_sh(void **state) {
    (void)state;
    struct texels t = texels_of(), plain = texels_of();
    lw_support_ok(lw_direction_maps_convert(&t.map, LW_DIRECTION_MAPS_SH, &t.normals, &t.irradiance, NULL),
                  NULL);
    assert_int_equal(t.map.height, 4 * SIDE);
    for (size_t i = 0; i < 4 * AREA; i++)
        for (size_t c = 0; i >= AREA && c < 3; c++)
            assert_true(t.map.rgba[4 * i + c] >= 0 && t.map.rgba[4 * i + c] <= 1);
    for (uint32_t i = 1; i < AREA; i++) {
        const struct lw_vec3 n = lw_vec3_normalize(get(&t.normals, i)), m = lw_support_unit_vector(i + 500);
        const struct lw_vec3 e = get(&t.irradiance, i), at_n = read_sh(&t.map, i, n),
                             at_m = read_sh(&t.map, i, m);
        const struct lw_direction_linear line = line_of(&t, i, get(&plain.map, i), 4);
        assert_true(fabsf(at_n.x * LW_PI / e.x - 1) < 1e-5f && fabsf(at_n.z * LW_PI / e.z - 1) < 1e-5f);
        assert_true(fabsf(at_m.y * LW_PI / e.y - lw_direction_linear_factor(&line, m)) < 1e-4f);
    }
    assert_true(t.map.rgba[0] == 0 && t.map.rgba[4 * AREA] == 0.5f);
    texels_finish(&t);
    texels_finish(&plain);
}

static void test_unity_reads_dominant(void **state) {
    (void)state;
    struct texels t = texels_of(), plain = texels_of();
    lw_support_ok(
        lw_direction_maps_convert(&t.map, LW_DIRECTION_MAPS_DOMINANT, &t.normals, &t.irradiance, NULL), NULL);
    assert_int_equal(t.map.height, SIDE);
    for (uint32_t i = 0; i < AREA; i++)
        for (size_t c = 0; c < 4; c++)
            assert_true(t.map.rgba[4 * i + c] >= 0 && t.map.rgba[4 * i + c] <= 1.00001f);
    for (uint32_t i = 1; i < AREA; i++) {
        const struct lw_vec3 n = lw_vec3_normalize(get(&t.normals, i)), m = lw_support_unit_vector(i + 500);
        const struct lw_direction_linear line = line_of(&t, i, get(&plain.map, i), 1);
        assert_true(fabsf(read_dominant(&t.map, i, n) - 1) < 1e-5f);
        assert_true(fabsf(read_dominant(&t.map, i, m) - lw_direction_linear_factor(&line, m)) < 1e-4f);
    }
    texels_finish(&t);
    texels_finish(&plain);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_even_light_is_exact),
        cmocka_unit_test(test_a_lamp),
        cmocka_unit_test(test_it_is_the_form_in_front_of_the_source),
        cmocka_unit_test(test_bounds),
        cmocka_unit_test(test_godot_reads_sh),
        cmocka_unit_test(test_unity_reads_dominant),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
