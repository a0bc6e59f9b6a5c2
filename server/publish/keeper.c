#include "server/publish/keeper.h"

#include "common/clock.h"
#include "common/log.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

static char *join(const char *folder, const char *name) {
    const size_t size = strlen(folder) + strlen(name) + 2;
    char *path = malloc(size);
    if (path) snprintf(path, size, "%s/%s", folder, name);
    return path;
}

enum lw_status lw_keeper_init(struct lw_keeper *keeper, const char *folder,
                              const uint8_t key[LW_KEPT_KEY_SIZE], struct lw_error *err) {
    struct stat st;
    if (mkdir(folder, 0777) != 0 && (errno != EEXIST || stat(folder, &st) != 0 || !S_ISDIR(st.st_mode)))
        return lw_status_fail(err, LW_CANNOT_CREATE, "%s: cannot make this folder: %s", folder,
                              strerror(errno));
    *keeper = (struct lw_keeper){
        .shown_path = join(folder, "shown"), .sums_path = join(folder, "sums"), .saved_ns = lw_clock_ns()};
    memcpy(keeper->key, key, sizeof keeper->key);
    if (keeper->shown_path && keeper->sums_path) return LW_OK;
    lw_keeper_finish(keeper);
    return lw_status_fail(err, LW_NO_MEMORY, "%s: out of memory", folder);
}

void lw_keeper_finish(struct lw_keeper *keeper) {
    lw_snapshot_unref(keeper->newest);
    free(keeper->sums_path);
    free(keeper->shown_path);
    *keeper = (struct lw_keeper){0};
}

/* Once; and that there is nothing yet is how everything begins. */
static void tell(struct lw_keeper *keeper, enum lw_status status, const struct lw_error *err) {
    if (status == LW_NO_INPUT || keeper->told) return;
    keeper->told = true;
    lw_log(LW_LOG_WARNING, "%s; lighting afresh", err->text);
}

struct lw_snapshot *lw_keeper_recall(struct lw_keeper *keeper, const struct lw_atlas_map *atlas_map,
                                     float target_error) {
    struct lw_error err = {0};
    struct lw_snapshot *snapshot;
    enum lw_status status =
        lw_kept_load(keeper->shown_path, keeper->key, atlas_map, target_error, &snapshot, &err);
    if (status != LW_OK) {
        tell(keeper, status, &err);
        return NULL;
    }
    lw_log(LW_LOG_INFO, "showing frame %llu of the last run until there is light",
           (unsigned long long)snapshot->frame);
    keeper->newest = lw_snapshot_ref(snapshot);
    return snapshot;
}

uint64_t lw_keeper_resume(struct lw_keeper *keeper, const struct lw_atlas_map *atlas_map,
                          struct lw_solver *solver) {
    struct lw_error err = {0};
    uint64_t frames, last = keeper->newest ? keeper->newest->frame : 0;
    enum lw_status status = solver->ops->load(solver, keeper->sums_path, keeper->key, &frames, &err);
    if (status != LW_OK) {
        tell(keeper, status, &err);
        return last;
    }
    lw_log(LW_LOG_INFO, "going on after %llu frames of the last run", (unsigned long long)frames);
    for (uint32_t id = 0; id < atlas_map->tile_count; id++) {
        struct lw_solver_tile tile;
        if (atlas_map->place[id].level) continue;
        solver->ops->read_tile(solver, (lw_tile_id){id}, &tile);
        if (tile.solved_frame > last) last = tile.solved_frame;
    }
    return last;
}

void lw_keeper_note(struct lw_keeper *keeper, struct lw_snapshot *snapshot, bool solved, bool changed) {
    keeper->changed |= changed;
    keeper->due |= solved || changed || snapshot;
    if (!snapshot) return;
    lw_snapshot_unref(keeper->newest);
    keeper->newest = lw_snapshot_ref(snapshot);
}

void lw_keeper_save(struct lw_keeper *keeper, const struct lw_solver *solver, bool now) {
    if (!keeper->due || !keeper->newest) return;
    if (!now && (double)(lw_clock_ns() - keeper->saved_ns) * 1e-9 < LW_KEEPER_INTERVAL_S) return;
    struct lw_error err = {0};
    enum lw_status status =
        lw_kept_save(keeper->shown_path, keeper->key, keeper->newest, !keeper->changed, &err);
    if (status == LW_OK && !keeper->changed)
        status = solver->ops->save(solver, keeper->sums_path, keeper->key, &err);
    if (status != LW_OK) lw_log(LW_LOG_WARNING, "the light is not kept: %s", err.text);
    keeper->saved_ns = lw_clock_ns();
    keeper->due = false;
}
