/* guard.h: guards the process while a library reads an outside file. A crash, too much processor time or too
 * much memory end the process with one line that says why. The library's state is not used after that.
 * Threads: entered and left by the thread that calls the library; one guard at a time. */
#ifndef LW_IMPORT_GUARD_H
#define LW_IMPORT_GUARD_H

#include "common/base/status.h"

#include <stdint.h>

struct lw_guard_desc {
    const char *scene;  /* the file, for the line */
    const char *reader; /* e.g. "the FBX reader" */
    int failure_fd;     /* where the line goes; 0: stderr, behind the program's name */
    double processor_s; /* processor time of this process from now on; 0: no limit */
    /* address space on top of the current use; 0: no limit. A smaller limit of the process stays. */
    uint64_t memory_bytes;
};

/** Bounds the processor time of all that the process does from now on, for good: at its end the exit code of
 * LW_BAD_DATA and a line that names --import-seconds. desc: reader and memory_bytes count for nothing. */
void lw_guard_bound(const struct lw_guard_desc *desc);

/** Opens the file with the amount of memory in use, for a process that cannot open files later. Without this
 * enter() does. Returns the descriptor; 0: there is none. */
int lw_guard_prepare(void);

/** From here on: the exit code of LW_BAD_DATA and a line, where otherwise a signal would end the process.
 * The limit on memory makes allocations fail, which the library reports in its own way.
 * Builds with a sanitizer keep their own signal handlers and have no limit on memory. */
void lw_guard_enter(const struct lw_guard_desc *desc);
/** Lifts the limits on time and memory. Crashes are still caught: what the library left behind may be
 * broken. */
void lw_guard_lift(void);
/** Restores what enter() found. */
void lw_guard_leave(void);

#endif
