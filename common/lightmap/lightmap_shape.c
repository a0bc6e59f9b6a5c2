#include "common/lightmap/lightmap_shape.h"

#include <stdlib.h>

static int compare_points(const void *left, const void *right) {
    const struct lw_vec2 *a = left, *b = right;
    if (a->x != b->x) return a->x < b->x ? -1 : 1;
    return a->y < b->y ? -1 : a->y > b->y;
}

static bool turns_left(struct lw_vec2 a, struct lw_vec2 b, struct lw_vec2 c) {
    return ((double)b.x - (double)a.x) * ((double)c.y - (double)a.y) >
           ((double)b.y - (double)a.y) * ((double)c.x - (double)a.x);
}

/* Adds p to a chain that starts at out_hull[from], rubbing out what it would dent. */
static uint32_t extend(struct lw_vec2 *out_hull, uint32_t from, uint32_t count, struct lw_vec2 p) {
    while (count >= from + 2 && !turns_left(out_hull[count - 2], out_hull[count - 1], p)) count--;
    out_hull[count] = p;
    return count + 1;
}

/* Andrew's monotone chain. */
uint32_t lw_lightmap_shape_hull(struct lw_vec2 *point, uint32_t count, struct lw_vec2 *out_hull) {
    qsort(point, count, sizeof *point, compare_points);
    uint32_t hull = 0;
    for (uint32_t i = 0; i < count; i++) hull = extend(out_hull, 0, hull, point[i]);
    if (count < 2) return hull;
    uint32_t upper = hull - 1;
    for (uint32_t i = count - 1; i-- > 0;) hull = extend(out_hull, upper, hull, point[i]);
    return hull - 1; /* the first point came again */
}

static struct lw_lightmap_box box_along(const struct lw_vec2 *hull, uint32_t count, struct lw_vec2 axis) {
    struct lw_vec2 low = {INFINITY, INFINITY}, high = {-INFINITY, -INFINITY};
    for (uint32_t i = 0; i < count; i++) {
        float x = axis.x * hull[i].x + axis.y * hull[i].y, y = axis.x * hull[i].y - axis.y * hull[i].x;
        low.x = fminf(low.x, x), high.x = fmaxf(high.x, x);
        low.y = fminf(low.y, y), high.y = fmaxf(high.y, y);
    }
    return (struct lw_lightmap_box){axis, {1, 1}, low, {high.x - low.x, high.y - low.y}};
}

struct lw_lightmap_box lw_lightmap_shape_turned(const struct lw_lightmap_box *box) {
    /* x' = y, y' = -x */
    return (struct lw_lightmap_box){{-box->axis.y, box->axis.x},
                                    {box->stretch.y, box->stretch.x},
                                    {box->low.y, -(box->low.x + box->size.x)},
                                    {box->size.y, box->size.x}};
}

/* The smallest rectangle has a side along an edge of the hull (Freeman and Shapira 1975); with a margin that
 * is only nearly so, and near enough. Hulls have few corners, so every edge is tried against every corner. */
struct lw_lightmap_box lw_lightmap_shape_box(const struct lw_vec2 *hull, uint32_t count, float margin) {
    struct lw_lightmap_box best = box_along(hull, count, (struct lw_vec2){1, 0});
    float least = (best.size.x + margin) * (best.size.y + margin);
    uint32_t stride = 1 + count / 256; /* a finely faceted circle needs no more directions than this */
    for (uint32_t i = 0; i < count; i += stride) {
        struct lw_vec2 p = hull[i], q = hull[(i + 1) % count];
        float x = q.x - p.x, y = q.y - p.y, length = sqrtf(x * x + y * y);
        if (!(length > 1e-12f)) continue;
        struct lw_lightmap_box box = box_along(hull, count, (struct lw_vec2){x / length, y / length});
        float cost = (box.size.x + margin) * (box.size.y + margin);
        if (cost < least * 0.9999f)
            least = cost, best = box; /* the margin keeps equal boxes from trading places */
    }
    return best.size.x < best.size.y ? lw_lightmap_shape_turned(&best) : best;
}
