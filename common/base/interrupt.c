#include "common/base/interrupt.h"

#include "common/base/clock.h"
#include "common/base/log.h"

#include <signal.h>
#include <stdatomic.h>
#include <stddef.h>
#include <unistd.h>

#define ONE_NS 500000000u /* signals this close together are one: timeout(1) sends its own twice */

static void (*program_handler)(int signal_number); /* a signal reaches nothing but globals */
static _Atomic uint64_t first_ns;
static const struct lw_interrupt_phase *_Atomic current; /* NULL: no answer */

static void on_signal(int signal_number) {
    const uint64_t now_ns = lw_clock_ns();
    uint64_t first = 0;
    if (atomic_compare_exchange_strong(&first_ns, &first, now_ns)) {
        const struct lw_interrupt_phase *phase = current;
        program_handler(signal_number);
        if (phase && phase->answer) lw_log_in_handler(phase->answer);
        if (phase && phase->ends) _exit(LW_INTERRUPT_EXIT_CODE);
    } else if (now_ns > first && now_ns - first > ONE_NS) {
        signal(signal_number, SIG_DFL);
        raise(signal_number);
    }
}

void lw_interrupt_enter(const struct lw_interrupt_phase *phase) { current = phase; }

void lw_interrupt_watch(void (*handler)(int signal_number), const struct lw_interrupt_phase *phase) {
    struct sigaction action = {.sa_handler = on_signal};
    program_handler = handler;
    current = phase;
    sigemptyset(&action.sa_mask);
    sigaction(SIGINT, &action, NULL);
    sigaction(SIGTERM, &action, NULL);
}
