/* cell_light.h: lights the tiles that a frame solves, bounce by bounce.
 * Flow:    due tiles -> [direct, bounces, probes] -> sums and estimates of the frame
 * Threads: one thread calls; workers inside. Passes are barriers apart. */
#ifndef LW_SOLVE_CELL_LIGHT_H
#define LW_SOLVE_CELL_LIGHT_H

#include "server/solve/cell_data.h"

/* What a pass over the due tiles works on. */
struct lw_cell_light {
    struct lw_cell_solver *s;
    const struct lw_transport *transport;
    bool changing; /* light that others read may be changing */
    uint64_t began_ns;
    struct lw_solver_stats *stats; /* times and rays are added */
};

/** The tile of that index among the due ones. */
static inline struct lw_solve_tile *lw_cell_light_due(const struct lw_cell_solver *s, uint32_t i) {
    return lw_tiles_at(&s->tiles, s->due[i]);
}

/** Adds the time since the last call to a field of the stats. */
void lw_cell_light_charge(struct lw_cell_light *light, uint64_t *field_ns);

/** Lists reflectors for where something moves before anything is solved. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_cell_light_list_reflectors(struct lw_cell_solver *s, struct lw_error *err);

/** Lights the due tiles, whose blocks were weighed (lw_correct_due()). Errors: LW_NO_MEMORY; LW_CLOSED:
 * cancelled. */
LW_MUST_CHECK enum lw_status lw_cell_light_run(struct lw_cell_light *light, struct lw_error *err);

#endif
