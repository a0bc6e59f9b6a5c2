#include "tests/support/failing_memory.h"
#include "tests/support/support.h"

#include "client/measure/figures/flip.h"
#include "client/measure/figures/reference.h"
#include "client/measure/figures/view_error.h"
#include "common/base/random.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { WIDTH = 64, HEIGHT = 48, PIXELS = WIDTH * HEIGHT, VALUES = 3 * PIXELS };

/* Uniform noise of variance 1. */
static float noise(uint32_t seed, size_t i) {
    return sqrtf(12) * (lw_random_unit(lw_random_hash2(seed, (uint32_t)i)) - 0.5f);
}

static float signal_at(size_t i) { return 0.2f + 0.3f * (float)(i % 5); }

static struct lw_view_error_reference reference_of(const float *a, const float *b) {
    return (struct lw_view_error_reference){.width = WIDTH, .height = HEIGHT, .half = {a, b}};
}

static struct lw_view_error_sum start(double epsilon) {
    struct lw_view_error_sum sum;
    lw_view_error_init(&sum, &(struct lw_view_error_desc){.epsilon = epsilon, .moment_distance_s = 0.25});
    return sum;
}

static void add(struct lw_view_error_sum *sum, const struct lw_view_error_reference *reference,
                const float *picture) {
    struct lw_error err = {0};
    lw_support_ok(lw_view_error_add(sum, reference, picture, &err), &err);
}

static void expect_near(double got, double want, double tolerance) {
    if (!(fabs(got - want) <= tolerance)) fail_msg("got %.8g, expected %.8g", got, want);
}

/* ---- one picture ---- */

static void relmse_is_the_references(void **state) {
    (void)state;
    static float half[2][VALUES], picture[VALUES];
    for (size_t i = 0; i < VALUES; i++) {
        for (uint32_t h = 0; h < 2; h++) half[h][i] = signal_at(i) + 0.05f * noise(h, i);
        picture[i] = 1.1f * signal_at(i) + 0.02f * noise(2, i);
    }
    const struct lw_view_error_reference reference = reference_of(half[0], half[1]);
    struct lw_reference same = {.width = WIDTH, .height = HEIGHT, .half = {half[0], half[1]}};
    for (size_t i = 0; i < VALUES; i++) {
        const double mean = 0.5 * ((double)half[0][i] + (double)half[1][i]);
        same.mean_square += mean * mean / VALUES;
    }
    struct lw_view_error_sum sum = start(0.01 * same.mean_square);
    add(&sum, &reference, picture);
    const struct lw_view_error error = lw_view_error_of(&sum);
    expect_near(error.relmse, lw_reference_error(&same, picture), 1e-12);
    assert_int_equal(error.pixel_count, PIXELS);
    same.mean_square = 100 * LW_VIEW_ERROR_FIXED_EPSILON;
    expect_near(error.relmse_fixed, lw_reference_error(&same, picture), 1e-12);
    lw_view_error_finish(&sum);
}

static void nothing_is_no_number(void **state) {
    (void)state;
    struct lw_view_error_sum sum = start(1);
    const struct lw_view_error error = lw_view_error_of(&sum);
    assert_true(isnan(error.relmse) && isnan(error.relmse_fixed) && isnan(error.relmse_trimmed));
    assert_true(isnan(error.flip) && isnan(error.flicker) && isnan(error.lag_s) && isnan(error.lag_relmse));
    assert_int_equal(error.pixel_count, 0);
    lw_view_error_finish(&sum);
    lw_view_error_finish(&(struct lw_view_error_sum){0});
}

/* The worst 6 of 2 x 3,072 pixels go, wherever they are; each other one is off by its number. */
static void the_worst_pixels_of_all_views_are_left_out(void **state) {
    (void)state;
    static float half[VALUES], picture[2][VALUES];
    double kept = 0;
    for (size_t p = 0; p < PIXELS; p++)
        for (int v = 0; v < 2; v++) {
            const bool bad = v == 0 && (p == 5 || (p > 100 && p < 105)), worst = v == 1 && p == PIXELS - 1;
            const double square = bad ? 1e4 + (double)p : worst ? 1e9 : 1e-2 * (double)(p * 7919 % PIXELS);
            if (!bad && !worst) kept += square / 3;
            for (size_t c = 0; c < 3; c++) half[3 * p + c] = 1, picture[v][3 * p + c] = 1;
            picture[v][3 * p + p % 3] = 1 + (float)sqrt(2 * square); /* t^2 + epsilon is 2 */
        }
    struct lw_view_error_sum sum = start(1);
    const struct lw_view_error_reference reference = reference_of(half, half);
    for (int v = 0; v < 2; v++) add(&sum, &reference, picture[v]);
    for (int again = 0; again < 2; again++) {
        const struct lw_view_error error = lw_view_error_of(&sum);
        assert_true(error.relmse > 1e4);
        expect_near(error.relmse_trimmed / (kept / (2 * PIXELS - 6)), 1, 1e-5);
    }
    lw_view_error_finish(&sum);
}

