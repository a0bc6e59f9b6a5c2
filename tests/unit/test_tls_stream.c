#include "tests/support/certificate.h"

#include "client/lib/tls_trust.h"
#include "common/tls/tls_stream.h"
#include "server/serve/transports/tls_context.h"

#include <openssl/ssl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

/* Both ends in memory. */
struct end {
    struct lw_tls_stream *stream;
    struct lw_tls_output output; /* for the other end */
    struct lw_error err;
    enum lw_status status;
    uint8_t heard[200000];
    size_t heard_size;
};

static struct end client, server;
static struct lw_tls_context *context;
static struct ssl_ctx_st *trust;
static char certificate[200], key[200];

static void make_files(const char *names, int days) {
    snprintf(certificate, sizeof certificate, "%s", lw_support_temporary("certificate.pem"));
    snprintf(key, sizeof key, "%s", lw_support_temporary("key.pem"));
    lw_certificate_make(certificate, key, names, days);
}

static void make_ends(const char *names, const struct lw_tls_trust_desc *believes, const char *server_name) {
    struct lw_error err = {0};
    make_files(names, 10);
    struct lw_tls_trust_desc desc = *believes;
    if (!desc.trusts_all && !desc.ca) desc.ca = certificate;
    lw_support_ok(lw_tls_context_create(&(struct lw_tls_context_desc){certificate, key}, &context, &err),
                  &err);
    lw_support_ok(lw_tls_trust_create(&desc, &trust, &err), &err);
    lw_support_ok(lw_tls_stream_create(lw_tls_context_ssl(context), NULL, &server.stream), NULL);
    lw_support_ok(lw_tls_stream_create(trust, server_name, &client.stream), NULL);
}

static void finish_end(struct end *end) {
    lw_tls_stream_destroy(end->stream);
    lw_tls_output_finish(&end->output);
    *end = (struct end){0};
}

static int finish_ends(void **state) {
    (void)state;
    finish_end(&client);
    finish_end(&server);
    lw_tls_trust_unref(trust);
    lw_tls_context_destroy(context);
    trust = NULL;
    context = NULL;
    return 0;
}

/* Hands an end at most `most` bytes of the other one's at a time. */
static void hear(struct end *end, struct end *other, size_t most) {
    struct lw_tls_output from = other->output;
    other->output = (struct lw_tls_output){0};
    size_t at = 0;
    do {
        const size_t left = from.size - at, size = left < most ? left : most;
        lw_tls_stream_lend(end->stream, from.bytes + at, size);
        at += size;
        for (size_t got = 1; end->status == LW_OK && got;) {
            end->status =
                lw_tls_stream_read(end->stream, end->heard + end->heard_size,
                                   sizeof end->heard - end->heard_size, &got, &end->output, &end->err);
            if (end->status == LW_OK) end->heard_size += got;
        }
    } while (at < from.size && end->status == LW_OK);
    lw_tls_output_finish(&from);
}

static void shake_hands(size_t most) {
    for (int i = 0; i < 4; i++) {
        hear(&client, &server, most);
        hear(&server, &client, most);
    }
}

static const struct lw_tls_trust_desc believes_file = {.wanted = true}, believes_all = {true, NULL, true};

static void say(struct end *from, size_t size) {
    uint8_t *bytes = malloc(size);
    for (size_t i = 0; i < size; i++) bytes[i] = (uint8_t)(i * 7 + i / 251);
    lw_support_ok(lw_tls_stream_write(from->stream, bytes, size, &from->output), NULL);
    free(bytes);
}

static void expect_said(struct end *end, size_t size) {
    assert_int_equal(end->heard_size, size);
    for (size_t i = 0; i < size; i++) assert_int_equal(end->heard[i], (uint8_t)(i * 7 + i / 251));
    end->heard_size = 0;
}

static void talk(size_t most) {
    shake_hands(most);
    assert_int_equal(client.status, LW_OK);
    assert_int_equal(server.status, LW_OK);
    assert_true(lw_tls_stream_is_ready(client.stream));
    assert_true(lw_tls_stream_is_ready(server.stream));
    say(&client, 5);
    hear(&server, &client, most);
    expect_said(&server, 5);
    say(&server, 100000); /* several records */
    hear(&client, &server, most);
    expect_said(&client, 100000);
    lw_tls_stream_end(server.stream, &server.output);
    hear(&client, &server, most);
    assert_int_equal(client.status, LW_CLOSED);
}

static void test_whole_and_byte_by_byte(void **state) {
    make_ends("DNS:localhost,IP:127.0.0.1", &believes_file, "localhost");
    talk(SIZE_MAX);
    finish_ends(state);
    make_ends("DNS:localhost,IP:127.0.0.1", &believes_file, "127.0.0.1");
    talk(1);
}

