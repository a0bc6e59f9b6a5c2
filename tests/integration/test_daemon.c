/* The real lightwelld, with clients of liblightwell and peers that misbehave. */
#include "tests/support/process.h"

#include "client/lib/client.h"
#include "common/base/clock.h"
#include "common/base/log.h"
#include "common/base/sanitizer.h"
#include "common/scene/pose.h"

#include <arpa/inet.h>
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <netinet/in.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#define VIEWERS_MAX   40
#define LIMIT_S       LW_PROCESS_LIMIT_S
#define SETTLED_LINES 10
#define SIGNALS       24  /* at as many moments of a start */
#define PONGS_BYTES   100 /* answers to pings that may come in between; the smallest tile is larger */

/* Growth of the daemon's memory that is no leak: a peer's queue has a bound far below. */
#define MEMORY_SLACK_KB 4096

/* All of the scene, with or without clients: what --light seen does is test_seen's. */
#define CORNELL "builtin:cornell --texels-per-metre 8 --clock step --json --light whole "
/* converges after a few dozen frames; then some more show soon that it has */
#define CONVERGES   CORNELL "--error 0.3 --frame-rate 300 "
#define NEVER_RESTS CORNELL "--error 1e-6 " /* hundreds of frames a second, for ever */
#define MOVING      "--texels-per-metre 8 --clock step --json --light whole " /* behind its file's name */
#define ATRIUM      "builtin:atrium-matt --texels-per-metre 0.5 --clock step --json --light whole "
#define CITY        "builtin:city:1 --texels-per-metre 0.3 --clock step --json "

/* ---- what the daemon prints ---- */

/* The daemon's lines so far. The last one may be a half: it does not count. */
struct report {
    char *text;
    unsigned lines;
    const char **line;
};

static struct report read_report(const struct lw_process *daemon) {
    struct report report = {.text = lw_process_out(daemon)};
    unsigned capacity = 1;
    for (const char *c = report.text; *c; c++) capacity += *c == '\n';
    report.line = calloc(capacity, sizeof *report.line);
    assert_non_null(report.line);
    for (char *start = report.text, *end; (end = strchr(start, '\n')); start = end + 1) {
        *end = '\0';
        report.line[report.lines++] = start;
    }
    return report;
}

static void free_report(struct report *report) {
    free(report->line);
    free(report->text);
}

static double sum_of(const struct report *report, const char *key) {
    double sum = 0;
    for (unsigned i = 0; i < report->lines; i++) sum += lw_process_number(report->line[i], key);
    return sum;
}

static double last_of(const struct report *report, const char *key) {
    assert_true(report->lines > 0);
    return lw_process_number(report->line[report->lines - 1], key);
}

/* The number of the first frame that clients got, and how long after the first frame of all it was, s. */
static double first_published(const struct report *report, double *out_after_s) {
    for (unsigned i = 0; i < report->lines; i++) {
        const double frame = lw_process_number(report->line[i], "published");
        *out_after_s = lw_process_number(report->line[i], "time_s") -
                       lw_process_number(report->line[0], "time_s") +
                       1e-3 * lw_process_number(report->line[i], "frame_ms");
        if (frame > 0) return frame;
    }
    return 0;
}

/* ---- clients ---- */

/* The clients of a test, of one daemon or of several in turn. What they have
 * received outlives their daemon. */
static struct {
    struct lw_client *client[VIEWERS_MAX];
    bool closed[VIEWERS_MAX];
    unsigned count;
} viewers;

static struct lw_client *join_at(const char *host, const struct lw_process *daemon) {
    struct lw_error err = {0};
    assert_true(viewers.count < VIEWERS_MAX);
    lw_support_ok(lw_client_create(&(struct lw_client_desc){.host = host,
                                                            .port = daemon->port,
                                                            .name = "test_daemon",
                                                            .timeout_ms = LIMIT_S * 1000},
                                   &viewers.client[viewers.count], &err),
                  &err);
    viewers.closed[viewers.count] = false;
    return viewers.client[viewers.count++];
}

static struct lw_client *join(const struct lw_process *daemon) { return join_at("127.0.0.1", daemon); }

static struct lw_client_stats stats_of(const struct lw_client *client) {
    struct lw_client_stats stats;
    lw_client_get_stats(client, &stats);
    return stats;
}

