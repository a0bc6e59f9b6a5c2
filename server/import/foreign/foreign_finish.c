#include "server/import/foreign/foreign_finish.h"

#include "server/import/images/finish_texels.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Where more of a normal map is no normals, one line says so. */
#define ODD_SHARE 0.01

struct reader {
    struct lw_foreign_finish *of;
    struct lw_foreign_pictures *pictures;
    const struct lw_foreign_look *look;
    const char *name;
    struct lw_finish finish;
};

size_t lw_foreign_finish_textures_max(size_t materials) {
    const size_t most = 2 * materials; /* surface, normals */
    return most < LW_SCENE_TEXTURES_MAX ? most : LW_SCENE_TEXTURES_MAX;
}

bool lw_foreign_finish_is_said(const struct lw_foreign_look *look) {
    return look->has_metalness || look->has_roughness || look->metalness_map.there ||
           look->roughness_map.there;
}

/* ---- textures ---- */

static enum lw_status no_memory(struct lw_error *err) {
    return lw_status_fail(err, LW_NO_MEMORY, "out of memory for textures");
}

/* A made picture as a texture of finishes. */
static enum lw_status use(struct reader *r, uint32_t picture, const struct lw_foreign_map *map,
                          enum lw_content content, struct lw_texture_use *out, struct lw_error *err) {
    struct lw_scene *scene = r->pictures->import->scene;
    struct aiString name = {0};
    uint32_t t = 0;
    if (picture == LW_SCENE_NONE) return LW_OK;
    const struct lw_foreign_picture *from = &r->pictures->picture[picture];
    for (; t < scene->finish_texture_count; t++) {
        const struct lw_texture *other = &scene->finish_texture[t];
        if (other->rgba == from->rgba && other->wrap_s == map->wrap_s && other->wrap_t == map->wrap_t) break;
    }
    if (t == LW_SCENE_TEXTURES_MAX)
        return lw_status_fail(err, LW_BAD_DATA, "one too many: the limit is %u textures of gloss and relief",
                              LW_SCENE_TEXTURES_MAX);
    if (t == scene->finish_texture_count) {
        snprintf(name.data, sizeof name.data, "%s", lw_foreign_pictures_base_name(map->path.data));
        const char *text = lw_foreign_import_text(r->pictures->import, &name);
        if (!text) return no_memory(err);
        scene->finish_texture[scene->finish_texture_count++] = (struct lw_texture){.name = text,
                                                                                   .width = from->width,
                                                                                   .height = from->height,
                                                                                   .rgba = from->rgba,
                                                                                   .wrap_s = map->wrap_s,
                                                                                   .wrap_t = map->wrap_t,
                                                                                   .content = content};
    }
    out->texture = t;
    out->uv_set = map->uv_set;
    memcpy(out->transform, map->transform, sizeof out->transform);
    return LW_OK;
}

/* *out: LW_SCENE_NONE: there is none. *out_lost: there should be. */
static enum lw_status find(struct reader *r, const struct lw_foreign_map *map, uint32_t *out, bool *out_lost,
                           struct lw_error *err) {
    *out = LW_SCENE_NONE;
    if (!map->there) return LW_OK;
    if (lw_foreign_pictures_get(r->pictures, map, out, err)) return err->status;
    const bool far = map->uv_set > 1;
    if (far) lw_foreign_import_warn(r->pictures->import, LW_FOREIGN_WARN_UV_SET);
    if (!far && !r->pictures->picture[*out].unreadable) return LW_OK;
    *out = LW_SCENE_NONE;
    *out_lost = true;
    return LW_OK;
}

/* The picture that is made under a key, of that size. *out_rgba NULL: it was there. *out LW_SCENE_NONE: there
 * is no room for it, which is reported. */
static enum lw_status make(struct reader *r, const char *key, uint32_t width, uint32_t height, uint32_t *out,
                           uint8_t **out_rgba, struct lw_error *err) {
    struct lw_foreign_picture *made = lw_foreign_pictures_find(r->pictures, key);
    *out_rgba = NULL;
    if (!made) {
        if (lw_foreign_pictures_add(r->pictures, key, &made, err)) return err->status;
        made->width = width;
        made->height = height;
        if (lw_foreign_pictures_texels(r->pictures, made, out_rgba, err) == LW_NO_MEMORY) return err->status;
        made->unreadable = err->status != LW_OK;
        if (made->unreadable) lw_tally_add(&r->of->left_out, r->name);
        *err = (struct lw_error){0};
    }
    *out = made->unreadable ? LW_SCENE_NONE : (uint32_t)(made - r->pictures->picture);
    return LW_OK;
}

/* ---- metalness and roughness ---- */

static float within(struct reader *r, float value) {
    if (value >= 0 && value <= 1) return value;
    lw_tally_add(&r->of->out_of_range, r->name);
    return value > 1 ? 1 : 0;
}

