/* interrupt.h: Ctrl-C and SIGTERM for programs that finish what they have begun.
 * Threads: main() only; watching begins before it starts others. */
#ifndef LW_COMMON_INTERRUPT_H
#define LW_COMMON_INTERRUPT_H

#include <stdbool.h>

/* EX_TEMPFAIL of sysexits.h: what a program ends with that a signal stopped before it had all it was asked
 * for. */
#define LW_INTERRUPT_EXIT_CODE 75

/** What the first signal does while a part of the program's work lasts. */
struct lw_interrupt_phase {
    const char *answer; /* a line that the log gets at once, whatever the program is busy with; NULL: none */
    bool ends;          /* there is nothing to finish: the program then ends, with the code above */
};

/** Calls the handler at the first SIGINT or SIGTERM. Another one, half a second later or more, has its
 * default effect: a user who is in a hurry gets out at once. Sooner it counts as the same, since timeout(1)
 * sends two. A handler can reach nothing but globals. phase: as below, or NULL. */
void lw_interrupt_watch(void (*handler)(int signal_number), const struct lw_interrupt_phase *phase);

/** Another phase begins; it must stay where it is. A signal that came before has been answered: look at what
 * its handler has set after this call, not before it. */
void lw_interrupt_enter(const struct lw_interrupt_phase *phase);

#endif
