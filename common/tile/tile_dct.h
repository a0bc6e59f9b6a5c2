/* tile_dct.h: the lossy tile codec: 8 x 8 cosine transforms of the logarithm of irradiance, quantised by a step that the
 * caller takes from the tile's own noise. Pure functions; format: proto/wire_format.md, codec 2. Used through tile_codec.h.
 * Threads: [any]; one struct lw_tile_dct per thread.
 * After:   orthonormal DCT-II; adaptive Golomb codes (Rice 1979). */
#ifndef LW_COMMON_TILE_DCT_H
#define LW_COMMON_TILE_DCT_H

#include "common/status.h"
#include "common/tile/atlas.h"

#define LW_TILE_DCT_SIDE  8u
#define LW_TILE_DCT_INTRA 1u /* first byte of a payload that builds on no other; others are to come */

/* Steps are 2^(-q/8), in units of log2: from 1 (a factor of two) to 1/256. */
#define LW_TILE_DCT_STEP_Q_MAX 64u

/* Gains are 2^(g/512). */
#define LW_TILE_DCT_GAIN_UNIT 512

/* Every value costs at most 12 + 20 + 1 bits, every block's length 12 + 20. */
#define LW_TILE_DCT_BOUND 56000u

/** Scratch and tables; some 140 KB. */
struct lw_tile_dct {
    _Alignas(64) float plane[3][LW_TILE_TEXELS_MAX]; /* rows of LW_TILE_SIDE */
    /* By number of points: [frequency][place], and the same transposed; 0 where there is none. */
    _Alignas(64) float basis[LW_TILE_DCT_SIDE + 1][LW_TILE_DCT_SIDE][LW_TILE_DCT_SIDE];
    _Alignas(64) float transposed[LW_TILE_DCT_SIDE + 1][LW_TILE_DCT_SIDE][LW_TILE_DCT_SIDE];
    uint8_t scan[LW_TILE_DCT_SIDE + 1][LW_TILE_DCT_SIDE + 1][LW_TILE_DCT_SIDE * LW_TILE_DCT_SIDE]; /* columns,
                                                                                                        rows */
    int32_t level[LW_TILE_TEXELS_MAX]; /* of one plane, block by block */
    _Alignas(64) float mean[LW_TILE_DCT_SIDE * LW_TILE_DCT_SIDE];
    _Alignas(64) float light[3][LW_TILE_TEXELS_MAX], weight[LW_TILE_TEXELS_MAX]; /* the encoder's */
};

/** Fills in the tables. */
void lw_tile_dct_init(struct lw_tile_dct *dct);

/** Encodes width x height texels, at most LW_TILE_SIDE each, into at most LW_TILE_DCT_BOUND bytes.
 * covered         per texel, 0: whoever decodes may find anything there; NULL: every texel counts
 * step            of every coefficient, in log2(1 + E/scale); none is off by more than 0.56 of it, so neither is any plane
 *                 in the root mean square; all three together make R, G and B differ by 0.3 to 0.5 of it, root mean square.
 *                 Taken down to a power of 2^(1/8) within the range above, further where the mean asks for it
 * out_saturated   channels that were not finite or negative (taken for 0), or too large
 * The mean of each channel over the covered texels is kept to 0.1 %. */
size_t lw_tile_dct_encode(struct lw_tile_dct *dct, const float *rgb, const uint8_t *covered, uint32_t width,
                          uint32_t height, float step, uint8_t *dst, float *out_scale,
                          uint32_t *out_saturated);

/** Decodes into width * height * 3 floats, finite and >= 0. False for what no encoder writes: another length, kind or
 * step; rgb is then unspecified. Bytes may come from anyone. scale: 0 < scale <= 2^60. */
bool lw_tile_dct_decode(struct lw_tile_dct *dct, const uint8_t *src, size_t src_size, float scale,
                        uint32_t width, uint32_t height, float *rgb);

#endif
