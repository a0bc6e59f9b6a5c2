/* Rules for what diffuse light cannot show, and why: docs/importing.md, "Materials". */
#include "server/import/foreign_material.h"

#include "common/file_read.h"
#include "common/log.h"
#include "server/import/beside.h"
#include "server/import/image_file.h"
#include "server/import/mesh_builder.h"
#include "server/import/mirror.h"

#include <assimp/material.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* What Assimp puts where a file names no diffuse colour. */
#define ASSIMP_GREY         0.6f
#define ASSIMP_DEFAULT_NAME "DefaultMaterial"

/* An opacity map with less than this share of texels between nearly 0 and nearly 1 cuts out; else it
 * blends. */
#define BLEND_SHARE   0.25
#define NEARLY_OPAQUE 229 /* of 255 */
#define NEARLY_CLEAR  26

#define WARNINGS_MAX 20 /* lines about single pictures */

enum { VARIANTS = 4 }; /* one- or two-sided, own colour or white */

struct lw_foreign_picture {
    char *key; /* path as the file has it; of a colour and an opacity map, both */
    const uint8_t *rgba;
    uint32_t width, height;
    bool unreadable, has_alpha;
};

struct lw_foreign_converted {
    bool done, stated_two_sided, emits, is_default;
    struct lw_material material;
    uint32_t variant[VARIANTS]; /* in the scene; LW_SCENE_NONE: not there yet */
};

static const struct lw_texture_use no_texture = {.texture = LW_SCENE_NONE, .transform = {1, 0, 0, 0, 1, 0}};

enum lw_status lw_foreign_materials_init(struct lw_foreign_materials *materials,
                                         struct lw_foreign_import *import, struct lw_error *err) {
    size_t count = import->ai->mNumMaterials;
    struct lw_scene *scene = import->scene;
    *materials =
        (struct lw_foreign_materials){.import = import, .pictures.limit = import->desc->picture_texels};
    if (count > LW_SCENE_MATERIALS_MAX / VARIANTS || 2 * count > LW_SCENE_TEXTURES_MAX)
        return lw_status_fail(err, LW_BAD_DATA, "has %zu materials; the limit is %u", count,
                              LW_SCENE_TEXTURES_MAX / 2);
    materials->converted = calloc(count + 1, sizeof *materials->converted);
    scene->material = lw_scene_alloc(scene, VARIANTS * count + 1, sizeof *scene->material);
    scene->texture = lw_scene_alloc(scene, 2 * count + 1, sizeof *scene->texture);
    if (!materials->converted || !scene->material || !scene->texture)
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory for materials");
    for (size_t i = 0; i < count; i++)
        for (int v = 0; v < VARIANTS; v++) materials->converted[i].variant[v] = LW_SCENE_NONE;
    return LW_OK;
}

void lw_foreign_materials_finish(struct lw_foreign_materials *materials) {
    for (uint32_t i = 0; i < materials->picture_count; i++) free(materials->picture[i].key);
    free(materials->picture);
    free(materials->converted);
    *materials = (struct lw_foreign_materials){0};
}

/* ---- pictures ---- */

static const char *base_name(const char *path) {
    const char *base = path;
    for (; *path; path++)
        if (*path == '/' || *path == '\\') base = path + 1;
    return base;
}

/* "*3" names the file's texture 3; FBX keeps the name of the file that was put in. */
static const struct aiTexture *find_embedded(const struct aiScene *ai, const char *path) {
    if (path[0] == '*') {
        char *end;
        unsigned long index = strtoul(path + 1, &end, 10);
        return *end == 0 && end > path + 1 && index < ai->mNumTextures ? ai->mTextures[index] : NULL;
    }
    for (unsigned i = 0; i < ai->mNumTextures; i++)
        if (strcmp(ai->mTextures[i]->mFilename.data, path) == 0) return ai->mTextures[i];
    for (unsigned i = 0; i < ai->mNumTextures; i++) {
        const char *name = ai->mTextures[i]->mFilename.data;
        if (*name && strcmp(base_name(name), base_name(path)) == 0) return ai->mTextures[i];
    }
    return NULL;
}

