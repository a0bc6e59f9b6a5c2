#include "tests/support/support.h"

#include "common/base/clock.h"
#include "common/tile/tile_codec.h"
#include "server/serve/tiles/deltas.h"

#include <math.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define WHOLE 100u
#define SIDE  64u

static const uint8_t nothing[256];

/* ---- by hand: payloads only have to have a size ---- */

/* A version of tile 1 with a delta of `bytes` bytes; 0: without one. */
static void add(struct lw_deltas *deltas, uint64_t base, uint64_t version, size_t bytes) {
    struct lw_snapshot_tile tile = {.version = version, .base = base};
    lw_support_ok(lw_blob_create(WHOLE, &tile.blob), NULL);
    if (bytes) lw_support_ok(lw_blob_create(bytes, &tile.delta), NULL);
    lw_deltas_add(deltas, 1, &tile);
    lw_blob_unref(tile.delta);
    lw_blob_unref(tile.blob);
}

/* The version that comes next after `from`; 0: the newest, whole. */
static uint64_t next(struct lw_deltas *deltas, uint64_t from) {
    struct lw_delta delta;
    const enum lw_deltas_way way = lw_deltas_next(deltas, 1, from, false, &delta);
    assert_int_not_equal(way, LW_DELTAS_WAIT);
    assert_int_equal(way == LW_DELTAS_WHOLE, delta.blob == deltas->tile[1].whole);
    return way == LW_DELTAS_DELTA ? delta.version : 0;
}

static void test_one_after_another(void **state) {
    (void)state;
    struct lw_deltas deltas;
    lw_support_ok(lw_deltas_init(&deltas, 2, NULL), NULL);
    add(&deltas, 0, 3, 0); /* whole: nothing leads there */
    assert_int_equal(next(&deltas, 3), 0);
    add(&deltas, 3, 5, 30);
    add(&deltas, 5, 9, 30);
    assert_int_equal(next(&deltas, 3), 5);
    assert_int_equal(next(&deltas, 5), 9);
    assert_int_equal(next(&deltas, 9), 0); /* it is there */
    assert_int_equal(next(&deltas, 4), 0);
    add(&deltas, 9, 10, 39);
    assert_int_equal(next(&deltas, 3), 5); /* 99 bytes */
    add(&deltas, 10, 11, 31);
    assert_int_equal(next(&deltas, 3), 0); /* 130 */
    assert_int_equal(next(&deltas, 5), 0); /* 100: no fewer than whole */
    assert_int_equal(next(&deltas, 9), 10);
    add(&deltas, 11, 12, 200); /* alone it is taken even so: its encoder chose it */
    assert_int_equal(next(&deltas, 11), 12);
    assert_int_equal(next(&deltas, 10), 0);
    lw_deltas_finish(&deltas);
}

static void test_what_does_not_lead_on_is_forgotten(void **state) {
    (void)state;
    struct lw_deltas deltas;
    lw_support_ok(lw_deltas_init(&deltas, 2, NULL), NULL);
    add(&deltas, 0, 2, 0);
    add(&deltas, 3, 4, 10); /* version 3 was never heard of */
    assert_int_equal(next(&deltas, 2), 0);
    assert_int_equal(next(&deltas, 3), 0);
    add(&deltas, 4, 5, 10);
    assert_int_equal(next(&deltas, 4), 5);
    add(&deltas, 0, 6, 0);
    assert_int_equal(next(&deltas, 4), 0);
    for (uint64_t version = 7; version <= 7 + LW_DELTAS_KEPT; version++)
        add(&deltas, version - 1, version, 1);
    assert_int_equal(next(&deltas, 6), 0);
    assert_int_equal(next(&deltas, 7), 8);
    lw_deltas_finish(&deltas);
}

/* ---- real tiles, and a transcoder ---- */

struct fixture {
    struct lw_scene *scene;
    struct lw_atlas_map map;
    struct lw_tile_codec *codec;
    struct lw_tile_dct_history history;
    uint8_t *payload, *delta;
    struct lw_transcoder *transcoder;
    struct lw_deltas deltas;
    pthread_mutex_t mutex;
    bool called;
};

static void note_wake(void *context) {
    struct fixture *f = context;
    pthread_mutex_lock(&f->mutex);
    f->called = true;
    pthread_mutex_unlock(&f->mutex);
}

