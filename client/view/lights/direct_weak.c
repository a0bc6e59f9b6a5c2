#include "client/view/lights/direct_weak.h"

#include "client/view/lights/direct_rays.h"
#include "client/view/lights/direct_unshadowed.h"
#include "common/base/random.h"
#include "common/base/wide.h"

#define LANES  LW_DIRECT_LANES
#define BLOCKS LW_DIRECT_BLOCKS

/* A block counts as one point for lights that are farther than this many of its radii. */
#define EVEN_RADII 8.0f
/* A light that gives less than this share of a block's has a ray there by chance, and counts more then. */
#define SHARE_CHANCE 1e-3f

LW_WIDE void lw_direct_weak_summarise(const struct lw_direct_block *restrict block, uint32_t b,
                                      struct lw_direct_summary *restrict out) {
    const struct lw_points16 *restrict p = &block->points;
    float weight[LANES], count = 0, x = 0, y = 0, z = 0, nx = 0, ny = 0, nz = 0, base = 0;
    for (uint32_t i = 0; i < LANES; i++) weight[i] = block->active >> i & 1u ? 1 : 0;
    for (uint32_t i = 0; i < LANES; i++) {
        const float k = weight[i];
        count += k, base += k * block->base[i];
        x += k * p->x[i], y += k * p->y[i], z += k * p->z[i];
        nx += k * p->nx[i], ny += k * p->ny[i], nz += k * p->nz[i];
    }
    const float scale = count > 0 ? 1 / count : 0;
    x *= scale, y *= scale, z *= scale, nx *= scale, ny *= scale, nz *= scale;
    float far2 = 0, spread2 = 0;
    for (uint32_t i = 0; i < LANES; i++) {
        const float k = weight[i], dx = k * (p->x[i] - x), dy = k * (p->y[i] - y), dz = k * (p->z[i] - z);
        const float ox = k * (p->nx[i] - nx), oy = k * (p->ny[i] - ny), oz = k * (p->nz[i] - nz);
        const float d2 = dx * dx + dy * dy + dz * dz, o2 = ox * ox + oy * oy + oz * oz;
        far2 = far2 > d2 ? far2 : d2, spread2 = spread2 > o2 ? spread2 : o2;
    }
    struct lw_points16 *at = &out->middle[b / LANES];
    const uint32_t lane = b % LANES;
    at->x[lane] = x, at->y[lane] = y, at->z[lane] = z;
    at->nx[lane] = nx, at->ny[lane] = ny, at->nz[lane] = nz;
    out->radius_m[b] = sqrtf(far2), out->spread[b] = sqrtf(spread2);
    out->found[b] = base * scale;
    out->filled[b] = count > 0 ? 1 : 0;
}

/* Turns the middles of blocks towards a light.
 * out     the middles, as points that face the light
 * cosine  of the light at the middle
 * most    largest cosine anywhere in the block
 * near    distance over the block's radius */
LW_WIDE static void turn_to(const struct lw_points16 *restrict p, const float *restrict radius_m,
                            const float *restrict spread, struct lw_vec3 light, float light_radius_m,
                            struct lw_points16 *restrict out, float *restrict cosine, float *restrict most,
                            float *restrict near) {
    for (uint32_t i = 0; i < LANES; i++) {
        const float x = light.x - p->x[i], y = light.y - p->y[i], z = light.z - p->z[i];
        const float m = sqrtf(x * x + y * y + z * z + 1e-20f), scale = 1 / m;
        const float apart = m - light_radius_m;
        out->x[i] = p->x[i], out->y[i] = p->y[i], out->z[i] = p->z[i];
        out->nx[i] = x * scale, out->ny[i] = y * scale, out->nz[i] = z * scale;
        const float c = (p->nx[i] * x + p->ny[i] * y + p->nz[i] * z) * scale;
        const float limit = c + spread[i] + (radius_m[i] + light_radius_m) * scale;
        cosine[i] = c > 0 ? c : 0;
        most[i] = limit > 1 ? 1 : limit > 0 ? limit : 0;
        near[i] = (apart > 0 ? apart : 0) / (radius_m[i] + 1e-20f);
    }
}

