/* regions.h: rooms of a tile, and which texels of a block are corrected together.
 * Flow:    sides of texels -> [rooms] -> what light errors are measured against
 *          rooms of texels -> [regions] -> packets; change and correction by regions
 * Threads: pure functions, [any].
 *
 * Each side of a chart (texels.h) within a tile is a room by itself: a wall's faces share a tile, and one
 * looks at the sun. Small charts that no wall cuts are one room together.
 *
 * Indirect light may change in one corner of a block and not in another: its regions are the quarters of
 * 8 x 8 texels. A change in one room says nothing of another, however near. So a block with several rooms
 * has regions by rooms: the largest rooms have one each, and a second one while there are regions left.
 * Regions of a room belong to one part; quarters are all of one. */
#ifndef LW_SURFACE_REGIONS_H
#define LW_SURFACE_REGIONS_H

#include "server/solve/surface/texels.h"

#define LW_REGIONS 4u

/* Rooms of a tile have numbers of 8 bits; 0: small charts. The smallest of very many share the last. */
#define LW_ROOMS_MAX 256u
/* Texels of a room that is wide: its light is measured by itself, and not against its tile's. */
#define LW_ROOM_WIDE 64u

/** Tells the covered texels of a tile their rooms, the largest first: from 1 on.
 * first    the tile's first texel within the mesh; the others follow, row by row
 * covered  of the tile's first texel: what takes part
 * side     likewise (texels.h)
 * room     likewise, written: 0 of texels that are not covered
 * Returns how many rooms from 1 on are wide. */
uint32_t lw_rooms_find(const struct lw_mesh_texels *mesh, uint32_t first, uint32_t width, uint32_t height,
                       const uint8_t *covered, const uint32_t *side, uint8_t *room);

/* Part p has the regions from end[p - 1], or 0, to end[p] - 1. */
struct lw_region_parts {
    uint8_t count; /* 1 to LW_REGIONS */
    uint8_t end[LW_REGIONS];
    uint8_t room[LW_REGIONS];
};

/** Tells the covered texels of one block their regions.
 * stride   from one of its rows to the next; width, height: of the block, in texels
 * covered  of the block's first texel, rows as above: what takes part
 * room     likewise
 * region   likewise, written: 0 to LW_REGIONS - 1, of texels that are not covered as well */
struct lw_region_parts lw_regions_deal(uint32_t stride, uint32_t width, uint32_t height,
                                       const uint8_t *covered, const uint8_t *room, uint8_t *region);

#endif
