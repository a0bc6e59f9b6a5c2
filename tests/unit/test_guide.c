#include "tests/support/failing_memory.h"
#include "tests/support/support.h"

#include "client/paths/guide.h"
#include "common/base/random.h"

#include <omp.h>
#include <stdlib.h>
#include <string.h>

static struct lw_guide *create(float alpha, float beta) {
    struct lw_guide *guide;
    struct lw_error err = {0};
    const struct lw_guide_desc desc = {
        .minimum_ws = {-1, 0, 2}, .maximum_ws = {3, 4, 6}, .alpha = alpha, .beta = beta, .trust = 1e-6f};
    lw_support_ok(lw_guide_create(&desc, &guide, &err), &err);
    return guide;
}

static const struct lw_vec3 inside = {0.3f, 1.2f, 3.4f};
static const struct lw_vec3 normals[] = {
    {0, 1, 0}, {0, -1, 0}, {1, 0, 0}, {0.6f, 0, -0.8f}, {0.48f, -0.6f, 0.64f}, {0, 0.6f, 0.8f}};
#define NORMALS (sizeof normals / sizeof *normals)

static struct lw_guide_aim aim(const struct lw_guide *guide, struct lw_vec3 normal) {
    struct lw_guide_aim a;
    lw_guide_aim_at(guide, inside, normal, &a);
    return a;
}

/* A Q that has nothing to do with any scene: some sectors a thousand times as bright as others, some dark. */
static void learn_nonsense(struct lw_guide *guide) {
    const uint32_t first = aim(guide, normals[0]).cell * LW_GUIDE_SECTORS;
    for (uint32_t s = 0; s < LW_GUIDE_SECTORS; s++) {
        const float x = lw_random_unit(lw_random_hash2(s, 7));
        lw_guide_note(guide, first + s, x < 0.3f ? 0 : powf(1000, x));
    }
    lw_guide_learn(guide, 1);
}

/* Even points of the sphere: a grid that is finer than sectors by 64 x 64. */
#define FINE 64u
static struct lw_vec3 sphere_point(uint32_t i, uint32_t j) {
    const float y = 1 - 2 * ((float)i + 0.5f) / (FINE * LW_GUIDE_BANDS), radius = sqrtf(1 - y * y),
                angle = 2 * LW_PI * ((float)j + 0.5f) / (FINE * LW_GUIDE_SLICES);
    return lw_vec3(radius * cosf(angle), y, radius * sinf(angle));
}

/* Integrals of the density over each sector; returns that over the sphere. out: by band, then slice. */
static double integrate(const struct lw_guide_aim *a, double out[LW_GUIDE_BANDS][LW_GUIDE_SLICES]) {
    const double cell = 4 * (double)LW_PI / (FINE * FINE * LW_GUIDE_SECTORS);
    double sum = 0;
    memset(out, 0, LW_GUIDE_SECTORS * sizeof **out);
    for (uint32_t i = 0; i < FINE * LW_GUIDE_BANDS; i++)
        for (uint32_t j = 0; j < FINE * LW_GUIDE_SLICES; j++) {
            const double d = (double)lw_guide_density(a, a->normal, sphere_point(i, j)) * cell;
            sum += d;
            out[i / FINE][j / FINE] += d;
        }
    return sum;
}

static void test_density_integrates_to_one(void **state) {
    (void)state;
    double by_sector[LW_GUIDE_BANDS][LW_GUIDE_SLICES];
    struct lw_guide *guide = create(0, 0.7f);
    for (int learned = 0; learned < 2; learned++) {
        if (learned) learn_nonsense(guide);
        for (size_t n = 0; n < NORMALS; n++) {
            const struct lw_guide_aim a = aim(guide, normals[n]);
            assert_int_equal(a.q != NULL, learned);
            assert_true(fabs(integrate(&a, by_sector) - 1) < 2e-4);
        }
    }
    lw_guide_destroy(guide);
}

