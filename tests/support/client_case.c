#include "tests/support/client_case.h"

#include "client/lib/client.h"
#include "common/base/clock.h"
#include "common/scene/scene_spares.h"
#include "common/tile/tile_codec.h"
#include "server/serve/server.h"

#include <arpa/inet.h>
#include <dirent.h>
#include <netinet/in.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>
#include <zstd.h>

#define SCALE 4.0f

struct client_case_world client_case_make_world_with(const char *spares) {
    struct client_case_world w = {.scene = lw_support_everything()};
    struct lw_error err = {0};
    if (spares) lw_support_ok(lw_scene_spares_add(w.scene, spares, &err), &err);
    for (uint32_t i = 0; i < w.scene->mesh_count;
         i++) /* several tiles across and down, the last ones cut off */
        if (w.scene->mesh[i].atlas_width) {
            w.scene->mesh[i].atlas_width = 200;
            w.scene->mesh[i].atlas_height = 140;
        }
    lw_support_ok(lw_atlas_map_init(&w.map, w.scene), NULL);
    assert_true(w.map.tile_count > 12);
    lw_support_ok(lw_package_write(w.scene, &w.package, &w.package_size, &err), &err);
    w.compressed = malloc(ZSTD_compressBound(w.package_size));
    w.compressed_size =
        ZSTD_compress(w.compressed, ZSTD_compressBound(w.package_size), w.package, w.package_size, 3);
    assert_false(ZSTD_isError(w.compressed_size));
    lw_support_ok(lw_tile_codec_create(&w.codec), NULL);
    return w;
}

struct client_case_world client_case_make_world(void) {
    return client_case_make_world_with(NULL);
}

void client_case_finish_world(struct client_case_world *w) {
    lw_tile_codec_destroy(w->codec);
    free(w->package);
    free(w->compressed);
    lw_atlas_map_finish(&w->map);
    lw_scene_destroy(w->scene);
}

float client_case_value_of(uint32_t object, uint32_t level, uint32_t x, uint32_t y, int channel,
                           uint64_t version) {
    return SCALE * (float)((object * 5 + level * 3 + x + 2 * y + (uint32_t)channel + version) % 64);
}

struct lw_message client_case_tile_message(const struct client_case_world *w, uint32_t id, uint64_t version,
                                           uint8_t *payload) {
    static float rgb[LW_TILE_TEXELS_MAX * 3];
    const struct lw_tile_place *p = &w->map.place[id];
    for (uint32_t y = 0; y < p->height; y++)
        for (uint32_t x = 0; x < p->width; x++)
            for (int c = 0; c < 3; c++)
                rgb[3 * (y * p->width + x) + (uint32_t)c] = client_case_value_of(
                    p->object, p->level, p->x * LW_TILE_SIDE + x, p->y * LW_TILE_SIDE + y, c, version);
    struct lw_message m = {.type = LW_MESSAGE_TILE,
                           .tile = {.object = p->object,
                                    .level = p->level,
                                    .tile = p->y * w->map.atlas[p->object]->level[p->level].tiles_x + p->x,
                                    .version = version,
                                    .codec = LW_TILE_CODEC_HALF_ZSTD,
                                    .bounces = 2,
                                    .error = 0.5f,
                                    .payload = payload}};
    uint32_t saturated;
    lw_support_ok(lw_tile_codec_encode_half(w->codec, NULL, rgb, p->width, p->height, payload,
                                            lw_tile_codec_bound(), &m.tile.payload_size, &m.tile.scale,
                                            &saturated),
                  NULL);
    return m;
}

void client_case_expect_texels(const struct lw_client *client, const struct client_case_world *w, uint32_t id,
                               uint64_t version) {
    const struct lw_tile_place *p = &w->map.place[id];
    struct lw_client_level level = lw_client_get_level(client, p->object, p->level);
    assert_int_equal(level.width, w->map.atlas[p->object]->level[p->level].width);
    assert_int_equal(level.height, w->map.atlas[p->object]->level[p->level].height);
    for (uint32_t y = p->y * LW_TILE_SIDE; y < p->y * LW_TILE_SIDE + p->height; y++)
        for (uint32_t x = p->x * LW_TILE_SIDE; x < p->x * LW_TILE_SIDE + p->width; x++)
            for (int c = 0; c < 3; c++) {
                float expected = version ? client_case_value_of(p->object, p->level, x, y, c, version) : 0;
                assert_true(level.rgb[3 * (y * level.width + x) + (uint32_t)c] == expected);
            }
}

void client_case_expect_tile(const struct lw_client *client, const struct client_case_world *w, uint32_t id,
                             uint64_t version) {
    client_case_expect_texels(client, w, id, version);
    assert_int_equal(lw_client_get_tile(client, (lw_tile_id){id}).version, version);
}

void *client_case_serve(void *server) {
    lw_support_ok(lw_server_run(server, NULL), NULL);
    return NULL;
}

