#include "tests/support/client_case.h"

#include "client/lib/client.h"
#include "client/lib/replica.h"
#include "common/tile/tile_codec.h"
#include "server/serve/server.h"

#include <stdlib.h>
#include <sys/socket.h>

/* Tiles: of two channels, as differences, of finer levels, stale. */

/* ---- against our own server ---- */

#define SPLIT_OFF 10u /* versions, by which the light of split tiles looks newer than it is */

/* Adds split tiles, which hold other light. */
static struct lw_snapshot *add_split(const struct client_case_world *w, struct lw_snapshot *snapshot) {
    uint8_t *payload = malloc(lw_tile_codec_bound());
    snapshot->channels |= 1u << LW_TILE_CHANNEL_SPLIT;
    snapshot->tile[LW_TILE_CHANNEL_SPLIT] = calloc(w->map.tile_count, sizeof(struct lw_snapshot_tile));
    for (uint32_t t = 0; t < w->map.tile_count; t++) {
        struct lw_snapshot_tile *tile = &snapshot->tile[LW_TILE_CHANNEL_SPLIT][t];
        struct lw_message m = client_case_tile_message(w, t, snapshot->frame + SPLIT_OFF, payload);
        m.tile.layer = LW_TILE_CHANNEL_SPLIT;
        m.tile.version = tile->version = snapshot->frame;
        lw_support_ok(lw_blob_from_message(&m, &tile->blob), NULL);
    }
    free(payload);
    return snapshot;
}

/* ---- coming back ---- */

static const uint8_t drawn_lights[] = {1}, drawn_materials[] = {2};

static struct client_case_running start_drawn(const struct client_case_world *w, uint16_t port) {
    return client_case_start_server_with(w, (struct lw_server_desc){.port = port,
                                                                    .client_lights = drawn_lights,
                                                                    .client_lights_size = 1,
                                                                    .client_materials = drawn_materials,
                                                                    .client_materials_size = 1});
}

/* Clients that draw take channel 1, others channel 0. A tile of one never counts for the other channel. */
static void test_draws(void **state) {
    (void)state;
    struct client_case_world w = client_case_make_world();
    struct lw_client *plain, *client;
    struct lw_client_stats stats;
    struct lw_error err = {0};
    assert_true(w.scene->light_count >= 1 && w.scene->material_count >= 2);
    struct client_case_running r = start_drawn(&w, 0);
    const uint16_t port = lw_server_port(r.server);
    struct lw_snapshot *seventh = client_case_make_snapshot(&w, 7);
    client_case_publish(&r, lw_snapshot_ref(seventh));
    struct lw_client_desc desc = {.host = "127.0.0.1", .port = port};
    lw_support_ok(lw_client_create(&desc, &plain, &err), &err);
    desc.draws_direct = true;
    lw_support_ok(lw_client_create(&desc, &client, &err), &err);
    assert_null(lw_client_draws(client)); /* there is no scene yet */
    client_case_poll_until_tiles(plain, w.map.tile_count);
    assert_null(lw_client_draws(plain));
    while (!lw_client_scene(client)) lw_support_ok(lw_client_poll(client, 100, &err), &err);
    const struct lw_client_draws *draws = lw_client_draws(client);
    assert_int_equal(draws->light_count, w.scene->light_count);
    assert_int_equal(draws->material_count, w.scene->material_count);
    for (uint32_t i = 0; i < draws->light_count; i++) assert_int_equal(draws->light[i], i == 0);
    for (uint32_t i = 0; i < draws->material_count; i++) assert_int_equal(draws->material[i], i == 1);
    lw_support_ok(lw_client_poll(client, 20, &err), &err);
    lw_client_get_stats(client, &stats);
    assert_int_equal(stats.frame, 0); /* nobody took this channel before */
    struct lw_snapshot *eighth = add_split(&w, client_case_make_snapshot(&w, 8));
    client_case_publish(&r, lw_snapshot_ref(eighth));
    client_case_poll_until_tiles(client, w.map.tile_count);
    client_case_poll_until_tiles(plain, 2 * w.map.tile_count);
    for (uint32_t t = 0; t < w.map.tile_count; t++) {
        client_case_expect_texels(client, &w, t, 8 + SPLIT_OFF);
        client_case_expect_tile(plain, &w, t, 8);
    }
    /* the link breaks: no tile that the client has is sent again, though the other channel had version 7 too
     * */
    assert_int_equal(shutdown(lw_client_descriptor(client), SHUT_RDWR), 0);
    client_case_lose_connection(client);
    lw_support_ok(lw_client_reconnect(client, &err), &err);
    assert_non_null(lw_client_draws(client));
    lw_support_ok(lw_client_poll(client, 100, &err), &err);
    lw_support_ok(lw_client_poll(client, 100, &err), &err);
    lw_client_get_stats(client, &stats);
    assert_int_equal(stats.tiles, w.map.tile_count);
    /* a server that has no client lights: tiles lack light that nobody draws now */
    client_case_stop_server(&r);
    client_case_lose_connection(client);
    r = client_case_start_server(&w, port);
    lw_support_ok(lw_client_reconnect(client, &err), &err);
    assert_null(lw_client_draws(client));
    for (uint32_t t = 0; t < w.map.tile_count; t++) client_case_expect_tile(client, &w, t, 0);
    client_case_publish(&r, client_case_make_snapshot(&w, 2));
    client_case_poll_until_tiles(client, 2 * w.map.tile_count);
    for (uint32_t t = 0; t < w.map.tile_count; t++) {
        client_case_expect_texels(client, &w, t, 2);
        assert_true(lw_client_get_tile(client, (lw_tile_id){t}).version > 8); /* they go on growing */
    }
    lw_snapshot_unref(seventh);
    lw_snapshot_unref(eighth);
    lw_client_destroy(client);
    lw_client_destroy(plain);
    client_case_stop_server(&r);
    client_case_finish_world(&w);
}

