/* The TGA reader on any bytes: a picture of the size that it said, or an error with a text. */
#include "server/import/images/image_tga.h"

#include <stdlib.h>

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size) {
    struct lw_error err = {0};
    uint32_t width = 0, height = 0;
    if (lw_image_tga_size(bytes, size, &width, &height, &err)) {
        if (!err.text[0] || width || height) abort();
        return 0;
    }
    if (!lw_image_tga_is(bytes, size) || width == 0 || height == 0) abort();
    if ((uint64_t)width * height > 1u << 20) return 0;
    uint8_t *rgba = malloc((size_t)width * height * 4); /* the exact size: a write past it is seen */
    if (!rgba) abort();
    if (lw_image_tga_decode(bytes, size, rgba, &err) != LW_OK && !err.text[0]) abort();
    free(rgba);
    return 0;
}
