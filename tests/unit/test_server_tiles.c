#include "tests/support/serving.h"

#include "common/base/clock.h"
#include "common/base/waiting.h"
#include "common/tile/tile_codec.h"
#include "server/serve/server.h"
#include "tests/support/server_clock.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* Tiles: the newest, as differences, in the order of what changed most, within a rate. */

/* ---- a peer ---- */

/* Reads on until that frame is announced. */
static void wait_for_frame(int s, uint64_t frame) {
    for (bool framed = false; !framed;) {
        struct lw_message m;
        assert_true(serving_get(s, &m));
        framed = m.type == LW_MESSAGE_FRAME && m.frame.frame == frame;
        lw_message_finish(&m);
    }
}

/* ---- joining ---- */

static void test_newer_snapshot(void **state) {
    (void)state;
    struct serving *f = serving_start(&(struct lw_server_desc){0});
    int s = serving_dial_and_stream(f);
    serving_expect_silence(s); /* nothing is published yet */
    struct lw_snapshot *first = serving_make_snapshot(f, 1, 0);
    lw_server_publish(f->server, first);
    serving_expect_light(f, s, 1);
    struct lw_snapshot *second =
        serving_make_snapshot(f, 2, 1); /* one tile changes, the rest stay as they are */
    for (uint32_t t = 0; t < f->map.tile_count; t++) {
        if (t == 5) continue;
        lw_blob_unref(second->tile[serving_channel][t].blob);
        second->tile[serving_channel][t] = (struct lw_snapshot_tile){
            .version = 1, .blob = lw_blob_ref(first->tile[serving_channel][t].blob)};
    }
    lw_snapshot_unref(first);
    serving_publish(f, second);
    serving_expect_frame(s, 2, 2);
    serving_expect_tiles(s, 1, 2);
    serving_publish(f, serving_make_snapshot(f, 5, 4)); /* builds on a frame that this session never had */
    serving_expect_light(f, s, 5);
    serving_expect_silence(s);
    close(s);
    serving_end(f);
}

/* Who has the version that a delta builds on gets the delta; who joins or missed it gets the tile whole. */
static void test_deltas(void **state) {
    (void)state;
    struct serving *f = serving_start(&(struct lw_server_desc){0});
    int early = serving_dial_and_stream(f);
    serving_publish(f, serving_make_snapshot(f, 1, 0));
    serving_expect_light(f, early, 1);
    struct lw_snapshot *second = serving_make_snapshot(f, 2, 1);
    for (uint32_t t = 0; t < f->map.tile_count; t++) {
        struct lw_message m;
        struct lw_framing_header header;
        const struct lw_blob *blob = second->tile[serving_channel][t].blob;
        lw_support_ok(lw_framing_read_header(blob->bytes, LW_FRAMING_BODY_MAX, &header, NULL), NULL);
        lw_support_ok(lw_message_decode(header, blob->bytes + LW_FRAMING_HEADER_SIZE, &m, NULL), NULL);
        m.tile.base = 1;
        second->tile[serving_channel][t].delta = serving_blob_of(&m);
        second->tile[serving_channel][t].base = t == 5 ? 7 : 1;
        lw_message_finish(&m);
    }
    lw_server_publish(f->server, second);
    int late = serving_dial_and_stream(f);
    for (int i = 0; i < 2; i++) {
        serving_expect_frame(i ? late : early, 2, i ? 1 : 2);
        uint32_t deltas = 0;
        for (uint32_t t = 0; t < f->map.tile_count; t++) {
            struct lw_message m;
            serving_expect(i ? late : early, LW_MESSAGE_TILE, &m);
            assert_int_equal(m.tile.version, 2);
            deltas += m.tile.base == 1;
            lw_message_finish(&m);
        }
        assert_int_equal(deltas, i ? 0 : f->map.tile_count - 1);
    }
    lw_snapshot_unref(second);
    close(late);
    close(early);
    serving_end(f);
}

