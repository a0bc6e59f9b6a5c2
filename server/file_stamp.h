/* file_stamp.h: detects that a file has been replaced or changed, without reading it.
 * Threads: [any]. */
#ifndef LW_SERVER_FILE_STAMP_H
#define LW_SERVER_FILE_STAMP_H

#include <stdbool.h>
#include <stdint.h>

/** All zero: there is no file. */
struct lw_file_stamp {
    uint64_t device, number, size_bytes, modified_ns;
};

/** The stamp of the file at path, through links; NULL: all zero. */
struct lw_file_stamp lw_file_stamp(const char *path);
bool lw_file_stamp_equal(const struct lw_file_stamp *a, const struct lw_file_stamp *b);

#endif
