/* Sessions of a server, played with: they come, say anything, whole messages and pieces, stop reading, fall
 * silent, go, while the clock moves on. Each byte of the input chooses what happens next. What a session
 * sends must be messages; what it holds must be gone when it is. There is no light here: frames and tiles are
 * fuzz_replica's. */
#include "common/base/clock.h"
#include "common/base/log.h"
#include "server/serve/admission/server_limits.h"
#include "server/serve/sessions/session_handlers.h"
#include "server/serve/sessions/session_private.h"
#include "server/serve/sessions/turns.h"
#include "tests/support/support.h"

#include <stdlib.h>
#include <string.h>
#include <time.h>

#define SECOND_NS 1000000000ull
#define CHUNKS    4u
#define SESSIONS  6u
#define PLACES    4u

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);
int __wrap_clock_gettime(clockid_t clock, struct timespec *out);

static uint64_t now_ns;

int __wrap_clock_gettime(clockid_t clock, struct timespec *out) {
    (void)clock;
    *out = (struct timespec){.tv_sec = (time_t)(now_ns / SECOND_NS), .tv_nsec = (long)(now_ns % SECOND_NS)};
    return 0;
}

static void require(bool condition) {
    if (!condition) abort();
}

/* ---- links ---- */

struct link {
    struct lw_session_transport transport; /* first */
    struct lw_session *session;
    bool is_full, is_read, is_closed, is_ended;
    size_t waits;
};

static int write_blobs(struct lw_session_transport *transport, struct lw_blob *const *blob, uint32_t count) {
    struct link *link = (struct link *)transport;
    size_t bytes = 0;
    require(!link->is_closed && !link->is_ended && !link->waits);
    require(count > 0 && count <= LW_SESSION_TRANSPORT_BLOBS);
    for (uint32_t i = 0; i < count; i++) {
        struct lw_message m;
        require(lw_message_decode_whole(blob[i]->bytes, blob[i]->size, &m) == LW_OK);
        lw_message_finish(&m);
        bytes += blob[i]->size;
        lw_blob_unref(blob[i]);
    }
    if (!link->is_full) return (int)bytes;
    link->waits = bytes;
    return 0;
}

static void read_on(struct lw_session_transport *transport, bool on) {
    ((struct link *)transport)->is_read = on;
}
static void push(struct lw_session_transport *transport) { (void)transport; }
static int end_writing(struct lw_session_transport *transport, enum lw_refusal code, const char *text) {
    (void)code;
    require(text != NULL);
    ((struct link *)transport)->is_ended = true;
    return 0;
}
static void close_link(struct lw_session_transport *transport) {
    struct link *link = (struct link *)transport;
    require(!link->is_closed);
    link->is_closed = true;
}
static void waiting(const struct lw_session_transport *transport, size_t *out_ours, size_t *out_socket) {
    *out_ours = ((const struct link *)transport)->waits;
    *out_socket = 0;
}

static const struct lw_session_transport_ops ops = {.write = write_blobs,
                                                    .read = read_on,
                                                    .push = push,
                                                    .end = end_writing,
                                                    .close = close_link,
                                                    .waiting = waiting};

/* ---- the server ---- */

static struct lw_session_shared shared;
static struct lw_atlas_map map;
static struct lw_scene *scene;
static struct lw_session_chunk chunk[CHUNKS];
static struct link *link_of[SESSIONS];

static void note(void *server) { (void)server; }

static enum lw_report_code ask(void *server, const struct lw_message_ask *question, char **out_text,
                               size_t *out_size) {
    (void)server, (void)question;
    *out_text = strdup("{}");
    *out_size = *out_text ? 2 : 0;
    return LW_REPORT_DONE;
}

/* Once; the replay of ctest does not call LLVMFuzzerInitialize(). */
static void prepare(void) {
    if (scene) return;
    static uint8_t data[LW_SESSION_CHUNK];
    lw_log_init("fuzz_session", LW_LOG_ERROR);
    scene = lw_support_squares(2, 1);
    scene->mesh[0].atlas_width = scene->mesh[0].atlas_height = 128;
    require(lw_atlas_map_init(&map, scene) == LW_OK);
    for (uint32_t i = 0; i < CHUNKS; i++) {
        const struct lw_message m = {.type = LW_MESSAGE_PACKAGE_CHUNK,
                                     .package_chunk = {i * LW_SESSION_CHUNK, data, sizeof data}};
        require(lw_blob_from_message(&m, &chunk[i].blob) == LW_OK);
        chunk[i].end = (i + 1ull) * LW_SESSION_CHUNK;
    }
}