static struct lw_snapshot *make_settling(const struct serving *f, uint64_t frame, uint64_t previous) {
    struct lw_snapshot *snapshot = serving_make_snapshot(f, frame, previous);
    snapshot->settled =
        serving_blob_of(&(struct lw_message){.type = LW_MESSAGE_SETTLED, .settled.frame = frame});
    return snapshot;
}

static void expect_settled(int s, uint64_t frame) {
    struct lw_message m;
    serving_expect(s, LW_MESSAGE_SETTLED, &m);
    assert_int_equal(m.settled.frame, frame);
    lw_message_finish(&m);
}

/* A session that lacks two versions takes two deltas, if they are fewer bytes than the tile and no single
 * delta is there. */
static void test_deltas_to_catch_up(void **state) {
    (void)state;
    enum { FRAMES = 4 };
    static const uint8_t little[100] = {1};
    struct serving *f = serving_start(&(struct lw_server_desc){0});
    struct lw_message_welcome welcome;
    struct lw_message m;
    close(serving_dial_again(f, &welcome));
    for (uint64_t frame = 1; frame <= FRAMES; frame++) { /* tile 0 of object 0 has deltas */
        struct lw_snapshot *snapshot = serving_make_snapshot(f, frame, frame - 1);
        if (frame > 1) {
            snapshot->tile[serving_channel][0].base = frame - 1;
            snapshot->tile[serving_channel][0].delta =
                serving_blob_of(&(struct lw_message){.type = LW_MESSAGE_TILE,
                                                     .tile = {.layer = serving_channel,
                                                              .version = frame,
                                                              .base = frame - 1,
                                                              .codec = 3,
                                                              .scale = 1,
                                                              .payload = little,
                                                              .payload_size = sizeof little}});
        }
        serving_publish(f, snapshot);
        int s = serving_dial_and_stream(f); /* so that the loop has seen it */
        serving_expect_frame(s, frame, 1);
        close(s);
    }
    static const struct lw_message_interest_tile wanted[] = {{0, 0, 0}};
    for (uint64_t held = 1; held < FRAMES; held++) {
        const struct lw_message_held tile[] = {{0, 0, 0, held}};
        int s = serving_dial_again(f, &welcome);
        serving_put(s, &(struct lw_message){.type = LW_MESSAGE_INTEREST,
                                            .interest = {.tile = wanted, .tile_count = 1}});
        serving_put(s, &(struct lw_message){.type = LW_MESSAGE_HOLDS, .holds = {tile, 1, 0}});
        serving_ask_for_package(s, welcome.package_compressed_size);
        serving_expect_frame(s, FRAMES, 1);
        for (uint64_t version = held + 1; version <= FRAMES; version++) {
            serving_expect(s, LW_MESSAGE_TILE, &m);
            assert_true(m.tile.version == version && m.tile.base == version - 1);
            lw_message_finish(&m);
        }
        serving_expect_silence(s);
        close(s);
    }
    serving_end(f);
}

/* A snapshot whose tile 0 is real light that moves a little from version to version. */
static struct lw_snapshot *make_moving(const struct serving *f, struct lw_tile_codec *codec,
                                       struct lw_tile_dct_history *history, uint64_t frame,
                                       uint64_t previous) {
    static float rgb[LW_TILE_TEXELS_MAX * 3];
    const struct lw_tile_place *place = &f->map.place[0];
    const size_t capacity = lw_tile_codec_bound();
    uint8_t *payload = malloc(capacity), *delta = malloc(capacity);
    assert_true(payload && delta);
    for (uint32_t i = 0; i < place->width * place->height * 3; i++)
        rgb[i] = 2 + sinf((float)(i * 7)) + 0.3f * sinf((float)i * 0.1f + (float)frame);
    struct lw_tile_dct_coded coded;
    lw_support_ok(lw_tile_codec_encode_dct(
                      codec,
                      &(struct lw_tile_dct_source){rgb, NULL, place->width, place->height, 0.1f, 0, NULL},
                      history, payload, delta, capacity, &coded),
                  NULL);
    struct lw_snapshot *snapshot = serving_make_snapshot(f, frame, previous);
    struct lw_message m = {.type = LW_MESSAGE_TILE,
                           .tile = {.layer = serving_channel,
                                    .version = frame,
                                    .codec = LW_TILE_CODEC_DCT,
                                    .scale = coded.scale,
                                    .payload = payload,
                                    .payload_size = coded.size}};
    lw_blob_unref(snapshot->tile[serving_channel][0].blob);
    snapshot->tile[serving_channel][0].blob = serving_blob_of(&m);
    if (coded.delta_size) {
        m.tile.base = snapshot->tile[serving_channel][0].base = previous;
        m.tile.payload = delta;
        m.tile.payload_size = coded.delta_size;
        snapshot->tile[serving_channel][0].delta = serving_blob_of(&m);
    }
    free(delta);
    free(payload);
    return snapshot;
}

