/* A file of tokens: any bytes. What it takes is what lw_tokens_role() finds again. */
#include "server/serve/admission/tokens.h"

#include <stdlib.h>
#include <string.h>

static void require(bool condition) {
    if (!condition) abort();
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    struct lw_tokens *tokens = NULL;
    struct lw_error err = {0};
    const enum lw_status status = lw_tokens_parse((const char *)data, size, &tokens, &err);
    require((status == LW_OK) == (tokens != NULL) && (status == LW_OK) == !*err.text);
    if (!tokens) return 0;
    require(tokens->count > 0 && tokens->count <= LW_TOKENS_MAX);
    for (uint32_t i = 0; i < tokens->count; i++) {
        struct lw_token token = tokens->entry[i].token;
        require(tokens->entry[i].role == LW_TOKENS_VIEW || tokens->entry[i].role == LW_TOKENS_CONTROL);
        require(lw_tokens_role(tokens, token.bytes) == tokens->entry[i].role);
    }
    lw_tokens_destroy(tokens);
    return 0;
}
