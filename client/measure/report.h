/* report.h: the files of a report. Each grows in memory and is saved whole.
 * Flow:    figures -> print functions -> [report] -> FOLDER/NAME; gnuplot -> *.png, *.svg
 * Threads: one thread at a time. */
#ifndef LW_CLIENT_MEASURE_REPORT_H
#define LW_CLIENT_MEASURE_REPORT_H

#include "common/base/status.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

/** A file while it is printed. */
struct lw_report {
    FILE *f;          /* takes further text, as CSV lines */
    uint32_t columns; /* columns of the current row */
    uint32_t series;  /* series of the current plot */
};

struct lw_report_file {
    const char *name;
    void (*print)(struct lw_report *report, const void *context);
};

/** Prints a file into memory. The caller frees *out_bytes, which a 0 follows. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_report_print(const struct lw_report_file *file, const void *context,
                                             char **out_bytes, size_t *out_size, struct lw_error *err);
/** Prints files and replaces each in one step. Errors: LW_NO_MEMORY, LW_CANNOT_CREATE, LW_IO. */
LW_MUST_CHECK enum lw_status lw_report_save(const char *folder, const struct lw_report_file *file,
                                            size_t count, const void *context, struct lw_error *err);

/* ---- Markdown ---- */

/** paragraph: NULL where none follows. */
void lw_report_section(struct lw_report *report, const char *title, const char *paragraph);
void lw_report_paragraph(struct lw_report *report, const char *format, ...) LW_PRINTF(2, 3);
/** The command line that made the report, the machine and the day. The paragraph goes on. */
void lw_report_origin(struct lw_report *report, const char *command, const char *machine, const char *day);

/** Ends the titles of a table with its last ones, apart by " | ". NULL: cells have all titles. */
void lw_report_head(struct lw_report *report, const char *titles);
/** Adds a cell to a row, or several, apart by " | " in the format. */
void lw_report_cell(struct lw_report *report, const char *format, ...) LW_PRINTF(2, 3);
/** A number, or a dash where it is not known. */
void lw_report_number(struct lw_report *report, double x);
/** A whole row. */
void lw_report_row(struct lw_report *report, const char *format, ...) LW_PRINTF(2, 3);
void lw_report_end_row(struct lw_report *report);

/** A figure as text, for sentences and cells. */
struct lw_report_words {
    char text[160];
};

/* ---- gnuplot scripts ---- */

/** NAME.png and NAME.svg, of this size in pixels. */
struct lw_report_plot {
    const char *name;
    unsigned width, height;
};

/** Begins a script. key: the legend's corner. */
void lw_report_script(struct lw_report *report, const char *key);
void lw_report_plot(struct lw_report *report, const struct lw_report_plot *plot);
/** Adds a series. format: the file, its columns and their style. */
void lw_report_series(struct lw_report *report, const char *title, const char *format, ...) LW_PRINTF(3, 4);
void lw_report_end_plot(struct lw_report *report, const struct lw_report_plot *plot);

/** Runs gnuplot on a script in a folder, which becomes its own; a warning says where that did not work. */
void lw_report_run_gnuplot(const char *folder, const char *script);

#endif
