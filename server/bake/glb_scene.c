#include "server/bake/glb_scene.h"

#include "server/bake/manifest.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Texture coordinates in the file: set 0 as it was, the lightmap's in set 1, as engines expect it; the
 * scene's own set 1, where a texture uses it, moves to 2. */
#define UV_LIGHTMAP 1
#define UV_MOVED    2

enum attribute { POSITION, NORMAL, TEXCOORD_0, TEXCOORD_1, TEXCOORD_2, COLOR_0, ATTRIBUTE_COUNT };
static const char *const attribute_name[ATTRIBUTE_COUNT] = {"POSITION",   "NORMAL",     "TEXCOORD_0",
                                                            "TEXCOORD_1", "TEXCOORD_2", "COLOR_0"};

enum {
    WRAP_REPEAT = 10497,
    WRAP_CLAMP = 33071,
    WRAP_MIRROR = 33648,
    FILTER_LINEAR = 9729,
    FILTER_MIPMAP = 9987
};

static void set(json_t *object, const char *key, json_t *value) {
    if (object)
        json_object_set_new(object, key, value);
    else
        json_decref(value);
}

static void out_of_memory(struct lw_glb_scene *g) { lw_glb_fail(&g->glb, LW_NO_MEMORY, "out of memory"); }

/* ---- making and releasing ---- */

static uint32_t *filled(size_t count) {
    uint32_t *array = malloc((count + 1) * sizeof *array);
    for (size_t i = 0; array && i <= count; i++) array[i] = LW_GLB_NONE;
    return array;
}

enum lw_status lw_glb_scene_init(struct lw_glb_scene *g, const struct lw_glb_scene_desc *desc) {
    const struct lw_scene *scene = desc->scene;
    *g = (struct lw_glb_scene){.desc = *desc,
                               .mesh = calloc((size_t)scene->mesh_count + 1, sizeof *g->mesh),
                               .texture = filled(scene->texture_count),
                               .image = filled(scene->texture_count),
                               .finish_texture = filled(scene->finish_texture_count),
                               .finish_image = filled(scene->finish_texture_count),
                               .object_mesh = filled(scene->object_count),
                               .object_extras =
                                   calloc((size_t)scene->object_count + 1, sizeof *g->object_extras),
                               .lightmap_sampler = LW_GLB_NONE};
    lw_glb_init(&g->glb, "lightwell " LW_VERSION);
    if (g->mesh && g->texture && g->image && g->finish_texture && g->finish_image && g->object_mesh &&
        g->object_extras && g->glb.error.status == LW_OK)
        return LW_OK;
    lw_glb_scene_finish(g);
    return LW_NO_MEMORY;
}

void lw_glb_scene_finish(struct lw_glb_scene *g) {
    const struct lw_scene *scene = g->desc.scene;
    if (!scene) return;
    for (uint32_t m = 0; g->mesh && m < scene->mesh_count; m++) {
        free(g->mesh[m].attribute);
        free(g->mesh[m].material);
        free(g->mesh[m].indices);
        free(g->mesh[m].back_indices);
    }
    for (uint32_t o = 0; g->object_extras && o < scene->object_count; o++) json_decref(g->object_extras[o]);
    free(g->object_extras);
    free(g->object_mesh);
    free(g->image);
    free(g->texture);
    free(g->finish_texture);
    free(g->finish_image);
    free(g->mesh);
    lw_glb_finish(&g->glb);
    *g = (struct lw_glb_scene){0};
}

/* ---- textures ---- */

static uint32_t add_picture(struct lw_glb_scene *g, const uint8_t *pixel, uint32_t width, uint32_t height,
                            unsigned channels, const char *name) {
    uint8_t *png;
    size_t size;
    if (g->glb.error.status != LW_OK) return LW_GLB_NONE;
    if (lw_image_encode_png(pixel, width, height, channels, &png, &size, &g->glb.error) != LW_OK)
        return LW_GLB_NONE;
    const uint32_t view = lw_glb_view(&g->glb, png, size, LW_GLB_TARGET_NONE);
    free(png);
    return lw_glb_add(&g->glb, "images",
                      json_pack("{s:I, s:s, s:o}", "bufferView", (json_int_t)view, "mimeType", "image/png",
                                "name", lw_manifest_text(name)));
}

static bool is_opaque(const struct lw_texture *texture) {
    for (size_t i = 0; i < (size_t)texture->width * texture->height; i++)
        if (texture->rgba[i * 4 + 3] != 255) return false;
    return true;
}

static uint32_t add_texture_image(struct lw_glb_scene *g, const struct lw_texture *texture) {
    if (!is_opaque(texture))
        return add_picture(g, texture->rgba, texture->width, texture->height, 4, texture->name);
    const size_t count = (size_t)texture->width * texture->height;
    uint8_t *rgb = malloc(count * 3);
    if (!rgb) {
        out_of_memory(g);
        return LW_GLB_NONE;
    }
    for (size_t i = 0; i < count; i++) memcpy(rgb + i * 3, texture->rgba + i * 4, 3);
    const uint32_t image = add_picture(g, rgb, texture->width, texture->height, 3, texture->name);
    free(rgb);
    return image;
}

