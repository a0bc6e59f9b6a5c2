#include "common/interrupt.h"

#include "common/clock.h"

#include <signal.h>
#include <stdatomic.h>
#include <stddef.h>

#define ONE_NS 500000000u /* signals this close together are one: timeout(1) sends its own twice */

static void (*program_handler)(int signal_number); /* a signal reaches nothing but globals */
static _Atomic uint64_t first_ns;

static void on_signal(int signal_number) {
    const uint64_t now_ns = lw_clock_ns();
    uint64_t first = 0;
    if (atomic_compare_exchange_strong(&first_ns, &first, now_ns)) {
        program_handler(signal_number);
    } else if (now_ns > first && now_ns - first > ONE_NS) {
        signal(signal_number, SIG_DFL);
        raise(signal_number);
    }
}

void lw_interrupt_watch(void (*handler)(int signal_number)) {
    struct sigaction action = {.sa_handler = on_signal};
    program_handler = handler;
    sigemptyset(&action.sa_mask);
    sigaction(SIGINT, &action, NULL);
    sigaction(SIGTERM, &action, NULL);
}
