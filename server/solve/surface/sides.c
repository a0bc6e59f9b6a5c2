#include "server/solve/surface/sides.h"

/* The reader looks from this far before the ray's end, in texels: high enough that a bulge does not hide its own
 * neighbours. */
#define BEFORE 0.1f

/* A texel that may be read, by its distance from the ray's end. */
struct candidate {
    uint32_t texel; /* within the object */
    struct lw_vec3 place_ws;
    float square_m;
};

struct reader {
    const struct lw_sides *sides;
    uint32_t object;
    struct lw_affine to_world;
    struct lw_sample_points_frame frame;
    struct lw_vec3 end_ws, eye_ws;
};

/* Where a texel's light comes from, off the surface. */
static struct candidate candidate_of(const struct reader *r, uint32_t local) {
    const struct lw_texels *texels = r->sides->texels;
    const struct lw_mesh_texels *mesh = &texels->mesh[texels->scene->object[r->object].mesh];
    const struct lw_vec3 normal = lw_affine_normal(&r->to_world, lw_texels_vector(mesh->geometric, local));
    struct candidate c = {.texel = local};
    c.place_ws = lw_vec3_mad(lw_affine_point(&r->to_world, lw_texels_place(texels, r->object, local)), normal,
                             lw_sample_points_lift_m(&r->frame, mesh->sample_points.lift[local]));
    const struct lw_vec3 way = lw_vec3_sub(c.place_ws, r->end_ws);
    c.square_m = lw_vec3_dot(way, way);
    return c;
}

/* Which of some places the reader sees. */
static uint16_t seen_of(const struct reader *r, const struct candidate *c, uint32_t count) {
    struct lw_ray16 rays = {.salt = 0};
    const uint16_t active = (uint16_t)((1u << count) - 1);
    for (uint32_t k = 0; k < count; k++)
        lw_trace_set_ray(&rays, k, r->eye_ws, lw_vec3_sub(c[k].place_ws, r->eye_ws), LW_TRACE_SHORT);
    return active & (uint16_t)~lw_trace_occluded16(r->sides->trace, LW_TRACE_LIGHT, active, &rays);
}

/* Lists the sixteen nearest covered texels around one, nearest first. */
static uint32_t list_around(const struct reader *r, uint32_t local, struct candidate out[LW_TRACE_WIDTH]) {
    const struct lw_texels *texels = r->sides->texels;
    const struct lw_mesh_texels *mesh = &texels->mesh[texels->scene->object[r->object].mesh];
    const uint8_t *covered = texels->covered + texels->first[r->object];
    struct lw_texels_neighbour near[LW_TEXELS_NEIGHBOURS_MAX];
    uint32_t x, y, count = 0;
    lw_texels_coordinates(mesh, local, &x, &y);
    const uint32_t all = lw_texels_neighbours(mesh, covered, x, y, near);
    for (uint32_t k = 0; k < all; k++) {
        const struct candidate c = candidate_of(r, lw_texels_index(mesh, near[k].x, near[k].y));
        uint32_t i = count < LW_TRACE_WIDTH ? count++ : count;
        for (; i > 0 && out[i - 1].square_m > c.square_m; i--)
            if (i < LW_TRACE_WIDTH) out[i] = out[i - 1];
        if (i < LW_TRACE_WIDTH) out[i] = c;
    }
    return count;
}

uint32_t lw_sides_read(const struct lw_sides *sides, uint32_t object, uint32_t under, struct lw_vec3 origin,
                       struct lw_vec3 dir, float t) {
    const struct lw_texels *texels = sides->texels;
    const uint32_t first = texels->first[object], source = texels->source[under];
    struct reader r = {.sides = sides, .object = object, .to_world = sides->pose->object_to_world[object]};
    lw_sample_points_frame_init(&r.frame, &r.to_world);
    const float size_m = texels->mesh[texels->scene->object[object].mesh].texel_m * r.frame.stretch;
    r.end_ws = lw_vec3_mad(origin, dir, t);
    r.eye_ws = lw_vec3_mad(origin, dir, t - fminf(BEFORE * size_m / lw_vec3_length(dir), 0.5f * t));
    struct candidate c[LW_TRACE_WIDTH];
    if (source != LW_TEXEL_NONE) {
        c[0] = candidate_of(&r, source - first);
        if (seen_of(&r, c, 1)) return source;
    }
    const uint32_t count = list_around(&r, under - first, c);
    const uint16_t seen = count ? seen_of(&r, c, count) : 0;
    return seen ? first + c[__builtin_ctz(seen)].texel : LW_TEXEL_NONE;
}
