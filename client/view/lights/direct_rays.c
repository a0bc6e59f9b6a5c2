#include "client/view/lights/direct_rays.h"

#include "common/base/random.h"

#include <string.h>

#define LANES  LW_DIRECT_LANES
#define BLOCKS LW_DIRECT_BLOCKS

/* A pixel takes one shadow ray. It takes FEW or SOME where its neighbours' rays differ, and LW_DIRECT_SAMPLES
 * in a penumbra that is too narrow for a mean over neighbours. */
#define FEW  2u
#define SOME 4u

/* Whether a point lies on the flat piece of surface around another. */
static bool is_flat(const struct lw_points16 *p, uint32_t a, uint32_t b) {
    const float dx = p->x[b] - p->x[a], dy = p->y[b] - p->y[a], dz = p->z[b] - p->z[a];
    const float off = dx * p->nx[a] + dy * p->ny[a] + dz * p->nz[a];
    return p->nx[a] * p->nx[b] + p->ny[a] * p->ny[b] + p->nz[a] * p->nz[b] > 0.97f &&
           off * off <= 0.03f * (dx * dx + dy * dy + dz * dz);
}

uint16_t lw_direct_rays_find_flat(const struct lw_direct_block *block) {
    const struct lw_points16 *p = &block->points;
    uint16_t flat = 0;
    for (uint32_t q = 0; q < 4; q++) {
        const uint32_t first = (q & 1) * 2 + (q >> 1) * 8;
        const uint16_t quad = (uint16_t)(0x33u << first);
        if ((block->active & quad) == quad && is_flat(p, first, first + 1) && is_flat(p, first, first + 4) &&
            is_flat(p, first, first + 5))
            flat |= quad;
    }
    return flat;
}

bool lw_direct_rays_is_flat(const struct lw_direct_block *block) {
    const struct lw_points16 *p = &block->points;
    return is_flat(p, 0, 2) && is_flat(p, 0, 8) && is_flat(p, 0, 10) && is_flat(p, 0, 3) &&
           is_flat(p, 0, 12) && is_flat(p, 0, 15) && is_flat(p, 15, 3) && is_flat(p, 15, 12);
}

/* Counts a pixel's ray. */
static void note_shadow_ray(struct lw_direct_work *w, uint32_t pixel, bool lit) {
    const uint32_t bit = 1u << lw_direct_rays_column(pixel);
    w->lit[pixel] += lit;
    w->state[pixel / LANES] |= lit ? LW_DIRECT_LIT : LW_DIRECT_DARK;
    (lit ? w->lit_row : w->dark_row)[lw_direct_rays_row(pixel)] |= bit;
}

void lw_direct_rays_flush(struct lw_direct_job *job) {
    struct lw_direct_work *w = job->work;
    if (!w->waiting) return;
    const uint16_t active = (uint16_t)((1u << w->waiting) - 1u);
    const uint16_t occluded =
        lw_trace_occluded16(job->direct->desc.trace, LW_TRACE_COHERENT, active, &w->rays);
    for (uint32_t i = 0; i < w->waiting; i++) note_shadow_ray(w, w->pixel[i], !(occluded >> i & 1u));
    job->tile->rays += w->waiting;
    w->waiting = 0;
}

/* Visible parts of a cluster from a block. A tile that is small, seen from the cluster, has one list for all
 * blocks. */
static const float *share_of(struct lw_direct_job *job, uint32_t block, struct lw_vec3 point) {
    struct lw_direct_work *w = job->work;
    const uint32_t slot = job->far ? 0 : block;
    if (w->shared[slot] != job->number) {
        w->shared[slot] = job->number;
        const struct lw_direct_pixels *d = job->direct;
        lw_emitter_clusters_share(&d->clusters.cluster[d->candidates.index[job->candidate]], point,
                                  w->part[slot]);
    }
    return w->part[slot];
}

