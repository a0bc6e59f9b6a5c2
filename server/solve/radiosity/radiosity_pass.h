/* radiosity_pass.h: one bounce of radiosity: what every patch gets from all shooters.
 * Flow:    patches, shooters -> [radiosity_pass] -> E per texel
 * Threads: one thread calls, workers inside: each packet of sixteen patches is one worker's, so that the sum
 *          of a patch always has the same order.
 * After:   Kahl 2023; the disc in the form factor: Wallace et al. 1989.
 *
 *   E_i = sum over j of flux_j V_ij cos_i cos_j / (pi r^2 + A_j)
 *
 * One ray a pair, between two lifted places, and so short at both ends. The area in the denominator
 * makes of a shooter a disc: without it neighbours in a corner, less than their size apart, would get more
 * than the shooter has. Sixteen patches meet a shooter in one packet of rays. Pairs of which one is behind
 * the other take no ray. */
#ifndef LW_RADIOSITY_RADIOSITY_PASS_H
#define LW_RADIOSITY_RADIOSITY_PASS_H

#include "common/base/progress.h"
#include "server/solve/radiosity/pair_visibility.h"

struct lw_radiosity_pass {
    const struct lw_patches *patches;
    const struct lw_shooters *shooters; /* shooters without flux cost nothing */
    const struct lw_trace *trace;
    uint32_t salt;
    float near_m2; /* r^2 counts as this at least: points (virtual_lights.h) instead of discs. 0: as it is */
    struct lw_pair_visibility
        *visibility;              /* NULL: every ray is traced. Else pairs that are known take none */
    const _Atomic bool *cancel;   /* may be NULL */
    struct lw_progress *progress; /* a step is a packet */
    int threads;
};

/** Writes E, W/m^2, of every patch; other texels stay as they are. Returns rays traced. */
uint64_t lw_radiosity_pass_run(const struct lw_radiosity_pass *pass, float *const out_e[3]);

#endif
