#include "tests/bench/bench_light.h"

#include <math.h>
#include <stdlib.h>

struct lw_solver_desc bench_light_desc(const struct lw_scene *scene, const struct lw_atlas_map *map,
                                       double error, uint32_t seed) {
    return (struct lw_solver_desc){.scene = scene,
                                   .atlas_map = map,
                                   .bounces = 2,
                                   .tracing_range_m = INFINITY,
                                   .direct_samples = 1,
                                   .indirect_samples = 2,
                                   .target_error = (float)error,
                                   .seed = seed};
}

float *bench_light_gather(const struct lw_solver *solver, const struct lw_atlas_map *map, size_t values,
                          bench_light_texel *texel, size_t *out_count) {
    size_t count = 0;
    float *light = NULL;
    for (int pass = 0; pass < 2; pass++) {
        if (pass && !(light = malloc((count + 1) * sizeof *light))) return NULL;
        count = 0;
        for (uint32_t id = 0; id < map->tile_count; id++) {
            if (map->place[id].level) continue;
            struct lw_solver_tile tile;
            solver->ops->read_tile(solver, (lw_tile_id){id}, &tile);
            for (uint32_t i = 0; i < tile.width * tile.height; i++) {
                if (!tile.covered[i]) continue;
                if (pass) texel(&tile, i, light + count);
                count += values;
            }
        }
    }
    *out_count = count;
    return light;
}

static void add_sums(const struct lw_solver_tile *tile, uint32_t i, float *out) {
    for (int c = 0; c < 3; c++) out[c] = tile->direct[c][i] + tile->indirect[c][i];
}

float *bench_read_light(const struct lw_solver *solver, const struct lw_atlas_map *map, size_t *out_count) {
    return bench_light_gather(solver, map, 3, add_sums, out_count);
}

double bench_light_epsilon(const float *reference, size_t count) {
    double square = 0;
    for (size_t i = 0; i < count; i++) square += (double)reference[i] * (double)reference[i];
    return 0.01 * square / (double)count;
}

double bench_light_error(const float x[3], const float reference[3], double epsilon) {
    double error = 0;
    for (int c = 0; c < 3; c++) {
        const double t = (double)reference[c], off = (double)x[c] - t;
        error += off * off / (t * t + epsilon) / 3;
    }
    return fmin(error, 1);
}

double bench_light_relmse(const float *x, const float *reference, size_t count) {
    const double epsilon = bench_light_epsilon(reference, count);
    double sum = 0;
    for (size_t i = 0; i < count; i += 3) sum += bench_light_error(x + i, reference + i, epsilon);
    return sum / ((double)count / 3);
}
