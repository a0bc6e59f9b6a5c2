#include "server/solve/tile_by_tile.h"

#include "common/base/invariant.h"
#include "common/base/log.h"
#include "server/solve/coarse_tiles.h"
#include "server/solve/memory_forecast.h"
#include "server/solve/state/tile_file.h"

#include <math.h>
#include <omp.h>
#include <stdlib.h>
#include <string.h>

#define LEVEL (LW_ATLAS_FINER + LW_COARSE_SCENE_SHIFT)
/* A tile that gives its room to another keeps its id for that frame. */
#define ROOM (2 * LW_TILE_BY_TILE_AT_ONCE)

static const float black[LW_TILE_TEXELS_MAX];

/* A tile that is being lit. */
struct lit {
    uint32_t tile;   /* id in the caller's map */
    lw_tile_id fine; /* id in the coarse scene's map */
};

struct tile_by_tile {
    struct lw_solver base;
    const struct lw_atlas_map *map; /* the caller's */
    struct lw_tile_by_tile_desc how;
    struct lw_coarse_scene coarse_scene;
    struct lw_atlas_map fine_map; /* the coarse scene's, with finer levels */
    struct lw_solver *solver;     /* the coarse scene's */
    uint32_t aim_frames;
    float aim_error;
    bool is_coarse_lit, is_saved; /* the coarse scene has converged; is in a checkpoint since */
    uint64_t number;              /* the inner solver's last frame: it rises, even where nothing was solved */
    struct lit lit[LW_TILE_BY_TILE_AT_ONCE];
    uint32_t lit_count;
    uint32_t next, done, total; /* tiles of level 0: the next one to look at; finished; all */
    uint32_t finished;          /* tiles that this run has finished */
    double frames_sum;          /* their frames */
    uint8_t *interest;          /* per id of fine_map */
    lw_tile_id released[ROOM];  /* ids whose tiles the solver may still hold */
    uint32_t released_count;
    struct lw_tile_file file;
    struct lw_tile_file_tile *buffer; /* a tile that is written, or was read last */
    struct lw_coarse_tiles coarse;    /* one tile, which was read last */
    lw_tile_id coarse_tile;           /* {UINT32_MAX}: none */
    struct lw_packed_albedo *albedo;  /* albedo of the tile that was read last */
};

static uint32_t count_planes(const struct lw_tile_by_tile_desc *how) {
    uint32_t count = how->has_albedo ? 3 : 0;
    LW_TILE_CHANNELS_EACH (channel, how->channels) count += lw_tile_channel_at(channel)->planes;
    return count;
}

/* ---- finished tiles ---- */

static enum lw_status keep(struct tile_by_tile *s, uint32_t id, const struct lw_solver_tile *tile,
                           struct lw_error *err) {
    struct lw_tile_file_tile *to = s->buffer;
    const uint32_t texels = tile->width * tile->height;
    uint32_t plane = 0;
    memset(to, 0, offsetof(struct lw_tile_file_tile, plane));
    to->texels = texels;
    to->sample_count = tile->sample_count;
    to->bounces = tile->bounces;
    to->error = tile->error;
    to->aim_frames = s->aim_frames;
    to->aim_error = s->aim_error;
    memcpy(to->covered, tile->covered, texels);
    memcpy(to->filled, tile->filled, texels);
    LW_TILE_CHANNELS_EACH (channel, s->how.channels)
        for (uint32_t p = 0; p < lw_tile_channel_at(channel)->planes; p++)
            memcpy(to->plane[plane++], tile->shown[channel][p], texels * sizeof(float));
    for (uint32_t i = 0; i < texels && s->how.has_albedo; i++) {
        const struct lw_vec3 albedo = lw_packed_albedo_unpack(tile->albedo[i]);
        for (uint32_t c = 0; c < 3; c++) to->plane[plane + c][i] = (&albedo.x)[c];
    }
    return lw_tile_file_put(&s->file, id, to, err);
}