float lw_direct_weak_expect(const struct lw_direct_pixels *d, const struct lw_direct_summary *summary,
                            uint32_t candidate, float luminance, struct lw_direct_outlook *out) {
    const struct lw_direct_candidates *c = &d->candidates;
    const struct lw_vec3 light = lw_vec3(c->x[candidate], c->y[candidate], c->z[candidate]);
    float sum = 0;
    for (uint32_t k = 0; k < BLOCKS / LANES; k++) {
        struct lw_points16 at;
        float cosine[LANES], e[LANES];
        turn_to(&summary->middle[k], summary->radius_m + k * LANES, summary->spread + k * LANES, light,
                c->radius_m[candidate], &at, cosine, out->most + k * LANES, out->near + k * LANES);
        lw_direct_unshadowed_points(d, candidate, &at, e);
        for (uint32_t i = 0; i < LANES; i++) {
            out->full[k * LANES + i] = e[i] * luminance;
            out->expected[k * LANES + i] = e[i] * cosine[i] * luminance;
            out->most[k * LANES + i] *= summary->filled[k * LANES + i] * e[i] * luminance;
            sum += out->expected[k * LANES + i];
        }
    }
    return sum;
}

/* Returns bit 0: some are weak, bit 1: some are full. */
LW_WIDE static uint32_t part_blocks(const struct lw_direct_outlook *restrict outlook,
                                    const float *restrict found, struct lw_direct_parts *restrict out) {
    uint32_t any = 0;
    for (uint32_t b = 0; b < BLOCKS; b++) {
        const float most = outlook->most[b], all = found[b] + most;
        const bool even = outlook->near[b] > EVEN_RADII, weak = even & (most < LW_DIRECT_SHARE_FAINT * all);
        out->weak[b] = (weak & (most > 0)) ? most / all : 0;
        out->full[b] = (weak | (even & !(most > 0))) ? 0 : 1;
        any |= (out->weak[b] > 0 ? 1u : 0u) | out->full[b] << 1;
    }
    return any;
}

/* Takes blocks that mirror much of the light out of the weak ones. Returns the bits of part_blocks(). */
static uint32_t part_finished(const struct lw_direct_job *job, const struct lw_direct_outlook *outlook,
                              uint32_t any, struct lw_direct_parts *out) {
    const struct lw_direct_work *w = job->work;
    for (uint32_t b = 0; b < BLOCKS; b++) {
        const struct lw_direct_block *block = &job->tile->block[b];
        float gain[LANES], greatest = 1;
        if (!block->finished || !(out->weak[b] > 0)) continue;
        lw_direct_unshadowed_weigh_mirrored(block, &w->gloss[b], gain);
        for (uint32_t i = 0; i < LANES; i++) greatest = fmaxf(greatest, gain[i]);
        const float bright = greatest * outlook->most[b];
        if (bright < LW_DIRECT_SHARE_FAINT * (w->summary.found[b] + bright)) continue;
        out->weak[b] = 0, out->full[b] = 1;
        any |= 2;
    }
    return any;
}

uint32_t lw_direct_weak_part(const struct lw_direct_job *job, const struct lw_direct_outlook *outlook,
                             struct lw_direct_parts *out) {
    /* the edge of a spot may cross a block */
    if (outlook && !job->tile->listed && !(job->direct->candidates.cos_reach[job->candidate] > -1)) {
        const uint32_t any = part_blocks(outlook, job->work->summary.found, out);
        return any & 1u && job->finished ? part_finished(job, outlook, any, out) : any;
    }
    for (uint32_t b = 0; b < BLOCKS; b++) out->weak[b] = 0, out->full[b] = 1;
    return 2;
}

/* Adds E to a block's pixels by their own normals. way: to the light, unit length */
LW_WIDE static void add_by_normals(struct lw_direct_block *restrict block,
                                   const struct lw_points16 *restrict p, struct lw_vec3 way,
                                   struct lw_vec3 e) {
    for (uint32_t i = 0; i < LANES; i++) {
        const float cosine = p->nx[i] * way.x + p->ny[i] * way.y + p->nz[i] * way.z;
        const float k = cosine > 0 ? cosine : 0;
        block->e[0][i] += k * e.x, block->e[1][i] += k * e.y, block->e[2][i] += k * e.z;
    }
}

/* A group is 2 x 2 blocks. */
enum { GROUP_SIDE = LW_DIRECT_TILE_SIDE / 2, GROUPS = GROUP_SIDE * GROUP_SIDE };

