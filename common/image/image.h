/* image.h: writes views and maps: EXR for numbers (OpenEXR's C core), PNG for eyes (libpng).
 * Threads: [any]. */
#ifndef LW_COMMON_IMAGE_H
#define LW_COMMON_IMAGE_H

#include "common/status.h"

#include <stdint.h>

/* Longest side of an image that we write or read: far above any lightmap or screen, so more is a mistake or damage. */
#define LW_IMAGE_SIDE_MAX 65536u

/** Writes width x height linear RGB floats, row 0 on top, as 32-bit float channels R, G, B (ZIP-compressed
 * scanlines). `units` becomes the string attribute "units", e.g. "W/(m^2 sr)".
 * Errors: LW_CANNOT_CREATE or LW_IO naming the path; LW_NO_MEMORY; LW_USAGE: a side of 0 or beyond the maximum.
 * The file appears whole or not at all. units may be NULL. */
LW_MUST_CHECK enum lw_status lw_image_write_exr(const char *path, const float *rgb, uint32_t width,
                                                uint32_t height, const char *units, struct lw_error *err);

/** Writes width x height 8-bit sRGB pixels, 3 bytes each. Errors as above. */
LW_MUST_CHECK enum lw_status lw_image_write_png(const char *path, const uint8_t *srgb, uint32_t width,
                                                uint32_t height, struct lw_error *err);

/** Reads R, G, B of an EXR as floats (for tests and tools); *out_rgb is malloc'ed.
 * Errors: LW_NO_INPUT, LW_BAD_DATA, LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_image_read_exr(const char *path, float **out_rgb, uint32_t *out_width,
                                               uint32_t *out_height, struct lw_error *err);

#endif
