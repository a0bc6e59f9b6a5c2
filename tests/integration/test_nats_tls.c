/* Light through NATS by TLS: which nats-servers are believed, and what each program says of others. */
#include "tests/support/certificate.h"
#include "tests/support/nats_case.h"
#include "tests/support/relays.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static struct lw_process server, relay;
static struct lw_nats_case nats;
static char certificate[200], key[200], other[200], other_key[200];

static int end_all(void **state) {
    (void)state;
    lw_relays_end();
    lw_nats_case_finish(&nats);
    server = relay = (struct lw_process){.port = 0};
    return 0;
}

static void make_certificates(const char *names, int days) {
    snprintf(certificate, sizeof certificate, "%s", lw_support_temporary("certificate.pem"));
    snprintf(key, sizeof key, "%s", lw_support_temporary("key.pem"));
    snprintf(other, sizeof other, "%s", lw_support_temporary("other.pem"));
    snprintf(other_key, sizeof other_key, "%s", lw_support_temporary("other_key.pem"));
    lw_certificate_make(certificate, key, names, days);
    lw_certificate_make(other, other_key, "DNS:elsewhere", 10);
}

static void start_nats(bool tls) {
    char options[500];
    snprintf(options, sizeof options, "--tls --tlscert %s --tlskey %s", certificate, key);
    lw_nats_case_start(&nats, &(struct lw_nats_case_desc){.options = tls ? options : NULL});
}

/* By TLS; host: NULL: 127.0.0.1 */
static const char *address(const char *host) {
    static char text[64];
    snprintf(text, sizeof text, "tls://%s:%u/room", host ? host : "127.0.0.1", nats.port);
    return text;
}

static void serve(const char *options) {
    char arguments[700];
    snprintf(arguments, sizeof arguments, LW_RELAYS_CORNELL " --nats %s %s", address(NULL), options);
    lw_process_serve(&server, arguments);
}

static bool second_has_the_frame(void) {
    return lw_relays_stats(0).frame && lw_relays_stats(1).frame >= lw_relays_stats(0).frame;
}

/* A daemon believes one certificate, a relay the system's issuers, anybody or that certificate. NATS comes
 * back. */
static void light_comes_by_tls(void **state) {
    (void)state;
    char options[300];
    struct lw_client_answer answer;
    const struct lw_scene_change hide = {.kind = LW_SCENE_CHANGE_OBJECT_HIDE, .target = 5};
    make_certificates("DNS:localhost,IP:127.0.0.1", 10);
    start_nats(true);
    snprintf(options, sizeof options, "--ca %s", certificate);
    serve(options);
    setenv("SSL_CERT_FILE", certificate, 1); /* the issuers that the system believes */
    lw_relays_start(&relay, address("localhost"), "");
    unsetenv("SSL_CERT_FILE");
    lw_relays_join_with(0, server.port, (struct lw_client_desc){.control = true});
    lw_relays_join(1, relay.port);
    lw_relays_rest(&server);
    for (size_t i = 0; i < 2; i++) {
        snprintf(options, sizeof options, "%s%s", i ? "--tls --ca " : "--tls-insecure", i ? certificate : "");
        lw_process_end(&relay);
        lw_relays_start(&relay, address("localhost"), options);
        lw_relays_reconnect(1);
        lw_relays_expect_same();
    }
    lw_nats_case_kill(&nats);
    lw_process_await_text(&server, "is gone: its relays get no light");
    start_nats(true);
    lw_process_await_text(&server, "is there again");
    lw_relays_update(0, &hide, &answer);
    assert_int_equal(answer.code, LW_SCENE_CHANGE_OK);
    lw_relays_wait(second_has_the_frame);
    lw_relays_expect_same();
}

static void refuses(const char *options, int code, const char *said) {
    char arguments[700];
    snprintf(arguments, sizeof arguments, LW_RELAYS_CORNELL " --listen 127.0.0.1:0 %s", options);
    lw_process_refuses("lightwelld", arguments, code, said, LW_PROCESS_LIMIT_S);
}

/* The relay tries on, and says why. */
static void relay_says(const char *options, const char *said) {
    char arguments[500];
    snprintf(arguments, sizeof arguments, "%s --listen 127.0.0.1:0 --http none %s", address(NULL), options);
    lw_process_start(&relay, "lightwell-relay", arguments);
    lw_process_await_text(&relay, said);
    lw_process_end(&relay);
}

static void refuses_with(const char *ca, int code, const char *said) {
    char options[500];
    snprintf(options, sizeof options, "--nats %s %s%s", address(NULL), ca ? "--ca " : "", ca ? ca : "");
    refuses(options, code, said);
}

static void others_are_not_believed(void **state) {
    (void)state;
    char options[500], plain[100];
    make_certificates("DNS:localhost,IP:127.0.0.1", 10);
    start_nats(true);
    refuses_with(NULL, 77, "is not trusted");
    refuses_with(other, 77, "--ca FILE names the certificate to believe");
    refuses_with("/nowhere", 66, "--ca: /nowhere");
    refuses_with(key, 65, "holds no certificate in PEM");
    relay_says("--tls", "is not trusted");
    snprintf(options, sizeof options, "--ca %s", other);
    relay_says(options, "--ca FILE names the certificate to believe");
    /* options that do not go together */
    snprintf(plain, sizeof plain, "%s", lw_nats_case_address(&nats, "room"));
    snprintf(options, sizeof options, "--nats %s --ca %s", plain, certificate);
    refuses(options, 64, "--ca is for --nats tls://");
    snprintf(options, sizeof options, "--nats %s --ca %s --tls-insecure", address(NULL), certificate);
    refuses(options, 64, "exclude each other");
    snprintf(options, sizeof options, "%s --tls", plain);
    lw_process_refuses("lightwell-relay", options, 64, "is in plain", LW_PROCESS_LIMIT_S);
    /* one end speaks TLS alone, the other one does not */
    snprintf(options, sizeof options, "--nats %s", plain);
    refuses(options, 76, "speaks TLS alone: write tls://");
    lw_nats_case_kill(&nats);
    start_nats(false);
    refuses_with(certificate, 76, "does not speak TLS: write nats://");
}

/* A certificate that is believed, but is another server's, or has expired. */
static void certificates_are_for_a_name_and_a_time(void **state) {
    (void)state;
    make_certificates("DNS:elsewhere", 10);
    start_nats(true);
    refuses_with(certificate, 77, "it must be for 127.0.0.1");
    lw_nats_case_kill(&nats);
    make_certificates("IP:127.0.0.1", -1);
    start_nats(true);
    refuses_with(certificate, 77, "is not trusted");
}

int main(void) {
    if (!lw_nats_case_is_possible()) return 0;
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(light_comes_by_tls, end_all),
        cmocka_unit_test_teardown(others_are_not_believed, end_all),
        cmocka_unit_test_teardown(certificates_are_for_a_name_and_a_time, end_all),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
