/* TLS with the real programs: which certificates are trusted, the message of each end for mistakes, new
 * files. */
#include "tests/support/certificate.h"
#include "tests/support/process.h"
#include "tests/support/web_peer.h"

#include "client/lib/tls_trust.h"
#include "common/tls/tls_stream.h"

#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#define LIMIT_MS (LW_PROCESS_LIMIT_S * 1000)

static struct lw_process server;
static char certificate[200], key[200], http_file[200];

static void make_files(const char *names) {
    snprintf(certificate, sizeof certificate, "%s", lw_support_temporary("certificate.pem"));
    snprintf(key, sizeof key, "%s", lw_support_temporary("key.pem"));
    lw_certificate_make(certificate, key, names, 10);
}

static void serve(const char *more) {
    char arguments[1000];
    make_files("DNS:localhost,IP:127.0.0.1");
    snprintf(http_file, sizeof http_file, "%s", lw_support_temporary("http_port"));
    snprintf(arguments, sizeof arguments,
             "builtin:cornell --freeze 0 --control-socket none --http 127.0.0.1:0 --http-port-file %s "
             "--tls-certificate %s --tls-key %s%s",
             http_file, certificate, key, more);
    lw_process_serve(&server, arguments);
}

static uint16_t http_port(void) {
    size_t size;
    char *text = (char *)lw_support_read_file(http_file, &size);
    const uint16_t port = (uint16_t)strtoul(text, NULL, 10);
    free(text);
    return port;
}

/* Runs it on the server's port; ends the test unless it ends with this code and says this on stderr. */
static void runs(const char *program, const char *options, int code, const char *said) {
    struct lw_process process;
    char arguments[700];
    snprintf(arguments, sizeof arguments, "%u %s", server.port, options);
    lw_process_start(&process, program, arguments);
    lw_process_expect(&process, lw_process_finish(&process, LW_PROCESS_LIMIT_S), code);
    char *text = lw_process_err(&process);
    if (said && !strstr(text, said)) fail_msg("%s %s said %s", program, arguments, text);
    free(text);
}

static void trusting(const char *program, const char *options) {
    char arguments[500];
    snprintf(arguments, sizeof arguments, "%s --ca %s", options, certificate);
    runs(program, arguments, 0, NULL);
}

static void test_programs_by_tls(void **state) {
    (void)state;
    serve("");
    trusting("lightwellctl", "status");
    /* handshakes for which one turn of the loop is too short: they go on in the next ones */
    trusting("lightwell-load", "--users 60 --seconds 1");
    trusting("lightwell-view", "--headless --wait first --json");
    runs("lightwellctl", "status --tls-insecure", 0, NULL);
    runs("lightwellctl", "status --tls", 77, "is not trusted");
    runs("lightwell-load", "--users 1 --seconds 1 --tls", 77, "is not trusted");
    runs("lightwellctl", "status", 76, "this server speaks TLS alone: connect with --tls");
    char both[300];
    snprintf(both, sizeof both, "status --tls-insecure --ca %s", certificate);
    runs("lightwellctl", both, 64, "exclude each other");
    runs("lightwellctl", "status --ca /nowhere", 66, "/nowhere");
    lw_process_end(&server);
}

static void test_plain_server(void **state) {
    (void)state;
    lw_process_serve(&server, "builtin:cornell --freeze 0 --control-socket none --http none");
    runs("lightwellctl", "status --tls-insecure", 76, "does not speak TLS: connect without --tls and --ca");
    runs("lightwell-load", "--users 1 --seconds 1 --tls", 76, "does not speak TLS");
    assert_true(lw_process_said(&server, "it speaks TLS, and this server has no certificate"));
    lw_process_end(&server);
}

/* ---- at the browsers' port ---- */

struct peer {
    int socket;
    struct lw_tls_stream *stream;
    struct lw_tls_output output;
};

static void flush(struct peer *peer) {
    if (peer->output.size)
        assert_int_equal(send(peer->socket, peer->output.bytes, peer->output.size, MSG_NOSIGNAL),
                         (ssize_t)peer->output.size);
    peer->output.size = 0;
}

/* Reads until what came contains `until`, or the server has ended it. */
static void read_until(struct peer *peer, const char *until, char *dst, size_t capacity) {
    static uint8_t sealed[65536];
    size_t size = 0;
    *dst = 0;
    for (;;) {
        struct pollfd wait = {.fd = peer->socket, .events = POLLIN};
        size_t got;
        struct lw_error err = {0};
        do {
            got = 0;
            enum lw_status status = lw_tls_stream_read(peer->stream, (uint8_t *)dst + size,
                                                       capacity - 1 - size, &got, &peer->output, &err);
            if (status == LW_CLOSED) return;
            lw_support_ok(status, &err);
            size += got;
            dst[size] = 0;
        } while (got);
        flush(peer);
        if (until ? strstr(dst, until) != NULL : lw_tls_stream_is_ready(peer->stream)) return;
        assert_int_equal(poll(&wait, 1, LIMIT_MS), 1);
        ssize_t came = recv(peer->socket, sealed, sizeof sealed, 0);
        assert_true(came >= 0);
        if (came == 0) return;
        lw_tls_stream_lend(peer->stream, sealed, (size_t)came);
    }
}

