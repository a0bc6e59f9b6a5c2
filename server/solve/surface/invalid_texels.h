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
 * Only objects that stand (standing.h) hide points, or lose some. */
#ifndef LW_SURFACE_INVALID_TEXELS_H
#define LW_SURFACE_INVALID_TEXELS_H

#include "server/solve/surface/hidden_points.h"

/** What a search has found. */
struct lw_invalid_texels_found {
    const struct lw_texels *texels; /* their `stands` marks the objects that stood */
    const struct lw_pose *pose;     /* at which they were searched */
    uint64_t count;                 /* texels that are gone */
};

/** Takes invalid points out of usable, invalid texels and those that yield (crossings.h) out of covered, and
 * links the sources.
 * stands     per object (standing.h); outlives the texels
 * cancel     may be NULL; once true, it ends within a part of an object
 * waiting    may be NULL; hears how far it is
 * out_count  how many texels are gone
 * Errors     LW_NO_MEMORY; LW_CLOSED: cancelled */
LW_MUST_CHECK enum lw_status lw_invalid_texels_find(struct lw_texels *texels, const struct lw_pose *pose,
                                                    const bool *stands, const struct lw_trace *trace,
                                                    int threads, const _Atomic bool *cancel,
                                                    struct lw_waiting *waiting, uint64_t *out_count);

/** How far hidden points are looked for at a pose, of any texels. */
struct lw_hidden_points_search lw_invalid_texels_points(const struct lw_texels *texels,
                                                        const struct lw_pose *pose,
                                                        const struct lw_trace *trace);

/** After other objects have come to stand, or stand elsewhere: texels are tested again near where these stood
 * and where they stand, and wherever an object that is gone may have hidden points. An object that stands no
 * longer has all of its texels. texels->changes tells which objects have others.
 * before, stood  the pose of the last test, and what stood then
 * out_others     whether any object covers other texels, or stands elsewhere
 * Errors         LW_NO_MEMORY
 * Cost           a few rays a texel of the tiles near that; elsewhere a comparison a texel of what stands */
LW_MUST_CHECK enum lw_status lw_invalid_texels_review(struct lw_texels *texels, const struct lw_pose *before,
                                                      const bool *stood, const struct lw_pose *pose,
                                                      const struct lw_trace *trace, int threads,
                                                      bool *out_others);

#endif
