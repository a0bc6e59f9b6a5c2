#include "tests/support/support.h"

#include "common/tile/bilinear.h"

#include <math.h>

static void test_two_texels_share_what_lies_between_their_centres(void **state) {
    (void)state;
    const struct lw_bilinear b = lw_bilinear_at(3.75f, 8);
    assert_int_equal(b.low, 3);
    assert_int_equal(b.high, 4);
    assert_float_equal(b.share, 0.25f, 0);
}

static void test_a_centre_is_its_texel_alone(void **state) {
    (void)state;
    const struct lw_bilinear b = lw_bilinear_at(2.5f, 8);
    assert_int_equal(b.low, 2);
    assert_float_equal(b.share, 0, 0);
}

static void test_beyond_the_last_centres_a_look_up_stays_inside(void **state) {
    (void)state;
    static const float at[] = {-100, 0, 0.5f, NAN, 7.5f, 8, 1e30f, INFINITY};
    for (size_t i = 0; i < sizeof at / sizeof *at; i++) {
        const struct lw_bilinear b = lw_bilinear_at(at[i], 8);
        const uint32_t texel = i < 4 ? 0 : 7;
        assert_int_equal(b.low, texel);
        assert_int_equal(b.high, texel < 7 ? texel + 1 : texel);
        assert_float_equal(b.share, 0, 0);
    }
    const struct lw_bilinear one = lw_bilinear_at(0.9f, 1);
    assert_int_equal(one.low, 0);
    assert_int_equal(one.high, 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_two_texels_share_what_lies_between_their_centres),
        cmocka_unit_test(test_a_centre_is_its_texel_alone),
        cmocka_unit_test(test_beyond_the_last_centres_a_look_up_stays_inside),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
