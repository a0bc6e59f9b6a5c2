#include "server/solve/sparse_solver.h"

#include "common/base/invariant.h"
#include "server/solve/coarse_tiles.h"
#include "server/solve/surface/saved_texels.h"

#include <omp.h>
#include <stdlib.h>
#include <string.h>

#define NONE UINT32_MAX
/* Views that want level 2 or a coarser one read the coarse scene. */
#define LEVEL_SPARSE_MAX (LW_COARSE_SCENE_SHIFT - 1)

_Static_assert(LW_ATLAS_FINER_MAX + LW_COARSE_SCENE_SHIFT <= LW_ATLAS_FINER_ALL, "the coarse scene has all");

/* A tile of the scene's level 0 or of a finer one. */
struct tile {
    uint32_t inner; /* its id in the inner map; NONE: it has none */
    uint64_t since; /* the frame in which is_read has changed; 0: it never has */
};

struct sparse {
    struct lw_solver base;
    const struct lw_scene *scene;   /* the caller's */
    const struct lw_atlas_map *map; /* the caller's */
    struct lw_coarse_scene coarse_scene;
    struct lw_atlas_map inner_map; /* the coarse scene's, with finer levels */
    struct lw_solver *inner;
    struct lw_coarse_tiles coarse; /* tiles of level 0 that are not read */
    struct tile *tile;             /* per id of `map` */
    uint8_t *is_read;              /* per id of level 0 of `map`: it is read, and not the coarse light */
    uint32_t *outer;               /* per id of a finer level of inner_map: the id in `map` */
    uint8_t *interest;             /* per id of inner_map */
    lw_tile_id *listed;            /* scratch of list_fine() */
    uint32_t channels;
    bool is_coarse_due; /* coarse tiles may lack light or a channel */
};

static uint32_t room(const struct sparse *s) { return lw_atlas_map_room(&s->inner_map); }

/* ---- interest ---- */

static void want_coarse(const struct sparse *s, uint8_t *interest, const struct lw_tile_place *place,
                        uint8_t finest) {
    const uint8_t level = finest > LW_COARSE_SCENE_SHIFT ? finest - LW_COARSE_SCENE_SHIFT : 1;
    uint8_t *below = &interest[lw_coarse_scene_below(&s->inner_map, place).v];
    if (!*below || level < *below) *below = level;
}

/* Gives a tile an id in the inner map, where it has none or has that of another tile. */
static void want_sparse(struct sparse *s, uint8_t *interest, uint32_t id, uint8_t turn) {
    const struct lw_tile_place *place = &s->map->place[id];
    const uint32_t level = LW_ATLAS_FINER + LW_COARSE_SCENE_SHIFT + lw_atlas_finer(place->level);
    const lw_tile_id inner = lw_atlas_map_claim(&s->inner_map, place->object, level, place->x, place->y);
    if (inner.v == NONE) return; /* it stays coarse */
    interest[inner.v] = turn;
    s->tile[id].inner = inner.v;
    s->outer[inner.v - s->inner_map.plain_count] = id;
}

static enum lw_status set_interest(struct lw_solver *solver, const uint8_t *interest, struct lw_error *err) {
    struct sparse *s = (struct sparse *)solver;
    uint8_t *inner = calloc(s->inner_map.tile_count + 1ul, 1);
    if (!inner) return lw_status_fail(err, LW_NO_MEMORY, "interest");
    for (uint32_t id = 0; interest && id < s->map->tile_count; id++) {
        const struct lw_tile_place *place = &s->map->place[id];
        const bool is_fine = id >= s->map->plain_count;
        if (!interest[id] || (!is_fine && place->level)) continue;
        want_coarse(s, inner, place, is_fine ? 1 : interest[id]);
        if (is_fine || interest[id] <= 1 + LEVEL_SPARSE_MAX)
            want_sparse(s, inner, id, is_fine ? interest[id] : 1);
    }
    const enum lw_status status = s->inner->ops->set_interest(s->inner, interest ? inner : NULL, err);
    if (status != LW_OK) {
        free(inner); /* ids that nobody wants are free with the next frame */
        return status;
    }
    free(s->interest);
    s->interest = inner;
    return LW_OK;
}

/* Ids of tiles that are neither wanted nor held are free again. */
static void release_ids(struct sparse *s) {
    const uint32_t plain = s->inner_map.plain_count;
    for (uint32_t k = 0; k < room(s); k++) {
        const lw_tile_id id = {plain + k};
        if (s->outer[k] == NONE || s->interest[id.v] || s->inner->ops->holds_fine(s->inner, id)) continue;
        if (s->tile[s->outer[k]].inner == id.v) s->tile[s->outer[k]].inner = NONE;
        s->outer[k] = NONE;
        lw_atlas_map_release(&s->inner_map, id);
    }
}

/* ---- frames ---- */

static bool holds(const struct sparse *s, uint32_t id) {
    const uint32_t inner = s->tile[id].inner;
    return inner != NONE && s->inner->ops->holds_fine(s->inner, (lw_tile_id){inner});
}

