#include "tests/support/support.h"

#include "client/load/tile_check.h"
#include "common/tile/tile_codec.h"

#include <stdlib.h>
#include <string.h>

#define PAYLOADS 8

struct world {
    struct lw_scene *scene;
    struct lw_atlas_map map;
    struct lw_tile_check *check;
    uint8_t *payload[PAYLOADS]; /* each of the whole tile 64 x 64, all of one value */
    size_t size[PAYLOADS];
    float scale[PAYLOADS];
    uint64_t *known[2];           /* for two sessions */
    struct lw_tile_held *held[2]; /* NULL: they are not followed */
};

/* The checker points into it. */
static void init_world(struct world *w, bool always) {
    *w = (struct world){.scene = lw_support_squares(1, 1)};
    struct lw_tile_codec *codec;
    static float rgb[LW_TILE_TEXELS_MAX * 3];
    uint32_t saturated;
    w->scene->mesh[0].atlas_width = w->scene->mesh[0].atlas_height = 128;
    lw_support_ok(lw_atlas_map_init(&w->map, w->scene), NULL);
    lw_support_ok(lw_tile_check_create(&w->map, always, &w->check), NULL);
    lw_support_ok(lw_tile_codec_create(&codec), NULL);
    for (int i = 0; i < PAYLOADS; i++) {
        for (size_t t = 0; t < sizeof rgb / sizeof rgb[0]; t++) rgb[t] = (float)(i + 1);
        w->payload[i] = malloc(lw_tile_codec_bound());
        lw_support_ok(lw_tile_codec_encode_half(codec, NULL, rgb, LW_TILE_SIDE, LW_TILE_SIDE, w->payload[i],
                                                lw_tile_codec_bound(), &w->size[i], &w->scale[i], &saturated),
                      NULL);
    }
    for (int i = 0; i < 2; i++) w->known[i] = calloc(w->map.tile_count, sizeof(uint64_t));
    lw_tile_codec_destroy(codec);
}

static void finish_world(struct world *w) {
    for (int i = 0; i < PAYLOADS; i++) free(w->payload[i]);
    for (int i = 0; i < 2; i++) {
        free(w->known[i]);
        lw_tile_held_destroy(w->held[i]);
    }
    lw_tile_check_destroy(w->check);
    lw_atlas_map_finish(&w->map);
    lw_scene_destroy(w->scene);
}

static struct lw_message_tile tile_of(const struct world *w, uint32_t tile, uint64_t version, int payload) {
    return (struct lw_message_tile){.tile = tile,
                                    .version = version,
                                    .codec = LW_TILE_CODEC_HALF_ZSTD,
                                    .scale = w->scale[payload],
                                    .bounces = 2,
                                    .error = 0.5f,
                                    .payload = w->payload[payload],
                                    .payload_size = w->size[payload]};
}

static struct lw_tile_finding check_tile(struct world *w, int session, struct lw_message_tile tile) {
    struct lw_tile_finding finding;
    lw_support_ok(lw_tile_check_take(w->check, &tile, w->known[session], w->held[session], &finding), NULL);
    return finding;
}

static void test_good_tiles_are_decoded_once(void **state) {
    (void)state;
    for (int always = 0; always < 2; always++) {
        struct world w;
        init_world(&w, always);
        for (uint64_t version = 1; version <= 20; version++)
            for (int session = 0; session < 2; session++) {
                struct lw_tile_finding f =
                    check_tile(&w, session, tile_of(&w, 3, version, (int)(version % PAYLOADS)));
                assert_int_equal(f.verdict, LW_TILE_GOOD);
                assert_int_equal(f.id.v, 3);
                assert_int_equal(f.before, version - 1);
                assert_int_equal(w.known[session][3], version);
            }
        assert_int_equal(lw_tile_check_decoded(w.check), always ? 40 : 20);
        finish_world(&w);
    }
}

/* A slow session gets what all others have left behind: it is decoded again, and evicts no other tile. */
static void test_versions_that_were_forgotten(void **state) {
    (void)state;
    struct world w;
    init_world(&w, false);
    for (uint64_t version = 1; version <= LW_TILE_CHECK_VERSIONS + 1; version++)
        assert_int_equal(check_tile(&w, 0, tile_of(&w, 0, version, 0)).verdict, LW_TILE_GOOD);
    assert_int_equal(check_tile(&w, 1, tile_of(&w, 0, 1, 0)).verdict, LW_TILE_GOOD);
    assert_int_equal(lw_tile_check_decoded(w.check), LW_TILE_CHECK_VERSIONS + 2);
    for (uint64_t version = 2; version <= LW_TILE_CHECK_VERSIONS + 1; version++)
        assert_int_equal(check_tile(&w, 1, tile_of(&w, 0, version, 0)).verdict, LW_TILE_GOOD);
    assert_int_equal(lw_tile_check_decoded(w.check), LW_TILE_CHECK_VERSIONS + 2);
    finish_world(&w);
}

