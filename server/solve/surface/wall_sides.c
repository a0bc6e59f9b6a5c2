#include "server/solve/surface/wall_sides.h"

/* The reader looks from this far before the ray's end, in texels: high enough that a bulge does not hide its
 * own neighbours. */
#define BEFORE 0.1f
/* Share of the way to a texel's place that must be free: the place lies on the surface. */
#define WAY 0.98f

/* Where one ray ends. */
struct reader {
    const struct lw_texels *texels;
    const struct lw_trace *trace;
    uint32_t object;
    struct lw_affine to_world;
    struct lw_vec3 end, eye; /* world space */
};

/* A texel that it may read. */
struct candidate {
    uint32_t texel; /* within the object */
    struct lw_vec3 place;
    float square; /* squared distance from the ray's end, m^2 */
};

static const struct lw_mesh_texels *mesh_of(const struct lw_texels *texels, uint32_t object) {
    return &texels->mesh[texels->scene->object[object].mesh];
}

static struct reader reader_of(const struct lw_wall_sides *sides, const struct lw_ray16 *rays,
                               const struct lw_hit16 *hits, uint32_t lane) {
    const struct lw_vec3 origin = lw_vec3(rays->org_x[lane], rays->org_y[lane], rays->org_z[lane]),
                         dir = lw_vec3(rays->dir_x[lane], rays->dir_y[lane], rays->dir_z[lane]);
    const uint32_t object = hits->object[lane];
    const float t = hits->t[lane];
    struct reader r = {.texels = sides->texels,
                       .trace = sides->trace,
                       .object = object,
                       .to_world = sides->pose->object_to_world[object]};
    const float size_m = mesh_of(r.texels, object)->texel_m * lw_affine_stretch(&r.to_world);
    r.end = lw_vec3_mad(origin, dir, t);
    r.eye = lw_vec3_mad(origin, dir, t - fminf(BEFORE * size_m / lw_vec3_length(dir), 0.5f * t));
    return r;
}

static struct candidate candidate_of(const struct reader *r, uint32_t local) {
    const struct lw_vec3 place = lw_affine_point(&r->to_world, lw_texels_place(r->texels, r->object, local)),
                         way = lw_vec3_sub(place, r->end);
    return (struct candidate){.texel = local, .place = place, .square = lw_vec3_dot(way, way)};
}

static void look_at(const struct reader *r, struct lw_ray16 *rays, uint32_t lane, struct lw_vec3 place) {
    lw_trace_set_ray(rays, lane, r->eye, lw_vec3_sub(place, r->eye), WAY);
}

/* The covered texels around one, the sixteen nearest, nearest first. */
static uint32_t list_around(const struct reader *r, uint32_t local, struct candidate out[LW_TRACE_WIDTH]) {
    const struct lw_mesh_texels *mesh = mesh_of(r->texels, r->object);
    struct lw_texels_neighbour near[LW_TEXELS_NEIGHBOURS_MAX];
    uint32_t x, y, count = 0;
    lw_texels_coordinates(mesh, local, &x, &y);
    const uint32_t all =
        lw_texels_neighbours(mesh, r->texels->covered + r->texels->first[r->object], x, y, near);
    for (uint32_t k = 0; k < all; k++) {
        const struct candidate c = candidate_of(r, lw_texels_index(mesh, near[k].x, near[k].y));
        uint32_t i = count;
        for (; i > 0 && out[i - 1].square > c.square; i--)
            if (i < LW_TRACE_WIDTH) out[i] = out[i - 1];
        if (i < LW_TRACE_WIDTH) out[i] = c;
        if (count < LW_TRACE_WIDTH) count++;
    }
    return count;
}

/* The nearest texel around one that the reader sees. */
static uint32_t search_around(const struct reader *r, uint32_t local) {
    struct candidate c[LW_TRACE_WIDTH];
    struct lw_ray16 rays = {.salt = 0};
    const uint32_t count = list_around(r, local, c);
    if (!count) return LW_TEXEL_NONE;
    for (uint32_t k = 0; k < count; k++) look_at(r, &rays, k, c[k].place);
    const uint16_t active = (uint16_t)((1u << count) - 1),
                   seen = active & (uint16_t)~lw_trace_occluded16(r->trace, LW_TRACE_LIGHT, active, &rays);
    return seen ? r->texels->first[r->object] + c[__builtin_ctz(seen)].texel : LW_TEXEL_NONE;
}

void lw_wall_sides_read16(const struct lw_wall_sides *sides, uint16_t active, const struct lw_ray16 *rays,
                          const struct lw_hit16 *hits, uint32_t texel[LW_TRACE_WIDTH]) {
    const struct lw_texels *texels = sides->texels;
    struct reader reader[LW_TRACE_WIDTH];
    struct lw_ray16 looks = {.salt = 0};
    uint16_t asked = 0, blind = 0;
    for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++) {
        if (!(active >> lane & 1) || texel[lane] == LW_TEXEL_NONE) continue;
        const uint32_t source = texels->source[texel[lane]], object = hits->object[lane];
        if (!(texels->walls[texel[lane]] & LW_TEXELS_WALL_NEAR)) {
            texel[lane] = source;
            continue;
        }
        reader[lane] = reader_of(sides, rays, hits, lane);
        if (source == LW_TEXEL_NONE) {
            blind |= (uint16_t)(1u << lane);
            continue;
        }
        look_at(&reader[lane], &looks, lane,
                candidate_of(&reader[lane], source - texels->first[object]).place);
        asked |= (uint16_t)(1u << lane);
    }
    if (asked) blind |= lw_trace_occluded16(sides->trace, LW_TRACE_LIGHT, asked, &looks) & asked;
    for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++) {
        if (blind >> lane & 1)
            texel[lane] = search_around(&reader[lane], texel[lane] - texels->first[reader[lane].object]);
        else if (asked >> lane & 1)
            texel[lane] = texels->source[texel[lane]];
    }
}

void lw_wall_sides_at16(const struct lw_wall_sides *sides, uint16_t active, const struct lw_ray16 *rays,
                        const struct lw_hit16 *hits, uint32_t out_texel[LW_TRACE_WIDTH]) {
    for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++)
        out_texel[lane] = !(active >> lane & 1) || hits->object[lane] == LW_TRACE_MISS
                              ? LW_TEXEL_NONE
                              : lw_texels_under(sides->texels, hits->object[lane], hits->triangle[lane],
                                                hits->u[lane], hits->v[lane], hits->back[lane]);
    lw_wall_sides_read16(sides, active, rays, hits, out_texel);
}