/* Takes in messages for all clients, waiting a little for them. Returns how many
 * clients still have their link. */
static unsigned poll_all(void) {
    struct pollfd ready[VIEWERS_MAX];
    unsigned open = 0;
    for (unsigned i = 0; i < viewers.count; i++) {
        int descriptor = viewers.closed[i] ? -1 : lw_client_descriptor(viewers.client[i]);
        ready[i] = (struct pollfd){.fd = descriptor, .events = POLLIN};
    }
    poll(ready, viewers.count, 10);
    for (unsigned i = 0; i < viewers.count; i++) {
        struct lw_error err = {0};
        if (viewers.closed[i]) continue;
        enum lw_status status = lw_client_poll(viewers.client[i], 0, &err);
        if (status != LW_OK && status != LW_CLOSED) fail_msg("client %u: %s", i, err.text);
        viewers.closed[i] = status == LW_CLOSED;
        open += status == LW_OK;
    }
    return open;
}

/* Every tile is there, with all bounces. */
static bool is_complete(const struct lw_client *client) {
    const struct lw_atlas_map *map = lw_client_atlas_map(client);
    for (uint32_t i = 0; map && i < map->tile_count; i++) {
        struct lw_client_tile tile = lw_client_get_tile(client, (lw_tile_id){i});
        if (tile.version == 0 || tile.bounces < stats_of(client).bounces) return false;
    }
    return map != NULL;
}

static uint64_t limit_ns(void) { return lw_clock_ns() + LIMIT_S * 1000000000ull; }

static void wait_complete(const struct lw_client *client) {
    for (uint64_t deadline_ns = limit_ns(); !is_complete(client);) {
        assert_true(poll_all() > 0);
        if (lw_clock_ns() > deadline_ns) fail_msg("no complete light within %u s", LIMIT_S);
    }
}

/* Whether the daemon's last lines say that nothing is solved any more and that
 * all that was sent is `tiles`. */
static bool is_settled(const struct lw_process *daemon, uint64_t tiles) {
    struct report report = read_report(daemon);
    bool settled = report.lines >= SETTLED_LINES;
    for (unsigned i = 0; settled && i < SETTLED_LINES; i++) {
        const char *line = report.line[report.lines - 1 - i];
        settled = lw_process_number(line, "tiles_solved") == 0 &&
                  lw_process_number(line, "tiles_sent") == (double)tiles;
    }
    free_report(&report);
    return settled;
}

/* Until the daemon's light has converged and the clients from number `first` on, all that it
 * has, have all that it sent. */
static void await_all_light(const struct lw_process *daemon, unsigned first) {
    for (uint64_t deadline_ns = limit_ns();;) {
        uint64_t tiles = 0;
        for (unsigned i = first; i < viewers.count; i++) {
            assert_false(viewers.closed[i]);
            tiles += stats_of(viewers.client[i]).tiles;
        }
        if (tiles && is_settled(daemon, tiles)) return;
        if (lw_clock_ns() > deadline_ns) fail_msg("not converged within %u s", LIMIT_S);
        poll_all();
    }
}

static bool same_tiles(const struct lw_client *a, const struct lw_client *b) {
    const struct lw_atlas_map *map = lw_client_atlas_map(a);
    assert_int_equal(map->tile_count, lw_client_atlas_map(b)->tile_count);
    for (uint32_t i = 0; i < map->tile_count; i++) {
        struct lw_client_tile of_a = lw_client_get_tile(a, (lw_tile_id){i}),
                              of_b = lw_client_get_tile(b, (lw_tile_id){i});
        if (of_a.version != of_b.version || of_a.bounces != of_b.bounces || of_a.error != of_b.error)
            return false;
    }
    return true;
}

static bool same_light(const struct lw_client *a, const struct lw_client *b) {
    const struct lw_atlas_map *map = lw_client_atlas_map(a);
    for (uint32_t o = 0; o < map->object_count; o++)
        for (uint32_t l = 0; l < map->atlas[o]->level_count; l++) {
            struct lw_client_level of_a = lw_client_get_level(a, o, l), of_b = lw_client_get_level(b, o, l);
            assert_true(of_a.width > 0 && of_a.width == of_b.width && of_a.height == of_b.height);
            if (memcmp(of_a.rgb, of_b.rgb, sizeof(float) * 3 * of_a.width * of_a.height) != 0) return false;
        }
    return true;
}

