#include "common/tile/tile_dct.h"

#include "common/tile/tile_bits.h"
#include "common/wide.h"

#include <math.h>
#include <string.h>

#define SIDE          LW_TILE_DCT_SIDE
#define BLOCK_TEXELS  (SIDE * SIDE)
#define STRIDE        LW_TILE_SIDE
#define GRID          (LW_TILE_SIDE / SIDE) /* blocks beside each other, at most */
#define HEADER_SIZE   5u
#define VALUE_MAX     63.0f   /* of log2(1 + E/scale) */
#define SCALE_MAX     0x1p60f /* so that scale * 2^63 is a float */
#define SCALE_MIN     0x1p-60f
#define LIGHT_MAX     0x1p100f
#define RICE_K_MAX    16u
#define GRID_LENGTH_K 4u    /* of the length of the means' block, which nothing predicts */
#define GAIN_MAX      127.0 /* 2^(127/512): a factor of 1.19 */
#define FINER_Q       8u    /* half the step */
#define LEVEL_MAX     ((1 << LW_TILE_BITS_RAW) - 1)

/* The mean of a tile lies about so many scales up: what is darker than a scale is coded absolutely, not relatively. */
#define MEAN_IN_SCALES 32.0f

/* Levels are rounded down from a bit over the half: zeros are cheap, and what is dropped is mostly noise. More than this
 * costs in contrast: with 0.38 errors at borders of charts grew by half for 8 % of the bits. */
#define ROUND_AC   0.44f
#define ROUND_MEAN 0.5f

_Static_assert(GRID <= SIDE, "the means of a plane's blocks are one block");

void lw_tile_dct_init(struct lw_tile_dct *dct) {
    memset(dct, 0, sizeof *dct);
    for (uint32_t n = 1; n <= SIDE; n++)
        for (uint32_t k = 0; k < n; k++)
            for (uint32_t x = 0; x < n; x++)
                dct->basis[n][k][x] = dct->transposed[n][x][k] =
                    (float)(sqrt((k ? 2.0 : 1.0) / n) * cos(M_PI * (x + 0.5) * k / (double)n));
    for (uint32_t w = 1; w <= SIDE; w++)
        for (uint32_t h = 1; h <= SIDE; h++) {
            uint8_t *at = dct->scan[w][h];
            for (uint32_t d = 0; d < w + h - 1; d++)
                for (uint32_t row = 0; row < h; row++)
                    if (row <= d && d - row < w) *at++ = (uint8_t)(row * SIDE + d - row);
        }
}

static inline float clamp(float x, float low, float high) { return x < low ? low : x > high ? high : x; }

/* ---- eight numbers at a time ---- */

typedef float row8 __attribute__((vector_size(SIDE * sizeof(float))));
typedef int32_t whole8 __attribute__((vector_size(SIDE * sizeof(int32_t))));

LW_WIDE_INLINE row8 load(const float *from) {
    row8 row;
    memcpy(&row, from, sizeof row);
    return row;
}

LW_WIDE_INLINE void store(float *to, row8 row) { memcpy(to, &row, sizeof row); }

LW_WIDE_INLINE row8 every(float x) { return (row8){x, x, x, x, x, x, x, x}; }

/* Where yes is -1, and where it is 0. */
LW_WIDE_INLINE row8 choose(whole8 yes, row8 a, row8 b) {
    return (row8)(((whole8)a & yes) | ((whole8)b & ~yes));
}

LW_WIDE_INLINE row8 clamp8(row8 x, float low, float high) {
    x = choose(x < low, every(low), x);
    return choose(x > high, every(high), x);
}

/* x >= 1, to 3e-6. log2(m) = 2/ln 2 artanh((m-1)/(m+1)), by its series. */
LW_WIDE_INLINE row8 log2_of(row8 x) {
    const whole8 bits = (whole8)x;
    const row8 m = (row8)((bits & 0x7fffff) | 0x3f800000);
    const row8 z = (m - 1) / (m + 1), zz = z * z;
    const row8 series = 1 + zz * (1 / 3.0f + zz * (1 / 5.0f + zz * (1 / 7.0f + zz * (1 / 9.0f))));
    return __builtin_convertvector((bits >> 23) - 127, row8) + 2.88539008f * z * series;
}

