#include "tests/support/support.h"

#include "common/base/colour.h"

#include <math.h>

/* IEC 61966-2-1 in double precision: what table and functions are measured against. */
static double decode(double s) { return s <= 0.04045 ? s / 12.92 : pow((s + 0.055) / 1.055, 2.4); }

static void the_table_is_the_formula(void **state) {
    (void)state;
    for (int i = 0; i < 256; i++) {
        double expected = decode(i / 255.0), found = (double)lw_colour_from_srgb8((uint8_t)i);
        if (fabs(found - expected) > 1e-7 * expected + 1e-12)
            fail_msg("entry %d: %.9g is not %.9g", i, found, expected);
    }
    assert_true(lw_colour_from_srgb8(0) == 0.0f);
    assert_true(lw_colour_from_srgb8(255) == 1.0f);
}

static void the_functions_are_the_formula(void **state) {
    (void)state;
    for (int i = 0; i <= 1000; i++) {
        float s = (float)i / 1000;
        assert_true(fabs((double)lw_colour_from_srgb(s) - decode((double)s)) < 1e-6);
    }
    assert_true(lw_colour_to_srgb(0) == 0);
    assert_true(fabsf(lw_colour_to_srgb(1) - 1) < 1e-6f);
}

static void encoding_undoes_decoding(void **state) {
    (void)state;
    for (int i = 0; i < 256; i++) {
        float encoded = lw_colour_to_srgb(lw_colour_from_srgb8((uint8_t)i)) * 255;
        assert_int_equal((int)lrintf(encoded), i);
        assert_true(fabsf(encoded - (float)i) < 0.01f);
    }
    /* and across the knee, where the two pieces of the curve meet */
    for (float l = 0.0025f; l < 0.0040f; l += 0.00001f)
        assert_true(fabsf(lw_colour_from_srgb(lw_colour_to_srgb(l)) - l) < 2e-6f);
}

static void luminance_weighs_by_rec709(void **state) {
    (void)state;
    assert_true(fabsf(lw_colour_luminance(lw_vec3(1, 1, 1)) - 1) < 1e-6f);
    assert_true(fabsf(lw_colour_luminance(lw_vec3(1, 0, 0)) - 0.2126f) < 1e-7f);
    assert_true(fabsf(lw_colour_luminance(lw_vec3(0, 2, 0)) - 1.4304f) < 1e-6f);
    assert_true(fabsf(lw_colour_luminance(lw_vec3(0, 0, 1)) - 0.0722f) < 1e-7f);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_table_is_the_formula),
        cmocka_unit_test(the_functions_are_the_formula),
        cmocka_unit_test(encoding_undoes_decoding),
        cmocka_unit_test(luminance_weighs_by_rec709),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
