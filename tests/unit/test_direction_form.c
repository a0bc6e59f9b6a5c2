/* The form of light with a direction: closed forms, bounds, input from strangers. */
#include "common/base/random.h"
#include "common/light/direction_form.h"
#include "tests/support/support.h"
#include "tests/support/unit_vector.h"
#include "tests/unit/direction_glsl.h"

#include <string.h>

static const struct lw_vec3 up = {0, 1, 0};

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
        struct lw_vec3 d = lw_support_unit_vector(i), m = lw_support_unit_vector(i + 5000);
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
        struct lw_vec3 d = lw_support_unit_vector(i);
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
        const struct lw_vec3 n = lw_support_unit_vector(i),
                             r = lw_vec3_scale(lw_support_unit_vector(3 * i + 1), 0.001f * (float)(i % 1200));
        const struct lw_direction_source source = lw_direction_source_of(r, n);
        assert_true(lw_direction_factor(&source, n, n) == 1);
    }
}

/* Three numbers of any bits, or from -2 to 2. */
static void hostile(uint32_t i, float r[3]) {
    const uint32_t bits[3] = {lw_random_hash2(i, 1), lw_random_hash2(i, 2), lw_random_hash2(i, 3)};
    memcpy(r, bits, sizeof bits);
    for (int k = 0; i % 3 && k < 3; k++) r[k] = (float)(bits[k] % 4001) / 1000 - 2;
}

static void test_bounds(void **state) {
    (void)state;
    for (uint32_t i = 0; i < 200000; i++) {
        float r[3];
        hostile(i, r);
        const struct lw_vec3 n = lw_support_unit_vector(i), m = lw_support_unit_vector(i + 77);
        const struct lw_direction_source source = lw_direction_source_of(lw_vec3(r[0], r[1], r[2]), n);
        const float factor = lw_direction_factor(&source, n, m);
        const float gain = lw_direction_gain(&source, n, m, 1e-3f + 0.999f * (float)(i % 100) / 99);
        assert_true(factor >= 0 && factor <= LW_DIRECTION_FACTOR_MAX);
        assert_true(gain >= 0 && gain <= LW_DIRECTION_GAIN_MAX);
        assert_true(source.share >= 0 && source.share <= 1);
        assert_true(fabsf(lw_vec3_length(source.direction) - 1) < 1e-3f);
    }
}

/* A direction that nobody knows is not an even hemisphere: E stays as it is at every normal. */
static void test_not_known(void **state) {
    (void)state;
    const struct lw_vec3 none[] = {
        {0, 0, 0}, {-0.01f, 0.01f, 0.01f}, {NAN, 0.5f, 0}, {0, INFINITY, 0}, {3e38f, 3e38f, 3e38f}};
    for (uint32_t i = 0; i < 400; i++)
        for (size_t k = 0; k < sizeof none / sizeof *none; k++) {
            const struct lw_vec3 n = lw_support_unit_vector(i), m = lw_support_unit_vector(i + 900);
            const struct lw_direction_source source = lw_direction_source_of(none[k], n);
            assert_true(!source.known && lw_direction_factor(&source, n, m) == 1);
            assert_true(lw_direction_gain(&source, n, m, 0.001f + 0.002f * (float)i) == 1);
        }
    const struct lw_direction_source even = lw_direction_source_of(lw_vec3(0, LW_DIRECTION_EVEN, 0), up);
    assert_true(even.known && fabsf(lw_direction_factor(&even, up, lw_vec3(1, 0, 0)) - 0.5f) < 1e-3f);
}

/* Moments and light of any bits give numbers within -1 to 1; as good as no light gives none. */
static void test_moments(void **state) {
    (void)state;
    const float down[3] = {-1e-38f, 1e-38f, -0.0f};
    for (int exponent = -149; exponent < 128; exponent++) {
        const float light = ldexpf(1, exponent), even[3] = {light, light, light},
                    moment[3] = {0, light / 2, light};
        const struct lw_vec3 r = lw_direction_of(moment, even);
        const bool lit = light >= 2 * LW_DIRECTION_LIGHT_MIN;
        assert_true(lit || light > LW_DIRECTION_LIGHT_MIN / 2 || (r.x == 0 && r.y == 0 && r.z == 0));
        assert_true(!lit || (fabsf(r.y - 0.5f) < 1e-5f && fabsf(r.z - 1) < 1e-5f));
    }
    assert_true(lw_vec3_length(lw_direction_of(down, (const float[3]){1e-38f, 1e-38f, 1e-38f})) == 0);
    for (uint32_t i = 0; i < 200000; i++) {
        float moment[3], light[3];
        hostile(3 * i, moment), hostile(i % 5 ? 3 * i + 30000000 : i, light);
        const struct lw_vec3 r = lw_direction_of(moment, light);
        assert_true(fabsf(r.x) <= 1 && fabsf(r.y) <= 1 && fabsf(r.z) <= 1);
    }
}

