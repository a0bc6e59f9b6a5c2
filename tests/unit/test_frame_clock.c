#include "tests/support/support.h"

#include "client/load/frame_clock.h"

static struct lw_frame_clock_entry heard(uint64_t frame) {
    return (struct lw_frame_clock_entry){.frame = frame, .heard_ns = 1000 * frame};
}

static void test_finds_the_first_at_or_after(void **state) {
    (void)state;
    struct lw_frame_clock clock;
    lw_support_ok(lw_frame_clock_init(&clock), NULL);
    assert_int_equal(lw_frame_clock_newest(&clock), 0);
    assert_null(lw_frame_clock_find(&clock, 1));
    assert_null(lw_frame_clock_at(&clock, 0));
    assert_true(lw_frame_clock_hear(&clock, heard(3)));
    assert_true(lw_frame_clock_hear(&clock, heard(7)));
    assert_false(lw_frame_clock_hear(&clock, (struct lw_frame_clock_entry){.frame = 7, .heard_ns = 1}));
    assert_false(lw_frame_clock_hear(&clock, (struct lw_frame_clock_entry){.frame = 4, .heard_ns = 1}));
    assert_int_equal(lw_frame_clock_newest(&clock), 7);
    const uint64_t expected[][2] = {{1, 3}, {3, 3}, {4, 7}, {7, 7}};
    for (unsigned i = 0; i < 4; i++)
        assert_int_equal(lw_frame_clock_find(&clock, expected[i][0])->heard_ns, 1000 * expected[i][1]);
    assert_null(lw_frame_clock_find(&clock, 8));
    assert_int_equal(lw_frame_clock_at(&clock, 1)->frame, 7);
    lw_frame_clock_finish(&clock);
}

static void test_forgets_the_oldest(void **state) {
    (void)state;
    struct lw_frame_clock clock;
    lw_support_ok(lw_frame_clock_init(&clock), NULL);
    for (uint64_t f = 1; f <= LW_FRAME_CLOCK_FRAMES; f++) assert_true(lw_frame_clock_hear(&clock, heard(f)));
    assert_int_equal(lw_frame_clock_find(&clock, 1)->frame, 1);
    assert_true(lw_frame_clock_hear(&clock, heard(LW_FRAME_CLOCK_FRAMES + 1)));
    assert_int_equal(lw_frame_clock_find(&clock, 1)->frame, 2);
    assert_null(lw_frame_clock_at(&clock, 0));
    assert_int_equal(lw_frame_clock_at(&clock, 1)->frame, 2);
    for (uint64_t f = 2; f <= LW_FRAME_CLOCK_FRAMES + 1; f++)
        assert_int_equal(lw_frame_clock_find(&clock, f)->frame, f);
    lw_frame_clock_finish(&clock);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_finds_the_first_at_or_after),
        cmocka_unit_test(test_forgets_the_oldest),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
