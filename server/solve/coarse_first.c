#include "server/solve/coarse_first.h"

#include "common/base/invariant.h"
#include "server/solve/coarse_tiles.h"
#include "server/solve/surface/saved_texels.h"

#include <omp.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* Frames after which the coarse light is smooth. A large scene has fewer: those take the processor from the
 * thread that builds the whole solver. */
#define COARSE_FRAMES_MAX 24u
#define COARSE_SAMPLES    1500000u /* texels times frames */

/* The thread that builds the whole solver. Nothing here changes while it runs. */
struct builder {
    pthread_t thread;
    const struct lw_solvers_entry *entry;
    struct lw_solver_desc desc;
    struct lw_saved_texels saved;
    char *saved_folder;
    struct lw_scene scene; /* the whole solver's; follows the desc's scene once the solver is there */
    struct lw_pose pose;
    struct lw_solver *solver;
    struct lw_error err;
    enum lw_status status;
    bool begun, joined;
    atomic_bool ended;
};

struct coarse_first {
    struct lw_solver base;
    const struct lw_scene *scene; /* the caller's */
    const struct lw_atlas_map *map;
    struct lw_coarse_scene coarse_scene;
    struct lw_coarse_tiles tiles;
    struct lw_solver *coarse; /* NULL: the whole solver has taken over */
    uint64_t *whole_since;    /* per tile of the map: the frame that took it over; 0: it is coarse */
    struct builder builder;
    struct lw_solver *whole; /* NULL: it is not there yet */
    uint32_t frames, whole_frames;
    uint32_t channels;
    uint8_t *interest; /* for the whole solver; NULL: everything */
};

bool lw_coarse_first_pays(const struct lw_scene *scene) {
    return lw_coarse_scene_count_texels(scene) >= LW_COARSE_FIRST_TEXELS_MIN;
}

static uint32_t coarse_frames(const struct lw_scene *scene) {
    const uint64_t frames = COARSE_SAMPLES / (lw_coarse_scene_count_texels(scene) + 1);
    return frames < LW_COARSE_FIRST_ALONE ? LW_COARSE_FIRST_ALONE
           : frames > COARSE_FRAMES_MAX   ? COARSE_FRAMES_MAX
                                          : (uint32_t)frames;
}

/* ---- building the whole solver ---- */

static void *build_in_thread(void *argument) {
    struct builder *b = argument;
    b->status = b->entry->create(&b->desc, &b->pose, &b->solver, &b->err);
    b->ended = true;
    return NULL;
}

/* pose: NULL: that of the creation */
static enum lw_status begin_building(struct coarse_first *s, const struct lw_pose *pose,
                                     struct lw_error *err) {
    struct builder *b = &s->builder;
    LW_INVARIANT(!b->begun && !s->whole);
    if (pose) lw_pose_copy(&b->pose, pose, s->scene);
    lw_coarse_scene_follow(&b->scene, s->scene);
    if (pthread_create(&b->thread, NULL, build_in_thread, b) != 0)
        return lw_status_fail(err, LW_OS, "cannot start a thread for the solver");
    b->begun = true;
    return LW_OK;
}

/* Waits for the thread, and takes its solver over. */
static enum lw_status take_whole(struct coarse_first *s, struct lw_error *err) {
    struct builder *b = &s->builder;
    if (!b->joined) pthread_join(b->thread, NULL);
    b->joined = true;
    if (b->status != LW_OK) {
        if (err && err->status == LW_OK) *err = b->err;
        return b->status;
    }
    LW_INVARIANT(b->solver && !s->whole);
    const enum lw_status status = b->solver->ops->set_interest(b->solver, s->interest, err);
    if (status != LW_OK) return status;
    s->whole = b->solver;
    b->solver = NULL;
    s->whole->ops->choose_channels(s->whole, s->channels);
    return LW_OK;
}

static void builder_finish(struct builder *b) {
    if (b->begun && !b->joined) pthread_join(b->thread, NULL);
    if (b->solver) b->solver->ops->destroy(b->solver);
    lw_pose_finish(&b->pose);
    lw_scene_finish_variant(&b->scene);
    free(b->saved_folder);
}

/* ---- frames ---- */

static bool has_coarse_tiles(const struct coarse_first *s) { return s->tiles.tile != NULL; }

