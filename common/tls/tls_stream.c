#include "common/tls/tls_stream.h"

#include "common/base/invariant.h"

#include <arpa/inet.h>
#include <openssl/bio.h>
#include <openssl/err.h>
#include <openssl/ssl.h>
#include <openssl/x509v3.h>
#include <stdlib.h>
#include <string.h>

#define OUTPUT_MIN (16u << 10)

/* On processors with its instructions AES-128-GCM is twice as fast as the ciphers after it. */
static const char ciphers[] = "TLS_AES_128_GCM_SHA256:TLS_CHACHA20_POLY1305_SHA256:TLS_AES_256_GCM_SHA384";

struct lw_tls_stream {
    SSL *ssl;
    BIO_METHOD *method;
    const uint8_t *lent;
    size_t lent_size;
    struct lw_tls_output *output; /* for the call under way */
    bool no_memory;
    bool failed;
};

void lw_tls_output_finish(struct lw_tls_output *output) {
    free(output->bytes);
    *output = (struct lw_tls_output){0};
}

static bool append(struct lw_tls_output *output, const void *bytes, size_t size) {
    if (size > output->capacity - output->size) {
        size_t capacity = output->capacity ? output->capacity : OUTPUT_MIN;
        while (capacity - output->size < size) capacity *= 2;
        uint8_t *grown = realloc(output->bytes, capacity);
        if (!grown) return false;
        output->bytes = grown;
        output->capacity = capacity;
    }
    memcpy(output->bytes + output->size, bytes, size);
    output->size += size;
    return true;
}

/* ---- what OpenSSL takes for the link ---- */

static int read_lent(BIO *bio, char *dst, int capacity) {
    struct lw_tls_stream *s = BIO_get_data(bio);
    BIO_clear_retry_flags(bio);
    if (capacity <= 0) return 0;
    const size_t size = (size_t)capacity < s->lent_size ? (size_t)capacity : s->lent_size;
    if (!size) {
        BIO_set_retry_read(bio);
        return -1;
    }
    memcpy(dst, s->lent, size);
    s->lent += size;
    s->lent_size -= size;
    return (int)size;
}

static void hand_over(struct lw_tls_output *output) {
    const size_t taken = output->take(output->link, output->bytes, output->size);
    LW_INVARIANT(taken <= output->size);
    output->taken += taken;
    output->size -= taken;
    output->is_full = output->size > 0;
    if (output->is_full) memmove(output->bytes, output->bytes + taken, output->size);
}

static int write_output(BIO *bio, const char *src, int size) {
    struct lw_tls_stream *s = BIO_get_data(bio);
    BIO_clear_retry_flags(bio);
    if (size <= 0) return 0;
    if (append(s->output, src, (size_t)size)) {
        if (s->output->take && !s->output->is_full && s->output->size >= LW_TLS_STREAM_TAKEN)
            hand_over(s->output);
        return size;
    }
    s->no_memory = true;
    return -1;
}

static long control(BIO *bio, int command, long number, void *pointer) {
    (void)bio;
    (void)number;
    (void)pointer;
    return command == BIO_CTRL_FLUSH; /* there is nothing to flush */
}

/* BIO_free() of SSL_free() must not touch memory of others. */
static int on_bio_freed(BIO *bio) {
    (void)bio;
    return 1;
}

static BIO *make_bio(struct lw_tls_stream *s) {
    s->method = BIO_meth_new(BIO_TYPE_START | BIO_TYPE_SOURCE_SINK, "lightwell link");
    if (!s->method || !BIO_meth_set_read(s->method, read_lent) ||
        !BIO_meth_set_write(s->method, write_output) || !BIO_meth_set_ctrl(s->method, control) ||
        !BIO_meth_set_destroy(s->method, on_bio_freed))
        return NULL;
    BIO *bio = BIO_new(s->method);
    if (!bio) return NULL;
    BIO_set_data(bio, s);
    BIO_set_init(bio, 1);
    return bio;
}

/* ---- beginning and end ---- */

enum lw_status lw_tls_stream_set_up(struct ssl_ctx_st *context) {
    SSL_CTX_set_mode(context, SSL_MODE_RELEASE_BUFFERS);
    SSL_CTX_set_options(context, SSL_OP_CIPHER_SERVER_PREFERENCE | SSL_OP_PRIORITIZE_CHACHA |
                                     SSL_OP_NO_COMPRESSION | SSL_OP_NO_RENEGOTIATION);
    SSL_CTX_set_session_cache_mode(context, SSL_SESS_CACHE_OFF);
    const bool done = SSL_CTX_set_min_proto_version(context, TLS1_3_VERSION) == 1 &&
                      SSL_CTX_set_num_tickets(context, 0) == 1 &&
                      SSL_CTX_set_ciphersuites(context, ciphers) == 1;
    ERR_clear_error();
    return done ? LW_OK : LW_NO_MEMORY;
}

static bool is_address(const char *name) {
    uint8_t bytes[16];
    return inet_pton(AF_INET, name, bytes) == 1 || inet_pton(AF_INET6, name, bytes) == 1;
}

