#include "tests/support/support.h"

#include "client/measure/figures/bootstrap.h"
#include "common/base/random.h"

#include <math.h>
#include <string.h>

#define VIEWS   12u
#define REPEATS 5u
#define CELLS   (VIEWS * REPEATS)

static double uniform(uint32_t seed, uint32_t index) {
    return (lw_random_hash2(seed, index) + 0.5) * 0x1p-32;
}

/* Box and Muller. */
static double normal(uint32_t seed, uint32_t index) {
    return sqrt(-2 * log(uniform(seed, 2 * index))) *
           cos(2 * 3.14159265358979 * uniform(seed, 2 * index + 1));
}

static double mean(const void *context, const double *weight) {
    const double *value = context;
    double sum = 0, of = 0;
    for (uint32_t i = 0; i < CELLS; i++) sum += weight[i] * value[i], of += weight[i];
    return of > 0 ? sum / of : (double)NAN;
}

static const struct lw_bootstrap_cells *all_cells(void) {
    static uint8_t there[CELLS];
    static const struct lw_bootstrap_cells cells = {VIEWS, REPEATS, there};
    memset(there, 1, sizeof there);
    return &cells;
}

/* Views that differ by a normal distribution, repeats by one of a tenth: the mean's deviation is known, and
 * of the
 * intervals 95 % hold the reference (a few less: views are few, and a bootstrap takes their spread for
 * smaller by 11/12). */
static void intervals_hold_the_mean_of_a_known_distribution(void **state) {
    (void)state;
    const double centre = 3, of_views = 1, of_repeats = 0.1;
    uint32_t held = 0, trials = 300;
    double width = 0;
    for (uint32_t t = 0; t < trials; t++) {
        double value[CELLS];
        for (uint32_t i = 0; i < CELLS; i++)
            value[i] = centre + of_views * normal(2 * t + 1, i / REPEATS) + of_repeats * normal(2 * t + 2, i);
        const struct lw_bootstrap_interval interval = lw_bootstrap(all_cells(), mean, value, t);
        held += interval.low <= centre && centre <= interval.high;
        width += (interval.high - interval.low) / trials;
        assert_true(interval.low <= interval.value && interval.value <= interval.high);
    }
    const double expected = 2 * 1.96 * of_views * sqrt(11.0 / 12 / VIEWS);
    print_message("held %u of %u, width %.3f for %.3f\n", held, trials, width, expected);
    assert_true(held > 0.87 * trials && held < 0.98 * trials);
    assert_true(fabs(width / expected - 1) < 0.06);
}

/* What a view does to both sides is no uncertainty of their ratio. */
static double ratio(const void *context, const double *weight) {
    const double *value = context;
    double a = 0, b = 0;
    for (uint32_t i = 0; i < CELLS; i++) a += weight[i] * value[i], b += weight[i] * 2 * value[i];
    return a / b;
}

static void pairs_cancel(void **state) {
    (void)state;
    double value[CELLS];
    for (uint32_t i = 0; i < CELLS; i++) value[i] = 0.1 + 10 * uniform(7, i / REPEATS);
    const struct lw_bootstrap_interval interval = lw_bootstrap(all_cells(), ratio, value, 1);
    assert_true(fabs(interval.low - 0.5) < 1e-12 && fabs(interval.high - 0.5) < 1e-12);
}

static void cells_that_are_missing_are_never_drawn(void **state) {
    (void)state;
    uint8_t there[CELLS] = {0};
    double value[CELLS];
    const struct lw_bootstrap_cells cells = {VIEWS, REPEATS, there};
    for (uint32_t i = 0; i < CELLS; i++) value[i] = (double)NAN;
    struct lw_bootstrap_interval interval = lw_bootstrap(&cells, mean, value, 1);
    assert_true(isnan(interval.value) && isnan(interval.low) && isnan(interval.high));
    there[17] = 1;
    value[17] = 4;
    for (uint32_t i = 0; i < CELLS; i++)
        if (i != 17) value[i] = 1e30;
    interval = lw_bootstrap(&cells, mean, value, 1);
    assert_true(interval.value == 4 && interval.low == 4 && interval.high == 4);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(intervals_hold_the_mean_of_a_known_distribution),
                                       cmocka_unit_test(pairs_cancel),
                                       cmocka_unit_test(cells_that_are_missing_are_never_drawn)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
