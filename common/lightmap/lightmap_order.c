#include "common/lightmap/lightmap_order.h"

#include <math.h>
#include <stdlib.h>

/* The two sides of a wall, whose normals are 2 apart, count as far from one another as two spots at this
 * distance; then most tiles show one side only. */
#define OPPOSITE 64.0f /* texels */

#define AXES 6

static float along(const struct lw_lightmap_spot *spot, int axis) {
    switch (axis) {
    case 0:
        return spot->centre.x;
    case 1:
        return spot->centre.y;
    case 2:
        return spot->centre.z;
    case 3:
        return spot->normal.x * (OPPOSITE / 2);
    case 4:
        return spot->normal.y * (OPPOSITE / 2);
    default:
        return spot->normal.z * (OPPOSITE / 2);
    }
}

static int compare(const void *left, const void *right, void *context) {
    const struct lw_lightmap_spot *a = left, *b = right;
    const int axis = *(const int *)context;
    const float x = along(a, axis), y = along(b, axis);
    if (x != y) return x < y ? -1 : 1;
    return a->id < b->id ? -1 : a->id > b->id;
}

static int widest_axis(const struct lw_lightmap_spot *spot, uint32_t count) {
    int widest = 0;
    float most = -1;
    for (int axis = 0; axis < AXES; axis++) {
        float low = INFINITY, high = -INFINITY;
        for (uint32_t i = 0; i < count; i++) {
            low = fminf(low, along(&spot[i], axis));
            high = fmaxf(high, along(&spot[i], axis));
        }
        if (high - low > most) most = high - low, widest = axis;
    }
    return widest;
}

void lw_lightmap_order(struct lw_lightmap_spot *spot, uint32_t count) {
    while (count > 1) {
        int axis = widest_axis(spot, count);
        qsort_r(spot, count, sizeof *spot, compare, &axis);
        double area = 0, half = 0;
        for (uint32_t i = 0; i < count; i++) area += (double)spot[i].area;
        uint32_t first = 0;
        do half += (double)spot[first++].area;
        while (first < count - 1 && half < area / 2);
        /* the larger part is the loop's: the depth of calls stays the logarithm of the count */
        if (first <= count - first) {
            lw_lightmap_order(spot, first);
            spot += first, count -= first;
        } else {
            lw_lightmap_order(spot + first, count - first);
            count = first;
        }
    }
}
