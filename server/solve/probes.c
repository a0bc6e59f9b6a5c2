#include "server/solve/probes.h"

#include "server/solve/sampling.h"
#include "server/solve/transport.h"

#include <stdlib.h>
#include <string.h>

#define COEFFICIENTS 9

enum lw_status lw_probes_init(struct lw_probes *probes, const struct lw_cells *cells, uint32_t bounces) {
    *probes = (struct lw_probes){.cells = cells, .count = lw_cells_total(cells), .bounces = bounces};
    probes->end = calloc((size_t)probes->count * LW_PROBES_RAYS, sizeof *probes->end);
    probes->coefficient =
        calloc((size_t)bounces * probes->count * COEFFICIENTS * 3 + 1, sizeof *probes->coefficient);
    if (!probes->end || !probes->coefficient) {
        lw_probes_finish(probes);
        return LW_NO_MEMORY;
    }
    return LW_OK;
}

void lw_probes_finish(struct lw_probes *probes) {
    free(probes->coefficient);
    free(probes->end);
    *probes = (struct lw_probes){0};
}

/* Real spherical harmonics up to l = 2. */
static void basis(struct lw_vec3 d, float y[COEFFICIENTS]) {
    y[0] = 0.282095f;
    y[1] = 0.488603f * d.y;
    y[2] = 0.488603f * d.z;
    y[3] = 0.488603f * d.x;
    y[4] = 1.092548f * d.x * d.y;
    y[5] = 1.092548f * d.y * d.z;
    y[6] = 0.315392f * (3 * d.z * d.z - 1);
    y[7] = 1.092548f * d.x * d.z;
    y[8] = 0.546274f * (d.x * d.x - d.y * d.y);
}

/* Direction of ray r of a probe in the frame `sample`. */
static struct lw_vec3 ray_direction(uint32_t seed, uint32_t probe, uint32_t sample, uint32_t ray) {
    float point[2];
    lw_random_sobol2(sample * LW_PROBES_RAYS + ray, lw_sampling_seed(seed, probe, 0, LW_SAMPLING_PROBE),
                     point);
    return lw_sampling_sphere(point);
}

uint64_t lw_probes_gather(struct lw_probes *probes, const struct lw_trace *trace,
                          const struct lw_texels *texels, uint32_t seed, uint32_t sample, int threads) {
#pragma omp parallel for schedule(dynamic, 4) num_threads(threads)
    for (uint32_t p = 0; p < probes->count; p++) {
        struct lw_vec3 centre = lw_cells_centre(probes->cells, p);
        for (uint32_t first = 0; first < LW_PROBES_RAYS; first += LW_TRACE_WIDTH) {
            struct lw_ray16 rays;
            struct lw_hit16 hits;
            rays.salt = sample * LW_PROBES_RAYS + first;
            for (uint32_t i = 0; i < LW_TRACE_WIDTH; i++)
                lw_trace_set_ray(&rays, i, centre, ray_direction(seed, p, sample, first + i), INFINITY);
            lw_trace_closest16(trace, LW_TRACE_LIGHT, UINT16_MAX, &rays, &hits);
            for (uint32_t i = 0; i < LW_TRACE_WIDTH; i++)
                probes->end[p * LW_PROBES_RAYS + first + i] =
                    hits.object[i] == LW_TRACE_MISS ? LW_END_NOTHING
                                                    : lw_texels_at(texels, hits.object[i], hits.triangle[i],
                                                                   hits.u[i], hits.v[i], hits.back[i]);
        }
    }
    return (uint64_t)probes->count * LW_PROBES_RAYS;
}

static float *coefficients(const struct lw_probes *probes, uint32_t bounce, uint32_t probe) {
    return probes->coefficient + ((size_t)bounce * probes->count + probe) * COEFFICIENTS * 3;
}

void lw_probes_project(struct lw_probes *probes, uint32_t bounce, const float *radiance, uint32_t seed,
                       uint32_t sample, float weight, int threads) {
#pragma omp parallel for schedule(static) num_threads(threads)
    for (uint32_t p = 0; p < probes->count; p++) {
        float sum[COEFFICIENTS * 3] = {0}, y[COEFFICIENTS];
        for (uint32_t r = 0; r < LW_PROBES_RAYS; r++) {
            uint32_t end = probes->end[p * LW_PROBES_RAYS + r];
            if (end == LW_END_NOTHING) continue;
            basis(ray_direction(seed, p, sample, r), y);
            for (int k = 0; k < COEFFICIENTS; k++)
                for (int c = 0; c < 3; c++) sum[k * 3 + c] += y[k] * radiance[(size_t)end * 4 + (size_t)c];
        }
        float *stored = coefficients(probes, bounce, p);
        const float per_ray = 4 * LW_PI / (float)LW_PROBES_RAYS; /* 1 / (N pdf) */
        for (int k = 0; k < COEFFICIENTS * 3; k++) stored[k] += (sum[k] * per_ray - stored[k]) * weight;
    }
}

struct lw_vec3 lw_probes_radiance(const struct lw_probes *probes, uint32_t bounce, uint32_t probe,
                                  struct lw_vec3 direction) {
    const float *stored = coefficients(probes, bounce, probe);
    float y[COEFFICIENTS], sum[3] = {0};
    basis(direction, y);
    for (int k = 0; k < COEFFICIENTS; k++)
        for (int c = 0; c < 3; c++) sum[c] += y[k] * stored[k * 3 + c];
    return lw_vec3(fmaxf(0, sum[0]), fmaxf(0, sum[1]), fmaxf(0, sum[2]));
}
