#include "tests/support/failing_memory.h"
#include "tests/support/support.h"

#include "common/base/random.h"
#include "common/tile/tile_codec.h"
#include "server/publish/publisher.h"

#include <stdlib.h>
#include <string.h>

#define SIDE 64u

/* A solver whose only object holds what the test says. */
static float light[3][SIDE * SIDE], split[3][SIDE * SIDE], nothing[SIDE * SIDE], error;
static uint8_t covered[SIDE * SIDE];
static uint64_t solved_frame;
static lw_tile_id fine; /* a tile of a finer level, and whether it is there */
static bool fine_is_there;
static float error_below;    /* the error of the tile of level 0 below */
static uint32_t second_tile; /* first tile of a second object with the same light; 0: there is none */

static void read_tile(const struct lw_solver *solver, lw_tile_id id, struct lw_solver_tile *tile) {
    (void)solver;
    assert_true(id.v == 0 || id.v == second_tile || (fine_is_there && id.v == fine.v));
    *tile = (struct lw_solver_tile){.shown = {{light[0], light[1], light[2]}, {split[0], split[1], split[2]}},
                                    .direct = {light[0], light[1], light[2]},
                                    .indirect = {nothing, nothing, nothing},
                                    .covered = covered,
                                    .width = SIDE,
                                    .height = SIDE,
                                    .bounces = 2,
                                    .sample_count = 1,
                                    .error = fine_is_there && id.v != fine.v ? error_below : error,
                                    .solved_frame = solved_frame,
                                    .has_surface = true};
}

static uint32_t list_fine(const struct lw_solver *solver, const lw_tile_id **out_tile) {
    (void)solver;
    *out_tile = &fine;
    return fine_is_there;
}

static bool holds_fine(const struct lw_solver *solver, lw_tile_id id) {
    (void)solver;
    return fine_is_there && id.v == fine.v;
}

static const struct lw_solver_ops ops = {
    .name = "test", .read_tile = read_tile, .list_fine = list_fine, .holds_fine = holds_fine};

struct world {
    struct lw_scene *scene;
    struct lw_atlas_map map;
    struct lw_pose pose;
    struct lw_solver solver;
    struct lw_publisher *publisher;
    struct lw_tile_codec *codec;
};

static uint64_t state_max; /* bytes that the next world's publisher keeps */

static void init_world_of(struct world *w, uint32_t codec, uint32_t objects, uint32_t finer) {
    fine_is_there = false;
    error_below = 0.1f;
    *w = (struct world){.scene = lw_support_squares(objects, 1), .solver = {&ops}};
    w->scene->mesh[0].atlas_width = w->scene->mesh[0].atlas_height = SIDE;
    lw_support_ok(lw_atlas_map_init_finer(&w->map, w->scene, finer, finer ? 4 : 0), NULL);
    second_tile = objects > 1 ? w->map.first_tile[1] : 0;
    lw_support_ok(lw_pose_init(&w->pose, w->scene), NULL);
    lw_support_ok(lw_tile_codec_create(&w->codec), NULL);
    lw_support_ok(lw_publisher_create(&(struct lw_publisher_desc){.scene = w->scene,
                                                                  .atlas_map = &w->map,
                                                                  .solver = &w->solver,
                                                                  .target_error = 0.02f,
                                                                  .codec = codec,
                                                                  .state_max = state_max,
                                                                  .threads = 1},
                                      &w->publisher),
                  NULL);
    error = 0.1f;
    memset(covered, 1, sizeof covered);
}

static void init_world(struct world *w, uint32_t codec) { init_world_of(w, codec, 1, 0); }

static void finish_world(struct world *w) {
    lw_publisher_destroy(w->publisher);
    lw_tile_codec_destroy(w->codec);
    lw_pose_finish(&w->pose);
    lw_atlas_map_finish(&w->map);
    lw_scene_destroy(w->scene);
}

/* A slope, a little noise, and a spot of light that wanders. */
static void set_light(uint64_t frame, float brightness) {
    for (uint32_t i = 0; i < SIDE * SIDE; i++)
        for (uint32_t c = 0; c < 3; c++) {
            const uint32_t x = i % SIDE, y = i / SIDE;
            const float spot = x / 8 == frame % 8 && y < 16 ? 2 : 1;
            light[c][i] = brightness * spot * (1 + 0.01f * (float)y) *
                          (1 + 0.1f * lw_random_unit(lw_random_hash3(i, c, (uint32_t)frame)));
        }
    solved_frame = frame;
}

