#include "common/light/lights16.h"

#include "common/light/direction.h"
#include "common/light/light_kernels.h"

#define LANES 16

#define STACK_MAX (LW_LIGHT_TREE_DEPTH_MAX + 2)

LW_WIDE_INLINE struct lw_vec3 position(const struct lw_points16 *p, int lane) {
    return lw_vec3(p->x[lane], p->y[lane], p->z[lane]);
}
LW_WIDE_INLINE struct lw_vec3 normal(const struct lw_points16 *p, int lane) {
    return lw_vec3(p->nx[lane], p->ny[lane], p->nz[lane]);
}

/* Light from behind the surface, and NaN, count as none. */
LW_WIDE_INLINE struct lw_vec3 arriving(struct lw_vec3 irradiance_normal, float cosine) {
    const struct lw_vec3 e = lw_vec3_scale(irradiance_normal, cosine);
    const float sum = e.x + e.y + e.z;
    const bool some = (cosine > 0) & (sum > 0) & (sum <= FLT_MAX);
    return lw_vec3(some ? e.x : 0, some ? e.y : 0, some ? e.z : 0);
}

LW_WIDE_INLINE void put(struct lw_light_sample16 *out, int lane, bool chosen, struct lw_vec3 direction,
                        float distance_m, struct lw_vec3 e) {
    out->dir_x[lane] = chosen ? direction.x : out->dir_x[lane];
    out->dir_y[lane] = chosen ? direction.y : out->dir_y[lane];
    out->dir_z[lane] = chosen ? direction.z : out->dir_z[lane];
    out->distance_m[lane] = chosen ? distance_m : out->distance_m[lane];
    out->e[0][lane] = chosen ? e.x : out->e[0][lane];
    out->e[1][lane] = chosen ? e.y : out->e[1][lane];
    out->e[2][lane] = chosen ? e.z : out->e[2][lane];
}

LW_WIDE uint16_t lw_light_sample16_lit(const struct lw_light_sample16 *s) {
    uint32_t lit = 0;
    for (int i = 0; i < LANES; i++) lit |= (s->e[0][i] + s->e[1][i] + s->e[2][i] > 0 ? 1u : 0u) << i;
    return (uint16_t)lit;
}

/* ---- choosing ---- */

/* Points that have come to a node of the tree, and the rest of their choice. */
struct choice {
    float pick[LANES], probability[LANES];
};

/* Bound of a node's light at each point. */
LW_WIDE static void weigh_points(const struct lw_light_node *at, const struct lw_points16 *restrict points,
                                 float *restrict out) {
    const struct lw_light_node node = *at;
    for (int i = 0; i < LANES; i++) {
        const struct lw_light_place place = {position(points, i), normal(points, i), 0, 1, 0};
        out[i] = lw_light_importance(&node, place);
    }
}

/* Whether each point goes to the left child, the right one or nowhere; those of `here` alone choose. */
LW_WIDE static void descend(const float *restrict left, const float *restrict right, uint16_t here,
                            struct choice *restrict choice, uint16_t *out_left, uint16_t *out_right) {
    uint32_t left_bit[LANES], right_bit[LANES], goes_left = 0, goes_right = 0;
    for (int i = 0; i < LANES; i++) {
        const float sum = left[i] + right[i], share = left[i] / sum, pick = choice->pick[i];
        const float p = pick < share ? share : 1 - share, below = pick < share ? 0 : share;
        const uint32_t bit = sum > 0 ? 1u << i & here : 0;
        choice->pick[i] = bit ? lw_light_smaller((pick - below) / p, LW_LIGHT_BELOW_ONE) : pick;
        choice->probability[i] *= bit ? p : 1;
        left_bit[i] = pick < share ? bit : 0;
        right_bit[i] = pick >= share ? bit : 0;
    }
    for (int i = 0; i < LANES; i++) goes_left |= left_bit[i], goes_right |= right_bit[i];
    *out_left = (uint16_t)goes_left;
    *out_right = (uint16_t)goes_right;
}

void lw_light_tree_choose16(const struct lw_light_tree *tree, uint32_t group,
                            const struct lw_points16 *points, float pick, uint16_t active,
                            uint32_t out_light[16], float out_probability[16]) {
    struct {
        uint32_t node;
        uint16_t lanes;
    } stack[STACK_MAX] = {{group, active}};
    struct choice choice;
    for (int i = 0; i < LANES; i++) {
        choice.pick[i] = pick;
        choice.probability[i] = 1;
        out_light[i] = UINT32_MAX;
        out_probability[i] = 0;
    }
    for (int top = 1; top > 0;) {
        const uint32_t node = stack[--top].node;
        const uint16_t lanes = stack[top].lanes;
        const struct lw_light_node *n = &tree->node[node];
        if (!lanes) continue;
        if (n->light == UINT32_MAX) {
            stack[top].node = n->right;
            stack[top + 1].node = node + 1;
            float left[LANES], right[LANES];
            weigh_points(n + 1, points, left);
            weigh_points(&tree->node[n->right], points, right);
            descend(left, right, lanes, &choice, &stack[top + 1].lanes, &stack[top].lanes);
            top += 2;
            continue;
        }
        for (int i = 0; i < LANES; i++)
            if (lanes >> i & 1) {
                out_light[i] = n->light;
                out_probability[i] = choice.probability[i];
            }
    }
}

