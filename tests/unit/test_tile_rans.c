#include "tests/support/support.h"

#include "common/base/random.h"
#include "common/tile/tile_rans.h"

#include <string.h>

#define COEFFICIENTS (3 * LW_TILE_TEXELS_MAX)
#define REST         64u

static struct lw_tile_rans rans;
static enum lw_tile_rans_isa best;
static int16_t coefficient[COEFFICIENTS], back[COEFFICIENTS], other[COEFFICIENTS];
static uint8_t length[LW_TILE_RANS_BLOCKS], payload[LW_TILE_RANS_BOUND + REST], rest[REST];

static int set_up(void **state) {
    (void)state;
    lw_tile_rans_init(&rans);
    best = rans.isa;
    for (uint32_t i = 0; i < REST; i++) rest[i] = (uint8_t)(1 + i * 3);
    return 0;
}

static const struct {
    uint32_t width, height;
} sizes[] = {{64, 64}, {36, 20}, {1, 1}, {1, 64}, {64, 7}, {9, 8}, {8, 9}, {64, 63}};

static size_t count_coefficients(uint32_t width, uint32_t height) {
    return (size_t)3 * ((width + 7) / 8) * ((height + 7) / 8) * 64;
}

/* How far each coefficient of a tile goes on, of those that are written: 0 outside and for the first of each
 * block. */
static void make_coefficients(uint32_t width, uint32_t height, uint32_t share, uint32_t seed) {
    const uint32_t across = (width + 7) / 8, down = (height + 7) / 8;
    memset(coefficient, 0, sizeof coefficient);
    for (uint32_t p = 0; p < 3; p++)
        for (uint32_t y = 0; y < height; y++)
            for (uint32_t x = 0; x < width; x++) {
                const uint32_t at = ((p * down + y / 8) * across + x / 8) * 64 + y % 8 * 8 + x % 8;
                const uint32_t random = lw_random_hash3(at, share, seed), wide = random >> 8 & 15;
                if (x % 8 + y % 8 == 0 || random % 256 >= share || x / 8 >= across) continue;
                const int32_t size =
                    1 + (int32_t)((random >> 12) % (1u << wide)) % LW_TILE_RANS_COEFFICIENT_MAX;
                coefficient[at] = (int16_t)(random >> 31 ? -size : size);
            }
}

static size_t put(uint32_t width, uint32_t height, size_t rest_size) {
    const size_t size = lw_tile_rans_put(&rans, 3, coefficient, width, height, rest, rest_size, payload);
    assert_true(size <= LW_TILE_RANS_BOUND + rest_size);
    return size;
}

static bool get(enum lw_tile_rans_isa isa, size_t size, uint32_t width, uint32_t height, int16_t *to,
                const uint8_t **out_rest, size_t *out_rest_size) {
    size_t free_size;
    rans.isa = isa;
    return lw_tile_rans_get(&rans, 3, payload, size, width, height, to, length, out_rest, out_rest_size,
                            &free_size);
}

static void expect_coefficients(uint32_t width, uint32_t height, size_t rest_size) {
    const size_t size = put(width, height, rest_size), all = count_coefficients(width, height);
    for (enum lw_tile_rans_isa isa = LW_TILE_RANS_SCALAR; isa <= best; isa++) {
        const uint8_t *rest_back;
        size_t rest_back_size;
        memset(back, 77, sizeof back);
        assert_true(get(isa, size, width, height, back, &rest_back, &rest_back_size));
        assert_memory_equal(back, coefficient, all * sizeof *coefficient);
        for (size_t i = 0; i < rest_back_size; i++)
            assert_int_equal(rest_back[i], i < rest_size ? rest[i] : 0);
        assert_true(rest_back_size >= rest_size);
    }
}

