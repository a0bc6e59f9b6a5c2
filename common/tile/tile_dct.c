#include "common/tile/tile_dct.h"

#include "common/base/invariant.h"
#include "common/base/wide.h"
#include "common/tile/tile_bits.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

#define SIDE                 LW_TILE_DCT_SIDE
#define BLOCK_TEXELS         (SIDE * SIDE)
#define STRIDE               LW_TILE_SIDE
#define GRID                 (LW_TILE_SIDE / SIDE) /* blocks beside each other, at most */
#define HEADER_SIZE          5u
#define VALUE_MAX_BITS       0x427c0000 /* 63.0f: of log2(1 + E/scale) */
#define SCALE_MAX            0x1p60f    /* so that scale * 2^63 is a float */
#define SCALE_MIN            0x1p-60f
#define LIGHT_MAX            0x1p100f
#define RICE_K_MAX           16u
#define GRID_LENGTH_K        4u      /* for the length of a list of means, which nothing predicts */
#define MEAN_OFF_MAX         0x1p-12 /* in scales */
#define GAIN_MAX             127.0   /* 2^(127/512): a factor of 1.19 */
#define FINER_Q              8u      /* half the step */
#define MEAN_COEFFICIENT_MAX ((1 << LW_TILE_BITS_RAW) - 1)
#define KEPT_MAX             LW_TILE_RANS_COEFFICIENT_MAX
#define PLANES               LW_TILE_CHANNEL_PLANES_MAX
#define MEANS_BOUND          (PLANES * BLOCK_TEXELS * 33 / 8 + 3 * 4 + 8)
#define NEAR_SCALE           2.0f /* largest ratio of scales of a tile and of its history */
#define NEAR_Q               6u   /* largest difference of their steps, in q */

/* The mean of a tile in units of its scale, about. Values below one scale are coded by their difference, not
 * by their ratio. */
#define MEAN_IN_SCALES 32.0f
/* A quarter of a tile's blocks may be dark. The scale is at most this multiple of their light. It is at
 * least DARK_PART_LEAST of the scale for the whole tile. */
#define DARK_PART_SCALES 4.0f
#define DARK_PART_LEAST  (1 / 128.0f)

/* Coefficients are rounded down from a bit over the half: zeros are cheap, and the lost part is mostly
 * noise. More than this costs in contrast: with 0.38 errors at borders of charts grew by half for 8 % of the
 * bits. */
#define ROUND_AC   0.44f
#define ROUND_MEAN 0.5f

/* Three planes of light, if it is not said. */
LW_WIDE_INLINE uint32_t planes_of(const struct lw_tile_channel *channel) {
    return channel ? channel->planes : 3;
}
LW_WIDE_INLINE bool is_plain(const struct lw_tile_channel *channel) {
    return channel && channel->coding == LW_TILE_CODING_PLAIN;
}

_Static_assert(GRID <= SIDE, "the means of a plane's blocks are one block");

void lw_tile_dct_init(struct lw_tile_dct *dct) {
    memset(dct, 0, sizeof *dct);
    lw_tile_rans_init(&dct->rans);
    for (uint32_t n = 1; n <= SIDE; n++)
        for (uint32_t k = 0; k < n; k++)
            for (uint32_t x = 0; x < n; x++)
                dct->basis[n][k][x] = dct->transposed[n][x][k] =
                    (float)(sqrt((k ? 2.0 : 1.0) / n) * cos(M_PI * (x + 0.5) * k / (double)n));
}

static inline float clamp(float x, float low, float high) { return x < low ? low : x > high ? high : x; }

/* ---- eight numbers at a time ---- */

typedef float row8 __attribute__((vector_size(SIDE * sizeof(float))));
typedef int32_t whole8 __attribute__((vector_size(SIDE * sizeof(int32_t))));
typedef int8_t byte8 __attribute__((vector_size(SIDE)));
typedef int16_t short8 __attribute__((vector_size(SIDE * sizeof(int16_t))));
typedef uint16_t unsigned8 __attribute__((vector_size(SIDE * sizeof(uint16_t))));

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

/* Functions of single values, two rows at a time: as wide as registers get. */
typedef float row16 __attribute__((vector_size(2 * SIDE * sizeof(float))));
typedef int32_t whole16 __attribute__((vector_size(2 * SIDE * sizeof(int32_t))));

LW_WIDE_INLINE row16 load16(const float *from) {
    row16 row;
    memcpy(&row, from, sizeof row);
    return row;
}

LW_WIDE_INLINE void store16(float *to, row16 row) { memcpy(to, &row, sizeof row); }

/* x >= 1, to 3e-6. log2(m) = 2/ln 2 artanh((m-1)/(m+1)), by its series. */
LW_WIDE_INLINE row16 log2_of(row16 x) {
    const whole16 bits = (whole16)x;
    const row16 m = (row16)((bits & 0x7fffff) | 0x3f800000);
    const row16 z = (m - 1) / (m + 1), zz = z * z;
    const row16 series = 1 + zz * (1 / 3.0f + zz * (1 / 5.0f + zz * (1 / 7.0f + zz * (1 / 9.0f))));
    return __builtin_convertvector((bits >> 23) - 127, row16) + 2.88539008f * z * series;
}

/* 2 to the power of the nearest number within 0 and VALUE_MAX, to 4e-6 of the value: the exponential series
 * around the nearest whole number. Floats >= 0 are in the order of their bits; compilers take comparisons of
 * vectors wider than registers apart. */
LW_WIDE_INLINE row16 exp2_of(row16 x) {
    whole16 below = (whole16)x;
    below = (below & ~(below >> 31)) - VALUE_MAX_BITS;
    const row16 inside = (row16)((below & (below >> 31)) + VALUE_MAX_BITS);
    const whole16 whole = __builtin_convertvector(inside + 0.5f, whole16);
    const row16 f = (inside - __builtin_convertvector(whole, row16)) * 0.693147181f;
    const row16 power = 1 + f * (1 + f * (1 / 2.0f + f * (1 / 6.0f + f * (1 / 24.0f + f * (1 / 120.0f)))));
    return power * (row16)((whole + 127) << 23);
}