static int wrap_code(uint8_t wrap) {
    return wrap == LW_WRAP_CLAMP ? WRAP_CLAMP : wrap == LW_WRAP_MIRROR ? WRAP_MIRROR : WRAP_REPEAT;
}

/* A texture of a list; textures of the same picture share the image. texture, image: as in lw_glb_scene. */
static uint32_t get_texture_of(struct lw_glb_scene *g, const struct lw_texture *list, uint32_t count,
                               uint32_t index, uint32_t *texture, uint32_t *image) {
    const struct lw_texture *t = &list[index];
    if (texture[index] != LW_GLB_NONE) return texture[index];
    for (uint32_t i = 0; i < count && image[index] == LW_GLB_NONE; i++)
        if (list[i].rgba == t->rgba) image[index] = image[i];
    if (image[index] == LW_GLB_NONE) image[index] = add_texture_image(g, t);
    const uint32_t sampler =
        lw_glb_add(&g->glb, "samplers",
                   json_pack("{s:i, s:i, s:i, s:i}", "magFilter", FILTER_LINEAR, "minFilter", FILTER_MIPMAP,
                             "wrapS", wrap_code(t->wrap_s), "wrapT", wrap_code(t->wrap_t)));
    return texture[index] = lw_glb_add(
               &g->glb, "textures",
               json_pack("{s:I, s:I}", "source", (json_int_t)image[index], "sampler", (json_int_t)sampler));
}

static uint32_t get_texture(struct lw_glb_scene *g, uint32_t index) {
    const struct lw_scene *scene = g->desc.scene;
    return get_texture_of(g, scene->texture, scene->texture_count, index, g->texture, g->image);
}

static uint32_t get_finish_texture(struct lw_glb_scene *g, uint32_t index) {
    const struct lw_scene *scene = g->desc.scene;
    return get_texture_of(g, scene->finish_texture, scene->finish_texture_count, index, g->finish_texture,
                          g->finish_image);
}

static uint32_t add_lightmap_texture(struct lw_glb_scene *g, const struct lw_map *map, const char *file,
                                     const uint8_t *rgb) {
    const uint32_t image = add_picture(g, rgb, map->width, map->height, 3, file);
    if (g->lightmap_sampler == LW_GLB_NONE)
        g->lightmap_sampler =
            lw_glb_add(&g->glb, "samplers",
                       json_pack("{s:i, s:i, s:i, s:i}", "magFilter", FILTER_LINEAR, "minFilter",
                                 FILTER_LINEAR, "wrapS", WRAP_CLAMP, "wrapT", WRAP_CLAMP));
    return lw_glb_add(
        &g->glb, "textures",
        json_pack("{s:I, s:I}", "source", (json_int_t)image, "sampler", (json_int_t)g->lightmap_sampler));
}

/* ---- meshes ---- */

static bool is_of_uv_set_1(const struct lw_texture_use *use) {
    return use->texture != LW_SCENE_NONE && use->uv_set == 1;
}

static bool finish_uses_uv_set_1(const struct lw_finish *f) {
    return f && (is_of_uv_set_1(&f->surface_texture) || is_of_uv_set_1(&f->specular_texture) ||
                 is_of_uv_set_1(&f->occlusion_texture) || is_of_uv_set_1(&f->normal_texture));
}

static bool uses_uv_set_1(const struct lw_scene *scene, const struct lw_mesh *mesh) {
    for (uint32_t t = 0; mesh->uv[1] && t < mesh->triangle_count; t++) {
        const struct lw_material *m = &scene->material[mesh->material[t]];
        if (is_of_uv_set_1(&m->base_colour_texture) || is_of_uv_set_1(&m->emission_texture) ||
            finish_uses_uv_set_1(m->finish))
            return true;
    }
    return false;
}

static uint32_t add_vertices(struct lw_glb_scene *g, const void *values, uint32_t count, const char *type,
                             bool with_bounds) {
    return lw_glb_accessor(&g->glb, values, count, type, LW_GLB_FLOAT, LW_GLB_TARGET_VERTICES, with_bounds);
}

static uint32_t add_normals(struct lw_glb_scene *g, const struct lw_mesh *mesh, float side) {
    struct lw_vec3 *normal = malloc((size_t)mesh->vertex_count * sizeof *normal);
    if (!normal) {
        out_of_memory(g);
        return LW_GLB_NONE;
    }
    for (uint32_t i = 0; i < mesh->vertex_count; i++)
        normal[i] = lw_vec3_scale(lw_vec3_normalize(mesh->normal[i]), side);
    const uint32_t accessor = add_vertices(g, normal, mesh->vertex_count, "VEC3", false);
    free(normal);
    return accessor;
}

/* The back of split sides lies behind the front by this part of the mesh's largest side: renderers that do
 * not cull, such as Cycles, would find both at the same distance. */
#define BACK_BEHIND 1e-4f

struct corner {
    struct lw_vec3 position;
    uint32_t vertex;
};

static int compare_corners(const void *a, const void *b) {
    return memcmp(&((const struct corner *)a)->position, &((const struct corner *)b)->position,
                  sizeof(struct lw_vec3));
}

/* Per vertex, the mean direction of the normals at its position, or zero: vertices that lie on each other
 * move alike, so that faces which meet at an edge do not part there. */
