/* motion.h: the objects that moved, how often, and where.
 * Flow:    poses of two frames -> [motion] -> distances of tiles, the plan's questions
 * Threads: [solver] */
#ifndef LW_ADAPT_MOTION_H
#define LW_ADAPT_MOTION_H

#include "common/scene/pose.h"
#include "server/solve/state/tiles.h"

/* A movement after this many frames without one is an onset. */
#define LW_MOTION_STILL_FRAMES 4u
/* Places on moved objects, at most; more would only order better. */
#define LW_MOTION_PLACES_MAX 32u

struct lw_motion {
    /* Frames in which something moved, so far; the count at the last onset, and when lights last moved. */
    uint32_t moves, began, light_moves;
    uint32_t frames_since_move;
    bool shone; /* at the last onset lights moved, or changed */
    /* Where something last moved from, and to. */
    struct lw_vec3 place_ws[LW_MOTION_PLACES_MAX];
    uint32_t place_count;
    bool *moved; /* per object: it has, in the last movement */
};

/** Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_motion_init(struct lw_motion *motion, uint32_t objects);
/** A zeroed one is fine. */
void lw_motion_finish(struct lw_motion *motion);

/** Something has moved: the tiles are still at pose `was`. shines: lights differ (lw_lights_differ()). */
void lw_motion_note(struct lw_motion *motion, const struct lw_tiles *tiles, const struct lw_scene *scene,
                    const struct lw_pose *was, const struct lw_pose *is, bool shines);

/** How far a tile is from what moved last, m; -1: it moved itself. */
float lw_motion_distance(const struct lw_motion *motion, const struct lw_solve_tile *tile);

#endif
