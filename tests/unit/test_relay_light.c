/* Light that another server sent: its form in snapshots, and refusals. */
#include "tests/support/support.h"

#include "common/scene/package.h"
#include "common/tile/tile_codec.h"
#include "relay/relay_light.h"

#include <stdlib.h>
#include <string.h>

enum { FULL = LW_TILE_CHANNEL_FULL, SPLIT = LW_TILE_CHANNEL_SPLIT };

static struct lw_relay_light *light;
static const struct lw_atlas_map *map;
static struct lw_tile_codec *codec;
static float rgb[LW_TILE_TEXELS_MAX * 3];

/* A tile as its server has it. */
struct source {
    struct lw_tile_dct_history history;
    struct lw_message_tile whole, delta; /* delta.payload_size 0: there is none */
    uint8_t whole_bytes[LW_TILE_DCT_BOUND], delta_bytes[LW_TILE_DCT_BOUND];
};
static struct source *source; /* by tile */

static void encode(uint32_t id, uint64_t version) {
    struct source *s = &source[id];
    const struct lw_tile_place *place = &map->place[id];
    struct lw_tile_dct_coded coded = {0};
    for (size_t i = 0; i < (size_t)place->width * place->height * 3; i++) /* the first texels change */
        rgb[i] = 1 + 0.02f * (float)(i * 7919 % 50) + (i < 24 ? 0.1f * (float)(version % 8) : 0);
    lw_support_ok(lw_tile_codec_encode_dct(
                      codec,
                      &(struct lw_tile_dct_source){rgb, NULL, place->width, place->height, 0.02f, 0, NULL},
                      &s->history, s->whole_bytes, s->delta_bytes, lw_tile_codec_bound(), &coded),
                  NULL);
    const uint64_t before = s->whole.version;
    s->whole = (struct lw_message_tile){.object = place->object,
                                        .level = place->level,
                                        .tile = lw_atlas_map_number(map, (lw_tile_id){id}),
                                        .version = version,
                                        .codec = LW_TILE_CODEC_DCT,
                                        .scale = coded.scale,
                                        .bounces = 1,
                                        .error = 0.1f,
                                        .payload = s->whole_bytes,
                                        .payload_size = coded.size};
    s->delta = s->whole;
    s->delta.payload = s->delta_bytes;
    s->delta.payload_size = coded.delta_size;
    s->delta.base = before;
}

#define FINE_MOST 4u /* tiles of finer levels that a test has at a time */

static int begin_with(uint32_t finer) {
    struct lw_scene *scene = lw_support_everything();
    for (uint32_t i = 0; i < scene->mesh_count; i++)
        if (scene->mesh[i].atlas_width) {
            scene->mesh[i].atlas_width = 140;
            scene->mesh[i].atlas_height = 72;
        }
    uint8_t *package;
    size_t size;
    struct lw_error err = {0};
    lw_support_ok(lw_package_write(scene, &package, &size, &err), &err);
    lw_scene_destroy(scene);
    lw_support_ok(lw_relay_light_create(package, size, finer, &light, &err), &err);
    free(package);
    map = lw_relay_light_map(light);
    lw_support_ok(lw_tile_codec_create(&codec), NULL);
    const size_t sources = map->plain_count + FINE_MOST;
    source = aligned_alloc(64, (sources * sizeof *source + 63) / 64 * 64);
    memset(source, 0, sources * sizeof *source);
    return 0;
}

static int begin(void **state) {
    (void)state;
    return begin_with(0);
}

static int begin_finer(void **state) {
    (void)state;
    return begin_with(2);
}

static int end(void **state) {
    (void)state;
    lw_relay_light_destroy(light);
    lw_tile_codec_destroy(codec);
    free(source);
    return 0;
}

static void take_frame(uint32_t channel, uint64_t frame) {
    struct lw_error err = {0};
    lw_support_ok(lw_relay_light_take_frame(
                      light, channel, &(struct lw_message_frame){.frame = frame, .base = frame - 1}, &err),
                  &err);
}

