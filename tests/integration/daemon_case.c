#include "tests/integration/daemon_case.h"

#include "common/base/clock.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <poll.h>
#include <signal.h>
#include <sys/socket.h>

struct daemon_case_viewers daemon_case_viewers;

const uint8_t daemon_case_hello[22] = {14, 0,    0, 0,   1,   0,   0,   0,   8,   1,   0x10,
                                       32, 0x1a, 8, 's', 't', 'r', 'a', 'n', 'g', 'e', 'r'};
const uint8_t daemon_case_package_request[8] = {0, 0, 0, 0, 4, 0, 0, 0};

struct lw_client *daemon_case_join_at(const char *host, const struct lw_process *daemon) {
    struct lw_error err = {0};
    assert_true(daemon_case_viewers.count < VIEWERS_MAX);
    lw_support_ok(lw_client_create(&(struct lw_client_desc){.host = host,
                                                            .port = daemon->port,
                                                            .name = "test_daemon",
                                                            .timeout_ms = LIMIT_S * 1000},
                                   &daemon_case_viewers.client[daemon_case_viewers.count], &err),
                  &err);
    daemon_case_viewers.closed[daemon_case_viewers.count] = false;
    return daemon_case_viewers.client[daemon_case_viewers.count++];
}

struct lw_client *daemon_case_join(const struct lw_process *daemon) {
    return daemon_case_join_at("127.0.0.1", daemon);
}

struct lw_client_stats daemon_case_stats_of(const struct lw_client *client) {
    struct lw_client_stats stats;
    lw_client_get_stats(client, &stats);
    return stats;
}

unsigned daemon_case_poll_all(void) {
    struct pollfd ready[VIEWERS_MAX];
    unsigned open = 0;
    for (unsigned i = 0; i < daemon_case_viewers.count; i++) {
        int descriptor =
            daemon_case_viewers.closed[i] ? -1 : lw_client_descriptor(daemon_case_viewers.client[i]);
        ready[i] = (struct pollfd){.fd = descriptor, .events = POLLIN};
    }
    poll(ready, daemon_case_viewers.count, 10);
    for (unsigned i = 0; i < daemon_case_viewers.count; i++) {
        struct lw_error err = {0};
        if (daemon_case_viewers.closed[i]) continue;
        enum lw_status status = lw_client_poll(daemon_case_viewers.client[i], 0, &err);
        if (status != LW_OK && status != LW_CLOSED) fail_msg("client %u: %s", i, err.text);
        daemon_case_viewers.closed[i] = status == LW_CLOSED;
        open += status == LW_OK;
    }
    return open;
}

bool daemon_case_is_complete(const struct lw_client *client) {
    const struct lw_atlas_map *map = lw_client_atlas_map(client);
    for (uint32_t i = 0; map && i < map->tile_count; i++) {
        struct lw_client_tile tile = lw_client_get_tile(client, (lw_tile_id){i});
        if (tile.version == 0 || tile.bounces < daemon_case_stats_of(client).bounces) return false;
    }
    return map != NULL;
}

uint64_t daemon_case_limit_ns(void) { return lw_clock_ns() + LIMIT_S * 1000000000ull; }

void daemon_case_wait_complete(const struct lw_client *client) {
    for (uint64_t deadline_ns = daemon_case_limit_ns(); !daemon_case_is_complete(client);) {
        assert_true(daemon_case_poll_all() > 0);
        if (lw_clock_ns() > deadline_ns) fail_msg("no complete light within %u s", LIMIT_S);
    }
}

int daemon_case_end_all(void **state) {
    (void)state;
    while (daemon_case_viewers.count)
        lw_client_destroy(daemon_case_viewers.client[--daemon_case_viewers.count]);
    lw_process_kill_all();
    return 0;
}

void daemon_case_stop(struct lw_process *daemon) {
    kill(daemon->pid, SIGTERM);
    for (uint64_t deadline_ns = daemon_case_limit_ns();
         lw_process_runs(daemon) && lw_clock_ns() < deadline_ns;)
        daemon_case_poll_all();
    int code = lw_process_finish(daemon, LIMIT_S);
    if (code != 0) fail_msg("ended with %d: %s", code, lw_process_err(daemon));
}

int daemon_case_connect_raw(const struct lw_process *daemon) {
    struct sockaddr_in address = {
        .sin_family = AF_INET, .sin_port = htons(daemon->port), .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    int peer = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0), small = 4096;
    assert_true(peer >= 0);
    setsockopt(peer, SOL_SOCKET, SO_RCVBUF, &small, sizeof small);
    setsockopt(peer, SOL_SOCKET, SO_RCVTIMEO, &(struct timeval){.tv_sec = LIMIT_S}, sizeof(struct timeval));
    assert_int_equal(connect(peer, (struct sockaddr *)&address, sizeof address), 0);
    return peer;
}

void daemon_case_say(int peer, const uint8_t *bytes, size_t size) {
    assert_int_equal(send(peer, bytes, size, MSG_NOSIGNAL), (ssize_t)size);
}

int daemon_case_connect_stranger(const struct lw_process *daemon) {
    int peer = daemon_case_connect_raw(daemon);
    daemon_case_say(peer, daemon_case_hello, sizeof daemon_case_hello);
    daemon_case_say(peer, daemon_case_package_request, sizeof daemon_case_package_request);
    return peer;
}
