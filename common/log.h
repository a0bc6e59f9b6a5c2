/* log.h: log lines for people, on stderr. Data goes to stdout, elsewhere.
 * Threads: [any]; lines never interleave. */
#ifndef LW_COMMON_LOG_H
#define LW_COMMON_LOG_H

#include "common/status.h"

enum lw_log_level { LW_LOG_ERROR, LW_LOG_WARNING, LW_LOG_INFO, LW_LOG_DEBUG };

/** Sets the program's name, which opens every line, and the most verbose level shown (default INFO). Call
 * once, before other threads start. */
void lw_log_init(const char *program, enum lw_log_level level);

/** Whether lines of this level are shown. */
bool lw_log_shows(enum lw_log_level level);

/** One line: "program: text" (errors and warnings say so). No final newline in format;
 * control characters in the text become '?'. */
void lw_log(enum lw_log_level level, const char *format, ...) LW_PRINTF(2, 3);

/** The same at LW_LOG_INFO of a plain text of at most 300 bytes, for signal handlers. */
void lw_log_in_handler(const char *text);

/** Logs an error, a lack of memory by that name whatever the text, and returns its exit code: `return lw_log_failure(&err);` ends a main(). */
int lw_log_failure(const struct lw_error *err);

#endif
