/* Pictures made here by the libraries' own encoders, and what a damaged one gets. */
#include "tests/support/support.h"

#include "server/import/images/image_file.h"

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

/* Both steps, as readers of scenes take them. *out_rgba: malloc'ed, as it was after failure. */
static enum lw_status read_image(const uint8_t *data, size_t size, uint8_t **out_rgba, struct lw_error *err) {
    uint32_t width, height;
    enum lw_status status = lw_image_file_size(data, size, &width, &height, err);
    if (status) return status;
    uint8_t *rgba = malloc((size_t)width * height * 4);
    assert_non_null(rgba);
    status = lw_image_file_decode(data, size, width, height, rgba, err);
    if (status)
        free(rgba);
    else
        *out_rgba = rgba;
    return status;
}

static uint8_t *decode(const struct bytes *in, uint32_t width, uint32_t height) {
    struct lw_error err = {0};
    uint32_t got_width = 0, got_height = 0;
    uint8_t *rgba = NULL;
    lw_support_ok(lw_image_file_size(in->data, in->size, &got_width, &got_height, &err), &err);
    assert_int_equal(got_width, width);
    assert_int_equal(got_height, height);
    lw_support_ok(read_image(in->data, in->size, &rgba, &err), &err);
    return rgba;
}

static void refuse(const uint8_t *data, size_t size, const char *text) {
    struct lw_error err = {0};
    uint8_t *rgba = NULL, *exact = malloc(size ? size : 1);
    memcpy(exact, data, size);
    lw_support_fails(read_image(exact, size, &rgba, &err), LW_BAD_DATA, &err, text);
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

static void copy_bytes(struct bytes *out, const uint8_t *data, size_t size) {
    assert_in_range(size, 1, sizeof out->data);
    memcpy(out->data, data, size);
    out->size = size;
}

static void write_webp(struct bytes *out) {
    uint8_t rgba[HIGH][WIDE][4], *encoded = NULL;
    paint(rgba);
    size_t size = WebPEncodeLosslessRGBA(rgba[0][0], WIDE, HIGH, WIDE * 4, &encoded);
    copy_bytes(out, encoded, size);
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
    copy_bytes(out, encoded.data, encoded.size);
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
                status = read_image(bytes.data, bytes.size, &rgba, &err);
            assert_true(status == LW_OK || (status == LW_BAD_DATA && err.text[0] && !rgba));
            refused += status != LW_OK;
            free(rgba);
            bytes.data[i] ^= (uint8_t)(1 << i % 8);
        }
    }
    assert_true(refused > 0);
}

/* At the limit and one past it; a refused picture counts for nothing. */
static void all_pictures_have_a_bound(void **state) {
    (void)state;
    struct lw_image_file_budget budget = {.limit = 100}, usual = {0};
    struct lw_error err = {0};
    lw_support_ok(lw_image_file_count(&budget, 9, 10, &err), &err);
    lw_support_fails(lw_image_file_count(&budget, 11, 1, &err), LW_BAD_DATA, &err,
                     "has 11 x 1 texels: with 90 of pictures before it more than 100 in all; "
                     "--picture-texels allows more");
    err = (struct lw_error){0};
    lw_support_ok(lw_image_file_count(&budget, 10, 1, &err), &err);
    lw_support_ok(lw_image_file_count(&usual, 16384, 16384, &err), &err);
    lw_support_fails(lw_image_file_count(&usual, 1, 1, &err), LW_BAD_DATA, &err,
                     "more than 268435456 in all");
}

/* A file that says another size than before, to a decoder with memory for the first size. */
static void another_size_is_refused(void **state) {
    (void)state;
    static struct bytes jpeg;
    uint8_t rgba[4] = {0};
    struct lw_error err = {0};
    const uint8_t colour[3] = {9, 9, 9};
    write_jpeg(&jpeg, 8, false, 3, colour);
    assert_int_equal(lw_image_file_decode(jpeg.data, jpeg.size, 1, 1, rgba, &err), LW_BAD_DATA);
}

/* ---- TGA and BMP, by our own readers ---- */

/* Decodes bytes of exactly this size, so that a sanitizer sees a read past them. */
static void expect_texels(const uint8_t *data, size_t size, uint32_t width, uint32_t height,
                          const uint8_t *expected) {
    struct lw_error err = {0};
    uint32_t got_width = 0, got_height = 0;
    uint8_t *rgba = NULL, *exact = malloc(size);
    memcpy(exact, data, size);
    lw_support_ok(lw_image_file_size(exact, size, &got_width, &got_height, &err), &err);
    assert_int_equal(got_width, width);
    assert_int_equal(got_height, height);
    lw_support_ok(read_image(exact, size, &rgba, &err), &err);
    assert_memory_equal(rgba, expected, (size_t)width * height * 4);
    free(rgba);
    free(exact);
}

