#include "server/serve/transports/tls_context.h"

#include "common/base/invariant.h"
#include "common/base/secret_file.h"
#include "common/tls/tls_stream.h"

#include <limits.h>
#include <openssl/err.h>
#include <openssl/pem.h>
#include <openssl/ssl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define FOLLOWERS_MAX 2u /* browsers, and monitoring */

/* Contents of the two files. */
struct identity {
    X509 *certificate;
    STACK_OF(X509) * issuers;
    EVP_PKEY *key;
};

struct lw_tls_context {
    struct lw_tls_context_desc desc;
    struct identity identity;
    SSL_CTX *ssl;
    SSL_CTX *follower[FOLLOWERS_MAX];
};

static void finish_identity(struct identity *identity) {
    X509_free(identity->certificate);
    sk_X509_pop_free(identity->issuers, X509_free);
    EVP_PKEY_free(identity->key);
    *identity = (struct identity){0};
}

/* ---- files ---- */

static enum lw_status open_file(const char *path, enum lw_secret_file_readers readers, uint8_t **out_bytes,
                                size_t *out_size, BIO **out_bio, struct lw_error *err) {
    enum lw_status status =
        lw_secret_file_read(path, readers, LW_TLS_CONTEXT_FILE_MAX, out_bytes, out_size, err);
    if (status != LW_OK) return status;
    *out_bio = BIO_new_mem_buf(*out_bytes, (int)*out_size);
    if (*out_bio) return LW_OK;
    lw_secret_file_free(*out_bytes, *out_size);
    return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
}

static enum lw_status parse_certificates(BIO *bio, const char *path, struct identity *identity,
                                         struct lw_error *err) {
    identity->certificate = PEM_read_bio_X509_AUX(bio, NULL, NULL, NULL);
    identity->issuers = sk_X509_new_null();
    if (!identity->certificate)
        return lw_status_fail(err, LW_BAD_DATA, "%s holds no certificate in PEM", path);
    for (X509 *issuer; (issuer = PEM_read_bio_X509(bio, NULL, NULL, NULL));)
        if (!identity->issuers || !sk_X509_push(identity->issuers, issuer)) {
            X509_free(issuer);
            return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
        }
    const unsigned long code = ERR_peek_last_error(); /* the end of the file is one, too */
    if (code && ERR_GET_REASON(code) != PEM_R_NO_START_LINE)
        return lw_status_fail(err, LW_BAD_DATA, "%s: what follows the first certificate is broken", path);
    return LW_OK;
}

static enum lw_status read_certificates(const char *path, struct identity *identity, struct lw_error *err) {
    uint8_t *bytes;
    size_t size;
    BIO *bio;
    enum lw_status status = open_file(path, LW_SECRET_FILE_ALL, &bytes, &size, &bio, err);
    if (status != LW_OK) return status;
    status = parse_certificates(bio, path, identity, err);
    BIO_free(bio);
    lw_secret_file_free(bytes, size);
    return status;
}

/* A daemon has nobody to ask. */
static int no_password(char *dst, int size, int writes, void *context) {
    (void)dst;
    (void)size;
    (void)writes;
    (void)context;
    return 0;
}

static enum lw_status read_key(const char *path, struct identity *identity, struct lw_error *err) {
    uint8_t *bytes;
    size_t size;
    BIO *bio;
    enum lw_status status = open_file(path, LW_SECRET_FILE_GROUP, &bytes, &size, &bio, err);
    if (status != LW_OK) return status;
    identity->key = PEM_read_bio_PrivateKey(bio, NULL, no_password, NULL);
    if (!identity->key)
        status = lw_status_fail(err, LW_BAD_DATA, "%s holds no key in PEM, or one with a password", path);
    BIO_free(bio);
    lw_secret_file_free(bytes, size);
    return status;
}

static enum lw_status read_identity(const struct lw_tls_context_desc *desc, struct identity *out_identity,
                                    struct lw_error *err) {
    struct identity identity = {0};
    ERR_clear_error();
    enum lw_status status = read_certificates(desc->certificate, &identity, err);
    if (status == LW_OK) status = read_key(desc->key, &identity, err);
    if (status == LW_OK && X509_check_private_key(identity.certificate, identity.key) != 1)
        status = lw_status_fail(err, LW_BAD_DATA, "the key %s is not that of the certificate %s", desc->key,
                                desc->certificate);
    if (status == LW_OK && X509_cmp_current_time(X509_get0_notAfter(identity.certificate)) < 0)
        status = lw_status_fail(err, LW_BAD_DATA, "the certificate %s has expired", desc->certificate);
    ERR_clear_error();
    if (status == LW_OK)
        *out_identity = identity;
    else
        finish_identity(&identity);
    return status;
}

