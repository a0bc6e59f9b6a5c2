/* file_read.h: reads a whole file whose name comes from outside: only a regular file, up to a size, and where
 * another file names it, only from that file's folder.
 * Threads: [any]. */
#ifndef LW_COMMON_BASE_FILE_READ_H
#define LW_COMMON_BASE_FILE_READ_H

#include "common/base/status.h"

#include <stdint.h>

/** Reads a whole regular file, or its first size_max bytes if not `whole`. *out_bytes is malloc'ed.
 * Errors: LW_NO_INPUT, LW_BAD_DATA (no regular file, too large), LW_IO, LW_NO_MEMORY; their text does not
 * name the file. */
LW_MUST_CHECK enum lw_status lw_file_read(const char *path, uint64_t size_max, bool whole,
                                          uint8_t **out_bytes, size_t *out_size, struct lw_error *err);

/** The same of a relative path that a file names: beneath a folder, wherever its links and its ".." lead. The
 * folder itself may be reached by links. Linux before 5.6 follows no link below it, and no "..".
 * Errors: also LW_BAD_DATA where it leads out of the folder. */
LW_MUST_CHECK enum lw_status lw_file_read_beneath(const char *folder, const char *path, uint64_t size_max,
                                                  bool whole, uint8_t **out_bytes, size_t *out_size,
                                                  struct lw_error *err);

#endif
