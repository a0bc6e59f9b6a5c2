#include "tests/support/support.h"

#include "client/view/compose/attention.h"

#include <stdlib.h>
#include <string.h>

#define SECOND 1000000000ull

static void mark(uint8_t *tiles, uint32_t first, uint32_t count) {
    for (uint32_t t = first; t < first + count; t++) tiles[t] = 1;
}

static void expect(const struct lw_attention *a, uint32_t first, uint32_t count) {
    assert_int_equal(a->list_count, count);
    for (uint32_t i = 0; i < count; i++) assert_int_equal(a->list[i].v, first + i);
}

static void test_keeps_what_was_seen(void **state) {
    (void)state;
    struct lw_attention a;
    uint8_t needed[10] = {0}, around[10] = {0};
    lw_support_ok(lw_attention_init(&a, 10), NULL);
    lw_attention_list(&a, needed, around, SECOND);
    expect(&a, 0, 0);
    needed[2] = around[2] = around[3] = 1;
    lw_attention_list(&a, needed, around, 2 * SECOND);
    expect(&a, 2, 2);
    memset(needed, 0, sizeof needed);
    memset(around, 0, sizeof around);
    needed[4] = 1; /* 2 was in the picture and is kept; 3 was beside it and is not */
    lw_attention_list(&a, needed, around, 2 * SECOND + LW_ATTENTION_KEEP_NS);
    assert_int_equal(a.list_count, 2);
    assert_true(a.list[0].v == 2 && a.list[1].v == 4);
    lw_attention_list(&a, needed, around, 2 * SECOND + LW_ATTENTION_KEEP_NS + 1);
    expect(&a, 4, 1);
    lw_attention_finish(&a);
}

static void test_leaves_out_what_matters_least(void **state) {
    (void)state;
    struct lw_attention a;
    const uint32_t most = LW_CLIENT_INTEREST_MAX, tiles = 2 * LW_CLIENT_INTEREST_MAX;
    uint8_t *needed = calloc(tiles, 1), *around = calloc(tiles, 1);
    assert_true(needed && around);
    lw_support_ok(lw_attention_init(&a, tiles), NULL);
    mark(needed, 0, 10);
    mark(around, 0, most - 10);
    lw_attention_list(&a, needed, around, SECOND);
    expect(&a, 0, most - 10);
    memset(needed, 0, 10);
    mark(needed, most - 10, 10); /* with those around, all that fit; the ten seen before are around as well */
    lw_attention_list(&a, needed, around, 2 * SECOND);
    expect(&a, 0, most);
    memset(around, 0, 10);
    mark(around, most, 10); /* the ten seen before do not fit any more */
    lw_attention_list(&a, needed, around, 2 * SECOND + 1);
    expect(&a, 10, most);
    mark(around, most + 10, 1); /* nor do those around */
    lw_attention_list(&a, needed, around, 2 * SECOND + 2);
    expect(&a, most - 10, 10);
    mark(needed, 0, most + 1); /* nor does the picture */
    lw_attention_list(&a, needed, around, 2 * SECOND + 3);
    expect(&a, 0, most + 1);
    lw_attention_finish(&a);
    free(around);
    free(needed);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_keeps_what_was_seen),
        cmocka_unit_test(test_leaves_out_what_matters_least),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
