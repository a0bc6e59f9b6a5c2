#include "server/import/foreign/foreign_picture.h"

#include "common/base/colour.h"
#include "common/base/file_read.h"
#include "common/base/log.h"
#include "server/import/beside.h"
#include "server/import/mesh/mesh_builder.h"

#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* An opacity map with less than this share of texels between nearly 0 and nearly 1 cuts out; else it
 * blends. */
#define BLEND_SHARE   0.25
#define NEARLY_OPAQUE 229 /* opacity out of 255 */
#define NEARLY_CLEAR  26

#define WARNINGS_MAX 20 /* lines about single pictures */

void lw_foreign_pictures_init(struct lw_foreign_pictures *pictures, struct lw_foreign_import *import) {
    *pictures = (struct lw_foreign_pictures){.import = import, .budget.limit = import->desc->picture_texels};
}

void lw_foreign_pictures_finish(struct lw_foreign_pictures *pictures) {
    for (uint32_t i = 0; i < pictures->picture_count; i++) free(pictures->picture[i].key);
    free(pictures->picture);
    *pictures = (struct lw_foreign_pictures){0};
}

const char *lw_foreign_pictures_base_name(const char *path) {
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
        if (*name && strcmp(lw_foreign_pictures_base_name(name), lw_foreign_pictures_base_name(path)) == 0)
            return ai->mTextures[i];
    }
    return NULL;
}

enum lw_status lw_foreign_pictures_texels(struct lw_foreign_pictures *pictures,
                                          struct lw_foreign_picture *picture, uint8_t **out,
                                          struct lw_error *err) {
    const uint64_t texels = (uint64_t)picture->width * picture->height;
    if (picture->width < 1 || picture->height < 1 || picture->width > LW_SCENE_TEXTURE_SIDE_MAX ||
        picture->height > LW_SCENE_TEXTURE_SIDE_MAX)
        return lw_status_fail(err, LW_BAD_DATA, "has %u x %u texels", picture->width, picture->height);
    if (lw_image_file_count(&pictures->budget, picture->width, picture->height, err)) return err->status;
    *out = lw_scene_alloc(pictures->import->scene, texels, 4);
    if (!*out)
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory for %u x %u texels", picture->width,
                              picture->height);
    picture->rgba = *out;
    return LW_OK;
}

static enum lw_status decode(struct lw_foreign_pictures *pictures, const uint8_t *bytes, size_t size,
                             struct lw_foreign_picture *picture, struct lw_error *err) {
    uint8_t *rgba;
    if (!lw_image_file_size(bytes, size, &picture->width, &picture->height, err) &&
        !lw_foreign_pictures_texels(pictures, picture, &rgba, err))
        return lw_image_file_decode(bytes, size, picture->width, picture->height, rgba, err);
    return err->status;
}