static bool is_ready(const struct sparse *s, lw_tile_id inner) {
    struct lw_solver_tile tile;
    s->inner->ops->read_tile(s->inner, inner, &tile);
    return tile.solved_frame && lw_coarse_tiles_end(&tile);
}

static enum lw_status update_coarse(struct sparse *s) {
    const enum lw_status status = lw_coarse_tiles_update(&s->coarse, s->inner, s->channels, s->is_read);
    s->is_coarse_due = status != LW_OK;
    return status;
}

/* Which tiles of level 0 are read from now on. Returns how many are read otherwise than before. */
static uint32_t choose_tiles(struct sparse *s, uint64_t number) {
    uint32_t changed = 0;
    for (uint32_t id = 0; id < s->map->plain_count; id++) {
        struct tile *tile = &s->tile[id];
        const bool is_read = holds(s, id) && is_ready(s, (lw_tile_id){tile->inner});
        if (is_read == s->is_read[id]) continue;
        s->is_read[id] = is_read;
        tile->since = number;
        if (is_read) lw_coarse_tiles_forget(&s->coarse, (lw_tile_id){id});
        changed++;
    }
    return changed;
}

static enum lw_status frame(struct lw_solver *solver, const struct lw_pose *pose, uint64_t number,
                            struct lw_solver_stats *out_stats, struct lw_error *err) {
    struct sparse *s = (struct sparse *)solver;
    lw_coarse_scene_follow(&s->coarse_scene.scene, s->scene);
    release_ids(s);
    enum lw_status status = s->inner->ops->frame(s->inner, pose, number, out_stats, err);
    if (status != LW_OK) return status;
    out_stats->tiles_shown += choose_tiles(s, number);
    if (!out_stats->tiles_shown && !s->is_coarse_due) return LW_OK; /* at rest */
    status = update_coarse(s);
    return status == LW_OK ? LW_OK : lw_status_fail(err, status, "tiles of coarse light");
}

/* ---- reading ---- */

static void read_tile(const struct lw_solver *solver, lw_tile_id id, struct lw_solver_tile *out_tile) {
    const struct sparse *s = (const struct sparse *)solver;
    const struct tile *tile = &s->tile[id.v];
    const bool plain = id.v < s->map->plain_count;
    if (plain && !s->is_read[id.v])
        lw_coarse_tiles_read(&s->coarse, id, out_tile);
    else
        s->inner->ops->read_tile(s->inner, (lw_tile_id){tile->inner}, out_tile);
    if (plain && out_tile->solved_frame < tile->since) out_tile->solved_frame = tile->since;
}

static void read_planes(const struct lw_solver *solver, lw_tile_id id, struct lw_solver_room *room,
                        struct lw_solver_tile *read_tile) {
    const struct sparse *s = (const struct sparse *)solver;
    lw_coarse_tiles_read_planes(&s->coarse, s->inner, id, room, read_tile);
}

static uint32_t list_fine(const struct lw_solver *solver, const lw_tile_id **out_tile) {
    const struct sparse *s = (const struct sparse *)solver;
    const lw_tile_id *inner;
    uint32_t count = 0;
    for (uint32_t i = 0, n = s->inner->ops->list_fine(s->inner, &inner); i < n; i++) {
        const uint32_t id = s->outer[inner[i].v - s->inner_map.plain_count];
        const bool is_finer = id >= s->map->plain_count && s->tile[id].inner == inner[i].v;
        if (is_finer && is_ready(s, inner[i])) s->listed[count++].v = id;
    }
    qsort(s->listed, count, sizeof *s->listed, lw_tile_id_compare);
    *out_tile = s->listed;
    return count;
}

static bool holds_fine(const struct lw_solver *solver, lw_tile_id id) {
    return holds((const struct sparse *)solver, id.v);
}

/* ---- the rest of solver.h ---- */

static void choose_channels(struct lw_solver *solver, uint32_t channels) {
    struct sparse *s = (struct sparse *)solver;
    s->is_coarse_due |= channels != s->channels;
    s->channels = channels;
    s->inner->ops->choose_channels(s->inner, channels);
}

static enum lw_status filter(struct lw_solver *solver, struct lw_error *err) {
    struct sparse *s = (struct sparse *)solver;
    const enum lw_status status = s->inner->ops->filter(s->inner, err);
    return status == LW_OK ? update_coarse(s) : status;
}

static enum lw_status save(const struct lw_solver *solver, const char *path, const uint8_t key[16],
                           struct lw_error *err) {
    const struct sparse *s = (const struct sparse *)solver;
    uint8_t changed[16];
    lw_coarse_scene_key(key, changed);
    return s->inner->ops->save(s->inner, path, changed, err);
}

static enum lw_status load(struct lw_solver *solver, const char *path, const uint8_t key[16],
                           uint64_t *out_frames, struct lw_error *err) {
    struct sparse *s = (struct sparse *)solver;
    uint8_t changed[16];
    lw_coarse_scene_key(key, changed);
    const enum lw_status status = s->inner->ops->load(s->inner, path, changed, out_frames, err);
    return status == LW_OK ? update_coarse(s) : status;
}

