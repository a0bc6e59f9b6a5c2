#include "server/import/images/image_file.h"

#include "server/import/images/image_bmp.h"
#include "server/import/images/image_tga.h"

#include <setjmp.h>
#include <stdio.h> /* before jpeglib.h, which needs FILE */
#include <stdlib.h>
#include <string.h>

#include <avif/avif.h>
#include <jerror.h>
#include <jpeglib.h>
#include <png.h>
#include <webp/decode.h>

/* A progressive JPEG of a few kilobytes may ask for thousands of passes over a large picture. */
#define JPEG_SCANS_MAX 200

/* One image on its way through a library that reports failure by a jump. Values that must survive the jump
 * live here. */
struct decoder {
    jmp_buf failed;
    char reason[JMSG_LENGTH_MAX];
    const uint8_t *bytes;
    size_t size, done;
    uint32_t width, height;
    uint32_t room_width, room_height; /* what the caller has memory for */
    uint8_t *rgba;                    /* NULL: the header alone */
    png_bytep *row;
};

/* ---- PNG ---- */

static void png_fails(png_structp png, png_const_charp reason) {
    struct decoder *decoder = png_get_error_ptr(png);
    snprintf(decoder->reason, sizeof decoder->reason, "%s", reason);
    longjmp(decoder->failed, 1);
}

static void png_warns(png_structp png, png_const_charp reason) { (void)png, (void)reason; }

static void png_reads(png_structp png, png_bytep out, size_t size) {
    struct decoder *decoder = png_get_io_ptr(png);
    if (size > decoder->size - decoder->done) png_error(png, "it is truncated");
    memcpy(out, decoder->bytes + decoder->done, size);
    decoder->done += size;
}

static bool make_rows(struct decoder *decoder) {
    if (decoder->width != decoder->room_width || decoder->height != decoder->room_height) return false;
    decoder->row = malloc(decoder->height * sizeof *decoder->row);
    if (!decoder->row) return false;
    for (uint32_t y = 0; y < decoder->height; y++)
        decoder->row[y] = decoder->rgba + (size_t)y * decoder->width * 4;
    return true;
}

/* glTF 2.0, 3.8.4.1: gamma and colour space chunks are ignored, as libpng does by default. */
static void read_png(struct decoder *decoder, png_structp png, png_infop info) {
    png_set_read_fn(png, decoder, png_reads);
    png_set_user_limits(png, LW_SCENE_TEXTURE_SIDE_MAX, LW_SCENE_TEXTURE_SIDE_MAX);
    png_read_info(png, info);
    decoder->width = png_get_image_width(png, info);
    decoder->height = png_get_image_height(png, info);
    if (!decoder->rgba) return;
    png_set_expand(png); /* palettes, few bits, transparent colours */
    png_set_scale_16(png);
    png_set_gray_to_rgb(png);
    png_set_add_alpha(png, 255, PNG_FILLER_AFTER);
    png_set_interlace_handling(png);
    png_read_update_info(png, info);
    if (png_get_rowbytes(png, info) != (size_t)decoder->width * 4)
        png_error(png, "its format is not supported");
    if (!make_rows(decoder)) png_error(png, "out of memory");
    png_read_image(png, decoder->row);
    png_read_end(png, NULL);
}

static bool run_png(struct decoder *decoder) {
    png_structp png = png_create_read_struct(PNG_LIBPNG_VER_STRING, decoder, png_fails, png_warns);
    png_infop info = png ? png_create_info_struct(png) : NULL;
    if (!info) snprintf(decoder->reason, sizeof decoder->reason, "out of memory");
    if (!info || setjmp(decoder->failed)) {
        png_destroy_read_struct(&png, &info, NULL);
        return false;
    }
    read_png(decoder, png, info);
    png_destroy_read_struct(&png, &info, NULL);
    return true;
}

/* ---- JPEG ---- */

static void jpeg_fails(j_common_ptr jpeg) {
    struct decoder *decoder = jpeg->client_data;
    jpeg->err->format_message(jpeg, decoder->reason);
    longjmp(decoder->failed, 1);
}

/* libjpeg goes on after corrupt data, in grey. Its other warnings (junk between segments, an odd version) do
 * no harm. */
static void jpeg_warns(j_common_ptr jpeg, int level) {
    int code = jpeg->err->msg_code;
    bool corrupt = code == JWRN_JPEG_EOF || code == JWRN_HIT_MARKER || code == JWRN_HUFF_BAD_CODE ||
                   code == JWRN_MUST_RESYNC;
    if (level < 0 && corrupt) jpeg_fails(jpeg);
}

static void jpeg_progresses(j_common_ptr jpeg) {
    struct decoder *decoder = jpeg->client_data;
    if (((j_decompress_ptr)jpeg)->input_scan_number <= JPEG_SCANS_MAX) return;
    snprintf(decoder->reason, sizeof decoder->reason, "it has more than %d scans", JPEG_SCANS_MAX);
    longjmp(decoder->failed, 1);
}

