#include "tests/support/serving.h"

#include "server/serve/server.h"
#include "tests/support/server_clock.h"

#include <netinet/in.h>
#include <netinet/tcp.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

/* Peers that misbehave: their session ends, and no other notices. */

/* ---- peers that misbehave ---- */

/* Who acknowledges what it was not sent, or goes back, is sent away; nobody else is. */
static void test_acks(void **state) {
    (void)state;
    static const struct {
        uint64_t first, second;
        bool good;
    } row[] = {{5, 5, true},  {5, 6, false}, {5, UINT64_MAX, false},
               {5, 4, false}, {0, 0, false}, {4, 5, true}};
    struct serving *f = serving_start(&(struct lw_server_desc){0});
    serving_publish(f, serving_make_snapshot(f, 5, 0));
    int observer = serving_dial_and_stream(f);
    serving_expect_light(f, observer, 5);
    for (size_t i = 0; i < sizeof row / sizeof row[0]; i++) {
        int s = serving_dial_and_stream(f);
        serving_expect_light(f, s, 5);
        serving_put(s, &(struct lw_message){.type = LW_MESSAGE_ACK, .ack.frame = row[i].first});
        serving_put(s, &(struct lw_message){.type = LW_MESSAGE_ACK, .ack.frame = row[i].second});
        serving_put(s, &(struct lw_message){.type = LW_MESSAGE_PING, .ping.token = SERVING_CLIENT_TOKEN});
        if (!row[i].good) {
            serving_expect_refusal(s, LW_REFUSAL_PROTOCOL);
            continue;
        }
        struct lw_message m;
        serving_expect(s, LW_MESSAGE_PONG, &m);
        lw_message_finish(&m);
        close(s);
    }
    int s = serving_dial_and_greet(f); /* before there was a frame */
    serving_put(s, &(struct lw_message){.type = LW_MESSAGE_ACK, .ack.frame = 5});
    serving_expect_refusal(s, LW_REFUSAL_PROTOCOL);
    serving_publish(f, serving_make_snapshot(f, 6, 5));
    serving_expect_frame(observer, 6, 2);
    close(observer);
    serving_end(f);
}