/* 0 <= x <= VALUE_MAX, to 4e-6 of the value: the exponential series around the nearest whole number. */
LW_WIDE_INLINE row8 exp2_of(row8 x) {
    const whole8 whole = __builtin_convertvector(x + 0.5f, whole8);
    const row8 f = (x - __builtin_convertvector(whole, row8)) * 0.693147181f;
    const row8 power = 1 + f * (1 + f * (1 / 2.0f + f * (1 / 6.0f + f * (1 / 24.0f + f * (1 / 120.0f)))));
    return power * (row8)((whole + 127) << 23);
}

/* In place, from E as planes: three logarithms as one of brightness and two of colour. What is off by some amount in a plane
 * is off by about the same in the logarithms. */
LW_WIDE static void take_logarithms(struct lw_tile_dct *dct, uint32_t height, float inverse_scale) {
    for (uint32_t i = 0; i < height * STRIDE; i += SIDE) {
        const row8 r = log2_of(1 + load(dct->light[0] + i) * inverse_scale);
        const row8 g = log2_of(1 + load(dct->light[1] + i) * inverse_scale);
        const row8 b = log2_of(1 + load(dct->light[2] + i) * inverse_scale);
        const row8 magenta = 0.5f * (r + b);
        store(dct->plane[0] + i, 0.5f * (g + magenta));
        store(dct->plane[1] + i, 0.5f * (r - b));
        store(dct->plane[2] + i, 0.5f * (g - magenta));
    }
}

LW_WIDE_INLINE row8 light_of(row8 value, float scale) {
    return (exp2_of(clamp8(value, 0, VALUE_MAX)) - 1) * scale;
}

/* The way back. */
LW_WIDE static void take_powers(struct lw_tile_dct *dct, uint32_t height, const float scale[3]) {
    for (uint32_t i = 0; i < height * STRIDE; i += SIDE) {
        const row8 luma = load(dct->plane[0] + i), orange = load(dct->plane[1] + i),
                   green = load(dct->plane[2] + i);
        store(dct->plane[0] + i, light_of(luma - green + orange, scale[0]));
        store(dct->plane[1] + i, light_of(luma + green, scale[1]));
        store(dct->plane[2] + i, light_of(luma - green - orange, scale[2]));
    }
}

/* ---- transforms: rows of eight, whatever the block's size; the bases are 0 past it ---- */

/* In place. Coefficients past the diagonal `diagonals - 1` are 0. */
LW_WIDE_INLINE void inverse(const struct lw_tile_dct *dct, float *block, uint32_t stride, uint32_t width,
                            uint32_t height, uint32_t diagonals) {
    row8 across[SIDE];
    const uint32_t rows = diagonals < height ? diagonals : height;
    for (uint32_t row = 0; row < rows; row++) {
        const uint32_t columns = diagonals - row < width ? diagonals - row : width;
        const float *c = block + row * stride;
        row8 sum = c[0] * load(dct->basis[width][0]);
        for (uint32_t k = 1; k < columns; k++) sum += c[k] * load(dct->basis[width][k]);
        across[row] = sum;
    }
    for (uint32_t y = 0; y < height; y++) {
        const float *c = dct->transposed[height][y];
        row8 sum = c[0] * across[0];
        for (uint32_t k = 1; k < rows; k++) sum += c[k] * across[k];
        store(block + y * stride, sum);
    }
}

/* In place. */
LW_WIDE_INLINE void forward(const struct lw_tile_dct *dct, float *block, uint32_t stride, uint32_t width,
                            uint32_t height) {
    row8 down[SIDE];
    for (uint32_t k = 0; k < height; k++) {
        const float *c = dct->basis[height][k];
        row8 sum = c[0] * load(block);
        for (uint32_t y = 1; y < height; y++) sum += c[y] * load(block + y * stride);
        down[k] = sum;
    }
    for (uint32_t k = 0; k < height; k++) {
        row8 sum = down[k][0] * load(dct->transposed[width][0]);
        for (uint32_t x = 1; x < width; x++) sum += down[k][x] * load(dct->transposed[width][x]);
        store(block + k * stride, sum);
    }
}

/* Where block (bx, by) of a plane lies, and its size. */
struct span {
    uint32_t at, width, height;
};

