/* Rules for what diffuse light cannot show, and why: docs/importing.md, "Materials". */
#include "server/import/foreign_material.h"

#include "common/colour.h"
#include "common/file_read.h"
#include "common/log.h"
#include "server/import/beside.h"
#include "server/import/foreign_look.h"
#include "server/import/image_file.h"
#include "server/import/mesh_builder.h"
#include "server/import/mirror.h"

#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Albedo of what has none. Assimp puts the same where FBX and Collada name no diffuse colour. */
#define GREY 0.6f

/* An opacity map with less than this share of texels between nearly 0 and nearly 1 cuts out; else it
 * blends. */
#define BLEND_SHARE   0.25
#define NEARLY_OPAQUE 229 /* of 255 */
#define NEARLY_CLEAR  26

#define WARNINGS_MAX 20 /* lines about single pictures */

enum { VARIANTS = 4 }; /* one- or two-sided, own colour or white */

struct lw_foreign_picture {
    char *key; /* folder and path as the file has them; of one that is made of others, what it is made of */
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

/* Beside the library that names it, then as if the scene did, then by its name near the library. *out: from
 * the scene's folder on; NULL: not there. */
static enum lw_status find_file(const struct lw_foreign_files *files, const struct lw_foreign_map *map,
                                char **out, struct lw_error *err) {
    char path[PATH_MAX], folder[PATH_MAX], *near = NULL;
    *out = NULL;
    if (!*map->folder) {
        if (lw_beside_find(files->folder, files->name, map->path.data, out) && !*out) goto no_memory;
        return LW_OK;
    }
    if (snprintf(path, sizeof path, "%s/%s", map->folder, map->path.data) >= (int)sizeof path ||
        snprintf(folder, sizeof folder, "%s/%s", files->folder, map->folder) >= (int)sizeof folder)
        return LW_OK;
    if (lw_beside_find(files->folder, files->name, path, out)) {
        if (!*out) goto no_memory;
        return LW_OK;
    }
    if (!lw_beside_find(folder, files->name, map->path.data, &near)) return LW_OK;
    if (!near) goto no_memory;
    const int length = snprintf(path, sizeof path, "%s/%s", map->folder, near);
    free(near);
    if (length >= (int)sizeof path) return LW_OK;
    *out = strdup(path);
    if (*out) return LW_OK;
no_memory:
    return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
}

static enum lw_status load_file(struct lw_foreign_materials *materials, const struct lw_foreign_map *map,
                                struct lw_foreign_picture *picture, struct lw_error *err) {
    const struct lw_foreign_files *files = materials->import->files;
    char *found = NULL;
    uint8_t *bytes = NULL;
    size_t size = 0;
    if (find_file(files, map, &found, err)) return err->status;
    if (!found)
        return lw_status_fail(err, LW_BAD_DATA, "is not there: put it into the folder of the scene or below");
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

/* Colours are sRGB in a picture, and linear where a map changes them. */
static uint8_t change_value(uint8_t value, const struct lw_foreign_map *map) {
    const float linear = map->base + map->gain * lw_colour_from_srgb((float)value / 255);
    return (uint8_t)(lw_colour_to_srgb(fminf(fmaxf(linear, 0), 1)) * 255 + 0.5f);
}

/* A copy of a picture with the values that its map asks for. */
static enum lw_status change_picture(struct lw_foreign_materials *materials, const struct lw_foreign_map *map,
                                     uint32_t *index, struct lw_error *err) {
    char key[PATH_MAX + 64];
    uint8_t table[256], *rgba;
    snprintf(key, sizeof key, "%.*s\n%.9g %.9g", PATH_MAX - 1, materials->picture[*index].key,
             (double)map->base, (double)map->gain);
    struct lw_foreign_picture *made = find_picture(materials, key);
    if (!made) {
        if (add_picture(materials, key, &made, err)) return err->status;
        const struct lw_foreign_picture *from = &materials->picture[*index];
        made->width = from->width;
        made->height = from->height;
        made->has_alpha = from->has_alpha;
        if (allocate_texels(materials, made, &rgba, err)) return err->status;
        for (int i = 0; i < 256; i++) table[i] = change_value((uint8_t)i, map);
        for (size_t i = 0; i < 4 * (size_t)from->width * from->height; i++)
            rgba[i] = i % 4 == 3 ? from->rgba[i] : table[from->rgba[i]];
    }
    *index = (uint32_t)(made - materials->picture);
    return LW_OK;
}

/* *out_index into the pictures, which may move. A picture that cannot be read is one that is marked so. */
static enum lw_status get_picture(struct lw_foreign_materials *materials, const struct lw_foreign_map *map,
                                  uint32_t *out_index, struct lw_error *err) {
    char key[PATH_MAX];
    snprintf(key, sizeof key, "%s%s%s", map->folder, *map->folder ? "/" : "", map->path.data);
    struct lw_foreign_picture *picture = find_picture(materials, key);
    if (!picture) {
        if (add_picture(materials, key, &picture, err)) return err->status;
        const struct aiTexture *embedded = find_embedded(materials->import->ai, map->path.data);
        if (embedded)
            (void)load_embedded(materials, embedded, picture, err);
        else
            (void)load_file(materials, map, picture, err);
        if (err->status == LW_NO_MEMORY) return err->status;
        picture->unreadable = err->status != LW_OK;
        if (picture->unreadable && materials->unreadable_count++ < WARNINGS_MAX)
            lw_log(LW_LOG_WARNING,
                   "%s: texture \"%s\": %s; a colour stands in (half the diffuse colour, no emission)",
                   materials->import->desc->path, map->path.data, err->text);
        *err = (struct lw_error){0};
        if (!picture->unreadable) picture->has_alpha = has_alpha(picture);
    }
    *out_index = (uint32_t)(picture - materials->picture);
    return LW_OK;
}

static uint8_t opacity_of(const uint8_t texel[4], bool has_alpha, const struct lw_foreign_map *map) {
    const char channel = map->channel ? map->channel : has_alpha ? 'm' : 'l';
    const float value = channel == 'r'   ? texel[0]
                        : channel == 'g' ? texel[1]
                        : channel == 'b' ? texel[2]
                        : channel == 'm' ? texel[3]
                                         : (float)((texel[0] + texel[1] + texel[2]) / 3);
    return (uint8_t)fminf(fmaxf(255 * map->base + map->gain * value, 0), 255);
}

/* The colour of one picture (white if there is none) with the opacity of another, at the larger of their
 * sizes. An opacity map without an alpha channel has it in its brightness. */
static void fill_combined(const struct lw_foreign_picture *colour, const struct lw_foreign_picture *opacity,
                          const struct lw_foreign_map *map, const struct lw_foreign_picture *made,
                          uint8_t *rgba) {
    const struct lw_foreign_picture *c = colour ? colour : opacity, *o = opacity;
    for (uint32_t y = 0; y < made->height; y++)
        for (uint32_t x = 0; x < made->width; x++) {
            const uint8_t *from = c->rgba + 4 * ((uint64_t)y * c->height / made->height * c->width +
                                                 (uint64_t)x * c->width / made->width);
            const uint8_t *mask = o->rgba + 4 * ((uint64_t)y * o->height / made->height * o->width +
                                                 (uint64_t)x * o->width / made->width);
            uint8_t *to = rgba + 4 * ((size_t)y * made->width + x);
            memcpy(to, colour ? from : (const uint8_t[]){255, 255, 255}, 3);
            to[3] = opacity_of(mask, o->has_alpha, map);
        }
}

static enum lw_status combine(struct lw_foreign_materials *materials, uint32_t colour, uint32_t opacity,
                              const struct lw_foreign_map *map, uint32_t *out_index, struct lw_error *err) {
    bool coloured = colour != LW_SCENE_NONE;
    char *key = NULL;
    if (asprintf(&key, "%s\n%s\n%c %.9g %.9g", coloured ? materials->picture[colour].key : "",
                 materials->picture[opacity].key, map->channel ? map->channel : '-', (double)map->base,
                 (double)map->gain) < 0)
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory for pictures");
    struct lw_foreign_picture *made = find_picture(materials, key);
    if (!made && add_picture(materials, key, &made, err) == LW_OK) {
        const struct lw_foreign_picture *o = &materials->picture[opacity],
                                        *c = coloured ? &materials->picture[colour] : NULL;
        uint8_t *rgba;
        made->width = c && c->width > o->width ? c->width : o->width;
        made->height = c && c->height > o->height ? c->height : o->height;
        made->has_alpha = true;
        if (!allocate_texels(materials, made, &rgba, err)) fill_combined(c, o, map, made, rgba);
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

static enum lw_status use_picture(struct lw_foreign_materials *materials, uint32_t index,
                                  const struct lw_foreign_map *reference, struct lw_texture_use *out,
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

static enum lw_status check_colour(const struct lw_foreign_look *look, enum lw_foreign_colour which,
                                   struct lw_error *err) {
    static const char *const names[LW_FOREIGN_COLOURS] = {"diffuse", "specular", "emissive"};
    for (int i = 0; i < 3 && look->has_colour[which]; i++)
        if (!(look->colour[which][i] >= 0 && look->colour[which][i] <= LW_SCENE_RADIANCE_MAX))
            return lw_status_fail(err, LW_BAD_DATA, "its %s colour has the component %g", names[which],
                                  (double)look->colour[which][i]);
    return LW_OK;
}

static float brightest(const float c[3]) { return lw_mirror_brightest(c); }
static bool is_white(const float c[3]) { return c[0] == 1 && c[1] == 1 && c[2] == 1; }

/* Next to a texture FBX and Collada mean the texture alone; an MTL file means the product, but a colour that
 * it leaves out, or gives as black, was never meant to hide the texture. */
static void colour_beside_texture(enum lw_scene_format format, const struct lw_foreign_look *look,
                                  float colour[3]) {
    if (format == LW_SCENE_FORMAT_OBJ && look->has_colour[LW_FOREIGN_DIFFUSE] && brightest(colour) > 0)
        return;
    for (int c = 0; c < 3; c++) colour[c] = 1;
}

static enum lw_status read_albedo(struct lw_foreign_materials *materials, const struct lw_foreign_look *look,
                                  float out[3], struct lw_error *err) {
    const float *specular = look->colour[LW_FOREIGN_SPECULAR];
    for (int c = 0; c < 3; c++) out[c] = GREY;
    if (check_colour(look, LW_FOREIGN_DIFFUSE, err)) return err->status;
    if (look->has_colour[LW_FOREIGN_DIFFUSE]) memcpy(out, look->colour[LW_FOREIGN_DIFFUSE], 3 * sizeof *out);
    if (look->colour_map.there) {
        colour_beside_texture(materials->import->desc->format, look, out);
        return LW_OK;
    }
    /* a lamp is black because it is a lamp */
    if (look->has_colour[LW_FOREIGN_EMISSION] && brightest(look->colour[LW_FOREIGN_EMISSION]) > 0)
        return LW_OK;
    if (check_colour(look, LW_FOREIGN_SPECULAR, err)) return err->status;
    if (look->has_colour[LW_FOREIGN_SPECULAR] && lw_mirror_is(out, specular))
        memcpy(out, specular, 3 * sizeof *out);
    return LW_OK;
}

static bool is_changed(const struct lw_foreign_map *map) { return map->base != 0 || map->gain != 1; }

/* The picture of a map, with the values that the map asks for; LW_SCENE_NONE: there is none, or it cannot be
 * read. */
static enum lw_status get_colours(struct lw_foreign_materials *materials, const struct lw_foreign_map *map,
                                  uint32_t *out, bool *out_unreadable, struct lw_error *err) {
    *out = LW_SCENE_NONE;
    *out_unreadable = false;
    if (!map->there) return LW_OK;
    if (get_picture(materials, map, out, err)) return err->status;
    *out_unreadable = materials->picture[*out].unreadable;
    if (*out_unreadable)
        *out = LW_SCENE_NONE;
    else if (is_changed(map))
        return change_picture(materials, map, out, err);
    return LW_OK;
}

/* The diffuse texture and the opacity map become one texture. Without an opacity map the alpha of a diffuse
 * texture means nothing, as the formats have it. *out: LW_SCENE_NONE if there is none. *out_opacity: it has
 * one. */
static enum lw_status join_maps(struct lw_foreign_materials *materials, const struct lw_foreign_look *look,
                                uint32_t colour, uint32_t opacity, uint32_t *out, bool *out_opacity,
                                struct lw_error *err) {
    const struct lw_foreign_map *map = &look->opacity_map;
    const bool plain = !map->channel && !is_changed(map);
    if (colour != LW_SCENE_NONE && opacity != LW_SCENE_NONE &&
        memcmp(map->transform, look->colour_map.transform, sizeof map->transform) != 0)
        lw_foreign_import_warn(materials->import, LW_FOREIGN_WARN_OPACITY_TRANSFORM);
    if (plain && opacity == colour && opacity != LW_SCENE_NONE && !materials->picture[opacity].has_alpha)
        opacity = LW_SCENE_NONE; /* exporters name the colour again; there is nothing in it */
    *out = colour;
    *out_opacity = opacity != LW_SCENE_NONE;
    if (*out_opacity && (opacity != colour || !plain))
        return combine(materials, colour, opacity, map, out, err);
    return LW_OK;
}

static enum lw_status read_alpha(struct lw_foreign_materials *materials, const struct lw_foreign_look *look,
                                 bool has_map, uint32_t picture, struct lw_material *out,
                                 struct lw_error *err) {
    float alpha = look->opacity;
    if (!(alpha >= 0 && alpha <= 1)) {
        if (!isfinite(alpha) || alpha < 0)
            return lw_status_fail(err, LW_BAD_DATA, "its opacity is %g", (double)alpha);
        alpha = 1;
    }
    if (alpha == 0 && !has_map) {
        lw_tally_add(&materials->invisible, out->name);
        alpha = 1;
    }
    out->base_colour[3] = alpha;
    if (alpha < 1)
        out->alpha_mode = LW_ALPHA_BLEND;
    else if (has_map)
        out->alpha_mode = blends(&materials->picture[picture]) ? LW_ALPHA_BLEND : LW_ALPHA_MASK;
    return LW_OK;
}

static enum lw_status read_base(struct lw_foreign_materials *materials, const struct lw_foreign_look *look,
                                struct lw_material *out, struct lw_error *err) {
    const struct lw_foreign_map *colour = &look->colour_map, *opacity = &look->opacity_map;
    struct lw_foreign_map plain = *opacity; /* its values are changed where it becomes an alpha */
    uint32_t colour_picture, opacity_picture, picture;
    bool colour_lost, opacity_lost, has_opacity;
    plain.base = 0;
    plain.gain = 1;
    if (read_albedo(materials, look, out->base_colour, err) ||
        get_colours(materials, colour, &colour_picture, &colour_lost, err) ||
        get_colours(materials, &plain, &opacity_picture, &opacity_lost, err))
        return err->status;
    if (brightest(out->base_colour) > 1) {
        lw_tally_add(&materials->bright, out->name);
        for (int c = 0; c < 3; c++) out->base_colour[c] = fminf(out->base_colour[c], 1);
    }
    for (int c = 0; colour_lost && c < 3; c++) out->base_colour[c] *= LW_IMAGE_FILE_STAND_IN_ALBEDO;
    if (colour->uv_set > 1 || opacity->uv_set > 1) {
        lw_foreign_import_warn(materials->import, LW_FOREIGN_WARN_UV_SET);
        colour_picture = opacity_picture = LW_SCENE_NONE;
    }
    if (join_maps(materials, look, colour_picture, opacity_picture, &picture, &has_opacity, err) ||
        (picture != LW_SCENE_NONE &&
         use_picture(materials, picture, colour->there ? colour : opacity, &out->base_colour_texture, err)))
        return err->status;
    return read_alpha(materials, look, has_opacity, picture, out, err);
}

static enum lw_status read_emission(struct lw_foreign_materials *materials,
                                    const struct lw_foreign_look *look, struct lw_material *out,
                                    struct lw_error *err) {
    const struct lw_foreign_map *map = &look->emission_map;
    uint32_t picture = 0;
    if (check_colour(look, LW_FOREIGN_EMISSION, err)) return err->status;
    if (look->has_colour[LW_FOREIGN_EMISSION])
        memcpy(out->emission, look->colour[LW_FOREIGN_EMISSION], sizeof out->emission);
    if (!map->there) return LW_OK;
    if (brightest(out->emission) <= 0)
        for (int c = 0; c < 3; c++)
            out->emission[c] = 1; /* a colour left at black is no wish to hide the map */
    if (get_picture(materials, map, &picture, err)) return err->status;
    if (materials->picture[picture].unreadable || map->uv_set > 1) {
        /* most of such a map is black: all of it alight would be worse than none */
        memset(out->emission, 0, sizeof out->emission);
        if (map->uv_set > 1) lw_foreign_import_warn(materials->import, LW_FOREIGN_WARN_UV_SET);
        return LW_OK;
    }
    if (map->base == 0 && map->gain >= 0) /* light may be above 1, a picture may not */
        for (int c = 0; c < 3; c++)
            out->emission[c] = fminf(out->emission[c] * map->gain, LW_SCENE_RADIANCE_MAX);
    else if (change_picture(materials, map, &picture, err))
        return err->status;
    return use_picture(materials, picture, map, &out->emission_texture, err);
}

/* ---- materials ---- */

static enum lw_status convert(struct lw_foreign_materials *materials, unsigned index,
                              struct lw_foreign_converted *converted, struct lw_error *err) {
    struct lw_material *out = &converted->material;
    struct lw_foreign_look look;
    *out = (struct lw_material){.base_colour = {1, 1, 1, 1},
                                .base_colour_texture = no_texture,
                                .emission_texture = no_texture,
                                .alpha_cutoff = 0.5f};
    const enum lw_status status = lw_foreign_look_read(materials->import, index, &look, err);
    out->name = lw_foreign_import_text(materials->import, &look.name);
    if (!out->name) return lw_status_fail(err, LW_NO_MEMORY, "out of memory for materials");
    if (status || read_base(materials, &look, out, err) || read_emission(materials, &look, out, err)) {
        lw_status_context(err, "material \"%.80s\"", out->name);
        return err->status;
    }
    converted->stated_two_sided = look.stated_two_sided;
    converted->emits = brightest(out->emission) > 0;
    converted->is_default = look.is_default;
    converted->done = true;
    if (look.has_bump) lw_foreign_import_warn(materials->import, LW_FOREIGN_WARN_NORMAL_MAP);
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
    if (!converted->done && convert(materials, index, converted, err)) return err->status;
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