static struct lw_vec3 *shared_normals(const struct lw_mesh *mesh) {
    const uint32_t n = mesh->vertex_count;
    struct corner *corner = malloc((size_t)n * sizeof *corner);
    struct lw_vec3 *normal = malloc((size_t)n * sizeof *normal);
    if (!corner || !normal) {
        free(corner);
        free(normal);
        return NULL;
    }
    for (uint32_t i = 0; i < n; i++) corner[i] = (struct corner){mesh->position[i], i};
    qsort(corner, n, sizeof *corner, compare_corners);
    for (uint32_t first = 0, end; first < n; first = end) {
        struct lw_vec3 sum = lw_vec3(0, 0, 0);
        for (end = first; end < n && compare_corners(&corner[first], &corner[end]) == 0; end++)
            sum = lw_vec3_add(sum, lw_vec3_normalize(mesh->normal[corner[end].vertex]));
        const float length = lw_vec3_length(sum);
        sum = length > 1e-3f ? lw_vec3_scale(sum, 1 / length) : lw_vec3(0, 0, 0);
        for (uint32_t i = first; i < end; i++) normal[corner[i].vertex] = sum;
    }
    free(corner);
    return normal;
}

static uint32_t add_back_positions(struct lw_glb_scene *g, const struct lw_mesh *mesh) {
    struct lw_vec3 low = mesh->position[0], high = low;
    for (uint32_t i = 1; i < mesh->vertex_count; i++) {
        low = lw_vec3_min(low, mesh->position[i]);
        high = lw_vec3_max(high, mesh->position[i]);
    }
    const float behind = BACK_BEHIND * lw_vec3_max_abs(lw_vec3_sub(high, low));
    struct lw_vec3 *position = shared_normals(mesh);
    if (!position) {
        out_of_memory(g);
        return LW_GLB_NONE;
    }
    for (uint32_t i = 0; i < mesh->vertex_count; i++)
        position[i] = lw_vec3_mad(mesh->position[i], position[i], -behind);
    const uint32_t accessor = add_vertices(g, position, mesh->vertex_count, "VEC3", true);
    free(position);
    return accessor;
}

/* Texel coordinates over the size of the atlas: v = 0 is the upper edge of row 0, as in glTF.
 * back: per vertex, whether it points at the back; NULL: none does. */
static uint32_t add_lightmap_uv(struct lw_glb_scene *g, const struct lw_mesh *mesh, const uint8_t *back,
                                uint32_t rows_down) {
    struct lw_vec2 *uv = malloc((size_t)mesh->vertex_count * sizeof *uv);
    if (!uv) {
        out_of_memory(g);
        return LW_GLB_NONE;
    }
    for (uint32_t i = 0; i < mesh->vertex_count; i++)
        uv[i] = (struct lw_vec2){mesh->lightmap_uv[i].x / (float)mesh->atlas_width,
                                 (mesh->lightmap_uv[i].y + (float)(!back || back[i] ? rows_down : 0)) /
                                     (float)mesh->atlas_height};
    const uint32_t accessor = add_vertices(g, uv, mesh->vertex_count, "VEC2", false);
    free(uv);
    return accessor;
}

static void add_attributes(struct lw_glb_scene *g, const struct lw_mesh *mesh, struct lw_glb_mesh *out) {
    const uint32_t n = mesh->vertex_count;
    uint32_t *a = out->attribute;
    a[POSITION] = add_vertices(g, mesh->position, n, "VEC3", true);
    a[NORMAL] = add_normals(g, mesh, 1);
    a[TEXCOORD_1] = add_lightmap_uv(g, mesh, NULL, 0);
    /* sets must begin with 0 and leave none out */
    a[TEXCOORD_0] = mesh->uv[0] ? add_vertices(g, mesh->uv[0], n, "VEC2", false) : a[TEXCOORD_1];
    if (uses_uv_set_1(g->desc.scene, mesh)) a[TEXCOORD_2] = add_vertices(g, mesh->uv[1], n, "VEC2", false);
    if (mesh->colour) a[COLOR_0] = add_vertices(g, mesh->colour, n, "VEC4", false);
    out->back_position = out->back_normal = out->back_uv = LW_GLB_NONE;
    if (!g->desc.split_sides || !mesh->back_offset) return;
    out->back_position = add_back_positions(g, mesh);
    out->back_normal = add_normals(g, mesh, -1);
    out->back_uv = add_lightmap_uv(g, mesh, NULL, mesh->back_offset);
}

/* Whether a material's triangles on this mesh are written once for each side. */
static bool splits(const struct lw_glb_scene *g, const struct lw_mesh *mesh,
                   const struct lw_material *material) {
    return g->desc.split_sides && mesh->back_offset && material->double_sided;
}