/* Sizes about the least one of which a pixel goes, against sorting. */
static int ascending(const void *a, const void *b) {
    const float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}
static void trimming_sorts(void **state) {
    (void)state;
    static const uint32_t sizes[] = {1, 2, 999, 1000, 1001, 1999, 2000, 5003};
    for (size_t s = 0; s < sizeof sizes / sizeof sizes[0]; s++)
        for (uint32_t kinds = 1; kinds <= 4096; kinds *= 16) { /* few: equal ones */
            const uint32_t count = sizes[s];
            static float half[3 * 5003], picture[3 * 5003], error[5003];
            for (uint32_t p = 0; p < count; p++) {
                const float off = (float)(lw_random_hash2(s + 1, p) % kinds);
                for (uint32_t c = 0; c < 3; c++) half[3 * p + c] = 0, picture[3 * p + c] = off;
                error[p] = off * off;
            }
            qsort(error, count, sizeof error[0], ascending);
            double expected = 0;
            const uint32_t kept = count - count / 1000;
            for (uint32_t p = 0; p < kept; p++) expected += (double)error[p] / kept;
            struct lw_view_error_sum sum = start(1);
            add(&sum, &(struct lw_view_error_reference){.width = count, .height = 1, .half = {half, half}},
                picture);
            expect_near(lw_view_error_of(&sum).relmse_trimmed, expected, 1e-6 * expected);
            lw_view_error_finish(&sum);
        }
}

static void flip_is_of_shown_pictures(void **state) {
    (void)state;
    static float half[2][VALUES], picture[VALUES], shown[2][VALUES], map[PIXELS];
    for (size_t i = 0; i < VALUES; i++) {
        half[0][i] = signal_at(i) * 1.5f, half[1][i] = signal_at(i) * 0.5f;
        picture[i] = signal_at(i) * (1 + 0.2f * noise(1, i));
    }
    const struct lw_view_error_desc desc = {
        .epsilon = 1, .curve = LW_TONEMAP_ACES, .stops = 1, .pixels_per_degree = 40};
    struct lw_view_error_sum sum;
    lw_view_error_init(&sum, &desc);
    const struct lw_view_error_reference reference = reference_of(half[0], half[1]);
    add(&sum, &reference, picture);
    for (size_t p = 0; p < PIXELS; p++)
        for (int side = 0; side < 2; side++) {
            float light[3];
            for (size_t c = 0; c < 3; c++) light[c] = 2 * (side ? picture[3 * p + c] : signal_at(3 * p + c));
            const struct lw_vec3 c = lw_tonemap_apply(LW_TONEMAP_ACES, lw_vec3(light[0], light[1], light[2]));
            shown[side][3 * p] = c.x, shown[side][3 * p + 1] = c.y, shown[side][3 * p + 2] = c.z;
        }
    struct lw_error err = {0};
    lw_support_ok(lw_flip_map(shown[0], shown[1], WIDTH, HEIGHT, 40, map, &err), &err);
    const double expected = lw_flip_mean(map, NULL, PIXELS);
    assert_true(expected > 0.01);
    expect_near(lw_view_error_of(&sum).flip, expected, 1e-5);
    /* a view of one pixel weighs a pixel: white where black should be */
    const float zero[3] = {0}, bright[3] = {1e6f, 1e6f, 1e6f};
    const struct lw_view_error_reference one = {.width = 1, .height = 1, .half = {zero, zero}};
    add(&sum, &one, bright);
    expect_near(lw_view_error_of(&sum).flip, (expected * PIXELS + 0.96738) / (PIXELS + 1), 1e-5);
    lw_view_error_finish(&sum);
}

/* ---- pixels that do not count ---- */

