/* tls_trust.h: which servers a client believes to be who they say, for TLS 1.3.
 * Flow:    --tls, --ca, --tls-insecure -> [tls_trust] -> link, tls_stream
 * Threads: [any]; what it makes is immutable. */
#ifndef LIGHTWELL_TLS_TRUST_H
#define LIGHTWELL_TLS_TRUST_H

#include "common/base/status.h"
#include "common/base/tls_trust_desc.h"

struct ssl_ctx_st; /* OpenSSL's SSL_CTX */

/** Reads the certificates; NULL without TLS. For lw_link_connect(), and then lw_tls_trust_unref().
 * Errors: LW_NO_INPUT, LW_BAD_DATA, LW_IO, each naming the file; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_tls_trust_create(const struct lw_tls_trust_desc *desc,
                                                 struct ssl_ctx_st **out_trust, struct lw_error *err);
/** NULL is fine. */
void lw_tls_trust_unref(struct ssl_ctx_st *trust);

/** Puts into words why a handshake failed, with what to do.
 * cause       as lw_tls_stream_read() gave it
 * first_byte  of what the server sent; negative: nothing came */
enum lw_status lw_tls_trust_explain(struct lw_error *err, const char *address, const struct lw_error *cause,
                                    int first_byte);

#endif