/* In place, from E as planes: three logarithms as one of brightness and two of colour. An error in a plane
 * is one of about the same size in the logarithms. */
LW_WIDE static void take_logarithms(struct lw_tile_dct *dct, uint32_t height, float inverse_scale) {
    for (uint32_t i = 0; i < height * STRIDE; i += 2 * SIDE) {
        const row16 r = log2_of(1 + load16(dct->light[0] + i) * inverse_scale);
        const row16 g = log2_of(1 + load16(dct->light[1] + i) * inverse_scale);
        const row16 b = log2_of(1 + load16(dct->light[2] + i) * inverse_scale);
        const row16 magenta = 0.5f * (r + b);
        store16(dct->plane[0] + i, 0.5f * (g + magenta));
        store16(dct->plane[1] + i, 0.5f * (r - b));
        store16(dct->plane[2] + i, 0.5f * (g - magenta));
    }
}

/* The way back, at place i of the planes. */
LW_WIDE_INLINE void light_at(const struct lw_tile_dct *dct, uint32_t i, const float scale[3],
                             row16 light[3]) {
    const row16 luma = load16(dct->plane[0] + i), orange = load16(dct->plane[1] + i),
                green = load16(dct->plane[2] + i);
    light[0] = (exp2_of(luma - green + orange) - 1) * scale[0];
    light[1] = (exp2_of(luma + green) - 1) * scale[1];
    light[2] = (exp2_of(luma - green - orange) - 1) * scale[2];
}

/* Sums of the light that planes hold, over covered texels. */
LW_WIDE static void sum_light(const struct lw_tile_dct *dct, uint32_t height, float scale,
                              double out_sum[3]) {
    out_sum[0] = out_sum[1] = out_sum[2] = 0;
    for (uint32_t y = 0; y < height; y++) {
        row16 sum[3] = {0};
        for (uint32_t i = y * STRIDE; i < (y + 1) * STRIDE; i += 2 * SIDE) {
            row16 light[3];
            light_at(dct, i, (const float[3]){scale, scale, scale}, light);
            for (uint32_t c = 0; c < 3; c++) sum[c] += light[c] * load16(dct->weight + i);
        }
        for (uint32_t c = 0; c < 3; c++)
            for (uint32_t i = 0; i < 2 * SIDE; i++) out_sum[c] += (double)sum[c][i];
    }
}

/* ---- eight texels of R, G, B in turn ---- */

#define SHUFFLE  __builtin_shufflevector
#define LOWER(x) SHUFFLE(x, x, 0, 1, 2, 3, 4, 5, 6, 7)
#define UPPER(x) SHUFFLE(x, x, 8, 9, 10, 11, 12, 13, 14, 15)

LW_WIDE_INLINE void join_channels(row8 r, row8 g, row8 b, float *texel) {
    const row8 first = SHUFFLE(r, g, 0, 8, -1, 1, 9, -1, 2, 10),
               second = SHUFFLE(r, g, -1, 3, 11, -1, 4, 12, -1, 5),
               third = SHUFFLE(r, g, 13, -1, 6, 14, -1, 7, 15, -1);
    store(texel, SHUFFLE(first, b, 0, 1, 8, 3, 4, 9, 6, 7));
    store(texel + SIDE, SHUFFLE(second, b, 10, 1, 2, 11, 4, 5, 12, 7));
    store(texel + 2 * SIDE, SHUFFLE(third, b, 0, 13, 2, 3, 14, 5, 6, 15));
}

LW_WIDE_INLINE void part_channels(const float *texel, row8 channel[3]) {
    const row8 first = load(texel), second = load(texel + SIDE), third = load(texel + 2 * SIDE);
    channel[0] = SHUFFLE(SHUFFLE(first, second, 0, 3, 6, 9, 12, 15, -1, -1), third, 0, 1, 2, 3, 4, 5, 10, 13);
    channel[1] =
        SHUFFLE(SHUFFLE(first, second, 1, 4, 7, 10, 13, -1, -1, -1), third, 0, 1, 2, 3, 4, 8, 11, 14);
    channel[2] =
        SHUFFLE(SHUFFLE(first, second, 2, 5, 8, 11, 14, -1, -1, -1), third, 0, 1, 2, 3, 4, 9, 12, 15);
}

/* The way back, into texels. */
LW_WIDE static void put_texels(const struct lw_tile_dct *dct, uint32_t width, uint32_t height,
                               const float scale[3], float *rgb) {
    for (uint32_t y = 0; y < height; y++)
        for (uint32_t x = 0; x < width; x += 2 * SIDE) {
            row16 light[3];
            light_at(dct, y * STRIDE + x, scale, light);
            float texels[6 * SIDE];
            join_channels(LOWER(light[0]), LOWER(light[1]), LOWER(light[2]), texels);
            join_channels(UPPER(light[0]), UPPER(light[1]), UPPER(light[2]), texels + 3 * SIDE);
            const uint32_t count = width - x < 2 * SIDE ? width - x : 2 * SIDE;
            float *to = rgb + ((size_t)y * width + x) * 3;
            if (count == 2 * SIDE)
                memcpy(to, texels, sizeof texels);
            else
                memcpy(to, texels, count * 3 * sizeof *to);
        }
}

/* ---- transforms: always rows of eight; the bases are 0 past the block's size ---- */

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

LW_WIDE_INLINE row8 scaled(const int16_t *coefficients, float step) {
    short8 row;
    memcpy(&row, coefficients, sizeof row);
    return __builtin_convertvector(__builtin_convertvector(row, whole8), row8) * step;
}

/* cos(k pi/16) / 2 */
#define C1 0.490392640f
#define C2 0.461939766f
#define C3 0.415734806f
#define C5 0.277785117f
#define C6 0.191341716f
#define C7 0.097545161f
#define R8 0.353553391f /* 1/sqrt(8) */

/* A whole block from its coefficients, of which only those of the first `count` rows and columns are not 0: 4
 * or 8, known when this is compiled. The second transform takes even and odd frequencies apart: the lower
 * half mirrors the upper one, odd ones with the opposite sign. */
