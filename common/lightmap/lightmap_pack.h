/* lightmap_pack.h: gives every chart its place in the atlas, near those that are near it in space
 * (lightmap_order.h).
 * Flow:    charts -> [pack] -> lightmap UVs
 * Threads: one mesh at a time per thread; nothing is shared. */
#ifndef LW_COMMON_LIGHTMAP_PACK_H
#define LW_COMMON_LIGHTMAP_PACK_H

#include "common/lightmap/lightmap_chart.h"
#include "common/lightmap/lightmap_shape.h"

/** Where one chart goes: at = origin + scale * (its box's local coordinates). */
struct lw_lightmap_slot {
    struct lw_lightmap_box box;
    struct lw_vec2 origin, scale;
    uint32_t x, y, width, height; /* rectangle around it, in texels; blocks, but for slivers */
    uint32_t gutter;              /* inside the rectangle; none for slivers */
    float area;                   /* of the chart, in its own units */
    struct lw_vec3 centre;        /* of the chart in space, in its own units */
    struct lw_vec3 normal;        /* its mean */
};

struct lw_lightmap_layout {
    const struct lw_lightmap_charts *charts;
    uint32_t chart_count, width, height; /* texels; front only */
    struct lw_lightmap_slot *slot;       /* one per chart */
    uint32_t *start, *order;             /* triangles by chart: order[start[c] .. start[c + 1]] */
};

/** Boxes of all charts; to be packed at any scale, as often as wanted. charts must outlive the layout.
 * Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_lightmap_pack_init(struct lw_lightmap_layout *layout,
                                                   const struct lw_lightmap_charts *charts,
                                                   const struct lw_mesh *mesh);
void lw_lightmap_pack_finish(struct lw_lightmap_layout *layout);

/** Packs the charts at `scale` times their own size into the smallest atlas found.
 * width_max, height_max  texels
 * out_fits               false: does not fit; the layout is then undefined
 * Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_lightmap_pack(struct lw_lightmap_layout *layout, float scale,
                                              uint32_t width_max, uint32_t height_max, bool *out_fits);

/** Atlas coordinates of a point of a chart, inside its rectangle's gutter whatever the rounding. */
struct lw_vec2 lw_lightmap_pack_place(const struct lw_lightmap_slot *slot, struct lw_vec2 point);

#endif
