#include "tests/support/support.h"

#include "common/base/random.h"
#include "common/tile/tile_dct.h"

#include <math.h>
#include <string.h>

static struct lw_tile_dct dct;
static float rgb[LW_TILE_TEXELS_MAX * 3], back[LW_TILE_TEXELS_MAX * 3];
static uint8_t covered[LW_TILE_TEXELS_MAX], payload[LW_TILE_DCT_BOUND];

static int set_up(void **state) {
    (void)state;
    lw_tile_dct_init(&dct);
    return 0;
}

/* A slope with an edge of shadow, in colours; noise: relative, uniform. */
static void make_light(uint32_t width, uint32_t height, float noise, uint32_t seed) {
    for (uint32_t i = 0; i < width * height; i++) {
        const float x = (float)(i % width), y = (float)(i / width), lit = x + y < 40 ? 3 : 0.4f;
        for (uint32_t c = 0; c < 3; c++)
            rgb[i * 3 + c] = lit * (1 + 0.01f * x) * (1 + 0.2f * (float)c) *
                             (1 + noise * (2 * lw_random_unit(lw_random_hash3(i, c, seed)) - 1));
    }
}

static size_t encode(uint32_t width, uint32_t height, const uint8_t *mask, float step, float *out_scale) {
    struct lw_tile_dct_coded coded;
    lw_tile_dct_encode(&dct, &(struct lw_tile_dct_source){rgb, mask, width, height, step, 0, NULL}, NULL,
                       payload, NULL, &coded);
    assert_int_equal(coded.saturated, 0);
    assert_true(coded.size <= sizeof payload && coded.delta_size == 0);
    *out_scale = coded.scale;
    return coded.size;
}

static size_t round_trip(uint32_t width, uint32_t height, float step, float *out_scale) {
    const size_t size = encode(width, height, NULL, step, out_scale);
    assert_true(lw_tile_dct_decode(&dct, NULL, LW_TILE_DCT_INTRA, payload, size, *out_scale, width, height,
                                   NULL, back));
    return size;
}

static double mean_of(const float *light, uint32_t texels, uint32_t channel) {
    double sum = 0;
    for (uint32_t i = 0; i < texels; i++) sum += (double)light[i * 3 + channel];
    return sum / texels;
}

/* Root mean square of the error of log2(1 + E/scale). */
static double log_error(uint32_t texels, float scale) {
    double sum = 0;
    for (uint32_t i = 0; i < texels * 3; i++) {
        const double off = (double)(log2f(1 + back[i] / scale) - log2f(1 + rgb[i] / scale));
        sum += off * off;
    }
    return sqrt(sum / (texels * 3));
}

static const struct {
    uint32_t width, height;
} sizes[] = {{64, 64}, {36, 20}, {1, 1}, {1, 64}, {64, 7}, {9, 8}, {8, 9}};

/* No coefficient is off by more than 0.56 steps, so no plane by more in the root mean square; the three
 * channels see the sum of three planes. With many coefficients that are not 0, 0.29 takes the place of
 * 0.56. */
static void test_error_follows_the_step(void **state) {
    (void)state;
    const double planes = sqrt(8.0 / 3);
    const float steps[] = {2, 1, 0.25f, 0.05f, 0x1p-8f};
    for (size_t s = 0; s < sizeof sizes / sizeof *sizes; s++)
        for (size_t i = 0; i < sizeof steps / sizeof *steps; i++) {
            const uint32_t texels = sizes[s].width * sizes[s].height;
            const double step = (double)steps[i];
            float scale;
            make_light(sizes[s].width, sizes[s].height, 0.2f, (uint32_t)s);
            round_trip(sizes[s].width, sizes[s].height, steps[i], &scale);
            assert_true(log_error(texels, scale) <= 0.57 * planes * step);
            if (texels >= 720 && step < 0.1) assert_true(log_error(texels, scale) <= 0.32 * planes * step);
        }
}

static void expect_means(uint32_t texels) {
    for (uint32_t c = 0; c < 3; c++)
        assert_true(fabs(mean_of(back, texels, c) / mean_of(rgb, texels, c) - 1) <= 0.001);
}