static uint32_t block_of(uint32_t group, uint32_t k) {
    const uint32_t x = group % GROUP_SIDE * 2 + (k & 1), y = group / GROUP_SIDE * 2 + (k >> 1);
    return y * LW_DIRECT_TILE_SIDE + x;
}

/* Takes one shadow ray for the weak blocks of a group. Returns its pixel. */
static uint32_t shoot_weakly(struct lw_direct_job *job, const struct lw_direct_parts *parts, uint32_t group,
                             uint32_t random) {
    struct lw_direct_work *w = job->work;
    uint32_t from = block_of(group, 0), lane = random % LANES;
    for (uint32_t k = 1; k < 4; k++)
        if (parts->weak[block_of(group, k)] > parts->weak[from]) from = block_of(group, k);
    while (!(job->tile->block[from].active >> lane & 1u)) lane = (lane + 1) % LANES;
    w->lit[from * LANES + lane] = 0;
    lw_direct_rays_shoot(job, from * LANES + lane, 0);
    return from * LANES + lane;
}

static void add_finished(struct lw_direct_block *block, struct lw_vec3 way, struct lw_vec3 e,
                         const struct lw_gloss_lit16 *lit) {
    struct lw_points16 bumped;
    float cosine[LANES];
    lw_direct_unshadowed_bump(block, &bumped);
    for (uint32_t i = 0; i < LANES; i++)
        cosine[i] = fmaxf(bumped.nx[i] * way.x + bumped.ny[i] * way.y + bumped.nz[i] * way.z, 0);
    lw_direct_unshadowed_add(cosine, lit, e, block);
}

/* weight: what the group's ray counts for */
static void add_to_block(const struct lw_direct_job *job, const struct lw_direct_outlook *outlook, uint32_t b,
                         float weight, struct lw_vec3 colour) {
    struct lw_direct_work *w = job->work;
    struct lw_direct_block *block = &job->tile->block[b];
    w->summary.found[b] += weight * outlook->expected[b];
    if (w->whole[b] && !block->finished) {
        const float e = weight * outlook->expected[b];
        w->weak[0][b] += e * colour.x, w->weak[1][b] += e * colour.y, w->weak[2][b] += e * colour.z;
        return;
    }
    const struct lw_direct_candidates *c = &job->direct->candidates;
    const struct lw_points16 *at = &w->summary.middle[b / LANES];
    const uint32_t i = b % LANES, from = job->candidate;
    const struct lw_vec3 way =
        lw_vec3_sub(lw_vec3(c->x[from], c->y[from], c->z[from]), lw_vec3(at->x[i], at->y[i], at->z[i]));
    const struct lw_vec3 unit = lw_vec3_normalize(way), e = lw_vec3_scale(colour, weight * outlook->full[b]);
    if (block->finished)
        add_finished(block, unit, e, &w->gloss[b]);
    else
        add_by_normals(block, &block->points, unit, e);
}

void lw_direct_weak_add(struct lw_direct_job *job, const struct lw_direct_outlook *outlook,
                        const struct lw_direct_parts *parts, struct lw_vec3 colour) {
    float weight[GROUPS];
    uint32_t group[GROUPS], pixel[GROUPS], count = 0;
    for (uint32_t g = 0; g < GROUPS; g++) {
        const float *at = parts->weak + block_of(g, 0), *below = at + LW_DIRECT_TILE_SIDE;
        const float chance = fmaxf(fmaxf(at[0], at[1]), fmaxf(below[0], below[1])) * (1 / SHARE_CHANCE);
        const uint32_t random = lw_random_hash2(job->seed, g);
        if (!(lw_random_unit(random) < chance)) continue;
        weight[count] = chance < 1 ? 1 / chance : 1;
        group[count] = g;
        pixel[count++] = shoot_weakly(job, parts, g, random);
    }
    lw_direct_rays_flush(job);
    for (uint32_t n = 0; n < count; n++) {
        if (!job->work->lit[pixel[n]]) continue;
        for (uint32_t k = 0; k < 4; k++) {
            const uint32_t b = block_of(group[n], k);
            if (parts->weak[b] > 0) add_to_block(job, outlook, b, weight[n], colour);
        }
    }
}
