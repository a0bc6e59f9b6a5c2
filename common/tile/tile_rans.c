#include "common/tile/tile_rans.h"

#include "common/base/invariant.h"
#include "common/base/wide.h"

#include <stddef.h>
#include <stdlib.h>
#include <string.h>
#if defined(__x86_64__) && defined(__GNUC__)
#define HAVE_X86
#include <immintrin.h>
#endif

#define SIDE              LW_TILE_RANS_SIDE
#define PLACES            LW_TILE_RANS_PLACES
#define LANES             LW_TILE_RANS_LANES
#define GRID              (LW_TILE_SIDE / SIDE)
#define SLOT_BITS         10u
#define STATE_LOW         0x10000u     /* a state below takes a word */
#define NONE              (PLACES - 1) /* no list is that long */
#define FAR               LW_TILE_RANS_FAR
#define NEAR_MAX          LW_TILE_RANS_NEAR_MAX
#define LANE_COEFFICIENTS 64u /* coefficients that make another lane worth its state */
#define CLASSES           15u
/* More than a group of lists takes that runs past the end: of each coefficient two words. */
#define SLACK      (PLACES * LANES * 4)
#define TABLE_LAST 15u /* for a list's last coefficient, which is not 0 */

_Static_assert(1u << SLOT_BITS == LW_TILE_RANS_SLOTS, "slots are the low bits of a state");

/* ---- the tables of the format ---- */

/* Tokens: sizes 0 to 15, then ranges; their raw bits, for coefficients one of them the sign. */
static const uint8_t coefficient_base[] = {0,  1,  2,  3,  4,  5,  6,  7,  8,  9,  10, 11,
                                           12, 13, 14, 15, 16, 20, 24, 32, 40, 56, 72, FAR};
static const uint8_t coefficient_raw[] = {0, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1,
                                          1, 1, 1, 1, 3, 3, 4, 4, 5, 5, 6, 1};
static const uint8_t length_base[] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 24, 32, 48};
static const uint8_t length_raw[] = {0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 3, 3, 4, 4};

#define COEFFICIENT_TABLES 16u

/* Slots of each token, by table: counted over tiles of the atrium, Sponza and the Cornell box at steps of 0.1
 * to 0.5, as bench_rans_tables counted them (docs/lab/codec.md; it is in the tree up to commit a0037187). */
static const uint16_t share_of[LW_TILE_RANS_TABLES][LW_TILE_RANS_TOKENS] = {
    {909, 89, 5, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1},
    {853, 135, 13, 3, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1},
    {705, 266, 29, 4, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1},
    {634, 305, 50, 11, 4, 2, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1},
    {558, 342, 78, 20, 6, 2, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1},
    {463, 387, 111, 30, 10, 4, 2, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1},
    {340, 393, 173, 61, 24, 10, 5, 2, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1},
    {380, 313, 144, 68, 37, 21, 16, 12, 8, 5, 4, 3, 2, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1},
    {252, 353, 209, 99, 47, 23, 12, 7, 4, 3, 2, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1},
    {193, 280, 219, 130, 72, 44, 27, 16, 11, 7, 5, 4, 3, 2, 1, 1, 2, 1, 1, 1, 1, 1, 1, 1},
    {139, 219, 203, 154, 105, 68, 43, 28, 19, 12, 8, 6, 4, 3, 2, 1, 3, 1, 1, 1, 1, 1, 1, 1},
    {99, 158, 154, 140, 118, 91, 67, 51, 37, 26, 19, 14, 10, 7, 6, 5, 10, 4, 3, 1, 1, 1, 1, 1},
    {67, 107, 107, 104, 97, 90, 78, 67, 56, 46, 37, 30, 25, 20, 16, 13, 31, 14, 11, 3, 2, 1, 1, 1},
    {38, 59, 60, 60, 58, 57, 55, 55, 53, 50, 46, 45, 41, 36, 33, 29, 90, 56, 58, 23, 16, 4, 1, 1},
    {18, 30, 29, 29, 28, 30, 29, 29, 28, 30, 28, 28, 27, 28, 27, 27, 97, 82, 126, 87, 93, 42, 33, 19},
    {0, 858, 99, 27, 12, 6, 4, 2, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1},
    {942, 8, 13, 2, 4, 4, 1, 2, 2, 2, 1, 1, 1, 1, 1, 1, 5, 5, 9, 19},
    {496, 175, 187, 17, 19, 19, 7, 7, 7, 9, 4, 3, 4, 3, 4, 1, 13, 12, 21, 16},
    {285, 43, 463, 13, 26, 39, 8, 10, 9, 20, 4, 4, 4, 4, 8, 2, 17, 19, 24, 22},
    {372, 42, 107, 27, 44, 55, 25, 23, 22, 46, 11, 10, 12, 14, 19, 7, 45, 42, 57, 44},
    {295, 24, 55, 15, 28, 36, 15, 18, 23, 38, 10, 13, 13, 16, 26, 8, 79, 85, 133, 94},
    {307, 14, 23, 9, 17, 17, 7, 12, 12, 15, 5, 9, 9, 12, 12, 6, 57, 91, 142, 248},
    {98, 12, 22, 7, 14, 14, 7, 9, 13, 14, 7, 8, 9, 12, 13, 10, 66, 116, 238, 335},
    {42, 2, 4, 1, 3, 3, 1, 3, 3, 3, 1, 2, 2, 3, 2, 2, 14, 24, 95, 814},
};

