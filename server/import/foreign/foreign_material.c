/* Rules for what diffuse light cannot show, and why: docs/importing_finish.md. */
#include "server/import/foreign/foreign_material.h"

#include "server/import/foreign/foreign_look.h"
#include "server/import/images/image_file.h"
#include "server/import/mesh/mesh_builder.h"
#include "server/import/mirror.h"

#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Albedo where a file names none. Assimp puts the same where FBX and Collada name no diffuse colour. */
#define GREY 0.6f

enum { VARIANTS = 4 }; /* one- or two-sided, own colour or white */

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
    *materials = (struct lw_foreign_materials){.import = import};
    lw_foreign_pictures_init(&materials->pictures, import);
    materials->finish = (struct lw_foreign_finish){.pictures = &materials->pictures};
    if (count > LW_SCENE_MATERIALS_MAX / VARIANTS || 2 * count > LW_SCENE_TEXTURES_MAX)
        return lw_status_fail(err, LW_BAD_DATA, "has %zu materials; the limit is %u", count,
                              LW_SCENE_TEXTURES_MAX / 2);
    materials->converted = calloc(count + 1, sizeof *materials->converted);
    scene->material = lw_scene_alloc(scene, VARIANTS * count + 1, sizeof *scene->material);
    scene->texture = lw_scene_alloc(scene, 2 * count + 1, sizeof *scene->texture);
    scene->finish_texture =
        lw_scene_alloc(scene, lw_foreign_finish_textures_max(count) + 1, sizeof *scene->finish_texture);
    if (!materials->converted || !scene->material || !scene->texture || !scene->finish_texture)
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory for materials");
    for (size_t i = 0; i < count; i++)
        for (int v = 0; v < VARIANTS; v++) materials->converted[i].variant[v] = LW_SCENE_NONE;
    return LW_OK;
}

void lw_foreign_materials_finish(struct lw_foreign_materials *materials) {
    lw_foreign_pictures_finish(&materials->pictures);
    free(materials->converted);
    *materials = (struct lw_foreign_materials){0};
}

/* ---- textures ---- */