static enum lw_status load_embedded(struct lw_foreign_pictures *pictures, const struct aiTexture *texture,
                                    struct lw_foreign_picture *picture, struct lw_error *err) {
    uint8_t *rgba;
    if (!texture->pcData) return lw_status_fail(err, LW_BAD_DATA, "is empty");
    if (texture->mHeight == 0)
        return decode(pictures, (const uint8_t *)texture->pcData, texture->mWidth, picture, err);
    picture->width = texture->mWidth;
    picture->height = texture->mHeight;
    if (lw_foreign_pictures_texels(pictures, picture, &rgba, err)) return err->status;
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

static enum lw_status load_file(struct lw_foreign_pictures *pictures, const struct lw_foreign_map *map,
                                struct lw_foreign_picture *picture, struct lw_error *err) {
    const struct lw_foreign_files *files = pictures->import->files;
    char *found = NULL;
    uint8_t *bytes = NULL;
    size_t size = 0;
    if (find_file(files, map, &found, err)) return err->status;
    if (!found)
        return lw_status_fail(err, LW_BAD_DATA, "is not there: put it into the folder of the scene or below");
    if (lw_file_read_beneath(files->folder, found, LW_IMAGE_FILE_SIZE_MAX, true, &bytes, &size, err) == LW_OK)
        (void)decode(pictures, bytes, size, picture, err);
    free(bytes);
    free(found);
    return err->status;
}

enum lw_status lw_foreign_pictures_add(struct lw_foreign_pictures *pictures, const char *key,
                                       struct lw_foreign_picture **out, struct lw_error *err) {
    char *own_key = strdup(key);
    if (!own_key || !lw_mesh_builder_reserve((void **)&pictures->picture, &pictures->picture_capacity,
                                             pictures->picture_count + 1ul, sizeof *pictures->picture)) {
        free(own_key);
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory for pictures");
    }
    *out = &pictures->picture[pictures->picture_count++];
    **out = (struct lw_foreign_picture){.key = own_key};
    return LW_OK;
}

struct lw_foreign_picture *lw_foreign_pictures_find(struct lw_foreign_pictures *pictures, const char *key) {
    for (uint32_t i = 0; i < pictures->picture_count; i++)
        if (strcmp(pictures->picture[i].key, key) == 0) return &pictures->picture[i];
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
enum lw_status lw_foreign_pictures_change(struct lw_foreign_pictures *pictures,
                                          const struct lw_foreign_map *map, uint32_t *index,
                                          struct lw_error *err) {
    char key[PATH_MAX + 64];
    uint8_t table[256], *rgba;
    snprintf(key, sizeof key, "%.*s\n%.9g %.9g", PATH_MAX - 1, pictures->picture[*index].key,
             (double)map->base, (double)map->gain);
    struct lw_foreign_picture *made = lw_foreign_pictures_find(pictures, key);
    if (!made) {
        if (lw_foreign_pictures_add(pictures, key, &made, err)) return err->status;
        const struct lw_foreign_picture *from = &pictures->picture[*index];
        made->width = from->width;
        made->height = from->height;
        made->has_alpha = from->has_alpha;
        if (lw_foreign_pictures_texels(pictures, made, &rgba, err)) return err->status;
        for (int i = 0; i < 256; i++) table[i] = change_value((uint8_t)i, map);
        for (size_t i = 0; i < 4 * (size_t)from->width * from->height; i++)
            rgba[i] = i % 4 == 3 ? from->rgba[i] : table[from->rgba[i]];
    }
    *index = (uint32_t)(made - pictures->picture);
    return LW_OK;
}

/* *out_index into the pictures, which may move. A picture that cannot be read is one that is marked so. */
enum lw_status lw_foreign_pictures_get(struct lw_foreign_pictures *pictures, const struct lw_foreign_map *map,
                                       uint32_t *out_index, struct lw_error *err) {
    char key[PATH_MAX];
    snprintf(key, sizeof key, "%s%s%s", map->folder, *map->folder ? "/" : "", map->path.data);
    struct lw_foreign_picture *picture = lw_foreign_pictures_find(pictures, key);
    if (!picture) {
        if (lw_foreign_pictures_add(pictures, key, &picture, err)) return err->status;
        const struct aiTexture *embedded = find_embedded(pictures->import->ai, map->path.data);
        if (embedded)
            (void)load_embedded(pictures, embedded, picture, err);
        else
            (void)load_file(pictures, map, picture, err);
        if (err->status == LW_NO_MEMORY) return err->status;
        picture->unreadable = err->status != LW_OK;
        if (picture->unreadable && pictures->unreadable_count++ < WARNINGS_MAX)
            lw_log(LW_LOG_WARNING,
                   "%s: texture \"%s\": %s; a colour stands in (half the diffuse colour; no emission, gloss, "
                   "relief)",
                   pictures->import->desc->path, map->path.data, err->text);
        *err = (struct lw_error){0};
        if (!picture->unreadable) picture->has_alpha = has_alpha(picture);
    }
    *out_index = (uint32_t)(picture - pictures->picture);
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

enum lw_status lw_foreign_pictures_combine(struct lw_foreign_pictures *pictures, uint32_t colour,
                                           uint32_t opacity, const struct lw_foreign_map *map,
                                           uint32_t *out_index, struct lw_error *err) {
    bool coloured = colour != LW_SCENE_NONE;
    char *key = NULL;
    if (asprintf(&key, "%s\n%s\n%c %.9g %.9g", coloured ? pictures->picture[colour].key : "",
                 pictures->picture[opacity].key, map->channel ? map->channel : '-', (double)map->base,
                 (double)map->gain) < 0)
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory for pictures");
    struct lw_foreign_picture *made = lw_foreign_pictures_find(pictures, key);
    if (!made && lw_foreign_pictures_add(pictures, key, &made, err) == LW_OK) {
        const struct lw_foreign_picture *o = &pictures->picture[opacity],
                                        *c = coloured ? &pictures->picture[colour] : NULL;
        uint8_t *rgba;
        made->width = c && c->width > o->width ? c->width : o->width;
        made->height = c && c->height > o->height ? c->height : o->height;
        made->has_alpha = true;
        if (!lw_foreign_pictures_texels(pictures, made, &rgba, err)) fill_combined(c, o, map, made, rgba);
    }
    free(key);
    if (err->status) return err->status;
    *out_index = (uint32_t)(made - pictures->picture);
    return LW_OK;
}

bool lw_foreign_pictures_blend(const struct lw_foreign_picture *picture) {
    size_t texels = (size_t)picture->width * picture->height, between = 0;
    for (size_t i = 0; i < texels; i++) {
        uint8_t alpha = picture->rgba[4 * i + 3];
        between += alpha > NEARLY_CLEAR && alpha < NEARLY_OPAQUE;
    }
    return (double)between > BLEND_SHARE * (double)texels;
}

void lw_foreign_pictures_report(const struct lw_foreign_pictures *pictures) {
    if (pictures->unreadable_count > WARNINGS_MAX)
        lw_log(LW_LOG_WARNING, "%s: %llu more textures cannot be read", pictures->import->desc->path,
               (unsigned long long)(pictures->unreadable_count - WARNINGS_MAX));
}
