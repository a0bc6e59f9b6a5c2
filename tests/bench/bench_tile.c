#include "tests/bench/bench_tile.h"

#include "common/colour.h"

float bench_radiance_of(const struct lw_transport *p, uint32_t texel) {
    if (texel == LW_TEXEL_NONE) return 0;
    float sum = 0;
    for (uint32_t k = 0; k < p->tiles->bounces; k++) {
        const float *l = p->tiles->radiance[k] + (size_t)texel * 4;
        sum += lw_colour_luminance(lw_vec3(l[0], l[1], l[2]));
    }
    return sum;
}

/* Mean of E over the covered texels of a square of the tile; how many these are. */
static uint32_t mean_over(const struct lw_transport *p, const struct lw_solve_tile *tile, uint32_t x,
                          uint32_t y, uint32_t side, const float *sum, uint32_t samples, double *out) {
    uint32_t count = 0;
    double total = 0;
    for (uint32_t ty = y; ty < y + side && ty < tile->height; ty++)
        for (uint32_t tx = x; tx < x + side && tx < tile->width; tx++) {
            const uint32_t i = ty * tile->width + tx;
            if (!p->tiles->covered[tile->first + i]) continue;
            total += (double)sum[i];
            count++;
        }
    *out = count ? total * (double)LW_PI / samples / count : 0;
    return count;
}

void bench_count_means(const struct lw_transport *p, const struct lw_solve_tile *tile,
                       const struct bench_scales *scales, uint64_t *means) {
    static const bench_plane none;
    double ignored;
    for (uint32_t k = 0; k < scales->count; k++)
        for (uint32_t y = 0; y < tile->height; y += scales->side[k])
            for (uint32_t x = 0; x < tile->width; x += scales->side[k])
                means[k] += mean_over(p, tile, x, y, scales->side[k], none, 1, &ignored) > 0;
}

void bench_add_errors(const struct lw_transport *p, const struct lw_solve_tile *tile,
                      const struct bench_scales *scales, const bench_plane sum, uint32_t samples,
                      bench_plane reference[2], uint32_t reference_samples, double eps, double *error) {
    for (uint32_t k = 0; k < scales->count; k++)
        for (uint32_t y = 0; y < tile->height; y += scales->side[k])
            for (uint32_t x = 0; x < tile->width; x += scales->side[k]) {
                double value, t[2];
                if (!mean_over(p, tile, x, y, scales->side[k], sum, samples, &value)) continue;
                for (int j = 0; j < 2; j++)
                    mean_over(p, tile, x, y, scales->side[k], reference[j], reference_samples, &t[j]);
                const double middle = (t[0] + t[1]) / 2;
                error[k] += (value - t[0]) * (value - t[1]) / (middle * middle + eps);
            }
}
