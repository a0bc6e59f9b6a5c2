#include "server/import/foreign/foreign_look.h"

#include "common/base/colour.h"

#include <assimp/material.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define ASSIMP_DEFAULT_NAME "DefaultMaterial"

/* ---- maps ---- */

static uint8_t wrap_of(enum aiTextureMapMode mode) {
    return mode == aiTextureMapMode_Mirror ? LW_WRAP_MIRROR
           : mode == aiTextureMapMode_Wrap ? LW_WRAP_REPEAT
                                           : LW_WRAP_CLAMP;
}

/* Coordinates are scaled, turned about (0.5, 0.5) and moved, with v up. Ours have v down: v' = 1 - v on both
 * sides of the transform. */
static void convert_transform(const struct aiUVTransform *from, float out[6]) {
    float c = cosf(from->mRotation), s = sinf(from->mRotation);
    float a[6] = {
        c * from->mScaling.x, -s * from->mScaling.y, 0.5f - 0.5f * c + 0.5f * s + from->mTranslation.x,
        s * from->mScaling.x, c * from->mScaling.y,  0.5f - 0.5f * s - 0.5f * c + from->mTranslation.y};
    const float flipped[6] = {a[0], -a[1], a[1] + a[2], -a[3], a[4], 1 - a[4] - a[5]};
    memcpy(out, flipped, sizeof flipped);
}

static enum lw_status read_map(const struct aiMaterial *ai, enum aiTextureType type,
                               struct lw_foreign_map *out, struct lw_error *err) {
    enum aiTextureMapMode mode[3] = {aiTextureMapMode_Wrap, aiTextureMapMode_Wrap, aiTextureMapMode_Wrap};
    struct aiUVTransform transform = {.mScaling = {1, 1}};
    *out = (struct lw_foreign_map){.folder = "", .gain = 1};
    if (aiGetMaterialTexture(ai, type, 0, &out->path, NULL, &out->uv_set, NULL, NULL, mode, NULL) !=
            aiReturn_SUCCESS ||
        out->path.length == 0)
        return LW_OK;
    (void)aiGetMaterialUVTransform(ai, AI_MATKEY_UVTRANSFORM(type, 0), &transform);
    out->there = true;
    out->wrap_s = wrap_of(mode[0]);
    out->wrap_t = wrap_of(mode[1]);
    convert_transform(&transform, out->transform);
    for (int i = 0; i < 6; i++)
        if (!isfinite(out->transform[i]))
            return lw_status_fail(err, LW_BAD_DATA, "the transform of texture \"%s\" is not finite",
                                  out->path.data);
    return LW_OK;
}

/* The first of two kinds that is there. */
static enum lw_status read_either(const struct aiMaterial *ai, enum aiTextureType first,
                                  enum aiTextureType second, struct lw_foreign_map *out,
                                  struct lw_error *err) {
    if (read_map(ai, first, out, err) || out->there) return err->status;
    return read_map(ai, second, out, err);
}

/* ---- Assimp ---- */

static bool read_colour(const struct aiMaterial *ai, const char *key, unsigned type, unsigned index,
                        struct lw_foreign_look *out, enum lw_foreign_colour which) {
    struct aiColor4D colour = {0};
    if (aiGetMaterialColor(ai, key, type, index, &colour) != aiReturn_SUCCESS) return false;
    memcpy(out->colour[which], (const float[]){colour.r, colour.g, colour.b}, sizeof out->colour[which]);
    return out->has_colour[which] = true;
}

/* Assimp paints surfaces without a material white in PLY and STL, and in a grey of its own in FBX: there
 * their material has a name and that colour alone. */
static bool is_bare(const struct lw_foreign_import *import, const struct aiMaterial *ai, const char *name) {
    switch (import->desc->format) {
    case LW_SCENE_FORMAT_PLY:
    case LW_SCENE_FORMAT_STL:
        return !import->files->has_material;
    case LW_SCENE_FORMAT_FBX:
        return strcmp(name, ASSIMP_DEFAULT_NAME) == 0 && ai->mNumProperties == 2;
    default:
        return false;
    }
}

/* The one colour of an STL is what a screen shows, like those of vertices. */
static void read_screen_colour(float c[3]) {
    for (int i = 0; i < 3; i++) c[i] = lw_colour_from_srgb(fminf(fmaxf(c[i], 0), 1));
}