static enum lw_status allocate_texels(struct lw_foreign_materials *materials,
                                      struct lw_foreign_picture *picture, uint8_t **out,
                                      struct lw_error *err) {
    const uint64_t texels = (uint64_t)picture->width * picture->height;
    if (picture->width < 1 || picture->height < 1 || picture->width > LW_SCENE_TEXTURE_SIDE_MAX ||
        picture->height > LW_SCENE_TEXTURE_SIDE_MAX)
        return lw_status_fail(err, LW_BAD_DATA, "has %u x %u texels", picture->width, picture->height);
    if (lw_image_file_count(&materials->pictures, picture->width, picture->height, err)) return err->status;
    *out = lw_scene_alloc(materials->import->scene, texels, 4);
    if (!*out)
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory for %u x %u texels", picture->width,
                              picture->height);
    picture->rgba = *out;
    return LW_OK;
}

static enum lw_status decode(struct lw_foreign_materials *materials, const uint8_t *bytes, size_t size,
                             struct lw_foreign_picture *picture, struct lw_error *err) {
    uint8_t *rgba;
    if (!lw_image_file_size(bytes, size, &picture->width, &picture->height, err) &&
        !allocate_texels(materials, picture, &rgba, err))
        return lw_image_file_decode(bytes, size, picture->width, picture->height, rgba, err);
    return err->status;
}

static enum lw_status load_embedded(struct lw_foreign_materials *materials, const struct aiTexture *texture,
                                    struct lw_foreign_picture *picture, struct lw_error *err) {
    uint8_t *rgba;
    if (!texture->pcData) return lw_status_fail(err, LW_BAD_DATA, "is empty");
    if (texture->mHeight == 0)
        return decode(materials, (const uint8_t *)texture->pcData, texture->mWidth, picture, err);
    picture->width = texture->mWidth;
    picture->height = texture->mHeight;
    if (allocate_texels(materials, picture, &rgba, err)) return err->status;
    for (size_t i = 0; i < (size_t)picture->width * picture->height; i++) {
        const struct aiTexel *texel = &texture->pcData[i];
        memcpy(rgba + 4 * i, (const uint8_t[]){texel->r, texel->g, texel->b, texel->a}, 4);
    }
    return LW_OK;
}

static enum lw_status load_file(struct lw_foreign_materials *materials, const char *path,
                                struct lw_foreign_picture *picture, struct lw_error *err) {
    const struct lw_foreign_files *files = materials->import->files;
    char *found = NULL;
    uint8_t *bytes = NULL;
    size_t size = 0;
    if (!lw_beside_find(files->folder, files->name, path, &found))
        return lw_status_fail(err, LW_BAD_DATA, "is not there: put it into the folder of the scene or below");
    if (!found) return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    if (lw_file_read_beneath(files->folder, found, LW_IMAGE_FILE_SIZE_MAX, true, &bytes, &size, err) == LW_OK)
        (void)decode(materials, bytes, size, picture, err);
    free(bytes);
    free(found);
    return err->status;
}

static enum lw_status add_picture(struct lw_foreign_materials *materials, const char *key,
                                  struct lw_foreign_picture **out, struct lw_error *err) {
    char *own_key = strdup(key);
    if (!own_key || !lw_mesh_builder_reserve((void **)&materials->picture, &materials->picture_capacity,
                                             materials->picture_count + 1ul, sizeof *materials->picture)) {
        free(own_key);
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory for pictures");
    }
    *out = &materials->picture[materials->picture_count++];
    **out = (struct lw_foreign_picture){.key = own_key};
    return LW_OK;
}

static struct lw_foreign_picture *find_picture(struct lw_foreign_materials *materials, const char *key) {
    for (uint32_t i = 0; i < materials->picture_count; i++)
        if (strcmp(materials->picture[i].key, key) == 0) return &materials->picture[i];
    return NULL;
}

static bool has_alpha(const struct lw_foreign_picture *picture) {
    for (size_t i = 0; i < (size_t)picture->width * picture->height; i++)
        if (picture->rgba[4 * i + 3] < 255) return true;
    return false;
}

/* *out_index into the pictures, which may move. A picture that cannot be read is one that is marked so. */
static enum lw_status get_picture(struct lw_foreign_materials *materials, const char *path,
                                  uint32_t *out_index, struct lw_error *err) {
    struct lw_foreign_picture *picture = find_picture(materials, path);
    if (!picture) {
        if (add_picture(materials, path, &picture, err)) return err->status;
        const struct aiTexture *embedded = find_embedded(materials->import->ai, path);
        if (embedded)
            (void)load_embedded(materials, embedded, picture, err);
        else
            (void)load_file(materials, path, picture, err);
        if (err->status == LW_NO_MEMORY) return err->status;
        picture->unreadable = err->status != LW_OK;
        if (picture->unreadable && materials->unreadable_count++ < WARNINGS_MAX)
            lw_log(LW_LOG_WARNING,
                   "%s: texture \"%s\": %s; a colour stands in (half the diffuse colour, no emission)",
                   materials->import->desc->path, path, err->text);
        *err = (struct lw_error){0};
        if (!picture->unreadable) picture->has_alpha = has_alpha(picture);
    }
    *out_index = (uint32_t)(picture - materials->picture);
    return LW_OK;
}

