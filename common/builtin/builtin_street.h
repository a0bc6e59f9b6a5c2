/* builtin_street.h: the space between the buildings of the city: paving, street lamps, trees, furniture of
 * streets and squares, carriages, the wall around it all.
 * A block's tile is LW_STREET_PITCH square, its middle at the origin: pavement (y = 0) around the block, and
 * half of the carriageways beyond it. Every function adds one thing to a mesh and leaves its placement as it
 * found it.
 * Threads: one mesh, one thread. */
#ifndef LW_COMMON_BUILTIN_STREET_H
#define LW_COMMON_BUILTIN_STREET_H

#include "common/builtin/builtin_building.h"

/* Metres from the middle of a block. */
#define LW_STREET_FRONT  (0.5f * LW_BUILDING_BLOCK)
#define LW_STREET_WALK   (LW_STREET_FRONT + 1.2f) /* where people walk: nothing stands here */
#define LW_STREET_LAMPS  (LW_STREET_FRONT + 2.5f)
#define LW_STREET_KERB   (LW_STREET_FRONT + 3.0f)
#define LW_STREET_LANE   (LW_STREET_FRONT + 5.0f)
#define LW_STREET_PITCH  (2.0f * (LW_STREET_FRONT + 7.0f))
#define LW_STREET_ROAD_Y -0.15f

struct lw_builtin_street_paints {
    struct lw_builtin_paint setts, paving, kerb, stripe, stone, grass, gravel, water, bark, foliage, iron,
        lamp, wood, awning, soil, wall, roof, paintwork, pale, glass, headlamp, taillamp, cabin;
};

/** Pavement, kerb, crossings and half carriageways of one tile. */
void lw_builtin_street_tile(struct lw_builtin_mesh *mesh, const struct lw_builtin_street_paints *paints);

/** Furniture of the pavement around a block: twelve lamps, benches, bollards. */
void lw_builtin_street_furniture(struct lw_builtin_mesh *mesh, const struct lw_builtin_street_paints *paints);

/** A street lamp, 4.4 m high; its lantern is of the paint `lamp`. */
void lw_builtin_street_lamp(struct lw_builtin_mesh *mesh, const struct lw_builtin_street_paints *paints);

/** A leafy tree of this height, 0 < height < 14 m. */
void lw_builtin_street_tree(struct lw_builtin_mesh *mesh, const struct lw_builtin_street_paints *paints,
                            float height, uint32_t seed);

/** Grounds inside a block, 50 m square: a garden court 26 m square, a paved square with its fountain, column
 * and stalls, a churchyard, a park with a pond. Trees are not among them. */
void lw_builtin_street_garden(struct lw_builtin_mesh *mesh, const struct lw_builtin_street_paints *paints);
void lw_builtin_street_square(struct lw_builtin_mesh *mesh, const struct lw_builtin_street_paints *paints);
void lw_builtin_street_churchyard(struct lw_builtin_mesh *mesh,
                                  const struct lw_builtin_street_paints *paints);
void lw_builtin_street_park(struct lw_builtin_mesh *mesh, const struct lw_builtin_street_paints *paints);
void lw_builtin_street_court(struct lw_builtin_mesh *mesh, const struct lw_builtin_street_paints *paints);

/** A motor car and a tram, heading to -Z, wheels on y = 0. The tram is lit inside. */
void lw_builtin_street_car(struct lw_builtin_mesh *mesh, const struct lw_builtin_street_paints *paints);
void lw_builtin_street_tram(struct lw_builtin_mesh *mesh, const struct lw_builtin_street_paints *paints);

/** One tile's length of the town's rim towards +Z from z = 0: the other half of the carriageway, pavement,
 * town wall and its tower; and what closes a corner of the rim, towards +X and +Z. */
void lw_builtin_street_rim(struct lw_builtin_mesh *mesh, const struct lw_builtin_street_paints *paints);
void lw_builtin_street_rim_corner(struct lw_builtin_mesh *mesh,
                                  const struct lw_builtin_street_paints *paints);
#define LW_STREET_RIM 12.0f /* m, its depth */

/** Meadows and hills around a square of this half side, out to `width` metres from it. */
void lw_builtin_street_country(struct lw_builtin_mesh *mesh, const struct lw_builtin_street_paints *paints,
                               float half, float width);

#endif
