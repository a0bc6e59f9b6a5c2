/* Faults, and what the documents promise of each: the real programs, killed, stopped, cut off, without
 * memory, disk or the right time. docs/lab/reliability.md has them as a table. */
#include "tests/support/certificate.h"
#include "tests/support/net_space.h"
#include "tests/support/process.h"
#include "tests/support/web_peer.h"

#include "client/lib/client.h"
#include "common/base/clock.h"
#include "common/base/sanitizer.h"
#include "proto/message.h"

#include <arpa/inet.h>
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <netinet/in.h>
#include <poll.h>
#include <sched.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#define LIMIT_S LW_PROCESS_LIMIT_S
#define TARGET  0.3f
#define CORNELL                                                                                              \
    "builtin:cornell --texels-per-metre 8 --clock step --json --light whole --error 0.3 --frame-rate 200 "

static bool is_long;
static uint64_t dice = 88172645463325252u; /* fixed: a run can be repeated */

static unsigned random_below(unsigned limit) {
    dice ^= dice << 13, dice ^= dice >> 7, dice ^= dice << 17;
    return (unsigned)(dice % limit);
}

static int kill_all(void **state) {
    (void)state;
    const char *const faults[] = {"LD_PRELOAD",       "FAULT_PROGRAM", "FAULT_ALLOCATION",
                                  "FAULT_CONNECTION", "FAULT_WRITE",   "FAULT_ERRNO",
                                  "FAULT_CLOCK",      "FAULT_COUNT",   "FAULT_KILL"};
    for (size_t i = 0; i < sizeof faults / sizeof *faults; i++) unsetenv(faults[i]);
    lw_process_kill_all();
    return 0;
}

/* ---- this process's own clock ---- */

static uint64_t ahead_ns;

int __real_clock_gettime(clockid_t clock, struct timespec *out);
int __wrap_clock_gettime(clockid_t clock, struct timespec *out);
int __wrap_clock_gettime(clockid_t clock, struct timespec *out) {
    const int result = __real_clock_gettime(clock, out);
    if (result == 0 && clock == CLOCK_MONOTONIC) {
        const uint64_t ns = (uint64_t)out->tv_nsec + ahead_ns;
        out->tv_sec += (time_t)(ns / 1000000000u);
        out->tv_nsec = (long)(ns % 1000000000u);
    }
    return result;
}

/* ---- looking at a process ---- */

static long resident_kb(pid_t pid) {
    char path[64], line[256];
    long kb = -1;
    snprintf(path, sizeof path, "/proc/%d/status", (int)pid);
    FILE *file = fopen(path, "re");
    while (file && fgets(line, sizeof line, file)) (void)!sscanf(line, "VmRSS: %ld", &kb);
    if (file) fclose(file);
    return kb;
}

static unsigned descriptors_of(pid_t pid) {
    char path[64];
    unsigned count = 0;
    snprintf(path, sizeof path, "/proc/%d/fd", (int)pid);
    DIR *folder = opendir(path);
    while (folder && readdir(folder)) count++;
    if (folder) closedir(folder);
    return count;
}

struct descriptors {
    pid_t pid;
    unsigned most;
};

static bool has_descriptors(void *context) {
    const struct descriptors *of = context;
    return descriptors_of(of->pid) <= of->most;
}

static void wait_for_descriptors(pid_t pid, unsigned most) {
    struct lw_process process = {.pid = pid};
    if (!lw_process_await(&process, has_descriptors, &(struct descriptors){pid, most}))
        fail_msg("it has ended");
}

/* ---- clients ---- */

static struct lw_client *join(uint16_t port) {
    struct lw_client *client = NULL;
    struct lw_error err = {0};
    const struct lw_client_desc desc = {
        .host = "127.0.0.1", .port = port, .name = "test_faults", .timeout_ms = LIMIT_S * 1000};
    lw_support_ok(lw_client_create(&desc, &client, &err), &err);
    return client;
}