static void take_tile(uint32_t channel, struct lw_message_tile tile) {
    struct lw_error err = {0};
    tile.layer = channel;
    lw_support_ok(lw_relay_light_take_tile(light, channel, &tile, &err), &err);
}

static void refuse_tile(struct lw_message_tile tile, const char *text) {
    struct lw_error err = {0};
    const uint64_t before = lw_relay_light_version(light, FULL, (lw_tile_id){0});
    lw_support_fails(lw_relay_light_take_tile(light, FULL, &tile, &err), LW_PROTOCOL, &err, text);
    assert_int_equal(lw_relay_light_version(light, FULL, (lw_tile_id){0}), before);
}

static void take_settled(uint32_t channel, uint64_t frame) {
    struct lw_error err = {0};
    lw_support_ok(lw_relay_light_take_settled(light, channel, frame, &err), &err);
}

static struct lw_snapshot *snapshot(void) {
    struct lw_snapshot *made;
    lw_support_ok(lw_relay_light_snapshot(light, &made), NULL);
    return made;
}

/* A frame with every tile, whole. */
static void take_all(uint32_t channel, uint64_t frame) {
    take_frame(channel, frame);
    for (uint32_t t = 0; t < map->plain_count; t++) {
        if (source[t].whole.version < 2 * frame) encode(t, 2 * frame);
        take_tile(channel, source[t].whole);
    }
    take_settled(channel, frame);
}

static void expect_tile(const struct lw_blob *blob, const struct lw_message_tile *expected) {
    struct lw_message m;
    assert_non_null(blob);
    lw_support_ok(lw_message_decode_whole(blob->bytes, blob->size, &m), NULL);
    assert_int_equal(m.type, LW_MESSAGE_TILE);
    assert_true(m.tile.version == expected->version && m.tile.base == expected->base &&
                m.tile.scale == expected->scale && m.tile.error == expected->error);
    assert_int_equal(m.tile.payload_size, expected->payload_size);
    assert_memory_equal(m.tile.payload, expected->payload, expected->payload_size);
    lw_message_finish(&m);
}

static void expect_frame(const struct lw_blob *frame, uint64_t run, uint64_t base) {
    struct lw_message m;
    lw_support_ok(lw_message_decode_whole(frame->bytes, frame->size, &m), NULL);
    assert_int_equal(m.type, LW_MESSAGE_FRAME);
    assert_int_equal(m.frame.run, run);
    assert_int_equal(m.frame.base, base);
    lw_message_finish(&m);
}

/* Tiles are forwarded as they came; one that came as a delta is made whole as its server has it. */
static void tiles_are_passed_on(void **state) {
    (void)state;
    assert_null(snapshot());
    lw_relay_light_begin(light, FULL);
    take_all(FULL, 5);
    assert_int_equal(lw_relay_light_news(light), LW_RELAY_LIGHT_ALL);
    struct lw_snapshot *s = snapshot();
    assert_true(s->frame == 5 && s->channels == 1u << FULL && !s->unsettled && !s->frame_delta);
    for (uint32_t t = 0; t < map->tile_count; t++) {
        expect_tile(s->tile[FULL][t].blob, &source[t].whole);
        assert_null(s->tile[FULL][t].delta);
    }
    lw_snapshot_unref(s);
    assert_int_equal(lw_relay_light_news(light), LW_RELAY_LIGHT_NOTHING);
    take_frame(FULL, 6);
    assert_int_equal(lw_relay_light_news(light), LW_RELAY_LIGHT_SOME);
    encode(0, 12);
    assert_true(source[0].delta.payload_size > 0);
    take_tile(FULL, source[0].delta);
    s = snapshot(); /* while tiles are still to come */
    assert_true(s->frame == 6 && s->previous_frame == 5 && s->frame_delta && s->unsettled == 1u << FULL);
    expect_tile(s->tile[FULL][0].blob, &source[0].whole);
    expect_tile(s->tile[FULL][0].delta, &source[0].delta);
    assert_int_equal(s->tile[FULL][0].base, 10);
    lw_snapshot_unref(s);
    encode(1, 12);
    take_tile(FULL, source[1].whole);
    take_settled(FULL, 6);
    s = snapshot(); /* the rest of the same frame: a session goes on from frame 5 or 6 */
    assert_true(s->frame == 6 && s->previous_frame == 5 && !s->unsettled);
    expect_tile(s->tile[FULL][1].blob, &source[1].whole);
    lw_snapshot_unref(s);
}

