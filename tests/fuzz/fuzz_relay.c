/* A server above that says anything, to the upper side of a relay: a session over a real link. The input is a
 * byte that says what came before, then pieces: two bytes of length, and the server's bytes. Before may come
 * nothing, a welcome and the package of a small scene, or a welcome of a session that is resumed, in the same
 * run or in another. Clients list two tiles of a finer level. After each piece there may be a snapshot. A
 * snapshot must be light for a client, whatever the server says: a replica takes it in.
 *
 * The fifth kind is a session for changes. Three updates of clients are sent up: each is answered or lost
 * once, and an answer is a message for its client. */
#include "tests/support/support.h"

#include "client/lib/replica.h"
#include "common/base/log.h"
#include "common/scene/scene_spares.h"
#include "relay/relay_upstream.h"
#include "server/serve/sessions/passed_updates.h"

#include <poll.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>
#include <zstd.h>

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);

#define FINER  1u /* levels that are finer than level 0 */
#define LISTED 2u /* tiles of those that clients list */

#define CONTROL 4u /* the kind of a session for changes */
#define UPDATES 3u
#define AHEAD   LW_PASSED_UPDATES_RUN_FRAMES /* the relay has joined two runs */

static void require(bool condition) {
    if (!condition) abort();
}

/* ---- the server above ---- */

static struct {
    int listener, session;
    char path[100];
    uint8_t *welcome, *control, *chunk; /* messages: welcomes of a session for light, and for changes */
    size_t welcome_size, control_size, chunk_size;
    uint8_t *package;
    size_t package_size;
    const uint8_t *first; /* what it says when the session begins */
    size_t first_size;
} above;

static void make_scene(void) {
    struct lw_scene *scene = lw_support_everything();
    for (uint32_t i = 0; i < scene->mesh_count; i++)
        if (scene->mesh[i].atlas_width) { /* several tiles across and down, the last ones cut off */
            scene->mesh[i].atlas_width = 140;
            scene->mesh[i].atlas_height = 72;
        }
    require(lw_scene_spares_add(scene, "1", NULL) == LW_OK);
    require(lw_package_write(scene, &above.package, &above.package_size, NULL) == LW_OK);
    lw_scene_destroy(scene);
    const size_t bound = ZSTD_compressBound(above.package_size);
    uint8_t *compressed = malloc(bound);
    const size_t size = ZSTD_compress(compressed, bound, above.package, above.package_size, 1);
    require(!ZSTD_isError(size) && size <= LW_MESSAGE_CHUNK_MAX);
    struct lw_message welcome = {
        .type = LW_MESSAGE_WELCOME,
        .welcome = {.version = LW_WIRE_VERSION,
                    .features = LW_FEATURE_DCT | LW_FEATURE_RESUME | LW_FEATURE_FINER,
                    .finer = FINER,
                    .name = "fuzz",
                    .package_size = above.package_size,
                    .package_compressed_size = size,
                    .run = 1}};
    lw_package_hash(above.package, above.package_size, &welcome.welcome.package_hash);
    const struct lw_message chunk = {.type = LW_MESSAGE_PACKAGE_CHUNK,
                                     .package_chunk = {0, compressed, size}};
    require(lw_message_encode_alloc(&welcome, &above.welcome, &above.welcome_size) == LW_OK);
    welcome.welcome.features = LW_FEATURE_CONTROL;
    welcome.welcome.finer = 0;
    require(lw_message_encode_alloc(&welcome, &above.control, &above.control_size) == LW_OK);
    require(lw_message_encode_alloc(&chunk, &above.chunk, &above.chunk_size) == LW_OK);
    free(compressed);
}

static void stop_listening(void) { unlink(above.path); }

static void listen_once(void) {
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    const char *folder = getenv("TMPDIR");
    snprintf(above.path, sizeof above.path, "%s/fuzz_relay.%ld", folder ? folder : "/tmp", (long)getpid());
    require(strlen(above.path) < sizeof address.sun_path);
    strcpy(address.sun_path, above.path);
    unlink(above.path);
    above.listener = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    require(above.listener >= 0 && bind(above.listener, (struct sockaddr *)&address, sizeof address) == 0 &&
            listen(above.listener, 4) == 0);
    atexit(stop_listening);
}

