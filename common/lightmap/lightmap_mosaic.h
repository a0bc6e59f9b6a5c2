/* lightmap_mosaic.h: packs shapes made of blocks, so that charts fill each other's holes and corners.
 * Threads: pure functions on the caller's memory. */
#ifndef LW_COMMON_LIGHTMAP_MOSAIC_H
#define LW_COMMON_LIGHTMAP_MOSAIC_H

#include "common/base/status.h"
#include "common/base/vec.h"

#include <stdint.h>

/** A shape on a grid of blocks. */
struct lw_lightmap_stone {
    uint32_t width, height; /* blocks */
    uint32_t x, y;          /* result */
    float wanted;           /* 0..1: wanted position along the atlas (lw_lightmap_mosaic_pack_near) */
    uint64_t *row;          /* height rows of (width + 63) / 64 words; bit x % 64 of word x / 64 */
};

static inline uint32_t lw_lightmap_mosaic_words(uint32_t width) { return (width + 63) / 64; }

/** Adds the cells that a triangle touches, or comes nearer to than reach (both axes alike).
 * corner, cell, reach  in the same unit; the shape's lower corner is the origin */
void lw_lightmap_mosaic_mark(struct lw_lightmap_stone *stone, const struct lw_vec2 corner[3], float cell,
                             float reach);

/** Places shapes in the order given, each at the first free place in rows from below.
 * out_width, out_height  the part that is used
 * looks                  positions that may be looked at, and are left: the search takes time, too
 * out_fits               false: height_max was not enough, a shape is wider than width, or no looks are left
 * Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_lightmap_mosaic_pack(struct lw_lightmap_stone *const *stone, uint32_t count,
                                                     uint32_t width, uint32_t height_max, uint64_t *looks,
                                                     uint32_t *out_width, uint32_t *out_height,
                                                     bool *out_fits);

/** Places shapes, the largest first, each in the free place nearest to its wanted position along the atlas.
 * Positions run through tiles of 16 x 16 cells, row by row in alternating direction, and inside a tile along
 * a Hilbert curve of squares of 4 x 4 cells. The atlas is the smallest nearly square one that holds all
 * shapes.
 * stone       sorted by the call
 * looks       as above
 * out_fits    false: it would be wider than width_max or higher than height_max, or no looks are left
 * Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_lightmap_mosaic_pack_near(struct lw_lightmap_stone **stone, uint32_t count,
                                                          uint32_t width_max, uint32_t height_max,
                                                          uint64_t *looks, uint32_t *out_width,
                                                          uint32_t *out_height, bool *out_fits);

/** Cells of a shape. */
uint64_t lw_lightmap_mosaic_area(const struct lw_lightmap_stone *stone);

/** Order of two shapes (pointers to pointers, for qsort) in one array: larger ones first. */
int lw_lightmap_mosaic_by_size(const void *left, const void *right);

#endif
