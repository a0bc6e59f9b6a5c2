/* tile_dct.h: the lossy tile codec: 8 x 8 cosine transforms of the logarithm of irradiance, quantised by a
 * step that the caller takes from the tile's own noise. Pure functions; format: proto/wire_format.md, codec
 * 4. Used through tile_codec.h.
 * Threads: [any]; one struct lw_tile_dct per thread.
 * After:   orthonormal DCT-II; tile_rans.h for coefficients, adaptive Golomb codes (Rice 1979) for means. */
#ifndef LW_COMMON_TILE_DCT_H
#define LW_COMMON_TILE_DCT_H

#include "common/base/status.h"
#include "common/tile/tile_rans.h"

#define LW_TILE_DCT_SIDE 8u
/* First byte of a payload, and the Rice parameter of its means' runs of zeros: a delta has longer ones. */
#define LW_TILE_DCT_INTRA 1u /* builds on no other */
#define LW_TILE_DCT_DELTA 2u /* adds to the coefficients of the tile as it was */

/* Steps are 2^(1 - q/8), in units of log2: from 2 (a factor of four) to 1/256. */
#define LW_TILE_DCT_STEP_Q_MAX 72u

/* Gains are 2^(g/512). */
#define LW_TILE_DCT_GAIN_UNIT 512

/* Coefficients of a plane: block by block, of each its rows. The first of each block is one of the means', in
 * rows of blocks. */
#define LW_TILE_DCT_PLANE_COEFFICIENTS LW_TILE_TEXELS_MAX
#define LW_TILE_DCT_COEFFICIENTS       (LW_TILE_CHANNEL_PLANES_MAX * LW_TILE_DCT_PLANE_COEFFICIENTS)

/* LW_TILE_RANS_BOUND, and for each mean 12 + 20 + 1 bits. */
#define LW_TILE_DCT_BOUND 56000u

/** Scratch and tables; some 480 KB. */
struct lw_tile_dct {
    _Alignas(64) float plane[LW_TILE_CHANNEL_PLANES_MAX][LW_TILE_TEXELS_MAX]; /* rows of LW_TILE_SIDE */
    /* By number of points: [frequency][place], and the same transposed; 0 beyond that number. */
    _Alignas(64) float basis[LW_TILE_DCT_SIDE + 1][LW_TILE_DCT_SIDE][LW_TILE_DCT_SIDE];
    _Alignas(64) float transposed[LW_TILE_DCT_SIDE + 1][LW_TILE_DCT_SIDE][LW_TILE_DCT_SIDE];
    /* The encoder's, and the decoder's of a tile whose coefficients are not kept: as
     * lw_tile_dct_coefficients. */
    _Alignas(64) int16_t coefficient[LW_TILE_DCT_COEFFICIENTS];
    _Alignas(64) int16_t change[LW_TILE_DCT_COEFFICIENTS]; /* the encoder's */
    struct lw_tile_rans rans;
    _Alignas(64) float mean[LW_TILE_DCT_SIDE * LW_TILE_DCT_SIDE];
    /* The encoder's: values plane by plane, and 1 where something is covered. */
    _Alignas(64) float light[LW_TILE_CHANNEL_PLANES_MAX][LW_TILE_TEXELS_MAX], weight[LW_TILE_TEXELS_MAX];
};

/** Fills in the tables. */
void lw_tile_dct_init(struct lw_tile_dct *dct);

/** The coefficients of a tile, kept so that a later payload can say by how much they differ: planes in
 * the order of lw_tile_dct.coefficient, each as many blocks as the tile has. Coefficients beyond 16
 * bits are kept as the nearest; nothing may build on such a tile. */
struct lw_tile_dct_coefficients {
    _Alignas(64) int16_t coefficient[LW_TILE_DCT_COEFFICIENTS];
};

/** State of an encoder for a tile, from one payload to the next. Zeroed before the first. */
struct lw_tile_dct_history {
    float scale; /* 0: there is nothing to build on */
    uint32_t q;  /* the step's */
    struct lw_tile_dct_coefficients coefficients;
};

/** Bytes of either struct that a tile of this size uses: 24 KB for 64 x 64 texels of light. No others are
 * touched, so that it may be allocated with this size (aligned_alloc(), a multiple of 64). channel: see
 * below. */
size_t lw_tile_dct_coefficients_size(const struct lw_tile_channel *channel, uint32_t width, uint32_t height);
size_t lw_tile_dct_history_size(const struct lw_tile_channel *channel, uint32_t width, uint32_t height);

/** Light under this share of `dark` is black at any exposure. */
#define LW_TILE_DCT_BLACK 0x1p-15f