/* The channel of a map: the file's, or that of glTF where one picture has both, or R. */
static char channel_of(const struct lw_foreign_map *map, bool both, char of_gltf) {
    return map->channel ? map->channel : both ? of_gltf : 'r';
}

static uint8_t value_of(const uint8_t *texel, const struct lw_foreign_map *map, char channel) {
    const float value = channel == 'g'   ? texel[1]
                        : channel == 'b' ? texel[2]
                        : channel == 'm' ? texel[3]
                        : channel == 'l' ? (float)(texel[0] + texel[1] + texel[2]) / 3
                                         : texel[0];
    return (uint8_t)(fminf(fmaxf(255 * map->base + map->gain * value, 0), 255) + 0.5f);
}

/* One picture of the two, at the larger of their sizes. */
static enum lw_status join_gloss(struct reader *r, uint32_t roughness, uint32_t metalness, uint32_t *out,
                                 struct lw_error *err) {
    const struct lw_foreign_map *rough_map = &r->look->roughness_map, *metal_map = &r->look->metalness_map;
    const struct lw_foreign_picture *all = r->pictures->picture;
    const bool rough = roughness != LW_SCENE_NONE, metal = metalness != LW_SCENE_NONE;
    const char rough_channel = channel_of(rough_map, roughness == metalness, 'g'),
               metal_channel = channel_of(metal_map, roughness == metalness, 'b');
    struct lw_finish_texels_join a = {0}, b = {0};
    if (rough)
        a = (struct lw_finish_texels_join){all[roughness].rgba, all[roughness].width, all[roughness].height};
    if (metal)
        b = (struct lw_finish_texels_join){all[metalness].rgba, all[metalness].width, all[metalness].height};
    const uint32_t width = a.width > b.width ? a.width : b.width,
                   height = a.height > b.height ? a.height : b.height;
    char *key = NULL;
    uint8_t *rgba;
    if (asprintf(&key, "surface\n%s\n%s\n%c %.9g %.9g %c %.9g %.9g", rough ? all[roughness].key : "",
                 metal ? all[metalness].key : "", rough_channel, (double)rough_map->base,
                 (double)rough_map->gain, metal_channel, (double)metal_map->base,
                 (double)metal_map->gain) < 0)
        return no_memory(err);
    (void)make(r, key, width, height, out, &rgba, err);
    free(key);
    for (uint32_t y = 0; !err->status && rgba && y < height; y++)
        for (uint32_t x = 0; x < width; x++) {
            uint8_t *to = rgba + 4 * ((size_t)y * width + x);
            memset(to, 255, 4);
            if (rough)
                to[1] = value_of(lw_finish_texels_at(&a, x, y, width, height), rough_map, rough_channel);
            if (metal)
                to[2] = value_of(lw_finish_texels_at(&b, x, y, width, height), metal_map, metal_channel);
        }
    return err->status;
}

/* A factor that is left out, or 0, was never meant to hide the map. */
static float beside_map(float value, bool said, bool map, float otherwise) {
    return map && !(said && value > 0) ? 1 : said ? value : otherwise;
}

static enum lw_status read_gloss(struct reader *r, struct lw_error *err) {
    const struct lw_foreign_look *look = r->look;
    const struct lw_foreign_map *rough_map = &look->roughness_map, *metal_map = &look->metalness_map;
    struct lw_finish *f = &r->finish;
    uint32_t rough, metal, both;
    bool lost = false;
    if (find(r, rough_map, &rough, &lost, err) || find(r, metal_map, &metal, &lost, err)) return err->status;
    if (lost) return LW_OK; /* matt */
    f->roughness = within(r, beside_map(look->roughness, look->has_roughness, rough_map->there, 1));
    f->metalness = within(r, beside_map(look->metalness, look->has_metalness, metal_map->there, 0));
    const bool mapped = rough != LW_SCENE_NONE || metal != LW_SCENE_NONE;
    f->specular = mapped || f->metalness > 0 || f->roughness < 1;
    if (!mapped) return LW_OK;
    if (rough_map->there && metal_map->there &&
        memcmp(rough_map->transform, metal_map->transform, sizeof metal_map->transform) != 0)
        lw_foreign_import_warn(r->pictures->import, LW_FOREIGN_WARN_GLOSS_TRANSFORM);
    if (join_gloss(r, rough, metal, &both, err)) return err->status;
    return use(r, both, rough_map->there ? rough_map : metal_map, LW_CONTENT_SURFACE, &f->surface_texture,
               err);
}