static size_t memory_bytes(const struct lw_solver *solver) {
    const struct sparse *s = (const struct sparse *)solver;
    return s->inner->ops->memory_bytes(s->inner) + lw_coarse_tiles_memory_bytes(&s->coarse) +
           s->map->tile_count * (sizeof *s->tile + sizeof *s->is_read) + s->inner_map.tile_count +
           room(s) * (sizeof *s->outer + sizeof *s->listed);
}

static void destroy(struct lw_solver *solver) {
    struct sparse *s = (struct sparse *)solver;
    if (!s) return;
    if (s->inner) s->inner->ops->destroy(s->inner);
    lw_coarse_tiles_finish(&s->coarse);
    lw_atlas_map_finish(&s->inner_map);
    lw_coarse_scene_finish(&s->coarse_scene);
    free(s->tile);
    free(s->is_read);
    free(s->outer);
    free(s->interest);
    free(s->listed);
    free(s);
}

static const struct lw_solver_ops ops = {.name = "sparse",
                                         .frame = frame,
                                         .set_interest = set_interest,
                                         .choose_channels = choose_channels,
                                         .filter = filter,
                                         .list_fine = list_fine,
                                         .holds_fine = holds_fine,
                                         .read_tile = read_tile,
                                         .read_planes = read_planes,
                                         .save = save,
                                         .load = load,
                                         .memory_bytes = memory_bytes,
                                         .destroy = destroy};

/* ---- creation ---- */

/* As many ids as there may be wanted tiles. */
static enum lw_status make_map(struct sparse *s) {
    uint32_t ids = lw_atlas_map_room(s->map);
    for (uint32_t id = 0; id < s->map->plain_count; id++) ids += s->map->place[id].level == 0;
    return lw_atlas_map_init_finer(&s->inner_map, &s->coarse_scene.scene,
                                   s->map->finer_count + LW_COARSE_SCENE_SHIFT, ids);
}

static enum lw_status make_room(struct sparse *s, int threads) {
    s->tile = calloc(s->map->tile_count + 1ul, sizeof *s->tile);
    s->is_read = calloc(s->map->tile_count + 1ul, sizeof *s->is_read);
    s->outer = malloc((room(s) + 1ul) * sizeof *s->outer);
    s->listed = malloc((room(s) + 1ul) * sizeof *s->listed);
    s->interest = calloc(s->inner_map.tile_count + 1ul, 1);
    if (!s->tile || !s->is_read || !s->outer || !s->listed || !s->interest) return LW_NO_MEMORY;
    for (uint32_t id = 0; id < s->map->tile_count; id++) s->tile[id].inner = NONE;
    for (uint32_t k = 0; k < room(s); k++) s->outer[k] = NONE;
    return lw_coarse_tiles_init(&s->coarse, s->map, &s->coarse_scene.map, false, threads);
}

static enum lw_status build_inner(struct sparse *s, const struct lw_solvers_entry *entry,
                                  const struct lw_solver_desc *desc, const struct lw_pose *pose,
                                  struct lw_error *err) {
    struct lw_solver_desc inner = *desc;
    struct lw_saved_texels saved;
    inner.scene = &s->coarse_scene.scene;
    inner.atlas_map = &s->inner_map;
    inner.fine_when = LW_FINE_AFTER_FRAMES; /* noise of the coarse scene is no reason to read it */
    if (desc->saved_texels) {
        saved = *desc->saved_texels;
        lw_coarse_scene_key(desc->saved_texels->key, saved.key);
        inner.saved_texels = &saved;
    }
    return entry->create(&inner, pose, &s->inner, err);
}

enum lw_status lw_sparse_solver_create(const struct lw_solvers_entry *entry,
                                       const struct lw_solver_desc *desc, const struct lw_pose *pose,
                                       struct lw_solver **out_solver, struct lw_error *err) {
    const int threads = desc->threads ? (int)desc->threads : omp_get_max_threads();
    LW_INVARIANT(desc->fine_tiles > 0);
    struct sparse *s = calloc(1, sizeof *s);
    if (!s) return lw_status_fail(err, LW_NO_MEMORY, "solver");
    s->base.ops = &ops;
    s->scene = desc->scene;
    s->map = desc->atlas_map;
    s->channels = lw_tile_channel_bit(LW_TILE_CHANNEL_FULL);
    s->is_coarse_due = true;
    enum lw_status status = lw_coarse_scene_init(&s->coarse_scene, desc->scene);
    if (status == LW_OK) status = make_map(s);
    if (status == LW_OK) status = make_room(s, threads);
    if (status != LW_OK) lw_status_fail(err, status, "a coarse scene");
    if (status == LW_OK) status = build_inner(s, entry, desc, pose, err);
    if (status != LW_OK) {
        destroy(&s->base);
        return status;
    }
    *out_solver = &s->base;
    return LW_OK;
}
