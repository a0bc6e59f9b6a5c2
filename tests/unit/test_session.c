#include "tests/support/support.h"

#include "common/base/clock.h"
#include "server/serve/sessions/session_handlers.h"
#include "server/serve/sessions/session_private.h"
#include "server/serve/sessions/turns.h"

#include <stdlib.h>
#include <string.h>
#include <time.h>

/* A session between a link that only counts and a clock that stands still until a test moves it: each limit
 * of server_limits.h at its last moment, byte or message, and one past it. */

#define SECOND_NS 1000000000ull
#define START_NS  (100 * SECOND_NS)
#define CHUNKS    16u

static uint64_t now_ns;

int __wrap_clock_gettime(clockid_t clock, struct timespec *out);
int __wrap_clock_gettime(clockid_t clock, struct timespec *out) {
    (void)clock;
    *out = (struct timespec){.tv_sec = (time_t)(now_ns / SECOND_NS), .tv_nsec = (long)(now_ns % SECOND_NS)};
    return 0;
}

/* ---- the link ---- */

struct link {
    struct lw_session_transport transport;
    bool is_full, is_read, is_closed;
    uint32_t writes, waits;
    struct lw_message_waiting wait; /* the last of these */
    size_t bytes, overhead;
    uint16_t last;        /* type of the last message written */
    enum lw_refusal code; /* code of a REFUSAL */
    char text[LW_MESSAGE_TEXT_MAX + 1];
};

static struct link *link_of(struct lw_session_transport *transport) { return (struct link *)transport; }

static int write_blobs(struct lw_session_transport *transport, struct lw_blob *const *blob, uint32_t count) {
    struct link *link = link_of(transport);
    size_t bytes = 0;
    for (uint32_t i = 0; i < count; i++) {
        struct lw_message m;
        bytes += blob[i]->size;
        lw_support_ok(lw_message_decode_whole(blob[i]->bytes, blob[i]->size, &m), NULL);
        link->last = (uint16_t)m.type;
        if (m.type == LW_MESSAGE_REFUSAL) {
            link->code = m.refusal.code;
            snprintf(link->text, sizeof link->text, "%s", m.refusal.text);
        }
        if (m.type == LW_MESSAGE_WAITING) {
            link->waits++;
            link->wait = m.waiting;
        }
        lw_message_finish(&m);
        lw_blob_unref(blob[i]);
    }
    link->writes++;
    link->bytes += bytes;
    return link->is_full ? 0 : (int)bytes;
}

static void read_on(struct lw_session_transport *transport, bool on) { link_of(transport)->is_read = on; }

static void push(struct lw_session_transport *transport) { (void)transport; }

static int end_writing(struct lw_session_transport *transport, enum lw_refusal code, const char *text) {
    (void)transport;
    (void)code;
    (void)text;
    return 0;
}

static void close_link(struct lw_session_transport *transport) { link_of(transport)->is_closed = true; }

static void waiting(const struct lw_session_transport *transport, size_t *out_ours, size_t *out_socket) {
    const struct link *link = (const struct link *)transport;
    *out_ours = link->is_full ? link->bytes : 0;
    *out_socket = 0;
}

static size_t overhead(struct lw_session_transport *transport) { return link_of(transport)->overhead; }

static const struct lw_session_transport_ops ops = {write_blobs, read_on, push,    end_writing,
                                                    close_link,  waiting, overhead};

/* ---- the server ---- */

static struct lw_session_shared shared;
static struct lw_atlas_map map;
static struct lw_scene *scene;

static void note(void *server) { (void)server; }

