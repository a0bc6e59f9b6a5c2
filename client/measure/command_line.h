/* command_line.h: the command line, for reports.
 * Threads: [any]. */
#ifndef LW_CLIENT_MEASURE_COMMAND_LINE_H
#define LW_CLIENT_MEASURE_COMMAND_LINE_H

#include <stddef.h>

/** "lightwell-load" and the arguments from its subcommand on; those with blanks in quotes. Cut off at
 * size. */
void lw_command_line_write(int argc, char **argv, char *out, size_t size);

#endif
