/* scene_motion.h: which of a scene's movers move: to measure what a still scene, a moving light or a moving object costs.
 * Flow:    scene -> [scene_motion: channels kept, dropped, made] -> scene
 * Threads: while the scene is being built. */
#ifndef LW_COMMON_SCENE_MOTION_H
#define LW_COMMON_SCENE_MOTION_H

#include "common/scene/scene.h"

enum lw_scene_motion {
    LW_SCENE_MOTION_STATIC, /* nothing */
    LW_SCENE_MOTION_LIGHT,  /* what carries a light or an emissive surface */
    LW_SCENE_MOTION_OBJECT, /* objects that carry none */
    LW_SCENE_MOTION_ALL     /* both */
};

/** What was done, for people. */
struct lw_scene_motion_report {
    uint32_t kept, dropped; /* channels */
    const char *light;  /* name of the light or lamp that was set moving because none did; NULL: none was */
    const char *object; /* likewise of the object */
};

/** Drops the animation that does not belong to a motion; cameras keep theirs, and so does the animation's length. Where
 * the scene has none that belongs to it, one mover is made, in a loop of some 4 s:
 *  - a light: the strongest point or spot light, or else an emissive object, goes round a circle of 5 % of the scene's
 *    longest side, less (down to 0.5 %) where a point or spot would come nearer to a surface than a tenth of its radius; where there is neither, the strongest directional light swings by 5 degrees to either side;
 *  - an object: of those that measure at most half the scene's longest side the one with the largest surface turns
 *    about its vertical axis.
 * Errors: LW_BAD_DATA where nothing of the scene can; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_scene_motion_set(struct lw_scene *scene, enum lw_scene_motion motion,
                                                 struct lw_scene_motion_report *out_report,
                                                 struct lw_error *err);

#endif