static void read_jpeg(struct decoder *decoder, j_decompress_ptr jpeg) {
    jpeg_mem_src(jpeg, decoder->bytes, decoder->size);
    jpeg_read_header(jpeg, TRUE);
    decoder->width = jpeg->image_width;
    decoder->height = jpeg->image_height;
    if (!decoder->rgba) return;
    jpeg->out_color_space = JCS_EXT_RGBA;
    jpeg_start_decompress(jpeg);
    if (!make_rows(decoder)) ERREXIT1(jpeg, JERR_OUT_OF_MEMORY, 0);
    while (jpeg->output_scanline < jpeg->output_height)
        jpeg_read_scanlines(jpeg, &decoder->row[jpeg->output_scanline],
                            jpeg->output_height - jpeg->output_scanline);
    jpeg_finish_decompress(jpeg);
}

static bool run_jpeg(struct decoder *decoder) {
    struct jpeg_decompress_struct jpeg = {.client_data = decoder};
    struct jpeg_error_mgr errors;
    struct jpeg_progress_mgr progress = {.progress_monitor = jpeg_progresses};
    jpeg.err = jpeg_std_error(&errors);
    errors.error_exit = jpeg_fails;
    errors.emit_message = jpeg_warns;
    if (setjmp(decoder->failed)) {
        jpeg_destroy_decompress(&jpeg);
        return false;
    }
    jpeg_create_decompress(&jpeg); /* keeps err and client_data */
    jpeg.progress = &progress;
    read_jpeg(decoder, &jpeg);
    jpeg_destroy_decompress(&jpeg);
    return true;
}

/* ---- WebP ---- */

static const char *webp_reason(VP8StatusCode status) {
    return status == VP8_STATUS_NOT_ENOUGH_DATA ? "it is truncated"
           : status == VP8_STATUS_OUT_OF_MEMORY ? "out of memory"
                                                : "it is corrupt";
}

static bool run_webp(struct decoder *decoder) {
    WebPDecoderConfig config;
    WebPInitDecoderConfig(&config);
    VP8StatusCode status = WebPGetFeatures(decoder->bytes, decoder->size, &config.input);
    if (status == VP8_STATUS_OK) {
        decoder->width = (uint32_t)config.input.width;
        decoder->height = (uint32_t)config.input.height;
        if (!decoder->rgba) return true;
        if (!make_rows(decoder)) status = VP8_STATUS_OUT_OF_MEMORY;
    }
    if (status == VP8_STATUS_OK) {
        config.output.colorspace = MODE_RGBA;
        config.output.is_external_memory = 1;
        config.output.u.RGBA = (WebPRGBABuffer){.rgba = decoder->rgba,
                                                .stride = (int)decoder->width * 4,
                                                .size = (size_t)decoder->width * decoder->height * 4};
        status = WebPDecode(decoder->bytes, decoder->size, &config);
    }
    if (status == VP8_STATUS_UNSUPPORTED_FEATURE)
        snprintf(decoder->reason, sizeof decoder->reason, "it is animated");
    else if (status != VP8_STATUS_OK)
        snprintf(decoder->reason, sizeof decoder->reason, "%s", webp_reason(status));
    return status == VP8_STATUS_OK;
}

/* ---- AVIF ---- */

/* Strict checks would refuse what encoders of some years ago wrote, and add no safety. */
static avifResult read_avif(struct decoder *decoder, avifDecoder *avif) {
    avif->maxThreads = 1;
    avif->ignoreExif = avif->ignoreXMP = AVIF_TRUE;
    avif->imageDimensionLimit = LW_SCENE_TEXTURE_SIDE_MAX;
    avif->imageCountLimit = 1;
    avif->strictFlags = AVIF_STRICT_DISABLED;
    avifResult result = avifDecoderSetIOMemory(avif, decoder->bytes, decoder->size);
    if (result == AVIF_RESULT_OK) result = avifDecoderParse(avif);
    if (result != AVIF_RESULT_OK) return result;
    decoder->width = avif->image->width;
    decoder->height = avif->image->height;
    if (!decoder->rgba) return AVIF_RESULT_OK;
    if ((result = avifDecoderNextImage(avif)) != AVIF_RESULT_OK) return result;
    if (avif->image->width != decoder->width || avif->image->height != decoder->height)
        return AVIF_RESULT_BMFF_PARSE_FAILED;
    if (!make_rows(decoder)) return AVIF_RESULT_OUT_OF_MEMORY;
    avifRGBImage out;
    avifRGBImageSetDefaults(&out, avif->image);
    out.format = AVIF_RGB_FORMAT_RGBA;
    out.depth = 8;
    out.pixels = decoder->rgba;
    out.rowBytes = decoder->width * 4;
    return avifImageYUVToRGB(avif->image, &out);
}

static bool run_avif(struct decoder *decoder) {
    avifDecoder *avif = avifDecoderCreate();
    avifResult result = avif ? read_avif(decoder, avif) : AVIF_RESULT_OUT_OF_MEMORY;
    if (avif) avifDecoderDestroy(avif);
    snprintf(decoder->reason, sizeof decoder->reason, "%s", avifResultToString(result));
    return result == AVIF_RESULT_OK;
}

