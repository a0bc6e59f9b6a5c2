/* tile_rans.h: the coefficients of tile_dct.h as bytes: up to sixteen interleaved range coders that share one
 * stream of words. Each coefficient's probability follows from its neighbours of higher frequency, by fixed
 * tables, so that no lane waits for another, nor for its own last coefficient. Format: proto/wire_format.md,
 * codec 4.
 * Threads: [any]; one struct lw_tile_rans per thread.
 * After:   asymmetric numeral systems, Duda 2013; lanes in one stream, Giesen 2014 ("Interleaved entropy
 *          coders"). */
#ifndef LW_COMMON_TILE_RANS_H
#define LW_COMMON_TILE_RANS_H

#include "common/tile/atlas.h"
#include "common/tile/tile_channels.h"

#include <stdbool.h>
#include <stddef.h>

#define LW_TILE_RANS_SIDE   8u
#define LW_TILE_RANS_PLACES (LW_TILE_RANS_SIDE * LW_TILE_RANS_SIDE)
#define LW_TILE_RANS_LANES  16u
#define LW_TILE_RANS_TABLES 24u
#define LW_TILE_RANS_SLOTS  1024u
#define LW_TILE_RANS_TOKENS 24u
#define LW_TILE_RANS_FAR    104u /* sizes from here on are followed by a word */
#define LW_TILE_RANS_BLOCKS (LW_TILE_CHANNEL_PLANES_MAX * LW_TILE_TEXELS_MAX / LW_TILE_RANS_PLACES)

/* The largest coefficient, of either sign. */
#define LW_TILE_RANS_COEFFICIENT_MAX 32767

/* Bytes for coefficients alone: 32 bits each, at most; lengths; states. */
#define LW_TILE_RANS_BOUND                                                                                   \
    (LW_TILE_CHANNEL_PLANES_MAX * LW_TILE_TEXELS_MAX * 4 + LW_TILE_RANS_BLOCKS * 2 + LW_TILE_RANS_LANES * 4)

#define LW_TILE_RANS_NEAR_MAX 30u /* larger sizes of a neighbour count as this */

/** Instruction set of the decoder. All give the same coefficients. */
enum lw_tile_rans_isa { LW_TILE_RANS_SCALAR, LW_TILE_RANS_AVX2, LW_TILE_RANS_AVX512 };

/** Tables and scratch; some 280 KB. */
struct lw_tile_rans {
    /* By columns, rows: places as row * 8 + column, diagonal by diagonal. */
    uint8_t scan[LW_TILE_RANS_SIDE + 1][LW_TILE_RANS_SIDE + 1][LW_TILE_RANS_PLACES];
    uint32_t slot[LW_TILE_RANS_TABLES][LW_TILE_RANS_SLOTS]; /* what the low bits of a state mean */
    /* The encoder's: of coefficients by size, of lengths; slots, share, raw bits and how many. */
    uint32_t coefficient_symbol[LW_TILE_RANS_TABLES][LW_TILE_RANS_FAR + 1];
    uint32_t length_symbol[LW_TILE_RANS_TABLES][LW_TILE_RANS_PLACES];
    uint64_t reciprocal[LW_TILE_RANS_SLOTS];    /* for shares, times 2^42, rounded up */
    int16_t rank[LW_TILE_RANS_PLACES];          /* for places in a whole block's scan, from 0 */
    uint32_t near_table[4][LW_TILE_RANS_LANES]; /* by diagonal, and class of the sum of sizes */
    uint8_t class_of_sum[5 * LW_TILE_RANS_NEAR_MAX + 1],
        diagonal[LW_TILE_RANS_PLACES]; /* per place in the list */
    uint8_t length_table[2 * LW_TILE_RANS_PLACES];
    uint8_t neighbour[LW_TILE_RANS_PLACES][5]; /* places in the list; LW_TILE_RANS_PLACES - 1: none */
    /* Per place in the list and lane: sizes as far as they count next to others, and coefficients. The last
     * row of sizes stays 0. */
    _Alignas(64) uint8_t size[LW_TILE_RANS_PLACES][LW_TILE_RANS_LANES];
    _Alignas(64) int16_t row[LW_TILE_RANS_PLACES][LW_TILE_RANS_LANES];
    uint8_t spread[256][8]; /* per mask of the eight lanes that take a word: each lane's word */
    enum lw_tile_rans_isa isa;
    uint32_t
        symbol[LW_TILE_CHANNEL_PLANES_MAX * LW_TILE_TEXELS_MAX + LW_TILE_RANS_BLOCKS]; /* the encoder's */
    /* the encoder's: words of large coefficients */
    uint16_t far[LW_TILE_CHANNEL_PLANES_MAX * LW_TILE_TEXELS_MAX];
    uint8_t active[LW_TILE_RANS_BLOCKS * LW_TILE_RANS_PLACES],
        far_count[LW_TILE_RANS_BLOCKS * LW_TILE_RANS_PLACES]; /* the encoder's: lanes of each step */
    uint8_t bytes[LW_TILE_RANS_BOUND + 8192];
};

/** isa becomes the best that the processor has. */
void lw_tile_rans_init(struct lw_tile_rans *rans);

/** Writes the coefficients of a tile of width x height texels, and after them other bytes, some of which cost
 * nothing.
 * planes     of them, at most LW_TILE_CHANNEL_PLANES_MAX
 * coefficient  plane by plane, of each the tile's blocks row by row, of each its rows; the first of each
 *              block and what lies outside the tile are not written
 * rest       rest_size bytes, of which zeros at the end may be left out
 * dst        of LW_TILE_RANS_BOUND + rest_size bytes at least
 * Returns how many it wrote. */
size_t lw_tile_rans_put(struct lw_tile_rans *rans, uint32_t planes, const int16_t *coefficient,
                        uint32_t width, uint32_t height, const uint8_t *rest, size_t rest_size, uint8_t *dst);

/** Reads them. Bytes may come from outside. Returns false if no encoder writes such bytes.
 * coefficient  all of it is written, as far as the tile has blocks
 * length     of each block of each plane, LW_TILE_TEXELS_MAX / 64 a plane: how many coefficients beyond the
 *            first were in its list
 * out_rest   the other bytes, in `rans` until the next call; the first *out_rest_free of them are always
 *            there, if as zeros */
bool lw_tile_rans_get(struct lw_tile_rans *rans, uint32_t planes, const uint8_t *src, size_t src_size,
                      uint32_t width, uint32_t height, int16_t *coefficient, uint8_t *length,
                      const uint8_t **out_rest, size_t *out_rest_size, size_t *out_rest_free);

#endif
