#include "tests/support/support.h"

#include "client/paths/path_film.h"

#include <math.h>

static struct lw_path_film new_film(uint32_t width, uint32_t height) {
    struct lw_path_film film;
    struct lw_error err = {0};
    lw_support_ok(lw_path_film_init(&film, width, height, &err), &err);
    return film;
}

static void test_mean_of_both_halves(void **state) {
    (void)state;
    struct lw_path_film film = new_film(2, 1);
    float rgb[6] = {9, 9, 9, 9, 9, 9};
    lw_path_film_resolve(&film, rgb);
    for (int i = 0; i < 6; i++) assert_true(rgb[i] == 0); /* no sample: black */
    for (int i = 0; i < 6; i++) film.half[0][i] = (float)i, film.half[1][i] = 1;
    film.samples = 4;
    lw_path_film_resolve(&film, rgb);
    for (int i = 0; i < 6; i++) assert_float_equal(rgb[i], ((double)i + 1) / 4, 1e-6);
    lw_path_film_clear(&film);
    assert_int_equal(film.samples, 0);
    for (int i = 0; i < 6; i++) assert_true(film.half[0][i] == 0 && film.half[1][i] == 0);
    lw_path_film_finish(&film);
    lw_path_film_finish(&film); /* a zeroed film */
}

/* Two pixels of 4 and 0: mean square 8, floor 0.08. */
static void test_error_by_hand(void **state) {
    (void)state;
    struct lw_path_film film = new_film(2, 1);
    film.samples = 1;
    assert_true(isinf(lw_path_film_error(&film)));
    film.samples = 3; /* two even samples and an odd one */
    for (int c = 0; c < 3; c++) {
        film.half[0][c] = 2 * 4.4f, film.half[1][c] = 3.2f; /* halves of 4.4 and 3.2: sum 12 */
        film.half[0][3 + c] = 2 * 0.1f, film.half[1][3 + c] = -0.2f;
    }
    double bright = 0.6 * 0.6 / (3.8 * 3.8 + 0.08), dark = 0.15 * 0.15 / (0.05 * 0.05 + 0.08);
    assert_float_equal(lw_path_film_error(&film), sqrt((bright + dark) / 2), 1e-6);
    lw_path_film_finish(&film);
}

static void test_black_has_no_error(void **state) {
    (void)state;
    struct lw_path_film film = new_film(3, 3);
    film.samples = 2;
    assert_true(lw_path_film_error(&film) == 0);
    lw_path_film_finish(&film);
}

/* The figure is the error: for independent normal noise of known size on a known picture. */
static void test_error_is_the_error(void **state) {
    (void)state;
    struct lw_path_film film = new_film(100, 100);
    const size_t count = 100 * 100 * 3;
    uint32_t random = 1;
    for (size_t i = 0; i < count; i++)
        for (int half = 0; half < 2; half++) {
            float noise = 0; /* variance 12 / 12 */
            for (int k = 0; k < 12; k++) {
                random = random * 1664525u + 1013904223u;
                noise += (float)(random >> 8) * 0x1p-24f - 0.5f;
            }
            film.half[half][i] = 8 * (10 + noise);
        }
    film.samples = 16;
    /* Each half is 10 with deviation 1, their mean's deviation is sqrt(1/2); relative to sqrt(10^2 + 0.01 *
     * 10^2). The estimate over 30,000 values is good to 1 %. */
    assert_true(fabs(lw_path_film_error(&film) - sqrt(0.5 / 101)) < 0.02 * sqrt(0.5 / 101));
    lw_path_film_finish(&film);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_mean_of_both_halves),
        cmocka_unit_test(test_error_by_hand),
        cmocka_unit_test(test_black_has_no_error),
        cmocka_unit_test(test_error_is_the_error),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
