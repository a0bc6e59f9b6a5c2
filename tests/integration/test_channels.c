/* A channel that only this file knows, signed and of two planes, goes the way of every other: from a solver
 * by publisher, server and wire to a client, and by the golden messages to the page
 * (client/web/test/channels.test.mjs). */
#include "tests/support/support.h"

#include "client/lib/client.h"
#include "client/lib/replica.h"
#include "common/base/clock.h"
#include "common/tile/tile_codec.h"
#include "server/publish/publisher.h"
#include "server/publish/saved_light.h"
#include "server/serve/server.h"

#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define WAIT_NS 600000000000u /* ends what hangs */
#define FEATURE ((uint64_t)1 << 20)
#define MADE_UP 4u /* its number */
#define SLOT    1u
#define PLANES  2u

/* ---- the table: ours, and one more ---- */

const struct lw_tile_channels *__real_lw_tile_channels(void);
const struct lw_tile_channels *__wrap_lw_tile_channels(void);

static struct lw_tile_channels table;

const struct lw_tile_channels *__wrap_lw_tile_channels(void) {
    if (table.count) return &table;
    table = *__real_lw_tile_channels();
    assert_int_equal(table.count, MADE_UP);
    table.channel[table.count++] = (struct lw_tile_channel){.name = "drift",
                                                            .unit = "m/s",
                                                            .meaning = "nothing that there is",
                                                            .planes = PLANES,
                                                            .is_signed = true,
                                                            .coding = LW_TILE_CODING_PLAIN,
                                                            .step = 1,
                                                            .asked = FEATURE,
                                                            .asks = FEATURE,
                                                            .slot = SLOT};
    return &table;
}

/* ---- a solver that has it ---- */

static uint64_t now; /* frame */

static float light_at(uint32_t object, uint32_t x, uint32_t y, uint32_t plane) {
    return 1 + 0.02f * (float)x + 0.01f * (float)y + (float)(plane + object) + 0.25f * (float)now;
}

/* From -5 to 5, and the planes apart. */
static float drift_at(uint32_t object, uint32_t x, uint32_t y, uint32_t plane) {
    const float phase = 0.2f * (float)x + 0.15f * (float)y + (float)(plane + object) + 0.3f * (float)now;
    return (plane ? 2 : 5) * sinf(phase);
}

static const struct lw_atlas_map *solved_map;

static void read_tile(const struct lw_solver *solver, lw_tile_id id, struct lw_solver_tile *tile) {
    static float light[3][LW_TILE_TEXELS_MAX], drift[PLANES][LW_TILE_TEXELS_MAX];
    static const float nothing[LW_TILE_TEXELS_MAX];
    static uint8_t covered[LW_TILE_TEXELS_MAX];
    const struct lw_tile_place *p = &solved_map->place[id.v];
    (void)solver;
    memset(covered, 1, sizeof covered);
    for (uint32_t i = 0; i < p->width * p->height; i++) {
        const uint32_t x = p->x * LW_TILE_SIDE + i % p->width, y = p->y * LW_TILE_SIDE + i / p->width;
        for (uint32_t c = 0; c < 3; c++) light[c][i] = light_at(p->object, x, y, c);
        for (uint32_t c = 0; c < PLANES; c++) drift[c][i] = drift_at(p->object, x, y, c);
    }
    *tile = (struct lw_solver_tile){
        .shown = {[LW_TILE_CHANNEL_FULL] = {light[0], light[1], light[2]}, [MADE_UP] = {drift[0], drift[1]}},
        .direct = {light[0], light[1], light[2]},
        .indirect = {nothing, nothing, nothing},
        .covered = covered,
        .width = p->width,
        .height = p->height,
        .bounces = 2,
        .sample_count = 1,
        .error = 0.02f,
        .solved_frame = now,
        .has_surface = true};
}

static const struct lw_solver_ops ops = {.name = "made up", .read_tile = read_tile};