/* ---- against a peer that reads from a script ---- */

/* Light that the client would count twice, or miss, ends the session; so does what no scene has. */
static void test_channels_out_of_place(void **state) {
    (void)state;
    struct client_case_world w = client_case_make_world();
    struct client_case_script s = {0};
    uint8_t *payload = malloc(lw_tile_codec_bound());
    struct lw_message tile = client_case_tile_message(&w, 0, 1, payload), plain = client_case_welcome_of(&w),
                      draws = plain;
    draws.welcome.features = LW_FEATURE_DRAWS;
    draws.welcome.client_lights = drawn_lights;
    draws.welcome.client_lights_size = 1;
    client_case_say(&s, &draws);
    client_case_say_package(&s, &w);
    client_case_expect_failure(&s, LW_PROTOCOL, "draws direct light, which was not offered", false);
    client_case_say(&s, &draws);
    client_case_say_package(&s, &w);
    client_case_say(&s, &tile);
    client_case_expect_failure_of(&s, true, LW_PROTOCOL, "it is of layer 0 in a session that gets layer 1",
                                  true);
    tile.tile.layer = LW_TILE_CHANNEL_SPLIT;
    for (int i = 0; i < 2; i++) {
        client_case_say(&s, &plain);
        client_case_say_package(&s, &w);
        client_case_say(&s, &tile);
        client_case_expect_failure_of(&s, i, LW_PROTOCOL, "it is of layer 1 in a session that gets layer 0",
                                      true);
    }
    uint8_t bits[LW_SCENE_LIGHTS_MAX / 8] = {0};
    const uint32_t lights = w.scene->light_count, materials = w.scene->material_count;
    bits[lights / 8] = (uint8_t)(1u << lights % 8);
    draws.welcome.client_lights = bits;
    draws.welcome.client_lights_size = lights / 8 + 1;
    client_case_say(&s, &draws);
    client_case_say_package(&s, &w);
    client_case_expect_failure_of(&s, true, LW_PROTOCOL, "client_lights has light", true);
    bits[lights / 8] = 0;
    bits[materials / 8] = (uint8_t)(1u << materials % 8);
    draws.welcome.client_lights = NULL;
    draws.welcome.client_lights_size = 0;
    draws.welcome.client_materials = bits;
    draws.welcome.client_materials_size = LW_SCENE_MATERIALS_MAX / 8; /* many bytes, that are 0 */
    client_case_say(&s, &draws);
    client_case_say_package(&s, &w);
    client_case_expect_failure_of(&s, true, LW_PROTOCOL, "client_materials has material", true);
    free(payload);
    client_case_finish_world(&w);
}