/* Clients have the tiles of a snapshot: from there on there is one delta over all versions since. */
static void versions_between_snapshots_are_one_delta(void **state) {
    (void)state;
    lw_relay_light_begin(light, FULL);
    take_all(FULL, 5);
    lw_snapshot_unref(snapshot());
    for (uint64_t frame = 6; frame < 9; frame++) {
        take_frame(FULL, frame);
        encode(0, 2 * frame);
        take_tile(FULL, source[0].delta);
    }
    struct lw_snapshot *s = snapshot();
    assert_true(s->frame == 8 && s->previous_frame == 5);
    assert_int_equal(s->tile[FULL][0].base, 10);
    struct lw_message m;
    lw_support_ok(lw_message_decode_whole(s->tile[FULL][0].delta->bytes, s->tile[FULL][0].delta->size, &m),
                  NULL);
    assert_true(m.tile.base == 10 && m.tile.version == 16);
    lw_message_finish(&m);
    expect_tile(s->tile[FULL][0].blob, &source[0].whole);
    lw_snapshot_unref(s);
}

/* Sessions of two forms: a frame is complete for each apart. */
static void channels_settle_apart(void **state) {
    (void)state;
    lw_relay_light_begin(light, FULL);
    lw_relay_light_begin(light, SPLIT);
    take_all(FULL, 5);
    struct lw_snapshot *s = snapshot();
    assert_true(s->channels == 1u << FULL);
    lw_snapshot_unref(s);
    take_frame(SPLIT, 5);
    for (uint32_t t = 1; t < map->tile_count; t++) take_tile(SPLIT, source[t].whole);
    take_tile(SPLIT, source[0].whole);
    s = snapshot();
    assert_true(s->frame == 5 && s->channels == (1u << FULL | 1u << SPLIT) && s->unsettled == 1u << SPLIT);
    lw_snapshot_unref(s);
    take_settled(SPLIT, 5);
    take_frame(FULL, 6);
    take_settled(FULL, 6);
    s = snapshot();
    assert_true(s->frame == 6 && s->unsettled == 1u << SPLIT);
    lw_snapshot_unref(s);
}

/* With no session left, light stays, in every channel; a session that is behind shows nothing older. */
static void light_stays(void **state) {
    (void)state;
    lw_relay_light_begin(light, FULL);
    lw_relay_light_begin(light, SPLIT);
    take_all(FULL, 5);
    take_all(SPLIT, 5);
    lw_snapshot_unref(snapshot());
    lw_relay_light_end(light, SPLIT);
    take_frame(FULL, 6);
    take_settled(FULL, 6);
    struct lw_snapshot *s = snapshot();
    assert_true(s->channels == 1u << FULL);
    lw_snapshot_unref(s);
    lw_relay_light_end(light, FULL);
    assert_int_equal(lw_relay_light_news(light), LW_RELAY_LIGHT_NOTHING);
    s = snapshot();
    assert_true(s->frame == 6 && s->channels == (1u << FULL | 1u << SPLIT) && !s->unsettled);
    for (uint32_t t = 0; t < map->tile_count; t++) expect_tile(s->tile[SPLIT][t].blob, &source[t].whole);
    lw_snapshot_unref(s);
    lw_relay_light_begin(light, FULL); /* in a relay that is behind */
    take_frame(FULL, 4);
    take_tile(FULL,
              (struct lw_message_tile){.version = 1,
                                       .codec = LW_TILE_CODEC_DCT,
                                       .payload = (const uint8_t *)"",
                                       .payload_size = 1}); /* older than the tile that is here: ignored */
    take_settled(FULL, 4);
    assert_null(snapshot());
    take_frame(FULL, 7);
    take_settled(FULL, 7);
    s = snapshot();
    assert_true(s->frame == 7 && s->previous_frame == 6);
    lw_snapshot_unref(s);
}

