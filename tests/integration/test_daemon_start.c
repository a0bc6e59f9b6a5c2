/* How the real lightwelld starts and ends: signals, ports, and the lines of its refusals. */
#include "tests/integration/daemon_case.h"
#include "tests/support/client_light.h"

#include "common/base/clock.h"
#include "common/base/log.h"
#include "common/base/sanitizer.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#define SIGNALS 24 /* at as many moments of a start */

/* ---- the end ---- */

static void stops_at(int signal_number, bool with_client, bool with_deaf_peer) {
    struct lw_process daemon;
    lw_process_serve(&daemon, NEVER_RESTS);
    if (with_client) daemon_case_wait_complete(daemon_case_join(&daemon));
    int deaf = with_deaf_peer ? daemon_case_connect_stranger(&daemon) : -1;
    const uint64_t deadline_ns = daemon_case_limit_ns();
    kill(daemon.pid, signal_number);
    while (with_client && daemon_case_poll_all() > 0) assert_true(lw_clock_ns() < deadline_ns);
    /* the server waits a second for a client that does not take the goodbye */
    assert_int_equal(lw_process_finish(&daemon, LIMIT_S), 0);
    assert_int_equal(access(daemon.port_file, F_OK), -1);
    lw_process_left_nothing();
    if (deaf >= 0) close(deaf);
    daemon_case_end_all(NULL);
}

static void signals_stop_it_cleanly(void **state) {
    (void)state;
    stops_at(SIGTERM, true, false);
    stops_at(SIGINT, true, false);
    stops_at(SIGTERM, false, false);
    stops_at(SIGINT, true, true);
}

static void a_signal_ends_a_long_frame(void **state) {
    (void)state;
    struct lw_process daemon;
    /* a frame of minutes; it is left between tiles, so these must not be too slow either */
    lw_process_serve(&daemon, NEVER_RESTS "--texels-per-metre 48 --threads 2 --indirect-samples 1024 "
                                          "--log-level debug --direct-samples 1024");
    lw_process_await_text(&daemon, "for the solve"); /* said before the first frame begins */
    lw_process_end(&daemon);
    char *out = lw_process_out(&daemon);
    assert_string_equal(out, ""); /* the first frame was not done */
    free(out);
}

/* ThreadSanitizer's runtime puts signals off, and of those that come while a process is being spawned it
 * loses one in a thousand: the handler is never called. It also leaves $TMPDIR/tsan.rodata.PID where it is
 * killed as it starts. Nothing here runs in two threads yet. */
static void skip_where_signals_are_lost(void) {
    if (LW_SANITIZER) skip();
}

struct importer {
    pid_t parent, pid;
    bool must_be_itself; /* not the fork before it became the program */
};

static bool importer_is_there(void *context) {
    struct importer *importer = context;
    char path[64], name[32] = "";
    if (!importer->pid) importer->pid = lw_process_child_of(importer->parent);
    if (!importer->pid || !importer->must_be_itself) return importer->pid != 0;
    snprintf(path, sizeof path, "/proc/%d/comm", (int)importer->pid);
    FILE *file = fopen(path, "re");
    if (!file || fscanf(file, "%31s", name) != 1) name[0] = '\0';
    if (file) fclose(file);
    return strncmp(name, "lightwell-impor", 15) == 0;
}

static void signals_stop_an_import(void **state) {
    (void)state;
    skip_where_signals_are_lost();
    const int signals[] = {SIGTERM, SIGINT};
    for (int i = 0; i < 2; i++) {
        struct lw_process daemon;
        char arguments[256], *port_file = strdup(lw_support_temporary("never"));
        snprintf(arguments, sizeof arguments, "builtin:atrium-matt --listen 127.0.0.1:0 --port-file %s",
                 port_file);
        lw_process_start(&daemon, "lightwelld", arguments);
        struct importer importer = {.parent = daemon.pid, .must_be_itself = i == 0};
        assert_true(lw_process_await(&daemon, importer_is_there, &importer));
        assert_int_equal(lw_process_stop(&daemon, signals[i], LIMIT_S), 0);
        assert_true(kill(importer.pid, 0) == -1 && errno == ESRCH);
        lw_process_left_nothing();
        assert_int_equal(access(port_file, F_OK), -1);
        free(port_file);
    }
}

