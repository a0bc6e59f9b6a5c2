/* interrupt.h: Ctrl-C and SIGTERM for programs that end at a point of their choice.
 * Threads: main() only; watching begins before it starts others. */
#ifndef LW_COMMON_BASE_INTERRUPT_H
#define LW_COMMON_BASE_INTERRUPT_H

#include <stdbool.h>

/* EX_TEMPFAIL of sysexits.h: the exit code of a program that a signal stopped before its work was
 * complete. */
#define LW_INTERRUPT_EXIT_CODE 75

/** Effect of the first signal during a part of the program's work. */
struct lw_interrupt_phase {
    const char *answer; /* a line logged at once, by the signal handler; NULL: none */
    bool ends;          /* nothing to finish: the handler ends the program, with the code above */
};

/** Calls the handler at the first SIGINT or SIGTERM. Another one, half a second later or more, has its
 * default effect: it ends the program at once. An earlier one is ignored, since timeout(1) sends two. A
 * handler can reach nothing but globals. phase: as below, or NULL. */
void lw_interrupt_watch(void (*handler)(int signal_number), const struct lw_interrupt_phase *phase);

/** Begins another phase. Its memory must stay valid. An earlier signal has been answered: read the flags of
 * its handler after this call, not before it. */
void lw_interrupt_enter(const struct lw_interrupt_phase *phase);

#endif
