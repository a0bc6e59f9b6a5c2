#include "client/gl/gl_fine_tiles.h"

#include "client/gl/gl_program.h"
#include "client/gl/gl_rgb10.h"
#include "client/gl/gl_rgb9e5.h"
#include "client/gl/gl_texture.h"
#include "common/base/invariant.h"

#include <stdlib.h>
#include <string.h>

#define SIDE LW_GL_FINE_TILES_SIDE
#define NONE UINT32_MAX

/* The tile of a slot, and those to the right, below, and below to the right, of which it has the border. */
enum { SELF, RIGHT, BELOW, CORNER, PARTS };

struct lw_gl_fine_slot {
    bool is_used;
    bool is_filled; /* its texels are of the pool's scale */
    bool leaves;    /* the share falls */
    uint32_t tile;  /* id; NONE: the tile has lost it */
    struct lw_tile_place place;
    uint64_t name;
    uint64_t version[PARTS]; /* the slot's; 0: not there */
    float share;             /* how much of the tile is seen */
    uint16_t word;           /* in the table */
};

/* ---- room ---- */

static uint32_t count_slots(const struct lw_atlas_map *map, uint32_t slots_max) {
    GLint table_max = 0, layers_max = 0, units_max = 0;
    const uint64_t words = map->plain_count + map->fine_names;
    const uint32_t tiles = lw_atlas_map_room(map);
    glGetIntegerv(GL_MAX_TEXTURE_BUFFER_SIZE, &table_max);
    glGetIntegerv(GL_MAX_ARRAY_TEXTURE_LAYERS, &layers_max);
    glGetIntegerv(GL_MAX_TEXTURE_IMAGE_UNITS, &units_max);
    if (words >= (uint64_t)table_max || words >= INT32_MAX || (uint32_t)units_max < LW_GL_FINE_TILES_UNITS)
        return 0;
    uint32_t count = tiles < slots_max ? tiles : slots_max;
    if (count > (uint32_t)layers_max) count = (uint32_t)layers_max;
    return count;
}

static GLuint make_pool(uint32_t slots, const struct lw_gl_texels *texels) {
    GLuint pool;
    lw_gl_texture_smooth(GL_TEXTURE_2D_ARRAY, &pool);
    glTexImage3D(GL_TEXTURE_2D_ARRAY, 0, texels->kept, (GLsizei)SIDE, (GLsizei)SIDE, (GLsizei)slots, 0,
                 texels->format, texels->type, NULL);
    return pool;
}

/* All slots are to be filled again. */
static void forget_texels(struct lw_gl_fine_tiles *fine) {
    for (uint32_t i = 0; i < fine->slot_count; i++) {
        memset(fine->slot[i].version, 0, sizeof fine->slot[i].version);
        fine->slot[i].is_filled = false;
    }
}

void lw_gl_fine_tiles_add_directions(struct lw_gl_fine_tiles *fine) {
    if (!fine->pool) return;
    fine->directions = make_pool(fine->slot_count, &lw_gl_texels_directions);
    forget_texels(fine);
}

enum lw_status lw_gl_fine_tiles_init(struct lw_gl_fine_tiles *fine, const struct lw_atlas_map *map,
                                     uint32_t slots_max, struct lw_error *err) {
    LW_INVARIANT(slots_max <= LW_GL_FINE_TILES_MAX);
    *fine = (struct lw_gl_fine_tiles){.map = map};
    if (lw_atlas_map_room(map) == 0) return LW_OK;
    const uint32_t count = count_slots(map, slots_max);
    if (count == 0) return LW_OK;
    fine->slot = calloc(count, sizeof *fine->slot);
    fine->in_pool = calloc(map->object_count + 1ul, sizeof *fine->in_pool);
    fine->wanted = calloc(lw_atlas_map_room(map), sizeof *fine->wanted);
    fine->word = calloc(lw_atlas_map_room(map), sizeof *fine->word);
    fine->texels = calloc((size_t)SIDE * SIDE, sizeof *fine->texels);
    enum lw_status status = LW_OK;
    if (!fine->slot || !fine->in_pool || !fine->wanted || !fine->word || !fine->texels)
        status = lw_status_fail(err, LW_NO_MEMORY, "no memory for the light of the view");
    if (status == LW_OK) {
        fine->slot_count = count;
        fine->pool = make_pool(count, &lw_gl_texels_light);
        status = lw_gl_program_check("lightmaps of finer levels", err);
    }
    if (status != LW_OK) lw_gl_fine_tiles_finish(fine);
    return status;
}

