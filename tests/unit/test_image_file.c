/* Pictures made here by the libraries' own encoders, and what a damaged one gets. */
#include "tests/support/support.h"

#include "server/import/image_file.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <avif/avif.h>
#include <jpeglib.h>
#include <png.h>
#include <webp/encode.h>

struct bytes {
    uint8_t data[1 << 16];
    size_t size;
};

static void append(png_structp png, png_bytep data, size_t size) {
    struct bytes *out = png_get_io_ptr(png);
    assert_true(out->size + size <= sizeof out->data);
    memcpy(out->data + out->size, data, size);
    out->size += size;
}

static void flush(png_structp png) { (void)png; }

/* rows: `row_size` bytes each. A palette of two colours, the second half transparent, if type asks for
 * one. */
static void write_png(struct bytes *out, uint32_t width, uint32_t height, int depth, int type, int interlace,
                      const uint8_t *rows, size_t row_size) {
    static const png_color palette[2] = {{10, 20, 30}, {200, 100, 50}};
    static const uint8_t transparency[2] = {255, 128};
    out->size = 0;
    png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, NULL, NULL, NULL);
    png_infop info = png_create_info_struct(png);
    png_set_write_fn(png, out, append, flush);
    png_set_IHDR(png, info, width, height, depth, type, interlace, PNG_COMPRESSION_TYPE_DEFAULT,
                 PNG_FILTER_TYPE_DEFAULT);
    png_set_gAMA(png, info, 1.0); /* glTF says that this is ignored */
    if (type == PNG_COLOR_TYPE_PALETTE) {
        png_set_PLTE(png, info, palette, 2);
        png_set_tRNS(png, info, transparency, 2, NULL);
    }
    png_write_info(png, info);
    int passes = png_set_interlace_handling(png);
    for (int pass = 0; pass < passes; pass++)
        for (uint32_t y = 0; y < height; y++) png_write_row(png, rows + y * row_size);
    png_write_end(png, info);
    png_destroy_write_struct(&png, &info);
}

/* One colour everywhere. */
static void write_jpeg(struct bytes *out, uint32_t side, bool progressive, int components,
                       const uint8_t colour[3]) {
    struct jpeg_compress_struct jpeg;
    struct jpeg_error_mgr errors;
    uint8_t *row = malloc(side * 3ul), *encoded = NULL;
    unsigned long size = 0;
    for (uint32_t i = 0; i < side * (uint32_t)components; i++) row[i] = colour[i % (uint32_t)components];
    jpeg.err = jpeg_std_error(&errors);
    jpeg_create_compress(&jpeg);
    jpeg_mem_dest(&jpeg, &encoded, &size);
    jpeg.image_width = jpeg.image_height = side;
    jpeg.input_components = components;
    jpeg.in_color_space = components == 3 ? JCS_RGB : JCS_GRAYSCALE;
    jpeg_set_defaults(&jpeg);
    jpeg_set_quality(&jpeg, 100, TRUE);
    if (progressive) jpeg_simple_progression(&jpeg);
    jpeg_start_compress(&jpeg, TRUE);
    for (uint32_t y = 0; y < side; y++) jpeg_write_scanlines(&jpeg, &row, 1);
    jpeg_finish_compress(&jpeg);
    jpeg_destroy_compress(&jpeg);
    assert_true(size <= sizeof out->data);
    memcpy(out->data, encoded, size);
    out->size = size;
    free(encoded);
    free(row);
}

static uint8_t *decode(const struct bytes *in, uint32_t width, uint32_t height) {
    struct lw_error err = {0};
    uint32_t got_width = 0, got_height = 0;
    uint8_t *rgba = NULL;
    lw_support_ok(lw_image_file_size(in->data, in->size, &got_width, &got_height, &err), &err);
    assert_int_equal(got_width, width);
    assert_int_equal(got_height, height);
    lw_support_ok(lw_image_file_decode(in->data, in->size, &rgba, &err), &err);
    return rgba;
}

