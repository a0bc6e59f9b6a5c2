/* report_text.h: a text file of a measurement: it grows in memory and is saved whole.
 * Flow:    fprintf() -> [report_text] -> FOLDER/NAME
 * Threads: one thread at a time. */
#ifndef LW_CLIENT_MEASURE_REPORT_TEXT_H
#define LW_CLIENT_MEASURE_REPORT_TEXT_H

#include "common/base/status.h"

#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

struct lw_report_text {
    FILE *stream;
    const char *name; /* the file's, for errors as well */
    char *bytes;      /* valid after lw_report_text_end() */
    size_t size;
};

/** Starts an empty text. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_report_text_begin(struct lw_report_text *text, const char *name,
                                                  struct lw_error *err);

/** Closes the stream. On success the caller frees text->bytes. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_report_text_end(struct lw_report_text *text, struct lw_error *err);

/** Closes the stream, writes the file and frees the bytes, also where it fails. Errors: those of
 * lw_report_text_end() and lw_report_text_write(). */
LW_MUST_CHECK enum lw_status lw_report_text_save(struct lw_report_text *text, const char *folder,
                                                 struct lw_error *err);

/** Ends the head of a table with its rule. */
void lw_report_text_rule(FILE *stream, uint32_t columns);
/** Writes a cell of a table and its end: the number, or a dash where it is not known. */
void lw_report_text_number(FILE *stream, double x);

/** Replaces a file of a folder in one step. Errors: LW_CANNOT_CREATE, LW_IO. */
LW_MUST_CHECK enum lw_status lw_report_text_write(const char *folder, const char *name, const char *bytes,
                                                  size_t size, struct lw_error *err);

#endif
