#include "server/import/gltf/gltf_texture.h"

#include "common/base/log.h"
#include "server/import/images/finish_texels.h"
#include "server/import/images/image_file.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Where more of a normal map is no normals, one line says so: a texel here and there is a JPEG's. */
#define ODD_SHARE 0.01

enum lw_status lw_gltf_textures_init(struct lw_gltf_textures *textures, struct lw_gltf_document *document,
                                     struct lw_scene *scene, uint64_t finish_textures, struct lw_error *err) {
    const uint32_t count = document->count[LW_GLTF_TEXTURES];
    *textures = (struct lw_gltf_textures){.document = document, .scene = scene};
    if (count > LW_SCENE_TEXTURES_MAX)
        return lw_status_fail(err, LW_BAD_DATA, "has %u textures; the limit is %u", count,
                              LW_SCENE_TEXTURES_MAX);
    textures->finish_texture_max =
        finish_textures < LW_SCENE_TEXTURES_MAX ? (uint32_t)finish_textures : LW_SCENE_TEXTURES_MAX;
    textures->texture_of = malloc((count + 1ul) * sizeof *textures->texture_of);
    textures->image = calloc(document->count[LW_GLTF_IMAGES] + 1ul, sizeof *textures->image);
    scene->texture = lw_scene_alloc(scene, count + 1ul, sizeof *scene->texture);
    scene->finish_texture =
        lw_scene_alloc(scene, textures->finish_texture_max + 1ul, sizeof *scene->finish_texture);
    if (!textures->texture_of || !textures->image || !scene->texture || !scene->finish_texture)
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory for textures");
    for (uint32_t i = 0; i <= count; i++) textures->texture_of[i] = LW_SCENE_NONE;
    return LW_OK;
}

void lw_gltf_textures_finish(struct lw_gltf_textures *textures) {
    free(textures->image);
    free(textures->texture_of);
    *textures = (struct lw_gltf_textures){0};
}

/* ---- images ---- */

enum lw_status lw_gltf_textures_texels(struct lw_gltf_textures *textures, uint32_t width, uint32_t height,
                                       uint8_t **out, struct lw_error *err) {
    if (lw_image_file_count(&textures->document->pictures, width, height, err)) return err->status;
    *out = lw_scene_alloc(textures->scene, (size_t)width * height, 4);
    if (!*out) return lw_status_fail(err, LW_NO_MEMORY, "out of memory for %u x %u texels", width, height);
    return LW_OK;
}

static enum lw_status decode_bytes(struct lw_gltf_textures *textures, struct lw_gltf_bytes bytes,
                                   struct lw_gltf_image_slot *slot, uint8_t **out, struct lw_error *err) {
    uint8_t *rgba = NULL;
    if (lw_image_file_size(bytes.data, bytes.size, &slot->width, &slot->height, err) ||
        lw_gltf_textures_texels(textures, slot->width, slot->height, &rgba, err) ||
        lw_image_file_decode(bytes.data, bytes.size, slot->width, slot->height, rgba, err))
        return err->status;
    *out = rgba;
    return LW_OK;
}

/* *out_spoilt: the error is that of a picture, not of the document. */
static enum lw_status read_image(struct lw_gltf_textures *textures, uint32_t index, uint8_t **out,
                                 bool *out_spoilt, struct lw_error *err) {
    const struct lw_gltf_document *document = textures->document;
    struct lw_gltf_image_slot *slot = &textures->image[index];
    const json_t *object = lw_gltf_document_item(document, LW_GLTF_IMAGES, index);
    const char *uri = NULL;
    uint32_t view = LW_SCENE_NONE;
    *out_spoilt = false;
    if (lw_gltf_json_string(object, "uri", &uri, err) ||
        lw_gltf_document_index(document, object, "bufferView", LW_GLTF_BUFFER_VIEWS, &view, err))
        return err->status;
    if ((uri == NULL) == (view == LW_SCENE_NONE))
        return lw_status_fail(err, LW_BAD_DATA, "must have either uri or bufferView");
    *out_spoilt = true;
    if (!uri) return decode_bytes(textures, document->view[view].bytes, slot, out, err);

    uint8_t *storage;
    size_t size;
    if (lw_gltf_document_fetch(document, uri, 0, LW_IMAGE_FILE_SIZE_MAX, true, &storage, &size, err))
        return err->status;
    if (decode_bytes(textures, (struct lw_gltf_bytes){storage, size}, slot, out, err))
        lw_status_context(err, "uri \"%.*s\"", strncasecmp(uri, "data:", 5) == 0 ? 40 : 200, uri);
    free(storage);
    return err->status;
}