static uint32_t add_indices(struct lw_glb_scene *g, const struct lw_mesh *mesh, uint32_t material,
                            bool back) {
    uint32_t *index = malloc((size_t)mesh->triangle_count * 3 * sizeof *index), count = 0;
    if (!index) {
        out_of_memory(g);
        return LW_GLB_NONE;
    }
    for (uint32_t t = 0; t < mesh->triangle_count; t++)
        if (mesh->material[t] == material)
            for (int k = 0; k < 3; k++) index[count++] = mesh->triangle[t][back ? 2 - k : k];
    /* 65535 itself restarts primitives */
    const bool small = mesh->vertex_count <= UINT16_MAX;
    for (uint32_t i = 0; small && i < count; i++) ((uint16_t *)index)[i] = (uint16_t)index[i];
    const uint32_t accessor = lw_glb_accessor(
        &g->glb, index, count, "SCALAR", small ? LW_GLB_UINT16 : LW_GLB_UINT32, LW_GLB_TARGET_INDICES, false);
    free(index);
    return accessor;
}

/* A primitive for each material, in the order in which triangles first name them. */
static void add_primitives(struct lw_glb_scene *g, const struct lw_mesh *mesh, struct lw_glb_mesh *out) {
    uint8_t *seen = calloc((size_t)g->desc.scene->material_count + 1, 1);
    uint32_t materials = 0;
    for (uint32_t t = 0; seen && t < mesh->triangle_count; t++) {
        materials += !seen[mesh->material[t]];
        seen[mesh->material[t]] = 1;
    }
    out->material = malloc(((size_t)materials + 1) * sizeof *out->material);
    out->indices = malloc(((size_t)materials + 1) * sizeof *out->indices);
    out->back_indices = malloc(((size_t)materials + 1) * sizeof *out->back_indices);
    if (!seen || !out->material || !out->indices || !out->back_indices) {
        free(seen);
        out_of_memory(g);
        return;
    }
    for (uint32_t t = 0; t < mesh->triangle_count; t++) {
        const uint32_t material = mesh->material[t];
        if (!seen[material]) continue;
        seen[material] = 0;
        out->material[out->primitive_count] = material;
        out->indices[out->primitive_count] = add_indices(g, mesh, material, false);
        out->back_indices[out->primitive_count++] = splits(g, mesh, &g->desc.scene->material[material])
                                                        ? add_indices(g, mesh, material, true)
                                                        : LW_GLB_NONE;
    }
    free(seen);
}

static const struct lw_glb_mesh *get_mesh(struct lw_glb_scene *g, uint32_t index) {
    struct lw_glb_mesh *out = &g->mesh[index];
    const struct lw_mesh *mesh = &g->desc.scene->mesh[index];
    if (out->attribute) return out;
    out->attribute = filled(ATTRIBUTE_COUNT);
    if (!out->attribute) {
        out_of_memory(g);
        return out;
    }
    add_attributes(g, mesh, out);
    add_primitives(g, mesh, out);
    return out;
}

/* ---- materials ---- */

/* KHR_texture_transform out of a 2 x 3 matrix: scale, then a rotation, then an offset. */
static json_t *make_transform(const float m[6]) {
    const float length = hypotf(m[0], m[3]);
    const float angle = length > 0 ? atan2f(-m[3], m[0]) : atan2f(m[1], m[4]);
    const float scale_v = sinf(angle) * m[1] + cosf(angle) * m[4];
    return json_pack("{s:[f,f], s:f, s:[f,f]}", "offset", (double)m[2], (double)m[5], "rotation",
                     (double)angle, "scale", (double)length, (double)scale_v);
}

static bool is_identity(const float m[6]) {
    static const float identity[6] = {1, 0, 0, 0, 1, 0};
    return memcmp(m, identity, sizeof identity) == 0;
}

static json_t *make_info(struct lw_glb_scene *g, uint32_t texture, const struct lw_texture_use *use) {
    json_t *info =
        json_pack("{s:I, s:i}", "index", (json_int_t)texture, "texCoord", use->uv_set == 1 ? UV_MOVED : 0);
    if (!is_identity(use->transform)) {
        lw_glb_use_extension(&g->glb, "KHR_texture_transform");
        set(info, "extensions", json_pack("{s:o}", "KHR_texture_transform", make_transform(use->transform)));
    }
    return info;
}

static json_t *make_texture_info(struct lw_glb_scene *g, const struct lw_texture_use *use) {
    return make_info(g, get_texture(g, use->texture), use);
}

/* A texture on a mesh without its coordinates is read at (0, 0): a constant, which goes into the factor. */
static bool is_constant(const struct lw_mesh *mesh, const struct lw_texture_use *use) {
    return use->texture != LW_SCENE_NONE && !mesh->uv[use->uv_set];
}

static struct lw_vec4 constant_of(const struct lw_glb_scene *g, const struct lw_mesh *mesh,
                                  const struct lw_texture_use *use) {
    if (!is_constant(mesh, use)) return (struct lw_vec4){1, 1, 1, 1};
    return lw_scene_sample(g->desc.scene, use, (struct lw_vec2){0, 0});
}

static float unit(float v) { return fminf(1, fmaxf(0, v)); }

