#include "tests/support/serving.h"

#include "server/serve/server.h"
#include "tests/support/server_clock.h"

#include <arpa/inet.h>
#include <errno.h>
#include <netinet/in.h>
#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

uint32_t serving_channel;

bool serving_is_paced; /* time goes on while a peer waits for bytes */

static const uint8_t client_lights[] = {2, 1}; /* the second and the ninth */

void *serving_serve(void *context) {
    struct serving *f = context;
    f->result = lw_server_run(f->server, NULL);
    return NULL;
}

uint32_t serving_finer_levels;  /* the next server's */
uint32_t serving_fine_room = 3; /* ids for their tiles */

struct serving *serving_start(const struct lw_server_desc *extra) {
    struct serving *f = calloc(1, sizeof *f);
    assert_non_null(f);
    f->scene = lw_support_squares(SERVING_OBJECTS, 1.0f);
    f->scene->mesh[0].atlas_width =
        200; /* levels 200x100, 100x50, 50x25, 25x13, 13x7: 8 + 2 + 1 + 1 + 1 tiles */
    f->scene->mesh[0].atlas_height = 100;
    lw_support_ok(lw_atlas_map_init_finer(&f->map, f->scene, serving_finer_levels,
                                          serving_finer_levels ? serving_fine_room : 0),
                  NULL);
    assert_int_equal(f->map.plain_count, 13 * SERVING_OBJECTS);
    f->package = malloc(SERVING_PACKAGE_SIZE);
    assert_non_null(f->package);
    uint32_t noise = 1; /* does not compress, so that there are several chunks */
    for (uint32_t i = 0; i < SERVING_PACKAGE_SIZE; i++)
        f->package[i] = (uint8_t)((noise = noise * 1664525u + 1013904223u) >> 24);
    struct lw_server_desc desc = *extra;
    struct lw_error err = {0};
    desc.host = "127.0.0.1";
    desc.atlas_map = &f->map;
    desc.client_lights = client_lights;
    desc.client_lights_size = sizeof client_lights;
    if (!desc.package) {
        desc.package = f->package;
        desc.package_size = SERVING_PACKAGE_SIZE;
    }
    desc.bounces = 2;
    desc.target_error = 0.05f;
    lw_support_ok(lw_server_create(&desc, &f->server, &err), &err);
    serving_is_paced = false;
    server_clock_stop();
    assert_int_equal(pthread_create(&f->thread, NULL, serving_serve, f), 0);
    return f;
}

void serving_join(struct serving *f) {
    server_clock_run();
    assert_int_equal(pthread_join(f->thread, NULL), 0);
    assert_int_equal(f->result, LW_OK);
    lw_server_destroy(f->server);
    f->server = NULL;
}

void serving_discard(struct serving *f) {
    lw_atlas_map_finish(&f->map);
    lw_scene_destroy(f->scene);
    free(f->package);
    free(f);
}

void serving_end(struct serving *f) {
    lw_server_stop(f->server);
    serving_join(f);
    serving_discard(f);
}

struct lw_server_stats serving_stats_of(const struct serving *f) {
    struct lw_server_stats stats;
    lw_server_get_stats(f->server, &stats);
    return stats;
}

void serving_wait_for_sessions(const struct serving *f, uint64_t sessions) {
    LW_SUPPORT_WAIT_UNTIL(serving_stats_of(f).sessions_now == sessions);
}

struct lw_blob *serving_blob_of(const struct lw_message *message) {
    struct lw_blob *blob;
    lw_support_ok(lw_blob_from_message(message, &blob), NULL);
    return blob;
}

static struct lw_blob *frame_blob(uint64_t frame, double time_s) {
    return serving_blob_of(
        &(struct lw_message){.type = LW_MESSAGE_FRAME, .frame = {.frame = frame, .time_s = time_s}});
}