static bool is_at_rest(const struct lw_client *client) {
    const struct lw_atlas_map *map = lw_client_atlas_map(client);
    for (uint32_t t = 0; map && t < map->tile_count; t++) {
        const struct lw_client_tile tile = lw_client_get_tile(client, (lw_tile_id){t});
        if (!tile.version || tile.error > TARGET) return false;
    }
    return map != NULL;
}

/* The light of a scene at rest, all texels together. */
static double light_at(uint16_t port) {
    const uint64_t end_ns = lw_clock_ns() + LIMIT_S * 1000000000ull;
    struct lw_client *client = join(port);
    struct lw_error err = {0};
    double sum = 0;
    while (!is_at_rest(client)) {
        lw_support_ok(lw_client_poll(client, 10, &err), &err);
        if (lw_clock_ns() > end_ns) fail_msg("no light within %u s", LIMIT_S);
    }
    for (uint32_t o = 0; o < lw_client_atlas_map(client)->object_count; o++) {
        const struct lw_client_level level = lw_client_get_level(client, o, 0);
        for (uint32_t i = 0; i < 3 * level.width * level.height; i++) sum += (double)level.rgb[i];
    }
    lw_client_destroy(client);
    return sum;
}

static void still_serves(struct lw_process *daemon) {
    assert_true(lw_process_runs(daemon));
    assert_true(light_at(daemon->port) > 0);
}

/* Killed once it has taken in what came this often. */
static _Noreturn void be_a_killed_client(uint16_t port, unsigned polls) {
    struct lw_client *client = NULL;
    const struct lw_client_desc desc = {
        .host = "127.0.0.1", .port = port, .name = "to be killed", .timeout_ms = LIMIT_S * 1000};
    if (lw_client_create(&desc, &client, NULL) == LW_OK)
        while (polls-- && lw_client_poll(client, 5, NULL) == LW_OK) {
        }
    kill(getpid(), SIGKILL);
    _exit(0);
}

/* Promise (access.md): a session that is gone leaves nothing behind. */
static void killed_clients_leave_nothing(void **state) {
    (void)state;
    enum { AT_ONCE = 10 };
    const unsigned kills = is_long ? 1000 : 100;
    struct lw_process daemon;
    lw_process_serve(&daemon, CORNELL);
    (void)light_at(daemon.port);
    const unsigned before = descriptors_of(daemon.pid);
    long first_kb = 0;
    for (unsigned done = 0; done < kills; done += AT_ONCE) {
        pid_t client[AT_ONCE];
        for (int i = 0; i < AT_ONCE; i++) {
            client[i] = fork();
            assert_true(client[i] >= 0);
            if (client[i] == 0) be_a_killed_client(daemon.port, i ? random_below(12) : 0);
        }
        for (int i = 0; i < AT_ONCE; i++) {
            int status;
            assert_int_equal(waitpid(client[i], &status, 0), client[i]);
            assert_true(WIFSIGNALED(status));
        }
        if (done == kills / 10) first_kb = resident_kb(daemon.pid);
    }
    wait_for_descriptors(daemon.pid, before);
    const long grown_kb = resident_kb(daemon.pid) - first_kb;
    print_message("%u clients killed: %u descriptors as before, %+ld kB\n", kills, before, grown_kb);
    if (!LW_SANITIZER) assert_true(grown_kb < 4096);
    still_serves(&daemon);
    assert_int_equal(lw_process_stop(&daemon, SIGTERM, LIMIT_S), 0);
}

/* ---- the C library fails ---- */

static void shim(const char *program) {
    char path[512], *slash;
    const ssize_t length = readlink("/proc/self/exe", path, sizeof path - 32);
    assert_true(length > 0);
    path[length] = 0;
    slash = strrchr(path, '/');
    snprintf(slash + 1, 32, "libfault_shim.so");
    assert_int_equal(access(path, R_OK), 0);
    setenv("LD_PRELOAD", path, 1);
    setenv("FAULT_PROGRAM", program, 1);
}

