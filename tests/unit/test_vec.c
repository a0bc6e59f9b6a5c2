#include "tests/support/support.h"

#include "common/base/box.h"
#include "common/base/random.h"
#include "common/base/vec.h"

static float uniform(uint32_t *serial) { return 2.0f * lw_random_unit(lw_random_hash((*serial)++)) - 1.0f; }

static struct lw_vec3 random_vector(uint32_t *serial) {
    float x = uniform(serial), y = uniform(serial), z = uniform(serial);
    return lw_vec3(x, y, z);
}

static struct lw_affine random_affine(uint32_t *serial) {
    struct lw_affine t;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 4; j++) t.m[i][j] = 3.0f * uniform(serial);
    return t;
}

static void assert_near(float a, float b, float tolerance) {
    if (!(fabsf(a - b) <= tolerance)) fail_msg("%g is not %g +- %g", (double)a, (double)b, (double)tolerance);
}

static void assert_vec_near(struct lw_vec3 a, struct lw_vec3 b, float tolerance) {
    assert_near(a.x, b.x, tolerance);
    assert_near(a.y, b.y, tolerance);
    assert_near(a.z, b.z, tolerance);
}

static void products_follow_their_definitions(void **state) {
    (void)state;
    struct lw_vec3 x = lw_vec3(1, 0, 0), y = lw_vec3(0, 1, 0), z = lw_vec3(0, 0, 1);
    assert_vec_near(lw_vec3_cross(x, y), z, 0);
    assert_vec_near(lw_vec3_cross(y, z), x, 0);
    assert_vec_near(lw_vec3_cross(z, x), y, 0);
    assert_near(lw_vec3_dot(lw_vec3(1, 2, 3), lw_vec3(4, -5, 6)), 12, 0);
    assert_vec_near(lw_vec3_mad(lw_vec3(1, 2, 3), lw_vec3(4, 5, 6), 2), lw_vec3(9, 12, 15), 0);
    assert_vec_near(lw_vec3_mul(lw_vec3(1, 2, 3), lw_vec3(4, 5, 6)), lw_vec3(4, 10, 18), 0);
    assert_near(lw_vec3_length(lw_vec3(2, 3, 6)), 7, 0);
}

static void normalize_always_gives_a_unit_vector(void **state) {
    (void)state;
    assert_vec_near(lw_vec3_normalize(lw_vec3(0, -4, 3)), lw_vec3(0, -0.8f, 0.6f), 1e-7f);
    assert_vec_near(lw_vec3_normalize(lw_vec3(0, 0, 0)), lw_vec3(0, 0, 1), 0);
    assert_vec_near(lw_vec3_normalize(lw_vec3(1e-38f, 0, 0)), lw_vec3(0, 0, 1), 0);
    assert_near(lw_vec3_length(lw_vec3_normalize(lw_vec3(1e-15f, 1e-15f, 0))), 1, 1e-6f);
}

static void finite_means_all_three(void **state) {
    (void)state;
    assert_true(lw_vec3_is_finite(lw_vec3(1, -2, 3)));
    assert_false(lw_vec3_is_finite(lw_vec3(NAN, 0, 0)));
    assert_false(lw_vec3_is_finite(lw_vec3(0, INFINITY, 0)));
    assert_false(lw_vec3_is_finite(lw_vec3(0, 0, -INFINITY)));
}

static void a_product_of_transforms_applies_the_right_one_first(void **state) {
    (void)state;
    uint32_t serial = 1;
    for (int i = 0; i < 100; i++) {
        struct lw_affine a = random_affine(&serial), b = random_affine(&serial),
                         ab = lw_affine_multiply(&a, &b);
        struct lw_vec3 p = random_vector(&serial);
        assert_vec_near(lw_affine_point(&ab, p), lw_affine_point(&a, lw_affine_point(&b, p)), 1e-4f);
        assert_vec_near(lw_affine_vector(&ab, p), lw_affine_vector(&a, lw_affine_vector(&b, p)), 1e-4f);
        assert_near(lw_affine_determinant(&ab), lw_affine_determinant(&a) * lw_affine_determinant(&b), 2e-2f);
    }
    struct lw_affine identity = LW_AFFINE_IDENTITY;
    assert_vec_near(lw_affine_point(&identity, lw_vec3(1, 2, 3)), lw_vec3(1, 2, 3), 0);
    assert_near(lw_affine_determinant(&identity), 1, 0);
}

