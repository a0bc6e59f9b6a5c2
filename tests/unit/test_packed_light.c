#include "tests/support/support.h"

#include "common/base/random.h"
#include "server/solve/state/packed_light.h"

#include <math.h>

/* Light of any size between 2^-40 and 2^40; of either sign, if it has one. */
static float draw(uint32_t i, uint32_t c, enum lw_packed_light_dropped dropped) {
    const float light =
        ldexpf(1 + lw_random_unit(lw_random_hash2(i, c)), (int)(lw_random_hash2(i, 9 + c) % 80) - 40);
    return dropped == LW_PACKED_LIGHT_SIGNED && lw_random_hash2(i, 17 + c) & 1 ? -light : light;
}

/* bound: half a step of the bits of the fraction that are left, as a share of the power of two below. */
static void expect_rounding(enum lw_packed_light_dropped dropped, float bound) {
    float largest = 0;
    double sum = 0;
    for (uint32_t i = 0; i < 100000; i++) {
        const struct lw_vec3 light = lw_vec3(draw(i, 0, dropped), draw(i, 1, dropped), draw(i, 2, dropped)),
                             read = lw_packed_light_rounded(light, dropped);
        for (int c = 0; c < 3; c++) {
            const float off = (&read.x)[c] / (&light.x)[c] - 1;
            largest = fmaxf(largest, fabsf(off));
            sum += (double)off;
        }
    }
    assert_true(largest <= bound);
    assert_true(largest > 0.9f * bound);
    /* Rounding goes up as often as down. Each error is uniform within the bound, or less, so that the mean's
     * deviation is at most the bound / sqrt(3 n). Five of them. */
    assert_true(fabs(sum / 300000) < 5 * (double)bound / sqrt(3.0 * 300000));
}

static void rounding_moves_a_channel_by_less_than_a_bound(void **state) {
    (void)state;
    expect_rounding(LW_PACKED_LIGHT_POSITIVE, 0x1p-14f);
    expect_rounding(LW_PACKED_LIGHT_SIGNED, 0x1p-13f);
}

/* Rounding twice is rounding once: verification finds no change where there is none. */
static void rounded_light_stays(void **state) {
    (void)state;
    for (int dropped = LW_PACKED_LIGHT_POSITIVE; dropped <= LW_PACKED_LIGHT_SIGNED; dropped++) {
        for (uint32_t i = 0; i < 10000; i++) {
            const struct lw_vec3 light = lw_packed_light_rounded(
                lw_vec3(draw(i, 0, dropped), draw(i, 1, dropped), 1e-30f * draw(i, 2, dropped)), dropped);
            const struct lw_vec3 again = lw_packed_light_rounded(light, dropped);
            assert_memory_equal(&light, &again, sizeof light);
        }
        const struct lw_vec3 none = lw_packed_light_unpack(0, dropped);
        assert_true(none.x == 0 && none.y == 0 && none.z == 0);
    }
    const struct lw_vec3 less = lw_packed_light_rounded(lw_vec3(-1, 2, -3), LW_PACKED_LIGHT_POSITIVE);
    assert_true(less.x == 0 && less.y == 2 && less.z == 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(rounding_moves_a_channel_by_less_than_a_bound),
                                       cmocka_unit_test(rounded_light_stays)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
