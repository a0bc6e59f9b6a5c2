/* lightmap_order.h: sorts charts so that neighbours in the order are near each other and face the same way.
 * Charts that lie together in an atlas are solved, sent and evicted together, and their rays are coherent.
 * Threads: pure function on the caller's memory. */
#ifndef LW_COMMON_LIGHTMAP_ORDER_H
#define LW_COMMON_LIGHTMAP_ORDER_H

#include "common/base/vec.h"

#include <stdint.h>

/** One thing to be put in order. */
struct lw_lightmap_spot {
    struct lw_vec3 centre; /* texels */
    struct lw_vec3 normal; /* unit, or shorter where it curves */
    float area;            /* a half holds half of the area */
    uint32_t id;           /* the caller's */
};

/** Sorts by repeated halving along the axis of largest spread: an axis of space or of the normal. If ids
 * differ, the result does not depend on the order before. */
void lw_lightmap_order(struct lw_lightmap_spot *spot, uint32_t count);

#endif
