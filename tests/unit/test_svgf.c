/* The filter on pictures that are made by hand: a painted wall straight ahead. */
#include "tests/support/support.h"

#include "client/paths/svgf.h"
#include "common/base/random.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define WALL_M 4.0f

/* A picture: the surfaces that the eye meets, the light on them, and the result. */
struct screen {
    struct lw_gbuffer g;
    float *memory, *light; /* light: E/pi, 3 floats a pixel */
    float *radiance, *out;
    struct lw_svgf *svgf;
};

static size_t pixels_of(const struct screen *s) { return (size_t)s->g.width * s->g.height; }

/* A grey wall that fills the picture, without light. */
static void screen_init(struct screen *s, uint32_t width, uint32_t height, unsigned threads) {
    struct lw_error err = {0};
    *s = (struct screen){.g = {.width = width, .height = height}};
    const size_t n = pixels_of(s);
    s->memory = calloc(26 * n, sizeof *s->memory);
    s->g.plane.object = calloc(n, sizeof *s->g.plane.object);
    assert_true(s->memory && s->g.plane.object);
    float *at = s->memory,
          **plane[] = {&s->g.plane.depth, &s->g.plane.slope[0], &s->g.plane.slope[1], &s->g.plane.apart};
    for (int i = 0; i < 4; i++, at += n) *plane[i] = at;
    float **vectors[] = {s->g.plane.normal, s->g.plane.albedo, s->g.plane.emission, s->g.plane.before};
    for (int v = 0; v < 4; v++)
        for (int c = 0; c < 3; c++, at += n) vectors[v][c] = at;
    s->light = at, s->radiance = at + 3 * n, s->out = at + 6 * n;
    s->g.camera = lw_camera_look_at(lw_vec3(0, 0, 0), lw_vec3(0, 0, -1), LW_PI / 3);
    for (size_t i = 0; i < n; i++) {
        s->g.plane.object[i] = 1;
        s->g.plane.normal[2][i] = 1;
        for (int c = 0; c < 3; c++) s->g.plane.albedo[c][i] = 0.5f;
    }
    lw_support_ok(lw_svgf_create(&(struct lw_svgf_desc){.width = width, .height = height, .threads = threads},
                                 &s->svgf, &err),
                  &err);
}

static void screen_finish(struct screen *s) {
    lw_svgf_destroy(s->svgf);
    free(s->g.plane.object);
    free(s->memory);
}

static float pixel_m(const struct screen *s) {
    return WALL_M * lw_camera_plane(&s->g.camera, s->g.width, s->g.height).pixel;
}

/* Where each pixel of the wall is, and was: `moved_m` further left. */
static void place_wall(struct screen *s, float moved_m) {
    const struct lw_camera_plane plane = lw_camera_plane(&s->g.camera, s->g.width, s->g.height);
    for (size_t i = 0; i < pixels_of(s); i++) {
        struct lw_vec3 way =
            lw_camera_direction(&plane, (float)(i % s->g.width) + 0.5f, (float)(i / s->g.width) + 0.5f);
        struct lw_vec3 point = lw_vec3_mad(s->g.camera.position, way, WALL_M);
        s->g.plane.depth[i] = 1 / WALL_M;
        s->g.plane.apart[i] = WALL_M / plane.pixel;
        s->g.plane.before[0][i] = point.x - moved_m;
        s->g.plane.before[1][i] = point.y;
        s->g.plane.before[2][i] = point.z;
    }
}

static void filter(struct screen *s) {
    for (size_t i = 0; i < 3 * pixels_of(s); i++)
        s->radiance[i] = s->light[i] * s->g.plane.albedo[i % 3][i / 3] + s->g.plane.emission[i % 3][i / 3];
    lw_svgf_filter(s->svgf, &s->g, s->radiance, s->out);
}

/* The light that comes out, red channel. */
static float seen(const struct screen *s, size_t i) {
    return (s->out[3 * i] - s->g.plane.emission[0][i]) / s->g.plane.albedo[0][i];
}