/* Puts a pixel's shadow ray number k into the packet. */
void lw_direct_rays_shoot(struct lw_direct_job *job, uint32_t pixel, uint32_t k) {
    struct lw_direct_work *w = job->work;
    const struct lw_direct_pixels *d = job->direct;
    const uint32_t block = pixel / LANES, lane = pixel % LANES, index = d->candidates.index[job->candidate];
    const uint32_t variant = lw_random_hash2(job->seed, block) % LW_DIRECT_VARIANTS;
    const struct lw_points16 *p = &job->tile->block[block].points;
    const struct lw_vec3 origin = lw_vec3(p->x[lane], p->y[lane], p->z[lane]);
    const float *point = d->point[variant][k][lane];
    struct lw_vec3 way;
    float end = LW_TRACE_SHORT;
    w->taken[pixel]++;
    switch ((enum lw_direct_kind)d->candidates.kind[job->candidate]) {
    case LW_DIRECT_SUN:
        way = d->sun[job->candidate][variant][k][lane];
        end = INFINITY;
        break;
    case LW_DIRECT_NEAR:
        way = lw_vec3_sub(d->lights.punctual[index].position_ws, origin);
        break;
    case LW_DIRECT_CLUSTER:
    default:
        if (!lw_emitter_clusters_aim(&d->clusters, &d->clusters.cluster[index], share_of(job, block, origin),
                                     origin, lw_vec3(p->nx[lane], p->ny[lane], p->nz[lane]), point[0],
                                     point[1], &way, &end)) {
            note_shadow_ray(w, pixel, false);
            return;
        }
        break;
    }
    w->pixel[w->waiting] = (uint16_t)pixel;
    lw_trace_set_ray(&w->rays, w->waiting, origin, way, end);
    if (++w->waiting == LANES) lw_direct_rays_flush(job);
}

/* One ray for each quad of a block that has none yet, and for each pixel of those that are not flat. */
static void shoot_quads(struct lw_direct_job *job, uint32_t b) {
    struct lw_direct_work *w = job->work;
    const uint32_t turn = lw_random_hash2(job->seed, b) >> 8;
    for (uint32_t q = 0; q < 4; q++) {
        const uint32_t first = (q & 1) * 2 + (q >> 1) * 8, at = b * LANES + first;
        const uint16_t quad = (uint16_t)(0x33u << first);
        if ((w->facing[b] & w->flat[b] & quad) == quad) {
            const uint32_t k = turn >> 2 * q & 3;
            if (!(w->taken[at] | w->taken[at + 1] | w->taken[at + 4] | w->taken[at + 5]))
                lw_direct_rays_shoot(job, at + (k & 1) + (k >> 1) * 4, 0);
            continue;
        }
        for (uint32_t k = 0; k < 4; k++) {
            const uint32_t i = first + (k & 1) + (k >> 1) * 4;
            if (!(w->facing[b] >> i & 1u)) continue;
            lw_direct_rays_shoot(job, b * LANES + i, 0);
            if (!(w->seen[b] & quad) && !job->tile->listed) break; /* weak light: one is enough */
        }
    }
}

/* One ray for each flat block, or flat quad, and for each pixel elsewhere. Rays of blocks in a row or
 * column go through all rows and columns of pixels, so that a straight shadow of a pixel's width is found
 * somewhere. */
static void shoot_sparsely(struct lw_direct_job *job, bool divided[BLOCKS]) {
    struct lw_direct_work *w = job->work;
    for (uint32_t b = 0; b < BLOCKS; b++) {
        const uint32_t u = b % LW_DIRECT_TILE_SIDE, v = b / LW_DIRECT_TILE_SIDE;
        divided[b] = w->facing[b] != 0xffff || !w->whole[b];
        if (w->facing[b] && !w->faint[b] && !job->tile->listed) { /* one will do, wherever it starts */
            lw_direct_rays_shoot(job, b * LANES + (uint32_t)__builtin_ctz(w->facing[b]), 0);
            divided[b] = true;
            continue;
        }
        if (!divided[b]) {
            const uint32_t x = (v + 2 * u + (job->seed >> 8)) & 3, y = (u + 2 * v + (job->seed >> 12)) & 3;
            lw_direct_rays_shoot(job, b * LANES + 4 * y + x, 0);
        } else if (w->facing[b]) {
            shoot_quads(job, b);
        }
    }
    lw_direct_rays_flush(job);
}

