/* lightmap_slot.h: where the charts of a mesh lie in its atlas.
 * Flow:    charts -> pack, sliver -> [slots] -> lightmap UVs
 * Threads: plain values; pure functions, [any]. */
#ifndef LW_COMMON_LIGHTMAP_SLOT_H
#define LW_COMMON_LIGHTMAP_SLOT_H

#include "common/lightmap/lightmap_chart.h"
#include "common/lightmap/lightmap_shape.h"

#include <math.h>

/** The place of one chart: at = origin + scale * (its box's local coordinates). */
struct lw_lightmap_slot {
    struct lw_lightmap_box box;
    struct lw_vec2 origin, scale;
    uint32_t x, y, width, height; /* rectangle around it, in texels; whole blocks, except for slivers */
    uint32_t gutter;              /* inside the rectangle; 0 for slivers */
    float area;                   /* the chart's, in units of the box */
    struct lw_vec3 centre;        /* the chart's in space, in its own units */
    struct lw_vec3 normal;        /* mean of the chart */
};

struct lw_lightmap_layout {
    const struct lw_lightmap_charts *charts;
    uint32_t chart_count, width, height; /* texels; front only */
    struct lw_lightmap_slot *slot;       /* one per chart */
    uint32_t *start, *order;             /* triangles by chart: order[start[c] .. start[c + 1]] */
};

/** Atlas coordinates of a point of the chart: inside the rectangle's gutter, with any rounding. */
static inline struct lw_vec2 lw_lightmap_slot_place(const struct lw_lightmap_slot *slot,
                                                    struct lw_vec2 point) {
    const struct lw_vec2 local = lw_lightmap_shape_local(&slot->box, point);
    const float left = (float)(slot->x + slot->gutter), right = (float)(slot->x + slot->width - slot->gutter),
                top = (float)(slot->y + slot->gutter),
                bottom = (float)(slot->y + slot->height - slot->gutter);
    return (struct lw_vec2){fminf(fmaxf(slot->origin.x + slot->scale.x * local.x, left), right),
                            fminf(fmaxf(slot->origin.y + slot->scale.y * local.y, top), bottom)};
}

#endif
