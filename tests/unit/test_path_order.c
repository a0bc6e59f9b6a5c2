#include "tests/support/support.h"

#include "client/view/path_order.h"
#include "common/random.h"

#include <string.h>

static struct lw_path_order_item item[LW_PATH_ORDER_MAX];
static uint16_t order[LW_PATH_ORDER_MAX];

static const struct lw_vec3 axis[6] = {{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}};

static float random_unit(uint32_t i, uint32_t dimension) {
    return lw_random_unit(lw_random_hash2(i, dimension));
}

static void fill(unsigned count, float extent) {
    for (unsigned i = 0; i < count; i++) {
        item[i].position =
            lw_vec3(extent * random_unit(i, 0), extent * random_unit(i, 1), extent * random_unit(i, 2));
        item[i].normal = axis[lw_random_hash2(i, 3) % 6];
        order[i] = (uint16_t)(5000 + i);
    }
}

static void expect_permutation(unsigned count) {
    static uint8_t seen[LW_PATH_ORDER_MAX];
    memset(seen, 0, sizeof seen);
    for (unsigned i = 0; i < count; i++) {
        assert_in_range(order[i], 5000, 5000 + count - 1);
        assert_int_equal(seen[order[i] - 5000]++, 0);
    }
}

static void test_every_number_stays(void **state) {
    (void)state;
    const unsigned counts[] = {0, 1, 2, 17, LW_PATH_ORDER_MAX};
    const float extents[] = {0, 1e-30f, 1, 1e9f};
    for (int c = 0; c < 5; c++)
        for (int e = 0; e < 4; e++) {
            fill(counts[c], extents[e]);
            lw_path_order(item, counts[c], order);
            expect_permutation(counts[c]);
        }
}

static void test_like_normals_stand_together(void **state) {
    (void)state;
    fill(LW_PATH_ORDER_MAX, 10);
    lw_path_order(item, LW_PATH_ORDER_MAX, order);
    unsigned changes = 0;
    for (unsigned i = 1; i < LW_PATH_ORDER_MAX; i++) {
        struct lw_vec3 a = item[order[i - 1] - 5000].normal, b = item[order[i] - 5000].normal;
        changes += lw_vec3_dot(a, b) < 1;
    }
    assert_int_equal(changes, 5);
}

/* A tilt does not tear a wall apart: each axis but -Z, which is the rim of the map, is in the middle of a class. */
static void test_nearly_like_normals_too(void **state) {
    (void)state;
    for (int a = 0; a < 5; a++) {
        const int other = (a + 2) % 5;
        fill(64, 0);
        for (unsigned i = 0; i < 64; i++) {
            struct lw_vec3 tilt =
                lw_vec3(random_unit(i, 7) - 0.5f, random_unit(i, 8) - 0.5f, random_unit(i, 9) - 0.5f);
            item[i].normal = lw_vec3_normalize(lw_vec3_mad(axis[i % 2 ? a : other], tilt, 0.1f));
        }
        lw_path_order(item, 64, order);
        for (unsigned i = 1; i < 64; i++)
            if (i != 32) assert_int_equal(order[i] % 2, order[i - 1] % 2);
    }
}

static void test_neighbours_stand_together(void **state) {
    (void)state;
    fill(LW_PATH_ORDER_MAX, 10);
    for (unsigned i = 0; i < LW_PATH_ORDER_MAX; i++) item[i].normal = axis[2];
    float before = 0, after = 0;
    for (unsigned i = 1; i < LW_PATH_ORDER_MAX; i++)
        before += lw_vec3_length(lw_vec3_sub(item[i].position, item[i - 1].position));
    lw_path_order(item, LW_PATH_ORDER_MAX, order);
    for (unsigned i = 1; i < LW_PATH_ORDER_MAX; i++)
        after +=
            lw_vec3_length(lw_vec3_sub(item[order[i] - 5000].position, item[order[i - 1] - 5000].position));
    /* 2 points in a box of 1.25 m: some 0.83 m within it, and a step to the next; 6.6 m at random */
    assert_true(after < 0.3f * before);
}

static void test_equal_items_keep_their_order(void **state) {
    (void)state;
    fill(100, 0);
    for (unsigned i = 0; i < 100; i++) item[i].normal = axis[4];
    lw_path_order(item, 100, order);
    for (unsigned i = 0; i < 100; i++) assert_int_equal(order[i], 5000 + i);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_every_number_stays),
        cmocka_unit_test(test_like_normals_stand_together),
        cmocka_unit_test(test_nearly_like_normals_too),
        cmocka_unit_test(test_neighbours_stand_together),
        cmocka_unit_test(test_equal_items_keep_their_order),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
