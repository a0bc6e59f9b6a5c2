/* crossings.h: which parts of an object other surfaces part, and which texels show what.
 * Flow:    texels, rays' structure -> [crossings] -> sides, walls, sources; texels that yield
 * Threads: [any], one call per object at a time.
 *
 * Other surfaces cut a chart: a ceiling the wall that goes on above it, a wall the floor that goes on out
 * of doors, a picture rail the wall behind it. Rays between neighbouring texels find the cuts. What no cut
 * parts is one side (texels.h).
 *
 * A look-up beside a cut reads texels of both sides, so that light would leak over it, by up to a texel.
 * Some texels yield: they count as uncovered, and show the light of the other side.
 *
 * strip         three quarters of the texels that a cut parts lie beside cuts; the region on the other side
 *               has at least 32 texels, and twice as many, and is not, for the most part, behind
 * cavity        another surface lies less than an eighth of a texel above the texel, and not above its
 *               neighbour
 * out of doors  it and its neighbours see at least a fifth of the sky, a tenth more of it than those beyond
 *               a cut, beside it or across a corner, of whose rays a quarter go farther than 4 texels, as in
 *               a room
 * behind        the single-sided face that parts two texels shows its back to this one alone, as the water
 *               of a pool does to the wall under it
 *
 * In a cavity, and behind, the next texel yields as well. Where both sides are wide, and rooms, the cut stays
 * between two texels, and look-ups mix them within half a texel.
 *
 * Around an uncovered texel may lie covered ones of several sides, as where a wall stands on it. It shows the
 * room's, where the others are out of doors; else those whose light comes from nearest.
 *
 * A texel lies where its usable points do: its own position may be on a cut's other side. */
#ifndef LW_SURFACE_CROSSINGS_H
#define LW_SURFACE_CROSSINGS_H

#include "common/scene/pose.h"
#include "common/trace/trace.h"
#include "server/solve/surface/texels.h"

/* So near above a texel, of its sides, that what lies between is seen by nobody. */
#define LW_CROSSINGS_CLOSE 0.125f

/** Takes the texels of an object that yield out of covered; their usable points stay in the mask. Texels that
 * yielded before are decided again. Sets the sides and walls, and links the sources. The object stands.
 * blocks     per block of its level 0, row by row: whether its texels are asked about. Texels of other
 *            blocks stay as they are, but for their sides. NULL: all
 * out_count  grows by how many yield
 * Errors     LW_NO_MEMORY */
LW_MUST_CHECK enum lw_status lw_crossings_find(struct lw_texels *texels, const struct lw_pose *pose,
                                               const struct lw_trace *trace, uint32_t object,
                                               const bool *blocks, uint64_t *out_count);

#endif
