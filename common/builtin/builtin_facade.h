/* builtin_facade.h: fronts of the city's buildings: walls with openings, and what fills, frames and crowns
 * these. A front stands in the plane z = 0 of the mesh's placement, from x = 0 to its width, y up from the
 * pavement, and faces +Z. Backs are not built: nobody enters.
 * Threads: one mesh, one thread. */
#ifndef LW_COMMON_BUILTIN_FACADE_H
#define LW_COMMON_BUILTIN_FACADE_H

#include "common/builtin/builtin_mesh.h"

/** A material and how its texture is laid: by lw_builtin_mesh_use(). */
struct lw_builtin_paint {
    uint32_t material;
    float metres; /* one repeat's */
};
/** Paints the next parts by their place in object space, or along their own rows and columns. */
void lw_builtin_facade_use(struct lw_builtin_mesh *mesh, struct lw_builtin_paint paint);
void lw_builtin_facade_use_along(struct lw_builtin_mesh *mesh, struct lw_builtin_paint paint);

struct lw_builtin_facade_paints {
    struct lw_builtin_paint wall, base, trim, frame, glass, glow, shutter, door, iron, awning, roof;
};

enum lw_builtin_ground {
    LW_FACADE_GROUND_WINDOWS,
    LW_FACADE_GROUND_SHOPS,
    LW_FACADE_GROUND_NONE /* storeys alone; the front starts at ground_m */
};
enum {
    LW_FACADE_SHUTTERS = 1,
    LW_FACADE_HOODS = 2,
    LW_FACADE_PEDIMENTS = 4,
    LW_FACADE_BALCONIES = 8, /* on the first storey, at every other window */
    LW_FACADE_PILASTERS = 16,
    LW_FACADE_CORNICE = 32,
    LW_FACADE_DOOR = 64 /* in the middle of the ground floor */
};

struct lw_builtin_facade {
    const struct lw_builtin_facade_paints *paints;
    float width, ground_m, storey_m; /* m */
    uint32_t bays, storeys;          /* storeys above the ground floor */
    float window_m[2];               /* width and height of the windows above the ground floor */
    enum lw_builtin_ground ground;
    unsigned features; /* LW_FACADE_SHUTTERS... */
    uint32_t seed;     /* for random choices, such as the lit windows */
    float lit;         /* share of the windows */
};
void lw_builtin_facade_build(struct lw_builtin_mesh *mesh, const struct lw_builtin_facade *facade);

/** Height of the wall above the pavement, m. */
float lw_builtin_facade_height(const struct lw_builtin_facade *facade);

/** A plain wall without openings, from y = bottom to top. */
void lw_builtin_facade_blank(struct lw_builtin_mesh *mesh, struct lw_builtin_paint paint, float width,
                             float bottom, float top);

/** A rectangle [x0, x1] x [y0, y1] of wall with a round-headed opening in its middle that reaches down to y0:
 * `width` wide, the arch springing at y = spring. depth: of its jambs and soffit; back: whether the wall is
 * seen from behind too. */
struct lw_builtin_arch {
    float x0, y0, x1, y1, width, spring, depth;
    bool back;
};
void lw_builtin_facade_arch(struct lw_builtin_mesh *mesh, const struct lw_builtin_arch *arch);

/** Fills such an opening with glass and bars, `inset` behind the wall. */
void lw_builtin_facade_arch_glass(struct lw_builtin_mesh *mesh, const struct lw_builtin_facade_paints *paints,
                                  const struct lw_builtin_arch *arch, bool lit);

/** A window with reveal, frame, bars, sill and what `features` says; its opening's lower left corner is (x,
 * y). */
void lw_builtin_facade_window(struct lw_builtin_mesh *mesh, const struct lw_builtin_facade *facade, float x,
                              float y, float width, float height, bool lit);

/** A cornice along [0, width], hanging below y = top, with dentils. */
void lw_builtin_facade_cornice(struct lw_builtin_mesh *mesh, struct lw_builtin_paint paint, float width,
                               float top);

/** Balusters under a rail along [x0, x1] from y on, `pitch` apart, in the plane z. */
void lw_builtin_facade_balustrade(struct lw_builtin_mesh *mesh, struct lw_builtin_paint paint, float x0,
                                  float x1, float y, float z, float pitch);

/** An iron railing likewise. */
void lw_builtin_facade_railing(struct lw_builtin_mesh *mesh, struct lw_builtin_paint paint, float x0,
                               float x1, float y, float z);

#endif
