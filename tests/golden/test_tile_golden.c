#include "tests/support/support.h"

#include "common/base/random.h"
#include "common/tile/tile_codec.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Payloads of codec 4 that must stay readable for ever, and payloads that must stay refused. tile_decoder.mjs
 * reads the same files. NAME.tile: u32 width, u32 height, f32 scale, payload, little-endian. NAME.rgb: the
 * texels, or no file if it is to be refused. NAME.next, of the same form, builds on NAME.tile, and
 * NAME.next.rgb has its texels, or is not there. A name that begins with direction_ is of layer 2, all others
 * are light. LW_GOLDEN_WRITE=1 writes them again (then look at the difference: there should be none). */

#define FOLDER    "tests/golden/tiles/"
#define HEAD_SIZE 12u

static struct lw_tile_codec *codec;
static float rgb[LW_TILE_TEXELS_MAX * 3];
static uint8_t file_bytes[HEAD_SIZE + LW_TILE_TEXELS_MAX * 16];

static int set_up(void **state) {
    (void)state;
    return lw_tile_codec_create(&codec) == LW_OK ? 0 : -1;
}

static int tear_down(void **state) {
    (void)state;
    lw_tile_codec_destroy(codec);
    return 0;
}

static const char *path_of(const char *name, const char *suffix) {
    static char relative[300];
    snprintf(relative, sizeof relative, FOLDER "%s%s", name, suffix);
    return lw_support_source(relative);
}

/* Light as there is: a slope, an edge of shadow, colour, noise. */
static void make_light(uint32_t width, uint32_t height, float noise) {
    for (uint32_t i = 0; i < width * height; i++) {
        const float x = (float)(i % width), y = (float)(i / width);
        const float lit = x + 0.5f * y < 0.6f * (float)width ? 50 : 1;
        const float random = lw_random_unit(lw_random_hash(i)) - 0.5f;
        for (uint32_t c = 0; c < 3; c++)
            rgb[i * 3 + c] = lit * (1 + 0.02f * y + 0.1f * (float)c) * (1 + noise * random);
    }
}

/* Directions as there are: two surfaces whose light comes from either side, some texels without light. */
static void make_directions(uint32_t width, uint32_t height, float noise) {
    for (uint32_t i = 0; i < width * height; i++) {
        const float x = (float)(i % width), y = (float)(i / width);
        const bool is_left = x + 0.5f * y < 0.6f * (float)width, is_dark = lw_random_hash(i) % 16 == 0;
        const float even[3] = {is_left ? -0.7f : 0.2f, 0.4f - 0.01f * y, is_left ? 0.1f : -0.6f};
        for (uint32_t c = 0; c < 3; c++) {
            const float random = lw_random_unit(lw_random_hash2(i, c)) - 0.5f;
            rgb[i * 3 + c] = is_dark ? 0 : fmaxf(fminf(even[c] + noise * random, 1), -1);
        }
    }
}

static const struct {
    const char *name;
    uint32_t width, height;
    float noise, step;
} valid[] = {{"one_texel", 1, 1, 0, 0.1f},
             {"one_block", 8, 8, 0.1f, 0.25f},
             {"cut_off", 20, 13, 0.3f, 0.0625f},
             {"row", 64, 1, 0.1f, 1},
             {"fine", 16, 16, 1, 0},
             {"whole", 64, 64, 0.5f, 0.5f},
             {"direction_one_texel", 1, 1, 0, 0.1f},
             {"direction_cut_off", 20, 13, 0.1f, 0.0625f},
             {"direction_fine", 16, 16, 0.4f, 0},
             {"direction_whole", 64, 64, 0.2f, 0.25f}};

/* NULL: light. */
static const struct lw_tile_channel *channel_of(const char *name) {
    const bool is_direction = strncmp(name, "direction_", 10) == 0;
    return is_direction ? lw_tile_channel_at(LW_TILE_CHANNEL_DIRECTION) : NULL;
}

