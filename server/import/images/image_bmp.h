/* image_bmp.h: decodes Windows and OS/2 bitmaps without compression: palettes of 1, 4 and 8 bits, 16, 24 and
 * 32 bits, bit fields. Run-length coded ones are refused by name. Written for outside bytes: a picture that
 * is cut short is refused before memory is taken for it.
 * Threads: [any]. After: Microsoft, Bitmap Storage; BITMAPV5HEADER. */
#ifndef LW_IMPORT_IMAGES_IMAGE_BMP_H
#define LW_IMPORT_IMAGES_IMAGE_BMP_H

#include "common/base/status.h"

#include <stdint.h>

bool lw_image_bmp_is(const uint8_t *bytes, size_t size);

/** Errors: LW_BAD_DATA: a header that is wrong or not read, or too few bytes for its texels. */
LW_MUST_CHECK enum lw_status lw_image_bmp_size(const uint8_t *bytes, size_t size, uint32_t *out_width,
                                               uint32_t *out_height, struct lw_error *err);

/** Writes width*height*4 bytes, row 0 on top. Opaque but where the header names bits for alpha and some texel
 * has one.
 * Errors: as above, and a colour past the palette. */
LW_MUST_CHECK enum lw_status lw_image_bmp_decode(const uint8_t *bytes, size_t size, uint8_t *out_rgba,
                                                 struct lw_error *err);

#endif
