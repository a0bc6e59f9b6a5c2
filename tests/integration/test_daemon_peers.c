/* The real lightwelld and peers that misbehave, that are old, or that come by IPv6. */
#include "tests/integration/daemon_case.h"

#include "common/base/clock.h"
#include "common/base/log.h"
#include "common/base/sanitizer.h"

#include <errno.h>
#include <netinet/in.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

/* The old client offers no features. */
static const uint8_t old_hello[] = {12,   0, 0,   0,   1,   0,   0,   0,   8,   1,
                                    0x1a, 8, 's', 't', 'r', 'a', 'n', 'g', 'e', 'r'};

/* Growth of the daemon's memory that is no leak: a peer's queue has a bound far below. */
#define MEMORY_SLACK_KB 4096

/* ---- peers that misbehave ---- */

static bool hear(int peer, uint8_t *bytes, size_t size) {
    for (size_t got = 0; got < size;) {
        ssize_t more = recv(peer, bytes + got, size - got, 0);
        if (more < 0) assert_int_equal(errno, ECONNRESET);
        if (more <= 0) return false;
        got += (size_t)more;
    }
    return true;
}

/* Reads up to a message of this type, and of its body the first two bytes. */
static void hear_up_to(int peer, unsigned type, uint8_t out_start[2]) {
    uint8_t header[8], rest;
    for (;;) {
        if (!hear(peer, header, sizeof header)) fail_msg("no message %u", type);
        uint32_t size = header[0] | header[1] << 8 | header[2] << 16 | (uint32_t)header[3] << 24;
        if (header[4] == type) break;
        while (size--) assert_true(hear(peer, &rest, 1));
    }
    assert_true(hear(peer, out_start, 2));
}

static void reset(int peer) {
    setsockopt(peer, SOL_SOCKET, SO_LINGER, &(struct linger){.l_onoff = 1}, sizeof(struct linger));
    close(peer);
}

static void leave_amid(const struct lw_process *daemon, unsigned type) {
    uint8_t start[2];
    int peer = daemon_case_connect_stranger(daemon);
    hear_up_to(peer, type, start);
    reset(peer);
}

static void is_refused(const struct lw_process *daemon, const uint8_t *bytes, size_t size, unsigned code) {
    uint8_t start[2];
    int peer = daemon_case_connect_raw(daemon);
    daemon_case_say(peer, bytes, size);
    hear_up_to(peer, REFUSAL, start);
    assert_int_equal(start[0], 8); /* field 1 */
    assert_int_equal(start[1], code);
    close(peer);
}

static void send_garbage(const struct lw_process *daemon) {
    static uint8_t garbage[65536];
    for (size_t i = 0; i < sizeof garbage; i++) garbage[i] = (uint8_t)(i * 2654435761u >> 13);
    int peer = daemon_case_connect_raw(daemon);
    if (send(peer, garbage, sizeof garbage, MSG_NOSIGNAL) < 0)
        assert_true(errno == EPIPE || errno == ECONNRESET);
    while (hear(peer, garbage, 1)) {
    }
    close(peer);
}

static void misbehave_in_every_way(const struct lw_process *daemon) {
    uint8_t other_version[sizeof daemon_case_hello];
    memcpy(other_version, daemon_case_hello, sizeof daemon_case_hello);
    other_version[9] = 2;
    is_refused(daemon, other_version, sizeof other_version, 1);
    is_refused(daemon, old_hello, sizeof old_hello, 6); /* it could not read the tiles */
    is_refused(daemon, (const uint8_t *)"GET / HTTP/1.0\r\n\r\n", 18, 3);
    is_refused(daemon, daemon_case_package_request, sizeof daemon_case_package_request,
               3); /* before the hello */
    leave_amid(daemon, PACKAGE_CHUNK);
    leave_amid(daemon, TILE);
    send_garbage(daemon);
    reset(daemon_case_connect_raw(daemon));
}

