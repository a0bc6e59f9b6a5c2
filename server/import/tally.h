/* tally.h: one warning for many cases: the first name, and the count of the others. */
#ifndef LW_IMPORT_TALLY_H
#define LW_IMPORT_TALLY_H

#include "common/base/status.h"

#include <stdint.h>

struct lw_tally {
    char first[80]; /* cut where it is longer */
    uint64_t count;
};

/** Counts one more; keeps the name of the first. */
void lw_tally_add(struct lw_tally *tally, const char *name);

/** One warning, `file: text "first" and N more`, if there is anything to say. [any] */
void lw_tally_warn(const struct lw_tally *tally, const char *file, const char *text);

#endif
