#include "common/base/colour.h"
#include "common/scene/scene.h"
#include "common/shading/tangent.h"

#include <string.h>

/* floorf() without the call that it is where the instruction set has no rounding (SSE2). */
static inline float whole(float x) {
    if (!(fabsf(x) < 0x1p23f)) return x; /* whole already, or no number */
    float cut = (float)(int)x;
    return cut > x ? cut - 1 : cut;
}

/* fminf(fmaxf(x, low), high) without those calls: NaN becomes low. */
static float clamp(float x, float low, float high) {
    x = x > low ? x : low;
    return x < high ? x : high;
}

/* Brings a texture coordinate into the wrap mode's period, so that the texel index fits an int for any
 * file. Finite inputs may still have overflowed in the UV transform; NaN and infinities end at 0. */
static inline float reduce(float u, uint8_t wrap) {
    switch ((enum lw_wrap)wrap) {
    case LW_WRAP_REPEAT:
        u -= whole(u);
        break;
    case LW_WRAP_MIRROR:
        u -= 2 * whole(u / 2);
        break;
    case LW_WRAP_CLAMP:
        u = clamp(u, 0, 1);
        break;
    }
    return u >= 0 && u <= 2 ? u : 0;
}

/* Texel index of i, at most one texel outside the period. */
static inline uint32_t wrap_index(int i, int side, uint8_t wrap) {
    switch ((enum lw_wrap)wrap) {
    case LW_WRAP_REPEAT:
        i = i < 0 ? i + side : i >= side ? i - side : i;
        break;
    case LW_WRAP_MIRROR:
        i = i < 0 ? i + 2 * side : i >= 2 * side ? i - 2 * side : i;
        if (i >= side) i = 2 * side - 1 - i;
        break;
    case LW_WRAP_CLAMP:
        i = i < 0 ? 0 : i >= side ? side - 1 : i;
        break;
    }
    return (uint32_t)i;
}

static struct lw_vec4 texel(const uint8_t *p) {
    return (struct lw_vec4){lw_colour_from_srgb8(p[0]), lw_colour_from_srgb8(p[1]),
                            lw_colour_from_srgb8(p[2]), (float)p[3] * (1.0f / 255.0f)};
}

static struct lw_vec4 mix(struct lw_vec4 a, struct lw_vec4 b, float t) {
    float s = 1 - t;
    return (struct lw_vec4){s * a.x + t * b.x, s * a.y + t * b.y, s * a.z + t * b.z, s * a.w + t * b.w};
}

static inline void find_texels(const struct lw_texture *texture, const struct lw_texture_use *use,
                               struct lw_vec2 uv, struct lw_texture_quad *out) {
    const float *m = use->transform;
    float u = reduce(m[0] * uv.x + m[1] * uv.y + m[2], texture->wrap_s);
    float v = reduce(m[3] * uv.x + m[4] * uv.y + m[5], texture->wrap_t);
    int width = (int)texture->width, height = (int)texture->height;
    float x = u * (float)width - 0.5f, y = v * (float)height - 0.5f;
    int i = (int)x, j = (int)y; /* towards 0, but the floor is wanted */
    i -= (float)i > x, j -= (float)j > y;
    uint32_t x0 = wrap_index(i, width, texture->wrap_s), x1 = wrap_index(i + 1, width, texture->wrap_s);
    uint32_t y0 = wrap_index(j, height, texture->wrap_t), y1 = wrap_index(j + 1, height, texture->wrap_t);
    const uint8_t *upper = texture->rgba + 4 * ((size_t)y0 * texture->width);
    const uint8_t *lower = texture->rgba + 4 * ((size_t)y1 * texture->width);
    out->at[0] = upper + 4 * (size_t)x0;
    out->at[1] = upper + 4 * (size_t)x1;
    out->at[2] = lower + 4 * (size_t)x0;
    out->at[3] = lower + 4 * (size_t)x1;
    out->x = x - (float)i;
    out->y = y - (float)j;
}

static struct lw_vec4 read_texels(const struct lw_texture_quad *t) {
    return mix(mix(texel(t->at[0]), texel(t->at[1]), t->x), mix(texel(t->at[2]), texel(t->at[3]), t->x),
               t->y);
}