/* By diagonal of the coefficient's place: up to 1, 3, 6, and beyond; and by class_of() the sum of its
 * neighbours. */
static const uint8_t near_tables[4][CLASSES] = {
    {4, 7, 7, 7, 9, 10, 11, 12, 12, 13, 14, 14, 14, 14, 14},
    {1, 3, 5, 6, 8, 9, 10, 11, 12, 13, 13, 14, 14, 14, 14},
    {0, 2, 4, 5, 6, 8, 10, 11, 12, 12, 13, 13, 14, 14, 14},
    {1, 3, 5, 6, 8, 9, 10, 11, 12, 12, 13, 13, 13, 14, 14},
};
static const uint8_t length_tables[CLASSES] = {16, 17, 17, 17, 18, 19, 19, 19, 20, 20, 20, 21, 22, 23, 23};

/* 0, 1, then two for each power of two. */
static unsigned class_of(unsigned sum) {
    if (sum < 2) return sum;
    const unsigned power = 31u - (unsigned)__builtin_clz(sum);
    return 2 * power + (sum >> (power - 1) & 1);
}

static enum lw_tile_rans_isa best_isa(void) {
#ifdef HAVE_X86
    if (__builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512bw") &&
        __builtin_cpu_supports("avx512dq"))
        return LW_TILE_RANS_AVX512;
    if (__builtin_cpu_supports("avx2")) return LW_TILE_RANS_AVX2;
#endif
    return LW_TILE_RANS_SCALAR;
}

/* A token's symbol, with the raw bits of a coefficient or length: see put_symbol(). */
static uint32_t symbol_of(uint32_t first, uint32_t share, uint32_t raw, uint32_t raw_bits) {
    return first | raw << SLOT_BITS | share << 16 | raw_bits << 26;
}

static void fill_table(struct lw_tile_rans *rans, uint32_t t) {
    const bool of_coefficients = t < COEFFICIENT_TABLES;
    const uint8_t *base = of_coefficients ? coefficient_base : length_base,
                  *raw_bits = of_coefficients ? coefficient_raw : length_raw;
    for (uint32_t token = 0, first = 0; token < LW_TILE_RANS_TOKENS; first += share_of[t][token++]) {
        const uint32_t share = share_of[t][token];
        if (!share) continue;
        for (uint32_t i = 0; i < share; i++)
            rans->slot[t][first + i] =
                share | i << 10 | (uint32_t)raw_bits[token] << 20 | (uint32_t)base[token] << 24;
        for (uint32_t raw = 0; raw < 1u << raw_bits[token]; raw++)
            if (!of_coefficients)
                rans->length_symbol[t][base[token] + raw] = symbol_of(first, share, raw, raw_bits[token]);
            else if (!(raw & 1)) /* the sign is the encoder's to add */
                rans->coefficient_symbol[t][base[token] + raw / 2] =
                    symbol_of(first, share, raw, raw_bits[token]);
    }
}

void lw_tile_rans_init(struct lw_tile_rans *rans) {
    memset(rans, 0, sizeof *rans);
    for (uint32_t w = 1; w <= SIDE; w++)
        for (uint32_t h = 1; h <= SIDE; h++) {
            uint8_t *at = rans->scan[w][h];
            for (uint32_t d = 0; d < w + h - 1; d++)
                for (uint32_t row = 0; row < h; row++)
                    if (row <= d && d - row < w) *at++ = (uint8_t)(row * SIDE + d - row);
        }
    for (uint32_t t = 0; t < LW_TILE_RANS_TABLES; t++) fill_table(rans, t);
    for (uint32_t share = 1; share < LW_TILE_RANS_SLOTS; share++)
        rans->reciprocal[share] =
            ((uint64_t)1 << 42) / share + ((uint64_t)1 << 42 != ((uint64_t)1 << 42) / share * share);
    for (uint32_t sum = 0; sum < sizeof rans->length_table; sum++)
        rans->length_table[sum] = length_tables[class_of(sum)];
    uint8_t at[SIDE + 2][SIDE + 2];
    memset(at, NONE, sizeof at);
    const uint8_t *scan = rans->scan[SIDE][SIDE] + 1;
    for (uint32_t i = 0; i < PLACES - 1; i++) {
        at[scan[i] / SIDE][scan[i] % SIDE] = (uint8_t)i;
        rans->rank[scan[i]] = (int16_t)(i + 1);
    }
    for (uint32_t i = 0; i < PLACES - 1; i++) {
        const uint32_t u = scan[i] % SIDE, v = scan[i] / SIDE, d = u + v;
        const uint8_t near[] = {at[v][u + 1], at[v + 1][u], at[v + 1][u + 1], at[v][u + 2], at[v + 2][u]};
        memcpy(rans->neighbour[i], near, sizeof near);
        rans->diagonal[i] = d <= 1 ? 0 : d <= 3 ? 1 : d <= 6 ? 2 : 3;
    }
    for (uint32_t sum = 0; sum < sizeof rans->class_of_sum; sum++)
        rans->class_of_sum[sum] = (uint8_t)class_of(sum);
    for (uint32_t d = 0; d < 4; d++)
        for (uint32_t c = 0; c < CLASSES; c++) rans->near_table[d][c] = near_tables[d][c];
    for (uint32_t mask = 0; mask < 256; mask++)
        for (uint32_t lane = 0, word = 0; lane < 8; lane++) {
            rans->spread[mask][lane] = (uint8_t)word;
            word += mask >> lane & 1;
        }
    rans->isa = best_isa();
}