static void what_is_left_out_has_no_influence(void **state) {
    (void)state;
    static float half[3][2][VALUES], picture[2][2][VALUES];
    static uint8_t left_out[PIXELS];
    for (size_t i = 0; i < VALUES; i++) {
        for (uint32_t m = 0; m < 3; m++)
            for (uint32_t h = 0; h < 2; h++)
                half[m][h][i] = (1 + 0.3f * (float)m) * signal_at(i) + 0.01f * noise(2 * m + h, i);
        for (uint32_t k = 0; k < 2; k++)
            picture[0][k][i] = (1.1f + 0.3f * (float)k) * signal_at(i) + 0.02f * noise(20 + k, i);
    }
    for (size_t p = 0; p < PIXELS; p++) left_out[p] = p % WIDTH > 20 && p % WIDTH < 30 ? 255 : 0;
    memcpy(picture[1], picture[0], sizeof picture[0]);
    for (size_t i = 0; i < VALUES; i++)
        if (left_out[i / 3])
            for (uint32_t k = 0; k < 2; k++) picture[1][k][i] = i % 7 ? 1e20f : NAN;
    enum { CLEAN, MASKED, BARE, NO_NUMBER, KINDS }; /* BARE: bad pixels count */
    struct lw_view_error error[KINDS];
    for (int kind = 0; kind < KINDS; kind++) {
        for (size_t p = 0; kind == NO_NUMBER && p < PIXELS; p++)
            if (left_out[p]) half[2][p % 2][3 * p + p % 3] = p % 5 ? NAN : INFINITY;
        struct lw_view_error_reference reference[3];
        for (uint32_t m = 0; m < 3; m++) reference[m] = reference_of(half[m][0], half[m][1]);
        if (kind == CLEAN || kind == MASKED) reference[2].left_out = left_out;
        const float(*seen)[VALUES] = picture[kind != CLEAN];
        struct lw_view_error_sum sum = start(0.01);
        add(&sum, &reference[2], seen[1]);
        lw_view_error_add_step(&sum, &reference[1], seen[0], &reference[2], seen[1]);
        lw_view_error_add_lag(&sum, reference, 3, seen[1]);
        error[kind] = lw_view_error_of(&sum);
        lw_view_error_finish(&sum);
    }
    assert_true(isfinite(error[0].relmse) && isfinite(error[0].lag_s));
    expect_near(error[CLEAN].lag_relmse_now, error[CLEAN].relmse, 1e-12);
    assert_memory_equal(&error[CLEAN], &error[MASKED], sizeof error[0]);
    assert_memory_equal(&error[CLEAN], &error[NO_NUMBER], sizeof error[0]);
    assert_int_equal(error[0].pixel_count, HEIGHT * (WIDTH - 9));
    assert_int_equal(error[0].not_finite, 0);
    assert_true(error[BARE].relmse > 1e6 && error[BARE].flip > error[CLEAN].flip &&
                error[BARE].not_finite > 0);
}

static void several_moments_take_all_their_masks(void **state) {
    (void)state;
    const float before[6] = {1, 1, 1, 1, 1, 1}, now[6] = {1, 1, 1, 5, 5, 5};
    const uint8_t left_out[2] = {0, 1};
    struct lw_view_error_reference reference[2];
    for (int with = 0; with < 2; with++) {
        for (int k = 0; k < 2; k++)
            reference[k] =
                (struct lw_view_error_reference){.width = 2, .height = 1, .half = {before, before}};
        if (with) reference[0].left_out = left_out;
        struct lw_view_error_sum sum = start(1);
        lw_view_error_add_step(&sum, &reference[0], before, &reference[1], now);
        lw_view_error_add_lag(&sum, reference, 2, now);
        const struct lw_view_error error = lw_view_error_of(&sum);
        const double expected = with ? 0 : 4; /* 16 / (1 + 1) in one of 2 pixels */
        expect_near(error.flicker, expected, 1e-12);
        expect_near(error.lag_relmse, expected, 1e-12);
        lw_view_error_finish(&sum);
    }
}

static void what_is_no_number_counts_as_black(void **state) {
    (void)state;
    const float reference[3] = {1, 2, 3}, picture[3] = {NAN, 2, INFINITY}, black[3] = {0, 2, 0};
    const struct lw_view_error_reference t = {.width = 1, .height = 1, .half = {reference, reference}};
    struct lw_view_error error[2];
    for (int k = 0; k < 2; k++) {
        struct lw_view_error_sum sum = start(1);
        add(&sum, &t, k ? picture : black);
        error[k] = lw_view_error_of(&sum);
        assert_int_equal(error[k].not_finite, k ? 2 : 0);
        lw_view_error_finish(&sum);
    }
    expect_near(error[0].relmse, (1.0 / 2 + 9.0 / 10) / 3, 1e-12);
    assert_true(error[1].relmse == error[0].relmse && error[1].flip == error[0].flip);
}