static void set_number(const char *name, long number) {
    char text[32];
    snprintf(text, sizeof text, "%ld", number);
    setenv(name, text, 1);
}

/* What a whole run needs: allocations and writes. */
static void count_calls(const char *program, const char *arguments, int code, long *out_allocations,
                        long *out_writes) {
    struct lw_process process;
    shim(program);
    setenv("FAULT_COUNT", "1", 1);
    lw_process_start(&process, program, arguments);
    lw_process_expect(&process, lw_process_finish(&process, LIMIT_S), code);
    unsetenv("FAULT_COUNT");
    char *said = lw_process_err(&process), *counts = strstr(said, "fault_shim: ");
    assert_non_null(counts);
    assert_int_equal(sscanf(counts, "fault_shim: %ld %ld", out_allocations, out_writes), 2);
    free(said);
    assert_true(*out_allocations > 0);
}

/* One life of a server that keeps its light. Even: killed after some frames. Odd: at one of the writes of the
 * save at its end. */
static void be_killed(const char *arguments, unsigned life, long writes) {
    struct lw_process daemon;
    const bool saves = life % 2 && !LW_SANITIZER;
    shim("lightwelld");
    if (LW_SANITIZER) unsetenv("LD_PRELOAD");
    if (saves) set_number("FAULT_KILL", 1 + random_below((unsigned)writes));
    lw_process_serve(&daemon, arguments);
    unsetenv("LD_PRELOAD");
    unsetenv("FAULT_KILL");
    if (!saves) lw_process_await_frames(&daemon, random_below(20));
    const int ended = lw_process_stop(&daemon, saves ? SIGTERM : SIGKILL, LIMIT_S);
    assert_true(ended == -SIGKILL || (saves && ended == 0));
}

/* Promise (running.md, Light over a restart): a killed run leaves the light that was saved last. */
static void a_killed_server_leaves_whole_light_or_none(void **state) {
    (void)state;
    const unsigned kills = is_long ? 200 : 10;
    char arguments[512];
    struct lw_process daemon;
    unsigned shown = 0;
    long allocations, writes = 0;
    snprintf(arguments, sizeof arguments,
             CORNELL "--listen 127.0.0.1:0 --http none --control-socket none --frames 4 --keep %s",
             lw_support_temporary("counted"));
    if (!LW_SANITIZER) count_calls("lightwelld", arguments, 0, &allocations, &writes);
    unsetenv("LD_PRELOAD");
    snprintf(arguments, sizeof arguments, CORNELL "--keep %s", lw_support_temporary("killed"));
    lw_process_serve(&daemon, arguments);
    const double light = light_at(daemon.port);
    assert_int_equal(lw_process_stop(&daemon, SIGTERM, LIMIT_S), 0);
    for (unsigned i = 0; i < kills; i++) {
        be_killed(arguments, i, writes);
        lw_process_serve(&daemon, arguments);
        char *said = lw_process_err(&daemon);
        shown += strstr(said, "showing frame") != NULL;
        if (strstr(said, "damaged") || strstr(said, "error")) fail_msg("after kill %u: %s", i, said);
        free(said);
        const double now = light_at(daemon.port);
        if (fabs(now - light) > 0.02 * light) fail_msg("after kill %u: light %g, not %g", i, now, light);
        assert_int_equal(lw_process_stop(&daemon, SIGKILL, LIMIT_S), -SIGKILL);
    }
    print_message("%u kills: saved light was shown after %u\n", kills, shown);
    assert_true(shown > 0);
}

/* Promise: lack of memory ends a program with a line, or costs nothing; never a signal.
 * aborts  of libraries, which cannot be asked not to: libuv does where it has no memory for the handler of
 *         forks that it installs when the first loop begins */
