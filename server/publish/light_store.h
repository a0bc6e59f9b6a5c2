/* light_store.h: saves light in a folder for the next run: the last snapshot, and the solver's sums.
 * Flow:    snapshots, solver -> [light store] -> FOLDER/shown, FOLDER/sums -> [light store] -> first
 *          snapshot, solver of the next run
 * Threads: lw_light_store_load() before the solver's thread starts; everything else is that thread's.
 *
 * The last snapshot can be sent at once, long before the solver has texels and rays. If the scene has changed
 * or moved in the last run, it is a placeholder: its tiles do not count as converged (saved_light.h). Sums
 * are saved only if the scene never changed. The next run begins with the file's scene, and sums of a changed
 * scene would hold light that it does not have. */
#ifndef LW_PUBLISH_LIGHT_STORE_H
#define LW_PUBLISH_LIGHT_STORE_H

#include "server/publish/saved_light.h"
#include "server/solve/solver.h"

#define LW_LIGHT_STORE_INTERVAL_S 300.0 /* between two saves, at least */

struct lw_light_store {
    char *shown_path, *sums_path;
    uint8_t key[LW_SAVED_LIGHT_KEY_SIZE];
    struct lw_snapshot *newest; /* NULL: none yet */
    bool changed;               /* the scene has changed in this run */
    bool due;                   /* something is not saved yet */
    bool warned;                /* the log says that the saved light does not fit */
    uint64_t saved_ns;
    bool is_locked; /* the folder, by this descriptor: */
    int lock;
};

/** Makes the folder if it does not exist, locks it until the end of the process or
 * lw_light_store_finish(), and removes what saves left that were killed. key: a hash of the scene and of
 * all options that the light depends on.
 * Errors: LW_CANNOT_CREATE naming the folder; LW_UNAVAILABLE: another process has it; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_light_store_init(struct lw_light_store *store, const char *folder,
                                                 const uint8_t key[LW_SAVED_LIGHT_KEY_SIZE],
                                                 struct lw_error *err);
/** A zeroed store is fine, and has no lock. */
void lw_light_store_finish(struct lw_light_store *store);

/** Last snapshot of the last run, a new reference. NULL if none fits; the reason is logged. */
struct lw_snapshot *lw_light_store_load(struct lw_light_store *store, const struct lw_atlas_map *atlas_map,
                                        float target_error);

/** Loads the sums of the last run into a new solver, if they fit; else the solver stays unchanged. Returns
 * the last frame number of the saved light, or 0; the frames of this run follow it. */
uint64_t lw_light_store_resume(struct lw_light_store *store, const struct lw_atlas_map *atlas_map,
                               struct lw_solver *solver);

/** After each frame. snapshot: the published one, or NULL. solved: there are new sums. changed: the scene
 * has changed. */
void lw_light_store_note(struct lw_light_store *store, struct lw_snapshot *snapshot, bool solved,
                         bool changed);

/** Saves new light, between two frames, if LW_LIGHT_STORE_INTERVAL_S have passed since the last time. A
 * failure is logged, and the server goes on. Returns false on failure. */
bool lw_light_store_save_sometimes(struct lw_light_store *store, const struct lw_solver *solver);
/** Saves new light at the end. solver: NULL in the middle of a frame, when sums cannot be saved.
 * Errors: LW_IO naming the file. */
LW_MUST_CHECK enum lw_status lw_light_store_save(struct lw_light_store *store, const struct lw_solver *solver,
                                                 struct lw_error *err);

#endif