/* An address has no place in a server name indication: RFC 6066, 3. */
static bool set_server_name(SSL *ssl, const char *name) {
    if (is_address(name)) return X509_VERIFY_PARAM_set1_ip_asc(SSL_get0_param(ssl), name) == 1;
    SSL_set_hostflags(ssl, X509_CHECK_FLAG_NO_PARTIAL_WILDCARDS);
    return SSL_set1_host(ssl, name) == 1 && SSL_set_tlsext_host_name(ssl, name) == 1;
}

enum lw_status lw_tls_stream_create(struct ssl_ctx_st *context, const char *server_name,
                                    struct lw_tls_stream **out_stream) {
    struct lw_tls_stream *s = calloc(1, sizeof *s);
    if (!s) return LW_NO_MEMORY;
    s->ssl = SSL_new(context);
    BIO *bio = s->ssl ? make_bio(s) : NULL;
    if (bio) SSL_set_bio(s->ssl, bio, bio);
    if (!bio || (server_name && !set_server_name(s->ssl, server_name))) {
        ERR_clear_error();
        lw_tls_stream_destroy(s);
        return LW_NO_MEMORY;
    }
    if (server_name)
        SSL_set_connect_state(s->ssl);
    else
        SSL_set_accept_state(s->ssl);
    *out_stream = s;
    return LW_OK;
}

void lw_tls_stream_destroy(struct lw_tls_stream *s) {
    if (!s) return;
    SSL_free(s->ssl);
    BIO_meth_free(s->method);
    free(s);
}

bool lw_tls_stream_is_ready(const struct lw_tls_stream *s) { return SSL_is_init_finished(s->ssl); }

/* ---- bytes ---- */

void lw_tls_stream_lend(struct lw_tls_stream *s, const uint8_t *bytes, size_t size) {
    LW_INVARIANT(!s->lent_size || s->failed); /* the bytes lent before are read, or of no use */
    s->lent = bytes;
    s->lent_size = size;
}

/* Text of a failure of a certificate, ours or the peer's; NULL: another failure. */
static const char *distrust(const SSL *ssl, unsigned long code) {
    const long verified = SSL_get_verify_result(ssl);
    if (verified != X509_V_OK) return X509_verify_cert_error_string(verified);
    if (ERR_GET_LIB(code) != ERR_LIB_SSL) return NULL;
    switch (ERR_GET_REASON(code)) {
    case SSL_R_TLSV1_ALERT_UNKNOWN_CA:
    case SSL_R_SSLV3_ALERT_BAD_CERTIFICATE:
    case SSL_R_SSLV3_ALERT_CERTIFICATE_UNKNOWN:
    case SSL_R_SSLV3_ALERT_CERTIFICATE_EXPIRED:
    case SSL_R_SSLV3_ALERT_CERTIFICATE_REVOKED:
    case SSL_R_SSLV3_ALERT_UNSUPPORTED_CERTIFICATE:
        return "the peer does not take the certificate";
    default:
        return NULL;
    }
}

static enum lw_status failure(struct lw_tls_stream *s, struct lw_error *err) {
    const unsigned long code = ERR_peek_error();
    const char *reason = ERR_reason_error_string(code), *distrusted = distrust(s->ssl, code);
    s->failed = true;
    s->lent_size = 0;
    ERR_clear_error();
    if (s->no_memory || ERR_GET_REASON(code) == ERR_R_MALLOC_FAILURE)
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    if (distrusted) return lw_status_fail(err, LW_NOT_ALLOWED, "%s", distrusted);
    return lw_status_fail(err, LW_PROTOCOL, "%s", reason ? reason : "no TLS 1.3");
}

enum lw_status lw_tls_stream_read(struct lw_tls_stream *s, uint8_t *dst, size_t capacity, size_t *out_size,
                                  struct lw_tls_output *output, struct lw_error *err) {
    if (s->failed) return lw_status_fail(err, LW_PROTOCOL, "it has failed before");
    s->output = output;
    ERR_clear_error();
    size_t size = 0;
    const int result = SSL_read_ex(s->ssl, dst, capacity, &size);
    s->output = NULL;
    if (result == 1) {
        *out_size = size;
        return LW_OK;
    }
    switch (SSL_get_error(s->ssl, result)) {
    case SSL_ERROR_WANT_READ:
        *out_size = 0;
        return LW_OK;
    case SSL_ERROR_ZERO_RETURN:
        return lw_status_fail(err, LW_CLOSED, "the peer has ended it");
    default:
        return failure(s, err);
    }
}

enum lw_status lw_tls_stream_write(struct lw_tls_stream *s, const uint8_t *src, size_t src_size,
                                   struct lw_tls_output *output) {
    size_t written;
    if (s->failed) return LW_PROTOCOL;
    if (!src_size) return LW_OK;
    LW_INVARIANT(lw_tls_stream_is_ready(s));
    s->output = output;
    ERR_clear_error();
    const int result = SSL_write_ex(s->ssl, src, src_size, &written);
    s->output = NULL;
    return result == 1 ? LW_OK : failure(s, NULL);
}

void lw_tls_stream_end(struct lw_tls_stream *s, struct lw_tls_output *output) {
    if (s->failed || !lw_tls_stream_is_ready(s)) return;
    s->output = output;
    (void)SSL_shutdown(s->ssl);
    s->output = NULL;
    ERR_clear_error();
}