static float noise(uint32_t seed, size_t i) { return lw_random_unit(lw_random_hash2(seed, (uint32_t)i)); }

static void set_light(struct screen *s, size_t i, float value) {
    for (size_t c = 0; c < 3; c++) s->light[3 * i + c] = value;
}

static void expect_within(double got, double want, double tolerance) {
    if (!(fabs(got - want) <= tolerance)) fail_msg("got %.7g, expected %.7g +- %.2g", got, want, tolerance);
}

/* ---- pictures that must not change ---- */

static void test_even_light_stays_whatever_the_texture(void **state) {
    (void)state;
    struct screen s;
    screen_init(&s, 67, 35, 1);
    place_wall(&s, 0);
    for (size_t i = 0; i < pixels_of(&s); i++) {
        set_light(&s, i, 3);
        for (uint32_t c = 0; c < 3; c++) {
            s.g.plane.albedo[c][i] = 0.05f + 0.95f * noise(c, i);
            s.g.plane.emission[c][i] = noise(7 + c, i) > 0.8f ? 2.0f : 0.0f;
        }
    }
    for (int frame = 0; frame < 6; frame++) {
        filter(&s);
        for (size_t i = 0; i < 3 * pixels_of(&s); i++)
            expect_within((double)s.out[i], (double)s.radiance[i], 2e-5 * (double)s.radiance[i]);
    }
    screen_finish(&s);
}

static void test_edge_of_light_stays_sharp_without_noise(void **state) {
    (void)state;
    struct screen s;
    screen_init(&s, 64, 32, 1);
    place_wall(&s, 0);
    for (size_t i = 0; i < pixels_of(&s); i++) set_light(&s, i, i % 64 < 30 ? 1 : 20);
    for (int frame = 0; frame < 12; frame++) filter(&s);
    for (size_t i = 0; i < pixels_of(&s); i++)
        expect_within((double)seen(&s, i), (double)s.light[3 * i], 1e-2 * (double)s.light[3 * i]);
    screen_finish(&s);
}

static void test_sky_and_black_show_what_shines(void **state) {
    (void)state;
    struct screen s;
    screen_init(&s, 16, 16, 1);
    place_wall(&s, 0);
    for (size_t i = 0; i < pixels_of(&s); i++) {
        set_light(&s, i, noise(1, i));
        if (i % 5 == 0) s.g.plane.object[i] = LW_TRACE_MISS, s.g.plane.depth[i] = 0;
        for (int c = 0; c < 3; c++) {
            if (i % 5 == 0 || i % 7 == 0) s.g.plane.albedo[c][i] = 0;
            s.g.plane.emission[c][i] = i % 5 == 0 || i % 7 == 0 ? 4.0f : 0.0f;
        }
    }
    for (int frame = 0; frame < 3; frame++) filter(&s);
    for (size_t i = 0; i < pixels_of(&s); i++) {
        const float radiance = s.out[3 * i];
        if (i % 5 == 0 || i % 7 == 0)
            assert_true(radiance == 4.0f);
        else /* what black pixels do not know is no darkness */
            assert_true(radiance > 0.1f && radiance <= 0.5f);
    }
    screen_finish(&s);
}

static void test_channel_that_reflects_nothing_spoils_no_neighbour(void **state) {
    (void)state;
    struct screen s;
    screen_init(&s, 32, 16, 1);
    place_wall(&s, 0);
    for (size_t i = 0; i < pixels_of(&s); i++) {
        set_light(&s, i, 2);
        if (i % 2) s.g.plane.albedo[2][i] = 0;
    }
    for (int frame = 0; frame < 3; frame++) filter(&s);
    for (size_t i = 0; i < pixels_of(&s); i++) expect_within((double)s.out[3 * i + 2], i % 2 ? 0 : 1, 1e-5);
    screen_finish(&s);
}

