/* tile_codec.h: a tile's channel as bytes. Pure functions; format: proto/wire_format.md, "Tile payload".
 * Threads: [any]; one lw_tile_codec per thread (it holds zstd's contexts and scratch). */
#ifndef LW_COMMON_TILE_CODEC_H
#define LW_COMMON_TILE_CODEC_H

#include "common/base/status.h"
#include "common/tile/atlas.h"
#include "common/tile/tile_dct.h"

#define LW_TILE_CODEC_NONE      0u /* no texels: a tile of a finer level that the server has no more */
#define LW_TILE_CODEC_HALF_ZSTD 1u /* half floats over a power-of-two scale, byte planes, zstd */
#define LW_TILE_CODEC_DCT       4u /* quantised cosine transforms of logarithms (tile_dct.h) */

struct lw_tile_codec;

LW_MUST_CHECK enum lw_status lw_tile_codec_create(struct lw_tile_codec **out_codec);
void lw_tile_codec_destroy(struct lw_tile_codec *codec);

/** Largest payload of any tile in any codec, bytes. */
size_t lw_tile_codec_bound(void);

/* channel: of which planes, coding and sign are read (tile_channels.h). NULL: three planes of light. */

/** Encodes width x height texels of a float per plane (interleaved, row by row), as near as halves are.
 * out_scale       the power of two that values were divided by
 * out_saturated   values that were not finite, or negative without a sign (stored as 0), or, never by choice
 *                 of scale, too large
 * Errors: LW_NO_MEMORY, LW_INTERNAL if dst_capacity is under the bound. */
LW_MUST_CHECK enum lw_status lw_tile_codec_encode_half(struct lw_tile_codec *codec,
                                                       const struct lw_tile_channel *channel,
                                                       const float *rgb, uint32_t width, uint32_t height,
                                                       uint8_t *dst, size_t dst_capacity, size_t *out_size,
                                                       float *out_scale, uint32_t *out_saturated);

/** Encodes texels with the source's step; see lw_tile_dct_encode(). delta_dst: of the same capacity; needed
 * with a history only.
 * Errors: LW_INTERNAL if dst_capacity is under the bound. */
LW_MUST_CHECK enum lw_status lw_tile_codec_encode_dct(struct lw_tile_codec *codec,
                                                      const struct lw_tile_dct_source *source,
                                                      struct lw_tile_dct_history *history, uint8_t *dst,
                                                      uint8_t *delta_dst, size_t dst_capacity,
                                                      struct lw_tile_dct_coded *out_coded);

/** Encodes how a payload of codec 4 differs from an earlier one of the same tile, neither of them a delta,
 * for a decoder that has the coefficients of `from`. It decodes to the same bits as `to`. Bytes may come
 * from anyone: LW_BAD_DATA for damaged ones, and for coefficients that no delta may build on. */
LW_MUST_CHECK enum lw_status lw_tile_codec_encode_between(struct lw_tile_codec *codec,
                                                          const struct lw_tile_channel *channel,
                                                          const uint8_t *from, size_t from_size,
                                                          const uint8_t *to, size_t to_size, uint32_t width,
                                                          uint32_t height, uint8_t *dst, size_t dst_capacity,
                                                          size_t *out_size);

/** Encodes a payload of codec 4 that stands for itself, from one such of an earlier version and a delta that
 * builds on that version. It decodes to the same bits as the delta, with the delta's scale. Bytes may come
 * from anyone: LW_BAD_DATA for damaged ones. */
LW_MUST_CHECK enum lw_status lw_tile_codec_encode_sum(struct lw_tile_codec *codec,
                                                      const struct lw_tile_channel *channel,
                                                      const uint8_t *from, size_t from_size,
                                                      const uint8_t *delta, size_t delta_size, uint32_t width,
                                                      uint32_t height, uint8_t *dst, size_t dst_capacity,
                                                      size_t *out_size);

/** Whether lw_tile_codec_decode() reads a codec of this number. */
bool lw_tile_codec_is_known(uint32_t number);

/** Decodes a payload of the codec of that number into width*height texels of a float per plane. Bytes may
 * come from anyone: a payload that is truncated, oversized, of the wrong tile or of an unknown codec gives
 * LW_BAD_DATA and leaves `rgb` unspecified but within bounds; so does a scale that is not a positive finite
 * number. Decoded values are always finite, and >= 0 unless the channel is signed.
 * coefficients  NULL, or what a delta of the tile's next version will need; codec 1 leaves them alone */
LW_MUST_CHECK enum lw_status lw_tile_codec_decode(struct lw_tile_codec *codec,
                                                  const struct lw_tile_channel *channel, uint32_t number,
                                                  const uint8_t *src, size_t src_size, float scale,
                                                  uint32_t width, uint32_t height,
                                                  struct lw_tile_dct_coefficients *coefficients, float *rgb);

/** The same for a delta of codec 4. coefficients: of the version that it builds on; they become those of this
 * version. */
LW_MUST_CHECK enum lw_status
lw_tile_codec_decode_delta(struct lw_tile_codec *codec, const struct lw_tile_channel *channel,
                           uint32_t number, const uint8_t *src, size_t src_size, float scale, uint32_t width,
                           uint32_t height, struct lw_tile_dct_coefficients *coefficients, float *rgb);

#endif