/* Every byte gives a status, and earlier tiles stay. */
static void what_makes_no_sense_is_refused(void **state) {
    (void)state;
    struct lw_error err = {0};
    encode(0, 10);
    struct lw_message_tile tile = source[0].whole;
    lw_relay_light_begin(light, FULL);
    refuse_tile(tile, "out of order");
    lw_support_fails(lw_relay_light_take_settled(light, FULL, 1, &err), LW_PROTOCOL, &err, "out of order");
    take_all(FULL, 5);
    err = (struct lw_error){0};
    lw_support_fails(lw_relay_light_take_frame(light, FULL, &(struct lw_message_frame){.frame = 4}, &err),
                     LW_PROTOCOL, &err, "number 4 after 5");
    const struct lw_message_transform nowhere = {.object = 1000};
    err = (struct lw_error){0};
    lw_support_fails(lw_relay_light_take_frame(
                         light, FULL,
                         &(struct lw_message_frame){.frame = 6, .transform = &nowhere, .transform_count = 1},
                         &err),
                     LW_PROTOCOL, &err, "transform_object 1000");
    take_frame(FULL, 6);
    encode(0, 12);
    const struct lw_message_tile whole = source[0].whole, delta = source[0].delta;
    tile = whole;
    tile.version = 13;
    refuse_tile(tile, "over twice the number");
    tile = whole;
    tile.object = 1000;
    refuse_tile(tile, "does not exist");
    tile = whole;
    tile.layer = SPLIT;
    refuse_tile(tile, "another layer");
    tile = whole;
    tile.codec = 2;
    refuse_tile(tile, "codec is unknown");
    tile = whole;
    tile.payload_size--;
    refuse_tile(tile, "damaged");
    tile = whole;
    tile.scale = 0x1p61f;
    refuse_tile(tile, "damaged");
    tile = delta;
    tile.base = 8;
    refuse_tile(tile, "a version that is not here");
    tile = delta;
    tile.payload_size--;
    refuse_tile(tile, "damaged");
    tile = delta;
    tile.scale = 0x1p61f;
    refuse_tile(tile, "damaged");
    tile = whole;
    tile.base = 10; /* a whole payload is no delta */
    refuse_tile(tile, "damaged");
    tile = delta;
    tile.codec = LW_TILE_CODEC_HALF_ZSTD;
    refuse_tile(tile, "a version that is not here");
    take_tile(FULL, delta);
    assert_int_equal(lw_relay_light_version(light, FULL, (lw_tile_id){0}), 12);
}

/* Another run of the same scene counts on from the one before: the server above has numbers of its own,
 * clients get larger ones than all before. Old tiles stay until new ones come. */