/* A mirror's highlight is as wide as Phong's: alpha^2 = 2 / (exponent + 2); GGX's alpha is roughness^2. */
static void read_mirror(struct reader *r) {
    const float exponent = r->look->exponent;
    r->finish.metalness = r->finish.specular = 1;
    r->finish.roughness = exponent >= 0 ? sqrtf(sqrtf(2 / (exponent + 2))) : 0;
}

/* ---- relief ---- */

/* The normals of a picture, in its own memory if nothing else is made of it. */
static enum lw_status make_normals(struct reader *r, uint32_t from, uint32_t *out, struct lw_error *err) {
    struct lw_foreign_picture *picture = &r->pictures->picture[from];
    const size_t texels = (size_t)picture->width * picture->height;
    char *key = NULL;
    uint8_t *rgba;
    if (asprintf(&key, "normals\n%s", picture->key) < 0) return no_memory(err);
    if (!make(r, key, picture->width, picture->height, out, &rgba, err) && rgba) {
        memcpy(rgba, r->pictures->picture[from].rgba, 4 * texels);
        if ((double)lw_finish_texels_normal(rgba, texels) > ODD_SHARE * (double)texels)
            lw_tally_add(&r->of->odd_normals, r->look->relief_map.path.data);
    }
    free(key);
    return err->status;
}

static enum lw_status make_heights(struct reader *r, uint32_t from, uint32_t *out, struct lw_error *err) {
    const struct lw_foreign_map *map = &r->look->relief_map;
    const struct lw_foreign_picture *picture = &r->pictures->picture[from];
    const struct lw_texture texture = {
        .width = picture->width, .height = picture->height, .wrap_s = map->wrap_s, .wrap_t = map->wrap_t};
    char *key = NULL;
    uint8_t *rgba;
    if (asprintf(&key, "heights\n%s\n%u %u", picture->key, map->wrap_s, map->wrap_t) < 0)
        return no_memory(err);
    if (!make(r, key, texture.width, texture.height, out, &rgba, err) && rgba)
        lw_finish_texels_height(r->pictures->picture[from].rgba, &texture, rgba);
    free(key);
    return err->status;
}

static enum lw_status read_relief(struct reader *r, struct lw_error *err) {
    const struct lw_foreign_look *look = r->look;
    uint32_t from, made;
    bool lost;
    const float scale = look->relief;
    if (scale == 0 || !(fabsf(scale) <= LW_SCENE_RADIANCE_MAX)) return LW_OK;
    if (find(r, &look->relief_map, &from, &lost, err) || from == LW_SCENE_NONE) return err->status;
    const struct lw_foreign_picture *picture = &r->pictures->picture[from];
    const bool normals = look->is_normal || lw_finish_texels_are_normals(
                                                picture->rgba, (size_t)picture->width * picture->height);
    if (normals ? make_normals(r, from, &made, err) : make_heights(r, from, &made, err)) return err->status;
    r->finish.normal_scale = scale;
    return use(r, made, &look->relief_map, LW_CONTENT_NORMAL, &r->finish.normal_texture, err);
}

/* ---- the whole ---- */

enum lw_status lw_foreign_finish_read(struct lw_foreign_finish *finish, const struct lw_foreign_look *look,
                                      bool mirror, struct lw_material *material, struct lw_error *err) {
    static const struct lw_texture_use none = {LW_SCENE_NONE, 0, {1, 0, 0, 0, 1, 0}};
    struct reader r = {.of = finish,
                       .pictures = finish->pictures,
                       .look = look,
                       .name = material->name,
                       .finish = {.roughness = 1,
                                  .specular_colour = {1, 1, 1},
                                  .ior = 1.5f,
                                  .normal_scale = 1,
                                  .surface_texture = none,
                                  .specular_texture = none,
                                  .occlusion_texture = none,
                                  .normal_texture = none}};
    if (mirror)
        read_mirror(&r);
    else if (lw_foreign_finish_is_said(look) && read_gloss(&r, err))
        return err->status;
    if (read_relief(&r, err)) return err->status;
    if (r.finish.metalness == 0 && r.finish.specular == 0 && r.finish.normal_texture.texture == LW_SCENE_NONE)
        return LW_OK;
    struct lw_finish *own = lw_scene_alloc(finish->pictures->import->scene, 1, sizeof *own);
    if (!own) return no_memory(err);
    *own = r.finish;
    material->finish = own;
    return LW_OK;
}

void lw_foreign_finish_report(const struct lw_foreign_finish *finish) {
    const char *path = finish->pictures->import->desc->path;
    lw_tally_warn(&finish->out_of_range, path, "metalness or roughness is taken to the end of its range");
    lw_tally_warn(
        &finish->left_out, path,
        "gloss or relief is left out where its picture is one too many; --picture-texels allows more");
    lw_tally_warn(&finish->odd_normals, path,
                  "normal maps have texels of no length, or that point into the surface: those are even, or "
                  "follow from x and y");
}