/* Black, in codec 4: a whole one, and a delta of it in which nothing is different. */
static struct lw_message_tile black_tile(uint64_t version, uint64_t base) {
    static struct lw_tile_dct dct;
    static struct lw_tile_dct_history history;
    static float rgb[LW_TILE_TEXELS_MAX * 3];
    static uint8_t payload[2][LW_TILE_DCT_BOUND];
    struct lw_tile_dct_coded coded;
    lw_tile_dct_init(&dct);
    history.scale = 0;
    for (int i = 0; i < 2; i++) {
        const struct lw_tile_dct_source source = {rgb, NULL, LW_TILE_SIDE, LW_TILE_SIDE, 1, 0, NULL};
        lw_tile_dct_encode(&dct, &source, &history, payload[0], payload[1], &coded);
    }
    return (struct lw_message_tile){.version = version,
                                    .codec = LW_TILE_CODEC_DCT,
                                    .scale = coded.scale,
                                    .payload = payload[base > 0],
                                    .payload_size = base ? coded.delta_size : coded.size,
                                    .base = base};
}

static void test_deltas(void **state) {
    (void)state;
    struct world w;
    init_world(&w, false);
    assert_int_equal(check_tile(&w, 0, black_tile(3, 2)).verdict, LW_TILE_DAMAGED); /* it has nothing yet */
    assert_int_equal(check_tile(&w, 0, black_tile(2, 0)).verdict, LW_TILE_GOOD);
    assert_int_equal(check_tile(&w, 0, black_tile(3, 2)).verdict, LW_TILE_GOOD);
    assert_int_equal(check_tile(&w, 1, black_tile(3, 0)).verdict, LW_TILE_GOOD); /* the same version, whole */
    assert_int_equal(check_tile(&w, 0, black_tile(5, 4)).verdict, LW_TILE_DAMAGED);
    assert_int_equal(check_tile(&w, 0, black_tile(4, 3)).verdict, LW_TILE_GOOD);
    assert_int_equal(check_tile(&w, 1, black_tile(4, 3)).verdict, LW_TILE_GOOD);
    assert_int_equal(lw_tile_check_decoded(w.check), 4);
    finish_world(&w);
}

/* Two followed users hold the same light, whether it came whole or as deltas; a user that comes by another
 * way is reported. */
static void test_light_of_those_who_are_followed(void **state) {
    (void)state;
    struct world w;
    struct lw_tile_codec *codec;
    static struct lw_tile_dct_history history;
    static float rgb[LW_TILE_TEXELS_MAX * 3];
    static uint8_t bytes[3][2][1 << 17];
    struct lw_message_tile whole[3], delta[3];
    init_world(&w, false);
    for (int i = 0; i < 2; i++) lw_support_ok(lw_tile_held_create(&w.map, &w.held[i]), NULL);
    assert_true(lw_tile_codec_bound() <= sizeof bytes[0][0]);
    lw_support_ok(lw_tile_codec_create(&codec), NULL);
    for (uint32_t v = 0; v < 3; v++) {
        struct lw_tile_dct_coded coded;
        for (uint32_t i = 0; i < LW_TILE_TEXELS_MAX * 3; i++) rgb[i] = 1 + 0.1f * (float)(i % 7 * (v + 1));
        lw_support_ok(lw_tile_codec_encode_dct(
                          codec,
                          &(struct lw_tile_dct_source){
                              .rgb = rgb, .width = LW_TILE_SIDE, .height = LW_TILE_SIDE, .step = 0.25f},
                          &history, bytes[v][0], bytes[v][1], sizeof bytes[0][0], &coded),
                      NULL);
        whole[v] = (struct lw_message_tile){.version = v + 1,
                                            .codec = LW_TILE_CODEC_DCT,
                                            .scale = coded.scale,
                                            .payload = bytes[v][0],
                                            .payload_size = coded.size};
        delta[v] = whole[v];
        delta[v].base = v;
        delta[v].payload = bytes[v][1];
        delta[v].payload_size = coded.delta_size;
    }
    assert_int_equal(check_tile(&w, 0, whole[0]).verdict, LW_TILE_GOOD);
    assert_int_equal(check_tile(&w, 0, delta[1]).verdict, LW_TILE_GOOD);
    assert_int_equal(check_tile(&w, 1, whole[1]).verdict, LW_TILE_GOOD);
    assert_int_equal(check_tile(&w, 0, delta[2]).verdict, LW_TILE_GOOD);
    assert_int_equal(lw_tile_check_decoded(w.check), 4);
    struct lw_message_tile other = whole[0]; /* sound bytes, but not the light of version 3 */
    other.version = 3;
    assert_int_equal(check_tile(&w, 1, other).verdict, LW_TILE_DIFFERENT);
    lw_tile_codec_destroy(codec);
    finish_world(&w);
}

