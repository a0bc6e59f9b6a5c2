/* pose.h: the scene at one moment: where objects, lights and cameras are.
 * Flow:    scene, time -> [pose] -> trace, solve, frame messages
 * Threads: a pose belongs to one thread at a time. */
#ifndef LW_COMMON_POSE_H
#define LW_COMMON_POSE_H

#include "common/scene/scene.h"

/** A punctual light in world space. */
struct lw_light_state {
    struct lw_vec3 position_ws;  /* m; unused for directional */
    struct lw_vec3 direction_ws; /* unit; where it shines; unused for point */
    struct lw_vec3 intensity;
};

struct lw_pose_local;

struct lw_pose {
    double time_s;                     /* wrapped */
    struct lw_affine *object_to_world; /* one per object */
    struct lw_light_state *light;      /* one per light */
    struct lw_affine *node_to_world;   /* one per node */
    struct lw_pose_local *local;       /* one per node; scratch of lw_pose_evaluate() */
    bool *node_moves;                  /* one per node: it or an ancestor has a channel */
};

/** Allocates for a scene and evaluates time 0. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_pose_init(struct lw_pose *pose, const struct lw_scene *scene);
void lw_pose_finish(struct lw_pose *pose);

/** Moves the pose to a time (s, wrapped into the animation's duration). */
void lw_pose_evaluate(struct lw_pose *pose, const struct lw_scene *scene, double time_s);

/** Whether an object can ever move: its node or an ancestor of it has a channel. */
bool lw_pose_object_moves(const struct lw_pose *pose, const struct lw_scene *scene, uint32_t object);

/** World-space bounds of all objects; false if there is no vertex. */
bool lw_pose_bounds(const struct lw_pose *pose, const struct lw_scene *scene, struct lw_vec3 *out_min,
                    struct lw_vec3 *out_max);

#endif
