/* moment_bounds.h: keeps shown cosine moments within what any light has (common/light/direction_form.h).
 * Flow:    shown planes, filtered and welded -> [moment_bounds] -> gutters -> publish
 * Threads: one caller, workers inside; same bytes at any number of them.
 *
 * |V| is at most the luminance of E, and V points away from the surface. The sums keep both. The filter mixes
 * in texels of other normals. The weld moves E and V each by itself: at an edge of shadow V could become many
 * times E. Both bounds hold again afterwards; means over texels keep the first one. */
#ifndef LW_FILTER_MOMENT_BOUNDS_H
#define LW_FILTER_MOMENT_BOUNDS_H

#include "server/solve/state/tiles.h"

/** Shortens the moments among `channels`, and lifts those of covered texels above their surface, in all tiles
 * that were shown in frame `frame`. A moment within the bounds, to 1e-6 of the luminance, is not changed.
 * pose  where objects stand */
void lw_moment_bounds_keep(struct lw_tiles *tiles, const struct lw_pose *pose, uint64_t frame,
                           uint32_t channels, int threads);

#endif
