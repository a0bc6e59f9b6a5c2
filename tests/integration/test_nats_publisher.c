/* The publisher alone, with snapshots made by hand: finer levels and directions, as a relay gets them. */
#include "tests/support/nats_case.h"

#include "common/nats/nats_link.h"
#include "common/tile/tile_codec.h"
#include "server/nats/nats_publisher.h"

#include <pthread.h>
#include <string.h>

#define ROOM      4u
#define LEVEL     (LW_ATLAS_FINER + 1)
#define RUN       77u
#define FULL      1u /* sets of channels */
#define DIRECTION (1u << LW_TILE_CHANNEL_DIRECTION)
#define LIMIT_MS  (LW_PROCESS_LIMIT_S * 1000)

static struct lw_nats_case nats;
static struct lw_scene *scene;
static struct lw_atlas_map map;
static struct lw_blob *welcome;
static struct lw_nats_publisher *publisher;
static natsConnection *connection;
static natsSubscription *live, *fine, *answers;
static struct lw_nats_wire_reader reader; /* the rest of `message` */
static natsMsg *message;

/* What the publisher wants for its relays. */
static pthread_mutex_t mutex = PTHREAD_MUTEX_INITIALIZER;
static uint32_t channels;
static size_t fine_count;
static uint64_t fine_name[ROOM];

static void on_wants(void *context, const struct lw_nats_publisher_wants *wants) {
    (void)context;
    pthread_mutex_lock(&mutex);
    channels = wants->channels;
    fine_count = wants->fine_count;
    for (size_t i = 0; i < fine_count && i < ROOM; i++) fine_name[i] = wants->fine[i];
    pthread_mutex_unlock(&mutex);
}

static struct lw_relay_tree_node tree[LW_RELAY_TREE_MAX];
static uint32_t tree_count;

static void on_reports(void *context, const struct lw_relay_tree_node *node, uint32_t count) {
    (void)context;
    pthread_mutex_lock(&mutex);
    memcpy(tree, node, count * sizeof *node);
    tree_count = count;
    pthread_mutex_unlock(&mutex);
}

/* The relay that the tree has at a place; 0: none. */
static uint64_t listed(uint32_t at, uint64_t *out_above) {
    pthread_mutex_lock(&mutex);
    const struct lw_relay_tree_node node =
        at < tree_count && at < LW_RELAY_TREE_MAX ? tree[at] : (struct lw_relay_tree_node){.relay = 0};
    pthread_mutex_unlock(&mutex);
    if (out_above) *out_above = node.above;
    return node.relay;
}

static bool lists(uint32_t count) { return !listed(count, NULL) && (!count || listed(count - 1, NULL)); }

static bool wants(uint32_t of, size_t count) {
    pthread_mutex_lock(&mutex);
    const bool is_so = channels == of && fine_count == count;
    pthread_mutex_unlock(&mutex);
    return is_so;
}

static natsSubscription *subscribe(const char *subject) {
    natsSubscription *subscription;
    assert_int_equal(natsConnection_SubscribeSync(&subscription, connection, subject), NATS_OK);
    return subscription;
}

static int begin(void **state) {
    (void)state;
    struct lw_nats_wire_address address;
    struct lw_error err = {0};
    lw_nats_case_start(&nats, &(struct lw_nats_case_desc){.host = NULL});
    lw_support_ok(lw_nats_wire_address(lw_nats_case_address(&nats, "room"), &address, &err), &err);
    scene = lw_support_squares(2, 1);
    for (uint32_t i = 0; i < scene->mesh_count; i++)
        scene->mesh[i].atlas_width = scene->mesh[i].atlas_height = 256;
    lw_support_ok(lw_atlas_map_init_finer(&map, scene, 1, ROOM), NULL);
    const struct lw_message any = {.type = LW_MESSAGE_SETTLED, .settled.frame = 1};
    lw_support_ok(lw_blob_from_message(&any, &welcome), NULL);
    const struct lw_nats_publisher_desc desc = {.address = &address,
                                                .map = &map,
                                                .channels = FULL | DIRECTION,
                                                .run = RUN,
                                                .welcome = welcome,
                                                .wants = on_wants,
                                                .reports = on_reports};
    lw_support_ok(lw_nats_publisher_create(&desc, &publisher, &err), &err);
    assert_int_equal(natsConnection_ConnectTo(&connection, address.url), NATS_OK);
    live = subscribe("lightwell.room.live.0.frame");
    fine = subscribe("lightwell.room.fine.*.*.*");
    answers = subscribe("answers");
    return 0;
}

