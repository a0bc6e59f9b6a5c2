#include "server/import/tally.h"

#include "common/base/log.h"

#include <stdio.h>

void lw_tally_add(struct lw_tally *tally, const char *name) {
    if (tally->count++ == 0) snprintf(tally->first, sizeof tally->first, "%s", name);
}

void lw_tally_warn(const struct lw_tally *tally, const char *file, const char *text) {
    if (tally->count > 1)
        lw_log(LW_LOG_WARNING, "%s: %s: \"%s\" and %llu more", file, text, tally->first,
               (unsigned long long)(tally->count - 1));
    else if (tally->count == 1)
        lw_log(LW_LOG_WARNING, "%s: %s: \"%s\"", file, text, tally->first);
}
