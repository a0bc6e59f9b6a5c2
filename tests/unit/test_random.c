#include "tests/support/support.h"

#include "common/base/random.h"

#include <stdbool.h>
#include <string.h>

static void hashes_never_change(void **state) {
    (void)state;
    /* worked out apart, in exact integers: pictures of old versions must stay comparable */
    assert_int_equal(lw_random_hash(0), 129708002u);
    assert_int_equal(lw_random_hash(1), 2831084092u);
    assert_int_equal(lw_random_hash(0xffffffffu), 3861530882u);
    assert_int_equal(lw_random_hash4(1, 2, 3, 4), 2053504716u);
}

static void hashes_depend_on_every_argument_and_its_place(void **state) {
    (void)state;
    assert_int_not_equal(lw_random_hash2(1, 2), lw_random_hash2(2, 1));
    assert_int_not_equal(lw_random_hash3(1, 2, 3), lw_random_hash3(1, 3, 2));
    uint32_t base = lw_random_hash4(5, 6, 7, 8);
    assert_int_not_equal(base, lw_random_hash4(4, 6, 7, 8));
    assert_int_not_equal(base, lw_random_hash4(5, 7, 7, 8));
    assert_int_not_equal(base, lw_random_hash4(5, 6, 6, 8));
    assert_int_not_equal(base, lw_random_hash4(5, 6, 7, 9));
    /* one bit in flips about half of the bits out: 32 * 4096 flips, each a coin; 5 sigma are 0.7 % */
    unsigned long flipped = 0;
    for (uint32_t i = 0; i < 4096; i++)
        for (int bit = 0; bit < 32; bit++)
            flipped += (unsigned)__builtin_popcount(lw_random_hash(i) ^ lw_random_hash(i ^ (1u << bit)));
    double share = (double)flipped / (4096.0 * 32 * 32);
    assert_true(share > 0.49 && share < 0.51);
}

static void units_are_below_one(void **state) {
    (void)state;
    assert_true(lw_random_unit(0) == 0.0f);
    assert_true(lw_random_unit(0xffffffffu) < 1.0f);
    assert_true(lw_random_unit(0xffffffffu) > 0.9999999f);
    assert_true(lw_random_unit(0x80000000u) == 0.5f);
    assert_true(lw_random_unit(0xff) == 0.0f); /* cut, not rounded */
}

static void reversal_reverses(void **state) {
    (void)state;
    for (int bit = 0; bit < 32; bit++) assert_int_equal(lw_random_reverse_bits(1u << bit), 1u << (31 - bit));
    for (uint32_t i = 0; i < 1000; i++) {
        uint32_t x = lw_random_hash(i);
        assert_int_equal(lw_random_reverse_bits(lw_random_reverse_bits(x)), x);
    }
}

/* Owen: values that share their first n bits still do, and the others still do not. */
static void owen_scrambling_keeps_intervals_together(void **state) {
    (void)state;
    for (uint32_t seed = 0; seed < 20; seed++)
        for (uint32_t i = 0; i < 200; i++) {
            uint32_t x = lw_random_hash(i);
            for (int bit = 0; bit < 32; bit++) {
                uint32_t y = x ^ (1u << bit),
                         change = lw_random_owen(x, seed * 77777u) ^ lw_random_owen(y, seed * 77777u);
                /* the highest bit that differs is the same one: all above agree */
                assert_true(change != 0);
                assert_int_equal(31 - __builtin_clz(change), bit);
            }
        }
}

/* Are the 2^k points in all boxes of 2^-a x 2^-(k-a), one each? */
static bool is_net(uint32_t first, unsigned k, uint32_t seed) {
    for (unsigned a = 0; a <= k; a++) {
        unsigned char seen[1 << 10] = {0};
        for (uint32_t i = 0; i < 1u << k; i++) {
            float p[2];
            lw_random_sobol2(first + i, seed, p);
            if (!(p[0] >= 0 && p[0] < 1 && p[1] >= 0 && p[1] < 1)) return false;
            unsigned column = (unsigned)(p[0] * (float)(1u << a)),
                     row = (unsigned)(p[1] * (float)(1u << (k - a)));
            if (seen[row << a | column]++) return false;
        }
    }
    return true;
}

static void every_aligned_run_is_stratified(void **state) {
    (void)state;
    static const uint32_t seeds[] = {0, 1, 2, 0x12345678u, 0xffffffffu};
    for (size_t s = 0; s < sizeof seeds / sizeof *seeds; s++)
        for (unsigned k = 0; k <= 10; k++) {
            static const uint32_t runs[] = {0, 1, 2, 3, 7, 100, 4095};
            for (size_t r = 0; r < sizeof runs / sizeof *runs; r++)
                if (!is_net(runs[r] << k, k, seeds[s]))
                    fail_msg("seed %x, run %u of 2^%u", seeds[s], runs[r], k);
        }
    /* the check can say no: a run that is not aligned is no net */
    assert_false(is_net(5, 4, 1) && is_net(3, 4, 1) && is_net(7, 4, 1));
}

static void seeds_give_different_points(void **state) {
    (void)state;
    unsigned equal = 0;
    for (uint32_t i = 0; i < 256; i++) {
        float a[2], b[2], again[2];
        lw_random_sobol2(i, 1, a);
        lw_random_sobol2(i, 2, b);
        lw_random_sobol2(i, 1, again);
        equal += a[0] == b[0] || a[1] == b[1];
        assert_memory_equal(a, again, sizeof a);
    }
    assert_true(equal < 3);
}

/* Over many seeds the same point is uniform: the mean of 10,000 is 1/2 within 5 sigma = 5 / sqrt(12 n). */
static void each_point_is_uniform_over_seeds(void **state) {
    (void)state;
    for (uint32_t index = 0; index < 5; index++) {
        double sum[2] = {0};
        for (uint32_t seed = 0; seed < 10000; seed++) {
            float p[2];
            lw_random_sobol2(index, seed, p);
            sum[0] += (double)p[0];
            sum[1] += (double)p[1];
        }
        for (int d = 0; d < 2; d++) {
            double mean = sum[d] / 10000;
            if (mean < 0.5 - 0.0145 || mean > 0.5 + 0.0145)
                fail_msg("point %u, dimension %d: %g", index, d, mean);
        }
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(hashes_never_change),
        cmocka_unit_test(hashes_depend_on_every_argument_and_its_place),
        cmocka_unit_test(units_are_below_one),
        cmocka_unit_test(reversal_reverses),
        cmocka_unit_test(owen_scrambling_keeps_intervals_together),
        cmocka_unit_test(every_aligned_run_is_stratified),
        cmocka_unit_test(seeds_give_different_points),
        cmocka_unit_test(each_point_is_uniform_over_seeds),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