static void end_coarse_solver(struct coarse_first *s) {
    s->coarse->ops->destroy(s->coarse);
    s->coarse = NULL;
    lw_coarse_scene_finish(&s->coarse_scene);
}

static bool is_ready(const struct coarse_first *s, lw_tile_id id) {
    struct lw_solver_tile tile;
    s->whole->ops->read_tile(s->whole, id, &tile);
    return lw_coarse_tiles_end(&tile);
}

/* Takes tiles over from the coarse light: those that are ready, or all. Returns how many. */
static uint32_t take_tiles(struct coarse_first *s, bool all, uint64_t frame) {
    uint32_t taken = 0, left = 0;
    for (uint32_t id = 0; id < s->map->plain_count; id++) {
        if (s->map->place[id].level || s->whole_since[id]) continue;
        if (!all && !is_ready(s, (lw_tile_id){id})) {
            left++;
            continue;
        }
        s->whole_since[id] = frame;
        lw_coarse_tiles_forget(&s->tiles, (lw_tile_id){id});
        taken++;
    }
    if (!left) lw_coarse_tiles_finish(&s->tiles);
    return taken;
}

static enum lw_status coarse_frame(struct coarse_first *s, const struct lw_pose *pose, uint64_t frame,
                                   struct lw_solver_stats *out_stats, struct lw_error *err) {
    lw_coarse_scene_follow(&s->coarse_scene.scene, s->scene);
    enum lw_status status = s->coarse->ops->frame(s->coarse, pose, frame, out_stats, err);
    if (status != LW_OK) return status;
    status = lw_coarse_tiles_update(&s->tiles, s->coarse, s->channels, NULL);
    return status == LW_OK ? LW_OK : lw_status_fail(err, status, "tiles of the first light");
}

static enum lw_status whole_frame(struct coarse_first *s, const struct lw_pose *pose, uint64_t frame,
                                  struct lw_solver_stats *out_stats, struct lw_error *err) {
    lw_coarse_scene_follow(&s->builder.scene, s->scene);
    return s->whole->ops->frame(s->whole, pose, frame, out_stats, err);
}

static void add_rays(struct lw_solver_stats *stats, const struct lw_solver_stats *other) {
    stats->rays_shadow += other->rays_shadow;
    stats->rays_bounce += other->rays_bounce;
    stats->rays_probe += other->rays_probe;
}

/* A frame of the whole solver alone. Coarse tiles do not follow movement, and have no channel that was not
 * shown when the coarse solver ended. */
static enum lw_status late_frame(struct coarse_first *s, const struct lw_pose *pose, uint64_t number,
                                 struct lw_solver_stats *out_stats, struct lw_error *err) {
    const enum lw_status status = whole_frame(s, pose, number, out_stats, err);
    if (status != LW_OK || !has_coarse_tiles(s)) return status;
    const bool all =
        out_stats->moved || (s->channels & ~s->tiles.channels) || ++s->whole_frames >= LW_COARSE_FIRST_KEPT;
    out_stats->tiles_shown += take_tiles(s, all, number);
    return LW_OK;
}

static enum lw_status frame(struct lw_solver *solver, const struct lw_pose *pose, uint64_t number,
                            struct lw_solver_stats *out_stats, struct lw_error *err) {
    struct coarse_first *s = (struct coarse_first *)solver;
    struct lw_solver_stats coarse_stats = {0};
    if (!s->coarse) return late_frame(s, pose, number, out_stats, err);
    enum lw_status status = coarse_frame(s, pose, number, &coarse_stats, err);
    if (status != LW_OK) return status;
    coarse_stats.coarse = true;
    *out_stats = coarse_stats;
    s->frames++;
    if (!s->builder.begun) return s->frames < LW_COARSE_FIRST_ALONE ? LW_OK : begin_building(s, pose, err);
    if (!s->whole && !s->builder.ended) return LW_OK;
    if (!s->whole && (status = take_whole(s, err)) != LW_OK) return status;
    if ((status = whole_frame(s, pose, number, out_stats, err)) != LW_OK) return status;
    add_rays(out_stats, &coarse_stats);
    if (++s->whole_frames < LW_COARSE_TILES_FRAMES) {
        out_stats->tiles_shown = coarse_stats.tiles_shown;
        out_stats->coarse = true;
        return LW_OK;
    }
    end_coarse_solver(s);
    out_stats->tiles_shown = take_tiles(s, out_stats->moved, number);
    return LW_OK;
}