static void another_run_counts_on(void **state) {
    (void)state;
    const uint64_t gap = UINT64_C(1) << 32;
    lw_relay_light_begin(light, FULL);
    take_all(FULL, 5);
    struct lw_snapshot *s = snapshot();
    expect_frame(s->frame_full, 0, 0);
    lw_snapshot_unref(s);
    assert_false(lw_relay_light_ahead(light));
    lw_relay_light_end(light, FULL);
    assert_true(lw_relay_light_begin_run(light, 77));
    assert_true(lw_relay_light_run(light) == 77 && lw_relay_light_ahead(light));
    assert_int_equal(lw_relay_light_version(light, FULL, (lw_tile_id){0}), 0);
    assert_int_equal(lw_relay_light_frame(light, FULL), 0);
    assert_int_equal(lw_relay_light_frame_for_clients(light, 3), gap + 3);
    assert_int_equal(lw_relay_light_frame_for_clients(light, 0), 0);
    lw_relay_light_begin(light, FULL);
    memset(source, 0, map->tile_count * sizeof *source);
    take_frame(FULL, 1);
    encode(0, 2);
    take_tile(FULL, source[0].whole);
    take_settled(FULL, 1);
    s = snapshot();
    assert_true(s->frame == gap + 1 && s->previous_frame == 5);
    expect_frame(s->frame_full, 77, 0);
    expect_frame(s->frame_delta, 77, 5);
    assert_int_equal(s->tile[FULL][0].version, 2 * gap + 2);
    assert_int_equal(s->tile[FULL][1].version, 10); /* the earlier run's */
    lw_snapshot_unref(s);
    assert_int_equal(lw_relay_light_version(light, FULL, (lw_tile_id){0}), 2);
    assert_int_equal(lw_relay_light_version(light, FULL, (lw_tile_id){1}), 0);
    assert_int_equal(lw_relay_light_frame(light, FULL), 1);
    /* a delta builds on tiles of this run alone */
    take_frame(FULL, 2);
    encode(0, 4);
    take_tile(FULL, source[0].delta);
    struct lw_message_tile of_before = source[0].delta;
    of_before.tile = lw_atlas_map_number(map, (lw_tile_id){1});
    of_before.object = map->place[1].object;
    of_before.level = map->place[1].level;
    of_before.base = 10;
    of_before.version = 11;
    refuse_tile(of_before, "over twice the number");
    /* numbers end some time: then there is no further run */
    lw_relay_light_end(light, FULL);
    assert_true(lw_relay_light_begin_run(light, 78));
    lw_relay_light_begin(light, FULL);
    take_frame(FULL, UINT64_MAX / 4 - 2 * gap);
    lw_relay_light_end(light, FULL);
    assert_false(lw_relay_light_begin_run(light, 79));
    assert_int_equal(lw_relay_light_run(light), 78);
}

/* The server above ends again before it has sent anything, as one does that cannot go on. */
static void a_run_may_end_before_its_first_frame(void **state) {
    (void)state;
    const uint64_t gap = UINT64_C(1) << 32;
    lw_relay_light_begin(light, FULL);
    take_all(FULL, 5);
    lw_snapshot_unref(snapshot());
    for (uint64_t run = 77; run < 80; run++) {
        lw_relay_light_end(light, FULL);
        assert_true(lw_relay_light_begin_run(light, run));
        lw_relay_light_begin(light, FULL);
    }
    take_frame(FULL, 1);
    take_settled(FULL, 1);
    struct lw_snapshot *s = snapshot();
    assert_true(s->frame == 3 * gap + 1 && s->previous_frame == 5);
    expect_frame(s->frame_full, 79, 0);
    lw_snapshot_unref(s);
}

/* ---- tiles of finer levels ---- */

static lw_tile_id claim(uint32_t tile) { return lw_atlas_map_claim_tile(map, 0, LW_ATLAS_FINER + 1, tile); }

/* Clients list these, and the server above is asked for them; by numbers of the level that is twice as fine.
 * Returns whether a snapshot is due. */
static bool list(uint64_t number, const uint32_t *tile, uint32_t count, bool asks) {
    uint32_t id[FINE_MOST];
    lw_tile_id asked[FINE_MOST];
    for (uint32_t i = 0; i < count; i++) asked[i] = claim(tile[i]), id[i] = asked[i].v;
    const bool is_due = lw_relay_light_list(light, number, id, count);
    if (asks) lw_relay_light_ask(light, FULL, asked, count);
    return is_due;
}

/* What a snapshot has of a tile; the last one of all. */
static void expect_fine(lw_tile_id id, uint64_t version, uint32_t its_codec, bool holds) {
    struct lw_message m;
    struct lw_snapshot *s = snapshot();
    assert_non_null(s);
    assert_int_equal(s->tile[FULL][id.v].version, version);
    assert_int_equal(lw_snapshot_holds_fine(s, id.v - map->plain_count), holds);
    if (version) {
        const struct lw_blob *blob = s->tile[FULL][id.v].blob;
        lw_support_ok(lw_message_decode_whole(blob->bytes, blob->size, &m), NULL);
        assert_int_equal(m.tile.version, version);
        assert_int_equal(m.tile.codec, its_codec);
        assert_true(m.tile.level > LW_ATLAS_FINER && !m.tile.base);
        lw_message_finish(&m);
    }
    lw_snapshot_unref(s);
}

