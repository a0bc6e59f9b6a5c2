#include "server/solve/memory_forecast.h"

#include "common/light/client_lights.h"
#include "server/solve/coarse_scene.h"
#include "server/solve/state/tiles.h"

#include <unistd.h>

/* Bytes of a texel beside the planes of its light: places, sample points, rays, pairs of the filter, the
 * reflectors' light; as measured (docs/lab/big_scenes.md). */
#define TEXEL_BYTES 200u

uint64_t lw_memory_forecast_texel(const struct lw_solver_desc *desc) {
    const bool parts = lw_client_lights_any(desc->client_lights);
    return lw_tiles_texel_bytes(desc->bounces, parts, desc->directions) + TEXEL_BYTES;
}

uint64_t lw_memory_forecast_whole(const struct lw_solver_desc *desc) {
    return lw_coarse_scene_count_texels(desc->scene) * lw_memory_forecast_texel(desc);
}

uint64_t lw_memory_forecast_coarse(const struct lw_solver_desc *desc) {
    return lw_memory_forecast_whole(desc) / (LW_COARSE_SCENE_SIDE * LW_COARSE_SCENE_SIDE);
}

uint64_t lw_memory_forecast_machine(void) {
    return (uint64_t)sysconf(_SC_PHYS_PAGES) * (uint64_t)sysconf(_SC_PAGESIZE);
}
