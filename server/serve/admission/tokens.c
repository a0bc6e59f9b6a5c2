#include "server/serve/admission/tokens.h"

#include "common/base/invariant.h"
#include "common/base/secret_file.h"

#include <openssl/crypto.h>
#include <stdlib.h>
#include <string.h>

/* A word of a line. Moves *at behind it. */
static size_t take_word(const char **at, const char *end, const char **out_word) {
    const char *p = *at;
    while (p < end && (*p == ' ' || *p == '\t' || *p == '\r')) p++;
    *out_word = p;
    while (p < end && *p != ' ' && *p != '\t' && *p != '\r') p++;
    *at = p;
    return (size_t)(p - *out_word);
}

static bool is_word(const char *word, size_t size, const char *text) {
    return size == strlen(text) && memcmp(word, text, size) == 0;
}

/* Adds what a line says; nothing for one that says nothing. */
static enum lw_status parse_line(const char *line, const char *end, struct lw_tokens *tokens,
                                 struct lw_error *err) {
    const char *role, *token, *more;
    struct lw_tokens_entry entry = {.role = LW_TOKENS_NONE};
    const size_t role_size = take_word(&line, end, &role);
    if (!role_size || *role == '#') return LW_OK;
    const size_t token_size = take_word(&line, end, &token);
    if (is_word(role, role_size, "view"))
        entry.role = LW_TOKENS_VIEW;
    else if (is_word(role, role_size, "control"))
        entry.role = LW_TOKENS_CONTROL;
    else
        return lw_status_fail(err, LW_BAD_DATA, "a line is ROLE TOKEN, and ROLE view or control");
    if (!lw_token_parse(token, token_size, &entry.token))
        return lw_status_fail(err, LW_BAD_DATA,
                              "a token is 64 hexadecimal digits: lightwellctl token makes one");
    if (take_word(&line, end, &more))
        return lw_status_fail(err, LW_BAD_DATA, "there is more after the token");
    if (lw_tokens_role(tokens, entry.token.bytes) != LW_TOKENS_NONE)
        return lw_status_fail(err, LW_BAD_DATA, "another line has the same token");
    if (tokens->count == LW_TOKENS_MAX)
        return lw_status_fail(err, LW_BAD_DATA, "there are over %u tokens", LW_TOKENS_MAX);
    tokens->entry[tokens->count++] = entry;
    explicit_bzero(&entry, sizeof entry);
    return LW_OK;
}

enum lw_status lw_tokens_parse(const char *text, size_t size, struct lw_tokens **out_tokens,
                               struct lw_error *err) {
    struct lw_tokens *tokens = calloc(1, sizeof *tokens + LW_TOKENS_MAX * sizeof *tokens->entry);
    if (!tokens) return lw_status_fail(err, LW_NO_MEMORY, "out of memory for tokens");
    enum lw_status status = LW_OK;
    const char *end = text + size;
    unsigned number = 1;
    for (const char *line = text, *next; line < end && status == LW_OK; line = next, number++) {
        const char *line_end = memchr(line, '\n', (size_t)(end - line));
        if (!line_end) line_end = end;
        next = line_end < end ? line_end + 1 : end;
        status = parse_line(line, line_end, tokens, err);
        if (status != LW_OK) lw_status_context(err, "line %u", number);
    }
    if (status == LW_OK && !tokens->count)
        status = lw_status_fail(err, LW_BAD_DATA, "holds no token: lightwellctl token makes one");
    if (status == LW_OK)
        *out_tokens = tokens;
    else
        lw_tokens_destroy(tokens);
    return status;
}

enum lw_status lw_tokens_read(const char *path, struct lw_tokens **out_tokens, struct lw_error *err) {
    uint8_t *bytes;
    size_t size;
    enum lw_status status =
        lw_secret_file_read(path, LW_SECRET_FILE_OWNER, LW_TOKENS_FILE_MAX, &bytes, &size, err);
    if (status != LW_OK) return status;
    status = lw_tokens_parse((const char *)bytes, size, out_tokens, err);
    if (status != LW_OK) lw_status_context(err, "%s", path);
    lw_secret_file_free(bytes, size);
    return status;
}

/* Each is compared whole: neither the place of the first byte that differs nor that of the entry shows in the
 * time that it takes. */
enum lw_tokens_role lw_tokens_role(const struct lw_tokens *tokens, const uint8_t *token) {
    unsigned role = LW_TOKENS_NONE;
    for (uint32_t i = 0; token && i < tokens->count; i++) {
        const unsigned equal = CRYPTO_memcmp(tokens->entry[i].token.bytes, token, LW_TOKEN_SIZE) == 0;
        role |= (0u - equal) & (unsigned)tokens->entry[i].role;
    }
    LW_INVARIANT(role == LW_TOKENS_NONE || role == LW_TOKENS_VIEW || role == LW_TOKENS_CONTROL);
    return (enum lw_tokens_role)role;
}

void lw_tokens_destroy(struct lw_tokens *tokens) {
    if (tokens) explicit_bzero(tokens, sizeof *tokens + LW_TOKENS_MAX * sizeof *tokens->entry);
    free(tokens);
}
