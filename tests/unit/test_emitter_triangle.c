/* E of a triangle against closed forms of rectangles (Siegel and Howell, Thermal Radiation Heat Transfer). */
#include "tests/support/support.h"

#include "client/view/lights/emitter_triangle.h"
#include "common/base/random.h"

#include <math.h>

/* Two triangles. corner: counterclockwise from where it shines */
static double rectangle_light(const struct lw_vec3 corner[4], struct lw_vec3 point, struct lw_vec3 normal) {
    const struct lw_vec3 first[3] = {corner[0], corner[1], corner[2]},
                         second[3] = {corner[0], corner[2], corner[3]};
    return (double)lw_emitter_triangle_light(first, point, normal) +
           (double)lw_emitter_triangle_light(second, point, normal);
}

static const struct lw_vec3 origin = {0, 0, 0}, up = {0, 0, 1};

/* Parallel to the surface, one corner above the point. */
static double parallel(double x, double y) {
    const double a = sqrt(1 + x * x), b = sqrt(1 + y * y);
    return 0.5 * (x / a * atan(y / a) + y / b * atan(x / b));
}

static void test_above(void **state) {
    (void)state;
    static const float side[] = {0.03f, 0.2f, 1, 4, 40, 1000};
    for (int i = 0; i < 6; i++)
        for (int j = 0; j < 6; j++) {
            const float x = side[i], y = side[j];
            const struct lw_vec3 corner[4] = {{0, 0, 1}, {0, y, 1}, {x, y, 1}, {x, 0, 1}};
            const double want = parallel((double)x, (double)y);
            assert_true(fabs(rectangle_light(corner, origin, up) - want) < 2e-4 * want + 1e-5);
        }
}

/* It stands on the surface's plane, or reaches as far below it as it likes. */
static void test_upright(void **state) {
    (void)state;
    static const double depth[] = {0, 0.1, 3, 100};
    for (int k = 0; k < 4; k++)
        for (double y = 0.1; y < 8; y *= 2) { /* its distance over its width; it is as high as wide */
            const float d = (float)y, low = -(float)depth[k];
            const struct lw_vec3 corner[4] = {{0, d, low}, {1, d, low}, {1, d, 1}, {0, d, 1}};
            const double far = sqrt(1 + y * y), want = 0.5 * (atan(1 / y) - y / far * atan(1 / far));
            assert_true(fabs(rectangle_light(corner, origin, up) - want) < 2e-4);
        }
}

/* E is never more than that of a hemisphere, and no less than 0, wherever the point is. */
static void test_any_triangle(void **state) {
    (void)state;
    uint32_t lit = 0;
    for (uint32_t n = 0; n < 20000; n++) {
        float r[12];
        for (uint32_t i = 0; i < 12; i++) r[i] = 2 * lw_random_unit(lw_random_hash2(n, i)) - 1;
        const float size = n % 3 ? 1 : 1e-3f; /* small, or close to the point */
        const struct lw_vec3 corner[3] = {{r[0], r[1], r[2]},
                                          {r[0] + size * r[3], r[1] + size * r[4], r[2] + size * r[5]},
                                          {r[0] + size * r[6], r[1] + size * r[7], r[2] + size * r[8]}};
        const struct lw_vec3 point = n % 5 ? lw_vec3(0, 0, 0) : corner[n % 3],
                             normal = lw_vec3_normalize(lw_vec3(r[9], r[10], r[11])),
                             turned[3] = {corner[2], corner[1], corner[0]};
        const float front = lw_emitter_triangle_light(corner, point, normal),
                    back = lw_emitter_triangle_light(turned, point, normal);
        assert_true(front >= 0 && front < LW_PI + 1e-3f && back >= 0 && back < LW_PI + 1e-3f);
        assert_true(fminf(front, back) < 1e-3f); /* it shines to one side */
        lit += front > 0;
    }
    assert_true(lit > 2000);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_above), cmocka_unit_test(test_upright),
                                       cmocka_unit_test(test_any_triangle)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
