/* Published values that are held here: L*a*b* of sRGB's primaries (CIE 15 with D65, as tables print them)
 * with the paper's exponent and mapping, and what the authors' program (version 1.7, their C++ header) gives
 * on the patterns below. The patterns are made here: the authors' own pictures are not in this repository. */
#include "tests/support/support.h"

#include "client/measure/figures/flip.h"
#include "common/image/image.h"

#include <math.h>

/* ---- patterns -------------------------------------------------------------------------------- */

/* In [0, 1); the same numbers on every machine. */
static float noise(unsigned x, unsigned y, unsigned c) {
    unsigned n = (y * 4099u + x) * 3u + c + 1u;
    n *= 2654435761u, n ^= n >> 15, n *= 2246822519u, n ^= n >> 13, n *= 3266489917u, n ^= n >> 16;
    return (float)(n >> 8) / 16777216.0f;
}

enum pattern {
    RAMPS,   /* colours that change slowly; some noise */
    STEP,    /* an edge; a pixel further to the right */
    FIREFLY, /* grey; one white pixel */
    CHECKER, /* red and blue squares; their mean */
    NOISE    /* two kinds of it */
};

static void draw(enum pattern pattern, bool test, unsigned width, unsigned height, float *rgb) {
    for (unsigned y = 0; y < height; y++)
        for (unsigned x = 0; x < width; x++, rgb += 3)
            for (unsigned c = 0; c < 3; c++) {
                const float ramp[3] = {((float)x + 0.5f) / (float)width, ((float)y + 0.5f) / (float)height,
                                       0.25f};
                const bool odd = (x / 2 + y / 2) % 2;
                switch (pattern) {
                case RAMPS:
                    rgb[c] = ramp[c] + (test ? 0.125f * (noise(x, y, c) - 0.5f) : 0);
                    break;
                case STEP:
                    rgb[c] = x < width / 2 + test ? 0.05f : 0.6f;
                    break;
                case FIREFLY:
                    rgb[c] = test && x == width / 2 && y == height / 2 ? 1.0f : 0.18f;
                    break;
                case CHECKER:
                    rgb[c] = c == 1 ? 0.0f : test ? 0.5f : odd == (c == 0) ? 1.0f : 0.0f;
                    break;
                case NOISE:
                    rgb[c] = noise(x, y + (test ? 1000 : 0), c);
                    break;
                }
            }
}

/* ---- the authors' values --------------------------------------------------------------------- */

static void map_of(const float *a, const float *b, unsigned width, unsigned height, float pixels_per_degree,
                   float *out_map) {
    struct lw_error err = {0};
    lw_support_ok(lw_flip_map(a, b, width, height, pixels_per_degree, out_map, &err), &err);
}

#define WIDTH_MAX  64
#define HEIGHT_MAX 48
#define PIXELS_MAX (WIDTH_MAX * HEIGHT_MAX)

static void the_authors_program_agrees(void **state) {
    (void)state;
    static const struct {
        enum pattern pattern;
        unsigned width, height;
        float pixels_per_degree;
        double mean, first, middle, last, most;
    } known[] = {
        {RAMPS, 64, 48, 67, 0.0792324, 0.1025637, 0.0640286, 0.1117875, 0.2177285},
        {STEP, 64, 48, 67, 0.0333142, 0, 0.4305226, 0, 0.5726690},
        {FIREFLY, 64, 48, 67, 0.0015432, 0, 0.4108892, 0, 0.4108892},
        {CHECKER, 64, 48, 67, 0.0725421, 0.4868572, 0.0590014, 0.4868572, 0.5212517},
        {NOISE, 64, 48, 67, 0.3891225, 0.4605863, 0.3361231, 0.3569781, 0.8955863},
        {NOISE, 64, 48, 20, 0.8062383, 0.5631963, 0.7927465, 0.8877381, 0.9890372},
        {NOISE, 64, 48, 150, 0.2539294, 0.3246414, 0.2616982, 0.3574370, 0.6610325},
        {NOISE, 5, 3, 67, 0.5744557, 0.4005063, 0.4070490, 0.7366520, 0.7959343},
        {NOISE, 1, 7, 67, 0.5732592, 0.5479950, 0.5060972, 0.6677688, 0.6677688},
        {NOISE, 1, 1, 67, 0.4097099, 0.4097099, 0.4097099, 0.4097099, 0.4097099},
    };
    /* Square roots of differences near 0 make the most of what floats round in another order. */
    const double near = 1e-4;
    static float a[3 * PIXELS_MAX], b[3 * PIXELS_MAX], map[PIXELS_MAX];
    for (size_t i = 0; i < sizeof known / sizeof known[0]; i++) {
        const unsigned width = known[i].width, height = known[i].height;
        draw(known[i].pattern, false, width, height, a);
        draw(known[i].pattern, true, width, height, b);
        map_of(a, b, width, height, known[i].pixels_per_degree, map);
        double most = 0;
        for (unsigned p = 0; p < width * height; p++) most = fmax(most, (double)map[p]);
        assert_true(fabs(lw_flip_mean(map, NULL, (size_t)width * height) - known[i].mean) < near / 5);
        assert_true(fabs((double)map[0] - known[i].first) < near);
        assert_true(fabs((double)map[height / 2 * width + width / 2] - known[i].middle) < near);
        assert_true(fabs((double)map[width * height - 1] - known[i].last) < near);
        assert_true(fabs(most - known[i].most) < near);
    }
}

