#include "tests/support/support.h"

#include "common/base/random.h"
#include "server/solve/surface/packed_normal.h"

/* Rounding moves both coordinates by half a step, 1 / STEPS, and z by as much as both together: on the
 * octahedron by sqrt(6) / STEPS. The middles of its faces lie at 1 / sqrt(3) from the centre, so that a
 * direction turns by sqrt(3) times as much. */
static const float most = 1.7320508f * 2.4494897f / LW_PACKED_NORMAL_STEPS;

static float turned(struct lw_vec3 normal) {
    return lw_vec3_length(lw_vec3_sub(lw_packed_normal_unpack(lw_packed_normal(normal)), normal));
}

static void rounding_turns_a_normal_by_less_than_a_bound(void **state) {
    (void)state;
    float largest = 0;
    for (uint32_t i = 0; i < 100000; i++) {
        const float z = 2 * lw_random_unit(lw_random_hash2(i, 1)) - 1,
                    turn = 2 * LW_PI * lw_random_unit(lw_random_hash2(i, 2)), r = sqrtf(1 - z * z);
        const struct lw_vec3 normal = lw_vec3_normalize(lw_vec3(r * cosf(turn), r * sinf(turn), z));
        const struct lw_vec3 read = lw_packed_normal_unpack(lw_packed_normal(normal));
        assert_true(fabsf(lw_vec3_length(read) - 1) < 1e-6f);
        largest = fmaxf(largest, turned(normal));
    }
    assert_true(largest < most + 1e-6f);
    assert_true(largest > 1 / LW_PACKED_NORMAL_STEPS); /* it does round */
    assert_true(most + 1e-6f < 1e-4f);
}

/* Walls face them, and lie flat only if they look straight ahead. */
static void axes_are_exact(void **state) {
    (void)state;
    for (int axis = 0; axis < 3; axis++)
        for (float sign = -1; sign <= 1; sign += 2)
            assert_true(turned(lw_vec3(sign * (float)(axis == 0), sign * (float)(axis == 1),
                                       sign * (float)(axis == 2))) == 0);
}

static void a_packed_normal_stays(void **state) {
    (void)state;
    for (uint32_t i = 0; i < 10000; i++) {
        const uint32_t x = lw_random_hash2(i, 3) % 65535, y = lw_random_hash2(i, 4) % 65535;
        const struct lw_vec3 normal = lw_packed_normal_unpack(x | y << 16);
        assert_true(turned(normal) < 1e-6f);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(rounding_turns_a_normal_by_less_than_a_bound),
                                       cmocka_unit_test(axes_are_exact),
                                       cmocka_unit_test(a_packed_normal_stays)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
