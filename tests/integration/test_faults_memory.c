/* Faults: the real programs without memory, at each allocation in turn. */
#include "tests/integration/faults_case.h"
#include "tests/support/certificate.h"
#include "tests/support/client_light.h"
#include "tests/support/web_peer.h"

#include "client/lib/client.h"
#include "common/base/clock.h"
#include "common/base/sanitizer.h"
#include "proto/message.h"

#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

/* ---- the C library fails ---- */

/* Promise: lack of memory ends a program with a line, or costs nothing; never a signal.
 * aborts  of libraries, which cannot be asked not to: libuv does where it has no memory for the handler of
 *         forks that it installs when the first loop begins */
static void each_allocation_may_fail(const char *program, const char *arguments, unsigned aborts) {
    long allocations, writes;
    unsigned ended = 0, went_on = 0, tries = 0;
    faults_case_count_calls(program, arguments, 0, &allocations, &writes);
    const long step = faults_case_is_long || allocations < 20 ? 1 : allocations / 20;
    for (long n = 1; n <= allocations; n += step, tries++) {
        struct lw_process process;
        faults_case_set_number("FAULT_ALLOCATION", n);
        lw_process_start(&process, program, arguments);
        const int code = lw_process_finish(&process, LIMIT_S);
        char *said = lw_process_err(&process);
        if (code == -SIGABRT && aborts) {
            aborts--;
            free(said);
            continue;
        }
        if (code < 0)
            fail_msg("%s, allocation %ld of %ld: signal %d: %s", program, n, allocations, -code, said);
        if (code > 0 && !*said) fail_msg("%s, allocation %ld: ends with %d without a word", program, n, code);
        *(code ? &ended : &went_on) += 1;
        free(said);
    }
    print_message("%s: %u of %ld allocations failed, one a run: %u runs ended with a line, %u went on\n",
                  program, tries, allocations, ended, went_on);
    unsetenv("FAULT_ALLOCATION");
}

static void an_import_without_memory_is_a_line(void **state) {
    (void)state;
    if (LW_SANITIZER) skip(); /* it has allocation functions of its own */
    char arguments[512];
    snprintf(arguments, sizeof arguments, "builtin:cornell -o %s --threads 1 --texels-per-metre 4",
             lw_support_temporary("no_memory.lwscene"));
    each_allocation_may_fail("lightwell-import", arguments, 0);
}

static void a_solve_without_memory_is_a_line(void **state) {
    (void)state;
    if (LW_SANITIZER) skip();
    char import[512], serve[512];
    struct lw_process process;
    const char *scene = lw_support_temporary("solve.lwscene");
    snprintf(import, sizeof import, "builtin:cornell -o %s --texels-per-metre 2", scene);
    lw_process_run(&process, "lightwell-import", import, 0);
    snprintf(
        serve, sizeof serve,
        "%s --listen 127.0.0.1:0 --http none --control-socket none --clock step --light whole --frames 2 "
        "--threads 1",
        scene);
    each_allocation_may_fail("lightwelld", serve, 1);
}

/* Allocations of all threads while a client comes, gets everything and goes: once there was light, light that
 * could not be published is published later. */
static void a_frame_without_memory_is_published_later(void **state) {
    (void)state;
    if (LW_SANITIZER) skip();
    const unsigned tries = faults_case_is_long ? 400 : 6;
    unsigned refused = 0, ended = 0;
    faults_case_shim("lightwelld");
    long allocations, writes;
    faults_case_count_calls("lightwelld", CORNELL "--listen 127.0.0.1:0 --http none --threads 1 --frames 1",
                            0, &allocations, &writes);
    for (unsigned i = 0; i < tries; i++) {
        struct lw_process daemon;
        /* after what a start needs: that is the test above */
        faults_case_set_number("FAULT_ALLOCATION", allocations + 1 + (faults_case_is_long ? i : 31 * i));
        lw_process_serve(&daemon, CORNELL "--http none --threads 1");
        struct lw_client *client = NULL;
        struct lw_error err = {0};
        const struct lw_client_desc desc = {.host = "127.0.0.1", .port = daemon.port, .name = "test_faults"};
        enum lw_status status = lw_client_create(&desc, &client, &err);
        const uint64_t end_ns = lw_clock_ns() + LIMIT_S * 1000000000ull;
        while (status == LW_OK && !client_light_is_whole(client, TARGET)) {
            status = lw_client_poll(client, 10, &err);
            if (lw_clock_ns() > end_ns) fail_msg("no light within %u s", LIMIT_S);
        }
        lw_client_destroy(client);
        refused += status != LW_OK;
        client = NULL;
        if (lw_client_create(&desc, &client, &err) == LW_OK) lw_client_destroy(client);
        const int code =
            client ? lw_process_stop(&daemon, SIGTERM, LIMIT_S) : lw_process_finish(&daemon, LIMIT_S);
        char *said = lw_process_err(&daemon);
        if (code < 0 || (code > 0 && (!strstr(said, "memory") || strstr(said, "first light after"))))
            fail_msg("allocation %ld + %u: ends with %d: %s", allocations, i, code, said);
        ended += code > 0;
        free(said);
    }
    print_message(
        "%u allocations failed: %u sessions ended, and %u servers with a line, before first light\n", tries,
        refused, ended);
}

