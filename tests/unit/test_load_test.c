/* Against servers that are none: each says its piece to one user after another and then waits for their
 * end. */
#include "tests/support/support.h"

#include "client/load/load_test.h"
#include "common/tile/tile_codec.h"
#include "proto/message.h"

#include <arpa/inet.h>
#include <math.h>
#include <netinet/in.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>
#include <zstd.h>

#define USERS_MAX 4u
#define LATE_MS   1000
#define SECONDS   3 /* measured: what a server says comes within them on a busy machine, too */

struct fake;

/** What a server says to user number `user` (from 0) instead of WELCOME or after its PACKAGE_REQUEST. */
struct part {
    void (*instead)(struct fake *fake, uint32_t user);
    void (*after)(struct fake *fake, uint32_t user);
    bool hangs_up; /* when all users have heard their parts */
};

struct fake {
    const struct part *part;
    uint32_t users;
    int listener, peer;
    uint16_t port;
    pthread_t thread;
    struct lw_scene *scene;
    struct lw_atlas_map map;
    uint8_t *package, *compressed;
    size_t package_size, compressed_size;
    struct lw_tile_codec *codec;
};

/* ---- what a server says ---- */

static void say_bytes(struct fake *f, const void *bytes, size_t size) {
    /* a user that got nonsense may leave in the middle of it */
    (void)!send(f->peer, bytes, size, MSG_NOSIGNAL);
}

static void say(struct fake *f, const struct lw_message *message) {
    uint8_t *bytes;
    size_t size;
    lw_support_ok(lw_message_encode_alloc(message, &bytes, &size), NULL);
    say_bytes(f, bytes, size);
    free(bytes);
}

static void say_frame(struct fake *f, uint64_t frame) {
    say(f,
        &(struct lw_message){.type = LW_MESSAGE_FRAME,
                             .frame = {.frame = frame, .solve_ns = 5000000, .server_cpu_ns = 1000 * frame}});
}

static void say_settled(struct fake *f, uint64_t frame) {
    say(f, &(struct lw_message){.type = LW_MESSAGE_SETTLED, .settled.frame = frame});
}

/* All texels of a tile have one value. */
static void say_tile(struct fake *f, uint32_t id, uint64_t version, float value, size_t cut_off) {
    static float rgb[LW_TILE_TEXELS_MAX * 3];
    const struct lw_tile_place *p = &f->map.place[id];
    uint8_t *payload = malloc(lw_tile_codec_bound());
    uint32_t saturated;
    for (uint32_t i = 0; i < p->width * p->height * 3; i++) rgb[i] = value;
    struct lw_message m = {.type = LW_MESSAGE_TILE,
                           .tile = {.object = p->object,
                                    .level = p->level,
                                    .tile = p->y * f->map.atlas[p->object]->level[p->level].tiles_x + p->x,
                                    .version = version,
                                    .codec = LW_TILE_CODEC_HALF_ZSTD,
                                    .bounces = 2,
                                    .payload = payload}};
    lw_support_ok(lw_tile_codec_encode_half(f->codec, NULL, rgb, p->width, p->height, payload,
                                            lw_tile_codec_bound(), &m.tile.payload_size, &m.tile.scale,
                                            &saturated),
                  NULL);
    m.tile.payload_size -= cut_off;
    say(f, &m);
    free(payload);
}

static void say_tiles(struct fake *f, uint64_t version) {
    for (uint32_t t = 0; t < f->map.tile_count; t++) say_tile(f, t, version, (float)version, 0);
}

static void say_welcome(struct fake *f, bool other_package) {
    struct lw_message m = {.type = LW_MESSAGE_WELCOME,
                           .welcome = {.version = LW_WIRE_VERSION,
                                       .session = 1,
                                       .name = "fake",
                                       .package_size = f->package_size,
                                       .package_compressed_size = f->compressed_size,
                                       .bounces = 2,
                                       .target_error = 0.02f}};
    lw_package_hash(f->package, f->package_size, &m.welcome.package_hash);
    m.welcome.package_hash.bytes[0] ^= other_package;
    say(f, &m);
}