static int end(void **state) {
    (void)state;
    natsMsg_Destroy(message);
    message = NULL;
    natsSubscription *const each[] = {live, fine, answers};
    for (size_t i = 0; i < 3; i++) natsSubscription_Destroy(each[i]);
    natsConnection_Destroy(connection);
    lw_nats_publisher_destroy(publisher);
    lw_blob_unref(welcome);
    lw_atlas_map_finish(&map);
    lw_scene_destroy(scene);
    lw_process_kill_all();
    lw_nats_case_finish(&nats);
    return 0;
}

/* ---- a relay ---- */

/* what, then bytes, then a message */
static void say(const char *what, const char *reply, const uint8_t *bytes, size_t size,
                const struct lw_message *said) {
    uint8_t payload[2000];
    char subject[100];
    size_t length = LW_NATS_WIRE_PREFIX_SIZE + size, written = 0;
    snprintf(subject, sizeof subject, "lightwell.room.%s", what);
    lw_nats_wire_write_prefix(payload, (struct lw_nats_wire_prefix){0, RUN});
    memcpy(payload + LW_NATS_WIRE_PREFIX_SIZE, bytes, size);
    lw_support_ok(lw_message_encode(said, payload + length, sizeof payload - length, &written), NULL);
    length += written;
    assert_int_equal(natsConnection_PublishRequest(connection, subject, reply, payload, (int)length),
                     NATS_OK);
}

static void want(uint8_t relay, uint32_t set, const struct lw_message_interest_tile *tile, size_t count) {
    const uint8_t head[9] = {relay, [8] = (uint8_t)set};
    say("want", "nobody", head, sizeof head,
        &(struct lw_message){.type = LW_MESSAGE_INTEREST, .interest = {.tile = tile, .tile_count = count}});
}

static void ask(uint8_t channel, const struct lw_message_held *held, size_t count) {
    say("sync", "answers", &channel, 1,
        &(struct lw_message){.type = LW_MESSAGE_HOLDS, .holds = {.tile = held, .tile_count = count}});
}

/* The next message of the protocol; type 0: a payload without one. It is finished: numbers alone count. */
static struct lw_message next(natsSubscription *from) {
    struct lw_nats_wire_prefix prefix;
    struct lw_message m = {0};
    const uint8_t *raw;
    size_t size;
    if (!message || !reader.left) {
        natsMsg_Destroy(message);
        message = NULL;
        assert_int_equal(natsSubscription_NextMsg(&message, from, LIMIT_MS), NATS_OK);
        lw_support_ok(lw_nats_wire_read_prefix(natsMsg_GetData(message),
                                               (size_t)natsMsg_GetDataLength(message), &prefix, &reader),
                      NULL);
        assert_int_equal(prefix.run, RUN);
    }
    lw_support_ok(lw_nats_wire_read(&reader, &m, &raw, &size), NULL);
    if (raw) lw_message_finish(&m);
    return m;
}

static void expect_frame(natsSubscription *from, enum lw_message_type type, uint64_t frame) {
    const struct lw_message m = next(from);
    assert_int_equal(m.type, type);
    assert_int_equal(type == LW_MESSAGE_FRAME ? m.frame.frame : m.settled.frame, frame);
}

static void expect_tile(natsSubscription *from, uint32_t object, uint32_t tile, uint64_t version,
                        uint32_t codec) {
    const struct lw_message m = next(from);
    assert_int_equal(m.type, LW_MESSAGE_TILE);
    assert_int_equal(m.tile.object, object);
    assert_int_equal(m.tile.level, LEVEL);
    assert_int_equal(m.tile.tile, tile);
    assert_int_equal(m.tile.version, version);
    assert_int_equal(m.tile.codec, codec);
    assert_int_equal(m.tile.base, 0);
}

/* ---- snapshots ---- */

static struct lw_blob *blob_of(const struct lw_message *m) {
    struct lw_blob *blob;
    lw_support_ok(lw_blob_from_message(m, &blob), NULL);
    return blob;
}

static struct lw_snapshot *make_snapshot(uint64_t frame, uint32_t set) {
    struct lw_snapshot *snapshot;
    lw_support_ok(lw_snapshot_create(map.tile_count, set, &snapshot), NULL);
    snapshot->frame = frame;
    snapshot->frame_full = blob_of(&(struct lw_message){.type = LW_MESSAGE_FRAME, .frame.frame = frame});
    snapshot->settled = blob_of(&(struct lw_message){.type = LW_MESSAGE_SETTLED, .settled.frame = frame});
    return snapshot;
}