/* A start that gets SIGTERM at its Nth allocation; 0: at none. Returns its exit code, or minus the signal.
 * The number of allocations goes to *out_allocations. */
static int start_with_signal_at(long n, long *out_allocations) {
    struct lw_process daemon;
    char arguments[256], number[32], shim[512], *port_file = strdup(lw_support_temporary("any"));
    lw_process_find(shim, sizeof shim, "libfault_shim.so");
    setenv("LD_PRELOAD", shim, 1);
    setenv("FAULT_PROGRAM", "lightwelld", 1);
    setenv("FAULT_COUNT", "1", 1);
    snprintf(number, sizeof number, "%ld", n);
    setenv("FAULT_SIGNAL", number, 1);
    snprintf(arguments, sizeof arguments, CONVERGES "--listen 127.0.0.1:0 --frames 2 --port-file %s",
             port_file);
    lw_process_start(&daemon, "lightwelld", arguments);
    unsetenv("LD_PRELOAD");
    const int code = lw_process_finish(&daemon, LIMIT_S);
    char *err = lw_process_err(&daemon), *count = strstr(err, "fault_shim: ");
    if (code != 0 && code != -SIGTERM) fail_msg("allocation %ld: ends with %d: %s", n, code, err);
    if (code != 0 && *err) fail_msg("allocation %ld: ended by the signal after \"%s\"", n, err);
    if (count) assert_int_equal(sscanf(count, "fault_shim: %ld", out_allocations), 1);
    free(err);
    lw_process_left_nothing();
    assert_int_equal(access(port_file, F_OK), -1);
    free(port_file);
    return code;
}

/* At whatever moment of the start: no importer, no folder, no port file stays; and once
 * it watches, it ends with 0. */
static void a_signal_at_any_moment_leaves_nothing(void **state) {
    (void)state;
    skip_where_signals_are_lost();
    long allocations = 0, watches_from = 0, ignored;
    assert_int_equal(start_with_signal_at(0, &allocations), 0);
    assert_true(allocations > SIGNALS);
    for (long i = 0; i < SIGNALS; i++) {
        const long n =
            1 + i * i * (allocations - 1) / ((SIGNALS - 1) * (SIGNALS - 1)); /* the start in more detail */
        const int code = start_with_signal_at(n, &ignored);
        if (code == 0 && !watches_from) watches_from = n;
        if (code != 0 && watches_from)
            fail_msg("it watches from allocation %ld on, but not at %ld", watches_from, n);
    }
    assert_true(watches_from > 1 && watches_from < allocations / 2);
}

static void restarts_on_its_port(void **state) {
    (void)state;
    struct lw_process daemon;
    char arguments[256];
    lw_process_serve(&daemon, CONVERGES);
    daemon_case_wait_complete(daemon_case_join(&daemon));
    uint16_t port = daemon.port;
    snprintf(arguments, sizeof arguments, CONVERGES "--listen 127.0.0.1:%u", port);
    for (int i = 0; i < 3; i++) {
        daemon_case_stop(&daemon);
        lw_process_serve(&daemon, arguments);
        assert_int_equal(daemon.port, port);
        daemon_case_wait_complete(daemon_case_join(&daemon));
    }
    daemon_case_stop(&daemon);
}

/* ---- bad input ---- */

/* It must end with `code` and, last on stderr, one line that says both. */
static void fails(const char *arguments, int code, const char *said, const char *said_too) {
    struct lw_process daemon;
    lw_process_start(&daemon, "lightwelld", arguments);
    int got = lw_process_finish(&daemon, LIMIT_S);
    char *err = lw_process_err(&daemon), *out = lw_process_out(&daemon);
    char *line = strstr(err, "lightwelld: error: ");
    if (got != code || !line || !strstr(line, said) || !strstr(line, said_too))
        fail_msg("\"%s\" ended with %d: %s", arguments, got, err);
    assert_string_equal(strchr(line, '\n'), "\n");
    assert_string_equal(out, "");
    lw_process_left_nothing();
    free(out);
    free(err);
}