/* The last of those channels, by the same steps. */
static float read_alpha(const struct lw_texture_quad *t) {
    float a[4], s = 1 - t->x;
    for (int i = 0; i < 4; i++) a[i] = (float)t->at[i][3] * (1.0f / 255.0f);
    return (1 - t->y) * (s * a[0] + t->x * a[1]) + t->y * (s * a[2] + t->x * a[3]);
}

struct lw_vec4 lw_scene_sample(const struct lw_scene *scene, const struct lw_texture_use *use,
                               struct lw_vec2 uv) {
    if (use->texture == LW_SCENE_NONE) return (struct lw_vec4){1, 1, 1, 1};
    struct lw_texture_quad texels;
    find_texels(&scene->texture[use->texture], use, uv, &texels);
    return read_texels(&texels);
}

static struct lw_vec4 linear_texel(const uint8_t *p) {
    const float unit = 1.0f / 255.0f;
    return (struct lw_vec4){(float)p[0] * unit, (float)p[1] * unit, (float)p[2] * unit, (float)p[3] * unit};
}

static struct lw_vec4 read_linear(const struct lw_texture_quad *t) {
    return mix(mix(linear_texel(t->at[0]), linear_texel(t->at[1]), t->x),
               mix(linear_texel(t->at[2]), linear_texel(t->at[3]), t->x), t->y);
}

struct lw_vec4 lw_scene_sample_finish(const struct lw_scene *scene, const struct lw_texture_use *use,
                                      struct lw_vec2 uv) {
    if (use->texture == LW_SCENE_NONE) return (struct lw_vec4){1, 1, 1, 1};
    const struct lw_texture *texture = &scene->finish_texture[use->texture];
    struct lw_texture_quad t;
    find_texels(texture, use, uv, &t);
    return texture->content == LW_CONTENT_COLOUR ? read_texels(&t) : read_linear(&t);
}

/* Barycentric weights of a triangle's corners, with the corners. */
struct corners {
    uint32_t vertex[3];
    float weight[3];
};

static struct corners find_corners(const struct lw_mesh *mesh, uint32_t triangle, float u, float v) {
    const uint32_t *t = mesh->triangle[triangle];
    return (struct corners){{t[0], t[1], t[2]}, {1 - u - v, u, v}};
}

static struct lw_vec2 interpolate2(const struct lw_vec2 *array, const struct corners *c) {
    if (!array) return (struct lw_vec2){0, 0};
    const struct lw_vec2 corner[3] = {array[c->vertex[0]], array[c->vertex[1]], array[c->vertex[2]]};
    return lw_scene_facet_mean(corner, c->weight);
}

static struct lw_vec3 interpolate3(const struct lw_vec3 *array, const struct corners *c) {
    struct lw_vec3 a = lw_vec3_scale(array[c->vertex[0]], c->weight[0]);
    return lw_vec3_mad(lw_vec3_mad(a, array[c->vertex[1]], c->weight[1]), array[c->vertex[2]], c->weight[2]);
}

static struct lw_vec4 interpolate4(const struct lw_vec4 *array, const struct corners *c) {
    struct lw_vec4 a = array[c->vertex[0]], b = array[c->vertex[1]], d = array[c->vertex[2]];
    const float *w = c->weight;
    return (struct lw_vec4){w[0] * a.x + w[1] * b.x + w[2] * d.x, w[0] * a.y + w[1] * b.y + w[2] * d.y,
                            w[0] * a.z + w[1] * b.z + w[2] * d.z, w[0] * a.w + w[1] * b.w + w[2] * d.w};
}

static float clamp01(float x) { return clamp(x, 0, 1); }

static float opacity(const struct lw_material *material, float alpha) {
    switch ((enum lw_alpha_mode)material->alpha_mode) {
    case LW_ALPHA_MASK:
        return alpha >= material->alpha_cutoff ? 1 : 0;
    case LW_ALPHA_BLEND:
        return clamp01(alpha);
    case LW_ALPHA_OPAQUE:
        break;
    }
    return 1;
}

