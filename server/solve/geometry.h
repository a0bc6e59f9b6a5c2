/* geometry.h: what all light of a scene shares: the rays' structure, the texels,
 * pairs for a filter, and seams.
 * Flow:    scene, pose -> [geometry] -> cell_solver, one for each layer of light (light_layers.h)
 * Threads: one caller at a time, workers inside; between two calls [any] may read. Searches for seams have a
 *          thread of their own. */
#ifndef LW_SOLVE_GEOMETRY_H
#define LW_SOLVE_GEOMETRY_H

#include "common/trace/trace.h"
#include "server/solve/filter/denoise.h"
#include "server/solve/filter/seams.h"
#include "server/solve/fine_tiles.h"
#include "server/solve/solver.h"
#include "server/solve/surface/saved_texels.h"
#include "server/solve/surface/standing.h"
#include "server/solve/surface/wall_sides.h"

/** How it finds which texels light reaches. */
struct lw_geometry_terms {
    /* Where an earlier start has saved them, and where this one does: what cannot be read or written is
     * logged, and costs the time of finding it. Copied. NULL: nowhere. */
    const struct lw_saved_texels *saved;
    /* Tiles of finer levels at most, when they are made, and the atlases that have such levels. */
    uint32_t fine_tiles;
    enum lw_fine_when fine_when;
    const struct lw_atlas_map *map; /* outlives the geometry; NULL: there are none */
};

struct lw_geometry {
    const struct lw_scene *scene;
    struct lw_trace *trace;
    struct lw_standing standing;
    struct lw_texels texels;
    struct lw_fine_tiles fine;
    uint32_t changes;              /* how often texels->changes has counted */
    struct lw_denoise_pairs pairs; /* empty until somebody filters */
    struct lw_seams seams;         /* empty until somebody welds */
    uint32_t seams_found;          /* times that they have been */
    bool seams_outdated;
    struct lw_geometry_search *search; /* for others, or NULL */
    struct lw_geometry_edges *edges;   /* a search for the edges of the first seams, or NULL */
    struct lw_pose pose;               /* at which they are */
    int threads;
};

/** Builds structure and texels at a pose.
 * scene    outlives the geometry
 * terms    NULL: it looks at once, and saves nothing
 * cancel   may be NULL; once true, it ends soon
 * waiting  may be NULL; hears how far it is
 * Errors   LW_NO_MEMORY, LW_INTERNAL; LW_BAD_DATA for more texels than fit; LW_CLOSED: cancelled */
LW_MUST_CHECK enum lw_status lw_geometry_init(struct lw_geometry *geometry, const struct lw_scene *scene,
                                              const struct lw_pose *pose,
                                              const struct lw_geometry_terms *terms, int threads,
                                              const _Atomic bool *cancel, struct lw_waiting *waiting,
                                              struct lw_error *err);
/** A zeroed one is fine. */
void lw_geometry_finish(struct lw_geometry *geometry);

/** Moves to another pose, and takes over what base colours the scene has now. Where objects no longer stand
 * (standing.h), what they buried comes to light; where others do, texels are hidden and parted: other texels
 * are covered, of other sides. Who keeps something by texels looks at changes, and takes it over by
 * lw_tiles_recount(). Seams are those of before until they are found again. A pose at which it is already
 * costs nothing.
 * later   as for lw_trace_set_pose_soon()
 * frame   of the solver
 * Errors  LW_NO_MEMORY, LW_INTERNAL */
LW_MUST_CHECK enum lw_status lw_geometry_set_pose(struct lw_geometry *geometry, const struct lw_pose *pose,
                                                  bool later, uint64_t frame, struct lw_error *err);

/** Goes on to a frame: objects that have been at rest for long enough stand from now on, as above. A second
 * call for the same frame does nothing. */
LW_MUST_CHECK enum lw_status lw_geometry_rest(struct lw_geometry *geometry, uint64_t frame,
                                              struct lw_error *err);

/** Its texels as rays read them. */
static inline struct lw_wall_sides lw_geometry_sides(const struct lw_geometry *geometry) {
    return (struct lw_wall_sides){
        .texels = &geometry->texels, .pose = &geometry->pose, .trace = geometry->trace};
}

/** Weighs the pairs, unless they are. Errors: LW_NO_MEMORY; there are none then. */
LW_MUST_CHECK enum lw_status lw_geometry_weigh_pairs(struct lw_geometry *geometry);

/** Finds the seams, unless they are current; seams_found tells.
 * tiles   any over its texels
 * later   seams of before may serve for a while: others are sought in a thread, and taken by
 *         the first call after it has ended
 * Errors  LW_NO_MEMORY; those of before stay then */
LW_MUST_CHECK enum lw_status lw_geometry_find_seams(struct lw_geometry *geometry,
                                                    const struct lw_tiles *tiles, bool later);

/** Before tiles are freed with which seams may be sought: ends that. */
void lw_geometry_forget_tiles(struct lw_geometry *geometry);

size_t lw_geometry_memory_bytes(const struct lw_geometry *geometry);

#endif
