#include "server/import/gltf/gltf_material.h"

#include "server/import/images/image_file.h"
#include "server/import/mirror.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define FINISH_TEXTURES 4 /* one material's at most */

enum lw_status lw_gltf_materials_init(struct lw_gltf_materials *materials, struct lw_gltf_document *document,
                                      struct lw_scene *scene, bool matt, struct lw_error *err) {
    const uint32_t count = document->count[LW_GLTF_MATERIALS];
    *materials = (struct lw_gltf_materials){.document = document, .scene = scene, .matt = matt};
    if (count >= LW_SCENE_MATERIALS_MAX)
        return lw_status_fail(err, LW_BAD_DATA, "has %u materials; the limit is %u", count,
                              LW_SCENE_MATERIALS_MAX - 1);
    if (lw_gltf_textures_init(&materials->textures, document, scene, FINISH_TEXTURES * (uint64_t)count, err))
        return err->status;
    lw_gltf_finishes_init(&materials->finishes, &materials->textures);
    materials->material_of = malloc((count + 1ul) * sizeof *materials->material_of);
    scene->material = lw_scene_alloc(scene, count + 1ul, sizeof *scene->material);
    if (!materials->material_of || !scene->material)
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory for materials");
    for (uint32_t i = 0; i <= count; i++) materials->material_of[i] = LW_SCENE_NONE;
    return LW_OK;
}

void lw_gltf_materials_finish(struct lw_gltf_materials *materials) {
    lw_gltf_finishes_finish(&materials->finishes);
    lw_gltf_textures_finish(&materials->textures);
    free(materials->material_of);
    *materials = (struct lw_gltf_materials){0};
}

/* ---- materials ---- */

/* Where all is matt, a black diffuse colour under a bright specular one of
 * KHR_materials_pbrSpecularGlossiness is a metal, by the rule as in MTL: it reflects its specular colour. */
static enum lw_status read_specular(const json_t *extension, struct lw_material *out, struct lw_error *err) {
    float specular[3] = {0, 0, 0};
    if (lw_gltf_json_reals(extension, "specularFactor", 3, 0, HUGE_VAL, specular, err)) return err->status;
    if (!json_object_get(extension, "diffuseTexture") && lw_mirror_is(out->base_colour, specular))
        memcpy(out->base_colour, specular, sizeof specular);
    return LW_OK;
}

static enum lw_status read_base_colour(struct lw_gltf_materials *materials, const json_t *object,
                                       struct lw_material *out, bool *out_bright, struct lw_error *err) {
    const json_t *pbr = NULL, *glossy = NULL;
    bool unreadable;
    if (lw_gltf_json_object(object, "pbrMetallicRoughness", &pbr, err) ||
        lw_gltf_json_extension(object, "KHR_materials_pbrSpecularGlossiness", &glossy, err))
        return err->status;
    if (glossy) pbr = glossy;
    if (!pbr) return LW_OK;
    const char *factor = glossy ? "diffuseFactor" : "baseColorFactor";
    const char *texture = glossy ? "diffuseTexture" : "baseColorTexture";
    if (lw_gltf_json_reals(pbr, factor, 4, 0, HUGE_VAL, out->base_colour, err) ||
        lw_gltf_textures_use(&materials->textures, pbr, texture, &out->base_colour_texture, &unreadable,
                             err) ||
        (glossy && materials->matt && read_specular(glossy, out, err))) {
        lw_status_context(err, glossy ? "KHR_materials_pbrSpecularGlossiness" : "pbrMetallicRoughness");
        return err->status;
    }
    for (int c = 0; c < 4; c++) {
        if (out->base_colour[c] <= 1) continue;
        out->base_colour[c] = 1; /* a surface that reflects more than it receives would never converge */
        *out_bright = true;
    }
    for (int c = 0; unreadable && c < 3; c++) out->base_colour[c] *= LW_IMAGE_FILE_STAND_IN_ALBEDO;
    return LW_OK;
}

static enum lw_status read_emission(struct lw_gltf_materials *materials, const json_t *object,
                                    struct lw_material *out, struct lw_error *err) {
    const json_t *extension = NULL;
    float strength = 1;
    bool unreadable;
    if (lw_gltf_json_reals(object, "emissiveFactor", 3, 0, HUGE_VAL, out->emission, err) ||
        lw_gltf_json_extension(object, "KHR_materials_emissive_strength", &extension, err) ||
        (extension && lw_gltf_json_real(extension, "emissiveStrength", 0, HUGE_VAL, &strength, err)))
        return err->status;
    for (int c = 0; c < 3; c++) {
        out->emission[c] *= strength;
        if (!isfinite(out->emission[c]))
            return lw_status_fail(err, LW_BAD_DATA, "emissiveFactor: is too large");
    }
    /* an emission texture behind a zero factor is never seen: do not decode it */
    if (out->emission[0] + out->emission[1] + out->emission[2] <= 0) return LW_OK;
    if (lw_gltf_textures_use(&materials->textures, object, "emissiveTexture", &out->emission_texture,
                             &unreadable, err))
        return err->status;
    /* most of such a texture is black: all of it alight would be worse than none */
    if (unreadable) memset(out->emission, 0, sizeof out->emission);
    return LW_OK;
}