/* A picture that is not there, is none or lies outside of the scene's folder spoils one material, not the
 * scene: it is reported and something stands in. Wrong JSON is an error of the document. */
static enum lw_status give_up_image(struct lw_gltf_textures *textures, uint32_t index, struct lw_error *err) {
    if (err->status != LW_BAD_DATA && err->status != LW_NO_INPUT) return err->status;
    lw_log(LW_LOG_WARNING,
           "%s: images[%u]: %s; a colour stands in (half the base colour factor; no emission, gloss, relief)",
           textures->document->name, index, err->text);
    textures->image[index].unreadable = true;
    *err = (struct lw_error){0};
    return LW_OK;
}

/* Texels of a picture without alpha are its colours and its surface. */
static void keep_texels(struct lw_gltf_textures *textures, uint32_t index, enum lw_content content,
                        uint8_t *rgba) {
    struct lw_gltf_image_slot *slot = &textures->image[index];
    const size_t texels = (size_t)slot->width * slot->height;
    char name[32];
    slot->texel[content] = rgba;
    if (content == LW_CONTENT_SURFACE && lw_finish_texels_opaque(rgba, texels))
        slot->texel[LW_CONTENT_COLOUR] = rgba;
    else if (content == LW_CONTENT_SURFACE)
        lw_finish_texels_cover(rgba, texels);
    if (content != LW_CONTENT_NORMAL) return;
    snprintf(name, sizeof name, "images[%u]", index);
    if ((double)lw_finish_texels_normal(rgba, texels) > ODD_SHARE * (double)texels)
        lw_tally_add(&textures->odd_normals, name);
}

static enum lw_status load_image(struct lw_gltf_textures *textures, uint32_t index, enum lw_content content,
                                 struct lw_error *err) {
    struct lw_gltf_image_slot *slot = &textures->image[index];
    const uint8_t *colours = slot->texel[LW_CONTENT_COLOUR];
    uint8_t *rgba = NULL;
    bool spoilt;
    if (slot->texel[content] || slot->unreadable) return LW_OK;
    if (content == LW_CONTENT_SURFACE && colours &&
        lw_finish_texels_opaque(colours, (size_t)slot->width * slot->height)) {
        slot->texel[content] = colours;
        return LW_OK;
    }
    if (read_image(textures, index, &rgba, &spoilt, err))
        return spoilt ? give_up_image(textures, index, err) : err->status;
    keep_texels(textures, index, content, rgba);
    return LW_OK;
}

enum lw_status lw_gltf_textures_image(struct lw_gltf_textures *textures, uint32_t index,
                                      enum lw_content content, const struct lw_gltf_image_slot **out,
                                      struct lw_error *err) {
    *out = &textures->image[index];
    if (load_image(textures, index, content, err)) lw_status_context(err, "images[%u]", index);
    return err->status;
}