/* With a step over the noise nothing of it is left; the logarithms' mean would be 18 % too dark. */
static void test_mean_is_kept(void **state) {
    (void)state;
    float scale;
    make_light(64, 64, 0.95f, 1);
    round_trip(64, 64, 1, &scale);
    expect_means(LW_TILE_TEXELS_MAX);
    /* A texel that is most of the light, and off by up to a factor of 1.4: more than gains make up for. */
    for (float bright = 1e3f; bright < 1e7f; bright *= 1.5f) {
        make_light(64, 64, 0, 1);
        for (uint32_t c = 0; c < 3; c++) rgb[100 * 3 + c] = bright;
        round_trip(64, 64, 1, &scale);
        expect_means(LW_TILE_TEXELS_MAX);
    }
}

static void test_noise_under_the_step_costs_little(void **state) {
    (void)state;
    float scale;
    make_light(64, 64, 0, 1);
    const size_t clean = round_trip(64, 64, 1, &scale);
    make_light(64, 64, 0.2f, 1); /* 0.17 in units of log2 */
    const size_t noisy = round_trip(64, 64, 1, &scale);
    assert_true(noisy < clean + clean / 4);
    make_light(64, 64, 0.2f, 1);
    assert_true(round_trip(64, 64, 0.05f, &scale) > 3 * noisy);
}

/* What nobody reads: other values there are the same bytes, and next to none. */
static void test_uncovered_texels_cost_nothing(void **state) {
    (void)state;
    static uint8_t first[LW_TILE_DCT_BOUND];
    float scale;
    for (uint32_t i = 0; i < LW_TILE_TEXELS_MAX; i++) covered[i] = i % 64 < 32 && i / 64 < 29;
    make_light(64, 64, 0, 1);
    const size_t size = encode(64, 64, covered, 0.1f, &scale);
    memcpy(first, payload, size);
    for (uint32_t i = 0; i < LW_TILE_TEXELS_MAX * 3; i++)
        if (!covered[i / 3]) rgb[i] = i % 5 ? 1000 * (float)(i % 7) : NAN;
    assert_int_equal(encode(64, 64, covered, 0.1f, &scale), size);
    assert_memory_equal(first, payload, size);
    assert_true(lw_tile_dct_decode(&dct, NULL, LW_TILE_DCT_INTRA, payload, size, scale, 64, 64, NULL, back));
    for (uint32_t i = 0; i < LW_TILE_TEXELS_MAX * 3; i++)
        if (covered[i / 3]) assert_true(fabsf(log2f(1 + back[i] / scale) - log2f(1 + rgb[i] / scale)) < 0.3f);
    memset(covered, 0, sizeof covered);
    assert_true(encode(64, 64, covered, 0.1f, &scale) < 40);
}

static void test_one_texel_black_and_flat(void **state) {
    (void)state;
    float scale;
    memset(rgb, 0, sizeof rgb);
    assert_true(round_trip(64, 64, 0.1f, &scale) < 40);
    for (uint32_t i = 0; i < LW_TILE_TEXELS_MAX * 3; i++) assert_true(back[i] == 0);
    for (float light = 1e-20f; light < 1e25f; light *= 1e5f) {
        for (uint32_t i = 0; i < LW_TILE_TEXELS_MAX * 3; i++) rgb[i] = light;
        assert_true(round_trip(64, 64, 0.05f, &scale) < 60);
        for (uint32_t i = 0; i < LW_TILE_TEXELS_MAX * 3; i++)
            assert_true(light < 1e-17f || fabsf(back[i] / light - 1) < 0.002f);
    }
}

static void test_what_has_no_number_is_counted(void **state) {
    (void)state;
    for (uint32_t i = 0; i < 192; i++) rgb[i] = 2;
    rgb[3] = NAN;
    rgb[4] = INFINITY;
    rgb[5] = -1;
    struct lw_tile_dct_coded coded;
    lw_tile_dct_encode(&dct, &(struct lw_tile_dct_source){rgb, NULL, 8, 8, 0.01f, 0, NULL}, NULL, payload,
                       NULL, &coded);
    assert_int_equal(coded.saturated, 3);
    assert_true(lw_tile_dct_decode(&dct, NULL, LW_TILE_DCT_INTRA, payload, coded.size, coded.scale, 8, 8,
                                   NULL, back));
    assert_true(back[3] < 0.1f && fabsf(back[6] - 2) < 0.1f);
}

