#include "client/lib/tls_trust.h"

#include "common/base/secret_file.h"
#include "common/tls/tls_stream.h"

#include <openssl/err.h>
#include <openssl/pem.h>
#include <openssl/ssl.h>

#define CA_FILE_MAX (4u << 20) /* bytes: a system's whole list has a quarter of that */

enum { HANDSHAKE = 0x16, ALERT = 0x15 }; /* records that a TLS server begins with */

static enum lw_status add_certificates(BIO *bio, X509_STORE *store, const char *path, struct lw_error *err) {
    unsigned count = 0;
    for (X509 *certificate; (certificate = PEM_read_bio_X509(bio, NULL, NULL, NULL)); count++) {
        const int added = X509_STORE_add_cert(store, certificate);
        X509_free(certificate);
        if (added != 1) return lw_status_fail(err, LW_NO_MEMORY, "%s: out of memory", path);
    }
    const unsigned long code = ERR_peek_last_error();
    if (!count || (code && ERR_GET_REASON(code) != PEM_R_NO_START_LINE))
        return lw_status_fail(err, LW_BAD_DATA, "%s holds no certificate in PEM, or a broken one", path);
    return LW_OK;
}

static enum lw_status read_certificates(const char *path, X509_STORE *store, struct lw_error *err) {
    uint8_t *bytes;
    size_t size;
    enum lw_status status = lw_secret_file_read(path, LW_SECRET_FILE_ALL, CA_FILE_MAX, &bytes, &size, err);
    if (status != LW_OK) return status;
    BIO *bio = BIO_new_mem_buf(bytes, (int)size);
    status = bio ? add_certificates(bio, store, path, err)
                 : lw_status_fail(err, LW_NO_MEMORY, "%s: out of memory", path);
    BIO_free(bio);
    lw_secret_file_free(bytes, size);
    return status;
}

/* A server's own certificate may be the one that is believed: then its issuer need not be known. */
static enum lw_status set_trust(SSL_CTX *trust, const struct lw_tls_trust_desc *desc, struct lw_error *err) {
    if (lw_tls_stream_set_up(trust) != LW_OK) return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    SSL_CTX_set_verify(trust, desc->trusts_all ? SSL_VERIFY_NONE : SSL_VERIFY_PEER, NULL);
    X509_VERIFY_PARAM_set_flags(SSL_CTX_get0_param(trust), X509_V_FLAG_PARTIAL_CHAIN);
    if (desc->trusts_all) return LW_OK;
    if (desc->ca) return read_certificates(desc->ca, SSL_CTX_get_cert_store(trust), err);
    if (SSL_CTX_set_default_verify_paths(trust) == 1) return LW_OK;
    return lw_status_fail(err, LW_NO_INPUT, "the system has no list of certificates: --ca FILE names one");
}

enum lw_status lw_tls_trust_create(const struct lw_tls_trust_desc *desc, struct ssl_ctx_st **out_trust,
                                   struct lw_error *err) {
    SSL_CTX *trust = NULL;
    enum lw_status status = LW_OK;
    if (desc->wanted) {
        ERR_clear_error();
        trust = SSL_CTX_new(TLS_client_method());
        status = trust ? set_trust(trust, desc, err) : lw_status_fail(err, LW_NO_MEMORY, "out of memory");
        ERR_clear_error();
    }
    if (status == LW_OK)
        *out_trust = trust;
    else
        SSL_CTX_free(trust);
    return status;
}

void lw_tls_trust_unref(struct ssl_ctx_st *trust) { SSL_CTX_free(trust); }

enum lw_status lw_tls_trust_explain(struct lw_error *err, const char *address, const struct lw_error *cause,
                                    int first_byte) {
    if (first_byte >= 0 && first_byte != HANDSHAKE && first_byte != ALERT)
        return lw_status_fail(err, LW_PROTOCOL, "%s does not speak TLS: connect without --tls and --ca",
                              address);
    if (cause->status == LW_NOT_ALLOWED)
        return lw_status_fail(
            err, LW_NOT_ALLOWED,
            "%s is not trusted: %s: --ca FILE names the certificate to believe, or its issuer's", address,
            cause->text);
    return lw_status_fail(err, cause->status, "%s: TLS: %s", address, cause->text);
}
