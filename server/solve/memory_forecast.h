/* memory_forecast.h: how much memory the light of texels takes, before anything is made.
 * Flow:    scene, desc -> [memory_forecast] -> the choice of a solver, by --memory
 * Threads: [any]: pure functions. */
#ifndef LW_SOLVE_MEMORY_FORECAST_H
#define LW_SOLVE_MEMORY_FORECAST_H

#include "server/solve/solver.h"

/** Bytes that a solver takes for a texel with its places, sample points and light, roughly; without the rays'
 * structure. desc: read are client_lights, bounces and directions */
uint64_t lw_memory_forecast_texel(const struct lw_solver_desc *desc);

/** The same for all texels of a scene, and of its coarse scene (coarse_scene.h). desc: also scene */
uint64_t lw_memory_forecast_whole(const struct lw_solver_desc *desc);
uint64_t lw_memory_forecast_coarse(const struct lw_solver_desc *desc);

/** Bytes of this machine's memory. */
uint64_t lw_memory_forecast_machine(void);

#endif
