/* The real lightwelld as a monitoring system sees it: /metrics, /healthz, /readyz. */
#include "tests/support/process.h"
#include "tests/support/web_peer.h"

#include <ctype.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define LIMIT_S LW_PROCESS_LIMIT_S
#define SCENE   "builtin:cornell --texels-per-metre 8 --light whole --http none --metrics 127.0.0.1:0 "

static struct lw_process daemon_process;
static uint16_t page_port;

static void serve(const char *arguments) {
    char line[1024], text[16] = "";
    const char *port_file = lw_support_temporary("metrics-port");
    (void)unlink(port_file);
    snprintf(line, sizeof line, SCENE "--metrics-port-file %s %s", port_file, arguments);
    lw_process_serve(&daemon_process, line);
    FILE *file = fopen(port_file, "re"); /* it is written before the one that lw_process_serve() waits for */
    assert_non_null(file);
    assert_non_null(fgets(text, sizeof text, file));
    fclose(file);
    page_port = (uint16_t)atoi(text);
    assert_true(page_port > 0);
}

/* The status of the answer; its body in *out_body, which the caller frees, unless that is NULL. */
static unsigned ask_with(const char *method, const char *path, const char *host, char **out_body) {
    char request[1024];
    unsigned status = 0;
    snprintf(request, sizeof request, "%s %s HTTP/1.1\r\nHost: %s\r\n\r\n", method, path, host);
    const int s = lw_web_peer_dial(page_port);
    char *answer = lw_web_peer_ask(s, request, false, NULL);
    close(s);
    (void)sscanf(answer, "HTTP/1.%*u %u", &status);
    const char *body = strstr(answer, "\r\n\r\n");
    assert_non_null(body);
    if (out_body) *out_body = strdup(body + 4);
    free(answer);
    return status;
}

static unsigned ask(const char *path, char **out_body) {
    return ask_with("GET", path, "localhost", out_body);
}

/* The value of the sample that is called so, labels included. */
static double value_of(const char *text, const char *sample) {
    const size_t length = strlen(sample);
    for (const char *line = text; line; line = (line = strchr(line, '\n')) ? line + 1 : NULL)
        if (strncmp(line, sample, length) == 0 && line[length] == ' ') return atof(line + length);
    fail_msg("there is no %s in: %s", sample, text);
    return 0;
}

static double metric(const char *sample) {
    char *text;
    assert_int_equal(ask("/metrics", &text), 200);
    const double value = value_of(text, sample);
    free(text);
    return value;
}

static bool is_ready(void *context) {
    (void)context;
    return ask("/readyz", NULL) == 200;
}

static void await_ready(void) { assert_true(lw_process_await(&daemon_process, is_ready, NULL)); }

static bool has_looked_inside(void *context) {
    (void)context;
    return metric("lightwell_waiting_stage") == 2 && metric("lightwell_waiting_share") == 1;
}

/* Ready is who has light; alive is who has none yet, too. */
static void test_ready_with_light(void **state) {
    (void)state;
    int input[2];
    char *body;
    assert_int_equal(pipe2(input, O_CLOEXEC), 0);
    const int own_input = dup(STDIN_FILENO);
    assert_true(own_input >= 0);
    dup2(input[0], STDIN_FILENO);
    serve("--clock manual");
    dup2(own_input, STDIN_FILENO);
    close(own_input);
    close(input[0]);
    assert_int_equal(ask("/healthz", NULL), 200);
    assert_true(lw_process_await(&daemon_process, has_looked_inside, NULL)); /* and now it waits for us */
    assert_int_equal(ask("/readyz", &body), 503);
    assert_string_equal(body, "no light yet: looking inside objects, 100 %\n");
    free(body);
    assert_true(metric("lightwell_ready") == 0);
    assert_int_equal(write(input[1], "\n", 1), 1);
    await_ready();
    assert_true(metric("lightwell_ready") == 1);
    assert_true(metric("lightwell_first_light_seconds") > 0);
    assert_true(metric("lightwell_waiting_stage") == 4);
    assert_true(metric("lightwell_frame_duration_seconds_count") == 1);
    assert_true(metric("lightwell_frame") == 1);
    close(input[1]);
    assert_int_equal(lw_process_finish(&daemon_process, LIMIT_S), 0);
}