static int start(void **state) {
    (void)state;
    now_ns = START_NS;
    memset(&shared, 0, sizeof shared);
    scene = lw_support_squares(1, 1);
    scene->mesh[0].atlas_width = scene->mesh[0].atlas_height = 16;
    lw_support_ok(lw_atlas_map_init(&map, scene), NULL);
    shared.atlas_map = &map;
    shared.channels.served = lw_tile_channel_bit(LW_TILE_CHANNEL_FULL);
    lw_support_ok(lw_interest_union_init(&shared.interest_union, &map), NULL);
    lw_support_ok(lw_updates_init(&shared.updates), NULL);
    assert_int_equal(uv_mutex_init(&shared.stats_mutex), 0);
    shared.welcome =
        (struct lw_message_welcome){.version = LW_WIRE_VERSION, .package_size = 1, .name = "test"};
    shared.limits.sessions_max = LW_SERVER_SESSIONS_MAX;
    shared.parse.budget = LW_SERVER_PARSE_MAX;
    shared.limits.hello_timeout_ns = LW_SERVER_HELLO_TIMEOUT_S * SECOND_NS;
    shared.limits.package_timeout_ns = LW_SERVER_PACKAGE_TIMEOUT_S * SECOND_NS;
    shared.limits.stall_timeout_ns = LW_SERVER_STALL_TIMEOUT_S * SECOND_NS;
    shared.limits.excess_timeout_ns = LW_SERVER_EXCESS_TIMEOUT_S * SECOND_NS;
    shared.limits.silence_timeout_ns = LW_SERVER_SILENCE_S * SECOND_NS;
    shared.on_open = shared.on_close = note;
    static uint8_t data[LW_SESSION_CHUNK];
    shared.package.chunk = calloc(CHUNKS, sizeof *shared.package.chunk);
    for (; shared.package.chunk_count < CHUNKS; shared.package.chunk_count++) {
        struct lw_session_chunk *chunk = &shared.package.chunk[shared.package.chunk_count];
        const struct lw_message m = {
            .type = LW_MESSAGE_PACKAGE_CHUNK,
            .package_chunk = {shared.package.chunk_count * LW_SESSION_CHUNK, data, sizeof data}};
        lw_support_ok(lw_blob_from_message(&m, &chunk->blob), NULL);
        chunk->end = (shared.package.chunk_count + 1ull) * LW_SESSION_CHUNK;
        shared.welcome.package_compressed_size = chunk->end;
    }
    return 0;
}

static int close_sessions(void **state) {
    (void)state;
    while (shared.first) {
        struct lw_session *s = shared.first;
        struct lw_session_transport *link = s->link;
        lw_session_close(s, "the test ends");
        lw_session_closed(s);
        free(link);
    }
    for (uint32_t i = 0; i < CHUNKS; i++) lw_blob_unref(shared.package.chunk[i].blob);
    free(shared.package.chunk);
    lw_interest_union_finish(&shared.interest_union);
    lw_updates_finish(&shared.updates);
    lw_address_places_finish(&shared.places);
    lw_address_places_finish(&shared.turned_away);
    lw_message_memory_finish(&shared.parse);
    uv_mutex_destroy(&shared.stats_mutex);
    lw_atlas_map_finish(&map);
    lw_scene_destroy(scene);
    return 0;
}

/* Everything that is due, in as many turns as that takes. */
static void serve(void) {
    while (shared.queues.due[0].first || shared.queues.due[1].first) lw_turns_serve_due(&shared, UINT64_MAX);
}

/* NULL: there was no room to say no. */
static struct lw_session *open_from(uint32_t address, bool is_own) {
    struct link *link = calloc(1, sizeof *link);
    struct lw_session_peer peer = {.at = {.is_loopback = is_own}, .address = "peer"};
    assert_non_null(link);
    memcpy(peer.at.bytes, &address, sizeof address);
    link->transport.ops = &ops;
    link->is_read = true;
    struct lw_session *s = lw_session_open(&shared, &link->transport, &peer);
    if (!s) free(link);
    serve();
    return s;
}

static struct lw_session *open_one(void) { return open_from(1, false); }