/* ---- noise ---- */

struct spread {
    double mean, deviation;
};

static struct spread spread_of(const struct screen *s) {
    double sum = 0, squares = 0, n = (double)pixels_of(s);
    for (size_t i = 0; i < pixels_of(s); i++) {
        const double v = (double)seen(s, i);
        sum += v, squares += v * v;
    }
    return (struct spread){sum / n, sqrt(fmax(0, squares / n - sum / n * (sum / n)))};
}

static void fill_noise(struct screen *s, uint32_t seed) {
    for (size_t i = 0; i < pixels_of(s); i++)
        set_light(s, i, 2 * noise(seed, i)); /* mean 1, deviation 1/sqrt(3) */
}

static void test_noise_falls_and_the_mean_stays(void **state) {
    (void)state;
    struct screen s;
    screen_init(&s, 128, 128, 1);
    place_wall(&s, 0);
    fill_noise(&s, 1);
    filter(&s);
    /* 4.5 standard errors of the mean of 2^14 pixels; a tenth of the noise is far more than five levels
     * leave */
    struct spread first = spread_of(&s);
    expect_within(first.mean, 1, 4.5 * sqrt(1 / 3.0) / 128 + 0.005);
    assert_true(first.deviation < 0.1 * sqrt(1 / 3.0));
    for (uint32_t frame = 2; frame <= 32; frame++) {
        fill_noise(&s, frame);
        filter(&s);
    }
    struct spread later = spread_of(&s);
    assert_true(later.deviation < 0.9 * first.deviation);
    screen_finish(&s);
}

static double error_after(uint32_t frames, bool still) {
    struct screen s;
    screen_init(&s, 64, 64, 1);
    place_wall(&s, 0);
    s.g.still = still;
    for (uint32_t frame = 1; frame <= frames; frame++) {
        fill_noise(&s, frame);
        filter(&s);
    }
    struct spread spread = spread_of(&s);
    screen_finish(&s);
    return hypot(spread.deviation, spread.mean - 1);
}

static void test_still_picture_converges(void **state) {
    (void)state;
    enum { FRAMES = 256 };
    const double still = error_after(FRAMES, true);
    /* The mean of N frames is off by 1/sqrt(3 N) per pixel, before the filter. */
    assert_true(still < 0.2 / sqrt(3.0 * FRAMES));
    assert_true(still < 0.8 * error_after(FRAMES, false)); /* which forgets */
}

/* ---- edges ---- */

static void split_by_object(struct screen *s, size_t i) { s->g.plane.object[i] = 2; }
static void split_by_normal(struct screen *s, size_t i) {
    s->g.plane.normal[0][i] = 0.5f, s->g.plane.normal[2][i] = 0.8660254f;
}
static void split_by_depth(struct screen *s, size_t i) { s->g.plane.depth[i] = 0.5f / WALL_M; }

static void test_edges_are_not_crossed(void **state) {
    (void)state;
    void (*const split[])(struct screen *, size_t) = {split_by_object, split_by_normal, split_by_depth};
    for (int kind = 0; kind < 3; kind++) {
        struct screen s;
        screen_init(&s, 80, 24, 1);
        place_wall(&s, 0);
        for (size_t i = 0; i < pixels_of(&s); i++)
            if (i % 80 >= 40) split[kind](&s, i);
        for (uint32_t frame = 1; frame <= 3; frame++) {
            for (size_t i = 0; i < pixels_of(&s); i++) {
                set_light(&s, i, noise(frame, i));
                s.light[3 * i + 2] =
                    i % 80 < 40 ? 0 : 1; /* which weighs little in luminance: it marks the side */
            }
            filter(&s);
            for (size_t i = 0; i < pixels_of(&s); i++)
                expect_within((double)s.out[3 * i + 2], i % 80 < 40 ? 0 : 0.5, 1e-5);
        }
        screen_finish(&s);
    }
}

/* ---- history ---- */

