/* pixel_filter.h: filters a texture's pixels to differences from a prediction by their neighbours, and back.
 * The number of bytes stays; zstd then compresses them to two thirds. Format: docs/scene_package.md,
 * "Pixels".
 * Threads: pure functions, [any].
 * After:   the median edge detector of LOCO-I (Weinberger, Seroussi and Sapiro 2000). */
#ifndef LW_COMMON_PIXEL_FILTER_H
#define LW_COMMON_PIXEL_FILTER_H

#include <stddef.h>
#include <stdint.h>

/** rgba, out_bytes: 4 * width * height bytes each; they must not overlap. */
void lw_pixel_filter_apply(const uint8_t *rgba, uint32_t width, uint32_t height, uint8_t *out_bytes);
/** The way back, for any bytes. */
void lw_pixel_filter_undo(const uint8_t *bytes, uint32_t width, uint32_t height, uint8_t *out_rgba);

/** The same of the first `planes` bytes of each pixel, each byte for itself. out_bytes: planes * width *
 * height. */
void lw_pixel_filter_apply_planes(const uint8_t *rgba, uint32_t width, uint32_t height, uint32_t planes,
                                  uint8_t *out_bytes);
/** The way back; the other bytes of pixels stay. */
void lw_pixel_filter_undo_planes(const uint8_t *bytes, uint32_t width, uint32_t height, uint32_t planes,
                                 uint8_t *out_rgba);

#endif