/* A session that lacks several versions takes one delta over all of them, made for the first who wants it and
 * the same for the next; SETTLED waits for it. */
static void test_a_jump_to_catch_up(void **state) {
    (void)state;
    enum { FRAMES = 6 };
    static struct lw_tile_dct_history history;
    static const struct lw_message_interest_tile wanted[] = {{0, 0, 0}};
    struct serving *f = serving_start(&(struct lw_server_desc){.features = LW_FEATURE_DCT});
    struct lw_tile_codec *codec;
    lw_support_ok(lw_tile_codec_create(&codec), NULL);
    memset(&history, 0, sizeof history);
    for (uint64_t frame = 1; frame <= FRAMES; frame++) {
        struct lw_snapshot *snapshot = make_moving(f, codec, &history, frame, frame - 1);
        if (frame == FRAMES)
            snapshot->settled =
                serving_blob_of(&(struct lw_message){.type = LW_MESSAGE_SETTLED, .settled.frame = frame});
        serving_publish(f, snapshot);
        int s = serving_dial_and_greet_with(f, LW_FEATURE_DCT);
        serving_ask_for_package(s, SERVING_PACKAGE_SIZE); /* so that the loop has seen it */
        wait_for_frame(s, frame);
        close(s);
    }
    for (int i = 0; i < 2; i++) {
        const struct lw_message_held tile[] = {{0, 0, 0, 2}};
        int s = serving_dial(f);
        struct lw_message m;
        serving_put(s, &(struct lw_message){.type = LW_MESSAGE_HELLO,
                                            .hello = {.version = LW_WIRE_VERSION,
                                                      .features = LW_FEATURE_DCT | LW_FEATURE_RESUME}});
        serving_expect(s, LW_MESSAGE_WELCOME, &m);
        const uint64_t end_of_package = m.welcome.package_compressed_size;
        lw_message_finish(&m);
        serving_put(s, &(struct lw_message){.type = LW_MESSAGE_INTEREST,
                                            .interest = {.tile = wanted, .tile_count = 1}});
        serving_put(s, &(struct lw_message){.type = LW_MESSAGE_HOLDS, .holds = {tile, 1, 0}});
        serving_ask_for_package(s, end_of_package);
        serving_expect_frame(s, FRAMES, 1);
        serving_expect(s, LW_MESSAGE_TILE, &m);
        assert_int_equal(m.tile.base, 2);
        assert_int_equal(m.tile.version, FRAMES);
        lw_message_finish(&m);
        expect_settled(s, FRAMES);
        serving_expect_silence(s);
        close(s);
    }
    lw_tile_codec_destroy(codec);
    serving_end(f);
}

/* A client whose link takes less than changes gets tiles in wider steps, and the rest once nothing changes
 * any more; that is when all has been sent. */
