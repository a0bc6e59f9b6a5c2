/* cell_data.h: the state of a cell solver, in four parts: place, light, plan, shown.
 * Threads: those of solver.h. */
#ifndef LW_SOLVE_CELL_DATA_H
#define LW_SOLVE_CELL_DATA_H

#include "common/base/progress.h"
#include "common/light/client_lights.h"
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
    struct lw_geometry own_geometry; /* used unless layers share one */
    struct lw_cells cells;
    struct lw_tiles tiles;
    struct lw_pose pose;    /* the newest */
    unsigned pose_due;      /* LW_POSE_*: changes of pose that rays, lights and tiles have not taken over */
    bool view_due;          /* they have not taken over which objects are hidden */
    uint32_t texel_changes; /* lw_geometry.changes that the tiles have taken over */

    /* -- light -- */
    struct lw_lights lights; /* without client lights */
    struct lw_lights drawn;  /* client lights; zeroed where there are none */
    struct lw_probes probes;
    bool has_probes;
    uint32_t *ray_hit;       /* desc.indirect_samples words a texel (transport.h) */
    uint16_t *ray_direction; /* the same; NULL: without directions */
    uint16_t *ray_gloss;     /* the same; NULL: without directions, or without finishes */
    struct lw_reflectors reflectors;
    struct lw_reflected *reflected;
    uint16_t *reflected_direction; /* NULL: without directions */
    /* Cost of the last listing of reflectors; of rays and sums since then. Wall time in ns, or work units
     * under a budget of units. listing is 0 when a listing is due. */
    uint64_t listing, since_listing;
    uint32_t frames;      /* frames that solved something */
    bool lacks_estimates; /* the tiles' last estimates are lost: a checkpoint does not keep them */

    /* -- plan -- */
    struct lw_interest_set interest;
    struct lw_motion motion;
    struct lw_plan_memory memory;
    struct lw_plan plan;
    struct lw_plan_log *plan_log;  /* NULL: no log */
    struct lw_plan_fact *fact;     /* per tile, in the order of tiles.tile at the last plan */
    bool *contributes, *corrected; /* per lw_tile_id, in this frame */
    lw_tile_id *due;               /* tiles that the last plan solves; this rank's own come first */
    uint32_t due_count, own_count;
    lw_tile_id *exchanged; /* scratch: ids that ranks exchange */
    struct lw_cell_layer_turn turn;
    struct lw_budget_rates rates;
    struct lw_work work;
    struct lw_progress progress;

    /* -- shown -- */
    struct lw_shown shown;
};

static inline struct lw_converged lw_cell_data_converged(const struct lw_cell_solver *s) {
    return (struct lw_converged){.target_error = s->desc.target_error, .frames_max = s->desc.frames_max};
}

/** Whether the tiles keep the light of client lights apart. */
static inline bool lw_cell_data_parts_drawn(const struct lw_cell_solver *s) {
    return lw_client_lights_any(s->desc.client_lights);
}

#endif
