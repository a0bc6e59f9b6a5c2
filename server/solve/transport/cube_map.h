/* cube_map.h: functions of direction on the six faces of a cube, each a map (bordered_map.h) whose border
 * repeats what lies across its edges.
 * Threads: pure functions, [any].
 * After:   Greene 1986 (environment maps on a cube). */
#ifndef LW_TRANSPORT_CUBE_MAP_H
#define LW_TRANSPORT_CUBE_MAP_H

#include "common/base/vec.h"
#include "server/solve/transport/bordered_map.h"

#include <stdint.h>
#include <string.h>

#define LW_CUBE_MAP_FACES 6u

/* The point where a direction meets the cube. Face 2a is on the positive side of axis a, face 2a + 1 on the
 * negative one. u, v: the position in the face, 0 to 1. */
struct lw_cube_map_place {
    uint32_t face;
    float u, v;
};

/* across, up: along the axes after the face's own, over the component along that. */
static inline struct lw_cube_map_place lw_cube_map_on(uint32_t axis, float along, float across, float up) {
    const float scale = 0.5f / fabsf(along);
    return (struct lw_cube_map_place){2 * axis + (along < 0), across * scale + 0.5f, up * scale + 0.5f};
}

/** d: of any length but 0. */
static inline struct lw_cube_map_place lw_cube_map_place(struct lw_vec3 d) {
    const float x = fabsf(d.x), y = fabsf(d.y), z = fabsf(d.z);
    if (x >= y && x >= z) return lw_cube_map_on(0, d.x, d.y, d.z);
    if (y >= z) return lw_cube_map_on(1, d.y, d.z, d.x);
    return lw_cube_map_on(2, d.z, d.x, d.y);
}

/** Unit direction through a place, which may lie beyond its face. */
static inline struct lw_vec3 lw_cube_map_direction(struct lw_cube_map_place p) {
    const float along = p.face & 1 ? -1 : 1, across = 2 * p.u - 1, up = 2 * p.v - 1;
    const struct lw_vec3 turned[3] = {lw_vec3(along, across, up), lw_vec3(up, along, across),
                                      lw_vec3(across, up, along)};
    return lw_vec3_normalize(turned[p.face / 2]);
}

/** The cell that a direction falls into; never one of a border. */
static inline uint32_t lw_cube_map_cell(uint32_t side, struct lw_vec3 d) {
    const struct lw_cube_map_place p = lw_cube_map_place(d);
    return p.face * lw_bordered_map_cells(side) + lw_bordered_map_cell(side, p.u, p.v);
}

/** The middle of a row or column, i of 0 to side + 1. That of a border lies just beyond the face, so that the
 * cell there is the neighbour's along their common edge. */
static inline float lw_cube_map_middle(uint32_t side, uint32_t i) {
    return fminf(fmaxf(((float)i - 0.5f) / (float)side, -0.001f), 1.001f);
}

/** Fills the borders of all faces of a map of `channels` floats a cell from their insides. */
static inline void lw_cube_map_wrap(float *map, uint32_t side, uint32_t channels) {
    const uint32_t cells = lw_bordered_map_cells(side), row = side + 2;
    for (uint32_t i = 0; i < LW_CUBE_MAP_FACES * cells; i++) {
        const uint32_t x = i % cells % row, y = i % cells / row;
        if (x >= 1 && x <= side && y >= 1 && y <= side) continue;
        const struct lw_vec3 d = lw_cube_map_direction(
            (struct lw_cube_map_place){i / cells, lw_cube_map_middle(side, x), lw_cube_map_middle(side, y)});
        memcpy(map + (size_t)i * channels, map + (size_t)lw_cube_map_cell(side, d) * channels,
               channels * sizeof *map);
    }
}

/** Bilinear read. */
static inline void lw_cube_map_read(const float *map, uint32_t side, uint32_t channels, struct lw_vec3 d,
                                    float *out) {
    const struct lw_cube_map_place p = lw_cube_map_place(d);
    lw_bordered_map_read(map + (size_t)p.face * lw_bordered_map_cells(side) * channels, side, channels, p.u,
                         p.v, out);
}

#endif
