/* trace_replay.h: records the ray packets of a pass and traces them again by Embree alone. A bench compares
 * the two times: the cost of the pass beyond its rays.
 * Flow:    passes -> trace -> [record] -> rtcIntersect16, rtcOccluded16;  [run] -> the same calls alone
 * Threads: a replay belongs to one thread at a time.
 *
 * For benches: in a program that links lw_trace_replay the linker puts it between trace.c and Embree (ld
 * --wrap). Other programs know nothing of it. */
#ifndef LW_COMMON_TRACE_REPLAY_H
#define LW_COMMON_TRACE_REPLAY_H

#include "common/base/status.h"

#include <stddef.h>
#include <stdint.h>

struct lw_trace_replay;

/** Room for `packets` packets, some 1.5 kB each; later ones are not recorded. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_trace_replay_create(size_t packets, struct lw_trace_replay **out_replay);
void lw_trace_replay_destroy(struct lw_trace_replay *replay);

/** Forgets what it holds. */
void lw_trace_replay_clear(struct lw_trace_replay *replay);

/** From now on the calling thread's packets are recorded there; NULL: nowhere, as at the start. */
void lw_trace_replay_record(struct lw_trace_replay *replay);

struct lw_trace_replay_cost {
    uint64_t packets, rays; /* rays: active lanes */
    uint64_t cpu_ns;        /* in Embree, of the calling thread */
};

/** Traces all packets again, in the same order and with the same filters. Before the clock runs, packets are
 * copied into the cache in batches. Adds to *cost. The traced scenes must still exist. */
void lw_trace_replay_run(struct lw_trace_replay *replay, struct lw_trace_replay_cost *cost);

#endif