/* ---- flicker ---- */

static void flicker_is_change_that_the_reference_has_not(void **state) {
    (void)state;
    static float half[2][2][VALUES], picture[2][VALUES];
    double expected = 0;
    const float sigma = 0.03f;
    for (size_t i = 0; i < VALUES; i++)
        for (uint32_t k = 0; k < 2; k++) {
            const float t = signal_at(i) * (k ? 1.25f : 1);
            for (uint32_t h = 0; h < 2; h++) half[k][h][i] = t + 0.1f * noise(2 * k + h, i);
            picture[k][i] = t + 0.4f; /* off, and steadily so */
            if (k) expected += 2.0 * (double)(sigma * sigma) / ((double)(t * t) + 0.05) / VALUES;
        }
    struct lw_view_error_reference reference[2];
    for (int k = 0; k < 2; k++) reference[k] = reference_of(half[k][0], half[k][1]);
    struct lw_view_error_sum steady = start(0.05);
    add(&steady, &reference[1], picture[1]);
    lw_view_error_add_step(&steady, &reference[0], picture[0], &reference[1], picture[1]);
    const struct lw_view_error still = lw_view_error_of(&steady);
    assert_true(still.relmse > 0.2);
    expect_near(still.flicker / still.relmse, 0, 0.02); /* noise of the references, taken out */
    lw_view_error_finish(&steady);

    for (size_t i = 0; i < VALUES; i++)
        for (uint32_t k = 0; k < 2; k++) {
            picture[k][i] += sigma * noise(10 + k, i);
            for (int h = 0; h < 2; h++) half[k][h][i] = signal_at(i) * (k ? 1.25f : 1);
        }
    struct lw_view_error_sum noisy = start(0.05);
    lw_view_error_add_step(&noisy, &reference[0], picture[0], &reference[1], picture[1]);
    expect_near(lw_view_error_of(&noisy).flicker / expected, 1, 0.06);
    lw_view_error_finish(&noisy);
}

/* ---- lag ---- */

#define MOMENTS 9 /* 2 s at 4 per second */

/* A lamp that walks over the picture. */
static float walking(size_t i, double t_s) {
    const size_t p = i / 3;
    const double x = (double)(p % WIDTH) - 12 - 15 * t_s, y = (double)(p / WIDTH) - HEIGHT / 2;
    return (float)(0.1 + 2 * exp(-(x * x + y * y) / 300));
}

/* Fits a picture of `age` seconds, with noise, to references with noise. */
static struct lw_view_error lag_of(float (*light)(size_t i, double t_s), double age_s, float sigma,
                                   uint32_t views) {
    static float half[MOMENTS][2][VALUES], picture[VALUES];
    struct lw_view_error_reference reference[MOMENTS];
    struct lw_view_error_sum sum = start(0.01);
    for (uint32_t v = 0; v < views; v++) {
        for (uint32_t m = 0; m < MOMENTS; m++) {
            reference[m] = reference_of(half[m][0], half[m][1]);
            for (uint32_t h = 0; h < 2; h++)
                for (size_t i = 0; i < VALUES; i++)
                    half[m][h][i] = light(i, 0.25 * m) + sigma * noise(100 * v + 2 * m + h, i);
        }
        for (size_t i = 0; i < VALUES; i++)
            picture[i] = light(i, 0.25 * (MOMENTS - 1) - age_s) + sigma * noise(100 * v + 99, i);
        lw_view_error_add_lag(&sum, reference, MOMENTS, picture);
    }
    const struct lw_view_error error = lw_view_error_of(&sum);
    lw_view_error_finish(&sum);
    return error;
}

static float growing(size_t i, double t_s) { return signal_at(i) * (float)(1 + 0.1 * t_s); }
static float still(size_t i, double t_s) {
    (void)t_s;
    return signal_at(i);
}

