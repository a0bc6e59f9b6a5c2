/* lightmap_shape.h: convex hulls, and the smallest rectangle around a chart.
 * Threads: pure functions, [any]. */
#ifndef LW_COMMON_LIGHTMAP_SHAPE_H
#define LW_COMMON_LIGHTMAP_SHAPE_H

#include "common/base/vec.h"
#include "common/lightmap/lightmap.h"

#include <stdint.h>

/* Texels of a rectangle beyond its content, on a side: both gutters, and half a block lost to rounding. */
#define LW_LIGHTMAP_SHAPE_MARGIN (2.0f * LW_LIGHTMAP_GUTTER + LW_LIGHTMAP_BLOCK / 2.0f)

/** A rectangle at an angle: it spans from low to low + size in the frame (axis, axis turned left), in which
 * the chart is stretched. */
struct lw_lightmap_box {
    struct lw_vec2 axis;    /* unit */
    struct lw_vec2 stretch; /* along the frame's axes; 1 unless the chart is refined */
    struct lw_vec2 low, size;
};

/** Convex hull, counter-clockwise. Sorts point; out_hull has room for count + 1. Returns the number of
 * corners. */
uint32_t lw_lightmap_shape_hull(struct lw_vec2 *point, uint32_t count, struct lw_vec2 *out_hull);

/** The box around a hull that costs least in an atlas where every rectangle has a margin (texels, both sides
 * together). The longer side lies along the axis. */
struct lw_lightmap_box lw_lightmap_shape_box(const struct lw_vec2 *hull, uint32_t count, float margin);

/** The same box, turned by a right angle. */
struct lw_lightmap_box lw_lightmap_shape_turned(const struct lw_lightmap_box *box);

/** Texels that a box takes in an atlas, about. */
static inline float lw_lightmap_shape_cost(struct lw_lightmap_box box) {
    float least = LW_LIGHTMAP_BLOCK / 2.0f;
    return (fmaxf(box.size.x, least) + LW_LIGHTMAP_SHAPE_MARGIN) *
           (fmaxf(box.size.y, least) + LW_LIGHTMAP_SHAPE_MARGIN);
}

static inline struct lw_vec2 lw_lightmap_shape_local(const struct lw_lightmap_box *box, struct lw_vec2 p) {
    return (struct lw_vec2){box->stretch.x * (box->axis.x * p.x + box->axis.y * p.y) - box->low.x,
                            box->stretch.y * (box->axis.x * p.y - box->axis.y * p.x) - box->low.y};
}

#endif
