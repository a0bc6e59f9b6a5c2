#include "tests/support/support.h"

#include "client/view/plateau.h"

#include <math.h>

#define S 1000000000ull

/* The error of a mean, polled twenty times a second, never converges. */
static void test_what_falls_does_not_settle(void **state) {
    (void)state;
    for (double speed = 0.1; speed < 100; speed *= 10) {
        struct lw_plateau s = {0};
        for (uint64_t t = 0; t < 600 * S; t += S / 20) {
            const double at_s = 1e-9 * (double)t;
            assert_false(lw_plateau_note(&s, (float)(1 / sqrt(1 + speed * at_s)), 30 * at_s, 7 * S + t));
        }
    }
}

static void test_what_stays_settles(void **state) {
    (void)state;
    struct lw_plateau s = {0};
    assert_false(lw_plateau_note(&s, 0.09f, 3, 100 * S));
    assert_false(lw_plateau_note(&s, 0.09f, 50, 105 * S - 1));
    assert_true(lw_plateau_note(&s, 0.09f, 50, 105 * S));
    assert_false(
        lw_plateau_note(&s, 0.05f, 90, 120 * S)); /* it does fall: as long again as the 20 s to here */
    assert_false(lw_plateau_note(&s, 0.046f, 900, 140 * S - 1));
    assert_true(lw_plateau_note(&s, 0.046f, 900, 140 * S));
}

/* Where hardly anything comes, nothing is known of what it would fall to. */
static void test_a_slow_server_is_waited_for(void **state) {
    (void)state;
    struct lw_plateau s = {0};
    assert_false(lw_plateau_note(&s, 0.09f, 1, 100 * S));
    assert_false(lw_plateau_note(&s, 0.09f, 16.5, 110 * S));
    assert_true(lw_plateau_note(&s, 0.09f, 17, 111 * S));
    assert_false(lw_plateau_note(&s, 0.05f, 17, 112 * S));
    assert_false(lw_plateau_note(&s, 0.05f, 17, 142 * S - 1));
    assert_true(lw_plateau_note(&s, 0.05f, 17, 142 * S));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_what_falls_does_not_settle),
        cmocka_unit_test(test_what_stays_settles),
        cmocka_unit_test(test_a_slow_server_is_waited_for),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
