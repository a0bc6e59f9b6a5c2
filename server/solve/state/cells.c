#include "server/solve/state/cells.h"

#include "common/base/invariant.h"

static uint32_t cells_along(float extent, float size) {
    float n = ceilf(extent / size - 0.01f); /* the margin alone makes no cell */
    return n < 1 ? 1 : n > (float)LW_CELLS_PER_AXIS_MAX ? LW_CELLS_PER_AXIS_MAX : (uint32_t)n;
}

void lw_cells_init(struct lw_cells *cells, struct lw_vec3 minimum_ws, struct lw_vec3 maximum_ws,
                   float cell_size_m) {
    struct lw_vec3 extent = lw_vec3_sub(maximum_ws, minimum_ws);
    float longest = fmaxf(extent.x, fmaxf(extent.y, extent.z));
    float margin =
        fmaxf(longest * 1e-4f, 1e-6f); /* surfaces on the box's faces lie inside; flat scenes have volume */
    cells->minimum_ws = lw_vec3_sub(minimum_ws, lw_vec3(margin, margin, margin));
    cells->maximum_ws = lw_vec3_add(maximum_ws, lw_vec3(margin, margin, margin));
    extent = lw_vec3_sub(cells->maximum_ws, cells->minimum_ws);
    float size = cell_size_m > 0 ? cell_size_m : longest / 4;
    size = fmaxf(size, margin);
    cells->count[0] = cells_along(extent.x, size);
    cells->count[1] = cells_along(extent.y, size);
    cells->count[2] = cells_along(extent.z, size);
    cells->size_m = lw_vec3(extent.x / (float)cells->count[0], extent.y / (float)cells->count[1],
                            extent.z / (float)cells->count[2]);
    LW_INVARIANT(lw_cells_total(cells) > 0 && cells->size_m.x > 0 && cells->size_m.y > 0 &&
                 cells->size_m.z > 0);
}

uint32_t lw_cells_total(const struct lw_cells *cells) {
    return cells->count[0] * cells->count[1] * cells->count[2];
}

static uint32_t slot(float position, float minimum, float size, uint32_t count) {
    float s = (position - minimum) / size;
    return s > 0 ? s < (float)count ? (uint32_t)s : count - 1 : 0; /* NaN: 0 */
}

uint32_t lw_cells_at(const struct lw_cells *cells, struct lw_vec3 p) {
    uint32_t x = slot(p.x, cells->minimum_ws.x, cells->size_m.x, cells->count[0]);
    uint32_t y = slot(p.y, cells->minimum_ws.y, cells->size_m.y, cells->count[1]);
    uint32_t z = slot(p.z, cells->minimum_ws.z, cells->size_m.z, cells->count[2]);
    LW_INVARIANT_DEAR(x < cells->count[0] && y < cells->count[1] && z < cells->count[2]);
    return (z * cells->count[1] + y) * cells->count[0] + x;
}

struct lw_vec3 lw_cells_centre(const struct lw_cells *cells, uint32_t cell) {
    uint32_t x = cell % cells->count[0], y = cell / cells->count[0] % cells->count[1],
             z = cell / (cells->count[0] * cells->count[1]);
    return lw_vec3_add(cells->minimum_ws, lw_vec3_mul(cells->size_m, lw_vec3((float)x + 0.5f, (float)y + 0.5f,
                                                                             (float)z + 0.5f)));
}

bool lw_cells_contain(const struct lw_cells *cells, struct lw_vec3 p) {
    return p.x >= cells->minimum_ws.x && p.y >= cells->minimum_ws.y && p.z >= cells->minimum_ws.z &&
           p.x <= cells->maximum_ws.x && p.y <= cells->maximum_ws.y && p.z <= cells->maximum_ws.z;
}

static float exit_distance(float position, float direction, float minimum, float maximum) {
    if (direction > 0) return (maximum - position) / direction;
    if (direction < 0) return (minimum - position) / direction;
    return INFINITY;
}

struct lw_vec3 lw_cells_project(const struct lw_cells *cells, struct lw_vec3 p, struct lw_vec3 d) {
    float t = exit_distance(p.x, d.x, cells->minimum_ws.x, cells->maximum_ws.x);
    t = fminf(t, exit_distance(p.y, d.y, cells->minimum_ws.y, cells->maximum_ws.y));
    t = fminf(t, exit_distance(p.z, d.z, cells->minimum_ws.z, cells->maximum_ws.z));
    return t > 0 && isfinite(t) ? lw_vec3_mad(p, d, t) : p;
}
