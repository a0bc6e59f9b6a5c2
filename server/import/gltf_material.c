#include "server/import/gltf_material.h"

#include "common/log.h"
#include "server/import/image_file.h"
#include "server/import/mirror.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum lw_status lw_gltf_materials_init(struct lw_gltf_materials *materials, struct lw_gltf_document *document,
                                      struct lw_scene *scene, struct lw_error *err) {
    uint32_t material_count = document->count[LW_GLTF_MATERIALS],
             texture_count = document->count[LW_GLTF_TEXTURES];
    *materials = (struct lw_gltf_materials){.document = document, .scene = scene};
    if (material_count >= LW_SCENE_MATERIALS_MAX)
        return lw_status_fail(err, LW_BAD_DATA, "has %u materials; the limit is %u", material_count,
                              LW_SCENE_MATERIALS_MAX - 1);
    if (texture_count > LW_SCENE_TEXTURES_MAX)
        return lw_status_fail(err, LW_BAD_DATA, "has %u textures; the limit is %u", texture_count,
                              LW_SCENE_TEXTURES_MAX);
    materials->material_of = malloc((material_count + 1ul) * sizeof *materials->material_of);
    materials->texture_of = malloc((texture_count + 1ul) * sizeof *materials->texture_of);
    materials->image = calloc(document->count[LW_GLTF_IMAGES] + 1ul, sizeof *materials->image);
    scene->material = lw_scene_alloc(scene, material_count + 1ul, sizeof *scene->material);
    scene->texture = lw_scene_alloc(scene, texture_count + 1ul, sizeof *scene->texture);
    if (!materials->material_of || !materials->texture_of || !materials->image || !scene->material ||
        !scene->texture)
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory for materials");
    for (uint32_t i = 0; i <= material_count; i++) materials->material_of[i] = LW_SCENE_NONE;
    for (uint32_t i = 0; i <= texture_count; i++) materials->texture_of[i] = LW_SCENE_NONE;
    return LW_OK;
}

void lw_gltf_materials_finish(struct lw_gltf_materials *materials) {
    free(materials->image);
    free(materials->texture_of);
    free(materials->material_of);
    *materials = (struct lw_gltf_materials){0};
}

/* ---- images ---- */

static enum lw_status decode_image(struct lw_gltf_materials *materials, struct lw_gltf_bytes bytes,
                                   struct lw_gltf_image_slot *slot, struct lw_error *err) {
    if (lw_image_file_size(bytes.data, bytes.size, &slot->width, &slot->height, err)) return err->status;
    if (lw_image_file_count(&materials->document->pictures, slot->width, slot->height, err))
        return err->status;
    uint8_t *rgba = lw_scene_alloc(materials->scene, (size_t)slot->width * slot->height, 4);
    if (!rgba)
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory for %u x %u texels", slot->width,
                              slot->height);
    if (lw_image_file_decode(bytes.data, bytes.size, slot->width, slot->height, rgba, err))
        return err->status;
    slot->rgba = rgba;
    return LW_OK;
}

/* A picture that is not there, is none or lies outside of the scene's folder spoils one material, not the
 * scene: it is told and something stands in. Wrong JSON is an error of the document. */
static enum lw_status give_up_image(struct lw_gltf_materials *materials, uint32_t index,
                                    struct lw_error *err) {
    if (err->status != LW_BAD_DATA && err->status != LW_NO_INPUT) return err->status;
    lw_log(LW_LOG_WARNING,
           "%s: images[%u]: %s; a colour stands in (half the base colour factor, no emission)",
           materials->document->name, index, err->text);
    materials->image[index].unreadable = true;
    *err = (struct lw_error){0};
    return LW_OK;
}

static enum lw_status load_image(struct lw_gltf_materials *materials, uint32_t index, struct lw_error *err) {
    const struct lw_gltf_document *document = materials->document;
    struct lw_gltf_image_slot *slot = &materials->image[index];
    const json_t *object = lw_gltf_document_item(document, LW_GLTF_IMAGES, index);
    const char *uri = NULL;
    uint32_t view = LW_SCENE_NONE;
    if (slot->rgba || slot->unreadable) return LW_OK;
    if (lw_gltf_json_string(object, "uri", &uri, err) ||
        lw_gltf_document_index(document, object, "bufferView", LW_GLTF_BUFFER_VIEWS, &view, err))
        return err->status;
    if ((uri == NULL) == (view == LW_SCENE_NONE))
        return lw_status_fail(err, LW_BAD_DATA, "must have either uri or bufferView");
    if (!uri)
        return decode_image(materials, document->view[view].bytes, slot, err)
                   ? give_up_image(materials, index, err)
                   : LW_OK;

