/* Running means: plain at rest, short where light changes. */
#include "server/solve/state/history.h"
#include "tests/support/support.h"

static void expect_close(float got, float want, float tolerance) {
    if (!(fabsf(got - want) <= tolerance * fmaxf(1e-3f, fabsf(want))))
        fail_msg("%g instead of %g", (double)got, (double)want);
}

static void test_plain_mean(void **state) {
    (void)state;
    struct lw_history m = {0};
    for (int n = 1; n <= 1000; n++) expect_close(lw_history_take(&m, INFINITY), 1 / (float)n, 1e-5f);
}

static void test_nothing_is_left_without_room(void **state) {
    (void)state;
    struct lw_history m = {0};
    for (int n = 0; n < 100; n++) (void)lw_history_take(&m, INFINITY);
    expect_close(lw_history_take(&m, 0), 1, 0);
    expect_close(m.sample_count, 1, 0);
}

/* A mean's staleness, as gradient.c keeps it. */
static float take_stale(struct lw_history *m, float variance, float *stale) {
    const float weight = lw_history_take(m, *stale > 0 ? lw_history_max(variance, *stale) : INFINITY);
    *stale *= 1 - weight;
    return weight;
}

/* One change: light of the time before fades as the history grows, and is less than the noise from
 * then on. */
static void test_one_change(void **state) {
    (void)state;
    struct lw_history m = {0};
    const float variance = 0.25f, change = 0.1f;
    float stale = 0;
    for (int n = 0; n < 400; n++) (void)take_stale(&m, variance, &stale);
    stale = change;
    (void)take_stale(&m, variance, &stale);
    expect_close(m.sample_count, variance / (change * change) + 1, 1e-4f);
    for (int n = 0; n < 300; n++) {
        (void)take_stale(&m, variance, &stale);
        assert_true(stale * stale < 1.05f * variance / m.sample_count);
    }
    expect_close(m.sample_count, 326, 0.01f);
    expect_close(stale, change * 25 / 326, 0.05f);
}

/* A change in every frame: as old as the mean is noisy. */
static void test_steady_change(void **state) {
    (void)state;
    for (float drift = 0.001f; drift < 0.2f; drift *= 2) {
        struct lw_history m = {0};
        float stale = 0;
        for (int n = 0; n < 3000; n++) {
            stale += drift;
            (void)take_stale(&m, 1, &stale);
        }
        expect_close(m.sample_count, cbrtf(1 / (drift * drift)), 0.2f);
        expect_close(stale, drift * (m.sample_count - 1), 0.05f);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_plain_mean),
        cmocka_unit_test(test_nothing_is_left_without_room),
        cmocka_unit_test(test_one_change),
        cmocka_unit_test(test_steady_change),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