/* The colour of one picture (white if there is none) with the opacity of another, at the larger of their
 * sizes. An opacity map without an alpha channel has it in its brightness. */
static enum lw_status combine(struct lw_foreign_materials *materials, uint32_t colour, uint32_t opacity,
                              uint32_t *out_index, struct lw_error *err) {
    bool coloured = colour != LW_SCENE_NONE;
    size_t size =
        strlen(materials->picture[opacity].key) + (coloured ? strlen(materials->picture[colour].key) : 0) + 2;
    char *key = malloc(size);
    if (!key) return lw_status_fail(err, LW_NO_MEMORY, "out of memory for pictures");
    snprintf(key, size, "%s\n%s", coloured ? materials->picture[colour].key : "",
             materials->picture[opacity].key);
    struct lw_foreign_picture *made = find_picture(materials, key);
    if (!made && add_picture(materials, key, &made, err) == LW_OK) {
        const struct lw_foreign_picture *o = &materials->picture[opacity],
                                        *c = coloured ? &materials->picture[colour] : o;
        uint8_t *rgba;
        made->width = c->width > o->width ? c->width : o->width;
        made->height = c->height > o->height ? c->height : o->height;
        made->has_alpha = true;
        if (!allocate_texels(materials, made, &rgba, err))
            for (uint32_t y = 0; y < made->height; y++)
                for (uint32_t x = 0; x < made->width; x++) {
                    const uint8_t *from = c->rgba + 4 * ((uint64_t)y * c->height / made->height * c->width +
                                                         (uint64_t)x * c->width / made->width);
                    const uint8_t *mask = o->rgba + 4 * ((uint64_t)y * o->height / made->height * o->width +
                                                         (uint64_t)x * o->width / made->width);
                    uint8_t *to = rgba + 4 * ((size_t)y * made->width + x);
                    memcpy(to, coloured ? from : (const uint8_t[]){255, 255, 255}, 3);
                    to[3] = o->has_alpha ? mask[3] : (uint8_t)((mask[0] + mask[1] + mask[2]) / 3);
                }
    }
    free(key);
    if (err->status) return err->status;
    *out_index = (uint32_t)(made - materials->picture);
    return LW_OK;
}

static bool blends(const struct lw_foreign_picture *picture) {
    size_t texels = (size_t)picture->width * picture->height, between = 0;
    for (size_t i = 0; i < texels; i++) {
        uint8_t alpha = picture->rgba[4 * i + 3];
        between += alpha > NEARLY_CLEAR && alpha < NEARLY_OPAQUE;
    }
    return (double)between > BLEND_SHARE * (double)texels;
}

/* ---- textures ---- */

/* A material's texture of one kind, before its picture is read. */
struct reference {
    bool there;
    struct aiString path;
    unsigned uv_set;
    uint8_t wrap_s, wrap_t;
    float transform[6];
};

static uint8_t wrap_of(enum aiTextureMapMode mode) {
    return mode == aiTextureMapMode_Mirror ? LW_WRAP_MIRROR
           : mode == aiTextureMapMode_Wrap ? LW_WRAP_REPEAT
                                           : LW_WRAP_CLAMP;
}

/* Assimp: coordinates are scaled, turned about (0.5, 0.5) and moved, with v up. Ours have v down: v' = 1 - v
 * on both sides of the transform. */
static void convert_transform(const struct aiUVTransform *from, float out[6]) {
    float c = cosf(from->mRotation), s = sinf(from->mRotation);
    float a[6] = {
        c * from->mScaling.x, -s * from->mScaling.y, 0.5f - 0.5f * c + 0.5f * s + from->mTranslation.x,
        s * from->mScaling.x, c * from->mScaling.y,  0.5f - 0.5f * s - 0.5f * c + from->mTranslation.y};
    const float flipped[6] = {a[0], -a[1], a[1] + a[2], -a[3], a[4], 1 - a[4] - a[5]};
    memcpy(out, flipped, sizeof flipped);
}