/* Whether the file has a tile that was solved as far as it is to be now. */
static bool is_kept(struct tile_by_tile *s, uint32_t id) {
    struct lw_error err = {0};
    if (!s->file.has[id]) return false;
    if (lw_tile_file_get(&s->file, id, s->buffer, &err) != LW_OK) {
        lw_log(LW_LOG_WARNING, "%s: it is lit again", err.text);
    } else if (s->aim_frames ? s->buffer->aim_frames >= s->aim_frames
                             : !s->buffer->aim_frames && s->buffer->aim_error <= s->aim_error) {
        return true;
    }
    lw_tile_file_forget(&s->file, id);
    return false;
}

/* Reads the coarse tile below a tile of the caller's map. Returns the coarse texel below its first one. */
static uint32_t read_below(const struct tile_by_tile *s, const struct lw_tile_place *place,
                           struct lw_solver_tile *out_tile) {
    const uint32_t side = LW_TILE_SIDE / LW_COARSE_SCENE_SIDE, x = place->x * side, y = place->y * side;
    s->solver->ops->read_tile(s->solver, lw_coarse_scene_below(&s->fine_map, place), out_tile);
    return y % LW_TILE_SIDE * out_tile->width + x % LW_TILE_SIDE;
}

/* ---- which tiles are lit ---- */

/* Whether light falls on something where a tile of the caller's map lies. */
static bool has_surface(const struct tile_by_tile *s, const struct lw_tile_place *place) {
    struct lw_solver_tile below;
    const uint32_t first = read_below(s, place, &below);
    for (uint32_t y = 0; y < place->height / LW_COARSE_SCENE_SIDE; y++)
        for (uint32_t x = 0; x < place->width / LW_COARSE_SCENE_SIDE; x++) {
            const uint32_t i = first + y * below.width + x;
            if (below.covered[i] || below.filled[i]) return true;
        }
    return false;
}

/* An id that the solver no longer needs is free again. */
static void release_ids(struct tile_by_tile *s) {
    uint32_t kept = 0;
    for (uint32_t i = 0; i < s->released_count; i++) {
        if (s->solver->ops->holds_fine(s->solver, s->released[i]))
            s->released[kept++] = s->released[i];
        else
            lw_atlas_map_release(&s->fine_map, s->released[i]);
    }
    s->released_count = kept;
}

/* Begins tiles while there is room. Returns whether there are others than before. */
static bool begin_tiles(struct tile_by_tile *s) {
    bool others = false;
    release_ids(s);
    for (; s->next < s->map->plain_count && s->lit_count < LW_TILE_BY_TILE_AT_ONCE; s->next++) {
        const struct lw_tile_place *place = &s->map->place[s->next];
        if (place->level) continue;
        if (is_kept(s, s->next) || !has_surface(s, place)) {
            s->done++;
            continue;
        }
        const lw_tile_id fine = lw_atlas_map_claim(&s->fine_map, place->object, LEVEL, place->x, place->y);
        if (fine.v == UINT32_MAX) break; /* in the next frame */
        s->interest[fine.v] = 1;
        s->lit[s->lit_count++] = (struct lit){s->next, fine};
        others = true;
    }
    return others;
}

static bool is_finished(const struct lw_solver_tile *tile) {
    return tile->solved_frame && (tile->converged || !tile->has_surface);
}

/* Writes tiles that have converged. *out_count: how many */
static enum lw_status end_tiles(struct tile_by_tile *s, uint32_t *out_count, struct lw_error *err) {
    uint32_t left = 0;
    *out_count = 0;
    for (uint32_t i = 0; i < s->lit_count; i++) {
        const struct lit lit = s->lit[i];
        struct lw_solver_tile tile = {.solved_frame = 0};
        if (s->solver->ops->holds_fine(s->solver, lit.fine))
            s->solver->ops->read_tile(s->solver, lit.fine, &tile);
        if (!is_finished(&tile)) {
            s->lit[left++] = lit;
            continue;
        }
        enum lw_status status = keep(s, lit.tile, &tile, err);
        if (status != LW_OK) return status;
        LW_INVARIANT(s->released_count < ROOM);
        s->interest[lit.fine.v] = 0;
        s->released[s->released_count++] = lit.fine;
        s->frames_sum += tile.sample_count;
        s->finished++;
        ++*out_count;
    }
    s->lit_count = left;
    s->done += *out_count;
    return LW_OK;
}