static void each_allocation_may_fail(const char *program, const char *arguments, unsigned aborts) {
    long allocations, writes;
    unsigned ended = 0, went_on = 0, tries = 0;
    count_calls(program, arguments, 0, &allocations, &writes);
    const long step = is_long || allocations < 20 ? 1 : allocations / 20;
    for (long n = 1; n <= allocations; n += step, tries++) {
        struct lw_process process;
        set_number("FAULT_ALLOCATION", n);
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
    lw_process_start(&process, "lightwell-import", import);
    lw_process_expect(&process, lw_process_finish(&process, LIMIT_S), 0);
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
    const unsigned tries = is_long ? 400 : 6;
    unsigned refused = 0, ended = 0;
    shim("lightwelld");
    long allocations, writes;
    count_calls("lightwelld", CORNELL "--listen 127.0.0.1:0 --http none --threads 1 --frames 1", 0,
                &allocations, &writes);
    for (unsigned i = 0; i < tries; i++) {
        struct lw_process daemon;
        /* after what a start needs: that is the test above */
        set_number("FAULT_ALLOCATION", allocations + 1 + (is_long ? i : 31 * i));
        lw_process_serve(&daemon, CORNELL "--http none --threads 1");
        struct lw_client *client = NULL;
        struct lw_error err = {0};
        const struct lw_client_desc desc = {.host = "127.0.0.1", .port = daemon.port, .name = "test_faults"};
        enum lw_status status = lw_client_create(&desc, &client, &err);
        const uint64_t end_ns = lw_clock_ns() + LIMIT_S * 1000000000ull;
        while (status == LW_OK && !is_at_rest(client)) {
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
    shim("lightwelld");
    set_number("FAULT_CONNECTION", step);
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
        each_allocation_of_a_connection_may_fail(&way[i], way[i].access.tls.wanted && !is_long ? 31 : 1);
}

/* Promise (importing.md, running.md): a file is whole or not there, and the failure is a line with 74. */
static void each_write_may_fail(const char *program, const char *arguments, const char *output,
                                bool is_one_file) {
    static const int faults[] = {ENOSPC, EIO, 0};
    long allocations, writes;
    count_calls(program, arguments, 0, &allocations, &writes);
    assert_true(writes > 0);
    const long step = is_long || writes < 8 ? 1 : writes / 8;
    for (size_t f = 0; f < sizeof faults / sizeof *faults; f++)
        for (long n = 1; n <= writes; n += step) {
            struct lw_process process;
            (void)unlink(output);
            set_number("FAULT_WRITE", n);
            set_number("FAULT_ERRNO", faults[f]);
            lw_process_start(&process, program, arguments);
            const int code = lw_process_finish(&process, LIMIT_S);
            char *said = lw_process_err(&process);
            if (faults[f] && (code <= 0 || !strstr(said, strerror(faults[f]))))
                fail_msg("%s, write %ld of %ld, %s: ends with %d: %s", program, n, writes,
                         strerror(faults[f]), code, said);
            if (!faults[f] && code) fail_msg("%s, short writes from %ld on: %d: %s", program, n, code, said);
            if (is_one_file) assert_int_equal(access(output, F_OK) == 0, faults[f] == 0);
            free(said);
        }
    print_message("%s: %ld writes, each with ENOSPC, EIO and cut short\n", program, writes);
    unsetenv("FAULT_WRITE");
}

static void a_full_disk_leaves_no_half_package(void **state) {
    (void)state;
    if (LW_SANITIZER) skip();
    char arguments[512], output[256];
    snprintf(output, sizeof output, "%s", lw_support_temporary("full.lwscene"));
    snprintf(arguments, sizeof arguments, "builtin:cornell -o %s --threads 1 --texels-per-metre 2", output);
    each_write_may_fail("lightwell-import", arguments, output, true);
}

/* A failed save is reported at the end. There are two files: either may be whole. */
static void a_full_disk_leaves_no_half_light(void **state) {
    (void)state;
    if (LW_SANITIZER) skip();
    char arguments[512], output[256];
    snprintf(output, sizeof output, "%s", lw_support_temporary("full_keep/shown"));
    snprintf(
        arguments, sizeof arguments,
        CORNELL
        "--listen 127.0.0.1:0 --http none --control-socket none --texels-per-metre 2 --frames 2 --keep %s",
        lw_support_temporary("full_keep"));
    each_write_may_fail("lightwelld", arguments, output, false);
}

static void a_full_disk_leaves_no_half_bake(void **state) {
    (void)state;
    if (LW_SANITIZER) skip();
    char arguments[512], output[256];
    snprintf(output, sizeof output, "%s", lw_support_temporary("full_bake/index.json"));
    snprintf(arguments, sizeof arguments, "builtin:cornell -o %s --texels-per-metre 1 --samples 1",
             lw_support_temporary("full_bake"));
    each_write_may_fail("lightwell-bake", arguments, output, true);
}

/* Its files in a folder; with half ones, which have names of their own. */
static unsigned files_in(const char *path) {
    unsigned count = 0;
    DIR *folder = opendir(path);
    for (const struct dirent *entry; folder && (entry = readdir(folder));) count += entry->d_name[0] != '.';
    if (folder) closedir(folder);
    return count;
}

static void empty(const char *path) {
    char command[600];
    snprintf(command, sizeof command, "rm -rf '%s'", path);
    assert_int_equal(system(command), 0);
}

/* Promise (client.h): a package that cannot be kept is reported in one line, and the command does its work;
 * all files in the folder are whole. */
static void a_full_disk_leaves_no_half_cache(void **state) {
    (void)state;
    if (LW_SANITIZER) skip();
    static const int faults[] = {ENOSPC, EIO, 0};
    char arguments[600], folder[300];
    struct lw_process daemon, ctl;
    long allocations, writes;
    snprintf(arguments, sizeof arguments, "%s --texels-per-metre 4 --freeze 0 --http none --threads 1",
             lw_support_source("tests/support/moving.gltf"));
    lw_process_serve(&daemon, arguments); /* it has textures, which are parts of their own */
    snprintf(folder, sizeof folder, "%s", lw_support_temporary("full_cache"));
    snprintf(arguments, sizeof arguments, "127.0.0.1:%u list --cache %s", daemon.port, folder);
    count_calls("lightwellctl", arguments, 0, &allocations, &writes);
    const unsigned whole = files_in(folder);
    assert_true(writes > 0 && whole > 0);
    const long step = is_long || writes < 3 ? 1 : writes / 3;
    for (size_t f = 0; f < sizeof faults / sizeof *faults; f++)
        for (long n = faults[f] ? 1 : writes; n <= writes; n += step) { /* a byte at a time takes long */
            empty(folder);
            set_number("FAULT_WRITE", n);
            set_number("FAULT_ERRNO", faults[f]);
            lw_process_start(&ctl, "lightwellctl", arguments);
            lw_process_expect(&ctl, lw_process_finish(&ctl, LIMIT_S), 0);
            char *said = lw_process_err(&ctl), *line = strstr(said, "is not kept");
            if ((line != NULL) != (faults[f] != 0)) fail_msg("write %ld of %ld: %s", n, writes, said);
            if (line && (!strstr(line, folder) || !strstr(line, strerror(faults[f])) ||
                         strstr(line + 1, "is not kept")))
                fail_msg("write %ld of %ld: %s", n, writes, said);
            free(said);
            const unsigned kept = files_in(folder);
            if (faults[f] ? kept >= whole : kept != whole)
                fail_msg("write %ld: %u of %u files", n, kept, whole);
            unsetenv("FAULT_WRITE"); /* the file is taken for whole: it must be */
            lw_process_start(&ctl, "lightwellctl", arguments);
            lw_process_expect(&ctl, lw_process_finish(&ctl, LIMIT_S), 0);
            said = lw_process_err(&ctl);
            if (*said) fail_msg("after write %ld: %s", n, said);
            free(said);
            assert_int_equal(files_in(folder), whole);
        }
    print_message("lightwellctl: %ld writes of the cache, each with ENOSPC and EIO, one cut short\n", writes);
}

static void a_full_disk_leaves_no_half_picture(void **state) {
    (void)state;
    if (LW_SANITIZER) skip();
    char arguments[512], output[256];
    snprintf(output, sizeof output, "%s", lw_support_temporary("full.png"));
    snprintf(arguments, sizeof arguments,
             "--path-trace builtin:cornell --size 16x16 --spp 4 --out %s --threads 1", output);
    each_write_may_fail("lightwell-view", arguments, output, true);
}

/* ---- time ---- */

/* Promise: sessions, frames and deadlines go by a clock that nobody sets. */
static void a_jump_of_the_clock_is_not_felt(void **state) {
    (void)state;
    if (LW_SANITIZER) skip();
    static const long jumps_s[] = {86400 * 365, -86400 * 365};
    for (size_t i = 0; i < sizeof jumps_s / sizeof *jumps_s; i++) {
        struct lw_process daemon;
        shim("lightwelld");
        set_number("FAULT_CLOCK", jumps_s[i]);
        lw_process_serve(&daemon, CORNELL);
        unsetenv("LD_PRELOAD");
        struct lw_client *client = join(daemon.port);
        struct lw_error err = {0};
        /* the jump was at its connection */
        for (const double frame = lw_process_newest(&daemon, "frame");
             lw_process_newest(&daemon, "frame") < frame + 50;)
            lw_support_ok(lw_client_poll(client, 50, &err), &err);
        still_serves(&daemon);
        lw_client_destroy(client);
        assert_int_equal(lw_process_stop(&daemon, SIGTERM, LIMIT_S), 0);
    }
}

/* Promise (wire_format.md, section 3): silence is an end after 60 s, not after 5. The client's clock goes
 * ahead; in the long test both wait. */
static void a_stopped_server_goes_on(void **state) {
    (void)state;
    struct lw_process daemon;
    lw_process_serve(&daemon, CORNELL);
    struct lw_client *client = join(daemon.port);
    struct lw_error err = {0};
    assert_int_equal(kill(daemon.pid, SIGSTOP), 0);
    for (unsigned tenths = 0; tenths < 50; tenths++) {
        if (!is_long) ahead_ns += 100000000u;
        lw_support_ok(lw_client_poll(client, is_long ? 100 : 1, &err), &err);
    }
    assert_int_equal(kill(daemon.pid, SIGCONT), 0);
    while (!is_at_rest(client)) lw_support_ok(lw_client_poll(client, 100, &err), &err);
    lw_client_destroy(client);
    still_serves(&daemon);
    assert_int_equal(lw_process_stop(&daemon, SIGTERM, LIMIT_S), 0);
}

/* ---- readers ---- */

/* Promise: who reads a byte a second costs others nothing, and the server no more than a link holds. */
static void readers_of_a_byte_a_second_hold_nobody_up(void **state) {
    (void)state;
    enum { READERS = 20 };
    int reader[READERS];
    struct lw_process daemon;
    lw_process_serve(&daemon, CORNELL);
    (void)light_at(daemon.port);
    const unsigned before = descriptors_of(daemon.pid);
    const long before_kb = resident_kb(daemon.pid);
    for (int i = 0; i < READERS; i++) {
        const struct sockaddr_in to = {
            .sin_family = AF_INET, .sin_port = htons(daemon.port), .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
        const int small = 4096;
        reader[i] = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
        assert_int_equal(setsockopt(reader[i], SOL_SOCKET, SO_RCVBUF, &small, sizeof small), 0);
        assert_int_equal(connect(reader[i], (const struct sockaddr *)&to, sizeof to), 0);
    }
    for (unsigned second = 0; second < (is_long ? 30u : 3u); second++) {
        char byte;
        for (int i = 0; i < READERS; i++) (void)recv(reader[i], &byte, 1, MSG_DONTWAIT);
        if (is_long) lw_process_sleep_ms(1000);
        still_serves(&daemon); /* an honest client gets all of its light between two bytes */
    }
    if (!LW_SANITIZER) assert_true(resident_kb(daemon.pid) - before_kb < 32768);
    for (int i = 0; i < READERS; i++) close(reader[i]);
    wait_for_descriptors(daemon.pid, before);
    assert_int_equal(lw_process_stop(&daemon, SIGTERM, LIMIT_S), 0);
}

/* Both cores taken by others: first light and a stop all the same. */
static void a_saturated_machine_is_slow_not_broken(void **state) {
    (void)state;
    enum { BURNERS = 8 };
    pid_t burner[BURNERS];
    for (int i = 0; i < BURNERS; i++) {
        burner[i] = fork();
        assert_true(burner[i] >= 0);
        if (burner[i] == 0) {
            alarm(LIMIT_S);
            for (volatile unsigned n = 0;; n++) {
            }
        }
    }
    struct lw_process daemon;
    lw_process_serve(&daemon, CORNELL);
    still_serves(&daemon);
    assert_int_equal(lw_process_stop(&daemon, SIGTERM, LIMIT_S), 0);
    for (int i = 0; i < BURNERS; i++) {
        kill(burner[i], SIGKILL);
        assert_int_equal(waitpid(burner[i], NULL, 0), burner[i]);
    }
}

/* ---- links ---- */

static struct lw_net_space space; /* a cable goes to a client there */

static int remove_space(void **state) {
    lw_net_space_remove(&space);
    return kill_all(state);
}

/* In that namespace: a client that writes a byte for each frame, L where it lost the session, R where it has
 * it again. */
static _Noreturn void be_a_client_there(uint16_t port, int out) {
    struct lw_client *client = NULL;
    struct lw_client_stats stats;
    uint64_t frame = 0;
    const struct lw_client_desc desc = {
        .host = space.cable[0].here, .port = port, .name = "there", .timeout_ms = LIMIT_S * 1000};
    char path[64];
    snprintf(path, sizeof path, "/run/netns/%s", space.name);
    const int descriptor = open(path, O_RDONLY | O_CLOEXEC);
    if (descriptor < 0 || setns(descriptor, CLONE_NEWNET) != 0 || lw_client_create(&desc, &client, NULL))
        _exit(1);
    for (;;) {
        if (lw_client_poll(client, 100, NULL) != LW_OK) {
            (void)!write(out, "L", 1);
            for (unsigned i = 0; lw_client_reconnect(client, NULL) != LW_OK; i++)
                lw_process_sleep_ms(lw_client_backoff_ms(i, 1));
            (void)!write(out, "R", 1);
        }
        lw_client_get_stats(client, &stats);
        if (stats.frame != frame && write(out, "f", 1) != 1) _exit(0);
        frame = stats.frame;
    }
}

/* Takes in what the client has written, for so long or until it has said this. */
static bool hears(int in, char wanted, unsigned limit_ms, unsigned *losses) {
    const uint64_t end_ns = lw_clock_ns() + limit_ms * 1000000ull;
    while (lw_clock_ns() < end_ns) {
        struct pollfd ready = {.fd = in, .events = POLLIN};
        char byte;
        if (poll(&ready, 1, 50) != 1) continue;
        if (read(in, &byte, 1) != 1) return false;
        *losses += byte == 'L';
        if (byte == wanted) return true;
    }
    return false;
}

/* Promise (wire_format.md, section 3): no byte taken for 15 s, or nothing heard for 60, ends a session with
 * TIMEOUT; before that it goes on as before. Clients come back by themselves. */
static void a_link_that_was_down(void **state) {
    (void)state;
    static const unsigned down_s[] = {2, 30, 300};
    if (!lw_net_space_make(&space, 1)) skip();
    struct lw_process daemon;
    int ends[2];
    char arguments[256];
    snprintf(arguments, sizeof arguments,
             "builtin:cornell --texels-per-metre 4 --light whole --error 1e-6 --frame-rate 20 "
             "--listen %s:0 --insecure --http none --json",
             space.cable[0].here);
    lw_process_serve(&daemon, arguments);
    assert_int_equal(pipe2(ends, O_CLOEXEC), 0);
    const unsigned before = descriptors_of(daemon.pid);
    const pid_t client = fork();
    if (client == 0) be_a_client_there(daemon.port, ends[1]);
    close(ends[1]);
    for (size_t i = 0; i < (is_long ? 3u : 1u); i++) {
        unsigned losses = 0;
        assert_true(hears(ends[0], 'f', LIMIT_S * 1000, &losses));
        lw_net_space_plug(&space, 0, false);
        losses = 0;
        if (is_long)
            (void)hears(ends[0], 0, down_s[i] * 1000, &losses);
        else
            lw_process_await_frames(&daemon, 10);                     /* none gets through */
        if (down_s[i] > 60) wait_for_descriptors(daemon.pid, before); /* the server does not keep it */
        lw_net_space_plug(&space, 0, true);
        const uint64_t up_ns = lw_clock_ns();
        for (unsigned frames = 0; frames < 12; frames++) /* more than the link holds */
            assert_true(hears(ends[0], 'f', LIMIT_S * 1000, &losses));
        print_message("link down for %u s: %u sessions lost, 12 frames %.1f s after\n",
                      is_long ? down_s[i] : 0, losses, (double)(lw_clock_ns() - up_ns) * 1e-9);
        if (down_s[i] < 15) assert_int_equal(losses, 0);
    }
    /* half open: the peer is gone, and no packet says so */
    if (is_long) lw_net_space_plug(&space, 0, false);
    assert_int_equal(kill(client, SIGKILL), 0);
    assert_int_equal(waitpid(client, NULL, 0), client);
    const uint64_t gone_ns = lw_clock_ns();
    wait_for_descriptors(daemon.pid, before);
    if (is_long) print_message("half open: gone after %.0f s\n", (double)(lw_clock_ns() - gone_ns) * 1e-9);
    close(ends[0]);
    assert_int_equal(lw_process_stop(&daemon, SIGTERM, LIMIT_S), 0);
}

/* test_faults [long [PATTERN]]: all of each, which takes an hour, or of those tests alone; else samples. */
int main(int argc, char **argv) {
    is_long = argc > 1;
    if (argc > 2) cmocka_set_test_filter(argv[2]);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(killed_clients_leave_nothing, kill_all),
        cmocka_unit_test_teardown(a_killed_server_leaves_whole_light_or_none, kill_all),
        cmocka_unit_test_teardown(an_import_without_memory_is_a_line, kill_all),
        cmocka_unit_test_teardown(a_solve_without_memory_is_a_line, kill_all),
        cmocka_unit_test_teardown(a_frame_without_memory_is_published_later, kill_all),
        cmocka_unit_test_teardown(sessions_without_memory_end_alone, kill_all),
        cmocka_unit_test_teardown(a_full_disk_leaves_no_half_package, kill_all),
        cmocka_unit_test_teardown(a_full_disk_leaves_no_half_light, kill_all),
        cmocka_unit_test_teardown(a_full_disk_leaves_no_half_bake, kill_all),
        cmocka_unit_test_teardown(a_full_disk_leaves_no_half_cache, kill_all),
        cmocka_unit_test_teardown(a_full_disk_leaves_no_half_picture, kill_all),
        cmocka_unit_test_teardown(a_jump_of_the_clock_is_not_felt, kill_all),
        cmocka_unit_test_teardown(a_stopped_server_goes_on, kill_all),
        cmocka_unit_test_teardown(readers_of_a_byte_a_second_hold_nobody_up, kill_all),
        cmocka_unit_test_teardown(a_link_that_was_down, remove_space),
        cmocka_unit_test_teardown(a_saturated_machine_is_slow_not_broken, kill_all),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
