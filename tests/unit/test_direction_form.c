/* The form of light with a direction: closed forms, bounds, input from strangers. */
#include "common/base/random.h"
#include "common/light/direction_form.h"
#include "tests/support/support.h"

#include <string.h>

static const struct lw_vec3 up = {0, 1, 0};

static struct lw_vec3 unit_of(uint32_t seed) {
    float u[2];
    lw_random_sobol2(seed, 9, u);
    const float z = 1 - 2 * u[0], radius = sqrtf(fmaxf(1 - z * z, 0)), angle = 2 * LW_PI * u[1];
    return lw_vec3(radius * cosf(angle), radius * sinf(angle), z);
}

static void test_even_light(void **state) {
    (void)state;
    const struct lw_direction_source source = lw_direction_source_of(lw_vec3(0, LW_DIRECTION_EVEN, 0), up);
    assert_true(source.share < 1e-3f);
    for (int deg = 0; deg <= 90; deg += 10) {
        const float a = (float)deg * LW_PI / 180;
        const float factor = lw_direction_factor(&source, up, lw_vec3(sinf(a), cosf(a), 0));
        assert_true(fabsf(factor - 0.5f * (1 + cosf(a))) < 1e-3f); /* the lune of two hemispheres */
    }
}

static void test_one_source(void **state) {
    (void)state;
    for (uint32_t i = 0; i < 400; i++) {
        struct lw_vec3 d = unit_of(i), m = unit_of(i + 5000);
        if (d.y < 0.3f) continue;
        const struct lw_direction_source source = lw_direction_source_of(d, up);
        assert_true(fabsf(source.share - 1) < 1e-3f && lw_vec3_dot(source.direction, d) > 0.9999f);
        const float wanted = fminf(fmaxf(lw_vec3_dot(d, m), 0) / d.y, LW_DIRECTION_FACTOR_MAX);
        assert_true(fabsf(lw_direction_factor(&source, up, m) - wanted) < 4e-3f);
    }
}

/* An even part and a source: share and direction come back. */
static void test_parts_come_back(void **state) {
    (void)state;
    for (uint32_t i = 0; i < 400; i++) {
        struct lw_vec3 d = unit_of(i);
        const float share = 0.05f + 0.9f * (float)(i % 16) / 16;
        if (d.y < 0) d.y = -d.y;
        const struct lw_vec3 r = lw_vec3_mad(lw_vec3_scale(up, (1 - share) * LW_DIRECTION_EVEN), d, share);
        const struct lw_direction_source source = lw_direction_source_of(r, up);
        assert_true(fabsf(source.share - share) < 2e-3f);
        assert_true(lw_vec3_dot(source.direction, d) > 0.999f);
    }
}

static void test_plain_normal_is_exact(void **state) {
    (void)state;
    for (uint32_t i = 0; i < 2000; i++) {
        const struct lw_vec3 n = unit_of(i),
                             r = lw_vec3_scale(unit_of(3 * i + 1), 0.001f * (float)(i % 1200));
        const struct lw_direction_source source = lw_direction_source_of(r, n);
        assert_true(lw_direction_factor(&source, n, n) == 1);
    }
}

/* Any bits. */
static void test_bounds(void **state) {
    (void)state;
    for (uint32_t i = 0; i < 200000; i++) {
        const uint32_t bits[3] = {lw_random_hash2(i, 1), lw_random_hash2(i, 2), lw_random_hash2(i, 3)};
        float r[3];
        memcpy(r, bits, sizeof r);
        if (i % 3)
            for (int k = 0; k < 3; k++) r[k] = (float)(bits[k] % 4001) / 1000 - 2;
        const struct lw_vec3 n = unit_of(i), m = unit_of(i + 77);
        const struct lw_direction_source source = lw_direction_source_of(lw_vec3(r[0], r[1], r[2]), n);
        const float factor = lw_direction_factor(&source, n, m);
        assert_true(factor >= 0 && factor <= LW_DIRECTION_FACTOR_MAX);
        assert_true(source.share >= 0 && source.share <= 1);
        assert_true(fabsf(lw_vec3_length(source.direction) - 1) < 1e-3f);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_even_light),      cmocka_unit_test(test_one_source),
        cmocka_unit_test(test_parts_come_back), cmocka_unit_test(test_plain_normal_is_exact),
        cmocka_unit_test(test_bounds),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
