/* text_lines.h: reads OBJ and MTL line by line, as people and exporters write them: with a byte order mark,
 * with any line ends, with lines that go on behind a backslash, with comments and blanks behind a statement.
 * Threads: a reader belongs to one thread. */
#ifndef LW_IMPORT_TEXT_LINES_H
#define LW_IMPORT_TEXT_LINES_H

#include "common/base/status.h"

#include <stdint.h>

#define LW_TEXT_LINES_KEYWORD_SIZE 32 /* longer ones are cut: none that is known is as long */

struct lw_text_lines {
    const char *at, *end;
    unsigned next; /* number of the line at `at` */
    /* the statement that was read */
    unsigned line;                            /* where it begins, from 1 */
    char keyword[LW_TEXT_LINES_KEYWORD_SIZE]; /* in lower case */
    char *rest;                               /* behind it, without blanks at its ends; may be cut up */
    /* memory of the statement */
    char *text;
    size_t capacity;
    bool out_of_memory;
};

/** The bytes must outlive the reader. */
void lw_text_lines_init(struct lw_text_lines *lines, const uint8_t *bytes, size_t size);
void lw_text_lines_finish(struct lw_text_lines *lines);

/** The next statement; lines that are empty or comments are passed over. False at the end, and when out of
 * memory. */
LW_MUST_CHECK bool lw_text_lines_next(struct lw_text_lines *lines);

/** Cuts the next word off *at and ends it with a NUL. NULL at the end, which a comment is too, also right
 * behind a word. */
char *lw_text_lines_word(char **at);

/** Whether all of the word is a number; nan and inf are. A comma counts as the point of a decimal, because
 * exporters write what their country does. */
bool lw_text_lines_number(const char *word, double *out);

/** Removes a comment behind a name, and the blanks before it: " #" and what follows, unless a digit does, as
 * in "Material #25". */
void lw_text_lines_cut_comment(char *name);

/** Whether the text begins as UTF-16 or UTF-32 does. */
bool lw_text_lines_is_wide(const uint8_t *bytes, size_t size);

#endif