/* Sum of the green irradiance over all texels of the finest levels. */
static double total_light(const struct lw_client *client) {
    double sum = 0;
    for (uint32_t o = 0; o < lw_client_atlas_map(client)->object_count; o++) {
        struct lw_client_level level = lw_client_get_level(client, o, 0);
        for (uint32_t i = 0; i < level.width * level.height; i++) sum += (double)level.rgb[3 * i + 1];
    }
    return sum;
}

static int end_all(void **state) {
    (void)state;
    while (viewers.count) lw_client_destroy(viewers.client[--viewers.count]);
    lw_process_kill_all();
    return 0;
}

/* The clients listen meanwhile: the daemon gives those who do not a second to take its goodbye. */
static void stop(struct lw_process *daemon) {
    kill(daemon->pid, SIGTERM);
    for (uint64_t deadline_ns = limit_ns(); lw_process_runs(daemon) && lw_clock_ns() < deadline_ns;)
        poll_all();
    int code = lw_process_finish(daemon, LIMIT_S);
    if (code != 0) fail_msg("ended with %d: %s", code, lw_process_err(daemon));
}

/* ---- one solve for all ---- */

struct total {
    double rays, tiles_encoded;
};

/* All clients are there before the first frame. */
static struct total run_forty_frames(unsigned clients) {
    struct lw_process daemon;
    unsigned first = viewers.count;
    lw_process_serve_by_hand(&daemon,
                             "builtin:cornell --texels-per-metre 8 --json --light whole --error 1e-6 "
                             "--direct-samples 2 --indirect-samples 8 --frames 40");
    for (unsigned i = 0; i < clients; i++) join(&daemon);
    for (unsigned i = first; i < viewers.count; i++)
        for (uint64_t end_ns = limit_ns(); !lw_client_scene(viewers.client[i]);) {
            assert_int_equal(poll_all(), clients);
            assert_true(lw_clock_ns() < end_ns);
        }
    lw_process_step(&daemon, 40);
    for (uint64_t deadline_ns = limit_ns(); poll_all() > 0;) assert_true(lw_clock_ns() < deadline_ns);
    assert_int_equal(lw_process_finish(&daemon, LIMIT_S), 0);
    struct report report = read_report(&daemon);
    assert_int_equal(report.lines, 40);
    assert_int_equal(last_of(&report, "sessions"), clients);
    for (unsigned i = first; i < viewers.count; i++) assert_true(is_complete(viewers.client[i]));
    struct total total = {last_of(&report, "rays_total"), sum_of(&report, "tiles_encoded")};
    free_report(&report);
    return total;
}

static void one_solve_serves_all(void **state) {
    (void)state;
    struct total alone = run_forty_frames(1), together = run_forty_frames(32);
    assert_true(alone.rays > 1e5 && alone.tiles_encoded > 40);
    assert_true(alone.rays == together.rays);
    assert_true(alone.tiles_encoded == together.tiles_encoded);
}

/* Runs until the scene has converged and `clients` clients have it all; returns all rays traced. */
static double run_to_rest(const char *arguments, unsigned clients) {
    struct lw_process daemon;
    unsigned first = viewers.count;
    lw_process_serve(&daemon, arguments);
    for (unsigned i = 0; i < clients; i++) join(&daemon);
    await_all_light(&daemon, first);
    struct report report = read_report(&daemon);
    double rays = last_of(&report, "rays_total");
    free_report(&report);
    stop(&daemon);
    return rays;
}

static void all_see_the_same(void **state) {
    (void)state;
    double alone = run_to_rest(CONVERGES, 1), together = run_to_rest(CONVERGES, 32);
    assert_true(alone > 0 && alone == together);
    for (unsigned i = 0; i < viewers.count; i++) {
        assert_true(is_complete(viewers.client[i]));
        assert_true(same_tiles(viewers.client[0], viewers.client[i]));
        assert_true(same_light(viewers.client[0], viewers.client[i]));
    }
}

