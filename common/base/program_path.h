/* program_path.h: paths of the project's other programs.
 * Threads: [any]. */
#ifndef LW_COMMON_BASE_PROGRAM_PATH_H
#define LW_COMMON_BASE_PROGRAM_PATH_H

#include <stddef.h>

/** The path of a program that lies beside this one; its bare name, for a search in PATH, if none does. */
void lw_program_path(const char *name, char *out_path, size_t capacity);

#endif
