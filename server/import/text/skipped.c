#include "server/import/text/skipped.h"

#include "common/base/log.h"

#include <stdio.h>
#include <string.h>

void lw_skipped_add(struct lw_skipped *skipped, const char *what, const char *why, unsigned line) {
    char cut[sizeof skipped->kind->what];
    snprintf(cut, sizeof cut, "%s", what);
    for (unsigned i = 0; i < skipped->kind_count; i++)
        if (strcmp(skipped->kind[i].what, cut) == 0 && strcmp(skipped->kind[i].why, why) == 0) {
            skipped->kind[i].count++;
            return;
        }
    if (skipped->kind_count == LW_SKIPPED_KINDS) {
        skipped->other_count++;
        return;
    }
    skipped->kind[skipped->kind_count].why = why;
    skipped->kind[skipped->kind_count].line = line;
    skipped->kind[skipped->kind_count].count = 1;
    memcpy(skipped->kind[skipped->kind_count++].what, cut, sizeof cut);
}

void lw_skipped_report(const struct lw_skipped *skipped, const char *file) {
    for (unsigned i = 0; i < skipped->kind_count; i++) {
        char more[64] = "";
        if (skipped->kind[i].count > 1)
            snprintf(more, sizeof more, " (%llu such lines)", (unsigned long long)skipped->kind[i].count);
        lw_log(LW_LOG_WARNING, "%s: line %u: \"%s\": %s%s", file, skipped->kind[i].line,
               skipped->kind[i].what, skipped->kind[i].why, more);
    }
    if (skipped->other_count)
        lw_log(LW_LOG_WARNING, "%s: %llu more lines of other kinds are not read", file,
               (unsigned long long)skipped->other_count);
}
