#include "tests/support/support.h"

#include "server/solve/surface/packed_albedo.h"

static float read(float channel) {
    return lw_packed_albedo_unpack(lw_packed_albedo(lw_vec3(0, channel, 0))).y;
}

/* Half a step, and the rounding of floats. */
static void rounding_moves_a_channel_by_half_a_step(void **state) {
    (void)state;
    float largest = 0;
    for (uint32_t i = 0; i <= 1000000; i++) {
        const float channel = (float)i * 1e-6f;
        largest = fmaxf(largest, fabsf(read(channel) - channel));
    }
    assert_true(largest < 0.5f / LW_PACKED_ALBEDO_ONE + 1e-7f);
    assert_true(largest > 0.4f / LW_PACKED_ALBEDO_ONE);
}

/* A furnace's walls send back all light, and no texel more. */
static void ends_are_exact(void **state) {
    (void)state;
    assert_true(read(0) == 0 && read(1) == 1);
    assert_true(read(1.001f) == 1 && read(-0.001f) == 0);
    const struct lw_vec3 three = lw_packed_albedo_unpack(lw_packed_albedo(lw_vec3(0, 1, 0.5f)));
    assert_true(three.x == 0 && three.y == 1 && fabsf(three.z - 0.5f) < 1e-5f);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(rounding_moves_a_channel_by_half_a_step),
                                       cmocka_unit_test(ends_are_exact)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
