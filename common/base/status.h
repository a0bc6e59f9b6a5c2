/* status.h: results of functions: a code for programs, and one line of text for people.
 * Threads: values only; an lw_error belongs to the caller that made it. */
#ifndef LW_COMMON_BASE_STATUS_H
#define LW_COMMON_BASE_STATUS_H

#include <stdbool.h>
#include <stddef.h>

/* name, what it means, the exit code a program ends with (sysexits.h) */
#define LW_STATUS_MAP(X)                                                                                     \
    X(OK, "success", 0)                                                                                      \
    X(USAGE, "wrong use of an option", 64)                                                                   \
    X(BAD_DATA, "malformed or unsupported data", 65)                                                         \
    X(NO_INPUT, "cannot open the input", 66)                                                                 \
    X(NO_HOST, "host name unknown", 68)                                                                      \
    X(UNAVAILABLE, "service unavailable", 69)                                                                \
    X(INTERNAL, "internal error", 70)                                                                        \
    X(NO_MEMORY, "out of memory", 71)                                                                        \
    X(OS, "system error", 71)                                                                                \
    X(CANNOT_CREATE, "cannot create the output", 73)                                                         \
    X(IO, "input/output error", 74)                                                                          \
    X(TIMED_OUT, "timed out", 75)                                                                            \
    X(PROTOCOL, "protocol error", 76)                                                                        \
    X(CLOSED, "connection closed", 69)                                                                       \
    X(NOT_ALLOWED, "not allowed", 77)

enum lw_status {
#define X(name, text, exit_code) LW_##name,
    LW_STATUS_MAP(X)
#undef X
        LW_STATUS_COUNT
};

#define LW_MUST_CHECK                  __attribute__((warn_unused_result))
#define LW_PRINTF(format_index, first) __attribute__((format(printf, format_index, first)))

#define LW_ERROR_TEXT_SIZE 512

/** A failure with its detail. Zero-initialise; the first cause wins, callers add context in front. */
struct lw_error {
    enum lw_status status;
    char text[LW_ERROR_TEXT_SIZE]; /* one line, no final newline; names the file, field or option */
};

#ifdef __cplusplus
extern "C" {
#endif

/** Text of a status, e.g. "malformed or unsupported data". Never NULL. [any] */
const char *lw_status_text(enum lw_status status);

/** The sysexits code that a program ends with on this status. [any] */
int lw_status_exit_code(enum lw_status status);

/** Makes text fit one line of a terminal: control characters, which a hostile name may hold, become '?'.
 * [any] */
void lw_status_one_line(char *text);

/** Records a failure and returns its status, so that `return lw_status_fail(err, LW_IO, "...")` reads well.
 * err may be NULL. Does nothing to an err that already holds a cause. */
enum lw_status lw_status_fail(struct lw_error *err, enum lw_status status, const char *format, ...)
    LW_PRINTF(3, 4);

/** Puts "context: " in front of the text of an error that holds a cause; otherwise does nothing.
 * If both do not fit, the context is cut, since the cause is more useful. */
void lw_status_context(struct lw_error *err, const char *format, ...) LW_PRINTF(2, 3);

#ifdef __cplusplus
}
#endif

#endif