enum lw_status lw_gltf_textures_decode(struct lw_gltf_textures *textures, uint32_t image,
                                       struct lw_texture *out, uint8_t **out_rgba, struct lw_error *err) {
    const struct lw_gltf_image_slot *slot = &textures->image[image];
    bool spoilt;
    *out_rgba = NULL;
    if (!slot->unreadable && read_image(textures, image, out_rgba, &spoilt, err) &&
        (!spoilt || give_up_image(textures, image, err)))
        lw_status_context(err, "images[%u]", image);
    out->rgba = *out_rgba;
    out->width = slot->width;
    out->height = slot->height;
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

static enum lw_status read_sampler(const struct lw_gltf_document *document, const json_t *texture,
                                   struct lw_texture *out, struct lw_error *err) {
    uint32_t sampler = LW_SCENE_NONE;
    if (lw_gltf_document_index(document, texture, "sampler", LW_GLTF_SAMPLERS, &sampler, err))
        return err->status;
    const json_t *object =
        sampler == LW_SCENE_NONE ? NULL : lw_gltf_document_item(document, LW_GLTF_SAMPLERS, sampler);
    if (read_wrap(object, "wrapS", &out->wrap_s, err) || read_wrap(object, "wrapT", &out->wrap_t, err))
        lw_status_context(err, "samplers[%u]", sampler);
    return err->status;
}

enum lw_status lw_gltf_textures_sampler(struct lw_gltf_textures *textures, uint32_t index,
                                        struct lw_texture *out, uint32_t *out_image, struct lw_error *err) {
    const struct lw_gltf_document *document = textures->document;
    const json_t *object = lw_gltf_document_item(document, LW_GLTF_TEXTURES, index);
    char name[32];
    *out = (struct lw_texture){.name = ""};
    *out_image = LW_SCENE_NONE;
    if (find_image(document, object, out_image, err) || read_sampler(document, object, out, err) ||
        lw_gltf_json_string(object, "name", &out->name, err))
        return err->status;
    if (*out_image != LW_SCENE_NONE)
        return *out->name ? LW_OK
                          : lw_gltf_json_string(lw_gltf_document_item(document, LW_GLTF_IMAGES, *out_image),
                                                "name", &out->name, err);
    snprintf(name, sizeof name, "textures[%u]", index); /* it names one in an extension that is not read */
    lw_tally_add(&textures->without_image, name);
    return LW_OK;
}

enum lw_status lw_gltf_textures_sample(struct lw_gltf_textures *textures, uint32_t index,
                                       enum lw_content content, struct lw_texture *out,
                                       struct lw_error *err) {
    const struct lw_gltf_image_slot *slot;
    uint32_t image;
    if (lw_gltf_textures_sampler(textures, index, out, &image, err)) return err->status;
    out->content = (uint8_t)content;
    if (image == LW_SCENE_NONE) return LW_OK;
    if (lw_gltf_textures_image(textures, image, content, &slot, err)) return err->status;
    out->width = slot->width;
    out->height = slot->height;
    out->rgba = slot->texel[content];
    return LW_OK;
}

struct list {
    struct lw_texture *texture;
    uint32_t *count, capacity;
};

/* Textures that differ only in what we do not use (filters, names) become one. */
static enum lw_status add_texture(struct lw_scene *scene, const struct list *list,
                                  const struct lw_texture *texture, uint32_t *out, struct lw_error *err) {
    for (uint32_t i = 0; i < *list->count; i++) {
        const struct lw_texture *other = &list->texture[i];
        if (other->rgba != texture->rgba || other->wrap_s != texture->wrap_s ||
            other->wrap_t != texture->wrap_t || other->content != texture->content)
            continue;
        *out = i;
        return LW_OK;
    }
    if (*list->count == list->capacity)
        return lw_status_fail(err, LW_BAD_DATA, "has more than %u textures", list->capacity);
    struct lw_texture own = *texture;
    own.name = lw_scene_string(scene, texture->name);
    if (!own.name) return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    *out = (*list->count)++;
    list->texture[*out] = own;
    return LW_OK;
}

enum lw_status lw_gltf_textures_add_finish(struct lw_gltf_textures *textures,
                                           const struct lw_texture *texture, uint32_t *out,
                                           struct lw_error *err) {
    struct lw_scene *scene = textures->scene;
    const struct list list = {scene->finish_texture, &scene->finish_texture_count,
                              textures->finish_texture_max};
    return add_texture(scene, &list, texture, out, err);
}

/* ---- uses ---- */

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

enum lw_status lw_gltf_textures_info(struct lw_gltf_textures *textures, const json_t *parent, const char *key,
                                     struct lw_gltf_texture_info *out, struct lw_error *err) {
    const json_t *info = NULL;
    uint64_t uv_set = 0;
    *out = (struct lw_gltf_texture_info){LW_SCENE_NONE, {LW_SCENE_NONE, 0, {1, 0, 0, 0, 1, 0}}};
    if (lw_gltf_json_object(parent, key, &info, err)) return err->status;
    if (!info) return LW_OK;
    if (lw_gltf_json_require(info, "index", err) ||
        lw_gltf_document_index(textures->document, info, "index", LW_GLTF_TEXTURES, &out->texture, err) ||
        lw_gltf_json_integer(info, "texCoord", 0, UINT32_MAX, &uv_set, err) ||
        read_transform(info, out->place.transform, &uv_set, err)) {
        lw_status_context(err, "%s", key);
        return err->status;
    }
    if (uv_set > 1) {
        lw_gltf_document_warn(textures->document, LW_GLTF_WARN_UV_SET);
        out->texture = LW_SCENE_NONE;
    }
    out->place.uv_set = uv_set == 1;
    return LW_OK;
}

static enum lw_status use_texture(struct lw_gltf_textures *textures, uint32_t index, uint32_t *out,
                                  struct lw_error *err) {
    struct lw_scene *scene = textures->scene;
    const struct list list = {scene->texture, &scene->texture_count,
                              textures->document->count[LW_GLTF_TEXTURES]};
    struct lw_texture texture;
    *out = textures->texture_of[index];
    if (*out != LW_SCENE_NONE) return LW_OK;
    if (lw_gltf_textures_sample(textures, index, LW_CONTENT_COLOUR, &texture, err) ||
        (texture.rgba && add_texture(scene, &list, &texture, out, err)))
        return err->status;
    textures->texture_of[index] = *out;
    return LW_OK;
}

enum lw_status lw_gltf_textures_use(struct lw_gltf_textures *textures, const json_t *parent, const char *key,
                                    struct lw_texture_use *use, bool *out_unreadable, struct lw_error *err) {
    struct lw_gltf_texture_info info;
    *out_unreadable = false;
    if (lw_gltf_textures_info(textures, parent, key, &info, err)) return err->status;
    if (info.texture == LW_SCENE_NONE) return LW_OK;
    if (use_texture(textures, info.texture, &info.place.texture, err)) {
        lw_status_context(err, "%s: textures[%u]", key, info.texture);
        return err->status;
    }
    *out_unreadable = info.place.texture == LW_SCENE_NONE;
    if (!*out_unreadable) *use = info.place;
    return LW_OK;
}

enum lw_status lw_gltf_textures_use_finish(struct lw_gltf_textures *textures, const json_t *parent,
                                           const char *key, enum lw_content content,
                                           struct lw_texture_use *use, bool *out_unreadable,
                                           struct lw_error *err) {
    struct lw_gltf_texture_info info;
    struct lw_texture texture;
    *out_unreadable = false;
    if (lw_gltf_textures_info(textures, parent, key, &info, err)) return err->status;
    if (info.texture == LW_SCENE_NONE) return LW_OK;
    if (lw_gltf_textures_sample(textures, info.texture, content, &texture, err) ||
        (texture.rgba && lw_gltf_textures_add_finish(textures, &texture, &info.place.texture, err))) {
        lw_status_context(err, "%s: textures[%u]", key, info.texture);
        return err->status;
    }
    *out_unreadable = !texture.rgba;
    if (!*out_unreadable) *use = info.place;
    return LW_OK;
}