static void set_base_colour(struct lw_glb_scene *g, json_t *out, const struct lw_material *material,
                            const struct lw_mesh *mesh) {
    const struct lw_texture_use *use = &material->base_colour_texture;
    const struct lw_vec4 k = constant_of(g, mesh, use);
    const float *c = material->base_colour;
    const float factor[4] = {unit(c[0] * k.x), unit(c[1] * k.y), unit(c[2] * k.z), unit(c[3] * k.w)};
    json_t *pbr = json_pack("{s:o, s:f, s:f}", "baseColorFactor", lw_glb_numbers(factor, 4), "metallicFactor",
                            0.0, "roughnessFactor", 1.0);
    if (use->texture != LW_SCENE_NONE && !is_constant(mesh, use))
        set(pbr, "baseColorTexture", make_texture_info(g, use));
    set(out, "pbrMetallicRoughness", pbr);
}

/* The texture of a finish, as a member of an object. NULL: there is none, or it is a constant. */
static json_t *add_finish_texture(struct lw_glb_scene *g, json_t *to, const char *name,
                                  const struct lw_mesh *mesh, const struct lw_texture_use *use) {
    if (use->texture == LW_SCENE_NONE || is_constant(mesh, use)) return NULL;
    json_t *info = make_info(g, get_finish_texture(g, use->texture), use);
    set(to, name, info);
    return info;
}

static struct lw_vec4 finish_constant(const struct lw_glb_scene *g, const struct lw_mesh *mesh,
                                      const struct lw_texture_use *use) {
    if (!is_constant(mesh, use)) return (struct lw_vec4){1, 1, 1, 1};
    return lw_scene_sample_finish(g->desc.scene, use, (struct lw_vec2){0, 0});
}

/* Reflectance of a dielectric. glTF's default values are left out. */
static void set_specular(struct lw_glb_scene *g, json_t *extensions, const struct lw_finish *f,
                         const struct lw_mesh *mesh) {
    const struct lw_vec4 k = finish_constant(g, mesh, &f->specular_texture);
    const float colour[3] = {f->specular_colour[0] * k.x, f->specular_colour[1] * k.y,
                             f->specular_colour[2] * k.z};
    const float specular = f->specular * k.w;
    if (f->ior != 1.5f) {
        lw_glb_use_extension(&g->glb, "KHR_materials_ior");
        set(extensions, "KHR_materials_ior", json_pack("{s:f}", "ior", (double)f->ior));
    }
    if (specular == 1 && colour[0] == 1 && colour[1] == 1 && colour[2] == 1 &&
        f->specular_texture.texture == LW_SCENE_NONE)
        return;
    lw_glb_use_extension(&g->glb, "KHR_materials_specular");
    json_t *out = json_pack("{s:f, s:o}", "specularFactor", (double)specular, "specularColorFactor",
                            lw_glb_numbers(colour, 3));
    add_finish_texture(g, out, "specularTexture", mesh, &f->specular_texture);
    add_finish_texture(g, out, "specularColorTexture", mesh, &f->specular_texture);
    set(extensions, "KHR_materials_specular", out);
}

/* Over what set_base_colour() wrote. Occlusion and relief of a constant texture are left out: no surface has
 * its coordinates. */
static void set_finish(struct lw_glb_scene *g, json_t *out, json_t *extensions, const struct lw_finish *f,
                       const struct lw_mesh *mesh) {
    json_t *pbr = json_object_get(out, "pbrMetallicRoughness");
    const struct lw_vec4 k = finish_constant(g, mesh, &f->surface_texture);
    set(pbr, "metallicFactor", json_real((double)unit(f->metalness * k.z)));
    set(pbr, "roughnessFactor", json_real((double)unit(f->roughness * k.y)));
    add_finish_texture(g, pbr, "metallicRoughnessTexture", mesh, &f->surface_texture);
    json_t *info = add_finish_texture(g, out, "normalTexture", mesh, &f->normal_texture);
    if (info && f->normal_scale != 1) set(info, "scale", json_real((double)f->normal_scale));
    info = add_finish_texture(g, out, "occlusionTexture", mesh, &f->occlusion_texture);
    if (info && f->occlusion != 1) set(info, "strength", json_real((double)f->occlusion));
    set_specular(g, extensions, f, mesh);
}

static void set_emission(struct lw_glb_scene *g, json_t *out, json_t *extensions,
                         const struct lw_material *material, const struct lw_mesh *mesh) {
    const struct lw_texture_use *use = &material->emission_texture;
    const struct lw_vec4 k = constant_of(g, mesh, use);
    const float *e = material->emission;
    const float emission[3] = {e[0] * k.x, e[1] * k.y, e[2] * k.z};
    const float largest = fmaxf(emission[0], fmaxf(emission[1], emission[2]));
    if (!(largest > 0)) return;
    const float strength = largest > 1 ? largest : 1; /* factors end at 1 */
    const float factor[3] = {unit(emission[0] / strength), unit(emission[1] / strength),
                             unit(emission[2] / strength)};
    set(out, "emissiveFactor", lw_glb_numbers(factor, 3));
    if (use->texture != LW_SCENE_NONE && !is_constant(mesh, use))
        set(out, "emissiveTexture", make_texture_info(g, use));
    if (!(strength > 1)) return;
    lw_glb_use_extension(&g->glb, "KHR_materials_emissive_strength");
    set(extensions, "KHR_materials_emissive_strength",
        json_pack("{s:f}", "emissiveStrength", (double)strength));
}