void lw_gl_fine_tiles_finish(struct lw_gl_fine_tiles *fine) {
    if (fine->pool) glDeleteTextures(1, &fine->pool);
    if (fine->directions) glDeleteTextures(1, &fine->directions);
    free(fine->texels);
    free(fine->word);
    free(fine->wanted);
    free(fine->in_pool);
    free(fine->slot);
    *fine = (struct lw_gl_fine_tiles){0};
}

/* ---- one slot ---- */

/* A tile, or a neighbour that its border is of. */
struct part {
    struct lw_client_tile is; /* version 0: it is not there */
    uint32_t width;           /* texels */
};

static void find_parts(const struct lw_gl_fine_tiles *fine, const struct lw_compose_source *source,
                       const struct lw_tile_place *p, struct part out[PARTS]) {
    for (uint32_t i = 0; i < PARTS; i++) {
        const lw_tile_id id =
            lw_atlas_map_find(fine->map, p->object, p->level, p->x + (i & 1), p->y + (i >> 1));
        out[i] = (struct part){.width = 0};
        if (id.v == UINT32_MAX) continue;
        out[i] = (struct part){source->tile(source->context, id), fine->map->place[id.v].width};
        if (!out[i].is.rgb) out[i].is.version = 0;
    }
}

static void versions_of(const struct part part[PARTS], uint64_t out[PARTS]) {
    for (uint32_t i = 0; i < PARTS; i++) out[i] = lw_client_tile_changes(&part[i].is);
}

/* Packs a tile and its border. Where a neighbour lacks, the edge stands in for it in look-ups between the
 * two. */
static void pack(struct lw_gl_fine_tiles *fine, const struct lw_tile_place *p, const struct part part[PARTS],
                 bool directions) {
    static const float unknown[3] = {0};
    uint32_t *out = fine->texels;
    for (uint32_t y = 0; y <= p->height; y++)
        for (uint32_t x = 0; x <= p->width; x++) {
            const uint32_t at = (x == p->width ? RIGHT : 0u) + (y == p->height ? BELOW : 0u);
            const bool there = part[at].is.version != 0;
            const struct part *from = &part[there ? at : SELF];
            const uint32_t sx = x < p->width ? x
                                : there      ? 0
                                             : x - 1,
                           sy = y < p->height ? y
                                : there       ? 0
                                              : y - 1;
            const size_t texel = 3 * ((size_t)sy * from->width + sx);
            *out++ = !directions
                         ? lw_gl_rgb9e5_pack(from->is.rgb + texel, fine->scale)
                         : lw_gl_rgb10_pack(from->is.direction ? from->is.direction + texel : unknown);
        }
}

static bool upload(struct lw_gl_fine_tiles *fine, const struct lw_compose_source *source, uint32_t slot,
                   uint32_t tile) {
    const struct lw_tile_place *p = &fine->map->place[tile];
    struct part part[PARTS];
    find_parts(fine, source, p, part);
    if (!part[SELF].is.version) return false;
    versions_of(part, fine->slot[slot].version);
    for (int k = 0; k < (fine->directions ? 2 : 1); k++) {
        const struct lw_gl_texels *texels = k ? &lw_gl_texels_directions : &lw_gl_texels_light;
        pack(fine, p, part, k == 1);
        glBindTexture(GL_TEXTURE_2D_ARRAY, k ? fine->directions : fine->pool);
        glTexSubImage3D(GL_TEXTURE_2D_ARRAY, 0, 0, 0, (GLint)slot, (GLsizei)p->width + 1,
                        (GLsizei)p->height + 1, 1, texels->format, texels->type, fine->texels);
    }
    fine->slot[slot].is_filled = true;
    fine->uploaded++;
    return true;
}

