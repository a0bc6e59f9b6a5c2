#include "common/tile/tile_dct.h"

#include "common/tile/tile_bits.h"
#include "common/wide.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

#define SIDE           LW_TILE_DCT_SIDE
#define BLOCK_TEXELS   (SIDE * SIDE)
#define STRIDE         LW_TILE_SIDE
#define GRID           (LW_TILE_SIDE / SIDE) /* blocks beside each other, at most */
#define HEADER_SIZE    5u
#define VALUE_MAX_BITS 0x427c0000 /* 63.0f: of log2(1 + E/scale) */
#define SCALE_MAX      0x1p60f    /* so that scale * 2^63 is a float */
#define SCALE_MIN      0x1p-60f
#define LIGHT_MAX      0x1p100f
#define RICE_K_MAX     16u
#define GRID_LENGTH_K  4u      /* of the length of the means' block, which nothing predicts */
#define SURPRISE_K     3u      /* of the length of a block among empty ones */
#define MEAN_OFF_MAX   0x1p-12 /* of a scale */
#define GAIN_MAX       127.0   /* 2^(127/512): a factor of 1.19 */
#define FINER_Q        8u      /* half the step */
#define LEVEL_MAX      ((1 << LW_TILE_BITS_RAW) - 1)
#define KEPT_MAX       32767
#define NEAR_SCALE     2.0f /* a history serves as long as its scale */
#define NEAR_Q         6u   /* and step are so near what the tile wants by itself */

/* The mean of a tile lies about so many scales up: what is darker than a scale is coded absolutely, not relatively. */
#define MEAN_IN_SCALES 32.0f

/* Levels are rounded down from a bit over the half: zeros are cheap, and what is dropped is mostly noise. More than this
 * costs in contrast: with 0.38 errors at borders of charts grew by half for 8 % of the bits. */
#define ROUND_AC   0.44f
#define ROUND_MEAN 0.5f

_Static_assert(GRID <= SIDE, "the means of a plane's blocks are one block");

static void fill_tables(struct lw_tile_dct *dct);

