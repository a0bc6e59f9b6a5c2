/* access.h: how a program of ours gets into a server: what options and environment say of tokens and TLS.
 * Flow:    --token-file, $LIGHTWELL_TOKEN, --tls, --ca -> [access] -> client, link
 * Threads: main() only. */
#ifndef LIGHTWELL_ACCESS_H
#define LIGHTWELL_ACCESS_H

#include "client/lib/tls_trust.h"
#include "common/base/options.h"
#include "common/base/token.h"

#define LW_ACCESS_UNIX "unix:" /* begins a host that is the path of a Unix socket */

/** Zero: without a token, in plain. */
struct lw_access {
    bool has_token;
    struct lw_token token;
    struct lw_tls_trust_desc tls; /* its text is that of the option */
};

/** What the options below say. */
struct lw_access_options {
    const char *token_file, *ca; /* NULL: not said */
    bool tls, tls_insecure;
};

#define LW_ACCESS_TOKEN_HELP                                                                                 \
    "a file with the token to connect with; nobody else may read it (default: the token in "                 \
    "$LIGHTWELL_TOKEN, if it is set)"

#define LW_ACCESS_CA_HELP                                                                                    \
    "a PEM file with the certificate of a server to trust, or of its issuer; it means --tls (default: the "  \
    "issuers that the system trusts)"

/** The rows of an option table that fill this. options: a pointer to a struct lw_access_options. */
#define LW_ACCESS_OPTIONS(options)                                                                           \
    {.name = "token-file",                                                                                   \
     .argument = "FILE",                                                                                     \
     .help = LW_ACCESS_TOKEN_HELP,                                                                           \
     .kind = LW_OPTION_STRING,                                                                               \
     .value = &(options)->token_file},                                                                       \
        {.name = "tls",                                                                                      \
         .help = "connect by TLS 1.3; the server's certificate must be for the name in its address",         \
         .kind = LW_OPTION_FLAG,                                                                             \
         .value = &(options)->tls},                                                                          \
        {.name = "ca",                                                                                       \
         .argument = "FILE",                                                                                 \
         .help = LW_ACCESS_CA_HELP,                                                                          \
         .kind = LW_OPTION_STRING,                                                                           \
         .value = &(options)->ca},                                                                           \
    {                                                                                                        \
        .name = "tls-insecure",                                                                              \
        .help = "TLS without a check of certificates, for tests. An attacker on the way can read and "       \
                "change everything",                                                                         \
        .kind = LW_OPTION_FLAG, .value = &(options)->tls_insecure                                            \
    }

/** Where a server is: as lw_options_address(), or unix:PATH, which is then the host. Errors: LW_USAGE. */
LW_MUST_CHECK enum lw_status lw_access_address(const char *text, char *out_host, size_t host_size,
                                               uint16_t *out_port, struct lw_error *err);

/** Takes them up. Errors: as lw_token_read(), naming the option; LW_USAGE: the environment has no
 * token, or options exclude each other. */
LW_MUST_CHECK enum lw_status lw_access_read(const struct lw_access_options *options,
                                            struct lw_access *out_access, struct lw_error *err);

#endif