static void test_a_narrow_link(void **state) {
    (void)state;
    enum { FRAMES = 10 };
    static struct lw_tile_dct_history history;
    static const struct lw_message_interest_tile wanted[] = {{0, 0, 0}};
    struct serving *f =
        serving_start(&(struct lw_server_desc){.features = LW_FEATURE_DCT, .rate_limit_bytes_hz = 20000});
    struct lw_tile_codec *codec;
    struct lw_message m;
    lw_support_ok(lw_tile_codec_create(&codec), NULL);
    memset(&history, 0, sizeof history);
    int s = serving_dial(f);
    serving_put(s, &(struct lw_message){.type = LW_MESSAGE_HELLO,
                                        .hello = {.version = LW_WIRE_VERSION, .features = LW_FEATURE_DCT}});
    serving_expect(s, LW_MESSAGE_WELCOME, &m);
    const uint64_t end_of_package = m.welcome.package_compressed_size;
    lw_message_finish(&m);
    serving_put(
        s, &(struct lw_message){.type = LW_MESSAGE_INTEREST, .interest = {.tile = wanted, .tile_count = 1}});
    serving_ask_for_package(s, end_of_package);
    int observer = serving_dial_and_greet_with(f, LW_FEATURE_DCT);
    serving_put(observer, &(struct lw_message){.type = LW_MESSAGE_INTEREST});
    serving_ask_for_package(observer, end_of_package);
    for (uint64_t frame = 2; frame <= 2 * FRAMES; frame += 2) {
        struct lw_snapshot *snapshot = make_moving(f, codec, &history, frame, frame - 2);
        snapshot->settled =
            serving_blob_of(&(struct lw_message){.type = LW_MESSAGE_SETTLED, .settled.frame = frame});
        serving_publish(f, snapshot);
        wait_for_frame(observer, frame);
        server_clock_step(20);
    }
    close(observer);
    serving_is_paced = true;
    size_t coarse_bytes = 0, bytes = 0;
    uint64_t version = 0;
    bool settled = false;
    while (!settled) {
        assert_true(serving_get(s, &m));
        settled = m.type == LW_MESSAGE_SETTLED && m.settled.frame == 2 * FRAMES;
        if (m.type == LW_MESSAGE_TILE) {
            assert_true(m.tile.version > version);
            version = m.tile.version;
            if (!m.tile.base)
                *(lw_snapshot_is_coarse(version) ? &coarse_bytes : &bytes) = m.tile.payload_size;
        }
        lw_message_finish(&m);
    }
    assert_int_equal(version, 2 * FRAMES);
    assert_true(coarse_bytes > 0 && coarse_bytes < 2 * bytes / 3);
    close(s);
    lw_tile_codec_destroy(codec);
    serving_end(f);
}

/* Once per frame, after its last tile; again after an INTEREST. */
static void test_settled(void **state) {
    (void)state;
    struct serving *f = serving_start(&(struct lw_server_desc){0});
    int s = serving_dial_and_stream(f);
    for (uint64_t frame = 1; frame <= 3; frame++) {
        serving_publish(f, make_settling(f, frame, frame - 1));
        serving_expect_frame(s, frame, frame == 1 ? 1 : 2);
        serving_expect_tiles(s, f->map.tile_count, frame);
        expect_settled(s, frame);
        serving_expect_silence(s);
    }
    serving_put(s, &(struct lw_message){.type = LW_MESSAGE_INTEREST});
    expect_settled(s, 3);
    serving_publish(f, make_settling(f, 4, 3));
    serving_expect_frame(s, 4, 2);
    expect_settled(s, 4); /* nothing is wanted of it */
    serving_put(s, &(struct lw_message){.type = LW_MESSAGE_INTEREST, .interest.everything = true});
    serving_expect_tiles(s, f->map.tile_count, 4);
    expect_settled(s, 4);
    serving_expect_silence(s);
    close(s);
    serving_end(f);
}

/* ---- sharing and isolation ---- */

