#include "server/cost_report.h"

#include "common/base/file_read.h"

#include <limits.h>
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const char head[] = "renderer,setting,cpu_s,";

/* A cell, which ends at a comma or at the line's end. False: it does not fit. */
static bool take_cell(char **at, char *dst, size_t size) {
    const char *cell = strsep(at, ",");
    return cell && *cell && strlen(cell) < size && snprintf(dst, size, "%s", cell) > 0;
}

static bool read_row(char *line, struct lw_cost_report_row *out) {
    char cost[40], *end;
    if (!take_cell(&line, out->renderer, sizeof out->renderer) ||
        !take_cell(&line, out->setting, sizeof out->setting) || !take_cell(&line, cost, sizeof cost))
        return false;
    out->cpu_s = strtod(cost, &end);
    return !*end && isfinite(out->cpu_s) && out->cpu_s > 0;
}

static enum lw_status read_rows(char *text, struct lw_cost_report *out, struct lw_error *err) {
    struct lw_cost_report report = {0};
    unsigned number = 0;
    for (char *line; (line = strsep(&text, "\n")) != NULL;) {
        struct lw_cost_report_row row;
        number++;
        if (number == 1 && strncmp(line, head, sizeof head - 1) != 0)
            return lw_status_fail(err, LW_BAD_DATA, "line 1 is not \"%s...\"", head);
        if (number == 1 || !*line) continue;
        if (!read_row(line, &row)) return lw_status_fail(err, LW_BAD_DATA, "line %u makes no sense", number);
        if (strcmp(row.renderer, "cache") != 0 && report.count < LW_COST_REPORT_MAX)
            report.row[report.count++] = row;
    }
    if (!report.count) return lw_status_fail(err, LW_BAD_DATA, "has no renderer but the cache");
    *out = report;
    return LW_OK;
}

enum lw_status lw_cost_report_read(const char *folder, struct lw_cost_report *out_report,
                                   struct lw_error *err) {
    char path[PATH_MAX];
    uint8_t *bytes;
    size_t size;
    if ((size_t)snprintf(path, sizeof path, "%s/curves.csv", folder) >= sizeof path)
        return lw_status_fail(err, LW_NO_INPUT, "%.200s...: the path is too long", folder);
    enum lw_status status = lw_file_read(path, LW_COST_REPORT_BYTES_MAX, true, &bytes, &size, err);
    if (status != LW_OK) {
        lw_status_context(err, "%s", path);
        return status;
    }
    char *text = strndup((const char *)bytes, size);
    free(bytes);
    if (!text) return lw_status_fail(err, LW_NO_MEMORY, "%s: out of memory", path);
    status = read_rows(text, out_report, err);
    if (status != LW_OK) lw_status_context(err, "%s", path);
    free(text);
    return status;
}