/* ---- all of them ---- */

/* One call of lw_gl_fine_tiles_take(). */
struct call {
    struct lw_gl_fine_tiles *fine;
    const struct lw_gl_fine_tiles_take *take;
    float step;          /* by which shares move */
    uint32_t tiles_left; /* uploads that are still allowed */
    uint32_t oldest;     /* the slot whose tile was wanted least recently; NONE: not known */
    bool changed;
};

static uint32_t wanted(const struct lw_gl_fine_tiles *fine, uint32_t tile) {
    return fine->wanted[tile - fine->map->plain_count];
}

/* Whether views read a tile (compose.c: read_finer). */
static bool is_read(const struct call *c, uint32_t tile) {
    const struct lw_client_tile is = c->take->source->tile(c->take->source->context, (lw_tile_id){tile});
    return is.version != 0 && is.rgb &&
           (c->take->unfiltered || lw_atlas_noise_level_min(is.error, c->take->source->noise_shown) == 0);
}

static void set_word(struct call *c, struct lw_gl_fine_slot *s, uint16_t word) {
    if (s->tile != NONE) c->fine->word[s->tile - c->fine->map->plain_count] = word;
    if (s->word == word) return;
    s->word = word;
    c->changed = true;
    if (!c->take->table) return;
    glBindBuffer(GL_TEXTURE_BUFFER, c->take->table);
    glBufferSubData(GL_TEXTURE_BUFFER, (GLintptr)((c->fine->map->plain_count + s->name) * sizeof word),
                    sizeof word, &word);
}

static void write_word(struct call *c, uint32_t slot) {
    struct lw_gl_fine_slot *s = &c->fine->slot[slot];
    const uint32_t share = (uint32_t)(s->share * (float)LW_GL_FINE_TILES_WHOLE + 0.5f);
    set_word(c, s, (uint16_t)((slot + 1) | share << LW_GL_FINE_TILES_SHIFT));
}

static void empty_slot(struct call *c, uint32_t slot) {
    struct lw_gl_fine_slot *s = &c->fine->slot[slot];
    LW_INVARIANT(s->is_used && c->fine->used > 0);
    set_word(c, s, 0);
    c->fine->in_pool[s->place.object]--;
    c->fine->used--;
    *s = (struct lw_gl_fine_slot){.is_used = false};
}

/* A share that turns round moves from the next call on, since no picture was drawn after the last call. */
static void fade(const struct call *c, struct lw_gl_fine_slot *s, bool stays) {
    const float step = stays == s->leaves && c->take->now_ns ? 0 : c->step;
    s->leaves = !stays;
    s->share += stays ? step : -step;
    s->share = s->share < 1 ? s->share : 1;
}

/* Uploads a slot whose tile is there, if that has changed. Returns whether it still waits for that. */
static bool refresh(struct call *c, uint32_t slot) {
    const struct lw_gl_fine_slot *s = &c->fine->slot[slot];
    uint64_t version[PARTS];
    struct part part[PARTS];
    find_parts(c->fine, c->take->source, &s->place, part);
    versions_of(part, version);
    if (memcmp(version, s->version, sizeof version) == 0) return false;
    if (c->tiles_left == 0 || !upload(c->fine, c->take->source, slot, s->tile)) return true;
    c->tiles_left--;
    return false;
}

/* Brings a slot up to date, and moves its share on. A tile that is there no more fades out with the texels
 * that the slot has. If it comes back before its share is 0, it is uploaded again. */
static void follow_slot(struct call *c, uint32_t slot) {
    struct lw_gl_fine_slot *s = &c->fine->slot[slot];
    const struct lw_tile_place *p = &s->place;
    s->tile = lw_atlas_map_find(c->fine->map, p->object, p->level, p->x, p->y).v;
    const bool stays = s->tile != NONE && is_read(c, s->tile);
    fade(c, s, stays);
    if (!stays && (s->share <= 0 || !s->is_filled)) {
        empty_slot(c, slot);
        return;
    }
    if (!stays) memset(s->version, 0, sizeof s->version);
    const bool late = stays && refresh(c, slot);
    c->fine->waiting += late || !stays || s->share < 1;
    write_word(c, slot);
}