static void dial(struct peer *peer, uint16_t port) {
    struct lw_error err = {0};
    struct ssl_ctx_st *trust;
    char nothing[16];
    lw_support_ok(lw_tls_trust_create(&(struct lw_tls_trust_desc){true, certificate, false}, &trust, &err),
                  &err);
    *peer = (struct peer){.socket = lw_web_peer_dial(port)};
    lw_support_ok(lw_tls_stream_create(trust, "localhost", &peer->stream), NULL);
    lw_tls_trust_unref(trust);
    read_until(peer, NULL, nothing, sizeof nothing);
}

static void hang_up(struct peer *peer) {
    lw_tls_stream_destroy(peer->stream);
    lw_tls_output_finish(&peer->output);
    close(peer->socket);
}

static void ask(struct peer *peer, const char *request, const char *until, char *answer, size_t capacity) {
    lw_support_ok(lw_tls_stream_write(peer->stream, (const uint8_t *)request, strlen(request), &peer->output),
                  NULL);
    flush(peer);
    read_until(peer, until, answer, capacity);
}

static void test_https_and_wss(void **state) {
    (void)state;
    static char answer[100000];
    struct peer peer;
    serve("");
    dial(&peer, http_port());
    ask(&peer, "GET / HTTP/1.1\r\nHost: localhost\r\n\r\n", "</html>", answer, sizeof answer);
    assert_non_null(strstr(answer, "HTTP/1.1 200"));
    hang_up(&peer);
    dial(&peer, http_port());
    ask(&peer,
        "GET /ws HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n"
        "Sec-WebSocket-Protocol: lightwell\r\n\r\n",
        "\r\n\r\n", answer, sizeof answer);
    assert_non_null(strstr(answer, "HTTP/1.1 101"));
    hang_up(&peer);
    const int plain = lw_web_peer_dial(http_port());
    char *text = lw_web_peer_ask(plain, "GET / HTTP/1.1\r\nHost: localhost\r\n\r\n", false, NULL);
    assert_non_null(strstr(text, "HTTP/1.1 400"));
    assert_non_null(strstr(text, "This server speaks TLS alone"));
    free(text);
    close(plain);
    lw_process_end(&server);
}

/* ---- SIGHUP ---- */

/* Waits until the server has said this `count` times. */
static void await_lines(const char *text, unsigned count) { lw_process_await_texts(&server, text, count); }

static void test_new_files(void **state) {
    (void)state;
    serve("");
    struct peer before, web;
    dial(&before, server.port);
    lw_support_write_file(key, "nonsense", 8);
    assert_int_equal(kill(server.pid, SIGHUP), 0);
    await_lines("the certificate stays as it was: ", 1);
    trusting("lightwellctl", "status");
    make_files("DNS:localhost,IP:127.0.0.1,DNS:other.example");
    assert_int_equal(kill(server.pid, SIGHUP), 0);
    await_lines("TLS: certificate of /CN=lightwell test", 2); /* once at the start */
    trusting("lightwellctl", "status");                       /* which believes the new one alone */
    dial(&web, http_port());
    hang_up(&web);
    lw_support_ok(lw_tls_stream_write(before.stream, (const uint8_t *)"\0\0\0\0", 4, &before.output), NULL);
    flush(&before); /* an earlier session stays */
    hang_up(&before);
    lw_process_end(&server);
}

static void test_bad_options(void **state) {
    (void)state;
    char arguments[700];
    make_files("DNS:localhost");
    snprintf(arguments, sizeof arguments, "builtin:cornell --listen 127.0.0.1:0 --tls-certificate %s",
             certificate);
    lw_process_refuses("lightwelld", arguments, 64, "--tls-certificate and --tls-key need each other",
                       LW_PROCESS_LIMIT_S);
    snprintf(arguments, sizeof arguments,
             "builtin:cornell --listen 127.0.0.1:0 --http none --tls-certificate %s --tls-key /nowhere",
             certificate);
    lw_process_refuses("lightwelld", arguments, 66, "/nowhere", LW_PROCESS_LIMIT_S);
}