/* ---- forwarded calls ---- */

static enum lw_status set_interest(struct lw_solver *solver, const uint8_t *interest, struct lw_error *err) {
    struct coarse_first *s = (struct coarse_first *)solver;
    if (s->whole) return s->whole->ops->set_interest(s->whole, interest, err);
    uint8_t *copy = interest ? malloc(s->map->tile_count + 1ul) : NULL;
    if (interest && !copy) return lw_status_fail(err, LW_NO_MEMORY, "interest");
    if (copy) memcpy(copy, interest, s->map->tile_count);
    free(s->interest);
    s->interest = copy;
    return LW_OK;
}

static void choose_channels(struct lw_solver *solver, uint32_t channels) {
    struct coarse_first *s = (struct coarse_first *)solver;
    s->channels = channels;
    if (s->coarse) s->coarse->ops->choose_channels(s->coarse, channels);
    if (s->whole) s->whole->ops->choose_channels(s->whole, channels);
}

static enum lw_status filter(struct lw_solver *solver, struct lw_error *err) {
    struct coarse_first *s = (struct coarse_first *)solver;
    if (!s->coarse) return s->whole->ops->filter(s->whole, err);
    enum lw_status status = s->coarse->ops->filter(s->coarse, err);
    return status == LW_OK ? lw_coarse_tiles_update(&s->tiles, s->coarse, s->channels, NULL) : status;
}

static uint32_t list_fine(const struct lw_solver *solver, const lw_tile_id **out_tile) {
    const struct coarse_first *s = (const struct coarse_first *)solver;
    return s->coarse || !s->whole->ops->list_fine ? 0 : s->whole->ops->list_fine(s->whole, out_tile);
}

static bool holds_fine(const struct lw_solver *solver, lw_tile_id tile) {
    const struct coarse_first *s = (const struct coarse_first *)solver;
    return s->whole && s->whole->ops->holds_fine && s->whole->ops->holds_fine(s->whole, tile);
}

static void read_tile(const struct lw_solver *solver, lw_tile_id tile, struct lw_solver_tile *out_tile) {
    const struct coarse_first *s = (const struct coarse_first *)solver;
    const bool plain = tile.v < s->map->plain_count;
    if (has_coarse_tiles(s) && plain && !s->whole_since[tile.v]) {
        lw_coarse_tiles_read(&s->tiles, tile, out_tile);
        return;
    }
    s->whole->ops->read_tile(s->whole, tile, out_tile);
    if (plain && out_tile->solved_frame < s->whole_since[tile.v])
        out_tile->solved_frame = s->whole_since[tile.v];
}

/* The light of a start that ends before all detail is there is not worth a file. */
static enum lw_status save(const struct lw_solver *solver, const char *path, const uint8_t key[16],
                           struct lw_error *err) {
    const struct coarse_first *s = (const struct coarse_first *)solver;
    return s->coarse ? LW_OK : s->whole->ops->save(s->whole, path, key, err);
}

static enum lw_status load(struct lw_solver *solver, const char *path, const uint8_t key[16],
                           uint64_t *out_frames, struct lw_error *err) {
    struct coarse_first *s = (struct coarse_first *)solver;
    /* there is nothing to wait for: the coarse solver says so as the whole one would */
    if (s->coarse && access(path, F_OK) != 0)
        return s->coarse->ops->load(s->coarse, path, key, out_frames, err);
    enum lw_status status = s->builder.begun ? LW_OK : begin_building(s, NULL, err);
    if (status == LW_OK && !s->whole) status = take_whole(s, err);
    if (status == LW_OK) status = s->whole->ops->load(s->whole, path, key, out_frames, err);
    if (status == LW_OK && s->coarse) {
        end_coarse_solver(s);
        lw_coarse_tiles_finish(&s->tiles);
    }
    return status;
}

static size_t memory_bytes(const struct lw_solver *solver) {
    const struct coarse_first *s = (const struct coarse_first *)solver;
    size_t bytes = s->whole ? s->whole->ops->memory_bytes(s->whole) : 0;
    if (s->coarse) bytes += s->coarse->ops->memory_bytes(s->coarse);
    bytes += lw_coarse_tiles_memory_bytes(&s->tiles);
    return bytes;
}