/* In two chunks; the second one may be spoiled. */
static void say_package(struct fake *f, uint8_t spoil) {
    const size_t half = f->compressed_size / 2;
    uint8_t *copy = malloc(f->compressed_size);
    memcpy(copy, f->compressed, f->compressed_size);
    copy[f->compressed_size - 1] ^= spoil;
    for (int i = 0; i < 2; i++)
        say(f, &(struct lw_message){.type = LW_MESSAGE_PACKAGE_CHUNK,
                                    .package_chunk = {i ? half : 0, copy + (i ? half : 0),
                                                      i ? f->compressed_size - half : half}});
    free(copy);
}

/* ---- a server ---- */

/* Reads one whole message; returns its type, 0 at the end of the link. */
static uint16_t hear(struct fake *f, struct lw_message *out_message) {
    uint8_t bytes[LW_FRAMING_HEADER_SIZE + 1024];
    struct lw_framing_header header;
    if (recv(f->peer, bytes, LW_FRAMING_HEADER_SIZE, MSG_WAITALL) != (ssize_t)LW_FRAMING_HEADER_SIZE)
        return 0;
    lw_support_ok(lw_framing_read_header(bytes, 1024, &header, NULL), NULL);
    ssize_t body_size = (ssize_t)header.body_size; /* with none, recv() would wait for the next message */
    if (body_size &&
        recv(f->peer, bytes + LW_FRAMING_HEADER_SIZE, (size_t)body_size, MSG_WAITALL) != body_size)
        return 0;
    lw_support_ok(lw_message_decode(header, bytes + LW_FRAMING_HEADER_SIZE, out_message, NULL), NULL);
    return header.type;
}

/* Returns where the client's package begins; or UINT64_MAX if it left instead. */
static uint64_t hear_request(struct fake *f) {
    struct lw_message m;
    uint64_t offset = UINT64_MAX;
    for (uint16_t type = 1; type && offset == UINT64_MAX;) {
        if (!(type = hear(f, &m))) break;
        if (type == LW_MESSAGE_PACKAGE_REQUEST) offset = m.package_request.offset;
        lw_message_finish(&m);
    }
    return offset;
}

static void hear_hello(struct fake *f) {
    struct lw_message m;
    assert_int_equal(hear(f, &m), LW_MESSAGE_HELLO);
    lw_message_finish(&m);
}

static void *serve(void *argument) {
    struct fake *f = argument;
    int peer[USERS_MAX];
    f->peer = accept(f->listener, NULL, NULL); /* who downloads for all */
    hear_hello(f);
    say_welcome(f, false);
    assert_int_equal(hear_request(f), 0);
    say(f, &(struct lw_message){.type = LW_MESSAGE_PONG, .pong.token = 1}); /* as after 5 s of download */
    say_package(f, 0);
    close(f->peer);
    bool asked[USERS_MAX] = {false};
    for (uint32_t u = 0; u < f->users; u++) { /* when the last one says hello, the measured time has begun */
        f->peer = peer[u] = accept(f->listener, NULL, NULL);
        hear_hello(f);
        if (f->part->instead) {
            f->part->instead(f, u);
            continue;
        }
        say_welcome(f, false);
        asked[u] = hear_request(f) != UINT64_MAX;
    }
    for (uint32_t u = 0; u < f->users; u++) {
        f->peer = peer[u];
        if (asked[u] && f->part->after) f->part->after(f, u);
    }
    for (uint32_t u = 0; u < f->users; u++) {
        struct lw_message m;
        for (f->peer = peer[u]; !f->part->hangs_up && hear(f, &m);) {
            if (m.type == LW_MESSAGE_PING)
                say(f, &(struct lw_message){.type = LW_MESSAGE_PONG, .pong.token = m.ping.token});
            lw_message_finish(&m);
        }
        close(peer[u]);
    }
    return NULL;
}

