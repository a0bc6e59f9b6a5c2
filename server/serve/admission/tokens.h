/* tokens.h: the tokens that a server takes: for looking, and for changing the scene.
 * Flow:    file -> [tokens]; HELLO's token -> [tokens] -> role
 * Threads: a table is immutable; [any].
 *
 * A file has a line for each: ROLE TOKEN, where ROLE is view or control, and TOKEN 64 hexadecimal digits
 * (lightwellctl token makes such a line). Empty lines and those that begin with # say nothing. */
#ifndef LW_SERVE_ADMISSION_TOKENS_H
#define LW_SERVE_ADMISSION_TOKENS_H

#include "common/base/token.h"

#define LW_TOKENS_MAX      1024u
#define LW_TOKENS_FILE_MAX (256u << 10) /* bytes */

enum lw_tokens_role {
    LW_TOKENS_NONE,   /* may not connect */
    LW_TOKENS_VIEW,   /* may look */
    LW_TOKENS_CONTROL /* may change the scene as well */
};

struct lw_tokens {
    uint32_t count;
    struct lw_tokens_entry {
        struct lw_token token;
        enum lw_tokens_role role;
    } entry[];
};

/** Reads a file's text. Errors: LW_BAD_DATA naming the line, but no token; none
 * at all is one; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_tokens_parse(const char *text, size_t size, struct lw_tokens **out_tokens,
                                             struct lw_error *err);

/** Reads a file that its owner alone may read. Errors: as lw_secret_file_read() and lw_tokens_parse(), naming
 * the path. */
LW_MUST_CHECK enum lw_status lw_tokens_read(const char *path, struct lw_tokens **out_tokens,
                                            struct lw_error *err);

/** Role of a token. token: LW_TOKEN_SIZE bytes, or NULL: none. Takes the same time for every token. */
enum lw_tokens_role lw_tokens_role(const struct lw_tokens *tokens, const uint8_t *token);

/** Overwrites and frees. NULL is fine. */
void lw_tokens_destroy(struct lw_tokens *tokens);

#endif