static void say(struct lw_session *s, const struct lw_message *message, unsigned times) {
    struct lw_blob *blob, *many;
    lw_support_ok(lw_blob_from_message(message, &blob), NULL);
    lw_support_ok(lw_blob_create(blob->size * times, &many), NULL);
    for (unsigned i = 0; i < times; i++) memcpy(many->bytes + i * blob->size, blob->bytes, blob->size);
    lw_session_handlers_receive(s, many->bytes, many->size);
    lw_blob_unref(blob);
    lw_blob_unref(many);
}

static void greet(struct lw_session *s) {
    say(s,
        &(struct lw_message){
            .type = LW_MESSAGE_HELLO,
            .hello = {.version = LW_WIRE_VERSION, .features = LW_FEATURE_RESUME, .name = "test"}},
        1);
    serve();
    assert_int_equal(link_of(s->link)->last, LW_MESSAGE_WELCOME);
}

/* As one who has the package; or wants it. */
static void ask_for_package(struct lw_session *s, bool all) {
    say(s,
        &(struct lw_message){.type = LW_MESSAGE_PACKAGE_REQUEST,
                             .package_request.offset = all ? 0 : shared.welcome.package_compressed_size},
        1);
    serve();
}

static void tick_and_serve(struct lw_session *s, uint64_t at_ns) {
    struct lw_session_waiting unused = {0};
    now_ns = at_ns;
    lw_session_tick(s, now_ns, &unused);
    serve();
}

static bool is_refused(const struct lw_session *s, enum lw_refusal code) {
    return s->state == LW_SESSION_LEAVING && s->refusal == code;
}

static bool has_refusal(const struct lw_session *s) {
    const struct link *link = (const struct link *)s->link;
    return link->last == LW_MESSAGE_REFUSAL && link->code == s->refusal;
}

/* Nothing happens at this moment, and a refusal a moment later. */
static void expect_limit(struct lw_session *s, uint64_t at_ns, enum lw_refusal code) {
    tick_and_serve(s, at_ns);
    if (s->state >= LW_SESSION_LEAVING) fail_msg("refused too early: %s", link_of(s->link)->text);
    tick_and_serve(s, at_ns + 1);
    assert_true(is_refused(s, code));
    assert_true(has_refusal(s) || link_of(s->link)->is_full);
}

/* ---- time ---- */

static void test_hello_in_time(void **state) {
    (void)state;
    struct lw_session *s = open_one();
    expect_limit(s, START_NS + LW_SERVER_HELLO_TIMEOUT_S * SECOND_NS, LW_REFUSAL_TIMEOUT);
    const uint64_t refused_ns = now_ns;
    tick_and_serve(s, refused_ns + LW_SERVER_LINGER_S * SECOND_NS);
    assert_false(link_of(s->link)->is_closed);
    struct lw_session_waiting unused = {0};
    struct link *link = link_of(s->link);
    lw_session_tick(s, ++now_ns, &unused);
    assert_true(link->is_closed);
    lw_session_closed(s);
    free(link);
}

static void test_hello_where_places_are_short(void **state) {
    (void)state;
    struct lw_tokens tokens = {0};
    struct lw_session *s[LW_SERVER_KEPT_ONE_IN];
    shared.tokens = &tokens;
    shared.limits.sessions_max = LW_SERVER_KEPT_ONE_IN; /* one of them is kept */
    const uint64_t limit_ns = START_NS + LW_SERVER_CROWDED_HELLO_S * SECOND_NS;
    for (unsigned i = 0; i + 1 < LW_SERVER_KEPT_ONE_IN; i++) s[i] = open_from(i, false);
    tick_and_serve(s[0], limit_ns + 1); /* it has the usual time */
    assert_int_equal(s[0]->state, LW_SESSION_EXPECTS_HELLO);
    s[LW_SERVER_KEPT_ONE_IN - 1] = open_from(1000, false); /* the kept one */
    expect_limit(s[1], limit_ns, LW_REFUSAL_TIMEOUT);
}

