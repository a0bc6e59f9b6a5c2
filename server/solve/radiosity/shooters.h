/* shooters.h: the patches that send light in a pass: each by itself, or one for many.
 * Flow:    patches, what each sends -> [shooters] -> radiosity_pass
 * Threads: one thread calls, workers inside; then [any].
 *
 * A shooter stands for the covered texels of one chart in a window of side x side texels (Kahl 2023):
 *   none      each texel for itself
 *   stride    the window's first texel for all: its place, what it sends, the area of all
 *   random    a texel sampled by area, with a number of its window's own: unbiased over frames
 *   mip       their mean place, mean normal and total flux */
#ifndef LW_RADIOSITY_SHOOTERS_H
#define LW_RADIOSITY_SHOOTERS_H

#include "server/solve/radiosity/patches.h"
#include "server/solve/state/solver_terms.h"

#include <string.h>

/* One cache line. */
struct lw_shooter {
    _Alignas(64) float position[3], normal[3]; /* world space */
    float area_m2, flux_w[3];                  /* pi x radiance x area: what it sends into its hemisphere */
    uint32_t first, count, texel; /* its members; the one that stands for all (none of them: MIP) */
};

static inline void lw_shooter_set_place(struct lw_shooter *shooter, struct lw_vec3 position_ws,
                                        struct lw_vec3 normal_ws) {
    memcpy(shooter->position, &position_ws, sizeof shooter->position);
    memcpy(shooter->normal, &normal_ws, sizeof shooter->normal);
}

struct lw_shooters {
    const struct lw_patches *patches;
    struct lw_shooter *shooter;
    uint32_t count, capacity;
    uint32_t *member; /* texels, shooter by shooter */
    enum lw_undersample undersample;
    uint32_t side; /* a window's, texels */
};

/** side: 0: 1/128 of the side of a square that holds all patches. Both outlive the shooters.
 * Errors: LW_NO_MEMORY; finish them then. */
LW_MUST_CHECK enum lw_status lw_shooters_init(struct lw_shooters *shooters, const struct lw_patches *patches,
                                              enum lw_undersample undersample, uint32_t side);
void lw_shooters_finish(struct lw_shooters *shooters);

/** Groups placed patches, and chooses who stands for whom. turn: another one for each frame. */
void lw_shooters_place(struct lw_shooters *shooters, uint32_t seed, uint32_t turn);

/** Sets what they send. radiance: per texel of the global numbering, `stride` floats apart, W/(m^2 sr). */
void lw_shooters_charge(struct lw_shooters *shooters, const float *radiance, uint32_t stride, int threads);

/** Groups placed patches by what they send, and sets it: a quad-tree over each block of 16 x 16 texels, whose
 * squares stay whole where between any two of their quarters |dL| / (2 L) + |dn| / 2 < threshold. dL, dn: of
 * mean radiance and mean normal; L: the mean of all patches that send something. Each square is its mean. */
void lw_shooters_subdivide(struct lw_shooters *shooters, float threshold, const float *radiance,
                           uint32_t stride);

size_t lw_shooters_memory_bytes(const struct lw_shooters *shooters);

#endif
