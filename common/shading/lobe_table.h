/* lobe_table.h: the share of light that rough mirrors send back, by angle and roughness.
 * Flow:    integrals at the first question -> [lobe_table] -> lobes, clients' shaders
 * Threads: [any].
 * After:   Karis 2013 (the split sum: two integrals serve every Fresnel reflectance); Kulla and Conty 2017.
 *
 * GGX with height-correlated Smith masking, alpha = roughness^2, scattered once. With Schlick's F = f0 +
 * (f90 - f0) c, c = (1 - cos)^5, a mirror sends back f0 a + f90 b of the light that comes from a direction: a
 * is the integral of 1 - c, b of c. */
#ifndef LW_COMMON_LOBE_TABLE_H
#define LW_COMMON_LOBE_TABLE_H

#include <stdint.h>

/* Cosines and roughnesses: entry i is at cosine (i / (SIDE - 1))^2, entry j at roughness j / (SIDE - 1). */
#define LW_LOBE_TABLE_SIDE 32

struct lw_lobe_share {
    float a, b;
};

/** The share for light along a direction. cosine: with the normal, in [0, 1]; roughness in [0, 1]. */
struct lw_lobe_share lw_lobe_table_at(float cosine, float roughness);
/** The mean over all directions, weighted by their cosines. */
struct lw_lobe_share lw_lobe_table_mean(float roughness);

/** The table for shaders: LW_LOBE_TABLE_SIDE rows, one for each roughness, of as many entries. */
const struct lw_lobe_share *lw_lobe_table(void);
/** The same in half the memory, for vectors: 65535 a in the lower 16 bits, 65535 b in the upper ones. */
const uint32_t *lw_lobe_table_packed(void);

#endif