static bool is_unhealthy(void *context) {
    char *body;
    (void)context;
    const bool unhealthy = ask("/healthz", &body) == 503;
    if (unhealthy) assert_string_equal(body, "the solver makes no progress\n");
    free(body);
    return unhealthy;
}

static void test_a_hang_is_not_healthy(void **state) {
    (void)state;
    serve("--stall-limit 0.001 --texels-per-metre 100 --threads 1 --clock step --error 1e-6");
    assert_true(lw_process_await(&daemon_process, is_unhealthy, NULL));
}

static bool has_no_session(void *context) {
    (void)context;
    return metric("lightwell_sessions") == 0;
}

/* What clients get, and what that costs, is counted. */
static void test_clients_are_counted(void **state) {
    (void)state;
    struct lw_process load;
    char arguments[200], *before, *after;
    serve("--clock step --error 1e-6");
    await_ready();
    assert_int_equal(ask("/metrics", &before), 200);
    assert_true(value_of(before, "lightwell_opened_sessions_total") == 0);
    snprintf(arguments, sizeof arguments, "127.0.0.1:%u --users 3 --seconds 2", daemon_process.port);
    lw_process_run(&load, "lightwell-load", arguments, 0);
    assert_true(lw_process_await(&daemon_process, has_no_session, NULL));
    assert_int_equal(ask("/metrics", &after), 200);
    static const char *const grows[] = {"lightwell_sent_bytes_total",
                                        "lightwell_sent_tiles_total",
                                        "lightwell_encoded_bytes_total",
                                        "lightwell_rays_total{kind=\"bounce\"}",
                                        "lightwell_solved_texels_total",
                                        "lightwell_loop_lag_seconds_count",
                                        "lightwell_acknowledgement_duration_seconds_count",
                                        "lightwell_frame_duration_seconds_count",
                                        "lightwell_pass_duration_seconds_count{pass=\"scatter\"}",
                                        "lightwell_cpu_seconds_total{stage=\"solve\"}",
                                        "lightwell_cpu_seconds_total{stage=\"serve\"}",
                                        "process_cpu_seconds_total"};
    for (size_t i = 0; i < sizeof grows / sizeof *grows; i++)
        if (!(value_of(after, grows[i]) > value_of(before, grows[i]))) fail_msg("%s: %s", grows[i], after);
    /* one more asks for the scene package before the users come */
    const double opened = value_of(after, "lightwell_opened_sessions_total");
    assert_true(opened >= 3 && opened <= 4);
    /* three for two seconds and the ramp; ticks are a quarter of a second apart */
    const double session_s = value_of(after, "lightwell_session_seconds_total");
    if (session_s < 4 || session_s > 3 * LIMIT_S) fail_msg("%g s", session_s);
    free(before);
    free(after);
}

/* The names of all metrics, each with a line that explains it, and of all labels. */
static void test_names(void **state) {
    (void)state;
    static const char *const labels[] = {"version", "isa", "solver",   "pass",   "kind",
                                         "stage",   "le",  "renderer", "setting"};
    char *text, *document = lw_support_read_text(lw_support_source("docs"), "measuring.md");
    char line[400];
    snprintf(line, sizeof line, "--crossover-report %s",
             lw_support_source("docs/lab/crossover/atrium-sun-swing"));
    serve(line);
    await_ready();
    assert_int_equal(ask("/metrics", &text), 200);
    assert_true(value_of(text, "lightwell_renderer_frame_cpu_seconds{renderer=\"svgf\",setting=\"1 path\"}") >
                0.1);
    if (strstr(text, "renderer=\"cache\"")) fail_msg("the cache is no renderer for each user");
    unsigned metrics = 0;
    for (const char *at = text; (at = strstr(at, "# HELP ")); metrics++) {
        char name[100], quoted[110];
        assert_int_equal(sscanf(at += 7, "%99s", name), 1);
        snprintf(quoted, sizeof quoted, "`%s`", name);
        if (!strstr(document, quoted)) fail_msg("docs/measuring.md does not have %s", quoted);
    }
    assert_true(metrics > 30);
    for (const char *at = text; (at = strstr(at, "=\""));) {
        const char *begin = at;
        while (begin > text && isalpha((unsigned char)begin[-1])) begin--;
        bool known = false;
        for (size_t i = 0; i < sizeof labels / sizeof *labels; i++)
            known |=
                strlen(labels[i]) == (size_t)(at - begin) && !strncmp(begin, labels[i], (size_t)(at - begin));
        if (!known) fail_msg("label %.20s", begin);
        at += 2;
    }
    if (!strstr(text, "lightwell_build_info{version=\"")) fail_msg("%s", text);
    free(text);
    free(document);
}

