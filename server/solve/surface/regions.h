/* regions.h: which texels of a block are corrected together.
 * Flow:    sides of texels -> [regions] -> packets; what changes, and is corrected, by regions
 * Threads: pure function, [any].
 *
 * Indirect light may change in one corner of a block and not in another: its regions are the quarters of
 * 8 x 8 texels. What changes on one side of a wall says nothing of the other, however near. So a block on
 * which walls stand has regions by sides (texels.h): the largest sides have one each, and a second one while
 * there are regions left. Regions of a side belong to one part; quarters are all of one. */
#ifndef LW_SURFACE_REGIONS_H
#define LW_SURFACE_REGIONS_H

#include "server/solve/surface/texels.h"

#define LW_REGIONS 4u

/* Part p has the regions from end[p - 1], or 0, to end[p] - 1. */
struct lw_region_parts {
    uint8_t count; /* 1 to LW_REGIONS */
    uint8_t end[LW_REGIONS];
};

/** Tells the covered texels of one block their regions.
 * first    the block's first texel within the mesh
 * stride   from one of its rows to the next; width, height: of the block, in texels
 * covered  of the block's first texel, rows as above: what takes part
 * side     likewise (texels.h)
 * region   likewise, written: 0 to LW_REGIONS - 1, of texels that are not covered as well */
struct lw_region_parts lw_regions_deal(const struct lw_mesh_texels *mesh, uint32_t first, uint32_t stride,
                                       uint32_t width, uint32_t height, const uint8_t *covered,
                                       const uint32_t *side, uint8_t *region);

#endif
