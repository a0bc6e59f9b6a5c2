/* light_tree.h: chooses among many lights by what they may give to a point, in the logarithm of their number.
 * Flow:    lights, as boxes with a power and a cone they shine into -> [tree] -> a light for a point, and its probability
 * Threads: create and refit by one thread; choosing [any] in between.
 * After:   Conty Estevez and Kulla, Importance Sampling of Many Lights with Adaptive Tree Splitting, 2018. */
#ifndef LW_COMMON_LIGHT_TREE_H
#define LW_COMMON_LIGHT_TREE_H

#include "common/status.h"
#include "common/vec.h"

#include <stdint.h>

/** What a light, or a group of them, is to points around it. */
struct lw_light_bounds {
    struct lw_vec3 low, high; /* m */
    struct lw_vec3 axis;      /* unit: middle of the directions that its surfaces face */
    float spread, reach;      /* rad: how far those are off the axis; how far off them it shines */
    float power;              /* W/sr; 0: it does not shine, and the rest says nothing */
};

struct lw_light_tree {
    struct lw_light_node *node; /* 2 count - 1, parents before their children */
    uint32_t *leaf;             /* of each light */
    uint32_t count;
};

/** Builds over count > 0 lights; they stay together when they move. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_light_tree_init(struct lw_light_tree *tree,
                                                const struct lw_light_bounds *light, uint32_t count);
void lw_light_tree_finish(struct lw_light_tree *tree);
/** The same lights, moved. */
void lw_light_tree_refit(struct lw_light_tree *tree, const struct lw_light_bounds *light);

/** What all lights together may give to a point, roughly, W/m^2; 0: nothing. */
float lw_light_tree_promise(const struct lw_light_tree *tree, struct lw_vec3 point_ws,
                            struct lw_vec3 normal_ws);

/** A light for a point of a surface, by pick in [0, 1); and its probability. UINT32_MAX: none. */
uint32_t lw_light_tree_choose(const struct lw_light_tree *tree, struct lw_vec3 point_ws,
                              struct lw_vec3 normal_ws, float pick, float *out_probability);
/** The probability with which a light is chosen. */
float lw_light_tree_probability(const struct lw_light_tree *tree, struct lw_vec3 point_ws,
                                struct lw_vec3 normal_ws, uint32_t light);

#endif
