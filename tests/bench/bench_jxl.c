#include "tests/bench/bench_jxl.h"

#include <jxl/decode.h>
#include <jxl/encode.h>
#include <stdlib.h>

struct bench_jxl {
    JxlEncoder *encoder;
    JxlDecoder *decoder;
};

static const JxlPixelFormat format = {.num_channels = 3, .data_type = JXL_TYPE_FLOAT};

enum lw_status bench_jxl_create(struct bench_jxl **out_jxl) {
    struct bench_jxl *jxl = calloc(1, sizeof *jxl);
    if (!jxl) return LW_NO_MEMORY;
    jxl->encoder = JxlEncoderCreate(NULL);
    jxl->decoder = JxlDecoderCreate(NULL);
    *out_jxl = jxl;
    if (jxl->encoder && jxl->decoder) return LW_OK;
    bench_jxl_destroy(jxl);
    return LW_NO_MEMORY;
}

void bench_jxl_destroy(struct bench_jxl *jxl) {
    if (!jxl) return;
    if (jxl->encoder) JxlEncoderDestroy(jxl->encoder);
    if (jxl->decoder) JxlDecoderDestroy(jxl->decoder);
    free(jxl);
}

enum lw_status bench_jxl_encode(struct bench_jxl *jxl, const float *rgb, uint32_t width, uint32_t height,
                                int effort, float distance, uint8_t *dst, size_t dst_capacity,
                                size_t *out_size) {
    JxlBasicInfo info;
    JxlColorEncoding colour;
    JxlEncoderReset(jxl->encoder);
    JxlEncoderInitBasicInfo(&info);
    info.xsize = width;
    info.ysize = height;
    info.bits_per_sample = 32;
    info.exponent_bits_per_sample = 8;
    info.uses_original_profile = JXL_FALSE;
    JxlColorEncodingSetToSRGB(&colour, JXL_FALSE);
    if (JxlEncoderSetBasicInfo(jxl->encoder, &info) != JXL_ENC_SUCCESS ||
        JxlEncoderSetColorEncoding(jxl->encoder, &colour) != JXL_ENC_SUCCESS)
        return LW_INTERNAL;
    JxlEncoderFrameSettings *settings = JxlEncoderFrameSettingsCreate(jxl->encoder, NULL);
    if (JxlEncoderFrameSettingsSetOption(settings, JXL_ENC_FRAME_SETTING_EFFORT, effort) != JXL_ENC_SUCCESS ||
        JxlEncoderSetFrameDistance(settings, distance) != JXL_ENC_SUCCESS ||
        JxlEncoderAddImageFrame(settings, &format, rgb, (size_t)width * height * 3 * sizeof *rgb) !=
            JXL_ENC_SUCCESS)
        return LW_INTERNAL;
    JxlEncoderCloseInput(jxl->encoder);
    uint8_t *at = dst;
    size_t left = dst_capacity;
    if (JxlEncoderProcessOutput(jxl->encoder, &at, &left) != JXL_ENC_SUCCESS) return LW_INTERNAL;
    *out_size = dst_capacity - left;
    return LW_OK;
}

enum lw_status bench_jxl_decode(struct bench_jxl *jxl, const uint8_t *src, size_t src_size, uint32_t width,
                                uint32_t height, float *rgb) {
    JxlDecoderReset(jxl->decoder);
    if (JxlDecoderSubscribeEvents(jxl->decoder, JXL_DEC_FULL_IMAGE) != JXL_DEC_SUCCESS ||
        JxlDecoderSetInput(jxl->decoder, src, src_size) != JXL_DEC_SUCCESS)
        return LW_BAD_DATA;
    JxlDecoderCloseInput(jxl->decoder);
    for (;;) switch (JxlDecoderProcessInput(jxl->decoder)) {
        case JXL_DEC_NEED_IMAGE_OUT_BUFFER:
            if (JxlDecoderSetImageOutBuffer(jxl->decoder, &format, rgb,
                                            (size_t)width * height * 3 * sizeof *rgb) != JXL_DEC_SUCCESS)
                return LW_BAD_DATA;
            break;
        case JXL_DEC_FULL_IMAGE:
            return LW_OK;
        default:
            return LW_BAD_DATA;
        }
}
