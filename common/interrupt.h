/* interrupt.h: Ctrl-C and SIGTERM for programs that finish what they have begun.
 * Threads: main() only, before it starts others. */
#ifndef LW_COMMON_INTERRUPT_H
#define LW_COMMON_INTERRUPT_H

/** Calls the handler at the first SIGINT or SIGTERM. Another one, half a second later or more, has its default effect: whoever
 * is in a hurry gets out at once. Sooner it counts as the same, since timeout(1) sends two. A handler can reach nothing but
 * globals. */
void lw_interrupt_watch(void (*handler)(int signal_number));

#endif