struct lw_snapshot *client_case_make_snapshot(const struct client_case_world *w, uint64_t frame) {
    struct lw_snapshot *snapshot;
    uint8_t *payload = malloc(lw_tile_codec_bound());
    lw_support_ok(lw_snapshot_create(w->map.tile_count, 1u << LW_TILE_CHANNEL_FULL, &snapshot), NULL);
    snapshot->frame = frame;
    struct lw_message_transform moved = {.object = 1, .object_to_world = LW_AFFINE_IDENTITY};
    moved.object_to_world.m[1][3] = (float)frame;
    struct lw_message m = {.type = LW_MESSAGE_FRAME,
                           .frame = {.frame = frame,
                                     .time_s = 0.5 * (double)frame,
                                     .solve_ns = 1000000,
                                     .rays_total = 1000 * frame,
                                     .server_cpu_ns = 7 * frame,
                                     .sky = {1, 2, 3},
                                     .transform = &moved,
                                     .transform_count = 1}};
    lw_support_ok(lw_blob_from_message(&m, &snapshot->frame_full), NULL);
    m = (struct lw_message){.type = LW_MESSAGE_SETTLED, .settled.frame = frame};
    lw_support_ok(lw_blob_from_message(&m, &snapshot->settled), NULL);
    for (uint32_t t = 0; t < w->map.tile_count; t++) {
        m = client_case_tile_message(w, t, frame, payload);
        snapshot->tile[LW_TILE_CHANNEL_FULL][t].version = frame;
        lw_support_ok(lw_blob_from_message(&m, &snapshot->tile[LW_TILE_CHANNEL_FULL][t].blob), NULL);
    }
    free(payload);
    return snapshot;
}

void client_case_poll_until_tiles(struct lw_client *client, uint64_t tiles) {
    struct lw_client_stats stats;
    struct lw_error err = {0};
    uint64_t end_ns = lw_clock_ns() + CLIENT_CASE_WAIT_NS;
    do {
        assert_true(lw_clock_ns() < end_ns);
        lw_support_ok(lw_client_poll(client, 100, &err), &err);
        lw_client_get_stats(client, &stats);
    } while (stats.tiles < tiles);
}

struct client_case_running client_case_start_server_with(const struct client_case_world *w,
                                                         struct lw_server_desc desc) {
    struct client_case_running r;
    struct lw_error err = {0};
    desc.host = "127.0.0.1";
    desc.atlas_map = &w->map;
    desc.package = w->package;
    desc.package_size = w->package_size;
    lw_support_ok(lw_server_create(&desc, &r.server, &err), &err);
    assert_int_equal(pthread_create(&r.thread, NULL, client_case_serve, r.server), 0);
    return r;
}

struct client_case_running client_case_start_server(const struct client_case_world *w, uint16_t port) {
    return client_case_start_server_with(w, (struct lw_server_desc){.port = port});
}

void client_case_stop_server(struct client_case_running *r) {
    lw_server_stop(r->server);
    assert_int_equal(pthread_join(r->thread, NULL), 0);
    lw_server_destroy(r->server);
}

void client_case_publish(const struct client_case_running *r, struct lw_snapshot *snapshot) {
    lw_server_publish(r->server, snapshot);
    lw_snapshot_unref(snapshot);
}

void client_case_lose_connection(struct lw_client *client) {
    struct lw_error err = {0};
    enum lw_status status = LW_OK;
    while (status == LW_OK) status = lw_client_poll(client, 1000, &err);
    lw_support_fails(status, LW_CLOSED, &err, "127.0.0.1");
}

unsigned client_case_for_files(const char *folder, const char *suffix,
                               void (*call)(const char *path, void *to), void *to) {
    unsigned count = 0;
    char path[640];
    DIR *open = opendir(folder);
    assert_non_null(open);
    for (struct dirent *entry; (entry = readdir(open));) {
        if (strlen(entry->d_name) < strlen(suffix) ||
            strcmp(entry->d_name + strlen(entry->d_name) - strlen(suffix), suffix) != 0)
            continue;
        snprintf(path, sizeof path, "%s/%s", folder, entry->d_name);
        call(path, to);
        count++;
    }
    closedir(open);
    return count;
}

static void remove_one(const char *path, void *to) {
    (void)to;
    assert_int_equal(unlink(path), 0);
}

unsigned client_case_remove_files(const char *folder, const char *suffix) {
    return client_case_for_files(folder, suffix, remove_one, NULL);
}

void client_case_add_size(const char *path, void *to) {
    size_t size;
    free(lw_support_read_file(path, &size));
    *(size_t *)to += size;
}