static enum lw_status read_reference(const struct aiMaterial *ai, enum aiTextureType type,
                                     struct reference *out, struct lw_error *err) {
    enum aiTextureMapMode mode[3] = {aiTextureMapMode_Wrap, aiTextureMapMode_Wrap, aiTextureMapMode_Wrap};
    struct aiUVTransform transform = {.mScaling = {1, 1}};
    *out = (struct reference){0};
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
                                  enum aiTextureType second, struct reference *out, struct lw_error *err) {
    if (read_reference(ai, first, out, err) || out->there) return err->status;
    return read_reference(ai, second, out, err);
}

static enum lw_status use_picture(struct lw_foreign_materials *materials, uint32_t index,
                                  const struct reference *reference, struct lw_texture_use *out,
                                  struct lw_error *err) {
    struct lw_scene *scene = materials->import->scene;
    const struct lw_foreign_picture *picture = &materials->picture[index];
    uint32_t t = 0;
    while (t < scene->texture_count &&
           (scene->texture[t].rgba != picture->rgba || scene->texture[t].wrap_s != reference->wrap_s ||
            scene->texture[t].wrap_t != reference->wrap_t))
        t++;
    if (t == scene->texture_count) {
        struct aiString name = {0};
        snprintf(name.data, sizeof name.data, "%s", base_name(reference->path.data));
        const char *text = lw_foreign_import_text(materials->import, &name);
        if (!text) return lw_status_fail(err, LW_NO_MEMORY, "out of memory for textures");
        scene->texture[scene->texture_count++] = (struct lw_texture){.name = text,
                                                                     .width = picture->width,
                                                                     .height = picture->height,
                                                                     .rgba = picture->rgba,
                                                                     .wrap_s = reference->wrap_s,
                                                                     .wrap_t = reference->wrap_t};
    }
    out->texture = t;
    out->uv_set = reference->uv_set;
    memcpy(out->transform, reference->transform, sizeof out->transform);
    return LW_OK;
}

/* ---- colours ---- */

/* *out_there: the material has the colour. */
static enum lw_status read_colour(const struct aiMaterial *ai, const char *key, unsigned type, unsigned index,
                                  const char *name, float out[3], bool *out_there, struct lw_error *err) {
    struct aiColor4D colour = {0};
    *out_there = aiGetMaterialColor(ai, key, type, index, &colour) == aiReturn_SUCCESS;
    if (!*out_there) return LW_OK;
    const float c[3] = {colour.r, colour.g, colour.b};
    for (int i = 0; i < 3; i++)
        if (!(c[i] >= 0 && c[i] <= LW_SCENE_RADIANCE_MAX))
            return lw_status_fail(err, LW_BAD_DATA, "its %s colour has the component %g", name, (double)c[i]);
    memcpy(out, c, sizeof c);
    return LW_OK;
}

static float brightest(const float c[3]) { return lw_mirror_brightest(c); }
static bool is_white(const float c[3]) { return c[0] == 1 && c[1] == 1 && c[2] == 1; }

/* Next to a texture FBX and Collada mean the texture alone; an MTL file means the product, but a colour that
 * it leaves out, or gives as black, was never meant to hide the texture. */
static void colour_beside_texture(enum lw_scene_format format, float colour[3]) {
    bool missing = colour[0] == ASSIMP_GREY && colour[1] == ASSIMP_GREY && colour[2] == ASSIMP_GREY;
    if (format == LW_SCENE_FORMAT_OBJ && !missing && brightest(colour) > 0) return;
    for (int c = 0; c < 3; c++) colour[c] = 1;
}

/* A lamp is black because it is a lamp. */
static bool emits(const struct aiMaterial *ai) {
    struct aiColor4D colour = {0};
    return aiGetMaterialColor(ai, AI_MATKEY_COLOR_EMISSIVE, &colour) == aiReturn_SUCCESS &&
           (colour.r > 0 || colour.g > 0 || colour.b > 0);
}

static enum lw_status read_albedo(struct lw_foreign_materials *materials, const struct aiMaterial *ai,
                                  const struct reference *texture, float out[3], struct lw_error *err) {
    float specular[3] = {0};
    bool there;
    for (int c = 0; c < 3; c++) out[c] = ASSIMP_GREY;
    if (read_colour(ai, AI_MATKEY_COLOR_DIFFUSE, "diffuse", out, &there, err) ||
        (!there && read_colour(ai, AI_MATKEY_BASE_COLOR, "base", out, &there, err)))
        return err->status;
    if (texture->there) {
        colour_beside_texture(materials->import->desc->format, out);
        return LW_OK;
    }
    if (emits(ai)) return LW_OK;
    if (read_colour(ai, AI_MATKEY_COLOR_SPECULAR, "specular", specular, &there, err)) return err->status;
    if (lw_mirror_is(out, specular)) memcpy(out, specular, sizeof specular);
    return LW_OK;
}