static struct lw_publisher_stats stats; /* the last frame's */

static struct lw_snapshot *publish_solved(struct world *w, uint64_t frame, uint64_t tiles_solved) {
    struct lw_snapshot *snapshot;
    lw_support_ok(lw_publisher_publish(w->publisher, &w->pose, frame, 1, 1, tiles_solved, &snapshot, &stats),
                  NULL);
    return snapshot;
}

static struct lw_snapshot *publish(struct world *w, uint64_t frame) { return publish_solved(w, frame, 1); }

/* What a client makes of a blob; returns the payload's size. */
static size_t decode(const struct world *w, const struct lw_blob *blob, uint64_t version, uint64_t base,
                     struct lw_tile_dct_coefficients *levels, float *rgb, float *out_scale) {
    struct lw_framing_header header;
    struct lw_message m;
    lw_support_ok(lw_framing_read_header(blob->bytes, LW_FRAMING_BODY_MAX, &header, NULL), NULL);
    lw_support_ok(lw_message_decode(header, blob->bytes + LW_FRAMING_HEADER_SIZE, &m, NULL), NULL);
    assert_int_equal(m.type, LW_MESSAGE_TILE);
    assert_int_equal(m.tile.version, lw_snapshot_version(version));
    assert_int_equal(m.tile.base, lw_snapshot_version(base));
    lw_support_ok((base ? lw_tile_codec_decode_delta
                        : lw_tile_codec_decode)(w->codec, NULL, m.tile.codec, m.tile.payload,
                                                m.tile.payload_size, m.tile.scale, SIDE, SIDE, levels, rgb),
                  NULL);
    const size_t size = m.tile.payload_size;
    *out_scale = m.tile.scale;
    lw_message_finish(&m);
    return size;
}

/* Who follows every frame and who joins see the same; following costs less. */
static void test_deltas(void **state) {
    (void)state;
    static struct lw_tile_dct_coefficients levels;
    static float followed[SIDE * SIDE * 3], joined[SIDE * SIDE * 3];
    struct world w;
    init_world(&w, LW_TILE_CODEC_DCT);
    size_t whole_size = 0, delta_size = 0;
    float scale;
    error = 0.2f; /* and steps of 0.2, which the noise does not fill */
    for (uint64_t frame = 1; frame <= 6; frame++) {
        set_light(frame, 5);
        struct lw_snapshot *s = publish(&w, frame);
        const struct lw_snapshot_tile *tile = &s->tile[LW_TILE_CHANNEL_FULL][0];
        assert_int_equal(tile->version, lw_snapshot_version(frame));
        whole_size += decode(&w, tile->blob, frame, 0, frame > 1 ? NULL : &levels, joined, &scale);
        assert_true(frame > 1 ? tile->delta && tile->base == lw_snapshot_version(frame - 1) : !tile->delta);
        if (frame > 1) {
            delta_size += decode(&w, tile->delta, frame, frame - 1, &levels, followed, &scale);
            assert_memory_equal(followed, joined, sizeof joined);
        }
        lw_snapshot_unref(s);
    }
    assert_true(delta_size < whole_size * 2 / 3);
    struct lw_snapshot *s = publish(&w, 7); /* nothing moved: sent tiles stay as they are */
    assert_int_equal(s->tile[LW_TILE_CHANNEL_FULL][0].version, lw_snapshot_version(6));
    assert_int_equal(s->tile[LW_TILE_CHANNEL_FULL][0].base, lw_snapshot_version(5));
    lw_snapshot_unref(s);
    set_light(8, 5000); /* no sent tile is of use */
    s = publish(&w, 8);
    assert_int_equal(s->tile[LW_TILE_CHANNEL_FULL][0].version, lw_snapshot_version(8));
    assert_null(s->tile[LW_TILE_CHANNEL_FULL][0].delta);
    lw_snapshot_unref(s);
    finish_world(&w);
}

