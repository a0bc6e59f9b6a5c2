#include "tests/support/support.h"

#include "common/base/sampling.h"

#include <math.h>
#include <string.h>

#define SEEDS 50u

/* Ends the test unless each of the boxes of 2^a x 2^b over the square holds one of the 2^(a + b) points. */
static void assert_net(float (*point)[2], unsigned bits) {
    for (unsigned a = 0; a <= bits; a++) {
        uint8_t held[256] = {0};
        for (uint32_t i = 0; i < 1u << bits; i++) {
            assert_true(point[i][0] >= 0 && point[i][0] < 1 && point[i][1] >= 0 && point[i][1] < 1);
            const uint32_t x = (uint32_t)(point[i][0] * (float)(1u << a)),
                           y = (uint32_t)(point[i][1] * (float)(1u << (bits - a)));
            assert_int_equal(held[x << (bits - a) | y]++, 0);
        }
    }
}

/* What one texel sees: every run of 2^k samples of its set. */
static void test_samples_of_a_set_are_stratified(void **state) {
    (void)state;
    float point[256][2];
    for (uint32_t seed = 0; seed < SEEDS; seed++)
        for (uint32_t set = 0; set < 16; set++)
            for (unsigned bits = 0; bits <= 8; bits++) {
                const uint32_t first = (seed % 3) << bits;
                for (uint32_t i = 0; i < 1u << bits; i++)
                    lw_sampling_point(lw_random_hash(seed), first + i, set, point[i]);
                assert_net(point, bits);
            }
}

/* What a pattern of 4 x 4 texels sees in one frame. */
static void test_sets_of_a_sample_are_stratified(void **state) {
    (void)state;
    float point[16][2];
    for (uint32_t seed = 0; seed < SEEDS; seed++)
        for (uint32_t sample = 0; sample < 40; sample++) {
            for (uint32_t set = 0; set < 16; set++)
                lw_sampling_point(lw_random_hash(seed), sample, set, point[set]);
            assert_net(point, 4);
        }
}

/* What the texels of a packet see in one frame: within a cell, of which each has its own part. */
static void test_texels_of_a_set_share_a_cell(void **state) {
    (void)state;
    const float cells = (float)(1u << LW_SAMPLING_CELL_BITS);
    for (uint32_t seed = 0; seed < SEEDS; seed++) {
        float point[2], within[16][2];
        lw_sampling_point(lw_random_hash(seed), seed, seed % 16, point);
        for (uint32_t lane = 0; lane < 16; lane++) {
            float own[2];
            lw_sampling_spread(point, lane, own);
            for (uint32_t k = 0; k < 2; k++) {
                if (lane == 0) assert_true(own[k] == point[k]);
                assert_true(floorf(own[k] * cells) == floorf(point[k] * cells));
                within[lane][k] = own[k] * cells - floorf(own[k] * cells);
            }
        }
        assert_net(within, 4);
    }
}

/* What one texel of a packet sees over the frames. */
static void test_samples_of_a_texel_are_stratified(void **state) {
    (void)state;
    float point[256][2];
    for (uint32_t lane = 0; lane < 16; lane++)
        for (unsigned bits = 0; bits <= 8; bits++) {
            for (uint32_t i = 0; i < 1u << bits; i++) {
                float shared[2];
                lw_sampling_point(lw_random_hash(lane), i, lane, shared);
                lw_sampling_spread(shared, lane, point[i]);
            }
            assert_net(point, bits);
        }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_samples_of_a_set_are_stratified),
                                       cmocka_unit_test(test_texels_of_a_set_share_a_cell),
                                       cmocka_unit_test(test_samples_of_a_texel_are_stratified),
                                       cmocka_unit_test(test_sets_of_a_sample_are_stratified)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
