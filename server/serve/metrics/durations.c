#include "server/serve/metrics/durations.h"

const double lw_durations_bound_s[LW_DURATIONS_BOUNDS] = {0.0005, 0.001, 0.0025, 0.005, 0.01, 0.025, 0.05,
                                                          0.1,    0.25,  0.5,    1,     2.5,  5,     10};

void lw_durations_add(struct lw_durations *durations, uint64_t ns) {
    const double s = (double)ns * 1e-9;
    unsigned bucket = 0;
    while (bucket < LW_DURATIONS_BOUNDS && s > lw_durations_bound_s[bucket]) bucket++;
    durations->count[bucket]++;
    durations->sum_ns += ns;
}
