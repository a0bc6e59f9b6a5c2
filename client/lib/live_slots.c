#include "client/lib/live_slots.h"

#include "common/base/invariant.h"

#include <stdlib.h>
#include <string.h>

/* The tile of a slot, and those to the right, below, and below to the right, of which it has the border. */
enum { SELF, RIGHT, BELOW, CORNER, PARTS };

struct lw_live_slots_one {
    bool used, leaves; /* leaves: its share falls */
    bool is_reported;  /* the engine has texels of it */
    bool was_before;   /* the engine does not know yet that `before` is gone */
    struct lw_tile_place place, before;
    uint64_t page, page_before;
    float share, share_reported;
    uint64_t version[PARTS]; /* as last reported with has_texels */
};

enum lw_status lw_live_slots_init(struct lw_live_slots *slots, const struct lw_live_tiles *tiles,
                                  uint32_t count) {
    *slots = (struct lw_live_slots){.tiles = tiles};
    if (!count || !lw_atlas_map_room(tiles->map)) return LW_OK;
    slots->slot = calloc(count, sizeof *slots->slot);
    slots->placed = calloc(lw_atlas_map_room(tiles->map), sizeof *slots->placed);
    if (!slots->slot || !slots->placed) {
        lw_live_slots_finish(slots);
        return LW_NO_MEMORY;
    }
    slots->count = count;
    return LW_OK;
}

void lw_live_slots_finish(struct lw_live_slots *slots) {
    free(slots->slot);
    free(slots->placed);
    *slots = (struct lw_live_slots){0};
}

/* ---- one slot ---- */

static lw_tile_id find(const struct lw_live_slots *slots, const struct lw_tile_place *p, uint32_t part) {
    return lw_atlas_map_find(slots->tiles->map, p->object, p->level, p->x + (part & 1), p->y + (part >> 1));
}

static uint64_t changes_of(const struct lw_live_tiles *tiles, lw_tile_id id) {
    const struct lw_client_tile known = lw_client_get_tile(tiles->client, id);
    return lw_client_tile_changes(&known);
}

/* What the texels of a part are of: those of its tile, or where that is not there of level 0 below it. */
static uint64_t version_of(const struct lw_live_slots *slots, const struct lw_tile_place *p, uint32_t part) {
    const struct lw_live_tiles *tiles = slots->tiles;
    const lw_tile_id id = find(slots, p, part);
    if (id.v != UINT32_MAX && lw_live_tiles_reads_fine(tiles, id)) return 2 * changes_of(tiles, id) + 1;
    const uint32_t k = lw_atlas_finer(p->level);
    const lw_tile_id below =
        lw_atlas_map_find(tiles->map, p->object, 0, (p->x + (part & 1)) >> k, (p->y + (part >> 1)) >> k);
    return below.v != UINT32_MAX ? 2 * changes_of(tiles, below) : 0;
}

/* A share that turns moves from the next call on: nobody has drawn since the last call. */
static void fade(struct lw_live_slots_one *s, bool stays, float step, bool fades) {
    const bool turns = stays == s->leaves;
    s->leaves = !stays;
    if (!s->is_reported || (turns && fades)) return;
    s->share += stays ? step : -step;
    s->share = s->share < 1 ? s->share : 1;
}

static void empty(struct lw_live_slots *slots, struct lw_live_slots_one *s) {
    LW_INVARIANT(s->used && slots->used > 0);
    if (s->is_reported) {
        s->was_before = true;
        s->before = s->place;
        s->page_before = s->page;
    }
    s->used = s->is_reported = false;
    slots->used--;
}

/* Moves the share of a slot on. */
static void update_share(struct lw_live_slots *slots, struct lw_live_slots_one *s, float step, bool fades) {
    const struct lw_atlas_map *map = slots->tiles->map;
    const lw_tile_id id = find(slots, &s->place, SELF);
    const bool stays = id.v != UINT32_MAX && lw_live_tiles_reads_fine(slots->tiles, id);
    fade(s, stays, step, fades);
    if (!stays && (s->share <= 0 || !s->is_reported))
        empty(slots, s);
    else if (id.v != UINT32_MAX)
        slots->placed[id.v - map->plain_count] = 1;
}

static void occupy(struct lw_live_slots *slots, struct lw_live_slots_one *s, lw_tile_id id, bool fades) {
    LW_INVARIANT(!s->used);
    s->used = true;
    s->leaves = s->is_reported = false;
    s->place = slots->tiles->map->place[id.v];
    s->page = lw_atlas_map_name(slots->tiles->map, id);
    s->share = fades ? 0 : 1;
    slots->used++;
}

