/* memory_forecast.h: how much memory the light of texels takes, before anything is made.
 * Flow:    scene, desc -> [memory_forecast] -> the choice of a solver, by --memory
 * Threads: [any]: pure functions. */
#ifndef LW_SOLVE_MEMORY_FORECAST_H
#define LW_SOLVE_MEMORY_FORECAST_H

#include "server/solve/solver.h"

/** Bytes that a solver takes for a texel with its places, sample points and light, roughly; without the rays'
 * structure. desc: read are client_lights, bounces and directions. layers: of light (light_layers.h) */
uint64_t lw_memory_forecast_texel(const struct lw_solver_desc *desc, uint32_t layers);

/** The same for all texels and tiles of desc.scene, and of its coarse scene (coarse_scene.h). */
uint64_t lw_memory_forecast_whole(const struct lw_solver_desc *desc, uint32_t layers);
uint64_t lw_memory_forecast_coarse(const struct lw_solver_desc *desc, uint32_t layers);

/** Bytes of this machine's memory. */
uint64_t lw_memory_forecast_machine(void);

/** Says that --memory, of `memory` bytes, is less than the texels of desc->scene need.
 * how     goes behind the number of MB, such as " even tile by tile"; may be empty
 * advice  what to set, as for printf()
 * Returns LW_NO_MEMORY. */
enum lw_status lw_memory_forecast_refuse(struct lw_error *err, const struct lw_solver_desc *desc,
                                         uint64_t needed, const char *how, uint64_t memory,
                                         const char *advice, ...) __attribute__((format(printf, 6, 7)));

#endif
