/* pair_visibility.h: which patches see which shooters, a bit a pair, once they have been traced.
 * Flow:    radiosity_pass -> [pair_visibility] -> later passes, file -> bakes with other lights
 * Threads: a row belongs to one packet's worker; else one thread.
 * After:   Kahl 2023 (bits by pair).
 *
 * A shooter's column is known once a pass has traced it: dark shooters cost nothing until they shine. Bits
 * hold while patches stay where they are: all frames then use one place on each texel. */
#ifndef LW_RADIOSITY_PAIR_VISIBILITY_H
#define LW_RADIOSITY_PAIR_VISIBILITY_H

#include "common/scene/pose.h"
#include "server/solve/radiosity/shooters.h"

#define LW_PAIR_VISIBILITY_MAX (4ull << 30) /* bytes */

struct lw_pair_visibility {
    uint32_t packets, shooters;
    uint16_t *mask; /* [packet][shooter]: bit i: patch i of the packet sees it */
    uint8_t *known; /* per shooter */
};

/** All unknown. Errors: LW_USAGE over LW_PAIR_VISIBILITY_MAX, saying what it would take; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_pair_visibility_init(struct lw_pair_visibility *visibility, uint32_t packets,
                                                     uint32_t shooters, struct lw_error *err);
/** A zeroed one is fine. */
void lw_pair_visibility_finish(struct lw_pair_visibility *visibility);
void lw_pair_visibility_forget(struct lw_pair_visibility *visibility);

size_t lw_pair_visibility_bytes(const struct lw_pair_visibility *visibility);

/** 16 bytes that name what decides the bits: patches, shooters, and all that can be in the way; no lights. */
void lw_pair_visibility_key(const struct lw_patches *patches, const struct lw_shooters *shooters,
                            const struct lw_pose *pose, uint8_t out_key[16]);

/** Writes them; the file appears whole or not at all. Errors: as lw_checked_file_write_end(). */
LW_MUST_CHECK enum lw_status lw_pair_visibility_save(const struct lw_pair_visibility *visibility,
                                                     const char *path, const uint8_t key[16],
                                                     struct lw_error *err);
/** Takes those of a file. Errors: as lw_checked_file_read_begin(); LW_BAD_DATA naming the path for
 * another key or size. All are unknown then. */
LW_MUST_CHECK enum lw_status lw_pair_visibility_load(struct lw_pair_visibility *visibility, const char *path,
                                                     const uint8_t key[16], struct lw_error *err);

#endif