/* Free slots go first, then those whose tiles fade out. */
static int64_t priority_of(const struct lw_gl_fine_tiles *fine, const struct lw_gl_fine_slot *s) {
    if (!s->is_used) return -2;
    LW_INVARIANT(s->leaves || s->tile != NONE);
    return s->leaves ? -1 : (int64_t)wanted(fine, s->tile);
}

/* The slot of the lowest priority. */
static uint32_t find_oldest(struct call *c) {
    const struct lw_gl_fine_tiles *fine = c->fine;
    if (c->oldest != NONE) return c->oldest;
    int64_t lowest = INT64_MAX;
    for (uint32_t i = 0; i < fine->slot_count && lowest > -2; i++) {
        const int64_t priority = priority_of(fine, &fine->slot[i]);
        if (priority >= lowest) continue;
        lowest = priority;
        c->oldest = i;
    }
    return c->oldest;
}

/* Puts a tile into the pool, if there is a place for it. */
static void add(struct call *c, uint32_t tile) {
    struct lw_gl_fine_tiles *fine = c->fine;
    const uint32_t slot = find_oldest(c);
    struct lw_gl_fine_slot *s = &fine->slot[slot];
    if ((int64_t)wanted(fine, tile) <= priority_of(fine, s)) return;
    if (c->tiles_left == 0) {
        fine->waiting++;
        return;
    }
    if (s->is_used) empty_slot(c, slot);
    if (!upload(fine, c->take->source, slot, tile)) return;
    c->oldest = NONE;
    c->tiles_left--;
    s->is_used = true;
    s->tile = tile;
    s->place = fine->map->place[tile];
    s->name = lw_atlas_map_name(fine->map, (lw_tile_id){tile});
    s->share = c->take->now_ns ? 0 : 1;
    fine->used++;
    fine->in_pool[s->place.object]++;
    fine->waiting += s->share < 1;
    write_word(c, slot);
}

static float step_since(uint64_t then_ns, uint64_t now_ns) {
    const uint64_t past_ns = now_ns > then_ns ? now_ns - then_ns : 0;
    return now_ns && past_ns < LW_GL_FINE_TILES_FADE ? (float)past_ns / (float)LW_GL_FINE_TILES_FADE : 1;
}

/* All tiles that are seen have one scale. */
static void rescale(struct call *c) {
    c->fine->scale = c->take->scale;
    c->tiles_left = UINT32_MAX;
    forget_texels(c->fine);
}

bool lw_gl_fine_tiles_take(struct lw_gl_fine_tiles *fine, const struct lw_gl_fine_tiles_take *take) {
    if (!fine->pool) return false;
    struct call c = {.fine = fine,
                     .take = take,
                     .step = step_since(fine->moved_ns, take->now_ns),
                     .tiles_left = take->tiles_max,
                     .oldest = NONE};
    fine->moved_ns = take->now_ns;
    fine->waiting = 0;
    if (take->scale != fine->scale) rescale(&c);
    glPixelStorei(GL_UNPACK_ALIGNMENT, 4);
    memset(fine->word, 0, lw_atlas_map_room(fine->map) * sizeof *fine->word);
    for (uint32_t i = 0; i < fine->slot_count; i++)
        if (fine->slot[i].is_used) follow_slot(&c, i);
    for (uint32_t t = fine->map->plain_count; t < fine->map->tile_count; t++)
        if (fine->word[t - fine->map->plain_count] == 0 && is_read(&c, t)) add(&c, t);
    LW_INVARIANT(fine->used <= fine->slot_count);
    return c.changed;
}

void lw_gl_fine_tiles_survey(struct lw_gl_fine_tiles *fine) { fine->survey++; }

void lw_gl_fine_tiles_want(struct lw_gl_fine_tiles *fine, lw_tile_id tile) {
    LW_INVARIANT(!fine->pool || tile.v < fine->map->tile_count);
    if (fine->pool && tile.v >= fine->map->plain_count)
        fine->wanted[tile.v - fine->map->plain_count] = fine->survey;
}
