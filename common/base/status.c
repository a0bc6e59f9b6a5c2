#include "common/base/status.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

static const struct {
    const char *text;
    int exit_code;
} statuses[LW_STATUS_COUNT] = {
#define X(name, text, exit_code) [LW_##name] = {text, exit_code},
    LW_STATUS_MAP(X)
#undef X
};

const char *lw_status_text(enum lw_status status) {
    return (unsigned)status < LW_STATUS_COUNT ? statuses[status].text : "unknown status";
}

int lw_status_exit_code(enum lw_status status) {
    return (unsigned)status < LW_STATUS_COUNT ? statuses[status].exit_code : statuses[LW_INTERNAL].exit_code;
}

void lw_status_one_line(char *text) {
    for (unsigned char *c = (unsigned char *)text; *c; c++)
        if (*c < 0x20 || *c == 0x7f) *c = '?';
}

enum lw_status lw_status_fail(struct lw_error *err, enum lw_status status, const char *format, ...) {
    if (err && err->status == LW_OK) {
        va_list args;
        va_start(args, format);
        vsnprintf(err->text, sizeof err->text, format, args);
        va_end(args);
        lw_status_one_line(err->text);
        err->status = status;
    }
    return status;
}

void lw_status_context(struct lw_error *err, const char *format, ...) {
    if (!err || err->status == LW_OK) return;
    char cause[LW_ERROR_TEXT_SIZE], context[LW_ERROR_TEXT_SIZE];
    memcpy(cause, err->text, sizeof cause);
    va_list args;
    va_start(args, format);
    vsnprintf(context, sizeof context, format, args);
    va_end(args);
    lw_status_one_line(context);
    size_t cause_length = strlen(cause), length = strlen(context);
    size_t room = sizeof err->text - sizeof ": " - cause_length;
    if (cause_length + sizeof ": " >= sizeof err->text) return;
    if (length > room) length = room;
    memcpy(err->text, context, length);
    memcpy(err->text + length, ": ", 2);
    memcpy(err->text + length + 2, cause, cause_length + 1);
}