LW_WIDE_INLINE struct span span_of(uint32_t bx, uint32_t by, uint32_t width, uint32_t height) {
    const uint32_t w = width - bx * SIDE, h = height - by * SIDE;
    return (struct span){by * SIDE * STRIDE + bx * SIDE, w < SIDE ? w : SIDE, h < SIDE ? h : SIDE};
}

LW_WIDE_INLINE uint32_t blocks(uint32_t texels) { return (texels + SIDE - 1) / SIDE; }

/* ---- levels as bits ---- */

/* Of a number that is likely as large as the two before it, or as the lengths of the blocks beside it: bits of a third. */
LW_WIDE_INLINE unsigned rice_k(uint32_t a, uint32_t b) {
    const unsigned k = 31u - (unsigned)__builtin_clz((a + b) / 3 << 1 | 1);
    return k < RICE_K_MAX ? k : RICE_K_MAX;
}

/* The lengths of the blocks to the left and above; where there is one only, that twice; in the corner 0. */
LW_WIDE_INLINE unsigned length_k(const uint8_t *length, uint32_t bx, uint32_t by) {
    const uint8_t *at = length + by * GRID + bx;
    const uint32_t left = bx ? at[-1] : by ? at[-(int)GRID] : 0, above = by ? at[-(int)GRID] : left;
    return rice_k(left, above);
}

/* Levels of one block, `level` by rows and `scan` without what is coded elsewhere: how many up to the last that is not 0,
 * then those, the last one first. */
static uint32_t put_levels(struct lw_tile_bits_writer *w, const int32_t *level, const uint8_t *scan,
                           uint32_t count, unsigned k) {
    while (count && !level[scan[count - 1]]) count--;
    lw_tile_bits_put_rice(w, count, k, 0, 0);
    uint32_t a = 0, b = 0;
    for (uint32_t i = count; i-- > 0;) {
        const int32_t v = level[scan[i]];
        const uint32_t size = (uint32_t)(v < 0 ? -v : v);
        lw_tile_bits_put_rice(w, size - (i + 1 == count), rice_k(a, b), v < 0, size != 0);
        b = a;
        a = size;
    }
    return count;
}

/* Into block, which is 0 but for what the scan leaves out. False for a length that the block does not have. */
LW_WIDE_INLINE bool get_levels(struct lw_tile_bits_reader *r, const uint8_t *scan, uint32_t count, unsigned k,
                               float step, float *block, uint32_t stride, uint32_t *out_length) {
    lw_tile_bits_refill(r);
    const uint32_t length = lw_tile_bits_get_rice(r, k);
    if (length > count) return false;
    uint32_t a = 0, b = 0;
    for (uint32_t i = length; i-- > 0;) {
        lw_tile_bits_refill(r);
        const uint32_t size = lw_tile_bits_get_rice(r, rice_k(a, b)) + (i + 1 == length);
        const int32_t negative = -(int32_t)(r->held & (size != 0)); /* no branch: it would be a coin's toss */
        lw_tile_bits_drop(r, size != 0);
        block[(scan[i] / SIDE) * stride + scan[i] % SIDE] =
            (float)(((int32_t)size ^ negative) - negative) * step;
        b = a;
        a = size;
    }
    *out_length = length;
    return true;
}

/* ---- decoding ---- */

LW_WIDE static bool decode_plane(struct lw_tile_dct *dct, float *plane, uint32_t width, uint32_t height,
                                 float step, struct lw_tile_bits_reader *r) {
    const uint32_t across = blocks(width), down = blocks(height);
    const uint8_t *scan = dct->scan[across][down];
    uint8_t length[GRID * GRID];
    uint32_t count;
    memset(dct->mean, 0, sizeof dct->mean);
    if (!get_levels(r, scan, across * down, GRID_LENGTH_K, step, dct->mean, SIDE, &count)) return false;
    inverse(dct, dct->mean, SIDE, across, down, across + down - 1);
    for (uint32_t by = 0; by < down; by++)
        for (uint32_t bx = 0; bx < across; bx++) {
            const struct span s = span_of(bx, by, width, height);
            const float mean = dct->mean[by * SIDE + bx];
            float *block = plane + s.at;
            for (uint32_t y = 0; y < s.height; y++) memset(block + y * STRIDE, 0, SIDE * sizeof *block);
            scan = dct->scan[s.width][s.height];
            if (!get_levels(r, scan + 1, s.width * s.height - 1, length_k(length, bx, by), step, block,
                            STRIDE, &count))
                return false;
            length[by * GRID + bx] = (uint8_t)count;
            block[0] = mean;
            const uint32_t last = scan[count];
            inverse(dct, block, STRIDE, s.width, s.height, last / SIDE + last % SIDE + 1);
        }
    return true;
}