/* sample: of its texture. */
static struct lw_vec4 tint(const struct lw_mesh *mesh, const struct lw_material *material,
                           struct lw_vec4 sample, const struct corners *corners) {
    const float *f = material->base_colour;
    struct lw_vec4 t = {f[0] * sample.x, f[1] * sample.y, f[2] * sample.z, f[3] * sample.w};
    if (!mesh->colour) return t;
    struct lw_vec4 c = interpolate4(mesh->colour, corners);
    return (struct lw_vec4){t.x * c.x, t.y * c.y, t.z * c.z, t.w * c.w};
}

static struct lw_vec4 base_colour(const struct lw_scene *scene, const struct lw_mesh *mesh,
                                  const struct lw_material *material, const struct corners *corners) {
    const struct lw_texture_use *use = &material->base_colour_texture;
    struct lw_vec2 uv = interpolate2(mesh->uv[use->uv_set], corners);
    return tint(mesh, material, lw_scene_sample(scene, use, uv), corners);
}

static struct lw_vec4 finish_texel(const struct lw_scene *scene, const struct lw_mesh *mesh,
                                   const struct lw_texture_use *use, const struct corners *corners) {
    if (use->texture == LW_SCENE_NONE) return (struct lw_vec4){1, 1, 1, 1};
    return lw_scene_sample_finish(scene, use, interpolate2(mesh->uv[use->uv_set], corners));
}

static float blend(float a, float b, float t) { return a + t * (b - a); }

/* The lobes of a surface of this base colour. */
static struct lw_lobes lobes_of(const struct lw_scene *scene, const struct lw_mesh *mesh,
                                const struct lw_finish *finish, const struct corners *corners,
                                struct lw_vec3 base) {
    const struct lw_vec4 surface = finish_texel(scene, mesh, &finish->surface_texture, corners);
    const struct lw_vec4 mirror = finish_texel(scene, mesh, &finish->specular_texture, corners);
    const float metal = clamp01(finish->metalness * surface.z), under = 1 - metal;
    const float strength = clamp01(finish->specular * mirror.w);
    const float bend = (finish->ior - 1) / (finish->ior + 1), f0 = bend * bend;
    const float *tint = finish->specular_colour;
    const struct lw_vec3 gloss =
        lw_vec3(clamp01(f0 * tint[0] * mirror.x) * strength, clamp01(f0 * tint[1] * mirror.y) * strength,
                clamp01(f0 * tint[2] * mirror.z) * strength);
    return (struct lw_lobes){
        .diffuse = lw_vec3_scale(base, under),
        .f0 = lw_vec3(blend(gloss.x, base.x, metal), blend(gloss.y, base.y, metal),
                      blend(gloss.z, base.z, metal)),
        .f90 = blend(strength, 1, metal),
        .gloss0 = fmaxf(gloss.x, fmaxf(gloss.y, gloss.z)),
        .gloss90 = strength,
        .roughness = clamp01(finish->roughness * surface.y),
    };
}

/* What a surface of that base colour reflects diffusely; what of an unlit one is seen is added to its
 * emission. */
static struct lw_vec3 reflected(const struct lw_scene *scene, const struct lw_mesh *mesh,
                                const struct lw_material *material, const struct corners *corners,
                                struct lw_vec3 base, struct lw_vec3 *emission) {
    if (material->unlit) {
        *emission = lw_vec3_add(*emission, base);
        return lw_vec3(0, 0, 0);
    }
    if (!material->finish) return base;
    const struct lw_lobes lobes = lobes_of(scene, mesh, material->finish, corners, base);
    return lw_lobes_albedo(&lobes);
}

static struct lw_vec3 clamp_colour(struct lw_vec4 colour) {
    return lw_vec3(clamp01(colour.x), clamp01(colour.y), clamp01(colour.z));
}

static struct lw_vec3 emission(const struct lw_scene *scene, const struct lw_mesh *mesh,
                               const struct lw_material *material, const struct corners *corners) {
    const float *e = material->emission;
    if (e[0] == 0 && e[1] == 0 && e[2] == 0) return lw_vec3(0, 0, 0);
    const struct lw_texture_use *use = &material->emission_texture;
    struct lw_vec4 t = lw_scene_sample(scene, use, interpolate2(mesh->uv[use->uv_set], corners));
    return lw_vec3(e[0] * t.x, e[1] * t.y, e[2] * t.z);
}