static void threads_change_nothing_and_seeds_do(void **state) {
    (void)state;
    const char *common = CONVERGES "--tracing-range 1 --texels-per-metre 12 --seed 7 --threads ";
    char one[512], two[512];
    snprintf(one, sizeof one, "%s 1", common);
    snprintf(two, sizeof two, "%s 2", common);
    double rays_one = run_to_rest(one, 1), rays_two = run_to_rest(two, 1);
    assert_true(rays_one == rays_two);
    assert_true(same_tiles(viewers.client[0], viewers.client[1]));
    assert_true(same_light(viewers.client[0], viewers.client[1]));
    run_to_rest(CONVERGES "--tracing-range 1 --texels-per-metre 12 --seed 8", 1);
    assert_false(same_light(viewers.client[0], viewers.client[2]));
}

/* ---- converged ---- */

static void converged_light_costs_nothing(void **state) {
    (void)state;
    struct lw_process daemon;
    lw_process_serve(&daemon, CONVERGES "--frame-rate 60");
    struct lw_client *early = join(&daemon);
    await_all_light(&daemon, 0);
    struct lw_client_stats before = stats_of(early);
    const uint64_t began_ns = lw_clock_ns();
    struct report report = read_report(&daemon);
    unsigned lines = report.lines;
    double rays = last_of(&report, "rays_total"), tiles = last_of(&report, "tiles_sent"),
           bytes = last_of(&report, "bytes_sent");
    free_report(&report);
    for (const double frame = lw_process_newest(&daemon, "frame");
         lw_process_newest(&daemon, "frame") < frame + 10;) /* it goes on ... */
        poll_all();
    report = read_report(&daemon);
    const double elapsed_s = (double)(lw_clock_ns() - began_ns) * 1e-9;
    /* ... at the frame rate, not as fast as it can: frames are as far apart as that or farther */
    if (report.lines > lines + 2 + 60 * elapsed_s)
        fail_msg("%u frames in %.2f s", report.lines - lines, elapsed_s);
    for (unsigned i = lines; i < report.lines; i++) {
        assert_true(lw_process_number(report.line[i], "rays_total") == rays);
        assert_true(lw_process_number(report.line[i], "tiles_sent") == tiles);
        assert_true(lw_process_number(report.line[i], "bytes_sent") < bytes + PONGS_BYTES);
        assert_true(lw_process_number(report.line[i], "tiles_encoded") == 0);
    }
    assert_true(stats_of(early).bytes < before.bytes + PONGS_BYTES && stats_of(early).tiles == before.tiles);
    free_report(&report);
    /* a late client gets the same */
    struct lw_client *late = join(&daemon);
    wait_complete(late);
    await_all_light(&daemon, 0);
    assert_true(same_tiles(early, late) && same_light(early, late));
    report = read_report(&daemon);
    assert_true(last_of(&report, "rays_total") == rays);
    free_report(&report);
    stop(&daemon);
}

/* ---- peers that misbehave ---- */

static const uint8_t hello[] = {14, 0,    0, 0,   1,   0,   0,   0,   8,   1,   0x10,
                                32, 0x1a, 8, 's', 't', 'r', 'a', 'n', 'g', 'e', 'r'},
                     old_hello[] = {12,   0, 0,   0,   1,   0,   0,   0,   8,   1,
                                    0x1a, 8, 's', 't', 'r', 'a', 'n', 'g', 'e', 'r'},
                     package_request[] = {0, 0, 0, 0, 4, 0, 0, 0}; /* the old one offers no features */
enum { REFUSAL = 3, PACKAGE_CHUNK = 5, TILE = 8 };

static int connect_raw(const struct lw_process *daemon) {
    struct sockaddr_in address = {
        .sin_family = AF_INET, .sin_port = htons(daemon->port), .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    int peer = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0), small = 4096;
    assert_true(peer >= 0);
    setsockopt(peer, SOL_SOCKET, SO_RCVBUF, &small, sizeof small);
    setsockopt(peer, SOL_SOCKET, SO_RCVTIMEO, &(struct timeval){.tv_sec = LIMIT_S}, sizeof(struct timeval));
    assert_int_equal(connect(peer, (struct sockaddr *)&address, sizeof address), 0);
    return peer;
}

static void say(int peer, const uint8_t *bytes, size_t size) {
    assert_int_equal(send(peer, bytes, size, MSG_NOSIGNAL), (ssize_t)size);
}

/* Says what a client says first. */
static int connect_stranger(const struct lw_process *daemon) {
    int peer = connect_raw(daemon);
    say(peer, hello, sizeof hello);
    say(peer, package_request, sizeof package_request);
    return peer;
}

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
    int peer = connect_stranger(daemon);
    hear_up_to(peer, type, start);
    reset(peer);
}