/* ---- blocks, in the order of the format ---- */

struct block {
    int16_t *coefficient; /* rows of SIDE */
    const uint8_t *scan;  /* without the first place */
    uint32_t length;
};

/* A tile's blocks that have a list of coefficients, the longest first. */
struct lists {
    struct block *list[LW_TILE_RANS_BLOCKS];
    uint32_t count, lanes;
};

LW_WIDE_INLINE uint32_t blocks(uint32_t texels) { return (texels + SIDE - 1) / SIDE; }

LW_WIDE_INLINE uint32_t at_most(uint32_t x, uint32_t most) { return x < most ? x : most; }

/* The lengths of the blocks to the left and above. A lone neighbour counts twice. In the corner: 0. */
LW_WIDE_INLINE uint32_t lengths_near(const uint8_t *length, uint32_t bx, uint32_t by) {
    const uint8_t *at = length + by * GRID + bx;
    const uint32_t left = bx ? at[-1] : by ? at[-(int)GRID] : 0, above = by ? at[-(int)GRID] : left;
    return left + above;
}

LW_WIDE_INLINE void sort_lists(struct block *block, uint32_t count, struct lists *out) {
    uint32_t first[PLACES] = {0}, coefficients = 0, at = 0;
    for (uint32_t i = 0; i < count; i++) {
        first[block[i].length]++;
        coefficients += block[i].length;
    }
    out->count = count - first[0];
    for (out->lanes = 1; out->lanes < LANES && coefficients >= 2 * out->lanes * LANE_COEFFICIENTS;)
        out->lanes *= 2;
    for (uint32_t n = PLACES; n-- > 1;) {
        const uint32_t of_n = first[n];
        first[n] = at;
        at += of_n;
    }
    LW_INVARIANT(at == out->count && out->count <= LW_TILE_RANS_BLOCKS); /* all that have a list */
    for (uint32_t i = 0; i < count; i++)
        if (block[i].length) out->list[first[block[i].length]++] = &block[i];
}

typedef int16_t short8 __attribute__((vector_size(SIDE * sizeof(int16_t))));
typedef uint8_t byte16 __attribute__((vector_size(LANES)));

/* The sums of sizes next to place i, of all lanes. */
LW_WIDE_INLINE byte16 sum_near(const struct lw_tile_rans *rans, uint32_t i) {
    byte16 sum = {0};
    for (uint32_t n = 0; n < 5; n++) {
        byte16 size;
        memcpy(&size, rans->size[rans->neighbour[i][n]], sizeof size);
        sum += size;
    }
    return sum;
}

/* Number of lists, the longest first, that reach place i. */
LW_WIDE_INLINE uint32_t count_active(struct block *const *list, uint32_t count, uint32_t active, uint32_t i) {
    while (active < count && list[active]->length > i) active++;
    return active;
}

/* ---- reading ---- */

struct reader {
    const uint8_t *at;
    uint32_t state[LANES];
};

LW_WIDE_INLINE uint32_t word_at(const uint8_t *at) { return at[0] | (uint32_t)at[1] << 8; }

LW_WIDE_INLINE uint32_t state_at(const uint8_t *at) { return word_at(at) | word_at(at + 2) << 16; }

/* The next token of a lane: its base, and raw bits. */
LW_WIDE_INLINE uint32_t get_token(struct reader *r, uint32_t lane, const uint32_t *slots, uint32_t *out_raw) {
    uint32_t x = r->state[lane];
    const uint32_t slot = slots[x & (LW_TILE_RANS_SLOTS - 1)], raw_bits = slot >> 20 & 7;
    x >>= SLOT_BITS;
    *out_raw = x & ((1u << raw_bits) - 1);
    x = (slot & 1023) * (x >> raw_bits) + (slot >> 10 & 1023);
    const uint32_t takes = x < STATE_LOW; /* no branch: it would be mispredicted */
    r->state[lane] = x << 16 * takes | (word_at(r->at) & (0 - takes));
    r->at += 2 * takes;
    return slot >> 24;
}

/* The sizes that are too large for tokens, after the lanes' tokens of a step. Adds to `outside` what no
 * coefficient is. */
static const uint8_t *get_far(const uint8_t *at, uint32_t lanes, int16_t *row, uint32_t *outside) {
    for (; lanes; lanes &= lanes - 1, at += 2) {
        int16_t *coefficient = &row[__builtin_ctz(lanes)];
        const uint32_t size = FAR + word_at(at);
        *outside |= size > LW_TILE_RANS_COEFFICIENT_MAX;
        *coefficient = (int16_t)(*coefficient < 0 ? -(int32_t)size : (int32_t)size);
    }
    return at;
}

typedef int16_t short16 __attribute__((vector_size(LANES * sizeof(int16_t))));

