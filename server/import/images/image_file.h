/* image_file.h: decodes PNG, JPEG, WebP, AVIF, TGA and BMP to 8-bit RGBA, within bounds that are checked
 * before a texel is decoded. The first four by the formats' own libraries, because Debian mends them:
 * stb_image's JPEG decoder of 2022 writes out of bounds by a Huffman table of more than 256 codes, which
 * fuzzing found within seconds.
 * Threads: [any]. */
#ifndef LW_IMPORT_IMAGES_IMAGE_FILE_H
#define LW_IMPORT_IMAGES_IMAGE_FILE_H

#include "common/scene/scene.h"

#define LW_IMAGE_FILE_FORMATS "PNG, JPEG, WebP, AVIF, TGA or BMP"

#define LW_IMAGE_FILE_SIZE_MAX (256u << 20) /* bytes of an encoded image */

/* Texels of all images of a scene together, by default and at most: 1 GiB decoded, and just less than a scene
 * package may hold. */
#define LW_IMAGE_FILE_TEXELS     (1u << 28)
#define LW_IMAGE_FILE_TEXELS_MAX 1000000000u

/* Albedo that stands for a texture that cannot be read, times the material's own colour: that is mostly near
 * white beside a texture, and a white room would be far too bright. */
#define LW_IMAGE_FILE_STAND_IN_ALBEDO 0.5f

/** Size of an image from its header. Errors: LW_BAD_DATA (no such format, larger than
 * LW_SCENE_TEXTURE_SIDE_MAX). */
LW_MUST_CHECK enum lw_status lw_image_file_size(const uint8_t *bytes, size_t size, uint32_t *out_width,
                                                uint32_t *out_height, struct lw_error *err);

/** Memory that images of one scene may take, and have taken so far. limit 0: LW_IMAGE_FILE_TEXELS. */
struct lw_image_file_budget {
    uint64_t limit, used; /* texels */
};

/** Counts an image by the size in its header, before it is decoded.
 * Errors: LW_BAD_DATA with both numbers and the option; then it counts for nothing. */
LW_MUST_CHECK enum lw_status lw_image_file_count(struct lw_image_file_budget *budget, uint32_t width,
                                                 uint32_t height, struct lw_error *err);

/** Decodes an image of the size that its header has. out_rgba: width*height*4 bytes, row 0 on top.
 * Errors: LW_BAD_DATA; a picture that is cut short or corrupt is one. Then anything may stand there. */
LW_MUST_CHECK enum lw_status lw_image_file_decode(const uint8_t *bytes, size_t size, uint32_t width,
                                                  uint32_t height, uint8_t *out_rgba, struct lw_error *err);

#endif
