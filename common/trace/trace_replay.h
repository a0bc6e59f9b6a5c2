/* trace_replay.h: notes the packets that the trace layer hands to Embree, and hands them to Embree again with
 * nothing around it: what a pass costs over its bare rays.
 * Flow:    passes -> trace -> [record] -> rtcIntersect16, rtcOccluded16;  [run] -> the same calls alone
 * Threads: a replay belongs to one thread at a time.
 *
 * For benches: in a program that links lw_trace_replay the linker puts it between trace.c and Embree (ld
 * --wrap). Other programs know nothing of it. */
#ifndef LW_COMMON_TRACE_REPLAY_H
#define LW_COMMON_TRACE_REPLAY_H

#include "common/status.h"

#include <stddef.h>
#include <stdint.h>

struct lw_trace_replay;

/** Room for so many packets, some 1.5 kB each; those that come later are not noted. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_trace_replay_create(size_t packets, struct lw_trace_replay **out_replay);
void lw_trace_replay_destroy(struct lw_trace_replay *replay);

/** Forgets what it holds. */
void lw_trace_replay_clear(struct lw_trace_replay *replay);

/** From now on the calling thread's packets are noted there; NULL: nowhere, as at the start. */
void lw_trace_replay_record(struct lw_trace_replay *replay);

struct lw_trace_replay_cost {
    uint64_t packets, rays; /* rays: active lanes */
    uint64_t cpu_ns;        /* in Embree, of the calling thread */
};

/** Traces everything again, in the order in which it came, with the filters of then. Packets are copied into
 * the cache, so many at a time, before the clock runs. Adds to *cost. The structures that were traced must
 * still be there. */
void lw_trace_replay_run(struct lw_trace_replay *replay, struct lw_trace_replay_cost *cost);

#endif