/* They are there while clients list them, and the server above was asked. Their ids are free with the first
 * snapshot that knows of neither. */
static void finer_tiles_come_and_go(void **state) {
    (void)state;
    static const uint32_t none = 0, first = 1;
    lw_relay_light_begin(light, FULL);
    take_all(FULL, 5);
    const lw_tile_id id = claim(first);
    encode(id.v, 8);
    take_tile(FULL, source[id.v].whole); /* nobody has asked: it was under way */
    expect_fine(id, 0, 0, false);
    assert_false(list(1, &first, 1, true));
    take_tile(FULL, source[id.v].whole);
    expect_fine(id, 8, LW_TILE_CODEC_DCT, true);
    take_frame(FULL, 6);
    encode(id.v, 11); /* a form with wider steps */
    take_tile(FULL, source[id.v].delta);
    struct lw_snapshot *s = snapshot();
    expect_tile(s->tile[FULL][id.v].delta, &source[id.v].delta);
    expect_tile(s->tile[FULL][id.v].blob, &source[id.v].whole);
    lw_snapshot_unref(s);
    assert_false(list(2, &none, 0, false)); /* the server above has not heard of it */
    expect_fine(id, 11, LW_TILE_CODEC_DCT, true);
    lw_relay_light_ask(light, FULL, NULL, 0);
    assert_int_equal(lw_relay_light_news(light), LW_RELAY_LIGHT_SOME);
    take_tile(FULL, source[id.v].whole);
    expect_fine(id, 0, 0, false);
    /* it is another tile's now, which has a smaller version */
    lw_atlas_map_release(map, id);
    while (claim(2).v != id.v) lw_atlas_map_release(map, claim(2));
    source[id.v] = (struct source){0};
    encode(id.v, 4);
    static const uint32_t second = 2;
    assert_false(list(3, &second, 1, true));
    take_tile(FULL, source[id.v].whole);
    take_settled(FULL, 6);
    expect_fine(id, 4, LW_TILE_CODEC_DCT, true);
}

static const uint32_t two_tiles[2] = {0, 1};

/* Light of frame 5, and two finer tiles of a version, both listed. */
static void begin_with_two(lw_tile_id id[2], uint64_t version) {
    lw_relay_light_begin(light, FULL);
    take_all(FULL, 5);
    (void)list(1, two_tiles, 2, true);
    for (uint32_t i = 0; i < 2; i++) {
        id[i] = claim(i);
        encode(id[i].v, version);
        take_tile(FULL, source[id[i].v].whole);
    }
    take_settled(FULL, 5);
}

/* The server above forgets them when a session ends. A tile that does not come again is withdrawn, and may
 * return. */
static void finer_tiles_of_a_session_that_ended_are_in_doubt(void **state) {
    (void)state;
    lw_tile_id id[2];
    begin_with_two(id, 6);
    expect_fine(id[0], 6, LW_TILE_CODEC_DCT, true);
    lw_relay_light_end(light, FULL);
    expect_fine(id[0], 6, LW_TILE_CODEC_DCT, true); /* light stays */
    lw_relay_light_begin(light, FULL);
    (void)list(2, two_tiles, 2, true);
    take_frame(FULL, 5);
    take_tile(FULL, source[id[0].v].whole);
    encode(id[1].v, 8);
    take_tile(FULL, source[id[1].v].delta); /* builds on a version of the session before: it means nothing */
    take_settled(FULL, 5);
    expect_fine(id[0], 6, LW_TILE_CODEC_DCT, true); /* the same: clients hear nothing */
    expect_fine(id[1], 7, LW_TILE_CODEC_NONE, true);
    encode(id[0].v, 10);
    take_tile(FULL, source[id[0].v].delta);
    source[id[1].v].whole.version = 6; /* as old as before */
    take_tile(FULL, source[id[1].v].whole);
    take_settled(FULL, 5);
    expect_fine(id[0], 10, LW_TILE_CODEC_DCT, true);
    expect_fine(id[1], 8, LW_TILE_CODEC_DCT, true);
    /* a tile that is as new as the frame is withdrawn once there is a frame to say so */
    struct lw_message_tile gone = source[id[0].v].whole;
    gone.codec = LW_TILE_CODEC_NONE;
    take_tile(FULL, gone);
    take_settled(FULL, 5);
    expect_fine(id[0], 10, LW_TILE_CODEC_DCT, true);
    take_frame(FULL, 6);
    take_settled(FULL, 6);
    expect_fine(id[0], 11, LW_TILE_CODEC_NONE, true);
}