static void refuse(const uint8_t *data, size_t size, const char *text) {
    struct lw_error err = {0};
    uint8_t *rgba = NULL, *exact = malloc(size ? size : 1);
    memcpy(exact, data, size);
    lw_support_fails(lw_image_file_decode(exact, size, &rgba, &err), LW_BAD_DATA, &err, text);
    assert_null(rgba);
    free(exact);
}

static void every_kind_of_png_becomes_rgba(void **state) {
    (void)state;
    struct bytes png;
    const uint8_t grey[4] = {0, 100, 200, 255};
    write_png(&png, 2, 2, 8, PNG_COLOR_TYPE_GRAY, PNG_INTERLACE_NONE, grey, 2);
    uint8_t *rgba = decode(&png, 2, 2);
    const uint8_t grey_rgba[16] = {0, 0, 0, 255, 100, 100, 100, 255, 200, 200, 200, 255, 255, 255, 255, 255};
    assert_memory_equal(rgba, grey_rgba, 16);
    free(rgba);

    const uint8_t grey_alpha[4] = {7, 8, 9, 10};
    write_png(&png, 2, 1, 8, PNG_COLOR_TYPE_GRAY_ALPHA, PNG_INTERLACE_NONE, grey_alpha, 4);
    rgba = decode(&png, 2, 1);
    const uint8_t grey_alpha_rgba[8] = {7, 7, 7, 8, 9, 9, 9, 10};
    assert_memory_equal(rgba, grey_alpha_rgba, 8);
    free(rgba);

    const uint8_t wide[12] = {0xff, 0xff, 0, 0, 0x80, 0x80, 0, 0, 0x40, 0x40, 0xff, 0xff};
    write_png(&png, 2, 1, 16, PNG_COLOR_TYPE_RGB, PNG_INTERLACE_NONE, wide, 12);
    rgba = decode(&png, 2, 1);
    const uint8_t wide_rgba[8] = {255, 0, 128, 255, 0, 64, 255, 255};
    assert_memory_equal(rgba, wide_rgba, 8);
    free(rgba);

    const uint8_t bits[1] = {0x40}; /* 0, 1 */
    write_png(&png, 2, 1, 1, PNG_COLOR_TYPE_PALETTE, PNG_INTERLACE_NONE, bits, 1);
    rgba = decode(&png, 2, 1);
    const uint8_t palette_rgba[8] = {10, 20, 30, 255, 200, 100, 50, 128};
    assert_memory_equal(rgba, palette_rgba, 8);
    free(rgba);
}

static void interlaced_png_is_whole(void **state) {
    (void)state;
    struct bytes png;
    uint8_t rows[9][9 * 4];
    for (int i = 0; i < 9 * 9 * 4; i++) rows[i / 36][i % 36] = (uint8_t)(i * 5);
    write_png(&png, 9, 9, 8, PNG_COLOR_TYPE_RGBA, PNG_INTERLACE_ADAM7, rows[0], sizeof rows[0]);
    uint8_t *rgba = decode(&png, 9, 9);
    assert_memory_equal(rgba, rows, sizeof rows);
    free(rgba);
}

static void jpeg_becomes_rgba(void **state) {
    (void)state;
    struct bytes jpeg;
    const uint8_t colour[3] = {200, 100, 50};
    for (int progressive = 0; progressive < 2; progressive++) {
        write_jpeg(&jpeg, 17, progressive, 3, colour);
        uint8_t *rgba = decode(&jpeg, 17, 17);
        for (int i = 0; i < 17 * 17; i++) {
            for (int c = 0; c < 3; c++) assert_in_range(rgba[i * 4 + c], colour[c] - 2, colour[c] + 2);
            assert_int_equal(rgba[i * 4 + 3], 255);
        }
        free(rgba);
    }
    write_jpeg(&jpeg, 8, false, 1, colour);
    uint8_t *rgba = decode(&jpeg, 8, 8);
    assert_in_range(rgba[2], 199, 201);
    free(rgba);
}