static void expect_harmless(size_t size, float scale) {
    const uint32_t values = 12 * 12 * 3;
    for (uint32_t i = 0; i < 16; i++) back[values + i] = 77; /* past the tile */
    if (lw_tile_dct_decode(&dct, NULL, LW_TILE_DCT_INTRA, payload, size, scale, 12, 12, NULL, back))
        for (uint32_t i = 0; i < values; i++) assert_true(isfinite(back[i]) && back[i] >= 0);
    for (uint32_t i = 0; i < 16; i++) assert_true(back[values + i] == 77);
}

static void test_hostile_payloads_are_refused(void **state) {
    (void)state;
    float scale;
    make_light(12, 12, 0.5f, 1);
    const size_t size = encode(12, 12, NULL, 0.3f, &scale);
    for (size_t n = 0; n < size; n++)
        assert_false(
            lw_tile_dct_decode(&dct, NULL, LW_TILE_DCT_INTRA, payload, n, scale, 12, 12, NULL, back));
    payload[size] = 0;
    assert_false(
        lw_tile_dct_decode(&dct, NULL, LW_TILE_DCT_INTRA, payload, size + 1, scale, 12, 12, NULL, back));
    const float bad[] = {0, -1, NAN, INFINITY, 0x1p61f};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
        assert_false(
            lw_tile_dct_decode(&dct, NULL, LW_TILE_DCT_INTRA, payload, size, bad[i], 12, 12, NULL, back));
    assert_false(lw_tile_dct_decode(&dct, NULL, LW_TILE_DCT_INTRA, payload, size, scale, 0, 12, NULL, back));
    assert_false(lw_tile_dct_decode(&dct, NULL, LW_TILE_DCT_INTRA, payload, size, scale, 12, 65, NULL, back));
    for (size_t bit = 0; bit < size * 8; bit++) {
        payload[bit / 8] ^= (uint8_t)(1u << bit % 8);
        expect_harmless(size, 0x1p60f);
        payload[bit / 8] ^= (uint8_t)(1u << bit % 8);
    }
    for (uint32_t seed = 0; seed < 2000; seed++) {
        for (size_t i = 5; i < 200; i++)
            payload[i] = (uint8_t)lw_random_hash2((uint32_t)i, seed) | (seed & 1 ? 0x7f : 0);
        expect_harmless(200, 0x1p60f);
    }
}

/* Light that goes on changing a little: each version is the same bit by bit from its delta and from
 * itself. */
static void test_deltas(void **state) {
    (void)state;
    static struct lw_tile_dct_history history;
    static struct lw_tile_dct_coefficients coefficients;
    static float whole[LW_TILE_TEXELS_MAX * 3];
    static uint8_t delta[LW_TILE_DCT_BOUND];
    for (size_t s = 0; s < sizeof sizes / sizeof *sizes; s++) {
        const uint32_t width = sizes[s].width, height = sizes[s].height;
        struct lw_tile_dct_source source = {rgb, NULL, width, height, 0.25f, 0, NULL};
        struct lw_tile_dct_coded coded;
        history = (struct lw_tile_dct_history){.scale = 0};
        size_t all = 0, deltas = 0;
        for (uint32_t version = 0; version < 5; version++) {
            make_light(width, height, 0.1f, 1);
            for (uint32_t i = 0; i < width * 3; i++) rgb[i] *= 1 + 0.3f * (float)version;
            lw_tile_dct_encode(&dct, &source, &history, payload, delta, &coded);
            const bool has_delta = coded.delta_size > 0;
            assert_int_equal(has_delta, version > 0);
            all += coded.size;
            deltas += has_delta ? coded.delta_size : coded.size;
            assert_true(lw_tile_dct_decode(&dct, NULL, LW_TILE_DCT_INTRA, payload, coded.size, coded.scale,
                                           width, height, has_delta ? NULL : &coefficients, whole));
            assert_false(has_delta &&
                         lw_tile_dct_decode(&dct, NULL, LW_TILE_DCT_INTRA, delta, coded.delta_size,
                                            coded.scale, width, height, NULL, back));
            assert_false(lw_tile_dct_decode(&dct, NULL, LW_TILE_DCT_DELTA, payload, coded.size, coded.scale,
                                            width, height, &coefficients, back));
            if (!has_delta) continue;
            assert_true(lw_tile_dct_decode(&dct, NULL, LW_TILE_DCT_DELTA, delta, coded.delta_size,
                                           coded.scale, width, height, &coefficients, back));
            assert_memory_equal(back, whole, (size_t)width * height * 3 * sizeof *back);
            for (uint32_t i = 0; i < width * height * 3; i++)
                assert_true(fabsf(log2f((1 + back[i] / coded.scale) / (1 + rgb[i] / coded.scale))) < 1);
        }
        assert_true(width * height < 100 || deltas < all / 2);
        for (uint32_t i = 0; i < width * height * 3; i++) rgb[i] *= 1000; /* another scale: no delta */
        lw_tile_dct_encode(&dct, &source, &history, payload, delta, &coded);
        assert_int_equal(coded.delta_size, 0);
    }
}

