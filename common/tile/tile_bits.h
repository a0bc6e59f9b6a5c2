/* tile_bits.h: a sequence of bits, the low ones of each byte first, and the codes of whole numbers that
 * tile_dct.h uses.
 * Threads: a sequence belongs to one thread. */
#ifndef LW_COMMON_TILE_BITS_H
#define LW_COMMON_TILE_BITS_H

#include "common/base/invariant.h"

#include <stddef.h>
#include <stdint.h>
#include <string.h>

#define LW_TILE_BITS_ONES_MAX 12u /* this many ones are followed by the number itself, */
#define LW_TILE_BITS_RAW      20u /* in this many bits */

/* Writes eight bytes at a time: up to seven past the end are overwritten. */
struct lw_tile_bits_writer {
    uint8_t *at;
    uint64_t held;
    unsigned count; /* < 8 between calls */
};

static inline uint64_t lw_tile_bits_order(uint64_t bytes) {
#if __BYTE_ORDER__ == __ORDER_BIG_ENDIAN__
    return __builtin_bswap64(bytes);
#else
    return bytes;
#endif
}

/** count <= 56, and bits has no others. */
static inline void lw_tile_bits_put(struct lw_tile_bits_writer *w, uint64_t bits, unsigned count) {
    LW_INVARIANT_DEAR(w->count < 8 && count <= 56 && bits >> count == 0);
    w->held |= bits << w->count;
    w->count += count;
    const uint64_t bytes = lw_tile_bits_order(w->held);
    memcpy(w->at, &bytes, sizeof bytes);
    w->at += w->count >> 3;
    w->held >>= w->count & ~7u;
    w->count &= 7;
}

static inline uint8_t *lw_tile_bits_end(struct lw_tile_bits_writer *w) { return w->at + (w->count > 0); }

/** v < 2^20: v >> k in ones, a zero, k low bits; or 12 ones and 20 bits. Then the lowest bit of `more`, if it
 * has one: more_count is 0 or 1. */
static inline void lw_tile_bits_put_rice(struct lw_tile_bits_writer *w, uint32_t v, unsigned k, uint64_t more,
                                         unsigned more_count) {
    LW_INVARIANT_DEAR(v >> LW_TILE_BITS_RAW == 0 && more >> more_count == 0 && more_count <= 1);
    uint32_t ones = v >> k;
    uint64_t low = v & ((1u << k) - 1);
    unsigned zero = 1;
    if (ones >= LW_TILE_BITS_ONES_MAX) {
        ones = LW_TILE_BITS_ONES_MAX;
        zero = 0;
        low = v;
        k = LW_TILE_BITS_RAW;
    }
    const unsigned head = ones + zero;
    lw_tile_bits_put(w, ((1u << ones) - 1) | low << head | more << (head + k), head + k + more_count);
}

/* Past the end it reads zeros and counts on, which lw_tile_bits_is_at_end() reports. */
struct lw_tile_bits_reader {
    const uint8_t *at, *end;
    uint64_t held;  /* bits above `count` are zero, or a part of the next bytes */
    unsigned count; /* in held */
    size_t missing; /* bytes read past the end */
};

/* At least 56 bits are held afterwards. */
static inline void lw_tile_bits_refill(struct lw_tile_bits_reader *r) {
    if (r->end - r->at >= 8) {
        uint64_t next;
        memcpy(&next, r->at, sizeof next);
        r->held |= lw_tile_bits_order(next) << r->count;
        r->at += (63 - r->count) >> 3;
        r->count |= 56;
        return;
    }
    for (; r->count < 56; r->count += 8) {
        if (r->at < r->end)
            r->held |= (uint64_t)*r->at++ << r->count;
        else
            r->missing++;
    }
}

static inline void lw_tile_bits_drop(struct lw_tile_bits_reader *r, unsigned count) {
    r->held >>= count;
    r->count -= count;
}

/** After a refill; k <= 20. Takes at most 32 bits. */
static inline uint32_t lw_tile_bits_get_rice(struct lw_tile_bits_reader *r, unsigned k) {
    const unsigned ones = (unsigned)__builtin_ctzll(~r->held | 1u << LW_TILE_BITS_ONES_MAX);
    uint32_t v;
    if (ones < LW_TILE_BITS_ONES_MAX) {
        v = ones << k | ((uint32_t)(r->held >> (ones + 1)) & ((1u << k) - 1));
        lw_tile_bits_drop(r, ones + 1 + k);
    } else {
        v = (uint32_t)(r->held >> LW_TILE_BITS_ONES_MAX) & ((1u << LW_TILE_BITS_RAW) - 1);
        lw_tile_bits_drop(r, LW_TILE_BITS_ONES_MAX + LW_TILE_BITS_RAW);
    }
    return v;
}

/** Whether everything was read, except for at most `most` bits, which are all 0. */
static inline int lw_tile_bits_is_at_end(const struct lw_tile_bits_reader *r, size_t most) {
    if (r->count < r->missing * 8) return 0;
    const size_t held = r->count - r->missing * 8;
    if ((size_t)(r->end - r->at) * 8 + held > most || (r->held & (((uint64_t)1 << held) - 1)) != 0) return 0;
    for (const uint8_t *at = r->at; at < r->end; at++)
        if (*at) return 0;
    return 1;
}

#endif
