/* lightmap_chart.h: cuts a mesh into charts and lays each of them out flat.
 * Flow:    mesh -> topology -> [charts: grow, merge] -> pack
 * Threads: one mesh at a time per thread; nothing is shared.
 *
 * A chart grows from a seed triangle by unfolding its neighbours over their shared edges, like a paper model.
 * Developable surfaces (walls, columns, arches, mouldings) are exact. Elsewhere stretch is bounded: a
 * triangle that would be stretched too far, flip, or overlap another goes to another chart. Triangles lower
 * than a texel may be stretched more. Hard edges, and bevels within a texel (lightmap_bevel.h), are chart
 * borders, except of pieces of a few texels, whose gutters would take most of the atlas. */
#ifndef LW_COMMON_LIGHTMAP_CHART_H
#define LW_COMMON_LIGHTMAP_CHART_H

#include "common/lightmap/lightmap_topology.h"

struct lw_lightmap_charts {
    uint32_t triangle_count, point_count, chart_count;
    uint32_t (*corner)[3]; /* per triangle: its points */
    /* texels; every chart has a frame of its own, y is left of x seen from the front */
    struct lw_vec2 *point;
    uint32_t *chart; /* per triangle; LW_SCENE_NONE if no triangle of the mesh has area */
    /* Per chart, in its frame: the sum of angle * length * n n^T over its bent edges, n across the edge; by
     * its area, how much the surface bends per texel, and which way. */
    struct lw_lightmap_bend {
        float xx, xy, yy;
    } * bend;
};

/** scale  texels per unit of object space. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_lightmap_chart_build(struct lw_lightmap_charts *charts,
                                                     const struct lw_mesh *mesh, double scale);
void lw_lightmap_chart_finish(struct lw_lightmap_charts *charts);

#endif
