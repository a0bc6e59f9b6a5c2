#include "server/solve/radiosity/radiosity_pass.h"

#include "common/base/invariant.h"
#include "common/light/form16.h"

#include <string.h>

#define LANES LW_TRACE_WIDTH

struct sum {
    _Alignas(64) float e[3][LANES];
};

static bool shines(const struct lw_shooter *shooter) {
    return shooter->flux_w[0] > 0 || shooter->flux_w[1] > 0 || shooter->flux_w[2] > 0;
}

/* One packet under way. */
struct flight {
    const struct lw_radiosity_pass *pass;
    const struct lw_patches_packet *packet;
    uint16_t *known; /* its row of visibility, or NULL */
    struct lw_ray16 rays;
    struct sum sum;
    uint64_t count;
};

/* Which of the active patches see a shooter. */
static uint16_t trace(struct flight *f, uint32_t shooter, uint16_t active, float (*tint)[LANES]) {
    const struct lw_radiosity_pass *pass = f->pass;
    const unsigned flags = f->packet->coherent ? LW_TRACE_COHERENT : LW_TRACE_LIGHT;
    lw_form16_aim(&f->packet->at, pass->shooters->shooter[shooter].position, &f->rays);
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
    lw_form16_start(&packet->at, &f->rays);
    for (uint32_t k = 0; k < f->pass->shooters->count; k++) {
        const struct lw_shooter *shooter = &f->pass->shooters->shooter[k];
        _Alignas(64) float weight[LANES];
        float tint[3][LANES];
        if (!shines(shooter)) continue;
        lw_form16_weigh(&packet->at, shooter->position, shooter->normal, shooter->area_m2, f->pass->near_m2,
                        weight);
        const uint16_t active = lw_form16_lit(weight) & packet->active;
        if (!active) continue;
        const uint16_t sees = seen(f, k, active, tints ? tint : NULL);
        for (int i = 0; i < LANES; i++)
            if (!(sees >> i & 1)) weight[i] = 0;
        lw_form16_add(weight, shooter->flux_w, f->sum.e);
        for (int c = 0; tints && c < 3; c++) /* what the tints add to 1 */
            for (int i = 0; i < LANES; i++)
                if (weight[i] > 0) f->sum.e[c][i] += weight[i] * shooter->flux_w[c] * (tint[c][i] - 1);
    }
}

uint64_t lw_radiosity_pass_run(const struct lw_radiosity_pass *pass, float *const out_e[3]) {
    uint64_t rays = 0;
    LW_INVARIANT(!pass->visibility || (pass->visibility->packets == pass->patches->packet_count &&
                                       pass->visibility->shooters == pass->shooters->count));
#pragma omp parallel for schedule(dynamic, 4) num_threads(pass->threads) reduction(+ : rays)
    for (uint32_t p = 0; p < pass->patches->packet_count; p++) {
        const struct lw_patches_packet *packet = &pass->patches->packet[p];
        if (pass->cancel && *pass->cancel) continue;
        struct flight f = {.pass = pass, .packet = packet, .rays = {.salt = pass->salt}};
        if (pass->visibility) f.known = pass->visibility->mask + (size_t)p * pass->visibility->shooters;
        gather(&f);
        rays += f.count;
        for (int i = 0; i < LANES; i++)
            LW_INVARIANT_DEAR(!(packet->active >> i & 1) ||
                              (f.sum.e[0][i] >= 0 && f.sum.e[1][i] >= 0 && f.sum.e[2][i] >= 0));
        for (int i = 0; i < LANES; i++)
            for (int c = 0; packet->active >> i & 1 && c < 3; c++) out_e[c][packet->texel[i]] = f.sum.e[c][i];
        lw_progress_step(pass->progress, 1);
    }
    for (uint32_t k = 0; pass->visibility && k < pass->shooters->count; k++)
        if (!(pass->cancel && *pass->cancel) && shines(&pass->shooters->shooter[k]))
            pass->visibility->known[k] = 1;
    return rays;
}