/** Texels to be encoded, and options.
 * rgb        width * height, at most LW_TILE_SIDE each, of a float per plane
 * covered    per texel, 0: the decoded value may be anything; NULL: every texel counts
 * step       of every coefficient, in log2(1 + E/scale). None is off by more than 0.56 of it
 *            (LW_TILE_DCT_HOLD if it builds on a history), so neither is any plane in the root mean square.
 *            All three together make R, G and B differ by 0.3 to 0.5 of it, root mean square. Taken down to
 *            a power of 2^(1/8) within the range above, further where the mean asks for it; with a history,
 *            up or down to its step where that is near
 * dark       W/m^2: light this dark looks black beside the scene's white. A brighter tile has no smaller
 *            scale, unless a quarter of it is dark: darker light is coded by its difference, not by its
 *            ratio. A darker tile has its mean as scale, or LW_TILE_DCT_BLACK of `dark`; 0: the tile's own
 *            light alone sets the scale
 * channel    of which planes, coding and sign are read; NULL: three planes of light. Plain values are coded
 *            by their difference: a step is of a power of two over the largest one; `dark` means nothing */
struct lw_tile_dct_source {
    const float *rgb;
    const uint8_t *covered;
    uint32_t width, height;
    float step, dark;
    const struct lw_tile_channel *channel;
};

/* With a history a coefficient keeps its value while that is within this many steps of the new one. */
#define LW_TILE_DCT_HOLD 0.8f

struct lw_tile_dct_coded {
    size_t size, delta_size; /* delta_size 0: there is none */
    float scale;             /* both codings' */
    uint32_t saturated; /* values that were not finite, negative without a sign (taken for 0), or too large */
};

/** Encodes a tile that builds on nothing into at most LW_TILE_DCT_BOUND bytes.
 * history    NULL: none is kept. Otherwise it becomes that of this payload; where it holds one that serves,
 *            the same tile is also encoded as what changed since, into delta_dst of the same size: decoded,
 *            both are the same bit by bit
 * The mean of each channel over the covered texels is kept to 0.1 %, or to 1/4096 of the scale. */
void lw_tile_dct_encode(struct lw_tile_dct *dct, const struct lw_tile_dct_source *source,
                        struct lw_tile_dct_history *history, uint8_t *dst, uint8_t *delta_dst,
                        struct lw_tile_dct_coded *out_coded);

/** Decodes into width * height texels of a float per plane, finite; >= 0 unless the channel is signed.
 * False for what no encoder writes: another length, kind or step; rgb and coefficients are then
 * unspecified. Bytes may come from anyone. scale: 0 < scale <= 2^60.
 * channel    as above
 * kind       what the payload must be: LW_TILE_DCT_INTRA or LW_TILE_DCT_DELTA
 * coefficients  for a delta: of the version before; they become those of this one. NULL, with INTRA only:
 *            they are not kept */
bool lw_tile_dct_decode(struct lw_tile_dct *dct, const struct lw_tile_channel *channel, uint32_t kind,
                        const uint8_t *src, size_t src_size, float scale, uint32_t width, uint32_t height,
                        struct lw_tile_dct_coefficients *coefficients, float *rgb);

/** Encodes how a payload differs from an earlier one of the same tile, both of kind INTRA: a delta over any
 * number of versions, for a decoder that has the coefficients of `from`. It decodes to the same bits as
 * `to`. Bytes may come from anyone.
 * dst        LW_TILE_DCT_BOUND bytes
 * Returns the size; 0: one of them is damaged, or has coefficients that may be beyond 16 bits, on which
 * nothing builds. */
size_t lw_tile_dct_encode_between(struct lw_tile_dct *dct, const struct lw_tile_channel *channel,
                                  const uint8_t *from, size_t from_size, const uint8_t *to, size_t to_size,
                                  uint32_t width, uint32_t height, struct lw_tile_dct_coefficients scratch[2],
                                  uint8_t *dst);

/** Encodes a payload of kind INTRA that decodes to the same bits as a delta for a decoder that has the
 * coefficients of `from`, which is of kind INTRA: what a newcomer gets in place of both. Bytes may come from
 * anyone.
 * scratch    one
 * dst        LW_TILE_DCT_BOUND bytes
 * Returns the size; 0: one of them is damaged, or a sum is beyond 16 bits. */
size_t lw_tile_dct_encode_sum(struct lw_tile_dct *dct, const struct lw_tile_channel *channel,
                              const uint8_t *from, size_t from_size, const uint8_t *delta, size_t delta_size,
                              uint32_t width, uint32_t height, struct lw_tile_dct_coefficients *scratch,
                              uint8_t *dst);

#endif