static void is_refused(const struct lw_process *daemon, const uint8_t *bytes, size_t size, unsigned code) {
    uint8_t start[2];
    int peer = connect_raw(daemon);
    say(peer, bytes, size);
    hear_up_to(peer, REFUSAL, start);
    assert_int_equal(start[0], 8); /* field 1 */
    assert_int_equal(start[1], code);
    close(peer);
}

static void send_garbage(const struct lw_process *daemon) {
    static uint8_t garbage[65536];
    for (size_t i = 0; i < sizeof garbage; i++) garbage[i] = (uint8_t)(i * 2654435761u >> 13);
    int peer = connect_raw(daemon);
    if (send(peer, garbage, sizeof garbage, MSG_NOSIGNAL) < 0)
        assert_true(errno == EPIPE || errno == ECONNRESET);
    while (hear(peer, garbage, 1)) {
    }
    close(peer);
}

static long resident_kb(const struct lw_process *daemon) {
    char path[64], line[256];
    long kb = -1;
    snprintf(path, sizeof path, "/proc/%d/status", (int)daemon->pid);
    FILE *file = fopen(path, "r");
    assert_non_null(file);
    while (fgets(line, sizeof line, file)) (void)sscanf(line, "VmRSS: %ld", &kb);
    fclose(file);
    assert_true(kb > 0);
    return kb;
}

static void misbehave_in_every_way(const struct lw_process *daemon) {
    uint8_t other_version[sizeof hello];
    memcpy(other_version, hello, sizeof hello);
    other_version[9] = 2;
    is_refused(daemon, other_version, sizeof other_version, 1);
    is_refused(daemon, old_hello, sizeof old_hello, 6); /* it could not read the tiles */
    is_refused(daemon, (const uint8_t *)"GET / HTTP/1.0\r\n\r\n", 18, 3);
    is_refused(daemon, package_request, sizeof package_request, 3); /* before the hello */
    leave_amid(daemon, PACKAGE_CHUNK);
    leave_amid(daemon, TILE);
    send_garbage(daemon);
    reset(connect_raw(daemon));
}

static void old_clients_get_halves(void **state) {
    (void)state;
    struct lw_process daemon;
    uint8_t start[2];
    lw_process_serve(&daemon, NEVER_RESTS "--codec half");
    int old = connect_raw(&daemon);
    say(old, old_hello, sizeof old_hello);
    say(old, package_request, sizeof package_request);
    hear_up_to(old, TILE, start);
    close(old);
    wait_complete(join(&daemon)); /* and new ones too */
}

static void misbehaving_peers_hurt_nobody(void **state) {
    (void)state;
    struct lw_process daemon;
    lw_process_serve(&daemon, NEVER_RESTS "--texels-per-metre 16"); /* 60 kB of tiles a frame: leaks show */
    struct lw_client *good = join(&daemon);
    wait_complete(good);
    int silent = connect_raw(&daemon), deaf = connect_stranger(&daemon);
    say(silent, hello, 4); /* half a header, and then nothing */
    for (int i = 0; i < 20; i++, poll_all()) misbehave_in_every_way(&daemon);
    long before_kb = resident_kb(&daemon);
    uint64_t frame = stats_of(good).frame, tiles = stats_of(good).tiles;
    for (int i = 0; i < 100; i++, poll_all()) misbehave_in_every_way(&daemon);
    /* all that time the deaf one takes nothing and the others are served, however busy the machine is */
    for (uint64_t end_ns = limit_ns();
         stats_of(good).frame <= frame + 20 || stats_of(good).tiles <= tiles + 20;) {
        poll_all();
        if (lw_clock_ns() > end_ns) fail_msg("not served within %u s", LIMIT_S);
    }
    long after_kb = resident_kb(&daemon);
    assert_true(lw_process_runs(&daemon));
    if (!LW_SANITIZER && after_kb > before_kb + MEMORY_SLACK_KB)
        fail_msg("%ld kB before, %ld kB after", before_kb, after_kb);
    struct lw_client *late = join(&daemon);
    wait_complete(late);
    close(silent);
    close(deaf);
    stop(&daemon);
}

/* ---- the end ---- */