/* ---- a world with a server ---- */

struct world {
    struct lw_scene *scene;
    struct lw_atlas_map map;
    struct lw_pose pose;
    struct lw_solver solver;
    struct lw_publisher *publisher;
    uint8_t *package;
    size_t package_size;
    struct lw_server *server;
    pthread_t thread;
};

static void *serve(void *server) {
    lw_support_ok(lw_server_run(server, NULL), NULL);
    return NULL;
}

static void init_world(struct world *w, uint32_t codec) {
    struct lw_error err = {0};
    *w = (struct world){.scene = lw_support_everything(), .solver = {&ops}};
    for (uint32_t i = 0; i < w->scene->mesh_count; i++)
        if (w->scene->mesh[i].atlas_width)
            w->scene->mesh[i].atlas_width = w->scene->mesh[i].atlas_height = 100;
    lw_support_ok(lw_atlas_map_init(&w->map, w->scene), NULL);
    solved_map = &w->map;
    lw_support_ok(lw_pose_init(&w->pose, w->scene), NULL);
    lw_support_ok(lw_package_write(w->scene, &w->package, &w->package_size, &err), &err);
    lw_support_ok(lw_publisher_create(&(struct lw_publisher_desc){.scene = w->scene,
                                                                  .atlas_map = &w->map,
                                                                  .solver = &w->solver,
                                                                  .target_error = 0.02f,
                                                                  .codec = codec,
                                                                  .threads = 1},
                                      &w->publisher),
                  NULL);
    lw_support_ok(lw_publisher_set_channels(w->publisher, 1u << LW_TILE_CHANNEL_FULL | 1u << MADE_UP), NULL);
    const struct lw_server_desc desc = {.host = "127.0.0.1",
                                        .atlas_map = &w->map,
                                        .package = w->package,
                                        .package_size = w->package_size,
                                        .channels = 1u << MADE_UP,
                                        .features = codec == LW_TILE_CODEC_DCT ? LW_FEATURE_DCT : 0};
    lw_support_ok(lw_server_create(&desc, &w->server, &err), &err);
    assert_int_equal(pthread_create(&w->thread, NULL, serve, w->server), 0);
}

static void finish_world(struct world *w) {
    lw_server_stop(w->server);
    assert_int_equal(pthread_join(w->thread, NULL), 0);
    lw_server_destroy(w->server);
    lw_publisher_destroy(w->publisher);
    free(w->package);
    lw_pose_finish(&w->pose);
    lw_atlas_map_finish(&w->map);
    lw_scene_destroy(w->scene);
}

static struct lw_snapshot *publish(struct world *w, uint64_t frame) {
    struct lw_snapshot *snapshot;
    struct lw_publisher_stats stats;
    now = frame;
    lw_support_ok(lw_publisher_publish(w->publisher, &w->pose, frame, 1, 1, 1, &snapshot, &stats), NULL);
    assert_int_equal(stats.saturated, 0);
    lw_server_publish(w->server, snapshot);
    return snapshot;
}

static struct lw_client *join(const struct world *w, uint64_t channel_features) {
    struct lw_client *client;
    struct lw_error err = {0};
    lw_support_ok(lw_client_create(&(struct lw_client_desc){.host = "127.0.0.1",
                                                            .port = lw_server_port(w->server),
                                                            .channel_features = channel_features},
                                   &client, &err),
                  &err);
    return client;
}

/* Until all of a frame has come. */
static void hear(struct lw_client *client, uint64_t frame) {
    struct lw_client_stats stats;
    struct lw_error err = {0};
    const uint64_t end_ns = lw_clock_ns() + WAIT_NS;
    do {
        assert_true(lw_clock_ns() < end_ns);
        lw_support_ok(lw_client_poll(client, 100, &err), &err);
        lw_client_get_stats(client, &stats);
    } while (stats.settled_frame != frame);
}