static struct lw_tile_dct_source source_of(size_t i) {
    const struct lw_tile_channel *channel = channel_of(valid[i].name);
    (channel ? make_directions : make_light)(valid[i].width, valid[i].height, valid[i].noise);
    return (struct lw_tile_dct_source){.channel = channel,
                                       .rgb = rgb,
                                       .width = valid[i].width,
                                       .height = valid[i].height,
                                       .step = valid[i].step};
}

/* A change of such a file that makes it one which no reader accepts. */
static const struct {
    const char *name, *from;
    int cut, add; /* bytes at the end; a byte of that value is added */
    size_t at;    /* a byte of the payload that is set */
    uint8_t to;
} invalid[] = {{"invalid_empty", "one_texel", 1000, -1, 0, 0},
               {"invalid_cut", "whole", 1, -1, 0, 1},
               {"invalid_cut_twice", "whole", 2, -1, 0, 1},
               {"invalid_longer", "whole", 0, 0, 0, 1},
               {"invalid_rest", "one_block", 0, 128, 0, 1},
               {"invalid_kind", "one_block", 0, -1, 0, 2},
               {"invalid_kind_zero", "one_block", 0, -1, 0, 0},
               {"invalid_step", "one_block", 0, -1, 1, 73},
               {"invalid_length", "one_texel", 0, -1, 5, 0x7f},
               {"direction_invalid_gain", "direction_one_texel", 0, -1, 4, 1},
               {"direction_invalid_cut", "direction_whole", 1, -1, 0, 1}};

/* Deltas, of a tile that grows in its first rows: on `valid` of that name. */
static const char *const next[] = {"cut_off", "whole", "direction_cut_off", "direction_whole"};

static void write_valid(void) {
    for (size_t i = 0; i < sizeof valid / sizeof *valid; i++) {
        const uint32_t size_of[] = {valid[i].width, valid[i].height};
        struct lw_tile_dct_coded coded;
        const struct lw_tile_dct_source source = source_of(i);
        lw_support_ok(lw_tile_codec_encode_dct(codec, &source, NULL, file_bytes + HEAD_SIZE, NULL,
                                               sizeof file_bytes - HEAD_SIZE, &coded),
                      NULL);
        memcpy(file_bytes, size_of, sizeof size_of);
        memcpy(file_bytes + 8, &coded.scale, sizeof coded.scale);
        lw_support_write_file(path_of(valid[i].name, ".tile"), file_bytes, HEAD_SIZE + coded.size);
        lw_support_ok(lw_tile_codec_decode(codec, source.channel, LW_TILE_CODEC_DCT, file_bytes + HEAD_SIZE,
                                           coded.size, coded.scale, source.width, source.height, NULL, rgb),
                      NULL);
        lw_support_write_file(path_of(valid[i].name, ".rgb"), rgb,
                              (size_t)valid[i].width * valid[i].height * 12);
    }
}

static void write_next(void) {
    static struct lw_tile_dct_history history;
    static uint8_t payload[LW_TILE_TEXELS_MAX * 16];
    for (size_t n = 0; n < sizeof next / sizeof *next; n++)
        for (size_t i = 0; i < sizeof valid / sizeof *valid; i++) {
            const uint32_t size_of[] = {valid[i].width, valid[i].height};
            struct lw_tile_dct_coded coded;
            if (strcmp(next[n], valid[i].name) != 0) continue;
            const struct lw_tile_dct_source source = source_of(i);
            history = (struct lw_tile_dct_history){.scale = 0};
            for (int version = 0; version < 2; version++) {
                lw_support_ok(lw_tile_codec_encode_dct(codec, &source, &history, payload,
                                                       file_bytes + HEAD_SIZE, sizeof payload, &coded),
                              NULL);
                for (uint32_t t = 0; t < 3 * valid[i].width * 5; t++) rgb[t] *= 1.4f;
            }
            memcpy(file_bytes, size_of, sizeof size_of);
            memcpy(file_bytes + 8, &coded.scale, sizeof coded.scale);
            lw_support_write_file(path_of(valid[i].name, ".next"), file_bytes, HEAD_SIZE + coded.delta_size);
            lw_support_ok(lw_tile_codec_decode(codec, source.channel, LW_TILE_CODEC_DCT, payload, coded.size,
                                               coded.scale, source.width, source.height, NULL, rgb),
                          NULL);
            lw_support_write_file(path_of(valid[i].name, ".next.rgb"), rgb,
                                  (size_t)valid[i].width * valid[i].height * 12);
        }
}

