/* level_seams.h: makes the light on both sides of a lightmap's seams agree on the coarser levels that views read.
 * Flow:    seam_edges, scene -> [rows]; each frame: levels, built -> [weld] -> levels -> tiles
 * Threads: one caller, workers inside; same values at any number of them.
 *
 * What level 0 agrees on, the means of its texels do not: a look-up of level 1 or 2 reads as far as two or four texels into either chart.
 * So these levels are welded like level 0 (server/solve/seams.h), each by itself, from what was built. Rows lie on their own
 * texels, so that there are fewer than on level 0, half and a quarter of the points. Seams of slivers, which views read at level 0
 * alone, and of other objects' with movers are left out. */
#ifndef LW_PUBLISH_LEVEL_SEAMS_H
#define LW_PUBLISH_LEVEL_SEAMS_H

#include "server/publish/levels.h"
#include "server/solve/seams.h"

struct lw_level_seams {
    const struct lw_scene *scene;
    uint32_t object_count;
    struct lw_seam_edges edges;
    uint8_t **shared;     /* per mesh, per triangle: lw_lightmap_shared() */
    uint8_t *state;       /* per object, as the rows have it: built, moves */
    uint32_t *first_cell; /* per object: of levels' cells; and one more */
    struct lw_seams seams;
    struct lw_seams_light light;
    struct lw_level_texel *texel; /* that a row reads */
};

/** Finds the seams. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_level_seams_init(struct lw_level_seams *s, const struct lw_scene *scene,
                                                 const struct lw_pose *pose, const struct lw_atlas_map *map);
void lw_level_seams_finish(struct lw_level_seams *s);

/** Bytes held. */
size_t lw_level_seams_memory_bytes(const struct lw_level_seams *s);

/** Welds what hangs on the cells built since the last call.
 * levels   per object
 * changed  per object: it was built for this call; set for those that only this changes
 * Errors: LW_NO_MEMORY, with what was built as it is. */
LW_MUST_CHECK enum lw_status lw_level_seams_weld(struct lw_level_seams *s, struct lw_levels *levels,
                                                 const struct lw_pose *pose, bool *changed, int threads);

#endif
