#include "common/base/token.h"

#include "common/base/secret_file.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>

#define FILE_MAX 65536u /* bytes */

enum lw_status lw_token_make(struct lw_token *out_token, struct lw_error *err) {
    struct lw_token token;
    if (getrandom(token.bytes, sizeof token.bytes, 0) != (ssize_t)sizeof token.bytes)
        return lw_status_fail(err, LW_OS, "the system gives no random numbers");
    *out_token = token;
    return LW_OK;
}

void lw_token_format(const struct lw_token *token, char out_text[LW_TOKEN_TEXT_SIZE]) {
    for (size_t i = 0; i < LW_TOKEN_SIZE; i++) snprintf(out_text + 2 * i, 3, "%02x", token->bytes[i]);
}

static int digit_of(char c) {
    if (c >= '0' && c <= '9') return c - '0';
    if (c >= 'a' && c <= 'f') return c - 'a' + 10;
    return c >= 'A' && c <= 'F' ? c - 'A' + 10 : -1;
}

bool lw_token_parse(const char *text, size_t size, struct lw_token *out_token) {
    struct lw_token token;
    if (size != 2 * LW_TOKEN_SIZE) return false;
    for (size_t i = 0; i < LW_TOKEN_SIZE; i++) {
        const int high = digit_of(text[2 * i]), low = digit_of(text[2 * i + 1]);
        if (high < 0 || low < 0) return false;
        token.bytes[i] = (uint8_t)(high << 4 | low);
    }
    *out_token = token;
    return true;
}

/* Finds the last word of the first line that says something. */
static bool find(const char *text, size_t size, struct lw_token *out_token) {
    for (size_t at = 0; at < size;) {
        const char *line = text + at, *end = memchr(line, '\n', size - at);
        size_t length = end ? (size_t)(end - line) : size - at;
        at += length + 1;
        while (length && strchr(" \t\r", line[length - 1])) length--;
        if (!length || *line == '#') continue;
        size_t first = length;
        while (first && !strchr(" \t", line[first - 1])) first--;
        return lw_token_parse(line + first, length - first, out_token);
    }
    return false;
}

enum lw_status lw_token_read(const char *path, struct lw_token *out_token, struct lw_error *err) {
    uint8_t *bytes;
    size_t size;
    enum lw_status status = lw_secret_file_read(path, LW_SECRET_FILE_OWNER, FILE_MAX, &bytes, &size, err);
    if (status != LW_OK) return status;
    if (!find((const char *)bytes, size, out_token))
        status = lw_status_fail(err, LW_BAD_DATA,
                                "%s: its first line ends in no token of 64 hexadecimal digits", path);
    lw_secret_file_free(bytes, size);
    return status;
}