/* A report that is none, or is not there, is named at the start. */
static void test_wrong_report(void **state) {
    (void)state;
    char line[600], folder[300];
    snprintf(folder, sizeof folder, "%s", lw_support_temporary("report"));
    (void)mkdir(folder, 0777);
    static const char *const wrong[][2] = {
        {"renderer,setting,frames\n", "curves.csv: line 1 is not"},
        {"renderer,setting,cpu_s,relmse\nsvgf,1 path,fast,0\n", "curves.csv: line 2 makes no sense"},
        {"renderer,setting,cpu_s,relmse\nsvgf\n", "curves.csv: line 2 makes no sense"},
        {"renderer,setting,cpu_s,relmse\ncache,x1,0.5,0\n", "curves.csv: has no renderer but the cache"}};
    snprintf(line, sizeof line, "builtin:cornell --crossover-report %s", folder);
    lw_process_refuses("lightwelld", line, 66, "curves.csv", LIMIT_S);
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        char path[400];
        snprintf(path, sizeof path, "%s/curves.csv", folder);
        lw_support_write_file(path, wrong[i][0], strlen(wrong[i][0]));
        lw_process_refuses("lightwelld", line, 65, wrong[i][1], LIMIT_S);
    }
}

static void test_promtool(void **state) {
    (void)state;
    char command[400], *text;
    if (system("promtool --version >/dev/null 2>&1") != 0) {
        print_message("skipped: there is no promtool (Debian package prometheus)\n");
        skip();
    }
    serve("");
    await_ready();
    assert_int_equal(ask("/metrics", &text), 200);
    const char *file = lw_support_temporary("metrics");
    lw_support_write_file(file, text, strlen(text));
    free(text);
    snprintf(command, sizeof command, "promtool check metrics <%s >&2", file);
    assert_int_equal(system(command), 0);
}

static void test_who_may_ask(void **state) {
    (void)state;
    serve("");
    assert_int_equal(ask("/", NULL), 404);
    assert_int_equal(ask("/metrics/", NULL), 404);
    assert_int_equal(ask("/ws", NULL), 404);
    assert_int_equal(ask_with("POST", "/metrics", "localhost", NULL), 405);
    assert_int_equal(ask_with("GET", "/metrics", "evil.example", NULL), 403);
    const int s = lw_web_peer_dial(page_port);
    assert_int_equal(
        lw_web_peer_upgrade(s, "/ws", "Host: localhost\r\nSec-WebSocket-Protocol: lightwell\r\n"), 404);
    close(s);
    lw_process_end(&daemon_process);
}

static void test_wrong_addresses(void **state) {
    (void)state;
    char arguments[200];
    lw_process_refuses("lightwelld", "builtin:cornell --listen 127.0.0.1:0 --http none --metrics 1:2:3", 64,
                       "--metrics: address \"1:2:3\"", LIMIT_S);
    serve("");
    snprintf(arguments, sizeof arguments, "builtin:cornell --listen 127.0.0.1:0 --http none --metrics %u",
             page_port);
    lw_process_refuses("lightwelld", arguments, 69, "choose another with --metrics", LIMIT_S);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(test_ready_with_light, lw_process_teardown),
        cmocka_unit_test_teardown(test_a_hang_is_not_healthy, lw_process_teardown),
        cmocka_unit_test_teardown(test_clients_are_counted, lw_process_teardown),
        cmocka_unit_test_teardown(test_names, lw_process_teardown),
        cmocka_unit_test_teardown(test_wrong_report, lw_process_teardown),
        cmocka_unit_test_teardown(test_promtool, lw_process_teardown),
        cmocka_unit_test_teardown(test_who_may_ask, lw_process_teardown),
        cmocka_unit_test_teardown(test_wrong_addresses, lw_process_teardown),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
