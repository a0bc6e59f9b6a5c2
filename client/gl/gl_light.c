#include "client/gl/gl_light.h"

#include "client/gl/gl_program.h"
#include "client/gl/gl_rgb10.h"
#include "client/gl/gl_rgb9e5.h"
#include "client/gl/gl_texture.h"
#include "common/base/colour.h"

#include <stdlib.h>
#include <string.h>

#define PAGE_SIDE   1024u /* texels; larger where a level is */
#define BORDERED    (LW_TILE_SIDE + 2)
#define DRIFT_STOPS 8 /* light is packed again when its mean has moved by so much */
#define FAR_STOPS   100

struct lw_gl_light_rect {
    uint32_t x, y, layer, mip, width, height; /* texels of that mip level of the pages */
};

/* ---- room ---- */

/* Levels with a place of their own. */
struct order {
    uint32_t level, height;
};

static int by_height(const void *a, const void *b) {
    const struct order *x = a, *y = b;
    if (x->height != y->height) return x->height > y->height ? -1 : 1;
    return x->level < y->level ? -1 : 1;
}

/* Places keep to whole texels of the coarsest mip level. */
static uint32_t rounded(uint32_t side) {
    return (side + (1u << LW_ATLAS_READ_MAX) - 1) >> LW_ATLAS_READ_MAX << LW_ATLAS_READ_MAX;
}

/* Packs them on shelves, the tallest first. */
static void lay_out(struct lw_gl_light *light, const struct order *order, uint32_t count) {
    uint32_t x = 0, y = 0, shelf = 0, layer = 0;
    for (uint32_t i = 0; i < count; i++) {
        struct lw_gl_light_rect *r = &light->rect[order[i].level];
        const uint32_t width = rounded(r->width), height = rounded(r->height);
        if (x + width > light->side) x = 0, y += shelf, shelf = 0;
        if (y + height > light->side) x = 0, y = 0, shelf = 0, layer++;
        if (shelf == 0) shelf = height;
        r->x = x, r->y = y, r->layer = layer;
        x += width;
    }
    light->layers = layer + 1;
}

/* Levels 1 and 2 lie where level 0 does. */
static void place_mips(struct lw_gl_light *light) {
    for (uint32_t o = 0; o < light->map->object_count; o++) {
        struct lw_gl_light_rect *r = &light->rect[light->first_level[o]];
        for (uint32_t k = 1; k <= LW_ATLAS_READ_MAX && k < light->map->atlas[o]->level_count; k++)
            r[k].x = r->x >> k, r[k].y = r->y >> k, r[k].layer = r->layer, r[k].mip = k;
    }
}

static enum lw_status find_places(struct lw_gl_light *light, uint32_t count, struct lw_error *err) {
    GLint side_max = 0, layers_max = 0;
    glGetIntegerv(GL_MAX_TEXTURE_SIZE, &side_max);
    glGetIntegerv(GL_MAX_ARRAY_TEXTURE_LAYERS, &layers_max);
    struct order *order = calloc(count + 1ul, sizeof *order);
    if (order == NULL) return lw_status_fail(err, LW_NO_MEMORY, "no memory for the light of the view");
    uint32_t placed = 0;
    light->side = PAGE_SIDE;
    for (uint32_t o = 0; o < light->map->object_count; o++)
        for (uint32_t k = 0; k < light->map->atlas[o]->level_count; k++) {
            const uint32_t number = light->first_level[o] + k;
            const struct lw_gl_light_rect *r = &light->rect[number];
            if (k == 0 || k > LW_ATLAS_READ_MAX) order[placed++] = (struct order){number, r->height};
            while (light->side < r->width || light->side < r->height) light->side *= 2;
        }
    qsort(order, placed, sizeof *order, by_height);
    do lay_out(light, order, placed);
    while (light->layers > (uint32_t)layers_max && (light->side *= 2) <= (uint32_t)side_max);
    free(order);
    if (light->side > (uint32_t)side_max || light->layers > (uint32_t)layers_max)
        return lw_status_fail(
            err, LW_UNAVAILABLE,
            "the scene's lightmaps take %u pages of %u x %u texels, the GPU has %d of %d x %d", light->layers,
            light->side, light->side, layers_max, side_max, side_max);
    place_mips(light);
    return LW_OK;
}