/* Header of a TGA: type, size, bits, descriptor; without a palette. */
#define TGA(type, width, height, bits, descriptor)                                                           \
    0, 0, type, 0, 0, 0, 0, 0, 0, 0, 0, 0, width, 0, height, 0, bits, descriptor

static void every_kind_of_tga_becomes_rgba(void **state) {
    (void)state;
    /* two rows of two, the lower one first */
    static const uint8_t colour[] = {TGA(2, 2, 2, 24, 0), 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12};
    static const uint8_t up[16] = {9, 8, 7, 255, 12, 11, 10, 255, 3, 2, 1, 255, 6, 5, 4, 255};
    expect_texels(colour, sizeof colour, 2, 2, up);
    /* from the top and the right; alpha */
    static const uint8_t alpha[] = {TGA(2, 2, 1, 32, 0x38), 1, 2, 3, 128, 4, 5, 6, 0};
    static const uint8_t turned[8] = {6, 5, 4, 0, 3, 2, 1, 128};
    expect_texels(alpha, sizeof alpha, 2, 1, turned);
    /* an alpha of 0 everywhere is one that nobody wrote */
    static const uint8_t unwritten[] = {TGA(2, 1, 1, 32, 0), 1, 2, 3, 0};
    static const uint8_t opaque[4] = {3, 2, 1, 255};
    expect_texels(unwritten, sizeof unwritten, 1, 1, opaque);
    /* five bits each: 31, 16, 1 */
    static const uint8_t narrow[] = {TGA(2, 1, 1, 16, 0), 0x01, 0x7E};
    static const uint8_t widened[4] = {255, 132, 8, 255};
    expect_texels(narrow, sizeof narrow, 1, 1, widened);
    static const uint8_t grey[] = {TGA(3, 2, 1, 8, 0x20), 7, 200};
    static const uint8_t greys[8] = {7, 7, 7, 255, 200, 200, 200, 255};
    expect_texels(grey, sizeof grey, 2, 1, greys);
    /* runs: three of one, one as it is; they cross the row */
    static const uint8_t runs[] = {TGA(10, 2, 2, 24, 0x20), 0x82, 1, 2, 3, 0x00, 4, 5, 6};
    static const uint8_t spread[16] = {3, 2, 1, 255, 3, 2, 1, 255, 3, 2, 1, 255, 6, 5, 4, 255};
    expect_texels(runs, sizeof runs, 2, 2, spread);
    /* a palette that starts at 5, behind a text of two bytes */
    static const uint8_t palette[] = {2, 1, 1, 5,    0,   2,   0, 24, 0, 0, 0, 0, 2, 0,
                                      1, 0, 8, 0x20, 'h', 'i', 1, 2,  3, 4, 5, 6, 6, 5};
    static const uint8_t picked[8] = {6, 5, 4, 255, 3, 2, 1, 255};
    expect_texels(palette, sizeof palette, 2, 1, picked);

    uint8_t outside[sizeof palette];
    memcpy(outside, palette, sizeof palette);
    outside[sizeof palette - 1] = 7;
    refuse(outside, sizeof outside, "texel 1 is past its palette");
    outside[sizeof palette - 1] = 4;
    refuse(outside, sizeof outside, "texel 1 is past its palette");
    for (size_t size = 0; size < sizeof runs; size++)
        refuse(runs, size, size < 18 ? "is not PNG" : "it is truncated");
    for (size_t size = 18; size < sizeof palette; size++) refuse(palette, size, "it is truncated");
    static const uint8_t large[] = {0, 0, 10, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 64, 0, 64, 24, 0, 0xFF, 1, 2, 3};
    refuse(large, sizeof large, "it is truncated"); /* 16,384 a side in 22 bytes: no memory is taken */
}

#define LONG(value) (value) & 255, (value) >> 8 & 255, (value) >> 16 & 255, (value) >> 24 & 255
/* The two headers of a BMP; `more` bytes of header and palette follow. */
#define BMP(header, more, width, height, bits, compression, used)                                            \
    'B', 'M', LONG(0), LONG(0), LONG(54 + (more)), LONG(header), LONG(width), LONG(height), 1, 0, bits, 0,   \
        LONG(compression), LONG(0), LONG(0), LONG(0), LONG(used), LONG(0)

