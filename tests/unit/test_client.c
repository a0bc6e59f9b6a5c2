#include "tests/support/support.h"

#include "client/lib/client.h"
#include "client/lib/link.h"
#include "client/lib/package_cache.h"
#include "client/lib/replica.h"
#include "common/clock.h"
#include "common/scene/finish_package.h"
#include "common/scene/scene_spares.h"
#include "common/tile/tile_codec.h"
#include "server/serve/server.h"

#include <arpa/inet.h>
#include <dirent.h>
#include <netinet/in.h>
#include <poll.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>
#include <zstd.h>

#define WAIT_NS 600000000000u /* ends what hangs */
#define SCALE   4.0f

/* ---- a scene, its package and messages about it ---- */

struct world {
    struct lw_scene *scene;
    struct lw_atlas_map map;
    uint8_t *package, *compressed;
    size_t package_size, compressed_size;
    struct lw_tile_codec *codec;
};

static struct world make_world_with(const char *spares) {
    struct world w = {.scene = lw_support_everything()};
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

static struct world make_world(void) { return make_world_with(NULL); }

static void finish_world(struct world *w) {
    lw_tile_codec_destroy(w->codec);
    free(w->package);
    free(w->compressed);
    lw_atlas_map_finish(&w->map);
    lw_scene_destroy(w->scene);
}

/* What texel (x, y) of a level holds in version `version`: exact in half floats over SCALE. */
static float value_of(uint32_t object, uint32_t level, uint32_t x, uint32_t y, int channel,
                      uint64_t version) {
    return SCALE * (float)((object * 5 + level * 3 + x + 2 * y + (uint32_t)channel + version) % 64);
}

/* payload: lw_tile_codec_bound() bytes. */
static struct lw_message tile_message(const struct world *w, uint32_t id, uint64_t version,
                                      uint8_t *payload) {
    static float rgb[LW_TILE_TEXELS_MAX * 3];
    const struct lw_tile_place *p = &w->map.place[id];
    for (uint32_t y = 0; y < p->height; y++)
        for (uint32_t x = 0; x < p->width; x++)
            for (int c = 0; c < 3; c++)
                rgb[3 * (y * p->width + x) + (uint32_t)c] = value_of(
                    p->object, p->level, p->x * LW_TILE_SIDE + x, p->y * LW_TILE_SIDE + y, c, version);
    struct lw_message m = {.type = LW_MESSAGE_TILE,
                           .tile = {.object = p->object,
                                    .level = p->level,
                                    .tile = p->y * w->map.atlas[p->object].level[p->level].tiles_x + p->x,
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

static void expect_texels(const struct lw_client *client, const struct world *w, uint32_t id,
                          uint64_t version) {
    const struct lw_tile_place *p = &w->map.place[id];
    struct lw_client_level level = lw_client_get_level(client, p->object, p->level);
    assert_int_equal(level.width, w->map.atlas[p->object].level[p->level].width);
    assert_int_equal(level.height, w->map.atlas[p->object].level[p->level].height);
    for (uint32_t y = p->y * LW_TILE_SIDE; y < p->y * LW_TILE_SIDE + p->height; y++)
        for (uint32_t x = p->x * LW_TILE_SIDE; x < p->x * LW_TILE_SIDE + p->width; x++)
            for (int c = 0; c < 3; c++) {
                float expected = version ? value_of(p->object, p->level, x, y, c, version) : 0;
                assert_true(level.rgb[3 * (y * level.width + x) + (uint32_t)c] == expected);
            }
}

static void expect_tile(const struct lw_client *client, const struct world *w, uint32_t id,
                        uint64_t version) {
    expect_texels(client, w, id, version);
    assert_int_equal(lw_client_get_tile(client, (lw_tile_id){id}).version, version);
}

/* ---- against our own server ---- */

static void *serve(void *server) {
    lw_support_ok(lw_server_run(server, NULL), NULL);
    return NULL;
}

#define SPLIT_OFF 10u /* versions, by which the light of split tiles looks newer than it is */

/* Adds split tiles, which hold other light. */
static struct lw_snapshot *add_split(const struct world *w, struct lw_snapshot *snapshot) {
    uint8_t *payload = malloc(lw_tile_codec_bound());
    snapshot->channels |= 1u << LW_LIGHT_FORM_SPLIT;
    snapshot->tile[LW_LIGHT_FORM_SPLIT] = calloc(w->map.tile_count, sizeof(struct lw_snapshot_tile));
    for (uint32_t t = 0; t < w->map.tile_count; t++) {
        struct lw_snapshot_tile *tile = &snapshot->tile[LW_LIGHT_FORM_SPLIT][t];
        struct lw_message m = tile_message(w, t, snapshot->frame + SPLIT_OFF, payload);
        m.tile.layer = LW_LIGHT_FORM_SPLIT;
        m.tile.version = tile->version = snapshot->frame;
        lw_support_ok(lw_blob_from_message(&m, &tile->blob), NULL);
    }
    free(payload);
    return snapshot;
}

static struct lw_snapshot *make_snapshot(const struct world *w, uint64_t frame) {
    struct lw_snapshot *snapshot;
    uint8_t *payload = malloc(lw_tile_codec_bound());
    lw_support_ok(lw_snapshot_create(w->map.tile_count, 1u << LW_LIGHT_FORM_FULL, &snapshot), NULL);
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
        m = tile_message(w, t, frame, payload);
        snapshot->tile[LW_LIGHT_FORM_FULL][t].version = frame;
        lw_support_ok(lw_blob_from_message(&m, &snapshot->tile[LW_LIGHT_FORM_FULL][t].blob), NULL);
    }
    free(payload);
    return snapshot;
}

static void poll_until_tiles(struct lw_client *client, uint64_t tiles) {
    struct lw_client_stats stats;
    struct lw_error err = {0};
    uint64_t end_ns = lw_clock_ns() + WAIT_NS;
    do {
        assert_true(lw_clock_ns() < end_ns);
        lw_support_ok(lw_client_poll(client, 100, &err), &err);
        lw_client_get_stats(client, &stats);
    } while (stats.tiles < tiles);
}

struct running {
    struct lw_server *server;
    pthread_t thread;
};

/* desc: beside the address and the world. */
static struct running start_server_with(const struct world *w, struct lw_server_desc desc) {
    struct running r;
    struct lw_error err = {0};
    desc.host = "127.0.0.1";
    desc.atlas_map = &w->map;
    desc.package = w->package;
    desc.package_size = w->package_size;
    lw_support_ok(lw_server_create(&desc, &r.server, &err), &err);
    assert_int_equal(pthread_create(&r.thread, NULL, serve, r.server), 0);
    return r;
}

static struct running start_server(const struct world *w, uint16_t port) {
    return start_server_with(w, (struct lw_server_desc){.port = port});
}

static void stop_server(struct running *r) {
    lw_server_stop(r->server);
    assert_int_equal(pthread_join(r->thread, NULL), 0);
    lw_server_destroy(r->server);
}

static void test_session(void **state) {
    (void)state;
    struct world w = make_world();
    struct lw_server *server;
    struct lw_error err = {0};
    pthread_t thread;
    struct lw_server_desc desc = {.host = "127.0.0.1",
                                  .atlas_map = &w.map,
                                  .package = w.package,
                                  .package_size = w.package_size,
                                  .bounces = 3,
                                  .target_error = 0.25f,
                                  .noise_shown = 0.5f};
    lw_support_ok(lw_server_create(&desc, &server, &err), &err);
    assert_int_equal(pthread_create(&thread, NULL, serve, server), 0);

    struct lw_client *client;
    uint64_t before_ns = lw_clock_ns();
    lw_support_ok(
        lw_client_create(
            &(struct lw_client_desc){.host = "127.0.0.1", .port = lw_server_port(server), .name = "test"},
            &client, &err),
        &err);
    print_message("handshake on loopback: %.3f ms\n", 1e-6 * (double)(lw_clock_ns() - before_ns));
    assert_true(lw_client_descriptor(client) >= 0);
    while (!lw_client_scene(client)) lw_support_ok(lw_client_poll(client, 100, &err), &err);
    assert_true(lw_client_package_progress(client) == 1);
    assert_int_equal(lw_client_scene(client)->object_count, w.scene->object_count);
    assert_int_equal(lw_client_atlas_map(client)->tile_count, w.map.tile_count);
    assert_null(lw_client_object_to_world(client, w.scene->object_count));
    for (uint32_t t = 0; t < w.map.tile_count; t++) expect_tile(client, &w, t, 0); /* zeros, not garbage */

    for (uint64_t frame = 1; frame <= 3; frame += 2) {
        struct lw_snapshot *snapshot = make_snapshot(&w, frame);
        lw_server_publish(server, snapshot);
        lw_snapshot_unref(snapshot);
        poll_until_tiles(client, (frame + 1) / 2 * w.map.tile_count);
        for (uint32_t t = 0; t < w.map.tile_count; t++) expect_tile(client, &w, t, frame);
        assert_true(lw_client_object_to_world(client, 1)->m[1][3] == (float)frame);
        struct lw_client_stats stats;
        do {
            lw_support_ok(lw_client_poll(client, 100, &err), &err);
            lw_client_get_stats(client, &stats);
        } while (stats.settled_frame != frame); /* it comes behind the tiles */
        assert_int_equal(stats.frame, frame);
        assert_int_equal(stats.frames, (frame + 1) / 2);
        assert_int_equal(stats.rays_total, 1000 * frame);
        assert_int_equal(stats.server_cpu_ns, 7 * frame);
        assert_true(stats.decode_ns > 0);
        assert_int_equal(stats.bounces, 3);
        assert_true(stats.target_error == 0.25f && stats.noise_shown == 0.5f);
        assert_true(stats.time_s == 0.5 * (double)frame && stats.sky[2] == 3);
        assert_true(stats.light_age_ns >= 1000000 && stats.light_age_ns < WAIT_NS);
        assert_true(before_ns <= stats.connected_ns && stats.connected_ns <= stats.package_ns &&
                    stats.package_ns <= stats.first_ns);
        assert_true(stats.bytes > w.compressed_size);
    }
    struct lw_client_tile tile = lw_client_get_tile(client, (lw_tile_id){0});
    assert_true(tile.bounces == 2 && tile.error == 0.5f);
    assert_int_equal(lw_client_get_tile(client, (lw_tile_id){w.map.tile_count}).version, 0);
    assert_int_equal(lw_client_get_level(client, 0, LW_ATLAS_LEVELS_MAX).width, 0);
    assert_int_equal(lw_client_get_level(client, w.scene->object_count, 0).width, 0);
    lw_support_ok(lw_client_poll(client, 0, &err), &err); /* nothing there: returns at once */

    lw_server_stop(server);
    enum lw_status status = LW_OK;
    while (status == LW_OK) status = lw_client_poll(client, 1000, &err);
    lw_support_fails(status, LW_CLOSED, &err, "ended the session: the server ends");
    expect_tile(client, &w, 0, 3); /* what was received stays readable */
    lw_client_destroy(client);
    lw_client_destroy(NULL);
    assert_int_equal(pthread_join(thread, NULL), 0);
    lw_server_destroy(server);
    finish_world(&w);
}

/* A snapshot whose frame hides object 0, paints material 0 and sets another sky. */
static struct lw_snapshot *make_changed_snapshot(const struct world *w, uint64_t frame) {
    static const uint32_t hidden[] = {0};
    static const struct lw_message_material material[] = {{0, {0.25f, 0.5f, 0.75f}, {4, 5, 6}}};
    struct lw_snapshot *snapshot = make_snapshot(w, frame);
    lw_blob_unref(snapshot->frame_full);
    const struct lw_message m = {.type = LW_MESSAGE_FRAME,
                                 .frame = {.frame = frame,
                                           .sky = {7, 8, 9},
                                           .hidden = hidden,
                                           .hidden_count = 1,
                                           .material = material,
                                           .material_count = 1}};
    lw_support_ok(lw_blob_from_message(&m, &snapshot->frame_full), NULL);
    return snapshot;
}

static struct lw_client_answer await_answer(struct lw_client *client) {
    struct lw_client_answer answer = {0};
    struct lw_error err = {0};
    const uint64_t end_ns = lw_clock_ns() + WAIT_NS;
    while (!lw_client_next_answer(client, &answer)) {
        assert_true(lw_clock_ns() < end_ns);
        lw_support_ok(lw_client_poll(client, 100, &err), &err);
    }
    return answer;
}

static void test_updates(void **state) {
    (void)state;
    struct world w = make_world();
    struct lw_client *client, *other;
    struct lw_error err = {0};
    struct running r =
        start_server_with(&w, (struct lw_server_desc){.scene = w.scene, .control_socket = "auto"});
    struct lw_server *server = r.server;
    struct lw_client_desc desc = {.host = "127.0.0.1", .port = lw_server_port(server), .control = true};
    lw_support_ok(lw_client_create(&desc, &client, &err), &err);
    while (!lw_client_scene(client)) lw_support_ok(lw_client_poll(client, 100, &err), &err);
    desc.control = false;
    desc.scene_of = client;
    lw_support_ok(lw_client_create(&desc, &other, &err), &err);
    assert_true(lw_client_may_update(client));
    assert_false(lw_client_may_update(other));
    lw_support_fails(lw_client_update(other, NULL, 0, NULL, &err), LW_UNAVAILABLE, &err, "takes no updates");
    static struct lw_scene_change many[LW_CLIENT_CHANGES_MAX + 1];
    for (size_t i = 0; i <= LW_CLIENT_CHANGES_MAX; i++)
        many[i] = (struct lw_scene_change){.kind = LW_SCENE_CHANGE_OBJECT_TRANSFORM, .value_count = 12};
    err = (struct lw_error){0};
    lw_support_fails(lw_client_update(client, many, LW_CLIENT_CHANGES_MAX + 1, NULL, &err), LW_USAGE, &err,
                     "at most 1024 changes");
    struct lw_scene_change wide = {.value_count = LW_SCENE_CHANGE_VALUES_MAX + 1};
    err = (struct lw_error){0};
    lw_support_fails(lw_client_update(client, &wide, 1, NULL, &err), LW_USAGE, &err, "at most 12 values");

    uint64_t request = 0;
    err = (struct lw_error){0};
    lw_support_ok(lw_client_update(client, many, LW_CLIENT_CHANGES_MAX, &request, &err), &err);
    assert_int_equal(request, 1);
    struct lw_client_answer answer = await_answer(client); /* the largest message there is; scaled to 0 */
    assert_int_equal(answer.request, 1);
    assert_int_equal(answer.code, LW_SCENE_CHANGE_DEGENERATE);
    assert_int_equal(answer.frame, 0);
    assert_non_null(strstr(answer.text, "OBJECT_TRANSFORM 0"));
    const struct lw_scene_change hide = {.kind = LW_SCENE_CHANGE_OBJECT_HIDE};
    lw_support_ok(lw_client_update(client, &hide, 1, &request, &err), &err);
    struct lw_scene_change *taken = NULL;
    size_t count = 0;
    for (uint64_t end_ns = lw_clock_ns() + WAIT_NS; count == 0;) {
        assert_true(lw_clock_ns() < end_ns);
        free(taken);
        (void)lw_server_take_updates(server, 5, &taken, &count);
    }
    assert_memory_equal(taken, &hide, sizeof hide);
    free(taken);
    const struct lw_material before = w.scene->material[0];
    assert_memory_equal(lw_client_scene(client)->material[0].base_colour, before.base_colour,
                        sizeof before.base_colour);
    assert_false(lw_client_object_hidden(client, 0));
    struct lw_snapshot *snapshot = make_changed_snapshot(&w, 5);
    lw_server_publish(server, snapshot);
    lw_snapshot_unref(snapshot);
    answer = await_answer(client);
    assert_true(answer.request == request && answer.code == LW_SCENE_CHANGE_OK && answer.frame == 5);
    struct lw_client_stats stats;
    lw_client_get_stats(client, &stats);
    assert_true(stats.frame == 5 && stats.changed_frame == 5); /* it came before the answer */
    const struct lw_scene *now = lw_client_scene(client);
    assert_true(lw_client_object_hidden(client, 0) && !lw_client_object_hidden(client, 1));
    assert_false(lw_client_object_hidden(client, UINT32_MAX));
    assert_true(now->material[0].base_colour[2] == 0.75f && now->material[0].emission[1] == 5);
    assert_true(now->material[0].base_colour[3] == before.base_colour[3] && now->sky[0] == 7);
    const struct lw_vec3 own = lw_client_own_emission(client, 0); /* what the scene has stays known */
    assert_true(own.x == before.emission[0] && own.y == before.emission[1] && own.z == before.emission[2]);
    assert_true(before.emission[1] != 5 && lw_client_own_emission(client, UINT32_MAX).x == 0);
    assert_true(lw_client_scene(other)->material[0].base_colour[2] ==
                before.base_colour[2]); /* not polled yet */
    assert_true(lw_client_get_light(client, UINT32_MAX).intensity.x == 0);
    lw_client_destroy(other);
    lw_client_destroy(client);
    stop_server(&r);
    finish_world(&w);
}

/* ---- coming back ---- */

static void publish(const struct running *r, struct lw_snapshot *snapshot) {
    lw_server_publish(r->server, snapshot);
    lw_snapshot_unref(snapshot);
}

static void lose_connection(struct lw_client *client) {
    struct lw_error err = {0};
    enum lw_status status = LW_OK;
    while (status == LW_OK) status = lw_client_poll(client, 1000, &err);
    lw_support_fails(status, LW_CLOSED, &err, "127.0.0.1");
}

/* A frame in which tile 0 alone has changed. */
static struct lw_snapshot *make_next_snapshot(const struct world *w, const struct lw_snapshot *before) {
    struct lw_snapshot *snapshot = make_snapshot(w, before->frame + 1);
    for (uint32_t t = 1; t < w->map.tile_count; t++) {
        lw_blob_unref(snapshot->tile[LW_LIGHT_FORM_FULL][t].blob);
        snapshot->tile[LW_LIGHT_FORM_FULL][t] = before->tile[LW_LIGHT_FORM_FULL][t];
        lw_blob_ref(snapshot->tile[LW_LIGHT_FORM_FULL][t].blob);
    }
    return snapshot;
}

/* What a server says of an object that is added while a client looks on. */
static struct lw_snapshot *make_spare_snapshot(const struct world *w, uint64_t frame, uint32_t object,
                                               bool spare, uint64_t coarsest) {
    struct lw_snapshot *snapshot = make_snapshot(w, frame);
    const struct lw_message m = {.type = LW_MESSAGE_FRAME,
                                 .frame = {.frame = frame,
                                           .hidden = &object,
                                           .hidden_count = spare,
                                           .spare_count = spare,
                                           .shown = &object,
                                           .shown_count = !spare}};
    lw_blob_unref(snapshot->frame_full);
    lw_support_ok(lw_blob_from_message(&m, &snapshot->frame_full), NULL);
    uint8_t *payload = malloc(lw_tile_codec_bound());
    for (uint32_t t = 0; t < w->map.tile_count;
         t++) { /* of it nothing has come but the coarsest level, long ago */
        if (w->map.place[t].object != object) continue;
        const struct lw_message tile = tile_message(w, t, coarsest, payload);
        snapshot->tile[LW_LIGHT_FORM_FULL][t].version = coarsest;
        lw_blob_unref(snapshot->tile[LW_LIGHT_FORM_FULL][t].blob);
        lw_support_ok(lw_blob_from_message(&tile, &snapshot->tile[LW_LIGHT_FORM_FULL][t].blob), NULL);
    }
    free(payload);
    return snapshot;
}

static void test_spares(void **state) {
    (void)state;
    struct world w = make_world_with("#0=1");
    const uint32_t spare = w.scene->object_count - 1;
    struct running r = start_server(&w, 0);
    struct lw_client *client;
    struct lw_client_stats stats = {0};
    struct lw_error err = {0};
    assert_true(w.map.atlas[spare].level_count > 0);
    lw_support_ok(
        lw_client_create(&(struct lw_client_desc){.host = "127.0.0.1", .port = lw_server_port(r.server)},
                         &client, &err),
        &err);
    assert_int_equal(lw_client_object_state(client, 0), LW_CLIENT_OBJECT_SPARE);
    while (!lw_client_scene(client)) lw_support_ok(lw_client_poll(client, 100, &err), &err);
    assert_int_equal(lw_client_object_state(client, 0), LW_CLIENT_OBJECT_SHOWN); /* as the package has it */
    assert_int_equal(lw_client_object_state(client, spare), LW_CLIENT_OBJECT_SPARE);
    assert_int_equal(lw_client_object_state(client, spare + 1), LW_CLIENT_OBJECT_SPARE);
    assert_true(lw_client_object_hidden(client, spare));
    publish(&r, make_spare_snapshot(&w, 1, spare, true, 1));
    while (stats.settled_frame < 1) {
        lw_support_ok(lw_client_poll(client, 100, &err), &err);
        lw_client_get_stats(client, &stats);
    }
    assert_true(lw_client_object_hidden(client, spare));
    publish(&r, make_spare_snapshot(&w, 2, spare, false, 1)); /* no light of it yet */
    while (stats.settled_frame < 2) {
        lw_support_ok(lw_client_poll(client, 100, &err), &err);
        lw_client_get_stats(client, &stats);
    }
    assert_int_equal(lw_client_object_state(client, spare), LW_CLIENT_OBJECT_SHOWN);
    assert_true(lw_client_object_hidden(client, spare));
    publish(&r, make_spare_snapshot(&w, 3, spare, false, 3));
    while (stats.settled_frame < 3) {
        lw_support_ok(lw_client_poll(client, 100, &err), &err);
        lw_client_get_stats(client, &stats);
    }
    assert_false(lw_client_object_hidden(client, spare));
    lw_client_destroy(client);
    stop_server(&r);
    finish_world(&w);
}

static void test_reconnect(void **state) {
    (void)state;
    struct world w = make_world();
    struct lw_client *client;
    struct lw_client_stats stats;
    struct lw_error err = {0};
    struct running r = start_server(&w, 0);
    const uint16_t port = lw_server_port(r.server);
    struct lw_snapshot *seventh = make_snapshot(&w, 7);
    lw_snapshot_ref(seventh);
    publish(&r, seventh);
    lw_support_ok(
        lw_client_create(&(struct lw_client_desc){.host = "127.0.0.1", .port = port}, &client, &err), &err);
    poll_until_tiles(client, w.map.tile_count);
    const struct lw_scene *scene = lw_client_scene(client);

    /* the link breaks: nothing of what is here is sent again */
    assert_int_equal(shutdown(lw_client_descriptor(client), SHUT_RDWR), 0);
    lose_connection(client);
    lw_support_ok(lw_client_reconnect(client, &err), &err);
    publish(&r, make_next_snapshot(&w, seventh));
    lw_snapshot_unref(seventh);
    poll_until_tiles(client, w.map.tile_count + 1);
    lw_support_ok(lw_client_poll(client, 100, &err), &err);
    lw_client_get_stats(client, &stats);
    assert_int_equal(stats.tiles, w.map.tile_count + 1);
    expect_tile(client, &w, 0, 8);
    expect_tile(client, &w, 1, 7);

    /* the server starts again: its light replaces the old, however small its numbers are */
    stop_server(&r);
    lose_connection(client);
    lw_support_fails(lw_client_reconnect(client, &err), LW_UNAVAILABLE, &err, "is lightwelld running?");
    err = (struct lw_error){0};
    r = start_server(&w, port);
    lw_support_ok(lw_client_reconnect(client, &err), &err);
    expect_tile(client, &w, 1, 7);                        /* until then it stays */
    lw_support_ok(lw_client_poll(client, 0, &err), &err); /* there is no frame to say anything of */
    publish(&r, make_snapshot(&w, 2));
    poll_until_tiles(client, 2 * w.map.tile_count + 1);
    for (uint32_t t = 0; t < w.map.tile_count; t++) {
        expect_texels(client, &w, t, 2);
        assert_int_equal(lw_client_get_tile(client, (lw_tile_id){t}).version, 8 + 2);
    }
    lw_client_get_stats(client, &stats);
    assert_int_equal(stats.frame, 2);
    assert_ptr_equal(lw_client_scene(client), scene);

    /* and a third time, within that run */
    assert_int_equal(shutdown(lw_client_descriptor(client), SHUT_RDWR), 0);
    lose_connection(client);
    lw_support_ok(lw_client_reconnect(client, &err), &err);
    publish(&r, make_snapshot(&w, 3));
    poll_until_tiles(client, 3 * w.map.tile_count + 1);
    expect_texels(client, &w, 0, 3);

    /* another scene needs another client */
    stop_server(&r);
    lose_connection(client);
    w.package[w.package_size - 1] ^= 1;
    r = start_server(&w, port);
    lw_support_fails(lw_client_reconnect(client, &err), LW_BAD_DATA, &err, "another scene");
    expect_texels(client, &w, 0, 3);
    lw_client_destroy(client);
    stop_server(&r);
    finish_world(&w);
}

static const uint8_t drawn_lights[] = {1}, drawn_materials[] = {2};

static struct running start_drawn(const struct world *w, uint16_t port) {
    return start_server_with(w, (struct lw_server_desc){.port = port,
                                                        .client_lights = drawn_lights,
                                                        .client_lights_size = 1,
                                                        .client_materials = drawn_materials,
                                                        .client_materials_size = 1});
}

/* A client that draws gets the other form, beside one that does not; nothing of one form stands in for the
 * other. */
static void test_draws(void **state) {
    (void)state;
    struct world w = make_world();
    struct lw_client *plain, *client;
    struct lw_client_stats stats;
    struct lw_error err = {0};
    assert_true(w.scene->light_count >= 1 && w.scene->material_count >= 2);
    struct running r = start_drawn(&w, 0);
    const uint16_t port = lw_server_port(r.server);
    struct lw_snapshot *seventh = make_snapshot(&w, 7);
    publish(&r, lw_snapshot_ref(seventh));
    struct lw_client_desc desc = {.host = "127.0.0.1", .port = port};
    lw_support_ok(lw_client_create(&desc, &plain, &err), &err);
    desc.draws_direct = true;
    lw_support_ok(lw_client_create(&desc, &client, &err), &err);
    assert_null(lw_client_draws(client)); /* of which scene? */
    poll_until_tiles(plain, w.map.tile_count);
    assert_null(lw_client_draws(plain));
    while (!lw_client_scene(client)) lw_support_ok(lw_client_poll(client, 100, &err), &err);
    const struct lw_client_draws *draws = lw_client_draws(client);
    assert_int_equal(draws->light_count, w.scene->light_count);
    assert_int_equal(draws->material_count, w.scene->material_count);
    for (uint32_t i = 0; i < draws->light_count; i++) assert_int_equal(draws->light[i], i == 0);
    for (uint32_t i = 0; i < draws->material_count; i++) assert_int_equal(draws->material[i], i == 1);
    lw_support_ok(lw_client_poll(client, 20, &err), &err);
    lw_client_get_stats(client, &stats);
    assert_int_equal(stats.frame, 0); /* nobody took this form before */
    struct lw_snapshot *eighth = add_split(&w, make_snapshot(&w, 8));
    publish(&r, lw_snapshot_ref(eighth));
    poll_until_tiles(client, w.map.tile_count);
    poll_until_tiles(plain, 2 * w.map.tile_count);
    for (uint32_t t = 0; t < w.map.tile_count; t++) {
        expect_texels(client, &w, t, 8 + SPLIT_OFF);
        expect_tile(plain, &w, t, 8);
    }
    /* the link breaks: nothing of what is here is sent again, though the other form had version 7 too */
    assert_int_equal(shutdown(lw_client_descriptor(client), SHUT_RDWR), 0);
    lose_connection(client);
    lw_support_ok(lw_client_reconnect(client, &err), &err);
    assert_non_null(lw_client_draws(client));
    lw_support_ok(lw_client_poll(client, 100, &err), &err);
    lw_support_ok(lw_client_poll(client, 100, &err), &err);
    lw_client_get_stats(client, &stats);
    assert_int_equal(stats.tiles, w.map.tile_count);
    /* a server that has no client lights: what is there lacks what nobody draws now */
    stop_server(&r);
    lose_connection(client);
    r = start_server(&w, port);
    lw_support_ok(lw_client_reconnect(client, &err), &err);
    assert_null(lw_client_draws(client));
    for (uint32_t t = 0; t < w.map.tile_count; t++) expect_tile(client, &w, t, 0);
    publish(&r, make_snapshot(&w, 2));
    poll_until_tiles(client, 2 * w.map.tile_count);
    for (uint32_t t = 0; t < w.map.tile_count; t++) {
        expect_texels(client, &w, t, 2);
        assert_true(lw_client_get_tile(client, (lw_tile_id){t}).version > 8); /* they go on growing */
    }
    lw_snapshot_unref(seventh);
    lw_snapshot_unref(eighth);
    lw_client_destroy(client);
    lw_client_destroy(plain);
    stop_server(&r);
    finish_world(&w);
}

/* Every other tile is as it was in frame 1. */
static struct lw_snapshot *change_half(const struct world *w, const struct lw_snapshot *first,
                                       uint64_t frame) {
    struct lw_snapshot *snapshot = make_snapshot(w, frame);
    for (uint32_t t = 1; t < w->map.tile_count; t += 2) {
        lw_blob_unref(snapshot->tile[LW_LIGHT_FORM_FULL][t].blob);
        snapshot->tile[LW_LIGHT_FORM_FULL][t] = (struct lw_snapshot_tile){
            .version = 1, .blob = lw_blob_ref(first->tile[LW_LIGHT_FORM_FULL][t].blob)};
    }
    return snapshot;
}

/* A client that reads nothing for longer than the server waits is closed; it comes back and gets what has
 * changed, not what it has. */
static void test_who_stopped_reading_comes_back(void **state) {
    (void)state;
    struct world w = make_world();
    struct lw_server_stats served;
    struct lw_client_stats before, after;
    struct lw_client *client;
    struct lw_error err = {0};
    struct running r = start_server_with(
        &w, (struct lw_server_desc){.bounces = 3, .target_error = 0.25f, .stall_timeout_ms = 300});
    struct lw_server *server = r.server;
    struct lw_snapshot *first = make_snapshot(&w, 1);
    lw_server_publish(server, first);
    lw_support_ok(
        lw_client_create(&(struct lw_client_desc){.host = "127.0.0.1", .port = lw_server_port(server)},
                         &client, &err),
        &err);
    const int little = 1;
    assert_int_equal(setsockopt(lw_client_descriptor(client), SOL_SOCKET, SO_RCVBUF, &little, sizeof little),
                     0);
    poll_until_tiles(client, w.map.tile_count);
    uint64_t frame = 1;
    const uint64_t end_ns = lw_clock_ns() + WAIT_NS;
    do { /* nobody polls */
        struct lw_snapshot *snapshot = change_half(&w, first, ++frame);
        lw_server_publish(server, snapshot);
        lw_snapshot_unref(snapshot);
        lw_support_pause();
        lw_server_get_stats(server, &served);
    } while (served.sessions_now);
    while (lw_client_poll(client, 100, &err) == LW_OK) assert_true(lw_clock_ns() < end_ns);
    lw_client_get_stats(client, &before);
    err = (struct lw_error){0};
    lw_support_ok(lw_client_reconnect(client, &err), &err);
    do {
        assert_true(lw_clock_ns() < end_ns);
        lw_support_ok(lw_client_poll(client, 100, &err), &err);
        lw_client_get_stats(client, &after);
    } while (after.settled_frame < frame);
    assert_int_equal(after.tiles - before.tiles, (w.map.tile_count + 1) / 2);
    for (uint32_t t = 0; t < w.map.tile_count; t++) expect_tile(client, &w, t, t % 2 ? 1 : frame);
    lw_client_destroy(client);
    lw_snapshot_unref(first);
    stop_server(&r);
    finish_world(&w);
}

/* Waits for the scene and returns the bytes that it took. */
static uint64_t fetch_scene(const struct running *r, const char *folder, uint32_t objects) {
    struct lw_client *client;
    struct lw_client_stats stats;
    struct lw_error err = {0};
    lw_support_ok(lw_client_create(&(struct lw_client_desc){.host = "127.0.0.1",
                                                            .port = lw_server_port(r->server),
                                                            .cache_folder = folder},
                                   &client, &err),
                  &err);
    while (!lw_client_scene(client)) lw_support_ok(lw_client_poll(client, 100, &err), &err);
    assert_int_equal(lw_client_scene(client)->object_count, objects);
    lw_client_get_stats(client, &stats);
    assert_true(stats.package_ns > 0);
    lw_client_destroy(client);
    return stats.bytes;
}

/* Calls back for the files of a folder whose names end so; returns how many. */
static unsigned for_files(const char *folder, const char *suffix, void (*call)(const char *path, void *to),
                          void *to) {
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

static unsigned remove_files(const char *folder, const char *suffix) {
    return for_files(folder, suffix, remove_one, NULL);
}

static void add_size(const char *path, void *to) {
    size_t size;
    free(lw_support_read_file(path, &size));
    *(size_t *)to += size;
}

static void damage(const char *path, void *to) {
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

/* What is fetched is kept, nothing of it twice, and not fetched again unless it is damaged. */
static void test_cache(void **state) {
    (void)state;
    struct world w = make_world();
    struct running r = start_server(&w, 0);
    char folder[256];
    snprintf(folder, sizeof folder, "%s", lw_support_temporary("cache"));
    const uint32_t objects = w.scene->object_count, parts = w.scene->texture_count + 1;
    const uint64_t whole = fetch_scene(&r, NULL, objects);
    assert_true(whole > w.compressed_size && parts > 1);
    assert_int_equal(fetch_scene(&r, folder, objects), whole); /* and keeps it */
    size_t size = 0;
    assert_int_equal(for_files(folder, ".lwpart", add_size, &size), parts);
    assert_int_equal(size, w.package_size);
    assert_int_equal(remove_files(folder, ".lwscene"), 0);
    const uint64_t nothing = fetch_scene(&r, folder, objects); /* but the hashes of its parts */
    assert_true(nothing < whole - w.compressed_size + 100);
    for (int cut = 0; cut < 2; cut++) { /* damaged, or cut off: downloaded once more, and whole again */
        assert_int_equal(for_files(folder, ".lwpart", damage, &(bool){cut}), parts);
        assert_int_equal(fetch_scene(&r, folder, objects), whole);
        assert_int_equal(fetch_scene(&r, folder, objects), nothing);
    }
    assert_int_equal(remove_files(folder, ".lwpart"), parts);
    rmdir(folder);
    /* nowhere to keep it */
    assert_int_equal(fetch_scene(&r, "/dev/null/cache", objects), whole);
    stop_server(&r);
    finish_world(&w);
}

/* A package in one piece serves too, under the hash that it has. */
static void test_a_package_in_the_cache(void **state) {
    (void)state;
    struct world w = make_world();
    struct running r = start_server(&w, 0);
    struct lw_package_hash hash;
    struct lw_error err = {0};
    char folder[256];
    snprintf(folder, sizeof folder, "%s", lw_support_temporary("package"));
    lw_package_hash(w.package, w.package_size, &hash);
    lw_support_ok(
        lw_package_cache_write(folder, LW_PACKAGE_CACHE_PACKAGE, &hash, w.package, w.package_size, &err),
        &err);
    assert_true(fetch_scene(&r, folder, w.scene->object_count) < 400);
    assert_int_equal(remove_files(folder, ".lwpart"), 0);
    assert_int_equal(remove_files(folder, ".lwscene"), 1);
    rmdir(folder);
    stop_server(&r);
    finish_world(&w);
}

/* Textures that came with another package are not sent, nor what else of it is the same. */
static void test_parts(void **state) {
    (void)state;
    struct world w = make_world(), other = make_world_with("3");
    char folder[256];
    snprintf(folder, sizeof folder, "%s", lw_support_temporary("parts"));
    assert_true(w.scene->texture_count > 1 && other.scene->object_count > w.scene->object_count);
    struct running r = start_server(&w, 0);
    (void)fetch_scene(&r, folder, w.scene->object_count);
    stop_server(&r);
    r = start_server(&other, 0);
    const uint64_t other_whole = fetch_scene(&r, NULL, other.scene->object_count);
    assert_true(fetch_scene(&r, folder, other.scene->object_count) < other_whole);
    assert_int_equal(remove_files(folder, ".lwpart"), w.scene->texture_count + 2);
    rmdir(folder);
    stop_server(&r);
    finish_world(&other);
    finish_world(&w);
}

/* ---- finishes ---- */

static uint8_t *write_finishes(const struct world *w, struct lw_server_desc *desc) {
    uint8_t *bytes;
    lw_support_ok(lw_finish_package_write(w->scene, &bytes, &desc->finishes_size, NULL), NULL);
    desc->finishes = bytes;
    return bytes;
}

static uint8_t *add_finishes(struct world *w, struct lw_server_desc *desc) {
    lw_support_add_finishes(w->scene);
    return write_finishes(w, desc);
}

static void expect_finish(const struct world *w, const struct lw_client *client) {
    const struct lw_scene *scene = lw_client_scene(client);
    uint8_t *ours, *theirs;
    size_t our_size, their_size;
    lw_support_ok(lw_finish_package_write(w->scene, &ours, &our_size, NULL), NULL);
    lw_support_ok(lw_finish_package_write(scene, &theirs, &their_size, NULL), NULL);
    assert_int_equal(our_size, their_size);
    assert_memory_equal(ours, theirs, our_size);
    free(ours);
    free(theirs);
}

static void expect_matt(const struct lw_client *client) {
    const struct lw_scene *scene = lw_client_scene(client);
    for (uint32_t m = 0; m < scene->material_count; m++) assert_null(scene->material[m].finish);
    for (uint32_t m = 0; m < scene->mesh_count; m++) assert_null(scene->mesh[m].tangent);
    assert_int_equal(scene->finish_texture_count, 0);
}

static void count_finishes(void *context) { ++*(unsigned *)context; }

/* Waits for the light and, where they are to come, finishes. Returns the bytes that it took. */
static uint64_t fetch_finishes(const struct running *r, const struct world *w, struct lw_client_desc desc,
                               enum lw_client_finishes expected) {
    struct lw_client *client;
    struct lw_client_stats stats;
    struct lw_error err = {0};
    unsigned told = 0;
    desc.host = "127.0.0.1";
    desc.port = lw_server_port(r->server);
    desc.watch.context = &told;
    desc.watch.finishes = count_finishes;
    lw_support_ok(lw_client_create(&desc, &client, &err), &err);
    do {
        lw_support_ok(lw_client_poll(client, 100, &err), &err);
        lw_client_get_stats(client, &stats);
        if (!stats.first_ns && lw_client_scene(client)) expect_matt(client);
    } while (!stats.settled_frame || lw_client_finishes(client) == LW_CLIENT_FINISHES_COMING);
    assert_int_equal(lw_client_finishes(client), expected);
    assert_int_equal(told, expected == LW_CLIENT_FINISHES_THERE);
    assert_int_equal(stats.finishes_ns != 0, told);
    assert_int_equal(stats.finish_bytes != 0, told);
    assert_in_range(stats.package_bytes, 1, stats.bytes);
    if (told) {
        assert_in_range(stats.finish_bytes, 1, stats.bytes - stats.package_bytes);
        assert_true(stats.finishes_ns >= stats.first_ns);
        expect_finish(w, client);
    } else {
        expect_matt(client);
    }
    lw_client_destroy(client);
    return stats.bytes;
}

/* Who asks gets them, after its light; who does not, and who has a server without, has a matt scene. */
static void test_finishes(void **state) {
    (void)state;
    struct world w = make_world();
    struct lw_server_desc desc = {0};
    uint8_t *bytes = add_finishes(&w, &desc);
    struct running r = start_server_with(&w, desc);
    publish(&r, make_snapshot(&w, 1));
    const uint64_t matt = fetch_finishes(&r, &w, (struct lw_client_desc){0}, LW_CLIENT_FINISHES_NONE);
    const uint64_t all =
        fetch_finishes(&r, &w, (struct lw_client_desc){.materials = true}, LW_CLIENT_FINISHES_THERE);
    assert_true(all > matt);
    stop_server(&r);
    r = start_server(&w, 0);
    publish(&r, make_snapshot(&w, 1));
    fetch_finishes(&r, &w, (struct lw_client_desc){.materials = true}, LW_CLIENT_FINISHES_NONE);
    stop_server(&r);
    free(bytes);
    finish_world(&w);
}

static void test_cached_finishes(void **state) {
    (void)state;
    struct world w = make_world();
    struct lw_server_desc desc = {0};
    uint8_t *bytes = add_finishes(&w, &desc);
    struct running r = start_server_with(&w, desc);
    char folder[256];
    snprintf(folder, sizeof folder, "%s", lw_support_temporary("finishes"));
    const struct lw_client_desc cached = {.materials = true, .cache_folder = folder};
    const unsigned parts = w.scene->texture_count + 1 + w.scene->finish_texture_count + 1;
    publish(&r, make_snapshot(&w, 1));
    const uint64_t whole = fetch_finishes(&r, &w, cached, LW_CLIENT_FINISHES_THERE);
    size_t size = 0;
    assert_int_equal(for_files(folder, ".lwpart", add_size, &size), parts);
    assert_int_equal(size, w.package_size + desc.finishes_size);
    const uint64_t again = fetch_finishes(&r, &w, cached, LW_CLIENT_FINISHES_THERE);
    assert_true(again + w.compressed_size < whole);
    for_files(folder, ".lwpart", damage, &(bool){false});
    assert_int_equal(fetch_finishes(&r, &w, cached, LW_CLIENT_FINISHES_THERE), whole);
    assert_int_equal(remove_files(folder, ".lwpart"), parts);
    rmdir(folder);
    stop_server(&r);
    free(bytes);
    finish_world(&w);
}

static void poll_until_finished(struct lw_client *client) {
    struct lw_error err = {0};
    const uint64_t end_ns = lw_clock_ns() + WAIT_NS;
    while (lw_client_finishes(client) != LW_CLIENT_FINISHES_THERE) {
        assert_true(lw_clock_ns() < end_ns);
        lw_support_ok(lw_client_poll(client, 100, &err), &err);
    }
}

/* A client that comes back keeps its finishes; others than those are another scene. */
static void test_finishes_of_another_session(void **state) {
    (void)state;
    struct world w = make_world();
    struct lw_server_desc desc = {0};
    struct lw_client *client;
    struct lw_client_stats before, after;
    struct lw_error err = {0};
    uint8_t *bytes = add_finishes(&w, &desc);
    struct running r = start_server_with(&w, desc);
    const uint16_t port = lw_server_port(r.server);
    publish(&r, make_snapshot(&w, 1));
    lw_support_ok(
        lw_client_create(&(struct lw_client_desc){.host = "127.0.0.1", .port = port, .materials = true},
                         &client, &err),
        &err);
    poll_until_finished(client);
    lw_client_get_stats(client, &before);
    assert_int_equal(shutdown(lw_client_descriptor(client), SHUT_RDWR), 0);
    lose_connection(client);
    lw_support_ok(lw_client_reconnect(client, &err), &err);
    poll_until_tiles(client, before.tiles);
    lw_client_get_stats(client, &after);
    assert_int_equal(after.finishes_ns, before.finishes_ns);
    expect_finish(&w, client);
    stop_server(&r);
    free(bytes);

    ((struct lw_finish *)w.scene->material[1].finish)->roughness = 0.125f;
    bytes = write_finishes(&w, &desc);
    desc.port = port;
    r = start_server_with(&w, desc);
    publish(&r, make_snapshot(&w, 1));
    lose_connection(client);
    lw_support_fails(lw_client_reconnect(client, &err), LW_BAD_DATA, &err, "another scene");
    assert_true(lw_client_found_other_scene(client));
    lw_client_forget_scene(client);
    assert_int_equal(lw_client_finishes(client), LW_CLIENT_FINISHES_NONE);
    err = (struct lw_error){0};
    lw_support_ok(lw_client_reconnect(client, &err), &err);
    poll_until_finished(client);
    expect_finish(&w, client);
    lw_client_destroy(client);
    stop_server(&r);
    free(bytes);
    finish_world(&w);
}

static void test_backoff(void **state) {
    (void)state;
    for (unsigned attempt = 0; attempt < 40; attempt++) {
        unsigned least = UINT32_MAX, most = 0, low = attempt < 4 ? 50u << attempt : 500;
        for (uint32_t seed = 0; seed < 1000; seed++) {
            unsigned ms = lw_client_backoff_ms(attempt, seed);
            least = ms < least ? ms : least;
            most = ms > most ? ms : most;
        }
        assert_in_range(least, low, low + low / 10 + 1);
        assert_in_range(most, 2 * low - low / 10 - 1, 2 * low);
    }
}

/* ---- against a peer that reads from a script ---- */

struct script {
    uint8_t *bytes;
    size_t size;
    bool closes; /* after the last byte; otherwise it stays silent until the client goes */
    int listener;
    uint16_t port;
    _Atomic bool said; /* all of it has been sent */
    pthread_t thread;
};

static void say_bytes(struct script *s, const void *bytes, size_t size) {
    s->bytes = realloc(s->bytes, s->size + size + 1);
    assert_non_null(s->bytes);
    memcpy(s->bytes + s->size, bytes, size);
    s->size += size;
}

static void say(struct script *s, const struct lw_message *message) {
    uint8_t *bytes;
    size_t size;
    lw_support_ok(lw_message_encode_alloc(message, &bytes, &size), NULL);
    say_bytes(s, bytes, size);
    free(bytes);
}

static struct lw_message welcome_of(const struct world *w) {
    struct lw_message m = {.type = LW_MESSAGE_WELCOME,
                           .welcome = {.version = 1,
                                       .name = "script",
                                       .package_size = w->package_size,
                                       .package_compressed_size = w->compressed_size}};
    lw_package_hash(w->package, w->package_size, &m.welcome.package_hash);
    return m;
}

/* In pieces of seven bytes and then the rest, so that decompression starts and stops. */
static void say_package(struct script *s, const struct world *w) {
    for (size_t at = 0, piece = 7; at < w->compressed_size; at += piece) {
        if (at > 70) piece = w->compressed_size - at;
        if (piece > LW_MESSAGE_CHUNK_MAX) piece = LW_MESSAGE_CHUNK_MAX;
        say(s, &(struct lw_message){.type = LW_MESSAGE_PACKAGE_CHUNK,
                                    .package_chunk = {at, w->compressed + at, piece}});
    }
}

static void *recite(void *context) {
    struct script *s = context;
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

static void begin(struct script *s) {
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

static void end(struct script *s) {
    assert_int_equal(pthread_join(s->thread, NULL), 0);
    close(s->listener);
    free(s->bytes);
    *s = (struct script){0};
}

/* Plays the script to a client until it fails, as it must. *out_created says whether there was a welcome. */
static void expect_failure_of(struct script *s, bool draws, enum lw_status expected, const char *text,
                              bool created) {
    struct lw_client *client = NULL;
    struct lw_error err = {0};
    begin(s);
    uint64_t end_ns = lw_clock_ns() + WAIT_NS;
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
    end(s);
}

static void expect_failure(struct script *s, enum lw_status expected, const char *text, bool created) {
    expect_failure_of(s, false, expected, text, created);
}

static void test_no_server(void **state) {
    (void)state;
    struct lw_client *client = NULL;
    struct lw_error err = {0};
    struct script s = {0};
    begin(&s);
    uint16_t port = s.port;
    struct sockaddr_in address = {
        .sin_family = AF_INET, .sin_port = htons(port), .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    int once = socket(AF_INET, SOCK_STREAM, 0);
    assert_int_equal(connect(once, (struct sockaddr *)&address, sizeof address), 0);
    close(once);
    end(&s); /* nobody listens there any more */
    char name[100];
    snprintf(name, sizeof name, "cannot connect to 127.0.0.1:%u: Connection refused: is lightwelld running?",
             port);
    lw_support_fails(
        lw_client_create(&(struct lw_client_desc){.host = "127.0.0.1", .port = port}, &client, &err),
        LW_UNAVAILABLE, &err, name);
    err = (struct lw_error){0};
    lw_support_fails(
        lw_client_create(&(struct lw_client_desc){.host = "no such host", .port = 1}, &client, &err),
        LW_NO_HOST, &err, "no such host:1");
    assert_null(client);
}

static void test_not_a_lightwelld(void **state) {
    (void)state;
    struct script s = {0};
    say_bytes(&s, "SSH-2.0-OpenSSH_9.2p1\r\n", 23);
    expect_failure(&s, LW_PROTOCOL, "no welcome from a lightwelld of this version", false);
    expect_failure(&s, LW_TIMED_OUT, "does not answer: is it a lightwelld?", false); /* says nothing */
    s.closes = true;
    expect_failure(&s, LW_PROTOCOL, "closed the connection", false);
    uint8_t cut[] = {200, 0, 0, 0, 2, 0, 0, 0, 1, 2, 3};
    s.closes = true;
    say_bytes(&s, cut, sizeof cut);
    expect_failure(&s, LW_PROTOCOL, "closed the connection", false);
    say(&s, &(struct lw_message){.type = LW_MESSAGE_HELLO, .hello.version = 1}); /* a client */
    expect_failure(&s, LW_PROTOCOL, "message HELLO: not one that a server sends", false);
}

static void test_refused(void **state) {
    (void)state;
    struct script s = {0};
    say(&s, &(struct lw_message){.type = LW_MESSAGE_REFUSAL,
                                 .refusal = {.code = LW_REFUSAL_VERSION, .text = "speak version 2"}});
    expect_failure(&s, LW_PROTOCOL, "it refused us: speak version 2", false);
    say(&s, &(struct lw_message){.type = LW_MESSAGE_REFUSAL,
                                 .refusal = {.code = LW_REFUSAL_FULL, .text = "come back later"}});
    s.closes = true;
    expect_failure(&s, LW_UNAVAILABLE, "it refused us: come back later", false);
    say(&s, &(struct lw_message){.type = LW_MESSAGE_REFUSAL,
                                 .refusal = {.code = (enum lw_refusal)999, .text = ""}});
    expect_failure(&s, LW_UNAVAILABLE, "it did not say why", false);
    struct world w = make_world();
    struct lw_message welcome = welcome_of(&w);
    welcome.welcome.version = 2;
    say(&s, &welcome);
    expect_failure(&s, LW_PROTOCOL, "it speaks version 2 of the protocol", false);
    finish_world(&w);
}

static void test_unknown_types_are_skipped(void **state) {
    (void)state;
    struct world w = make_world();
    struct script s = {0};
    const uint8_t future[] = {5, 0, 0, 0, 200, 1, 0, 0, 0xff, 0xff, 0xff, 0xff, 0xff};
    struct lw_message welcome = welcome_of(&w);
    say_bytes(&s, future, sizeof future);
    say(&s, &welcome);
    say_bytes(&s, future, sizeof future);
    say(&s, &(struct lw_message){.type = LW_MESSAGE_PING, .ping.token = 1});
    say_package(&s, &w);
    say(&s, &(struct lw_message){.type = LW_MESSAGE_REFUSAL,
                                 .refusal = {.code = LW_REFUSAL_SHUTDOWN, .text = "good night"}});
    expect_failure(&s, LW_CLOSED, "it ended the session: good night", true);
    finish_world(&w);
}

static void poll_until_waiting(struct lw_client *client, enum lw_waiting_stage stage, float share) {
    struct lw_error err = {0};
    const uint64_t end_ns = lw_clock_ns() + WAIT_NS;
    for (struct lw_waiting_state now;
         now = lw_client_waiting(client), now.stage != stage || now.share != share;) {
        assert_true(lw_clock_ns() < end_ns);
        lw_support_ok(lw_client_poll(client, 100, &err), &err);
    }
}

/* Why there is no light yet, from the server's own account to its first frame, and again in a new session. */
static void test_waiting(void **state) {
    (void)state;
    struct world w = make_world();
    struct lw_waiting waiting = {0};
    struct running r = start_server_with(&w, (struct lw_server_desc){.first_light = &waiting});
    const struct lw_client_desc desc = {.host = "127.0.0.1", .port = lw_server_port(r.server)};
    struct lw_client *client;
    struct lw_error err = {0};
    lw_support_ok(lw_client_create(&desc, &client, &err), &err);
    assert_int_equal(lw_client_waiting(client).stage, LW_WAITING_UNKNOWN);
    lw_waiting_raise(&waiting, LW_WAITING_PLACING_TEXELS, 1, 10);
    poll_until_waiting(client, LW_WAITING_PLACING_TEXELS, 0.1f);
    lw_waiting_raise(&waiting, LW_WAITING_LOOKING_INSIDE, 42, 100);
    poll_until_waiting(client, LW_WAITING_LOOKING_INSIDE, 0.42f);
    lw_waiting_raise(&waiting, LW_WAITING_FIRST_LIGHT, 17, 100);
    poll_until_waiting(client, LW_WAITING_FIRST_LIGHT, 0.17f);
    assert_true(lw_client_scene(client) != NULL); /* which has come meanwhile */
    struct lw_snapshot *snapshot = make_snapshot(&w, 1);
    lw_server_publish(r.server, snapshot);
    lw_snapshot_unref(snapshot);
    poll_until_waiting(client, LW_WAITING_READY, 1);
    poll_until_tiles(client, w.map.tile_count);
    lw_support_ok(lw_client_reconnect(client, &err), &err);
    assert_int_equal(lw_client_waiting(client).stage, LW_WAITING_UNKNOWN); /* of this session */
    poll_until_waiting(client, LW_WAITING_READY, 1);                       /* by its first frame */
    lw_client_destroy(client);
    stop_server(&r);
    finish_world(&w);
}

/* Stages of a newer server, and what comes too early or too late. */
static void test_waiting_for_what_is_new(void **state) {
    (void)state;
    struct world w = make_world();
    struct script s = {0};
    struct lw_client *client;
    struct lw_error err = {0};
    const struct lw_message welcome = welcome_of(&w),
                            first = {.type = LW_MESSAGE_WAITING, .waiting = {2, 0.5f}},
                            later = {.type = LW_MESSAGE_WAITING, .waiting = {77, 0.5f}},
                            frame = {.type = LW_MESSAGE_FRAME, .frame = {.frame = 5}};
    say(&s, &first);
    expect_failure(&s, LW_PROTOCOL, "message WAITING: out of order", false);
    say(&s, &welcome);
    say(&s, &first);
    say(&s, &later);
    begin(&s);
    const struct lw_client_desc desc = {.host = "127.0.0.1", .port = s.port};
    lw_support_ok(lw_client_create(&desc, &client, &err), &err);
    poll_until_waiting(client, LW_WAITING_UNKNOWN, 0.5f);
    lw_client_destroy(client);
    end(&s);
    say(&s, &welcome);
    say_package(&s, &w);
    say(&s, &frame);
    say(&s, &first);
    say(&s, &(struct lw_message){.type = LW_MESSAGE_SETTLED, .settled.frame = 5});
    begin(&s);
    const struct lw_client_desc again = {.host = "127.0.0.1", .port = s.port};
    lw_support_ok(lw_client_create(&again, &client, &err), &err);
    for (struct lw_client_stats stats = {0}; stats.settled_frame != 5; lw_client_get_stats(client, &stats))
        lw_support_ok(lw_client_poll(client, 100, &err), &err);
    assert_int_equal(lw_client_waiting(client).stage, LW_WAITING_READY);
    lw_client_destroy(client);
    end(&s);
    finish_world(&w);
}

static void test_what_comes_with_the_welcome(void **state) {
    (void)state;
    struct world w = make_world();
    struct script s = {0};
    struct lw_message welcome = welcome_of(&w);
    say(&s, &welcome);
    say_package(&s, &w);
    begin(&s);
    struct lw_client *client;
    struct lw_error err = {0};
    lw_support_ok(
        lw_client_create(&(struct lw_client_desc){.host = "127.0.0.1", .port = s.port}, &client, &err), &err);
    LW_SUPPORT_WAIT_UNTIL(s.said); /* now all of it is read already, or waits in the socket */
    /* a poll that waited for what is here already would never come back */
    while (!lw_client_scene(client)) lw_support_ok(lw_client_poll(client, INT_MAX, &err), &err);
    lw_client_destroy(client);
    end(&s);
    finish_world(&w);
}

/* A download that was cut short goes on where it was, if the server is the same; otherwise it begins
 * again. */
static void test_download_goes_on(void **state) {
    (void)state;
    struct world w = make_world();
    const size_t half = w.compressed_size / 2,
                 part[3][2] = {{0, half}, {half, w.compressed_size - half}, {0, w.compressed_size}};
    for (int same = 0; same < 2; same++) {
        struct script s = {.closes = true};
        struct lw_client *client;
        struct lw_error err = {0};
        struct lw_message welcome = welcome_of(&w);
        welcome.welcome.run = 77;
        say(&s, &welcome);
        say(&s, &(struct lw_message){.type = LW_MESSAGE_PACKAGE_CHUNK,
                                     .package_chunk = {0, w.compressed, part[0][1]}});
        begin(&s);
        const uint16_t port = s.port;
        lw_support_ok(
            lw_client_create(&(struct lw_client_desc){.host = "127.0.0.1", .port = port}, &client, &err),
            &err);
        lose_connection(client);
        assert_null(lw_client_scene(client));
        assert_true(lw_client_package_progress(client) > 0.4f);
        end(&s);
        const size_t *rest = part[same ? 1 : 2];
        s = (struct script){.port = port};
        welcome.welcome.run = same ? 77 : 78;
        say(&s, &welcome);
        say(&s, &(struct lw_message){.type = LW_MESSAGE_PACKAGE_CHUNK,
                                     .package_chunk = {rest[0], w.compressed + rest[0], rest[1]}});
        begin(&s);
        lw_support_ok(lw_client_reconnect(client, &err), &err);
        while (!lw_client_scene(client)) lw_support_ok(lw_client_poll(client, 4000, &err), &err);
        assert_int_equal(lw_client_scene(client)->object_count, w.scene->object_count);
        lw_client_destroy(client);
        end(&s);
    }
    finish_world(&w);
}

/* Finishes of a script: all of them in one part. */
static uint8_t *tell_finishes(struct world *w, struct lw_message *welcome, const uint8_t *bytes,
                              size_t size) {
    static uint64_t sizes[2];
    static struct lw_package_hash hash;
    uint8_t *compressed = malloc(ZSTD_compressBound(size));
    sizes[0] = size;
    sizes[1] = ZSTD_compress(compressed, ZSTD_compressBound(size), bytes, size, 3);
    lw_package_hash(bytes, size, &hash);
    *welcome = welcome_of(w);
    welcome->welcome.run = 77;
    welcome->welcome.features = LW_FEATURE_MATERIALS;
    welcome->welcome.finish = (struct lw_message_package){.hash = hash,
                                                          .size = sizes[0],
                                                          .compressed_size = sizes[1],
                                                          .part_size = &sizes[0],
                                                          .part_compressed_size = &sizes[1],
                                                          .part_hash = &hash,
                                                          .part_count = 1};
    return compressed;
}

/* A frame and all of its tiles, after which the client asks for finishes. */
static void say_all_light(struct script *s, const struct world *w, uint64_t version) {
    uint8_t *payload = malloc(lw_tile_codec_bound());
    say(s, &(struct lw_message){.type = LW_MESSAGE_FRAME, .frame = {.frame = 1}});
    for (uint32_t t = 0; t < w->map.tile_count; t++) {
        const struct lw_message tile = tile_message(w, t, version, payload);
        say(s, &tile);
    }
    free(payload);
}

/* A download that was cut short, and a folder that has the package by the next welcome. */
static void test_a_download_that_a_folder_ends(void **state) {
    (void)state;
    struct world w = make_world();
    struct script s = {.closes = true};
    struct lw_client *client;
    struct lw_error err = {0};
    char folder[256];
    snprintf(folder, sizeof folder, "%s", lw_support_temporary("download"));
    struct lw_message welcome = welcome_of(&w);
    welcome.welcome.run = 77;
    say(&s, &welcome);
    say(&s, &(struct lw_message){.type = LW_MESSAGE_PACKAGE_CHUNK,
                                 .package_chunk = {0, w.compressed, w.compressed_size / 2}});
    begin(&s);
    const uint16_t port = s.port;
    lw_support_ok(
        lw_client_create(&(struct lw_client_desc){.host = "127.0.0.1", .port = port, .cache_folder = folder},
                         &client, &err),
        &err);
    lose_connection(client);
    end(&s);
    lw_support_ok(lw_package_cache_write(folder, LW_PACKAGE_CACHE_PACKAGE, &welcome.welcome.package_hash,
                                         w.package, w.package_size, &err),
                  &err);
    s = (struct script){.port = port};
    say(&s, &welcome);
    say_all_light(&s, &w, 1);
    begin(&s);
    lw_support_ok(lw_client_reconnect(client, &err), &err);
    assert_non_null(lw_client_scene(client));
    poll_until_tiles(client, w.map.tile_count);
    lw_client_destroy(client);
    end(&s);
    assert_int_equal(remove_files(folder, ".lwscene"), 1);
    rmdir(folder);
    finish_world(&w);
}

/* A welcome of a new run that fails half-way does not make the next one a session of the same run. */
static void test_a_welcome_that_fails(void **state) {
    (void)state;
    struct world w = make_world();
    struct script s = {.closes = true};
    struct lw_client *client;
    struct lw_error err = {0};
    struct lw_message welcome = welcome_of(&w);
    welcome.welcome.run = 77;
    say(&s, &welcome);
    say_package(&s, &w);
    say_all_light(&s, &w, 5);
    begin(&s);
    const uint16_t port = s.port;
    lw_support_ok(
        lw_client_create(&(struct lw_client_desc){.host = "127.0.0.1", .port = port}, &client, &err), &err);
    lose_connection(client);
    end(&s);
    expect_tile(client, &w, 0, 5);
    s = (struct script){.port = port, .closes = true};
    welcome.welcome.run = 78;
    welcome.welcome.features = LW_FEATURE_DRAWS; /* was not offered */
    say(&s, &welcome);
    begin(&s);
    lw_support_fails(lw_client_reconnect(client, &err), LW_PROTOCOL, &err, "not offered");
    assert_int_equal(shutdown(lw_client_descriptor(client), SHUT_RDWR), 0);
    end(&s);
    err = (struct lw_error){0};
    s = (struct script){.port = port};
    welcome.welcome.features = 0;
    say(&s, &welcome);
    say_all_light(&s, &w, 1);
    begin(&s);
    lw_support_ok(lw_client_reconnect(client, &err), &err);
    poll_until_tiles(client, 2 * w.map.tile_count);
    for (uint32_t t = 0; t < w.map.tile_count; t++) expect_texels(client, &w, t, 1);
    lw_client_destroy(client);
    end(&s);
    finish_world(&w);
}

static void expect_finish_failure(struct script *s, enum lw_status expected, const char *text) {
    struct lw_client *client = NULL;
    struct lw_error err = {0};
    begin(s);
    lw_support_ok(lw_client_create(&(struct lw_client_desc){.host = "127.0.0.1",
                                                            .port = s->port,
                                                            .timeout_ms = 400,
                                                            .budget_ns = 1, /* a message at a time */
                                                            .materials = true},
                                   &client, &err),
                  &err);
    enum lw_status status = LW_OK;
    while (status == LW_OK) status = lw_client_poll(client, 100, &err);
    lw_support_fails(status, expected, &err, text);
    if (lw_client_scene(client)) expect_matt(client);
    lw_client_destroy(client);
    end(s);
}

static void test_damaged_finishes(void **state) {
    (void)state;
    struct world w = make_world();
    struct lw_server_desc desc = {0};
    struct lw_message welcome;
    uint8_t *bytes = add_finishes(&w, &desc), *compressed;
    const struct {
        enum lw_status status;
        const char *text;
    } expected[] = {{LW_PROTOCOL, "message FINISH_CHUNK: out of order"},
                    {LW_PROTOCOL, "finish package: chunk at 1 where 0 was expected"},
                    {LW_PROTOCOL, "finish package: its hash is not the one promised"},
                    {LW_BAD_DATA, "material 3, after 1 of 3"},
                    {LW_PROTOCOL, "message FINISH_CHUNK: out of order"}};
    for (int lie = 0; lie < 5; lie++) {
        struct script s = {0};
        uint8_t *record = bytes + 32 + 24 * 7 + 8 + 16 + 168; /* the second finish, behind the scene */
        if (lie == 3) record[0] = 3;
        compressed = tell_finishes(&w, &welcome, bytes, desc.finishes_size);
        record[0] = 2;
        if (lie == 2) welcome.welcome.finish.hash.bytes[3] ^= 1;
        const size_t size = welcome.welcome.finish.compressed_size;
        struct lw_message chunk = {.type = LW_MESSAGE_FINISH_CHUNK, .finish_chunk = {0, compressed, size}};
        if (lie == 1) chunk.finish_chunk = (struct lw_message_package_chunk){1, compressed + 1, size - 1};
        say(&s, &welcome);
        if (lie) say_package(&s, &w);
        if (lie) say_all_light(&s, &w, 1);
        say(&s, &chunk);
        if (lie == 4) say(&s, &chunk); /* they are there */
        if (lie < 4) {
            expect_finish_failure(&s, expected[lie].status, expected[lie].text);
        } else {
            struct lw_client *client = NULL;
            struct lw_error err = {0};
            begin(&s);
            enum lw_status status = lw_client_create(
                &(struct lw_client_desc){
                    .host = "127.0.0.1", .port = s.port, .budget_ns = 1, .materials = true},
                &client, &err);
            while (status == LW_OK) status = lw_client_poll(client, 100, &err);
            lw_support_fails(status, LW_PROTOCOL, &err, expected[lie].text);
            expect_finish(&w, client);
            lw_client_destroy(client);
            end(&s);
        }
        free(compressed);
    }
    free(bytes);
    finish_world(&w);
}

/* What was cut short goes on in the same run, and begins again in another. */
static void test_finishes_go_on(void **state) {
    (void)state;
    struct world w = make_world();
    struct lw_server_desc desc = {0};
    struct lw_message welcome;
    uint8_t *bytes = add_finishes(&w, &desc), *compressed;
    compressed = tell_finishes(&w, &welcome, bytes, desc.finishes_size);
    const size_t size = welcome.welcome.finish.compressed_size, half = size / 2;
    for (int same = 0; same < 2; same++) {
        struct script s = {.closes = true};
        struct lw_client *client;
        struct lw_error err = {0};
        welcome.welcome.run = 77;
        say(&s, &welcome);
        say_package(&s, &w);
        say_all_light(&s, &w, 1);
        say(&s, &(struct lw_message){.type = LW_MESSAGE_FINISH_CHUNK, .finish_chunk = {0, compressed, half}});
        begin(&s);
        const uint16_t port = s.port;
        lw_support_ok(lw_client_create(
                          &(struct lw_client_desc){
                              .host = "127.0.0.1", .port = port, .budget_ns = 1, .materials = true},
                          &client, &err),
                      &err);
        lose_connection(client);
        assert_int_equal(lw_client_finishes(client), LW_CLIENT_FINISHES_COMING);
        end(&s);
        const size_t from = same ? half : 0;
        s = (struct script){.port = port};
        welcome.welcome.run = same ? 77 : 78;
        say(&s, &welcome);
        say_all_light(&s, &w, 1);
        say(&s, &(struct lw_message){.type = LW_MESSAGE_FINISH_CHUNK,
                                     .finish_chunk = {from, compressed + from, size - from}});
        begin(&s);
        lw_support_ok(lw_client_reconnect(client, &err), &err);
        poll_until_finished(client);
        expect_finish(&w, client);
        lw_client_destroy(client);
        end(&s);
    }
    free(compressed);
    free(bytes);
    finish_world(&w);
}

static void test_damaged_package(void **state) {
    (void)state;
    struct world w = make_world();
    struct script s = {0};
    struct lw_message good = welcome_of(&w), m = good;
    m.welcome.package_hash.bytes[15] ^= 1;
    say(&s, &m);
    say_package(&s, &w);
    expect_failure(&s, LW_PROTOCOL, "hash", true);
    m = good;
    m.welcome.package_size--;
    say(&s, &m);
    say_package(&s, &w);
    expect_failure(&s, LW_PROTOCOL, "scene package: ", true);
    m = good;
    m.welcome.package_size++;
    say(&s, &m);
    say_package(&s, &w);
    expect_failure(&s, LW_PROTOCOL, "were promised", true);
    m = good;
    m.welcome.package_compressed_size--;
    say(&s, &m);
    say_package(&s, &w);
    expect_failure(&s, LW_PROTOCOL, "scene package: ", true);
    m = good;
    m.welcome.package_compressed_size += 4;
    say(&s, &m);
    say_package(&s, &w);
    say(&s, &(struct lw_message){.type = LW_MESSAGE_PACKAGE_CHUNK,
                                 .package_chunk = {w.compressed_size, (const uint8_t *)"more", 4}});
    expect_failure(&s, LW_PROTOCOL, "bytes after its end", true);
    say(&s, &good);
    say(&s,
        &(struct lw_message){.type = LW_MESSAGE_PACKAGE_CHUNK, .package_chunk = {1, w.compressed + 1, 10}});
    expect_failure(&s, LW_PROTOCOL, "chunk at 1 where 0 was expected", true);
    say(&s, &good);
    say(&s, &(struct lw_message){.type = LW_MESSAGE_PACKAGE_CHUNK,
                                 .package_chunk = {0, (const uint8_t *)"zstd?", 5}});
    expect_failure(&s, LW_PROTOCOL, "scene package: ", true);
    /* a hash that fits bytes that are no package */
    m = good;
    uint8_t compressed[64];
    m.welcome.package_size = 5;
    m.welcome.package_compressed_size = ZSTD_compress(compressed, sizeof compressed, "scene", 5, 1);
    lw_package_hash((const uint8_t *)"scene", 5, &m.welcome.package_hash);
    say(&s, &m);
    say(&s, &(struct lw_message){.type = LW_MESSAGE_PACKAGE_CHUNK,
                                 .package_chunk = {0, compressed, m.welcome.package_compressed_size}});
    expect_failure(&s, LW_BAD_DATA, "127.0.0.1", true);
    finish_world(&w);
}

static void say_beginning(struct script *s, const struct world *w) {
    struct lw_message welcome = welcome_of(w);
    say(s, &welcome);
    say_package(s, w);
}

/* Light that the client would count twice, or miss, ends the session; so does what no scene has. */
static void test_forms_out_of_place(void **state) {
    (void)state;
    struct world w = make_world();
    struct script s = {0};
    uint8_t *payload = malloc(lw_tile_codec_bound());
    struct lw_message tile = tile_message(&w, 0, 1, payload), plain = welcome_of(&w), draws = plain;
    draws.welcome.features = LW_FEATURE_DRAWS;
    draws.welcome.client_lights = drawn_lights;
    draws.welcome.client_lights_size = 1;
    say(&s, &draws);
    say_package(&s, &w);
    expect_failure(&s, LW_PROTOCOL, "draws direct light, which was not offered", false);
    say(&s, &draws);
    say_package(&s, &w);
    say(&s, &tile);
    expect_failure_of(&s, true, LW_PROTOCOL, "it is of layer 0 in a session that gets layer 1", true);
    tile.tile.layer = LW_LIGHT_FORM_SPLIT;
    for (int i = 0; i < 2; i++) {
        say(&s, &plain);
        say_package(&s, &w);
        say(&s, &tile);
        expect_failure_of(&s, i, LW_PROTOCOL, "it is of layer 1 in a session that gets layer 0", true);
    }
    uint8_t bits[LW_SCENE_LIGHTS_MAX / 8] = {0};
    const uint32_t lights = w.scene->light_count, materials = w.scene->material_count;
    bits[lights / 8] = (uint8_t)(1u << lights % 8);
    draws.welcome.client_lights = bits;
    draws.welcome.client_lights_size = lights / 8 + 1;
    say(&s, &draws);
    say_package(&s, &w);
    expect_failure_of(&s, true, LW_PROTOCOL, "client_lights has light", true);
    bits[lights / 8] = 0;
    bits[materials / 8] = (uint8_t)(1u << materials % 8);
    draws.welcome.client_lights = NULL;
    draws.welcome.client_lights_size = 0;
    draws.welcome.client_materials = bits;
    draws.welcome.client_materials_size = LW_SCENE_MATERIALS_MAX / 8; /* many bytes, that are 0 */
    say(&s, &draws);
    say_package(&s, &w);
    expect_failure_of(&s, true, LW_PROTOCOL, "client_materials has material", true);
    free(payload);
    finish_world(&w);
}

static void test_messages_out_of_place(void **state) {
    (void)state;
    struct world w = make_world();
    struct script s = {0};
    uint8_t *payload = malloc(lw_tile_codec_bound());
    struct lw_message tile = tile_message(&w, 0, 1, payload), m, welcome = welcome_of(&w);
    struct lw_message frame = {.type = LW_MESSAGE_FRAME, .frame = {.frame = 5}};
    say(&s, &welcome);
    say(&s, &tile);
    expect_failure(&s, LW_PROTOCOL, "message TILE: out of order", true);
    say(&s, &welcome);
    say(&s, &frame);
    expect_failure(&s, LW_PROTOCOL, "message FRAME: out of order", true);
    say(&s, &welcome);
    say(&s, &welcome);
    /* both may arrive while the client still waits for the first */
    struct lw_client *client = NULL;
    struct lw_error err = {0};
    begin(&s);
    enum lw_status status =
        lw_client_create(&(struct lw_client_desc){.host = "127.0.0.1", .port = s.port}, &client, &err);
    while (status == LW_OK) status = lw_client_poll(client, 100, &err);
    lw_support_fails(status, LW_PROTOCOL, &err, "message WELCOME: out of order");
    lw_client_destroy(client);
    end(&s);
    const struct lw_message_interest_tile nowhere[] = {{w.scene->object_count, 0, 0},
                                                       {0, w.map.atlas[0].level_count, 0},
                                                       {0, w.map.atlas[0].level_count - 1, 1},
                                                       {UINT32_MAX, UINT32_MAX, UINT32_MAX},
                                                       {0, 0, UINT32_MAX}};
    for (size_t i = 0; i < sizeof nowhere / sizeof *nowhere; i++) {
        m = tile;
        m.tile.object = nowhere[i].object;
        m.tile.level = nowhere[i].level;
        m.tile.tile = nowhere[i].tile;
        say_beginning(&s, &w);
        say(&s, &m);
        expect_failure(&s, LW_PROTOCOL, "message TILE: there is no object", true);
    }
    m = tile;
    m.tile.codec = 3;
    say_beginning(&s, &w);
    say(&s, &m);
    expect_failure(&s, LW_PROTOCOL, "codec 3 is unknown", true);
    m = tile;
    m.tile.payload_size--;
    say_beginning(&s, &w);
    say(&s, &m);
    expect_failure(&s, LW_PROTOCOL, "the payload is damaged", true);
    struct lw_message_transform transform = {w.scene->object_count, LW_AFFINE_IDENTITY};
    m = frame;
    m.frame.transform = &transform;
    m.frame.transform_count = 1;
    say_beginning(&s, &w);
    say(&s, &m);
    expect_failure(&s, LW_PROTOCOL, "transform_object", true);
    struct lw_message_light light = {.light = w.scene->light_count};
    m = frame;
    m.frame.light = &light;
    m.frame.light_count = 1;
    say_beginning(&s, &w);
    say(&s, &m);
    expect_failure(&s, LW_PROTOCOL, "message FRAME: light", true);
    m = frame;
    m.frame.frame = 4;
    say_beginning(&s, &w);
    say(&s, &frame);
    say(&s, &m);
    expect_failure(&s, LW_PROTOCOL, "number 4 after 5", true);
    m = (struct lw_message){.type = LW_MESSAGE_SETTLED, .settled.frame = 6};
    say_beginning(&s, &w);
    say(&s, &m);
    expect_failure(&s, LW_PROTOCOL, "message SETTLED: out of order", true);
    say_beginning(&s, &w);
    say(&s, &frame);
    say(&s, &m);
    expect_failure(&s, LW_PROTOCOL, "message SETTLED: out of order", true);
    free(payload);
    finish_world(&w);
}

/* A tile in codec 4, as a whole and then as what has changed: of the smallest there is. */
static void say_light(struct script *s, const struct world *w) {
    uint32_t id = 0;
    for (uint32_t t = 1; t < w->map.tile_count; t++)
        if (w->map.place[t].width * w->map.place[t].height < w->map.place[id].width * w->map.place[id].height)
            id = t;
    const struct lw_tile_place *p = &w->map.place[id];
    static struct lw_tile_dct_history history;
    static float rgb[LW_TILE_TEXELS_MAX * 3];
    uint8_t *payload = malloc(lw_tile_codec_bound()), *delta = malloc(lw_tile_codec_bound());
    struct lw_message m = tile_message(w, id, 10, payload); /* for its names */
    m.tile.codec = LW_TILE_CODEC_DCT;
    for (uint64_t version = 10; version < 12; version++) {
        struct lw_tile_dct_coded coded;
        for (uint32_t i = 0; i < p->width * p->height * 3; i++) rgb[i] = 1 + (float)(i % 7 * version);
        lw_support_ok(
            lw_tile_codec_encode_dct(
                w->codec,
                &(struct lw_tile_dct_source){.rgb = rgb, .width = p->width, .height = p->height, .step = 1},
                &history, payload, delta, lw_tile_codec_bound(), &coded),
            NULL);
        m.tile.version = version;
        m.tile.base = version == 10 ? 0 : 10;
        m.tile.scale = coded.scale;
        m.tile.payload = version == 10 ? payload : delta;
        m.tile.payload_size = version == 10 ? coded.size : coded.delta_size;
        say(s, &m);
    }
    free(delta);
    free(payload);
}

/* Plays bytes to a client that has the scene already, until it fails. */
static enum lw_status listen_to(const struct lw_client *scene_of, const uint8_t *bytes, size_t size,
                                struct lw_client_stats *out_stats) {
    struct script s = {.closes = true};
    struct lw_client *client = NULL;
    struct lw_error err = {0};
    say_bytes(&s, bytes, size);
    begin(&s);
    enum lw_status status = lw_client_create(
        &(struct lw_client_desc){.host = "127.0.0.1", .port = s.port, .scene_of = scene_of}, &client, &err);
    while (status == LW_OK) status = lw_client_poll(client, 1000, &err);
    assert_true(err.text[0] != '\0');
    if (client) lw_client_get_stats(client, out_stats);
    lw_client_destroy(client);
    end(&s);
    return status;
}

/* What a server says cut off at every byte, and with every bit turned: a status, and nothing worse. */
static void test_bytes_gone_wrong(void **state) {
    (void)state;
    struct world w = make_world();
    struct script s = {0}, first = {0};
    struct lw_client *owner;
    struct lw_client_stats stats = {0};
    struct lw_error err = {0};
    say_beginning(&first, &w);
    begin(&first);
    lw_support_ok(
        lw_client_create(&(struct lw_client_desc){.host = "127.0.0.1", .port = first.port}, &owner, &err),
        &err);
    while (!lw_client_scene(owner)) lw_support_ok(lw_client_poll(owner, 1000, &err), &err);

    const struct lw_message_transform moved = {.object = 1, .object_to_world = LW_AFFINE_IDENTITY};
    const struct lw_message welcome = welcome_of(&w),
                            frame = {.type = LW_MESSAGE_FRAME,
                                     .frame = {.frame = 5, .transform = &moved, .transform_count = 1}},
                            settled = {.type = LW_MESSAGE_SETTLED, .settled.frame = 5};
    say(&s, &welcome);
    say(&s, &frame);
    say_light(&s, &w);
    say(&s, &settled);
    assert_int_equal(listen_to(owner, s.bytes, s.size, &stats), LW_CLOSED);
    assert_true(stats.tiles == 2 && stats.settled_frame == 5);
    for (size_t cut = 0; cut < s.size; cut++) {
        enum lw_status status = listen_to(owner, s.bytes, cut, &stats);
        assert_true(status == LW_CLOSED || status == LW_PROTOCOL);
    }
    unsigned refused = 0;
    for (size_t bit = 0; bit < 8 * s.size; bit++) {
        s.bytes[bit / 8] ^= (uint8_t)(1u << bit % 8);
        enum lw_status status = listen_to(owner, s.bytes, s.size, &stats);
        s.bytes[bit / 8] ^= (uint8_t)(1u << bit % 8);
        assert_true(status == LW_CLOSED || status == LW_PROTOCOL || status == LW_BAD_DATA);
        refused += status != LW_CLOSED;
    }
    assert_true(refused > s.size); /* the rest are other numbers, other light, or an end too early */
    free(s.bytes);
    lw_client_destroy(owner);
    end(&first);
    finish_world(&w);
}

/* ---- the replica by itself ---- */

/* A delta looks as the same version sent whole; on another version, or on a tile of codec 1, it is
 * refused. */
static void test_tiles_that_build_on_others(void **state) {
    (void)state;
    struct world w = make_world();
    struct lw_replica *replica, *late;
    struct lw_error err = {0};
    uint8_t *payload = malloc(lw_tile_codec_bound()), *delta = malloc(lw_tile_codec_bound());
    lw_support_ok(lw_replica_create(w.package, w.package_size, 0, &replica, &err), &err);
    lw_support_ok(lw_replica_create(w.package, w.package_size, 0, &late, &err), &err);
    static struct lw_tile_dct_history history;
    static float rgb[LW_TILE_TEXELS_MAX * 3];
    const struct lw_tile_place *p = &w.map.place[0];
    struct lw_message m = tile_message(&w, 0, 10, payload); /* for its names */
    m.tile.codec = LW_TILE_CODEC_DCT;
    for (uint64_t version = 10; version < 14; version++) {
        struct lw_tile_dct_coded coded;
        for (uint32_t i = 0; i < p->width * p->height * 3; i++)
            rgb[i] = 1 + 0.1f * (float)(i % 7 * (uint32_t)version);
        lw_support_ok(
            lw_tile_codec_encode_dct(w.codec,
                                     &(struct lw_tile_dct_source){
                                         .rgb = rgb, .width = p->width, .height = p->height, .step = 0.25f},
                                     &history, payload, delta, lw_tile_codec_bound(), &coded),
            NULL);
        struct lw_message_tile whole = m.tile;
        whole.version = version;
        whole.scale = coded.scale;
        whole.payload = payload;
        whole.payload_size = coded.size;
        lw_support_ok(lw_replica_take_tile(late, &whole, &err), &err);
        if (version > 10) {
            whole.base = version - 2;
            whole.payload = delta;
            whole.payload_size = coded.delta_size;
            assert_int_equal(lw_replica_take_tile(replica, &whole, NULL), LW_PROTOCOL);
            whole.base = version - 1;
        }
        lw_support_ok(lw_replica_take_tile(replica, &whole, &err), &err);
        struct lw_client_level a = lw_replica_get_level(replica, p->object, p->level),
                               b = lw_replica_get_level(late, p->object, p->level);
        assert_memory_equal(a.rgb, b.rgb, (size_t)p->width * 3 * sizeof *a.rgb);
    }
    struct lw_message_tile half = tile_message(&w, 0, 20, payload).tile;
    lw_support_ok(lw_replica_take_tile(replica, &half, &err), &err);
    m.tile.version = 21;
    m.tile.base = 20;
    m.tile.scale = 1;
    m.tile.payload = delta;
    m.tile.payload_size = 30;
    assert_int_equal(lw_replica_take_tile(replica, &m.tile, NULL), LW_PROTOCOL);
    lw_replica_destroy(late);
    lw_replica_destroy(replica);
    free(delta);
    free(payload);
    finish_world(&w);
}

/* A tile of a finer level has a place of its own, is withdrawn, and comes again; of other levels none is. */
static void test_tiles_of_finer_levels(void **state) {
    (void)state;
    struct world w = make_world();
    struct lw_replica *replica, *plain;
    struct lw_error err = {0};
    uint8_t *payload = malloc(lw_tile_codec_bound());
    lw_support_ok(lw_replica_create(w.package, w.package_size, 2, &replica, &err), &err);
    lw_support_ok(lw_replica_create(w.package, w.package_size, 0, &plain, &err), &err);
    const struct lw_atlas_map *map = lw_replica_atlas_map(replica);
    assert_int_equal(map->finer_count, 2);
    const lw_tile_id id = lw_atlas_map_claim(map, 0, LW_ATLAS_FINER + 2, 0, 0),
                     below = lw_atlas_map_find(map, 0, 0, 0, 0);
    static float value[LW_TILE_TEXELS_MAX * 3];
    for (size_t i = 0; i < sizeof value / sizeof *value; i++) value[i] = 3;
    struct lw_message_tile tile = {
        .level = LW_ATLAS_FINER + 2, .version = 10, .codec = LW_TILE_CODEC_HALF_ZSTD, .payload = payload};
    uint32_t saturated = 0;
    lw_support_ok(lw_tile_codec_encode_half(w.codec, lw_tile_channel_at(LW_LIGHT_FORM_FULL), value,
                                            map->place[id.v].width, map->place[id.v].height, payload,
                                            lw_tile_codec_bound(), &tile.payload_size, &tile.scale,
                                            &saturated),
                  NULL);
    assert_int_equal(lw_replica_take_tile(plain, &tile, NULL), LW_PROTOCOL); /* it has no such level */
    for (uint64_t version = 10; version < 14; version += 2) {
        tile.version = version;
        lw_support_ok(lw_replica_take_tile(replica, &tile, &err), &err);
        assert_int_equal(lw_replica_get_tile(replica, id).version, version);
        assert_int_equal(lw_replica_get_tile(replica, below).version, 0);
        assert_true(lw_replica_get_tile(replica, id).rgb[0] == 3);
        assert_int_equal(lw_replica_get_level(replica, 0, LW_ATLAS_FINER + 2).width, 0);
        struct lw_message_tile gone = tile;
        gone.version++;
        gone.codec = LW_TILE_CODEC_NONE;
        lw_support_ok(lw_replica_take_tile(replica, &gone, &err), &err);
        assert_int_equal(lw_replica_get_tile(replica, id).version, 0);
    }
    /* what is dropped comes no more, nor does what builds on it, until it has an id again */
    tile.version = 20;
    lw_support_ok(lw_replica_take_tile(replica, &tile, &err), &err);
    lw_replica_release_fine(replica, id);
    tile.version = 21;
    lw_support_ok(lw_replica_take_tile(replica, &tile, &err), &err);
    const lw_tile_id again = lw_atlas_map_claim(map, 0, LW_ATLAS_FINER + 2, 0, 0);
    assert_int_equal(lw_replica_get_tile(replica, again).version, 0);
    tile.version = 22;
    tile.base = 20;
    lw_support_ok(lw_replica_take_tile(replica, &tile, &err), &err);
    assert_int_equal(lw_replica_get_tile(replica, again).version, 0);
    assert_null(lw_replica_get_tile(replica, again).rgb);
    tile.base = 0;
    lw_support_ok(lw_replica_take_tile(replica, &tile, &err), &err);
    assert_int_equal(lw_replica_get_tile(replica, again).version, 22);
    lw_replica_forget_fine(replica); /* a new session */
    assert_int_equal(lw_replica_get_tile(replica, again).version, 0);
    assert_true(lw_atlas_map_is_used(map, again));
    lw_support_ok(lw_replica_take_tile(replica, &tile, &err), &err);
    assert_int_equal(lw_replica_get_tile(replica, again).version, 22);
    tile.tile = 1 << 20;
    assert_int_equal(lw_replica_take_tile(replica, &tile, NULL), LW_PROTOCOL);
    tile.tile = 0;
    tile.level = 0;
    tile.version = 20;
    tile.codec = LW_TILE_CODEC_NONE;
    assert_int_equal(lw_replica_take_tile(replica, &tile, NULL), LW_PROTOCOL);
    lw_replica_destroy(plain);
    lw_replica_destroy(replica);
    free(payload);
    finish_world(&w);
}

static void test_stale_tiles(void **state) {
    (void)state;
    struct world w = make_world();
    struct lw_replica *replica;
    struct lw_error err = {0};
    uint8_t *payload = malloc(lw_tile_codec_bound());
    lw_support_ok(lw_replica_create(w.package, w.package_size, 0, &replica, &err), &err);
    const struct lw_tile_place *p = &w.map.place[0];
    static const struct {
        uint64_t version, expected;
        uint32_t layer;
    } steps[] = {{5, 5, 0}, {5, 5, 0}, {4, 5, 0}, {9, 5, 2}, {6, 6, 0}};
    for (size_t i = 0; i < sizeof steps / sizeof *steps; i++) {
        struct lw_message m = tile_message(&w, 0, steps[i].version, payload);
        m.tile.layer = steps[i].layer;
        lw_support_ok(lw_replica_take_tile(replica, &m.tile, &err), &err);
        assert_int_equal(lw_replica_get_tile(replica, (lw_tile_id){0}).version, steps[i].expected);
        struct lw_client_level level = lw_replica_get_level(replica, p->object, p->level);
        assert_true(level.rgb[0] == value_of(p->object, p->level, 0, 0, 0, steps[i].expected));
    }
    /* the first picture is there with the last coarsest level, whatever the order */
    assert_false(lw_replica_has_first(replica));
    for (uint32_t t = w.map.tile_count; t-- > 0;) {
        const struct lw_tile_place *place = &w.map.place[t];
        bool is_last = place->object == 0 && place->level == w.map.atlas[0].level_count - 1;
        assert_false(lw_replica_has_first(replica));
        struct lw_message m = tile_message(&w, t, 7, payload);
        lw_support_ok(lw_replica_take_tile(replica, &m.tile, &err), &err);
        if (is_last) break;
    }
    assert_true(lw_replica_has_first(replica));
    lw_replica_destroy(replica);
    lw_replica_destroy(NULL);
    free(payload);
    finish_world(&w);
}

/* ---- silence ---- */

/* Polls until the server has news of the interest sets; expects `tiles` level-0 tiles in their union. */
static void expect_wanted(struct lw_server *server, struct lw_client *client, const struct world *w,
                          bool everything, uint32_t tiles) {
    struct lw_server_interest wanted;
    for (uint64_t end_ns = lw_clock_ns() + WAIT_NS; !lw_server_take_interest(server, &wanted);) {
        assert_true(lw_clock_ns() < end_ns);
        lw_support_ok(lw_client_poll(client, 5, NULL), NULL);
    }
    uint32_t count = 0;
    for (uint32_t t = 0; !wanted.everything && t < w->map.tile_count; t++) count += wanted.levels[t] > 0;
    assert_int_equal(wanted.everything, everything);
    assert_int_equal(count, tiles);
    free(wanted.levels);
}

static void test_want(void **state) {
    (void)state;
    struct world w = make_world();
    struct lw_server *server;
    struct lw_client *client;
    struct lw_error err = {0};
    struct lw_server_desc desc = {
        .host = "127.0.0.1", .atlas_map = &w.map, .package = w.package, .package_size = w.package_size};
    lw_support_ok(lw_server_create(&desc, &server, &err), &err);
    pthread_t thread;
    assert_int_equal(pthread_create(&thread, NULL, serve, server), 0);
    lw_support_ok(lw_client_create(&(struct lw_client_desc){.host = "127.0.0.1",
                                                            .port = lw_server_port(server),
                                                            .wants_nothing = true},
                                   &client, &err),
                  &err);
    const lw_tile_id tile[] = {{w.map.first_tile[0] + 1}, {w.map.first_tile[0]}, {w.map.first_tile[0] + 1}},
                     none = {w.map.tile_count};
    assert_int_equal(lw_client_want(client, tile, 1), LW_USAGE); /* there is no scene yet */
    while (!lw_client_scene(client)) lw_support_ok(lw_client_poll(client, 100, &err), &err);
    struct lw_server_interest nothing;
    assert_false(lw_server_take_interest(server, &nothing)); /* not for a moment was everything wanted */
    assert_int_equal(lw_client_want(client, &none, 1), LW_USAGE);
    lw_support_ok(lw_client_want(client, tile, 3), NULL);
    expect_wanted(server, client, &w, false, 2);
    lw_client_want_everything(client);
    expect_wanted(server, client, &w, true, 0);
    lw_support_ok(lw_client_want(client, NULL, 0), NULL);
    expect_wanted(server, client, &w, false, 0);
    struct lw_snapshot *snapshot = make_snapshot(&w, 1);
    lw_server_publish(server, snapshot);
    lw_snapshot_unref(snapshot);
    struct lw_client_stats stats = {0};
    for (uint64_t end_ns = lw_clock_ns() + WAIT_NS; !stats.first_ns; lw_client_get_stats(client, &stats)) {
        assert_true(lw_clock_ns() < end_ns);
        lw_support_ok(lw_client_poll(client, 10, NULL), NULL);
    }
    uint32_t coarsest = 0;
    for (uint32_t o = 0; o < w.map.object_count; o++)
        coarsest += w.map.atlas[o].level_count > 0; /* 200 x 140: the coarsest level is one tile */
    assert_int_equal(stats.tiles, coarsest);
    lw_server_stop(server);
    assert_int_equal(pthread_join(thread, NULL), 0);
    lw_client_destroy(client);
    lw_server_destroy(server);
    finish_world(&w);
}

/* Gives ids to `count` tiles of the finest level of object 0, from number `first` on. */
static void claim(const struct lw_client *client, uint32_t first, uint32_t count, lw_tile_id *out_id) {
    for (uint32_t i = 0; i < count; i++) {
        out_id[i] = lw_atlas_map_claim_tile(lw_client_atlas_map(client), 0,
                                            LW_ATLAS_FINER + LW_ATLAS_FINER_MAX, first + i);
        assert_true(out_id[i].v != UINT32_MAX);
    }
}

/* How many of some tiles have their ids. */
static uint32_t count_used(const struct lw_client *client, const lw_tile_id *id, uint32_t count) {
    uint32_t used = 0;
    for (uint32_t i = 0; i < count; i++) used += lw_atlas_map_is_used(lw_client_atlas_map(client), id[i]);
    return used;
}

/* Tiles of finer levels lose their ids, and their light, once the server was told a list without them; where
 * ids are about to run out, with the next list. A tile that has lost its id may still be listed, and is left
 * out. */
static void test_ids_that_nobody_wants_go(void **state) {
    (void)state;
    enum { MANY = LW_REPLICA_FINE_MAX / 4 * 3 + 1, FEW = 10 };
    struct world w = make_world();
    struct lw_server *server;
    struct lw_client *client;
    struct lw_error err = {0};
    struct lw_atlas_map map;
    lw_support_ok(lw_atlas_map_init_finer(&map, w.scene, LW_ATLAS_FINER_MAX, MANY), NULL);
    struct lw_server_desc desc = {
        .host = "127.0.0.1", .atlas_map = &map, .package = w.package, .package_size = w.package_size};
    lw_support_ok(lw_server_create(&desc, &server, &err), &err);
    pthread_t thread;
    assert_int_equal(pthread_create(&thread, NULL, serve, server), 0);
    lw_support_ok(lw_client_create(&(struct lw_client_desc){.host = "127.0.0.1",
                                                            .port = lw_server_port(server),
                                                            .finer = LW_ATLAS_FINER_MAX,
                                                            .wants_nothing = true},
                                   &client, &err),
                  &err);
    while (!lw_client_scene(client)) lw_support_ok(lw_client_poll(client, 100, &err), &err);
    static lw_tile_id id[MANY];
    claim(client, 0, MANY - 1, id);
    lw_support_ok(lw_client_want(client, id, FEW), NULL);
    assert_int_equal(count_used(client, id, MANY - 1), MANY - 1); /* there are enough */
    struct lw_server_interest wanted = {.everything = true};
    for (uint64_t end_ns = lw_clock_ns() + WAIT_NS; !lw_server_take_interest(server, &wanted);) {
        assert_true(lw_clock_ns() < end_ns);
        lw_support_ok(lw_client_poll(client, 10, NULL), NULL);
    }
    free(wanted.levels);
    assert_int_equal(count_used(client, id, MANY - 1), FEW);
    assert_int_equal(count_used(client, id, FEW), FEW);
    claim(client, 0, MANY, id);
    lw_support_ok(lw_client_want(client, id + MANY - FEW, FEW), NULL);
    assert_int_equal(count_used(client, id, FEW), FEW); /* the server was told of them */
    assert_int_equal(count_used(client, id + MANY - FEW, FEW), FEW);
    assert_int_equal(count_used(client, id, MANY), 2 * FEW);
    assert_int_equal(lw_client_want(client, id, MANY), LW_OK);
    assert_int_equal(count_used(client, id, MANY), 2 * FEW);
    lw_server_stop(server);
    assert_int_equal(pthread_join(thread, NULL), 0);
    lw_client_destroy(client);
    lw_server_destroy(server);
    lw_atlas_map_finish(&map);
    finish_world(&w);
}

static void test_longest_want_fits_the_outbox(void **state) {
    (void)state;
    static const struct lw_message_interest_tile tile[LW_CLIENT_INTEREST_MAX];
    const struct lw_message message = {
        .type = LW_MESSAGE_INTEREST,
        .interest = {.stand_ins = true, .tile = tile, .tile_count = LW_CLIENT_INTEREST_MAX}};
    assert_true(lw_message_size(&message) <= LW_LINK_OUTBOX_SIZE);
}

static void test_silence(void **state) {
    (void)state;
    struct script s = {0};
    struct lw_link link;
    struct lw_error err = {0};
    begin(&s);
    lw_support_ok(
        lw_link_connect(&link, &(struct lw_link_desc){"127.0.0.1", s.port, 1000, false, NULL}, &err), &err);
    uint64_t second = 1000000000, now_ns = lw_clock_ns();
    link.heard_ns = now_ns - (LW_LINK_SILENCE_S - 1) * second;
    link.looked_ns = now_ns;
    lw_support_ok(lw_link_wait(&link, 0, &err), &err);
    link.heard_ns = now_ns - (LW_LINK_SILENCE_S + 1) * second;
    link.looked_ns =
        now_ns - (LW_LINK_PING_S + 1) * second; /* nobody looked for a while: that is no silence */
    lw_support_ok(lw_link_wait(&link, 0, &err), &err);
    link.heard_ns = lw_clock_ns() - (LW_LINK_SILENCE_S + 1) * second;
    char text[100];
    snprintf(text, sizeof text, "127.0.0.1:%u has been silent for 15 s", (unsigned)s.port);
    lw_support_fails(lw_link_wait(&link, 0, &err), LW_TIMED_OUT, &err, text);
    lw_link_finish(&link);
    end(&s);
}

static void test_ping(void **state) {
    (void)state;
    int listener = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    struct sockaddr_in address = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    socklen_t size = sizeof address;
    assert_int_equal(bind(listener, (struct sockaddr *)&address, size), 0);
    assert_int_equal(listen(listener, 1), 0);
    assert_int_equal(getsockname(listener, (struct sockaddr *)&address, &size), 0);
    struct lw_link link;
    struct lw_error err = {0};
    lw_support_ok(
        lw_link_connect(
            &link, &(struct lw_link_desc){"127.0.0.1", ntohs(address.sin_port), 1000, false, NULL}, &err),
        &err);
    int peer = accept(listener, NULL, NULL);
    link.pinged_ns = lw_clock_ns() - LW_LINK_PING_S * 1000000000ull;
    lw_support_ok(lw_link_wait(&link, 0, &err), &err);
    uint8_t bytes[100];
    ssize_t got = recv(peer, bytes, sizeof bytes, 0);
    assert_true(got > 8);
    assert_int_equal(bytes[4], LW_MESSAGE_PING);
    struct pollfd wait = {.fd = peer, .events = POLLIN};
    lw_support_ok(lw_link_wait(&link, 0, &err), &err);
    assert_int_equal(poll(&wait, 1, 0), 0); /* one is enough for now */
    close(peer);
    close(listener);
    lw_link_finish(&link);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_session),
        cmocka_unit_test(test_updates),
        cmocka_unit_test(test_spares),
        cmocka_unit_test(test_no_server),
        cmocka_unit_test(test_not_a_lightwelld),
        cmocka_unit_test(test_refused),
        cmocka_unit_test(test_unknown_types_are_skipped),
        cmocka_unit_test(test_waiting),
        cmocka_unit_test(test_waiting_for_what_is_new),
        cmocka_unit_test(test_what_comes_with_the_welcome),
        cmocka_unit_test(test_reconnect),
        cmocka_unit_test(test_draws),
        cmocka_unit_test(test_who_stopped_reading_comes_back),
        cmocka_unit_test(test_cache),
        cmocka_unit_test(test_parts),
        cmocka_unit_test(test_a_package_in_the_cache),
        cmocka_unit_test(test_finishes),
        cmocka_unit_test(test_cached_finishes),
        cmocka_unit_test(test_finishes_of_another_session),
        cmocka_unit_test(test_damaged_finishes),
        cmocka_unit_test(test_finishes_go_on),
        cmocka_unit_test(test_backoff),
        cmocka_unit_test(test_download_goes_on),
        cmocka_unit_test(test_a_download_that_a_folder_ends),
        cmocka_unit_test(test_a_welcome_that_fails),
        cmocka_unit_test(test_damaged_package),
        cmocka_unit_test(test_forms_out_of_place),
        cmocka_unit_test(test_messages_out_of_place),
        cmocka_unit_test(test_tiles_that_build_on_others),
        cmocka_unit_test(test_bytes_gone_wrong),
        cmocka_unit_test(test_tiles_of_finer_levels),
        cmocka_unit_test(test_stale_tiles),
        cmocka_unit_test(test_want),
        cmocka_unit_test(test_ids_that_nobody_wants_go),
        cmocka_unit_test(test_longest_want_fits_the_outbox),
        cmocka_unit_test(test_silence),
        cmocka_unit_test(test_ping),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