static void test_package_in_time(void **state) {
    (void)state;
    struct lw_session *s = open_one();
    greet(s);
    for (unsigned at_s = 0; at_s < LW_SERVER_PACKAGE_TIMEOUT_S; at_s += 10) { /* it is not silent */
        tick_and_serve(s, START_NS + at_s * SECOND_NS);
        say(s, &(struct lw_message){.type = LW_MESSAGE_PONG}, 1);
    }
    expect_limit(s, START_NS + LW_SERVER_PACKAGE_TIMEOUT_S * SECOND_NS, LW_REFUSAL_TIMEOUT);
    assert_non_null(strstr(link_of(s->link)->text, "PACKAGE_REQUEST"));
}

static void test_silence(void **state) {
    (void)state;
    struct lw_session *s = open_one();
    greet(s);
    ask_for_package(s, false);
    tick_and_serve(s, START_NS + LW_SERVER_SILENCE_S * SECOND_NS / 2);
    assert_int_not_equal(link_of(s->link)->last, LW_MESSAGE_PING);
    tick_and_serve(s, now_ns + 1);
    assert_int_equal(link_of(s->link)->last, LW_MESSAGE_PING);
    say(s, &(struct lw_message){.type = LW_MESSAGE_PONG}, 1);
    expect_limit(s, now_ns + LW_SERVER_SILENCE_S * SECOND_NS, LW_REFUSAL_TIMEOUT);
}

/* One byte that is taken begins the time again. */
static void test_stall(void **state) {
    (void)state;
    struct lw_session *s = open_one();
    struct link *link = link_of(s->link);
    greet(s);
    link->is_full = true;
    link->bytes = 0;
    ask_for_package(s, true);
    const uint64_t limit_ns = LW_SERVER_STALL_TIMEOUT_S * SECOND_NS;
    tick_and_serve(s, START_NS);
    tick_and_serve(s, START_NS + limit_ns);
    assert_int_equal(s->state, LW_SESSION_STREAMING);
    link->bytes--;
    tick_and_serve(s, now_ns + 1);
    expect_limit(s, START_NS + 2 * limit_ns + 1, LW_REFUSAL_TIMEOUT);
}

/* A refusal that the link does not take waits for it, and the close waits for that. */
static void test_who_was_slow_may_read_on(void **state) {
    (void)state;
    struct lw_session *s = open_one();
    struct link *link = link_of(s->link);
    greet(s);
    link->is_full = true;
    link->bytes = 0;
    ask_for_package(s, true);
    tick_and_serve(s, START_NS);
    tick_and_serve(s, START_NS + LW_SERVER_STALL_TIMEOUT_S * SECOND_NS + 1);
    assert_int_equal(s->state, LW_SESSION_LEAVING);
    const uint64_t refused_ns = now_ns;
    assert_int_not_equal(link->last, LW_MESSAGE_REFUSAL);
    link->is_full = false;
    lw_session_written(s, 0, true);
    serve();
    assert_true(is_refused(s, LW_REFUSAL_TIMEOUT) && has_refusal(s));
    tick_and_serve(s, refused_ns + LW_SERVER_STALL_TIMEOUT_S * SECOND_NS);
    assert_false(link->is_closed);
    struct lw_session_waiting unused = {0};
    lw_session_tick(s, ++now_ns, &unused);
    assert_true(link->is_closed);
    lw_session_closed(s);
    free(link);
}

