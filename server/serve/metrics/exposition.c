#include "server/serve/metrics/exposition.h"

#include <inttypes.h>
#include <math.h>
#include <stdlib.h>

enum lw_status lw_exposition_begin(struct lw_exposition *e) {
    *e = (struct lw_exposition){0};
    e->stream = open_memstream(&e->text, &e->size);
    return e->stream ? LW_OK : LW_NO_MEMORY;
}

enum lw_status lw_exposition_end(struct lw_exposition *e, char **out_text, size_t *out_size) {
    const bool failed = ferror(e->stream);
    if (fclose(e->stream) != 0 || failed) {
        free(e->text);
        return LW_NO_MEMORY;
    }
    *out_text = e->text;
    *out_size = e->size;
    return LW_OK;
}

void lw_exposition_metric(struct lw_exposition *e, const char *name, const char *kind, const char *help) {
    fprintf(e->stream, "# HELP %s %s\n# TYPE %s %s\n", name, help, name, kind);
}

/* Counts to the last digit, everything else as short as it is exact. */
static void print_value(FILE *stream, double value) {
    if (value == floor(value) && fabs(value) < 0x1p53)
        fprintf(stream, " %.0f\n", value);
    else
        fprintf(stream, " %.15g\n", value);
}

void lw_exposition_sample(struct lw_exposition *e, const char *name, const char *labels, double value) {
    fputs(name, e->stream);
    if (labels) fprintf(e->stream, "{%s}", labels);
    print_value(e->stream, value);
}

void lw_exposition_durations(struct lw_exposition *e, const char *name, const char *labels,
                             const struct lw_durations *durations) {
    const char *before = labels ? labels : "", *comma = labels ? "," : "";
    uint64_t seen = 0;
    for (unsigned b = 0; b < LW_DURATIONS_BOUNDS; b++) {
        seen += durations->count[b];
        fprintf(e->stream, "%s_bucket{%s%sle=\"%g\"} %" PRIu64 "\n", name, before, comma,
                lw_durations_bound_s[b], seen);
    }
    seen += durations->count[LW_DURATIONS_BOUNDS];
    fprintf(e->stream, "%s_bucket{%s%sle=\"+Inf\"} %" PRIu64 "\n", name, before, comma, seen);
    const char *open = labels ? "{" : "", *close = labels ? "}" : "";
    fprintf(e->stream, "%s_sum%s%s%s", name, open, before, close);
    print_value(e->stream, (double)durations->sum_ns * 1e-9);
    fprintf(e->stream, "%s_count%s%s%s %" PRIu64 "\n", name, open, before, close, seen);
}

void lw_exposition_counter(struct lw_exposition *e, const char *name, double value, const char *help) {
    lw_exposition_metric(e, name, "counter", help);
    lw_exposition_sample(e, name, NULL, value);
}

void lw_exposition_gauge(struct lw_exposition *e, const char *name, double value, const char *help) {
    lw_exposition_metric(e, name, "gauge", help);
    lw_exposition_sample(e, name, NULL, value);
}

void lw_exposition_escape(char *dst, size_t size, const char *text) {
    size_t at = 0;
    for (; *text && at + 2 < size; text++) {
        const bool special = *text == '\\' || *text == '"' || *text == '\n';
        if (special) dst[at++] = '\\';
        dst[at++] = *text == '\n' ? 'n' : *text;
    }
    if (size) dst[at] = '\0';
}