static void start(struct fake *f, const struct part *part, uint32_t users) {
    struct sockaddr_in address = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    socklen_t length = sizeof address;
    struct lw_error err = {0};
    *f = (struct fake){.part = part, .users = users, .scene = lw_support_squares(1, 1)};
    f->scene->mesh[0].atlas_width = 128;
    f->scene->mesh[0].atlas_height = 64;
    f->scene->mesh[0].lightmap_uv = f->scene->mesh[0].uv[0];
    lw_support_ok(lw_atlas_map_init(&f->map, f->scene), NULL);
    lw_support_ok(lw_package_write(f->scene, &f->package, &f->package_size, &err), &err);
    f->compressed = malloc(ZSTD_compressBound(f->package_size));
    f->compressed_size =
        ZSTD_compress(f->compressed, ZSTD_compressBound(f->package_size), f->package, f->package_size, 3);
    lw_support_ok(lw_tile_codec_create(&f->codec), NULL);
    f->listener = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    assert_int_equal(bind(f->listener, (struct sockaddr *)&address, sizeof address), 0);
    assert_int_equal(listen(f->listener, 16), 0);
    assert_int_equal(getsockname(f->listener, (struct sockaddr *)&address, &length), 0);
    f->port = ntohs(address.sin_port);
    assert_int_equal(pthread_create(&f->thread, NULL, serve, f), 0);
}

static void stop(struct fake *f) {
    pthread_join(f->thread, NULL);
    close(f->listener);
    lw_tile_codec_destroy(f->codec);
    free(f->package);
    free(f->compressed);
    lw_atlas_map_finish(&f->map);
    lw_scene_destroy(f->scene);
}

static struct lw_load_options options_for(const struct fake *f) {
    struct lw_load_options o = {.host = "127.0.0.1",
                                .port = f->port,
                                .users = f->users,
                                .seconds = SECONDS,
                                .ramp_hz = 1000,
                                .latency_max_ms = (double)INFINITY,
                                .first_view_max_ms = (double)INFINITY};
    return o;
}

/* The caller frees. */
static struct lw_load_report *run(const struct part *part, uint32_t users, bool download,
                                  uint32_t *out_tiles) {
    struct fake fake;
    struct lw_load_report *report;
    struct lw_error err = {0};
    start(&fake, part, users);
    struct lw_load_options options = options_for(&fake);
    options.download = download;
    lw_support_ok(lw_load_test_run(&options, &report, &err), &err);
    if (out_tiles) *out_tiles = fake.map.tile_count;
    stop(&fake);
    return report;
}

/* ---- good servers ---- */

static void say_two_frames(struct fake *f, uint32_t user) {
    (void)user;
    say_frame(f, 3);
    say_frame(f, 3); /* a large frame comes in several messages */
    say_tiles(f, 2);
    say_settled(f, 3);
    say_frame(f, 4);
    say_bytes(f, "\x01\x00\x00\x00\xff\x00\x00\x00?", 9); /* a newer server's message */
    say_tiles(f, 4);
    say_settled(f, 4);
}

static void test_figures(void **state) {
    (void)state;
    uint32_t tiles;
    struct lw_load_report *r = run(&(struct part){.after = say_two_frames}, 1, false, &tiles);
    const struct lw_load_figures *f = &r->figures;
    for (int i = 0; i < LW_LOAD_FAULT_COUNT; i++)
        if (f->fault[i]) fail_msg("fault %d: %s", i, f->first_fault[i]);
    assert_int_equal(r->end, LW_LOAD_END_TIME);
    assert_int_equal(f->asked, 1);
    assert_int_equal(f->welcomed, 1);
    assert_int_equal(f->refused + f->lost, 0);
    assert_int_equal(f->tiles, 2 * tiles);
    assert_int_equal(f->frames, 2);
    assert_int_equal(f->settled, 2);
    assert_int_equal(r->tiles_decoded, 2 * tiles);
    assert_int_equal(f->first_view.count, 1);
    assert_int_equal(f->connect.count, 1);
    assert_int_equal(f->update.count, tiles); /* tiles of the first view do not count */
    assert_int_equal(f->age.count, tiles);
    assert_true(f->age.min >= 5000000 && f->age.min <= 5000000 + f->update.max);
    assert_int_equal(f->whole.count, 1);
    assert_true((double)f->whole.max < SECONDS * 1e9);
    assert_true(r->measured_s >= SECONDS && r->measured_s < 10);
    assert_int_equal(r->users_at_end, 1);
    assert_true(r->user_s > 0.5 * SECONDS && r->user_s <= r->measured_s + 0.1);
    free(r);
}

