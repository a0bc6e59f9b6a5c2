/* builtin_furnish.h: what stands and hangs in the atrium. Every function adds one thing to a mesh, at the
 * mesh's placement, with its material and texture state, which it leaves as it found them.
 * Threads: one mesh, one thread. */
#ifndef LW_COMMON_BUILTIN_FURNISH_H
#define LW_COMMON_BUILTIN_FURNISH_H

#include "common/builtin/builtin_mesh.h"

enum lw_builtin_vase {
    LW_BUILTIN_AMPHORA,
    LW_BUILTIN_KRATER,
    LW_BUILTIN_JAR,
    LW_BUILTIN_POT,
    LW_BUILTIN_VASE_COUNT
};

/** A vase of this height, open at the top; the inside is there as far as one can see. */
void lw_builtin_furnish_vase(struct lw_builtin_mesh *mesh, enum lw_builtin_vase kind, float height);

/** Soil that fills a pot of that height. */
void lw_builtin_furnish_soil(struct lw_builtin_mesh *mesh, float height);

/** A cloth over a rail: the rail runs along local X through the origin, `width` metres of it are covered; the
 * cloth falls `behind` metres on the -Z side and `front` on the +Z side, where it stays `clear` metres away
 * from the rail's axis from `clear_below` metres below the rail on. One sheet. */
struct lw_builtin_cloth {
    float width, behind, front, clear, clear_below;
    float phase; /* its folds' */
};
void lw_builtin_furnish_cloth(struct lw_builtin_mesh *mesh, const struct lw_builtin_cloth *cloth);

/** A palm of bent fronds, or a bush of broad leaves, growing from the origin. Sheets, to be masked. */
void lw_builtin_furnish_palm(struct lw_builtin_mesh *mesh, float height, uint32_t fronds, uint32_t seed);
void lw_builtin_furnish_bush(struct lw_builtin_mesh *mesh, float height, uint32_t leaves, uint32_t seed);

/** A round basin on the floor with its foot in the middle, and the water in it. */
void lw_builtin_furnish_basin(struct lw_builtin_mesh *mesh);
void lw_builtin_furnish_water(struct lw_builtin_mesh *mesh);

/** A lamp's metalwork: cap, cage, and a chain of this length up from the cap; and its globe. Centred on the
 * globe. */
void lw_builtin_furnish_lamp(struct lw_builtin_mesh *mesh, float radius, float chain);
void lw_builtin_furnish_globe(struct lw_builtin_mesh *mesh, float radius, uint32_t segments);

/** Three rings about a globe, of this outer radius; centred. */
void lw_builtin_furnish_armillary(struct lw_builtin_mesh *mesh, float radius);

#endif