/* ---- frames ---- */

/* Texels times frames of tiles that nobody has begun: as many frames as those took that are finished. */
static double work_left(const struct tile_by_tile *s, double frames) {
    const double each = s->aim_frames       ? (double)s->aim_frames
                        : s->frames_sum > 0 ? s->frames_sum / s->finished
                                            : fmax(frames, LW_SOLVER_FRAMES_MIN);
    return each * LW_TILE_TEXELS_MAX * (double)(s->total - s->done - s->lit_count);
}

static enum lw_status coarse_frame(struct tile_by_tile *s, const struct lw_pose *pose,
                                   struct lw_solver_stats *out_stats, struct lw_error *err) {
    enum lw_status status = s->solver->ops->frame(s->solver, pose, s->number, out_stats, err);
    if (status != LW_OK) return status;
    s->is_coarse_lit = out_stats->tiles_converged == out_stats->tiles;
    if (s->is_coarse_lit) lw_log(LW_LOG_INFO, "the light between surfaces is there; now tile by tile");
    out_stats->texels_left += work_left(s, (double)s->number);
    return LW_OK;
}

static enum lw_status frame(struct lw_solver *solver, const struct lw_pose *pose, uint64_t number,
                            struct lw_solver_stats *out_stats, struct lw_error *err) {
    struct tile_by_tile *s = (struct tile_by_tile *)solver;
    uint32_t finished = 0;
    enum lw_status status = LW_OK;
    s->number = number > s->number ? number : s->number + 1;
    if (!s->is_coarse_lit) {
        status = coarse_frame(s, pose, out_stats, err);
    } else {
        const uint32_t done = s->done;
        if (begin_tiles(s)) status = s->solver->ops->set_interest(s->solver, s->interest, err);
        if (status == LW_OK) status = s->solver->ops->frame(s->solver, pose, s->number, out_stats, err);
        if (status == LW_OK) status = end_tiles(s, &finished, err);
        out_stats->texels_left += work_left(s, 0);
        out_stats->tiles_solved += s->done - done;
    }
    out_stats->tiles = s->total;
    out_stats->tiles_converged = s->done;
    return status;
}

/* ---- reading ---- */

static void read_kept(const struct tile_by_tile *s, lw_tile_id id, struct lw_solver_tile *out_tile) {
    const struct lw_tile_place *place = &s->map->place[id.v];
    const struct lw_tile_file_tile *from = s->buffer;
    uint32_t plane = 0;
    *out_tile = (struct lw_solver_tile){.covered = from->covered,
                                        .filled = from->filled,
                                        .width = place->width,
                                        .height = place->height,
                                        .bounces = from->bounces,
                                        .sample_count = from->sample_count,
                                        .error = from->error,
                                        .solved_frame = 1,
                                        .converged = true,
                                        .has_surface =
                                            memchr(from->covered, 1, place->width * place->height) != NULL};
    LW_TILE_CHANNELS_EACH (channel, s->how.channels)
        for (uint32_t p = 0; p < lw_tile_channel_at(channel)->planes; p++)
            out_tile->shown[channel][p] = from->plane[plane++];
    for (int c = 0; c < 3; c++) out_tile->direct[c] = out_tile->indirect[c] = black;
    if (!s->how.has_albedo) return;
    for (uint32_t i = 0; i < place->width * place->height; i++)
        s->albedo[i] = lw_packed_albedo(
            lw_vec3(from->plane[plane][i], from->plane[plane + 1][i], from->plane[plane + 2][i]));
    out_tile->albedo = s->albedo;
}

/* The albedo of the coarse texels. */
static void take_albedo(struct tile_by_tile *s, const struct lw_tile_place *place,
                        struct lw_solver_tile *tile) {
    struct lw_solver_tile below;
    const uint32_t first = read_below(s, place, &below);
    for (uint32_t i = 0; i < tile->width * tile->height; i++) {
        const uint32_t x = i % tile->width / LW_COARSE_SCENE_SIDE, y = i / tile->width / LW_COARSE_SCENE_SIDE;
        s->albedo[i] = below.albedo[first + y * below.width + x];
    }
    tile->albedo = s->albedo;
}