static void list_levels(struct lw_gl_light *light) {
    uint32_t k = 0;
    for (uint32_t o = 0; o < light->map->object_count; o++) {
        light->first_level[o] = k += light->map->atlas[o]->finer_count;
        for (uint32_t i = 0; i < light->map->atlas[o]->level_count; i++, k++) {
            const struct lw_atlas_level *l = &light->map->atlas[o]->level[i];
            light->rect[k] = (struct lw_gl_light_rect){.width = l->width, .height = l->height};
        }
    }
}

void lw_gl_light_place(const struct lw_gl_light *light, uint32_t object, uint32_t back_offset,
                       uint32_t out_words[4]) {
    const struct lw_gl_light_rect *r = &light->rect[light->first_level[object]];
    const uint32_t level_count = light->map->atlas[object]->level_count;
    out_words[0] = light->first_level[object];
    out_words[1] = level_count | r->layer << 4 | back_offset << 16;
    out_words[2] = r->x | r->y << 16;
    out_words[3] = r->width | r->height << 16;
}

/* Words of the table: those of plain tiles, then those of finer levels by their names. Without a pool no
 * word of a finer level is read. */
static size_t count_words(const struct lw_gl_light *light) {
    return light->map->plain_count + (light->fine.pool ? (size_t)light->map->fine_names : 0) + 1;
}

/* A table of words, which are all 0. */
static enum lw_status make_words(struct lw_gl_light *light, struct lw_error *err) {
    uint16_t *zero = calloc(count_words(light), sizeof *zero);
    if (zero == NULL) return lw_status_fail(err, LW_NO_MEMORY, "no memory for the light of the view");
    lw_gl_texture_table(GL_R16UI, count_words(light) * sizeof *zero, zero, &light->tile_buffer,
                        &light->tiles);
    free(zero);
    return LW_OK;
}

static GLuint make_pages(const struct lw_gl_light *light, const struct lw_gl_texels *texels) {
    GLuint pages;
    lw_gl_texture_smooth(GL_TEXTURE_2D_ARRAY, &pages);
    glTexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_MIN_FILTER, GL_LINEAR_MIPMAP_NEAREST);
    glTexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_MAX_LEVEL, LW_ATLAS_READ_MAX);
    for (GLint mip = 0; mip <= (GLint)LW_ATLAS_READ_MAX; mip++)
        glTexImage3D(GL_TEXTURE_2D_ARRAY, mip, texels->kept, (GLsizei)(light->side >> mip),
                     (GLsizei)(light->side >> mip), (GLsizei)light->layers, 0, texels->format, texels->type,
                     NULL);
    return pages;
}

static enum lw_status make_textures(struct lw_gl_light *light, uint32_t count, struct lw_error *err) {
    const struct lw_atlas_map *map = light->map;
    uint32_t(*table)[4] = calloc(count + 1ul, sizeof *table);
    if (table == NULL) return lw_status_fail(err, LW_NO_MEMORY, "no memory for the light of the view");
    for (uint32_t o = 0; o < map->object_count; o++) {
        for (uint32_t i = 0; i < map->atlas[o]->level_count; i++) {
            const struct lw_gl_light_rect *r = &light->rect[light->first_level[o] + i];
            const struct lw_atlas_level *l = &map->atlas[o]->level[i];
            uint32_t *row = table[light->first_level[o] + i];
            row[0] = r->x | r->y << 16;
            row[1] = r->layer | r->mip << 12 | l->tiles_x << 16;
            row[2] = r->width | r->height << 16;
            row[3] = map->first_tile[o] + l->first_tile;
        }
        for (uint32_t i = 1; i <= map->atlas[o]->finer_count; i++) {
            uint32_t *row = table[light->first_level[o] - i];
            row[1] = map->atlas[o]->finer[i - 1].tiles_x << 16;
            row[3] =
                (uint32_t)(map->plain_count + map->first_finer[o] + map->atlas[o]->finer[i - 1].first_tile);
        }
    }
    lw_gl_texture_table(GL_RGBA32UI, (count + 1ul) * sizeof *table, table, &light->level_buffer,
                        &light->levels);
    free(table);
    const enum lw_status status = make_words(light, err);
    if (status != LW_OK) return status;
    light->pages = make_pages(light, &lw_gl_texels_light);
    return lw_gl_program_check("the scene's lightmaps", err);
}

