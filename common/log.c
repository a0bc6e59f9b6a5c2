#include "common/log.h"

#include <errno.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <termios.h>
#include <unistd.h>

/* The one exception to "no globals but tables of constants": a log line has no context to carry them, and
 * they are written once, before threads start. */
static const char *program_name = "lightwell";
static enum lw_log_level most_talkative = LW_LOG_INFO;

void lw_log_init(const char *program, enum lw_log_level level) {
    program_name = program;
    most_talkative = level;
}

bool lw_log_shows(enum lw_log_level level) { return level <= most_talkative; }

/* isatty(), by what may be called in a signal's handler. */
static bool is_terminal(void) {
    struct termios settings;
    return tcgetattr(STDERR_FILENO, &settings) == 0;
}

void lw_log(enum lw_log_level level, const char *format, ...) {
    if (!lw_log_shows(level)) return;
    static const char *const kinds[] = {[LW_LOG_ERROR] = "error: ",
                                        [LW_LOG_WARNING] = "warning: ",
                                        [LW_LOG_INFO] = "",
                                        [LW_LOG_DEBUG] = "debug: "};
    char line[1024];
    /* a progress bar may stand on this line of the terminal: wipe it */
    const char *wipe = is_terminal() ? "\r\033[K" : "";
    int head = snprintf(line, sizeof line, "%s%.100s: %s", wipe, program_name, kinds[level]);
    if (head < 0) return;
    va_list args;
    va_start(args, format);
    int body = vsnprintf(line + head, sizeof line - (size_t)head - 1, format, args);
    va_end(args);
    if (body < 0) return;
    lw_status_one_line(line + head);
    size_t length = strlen(line);
    line[length++] = '\n';
    /* one call per line: stdio holds stderr's lock for all of it, so lines of several threads never
     * interleave; a log that cannot be written has nobody to tell */
    (void)!fwrite(line, 1, length, stderr);
}

static char *append(char *at, const char *end, const char *text) {
    while (*text && at < end) *at++ = *text++;
    return at;
}

/* Async-signal-safe calls alone: no stdio, whose lock the interrupted thread may hold. */
void lw_log_in_handler(const char *text) {
    if (!lw_log_shows(LW_LOG_INFO)) return;
    const int error = errno;
    char line[512], *end = line + sizeof line - 1;
    char *at = append(line, end, is_terminal() ? "\r\033[K" : "");
    at = append(at, end, program_name);
    at = append(at, end, ": ");
    at = append(at, end, text);
    *at++ = '\n';
    (void)!write(STDERR_FILENO, line, (size_t)(at - line));
    errno = error;
}

int lw_log_failure(const struct lw_error *err) {
    const char *text = err->text[0] ? err->text : lw_status_text(err->status);
    const bool names_memory = err->status != LW_NO_MEMORY || strstr(text, lw_status_text(LW_NO_MEMORY));
    if (err->status != LW_OK) lw_log(LW_LOG_ERROR, "%s%s", names_memory ? "" : "out of memory: ", text);
    return lw_status_exit_code(err->status);
}
