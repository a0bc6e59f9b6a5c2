/* What texels of pictures become in finishes. */
#include "tests/support/support.h"

#include "server/import/images/finish_texels.h"

#include <math.h>
#include <string.h>

static struct lw_vec3 normal_of(const uint8_t *texel) {
    return lw_vec3(((float)texel[0] - 127.5f) / 127.5f, ((float)texel[1] - 127.5f) / 127.5f,
                   ((float)texel[2] - 127.5f) / 127.5f);
}

static void every_normal_becomes_unit(void **state) {
    (void)state;
    static uint8_t texels[52 * 52 * 52][4];
    for (unsigned i = 0; i < 52 * 52 * 52; i++) {
        const uint8_t texel[4] = {(uint8_t)(5 * (i % 52)), (uint8_t)(5 * (i / 52 % 52)),
                                  (uint8_t)(5 * (i / 52 / 52)), 7};
        memcpy(texels[i], texel, 4);
    }
    lw_finish_texels_normal(texels[0], 52 * 52 * 52);
    for (unsigned i = 0; i < 52 * 52 * 52; i++) {
        assert_float_equal(lw_vec3_length(normal_of(texels[i])), 1, 0.02);
        assert_true(texels[i][2] >= 127 && texels[i][3] == 255);
    }
}

static void normals_of_no_length_are_even(void **state) {
    (void)state;
    static const struct {
        uint8_t from[4];
        size_t odd;
        float x, y;
    } cases[] = {
        {{128, 128, 255, 255}, 0, 0, 0},
        {{218, 128, 218, 255}, 0, 0.707f, 0},
        {{128, 128, 128, 255}, 1, 0, 0},
        {{0, 0, 0, 255}, 1, 0, 0}, /* none; black */
        {{204, 128, 0, 255}, 1, 0.6f, 0},
        {{255, 255, 255, 255}, 0, 0.577f, 0.577f}, /* two channels; white */
        {{160, 128, 160, 255}, 0, 0.707f, 0}       /* short */
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        uint8_t texel[4];
        memcpy(texel, cases[i].from, 4);
        assert_int_equal(lw_finish_texels_normal(texel, 1), cases[i].odd);
        const struct lw_vec3 n = normal_of(texel);
        if (fabsf(n.x - cases[i].x) > 0.013f || fabsf(n.y - cases[i].y) > 0.013f)
            fail_msg("case %zu: (%g, %g)", i, (double)n.x, (double)n.y);
    }
}

/* A rounding of the file is no reason to move its bytes. */
static void unit_normals_keep_their_bytes(void **state) {
    (void)state;
    for (int i = 0; i < 90; i++) {
        const float a = (float)i * LW_PI / 180;
        const uint8_t from[4] = {(uint8_t)lrintf(127.5f + 127.5f * sinf(a)), 128,
                                 (uint8_t)lrintf(127.5f + 127.5f * cosf(a)), 255};
        uint8_t texel[4];
        memcpy(texel, from, 4);
        lw_finish_texels_normal(texel, 1);
        assert_memory_equal(texel, from, 2);
    }
}

static void pictures_of_normals_are_distinguished_from_heights(void **state) {
    (void)state;
    const uint8_t normals[8] = {100, 128, 250, 255, 150, 128, 250, 255},
                  grey[8] = {100, 100, 100, 255, 250, 250, 250, 255},
                  blue[8] = {0, 0, 255, 255, 0, 0, 255, 255};
    assert_true(lw_finish_texels_are_normals(normals, 2));
    assert_false(lw_finish_texels_are_normals(grey, 2));
    assert_false(lw_finish_texels_are_normals(blue, 2));
}

static void glossiness_is_taken_apart(void **state) {
    (void)state;
    uint8_t picture[8] = {10, 20, 30, 255, 40, 50, 60, 51}, surface[8];
    lw_finish_texels_gloss(picture, 2, 0.5f, surface);
    const uint8_t colour[8] = {10, 20, 30, 255, 40, 50, 60, 255};
    assert_memory_equal(picture, colour, 8);
    assert_int_equal(surface[1], 128); /* 1 - 0.5 */
    assert_int_equal(surface[5], 230); /* 1 - 0.5 x 0.2 = 0.9 */
    assert_int_equal(surface[3], 255);
}

/* A ramp that rises by 1 over the picture's side has the slope LW_FINISH_TEXELS_RELIEF. */
static void heights_become_slopes(void **state) {
    (void)state;
    enum { SIDE = 128 };
    static uint8_t ramp[SIDE * SIDE * 4], out[SIDE * SIDE * 4];
    struct lw_texture texture = {
        .width = SIDE, .height = SIDE, .wrap_s = LW_WRAP_CLAMP, .wrap_t = LW_WRAP_CLAMP};
    for (int up = 0; up < 2; up++) {
        for (int i = 0; i < SIDE * SIDE; i++)
            memset(ramp + 4 * i, 2 * (up ? SIDE - 1 - i / SIDE : i % SIDE), 4);
        lw_finish_texels_height(ramp, &texture, out);
        /* 2/255 a texel, 128 texels */
        const float slope = LW_FINISH_TEXELS_RELIEF * SIDE * 2 / 255, x = slope / sqrtf(1 + slope * slope);
        const struct lw_vec3 n = normal_of(out + 4 * (SIDE / 2 * SIDE + SIDE / 2));
        assert_float_equal(up ? n.y : n.x, -x, 0.005);
        assert_float_equal(up ? n.x : n.y, 0, 0.005);
    }
    /* beyond the edge it begins again: there is a cliff, or none */
    texture.wrap_t = LW_WRAP_REPEAT;
    lw_finish_texels_height(ramp, &texture, out);
    assert_true(normal_of(out).y > 0.5f);
    texture.wrap_t = LW_WRAP_MIRROR;
    lw_finish_texels_height(ramp, &texture, out);
    assert_true(fabsf(normal_of(out).y) < 0.02f);
    /* one texel */
    texture.width = texture.height = 1;
    lw_finish_texels_height(ramp, &texture, out);
    assert_int_equal(out[2], 255);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_normal_becomes_unit),
        cmocka_unit_test(normals_of_no_length_are_even),
        cmocka_unit_test(unit_normals_keep_their_bytes),
        cmocka_unit_test(pictures_of_normals_are_distinguished_from_heights),
        cmocka_unit_test(glossiness_is_taken_apart),
        cmocka_unit_test(heights_become_slopes),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