static void test_saying_too_much(void **state) {
    (void)state;
    struct lw_session *s = open_one();
    greet(s);
    uint64_t waited_ns = 0;
    while (!is_refused(s, LW_REFUSAL_RATE)) {
        if (!s->rates.waits) say(s, &(struct lw_message){.type = LW_MESSAGE_PING}, 200);
        assert_true(s->rates.waits);
        assert_false(link_of(s->link)->is_read); /* the rest stays with the peer */
        assert_true(waited_ns <= LW_SERVER_EXCESS_TIMEOUT_S * SECOND_NS);
        waited_ns += SECOND_NS / LW_SERVER_LOOKS_HZ;
        tick_and_serve(s, now_ns + SECOND_NS / LW_SERVER_LOOKS_HZ);
    }
    assert_true(waited_ns > LW_SERVER_EXCESS_TIMEOUT_S * SECOND_NS);
    assert_true(has_refusal(s));
    assert_string_equal(link_of(s->link)->text, "more than 20 PING a second, for too long");
}

/* Frames without messages, and bytes that are neither: read no more, then refused. */
static void expect_too_much(struct lw_session *s, const char *text) {
    uint64_t waited_ns = 0;
    assert_true(s->rates.waits);
    assert_false(link_of(s->link)->is_read);
    for (; !is_refused(s, LW_REFUSAL_RATE); waited_ns += SECOND_NS / LW_SERVER_LOOKS_HZ) {
        lw_session_count_other(s, LW_MESSAGE_RATES_FRAMES, 1000);
        assert_true(waited_ns <= LW_SERVER_EXCESS_TIMEOUT_S * SECOND_NS);
        tick_and_serve(s, now_ns + SECOND_NS / LW_SERVER_LOOKS_HZ);
    }
    assert_true(has_refusal(s));
    assert_string_equal(link_of(s->link)->text, text);
}

static void test_frames_without_messages(void **state) {
    (void)state;
    struct lw_session *s = open_one();
    greet(s);
    lw_session_count_other(s, LW_MESSAGE_RATES_FRAMES, 1000);
    assert_true(link_of(s->link)->is_read);
    lw_session_count_other(s, LW_MESSAGE_RATES_FRAMES, 1);
    expect_too_much(s, "more than 100 FRAMES a second, for too long");
}

static void test_overhead(void **state) {
    (void)state;
    struct lw_session *s = open_one();
    greet(s);
    link_of(s->link)->overhead =
        32768 + LW_MESSAGE_RATES_ENVELOPE; /* the HELLO's is no more than there may be */
    tick_and_serve(s, now_ns);
    assert_true(s->rates.waits);
    link_of(s->link)->overhead = 0;
    tick_and_serve(s, now_ns + SECOND_NS);
    lw_turns_serve_paced(&shared); /* a second has brought enough to go on */
    lw_turns_read_on(&shared);
    assert_true(link_of(s->link)->is_read);
    link_of(s->link)->overhead = 100000;
    tick_and_serve(s, now_ns);
    while (s->state < LW_SESSION_LEAVING) tick_and_serve(s, now_ns + SECOND_NS / LW_SERVER_LOOKS_HZ);
    assert_string_equal(link_of(s->link)->text, "more than 4096 OVERHEAD a second, for too long");
}

/* Bytes of a refused peer are dropped, as far as they may be on their way already. */
static void test_what_follows_a_refusal(void **state) {
    (void)state;
    static uint8_t more[LW_SERVER_DROPPED_MAX];
    struct lw_session *s = open_one();
    say(s, &(struct lw_message){.type = LW_MESSAGE_PING}, 1); /* no HELLO */
    assert_true(is_refused(s, LW_REFUSAL_PROTOCOL));
    const size_t counted = LW_FRAMING_HEADER_SIZE; /* bytes of the PING */
    lw_session_handlers_receive(s, more, sizeof more - counted);
    assert_true(link_of(s->link)->is_read);
    lw_session_handlers_receive(s, more, 1);
    assert_false(link_of(s->link)->is_read);
    now_ns += SECOND_NS / 2; /* a time later it is read again */
    lw_turns_serve_paced(&shared);
    lw_turns_read_on(&shared);
    assert_true(link_of(s->link)->is_read);
    assert_true(is_refused(s, LW_REFUSAL_PROTOCOL));
}

/* ---- messages and bytes ---- */

