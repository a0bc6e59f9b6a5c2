#include "common/lightmap/lightmap_things.h"

#include "common/lightmap/lightmap_topology.h"

#define RIGHT_ANGLE (0.5 * (double)LW_PI)

enum lw_status lw_lightmap_things_edges(const struct lw_mesh *mesh, double *out_length) {
    struct lw_lightmap_topology topology;
    const enum lw_status status = lw_lightmap_topology_init(&topology, mesh, 1);
    if (status != LW_OK) return status;
    double sum = 0;
    for (uint32_t n = 0; n < 3 * topology.triangle_count; n++) {
        if (topology.area[n / 3] == 0) continue;
        const double length = (double)topology.side[n / 3][n % 3];
        if (topology.neighbour[n] == LW_SCENE_NONE)
            sum += length;
        else /* the other half is the neighbour's */
            sum += 0.5 * length * fmin(1, (double)topology.bend[n] / RIGHT_ANGLE);
    }
    lw_lightmap_topology_finish(&topology);
    *out_length = sum;
    return LW_OK;
}
