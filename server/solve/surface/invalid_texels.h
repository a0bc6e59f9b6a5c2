/* burial.h: finds what light cannot reach: places inside other objects, under a box that stands on the floor, behind a
 * plinth, or on the very plane of a wall, where rays may start on its other side.
 * Flow:    texels, rays' structure -> [burial] -> texels without them
 * Threads: one call before the first frame, others between two; workers inside.
 *
 * A buried place sees the backs of what it lies in, close by, or beside a wall of it. Its darkness is nobody's to see, but would bleed into the
 * lookups at the rim of the contact; so it is left out of its texel's footprint. A texel that has no place left counts as
 * uncovered, and is filled from its neighbours like a gutter. Only objects that never move bury and are buried. */
#ifndef LW_SURFACE_INVALID_TEXELS_H
#define LW_SURFACE_INVALID_TEXELS_H

#include "common/scene/pose.h"
#include "common/trace/trace.h"
#include "server/solve/surface/texels.h"

/** Takes what is buried out of usable and covered and links the sources anew. Returns how many texels are gone. */
uint64_t lw_invalid_texels_find(struct lw_texels *texels, const struct lw_pose *pose,
                                const struct lw_trace *trace, int threads);

/** After objects have become movers: looks again at what was buried as near to where they stood as they may have buried it, and
 * gives back what no longer is. Movers have all of their texels. What was not buried is not looked at: fewer objects bury less.
 * before: the pose of the last look. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_invalid_texels_review(struct lw_texels *texels, const struct lw_pose *before,
                                                      const struct lw_pose *pose,
                                                      const struct lw_trace *trace, int threads);

#endif
