/* log.h: log lines for people, on stderr. Data goes to stdout, elsewhere.
 * Threads: [any]; lines never interleave. */
#ifndef LW_COMMON_BASE_LOG_H
#define LW_COMMON_BASE_LOG_H

#include "common/base/status.h"

enum lw_log_level { LW_LOG_ERROR, LW_LOG_WARNING, LW_LOG_INFO, LW_LOG_DEBUG };
#define LW_LOG_LEVELS "error|warning|info|debug" /* as the choices of an option */

/** TEXT: "program: text"; errors, warnings and debugging say so. JSON: an object with the strings "time"
 * (RFC 3339, UTC, milliseconds), "level", "program" and "message", in UTF-8. AUTO: TEXT if stderr is a
 * terminal. */
enum lw_log_format { LW_LOG_AUTO, LW_LOG_TEXT, LW_LOG_JSON };
#define LW_LOG_FORMATS "auto|text|json"

/* clang-format off */
/** Rows of an option table (options.h). format, level: int */
#define LW_LOG_OPTIONS(format, level)                                                                        \
    {"log-format", LW_LOG_FORMATS,                                                                           \
     "lines on stderr: text for people, or a JSON object each (default {}: text on a terminal, else "      \
     "JSON)",                                                                                                \
     LW_OPTION_CHOICE, (format), 0, 0, NULL},                                                                \
    {"log-level", LW_LOG_LEVELS, "the most verbose lines that are shown (default {})", LW_OPTION_CHOICE,   \
     (level), 0, 0, NULL}
/* clang-format on */

/** Sets the program's name, which opens every line, and the most verbose level shown (default INFO). Call
 * once, before other threads start. */
void lw_log_init(const char *program, enum lw_log_level level);

/** The most verbose level shown from now on. */
void lw_log_set_level(enum lw_log_level level);

/** Sets the format of lines. It is LW_LOG_TEXT at first. Call once, before other threads start. */
void lw_log_set_format(enum lw_log_format format);

/** The chosen format and level, for programs that are started. Never LW_LOG_AUTO. */
enum lw_log_format lw_log_get_format(void);
enum lw_log_level lw_log_get_level(void);
const char *lw_log_level_name(enum lw_log_level level);

/** Whether progress may be drawn over the last line: stderr is a terminal, and lines are text. */
bool lw_log_is_drawn(void);

/** Whether lines of this level are shown. */
bool lw_log_shows(enum lw_log_level level);

/** One line. No final newline in format; control characters in the text become '?', and in JSON so do bytes
 * that are no UTF-8. */
void lw_log(enum lw_log_level level, const char *format, ...) LW_PRINTF(2, 3);

/** The same at LW_LOG_INFO of an ASCII text of at most 300 bytes without quotes or backslashes, for signal
 * handlers. */
void lw_log_in_handler(const char *text);

/** Logs an error and returns its exit code. Lack of memory is logged by that name. `return
 * lw_log_failure(&err);` ends a main(). */
int lw_log_failure(const struct lw_error *err);

#endif