enum lw_status lw_gl_light_init(struct lw_gl_light *light, const struct lw_atlas_map *map, bool unfiltered,
                                struct lw_error *err) {
    uint32_t count = 0;
    GLint table_max = 0;
    for (uint32_t o = 0; o < map->object_count; o++)
        count += map->atlas[o]->level_count + map->atlas[o]->finer_count;
    *light = (struct lw_gl_light){.map = map, .unfiltered = unfiltered, .scale = 0};
    glGetIntegerv(GL_MAX_TEXTURE_BUFFER_SIZE, &table_max);
    if (map->plain_count >= (uint32_t)table_max || count >= (uint32_t)table_max)
        return lw_status_fail(err, LW_UNAVAILABLE, "the scene has %u tiles of light, the GPU takes %d",
                              map->plain_count, table_max);
    light->first_level = calloc(map->object_count + 1ul, sizeof *light->first_level);
    light->rect = calloc(count + 1ul, sizeof *light->rect);
    light->version = calloc(map->plain_count + 1ul, sizeof *light->version);
    light->noise_level = calloc(map->plain_count + 1ul, sizeof *light->noise_level);
    light->settled = calloc(map->object_count + 1ul, sizeof *light->settled);
    light->word = calloc(map->plain_count + 1ul, sizeof *light->word);
    light->queue = calloc(map->plain_count + 1ul, sizeof *light->queue);
    light->texels = calloc((size_t)BORDERED * BORDERED, sizeof *light->texels);
    enum lw_status status = LW_OK;
    if (!light->first_level || !light->rect || !light->version || !light->noise_level || !light->settled ||
        !light->word || !light->queue || !light->texels)
        status = lw_status_fail(err, LW_NO_MEMORY, "no memory for the light of the view");
    if (status == LW_OK) {
        list_levels(light);
        status = find_places(light, count, err);
    }
    if (status == LW_OK) status = lw_gl_fine_tiles_init(&light->fine, map, LW_GL_FINE_TILES_MAX, err);
    if (status == LW_OK) status = make_textures(light, count, err);
    if (status != LW_OK) lw_gl_light_finish(light);
    return status;
}

void lw_gl_light_finish(struct lw_gl_light *light) {
    if (light->pages) glDeleteTextures(1, &light->pages);
    if (light->directions) glDeleteTextures(1, &light->directions);
    if (light->levels) glDeleteTextures(1, &light->levels);
    if (light->tiles) glDeleteTextures(1, &light->tiles);
    if (light->level_buffer) glDeleteBuffers(1, &light->level_buffer);
    if (light->tile_buffer) glDeleteBuffers(1, &light->tile_buffer);
    lw_gl_fine_tiles_finish(&light->fine);
    free(light->texels);
    free(light->queue);
    free(light->word);
    free(light->settled);
    free(light->noise_level);
    free(light->version);
    free(light->rect);
    free(light->first_level);
    *light = (struct lw_gl_light){0};
}

/* ---- tiles ---- */

/* Whether a tile of a level is in the pages; `self` counts. */
static bool is_here(const struct lw_gl_light *light, const struct lw_tile_place *place, int64_t x, int64_t y,
                    uint32_t self) {
    const struct lw_atlas_level *l = &light->map->atlas[place->object]->level[place->level];
    const uint32_t t =
        light->map->first_tile[place->object] + l->first_tile + (uint32_t)y * l->tiles_x + (uint32_t)x;
    return t == self || light->version[t] != 0;
}

