#include "common/base/log.h"

#include <errno.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

/* The one exception to "no globals but tables of constants": a log line has no context to carry them, and
 * they are written before threads start; the level may change later. */
static const char *program_name = "lightwell";
static _Atomic(enum lw_log_level) most_talkative = LW_LOG_INFO;
static enum lw_log_format chosen = LW_LOG_TEXT;

static const char *const level_names[] = {
    [LW_LOG_ERROR] = "error", [LW_LOG_WARNING] = "warning", [LW_LOG_INFO] = "info", [LW_LOG_DEBUG] = "debug"};

void lw_log_init(const char *program, enum lw_log_level level) {
    program_name = program;
    lw_log_set_level(level);
}

void lw_log_set_level(enum lw_log_level level) { most_talkative = level; }

/* isatty(), by calls that a signal's handler may make. */
static bool is_terminal(void) {
    struct termios settings;
    return tcgetattr(STDERR_FILENO, &settings) == 0;
}

void lw_log_set_format(enum lw_log_format format) {
    chosen = format != LW_LOG_AUTO ? format : is_terminal() ? LW_LOG_TEXT : LW_LOG_JSON;
}

enum lw_log_format lw_log_get_format(void) { return chosen; }
enum lw_log_level lw_log_get_level(void) { return most_talkative; }
const char *lw_log_level_name(enum lw_log_level level) { return level_names[level]; }
bool lw_log_is_drawn(void) { return chosen == LW_LOG_TEXT && is_terminal(); }
bool lw_log_shows(enum lw_log_level level) { return level <= most_talkative; }

/* ---- JSON ---- */

/* Writes `digits` digits of value. */
static char *put_digits(char *at, uint64_t value, unsigned digits) {
    for (unsigned i = digits; i-- > 0; value /= 10) at[i] = (char)('0' + value % 10);
    return at + digits;
}

/* "2026-11-25T03:57:41.123Z": 24 characters and a zero. By arithmetic alone, since gmtime_r() is not for
 * signal handlers. Days to a date: Hinnant, "chrono-Compatible Low-Level Date Algorithms",
 * civil_from_days. */
static void format_time(char dst[25]) {
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    const uint64_t seconds = (uint64_t)now.tv_sec, days = seconds / 86400 + 719468;
    const uint64_t era = days / 146097, of_era = days % 146097;
    const uint64_t year_of_era = (of_era - of_era / 1460 + of_era / 36524 - of_era / 146096) / 365;
    const uint64_t day_of_year = of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    const uint64_t month_from_march = (5 * day_of_year + 2) / 153;
    const uint64_t month = month_from_march < 10 ? month_from_march + 3 : month_from_march - 9;
    char *at = put_digits(dst, year_of_era + era * 400 + (month <= 2), 4);
    *at++ = '-';
    at = put_digits(at, month, 2);
    *at++ = '-';
    at = put_digits(at, day_of_year - (153 * month_from_march + 2) / 5 + 1, 2);
    *at++ = 'T';
    at = put_digits(at, seconds / 3600 % 24, 2);
    *at++ = ':';
    at = put_digits(at, seconds / 60 % 60, 2);
    *at++ = ':';
    at = put_digits(at, seconds % 60, 2);
    *at++ = '.';
    at = put_digits(at, (uint64_t)now.tv_nsec / 1000000, 3);
    *at++ = 'Z';
    *at = '\0';
}

/* Bytes of the UTF-8 character at s (Unicode 15, table 3-7); 0 if it is malformed. */
static size_t utf8_length(const unsigned char *s) {
    const unsigned char low = s[0] == 0xe0 ? 0xa0 : s[0] == 0xf0 ? 0x90 : 0x80;
    const unsigned char high = s[0] == 0xed ? 0x9f : s[0] == 0xf4 ? 0x8f : 0xbf;
    if (s[0] < 0x80) return 1;
    const size_t length = s[0] >= 0xc2 && s[0] <= 0xdf   ? 2
                          : s[0] >= 0xe0 && s[0] <= 0xef ? 3
                          : s[0] >= 0xf0 && s[0] <= 0xf4 ? 4
                                                         : 0;
    for (size_t i = 1; i < length; i++)
        if (s[i] < (i == 1 ? low : 0x80) || s[i] > (i == 1 ? high : 0xbf)) return 0;
    return length;
}

/* text as the inside of a JSON string; cut between characters where dst is full. */
static size_t escape(char *dst, size_t dst_size, const char *text) {
    const unsigned char *s = (const unsigned char *)text;
    size_t size = 0;
    while (*s && size + 5 < dst_size) {
        const size_t length = utf8_length(s);
        if (*s == '"' || *s == '\\') dst[size++] = '\\';
        if (length) memcpy(dst + size, s, length);
        if (!length) dst[size] = '?';
        size += length ? length : 1;
        s += length ? length : 1;
    }
    dst[size] = '\0';
    return size;
}

/* ---- lines ---- */

#define MESSAGE_MAX 960 /* bytes of text */

void lw_log(enum lw_log_level level, const char *format, ...) {
    if (!lw_log_shows(level)) return;
    char message[MESSAGE_MAX], line[2 * MESSAGE_MAX + 256]; /* escaped, and what stands around it */
    va_list args;
    va_start(args, format);
    const int body = vsnprintf(message, sizeof message, format, args);
    va_end(args);
    if (body < 0) return;
    lw_status_one_line(message);
    int length;
    if (chosen == LW_LOG_JSON) {
        char escaped[2 * MESSAGE_MAX], program[128], time[25];
        format_time(time);
        escape(program, sizeof program, program_name);
        escape(escaped, sizeof escaped, message);
        length = snprintf(line, sizeof line,
                          "{\"time\":\"%s\",\"level\":\"%s\",\"program\":\"%s\",\"message\":\"%s\"}\n", time,
                          level_names[level], program, escaped);
    } else {
        const bool says = level != LW_LOG_INFO;
        /* a progress bar may stand on this line of the terminal: wipe it */
        length = snprintf(line, sizeof line, "%s%.100s: %s%s%s\n", is_terminal() ? "\r\033[K" : "",
                          program_name, says ? level_names[level] : "", says ? ": " : "", message);
    }
    /* one call per line: stdio holds stderr's lock for all of it, so lines of several threads never
     * interleave; a log that cannot be written has nobody to tell */
    if (length > 0) (void)!fwrite(line, 1, (size_t)length, stderr);
}

static char *append(char *at, const char *end, const char *text) {
    while (*text && at < end) *at++ = *text++;
    return at;
}

/* Async-signal-safe calls alone: no stdio, whose lock the interrupted thread may hold. */
void lw_log_in_handler(const char *text) {
    if (!lw_log_shows(LW_LOG_INFO)) return;
    const int error = errno;
    const bool is_json = chosen == LW_LOG_JSON;
    char line[512], time[25], *end = line + sizeof line - 1;
    char *at = append(line, end, is_json ? "{\"time\":\"" : is_terminal() ? "\r\033[K" : "");
    if (is_json) {
        format_time(time);
        at = append(at, end, time);
        at = append(at, end, "\",\"level\":\"info\",\"program\":\"");
    }
    at = append(at, end, program_name);
    at = append(at, end, is_json ? "\",\"message\":\"" : ": ");
    at = append(at, end, text);
    if (is_json) at = append(at, end, "\"}");
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