/* Each tile as a publisher has it that has published nothing before. */
static void expect_fresh(const struct lw_snapshot *s, uint64_t frame) {
    struct world fresh;
    init_world(&fresh, LW_TILE_CODEC_DCT);
    error = 0.2f;
    struct lw_snapshot *whole = publish(&fresh, frame);
    for (uint32_t t = 0; t < s->tile_count; t++) {
        const struct lw_snapshot_tile *tile = &s->tile[LW_TILE_CHANNEL_FULL][t];
        const struct lw_blob *blob = whole->tile[LW_TILE_CHANNEL_FULL][t].blob;
        assert_null(tile->delta);
        assert_int_equal(tile->version, lw_snapshot_version(frame));
        assert_int_equal(tile->blob->size, blob->size);
        assert_memory_equal(tile->blob->bytes, blob->bytes, blob->size);
    }
    lw_snapshot_unref(whole);
    finish_world(&fresh);
}

/* Where the state of all objects takes too much, an object that nobody looks at has none, and its tiles come
 * whole. Somebody looks from frame 4 to frame 6. */
static void test_state_of_who_is_looked_at(void **state) {
    (void)state;
    static struct lw_tile_dct_coefficients levels;
    static float followed[SIDE * SIDE * 3], joined[SIDE * SIDE * 3];
    struct world w;
    float scale;
    size_t looked_at = 0;
    state_max = 1;
    init_world(&w, LW_TILE_CODEC_DCT);
    state_max = 0;
    uint8_t *wanted = calloc(w.map.tile_count, 1);
    for (uint64_t frame = 1; frame <= 8; frame++) {
        error = 0.2f;
        set_light(frame, 5);
        wanted[0] = frame >= 4 && frame <= 6;
        lw_publisher_want(w.publisher, wanted);
        struct lw_snapshot *s = publish(&w, frame);
        const struct lw_snapshot_tile *tile = &s->tile[LW_TILE_CHANNEL_FULL][0];
        if (frame < 5 || frame > 6) {
            expect_fresh(s, frame);
        } else {
            assert_true(tile->delta && tile->base == lw_snapshot_version(frame - 1));
            decode(&w, tile->delta, frame, frame - 1, &levels, followed, &scale);
        }
        decode(&w, tile->blob, frame, 0, frame == 4 ? &levels : NULL, joined, &scale);
        if (frame == 5 || frame == 6) assert_memory_equal(followed, joined, sizeof joined);
        if (frame == 6) looked_at = lw_publisher_memory_bytes(w.publisher);
        lw_snapshot_unref(s);
    }
    assert_true(lw_publisher_memory_bytes(w.publisher) < looked_at / 4);
    struct lw_snapshot *s = publish(&w, 9); /* nothing moved */
    assert_int_equal(s->tile[LW_TILE_CHANNEL_FULL][0].version, lw_snapshot_version(8));
    lw_snapshot_unref(s);
    free(wanted);
    finish_world(&w);
}

static struct lw_message frame_of(const struct lw_blob *blob) {
    struct lw_framing_header header;
    struct lw_message m;
    lw_support_ok(lw_framing_read_header(blob->bytes, LW_FRAMING_BODY_MAX, &header, NULL), NULL);
    lw_support_ok(lw_message_decode(header, blob->bytes + LW_FRAMING_HEADER_SIZE, &m, NULL), NULL);
    assert_int_equal(m.type, LW_MESSAGE_FRAME);
    return m;
}

static void expect_object(const struct lw_blob *blob, size_t hidden, size_t spares, size_t shown) {
    struct lw_message m = frame_of(blob);
    assert_int_equal(m.frame.hidden_count, hidden);
    assert_int_equal(m.frame.spare_count, spares);
    assert_int_equal(m.frame.shown_count, shown);
    lw_message_finish(&m);
}

static void expect_base(const struct lw_blob *blob, uint64_t base) {
    struct lw_message m = frame_of(blob);
    assert_int_equal(m.frame.base, base);
    lw_message_finish(&m);
}

