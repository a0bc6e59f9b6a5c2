/* seam_walk.h: walks every seam of a solved scene and reads both sides as the viewer does.
 * Threads: one at a time. */
#ifndef LW_TESTS_SEAM_WALK_H
#define LW_TESTS_SEAM_WALK_H

#include "server/publish/levels.h"
#include "server/solve/surface/seam_edges.h"

/** The light of a solve as clients get it. */
struct seam_walk {
    uint32_t object_count;
    const struct lw_scene *scene;
    struct lw_levels *levels; /* per object */
    uint8_t **coarsest;       /* per mesh, per triangle: views read no coarser level (lw_lightmap_coarsest) */
    double floor;             /* under the divisor: 2 % of the mean light */
};

enum seam_walk_light {
    SEAM_WALK_WELDED,
    SEAM_WALK_SEWN, /* not welded: texels around a chart are the mean of their neighbours on it */
    SEAM_WALK_BARE  /* not welded: level 0 is black around charts */
};

/** Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status seam_walk_init(struct seam_walk *walk, const struct lw_scene *scene,
                                            const struct lw_atlas_map *map, const struct lw_solver *solver,
                                            enum seam_walk_light light);
void seam_walk_finish(struct seam_walk *walk);

/** Light that the viewer reads of an object at a place of its atlas (texels of level 0), red channel. Returns
 * false over a hole. */
bool seam_walk_read(const struct seam_walk *walk, uint32_t object, unsigned level, double u, double v,
                    double *out);

/** Relative differences of the two sides, red channel. */
struct seam_spread {
    size_t points;
    double light; /* mean of what both sides read, W/m^2 */
    double mean, p50, p99, p999, worst;
    double over, far_over; /* shares of points over 1 % and over 5 % */
    double dark;           /* share of points whose sides' mean is under the floor */
};

/** Eight points per texel of the level; on coarser levels without the seams of charts that are read at level
 * 0 alone. object: whose seams, or LW_SCENE_NONE: all. A side with holes alone (inside an object) has no
 * seam.
 * Errors: LW_NO_MEMORY; LW_INTERNAL: light that is negative or not finite. */
LW_MUST_CHECK enum lw_status seam_walk_measure(const struct seam_walk *walk,
                                               const struct lw_seam_edges *edges, unsigned level,
                                               uint32_t object, struct seam_spread *out);

/** Relative change of the mean light by welding: of the scene, and the worst of an object of 1,000 texels and
 * more. */
void seam_walk_mean_change(const struct lw_atlas_map *map, const struct lw_solver *solver, double *out_scene,
                           double *out_object);

#endif