/* Where a texel of the border of a tile is read: in the neighbour, or where that has not arrived at the
 * tile's own edge, which then stands in for it in look-ups between the two. */
static int64_t nearest(int64_t at, int64_t first, int64_t count) {
    if (at < first) return first;
    return at < first + count ? at : first + count - 1;
}

/* The part of a level that an upload writes: a tile, with a border of a texel wherever the level goes on. */
struct part {
    int64_t left, top, right, bottom;
};

/* Packs it into light->texels. from: the level's texels; directions: they are that, else light */
static void pack_tile(struct lw_gl_light *light, uint32_t tile, const float *from, uint32_t width,
                      const struct part *part, bool directions) {
    const struct lw_tile_place *place = &light->map->place[tile];
    const int64_t x0 = (int64_t)place->x * LW_TILE_SIDE, y0 = (int64_t)place->y * LW_TILE_SIDE;
    uint32_t *out = light->texels;
    for (int64_t y = part->top; y < part->bottom; y++)
        for (int64_t x = part->left; x < part->right; x++) {
            const bool inside = x >= x0 && x < x0 + place->width && y >= y0 && y < y0 + place->height;
            int64_t sx = x, sy = y;
            if (!inside && !is_here(light, place, x / LW_TILE_SIDE, y / LW_TILE_SIDE, tile))
                sx = nearest(x, x0, place->width), sy = nearest(y, y0, place->height);
            const float *texel = from + 3 * ((size_t)sy * width + (size_t)sx);
            *out++ = directions ? lw_gl_rgb10_pack(texel) : lw_gl_rgb9e5_pack(texel, light->scale);
        }
}

static bool upload(struct lw_gl_light *light, const struct lw_compose_source *source, uint32_t tile) {
    const struct lw_tile_place *place = &light->map->place[tile];
    const struct lw_gl_light_rect *r = &light->rect[light->first_level[place->object] + place->level];
    const struct lw_client_level level = source->level(source->context, place->object, place->level);
    if (level.rgb == NULL || level.width != r->width || level.height != r->height) return false;
    const int64_t x = (int64_t)place->x * LW_TILE_SIDE, y = (int64_t)place->y * LW_TILE_SIDE,
                  right = x + place->width, bottom = y + place->height;
    const struct part part = {x - (x > 0), y - (y > 0), right + (right < r->width),
                              bottom + (bottom < r->height)};
    for (int k = 0; k < (light->directions && level.direction ? 2 : 1); k++) {
        const struct lw_gl_texels *texels = k ? &lw_gl_texels_directions : &lw_gl_texels_light;
        pack_tile(light, tile, k ? level.direction : level.rgb, level.width, &part, k == 1);
        glBindTexture(GL_TEXTURE_2D_ARRAY, k ? light->directions : light->pages);
        glTexSubImage3D(GL_TEXTURE_2D_ARRAY, (GLint)r->mip, (GLint)(r->x + part.left),
                        (GLint)(r->y + part.top), (GLint)r->layer, (GLsizei)(part.right - part.left),
                        (GLsizei)(part.bottom - part.top), 1, texels->format, texels->type, light->texels);
    }
    return true;
}

/* Whether a source knows where its light comes from. */
static bool has_directions(const struct lw_gl_light *light, const struct lw_compose_source *source) {
    for (uint32_t o = 0; o < light->map->object_count; o++)
        if (light->map->atlas[o]->level_count) return source->level(source->context, o, 0).direction != NULL;
    return false;
}