/* base: of a difference that is there, too; 0: there is none */
static void put(struct lw_snapshot *snapshot, uint32_t place, uint32_t object, uint32_t tile, uint32_t codec,
                uint64_t base) {
    static const uint8_t byte = 1;
    struct lw_message m = {.type = LW_MESSAGE_TILE,
                           .tile = {.object = object,
                                    .level = LEVEL,
                                    .tile = tile,
                                    .version = 2 * snapshot->frame,
                                    .codec = codec,
                                    .scale = 1,
                                    .payload = &byte,
                                    .payload_size = 1}};
    struct lw_snapshot_tile *t = &snapshot->tile[0][map.plain_count + place];
    *t = (struct lw_snapshot_tile){.version = m.tile.version, .blob = blob_of(&m), .base = base};
    m.tile.base = base;
    if (base) t->delta = blob_of(&m);
}

static void publish(struct lw_snapshot *snapshot) {
    lw_nats_publisher_publish(publisher, snapshot);
    lw_snapshot_unref(snapshot);
}

/* Tiles of finer levels are named by relays, published where an id is another tile's than before, and
 * withdrawn. */
static void finer_tiles_come_and_go(void **state) {
    (void)state;
    static const struct lw_message_interest_tile first[] = {{0, LEVEL, 3}, {1, LEVEL, 2}},
                                                 second[] = {{1, LEVEL, 2}, {1, LEVEL, 5}};
    want(1, FULL, first, 2);
    want(2, FULL, second, 2);
    LW_SUPPORT_WAIT_UNTIL(wants(FULL, 3));
    for (size_t i = 0; i < 2; i++) /* the first ones of each list */
        assert_true(fine_name[i] == lw_atlas_map_name_tile(&map, 0, LEVEL, 3) ||
                    fine_name[i] == lw_atlas_map_name_tile(&map, 1, LEVEL, 2));
    struct lw_snapshot *snapshot = make_snapshot(5, FULL);
    put(snapshot, 0, 0, 3, LW_TILE_CODEC_DCT, 0);
    put(snapshot, 1, 1, 2, LW_TILE_CODEC_DCT, 0);
    publish(snapshot);
    expect_frame(live, LW_MESSAGE_FRAME, 5);
    expect_frame(live, LW_MESSAGE_SETTLED, 5);
    expect_tile(fine, 0, 3, 10, LW_TILE_CODEC_DCT);
    expect_tile(fine, 1, 2, 10, LW_TILE_CODEC_DCT);
    /* one that it has, one of another version, one that is not there any more, one that is not there yet */
    static const struct lw_message_held held[] = {
        {0, LEVEL, 3, 10}, {1, LEVEL, 2, 8}, {1, LEVEL, 5, 6}, {1, LEVEL, 6, 0}};
    ask(LW_TILE_CHANNEL_FULL, held, 4);
    expect_frame(answers, LW_MESSAGE_FRAME, 5);
    expect_tile(answers, 1, 2, 10, LW_TILE_CODEC_DCT);
    expect_tile(answers, 1, 5, 10, LW_TILE_CODEC_NONE);
    expect_frame(answers, LW_MESSAGE_SETTLED, 5);
    /* One is withdrawn. The id of the other is another tile's: relays have no version for its difference. */
    snapshot = make_snapshot(6, FULL);
    put(snapshot, 0, 0, 3, LW_TILE_CODEC_NONE, 0);
    put(snapshot, 1, 1, 5, LW_TILE_CODEC_DCT, 10);
    publish(snapshot);
    expect_tile(fine, 0, 3, 12, LW_TILE_CODEC_NONE);
    expect_tile(fine, 1, 5, 12, LW_TILE_CODEC_DCT);
    static const struct lw_message_held gone[] = {{1, LEVEL, 2, 10}};
    ask(LW_TILE_CHANNEL_FULL, gone, 1);
    expect_frame(answers, LW_MESSAGE_FRAME, 6);
    expect_tile(answers, 1, 2, 12, LW_TILE_CODEC_NONE);
    expect_frame(answers, LW_MESSAGE_SETTLED, 6);
}

