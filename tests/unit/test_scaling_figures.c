#include "tests/support/support.h"

#include "client/measure/figures/scaling_figures.h"

#include <math.h>

static void means_and_intervals(void **state) {
    (void)state;
    const double value[] = {1, 2, 3, 4};
    struct lw_scaling_figure f = lw_scaling_figures_mean(value, 4);
    assert_true(fabs(f.mean - 2.5) < 1e-12);
    /* s = sqrt(5/3), t(3) = 3.182: 3.182 * 1.29099 / 2 */
    assert_true(fabs(f.half - 2.05397) < 1e-3);
    f = lw_scaling_figures_mean(value, 1);
    assert_true(f.mean == 1 && f.half == 0);
    f = lw_scaling_figures_mean((const double[]){(double)INFINITY, 1}, 2);
    assert_true(isinf(f.mean) && f.half == 0);
}

static void lines_and_crossings(void **state) {
    (void)state;
    const uint32_t users[] = {1, 2, 8, 64};
    double cost[4], fixed, slope;
    for (int i = 0; i < 4; i++) cost[i] = 12 + 0.5 * users[i];
    lw_scaling_figures_line(users, cost, 4, &fixed, &slope);
    assert_true(fabs(fixed - 12) < 1e-9 && fabs(slope - 0.5) < 1e-9);
    assert_true(fabs(lw_scaling_figures_cross(fixed, slope, 2) - 8) < 1e-9); /* 12 + 0.5 N = 2 N */
    assert_true(isinf(lw_scaling_figures_cross(12, 2, 2)));
    assert_true(lw_scaling_figures_cross(-1, 0.5, 2) == 0);
    lw_scaling_figures_line(users, cost, 1, &fixed, &slope);
    assert_true(fixed == cost[0] && slope == 0);
}

static void errors_are_compared_over_the_same_views(void **state) {
    (void)state;
    struct lw_scaling_errors all = {.of = {{0}}}, some = {.of = {{0}}};
    for (uint32_t p = 0; p < LW_SCALING_PICTURES; p++)
        for (uint32_t eye = 0; eye < LW_SCALING_EYES; eye++) {
            all.of[p][eye] = p + 10.0 * eye;
            all.judged[p][eye] = true;
        }
    some.judged[0][1] = some.judged[2][3] = true;
    some.of[0][1] = 7;
    assert_true(fabs(lw_scaling_figures_error(&all, &all) - 16) < 1e-12);
    assert_true(fabs(lw_scaling_figures_error(&all, &some) - (10 + 32) / 2.0) < 1e-12);
    assert_true(fabs(lw_scaling_figures_error(&some, &all) - 3.5) < 1e-12);
    assert_true(isnan(lw_scaling_figures_error(&all, &(struct lw_scaling_errors){.of = {{0}}})));
}

static void rungs_that_gained_nothing_are_left_out(void **state) {
    (void)state;
    assert_int_equal(lw_scaling_figures_rungs(0, 7), 2); /* nothing but the first: one more is tried */
    assert_int_equal(lw_scaling_figures_rungs(3, 7), 5);
    assert_int_equal(lw_scaling_figures_rungs(6, 7), 7);
    assert_int_equal(lw_scaling_figures_rungs(1, 2), 2); /* never more than before */
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(means_and_intervals), cmocka_unit_test(errors_are_compared_over_the_same_views),
        cmocka_unit_test(lines_and_crossings), cmocka_unit_test(rungs_that_gained_nothing_are_left_out)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