/* A decoder with version 0 gets to version 4 in one step, for fewer bytes than by the versions between. */
static void test_one_delta_over_several_versions(void **state) {
    (void)state;
    static struct lw_tile_dct_history history;
    static struct lw_tile_dct_coefficients coefficients, scratch[2];
    static float whole[LW_TILE_TEXELS_MAX * 3];
    static uint8_t delta[LW_TILE_DCT_BOUND], first[LW_TILE_DCT_BOUND], jump[LW_TILE_DCT_BOUND];
    for (size_t s = 0; s < sizeof sizes / sizeof *sizes; s++) {
        const uint32_t width = sizes[s].width, height = sizes[s].height;
        struct lw_tile_dct_coded coded = {0};
        history = (struct lw_tile_dct_history){.scale = 0};
        size_t first_size = 0, chain = 0;
        for (uint32_t version = 0; version < 5; version++) {
            make_light(width, height, 0.1f, 1 + version);
            lw_tile_dct_encode(&dct, &(struct lw_tile_dct_source){rgb, NULL, width, height, 0.1f, 0, NULL},
                               &history, payload, delta, &coded);
            if (version) chain += coded.delta_size;
            if (version) continue;
            memcpy(first, payload, first_size = coded.size);
            assert_true(lw_tile_dct_decode(&dct, NULL, LW_TILE_DCT_INTRA, first, first_size, coded.scale,
                                           width, height, &coefficients, back));
        }
        assert_true(lw_tile_dct_decode(&dct, NULL, LW_TILE_DCT_INTRA, payload, coded.size, coded.scale, width,
                                       height, NULL, whole));
        const size_t size = lw_tile_dct_encode_between(&dct, NULL, first, first_size, payload, coded.size,
                                                       width, height, scratch, jump);
        assert_true(size > 0 && (width * height < 100 || size < chain / 2));
        assert_true(lw_tile_dct_decode(&dct, NULL, LW_TILE_DCT_DELTA, jump, size, coded.scale, width, height,
                                       &coefficients, back));
        assert_memory_equal(back, whole, (size_t)width * height * 3 * sizeof *back);
        assert_int_equal(lw_tile_dct_encode_between(&dct, NULL, first, first_size - 1, payload, coded.size,
                                                    width, height, scratch, jump),
                         0);
        assert_int_equal(lw_tile_dct_encode_between(&dct, NULL, first, first_size, delta, coded.delta_size,
                                                    width, height, scratch, jump),
                         0);
    }
}