static void stops_at(int signal_number, bool with_client, bool with_deaf_peer) {
    struct lw_process daemon;
    lw_process_serve(&daemon, NEVER_RESTS);
    if (with_client) wait_complete(join(&daemon));
    int deaf = with_deaf_peer ? connect_stranger(&daemon) : -1;
    const uint64_t deadline_ns = limit_ns();
    kill(daemon.pid, signal_number);
    while (with_client && poll_all() > 0) assert_true(lw_clock_ns() < deadline_ns);
    /* the server waits a second for a client that does not take the goodbye */
    assert_int_equal(lw_process_finish(&daemon, LIMIT_S), 0);
    assert_int_equal(access(daemon.port_file, F_OK), -1);
    lw_process_left_nothing();
    if (deaf >= 0) close(deaf);
    end_all(NULL);
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
    assert_int_equal(lw_process_stop(&daemon, SIGTERM, LIMIT_S), 0);
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
    wait_complete(join(&daemon));
    uint16_t port = daemon.port;
    snprintf(arguments, sizeof arguments, CONVERGES "--listen 127.0.0.1:%u", port);
    for (int i = 0; i < 3; i++) {
        stop(&daemon);
        lw_process_serve(&daemon, arguments);
        assert_int_equal(daemon.port, port);
        wait_complete(join(&daemon));
    }
    stop(&daemon);
}

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
    wait_complete(join_at("::1", &daemon));
    stop(&daemon);
    snprintf(command, sizeof command, "lightwell-view [::1]:%u ", daemon.port);
    char *err = lw_process_err(&daemon);
    if (!strstr(err, command)) fail_msg("no \"%s\" in %s", command, err);
    free(err);
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
    wait_complete(join(&daemon)); /* the first one does not mind */
    stop(&daemon);
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
    assert_int_equal(lw_process_stop(&daemon, SIGTERM, LIMIT_S), 0);
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
    struct lw_client *client = join(&daemon);
    wait_complete(client);
    assert_true(stats_of(client).sky[1] == 1 && total_light(client) > 0);
    stop(&daemon);
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

/* ---- moving scenes ---- */

/* A client's transforms are those of its scene at the time of its newest frame. */
static void check_pose(const struct lw_client *client, struct lw_pose *pose) {
    const struct lw_scene *scene = lw_client_scene(client);
    lw_pose_evaluate(pose, scene, stats_of(client).time_s);
    for (uint32_t o = 0; o < scene->object_count; o++)
        assert_memory_equal(lw_client_object_to_world(client, o), &pose->object_to_world[o],
                            sizeof(struct lw_affine));
}

/* Waits until a client has heard of `count` more frames; checks each that it sees.
 * Returns how often something moved. */
static unsigned watch_frames(const struct lw_client *client, unsigned count, double step_s, double start_s) {
    struct lw_pose pose = {0};
    struct lw_affine *before = NULL;
    unsigned seen = 0, moved = 0;
    uint64_t frame = 0;
    for (uint64_t deadline_ns = limit_ns(); seen < count;) {
        assert_int_equal(poll_all(), viewers.count);
        if (lw_clock_ns() > deadline_ns) fail_msg("%u frames within %u s", seen, LIMIT_S);
        struct lw_client_stats stats = stats_of(client);
        if (stats.frame == frame) continue;
        frame = stats.frame;
        seen++;
        if (fabs(stats.time_s - start_s - (double)(frame - 1) * step_s) > 1e-9)
            fail_msg("frame %llu at %f s", (unsigned long long)frame, stats.time_s);
        const struct lw_scene *scene = lw_client_scene(client);
        size_t size = scene->object_count * sizeof *before;
        if (!before) {
            lw_support_ok(lw_pose_init(&pose, scene), NULL);
            assert_non_null(before = malloc(size));
        } else {
            moved += memcmp(before, lw_client_object_to_world(client, 0), size) != 0;
        }
        memcpy(before, lw_client_object_to_world(client, 0), size);
        check_pose(client, &pose);
    }
    free(before);
    lw_pose_finish(&pose);
    return moved;
}

/* A room where a box and a lamp move. */
static void serve_moving(struct lw_process *daemon, const char *more) {
    char arguments[512];
    snprintf(arguments, sizeof arguments, "%s " MOVING "%s", lw_support_source("tests/support/moving.gltf"),
             more);
    lw_process_serve(daemon, arguments);
}

