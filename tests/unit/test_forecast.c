#include "tests/support/support.h"

#include "server/bake/forecast.h"

#include <math.h>

/* Work that falls evenly ends when it will, from the second word on. */
static void even_work_is_foretold(void **state) {
    (void)state;
    struct lw_forecast f = {0};
    assert_true(isinf(lw_forecast_note(&f, 0, 1000)));
    for (double t = 0.5; t < 1000; t += 0.5)
        assert_true(fabs(lw_forecast_note(&f, t, 1000 - t) - (1000 - t)) < 1e-6 * 1000);
    assert_true(lw_forecast_note(&f, 1000, 0) == 0);
}

/* Frames of which the last, with few tiles, each take ten times as long for their work: no longer than half a
 * minute after that has begun, the forecast is right to a tenth. */
static void a_slow_end_is_seen(void **state) {
    (void)state;
    struct lw_forecast f = {0};
    for (double t = 0; t < 90; t += 0.5) lw_forecast_note(&f, t, 1000 - 10 * t);
    for (double t = 90; t < 190; t += 0.5) {
        const double said = lw_forecast_note(&f, t, 100 - (t - 90)), true_s = 190 - t;
        if (t > 90 + 60 && !(fabs(said / true_s - 1) < 0.1)) fail_msg("at %g: %g s, not %g", t, said, true_s);
    }
}

/* An error that proves to be larger: the forecast grows, and recovers. */
static void work_that_grows_has_no_end_until_it_falls(void **state) {
    (void)state;
    struct lw_forecast f = {0};
    lw_forecast_note(&f, 0, 100);
    lw_forecast_note(&f, 1, 90);
    assert_true(isinf(lw_forecast_note(&f, 2, 200)));
    for (double t = 3; t < 20; t++) lw_forecast_note(&f, t, 200 - (t - 2) * 5);
    assert_true(fabs(lw_forecast_note(&f, 20, 110) - 22) < 1e-9);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(even_work_is_foretold),
        cmocka_unit_test(a_slow_end_is_seen),
        cmocka_unit_test(work_that_grows_has_no_end_until_it_falls),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
