#include "server/solve/memory_forecast.h"

#include "common/light/client_lights.h"
#include "server/solve/coarse_scene.h"
#include "server/solve/state/tiles.h"

#include <stdarg.h>
#include <stdio.h>
#include <unistd.h>

/* Bytes that light takes, as measured (docs/lab/memory.md), for: */
#define TEXEL_BYTES 36u   /* a texel: its place, sample points and the like, where most texels are flat */
#define LAYER_BYTES 110u  /* a texel in each layer: rays, pairs of the filter; not the planes of light */
#define TILE_BYTES  3000u /* a tile: its blocks and packets, and what sessions remember of it */

uint64_t lw_memory_forecast_texel(const struct lw_solver_desc *desc, uint32_t layers) {
    const bool parts = lw_client_lights_any(desc->client_lights);
    return layers * (lw_tiles_texel_bytes(desc->bounces, parts, desc->directions) + LAYER_BYTES) +
           TEXEL_BYTES;
}

static uint64_t tile_bytes(const struct lw_scene *scene) {
    uint64_t tiles = 0;
    for (uint32_t o = 0; o < scene->object_count; o++) {
        const struct lw_mesh *mesh = &scene->mesh[scene->object[o].mesh];
        tiles +=
            (uint64_t)lw_texels_tiles_along(mesh->atlas_width) * lw_texels_tiles_along(mesh->atlas_height);
    }
    return tiles * TILE_BYTES;
}

static uint64_t texel_bytes(const struct lw_solver_desc *desc, uint32_t layers) {
    return lw_coarse_scene_count_texels(desc->scene) * lw_memory_forecast_texel(desc, layers);
}

uint64_t lw_memory_forecast_whole(const struct lw_solver_desc *desc, uint32_t layers) {
    return texel_bytes(desc, layers) + tile_bytes(desc->scene);
}

uint64_t lw_memory_forecast_coarse(const struct lw_solver_desc *desc, uint32_t layers) {
    return texel_bytes(desc, layers) / (LW_COARSE_SCENE_SIDE * LW_COARSE_SCENE_SIDE) +
           tile_bytes(desc->scene);
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