/* ---- the replica by itself ---- */

/* A delta looks as the same version sent whole; on another version, or on a tile of codec 1, it is
 * refused. */
static void test_tiles_that_build_on_others(void **state) {
    (void)state;
    struct client_case_world w = client_case_make_world();
    struct lw_replica *replica, *late;
    struct lw_error err = {0};
    uint8_t *payload = malloc(lw_tile_codec_bound()), *delta = malloc(lw_tile_codec_bound());
    lw_support_ok(lw_replica_create(w.package, w.package_size, 0, &replica, &err), &err);
    lw_support_ok(lw_replica_create(w.package, w.package_size, 0, &late, &err), &err);
    static struct lw_tile_dct_history history;
    static float rgb[LW_TILE_TEXELS_MAX * 3];
    const struct lw_tile_place *p = &w.map.place[0];
    struct lw_message m = client_case_tile_message(&w, 0, 10, payload); /* for its names */
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
    struct lw_message_tile half = client_case_tile_message(&w, 0, 20, payload).tile;
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
    client_case_finish_world(&w);
}

/* A tile of a finer level has a place of its own, is withdrawn, and comes again; of other levels none is. */
static void test_tiles_of_finer_levels(void **state) {
    (void)state;
    struct client_case_world w = client_case_make_world();
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
    lw_support_ok(lw_tile_codec_encode_half(w.codec, lw_tile_channel_at(LW_TILE_CHANNEL_FULL), value,
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
    /* a dropped tile comes no more, nor do its deltas, until it has an id again */
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
    client_case_finish_world(&w);
}

static void test_stale_tiles(void **state) {
    (void)state;
    struct client_case_world w = client_case_make_world();
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
        struct lw_message m = client_case_tile_message(&w, 0, steps[i].version, payload);
        m.tile.layer = steps[i].layer;
        lw_support_ok(lw_replica_take_tile(replica, &m.tile, &err), &err);
        assert_int_equal(lw_replica_get_tile(replica, (lw_tile_id){0}).version, steps[i].expected);
        struct lw_client_level level = lw_replica_get_level(replica, p->object, p->level);
        assert_true(level.rgb[0] == client_case_value_of(p->object, p->level, 0, 0, 0, steps[i].expected));
    }
    /* the first picture is there with the last coarsest level, whatever the order */
    assert_false(lw_replica_has_first(replica));
    for (uint32_t t = w.map.tile_count; t-- > 0;) {
        const struct lw_tile_place *place = &w.map.place[t];
        bool is_last = place->object == 0 && place->level == w.map.atlas[0]->level_count - 1;
        assert_false(lw_replica_has_first(replica));
        struct lw_message m = client_case_tile_message(&w, t, 7, payload);
        lw_support_ok(lw_replica_take_tile(replica, &m.tile, &err), &err);
        if (is_last) break;
    }
    assert_true(lw_replica_has_first(replica));
    lw_replica_destroy(replica);
    lw_replica_destroy(NULL);
    free(payload);
    client_case_finish_world(&w);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_draws),
        cmocka_unit_test(test_channels_out_of_place),
        cmocka_unit_test(test_tiles_that_build_on_others),
        cmocka_unit_test(test_tiles_of_finer_levels),
        cmocka_unit_test(test_stale_tiles),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