static void test_what_comes_into_view_has_no_past(void **state) {
    (void)state;
    struct screen s;
    screen_init(&s, 64, 16, 1);
    place_wall(&s, 0);
    for (size_t i = 0; i < pixels_of(&s); i++) set_light(&s, i, 100);
    for (int frame = 0; frame < 8; frame++) filter(&s);
    for (size_t i = 0; i < pixels_of(&s); i++)
        if (i % 64 < 20) s.g.plane.object[i] = 9, set_light(&s, i, 1);
    filter(&s);
    for (size_t i = 0; i < pixels_of(&s); i++)
        expect_within((double)seen(&s, i), i % 64 < 20 ? 1 : 100, i % 64 < 20 ? 1e-4 : 1e-2);
    /* and nothing has after a reset */
    for (size_t i = 0; i < pixels_of(&s); i++) set_light(&s, i, 5);
    lw_svgf_reset(s.svgf);
    filter(&s);
    for (size_t i = 0; i < pixels_of(&s); i++) expect_within((double)seen(&s, i), 5, 1e-3);
    screen_finish(&s);
}

/* Stripes 4 pixels wide at column x of the wall, and noise of mean 0 over two frames. */
static float stripe(int64_t column, uint32_t frame) {
    const float noise_now = (frame & 1u) ? 0.5f : -0.5f;
    return ((column >> 2) & 1) ? 10 + noise_now : 1 + noise_now;
}

static void expect_stripes(const struct screen *s, int64_t shift, size_t margin) {
    for (size_t i = 0; i < pixels_of(s); i++) {
        const size_t x = i % s->g.width;
        if (x < margin || x + margin >= s->g.width) continue;
        const double want = (((int64_t)x + shift) >> 2) & 1 ? 10 : 1;
        expect_within((double)seen(s, i), want, 0.35);
    }
}

static void test_history_follows_the_camera(void **state) {
    (void)state;
    struct screen s;
    screen_init(&s, 96, 16, 1);
    const float step_m = pixel_m(&s) * 2; /* two pixels a frame: taps fall on pixels */
    for (uint32_t frame = 0; frame < 12; frame++) {
        s.g.camera.position.x = step_m * (float)frame;
        place_wall(&s, 0);
        for (size_t i = 0; i < pixels_of(&s); i++)
            set_light(&s, i, stripe((int64_t)(i % 96) + 2 * frame, frame));
        filter(&s);
    }
    expect_stripes(&s, 22, 26);
    screen_finish(&s);
}

static void test_history_follows_an_object(void **state) {
    (void)state;
    struct screen s;
    screen_init(&s, 96, 16, 1);
    const float step_m = pixel_m(&s) * 2;
    for (uint32_t frame = 0; frame < 12; frame++) {
        place_wall(&s, frame ? step_m : 0); /* it moves right */
        for (size_t i = 0; i < pixels_of(&s); i++)
            set_light(&s, i, stripe((int64_t)(i % 96) - 2 * frame + 96, frame));
        filter(&s);
    }
    expect_stripes(&s, 96 - 22, 26);
    screen_finish(&s);
}

static void test_history_gives_way_to_light_that_changes(void **state) {
    (void)state;
    struct screen s;
    screen_init(&s, 64, 64, 1);
    place_wall(&s, 0);
    for (uint32_t frame = 1; frame <= 40; frame++) {
        for (size_t i = 0; i < pixels_of(&s); i++)
            set_light(&s, i, (frame <= 32 || i % 64 < 32 ? 1.0f : 4.0f) * 2 * noise(frame, i));
        filter(&s);
    }
    /* Eight frames after 32: means of all would be 0.75 short of the right half's 4, of the last 32 as
     * much. */
    double left = 0, right = 0;
    for (size_t i = 0; i < pixels_of(&s); i++) {
        if (i % 64 < 24) left += (double)seen(&s, i) / (24 * 64);
        if (i % 64 >= 40) right += (double)seen(&s, i) / (24 * 64);
    }
    expect_within(left, 1, 0.05);
    expect_within(right, 4, 0.3);
    screen_finish(&s);
}

