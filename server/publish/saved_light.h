/* saved_light.h: a snapshot in a file, which the next run of a server sends before its own first frame.
 * Flow:    snapshot -> [saved light] -> file -> [saved light] -> the first snapshot of the next run
 * Threads: one thread per call; snapshots are immutable.
 *
 * The file: a header with a version and the caller's key (which scene, which options), the snapshot's FRAME
 * and TILE messages as on the wire, those of each channel that it has and that is kept
 * (proto/wire_format.md), a checksum (common/base/checked_file.h). Integers have the machine's byte order, so
 * the file is for this machine only. */
#ifndef LW_PUBLISH_SAVED_LIGHT_H
#define LW_PUBLISH_SAVED_LIGHT_H

#include "server/publish/snapshot.h"

#define LW_SAVED_LIGHT_VERSION  2u
#define LW_SAVED_LIGHT_KEY_SIZE 16u /* bytes */
/* bytes of a file without its checksum; larger ones are refused */
#define LW_SAVED_LIGHT_SIZE_MAX (1ull << 30)

/** Writes a snapshot, which has a frame; the file appears whole or not at all. steady: the scene has not
 * changed since the first sample of this light.
 * Errors: LW_CANNOT_CREATE, LW_IO naming the path; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_saved_light_save(const char *path, const uint8_t key[LW_SAVED_LIGHT_KEY_SIZE],
                                                 const struct lw_snapshot *snapshot, bool steady,
                                                 struct lw_error *err);

/** Reads it back as a snapshot of the same frame and kept channels. Counters of rays and CPU time are 0. If
 * it was not steady, light and scene are of a past moment: no tile counts as converged (its error becomes
 * at least twice target_error), and sessions get no SETTLED message.
 * Errors: LW_NO_INPUT: no such file; LW_BAD_DATA naming the path: damaged, of another version, of another
 * key, or not of this map's tiles; LW_IO, LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_saved_light_load(const char *path, const uint8_t key[LW_SAVED_LIGHT_KEY_SIZE],
                                                 const struct lw_atlas_map *atlas_map, float target_error,
                                                 struct lw_snapshot **out_snapshot, struct lw_error *err);

#endif
