/* A tile's payload from any server: codec, and 128 if it builds on levels (of all sizes), width and height, then the bytes. */
#include "common/tile/tile_codec.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static void require(bool condition) {
    if (!condition) abort();
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size) {
    static struct lw_tile_codec *codec; /* kept: what one payload leaves behind must not hurt the next */
    if (!codec) require(lw_tile_codec_create(&codec) == LW_OK);
    if (size < 3) return 0;
    const uint32_t number = bytes[0] & 127, width = bytes[1], height = bytes[2];
    const size_t values = (size_t)width * height * 3;
    float *rgb = malloc(values * sizeof *rgb + 1); /* of this size, so that ASan sees a write past the tile */
    require(rgb != NULL);
    static struct lw_tile_dct_levels levels;
    for (uint32_t i = 0; i < 3 * LW_TILE_DCT_PLANE_LEVELS; i++) levels.level[i] = (int16_t)(i * 7919);
    enum lw_status status = (bytes[0] & 128 ? lw_tile_codec_decode_delta : lw_tile_codec_decode)(
        codec, number, bytes + 3, size - 3, 0x1p60f, width, height, &levels, rgb);
    require(status == LW_OK || status == LW_BAD_DATA);
    require(status != LW_OK || (values > 0 && width <= LW_TILE_SIDE && height <= LW_TILE_SIDE));
    for (size_t i = 0; status == LW_OK && i < values; i++) require(isfinite(rgb[i]) && rgb[i] >= 0);
    free(rgb);
    return 0;
}