static void set_alpha(json_t *out, const struct lw_material *material, bool double_sided) {
    if (material->alpha_mode == LW_ALPHA_MASK) {
        set(out, "alphaMode", json_string("MASK"));
        set(out, "alphaCutoff", json_real((double)material->alpha_cutoff));
    } else if (material->alpha_mode == LW_ALPHA_BLEND)
        set(out, "alphaMode", json_string("BLEND"));
    if (double_sided) set(out, "doubleSided", json_true());
}

static json_t *use_lightmap(struct lw_glb_scene *g, uint32_t lightmap, float scale) {
    lw_glb_use_extension(&g->glb, "MOZ_lightmap");
    return json_pack("{s:{s:I, s:i, s:f}}", "MOZ_lightmap", "index", (json_int_t)lightmap, "texCoord",
                     UV_LIGHTMAP, "intensity", (double)scale);
}

static uint32_t add_material(struct lw_glb_scene *g, const struct lw_material *material,
                             const struct lw_mesh *mesh, uint32_t lightmap, float scale, json_t *extras) {
    json_t *extensions = material->unlit ? json_object() : use_lightmap(g, lightmap, scale);
    json_t *out = json_pack("{s:o}", "name", lw_manifest_text(material->name));
    if (material->unlit) {
        lw_glb_use_extension(&g->glb, "KHR_materials_unlit");
        set(extensions, "KHR_materials_unlit", json_object());
    }
    set_base_colour(g, out, material, mesh);
    if (material->finish && !material->unlit) set_finish(g, out, extensions, material->finish, mesh);
    set_emission(g, out, extensions, material, mesh);
    set_alpha(out, material, material->double_sided && !splits(g, mesh, material));
    set(out, "extensions", extensions);
    if (!material->unlit) set(out, "extras", json_pack("{s:O}", "lightwell", extras)); /* it takes no map */
    return lw_glb_add(&g->glb, "materials", out);
}

/* ---- objects ---- */

/* Returns false without memory. */
static bool add_directions(const struct lw_glb_scene *g, json_t *extras, const char *file) {
    char *path = NULL;
    if (!g->desc.direction_form) return true;
    if (asprintf(&path, "%s%s/%s", g->desc.map_folder, g->desc.direction_folder, file) < 0) return false;
    const bool ok = json_object_set_new(extras, "directions", lw_manifest_text(path)) == 0 &&
                    json_object_set_new(extras, "directionForm", json_string(g->desc.direction_form)) == 0;
    free(path);
    return ok;
}

/* Fields with which an engine's script loads the EXR in place of the picture. */
static json_t *make_extras(const struct lw_glb_scene *g, const struct lw_map *map, const char *file,
                           const char *side) {
    char *path = NULL;
    if (asprintf(&path, "%s%s", g->desc.map_folder, file) < 0) return NULL;
    json_t *extras = json_pack(
        "{s:o, s:s, s:s, s:s, s:i, s:I, s:I, s:I, s:s}", "lightmap", lw_manifest_text(path), "convention",
        g->desc.convention->name, "quantity", g->desc.convention->quantity, "units",
        g->desc.convention->units, "texCoord", UV_LIGHTMAP, "width", (json_int_t)map->width, "height",
        (json_int_t)map->height, "back_offset", (json_int_t)map->back_offset, "side", side);
    free(path);
    if (extras && !add_directions(g, extras, file)) {
        json_decref(extras);
        return NULL;
    }
    return extras;
}

/* lightmap_uv: the accessor of the object's own coordinates, or LW_GLB_NONE: those of its mesh */
static json_t *make_primitive(const struct lw_glb_mesh *mesh, uint32_t primitive, uint32_t material,
                              bool back, uint32_t lightmap_uv) {
    json_t *attributes = json_object();
    for (int i = 0; i < ATTRIBUTE_COUNT; i++) {
        uint32_t accessor = mesh->attribute[i];
        if (lightmap_uv != LW_GLB_NONE && accessor == mesh->attribute[TEXCOORD_1]) accessor = lightmap_uv;
        if (back && i == POSITION) accessor = mesh->back_position;
        if (back && i == NORMAL) accessor = mesh->back_normal;
        if (back && i == TEXCOORD_1) accessor = mesh->back_uv;
        if (accessor != LW_GLB_NONE) set(attributes, attribute_name[i], json_integer(accessor));
    }
    return json_pack("{s:o, s:I, s:I}", "attributes", attributes, "indices",
                     (json_int_t)(back ? mesh->back_indices : mesh->indices)[primitive], "material",
                     (json_int_t)material);
}