/* Pieces are shorter than what a socket holds. */
static void say(const uint8_t *bytes, size_t size) {
    while (size) {
        const ssize_t sent = send(above.session, bytes, size, MSG_NOSIGNAL | MSG_DONTWAIT);
        if (sent <= 0) return; /* the relay has hung up, or is full */
        bytes += sent;
        size -= (size_t)sent;
    }
}

/* Says the next piece of the input, whose length stands before it; returns where it ends. */
static size_t say_next(const uint8_t *bytes, size_t size, size_t at) {
    size_t length = bytes[at] | (size_t)bytes[at + 1] << 8;
    at += 2;
    if (length > size - at) length = size - at;
    say(bytes + at, length);
    return at + length;
}

static void *welcome(void *nothing) {
    above.session = accept(above.listener, NULL, NULL);
    say(above.first, above.first_size);
    if (above.first != above.welcome && above.first != above.control)
        shutdown(above.session, SHUT_WR); /* nobody waits for more */
    return nothing;
}

static struct lw_relay_upstream *connect_relay(const uint8_t *first, size_t size) {
    struct lw_relay_upstream *up = NULL;
    struct lw_error err = {0};
    char host[120];
    pthread_t thread;
    above.first = first;
    above.first_size = size;
    snprintf(host, sizeof host, LW_ACCESS_UNIX "%s", above.path);
    require(pthread_create(&thread, NULL, welcome, NULL) == 0);
    const enum lw_status status = lw_relay_upstream_create(
        &(struct lw_relay_upstream_desc){
            .host = host, .timeout_ms = 10000, .relay = 7, .control = first == above.control},
        &up, &err);
    require(status == LW_OK || (!up && *err.text));
    pthread_join(thread, NULL);
    return up;
}

static void hang_up(struct lw_relay_upstream **up) {
    lw_relay_upstream_destroy(*up);
    *up = NULL;
    close(above.session);
}

/* ---- clients below ---- */

/* Tiles of a finer level of the first object that has a lightmap. */
static lw_tile_id fine_tile(const struct lw_atlas_map *map, uint32_t number) {
    uint32_t object = 0;
    while (!map->atlas[object]->level_count) object++;
    const lw_tile_id id = lw_atlas_map_claim_tile(map, object, LW_ATLAS_FINER + 1, number);
    require(id.v != UINT32_MAX);
    return id;
}

static void list_fine(struct lw_relay_light *light, lw_tile_id out_id[LISTED]) {
    uint32_t tile[LISTED];
    for (uint32_t i = 0; i < LISTED; i++) {
        out_id[i] = fine_tile(lw_relay_light_map(light), i);
        tile[i] = out_id[i].v;
    }
    (void)lw_relay_light_list(light, 1, tile, LISTED);
}

static struct lw_replica *join(void) {
    struct lw_replica *replica;
    require(lw_replica_create(above.package, above.package_size, FINER, &replica, NULL) == LW_OK);
    for (uint32_t i = 0; i < LISTED; i++) (void)fine_tile(lw_replica_atlas_map(replica), i);
    return replica;
}

static void give(struct lw_replica *replica, const struct lw_blob *blob) {
    struct lw_error err = {0};
    for (size_t at = 0; blob && at < blob->size;) {
        struct lw_framing_header header;
        struct lw_message m;
        require(lw_framing_read_header(blob->bytes + at, LW_FRAMING_BODY_MAX, &header, NULL) == LW_OK);
        at += LW_FRAMING_HEADER_SIZE;
        require(header.body_size <= blob->size - at);
        require(lw_message_decode(header, blob->bytes + at, &m, NULL) == LW_OK);
        at += header.body_size;
        if (m.type == LW_MESSAGE_FRAME) require(lw_replica_take_frame(replica, &m.frame, &err) == LW_OK);
        if (m.type == LW_MESSAGE_TILE) require(lw_replica_take_tile(replica, &m.tile, &err) == LW_OK);
        lw_message_finish(&m);
    }
}