static void set_up(struct fixture *f) {
    *f = (struct fixture){.mutex = PTHREAD_MUTEX_INITIALIZER};
    f->scene = lw_support_squares(1, 1.0f);
    f->scene->mesh[0].atlas_width = f->scene->mesh[0].atlas_height = SIDE;
    lw_support_ok(lw_atlas_map_init(&f->map, f->scene), NULL);
    lw_support_ok(lw_tile_codec_create(&f->codec), NULL);
    f->payload = malloc(lw_tile_codec_bound());
    f->delta = malloc(lw_tile_codec_bound());
    assert_true(f->payload && f->delta);
    lw_support_ok(
        lw_transcoder_create(lw_tile_channel_at(LW_TILE_CHANNEL_FULL), &f->map, note_wake, f, &f->transcoder),
        NULL);
    lw_support_ok(lw_deltas_init(&f->deltas, f->map.tile_count, f->transcoder), NULL);
}

static void tear_down(struct fixture *f) {
    lw_transcoder_destroy(f->transcoder);
    lw_deltas_finish(&f->deltas);
    free(f->delta);
    free(f->payload);
    lw_tile_codec_destroy(f->codec);
    lw_atlas_map_finish(&f->map);
    lw_scene_destroy(f->scene);
    pthread_mutex_destroy(&f->mutex);
}

static struct lw_blob *tile_blob(uint64_t base, uint64_t version, float scale, const uint8_t *payload,
                                 size_t size) {
    struct lw_blob *blob;
    lw_support_ok(lw_blob_from_message(&(struct lw_message){.type = LW_MESSAGE_TILE,
                                                            .tile = {.version = version,
                                                                     .base = base,
                                                                     .codec = LW_TILE_CODEC_DCT,
                                                                     .scale = scale,
                                                                     .error = 0.25f,
                                                                     .bounces = 3,
                                                                     .payload = payload,
                                                                     .payload_size = size}},
                                       &blob),
                  NULL);
    return blob;
}

/* A ripple goes over the light: each change of a version is undone by a later one. */
static void add_real(struct fixture *f, uint64_t version) {
    static float rgb[SIDE * SIDE * 3];
    struct lw_tile_dct_coded coded;
    for (uint32_t i = 0; i < SIDE * SIDE; i++)
        for (uint32_t c = 0; c < 3; c++)
            rgb[3 * i + c] = 2 + 0.2f * sinf(0.3f * (float)(i % SIDE) + (float)(version % 4)) +
                             0.3f * sinf((float)(i * (c + 7)));
    lw_support_ok(lw_tile_codec_encode_dct(f->codec,
                                           &(struct lw_tile_dct_source){rgb, NULL, SIDE, SIDE, 0.1f, 0, NULL},
                                           &f->history, f->payload, f->delta, lw_tile_codec_bound(), &coded),
                  NULL);
    struct lw_snapshot_tile tile = {.version = version, .base = f->deltas.tile[0].version};
    tile.blob = tile_blob(0, version, coded.scale, f->payload, coded.size);
    if (coded.delta_size) tile.delta = tile_blob(tile.base, version, coded.scale, f->delta, coded.delta_size);
    lw_deltas_add(&f->deltas, 0, &tile);
    lw_blob_unref(tile.delta);
    lw_blob_unref(tile.blob);
}

static void wait_until_made(struct fixture *f) {
    LW_SUPPORT_WAIT_UNTIL(lw_deltas_collect(&f->deltas));
    pthread_mutex_lock(&f->mutex);
    assert_true(f->called);
    pthread_mutex_unlock(&f->mutex);
}

/* What a client has after a blob. */
static void decode(struct fixture *f, const struct lw_blob *blob, uint64_t base, uint64_t version,
                   struct lw_tile_dct_coefficients *levels, float *rgb) {
    struct lw_framing_header header;
    struct lw_message m;
    lw_support_ok(lw_framing_read_header(blob->bytes, LW_FRAMING_BODY_MAX, &header, NULL), NULL);
    lw_support_ok(lw_message_decode(header, blob->bytes + LW_FRAMING_HEADER_SIZE, &m, NULL), NULL);
    assert_int_equal(m.tile.base, base);
    assert_int_equal(m.tile.version, version);
    assert_true(m.tile.error == 0.25f && m.tile.bounces == 3);
    lw_support_ok((base ? lw_tile_codec_decode_delta
                        : lw_tile_codec_decode)(f->codec, NULL, m.tile.codec, m.tile.payload,
                                                m.tile.payload_size, m.tile.scale, SIDE, SIDE, levels, rgb),
                  NULL);
    lw_message_finish(&m);
}

