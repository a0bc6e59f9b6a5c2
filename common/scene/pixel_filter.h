/* pixel_filter.h: a texture's pixels as differences from what their neighbours let one expect, and back: the
 * same number of bytes, of which zstd makes two thirds. Format: docs/scene_package.md, "Pixels".
 * Threads: pure functions, [any].
 * After:   the median edge detector of LOCO-I (Weinberger, Seroussi and Sapiro 2000). */
#ifndef LW_COMMON_PIXEL_FILTER_H
#define LW_COMMON_PIXEL_FILTER_H

#include <stddef.h>
#include <stdint.h>

/** rgba, out_bytes: 4 * width * height bytes each, apart from one another. */
void lw_pixel_filter_apply(const uint8_t *rgba, uint32_t width, uint32_t height, uint8_t *out_bytes);
/** The way back, for any bytes. */
void lw_pixel_filter_undo(const uint8_t *bytes, uint32_t width, uint32_t height, uint8_t *out_rgba);

#endif
