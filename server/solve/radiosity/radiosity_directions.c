#include "server/solve/radiosity/radiosity_directions.h"

#include "common/base/invariant.h"
#include "common/base/wide.h"
#include "common/light/direction.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define LANES LW_TRACE_WIDTH
/* Places a side of the disc's square where a circle may be centred: with 1,024 directions some 50 lie about
 * each. */
#define GRID 256

#define RELAXATIONS 8

/* Sum over the places nearest to a point. */
struct cell {
    float x, y;
    uint32_t count;
};

static float place_of(uint32_t i) { return ((float)i + 0.5f) * (2.0f / GRID) - 1; }

/* Each point goes to the middle of the places nearest to it (Lloyd 1982): circles alone leave the rim thin,
 * and the mean cosine 5 % too high. */
static void relax(struct lw_radiosity_directions *directions, struct cell *cell) {
    for (uint32_t n = 0; n < directions->count; n++) cell[n] = (struct cell){0};
    for (uint32_t i = 0; i < GRID * GRID; i++) {
        const float x = place_of(i % GRID), y = place_of(i / GRID);
        float nearest = INFINITY;
        uint32_t best = 0;
        if (x * x + y * y >= 1) continue;
        for (uint32_t n = 0; n < directions->count; n++) {
            const float u = directions->point[n][0] - x, v = directions->point[n][1] - y;
            if (u * u + v * v < nearest) nearest = u * u + v * v, best = n;
        }
        cell[best].x += x, cell[best].y += y, cell[best].count++;
    }
    for (uint32_t n = 0; n < directions->count; n++) {
        LW_INVARIANT(cell[n].count > 0); /* no two points are one */
        directions->point[n][0] = cell[n].x / (float)cell[n].count;
        directions->point[n][1] = cell[n].y / (float)cell[n].count;
    }
}

enum lw_status lw_radiosity_directions_init(struct lw_radiosity_directions *directions, uint32_t count) {
    *directions = (struct lw_radiosity_directions){.count = count};
    if (!count) return LW_OK;
    float *room =
        malloc((size_t)GRID * GRID * sizeof *room); /* diameter of the empty circle there, squared */
    directions->point = malloc(count * sizeof *directions->point);
    struct cell *cell = malloc(count * sizeof *cell);
    if (!room || !cell || !directions->point) {
        free(room);
        free(cell);
        lw_radiosity_directions_finish(directions);
        return LW_NO_MEMORY;
    }
    /* The rim counts as a mirror: a point keeps from it half of what it keeps from others. */
    for (uint32_t y = 0; y < GRID; y++)
        for (uint32_t x = 0; x < GRID; x++) {
            const float radius = hypotf(place_of(x), place_of(y)), rim = 2 * (1 - radius);
            room[y * GRID + x] = radius < 1 ? rim * rim : -1;
        }
    for (uint32_t n = 0; n < count; n++) {
        uint32_t best = 0;
        for (uint32_t i = 1; i < GRID * GRID; i++)
            if (room[i] > room[best]) best = i;
        float *p = directions->point[n];
        p[0] = place_of(best % GRID), p[1] = place_of(best / GRID);
        for (uint32_t i = 0; i < GRID * GRID; i++) {
            const float x = place_of(i % GRID) - p[0], y = place_of(i / GRID) - p[1];
            room[i] = fminf(room[i], x * x + y * y);
        }
    }
    for (int k = 0; k < RELAXATIONS; k++) relax(directions, cell);
    free(room);
    free(cell);
    return LW_OK;
}

void lw_radiosity_directions_finish(struct lw_radiosity_directions *directions) {
    free(directions->point);
    *directions = (struct lw_radiosity_directions){0};
}

LW_WIDE static void aim(const struct lw_points16 *restrict at, struct lw_vec3 local,
                        struct lw_ray16 *restrict rays) {
    for (int i = 0; i < LANES; i++) {
        const struct lw_vec3 d = lw_direction_about(lw_vec3(at->nx[i], at->ny[i], at->nz[i]), local);
        rays->dir_x[i] = d.x;
        rays->dir_y[i] = d.y;
        rays->dir_z[i] = d.z;
    }
}

static uint64_t gather(const struct lw_radiosity_gather *g, const struct lw_patches_packet *packet,
                       float *const out_e[3]) {
    const float c = cosf(g->turn), s = sinf(g->turn), weight = LW_PI / (float)g->directions->count;
    LW_INVARIANT_DEAR(g->directions->count > 0 && packet->active);
    const unsigned flags = packet->coherent ? LW_TRACE_COHERENT : LW_TRACE_LIGHT;
    float sum[3][LANES] = {{0}};
    struct lw_ray16 rays;
    struct lw_hit16 hits;
    memset(rays.t_near, 0, sizeof rays.t_near);
    memcpy(rays.org_x, packet->at.x, sizeof rays.org_x);
    memcpy(rays.org_y, packet->at.y, sizeof rays.org_y);
    memcpy(rays.org_z, packet->at.z, sizeof rays.org_z);
    for (int i = 0; i < LANES; i++) rays.t_far[i] = INFINITY;
    for (uint32_t n = 0; n < g->directions->count; n++) {
        const float *p = g->directions->point[n];
        LW_INVARIANT_DEAR(p[0] * p[0] + p[1] * p[1] < 1);
        const float x = c * p[0] - s * p[1], y = s * p[0] + c * p[1];
        aim(&packet->at, lw_vec3(x, y, sqrtf(fmaxf(0, 1 - x * x - y * y))), &rays);
        rays.salt = g->salt + n;
        lw_trace_closest16(g->sides->trace, flags, packet->active, &rays, &hits);
        uint32_t texel[LANES];
        lw_wall_sides_at16(g->sides, packet->active, &rays, &hits, texel);
        for (int i = 0; i < LANES; i++)
            for (int k = 0; texel[i] != LW_TEXEL_NONE && k < 3; k++)
                sum[k][i] += g->radiance[(size_t)texel[i] * g->stride + (size_t)k];
    }
    for (int i = 0; i < LANES; i++)
        for (int k = 0; packet->active >> i & 1 && k < 3; k++)
            out_e[k][packet->texel[i]] = sum[k][i] * weight;
    return (uint64_t)__builtin_popcount(packet->active) * g->directions->count;
}

uint64_t lw_radiosity_directions_run(const struct lw_radiosity_gather *g, float *const out_e[3]) {
    uint64_t rays = 0;
#pragma omp parallel for schedule(dynamic, 16) num_threads(g->threads) reduction(+ : rays)
    for (uint32_t p = 0; p < g->patches->packet_count; p++) {
        if (g->cancel && *g->cancel) continue;
        rays += gather(g, &g->patches->packet[p], out_e);
        lw_progress_step(g->progress, 1);
    }
    return rays;
}