#define CHOICES 4u /* they go down the tree together */
#define NODES   8u /* their children */

struct nodes {
    _Alignas(32) float x[NODES];
    float y[NODES], z[NODES], radius[NODES], power[NODES], axis_x[NODES], axis_y[NODES], axis_z[NODES],
        cos_spread[NODES], sin_spread[NODES], cos_reach[NODES], dims[NODES];
};

static void put_node(struct nodes *nodes, uint32_t lane, const struct lw_light_node *node) {
    nodes->x[lane] = node->centre.x, nodes->y[lane] = node->centre.y, nodes->z[lane] = node->centre.z;
    nodes->radius[lane] = node->radius, nodes->power[lane] = node->power;
    nodes->axis_x[lane] = node->axis.x, nodes->axis_y[lane] = node->axis.y,
    nodes->axis_z[lane] = node->axis.z;
    nodes->cos_spread[lane] = node->cos_spread, nodes->sin_spread[lane] = node->sin_spread;
    nodes->cos_reach[lane] = node->cos_reach, nodes->dims[lane] = node->dims;
}

LW_WIDE static void weigh_nodes(const struct nodes *restrict n, const struct lw_light_place *at,
                                float *restrict out) {
    const struct lw_light_place place = *at;
    for (int i = 0; i < (int)NODES; i++) {
        const struct lw_light_node node = {.centre = lw_vec3(n->x[i], n->y[i], n->z[i]),
                                           .radius = n->radius[i],
                                           .power = n->power[i],
                                           .axis = lw_vec3(n->axis_x[i], n->axis_y[i], n->axis_z[i]),
                                           .cos_spread = n->cos_spread[i],
                                           .sin_spread = n->sin_spread[i],
                                           .cos_reach = n->cos_reach[i],
                                           .dims = n->dims[i] > 0};
        out[i] = lw_light_importance(&node, place);
    }
}

static bool is_inner(const struct lw_light_tree *tree, uint32_t node) {
    return node != UINT32_MAX && tree->node[node].light == UINT32_MAX;
}

/* One step down for up to CHOICES, each at its `node`; false: all have arrived. */
static bool step_down(const struct lw_light_tree *tree, const struct lw_light_place *place, uint32_t count,
                      struct lw_light_choice *choice, uint32_t *node) {
    struct nodes children = {.x = {0}};
    float weight[NODES];
    bool any = false;
    for (uint32_t i = 0; i < count; i++) {
        if (!is_inner(tree, node[i])) continue;
        put_node(&children, 2 * i, &tree->node[node[i] + 1]);
        put_node(&children, 2 * i + 1, &tree->node[tree->node[node[i]].right]);
        any = true;
    }
    if (!any) return false;
    weigh_nodes(&children, place, weight);
    for (uint32_t i = 0; i < count; i++)
        if (is_inner(tree, node[i]))
            node[i] = lw_light_go_down(&tree->node[node[i]], node[i], weight[2 * i], weight[2 * i + 1],
                                       &choice[i].pick, &choice[i].probability);
    return true;
}

void lw_light_tree_choose_each(const struct lw_light_tree *tree, const struct lw_light_region *region,
                               struct lw_light_choice *choice, uint32_t count) {
    const struct lw_light_place place = lw_light_place_of(region);
    for (uint32_t first = 0; first < count; first += CHOICES) {
        const uint32_t some = count - first < CHOICES ? count - first : CHOICES;
        uint32_t node[CHOICES];
        for (uint32_t i = 0; i < some; i++) {
            node[i] = choice[first + i].group;
            choice[first + i].probability = 1;
        }
        while (step_down(tree, &place, some, choice + first, node))
            ;
        for (uint32_t i = 0; i < some; i++)
            choice[first + i].light = node[i] == UINT32_MAX ? UINT32_MAX : tree->node[node[i]].light;
    }
}

/* ---- sampling ---- */

/* By the emitter's area; returns which of the chosen points are too near for that. */
LW_WIDE static uint16_t sample_by_area(const struct lw_emitter *emitter, struct lw_vec3 radiance,
                                       const float *restrict probability, struct lw_vec2 b,
                                       const struct lw_points16 *restrict points, uint16_t chosen,
                                       struct lw_light_sample16 *restrict out) {
    const struct lw_emitter e = *emitter;
    uint32_t near = 0;
    for (int i = 0; i < LANES; i++) {
        const struct lw_light_sample s =
            lw_light_emitter_sample(&e, radiance, probability[i], 0, b, position(points, i));
        const float cosine = lw_vec3_dot(s.direction, normal(points, i));
        put(out, i, chosen >> i & 1, s.direction, s.distance_m, arriving(s.irradiance_normal, cosine));
        near |= (lw_light_is_near(&e, position(points, i)) ? 1u : 0u) << i;
    }
    return (uint16_t)near & chosen;
}