/* Makes room for directions when they are first there. All tiles are uploaded again then. */
static void take_directions(struct lw_gl_light *light, const struct lw_compose_source *source) {
    GLint units_max = 0;
    if (light->directions || !has_directions(light, source)) return;
    glGetIntegerv(GL_MAX_TEXTURE_IMAGE_UNITS, &units_max);
    if (units_max < (GLint)LW_GL_FINE_TILES_UNITS) return; /* indirect light then looks as without them */
    light->directions = make_pages(light, &lw_gl_texels_directions);
    lw_gl_fine_tiles_add_directions(&light->fine);
    memset(light->version, 0, light->map->plain_count * sizeof *light->version);
}

/* The level to read where `level` is the finest that serves a tile of an object, which is at (x, y) of
 * that. */
static unsigned level_to_read(const struct lw_gl_light *light, uint32_t object, uint32_t level, uint32_t x,
                              uint32_t y) {
    const struct lw_atlas *atlas = light->map->atlas[object];
    for (uint32_t k = level; k < atlas->level_count; k++, x /= 2, y /= 2) {
        const struct lw_atlas_level *l = &atlas->level[k];
        if (light->version[light->map->first_tile[object] + l->first_tile + y * l->tiles_x + x]) return k;
    }
    return LW_GL_LIGHT_NONE;
}

static void find_words(struct lw_gl_light *light) {
    for (uint32_t o = 0; o < light->map->object_count; o++) light->settled[o] = true;
    for (uint32_t t = 0; t < light->map->plain_count; t++) {
        const struct lw_tile_place *p = &light->map->place[t];
        const uint32_t last = light->map->atlas[p->object]->level_count - 1;
        unsigned word = (unsigned)light->noise_level[t] << LW_GL_LIGHT_NOISE_SHIFT;
        for (uint32_t i = 0; i <= LW_ATLAS_READ_MAX; i++) {
            uint32_t k = i > p->level ? i : p->level;
            if (k > last) k = last;
            const unsigned shift = k - p->level;
            word |= level_to_read(light, p->object, k, p->x >> shift, p->y >> shift) << (4 * i);
        }
        light->word[t] = (uint16_t)word;
        if (light->noise_level[t] || !light->version[t]) light->settled[p->object] = false;
    }
}

static void upload_words(const struct lw_gl_light *light) {
    glBindBuffer(GL_TEXTURE_BUFFER, light->tile_buffer);
    glBufferSubData(GL_TEXTURE_BUFFER, 0, (GLsizeiptr)(light->map->plain_count * sizeof *light->word),
                    light->word);
}

/* The average of the objects' coarsest levels, as far as they have arrived. */
static void take_average(struct lw_gl_light *light, const struct lw_compose_source *source) {
    double sum[3] = {0}, count = 0;
    for (uint32_t o = 0; o < light->map->object_count; o++) {
        const struct lw_atlas *atlas = light->map->atlas[o];
        if (atlas->level_count == 0) continue;
        const uint32_t k = atlas->level_count - 1,
                       tile = light->map->first_tile[o] + atlas->level[k].first_tile;
        if (source->tile(source->context, (lw_tile_id){tile}).version == 0) continue;
        const struct lw_client_level level = source->level(source->context, o, k);
        for (size_t i = 0; level.rgb && i < (size_t)level.width * level.height; i++) {
            const float *e = level.rgb + 3 * i;
            if (!(e[0] >= 0 && e[1] >= 0 && e[2] >= 0 && e[0] + e[1] + e[2] < INFINITY)) continue;
            for (int c = 0; c < 3; c++) sum[c] += (double)e[c];
            count += 1;
        }
    }
    const bool known = count > 0 && sum[0] + sum[1] + sum[2] > 0;
    /* before anything has arrived, light that shows a surface as its albedo */
    light->stand_in = known
                          ? lw_vec3((float)(sum[0] / count), (float)(sum[1] / count), (float)(sum[2] / count))
                          : lw_vec3(LW_PI, LW_PI, LW_PI);
    light->mean = known ? lw_colour_luminance(light->stand_in) : 0;
}

/* Pages hold a wide range of light, but not that of every unit: about as much above the scene's mean as
 * below. */