/* Even pictures have no features: the rest is Hunt, HyAB, exponent and mapping. */
static void even_colours(void **state) {
    (void)state;
    enum { BLACK, WHITE, RED, GREEN, BLUE, COLOURS };
    static const struct {
        float rgb[3];
        double lab[3];
    } colour[COLOURS] = {
        [BLACK] = {{0, 0, 0}, {0, 0, 0}},
        [WHITE] = {{1, 1, 1}, {100, 0, 0}},
        [RED] = {{1, 0, 0}, {53.2408, 80.0925, 67.2032}},
        [GREEN] = {{0, 1, 0}, {87.7347, -86.1827, 83.1793}},
        [BLUE] = {{0, 0, 1}, {32.2970, 79.1875, -107.8602}},
    };
    double e[COLOURS][COLOURS];
    for (int i = 0; i < COLOURS; i++)
        for (int j = 0; j < COLOURS; j++) {
            const double *p = colour[i].lab, *q = colour[j].lab;
            const double da = 0.01 * (p[0] * p[1] - q[0] * q[1]), db = 0.01 * (p[0] * p[2] - q[0] * q[2]);
            e[i][j] = pow(fabs(p[0] - q[0]) + hypot(da, db), 0.7);
        }
    const double largest = e[GREEN][BLUE], knee = 0.4 * largest;
    assert_true(fabs(largest - 41.276) < 2e-3);
    for (int i = 0; i < COLOURS; i++)
        for (int j = 0; j < COLOURS; j++) {
            enum { WIDTH = 9, HEIGHT = 5 };
            float a[3 * WIDTH * HEIGHT], b[3 * WIDTH * HEIGHT], map[WIDTH * HEIGHT];
            for (int p = 0; p < 3 * WIDTH * HEIGHT; p++)
                a[p] = colour[i].rgb[p % 3], b[p] = colour[j].rgb[p % 3];
            map_of(a, b, WIDTH, HEIGHT, LW_FLIP_PIXELS_PER_DEGREE, map);
            const double expected =
                e[i][j] < knee ? 0.95 * e[i][j] / knee : 0.95 + 0.05 * (e[i][j] - knee) / (largest - knee);
            for (int p = 0; p < WIDTH * HEIGHT; p++)
                assert_true(fabs((double)map[p] - expected) < (i == j ? 1e-9 : 3e-4));
        }
    assert_true(e[BLACK][WHITE] > knee && fabs(e[BLACK][WHITE] - pow(100, 0.7)) < 1e-9);
}

/* ---- the rest -------------------------------------------------------------------------------- */

static void no_difference_and_either_way(void **state) {
    (void)state;
    static float a[3 * PIXELS_MAX], b[3 * PIXELS_MAX], map[PIXELS_MAX], back[PIXELS_MAX];
    draw(NOISE, false, WIDTH_MAX, HEIGHT_MAX, a);
    draw(NOISE, true, WIDTH_MAX, HEIGHT_MAX, b);
    map_of(a, a, WIDTH_MAX, HEIGHT_MAX, LW_FLIP_PIXELS_PER_DEGREE, map);
    for (int i = 0; i < PIXELS_MAX; i++) assert_true(map[i] == 0);
    map_of(a, b, WIDTH_MAX, HEIGHT_MAX, LW_FLIP_PIXELS_PER_DEGREE, map);
    map_of(b, a, WIDTH_MAX, HEIGHT_MAX, LW_FLIP_PIXELS_PER_DEGREE, back);
    assert_memory_equal(map, back, sizeof map);
}

static void turn(const float *in, unsigned width, unsigned height, unsigned channels, float *out) {
    for (unsigned y = 0; y < height; y++)
        for (unsigned x = 0; x < width; x++)
            for (unsigned c = 0; c < channels; c++)
                out[(x * height + y) * channels + c] = in[(y * width + x) * channels + c];
}

