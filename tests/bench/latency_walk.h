/* latency_walk.h: how far the light trails behind while the scene's own animation runs, in real time.
 * Flow:    times, fresh light a second before and at each -> [walk: a server and a client] -> p and error at
 *          each time and pass
 * Threads: main() only. A failure ends the program with its reason. */
#ifndef LW_TESTS_BENCH_LATENCY_WALK_H
#define LW_TESTS_BENCH_LATENCY_WALK_H

#include "tests/bench/latency_light.h"

struct latency_walk_desc {
    const char *camera, *times; /* times: scene seconds, apart by commas */
    int64_t passes, frames;     /* frames, and settle_s: before the first pass */
    double settle_s;
    bool json;
};

/** Measures and prints. light: introduced. */
void latency_walk(struct latency_light *light, const struct latency_walk_desc *desc);

#endif