/* All states of a block and of those around it. */
static unsigned states_around(const struct lw_direct_work *w, uint32_t b) {
    const int side = (int)LW_DIRECT_TILE_SIDE, x = (int)b % side, y = (int)b / side;
    unsigned states = 0;
    for (int j = y > 0 ? y - 1 : 0; j <= (y + 1 < side ? y + 1 : y); j++)
        for (int i = x > 0 ? x - 1 : 0; i <= (x + 1 < side ? x + 1 : x); i++)
            states |= w->state[j * side + i];
    return states;
}

/* Where blocks disagree with those around them they have a ray for each quad; what these find may lead on. */
static void divide(struct lw_direct_job *job, bool divided[BLOCKS]) {
    struct lw_direct_work *w = job->work;
    for (bool again = true; again;) {
        again = false;
        for (uint32_t b = 0; b < BLOCKS; b++) {
            if (divided[b] || !w->faint[b] || states_around(w, b) != (LW_DIRECT_DARK | LW_DIRECT_LIT))
                continue;
            shoot_quads(job, b);
            divided[b] = again = true;
        }
        lw_direct_rays_flush(job);
    }
}

/* The pixels that have both light and shadow in the square window of half side r around them. */
static void find_mixed(const struct lw_direct_work *w, int r, uint32_t out_row[LW_DIRECT_SIDE]) {
    uint32_t lit[LW_DIRECT_SIDE], dark[LW_DIRECT_SIDE];
    for (uint32_t y = 0; y < LW_DIRECT_SIDE; y++)
        lit[y] = lw_direct_rays_widen(w->lit_row[y], r), dark[y] = lw_direct_rays_widen(w->dark_row[y], r);
    for (int y = 0; y < (int)LW_DIRECT_SIDE; y++) {
        uint32_t any_lit = 0, any_dark = 0;
        for (int j = y > r ? y - r : 0; j <= y + r && j < (int)LW_DIRECT_SIDE; j++)
            any_lit |= lit[j], any_dark |= dark[j];
        out_row[y] = any_lit & any_dark;
    }
}

/* The pixels of a block, of rows of the tile. */
static uint16_t of_block(const uint32_t row[LW_DIRECT_SIDE], uint32_t b) {
    const uint32_t x = b % LW_DIRECT_TILE_SIDE * 4, y = b / LW_DIRECT_TILE_SIDE * 4;
    uint32_t bits = 0;
    for (uint32_t k = 0; k < 4; k++) bits |= (row[y + k] >> x & 15u) << 4 * k;
    return (uint16_t)bits;
}

/* Pixels close to others that disagree have rays of their own. Rays of quads side by side are up to three
 * pixels apart. */
static void shoot_pixels(struct lw_direct_job *job) {
    struct lw_direct_work *w = job->work;
    for (int pass = 0; pass < 2; pass++) {
        uint32_t mixed[LW_DIRECT_SIDE];
        find_mixed(w, 3, mixed);
        for (uint32_t b = 0; b < BLOCKS; b++) {
            uint32_t left = w->seen[b] ? w->seen[b] & of_block(mixed, b) : 0;
            for (; left; left &= left - 1) {
                const uint32_t pixel = b * LANES + (uint32_t)__builtin_ctz(left);
                if (!w->taken[pixel]) lw_direct_rays_shoot(job, pixel, 0);
            }
        }
        lw_direct_rays_flush(job);
    }
}

