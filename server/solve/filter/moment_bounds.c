#include "server/solve/filter/moment_bounds.h"

#include "common/base/colour.h"

#include <math.h>

/* Over the luminance: less is rounding, and stays, so that a second run changes nothing. */
#define ROUNDING 1e-6f

static struct lw_vec3 shortened(struct lw_vec3 v, float luminance) {
    const float length = lw_vec3_length(v);
    return length > (1 + ROUNDING) * luminance ? lw_vec3_scale(v, luminance / length) : v;
}

static struct lw_vec3 lifted(struct lw_vec3 v, float luminance, struct lw_vec3 normal) {
    const float along = lw_vec3_dot(v, normal);
    return along < -ROUNDING * luminance ? lw_vec3_mad(v, normal, -along) : v;
}

static void keep_tile(struct lw_tiles *tiles, const struct lw_affine *to_world,
                      const struct lw_solve_tile *tile, uint32_t channel) {
    float *const *e = tiles->shown[lw_tile_channel_at(channel)->follows], *const *v = tiles->shown[channel];
    for (uint32_t k = 0; k < tile->width * tile->height; k++) {
        const uint32_t i = tile->first + k;
        const float luminance = fmaxf(lw_colour_luminance(lw_vec3(e[0][i], e[1][i], e[2][i])), 0);
        struct lw_vec3 moment = shortened(lw_vec3(v[0][i], v[1][i], v[2][i]), luminance);
        if (tiles->covered[i]) {
            const struct lw_vec3 normal = lw_packed_normal_unpack(tile->mesh->normal[tile->local + k]);
            moment = lifted(moment, luminance, lw_affine_normal(to_world, normal));
        }
        v[0][i] = moment.x, v[1][i] = moment.y, v[2][i] = moment.z;
    }
}

void lw_moment_bounds_keep(struct lw_tiles *tiles, const struct lw_pose *pose, uint64_t frame,
                           uint32_t channels, int threads) {
#pragma omp parallel for schedule(dynamic) num_threads(threads)
    for (uint32_t t = 0; t < tiles->count; t++) {
        const struct lw_solve_tile *tile = &tiles->tile[t];
        if (tile->light.solved_frame != frame) continue;
        LW_TILE_CHANNELS_EACH (channel, lw_tiles_channels_of(tiles, tile, channels))
            if (lw_tile_channel_at(channel)->moment)
                keep_tile(tiles, &pose->object_to_world[tile->object], tile, channel);
    }
}
