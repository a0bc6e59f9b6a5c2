/* image_tga.h: decodes Truevision TGA: true colour, grey and palettes, plain or run-length coded. Written for
 * outside bytes: a picture that is cut short is refused before memory is taken for it.
 * Threads: [any]. After: Truevision TGA File Format Specification 2.0. */
#ifndef LW_IMPORT_IMAGES_IMAGE_TGA_H
#define LW_IMPORT_IMAGES_IMAGE_TGA_H

#include "common/base/status.h"

#include <stdint.h>

/** Whether the header is one that is read. The format has no mark at its start: ask for the others first. */
bool lw_image_tga_is(const uint8_t *bytes, size_t size);

/** Errors: LW_BAD_DATA if the file is too short for its texels. */
LW_MUST_CHECK enum lw_status lw_image_tga_size(const uint8_t *bytes, size_t size, uint32_t *out_width,
                                               uint32_t *out_height, struct lw_error *err);

/** Writes width*height*4 bytes, row 0 on top. An alpha that is 0 everywhere means nothing: opaque.
 * Errors: LW_BAD_DATA: cut short, a colour past the palette; LW_NO_MEMORY never. */
LW_MUST_CHECK enum lw_status lw_image_tga_decode(const uint8_t *bytes, size_t size, uint8_t *out_rgba,
                                                 struct lw_error *err);

#endif
