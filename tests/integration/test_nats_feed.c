/* A relay's feed alone, with nats-server and a daemon that the test plays: when it asks for tiles again, and
 * when it sends SETTLED. */
#include "tests/support/nats_case.h"

#include "common/base/clock.h"
#include "common/nats/nats_link.h"
#include "common/tile/tile_codec.h"
#include "proto/message_reader.h"
#include "relay/nats_feed.h"

#include <poll.h>
#include <stdatomic.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#define RUN      77u
#define TILES    2u
#define STREAM   "lightwell-room"
#define LIMIT_MS (LW_PROCESS_LIMIT_S * 1000)
#define CHECK_S  30u /* a feed asks for all tiles so often, whatever it has heard */

static struct lw_nats_case nats;
static struct lw_scene *scene;
static struct lw_atlas_map map;
static natsConnection *connection;
static natsSubscription *who, *syncs;
static struct lw_nats_feed *feed;
static int session;
static struct lw_message_reader reader;
static uint8_t input[16u << 10];

/* The daemon's. */
static _Atomic uint32_t epoch;
static uint64_t frame, version[TILES], alive_ns;
static unsigned sync_count;

/* ---- the daemon ---- */

static const char live_frame[] = "lightwell.room.live.0.frame";

static void publish_to(const char *subject, const struct lw_message *message) {
    uint8_t payload[2000];
    size_t size = 0;
    lw_nats_wire_write_prefix(payload, (struct lw_nats_wire_prefix){epoch, RUN});
    if (message)
        lw_support_ok(lw_message_encode(message, payload + LW_NATS_WIRE_PREFIX_SIZE,
                                        sizeof payload - LW_NATS_WIRE_PREFIX_SIZE, &size),
                      NULL);
    assert_int_equal(
        natsConnection_Publish(connection, subject, payload, (int)(LW_NATS_WIRE_PREFIX_SIZE + size)),
        NATS_OK);
}

static void publish_frame(const char *subject) {
    publish_to(subject, &(struct lw_message){.type = LW_MESSAGE_FRAME, .frame.frame = frame});
}

static void publish_changes(uint64_t base) {
    publish_to(live_frame,
               &(struct lw_message){.type = LW_MESSAGE_FRAME, .frame = {.frame = frame, .base = base}});
}

static void publish_settled(const char *subject) {
    publish_to(subject, &(struct lw_message){.type = LW_MESSAGE_SETTLED, .settled.frame = frame});
}

/* base: of a difference; 0: it is whole */
static void publish_tile(const char *subject, uint32_t tile, uint64_t base) {
    static const uint8_t byte = 1;
    const struct lw_tile_place *place = &map.place[tile];
    publish_to(subject, &(struct lw_message){.type = LW_MESSAGE_TILE,
                                             .tile = {.object = place->object,
                                                      .level = place->level,
                                                      .tile = lw_atlas_map_number(&map, (lw_tile_id){tile}),
                                                      .version = version[tile],
                                                      .base = base,
                                                      .codec = LW_TILE_CODEC_DCT,
                                                      .scale = 1,
                                                      .payload = &byte,
                                                      .payload_size = 1}});
}

/* A frame in which these tiles change: a bit for each. */
static void solve(uint32_t tiles) {
    frame++;
    for (uint32_t t = 0; t < TILES; t++)
        if (tiles >> t & 1) version[t] = 2 * frame;
}

/* The feed has not had the version that the difference builds on. */
static void publish_lost(uint32_t tile) {
    char subject[LW_NATS_WIRE_SUBJECT_SIZE];
    lw_nats_wire_subject(subject, "room", "live.0.%u.%u", map.place[tile].object, map.place[tile].level);
    publish_tile(subject, tile, version[tile] - 1);
}

/* To be called again and again. */
static void stay_alive(void) {
    if (lw_clock_ns() < alive_ns) return;
    publish_to("lightwell.room.alive", NULL);
    alive_ns = lw_clock_ns() + LW_NATS_WIRE_ALIVE_MS * 1000000ull;
}

static void on_who(natsConnection *of, natsSubscription *subscription, natsMsg *message, void *context) {
    (void)of, (void)subscription, (void)context;
    publish_to(natsMsg_GetReply(message), NULL);
    natsMsg_Destroy(message);
}

static void answer(natsMsg *request) {
    struct lw_nats_wire_prefix prefix;
    struct lw_nats_wire_reader payload;
    struct lw_message m;
    const char *reply = natsMsg_GetReply(request);
    const uint8_t *raw;
    size_t size;
    lw_support_ok(lw_nats_wire_read_prefix(natsMsg_GetData(request), (size_t)natsMsg_GetDataLength(request),
                                           &prefix, &payload),
                  NULL);
    assert_int_equal(*lw_nats_wire_read_bytes(&payload, 1), LW_TILE_CHANNEL_FULL);
    publish_frame(reply);
    while (payload.left) {
        lw_support_ok(lw_nats_wire_read(&payload, &m, &raw, &size), NULL);
        assert_int_equal(m.type, LW_MESSAGE_HOLDS);
        for (size_t i = 0; i < m.holds.tile_count; i++) {
            const struct lw_message_held *h = &m.holds.tile[i];
            const lw_tile_id id = lw_atlas_map_find_tile(&map, h->object, h->level, h->tile);
            if (version[id.v] != h->version) publish_tile(reply, id.v, 0);
        }
        lw_message_finish(&m);
    }
    publish_settled(reply);
}

