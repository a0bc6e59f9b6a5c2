#include "server/import/gltf/gltf_finish.h"

#include "common/base/log.h"
#include "server/import/images/finish_texels.h"
#include "server/import/mesh/mesh_builder.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define IOR_DEFAULT 1.5f
#define F0_DEFAULT  0.04f /* f0 for IOR_DEFAULT */
#define IOR_MIRROR  1e6f  /* for 0, which KHR_materials_ior has for "f0 is 1" */
#define IOR_MAX     1e6f

struct reader {
    struct lw_gltf_finishes *finishes;
    struct lw_gltf_textures *textures;
    const char *name; /* the material's */
    struct lw_finish finish;
};

void lw_gltf_finishes_init(struct lw_gltf_finishes *finishes, struct lw_gltf_textures *textures) {
    *finishes = (struct lw_gltf_finishes){.textures = textures};
}

void lw_gltf_finishes_finish(struct lw_gltf_finishes *finishes) {
    free(finishes->made);
    *finishes = (struct lw_gltf_finishes){0};
}

/* ---- numbers ---- */

static void add_to_tally(struct lw_tally *tally, const struct reader *r, const char *key, float value) {
    char name[80];
    snprintf(name, sizeof name, "%.30s: %.24s %g", r->name, key, (double)value);
    lw_tally_add(tally, name);
}

static float within(struct reader *r, const char *key, float value, float high) {
    if (value >= 0 && value <= high) return value;
    add_to_tally(&r->finishes->out_of_range, r, key, value);
    return value < 0 ? 0 : high;
}

/* object[key], in [0, 1]. */
static enum lw_status read_share(struct reader *r, const json_t *object, const char *key, float *out,
                                 struct lw_error *err) {
    if (!lw_gltf_json_real(object, key, -HUGE_VAL, HUGE_VAL, out, err)) *out = within(r, key, *out, 1);
    return err->status;
}

static enum lw_status read_colour(struct reader *r, const json_t *object, const char *key, float high,
                                  float out[3], struct lw_error *err) {
    if (lw_gltf_json_reals(object, key, 3, -HUGE_VAL, HUGE_VAL, out, err)) return err->status;
    for (int c = 0; c < 3; c++) out[c] = within(r, key, out[c], high);
    return LW_OK;
}

static bool has(const json_t *object, const char *key) { return json_object_get(object, key) != NULL; }

/* ---- metallic-roughness ---- */

/* A texture behind factors of 0 is never seen: it is not decoded. One that cannot be read leaves no gloss. */
static enum lw_status read_metal(struct reader *r, const json_t *pbr, bool *out_lost, struct lw_error *err) {
    struct lw_finish *f = &r->finish;
    f->metalness = 1;
    if (read_share(r, pbr, "metallicFactor", &f->metalness, err) ||
        read_share(r, pbr, "roughnessFactor", &f->roughness, err))
        return err->status;
    if (f->metalness == 0 && f->roughness == 0) return LW_OK;
    return lw_gltf_textures_use_finish(r->textures, pbr, "metallicRoughnessTexture", LW_CONTENT_SURFACE,
                                       &f->surface_texture, out_lost, err);
}

/* ---- pictures that are made of others ---- */

static struct lw_gltf_made *find_made(struct lw_gltf_finishes *finishes, uint32_t a, uint32_t b,
                                      float factor) {
    for (size_t i = 0; i < finishes->made_count; i++) {
        struct lw_gltf_made *made = &finishes->made[i];
        if (made->texture[0] == a && made->texture[1] == b && made->factor == factor) return made;
    }
    return NULL;
}

static enum lw_status add_made(struct lw_gltf_finishes *finishes, const struct lw_gltf_made *made,
                               struct lw_error *err) {
    if (!lw_mesh_builder_reserve((void **)&finishes->made, &finishes->made_capacity, finishes->made_count + 1,
                                 sizeof *finishes->made))
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory for textures");
    finishes->made[finishes->made_count++] = *made;
    return LW_OK;
}

/* Texels for one texture. *out NULL: there is no room, which is reported. */
static enum lw_status make_texels(struct reader *r, uint32_t width, uint32_t height, uint8_t **out,
                                  struct lw_error *err) {
    *out = NULL;
    if (lw_gltf_textures_texels(r->textures, width, height, out, err) != LW_BAD_DATA) return err->status;
    lw_tally_add(&r->finishes->left_out, r->name);
    *err = (struct lw_error){0};
    return LW_OK;
}

/* ---- specular and index of refraction ---- */

