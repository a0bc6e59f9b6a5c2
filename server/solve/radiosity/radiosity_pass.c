#include "server/solve/radiosity/radiosity_pass.h"

#include "common/wide.h"

#include <string.h>

#define LANES LW_TRACE_WIDTH
/* Of a ray's length: the end lies off its surface as the start does, and this only keeps rounding out. */
#define RAY_SHARE (1 - 0x1p-20f)

LW_WIDE void lw_radiosity_pass_weigh(const struct lw_points16 *restrict at,
                                     const struct lw_shooter *restrict shooter, float near_m2,
                                     float out[restrict 16]) {
    const float px = shooter->position[0], py = shooter->position[1], pz = shooter->position[2],
                nx = shooter->normal[0], ny = shooter->normal[1], nz = shooter->normal[2],
                area = shooter->area_m2;
    for (int i = 0; i < LANES; i++) {
        const float x = px - at->x[i], y = py - at->y[i], z = pz - at->z[i];
        const float r2 = x * x + y * y + z * z;
        const float here = x * at->nx[i] + y * at->ny[i] + z * at->nz[i], there = -(x * nx + y * ny + z * nz);
        const float both = (here > 0 ? here : 0) * (there > 0 ? there : 0);
        out[i] = both / (r2 * (LW_PI * (r2 > near_m2 ? r2 : near_m2) + area) + 1e-37f);
    }
}

/* Both in one: rays towards a shooter. */
LW_WIDE static void aim(const struct lw_points16 *restrict at, const struct lw_shooter *restrict shooter,
                        struct lw_ray16 *restrict rays) {
    for (int i = 0; i < LANES; i++) {
        rays->dir_x[i] = shooter->position[0] - at->x[i];
        rays->dir_y[i] = shooter->position[1] - at->y[i];
        rays->dir_z[i] = shooter->position[2] - at->z[i];
    }
}

static uint16_t lit(const float weight[LANES], uint16_t active) {
    uint16_t mask = 0;
    for (int i = 0; i < LANES; i++) mask |= (uint16_t)((weight[i] > 0) << i);
    return mask & active;
}

struct sum {
    _Alignas(64) float e[3][LANES];
};

LW_WIDE static void add(const float weight[restrict LANES], const float flux[restrict 3],
                        struct sum *restrict sum) {
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < LANES; i++) sum->e[c][i] += weight[i] * flux[c];
}

static bool shines(const struct lw_shooter *shooter) {
    return shooter->flux_w[0] > 0 || shooter->flux_w[1] > 0 || shooter->flux_w[2] > 0;
}

/* One packet under way. */
struct flight {
    const struct lw_radiosity_pass *pass;
    const struct lw_patches_packet *packet;
    uint16_t *known; /* of visibility: its row; or NULL */
    struct lw_ray16 rays;
    struct sum sum;
    uint64_t count;
};

/* Which of the active patches see a shooter. */
static uint16_t trace(struct flight *f, uint32_t shooter, uint16_t active, float (*tint)[LANES]) {
    const struct lw_radiosity_pass *pass = f->pass;
    const unsigned flags = f->packet->coherent ? LW_TRACE_COHERENT : LW_TRACE_LIGHT;
    aim(&f->packet->at, &pass->shooters->shooter[shooter], &f->rays);
    f->count += (uint64_t)__builtin_popcount(active);
    return active & (uint16_t) ~(tint ? lw_trace_tinted16(pass->trace, flags, active, &f->rays, tint)
                                      : lw_trace_occluded16(pass->trace, flags, active, &f->rays));
}

static uint16_t seen(struct flight *f, uint32_t shooter, uint16_t active, float (*tint)[LANES]) {
    const struct lw_pair_visibility *visibility = f->pass->visibility;
    if (!visibility) return trace(f, shooter, active, tint);
    if (!visibility->known[shooter]) f->known[shooter] = trace(f, shooter, active, NULL);
    return f->known[shooter];
}

static void gather(struct flight *f) {
    const struct lw_patches_packet *packet = f->packet;
    const bool tints = lw_trace_tints(f->pass->trace) && !f->pass->visibility;
    memset(f->rays.t_near, 0, sizeof f->rays.t_near);
    memcpy(f->rays.org_x, packet->at.x, sizeof f->rays.org_x);
    memcpy(f->rays.org_y, packet->at.y, sizeof f->rays.org_y);
    memcpy(f->rays.org_z, packet->at.z, sizeof f->rays.org_z);
    for (int i = 0; i < LANES; i++) f->rays.t_far[i] = RAY_SHARE;
    for (uint32_t k = 0; k < f->pass->shooters->count; k++) {
        const struct lw_shooter *shooter = &f->pass->shooters->shooter[k];
        _Alignas(64) float weight[LANES];
        float tint[3][LANES];
        if (!shines(shooter)) continue;
        lw_radiosity_pass_weigh(&packet->at, shooter, f->pass->near_m2, weight);
        const uint16_t active = lit(weight, packet->active);
        if (!active) continue;
        const uint16_t sees = seen(f, k, active, tints ? tint : NULL);
        for (int i = 0; i < LANES; i++)
            if (!(sees >> i & 1)) weight[i] = 0;
        add(weight, shooter->flux_w, &f->sum);
        for (int c = 0; tints && c < 3; c++) /* what the tints add to 1 */
            for (int i = 0; i < LANES; i++)
                if (weight[i] > 0) f->sum.e[c][i] += weight[i] * shooter->flux_w[c] * (tint[c][i] - 1);
    }
}

uint64_t lw_radiosity_pass_run(const struct lw_radiosity_pass *pass, float *const out_e[3]) {
    uint64_t rays = 0;
#pragma omp parallel for schedule(dynamic, 4) num_threads(pass->threads) reduction(+ : rays)
    for (uint32_t p = 0; p < pass->patches->packet_count; p++) {
        const struct lw_patches_packet *packet = &pass->patches->packet[p];
        if (pass->cancel && *pass->cancel) continue;
        struct flight f = {.pass = pass, .packet = packet, .rays = {.salt = pass->salt}};
        if (pass->visibility) f.known = pass->visibility->mask + (size_t)p * pass->visibility->shooters;
        gather(&f);
        rays += f.count;
        for (int i = 0; i < LANES; i++)
            for (int c = 0; packet->active >> i & 1 && c < 3; c++) out_e[c][packet->texel[i]] = f.sum.e[c][i];
        lw_progress_step(pass->progress, 1);
    }
    for (uint32_t k = 0; pass->visibility && k < pass->shooters->count; k++)
        if (!(pass->cancel && *pass->cancel) && shines(&pass->shooters->shooter[k]))
            pass->visibility->known[k] = 1;
    return rays;
}