static const struct lw_message holds = {.type = LW_MESSAGE_HOLDS};

static void test_messages_of_a_turn(void **state) {
    (void)state;
    struct lw_session *s = open_one();
    greet(s);
    say(s, &holds, LW_SERVER_TURN_MESSAGES - 1);
    assert_null(s->inbox);
    say(s, &holds, LW_SERVER_TURN_MESSAGES + 1);
    assert_ptr_equal(s->inbox, &shared.queues.unread);
    const double left = s->rates.left[LW_MESSAGE_RATES_HOLDS];
    lw_turns_read_on(&shared); /* the last one has the next turn, and then the peer is read again */
    assert_null(s->inbox);
    assert_true(link_of(s->link)->is_read);
    assert_true(s->rates.left[LW_MESSAGE_RATES_HOLDS] == left - 1);
}

/* An unknown field of any length is legal, and ignored. */
static void say_hello_of(struct lw_session *s, uint32_t body_size) {
    uint8_t *bytes = calloc(1, LW_FRAMING_HEADER_SIZE + body_size), *at = bytes + LW_FRAMING_HEADER_SIZE;
    const uint32_t rest = body_size - 2 - 2 - 3; /* version 1, key and length of field 100 */
    lw_framing_write_header(bytes,
                            (struct lw_framing_header){.body_size = body_size, .type = LW_MESSAGE_HELLO});
    const uint8_t begin[] = {
        8, 1, 0xa2, 6, 0x80 | (rest & 127), 0x80 | (rest >> 7 & 127), (uint8_t)(rest >> 14)};
    memcpy(at, begin, sizeof begin);
    for (size_t done = 0, size = LW_FRAMING_HEADER_SIZE + (size_t)body_size, piece; done < size;
         done += piece) {
        piece = size - done < LW_SERVER_TURN_READ ? size - done : LW_SERVER_TURN_READ;
        lw_session_handlers_receive(s, bytes + done, piece);
    }
    serve();
    free(bytes);
}

static void test_body(void **state) {
    (void)state;
    struct lw_session *s = open_one();
    say_hello_of(s, LW_FRAMING_CLIENT_BODY_MAX);
    assert_int_equal(link_of(s->link)->last, LW_MESSAGE_WELCOME);
    s = open_one();
    say_hello_of(s, LW_FRAMING_CLIENT_BODY_MAX + 1);
    assert_true(is_refused(s, LW_REFUSAL_PROTOCOL));
}

/* No message of ours comes near the budget of a server: this one has less. */
static void test_memory_of_a_message(void **state) {
    (void)state;
    greet(open_one());
    const size_t asked = shared.parse.asked;
    shared.parse.budget = asked;
    greet(open_one());
    shared.parse.budget = asked - 16; /* memory is given in pieces of that */
    struct lw_session *s = open_one();
    say(s,
        &(struct lw_message){
            .type = LW_MESSAGE_HELLO,
            .hello = {.version = LW_WIRE_VERSION, .features = LW_FEATURE_RESUME, .name = "test"}},
        1);
    serve();
    assert_true(is_refused(s, LW_REFUSAL_PROTOCOL));
    assert_non_null(strstr(link_of(s->link)->text, "bytes of memory"));
}

static void test_bytes_that_wait(void **state) {
    (void)state;
    struct lw_session *s = open_one();
    struct link *link = link_of(s->link);
    greet(s);
    link->is_full = true;
    link->bytes = link->writes = 0;
    ask_for_package(s, true); /* 1 MiB */
    assert_int_equal(link->writes, 1);
    assert_in_range(link->bytes, 1, LW_SERVER_QUEUE_MAX);
}