/* KHR_materials_ior: the reflectance of n is that of 1/n. */
static enum lw_status read_ior(struct reader *r, const json_t *extension, struct lw_error *err) {
    float *ior = &r->finish.ior, said = IOR_DEFAULT;
    if (lw_gltf_json_real(extension, "ior", -HUGE_VAL, HUGE_VAL, &said, err)) {
        lw_status_context(err, "KHR_materials_ior");
        return err->status;
    }
    if (said < 1 && said != 0) add_to_tally(&r->finishes->low_ior, r, "ior", said);
    *ior = said < 0 ? IOR_DEFAULT : said == 0 ? IOR_MIRROR : fminf(said < 1 ? 1 / said : said, IOR_MAX);
    return LW_OK;
}

/* The specular textures of a material: A of `strength`, R, G, B of `colour`. */
struct pair {
    struct lw_gltf_texture_info strength, colour;
    struct lw_texture strength_texture, colour_texture; /* rgba NULL: none, or unreadable */
};

static void join_pair(const struct pair *pair, struct lw_texture *out, uint8_t *rgba) {
    const struct lw_texture *s = &pair->strength_texture, *c = &pair->colour_texture;
    const struct lw_finish_texels_join strength = {s->rgba, s->width, s->height},
                                       colour = {c->rgba, c->width, c->height};
    for (uint32_t y = 0; y < out->height; y++)
        for (uint32_t x = 0; x < out->width; x++) {
            uint8_t *to = rgba + 4 * ((size_t)y * out->width + x);
            memset(to, 255, 4);
            if (c->rgba) memcpy(to, lw_finish_texels_at(&colour, x, y, out->width, out->height), 3);
            if (s->rgba) to[3] = lw_finish_texels_at(&strength, x, y, out->width, out->height)[3];
        }
    out->rgba = rgba;
}

static bool lie_alike(const struct pair *pair) {
    return memcmp(&pair->strength.place, &pair->colour.place, sizeof pair->colour.place) == 0 &&
           pair->strength_texture.wrap_s == pair->colour_texture.wrap_s &&
           pair->strength_texture.wrap_t == pair->colour_texture.wrap_t;
}

/* One texture for both, at the larger of their sizes. */
static enum lw_status make_pair(struct reader *r, const struct pair *pair, uint32_t *out,
                                struct lw_error *err) {
    const struct lw_texture *s = &pair->strength_texture, *c = &pair->colour_texture;
    const uint32_t a = s->rgba ? pair->strength.texture : LW_SCENE_NONE,
                   b = c->rgba ? pair->colour.texture : LW_SCENE_NONE;
    const struct lw_gltf_made *known = find_made(r->finishes, a, b, 0);
    struct lw_texture texture = c->rgba ? *c : *s;
    uint8_t *rgba;
    *out = known ? known->made[0] : LW_SCENE_NONE;
    if (known) return LW_OK;
    if (s->rgba == c->rgba || (!s->rgba && lw_finish_texels_opaque(c->rgba, (size_t)c->width * c->height)))
        return lw_gltf_textures_add_finish(r->textures, &texture, out, err);
    texture.width = s->rgba && c->rgba && s->width > c->width ? s->width : texture.width;
    texture.height = s->rgba && c->rgba && s->height > c->height ? s->height : texture.height;
    if (make_texels(r, texture.width, texture.height, &rgba, err) || !rgba) return err->status;
    join_pair(pair, &texture, rgba);
    if (lw_gltf_textures_add_finish(r->textures, &texture, out, err)) return err->status;
    return add_made(r->finishes, &(struct lw_gltf_made){{a, b}, 0, {*out, LW_SCENE_NONE}}, err);
}

static enum lw_status read_pair(struct reader *r, const json_t *extension, struct lw_error *err) {
    struct pair pair = {0};
    if (lw_gltf_textures_info(r->textures, extension, "specularTexture", &pair.strength, err) ||
        lw_gltf_textures_info(r->textures, extension, "specularColorTexture", &pair.colour, err) ||
        (pair.strength.texture != LW_SCENE_NONE &&
         lw_gltf_textures_sample(r->textures, pair.strength.texture, LW_CONTENT_COLOUR,
                                 &pair.strength_texture, err)) ||
        (pair.colour.texture != LW_SCENE_NONE &&
         lw_gltf_textures_sample(r->textures, pair.colour.texture, LW_CONTENT_COLOUR, &pair.colour_texture,
                                 err)))
        return err->status;
    if (!pair.strength_texture.rgba && !pair.colour_texture.rgba) return LW_OK;
    if (pair.strength_texture.rgba && pair.colour_texture.rgba && !lie_alike(&pair))
        lw_tally_add(&r->finishes->apart, r->name);
    r->finish.specular_texture = pair.colour_texture.rgba ? pair.colour.place : pair.strength.place;
    return make_pair(r, &pair, &r->finish.specular_texture.texture, err);
}