/* The first picture is that of three frames, or of as many as there are a second and a half after the first;
 * where there will be no more, of those that there are. */
static void the_first_light_has_several_frames(void **state) {
    (void)state;
    static const struct {
        const char *options;
        double frame;
    } light[] = {{"--prepare 1000", 3}, {"--light whole", 3}, {"--frames 2", 2}, {"--prepare 0", 1}};
    for (size_t i = 0; i < sizeof light / sizeof *light; i++) {
        struct lw_process daemon;
        char arguments[128];
        snprintf(arguments, sizeof arguments,
                 "builtin:cornell --texels-per-metre 8 --json --frame-budget-ms inf %s", light[i].options);
        lw_process_serve(&daemon, arguments);
        if (light[i].frame != 2) lw_process_await_frames(&daemon, 4);
        if (light[i].frame == 2)
            assert_int_equal(lw_process_finish(&daemon, LIMIT_S), 0);
        else
            stop(&daemon);
        struct report report = read_report(&daemon);
        double after_s;
        const double frame = first_published(&report, &after_s);
        if (!(frame == light[i].frame || (frame > 0 && frame < light[i].frame && after_s > 1.2)))
            fail_msg("%s: frame %g, after %g s", light[i].options, frame, after_s);
        free_report(&report);
    }
}

static void expect_frame_by_frame(struct lw_process *daemon) {
    struct lw_client *client = join(daemon);
    assert_int_equal(watch_frames(client, 10, 1.0 / 30, 0), 9);
    wait_complete(client);
    stop(daemon);
    struct report report = read_report(daemon);
    assert_true(report.lines >= 10);
    for (unsigned i = 0; i < report.lines; i++)
        assert_true(lw_process_number(report.line[i], "frame") == i + 1);
    free_report(&report);
}

static void a_scene_moves_frame_by_frame(void **state) {
    (void)state;
    struct lw_process daemon;
    serve_moving(&daemon, "");
    expect_frame_by_frame(&daemon);
}

static void the_atrium_moves_frame_by_frame(void **state) {
    (void)state;
    struct lw_process daemon;
    lw_process_serve(&daemon, ATRIUM);
    expect_frame_by_frame(&daemon);
}

/* Hundreds of objects, thousands of emitters, two spots that drive. */
static void the_city_moves_frame_by_frame(void **state) {
    (void)state;
    struct lw_process daemon;
    lw_process_serve(&daemon, CITY);
    struct lw_client *client = join(&daemon);
    assert_int_equal(watch_frames(client, 3, 1.0 / 30, 0), 2);
    wait_complete(client);
    assert_true(total_light(client) > 0);
    stop(&daemon);
}

static void a_frozen_scene_holds_still(void **state) {
    (void)state;
    struct lw_process daemon;
    serve_moving(&daemon, "--freeze 1.5 --error 1e-6");
    struct lw_client *client = join(&daemon);
    assert_int_equal(watch_frames(client, 5, 0, 1.5), 0);
    stop(&daemon);
}

/* ---- ways to solve ---- */

static double light_with(const char *options, unsigned bounces) {
    struct lw_process daemon;
    char arguments[256];
    snprintf(arguments, sizeof arguments, CORNELL "--error 0.15 --frame-rate 300 %s", options);
    lw_process_serve(&daemon, arguments);
    struct lw_client *client = join(&daemon);
    await_all_light(&daemon, viewers.count - 1);
    assert_true(is_complete(client));
    assert_int_equal(stats_of(client).bounces, bounces);
    stop(&daemon);
    struct report report = read_report(&daemon);
    bool asks_probes = strstr(options, "--tracing-range 1") != NULL, bounces_at_all = bounces > 0;
    assert_int_equal(sum_of(&report, "rays_probe") > 0, asks_probes);
    assert_int_equal(sum_of(&report, "rays_bounce") > 0, bounces_at_all);
    free_report(&report);
    return total_light(client);
}

static void every_way_to_solve_serves(void **state) {
    (void)state;
    double traced = light_with("--tracing-range inf", 2), probed = light_with("--tracing-range 1", 2),
           direct = light_with("--bounces 0", 0), once = light_with("--bounces 1", 1);
    assert_true(direct > 0 && direct < 0.9 * once && once < 0.98 * traced);
    if (probed < 0.8 * traced || probed > 1.2 * traced)
        fail_msg("%g with probes, %g without", probed, traced);
}

