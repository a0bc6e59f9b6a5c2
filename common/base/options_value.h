/* options_value.h: values of options as text, and the sentences of --help that say them.
 * Flow:    table, before parsing -> [options_value] -> table whose help says the defaults -> --help, manual
 * Threads: main() only.
 *
 * A default is stated once, as the option's value. Its help has a place for it:
 *   {}           the value, as a file of options has it: "seed of all random numbers (default {})"
 *   {WORD}       " (default)" if the value is WORD, else nothing: "real: wall time{real}. step: 1/30 s"
 *   {WORD|TEXT}  TEXT if the value is WORD, else nothing
 * WORD is for texts and choices. Help says in words what an option does that is not set. */
#ifndef LW_COMMON_BASE_OPTIONS_VALUE_H
#define LW_COMMON_BASE_OPTIONS_VALUE_H

#include "common/base/options.h"

#include <stdio.h>

/** Writes a value that lw_options_set() takes back: a real as short as it is exact. A text must not be NULL,
 * and a choice must be one of its list. */
void lw_options_value_write(const struct lw_option *o, FILE *stream);

/** Writes an option's help with the present value in its places. */
void lw_options_value_write_help(const struct lw_option *o, FILE *stream);

/** A copy of a table whose help has the present values in its places. The caller calls
 * lw_options_value_free(). NULL: out of memory. */
struct lw_option *lw_options_value_fill(const struct lw_option *table, size_t count);
void lw_options_value_free(struct lw_option *filled, size_t count);

#endif
