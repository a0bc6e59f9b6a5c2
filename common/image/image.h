/* image.h: writes views and maps: EXR for numbers (OpenEXR's C core), PNG for eyes (libpng).
 * Threads: [any]. */
#ifndef LW_COMMON_IMAGE_H
#define LW_COMMON_IMAGE_H

#include "common/base/status.h"

#include <stdint.h>

/* Longest side of an image that we write or read: far above any lightmap or screen, so more is a mistake or
 * damage. */
#define LW_IMAGE_SIDE_MAX 65536u

/** Writes width x height linear RGB floats, row 0 on top, as 32-bit float channels R, G, B (ZIP-compressed
 * scanlines). `units` becomes the string attribute "units", e.g. "W/(m^2 sr)".
 * Errors: LW_CANNOT_CREATE or LW_IO naming the path; LW_NO_MEMORY; LW_USAGE: a side of 0 or beyond the
 * maximum. The file appears whole or not at all. units may be NULL. */
LW_MUST_CHECK enum lw_status lw_image_write_exr(const char *path, const float *rgb, uint32_t width,
                                                uint32_t height, const char *units, struct lw_error *err);

/** A string attribute of an EXR's header. */
struct lw_image_attribute {
    const char *name, *text;
};

/** Contents of an EXR. */
struct lw_image_exr {
    const float *pixel; /* width * height * channels, a pixel's channels side by side, linear, row 0 on top */
    uint32_t width, height;
    unsigned channels; /* 3: R, G, B; 4: and A, as it is (nothing is premultiplied) */
    bool half;         /* 16-bit floats in the file: up to 65504, 11 bits of precision */
    const struct lw_image_attribute *attribute;
    size_t attribute_count;
};

/** The same with a choice of channels, of their type and of attributes. */
LW_MUST_CHECK enum lw_status lw_image_write_exr_with(const char *path, const struct lw_image_exr *image,
                                                     struct lw_error *err);

/** Writes width x height 8-bit sRGB pixels, 3 bytes each. Errors as above. */
LW_MUST_CHECK enum lw_status lw_image_write_png(const char *path, const uint8_t *srgb, uint32_t width,
                                                uint32_t height, struct lw_error *err);

/** Encodes 8-bit pixels of 3 (R, G, B) or 4 channels (and A) as a PNG in memory, without colour chunks, as
 * glTF asks. *out_png is malloc'ed. Errors: LW_NO_MEMORY, LW_USAGE, LW_INTERNAL. */
LW_MUST_CHECK enum lw_status lw_image_encode_png(const uint8_t *pixel, uint32_t width, uint32_t height,
                                                 unsigned channels, uint8_t **out_png, size_t *out_size,
                                                 struct lw_error *err);

/** Reads R, G, B of an EXR as floats; *out_rgb is malloc'ed. The picture is the display window: data outside
 * of it is left out, and where it has none it is 0 (alpha too).
 * Errors: LW_NO_INPUT, LW_BAD_DATA, LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_image_read_exr(const char *path, float **out_rgb, uint32_t *out_width,
                                               uint32_t *out_height, struct lw_error *err);
/** R, G, B and A; where the file has no A, it is 1. */
LW_MUST_CHECK enum lw_status lw_image_read_exr_rgba(const char *path, float **out_rgba, uint32_t *out_width,
                                                    uint32_t *out_height, struct lw_error *err);

#endif
