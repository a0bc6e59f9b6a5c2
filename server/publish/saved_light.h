/* saved_light.h: a snapshot in a file, so that the next run of a server has something to show before it has
 * light of its own.
 * Flow:    snapshot -> [saved light] -> file -> [saved light] -> the first snapshot of the next run
 * Threads: one thread per call; snapshots are immutable.
 *
 * The file: a header with a version and the caller's key (which scene, which options), the snapshot's FRAME
 * and TILE messages as on the wire, those of each form of light that it has (proto/wire_format.md), a
 * checksum (common/checked_file.h). Integers lie as in memory: it belongs to one machine. */
#ifndef LW_PUBLISH_SAVED_LIGHT_H
#define LW_PUBLISH_SAVED_LIGHT_H

#include "server/publish/snapshot.h"

#define LW_SAVED_LIGHT_VERSION  2u
#define LW_SAVED_LIGHT_KEY_SIZE 16u          /* bytes */
#define LW_SAVED_LIGHT_SIZE_MAX (1ull << 30) /* bytes of a file that is read, but for its checksum */

/** Writes a snapshot, which has a frame; the file appears whole or not at all.
 * steady: nothing of the scene has changed since this light was begun.
 * Errors: LW_CANNOT_CREATE, LW_IO naming the path; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_saved_light_save(const char *path, const uint8_t key[LW_SAVED_LIGHT_KEY_SIZE],
                                                 const struct lw_snapshot *snapshot, bool steady,
                                                 struct lw_error *err);

/** Reads it back as a snapshot of the same frame and forms, whose counters of rays and CPU time are those
 * of a server that has just started. Unless it was steady, light and scene are those of a moment that is
 * over: no tile counts as converged (its error is twice target_error or more), and sessions are not told
 * that the frame is whole.
 * Errors: LW_NO_INPUT: no such file; LW_BAD_DATA naming the path: damaged, of another version, of another
 * key, or not of this map's tiles; LW_IO, LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_saved_light_load(const char *path, const uint8_t key[LW_SAVED_LIGHT_KEY_SIZE],
                                                 const struct lw_atlas_map *atlas_map, float target_error,
                                                 struct lw_snapshot **out_snapshot, struct lw_error *err);

#endif
