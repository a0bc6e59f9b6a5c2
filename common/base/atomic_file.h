/* atomic_file.h: output files that appear whole or not at all.
 * Bytes go to a temporary name in the same folder; commit renames it over the old file, whose mode and, as
 * root, owner it keeps. A device or a pipe (/dev/stdout, /dev/null) is written directly: it must not be
 * replaced. Guards against our own failures; against power loss where `durable` is set.
 * Threads: one lw_atomic_file belongs to one thread; different ones are independent, even for the same
 * path. */
#ifndef LW_COMMON_BASE_ATOMIC_FILE_H
#define LW_COMMON_BASE_ATOMIC_FILE_H

#include "common/base/status.h"

#include <signal.h>
#include <stdbool.h>
#include <stdint.h>

/** open() fills it; the caller may set the last two between open() and the first write. */
struct lw_atomic_file {
    int fd;                            /* -1: not open */
    char *path;                        /* where the file shall appear; links resolved */
    char *temporary_path;              /* NULL: written directly */
    bool durable;                      /* commit waits until the disk has the bytes, then the name */
    const volatile sig_atomic_t *stop; /* NULL or: non-zero, e.g. by a signal, makes write and commit fail */
};

/** Whether a file could be written now, for programs that have long work before they write it. Leaves nothing
 * behind.
 * Errors: as lw_atomic_file_open(). */
LW_MUST_CHECK enum lw_status lw_atomic_file_check(const char *path, struct lw_error *err);

/** Errors: LW_CANNOT_CREATE naming the path; LW_NO_MEMORY. End with commit or abandon. */
LW_MUST_CHECK enum lw_status lw_atomic_file_open(struct lw_atomic_file *file, const char *path,
                                                 struct lw_error *err);

/** Appends size bytes. Errors: LW_IO naming the path; LW_CLOSED where `stop` says so. */
LW_MUST_CHECK enum lw_status lw_atomic_file_write(struct lw_atomic_file *file, const void *bytes, size_t size,
                                                  struct lw_error *err);

/** Writes size bytes at an offset, and leaves the place of the next write() as it is. Errors: LW_IO naming
 * the path. */
LW_MUST_CHECK enum lw_status lw_atomic_file_write_at(struct lw_atomic_file *file, const void *bytes,
                                                     size_t size, uint64_t offset_bytes,
                                                     struct lw_error *err);

/** Makes the file appear under its name and ends `file`, also on failure; then nothing appears.
 * Errors: LW_IO or LW_CANNOT_CREATE naming the path; LW_CLOSED where `stop` says so. */
LW_MUST_CHECK enum lw_status lw_atomic_file_commit(struct lw_atomic_file *file, struct lw_error *err);

/** A file of these bytes: open, write, commit. Errors: theirs. */
LW_MUST_CHECK enum lw_status lw_atomic_file_save(const char *path, const void *bytes, size_t size,
                                                 struct lw_error *err);

/** Removes the unfinished file and ends `file`; harmless after commit and on {.fd = -1}. */
void lw_atomic_file_abandon(struct lw_atomic_file *file);

/** Removes the temporary files that writers of this path left when they were killed; those of writers that
 * live are locked and stay. Where a file system has no locks, nothing is removed. Returns how many there
 * were. */
unsigned lw_atomic_file_sweep(const char *path);

#endif
