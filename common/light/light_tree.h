/* light_tree.h: chooses among many lights by what they may give to a point, in the logarithm of their number.
 * Flow:    lights, as boxes with a power and a cone they shine into -> [tree] -> a light for a point, and its
 *          probability
 * Threads: create and refit by one thread; choosing [any] in between.
 * After:   Conty Estevez and Kulla, Importance Sampling of Many Lights with Adaptive Tree Splitting, 2018. */
#ifndef LW_COMMON_LIGHT_TREE_H
#define LW_COMMON_LIGHT_TREE_H

#include "common/status.h"
#include "common/vec.h"

#include <stdint.h>

#define LW_LIGHT_TREE_GROUPS_MAX 64u /* that lw_light_tree_split() can tell apart */

/** What a light, or a group of them, is to points around it. */
struct lw_light_bounds {
    struct lw_vec3 low, high; /* m */
    struct lw_vec3 axis;      /* unit: middle of the directions that its surfaces face */
    float spread, reach;      /* rad: how far those are off the axis; how far off them it shines */
    float power;              /* W/sr; 0: it does not shine, and the rest says nothing */
};

struct lw_light_tree {
    struct lw_light_node *node;     /* 2 count - 1, parents before their children */
    struct lw_light_bounds *bounds; /* of each node */
    uint32_t *leaf;                 /* of each light */
    uint32_t count;
};

/** Builds over count > 0 lights; they stay together when they move.
 * first_count  so many at the beginning are a group by themselves: 1, where there are others too; else 0, as
 *              all are
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
    float radius_m, cos_spread;          /* of the cone: 1 where all normals are the axis */
};

/** Splits a group (0: all) into at most `most` smaller ones for a region: what promises most is told apart
 * first, so that far and weak lights stay together, and near and strong ones are groups of their own. What
 * none of them holds lights no point of the region. Greedy by an upper bound, as the cuts of Walter et al.,
 * Lightcuts, 2005.
 * out_group  `most` of them, 1 to LW_LIGHT_TREE_GROUPS_MAX
 * Returns    how many there are */
uint32_t lw_light_tree_split(const struct lw_light_tree *tree, uint32_t group,
                             const struct lw_light_region *region, uint32_t most, uint32_t *out_group);

/** What all lights together may give to a point, roughly, W/m^2; 0: nothing. */
float lw_light_tree_promise(const struct lw_light_tree *tree, struct lw_vec3 point_ws,
                            struct lw_vec3 normal_ws);

/** A light of a group (0: of all) for the points of a region, by pick in [0, 1); and its probability within
 * the group. UINT32_MAX: none. */
uint32_t lw_light_tree_choose(const struct lw_light_tree *tree, uint32_t group,
                              const struct lw_light_region *region, float pick, float *out_probability);
/** Whether a group lies so far off, a region's radius at least, that one choice for the region is as good as
 * one for each of its points. */
bool lw_light_tree_is_far(const struct lw_light_tree *tree, uint32_t group,
                          const struct lw_light_region *region);
/** The probability with which a light is chosen. */
float lw_light_tree_probability(const struct lw_light_tree *tree, struct lw_vec3 point_ws,
                                struct lw_vec3 normal_ws, uint32_t light);

#endif
