/* Faults, and what the documents promise of each: the real programs, killed, stopped, cut off, slowed, or
 * with a wrong clock. docs/lab/reliability.md has them as a table. */
#include "tests/integration/faults_case.h"
#include "tests/support/client_light.h"
#include "tests/support/net_space.h"

#include "client/lib/client.h"
#include "common/base/clock.h"
#include "common/base/sanitizer.h"

#include <arpa/inet.h>
#include <dirent.h>
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

static uint64_t dice = 88172645463325252u; /* fixed: a run can be repeated */

static unsigned random_below(unsigned limit) {
    dice ^= dice << 13, dice ^= dice >> 7, dice ^= dice << 17;
    return (unsigned)(dice % limit);
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

/* The light of a scene at rest, all texels together. */
static double light_at(uint16_t port) {
    const uint64_t end_ns = lw_clock_ns() + LIMIT_S * 1000000000ull;
    struct lw_client *client = join(port);
    struct lw_error err = {0};
    while (!client_light_is_whole(client, TARGET)) {
        lw_support_ok(lw_client_poll(client, 10, &err), &err);
        if (lw_clock_ns() > end_ns) fail_msg("no light within %u s", LIMIT_S);
    }
    const double sum = client_light_total(client);
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
    const unsigned kills = faults_case_is_long ? 1000 : 100;
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
        if (done == kills / 10) first_kb = lw_process_resident_kb(daemon.pid);
    }
    wait_for_descriptors(daemon.pid, before);
    const long grown_kb = lw_process_resident_kb(daemon.pid) - first_kb;
    print_message("%u clients killed: %u descriptors as before, %+ld kB\n", kills, before, grown_kb);
    if (!LW_SANITIZER) assert_true(grown_kb < 4096);
    still_serves(&daemon);
    lw_process_end(&daemon);
}

/* ---- the C library fails ---- */

/* One life of a server that keeps its light. Even: killed after some frames. Odd: at one of the writes of the
 * save at its end. */
