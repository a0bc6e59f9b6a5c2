#include "tests/support/support.h"

#include "server/serve/deltas.h"

#include <stdlib.h>

#define WHOLE 100u

/* A version of tile 1 with a delta of so many bytes; 0: without one. */
static void add(struct lw_deltas *deltas, uint64_t base, uint64_t version, size_t bytes) {
    struct lw_snapshot_tile tile = {.version = version, .base = base};
    if (bytes) lw_support_ok(lw_blob_create(bytes, &tile.delta), NULL);
    lw_deltas_add(deltas, 1, &tile);
    lw_blob_unref(tile.delta);
}

static uint64_t next(const struct lw_deltas *deltas, uint64_t from) {
    const struct lw_delta *delta = lw_deltas_next(deltas, 1, from, WHOLE);
    if (delta) assert_int_equal(delta->base, from);
    return delta ? delta->version : 0;
}

static void test_one_after_another(void **state) {
    (void)state;
    struct lw_deltas deltas;
    lw_support_ok(lw_deltas_init(&deltas, 2), NULL);
    assert_int_equal(next(&deltas, 0), 0);
    add(&deltas, 0, 3, 0); /* whole: nothing leads there */
    assert_int_equal(next(&deltas, 3), 0);
    add(&deltas, 3, 5, 30);
    add(&deltas, 5, 9, 30);
    assert_int_equal(next(&deltas, 3), 5);
    assert_int_equal(next(&deltas, 5), 9);
    assert_int_equal(next(&deltas, 9), 0); /* it is there */
    assert_int_equal(next(&deltas, 4), 0);
    assert_null(lw_deltas_next(&deltas, 0, 3, WHOLE)); /* of another tile */
    add(&deltas, 9, 10, 39);
    assert_int_equal(next(&deltas, 3), 5); /* 99 bytes */
    add(&deltas, 10, 11, 31);
    assert_int_equal(next(&deltas, 3), 0); /* 130 */
    assert_int_equal(next(&deltas, 5), 0); /* 100: no fewer than whole */
    assert_int_equal(next(&deltas, 9), 10);
    add(&deltas, 11, 12, 200); /* alone it is taken all the same: whoever made it knew why */
    assert_int_equal(next(&deltas, 11), 12);
    assert_int_equal(next(&deltas, 10), 0);
    lw_deltas_finish(&deltas);
}

static void test_what_does_not_lead_on_is_forgotten(void **state) {
    (void)state;
    struct lw_deltas deltas;
    lw_support_ok(lw_deltas_init(&deltas, 2), NULL);
    add(&deltas, 1, 2, 10);
    add(&deltas, 3, 4, 10); /* version 3 was never heard of */
    assert_int_equal(next(&deltas, 1), 0);
    assert_int_equal(next(&deltas, 3), 4);
    add(&deltas, 0, 5, 0);
    assert_int_equal(next(&deltas, 3), 0);
    for (uint64_t version = 6; version <= 6 + LW_DELTAS_KEPT; version++)
        add(&deltas, version - 1, version, 1);
    assert_int_equal(next(&deltas, 5), 0);
    assert_int_equal(next(&deltas, 6), 7);
    lw_deltas_finish(&deltas);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_one_after_another),
        cmocka_unit_test(test_what_does_not_lead_on_is_forgotten),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