struct lw_vec3 lw_scene_normal(const struct lw_mesh *mesh, uint32_t triangle, float u, float v,
                               struct lw_vec3 *out_geometric) {
    struct corners corners = find_corners(mesh, triangle, u, v);
    const uint32_t *vertex = corners.vertex;
    struct lw_vec3 origin = mesh->position[vertex[0]];
    struct lw_vec3 face = lw_vec3_cross(lw_vec3_sub(mesh->position[vertex[1]], origin),
                                        lw_vec3_sub(mesh->position[vertex[2]], origin));
    struct lw_vec3 normal = interpolate3(mesh->normal, &corners);
    *out_geometric = lw_vec3_normalize(face);
    /* Opposite corner normals can cancel: then the face knows better than rounding does. */
    return lw_vec3_length(normal) > 1e-6f ? lw_vec3_normalize(normal) : *out_geometric;
}

void lw_scene_surface(const struct lw_scene *scene, const struct lw_mesh *mesh, uint32_t triangle, float u,
                      float v, struct lw_surface *out) {
    const struct lw_material *material = &scene->material[mesh->material[triangle]];
    struct corners corners = find_corners(mesh, triangle, u, v);
    struct lw_vec4 colour = base_colour(scene, mesh, material, &corners);
    out->position = interpolate3(mesh->position, &corners);
    out->normal = lw_scene_normal(mesh, triangle, u, v, &out->geometric_normal);
    out->alpha = opacity(material, colour.w);
    out->emission = emission(scene, mesh, material, &corners);
    out->base = clamp_colour(colour);
    out->albedo = reflected(scene, mesh, material, &corners, out->base, &out->emission);
    out->lightmap_uv = interpolate2(mesh->lightmap_uv, &corners);
    out->material = material;
}

struct lw_vec3 lw_scene_albedo(const struct lw_scene *scene, const struct lw_mesh *mesh, uint32_t triangle,
                               float u, float v, float *out_alpha) {
    const struct lw_material *material = &scene->material[mesh->material[triangle]];
    const struct corners corners = find_corners(mesh, triangle, u, v);
    const struct lw_vec4 colour = base_colour(scene, mesh, material, &corners);
    struct lw_vec3 seen = {0};
    *out_alpha = opacity(material, colour.w);
    return reflected(scene, mesh, material, &corners, clamp_colour(colour), &seen);
}

static void gather2(const struct lw_vec2 *array, const uint32_t vertex[3], struct lw_vec2 out[3]) {
    for (int i = 0; i < 3; i++) out[i] = array ? array[vertex[i]] : (struct lw_vec2){0, 0};
}

/* Whether what it reflects differs from place to place. */
static bool finish_varies(const struct lw_finish *finish) {
    return finish && (finish->surface_texture.texture != LW_SCENE_NONE ||
                      finish->specular_texture.texture != LW_SCENE_NONE);
}

void lw_scene_facet(const struct lw_scene *scene, const struct lw_mesh *mesh, uint32_t triangle,
                    struct lw_facet *out) {
    const struct lw_material *material = &scene->material[mesh->material[triangle]];
    const struct lw_texture_use *base = &material->base_colour_texture, *glow = &material->emission_texture;
    const float *f = material->base_colour, *e = material->emission;
    const uint32_t *vertex = mesh->triangle[triangle];
    const bool shines = e[0] != 0 || e[1] != 0 || e[2] != 0;
    out->mesh = mesh;
    out->material = material;
    for (int i = 0; i < 3; i++) out->vertex[i] = vertex[i];
    out->varies = base->texture != LW_SCENE_NONE || mesh->colour ||
                  (shines && glow->texture != LW_SCENE_NONE) || finish_varies(material->finish);
    out->alpha = opacity(material, f[3]);
    out->emission = lw_vec3(e[0], e[1], e[2]);
    const struct corners any = {{vertex[0], vertex[1], vertex[2]}, {1, 0, 0}};
    out->base = clamp_colour((struct lw_vec4){f[0], f[1], f[2], 1});
    if (out->varies && material->finish)
        out->albedo = out->base; /* nobody reads it */
    else
        out->albedo = reflected(scene, mesh, material, &any, out->base, &out->emission);
    gather2(mesh->lightmap_uv, vertex, out->lightmap_uv);
    gather2(mesh->uv[base->uv_set], vertex, out->uv);
}