/* Where the server above is asked for fewer than clients list, they hear of it. Listed again, a tile that was
 * dropped comes under its version. */
static void finer_tiles_give_way(void **state) {
    (void)state;
    lw_tile_id id[2];
    begin_with_two(id, 10);
    expect_fine(id[1], 10, LW_TILE_CODEC_DCT, true);
    take_frame(FULL, 6);
    lw_relay_light_ask(light, FULL, id, 1);
    take_settled(FULL, 6);
    expect_fine(id[0], 10, LW_TILE_CODEC_DCT, true);
    expect_fine(id[1], 11, LW_TILE_CODEC_NONE, true);
    assert_true(list(2, two_tiles, 0, true)); /* nobody asks for the second */
    expect_fine(id[0], 0, 0, false);
    (void)list(3, two_tiles, 1, true);
    take_tile(FULL, source[id[0].v].whole);
    expect_fine(id[0], 10, LW_TILE_CODEC_DCT, true);
}

static void finer_tiles_that_make_no_sense_are_refused(void **state) {
    (void)state;
    static const uint32_t tile = 0;
    lw_relay_light_begin(light, FULL);
    take_all(FULL, 5);
    (void)list(1, &tile, 1, true);
    const lw_tile_id id = claim(0);
    encode(id.v, 10);
    struct lw_message_tile t = source[id.v].whole;
    t.layer = FULL;
    t.codec = 77;
    refuse_tile(t, "its codec is unknown");
    t = source[id.v].whole;
    t.layer = FULL;
    t.level = LW_ATLAS_FINER + 3;
    refuse_tile(t, "it does not exist");
    t = source[id.v].whole;
    t.layer = FULL;
    t.tile = 100000;
    refuse_tile(t, "it does not exist");
    t = source[id.v].whole;
    t.layer = FULL;
    t.version = 11;
    refuse_tile(t, "its version is over twice the number of the frame");
    t = source[id.v].whole;
    t.layer = FULL;
    t.payload_size /= 2;
    refuse_tile(t, "the payload is damaged");
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(tiles_are_passed_on, begin, end),
        cmocka_unit_test_setup_teardown(versions_between_snapshots_are_one_delta, begin, end),
        cmocka_unit_test_setup_teardown(channels_settle_apart, begin, end),
        cmocka_unit_test_setup_teardown(light_stays, begin, end),
        cmocka_unit_test_setup_teardown(what_makes_no_sense_is_refused, begin, end),
        cmocka_unit_test_setup_teardown(another_run_counts_on, begin, end),
        cmocka_unit_test_setup_teardown(a_run_may_end_before_its_first_frame, begin, end),
        cmocka_unit_test_setup_teardown(finer_tiles_come_and_go, begin_finer, end),
        cmocka_unit_test_setup_teardown(finer_tiles_of_a_session_that_ended_are_in_doubt, begin_finer, end),
        cmocka_unit_test_setup_teardown(finer_tiles_give_way, begin_finer, end),
        cmocka_unit_test_setup_teardown(finer_tiles_that_make_no_sense_are_refused, begin_finer, end),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