void client_case_damage(const char *path, void *to) {
    FILE *f = fopen(path, "r+b");
    const bool cut = *(const bool *)to;
    char byte;
    assert_non_null(f);
    assert_int_equal(fread(&byte, 1, 1, f), 1);
    byte ^= 1;
    rewind(f);
    if (cut)
        assert_int_equal(ftruncate(fileno(f), 0), 0);
    else
        assert_int_equal(fwrite(&byte, 1, 1, f), 1);
    fclose(f);
}

void client_case_say_bytes(struct client_case_script *s, const void *bytes, size_t size) {
    s->bytes = realloc(s->bytes, s->size + size + 1);
    assert_non_null(s->bytes);
    memcpy(s->bytes + s->size, bytes, size);
    s->size += size;
}

void client_case_say(struct client_case_script *s, const struct lw_message *message) {
    uint8_t *bytes;
    size_t size;
    lw_support_ok(lw_message_encode_alloc(message, &bytes, &size), NULL);
    client_case_say_bytes(s, bytes, size);
    free(bytes);
}

struct lw_message client_case_welcome_of(const struct client_case_world *w) {
    struct lw_message m = {.type = LW_MESSAGE_WELCOME,
                           .welcome = {.version = 1,
                                       .name = "script",
                                       .package_size = w->package_size,
                                       .package_compressed_size = w->compressed_size}};
    lw_package_hash(w->package, w->package_size, &m.welcome.package_hash);
    return m;
}

void client_case_say_package(struct client_case_script *s, const struct client_case_world *w) {
    for (size_t at = 0, piece = 7; at < w->compressed_size; at += piece) {
        if (at > 70) piece = w->compressed_size - at;
        if (piece > LW_MESSAGE_CHUNK_MAX) piece = LW_MESSAGE_CHUNK_MAX;
        client_case_say(s, &(struct lw_message){.type = LW_MESSAGE_PACKAGE_CHUNK,
                                                .package_chunk = {at, w->compressed + at, piece}});
    }
}

static void *recite(void *context) {
    struct client_case_script *s = context;
    int peer = accept(s->listener, NULL, NULL);
    for (size_t sent = 0; sent < s->size;) {
        ssize_t n = send(peer, s->bytes + sent, s->size - sent, MSG_NOSIGNAL);
        if (n < 0) break;
        sent += (size_t)n;
    }
    s->said = true;
    uint8_t rest[4096];
    if (s->closes) shutdown(peer, SHUT_WR);
    while (recv(peer, rest, sizeof rest, 0) > 0) {
    }
    close(peer);
    return NULL;
}

void client_case_begin(struct client_case_script *s) {
    struct sockaddr_in address = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    socklen_t size = sizeof address;
    const int on = 1;
    s->listener = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    address.sin_port = htons(s->port); /* 0: any */
    assert_int_equal(setsockopt(s->listener, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on), 0);
    assert_int_equal(bind(s->listener, (struct sockaddr *)&address, size), 0);
    assert_int_equal(listen(s->listener, 1), 0);
    assert_int_equal(getsockname(s->listener, (struct sockaddr *)&address, &size), 0);
    s->port = ntohs(address.sin_port);
    assert_int_equal(pthread_create(&s->thread, NULL, recite, s), 0);
}

void client_case_end(struct client_case_script *s) {
    assert_int_equal(pthread_join(s->thread, NULL), 0);
    close(s->listener);
    free(s->bytes);
    *s = (struct client_case_script){0};
}

void client_case_expect_failure_of(struct client_case_script *s, bool draws, enum lw_status expected,
                                   const char *text, bool created) {
    struct lw_client *client = NULL;
    struct lw_error err = {0};
    client_case_begin(s);
    uint64_t end_ns = lw_clock_ns() + CLIENT_CASE_WAIT_NS;
    enum lw_status status = lw_client_create(
        &(struct lw_client_desc){
            .host = "127.0.0.1", .port = s->port, .timeout_ms = 400, .draws_direct = draws},
        &client, &err);
    assert_int_equal(client != NULL, created);
    while (status == LW_OK) {
        assert_true(lw_clock_ns() < end_ns);
        status = lw_client_poll(client, 100, &err);
    }
    lw_support_fails(status, expected, &err, text);
    assert_non_null(strstr(err.text, "127.0.0.1:"));
    lw_client_destroy(client);
    client_case_end(s);
}

void client_case_expect_failure(struct client_case_script *s, enum lw_status expected, const char *text,
                                bool created) {
    client_case_expect_failure_of(s, false, expected, text, created);
}

void client_case_say_all_light(struct client_case_script *s, const struct client_case_world *w,
                               uint64_t version) {
    uint8_t *payload = malloc(lw_tile_codec_bound());
    client_case_say(s, &(struct lw_message){.type = LW_MESSAGE_FRAME, .frame = {.frame = 1}});
    for (uint32_t t = 0; t < w->map.tile_count; t++) {
        const struct lw_message tile = client_case_tile_message(w, t, version, payload);
        client_case_say(s, &tile);
    }
    free(payload);
}
