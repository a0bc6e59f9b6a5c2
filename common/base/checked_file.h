/* checked_file.h: our own files, written under a temporary name and ended by a checksum: a damaged file is
 * refused.
 * Flow:    bytes -> [checked_file] -> file -> [checked_file] -> the same bytes
 * Threads: one writer or reader belongs to one thread.
 *
 * A file begins with its kind and ends with XXH3-64 of all before it; integers have the machine's byte order,
 * so the file is for this machine only. */
#ifndef LW_COMMON_BASE_CHECKED_FILE_H
#define LW_COMMON_BASE_CHECKED_FILE_H

#include "common/base/atomic_file.h"

#include <stdio.h>

/** Begin of every file: the first member of its header. */
struct lw_checked_file_kind {
    char magic[8];
    uint32_t version;
};

struct lw_checked_file_writer {
    struct lw_atomic_file file;
    void *hash;
    struct lw_error *err;
    enum lw_status status; /* the first failure; a caller may set its own */
};

/** Errors: LW_CANNOT_CREATE naming the path; LW_NO_MEMORY. err, which may be NULL, takes the writer's errors
 * until its end. */
LW_MUST_CHECK enum lw_status lw_checked_file_write_begin(struct lw_checked_file_writer *writer,
                                                         const char *path, struct lw_error *err);
/** Appends; after a failure it does nothing. */
void lw_checked_file_put(struct lw_checked_file_writer *writer, const void *bytes, size_t size);
/** Adds the checksum and makes the file appear, once the disk has it. Errors: the first one since the begin,
 * LW_IO and LW_CANNOT_CREATE naming the path; then nothing appears. */
LW_MUST_CHECK enum lw_status lw_checked_file_write_end(struct lw_checked_file_writer *writer);

struct lw_checked_file_reader {
    FILE *file;
    const char *path;
    uint64_t left; /* bytes before the checksum */
    struct lw_error *err;
};

/** Opens a file, reads it once to check it, and goes back to its first byte, which is the kind's.
 * path, err  outlive the reader; err may be NULL
 * what       the file should hold: "checkpoint"
 * Errors     LW_NO_INPUT: cannot be opened; LW_BAD_DATA: of another kind or version, damaged, cut short;
 *            LW_IO, LW_NO_MEMORY. All name the path. */
LW_MUST_CHECK enum lw_status lw_checked_file_read_begin(struct lw_checked_file_reader *reader,
                                                        const char *path,
                                                        const struct lw_checked_file_kind *kind,
                                                        const char *what, struct lw_error *err);
/** Takes the next bytes. Errors: LW_BAD_DATA: fewer are left; LW_IO; both name the path. */
LW_MUST_CHECK enum lw_status lw_checked_file_take(struct lw_checked_file_reader *reader, void *bytes,
                                                  size_t size);
/** Fine after a begin that failed, too. */
void lw_checked_file_read_end(struct lw_checked_file_reader *reader);

#endif