/* What a newcomer gets in place of a whole payload and the deltas after it is the newest one, bit by bit. */
static void test_sum_of_a_payload_and_its_deltas(void **state) {
    (void)state;
    static struct lw_tile_dct_history history;
    static struct lw_tile_dct_coefficients scratch;
    static uint8_t delta[LW_TILE_DCT_BOUND], sum[2][LW_TILE_DCT_BOUND];
    static float whole[LW_TILE_TEXELS_MAX * 3];
    for (size_t s = 0; s < sizeof sizes / sizeof *sizes; s++) {
        const uint32_t width = sizes[s].width, height = sizes[s].height;
        struct lw_tile_dct_coded coded = {0};
        history = (struct lw_tile_dct_history){.scale = 0};
        size_t size = 0;
        for (uint32_t version = 0; version < 5; version++) {
            make_light(width, height, 0.1f, 1 + version);
            lw_tile_dct_encode(&dct, &(struct lw_tile_dct_source){rgb, NULL, width, height, 0.1f, 0, NULL},
                               &history, payload, delta, &coded);
            uint8_t *from = sum[version % 2], *to = sum[1 - version % 2];
            if (!version) {
                memcpy(to, payload, size = coded.size);
                continue;
            }
            assert_true(coded.delta_size > 0);
            assert_int_equal(lw_tile_dct_encode_sum(&dct, NULL, from, size - 1, delta, coded.delta_size,
                                                    width, height, &scratch, to),
                             0);
            assert_int_equal(lw_tile_dct_encode_sum(&dct, NULL, delta, coded.delta_size, from, size, width,
                                                    height, &scratch, to),
                             0);
            size = lw_tile_dct_encode_sum(&dct, NULL, from, size, delta, coded.delta_size, width, height,
                                          &scratch, to);
            assert_int_equal(size, coded.size);
            assert_memory_equal(to, payload, size);
        }
        assert_true(lw_tile_dct_decode(&dct, NULL, LW_TILE_DCT_INTRA, sum[1], size, coded.scale, width,
                                       height, NULL, back));
        assert_true(lw_tile_dct_decode(&dct, NULL, LW_TILE_DCT_INTRA, payload, coded.size, coded.scale, width,
                                       height, NULL, whole));
        assert_memory_equal(back, whole, (size_t)width * height * 3 * sizeof *back);
    }
}

/* A mean past 16 bits is one that no delta builds on: there is no sum. */
static void test_sum_past_16_bits(void **state) {
    (void)state;
    static struct lw_tile_dct_coefficients scratch;
    static uint8_t sum[LW_TILE_DCT_BOUND];
    const uint8_t delta[] = {LW_TILE_DCT_DELTA, 8, 0, 0, 0, 0x66, 0x48, 1, 0, 0};
    struct lw_tile_dct_coded coded;
    for (uint32_t i = 0; i < 3; i++) rgb[i] = 1;
    lw_tile_dct_encode(&dct, &(struct lw_tile_dct_source){rgb, NULL, 1, 1, 0.1f, 0, NULL}, NULL, payload,
                       NULL, &coded);
    size_t size = coded.size, sums = 0;
    assert_true(lw_tile_dct_encode_sum(&dct, NULL, payload, size, delta, sizeof delta, 1, 1, &scratch, sum));
    for (size_t next; sums < 40000; sums++, size = next) { /* one step more each time */
        next = lw_tile_dct_encode_sum(&dct, NULL, payload, size, delta, sizeof delta, 1, 1, &scratch, sum);
        if (!next) break;
        memcpy(payload, sum, next);
    }
    assert_true(sums > 32000 && sums < 32768);
}

/* A coefficient that is kept as the largest may be a larger one. */
static void test_nothing_is_coded_between_coefficients_beyond_16_bits(void **state) {
    (void)state;
    static struct lw_tile_dct_coefficients scratch[2];
    static uint8_t jump[LW_TILE_DCT_BOUND];
    /* one coefficient, of the mean of means */
    for (uint32_t i = 0; i < LW_TILE_TEXELS_MAX * 3; i++) rgb[i] = 1;
    for (int fine = 0; fine < 2; fine++) {
        struct lw_tile_dct_coded coded;
        const float step = fine ? 0x1p-8f : 0.1f;
        lw_tile_dct_encode(&dct, &(struct lw_tile_dct_source){rgb, NULL, 64, 64, step, 0, NULL}, NULL,
                           payload, NULL, &coded);
        const bool fits = lw_tile_dct_encode_between(&dct, NULL, payload, coded.size, payload, coded.size, 64,
                                                     64, scratch, jump) > 0;
        assert_int_equal(fits, !fine);
    }
}