static void begin(void) {
    prepare();
    now_ns = 100 * SECOND_NS;
    shared = (struct lw_session_shared){.atlas_map = &map,
                                        .channels.served = lw_tile_channel_bit(LW_TILE_CHANNEL_FULL),
                                        .welcome = {.version = LW_WIRE_VERSION,
                                                    .package_size = 1,
                                                    .package_compressed_size = CHUNKS * LW_SESSION_CHUNK,
                                                    .name = "fuzz"},
                                        .package = {chunk, CHUNKS},
                                        .scene = scene,
                                        .limits.sessions_max = PLACES,
                                        .parse.budget = LW_SERVER_PARSE_MAX,
                                        .limits.hello_timeout_ns = LW_SERVER_HELLO_TIMEOUT_S * SECOND_NS,
                                        .limits.package_timeout_ns = LW_SERVER_PACKAGE_TIMEOUT_S * SECOND_NS,
                                        .limits.stall_timeout_ns = LW_SERVER_STALL_TIMEOUT_S * SECOND_NS,
                                        .limits.excess_timeout_ns = LW_SERVER_EXCESS_TIMEOUT_S * SECOND_NS,
                                        .limits.silence_timeout_ns = LW_SERVER_SILENCE_S * SECOND_NS,
                                        .ask = ask,
                                        .on_open = note,
                                        .on_close = note};
    require(lw_interest_union_init(&shared.interest_union, &map) == LW_OK);
    require(lw_updates_init(&shared.updates) == LW_OK);
    require(lw_scene_roster_init(&shared.roster, scene) == LW_OK);
    require((shared.listed = calloc(map.tile_count / 64 + 1, sizeof *shared.listed)) != NULL);
    require(uv_mutex_init(&shared.stats_mutex) == 0);
}

/* What a link's close() has asked for. */
static void close_links(void) {
    for (unsigned i = 0; i < SESSIONS; i++) {
        if (!link_of[i] || !link_of[i]->is_closed) continue;
        lw_session_closed(link_of[i]->session);
        free(link_of[i]);
        link_of[i] = NULL;
    }
}

static void close_all(void) {
    for (unsigned i = 0; i < SESSIONS; i++)
        if (link_of[i] && !link_of[i]->is_closed) lw_session_close(link_of[i]->session, "the end");
    close_links();
    require(!shared.first && !shared.place_count && !shared.control_count && !shared.turned_away_count);
    for (uint32_t t = 0; t < map.tile_count; t++) require(!shared.interest_union.count[t]);
    for (uint32_t w = 0; w <= map.tile_count / 64; w++) require(!shared.listed[w]);
    free(shared.listed);
    lw_scene_roster_finish(&shared.roster);
    lw_interest_union_finish(&shared.interest_union);
    lw_updates_finish(&shared.updates);
    lw_address_places_finish(&shared.places);
    lw_address_places_finish(&shared.turned_away);
    lw_message_memory_finish(&shared.parse);
    uv_mutex_destroy(&shared.stats_mutex);
}

/* ---- what happens ---- */

struct input {
    const uint8_t *at;
    size_t left;
};

static uint32_t take_value(struct input *in, unsigned bytes) {
    uint32_t value = 0;
    for (; bytes && in->left; bytes--, in->at++, in->left--) value = value << 8 | *in->at;
    return value;
}

static void open_session(struct input *in, unsigned slot) {
    const uint32_t what = take_value(in, 1);
    struct lw_session_peer peer = {.at = {.is_loopback = what & 8},
                                   .address = "peer",
                                   .may_control = what & 16,
                                   .is_local = what & 32,
                                   .is_operator = (what & 96) == 96};
    peer.at.bytes[0] = what & 7;
    struct link *link = calloc(1, sizeof *link);
    require(link != NULL);
    link->transport.ops = &ops;
    link->is_read = true;
    link->is_full = what & 128;
    link->session = lw_session_open(&shared, &link->transport, &peer);
    if (link->session)
        link_of[slot] = link;
    else
        free(link);
}

static void receive(struct link *link, const uint8_t *bytes, size_t size) {
    if (!link->is_read || link->is_closed || link->is_ended) return; /* it stays with the peer */
    uint8_t *exact = malloc(size ? size : 1);
    require(exact != NULL);
    memcpy(exact, bytes, size);
    lw_session_handlers_receive(link->session, exact, size);
    free(exact);
}