/* A tile that was withdrawn is gone from both. */
static void show_fine(const struct lw_snapshot *s, lw_tile_id id, uint32_t number,
                      struct lw_replica *newcomer, struct lw_replica *follower) {
    const struct lw_snapshot_tile *tile = &s->tile[LW_TILE_CHANNEL_FULL][id.v];
    const lw_tile_id theirs[2] = {fine_tile(lw_replica_atlas_map(newcomer), number),
                                  fine_tile(lw_replica_atlas_map(follower), number)};
    const uint64_t had = lw_replica_get_tile(follower, theirs[1]).version;
    require(tile->version <= lw_snapshot_version(s->frame) && had <= tile->version);
    give(newcomer, tile->blob);
    if (had < tile->version) give(follower, tile->delta && tile->base == had ? tile->delta : tile->blob);
    const struct lw_client_tile a = lw_replica_get_tile(newcomer, theirs[0]),
                                b = lw_replica_get_tile(follower, theirs[1]);
    require(a.version == b.version && (!a.version || a.version == tile->version) && !a.rgb == !b.rgb);
    const struct lw_tile_place *place = &lw_replica_atlas_map(newcomer)->place[theirs[0].v];
    require(!a.rgb || !memcmp(a.rgb, b.rgb, 3 * sizeof(float) * (size_t)place->width * place->height));
}

/* Newcomers get whole tiles; a replica that followed gets deltas. */
static void compare_newcomer(struct lw_relay_light *light, struct lw_replica *follower) {
    const struct lw_atlas_map *map = lw_relay_light_map(light);
    struct lw_snapshot *s;
    if (lw_relay_light_snapshot(light, &s) != LW_OK || !s) return;
    struct lw_replica *newcomer = join();
    give(newcomer, s->frame_full);
    give(follower, s->frame_delta ? s->frame_delta : s->frame_full);
    for (uint32_t t = 0; t < map->plain_count; t++) {
        const struct lw_snapshot_tile *tile = &s->tile[LW_TILE_CHANNEL_FULL][t];
        const uint64_t had = lw_replica_get_tile(follower, (lw_tile_id){t}).version;
        require(tile->version <= lw_snapshot_version(s->frame) && had <= tile->version);
        give(newcomer, tile->blob);
        if (had < tile->version) give(follower, tile->delta && tile->base == had ? tile->delta : tile->blob);
        require(lw_replica_get_tile(newcomer, (lw_tile_id){t}).version == tile->version &&
                lw_replica_get_tile(follower, (lw_tile_id){t}).version == tile->version);
    }
    for (uint32_t o = 0; o < map->object_count; o++)
        for (uint32_t l = 0; l < map->atlas[o]->level_count; l++) {
            const struct lw_client_level a = lw_replica_get_level(newcomer, o, l),
                                         b = lw_replica_get_level(follower, o, l);
            require(!memcmp(a.rgb, b.rgb, 3 * sizeof(float) * (size_t)a.width * a.height));
        }
    for (uint32_t i = 0; i < LISTED; i++) show_fine(s, fine_tile(map, i), i, newcomer, follower);
    lw_replica_destroy(newcomer);
    lw_snapshot_unref(s);
}

/* ---- updates ---- */

static struct lw_passed_updates updates;

static void on_answered(void *nothing, const struct lw_message_updated *updated) {
    (void)nothing;
    struct lw_message_updated answer = *updated;
    answer.frame = lw_relay_light_count(updated->frame, AHEAD);
    (void)lw_passed_updates_answer(&updates, updated->request, &answer);
}

/* What clients hear at a frame; the number of answers, and of updates that are lost. */
static unsigned hear(uint64_t frame) {
    struct lw_passed_updates_done done;
    unsigned count = 0;
    for (; lw_passed_updates_next(&updates, frame, &done); count++) {
        uint8_t *bytes = NULL;
        size_t size;
        const struct lw_message message = {.type = LW_MESSAGE_UPDATED, .updated = done.answer};
        if (!done.is_lost) {
            require(done.answer.request < UPDATES && (done.answer.code || done.answer.frame <= frame));
            require(lw_message_encode_alloc(&message, &bytes, &size) == LW_OK);
        }
        free(bytes);
        free(done.storage);
    }
    return count;
}

