#include "server/solve/surface/dark_spaces.h"

#include "common/base/invariant.h"
#include "common/base/random.h"
#include "common/light/direction.h"

#define STEPS 8u /* surfaces that a walk meets at most */

struct walks {
    const struct lw_dark_spaces *spaces;
    uint16_t active, lit;
    struct lw_vec3 at[LW_TRACE_WIDTH], normal[LW_TRACE_WIDTH];
    struct lw_ray16 rays;
    struct lw_hit16 hits;
};

static bool is_active(const struct walks *w, uint32_t lane) { return w->active >> lane & 1; }

static void end_lit(struct walks *w, uint16_t lanes) {
    w->lit |= lanes;
    w->active &= (uint16_t)~lanes;
}

/* Whether what a ray has met keeps light out, and is dark itself. */
static bool is_dark(const struct walks *w, uint32_t lane) {
    if (w->hits.object[lane] == LW_TRACE_MISS) return false;
    const struct lw_material *material = lw_trace_material(w->spaces->texels->scene, &w->hits, lane);
    return w->spaces->texels->stands[w->hits.object[lane]] && material->alpha_mode == LW_ALPHA_OPAQUE &&
           !lw_material_shines(material);
}

/* Goes to where the ray has ended, on the side that it came from. */
static void move(struct walks *w, uint32_t lane) {
    const struct lw_scene *scene = w->spaces->texels->scene;
    const uint32_t object = w->hits.object[lane];
    const struct lw_mesh *mesh = &scene->mesh[scene->object[object].mesh];
    const uint32_t *vertex = mesh->triangle[w->hits.triangle[lane]];
    const struct lw_vec3 d = lw_vec3(w->rays.dir_x[lane], w->rays.dir_y[lane], w->rays.dir_z[lane]);
    struct lw_vec3 corner[3];
    float largest_m = 0;
    for (uint32_t k = 0; k < 3; k++) {
        corner[k] = lw_affine_point(&w->spaces->pose->object_to_world[object], mesh->position[vertex[k]]);
        largest_m = fmaxf(largest_m, lw_vec3_max_abs(corner[k]));
    }
    const struct lw_vec3 n = lw_vec3_normalize(
        lw_vec3_cross(lw_vec3_sub(corner[1], corner[0]), lw_vec3_sub(corner[2], corner[0])));
    w->normal[lane] = lw_vec3_dot(n, d) > 0 ? lw_vec3_scale(n, -1) : n;
    w->at[lane] = lw_trace_lift(lw_vec3_mad(w->at[lane], d, w->hits.t[lane]), w->normal[lane], 2 * largest_m);
}

/* Walks go in the directions of a sequence, another one at each step. */
static void bounce(struct walks *w, const uint32_t walk[LW_TRACE_WIDTH], uint32_t step) {
    for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++) {
        if (!is_active(w, lane)) continue;
        float square[2];
        lw_random_sobol2(walk[lane], step, square);
        lw_trace_set_ray(&w->rays, lane, w->at[lane],
                         lw_direction_about(w->normal[lane], lw_direction_cosine(square)), w->spaces->far_m);
    }
    lw_trace_closest16(w->spaces->trace, LW_TRACE_LIGHT, w->active, &w->rays, &w->hits);
    uint16_t lit = 0;
    for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++)
        if (is_active(w, lane) && !is_dark(w, lane)) lit |= (uint16_t)(1u << lane);
    end_lit(w, lit);
    for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++)
        if (is_active(w, lane)) move(w, lane);
}

/* The nearest lamp that is not the sun; LW_SCENE_NONE: there is none. */
static uint32_t nearest_lamp(const struct walks *w, struct lw_vec3 from) {
    const struct lw_scene *scene = w->spaces->texels->scene;
    uint32_t nearest = LW_SCENE_NONE;
    float least = INFINITY;
    for (uint32_t i = 0; i < scene->light_count; i++) {
        if (scene->light[i].kind == LW_LIGHT_DIRECTIONAL) continue;
        const struct lw_vec3 way = lw_vec3_sub(w->spaces->pose->light[i].position_ws, from);
        const float distance2 = lw_vec3_dot(way, way);
        if (distance2 < least) least = distance2, nearest = i;
    }
    return nearest;
}

/* Cones of spots do not count: their light comes back from where they shine. */
static void look_for_lamps(struct walks *w) {
    uint16_t looking = 0;
    for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++) {
        if (!is_active(w, lane)) continue;
        const uint32_t lamp = nearest_lamp(w, w->at[lane]);
        if (lamp == LW_SCENE_NONE) return;
        const struct lw_vec3 way = lw_vec3_sub(w->spaces->pose->light[lamp].position_ws, w->at[lane]);
        if (lw_vec3_dot(way, w->normal[lane]) <= 0) continue;
        lw_trace_set_ray(&w->rays, lane, w->at[lane], way, 1);
        looking |= (uint16_t)(1u << lane);
    }
    if (looking)
        end_lit(w, looking &
                       (uint16_t)~lw_trace_occluded16(w->spaces->trace, LW_TRACE_LIGHT, looking, &w->rays));
}

uint16_t lw_dark_spaces_find_light(const struct lw_dark_spaces *spaces, uint16_t active,
                                   const uint32_t walk[LW_TRACE_WIDTH],
                                   const struct lw_vec3 point[LW_TRACE_WIDTH],
                                   const struct lw_vec3 normal[LW_TRACE_WIDTH]) {
    struct walks w = {.spaces = spaces, .active = active};
    for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++) {
        if (!is_active(&w, lane)) continue;
        LW_INVARIANT(walk[lane] < LW_DARK_SPACES_WALKS);
        w.at[lane] = point[lane];
        w.normal[lane] = normal[lane];
    }
    look_for_lamps(&w);
    for (uint32_t step = 0; step < STEPS && w.active; step++) {
        bounce(&w, walk, step);
        look_for_lamps(&w);
    }
    return w.lit;
}