static enum lw_status read_specular(struct reader *r, const json_t *extension, struct lw_error *err) {
    struct lw_finish *f = &r->finish;
    if (read_share(r, extension, "specularFactor", &f->specular, err) ||
        read_colour(r, extension, "specularColorFactor", LW_SCENE_RADIANCE_MAX, f->specular_colour, err) ||
        (f->specular > 0 && read_pair(r, extension, err)))
        lw_status_context(err, "KHR_materials_specular");
    return err->status;
}

/* ---- specular-glossiness ---- */

/* The picture of a material becomes two: the specular colour, and roughness as 1 - factor x A. */
static enum lw_status split_picture(struct reader *r, uint32_t index, float glossiness,
                                    struct lw_gltf_made *out, struct lw_error *err) {
    struct lw_texture colour, surface;
    uint32_t image;
    uint8_t *rgba = NULL, *roughness;
    *out = (struct lw_gltf_made){{index, LW_SCENE_NONE}, glossiness, {LW_SCENE_NONE, LW_SCENE_NONE}};
    if (lw_gltf_textures_sampler(r->textures, index, &colour, &image, err) ||
        (image != LW_SCENE_NONE && lw_gltf_textures_decode(r->textures, image, &colour, &rgba, err)) ||
        !rgba || make_texels(r, colour.width, colour.height, &roughness, err) || !roughness)
        return err->status;
    lw_finish_texels_gloss(rgba, (size_t)colour.width * colour.height, glossiness, roughness);
    surface = colour;
    surface.rgba = roughness;
    surface.content = LW_CONTENT_SURFACE;
    if (lw_gltf_textures_add_finish(r->textures, &colour, &out->made[0], err) ||
        lw_gltf_textures_add_finish(r->textures, &surface, &out->made[1], err))
        return err->status;
    return add_made(r->finishes, out, err);
}

static enum lw_status read_glossy_texture(struct reader *r, const json_t *extension, float glossiness,
                                          bool *out_lost, struct lw_error *err) {
    struct lw_finish *f = &r->finish;
    struct lw_gltf_texture_info info;
    struct lw_gltf_made made;
    if (lw_gltf_textures_info(r->textures, extension, "specularGlossinessTexture", &info, err) ||
        info.texture == LW_SCENE_NONE)
        return err->status;
    const struct lw_gltf_made *known = find_made(r->finishes, info.texture, LW_SCENE_NONE, glossiness);
    if (known)
        made = *known;
    else if (split_picture(r, info.texture, glossiness, &made, err))
        return err->status;
    *out_lost = made.made[0] == LW_SCENE_NONE;
    if (*out_lost) return LW_OK;
    f->specular_texture = f->surface_texture = info.place;
    f->specular_texture.texture = made.made[0];
    f->surface_texture.texture = made.made[1];
    f->roughness = 1;
    return LW_OK;
}

/* KHR_materials_pbrSpecularGlossiness: the specular colour is f0, the diffuse colour lies under the gloss. */
static enum lw_status read_glossy(struct reader *r, const json_t *extension, bool *out_lost,
                                  struct lw_error *err) {
    struct lw_finish *f = &r->finish;
    float specular[3] = {1, 1, 1}, glossiness = 1;
    if (read_colour(r, extension, "specularFactor", 1, specular, err) ||
        read_share(r, extension, "glossinessFactor", &glossiness, err)) {
        lw_status_context(err, "KHR_materials_pbrSpecularGlossiness");
        return err->status;
    }
    f->roughness = 1 - glossiness;
    for (int c = 0; c < 3; c++) f->specular_colour[c] = specular[c] / F0_DEFAULT;
    if (fmaxf(specular[0], fmaxf(specular[1], specular[2])) <= 0) f->specular = 0; /* it mirrors nothing */
    if (f->specular > 0 && read_glossy_texture(r, extension, glossiness, out_lost, err))
        lw_status_context(err, "KHR_materials_pbrSpecularGlossiness");
    return err->status;
}

/* ---- the whole ---- */

/* A material's statements of gloss. */
struct said {
    const json_t *pbr, *glossy, *specular, *ior;
    bool metal, gloss; /* by the core fields; by specular-glossiness */
};

static enum lw_status find_said(const json_t *object, struct said *said, struct lw_error *err) {
    *said = (struct said){0};
    if (lw_gltf_json_object(object, "pbrMetallicRoughness", &said->pbr, err) ||
        lw_gltf_json_extension(object, "KHR_materials_pbrSpecularGlossiness", &said->glossy, err) ||
        lw_gltf_json_extension(object, "KHR_materials_specular", &said->specular, err) ||
        lw_gltf_json_extension(object, "KHR_materials_ior", &said->ior, err))
        return err->status;
    const json_t *g = said->glossy;
    said->metal = has(said->pbr, "metallicFactor") || has(said->pbr, "roughnessFactor") ||
                  has(said->pbr, "metallicRoughnessTexture") || said->specular || said->ior;
    said->gloss =
        g && (has(g, "specularFactor") || has(g, "glossinessFactor") || has(g, "specularGlossinessTexture"));
    return LW_OK;
}

