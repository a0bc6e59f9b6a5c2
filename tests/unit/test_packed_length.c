#include "tests/support/support.h"

#include "server/solve/surface/packed_length.h"

#include <math.h>

static float read(float length) { return lw_packed_length_unpack(lw_packed_length(length)); }

static void a_length_grows_by_less_than_a_bound(void **state) {
    (void)state;
    float most = 0;
    for (float length = 1e-30f; length < 1e30f; length *= 1.001f) {
        assert_true(read(length) >= length);
        most = fmaxf(most, read(length) / length - 1);
    }
    assert_true(most < 0x1p-7f && most > 0.9f * 0x1p-7f);
}

static void packed_lengths_stay(void **state) {
    (void)state;
    assert_true(read(0) == 0 && read(1) == 1 && read(0.0625f) == 0.0625f);
    for (float length = 1e-20f; length < 1e20f; length *= 1.1f)
        assert_true(read(read(length)) == read(length));
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(a_length_grows_by_less_than_a_bound),
                                       cmocka_unit_test(packed_lengths_stay)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