/* Where samples fall, and the density that they say. */
static void test_samples_follow_the_density(void **state) {
    (void)state;
    enum { COUNT = 1 << 18 };
    struct lw_guide *guide = create(0, 0.7f);
    for (int learned = 0; learned < 2; learned++) {
        if (learned) learn_nonsense(guide);
        for (size_t n = 0; n < NORMALS; n++) {
            double want[LW_GUIDE_BANDS][LW_GUIDE_SLICES], sum = 0;
            uint32_t got[LW_GUIDE_SECTORS] = {0}, differ = 0;
            const struct lw_guide_aim a = aim(guide, normals[n]);
            integrate(&a, want);
            for (uint32_t i = 0; i < COUNT; i++) {
                float point[2];
                lw_random_sobol2(i, 5, point);
                const struct lw_guide_sample s = lw_guide_sample(&a, a.normal, point);
                assert_true(fabsf(lw_vec3_length(s.direction) - 1) < 1e-5f);
                assert_int_equal(s.place / LW_GUIDE_SECTORS, a.cell);
                got[s.place % LW_GUIDE_SECTORS]++;
                /* On the border of two sectors rounding may take either. */
                const float density = lw_guide_density(&a, a.normal, s.direction);
                differ += fabsf(density - s.density) > 1e-3f * s.density + 1e-6f;
                const float cosine = lw_vec3_dot(s.direction, normals[n]);
                if (cosine > 0) sum += (double)(cosine / s.density);
            }
            assert_true(differ < COUNT / 10000);
            /* The mean of f / p is the integral of f: here of the cosine over the hemisphere. */
            assert_true(fabs(sum / COUNT / (double)LW_PI - 1) < 2e-3);
            for (uint32_t k = 0; k < LW_GUIDE_BANDS; k++)
                for (uint32_t j = 0; j < LW_GUIDE_SLICES; j++)
                    assert_true(fabs((double)got[j * LW_GUIDE_BANDS + k] / COUNT - want[k][j]) < 5e-4);
        }
    }
    lw_guide_destroy(guide);
}

/* Surfaces of other normals may share an aim: each has a density that integrates to one. */
static void test_an_aim_may_be_shared(void **state) {
    (void)state;
    const double cell = 4 * (double)LW_PI / (FINE * FINE * LW_GUIDE_SECTORS);
    struct lw_guide *guide = create(0, 0.7f);
    learn_nonsense(guide);
    const struct lw_guide_aim a = aim(guide, normals[0]);
    for (size_t n = 1; n < NORMALS; n++) {
        double sum = 0, mean = 0;
        for (uint32_t i = 0; i < FINE * LW_GUIDE_BANDS; i++)
            for (uint32_t j = 0; j < FINE * LW_GUIDE_SLICES; j++)
                sum += (double)lw_guide_density(&a, normals[n], sphere_point(i, j)) * cell;
        assert_true(fabs(sum - 1) < 2e-4);
        for (uint32_t i = 0; i < 1 << 16; i++) {
            float point[2];
            lw_random_sobol2(i, 11, point);
            const struct lw_guide_sample s = lw_guide_sample(&a, normals[n], point);
            mean += (double)(fmaxf(0, lw_vec3_dot(s.direction, normals[n])) / s.density) / (1 << 16);
        }
        assert_true(fabs(mean / (double)LW_PI - 1) < 4e-3);
    }
    lw_guide_destroy(guide);
}

/* No sample weighs more than 1 / (1 - beta), whatever Q says. */
static void test_weights_are_bounded(void **state) {
    (void)state;
    struct lw_guide *guide = create(0, 0.5f);
    learn_nonsense(guide);
    for (size_t n = 0; n < NORMALS; n++) {
        const struct lw_guide_aim a = aim(guide, normals[n]);
        for (uint32_t i = 0; i < 4096; i++) {
            float point[2];
            lw_random_sobol2(i, 9, point);
            const struct lw_guide_sample s = lw_guide_sample(&a, a.normal, point);
            const float cosine = lw_vec3_dot(s.direction, normals[n]);
            if (cosine > 0) assert_true(cosine / LW_PI / s.density < 2.0001f);
        }
    }
    lw_guide_destroy(guide);
}

