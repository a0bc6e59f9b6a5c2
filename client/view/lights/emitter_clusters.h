/* emitter_clusters.h: small emissive meshes as lamps: the unshadowed light of each at a point, and targets on
 * it for shadow rays.
 * Flow:    lights -> [emitter_clusters] -> direct_pixels, direct_tile
 * Threads: init and set_pose by one thread; the rest [any] in between.
 *
 * A cluster is made of connected triangles of one object and one material, and of such pieces that lie close
 * together. Its light without shadows is computed, not sampled, so it has no noise. A shadow ray to one place
 * on it says how much of that arrives (Heitz, Hill, McGuire: Combining Analytic Direct Illumination and
 * Stochastic Shadows, 2018).
 * from afar    a point whose intensity depends on the direction (a map of the octahedron). An object close to
 * it, such as a lamp's shade or cage, is part of it: shadow rays end before that
 *   from nearby  its triangles, exactly, if they are few; else a few facets, each as bright as a disc of its
 *                area. Shadow rays go all the way */
#ifndef LW_CLIENT_VIEW_LIGHTS_EMITTER_CLUSTERS_H
#define LW_CLIENT_VIEW_LIGHTS_EMITTER_CLUSTERS_H

#include "common/base/points16.h"
#include "common/light/lights.h"
#include "common/trace/trace.h"

#define LW_EMITTER_CLUSTERS_POINTS     64u /* places on a cluster, a multiple of 16 */
#define LW_EMITTER_CLUSTERS_FACETS_MAX 32u
#define LW_EMITTER_CLUSTERS_MAP        16u /* steps along a side of the octahedron's map */

/** Triangles that face much the same way, side by side. */
struct lw_emitter_facet {
    struct lw_vec3 centre, normal; /* world space */
    float power;                   /* luminance x area, W/sr */
    float soft_m2;                 /* area / pi */
    uint32_t first, count;         /* its sides */
    struct lw_vec2 corner[3];      /* its part of a single side, in that side's barycentrics */
};

/** One side of a cluster of few. */
struct lw_emitter_triangle {
    struct lw_vec3 corner[3]; /* counterclockwise as seen from where it shines, world space, m */
    float luminance;          /* radiance, luminance of it: W/(m^2 sr) */
};

struct lw_emitter_cluster {
    struct lw_vec3 centre; /* the centre of a ball around it, world space, m */
    float radius_m;
    struct lw_vec3 colour; /* unit luminance */
    float intensity;       /* the most in any direction, luminance, W/sr; 0: it does not shine */
    uint32_t first, count; /* its sides */
    uint32_t facet_count;
    struct lw_emitter_facet facet[LW_EMITTER_CLUSTERS_FACETS_MAX]; /* for shadow rays */
    uint32_t triangle_count; /* its sides, if they are no more than facets; else 0 */
    struct lw_emitter_triangle triangle[LW_EMITTER_CLUSTERS_FACETS_MAX];
    struct lw_vec3 point[LW_EMITTER_CLUSTERS_POINTS],
        normal[LW_EMITTER_CLUSTERS_POINTS]; /* even over its power */
    float reach_m;                          /* from its centre: what stands within it is part of the map */
    /* intensity by direction, luminance, W/sr; values at the steps, edges included */
    float map[(LW_EMITTER_CLUSTERS_MAP + 1) * (LW_EMITTER_CLUSTERS_MAP + 1)];
    /* the same without what stands close */
    float open[(LW_EMITTER_CLUSTERS_MAP + 1) * (LW_EMITTER_CLUSTERS_MAP + 1)];
};

/** One shining side of an emitter. */
struct lw_emitter_side {
    uint32_t emitter;
    bool flipped;     /* the back of a double-sided one */
    float cumulative; /* power of the sides of its facet up to this one */
};

struct lw_emitter_clusters {
    const struct lw_lights *lights;
    struct lw_emitter_cluster *cluster;
    struct lw_emitter_side *side;
    uint32_t count;
};

/** Finds the clusters of emitters.
 * lights  must outlive it, and stand at the pose at which things are side by side
 * Errors: LW_NO_MEMORY */
LW_MUST_CHECK enum lw_status lw_emitter_clusters_init(struct lw_emitter_clusters *clusters,
                                                      const struct lw_lights *lights);
/** A zeroed one is fine. */
void lw_emitter_clusters_finish(struct lw_emitter_clusters *clusters);

/** Takes over where the lights of one cluster are now, and what stands close to it. [any] for different
 * clusters */
void lw_emitter_clusters_place(struct lw_emitter_clusters *clusters, uint32_t cluster,
                               const struct lw_trace *trace);

/** E of sixteen points, luminance, W/m^2, if nothing is in the way of shadow rays; times the cluster's
 * colour it is E. Finite. */
void lw_emitter_clusters_light16(const struct lw_emitter_cluster *cluster, const struct lw_points16 *points,
                                 float out[16]);

/** Cumulative shares of a cluster's points in its light from afar in a direction: points that face it count
 * by their cosine.
 * from        a point in that direction, world space
 * out_share   LW_EMITTER_CLUSTERS_POINTS ascending sums, the last 1; all 0: none of them faces it */
void lw_emitter_clusters_share(const struct lw_emitter_cluster *cluster, struct lw_vec3 from,
                               float out_share[LW_EMITTER_CLUSTERS_POINTS]);

/** A shadow ray from a point to a place on the cluster. Its parts are chosen by their light at the point; (u,
 * v) in [0, 1).
 * share    for the point's direction, or one close by
 * out_way  from the point to that place, world space, m
 * out_end  where the ray ends, as a share of that
 * False: nothing of it shines on the point. */
bool lw_emitter_clusters_aim(const struct lw_emitter_clusters *clusters,
                             const struct lw_emitter_cluster *cluster,
                             const float share[LW_EMITTER_CLUSTERS_POINTS], struct lw_vec3 point,
                             struct lw_vec3 normal, float u, float v, struct lw_vec3 *out_way,
                             float *out_end);

#endif
