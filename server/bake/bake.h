/* bake.h: the solve of a bake: frames until every texel reaches the target, with progress, a time limit and a
 * checkpoint.
 * Flow:    scene, pose, solver -> [bake: frames] -> solver with the light -> maps
 * Threads: main() only; the solver runs its own workers. */
#ifndef LW_BAKE_BAKE_H
#define LW_BAKE_BAKE_H

#include "server/solve/solver.h"

struct lw_bake_desc {
    struct lw_solver *solver; /* with one sample of each kind per frame, and the target in its desc */
    const struct lw_atlas_map *atlas_map;
    const struct lw_pose *pose;
    uint32_t samples;         /* the target, as the solver's frames_max; 0: the error decides */
    float error;              /* its target_error */
    double limit_s;           /* stop after this time; 0: no limit */
    const char *state_path;   /* the checkpoint's; NULL: none */
    const char *tiles_path;   /* the finished tiles' (tile_by_tile.h); NULL: none */
    double state_interval_s;  /* 0: at the end only */
    uint8_t key[16];          /* the checkpoint's */
    const _Atomic bool *stop; /* may be NULL; once true, the frame under way is the last */
};

struct lw_bake_result {
    uint64_t frames, rays; /* frames: those of earlier runs included */
    double seconds;
    uint32_t tiles, tiles_open; /* total; short of the target */
    bool stopped, limited;      /* by the signal; by the time limit */
};

/** Loads the checkpoint of an earlier run. *out_frames is 0 without one.
 * Errors: as the solver's load(). */
LW_MUST_CHECK enum lw_status lw_bake_resume(const struct lw_bake_desc *desc, uint64_t *out_frames,
                                            struct lw_error *err);

/** Solves frames until all tiles have converged, the time limit is reached or *stop is set. Then saves a
 * checkpoint, so that no work is lost if the maps cannot be written. A checkpoint that cannot be saved is a
 * warning: the bake goes on. frames: from lw_bake_resume(). Errors: the solver's. */
LW_MUST_CHECK enum lw_status lw_bake_run(const struct lw_bake_desc *desc, uint64_t frames,
                                         struct lw_bake_result *out_result, struct lw_error *err);

/** Removes the checkpoint, and the finished tiles, when they are no longer needed. */
void lw_bake_forget(const struct lw_bake_desc *desc);

#endif
