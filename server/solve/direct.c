#include "server/solve/direct.h"

#include "common/light/direct16.h"

#include <string.h>

#define LANES LW_TRACE_WIDTH

void lw_direct_light(const struct lw_passes *passes, const struct lw_solve_tile *tile,
                     struct lw_launch *launch, struct lw_launch_site *site, struct lw_direct_estimate *out,
                     struct lw_passes_count *count) {
    const uint32_t samples = passes->direct_samples, first = launch->frames * samples;
    const float weight = 1.0f / (float)samples;
    lw_launch_place(launch, tile, site);
    struct lw_direct16 part[2] = {{.lights = passes->lights,
                                   .trace = passes->trace,
                                   .points = &site->lanes.at,
                                   .active = launch->active,
                                   .coherent = site->coherent,
                                   .seed = passes->seed,
                                   .object = tile->object,
                                   .block = launch->block,
                                   .set = launch->set,
                                   .salt = launch->frames,
                                   .e = out->all}};
    const uint32_t parts = passes->drawn ? 2 : 1;
    memset(out, 0, sizeof *out);
    part[1] = part[0];
    part[1].lights = passes->drawn;
    part[1].e = out->drawn;
    for (uint32_t k = 0; k < parts; k++) lw_direct16_punctual(&part[k], launch->frames, 1);
    for (uint32_t s = 0; s < samples; s++) {
        if (samples > 1) {
            lw_launch_choose(launch, tile, passes->texels->usable, passes->seed, first + s);
            lw_launch_place(launch, tile, site);
        }
        for (uint32_t k = 0; k < parts; k++) {
            part[k].coherent = site->coherent;
            part[k].salt = first + s;
            lw_direct16_groups(&part[k], first + s, weight);
            lw_direct16_sky(&part[k], first + s, weight);
        }
    }
    for (uint32_t k = 0; k < parts; k++) count->shadow += part[k].rays;
    for (int c = 0; c < 3 && parts > 1; c++)
        for (uint32_t lane = 0; lane < LANES; lane++) out->all[c][lane] += out->drawn[c][lane];
}
