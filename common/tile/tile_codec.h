/* tile_codec.h: a tile's irradiance as bytes. Pure functions; format: proto/wire_format.md, "Tile payload".
 * Threads: [any]; one lw_tile_codec per thread (it holds zstd's contexts). */
#ifndef LW_COMMON_TILE_CODEC_H
#define LW_COMMON_TILE_CODEC_H

#include "common/status.h"
#include "common/tile/atlas.h"

#define LW_TILE_CODEC_HALF_ZSTD 1u /* half floats over a power-of-two scale, byte planes, zstd */

struct lw_tile_codec;

LW_MUST_CHECK enum lw_status lw_tile_codec_create(struct lw_tile_codec **out_codec);
void lw_tile_codec_destroy(struct lw_tile_codec *codec);

/** Largest payload of any tile, bytes. */
size_t lw_tile_codec_bound(void);

/** Encodes width x height texels of 3 floats (RGB interleaved, row by row, W/m^2, >= 0).
 * out_scale       the power of two that values were divided by
 * out_saturated   channels that were not finite or negative (stored as 0) or, never by choice of scale, too large
 * Errors: LW_NO_MEMORY, LW_INTERNAL if dst_capacity is under the bound. */
LW_MUST_CHECK enum lw_status lw_tile_codec_encode(struct lw_tile_codec *codec, const float *rgb,
                                                  uint32_t width, uint32_t height, uint8_t *dst,
                                                  size_t dst_capacity, size_t *out_size, float *out_scale,
                                                  uint32_t *out_saturated);

/** Decodes into width*height*3 floats. Bytes may come from anyone: a payload that is truncated, oversized or of the
 * wrong tile gives LW_BAD_DATA and leaves `rgb` unspecified but within bounds; a scale that is not a positive finite
 * number gives LW_BAD_DATA. What decodes is always finite and >= 0. */
LW_MUST_CHECK enum lw_status lw_tile_codec_decode(struct lw_tile_codec *codec, const uint8_t *src,
                                                  size_t src_size, float scale, uint32_t width,
                                                  uint32_t height, float *rgb);

#endif
