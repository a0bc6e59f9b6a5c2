#include "tests/support/support.h"

#include "server/solve/state/cells.h"
#include "server/solve/transport/ray_hit.h"

#include <math.h>

static void test_grid_covers_its_box(void **state) {
    (void)state;
    struct lw_cells cells;
    lw_cells_init(&cells, lw_vec3(-4, 0, 2), lw_vec3(4, 4, 4), 0);
    assert_int_equal(cells.count[0], 4);
    assert_int_equal(cells.count[1], 2);
    assert_int_equal(cells.count[2], 1);
    for (uint32_t c = 0; c < lw_cells_total(&cells); c++)
        assert_int_equal(lw_cells_at(&cells, lw_cells_centre(&cells, c)), c);
    assert_int_equal(lw_cells_at(&cells, lw_vec3(-100, -100, -100)), 0);
    assert_int_equal(lw_cells_at(&cells, lw_vec3(100, 100, 100)), lw_cells_total(&cells) - 1);
    assert_true(lw_cells_at(&cells, lw_vec3(NAN, NAN, NAN)) < lw_cells_total(&cells));
}

static void test_flat_scene_and_tiny_cells_stay_bounded(void **state) {
    (void)state;
    struct lw_cells cells;
    lw_cells_init(&cells, lw_vec3(0, 0, 0), lw_vec3(10, 0, 10), 1e-6f);
    assert_int_equal(cells.count[0], LW_CELLS_PER_AXIS_MAX);
    assert_true(cells.count[1] >= 1 && cells.size_m.y > 0);
    lw_cells_init(&cells, lw_vec3(3, 3, 3), lw_vec3(3, 3, 3), 0);
    assert_true(lw_cells_total(&cells) >= 1 && lw_cells_total(&cells) <= LW_CELLS_PER_AXIS_MAX *
                                                                             LW_CELLS_PER_AXIS_MAX *
                                                                             LW_CELLS_PER_AXIS_MAX);
}

static void test_projection_reaches_the_box(void **state) {
    (void)state;
    struct lw_cells cells;
    lw_cells_init(&cells, lw_vec3(0, 0, 0), lw_vec3(2, 2, 2), 0);
    struct lw_vec3 p = lw_cells_project(&cells, lw_vec3(1, 1, 1), lw_vec3(0, 0.6f, 0.8f));
    assert_float_equal(p.z, 2, 1e-3);
    assert_float_equal(p.y, 1.75, 1e-3);
    p = lw_cells_project(&cells, lw_vec3(1, 1, 1), lw_vec3(-1, 0, 0));
    assert_float_equal(p.x, 0, 1e-3);
}

static void test_ends_carry_probe_and_direction(void **state) {
    (void)state;
    for (int i = 0; i < 500; i++) {
        float z = -1 + 2 * ((float)i + 0.5f) / 500, angle = 2.4f * (float)i, r = sqrtf(1 - z * z);
        struct lw_vec3 d = lw_vec3(r * cosf(angle), r * sinf(angle), z);
        uint32_t end = lw_ray_hit_pack_probe((uint32_t)i * 65u, d);
        assert_true(end != LW_RAY_HIT_NOTHING && (end & LW_RAY_HIT_PROBE));
        assert_int_equal(lw_ray_hit_probe(end), (uint32_t)i * 65u);
        assert_true(lw_vec3_dot(lw_ray_hit_direction(end), d) > 0.9998f); /* a degree */
    }
    assert_true(lw_ray_hit_pack_probe(0x7fff, lw_vec3(1, 1, -0.0001f)) != LW_RAY_HIT_NOTHING);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_grid_covers_its_box),
        cmocka_unit_test(test_flat_scene_and_tiny_cells_stay_bounded),
        cmocka_unit_test(test_projection_reaches_the_box),
        cmocka_unit_test(test_ends_carry_probe_and_direction),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
