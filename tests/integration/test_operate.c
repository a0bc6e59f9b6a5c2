/* The real lightwelld and its operator: lightwellctl stats and drain, over the server's Unix socket alone. */
#include "tests/support/process.h"

#include "client/lib/client.h"
#include "common/base/clock.h"
#include "proto/message.h"

#include <jansson.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define LIMIT_S LW_PROCESS_LIMIT_S
#define SCENE   "builtin:cornell --texels-per-metre 8 --light whole --http none "

static struct lw_process server;
static char socket_path[200];

static int serve(void **state) {
    (void)state;
    char line[500];
    snprintf(socket_path, sizeof socket_path, "%s", lw_support_temporary("operate.sock"));
    snprintf(line, sizeof line, SCENE "--control-socket %s", socket_path);
    lw_process_serve(&server, line);
    return 0;
}

/* Runs lightwellctl to its end; returns what it printed, which the caller frees. */
static char *ctl(const char *arguments, int expected) {
    struct lw_process process;
    lw_process_start(&process, "lightwellctl", arguments);
    lw_process_expect(&process, lw_process_finish(&process, LIMIT_S), expected);
    return lw_process_out(&process);
}

static char *over_socket(const char *command, int expected) {
    char line[400];
    snprintf(line, sizeof line, "unix:%s %s", socket_path, command);
    return ctl(line, expected);
}

static void test_stats(void **state) {
    (void)state;
    char *text = over_socket("stats", 0);
    if (!strstr(text, "sessions   ") || !strstr(text, "CPU time   ")) fail_msg("%s", text);
    free(text);
    text = over_socket("stats --json", 0);
    json_error_t error;
    json_t *object = json_loads(text, 0, &error);
    if (!object) fail_msg("%s: %s", error.text, text);
    assert_true(json_is_number(json_object_get(object, "lightwell_sessions")));
    assert_true(json_is_number(json_object_get(object, "lightwell_rays_total{kind=\"bounce\"}")));
    assert_true(json_number_value(json_object_get(object, "lightwell_opened_sessions_total")) >= 2);
    json_decref(object);
    free(text);
}

/* On other ways than the socket the refusal names the socket. */
static void test_not_over_tcp(void **state) {
    (void)state;
    char line[100];
    snprintf(line, sizeof line, "127.0.0.1:%u stats", server.port);
    lw_process_refuses("lightwellctl", line, 77, "over its own Unix socket alone", LIMIT_S);
    snprintf(line, sizeof line, "127.0.0.1:%u drain", server.port);
    lw_process_refuses("lightwellctl", line, 77, "over its own Unix socket alone", LIMIT_S);
    assert_true(lw_process_runs(&server));
    lw_process_refuses("lightwellctl", "drain soon", 64, "in how many seconds", LIMIT_S);
    lw_process_refuses("lightwellctl", "list --watch", 64, "--watch is for stats", LIMIT_S);
}

static bool has_two_lines(void *context) {
    char *said = lw_process_out(context);
    const char *first = strchr(said, '\n');
    const bool two = first && strchr(first + 1, '\n');
    free(said);
    return two;
}

/* A line a second, until the server ends. */
static void test_watch(void **state) {
    (void)state;
    struct lw_process watch;
    char line[400], *said;
    snprintf(line, sizeof line, "unix:%s stats --watch", socket_path);
    lw_process_start(&watch, "lightwellctl", line);
    assert_true(lw_process_await(&watch, has_two_lines, &watch));
    said = lw_process_out(&watch);
    assert_memory_equal(said, "sessions ", 9);
    free(said);
    lw_process_expect(&server, lw_process_stop(&server, SIGTERM, LIMIT_S), 0);
    assert_int_not_equal(lw_process_finish(&watch, LIMIT_S), 0);
}

/* A client hears to come back after as long as the operator says; the server ends with 0. */
static void test_drain(void **state) {
    (void)state;
    struct lw_client *client;
    struct lw_error err = {0};
    lw_support_ok(
        lw_client_create(&(struct lw_client_desc){.host = "127.0.0.1", .port = server.port}, &client, &err),
        &err);
    char *text = over_socket("drain 77.5", 0);
    if (!strstr(text, "drained")) fail_msg("%s", text);
    free(text);
    enum lw_status status = LW_OK;
    for (uint64_t end_ns = lw_clock_ns() + LIMIT_S * 1000000000ull; status == LW_OK;) {
        assert_true(lw_clock_ns() < end_ns);
        status = lw_client_poll(client, 50, &err);
    }
    assert_int_equal(status, LW_CLOSED);
    assert_int_equal(lw_client_retry_after_ms(client), 77500);
    lw_client_destroy(client);
    lw_process_expect(&server, lw_process_finish(&server, LIMIT_S), 0);
}

/* A session over TCP that asks all the same is refused; others stay. */
static void test_ask_over_tcp(void **state) {
    (void)state;
    struct lw_client *client;
    struct lw_error err = {0};
    lw_support_ok(
        lw_client_create(&(struct lw_client_desc){.host = "127.0.0.1", .port = server.port, .operate = true},
                         &client, &err),
        &err);
    assert_false(lw_client_may_ask(client));
    lw_support_fails(lw_client_ask(client, LW_ASK_DRAIN, 0, &err), LW_NOT_ALLOWED, &err, "Unix socket");
    lw_client_destroy(client);
    assert_true(lw_process_runs(&server));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_stats, serve, lw_process_teardown),
        cmocka_unit_test_setup_teardown(test_not_over_tcp, serve, lw_process_teardown),
        cmocka_unit_test_setup_teardown(test_watch, serve, lw_process_teardown),
        cmocka_unit_test_setup_teardown(test_drain, serve, lw_process_teardown),
        cmocka_unit_test_setup_teardown(test_ask_over_tcp, serve, lw_process_teardown),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
