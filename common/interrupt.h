/* interrupt.h: Ctrl-C and SIGTERM for programs that finish what they have begun.
 * Threads: main() only, before it starts others. */
#ifndef LW_COMMON_INTERRUPT_H
#define LW_COMMON_INTERRUPT_H

/** Calls the handler at the first SIGINT and at the first SIGTERM. A second one has its default effect: whoever is in a hurry gets out
 * at once. A handler can reach nothing but globals. */
void lw_interrupt_watch(void (*handler)(int signal_number));

#endif
