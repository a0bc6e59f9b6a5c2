/* ctl_figures.h: a server's figures, as Prometheus gets them, read and put into lines for people.
 * Flow:    REPORT's text -> [figures] -> a table, a line a second, or JSON
 * Threads: one thread at a time. */
#ifndef LW_CLIENT_CTL_FIGURES_H
#define LW_CLIENT_CTL_FIGURES_H

#include "common/base/status.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/** Figures by their names, labels included: "lightwell_rays_total{kind=\"probe\"}". */
struct lw_ctl_figures {
    char *text; /* the names, cut out of it */
    struct lw_ctl_figure {
        const char *name;
        double value;
    } * figure;
    size_t count;
    uint64_t as_of_ns; /* lw_clock_ns() */
};

/** Reads text format 0.0.4. text: the figures' from now on, also on failure.
 * Errors: LW_PROTOCOL: a line that is none; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_ctl_figures_read(struct lw_ctl_figures *figures, char *text,
                                                 uint64_t as_of_ns, struct lw_error *err);
/** Zeroed ones are fine. */
void lw_ctl_figures_finish(struct lw_ctl_figures *figures);

/** The figure of a name; 0 where there is none. */
double lw_ctl_figures_get(const struct lw_ctl_figures *figures, const char *name);

/** A table of several lines, ended by '\n'. */
void lw_ctl_figures_table(const struct lw_ctl_figures *figures, char *dst, size_t dst_size);

/** One line of the changes between two readings, a second apart or so; without '\n'. */
void lw_ctl_figures_line(const struct lw_ctl_figures *before, const struct lw_ctl_figures *now, char *dst,
                         size_t dst_size);

#endif