/* ---- contexts ---- */

/* The certificate or the key may be of a kind that OpenSSL does not take: 512 bits of RSA. */
static enum lw_status use_identity(const struct identity *identity, SSL_CTX *ssl) {
    const int done =
        SSL_CTX_use_cert_and_key(ssl, identity->certificate, identity->key, identity->issuers, 1);
    ERR_clear_error();
    return done == 1 ? LW_OK : LW_BAD_DATA;
}

static enum lw_status try_out(const struct lw_tls_context_desc *desc, const struct identity *identity,
                              struct lw_error *err) {
    SSL_CTX *ssl = SSL_CTX_new(TLS_server_method());
    enum lw_status status = ssl ? use_identity(identity, ssl) : LW_NO_MEMORY;
    SSL_CTX_free(ssl);
    if (status == LW_BAD_DATA)
        return lw_status_fail(err, status, "the key %s is too weak, or of a kind that TLS 1.3 has not",
                              desc->key);
    return status == LW_OK ? LW_OK : lw_status_fail(err, status, "out of memory");
}

enum lw_status lw_tls_context_create(const struct lw_tls_context_desc *desc,
                                     struct lw_tls_context **out_context, struct lw_error *err) {
    struct lw_tls_context *context = calloc(1, sizeof *context);
    if (!context) return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    context->desc = *desc;
    enum lw_status status = read_identity(desc, &context->identity, err);
    if (status == LW_OK) status = try_out(desc, &context->identity, err);
    if (status == LW_OK) {
        context->ssl = SSL_CTX_new(TLS_server_method());
        status = context->ssl ? lw_tls_stream_set_up(context->ssl) : LW_NO_MEMORY;
        if (status == LW_OK) status = use_identity(&context->identity, context->ssl);
        if (status != LW_OK) lw_status_fail(err, status, "out of memory for TLS");
    }
    if (status == LW_OK)
        *out_context = context;
    else
        lw_tls_context_destroy(context);
    return status;
}

void lw_tls_context_destroy(struct lw_tls_context *context) {
    if (!context) return;
    SSL_CTX_free(context->ssl);
    finish_identity(&context->identity);
    free(context);
}

enum lw_status lw_tls_context_reload(struct lw_tls_context *context, struct lw_error *err) {
    struct identity identity;
    enum lw_status status = read_identity(&context->desc, &identity, err);
    if (status != LW_OK) return status;
    if ((status = try_out(&context->desc, &identity, err)) == LW_OK) {
        status = use_identity(&identity, context->ssl);
        for (unsigned i = 0; i < FOLLOWERS_MAX; i++)
            if (context->follower[i] && status == LW_OK)
                status = use_identity(&identity, context->follower[i]);
        if (status != LW_OK) lw_status_fail(err, status, "out of memory for TLS");
    }
    if (status != LW_OK) {
        finish_identity(&identity);
        return status;
    }
    finish_identity(&context->identity);
    context->identity = identity;
    return LW_OK;
}

struct ssl_ctx_st *lw_tls_context_ssl(const struct lw_tls_context *context) {
    return context->ssl;
}

enum lw_status lw_tls_context_lead(struct lw_tls_context *context, struct ssl_ctx_st *follower) {
    unsigned at = 0;
    for (; at < FOLLOWERS_MAX && context->follower[at]; at++)
        LW_INVARIANT(context->follower[at] != follower); /* else one place would be given back of two */
    if (at == FOLLOWERS_MAX) return LW_INTERNAL;
    enum lw_status status = lw_tls_stream_set_up(follower);
    if (status == LW_OK) status = use_identity(&context->identity, follower);
    if (status == LW_OK) context->follower[at] = follower;
    return status;
}

void lw_tls_context_let_go(struct lw_tls_context *context, const struct ssl_ctx_st *follower) {
    for (unsigned i = 0; follower && i < FOLLOWERS_MAX; i++)
        if (context->follower[i] == follower) context->follower[i] = NULL;
}

void lw_tls_context_about(const struct lw_tls_context *context, char *dst, size_t size) {
    char name[128] = "?";
    struct tm until = {0};
    X509_NAME_oneline(X509_get_subject_name(context->identity.certificate), name, sizeof name);
    (void)ASN1_TIME_to_tm(X509_get0_notAfter(context->identity.certificate), &until);
    snprintf(dst, size, "certificate of %s, until %04d-%02d-%02d", name, 1900 + until.tm_year,
             until.tm_mon + 1, until.tm_mday);
    lw_status_one_line(dst);
}