/* Root mean square of the error of a level's planes, over that of the right values. */
static double error_of(const struct lw_atlas_level *level, uint32_t object, uint32_t up, uint32_t planes,
                       const float *texels, float (*value)(uint32_t, uint32_t, uint32_t, uint32_t)) {
    double off = 0, all = 0;
    /* look-ups beyond the atlas's edge do not read the texels below */
    for (uint32_t y = 0; y + 1 < level->height; y++)
        for (uint32_t x = 0; x + 1 < level->width; x++)
            for (uint32_t p = 0; p < planes; p++) {
                double sum = 0;
                for (uint32_t v = y << up; v < (y + 1) << up; v++)
                    for (uint32_t u = x << up; u < (x + 1) << up; u++) sum += (double)value(object, u, v, p);
                const double expected = sum / (1u << 2 * up),
                             d = (double)texels[(y * level->width + x) * planes + p] - expected;
                off += d * d;
                all += expected * expected;
            }
    return sqrt(off / all);
}

/* drift: of its largest size; light: of a logarithm. Held values may be off by a part of a step. */
static void expect_all(const struct world *w, const struct lw_client *client, double drift_most,
                       double light_most) {
    for (uint32_t o = 0; o < w->map.object_count; o++)
        for (uint32_t l = 0; l < 2 && l < w->map.atlas[o]->level_count; l++) {
            const struct lw_atlas_level *level = &w->map.atlas[o]->level[l];
            const float *drift = lw_client_get_texels(client, SLOT, o, l);
            assert_non_null(drift);
            const double drift_error = error_of(level, o, l, PLANES, drift, drift_at),
                         light_error =
                             error_of(level, o, l, 3, lw_client_get_level(client, o, l).rgb, light_at);
            if (drift_error > drift_most || light_error > light_most)
                fail_msg("%g, %g", drift_error, light_error);
        }
}

static void follow(uint32_t codec, double drift_most, double light_most) {
    struct world w;
    init_world(&w, codec);
    struct lw_client *asks = join(&w, FEATURE), *knows_nothing = join(&w, 0);
    uint32_t deltas = 0;
    for (uint64_t frame = 1; frame <= 3; frame++) {
        struct lw_snapshot *snapshot = publish(&w, frame);
        for (uint32_t t = 0; t < w.map.tile_count; t++) deltas += snapshot->tile[MADE_UP][t].delta != NULL;
        hear(asks, frame);
        hear(knows_nothing, frame);
        expect_all(&w, asks, drift_most, light_most);
        lw_snapshot_unref(snapshot);
    }
    assert_true(codec == LW_TILE_CODEC_DCT ? deltas > 0 : !deltas);
    struct lw_client_stats stats[2];
    lw_client_get_stats(asks, &stats[0]);
    lw_client_get_stats(knows_nothing, &stats[1]);
    assert_int_equal(stats[1].tiles, 3 * w.map.tile_count);
    assert_int_equal(stats[0].tiles, 2 * stats[1].tiles);
    assert_null(lw_client_get_texels(knows_nothing, SLOT, 0, 0));
    lw_client_destroy(asks);
    lw_client_destroy(knows_nothing);
    finish_world(&w);
}

static void by_cosines(void **state) {
    (void)state;
    /* a step is of a scale of 8; sizes of 5 and 2 are so large in the root mean square */
    const double off = (double)(LW_TILE_DCT_HOLD * LW_PUBLISHER_STEP_MIN), size = sqrt((25 + 4) / 4.0);
    follow(LW_TILE_CODEC_DCT, off * 8 / size, off * M_LN2);
}

static void by_halves(void **state) {
    (void)state;
    follow(LW_TILE_CODEC_HALF_ZSTD, 0x1p-11, 0x1p-11);
}