static void test_a_jump_over_several_versions(void **state) {
    (void)state;
    static struct lw_tile_dct_coefficients levels;
    static float by_jump[SIDE * SIDE * 3], whole[SIDE * SIDE * 3];
    struct fixture f;
    struct lw_delta delta;
    set_up(&f);
    for (uint64_t version = 1; version <= 2; version++) add_real(&f, version);
    struct lw_blob *second = lw_blob_ref(f.deltas.tile[0].whole);
    for (uint64_t version = 3; version <= 6; version++) add_real(&f, version);
    assert_int_equal(lw_deltas_next(&f.deltas, 0, 5, false, &delta), LW_DELTAS_DELTA); /* the snapshot's */
    assert_int_equal(lw_deltas_next(&f.deltas, 0, 6, false, &delta), LW_DELTAS_WHOLE); /* useless */
    assert_int_equal(lw_deltas_next(&f.deltas, 0, 2, false, &delta), LW_DELTAS_WAIT);
    assert_int_equal(lw_deltas_next(&f.deltas, 0, 2, false, &delta),
                     LW_DELTAS_WAIT); /* is not asked for twice */
    wait_until_made(&f);
    assert_false(lw_deltas_collect(&f.deltas));
    assert_int_equal(lw_deltas_next(&f.deltas, 0, 2, false, &delta), LW_DELTAS_DELTA);
    assert_int_equal(delta.version, 6);
    struct lw_blob *first_step = f.deltas.tile[0].base[1].delta;
    assert_true(delta.blob->size < 2 * first_step->size && delta.blob->size < f.deltas.tile[0].whole->size);
    decode(&f, second, 0, 2, &levels, by_jump);
    decode(&f, delta.blob, 2, 6, &levels, by_jump);
    decode(&f, f.deltas.tile[0].whole, 0, 6, NULL, whole);
    assert_memory_equal(by_jump, whole, sizeof whole);
    lw_deltas_prepare(&f.deltas, 0, 3, false);
    wait_until_made(&f);
    assert_int_equal(lw_deltas_next(&f.deltas, 0, 3, false, &delta), LW_DELTAS_DELTA);
    assert_int_equal(delta.version, 6);
    add_real(&f, 7); /* what led to 6 is of no use now */
    assert_int_equal(lw_deltas_next(&f.deltas, 0, 2, false, &delta), LW_DELTAS_WAIT);
    lw_blob_unref(second);
    tear_down(&f);
}

static void test_what_is_made_too_late_is_dropped(void **state) {
    (void)state;
    struct fixture f;
    struct lw_delta delta;
    set_up(&f);
    for (uint64_t version = 1; version <= 4; version++) add_real(&f, version);
    assert_int_equal(lw_deltas_next(&f.deltas, 0, 1, false, &delta), LW_DELTAS_WAIT);
    add_real(&f, 5);
    wait_until_made(&f);
    assert_false(f.deltas.tile[0].base[0].is_known);
    assert_int_equal(lw_deltas_next(&f.deltas, 0, 1, false, &delta), LW_DELTAS_WAIT);
    wait_until_made(&f);
    assert_int_equal(lw_deltas_next(&f.deltas, 0, 1, false, &delta), LW_DELTAS_DELTA);
    assert_int_equal(delta.version, 5);
    tear_down(&f);
}

static double relative_error(const float *x, const float *reference, size_t count) {
    double sum = 0;
    for (size_t i = 0; i < count; i++) sum += pow((double)(x[i] - reference[i]) / (double)reference[i], 2);
    return sqrt(sum / (double)count);
}

static enum lw_deltas_way wait_for_coarse(struct fixture *f, uint64_t from, struct lw_delta *out_delta) {
    enum lw_deltas_way way;
    while ((way = lw_deltas_next(&f->deltas, 0, from, true, out_delta)) == LW_DELTAS_WAIT) wait_until_made(f);
    return way;
}

