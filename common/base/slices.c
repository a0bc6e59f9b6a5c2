#include "common/base/slices.h"

#include <sched.h>
#include <stdint.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#define SLICE_NS 100000u /* the least that Linux gives */

void lw_slices_ask_for_short(void) {
#if defined(SYS_sched_setattr)
    struct { /* sched_attr of linux/sched/types.h, which does not go with sched.h */
        uint32_t size, policy;
        uint64_t flags;
        int32_t nice;
        uint32_t priority;
        uint64_t runtime, deadline, period;
    } slices = {.size = sizeof slices, .policy = SCHED_OTHER, .runtime = SLICE_NS};
    slices.nice = getpriority(PRIO_PROCESS, 0);
    if (sched_getscheduler(0) == SCHED_OTHER) (void)syscall(SYS_sched_setattr, 0, &slices, 0);
#endif
}
