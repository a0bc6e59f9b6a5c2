#include "common/light/form16.h"

#include "common/base/wide.h"

#include <string.h>

#define LANES LW_TRACE_WIDTH
/* Share of a ray's length: its end lies off the surface as its start does. This only keeps rounding out. */
#define RAY_SHARE (1 - 0x1p-20f)

LW_WIDE void lw_form16_weigh(const struct lw_points16 *restrict at, const float position[restrict 3],
                             const float normal[restrict 3], float area, float near_m2,
                             float out[restrict LANES]) {
    const float px = position[0], py = position[1], pz = position[2], nx = normal[0], ny = normal[1],
                nz = normal[2];
    for (int i = 0; i < LANES; i++) {
        const float x = px - at->x[i], y = py - at->y[i], z = pz - at->z[i];
        const float r2 = x * x + y * y + z * z;
        const float here = x * at->nx[i] + y * at->ny[i] + z * at->nz[i], there = -(x * nx + y * ny + z * nz);
        const float both = (here > 0 ? here : 0) * (there > 0 ? there : 0);
        out[i] = both / (r2 * (LW_PI * (r2 > near_m2 ? r2 : near_m2) + area) + 1e-37f);
    }
}

uint16_t lw_form16_lit(const float weight[LANES]) {
    uint16_t mask = 0;
    for (int i = 0; i < LANES; i++) mask |= (uint16_t)((weight[i] > 0) << i);
    return mask;
}

void lw_form16_start(const struct lw_points16 *points, struct lw_ray16 *rays) {
    memset(rays->t_near, 0, sizeof rays->t_near);
    memcpy(rays->org_x, points->x, sizeof rays->org_x);
    memcpy(rays->org_y, points->y, sizeof rays->org_y);
    memcpy(rays->org_z, points->z, sizeof rays->org_z);
    for (int i = 0; i < LANES; i++) rays->t_far[i] = RAY_SHARE;
}

LW_WIDE void lw_form16_aim(const struct lw_points16 *restrict at, const float position[restrict 3],
                           struct lw_ray16 *restrict rays) {
    for (int i = 0; i < LANES; i++) {
        rays->dir_x[i] = position[0] - at->x[i];
        rays->dir_y[i] = position[1] - at->y[i];
        rays->dir_z[i] = position[2] - at->z[i];
    }
}

LW_WIDE void lw_form16_add(const float weight[restrict LANES], const float flux[restrict 3],
                           float sum[restrict 3][LANES]) {
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < LANES; i++) sum[c][i] += weight[i] * flux[c];
}