static void test_blobs_are_shared(void **state) {
    (void)state;
    struct serving *f = serving_start(&(struct lw_server_desc){0});
    enum { SLOW = 4 };
    int slow[SLOW];
    for (int i = 0; i < SLOW; i++) slow[i] = serving_dial_with_buffer(f, 4096);
    for (int i = 0; i < SLOW; i++) {
        serving_put(slow[i], &serving_hello);
        serving_ask_for_package(slow[i], SERVING_PACKAGE_SIZE);
    }
    serving_wait_for_sessions(f, SLOW);
    struct lw_snapshot *snapshot = serving_make_snapshot(f, 1, 0);
    lw_server_publish(f->server, snapshot);
    /* the links hold back, so the server holds references: to one blob, not to copies */
    uint32_t most = 0;
    while (most < 1 + SLOW) {
        most = 0;
        for (uint32_t t = 0; t < snapshot->tile_count; t++) {
            uint32_t references = snapshot->tile[serving_channel][t].blob->references;
            if (references > most) most = references;
        }
        lw_support_pause();
    }
    for (int i = 0; i < SLOW; i++) close(slow[i]);
    serving_wait_for_sessions(f, 0);
    lw_server_stop(f->server);
    serving_join(f);
    for (uint32_t t = 0; t < snapshot->tile_count; t++)
        assert_int_equal(snapshot->tile[serving_channel][t].blob->references, 1);
    assert_int_equal(snapshot->references, 1);
    lw_snapshot_unref(snapshot);
    serving_discard(f);
}

/* ---- whose turn it is ---- */

/* A limit of 1 MB/s lets a tenth of a second's worth through at once, then that rate; a peer without one does
 * not notice. Only tiles wait. */
static void test_rate_limits(void **state) {
    (void)state;
    static const struct {
        uint64_t of_server, of_client;
    } row[] = {{1000000, 0}, {0, 1000000}, {1000000, UINT64_MAX}, {UINT64_MAX, 1000000}};
    for (size_t i = 0; i < sizeof row / sizeof row[0]; i++) {
        struct serving *f = serving_start(&(struct lw_server_desc){.rate_limit_bytes_hz = row[i].of_server});
        struct lw_message m;
        serving_is_paced = true;
        serving_publish(f, serving_make_snapshot(f, 1, 0));
        int s = serving_dial(f);
        serving_put(s, &(struct lw_message){
                           .type = LW_MESSAGE_HELLO,
                           .hello = {.version = LW_WIRE_VERSION, .rate_limit_bytes_hz = row[i].of_client}});
        serving_expect(s, LW_MESSAGE_WELCOME, &m);
        const uint64_t began_ns = lw_clock_ns();
        serving_ask_for_package(s, m.welcome.package_compressed_size);
        lw_message_finish(&m);
        serving_expect_light(f, s, 1); /* 780 kB */
        const double took_s = 1e-9 * (double)(lw_clock_ns() - began_ns),
                     bytes = (double)f->map.tile_count * SERVING_PAYLOAD_SIZE;
        const double least_s = (bytes - SERVING_PAYLOAD_SIZE) / 1e6 - 1e-3 * LW_SERVER_BURST_MS - 0.02;
        assert_true(took_s > least_s && took_s < least_s + 0.2);
        serving_publish(f, serving_make_snapshot(f, 2, 1));
        serving_expect_frame(s, 2, 2);
        serving_publish(f, serving_make_snapshot(f, 3, 2)); /* comes at once, though tiles are held back */
        uint32_t before = 0;
        for (bool framed = false; !framed; before += !framed) {
            assert_true(serving_get(s, &m));
            framed = m.type == LW_MESSAGE_FRAME;
            lw_message_finish(&m);
        }
        assert_true(before < f->map.tile_count);
        serving_expect_tiles(s, f->map.tile_count, 3); /* and the newest of each */
        close(s);
        serving_end(f);
    }
}

/* A link that takes one tile after another gets first the tile that has changed most; a client that is
 * behind, the one that has since it had it last. */