static bool is_avif(const uint8_t *bytes, size_t size) {
    const avifROData data = {bytes, size};
    return size >= 12 && memcmp(bytes + 4, "ftyp", 4) == 0 && avifPeekCompatibleFileType(&data);
}

/* ---- TGA and BMP ---- */

typedef enum lw_status read_size(const uint8_t *bytes, size_t size, uint32_t *out_width, uint32_t *out_height,
                                 struct lw_error *err);
typedef enum lw_status read_texels(const uint8_t *bytes, size_t size, uint8_t *out_rgba,
                                   struct lw_error *err);

static bool run_own(struct decoder *decoder, read_size *size, read_texels *texels) {
    struct lw_error err = {0};
    enum lw_status status = size(decoder->bytes, decoder->size, &decoder->width, &decoder->height, &err);
    if (status == LW_OK && decoder->rgba) {
        if (make_rows(decoder))
            status = texels(decoder->bytes, decoder->size, decoder->rgba, &err);
        else
            status = lw_status_fail(&err, LW_NO_MEMORY, "out of memory");
    }
    snprintf(decoder->reason, sizeof decoder->reason, "%s", err.text);
    return status == LW_OK;
}

static bool run_tga(struct decoder *decoder) {
    return run_own(decoder, lw_image_tga_size, lw_image_tga_decode);
}
static bool run_bmp(struct decoder *decoder) {
    return run_own(decoder, lw_image_bmp_size, lw_image_bmp_decode);
}

/* ---- all ---- */

/* Format by the first bytes; NULL: none of these. */
static bool (*find_format(const uint8_t *bytes, size_t size))(struct decoder *decoder) {
    static const uint8_t jpeg_magic[3] = {0xff, 0xd8, 0xff};
    if (size >= 8 && png_sig_cmp(bytes, 0, 8) == 0) return run_png;
    if (size >= 3 && memcmp(bytes, jpeg_magic, 3) == 0) return run_jpeg;
    if (size >= 12 && memcmp(bytes, "RIFF", 4) == 0 && memcmp(bytes + 8, "WEBP", 4) == 0) return run_webp;
    if (is_avif(bytes, size)) return run_avif;
    if (lw_image_bmp_is(bytes, size)) return run_bmp;
    return lw_image_tga_is(bytes, size) ? run_tga : NULL;
}

static enum lw_status run(struct decoder *decoder, struct lw_error *err) {
    if (decoder->size > LW_IMAGE_FILE_SIZE_MAX)
        return lw_status_fail(err, LW_BAD_DATA, "has %zu bytes; the limit is %u", decoder->size,
                              LW_IMAGE_FILE_SIZE_MAX);
    bool (*decode)(struct decoder *) = find_format(decoder->bytes, decoder->size);
    if (!decode) return lw_status_fail(err, LW_BAD_DATA, "is not " LW_IMAGE_FILE_FORMATS);
    if (!decode(decoder)) return lw_status_fail(err, LW_BAD_DATA, "cannot be decoded: %s", decoder->reason);
    return LW_OK;
}

enum lw_status lw_image_file_size(const uint8_t *bytes, size_t size, uint32_t *out_width,
                                  uint32_t *out_height, struct lw_error *err) {
    struct decoder decoder = {.bytes = bytes, .size = size};
    enum lw_status status = run(&decoder, err);
    if (status) return status;
    if (decoder.width < 1 || decoder.height < 1 || decoder.width > LW_SCENE_TEXTURE_SIDE_MAX ||
        decoder.height > LW_SCENE_TEXTURE_SIDE_MAX)
        return lw_status_fail(err, LW_BAD_DATA, "has %u x %u texels; the limit is %u x %u", decoder.width,
                              decoder.height, LW_SCENE_TEXTURE_SIDE_MAX, LW_SCENE_TEXTURE_SIDE_MAX);
    *out_width = decoder.width;
    *out_height = decoder.height;
    return LW_OK;
}

enum lw_status lw_image_file_count(struct lw_image_file_budget *budget, uint32_t width, uint32_t height,
                                   struct lw_error *err) {
    const uint64_t limit = budget->limit ? budget->limit : LW_IMAGE_FILE_TEXELS,
                   texels = (uint64_t)width * height;
    if (texels > limit - budget->used)
        return lw_status_fail(err, LW_BAD_DATA,
                              "has %u x %u texels: with %llu of pictures before it more than %llu in all; "
                              "--picture-texels allows more",
                              width, height, (unsigned long long)budget->used, (unsigned long long)limit);
    budget->used += texels;
    return LW_OK;
}

enum lw_status lw_image_file_decode(const uint8_t *bytes, size_t size, uint32_t width, uint32_t height,
                                    uint8_t *out_rgba, struct lw_error *err) {
    struct decoder decoder = {
        .bytes = bytes, .size = size, .room_width = width, .room_height = height, .rgba = out_rgba};
    enum lw_status status = run(&decoder, err);
    free(decoder.row);
    return status;
}
