#include "common/scene/pixel_filter.h"

#include <string.h>

/* Left, above, and above to the left. */
static inline uint8_t expect(uint8_t a, uint8_t b, uint8_t c) {
    const int low = a < b ? a : b, high = a < b ? b : a, plane = a + b - c;
    return (uint8_t)(plane < low ? low : plane > high ? high : plane);
}

/* The value before in the first row, the one above in the first column; for the very first 0. */
static inline uint8_t expect_at(const uint8_t *at, uint32_t x, uint32_t y, ptrdiff_t width) {
    if (x && y) return expect(at[-1], at[-width], at[-width - 1]);
    return x ? at[-1] : y ? at[-width] : 0;
}

#define RUN 256u /* pixels of a row whose differences are taken together */

/* Writes the differences of a run to `out`; at: its first value, not in the first row or column. */
static void take_differences(const uint8_t *restrict at, const uint8_t *restrict above, uint32_t count,
                             uint8_t *restrict out) {
    for (uint32_t i = 0; i < count; i++)
        out[i] = (uint8_t)(at[i] - expect(at[(ptrdiff_t)i - 1], above[i], above[(ptrdiff_t)i - 1]));
}

/* From the end: predictions use the values before differences replace them. */
static void replace_by_differences(uint8_t *bytes, uint32_t width, uint32_t height, uint32_t planes) {
    for (uint32_t c = 0; c < planes; c++)
        for (uint32_t y = height; y-- > 0;) {
            uint8_t *row = bytes + ((size_t)c * height + y) * width, run[RUN];
            uint32_t x = width;
            while (y && x > 1) {
                const uint32_t count = x - 1 < RUN ? x - 1 : RUN;
                x -= count;
                take_differences(row + x, row + x - width, count, run);
                memcpy(row + x, run, count);
            }
            while (x-- > 0) row[x] = (uint8_t)(row[x] - expect_at(row + x, x, y, width));
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

/* One value of each plane. */
typedef int16_t values __attribute__((vector_size(8)));

static inline values least(values a, values b) {
    const values chosen = a < b;
    return (a & chosen) | (b & ~chosen);
}

static inline values most(values a, values b) {
    const values chosen = a > b;
    return (a & chosen) | (b & ~chosen);
}

/* The planes of a pixel are undone at once: each prediction waits for the one before it. */
void lw_pixel_filter_undo_planes(const uint8_t *bytes, uint32_t width, uint32_t height, uint32_t planes,
                                 uint8_t *out_rgba) {
    const size_t count = (size_t)width * height, row = 4 * (size_t)width;
    const size_t plane[4] = {0, planes > 1 ? count : 0, planes > 2 ? 2 * count : 0,
                             planes > 3 ? 3 * count : 0};
    for (uint32_t y = 0; y < height; y++) {
        const uint8_t *from = bytes + (size_t)y * width;
        uint8_t *to = out_rgba + y * row;
        values left = {0}, corner = {0};
        for (uint32_t x = 0; x < width; x++, from++, to += 4) {
            const uint8_t *up = y ? to - row : to;
            const values above = y ? (values){up[0], up[1], up[2], up[3]} : left;
            if (!x) left = corner = above;
            const values difference = {from[plane[0]], from[plane[1]], from[plane[2]], from[plane[3]]},
                         expected =
                             y ? most(least(left + above - corner, most(left, above)), least(left, above))
                               : left;
            left = (difference + expected) & 0xff;
            corner = above;
            for (uint32_t c = 0; c < planes; c++) to[c] = (uint8_t)left[c];
        }
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
