/* light_kernels.h: the arithmetic of choosing and sampling a light, for one point. It has no branches, so
 * that compilers vectorise it: lights.c and light_tree.c call it for one point, lights16.c in loops over
 * sixteen.
 * Threads: pure functions, [any]. */
#ifndef LW_COMMON_LIGHT_KERNELS_H
#define LW_COMMON_LIGHT_KERNELS_H

#include "common/base/wide.h"
#include "common/light/lights.h"

#include <float.h>

/* fmaxf() and fminf() are calls */
LW_WIDE_INLINE float lw_light_larger(float a, float b) { return a > b ? a : b; }
LW_WIDE_INLINE float lw_light_smaller(float a, float b) { return a < b ? a : b; }

/* ---- choosing ---- */

/* Cosines are rounded: a direction this near to the edge of a cone counts as within. */
#define LW_LIGHT_COSINE_SLACK 2e-3f
#define LW_LIGHT_BELOW_ONE    0x1.fffffep-1f

/* Part of a node that a choice reads: one cache line. */
struct lw_light_node {
    struct lw_vec3 centre; /* the centre of the ball around its box */
    float radius, power;
    struct lw_vec3 axis;
    float cos_spread, sin_spread, cos_reach;
    bool dims;      /* by the cosine at the light; a cone narrower than a half space, a spot's, does not */
    uint32_t right; /* an inner node's; the left child is the next node */
    uint32_t light; /* a leaf's; UINT32_MAX: an inner node */
    uint32_t parent;
};
_Static_assert(sizeof(struct lw_light_node) <= 64, "a line");

/* Receiver of light: a region (light_tree.h), or a point of a surface as a region of no extent. */
struct lw_light_place {
    struct lw_vec3 centre, normal;
    float radius, cos_spread, sin_spread;
};

LW_WIDE_INLINE float lw_light_sine_of(float cosine) { return sqrtf(lw_light_larger(0, 1 - cosine * cosine)); }

static inline struct lw_light_place lw_light_place_of(const struct lw_light_region *r) {
    return (struct lw_light_place){.centre = r->centre_ws,
                                   .normal = r->normal_ws,
                                   .radius = r->radius_m,
                                   .cos_spread = r->cos_spread,
                                   .sin_spread = lw_light_sine_of(r->cos_spread)};
}

/* Cosine of max(0, a - b - c), for angles within [0, pi] of which only a comes without its sine. */
LW_WIDE_INLINE float lw_light_cos_of_rest(float cos_a, float cos_b, float sin_b, float cos_c, float sin_c) {
    const float cos_bc = cos_b * cos_c - sin_b * sin_c, sin_bc = sin_b * cos_c + cos_b * sin_c;
    const float rest = cos_a * cos_bc + lw_light_sine_of(cos_a) * sin_bc;
    const float less = cos_a >= cos_bc ? 1 : rest;
    return sin_bc < 0 ? 1 : less; /* b + c is more than any angle */
}

/* Upper bound of a group's light: power x cos x cos' / d^2, with the most favourable angles. 0 only where it
 * gives nothing. */
LW_WIDE_INLINE float lw_light_importance(const struct lw_light_node *node, struct lw_light_place place) {
    const struct lw_vec3 to = lw_vec3_sub(node->centre, place.centre);
    /* the vectors from points of one ball to those of another are those from a point to a ball of both
     * radii */
    const float radius = node->radius + place.radius, radius2 = lw_light_larger(radius * radius, 1e-12f);
    const float distance2 = lw_vec3_dot(to, to);
    /* the angle that the group's ball fills, seen from the point, is taken off both */
    const float scale = 1 / sqrtf(distance2), sin_seen = radius * scale,
                cos_seen = lw_light_sine_of(sin_seen);
    const float at_point = lw_light_cos_of_rest(lw_vec3_dot(to, place.normal) * scale, place.cos_spread,
                                                place.sin_spread, cos_seen, sin_seen);
    const float at_light = lw_light_cos_of_rest(-lw_vec3_dot(to, node->axis) * scale, node->cos_spread,
                                                node->sin_spread, cos_seen, sin_seen);
    const float least_facing = node->dims ? 1e-3f : 1; /* one number for all points, as vectors want it */
    const float given = node->power * lw_light_larger(at_point, 1e-3f) *
                        lw_light_larger(at_light, least_facing) * (scale * scale);
    const float outside = at_point < -LW_LIGHT_COSINE_SLACK ? 0 : given;
    const float lit = at_light < node->cos_reach - LW_LIGHT_COSINE_SLACK ? 0 : outside;
    return distance2 <= radius2 * 1.0001f ? node->power / radius2 : lit; /* within: all directions */
}

/* From an inner node, number `index` of its tree, to one of its children, which promise left and right;
 * UINT32_MAX: neither can give anything. The rest of the pick is even in [0, 1) again. */
