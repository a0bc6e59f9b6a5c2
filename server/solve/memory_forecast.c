#include "server/solve/memory_forecast.h"

#include "common/light/client_lights.h"
#include "server/solve/coarse_scene.h"
#include "server/solve/state/tiles.h"

#include <stdarg.h>
#include <stdio.h>
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

enum lw_status lw_memory_forecast_refuse(struct lw_error *err, const struct lw_solver_desc *desc,
                                         uint64_t needed, const char *how, uint64_t memory,
                                         const char *advice, ...) {
    char text[200];
    va_list arguments;
    va_start(arguments, advice);
    vsnprintf(text, sizeof text, advice, arguments);
    va_end(arguments);
    return lw_status_fail(err, LW_NO_MEMORY, "%.2g M texels need %.0f MB%s, over %.0f (--memory): %s",
                          (double)lw_coarse_scene_count_texels(desc->scene) * 1e-6, (double)needed * 1e-6,
                          how, (double)memory * 1e-6, text);
}
