/* light_tree.h: chooses one of many lights by a bound on its contribution to a point. Cost: the logarithm of
 * the number of lights.
 * Flow:    lights, as boxes with a power and a cone they shine into -> [tree] -> a light for a point, and its
 *          probability
 * Threads: create and refit by one thread; choosing [any] in between.
 * After:   Conty Estevez and Kulla, Importance Sampling of Many Lights with Adaptive Tree Splitting, 2018. */
#ifndef LW_COMMON_LIGHT_TREE_H
#define LW_COMMON_LIGHT_TREE_H

#include "common/base/status.h"
#include "common/base/vec.h"

#include <stdint.h>

#define LW_LIGHT_TREE_GROUPS_MAX 64u /* the most groups of lw_light_tree_split() */
#define LW_LIGHT_TREE_DEPTH_MAX  64u /* from the root down to a light */

/** Bounds of a light, or of a group of lights. */
struct lw_light_bounds {
    struct lw_vec3 low, high; /* m */
    struct lw_vec3 axis;      /* unit: middle of the directions that its surfaces face */
    float spread, reach;      /* rad: largest angle of a normal with the axis; of a ray with a normal */
    float power;              /* W/sr; 0: it emits nothing, and the other fields are undefined */
};

struct lw_light_tree {
    struct lw_light_node *node;     /* 2 count - 1, parents before their children */
    struct lw_light_bounds *bounds; /* per node */
    uint32_t *leaf;                 /* per light */
    uint32_t count;
};

/** Builds the tree over count > 0 lights. Its groups stay the same when lights move.
 * first_count  the first first_count lights are a group of their own: node 1 if there are other lights, else
 *              node 0
 * Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_light_tree_init(struct lw_light_tree *tree,
                                                const struct lw_light_bounds *light, uint32_t count,
                                                uint32_t first_count);
void lw_light_tree_finish(struct lw_light_tree *tree);
/** The same lights, moved. */
void lw_light_tree_refit(struct lw_light_tree *tree, const struct lw_light_bounds *light);

/** A part of a surface: points within a ball, with normals within a cone. */
struct lw_light_region {
    struct lw_vec3 centre_ws, normal_ws; /* unit: the cone's axis */
    float radius_m, cos_spread;          /* the cone's: 1 where all normals are the axis */
};

/** A group of lights: a node of the tree, 0: all. */
struct lw_light_group {
    uint32_t node;
    float promise; /* about what it may give to a region, W/m^2; > 0 */
};

/** Splits a group into at most `most` smaller ones for a region. The group that promises most is split first:
 * far and weak lights stay together, near and strong ones get groups of their own. A light in none of them
 * lights no point of the region. Greedy, as the cuts of Walter et al., Lightcuts, 2005.
 * out_group  `most` of them, 1 to LW_LIGHT_TREE_GROUPS_MAX
 * Returns    how many there are */
uint32_t lw_light_tree_split(const struct lw_light_tree *tree, uint32_t node,
                             const struct lw_light_region *region, uint32_t most,
                             struct lw_light_group *out_group);

/** A group that stands for others. */
struct lw_light_group_sample {
    uint32_t node;
    float probability; /* with which it is sampled: its light is divided by this */
    float pick;        /* even in [0, 1), for a choice within the group */
    uint32_t number;   /* the sample's, 0 to most - 1; a group mostly keeps it */
};

/** Samples at most `most` of some groups, each once at most, with probabilities in proportion to their
 * promises: a systematic sample (Madow 1949).
 * count        LW_LIGHT_TREE_GROUPS_MAX at most
 * pick         in [0, 1)
 * out_sampled  `most` of them
 * Returns      how many there are */
uint32_t lw_light_tree_sample(const struct lw_light_group *group, uint32_t count, uint32_t most, float pick,
                              struct lw_light_group_sample *out_sampled);

/** Estimate of the irradiance of all lights together at a point, W/m^2; 0: none reaches it. */
float lw_light_tree_promise(const struct lw_light_tree *tree, struct lw_vec3 point_ws,
                            struct lw_vec3 normal_ws);

/** A light of a group (0: of all) for the points of a region, by pick in [0, 1); and its probability within
 * the group. UINT32_MAX: none. */
uint32_t lw_light_tree_choose(const struct lw_light_tree *tree, uint32_t group,
                              const struct lw_light_region *region, float pick, float *out_probability);
/** Whether a group is at least a region's radius away. Then one choice for the region is as good as a choice
 * for each point. */
bool lw_light_tree_is_far(const struct lw_light_tree *tree, uint32_t group,
                          const struct lw_light_region *region);
/** The probability with which a light is chosen. */
float lw_light_tree_probability(const struct lw_light_tree *tree, struct lw_vec3 point_ws,
                                struct lw_vec3 normal_ws, uint32_t light);

#endif
