#include "server/solve/direct.h"

#include "common/light/direct16.h"

#include <string.h>

#define LANES LW_TRACE_WIDTH

void lw_direct_light(const struct lw_passes *passes, const struct lw_solve_tile *tile,
                     struct lw_launch *launch, struct lw_launch_site *site, float out_e[3][LANES],
                     struct lw_passes_count *count) {
    const uint32_t samples = passes->direct_samples, first = launch->frames * samples;
    const float weight = 1.0f / (float)samples;
    lw_launch_place(launch, tile, site);
    struct lw_direct16 direct = {.lights = passes->lights,
                                 .trace = passes->trace,
                                 .points = &site->lanes.at,
                                 .active = launch->active,
                                 .coherent = site->coherent,
                                 .seed = passes->seed,
                                 .object = tile->object,
                                 .block = launch->block,
                                 .set = launch->set,
                                 .salt = launch->frames,
                                 .e = out_e};
    memset(out_e, 0, 3 * sizeof *out_e);
    lw_direct16_punctual(&direct, launch->frames, 1);
    for (uint32_t s = 0; s < samples; s++) {
        if (samples > 1) {
            lw_launch_choose(launch, tile, passes->texels->usable, passes->seed, first + s);
            lw_launch_place(launch, tile, site);
            direct.coherent = site->coherent;
        }
        direct.salt = first + s;
        lw_direct16_groups(&direct, first + s, weight);
        lw_direct16_sky(&direct, first + s, weight);
    }
    count->shadow += direct.rays;
}
