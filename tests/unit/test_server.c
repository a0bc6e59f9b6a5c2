#include "tests/support/support.h"

#include "common/clock.h"
#include "common/scene/scene_spares.h"
#include "common/tile/tile_codec.h"
#include "common/waiting.h"
#include "server/serve/priority.h"
#include "server/serve/server.h"
#include "server/serve/session.h"
#include "tests/support/server_clock.h"

#include <arpa/inet.h>
#include <errno.h>
#include <math.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <pthread.h>
#include <semaphore.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>
#include <uv.h>
#include <zstd.h>

/* A server in a thread of its own, raw sockets here. Snapshots are made by hand: the payloads only have to
 * be bytes. Peers ask for one form of light, which snapshots have; the server knows both. The server's clock
 * stands from its start to its end: no time-out strikes unless the test moves the clock. */

#define OBJECTS      3u
#define STEP_MS      20 /* by which time goes on, for who waits for that */
#define PAYLOAD_SIZE 20000u
#define PACKAGE_SIZE 300000u
#define FLOOD_MAX    (6u << 20) /* bytes of a peer that is not read: what sockets hold */
#define CLIENT_TOKEN 0x1122334455667788u

static enum lw_light_form form;
static bool is_paced; /* time goes on while a peer waits for bytes */

struct fixture {
    struct lw_scene *scene;
    struct lw_atlas_map map;
    uint8_t *package;
    struct lw_server *server;
    pthread_t thread;
    enum lw_status result;
};

static const uint8_t client_lights[] = {2, 1}; /* the second and the ninth */

static void *serve(void *context) {
    struct fixture *f = context;
    f->result = lw_server_run(f->server, NULL);
    return NULL;
}

static uint32_t finer_levels;  /* of the next one */
static uint32_t fine_room = 3; /* ids for their tiles */

/* The package: noise, unless extra has one. */
static struct fixture *start(const struct lw_server_desc *extra) {
    struct fixture *f = calloc(1, sizeof *f);
    assert_non_null(f);
    f->scene = lw_support_squares(OBJECTS, 1.0f);
    f->scene->mesh[0].atlas_width =
        200; /* levels 200x100, 100x50, 50x25, 25x13, 13x7: 8 + 2 + 1 + 1 + 1 tiles */
    f->scene->mesh[0].atlas_height = 100;
    lw_support_ok(lw_atlas_map_init_finer(&f->map, f->scene, finer_levels, finer_levels ? fine_room : 0),
                  NULL);
    assert_int_equal(f->map.plain_count, 13 * OBJECTS);
    f->package = malloc(PACKAGE_SIZE);
    assert_non_null(f->package);
    uint32_t noise = 1; /* does not compress, so that there are several chunks */
    for (uint32_t i = 0; i < PACKAGE_SIZE; i++)
        f->package[i] = (uint8_t)((noise = noise * 1664525u + 1013904223u) >> 24);
    struct lw_server_desc desc = *extra;
    struct lw_error err = {0};
    desc.host = "127.0.0.1";
    desc.atlas_map = &f->map;
    desc.client_lights = client_lights;
    desc.client_lights_size = sizeof client_lights;
    if (!desc.package) {
        desc.package = f->package;
        desc.package_size = PACKAGE_SIZE;
    }
    desc.bounces = 2;
    desc.target_error = 0.05f;
    lw_support_ok(lw_server_create(&desc, &f->server, &err), &err);
    is_paced = false;
    server_clock_stop();
    assert_int_equal(pthread_create(&f->thread, NULL, serve, f), 0);
    return f;
}

static void join(struct fixture *f) {
    server_clock_run();
    assert_int_equal(pthread_join(f->thread, NULL), 0);
    assert_int_equal(f->result, LW_OK);
    lw_server_destroy(f->server);
    f->server = NULL;
}

static void discard(struct fixture *f) {
    lw_atlas_map_finish(&f->map);
    lw_scene_destroy(f->scene);
    free(f->package);
    free(f);
}

static void end(struct fixture *f) {
    lw_server_stop(f->server);
    join(f);
    discard(f);
}

static struct lw_server_stats stats_of(const struct fixture *f) {
    struct lw_server_stats stats;
    lw_server_get_stats(f->server, &stats);
    return stats;
}

static void wait_for_sessions(const struct fixture *f, uint64_t sessions) {
    LW_SUPPORT_WAIT_UNTIL(stats_of(f).sessions_now == sessions);
}

/* ---- snapshots ---- */

static struct lw_blob *blob_of(const struct lw_message *message) {
    struct lw_blob *blob;
    lw_support_ok(lw_blob_from_message(message, &blob), NULL);
    return blob;
}

static struct lw_blob *frame_blob(uint64_t frame, double time_s) {
    return blob_of(
        &(struct lw_message){.type = LW_MESSAGE_FRAME, .frame = {.frame = frame, .time_s = time_s}});
}

/* All tiles of version `frame`, which is a number of its own: two of them are a frame to the server. The full
 * frame message has time 1, the delta time 2, to tell them apart. */
static struct lw_snapshot *make_snapshot(const struct fixture *f, uint64_t frame, uint64_t previous) {
    static const uint8_t payload[PAYLOAD_SIZE] = {1};
    struct lw_snapshot *snapshot;
    lw_support_ok(lw_snapshot_create(f->map.tile_count, 1u << form, &snapshot), NULL);
    snapshot->frame = frame;
    snapshot->previous_frame = previous;
    snapshot->frame_full = frame_blob(frame, 1);
    if (previous) snapshot->frame_delta = frame_blob(frame, 2);
    for (uint32_t t = 0; t < f->map.tile_count; t++) {
        const struct lw_tile_place *p = &f->map.place[t];
        if (!lw_atlas_map_is_used(&f->map, (lw_tile_id){t})) continue;
        snapshot->tile[form][t].version = frame;
        snapshot->tile[form][t].blob =
            blob_of(&(struct lw_message){.type = LW_MESSAGE_TILE,
                                         .tile = {.layer = form,
                                                  .object = p->object,
                                                  .level = p->level,
                                                  .tile = lw_atlas_map_number(&f->map, (lw_tile_id){t}),
                                                  .version = frame,
                                                  .codec = 1,
                                                  .scale = 1,
                                                  .payload = payload,
                                                  .payload_size = sizeof payload}});
    }
    return snapshot;
}

static void publish(struct fixture *f, struct lw_snapshot *snapshot) {
    lw_server_publish(f->server, snapshot);
    lw_snapshot_unref(snapshot);
}

/* ---- a peer ---- */