/* Lists side by side, one a lane, from the highest place down, into rans->row. */
LW_WIDE static uint32_t get_group(struct lw_tile_rans *rans, struct reader *reader, struct block **list,
                                  uint32_t count) {
    struct reader r = *reader;
    uint32_t active = 0, outside = 0;
    for (uint32_t i = list[0]->length; i-- > 0;) {
        const byte16 sums = sum_near(rans, i);
        const uint32_t *const table = rans->near_table[rans->diagonal[i]];
        uint8_t sum[LANES], base[LANES] = {0}, raw[LANES] = {0};
        memcpy(sum, &sums, sizeof sum);
        uint32_t lane = 0, bits;
        for (; lane < active; lane++) {
            base[lane] =
                (uint8_t)get_token(&r, lane, rans->slot[table[rans->class_of_sum[sum[lane]]]], &bits);
            raw[lane] = (uint8_t)bits;
        }
        for (active = count_active(list, count, active, i); lane < active; lane++) {
            base[lane] = (uint8_t)get_token(&r, lane, rans->slot[TABLE_LAST], &bits);
            raw[lane] = (uint8_t)bits;
        }
        byte16 bases, raws;
        memcpy(&bases, base, sizeof bases);
        memcpy(&raws, raw, sizeof raws);
        const byte16 sizes = bases + (raws >> 1), near = (byte16)(sizes < NEAR_MAX);
        const byte16 capped = (sizes & near) | (NEAR_MAX & ~near);
        const short16 sign = -__builtin_convertvector(raws & 1, short16);
        const short16 row = (__builtin_convertvector(sizes, short16) ^ sign) - sign;
        memcpy(rans->size[i], &capped, sizeof capped);
        memcpy(rans->row[i], &row, sizeof row);
        uint32_t far = 0;
        const byte16 is_far = (byte16)(bases == FAR);
        uint64_t any[2];
        memcpy(any, &is_far, sizeof any);
        if (__builtin_expect((any[0] | any[1]) != 0, 0)) {
            for (lane = 0; lane < LANES; lane++) far |= (uint32_t)(base[lane] == FAR) << lane;
            r.at = get_far(r.at, far, rans->row[i], &outside);
        }
    }
    *reader = r;
    return outside;
}

#ifdef HAVE_X86
#define AVX512 __attribute__((target("avx512f,avx512vl,avx512bw,avx512dq,popcnt")))
#define AVX2   __attribute__((target("avx2,popcnt")))

AVX512 static uint32_t get_group_avx512(struct lw_tile_rans *rans, struct reader *reader, struct block **list,
                                        uint32_t count) {
    const uint8_t *at = reader->at;
    __m512i x = _mm512_loadu_si512(reader->state);
    const __m512i ones = _mm512_set1_epi32(-1), ten_bits = _mm512_set1_epi32(1023),
                  one = _mm512_set1_epi32(1);
    uint32_t active = 0, outside = 0;
    for (uint32_t i = list[0]->length; i-- > 0;) {
        const __mmask16 going_on = (__mmask16)((1u << active) - 1);
        active = count_active(list, count, active, i);
        const __mmask16 lanes = (__mmask16)((1u << active) - 1);
        const __m512i sum = _mm512_cvtepu8_epi32((__m128i)sum_near(rans, i));
        /* class_of(): twice the exponent and the first bit behind it */
        const __m512i power = _mm512_sub_epi32(
            _mm512_srli_epi32(_mm512_castps_si512(_mm512_cvtepi32_ps(sum)), 22), _mm512_set1_epi32(254));
        const __m512i class = _mm512_max_epi32(power, _mm512_min_epi32(sum, one));
        const __m512i table =
            _mm512_mask_permutexvar_epi32(_mm512_set1_epi32(TABLE_LAST), going_on, class,
                                          _mm512_loadu_si512(rans->near_table[rans->diagonal[i]]));
        const __m512i at_slot =
            _mm512_or_si512(_mm512_slli_epi32(table, SLOT_BITS), _mm512_and_si512(x, ten_bits));
        const __m512i slot =
            _mm512_mask_i32gather_epi32(_mm512_setzero_si512(), lanes, at_slot, rans->slot, 4);
        const __m512i raw_bits = _mm512_and_si512(_mm512_srli_epi32(slot, 20), _mm512_set1_epi32(7));
        const __m512i above = _mm512_srli_epi32(x, SLOT_BITS);
        const __m512i raw = _mm512_andnot_si512(_mm512_sllv_epi32(ones, raw_bits), above);
        const __m512i next = _mm512_add_epi32(
            _mm512_mullo_epi32(_mm512_and_si512(slot, ten_bits), _mm512_srlv_epi32(above, raw_bits)),
            _mm512_and_si512(_mm512_srli_epi32(slot, 10), ten_bits));
        const __mmask16 takes = _mm512_mask_cmplt_epu32_mask(lanes, next, _mm512_set1_epi32(STATE_LOW));
        const __m512i words =
            _mm512_maskz_expand_epi32(takes, _mm512_cvtepu16_epi32(_mm256_loadu_si256((const __m256i *)at)));
        x = _mm512_mask_mov_epi32(x, lanes, next);
        x = _mm512_mask_or_epi32(x, takes, _mm512_slli_epi32(next, 16), words);
        at += 2 * (uint32_t)__builtin_popcount(takes);
        const __m512i base = _mm512_srli_epi32(slot, 24);
        const __m512i size = _mm512_add_epi32(base, _mm512_srli_epi32(raw, 1));
        const __m512i sign = _mm512_sub_epi32(_mm512_setzero_si512(), _mm512_and_si512(raw, one));
        const __m512i coefficient = _mm512_sub_epi32(_mm512_xor_si512(size, sign), sign);
        _mm_store_si128(
            (__m128i *)rans->size[i],
            _mm512_maskz_cvtepi32_epi8(lanes, _mm512_min_epi32(size, _mm512_set1_epi32(NEAR_MAX))));
        _mm256_store_si256((__m256i *)rans->row[i], _mm512_cvtepi32_epi16(coefficient));
        const __mmask16 far = _mm512_mask_cmpeq_epi32_mask(lanes, base, _mm512_set1_epi32(FAR));
        if (__builtin_expect(far, 0)) at = get_far(at, far, rans->row[i], &outside);
    }
    _mm512_storeu_si512(reader->state, x);
    reader->at = at;
    return outside;
}

