#include "server/solve/transport/hit_sun.h"

#include "common/base/colour.h"
#include "common/base/invariant.h"

#include <math.h>

/* Shares of the sun's light that a texel in the sun has, and one in the shade. */
#define IN_SUN   0.97f
#define IN_SHADE 0.03f
/* Light that a texel sends out, times pi, over that which the ray's own block has: weaker light does not
 * matter to it. */
#define BRIGHT 1.0f
/* A texel that the sun meets at a smaller cosine is neither in the sun nor in the shade. */
#define GRAZING 0.05f
/* How far above its end a ray looks for the sun, in texels. */
#define LIFT 1e-3f

struct sun {
    struct lw_vec3 direction;  /* to it */
    struct lw_vec3 irradiance; /* where a surface faces it, W/m^2 */
};

/* An object on which rays end. */
struct ground {
    const struct lw_mesh_texels *mesh;
    const struct lw_affine *to_world;
    uint32_t first; /* of its texels */
};

static struct ground ground_of(const struct lw_transport *t, uint32_t object) {
    return (struct ground){&t->texels->mesh[t->scene->object[object].mesh], &t->pose->object_to_world[object],
                           t->texels->first[object]};
}

static struct lw_vec3 unit_normal(const struct ground *g, const uint32_t *normals, uint32_t local) {
    LW_INVARIANT_DEAR(local < g->mesh->texel_count);
    return lw_vec3_normalize(lw_affine_normal(g->to_world, lw_packed_normal_unpack(normals[local])));
}

static void find_strongest(const struct lw_lights *lights, struct lw_vec3 normal, struct sun *sun,
                           float *most) {
    for (uint32_t k = 0; lights && k < lights->sun_count; k++) {
        const struct lw_light_sample sample =
            lw_lights_sample_punctual(lights, lights->sun[k], 0, 0, lw_vec3(0, 0, 0));
        const float cosine = lw_vec3_dot(normal, sample.direction),
                    e = lw_colour_luminance(sample.irradiance_normal) * cosine;
        if (!(cosine > GRAZING) || !(e > *most)) continue;
        *sun = (struct sun){sample.direction, sample.irradiance_normal};
        *most = e;
    }
}

static bool is_bright(const struct lw_transport *t, uint32_t from, uint32_t texel) {
    const struct lw_solve_block *block = &t->tiles->block[t->tiles->block_of_texel[from]];
    return LW_PI * lw_colour_luminance(lw_tiles_radiance(t->tiles, 0, texel)) >
           BRIGHT * block->reference_luminance;
}

/* The nearest texels in the sun and in the shade: a texel itself, or those around it. */
struct pair {
    uint32_t sun, shade; /* LW_TEXEL_NONE: there is none */
    uint32_t sun_distance2, shade_distance2;
};

/* What a texel sends out of direct light tells how much of the sun it has. */
static void add_texel(struct pair *pair, const struct lw_transport *t, const struct ground *g, uint32_t local,
                      uint32_t distance2, const struct sun *sun) {
    const uint32_t texel = g->first + local;
    const float cosine = lw_vec3_dot(unit_normal(g, g->mesh->normal, local), sun->direction),
                sent = LW_PI * lw_colour_luminance(lw_tiles_radiance(t->tiles, 0, texel)),
                all = cosine * lw_colour_luminance(lw_vec3_mul(
                                   sun->irradiance, lw_packed_albedo_unpack(g->mesh->albedo[local])));
    if (!(cosine > GRAZING) || !(all > 0)) return;
    if (sent >= IN_SUN * all && distance2 < pair->sun_distance2)
        pair->sun = texel, pair->sun_distance2 = distance2;
    if (sent <= IN_SHADE * all && distance2 < pair->shade_distance2)
        pair->shade = texel, pair->shade_distance2 = distance2;
}

static struct pair find_pair(const struct lw_transport *t, const struct ground *g, uint32_t local,
                             const struct sun *sun) {
    struct lw_texels_neighbour near[LW_TEXELS_NEIGHBOURS_MAX];
    struct pair pair = {LW_TEXEL_NONE, LW_TEXEL_NONE, UINT32_MAX, UINT32_MAX};
    uint32_t x, y;
    lw_texels_coordinates(g->mesh, local, &x, &y);
    const uint32_t count = lw_texels_neighbours(g->mesh, t->texels->covered + g->first, x, y, near);
    add_texel(&pair, t, g, local, 0, sun);
    for (uint32_t k = 0; k < count; k++)
        add_texel(&pair, t, g, lw_texels_index(g->mesh, near[k].x, near[k].y), near[k].distance2, sun);
    return pair;
}

/* Sets up a lane's ray to the sun, which starts as those of texels do; false: no edge runs by here. */
static bool look_for_sun(const struct lw_transport *t, const struct lw_hit16 *hits, uint32_t lane,
                         uint32_t texel, struct lw_ray16 *out_rays, struct pair *out_pair) {
    const uint32_t object = hits->object[lane];
    const struct ground g = ground_of(t, object);
    const uint32_t local = texel - g.first;
    struct sun sun;
    float most = 0;
    const struct lw_vec3 normal = unit_normal(&g, g.mesh->normal, local);
    find_strongest(t->lights, normal, &sun, &most);
    find_strongest(t->drawn, normal, &sun, &most);
    if (!(most > 0)) return false;
    *out_pair = find_pair(t, &g, local, &sun);
    if (out_pair->sun == LW_TEXEL_NONE || out_pair->shade == LW_TEXEL_NONE) return false;
    const struct lw_vec3 start =
        lw_scene_shadow_origin(&t->scene->mesh[t->scene->object[object].mesh], hits->triangle[lane],
                               hits->u[lane], hits->v[lane], hits->back[lane]);
    const float lift_m = LIFT * g.mesh->texel_m * lw_affine_stretch(g.to_world);
    lw_trace_set_ray(
        out_rays, lane,
        lw_vec3_mad(lw_affine_point(g.to_world, start), unit_normal(&g, g.mesh->geometric, local), lift_m),
        sun.direction, INFINITY);
    return true;
}

void lw_hit_sun_read16(const struct lw_transport *t, uint16_t active, const uint32_t from[LW_TRACE_WIDTH],
                       uint32_t salt, const struct lw_hit16 *hits, uint32_t hit[LW_TRACE_WIDTH],
                       struct lw_ray_count *count) {
    if (!t->lights->sun_count && !(t->drawn && t->drawn->sun_count)) return;
    struct pair pair[LW_TRACE_WIDTH];
    struct lw_ray16 looks = {.salt = salt};
    uint16_t asked = 0;
    for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++)
        if (active >> lane & 1 && is_bright(t, from[lane], hit[lane]) &&
            look_for_sun(t, hits, lane, hit[lane], &looks, &pair[lane]))
            asked |= (uint16_t)(1u << lane);
    if (!asked) return;
    const uint16_t dark = lw_trace_occluded16(t->trace, LW_TRACE_LIGHT, asked, &looks);
    count->shadow += (uint64_t)__builtin_popcount(asked);
    for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++)
        if (asked >> lane & 1) hit[lane] = dark >> lane & 1 ? pair[lane].shade : pair[lane].sun;
}
