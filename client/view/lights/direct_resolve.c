#include "client/view/lights/direct_resolve.h"

#include "client/view/lights/direct_rays.h"
#include "client/view/lights/direct_unshadowed.h"
#include "common/base/wide.h"

#include <string.h>

#define LANES  LW_DIRECT_LANES
#define BLOCKS LW_DIRECT_BLOCKS

/* Half the side of the largest window over which a penumbra is averaged, pixels. */
#define WINDOW 3

static bool is_partial(const struct lw_direct_work *w, uint32_t pixel) {
    return w->lit[pixel] > 0 && w->lit[pixel] < w->taken[pixel];
}

/* Gives pixels without a ray the share of their quad's ray, or of the block's. */
static void spread(struct lw_direct_work *w, uint32_t b) {
    if (w->state[b] != (LW_DIRECT_DARK | LW_DIRECT_LIT)) {
        for (uint32_t i = 0; i < LANES; i++) w->share[b * LANES + i] = w->state[b] == LW_DIRECT_LIT ? 1 : 0;
        return;
    }
    float of_block = 0;
    for (uint32_t p = b * LANES; p < (b + 1) * LANES; p++)
        if (w->taken[p]) of_block = (float)w->lit[p] / (float)w->taken[p];
    for (uint32_t q = 0; q < 4; q++) {
        const uint32_t first = b * LANES + (q & 1) * 2 + (q >> 1) * 8;
        const uint32_t at[4] = {first, first + 1, first + 4, first + 5};
        float share = of_block;
        for (int k = 0; k < 4; k++)
            if (w->taken[at[k]]) share = (float)w->lit[at[k]] / (float)w->taken[at[k]];
        for (int k = 0; k < 4; k++)
            w->share[at[k]] = w->taken[at[k]] ? (float)w->lit[at[k]] / (float)w->taken[at[k]] : share;
    }
}

static bool is_one_surface(const struct lw_direct_tile *tile, uint32_t a, uint32_t b) {
    const struct lw_points16 *p = &tile->block[a / LANES].points, *q = &tile->block[b / LANES].points;
    const uint32_t i = a % LANES, j = b % LANES;
    const float dx = q->x[j] - p->x[i], dy = q->y[j] - p->y[i], dz = q->z[j] - p->z[i];
    const float off = dx * p->nx[i] + dy * p->ny[i] + dz * p->nz[i];
    return p->nx[i] * q->nx[j] + p->ny[i] * q->ny[j] + p->nz[i] * q->nz[j] > 0.95f &&
           off * off <= 0.05f * (dx * dx + dy * dy + dz * dz);
}

/* Mean share over the widest window around a pixel that lies within a penumbra, on one surface. */
static float smooth(const struct lw_direct_job *job, uint32_t pixel) {
    const struct lw_direct_work *w = job->work;
    const int x = lw_direct_rays_column(pixel), y = lw_direct_rays_row(pixel), side = (int)LW_DIRECT_SIDE;
    uint32_t near = 0;
    for (int j = y > 0 ? y - 1 : 0; j <= y + 1 && j < side; j++) near |= w->lit_row[j] & w->dark_row[j];
    if (!(near & lw_direct_rays_widen(1u << x, 1))) return w->share[pixel];
    float mean = w->share[pixel], sum = mean;
    uint32_t partial = is_partial(w, pixel), all = 1;
    for (int r = 1; r <= WINDOW; r++) {
        for (int j = -r; j <= r; j++)
            for (int i = -r; i <= r; i += j == -r || j == r ? 1 : 2 * r) {
                if (x + i < 0 || y + j < 0 || x + i >= side || y + j >= side) continue;
                const uint32_t p = lw_direct_rays_pixel_at(x + i, y + j);
                if (!w->taken[p] || !is_one_surface(job->tile, pixel, p)) continue;
                sum += w->share[p];
                partial += is_partial(w, p);
                all++;
            }
        if (!lw_direct_rays_is_wide(partial, all, (uint32_t)r)) break;
        mean = sum / (float)all;
    }
    return mean;
}

LW_WIDE static void add_matt_part(const float *restrict share, const float *restrict e, struct lw_vec3 colour,
                                  uint16_t facing, float (*restrict out)[LANES]) {
    for (uint32_t i = 0; i < LANES; i++) {
        const float part = facing >> i & 1u ? e[i] * share[i] : 0;
        out[0][i] += part * colour.x, out[1][i] += part * colour.y, out[2][i] += part * colour.z;
    }
}

void lw_direct_resolve_add(const struct lw_direct_job *job, uint32_t b, const float share[LANES],
                           struct lw_vec3 colour) {
    const struct lw_direct_work *w = job->work;
    struct lw_direct_block *block = &job->tile->block[b];
    if (!block->finished) {
        add_matt_part(share, w->e[b], colour, w->facing[b], block->e);
        return;
    }
    float e[LANES];
    for (uint32_t i = 0; i < LANES; i++) e[i] = w->facing[b] >> i & 1u ? w->e[b][i] * share[i] : 0;
    lw_direct_unshadowed_add(e, &w->gloss[b], colour, block);
}

void lw_direct_resolve_tile(const struct lw_direct_job *job) {
    struct lw_direct_work *w = job->work;
    const struct lw_vec3 colour = lw_direct_unshadowed_colour(job->direct, job->candidate);
    if (!lw_direct_rays_is_mixed(w)) { /* all of the tile is lit, or dark */
        static const float all[LANES] = {1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1};
        for (uint32_t b = 0; b < BLOCKS; b++)
            if (w->facing[b] && w->state[b] == LW_DIRECT_LIT) lw_direct_resolve_add(job, b, all, colour);
        return;
    }
    for (uint32_t b = 0; b < BLOCKS; b++)
        if (w->facing[b]) spread(w, b);
    for (uint32_t b = 0; b < BLOCKS; b++) {
        if (!w->facing[b]) continue;
        float share[LANES];
        memcpy(share, w->share + b * LANES, sizeof share);
        for (uint32_t left = job->tile->listed ? 0 : w->facing[b]; left; left &= left - 1) {
            const uint32_t i = (uint32_t)__builtin_ctz(left);
            if (w->taken[b * LANES + i] > 1) share[i] = smooth(job, b * LANES + i);
        }
        lw_direct_resolve_add(job, b, share, colour);
    }
}