/* The table says that it is not kept. */
static void is_not_kept(void **state) {
    (void)state;
    struct world w;
    struct lw_error err = {0};
    const uint8_t key[LW_SAVED_LIGHT_KEY_SIZE] = {1};
    const char *path = lw_support_temporary("channels");
    init_world(&w, LW_TILE_CODEC_DCT);
    struct lw_snapshot *snapshot = publish(&w, 1), *again;
    lw_support_ok(lw_saved_light_save(path, key, snapshot, true, &err), &err);
    lw_support_ok(lw_saved_light_load(path, key, &w.map, 0.02f, &again, &err), &err);
    assert_int_equal(again->channels, 1u << LW_TILE_CHANNEL_FULL);
    table.channel[MADE_UP].kept = true;
    lw_support_ok(lw_saved_light_save(path, key, snapshot, true, &err), &err);
    lw_snapshot_unref(again);
    lw_support_ok(lw_saved_light_load(path, key, &w.map, 0.02f, &again, &err), &err);
    assert_int_equal(again->channels, 1u << LW_TILE_CHANNEL_FULL | 1u << MADE_UP);
    assert_int_equal(again->tile[MADE_UP][0].blob->size, snapshot->tile[MADE_UP][0].blob->size);
    table.channel[MADE_UP].kept = false;
    lw_snapshot_unref(again);
    lw_snapshot_unref(snapshot);
    finish_world(&w);
}

/* ---- the codecs alone ---- */

/* A signed channel is what its sign says in both codecs; an unsigned one refuses. */
static void signs(void **state) {
    (void)state;
    struct lw_tile_channel bare = *lw_tile_channel_at(MADE_UP), *unsigned_one = &bare;
    float values[8 * 8 * PLANES], back[8 * 8 * PLANES], scale;
    struct lw_tile_codec *codec;
    size_t size;
    uint32_t saturated;
    unsigned_one->is_signed = false;
    lw_support_ok(lw_tile_codec_create(&codec), NULL);
    uint8_t *payload = malloc(lw_tile_codec_bound()), *delta = malloc(lw_tile_codec_bound());
    for (uint32_t i = 0; i < 8 * 8 * PLANES; i++) values[i] = i % 2 ? -3 : 0.5f;
    const struct lw_tile_channel *channel = lw_tile_channel_at(MADE_UP);
    lw_support_ok(lw_tile_codec_encode_half(codec, channel, values, 8, 8, payload, lw_tile_codec_bound(),
                                            &size, &scale, &saturated),
                  NULL);
    assert_int_equal(saturated, 0);
    lw_support_ok(
        lw_tile_codec_decode(codec, channel, LW_TILE_CODEC_HALF_ZSTD, payload, size, scale, 8, 8, NULL, back),
        NULL);
    assert_memory_equal(values, back, sizeof values);
    assert_int_equal(lw_tile_codec_decode(codec, unsigned_one, LW_TILE_CODEC_HALF_ZSTD, payload, size, scale,
                                          8, 8, NULL, back),
                     LW_BAD_DATA);
    assert_int_equal(
        lw_tile_codec_decode(codec, NULL, LW_TILE_CODEC_HALF_ZSTD, payload, size, scale, 8, 8, NULL, back),
        LW_BAD_DATA);
    struct lw_tile_dct_coded coded;
    lw_support_ok(lw_tile_codec_encode_dct(
                      codec,
                      &(struct lw_tile_dct_source){
                          .rgb = values, .width = 8, .height = 8, .step = 0x1p-7f, .channel = unsigned_one},
                      NULL, payload, delta, lw_tile_codec_bound(), &coded),
                  NULL);
    assert_int_equal(coded.saturated, 8 * 8);
    lw_support_ok(lw_tile_codec_decode(codec, unsigned_one, LW_TILE_CODEC_DCT, payload, coded.size,
                                       coded.scale, 8, 8, NULL, back),
                  NULL);
    for (uint32_t i = 0; i < 8 * 8 * PLANES; i++) assert_true(back[i] >= 0);
    values[0] = NAN, values[1] = INFINITY;
    lw_support_ok(lw_tile_codec_encode_dct(
                      codec,
                      &(struct lw_tile_dct_source){
                          .rgb = values, .width = 8, .height = 8, .step = 0x1p-7f, .channel = channel},
                      NULL, payload, delta, lw_tile_codec_bound(), &coded),
                  NULL);
    assert_int_equal(coded.saturated, 2);
    payload[3] = 1; /* a gain, which plain values do not have */
    assert_int_equal(lw_tile_codec_decode(codec, channel, LW_TILE_CODEC_DCT, payload, coded.size, coded.scale,
                                          8, 8, NULL, back),
                     LW_BAD_DATA);
    free(delta);
    free(payload);
    lw_tile_codec_destroy(codec);
}

