/* builtin_building.h: the buildings of the city, each one mesh. The pavement is at y = 0.
 * Every function adds one building to a mesh and leaves its placement as it found it.
 * Threads: one mesh, one thread. */
#ifndef LW_COMMON_BUILTIN_BUILDING_H
#define LW_COMMON_BUILTIN_BUILDING_H

#include "common/builtin/builtin_facade.h"

#define LW_BUILDING_BLOCK     50.0f /* m, side of a block between its street fronts */
#define LW_BUILDING_CORNER    14.0f /* side of a corner house */
#define LW_BUILDING_ROW_WIDTH 11.0f /* two of them stand between two corner houses */
#define LW_BUILDING_ROW_DEPTH 12.0f

/** Looks of a house: its paints, its windows, its height. */
struct lw_builtin_house_style {
    const struct lw_builtin_facade_paints *paints;
    uint32_t storeys, bays; /* a row house's; corner houses have bays to the same measure */
    enum lw_builtin_ground ground;
    unsigned features; /* LW_FACADE_... of street fronts */
    bool turret;       /* corner houses: on the corner */
    uint32_t seed;
};

/** A terraced house; the origin is the middle of its street front, which faces +Z. */
void lw_builtin_building_row_house(struct lw_builtin_mesh *mesh, const struct lw_builtin_house_style *style);

/** A house with street fronts towards +Z and +X that meet at the origin. */
void lw_builtin_building_corner_house(struct lw_builtin_mesh *mesh,
                                      const struct lw_builtin_house_style *style);

/** A quarter of a palace around a court: the wing on the +Z side of a block whose middle is the origin. Four
 * of them, turned by right angles, close. Arcades run along street and court. */
void lw_builtin_building_palace_wing(struct lw_builtin_mesh *mesh,
                                     const struct lw_builtin_facade_paints *paints, uint32_t seed);

/** A tower of 19 storeys on a base that fills the block around the origin. */
void lw_builtin_building_tower(struct lw_builtin_mesh *mesh, const struct lw_builtin_facade_paints *paints,
                               uint32_t seed);

/** A church along Z, its bell tower to +Z, in the middle of a block. */
void lw_builtin_building_church(struct lw_builtin_mesh *mesh, const struct lw_builtin_facade_paints *paints);

#endif