/* A channel is not SETTLED before the directions that a relay wants with it are there. */
static void directions_are_waited_for(void **state) {
    (void)state;
    want(1, FULL | DIRECTION, NULL, 0);
    LW_SUPPORT_WAIT_UNTIL(wants(FULL | DIRECTION, 0));
    publish(make_snapshot(7, FULL));
    expect_frame(live, LW_MESSAGE_FRAME, 7);
    ask(LW_TILE_CHANNEL_DIRECTION, NULL, 0);
    expect_frame(answers, LW_MESSAGE_FRAME, 7);
    assert_int_equal(next(answers).type, 0); /* tiles are still to come */
    publish(make_snapshot(8, FULL | DIRECTION));
    expect_frame(live, LW_MESSAGE_FRAME, 8);
    expect_frame(live, LW_MESSAGE_SETTLED, 8);
    ask(LW_TILE_CHANNEL_DIRECTION, NULL, 0);
    expect_frame(answers, LW_MESSAGE_FRAME, 8);
    expect_frame(answers, LW_MESSAGE_SETTLED, 8);
    /* directions alone are no irradiance; the daemon has none but these */
    want(2, DIRECTION, NULL, 0);
    want(3, 1u << LW_TILE_CHANNEL_SPLIT, NULL, 0);
    want(1, FULL, NULL, 0);
    LW_SUPPORT_WAIT_UNTIL(wants(FULL, 0));
}

/* ---- reports ---- */

static void report(const char *lines) {
    say("report", "nobody", NULL, 0,
        &(struct lw_message){.type = LW_MESSAGE_REPORT,
                             .report = {.data = (const uint8_t *)lines, .size = strlen(lines)}});
}

static uint64_t refused_count(void) {
    struct lw_nats_publisher_stats stats;
    lw_nats_publisher_get_stats(publisher, &stats);
    return stats.refused_messages;
}

/* Relays, and those below them. The newest report of a relay counts, and each relay is listed once. One that
 * is silent is gone. */
static void relays_are_listed_while_they_report(void **state) {
    (void)state;
    uint64_t above;
    report("7 99 3 0 1000 first\n9 7 2 0 0 below\n");
    LW_SUPPORT_WAIT_UNTIL(lists(2));
    assert_int_equal(listed(0, &above), 7);
    assert_int_equal(above, 0); /* the daemon feeds it */
    assert_int_equal(listed(1, &above), 9);
    assert_int_equal(above, 7);
    report("9 0 2 0 0 moved\n"); /* it takes light from NATS itself now */
    LW_SUPPORT_WAIT_UNTIL(listed(0, &above) == 9 && !above && lists(2));
    report("7 0 3 0 0 first\n8 7 0 0 0 other\n");
    LW_SUPPORT_WAIT_UNTIL(lists(3));
    LW_SUPPORT_WAIT_UNTIL(lists(0)); /* after LW_NATS_WIRE_SILENCE_MS */
}

static void reports_that_make_no_sense_change_nothing(void **state) {
    (void)state;
    static const char *const bad[] = {
        "", "x\n", "0 0 0 0 0 a\n", "7 0 0 0 0 a\n7", "7 0 0 0 0 a b\n", "7 0 -1 0 0 a\n"};
    const size_t count = sizeof bad / sizeof *bad;
    for (size_t i = 0; i < count; i++) report(bad[i]);
    LW_SUPPORT_WAIT_UNTIL(refused_count() == count);
    const struct lw_message other = {.type = LW_MESSAGE_SETTLED, .settled.frame = 1},
                            asked = {.type = LW_MESSAGE_REPORT,
                                     .report = {
                                         .request = 1, .data = (const uint8_t *)"7 0 0 0 0 a\n", .size = 12}};
    say("report", "nobody", NULL, 0, &other);
    say("report", "nobody", NULL, 0, &asked);
    say("report", "nobody", (const uint8_t *)"\xff\xff\xff", 3, &other);
    LW_SUPPORT_WAIT_UNTIL(refused_count() == count + 3);
    assert_true(lists(0));
    report("7 0 3 0 0 first\n");
    LW_SUPPORT_WAIT_UNTIL(lists(1));
}

int main(void) {
    if (!lw_nats_case_is_possible()) return 0;
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(finer_tiles_come_and_go, begin, end),
        cmocka_unit_test_setup_teardown(directions_are_waited_for, begin, end),
        cmocka_unit_test_setup_teardown(relays_are_listed_while_they_report, begin, end),
        cmocka_unit_test_setup_teardown(reports_that_make_no_sense_change_nothing, begin, end),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