/* Its light is sent once all of it has been solved there, even if it is the light that was sent before. */
static void test_an_object_that_was_a_spare(void **state) {
    (void)state;
    struct world w;
    init_world(&w, LW_TILE_CODEC_DCT);
    set_light(1, 5);
    lw_snapshot_unref(publish(&w, 1));
    w.pose.object_spare[0] = w.pose.object_hidden[0] = true;
    struct lw_snapshot *s = publish(&w, 2);
    expect_object(s->frame_full, 1, 1, 0);
    expect_object(s->frame_delta, 1, 1, 0);
    lw_snapshot_unref(s);
    s = publish(&w, 3);
    expect_object(s->frame_full, 1, 1, 0);
    expect_object(s->frame_delta, 0, 0, 0);
    expect_base(s->frame_full, 0);
    expect_base(s->frame_delta, 2);
    lw_snapshot_unref(s);
    w.pose.object_spare[0] = false; /* added, and hidden at once */
    s = publish(&w, 4);
    expect_object(s->frame_delta, 1, 0, 0);
    lw_snapshot_unref(s);
    w.pose.object_hidden[0] = false;
    s = publish(&w, 5);
    expect_object(s->frame_full, 0, 0, 1);
    expect_object(s->frame_delta, 0, 0, 1);
    assert_int_equal(s->tile[LW_TILE_CHANNEL_FULL][0].version, lw_snapshot_version(1)); /* not solved yet */
    lw_snapshot_unref(s);
    solved_frame = 6;
    s = publish(&w, 6);
    assert_int_equal(s->tile[LW_TILE_CHANNEL_FULL][0].version, lw_snapshot_version(6));
    lw_snapshot_unref(s);
    solved_frame = 7;
    s = publish(&w, 7); /* and only then */
    assert_int_equal(s->tile[LW_TILE_CHANNEL_FULL][0].version, lw_snapshot_version(6));
    lw_snapshot_unref(s);
    finish_world(&w);
}

/* Views read a tile at another level: that is published though its light is as it was. */
static void test_another_class_of_error(void **state) {
    (void)state;
    static const struct {
        float error;
        bool is_sent;
    } step[] = {{0.5f, true},   {0.3f, false}, {0.2f, true},  {0.15f, false}, {0.09f, true},
                {0.03f, false}, {0.02f, true}, {0.15f, true}, {0.4f, true}};
    struct world w;
    init_world(&w, LW_TILE_CODEC_DCT);
    set_light(1, 5);
    for (uint64_t frame = 1; frame <= sizeof step / sizeof *step; frame++) {
        error = step[frame - 1].error;
        solved_frame = frame;
        struct lw_snapshot *s = publish(&w, frame);
        assert_int_equal(s->tile[LW_TILE_CHANNEL_FULL][0].version == lw_snapshot_version(frame),
                         step[frame - 1].is_sent);
        lw_snapshot_unref(s);
    }
    finish_world(&w);
}

/* Steps follow the noise of light at rest; they are never so wide that a view would show it. */
static void test_steps(void **state) {
    (void)state;
    static const struct {
        float error;
        uint32_t level;
        float step;
    } of[] = {{INFINITY, 0, 0.4f},
              {INFINITY, 1, 0.2f},
              {0.11f, 0, 0.4f},
              {0.09f, 0, 0.09f},
              {0.04f, 1, 0.04f},
              {0.16f, 2, 0.08f},
              {0.9f, 2, 0.2f},
              {0.06f, 3, LW_PUBLISHER_STEP_MIN},
              {0, 0, LW_PUBLISHER_STEP_MIN}};
    for (size_t i = 0; i < sizeof of / sizeof *of; i++)
        assert_float_equal(lw_publisher_step(of[i].error, 1, of[i].level, 0.2f), of[i].step, 1e-6f);
    /* what a filter leaves is what counts as noise, but not at rest */
    assert_float_equal(lw_publisher_step(0.45f, 0.2f, 0, 0.2f), 0.2f, 1e-6f);
    assert_float_equal(lw_publisher_step(0.55f, 0.2f, 0, 0.2f), 0.4f, 1e-6f);
    assert_float_equal(lw_publisher_step(0.09f, 0.2f, 0, 0.2f), 0.09f, 1e-6f);
}

/* The scale follows the whole scene's white. */
static void test_dark_beside_white(void **state) {
    (void)state;
    static float rgb[SIDE * SIDE * 3];
    struct world w;
    init_world(&w, LW_TILE_CODEC_DCT);
    set_light(1, 1);
    float scale;
    for (uint32_t i = 0; i < SIDE * SIDE / 32; i++)
        for (int c = 0; c < 3; c++) light[c][i] = 2048; /* a quarter of a square: a white of 512 */
    struct lw_snapshot *s = publish(&w, 1);
    decode(&w, s->tile[LW_TILE_CHANNEL_FULL][0].blob, 1, 0, NULL, rgb, &scale);
    assert_true(scale >= 512 * 0.8f * LW_PUBLISHER_DARK_SHARE);
    lw_snapshot_unref(s);
    finish_world(&w);
}