/* The diffuse texture and the opacity map become one texture. Without an opacity map the alpha of a diffuse
 * texture means nothing, as the formats have it. */
static enum lw_status read_base(struct lw_foreign_materials *materials, const struct aiMaterial *ai,
                                struct lw_material *out, struct lw_error *err) {
    struct reference colour, opacity;
    uint32_t colour_picture = LW_SCENE_NONE, opacity_picture = LW_SCENE_NONE;
    float alpha = 1;
    if (read_either(ai, aiTextureType_DIFFUSE, aiTextureType_BASE_COLOR, &colour, err) ||
        read_reference(ai, aiTextureType_OPACITY, &opacity, err) ||
        read_albedo(materials, ai, &colour, out->base_colour, err) ||
        (colour.there && get_picture(materials, colour.path.data, &colour_picture, err)) ||
        (opacity.there && get_picture(materials, opacity.path.data, &opacity_picture, err)))
        return err->status;
    if (brightest(out->base_colour) > 1) {
        lw_tally_add(&materials->bright, out->name);
        for (int c = 0; c < 3; c++) out->base_colour[c] = fminf(out->base_colour[c], 1);
    }
    if (colour.there && materials->picture[colour_picture].unreadable) {
        for (int c = 0; c < 3; c++) out->base_colour[c] *= LW_IMAGE_FILE_STAND_IN_ALBEDO;
        colour_picture = LW_SCENE_NONE;
    }
    if (opacity.there && materials->picture[opacity_picture].unreadable) opacity_picture = LW_SCENE_NONE;
    if (colour.uv_set > 1 || opacity.uv_set > 1) {
        lw_foreign_import_warn(materials->import, LW_FOREIGN_WARN_UV_SET);
        colour_picture = opacity_picture = LW_SCENE_NONE;
    }
    bool own_alpha = opacity_picture != LW_SCENE_NONE && opacity_picture == colour_picture &&
                     !materials->picture[opacity_picture].has_alpha;
    if (own_alpha)
        opacity_picture = LW_SCENE_NONE; /* exporters name the colour again; there is nothing in it */
    uint32_t picture = colour_picture;
    if (opacity_picture != LW_SCENE_NONE && opacity_picture != colour_picture &&
        combine(materials, colour_picture, opacity_picture, &picture, err))
        return err->status;
    if (picture != LW_SCENE_NONE &&
        use_picture(materials, picture, colour.there ? &colour : &opacity, &out->base_colour_texture, err))
        return err->status;

    (void)aiGetMaterialFloatArray(ai, AI_MATKEY_OPACITY, &alpha, NULL);
    if (!(alpha >= 0 && alpha <= 1)) {
        if (!isfinite(alpha) || alpha < 0)
            return lw_status_fail(err, LW_BAD_DATA, "its opacity is %g", (double)alpha);
        alpha = 1;
    }
    if (alpha == 0 && opacity_picture == LW_SCENE_NONE) {
        lw_tally_add(&materials->invisible, out->name);
        alpha = 1;
    }
    out->base_colour[3] = alpha;
    if (alpha < 1)
        out->alpha_mode = LW_ALPHA_BLEND;
    else if (opacity_picture != LW_SCENE_NONE)
        out->alpha_mode = blends(&materials->picture[picture]) ? LW_ALPHA_BLEND : LW_ALPHA_MASK;
    return LW_OK;
}

static enum lw_status read_emission(struct lw_foreign_materials *materials, const struct aiMaterial *ai,
                                    struct lw_material *out, struct lw_error *err) {
    struct reference reference;
    uint32_t picture = 0;
    bool there;
    if (read_colour(ai, AI_MATKEY_COLOR_EMISSIVE, "emissive", out->emission, &there, err) ||
        read_either(ai, aiTextureType_EMISSIVE, aiTextureType_EMISSION_COLOR, &reference, err) ||
        !reference.there)
        return err->status;
    if (brightest(out->emission) <= 0)
        for (int c = 0; c < 3; c++)
            out->emission[c] = 1; /* a colour left at black is no wish to hide the map */
    if (get_picture(materials, reference.path.data, &picture, err)) return err->status;
    if (materials->picture[picture].unreadable || reference.uv_set > 1) {
        /* most of such a map is black: all of it alight would be worse than none */
        memset(out->emission, 0, sizeof out->emission);
        if (reference.uv_set > 1) lw_foreign_import_warn(materials->import, LW_FOREIGN_WARN_UV_SET);
        return LW_OK;
    }
    return use_picture(materials, picture, &reference, &out->emission_texture, err);
}

