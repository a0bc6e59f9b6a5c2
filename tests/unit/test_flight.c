#include "tests/support/support.h"

#include "client/camera/flight.h"
#include "client/view/window/pace.h"

#include <math.h>

static void assert_vec(struct lw_vec3 v, float x, float y, float z) {
    assert_float_equal(v.x, x, 1e-4f);
    assert_float_equal(v.y, y, 1e-4f);
    assert_float_equal(v.z, z, 1e-4f);
}

static void test_takes_any_view(void **state) {
    (void)state;
    for (int i = 0; i < 200; i++) {
        float yaw = 0.1f * (float)i, pitch = 1.5f * sinf(0.7f * (float)i);
        struct lw_vec3 dir = lw_vec3(sinf(yaw) * cosf(pitch), sinf(pitch), -cosf(yaw) * cosf(pitch));
        struct lw_camera_view view =
            lw_camera_look_at(lw_vec3(1, 2, 3), lw_vec3_add(lw_vec3(1, 2, 3), dir), 1);
        struct lw_flight flight = {.speed = 1};
        lw_flight_take(&flight, &view);
        struct lw_camera_view again = lw_flight_view(&flight);
        assert_vec(again.position, 1, 2, 3);
        assert_vec(again.forward, view.forward.x, view.forward.y, view.forward.z);
        assert_vec(again.right, view.right.x, view.right.y, view.right.z);
    }
    struct lw_camera_view down = lw_camera_look_at(lw_vec3(0, 5, 0), lw_vec3(0, 0, 0), 1);
    struct lw_flight flight = {.speed = 1};
    lw_flight_take(&flight, &down);
    assert_true(lw_flight_view(&flight).forward.y < -0.99f);
    assert_float_equal(lw_flight_view(&flight).right.x, down.right.x, 1e-4f);
}

static void test_turns_and_moves(void **state) {
    (void)state;
    struct lw_flight flight = {.speed = 2, .fov_y = 1};
    lw_flight_move(&flight, 0, 0, 1, 0.5f); /* looks along -Z */
    assert_vec(flight.position, 0, 0, -1);
    lw_flight_turn(&flight, LW_PI / 2, 0); /* to the right: +X */
    assert_vec(lw_flight_view(&flight).forward, 1, 0, 0);
    lw_flight_move(&flight, 1, 0, 0, 0.5f); /* right of +X is +Z */
    assert_vec(flight.position, 0, 0, 0);
    lw_flight_move(&flight, 0, 1, 0, 1);
    assert_vec(flight.position, 0, 2, 0);
    lw_flight_turn(&flight, 0, 10); /* never over the top */
    assert_true(lw_flight_view(&flight).forward.x > 0);
    assert_true(lw_flight_view(&flight).up.y > 0);
    for (int i = 0; i < 1000; i++) lw_flight_turn(&flight, 1, 0);
    assert_true(fabsf(flight.yaw) <= 3.15f);
}

/* The point in the middle of the view stays there, at its distance; a walker's forward is level. */
static void test_orbits_and_walks(void **state) {
    (void)state;
    struct lw_flight flight = {.position = {1, 2, 3}, .yaw = 0.4f, .pitch = -0.3f, .fov_y = 1, .speed = 2};
    struct lw_camera_view view = lw_flight_view(&flight);
    const struct lw_vec3 pivot = lw_vec3_mad(view.position, view.forward, 5);
    for (int i = 0; i < 20; i++) {
        lw_flight_orbit(&flight, 5, 0.3f, i < 10 ? 0.2f : -0.4f);
        view = lw_flight_view(&flight);
        const struct lw_vec3 middle = lw_vec3_mad(view.position, view.forward, 5);
        assert_vec(middle, pivot.x, pivot.y, pivot.z);
        assert_true(view.up.y > 0);
    }
    flight = (struct lw_flight){.pitch = -1, .speed = 2};
    lw_flight_walk(&flight, 0, 1, 0.5f);
    assert_vec(flight.position, 0, 0, -1);
    lw_flight_walk(&flight, 1, 0, 0.5f);
    assert_vec(flight.position, 1, 0, -1);
    flight.pitch = LW_PI / 6;
    lw_flight_advance(&flight, 2);
    assert_vec(flight.position, 1, 1, -1 - sqrtf(3));
}

static void test_pace(void **state) {
    (void)state;
    struct lw_pace pace = {0};
    uint32_t width, height;
    lw_pace_note(&pace, 1000, 1000 * 1000); /* a microsecond a pixel: 40,000 pixels in time */
    lw_pace_size(&pace, 1280, 720, &width, &height);
    assert_true(width * height <= 40000 && width * height > 35000);
    assert_float_equal((float)width / (float)height, 1280.0f / 720.0f, 0.05f);
    for (int i = 0; i < 50; i++) lw_pace_note(&pace, 1000, 10 * 1000); /* ten nanoseconds: all of it */
    lw_pace_size(&pace, 1280, 720, &width, &height);
    assert_int_equal(width, 1280);
    assert_int_equal(height, 720);
    for (int i = 0; i < 50; i++) lw_pace_note(&pace, 10, 1000000000); /* never smaller than it can be seen */
    lw_pace_size(&pace, 1280, 40, &width, &height);
    assert_int_equal(width, LW_PACE_SIDE_MIN);
    assert_int_equal(height, 40);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_takes_any_view),
        cmocka_unit_test(test_turns_and_moves),
        cmocka_unit_test(test_orbits_and_walks),
        cmocka_unit_test(test_pace),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