/* Even light from everywhere: a white surface reflects it, up to the cosines of the sectors' middles. */
static void test_even_light_is_reflected(void **state) {
    (void)state;
    struct lw_guide *guide = create(0, 0);
    assert_true(lw_guide_reflected(&(struct lw_guide_aim){.q = NULL}) == 0);
    const uint32_t first = aim(guide, normals[0]).cell * LW_GUIDE_SECTORS;
    for (uint32_t s = 0; s < LW_GUIDE_SECTORS; s++) lw_guide_note(guide, first + s, 3);
    lw_guide_learn(guide, 2);
    for (size_t n = 0; n < NORMALS; n++) {
        const struct lw_guide_aim a = aim(guide, normals[n]);
        assert_true(fabsf(lw_guide_reflected(&a) / 3 - 1) < 0.025f);
    }
    lw_guide_destroy(guide);
}

/* Q of one sector, by what a surface that faces it reflects. */
static float learned(const struct lw_guide *guide) {
    const struct lw_guide_aim a = aim(guide, normals[0]);
    return a.q ? a.q[0] : 0;
}

static void note(struct lw_guide *guide, unsigned times, float luminance) {
    const uint32_t first = aim(guide, normals[0]).cell * LW_GUIDE_SECTORS;
    for (unsigned i = 0; i < times; i++) lw_guide_note(guide, first, luminance);
}

static void test_first_notes_are_averaged_and_later_ones_weigh_alpha(void **state) {
    (void)state;
    struct lw_guide *guide = create(0.1f, 0);
    note(guide, 1, 4);
    lw_guide_learn(guide, 1);
    assert_true(fabsf(learned(guide) - 4) < 1e-3f);
    note(guide, 1, 2);
    lw_guide_learn(guide, 1);
    assert_true(fabsf(learned(guide) - 3) < 1e-3f);
    note(guide, 998, 3);
    lw_guide_learn(guide, 1);
    assert_true(fabsf(learned(guide) - 3) < 1e-3f);
    note(guide, 2, 13); /* 1 - 0.9^2 of the way */
    lw_guide_learn(guide, 1);
    assert_true(fabsf(learned(guide) - (3 + 0.19f * 10)) < 1e-3f);
    lw_guide_destroy(guide);
}

/* The sums keep the light of the brightest and of the dimmest scene, from the second pass on. */
static void test_any_brightness(void **state) {
    (void)state;
    for (float l = 1e-30f; l < 1e31f; l *= 1e6f) {
        struct lw_guide *guide = create(1, 0);
        for (int pass = 0; pass < 2; pass++) {
            note(guide, 3, l);
            lw_guide_learn(guide, 1);
        }
        if (!(fabsf(learned(guide) / l - 1) < 1e-3f)) fail_msg("%g: %g", (double)l, (double)learned(guide));
        lw_guide_destroy(guide);
    }
}

/* The share of Q's directions grows with the samples of a cell. */
static void test_trust_grows_with_notes(void **state) {
    (void)state;
    struct lw_guide *guide;
    struct lw_error err = {0};
    lw_support_ok(lw_guide_create(&(struct lw_guide_desc){.beta = 0.8f, .trust = 300}, &guide, &err), &err);
    for (unsigned n = 100; n <= 300; n += 100) {
        note(guide, 100, 1);
        lw_guide_learn(guide, 1);
        assert_true(fabsf(aim(guide, normals[0]).beta - 0.8f * (float)n / ((float)n + 300)) < 1e-5f);
    }
    lw_guide_destroy(guide);
}

static void test_what_is_no_light_counts_as_none(void **state) {
    (void)state;
    struct lw_guide *guide = create(0, 0);
    note(guide, 1, NAN);
    note(guide, 1, INFINITY);
    note(guide, 1, -5);
    note(guide, 1, 8);
    lw_guide_learn(guide, 1);
    assert_true(fabsf(learned(guide) - 2) < 1e-3f);
    lw_guide_destroy(guide);
}