/* ---- materials ---- */

static enum lw_status convert(struct lw_foreign_materials *materials, const struct aiMaterial *ai,
                              struct lw_foreign_converted *converted, struct lw_error *err) {
    struct lw_material *out = &converted->material;
    struct aiString name = {0};
    int two_sided = 0;
    (void)aiGetMaterialString(ai, AI_MATKEY_NAME, &name);
    *out = (struct lw_material){.base_colour = {1, 1, 1, 1},
                                .base_colour_texture = no_texture,
                                .emission_texture = no_texture,
                                .alpha_cutoff = 0.5f};
    out->name = lw_foreign_import_text(materials->import, &name);
    if (!out->name) return lw_status_fail(err, LW_NO_MEMORY, "out of memory for materials");
    if (read_base(materials, ai, out, err) || read_emission(materials, ai, out, err)) {
        lw_status_context(err, "material \"%.80s\"", out->name);
        return err->status;
    }
    (void)aiGetMaterialIntegerArray(ai, AI_MATKEY_TWOSIDED, &two_sided, NULL);
    converted->stated_two_sided = two_sided != 0;
    converted->emits = brightest(out->emission) > 0;
    converted->is_default = strcmp(name.data, ASSIMP_DEFAULT_NAME) == 0;
    converted->done = true;
    if (aiGetMaterialTextureCount(ai, aiTextureType_NORMALS) +
        aiGetMaterialTextureCount(ai, aiTextureType_HEIGHT))
        lw_foreign_import_warn(materials->import, LW_FOREIGN_WARN_NORMAL_MAP);
    return LW_OK;
}

static bool is_two_sided(const struct lw_foreign_materials *materials,
                         const struct lw_foreign_converted *converted, bool closed) {
    switch (materials->import->desc->sides) {
    case LW_FOREIGN_SIDES_ONE:
        return false;
    case LW_FOREIGN_SIDES_TWO:
        return true;
    case LW_FOREIGN_SIDES_AUTO:
        break;
    }
    return converted->stated_two_sided || (!closed && !converted->emits);
}

enum lw_status lw_foreign_materials_get(struct lw_foreign_materials *materials, uint32_t index,
                                        struct lw_foreign_surface surface, uint32_t *out,
                                        struct lw_error *err) {
    const struct aiScene *ai = materials->import->ai;
    if (index >= ai->mNumMaterials)
        return lw_status_fail(err, LW_BAD_DATA, "uses material %u of %u", index, ai->mNumMaterials);
    struct lw_foreign_converted *converted = &materials->converted[index];
    if (!converted->done && convert(materials, ai->mMaterials[index], converted, err)) return err->status;
    bool two_sided = is_two_sided(materials, converted, surface.closed);
    /* vertex colours are the colour of what has no material; the default grey would darken them */
    bool white = surface.coloured && converted->is_default && !is_white(converted->material.base_colour);
    uint32_t *variant = &converted->variant[2 * white + two_sided];
    if (*variant == LW_SCENE_NONE) {
        struct lw_scene *scene = materials->import->scene;
        struct lw_material *material = &scene->material[scene->material_count];
        *material = converted->material;
        material->double_sided = two_sided;
        for (int c = 0; white && c < 3; c++) material->base_colour[c] = 1;
        *variant = scene->material_count++;
    }
    *out = *variant;
    return LW_OK;
}

void lw_foreign_materials_report(const struct lw_foreign_materials *materials) {
    const char *path = materials->import->desc->path;
    if (materials->unreadable_count > WARNINGS_MAX)
        lw_log(LW_LOG_WARNING, "%s: %llu more textures cannot be read", path,
               (unsigned long long)(materials->unreadable_count - WARNINGS_MAX));
    lw_tally_warn(&materials->bright, path, "diffuse colours above 1 are lowered to 1");
    lw_tally_warn(&materials->invisible, path, "materials of opacity 0 are taken as opaque");
}