static void the_age_of_light_is_found(void **state) {
    (void)state;
    static const double ages[] = {0, 0.1, 0.25, 0.375, 0.9, 1.5, 2};
    for (size_t a = 0; a < sizeof ages / sizeof ages[0]; a++) {
        /* light that changes linearly is found exactly, and nothing is left */
        struct lw_view_error error = lag_of(growing, ages[a], 0, 1);
        expect_near(error.lag_s, ages[a], 1e-4);
        expect_near(error.lag_relmse, 0, 1e-9);
        error = lag_of(walking, ages[a], 0, 1);
        expect_near(error.lag_s, ages[a], 0.02);
        if (ages[a] > 0) assert_true(error.lag_relmse < 0.2 * error.lag_relmse_now);
        /* noise of picture and references moves it little, and not towards a middle */
        error = lag_of(walking, ages[a], 0.05f, 2);
        expect_near(error.lag_s, ages[a], 0.05);
    }
    /* beyond the moments: the nearest of them */
    assert_true(lag_of(growing, 3, 0, 1).lag_s == 2);
    assert_true(lag_of(growing, -1, 0, 1).lag_s == 0);
}

static void a_mix_of_ages_is_between_them(void **state) {
    (void)state;
    static float half[3][VALUES], picture[VALUES];
    struct lw_view_error_reference reference[3];
    for (uint32_t m = 0; m < 3; m++) {
        reference[m] = reference_of(half[m], half[m]);
        for (size_t i = 0; i < VALUES; i++) half[m][i] = walking(i, 0.25 * m);
    }
    for (size_t i = 0; i < VALUES; i++) picture[i] = 0.75f * half[1][i] + 0.25f * half[0][i];
    struct lw_view_error_sum sum = start(0.01);
    lw_view_error_add_lag(&sum, reference, 3, picture);
    const struct lw_view_error error = lw_view_error_of(&sum);
    expect_near(error.lag_s, 0.25 + 0.25 * 0.25, 1e-5);
    expect_near(error.lag_relmse, 0, 1e-9);
    lw_view_error_finish(&sum);
}

static void still_light_has_no_age(void **state) {
    (void)state;
    assert_true(isnan(lag_of(still, 0, 0, 1).lag_s));
    for (int k = 1; k < 4; k++) { /* nor has noise */
        const struct lw_view_error error = lag_of(still, 0, 0.05f * (float)k, 1);
        assert_true(isnan(error.lag_s) && isfinite(error.lag_relmse) && isfinite(error.lag_relmse_now));
    }
    /* a change that noise of one pixel hides and that of all of them does not */
    assert_true(isfinite(lag_of(growing, 0.5, 0.05f, 1).lag_s));
}

/* ---- failures ---- */

static void a_failure_adds_nothing(void **state) {
    (void)state;
    static float half[VALUES], picture[VALUES];
    for (size_t i = 0; i < VALUES; i++) half[i] = signal_at(i), picture[i] = 0;
    const struct lw_view_error_reference reference = reference_of(half, half);
    struct lw_view_error_sum sum = start(1);
    struct lw_error err = {0};
    unsigned failures = 0;
    for (enum lw_status status = LW_NO_MEMORY; status != LW_OK;) {
        lw_view_error_finish(&sum);
        sum = start(1);
        err = (struct lw_error){0};
        failing_memory_all(failures);
        status = lw_view_error_add(&sum, &reference, picture, &err);
        (void)failing_memory_end();
        if (status == LW_OK) break;
        lw_support_fails(status, LW_NO_MEMORY, &err, "no memory");
        const struct lw_view_error error = lw_view_error_of(&sum);
        assert_true(error.pixel_count == 0 && isnan(error.flip) && isnan(error.relmse));
        failures++;
    }
    assert_int_equal(failures, 3);
    assert_int_equal(lw_view_error_of(&sum).pixel_count, PIXELS);
    const struct lw_view_error_reference none = {.width = 0, .height = 4, .half = {half, half}};
    err = (struct lw_error){0};
    lw_support_fails(lw_view_error_add(&sum, &none, picture, &err), LW_USAGE, &err, "0 x 4");
    lw_view_error_finish(&sum);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(relmse_is_the_references),
        cmocka_unit_test(nothing_is_no_number),
        cmocka_unit_test(the_worst_pixels_of_all_views_are_left_out),
        cmocka_unit_test(trimming_sorts),
        cmocka_unit_test(flip_is_of_shown_pictures),
        cmocka_unit_test(what_is_left_out_has_no_influence),
        cmocka_unit_test(several_moments_take_all_their_masks),
        cmocka_unit_test(what_is_no_number_counts_as_black),
        cmocka_unit_test(flicker_is_change_that_the_reference_has_not),
        cmocka_unit_test(the_age_of_light_is_found),
        cmocka_unit_test(a_mix_of_ages_is_between_them),
        cmocka_unit_test(still_light_has_no_age),
        cmocka_unit_test(a_failure_adds_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