static void test_answers(void **state) {
    (void)state;
    struct lw_session *s = open_one();
    greet(s);
    link_of(s->link)->is_full = true;
    say(s, &(struct lw_message){.type = LW_MESSAGE_PING}, 1);
    serve(); /* the link has a PONG to take, and what follows waits */
    const struct lw_message_updated answer = {.request = 1};
    for (unsigned i = 0; i < LW_SERVER_ANSWERS_MAX; i++) lw_session_answer(s, &answer);
    assert_int_equal(s->answer_count, LW_SERVER_ANSWERS_MAX);
    assert_int_equal(s->state, LW_SESSION_WELCOMED);
    lw_session_answer(s, &answer);
    assert_int_equal(s->state, LW_SESSION_LEAVING);
    assert_int_equal(s->refusal, LW_REFUSAL_PROTOCOL);
}

/* ---- places ---- */

static void test_places(void **state) {
    (void)state;
    const unsigned most = lw_address_places_share(&(struct lw_address){{0}, false}, LW_SERVER_SESSIONS_MAX),
                   own = lw_address_places_share(&(struct lw_address){{0}, true}, LW_SERVER_SESSIONS_MAX);
    for (unsigned i = 0; i < own; i++) assert_true(open_from(1, true)->has_place);
    assert_true(is_refused(open_from(1, true), LW_REFUSAL_FULL));
    for (unsigned i = 0; i < most; i++) assert_true(open_from(2, false)->has_place);
    assert_int_equal(shared.place_count, LW_SERVER_SESSIONS_MAX);
    struct lw_session *s = open_from(3, false);
    assert_true(is_refused(s, LW_REFUSAL_FULL));
    assert_non_null(strstr(link_of(s->link)->text, "the server has its 10000 sessions"));
}

static void test_places_of_an_address(void **state) {
    (void)state;
    const unsigned most = lw_address_places_share(&(struct lw_address){{0}, false}, LW_SERVER_SESSIONS_MAX);
    for (unsigned i = 0; i < most; i++) assert_true(open_from(1, false)->has_place);
    struct lw_session *s = open_from(1, false);
    assert_true(is_refused(s, LW_REFUSAL_FULL));
    assert_non_null(strstr(link_of(s->link)->text, "this address has its 1000 sessions"));
    assert_true(open_from(2, false)->has_place);
}

static void test_turned_away(void **state) {
    (void)state;
    shared.limits.sessions_max = 1;
    (void)open_from(0, false);
    unsigned address = 1;
    for (unsigned all = 0; all < LW_SERVER_TURNED_AWAY_MAX; all++) {
        if (all && all % LW_SERVER_ADDRESS_TURNED_AWAY_MAX == 0) address++;
        assert_true(is_refused(open_from(address, false), LW_REFUSAL_FULL));
    }
    address++;
    assert_null(open_from(address, false)); /* in all */
}

/* As many at once as there are places, then as many as come back in 20 s; one more is refused. */
static void test_connecting_too_often(void **state) {
    (void)state;
    const struct lw_address own = {{1}, true}, other = {{2}, false};
    unsigned count = 0;
    while (lw_session_may_connect(&shared, &other)) count++;
    assert_int_equal(count, 1000);
    for (count = 0; lw_session_may_connect(&shared, &own); count++) {
    }
    assert_int_equal(count, 9000);
    now_ns += SECOND_NS + 1000;
    for (count = 0; lw_session_may_connect(&shared, &other); count++) {
    }
    assert_int_equal(count, 50);
    for (count = 0; lw_session_may_connect(&shared, &own); count++) {
    }
    assert_int_equal(count, 450);
    struct link *link = calloc(1, sizeof *link);
    assert_non_null(link);
    link->transport.ops = &ops;
    link->is_read = true;
    const struct lw_session_peer peer = {.at = other, .address = "peer", .is_too_many = true};
    struct lw_session *s = lw_session_open(&shared, &link->transport, &peer);
    assert_non_null(s);
    serve();
    assert_true(is_refused(s, LW_REFUSAL_RATE) && has_refusal(s));
    assert_string_equal(link->text, "this address connects too often: 50 times a second at most");
    assert_int_equal(shared.place_count, 0);
    shared.limits.address_sessions_max = 1; /* there is a least, for browsers, which open several at once */
    const struct lw_address third = {{3}, false};
    for (count = 0; lw_session_may_connect(&shared, &third); count++) {
    }
    assert_int_equal(count, LW_SERVER_CONNECTIONS_MIN);
}

