#include "server/publish/light_store.h"

#include "common/base/atomic_file.h"
#include "common/base/clock.h"
#include "common/base/folders.h"
#include "common/base/invariant.h"
#include "common/base/log.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

/* The folder itself is locked: no file has to be made, and the system takes the lock back however the process
 * ends. File systems without locks are used without. */
static enum lw_status lock(const char *folder, int *out_descriptor, struct lw_error *err) {
    const int descriptor = open(folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (descriptor < 0)
        return lw_status_fail(err, LW_CANNOT_CREATE, "%s: cannot open this folder: %s", folder,
                              strerror(errno));
    if (flock(descriptor, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK) {
        close(descriptor);
        return lw_status_fail(err, LW_UNAVAILABLE,
                              "%s: another lightwelld keeps its light in this folder; name another", folder);
    }
    *out_descriptor = descriptor;
    return LW_OK;
}

static void sweep(const struct lw_light_store *store) {
    const unsigned count = lw_atomic_file_sweep(store->shown_path) + lw_atomic_file_sweep(store->sums_path);
    if (count) lw_log(LW_LOG_INFO, "removed %u unfinished files of an earlier run that was killed", count);
}

enum lw_status lw_light_store_init(struct lw_light_store *store, const char *folder,
                                   const uint8_t key[LW_SAVED_LIGHT_KEY_SIZE], struct lw_error *err) {
    struct stat st;
    if (mkdir(folder, 0777) != 0 && (errno != EEXIST || stat(folder, &st) != 0 || !S_ISDIR(st.st_mode)))
        return lw_status_fail(err, LW_CANNOT_CREATE, "%s: cannot make this folder: %s", folder,
                              strerror(errno));
    *store = (struct lw_light_store){.shown_path = lw_folders_join(folder, "shown"),
                                     .sums_path = lw_folders_join(folder, "sums"),
                                     .saved_ns = lw_clock_ns()};
    memcpy(store->key, key, sizeof store->key);
    enum lw_status status = store->shown_path && store->sums_path
                                ? lock(folder, &store->lock, err)
                                : lw_status_fail(err, LW_NO_MEMORY, "%s: out of memory", folder);
    store->is_locked = status == LW_OK;
    if (status == LW_OK)
        sweep(store);
    else
        lw_light_store_finish(store);
    return status;
}

void lw_light_store_finish(struct lw_light_store *store) {
    lw_snapshot_unref(store->newest);
    if (store->is_locked) close(store->lock);
    free(store->sums_path);
    free(store->shown_path);
    *store = (struct lw_light_store){0};
}

/* Logs the first failure only; a first run without files is none. */
static void log_first_failure(struct lw_light_store *store, enum lw_status status,
                              const struct lw_error *err) {
    if (status == LW_NO_INPUT || store->warned) return;
    store->warned = true;
    lw_log(LW_LOG_WARNING, "%s; lighting afresh", err->text);
}

struct lw_snapshot *lw_light_store_load(struct lw_light_store *store, const struct lw_atlas_map *atlas_map,
                                        float target_error) {
    struct lw_error err = {0};
    struct lw_snapshot *snapshot;
    LW_INVARIANT(store->is_locked); /* nobody else writes it meanwhile */
    enum lw_status status =
        lw_saved_light_load(store->shown_path, store->key, atlas_map, target_error, &snapshot, &err);
    if (status != LW_OK) {
        log_first_failure(store, status, &err);
        return NULL;
    }
    lw_log(LW_LOG_INFO, "showing frame %llu of the last run until there is light",
           (unsigned long long)snapshot->frame);
    LW_INVARIANT(!store->newest && snapshot->frame > 0 && snapshot->tile_count == atlas_map->tile_count);
    store->newest = lw_snapshot_ref(snapshot);
    return snapshot;
}

uint64_t lw_light_store_resume(struct lw_light_store *store, const struct lw_atlas_map *atlas_map,
                               struct lw_solver *solver) {
    struct lw_error err = {0};
    uint64_t frames, last = store->newest ? store->newest->frame : 0;
    enum lw_status status = solver->ops->load(solver, store->sums_path, store->key, &frames, &err);
    if (status != LW_OK) {
        log_first_failure(store, status, &err);
        return last;
    }
    lw_log(LW_LOG_INFO, "going on after %llu frames of the last run", (unsigned long long)frames);
    for (uint32_t id = 0; id < atlas_map->plain_count; id++) {
        struct lw_solver_tile tile;
        if (atlas_map->place[id].level) continue;
        solver->ops->read_tile(solver, (lw_tile_id){id}, &tile);
        if (tile.solved_frame > last) last = tile.solved_frame;
    }
    return last;
}

void lw_light_store_note(struct lw_light_store *store, struct lw_snapshot *snapshot, bool solved,
                         bool changed) {
    store->changed |= changed;
    store->due |= solved || changed || snapshot;
    if (!snapshot) return;
    LW_INVARIANT(!store->newest || snapshot->frame >= store->newest->frame);
    lw_snapshot_unref(store->newest);
    store->newest = lw_snapshot_ref(snapshot);
}

static enum lw_status save(struct lw_light_store *store, const struct lw_solver *solver,
                           struct lw_error *err) {
    LW_INVARIANT(store->is_locked && store->due && store->newest);
    enum lw_status status =
        lw_saved_light_save(store->shown_path, store->key, store->newest, !store->changed, err);
    if (status == LW_OK && solver && !store->changed)
        status = solver->ops->save(solver, store->sums_path, store->key, err);
    store->saved_ns = lw_clock_ns();
    store->due = false;
    return status;
}

bool lw_light_store_save_sometimes(struct lw_light_store *store, const struct lw_solver *solver) {
    struct lw_error err = {0};
    if (!store->due || !store->newest ||
        (double)(lw_clock_ns() - store->saved_ns) * 1e-9 < LW_LIGHT_STORE_INTERVAL_S)
        return true;
    if (save(store, solver, &err) == LW_OK) return true;
    lw_log(LW_LOG_WARNING, "the light is not kept: %s", err.text);
    return false;
}

enum lw_status lw_light_store_save(struct lw_light_store *store, const struct lw_solver *solver,
                                   struct lw_error *err) {
    struct lw_error cause = {0};
    if (!store->due || !store->newest || save(store, solver, &cause) == LW_OK) return LW_OK;
    return lw_status_fail(err, LW_IO, "the light is not kept: %s", cause.text);
}