/* Eight lanes of a step. */
struct eight {
    __m256i x, base, raw;
};

AVX2 static inline __attribute__((always_inline)) struct eight
get_eight(const struct lw_tile_rans *rans, __m256i x, __m256i sum, const uint32_t *near_table,
          __m256i going_on, __m256i lanes, const uint8_t **at) {
    const __m256i ten_bits = _mm256_set1_epi32(1023), one = _mm256_set1_epi32(1);
    const __m256i power = _mm256_sub_epi32(
        _mm256_srli_epi32(_mm256_castps_si256(_mm256_cvtepi32_ps(sum)), 22), _mm256_set1_epi32(254));
    const __m256i class = _mm256_max_epi32(power, _mm256_min_epi32(sum, one));
    const __m256i low = _mm256_permutevar8x32_epi32(_mm256_loadu_si256((const __m256i *)near_table), class),
                  high = _mm256_permutevar8x32_epi32(_mm256_loadu_si256((const __m256i *)(near_table + 8)),
                                                     class);
    __m256i table = _mm256_blendv_epi8(low, high, _mm256_cmpgt_epi32(class, _mm256_set1_epi32(7)));
    table = _mm256_blendv_epi8(_mm256_set1_epi32(TABLE_LAST), table, going_on);
    const __m256i at_slot =
        _mm256_or_si256(_mm256_slli_epi32(table, SLOT_BITS), _mm256_and_si256(x, ten_bits));
    const __m256i slot =
        _mm256_mask_i32gather_epi32(_mm256_setzero_si256(), (const int *)rans->slot, at_slot, lanes, 4);
    const __m256i raw_bits = _mm256_and_si256(_mm256_srli_epi32(slot, 20), _mm256_set1_epi32(7));
    const __m256i above = _mm256_srli_epi32(x, SLOT_BITS);
    const __m256i raw = _mm256_andnot_si256(_mm256_sllv_epi32(_mm256_set1_epi32(-1), raw_bits), above);
    const __m256i next = _mm256_add_epi32(
        _mm256_mullo_epi32(_mm256_and_si256(slot, ten_bits), _mm256_srlv_epi32(above, raw_bits)),
        _mm256_and_si256(_mm256_srli_epi32(slot, 10), ten_bits));
    const __m256i takes =
        _mm256_and_si256(lanes, _mm256_cmpeq_epi32(_mm256_srli_epi32(next, 16), _mm256_setzero_si256()));
    const uint32_t mask = (uint32_t)_mm256_movemask_ps(_mm256_castsi256_ps(takes));
    const __m256i words = _mm256_permutevar8x32_epi32(
        _mm256_cvtepu16_epi32(_mm_loadu_si128((const __m128i *)*at)),
        _mm256_cvtepu8_epi32(_mm_loadl_epi64((const __m128i *)rans->spread[mask])));
    *at += 2 * (uint32_t)__builtin_popcount(mask);
    x = _mm256_blendv_epi8(x, next, lanes);
    x = _mm256_blendv_epi8(x, _mm256_or_si256(_mm256_slli_epi32(next, 16), words), takes);
    return (struct eight){x, _mm256_srli_epi32(slot, 24), raw};
}