static void expect_distrust(const char *text) {
    shake_hands(SIZE_MAX);
    lw_support_fails(client.status, LW_NOT_ALLOWED, &client.err, text);
    assert_int_equal(server.status, LW_NOT_ALLOWED); /* it has the reason */
    assert_false(lw_tls_stream_is_ready(client.stream));
}

static void test_names_are_verified(void **state) {
    make_ends("DNS:localhost", &believes_file, "elsewhere.example");
    expect_distrust("hostname mismatch");
    finish_ends(state);
    make_ends("DNS:localhost", &believes_file, "127.0.0.1");
    expect_distrust("IP address mismatch");
    finish_ends(state);
    make_ends("DNS:localhost", &believes_all, "elsewhere.example");
    talk(SIZE_MAX);
}

static void test_other_certificates_are_not_believed(void **state) {
    (void)state;
    char other[200];
    snprintf(other, sizeof other, "%s", lw_support_temporary("other.pem"));
    lw_certificate_make(other, lw_support_temporary("other_key.pem"), "DNS:localhost", 10);
    make_ends("DNS:localhost", &(struct lw_tls_trust_desc){true, other, false}, "localhost");
    expect_distrust("self-signed certificate");
}

static void test_tls_1_2_is_refused(void **state) {
    (void)state;
    make_ends("DNS:localhost", &believes_all, "localhost");
    SSL_CTX *old = SSL_CTX_new(TLS_client_method());
    assert_non_null(old);
    assert_int_equal(SSL_CTX_set_max_proto_version(old, TLS1_2_VERSION), 1);
    lw_tls_stream_destroy(client.stream);
    client.stream = NULL;
    lw_support_ok(lw_tls_stream_create(old, "localhost", &client.stream), NULL);
    SSL_CTX_free(old); /* the stream has a reference */
    shake_hands(SIZE_MAX);
    lw_support_fails(server.status, LW_PROTOCOL, &server.err, "unsupported protocol");
    assert_int_equal(client.status, LW_PROTOCOL);
}

/* What a peer may send instead of TLS: each byte of a good beginning changed, and that cut off. */
static void test_garbage(void **state) {
    make_ends("DNS:localhost", &believes_all, "localhost");
    hear(&client, &server, SIZE_MAX);
    const size_t size = client.output.size;
    uint8_t *good = malloc(size);
    assert_non_null(good);
    memcpy(good, client.output.bytes, size);
    for (size_t i = 0; i < size; i++) {
        finish_end(&server);
        lw_support_ok(lw_tls_stream_create(lw_tls_context_ssl(context), NULL, &server.stream), NULL);
        uint8_t *bad = malloc(size);
        memcpy(bad, good, size);
        bad[i] ^= 0x55;
        struct end peer = {.output = {.bytes = bad, .size = i % 2 ? size : i, .capacity = size}};
        hear(&server, &peer, SIZE_MAX);
        assert_false(lw_tls_stream_is_ready(server.stream));
        if (server.status != LW_OK) { /* and it stays so */
            size_t got;
            assert_int_equal(lw_tls_stream_read(server.stream, server.heard, 10, &got, &server.output, NULL),
                             LW_PROTOCOL);
            assert_int_equal(lw_tls_stream_write(server.stream, good, 1, &server.output), LW_PROTOCOL);
        }
    }
    free(good);
    finish_ends(state);
    make_ends("DNS:localhost", &believes_all, "localhost");
    shake_hands(SIZE_MAX);
    say(&client, 100);
    client.output.bytes[50] ^= 1; /* one byte of a whole record */
    hear(&server, &client, SIZE_MAX);
    lw_support_fails(server.status, LW_PROTOCOL, &server.err, "bad record mac");
    assert_int_equal(server.heard_size, 0);
}

/* ---- the server's files ---- */

static void refuses(enum lw_status expected, const char *text) {
    struct lw_error err = {0};
    struct lw_tls_context *none = NULL;
    lw_support_fails(lw_tls_context_create(&(struct lw_tls_context_desc){certificate, key}, &none, &err),
                     expected, &err, text);
    assert_null(none);
}