/* Whether a pixel lies at the edge of a penumbra that is too narrow for a mean over neighbours. */
static bool is_narrow(const struct lw_direct_work *w, uint32_t pixel) {
    const int x = lw_direct_rays_column(pixel), y = lw_direct_rays_row(pixel);
    const uint32_t window = lw_direct_rays_widen(1u << x, 1);
    uint32_t partial = 0, all = 0;
    for (int j = y > 0 ? y - 1 : 0; j <= y + 1 && j < (int)LW_DIRECT_SIDE; j++) {
        partial += (uint32_t)__builtin_popcount(w->lit_row[j] & w->dark_row[j] & window);
        all += (uint32_t)__builtin_popcount((w->lit_row[j] | w->dark_row[j]) & window);
    }
    return partial > 0 && !lw_direct_rays_is_wide(partial, all, 1);
}

/* The pixels of a block that take more than `taken` rays. mixed: those close to light and shadow */
static uint16_t find_wanting(const struct lw_direct_job *job, const uint32_t mixed[LW_DIRECT_SIDE],
                             uint32_t b, uint32_t taken) {
    const struct lw_direct_work *w = job->work;
    const bool listed = job->tile->listed; /* its blocks are no neighbourhoods: a mixed one is enough */
    if (listed && (w->state[b] != (LW_DIRECT_DARK | LW_DIRECT_LIT) || taken >= SOME)) return 0;
    uint32_t wanting = 0, left = taken == 1 ? w->seen[b] : w->noisy[b];
    if (left && !listed) left &= of_block(mixed, b);
    for (; left; left &= left - 1) {
        const uint32_t i = (uint32_t)__builtin_ctz(left), pixel = b * LANES + i;
        if (w->taken[pixel] == taken && (taken < SOME || is_narrow(w, pixel))) wanting |= 1u << i;
    }
    return (uint16_t)wanting;
}

/* Brings pixels that have `taken` rays, and whose neighbourhood is mixed, to `count`. reach: half its side */
static void refine(struct lw_direct_job *job, int reach, uint32_t taken, uint32_t count) {
    struct lw_direct_work *w = job->work;
    uint16_t more[BLOCKS]; /* by the rays of before */
    uint32_t mixed[LW_DIRECT_SIDE];
    find_mixed(w, reach, mixed);
    for (uint32_t b = 0; b < BLOCKS; b++) more[b] = find_wanting(job, mixed, b, taken);
    for (uint32_t k = taken; k < count; k++) {
        w->rays.salt = lw_random_hash2(job->seed, k);
        for (uint32_t b = 0; b < BLOCKS; b++)
            for (uint32_t left = more[b]; left; left &= left - 1)
                lw_direct_rays_shoot(job, b * LANES + (uint32_t)__builtin_ctz(left), k);
        lw_direct_rays_flush(job);
    }
}

bool lw_direct_rays_is_mixed(const struct lw_direct_work *w) {
    unsigned states = 0;
    for (uint32_t b = 0; b < BLOCKS; b++) states |= w->state[b];
    return states == (LW_DIRECT_DARK | LW_DIRECT_LIT);
}

void lw_direct_rays_trace(struct lw_direct_job *job) {
    struct lw_direct_work *w = job->work;
    memset(w->lit, 0, sizeof w->lit);
    memset(w->taken, 0, sizeof w->taken);
    memset(w->state, 0, sizeof w->state);
    memset(w->lit_row, 0, sizeof w->lit_row);
    memset(w->dark_row, 0, sizeof w->dark_row);
    w->rays.salt = job->seed;
    bool divided[BLOCKS];
    shoot_sparsely(job, divided);
    if (lw_direct_rays_is_mixed(w)) {
        if (!job->tile->listed) {
            divide(job, divided);
            shoot_pixels(job);
        }
        if (job->wide) {
            refine(job, 1, 1, FEW);
            refine(job, 1, 1, FEW); /* what only these have shown to be close to a penumbra */
            refine(job, 1, FEW, SOME);
            refine(job, 2, SOME, LW_DIRECT_SAMPLES);
        }
    }
}