AVX2 static uint32_t get_group_avx2(struct lw_tile_rans *rans, struct reader *reader, struct block **list,
                                    uint32_t count) {
    const uint8_t *at = reader->at;
    const __m256i place = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7), eight = _mm256_set1_epi32(8);
    __m256i x[2] = {_mm256_loadu_si256((const __m256i *)reader->state),
                    _mm256_loadu_si256((const __m256i *)(reader->state + 8))};
    uint32_t active = 0, outside = 0;
    for (uint32_t i = list[0]->length; i-- > 0;) {
        const __m256i went = _mm256_set1_epi32((int)active);
        active = count_active(list, count, active, i);
        const __m256i go = _mm256_set1_epi32((int)active);
        const __m128i sum = (__m128i)sum_near(rans, i);
        const uint32_t *table = rans->near_table[rans->diagonal[i]];
        struct eight half[2];
        half[0] = get_eight(rans, x[0], _mm256_cvtepu8_epi32(sum), table, _mm256_cmpgt_epi32(went, place),
                            _mm256_cmpgt_epi32(go, place), &at);
        half[1] = (struct eight){x[1], _mm256_setzero_si256(), _mm256_setzero_si256()};
        if (active > 8)
            half[1] = get_eight(rans, x[1], _mm256_cvtepu8_epi32(_mm_srli_si128(sum, 8)), table,
                                _mm256_cmpgt_epi32(went, _mm256_add_epi32(place, eight)),
                                _mm256_cmpgt_epi32(go, _mm256_add_epi32(place, eight)), &at);
        x[0] = half[0].x;
        x[1] = half[1].x;
        const __m256i base = _mm256_permute4x64_epi64(_mm256_packus_epi32(half[0].base, half[1].base), 0xd8);
        __m256i raw = _mm256_permute4x64_epi64(_mm256_packus_epi32(half[0].raw, half[1].raw), 0xd8);
        /* lanes that are not active have base 0, and whatever raw bits of 0 */
        const __m256i size = _mm256_add_epi16(base, _mm256_srli_epi16(raw, 1));
        const __m256i sign =
            _mm256_sub_epi16(_mm256_setzero_si256(), _mm256_and_si256(raw, _mm256_set1_epi16(1)));
        _mm256_store_si256((__m256i *)rans->row[i], _mm256_sub_epi16(_mm256_xor_si256(size, sign), sign));
        const __m256i near = _mm256_min_epi16(size, _mm256_set1_epi16(NEAR_MAX));
        _mm_store_si128((__m128i *)rans->size[i],
                        _mm_packus_epi16(_mm256_castsi256_si128(near), _mm256_extracti128_si256(near, 1)));
        const uint32_t far = (uint32_t)_mm256_movemask_epi8(_mm256_cmpeq_epi16(base, _mm256_set1_epi16(FAR)));
        if (__builtin_expect(far, 0)) {
            uint32_t lanes = 0;
            for (uint32_t lane = 0; lane < LANES; lane++) lanes |= (far >> 2 * lane & 1) << lane;
            at = get_far(at, lanes, rans->row[i], &outside);
        }
    }
    _mm256_storeu_si256((__m256i *)reader->state, x[0]);
    _mm256_storeu_si256((__m256i *)(reader->state + 8), x[1]);
    reader->at = at;
    return outside;
}
#endif

static uint32_t get_any_group(struct lw_tile_rans *rans, struct reader *reader, struct block **list,
                              uint32_t count) {
#ifdef HAVE_X86
    if (rans->isa == LW_TILE_RANS_AVX512) return get_group_avx512(rans, reader, list, count);
    if (rans->isa == LW_TILE_RANS_AVX2) return get_group_avx2(rans, reader, list, count);
#endif
    return get_group(rans, reader, list, count);
}

/* From rans->row into blocks. */
LW_WIDE_INLINE void take_rows(struct lw_tile_rans *rans, struct block **list, uint32_t count) {
    for (uint32_t lane = 0; lane < count; lane++) {
        const struct block b = *list[lane];
        for (uint32_t i = 0; i < b.length; i++) b.coefficient[b.scan[i]] = rans->row[i][lane];
    }
}

LW_WIDE static bool get_lists(struct lw_tile_rans *rans, uint32_t planes, const uint8_t *end, uint32_t width,
                              uint32_t height, int16_t *coefficient, uint8_t *length, struct reader *reader,
                              uint32_t *out_lanes) {
    struct block block[LW_TILE_RANS_BLOCKS];
    struct lists lists;
    uint32_t count = 0, outside = 0;
    struct reader r = *reader;
    memset(coefficient, 0, planes * (size_t)blocks(width) * blocks(height) * PLACES * sizeof *coefficient);
    for (uint32_t p = 0; p < planes; p++)
        for (uint32_t by = 0; by < blocks(height); by++)
            for (uint32_t bx = 0; bx < blocks(width); bx++) {
                uint8_t *lengths = length + p * GRID * GRID;
                const uint32_t w = at_most(width - bx * SIDE, SIDE), h = at_most(height - by * SIDE, SIDE);
                uint32_t raw;
                const uint32_t base =
                    get_token(&r, 0, rans->slot[rans->length_table[lengths_near(lengths, bx, by)]], &raw);
                const uint32_t n = base + raw;
                if (n >= w * h) return false;
                lengths[by * GRID + bx] = (uint8_t)n;
                block[count++] =
                    (struct block){coefficient + ((p * blocks(height) + by) * blocks(width) + bx) * PLACES,
                                   rans->scan[w][h] + 1, n};
            }
    sort_lists(block, count, &lists);
    for (uint32_t lane = 1; lane < lists.lanes; lane++, r.at += 4) {
        r.state[lane] = state_at(r.at);
        if (r.state[lane] < STATE_LOW) return false;
    }
    *reader = r;
    for (uint32_t i = 0; i < lists.count && reader->at <= end; i += lists.lanes) {
        const uint32_t here = at_most(lists.count - i, lists.lanes);
        memset(rans->size, 0, sizeof rans->size);
        outside |= get_any_group(rans, reader, lists.list + i, here);
        take_rows(rans, lists.list + i, here);
    }
    *out_lanes = lists.lanes;
    return reader->at <= end && !outside;
}