/* A request of the feed that has come; NULL: none has. */
static natsMsg *take_request(void) {
    natsMsg *request = NULL;
    stay_alive();
    return natsSubscription_NextMsg(&request, syncs, 1) == NATS_OK ? request : NULL;
}

static void serve(natsMsg *request) {
    if (!request) return;
    answer(request);
    natsMsg_Destroy(request);
    sync_count++;
}

/* ---- the session ---- */

static void say(const struct lw_message *message) {
    uint8_t bytes[500];
    size_t size;
    lw_support_ok(lw_message_encode(message, bytes, sizeof bytes, &size), NULL);
    assert_int_equal(send(session, bytes, size, MSG_NOSIGNAL), size);
}

/* The next message of the feed, finished: numbers alone count. Requests are answered meanwhile, or wait. */
static struct lw_message next(bool serves) {
    for (const uint64_t end_ns = lw_clock_ns() + LIMIT_MS * 1000000ull; lw_clock_ns() < end_ns;) {
        struct lw_framing_header header;
        struct lw_message m;
        const uint8_t *body;
        lw_support_ok(lw_message_reader_take(&reader, &header, &body, NULL), NULL);
        if (body) {
            lw_support_ok(lw_message_decode(header, body, &m, NULL), NULL);
            lw_message_finish(&m);
            return m;
        }
        lw_support_ok(lw_message_reader_keep(&reader), NULL);
        struct pollfd polled = {.fd = session, .events = POLLIN};
        while (poll(&polled, 1, 10) == 0)
            if (serves)
                serve(take_request());
            else
                stay_alive();
        const ssize_t got = recv(session, input, sizeof input, 0);
        assert_true(got > 0);
        lw_message_reader_lend(&reader, input, (size_t)got);
    }
    fail_msg("the feed said nothing for %d ms", LIMIT_MS);
    return (struct lw_message){0};
}

static void expect_frame(bool serves, uint64_t number) {
    const struct lw_message m = next(serves);
    assert_int_equal(m.type, LW_MESSAGE_FRAME);
    assert_int_equal(m.frame.frame, number);
}

static void expect_changes(uint64_t base) {
    const struct lw_message m = next(true);
    assert_int_equal(m.type, LW_MESSAGE_FRAME);
    assert_int_equal(m.frame.frame, frame);
    assert_int_equal(m.frame.base, base);
}

static void expect_tile(uint32_t tile) {
    const struct lw_message m = next(true);
    assert_int_equal(m.type, LW_MESSAGE_TILE);
    assert_int_equal(lw_atlas_map_find_tile(&map, m.tile.object, m.tile.level, m.tile.tile).v, tile);
    assert_int_equal(m.tile.version, version[tile]);
}

static void expect_settled(void) {
    const struct lw_message m = next(true);
    assert_int_equal(m.type, LW_MESSAGE_SETTLED);
    assert_int_equal(m.settled.frame, frame);
}

/* ---- begin, end ---- */

static void keep_welcome(void) {
    static const char *subjects[] = {"lightwell.room.kept.>"};
    uint8_t payload[500];
    size_t size;
    jsCtx *jetstream;
    jsStreamConfig config;
    jsStreamConfig_Init(&config);
    config.Name = STREAM;
    config.Subjects = subjects;
    config.SubjectsLen = 1;
    const struct lw_message welcome = {.type = LW_MESSAGE_WELCOME,
                                       .welcome = {.version = LW_WIRE_VERSION,
                                                   .name = "test",
                                                   .package_size = 1,
                                                   .package_compressed_size = 1,
                                                   .run = RUN}};
    lw_nats_wire_write_prefix(payload, (struct lw_nats_wire_prefix){0, RUN});
    lw_support_ok(lw_message_encode(&welcome, payload + LW_NATS_WIRE_PREFIX_SIZE,
                                    sizeof payload - LW_NATS_WIRE_PREFIX_SIZE, &size),
                  NULL);
    assert_int_equal(natsConnection_JetStream(&jetstream, connection, NULL), NATS_OK);
    assert_int_equal(js_AddStream(NULL, jetstream, &config, NULL, NULL), NATS_OK);
    assert_int_equal(js_Publish(NULL, jetstream, "lightwell.room.kept.welcome", payload,
                                (int)(LW_NATS_WIRE_PREFIX_SIZE + size), NULL, NULL),
                     NATS_OK);
    jsCtx_Destroy(jetstream);
}