static inline uint32_t lw_light_go_down(const struct lw_light_node *node, uint32_t index, float left,
                                        float right, float *pick, float *probability) {
    if (!(left + right > 0)) return UINT32_MAX;
    const float share = left / (left + right);
    const bool to_left = *pick < share;
    const float p = to_left ? share : 1 - share, below = to_left ? 0 : share;
    *pick = lw_light_smaller((*pick - below) / p, LW_LIGHT_BELOW_ONE);
    *probability *= p;
    return to_left ? index + 1 : node->right;
}

/* ---- sampling ---- */

/* From a point to a place of an emitter: b, its barycentrics. */
LW_WIDE_INLINE struct lw_vec3 lw_light_to_emitter(const struct lw_emitter *e, struct lw_vec3 point,
                                                  struct lw_vec2 b) {
    return lw_vec3_mad(lw_vec3_mad(lw_vec3_sub(e->corner, point), e->edge_u, b.x), e->edge_v, b.y);
}

/* Barycentrics of a point chosen evenly over a triangle's area. */
LW_WIDE_INLINE struct lw_vec2 lw_light_by_area(float u, float v) {
    const float root = sqrtf(u);
    return (struct lw_vec2){v * root, root * (1 - v)};
}

/* Whether a point is near enough to an emitter to sample the emitter by solid angle. */
LW_WIDE_INLINE bool lw_light_is_near(const struct lw_emitter *e, struct lw_vec3 point) {
    const struct lw_vec3 middle = lw_light_to_emitter(e, point, (struct lw_vec2){1.0f / 3, 1.0f / 3});
    return lw_vec3_dot(middle, middle) <= e->near_m2;
}

/* Density per solid angle of a direction to an emitter at a distance. inverse_sr: 1 / solid angle of uniform
 * sampling; 0: the sample is uniform over the emitter's area, d^2 / (A cos'). 0 where the emitter shows a
 * side that does not shine. */
LW_WIDE_INLINE float lw_light_emitter_pdf(const struct lw_emitter *e, float inverse_sr,
                                          struct lw_vec3 direction, float distance_m) {
    const float facing = -lw_vec3_dot(direction, e->normal), back = e->both_sides ? -1.0f : 1.0f;
    const float cosine = lw_light_larger(facing, facing * back);
    const float by_area = distance_m * distance_m / (e->area_m2 * cosine);
    const float pdf = inverse_sr > 0 ? inverse_sr : by_area;
    return cosine > 0 ? pdf : 0;
}

/* A sample of an emitter, chosen with a probability, at the place b on it. */
LW_WIDE_INLINE struct lw_light_sample lw_light_emitter_sample(const struct lw_emitter *e,
                                                              struct lw_vec3 radiance, float probability,
                                                              float inverse_sr, struct lw_vec2 b,
                                                              struct lw_vec3 point) {
    const struct lw_vec3 to = lw_light_to_emitter(e, point, b);
    const float distance = sqrtf(lw_vec3_dot(to, to));
    const struct lw_vec3 direction = lw_vec3_scale(to, 1.0f / distance);
    const float density = probability * lw_light_emitter_pdf(e, inverse_sr, direction, distance);
    const float pdf = density > 0 ? density : 0, inverse = density > 0 ? 1.0f / density : 0;
    return (struct lw_light_sample){direction, distance, lw_vec3_scale(radiance, inverse), pdf};
}

/* (1 - cos angle) / 2 without its cancellation: a searchlight's cosines are 1 to the last bits. */
static inline float lw_light_sine2_of_half(float angle) {
    const float sine = sinf(0.5f * angle);
    return sine * sine;
}

/* A spot's; sine2 of half its outer angle. Points are spots whose edge is out of reach. */
struct lw_light_cone {
    float outer, inverse;
};
static inline struct lw_light_cone lw_light_cone_of(const struct lw_light *light) {
    if (light->kind != LW_LIGHT_SPOT) return (struct lw_light_cone){2, 1};
    const float outer = lw_light_sine2_of_half(light->outer_cone);
    return (struct lw_light_cone){
        outer, 1 / lw_light_larger(FLT_MIN, outer - lw_light_sine2_of_half(light->inner_cone))};
}

/* KHR_lights_punctual's recommended curve: clamp((cos a - cos o) / (cos i - cos o))^2. */
LW_WIDE_INLINE struct lw_light_sample lw_light_near_sample(const struct lw_light_state *state,
                                                           struct lw_light_cone cone, struct lw_vec3 point) {
    const struct lw_vec3 to = lw_vec3_sub(state->position_ws, point);
    const float distance2 = lw_vec3_dot(to, to), distance = sqrtf(distance2);
    const struct lw_vec3 direction = lw_vec3_scale(to, 1.0f / distance);
    const struct lw_vec3 apart = lw_vec3_add(direction, state->direction_ws);
    const float s = (cone.outer - 0.25f * lw_vec3_dot(apart, apart)) * cone.inverse;
    const float within = lw_light_smaller(lw_light_larger(s, 0), 1);
    const float falloff = distance2 > 1e-12f ? within * within / distance2 : 0;
    return (struct lw_light_sample){direction, distance, lw_vec3_scale(state->intensity, falloff), 0};
}

#endif