static void scales_of(float scale, const int8_t gain[3], float out[3]) {
    for (int c = 0; c < 3; c++) out[c] = scale * exp2f((float)gain[c] / LW_TILE_DCT_GAIN_UNIT);
}

static float step_of(uint32_t q) { return exp2f((float)q / -8.0f); }

bool lw_tile_dct_decode(struct lw_tile_dct *dct, const uint8_t *src, size_t src_size, float scale,
                        uint32_t width, uint32_t height, float *rgb) {
    if (width - 1 >= LW_TILE_SIDE || height - 1 >= LW_TILE_SIDE || !(scale > 0) || !(scale <= SCALE_MAX))
        return false;
    if (src_size < HEADER_SIZE || src[0] != LW_TILE_DCT_INTRA || src[1] > LW_TILE_DCT_STEP_Q_MAX)
        return false;
    const int8_t gain[3] = {(int8_t)src[2], (int8_t)src[3], (int8_t)src[4]};
    struct lw_tile_bits_reader r = {.at = src + HEADER_SIZE, .end = src + src_size};
    for (int p = 0; p < 3; p++)
        if (!decode_plane(dct, dct->plane[p], width, height, step_of(src[1]), &r)) return false;
    if (!lw_tile_bits_is_at_end(&r)) return false;
    float scales[3];
    scales_of(scale, gain, scales);
    take_powers(dct, height, scales);
    for (uint32_t y = 0; y < height; y++)
        for (uint32_t x = 0; x < width; x++)
            for (uint32_t c = 0; c < 3; c++)
                rgb[((size_t)y * width + x) * 3 + c] = dct->plane[c][y * STRIDE + x];
    return true;
}

/* ---- encoding ---- */

/* The power of two under a share of the mean; 1 for a black tile. */
static float choose_scale(double mean) {
    if (!(mean > 0)) return 1;
    int exponent;
    frexpf((float)mean / MEAN_IN_SCALES, &exponent);
    return clamp(ldexpf(1, exponent), SCALE_MIN, SCALE_MAX);
}

/* Into planes, with what is no number as 0; counts that, and the covered texels. Rows are filled up: no rests of another
 * tile. */
LW_WIDE static uint32_t take_light(struct lw_tile_dct *dct, const float *restrict rgb,
                                   const uint8_t *restrict covered, uint32_t width, uint32_t height,
                                   uint32_t *out_saturated) {
    uint32_t saturated = 0, count = 0;
    for (uint32_t y = 0; y < height; y++) {
        uint32_t weight[STRIDE] = {0};
        for (uint32_t x = 0; x < width; x++) weight[x] = covered ? covered[y * width + x] != 0 : 1;
        for (uint32_t x = 0; x < STRIDE; x++) {
            dct->weight[y * STRIDE + x] = (float)(int32_t)weight[x];
            count += weight[x];
        }
        for (uint32_t c = 0; c < 3; c++) {
            const float *restrict from = rgb + (size_t)y * width * 3 + c;
            float *restrict to = dct->light[c] + y * STRIDE;
            for (uint32_t x = 0; x < width; x++) {
                const float v = from[x * 3];
                const uint32_t fits = v >= 0 && v <= LIGHT_MAX; /* 0 for NaN */
                to[x] = fits ? v : 0;
                saturated += weight[x] & ~fits & 1;
            }
            for (uint32_t x = width; x < STRIDE; x++) to[x] = 0;
        }
    }
    *out_saturated = saturated;
    return count;
}

LW_WIDE_INLINE float add_up(row8 row) {
    return row[0] + row[1] + row[2] + row[3] + row[4] + row[5] + row[6] + row[7];
}

