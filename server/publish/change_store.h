/* change_store.h: keeps the changes that clients have made to the scene in a file, for the next run.
 * Flow:    changes of each frame -> [change store] -> FOLDER/changes -> [change store] -> the first frame of
 *          the next run
 * Threads: lw_change_store_open() before the solver's thread starts; everything else is that thread's.
 *
 * A frame's changes are in the file before its light is published, and so before they are acknowledged. A
 * killed server has lost none, unless a write failed: that is a warning and a count in /metrics. Nobody
 * waits for the disk, so that a power cut may lose the last seconds. The file is a header, and for each frame
 * a list of changes with a checksum. Integers have the machine's byte order. A list that is cut short ends
 * the file. */
#ifndef LW_PUBLISH_CHANGE_STORE_H
#define LW_PUBLISH_CHANGE_STORE_H

#include "common/scene/scene_state.h"

#define LW_CHANGE_STORE_KEY_SIZE  16u        /* bytes */
#define LW_CHANGE_STORE_GROWN     (1u << 20) /* growth of the file that makes us rewrite it, bytes */
#define LW_CHANGE_STORE_COUNT_MAX (1u << 24) /* changes of one list */

struct lw_change_store {
    char *path;
    int file; /* -1: not open, as after a failure */
    uint8_t key[LW_CHANGE_STORE_KEY_SIZE];
    uint64_t bytes, bytes_at_first; /* size now; size after the last rewrite of this run */
    uint64_t failed_ns;             /* when the last attempt was */
    bool warned;                    /* the log knows of the failure */
};

/** Opens FOLDER/changes, whose folder exists and is locked, or makes it.
 * key             a hash of the scene. Changes of another scene are dropped, with a warning
 * *out_change     the kept changes, in order, not checked against the scene; the caller frees them
 * Errors: LW_CANNOT_CREATE, LW_IO naming the file; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_change_store_open(struct lw_change_store *store, const char *folder,
                                                  const uint8_t key[LW_CHANGE_STORE_KEY_SIZE],
                                                  struct lw_scene_change **out_change, size_t *out_count,
                                                  struct lw_error *err);
/** A zeroed store is fine. */
void lw_change_store_finish(struct lw_change_store *store);

/** Keeps the changes of a frame. state: the scene with these changes; a file that has grown is
 * rewritten from it. wall_s: the frame's clock. A failure is logged once. The next change tries again, and so
 * does a frame without changes, once a second.
 * Returns false on failure: then a kill loses these changes. */
bool lw_change_store_add(struct lw_change_store *store, const struct lw_scene_change *change, size_t count,
                         const struct lw_scene_state *state, double wall_s);
/** The file holds changes that cannot be made: the next lw_change_store_add() rewrites it from the state. */
void lw_change_store_discard(struct lw_change_store *store);

#endif