static void read_coarse(struct tile_by_tile *s, lw_tile_id id, struct lw_solver_tile *out_tile) {
    if (s->coarse_tile.v != UINT32_MAX) lw_coarse_tiles_forget(&s->coarse, s->coarse_tile);
    s->coarse_tile = id;
    const enum lw_status status = lw_coarse_tiles_update_one(&s->coarse, s->solver, s->how.channels, id);
    LW_INVARIANT(status == LW_OK); /* some 100 kB */
    lw_coarse_tiles_read(&s->coarse, id, out_tile);
    if (s->how.has_albedo) take_albedo(s, &s->map->place[id.v], out_tile);
}

/* A bake that is stopped shows what tiles have that are being lit. */
static bool read_lit(const struct tile_by_tile *s, lw_tile_id id, struct lw_solver_tile *out_tile) {
    for (uint32_t i = 0; i < s->lit_count; i++) {
        if (s->lit[i].tile != id.v || !s->solver->ops->holds_fine(s->solver, s->lit[i].fine)) continue;
        s->solver->ops->read_tile(s->solver, s->lit[i].fine, out_tile);
        return out_tile->solved_frame > 0;
    }
    return false;
}

static void read_tile(const struct lw_solver *solver, lw_tile_id id, struct lw_solver_tile *out_tile) {
    struct tile_by_tile *s = (struct tile_by_tile *)solver; /* its buffers change alone */
    struct lw_error err = {0};
    LW_INVARIANT(id.v < s->map->plain_count && !s->map->place[id.v].level);
    const enum lw_status status =
        s->file.has[id.v] ? lw_tile_file_get(&s->file, id.v, s->buffer, &err) : LW_NO_INPUT;
    if (status == LW_OK) return read_kept(s, id, out_tile);
    if (status != LW_NO_INPUT) lw_log(LW_LOG_WARNING, "%s: the map has coarse light there", err.text);
    if (!read_lit(s, id, out_tile)) read_coarse(s, id, out_tile);
}

/* ---- the rest of solver.h ---- */

static enum lw_status set_interest(struct lw_solver *solver, const uint8_t *interest, struct lw_error *err) {
    (void)solver, (void)interest;
    return lw_status_fail(err, LW_INTERNAL, "a solver of tiles one after another knows no interest");
}

static void choose_channels(struct lw_solver *solver, uint32_t channels) {
    LW_INVARIANT(channels == ((const struct tile_by_tile *)solver)->how.channels);
}

/* Tiles are filtered as they are lit. */
static enum lw_status filter(struct lw_solver *solver, struct lw_error *err) {
    (void)solver, (void)err;
    return LW_OK;
}

/* The coarse light does not change once it is there, and finished tiles are in their file. */
static enum lw_status save(const struct lw_solver *solver, const char *path, const uint8_t key[16],
                           struct lw_error *err) {
    struct tile_by_tile *s = (struct tile_by_tile *)solver;
    if (s->is_saved) return LW_OK;
    const enum lw_status status = s->solver->ops->save(s->solver, path, key, err);
    s->is_saved = status == LW_OK && s->is_coarse_lit;
    return status;
}

static enum lw_status load(struct lw_solver *solver, const char *path, const uint8_t key[16],
                           uint64_t *out_frames, struct lw_error *err) {
    const struct tile_by_tile *s = (const struct tile_by_tile *)solver;
    return s->solver->ops->load(s->solver, path, key, out_frames, err);
}

static size_t memory_bytes(const struct lw_solver *solver) {
    const struct tile_by_tile *s = (const struct tile_by_tile *)solver;
    return s->solver->ops->memory_bytes(s->solver) + lw_coarse_tiles_memory_bytes(&s->coarse) +
           sizeof *s->buffer + s->file.tiles + s->fine_map.tile_count;
}

