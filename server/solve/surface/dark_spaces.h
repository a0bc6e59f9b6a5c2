/* dark_spaces.h: whether light can reach a point at all.
 * Flow:    points that see backs alone, or something close above -> [dark_spaces] -> hidden_points
 * Threads: [any].
 *
 * Walks leave the point and bounce off what they meet, as light would on its way back. A walk finds light
 * where it leaves the scene, meets something that shines, moves or lets light through, or sees a lamp. A
 * space in which no walk finds light is dark: the inside of a solid, or a joint between two. */
#ifndef LW_SURFACE_DARK_SPACES_H
#define LW_SURFACE_DARK_SPACES_H

#include "common/scene/pose.h"
#include "common/trace/trace.h"
#include "server/solve/surface/texels.h"

#define LW_DARK_SPACES_WALKS 16u /* a space where none finds light is dark */

/** Where walks go. far_m: beyond all of the scene */
struct lw_dark_spaces {
    const struct lw_texels *texels;
    const struct lw_pose *pose;
    const struct lw_trace *trace;
    float far_m;
};

/** Sixteen walks, one from each active point. walk: which, each below LW_DARK_SPACES_WALKS. Returns the lanes
 * that find light. */
uint16_t lw_dark_spaces_find_light(const struct lw_dark_spaces *spaces, uint16_t active,
                                   const uint32_t walk[LW_TRACE_WIDTH],
                                   const struct lw_vec3 point[LW_TRACE_WIDTH],
                                   const struct lw_vec3 normal[LW_TRACE_WIDTH]);

#endif
