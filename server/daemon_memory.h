/* daemon_memory.h: how much light a daemon holds at a time, by --memory.
 * Flow:    scene, settings -> [daemon_memory] -> the choice of a solver, its tiles of finer levels
 * Threads: [any]; one call after another. */
#ifndef LW_DAEMON_MEMORY_H
#define LW_DAEMON_MEMORY_H

#include "server/daemon_settings.h"
#include "server/solve/solver.h"

struct lw_daemon_memory {
    bool is_sparse;      /* level 0 is there where somebody looks (sparse_solver.h) */
    uint32_t fine_tiles; /* at a time: those of finer levels, and of level 0 where that is sparse */
    /* By the forecast: light that is always there, a tile of a finer level, and the most for both. */
    uint64_t base_bytes, tile_bytes, limit_bytes;
};

/** Chooses, and says so in a line where level 0 is sparse.
 * desc    of the solver of all texels: read are scene, client_lights, bounces and directions
 * layers  of light (light_groups.h)
 * Errors  LW_NO_MEMORY with the MB needed */
LW_MUST_CHECK enum lw_status lw_daemon_memory_choose(const struct lw_daemon_settings *settings,
                                                     const struct lw_solver_desc *desc, uint32_t layers,
                                                     struct lw_daemon_memory *out_memory,
                                                     struct lw_error *err);

#endif
