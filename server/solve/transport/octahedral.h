/* octahedral.h: functions of direction as square maps (octahedron.h), with a border (bordered_map.h) of the
 * cells that the mapping joins to them.
 * Threads: pure functions, [any].
 * After:   Majercik et al. 2019 (bordered maps). */
#ifndef LW_TRANSPORT_OCTAHEDRAL_H
#define LW_TRANSPORT_OCTAHEDRAL_H

#include "server/solve/surface/octahedron.h"
#include "server/solve/transport/bordered_map.h"

#include <stdint.h>
#include <string.h>

/** Direction to the unit square. The direction need not be of unit length, but not zero. */
static inline struct lw_vec2 lw_octahedral_encode(struct lw_vec3 d) {
    const struct lw_vec2 p = lw_octahedron_fold(d);
    return (struct lw_vec2){p.x * 0.5f + 0.5f, p.y * 0.5f + 0.5f};
}

/** Unit square to unit direction. */
static inline struct lw_vec3 lw_octahedral_decode(struct lw_vec2 p) {
    return lw_octahedron_unfold(2 * p.x - 1, 2 * p.y - 1);
}

/** The cell of a bordered map that a direction falls into; never one of the border. */
static inline uint32_t lw_octahedral_cell(uint32_t side, struct lw_vec3 d) {
    const struct lw_vec2 p = lw_octahedral_encode(d);
    return lw_bordered_map_cell(side, p.x, p.y);
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
    const struct lw_vec2 p = lw_octahedral_encode(d);
    lw_bordered_map_read(map, side, channels, p.x, p.y, out);
}

#endif