static void normals_stay_perpendicular_and_outward(void **state) {
    (void)state;
    uint32_t serial = 1000;
    unsigned mirrored = 0;
    for (int i = 0; i < 500; i++) {
        struct lw_affine t = random_affine(&serial);
        float determinant = lw_affine_determinant(&t);
        if (fabsf(determinant) < 0.5f) continue; /* nearly flat: tangents lose their digits */
        mirrored += determinant < 0;
        struct lw_vec3 n = lw_vec3_normalize(random_vector(&serial)), tangent, bitangent;
        lw_vec3_frame(n, &tangent, &bitangent);
        struct lw_vec3 m = lw_affine_normal(&t, n);
        assert_near(lw_vec3_length(m), 1, 1e-5f);
        assert_near(lw_vec3_dot(m, lw_vec3_normalize(lw_affine_vector(&t, tangent))), 0, 1e-4f);
        assert_near(lw_vec3_dot(m, lw_vec3_normalize(lw_affine_vector(&t, bitangent))), 0, 1e-4f);
        /* a unit square grows to this area */
        float area =
            lw_vec3_length(lw_vec3_cross(lw_affine_vector(&t, tangent), lw_affine_vector(&t, bitangent)));
        assert_near(lw_vec3_length(lw_affine_cofactor_normal(&t, n)), area, 1e-4f * fmaxf(area, 1));
        /* n points from the surface to the outside, and so does its image */
        assert_true(lw_vec3_dot(m, lw_affine_vector(&t, n)) > 0);
    }
    assert_true(mirrored > 100);
    struct lw_affine mirror = {{{-1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}}},
                     flat = {{{1, 0, 0, 0}, {0, 1, 0, 0}}};
    assert_vec_near(lw_affine_normal(&mirror, lw_vec3(1, 0, 0)), lw_vec3(-1, 0, 0), 0);
    assert_vec_near(lw_affine_normal(&mirror, lw_vec3(0, 1, 0)), lw_vec3(0, 1, 0), 0);
    assert_vec_near(lw_affine_normal(&flat, lw_vec3(0, 0, 1)), lw_vec3(0, 0, 1), 0);
    assert_near(lw_vec3_length(lw_affine_normal(&flat, lw_vec3(1, 0, 0))), 1, 0);
}

static void twice_the_area_has_the_sign_of_the_turn(void **state) {
    (void)state;
    const struct lw_vec2 a = {1, 1}, b = {4, 1}, c = {2, 3};
    assert_near(lw_vec2_twice_area(a, b, c), 6, 0);
    assert_near(lw_vec2_twice_area(b, c, a), 6, 0);
    assert_near(lw_vec2_twice_area(a, c, b), -6, 0);
    assert_near(lw_vec2_twice_area(a, b, b), 0, 0);
}

static void a_frame_is_orthonormal_and_right_handed(void **state) {
    (void)state;
    uint32_t serial = 77;
    for (int i = 0; i < 2006; i++) {
        struct lw_vec3 n = lw_vec3_normalize(random_vector(&serial)), t, b;
        /* the axes, and z's two signs: the formula divides by sign + n.z */
        if (i < 6)
            n = lw_vec3((i / 2 == 0) * (i & 1 ? -1.0f : 1.0f), (i / 2 == 1) * (i & 1 ? -1.0f : 1.0f),
                        (i / 2 == 2) * (i & 1 ? -1.0f : 1.0f));
        lw_vec3_frame(n, &t, &b);
        assert_near(lw_vec3_length(t), 1, 1e-6f);
        assert_near(lw_vec3_length(b), 1, 1e-6f);
        assert_near(lw_vec3_dot(t, b), 0, 1e-6f);
        assert_near(lw_vec3_dot(t, n), 0, 1e-6f);
        assert_near(lw_vec3_dot(b, n), 0, 1e-6f);
        assert_vec_near(lw_vec3_cross(t, b), n, 1e-6f);
    }
}

static void a_box_holds_what_has_been_added_and_no_more(void **state) {
    (void)state;
    struct lw_box box = LW_BOX_EMPTY;
    assert_true(lw_box_is_empty(&box));
    lw_box_add(&box, &LW_BOX_EMPTY);
    assert_true(lw_box_is_empty(&box));
    lw_box_add_point(&box, lw_vec3(1, 2, 3));
    assert_false(lw_box_is_empty(&box));
    assert_vec_near(lw_box_size(&box), lw_vec3(0, 0, 0), 0);
    lw_box_add(&box, &(struct lw_box){{-1, 4, 3}, {0, 6, 7}});
    assert_vec_near(lw_box_size(&box), lw_vec3(2, 4, 4), 0);
    assert_vec_near(lw_box_middle(&box), lw_vec3(0, 4, 5), 0);
    assert_near(lw_box_radius(&box), 3, 0);
    assert_true(lw_box_holds(&box, lw_vec3(1, 6, 7), 0));
    assert_false(lw_box_holds(&box, lw_vec3(1, 6.5f, 7), 0.25f));
    assert_true(lw_box_holds(&box, lw_vec3(1, 6.5f, 7), 0.5f));
    assert_near(lw_box_distance(&box, lw_vec3(0.5f, 3, 4)), 0, 0);
    assert_near(lw_box_distance(&box, lw_vec3(4, 3, -1)), 5, 0);
}

static void a_moved_box_holds_its_corners(void **state) {
    (void)state;
    const struct lw_box box = {{0, 0, 0}, {2, 1, 1}};
    const struct lw_affine turn = {{{0, -1, 0, 10}, {1, 0, 0, 0}, {0, 0, 1, 0}}}; /* x to y, y to -x */
    const struct lw_box moved = lw_box_moved(&turn, &box);
    assert_vec_near(moved.low, lw_vec3(9, 0, 0), 0);
    assert_vec_near(moved.high, lw_vec3(10, 2, 1), 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(products_follow_their_definitions),
        cmocka_unit_test(normalize_always_gives_a_unit_vector),
        cmocka_unit_test(finite_means_all_three),
        cmocka_unit_test(a_product_of_transforms_applies_the_right_one_first),
        cmocka_unit_test(normals_stay_perpendicular_and_outward),
        cmocka_unit_test(twice_the_area_has_the_sign_of_the_turn),
        cmocka_unit_test(a_frame_is_orthonormal_and_right_handed),
        cmocka_unit_test(a_box_holds_what_has_been_added_and_no_more),
        cmocka_unit_test(a_moved_box_holds_its_corners),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