/* ---- golden: TILE messages, and what they hold; `test_channels write` makes them ---- */

#define SIDE 20u /* cut-off blocks */

struct golden {
    uint8_t *messages;
    size_t size;
    float values[3][SIDE * SIDE * PLANES];
};

static void add_message(struct golden *g, struct lw_message_tile tile) {
    const struct lw_message message = {.type = LW_MESSAGE_TILE, .tile = tile};
    size_t size;
    lw_support_ok(lw_message_encode(&message, g->messages + g->size, lw_message_size(&message), &size), NULL);
    g->size += size;
}

/* Version 1 whole and 2 as a delta, in codec 4; 3 in codec 1. */
static void make_golden(struct golden *g) {
    static struct lw_tile_dct_history history;
    static struct lw_tile_dct_coefficients coefficients;
    static float values[SIDE * SIDE * PLANES];
    const struct lw_tile_channel *channel = lw_tile_channel_at(MADE_UP);
    struct lw_tile_codec *codec;
    struct lw_tile_dct_coded coded;
    lw_support_ok(lw_tile_codec_create(&codec), NULL);
    uint8_t *payload = malloc(lw_tile_codec_bound()), *delta = malloc(lw_tile_codec_bound()),
            *first = malloc(lw_tile_codec_bound()), *jump = malloc(lw_tile_codec_bound());
    size_t first_size = 0, size;
    *g = (struct golden){.messages = malloc(3 * lw_tile_codec_bound())};
    struct lw_message_tile tile = {.layer = MADE_UP, .bounces = 2, .error = 0.125f};
    for (uint64_t version = 1; version <= 3; version++) {
        now = version;
        for (uint32_t i = 0; i < SIDE * SIDE * PLANES; i++)
            values[i] = drift_at(0, i / PLANES % SIDE, i / PLANES / SIDE, i % PLANES);
        tile.version = version;
        tile.base = version == 2;
        if (version == 3) {
            uint32_t saturated;
            lw_support_ok(lw_tile_codec_encode_half(codec, channel, values, SIDE, SIDE, payload,
                                                    lw_tile_codec_bound(), &size, &tile.scale, &saturated),
                          NULL);
            tile.codec = LW_TILE_CODEC_HALF_ZSTD;
            tile.payload = payload, tile.payload_size = size;
            lw_support_ok(lw_tile_codec_decode(codec, channel, tile.codec, payload, size, tile.scale, SIDE,
                                               SIDE, NULL, g->values[2]),
                          NULL);
            add_message(g, tile);
            break;
        }
        const struct lw_tile_dct_source source = {
            .rgb = values, .width = SIDE, .height = SIDE, .step = 0x1p-5f, .channel = channel};
        lw_support_ok(
            lw_tile_codec_encode_dct(codec, &source, &history, payload, delta, lw_tile_codec_bound(), &coded),
            NULL);
        assert_int_equal(coded.delta_size > 0, version == 2);
        tile.codec = LW_TILE_CODEC_DCT;
        tile.scale = coded.scale;
        tile.payload = version == 2 ? delta : payload;
        tile.payload_size = version == 2 ? coded.delta_size : coded.size;
        lw_support_ok((version == 2 ? lw_tile_codec_decode_delta : lw_tile_codec_decode)(
                          codec, channel, tile.codec, tile.payload, tile.payload_size, tile.scale, SIDE, SIDE,
                          &coefficients, g->values[version - 1]),
                      NULL);
        add_message(g, tile);
        if (version == 1) {
            memcpy(first, payload, first_size = coded.size);
            continue;
        }
        /* between two payloads: the same bytes as the delta, since the history had the first one */
        lw_support_ok(lw_tile_codec_encode_between(codec, channel, first, first_size, payload, coded.size,
                                                   SIDE, SIDE, jump, lw_tile_codec_bound(), &size),
                      NULL);
        assert_int_equal(size, coded.delta_size);
        assert_memory_equal(jump, delta, size);
    }
    free(jump);
    free(first);
    free(delta);
    free(payload);
    lw_tile_codec_destroy(codec);
}