static void be_killed(const char *arguments, unsigned life, long writes) {
    struct lw_process daemon;
    const bool saves = life % 2 && !LW_SANITIZER;
    faults_case_shim("lightwelld");
    if (LW_SANITIZER) unsetenv("LD_PRELOAD");
    if (saves) faults_case_set_number("FAULT_KILL", 1 + random_below((unsigned)writes));
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
    const unsigned kills = faults_case_is_long ? 200 : 10;
    char arguments[512];
    struct lw_process daemon;
    unsigned shown = 0;
    long allocations, writes = 0;
    snprintf(arguments, sizeof arguments,
             CORNELL "--listen 127.0.0.1:0 --http none --control-socket none --frames 4 --keep %s",
             lw_support_temporary("counted"));
    if (!LW_SANITIZER) faults_case_count_calls("lightwelld", arguments, 0, &allocations, &writes);
    unsetenv("LD_PRELOAD");
    snprintf(arguments, sizeof arguments, CORNELL "--keep %s", lw_support_temporary("killed"));
    lw_process_serve(&daemon, arguments);
    const double light = light_at(daemon.port);
    lw_process_end(&daemon);
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

/* ---- time ---- */

/* Promise: sessions, frames and deadlines go by a clock that nobody sets. */
static void a_jump_of_the_clock_is_not_felt(void **state) {
    (void)state;
    if (LW_SANITIZER) skip();
    static const long jumps_s[] = {86400 * 365, -86400 * 365};
    for (size_t i = 0; i < sizeof jumps_s / sizeof *jumps_s; i++) {
        struct lw_process daemon;
        faults_case_shim("lightwelld");
        faults_case_set_number("FAULT_CLOCK", jumps_s[i]);
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
        lw_process_end(&daemon);
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
        if (!faults_case_is_long) ahead_ns += 100000000u;
        lw_support_ok(lw_client_poll(client, faults_case_is_long ? 100 : 1, &err), &err);
    }
    assert_int_equal(kill(daemon.pid, SIGCONT), 0);
    while (!client_light_is_whole(client, TARGET)) lw_support_ok(lw_client_poll(client, 100, &err), &err);
    lw_client_destroy(client);
    still_serves(&daemon);
    lw_process_end(&daemon);
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
    const long before_kb = lw_process_resident_kb(daemon.pid);
    for (int i = 0; i < READERS; i++) {
        const struct sockaddr_in to = {
            .sin_family = AF_INET, .sin_port = htons(daemon.port), .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
        const int small = 4096;
        reader[i] = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
        assert_int_equal(setsockopt(reader[i], SOL_SOCKET, SO_RCVBUF, &small, sizeof small), 0);
        assert_int_equal(connect(reader[i], (const struct sockaddr *)&to, sizeof to), 0);
    }
    for (unsigned second = 0; second < (faults_case_is_long ? 30u : 3u); second++) {
        char byte;
        for (int i = 0; i < READERS; i++) (void)recv(reader[i], &byte, 1, MSG_DONTWAIT);
        if (faults_case_is_long) lw_process_sleep_ms(1000);
        still_serves(&daemon); /* an honest client gets all of its light between two bytes */
    }
    if (!LW_SANITIZER) assert_true(lw_process_resident_kb(daemon.pid) - before_kb < 32768);
    for (int i = 0; i < READERS; i++) close(reader[i]);
    wait_for_descriptors(daemon.pid, before);
    lw_process_end(&daemon);
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
    lw_process_end(&daemon);
    for (int i = 0; i < BURNERS; i++) {
        kill(burner[i], SIGKILL);
        assert_int_equal(waitpid(burner[i], NULL, 0), burner[i]);
    }
}

/* ---- links ---- */

static struct lw_net_space space; /* a cable goes to a client there */

static int remove_space(void **state) {
    lw_net_space_remove(&space);
    return faults_case_kill_all(state);
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
    for (size_t i = 0; i < (faults_case_is_long ? 3u : 1u); i++) {
        unsigned losses = 0;
        assert_true(hears(ends[0], 'f', LIMIT_S * 1000, &losses));
        lw_net_space_plug(&space, 0, false);
        losses = 0;
        if (faults_case_is_long)
            (void)hears(ends[0], 0, down_s[i] * 1000, &losses);
        else
            lw_process_await_frames(&daemon, 10);                     /* none gets through */
        if (down_s[i] > 60) wait_for_descriptors(daemon.pid, before); /* the server does not keep it */
        lw_net_space_plug(&space, 0, true);
        const uint64_t up_ns = lw_clock_ns();
        for (unsigned frames = 0; frames < 12; frames++) /* more than the link holds */
            assert_true(hears(ends[0], 'f', LIMIT_S * 1000, &losses));
        print_message("link down for %u s: %u sessions lost, 12 frames %.1f s after\n",
                      faults_case_is_long ? down_s[i] : 0, losses, (double)(lw_clock_ns() - up_ns) * 1e-9);
        if (down_s[i] < 15) assert_int_equal(losses, 0);
    }
    /* half open: the peer is gone, and no packet says so */
    if (faults_case_is_long) lw_net_space_plug(&space, 0, false);
    assert_int_equal(kill(client, SIGKILL), 0);
    assert_int_equal(waitpid(client, NULL, 0), client);
    const uint64_t gone_ns = lw_clock_ns();
    wait_for_descriptors(daemon.pid, before);
    if (faults_case_is_long)
        print_message("half open: gone after %.0f s\n", (double)(lw_clock_ns() - gone_ns) * 1e-9);
    close(ends[0]);
    lw_process_end(&daemon);
}

int main(int argc, char **argv) {
    faults_case_is_long = argc > 1;
    if (argc > 2) cmocka_set_test_filter(argv[2]);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(killed_clients_leave_nothing, faults_case_kill_all),
        cmocka_unit_test_teardown(a_killed_server_leaves_whole_light_or_none, faults_case_kill_all),
        cmocka_unit_test_teardown(a_jump_of_the_clock_is_not_felt, faults_case_kill_all),
        cmocka_unit_test_teardown(a_stopped_server_goes_on, faults_case_kill_all),
        cmocka_unit_test_teardown(readers_of_a_byte_a_second_hold_nobody_up, faults_case_kill_all),
        cmocka_unit_test_teardown(a_link_that_was_down, remove_space),
        cmocka_unit_test_teardown(a_saturated_machine_is_slow_not_broken, faults_case_kill_all),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
