/* image_file.h: decodes PNG, JPEG, WebP, AVIF, TGA and BMP to 8-bit RGBA, within bounds that are checked
 * before a texel is decoded. The first four by the formats' own libraries, because Debian mends them:
 * stb_image's JPEG decoder of 2022 writes out of bounds by a Huffman table of more than 256 codes, which
 * fuzzing found within seconds.
 * Threads: [any]. */
#ifndef LW_IMPORT_IMAGE_FILE_H
#define LW_IMPORT_IMAGE_FILE_H

#include "common/scene/scene.h"

#define LW_IMAGE_FILE_FORMATS "PNG, JPEG, WebP, AVIF, TGA or BMP"

#define LW_IMAGE_FILE_SIZE_MAX   (256u << 20) /* bytes of an encoded image */
#define LW_IMAGE_FILE_TEXELS_MAX (1ull << 30) /* of all images of a scene together: 4 GiB decoded */

/* Albedo that stands for a texture that cannot be read, times the material's own colour: that is mostly near
 * white beside a texture, and a white room would be far too bright. */
#define LW_IMAGE_FILE_STAND_IN_ALBEDO 0.5f

/** Size of an image from its header. Errors: LW_BAD_DATA (no such format, larger than
 * LW_SCENE_TEXTURE_SIDE_MAX). */
LW_MUST_CHECK enum lw_status lw_image_file_size(const uint8_t *bytes, size_t size, uint32_t *out_width,
                                                uint32_t *out_height, struct lw_error *err);

/** Decodes an image whose size was found good. *out_rgba is malloc'ed: width*height*4 bytes, row 0 on top.
 * Errors: LW_BAD_DATA; a picture that is cut short or corrupt is one. */
LW_MUST_CHECK enum lw_status lw_image_file_decode(const uint8_t *bytes, size_t size, uint8_t **out_rgba,
                                                  struct lw_error *err);

#endif