bool lw_tile_rans_get(struct lw_tile_rans *rans, uint32_t planes, const uint8_t *src, size_t src_size,
                      uint32_t width, uint32_t height, int16_t *coefficient, uint8_t *length,
                      const uint8_t **out_rest, size_t *out_rest_size, size_t *out_rest_free) {
    if (src_size < 4 || src_size > sizeof rans->bytes - SLACK) return false;
    memcpy(rans->bytes, src, src_size);
    struct reader r = {.at = rans->bytes + 4, .state = {state_at(rans->bytes)}};
    uint8_t *const end = rans->bytes + src_size;
    uint32_t lanes;
    if (r.state[0] < STATE_LOW ||
        !get_lists(rans, planes, end, width, height, coefficient, length, &r, &lanes))
        return false;
    uint8_t *rest = rans->bytes + (r.at - rans->bytes) - 2 * lanes; /* all before it has been read */
    for (uint32_t lane = 0; lane < lanes; lane++) {
        if (r.state[lane] >> 16 != 1) return false;
        rest[2 * lane] = (uint8_t)r.state[lane];
        rest[2 * lane + 1] = (uint8_t)(r.state[lane] >> 8);
    }
    LW_INVARIANT(rest >= rans->bytes && rest <= end);
    *out_rest = rest;
    *out_rest_size = (size_t)(end - rest);
    *out_rest_free = 2 * lanes;
    return true;
}

/* ---- writing ---- */

struct writer {
    uint32_t *symbol;
    uint16_t *far;
    uint8_t *active, *far_count; /* per step */
};

LW_WIDE_INLINE bool is_any(short16 x) {
    uint64_t part[4];
    memcpy(part, &x, sizeof part);
    return (part[0] | part[1] | part[2] | part[3]) != 0;
}

/* Lists side by side as symbols, in the order of reading. */
LW_WIDE_INLINE void list_group(struct lw_tile_rans *rans, struct block **list, uint32_t count,
                               struct writer *writer) {
    struct writer w = *writer;
    uint32_t active = 0;
    memset(rans->size, 0, sizeof rans->size);
    memset(rans->row, 0, sizeof rans->row);
    for (uint32_t lane = 0; lane < count; lane++) {
        const struct block b = *list[lane];
        for (uint32_t i = 0; i < b.length; i++) rans->row[i][lane] = b.coefficient[b.scan[i]];
    }
    for (uint32_t i = list[0]->length; i-- > 0;) {
        const byte16 sums = sum_near(rans, i);
        const uint32_t *const table = rans->near_table[rans->diagonal[i]];
        short16 coefficient;
        memcpy(&coefficient, rans->row[i], sizeof coefficient);
        const short16 minus = coefficient < 0, sizes = (coefficient ^ minus) - minus;
        const short16 is_far = sizes >= (int16_t)FAR, is_near = sizes < (int16_t)NEAR_MAX;
        const byte16 capped = __builtin_convertvector((sizes & ~is_far) | ((int16_t)FAR & is_far), byte16),
                     counts =
                         __builtin_convertvector((sizes & is_near) | ((int16_t)NEAR_MAX & ~is_near), byte16),
                     signs = __builtin_convertvector(minus & 4, byte16);
        uint8_t sum[LANES], size[LANES], sign[LANES];
        memcpy(rans->size[i], &counts, sizeof counts);
        memcpy(sum, &sums, sizeof sum);
        memcpy(size, &capped, sizeof size);
        memcpy(sign, &signs, sizeof sign);
        uint32_t lane = 0;
        for (; lane < active; lane++)
            w.symbol[lane] = rans->coefficient_symbol[table[rans->class_of_sum[sum[lane]]]][size[lane]] |
                             (uint32_t)sign[lane] << 8;
        for (active = count_active(list, count, active, i); lane < active; lane++)
            w.symbol[lane] = rans->coefficient_symbol[TABLE_LAST][size[lane]] | (uint32_t)sign[lane] << 8;
        uint8_t far_count = 0;
        if (__builtin_expect(is_any(is_far), 0))
            for (lane = 0; lane < active; lane++)
                if (size[lane] == FAR) w.far[far_count++] = (uint16_t)(abs(rans->row[i][lane]) - (int)FAR);
        w.far += far_count;
        w.symbol += active;
        *w.active++ = (uint8_t)active;
        *w.far_count++ = far_count;
    }
    *writer = w;
}

LW_WIDE_INLINE uint8_t *put_word(uint8_t *end, uint32_t word) {
    end -= 2;
    end[0] = (uint8_t)word;
    end[1] = (uint8_t)(word >> 8);
    return end;
}

LW_WIDE_INLINE uint8_t *put_state(uint8_t *end, uint32_t state) {
    return put_word(put_word(end, state >> 16), state & 0xffff);
}

/* What get_token() undoes; words go before those that are there. symbol: the slot and, above its bits, the
 * raw ones; from bit 16 on the share, from bit 26 on how many raw bits there are. */