/* Coefficient after coefficient up to the most that is kept, and one past it. */
static void test_sums_have_a_limit(void **state) {
    (void)state;
    static struct lw_tile_dct_coefficients coefficients;
    /* One texel, of which the mean of plane Y grows by one: the example of wire_format.md. */
    const uint8_t delta[] = {LW_TILE_DCT_DELTA, 8, 0, 0, 0, 0x66, 0x48, 1, 0, 0};
    for (int at = 32765; at <= 32767; at++) {
        coefficients.coefficient[0] = (int16_t)at;
        const bool fits = lw_tile_dct_decode(&dct, NULL, LW_TILE_DCT_DELTA, delta, sizeof delta, 1, 1, 1,
                                             &coefficients, back);
        assert_int_equal(fits, at < 32767);
        if (fits) assert_int_equal(coefficients.coefficient[0], at + 1);
    }
}

/* There and back, with steps of 0.1. */
static struct lw_tile_dct_coded code_beside(float dark) {
    struct lw_tile_dct_coded coded;
    lw_tile_dct_encode(&dct, &(struct lw_tile_dct_source){rgb, NULL, 64, 64, 0.1f, dark, NULL}, NULL, payload,
                       NULL, &coded);
    assert_true(lw_tile_dct_decode(&dct, NULL, LW_TILE_DCT_INTRA, payload, coded.size, coded.scale, 64, 64,
                                   NULL, back));
    return coded;
}

/* Light that is black beside the scene's white costs little, and errs by little beside it. */
static void test_black_is_coded_by_difference(void **state) {
    (void)state;
    make_light(64, 64, 0.9f, 1);
    const struct lw_tile_dct_coded alone = code_beside(0), black = code_beside(100 / LW_TILE_DCT_BLACK);
    assert_true(black.size < alone.size / 4 && black.scale >= 100);
    assert_true(log_error(LW_TILE_TEXELS_MAX, black.scale) < 0.1);
    expect_means(LW_TILE_TEXELS_MAX);
}

/* The largest error of a value, over the value. */
static double largest_ratio(void) {
    double off = 0;
    for (uint32_t i = 0; i < LW_TILE_TEXELS_MAX * 3; i++)
        off = fmax(off, fabs((double)(back[i] / rgb[i]) - 1));
    return off;
}

/* A room beside a yard in the sun keeps its colours, in tiles of its own and in shared ones. */
static void test_dark_has_its_colours(void **state) {
    (void)state;
    for (uint32_t i = 0; i < LW_TILE_TEXELS_MAX * 3; i++)
        rgb[i] = 0.01f * (1 + 0.01f * (float)(i / 192)) * (1 + 0.1f * (float)(i % 3));
    assert_true(code_beside(1).scale < 0.04f);
    assert_true(largest_ratio() < 0.15);
    for (uint32_t i = 0; i < LW_TILE_TEXELS_MAX * 3; i++)
        if (i / 3 % 64 >= 32) rgb[i] *= 1000; /* the other half, in the sun */
    code_beside(1);
    assert_true(largest_ratio() < 0.4);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_deltas),
        cmocka_unit_test(test_one_delta_over_several_versions),
        cmocka_unit_test(test_nothing_is_coded_between_coefficients_beyond_16_bits),
        cmocka_unit_test(test_sum_of_a_payload_and_its_deltas),
        cmocka_unit_test(test_sum_past_16_bits),
        cmocka_unit_test(test_sums_have_a_limit),
        cmocka_unit_test(test_black_is_coded_by_difference),
        cmocka_unit_test(test_dark_has_its_colours),
        cmocka_unit_test(test_error_follows_the_step),
        cmocka_unit_test(test_mean_is_kept),
        cmocka_unit_test(test_noise_under_the_step_costs_little),
        cmocka_unit_test(test_uncovered_texels_cost_nothing),
        cmocka_unit_test(test_one_texel_black_and_flat),
        cmocka_unit_test(test_what_has_no_number_is_counted),
        cmocka_unit_test(test_hostile_payloads_are_refused),
    };
    return cmocka_run_group_tests(tests, set_up, NULL);
}