    uint8_t *storage;
    size_t size;
    if (lw_gltf_document_fetch(document, uri, 0, LW_IMAGE_FILE_SIZE_MAX, true, &storage, &size, err))
        return give_up_image(materials, index, err);
    if (decode_image(materials, (struct lw_gltf_bytes){storage, size}, slot, err))
        lw_status_context(err, "uri \"%.*s\"", strncasecmp(uri, "data:", 5) == 0 ? 40 : 200, uri);
    free(storage);
    return err->status ? give_up_image(materials, index, err) : LW_OK;
}

enum lw_status lw_gltf_materials_image(struct lw_gltf_materials *materials, uint32_t index,
                                       const struct lw_gltf_image_slot **out, struct lw_error *err) {
    *out = &materials->image[index];
    if (load_image(materials, index, err)) lw_status_context(err, "images[%u]", index);
    return err->status;
}

/* ---- textures ---- */

static enum lw_status read_wrap(const json_t *sampler, const char *key, uint8_t *out, struct lw_error *err) {
    uint64_t mode = 10497;
    if (sampler && lw_gltf_json_integer(sampler, key, 0, UINT32_MAX, &mode, err)) return err->status;
    switch (mode) {
    case 10497:
        *out = LW_WRAP_REPEAT;
        return LW_OK;
    case 33071:
        *out = LW_WRAP_CLAMP;
        return LW_OK;
    case 33648:
        *out = LW_WRAP_MIRROR;
        return LW_OK;
    default:
        return lw_status_fail(err, LW_BAD_DATA, "%s: must be 10497, 33071 or 33648", key);
    }
}

/* Textures that differ only in what we do not use (filters, names) become one. */
static uint32_t find_texture(const struct lw_scene *scene, const struct lw_texture *texture) {
    for (uint32_t i = 0; i < scene->texture_count; i++) {
        const struct lw_texture *other = &scene->texture[i];
        if (other->rgba == texture->rgba && other->wrap_s == texture->wrap_s &&
            other->wrap_t == texture->wrap_t)
            return i;
    }
    return LW_SCENE_NONE;
}

/* The image of a texture; *out stays LW_SCENE_NONE if it has none that can be read. */
static enum lw_status find_image(const struct lw_gltf_document *document, const json_t *texture,
                                 uint32_t *out, struct lw_error *err) {
    static const char *const extensions[] = {"EXT_texture_avif", "EXT_texture_webp"};
    for (size_t i = 0; i < sizeof extensions / sizeof *extensions; i++) {
        const json_t *extension = NULL;
        if (lw_gltf_json_extension(texture, extensions[i], &extension, err) ||
            (extension && lw_gltf_document_index(document, extension, "source", LW_GLTF_IMAGES, out, err))) {
            lw_status_context(err, "%s", extensions[i]);
            return err->status;
        }
        if (*out != LW_SCENE_NONE) return LW_OK;
    }
    return lw_gltf_document_index(document, texture, "source", LW_GLTF_IMAGES, out, err);
}

/* *out stays LW_SCENE_NONE if the picture is unreadable. */
static enum lw_status convert_texture(struct lw_gltf_materials *materials, uint32_t index, uint32_t *out,
                                      struct lw_error *err) {
    const struct lw_gltf_document *document = materials->document;
    const json_t *object = lw_gltf_document_item(document, LW_GLTF_TEXTURES, index);
    uint32_t image = LW_SCENE_NONE, sampler = LW_SCENE_NONE;
    if (find_image(document, object, &image, err) ||
        lw_gltf_document_index(document, object, "sampler", LW_GLTF_SAMPLERS, &sampler, err))
        return err->status;
    if (image == LW_SCENE_NONE) { /* it names one in an extension that is not read */
        char name[32];
        snprintf(name, sizeof name, "textures[%u]", index);
        lw_tally_add(&materials->without_image, name);
        return LW_OK;
    }
    struct lw_texture texture = {0};
    const json_t *sampler_object =
        sampler == LW_SCENE_NONE ? NULL : lw_gltf_document_item(document, LW_GLTF_SAMPLERS, sampler);
    if (read_wrap(sampler_object, "wrapS", &texture.wrap_s, err) ||
        read_wrap(sampler_object, "wrapT", &texture.wrap_t, err)) {
        lw_status_context(err, "samplers[%u]", sampler);
        return err->status;
    }
    if (load_image(materials, image, err)) {
        lw_status_context(err, "images[%u]", image);
        return err->status;
    }
    if (materials->image[image].unreadable) return LW_OK;
    const char *name = "";
    const json_t *image_object = lw_gltf_document_item(document, LW_GLTF_IMAGES, image);
    if (lw_gltf_json_string(object, "name", &name, err)) return err->status;
    if (!*name && lw_gltf_json_string(image_object, "name", &name, err)) return err->status;
    texture.width = materials->image[image].width;
    texture.height = materials->image[image].height;
    texture.rgba = materials->image[image].rgba;
    *out = find_texture(materials->scene, &texture);
    if (*out != LW_SCENE_NONE) return LW_OK;
    texture.name = lw_scene_string(materials->scene, name);
    if (!texture.name) return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    *out = materials->scene->texture_count++;
    materials->scene->texture[*out] = texture;
    return LW_OK;
}

