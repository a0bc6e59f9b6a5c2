/* token.h: bearer tokens: 256 random bits, as bytes and as text, and one from a client's file.
 * Threads: [any]. */
#ifndef LW_COMMON_BASE_TOKEN_H
#define LW_COMMON_BASE_TOKEN_H

#include "common/base/status.h"

#include <stdint.h>

#define LW_TOKEN_SIZE      32u                     /* bytes */
#define LW_TOKEN_TEXT_SIZE (2 * LW_TOKEN_SIZE + 1) /* hexadecimal digits and the terminator */

struct lw_token {
    uint8_t bytes[LW_TOKEN_SIZE];
};

/** Makes one from the system's random numbers. Errors: LW_OS. */
LW_MUST_CHECK enum lw_status lw_token_make(struct lw_token *out_token, struct lw_error *err);

/** Its text: 64 hexadecimal digits in lower case. */
void lw_token_format(const struct lw_token *token, char out_text[LW_TOKEN_TEXT_SIZE]);

/** Reads 64 hexadecimal digits; text needs no terminator. false: it is anything else. */
bool lw_token_parse(const char *text, size_t size, struct lw_token *out_token);

/** Reads the token of a client from a file: it is the last word of the first line that is neither empty nor
 * begins with #, so that a line of the server's file will do.
 * Errors: as lw_secret_file_read(); LW_BAD_DATA: there is none. All name the path, none has the token. */
LW_MUST_CHECK enum lw_status lw_token_read(const char *path, struct lw_token *out_token,
                                           struct lw_error *err);

#endif