LW_WIDE_INLINE uint32_t put_symbol(const struct lw_tile_rans *rans, uint32_t x, uint32_t symbol,
                                   uint8_t **end) {
    const uint32_t share = symbol >> 16 & 1023, raw_bits = symbol >> 26;
    LW_INVARIANT_DEAR(share > 0 && x >= STATE_LOW); /* there is such a token, and a state is a state */
    put_word(*end, x);
    const uint32_t gives = x >= share << (22 - raw_bits);
    *end -= 2 * gives;
    x >>= 16 * gives;
    /* x / share: exact, and within 64 bits, for x < share * 2^22 and share < 1024 */
    const uint32_t whole = (uint32_t)(x * rans->reciprocal[share] >> 42);
    return (whole << (SLOT_BITS + raw_bits)) + (symbol & 0xffff) + (x - whole * share);
}

/* Number of coefficients up to the last that is not 0. */
LW_WIDE_INLINE uint32_t length_of(const struct lw_tile_rans *rans, const int16_t *coefficient,
                                  const uint8_t *scan, uint32_t n) {
    if (n < PLACES - 1) {
        while (n && !coefficient[scan[n - 1]]) n--;
        return n;
    }
    short8 most = {0};
    for (uint32_t y = 0; y < SIDE; y++) {
        short8 row, rank;
        memcpy(&row, coefficient + y * SIDE, sizeof row);
        memcpy(&rank, rans->rank + y * SIDE, sizeof rank);
        rank &= row != 0;
        most = (rank & (rank > most)) | (most & ~(rank > most));
    }
    int16_t length = 0;
    for (uint32_t x = 0; x < SIDE; x++) length = most[x] > length ? most[x] : length;
    return (uint32_t)length;
}

LW_WIDE static uint8_t *put_lists(struct lw_tile_rans *rans, uint32_t planes, const int16_t *coefficient,
                                  uint32_t width, uint32_t height, const uint8_t *rest, size_t rest_size,
                                  uint8_t *end, uint32_t *out_lanes) {
    struct block block[LW_TILE_RANS_BLOCKS];
    struct lists lists;
    uint8_t length[LW_TILE_RANS_BLOCKS];
    uint32_t count = 0, state[LANES], at = 0;
    uint32_t *const first_coefficient = rans->symbol + LW_TILE_RANS_BLOCKS;
    for (uint32_t p = 0; p < planes; p++)
        for (uint32_t by = 0; by < blocks(height); by++)
            for (uint32_t bx = 0; bx < blocks(width); bx++) {
                uint8_t *lengths = length + p * GRID * GRID;
                const uint32_t w = at_most(width - bx * SIDE, SIDE), h = at_most(height - by * SIDE, SIDE);
                const int16_t *coefficients =
                    coefficient + ((p * blocks(height) + by) * blocks(width) + bx) * PLACES;
                const uint8_t *scan = rans->scan[w][h] + 1;
                const uint32_t n = length_of(rans, coefficients, scan, w * h - 1);
                lengths[by * GRID + bx] = (uint8_t)n;
                block[count] = (struct block){(int16_t *)coefficients, scan, n};
                rans->symbol[count++] =
                    rans->length_symbol[rans->length_table[lengths_near(lengths, bx, by)]][n];
            }
    sort_lists(block, count, &lists);
    struct writer w = {first_coefficient, rans->far, rans->active, rans->far_count};
    for (uint32_t i = 0; i < lists.count; i += lists.lanes)
        list_group(rans, lists.list + i, at_most(lists.count - i, lists.lanes), &w);
    LW_INVARIANT(w.symbol <= rans->symbol + sizeof rans->symbol / sizeof *rans->symbol);
    for (uint32_t lane = 0; lane < lists.lanes; lane++, at += 2)
        state[lane] = STATE_LOW | (at < rest_size ? rest[at] : 0u) |
                      (at + 1 < rest_size ? (uint32_t)rest[at + 1] << 8 : 0u);
    while (w.symbol > first_coefficient) {
        const uint32_t active = *--w.active;
        for (uint32_t n = *--w.far_count; n-- > 0;) end = put_word(end, *--w.far);
        for (uint32_t lane = active; lane-- > 0;)
            state[lane] = put_symbol(rans, state[lane], *--w.symbol, &end);
    }
    LW_INVARIANT(w.symbol == first_coefficient && w.far == rans->far); /* each was put once */
    LW_INVARIANT(w.active == rans->active && w.far_count == rans->far_count);
    for (uint32_t lane = lists.lanes; lane-- > 1;) end = put_state(end, state[lane]);
    while (count-- > 0) state[0] = put_symbol(rans, state[0], rans->symbol[count], &end);
    *out_lanes = lists.lanes;
    return put_state(end, state[0]);
}

size_t lw_tile_rans_put(struct lw_tile_rans *rans, uint32_t planes, const int16_t *coefficient,
                        uint32_t width, uint32_t height, const uint8_t *rest, size_t rest_size,
                        uint8_t *dst) {
    uint8_t *const end = rans->bytes + sizeof rans->bytes;
    uint32_t lanes;
    const uint8_t *begin = put_lists(rans, planes, coefficient, width, height, rest, rest_size, end, &lanes);
    LW_INVARIANT(begin >= rans->bytes && end - begin <= (ptrdiff_t)LW_TILE_RANS_BOUND);
    const size_t size = (size_t)(end - begin), free_size = at_most(2 * lanes, (uint32_t)rest_size);
    memcpy(dst, begin, size);
    memcpy(dst + size, rest + free_size, rest_size - free_size);
    return size + rest_size - free_size;
}