static void a_cut_picture_is_refused(void **state) {
    (void)state;
    struct bytes bytes;
    uint8_t rows[16][16 * 3];
    for (int i = 0; i < 16 * 48; i++) rows[i / 48][i % 48] = (uint8_t)(i * i * 31 >> 3);
    write_png(&bytes, 16, 16, 8, PNG_COLOR_TYPE_RGB, PNG_INTERLACE_NONE, rows[0], sizeof rows[0]);
    for (size_t size = 0; size < bytes.size; size++)
        refuse(bytes.data, size, size < 8 ? "is not PNG" : "truncated");
    bytes.data[bytes.size - 20] ^= 1; /* in the compressed data */
    refuse(bytes.data, bytes.size, "cannot be decoded");

    const uint8_t colour[3] = {200, 100, 50};
    write_jpeg(&bytes, 64, false, 3, colour);
    for (size_t size = 0; size < bytes.size - 2; size++)
        refuse(bytes.data, size, size < 3 ? "is not PNG" : "cannot be decoded");
}

static void oversized_pictures_are_refused_by_their_header(void **state) {
    (void)state;
    struct bytes jpeg;
    const uint8_t colour[3] = {1, 2, 3};
    uint32_t width, height;
    write_jpeg(&jpeg, 8, false, 3, colour);
    size_t at = 2; /* the frame header: FF C0, length, precision, height, width */
    while (jpeg.data[at + 1] != 0xc0) at += 2u + jpeg.data[at + 2] * 256u + jpeg.data[at + 3];
    const uint32_t limit = LW_SCENE_TEXTURE_SIDE_MAX;
    for (uint32_t side = limit; side <= limit + 1; side++) {
        struct lw_error err = {0};
        jpeg.data[at + 7] = (uint8_t)(side >> 8);
        jpeg.data[at + 8] = (uint8_t)side;
        enum lw_status status = lw_image_file_size(jpeg.data, jpeg.size, &width, &height, &err);
        if (side == limit)
            lw_support_ok(status, &err);
        else
            lw_support_fails(status, LW_BAD_DATA, &err, "the limit is 16384 x 16384");
    }
}

static void a_jpeg_of_endless_scans_is_refused(void **state) {
    (void)state;
    static struct bytes jpeg;
    const uint8_t colour[3] = {200, 100, 50};
    write_jpeg(&jpeg, 16, true, 3, colour);
    size_t end = jpeg.size - 2, last = end; /* the last scan, from its SOS to the end marker */
    while (jpeg.data[last] != 0xff || jpeg.data[last + 1] != 0xda) last--;
    size_t scan = end - last;
    for (int i = 0; i < 250; i++, end += scan) {
        assert_true(end + scan + 2 <= sizeof jpeg.data);
        memmove(jpeg.data + end, jpeg.data + last, scan);
    }
    memcpy(jpeg.data + end, "\xff\xd9", 2);
    refuse(jpeg.data, end + 2, "more than 200 scans");
}

/* A picture of many colours, so that a format that mixes up rows or channels shows. */
#define WIDE 19
#define HIGH 13
static void paint(uint8_t rgba[HIGH][WIDE][4]) {
    for (int y = 0; y < HIGH; y++)
        for (int x = 0; x < WIDE; x++) {
            const uint8_t colour[4] = {(uint8_t)(13 * x), (uint8_t)(19 * y), (uint8_t)(7 * x + 5 * y),
                                       (uint8_t)(255 - 11 * y)};
            memcpy(rgba[y][x], colour, 4);
        }
}

static void take(struct bytes *out, const uint8_t *data, size_t size) {
    assert_in_range(size, 1, sizeof out->data);
    memcpy(out->data, data, size);
    out->size = size;
}