static bool writes_golden;

static const char *golden_path(const char *name) {
    char relative[64];
    snprintf(relative, sizeof relative, "tests/golden/channels/%s", name);
    return lw_support_source(relative);
}

static void write_file(const char *name, const void *bytes, size_t size) {
    FILE *file = fopen(golden_path(name), "wb");
    assert_non_null(file);
    assert_int_equal(fwrite(bytes, 1, size, file), size);
    assert_int_equal(fclose(file), 0);
}

/* What the files' messages decode to, bit for bit, here and in the page. */
static void golden(void **state) {
    (void)state;
    static struct golden g;
    static struct lw_tile_dct_coefficients coefficients;
    static float values[SIDE * SIDE * PLANES];
    const struct lw_tile_channel *channel = lw_tile_channel_at(MADE_UP);
    make_golden(&g);
    if (writes_golden) {
        write_file("drift.bin", g.messages, g.size);
        write_file("drift.values", g.values, sizeof g.values);
    }
    free(g.messages);
    size_t size, values_size;
    uint8_t *bytes = lw_support_read_file(golden_path("drift.bin"), &size), *at = bytes;
    uint8_t *expected = lw_support_read_file(golden_path("drift.values"), &values_size);
    struct lw_tile_codec *codec;
    lw_support_ok(lw_tile_codec_create(&codec), NULL);
    for (uint64_t version = 1; version <= 3; version++) {
        struct lw_framing_header header;
        struct lw_message m;
        lw_support_ok(lw_framing_read_header(at, LW_FRAMING_BODY_MAX, &header, NULL), NULL);
        lw_support_ok(lw_message_decode(header, at + LW_FRAMING_HEADER_SIZE, &m, NULL), NULL);
        at += LW_FRAMING_HEADER_SIZE + header.body_size;
        assert_true(m.type == LW_MESSAGE_TILE && m.tile.layer == MADE_UP && m.tile.version == version);
        lw_support_ok((m.tile.base ? lw_tile_codec_decode_delta : lw_tile_codec_decode)(
                          codec, channel, m.tile.codec, m.tile.payload, m.tile.payload_size, m.tile.scale,
                          SIDE, SIDE, &coefficients, values),
                      NULL);
        lw_message_finish(&m);
        assert_memory_equal(values, expected + (version - 1) * sizeof values, sizeof values);
        now = version;
        const struct lw_atlas_level level = {.width = SIDE, .height = SIDE};
        assert_true(error_of(&level, 0, 0, PLANES, values, drift_at) < 0.02);
    }
    assert_ptr_equal(at, bytes + size);
    assert_int_equal(values_size, 3 * sizeof values);
    lw_tile_codec_destroy(codec);
    free(expected);
    free(bytes);
}

int main(int argc, char **argv) {
    writes_golden = argc > 1 && strcmp(argv[1], "write") == 0;
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(golden),    cmocka_unit_test(signs),       cmocka_unit_test(by_cosines),
        cmocka_unit_test(by_halves), cmocka_unit_test(is_not_kept),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
