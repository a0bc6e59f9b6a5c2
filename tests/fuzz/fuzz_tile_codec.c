/* A tile's payload from any server. The input: codec, 8 times a channel, and 128 if it builds on coefficients
 * (of all sizes), then width, height and the bytes. Channel 0 is light. Channels 1, 2, 3 have that number of
 * planes, coded plain; 5, 6, 7 have four less, with a sign. */
#include "common/tile/tile_codec.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static void require(bool condition) {
    if (!condition) abort();
}

/* What it differs by from itself, and from what it is with a byte changed, decodes. */
static void expect_between(struct lw_tile_codec *codec, const struct lw_tile_channel *channel,
                           const uint8_t *bytes, size_t size, uint32_t width, uint32_t height) {
    static struct lw_tile_dct_coefficients coefficients;
    static float rgb[LW_TILE_TEXELS_MAX * 3];
    const size_t capacity = lw_tile_codec_bound();
    uint8_t *delta = malloc(capacity), *other = malloc(size + 1);
    require(delta != NULL && other != NULL);
    memcpy(other, bytes, size);
    for (size_t at = size; at-- > 5;) { /* the last that makes a payload of it */
        other[at] ^= 1;
        if (lw_tile_codec_decode(codec, channel, LW_TILE_CODEC_DCT, other, size, 1, width, height, NULL,
                                 rgb) == LW_OK)
            break;
        other[at] ^= 1;
        if (size - at > 16) break;
    }
    size_t delta_size;
    if (lw_tile_codec_encode_between(codec, channel, bytes, size, other, size, width, height, delta, capacity,
                                     &delta_size) == LW_OK) {
        require(delta_size <= capacity);
        require(lw_tile_codec_decode(codec, channel, LW_TILE_CODEC_DCT, bytes, size, 1, width, height,
                                     &coefficients, rgb) == LW_OK);
        require(lw_tile_codec_decode_delta(codec, channel, LW_TILE_CODEC_DCT, delta, delta_size, 1, width,
                                           height, &coefficients, rgb) == LW_OK);
    }
    free(other);
    free(delta);
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size) {
    static struct lw_tile_codec *codec; /* kept: what one payload leaves behind must not hurt the next */
    if (!codec) require(lw_tile_codec_create(&codec) == LW_OK);
    if (size < 3) return 0;
    const uint32_t number = bytes[0] & 7, kind = bytes[0] >> 3 & 7, width = bytes[1], height = bytes[2];
    const struct lw_tile_channel plain = {
        .planes = kind & 3, .is_signed = kind & 4, .coding = LW_TILE_CODING_PLAIN};
    const struct lw_tile_channel *const channel = kind & 3 ? &plain : NULL;
    const size_t values = (size_t)width * height * (channel ? channel->planes : 3);
    float *rgb =
        malloc(values * sizeof *rgb + 1); /* exactly this size, so that ASan sees a write past the tile */
    require(rgb != NULL);
    static struct lw_tile_dct_coefficients coefficients;
    for (uint32_t i = 0; i < 3 * LW_TILE_DCT_PLANE_COEFFICIENTS; i++)
        coefficients.coefficient[i] = (int16_t)(i * 7919);
    enum lw_status status = (bytes[0] & 128 ? lw_tile_codec_decode_delta : lw_tile_codec_decode)(
        codec, channel, number, bytes + 3, size - 3, 0x1p60f, width, height, &coefficients, rgb);
    require(status == LW_OK || status == LW_BAD_DATA);
    require(status != LW_OK || (values > 0 && width <= LW_TILE_SIDE && height <= LW_TILE_SIDE));
    for (size_t i = 0; status == LW_OK && i < values; i++)
        require(isfinite(rgb[i]) && (rgb[i] >= 0 || plain.is_signed));
    free(rgb);
    expect_between(codec, channel, bytes + 3, size - 3, width, height);
    return 0;
}
