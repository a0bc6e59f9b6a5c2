/* builtin_house.h: the architecture of the atrium: a court of 24 x 12 m between two storeys of round arches
 * on columns, with a gallery behind them. The ground floor is at 0. The middle of the court is the origin.
 * Its long sides run along X. Every function adds one part to a mesh, with the mesh's material and texture
 * state.
 * Threads: one mesh, one thread. */
#ifndef LW_COMMON_BUILTIN_HOUSE_H
#define LW_COMMON_BUILTIN_HOUSE_H

#include "common/builtin/builtin_mesh.h"

/* Metres. The columns' axes stand on the rectangle HALF_X x HALF_Z, one BAY apart. */
#define LW_HOUSE_BAY          3.0f
#define LW_HOUSE_HALF_X       12.0f
#define LW_HOUSE_HALF_Z       6.0f
#define LW_HOUSE_BAYS_X       8
#define LW_HOUSE_BAYS_Z       4
#define LW_HOUSE_GALLERY      3.0f  /* from the columns' axes to the wall */
#define LW_HOUSE_THICKNESS    0.30f /* half of an arcade's */
#define LW_HOUSE_COURT_Y      -0.15f
#define LW_HOUSE_LOWER_SPRING 3.0f
#define LW_HOUSE_LOWER_TOP    4.45f
#define LW_HOUSE_UPPER_FLOOR  4.85f
#define LW_HOUSE_PEDESTAL     0.90f
#define LW_HOUSE_UPPER_SPRING 7.85f
#define LW_HOUSE_UPPER_TOP    9.25f
#define LW_HOUSE_EAVE         9.70f

/** A column with base, entasis and capital, on the placement's origin. */
void lw_builtin_house_column(struct lw_builtin_mesh *mesh, float height, float radius);

/** A column of that height at every axis, from base_y up. */
void lw_builtin_house_columns(struct lw_builtin_mesh *mesh, float base_y, float height, float radius);

/** Arcade wall above the columns: fronts, backs, soffits. The upper storey's backs end at the ceiling, the
 * lower's at the vaults. */
void lw_builtin_house_arcade(struct lw_builtin_mesh *mesh, bool upper);

/** Mouldings around the arches of one storey. */
void lw_builtin_house_archivolts(struct lw_builtin_mesh *mesh, bool upper);

/** String course between the storeys, cornice under the eaves. */
void lw_builtin_house_cornices(struct lw_builtin_mesh *mesh);

/** Groin vaults over the lower gallery, and the ribs between them. */
void lw_builtin_house_vaults(struct lw_builtin_mesh *mesh);
void lw_builtin_house_ribs(struct lw_builtin_mesh *mesh);

/** Timber ceiling of the upper gallery: boards and beams. */
void lw_builtin_house_timber(struct lw_builtin_mesh *mesh);

/** Walls of the galleries from the dado up, the dado and the pilasters. No outside: backs stop light. */
void lw_builtin_house_walls(struct lw_builtin_mesh *mesh);
void lw_builtin_house_dado(struct lw_builtin_mesh *mesh, float floor_y);
void lw_builtin_house_pilasters(struct lw_builtin_mesh *mesh);

void lw_builtin_house_court_floor(struct lw_builtin_mesh *mesh, float border);
void lw_builtin_house_court_border(struct lw_builtin_mesh *mesh, float border);
void lw_builtin_house_lower_floor(struct lw_builtin_mesh *mesh);
void lw_builtin_house_step(struct lw_builtin_mesh *mesh);
void lw_builtin_house_upper_floor(struct lw_builtin_mesh *mesh);

/** Pedestals, plinth, balusters and rail between the upper columns. */
void lw_builtin_house_balustrade(struct lw_builtin_mesh *mesh);

void lw_builtin_house_roof(struct lw_builtin_mesh *mesh);

#endif
