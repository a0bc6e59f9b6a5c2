#include "client/lib/live_error.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

/* ---- errors ---- */

static enum lw_live_status public_status(enum lw_status status) {
    switch (status) {
    case LW_OK:
        return LW_LIVE_OK;
    case LW_USAGE:
        return LW_LIVE_USAGE;
    case LW_BAD_DATA:
        return LW_LIVE_BAD_DATA;
    case LW_NO_HOST:
        return LW_LIVE_NO_HOST;
    case LW_UNAVAILABLE:
        return LW_LIVE_UNAVAILABLE;
    case LW_NO_MEMORY:
        return LW_LIVE_NO_MEMORY;
    case LW_OS:
        return LW_LIVE_SYSTEM;
    case LW_TIMED_OUT:
        return LW_LIVE_TIMED_OUT;
    case LW_PROTOCOL:
        return LW_LIVE_PROTOCOL;
    case LW_CLOSED:
        return LW_LIVE_CLOSED;
    case LW_NOT_ALLOWED:
        return LW_LIVE_NOT_ALLOWED;
    default:
        return LW_LIVE_INTERNAL;
    }
}

enum lw_live_status lw_live_fail(struct lw_live_error *err, enum lw_live_status status, const char *format,
                                 ...) {
    if (!err) return status;
    va_list args;
    va_start(args, format);
    vsnprintf(err->text, sizeof err->text, format, args);
    va_end(args);
    lw_status_one_line(err->text);
    err->status = status;
    return status;
}

enum lw_live_status lw_live_pass(struct lw_live_error *err, enum lw_status status,
                                 const struct lw_error *cause) {
    if (status == LW_OK) return LW_LIVE_OK;
    return lw_live_fail(err, public_status(status), "%s",
                        cause && cause->status != LW_OK ? cause->text : lw_status_text(status));
}

/* ---- structs from outside: the first version of each is the smallest there is ---- */

size_t lw_live_struct_size(const void *outside) {
    size_t size = 0;
    if (outside) memcpy(&size, outside, sizeof size);
    return size;
}

bool lw_live_read_struct(void *dst, size_t dst_size, const void *src) {
    const size_t size = lw_live_struct_size(src);
    if (size < dst_size) return false;
    memcpy(dst, src, dst_size);
    return true;
}

bool lw_live_write_struct(void *dst, void *src, size_t src_size) {
    const size_t size = lw_live_struct_size(dst);
    if (size < src_size) return false;
    memcpy(src, &size, sizeof size);
    memcpy(dst, src, src_size);
    return true;
}