#define FULL  (1u << LW_TILE_CHANNEL_FULL)
#define SPLIT (1u << LW_TILE_CHANNEL_SPLIT)

static void expect_channel(const struct world *w, const struct lw_snapshot *s, uint32_t channel,
                           uint64_t version, float value) {
    static float rgb[SIDE * SIDE * 3];
    float scale;
    struct lw_framing_header header;
    struct lw_message m;
    assert_true(lw_snapshot_has(s, channel));
    const struct lw_blob *blob = s->tile[channel][0].blob;
    assert_int_equal(s->tile[channel][0].version, lw_snapshot_version(version));
    decode(w, blob, version, 0, NULL, rgb, &scale);
    assert_true(fabsf(rgb[0] / value - 1) < 0.001f);
    lw_support_ok(lw_framing_read_header(blob->bytes, LW_FRAMING_BODY_MAX, &header, NULL), NULL);
    lw_support_ok(lw_message_decode(header, blob->bytes + LW_FRAMING_HEADER_SIZE, &m, NULL), NULL);
    assert_int_equal(m.tile.layer, channel);
    lw_message_finish(&m);
}

/* A channel is published while it is to be, whole from the next frame on, though nothing was solved. */
static void test_channels(void **state) {
    (void)state;
    struct world w;
    init_world(&w, LW_TILE_CODEC_HALF_ZSTD);
    set_light(1, 5);
    for (uint32_t i = 0; i < SIDE * SIDE; i++)
        for (int c = 0; c < 3; c++) split[c][i] = 0.25f * light[c][i];
    struct lw_snapshot *s = publish(&w, 1);
    assert_int_equal(s->channels, FULL);
    assert_null(s->tile[LW_TILE_CHANNEL_SPLIT]);
    assert_int_equal(stats.split_tiles_encoded, 0);
    lw_snapshot_unref(s);
    const size_t one = lw_publisher_memory_bytes(w.publisher);
    lw_support_ok(lw_publisher_set_channels(w.publisher, FULL | SPLIT), NULL);
    s = publish_solved(&w, 2, 0);
    assert_int_equal(s->channels, FULL | SPLIT);
    expect_channel(&w, s, LW_TILE_CHANNEL_FULL, 1, light[0][0]);
    expect_channel(&w, s, LW_TILE_CHANNEL_SPLIT, 2, split[0][0]);
    assert_true(stats.split_tiles_encoded == w.map.tile_count &&
                stats.tiles_encoded == stats.split_tiles_encoded &&
                stats.bytes_encoded == stats.split_bytes_encoded);
    assert_true(lw_publisher_memory_bytes(w.publisher) > 3 * one / 2);
    lw_snapshot_unref(s);
    s = publish_solved(&w, 3, 0); /* nothing is news */
    expect_channel(&w, s, LW_TILE_CHANNEL_SPLIT, 2, split[0][0]);
    assert_int_equal(stats.tiles_encoded, 0);
    lw_snapshot_unref(s);
    lw_support_ok(lw_publisher_set_channels(w.publisher, SPLIT), NULL);
    set_light(4, 10); /* a client light is brighter: the rest is as it was */
    s = publish(&w, 4);
    assert_int_equal(s->channels, SPLIT);
    expect_channel(&w, s, LW_TILE_CHANNEL_SPLIT, 2, split[0][0]);
    lw_snapshot_unref(s);
    lw_support_ok(lw_publisher_set_channels(w.publisher, FULL), NULL);
    s = publish_solved(&w, 5, 0);
    assert_int_equal(s->channels, FULL);
    expect_channel(&w, s, LW_TILE_CHANNEL_FULL, 5, light[0][0]);
    lw_snapshot_unref(s);
    assert_true(lw_publisher_memory_bytes(w.publisher) < 5 * one / 4);
    finish_world(&w);
}

static uint8_t step_q(const struct lw_blob *blob) {
    struct lw_framing_header header;
    struct lw_message m;
    lw_support_ok(lw_framing_read_header(blob->bytes, LW_FRAMING_BODY_MAX, &header, NULL), NULL);
    lw_support_ok(lw_message_decode(header, blob->bytes + LW_FRAMING_HEADER_SIZE, &m, NULL), NULL);
    const uint8_t q = m.tile.payload[1]; /* a step is 2^(1 - q/8) */
    lw_message_finish(&m);
    return q;
}