static void a_port_in_use_is_named(void **state) {
    (void)state;
    struct lw_process daemon;
    char arguments[256], address[32];
    lw_process_serve(&daemon, CONVERGES);
    snprintf(address, sizeof address, "127.0.0.1:%u", daemon.port);
    snprintf(arguments, sizeof arguments, CONVERGES "--listen %s", address);
    fails(arguments, 69, address, "--listen");
    daemon_case_wait_complete(daemon_case_join(&daemon)); /* the first one does not mind */
    daemon_case_stop(&daemon);
}

/* Who starts the daemon may wait for its port at a pipe. */
static void a_port_file_may_be_a_pipe(void **state) {
    (void)state;
    struct lw_process daemon;
    char arguments[256], text[16] = "", *path = strdup(lw_support_temporary("pipe"));
    assert_int_equal(mkfifo(path, 0600), 0);
    int reader = open(path, O_RDWR | O_CLOEXEC);
    assert_true(reader >= 0);
    snprintf(arguments, sizeof arguments, CONVERGES "--listen 127.0.0.1:0 --port-file %s", path);
    lw_process_start(&daemon, "lightwelld", arguments);
    struct pollfd said = {.fd = reader, .events = POLLIN};
    assert_int_equal(poll(&said, 1, LIMIT_S * 1000), 1);
    assert_true(read(reader, text, sizeof text - 1) > 1);
    assert_true(atoi(text) > 0 && text[strlen(text) - 1] == '\n');
    lw_process_end(&daemon);
    assert_int_equal(access(path, F_OK), 0);
    unlink(path);
    close(reader);
    free(path);
}

static void bad_options_are_named(void **state) {
    (void)state;
    static const struct {
        const char *options, *said;
    } bad[] = {
        {"--bounces -1", "--bounces"},
        {"--bounces 1000000", "--bounces"},
        {"--bounces two", "--bounces"},
        {"--tracing-range 0", "--tracing-range"},
        {"--cell-size nan", "--cell-size"},
        {"--texels-per-metre -3", "--texels-per-metre"},
        {"--atlas-max 1", "--atlas-max"},
        {"--direct-samples 0", "--direct-samples"},
        {"--indirect-samples 0", "--indirect-samples"},
        {"--frame-rate 0", "--frame-rate"},
        {"--clock wall", "--clock"},
        {"--light some", "--light"},
        {"--threads 0", "--threads"},
        {"--seed -1", "--seed"},
        {"--freeze -1", "--freeze"},
        {"--sky 1,1", "--sky"},
        {"--sun-angle 91", "--sun-angle"},
        {"--error 2", "--error"},
        {"--frames 0", "--frames"},
        {"--listen ::1", "--listen"},
        {"--listen 127.0.0.1:65536", "--listen"},
        {"--animate --freeze 1", "--freeze"},
        {"--no-such-option", "--no-such-option"},
        {"--bounces", "--bounces"},
        {"a-second-scene", "a-second-scene"},
    };
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        char arguments[256];
        snprintf(arguments, sizeof arguments, "builtin:cornell %s", bad[i].options);
        fails(arguments, 64, bad[i].said, "");
    }
    fails("", 64, "SCENE", "");
}

static void bad_scenes_and_files_are_named(void **state) {
    (void)state;
    char arguments[512];
    fails("builtin:nothing", 66, "builtin:nothing", "builtin:cornell");
    fails("builtin:city:0", 64, "builtin:city:0", "from 1 to 32");
    fails("/nowhere/scene.glb", 66, "/nowhere/scene.glb", "");
    fails("/nowhere/scene.lwscene", 66, "/nowhere/scene.lwscene", "");
    const char *path = lw_support_temporary("broken.gltf");
    FILE *file = fopen(path, "w");
    assert_true(file && fputs("{\"asset\":{\"version\":\"2.0\"},", file) > 0 && fclose(file) == 0);
    fails(path, 65, path, "");
    fails(CONVERGES "--listen 127.0.0.1:0 --port-file /nowhere/port", 73, "--port-file", "/nowhere/port");
    fails(CONVERGES "--listen no-such-host.invalid:7780", 68, "no-such-host.invalid", "");
    snprintf(arguments, sizeof arguments, CONVERGES "--listen 127.0.0.1:0 --port-file %s",
             lw_support_temporary("tmp"));
    fails(arguments, 73, "--port-file", "is a folder");
}

