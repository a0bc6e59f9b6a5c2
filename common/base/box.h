/* box.h: boxes along the axes.
 * Threads: pure functions, [any]. */
#ifndef LW_COMMON_BASE_BOX_H
#define LW_COMMON_BASE_BOX_H

#include "common/base/vec.h"

struct lw_box {
    struct lw_vec3 low, high; /* low.x > high.x: empty */
};

/** A box that holds nothing. Points and boxes that are added to it are held from then on. */
#define LW_BOX_EMPTY ((struct lw_box){{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}})

static inline bool lw_box_is_empty(const struct lw_box *box) { return !(box->low.x <= box->high.x); }

static inline void lw_box_add(struct lw_box *box, const struct lw_box *other) {
    box->low = lw_vec3_min(box->low, other->low);
    box->high = lw_vec3_max(box->high, other->high);
}
static inline void lw_box_add_point(struct lw_box *box, struct lw_vec3 p) {
    lw_box_add(box, &(struct lw_box){p, p});
}

static inline struct lw_vec3 lw_box_size(const struct lw_box *box) {
    return lw_vec3_sub(box->high, box->low);
}
static inline struct lw_vec3 lw_box_middle(const struct lw_box *box) {
    return lw_vec3_scale(lw_vec3_add(box->low, box->high), 0.5f);
}
/** The radius of the sphere through its corners. */
static inline float lw_box_radius(const struct lw_box *box) {
    return 0.5f * lw_vec3_length(lw_box_size(box));
}

/** Whether it would hold a point if its sides lay `margin` further out. */
static inline bool lw_box_holds(const struct lw_box *box, struct lw_vec3 p, float margin) {
    return p.x >= box->low.x - margin && p.y >= box->low.y - margin && p.z >= box->low.z - margin &&
           p.x <= box->high.x + margin && p.y <= box->high.y + margin && p.z <= box->high.z + margin;
}

/** From a point to the nearest one of the box; 0 within. */
static inline float lw_box_distance(const struct lw_box *box, struct lw_vec3 p) {
    return lw_vec3_length(lw_vec3_sub(p, lw_vec3_max(box->low, lw_vec3_min(box->high, p))));
}

/** A corner, 0 to 7: bits 0, 1 and 2 choose the low side along x, y and z. */
static inline struct lw_vec3 lw_box_corner(const struct lw_box *box, unsigned corner) {
    return lw_vec3(corner & 1 ? box->low.x : box->high.x, corner & 2 ? box->low.y : box->high.y,
                   corner & 4 ? box->low.z : box->high.z);
}

/** The box along the axes that holds all corners of a box that has been transformed. */
static inline struct lw_box lw_box_moved(const struct lw_affine *t, const struct lw_box *box) {
    struct lw_box moved = LW_BOX_EMPTY;
    for (unsigned i = 0; i < 8; i++) lw_box_add_point(&moved, lw_affine_point(t, lw_box_corner(box, i)));
    return moved;
}

#endif