void lw_scene_facet_texels(const struct lw_scene *scene, const struct lw_facet *facet, const float weight[3],
                           struct lw_texture_quad *out) {
    const struct lw_texture_use *use = &facet->material->base_colour_texture;
    out->at[0] = NULL;
    if (use->texture == LW_SCENE_NONE) return;
    find_texels(&scene->texture[use->texture], use, lw_scene_facet_mean(facet->uv, weight), out);
    __builtin_prefetch(out->at[0]);
    __builtin_prefetch(out->at[2]);
}

static struct corners facet_corners(const struct lw_facet *facet, const float weight[3]) {
    return (struct corners){{facet->vertex[0], facet->vertex[1], facet->vertex[2]},
                            {weight[0], weight[1], weight[2]}};
}

void lw_scene_facet_base(const struct lw_scene *scene, const struct lw_facet *facet, const float weight[3],
                         const struct lw_texture_quad *texels, struct lw_surface *out) {
    const struct lw_material *material = facet->material;
    const struct corners corners = facet_corners(facet, weight);
    const struct lw_vec4 sample = texels->at[0] ? read_texels(texels) : (struct lw_vec4){1, 1, 1, 1};
    const struct lw_vec4 colour = tint(facet->mesh, material, sample, &corners);
    out->alpha = opacity(material, colour.w);
    out->emission = emission(scene, facet->mesh, material, &corners);
    out->base = clamp_colour(colour);
}

void lw_scene_facet_colour(const struct lw_scene *scene, const struct lw_facet *facet, const float weight[3],
                           const struct lw_texture_quad *texels, struct lw_surface *out) {
    const struct corners corners = facet_corners(facet, weight);
    lw_scene_facet_base(scene, facet, weight, texels, out);
    out->albedo = reflected(scene, facet->mesh, facet->material, &corners, out->base, &out->emission);
}

static struct lw_vec4 interpolate_tangent(const struct lw_mesh *mesh, uint32_t triangle,
                                          const struct corners *c) {
    struct lw_vec4 sum = {0, 0, 0, 0};
    for (int i = 0; i < 3; i++) {
        const struct lw_vec4 t =
            lw_tangent_decode(mesh->tangent[3 * (size_t)triangle + (size_t)i], mesh->normal[c->vertex[i]]);
        const float w = c->weight[i];
        sum = (struct lw_vec4){sum.x + w * t.x, sum.y + w * t.y, sum.z + w * t.z, t.w};
    }
    return sum;
}

uint8_t lw_scene_normal_blue(uint8_t red, uint8_t green) {
    const int unit = 255 * 255, x = 2 * red - 255, y = 2 * green - 255; /* 255 is 1 */
    const int squared = unit - x * x - y * y;
    return (uint8_t)(127.5f + 127.5f * sqrtf((float)(squared > 0 ? squared : 0) / (float)unit) + 0.5f);
}

/* Normal of a map. Scaled by less than 0 it turns around; an even one stands where it is too short. */
static struct lw_vec3 bump_of(struct lw_vec4 texel, float scale) {
    const float x = (texel.x * 255 - 127.5f) / 127.5f, y = (texel.y * 255 - 127.5f) / 127.5f;
    const float z = sqrtf(fmaxf(1 - x * x - y * y, 1e-4f));
    return lw_vec3_normalize(lw_vec3(scale * x, scale * y, z));
}

