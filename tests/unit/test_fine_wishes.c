/* Tiles of finer levels that relays want: in turns, each once. */
#include "tests/support/support.h"

#include "server/nats/fine_wishes.h"

static void relays_take_turns(void **state) {
    (void)state;
    static const uint64_t greedy[] = {1, 2, 3, 4, 5, 6}, modest[] = {9, 2};
    struct lw_fine_wishes wishes = {0};
    uint64_t name[8];
    lw_support_ok(lw_fine_wishes_add(&wishes, greedy, 6), NULL);
    lw_support_ok(lw_fine_wishes_add(&wishes, NULL, 0), NULL);
    lw_support_ok(lw_fine_wishes_add(&wishes, modest, 2), NULL);
    assert_int_equal(lw_fine_wishes_take(&wishes, name, 4), 4);
    static const uint64_t first[] = {1, 9, 2, 3}; /* the greedy list has no place that the modest one needs */
    assert_memory_equal(name, first, sizeof first);
    assert_int_equal(lw_fine_wishes_take(&wishes, name, 4), 0); /* it is empty */
    lw_support_ok(lw_fine_wishes_add(&wishes, greedy, 6), NULL);
    lw_support_ok(lw_fine_wishes_add(&wishes, greedy, 6), NULL);
    assert_int_equal(lw_fine_wishes_take(&wishes, name, 8), 6);
    assert_memory_equal(name, greedy, sizeof greedy);
    lw_fine_wishes_finish(&wishes);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(relays_take_turns)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
