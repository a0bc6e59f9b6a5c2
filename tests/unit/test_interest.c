#include "tests/support/support.h"

#include "client/lib/interest.h"

#define SECOND 1000000000ull
#define MOST   16u

static void set(struct lw_interest *interest, uint32_t first, uint32_t count) {
    lw_tile_id tile[2 * MOST];
    for (uint32_t i = 0; i < count; i++) tile[i].v = first + count - 1 - i; /* in any order */
    lw_support_ok(lw_interest_set(interest, tile, count, MOST), NULL);
}

static void tell(struct lw_interest *interest, uint64_t now_ns) {
    lw_support_ok(lw_interest_tell(interest, now_ns), NULL);
    assert_false(lw_interest_is_due(interest, now_ns + 10 * SECOND));
}

static void test_begins_with_everything(void **state) {
    (void)state;
    struct lw_interest interest;
    lw_interest_init(&interest);
    assert_false(lw_interest_is_due(&interest, SECOND));
    lw_interest_set_everything(&interest);
    assert_false(lw_interest_is_due(&interest, SECOND));
    set(&interest, 0, 0);
    assert_true(lw_interest_is_due(&interest, SECOND));
    tell(&interest, SECOND);
    lw_interest_set_everything(&interest);
    assert_true(lw_interest_is_due(&interest, 2 * SECOND));
    lw_interest_finish(&interest);
}

static void test_lists_are_sorted_and_short(void **state) {
    (void)state;
    struct lw_interest interest;
    lw_interest_init(&interest);
    const lw_tile_id tile[] = {{5}, {2}, {5}, {9}, {2}};
    lw_support_ok(lw_interest_set(&interest, tile, 5, MOST), NULL);
    assert_int_equal(interest.now.count, 3);
    assert_true(interest.now.tile[0].v == 2 && interest.now.tile[1].v == 5 && interest.now.tile[2].v == 9);
    set(&interest, 0, MOST);
    assert_false(interest.now.everything);
    set(&interest, 0, MOST + 1);
    assert_true(interest.now.everything);
    assert_int_equal(interest.now.count, 0);
    lw_interest_finish(&interest);
}

/* New tiles at the next tenth of a second; fewer tiles when they are many or time has passed. */
static void test_tells_what_matters(void **state) {
    (void)state;
    struct lw_interest interest;
    const uint64_t start = 50 * SECOND;
    lw_interest_init(&interest);
    set(&interest, 0, 16);
    tell(&interest, start);
    set(&interest, 1, 16); /* one new, one gone */
    assert_false(lw_interest_is_due(&interest, start + LW_INTEREST_TELL_NS - 1));
    assert_true(lw_interest_is_due(&interest, start + LW_INTEREST_TELL_NS));
    set(&interest, 0, 15); /* one in sixteen gone: under one in eight */
    assert_false(lw_interest_is_due(&interest, start + LW_INTEREST_SHED_NS - 1));
    assert_true(lw_interest_is_due(&interest, start + LW_INTEREST_SHED_NS));
    set(&interest, 0, 14); /* one in eight */
    assert_false(lw_interest_is_due(&interest, start + LW_INTEREST_TELL_NS - 1));
    assert_true(lw_interest_is_due(&interest, start + LW_INTEREST_TELL_NS));
    set(&interest, 0, 16); /* changed its mind in time */
    assert_false(lw_interest_is_due(&interest, start + LW_INTEREST_SHED_NS));
    set(&interest, 0, 0);
    assert_true(lw_interest_is_due(&interest, start + LW_INTEREST_TELL_NS));
    lw_interest_finish(&interest);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_begins_with_everything),
        cmocka_unit_test(test_lists_are_sorted_and_short),
        cmocka_unit_test(test_tells_what_matters),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
