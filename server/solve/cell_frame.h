/* cell_frame.h: a frame of the cell solver: a list of stages.
 * Flow:    pose -> [take pose, verify, choose, solve bounce by bounce, show, settle] -> tiles
 * Threads: one thread calls; each stage runs its own workers.
 *
 * Every frame runs the same list (the table in cell_frame.c). Stages that solve are
 * left out where nothing is due. */
#ifndef LW_SOLVE_CELL_FRAME_H
#define LW_SOLVE_CELL_FRAME_H

#include "common/light/client_lights.h"
#include "common/progress.h"
#include "server/solve/adapt/scheduler.h"
#include "server/solve/cell_layer.h"
#include "server/solve/filter/denoise.h"

struct lw_cell_solver {
    struct lw_solver base;
    struct lw_solver_desc desc;
    int threads;
    struct lw_geometry *geometry;
    /* Unless it is shared. */
    struct lw_geometry own_geometry;
    struct lw_cells cells;
    struct lw_tiles tiles;
    /* Tiles that the frame under way, or the last one, solves. By id: a movement reorders tiles.tile. */
    lw_tile_id *due;
    uint32_t due_count;
    /* SPLIT: only with client lights. */
    struct lw_seams_light welds[LW_LIGHT_FORM_COUNT];
    /* That are shown (light_form.h). */
    unsigned forms;
    /* One of them is new: the next frame shows everything. */
    bool shows_all;
    /* Of the geometry: those that the welds are of. */
    uint32_t seams_found;
    uint32_t texel_changes; /* of the geometry, that the tiles know */
    /* Without client lights; and those, zeroed where there are none. */
    struct lw_lights lights, drawn;
    struct lw_probes probes;
    bool has_probes;
    /* Empty unless the desc asks for it. */
    struct lw_denoise denoise;
    /* Ray hits: of each texel, indirect_samples words (transport.h). */
    uint32_t *ray_hit;
    struct lw_reflectors reflectors;
    /* Wall time, or work under a budget of units: that listing them took last, 0 if it is due; that rays and
     * sums have taken since. */
    uint64_t listing, since_listing;
    struct lw_reflected *reflected;
    /* The last one given. */
    struct lw_pose pose;
    struct lw_progress progress;
    struct lw_scheduler scheduler;
    /* That solved something. */
    uint32_t frames;
    struct lw_budget_rates rates;
    struct lw_cell_layer_turn turn;
    /* The tiles' estimates are not those of their last solve: a checkpoint keeps none. */
    bool forgetful;
    /* What of the pose has changed since rays, lights and tiles were last placed: LW_POSE_*. */
    unsigned pose_due;
    /* Likewise: which objects are hidden. */
    bool view_due;
};

/** Runs a frame; as lw_solver_ops.frame(). */
LW_MUST_CHECK enum lw_status lw_cell_frame_run(struct lw_cell_solver *s, const struct lw_pose *pose,
                                               uint64_t number, struct lw_solver_stats *out_stats,
                                               struct lw_error *err);

/** Makes the light of frame `number` agree over seams, and fills gutters. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_cell_frame_weld(struct lw_cell_solver *s, uint64_t number,
                                                struct lw_error *err);

/** Finds seams, unless they are those of the geometry as it is. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_cell_frame_find_seams(struct lw_cell_solver *s);

/** Sets what all tiles send out, from their sums. */
void lw_cell_frame_radiate_all(struct lw_cell_solver *s);

/** What passes of this solver work on. */
struct lw_transport lw_cell_frame_transport(struct lw_cell_solver *s);

static inline struct lw_converged lw_cell_frame_converged(const struct lw_cell_solver *s) {
    return (struct lw_converged){.target_error = s->desc.target_error, .frames_max = s->desc.frames_max};
}

/** Whether light of client lights is kept apart. */
static inline bool lw_cell_frame_parts_drawn(const struct lw_cell_solver *s) {
    return lw_client_lights_any(s->desc.client_lights);
}

#endif