static bool is_matt(const struct lw_finish *f, const struct said *said) {
    const bool extended = said->glossy || said->specular || said->ior;
    return f->metalness == 0 &&
           (f->specular == 0 ||
            (f->roughness == 1 && f->surface_texture.texture == LW_SCENE_NONE && !extended));
}

static void make_matt(struct lw_finish *f) {
    f->metalness = f->specular = 0;
    f->roughness = 1;
    f->ior = IOR_DEFAULT;
    for (int c = 0; c < 3; c++) f->specular_colour[c] = 1;
    f->surface_texture.texture = f->specular_texture.texture = LW_SCENE_NONE;
}

static enum lw_status read_gloss(struct reader *r, const json_t *object, struct lw_error *err) {
    struct said said;
    bool lost = false;
    if (find_said(object, &said, err)) return err->status;
    if (said.glossy) {
        if (said.gloss && read_glossy(r, said.glossy, &lost, err)) return err->status;
    } else if (said.metal) {
        if (said.pbr && read_metal(r, said.pbr, &lost, err)) {
            lw_status_context(err, "pbrMetallicRoughness");
            return err->status;
        }
        if (!said.pbr) r->finish.metalness = 1;
        if ((said.ior && read_ior(r, said.ior, err)) ||
            (said.specular && read_specular(r, said.specular, err)))
            return err->status;
    }
    if (!said.gloss && !said.metal) lw_tally_add(&r->finishes->silent, r->name);
    if (lost || !(said.glossy ? said.gloss : said.metal) || is_matt(&r->finish, &said)) make_matt(&r->finish);
    return LW_OK;
}

static enum lw_status read_relief(struct reader *r, const json_t *object, struct lw_error *err) {
    struct lw_finish *f = &r->finish;
    const json_t *normal = NULL;
    bool lost;
    if (lw_gltf_json_object(object, "normalTexture", &normal, err)) return err->status;
    if (normal && lw_gltf_json_real(normal, "scale", -(double)LW_SCENE_RADIANCE_MAX,
                                    (double)LW_SCENE_RADIANCE_MAX, &f->normal_scale, err)) {
        lw_status_context(err, "normalTexture");
        return err->status;
    }
    if (f->normal_scale == 0) return LW_OK;
    return lw_gltf_textures_use_finish(r->textures, object, "normalTexture", LW_CONTENT_NORMAL,
                                       &f->normal_texture, &lost, err);
}

static bool is_even(const struct lw_finish *f) {
    return f->metalness == 0 && f->specular == 0 && f->normal_texture.texture == LW_SCENE_NONE;
}

enum lw_status lw_gltf_finishes_read(struct lw_gltf_finishes *finishes, const json_t *object,
                                     struct lw_material *material, struct lw_error *err) {
    static const struct lw_texture_use none = {LW_SCENE_NONE, 0, {1, 0, 0, 0, 1, 0}};
    struct reader r = {.finishes = finishes,
                       .textures = finishes->textures,
                       .name = material->name,
                       .finish = {.roughness = 1,
                                  .specular = 1,
                                  .specular_colour = {1, 1, 1},
                                  .ior = IOR_DEFAULT,
                                  .normal_scale = 1,
                                  .surface_texture = none,
                                  .specular_texture = none,
                                  .occlusion_texture = none,
                                  .normal_texture = none}};
    if (read_gloss(&r, object, err) || read_relief(&r, object, err)) return err->status;
    if (is_even(&r.finish)) return LW_OK;
    struct lw_finish *own = lw_scene_alloc(finishes->textures->scene, 1, sizeof *own);
    if (!own) return lw_status_fail(err, LW_NO_MEMORY, "out of memory for materials");
    *own = r.finish;
    material->finish = own;
    return LW_OK;
}

void lw_gltf_finishes_report(const struct lw_gltf_finishes *finishes) {
    const struct lw_tally *silent = &finishes->silent;
    const char *file = finishes->textures->document->name;
    if (silent->count)
        lw_log(LW_LOG_INFO,
               "%s: materials that say nothing of metal or roughness are matt, not the metal of glTF's "
               "defaults: %llu, \"%s\" for one",
               file, (unsigned long long)silent->count, silent->first);
    lw_tally_warn(&finishes->out_of_range, file, "values of gloss are taken to the end of their range");
    lw_tally_warn(&finishes->low_ior, file,
                  "indices of refraction below 1 are taken as 1 by them, negative ones as 1.5");
    lw_tally_warn(&finishes->left_out, file,
                  "gloss is left out where its picture is one too many; --picture-texels allows more");
    lw_tally_warn(&finishes->apart, file,
                  "a specular texture lies otherwise than the specular colour: it is read as that lies");
}