static void old_clients_get_halves(void **state) {
    (void)state;
    struct lw_process daemon;
    uint8_t start[2];
    lw_process_serve(&daemon, NEVER_RESTS "--codec half");
    int old = daemon_case_connect_raw(&daemon);
    daemon_case_say(old, old_hello, sizeof old_hello);
    daemon_case_say(old, daemon_case_package_request, sizeof daemon_case_package_request);
    hear_up_to(old, TILE, start);
    close(old);
    daemon_case_wait_complete(daemon_case_join(&daemon)); /* and new ones too */
}

static void misbehaving_peers_hurt_nobody(void **state) {
    (void)state;
    struct lw_process daemon;
    lw_process_serve(&daemon, NEVER_RESTS "--texels-per-metre 16"); /* 60 kB of tiles a frame: leaks show */
    struct lw_client *good = daemon_case_join(&daemon);
    daemon_case_wait_complete(good);
    int silent = daemon_case_connect_raw(&daemon), deaf = daemon_case_connect_stranger(&daemon);
    daemon_case_say(silent, daemon_case_hello, 4); /* half a header, and then nothing */
    for (int i = 0; i < 20; i++, daemon_case_poll_all()) misbehave_in_every_way(&daemon);
    long before_kb = lw_process_resident_kb(daemon.pid);
    uint64_t frame = daemon_case_stats_of(good).frame, tiles = daemon_case_stats_of(good).tiles;
    for (int i = 0; i < 100; i++, daemon_case_poll_all()) misbehave_in_every_way(&daemon);
    /* all that time the deaf one takes nothing and the others are served, however busy the machine is */
    for (uint64_t end_ns = daemon_case_limit_ns();
         daemon_case_stats_of(good).frame <= frame + 20 || daemon_case_stats_of(good).tiles <= tiles + 20;) {
        daemon_case_poll_all();
        if (lw_clock_ns() > end_ns) fail_msg("not served within %u s", LIMIT_S);
    }
    long after_kb = lw_process_resident_kb(daemon.pid);
    assert_true(lw_process_runs(&daemon));
    if (!LW_SANITIZER && after_kb > before_kb + MEMORY_SLACK_KB)
        fail_msg("%ld kB before, %ld kB after", before_kb, after_kb);
    struct lw_client *late = daemon_case_join(&daemon);
    daemon_case_wait_complete(late);
    close(silent);
    close(deaf);
    daemon_case_stop(&daemon);
}

/* ---- the end ---- */

static void serves_version_six_addresses(void **state) {
    (void)state;
    struct sockaddr_in6 any_port = {.sin6_family = AF_INET6, .sin6_addr = IN6ADDR_LOOPBACK_INIT};
    int probe = socket(AF_INET6, SOCK_STREAM | SOCK_CLOEXEC, 0);
    bool there = probe >= 0 && bind(probe, (struct sockaddr *)&any_port, sizeof any_port) == 0;
    if (probe >= 0) close(probe);
    if (!there) {
        print_message("skipped: no IPv6 on this machine\n");
        skip();
    }
    struct lw_process daemon;
    char command[64];
    lw_process_serve(&daemon, CONVERGES "--listen [::1]:0");
    daemon_case_wait_complete(daemon_case_join_at("::1", &daemon));
    daemon_case_stop(&daemon);
    snprintf(command, sizeof command, "lightwell-view [::1]:%u ", daemon.port);
    char *err = lw_process_err(&daemon);
    if (!strstr(err, command)) fail_msg("no \"%s\" in %s", command, err);
    free(err);
}

int main(void) {
    lw_log_init("test_daemon_peers", LW_LOG_WARNING);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(old_clients_get_halves, daemon_case_end_all),
        cmocka_unit_test_teardown(misbehaving_peers_hurt_nobody, daemon_case_end_all),
        cmocka_unit_test_teardown(serves_version_six_addresses, daemon_case_end_all),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