/* A message as it should be, of a kind and with numbers that the input chooses. */
static void say(struct input *in, struct link *link) {
    static const enum lw_message_type types[] = {
        LW_MESSAGE_HELLO, LW_MESSAGE_PACKAGE_REQUEST, LW_MESSAGE_INTEREST, LW_MESSAGE_ACK, LW_MESSAGE_PING,
        LW_MESSAGE_PONG,  LW_MESSAGE_UPDATE,          LW_MESSAGE_ASK};
    struct lw_message m = {.type = types[take_value(in, 1) % (sizeof types / sizeof *types)]};
    struct lw_message_interest_tile tile[4];
    struct lw_scene_change change[2] = {{0}};
    switch (m.type) {
    case LW_MESSAGE_HELLO:
        m.hello = (struct lw_message_hello){.version = take_value(in, 1) % 8 ? LW_WIRE_VERSION : 9,
                                            .features = take_value(in, 2),
                                            .rate_limit_bytes_hz = take_value(in, 2),
                                            .name = "fuzz"};
        break;
    case LW_MESSAGE_PACKAGE_REQUEST:
        m.package_request.offset = take_value(in, 3);
        break;
    case LW_MESSAGE_INTEREST:
        m.interest = (struct lw_message_interest){.everything = take_value(in, 1) & 1, .tile = tile};
        m.interest.tile_count = m.interest.everything ? 0 : take_value(in, 1) % 5;
        m.interest.stand_ins = take_value(in, 1) & 1;
        for (unsigned i = 0; i < 4; i++)
            tile[i] = (struct lw_message_interest_tile){take_value(in, 1) % 3, take_value(in, 1) % 5,
                                                        take_value(in, 1) % 5};
        break;
    case LW_MESSAGE_ACK:
        m.ack.frame = take_value(in, 2);
        break;
    case LW_MESSAGE_PING:
        m.ping.token = take_value(in, 2);
        break;
    case LW_MESSAGE_UPDATE:
        m.update = (struct lw_message_update){take_value(in, 1), change, take_value(in, 1) % 3};
        for (unsigned i = 0; i < 2; i++) {
            change[i] = (struct lw_scene_change){
                take_value(in, 1) % 24, take_value(in, 1) % 4, take_value(in, 1) % 13, {0}};
            for (unsigned v = 0; v < change[i].value_count && v < LW_SCENE_CHANGE_VALUES_MAX; v++)
                change[i].value[v] = (float)take_value(in, 1) - 100;
            if (change[i].value_count > LW_SCENE_CHANGE_VALUES_MAX) change[i].value_count = 0;
        }
        break;
    case LW_MESSAGE_ASK:
        m.ask = (struct lw_message_ask){take_value(in, 1), take_value(in, 1) % 4, take_value(in, 2)};
        break;
    default:
        break;
    }
    uint8_t *bytes;
    size_t size;
    if (lw_message_encode_alloc(&m, &bytes, &size) != LW_OK) return;
    receive(link, bytes, size);
    free(bytes);
}

static void tick_all(uint64_t passed_ns) {
    struct lw_session_waiting waits = {0};
    now_ns += passed_ns;
    shared.epoch++;
    for (struct lw_session *s = shared.first, *next; s; s = next) {
        next = lw_session_next(s);
        lw_session_tick(s, now_ns, &waits);
    }
    lw_turns_serve_paced(&shared);
}

static void go_on(struct link *link) {
    if (!link->waits || link->is_closed) return;
    link->waits = 0;
    link->is_full = false;
    lw_session_written(link->session, 0, true);
}

static void step(struct input *in) {
    const uint32_t what = take_value(in, 1);
    const unsigned slot = (what >> 4) % SESSIONS;
    struct link *link = link_of[slot];
    if (!link) {
        if (what & 1)
            open_session(in, slot);
        else
            tick_all(take_value(in, 1) * (SECOND_NS / 16));
        return;
    }
    switch (what & 15) {
    case 0: {
        size_t size = take_value(in, 1);
        if (size > in->left) size = in->left;
        const uint8_t *bytes = in->at;
        in->at += size, in->left -= size;
        receive(link, bytes, size);
        break;
    }
    case 1:
        link->is_full = true;
        break;
    case 2:
        go_on(link);
        break;
    case 3:
        if (!link->is_closed) lw_session_lost(link->session, take_value(in, 1) & 1 ? UV_EOF : UV_ECONNRESET);
        break;
    case 4:
        tick_all(take_value(in, 1) * (SECOND_NS / 16));
        break;
    case 5:
        tick_all(take_value(in, 1) * SECOND_NS);
        break;
    case 6:
        lw_turns_read_on(&shared);
        break;
    case 7:
        lw_session_refuse(link->session, LW_REFUSAL_SHUTDOWN, "the server ends");
        break;
    default:
        say(in, link);
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size) {
    struct input in = {bytes, size};
    begin();
    while (in.left) {
        step(&in);
        lw_turns_serve_due(&shared, UINT64_MAX);
        close_links();
        require(shared.place_count <= PLACES);
    }
    close_all();
    return 0;
}