static void test_the_most_visible_change_goes_first(void **state) {
    (void)state;
    struct serving *f =
        serving_start(&(struct lw_server_desc){.rate_limit_bytes_hz = 10 * SERVING_PAYLOAD_SIZE});
    struct lw_message m;
    serving_is_paced = true;
    int s = serving_dial_and_stream(f);
    serving_publish(f, serving_make_snapshot(f, 2, 0));
    serving_expect_light(f, s, 2);
    /* whole tiles of level 0, one of each object, move the more the later they come; the others little */
    const uint32_t tile[SERVING_OBJECTS] = {0, 13, 26};
    struct lw_snapshot *snapshot = serving_make_snapshot(f, 4, 2);
    for (uint32_t i = 0; i < f->map.tile_count; i++) snapshot->tile[serving_channel][i].change = 0.001f;
    for (uint32_t o = 0; o < SERVING_OBJECTS; o++)
        snapshot->tile[serving_channel][tile[o]].change = 0.1f * (float)(o + 1);
    serving_publish(f, snapshot);
    serving_expect_frame(s, 4, 2);
    serving_expect(s, LW_MESSAGE_TILE, &m);
    assert_int_equal(m.tile.object, SERVING_OBJECTS - 1);
    assert_int_equal(m.tile.level, 0);
    lw_message_finish(&m);
    /* now all but this tile lag behind; the first moves again and overtakes the second */
    snapshot = serving_make_snapshot(f, 6, 4);
    for (uint32_t i = 0; i < f->map.tile_count; i++) snapshot->tile[serving_channel][i].change = 0.001f;
    snapshot->tile[serving_channel][tile[0]].change = 0.2f;
    serving_publish(f, snapshot);
    for (bool framed = false; !framed;) {
        assert_true(serving_get(s, &m));
        framed = m.type == LW_MESSAGE_FRAME;
        if (!framed) assert_true(m.tile.version == 4); /* on its way already */
        lw_message_finish(&m);
    }
    serving_expect(s, LW_MESSAGE_TILE, &m);
    assert_true(m.tile.version == 6 && m.tile.level == 0 && m.tile.object == 0);
    lw_message_finish(&m);
    close(s);
    serving_end(f);
}

static void test_what_waits_is_reported(void **state) {
    (void)state;
    struct serving *f = serving_start(&(struct lw_server_desc){0});
    struct lw_message m;
    int slow = serving_dial_with_buffer(f, 16 << 10);
    serving_put(slow, &serving_hello);
    serving_expect(slow, LW_MESSAGE_WELCOME, &m);
    serving_ask_for_package(slow, m.welcome.package_compressed_size);
    lw_message_finish(&m);
    for (uint64_t frame = 1; !serving_stats_of(f).waiting_bytes; frame++) {
        serving_publish(f, serving_make_snapshot(f, frame, frame - 1));
        server_clock_step(10);
    }
    struct lw_server_stats stats = serving_stats_of(f);
    assert_int_equal(stats.waiting_bytes, stats.waiting_bytes_max);
    assert_in_range(stats.waiting_bytes_max, 1, LW_SERVER_QUEUE_MAX);
    assert_true(stats.socket_bytes > 0);
    close(slow);
    serving_wait_for_sessions(f, 0);
    serving_end(f);
}

int main(void) {
    const struct CMUnitTest in_split_channel[] = {
        cmocka_unit_test(test_newer_snapshot),     cmocka_unit_test(test_deltas),
        cmocka_unit_test(test_deltas_to_catch_up), cmocka_unit_test(test_a_jump_to_catch_up),
        cmocka_unit_test(test_a_narrow_link),      cmocka_unit_test(test_settled),
        cmocka_unit_test(test_blobs_are_shared),   cmocka_unit_test(test_the_most_visible_change_goes_first),
    };
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_newer_snapshot),
        cmocka_unit_test(test_deltas),
        cmocka_unit_test(test_deltas_to_catch_up),
        cmocka_unit_test(test_a_jump_to_catch_up),
        cmocka_unit_test(test_a_narrow_link),
        cmocka_unit_test(test_settled),
        cmocka_unit_test(test_blobs_are_shared),
        cmocka_unit_test(test_rate_limits),
        cmocka_unit_test(test_the_most_visible_change_goes_first),
        cmocka_unit_test(test_what_waits_is_reported),
    };
    const int failed = cmocka_run_group_tests(tests, NULL, NULL);
    return failed + cmocka_run_group_tests(in_split_channel, serving_ask_for_split, NULL);
}