static enum lw_status read_alpha(const json_t *object, struct lw_material *out, struct lw_error *err) {
    const char *mode = "OPAQUE";
    bool double_sided = false;
    if (lw_gltf_json_string(object, "alphaMode", &mode, err) ||
        lw_gltf_json_real(object, "alphaCutoff", 0, HUGE_VAL, &out->alpha_cutoff, err) ||
        lw_gltf_json_flag(object, "doubleSided", &double_sided, err))
        return err->status;
    out->double_sided = double_sided;
    if (strcmp(mode, "OPAQUE") == 0)
        out->alpha_mode = LW_ALPHA_OPAQUE;
    else if (strcmp(mode, "MASK") == 0)
        out->alpha_mode = LW_ALPHA_MASK;
    else if (strcmp(mode, "BLEND") == 0)
        out->alpha_mode = LW_ALPHA_BLEND;
    else
        return lw_status_fail(err, LW_BAD_DATA, "alphaMode: must be OPAQUE, MASK or BLEND");
    return LW_OK;
}

/* KHR_materials_transmission on a thin surface: of light, the factor t times the base colour c passes, and (1
 * - t) c is reflected. 1 - alpha = t L(c), with L the luminance, and the albedo is what alpha times it must
 * be, (1 - t) c. The tint c / L(c) makes the colour of what passes, where it is known: t L(c) c / L(c) = t c.
 * A base colour texture counts as the reflection's alone. */
static enum lw_status read_transmission(struct lw_gltf_materials *materials, const json_t *object,
                                        struct lw_material *out, struct lw_error *err) {
    const json_t *extension = NULL;
    float t = 0;
    if (lw_gltf_json_extension(object, "KHR_materials_transmission", &extension, err)) return err->status;
    if (extension && lw_gltf_json_real(extension, "transmissionFactor", 0, 1, &t, err))
        lw_status_context(err, "KHR_materials_transmission");
    if (err->status || !(t > 0) || out->unlit || out->alpha_mode == LW_ALPHA_MASK) return err->status;
    if (json_object_get(extension, "transmissionTexture")) {
        lw_gltf_document_warn(materials->document, LW_GLTF_WARN_TRANSMISSION);
        return LW_OK;
    }
    if (out->alpha_mode == LW_ALPHA_OPAQUE) out->base_colour[3] = 1;
    const float *c = out->base_colour;
    const float luminance = 0.2126f * c[0] + 0.7152f * c[1] + 0.0722f * c[2], alpha = 1 - t * luminance;
    const bool coloured = luminance > 1e-6f && (c[0] != c[1] || c[1] != c[2]); /* less of it is black */
    for (int k = 0; coloured && k < 3; k++) out->tint[k] = c[k] / luminance;
    if (coloured) lw_gltf_document_warn(materials->document, LW_GLTF_WARN_TINT);
    for (int k = 0; k < 3; k++)
        out->base_colour[k] = alpha > 0 ? fminf((1 - t) * out->base_colour[k] / alpha, 1) : 0;
    out->base_colour[3] *= alpha;
    out->alpha_mode = LW_ALPHA_BLEND;
    return LW_OK;
}

/* KHR_materials_unlit: the base colour is seen as it is; what else the material says is for readers that do
 * not know the extension. */
static enum lw_status read_unlit(const json_t *object, struct lw_material *out, struct lw_error *err) {
    const json_t *extension = NULL;
    if (lw_gltf_json_extension(object, "KHR_materials_unlit", &extension, err)) return err->status;
    out->unlit = extension != NULL;
    if (!out->unlit) return LW_OK;
    memset(out->emission, 0, sizeof out->emission);
    out->emission_texture.texture = LW_SCENE_NONE;
    return LW_OK;
}

static enum lw_status convert_material(struct lw_gltf_materials *materials, const json_t *object,
                                       struct lw_material *out, bool *out_bright, struct lw_error *err) {
    static const struct lw_texture_use no_texture = {.texture = LW_SCENE_NONE,
                                                     .transform = {1, 0, 0, 0, 1, 0}};
    const char *name = "";
    *out = (struct lw_material){.base_colour = {1, 1, 1, 1},
                                .base_colour_texture = no_texture,
                                .emission_texture = no_texture,
                                .alpha_cutoff = 0.5f};
    if (object) {
        if (lw_gltf_json_string(object, "name", &name, err) ||
            read_base_colour(materials, object, out, out_bright, err) ||
            read_emission(materials, object, out, err) || read_alpha(object, out, err) ||
            read_unlit(object, out, err) || read_transmission(materials, object, out, err) ||
            lw_gltf_json_drawn_by(object, &out->drawn_by, err))
            return err->status;
    }
    out->name = lw_scene_string(materials->scene, object ? name : "default");
    if (!out->name) return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    if (!object || materials->matt || out->unlit) return LW_OK;
    return lw_gltf_finishes_read(&materials->finishes, object, out, err);
}

enum lw_status lw_gltf_materials_get(struct lw_gltf_materials *materials, uint32_t index,
                                     uint32_t *out_material, struct lw_error *err) {
    uint32_t default_slot = materials->document->count[LW_GLTF_MATERIALS];
    uint32_t *slot = &materials->material_of[index == LW_SCENE_NONE ? default_slot : index];
    if (*slot == LW_SCENE_NONE) {
        const json_t *object = index == LW_SCENE_NONE
                                   ? NULL
                                   : lw_gltf_document_item(materials->document, LW_GLTF_MATERIALS, index);
        struct lw_material *material = &materials->scene->material[materials->scene->material_count];
        bool bright = false;
        if (convert_material(materials, object, material, &bright, err)) {
            lw_status_context(err, "materials[%u]", index);
            return err->status;
        }
        if (bright) {
            char name[160];
            snprintf(name, sizeof name, "materials[%u] %s", index, material->name);
            lw_tally_add(&materials->bright, name);
        }
        *slot = materials->scene->material_count++;
    }
    *out_material = *slot;
    return LW_OK;
}