/* With all counts of lanes, and coefficients of all sizes. */
static void test_round_trip(void **state) {
    (void)state;
    const uint32_t shares[] = {0, 1, 2, 5, 12, 30, 100, 256};
    for (uint32_t s = 0; s < sizeof sizes / sizeof *sizes; s++)
        for (uint32_t i = 0; i < sizeof shares / sizeof *shares; i++)
            for (uint32_t seed = 0; seed < 8; seed++) {
                make_coefficients(sizes[s].width, sizes[s].height, shares[i], seed);
                expect_coefficients(sizes[s].width, sizes[s].height, seed * 9);
            }
}

/* The largest coefficient there is; one more is refused. */
static void test_coefficients_have_a_limit(void **state) {
    (void)state;
    const uint8_t *rest_back;
    size_t rest_size, found = 0;
    memset(coefficient, 0, sizeof coefficient);
    coefficient[9] = LW_TILE_RANS_COEFFICIENT_MAX;
    expect_coefficients(8, 8, 8);
    coefficient[9] = -LW_TILE_RANS_COEFFICIENT_MAX;
    expect_coefficients(8, 8, 8);
    const size_t size = put(8, 8, 8);
    const uint32_t word = LW_TILE_RANS_COEFFICIENT_MAX - LW_TILE_RANS_FAR;
    for (size_t i = 0; i + 1 < size; i++)
        if (payload[i] == (word & 255) && payload[i + 1] == word >> 8) {
            payload[i]++;
            found++;
        }
    assert_int_equal(found, 1);
    for (enum lw_tile_rans_isa isa = LW_TILE_RANS_SCALAR; isa <= best; isa++)
        assert_false(get(isa, size, 8, 8, back, &rest_back, &rest_size));
}

/* Cut anywhere before the bytes that belong to others. */
static void test_what_ends_early_is_refused(void **state) {
    (void)state;
    const uint8_t *rest_back;
    size_t rest_size;
    make_coefficients(36, 20, 60, 1);
    const size_t size = put(36, 20, 0);
    for (enum lw_tile_rans_isa isa = LW_TILE_RANS_SCALAR; isa <= best; isa++)
        for (size_t n = 0; n < size; n++) assert_false(get(isa, n, 36, 20, back, &rest_back, &rest_size));
    assert_false(get(best, sizeof rans.bytes, 36, 20, back, &rest_back, &rest_size));
}

/* Any bytes: all decoders give the same verdict and the same coefficients. */
static void test_hostile_bytes_are_the_same_to_all(void **state) {
    (void)state;
    const uint8_t *rest_back;
    size_t rest_size;
    uint32_t good = 0;
    for (uint32_t seed = 0; seed < 3000; seed++) {
        const uint32_t s = seed % (sizeof sizes / sizeof *sizes), width = sizes[s].width,
                       height = sizes[s].height;
        make_coefficients(width, height, seed % 40, seed);
        const size_t size = put(width, height, 40);
        for (uint32_t n = 0; n < seed % 3; n++)
            payload[lw_random_hash2(seed, n) % size] ^= (uint8_t)(1u << seed % 8);
        if (seed % 7 == 6)
            for (size_t i = 4; i < size; i++) payload[i] = (uint8_t)lw_random_hash2(seed, (uint32_t)i);
        const bool is_good = get(LW_TILE_RANS_SCALAR, size, width, height, back, &rest_back, &rest_size);
        const size_t first_rest = is_good ? rest_size : 0;
        for (enum lw_tile_rans_isa isa = LW_TILE_RANS_AVX2; isa <= best; isa++) {
            assert_int_equal(get(isa, size, width, height, other, &rest_back, &rest_size), is_good);
            if (!is_good) continue;
            assert_int_equal(rest_size, first_rest);
            assert_memory_equal(other, back, count_coefficients(width, height) * sizeof *back);
        }
        good += is_good;
    }
    assert_true(good > 800 && good < 2500);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_round_trip),
        cmocka_unit_test(test_coefficients_have_a_limit),
        cmocka_unit_test(test_what_ends_early_is_refused),
        cmocka_unit_test(test_hostile_bytes_are_the_same_to_all),
    };
    return cmocka_run_group_tests(tests, set_up, NULL);
}