/* Over what is covered. */
LW_WIDE static double sum_of(const struct lw_tile_dct *dct, const float *plane, uint32_t height) {
    double sum = 0;
    for (uint32_t y = 0; y < height; y++) {
        row8 row = {0};
        for (uint32_t x = 0; x < STRIDE; x += SIDE)
            row += load(plane + y * STRIDE + x) * load(dct->weight + y * STRIDE + x);
        sum += (double)add_up(row);
    }
    return sum;
}

/* Nobody asks for what is not covered, so it takes whatever costs least: the mean of its block's covered texels, or
 * of the last block before it that has any. */
LW_WIDE static void fill_uncovered(const struct lw_tile_dct *dct, float *plane, uint32_t width,
                                   uint32_t height) {
    float mean = 0;
    for (uint32_t by = 0; by < blocks(height); by++)
        for (uint32_t bx = 0; bx < blocks(width); bx++) {
            const struct span s = span_of(bx, by, width, height);
            const float *weight = dct->weight + s.at;
            float *block = plane + s.at;
            row8 sum = {0}, weights = {0};
            for (uint32_t y = 0; y < s.height; y++) {
                sum += load(block + y * STRIDE) * load(weight + y * STRIDE);
                weights += load(weight + y * STRIDE);
            }
            const float count = add_up(weights);
            if (count > 0) mean = add_up(sum) / count;
            for (uint32_t y = 0; y < s.height; y++)
                store(block + y * STRIDE,
                      choose(load(weight + y * STRIDE) > 0, load(block + y * STRIDE), every(mean)));
        }
}

LW_WIDE_INLINE whole8 levels_of(row8 value, float inverse_step, float round) {
    const row8 size = clamp8((row8)((whole8)value & 0x7fffffff) * inverse_step + round, 0, LEVEL_MAX);
    const whole8 negative = value < 0;
    return (__builtin_convertvector(size, whole8) ^ negative) - negative;
}

/* Coefficients to levels, by rows, and in place to what a decoder has of them. Of the first coefficient the decoder has
 * nothing yet. Returns how many diagonals are not all 0. */
LW_WIDE_INLINE uint32_t quantise(float *block, uint32_t stride, uint32_t width, uint32_t height, float step,
                                 float round, int32_t *level) {
    const whole8 place = {0, 1, 2, 3, 4, 5, 6, 7};
    const float inverse_step = 1 / step;
    whole8 last = {0};
    for (uint32_t y = 0; y < height; y++) {
        const whole8 inside = place < (int32_t)width;
        const whole8 levels = levels_of(load(block + y * stride), inverse_step, round) & inside;
        memcpy(level + y * SIDE, &levels, sizeof levels);
        store(block + y * stride, __builtin_convertvector(levels, row8) * step);
        const whole8 diagonal = (levels != 0) & (place + (int32_t)(y + 1));
        last = (diagonal & (diagonal > last)) | (last & ~(diagonal > last));
    }
    int32_t most = 1;
    for (uint32_t x = 0; x < SIDE; x++) most = last[x] > most ? last[x] : most;
    return (uint32_t)most;
}

/* The plane's levels, block after block; its means' go to `grid`. The plane ends up as a decoder has it. */
LW_WIDE static void quantise_plane(struct lw_tile_dct *dct, float *plane, uint32_t width, uint32_t height,
                                   float step, int32_t *grid) {
    const uint32_t across = blocks(width), down = blocks(height);
    uint8_t diagonals[GRID * GRID];
    memset(dct->mean, 0, sizeof dct->mean);
    for (uint32_t by = 0; by < down; by++)
        for (uint32_t bx = 0; bx < across; bx++) {
            const struct span s = span_of(bx, by, width, height);
            const uint32_t b = by * GRID + bx;
            forward(dct, plane + s.at, STRIDE, s.width, s.height);
            dct->mean[by * SIDE + bx] = plane[s.at];
            diagonals[b] = (uint8_t)quantise(plane + s.at, STRIDE, s.width, s.height, step, ROUND_AC,
                                             dct->level + b * BLOCK_TEXELS);
        }
    forward(dct, dct->mean, SIDE, across, down);
    quantise(dct->mean, SIDE, across, down, step, ROUND_MEAN, grid);
    inverse(dct, dct->mean, SIDE, across, down, across + down - 1);
    for (uint32_t by = 0; by < down; by++)
        for (uint32_t bx = 0; bx < across; bx++) {
            const struct span s = span_of(bx, by, width, height);
            plane[s.at] = dct->mean[by * SIDE + bx];
            inverse(dct, plane + s.at, STRIDE, s.width, s.height, diagonals[by * GRID + bx]);
        }
}

