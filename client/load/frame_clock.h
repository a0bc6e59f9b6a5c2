/* frame_clock.h: when any session first received a frame. Latencies count from then, since a client knows
 * no earlier moment of its publication.
 * Flow:    FRAME of any session -> [frame_clock] -> age of a tile or frame when a session gets it
 * Threads: one thread at a time. */
#ifndef LW_CLIENT_LOAD_FRAME_CLOCK_H
#define LW_CLIENT_LOAD_FRAME_CLOCK_H

#include "common/base/status.h"

#include <stdint.h>

#define LW_FRAME_CLOCK_FRAMES 65536u /* remembered */

struct lw_frame_clock_entry {
    uint64_t frame;
    uint64_t heard_ns;      /* lw_clock_ns() */
    uint64_t solve_ns;      /* from the moment simulated to the moment published, as the server says */
    uint64_t server_cpu_ns; /* the server process's since it started, as it says; 0: not known */
};

struct lw_frame_clock {
    uint64_t count; /* heard of so far; entry i lies at i % LW_FRAME_CLOCK_FRAMES */
    struct lw_frame_clock_entry *entry;
};

/** Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_frame_clock_init(struct lw_frame_clock *clock);
void lw_frame_clock_finish(struct lw_frame_clock *clock);

/** Notes a FRAME that a session received. An older one than the newest so far changes nothing: returns
 * false. */
bool lw_frame_clock_hear(struct lw_frame_clock *clock, struct lw_frame_clock_entry heard);

/** The i-th frame noted, from 0; NULL if it was dropped or is not there yet. */
const struct lw_frame_clock_entry *lw_frame_clock_at(const struct lw_frame_clock *clock, uint64_t i);

/** The newest frame noted; 0: none. */
uint64_t lw_frame_clock_newest(const struct lw_frame_clock *clock);

/** The first frame noted with a number of at least `frame`. A server may skip numbers on the wire; what it
 * published under a skipped number comes with the next frame.
 * For a number that was dropped it returns the oldest frame known, so that ages are never too large.
 * NULL: no such frame was noted. Valid until the next call of lw_frame_clock_hear(). */
const struct lw_frame_clock_entry *lw_frame_clock_find(const struct lw_frame_clock *clock, uint64_t frame);

#endif