/* A triangle, 2 m to either side, and no light. */
static const char unlit[] =
    "{\"asset\":{\"version\":\"2.0\"},\"scene\":0,\"scenes\":[{\"nodes\":[0]}],\"nodes\":[{\"mesh\":0}],"
    "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0}}]}],"
    "\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":3,\"type\":\"VEC3\",\"min\":[0,0,0],"
    "\"max\":[2,2,0]}],\"bufferViews\":[{\"buffer\":0,\"byteLength\":36}],\"buffers\":[{\"byteLength\":36,"
    "\"uri\":\"data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAAAAQAAAAAAAAAAAAAAAAAAAAEAAAAAA\"}]}";

static void a_scene_without_light_asks_for_a_sky(void **state) {
    (void)state;
    struct lw_process daemon;
    char arguments[1024];
    const char *path = lw_support_temporary("unlit.gltf");
    lw_support_write_file(path, unlit, sizeof unlit - 1);
    fails(path, 65, path, "--sky");
    snprintf(arguments, sizeof arguments, "%s --texels-per-metre 4 --clock step --error 0.5 --sky 1,1,1",
             path);
    lw_process_serve(&daemon, arguments);
    struct lw_client *client = daemon_case_join(&daemon);
    daemon_case_wait_complete(client);
    assert_true(daemon_case_stats_of(client).sky[1] == 1 && client_light_total(client) > 0);
    daemon_case_stop(&daemon);
}

static void make_package(const char *path) {
    struct lw_process importer;
    char arguments[512];
    snprintf(arguments, sizeof arguments, "builtin:cornell --texels-per-metre 8 -o %s", path);
    lw_process_start(&importer, "lightwell-import", arguments);
    assert_int_equal(lw_process_finish(&importer, LIMIT_S), 0);
}

/* A flipped bit is refused or, in a number that may be anything, lit: never worse. */
static void damaged_packages_are_refused(void **state) {
    (void)state;
    char path[128], arguments[512];
    size_t size;
    snprintf(path, sizeof path, "%s", lw_support_temporary("damaged.lwscene"));
    make_package(path);
    uint8_t *bytes = lw_support_read_file(path, &size);
    snprintf(arguments, sizeof arguments, "%s --listen 127.0.0.1:0 --clock step --frames 2", path);
    for (size_t i = 0; i < 12; i += 4) { /* magic and version */
        bytes[i] ^= 0x10;
        lw_support_write_file(path, bytes, size);
        fails(arguments, 65, path, "");
        bytes[i] ^= 0x10;
    }
    unsigned refused = 0;
    for (size_t i = 12; i < size; i += size / 64) {
        struct lw_process daemon;
        bytes[i] ^= 0x40;
        lw_support_write_file(path, bytes, size);
        lw_process_start(&daemon, "lightwelld", arguments);
        int code = lw_process_finish(&daemon, LIMIT_S);
        if (code != 0 && code != 65)
            fail_msg("byte %zu flipped: ended with %d: %s", i, code, lw_process_err(&daemon));
        refused += code == 65;
        bytes[i] ^= 0x40;
    }
    assert_true(refused > 5);
    lw_support_write_file(path, bytes, size - 1);
    fails(arguments, 65, path, "");
    free(bytes);
}

int main(void) {
    lw_log_init("test_daemon_start", LW_LOG_WARNING);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(signals_stop_it_cleanly, daemon_case_end_all),
        cmocka_unit_test_teardown(a_signal_ends_a_long_frame, daemon_case_end_all),
        cmocka_unit_test_teardown(signals_stop_an_import, daemon_case_end_all),
        cmocka_unit_test_teardown(a_signal_at_any_moment_leaves_nothing, daemon_case_end_all),
        cmocka_unit_test_teardown(restarts_on_its_port, daemon_case_end_all),
        cmocka_unit_test_teardown(a_port_in_use_is_named, daemon_case_end_all),
        cmocka_unit_test_teardown(a_port_file_may_be_a_pipe, daemon_case_end_all),
        cmocka_unit_test_teardown(bad_options_are_named, daemon_case_end_all),
        cmocka_unit_test_teardown(bad_scenes_and_files_are_named, daemon_case_end_all),
        cmocka_unit_test_teardown(a_scene_without_light_asks_for_a_sky, daemon_case_end_all),
        cmocka_unit_test_teardown(damaged_packages_are_refused, daemon_case_end_all),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