/* ---- connections without memory ---- */

#define CONNECTIONS_MAX 2000 /* allocations that none takes */
#define VISIT_S         LIMIT_S
/* A browser gives up so long after the failure: one connection that libwebsockets has no memory for is
 * neither served nor closed before its time is over. A client that is not hit waits for its answer. */
#define PATIENCE_NS 100000000u

struct way {
    const char *name, *arguments, *port_file; /* NULL: the daemon's own port */
    void (*visit)(struct way *way);
    char host[256];
    uint16_t port;
    struct lw_access access;
    struct lw_process daemon;
    unsigned failures;  /* number in the connections before this one */
    uint64_t failed_ns; /* when this one's was seen; 0: not yet */
};

static const struct lw_message hello = {.type = LW_MESSAGE_HELLO,
                                        .hello = {.version = LW_WIRE_VERSION,
                                                  .features = LW_FEATURE_DCT | LW_FEATURE_PARTS,
                                                  .name = "test_faults"}},
                               request = {.type = LW_MESSAGE_PACKAGE_REQUEST},
                               ping = {.type = LW_MESSAGE_PING};

/* Whether the session goes on until there is light. */
static bool has_light(struct lw_client *client) {
    const uint64_t end_ns = lw_clock_ns() + VISIT_S * 1000000000ull;
    struct lw_client_stats stats = {0};
    while (!stats.frame) {
        if (lw_client_poll(client, 10, NULL) != LW_OK) return false;
        lw_client_get_stats(client, &stats);
        if (lw_clock_ns() > end_ns) fail_msg("the session neither goes on nor ends");
    }
    return true;
}

static bool is_answered(struct lw_client *client) {
    const struct lw_scene_change change = {.kind = LW_SCENE_CHANGE_OBJECT_SHOW};
    const uint64_t end_ns = lw_clock_ns() + VISIT_S * 1000000000ull;
    struct lw_client_answer answer;
    uint64_t number;
    if (lw_client_update(client, &change, 1, &number, NULL) != LW_OK) return false;
    while (!lw_client_next_answer(client, &answer)) {
        if (lw_client_poll(client, 10, NULL) != LW_OK) return false;
        if (lw_clock_ns() > end_ns) fail_msg("an update has no answer");
    }
    return true;
}

/* All that makes a session allocate: package, light in both forms, interest, updates. */
static void visit_as_client(struct way *way) {
    static unsigned visits;
    struct lw_client *client = NULL;
    const struct lw_client_desc desc = {.host = way->host,
                                        .port = way->port,
                                        .access = &way->access,
                                        .control = true,
                                        .draws_direct = visits++ & 1,
                                        .timeout_ms = VISIT_S * 1000};
    if (lw_client_create(&desc, &client, NULL) != LW_OK) return;
    const lw_tile_id few[] = {{0}, {1}};
    if (has_light(client) && lw_client_want(client, few, 2) == LW_OK &&
        lw_client_poll(client, 30, NULL) == LW_OK && lw_client_may_update(client))
        (void)is_answered(client);
    lw_client_destroy(client);
}

static unsigned failures_of(const struct lw_process *daemon) {
    unsigned count = 0;
    char *said = lw_process_err(daemon);
    for (const char *at = said; (at = strstr(at, "fault_shim: failed")); at++) count++;
    free(said);
    return count;
}

static bool has_no_hope(void *context) {
    struct way *way = context;
    if (!way->failed_ns && failures_of(&way->daemon) > way->failures) way->failed_ns = lw_clock_ns();
    return way->failed_ns && lw_clock_ns() > way->failed_ns + PATIENCE_NS;
}

static int dial_web(struct way *way) {
    way->failures = failures_of(&way->daemon);
    way->failed_ns = 0;
    lw_web_peer_give_up(has_no_hope, way);
    return lw_web_peer_dial(way->port);
}

static void visit_as_browser(struct way *way) {
    const int s = dial_web(way);
    free(lw_web_peer_ask(s, "GET / HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n", false, NULL));
    close(s);
}

static bool say(int s, const struct lw_message *message) {
    uint8_t *bytes;
    size_t size;
    lw_support_ok(lw_message_encode_alloc(message, &bytes, &size), NULL);
    const bool said = lw_web_peer_write(s, true, WEB_PEER_BINARY, bytes, size, size);
    free(bytes);
    return said;
}

static void visit_by_web_socket(struct way *way) {
    static const char lines[] = "Host: localhost\r\nSec-WebSocket-Protocol: lightwell\r\n";
    const int s = dial_web(way);
    if (lw_web_peer_upgrade(s, "/ws", lines) == 101 && say(s, &hello) && say(s, &request) && say(s, &ping))
        (void)lw_web_peer_closes(s, 100); /* it takes bytes that come meanwhile */
    close(s);
}

