/* Disjoint sets: the same sets and roots whatever the order of joins. */
#include "tests/support/support.h"

#include "common/base/random.h"
#include "common/base/union_find.h"

#define COUNT 64u
#define JOINS 40u

static void roots_do_not_hang_on_the_order(void **state) {
    (void)state;
    uint32_t parent[2][COUNT], smallest[COUNT];
    for (uint32_t i = 0; i < COUNT; i++) parent[0][i] = parent[1][i] = smallest[i] = i;
    for (uint32_t j = 0; j < JOINS; j++) {
        const uint32_t back = JOINS - 1 - j;
        lw_union_find_join(parent[0], lw_random_hash2(j, 1) % COUNT, lw_random_hash2(j, 2) % COUNT);
        lw_union_find_join(parent[1], lw_random_hash2(back, 2) % COUNT, lw_random_hash2(back, 1) % COUNT);
    }
    /* the plain way: pass the smaller number on until nothing changes */
    for (uint32_t round = 0; round < COUNT; round++)
        for (uint32_t j = 0; j < JOINS; j++) {
            uint32_t *a = &smallest[lw_random_hash2(j, 1) % COUNT],
                     *b = &smallest[lw_random_hash2(j, 2) % COUNT];
            *a = *b = *a < *b ? *a : *b;
        }
    for (uint32_t i = 0; i < COUNT; i++)
        for (int order = 0; order < 2; order++)
            assert_int_equal(lw_union_find_root(parent[order], i), smallest[i]);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(roots_do_not_hang_on_the_order)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