static void send_updates(struct lw_relay_upstream *up, struct lw_session *client) {
    struct lw_error err = {0};
    for (uint64_t i = 0; i < UPDATES; i++) {
        struct lw_scene_change change = {.kind = LW_SCENE_CHANGE_OBJECT_HIDE, .target = 1};
        struct lw_passed_update update;
        bool sent;
        require(lw_passed_updates_add(&updates, client, NULL, &(struct lw_message_update){i, &change, 1}));
        require(lw_passed_updates_take(&updates, &update));
        require(lw_relay_upstream_update(up, update.number, update.change, update.change_count, &sent,
                                         &err) == LW_OK &&
                sent);
        free(update.change);
    }
}

static void change_scene(const uint8_t *bytes, size_t size) {
    struct lw_error err = {0};
    char client; /* a session is an address here */
    unsigned heard = 0;
    struct lw_relay_upstream *up = connect_relay(above.control, above.control_size);
    require(up && lw_passed_updates_init(&updates) == LW_OK);
    lw_relay_upstream_set_answered(up, on_answered, NULL);
    send_updates(up, (struct lw_session *)(void *)&client);
    for (size_t at = 0; up && size - at >= 2;) {
        at = say_next(bytes, size, at);
        if (lw_relay_upstream_take(up, &err) != LW_OK) {
            require(*err.text);
            hang_up(&up);
        }
        heard += hear(AHEAD + at);
    }
    if (up) hang_up(&up);
    for (uint64_t number = 1; number <= UPDATES; number++) lw_passed_updates_lose(&updates, number);
    heard += hear(UINT64_MAX);
    require(heard == UPDATES);
    lw_passed_updates_finish(&updates);
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size) {
    if (!above.package) {
        lw_log_init("fuzz_relay", LW_LOG_ERROR);
        make_scene();
        listen_once();
    }
    if (!size) return 0;
    const uint8_t kind = bytes[0] % 5;
    if (kind == CONTROL) {
        change_scene(bytes + 1, size - 1);
        return 0;
    }
    struct lw_error err = {0};
    struct lw_relay_scene scene = {0};
    struct lw_replica *follower = NULL;
    lw_tile_id listed[LISTED];
    struct lw_relay_upstream *up =
        connect_relay(kind ? above.welcome : bytes + 1, kind ? above.welcome_size : size - 1);
    if (up && kind && lw_relay_upstream_begin(up, &err) == LW_OK) {
        say(above.chunk, above.chunk_size);
        while (!lw_relay_upstream_light(up)) require(lw_relay_upstream_take(up, &err) == LW_OK);
        lw_relay_upstream_give(up, &scene);
        list_fine(scene.light, listed);
        lw_relay_light_ask(scene.light, LW_TILE_CHANNEL_FULL, listed, LISTED);
        follower = join();
    }
    for (size_t at = 1; follower && up && size - at >= 2;) {
        at = say_next(bytes, size, at);
        if (lw_relay_upstream_take(up, &err) != LW_OK) {
            require(*err.text);
            err = (struct lw_error){0};
            hang_up(&up);
            if (kind < 2 || !(up = connect_relay(above.welcome, above.welcome_size))) break;
            if (kind == 3 && !lw_relay_light_begin_run(scene.light, at)) {
                hang_up(&up);
                break;
            }
            if (lw_relay_upstream_want(up, false, &listed->v, LISTED) != LW_OK ||
                lw_relay_upstream_resume(up, scene.light, &err) != LW_OK)
                hang_up(&up);
        }
        compare_newcomer(scene.light, follower);
    }
    if (up)
        hang_up(&up);
    else if (!kind)
        close(above.session);
    lw_replica_destroy(follower);
    lw_relay_scene_finish(&scene);
    return 0;
}
