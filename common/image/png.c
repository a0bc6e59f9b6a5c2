#include "common/image/image.h"

#include "common/base/atomic_file.h"

#include <png.h>
#include <stdlib.h>
#include <string.h>

struct encoder {
    struct lw_atomic_file *file; /* NULL: into memory */
    uint8_t *bytes;
    size_t size, capacity;
    const char *path;
    struct lw_error *err;
    enum lw_status status; /* the first failure */
};

/* libpng's errors leave by longjmp, so no function between here and setjmp may hold what needs releasing */
static void on_error(png_structp png, png_const_charp message) {
    struct encoder *encoder = png_get_error_ptr(png);
    if (encoder->status == LW_OK)
        encoder->status =
            lw_status_fail(encoder->err, LW_INTERNAL, "%s: cannot encode: %s", encoder->path, message);
    png_longjmp(png, 1);
}

static void on_warning(png_structp png, png_const_charp message) {
    (void)png;
    (void)message; /* warnings concern chunks that we do not write */
}

static enum lw_status append(struct encoder *encoder, const uint8_t *bytes, size_t size) {
    if (size > encoder->capacity - encoder->size) {
        size_t capacity =
            encoder->capacity * 2 > encoder->size + size ? encoder->capacity * 2 : encoder->size + size;
        uint8_t *moved = realloc(encoder->bytes, capacity);
        if (!moved) return lw_status_fail(encoder->err, LW_NO_MEMORY, "%s: out of memory", encoder->path);
        encoder->bytes = moved;
        encoder->capacity = capacity;
    }
    memcpy(encoder->bytes + encoder->size, bytes, size);
    encoder->size += size;
    return LW_OK;
}

static void on_write(png_structp png, png_bytep bytes, size_t size) {
    struct encoder *encoder = png_get_io_ptr(png);
    encoder->status = encoder->file ? lw_atomic_file_write(encoder->file, bytes, size, encoder->err)
                                    : append(encoder, bytes, size);
    if (encoder->status) png_error(png, "write");
}

static void on_flush(png_structp png) { (void)png; }

/* All locals are parameters: none changes between setjmp and longjmp, so none can be lost. */
static enum lw_status encode(struct encoder *encoder, png_structp png, png_infop info, const uint8_t *pixel,
                             uint32_t width, uint32_t height, unsigned channels) {
    if (setjmp(png_jmpbuf(png))) return encoder->status;
    png_set_write_fn(png, encoder, on_write, on_flush);
    png_set_IHDR(png, info, width, height, 8, channels == 4 ? PNG_COLOR_TYPE_RGB_ALPHA : PNG_COLOR_TYPE_RGB,
                 PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
    if (encoder->file) png_set_sRGB_gAMA_and_cHRM(png, info, PNG_sRGB_INTENT_PERCEPTUAL);
    png_write_info(png, info);
    for (uint32_t y = 0; y < height; y++) png_write_row(png, pixel + (size_t)y * width * channels);
    png_write_end(png, info);
    return LW_OK;
}

static enum lw_status run_encoder(struct encoder *encoder, const uint8_t *pixel, uint32_t width,
                                  uint32_t height, unsigned channels) {
    png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, encoder, on_error, on_warning);
    png_infop info = png ? png_create_info_struct(png) : NULL;
    enum lw_status status =
        info ? encode(encoder, png, info, pixel, width, height, channels)
             : lw_status_fail(encoder->err, LW_NO_MEMORY, "%s: out of memory", encoder->path);
    png_destroy_write_struct(&png, &info);
    return status;
}

static enum lw_status check_size(const char *path, uint32_t width, uint32_t height, struct lw_error *err) {
    if (width && height && width <= LW_IMAGE_SIDE_MAX && height <= LW_IMAGE_SIDE_MAX) return LW_OK;
    return lw_status_fail(err, LW_USAGE, "%s: an image of %u x %u pixels; each side is from 1 to %u", path,
                          width, height, LW_IMAGE_SIDE_MAX);
}

enum lw_status lw_image_write_png(const char *path, const uint8_t *srgb, uint32_t width, uint32_t height,
                                  struct lw_error *err) {
    struct lw_atomic_file file;
    enum lw_status status = check_size(path, width, height, err);
    if (status == LW_OK) status = lw_atomic_file_open(&file, path, err);
    if (status) return status;
    struct encoder encoder = {.file = &file, .path = path, .err = err};
    status = run_encoder(&encoder, srgb, width, height, 3);
    if (status) {
        lw_atomic_file_abandon(&file);
        return status;
    }
    return lw_atomic_file_commit(&file, err);
}

enum lw_status lw_image_encode_png(const uint8_t *pixel, uint32_t width, uint32_t height, unsigned channels,
                                   uint8_t **out_png, size_t *out_size, struct lw_error *err) {
    struct encoder encoder = {.path = "PNG", .err = err};
    enum lw_status status = check_size(encoder.path, width, height, err);
    if (status == LW_OK) status = run_encoder(&encoder, pixel, width, height, channels);
    if (status) {
        free(encoder.bytes);
        return status;
    }
    *out_png = encoder.bytes;
    *out_size = encoder.size;
    return LW_OK;
}
