#include "common/interrupt.h"

#include <signal.h>
#include <stddef.h>

void lw_interrupt_watch(void (*handler)(int signal_number)) {
    struct sigaction action = {.sa_handler = handler, .sa_flags = (int)SA_RESETHAND};
    sigemptyset(&action.sa_mask);
    sigaction(SIGINT, &action, NULL);
    sigaction(SIGTERM, &action, NULL);
}