void lw_coarse_first_wait(struct lw_solver *solver) {
    struct builder *b = &((struct coarse_first *)solver)->builder;
    LW_INVARIANT(b->begun);
    if (!b->joined) pthread_join(b->thread, NULL);
    b->joined = true;
    b->ended = true;
}

static void destroy(struct lw_solver *solver) {
    if (!solver) return;
    struct coarse_first *s = (struct coarse_first *)solver;
    builder_finish(&s->builder);
    if (s->whole) s->whole->ops->destroy(s->whole);
    if (s->coarse) s->coarse->ops->destroy(s->coarse);
    lw_coarse_tiles_finish(&s->tiles);
    lw_coarse_scene_finish(&s->coarse_scene);
    free(s->interest);
    free(s->whole_since);
    free(s);
}

static const struct lw_solver_ops ops = {.name = "coarse first",
                                         .frame = frame,
                                         .set_interest = set_interest,
                                         .choose_channels = choose_channels,
                                         .filter = filter,
                                         .list_fine = list_fine,
                                         .holds_fine = holds_fine,
                                         .read_tile = read_tile,
                                         .save = save,
                                         .load = load,
                                         .memory_bytes = memory_bytes,
                                         .destroy = destroy};

/* ---- creation ---- */

static enum lw_status init_builder(struct builder *b, const struct lw_solver_desc *desc,
                                   const struct lw_pose *pose) {
    b->desc = *desc;
    b->desc.scene = &b->scene;
    b->desc.waiting = NULL; /* clients have light */
    if (desc->saved_texels) {
        b->saved = *desc->saved_texels;
        b->saved.folder = b->saved_folder = strdup(desc->saved_texels->folder);
        b->desc.saved_texels = &b->saved;
        if (!b->saved_folder) return LW_NO_MEMORY;
    }
    enum lw_status status = lw_scene_init_variant(&b->scene, desc->scene);
    return status == LW_OK ? lw_pose_init_copy(&b->pose, pose, desc->scene) : status;
}

static enum lw_status build_coarse(struct coarse_first *s, const struct lw_solver_desc *desc,
                                   const struct lw_pose *pose, struct lw_error *err) {
    struct lw_solver_desc coarse = *desc;
    struct lw_saved_texels saved;
    coarse.scene = &s->coarse_scene.scene;
    coarse.atlas_map = &s->coarse_scene.map;
    coarse.frames_max = coarse_frames(coarse.scene);
    coarse.frame_budget_s = coarse.frame_budget_units = 0;
    coarse.plan_log = NULL;
    if (desc->saved_texels) {
        saved = *desc->saved_texels;
        lw_coarse_scene_key(desc->saved_texels->key, saved.key);
        coarse.saved_texels = &saved;
    }
    coarse.fine_tiles = 0;
    coarse.awaited = NULL;
    return s->builder.entry->create(&coarse, pose, &s->coarse, err);
}

enum lw_status lw_coarse_first_create(const struct lw_solvers_entry *entry, const struct lw_solver_desc *desc,
                                      const struct lw_pose *pose, struct lw_solver **out_solver,
                                      struct lw_error *err) {
    const int threads = desc->threads ? (int)desc->threads : omp_get_max_threads();
    struct coarse_first *s = calloc(1, sizeof *s);
    if (!s) return lw_status_fail(err, LW_NO_MEMORY, "solver");
    s->base.ops = &ops;
    s->scene = desc->scene;
    s->map = desc->atlas_map;
    s->builder.entry = entry;
    s->channels = lw_tile_channel_bit(LW_TILE_CHANNEL_FULL);
    s->whole_since = calloc(s->map->plain_count + 1ul, sizeof *s->whole_since);
    enum lw_status status = s->whole_since ? init_builder(&s->builder, desc, pose) : LW_NO_MEMORY;
    if (status == LW_OK) status = lw_coarse_scene_init(&s->coarse_scene, desc->scene);
    if (status == LW_OK)
        status = lw_coarse_tiles_init(&s->tiles, s->map, &s->coarse_scene.map, true, threads);
    if (status != LW_OK) lw_status_fail(err, status, "a coarse scene");
    if (status == LW_OK) status = build_coarse(s, desc, pose, err);
    if (status != LW_OK) {
        destroy(&s->base);
        return status;
    }
    *out_solver = &s->base;
    return LW_OK;
}