void lw_tile_dct_init(struct lw_tile_dct *dct) {
    memset(dct, 0, sizeof *dct);
    fill_tables(dct);
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
typedef int8_t byte8 __attribute__((vector_size(SIDE)));
typedef int16_t short8 __attribute__((vector_size(SIDE * sizeof(int16_t))));

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

/* Of the nearest number within 0 and VALUE_MAX, to 4e-6 of the value: the exponential series around the nearest whole number.
 * Floats >= 0 are in the order of their bits; compilers take comparisons of vectors wider than registers apart. */
LW_WIDE_INLINE row16 exp2_of(row16 x) {
    whole16 below = (whole16)x;
    below = (below & ~(below >> 31)) - VALUE_MAX_BITS;
    const row16 inside = (row16)((below & (below >> 31)) + VALUE_MAX_BITS);
    const whole16 whole = __builtin_convertvector(inside + 0.5f, whole16);
    const row16 f = (inside - __builtin_convertvector(whole, row16)) * 0.693147181f;
    const row16 power = 1 + f * (1 + f * (1 / 2.0f + f * (1 / 6.0f + f * (1 / 24.0f + f * (1 / 120.0f)))));
    return power * (row16)((whole + 127) << 23);
}

/* In place, from E as planes: three logarithms as one of brightness and two of colour. What is off by some amount in a plane
 * is off by about the same in the logarithms. */
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

/* Sums over what is covered, of the light that planes hold. */
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

LW_WIDE_INLINE row8 scaled(const int32_t *levels, float step) {
    whole8 row;
    memcpy(&row, levels, sizeof row);
    return __builtin_convertvector(row, row8) * step;
}

/* cos(k pi/16) / 2 */
#define C1 0.490392640f
#define C2 0.461939766f
#define C3 0.415734806f
#define C5 0.277785117f
#define C6 0.191341716f
#define C7 0.097545161f
#define R8 0.353553391f /* 1/sqrt(8) */

/* A whole block from its levels, of which only those of the first `count` rows and columns are not 0: 4 or 8, known when this is
 * compiled. The second transform takes even and odd frequencies apart: the lower half mirrors the upper one, odd ones with
 * the opposite sign. */
LW_WIDE_INLINE void inverse8(const struct lw_tile_dct *dct, const int32_t *level, float mean, float step,
                             uint32_t count, float *block) {
    row8 c[SIDE] = {0};
    for (uint32_t v = 0; v < count; v++) {
        float u[SIDE];
        store(u, scaled(level + v * SIDE, step));
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

/* The means' levels, in rows of SIDE, out of those of all blocks; the rest of the grid stays as it is. */
LW_WIDE_INLINE void take_grid(const int32_t *level, uint32_t across, uint32_t down, int32_t *grid) {
    for (uint32_t by = 0; by < down; by++)
        for (uint32_t bx = 0; bx < across; bx++)
            grid[by * SIDE + bx] = level[(by * GRID + bx) * BLOCK_TEXELS];
}

/* ---- levels that are kept ---- */

LW_WIDE_INLINE uint32_t plane_levels(uint32_t height) { return blocks(height) * GRID * BLOCK_TEXELS; }

static int16_t *plane_of(struct lw_tile_dct_levels *levels, int plane, uint32_t height) {
    return levels->level + (uint32_t)plane * plane_levels(height);
}

size_t lw_tile_dct_levels_size(uint32_t height) { return 3 * plane_levels(height) * sizeof(int16_t); }

size_t lw_tile_dct_history_size(uint32_t height) {
    return offsetof(struct lw_tile_dct_history, levels) + lw_tile_dct_levels_size(height);
}

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

/* A length among short ones is 0 for the most part, and anything otherwise. */
LW_WIDE_INLINE void put_length(struct lw_tile_bits_writer *w, uint32_t length, unsigned k) {
    if (k) {
        lw_tile_bits_put_rice(w, length, k, 0, 0);
        return;
    }
    lw_tile_bits_put(w, length > 0, 1);
    if (length) lw_tile_bits_put_rice(w, length - 1, SURPRISE_K, 0, 0);
}

LW_WIDE_INLINE uint32_t get_length(struct lw_tile_bits_reader *r, unsigned k) {
    if (k) return lw_tile_bits_get_rice(r, k);
    const bool any = r->held & 1;
    lw_tile_bits_drop(r, 1);
    return any ? 1 + lw_tile_bits_get_rice(r, SURPRISE_K) : 0;
}

/* Codes of levels are looked up, with their signs: in one table for each of the small rice_k(), in one for levels that are
 * known not to be 0, whose rice_k() is 0. All others are in a table that holds nothing. */
enum { TABLE_OTHERS = LW_TILE_DCT_TABLES - 2, TABLE_KNOWN };

static void fill_tables(struct lw_tile_dct *dct) {
    for (uint32_t t = 0; t < LW_TILE_DCT_TABLES; t++) {
        const uint32_t known = t == TABLE_KNOWN, k = known ? 0 : t;
        for (uint32_t size = known; t != TABLE_OTHERS && size < LW_TILE_DCT_SIZES; size++) {
            uint8_t bytes[16];
            struct lw_tile_bits_writer w = {.at = bytes};
            lw_tile_bits_put_rice(&w, size - known, k, 0, size > 0);
            const uint32_t count = (uint32_t)(w.at - bytes) * 8 + w.count;
            if (count > 24) continue;
            const uint32_t bits = bytes[0] | (uint32_t)bytes[1] << 8 | (uint32_t)bytes[2] << 16;
            dct->bits_of_size[t][size] = bits | count << 24;
            for (uint32_t rest = 0; count <= LW_TILE_DCT_PEEK && rest < 1u << (LW_TILE_DCT_PEEK - count);
                 rest++) {
                dct->level_of_bits[t][rest << count | bits] = size << 16 | size << 8 | count;
                if (size) /* the last bit says that it is negative */
                    dct->level_of_bits[t][rest << count | bits | 1u << (count - 1)] =
                        (0 - size) << 16 | size << 8 | count;
            }
        }
    }
    for (uint32_t sum = 0; sum < 2 * LW_TILE_DCT_SIZES; sum++) {
        const uint32_t k = rice_k(sum, 0), t = k < TABLE_OTHERS ? k : TABLE_OTHERS;
        dct->table_of_sum[sum] = (uint8_t)t;
        dct->levels_of_sum[sum] = dct->level_of_bits[t];
    }
}

/* Levels of one block, `level` by rows and `scan` without what is coded elsewhere: how many up to the last that is not 0,
 * then those, the last one first; after two zeros, how many more there are. */
LW_WIDE_INLINE uint32_t put_levels(struct lw_tile_bits_writer *w, const struct lw_tile_dct *dct,
                                   const int32_t *level, const uint8_t *scan, uint32_t count, unsigned k,
                                   unsigned run_k) {
    while (count && !level[scan[count - 1]]) count--;
    put_length(w, count, k);
    uint32_t a = 0, b = 0, table = TABLE_KNOWN;
    for (uint32_t i = count; i-- > 0;) {
        if (table != TABLE_KNOWN && !(a | b)) {
            uint32_t run = 0;
            while (run <= i && !level[scan[i - run]]) run++;
            lw_tile_bits_put_rice(w, run, run_k, 0, 0);
            if (run > i) break;
            i -= run;
            table = TABLE_KNOWN;
        }
        const int32_t v = level[scan[i]];
        const uint32_t size = (uint32_t)(v < 0 ? -v : v);
        const uint32_t code = size < LW_TILE_DCT_SIZES ? dct->bits_of_size[table][size] : 0;
        if (code)
            lw_tile_bits_put(w, (code & 0xffffff) | (uint64_t)(v < 0) << (code >> 24) >> 1, code >> 24);
        else
            lw_tile_bits_put_rice(w, size - (table == TABLE_KNOWN), rice_k(a, b), v < 0, size != 0);
        b = a;
        a = size;
        table = a + b < 2 * LW_TILE_DCT_SIZES ? dct->table_of_sum[a + b] : TABLE_OTHERS;
    }
    return count;
}

/* Into `level`, by rows, which is 0 but for what the scan leaves out. False for what the block has no room for. */
LW_WIDE_INLINE bool get_levels(struct lw_tile_bits_reader *r, const struct lw_tile_dct *dct,
                               const uint8_t *scan, uint32_t count, unsigned k, unsigned run_k,
                               int32_t *level, uint8_t *out_length) {
    lw_tile_bits_refill(r);
    const uint32_t length = get_length(r, k);
    if (length > count) return false;
    *out_length = (uint8_t)length;
    /* What the bits mean follows from the two sizes before: the table of a sum is found by the newest of them alone. */
    const uint32_t *const known = dct->level_of_bits[TABLE_KNOWN], *const *of_sum = dct->levels_of_sum;
    const uint32_t *table = known;
    size_t a = 0, b = 0;
    for (uint32_t i = length; i;) {
        lw_tile_bits_refill(r);
        const uint32_t code = table[r->held & ((1u << LW_TILE_DCT_PEEK) - 1)];
        i--;
        if (__builtin_expect(code != 0, 1)) {
            lw_tile_bits_drop(r, code & 0xff);
            level[scan[i]] = (int32_t)code >> 16;
            b = a;
            a = code >> 8 & 0xff;
            table = of_sum[a];
            of_sum = dct->levels_of_sum + a;
        } else {
            const uint32_t size =
                lw_tile_bits_get_rice(r, rice_k((uint32_t)a, (uint32_t)b)) + (table == known);
            const bool is_negative = size && r->held & 1;
            lw_tile_bits_drop(r, size > 0);
            level[scan[i]] = is_negative ? -(int32_t)size : (int32_t)size;
            b = a;
            a = size;
            table =
                a + b < 2 * LW_TILE_DCT_SIZES ? dct->levels_of_sum[a + b] : dct->level_of_bits[TABLE_OTHERS];
            of_sum =
                dct->levels_of_sum + (a < LW_TILE_DCT_SIZES ? a : 0); /* after larger ones it is not used */
        }
        if (a | b) continue;
        if (!i) break;
        lw_tile_bits_refill(r);
        const uint32_t run = lw_tile_bits_get_rice(r, run_k);
        if (run > i) return false;
        i -= run;
        table = known;
    }
    return true;
}

/* ---- decoding ---- */

/* What is kept of a block to what was read, if that is a difference, and the sum back. Adds to `outside` where a sum does not
 * fit. */
LW_WIDE_INLINE void keep_block(int32_t *levels, int16_t *kept, bool is_delta, whole8 *outside) {
    for (uint32_t i = 0; i < BLOCK_TEXELS; i += SIDE) {
        whole8 level;
        short8 was;
        memcpy(&level, levels + i, sizeof level);
        memcpy(&was, kept + i, sizeof was);
        if (is_delta) level += __builtin_convertvector(was, whole8);
        memcpy(levels + i, &level, sizeof level);
        const whole8 low = level<-KEPT_MAX, high = level> KEPT_MAX;
        *outside |= low | high;
        level = (level & ~(low | high)) | (KEPT_MAX & high) | (-KEPT_MAX & low);
        was = __builtin_convertvector(level, short8);
        memcpy(kept + i, &was, sizeof was);
    }
}

LW_WIDE_INLINE bool is_any(whole8 x) {
    int32_t any = 0;
    for (uint32_t i = 0; i < SIDE; i++) any |= x[i];
    return any != 0;
}

/* The encoder's. False if a level does not fit. */
LW_WIDE static bool keep_plane(struct lw_tile_dct *dct, int16_t *kept, uint32_t width, uint32_t height) {
    whole8 outside = {0};
    for (uint32_t by = 0; by < blocks(height); by++)
        for (uint32_t b = by * GRID; b < by * GRID + blocks(width); b++)
            keep_block(dct->level + b * BLOCK_TEXELS, kept + b * BLOCK_TEXELS, false, &outside);
    return !is_any(outside);
}

/* How many diagonals of a block's levels are not all 0, one at least. */
LW_WIDE_INLINE uint32_t diagonals_of(const int32_t *level, uint32_t height) {
    const whole8 place = {1, 2, 3, 4, 5, 6, 7, 8};
    whole8 last = {1};
    for (uint32_t y = 0; y < height; y++) {
        whole8 row;
        memcpy(&row, level + y * SIDE, sizeof row);
        const whole8 diagonal = (row != 0) & (place + (int32_t)y);
        last = (diagonal & (diagonal > last)) | (last & ~(diagonal > last));
    }
    int32_t most = 1;
    for (uint32_t x = 0; x < SIDE; x++) most = last[x] > most ? last[x] : most;
    return (uint32_t)most;
}

/* The texels of a block; of its levels the first counts for nothing. */
LW_WIDE_INLINE void restore_block(const struct lw_tile_dct *dct, const int32_t *level, float mean, float step,
                                  uint32_t diagonals, struct span s, float *plane) {
    float *block = plane + s.at;
    if (s.width < SIDE || s.height < SIDE) {
        for (uint32_t y = 0; y < s.height; y++) store(block + y * STRIDE, scaled(level + y * SIDE, step));
        block[0] = mean;
        inverse(dct, block, STRIDE, s.width, s.height, diagonals);
    } else if (diagonals == 1)
        for (uint32_t y = 0; y < SIDE; y++) store(block + y * STRIDE, every(mean * (1.0f / SIDE)));
    else if (diagonals <= SIDE / 2)
        inverse8(dct, level, mean, step, SIDE / 2, block);
    else
        inverse8(dct, level, mean, step, SIDE, block);
}

/* From the means' levels to the means. */
LW_WIDE_INLINE void restore_means(struct lw_tile_dct *dct, const int32_t *grid, float step, uint32_t across,
                                  uint32_t down) {
    for (uint32_t y = 0; y < SIDE; y++) store(dct->mean + y * SIDE, scaled(grid + y * SIDE, step));
    inverse(dct, dct->mean, SIDE, across, down, across + down - 1);
}

/* The encoder's: a plane from dct->level. */
LW_WIDE static void restore_plane(struct lw_tile_dct *dct, float *plane, uint32_t width, uint32_t height,
                                  float step) {
    const uint32_t across = blocks(width), down = blocks(height);
    int32_t grid[BLOCK_TEXELS] = {0};
    take_grid(dct->level, across, down, grid);
    restore_means(dct, grid, step, across, down);
    for (uint32_t by = 0; by < down; by++)
        for (uint32_t bx = 0; bx < across; bx++) {
            const struct span s = span_of(bx, by, width, height);
            const int32_t *level = dct->level + (by * GRID + bx) * BLOCK_TEXELS;
            restore_block(dct, level, dct->mean[by * SIDE + bx], step, diagonals_of(level, s.height), s,
                          plane);
        }
}

/* A plane from its bits. What goes into a block's transform is ready long before the next block's bits are read, one waiting
 * for the other: the processor does both at once.
 * kept: of the plane; NULL: nothing is */
LW_WIDE static bool get_plane(struct lw_tile_dct *dct, float *plane, uint32_t width, uint32_t height,
                              uint32_t kind, float step, int16_t *kept, struct lw_tile_bits_reader *reader) {
    struct lw_tile_bits_reader r = *reader; /* in registers */
    const uint32_t across = blocks(width), down = blocks(height);
    const bool is_delta = kind == LW_TILE_DCT_DELTA;
    int32_t grid[BLOCK_TEXELS] = {0};
    uint8_t length[GRID * GRID], grid_length;
    whole8 outside = {0};
    if (!get_levels(&r, dct, dct->scan[across][down], across * down, GRID_LENGTH_K, kind, grid, &grid_length))
        return false;
    for (uint32_t by = 0; is_delta && by < down; by++)
        for (uint32_t bx = 0; bx < across; bx++)
            grid[by * SIDE + bx] += kept[(by * GRID + bx) * BLOCK_TEXELS];
    restore_means(dct, grid, step, across, down);
    for (uint32_t by = 0; by < down; by++) {
        memset(length + by * GRID, 0, across);
        lw_tile_bits_refill(&r);
        const bool any = r.held & 1;
        lw_tile_bits_drop(&r, 1);
        for (uint32_t bx = 0; bx < across; bx++) {
            const struct span s = span_of(bx, by, width, height);
            const uint32_t b = by * GRID + bx;
            const uint8_t *scan = dct->scan[s.width][s.height];
            _Alignas(64) int32_t level[BLOCK_TEXELS] = {0};
            if (any && !get_levels(&r, dct, scan + 1, s.width * s.height - 1, length_k(length, bx, by), kind,
                                   level, length + b))
                return false;
            uint32_t diagonals = 1 + scan[length[b]] / SIDE + scan[length[b]] % SIDE;
            if (kept) {
                int16_t *kept_block = kept + b * BLOCK_TEXELS;
                level[0] = grid[by * SIDE + bx];
                if (is_delta) kept_block[0] = 0; /* it is in the grid */
                keep_block(level, kept_block, is_delta, &outside);
                if (is_delta) diagonals = diagonals_of(level, s.height);
            }
            restore_block(dct, level, dct->mean[by * SIDE + bx], step, diagonals, s, plane);
        }
    }
    *reader = r;
    return !(is_delta && is_any(outside));
}

static void scales_of(float scale, const int8_t gain[3], float out[3]) {
    for (int c = 0; c < 3; c++) out[c] = scale * exp2f((float)gain[c] / LW_TILE_DCT_GAIN_UNIT);
}

static float step_of(uint32_t q) { return exp2f(1 - (float)q / 8); }

bool lw_tile_dct_decode(struct lw_tile_dct *dct, uint32_t kind, const uint8_t *src, size_t src_size,
                        float scale, uint32_t width, uint32_t height, struct lw_tile_dct_levels *levels,
                        float *rgb) {
    if (width - 1 >= LW_TILE_SIDE || height - 1 >= LW_TILE_SIDE || !(scale > 0) || !(scale <= SCALE_MAX))
        return false;
    if (src_size < HEADER_SIZE || src[0] != kind || src[1] > LW_TILE_DCT_STEP_Q_MAX) return false;
    const int8_t gain[3] = {(int8_t)src[2], (int8_t)src[3], (int8_t)src[4]};
    struct lw_tile_bits_reader r = {.at = src + HEADER_SIZE, .end = src + src_size};
    for (int p = 0; p < 3; p++)
        if (!get_plane(dct, dct->plane[p], width, height, kind, step_of(src[1]),
                       levels ? plane_of(levels, p, height) : NULL, &r))
            return false;
    if (!lw_tile_bits_is_at_end(&r)) return false;
    float scales[3];
    scales_of(scale, gain, scales);
    put_texels(dct, width, height, scales, rgb);
    return true;
}

/* ---- encoding ---- */

/* The power of two over a share of the mean, or what is dark; 1 for a black tile. */
static float choose_scale(double mean, float dark) {
    if (!(mean > 0)) return 1;
    int exponent;
    frexpf(fmaxf((float)mean / MEAN_IN_SCALES, dark), &exponent);
    return clamp(ldexpf(1, exponent), SCALE_MIN, SCALE_MAX);
}

LW_WIDE_INLINE int32_t sum8(whole8 x) { return x[0] + x[1] + x[2] + x[3] + x[4] + x[5] + x[6] + x[7]; }

/* Into planes, with what is no number as 0; counts that, and the covered texels. Rows are filled up: no rests of another
 * tile. */
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

LW_WIDE_INLINE whole8 levels_of(row8 steps, float round) {
    const row8 size = clamp8((row8)((whole8)steps & 0x7fffffff) + round, 0, LEVEL_MAX);
    const whole8 negative = steps < 0;
    return (__builtin_convertvector(size, whole8) ^ negative) - negative;
}

/* Coefficients to levels. kept: what they were, by rows of SIDE; NULL: they build on nothing. */
LW_WIDE_INLINE void quantise(const float *block, uint32_t stride, uint32_t width, uint32_t height, float step,
                             float round, const int16_t *kept, int32_t *level) {
    const whole8 place = {0, 1, 2, 3, 4, 5, 6, 7}, inside = place < (int32_t)width;
    const float inverse_step = 1 / step;
    for (uint32_t y = 0; y < SIDE; y++) {
        whole8 levels = {0};
        if (y < height) {
            const row8 steps = load(block + y * stride) * inverse_step;
            levels = levels_of(steps, round);
            if (kept) {
                short8 row;
                memcpy(&row, kept + y * SIDE, sizeof row);
                const whole8 was = __builtin_convertvector(row, whole8);
                const row8 off = steps - __builtin_convertvector(was, row8);
                const whole8 near = (off < LW_TILE_DCT_HOLD) & (off > -LW_TILE_DCT_HOLD);
                levels = (was & near) | (levels & ~near);
            }
            levels &= inside;
        }
        memcpy(level + y * SIDE, &levels, sizeof levels);
    }
}

/* The plane's levels into dct->level. */
LW_WIDE static void quantise_plane(struct lw_tile_dct *dct, float *plane, uint32_t width, uint32_t height,
                                   float step, const int16_t *kept) {
    const uint32_t across = blocks(width), down = blocks(height);
    int32_t grid[BLOCK_TEXELS] = {0};
    int16_t kept_grid[BLOCK_TEXELS] = {0};
    memset(dct->mean, 0, sizeof dct->mean);
    for (uint32_t by = 0; by < down; by++)
        for (uint32_t bx = 0; bx < across; bx++) {
            const struct span s = span_of(bx, by, width, height);
            const uint32_t first = (by * GRID + bx) * BLOCK_TEXELS;
            forward(dct, plane + s.at, STRIDE, s.width, s.height);
            dct->mean[by * SIDE + bx] = plane[s.at];
            quantise(plane + s.at, STRIDE, s.width, s.height, step, ROUND_AC, kept ? kept + first : NULL,
                     dct->level + first);
            if (kept) kept_grid[by * SIDE + bx] = kept[first];
        }
    forward(dct, dct->mean, SIDE, across, down);
    quantise(dct->mean, SIDE, across, down, step, ROUND_MEAN, kept ? kept_grid : NULL, grid);
    for (uint32_t by = 0; by < down; by++)
        for (uint32_t bx = 0; bx < across; bx++)
            dct->level[(by * GRID + bx) * BLOCK_TEXELS] = grid[by * SIDE + bx];
}

LW_WIDE static void put_plane(const struct lw_tile_dct *dct, const int32_t *level, uint32_t width,
                              uint32_t height, unsigned run_k, struct lw_tile_bits_writer *writer) {
    struct lw_tile_bits_writer w = *writer; /* in registers */
    const uint32_t across = blocks(width), down = blocks(height);
    int32_t grid[BLOCK_TEXELS] = {0};
    uint8_t length[GRID * GRID];
    take_grid(level, across, down, grid);
    put_levels(&w, dct, grid, dct->scan[across][down], across * down, GRID_LENGTH_K, run_k);
    for (uint32_t by = 0; by < down; by++) {
        uint32_t most[GRID], all = 0; /* of the levels of each block beyond the first: so many may be not 0 */
        for (uint32_t bx = 0; bx < across; bx++) {
            const struct span s = span_of(bx, by, width, height);
            const uint32_t diagonals = diagonals_of(level + (by * GRID + bx) * BLOCK_TEXELS, s.height);
            const uint32_t places = diagonals * (diagonals + 1) / 2, texels = s.width * s.height;
            most[bx] = (places < texels ? places : texels) - 1;
            all |= most[bx];
        }
        memset(length + by * GRID, 0, across);
        lw_tile_bits_put(&w, all > 0, 1);
        for (uint32_t bx = 0; all && bx < across; bx++) {
            const struct span s = span_of(bx, by, width, height);
            const uint32_t b = by * GRID + bx;
            length[b] =
                (uint8_t)put_levels(&w, dct, level + b * BLOCK_TEXELS, dct->scan[s.width][s.height] + 1,
                                    most[bx], length_k(length, bx, by), run_k);
        }
    }
    *writer = w;
}

LW_WIDE static void find_change(struct lw_tile_dct *dct, const int16_t *kept, uint32_t width,
                                uint32_t height) {
    for (uint32_t by = 0; by < blocks(height); by++)
        for (uint32_t i = by * GRID * BLOCK_TEXELS; i < (by * GRID + blocks(width)) * BLOCK_TEXELS; i++)
            dct->change[i] = dct->level[i] - kept[i];
}

/* A mean of logarithms is under the logarithm of the mean, so what was noise has become darker. One factor per channel
 * makes up for it. False if no gain does, and the mean is off by more than black. */
static bool choose_gain(double was, double is, double black, uint8_t *out_gain) {
    *out_gain = 0;
    const double gain = was > 0 && is > 0 ? LW_TILE_DCT_GAIN_UNIT * log2(was / is) : (double)INFINITY;
    if (!(fabs(gain) <= GAIN_MAX)) return fabs(was - is) <= black;
    *out_gain = (uint8_t)(int8_t)lrint(gain);
    return true;
}

static size_t finish_payload(uint8_t *dst, uint32_t kind, uint32_t q, const uint8_t gain[3],
                             struct lw_tile_bits_writer *w) {
    dst[0] = (uint8_t)kind;
    dst[1] = (uint8_t)q;
    memcpy(dst + 2, gain, 3);
    return (size_t)(lw_tile_bits_end(w) - dst);
}

/* With one step; false if it is so coarse that the mean is lost. delta_dst: NULL: what history holds is of no use. */
static bool encode(struct lw_tile_dct *dct, const struct lw_tile_dct_source *source, uint32_t covered_count,
                   uint32_t q, const double sum[3], struct lw_tile_dct_history *history, uint8_t *dst,
                   uint8_t *delta_dst, struct lw_tile_dct_coded *coded) {
    const uint32_t width = source->width, height = source->height;
    const float scale = coded->scale;
    struct lw_tile_bits_writer w = {.at = dst + HEADER_SIZE}, delta = {0};
    if (delta_dst) delta.at = delta_dst + HEADER_SIZE;
    bool fits = true;
    take_logarithms(dct, height, 1 / scale);
    for (int p = 0; p < 3; p++) {
        int16_t *kept = history ? plane_of(&history->levels, p, height) : NULL;
        if (covered_count < width * height) fill_uncovered(dct, dct->plane[p], width, height);
        quantise_plane(dct, dct->plane[p], width, height, step_of(q), delta_dst ? kept : NULL);
        put_plane(dct, dct->level, width, height, LW_TILE_DCT_INTRA, &w);
        if (delta_dst) {
            find_change(dct, kept, width, height);
            put_plane(dct, dct->change, width, height, LW_TILE_DCT_DELTA, &delta);
        }
        if (kept) fits &= keep_plane(dct, kept, width, height);
        restore_plane(dct, dct->plane[p], width, height, step_of(q));
    }
    double restored[3];
    sum_light(dct, height, scale, restored);
    uint8_t gain[3];
    bool kept_mean = true;
    const double black = MEAN_OFF_MAX * (double)scale * covered_count;
    for (int c = 0; c < 3; c++) kept_mean &= choose_gain(sum[c], restored[c], black, gain + c);
    coded->size = finish_payload(dst, LW_TILE_DCT_INTRA, q, gain, &w);
    coded->delta_size = delta_dst && fits ? finish_payload(delta_dst, LW_TILE_DCT_DELTA, q, gain, &delta) : 0;
    if (history) {
        history->q = q;
        history->scale = fits ? scale : 0;
    }
    return kept_mean;
}

/* Whether a tile of this scale and step may go on with those of its history: then they are its own. */
static bool goes_on(const struct lw_tile_dct_history *history, float scale, uint32_t q) {
    return history && history->scale >= scale / NEAR_SCALE && history->scale <= scale * NEAR_SCALE &&
           history->q + NEAR_Q >= q && history->q <= q + NEAR_Q;
}

void lw_tile_dct_encode(struct lw_tile_dct *dct, const struct lw_tile_dct_source *source,
                        struct lw_tile_dct_history *history, uint8_t *dst, uint8_t *delta_dst,
                        struct lw_tile_dct_coded *out_coded) {
    const uint32_t width = source->width, height = source->height;
    const float q_wanted = ceilf(8 - 8 * log2f(source->step > 0 ? source->step : 0x1p-20f));
    uint32_t q = (uint32_t)clamp(q_wanted, 0, LW_TILE_DCT_STEP_Q_MAX);
    const uint32_t count =
        take_light(dct, source->rgb, source->covered, width, height, &out_coded->saturated);
    double sum[3];
    for (int c = 0; c < 3; c++) sum[c] = sum_of(dct, dct->light[c], height);
    out_coded->scale = choose_scale((sum[0] + sum[1] + sum[2]) / (3.0 * count), source->dark);
    const bool continues = goes_on(history, out_coded->scale, q);
    if (continues) {
        out_coded->scale = history->scale;
        q = history->q;
    }
    if (!continues) delta_dst = NULL;
    /* A few texels that shine hundreds of times as bright as the rest make up the mean: these need a finer step. */
    while (!encode(dct, source, count, q, sum, history, dst, delta_dst, out_coded) &&
           q < LW_TILE_DCT_STEP_Q_MAX) {
        q = q + FINER_Q < LW_TILE_DCT_STEP_Q_MAX ? q + FINER_Q : LW_TILE_DCT_STEP_Q_MAX;
        delta_dst = NULL;
    }
}

/* ---- between two payloads ---- */

/* The levels of a payload that builds on nothing. */
static bool get_intra_levels(struct lw_tile_dct *dct, const uint8_t *src, size_t src_size, uint32_t width,
                             uint32_t height, struct lw_tile_dct_levels *out_levels) {
    if (src_size < HEADER_SIZE || src[0] != LW_TILE_DCT_INTRA || src[1] > LW_TILE_DCT_STEP_Q_MAX)
        return false;
    struct lw_tile_bits_reader r = {.at = src + HEADER_SIZE, .end = src + src_size};
    for (int p = 0; p < 3; p++)
        if (!get_plane(dct, dct->plane[p], width, height, LW_TILE_DCT_INTRA, step_of(src[1]),
                       plane_of(out_levels, p, height), &r))
            return false;
    return lw_tile_bits_is_at_end(&r);
}

/* As keep_block() cuts them off: one of these may stand for a larger one. */
static bool is_beyond(int16_t level) { return level == INT16_MAX || level == INT16_MIN; }

static bool find_difference(struct lw_tile_dct *dct, const int16_t *from, const int16_t *to, uint32_t width,
                            uint32_t height) {
    bool beyond = false;
    for (uint32_t by = 0; by < blocks(height); by++)
        for (uint32_t i = by * GRID * BLOCK_TEXELS; i < (by * GRID + blocks(width)) * BLOCK_TEXELS; i++) {
            beyond |= is_beyond(from[i]) | is_beyond(to[i]);
            dct->change[i] = to[i] - from[i];
        }
    return !beyond;
}

size_t lw_tile_dct_encode_between(struct lw_tile_dct *dct, const uint8_t *from, size_t from_size,
                                  const uint8_t *to, size_t to_size, uint32_t width, uint32_t height,
                                  struct lw_tile_dct_levels scratch[2], uint8_t *dst) {
    if (width - 1 >= LW_TILE_SIDE || height - 1 >= LW_TILE_SIDE ||
        !get_intra_levels(dct, from, from_size, width, height, &scratch[0]) ||
        !get_intra_levels(dct, to, to_size, width, height, &scratch[1]))
        return 0;
    struct lw_tile_bits_writer w = {.at = dst + HEADER_SIZE};
    for (int p = 0; p < 3; p++) {
        if (!find_difference(dct, plane_of(&scratch[0], p, height), plane_of(&scratch[1], p, height), width,
                             height))
            return 0;
        put_plane(dct, dct->change, width, height, LW_TILE_DCT_DELTA, &w);
    }
    return finish_payload(dst, LW_TILE_DCT_DELTA, to[1], to + 2, &w);
}
