#include "client/lib/access.h"

#include <stdlib.h>
#include <string.h>

enum lw_status lw_access_address(const char *text, char *out_host, size_t host_size, uint16_t *out_port,
                                 struct lw_error *err) {
    if (strncmp(text, LW_ACCESS_UNIX, strlen(LW_ACCESS_UNIX)) != 0)
        return lw_options_address(text, out_host, host_size, out_port, err);
    if (strlen(text) >= host_size || !text[strlen(LW_ACCESS_UNIX)])
        return lw_status_fail(err, LW_USAGE, "address \"%.60s\" is not unix:PATH", text);
    strcpy(out_host, text);
    *out_port = 0;
    return LW_OK;
}

enum lw_status lw_access_read(const struct lw_access_options *options, struct lw_access *out_access,
                              struct lw_error *err) {
    struct lw_access access = {.tls = {.wanted = options->tls || options->ca || options->tls_insecure,
                                       .ca = options->ca,
                                       .trusts_all = options->tls_insecure}};
    if (options->ca && options->tls_insecure)
        return lw_status_fail(err, LW_USAGE, "--ca and --tls-insecure exclude each other");
    const char *text = getenv("LIGHTWELL_TOKEN");
    if (options->token_file) {
        enum lw_status status = lw_token_read(options->token_file, &access.token, err);
        if (status != LW_OK) {
            lw_status_context(err, "--token-file");
            return status;
        }
        access.has_token = true;
    } else if (text && *text) {
        if (!lw_token_parse(text, strlen(text), &access.token))
            return lw_status_fail(err, LW_USAGE, "LIGHTWELL_TOKEN is not 64 hexadecimal digits");
        access.has_token = true;
    }
    *out_access = access;
    return LW_OK;
}
