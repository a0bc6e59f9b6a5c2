/* emitter_triangle.h: E of a triangle that shines evenly, exactly.
 * Flow:    corners, point -> [emitter_triangle] -> E over radiance -> emitter_clusters
 * Threads: pure functions, [any].
 *
 * Lambert's formula for polygons (Baum, Rushmeier, Winget 1989): half the sum over edges of the angle under
 * which an edge is seen, times the cosine between the surface's normal and that of the plane through the edge
 * and the point. The part below the surface's horizon is cut off. */
#ifndef LW_CLIENT_VIEW_LIGHTS_EMITTER_TRIANGLE_H
#define LW_CLIENT_VIEW_LIGHTS_EMITTER_TRIANGLE_H

#include "common/base/vec.h"
#include "common/base/wide.h"

/** An angle over its sine; cosine: of the angle. The arc cosine is off by 7e-5 at most (Abramowitz and
 * Stegun, 4.4.45). */
LW_WIDE_INLINE float lw_emitter_triangle_angle_over_sine(float cosine) {
    const float x = fabsf(cosine) < 1 ? fabsf(cosine) : 1;
    const float p = 1.5707288f + x * (-0.2121144f + x * (0.0742610f - x * 0.0187293f));
    const float sine2 = 1 - x * x;
    const float acute = p / sqrtf(1 + x),
                obtuse = (LW_PI - sqrtf(1 - x) * p) / sqrtf(sine2 > 1e-7f ? sine2 : 1e-7f);
    return cosine > 0 ? acute : obtuse;
}

/** The term of an edge. a, b: from the point to its ends; normal: the surface's */
LW_WIDE_INLINE float lw_emitter_triangle_edge(struct lw_vec3 a, struct lw_vec3 b, struct lw_vec3 normal) {
    const float scale = 1 / sqrtf(lw_vec3_dot(a, a) * lw_vec3_dot(b, b) + 1e-37f);
    return lw_emitter_triangle_angle_over_sine(lw_vec3_dot(a, b) * scale) * scale *
           lw_vec3_dot(lw_vec3_cross(a, b), normal);
}

LW_WIDE_INLINE struct lw_vec3 lw_emitter_triangle_select(bool first, struct lw_vec3 a, struct lw_vec3 b) {
    return lw_vec3(first ? a.x : b.x, first ? a.y : b.y, first ? a.z : b.z);
}

/* The part above the horizon, as edges are added. */
struct lw_emitter_triangle_above {
    float sum;                     /* the terms of all edges */
    struct lw_vec3 enters, leaves; /* where the outline crosses the horizon */
};

/* Without branches, so that sixteen points go through at once. height, next: of the ends above the horizon */
LW_WIDE_INLINE void lw_emitter_triangle_add_edge(struct lw_emitter_triangle_above *above, struct lw_vec3 from,
                                                 struct lw_vec3 to, float height, float next,
                                                 struct lw_vec3 normal) {
    const float step = height - next;
    const struct lw_vec3 crossing = lw_vec3_mad(from, lw_vec3_sub(to, from), height / (step != 0 ? step : 1));
    const struct lw_vec3 a = lw_emitter_triangle_select(height > 0, from, crossing),
                         b = lw_emitter_triangle_select(next > 0, to, crossing);
    const float term = lw_emitter_triangle_edge(a, b, normal), highest = height > next ? height : next,
                leaving = height > 0 ? -next : -1, entering = next > 0 ? -height : -1;
    above->sum += highest > 0 ? term : 0;
    above->leaves = lw_emitter_triangle_select(leaving >= 0, crossing, above->leaves);
    above->enters = lw_emitter_triangle_select(entering >= 0, crossing, above->enters);
}

/** E at a point, over the triangle's radiance: 0 to pi. Points behind the triangle get none.
 * corner  counterclockwise as seen from the side that shines, world space, m */
LW_WIDE_INLINE float lw_emitter_triangle_light(const struct lw_vec3 corner[3], struct lw_vec3 point,
                                               struct lw_vec3 normal) {
    const struct lw_vec3 a = lw_vec3_sub(corner[0], point), b = lw_vec3_sub(corner[1], point),
                         c = lw_vec3_sub(corner[2], point);
    const float x = lw_vec3_dot(a, normal), y = lw_vec3_dot(b, normal), z = lw_vec3_dot(c, normal);
    struct lw_emitter_triangle_above above = {.sum = 0};
    lw_emitter_triangle_add_edge(&above, a, b, x, y, normal);
    lw_emitter_triangle_add_edge(&above, b, c, y, z, normal);
    lw_emitter_triangle_add_edge(&above, c, a, z, x, normal);
    /* 0 where it does not cross the horizon */
    above.sum += lw_emitter_triangle_edge(above.leaves, above.enters, normal);
    return above.sum < 0 ? -0.5f * above.sum : 0;
}

#endif
