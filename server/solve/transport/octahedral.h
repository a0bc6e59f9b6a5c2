/* octahedral.h: functions of direction as square maps: the sphere folded to an octahedron, the octahedron to
 * a square. A map has side x side cells and a border of one cell that repeats what lies across the fold, so
 * that bilinear reads need no special case.
 * Threads: pure functions, [any].
 * After:   Meyer et al. 2010 (the mapping), Cigolle et al. 2014 (its error), Majercik
 *          et al. 2019 (bordered maps). */
#ifndef LW_TRANSPORT_OCTAHEDRAL_H
#define LW_TRANSPORT_OCTAHEDRAL_H

#include "common/vec.h"

#include <stdint.h>
#include <string.h>

/** Direction to the unit square. The direction need not be of unit length, but not zero. */
static inline struct lw_vec2 lw_octahedral_encode(struct lw_vec3 d) {
    float norm = fabsf(d.x) + fabsf(d.y) + fabsf(d.z), u = d.x / norm, v = d.y / norm;
    if (d.z < 0) {
        float folded = (1 - fabsf(v)) * copysignf(1, u);
        v = (1 - fabsf(u)) * copysignf(1, v);
        u = folded;
    }
    return (struct lw_vec2){u * 0.5f + 0.5f, v * 0.5f + 0.5f};
}

/** Unit square to unit direction. */
static inline struct lw_vec3 lw_octahedral_decode(struct lw_vec2 p) {
    float u = 2 * p.x - 1, v = 2 * p.y - 1, z = 1 - fabsf(u) - fabsf(v), fold = z < 0 ? -z : 0;
    return lw_vec3_normalize(lw_vec3(u - copysignf(fold, u), v - copysignf(fold, v), z));
}

/** Cells of a map with its border. */
static inline uint32_t lw_octahedral_cells(uint32_t side) { return (side + 2) * (side + 2); }

/** The cell of a bordered map that a direction falls into; never one of the border. */
static inline uint32_t lw_octahedral_cell(uint32_t side, struct lw_vec3 d) {
    struct lw_vec2 p = lw_octahedral_encode(d);
    uint32_t x = (uint32_t)(p.x * (float)side), y = (uint32_t)(p.y * (float)side);
    x = x < side ? x : side - 1;
    y = y < side ? y : side - 1;
    return (y + 1) * (side + 2) + x + 1;
}

/** Direction of a cell's middle. x, y from 0, without the border. */
static inline struct lw_vec3 lw_octahedral_direction(uint32_t side, uint32_t x, uint32_t y) {
    return lw_octahedral_decode(
        (struct lw_vec2){((float)x + 0.5f) / (float)side, ((float)y + 0.5f) / (float)side});
}

/** Fills the border of a map of `channels` floats a cell from its inside. */
static inline void lw_octahedral_wrap(float *map, uint32_t side, uint32_t channels) {
    const uint32_t row = side + 2;
    const size_t bytes = channels * sizeof *map;
    for (uint32_t i = 1; i <= side; i++) {
        const uint32_t mirrored = side + 1 - i;
        memcpy(map + (size_t)i * channels, map + (size_t)(row + mirrored) * channels, bytes);
        memcpy(map + (size_t)((side + 1) * row + i) * channels,
               map + (size_t)(side * row + mirrored) * channels, bytes);
    }
    for (uint32_t i = 0; i < row; i++) { /* the corners as well: all four are the direction -Z */
        const uint32_t mirrored = side + 1 - i;
        memcpy(map + (size_t)(i * row) * channels, map + (size_t)(mirrored * row + 1) * channels, bytes);
        memcpy(map + (size_t)(i * row + side + 1) * channels,
               map + (size_t)(mirrored * row + side) * channels, bytes);
    }
}

/** Bilinear read of a bordered map. */
static inline void lw_octahedral_read(const float *map, uint32_t side, uint32_t channels, struct lw_vec3 d,
                                      float *out) {
    struct lw_vec2 p = lw_octahedral_encode(d);
    float x = p.x * (float)side + 0.5f, y = p.y * (float)side + 0.5f;
    uint32_t i = (uint32_t)x, j = (uint32_t)y;
    i = i <= side ? i : side;
    j = j <= side ? j : side;
    float fx = x - (float)i, fy = y - (float)j;
    const float *a = map + (size_t)(j * (side + 2) + i) * channels, *b = a + (size_t)(side + 2) * channels;
    for (uint32_t c = 0; c < channels; c++) {
        float low = a[c] + (a[channels + c] - a[c]) * fx, high = b[c] + (b[channels + c] - b[c]) * fx;
        out[c] = low + (high - low) * fy;
    }
}

#endif