/* KHR_texture_transform: scale, then a rotation of the coordinates counter-clockwise as seen (v points down),
 * then the offset: u' = c su + s sv + ou, v' = -s su + c sv + ov. */
static enum lw_status read_transform(const json_t *info, float transform[6], uint64_t *uv_set,
                                     struct lw_error *err) {
    const json_t *extension = NULL;
    float offset[2] = {0, 0}, scale[2] = {1, 1}, rotation = 0;
    if (lw_gltf_json_extension(info, "KHR_texture_transform", &extension, err)) return err->status;
    if (!extension) return LW_OK;
    if (lw_gltf_json_reals(extension, "offset", 2, -HUGE_VAL, HUGE_VAL, offset, err) ||
        lw_gltf_json_reals(extension, "scale", 2, -HUGE_VAL, HUGE_VAL, scale, err) ||
        lw_gltf_json_real(extension, "rotation", -HUGE_VAL, HUGE_VAL, &rotation, err) ||
        lw_gltf_json_integer(extension, "texCoord", 0, UINT32_MAX, uv_set, err)) {
        lw_status_context(err, "KHR_texture_transform");
        return err->status;
    }
    float c = cosf(rotation), s = sinf(rotation);
    const float matrix[6] = {c * scale[0], s * scale[1], offset[0], -s * scale[0], c * scale[1], offset[1]};
    memcpy(transform, matrix, sizeof matrix);
    return LW_OK;
}

/* *out_unreadable: there should be a texture, but it cannot be read. */
static enum lw_status read_texture_use(struct lw_gltf_materials *materials, const json_t *parent,
                                       const char *key, struct lw_texture_use *use, bool *out_unreadable,
                                       struct lw_error *err) {
    const json_t *info = NULL;
    uint32_t index = 0;
    uint64_t uv_set = 0;
    *out_unreadable = false;
    if (lw_gltf_json_object(parent, key, &info, err)) return err->status;
    if (!info) return LW_OK;
    if (lw_gltf_json_require(info, "index", err) ||
        lw_gltf_document_index(materials->document, info, "index", LW_GLTF_TEXTURES, &index, err) ||
        lw_gltf_json_integer(info, "texCoord", 0, UINT32_MAX, &uv_set, err) ||
        read_transform(info, use->transform, &uv_set, err)) {
        lw_status_context(err, "%s", key);
        return err->status;
    }
    if (uv_set > 1) {
        lw_gltf_document_warn(materials->document, LW_GLTF_WARN_UV_SET);
        return LW_OK;
    }
    if (materials->texture_of[index] == LW_SCENE_NONE &&
        convert_texture(materials, index, &materials->texture_of[index], err)) {
        lw_status_context(err, "%s: textures[%u]", key, index);
        return err->status;
    }
    *out_unreadable = materials->texture_of[index] == LW_SCENE_NONE;
    use->texture = materials->texture_of[index];
    use->uv_set = (uint32_t)uv_set;
    return LW_OK;
}

/* ---- materials ---- */

/* KHR_materials_pbrSpecularGlossiness: a black diffuse colour under a bright specular one is a metal, by the
 * rule as in MTL: it reflects its specular colour. */
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
        read_texture_use(materials, pbr, texture, &out->base_colour_texture, &unreadable, err) ||
        (glossy && read_specular(glossy, out, err))) {
        lw_status_context(err, glossy ? "KHR_materials_pbrSpecularGlossiness" : "pbrMetallicRoughness");
        return err->status;
    }
    for (int c = 0; c < 4; c++) {
        if (out->base_colour[c] <= 1) continue;
        out->base_colour[c] = 1; /* a surface that reflects more than it receives would never settle */
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
    if (read_texture_use(materials, object, "emissiveTexture", &out->emission_texture, &unreadable, err))
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
        const json_t *normal_map = NULL;
        if (lw_gltf_json_string(object, "name", &name, err) ||
            read_base_colour(materials, object, out, out_bright, err) ||
            read_emission(materials, object, out, err) || read_alpha(object, out, err) ||
            read_unlit(object, out, err) || read_transmission(materials, object, out, err) ||
            lw_gltf_json_object(object, "normalTexture", &normal_map, err) ||
            lw_gltf_json_drawn_by(object, &out->drawn_by, err))
            return err->status;
        if (normal_map) lw_gltf_document_warn(materials->document, LW_GLTF_WARN_NORMAL_MAP);
    }
    out->name = lw_scene_string(materials->scene, object ? name : "default");
    return out->name ? LW_OK : lw_status_fail(err, LW_NO_MEMORY, "out of memory");
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