/* Points outside count as of the nearest cell; a scene without extent has one. */
static void test_any_point_has_a_cell(void **state) {
    (void)state;
    struct lw_guide *guide = create(0, 0), *flat;
    struct lw_guide_aim a, b;
    struct lw_error err = {0};
    lw_guide_aim_at(guide, lw_vec3(-1e9f, 1e9f, INFINITY), normals[0], &a);
    lw_guide_aim_at(guide, lw_vec3(-1, 3.999f, 5.999f), normals[0], &b);
    assert_int_equal(a.cell, b.cell);
    lw_guide_aim_at(guide, lw_vec3(NAN, NAN, NAN), normals[0], &a);
    assert_int_equal(a.cell, 0);
    lw_guide_destroy(guide);
    lw_support_ok(lw_guide_create(&(struct lw_guide_desc){.alpha = 0}, &flat, &err), &err);
    lw_guide_aim_at(flat, lw_vec3(0, 0, 0), normals[0], &a);
    assert_int_equal(a.cell, 0);
    lw_guide_destroy(flat);
}

/* The same notes in another order, from several threads. */
static void test_order_and_threads_change_nothing(void **state) {
    (void)state;
    enum { COUNT = 1 << 16 };
    struct lw_guide *guide[2] = {create(0, 0), create(0, 0)};
    const uint32_t first = aim(guide[0], normals[0]).cell * LW_GUIDE_SECTORS;
    for (int pass = 0; pass < 3; pass++)
        for (int g = 0; g < 2; g++) {
#pragma omp parallel for num_threads(g ? 4 : 1)
            for (uint32_t k = 0; k < COUNT; k++) {
                const uint32_t i = g ? COUNT - 1 - k : k;
                const uint32_t hash = lw_random_hash2(i, (uint32_t)pass);
                lw_guide_note(guide[g], first + hash % LW_GUIDE_SECTORS, expf((float)(hash >> 16) * 1e-3f));
            }
            lw_guide_learn(guide[g], g ? 4 : 1);
        }
    const struct lw_guide_aim a = aim(guide[0], normals[0]), b = aim(guide[1], normals[0]);
    assert_memory_equal(a.q, b.q, LW_GUIDE_SECTORS * sizeof *a.q);
    for (int g = 0; g < 2; g++) lw_guide_destroy(guide[g]);
}

static void test_out_of_memory(void **state) {
    (void)state;
    struct lw_guide *guide = NULL;
    enum lw_status status = LW_NO_MEMORY;
    unsigned enough = 0;
    for (; status != LW_OK; enough++) {
        struct lw_error err = {0};
        failing_memory_all(enough);
        status = lw_guide_create(&(struct lw_guide_desc){.alpha = 0}, &guide, &err);
        (void)failing_memory_end();
        if (status == LW_OK) break;
        assert_int_equal(status, LW_NO_MEMORY);
        assert_null(guide);
        assert_non_null(strstr(err.text, "guiding"));
    }
    assert_int_equal(enough, 5);
    lw_guide_destroy(guide);
    lw_guide_destroy(NULL);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_density_integrates_to_one),
        cmocka_unit_test(test_samples_follow_the_density),
        cmocka_unit_test(test_an_aim_may_be_shared),
        cmocka_unit_test(test_weights_are_bounded),
        cmocka_unit_test(test_even_light_is_reflected),
        cmocka_unit_test(test_first_notes_are_averaged_and_later_ones_weigh_alpha),
        cmocka_unit_test(test_any_brightness),
        cmocka_unit_test(test_trust_grows_with_notes),
        cmocka_unit_test(test_what_is_no_light_counts_as_none),
        cmocka_unit_test(test_any_point_has_a_cell),
        cmocka_unit_test(test_order_and_threads_change_nothing),
        cmocka_unit_test(test_out_of_memory),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