/* In wider steps: fewer bytes, less exact, with deltas of their own. */
static void test_coarse_forms(void **state) {
    (void)state;
    static struct lw_tile_dct_coefficients levels;
    static float fine[SIDE * SIDE * 3], whole[SIDE * SIDE * 3], followed[SIDE * SIDE * 3];
    struct fixture f;
    struct lw_delta first, next, other;
    set_up(&f);
    add_real(&f, 2);
    assert_int_equal(wait_for_coarse(&f, 0, &first), LW_DELTAS_WHOLE);
    assert_int_equal(first.version, 1);
    assert_true(first.blob->size < 2 * f.deltas.tile[0].whole->size / 3);
    decode(&f, f.deltas.tile[0].whole, 0, 2, NULL, fine);
    decode(&f, first.blob, 0, 1, &levels, followed);
    const double error = relative_error(followed, fine, SIDE * SIDE * 3);
    assert_true(error > 0.02 && error < 0.2);
    add_real(&f, 4);
    assert_int_equal(wait_for_coarse(&f, 1, &next), LW_DELTAS_DELTA);
    assert_int_equal(next.version, 3);
    assert_true(next.blob->size < f.deltas.coarse[0].whole->size);
    decode(&f, next.blob, 1, 3, &levels, followed);
    assert_int_equal(wait_for_coarse(&f, 0, &other), LW_DELTAS_WHOLE); /* a session without a version */
    decode(&f, other.blob, 0, 3, NULL, whole);
    assert_memory_equal(whole, followed, sizeof whole);
    /* from it to the newest there is no way but the whole */
    assert_int_equal(lw_deltas_next(&f.deltas, 0, 3, false, &other), LW_DELTAS_WHOLE);
    assert_int_equal(other.version, 4);
    /* two versions on, at once */
    add_real(&f, 6);
    assert_int_equal(wait_for_coarse(&f, 3, &next), LW_DELTAS_DELTA);
    assert_int_equal(wait_for_coarse(&f, 1, &next), LW_DELTAS_DELTA);
    assert_int_equal(next.version, 5);
    assert_int_equal(f.deltas.coarse[0].count, 2);
    tear_down(&f);
}

/* A tile of another codec than 3 has no other form than itself. */
static void test_no_coarse_form(void **state) {
    (void)state;
    struct fixture f;
    struct lw_delta delta;
    set_up(&f);
    struct lw_snapshot_tile tile = {.version = 2, .blob = tile_blob(0, 2, 1, nothing, 9)};
    lw_deltas_add(&f.deltas, 0, &tile);
    assert_int_equal(wait_for_coarse(&f, 0, &delta), LW_DELTAS_WHOLE);
    assert_true(delta.version == 2 && delta.blob == tile.blob);
    lw_blob_unref(tile.blob);
    tear_down(&f);
}

/* Nobody waits for a transcoder that has too much to do; and what it is never
 * asked for again goes with it. */
static void test_a_transcoder_takes_no_more_than_it_says(void **state) {
    (void)state;
    struct fixture f;
    struct lw_transcoder_result result;
    set_up(&f);
    struct lw_blob *damaged = tile_blob(0, 1, 1, nothing, 9);
    const struct lw_transcoder_job job = {.base = 1, .version = 2, .from = damaged, .to = damaged};
    for (uint32_t i = 0; i < LW_TRANSCODER_JOBS_MAX; i++) assert_true(lw_transcoder_ask(f.transcoder, &job));
    assert_false(lw_transcoder_ask(f.transcoder, &job));
    for (uint64_t version = 1; version <= 3; version++) add_real(&f, version);
    struct lw_delta delta;
    assert_int_equal(lw_deltas_next(&f.deltas, 0, 1, false, &delta), LW_DELTAS_DELTA);
    assert_int_equal(delta.version, 2); /* one after another */
    LW_SUPPORT_WAIT_UNTIL(lw_transcoder_collect(f.transcoder, &result));
    assert_null(result.blob); /* there is no delta between damaged tiles */
    assert_true(result.tile == 0 && result.base == 1 && result.version == 2);
    assert_true(lw_transcoder_ask(f.transcoder, &job));
    assert_false(lw_transcoder_ask(f.transcoder, &job));
    tear_down(&f);
    assert_int_equal(atomic_load(&damaged->references), 1);
    lw_blob_unref(damaged);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_one_after_another),
        cmocka_unit_test(test_what_does_not_lead_on_is_forgotten),
        cmocka_unit_test(test_a_jump_over_several_versions),
        cmocka_unit_test(test_what_is_made_too_late_is_dropped),
        cmocka_unit_test(test_coarse_forms),
        cmocka_unit_test(test_no_coarse_form),
        cmocka_unit_test(test_a_transcoder_takes_no_more_than_it_says),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
