/* lightmap_order.h: an order of charts in which neighbours lie near one another and look the same way.
 * What lies together in an atlas is solved, sent and forgotten together, and traces its rays together.
 * Threads: pure function on the caller's memory. */
#ifndef LW_COMMON_LIGHTMAP_ORDER_H
#define LW_COMMON_LIGHTMAP_ORDER_H

#include "common/vec.h"

#include <stdint.h>

/** One thing to be put in order. */
struct lw_lightmap_spot {
    struct lw_vec3 centre; /* texels */
    struct lw_vec3 normal; /* unit, or shorter where it curves */
    float area;            /* halves are halves of it */
    uint32_t id;           /* the caller's */
};

/** Sorts by halving, again and again, along the axis on which they differ most: one of space, or one of the
 * normal. The same order whatever the order before, if ids differ. */
void lw_lightmap_order(struct lw_lightmap_spot *spot, uint32_t count);

#endif
