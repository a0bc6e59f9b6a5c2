/* wall_sides.h: which texel a ray reads where walls stand on a surface: one on its own side.
 * Flow:    ray hits -> [wall_sides] -> the texels whose light they read
 * Threads: [any].
 *
 * A texel's square may lie on several sides of what stands on it, but its light is that of one
 * (crossings.h). A ray that ends on another side reads the nearest texel that is seen from just before its
 * end. */
#ifndef LW_SURFACE_WALL_SIDES_H
#define LW_SURFACE_WALL_SIDES_H

#include "common/scene/pose.h"
#include "common/trace/trace.h"
#include "server/solve/surface/texels.h"

struct lw_wall_sides {
    const struct lw_texels *texels;
    const struct lw_pose *pose;
    const struct lw_trace *trace;
};

/** Puts the texels to read in the place of those on whose squares rays end; global indices.
 * active  lanes that have met something
 * rays    as they were traced; directions of any length
 * texel   on whose square each lane ends, or LW_TEXEL_NONE. Afterwards the texel that it reads, or
 *         LW_TEXEL_NONE if no texel of its side is near
 * Cost: nothing where no wall is near; else a ray, and sixteen more where that meets something. */
void lw_wall_sides_read16(const struct lw_wall_sides *sides, uint16_t active, const struct lw_ray16 *rays,
                          const struct lw_hit16 *hits, uint32_t texel[LW_TRACE_WIDTH]);

/** The texels that rays read, by lw_texels_under() and the above. Lanes that are not active, that have met
 * nothing, or the back of a single-sided surface, get LW_TEXEL_NONE. */
void lw_wall_sides_at16(const struct lw_wall_sides *sides, uint16_t active, const struct lw_ray16 *rays,
                        const struct lw_hit16 *hits, uint32_t out_texel[LW_TRACE_WIDTH]);

#endif
