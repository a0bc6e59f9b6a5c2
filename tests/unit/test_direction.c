/* Random directions: unit, of the densities they say, and turned without bending. */
#include "tests/support/support.h"

#include "common/base/random.h"
#include "common/light/direction.h"

#define COUNT 4096u

/* Means over a (0,2)-sequence are within a few 1/COUNT of the integrals. */
static void directions_have_their_densities(void **state) {
    (void)state;
    double cosine_z = 0, cosine_z2 = 0, sphere_z2 = 0, sphere_x = 0;
    for (uint32_t i = 0; i < COUNT; i++) {
        float point[2];
        lw_random_sobol2(i, 3, point);
        struct lw_vec3 c = lw_direction_cosine(point), s = lw_direction_sphere(point);
        assert_true(fabsf(lw_vec3_length(c) - 1) < 1e-6f && fabsf(lw_vec3_length(s) - 1) < 1e-6f);
        assert_true(c.z >= 0);
        cosine_z += (double)c.z / COUNT;
        cosine_z2 += (double)(c.z * c.z) / COUNT;
        sphere_z2 += (double)(s.z * s.z) / COUNT;
        sphere_x += (double)s.x / COUNT;
    }
    assert_true(fabs(cosine_z - 2.0 / 3) < 1e-3 && fabs(cosine_z2 - 0.5) < 1e-3);
    assert_true(fabs(sphere_z2 - 1.0 / 3) < 1e-3 && fabs(sphere_x) < 1e-3);
}

static void turning_keeps_angles(void **state) {
    (void)state;
    for (uint32_t i = 0; i < 256; i++) {
        float a[2], b[2];
        lw_random_sobol2(i, 5, a);
        lw_random_sobol2(i, 6, b);
        struct lw_vec3 normal = lw_direction_sphere(a), local = lw_direction_cosine(b),
                       turned = lw_direction_about(normal, local);
        assert_true(fabsf(lw_vec3_dot(turned, normal) - local.z) < 1e-5f);
        assert_true(fabsf(lw_vec3_length(turned) - 1) < 1e-5f);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(directions_have_their_densities),
                                       cmocka_unit_test(turning_keeps_angles)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
