/* scene_state.h: the current scene after updates: objects, lights, materials, sky and clock that differ from
 * the file.
 * Flow:    changes, in order -> [scene state] -> at a frame's beginning: the current scene and its pose ->
 *          solve, publish
 * Threads: one thread at a time; `scene` may be read between two changes. */
#ifndef LW_COMMON_SCENE_STATE_H
#define LW_COMMON_SCENE_STATE_H

#include "common/scene/pose.h"
#include "common/scene/scene_roster.h"

struct lw_scene_state_object;
struct lw_scene_state_light;

struct lw_scene_state {
    const struct lw_scene *original;
    struct lw_scene scene;         /* the original with the current materials and sky */
    struct lw_scene_roster roster; /* which objects there are */
    struct lw_scene_state_object *object;
    struct lw_scene_state_light *light;
    /* The animation is at anchor_scene_s when the clock (of the wall or of steps) is at anchor_s. */
    double anchor_s, anchor_scene_s, rate;
    bool paused;
    double start_scene_s; /* a reset goes back to this time, */
    bool start_paused;    /* paused or not */
};

/** Begins with the scene as it is, its animation at start_scene_s when the wall is at 0. original outlives
 * the state.
 * Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_scene_state_init(struct lw_scene_state *state,
                                                 const struct lw_scene *original, double start_scene_s,
                                                 bool paused);
/** A zeroed state is fine. */
void lw_scene_state_finish(struct lw_scene_state *state);

/** Makes one change, which lw_scene_change_check() and a roster with all earlier changes have accepted.
 * wall_s: the frame's clock, where the animation goes on. */
void lw_scene_state_change(struct lw_scene_state *state, const struct lw_scene_change *change, double wall_s);

/** The animation's time when the wall is at wall_s; not wrapped. */
double lw_scene_state_time(const struct lw_scene_state *state, double wall_s);

/** Evaluates a pose of state->scene at that moment, with all that was changed. An object that was ever moved
 * or hidden counts as one that moves from then on. */
void lw_scene_state_pose(const struct lw_scene_state *state, double wall_s, struct lw_pose *pose);

/** The change that sets the animation's clock to where it is at wall_s. */
struct lw_scene_change lw_scene_state_seek(const struct lw_scene_state *state, double wall_s);

/** Changes that make this state of the original scene: few, however many there were. A clock that was set
 * goes on from its time at wall_s; another one starts again. *out_change: the caller frees it.
 * Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_scene_state_changes(const struct lw_scene_state *state, double wall_s,
                                                    struct lw_scene_change **out_change, size_t *out_count);

#endif