static void test_bad_tiles(void **state) {
    (void)state;
    struct world w;
    init_world(&w, false);
    struct lw_message_tile t =
        tile_of(&w, w.map.atlas[0]->level[0].tiles_x * w.map.atlas[0]->level[0].tiles_y, 1, 0);
    assert_int_equal(check_tile(&w, 0, t).verdict, LW_TILE_NOWHERE);
    t = tile_of(&w, 0, 1, 0);
    t.object = 1;
    assert_int_equal(check_tile(&w, 0, t).verdict, LW_TILE_NOWHERE);
    t = tile_of(&w, 0, 1, 0);
    t.level = w.map.atlas[0]->level_count;
    assert_int_equal(check_tile(&w, 0, t).verdict, LW_TILE_NOWHERE);
    t = tile_of(&w, 0, 1, 0);
    t.codec = 2;
    assert_int_equal(check_tile(&w, 0, t).verdict, LW_TILE_DAMAGED);
    t = tile_of(&w, 0, 1, 0);
    t.payload_size--;
    assert_int_equal(check_tile(&w, 0, t).verdict, LW_TILE_DAMAGED);
    t = tile_of(&w, 0, 1, 0);
    t.level = 1; /* 64 x 64 too, but level 2 is not */
    assert_int_equal(check_tile(&w, 0, t).verdict, LW_TILE_GOOD);
    t.level = 2;
    assert_int_equal(check_tile(&w, 0, t).verdict, LW_TILE_DAMAGED);
    t = tile_of(&w, 0, 1, 0);
    t.layer = 1;
    assert_int_equal(check_tile(&w, 0, t).verdict, LW_TILE_IGNORED);
    for (uint32_t i = 0; i < w.map.tile_count; i++)
        assert_int_equal(w.known[0][i], i == w.map.atlas[0]->level[1].first_tile);
    finish_world(&w);
}

static void test_versions_only_grow(void **state) {
    (void)state;
    struct world w;
    init_world(&w, false);
    assert_int_equal(check_tile(&w, 0, tile_of(&w, 2, 5, 0)).verdict, LW_TILE_GOOD);
    assert_int_equal(check_tile(&w, 0, tile_of(&w, 2, 5, 0)).verdict, LW_TILE_BACKWARDS);
    assert_int_equal(check_tile(&w, 0, tile_of(&w, 2, 4, 0)).verdict, LW_TILE_BACKWARDS);
    assert_int_equal(w.known[0][2], 5);
    assert_int_equal(check_tile(&w, 1, tile_of(&w, 2, 4, 0)).verdict, LW_TILE_GOOD);
    finish_world(&w);
}

static void test_one_version_is_one_content(void **state) {
    (void)state;
    for (int always = 0; always < 2; always++) {
        struct world w;
        init_world(&w, always);
        struct lw_message_tile t = tile_of(&w, 0, 5, 0);
        assert_int_equal(check_tile(&w, 0, t).verdict, LW_TILE_GOOD);
        assert_int_equal(check_tile(&w, 1, tile_of(&w, 0, 5, 1)).verdict, LW_TILE_DIFFERENT);
        t.error = 0.25f;
        assert_int_equal(check_tile(&w, 1, t).verdict, LW_TILE_DIFFERENT);
        t = tile_of(&w, 0, 5, 0);
        t.scale *= 2;
        assert_int_equal(check_tile(&w, 1, t).verdict, LW_TILE_DIFFERENT);
        assert_int_equal(w.known[1][0], 0);
        assert_int_equal(check_tile(&w, 1, tile_of(&w, 0, 5, 0)).verdict, LW_TILE_GOOD);
        finish_world(&w);
    }
}

/* Nobody remembers a tile that did not decode. */
static void test_damage_is_found_again(void **state) {
    (void)state;
    struct world w;
    init_world(&w, false);
    struct lw_message_tile t = tile_of(&w, 0, 5, 0);
    t.payload_size--;
    assert_int_equal(check_tile(&w, 0, t).verdict, LW_TILE_DAMAGED);
    assert_int_equal(check_tile(&w, 1, t).verdict, LW_TILE_DAMAGED);
    assert_int_equal(check_tile(&w, 1, tile_of(&w, 0, 5, 0)).verdict, LW_TILE_GOOD);
    finish_world(&w);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_good_tiles_are_decoded_once),
        cmocka_unit_test(test_versions_that_were_forgotten),
        cmocka_unit_test(test_deltas),
        cmocka_unit_test(test_light_of_those_who_are_followed),
        cmocka_unit_test(test_bad_tiles),
        cmocka_unit_test(test_versions_only_grow),
        cmocka_unit_test(test_one_version_is_one_content),
        cmocka_unit_test(test_damage_is_found_again),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