LW_WIDE static void sample_punctual(const struct lw_light_state *at, struct lw_light_cone cone,
                                    const float *restrict probability,
                                    const struct lw_points16 *restrict points, uint16_t chosen,
                                    struct lw_light_sample16 *restrict out) {
    const struct lw_light_state state = *at;
    for (int i = 0; i < LANES; i++) {
        const struct lw_light_sample s = lw_light_near_sample(&state, cone, position(points, i));
        const float cosine = lw_vec3_dot(s.direction, normal(points, i));
        put(out, i, chosen >> i & 1, s.direction, s.distance_m,
            arriving(lw_vec3_scale(s.irradiance_normal, 1 / probability[i]), cosine));
    }
}

void lw_lights_sample_near16(const struct lw_lights *lights, uint32_t light, const float probability[16],
                             float u, float v, const struct lw_points16 *points, uint16_t chosen,
                             struct lw_light_sample16 *out) {
    if (light >= lights->emitter_count) {
        const uint32_t punctual = lights->near[light - lights->emitter_count];
        sample_punctual(&lights->punctual[punctual], lw_light_cone_of(&lights->scene->light[punctual]),
                        probability, points, chosen, out);
        return;
    }
    const struct lw_vec2 b = lw_light_by_area(u, v);
    uint16_t near = sample_by_area(&lights->emitter[light], lw_lights_radiance(lights, light, b), probability,
                                   b, points, chosen, out);
    for (; near; near &= (uint16_t)(near - 1)) {
        const int i = __builtin_ctz(near);
        const struct lw_light_sample s = lw_lights_sample_near(lights, light, probability[i], u, v,
                                                               position(points, i), normal(points, i));
        put(out, i, true, s.direction, s.distance_m,
            arriving(s.irradiance_normal, lw_vec3_dot(s.direction, normal(points, i))));
    }
}

/* The same direction for all points. */
LW_WIDE static void point_all(struct lw_vec3 direction, struct lw_vec3 irradiance_normal,
                              const struct lw_points16 *restrict points,
                              struct lw_light_sample16 *restrict out) {
    for (int i = 0; i < LANES; i++)
        put(out, i, true, direction, INFINITY,
            arriving(irradiance_normal, lw_vec3_dot(direction, normal(points, i))));
}

/* One about each point's normal. */
LW_WIDE static void point_about(const struct lw_vec3 local[LANES],
                                const struct lw_vec3 irradiance_normal[LANES],
                                const struct lw_points16 *restrict points,
                                struct lw_light_sample16 *restrict out) {
    for (int i = 0; i < LANES; i++)
        put(out, i, true, lw_direction_about(normal(points, i), local[i]), INFINITY,
            arriving(irradiance_normal[i], local[i].z));
}

void lw_lights_sample_punctual16(const struct lw_lights *lights, uint32_t light, float u, float v,
                                 const struct lw_points16 *points, struct lw_light_sample16 *out) {
    static const float certain[LANES] = {1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1};
    const struct lw_light *l = &lights->scene->light[light];
    if (l->kind == LW_LIGHT_DIRECTIONAL) {
        const struct lw_light_sample sun = lw_lights_sample_punctual(lights, light, u, v, lw_vec3(0, 0, 0));
        point_all(sun.direction, sun.irradiance_normal, points, out);
        return;
    }
    sample_punctual(&lights->punctual[light], lw_light_cone_of(l), certain, points, UINT16_MAX, out);
}

void lw_lights_place_sky16(const struct lw_lights *lights, const struct lw_sky_sample sky[LANES],
                           const struct lw_points16 *points, struct lw_light_sample16 *out) {
    float cosine;
    if (!lights->scene->environment.width) { /* the same from everywhere */
        struct lw_vec3 local[LANES], irradiance_normal[LANES];
        for (int i = 0; i < LANES; i++) {
            local[i] = sky[i].direction;
            irradiance_normal[i] =
                lw_lights_place_sky(lights, &sky[i], lw_vec3(0, 0, 1), &cosine).irradiance_normal;
        }
        point_about(local, irradiance_normal, points, out);
        return;
    }
    for (int i = 0; i < LANES; i++) {
        const struct lw_light_sample s = lw_lights_place_sky(lights, &sky[i], normal(points, i), &cosine);
        put(out, i, true, s.direction, s.distance_m, arriving(s.irradiance_normal, cosine));
    }
}
