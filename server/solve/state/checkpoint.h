/* checkpoint.h: the state of a solve in a file: a solve that was stopped goes on bit for bit.
 * Flow:    tiles, what else the solver remembers -> [checkpoint] -> file ->
 *          [checkpoint] -> the same, in a new process
 * Threads: the solver's, between two frames.
 *
 * The file belongs to one machine and one build: numbers lie as in memory. It holds a header with a version,
 * the caller's key (which scene, which options), which texels are covered, and the size. Then follow one
 * record per tile and per block, in the order of their ids, the planes of sums, the caller's own parts, and a
 * checksum (common/base/checked_file.h). The reader takes a file that fits in every respect, or nothing of
 * it. */
#ifndef LW_STATE_CHECKPOINT_H
#define LW_STATE_CHECKPOINT_H

#include "server/solve/state/tiles.h"

#define LW_CHECKPOINT_VERSION  9u
#define LW_CHECKPOINT_KEY_SIZE 16u /* bytes */

/** Memory that belongs to the state beside the tiles. */
struct lw_checkpoint_part {
    void *bytes;
    size_t size;
};

/** Writes a checkpoint; it appears whole or not at all. Errors: LW_CANNOT_CREATE, LW_IO
 * naming the path; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_checkpoint_save(const char *path, const uint8_t key[LW_CHECKPOINT_KEY_SIZE],
                                                const struct lw_tiles *tiles,
                                                const struct lw_checkpoint_part *part, uint32_t part_count,
                                                struct lw_error *err);

/** Reads it back into tiles and parts of the same sizes. Whether a tile has converged is not kept: the caller
 * decides.
 * Errors: LW_NO_INPUT: no such file; LW_BAD_DATA naming the path: damaged, of another version, another key,
 *         other sizes or other covered texels; LW_NO_MEMORY. Tiles and parts are untouched on failure, but
 *         for LW_IO in the middle of reading. */
LW_MUST_CHECK enum lw_status lw_checkpoint_load(const char *path, const uint8_t key[LW_CHECKPOINT_KEY_SIZE],
                                                struct lw_tiles *tiles, const struct lw_checkpoint_part *part,
                                                uint32_t part_count, struct lw_error *err);

#endif