static void test_bad_files(void **state) {
    (void)state;
    make_files("DNS:localhost", -1);
    refuses(LW_BAD_DATA, "has expired");
    make_files("DNS:localhost", 10);
    assert_int_equal(remove(key), 0);
    refuses(LW_NO_INPUT, "key.pem");
    lw_certificate_make(lw_support_temporary("other.pem"), key, "DNS:localhost", 10);
    refuses(LW_BAD_DATA, "is not that of the certificate");
    lw_support_write_file(key, "nonsense", 8);
    refuses(LW_BAD_DATA, "holds no key");
    make_files("DNS:localhost", 10);
    lw_support_write_file(certificate, "nonsense", 8);
    refuses(LW_BAD_DATA, "holds no certificate");
    make_files("DNS:localhost", 10);
    FILE *file = fopen(certificate, "a");
    assert_non_null(file);
    assert_true(fputs("-----BEGIN CERTIFICATE-----\nnonsense\n-----END CERTIFICATE-----\n", file) >= 0);
    assert_int_equal(fclose(file), 0);
    refuses(LW_BAD_DATA, "what follows the first certificate is broken");
    make_files("DNS:localhost", 10);
    assert_int_equal(truncate(certificate, LW_TLS_CONTEXT_FILE_MAX + 1), 0);
    refuses(LW_BAD_DATA, "the limit is");
    assert_int_equal(truncate(certificate, LW_TLS_CONTEXT_FILE_MAX), 0);
    struct lw_error err = {0};
    lw_support_ok(lw_tls_context_create(&(struct lw_tls_context_desc){certificate, key}, &context, &err),
                  &err);
    lw_tls_context_destroy(context);
    context = NULL;
    make_files("DNS:localhost", 10);
    assert_int_equal(chmod(key, 0644), 0);
    refuses(LW_BAD_DATA, "others can read");
    assert_int_equal(chmod(key, 0640), 0);
    lw_support_ok(lw_tls_context_create(&(struct lw_tls_context_desc){certificate, key}, &context, &err),
                  &err);
    char about[200];
    lw_tls_context_about(context, about, sizeof about);
    assert_non_null(strstr(about, "lightwell test"));
}

static void test_files_of_a_client(void **state) {
    (void)state;
    struct lw_error err = {0};
    make_files("DNS:localhost", 10);
    lw_support_write_file(certificate, "nonsense", 8);
    lw_support_fails(lw_tls_trust_create(&(struct lw_tls_trust_desc){true, certificate, false}, &trust, &err),
                     LW_BAD_DATA, &err, "holds no certificate");
    err = (struct lw_error){0};
    lw_support_fails(lw_tls_trust_create(&(struct lw_tls_trust_desc){true, "/nowhere", false}, &trust, &err),
                     LW_NO_INPUT, &err, "/nowhere");
    lw_support_ok(lw_tls_trust_create(&(struct lw_tls_trust_desc){0}, &trust, NULL), NULL);
    assert_null(trust);
}

/* Bad files leave the earlier certificate; good ones hold from the next handshake on, also for a follower. */
static void test_reload(void **state) {
    make_ends("DNS:localhost", &believes_file, "localhost");
    struct lw_error err = {0};
    SSL_CTX *follower = SSL_CTX_new(TLS_server_method());
    lw_support_ok(lw_tls_context_lead(context, follower), NULL);
    lw_support_write_file(key, "nonsense", 8);
    lw_support_fails(lw_tls_context_reload(context, &err), LW_BAD_DATA, &err, "key.pem");
    talk(SIZE_MAX);
    char other[200];
    snprintf(other, sizeof other, "%s", lw_support_temporary("other.pem"));
    lw_certificate_make(certificate, key, "DNS:newer.example", 20);
    err = (struct lw_error){0};
    lw_support_ok(lw_tls_context_reload(context, &err), &err);
    SSL_CTX *const serving[] = {lw_tls_context_ssl(context), follower};
    for (int i = 0; i < 2; i++) {
        finish_end(&client);
        finish_end(&server);
        lw_tls_trust_unref(trust);
        lw_support_ok(
            lw_tls_trust_create(&(struct lw_tls_trust_desc){true, certificate, false}, &trust, &err), &err);
        lw_support_ok(lw_tls_stream_create(serving[i], NULL, &server.stream), NULL);
        lw_support_ok(lw_tls_stream_create(trust, "newer.example", &client.stream), NULL);
        talk(SIZE_MAX);
    }
    lw_tls_context_let_go(context, follower);
    SSL_CTX_free(follower);
    finish_ends(state);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(test_whole_and_byte_by_byte, finish_ends),
        cmocka_unit_test_teardown(test_names_are_verified, finish_ends),
        cmocka_unit_test_teardown(test_other_certificates_are_not_believed, finish_ends),
        cmocka_unit_test_teardown(test_tls_1_2_is_refused, finish_ends),
        cmocka_unit_test_teardown(test_garbage, finish_ends),
        cmocka_unit_test_teardown(test_bad_files, finish_ends),
        cmocka_unit_test_teardown(test_files_of_a_client, finish_ends),
        cmocka_unit_test_teardown(test_reload, finish_ends),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