/* All that a client may say, in order, with a snapshot of frame 9 in between. */
static size_t write_script(uint8_t *dst, size_t capacity, uint64_t package_compressed_size) {
    static const struct lw_message_held held[] = {{0, 0, 7, 9}, {2, 4, 0, 9}};
    static const struct lw_message_interest_tile wanted[] = {{1, 0, 3}, {0, 2, 0}};
    const struct lw_message script[] = {
        serving_hello_again,
        {.type = LW_MESSAGE_INTEREST, .interest = {.stand_ins = true, .tile = wanted, .tile_count = 2}},
        {.type = LW_MESSAGE_HOLDS, .holds = {held, 2, 0}},
        {.type = LW_MESSAGE_PING, .ping.token = SERVING_CLIENT_TOKEN},
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
static bool recite(const struct serving *f, const uint8_t *bytes, size_t size) {
    bool refused = false;
    struct lw_message m;
    int s = serving_dial(f);
    serving_put_bytes(s, bytes, size);
    assert_int_equal(shutdown(s, SHUT_WR), 0);
    /* bytes on their way may be cut off when the server sees our end */
    for (uint8_t header[LW_FRAMING_HEADER_SIZE]; serving_get_bytes(s, header, sizeof header);) {
        static uint8_t body[LW_FRAMING_BODY_MAX];
        struct lw_framing_header h;
        lw_support_ok(lw_framing_read_header(header, LW_FRAMING_BODY_MAX, &h, NULL), NULL);
        if (!serving_get_bytes(s, body, h.body_size)) break;
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
    struct serving *f = serving_start(&(struct lw_server_desc){0});
    struct lw_message_welcome welcome;
    uint8_t script[1024], wrong[1024];
    close(serving_dial_again(f, &welcome));
    serving_publish(f, serving_make_snapshot(f, 9, 0));
    int observer = serving_dial_and_stream(f);
    serving_expect_light(f, observer, 9);
    const size_t size = write_script(script, sizeof script, welcome.package_compressed_size);
    assert_false(recite(f, script, size));
    for (size_t cut = 0; cut < size; cut++) assert_false(recite(f, script, cut));
    unsigned refused = 0;
    for (size_t bit = 0; bit < 8 * size; bit++) {
        memcpy(wrong, script, size);
        wrong[bit / 8] ^= (uint8_t)(1u << bit % 8);
        refused += recite(f, wrong, size);
    }
    assert_true(refused > 4 * size); /* the other bits change a number or a name that may be any */
    memcpy(wrong, script, size);
    memcpy(wrong + size, script, sizeof wrong - size < size ? sizeof wrong - size : size);
    assert_true(recite(f, wrong, 2 * size < sizeof wrong ? 2 * size : sizeof wrong));
    serving_publish(f, serving_make_snapshot(f, 10, 9));
    serving_expect_frame(observer, 10, 2);
    serving_expect_tiles(observer, f->map.tile_count, 10);
    serving_wait_for_sessions(f, 1);
    close(observer);
    serving_end(f);
}

static void test_garbage(void **state) {
    (void)state;
    struct serving *f = serving_start(&(struct lw_server_desc){0});
    int good = serving_dial_and_stream(f), s = serving_dial(f);
    serving_put_bytes(s, "GET / HTTP/1.1\r\n\r\n", 18);
    serving_expect_refusal(s, LW_REFUSAL_PROTOCOL);
    s = serving_dial(f); /* a body one byte over the limit, found from the header alone */
    uint8_t header[LW_FRAMING_HEADER_SIZE];
    lw_framing_write_header(header, (struct lw_framing_header){.body_size = LW_FRAMING_CLIENT_BODY_MAX + 1,
                                                               .type = LW_MESSAGE_HELLO});
    serving_put_bytes(s, header, sizeof header);
    serving_expect_refusal(s, LW_REFUSAL_PROTOCOL);
    s = serving_dial(f); /* flags of the future */
    lw_framing_write_header(header, (struct lw_framing_header){.type = LW_MESSAGE_HELLO, .flags = 1});
    serving_put_bytes(s, header, sizeof header);
    serving_expect_refusal(s, LW_REFUSAL_PROTOCOL);
    s = serving_dial(f); /* a body that is no protobuf */
    lw_framing_write_header(header, (struct lw_framing_header){.body_size = 2, .type = LW_MESSAGE_HELLO});
    serving_put_bytes(s, header, sizeof header);
    serving_put_bytes(s, "\xff\xff", 2);
    serving_expect_refusal(s, LW_REFUSAL_PROTOCOL);
    s = serving_dial_and_greet(f); /* a type that no version has */
    lw_framing_write_header(header, (struct lw_framing_header){.type = 99});
    serving_put_bytes(s, header, sizeof header);
    serving_expect_refusal(s, LW_REFUSAL_PROTOCOL);
    serving_publish(f, serving_make_snapshot(f, 1, 0));
    serving_expect_light(f, good, 1);
    assert_int_equal(serving_stats_of(f).refused, 5);
    close(good);
    serving_end(f);
}

static void test_out_of_order(void **state) {
    (void)state;
    struct serving *f = serving_start(&(struct lw_server_desc){0});
    int s = serving_dial(f);
    serving_put(s, &(struct lw_message){.type = LW_MESSAGE_PING});
    serving_expect_refusal(s, LW_REFUSAL_PROTOCOL);
    s = serving_dial(f);
    serving_ask_for_package(s, 0);
    serving_expect_refusal(s, LW_REFUSAL_PROTOCOL);
    s = serving_dial_and_greet(f);
    serving_put(s, &serving_hello);
    serving_expect_refusal(s, LW_REFUSAL_PROTOCOL);
    s = serving_dial_and_stream(f);
    serving_ask_for_package(s, 0);
    serving_expect_refusal(s, LW_REFUSAL_PROTOCOL);
    s = serving_dial_and_greet(f); /* past the end by one */
    serving_ask_for_package(s, LW_MESSAGE_COMPRESSED_MAX);
    serving_expect_refusal(s, LW_REFUSAL_PROTOCOL);
    s = serving_dial_and_greet(f); /* what only a server says */
    serving_put(s, &(struct lw_message){.type = LW_MESSAGE_REFUSAL,
                                        .refusal = {.code = LW_REFUSAL_FULL, .text = "no"}});
    serving_expect_refusal(s, LW_REFUSAL_PROTOCOL);
    serving_end(f);
}

static void test_wrong_version(void **state) {
    (void)state;
    struct serving *f = serving_start(&(struct lw_server_desc){0});
    for (uint32_t version = 0; version < 3; version += 2) {
        int s = serving_dial(f);
        serving_put(s, &(struct lw_message){.type = LW_MESSAGE_HELLO, .hello.version = version});
        serving_expect_refusal(s, LW_REFUSAL_VERSION);
    }
    assert_int_equal(serving_stats_of(f).sessions_total, 0);
    serving_end(f);
}

/* ---- finer levels ---- */

static void test_features_that_are_needed(void **state) {
    (void)state;
    struct serving *f = serving_start(&(struct lw_server_desc){.features = LW_FEATURE_DCT});
    int s = serving_dial(f);
    serving_put(s, &serving_hello); /* an old client: it offers none */
    serving_expect_refusal(s, LW_REFUSAL_FEATURES);
    s = serving_dial(f);
    serving_put(s, &(struct lw_message){
                       .type = LW_MESSAGE_HELLO,
                       .hello = {.version = LW_WIRE_VERSION, .features = LW_FEATURE_DCT | 1u << 20}});
    struct lw_message m;
    serving_expect(s, LW_MESSAGE_WELCOME, &m);
    assert_int_equal(m.welcome.features, LW_FEATURE_DCT); /* not what this server has never heard of */
    lw_message_finish(&m);
    assert_int_equal(serving_stats_of(f).sessions_total, 1);
    serving_end(f);
}

static void test_half_hello(void **state) {
    (void)state;
    struct serving *f = serving_start(&(struct lw_server_desc){.hello_timeout_ms = 1000});
    struct lw_blob *bytes = serving_blob_of(&serving_hello);
    int s = serving_dial(f), silent = serving_dial(f);
    for (size_t i = 0; i + 1 < bytes->size; i++) serving_put_bytes(s, bytes->bytes + i, 1);
    serving_is_paced = true;
    serving_expect_refusal(s, LW_REFUSAL_TIMEOUT);
    serving_expect_refusal(silent, LW_REFUSAL_TIMEOUT);
    serving_is_paced = false;
    s = serving_dial(f); /* byte by byte, but in time */
    for (size_t i = 0; i < bytes->size; i++) serving_put_bytes(s, bytes->bytes + i, 1);
    struct lw_message m;
    serving_expect(s, LW_MESSAGE_WELCOME, &m);
    lw_message_finish(&m);
    server_clock_step(1500);
    serving_expect_silence(s); /* the limit is for the hello */
    lw_blob_unref(bytes);
    close(s);
    serving_end(f);
}

static void test_many_messages_in_pieces(void **state) {
    (void)state;
    struct serving *f = serving_start(&(struct lw_server_desc){0});
    int s = serving_dial_and_greet(f);
    static const struct lw_message_interest_tile wanted[LW_MESSAGE_INTEREST_MAX];
    struct lw_blob *large = serving_blob_of(&(struct lw_message){
        .type = LW_MESSAGE_INTEREST, .interest = {.tile = wanted, .tile_count = LW_MESSAGE_INTEREST_MAX}});
    struct lw_blob *other = serving_blob_of(
        &(struct lw_message){.type = LW_MESSAGE_INTEREST,
                             .interest = {.tile = wanted, .tile_count = LW_MESSAGE_INTEREST_MAX - 100}});
    struct lw_blob *ping =
        serving_blob_of(&(struct lw_message){.type = LW_MESSAGE_PING, .ping.token = SERVING_CLIENT_TOKEN});
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
        serving_put_bytes(s, bytes + at, piece);
        server_clock_step(SERVING_STEP_MS);
    }
    serving_is_paced = true;
    serving_put(s, &(struct lw_message){.type = LW_MESSAGE_PING, .ping.token = 1});
    struct lw_message m;
    do { /* several pings may get one answer */
        serving_expect(s, LW_MESSAGE_PONG, &m);
        lw_message_finish(&m);
    } while (m.pong.token == SERVING_CLIENT_TOKEN);
    assert_int_equal(m.pong.token, 1);
    free(bytes);
    lw_blob_unref(large);
    lw_blob_unref(other);
    lw_blob_unref(ping);
    close(s);
    serving_end(f);
}

static void test_abrupt_close(void **state) {
    (void)state;
    struct serving *f = serving_start(&(struct lw_server_desc){0});
    const struct linger reset = {.l_onoff = 1};
    for (uint64_t frame = 1; frame <= 20; frame++) {
        int s = serving_dial_with_buffer(f, 4096);
        serving_put(s, &serving_hello);
        serving_ask_for_package(s, 0);
        serving_publish(f, serving_make_snapshot(f, frame, frame - 1));
        uint8_t some[100];
        assert_true(serving_get_bytes(s, some, sizeof some));
        if (frame % 2) setsockopt(s, SOL_SOCKET, SO_LINGER, &reset, sizeof reset);
        close(s);
    }
    serving_wait_for_sessions(f, 0);
    assert_int_equal(serving_stats_of(f).sessions_total, 20);
    serving_end(f);
}

/* ---- fairness ---- */

static void test_who_never_takes_the_package_is_refused(void **state) {
    (void)state;
    struct serving *f = serving_start(&(struct lw_server_desc){.package_timeout_ms = 1000});
    int s = serving_dial_and_greet(f), taker = serving_dial_and_stream(f);
    serving_put(s, &(struct lw_message){.type = LW_MESSAGE_PONG}); /* it does not help */
    serving_is_paced = true;
    serving_expect_refusal(s, LW_REFUSAL_TIMEOUT);
    serving_is_paced = false;
    server_clock_step(500);
    serving_expect_silence(taker);
    close(taker);
    serving_end(f);
    f = serving_start_controlled_with((struct lw_server_desc){.package_timeout_ms = 500});
    s = serving_dial_and_control(f, false); /* who controls need not take it */
    server_clock_step(1500);
    serving_expect_silence(s);
    close(s);
    serving_end(f);
}

static void test_silent_peers_are_pinged(void **state) {
    (void)state;
    struct serving *f = serving_start(&(struct lw_server_desc){.silence_timeout_ms = 2000});
    int silent = serving_dial_and_stream(f), good = serving_dial_and_stream(f);
    struct lw_message m;
    serving_is_paced = true;
    for (unsigned i = 0; i < 4; i++) {
        serving_expect(good, LW_MESSAGE_PING, &m);
        serving_put(good, &(struct lw_message){.type = LW_MESSAGE_PONG, .pong.token = m.ping.token});
        lw_message_finish(&m);
    }
    serving_expect(silent, LW_MESSAGE_PING, &m);
    lw_message_finish(&m);
    serving_expect_refusal(silent, LW_REFUSAL_TIMEOUT);
    serving_wait_for_sessions(f, 1);
    close(good);
    serving_end(f);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_acks),
        cmocka_unit_test(test_bytes_gone_wrong),
        cmocka_unit_test(test_garbage),
        cmocka_unit_test(test_out_of_order),
        cmocka_unit_test(test_wrong_version),
        cmocka_unit_test(test_features_that_are_needed),
        cmocka_unit_test(test_half_hello),
        cmocka_unit_test(test_many_messages_in_pieces),
        cmocka_unit_test(test_who_never_takes_the_package_is_refused),
        cmocka_unit_test(test_silent_peers_are_pinged),
        cmocka_unit_test(test_abrupt_close),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