/* ---- robustness ---- */

static void fill_wild(struct screen *s, uint32_t seed) {
    for (size_t i = 0; i < pixels_of(s); i++) {
        s->g.plane.object[i] = lw_random_hash2(seed / 3, (uint32_t)i / 17) % 3;
        if (s->g.plane.object[i] == 2) s->g.plane.object[i] = LW_TRACE_MISS;
        set_light(s, i, 1e3f * noise(seed, i) * noise(seed + 100, i));
    }
}

static void test_threads_change_no_byte(void **state) {
    (void)state;
    struct screen one, three;
    screen_init(&one, 301, 77, 1);
    screen_init(&three, 301, 77, 3);
    for (uint32_t frame = 0; frame < 5; frame++) {
        one.g.camera.position.x = three.g.camera.position.x = 0.013f * (float)frame;
        place_wall(&one, 0), place_wall(&three, 0);
        fill_wild(&one, frame), fill_wild(&three, frame);
        filter(&one), filter(&three);
        assert_memory_equal(one.out, three.out, 3 * pixels_of(&one) * sizeof *one.out);
    }
    screen_finish(&one);
    screen_finish(&three);
}

static void test_any_size(void **state) {
    (void)state;
    const uint32_t size[][2] = {{1, 1}, {1, 40}, {40, 1}, {3, 5}, {257, 3}, {513, 2}};
    for (size_t k = 0; k < sizeof size / sizeof *size; k++) {
        struct screen s;
        screen_init(&s, size[k][0], size[k][1], 1);
        place_wall(&s, 0);
        for (int frame = 0; frame < 4; frame++) {
            for (size_t i = 0; i < pixels_of(&s); i++) set_light(&s, i, 2);
            filter(&s);
            for (size_t i = 0; i < pixels_of(&s); i++) expect_within((double)seen(&s, i), 2, 1e-4);
        }
        screen_finish(&s);
    }
}

static void test_what_is_not_finite_ends_with_its_frame(void **state) {
    (void)state;
    struct screen s;
    screen_init(&s, 32, 32, 1);
    place_wall(&s, 0);
    for (int frame = 0; frame < 4; frame++) {
        for (size_t i = 0; i < pixels_of(&s); i++) set_light(&s, i, 1 + noise(3, i));
        if (frame == 1)
            s.light[300] = NAN, s.light[600] = INFINITY, s.light[903] = -INFINITY, s.light[1200] = 3e38f;
        filter(&s);
        for (size_t i = 0; i < 3 * pixels_of(&s); i++) assert_true(isfinite(s.out[i]) && s.out[i] >= 0);
        if (frame == 3) assert_true(seen(&s, 100) > 0.1f && seen(&s, 200) > 0.1f && seen(&s, 301) > 0.1f);
    }
    screen_finish(&s);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_even_light_stays_whatever_the_texture),
        cmocka_unit_test(test_edge_of_light_stays_sharp_without_noise),
        cmocka_unit_test(test_sky_and_black_show_what_shines),
        cmocka_unit_test(test_channel_that_reflects_nothing_spoils_no_neighbour),
        cmocka_unit_test(test_noise_falls_and_the_mean_stays),
        cmocka_unit_test(test_still_picture_converges),
        cmocka_unit_test(test_edges_are_not_crossed),
        cmocka_unit_test(test_what_comes_into_view_has_no_past),
        cmocka_unit_test(test_history_follows_the_camera),
        cmocka_unit_test(test_history_follows_an_object),
        cmocka_unit_test(test_history_gives_way_to_light_that_changes),
        cmocka_unit_test(test_threads_change_no_byte),
        cmocka_unit_test(test_any_size),
        cmocka_unit_test(test_what_is_not_finite_ends_with_its_frame),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
