/* invalid_texels.h: finds the sample points that light cannot reach, and texels that have no other.
 * Flow:    texels, rays' structure -> [invalid_texels] -> texels without them
 * Threads: one call before the first frame, others between two; workers inside.
 *
 * Such points lie inside other objects, under a box that stands on the floor, behind a plinth, or on the
 * very plane of a wall, where rays may start on its other side. They see the backs of what they lie in,
 * close by, or stand beside a wall of it. Nobody sees their darkness, but it would bleed into look-ups
 * at the rim of the contact. So they are left out of their texel, as are those close under other
 * surfaces, and those on one side of a surface that cuts the texel: the far side from its own position,
 * unless a single-sided face shows this one its back. A texel without a
 * sample point is invalid: it counts as uncovered, and is filled from its neighbours like a gutter.
 * Only objects that never move hide points, or lose some. */
#ifndef LW_SURFACE_INVALID_TEXELS_H
#define LW_SURFACE_INVALID_TEXELS_H

#include "common/scene/pose.h"
#include "common/trace/trace.h"
#include "server/solve/surface/texels.h"

/** Takes invalid points out of usable, invalid texels and those that yield (crossings.h) out of covered, and
 * links the sources.
 * cancel     may be NULL; once true, it ends within a part of an object
 * waiting    may be NULL; hears how far it is
 * out_count  how many texels are gone
 * Errors     LW_NO_MEMORY; LW_CLOSED: cancelled */
LW_MUST_CHECK enum lw_status lw_invalid_texels_find(struct lw_texels *texels, const struct lw_pose *pose,
                                                    const struct lw_trace *trace, int threads,
                                                    const _Atomic bool *cancel, struct lw_waiting *waiting,
                                                    uint64_t *out_count);

/** After objects have become movers: texels near where these stood that have lost points are tested again, as
 * a whole, and have the points that are valid now: most get some back, a few lose others, or yield in
 * place of those beside them. Texels that have lost none are not tested: fewer objects hide fewer points.
 * Movers have all of their texels.
 * before: the pose of the last test. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_invalid_texels_review(struct lw_texels *texels, const struct lw_pose *before,
                                                      const struct lw_pose *pose,
                                                      const struct lw_trace *trace, int threads);

#endif