static void write_webp(struct bytes *out) {
    uint8_t rgba[HIGH][WIDE][4], *encoded = NULL;
    paint(rgba);
    size_t size = WebPEncodeLosslessRGBA(rgba[0][0], WIDE, HIGH, WIDE * 4, &encoded);
    take(out, encoded, size);
    WebPFree(encoded);
}

/* Lossless: no quantisation, and red, green and blue as they are. */
static void write_avif(struct bytes *out) {
    uint8_t rgba[HIGH][WIDE][4];
    avifRGBImage rgb;
    avifRWData encoded = AVIF_DATA_EMPTY;
    avifImage *image = avifImageCreate(WIDE, HIGH, 8, AVIF_PIXEL_FORMAT_YUV444);
    avifEncoder *encoder = avifEncoderCreate();
    paint(rgba);
    image->matrixCoefficients = AVIF_MATRIX_COEFFICIENTS_IDENTITY;
    avifRGBImageSetDefaults(&rgb, image);
    rgb.pixels = rgba[0][0];
    rgb.rowBytes = WIDE * 4;
    encoder->minQuantizer = encoder->maxQuantizer = 0;
    encoder->minQuantizerAlpha = encoder->maxQuantizerAlpha = 0;
    assert_int_equal(avifImageRGBToYUV(image, &rgb), AVIF_RESULT_OK);
    assert_int_equal(avifEncoderWrite(encoder, image, &encoded), AVIF_RESULT_OK);
    take(out, encoded.data, encoded.size);
    avifRWDataFree(&encoded);
    avifEncoderDestroy(encoder);
    avifImageDestroy(image);
}

static void webp_and_avif_become_rgba(void **state) {
    (void)state;
    static struct bytes bytes;
    uint8_t expected[HIGH][WIDE][4];
    paint(expected);
    for (int avif = 0; avif < 2; avif++) {
        (avif ? write_avif : write_webp)(&bytes);
        uint8_t *rgba = decode(&bytes, WIDE, HIGH);
        assert_memory_equal(rgba, expected, sizeof expected);
        free(rgba);
    }
}

/* Cut at any place, or with a wrong bit anywhere, they are read or refused: no crash, no leak. */
static void damaged_webp_and_avif_are_read_or_refused(void **state) {
    (void)state;
    static struct bytes bytes;
    unsigned refused = 0;
    for (int avif = 0; avif < 2; avif++) {
        (avif ? write_avif : write_webp)(&bytes);
        for (size_t size = 0; size < bytes.size; size++) refuse(bytes.data, size, "");
        for (size_t i = 0; i < bytes.size; i++) {
            struct lw_error err = {0};
            uint32_t width = 0, height = 0;
            uint8_t *rgba = NULL;
            bytes.data[i] ^= (uint8_t)(1 << i % 8);
            enum lw_status status = lw_image_file_size(bytes.data, bytes.size, &width, &height, &err);
            if (status == LW_OK && (uint64_t)width * height < 1u << 22)
                status = lw_image_file_decode(bytes.data, bytes.size, &rgba, &err);
            assert_true(status == LW_OK || (status == LW_BAD_DATA && err.text[0] && !rgba));
            refused += status != LW_OK;
            free(rgba);
            bytes.data[i] ^= (uint8_t)(1 << i % 8);
        }
    }
    assert_true(refused > 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_kind_of_png_becomes_rgba),
        cmocka_unit_test(interlaced_png_is_whole),
        cmocka_unit_test(jpeg_becomes_rgba),
        cmocka_unit_test(webp_and_avif_become_rgba),
        cmocka_unit_test(damaged_webp_and_avif_are_read_or_refused),
        cmocka_unit_test(a_cut_picture_is_refused),
        cmocka_unit_test(oversized_pictures_are_refused_by_their_header),
        cmocka_unit_test(a_jpeg_of_endless_scans_is_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
