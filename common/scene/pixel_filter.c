#include "common/scene/pixel_filter.h"

/* Left, above, and above to the left. */
static inline uint8_t expect(uint8_t a, uint8_t b, uint8_t c) {
    const uint8_t low = a < b ? a : b, high = a < b ? b : a;
    return c >= high ? low : c <= low ? high : (uint8_t)(a + b - c);
}

/* The pixel before in the first row, the one above in the first column; for the very first 0. plane: `step`
 * bytes apart. */
static inline uint8_t expect_at(const uint8_t *at, uint32_t x, uint32_t y, size_t row, size_t step) {
    if (x && y) return expect(at[-(ptrdiff_t)step], at[-(ptrdiff_t)row], at[-(ptrdiff_t)(row + step)]);
    return x ? at[-(ptrdiff_t)step] : y ? at[-(ptrdiff_t)row] : 0;
}

/* From the end: predictions use the values before differences replace them. */
static void replace_by_differences(uint8_t *bytes, uint32_t width, uint32_t height, uint32_t planes) {
    for (uint32_t c = 0; c < planes; c++)
        for (uint32_t y = height; y-- > 0;)
            for (uint32_t x = width; x-- > 0;) {
                uint8_t *at = bytes + ((size_t)c * height + y) * width + x;
                *at = (uint8_t)(*at - expect_at(at, x, y, width, 1));
            }
}

void lw_pixel_filter_apply(const uint8_t *rgba, uint32_t width, uint32_t height, uint8_t *out_bytes) {
    const size_t count = (size_t)width * height;
    /* red and blue without green */
    for (size_t i = 0; i < count; i++) {
        out_bytes[i] = (uint8_t)(rgba[4 * i] - rgba[4 * i + 1]);
        out_bytes[count + i] = rgba[4 * i + 1];
        out_bytes[2 * count + i] = (uint8_t)(rgba[4 * i + 2] - rgba[4 * i + 1]);
        out_bytes[3 * count + i] = rgba[4 * i + 3];
    }
    replace_by_differences(out_bytes, width, height, 4);
}

void lw_pixel_filter_apply_planes(const uint8_t *rgba, uint32_t width, uint32_t height, uint32_t planes,
                                  uint8_t *out_bytes) {
    const size_t count = (size_t)width * height;
    for (uint32_t c = 0; c < planes; c++)
        for (size_t i = 0; i < count; i++) out_bytes[c * count + i] = rgba[4 * i + c];
    replace_by_differences(out_bytes, width, height, planes);
}

void lw_pixel_filter_undo_planes(const uint8_t *bytes, uint32_t width, uint32_t height, uint32_t planes,
                                 uint8_t *out_rgba) {
    const size_t count = (size_t)width * height, row = 4 * (size_t)width;
    for (uint32_t c = 0; c < planes; c++)
        for (uint32_t y = 0; y < height; y++)
            for (uint32_t x = 0; x < width; x++) {
                const size_t i = (size_t)y * width + x;
                uint8_t *at = out_rgba + 4 * i + c;
                *at = (uint8_t)(bytes[c * count + i] + expect_at(at, x, y, row, 4));
            }
}

void lw_pixel_filter_undo(const uint8_t *bytes, uint32_t width, uint32_t height, uint8_t *out_rgba) {
    const size_t count = (size_t)width * height;
    lw_pixel_filter_undo_planes(bytes, width, height, 4, out_rgba);
    for (size_t i = 0; i < count; i++) {
        out_rgba[4 * i] = (uint8_t)(out_rgba[4 * i] + out_rgba[4 * i + 1]);
        out_rgba[4 * i + 2] = (uint8_t)(out_rgba[4 * i + 2] + out_rgba[4 * i + 1]);
    }
}
