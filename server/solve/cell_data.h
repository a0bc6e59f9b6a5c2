/* cell_data.h: what a cell solver holds: place, light, plan, and what is shown.
 * Threads: those of solver.h. */
#ifndef LW_SOLVE_CELL_DATA_H
#define LW_SOLVE_CELL_DATA_H

#include "common/light/client_lights.h"
#include "common/progress.h"
#include "server/solve/adapt/converged.h"
#include "server/solve/adapt/interest_set.h"
#include "server/solve/adapt/motion.h"
#include "server/solve/adapt/plan_log.h"
#include "server/solve/adapt/ranks.h"
#include "server/solve/adapt/work.h"
#include "server/solve/cell_layer.h"
#include "server/solve/shown.h"

struct lw_cell_solver {
    struct lw_solver base;
    struct lw_solver_desc desc;
    int threads;

    /* -- place -- */
    struct lw_geometry *geometry;
    /* Unless it is shared. */
    struct lw_geometry own_geometry;
    struct lw_cells cells;
    struct lw_tiles tiles;
    /* The last one given. */
    struct lw_pose pose;
    /* What of it has changed since rays, lights and tiles were last placed: LW_POSE_*. */
    unsigned pose_due;
    /* Other objects are hidden than when rays, lights and tiles were last placed. */
    bool view_due;
    uint32_t texel_changes; /* of the geometry, that the tiles know */

    /* -- light -- */
    /* Without client lights; and those, zeroed where there are none. */
    struct lw_lights lights, drawn;
    struct lw_probes probes;
    bool has_probes;
    /* Ray hits: of each texel, indirect_samples words (transport.h). */
    uint32_t *ray_hit;
    struct lw_reflectors reflectors;
    struct lw_reflected *reflected;
    /* Wall time, or work under a budget of units: that listing reflectors took last, 0 if it is due; that
     * rays and sums have taken since. */
    uint64_t listing, since_listing;
    /* That solved something. */
    uint32_t frames;
    /* The tiles' estimates are not those of their last solve: a checkpoint keeps none. */
    bool forgetful;

    /* -- plan -- */
    struct lw_interest_set interest;
    struct lw_motion motion;
    struct lw_plan_memory memory;
    struct lw_plan plan;
    struct lw_plan_log *plan_log;  /* NULL: none is written */
    struct lw_plan_fact *fact;     /* per tile, in the order of tiles.tile as of the last plan */
    bool *contributes, *corrected; /* per lw_tile_id, in this frame */
    /* Tiles that the frame under way, or the last one, solves; first those that this rank owns. */
    lw_tile_id *due;
    uint32_t due_count, own_count;
    lw_tile_id *exchanged; /* scratch: of a list of the plan */
    struct lw_cell_layer_turn turn;
    struct lw_budget_rates rates;
    struct lw_work work;
    struct lw_progress progress;

    struct lw_shown shown;
};

static inline struct lw_converged lw_cell_data_converged(const struct lw_cell_solver *s) {
    return (struct lw_converged){.target_error = s->desc.target_error, .frames_max = s->desc.frames_max};
}

/** Whether light of client lights is kept apart. */
static inline bool lw_cell_data_parts_drawn(const struct lw_cell_solver *s) {
    return lw_client_lights_any(s->desc.client_lights);
}

#endif