static void say_at_user_times(struct fake *f, uint32_t user) {
    if (user == 1) usleep(LATE_MS * 1000);
    say_frame(f, 1);
    say_tiles(f, 1);
    say_frame(f, 2);
    say_tiles(f, 2);
    say_settled(f, 2);
}

/* The second user hears of frame 2 so much later than the first: that is its latency. */
static void test_latency_counts_from_the_first_who_heard(void **state) {
    (void)state;
    uint32_t tiles;
    struct lw_load_report *r = run(&(struct part){.after = say_at_user_times}, 2, false, &tiles);
    const struct lw_load_figures *f = &r->figures;
    assert_int_equal(f->update.count, 2 * tiles);
    assert_true(f->update.max >= 0.95 * LATE_MS * 1e6);
    assert_true((double)lw_histogram_quantile(&f->update, 0.25) < 0.75 * LATE_MS * 1e6);
    assert_int_equal(r->tiles_decoded, 2 * tiles);
    free(r);
}

static void say_package_to_one(struct fake *f, uint32_t user) { say_package(f, user ? 0x40 : 0); }

/* By --download each gets the package, and each byte of it is compared. */
static void test_downloads_of_all(void **state) {
    (void)state;
    struct lw_load_report *r = run(&(struct part){.after = say_package_to_one}, 2, true, NULL);
    assert_int_equal(r->figures.download.count, 1);
    assert_int_equal(r->figures.fault[LW_LOAD_FAULT_PACKAGE], 1);
    assert_int_equal(r->figures.lost, 1);
    free(r);
}

/* ---- bad servers ---- */