void lw_glb_scene_add(struct lw_glb_scene *g, const struct lw_map *map, const struct lw_sides_shown *shown,
                      const char *file, const uint8_t *irradiance_rgb, float scale) {
    const struct lw_scene *scene = g->desc.scene;
    const struct lw_object *object = &scene->object[map->object];
    const struct lw_mesh *mesh = &scene->mesh[object->mesh];
    const struct lw_glb_mesh *written = get_mesh(g, object->mesh);
    const uint32_t lightmap = add_lightmap_texture(g, map, file, irradiance_rgb);
    const bool own_uv = shown->back && !g->desc.split_sides;
    const uint32_t uv = own_uv ? add_lightmap_uv(g, mesh, shown->back, mesh->back_offset) : LW_GLB_NONE;
    json_t *extras = g->object_extras[map->object] =
        make_extras(g, map, file, g->desc.split_sides ? "each" : lw_sides_name(shown));
    json_t *primitives = json_array();
    if (!extras) out_of_memory(g);
    for (uint32_t p = 0; p < written->primitive_count && g->glb.error.status == LW_OK; p++) {
        const uint32_t material =
            add_material(g, &scene->material[written->material[p]], mesh, lightmap, scale, extras);
        json_array_append_new(primitives, make_primitive(written, p, material, false, uv));
        if (written->back_indices[p] != LW_GLB_NONE)
            json_array_append_new(primitives, make_primitive(written, p, material, true, uv));
    }
    g->object_mesh[map->object] =
        lw_glb_add(&g->glb, "meshes",
                   json_pack("{s:o, s:o}", "name", lw_manifest_text(mesh->name), "primitives", primitives));
}

/* ---- nodes and what hangs on them ---- */

static json_t *make_node(const struct lw_node *node) {
    json_t *out = json_pack("{s:o}", "name", lw_manifest_text(node->name));
    if (node->has_matrix) {
        float m[16] = {0}; /* column-major */
        for (int row = 0; row < 3; row++)
            for (int column = 0; column < 4; column++) m[column * 4 + row] = node->matrix.m[row][column];
        m[15] = 1;
        set(out, "matrix", lw_glb_numbers(m, 16));
        return out;
    }
    set(out, "translation", lw_glb_numbers(node->translation, 3));
    set(out, "rotation", lw_glb_numbers(node->rotation, 4));
    set(out, "scale", lw_glb_numbers(node->scale, 3));
    return out;
}

static json_t *child_list(json_t *node) {
    json_t *children = json_object_get(node, "children");
    if (children) return children;
    children = json_array();
    set(node, "children", children);
    return children;
}

/* Where a node can hold one thing of a kind only, a second one gets a node below it. */
static json_t *place_for(struct lw_glb_scene *g, json_t *nodes, uint32_t index, bool is_free,
                         const char *name) {
    json_t *node = json_array_get(nodes, index);
    if (is_free || !node) return node;
    json_t *child = json_pack("{s:o}", "name", lw_manifest_text(name));
    const uint32_t at = lw_glb_add(&g->glb, "nodes", child);
    if (at == LW_GLB_NONE) return NULL;
    json_array_append_new(child_list(node), json_integer(at));
    return json_array_get(nodes, at);
}

static void hang_objects(struct lw_glb_scene *g, json_t *nodes) {
    const struct lw_scene *scene = g->desc.scene;
    for (uint32_t o = 0; o < scene->object_count; o++) {
        if (g->object_mesh[o] == LW_GLB_NONE) continue;
        json_t *own = json_array_get(nodes, scene->object[o].node);
        json_t *node =
            place_for(g, nodes, scene->object[o].node, !json_object_get(own, "mesh"), scene->object[o].name);
        set(node, "mesh", json_integer(g->object_mesh[o]));
        set(node, "extras", json_pack("{s:O}", "lightwell", g->object_extras[o]));
    }
}

/* An orthographic one needs a width and an end: a square, and further than any scene. */
static json_t *make_camera(const struct lw_camera *camera) {
    const double half = 0.5 * (double)camera->height_m;
    json_t *name = lw_manifest_text(camera->name);
    if (half > 0)
        return json_pack("{s:s, s:o, s:{s:f, s:f, s:f, s:f}}", "type", "orthographic", "name", name,
                         "orthographic", "xmag", half, "ymag", half, "znear", 0.0, "zfar", 1e5);
    return json_pack("{s:s, s:o, s:{s:f, s:f}}", "type", "perspective", "name", name, "perspective", "yfov",
                     (double)camera->fov_y, "znear", 0.01);
}

static void hang_cameras(struct lw_glb_scene *g, json_t *nodes) {
    const struct lw_scene *scene = g->desc.scene;
    for (uint32_t c = 0; c < scene->camera_count; c++) {
        const struct lw_camera *camera = &scene->camera[c];
        json_t *node =
            place_for(g, nodes, camera->node, !json_object_get(json_array_get(nodes, camera->node), "camera"),
                      camera->name);
        set(node, "camera", json_integer(lw_glb_add(&g->glb, "cameras", make_camera(camera))));
    }
}

static json_t *make_light(const struct lw_light *light) {
    static const char *const type[] = {
        [LW_LIGHT_POINT] = "point", [LW_LIGHT_SPOT] = "spot", [LW_LIGHT_DIRECTIONAL] = "directional"};
    const float *i = light->intensity;
    const float largest = fmaxf(i[0], fmaxf(i[1], i[2])), safe = largest > 0 ? largest : 1;
    const float colour[3] = {i[0] / safe, i[1] / safe, i[2] / safe};
    json_t *out =
        json_pack("{s:s, s:o, s:o, s:f}", "type", type[light->kind], "name", lw_manifest_text(light->name),
                  "color", lw_glb_numbers(colour, 3), "intensity", (double)largest);
    if (light->kind == LW_LIGHT_SPOT)
        set(out, "spot",
            json_pack("{s:f, s:f}", "innerConeAngle", (double)light->inner_cone, "outerConeAngle",
                      (double)light->outer_cone));
    return out;
}