static void start_daemon(const char *url) {
    assert_int_equal(natsConnection_ConnectTo(&connection, url), NATS_OK);
    keep_welcome();
    assert_int_equal(natsConnection_Subscribe(&who, connection, "lightwell.room.who", on_who, NULL), NATS_OK);
    assert_int_equal(natsConnection_SubscribeSync(&syncs, connection, "lightwell.room.sync"), NATS_OK);
    assert_int_equal(natsConnection_Flush(connection), NATS_OK);
}

/* A session with the first light. */
static int begin(void **state) {
    (void)state;
    struct lw_nats_wire_address address;
    struct lw_error err = {0};
    epoch = 0;
    frame = alive_ns = 0;
    sync_count = 0;
    lw_nats_case_start(&nats, &(struct lw_nats_case_desc){.host = NULL});
    lw_support_ok(lw_nats_wire_address(lw_nats_case_address(&nats, "room"), &address, &err), &err);
    scene = lw_support_squares(TILES, 1);
    for (uint32_t i = 0; i < scene->mesh_count; i++)
        scene->mesh[i].atlas_width = scene->mesh[i].atlas_height = 1;
    lw_support_ok(lw_atlas_map_init(&map, scene), NULL);
    assert_int_equal(map.tile_count, TILES);
    start_daemon(address.url);
    const struct lw_nats_feed_desc desc = {.address = &address, .relay = 5, .timeout_ms = 5000};
    lw_support_ok(lw_nats_feed_create(&desc, &feed, &session, &err), &err);
    reader = (struct lw_message_reader){.body_max = LW_FRAMING_BODY_MAX};
    solve(3);
    say(&(struct lw_message){.type = LW_MESSAGE_HELLO,
                             .hello = {.version = LW_WIRE_VERSION, .name = "test"}});
    assert_int_equal(next(true).type, LW_MESSAGE_WELCOME);
    lw_nats_feed_set_map(feed, &map);
    say(&(struct lw_message){.type = LW_MESSAGE_PACKAGE_REQUEST, .package_request.offset = 1});
    expect_frame(true, 1);
    for (uint32_t t = 0; t < TILES; t++) expect_tile(t);
    expect_settled();
    return 0;
}

static int end(void **state) {
    (void)state;
    lw_nats_feed_destroy(feed);
    close(session);
    lw_message_reader_clear(&reader);
    natsSubscription_Destroy(who);
    natsSubscription_Destroy(syncs);
    natsConnection_Destroy(connection);
    lw_atlas_map_finish(&map);
    lw_scene_destroy(scene);
    lw_process_kill_all();
    lw_nats_case_finish(&nats);
    return 0;
}

/* ---- tests ---- */

/* The daemon lost NATS for a moment, and a frame with it; then nothing changes any more. The feed knows it by
 * the epoch alone: it does not wait until it asks for all tiles anyhow. */
static void another_epoch_is_asked_for(void **state) {
    (void)state;
    const uint64_t begin_ns = lw_clock_ns();
    for (unsigned times = 0; times < 3; times++) {
        solve(1u << times % TILES);
        epoch++;
        expect_frame(true, frame);
        expect_tile(times % TILES);
        expect_settled();
    }
    assert_true(lw_clock_ns() - begin_ns < 2 * CHECK_S * 1000000000ull);
}

/* Until the answer, no SETTLED that a daemon publishes is passed on. */
static void live_settled_waits_for_lost_tiles(void **state) {
    (void)state;
    solve(1);
    publish_frame(live_frame);
    publish_lost(0);
    publish_settled(live_frame);
    expect_frame(false, frame);
    solve(0);
    publish_frame(live_frame);
    publish_settled(live_frame);
    expect_frame(false, frame); /* and no SETTLED before it */
    expect_tile(0);
    expect_settled();
    assert_true(sync_count >= 2);
}

/* An answer brings no SETTLED if more was lost after the request. */
static void an_answer_waits_for_lost_tiles(void **state) {
    (void)state;
    natsMsg *request = NULL;
    solve(3);
    publish_frame(live_frame);
    publish_lost(0);
    expect_frame(false, frame);
    LW_SUPPORT_WAIT_UNTIL((request = take_request()));
    publish_lost(1);
    serve(request);
    expect_tile(0);
    expect_tile(1);
    expect_settled();
}

/* The changes of a frame got lost unnoticed: a later FRAME with changes does not stand for them, and an
 * answer brings all. */
static void changes_since_a_lost_frame_are_asked_for(void **state) {
    (void)state;
    solve(0);
    publish_changes(frame - 1);
    expect_changes(frame - 1);
    solve(0); /* lost */
    solve(2);
    publish_changes(frame - 1);
    expect_changes(0); /* the answer's */
    expect_tile(1);
    expect_settled();
    solve(0);
    publish_changes(frame - 1);
    expect_changes(frame - 1);
}

int main(void) {
    if (!lw_nats_case_is_possible()) return 0;
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(another_epoch_is_asked_for, begin, end),
        cmocka_unit_test_setup_teardown(live_settled_waits_for_lost_tiles, begin, end),
        cmocka_unit_test_setup_teardown(an_answer_waits_for_lost_tiles, begin, end),
        cmocka_unit_test_setup_teardown(changes_since_a_lost_frame_are_asked_for, begin, end),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