/* Puts tiles that have no slot into those that are free. */
static void place_all(struct lw_live_slots *slots, bool fades) {
    const struct lw_atlas_map *map = slots->tiles->map;
    uint32_t at = 0;
    for (uint32_t t = map->plain_count; t < map->tile_count && slots->used < slots->count; t++) {
        const lw_tile_id id = {t};
        if (slots->placed[t - map->plain_count] || !lw_atlas_map_is_used(map, id) ||
            !lw_live_tiles_reads_fine(slots->tiles, id))
            continue;
        while (slots->slot[at].used) at++;
        occupy(slots, &slots->slot[at], id, fades);
    }
}

/* ---- reports to the engine ---- */

struct report {
    struct lw_live_slot *out;
    size_t count, capacity, tiles_left;
};

/* A tile with the column and the row beside it, as far as the level goes. */
static struct lw_live_rect rect_of(const struct lw_live_slots *slots, const struct lw_tile_place *p) {
    const struct lw_atlas_level *level = lw_atlas_level(slots->tiles->map->atlas[p->object], p->level);
    const uint32_t x = p->x * LW_TILE_SIDE, y = p->y * LW_TILE_SIDE;
    return (struct lw_live_rect){.object = p->object,
                                 .level = p->level,
                                 .x = x,
                                 .y = y,
                                 .width = p->width + (x + p->width < level->width),
                                 .height = p->height + (y + p->height < level->height)};
}

/* false: there is no more room. */
static bool report_gone(const struct lw_live_slots *slots, struct report *t, uint32_t slot) {
    struct lw_live_slots_one *s = &slots->slot[slot];
    if (!s->was_before) return true;
    if (t->count == t->capacity) return false;
    t->out[t->count++] =
        (struct lw_live_slot){.slot = slot, .page = s->page_before, .rect = rect_of(slots, &s->before)};
    s->was_before = false;
    return true;
}

/* false: there is more to report. */
static bool report(const struct lw_live_slots *slots, struct report *t, uint32_t slot) {
    struct lw_live_slots_one *s = &slots->slot[slot];
    if (!report_gone(slots, t, slot)) return false;
    if (!s->used) return true;
    uint64_t version[PARTS];
    for (uint32_t i = 0; i < PARTS; i++) version[i] = version_of(slots, &s->place, i);
    const bool late = !s->leaves && (!s->is_reported || memcmp(version, s->version, sizeof version) != 0),
               reads = late && t->tiles_left > 0, moved = s->is_reported && s->share != s->share_reported;
    if (!reads && !moved) return !late;
    if (t->count == t->capacity) return false;
    t->out[t->count++] = (struct lw_live_slot){.slot = slot,
                                               .has_texels = reads,
                                               .page = s->page,
                                               .rect = rect_of(slots, &s->place),
                                               .share = s->share};
    s->share_reported = s->share;
    if (!reads) return !late;
    s->is_reported = true;
    memcpy(s->version, version, sizeof version);
    t->tiles_left--;
    return true;
}

static float step_since(uint64_t then_ns, uint64_t now_ns) {
    const uint64_t past_ns = now_ns > then_ns ? now_ns - then_ns : 0;
    return now_ns && past_ns < LW_LIVE_SLOTS_FADE ? (float)past_ns / (float)LW_LIVE_SLOTS_FADE : 1;
}

size_t lw_live_slots_take(struct lw_live_slots *slots, uint64_t now_ns, size_t tiles_max,
                          struct lw_live_slot *out_slot, size_t capacity) {
    if (!slots->count) return 0;
    const float step = step_since(slots->moved_ns, now_ns);
    const bool fades = now_ns != 0;
    slots->moved_ns = now_ns;
    memset(slots->placed, 0, lw_atlas_map_room(slots->tiles->map));
    for (uint32_t i = 0; i < slots->count; i++)
        if (slots->slot[i].used) update_share(slots, &slots->slot[i], step, fades);
    place_all(slots, fades);
    LW_INVARIANT(slots->used <= slots->count);
    struct report t = {out_slot, 0, capacity, tiles_max ? tiles_max : SIZE_MAX};
    uint32_t next = UINT32_MAX;
    slots->waiting = 0;
    for (uint32_t i = 0; i < slots->count; i++) {
        const uint32_t slot = (slots->next + i) % slots->count;
        const bool all = report(slots, &t, slot);
        const struct lw_live_slots_one *s = &slots->slot[slot];
        slots->waiting += !all || (s->used && (s->leaves || s->share < 1));
        if (!all && next == UINT32_MAX) next = slot;
    }
    slots->next = next == UINT32_MAX ? slots->next : next; /* the first that waits goes first */
    return t.count;
}
