/* bordered_map.h: square maps of side x side cells, with a border of one cell that repeats what lies across
 * an edge, so that bilinear reads need no special case.
 * Threads: pure functions, [any]. */
#ifndef LW_TRANSPORT_BORDERED_MAP_H
#define LW_TRANSPORT_BORDERED_MAP_H

#include <stddef.h>
#include <stdint.h>

/** Cells of a map with its border. */
static inline uint32_t lw_bordered_map_cells(uint32_t side) { return (side + 2) * (side + 2); }

/** The cell of a point of the unit square; never one of the border. */
static inline uint32_t lw_bordered_map_cell(uint32_t side, float u, float v) {
    uint32_t x = (uint32_t)(u * (float)side), y = (uint32_t)(v * (float)side);
    x = x < side ? x : side - 1;
    y = y < side ? y : side - 1;
    return (y + 1) * (side + 2) + x + 1;
}

/** Bilinear read at a point of the unit square. out: `channels` floats */
static inline void lw_bordered_map_read(const float *map, uint32_t side, uint32_t channels, float u, float v,
                                        float *out) {
    const float x = u * (float)side + 0.5f, y = v * (float)side + 0.5f;
    uint32_t i = (uint32_t)x, j = (uint32_t)y;
    i = i <= side ? i : side;
    j = j <= side ? j : side;
    const float fx = x - (float)i, fy = y - (float)j;
    const float *a = map + (size_t)(j * (side + 2) + i) * channels, *b = a + (size_t)(side + 2) * channels;
    for (uint32_t c = 0; c < channels; c++) {
        const float low = a[c] + (a[channels + c] - a[c]) * fx, high = b[c] + (b[channels + c] - b[c]) * fx;
        out[c] = low + (high - low) * fy;
    }
}

#endif
