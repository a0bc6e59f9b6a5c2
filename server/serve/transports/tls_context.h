/* tls_context.h: who a server is: its certificate and key, for TLS 1.3 (docs/access.md).
 * Flow:    files -> [tls_context] -> tls_stream, web_server
 * Threads: everything here is [loop]. */
#ifndef LW_SERVE_TRANSPORTS_TLS_CONTEXT_H
#define LW_SERVE_TRANSPORTS_TLS_CONTEXT_H

#include "common/base/status.h"

#define LW_TLS_CONTEXT_FILE_MAX (1u << 20) /* bytes of a certificate with its issuers, or of a key */

struct ssl_ctx_st; /* OpenSSL's SSL_CTX */
struct lw_tls_context;

/** Files in PEM, or systemd's credentials (secret_file.h). Outlives the context. */
struct lw_tls_context_desc {
    const char *certificate; /* then its issuers, as far as clients do not have them */
    const char *key;         /* which its owner and its group alone may read */
};

/** Errors: LW_NO_INPUT, LW_BAD_DATA, LW_IO, LW_NO_MEMORY: each names the file and the mistake in it. */
LW_MUST_CHECK enum lw_status lw_tls_context_create(const struct lw_tls_context_desc *desc,
                                                   struct lw_tls_context **out_context, struct lw_error *err);
/** NULL is fine. */
void lw_tls_context_destroy(struct lw_tls_context *context);

/** Reads the files again. Later handshakes use their new contents. Errors: as above; nothing changes. */
LW_MUST_CHECK enum lw_status lw_tls_context_reload(struct lw_tls_context *context, struct lw_error *err);

/** For lw_tls_stream_create(). */
struct ssl_ctx_st *lw_tls_context_ssl(const struct lw_tls_context *context);

/** Sets up another SSL_CTX likewise, now and at each reload, until lw_tls_context_let_go().
 * Monitoring and browsers have one each.
 * Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_tls_context_lead(struct lw_tls_context *context, struct ssl_ctx_st *follower);
void lw_tls_context_let_go(struct lw_tls_context *context, const struct ssl_ctx_st *follower);

/** For people, such as "certificate of CN=example.org, until 2030-01-31". dst holds size bytes. */
void lw_tls_context_about(const struct lw_tls_context *context, char *dst, size_t size);

#endif
