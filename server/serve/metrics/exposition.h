/* exposition.h: metrics as text, in Prometheus' exposition format, version 0.0.4.
 * Flow:    figures -> [exposition] -> text of /metrics
 * Threads: one thread per text. */
#ifndef LW_SERVE_METRICS_EXPOSITION_H
#define LW_SERVE_METRICS_EXPOSITION_H

#include "common/base/status.h"
#include "server/serve/metrics/durations.h"

#include <stdio.h>

#define LW_EXPOSITION_TYPE "text/plain; version=0.0.4; charset=utf-8"

struct lw_exposition {
    FILE *stream;
    char *text;
    size_t size;
};

/** Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_exposition_begin(struct lw_exposition *exposition);
/** The text, the caller's to free(), with a terminator that *out_size does not
 * count. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_exposition_end(struct lw_exposition *exposition, char **out_text,
                                               size_t *out_size);

/** Opens a metric: what follows are its samples. kind: "counter", "gauge" or "histogram". help: one line. */
void lw_exposition_metric(struct lw_exposition *exposition, const char *name, const char *kind,
                          const char *help);
/** One sample. labels: NULL, or `key="value"` apart by commas, values escaped by lw_exposition_escape(). */
void lw_exposition_sample(struct lw_exposition *exposition, const char *name, const char *labels,
                          double value);
/** The samples of a histogram, in seconds. */
void lw_exposition_durations(struct lw_exposition *exposition, const char *name, const char *labels,
                             const struct lw_durations *durations);
/** A metric with one sample. */
void lw_exposition_counter(struct lw_exposition *exposition, const char *name, double value,
                           const char *help);
void lw_exposition_gauge(struct lw_exposition *exposition, const char *name, double value, const char *help);

/** A label's value: backslash, quote and newline are escaped; text that does not fit is cut off. */
void lw_exposition_escape(char *dst, size_t size, const char *text);

#endif