static bool read_number(const struct aiMaterial *ai, const char *key, unsigned type, unsigned index,
                        float *out) {
    return aiGetMaterialFloatArray(ai, key, type, index, out, NULL) == aiReturn_SUCCESS;
}

/* From the exponent of an FBX Assimp makes a roughness, 1 - sqrt(exponent) / 10. Exporters write an exponent
 * on everything, so that it is no gloss. */
static bool is_of_exponent(const struct lw_foreign_look *look) {
    return look->exponent >= 0 && fabsf(look->roughness - (1 - sqrtf(look->exponent) / 10)) < 1e-5f;
}

static enum lw_status read_gloss(const struct aiMaterial *ai, struct lw_foreign_look *out,
                                 struct lw_error *err) {
    (void)read_number(ai, AI_MATKEY_SHININESS, &out->exponent);
    out->has_metalness = read_number(ai, AI_MATKEY_METALLIC_FACTOR, &out->metalness);
    out->has_roughness = read_number(ai, AI_MATKEY_ROUGHNESS_FACTOR, &out->roughness) && !is_of_exponent(out);
    (void)read_number(ai, AI_MATKEY_BUMPSCALING, &out->relief);
    if (out->relief == 0) out->relief = 1; /* a factor left at 0 is no wish to hide the map */
    if (read_map(ai, aiTextureType_METALNESS, &out->metalness_map, err) ||
        read_map(ai, aiTextureType_DIFFUSE_ROUGHNESS, &out->roughness_map, err) ||
        read_either(ai, aiTextureType_NORMALS, aiTextureType_NORMAL_CAMERA, &out->relief_map, err))
        return err->status;
    return out->relief_map.there ? LW_OK : read_map(ai, aiTextureType_HEIGHT, &out->relief_map, err);
}

static enum lw_status read_assimp(const struct lw_foreign_import *import, const struct aiMaterial *ai,
                                  struct lw_foreign_look *out, struct lw_error *err) {
    int two_sided = 0;
    (void)aiGetMaterialString(ai, AI_MATKEY_NAME, &out->name);
    (void)aiGetMaterialIntegerArray(ai, AI_MATKEY_TWOSIDED, &two_sided, NULL);
    out->stated_two_sided = two_sided != 0;
    const bool bare = is_bare(import, ai, out->name.data);
    out->is_default = bare || strcmp(out->name.data, ASSIMP_DEFAULT_NAME) == 0;
    if (!read_colour(ai, AI_MATKEY_COLOR_DIFFUSE, out, LW_FOREIGN_DIFFUSE))
        (void)read_colour(ai, AI_MATKEY_BASE_COLOR, out, LW_FOREIGN_DIFFUSE);
    (void)read_colour(ai, AI_MATKEY_COLOR_SPECULAR, out, LW_FOREIGN_SPECULAR);
    (void)read_colour(ai, AI_MATKEY_COLOR_EMISSIVE, out, LW_FOREIGN_EMISSION);
    (void)aiGetMaterialFloatArray(ai, AI_MATKEY_OPACITY, &out->opacity, NULL);
    if (bare) memset(out->has_colour, 0, sizeof out->has_colour);
    if (import->desc->format == LW_SCENE_FORMAT_STL) read_screen_colour(out->colour[LW_FOREIGN_DIFFUSE]);
    if (read_either(ai, aiTextureType_DIFFUSE, aiTextureType_BASE_COLOR, &out->colour_map, err) ||
        read_map(ai, aiTextureType_OPACITY, &out->opacity_map, err) ||
        read_either(ai, aiTextureType_EMISSIVE, aiTextureType_EMISSION_COLOR, &out->emission_map, err))
        return err->status;
    return bare ? LW_OK : read_gloss(ai, out, err);
}

/* ---- OBJ ---- */

static void take_map(const struct lw_mtl_map *from, const char *folder, struct lw_foreign_map *out) {
    const uint8_t wrap = from->clamp ? LW_WRAP_CLAMP : LW_WRAP_REPEAT;
    const struct aiUVTransform transform = {.mScaling = {from->scale[0], from->scale[1]},
                                            .mTranslation = {from->offset[0], from->offset[1]}};
    *out = (struct lw_foreign_map){.folder = folder, .gain = 1};
    if (!from->path) return;
    out->there = true;
    out->wrap_s = out->wrap_t = wrap;
    out->base = from->base;
    out->gain = from->gain;
    out->channel = from->channel;
    snprintf(out->path.data, sizeof out->path.data, "%s", from->path);
    out->path.length = (ai_uint32)strlen(out->path.data);
    convert_transform(&transform, out->transform);
}