void lw_scene_finish(const struct lw_scene *scene, const struct lw_mesh *mesh, uint32_t triangle, float u,
                     float v, const struct lw_surface *surface, struct lw_finish_point *out) {
    const struct lw_finish *finish = surface->material->finish;
    *out = (struct lw_finish_point){.lobes = lw_lobes_matt(surface->albedo), .occlusion = 1};
    if (!finish || surface->material->unlit) return;
    const struct corners corners = find_corners(mesh, triangle, u, v);
    out->lobes = lobes_of(scene, mesh, finish, &corners, surface->base);
    out->occlusion =
        1 + finish->occlusion * (finish_texel(scene, mesh, &finish->occlusion_texture, &corners).x - 1);
    if (finish->normal_texture.texture == LW_SCENE_NONE || !mesh->tangent) return;
    out->bumpy = true;
    out->bump = bump_of(finish_texel(scene, mesh, &finish->normal_texture, &corners), finish->normal_scale);
    out->tangent = interpolate_tangent(mesh, triangle, &corners);
}

struct lw_vec4 lw_scene_specular_texel(const struct lw_scene *scene, const struct lw_finish *finish,
                                       const struct lw_texture_quad *t) {
    if (scene->finish_texture[finish->specular_texture.texture].content == LW_CONTENT_COLOUR)
        return read_texels(t);
    return read_linear(t);
}

struct lw_vec3 lw_scene_bump(const struct lw_finish_point *point, struct lw_vec3 normal,
                             struct lw_vec3 tangent) {
    const struct lw_vec3 t = lw_vec3_normalize(lw_vec3_mad(tangent, normal, -lw_vec3_dot(tangent, normal)));
    const struct lw_vec3 b = lw_vec3_scale(lw_vec3_cross(normal, t), point->tangent.w);
    return lw_vec3_normalize(
        lw_vec3_mad(lw_vec3_mad(lw_vec3_scale(t, point->bump.x), b, point->bump.y), normal, point->bump.z));
}

/* Share in which a corner lifts, by the cosine of its normal with the face: see scene.h. */
static float lifting(float cosine) {
    const float none = 0.5f, full = 0.755f;
    float s = clamp01((cosine - none) / (full - none));
    return s * s * (3 - 2 * s);
}

struct lw_vec3 lw_scene_shadow_origin(const struct lw_mesh *mesh, uint32_t triangle, float u, float v,
                                      bool back) {
    struct corners corners = find_corners(mesh, triangle, u, v);
    const uint32_t *vertex = corners.vertex;
    const struct lw_vec3 first = mesh->position[vertex[0]];
    const float side = back ? -1 : 1;
    struct lw_vec3 face = lw_vec3_normalize(lw_vec3_cross(lw_vec3_sub(mesh->position[vertex[1]], first),
                                                          lw_vec3_sub(mesh->position[vertex[2]], first)));
    struct lw_vec3 p = interpolate3(mesh->position, &corners), origin = p;
    for (int i = 0; i < 3; i++) {
        struct lw_vec3 normal = mesh->normal[vertex[i]];
        float cosine = lw_vec3_dot(normal, face);
        /* Rounded normals of a flat face must not move it. */
        if (cosine > 0.99999f) continue;
        float height = side * lw_vec3_dot(lw_vec3_sub(mesh->position[vertex[i]], p), normal);
        if (!(height > 0)) continue;
        origin = lw_vec3_mad(origin, normal, side * corners.weight[i] * lifting(cosine) * height);
    }
    return origin;
}

float lw_scene_alpha(const struct lw_scene *scene, const struct lw_mesh *mesh, uint32_t triangle, float u,
                     float v) {
    const struct lw_material *material = &scene->material[mesh->material[triangle]];
    if (material->alpha_mode == LW_ALPHA_OPAQUE) return 1;
    const struct lw_texture_use *use = &material->base_colour_texture;
    struct corners corners = find_corners(mesh, triangle, u, v);
    float alpha = material->base_colour[3];
    if (use->texture != LW_SCENE_NONE) {
        struct lw_texture_quad quad;
        find_texels(&scene->texture[use->texture], use, interpolate2(mesh->uv[use->uv_set], &corners), &quad);
        alpha *= read_alpha(&quad);
    }
    if (mesh->colour) alpha *= interpolate4(mesh->colour, &corners).w;
    return opacity(material, alpha);
}