static int dial_with_buffer(const struct fixture *f, int receive_buffer) {
    int s = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    assert_true(s >= 0);
    if (receive_buffer)
        assert_int_equal(setsockopt(s, SOL_SOCKET, SO_RCVBUF, &receive_buffer, sizeof receive_buffer), 0);
    struct sockaddr_in address = {.sin_family = AF_INET,
                                  .sin_port = htons(lw_server_port(f->server)),
                                  .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    assert_int_equal(connect(s, (struct sockaddr *)&address, sizeof address), 0);
    return s;
}

static int dial(const struct fixture *f) { return dial_with_buffer(f, 0); }

static int dial_from(const struct fixture *f, const char *own) {
    int s = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    struct sockaddr_in from = {.sin_family = AF_INET}, to = {.sin_family = AF_INET,
                                                             .sin_port = htons(lw_server_port(f->server)),
                                                             .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    assert_int_equal(inet_pton(AF_INET, own, &from.sin_addr), 1);
    assert_int_equal(bind(s, (struct sockaddr *)&from, sizeof from), 0);
    assert_int_equal(connect(s, (struct sockaddr *)&to, sizeof to), 0);
    return s;
}

static void put_bytes(int s, const void *bytes, size_t size) {
    assert_int_equal(send(s, bytes, size, MSG_NOSIGNAL), (ssize_t)size);
}

static void put(int s, const struct lw_message *message) {
    struct lw_message m = *message;
    if (m.type == LW_MESSAGE_HELLO && form == LW_LIGHT_FORM_SPLIT) m.hello.features |= LW_FEATURE_DRAWS;
    struct lw_blob *blob = blob_of(&m);
    put_bytes(s, blob->bytes, blob->size);
    lw_blob_unref(blob);
}

static bool is_readable(int s) {
    struct pollfd look = {.fd = s, .events = POLLIN};
    return poll(&look, 1, 0) == 1;
}

/* Until there are bytes. */
static void wait_for_bytes(int s) {
    struct pollfd wait = {.fd = s, .events = POLLIN};
    while (is_paced && !is_readable(s))
        if (!server_clock_step(STEP_MS)) lw_support_pause(); /* it has not accepted anybody yet */
    assert_int_equal(poll(&wait, 1, -1), 1);
}

/* Reads exactly size bytes; false at the end of the stream. */
static bool get_bytes(int s, uint8_t *dst, size_t size) {
    for (size_t got = 0; got < size;) {
        wait_for_bytes(s);
        ssize_t n = recv(s, dst + got, size - got, 0);
        if (n == 0 || (n < 0 && errno == ECONNRESET)) return false;
        assert_true(n > 0);
        got += (size_t)n;
    }
    return true;
}

/* Whether it is in the form that peers ask for. What each WELCOME then has beside the rest is taken out. */
static void check_form(struct lw_message *m) {
    const bool draws = form == LW_LIGHT_FORM_SPLIT;
    if (m->type == LW_MESSAGE_TILE) assert_int_equal(m->tile.layer, form);
    if (m->type != LW_MESSAGE_WELCOME) return;
    assert_int_equal(m->welcome.features & LW_FEATURE_DRAWS, draws ? LW_FEATURE_DRAWS : 0);
    assert_int_equal(m->welcome.client_lights_size, draws ? sizeof client_lights : 0);
    if (draws) assert_memory_equal(m->welcome.client_lights, client_lights, sizeof client_lights);
    assert_int_equal(m->welcome.client_materials_size, 0);
    m->welcome.features &= ~(uint64_t)LW_FEATURE_DRAWS;
}

/* Reads the next message; false at the end of the stream. */
static bool get(int s, struct lw_message *out) {
    static uint8_t body[LW_FRAMING_BODY_MAX];
    uint8_t bytes[LW_FRAMING_HEADER_SIZE];
    struct lw_framing_header header;
    struct lw_error err = {0};
    if (!get_bytes(s, bytes, sizeof bytes)) return false;
    lw_support_ok(lw_framing_read_header(bytes, LW_FRAMING_BODY_MAX, &header, &err), &err);
    if (!get_bytes(s, body, header.body_size)) return false;
    lw_support_ok(lw_message_decode(header, body, out, &err), &err);
    check_form(out);
    return true;
}

static void expect(int s, enum lw_message_type type, struct lw_message *out) {
    assert_true(get(s, out));
    assert_int_equal(out->type, type);
}

static void expect_return_told(int s, enum lw_refusal code, uint32_t retry_after_ms) {
    struct lw_message m;
    while (get(s, &m)) {
        if (m.type != LW_MESSAGE_REFUSAL) {
            lw_message_finish(&m);
            continue;
        }
        assert_int_equal(m.refusal.code, code);
        assert_int_equal(m.refusal.retry_after_ms, retry_after_ms);
        assert_true(strlen(m.refusal.text) > 0);
        lw_message_finish(&m);
        uint8_t byte;
        const bool was_paced = is_paced;
        is_paced = true;
        assert_false(get_bytes(s, &byte, 1)); /* then closed */
        is_paced = was_paced;
        close(s);
        return;
    }
    fail_msg("closed without a refusal");
}

static void expect_refusal(int s, enum lw_refusal code) { expect_return_told(s, code, 0); }

static const struct lw_message hello = {.type = LW_MESSAGE_HELLO,
                                        .hello = {.version = LW_WIRE_VERSION, .name = "test"}};

static const struct lw_message hello_again = {
    .type = LW_MESSAGE_HELLO,
    .hello = {.version = LW_WIRE_VERSION, .features = LW_FEATURE_RESUME, .name = "test"}};

static int dial_and_greet(const struct fixture *f) {
    int s = dial(f);
    struct lw_message m;
    put(s, &hello);
    expect(s, LW_MESSAGE_WELCOME, &m);
    lw_message_finish(&m);
    return s;
}

static int dial_and_greet_with(const struct fixture *f, uint64_t features) {
    int s = dial(f);
    put(s, &(struct lw_message){.type = LW_MESSAGE_HELLO,
                                .hello = {.version = LW_WIRE_VERSION, .features = features}});
    struct lw_message m;
    expect(s, LW_MESSAGE_WELCOME, &m);
    lw_message_finish(&m);
    return s;
}

static void ask_for_package(int s, uint64_t offset) {
    put(s, &(struct lw_message){.type = LW_MESSAGE_PACKAGE_REQUEST, .package_request.offset = offset});
}

static int dial_and_stream(const struct fixture *f) {
    int s = dial(f);
    struct lw_message m;
    put(s, &hello);
    expect(s, LW_MESSAGE_WELCOME, &m);
    uint64_t end = m.welcome.package_compressed_size;
    lw_message_finish(&m);
    ask_for_package(s, end); /* as one who has the package */
    return s;
}

static void expect_frame(int s, uint64_t frame, double time_s) {
    struct lw_message m;
    expect(s, LW_MESSAGE_FRAME, &m);
    assert_int_equal(m.frame.frame, frame);
    assert_true(m.frame.time_s == time_s);
    lw_message_finish(&m);
}

static void expect_tiles(int s, uint32_t count, uint64_t version) {
    for (uint32_t i = 0; i < count; i++) {
        struct lw_message m;
        expect(s, LW_MESSAGE_TILE, &m);
        assert_int_equal(m.tile.version, version);
        lw_message_finish(&m);
    }
}

/* Reads on until that frame is told. */
static void wait_for_frame(int s, uint64_t frame) {
    for (bool framed = false; !framed;) {
        struct lw_message m;
        assert_true(get(s, &m));
        framed = m.type == LW_MESSAGE_FRAME && m.frame.frame == frame;
        lw_message_finish(&m);
    }
}

/* A frame that is told whole, with all of the tiles. */
static void expect_light(const struct fixture *f, int s, uint64_t frame) {
    expect_frame(s, frame, 1);
    expect_tiles(s, f->map.plain_count, frame);
}

/* Nothing is on its way to a peer, and nothing comes: questions get their answers and nothing in between. Two
 * of them, as an answer may overtake tiles, which are sent before the second question is read. Time goes by,
 * so that the server lets more of them in. */
static void expect_silence(int s) {
    static uint64_t token = 1000;
    for (int i = 0; i < 2; i++) {
        struct lw_message m;
        put(s, &(struct lw_message){.type = LW_MESSAGE_PING, .ping.token = ++token});
        expect(s, LW_MESSAGE_PONG, &m);
        assert_int_equal(m.pong.token, token);
        lw_message_finish(&m);
        server_clock_move(100);
    }
}

/* ---- joining ---- */

static void test_join(void **state) {
    (void)state;
    struct fixture *f = start(&(struct lw_server_desc){0});
    publish(f, make_snapshot(f, 7, 0));
    int s = dial(f);
    struct lw_message m;
    put(s, &hello);
    expect(s, LW_MESSAGE_WELCOME, &m);
    struct lw_message_welcome welcome = m.welcome;
    assert_int_equal(welcome.version, LW_WIRE_VERSION);
    assert_int_equal(welcome.bounces, 2);
    assert_true(welcome.target_error == 0.05f);
    assert_int_equal(welcome.package_size, PACKAGE_SIZE);
    assert_string_equal(welcome.name, "lightwelld " LW_VERSION);
    struct lw_package_hash hash;
    lw_package_hash(f->package, PACKAGE_SIZE, &hash);
    assert_memory_equal(welcome.package_hash.bytes, hash.bytes, sizeof hash.bytes);
    lw_message_finish(&m);
    expect_silence(s); /* nothing before it is asked for */
    ask_for_package(s, 0);
    uint8_t *compressed = malloc(welcome.package_compressed_size), *package = malloc(PACKAGE_SIZE);
    uint64_t at = 0;
    while (at < welcome.package_compressed_size) {
        expect(s, LW_MESSAGE_PACKAGE_CHUNK, &m);
        assert_int_equal(m.package_chunk.offset, at);
        memcpy(compressed + at, m.package_chunk.data, m.package_chunk.size);
        at += m.package_chunk.size;
        lw_message_finish(&m);
    }
    assert_int_equal(ZSTD_decompress(package, PACKAGE_SIZE, compressed, at), PACKAGE_SIZE);
    assert_memory_equal(package, f->package, PACKAGE_SIZE);
    free(compressed);
    free(package);
    expect_frame(s, 7, 1);
    /* coarsest levels of all objects, then the next finer ones */
    for (uint32_t i = 0; i < f->map.tile_count; i++) {
        static const uint32_t level_of[13 * OBJECTS] = {4, 4, 4, 3, 3, 3, 2, 2, 2, 1, 1, 1, 1, 1, 1, 0};
        expect(s, LW_MESSAGE_TILE, &m);
        assert_int_equal(m.tile.level, level_of[i]);
        if (level_of[i] > 1) assert_int_equal(m.tile.object, i % OBJECTS);
        assert_int_equal(m.tile.version, 7);
        lw_message_finish(&m);
    }
    expect_silence(s);
    close(s);
    end(f);
}

static void expect_waiting(int s, enum lw_waiting_stage stage, float share) {
    struct lw_message m;
    expect(s, LW_MESSAGE_WAITING, &m);
    assert_int_equal(m.waiting.stage, stage);
    assert_true(m.waiting.share == share);
    lw_message_finish(&m);
}

/* Time for the server's next look, at which it may say more. */
static void pass_a_wait(void) { assert_true(server_clock_step(LW_SERVER_WAITING_MS)); }

/* Who comes before the first light hears why there is none, and who comes later, how far that is by then: now
 * and again, if there is news, until there is light. */
static void test_waiting_for_the_first_light(void **state) {
    (void)state;
    struct lw_waiting waiting = {0};
    struct fixture *f = start(&(struct lw_server_desc){.first_light = &waiting});
    const int none = dial_and_greet(f); /* it wants no light */
    lw_waiting_raise(&waiting, LW_WAITING_PLACING_TEXELS, 0, 0);
    const int early = dial_and_stream(f);
    expect_waiting(early, LW_WAITING_PLACING_TEXELS, 0);
    pass_a_wait();
    expect_silence(early); /* no news */
    pass_a_wait();
    lw_waiting_raise(&waiting, LW_WAITING_LOOKING_INSIDE, 1, 4);
    expect_waiting(early, LW_WAITING_LOOKING_INSIDE, 0.25f);
    lw_waiting_raise(&waiting, LW_WAITING_LOOKING_INSIDE, 2, 4);
    assert_true(server_clock_step(0)); /* the server has looked, */
    expect_silence(early);             /* so soon */
    lw_waiting_raise(&waiting, LW_WAITING_LOOKING_INSIDE, 3, 4);
    const int late = dial_and_stream(f);
    expect_waiting(late, LW_WAITING_LOOKING_INSIDE, 0.75f);
    pass_a_wait();
    bool is_told = false; /* perhaps of the half, too: the look may have been between */
    while (!is_told) {
        struct lw_message m;
        expect(early, LW_MESSAGE_WAITING, &m);
        is_told = m.waiting.share == 0.75f;
        lw_message_finish(&m);
    }
    pass_a_wait();
    lw_waiting_raise(&waiting, LW_WAITING_FIRST_LIGHT, 1, 2);
    expect_waiting(early, LW_WAITING_FIRST_LIGHT, 0.5f);
    expect_waiting(late, LW_WAITING_FIRST_LIGHT, 0.5f);
    lw_waiting_raise(&waiting, LW_WAITING_READY, 1, 1);
    pass_a_wait();
    expect_silence(early); /* nothing has been published yet */
    publish(f, make_snapshot(f, 7, 0));
    expect_waiting(early, LW_WAITING_READY, 1);
    expect_light(f, early, 7);
    expect_waiting(late, LW_WAITING_READY, 1);
    expect_light(f, late, 7);
    const int last = dial_and_stream(f);
    expect_light(f, last, 7); /* it never waits */
    pass_a_wait();
    expect_silence(early);
    expect_silence(last);
    expect_silence(none);
    close(none);
    close(early);
    close(late);
    close(last);
    end(f);
}

static void test_package_from_offset(void **state) {
    (void)state;
    struct fixture *f = start(&(struct lw_server_desc){0});
    static uint8_t whole[PACKAGE_SIZE * 2], part[PACKAGE_SIZE * 2];
    const uint64_t offset = 70001;
    for (int pass = 0; pass < 2; pass++) {
        int s = dial(f);
        struct lw_message m;
        put(s, &hello);
        expect(s, LW_MESSAGE_WELCOME, &m);
        uint64_t end_offset = m.welcome.package_compressed_size, at = pass ? offset : 0;
        lw_message_finish(&m);
        ask_for_package(s, at);
        while (at < end_offset) {
            expect(s, LW_MESSAGE_PACKAGE_CHUNK, &m);
            assert_int_equal(m.package_chunk.offset, at);
            memcpy((pass ? part : whole) + at, m.package_chunk.data, m.package_chunk.size);
            at += m.package_chunk.size;
            lw_message_finish(&m);
        }
        assert_int_equal(at, end_offset);
        if (pass) assert_memory_equal(part + offset, whole + offset, end_offset - offset);
        close(s);
    }
    end(f);
}

/* Greets as one who was here before. */
/* Chunks from an offset on, but for parts whose bits are set: one for each part of so small a package. */
static void expect_parts(const struct fixture *f, uint64_t offset, uint8_t held) {
    static const struct lw_message with_parts = {
        .type = LW_MESSAGE_HELLO, .hello = {.version = LW_WIRE_VERSION, .features = LW_FEATURE_PARTS}};
    struct lw_message welcome, m;
    int s = dial(f);
    put(s, &with_parts);
    expect(s, LW_MESSAGE_WELCOME, &welcome);
    const struct lw_message_welcome *w = &welcome.welcome;
    assert_int_equal(w->part_count, 4);
    assert_true(w->features & LW_FEATURE_PARTS);
    put(s, &(struct lw_message){.type = LW_MESSAGE_PACKAGE_REQUEST, .package_request = {offset, &held, 1}});
    uint64_t begin = 0;
    for (size_t i = 0; i < w->part_count; i++) {
        const uint64_t end = begin + w->part_compressed_size[i], from = begin < offset ? offset : begin;
        begin = end;
        if (held >> i & 1 || from >= end) continue;
        expect(s, LW_MESSAGE_PACKAGE_CHUNK, &m);
        assert_int_equal(m.package_chunk.offset, from);
        assert_int_equal(m.package_chunk.size, end - from);
        uint8_t bytes[4096];
        if (from + w->part_compressed_size[i] == end) { /* all of it: a frame of its own */
            struct lw_package_hash hash;
            assert_int_equal(ZSTD_decompress(bytes, sizeof bytes, m.package_chunk.data, m.package_chunk.size),
                             w->part_size[i]);
            lw_package_hash(bytes, (size_t)w->part_size[i], &hash);
            assert_memory_equal(&hash, &w->part_hash[i], sizeof hash);
        }
        lw_message_finish(&m);
    }
    expect_silence(s);
    lw_message_finish(&welcome);
    close(s);
}

static void test_parts_of_the_package(void **state) {
    (void)state;
    struct lw_scene *scene = lw_support_everything(); /* with three textures */
    struct lw_server_desc desc = {0};
    uint8_t *package;
    lw_support_ok(lw_package_write(scene, &package, &desc.package_size, NULL), NULL);
    desc.package = package;
    struct fixture *f = start(&desc);
    for (unsigned held = 0; held < 16; held++) expect_parts(f, 0, (uint8_t)held);
    for (uint64_t offset = 1; offset < 40; offset++) expect_parts(f, offset * 17, offset % 16);
    int s = dial_and_greet_with(f, LW_FEATURE_PARTS);
    put(s, &(struct lw_message){.type = LW_MESSAGE_PACKAGE_REQUEST,
                                .package_request = {0, (const uint8_t[]){16}, 1}});
    expect_refusal(s, LW_REFUSAL_PROTOCOL); /* there is no fifth part */
    close(s);
    s = dial(f);
    put(s, &hello);
    expect_refusal(s, LW_REFUSAL_FEATURES);
    close(s);
    end(f);
    free(package);
    lw_scene_destroy(scene);
}

#define FINISH_PARTS 4u /* a head and three textures */

static void add_finishes(struct lw_server_desc *desc, struct lw_scene **out_scene) {
    uint8_t *bytes;
    *out_scene = lw_support_everything();
    lw_support_add_finishes(*out_scene);
    lw_support_ok(lw_finish_package_write(*out_scene, &bytes, &desc->finishes_size, NULL), NULL);
    desc->finishes = bytes;
}

static int dial_with_materials(const struct fixture *f, struct lw_message *out_welcome) {
    int s = dial(f);
    put(s, &(struct lw_message){.type = LW_MESSAGE_HELLO,
                                .hello = {.version = LW_WIRE_VERSION, .features = LW_FEATURE_MATERIALS}});
    expect(s, LW_MESSAGE_WELCOME, out_welcome);
    return s;
}

static void ask_for_finishes(int s, uint64_t offset, uint8_t held) {
    put(s, &(struct lw_message){.type = LW_MESSAGE_FINISH_REQUEST, .finish_request = {offset, &held, 1}});
}

/* Welcome and package are those of a server without finishes, but for the session and the run. */
static void test_who_knows_no_finishes_hears_of_none(void **state) {
    (void)state;
    struct lw_message of[2];
    for (int with = 0; with < 2; with++) {
        struct lw_server_desc desc = {0};
        struct lw_scene *scene = NULL;
        if (with) add_finishes(&desc, &scene);
        struct fixture *f = start(&desc);
        int s = dial(f);
        put(s, &hello);
        expect(s, LW_MESSAGE_WELCOME, &of[with]);
        assert_int_equal(of[with].welcome.features, 0);
        assert_int_equal(of[with].welcome.finish.size, 0);
        if (with) { /* nor may it ask */
            ask_for_package(s, of[with].welcome.package_compressed_size);
            ask_for_finishes(s, 0, 0);
            expect_refusal(s, LW_REFUSAL_PROTOCOL);
        } else {
            close(s);
            s = dial_with_materials(f, &of[1]); /* a server without any */
            assert_int_equal(of[1].welcome.features, 0);
            assert_int_equal(of[1].welcome.finish.size, 0);
            lw_message_finish(&of[1]);
            close(s);
        }
        end(f);
        free((void *)desc.finishes);
        lw_scene_destroy(scene);
    }
    assert_memory_equal(&of[0].welcome.package_hash, &of[1].welcome.package_hash,
                        sizeof of[0].welcome.package_hash);
    assert_int_equal(of[0].welcome.package_size, of[1].welcome.package_size);
    assert_int_equal(of[0].welcome.package_compressed_size, of[1].welcome.package_compressed_size);
    for (int i = 0; i < 2; i++) lw_message_finish(&of[i]);
}

/* Chunks from an offset on, but for held parts, whose bytes are those of the package; behind the first
 * light. */
static void expect_finishes(const struct fixture *f, const struct lw_server_desc *desc, uint64_t offset,
                            uint8_t held) {
    struct lw_message welcome, m;
    int s = dial_with_materials(f, &welcome);
    const struct lw_message_package *told = &welcome.welcome.finish;
    struct lw_package_hash hash;
    lw_package_hash(desc->finishes, desc->finishes_size, &hash);
    assert_int_equal(welcome.welcome.features, LW_FEATURE_MATERIALS);
    assert_memory_equal(&told->hash, &hash, sizeof hash);
    assert_int_equal(told->size, desc->finishes_size);
    assert_int_equal(told->part_count, FINISH_PARTS);
    ask_for_package(s, welcome.welcome.package_compressed_size);
    ask_for_finishes(s, offset, held);
    expect_frame(s, 7, 1);
    expect_tiles(s, OBJECTS, 7); /* of the coarsest levels */
    uint64_t begin = 0, at = 0;
    uint32_t tiles = OBJECTS;
    for (size_t i = 0; i < told->part_count; i++) {
        const uint64_t end = begin + told->part_compressed_size[i], from = begin < offset ? offset : begin;
        begin = end;
        at += told->part_size[i];
        if (held >> i & 1 || from >= end) continue;
        for (;; lw_message_finish(&m), tiles++) { /* tiles go on beside them */
            assert_true(get(s, &m));
            if (m.type != LW_MESSAGE_TILE) break;
        }
        if (m.type == LW_MESSAGE_SETTLED) {
            lw_message_finish(&m);
            assert_true(get(s, &m));
        }
        assert_int_equal(m.type, LW_MESSAGE_FINISH_CHUNK);
        assert_int_equal(m.finish_chunk.offset, from);
        assert_int_equal(m.finish_chunk.size, end - from);
        uint8_t bytes[4096];
        if (from + told->part_compressed_size[i] == end) { /* all of it: a frame of its own */
            assert_int_equal(ZSTD_decompress(bytes, sizeof bytes, m.finish_chunk.data, m.finish_chunk.size),
                             told->part_size[i]);
            assert_memory_equal(bytes, desc->finishes + at - told->part_size[i], told->part_size[i]);
        }
        lw_message_finish(&m);
    }
    lw_message_finish(&welcome);
    close(s);
}

static void test_finishes(void **state) {
    (void)state;
    struct lw_scene *scene;
    struct lw_server_desc desc = {0};
    add_finishes(&desc, &scene);
    struct fixture *f = start(&desc);
    publish(f, make_snapshot(f, 7, 0));
    for (unsigned held = 0; held < 1u << FINISH_PARTS; held += 3) expect_finishes(f, &desc, 0, (uint8_t)held);
    for (uint64_t offset = 1; offset < 40; offset += 6) expect_finishes(f, &desc, offset * 7, offset % 16);
    end(f);
    free((void *)desc.finishes);
    lw_scene_destroy(scene);
}

/* Asked for long before there is light, they come behind it, and then a chunk for each tile that waits. */
static void test_finishes_wait_for_the_first_light(void **state) {
    (void)state;
    struct lw_scene *scene;
    struct lw_server_desc desc = {0};
    struct lw_message welcome, m;
    add_finishes(&desc, &scene);
    struct fixture *f = start(&desc);
    int s = dial_with_materials(f, &welcome);
    ask_for_package(s, welcome.welcome.package_compressed_size);
    ask_for_finishes(s, 0, 0);
    lw_message_finish(&welcome);
    expect_silence(s);
    publish(f, make_snapshot(f, 7, 0));
    expect_frame(s, 7, 1);
    expect_tiles(s, OBJECTS, 7); /* of the coarsest levels */
    for (unsigned i = 0; i < FINISH_PARTS; i++) {
        expect(s, LW_MESSAGE_FINISH_CHUNK, &m);
        assert_true(LW_SESSION_TILES_FIRST * m.finish_chunk.size < PAYLOAD_SIZE);
        lw_message_finish(&m);
        expect_tiles(s, 1, 7);
    }
    expect_tiles(s, f->map.tile_count - OBJECTS - FINISH_PARTS, 7);
    close(s);
    end(f);
    free((void *)desc.finishes);
    lw_scene_destroy(scene);
}

/* What makes no sense is refused. */
static void test_finishes_out_of_order(void **state) {
    (void)state;
    struct lw_scene *scene;
    struct lw_server_desc desc = {0};
    add_finishes(&desc, &scene);
    struct fixture *f = start(&desc);
    for (int wrong = 0; wrong < 4; wrong++) {
        struct lw_message welcome;
        int s = dial_with_materials(f, &welcome);
        const uint64_t end = welcome.welcome.finish.compressed_size;
        if (wrong) ask_for_package(s, welcome.welcome.package_compressed_size);
        if (wrong == 1) ask_for_finishes(s, end, 0); /* and then again */
        ask_for_finishes(s, wrong == 2 ? end + 1 : 0, wrong == 3 ? 1u << FINISH_PARTS : 0);
        expect_refusal(s, LW_REFUSAL_PROTOCOL);
        lw_message_finish(&welcome);
    }
    end(f);
    free((void *)desc.finishes);
    lw_scene_destroy(scene);
}

static int dial_again(const struct fixture *f, struct lw_message_welcome *out_welcome) {
    int s = dial(f);
    struct lw_message m;
    put(s, &hello_again);
    expect(s, LW_MESSAGE_WELCOME, &m);
    assert_int_equal(m.welcome.features, LW_FEATURE_RESUME);
    *out_welcome = m.welcome;
    lw_message_finish(&m);
    return s;
}

static void test_what_is_held_is_not_sent(void **state) {
    (void)state;
    struct fixture *f = start(&(struct lw_server_desc){0});
    struct lw_message_welcome welcome, other;
    publish(f, make_snapshot(f, 7, 0));
    publish(f, make_snapshot(f, 9, 7));
    int s = dial_and_stream(f);
    expect_frame(s, 9, 1);
    close(s);
    static struct lw_message_held held[13 * OBJECTS];
    for (uint32_t t = 0; t < f->map.tile_count; t++) {
        const struct lw_tile_place *p = &f->map.place[t];
        const struct lw_atlas_level *level = &f->map.atlas[p->object].level[p->level];
        held[t] = (struct lw_message_held){p->object, p->level, p->y * level->tiles_x + p->x, 9};
    }
    held[3].version = 7; /* an older one */
    s = dial_again(f, &welcome);
    assert_true(welcome.run != 0);
    /* in two messages; all but the last three tiles */
    put(s, &(struct lw_message){.type = LW_MESSAGE_HOLDS, .holds = {held, 5}});
    put(s, &(struct lw_message){.type = LW_MESSAGE_HOLDS, .holds = {held + 5, f->map.tile_count - 8}});
    ask_for_package(s, welcome.package_compressed_size);
    expect_frame(s, 9, 1);
    expect_tiles(s, 4, 9);
    expect_silence(s);
    close(s);
    /* what cannot be is refused */
    struct lw_message_held wrong[4] = {held[0], held[0], held[0], held[0]};
    wrong[0].version = 10;
    wrong[1].object = OBJECTS;
    wrong[2].level = 7;
    wrong[3].version = UINT64_MAX;
    for (int i = 0; i < 4; i++) {
        s = dial_again(f, &other);
        assert_int_equal(other.run, welcome.run);
        put(s, &(struct lw_message){.type = LW_MESSAGE_HOLDS, .holds = {&wrong[i], 1}});
        expect_refusal(s, LW_REFUSAL_PROTOCOL);
    }
    /* too late; without the feature */
    s = dial_again(f, &other);
    ask_for_package(s, welcome.package_compressed_size);
    put(s, &(struct lw_message){.type = LW_MESSAGE_HOLDS, .holds = {held, 1}});
    expect_refusal(s, LW_REFUSAL_PROTOCOL);
    s = dial_and_greet(f);
    put(s, &(struct lw_message){.type = LW_MESSAGE_HOLDS, .holds = {held, 1}});
    expect_refusal(s, LW_REFUSAL_PROTOCOL);
    end(f);
    /* before there is light nobody has any */
    f = start(&(struct lw_server_desc){0});
    s = dial_again(f, &other);
    assert_int_not_equal(other.run, welcome.run);
    put(s, &(struct lw_message){.type = LW_MESSAGE_HOLDS, .holds = {held, 1}});
    expect_refusal(s, LW_REFUSAL_PROTOCOL);
    end(f);
}

static void test_newer_snapshot(void **state) {
    (void)state;
    struct fixture *f = start(&(struct lw_server_desc){0});
    int s = dial_and_stream(f);
    expect_silence(s); /* nothing is published yet */
    struct lw_snapshot *first = make_snapshot(f, 1, 0);
    lw_server_publish(f->server, first);
    expect_light(f, s, 1);
    struct lw_snapshot *second = make_snapshot(f, 2, 1); /* one tile changes, the rest stay as they are */
    for (uint32_t t = 0; t < f->map.tile_count; t++) {
        if (t == 5) continue;
        lw_blob_unref(second->tile[form][t].blob);
        second->tile[form][t] =
            (struct lw_snapshot_tile){.version = 1, .blob = lw_blob_ref(first->tile[form][t].blob)};
    }
    lw_snapshot_unref(first);
    publish(f, second);
    expect_frame(s, 2, 2);
    expect_tiles(s, 1, 2);
    publish(f, make_snapshot(f, 5, 4)); /* builds on a frame that this session never had */
    expect_light(f, s, 5);
    expect_silence(s);
    close(s);
    end(f);
}

/* Who has the version that a delta builds on gets the delta; who joins or missed it gets the tile whole. */
static void test_deltas(void **state) {
    (void)state;
    struct fixture *f = start(&(struct lw_server_desc){0});
    int early = dial_and_stream(f);
    publish(f, make_snapshot(f, 1, 0));
    expect_light(f, early, 1);
    struct lw_snapshot *second = make_snapshot(f, 2, 1);
    for (uint32_t t = 0; t < f->map.tile_count; t++) {
        struct lw_message m;
        struct lw_framing_header header;
        const struct lw_blob *blob = second->tile[form][t].blob;
        lw_support_ok(lw_framing_read_header(blob->bytes, LW_FRAMING_BODY_MAX, &header, NULL), NULL);
        lw_support_ok(lw_message_decode(header, blob->bytes + LW_FRAMING_HEADER_SIZE, &m, NULL), NULL);
        m.tile.base = 1;
        second->tile[form][t].delta = blob_of(&m);
        second->tile[form][t].base = t == 5 ? 7 : 1;
        lw_message_finish(&m);
    }
    lw_server_publish(f->server, second);
    int late = dial_and_stream(f);
    for (int i = 0; i < 2; i++) {
        expect_frame(i ? late : early, 2, i ? 1 : 2);
        uint32_t deltas = 0;
        for (uint32_t t = 0; t < f->map.tile_count; t++) {
            struct lw_message m;
            expect(i ? late : early, LW_MESSAGE_TILE, &m);
            assert_int_equal(m.tile.version, 2);
            deltas += m.tile.base == 1;
            lw_message_finish(&m);
        }
        assert_int_equal(deltas, i ? 0 : f->map.tile_count - 1);
    }
    lw_snapshot_unref(second);
    close(late);
    close(early);
    end(f);
}

static struct lw_snapshot *make_settling(const struct fixture *f, uint64_t frame, uint64_t previous) {
    struct lw_snapshot *snapshot = make_snapshot(f, frame, previous);
    snapshot->settled = blob_of(&(struct lw_message){.type = LW_MESSAGE_SETTLED, .settled.frame = frame});
    return snapshot;
}

static void expect_settled(int s, uint64_t frame) {
    struct lw_message m;
    expect(s, LW_MESSAGE_SETTLED, &m);
    assert_int_equal(m.settled.frame, frame);
    lw_message_finish(&m);
}

/* A session that lacks two versions takes two deltas, if they are fewer bytes than the tile and no single
 * delta is there. */
static void test_deltas_to_catch_up(void **state) {
    (void)state;
    enum { FRAMES = 4 };
    static const uint8_t little[100] = {1};
    struct fixture *f = start(&(struct lw_server_desc){0});
    struct lw_message_welcome welcome;
    struct lw_message m;
    close(dial_again(f, &welcome));
    for (uint64_t frame = 1; frame <= FRAMES; frame++) { /* of tile 0 of object 0 there are deltas */
        struct lw_snapshot *snapshot = make_snapshot(f, frame, frame - 1);
        if (frame > 1) {
            snapshot->tile[form][0].base = frame - 1;
            snapshot->tile[form][0].delta =
                blob_of(&(struct lw_message){.type = LW_MESSAGE_TILE,
                                             .tile = {.layer = form,
                                                      .version = frame,
                                                      .base = frame - 1,
                                                      .codec = 3,
                                                      .scale = 1,
                                                      .payload = little,
                                                      .payload_size = sizeof little}});
        }
        publish(f, snapshot);
        int s = dial_and_stream(f); /* so that the loop has seen it */
        expect_frame(s, frame, 1);
        close(s);
    }
    static const struct lw_message_interest_tile wanted[] = {{0, 0, 0}};
    for (uint64_t held = 1; held < FRAMES; held++) {
        const struct lw_message_held tile[] = {{0, 0, 0, held}};
        int s = dial_again(f, &welcome);
        put(s,
            &(struct lw_message){.type = LW_MESSAGE_INTEREST, .interest = {.tile = wanted, .tile_count = 1}});
        put(s, &(struct lw_message){.type = LW_MESSAGE_HOLDS, .holds = {tile, 1}});
        ask_for_package(s, welcome.package_compressed_size);
        expect_frame(s, FRAMES, 1);
        for (uint64_t version = held + 1; version <= FRAMES; version++) {
            expect(s, LW_MESSAGE_TILE, &m);
            assert_true(m.tile.version == version && m.tile.base == version - 1);
            lw_message_finish(&m);
        }
        expect_silence(s);
        close(s);
    }
    end(f);
}

/* A snapshot whose tile 0 is real light that moves a little from version to version. */
static struct lw_snapshot *make_moving(const struct fixture *f, struct lw_tile_codec *codec,
                                       struct lw_tile_dct_history *history, uint64_t frame,
                                       uint64_t previous) {
    static float rgb[LW_TILE_TEXELS_MAX * 3];
    const struct lw_tile_place *place = &f->map.place[0];
    const size_t capacity = lw_tile_codec_bound();
    uint8_t *payload = malloc(capacity), *delta = malloc(capacity);
    assert_true(payload && delta);
    for (uint32_t i = 0; i < place->width * place->height * 3; i++)
        rgb[i] = 2 + sinf((float)(i * 7)) + 0.3f * sinf((float)i * 0.1f + (float)frame);
    struct lw_tile_dct_coded coded;
    lw_support_ok(lw_tile_codec_encode_dct(
                      codec,
                      &(struct lw_tile_dct_source){rgb, NULL, place->width, place->height, 0.1f, 0, NULL},
                      history, payload, delta, capacity, &coded),
                  NULL);
    struct lw_snapshot *snapshot = make_snapshot(f, frame, previous);
    struct lw_message m = {.type = LW_MESSAGE_TILE,
                           .tile = {.layer = form,
                                    .version = frame,
                                    .codec = LW_TILE_CODEC_DCT,
                                    .scale = coded.scale,
                                    .payload = payload,
                                    .payload_size = coded.size}};
    lw_blob_unref(snapshot->tile[form][0].blob);
    snapshot->tile[form][0].blob = blob_of(&m);
    if (coded.delta_size) {
        m.tile.base = snapshot->tile[form][0].base = previous;
        m.tile.payload = delta;
        m.tile.payload_size = coded.delta_size;
        snapshot->tile[form][0].delta = blob_of(&m);
    }
    free(delta);
    free(payload);
    return snapshot;
}

/* A session that lacks several versions takes one delta over all of them, made for the first who wants it and
 * the same for the next; SETTLED waits for it. */
static void test_a_jump_to_catch_up(void **state) {
    (void)state;
    enum { FRAMES = 6 };
    static struct lw_tile_dct_history history;
    static const struct lw_message_interest_tile wanted[] = {{0, 0, 0}};
    struct fixture *f = start(&(struct lw_server_desc){.features = LW_FEATURE_DCT});
    struct lw_tile_codec *codec;
    lw_support_ok(lw_tile_codec_create(&codec), NULL);
    memset(&history, 0, sizeof history);
    for (uint64_t frame = 1; frame <= FRAMES; frame++) {
        struct lw_snapshot *snapshot = make_moving(f, codec, &history, frame, frame - 1);
        if (frame == FRAMES)
            snapshot->settled =
                blob_of(&(struct lw_message){.type = LW_MESSAGE_SETTLED, .settled.frame = frame});
        publish(f, snapshot);
        int s = dial_and_greet_with(f, LW_FEATURE_DCT);
        ask_for_package(s, PACKAGE_SIZE); /* so that the loop has seen it */
        wait_for_frame(s, frame);
        close(s);
    }
    for (int i = 0; i < 2; i++) {
        const struct lw_message_held tile[] = {{0, 0, 0, 2}};
        int s = dial(f);
        struct lw_message m;
        put(s, &(struct lw_message){
                   .type = LW_MESSAGE_HELLO,
                   .hello = {.version = LW_WIRE_VERSION, .features = LW_FEATURE_DCT | LW_FEATURE_RESUME}});
        expect(s, LW_MESSAGE_WELCOME, &m);
        const uint64_t end_of_package = m.welcome.package_compressed_size;
        lw_message_finish(&m);
        put(s,
            &(struct lw_message){.type = LW_MESSAGE_INTEREST, .interest = {.tile = wanted, .tile_count = 1}});
        put(s, &(struct lw_message){.type = LW_MESSAGE_HOLDS, .holds = {tile, 1}});
        ask_for_package(s, end_of_package);
        expect_frame(s, FRAMES, 1);
        expect(s, LW_MESSAGE_TILE, &m);
        assert_int_equal(m.tile.base, 2);
        assert_int_equal(m.tile.version, FRAMES);
        lw_message_finish(&m);
        expect_settled(s, FRAMES);
        expect_silence(s);
        close(s);
    }
    lw_tile_codec_destroy(codec);
    end(f);
}

/* Whose link takes less than changes gets tiles in wider steps, and what they leave out once nothing changes
 * any more; that is when all has been sent. */
static void test_a_narrow_link(void **state) {
    (void)state;
    enum { FRAMES = 10 };
    static struct lw_tile_dct_history history;
    static const struct lw_message_interest_tile wanted[] = {{0, 0, 0}};
    struct fixture *f =
        start(&(struct lw_server_desc){.features = LW_FEATURE_DCT, .rate_limit_bytes_hz = 20000});
    struct lw_tile_codec *codec;
    struct lw_message m;
    lw_support_ok(lw_tile_codec_create(&codec), NULL);
    memset(&history, 0, sizeof history);
    int s = dial(f);
    put(s, &(struct lw_message){.type = LW_MESSAGE_HELLO,
                                .hello = {.version = LW_WIRE_VERSION, .features = LW_FEATURE_DCT}});
    expect(s, LW_MESSAGE_WELCOME, &m);
    const uint64_t end_of_package = m.welcome.package_compressed_size;
    lw_message_finish(&m);
    put(s, &(struct lw_message){.type = LW_MESSAGE_INTEREST, .interest = {.tile = wanted, .tile_count = 1}});
    ask_for_package(s, end_of_package);
    int witness = dial_and_greet_with(f, LW_FEATURE_DCT);
    put(witness, &(struct lw_message){.type = LW_MESSAGE_INTEREST});
    ask_for_package(witness, end_of_package);
    for (uint64_t frame = 2; frame <= 2 * FRAMES; frame += 2) {
        struct lw_snapshot *snapshot = make_moving(f, codec, &history, frame, frame - 2);
        snapshot->settled = blob_of(&(struct lw_message){.type = LW_MESSAGE_SETTLED, .settled.frame = frame});
        publish(f, snapshot);
        wait_for_frame(witness, frame);
        server_clock_step(20);
    }
    close(witness);
    is_paced = true;
    size_t coarse_bytes = 0, bytes = 0;
    uint64_t version = 0;
    bool settled = false;
    while (!settled) {
        assert_true(get(s, &m));
        settled = m.type == LW_MESSAGE_SETTLED && m.settled.frame == 2 * FRAMES;
        if (m.type == LW_MESSAGE_TILE) {
            assert_true(m.tile.version > version);
            version = m.tile.version;
            if (!m.tile.base)
                *(lw_snapshot_is_coarse(version) ? &coarse_bytes : &bytes) = m.tile.payload_size;
        }
        lw_message_finish(&m);
    }
    assert_int_equal(version, 2 * FRAMES);
    assert_true(coarse_bytes > 0 && coarse_bytes < 2 * bytes / 3);
    close(s);
    lw_tile_codec_destroy(codec);
    end(f);
}

/* Once per frame, after its last tile; again after an INTEREST. */
static void test_settled(void **state) {
    (void)state;
    struct fixture *f = start(&(struct lw_server_desc){0});
    int s = dial_and_stream(f);
    for (uint64_t frame = 1; frame <= 3; frame++) {
        publish(f, make_settling(f, frame, frame - 1));
        expect_frame(s, frame, frame == 1 ? 1 : 2);
        expect_tiles(s, f->map.tile_count, frame);
        expect_settled(s, frame);
        expect_silence(s);
    }
    put(s, &(struct lw_message){.type = LW_MESSAGE_INTEREST});
    expect_settled(s, 3);
    publish(f, make_settling(f, 4, 3));
    expect_frame(s, 4, 2);
    expect_settled(s, 4); /* nothing is wanted of it */
    put(s, &(struct lw_message){.type = LW_MESSAGE_INTEREST, .interest.everything = true});
    expect_tiles(s, f->map.tile_count, 4);
    expect_settled(s, 4);
    expect_silence(s);
    close(s);
    end(f);
}

/* Stand-ins: every object's coarsest level, and what covers the same as a listed tile on coarser ones. */
static void test_stand_ins(void **state) {
    (void)state;
    struct fixture *f = start(&(struct lw_server_desc){0});
    int s = dial_and_greet(f);
    /* one twice; one before and one after those that it stands in for */
    const struct lw_message_interest_tile wanted[] = {{1, 3, 0}, {1, 0, 7}, {1, 0, 7}, {1, 1, 0}, {1, 2, 0}};
    put(s, &(struct lw_message){.type = LW_MESSAGE_INTEREST,
                                .interest = {.tile = wanted, .tile_count = 5, .stand_ins = true}});
    ask_for_package(s, PACKAGE_SIZE);
    publish(f, make_snapshot(f, 2, 0));
    struct lw_message m;
    do {
        assert_true(get(s, &m));
        lw_message_finish(&m);
    } while (m.type != LW_MESSAGE_FRAME);
    /* three coarsest; levels 3 and 2 of object 1; both tiles of its level 1; one of level 0 */
    expect_tiles(s, 3 + 2 + 2 + 1, 2);
    expect_silence(s);
    put(s, &(struct lw_message){.type = LW_MESSAGE_INTEREST, .interest = {.stand_ins = true}});
    put(s, &(struct lw_message){.type = LW_MESSAGE_PING});
    expect(s, LW_MESSAGE_PONG, &m); /* so it has been heard */
    lw_message_finish(&m);
    publish(f, make_snapshot(f, 4, 2));
    expect_frame(s, 4, 2);
    expect_tiles(s, 3, 4);
    expect_silence(s);
    close(s);
    end(f);
}

/* What views do not read is sent again once it is far off, or old; what they may read, with every version. */
static void test_stand_ins_wait(void **state) {
    (void)state;
    struct fixture *f = start(&(struct lw_server_desc){0});
    int s = dial_and_greet(f);
    const struct lw_message_interest_tile wanted[] = {{1, 0, 7}};
    put(s, &(struct lw_message){.type = LW_MESSAGE_INTEREST,
                                .interest = {.tile = wanted, .tile_count = 1, .stand_ins = true}});
    ask_for_package(s, PACKAGE_SIZE);
    const uint64_t far = 3, old = far + 2 * LW_PRIORITY_STAND_IN_FRAMES; /* versions, two a frame */
    for (uint64_t frame = 1; frame <= old; frame++) {
        struct lw_snapshot *snapshot = make_snapshot(f, frame, frame - 1);
        for (uint32_t t = 0; t < f->map.tile_count; t++)
            snapshot->tile[form][t].change =
                frame == far ? 2 * LW_PRIORITY_STAND_IN_OFF : LW_PRIORITY_STAND_IN_OFF / 10;
        publish(f, snapshot);
        struct lw_message m;
        do {
            assert_true(get(s, &m));
            lw_message_finish(&m);
        } while (m.type != LW_MESSAGE_FRAME);
        /* the tile itself and levels 1 and 2 above it, which views may read; level 3 and all coarsest */
        expect_tiles(s, frame == 1 || frame == far || frame == old ? 3 + 1 + 3 : 3, frame);
        expect_silence(s);
    }
    close(s);
    end(f);
}

/* Waits for news of the interest sets, and expects `tiles` level-0 tiles in their union; UINT32_MAX:
 * everything. */
static void expect_wanted(const struct fixture *f, uint32_t tiles) {
    struct lw_server_interest wanted;
    LW_SUPPORT_WAIT_UNTIL(lw_server_take_interest(f->server, &wanted));
    uint32_t count = 0;
    for (uint32_t t = 0; !wanted.everything && t < f->map.tile_count; t++) count += wanted.levels[t] > 0;
    assert_int_equal(wanted.everything ? UINT32_MAX : count, tiles);
    free(wanted.levels);
}

static void want(int s, const struct lw_message_interest_tile *tile, size_t count) {
    put(s, &(struct lw_message){.type = LW_MESSAGE_INTEREST,
                                .interest = {.tile = tile, .tile_count = count, .stand_ins = true}});
}

static void test_union_of_interest(void **state) {
    (void)state;
    struct fixture *f = start(&(struct lw_server_desc){0});
    struct lw_server_interest none;
    const struct lw_message_interest_tile corner[] = {{1, 0, 7}}, half[] = {{1, 1, 1}, {0, 0, 0}};
    assert_false(lw_server_take_interest(f->server, &none));
    int first = dial_and_greet(f), second = dial_and_greet(f), third = dial_and_greet(f);
    want(first, corner, 1);
    ask_for_package(first, PACKAGE_SIZE);
    expect_wanted(f, 1);
    want(second, half, 2);
    ask_for_package(second, PACKAGE_SIZE);
    expect_wanted(f, 5); /* the half of 4 holds the corner */
    ask_for_package(third, PACKAGE_SIZE);
    expect_wanted(f, UINT32_MAX);
    close(third);
    expect_wanted(f, 5);
    close(second);
    expect_wanted(f, 1);
    want(first, NULL, 0);
    expect_wanted(f, 0);
    close(first);
    end(f);
}

struct flood_of_interest {
    int s;
    const struct lw_message_interest_tile *tile;
};

static void *change_mind(void *context) {
    const struct flood_of_interest *say = context;
    for (unsigned i = 0; i < 50; i++) want(say->s, say->tile, LW_MESSAGE_INTEREST_MAX - i);
    want(say->s, say->tile, 1);
    return NULL;
}

/* Who changes its mind a thousand times between two frames is heard once, with what it said last; nobody else
 * waits. */
static void test_flood_of_interest(void **state) {
    (void)state;
    struct fixture *f = start(&(struct lw_server_desc){0});
    int flood = dial_and_greet(f), good = dial_and_stream(f);
    static struct lw_message_interest_tile tile[LW_MESSAGE_INTEREST_MAX];
    for (uint32_t i = 0; i < LW_MESSAGE_INTEREST_MAX; i++)
        tile[i] = (struct lw_message_interest_tile){i % OBJECTS, 0, i % 7};
    ask_for_package(flood, PACKAGE_SIZE);
    pthread_t sender; /* the server does not read on until time goes on */
    struct flood_of_interest say = {flood, tile};
    assert_int_equal(pthread_create(&sender, NULL, change_mind, &say), 0);
    publish(f, make_snapshot(f, 1, 0));
    expect_light(f, good, 1);
    close(good);
    struct lw_server_interest wanted = {0};
    unsigned news = 0;
    for (uint32_t count = 0; count != 1;) { /* everything, then as it comes, then one tile */
        if (!lw_server_take_interest(f->server, &wanted)) {
            server_clock_step(STEP_MS);
            continue;
        }
        count = wanted.everything ? UINT32_MAX : 0;
        for (uint32_t t = 0; !wanted.everything && t < f->map.tile_count; t++) count += wanted.levels[t] > 0;
        free(wanted.levels);
        assert_true(++news < 200);
    }
    assert_int_equal(pthread_join(sender, NULL), 0);
    close(flood);
    end(f);
}

static void test_interest(void **state) {
    (void)state;
    struct fixture *f = start(&(struct lw_server_desc){0});
    int s = dial_and_greet(f);
    const struct lw_message_interest_tile wanted[] = {{1, 0, 7}, {2, 4, 0}};
    put(s, &(struct lw_message){.type = LW_MESSAGE_INTEREST, .interest = {.tile = wanted, .tile_count = 2}});
    ask_for_package(s, PACKAGE_SIZE);
    publish(f, make_snapshot(f, 1, 0));
    struct lw_message m;
    do {
        assert_true(get(s, &m));
        lw_message_finish(&m);
    } while (m.type != LW_MESSAGE_FRAME);
    expect(s, LW_MESSAGE_TILE, &m);
    assert_int_equal(m.tile.object, 2);
    assert_int_equal(m.tile.level, 4);
    lw_message_finish(&m);
    expect(s, LW_MESSAGE_TILE, &m);
    assert_int_equal(m.tile.object, 1);
    assert_int_equal(m.tile.tile, 7);
    lw_message_finish(&m);
    expect_silence(s);
    put(s, &(struct lw_message){.type = LW_MESSAGE_INTEREST, .interest.everything = true});
    expect_tiles(s, f->map.tile_count - 2, 1); /* what it has is not sent again */
    put(s, &(struct lw_message){.type = LW_MESSAGE_INTEREST});
    put(s, &(struct lw_message){.type = LW_MESSAGE_PING, .ping.token = CLIENT_TOKEN});
    expect(s, LW_MESSAGE_PONG, &m);
    assert_int_equal(m.pong.token, CLIENT_TOKEN);
    lw_message_finish(&m);
    publish(f, make_snapshot(f, 2, 1));
    expect_frame(s, 2, 2);
    expect_silence(s); /* an empty list stops tiles */
    const struct lw_message_interest_tile unknown = {1, 0, 8};
    put(s,
        &(struct lw_message){.type = LW_MESSAGE_INTEREST, .interest = {.tile = &unknown, .tile_count = 1}});
    expect_refusal(s, LW_REFUSAL_PROTOCOL);
    end(f);
}

/* ---- sharing and isolation ---- */

static void test_blobs_are_shared(void **state) {
    (void)state;
    struct fixture *f = start(&(struct lw_server_desc){0});
    enum { SLOW = 4 };
    int slow[SLOW];
    for (int i = 0; i < SLOW; i++) slow[i] = dial_with_buffer(f, 4096);
    for (int i = 0; i < SLOW; i++) {
        put(slow[i], &hello);
        ask_for_package(slow[i], PACKAGE_SIZE);
    }
    wait_for_sessions(f, SLOW);
    struct lw_snapshot *snapshot = make_snapshot(f, 1, 0);
    lw_server_publish(f->server, snapshot);
    /* the links hold back, so the server holds references: to one blob, not to copies */
    uint32_t most = 0;
    while (most < 1 + SLOW) {
        most = 0;
        for (uint32_t t = 0; t < snapshot->tile_count; t++) {
            uint32_t references = snapshot->tile[form][t].blob->references;
            if (references > most) most = references;
        }
        lw_support_pause();
    }
    for (int i = 0; i < SLOW; i++) close(slow[i]);
    wait_for_sessions(f, 0);
    lw_server_stop(f->server);
    join(f);
    for (uint32_t t = 0; t < snapshot->tile_count; t++)
        assert_int_equal(snapshot->tile[form][t].blob->references, 1);
    assert_int_equal(snapshot->references, 1);
    lw_snapshot_unref(snapshot);
    discard(f);
}

static void test_slow_reader(void **state) {
    (void)state;
    struct fixture *f = start(&(struct lw_server_desc){0});
    int slow = dial_with_buffer(f, 4096);
    put(slow, &hello);
    ask_for_package(slow, PACKAGE_SIZE);
    wait_for_sessions(f, 1);
    int fast = dial_and_stream(f);
    const uint64_t frames = 30;
    for (uint64_t frame = 1; frame <= frames; frame++) {
        publish(f, make_snapshot(f, frame, frame - 1));
        expect_frame(fast, frame, frame == 1 ? 1 : 2); /* at once: no time goes by */
        expect_tiles(fast, f->map.tile_count, frame);
    }
    /* the slow one gets the newest in the end, and fewer tiles than there were: it skipped versions */
    struct lw_message m;
    uint64_t tiles = 0, newest[13 * OBJECTS] = {0};
    for (uint32_t complete = 0; complete < f->map.tile_count;) {
        assert_true(get(slow, &m));
        if (m.type == LW_MESSAGE_TILE) {
            uint32_t id = f->map.first_tile[m.tile.object] +
                          f->map.atlas[m.tile.object].level[m.tile.level].first_tile + m.tile.tile;
            assert_true(m.tile.version > newest[id]);
            newest[id] = m.tile.version;
            complete += newest[id] == frames;
            tiles++;
        }
        lw_message_finish(&m);
    }
    assert_true(tiles < frames * f->map.tile_count / 2);
    close(slow);
    close(fast);
    end(f);
}

static void test_stalled_reader_is_closed(void **state) {
    (void)state;
    struct fixture *f = start(&(struct lw_server_desc){.stall_timeout_ms = 1500});
    int slow = dial_with_buffer(f, 4096), idle = dial_and_stream(f);
    put(slow, &hello);
    ask_for_package(slow, PACKAGE_SIZE);
    wait_for_sessions(f, 2);
    publish(f, make_snapshot(f, 1, 0));
    expect_light(f, idle, 1);
    unsigned waited_ms = 0;
    for (; stats_of(f).sessions_now == 2; waited_ms += 100) server_clock_step(100);
    assert_true(waited_ms >= 1500); /* or more: what the kernel acknowledges in its own time is progress */
    assert_int_equal(stats_of(f).refused, 1);
    server_clock_step(1700);
    expect_silence(idle); /* one that has nothing to get is not stalled */
    assert_int_equal(stats_of(f).sessions_now, 1);
    uint8_t byte;
    while (get_bytes(slow, &byte, 1)) {
    }
    close(slow);
    close(idle);
    end(f);
}

/* Who reads on finds the refusal behind what was on the way. */
static void expect_told(bool while_held) {
    enum { STALL_MS = 600 };
    struct fixture *f = start(&(struct lw_server_desc){.stall_timeout_ms = STALL_MS});
    int slow = dial_with_buffer(f, 4096);
    struct lw_message m;
    bool told = false;
    put(slow, &hello);
    ask_for_package(slow, PACKAGE_SIZE);
    wait_for_sessions(f, 1);
    publish(f, make_snapshot(f, 1, 0));
    while (stats_of(f).sessions_now) server_clock_step(100);
    if (while_held) /* what it says makes no difference */
        put(slow, &(struct lw_message){.type = LW_MESSAGE_PING});
    else
        while (server_clock_step(STALL_MS)) /* until its link, the only one, has been closed */
            ;
    while (get(slow, &m)) {
        assert_false(told);
        told = m.type == LW_MESSAGE_REFUSAL;
        if (told) assert_int_equal(m.refusal.code, LW_REFUSAL_TIMEOUT);
        lw_message_finish(&m);
        is_paced = told; /* then the server closes the link */
    }
    assert_true(told);
    close(slow);
    end(f);
}

static void test_a_stalled_reader_is_told(void **state) {
    (void)state;
    expect_told(true);
    expect_told(false);
}

/* ---- whose turn it is ---- */

static _Atomic bool is_gated; /* writes with light in them wait for the test, each of them */
static sem_t at_gate, let_through;

int __real_uv_try_write(uv_stream_t *stream, const uv_buf_t buffer[], unsigned count);
int __wrap_uv_try_write(uv_stream_t *stream, const uv_buf_t buffer[], unsigned count);
int __wrap_uv_try_write(uv_stream_t *stream, const uv_buf_t buffer[], unsigned count) {
    size_t size = 0;
    for (unsigned i = 0; i < count; i++) size += buffer[i].len;
    if (is_gated && size >= PAYLOAD_SIZE) {
        sem_post(&at_gate);
        sem_wait(&let_through);
        server_clock_move(10); /* that it takes */
    }
    return __real_uv_try_write(stream, buffer, count);
}

/* Handing a snapshot out takes a second; who asks for something meanwhile is not kept waiting for all of
 * it. */
static void test_questions_do_not_wait_for_a_snapshot(void **state) {
    (void)state;
    enum { READERS = 100 };
    struct fixture *f = start(&(struct lw_server_desc){0});
    struct lw_message m;
    int reader[READERS];
    for (int i = 0; i < READERS; i++) reader[i] = dial_and_stream(f);
    int s = dial_and_greet(f);
    assert_int_equal(sem_init(&at_gate, 0, 0) | sem_init(&let_through, 0, 0), 0);
    is_gated = true;
    publish(f, make_snapshot(f, 1, 0));
    sem_wait(&at_gate);
    put(s, &(struct lw_message){.type = LW_MESSAGE_PING, .ping.token = CLIENT_TOKEN});
    int newcomer = dial(f);
    put(newcomer, &hello);
    for (int writes = 0; !is_readable(s) || !is_readable(newcomer); writes++) {
        assert_true(writes < READERS);
        sem_post(&let_through);
        sem_wait(&at_gate);
    }
    int without_light = 0;
    for (int i = 0; i < READERS; i++) {
        int there = 0;
        assert_int_equal(ioctl(reader[i], FIONREAD, &there), 0);
        without_light += there == 0;
    }
    is_gated = false;
    sem_post(&let_through);
    expect(s, LW_MESSAGE_PONG, &m);
    lw_message_finish(&m);
    expect(newcomer, LW_MESSAGE_WELCOME, &m);
    lw_message_finish(&m);
    assert_true(without_light > READERS / 2);
    for (int i = 0; i < READERS; i++) {
        expect_frame(reader[i], 1, 1); /* nobody is forgotten for that */
        expect_tiles(reader[i], f->map.tile_count, 1);
        close(reader[i]);
    }
    close(newcomer);
    close(s);
    end(f);
}

/* What a limit of 1 MB/s lets through: a tenth of a second's worth at once, then that rate; who has none does
 * not notice. What is not tiles does not wait. */
static void test_rate_limits(void **state) {
    (void)state;
    static const struct {
        uint64_t of_server, of_client;
    } row[] = {{1000000, 0}, {0, 1000000}, {1000000, UINT64_MAX}, {UINT64_MAX, 1000000}};
    for (size_t i = 0; i < sizeof row / sizeof row[0]; i++) {
        struct fixture *f = start(&(struct lw_server_desc){.rate_limit_bytes_hz = row[i].of_server});
        struct lw_message m;
        is_paced = true;
        publish(f, make_snapshot(f, 1, 0));
        int s = dial(f);
        put(s, &(struct lw_message){
                   .type = LW_MESSAGE_HELLO,
                   .hello = {.version = LW_WIRE_VERSION, .rate_limit_bytes_hz = row[i].of_client}});
        expect(s, LW_MESSAGE_WELCOME, &m);
        const uint64_t began_ns = lw_clock_ns();
        ask_for_package(s, m.welcome.package_compressed_size);
        lw_message_finish(&m);
        expect_light(f, s, 1); /* 780 kB */
        const double took_s = 1e-9 * (double)(lw_clock_ns() - began_ns),
                     bytes = (double)f->map.tile_count * PAYLOAD_SIZE;
        const double least_s = (bytes - PAYLOAD_SIZE) / 1e6 - 1e-3 * LW_SERVER_BURST_MS - 0.02;
        assert_true(took_s > least_s && took_s < least_s + 0.2);
        publish(f, make_snapshot(f, 2, 1));
        expect_frame(s, 2, 2);
        publish(f, make_snapshot(f, 3, 2)); /* comes at once, though tiles are held back */
        uint32_t before = 0;
        for (bool framed = false; !framed; before += !framed) {
            assert_true(get(s, &m));
            framed = m.type == LW_MESSAGE_FRAME;
            lw_message_finish(&m);
        }
        assert_true(before < f->map.tile_count);
        expect_tiles(s, f->map.tile_count, 3); /* and the newest of each */
        close(s);
        end(f);
    }
}

/* A link that takes one tile after another gets first what has changed most; who is behind, what has since it
 * had it last. */
static void test_the_most_visible_change_goes_first(void **state) {
    (void)state;
    struct fixture *f = start(&(struct lw_server_desc){.rate_limit_bytes_hz = 10 * PAYLOAD_SIZE});
    struct lw_message m;
    is_paced = true;
    int s = dial_and_stream(f);
    publish(f, make_snapshot(f, 2, 0));
    expect_light(f, s, 2);
    /* whole tiles of level 0, one of each object, move the more the later they come; the others little */
    const uint32_t tile[OBJECTS] = {0, 13, 26};
    struct lw_snapshot *snapshot = make_snapshot(f, 4, 2);
    for (uint32_t i = 0; i < f->map.tile_count; i++) snapshot->tile[form][i].change = 0.001f;
    for (uint32_t o = 0; o < OBJECTS; o++) snapshot->tile[form][tile[o]].change = 0.1f * (float)(o + 1);
    publish(f, snapshot);
    expect_frame(s, 4, 2);
    expect(s, LW_MESSAGE_TILE, &m);
    assert_int_equal(m.tile.object, OBJECTS - 1);
    assert_int_equal(m.tile.level, 0);
    lw_message_finish(&m);
    /* now all but that one lag behind; the first moves again and overtakes the second */
    snapshot = make_snapshot(f, 6, 4);
    for (uint32_t i = 0; i < f->map.tile_count; i++) snapshot->tile[form][i].change = 0.001f;
    snapshot->tile[form][tile[0]].change = 0.2f;
    publish(f, snapshot);
    for (bool framed = false; !framed;) {
        assert_true(get(s, &m));
        framed = m.type == LW_MESSAGE_FRAME;
        if (!framed) assert_true(m.tile.version == 4); /* on its way already */
        lw_message_finish(&m);
    }
    expect(s, LW_MESSAGE_TILE, &m);
    assert_true(m.tile.version == 6 && m.tile.level == 0 && m.tile.object == 0);
    lw_message_finish(&m);
    close(s);
    end(f);
}

static void test_what_waits_is_told(void **state) {
    (void)state;
    struct fixture *f = start(&(struct lw_server_desc){0});
    struct lw_message m;
    int slow = dial_with_buffer(f, 16 << 10);
    put(slow, &hello);
    expect(slow, LW_MESSAGE_WELCOME, &m);
    ask_for_package(slow, m.welcome.package_compressed_size);
    lw_message_finish(&m);
    for (uint64_t frame = 1; !stats_of(f).waiting_bytes; frame++) {
        publish(f, make_snapshot(f, frame, frame - 1));
        server_clock_step(10);
    }
    struct lw_server_stats stats = stats_of(f);
    assert_int_equal(stats.waiting_bytes, stats.waiting_bytes_max);
    assert_in_range(stats.waiting_bytes_max, 1, LW_SERVER_QUEUE_MAX);
    assert_true(stats.socket_bytes > 0);
    close(slow);
    wait_for_sessions(f, 0);
    end(f);
}

/* ---- peers that misbehave ---- */

/* Who acknowledges what it was not sent, or goes back, is sent away; nobody else is. */
static void test_acks(void **state) {
    (void)state;
    static const struct {
        uint64_t first, second;
        bool good;
    } row[] = {{5, 5, true},  {5, 6, false}, {5, UINT64_MAX, false},
               {5, 4, false}, {0, 0, false}, {4, 5, true}};
    struct fixture *f = start(&(struct lw_server_desc){0});
    publish(f, make_snapshot(f, 5, 0));
    int witness = dial_and_stream(f);
    expect_light(f, witness, 5);
    for (size_t i = 0; i < sizeof row / sizeof row[0]; i++) {
        int s = dial_and_stream(f);
        expect_light(f, s, 5);
        put(s, &(struct lw_message){.type = LW_MESSAGE_ACK, .ack.frame = row[i].first});
        put(s, &(struct lw_message){.type = LW_MESSAGE_ACK, .ack.frame = row[i].second});
        put(s, &(struct lw_message){.type = LW_MESSAGE_PING, .ping.token = CLIENT_TOKEN});
        if (!row[i].good) {
            expect_refusal(s, LW_REFUSAL_PROTOCOL);
            continue;
        }
        struct lw_message m;
        expect(s, LW_MESSAGE_PONG, &m);
        lw_message_finish(&m);
        close(s);
    }
    int s = dial_and_greet(f); /* before there was a frame */
    put(s, &(struct lw_message){.type = LW_MESSAGE_ACK, .ack.frame = 5});
    expect_refusal(s, LW_REFUSAL_PROTOCOL);
    publish(f, make_snapshot(f, 6, 5));
    expect_frame(witness, 6, 2);
    close(witness);
    end(f);
}

/* All that a client may say, in order, with a snapshot of frame 9 in between. */
static size_t write_script(uint8_t *dst, size_t capacity, uint64_t package_compressed_size) {
    static const struct lw_message_held held[] = {{0, 0, 7, 9}, {2, 4, 0, 9}};
    static const struct lw_message_interest_tile wanted[] = {{1, 0, 3}, {0, 2, 0}};
    const struct lw_message script[] = {
        hello_again,
        {.type = LW_MESSAGE_INTEREST, .interest = {.stand_ins = true, .tile = wanted, .tile_count = 2}},
        {.type = LW_MESSAGE_HOLDS, .holds = {held, 2}},
        {.type = LW_MESSAGE_PING, .ping.token = CLIENT_TOKEN},
        {.type = LW_MESSAGE_PACKAGE_REQUEST, .package_request.offset = package_compressed_size},
        {.type = LW_MESSAGE_INTEREST, .interest.everything = true},
        {.type = LW_MESSAGE_PONG, .pong.token = 1}};
    size_t size = 0;
    for (size_t i = 0; i < sizeof script / sizeof script[0]; i++) {
        size_t message;
        lw_support_ok(lw_message_encode(&script[i], dst + size, capacity - size, &message), NULL);
        size += message;
    }
    return size;
}

/* Says these bytes and no more, and reads to the end: what the server answers is sound. Returns whether it
 * was a refusal. */
static bool recite(const struct fixture *f, const uint8_t *bytes, size_t size) {
    bool refused = false;
    struct lw_message m;
    int s = dial(f);
    put_bytes(s, bytes, size);
    assert_int_equal(shutdown(s, SHUT_WR), 0);
    /* what was on its way when the server saw our end may be cut off */
    for (uint8_t header[LW_FRAMING_HEADER_SIZE]; get_bytes(s, header, sizeof header);) {
        static uint8_t body[LW_FRAMING_BODY_MAX];
        struct lw_framing_header h;
        lw_support_ok(lw_framing_read_header(header, LW_FRAMING_BODY_MAX, &h, NULL), NULL);
        if (!get_bytes(s, body, h.body_size)) break;
        lw_support_ok(lw_message_decode(h, body, &m, NULL), NULL);
        refused = m.type == LW_MESSAGE_REFUSAL;
        lw_message_finish(&m);
    }
    close(s);
    return refused;
}

/* Cut off at every byte, every bit turned, said twice: that session ends, the others never notice. */
static void test_bytes_gone_wrong(void **state) {
    (void)state;
    struct fixture *f = start(&(struct lw_server_desc){0});
    struct lw_message_welcome welcome;
    uint8_t script[1024], wrong[1024];
    close(dial_again(f, &welcome));
    publish(f, make_snapshot(f, 9, 0));
    int witness = dial_and_stream(f);
    expect_light(f, witness, 9);
    const size_t size = write_script(script, sizeof script, welcome.package_compressed_size);
    assert_false(recite(f, script, size));
    for (size_t cut = 0; cut < size; cut++) assert_false(recite(f, script, cut));
    unsigned refused = 0;
    for (size_t bit = 0; bit < 8 * size; bit++) {
        memcpy(wrong, script, size);
        wrong[bit / 8] ^= (uint8_t)(1u << bit % 8);
        refused += recite(f, wrong, size);
    }
    assert_true(refused > 4 * size); /* what is left changes a number or a name that may be any */
    memcpy(wrong, script, size);
    memcpy(wrong + size, script, sizeof wrong - size < size ? sizeof wrong - size : size);
    assert_true(recite(f, wrong, 2 * size < sizeof wrong ? 2 * size : sizeof wrong));
    publish(f, make_snapshot(f, 10, 9));
    expect_frame(witness, 10, 2);
    expect_tiles(witness, f->map.tile_count, 10);
    wait_for_sessions(f, 1);
    close(witness);
    end(f);
}

static void test_garbage(void **state) {
    (void)state;
    struct fixture *f = start(&(struct lw_server_desc){0});
    int good = dial_and_stream(f), s = dial(f);
    put_bytes(s, "GET / HTTP/1.1\r\n\r\n", 18);
    expect_refusal(s, LW_REFUSAL_PROTOCOL);
    s = dial(f); /* a body one byte over the limit, found from the header alone */
    uint8_t header[LW_FRAMING_HEADER_SIZE];
    lw_framing_write_header(header, (struct lw_framing_header){.body_size = LW_FRAMING_CLIENT_BODY_MAX + 1,
                                                               .type = LW_MESSAGE_HELLO});
    put_bytes(s, header, sizeof header);
    expect_refusal(s, LW_REFUSAL_PROTOCOL);
    s = dial(f); /* flags of the future */
    lw_framing_write_header(header, (struct lw_framing_header){.type = LW_MESSAGE_HELLO, .flags = 1});
    put_bytes(s, header, sizeof header);
    expect_refusal(s, LW_REFUSAL_PROTOCOL);
    s = dial(f); /* a body that is no protobuf */
    lw_framing_write_header(header, (struct lw_framing_header){.body_size = 2, .type = LW_MESSAGE_HELLO});
    put_bytes(s, header, sizeof header);
    put_bytes(s, "\xff\xff", 2);
    expect_refusal(s, LW_REFUSAL_PROTOCOL);
    s = dial_and_greet(f); /* a type that no version has */
    lw_framing_write_header(header, (struct lw_framing_header){.type = 99});
    put_bytes(s, header, sizeof header);
    expect_refusal(s, LW_REFUSAL_PROTOCOL);
    publish(f, make_snapshot(f, 1, 0));
    expect_light(f, good, 1);
    assert_int_equal(stats_of(f).refused, 5);
    close(good);
    end(f);
}

static void test_out_of_order(void **state) {
    (void)state;
    struct fixture *f = start(&(struct lw_server_desc){0});
    int s = dial(f);
    put(s, &(struct lw_message){.type = LW_MESSAGE_PING});
    expect_refusal(s, LW_REFUSAL_PROTOCOL);
    s = dial(f);
    ask_for_package(s, 0);
    expect_refusal(s, LW_REFUSAL_PROTOCOL);
    s = dial_and_greet(f);
    put(s, &hello);
    expect_refusal(s, LW_REFUSAL_PROTOCOL);
    s = dial_and_stream(f);
    ask_for_package(s, 0);
    expect_refusal(s, LW_REFUSAL_PROTOCOL);
    s = dial_and_greet(f); /* past the end by one */
    ask_for_package(s, LW_MESSAGE_COMPRESSED_MAX);
    expect_refusal(s, LW_REFUSAL_PROTOCOL);
    s = dial_and_greet(f); /* what only a server says */
    put(s,
        &(struct lw_message){.type = LW_MESSAGE_REFUSAL, .refusal = {.code = LW_REFUSAL_FULL, .text = "no"}});
    expect_refusal(s, LW_REFUSAL_PROTOCOL);
    end(f);
}

static void test_wrong_version(void **state) {
    (void)state;
    struct fixture *f = start(&(struct lw_server_desc){0});
    for (uint32_t version = 0; version < 3; version += 2) {
        int s = dial(f);
        put(s, &(struct lw_message){.type = LW_MESSAGE_HELLO, .hello.version = version});
        expect_refusal(s, LW_REFUSAL_VERSION);
    }
    assert_int_equal(stats_of(f).sessions_total, 0);
    end(f);
}

/* ---- finer levels ---- */

/* Lists tiles of the level that is twice as fine, by their numbers: a bit for each. */
static void want_fine(int s, uint32_t tiles) {
    struct lw_message_interest_tile tile[32];
    size_t count = 0;
    for (uint32_t t = 0; t < 32; t++)
        if (tiles >> t & 1) tile[count++] = (struct lw_message_interest_tile){0, LW_ATLAS_FINER + 1, t};
    put(s,
        &(struct lw_message){.type = LW_MESSAGE_INTEREST, .interest = {.tile = tile, .tile_count = count}});
}

static void expect_fine_tile(int s, uint32_t tile, uint64_t version) {
    struct lw_message m;
    expect(s, LW_MESSAGE_TILE, &m);
    assert_int_equal(m.tile.level, LW_ATLAS_FINER + 1);
    assert_int_equal(m.tile.tile, tile);
    assert_int_equal(m.tile.version, version);
    lw_message_finish(&m);
}

/* Who has not said that it knows of them is told of none, gets none with everything, and may ask for none. */
static void test_who_knows_no_finer_levels_gets_none(void **state) {
    (void)state;
    struct lw_message m;
    finer_levels = 2;
    struct fixture *f = start(&(struct lw_server_desc){0});
    int s = dial(f);
    put(s, &hello);
    expect(s, LW_MESSAGE_WELCOME, &m);
    assert_int_equal(m.welcome.features, 0);
    assert_int_equal(m.welcome.finer, 0);
    ask_for_package(s, m.welcome.package_compressed_size);
    lw_message_finish(&m);
    for (uint64_t frame = 1; frame < 4; frame++) {
        publish(f, make_snapshot(f, frame, 0));
        expect_light(f, s, frame);
        expect_silence(s);
    }
    want_fine(s, 0x8);
    expect_refusal(s, LW_REFUSAL_PROTOCOL);
    end(f);
    finer_levels = 0;
}

/* Who has, gets what it lists, and nothing finer with everything; the solver hears of it, and of level 0. */
static void test_finer_levels_are_sent_to_who_lists_them(void **state) {
    (void)state;
    struct lw_message m;
    finer_levels = 2;
    struct fixture *f = start(&(struct lw_server_desc){0});
    int s = dial(f);
    put(s, &(struct lw_message){.type = LW_MESSAGE_HELLO,
                                .hello = {.version = LW_WIRE_VERSION, .features = LW_FEATURE_FINER}});
    expect(s, LW_MESSAGE_WELCOME, &m);
    assert_int_equal(m.welcome.features, LW_FEATURE_FINER);
    assert_int_equal(m.welcome.finer, 2);
    ask_for_package(s, m.welcome.package_compressed_size);
    lw_message_finish(&m);
    publish(f, make_snapshot(f, 1, 0));
    expect_light(f, s, 1);
    want_fine(s, 0x8);
    struct lw_server_interest wanted;
    LW_SUPPORT_WAIT_UNTIL(lw_server_take_interest(f->server, &wanted) && !wanted.everything);
    for (uint32_t t = 0; t < f->map.tile_count; t++) {
        const struct lw_tile_place *p = &f->map.place[t];
        /* tile 3 of the level that is twice as fine is in the second column of the first row of level 0 */
        const bool listed = p->width && p->object == 0 && p->y == 0 && p->x == (p->level ? 3 : 1);
        assert_int_equal(wanted.levels[t], listed && (p->level == 0 || p->level == LW_ATLAS_FINER + 1));
    }
    free(wanted.levels);
    publish(f, make_snapshot(f, 2, 1));
    expect_frame(s, 2, 2);
    expect_fine_tile(s, 3, 2);
    expect_silence(s);
    close(s);
    end(f);
    finer_levels = 0;
}

/* The next list of interest, by the numbers of the fine tiles that are in it: a bit for each. */
static uint64_t take_fine(struct fixture *f, uint32_t *out_tiles) {
    struct lw_server_interest wanted;
    LW_SUPPORT_WAIT_UNTIL(lw_server_take_interest(f->server, &wanted));
    *out_tiles = 0;
    for (uint32_t t = f->map.plain_count; wanted.levels && t < f->map.tile_count; t++)
        if (wanted.levels[t]) *out_tiles |= 1u << lw_atlas_map_number(&f->map, (lw_tile_id){t});
    free(wanted.levels);
    return wanted.number;
}

/* The solver has these tiles, and heard the list of that number. */
static void publish_fine(struct fixture *f, uint64_t frame, uint64_t interest, uint32_t tiles) {
    struct lw_snapshot *snapshot = make_snapshot(f, frame, frame - 1);
    snapshot->interest = interest;
    assert_non_null(snapshot->holds_fine = calloc(fine_room, sizeof *snapshot->holds_fine));
    for (uint32_t i = 0; i < fine_room; i++) {
        const lw_tile_id id = {f->map.plain_count + i};
        snapshot->holds_fine[i] =
            lw_atlas_map_is_used(&f->map, id) && tiles >> lw_atlas_map_number(&f->map, id) & 1;
        if (snapshot->holds_fine[i]) continue;
        lw_blob_unref(snapshot->tile[form][id.v].blob);
        snapshot->tile[form][id.v] = (struct lw_snapshot_tile){0};
    }
    publish(f, snapshot);
}

/* Who lists more than a session may gets ids for as many: the first ones of its list. */
static void test_a_session_has_so_many_fine_tiles(void **state) {
    (void)state;
    struct lw_message m;
    struct lw_server_interest wanted;
    struct lw_message_interest_tile tile[LW_SESSION_FINE_MAX + 1];
    finer_levels = LW_ATLAS_FINER_MAX;
    fine_room = 2 * LW_SESSION_FINE_MAX;
    struct fixture *f = start(&(struct lw_server_desc){0});
    int s = dial(f);
    put(s, &(struct lw_message){.type = LW_MESSAGE_HELLO,
                                .hello = {.version = LW_WIRE_VERSION, .features = LW_FEATURE_FINER}});
    expect(s, LW_MESSAGE_WELCOME, &m);
    ask_for_package(s, m.welcome.package_compressed_size);
    lw_message_finish(&m);
    for (uint32_t t = 0; t <= LW_SESSION_FINE_MAX; t++)
        tile[t] = (struct lw_message_interest_tile){0, LW_ATLAS_FINER + LW_ATLAS_FINER_MAX, t};
    put(s, &(struct lw_message){.type = LW_MESSAGE_INTEREST,
                                .interest = {.tile = tile, .tile_count = LW_SESSION_FINE_MAX + 1}});
    LW_SUPPORT_WAIT_UNTIL(lw_server_take_interest(f->server, &wanted) && !wanted.everything);
    for (uint32_t t = 0; t <= LW_SESSION_FINE_MAX; t++) {
        const lw_tile_id id = lw_atlas_map_find_tile(&f->map, 0, tile[t].level, t);
        assert_int_equal(id.v != UINT32_MAX && wanted.levels[id.v], t < LW_SESSION_FINE_MAX);
    }
    free(wanted.levels);
    close(s);
    end(f);
    finer_levels = 0;
    fine_room = 3;
}

/* An id goes to another tile once nobody lists the first, and the solver has heard so and holds it no more.
 * */
static void test_ids_of_fine_tiles_go_to_others(void **state) {
    (void)state;
    struct lw_message m;
    uint32_t tiles;
    finer_levels = 2;
    struct fixture *f = start(&(struct lw_server_desc){0});
    int s = dial(f);
    put(s, &(struct lw_message){.type = LW_MESSAGE_HELLO,
                                .hello = {.version = LW_WIRE_VERSION, .features = LW_FEATURE_FINER}});
    expect(s, LW_MESSAGE_WELCOME, &m);
    ask_for_package(s, m.welcome.package_compressed_size);
    lw_message_finish(&m);
    publish(f, make_snapshot(f, 1, 0));
    expect_light(f, s, 1);
    want_fine(s, 0x7); /* as many as there are ids for */
    uint64_t number = take_fine(f, &tiles);
    while (!tiles) number = take_fine(f, &tiles);
    assert_int_equal(tiles, 0x7);
    publish_fine(f, 2, number, 0x7);
    expect_frame(s, 2, 2);
    for (uint32_t t = 0; t < 3; t++) expect_fine_tile(s, t, 2);
    want_fine(s, 0x8); /* none is left */
    const uint64_t next = take_fine(f, &tiles);
    assert_int_equal(next, number + 1);
    assert_int_equal(tiles, 0);
    publish_fine(f, 3, number, 0); /* the solver may still make what the list before has */
    expect_frame(s, 3, 2);
    want_fine(s, 0x8);
    expect_silence(s); /* the server has heard that before the next snapshot, of which the solver holds one */
    publish_fine(f, 4, next, 0x1);
    expect_frame(s, 4, 2);
    want_fine(s, 0x18);
    take_fine(f, &tiles);
    assert_int_equal(tiles, 0x18);
    publish_fine(f, 5, next, 0x19);
    expect_frame(s, 5, 2);
    expect_fine_tile(s, 3, 5);
    expect_fine_tile(s, 4, 5);
    want_fine(s, 0); /* what it does not list it may drop, and gets whole when it comes back */
    want_fine(s, 0x10);
    expect_fine_tile(s, 4, 5);
    expect_silence(s);
    close(s);
    end(f);
    finer_levels = 0;
}

static void test_features_that_are_needed(void **state) {
    (void)state;
    struct fixture *f = start(&(struct lw_server_desc){.features = LW_FEATURE_DCT});
    int s = dial(f);
    put(s, &hello); /* an old client: it offers none */
    expect_refusal(s, LW_REFUSAL_FEATURES);
    s = dial(f);
    put(s,
        &(struct lw_message){.type = LW_MESSAGE_HELLO,
                             .hello = {.version = LW_WIRE_VERSION, .features = LW_FEATURE_DCT | 1u << 20}});
    struct lw_message m;
    expect(s, LW_MESSAGE_WELCOME, &m);
    assert_int_equal(m.welcome.features, LW_FEATURE_DCT); /* not what this server has never heard of */
    lw_message_finish(&m);
    assert_int_equal(stats_of(f).sessions_total, 1);
    end(f);
}

static void test_half_hello(void **state) {
    (void)state;
    struct fixture *f = start(&(struct lw_server_desc){.hello_timeout_ms = 1000});
    struct lw_blob *bytes = blob_of(&hello);
    int s = dial(f), silent = dial(f);
    for (size_t i = 0; i + 1 < bytes->size; i++) put_bytes(s, bytes->bytes + i, 1);
    is_paced = true;
    expect_refusal(s, LW_REFUSAL_TIMEOUT);
    expect_refusal(silent, LW_REFUSAL_TIMEOUT);
    is_paced = false;
    s = dial(f); /* byte by byte, but in time */
    for (size_t i = 0; i < bytes->size; i++) put_bytes(s, bytes->bytes + i, 1);
    struct lw_message m;
    expect(s, LW_MESSAGE_WELCOME, &m);
    lw_message_finish(&m);
    server_clock_step(1500);
    expect_silence(s); /* the limit is for the hello */
    lw_blob_unref(bytes);
    close(s);
    end(f);
}

static void test_many_messages_in_pieces(void **state) {
    (void)state;
    struct fixture *f = start(&(struct lw_server_desc){0});
    int s = dial_and_greet(f);
    static const struct lw_message_interest_tile wanted[LW_MESSAGE_INTEREST_MAX];
    struct lw_blob *large = blob_of(&(struct lw_message){
        .type = LW_MESSAGE_INTEREST, .interest = {.tile = wanted, .tile_count = LW_MESSAGE_INTEREST_MAX}});
    struct lw_blob *other = blob_of(
        &(struct lw_message){.type = LW_MESSAGE_INTEREST,
                             .interest = {.tile = wanted, .tile_count = LW_MESSAGE_INTEREST_MAX - 100}});
    struct lw_blob *ping = blob_of(&(struct lw_message){.type = LW_MESSAGE_PING, .ping.token = CLIENT_TOKEN});
    /* a large one, small ones, another large one, a small one, cut where no message ends */
    enum { PINGS = 200 };
    struct lw_blob *parts[PINGS + 3];
    size_t size = 0;
    for (int i = 0; i < PINGS + 3; i++) parts[i] = i == 0 ? large : i == PINGS + 1 ? other : ping;
    for (int i = 0; i < PINGS + 3; i++) size += parts[i]->size;
    uint8_t *bytes = malloc(size), *at_part = bytes;
    for (int i = 0; i < PINGS + 3; i++) {
        memcpy(at_part, parts[i]->bytes, parts[i]->size);
        at_part += parts[i]->size;
    }
    const int on = 1;
    assert_int_equal(setsockopt(s, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on), 0);
    /* each is read by itself: the server has looked for what there is before the next */
    for (size_t at = 0, piece; at < size; at += piece) {
        const bool is_small = at > large->size && at < large->size + PINGS * ping->size;
        piece = is_small ? 101 : 10007;
        if (piece > size - at) piece = size - at;
        put_bytes(s, bytes + at, piece);
        server_clock_step(STEP_MS);
    }
    is_paced = true;
    put(s, &(struct lw_message){.type = LW_MESSAGE_PING, .ping.token = 1});
    struct lw_message m;
    do { /* several pings may get one answer */
        expect(s, LW_MESSAGE_PONG, &m);
        lw_message_finish(&m);
    } while (m.pong.token == CLIENT_TOKEN);
    assert_int_equal(m.pong.token, 1);
    free(bytes);
    lw_blob_unref(large);
    lw_blob_unref(other);
    lw_blob_unref(ping);
    close(s);
    end(f);
}

static void test_abrupt_close(void **state) {
    (void)state;
    struct fixture *f = start(&(struct lw_server_desc){0});
    const struct linger reset = {.l_onoff = 1};
    for (uint64_t frame = 1; frame <= 20; frame++) {
        int s = dial_with_buffer(f, 4096);
        put(s, &hello);
        ask_for_package(s, 0);
        publish(f, make_snapshot(f, frame, frame - 1));
        uint8_t some[100];
        assert_true(get_bytes(s, some, sizeof some));
        if (frame % 2) setsockopt(s, SOL_SOCKET, SO_LINGER, &reset, sizeof reset);
        close(s);
    }
    wait_for_sessions(f, 0);
    assert_int_equal(stats_of(f).sessions_total, 20);
    end(f);
}

/* ---- many, full, stop ---- */

static void test_many_connects(void **state) {
    (void)state;
    enum { MANY = 300 };
    struct fixture *f = start(&(struct lw_server_desc){0});
    static int s[MANY];
    publish(f, make_snapshot(f, 1, 0));
    for (int i = 0; i < MANY; i++) s[i] = dial_and_greet(f);
    assert_int_equal(stats_of(f).sessions_now, MANY);
    for (int i = 0; i < MANY; i += 2) close(s[i]);
    wait_for_sessions(f, MANY / 2);
    for (int i = 1; i < MANY; i += 2) close(s[i]);
    wait_for_sessions(f, 0);
    assert_int_equal(stats_of(f).sessions_total, MANY);
    end(f);
}

static void test_full(void **state) {
    (void)state;
    struct fixture *f = start(&(struct lw_server_desc){.sessions_max = 3});
    int s[3];
    for (int i = 0; i < 3; i++) s[i] = dial_and_greet(f);
    expect_refusal(dial(f), LW_REFUSAL_FULL);
    close(s[0]);
    wait_for_sessions(f, 2);
    s[0] = dial_and_greet(f); /* a place became free */
    for (int i = 0; i < 3; i++) close(s[i]);
    end(f);
}

/* Dials until there is a place: one that was taken becomes free when its link is closed, a moment later. */
static int dial_until_welcome(const struct fixture *f) {
    for (;; server_clock_step(STEP_MS)) {
        struct lw_message m;
        const int s = dial(f);
        put(s, &hello);
        const bool answered = get(s, &m), welcomed = answered && m.type == LW_MESSAGE_WELCOME;
        if (answered) lw_message_finish(&m);
        if (welcomed) return s;
        close(s);
    }
}

static void test_an_address_has_its_places(void **state) {
    (void)state;
    struct fixture *f = start(&(struct lw_server_desc){.sessions_max = 20, .address_sessions_max = 3});
    int s[3];
    for (int i = 0; i < 3; i++) s[i] = dial_and_greet(f);
    expect_refusal(dial(f), LW_REFUSAL_FULL);
    int other = dial_from(f, "127.0.0.2"); /* which has its own */
    struct lw_message m;
    put(other, &hello);
    expect(other, LW_MESSAGE_WELCOME, &m);
    lw_message_finish(&m);
    put_bytes(s[0], "nonsense", 8); /* who is refused gives its place up once its link is closed */
    expect_refusal(s[0], LW_REFUSAL_PROTOCOL);
    s[0] = dial_until_welcome(f);
    close(s[1]);
    wait_for_sessions(f, 3);
    s[1] = dial_and_greet(f);
    expect_refusal(dial(f), LW_REFUSAL_FULL);
    for (int i = 0; i < 3; i++) close(s[i]);
    close(other);
    end(f);
    f = start(&(struct lw_server_desc){.sessions_max = 20}); /* a tenth is kept for others */
    int many[18];
    for (int i = 0; i < 18; i++) many[i] = dial_and_greet(f);
    expect_refusal(dial(f), LW_REFUSAL_FULL);
    other = dial_from(f, "127.0.0.2");
    put(other, &hello);
    expect(other, LW_MESSAGE_WELCOME, &m);
    lw_message_finish(&m);
    for (int i = 0; i < 18; i++) close(many[i]);
    close(other);
    end(f);
}

/* Those that were refused and stay on the line have their places, and few lines without one: the others
 * notice nothing. */
static void test_refused_ones_that_linger(void **state) {
    (void)state;
    enum { LINGERING = 1100 };
    struct fixture *f = start(&(struct lw_server_desc){.sessions_max = 40, .address_sessions_max = 20});
    static int lingering[LINGERING];
    for (int i = 0; i < LINGERING; i++) {
        lingering[i] = dial_from(f, "127.0.0.2");
        (void)send(lingering[i], "nonsense", 8, MSG_NOSIGNAL); /* some are closed by then */
        if (i % 100) continue;
        int s = dial_and_greet(f);
        close(s);
        wait_for_sessions(f, 0);
    }
    for (int i = 0; i < LINGERING; i++) close(lingering[i]);
    end(f);
}

/* One address's connections without a place are told so as far as there is room, and closed beyond that. */
static void test_who_is_turned_away_is_told(void **state) {
    (void)state;
    enum { MORE = LW_SERVER_ADDRESS_TURNED_AWAY_MAX + 1 };
    struct fixture *f = start(&(struct lw_server_desc){.sessions_max = 5, .address_sessions_max = 1});
    int one = dial_and_greet(f), more[MORE], told = 0;
    for (int i = 0; i < MORE; i++) more[i] = dial(f);
    for (int i = 0; i < MORE; i++) {
        struct lw_message m;
        if (!get(more[i], &m)) continue;
        assert_int_equal(m.type, LW_MESSAGE_REFUSAL);
        assert_int_equal(m.refusal.code, LW_REFUSAL_FULL);
        lw_message_finish(&m);
        told++;
    }
    assert_in_range(told, LW_SERVER_ADDRESS_TURNED_AWAY_MAX,
                    MORE); /* all where the first have gone by then */
    for (int i = 0; i < MORE; i++) close(more[i]);
    close(one);
    end(f);
}

static void test_stop_while_sending(void **state) {
    (void)state;
    struct fixture *f = start(&(struct lw_server_desc){0});
    int slow = dial_with_buffer(f, 4096), reading = dial_and_greet(f), silent = dial(f);
    put(slow, &hello);
    ask_for_package(slow, 0);
    wait_for_sessions(f, 2);
    publish(f, make_snapshot(f, 1, 0));
    const uint64_t start_ns = lw_clock_ns();
    lw_server_stop(f->server);
    expect_refusal(reading, LW_REFUSAL_SHUTDOWN);
    expect_refusal(silent, LW_REFUSAL_SHUTDOWN);
    while (server_clock_step(100)) /* does not wait for the one that does not read for long */
        assert_true(lw_clock_ns() - start_ns < 10000000000u);
    join(f);
    close(slow);
    discard(f);
}

static void test_stop_before_and_without_run(void **state) {
    (void)state;
    struct fixture *f = start(&(struct lw_server_desc){0});
    lw_server_stop(f->server);
    join(f);
    struct lw_server_desc desc = {
        .host = "localhost", .atlas_map = &f->map, .package = f->package, .package_size = PACKAGE_SIZE};
    struct lw_error err = {0};
    lw_support_ok(lw_server_create(&desc, &f->server, &err), &err);
    publish(f, make_snapshot(f, 1, 0));
    lw_server_stop(f->server);
    lw_server_destroy(f->server);
    lw_server_destroy(NULL);
    discard(f);
}

/* At the end clients are told when to come back: as the owner says, or soon if
 * another server follows at once. */
static void test_stop_says_when_to_come_back(void **state) {
    (void)state;
    for (int relayed = 0; relayed < 2; relayed++) {
        struct fixture *f = start(&(struct lw_server_desc){.retry_after_ms = 1234});
        int s = dial_and_greet(f), wrong = dial(f);
        put_bytes(wrong, "nonsense", 8);
        expect_refusal(wrong, LW_REFUSAL_PROTOCOL);
        if (relayed)
            lw_server_relay(f->server);
        else
            lw_server_stop(f->server);
        expect_return_told(s, LW_REFUSAL_SHUTDOWN, relayed ? LW_SERVER_RELAY_MS : 1234);
        end(f);
    }
}

static void note_reload(void *context) { *(_Atomic int *)context += 1; }

static void test_hangup_reloads(void **state) {
    (void)state;
    _Atomic int reloads = 0;
    struct fixture *f =
        start(&(struct lw_server_desc){.hooks = {.reload = note_reload, .context = (void *)&reloads}});
    close(dial_and_greet(f)); /* it runs, and watches */
    for (int i = 1; i <= 2; i++) {
        kill(getpid(), SIGHUP);
        LW_SUPPORT_WAIT_UNTIL(atomic_load(&reloads) >= i);
    }
    close(dial_and_greet(f));
    end(f);
    assert_int_equal(reloads, 2);
}

static void test_signal(void **state) {
    (void)state;
    const int signals[] = {SIGINT, SIGTERM};
    for (int i = 0; i < 2; i++) {
        struct fixture *f = start(&(struct lw_server_desc){0});
        int s = dial_and_greet(f); /* the loop runs, so it watches signals */
        kill(getpid(), signals[i]);
        expect_refusal(s, LW_REFUSAL_SHUTDOWN);
        join(f);
        discard(f);
    }
}

static void test_address_errors(void **state) {
    (void)state;
    struct fixture *f = start(&(struct lw_server_desc){0});
    struct lw_server_desc desc = {.host = "127.0.0.1",
                                  .port = lw_server_port(f->server),
                                  .atlas_map = &f->map,
                                  .package = f->package,
                                  .package_size = PACKAGE_SIZE};
    struct lw_server *second = NULL;
    struct lw_error err = {0};
    char expected[200];
    assert_int_equal(lw_server_create(&desc, &second, &err), LW_UNAVAILABLE);
    snprintf(expected, sizeof expected,
             "127.0.0.1:%u is already in use: another lightwelld? choose another with --listen HOST:PORT",
             (unsigned)desc.port);
    assert_string_equal(err.text, expected);
    err = (struct lw_error){0};
    desc.host = "192.0.2.1"; /* for documentation: nobody's address */
    assert_int_equal(lw_server_create(&desc, &second, &err), LW_UNAVAILABLE);
    assert_non_null(strstr(err.text, "192.0.2.1"));
    err = (struct lw_error){0};
    desc.host = "no such host";
    assert_int_equal(lw_server_create(&desc, &second, &err), LW_NO_HOST);
    assert_non_null(strstr(err.text, "no such host"));
    assert_null(second);
    end(f);
}

/* A loop that spins looks at the clock all the time; one that waits, when a timer runs. */
static void test_an_idle_loop_waits(void **state) {
    (void)state;
    struct fixture *f = start(&(struct lw_server_desc){0});
    int s = dial_and_stream(f);
    publish(f, make_snapshot(f, 1, 0));
    expect_light(f, s, 1);
    uint64_t runs[2], readings[2];
    server_clock_count(&runs[0], &readings[0]);
    for (unsigned i = 0; i < 50; i++) server_clock_step(1);
    server_clock_count(&runs[1], &readings[1]);
    const double each = (double)(readings[1] - readings[0]) / (double)(runs[1] - runs[0]);
    print_message("%.1f readings a run\n", each);
    assert_true(each < 6);
    close(s);
    end(f);
}

/* ---- updates of the scene ---- */

static const struct lw_scene_change hide_1 = {LW_SCENE_CHANGE_OBJECT_HIDE, 1, 0, {0}},
                                    sky = {LW_SCENE_CHANGE_SKY, 0, 3, {1, 2, 3}},
                                    no_such = {LW_SCENE_CHANGE_OBJECT_HIDE, OBJECTS, 0, {0}};

/* A server whose scene may be changed; fixtures make theirs before the server knows it. */
static struct fixture *start_controlled_with(struct lw_server_desc desc) {
    static struct lw_scene *scene; /* of the same counts as every fixture's */
    if (!scene) scene = lw_support_squares(OBJECTS, 1.0f);
    desc.scene = scene;
    desc.control_socket = lw_support_temporary("control.sock");
    return start(&desc);
}

static struct fixture *start_controlled(void) { return start_controlled_with((struct lw_server_desc){0}); }

static int dial_locally(void) {
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    snprintf(address.sun_path, sizeof address.sun_path, "%s", lw_support_temporary("control.sock"));
    int s = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    assert_true(s >= 0);
    assert_int_equal(connect(s, (struct sockaddr *)&address, sizeof address), 0);
    return s;
}

static int dial_and_control(const struct fixture *f, bool stream) {
    (void)f;
    int s = dial_locally();
    struct lw_message m, control = hello;
    control.hello.features = LW_FEATURE_CONTROL;
    put(s, &control);
    expect(s, LW_MESSAGE_WELCOME, &m);
    assert_int_equal(m.welcome.features, LW_FEATURE_CONTROL);
    if (stream) ask_for_package(s, m.welcome.package_compressed_size);
    lw_message_finish(&m);
    return s;
}

static void update(int s, uint64_t request, const struct lw_scene_change *change, size_t count) {
    put(s, &(struct lw_message){.type = LW_MESSAGE_UPDATE, .update = {request, change, count}});
}

static void expect_updated(int s, uint64_t request, uint32_t code, uint32_t change, uint64_t frame) {
    struct lw_message m;
    expect(s, LW_MESSAGE_UPDATED, &m);
    assert_int_equal(m.updated.request, request);
    assert_int_equal(m.updated.code, code);
    assert_int_equal(m.updated.change, change);
    assert_int_equal(m.updated.frame, frame);
    assert_int_equal(*m.updated.text == 0, code == LW_SCENE_CHANGE_OK);
    lw_message_finish(&m);
}

static void expect_added(int s, uint64_t request, const uint32_t *object, size_t count) {
    struct lw_message m;
    expect(s, LW_MESSAGE_UPDATED, &m);
    assert_int_equal(m.updated.request, request);
    assert_int_equal(m.updated.code, LW_SCENE_CHANGE_OK);
    assert_int_equal(m.updated.added_count, count);
    assert_memory_equal(m.updated.added, object, count * sizeof *object);
    lw_message_finish(&m);
}

/* Waits until `updates` updates have arrived, and takes them for a frame. */
static struct lw_scene_change *take(const struct fixture *f, uint64_t frame, size_t updates, size_t changes) {
    struct lw_scene_change *all = NULL;
    size_t taken = 0, count = 0;
    for (; taken < updates; lw_support_pause()) {
        struct lw_scene_change *some;
        size_t some_count;
        taken += lw_server_take_updates(f->server, frame, &some, &some_count);
        all = realloc(all, (count + some_count + 1) * sizeof *all);
        assert_non_null(all);
        if (some_count) memcpy(all + count, some, some_count * sizeof *all);
        count += some_count;
        free(some);
    }
    assert_int_equal(taken, updates);
    assert_int_equal(count, changes);
    return all;
}

static void test_updates_are_answered_with_their_frame(void **state) {
    (void)state;
    struct fixture *f = start_controlled();
    int s = dial_and_control(f, true), other = dial_and_stream(f);
    update(s, 17, (struct lw_scene_change[]){hide_1, sky}, 2);
    update(s, 18, NULL, 0);
    struct lw_scene_change *change = take(f, 5, 2, 2);
    assert_memory_equal(&change[0], &hide_1, sizeof hide_1);
    assert_memory_equal(&change[1], &sky, sizeof sky);
    free(change);
    expect_silence(s); /* taken, but not to be seen yet */
    publish(f, make_snapshot(f, 5, 0));
    expect_frame(s, 5, 1); /* the frame before its answer */
    expect_updated(s, 17, LW_SCENE_CHANGE_OK, 0, 5);
    expect_updated(s, 18, LW_SCENE_CHANGE_OK, 0, 5);
    expect_tiles(s, f->map.tile_count, 5);
    expect_light(f, other, 5); /* nobody else hears of it */
    update(s, 19, &hide_1, 1);
    free(take(f, 6, 1, 1)); /* whose frame is overtaken by the next one */
    publish(f, make_snapshot(f, 7, 5));
    expect_frame(s, 7, 2);
    expect_updated(s, 19, LW_SCENE_CHANGE_OK, 0, 6);
    expect_frame(other, 7, 2);
    close(s);
    close(other);
    end(f);
}

static void test_wrong_updates_are_answered_and_nothing_of_them_is_done(void **state) {
    (void)state;
    struct fixture *f = start_controlled();
    int s = dial_and_control(f, false);
    struct lw_scene_change bad[] = {hide_1, no_such};
    update(s, 1, bad, 2);
    expect_updated(s, 1, LW_SCENE_CHANGE_UNKNOWN_TARGET, 1, 0);
    struct lw_scene_change wrong = sky;
    wrong.value[1] = NAN;
    update(s, 2, &wrong, 1);
    expect_updated(s, 2, LW_SCENE_CHANGE_NOT_FINITE, 0, 0);
    wrong.value[1] = -1;
    update(s, 3, &wrong, 1);
    expect_updated(s, 3, LW_SCENE_CHANGE_OUT_OF_RANGE, 0, 0);
    wrong = (struct lw_scene_change){4711, 0, 2, {0}};
    update(s, 4, &wrong, 1);
    expect_updated(s, 4, LW_SCENE_CHANGE_UNKNOWN_KIND, 0, 0);
    wrong = (struct lw_scene_change){LW_SCENE_CHANGE_OBJECT_TRANSFORM, 0, 12, {0}};
    update(s, 5, &wrong, 1);
    expect_updated(s, 5, LW_SCENE_CHANGE_DEGENERATE, 0, 0);
    update(s, 6, &hide_1, 1);
    free(take(f, 1, 1, 1)); /* that one alone */
    publish(f, make_snapshot(f, 1, 0));
    expect_updated(s, 6, LW_SCENE_CHANGE_OK, 0, 1); /* without any FRAME: it has not asked for the package */
    close(s);
    end(f);
}

/* Two at once, from two sessions: each spare goes to one of them, and what one takes is told to the other. */
static void test_spares_are_given_out_in_order(void **state) {
    (void)state;
    static const struct lw_scene_change add = {
        LW_SCENE_CHANGE_OBJECT_ADD, 0, 12, {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}};
    static const struct lw_scene_change remove = {LW_SCENE_CHANGE_OBJECT_REMOVE, 1, 0, {0}};
    struct lw_scene *scene = lw_support_squares(OBJECTS, 1);
    struct lw_error err = {0};
    lw_support_ok(lw_scene_spares_add(scene, "2", &err), &err);
    struct fixture *f = start(
        &(struct lw_server_desc){.scene = scene, .control_socket = lw_support_temporary("control.sock")});
    int a = dial_and_control(f, false), b = dial_and_control(f, false);
    const struct lw_scene_change hide_second = {LW_SCENE_CHANGE_OBJECT_HIDE, OBJECTS + 1, 0, {0}};
    update(a, 1, (struct lw_scene_change[]){add, hide_second}, 2); /* refused, and so it takes none */
    expect_updated(a, 1, LW_SCENE_CHANGE_ABSENT, 1, 0);
    update(a, 2, &add, 1);
    free(take(f, 1, 1, 1));
    update(b, 1, (struct lw_scene_change[]){add, add}, 2); /* one too many, and so none */
    expect_updated(b, 1, LW_SCENE_CHANGE_NO_SPARE, 1, 0);
    update(b, 2, (struct lw_scene_change[]){remove, add, add}, 3);
    free(take(f, 1, 1, 3));
    update(a, 3, &remove, 1); /* the one that has just been added; so is this number a spare again */
    free(take(f, 1, 1, 1));
    update(a, 4, &remove, 1);
    expect_updated(a, 4, LW_SCENE_CHANGE_ABSENT, 0, 0);
    update(a, 5, &hide_1, 1);
    expect_updated(a, 5, LW_SCENE_CHANGE_ABSENT, 0, 0);
    publish(f, make_snapshot(f, 1, 0));
    expect_added(a, 2, (uint32_t[]){OBJECTS}, 1);
    expect_updated(a, 3, LW_SCENE_CHANGE_OK, 0, 1);
    expect_added(b, 2, (uint32_t[]){1, OBJECTS + 1}, 2);
    update(b, 3, &(struct lw_scene_change){LW_SCENE_CHANGE_RESET, 0, 0, {0}}, 1);
    free(take(f, 2, 1, 1));
    update(b, 4, (struct lw_scene_change[]){hide_1, add, add}, 3); /* all is as it was */
    free(take(f, 2, 1, 3));
    close(a); /* who does not wait for the answer */
    close(b);
    publish(f, make_snapshot(f, 2, 0));
    end(f);
    lw_scene_destroy(scene);
}

static void test_a_thousand_updates_in_one_frame_keep_their_order(void **state) {
    (void)state;
    struct fixture *f = start_controlled();
    int s = dial_and_control(f, false);
    struct lw_scene_change change = {LW_SCENE_CHANGE_CLOCK_SEEK, 0, 1, {0}};
    for (unsigned i = 0; i < 1024; i++) {
        change.value[0] = (float)i;
        update(s, i, &change, 1);
    }
    update(s, 1024, &change, 1); /* one too many */
    expect_updated(s, 1024, LW_SCENE_CHANGE_BUSY, 0, 0);
    struct lw_scene_change *all = take(f, 3, 1024, 1024);
    for (unsigned i = 0; i < 1024; i++) assert_true(all[i].value[0] == (float)i);
    free(all);
    update(s, 1025, &change, 1); /* there is room again, before the frame is published */
    free(take(f, 4, 1, 1));
    publish(f, make_snapshot(f, 3, 0));
    for (unsigned i = 0; i < 1024; i++) expect_updated(s, i, LW_SCENE_CHANGE_OK, 0, 3);
    expect_silence(s);
    publish(f, make_snapshot(f, 4, 0));
    expect_updated(s, 1025, LW_SCENE_CHANGE_OK, 0, 4);
    close(s);
    end(f);
}

static void test_changes_that_wait_are_bounded(void **state) {
    (void)state;
    struct fixture *f = start_controlled();
    int s = dial_and_control(f, false);
    static struct lw_scene_change many[LW_MESSAGE_CHANGES_MAX];
    for (size_t i = 0; i < LW_MESSAGE_CHANGES_MAX; i++) many[i] = hide_1;
    const size_t full = (128u << 10) / LW_MESSAGE_CHANGES_MAX;
    for (size_t i = 0; i < full; i++) update(s, i, many, LW_MESSAGE_CHANGES_MAX);
    update(s, full, &hide_1, 1);
    expect_updated(s, full, LW_SCENE_CHANGE_BUSY, 0, 0);
    free(take(f, 1, full, full * LW_MESSAGE_CHANGES_MAX));
    close(s);
    end(f);
}

static void test_who_leaves_gets_no_answer_but_its_changes_are_made(void **state) {
    (void)state;
    struct fixture *f = start_controlled();
    int s = dial_and_control(f, false), other = dial_and_control(f, false);
    update(s, 1, &hide_1, 1);
    update(other, 2, &sky, 1);
    put(other, &(struct lw_message){.type = LW_MESSAGE_PING, .ping.token = 1});
    struct lw_message m;
    expect(other, LW_MESSAGE_PONG, &m);
    lw_message_finish(&m);
    free(take(f, 9, 2, 2));
    close(s);
    wait_for_sessions(f, 1);
    publish(f, make_snapshot(f, 9, 0));
    expect_updated(other, 2, LW_SCENE_CHANGE_OK, 0, 9);
    close(other);
    end(f);
}

/* ---- tokens ---- */

static const uint8_t view_token[LW_TOKEN_SIZE] = {1, 2, 3}, control_token[LW_TOKEN_SIZE] = {4, 5, 6},
                     no_token[LW_TOKEN_SIZE] = {1, 2, 3, 4};

/* Bytes in hex follow the role; either token may be NULL. */
static const char *write_tokens(const uint8_t *view, const uint8_t *control) {
    const char *path = lw_support_temporary("tokens");
    char text[400] = "# of a test\n", digits[LW_TOKEN_TEXT_SIZE];
    struct lw_token token;
    for (int i = 0; i < 2; i++) {
        const uint8_t *bytes = i ? control : view;
        if (!bytes) continue;
        memcpy(token.bytes, bytes, sizeof token.bytes);
        lw_token_format(&token, digits);
        const size_t length = strlen(text);
        snprintf(text + length, sizeof text - length, "%s %s\n", i ? "control" : "view", digits);
    }
    lw_support_write_file(path, text, strlen(text));
    assert_int_equal(chmod(path, 0600), 0);
    return path;
}

static void put_hello(int s, const uint8_t *token) {
    put(s, &(struct lw_message){
               .type = LW_MESSAGE_HELLO,
               .hello = {.version = LW_WIRE_VERSION, .features = LW_FEATURE_CONTROL, .token = token}});
}

static int dial_with_token(const struct fixture *f, const uint8_t *token, uint64_t features) {
    int s = dial(f);
    struct lw_message m;
    put_hello(s, token);
    expect(s, LW_MESSAGE_WELCOME, &m);
    assert_int_equal(m.welcome.features, features);
    lw_message_finish(&m);
    return s;
}

static void test_tokens(void **state) {
    (void)state;
    struct fixture *f =
        start_controlled_with((struct lw_server_desc){.tokens = write_tokens(view_token, control_token)});
    int s = dial(f);
    put_hello(s, NULL);
    expect_refusal(s, LW_REFUSAL_TOKEN);
    s = dial(f);
    put_hello(s, no_token);
    expect_refusal(s, LW_REFUSAL_TOKEN);
    s = dial_with_token(f, view_token, 0);
    update(s, 1, &hide_1, 1);
    expect_refusal(s, LW_REFUSAL_NOT_ALLOWED);
    s = dial_with_token(f, control_token, LW_FEATURE_CONTROL);
    update(s, 1, &hide_1, 1);
    free(take(f, 1, 1, 1));
    close(s);
    end(f);
}

/* One in twenty places is kept for those who may control; the own user's Unix socket takes none. */
static void test_places_are_kept_for_control(void **state) {
    (void)state;
    struct fixture *f = start_controlled_with((struct lw_server_desc){
        .tokens = write_tokens(view_token, control_token), .sessions_max = 40, .address_sessions_max = 40});
    int s[42];
    for (int i = 0; i < 38; i++) s[i] = dial_with_token(f, view_token, 0);
    int one_more = dial(f);
    put_hello(one_more, view_token);
    expect_refusal(one_more, LW_REFUSAL_FULL);
    LW_SUPPORT_WAIT_UNTIL(stats_of(f).refused == 1);
    s[38] = dial_with_token(f, control_token, LW_FEATURE_CONTROL);
    for (s[39] = -1; s[39] < 0;) { /* the refused one's place becomes free when its link is closed */
        struct lw_message m;
        const int t = dial(f);
        put_hello(t, control_token);
        assert_true(get(t, &m));
        if (m.type == LW_MESSAGE_WELCOME)
            s[39] = t;
        else
            close(t), server_clock_step(STEP_MS);
        lw_message_finish(&m);
    }
    one_more = dial(f);
    put_hello(one_more, control_token);
    expect_refusal(one_more, LW_REFUSAL_FULL);
    s[40] = dial_and_control(f, false);
    s[41] = dial_and_control(f, false);
    for (int i = 0; i < 42; i++) close(s[i]);
    end(f);
}

static _Atomic unsigned reload_count;

static void reload_files(void *context) {
    struct fixture **f = context;
    lw_server_reload((*f)->server);
    reload_count++;
}

static void expect_still_there(int s) {
    struct lw_message m;
    put(s, &(struct lw_message){.type = LW_MESSAGE_PING, .ping.token = 1});
    expect(s, LW_MESSAGE_PONG, &m);
    lw_message_finish(&m);
}

static void test_tokens_are_read_again(void **state) {
    (void)state;
    struct fixture *f = NULL;
    f = start_controlled_with((struct lw_server_desc){.tokens = write_tokens(view_token, control_token),
                                                      .hooks = {.reload = reload_files, .context = &f}});
    int viewer = dial_with_token(f, view_token, 0),
        controller = dial_with_token(f, control_token, LW_FEATURE_CONTROL), s;
    write_tokens(no_token, control_token);
    kill(getpid(), SIGHUP);
    expect_refusal(viewer, LW_REFUSAL_TOKEN); /* it has gone */
    expect_still_there(controller);
    s = dial(f);
    put_hello(s, view_token);
    expect_refusal(s, LW_REFUSAL_TOKEN);
    close(dial_with_token(f, no_token, 0));
    write_tokens(NULL, NULL); /* a file that cannot be used changes nothing */
    const unsigned before = reload_count;
    kill(getpid(), SIGHUP);
    LW_SUPPORT_WAIT_UNTIL(reload_count > before);
    expect_still_there(controller);
    s = dial_with_token(f, no_token, 0);
    write_tokens(control_token, no_token); /* roles have changed */
    kill(getpid(), SIGHUP);
    expect_refusal(controller, LW_REFUSAL_TOKEN);
    expect_refusal(s, LW_REFUSAL_TOKEN);
    close(dial_with_token(f, no_token, LW_FEATURE_CONTROL));
    end(f);
}

static void test_the_control_socket(void **state) {
    (void)state;
    const char *path = lw_support_temporary("control.sock");
    struct fixture *f =
        start_controlled_with((struct lw_server_desc){.tokens = write_tokens(view_token, NULL)});
    struct stat info;
    assert_int_equal(stat(path, &info), 0);
    assert_int_equal(info.st_mode & 0777, 0600);
    close(dial_and_control(f, false)); /* it needs no token */
    struct lw_server_desc desc = {
        .control_socket = path, .atlas_map = &f->map, .package = f->package, .package_size = PACKAGE_SIZE};
    struct lw_server *second;
    struct lw_error err = {0};
    lw_support_fails(lw_server_create(&desc, &second, &err), LW_UNAVAILABLE, &err, "is there already");
    close(dial_and_control(f, false)); /* it is still the first one's */
    end(f);
    assert_int_equal(access(path, F_OK), -1);
    int left = socket(AF_UNIX, SOCK_STREAM, 0); /* as a server leaves it that was killed */
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    snprintf(address.sun_path, sizeof address.sun_path, "%s", path);
    assert_int_equal(bind(left, (struct sockaddr *)&address, sizeof address), 0);
    close(left);
    f = start_controlled();
    close(dial_and_control(f, false));
    end(f);
    lw_support_write_file(path, "mine", 4); /* what is no socket stays */
    f = start(&(struct lw_server_desc){0});
    err = (struct lw_error){0};
    lw_support_fails(lw_server_create(&desc, &second, &err), LW_UNAVAILABLE, &err, path);
    assert_int_equal(stat(path, &info), 0);
    assert_int_equal(info.st_size, 4);
    end(f);
    unlink(path);
}

/* In a child that has become somebody else: 0 if it is refused as it should be. */
static int try_as_somebody_else(void) {
    struct lw_message m;
    if (setuid(65534) != 0) return 1;
    int s = dial_locally();
    put_hello(s, NULL);
    if (!get(s, &m) || m.type != LW_MESSAGE_REFUSAL) return 2;
    return m.refusal.code == LW_REFUSAL_NOT_ALLOWED ? 0 : 3;
}

static void test_the_control_socket_knows_its_user(void **state) {
    (void)state;
    if (geteuid() != 0) {
        print_message("skipped: only root can become another user\n");
        skip();
    }
    struct fixture *f = start_controlled();
    /* the file's permissions would keep it out: this is about what is behind them */
    const char *path = lw_support_temporary("control.sock");
    char folder[200];
    snprintf(folder, sizeof folder, "%.*s", (int)(strrchr(path, '/') - path), path);
    assert_int_equal(chmod(folder, 0755), 0);
    assert_int_equal(chmod(path, 0666), 0);
    const pid_t child = fork();
    if (child == 0) _exit(try_as_somebody_else());
    int status;
    assert_int_equal(waitpid(child, &status, 0), child);
    assert_true(WIFEXITED(status));
    assert_int_equal(WEXITSTATUS(status), 0);
    close(dial_and_control(f, false));
    end(f);
}

static void test_token_files_that_cannot_be_used(void **state) {
    (void)state;
    struct fixture *f = start(&(struct lw_server_desc){0});
    struct lw_server_desc desc = {.atlas_map = &f->map, .package = f->package, .package_size = PACKAGE_SIZE};
    struct lw_server *server;
    struct lw_error err = {0};
    desc.tokens = write_tokens(view_token, NULL);
    assert_int_equal(chmod(desc.tokens, 0644), 0);
    lw_support_fails(lw_server_create(&desc, &server, &err), LW_BAD_DATA, &err, "--tokens: ");
    assert_non_null(strstr(err.text, "others can read"));
    end(f);
}

static void test_updates_want_the_role(void **state) {
    (void)state;
    struct fixture *f = start_controlled();
    int s = dial_and_greet(f); /* without the feature */
    update(s, 1, &hide_1, 1);
    expect_refusal(s, LW_REFUSAL_NOT_ALLOWED);
    s = dial_with_token(f, NULL, 0); /* from this machine, but over TCP */
    update(s, 1, &hide_1, 1);
    expect_refusal(s, LW_REFUSAL_NOT_ALLOWED);
    s = dial_locally(); /* before hello */
    update(s, 1, &hide_1, 1);
    expect_refusal(s, LW_REFUSAL_PROTOCOL);
    end(f);
    f = start(&(struct lw_server_desc){0}); /* a server without a scene takes up nothing */
    s = dial(f);
    struct lw_message m, control = hello;
    control.hello.features = LW_FEATURE_CONTROL;
    put(s, &control);
    expect(s, LW_MESSAGE_WELCOME, &m);
    assert_int_equal(m.welcome.features, 0);
    lw_message_finish(&m);
    update(s, 1, &hide_1, 1);
    expect_refusal(s, LW_REFUSAL_NOT_ALLOWED);
    end(f);
}

/* Over the server's own socket alone, and for who has said so; a question that is unknown is answered,
 * too. */
static void test_operators_ask_over_the_socket(void **state) {
    (void)state;
    struct fixture *f = start_controlled();
    struct lw_message m, asker = hello;
    const struct lw_message stats = {.type = LW_MESSAGE_ASK, .ask = {5, LW_ASK_STATS, 0}},
                            unknown = {.type = LW_MESSAGE_ASK, .ask = {6, 99, 0}};
    asker.hello.features |= LW_FEATURE_OPERATE;
    int s = dial(f);
    put(s, &asker);
    expect(s, LW_MESSAGE_WELCOME, &m);
    assert_false(m.welcome.features & LW_FEATURE_OPERATE);
    lw_message_finish(&m);
    put(s, &stats);
    expect_refusal(s, LW_REFUSAL_NOT_ALLOWED);
    s = dial_locally();
    put(s, &hello); /* does not say so */
    expect(s, LW_MESSAGE_WELCOME, &m);
    lw_message_finish(&m);
    put(s, &stats);
    expect_refusal(s, LW_REFUSAL_NOT_ALLOWED);
    s = dial_locally();
    put(s, &asker);
    expect(s, LW_MESSAGE_WELCOME, &m);
    assert_true(m.welcome.features & LW_FEATURE_OPERATE);
    lw_message_finish(&m);
    put(s, &unknown);
    expect(s, LW_MESSAGE_REPORT, &m);
    assert_int_equal(m.report.request, 6);
    assert_int_equal(m.report.code, LW_REPORT_UNKNOWN);
    lw_message_finish(&m);
    put(s, &stats); /* this server has no pages */
    expect(s, LW_MESSAGE_REPORT, &m);
    assert_int_equal(m.report.request, 5);
    assert_int_equal(m.report.code, LW_REPORT_UNKNOWN);
    lw_message_finish(&m);
    close(s);
    end(f);
}

static void test_answers_that_nobody_reads_end_the_session(void **state) {
    (void)state;
    struct fixture *f = start_controlled();
    int s = dial_and_control(f, false), other = dial_and_stream(f);
    struct lw_blob *blob = blob_of(
        &(struct lw_message){.type = LW_MESSAGE_UPDATE, .update = {.change = &no_such, .change_count = 1}});
    /* each of them is answered at once, and none of the answers is read */
    for (size_t total = 0; stats_of(f).sessions_now == 2;) {
        const size_t at = total % blob->size;
        const ssize_t n = send(s, blob->bytes + at, blob->size - at, MSG_NOSIGNAL | MSG_DONTWAIT);
        if (n > 0)
            total += (size_t)n;
        else
            server_clock_step(STEP_MS);
    }
    lw_blob_unref(blob);
    publish(f, make_snapshot(f, 1, 0));
    expect_frame(other, 1, 1); /* who is none the wiser */
    close(s);
    close(other);
    end(f);
}

/* ---- fairness ---- */

/* Writes until the link takes no more though the server has had its turns, or the other end has closed it,
 * which sets *out_closed. Returns the bytes. total: what has been written of this already. */
static size_t flood(int s, const struct lw_blob *bytes, size_t total, bool *out_closed) {
    for (unsigned full = 0; full < 3;) {
        const size_t at = total % bytes->size;
        const ssize_t n = send(s, bytes->bytes + at, bytes->size - at, MSG_NOSIGNAL | MSG_DONTWAIT);
        *out_closed = n < 0 && errno != EAGAIN;
        if (*out_closed || total > FLOOD_MAX) return total;
        if (n > 0) total += (size_t)n;
        full = n > 0 ? 0 : full + 1;
        if (n < 0) server_clock_step(0);
    }
    return total;
}

/* The refusal's text after what else was sent; its code must be this. */
static void take_refusal(int s, enum lw_refusal code, char text[LW_MESSAGE_TEXT_MAX + 1]) {
    struct lw_message m;
    *text = '\0';
    while (get(s, &m)) {
        if (m.type == LW_MESSAGE_REFUSAL) {
            assert_int_equal(m.refusal.code, code);
            snprintf(text, LW_MESSAGE_TEXT_MAX + 1, "%s", m.refusal.text);
        }
        lw_message_finish(&m);
    }
    close(s);
}

/* Most of a flood is not read: it stays in the sockets of both sides. Who goes on is refused, and told
 * why. */
static void test_flood_of_messages(void **state) {
    (void)state;
    static const struct {
        struct lw_message message;
        const char *name;
    } of[] = {{{.type = LW_MESSAGE_PING, .ping.token = 5}, "PING"},
              {{.type = LW_MESSAGE_PONG, .pong.token = 5}, "PONG"},
              {{.type = LW_MESSAGE_INTEREST, .interest.everything = true}, "INTEREST"},
              {{.type = LW_MESSAGE_ACK, .ack.frame = 1}, "ACK"}};
    struct fixture *f = start(&(struct lw_server_desc){.excess_timeout_ms = 1500});
    publish(f, make_snapshot(f, 1, 0));
    int good = dial_and_stream(f);
    expect_light(f, good, 1);
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        struct lw_blob *one = blob_of(&of[i].message), *many;
        lw_support_ok(lw_blob_create(one->size * 4096, &many), NULL);
        for (size_t m = 0; m < 4096; m++) memcpy(many->bytes + m * one->size, one->bytes, one->size);
        int s = dial_and_stream(f);
        expect_light(f, s, 1);
        bool closed;
        size_t total = flood(s, many, 0, &closed);
        assert_true(!closed && total < FLOOD_MAX);
        struct lw_message m; /* others do not notice */
        put(good, &(struct lw_message){.type = LW_MESSAGE_PING, .ping.token = CLIENT_TOKEN + i});
        expect(good, LW_MESSAGE_PONG, &m);
        assert_int_equal(m.pong.token, CLIENT_TOKEN + i);
        lw_message_finish(&m);
        for (unsigned step = 0; !closed && stats_of(f).refused == i; step++) {
            assert_true(step < 25); /* of 100 ms */
            server_clock_step(100);
            total = flood(s, many, total, &closed);
            assert_true(total < FLOOD_MAX);
        }
        char text[LW_MESSAGE_TEXT_MAX + 1];
        take_refusal(s, LW_REFUSAL_RATE, text);
        if (!strstr(text, of[i].name)) fail_msg("a flood of %s: \"%s\"", of[i].name, text);
        lw_blob_unref(one);
        lw_blob_unref(many);
    }
    close(good);
    end(f);
}

static void test_who_never_takes_the_package_is_refused(void **state) {
    (void)state;
    struct fixture *f = start(&(struct lw_server_desc){.package_timeout_ms = 1000});
    int s = dial_and_greet(f), taker = dial_and_stream(f);
    put(s, &(struct lw_message){.type = LW_MESSAGE_PONG}); /* that does not help */
    is_paced = true;
    expect_refusal(s, LW_REFUSAL_TIMEOUT);
    is_paced = false;
    server_clock_step(500);
    expect_silence(taker);
    close(taker);
    end(f);
    f = start_controlled_with((struct lw_server_desc){.package_timeout_ms = 500});
    s = dial_and_control(f, false); /* who controls need not take it */
    server_clock_step(1500);
    expect_silence(s);
    close(s);
    end(f);
}

static void test_silent_peers_are_pinged(void **state) {
    (void)state;
    struct fixture *f = start(&(struct lw_server_desc){.silence_timeout_ms = 2000});
    int silent = dial_and_stream(f), good = dial_and_stream(f);
    struct lw_message m;
    is_paced = true;
    for (unsigned i = 0; i < 4; i++) {
        expect(good, LW_MESSAGE_PING, &m);
        put(good, &(struct lw_message){.type = LW_MESSAGE_PONG, .pong.token = m.ping.token});
        lw_message_finish(&m);
    }
    expect(silent, LW_MESSAGE_PING, &m);
    lw_message_finish(&m);
    expect_refusal(silent, LW_REFUSAL_TIMEOUT);
    wait_for_sessions(f, 1);
    close(good);
    end(f);
}

/* ---- forms of light ---- */

/* Both forms, or one, of all tiles. */
static struct lw_snapshot *make_forms(const struct fixture *f, uint64_t frame, uint64_t previous,
                                      uint32_t forms) {
    struct lw_snapshot *of[LW_LIGHT_FORM_COUNT] = {0}, *snapshot = NULL;
    const enum lw_light_form before = form;
    for (unsigned i = 0; i < LW_LIGHT_FORM_COUNT; i++) {
        form = (enum lw_light_form)i;
        if (forms >> i & 1) snapshot = of[i] = make_snapshot(f, frame, previous);
    }
    form = before;
    for (unsigned i = 0; i < LW_LIGHT_FORM_COUNT; i++) {
        if (!of[i] || of[i] == snapshot) continue;
        snapshot->tile[i] = of[i]->tile[i];
        of[i]->tile[i] = NULL;
        lw_snapshot_unref(of[i]);
    }
    snapshot->channels = forms;
    return snapshot;
}

static int dial_in(const struct fixture *f, enum lw_light_form as) {
    form = as;
    return dial_and_stream(f);
}

static void expect_light_in(const struct fixture *f, int s, enum lw_light_form as, uint64_t frame) {
    form = as;
    expect_light(f, s, frame);
}

static void wait_for_forms(const struct fixture *f, uint32_t forms) {
    LW_SUPPORT_WAIT_UNTIL(lw_server_channels_taken(f->server) == forms);
}

/* Each gets its own form, whatever the others get; who comes when nobody has taken its form waits for it. */
static void test_forms_beside_each_other(void **state) {
    (void)state;
    enum { FULL = 1u << LW_LIGHT_FORM_FULL, SPLIT = 1u << LW_LIGHT_FORM_SPLIT };
    struct fixture *f = start(&(struct lw_server_desc){0});
    assert_int_equal(lw_server_channels_taken(f->server), 0);
    publish(f, make_forms(f, 1, 0, FULL));
    int full = dial_in(f, LW_LIGHT_FORM_FULL);
    expect_light_in(f, full, LW_LIGHT_FORM_FULL, 1);
    assert_int_equal(lw_server_channels_taken(f->server), FULL);
    int split = dial_in(f, LW_LIGHT_FORM_SPLIT);
    wait_for_forms(f, FULL | SPLIT);
    assert_int_equal(stats_of(f).sessions_now, 2);
    assert_int_equal(stats_of(f).sessions_drawing, 1);
    expect_silence(split);
    publish(f, make_forms(f, 2, 1, FULL | SPLIT));
    expect_light_in(f, split, LW_LIGHT_FORM_SPLIT, 2);
    form = LW_LIGHT_FORM_FULL;
    expect_frame(full, 2, 2); /* as a difference: it had all of the one before */
    expect_tiles(full, f->map.tile_count, 2);
    /* one form is left out: its sessions keep what they have, and a newcomer gets nothing of old */
    publish(f, make_forms(f, 3, 2, FULL));
    expect_frame(full, 3, 2);
    expect_tiles(full, f->map.tile_count, 3);
    int late = dial_in(f, LW_LIGHT_FORM_SPLIT);
    expect_silence(split);
    expect_silence(late);
    publish(f, make_forms(f, 4, 3, FULL | SPLIT));
    expect_light_in(f, split, LW_LIGHT_FORM_SPLIT, 4);
    expect_light_in(f, late, LW_LIGHT_FORM_SPLIT, 4);
    form = LW_LIGHT_FORM_FULL;
    expect_frame(full, 4, 2);
    expect_tiles(full, f->map.tile_count, 4);
    close(full);
    wait_for_forms(f, SPLIT);
    close(split);
    wait_for_sessions(f, 1);
    assert_int_equal(lw_server_channels_taken(f->server), SPLIT);
    close(late);
    wait_for_forms(f, 0);
    assert_int_equal(stats_of(f).sessions_drawing, 0);
    end(f);
    form = LW_LIGHT_FORM_FULL;
}

/* Who has not asked for light takes no form. */
static void test_a_form_is_taken_with_the_package(void **state) {
    (void)state;
    struct fixture *f = start(&(struct lw_server_desc){0});
    form = LW_LIGHT_FORM_SPLIT;
    int s = dial_and_greet(f);
    expect_silence(s);
    assert_int_equal(lw_server_channels_taken(f->server), 0);
    ask_for_package(s, 0);
    wait_for_forms(f, 1u << LW_LIGHT_FORM_SPLIT);
    close(s);
    wait_for_forms(f, 0);
    end(f);
    form = LW_LIGHT_FORM_FULL;
}

/* A server without client lights takes the offer of nobody. */
static void test_no_client_lights(void **state) {
    (void)state;
    static const uint8_t none[] = {0, 0};
    for (int i = 0; i < 2; i++) {
        struct lw_server *server;
        struct fixture *f = start(&(struct lw_server_desc){0});
        struct lw_server_desc desc = {.host = "127.0.0.1",
                                      .atlas_map = &f->map,
                                      .package = f->package,
                                      .package_size = PACKAGE_SIZE,
                                      .client_lights = i ? none : NULL,
                                      .client_lights_size = i ? sizeof none : 0};
        lw_server_stop(f->server);
        join(f);
        lw_support_ok(lw_server_create(&desc, &server, NULL), NULL);
        f->server = server;
        assert_int_equal(pthread_create(&f->thread, NULL, serve, f), 0);
        close(dial_and_greet_with(f, LW_FEATURE_DRAWS)); /* which looks at what is taken up */
        end(f);
    }
}

static int ask_for_split(void **state) {
    (void)state;
    form = LW_LIGHT_FORM_SPLIT;
    return 0;
}

int main(void) {
    const struct CMUnitTest in_split_form[] = {
        cmocka_unit_test(test_join),
        cmocka_unit_test(test_waiting_for_the_first_light),
        cmocka_unit_test(test_what_is_held_is_not_sent),
        cmocka_unit_test(test_who_knows_no_finishes_hears_of_none),
        cmocka_unit_test(test_finishes),
        cmocka_unit_test(test_finishes_wait_for_the_first_light),
        cmocka_unit_test(test_finishes_out_of_order),
        cmocka_unit_test(test_newer_snapshot),
        cmocka_unit_test(test_deltas),
        cmocka_unit_test(test_deltas_to_catch_up),
        cmocka_unit_test(test_a_jump_to_catch_up),
        cmocka_unit_test(test_a_narrow_link),
        cmocka_unit_test(test_settled),
        cmocka_unit_test(test_stand_ins_wait),
        cmocka_unit_test(test_blobs_are_shared),
        cmocka_unit_test(test_the_most_visible_change_goes_first),
    };
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_forms_beside_each_other),
        cmocka_unit_test(test_a_form_is_taken_with_the_package),
        cmocka_unit_test(test_no_client_lights),
        cmocka_unit_test(test_updates_are_answered_with_their_frame),
        cmocka_unit_test(test_wrong_updates_are_answered_and_nothing_of_them_is_done),
        cmocka_unit_test(test_spares_are_given_out_in_order),
        cmocka_unit_test(test_a_thousand_updates_in_one_frame_keep_their_order),
        cmocka_unit_test(test_changes_that_wait_are_bounded),
        cmocka_unit_test(test_who_leaves_gets_no_answer_but_its_changes_are_made),
        cmocka_unit_test(test_updates_want_the_role),
        cmocka_unit_test(test_operators_ask_over_the_socket),
        cmocka_unit_test(test_answers_that_nobody_reads_end_the_session),
        cmocka_unit_test(test_tokens),
        cmocka_unit_test(test_places_are_kept_for_control),
        cmocka_unit_test(test_the_control_socket),
        cmocka_unit_test(test_the_control_socket_knows_its_user),
        cmocka_unit_test(test_tokens_are_read_again),
        cmocka_unit_test(test_token_files_that_cannot_be_used),
        cmocka_unit_test(test_join),
        cmocka_unit_test(test_waiting_for_the_first_light),
        cmocka_unit_test(test_package_from_offset),
        cmocka_unit_test(test_parts_of_the_package),
        cmocka_unit_test(test_what_is_held_is_not_sent),
        cmocka_unit_test(test_newer_snapshot),
        cmocka_unit_test(test_deltas),
        cmocka_unit_test(test_deltas_to_catch_up),
        cmocka_unit_test(test_a_jump_to_catch_up),
        cmocka_unit_test(test_a_narrow_link),
        cmocka_unit_test(test_settled),
        cmocka_unit_test(test_interest),
        cmocka_unit_test(test_stand_ins),
        cmocka_unit_test(test_stand_ins_wait),
        cmocka_unit_test(test_union_of_interest),
        cmocka_unit_test(test_flood_of_interest),
        cmocka_unit_test(test_blobs_are_shared),
        cmocka_unit_test(test_slow_reader),
        cmocka_unit_test(test_stalled_reader_is_closed),
        cmocka_unit_test(test_a_stalled_reader_is_told),
        cmocka_unit_test(test_questions_do_not_wait_for_a_snapshot),
        cmocka_unit_test(test_rate_limits),
        cmocka_unit_test(test_the_most_visible_change_goes_first),
        cmocka_unit_test(test_what_waits_is_told),
        cmocka_unit_test(test_acks),
        cmocka_unit_test(test_bytes_gone_wrong),
        cmocka_unit_test(test_garbage),
        cmocka_unit_test(test_out_of_order),
        cmocka_unit_test(test_wrong_version),
        cmocka_unit_test(test_who_knows_no_finer_levels_gets_none),
        cmocka_unit_test(test_finer_levels_are_sent_to_who_lists_them),
        cmocka_unit_test(test_ids_of_fine_tiles_go_to_others),
        cmocka_unit_test(test_a_session_has_so_many_fine_tiles),
        cmocka_unit_test(test_features_that_are_needed),
        cmocka_unit_test(test_half_hello),
        cmocka_unit_test(test_many_messages_in_pieces),
        cmocka_unit_test(test_flood_of_messages),
        cmocka_unit_test(test_who_never_takes_the_package_is_refused),
        cmocka_unit_test(test_silent_peers_are_pinged),
        cmocka_unit_test(test_abrupt_close),
        cmocka_unit_test(test_many_connects),
        cmocka_unit_test(test_full),
        cmocka_unit_test(test_an_address_has_its_places),
        cmocka_unit_test(test_refused_ones_that_linger),
        cmocka_unit_test(test_who_is_turned_away_is_told),
        cmocka_unit_test(test_stop_while_sending),
        cmocka_unit_test(test_stop_before_and_without_run),
        cmocka_unit_test(test_stop_says_when_to_come_back),
        cmocka_unit_test(test_hangup_reloads),
        cmocka_unit_test(test_signal),
        cmocka_unit_test(test_address_errors),
        cmocka_unit_test(test_an_idle_loop_waits),
    };
    const int failed = cmocka_run_group_tests(tests, NULL, NULL);
    return failed + cmocka_run_group_tests(in_split_form, ask_for_split, NULL);
}