static bool choose_scale(struct lw_gl_light *light) {
    int stops = light->mean > 0 ? -(int)lrintf(log2f(light->mean)) : 0;
    stops = stops > FAR_STOPS ? FAR_STOPS : stops < -FAR_STOPS ? -FAR_STOPS : stops;
    const int before = light->scale > 0 ? (int)lrintf(log2f(light->scale)) : 0;
    if (light->scale > 0 && (light->mean == 0 || abs(stops - before) <= DRIFT_STOPS)) return false;
    light->scale = ldexpf(1, stops);
    return true;
}

static int by_number(const void *a, const void *b) {
    const uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;
    return x < y ? -1 : x > y;
}

/* Lists the tiles that are not in the pages as they are now, coarse levels first; returns how many there
 * are. */
static uint32_t list_waiting(struct lw_gl_light *light, const struct lw_compose_source *source,
                             bool *out_changed) {
    uint32_t count = 0;
    *out_changed = false;
    for (uint32_t t = 0; t < light->map->plain_count; t++) {
        const struct lw_client_tile tile = source->tile(source->context, (lw_tile_id){t});
        const uint8_t noise_level =
            light->unfiltered ? 0 : (uint8_t)lw_atlas_noise_level_min(tile.error, source->noise_shown);
        *out_changed |= noise_level != light->noise_level[t];
        light->noise_level[t] = noise_level;
        if (lw_client_tile_changes(&tile) != light->version[t] && tile.version != 0)
            light->queue[count++] = t;
    }
    return count;
}

static void sort_waiting(struct lw_gl_light *light, uint32_t count) {
    /* by level, then by number, in one number each: a tile's number is below 2^28 */
    for (uint32_t i = 0; i < count; i++)
        light->queue[i] |= (LW_ATLAS_LEVELS_MAX - light->map->place[light->queue[i]].level) << 28;
    qsort(light->queue, count, sizeof *light->queue, by_number);
    for (uint32_t i = 0; i < count; i++) light->queue[i] &= (1u << 28) - 1;
}

/* Takes over all tiles but those of finer levels; returns how many it has uploaded. */
static uint32_t take_plain(struct lw_gl_light *light, const struct lw_compose_source *source,
                           uint32_t *tiles_max, bool *out_changed) {
    const bool first = light->scale == 0;
    bool changed;
    take_directions(light, source);
    uint32_t count = list_waiting(light, source, &changed);
    if (count > 0 || first) {
        take_average(light, source);
        if (choose_scale(light) && light->uploaded > 0) {
            memset(light->version, 0, light->map->plain_count * sizeof *light->version);
            count = list_waiting(light, source, &changed);
            *tiles_max = UINT32_MAX;
        }
    }
    const uint32_t now = count < *tiles_max ? count : *tiles_max;
    light->waiting = count - now;
    *out_changed = now > 0 || changed || first;
    if (!*out_changed) return 0;
    sort_waiting(light, count);
    glPixelStorei(GL_UNPACK_ALIGNMENT, 4);
    for (uint32_t i = 0; i < now; i++) {
        const uint32_t t = light->queue[i];
        const struct lw_client_tile tile = source->tile(source->context, (lw_tile_id){t});
        if (!upload(light, source, t)) continue;
        light->version[t] = lw_client_tile_changes(&tile);
        light->uploaded++;
    }
    find_words(light);
    return now;
}

void lw_gl_light_take(struct lw_gl_light *light, const struct lw_compose_source *source, uint32_t tiles_max,
                      uint64_t now_ns) {
    uint32_t most = tiles_max ? tiles_max : UINT32_MAX;
    bool changed;
    const uint32_t plain = take_plain(light, source, &most, &changed);
    const struct lw_gl_fine_tiles_take take = {.source = source,
                                               .unfiltered = light->unfiltered,
                                               .scale = light->scale,
                                               .now_ns = now_ns,
                                               .tiles_max = most - plain,
                                               .table = light->tile_buffer};
    if (changed) upload_words(light);
    lw_gl_fine_tiles_take(&light->fine, &take);
    light->waiting += light->fine.waiting;
}
