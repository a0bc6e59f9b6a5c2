/* access.h: how a program of ours gets into a server: what options and environment say of tokens.
 * Flow:    --token-file, $LIGHTWELL_TOKEN -> [access] -> client, link
 * Threads: main() only. */
#ifndef LIGHTWELL_ACCESS_H
#define LIGHTWELL_ACCESS_H

#include "common/options.h"
#include "common/token.h"

#define LW_ACCESS_UNIX "unix:" /* begins a host that is the path of a Unix socket */

/** Zero: without a token. */
struct lw_access {
    bool has_token;
    struct lw_token token;
};

/** What the options below say. */
struct lw_access_options {
    const char *token_file; /* NULL: not said */
};

#define LW_ACCESS_TOKEN_HELP                                                                                 \
    "A file that holds the token to connect with, which nobody else may read (default: the token in "        \
    "$LIGHTWELL_TOKEN, if it is set)."

/** The row of an option table that fills this. options: a pointer to a struct lw_access_options. */
#define LW_ACCESS_OPTIONS(options)                                                                           \
    {                                                                                                        \
        .name = "token-file", .argument = "FILE", .help = LW_ACCESS_TOKEN_HELP, .kind = LW_OPTION_STRING,    \
        .value = &(options)->token_file                                                                      \
    }

/** Where a server is: as lw_options_address(), or unix:PATH, which is then the host. Errors: LW_USAGE. */
LW_MUST_CHECK enum lw_status lw_access_address(const char *text, char *out_host, size_t host_size,
                                               uint16_t *out_port, struct lw_error *err);

/** Takes them up. Errors: as lw_token_read(), naming the option; LW_USAGE: the environment has no token. */
LW_MUST_CHECK enum lw_status lw_access_read(const struct lw_access_options *options,
                                            struct lw_access *out_access, struct lw_error *err);

#endif
