/* program_path.h: paths of the project's other programs.
 * Threads: [any]. */
#ifndef LW_COMMON_BASE_PROGRAM_PATH_H
#define LW_COMMON_BASE_PROGRAM_PATH_H

#include <stddef.h>

/** Path of a program beside this one. If there is none, its bare name, for a search in PATH. */
void lw_program_path(const char *name, char *out_path, size_t capacity);

#endif