static void every_kind_of_bmp_becomes_rgba(void **state) {
    (void)state;
    /* rows of two texels fill up to 8 bytes; the lower one first */
    static const uint8_t colour[] = {
        BMP(40, 0, 2, 2, 24, 0, 0), 1, 2, 3, 4, 5, 6, 0, 0, 7, 8, 9, 10, 11, 12, 0, 0};
    static const uint8_t up[16] = {9, 8, 7, 255, 12, 11, 10, 255, 3, 2, 1, 255, 6, 5, 4, 255};
    expect_texels(colour, sizeof colour, 2, 2, up);
    static const uint8_t down[] = {BMP(40, 0, 1, -2, 24, 0, 0), 1, 2, 3, 0, 4, 5, 6, 0};
    static const uint8_t from_top[8] = {3, 2, 1, 255, 6, 5, 4, 255};
    expect_texels(down, sizeof down, 1, 2, from_top);
    /* 32 bits have no alpha unless fields say so */
    static const uint8_t plain[] = {BMP(40, 0, 1, 1, 32, 0, 0), 1, 2, 3, 128};
    static const uint8_t opaque[4] = {3, 2, 1, 255};
    expect_texels(plain, sizeof plain, 1, 1, opaque);
    static const uint8_t fields[] = {BMP(56, 16, 1, 1, 32, 3, 0),
                                     LONG(0xFF),
                                     LONG(0xFF00),
                                     LONG(0xFF0000),
                                     LONG(0xFF000000u),
                                     1,
                                     2,
                                     3,
                                     128};
    static const uint8_t in_order[4] = {1, 2, 3, 128};
    expect_texels(fields, sizeof fields, 1, 1, in_order);
    /* 5, 6, 5 bits: 31, 32, 0 */
    static const uint8_t narrow[] = {
        BMP(40, 12, 1, 1, 16, 3, 0), LONG(0xF800), LONG(0x7E0), LONG(0x1F), 0x00, 0xFC, 0, 0};
    static const uint8_t widened[4] = {255, 129, 0, 255};
    expect_texels(narrow, sizeof narrow, 1, 1, widened);
    /* 4 bits, two colours */
    static const uint8_t palette[] = {BMP(40, 8, 3, 1, 4, 0, 2), 1, 2, 3, 0, 4, 5, 6, 0, 0x10, 0x10, 0, 0};
    static const uint8_t picked[12] = {6, 5, 4, 255, 3, 2, 1, 255, 6, 5, 4, 255};
    expect_texels(palette, sizeof palette, 3, 1, picked);
    /* OS/2: 1 bit, colours of three bytes */
    static const uint8_t core[] = {'B', 'M', LONG(0), LONG(0), LONG(32), LONG(12), 2, 0, 1,    0, 1, 0,
                                   1,   0,   1,       2,       3,        4,        5, 6, 0x40, 0, 0, 0};
    static const uint8_t bits[8] = {3, 2, 1, 255, 6, 5, 4, 255};
    expect_texels(core, sizeof core, 2, 1, bits);

    uint8_t wrong[sizeof palette];
    memcpy(wrong, palette, sizeof palette);
    wrong[sizeof palette - 4] = 0x12;
    refuse(wrong, sizeof wrong, "colour 2 is past its palette");
    static const uint8_t runs[] = {BMP(40, 0, 1, 1, 8, 1, 0), 1, 0, 0, 1};
    refuse(runs, sizeof runs, "its compression 1 is not read");
    static const uint8_t odd[] = {BMP(40, 0, 1, 1, 2, 0, 0), 1, 0, 0, 1};
    refuse(odd, sizeof odd, "it has 2 bits a texel");
    static const uint8_t gaps[] = {
        BMP(40, 12, 1, 1, 16, 3, 0), LONG(0xF801), LONG(0x7E0), LONG(0x1F), 0, 0, 0, 0};
    refuse(gaps, sizeof gaps, "its bit fields have gaps");
    static const uint8_t none[] = {BMP(40, 0, 0, 1, 24, 0, 0), 0, 0, 0, 0};
    refuse(none, sizeof none, "it has no texels");
    static const uint8_t wide[] = {BMP(40, 0, 0x7FFFFFFF, 0x7FFFFFFF, 32, 0, 0), 0, 0, 0, 0};
    refuse(wide, sizeof wide, "it is truncated");
    for (size_t size = 26; size < sizeof palette; size++) refuse(palette, size, "truncated");
    for (size_t size = 54; size < sizeof fields; size++) refuse(fields, size, "truncated");
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(all_pictures_have_a_bound),
        cmocka_unit_test(another_size_is_refused),
        cmocka_unit_test(every_kind_of_png_becomes_rgba),
        cmocka_unit_test(interlaced_png_is_whole),
        cmocka_unit_test(jpeg_becomes_rgba),
        cmocka_unit_test(webp_and_avif_become_rgba),
        cmocka_unit_test(damaged_webp_and_avif_are_read_or_refused),
        cmocka_unit_test(every_kind_of_tga_becomes_rgba),
        cmocka_unit_test(every_kind_of_bmp_becomes_rgba),
        cmocka_unit_test(a_cut_picture_is_refused),
        cmocka_unit_test(oversized_pictures_are_refused_by_their_header),
        cmocka_unit_test(a_jpeg_of_endless_scans_is_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