static void test_turned_away_of_an_address(void **state) {
    (void)state;
    shared.limits.sessions_max = 1;
    (void)open_from(0, false);
    for (unsigned i = 0; i < LW_SERVER_ADDRESS_TURNED_AWAY_MAX; i++)
        assert_true(is_refused(open_from(1, false), LW_REFUSAL_FULL));
    assert_null(open_from(1, false));
    assert_true(is_refused(open_from(2, false), LW_REFUSAL_FULL));
}

/* ---- before the first light ---- */

static void expect_waits(const struct lw_session *s, uint32_t count, uint32_t stage, float share) {
    const struct link *link = (const struct link *)s->link;
    assert_int_equal(link->waits, count);
    assert_int_equal(link->wait.stage, stage);
    assert_true(link->wait.share == share);
}

/* At once, and then as often as there is news, at most. */
static void test_waiting_for_light(void **state) {
    (void)state;
    struct lw_waiting light = {0};
    shared.first_light = &light;
    lw_waiting_raise(&light, LW_WAITING_PLACING_TEXELS, 1, 2);
    struct lw_session *s = open_one();
    greet(s);
    tick_and_serve(s, now_ns + SECOND_NS);
    expect_waits(s, 0, 0, 0); /* it wants nothing yet */
    ask_for_package(s, false);
    expect_waits(s, 1, LW_WAITING_PLACING_TEXELS, 0.5f);
    const uint64_t sent_ns = now_ns, apart_ns = LW_SERVER_WAITING_MS * 1000000ull;
    lw_waiting_raise(&light, LW_WAITING_LOOKING_INSIDE, 1, 4);
    tick_and_serve(s, sent_ns + apart_ns - 1);
    expect_waits(s, 1, LW_WAITING_PLACING_TEXELS, 0.5f);
    tick_and_serve(s, sent_ns + apart_ns);
    expect_waits(s, 2, LW_WAITING_LOOKING_INSIDE, 0.25f);
    tick_and_serve(s, now_ns + SECOND_NS);
    expect_waits(s, 2, LW_WAITING_LOOKING_INSIDE, 0.25f);
    for (unsigned i = 0; i < 100; i++) {
        lw_waiting_raise(&light, LW_WAITING_FIRST_LIGHT, i + 1, 101);
        tick_and_serve(s, now_ns + apart_ns / 10);
    }
    expect_waits(s, 12, LW_WAITING_FIRST_LIGHT, 0.9f);
}

int main(void) {
#define TEST(name) cmocka_unit_test_setup_teardown(name, start, close_sessions)
    const struct CMUnitTest tests[] = {
        TEST(test_hello_in_time),
        TEST(test_hello_where_places_are_short),
        TEST(test_package_in_time),
        TEST(test_silence),
        TEST(test_stall),
        TEST(test_who_was_slow_may_read_on),
        TEST(test_saying_too_much),
        TEST(test_frames_without_messages),
        TEST(test_overhead),
        TEST(test_what_follows_a_refusal),
        TEST(test_connecting_too_often),
        TEST(test_messages_of_a_turn),
        TEST(test_body),
        TEST(test_memory_of_a_message),
        TEST(test_bytes_that_wait),
        TEST(test_answers),
        TEST(test_places),
        TEST(test_places_of_an_address),
        TEST(test_turned_away),
        TEST(test_turned_away_of_an_address),
        TEST(test_waiting_for_light),
    };
#undef TEST
    return cmocka_run_group_tests(tests, NULL, NULL);
}