/* What clients draw has no error: the rest may have a larger one. */
static void test_split_steps_are_wider(void **state) {
    (void)state;
    struct world w;
    init_world(&w, LW_TILE_CODEC_DCT);
    lw_support_ok(lw_publisher_set_channels(w.publisher, FULL | SPLIT), NULL);
    for (uint64_t frame = 1; frame <= 2; frame++) {
        error = frame == 1 ? 0.2f : 0.04f;
        set_light(frame, frame == 1 ? 5 : 5000); /* so far apart that nothing goes on from the first */
        memcpy(split, light, sizeof split);
        struct lw_snapshot *s = publish(&w, frame);
        const int wider =
            step_q(s->tile[LW_TILE_CHANNEL_FULL][0].blob) - step_q(s->tile[LW_TILE_CHANNEL_SPLIT][0].blob);
        assert_int_equal(wider, 8); /* twice the step */
        lw_snapshot_unref(s);
    }
    finish_world(&w);
}

/* Light drawn over a tile is as bright as the light in it: black goes by all light. */
static void test_dark_beside_what_is_drawn(void **state) {
    (void)state;
    static float rgb[SIDE * SIDE * 3];
    struct world w;
    init_world(&w, LW_TILE_CODEC_DCT);
    lw_support_ok(lw_publisher_set_channels(w.publisher, SPLIT), NULL);
    set_light(1, 1);
    float scale;
    for (uint32_t i = 0; i < SIDE * SIDE; i++)
        for (int c = 0; c < 3; c++) {
            split[c][i] = 16;
            light[c][i] = i < SIDE * SIDE / 32 ? 2048 : 16;
        }
    struct lw_snapshot *s = publish(&w, 1);
    decode(&w, s->tile[LW_TILE_CHANNEL_SPLIT][0].blob, 1, 0, NULL, rgb, &scale);
    assert_true(scale >= 512 * LW_PUBLISHER_DARK_SHARE); /* 2,048 over a quarter of a square's rows */
    lw_snapshot_unref(s);
    finish_world(&w);
}

static void test_halves_have_no_deltas(void **state) {
    (void)state;
    static float rgb[SIDE * SIDE * 3];
    float scale;
    struct world w;
    init_world(&w, LW_TILE_CODEC_HALF_ZSTD);
    for (uint64_t frame = 1; frame <= 2; frame++) {
        set_light(frame, 5);
        struct lw_snapshot *s = publish(&w, frame);
        decode(&w, s->tile[LW_TILE_CHANNEL_FULL][0].blob, frame, 0, NULL, rgb, &scale);
        assert_true(fabsf(rgb[0] / light[0][0] - 1) < 0.001f);
        assert_null(s->tile[LW_TILE_CHANNEL_FULL][0].delta);
        lw_snapshot_unref(s);
    }
    finish_world(&w);
}

static double mean(const float *rgb) {
    double sum = 0;
    for (uint32_t i = 0; i < SIDE * SIDE * 3; i++) sum += (double)rgb[i];
    return sum / (SIDE * SIDE * 3);
}

struct follower {
    struct lw_tile_dct_coefficients levels;
    float followed[SIDE * SIDE * 3], joined[SIDE * SIDE * 3];
};

/* Two objects: the tile of the second is not even looked at where that of the first fails. */
static void follow(const struct world *w, const struct lw_snapshot *s, uint32_t id, struct follower *f) {
    float scale;
    const struct lw_snapshot_tile *tile = &s->tile[LW_TILE_CHANNEL_FULL][id];
    const uint64_t frame = lw_snapshot_frame_of(tile->version);
    decode(w, tile->blob, frame, 0, &f->levels, f->followed, &scale);
}

