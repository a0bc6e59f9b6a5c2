#include "server/solve/transport/hit_gloss.h"

#include "common/base/colour.h"
#include "common/shading/lobes.h"

#include <math.h>

#define HIT_GLOSS_ROUGHNESS 0.5f
#define FACTOR_MAX          60.0f /* a uint16_t holds little more */
#define EVEN                0.2f  /* light of which less has a direction has none */
#define GRAZING             0.02f /* cosines below it have no lobe to speak of */
#define WEAK                0.01f /* share of all light where the ray began */

/* The cosine moment of a texel's direct light. */
static struct lw_vec3 moment_of(const struct lw_tiles *tiles, uint32_t texel) {
    struct lw_vec3 v = lw_texels_vector(tiles->moment[LW_TILES_DIRECT], texel);
    if (tiles->drawn_moment[0]) v = lw_vec3_add(v, lw_texels_vector(tiles->drawn_moment, texel));
    return v;
}

/* pi f for the luminance: both directions unit, above the surface. */
static float lobe(const struct lw_lobes *lobes, struct lw_vec3 normal, struct lw_vec3 out,
                  struct lw_vec3 in) {
    const float out_z = lw_vec3_dot(normal, out), in_z = lw_vec3_dot(normal, in),
                out_x = sqrtf(fmaxf(1 - out_z * out_z, 0)), in_r = sqrtf(fmaxf(1 - in_z * in_z, 0));
    /* the angle between the two about the normal, from their own cosine */
    const float across = out_x * in_r,
                turn = across > 1e-6f ? (lw_vec3_dot(out, in) - out_z * in_z) / across : 1,
                cosine = fminf(1, fmaxf(-1, turn));
    const struct lw_vec3 to = lw_vec3(out_x, 0, out_z),
                         from = lw_vec3(in_r * cosine, in_r * sqrtf(1 - cosine * cosine), in_z);
    const struct lw_lobes_seen seen = lw_lobes_see(lobes, to);
    return LW_PI * lw_colour_luminance(lw_lobes_reflect(&seen, from)) / in_z;
}

/* Whether light of which a ray of a texel brings that much matters to it. */
static bool is_weak(const struct lw_transport *t, uint32_t from, uint32_t texel) {
    const struct lw_vec3 sent = lw_tiles_radiance(t->tiles, 0, texel);
    const struct lw_solve_block *block = &t->tiles->block[t->tiles->block_of_texel[from]];
    return LW_PI * lw_colour_luminance(sent) < WEAK * block->reference_luminance;
}

static float factor_of(const struct lw_transport *t, const struct lw_ray16 *rays, const struct lw_hit16 *hits,
                       uint32_t lane, uint32_t texel) {
    const struct lw_scene *scene = t->scene;
    const uint32_t o = hits->object[lane], triangle = hits->triangle[lane];
    const struct lw_mesh *mesh = &scene->mesh[scene->object[o].mesh];
    const struct lw_material *material = &scene->material[mesh->material[triangle]];
    if (!material->finish || material->unlit) return 1;
    const float e = lw_colour_luminance(lw_texels_vector(t->tiles->direct, texel));
    if (!(e > 0)) return 1;
    const struct lw_vec3 v = moment_of(t->tiles, texel);
    const float length = lw_vec3_length(v), share = fminf(1, length / e);
    if (!(share > EVEN)) return 1;
    const struct lw_vec3 out = lw_vec3_normalize(
                             lw_vec3(-rays->dir_x[lane], -rays->dir_y[lane], -rays->dir_z[lane])),
                         in = lw_vec3_scale(v, 1 / length);
    struct lw_surface surface;
    lw_scene_surface(scene, mesh, triangle, hits->u[lane], hits->v[lane], &surface);
    struct lw_vec3 normal = lw_vec3_normalize(lw_affine_normal(
        &t->pose->object_to_world[o], lw_scene_light_normal(surface.normal, surface.geometric_normal)));
    if (lw_vec3_dot(normal, out) < 0) normal = lw_vec3_scale(normal, -1);
    if (lw_vec3_dot(normal, out) < GRAZING || lw_vec3_dot(normal, in) < GRAZING) return 1;
    struct lw_finish_point point;
    lw_scene_finish(scene, mesh, triangle, hits->u[lane], hits->v[lane], &surface, &point);
    const float albedo = lw_colour_luminance(lw_lobes_albedo(&point.lobes));
    if (!(albedo > 0)) return 1;
    point.lobes.roughness = fmaxf(point.lobes.roughness, HIT_GLOSS_ROUGHNESS);
    const float lit = lobe(&point.lobes, normal, out, in) / albedo;
    return isfinite(lit) ? 1 - share + share * lit : 1;
}

uint16_t lw_hit_gloss(const struct lw_transport *t, const struct lw_ray16 *rays, const struct lw_hit16 *hits,
                      uint32_t lane, uint32_t from, uint32_t texel) {
    if (is_weak(t, from, texel)) return LW_HIT_GLOSS_ONE;
    const float factor = factor_of(t, rays, hits, lane, texel);
    return (uint16_t)(LW_HIT_GLOSS_ONE * fminf(factor, FACTOR_MAX) + 0.5f);
}
