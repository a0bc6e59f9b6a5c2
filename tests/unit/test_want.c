#include "tests/support/support.h"

#include "client/lib/want.h"

#define SECOND 1000000000ull
#define MOST   16u

static void set(struct lw_want *want, uint32_t first, uint32_t count) {
    lw_tile_id tile[2 * MOST];
    for (uint32_t i = 0; i < count; i++) tile[i].v = first + count - 1 - i; /* in any order */
    lw_support_ok(lw_want_set(want, tile, count, MOST), NULL);
}

static void tell(struct lw_want *want, uint64_t now_ns) {
    lw_support_ok(lw_want_tell(want, now_ns), NULL);
    assert_false(lw_want_is_due(want, now_ns + 10 * SECOND));
}

static void test_begins_with_everything(void **state) {
    (void)state;
    struct lw_want want;
    lw_want_init(&want);
    assert_false(lw_want_is_due(&want, SECOND));
    lw_want_set_everything(&want);
    assert_false(lw_want_is_due(&want, SECOND));
    set(&want, 0, 0);
    assert_true(lw_want_is_due(&want, SECOND));
    tell(&want, SECOND);
    lw_want_set_everything(&want);
    assert_true(lw_want_is_due(&want, 2 * SECOND));
    lw_want_finish(&want);
}

static void test_lists_are_sorted_and_short(void **state) {
    (void)state;
    struct lw_want want;
    lw_want_init(&want);
    const lw_tile_id tile[] = {{5}, {2}, {5}, {9}, {2}};
    lw_support_ok(lw_want_set(&want, tile, 5, MOST), NULL);
    assert_int_equal(want.now.count, 3);
    assert_true(want.now.tile[0].v == 2 && want.now.tile[1].v == 5 && want.now.tile[2].v == 9);
    set(&want, 0, MOST);
    assert_false(want.now.everything);
    set(&want, 0, MOST + 1);
    assert_true(want.now.everything);
    assert_int_equal(want.now.count, 0);
    lw_want_finish(&want);
}

/* New tiles at the next tenth of a second; fewer tiles when they are many or time has passed. */
static void test_tells_what_matters(void **state) {
    (void)state;
    struct lw_want want;
    const uint64_t start = 50 * SECOND;
    lw_want_init(&want);
    set(&want, 0, 16);
    tell(&want, start);
    set(&want, 1, 16); /* one new, one gone */
    assert_false(lw_want_is_due(&want, start + LW_WANT_TELL_NS - 1));
    assert_true(lw_want_is_due(&want, start + LW_WANT_TELL_NS));
    set(&want, 0, 15); /* one in sixteen gone: under one in eight */
    assert_false(lw_want_is_due(&want, start + LW_WANT_SHED_NS - 1));
    assert_true(lw_want_is_due(&want, start + LW_WANT_SHED_NS));
    set(&want, 0, 14); /* one in eight */
    assert_false(lw_want_is_due(&want, start + LW_WANT_TELL_NS - 1));
    assert_true(lw_want_is_due(&want, start + LW_WANT_TELL_NS));
    set(&want, 0, 16); /* changed its mind in time */
    assert_false(lw_want_is_due(&want, start + LW_WANT_SHED_NS));
    set(&want, 0, 0);
    assert_true(lw_want_is_due(&want, start + LW_WANT_TELL_NS));
    lw_want_finish(&want);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_begins_with_everything),
        cmocka_unit_test(test_lists_are_sorted_and_short),
        cmocka_unit_test(test_tells_what_matters),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
