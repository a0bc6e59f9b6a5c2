#include "server/solve/transport/direct_light.h"

#include "common/base/invariant.h"
#include "common/light/direct16.h"

#include <string.h>

#define LANES LW_TRACE_WIDTH

void lw_direct_light_estimate(const struct lw_transport *t, const struct lw_solve_tile *tile,
                              struct lw_ray_launch *launch, struct lw_ray_launch_site *site,
                              struct lw_direct_light *out, struct lw_ray_count *count) {
    const uint32_t samples = t->direct_samples, first = launch->frames * samples;
    const float weight = 1.0f / (float)samples;
    LW_INVARIANT(samples > 0 && launch->active);
    lw_ray_launch_place(launch, tile, site);
    struct lw_direct16 part[2] = {{.lights = t->lights,
                                   .trace = t->trace,
                                   .points = &site->lanes.at,
                                   .active = launch->active,
                                   .coherent = site->coherent,
                                   .seed = t->seed,
                                   .object = tile->object,
                                   .block = launch->block,
                                   .set = launch->set,
                                   .salt = launch->frames,
                                   .e = out->all}};
    const uint32_t parts = t->drawn ? 2 : 1;
    memset(out, 0, sizeof *out);
    part[1] = part[0];
    part[1].lights = t->drawn;
    part[1].e = out->drawn;
    if (lw_tiles_has_moments(t->tiles, tile)) {
        part[0].moment = out->moment;
        part[1].moment = out->drawn_moment;
    }
    for (uint32_t k = 0; k < parts; k++) lw_direct16_punctual(&part[k], launch->frames, 1);
    for (uint32_t s = 0; s < samples; s++) {
        if (samples > 1) {
            lw_ray_launch_choose(launch, tile, t->texels->usable, t->seed, first + s);
            lw_ray_launch_place(launch, tile, site);
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

void lw_direct_light_repeat(const struct lw_transport *t, const struct lw_solve_tile *tile,
                            struct lw_ray_launch *launch, struct lw_ray_launch_site *site,
                            struct lw_direct_light *out_direct, struct lw_ray_count *count) {
    LW_INVARIANT(launch->frames > 0); /* it was solved */
    launch->frames--;                 /* the numbers of that solve */
    lw_ray_launch_choose(launch, tile, t->texels->usable, t->seed, launch->frames * t->direct_samples);
    lw_direct_light_estimate(t, tile, launch, site, out_direct, count);
    launch->frames++;
}

void lw_direct_light_keep(const struct lw_transport *t, uint32_t texel, const struct lw_direct_light *e,
                          uint32_t lane) {
    LW_INVARIANT_DEAR(texel < t->tiles->texel_capacity && t->tiles->covered[texel]);
    lw_tiles_keep_estimate(t->tiles, LW_TILES_ESTIMATE_DIRECT, texel, lw_direct_light_lane(e->all, lane));
    if (t->drawn) lw_tiles_keep_drawn_estimate(t->tiles, texel, lw_direct_light_lane(e->drawn, lane));
}

static void blend_moments(const struct lw_transport *t, uint32_t texel, const struct lw_direct_light *e,
                          uint32_t lane, float weight) {
    lw_tiles_blend(t->tiles->moment[LW_TILES_DIRECT], texel, lw_direct_light_lane(e->moment, lane), weight);
    if (t->drawn)
        lw_tiles_blend(t->tiles->drawn_moment, texel, lw_direct_light_lane(e->drawn_moment, lane), weight);
}

void lw_direct_light_solve(const struct lw_transport *t, struct lw_solve_tile *tile,
                           struct lw_ray_count *count) {
    struct lw_ray_launch launch[LW_PACKETS_MAX];
    struct lw_ray_launch_site site;
    lw_sample_points_frame_init(&site.frame, &t->pose->object_to_world[tile->object]);
    LW_TILES_EACH_BLOCK (tile, block) {
        if (!block->due) continue;
        LW_INVARIANT(block->direct.weight > 0 && block->direct.weight <= 1);
        lw_ray_launch_block(tile, block, t->texels->usable, t->seed, block->sample_count * t->direct_samples,
                            launch);
        for (uint32_t set = 0; set < block->packet_count; set++) {
            struct lw_direct_light e;
            lw_direct_light_estimate(t, tile, &launch[set], &site, &e, count);
            for (uint32_t lane = 0; lane < block->packet[set].count; lane++) {
                const uint32_t texel = tile->first + launch[set].texel[lane];
                const struct lw_vec3 now = lw_direct_light_lane(e.all, lane);
                if (lw_tiles_has_moments(t->tiles, tile) && lw_vec3_is_finite(now))
                    blend_moments(t, texel, &e, lane, block->direct.weight);
                if (t->drawn && lw_vec3_is_finite(now))
                    lw_tiles_blend(t->tiles->drawn, texel, lw_direct_light_lane(e.drawn, lane),
                                   block->direct.weight);
                lw_tiles_blend(t->tiles->direct, texel, now, block->direct.weight);
                lw_direct_light_keep(t, texel, &e, lane);
            }
        }
    }
}