/* Half of a texel lies on a floor and half on a wall: each has one moment of both halves' lights. */
static void test_surface_that_turns(void **state) {
    (void)state;
    for (uint32_t i = 0; i < 4000; i++) {
        const float tilt = LW_PI * (float)(i % 64) / 63, share = (float)(i % 11) / 10;
        const struct lw_vec3 normal[2] = {up, lw_vec3(sinf(tilt), cosf(tilt), 0)},
                             m = lw_support_unit_vector(i + 33);
        struct lw_vec3 r = {0};
        for (int k = 0; k < 2; k++) {
            struct lw_vec3 d = lw_support_unit_vector(2 * i + (uint32_t)k);
            d = lw_vec3_mad(d, normal[k], fmaxf(-2 * lw_vec3_dot(d, normal[k]), 0));
            r = lw_vec3_mad(r, d, k ? share : 1 - share);
        }
        for (int k = 0; k < 2; k++) {
            const struct lw_direction_source source = lw_direction_source_of(r, normal[k]);
            const float factor = lw_direction_factor(&source, normal[k], m),
                        gain = lw_direction_gain(&source, normal[k], m, 0.1f);
            assert_true(factor >= 0 && factor <= LW_DIRECTION_FACTOR_MAX);
            assert_true(gain >= 0 && gain <= LW_DIRECTION_GAIN_MAX);
            assert_true(lw_direction_factor(&source, normal[k], normal[k]) == 1);
        }
    }
}

/* GLSL of docs/baking.md, and of page and three. The document keeps a source whose share is under
 * LW_DIRECTION_SHORT: that changes the factor by at most 2 LW_DIRECTION_SHORT. */
static void test_glsl(void **state) {
    (void)state;
    uint32_t known = 0, unknown = 0;
    for (uint32_t i = 0; i < 100000; i++) {
        float r[3];
        hostile(3 * i + 1, r);
        const float size = i % 7 == 0 ? 0 : 0.002f * (float)(i % 500);
        for (int k = 0; k < 3; k++) r[k] *= size;
        const struct lw_vec3 n = lw_support_unit_vector(i), m = lw_support_unit_vector(i + 77),
                             ahead = lw_support_unit_vector(i + 3);
        const float alpha = 0.01f + 0.99f * (float)(i % 90) / 89;
        const struct lw_direction_source source = lw_direction_source_of(lw_vec3(r[0], r[1], r[2]), n);
        const double factor = (double)lw_direction_factor(&source, n, m),
                     gain = (double)lw_direction_gain(&source, n, ahead, alpha);
        const float at[3][3] = {{n.x, n.y, n.z}, {m.x, m.y, m.z}, {ahead.x, ahead.y, ahead.z}};
        const double document = lw_direction_glsl_of_document(r, at[0], at[1]);
        double web[2];
        lw_direction_glsl_of_web(r, at[0], at[1], at[2], alpha, web);
        if (fabsf(lw_vec3_length(lw_vec3(r[0], r[1], r[2])) - LW_DIRECTION_SHORT) < 1e-5f) continue;
        if (fabsf(source.share - LW_DIRECTION_SHORT) < 1e-4f) continue;
        const double slack = source.known && source.share == 0 ? 2 * (double)LW_DIRECTION_SHORT : 2e-3;
        if (!(fabs(document - factor) <= slack && fabs(web[0] - factor) <= 2e-3 &&
              fabs(web[1] - gain) <= 2e-3 * fmax(gain, 1)))
            fail_msg("r %g %g %g: %g in the document, %g and %g in the web, wanted %g, %g", (double)r[0],
                     (double)r[1], (double)r[2], document, web[0], web[1], factor, gain);
        known += source.known, unknown += !source.known;
    }
    assert_true(known > 10000 && unknown > 10000);
}

static void test_texels_of_the_web(void **state) {
    (void)state;
    double r[3];
    lw_direction_glsl_from_texel((const float[3]){0, 0, 0}, r); /* no tile */
    assert_true(r[0] == 0 && r[1] == 0 && r[2] == 0);
    lw_direction_glsl_from_texel((const float[3]){0.5f, 0.5f, 0.5f}, r); /* no light */
    assert_true(r[0] == 0 && r[1] == 0 && r[2] == 0);
    lw_direction_glsl_from_texel((const float[3]){0, 0.5f, 0.75f}, r);
    assert_true(r[0] == -1 && r[1] == 0 && r[2] == 0.5);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_even_light),
        cmocka_unit_test(test_one_source),
        cmocka_unit_test(test_parts_come_back),
        cmocka_unit_test(test_plain_normal_is_exact),
        cmocka_unit_test(test_bounds),
        cmocka_unit_test(test_not_known),
        cmocka_unit_test(test_moments),
        cmocka_unit_test(test_surface_that_turns),
        cmocka_unit_test(test_glsl),
        cmocka_unit_test(test_texels_of_the_web),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