static void expect_newest(const struct world *w, const struct lw_snapshot *s, uint32_t id, uint64_t failed,
                          struct follower *f) {
    float scale;
    const struct lw_snapshot_tile *tile = &s->tile[LW_TILE_CHANNEL_FULL][id];
    const uint64_t frame = lw_snapshot_frame_of(tile->version), base = lw_snapshot_frame_of(tile->base);
    const bool follows = tile->delta && base == failed - 1;
    assert_in_range(frame, failed, failed + 1);
    if (follows) decode(w, tile->delta, frame, base, &f->levels, f->followed, &scale);
    decode(w, tile->blob, frame, 0, NULL, f->joined, &scale);
    assert_true(mean(f->joined) > 0.95 * mean(&light[0][0]) && mean(f->joined) < 1.05 * mean(&light[0][0]));
    if (follows) assert_memory_equal(f->followed, f->joined, sizeof f->joined);
}

/* What a frame could not publish the next one does, though nothing is solved in it; who follows by deltas has
 * the same as who joins. Returns whether the frame took fewer allocations than that. */
static bool publish_without(uint64_t failing_frame, unsigned allocation) {
    static struct follower first, second;
    struct world w;
    struct lw_snapshot *s = NULL;
    init_world_of(&w, LW_TILE_CODEC_DCT, 2, 0);
    for (uint64_t frame = 1; frame < failing_frame; frame++) {
        set_light(frame, (float)frame);
        s = publish(&w, frame);
        follow(&w, s, 0, &first);
        follow(&w, s, second_tile, &second);
        lw_snapshot_unref(s);
    }
    set_light(failing_frame, (float)failing_frame);
    failing_memory_one(allocation);
    const enum lw_status status =
        lw_publisher_publish(w.publisher, &w.pose, failing_frame, 1, 1, 1, &s, &stats);
    (void)failing_memory_end();
    if (status != LW_OK) {
        assert_int_equal(status, LW_NO_MEMORY);
        (void)lw_publisher_memory_bytes(w.publisher);
        s = publish_solved(&w, failing_frame + 1, 0);
        assert_int_equal(s->previous_frame, failing_frame - 1);
        expect_newest(&w, s, 0, failing_frame, &first);
        expect_newest(&w, s, second_tile, failing_frame, &second);
    }
    lw_snapshot_unref(s);
    finish_world(&w);
    return status == LW_OK;
}

/* A spare's light is not published for want of memory, then it is added and held back: a tile that is of no
 * version has no bytes either, and nothing builds on it. Returns whether the frame took fewer allocations. */
static bool hold_back_without(unsigned allocation) {
    struct world w;
    struct lw_snapshot *s = NULL;
    init_world(&w, LW_TILE_CODEC_DCT);
    set_light(1, 5);
    lw_snapshot_unref(publish(&w, 1));
    set_light(2, 6);
    lw_snapshot_unref(publish(&w, 2));
    w.pose.object_spare[0] = w.pose.object_hidden[0] = true;
    lw_snapshot_unref(publish(&w, 3));
    set_light(4, 7);
    failing_memory_one(allocation);
    const enum lw_status status = lw_publisher_publish(w.publisher, &w.pose, 4, 1, 1, 1, &s, &stats);
    (void)failing_memory_end();
    if (status != LW_OK) {
        w.pose.object_spare[0] = w.pose.object_hidden[0] = false;
        s = publish_solved(&w, 5, 0);
        for (uint32_t t = 0; t < s->tile_count; t++) {
            const struct lw_snapshot_tile *tile = &s->tile[LW_TILE_CHANNEL_FULL][t];
            assert_int_equal(tile->version == 0, tile->blob == NULL);
            assert_true(!tile->delta || tile->base < tile->version);
        }
    }
    lw_snapshot_unref(s);
    finish_world(&w);
    return status == LW_OK;
}

static void test_held_back_without_memory(void **state) {
    (void)state;
    unsigned allocation = 0;
    while (!hold_back_without(allocation)) allocation++;
    assert_true(allocation > 3);
}

static void test_without_memory(void **state) {
    (void)state;
    for (state_max = 0; state_max < 2; state_max++) /* the second time nobody looks */
        for (uint64_t frame = 1; frame <= 3; frame++) {
            unsigned allocation = 0;
            while (!publish_without(frame, allocation)) allocation++;
            assert_true(allocation > 7);
        }
    state_max = 0;
}

/* ---- tiles of finer levels ---- */

