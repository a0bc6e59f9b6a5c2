/* seam_gutters.h: what lies around charts: beyond a seam the light of the surface that goes
 * on there, else the chart's own.
 * Flow:    seam_edges, texels -> [find]
 *          each frame: welded light -> [fill] -> tiles' light -> publish
 * Threads: find by one; fill by one caller, workers inside.
 *
 * A look-up of level 0 reads one texel beyond a chart, which the weld has made to fit (seams.h). Look-ups of
 * levels 1 and 2 reach farther: their texels are means over gutters too. So a gutter that no look-up of level
 * 0 reads, up to two texels beyond a seam, takes what a bilinear look-up reads on the other side, as far from
 * the seam. All others take the light of the texel that stands for them (texels.h). */
#ifndef LW_FILTER_SEAM_GUTTERS_H
#define LW_FILTER_SEAM_GUTTERS_H

#include "server/solve/state/tiles.h"
#include "server/solve/surface/seam_edges.h"

struct lw_seam_gutters {
    struct lw_seam_gutter *gutter; /* beyond seams; by texel */
    size_t count, capacity;
    struct lw_seam_copy *copy; /* the others; by the block of the texel that stands for them */
    uint32_t *first_copy;      /* per block of lw_tiles, and one more */
    uint32_t block_count;
};

/** Finds the gutters that are not `welded` (a byte per texel of the global numbering), and
 * marks those beyond seams there.
 * tiles: any over these texels. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_seam_gutters_find(const struct lw_scene *scene,
                                                  const struct lw_texels *texels,
                                                  const struct lw_tiles *tiles,
                                                  const struct lw_seam_edges *edges, uint8_t *welded,
                                                  struct lw_seam_gutters *out_gutters);
void lw_seam_gutters_finish(struct lw_seam_gutters *gutters);

/** Bytes held. */
size_t lw_seam_gutters_memory_bytes(const struct lw_seam_gutters *gutters);

/** Fills them, in the given channels, from the shown light of covered texels in the blocks shown in frame
 * `frame`, which the solved_frame of their tiles becomes. */
void lw_seam_gutters_fill(const struct lw_seam_gutters *gutters, struct lw_tiles *tiles, uint64_t frame,
                          uint32_t channels, int threads);

#endif