static uint16_t read_number(const char *path) {
    size_t size;
    char *text = (char *)lw_support_read_file(path, &size);
    const uint16_t number = (uint16_t)strtoul(text, NULL, 10);
    free(text);
    return number;
}

/* How many allocations the newest connection had that another one followed; its number. */
static void last_connection(const struct lw_process *daemon, long *out_number, long *out_allocations) {
    static const char mark[] = "fault_shim: connection ";
    char *said = lw_process_err(daemon), *at = NULL;
    for (char *next = said; (next = strstr(next, mark)); next++) at = next;
    *out_number = *out_allocations = 0;
    if (at) assert_int_equal(sscanf(at + strlen(mark), "%ld: %ld", out_number, out_allocations), 2);
    free(said);
}

/* Each connection fails one allocation later than the one before it, until some have more than they need:
 * so each of all allocations fails once, and each failure is followed by somebody who is served. */
static void each_allocation_of_a_connection_may_fail(struct way *way, long step) {
    char arguments[1024];
    struct lw_process *daemon = &way->daemon;
    long number = 0, allocations = 0;
    faults_case_shim("lightwelld");
    faults_case_set_number("FAULT_CONNECTION", step);
    snprintf(arguments, sizeof arguments, CORNELL "--light seen --threads 1 %s", way->arguments);
    lw_process_serve(daemon, arguments);
    unsetenv("LD_PRELOAD");
    way->port = way->port_file ? read_number(way->port_file) : daemon->port;
    for (unsigned spared = 0; spared<8; spared += number> allocations) {
        way->visit(way);
        if (!lw_process_runs(daemon))
            fail_msg("%s: the server ends with %d after connection %ld", way->name,
                     lw_process_stop(daemon, 0, 1), number + 1);
        last_connection(daemon, &number, &allocations);
        if (number > CONNECTIONS_MAX)
            fail_msg("%s: connection %ld has %ld allocations", way->name, number, allocations);
    }
    const int code = lw_process_stop(daemon, SIGTERM, LIMIT_S);
    char *said = lw_process_err(daemon);
    if (code || !strstr(said, "out of memory")) fail_msg("%s: ends with %d: %s", way->name, code, said);
    free(said);
    print_message("%s: of %ld allocations %s failed, one a connection\n", way->name, allocations,
                  step > 1 ? "a sample" : "each");
}

static void sessions_without_memory_end_alone(void **state) {
    (void)state;
    if (LW_SANITIZER) skip(); /* it has allocation functions of its own */
    char certificate[200], key[200], by_socket[300], by_tls[700], by_http[300], socket_path[200],
        http_port[200];
    snprintf(certificate, sizeof certificate, "%s", lw_support_temporary("certificate.pem"));
    snprintf(key, sizeof key, "%s", lw_support_temporary("key.pem"));
    snprintf(socket_path, sizeof socket_path, "%s", lw_support_temporary("control"));
    snprintf(http_port, sizeof http_port, "%s", lw_support_temporary("http_port"));
    lw_certificate_make(certificate, key, "IP:127.0.0.1", 10);
    snprintf(by_socket, sizeof by_socket, "--http none --control-socket %s", socket_path);
    snprintf(by_tls, sizeof by_tls, "--http none --control-socket none --tls-certificate %s --tls-key %s",
             certificate, key);
    snprintf(by_http, sizeof by_http, "--http 127.0.0.1:0 --http-port-file %s --control-socket none",
             http_port);
    struct way way[] = {
        {.name = "TCP",
         .arguments = "--http none --control-socket none",
         .visit = visit_as_client,
         .host = "127.0.0.1"},
        {.name = "Unix socket", .arguments = by_socket, .visit = visit_as_client},
        {.name = "TLS",
         .arguments = by_tls,
         .visit = visit_as_client,
         .host = "127.0.0.1",
         .access.tls = {.wanted = true, .trusts_all = true}},
        {.name = "HTTP", .arguments = by_http, .port_file = http_port, .visit = visit_as_browser},
        {.name = "WebSocket", .arguments = by_http, .port_file = http_port, .visit = visit_by_web_socket}};
    snprintf(way[1].host, sizeof way[1].host, LW_ACCESS_UNIX "%s", socket_path);
    for (size_t i = 0; i < sizeof way / sizeof *way; i++)
        each_allocation_of_a_connection_may_fail(&way[i],
                                                 way[i].access.tls.wanted && !faults_case_is_long ? 31 : 1);
}

int main(int argc, char **argv) {
    faults_case_is_long = argc > 1;
    if (argc > 2) cmocka_set_test_filter(argv[2]);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(an_import_without_memory_is_a_line, faults_case_kill_all),
        cmocka_unit_test_teardown(a_solve_without_memory_is_a_line, faults_case_kill_all),
        cmocka_unit_test_teardown(a_frame_without_memory_is_published_later, faults_case_kill_all),
        cmocka_unit_test_teardown(sessions_without_memory_end_alone, faults_case_kill_all),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