static bool holds_light(const json_t *node) {
    return json_object_get(json_object_get(node, "extensions"), "KHR_lights_punctual") != NULL;
}

static bool keeps_light(const struct lw_glb_scene *g, uint32_t light) {
    return g->desc.with_lights || (g->desc.drawn && g->desc.drawn[light]);
}

static uint32_t count_kept_lights(const struct lw_glb_scene *g) {
    uint32_t count = 0;
    for (uint32_t l = 0; l < g->desc.scene->light_count; l++) count += keeps_light(g, l);
    return count;
}

static void hang_lights(struct lw_glb_scene *g, json_t *nodes) {
    const struct lw_scene *scene = g->desc.scene;
    if (!count_kept_lights(g)) return;
    json_t *lights = json_array();
    for (uint32_t l = 0; l < scene->light_count; l++) {
        const struct lw_light *light = &scene->light[l];
        if (!keeps_light(g, l)) continue;
        json_t *node =
            place_for(g, nodes, light->node, !holds_light(json_array_get(nodes, light->node)), light->name);
        set(node, "extensions",
            json_pack("{s:{s:I}}", "KHR_lights_punctual", "light", (json_int_t)json_array_size(lights)));
        json_array_append_new(lights, make_light(light));
    }
    lw_glb_use_extension(&g->glb, "KHR_lights_punctual");
    set(g->glb.root, "extensions", json_pack("{s:{s:o}}", "KHR_lights_punctual", "lights", lights));
}

static void add_nodes(struct lw_glb_scene *g) {
    const struct lw_scene *scene = g->desc.scene;
    json_t *roots = json_array();
    for (uint32_t n = 0; n < scene->node_count; n++) lw_glb_add(&g->glb, "nodes", make_node(&scene->node[n]));
    json_t *nodes = json_object_get(g->glb.root, "nodes");
    for (uint32_t n = 0; n < scene->node_count && g->glb.error.status == LW_OK; n++) {
        const uint32_t parent = scene->node[n].parent;
        json_array_append_new(parent == LW_SCENE_NONE ? roots : child_list(json_array_get(nodes, parent)),
                              json_integer(n));
    }
    hang_objects(g, nodes);
    hang_cameras(g, nodes);
    hang_lights(g, nodes);
    lw_glb_add(&g->glb, "scenes",
               json_pack("{s:o, s:o}", "name", lw_manifest_text(scene->name), "nodes", roots));
    set(g->glb.root, "scene", json_integer(0));
}

/* ---- animation ---- */

static void add_animation(struct lw_glb_scene *g) {
    static const char *const path[] = {"translation", "rotation", "scale"}, *const interpolation[] = {
                                                                                "STEP", "LINEAR",
                                                                                "CUBICSPLINE"};
    const struct lw_scene *scene = g->desc.scene;
    if (!scene->channel_count) return;
    json_t *samplers = json_array(), *channels = json_array();
    for (uint32_t c = 0; c < scene->channel_count; c++) {
        const struct lw_channel *channel = &scene->channel[c];
        const uint32_t values =
            channel->key_count * (channel->interpolation == LW_INTERPOLATION_CUBIC ? 3 : 1);
        const uint32_t input = lw_glb_accessor(&g->glb, channel->time_s, channel->key_count, "SCALAR",
                                               LW_GLB_FLOAT, LW_GLB_TARGET_NONE, true);
        const uint32_t output = lw_glb_accessor(&g->glb, channel->value, values,
                                                channel->path == LW_CHANNEL_ROTATION ? "VEC4" : "VEC3",
                                                LW_GLB_FLOAT, LW_GLB_TARGET_NONE, false);
        json_array_append_new(samplers, json_pack("{s:I, s:I, s:s}", "input", (json_int_t)input, "output",
                                                  (json_int_t)output, "interpolation",
                                                  interpolation[channel->interpolation]));
        json_array_append_new(channels,
                              json_pack("{s:I, s:{s:I, s:s}}", "sampler", (json_int_t)c, "target", "node",
                                        (json_int_t)channel->node, "path", path[channel->path]));
    }
    lw_glb_add(&g->glb, "animations", json_pack("{s:o, s:o}", "samplers", samplers, "channels", channels));
}

enum lw_status lw_glb_scene_write(struct lw_glb_scene *g, const char *path, struct lw_error *err) {
    const struct lw_scene *scene = g->desc.scene;
    add_nodes(g);
    add_animation(g);
    set(json_object_get(g->glb.root, "asset"), "extras",
        json_pack(
            "{s:{s:s, s:s, s:s, s:b, s:b, s:[f,f,f]}}", "lightwell", "convention", g->desc.convention->name,
            "quantity", g->desc.convention->quantity, "units", g->desc.convention->units, "lamps_left_out",
            (int)(count_kept_lights(g) < scene->light_count), "indirect_only", (int)(g->desc.drawn != NULL),
            "sky", (double)scene->sky[0], (double)scene->sky[1], (double)scene->sky[2]));
    return lw_glb_write(&g->glb, path, err);
}