static void refuse(struct fake *f, uint32_t user) {
    (void)user;
    say(f,
        &(struct lw_message){.type = LW_MESSAGE_REFUSAL,
                             .refusal = {.code = LW_REFUSAL_FULL, .text = "the server has its 0 sessions"}});
}
static void send_away(struct fake *f, uint32_t user) {
    (void)user;
    say_frame(f, 1);
    say(f, &(struct lw_message){.type = LW_MESSAGE_REFUSAL,
                                .refusal = {.code = LW_REFUSAL_SHUTDOWN, .text = "the server ends"}});
}
static void welcome_to_another(struct fake *f, uint32_t user) {
    (void)user;
    say_welcome(f, true);
}
static void welcome_twice(struct fake *f, uint32_t user) {
    (void)user;
    say_welcome(f, false);
    say_welcome(f, false);
}
static void say_garbage(struct fake *f, uint32_t user) {
    (void)user;
    say_bytes(f, "HTTP/1.1 200 OK\r\n\r\n", 19);
}
static void say_undecodable(struct fake *f, uint32_t user) {
    (void)user;
    say_bytes(f, "\x01\x00\x00\x00\x07\x00\x00\x00\xff", 9);
}
static void say_what_clients_say(struct fake *f, uint32_t user) {
    (void)user;
    say(f, &(struct lw_message){.type = LW_MESSAGE_ACK, .ack.frame = 1});
}
static void say_chunk_too_many(struct fake *f, uint32_t user) {
    (void)user;
    say_package(f, 0);
}
static void say_tile_before_frame(struct fake *f, uint32_t user) {
    (void)user;
    say_tile(f, 0, 1, 1, 0);
}
static void say_settled_of_another(struct fake *f, uint32_t user) {
    (void)user;
    say_frame(f, 2);
    say_settled(f, 1);
}
static void say_frame_backwards(struct fake *f, uint32_t user) {
    (void)user;
    say_frame(f, 2);
    say_frame(f, 1);
}
static void say_object_nowhere(struct fake *f, uint32_t user) {
    (void)user;
    struct lw_message_transform moved = {.object = f->map.object_count,
                                         .object_to_world = LW_AFFINE_IDENTITY};
    say(f, &(struct lw_message){.type = LW_MESSAGE_FRAME,
                                .frame = {.frame = 1, .transform = &moved, .transform_count = 1}});
}
static void say_tile_nowhere(struct fake *f, uint32_t user) {
    (void)user;
    say_frame(f, 1);
    say(f, &(struct lw_message){.type = LW_MESSAGE_TILE,
                                .tile = {.object = 7,
                                         .version = 1,
                                         .codec = 1,
                                         .scale = 1,
                                         .payload = (const uint8_t *)"",
                                         .payload_size = 1}});
}
static void say_damaged_tile(struct fake *f, uint32_t user) {
    (void)user;
    say_frame(f, 1);
    say_tile(f, 0, 1, 1, 3);
}
static void say_version_again(struct fake *f, uint32_t user) {
    (void)user;
    say_frame(f, 1);
    say_tile(f, 0, 1, 1, 0);
    say_tile(f, 0, 1, 1, 0);
}
static void say_other_light(struct fake *f, uint32_t user) {
    say_frame(f, 1);
    say_tile(f, 0, 1, 1.0f + (float)user, 0);
}
static void say_nothing_more(struct fake *f, uint32_t user) {
    (void)user;
    say_frame(f, 1);
}
static void say_pong_of_nobody(struct fake *f, uint32_t user) {
    (void)user;
    say(f, &(struct lw_message){.type = LW_MESSAGE_PONG, .pong.token = 3});
}

static void test_faults(void **state) {
    (void)state;
    static const struct {
        struct part part;
        uint32_t users;
        enum lw_load_fault fault;
        bool goes_on; /* the session does, all the same */
        bool welcomed;
    } cases[] = {
        {{.instead = refuse}, 1, LW_LOAD_FAULT_REFUSED, false, false},
        {{.instead = say_garbage}, 1, LW_LOAD_FAULT_MESSAGE, false, false},
        {{.instead = welcome_to_another}, 1, LW_LOAD_FAULT_PACKAGE, false, false},
        {{.instead = welcome_twice}, 1, LW_LOAD_FAULT_ORDER, false, true},
        {{.after = send_away}, 1, LW_LOAD_FAULT_LOST, false, true},
        {{.after = say_nothing_more, .hangs_up = true}, 1, LW_LOAD_FAULT_LOST, false, true},
        {{.after = say_undecodable}, 1, LW_LOAD_FAULT_MESSAGE, false, true},
        {{.after = say_what_clients_say}, 1, LW_LOAD_FAULT_MESSAGE, false, true},
        {{.after = say_chunk_too_many}, 1, LW_LOAD_FAULT_ORDER, false, true},
        {{.after = say_tile_before_frame}, 1, LW_LOAD_FAULT_ORDER, false, true},
        {{.after = say_settled_of_another}, 1, LW_LOAD_FAULT_ORDER, false, true},
        {{.after = say_pong_of_nobody}, 1, LW_LOAD_FAULT_ORDER, false, true},
        {{.after = say_frame_backwards}, 1, LW_LOAD_FAULT_FRAME, false, true},
        {{.after = say_object_nowhere}, 1, LW_LOAD_FAULT_PLACE, false, true},
        {{.after = say_tile_nowhere}, 1, LW_LOAD_FAULT_PLACE, false, true},
        {{.after = say_damaged_tile}, 1, LW_LOAD_FAULT_PAYLOAD, false, true},
        {{.after = say_version_again}, 1, LW_LOAD_FAULT_VERSION, true, true},
        {{.after = say_other_light}, 2, LW_LOAD_FAULT_DIFFERENT, true, true},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct lw_load_report *r = run(&cases[i].part, cases[i].users, false, NULL);
        const struct lw_load_figures *f = &r->figures;
        for (int k = 0; k < LW_LOAD_FAULT_COUNT; k++)
            if (f->fault[k] != (k == (int)cases[i].fault))
                fail_msg("case %zu: fault %d occurred %d times: %s", i, k, (int)f->fault[k],
                         f->first_fault[k]);
        assert_true(f->first_fault[cases[i].fault][0] != '\0');
        assert_int_equal(f->lost, !cases[i].goes_on && cases[i].welcomed);
        assert_int_equal(f->refused, !cases[i].welcomed);
        assert_int_equal(r->end, cases[i].goes_on ? LW_LOAD_END_TIME : LW_LOAD_END_SERVER_GONE);
        free(r);
    }
}