struct lw_snapshot *serving_make_snapshot(const struct serving *f, uint64_t frame, uint64_t previous) {
    static const uint8_t payload[SERVING_PAYLOAD_SIZE] = {1};
    struct lw_snapshot *snapshot;
    lw_support_ok(lw_snapshot_create(f->map.tile_count, 1u << serving_channel, &snapshot), NULL);
    snapshot->frame = frame;
    snapshot->previous_frame = previous;
    snapshot->frame_full = frame_blob(frame, 1);
    if (previous) snapshot->frame_delta = frame_blob(frame, 2);
    for (uint32_t t = 0; t < f->map.tile_count; t++) {
        const struct lw_tile_place *p = &f->map.place[t];
        if (!lw_atlas_map_is_used(&f->map, (lw_tile_id){t})) continue;
        snapshot->tile[serving_channel][t].version = frame;
        snapshot->tile[serving_channel][t].blob = serving_blob_of(
            &(struct lw_message){.type = LW_MESSAGE_TILE,
                                 .tile = {.layer = serving_channel,
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

void serving_publish(struct serving *f, struct lw_snapshot *snapshot) {
    lw_server_publish(f->server, snapshot);
    lw_snapshot_unref(snapshot);
}

int serving_dial_with_buffer(const struct serving *f, int receive_buffer) {
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

int serving_dial(const struct serving *f) { return serving_dial_with_buffer(f, 0); }

void serving_put_bytes(int s, const void *bytes, size_t size) {
    assert_int_equal(send(s, bytes, size, MSG_NOSIGNAL), (ssize_t)size);
}

void serving_put(int s, const struct lw_message *message) {
    struct lw_message m = *message;
    if (m.type == LW_MESSAGE_HELLO && serving_channel == LW_TILE_CHANNEL_SPLIT)
        m.hello.features |= LW_FEATURE_DRAWS;
    struct lw_blob *blob = serving_blob_of(&m);
    serving_put_bytes(s, blob->bytes, blob->size);
    lw_blob_unref(blob);
}

bool serving_is_readable(int s) {
    struct pollfd look = {.fd = s, .events = POLLIN};
    return poll(&look, 1, 0) == 1;
}

/* Until there are bytes. */
static void wait_for_bytes(int s) {
    struct pollfd wait = {.fd = s, .events = POLLIN};
    while (serving_is_paced && !serving_is_readable(s))
        if (!server_clock_step(SERVING_STEP_MS)) lw_support_pause(); /* it has not accepted anybody yet */
    assert_int_equal(poll(&wait, 1, -1), 1);
}

bool serving_get_bytes(int s, uint8_t *dst, size_t size) {
    for (size_t got = 0; got < size;) {
        wait_for_bytes(s);
        ssize_t n = recv(s, dst + got, size - got, 0);
        if (n == 0 || (n < 0 && errno == ECONNRESET)) return false;
        assert_true(n > 0);
        got += (size_t)n;
    }
    return true;
}

/* Whether it is in the channel that peers ask for. What WELCOME then has beside the rest is taken out. */
static void check_channel(struct lw_message *m) {
    const bool draws = serving_channel == LW_TILE_CHANNEL_SPLIT;
    if (m->type == LW_MESSAGE_TILE) assert_int_equal(m->tile.layer, serving_channel);
    if (m->type != LW_MESSAGE_WELCOME) return;
    assert_int_equal(m->welcome.features & LW_FEATURE_DRAWS, draws ? LW_FEATURE_DRAWS : 0);
    assert_int_equal(m->welcome.client_lights_size, draws ? sizeof client_lights : 0);
    if (draws) assert_memory_equal(m->welcome.client_lights, client_lights, sizeof client_lights);
    assert_int_equal(m->welcome.client_materials_size, 0);
    m->welcome.features &= ~(uint64_t)LW_FEATURE_DRAWS;
}

bool serving_get(int s, struct lw_message *out) {
    static uint8_t body[LW_FRAMING_BODY_MAX];
    uint8_t bytes[LW_FRAMING_HEADER_SIZE];
    struct lw_framing_header header;
    struct lw_error err = {0};
    if (!serving_get_bytes(s, bytes, sizeof bytes)) return false;
    lw_support_ok(lw_framing_read_header(bytes, LW_FRAMING_BODY_MAX, &header, &err), &err);
    if (!serving_get_bytes(s, body, header.body_size)) return false;
    lw_support_ok(lw_message_decode(header, body, out, &err), &err);
    check_channel(out);
    return true;
}

void serving_expect(int s, enum lw_message_type type, struct lw_message *out) {
    assert_true(serving_get(s, out));
    assert_int_equal(out->type, type);
}

void serving_expect_refusal_after(int s, enum lw_refusal code, uint32_t retry_after_ms) {
    struct lw_message m;
    while (serving_get(s, &m)) {
        if (m.type != LW_MESSAGE_REFUSAL) {
            lw_message_finish(&m);
            continue;
        }
        assert_int_equal(m.refusal.code, code);
        assert_int_equal(m.refusal.retry_after_ms, retry_after_ms);
        assert_true(strlen(m.refusal.text) > 0);
        lw_message_finish(&m);
        uint8_t byte;
        const bool was_paced = serving_is_paced;
        serving_is_paced = true;
        assert_false(serving_get_bytes(s, &byte, 1)); /* then closed */
        serving_is_paced = was_paced;
        close(s);
        return;
    }
    fail_msg("closed without a refusal");
}

void serving_expect_refusal(int s, enum lw_refusal code) { serving_expect_refusal_after(s, code, 0); }

const struct lw_message serving_hello = {.type = LW_MESSAGE_HELLO,
                                         .hello = {.version = LW_WIRE_VERSION, .name = "test"}};

const struct lw_message serving_hello_again = {
    .type = LW_MESSAGE_HELLO,
    .hello = {.version = LW_WIRE_VERSION, .features = LW_FEATURE_RESUME, .name = "test"}};

int serving_dial_and_greet(const struct serving *f) {
    int s = serving_dial(f);
    struct lw_message m;
    serving_put(s, &serving_hello);
    serving_expect(s, LW_MESSAGE_WELCOME, &m);
    lw_message_finish(&m);
    return s;
}

int serving_dial_and_greet_with(const struct serving *f, uint64_t features) {
    int s = serving_dial(f);
    serving_put(s, &(struct lw_message){.type = LW_MESSAGE_HELLO,
                                        .hello = {.version = LW_WIRE_VERSION, .features = features}});
    struct lw_message m;
    serving_expect(s, LW_MESSAGE_WELCOME, &m);
    lw_message_finish(&m);
    return s;
}

void serving_ask_for_package(int s, uint64_t offset) {
    serving_put(s,
                &(struct lw_message){.type = LW_MESSAGE_PACKAGE_REQUEST, .package_request.offset = offset});
}

int serving_dial_and_stream(const struct serving *f) {
    int s = serving_dial(f);
    struct lw_message m;
    serving_put(s, &serving_hello);
    serving_expect(s, LW_MESSAGE_WELCOME, &m);
    uint64_t end = m.welcome.package_compressed_size;
    lw_message_finish(&m);
    serving_ask_for_package(s, end); /* as one who has the package */
    return s;
}

void serving_expect_frame(int s, uint64_t frame, double time_s) {
    struct lw_message m;
    serving_expect(s, LW_MESSAGE_FRAME, &m);
    assert_int_equal(m.frame.frame, frame);
    assert_true(m.frame.time_s == time_s);
    lw_message_finish(&m);
}

void serving_expect_tiles(int s, uint32_t count, uint64_t version) {
    for (uint32_t i = 0; i < count; i++) {
        struct lw_message m;
        serving_expect(s, LW_MESSAGE_TILE, &m);
        assert_int_equal(m.tile.version, version);
        lw_message_finish(&m);
    }
}

void serving_expect_light(const struct serving *f, int s, uint64_t frame) {
    serving_expect_frame(s, frame, 1);
    serving_expect_tiles(s, f->map.plain_count, frame);
}

void serving_expect_silence(int s) {
    static uint64_t token = 1000;
    for (int i = 0; i < 2; i++) {
        struct lw_message m;
        serving_put(s, &(struct lw_message){.type = LW_MESSAGE_PING, .ping.token = ++token});
        serving_expect(s, LW_MESSAGE_PONG, &m);
        assert_int_equal(m.pong.token, token);
        lw_message_finish(&m);
        server_clock_move(100);
    }
}

int serving_dial_again(const struct serving *f, struct lw_message_welcome *out_welcome) {
    int s = serving_dial(f);
    struct lw_message m;
    serving_put(s, &serving_hello_again);
    serving_expect(s, LW_MESSAGE_WELCOME, &m);
    assert_int_equal(m.welcome.features, LW_FEATURE_RESUME);
    *out_welcome = m.welcome;
    lw_message_finish(&m);
    return s;
}

const struct lw_scene_change serving_hide_1 = {LW_SCENE_CHANGE_OBJECT_HIDE, 1, 0, {0}},
                             serving_sky = {LW_SCENE_CHANGE_SKY, 0, 3, {1, 2, 3}},
                             serving_no_such = {LW_SCENE_CHANGE_OBJECT_HIDE, SERVING_OBJECTS, 0, {0}};

struct serving *serving_start_controlled_with(struct lw_server_desc desc) {
    static struct lw_scene *scene; /* has the same counts as every fixture's */
    if (!scene) scene = lw_support_squares(SERVING_OBJECTS, 1.0f);
    desc.scene = scene;
    desc.control_socket = lw_support_temporary("control.sock");
    return serving_start(&desc);
}

struct serving *serving_start_controlled(void) {
    return serving_start_controlled_with((struct lw_server_desc){0});
}

int serving_dial_locally(void) {
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    snprintf(address.sun_path, sizeof address.sun_path, "%s", lw_support_temporary("control.sock"));
    int s = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    assert_true(s >= 0);
    assert_int_equal(connect(s, (struct sockaddr *)&address, sizeof address), 0);
    return s;
}

int serving_dial_and_control(const struct serving *f, bool stream) {
    (void)f;
    int s = serving_dial_locally();
    struct lw_message m, control = serving_hello;
    control.hello.features = LW_FEATURE_CONTROL;
    serving_put(s, &control);
    serving_expect(s, LW_MESSAGE_WELCOME, &m);
    assert_int_equal(m.welcome.features, LW_FEATURE_CONTROL);
    if (stream) serving_ask_for_package(s, m.welcome.package_compressed_size);
    lw_message_finish(&m);
    return s;
}

void serving_update(int s, uint64_t request, const struct lw_scene_change *change, size_t count) {
    serving_put(s, &(struct lw_message){.type = LW_MESSAGE_UPDATE, .update = {request, change, count}});
}

struct lw_scene_change *serving_take(const struct serving *f, uint64_t frame, size_t updates,
                                     size_t changes) {
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

size_t serving_flood(int s, const struct lw_blob *bytes, size_t total, bool *out_closed) {
    for (unsigned full = 0; full < 3;) {
        const size_t at = total % bytes->size;
        const ssize_t n = send(s, bytes->bytes + at, bytes->size - at, MSG_NOSIGNAL | MSG_DONTWAIT);
        *out_closed = n < 0 && errno != EAGAIN;
        if (*out_closed || total > SERVING_FLOOD_MAX) return total;
        if (n > 0) total += (size_t)n;
        full = n > 0 ? 0 : full + 1;
        if (n < 0) server_clock_step(0);
    }
    return total;
}

int serving_ask_for_split(void **state) {
    (void)state;
    serving_channel = LW_TILE_CHANNEL_SPLIT;
    return 0;
}
