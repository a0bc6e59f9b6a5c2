/* file_read.h: reads a whole file whose name comes from outside: only a regular file, up to a size.
 * Threads: [any]. */
#ifndef LW_COMMON_FILE_READ_H
#define LW_COMMON_FILE_READ_H

#include "common/status.h"

#include <stdint.h>

/** Reads a whole regular file, or its first size_max bytes if not `whole`. *out_bytes is malloc'ed.
 * Errors: LW_NO_INPUT, LW_BAD_DATA (no regular file, too large), LW_IO, LW_NO_MEMORY; their text does not
 * name the file. */
LW_MUST_CHECK enum lw_status lw_file_read(const char *path, uint64_t size_max, bool whole,
                                          uint8_t **out_bytes, size_t *out_size, struct lw_error *err);

#endif
