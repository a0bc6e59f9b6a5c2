/* light_groups.h: which lights share a layer of light.
 * Flow:    scene, names -> [light_groups] -> layers
 * Threads: built once; then [any].
 *
 * Lights are the punctual ones, materials that emit (all surfaces that have them), and the sky. A scene's own
 * choice: what its animation moves gets layers, the rest is the first one's. */
#ifndef LW_SOLVE_LIGHT_GROUPS_H
#define LW_SOLVE_LIGHT_GROUPS_H

#include "common/scene/pose.h"

/* Each layer has light of its own for every texel, and rays of its own to find it. */
#define LW_LIGHT_GROUPS_MAX 4u

struct lw_light_groups {
    uint32_t count;    /* >= 1 */
    uint8_t *light;    /* per light: its group */
    uint8_t *material; /* per material */
    uint8_t sky;       /* the sky's, and the environment's */
};

/** names: groups apart by ';', and lights, materials and "sky" of a group, by name, apart by ','. "none":
 * there is but one group. NULL: as the scene's animation has it. Anything not named is in the first group;
 * if none of it shines, it is in the group of the first names.
 * Errors: LW_USAGE naming what the scene does not have, or more than
 *         LW_LIGHT_GROUPS_MAX - 1; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_light_groups_init(struct lw_light_groups *groups,
                                                  const struct lw_scene *scene, const struct lw_pose *pose,
                                                  const char *names, struct lw_error *err);
/** Copies groups of a scene. Errors: LW_NO_MEMORY; the copy is then empty. */
LW_MUST_CHECK enum lw_status lw_light_groups_copy(struct lw_light_groups *copy,
                                                  const struct lw_light_groups *groups,
                                                  const struct lw_scene *scene);
/** Zeroed ones are fine. */
void lw_light_groups_finish(struct lw_light_groups *groups);

#endif