static void write_invalid(void) {
    for (size_t i = 0; i < sizeof invalid / sizeof *invalid; i++) {
        size_t size;
        uint8_t *from = lw_support_read_file(path_of(invalid[i].from, ".tile"), &size);
        size_t cut = (size_t)invalid[i].cut < size - HEAD_SIZE ? (size_t)invalid[i].cut : size - HEAD_SIZE;
        memcpy(file_bytes, from, size -= cut);
        if (size > HEAD_SIZE) file_bytes[HEAD_SIZE + invalid[i].at] = invalid[i].to;
        if (invalid[i].add >= 0) file_bytes[size++] = (uint8_t)invalid[i].add;
        lw_support_write_file(path_of(invalid[i].name, ".tile"), file_bytes, size);
        free(from);
    }
}

struct head {
    uint32_t width, height;
    float scale;
};

/* Decodes a file; false if it is refused. */
static bool decode(const char *name, bool is_next, struct lw_tile_dct_coefficients *coefficients,
                   struct head *out_head) {
    size_t size;
    uint8_t *bytes = lw_support_read_file(path_of(name, is_next ? ".next" : ".tile"), &size);
    memcpy(out_head, bytes, sizeof *out_head);
    enum lw_status status = (is_next ? lw_tile_codec_decode_delta : lw_tile_codec_decode)(
        codec, channel_of(name), LW_TILE_CODEC_DCT, bytes + HEAD_SIZE, size - HEAD_SIZE, out_head->scale,
        out_head->width, out_head->height, coefficients, rgb);
    free(bytes);
    assert_true(status == LW_OK || status == LW_BAD_DATA);
    return status == LW_OK;
}

static void expect_texels(const char *name, const char *suffix, const struct head *head) {
    size_t size;
    float *expected = (float *)lw_support_read_file(path_of(name, suffix), &size);
    assert_int_equal(size, (size_t)head->width * head->height * 12);
    for (uint32_t i = 0; i < head->width * head->height * 3; i++)
        assert_true(fabsf(rgb[i] - expected[i]) <= 0.0001f * (fabsf(expected[i]) + head->scale));
    free(expected);
}

static void test_valid(void **state) {
    (void)state;
    if (getenv("LW_GOLDEN_WRITE")) write_valid();
    for (size_t i = 0; i < sizeof valid / sizeof *valid; i++) {
        struct head head;
        assert_true(decode(valid[i].name, false, NULL, &head));
        expect_texels(valid[i].name, ".rgb", &head);
    }
}

static void test_next(void **state) {
    (void)state;
    if (getenv("LW_GOLDEN_WRITE")) write_next();
    for (size_t i = 0; i < sizeof next / sizeof *next; i++) {
        static struct lw_tile_dct_coefficients coefficients;
        struct head head;
        assert_true(decode(next[i], false, &coefficients, &head));
        assert_true(decode(next[i], true, &coefficients, &head));
        expect_texels(next[i], ".next.rgb", &head);
    }
}

static void test_invalid(void **state) {
    (void)state;
    if (getenv("LW_GOLDEN_WRITE")) write_invalid();
    for (size_t i = 0; i < sizeof invalid / sizeof *invalid; i++) {
        struct head head;
        if (decode(invalid[i].name, false, NULL, &head)) fail_msg("%s was read", invalid[i].name);
    }
}

/* No file that nobody reads. */
static void test_folder(void **state) {
    (void)state;
    assert_int_equal(lw_support_count_files(FOLDER),
                     2 * (sizeof valid / sizeof *valid + sizeof next / sizeof *next) +
                         sizeof invalid / sizeof *invalid);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_valid), cmocka_unit_test(test_next),
                                       cmocka_unit_test(test_invalid), cmocka_unit_test(test_folder)};
    return cmocka_run_group_tests(tests, set_up, tear_down);
}
