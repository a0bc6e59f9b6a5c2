/* skipped.h: statements of a text that are not read: one warning for each kind, with the line of the first.
 * Threads: a list belongs to one import. */
#ifndef LW_IMPORT_TEXT_SKIPPED_H
#define LW_IMPORT_TEXT_SKIPPED_H

#include "common/base/status.h"

#include <stdint.h>

#define LW_SKIPPED_KINDS 10 /* lines of one file; further kinds are counted */

struct lw_skipped {
    struct {
        char what[48]; /* cut where it is longer */
        const char *why;
        unsigned line; /* the first one's */
        uint64_t count;
    } kind[LW_SKIPPED_KINDS];
    unsigned kind_count;
    uint64_t other_count;
};

/** why: a constant; equal texts are one kind. */
void lw_skipped_add(struct lw_skipped *skipped, const char *what, const char *why, unsigned line);

/** Warns: `file: line 3: "curv": why (4 such lines)`. [any] */
void lw_skipped_report(const struct lw_skipped *skipped, const char *file);

#endif