/* What other machines reach wants both, unless --insecure is said. */
static void test_addresses_of_other_machines(void **state) {
    (void)state;
    char arguments[900];
    make_files("DNS:localhost");
    lw_process_refuses("lightwelld", "builtin:cornell --listen 0.0.0.0:0", 64, "--listen: other machines",
                       LW_PROCESS_LIMIT_S);
    lw_process_refuses("lightwelld", "builtin:cornell --listen 127.0.0.1:0 --http 0.0.0.0:0", 64,
                       "--http: other machines", LW_PROCESS_LIMIT_S);
    lw_process_refuses("lightwelld", "builtin:cornell --listen 127.0.0.1:0 --metrics 0.0.0.0:0", 64,
                       "--metrics: other machines", LW_PROCESS_LIMIT_S);
    snprintf(arguments, sizeof arguments,
             "builtin:cornell --listen 0.0.0.0:0 --tls-certificate %s --tls-key %s", certificate, key);
    lw_process_refuses("lightwelld", arguments, 64, "which wants tokens (--tokens)", LW_PROCESS_LIMIT_S);
    lw_process_serve(&server, "builtin:cornell --freeze 0 --listen 0.0.0.0:0 --http none --insecure "
                              "--control-socket none");
    await_lines("warning: --listen: other machines can reach 0.0.0.0", 1);
    runs("lightwellctl", "status", 0, NULL);
    lw_process_end(&server);
}

#define TOKEN "00112233445566778899aabbccddeeff00112233445566778899aabbccddeeff"

static unsigned status_of(const char *more) {
    static char answer[100000];
    char request[400];
    struct peer peer;
    dial(&peer, http_port());
    snprintf(request, sizeof request, "GET /healthz HTTP/1.1\r\nHost: localhost\r\n%s\r\n", more);
    ask(&peer, request, "\r\n\r\n", answer, sizeof answer);
    hang_up(&peer);
    assert_memory_equal(answer, "HTTP/1.1 ", 9);
    return (unsigned)strtoul(answer + 9, NULL, 10);
}

static void test_monitoring_from_other_machines(void **state) {
    (void)state;
    char arguments[1200], tokens[200];
    make_files("DNS:localhost,IP:127.0.0.1");
    snprintf(http_file, sizeof http_file, "%s", lw_support_temporary("metrics_port"));
    snprintf(tokens, sizeof tokens, "%s", lw_support_temporary("tokens"));
    lw_support_write_file(tokens, "view " TOKEN "\n", strlen("view " TOKEN "\n"));
    assert_int_equal(chmod(tokens, 0600), 0);
    snprintf(arguments, sizeof arguments,
             "builtin:cornell --freeze 0 --listen 0.0.0.0:0 --http none --control-socket none --tokens %s "
             "--metrics 0.0.0.0:0 --metrics-port-file %s --tls-certificate %s --tls-key %s",
             tokens, http_file, certificate, key);
    lw_process_serve(&server, arguments);
    assert_int_equal(status_of(""), 401);
    assert_int_equal(status_of("Authorization: Bearer 01" TOKEN "\r\n"), 401);
    assert_int_equal(status_of("Authorization: Basic " TOKEN "\r\n"), 401);
    assert_int_equal(status_of("Authorization: Bearer 1" TOKEN "\r\n"), 401);
    assert_int_equal(status_of("Authorization: Bearer " TOKEN "\r\n"), 200);
    lw_process_end(&server);
}

/* Bytes that are no TLS, or begin as if they were, harm nobody. */
static void test_garbage(void **state) {
    (void)state;
    static const char *const said[] = {"GET / HTTP/1.1\r\n\r\n",   "\x16",
                                       "\x16\x03\x01\xff\xff",     "\x80\x2e\x01\x03",
                                       "\x15\x03\x03\x02\x02\x46", "\x17\x03\x03\x40\x01"};
    serve("");
    int peers[60];
    for (unsigned i = 0; i < 60; i++) {
        const char *text = said[i % (sizeof said / sizeof *said)];
        peers[i] = lw_web_peer_dial(i % 2 ? server.port : http_port());
        (void)lw_web_peer_put(peers[i], text);
    }
    trusting("lightwellctl", "status");
    for (unsigned i = 0; i < 60; i++) close(peers[i]);
    lw_process_end(&server);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(test_programs_by_tls, lw_process_teardown),
        cmocka_unit_test_teardown(test_plain_server, lw_process_teardown),
        cmocka_unit_test_teardown(test_https_and_wss, lw_process_teardown),
        cmocka_unit_test_teardown(test_new_files, lw_process_teardown),
        cmocka_unit_test_teardown(test_bad_options, lw_process_teardown),
        cmocka_unit_test_teardown(test_addresses_of_other_machines, lw_process_teardown),
        cmocka_unit_test_teardown(test_monitoring_from_other_machines, lw_process_teardown),
        cmocka_unit_test_teardown(test_garbage, lw_process_teardown),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