static void test_no_server(void **state) {
    (void)state;
    struct fake fake;
    struct lw_load_report *report = NULL;
    struct lw_error err = {0};
    static const struct part part = {0};
    start(&fake, &part, 0);
    struct lw_load_options options = options_for(&fake);
    options.users = 1;
    lw_support_ok(lw_load_test_run(&options, &report, &err), &err); /* the scout alone is served */
    stop(&fake);
    free(report);
    report = NULL;
    lw_support_fails(lw_load_test_run(&options, &report, &err), LW_UNAVAILABLE, &err,
                     "is lightwelld running?");
    assert_null(report);
}

/* ---- conditions ---- */

static void test_thresholds(void **state) {
    (void)state;
    struct lw_load_report *r = calloc(1, sizeof *r);
    struct lw_load_options o = {.latency_max_ms = (double)INFINITY, .first_view_max_ms = (double)INFINITY};
    assert_true(lw_load_report_check(&o, r));
    o.latency_max_ms = 10.1; /* nothing was measured; later: within a bucket's width of 10 */
    assert_false(lw_load_report_check(&o, r));
    for (int i = 0; i < 100; i++) lw_histogram_add(&r->figures.update, i < 99 ? 10000000 : 20000000);
    assert_true(lw_load_report_check(&o, r));
    lw_histogram_add(&r->figures.update, 20000000);
    assert_false(lw_load_report_check(&o, r));
    o.latency_max_ms = (double)INFINITY;
    o.frames_min_hz = 20;
    assert_false(lw_load_report_check(&o, r));
    for (int i = 0; i < 101; i++) lw_histogram_add(&r->figures.rate_mhz, i < 1 ? 1000 : 20400);
    assert_true(lw_load_report_check(&o, r)); /* all but 1 of 101 */
    lw_histogram_add(&r->figures.rate_mhz, 1000);
    assert_false(lw_load_report_check(&o, r));
    o.errors_max = 1;
    r->figures.fault[LW_LOAD_FAULT_VERSION] = 1;
    o.frames_min_hz = 0.5;
    assert_true(lw_load_report_check(&o, r));
    r->figures.fault[LW_LOAD_FAULT_CONNECT] = 1;
    assert_false(lw_load_report_check(&o, r));
    o.errors_max = 2;
    assert_true(lw_load_report_check(&o, r));
    r->end = LW_LOAD_END_INTERRUPTED;
    assert_false(lw_load_report_check(&o, r));
    r->end = LW_LOAD_END_SERVER_GONE;
    assert_false(lw_load_report_check(&o, r));
    r->end = LW_LOAD_END_NOBODY_LEFT;
    assert_true(lw_load_report_check(&o, r));
    free(r);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_figures),
        cmocka_unit_test(test_latency_counts_from_the_first_who_heard),
        cmocka_unit_test(test_downloads_of_all),
        cmocka_unit_test(test_faults),
        cmocka_unit_test(test_no_server),
        cmocka_unit_test(test_thresholds),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
