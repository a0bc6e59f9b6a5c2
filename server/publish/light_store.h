/* light_store.h: light kept over a restart, in a folder: what was shown last, and the sums that it came from.
 * Flow:    snapshots, solver -> [light store] -> FOLDER/shown, FOLDER/sums -> [light store] -> first
 *          snapshot, solver of the next run
 * Threads: lw_light_store_recall() before the solver's thread starts; everything else is that thread's.
 *
 * What was shown last is there at once, long before there are texels and rays, whatever has happened to the
 * scene; where that has changed or moved, it stands in for light and says so (saved_light.h). Sums are kept
 * of a scene that never changed alone: changes end with the server, so that this is what the next run begins
 * with, and sums of another moment would rest on light that is not there any more. */
#ifndef LW_PUBLISH_LIGHT_STORE_H
#define LW_PUBLISH_LIGHT_STORE_H

#include "server/publish/saved_light.h"
#include "server/solve/solver.h"

#define LW_LIGHT_STORE_INTERVAL_S 300.0 /* between two saves, at least */

struct lw_light_store {
    char *shown_path, *sums_path;
    uint8_t key[LW_SAVED_LIGHT_KEY_SIZE];
    struct lw_snapshot *newest; /* NULL: none yet */
    bool changed;               /* the scene has, since this run began */
    bool due;                   /* something is not saved yet */
    bool told;                  /* that what is kept does not fit */
    uint64_t saved_ns;
};

/** Makes the folder if it is not there. key: what decides the light of this run: the scene and the options.
 * Errors: LW_CANNOT_CREATE naming the folder; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_light_store_init(struct lw_light_store *store, const char *folder,
                                                 const uint8_t key[LW_SAVED_LIGHT_KEY_SIZE],
                                                 struct lw_error *err);
/** A zeroed store is fine. */
void lw_light_store_finish(struct lw_light_store *store);

/** What the last run showed, a new reference, or NULL: there is none that fits, which the log tells. */
struct lw_snapshot *lw_light_store_recall(struct lw_light_store *store, const struct lw_atlas_map *atlas_map,
                                          float target_error);

/** Gives a new solver the sums of the last run, if there are any that fit; else it stays as it is. Returns
 * the number of the last frame that anything kept is of, or 0: frames go on after it. */
uint64_t lw_light_store_resume(struct lw_light_store *store, const struct lw_atlas_map *atlas_map,
                               struct lw_solver *solver);

/** After each frame. snapshot: what it published, or NULL; solved: there are new sums; changed: the scene
 * has. */
void lw_light_store_note(struct lw_light_store *store, struct lw_snapshot *snapshot, bool solved,
                         bool changed);

/** Saves what is not saved yet, between two frames; unless `now`, LW_LIGHT_STORE_INTERVAL_S after the last
 * time at the earliest. A failure is logged: light that is not kept is no reason to stop. */
void lw_light_store_save(struct lw_light_store *store, const struct lw_solver *solver, bool now);

#endif
