/* patch_solver.h: what solvers have in common whose frame lights all texels, as patches: the order of a
 * frame, means over frames, the shown light, the state. How light gets from texel to texel is a method's.
 * Flow:    scene, pose -> [direct light -> method: bounces -> means -> shown light] -> tiles -> publish
 * Threads: those of solver.h.
 *
 * A frame is an estimate of all light. Frames are averaged. Another pose begins another mean. Such solvers
 * know no interest, no light groups and no tracing range. */
#ifndef LW_SOLVE_PATCH_SOLVER_H
#define LW_SOLVE_PATCH_SOLVER_H

#include "common/base/progress.h"
#include "server/solve/radiosity/patches.h"
#include "server/solve/shown.h"
#include "server/solve/solver.h"
#include "server/solve/state/checkpoint.h"

#define LW_PATCH_SOLVER_PARTS_MAX 4u /* parts of a method, at most */

struct lw_patch_solver;

/** What is a solver's own. */
struct lw_patch_solver_method {
    const char *name;
    uint32_t direct_samples; /* samples of the direct pass in a frame */
    uint32_t frames_min;     /* before an error counts as known */
    /** Whether emissive surfaces enter by bounces() alone: the direct pass samples none of them then.
     * NULL: they never do. */
    bool (*surfaces_shoot)(const struct lw_patch_solver *s);
    /** Steps of the progress that a frame makes. */
    uint64_t (*steps)(const struct lw_patch_solver *s);
    /** Sets up what is the method's own, when all else is there. Errors: any; finish() follows. */
    enum lw_status (*init)(struct lw_patch_solver *s, struct lw_error *err);
    void (*finish)(struct lw_patch_solver *s);
    /** Another pose is about to be taken. May be NULL. */
    void (*leave)(struct lw_patch_solver *s, const struct lw_pose *next);
    /** Before the light of a frame: patches and what else has a place. Errors: any. */
    enum lw_status (*place)(struct lw_patch_solver *s, struct lw_error *err);
    /** Sets the frame's estimate of all bounces, frame_bounces, from frame_direct, and adds what
     * surfaces send to that. Returns rays. */
    uint64_t (*bounces)(struct lw_patch_solver *s);
    /** After a frame that was not cancelled. May be NULL. */
    void (*keep)(struct lw_patch_solver *s, uint64_t rays);
    /** What of its state the next frame depends on (checkpoint.h): LW_PATCH_SOLVER_PARTS_MAX at most. Returns
     * how many. May be NULL. */
    uint32_t (*list_parts)(const struct lw_patch_solver *s, struct lw_checkpoint_part *out_part);
    size_t (*memory_bytes)(const struct lw_patch_solver *s);
};

struct lw_patch_solver {
    struct lw_solver base;
    struct lw_solver_ops ops;
    const struct lw_patch_solver_method *method;
    struct lw_solver_desc desc;
    int threads;
    struct lw_geometry geometry;
    struct lw_cells cells;
    /* One order of bounces: all of them together. Its radiance is not used. */
    struct lw_tiles tiles;
    uint32_t texel_changes; /* the geometry's changes that the tiles know */
    struct lw_shown shown;
    /* emitters: all lights, for their surfaces; lights, drawn: what the direct pass samples. */
    struct lw_lights emitters, lights, drawn;
    uint8_t *no_light, *no_material; /* for a scene without client lights; one value for every material */
    struct lw_patches patches;
    float *frame_direct[3], *frame_drawn[3], *frame_bounces[3]; /* E of this frame */
    float *arrived[3];                                          /* E of the pass under way */
    struct lw_pose pose;
    bool placed;
    struct lw_progress progress;
    uint32_t frames; /* whole ones, since the light last changed */
};

/** Builds a solver in zeroed memory of malloc() that begins with a lw_patch_solver, and which is freed where
 * this fails. Errors: as lw_solvers_entry.create(). */
LW_MUST_CHECK enum lw_status lw_patch_solver_create(struct lw_patch_solver *s,
                                                    const struct lw_patch_solver_method *method,
                                                    const struct lw_solver_desc *desc,
                                                    const struct lw_pose *pose, struct lw_solver **out_solver,
                                                    struct lw_error *err);

/** Adds planes of all texels. */
void lw_patch_solver_add(const struct lw_patch_solver *s, float *const dst[3], float *const src[3]);

/** What each texel reflects of E: 3 floats a texel, W/(m^2 sr). */
void lw_patch_solver_reflect(struct lw_patch_solver *s, float *const e[3], float *out_radiance);

/** Once true, a frame under way is thrown away. */
bool lw_patch_solver_cancelled(const struct lw_patch_solver *s);

#endif
