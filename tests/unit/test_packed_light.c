#include "tests/support/support.h"

#include "common/base/random.h"
#include "server/solve/state/packed_light.h"

/* 21 bits of a float are 12 of its fraction: half a step is 2^-13 of the power of two below it. */
#define ROUNDING 0x1p-13f

static void rounding_moves_a_channel_by_less_than_a_bound(void **state) {
    (void)state;
    float largest = 0;
    double sum = 0;
    for (uint32_t i = 0; i < 100000; i++) {
        float channel[3];
        for (uint32_t c = 0; c < 3; c++)
            channel[c] = ldexpf(1 + lw_random_unit(lw_random_hash2(i, c)),
                                (int)(lw_random_hash2(i, 9 + c) % 80) - 40) *
                         (lw_random_hash2(i, 17 + c) & 1 ? 1.0f : -1.0f);
        const struct lw_vec3 light = lw_vec3(channel[0], channel[1], channel[2]),
                             read = lw_packed_light_rounded(light);
        const float off[3] = {(read.x - light.x) / light.x, (read.y - light.y) / light.y,
                              (read.z - light.z) / light.z};
        for (int c = 0; c < 3; c++) {
            largest = fmaxf(largest, fabsf(off[c]));
            sum += (double)off[c];
        }
    }
    assert_true(largest <= ROUNDING);
    assert_true(largest > 0.9f * ROUNDING);
    /* As often up as down: each is uniform within the bound, or less, so that the mean's deviation is at most
     * the bound / sqrt(3 n). Five of them. */
    assert_true(fabs(sum / 300000) < 5 * (double)ROUNDING / sqrt(3.0 * 300000));
}

/* Rounding twice is rounding once: verification finds no change where there is none. */
static void rounded_light_stays(void **state) {
    (void)state;
    for (uint32_t i = 0; i < 10000; i++) {
        const struct lw_vec3 light = lw_packed_light_rounded(
            lw_vec3(lw_random_unit(lw_random_hash2(i, 1)), -1e6f * lw_random_unit(lw_random_hash2(i, 2)),
                    1e-30f * lw_random_unit(lw_random_hash2(i, 3))));
        const struct lw_vec3 again = lw_packed_light_rounded(light);
        assert_memory_equal(&light, &again, sizeof light);
    }
    const struct lw_vec3 none = lw_packed_light_unpack(0);
    assert_true(none.x == 0 && none.y == 0 && none.z == 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(rounding_moves_a_channel_by_less_than_a_bound),
                                       cmocka_unit_test(rounded_light_stays)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