static struct lw_message_tile tile_of(const struct lw_snapshot *s, lw_tile_id id) {
    const struct lw_snapshot_tile *tile = &s->tile[LW_TILE_CHANNEL_FULL][id.v];
    struct lw_message m;
    lw_support_ok(lw_message_decode_whole(tile->blob->bytes, tile->blob->size, &m), NULL);
    const struct lw_message_tile is = m.tile;
    lw_message_finish(&m);
    assert_int_equal(is.version, tile->version);
    return is;
}

/* The first version waits until it has little noise, deltas follow, and clients that have it hear of its
 * removal. When it is there again it comes whole. */
static void test_fine_tiles_come_and_go(void **state) {
    (void)state;
    struct world w;
    init_world_of(&w, LW_TILE_CODEC_DCT, 1, 1);
    fine = lw_atlas_map_claim(&w.map, 0, LW_ATLAS_FINER + 1, 1, 1);
    fine_is_there = true;
    uint32_t deltas = 0;
    for (uint64_t frame = 1; frame < 10; frame++) {
        /* a sent tile may be noisy again; deltas pay where steps are wide */
        error = frame < 2 ? 0.5f : frame == 2 || frame == 7 ? 0.1f : 0.2f;
        fine_is_there = frame < 4 || frame > 6;
        set_light(frame, 5);
        struct lw_snapshot *s = publish(&w, frame);
        const struct lw_snapshot_tile *tile = &s->tile[LW_TILE_CHANNEL_FULL][fine.v];
        const uint64_t expected = frame < 2 ? 0 : frame < 4 ? frame : frame <= 6 ? 4 : frame;
        assert_int_equal(tile->version, expected ? lw_snapshot_version(expected) : 0);
        assert_true(!tile->delta || frame == 3 || frame > 7);
        deltas += tile->delta != NULL;
        assert_int_equal(lw_snapshot_holds_fine(s, fine.v - w.map.plain_count), fine_is_there);
        assert_false(lw_snapshot_holds_fine(s, fine.v - w.map.plain_count + 1));
        if (expected) {
            const struct lw_message_tile is = tile_of(s, fine);
            assert_int_equal(is.level, LW_ATLAS_FINER + 1);
            assert_int_equal(is.tile, 3);
            assert_int_equal(is.codec, expected == 4 ? LW_TILE_CODEC_NONE : LW_TILE_CODEC_DCT);
        }
        lw_snapshot_unref(s);
    }
    assert_true(deltas > 0);
    finish_world(&w);
}

/* It is held back while its error is larger than that of the tile below, which views read meanwhile, unless
 * it shows next to no noise. */
static void test_a_fine_tile_with_the_larger_error_is_held_back(void **state) {
    (void)state;
    static const struct {
        float error, below;
        bool sent;
    } cases[] = {{0.2f, 0.1f, false}, {0.2f, 0.19f, false}, {0.2f, 0.2f, true},
                 {0.1f, 0.2f, true},  {0.009f, 0, false},   {0.008f, 0, true}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct world w;
        init_world_of(&w, LW_TILE_CODEC_DCT, 1, 1);
        fine = lw_atlas_map_claim(&w.map, 0, LW_ATLAS_FINER + 1, 1, 1);
        fine_is_there = true;
        error = cases[i].error;
        error_below = cases[i].below;
        for (uint64_t frame = 1; frame < 3; frame++) {
            set_light(frame, 5);
            struct lw_snapshot *s = publish(&w, frame);
            assert_int_equal(s->tile[LW_TILE_CHANNEL_FULL][fine.v].version != 0, cases[i].sent);
            assert_true(lw_snapshot_holds_fine(s, fine.v - w.map.plain_count));
            lw_snapshot_unref(s);
        }
        finish_world(&w);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_fine_tiles_come_and_go),
        cmocka_unit_test(test_a_fine_tile_with_the_larger_error_is_held_back),
        cmocka_unit_test(test_deltas),
        cmocka_unit_test(test_state_of_who_is_looked_at),
        cmocka_unit_test(test_held_back_without_memory),
        cmocka_unit_test(test_without_memory),
        cmocka_unit_test(test_an_object_that_was_a_spare),
        cmocka_unit_test(test_another_class_of_error),
        cmocka_unit_test(test_steps),
        cmocka_unit_test(test_dark_beside_white),
        cmocka_unit_test(test_channels),
        cmocka_unit_test(test_split_steps_are_wider),
        cmocka_unit_test(test_dark_beside_what_is_drawn),
        cmocka_unit_test(test_halves_have_no_deltas),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