static void put_plane(const struct lw_tile_dct *dct, uint32_t width, uint32_t height, const int32_t *grid,
                      struct lw_tile_bits_writer *w) {
    const uint32_t across = blocks(width), down = blocks(height);
    uint8_t length[GRID * GRID];
    put_levels(w, grid, dct->scan[across][down], across * down, GRID_LENGTH_K);
    for (uint32_t by = 0; by < down; by++)
        for (uint32_t bx = 0; bx < across; bx++) {
            const struct span s = span_of(bx, by, width, height);
            const uint32_t b = by * GRID + bx;
            length[b] =
                (uint8_t)put_levels(w, dct->level + b * BLOCK_TEXELS, dct->scan[s.width][s.height] + 1,
                                    s.width * s.height - 1, length_k(length, bx, by));
        }
}

/* A mean of logarithms is under the logarithm of the mean, so what was noise has become darker. One factor per channel
 * makes up for it. False if no gain does. */
static bool choose_gain(double was, double is, uint8_t *out_gain) {
    *out_gain = 0;
    if (!(was > 0) || !(is > 0)) return !(was > 0);
    const double gain = LW_TILE_DCT_GAIN_UNIT * log2(was / is);
    if (!(fabs(gain) <= GAIN_MAX)) return false;
    *out_gain = (uint8_t)(int8_t)lrint(gain);
    return true;
}

/* With one step; false if it is so coarse that the mean is lost. */
static bool encode(struct lw_tile_dct *dct, uint32_t width, uint32_t height, bool filled, float scale,
                   uint32_t q, const double sum[3], uint8_t *dst, size_t *out_size) {
    take_logarithms(dct, height, 1 / scale);
    struct lw_tile_bits_writer w = {.at = dst + HEADER_SIZE};
    for (int p = 0; p < 3; p++) {
        int32_t grid[GRID * GRID];
        if (!filled) fill_uncovered(dct, dct->plane[p], width, height);
        quantise_plane(dct, dct->plane[p], width, height, step_of(q), grid);
        put_plane(dct, width, height, grid, &w);
    }
    take_powers(dct, height, (const float[3]){scale, scale, scale});
    dst[0] = LW_TILE_DCT_INTRA;
    dst[1] = (uint8_t)q;
    bool kept = true;
    for (int c = 0; c < 3; c++) kept &= choose_gain(sum[c], sum_of(dct, dct->plane[c], height), dst + 2 + c);
    *out_size = (size_t)(lw_tile_bits_end(&w) - dst);
    return kept;
}

size_t lw_tile_dct_encode(struct lw_tile_dct *dct, const float *rgb, const uint8_t *covered, uint32_t width,
                          uint32_t height, float step, uint8_t *dst, float *out_scale,
                          uint32_t *out_saturated) {
    const float q_wanted = ceilf(-8 * log2f(step > 0 ? step : 0x1p-20f));
    uint32_t q = (uint32_t)clamp(q_wanted, 0, LW_TILE_DCT_STEP_Q_MAX);
    const uint32_t count = take_light(dct, rgb, covered, width, height, out_saturated);
    double sum[3];
    for (int c = 0; c < 3; c++) sum[c] = sum_of(dct, dct->light[c], height);
    const float scale = choose_scale((sum[0] + sum[1] + sum[2]) / (3.0 * count));
    size_t size;
    /* A few texels that shine hundreds of times as bright as the rest make up the mean: these need a finer step. */
    while (!encode(dct, width, height, count == width * height, scale, q, sum, dst, &size) &&
           q < LW_TILE_DCT_STEP_Q_MAX)
        q = q + FINER_Q < LW_TILE_DCT_STEP_Q_MAX ? q + FINER_Q : LW_TILE_DCT_STEP_Q_MAX;
    *out_scale = scale;
    return size;
}
