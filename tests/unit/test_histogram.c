#include "tests/support/support.h"

#include "common/base/histogram.h"

#include <math.h>
#include <stdlib.h>

static struct lw_histogram *make(void) {
    struct lw_histogram *h = calloc(1, sizeof *h);
    assert_non_null(h);
    return h;
}

static void test_empty(void **state) {
    (void)state;
    struct lw_histogram *h = make();
    assert_int_equal(lw_histogram_quantile(h, 0), 0);
    assert_int_equal(lw_histogram_quantile(h, 0.5), 0);
    assert_int_equal(lw_histogram_quantile(h, 1), 0);
    assert_true(lw_histogram_mean(h) == 0);
    free(h);
}

static void test_small_values_are_exact(void **state) {
    (void)state;
    struct lw_histogram *h = make();
    for (uint64_t v = 1; v <= 100; v++) lw_histogram_add(h, v);
    for (uint64_t v = 1; v <= 100; v++) assert_int_equal(lw_histogram_quantile(h, (double)v / 100), v);
    assert_int_equal(lw_histogram_quantile(h, 0.991), 100);
    assert_int_equal(lw_histogram_quantile(h, -1), 1);
    assert_int_equal(lw_histogram_quantile(h, 2), 100);
    assert_true(lw_histogram_mean(h) == 50.5);
    free(h);
}

/* One value at every scale, and at both ends of what a power of two holds: the bucket's middle is within
 * 1/128 of it. */
static void test_every_scale(void **state) {
    (void)state;
    for (unsigned bit = 0; bit < 64; bit++)
        for (int delta = -1; delta <= 1; delta++) {
            uint64_t value = (1ull << bit) + (uint64_t)(int64_t)delta;
            struct lw_histogram *h = make();
            lw_histogram_add(h, 0);
            lw_histogram_add(h, value);
            lw_histogram_add(h, UINT64_MAX);
            double found = (double)lw_histogram_quantile(h, 0.5);
            assert_true(fabs(found - (double)value) <= (double)value / 128);
            assert_int_equal(h->min, 0);
            assert_true(h->max == UINT64_MAX);
            free(h);
        }
}

static void test_quantiles_of_many(void **state) {
    (void)state;
    struct lw_histogram *h = make();
    for (uint64_t v = 1; v <= 1000000; v++) lw_histogram_add(h, v * 1000);
    const double q[] = {0.001, 0.01, 0.5, 0.95, 0.99, 0.999};
    for (unsigned i = 0; i < sizeof q / sizeof q[0]; i++) {
        double expected = q[i] * 1e9, found = (double)lw_histogram_quantile(h, q[i]);
        assert_true(fabs(found - expected) <= expected / 128 + 1000);
    }
    assert_int_equal(lw_histogram_quantile(h, 1), 1000000000);
    assert_int_equal(lw_histogram_quantile(h, 0), 1000);
    free(h);
}

/* The middle of a bucket may lie outside of the added values. */
static void test_between_min_and_max(void **state) {
    (void)state;
    struct lw_histogram *h = make();
    lw_histogram_add(h, 1000001);
    assert_int_equal(lw_histogram_quantile(h, 0.5), 1000001);
    lw_histogram_add(h, 1000003);
    uint64_t found = lw_histogram_quantile(h, 0.5);
    assert_true(found >= 1000001 && found <= 1000003);
    free(h);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_empty),
        cmocka_unit_test(test_small_values_are_exact),
        cmocka_unit_test(test_every_scale),
        cmocka_unit_test(test_quantiles_of_many),
        cmocka_unit_test(test_between_min_and_max),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
