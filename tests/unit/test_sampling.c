#include "tests/support/support.h"

#include "common/sampling.h"

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

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_samples_of_a_set_are_stratified),
                                       cmocka_unit_test(test_sets_of_a_sample_are_stratified)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