static void destroy(struct lw_solver *solver) {
    struct tile_by_tile *s = (struct tile_by_tile *)solver;
    if (!s) return;
    if (s->solver) s->solver->ops->destroy(s->solver);
    lw_tile_file_close(&s->file);
    lw_coarse_tiles_finish(&s->coarse);
    lw_atlas_map_finish(&s->fine_map);
    lw_coarse_scene_finish(&s->coarse_scene);
    free(s->interest);
    free(s->buffer);
    free(s->albedo);
    free(s);
}

static const struct lw_solver_ops ops = {.name = "tile by tile",
                                         .frame = frame,
                                         .set_interest = set_interest,
                                         .choose_channels = choose_channels,
                                         .filter = filter,
                                         .read_tile = read_tile,
                                         .save = save,
                                         .load = load,
                                         .memory_bytes = memory_bytes,
                                         .destroy = destroy};

uint64_t lw_tile_by_tile_forecast(const struct lw_solver_desc *desc) {
    return lw_memory_forecast_coarse(desc, 1) +
           (uint64_t)LW_TILE_BY_TILE_AT_ONCE * LW_TILE_TEXELS_MAX * lw_memory_forecast_texel(desc, 1);
}

/* ---- creation ---- */

static enum lw_status make_room(struct tile_by_tile *s, int threads) {
    enum lw_status status = lw_coarse_tiles_init(&s->coarse, s->map, &s->coarse_scene.map, true, threads);
    s->interest = calloc(s->fine_map.tile_count + 1ul, 1);
    s->buffer = calloc(1, sizeof *s->buffer);
    s->albedo = calloc(LW_TILE_TEXELS_MAX, sizeof *s->albedo);
    return status == LW_OK && s->interest && s->buffer && s->albedo ? LW_OK : LW_NO_MEMORY;
}

static enum lw_status build(struct tile_by_tile *s, const struct lw_solvers_entry *entry,
                            const struct lw_solver_desc *desc, const struct lw_pose *pose,
                            struct lw_error *err) {
    const int threads = desc->threads ? (int)desc->threads : omp_get_max_threads();
    enum lw_status status = lw_coarse_scene_init(&s->coarse_scene, desc->scene);
    if (status == LW_OK)
        status = lw_atlas_map_init_finer(&s->fine_map, &s->coarse_scene.scene, LW_COARSE_SCENE_SHIFT, ROOM);
    if (status == LW_OK) status = make_room(s, threads);
    if (status != LW_OK) return lw_status_fail(err, status, "a coarse scene");
    for (uint32_t id = 0; id < s->map->plain_count; id++) s->total += s->map->place[id].level == 0;
    status =
        lw_tile_file_open(&s->file, s->how.path, s->how.key, s->map->plain_count, count_planes(&s->how), err);
    if (status != LW_OK) return status;
    struct lw_solver_desc inner = *desc;
    inner.scene = &s->coarse_scene.scene;
    inner.atlas_map = &s->fine_map;
    inner.fine_tiles = LW_TILE_BY_TILE_AT_ONCE;
    inner.fine_when = LW_FINE_AT_ONCE_FOR_MAPS;
    if ((status = entry->create(&inner, pose, &s->solver, err)) != LW_OK) return status;
    s->solver->ops->choose_channels(s->solver, s->how.channels);
    return LW_OK;
}

enum lw_status lw_tile_by_tile_create(const struct lw_solvers_entry *entry, const struct lw_solver_desc *desc,
                                      const struct lw_pose *pose, const struct lw_tile_by_tile_desc *how,
                                      struct lw_solver **out_solver, struct lw_error *err) {
    struct tile_by_tile *s = calloc(1, sizeof *s);
    if (!s) return lw_status_fail(err, LW_NO_MEMORY, "solver");
    s->base.ops = &ops;
    s->map = desc->atlas_map;
    s->how = *how;
    s->aim_frames = desc->frames_max;
    s->aim_error = desc->target_error;
    s->coarse_tile = (lw_tile_id){UINT32_MAX};
    LW_INVARIANT(!desc->light_groups && count_planes(how) <= LW_TILE_FILE_PLANES_MAX);
    const enum lw_status status = build(s, entry, desc, pose, err);
    if (status != LW_OK) {
        destroy(&s->base);
        return status;
    }
    *out_solver = &s->base;
    return LW_OK;
}