static void rows_are_like_columns(void **state) {
    (void)state;
    static float a[3 * PIXELS_MAX], b[3 * PIXELS_MAX], ta[3 * PIXELS_MAX], tb[3 * PIXELS_MAX];
    static float map[PIXELS_MAX], turned[PIXELS_MAX], expected[PIXELS_MAX];
    draw(NOISE, false, WIDTH_MAX, HEIGHT_MAX, a);
    draw(NOISE, true, WIDTH_MAX, HEIGHT_MAX, b);
    turn(a, WIDTH_MAX, HEIGHT_MAX, 3, ta);
    turn(b, WIDTH_MAX, HEIGHT_MAX, 3, tb);
    map_of(a, b, WIDTH_MAX, HEIGHT_MAX, LW_FLIP_PIXELS_PER_DEGREE, map);
    map_of(ta, tb, HEIGHT_MAX, WIDTH_MAX, LW_FLIP_PIXELS_PER_DEGREE, turned);
    turn(map, WIDTH_MAX, HEIGHT_MAX, 1, expected);
    for (int i = 0; i < PIXELS_MAX; i++) assert_float_equal(turned[i], expected[i], 1e-4f);
}

static void what_no_display_shows_is_clipped(void **state) {
    (void)state;
    enum { COUNT = 6 };
    const float wild[3 * COUNT] = {NAN, 2, 0.5f, -1, INFINITY, -INFINITY, 0.25f, 0.5f, 0.75f,
                                   1,   1, 1e9f, 0,  -0.0f,    0.5f,      -NAN,  1.5f, 0};
    const float tame[3 * COUNT] = {0, 1, 0.5f, 0, 1, 0, 0.25f, 0.5f, 0.75f, 1, 1, 1, 0, 0, 0.5f, 0, 1, 0};
    const float grey[3 * COUNT] = {0.2f, 0.2f, 0.2f, 0.2f, 0.2f, 0.2f, 0.2f, 0.2f, 0.2f,
                                   0.2f, 0.2f, 0.2f, 0.2f, 0.2f, 0.2f, 0.2f, 0.2f, 0.2f};
    float map[COUNT], expected[COUNT];
    map_of(wild, grey, 3, 2, LW_FLIP_PIXELS_PER_DEGREE, map);
    map_of(tame, grey, 3, 2, LW_FLIP_PIXELS_PER_DEGREE, expected);
    assert_memory_equal(map, expected, sizeof map);
    assert_true(expected[0] > 0);
    map_of(grey, wild, 3, 2, LW_FLIP_PIXELS_PER_DEGREE, map);
    assert_memory_equal(map, expected, sizeof map);
}

static void what_is_left_out_does_not_count(void **state) {
    (void)state;
    const float map[4] = {0.5f, 1, 0.25f, 0};
    assert_true(lw_flip_mean(map, NULL, 4) == 0.4375);
    assert_true(lw_flip_mean(map, (uint8_t[4]){0, 1, 0, 255}, 4) == 0.375);
    assert_true(lw_flip_mean(map, (uint8_t[4]){1, 1, 1, 1}, 4) == 0);
    assert_true(lw_flip_mean(map, NULL, 0) == 0);
}

static void limits(void **state) {
    (void)state;
    float a[6] = {0, 0, 0, 1, 1, 1}, b[6] = {1, 1, 1, 0, 0, 0}, map[2] = {-1, -1};
    const struct {
        unsigned width, height;
        float pixels_per_degree;
        const char *text;
    } bad[] = {
        {0, 1, 67, "0 x 1"},
        {1, 0, 67, "1 x 0"},
        {LW_IMAGE_SIDE_MAX + 1, 1, 67, "65537 x 1"},
        {1, LW_IMAGE_SIDE_MAX + 1, 67, "1 x 65537"},
        {2, 1, 0.99f, "0.99 pixels per degree"},
        {2, 1, 1000.5f, "1000.5 pixels per degree"},
        {2, 1, NAN, "pixels per degree"},
    };
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        struct lw_error err = {0};
        lw_support_fails(lw_flip_map(a, b, bad[i].width, bad[i].height, bad[i].pixels_per_degree, map, &err),
                         LW_USAGE, &err, bad[i].text);
        assert_true(map[0] == -1 && map[1] == -1);
    }
    const float at_limit[2] = {LW_FLIP_PIXELS_PER_DEGREE_MIN, LW_FLIP_PIXELS_PER_DEGREE_MAX};
    for (int i = 0; i < 2; i++) {
        map_of(a, b, 2, 1, at_limit[i], map);
        assert_true(map[0] > 0 && map[0] <= 1 && map[1] > 0 && map[1] <= 1);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_authors_program_agrees),
        cmocka_unit_test(even_colours),
        cmocka_unit_test(no_difference_and_either_way),
        cmocka_unit_test(rows_are_like_columns),
        cmocka_unit_test(what_no_display_shows_is_clipped),
        cmocka_unit_test(what_is_left_out_does_not_count),
        cmocka_unit_test(limits),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