LW_WIDE_INLINE void inverse8(const struct lw_tile_dct *dct, const int16_t *coefficient, float mean,
                             float step, uint32_t count, float *block) {
    row8 c[SIDE] = {0};
    for (uint32_t v = 0; v < count; v++) {
        float u[SIDE];
        store(u, scaled(coefficient + v * SIDE, step));
        if (!v) u[0] = mean;
        c[v] = u[0] * load(dct->basis[SIDE][0]);
        for (uint32_t k = 1; k < count; k++) c[v] += u[k] * load(dct->basis[SIDE][k]);
    }
    const bool all = count == SIDE;
    const row8 sum = (all ? c[0] + c[4] : c[0]) * R8, difference = (all ? c[0] - c[4] : c[0]) * R8;
    const row8 wide = all ? c[2] * C2 + c[6] * C6 : c[2] * C2,
               narrow = all ? c[2] * C6 - c[6] * C2 : c[2] * C6;
    const row8 even[4] = {sum + wide, difference + narrow, difference - narrow, sum - wide};
    row8 odd[4] = {c[1] * C1 + c[3] * C3, c[1] * C3 - c[3] * C7, c[1] * C5 - c[3] * C1,
                   c[1] * C7 - c[3] * C5};
    if (all) {
        odd[0] += c[5] * C5 + c[7] * C7;
        odd[1] -= c[5] * C1 + c[7] * C5;
        odd[2] += c[5] * C7 + c[7] * C3;
        odd[3] += c[5] * C3 - c[7] * C1;
    }
    for (uint32_t y = 0; y < 4; y++) {
        store(block + y * STRIDE, even[y] + odd[y]);
        store(block + (SIDE - 1 - y) * STRIDE, even[y] - odd[y]);
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

/* ---- coefficients that are kept ---- */

LW_WIDE_INLINE uint32_t plane_coefficients(uint32_t width, uint32_t height) {
    return blocks(width) * blocks(height) * BLOCK_TEXELS;
}

/* Where the coefficients of block (bx, by) of a plane begin. */
LW_WIDE_INLINE uint32_t block_at(uint32_t width, uint32_t bx, uint32_t by) {
    return (by * blocks(width) + bx) * BLOCK_TEXELS;
}

size_t lw_tile_dct_coefficients_size(const struct lw_tile_channel *channel, uint32_t width, uint32_t height) {
    return planes_of(channel) * plane_coefficients(width, height) * sizeof(int16_t);
}

size_t lw_tile_dct_history_size(const struct lw_tile_channel *channel, uint32_t width, uint32_t height) {
    return offsetof(struct lw_tile_dct_history, coefficients) +
           lw_tile_dct_coefficients_size(channel, width, height);
}

/* ---- the means' coefficients as bits ---- */

/* Rice parameter of a number that is likely as large as the two before it: bits of a third of their sum. */
LW_WIDE_INLINE unsigned rice_k(uint32_t a, uint32_t b) {
    const unsigned k = 31u - (unsigned)__builtin_clz((a + b) / 3 << 1 | 1);
    return k < RICE_K_MAX ? k : RICE_K_MAX;
}

/* `coefficient` by rows: how many up to the last that is not 0, then these, the last one first; after two
 * zeros, how many more zeros there are. */
LW_WIDE_INLINE void put_means(struct lw_tile_bits_writer *w, const int32_t *coefficient, const uint8_t *scan,
                              uint32_t count, unsigned run_k) {
    while (count && !coefficient[scan[count - 1]]) count--;
    lw_tile_bits_put_rice(w, count, GRID_LENGTH_K, 0, 0);
    uint32_t a = 0, b = 0;
    bool known = true; /* not to be 0 */
    for (uint32_t i = count; i-- > 0;) {
        if (!known && !(a | b)) {
            uint32_t run = 0;
            while (run <= i && !coefficient[scan[i - run]]) run++;
            lw_tile_bits_put_rice(w, run, run_k, 0, 0);
            if (run > i) break;
            i -= run;
            known = true;
        }
        const int32_t v = coefficient[scan[i]];
        const uint32_t size = (uint32_t)(v < 0 ? -v : v);
        lw_tile_bits_put_rice(w, size - known, rice_k(a, b), v < 0, size != 0);
        b = a;
        a = size;
        known = false;
    }
}

/* Reads into `coefficient`, by rows, which is all 0. False for a list longer than the block. */
LW_WIDE_INLINE bool get_means(struct lw_tile_bits_reader *r, const uint8_t *scan, uint32_t count,
                              unsigned run_k, int32_t *coefficient) {
    lw_tile_bits_refill(r);
    const uint32_t length = lw_tile_bits_get_rice(r, GRID_LENGTH_K);
    if (length > count) return false;
    uint32_t a = 0, b = 0;
    bool known = true;
    for (uint32_t i = length; i;) {
        lw_tile_bits_refill(r);
        const uint32_t size = lw_tile_bits_get_rice(r, rice_k(a, b)) + known;
        const bool is_negative = size && r->held & 1;
        lw_tile_bits_drop(r, size > 0);
        coefficient[scan[--i]] = is_negative ? -(int32_t)size : (int32_t)size;
        b = a;
        a = size;
        known = false;
        if (a | b) continue;
        if (!i) break;
        lw_tile_bits_refill(r);
        const uint32_t run = lw_tile_bits_get_rice(r, run_k);
        if (run > i) return false;
        i -= run;
        known = true;
    }
    return true;
}

/* ---- from coefficients to texels ---- */

/* Number of diagonals of a block's coefficients up to the last that is not 0; at least one. */
LW_WIDE_INLINE uint32_t diagonals_of(const int16_t *coefficient, uint32_t height) {
    const short8 place = {1, 2, 3, 4, 5, 6, 7, 8};
    short8 last = {1};
    for (uint32_t y = 0; y < height; y++) {
        short8 row;
        memcpy(&row, coefficient + y * SIDE, sizeof row);
        const short8 diagonal = (row != 0) & (place + (int16_t)y);
        last = (diagonal & (diagonal > last)) | (last & ~(diagonal > last));
    }
    int16_t most = 1;
    for (uint32_t x = 0; x < SIDE; x++) most = last[x] > most ? last[x] : most;
    return (uint32_t)most;
}

/* The texels of a block; of its coefficients the first counts for nothing. */
LW_WIDE_INLINE void restore_block(const struct lw_tile_dct *dct, const int16_t *coefficient, float mean,
                                  float step, uint32_t diagonals, struct span s, float *plane) {
    float *block = plane + s.at;
    if (s.width < SIDE || s.height < SIDE) {
        for (uint32_t y = 0; y < s.height; y++)
            store(block + y * STRIDE, scaled(coefficient + y * SIDE, step));
        block[0] = mean;
        inverse(dct, block, STRIDE, s.width, s.height, diagonals);
    } else if (diagonals == 1)
        for (uint32_t y = 0; y < SIDE; y++) store(block + y * STRIDE, every(mean * (1.0f / SIDE)));
    else if (diagonals <= SIDE / 2)
        inverse8(dct, coefficient, mean, step, SIDE / 2, block);
    else
        inverse8(dct, coefficient, mean, step, SIDE, block);
}

/* A plane from its coefficients and its means' coefficients.
 * length: of the blocks' lists, if nothing but what they held is in the coefficients; else NULL */
LW_WIDE static void restore_plane(struct lw_tile_dct *dct, float *plane, uint32_t width, uint32_t height,
                                  float step, const int16_t *coefficients, const int32_t *grid,
                                  const uint8_t *length) {
    const uint32_t across = blocks(width), down = blocks(height);
    LW_INVARIANT(across - 1 < GRID && down - 1 < GRID && step > 0);
    for (uint32_t i = 0; i < BLOCK_TEXELS; i++) dct->mean[i] = (float)grid[i] * step;
    inverse(dct, dct->mean, SIDE, across, down, across + down - 1);
    for (uint32_t by = 0; by < down; by++)
        for (uint32_t bx = 0; bx < across; bx++) {
            const struct span s = span_of(bx, by, width, height);
            const int16_t *coefficient = coefficients + block_at(width, bx, by);
            const uint8_t last = length ? dct->rans.scan[s.width][s.height][length[by * GRID + bx]] : 0;
            restore_block(dct, coefficient, dct->mean[by * SIDE + bx], step,
                          length ? 1u + last / SIDE + last % SIDE : diagonals_of(coefficient, s.height), s,
                          plane);
        }
}

/* ---- decoding ---- */

LW_WIDE_INLINE int16_t kept_of(int32_t coefficient) {
    return (int16_t)(coefficient > KEPT_MAX ? KEPT_MAX : coefficient < -KEPT_MAX ? -KEPT_MAX : coefficient);
}

/* The coefficients of a payload. The first of each block is that of its mean as far as it fits; grid has them
 * all, by rows of SIDE. length: see lw_tile_rans_get() */
static bool get_coefficients(struct lw_tile_dct *dct, uint32_t planes, uint32_t kind, const uint8_t *src,
                             size_t src_size, uint32_t width, uint32_t height, int16_t *coefficient,
                             int32_t grid[PLANES][BLOCK_TEXELS], uint8_t *length) {
    const uint32_t across = blocks(width), down = blocks(height);
    const uint8_t *rest;
    size_t rest_size, rest_free;
    if (src_size < HEADER_SIZE || src[0] != kind || src[1] > LW_TILE_DCT_STEP_Q_MAX ||
        !lw_tile_rans_get(&dct->rans, planes, src + HEADER_SIZE, src_size - HEADER_SIZE, width, height,
                          coefficient, length, &rest, &rest_size, &rest_free))
        return false;
    memset(grid, 0, planes * sizeof *grid);
    struct lw_tile_bits_reader r = {.at = rest, .end = rest + rest_size};
    for (uint32_t p = 0; p < planes; p++) {
        if (!get_means(&r, dct->rans.scan[across][down], across * down, kind, grid[p])) return false;
        for (uint32_t by = 0; by < down; by++)
            for (uint32_t bx = 0; bx < across; bx++)
                coefficient[p * plane_coefficients(width, height) + block_at(width, bx, by)] =
                    kept_of(grid[p][by * SIDE + bx]);
    }
    return lw_tile_bits_is_at_end(&r, rest_size > rest_free ? 7 : 8 * rest_free);
}

/* Adds dct->change to the kept coefficients of a tile; its means go into grid. False if a sum does not fit.
 * */
LW_WIDE static bool add_change(const struct lw_tile_dct *dct, uint32_t planes, const uint8_t *length,
                               uint32_t width, uint32_t height, int16_t *kept,
                               int32_t grid[PLANES][BLOCK_TEXELS]) {
    short8 outside = {0};
    for (uint32_t p = 0; p < planes; p++)
        for (uint32_t by = 0; by < blocks(height); by++)
            for (uint32_t bx = 0; bx < blocks(width); bx++) {
                const uint32_t n = length[(p * GRID + by) * GRID + bx],
                               b = p * plane_coefficients(width, height) + block_at(width, bx, by);
                grid[p][by * SIDE + bx] += kept[b];
                outside[0] |= grid[p][by * SIDE + bx] != kept_of(grid[p][by * SIDE + bx]);
                for (uint32_t i = b; i < b + (n ? BLOCK_TEXELS : SIDE); i += SIDE) {
                    short8 was, change;
                    memcpy(&was, kept + i, sizeof was);
                    memcpy(&change, dct->change + i, sizeof change);
                    const short8 is = (short8)((unsigned8)was + (unsigned8)change);
                    outside |= (((is ^ was) & (is ^ change)) < 0) | (is == INT16_MIN);
                    memcpy(kept + i, &is, sizeof is);
                }
            }
    int16_t any = 0;
    for (uint32_t i = 0; i < SIDE; i++) any |= outside[i];
    return !any;
}

static void scales_of(float scale, const int8_t gain[3], float out[3]) {
    for (int c = 0; c < 3; c++) out[c] = scale * exp2f((float)gain[c] / LW_TILE_DCT_GAIN_UNIT);
}

static float step_of(uint32_t q) { return exp2f(1 - (float)q / 8); }

/* The texels of planes that are values over a scale. */
LW_WIDE static void put_plain(const struct lw_tile_dct *dct, const struct lw_tile_channel *channel,
                              uint32_t width, uint32_t height, float scale, float *texels) {
    for (uint32_t y = 0; y < height; y++)
        for (uint32_t x = 0; x < width; x++)
            for (uint32_t p = 0; p < channel->planes; p++) {
                const float value = dct->plane[p][y * STRIDE + x] * scale;
                *texels++ = channel->is_signed || value > 0 ? value : 0;
            }
}

bool lw_tile_dct_decode(struct lw_tile_dct *dct, const struct lw_tile_channel *channel, uint32_t kind,
                        const uint8_t *src, size_t src_size, float scale, uint32_t width, uint32_t height,
                        struct lw_tile_dct_coefficients *coefficients, float *rgb) {
    if (width - 1 >= LW_TILE_SIDE || height - 1 >= LW_TILE_SIDE || !(scale > 0) || !(scale <= SCALE_MAX))
        return false;
    const bool is_delta = kind == LW_TILE_DCT_DELTA;
    const uint32_t planes = planes_of(channel);
    int16_t *coefficient = coefficients ? coefficients->coefficient : dct->coefficient;
    int32_t grid[PLANES][BLOCK_TEXELS];
    uint8_t length[LW_TILE_RANS_BLOCKS];
    if (!get_coefficients(dct, planes, kind, src, src_size, width, height,
                          is_delta ? dct->change : coefficient, grid, length) ||
        (is_delta && !add_change(dct, planes, length, width, height, coefficient, grid)))
        return false;
    for (uint32_t p = 0; p < planes; p++)
        restore_plane(dct, dct->plane[p], width, height, step_of(src[1]),
                      coefficient + p * plane_coefficients(width, height), grid[p],
                      is_delta ? NULL : length + p * GRID * GRID);
    if (is_plain(channel)) {
        put_plain(dct, channel, width, height, scale, rgb);
        return !(src[2] | src[3] | src[4]);
    }
    const int8_t gain[3] = {(int8_t)src[2], (int8_t)src[3], (int8_t)src[4]};
    float scales[3];
    scales_of(scale, gain, scales);
    put_texels(dct, width, height, scales, rgb);
    return true;
}

/* ---- encoding ---- */

/* The power of two over what the scale is to be; 1 for a black tile. The scale is a share of the mean, but no
 * smaller than dark. It is the mean of a tile that is darker, and smaller for a dark part. */
static float choose_scale(float mean, float dark_part, float dark) {
    if (!(mean > 0)) return 1;
    int exponent;
    const float whole = fminf(fmaxf(mean / MEAN_IN_SCALES, dark), mean);
    const float part = fmaxf(fminf(whole, dark_part * DARK_PART_SCALES), whole * DARK_PART_LEAST);
    frexpf(fmaxf(part, dark * LW_TILE_DCT_BLACK), &exponent);
    return clamp(ldexpf(1, exponent), SCALE_MIN, SCALE_MAX);
}

LW_WIDE_INLINE int32_t sum8(whole8 x) { return x[0] + x[1] + x[2] + x[3] + x[4] + x[5] + x[6] + x[7]; }

/* Copies light into planes, values that are no numbers as 0; counts these, and the covered texels. Rows are
 * filled up: no rests of another tile. */
LW_WIDE static uint32_t take_light(struct lw_tile_dct *dct, const float *rgb, const uint8_t *covered,
                                   uint32_t width, uint32_t height, uint32_t *out_saturated) {
    whole8 saturated = {0}, count = {0};
    for (uint32_t y = 0; y < height; y++)
        for (uint32_t x = 0; x < STRIDE; x += SIDE) {
            const size_t from = (size_t)y * width + x;
            const uint32_t texels = x >= width ? 0 : width - x < SIDE ? width - x : SIDE;
            float texel[3 * SIDE] = {0};
            byte8 cover = {0};
            if (texels == SIDE) {
                memcpy(texel, rgb + from * 3, sizeof texel);
                cover += 1;
                if (covered) memcpy(&cover, covered + from, sizeof cover);
            } else if (texels) {
                const byte8 ones = {1, 1, 1, 1, 1, 1, 1, 1};
                memcpy(texel, rgb + from * 3, texels * 3 * sizeof *texel);
                memcpy(&cover, covered ? (const void *)(covered + from) : &ones, texels);
            }
            const whole8 weight = __builtin_convertvector(cover != 0, whole8) & 1;
            store(dct->weight + y * STRIDE + x, __builtin_convertvector(weight, row8));
            count += weight;
            row8 channel[3];
            part_channels(texel, channel);
            for (uint32_t c = 0; c < 3; c++) {
                const whole8 fits = (channel[c] >= 0) & (channel[c] <= LIGHT_MAX); /* 0 for NaN */
                store(dct->light[c] + y * STRIDE + x, (row8)((whole8)channel[c] & fits));
                saturated += weight & ~fits;
            }
        }
    *out_saturated = (uint32_t)sum8(saturated);
    return (uint32_t)sum8(count);
}

/* The same for values that are coded by their difference; *out_largest: their largest size in covered texels.
 * */
static uint32_t take_plain(struct lw_tile_dct *dct, const struct lw_tile_dct_source *source,
                           float *out_largest, uint32_t *out_saturated) {
    uint32_t count = 0;
    const size_t bytes = source->height * STRIDE * sizeof(float);
    *out_saturated = 0;
    *out_largest = 0;
    memset(dct->weight, 0, bytes);
    for (uint32_t p = 0; p < source->channel->planes; p++) memset(dct->light[p], 0, bytes);
    for (uint32_t i = 0; i < source->width * source->height; i++) {
        const bool covered = !source->covered || source->covered[i];
        const uint32_t at = i / source->width * STRIDE + i % source->width;
        dct->weight[at] = covered;
        count += covered;
        for (uint32_t p = 0; p < source->channel->planes; p++) {
            const float value = source->rgb[i * source->channel->planes + p], size = fabsf(value);
            const bool fits = size <= LIGHT_MAX && (source->channel->is_signed || value >= 0); /* no NaN */
            dct->light[p][at] = fits ? value : 0;
            *out_saturated += covered && !fits;
            if (covered && fits && size > *out_largest) *out_largest = size;
        }
    }
    return count;
}

/* The power of two above it; 1 for a tile of zeros. */
static float scale_above(float largest) {
    int exponent;
    if (!(largest > 0)) return 1;
    frexpf(largest, &exponent);
    return clamp(ldexpf(1, exponent), SCALE_MIN, SCALE_MAX);
}

LW_WIDE static void scale_plain(struct lw_tile_dct *dct, uint32_t planes, uint32_t height, float inverse) {
    for (uint32_t p = 0; p < planes; p++)
        for (uint32_t i = 0; i < height * STRIDE; i++) dct->plane[p][i] = dct->light[p][i] * inverse;
}

LW_WIDE_INLINE float add_up(row8 row) {
    return row[0] + row[1] + row[2] + row[3] + row[4] + row[5] + row[6] + row[7];
}

/* The sum of covered texels. */
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

/* Sets *mean to that of a block's covered texels; false, and nothing: it has none. */
LW_WIDE_INLINE bool find_block_mean(const struct lw_tile_dct *dct, const float *plane, struct span s,
                                    float *mean) {
    row8 sum = {0}, weights = {0};
    for (uint32_t at = s.at; at < s.at + s.height * STRIDE; at += STRIDE) {
        sum += load(plane + at) * load(dct->weight + at);
        weights += load(dct->weight + at);
    }
    const float count = add_up(weights);
    if (count > 0) *mean = add_up(sum) / count;
    return count > 0;
}

/* No client reads uncovered texels, so they take the value of least cost: the mean of the block's covered
 * texels, or of the last earlier block that has any. */
LW_WIDE static void fill_uncovered(const struct lw_tile_dct *dct, float *plane, uint32_t width,
                                   uint32_t height) {
    float mean = 0;
    for (uint32_t by = 0; by < blocks(height); by++)
        for (uint32_t bx = 0; bx < blocks(width); bx++) {
            const struct span s = span_of(bx, by, width, height);
            const float *weight = dct->weight + s.at;
            float *block = plane + s.at;
            (void)find_block_mean(dct, plane, s, &mean);
            for (uint32_t y = 0; y < s.height; y++)
                store(block + y * STRIDE,
                      choose(load(weight + y * STRIDE) > 0, load(block + y * STRIDE), every(mean)));
        }
}

LW_WIDE_INLINE whole8 coefficients_of(row8 steps, float round, float most) {
    const row8 size = clamp8((row8)((whole8)steps & 0x7fffffff) + round, 0, most);
    const whole8 negative = steps < 0;
    return (__builtin_convertvector(size, whole8) ^ negative) - negative;
}

/* A row of coefficients, quantised. kept: what they were; NULL: they build on nothing. */
LW_WIDE_INLINE whole8 quantise(const float *row, uint32_t width, float inverse_step, float round, float most,
                               const int16_t *kept) {
    const whole8 place = {0, 1, 2, 3, 4, 5, 6, 7}, inside = place < (int32_t)width;
    const row8 steps = load(row) * inverse_step;
    whole8 coefficients = coefficients_of(steps, round, most);
    if (kept) {
        short8 short_row;
        memcpy(&short_row, kept, sizeof short_row);
        const whole8 was = __builtin_convertvector(short_row, whole8);
        const row8 off = steps - __builtin_convertvector(was, row8);
        const whole8 near = (off < LW_TILE_DCT_HOLD) & (off > -LW_TILE_DCT_HOLD);
        coefficients = (was & near) | (coefficients & ~near);
    }
    return coefficients & inside;
}

/* A plane's coefficients into `coefficient`, those of the means into `grid`, by rows of SIDE. */
LW_WIDE static void quantise_plane(struct lw_tile_dct *dct, float *plane, uint32_t width, uint32_t height,
                                   float step, const int16_t *kept, int16_t *coefficient, int32_t *grid) {
    const uint32_t across = blocks(width), down = blocks(height);
    int16_t kept_grid[BLOCK_TEXELS] = {0};
    memset(dct->mean, 0, sizeof dct->mean);
    for (uint32_t by = 0; by < down; by++)
        for (uint32_t bx = 0; bx < across; bx++) {
            const struct span s = span_of(bx, by, width, height);
            const uint32_t first = block_at(width, bx, by);
            forward(dct, plane + s.at, STRIDE, s.width, s.height);
            dct->mean[by * SIDE + bx] = plane[s.at];
            for (uint32_t y = 0; y < SIDE; y++) {
                short8 row = {0};
                if (y < s.height)
                    row = __builtin_convertvector(quantise(plane + s.at + y * STRIDE, s.width, 1 / step,
                                                           ROUND_AC, KEPT_MAX,
                                                           kept ? kept + first + y * SIDE : NULL),
                                                  short8);
                memcpy(coefficient + first + y * SIDE, &row, sizeof row);
            }
            if (kept) kept_grid[by * SIDE + bx] = kept[first];
        }
    forward(dct, dct->mean, SIDE, across, down);
    memset(grid, 0, BLOCK_TEXELS * sizeof *grid);
    for (uint32_t by = 0; by < down; by++) {
        const whole8 row = quantise(dct->mean + by * SIDE, across, 1 / step, ROUND_MEAN, MEAN_COEFFICIENT_MAX,
                                    kept ? kept_grid + by * SIDE : NULL);
        memcpy(grid + by * SIDE, &row, sizeof row);
        for (uint32_t bx = 0; bx < across; bx++) coefficient[block_at(width, bx, by)] = kept_of(row[bx]);
    }
}

/* Into dct->change, and grids; false if a coefficient is as large as what stands for all larger ones, or a
 * difference is larger. */
LW_WIDE static bool find_change(struct lw_tile_dct *dct, uint32_t planes, const int16_t *from,
                                const int16_t *to, uint32_t width, uint32_t height,
                                int32_t grid[PLANES][BLOCK_TEXELS]) {
    short8 outside = {0};
    for (uint32_t i = 0; i < planes * plane_coefficients(width, height); i += SIDE) {
        short8 was, is;
        memcpy(&was, from + i, sizeof was);
        memcpy(&is, to + i, sizeof is);
        const short8 change = (short8)((unsigned8)is - (unsigned8)was);
        outside |= (was == KEPT_MAX) | (was <= -KEPT_MAX) | (is == KEPT_MAX) | (is <= -KEPT_MAX) |
                   (((is ^ was) & (is ^ change)) < 0) | (change == INT16_MIN);
        memcpy(dct->change + i, &change, sizeof change);
    }
    memset(grid, 0, planes * sizeof *grid);
    for (uint32_t p = 0; p < planes; p++)
        for (uint32_t by = 0; by < blocks(height); by++)
            for (uint32_t bx = 0; bx < blocks(width); bx++)
                grid[p][by * SIDE + bx] =
                    dct->change[p * plane_coefficients(width, height) + block_at(width, bx, by)];
    int16_t any = 0;
    for (uint32_t i = 0; i < SIDE; i++) any |= outside[i];
    return !any;
}

/* The light of the block that a quarter of the tile's blocks are darker than. Black blocks do not count.
 * INFINITY: all are black. */
LW_WIDE static float find_dark_part(const struct lw_tile_dct *dct, uint32_t width, uint32_t height) {
    float light[GRID * GRID]; /* in the order of size */
    uint32_t count = 0;
    for (uint32_t by = 0; by < blocks(height); by++)
        for (uint32_t bx = 0; bx < blocks(width); bx++) {
            float mean[3] = {0};
            for (uint32_t c = 0; c < 3; c++)
                (void)find_block_mean(dct, dct->light[c], span_of(bx, by, width, height), &mean[c]);
            const float own = (mean[0] + mean[1] + mean[2]) / 3;
            if (!(own > 0)) continue;
            uint32_t at = count++;
            for (; at > 0 && light[at - 1] > own; at--) light[at] = light[at - 1];
            light[at] = own;
        }
    return count ? light[(count - 1) / 4] : INFINITY;
}

/* A mean of logarithms is under the logarithm of the mean, so noise has become darker. One factor
 * per channel makes up for it. False if no gain does, and the mean is off by more than black. */
static bool choose_gain(double was, double is, double black, uint8_t *out_gain) {
    *out_gain = 0;
    const double gain = was > 0 && is > 0 ? LW_TILE_DCT_GAIN_UNIT * log2(was / is) : (double)INFINITY;
    if (!(fabs(gain) <= GAIN_MAX)) return fabs(was - is) <= black;
    *out_gain = (uint8_t)(int8_t)lrint(gain);
    return true;
}

static size_t put_payload(struct lw_tile_dct *dct, uint32_t planes, uint32_t kind, uint32_t q,
                          const uint8_t gain[3], const int16_t *coefficient,
                          int32_t grid[PLANES][BLOCK_TEXELS], uint32_t width, uint32_t height, uint8_t *dst) {
    uint8_t means[MEANS_BOUND];
    struct lw_tile_bits_writer w = {.at = means};
    const uint32_t across = blocks(width), down = blocks(height);
    for (uint32_t p = 0; p < planes; p++)
        put_means(&w, grid[p], dct->rans.scan[across][down], across * down, kind);
    LW_INVARIANT((size_t)(lw_tile_bits_end(&w) - means) <= MEANS_BOUND && q <= LW_TILE_DCT_STEP_Q_MAX);
    dst[0] = (uint8_t)kind;
    dst[1] = (uint8_t)q;
    memcpy(dst + 2, gain, 3);
    return HEADER_SIZE + lw_tile_rans_put(&dct->rans, planes, coefficient, width, height, means,
                                          (size_t)(lw_tile_bits_end(&w) - means), dst + HEADER_SIZE);
}

/* With one step; false if it is so coarse that the mean is lost. delta_dst: NULL: what history holds is of no
 * use. */
static bool encode(struct lw_tile_dct *dct, const struct lw_tile_dct_source *source, uint32_t covered_count,
                   uint32_t q, const double sum[3], struct lw_tile_dct_history *history, uint8_t *dst,
                   uint8_t *delta_dst, struct lw_tile_dct_coded *coded) {
    const uint32_t width = source->width, height = source->height, stride = plane_coefficients(width, height);
    const uint32_t planes = planes_of(source->channel);
    const bool plain = is_plain(source->channel);
    const float scale = coded->scale;
    int32_t grid[PLANES][BLOCK_TEXELS], change[PLANES][BLOCK_TEXELS];
    if (plain)
        scale_plain(dct, planes, height, 1 / scale);
    else
        take_logarithms(dct, height, 1 / scale);
    memset(dct->coefficient, 0, lw_tile_dct_coefficients_size(source->channel, width, height));
    for (uint32_t p = 0; p < planes; p++) {
        if (covered_count < width * height) fill_uncovered(dct, dct->plane[p], width, height);
        quantise_plane(dct, dct->plane[p], width, height, step_of(q),
                       delta_dst ? history->coefficients.coefficient + p * stride : NULL,
                       dct->coefficient + p * stride, grid[p]);
        if (!plain)
            restore_plane(dct, dct->plane[p], width, height, step_of(q), dct->coefficient + p * stride,
                          grid[p], NULL);
    }
    uint8_t gain[3] = {0};
    bool kept_mean = true;
    if (!plain) {
        double restored[3];
        sum_light(dct, height, scale, restored);
        LW_INVARIANT(restored[0] >= 0 && restored[1] >= 0 && restored[2] >= 0 &&
                     isfinite(restored[0] + restored[1] + restored[2]));
        const double black = MEAN_OFF_MAX * (double)scale * covered_count;
        for (int c = 0; c < 3; c++) kept_mean &= choose_gain(sum[c], restored[c], black, gain + c);
    }
    coded->size =
        put_payload(dct, planes, LW_TILE_DCT_INTRA, q, gain, dct->coefficient, grid, width, height, dst);
    coded->delta_size = 0;
    if (delta_dst &&
        find_change(dct, planes, history->coefficients.coefficient, dct->coefficient, width, height, change))
        coded->delta_size = put_payload(dct, planes, LW_TILE_DCT_DELTA, q, gain, dct->change, change, width,
                                        height, delta_dst);
    if (history) {
        history->q = q;
        history->scale = scale;
        memcpy(history->coefficients.coefficient, dct->coefficient,
               lw_tile_dct_coefficients_size(source->channel, width, height));
    }
    return kept_mean;
}

/* True: a tile of this scale and step takes those of its history. */
static bool continues_history(const struct lw_tile_dct_history *history, float scale, uint32_t q) {
    return history && history->scale >= scale / NEAR_SCALE && history->scale <= scale * NEAR_SCALE &&
           history->q + NEAR_Q >= q && history->q <= q + NEAR_Q;
}

void lw_tile_dct_encode(struct lw_tile_dct *dct, const struct lw_tile_dct_source *source,
                        struct lw_tile_dct_history *history, uint8_t *dst, uint8_t *delta_dst,
                        struct lw_tile_dct_coded *out_coded) {
    const uint32_t width = source->width, height = source->height;
    const float q_wanted = ceilf(8 - 8 * log2f(source->step > 0 ? source->step : 0x1p-20f));
    uint32_t q = (uint32_t)clamp(q_wanted, 0, LW_TILE_DCT_STEP_Q_MAX);
    uint32_t count;
    double sum[3] = {0};
    float largest;
    if (is_plain(source->channel)) {
        count = take_plain(dct, source, &largest, &out_coded->saturated);
        out_coded->scale = scale_above(largest);
    } else {
        count = take_light(dct, source->rgb, source->covered, width, height, &out_coded->saturated);
        for (int c = 0; c < 3; c++) sum[c] = sum_of(dct, dct->light[c], height);
        out_coded->scale = choose_scale((float)((sum[0] + sum[1] + sum[2]) / (3.0 * count)),
                                        find_dark_part(dct, width, height), source->dark);
    }
    LW_INVARIANT(count <= width * height && out_coded->scale >= SCALE_MIN && out_coded->scale <= SCALE_MAX);
    LW_INVARIANT(sum[0] >= 0 && sum[1] >= 0 && sum[2] >= 0 && isfinite(sum[0] + sum[1] + sum[2]));
    const bool continues = continues_history(history, out_coded->scale, q);
    if (continues) {
        LW_INVARIANT(history->scale >= SCALE_MIN && history->scale <= SCALE_MAX &&
                     history->q <= LW_TILE_DCT_STEP_Q_MAX);
        out_coded->scale = history->scale;
        q = history->q;
    }
    if (!continues) delta_dst = NULL;
    /* A few texels that shine hundreds of times as bright as the rest make up the mean: these need a finer
     * step. */
    while (!encode(dct, source, count, q, sum, history, dst, delta_dst, out_coded) &&
           q < LW_TILE_DCT_STEP_Q_MAX) {
        q = q + FINER_Q < LW_TILE_DCT_STEP_Q_MAX ? q + FINER_Q : LW_TILE_DCT_STEP_Q_MAX;
        delta_dst = NULL;
    }
}

/* ---- from two payloads ---- */

size_t lw_tile_dct_encode_between(struct lw_tile_dct *dct, const struct lw_tile_channel *channel,
                                  const uint8_t *from, size_t from_size, const uint8_t *to, size_t to_size,
                                  uint32_t width, uint32_t height, struct lw_tile_dct_coefficients scratch[2],
                                  uint8_t *dst) {
    const uint32_t planes = planes_of(channel);
    int32_t grid[PLANES][BLOCK_TEXELS];
    uint8_t length[LW_TILE_RANS_BLOCKS];
    if (width - 1 >= LW_TILE_SIDE || height - 1 >= LW_TILE_SIDE ||
        !get_coefficients(dct, planes, LW_TILE_DCT_INTRA, from, from_size, width, height,
                          scratch[0].coefficient, grid, length) ||
        !get_coefficients(dct, planes, LW_TILE_DCT_INTRA, to, to_size, width, height, scratch[1].coefficient,
                          grid, length) ||
        !find_change(dct, planes, scratch[0].coefficient, scratch[1].coefficient, width, height, grid))
        return 0;
    return put_payload(dct, planes, LW_TILE_DCT_DELTA, to[1], to + 2, dct->change, grid, width, height, dst);
}

/* Means that a whole payload holds: the first coefficient of each block. False if one is as large as what
 * stands for all larger ones. */
static bool means_of(const int16_t *coefficient, uint32_t planes, uint32_t width, uint32_t height,
                     int32_t grid[PLANES][BLOCK_TEXELS]) {
    bool fits = true;
    memset(grid, 0, planes * sizeof *grid);
    for (uint32_t p = 0; p < planes; p++)
        for (uint32_t by = 0; by < blocks(height); by++)
            for (uint32_t bx = 0; bx < blocks(width); bx++) {
                const int16_t mean =
                    coefficient[p * plane_coefficients(width, height) + block_at(width, bx, by)];
                grid[p][by * SIDE + bx] = mean;
                fits &= mean < KEPT_MAX && mean > -KEPT_MAX;
            }
    return fits;
}

size_t lw_tile_dct_encode_sum(struct lw_tile_dct *dct, const struct lw_tile_channel *channel,
                              const uint8_t *from, size_t from_size, const uint8_t *delta, size_t delta_size,
                              uint32_t width, uint32_t height, struct lw_tile_dct_coefficients *scratch,
                              uint8_t *dst) {
    const uint32_t planes = planes_of(channel);
    int32_t grid[PLANES][BLOCK_TEXELS];
    uint8_t length[LW_TILE_RANS_BLOCKS];
    int16_t *coefficient = scratch->coefficient;
    if (width - 1 >= LW_TILE_SIDE || height - 1 >= LW_TILE_SIDE ||
        !get_coefficients(dct, planes, LW_TILE_DCT_INTRA, from, from_size, width, height, coefficient, grid,
                          length) ||
        !means_of(coefficient, planes, width, height, grid) ||
        !get_coefficients(dct, planes, LW_TILE_DCT_DELTA, delta, delta_size, width, height, dct->change, grid,
                          length) ||
        !add_change(dct, planes, length, width, height, coefficient, grid) ||
        !means_of(coefficient, planes, width, height, grid) ||
        (is_plain(channel) && (delta[2] | delta[3] | delta[4])))
        return 0;
    return put_payload(dct, planes, LW_TILE_DCT_INTRA, delta[1], delta + 2, coefficient, grid, width, height,
                       dst);
}