static enum lw_status use_picture(struct lw_foreign_materials *materials, uint32_t index,
                                  const struct lw_foreign_map *reference, struct lw_texture_use *out,
                                  struct lw_error *err) {
    struct lw_scene *scene = materials->import->scene;
    const struct lw_foreign_picture *picture = &materials->pictures.picture[index];
    uint32_t t = 0;
    while (t < scene->texture_count &&
           (scene->texture[t].rgba != picture->rgba || scene->texture[t].wrap_s != reference->wrap_s ||
            scene->texture[t].wrap_t != reference->wrap_t))
        t++;
    if (t == scene->texture_count) {
        struct aiString name = {0};
        snprintf(name.data, sizeof name.data, "%s", lw_foreign_pictures_base_name(reference->path.data));
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

/* *out_mirror: it is the specular colour. */
static enum lw_status read_albedo(struct lw_foreign_materials *materials, const struct lw_foreign_look *look,
                                  float out[3], bool *out_mirror, struct lw_error *err) {
    const float *specular = look->colour[LW_FOREIGN_SPECULAR];
    for (int c = 0; c < 3; c++) out[c] = GREY;
    *out_mirror = false;
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
    const bool said = !materials->import->desc->matt && lw_foreign_finish_is_said(look);
    *out_mirror = !said && look->has_colour[LW_FOREIGN_SPECULAR] && lw_mirror_is(out, specular);
    if (*out_mirror) memcpy(out, specular, 3 * sizeof *out);
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
    if (lw_foreign_pictures_get(&materials->pictures, map, out, err)) return err->status;
    *out_unreadable = materials->pictures.picture[*out].unreadable;
    if (*out_unreadable)
        *out = LW_SCENE_NONE;
    else if (is_changed(map))
        return lw_foreign_pictures_change(&materials->pictures, map, out, err);
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
    if (plain && opacity == colour && opacity != LW_SCENE_NONE &&
        !materials->pictures.picture[opacity].has_alpha)
        opacity = LW_SCENE_NONE; /* exporters name the colour again; there is nothing in it */
    *out = colour;
    *out_opacity = opacity != LW_SCENE_NONE;
    if (*out_opacity && (opacity != colour || !plain))
        return lw_foreign_pictures_combine(&materials->pictures, colour, opacity, map, out, err);
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
        out->alpha_mode =
            lw_foreign_pictures_blend(&materials->pictures.picture[picture]) ? LW_ALPHA_BLEND : LW_ALPHA_MASK;
    return LW_OK;
}

static enum lw_status read_base(struct lw_foreign_materials *materials, const struct lw_foreign_look *look,
                                struct lw_material *out, bool *out_mirror, struct lw_error *err) {
    const struct lw_foreign_map *colour = &look->colour_map, *opacity = &look->opacity_map;
    struct lw_foreign_map plain = *opacity; /* its values are changed where it becomes an alpha */
    uint32_t colour_picture, opacity_picture, picture;
    bool colour_lost, opacity_lost, has_opacity;
    plain.base = 0;
    plain.gain = 1;
    if (read_albedo(materials, look, out->base_colour, out_mirror, err) ||
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
    if (lw_foreign_pictures_get(&materials->pictures, map, &picture, err)) return err->status;
    if (materials->pictures.picture[picture].unreadable || map->uv_set > 1) {
        /* most of such a map is black: all of it alight would be worse than none */
        memset(out->emission, 0, sizeof out->emission);
        if (map->uv_set > 1) lw_foreign_import_warn(materials->import, LW_FOREIGN_WARN_UV_SET);
        return LW_OK;
    }
    if (map->base == 0 && map->gain >= 0) /* light may be above 1, a picture may not */
        for (int c = 0; c < 3; c++)
            out->emission[c] = fminf(out->emission[c] * map->gain, LW_SCENE_RADIANCE_MAX);
    else if (lw_foreign_pictures_change(&materials->pictures, map, &picture, err))
        return err->status;
    return use_picture(materials, picture, map, &out->emission_texture, err);
}

/* ---- materials ---- */

static enum lw_status convert(struct lw_foreign_materials *materials, unsigned index,
                              struct lw_foreign_converted *converted, struct lw_error *err) {
    struct lw_material *out = &converted->material;
    struct lw_foreign_look look;
    bool mirror;
    *out = (struct lw_material){.base_colour = {1, 1, 1, 1},
                                .base_colour_texture = no_texture,
                                .emission_texture = no_texture,
                                .alpha_cutoff = 0.5f};
    const enum lw_status status = lw_foreign_look_read(materials->import, index, &look, err);
    out->name = lw_foreign_import_text(materials->import, &look.name);
    if (!out->name) return lw_status_fail(err, LW_NO_MEMORY, "out of memory for materials");
    if (status || read_base(materials, &look, out, &mirror, err) ||
        read_emission(materials, &look, out, err) ||
        (!materials->import->desc->matt &&
         lw_foreign_finish_read(&materials->finish, &look, mirror, out, err))) {
        lw_status_context(err, "material \"%.80s\"", out->name);
        return err->status;
    }
    converted->stated_two_sided = look.stated_two_sided;
    converted->emits = brightest(out->emission) > 0;
    converted->is_default = look.is_default;
    converted->done = true;
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
    /* vertex colours are the colour of surfaces without a material; the default grey would darken them */
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
    lw_foreign_pictures_report(&materials->pictures);
    lw_foreign_finish_report(&materials->finish);
    lw_tally_warn(&materials->bright, path, "diffuse colours above 1 are lowered to 1");
    lw_tally_warn(&materials->invisible, path, "materials of opacity 0 are taken as opaque");
}