/* ---- beside other programs ---- */

/* Whether a file of a process in /proc holds `text`. */
static bool proc_holds(const struct lw_process *process, const char *file, const char *text) {
    char path[64], content[65536];
    snprintf(path, sizeof path, "/proc/%d/%s", (int)process->pid, file);
    const int fd = open(path, O_RDONLY | O_CLOEXEC);
    assert_true(fd >= 0);
    size_t length = 0;
    for (ssize_t got; (got = read(fd, content + length, sizeof content - length)) > 0;) length += (size_t)got;
    close(fd);
    return memmem(content, length, text, strlen(text)) != NULL;
}

static void expect_waiting(const char *policy, const char *expected) {
    struct lw_process daemon;
    char variable[64];
    snprintf(variable, sizeof variable, "OMP_WAIT_POLICY=%s", expected);
    assert_int_equal(policy ? setenv("OMP_WAIT_POLICY", policy, 1) : unsetenv("OMP_WAIT_POLICY"), 0);
    lw_process_serve(&daemon, CONVERGES);
    assert_true(proc_holds(&daemon, "environ", variable));
    assert_true(proc_holds(&daemon, "comm", "lightwelld\n"));
    stop(&daemon);
}

static void idle_threads_sleep_unless_set_otherwise(void **state) {
    (void)state;
    const char *was = getenv("OMP_WAIT_POLICY");
    char *kept = was ? strdup(was) : NULL;
    expect_waiting(NULL, "passive");
    expect_waiting("active", "active");
    assert_int_equal(kept ? setenv("OMP_WAIT_POLICY", kept, 1) : unsetenv("OMP_WAIT_POLICY"), 0);
    free(kept);
}

/* With an argument: the long tests alone, of large scenes. */
int main(int argc, char **argv) {
    (void)argv;
    lw_log_init("test_daemon", LW_LOG_WARNING);
    const struct CMUnitTest long_tests[] = {
        cmocka_unit_test_teardown(the_atrium_moves_frame_by_frame, end_all),
        cmocka_unit_test_teardown(the_city_moves_frame_by_frame, end_all),
    };
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(the_first_light_has_several_frames, end_all),
        cmocka_unit_test_teardown(one_solve_serves_all, end_all),
        cmocka_unit_test_teardown(all_see_the_same, end_all),
        cmocka_unit_test_teardown(threads_change_nothing_and_seeds_do, end_all),
        cmocka_unit_test_teardown(converged_light_costs_nothing, end_all),
        cmocka_unit_test_teardown(old_clients_get_halves, end_all),
        cmocka_unit_test_teardown(misbehaving_peers_hurt_nobody, end_all),
        cmocka_unit_test_teardown(signals_stop_it_cleanly, end_all),
        cmocka_unit_test_teardown(a_signal_ends_a_long_frame, end_all),
        cmocka_unit_test_teardown(signals_stop_an_import, end_all),
        cmocka_unit_test_teardown(a_signal_at_any_moment_leaves_nothing, end_all),
        cmocka_unit_test_teardown(restarts_on_its_port, end_all),
        cmocka_unit_test_teardown(serves_version_six_addresses, end_all),
        cmocka_unit_test_teardown(a_port_in_use_is_named, end_all),
        cmocka_unit_test_teardown(a_port_file_may_be_a_pipe, end_all),
        cmocka_unit_test_teardown(bad_options_are_named, end_all),
        cmocka_unit_test_teardown(bad_scenes_and_files_are_named, end_all),
        cmocka_unit_test_teardown(a_scene_without_light_asks_for_a_sky, end_all),
        cmocka_unit_test_teardown(damaged_packages_are_refused, end_all),
        cmocka_unit_test_teardown(a_scene_moves_frame_by_frame, end_all),
        cmocka_unit_test_teardown(a_frozen_scene_holds_still, end_all),
        cmocka_unit_test_teardown(every_way_to_solve_serves, end_all),
        cmocka_unit_test_teardown(idle_threads_sleep_unless_set_otherwise, end_all),
    };
    return argc > 1 ? cmocka_run_group_tests(long_tests, NULL, NULL)
                    : cmocka_run_group_tests(tests, NULL, NULL);
}