static void take_mtl(const struct lw_mtl_material *from, const char *folder, struct lw_foreign_look *out) {
    static const enum lw_mtl_colour colours[LW_FOREIGN_COLOURS] = {[LW_FOREIGN_DIFFUSE] = LW_MTL_DIFFUSE,
                                                                   [LW_FOREIGN_SPECULAR] = LW_MTL_SPECULAR,
                                                                   [LW_FOREIGN_EMISSION] = LW_MTL_EMISSION};
    for (int c = 0; c < LW_FOREIGN_COLOURS; c++) {
        out->has_colour[c] = from->has_colour[colours[c]];
        memcpy(out->colour[c], from->colour[colours[c]], sizeof out->colour[c]);
    }
    out->opacity = from->opacity;
    take_map(&from->map[LW_MTL_MAP_DIFFUSE], folder, &out->colour_map);
    take_map(&from->map[LW_MTL_MAP_EMISSION], folder, &out->emission_map);
    take_map(&from->map[LW_MTL_MAP_OPACITY], folder, &out->opacity_map);
    take_map(&from->map[LW_MTL_MAP_ROUGHNESS], folder, &out->roughness_map);
    take_map(&from->map[LW_MTL_MAP_METALNESS], folder, &out->metalness_map);
    out->is_normal = from->map[LW_MTL_MAP_NORMAL].path != NULL;
    const struct lw_mtl_map *relief = &from->map[out->is_normal ? LW_MTL_MAP_NORMAL : LW_MTL_MAP_BUMP];
    take_map(relief, folder, &out->relief_map);
    if (relief->path) out->relief = relief->bump * relief->gain;
    /* exporters that know nothing of gloss write zeros for all */
    const bool said = from->number[LW_MTL_ROUGHNESS] != 0 || from->number[LW_MTL_METALNESS] != 0;
    out->has_roughness = said && from->has_number[LW_MTL_ROUGHNESS];
    out->roughness = from->number[LW_MTL_ROUGHNESS];
    out->has_metalness = said && from->has_number[LW_MTL_METALNESS];
    out->metalness = from->number[LW_MTL_METALNESS];
    if (from->has_number[LW_MTL_EXPONENT]) out->exponent = from->number[LW_MTL_EXPONENT];
}

/* Assimp knows the materials of an OBJ by their number in our text (obj_text.h). */
static void read_obj(const struct lw_foreign_import *import, const struct aiMaterial *ai,
                     struct lw_foreign_look *out) {
    const struct lw_foreign_files *files = import->files;
    (void)aiGetMaterialString(ai, AI_MATKEY_NAME, &out->name);
    char *end;
    const unsigned long number = strtoul(out->name.data, &end, 10);
    out->is_default = end == out->name.data || *end || number >= files->materials.use_count;
    if (out->is_default) return;
    const struct lw_obj_materials_use *use = &files->materials.use[number];
    snprintf(out->name.data, sizeof out->name.data, "%s", files->obj.material.name[number]);
    out->name.length = (ai_uint32)strlen(out->name.data);
    if (use->material)
        take_mtl(use->material, use->folder, out);
    else
        out->is_default = true;
}

enum lw_status lw_foreign_look_read(const struct lw_foreign_import *import, unsigned index,
                                    struct lw_foreign_look *out, struct lw_error *err) {
    const struct aiMaterial *ai = import->ai->mMaterials[index];
    const struct lw_foreign_map no_map = {.folder = "", .gain = 1};
    *out = (struct lw_foreign_look){.opacity = 1,
                                    .exponent = -1,
                                    .relief = 1,
                                    .colour_map = no_map,
                                    .emission_map = no_map,
                                    .opacity_map = no_map,
                                    .metalness_map = no_map,
                                    .roughness_map = no_map,
                                    .relief_map = no_map};
    if (import->desc->format != LW_SCENE_FORMAT_OBJ) return read_assimp(import, ai, out, err);
    read_obj(import, ai, out);
    return LW_OK;
}
