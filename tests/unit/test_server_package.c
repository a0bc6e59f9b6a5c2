#include "tests/support/serving.h"

#include "server/serve/server.h"
#include "server/serve/sessions/session.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <zstd.h>

/* Scene packages and finishes: in parts, from an offset on, behind the light, without the parts that a client
 * holds. */

static void test_package_from_offset(void **state) {
    (void)state;
    struct serving *f = serving_start(&(struct lw_server_desc){0});
    static uint8_t whole[SERVING_PACKAGE_SIZE * 2], part[SERVING_PACKAGE_SIZE * 2];
    const uint64_t offset = 70001;
    for (int pass = 0; pass < 2; pass++) {
        int s = serving_dial(f);
        struct lw_message m;
        serving_put(s, &serving_hello);
        serving_expect(s, LW_MESSAGE_WELCOME, &m);
        uint64_t end_offset = m.welcome.package_compressed_size, at = pass ? offset : 0;
        lw_message_finish(&m);
        serving_ask_for_package(s, at);
        while (at < end_offset) {
            serving_expect(s, LW_MESSAGE_PACKAGE_CHUNK, &m);
            assert_int_equal(m.package_chunk.offset, at);
            memcpy((pass ? part : whole) + at, m.package_chunk.data, m.package_chunk.size);
            at += m.package_chunk.size;
            lw_message_finish(&m);
        }
        assert_int_equal(at, end_offset);
        if (pass) assert_memory_equal(part + offset, whole + offset, end_offset - offset);
        close(s);
    }
    serving_end(f);
}

/* Greets as one who was here before. */
/* Chunks from an offset on, but for parts whose bits are set: one for each part of so small a package. */
static void expect_parts(const struct serving *f, uint64_t offset, uint8_t held) {
    static const struct lw_message with_parts = {
        .type = LW_MESSAGE_HELLO, .hello = {.version = LW_WIRE_VERSION, .features = LW_FEATURE_PARTS}};
    struct lw_message welcome, m;
    int s = serving_dial(f);
    serving_put(s, &with_parts);
    serving_expect(s, LW_MESSAGE_WELCOME, &welcome);
    const struct lw_message_welcome *w = &welcome.welcome;
    assert_int_equal(w->part_count, 4);
    assert_true(w->features & LW_FEATURE_PARTS);
    serving_put(
        s, &(struct lw_message){.type = LW_MESSAGE_PACKAGE_REQUEST, .package_request = {offset, &held, 1}});
    uint64_t begin = 0;
    for (size_t i = 0; i < w->part_count; i++) {
        const uint64_t end = begin + w->part_compressed_size[i], from = begin < offset ? offset : begin;
        begin = end;
        if (held >> i & 1 || from >= end) continue;
        serving_expect(s, LW_MESSAGE_PACKAGE_CHUNK, &m);
        assert_int_equal(m.package_chunk.offset, from);
        assert_int_equal(m.package_chunk.size, end - from);
        uint8_t bytes[4096];
        if (from + w->part_compressed_size[i] == end) { /* all of it: a frame of its own */
            struct lw_package_hash hash;
            assert_int_equal(ZSTD_decompress(bytes, sizeof bytes, m.package_chunk.data, m.package_chunk.size),
                             w->part_size[i]);
            lw_package_hash(bytes, (size_t)w->part_size[i], &hash);
            assert_memory_equal(&hash, &w->part_hash[i], sizeof hash);
        }
        lw_message_finish(&m);
    }
    serving_expect_silence(s);
    lw_message_finish(&welcome);
    close(s);
}

static void test_parts_of_the_package(void **state) {
    (void)state;
    struct lw_scene *scene = lw_support_everything(); /* with three textures */
    struct lw_server_desc desc = {0};
    uint8_t *package;
    lw_support_ok(lw_package_write(scene, &package, &desc.package_size, NULL), NULL);
    desc.package = package;
    struct serving *f = serving_start(&desc);
    for (unsigned held = 0; held < 16; held++) expect_parts(f, 0, (uint8_t)held);
    for (uint64_t offset = 1; offset < 40; offset++) expect_parts(f, offset * 17, offset % 16);
    int s = serving_dial_and_greet_with(f, LW_FEATURE_PARTS);
    serving_put(s, &(struct lw_message){.type = LW_MESSAGE_PACKAGE_REQUEST,
                                        .package_request = {0, (const uint8_t[]){16}, 1}});
    serving_expect_refusal(s, LW_REFUSAL_PROTOCOL); /* there is no fifth part */
    close(s);
    s = serving_dial(f);
    serving_put(s, &serving_hello);
    serving_expect_refusal(s, LW_REFUSAL_FEATURES);
    close(s);
    serving_end(f);
    free(package);
    lw_scene_destroy(scene);
}

#define FINISH_PARTS 4u /* a head and three textures */

static void add_finishes(struct lw_server_desc *desc, struct lw_scene **out_scene) {
    uint8_t *bytes;
    *out_scene = lw_support_everything();
    lw_support_add_finishes(*out_scene);
    lw_support_ok(lw_finish_package_write(*out_scene, &bytes, &desc->finishes_size, NULL), NULL);
    desc->finishes = bytes;
}

static int dial_with_materials(const struct serving *f, struct lw_message *out_welcome) {
    int s = serving_dial(f);
    serving_put(
        s, &(struct lw_message){.type = LW_MESSAGE_HELLO,
                                .hello = {.version = LW_WIRE_VERSION, .features = LW_FEATURE_MATERIALS}});
    serving_expect(s, LW_MESSAGE_WELCOME, out_welcome);
    return s;
}

static void ask_for_finishes(int s, uint64_t offset, uint8_t held) {
    serving_put(
        s, &(struct lw_message){.type = LW_MESSAGE_FINISH_REQUEST, .finish_request = {offset, &held, 1}});
}

/* Welcome and package are those of a server without finishes, but for the session and the run. */
static void test_who_knows_no_finishes_hears_of_none(void **state) {
    (void)state;
    struct lw_message of[2];
    for (int with = 0; with < 2; with++) {
        struct lw_server_desc desc = {0};
        struct lw_scene *scene = NULL;
        if (with) add_finishes(&desc, &scene);
        struct serving *f = serving_start(&desc);
        int s = serving_dial(f);
        serving_put(s, &serving_hello);
        serving_expect(s, LW_MESSAGE_WELCOME, &of[with]);
        assert_int_equal(of[with].welcome.features, 0);
        assert_int_equal(of[with].welcome.finish.size, 0);
        if (with) { /* nor may it ask */
            serving_ask_for_package(s, of[with].welcome.package_compressed_size);
            ask_for_finishes(s, 0, 0);
            serving_expect_refusal(s, LW_REFUSAL_PROTOCOL);
        } else {
            close(s);
            s = dial_with_materials(f, &of[1]); /* a server without any */
            assert_int_equal(of[1].welcome.features, 0);
            assert_int_equal(of[1].welcome.finish.size, 0);
            lw_message_finish(&of[1]);
            close(s);
        }
        serving_end(f);
        free((void *)desc.finishes);
        lw_scene_destroy(scene);
    }
    assert_memory_equal(&of[0].welcome.package_hash, &of[1].welcome.package_hash,
                        sizeof of[0].welcome.package_hash);
    assert_int_equal(of[0].welcome.package_size, of[1].welcome.package_size);
    assert_int_equal(of[0].welcome.package_compressed_size, of[1].welcome.package_compressed_size);
    for (int i = 0; i < 2; i++) lw_message_finish(&of[i]);
}

/* Chunks from an offset on, but for held parts, whose bytes are those of the package; behind the first
 * light. */
static void expect_finishes(const struct serving *f, const struct lw_server_desc *desc, uint64_t offset,
                            uint8_t held) {
    struct lw_message welcome, m;
    int s = dial_with_materials(f, &welcome);
    const struct lw_message_package *announced = &welcome.welcome.finish;
    struct lw_package_hash hash;
    lw_package_hash(desc->finishes, desc->finishes_size, &hash);
    assert_int_equal(welcome.welcome.features, LW_FEATURE_MATERIALS);
    assert_memory_equal(&announced->hash, &hash, sizeof hash);
    assert_int_equal(announced->size, desc->finishes_size);
    assert_int_equal(announced->part_count, FINISH_PARTS);
    serving_ask_for_package(s, welcome.welcome.package_compressed_size);
    ask_for_finishes(s, offset, held);
    serving_expect_frame(s, 7, 1);
    serving_expect_tiles(s, SERVING_OBJECTS, 7); /* the coarsest levels */
    uint64_t begin = 0, at = 0;
    uint32_t tiles = SERVING_OBJECTS;
    for (size_t i = 0; i < announced->part_count; i++) {
        const uint64_t end = begin + announced->part_compressed_size[i],
                       from = begin < offset ? offset : begin;
        begin = end;
        at += announced->part_size[i];
        if (held >> i & 1 || from >= end) continue;
        for (;; lw_message_finish(&m), tiles++) { /* tiles go on beside them */
            assert_true(serving_get(s, &m));
            if (m.type != LW_MESSAGE_TILE) break;
        }
        if (m.type == LW_MESSAGE_SETTLED) {
            lw_message_finish(&m);
            assert_true(serving_get(s, &m));
        }
        assert_int_equal(m.type, LW_MESSAGE_FINISH_CHUNK);
        assert_int_equal(m.finish_chunk.offset, from);
        assert_int_equal(m.finish_chunk.size, end - from);
        uint8_t bytes[4096];
        if (from + announced->part_compressed_size[i] == end) { /* all of it: a frame of its own */
            assert_int_equal(ZSTD_decompress(bytes, sizeof bytes, m.finish_chunk.data, m.finish_chunk.size),
                             announced->part_size[i]);
            assert_memory_equal(bytes, desc->finishes + at - announced->part_size[i],
                                announced->part_size[i]);
        }
        lw_message_finish(&m);
    }
    lw_message_finish(&welcome);
    close(s);
}

static void test_finishes(void **state) {
    (void)state;
    struct lw_scene *scene;
    struct lw_server_desc desc = {0};
    add_finishes(&desc, &scene);
    struct serving *f = serving_start(&desc);
    serving_publish(f, serving_make_snapshot(f, 7, 0));
    for (unsigned held = 0; held < 1u << FINISH_PARTS; held += 3) expect_finishes(f, &desc, 0, (uint8_t)held);
    for (uint64_t offset = 1; offset < 40; offset += 6) expect_finishes(f, &desc, offset * 7, offset % 16);
    serving_end(f);
    free((void *)desc.finishes);
    lw_scene_destroy(scene);
}

/* Asked for long before there is light, they come behind it, and then a chunk for each tile that waits. */
static void test_finishes_wait_for_the_first_light(void **state) {
    (void)state;
    struct lw_scene *scene;
    struct lw_server_desc desc = {0};
    struct lw_message welcome, m;
    add_finishes(&desc, &scene);
    struct serving *f = serving_start(&desc);
    int s = dial_with_materials(f, &welcome);
    serving_ask_for_package(s, welcome.welcome.package_compressed_size);
    ask_for_finishes(s, 0, 0);
    lw_message_finish(&welcome);
    serving_expect_silence(s);
    serving_publish(f, serving_make_snapshot(f, 7, 0));
    serving_expect_frame(s, 7, 1);
    serving_expect_tiles(s, SERVING_OBJECTS, 7); /* the coarsest levels */
    for (unsigned i = 0; i < FINISH_PARTS; i++) {
        serving_expect(s, LW_MESSAGE_FINISH_CHUNK, &m);
        assert_true(LW_SESSION_TILES_FIRST * m.finish_chunk.size < SERVING_PAYLOAD_SIZE);
        lw_message_finish(&m);
        serving_expect_tiles(s, 1, 7);
    }
    serving_expect_tiles(s, f->map.tile_count - SERVING_OBJECTS - FINISH_PARTS, 7);
    close(s);
    serving_end(f);
    free((void *)desc.finishes);
    lw_scene_destroy(scene);
}

/* What makes no sense is refused. */
static void test_finishes_out_of_order(void **state) {
    (void)state;
    struct lw_scene *scene;
    struct lw_server_desc desc = {0};
    add_finishes(&desc, &scene);
    struct serving *f = serving_start(&desc);
    for (int wrong = 0; wrong < 4; wrong++) {
        struct lw_message welcome;
        int s = dial_with_materials(f, &welcome);
        const uint64_t end = welcome.welcome.finish.compressed_size;
        if (wrong) serving_ask_for_package(s, welcome.welcome.package_compressed_size);
        if (wrong == 1) ask_for_finishes(s, end, 0); /* and then again */
        ask_for_finishes(s, wrong == 2 ? end + 1 : 0, wrong == 3 ? 1u << FINISH_PARTS : 0);
        serving_expect_refusal(s, LW_REFUSAL_PROTOCOL);
        lw_message_finish(&welcome);
    }
    serving_end(f);
    free((void *)desc.finishes);
    lw_scene_destroy(scene);
}

static void test_what_is_held_is_not_sent(void **state) {
    (void)state;
    struct serving *f = serving_start(&(struct lw_server_desc){0});
    struct lw_message_welcome welcome, other;
    serving_publish(f, serving_make_snapshot(f, 7, 0));
    serving_publish(f, serving_make_snapshot(f, 9, 7));
    int s = serving_dial_and_stream(f);
    serving_expect_frame(s, 9, 1);
    close(s);
    static struct lw_message_held held[13 * SERVING_OBJECTS];
    for (uint32_t t = 0; t < f->map.tile_count; t++) {
        const struct lw_tile_place *p = &f->map.place[t];
        const struct lw_atlas_level *level = &f->map.atlas[p->object]->level[p->level];
        held[t] = (struct lw_message_held){p->object, p->level, p->y * level->tiles_x + p->x, 9};
    }
    held[3].version = 7; /* an older one */
    s = serving_dial_again(f, &welcome);
    assert_true(welcome.run != 0);
    /* in two messages; all but the last three tiles */
    serving_put(s, &(struct lw_message){.type = LW_MESSAGE_HOLDS, .holds = {held, 5, 0}});
    serving_put(
        s, &(struct lw_message){.type = LW_MESSAGE_HOLDS, .holds = {held + 5, f->map.tile_count - 8, 0}});
    serving_ask_for_package(s, welcome.package_compressed_size);
    serving_expect_frame(s, 9, 1);
    serving_expect_tiles(s, 4, 9);
    serving_expect_silence(s);
    close(s);
    /* what cannot be is refused */
    struct lw_message_held wrong[4] = {held[0], held[0], held[0], held[0]};
    wrong[0].version = 10;
    wrong[1].object = SERVING_OBJECTS;
    wrong[2].level = 7;
    wrong[3].version = UINT64_MAX;
    for (int i = 0; i < 4; i++) {
        s = serving_dial_again(f, &other);
        assert_int_equal(other.run, welcome.run);
        serving_put(s, &(struct lw_message){.type = LW_MESSAGE_HOLDS, .holds = {&wrong[i], 1, 0}});
        serving_expect_refusal(s, LW_REFUSAL_PROTOCOL);
    }
    /* too late; without the feature */
    s = serving_dial_again(f, &other);
    serving_ask_for_package(s, welcome.package_compressed_size);
    serving_put(s, &(struct lw_message){.type = LW_MESSAGE_HOLDS, .holds = {held, 1, 0}});
    serving_expect_refusal(s, LW_REFUSAL_PROTOCOL);
    s = serving_dial_and_greet(f);
    serving_put(s, &(struct lw_message){.type = LW_MESSAGE_HOLDS, .holds = {held, 1, 0}});
    serving_expect_refusal(s, LW_REFUSAL_PROTOCOL);
    serving_end(f);
    /* before there is light nobody has any */
    f = serving_start(&(struct lw_server_desc){0});
    s = serving_dial_again(f, &other);
    assert_int_not_equal(other.run, welcome.run);
    serving_put(s, &(struct lw_message){.type = LW_MESSAGE_HOLDS, .holds = {held, 1, 0}});
    serving_expect_refusal(s, LW_REFUSAL_PROTOCOL);
    serving_end(f);
}

/* A client comes from another relay, which is two frames ahead of this one. */
static void test_no_frame_before_the_held_one(void **state) {
    (void)state;
    struct serving *f = serving_start(&(struct lw_server_desc){.relay = 5});
    struct lw_message_welcome welcome;
    serving_publish(f, serving_make_snapshot(f, 7, 0));
    int s = serving_dial_again(f, &welcome);
    const uint64_t frames[] = {9, 8}; /* the later one counts */
    for (int i = 0; i < 2; i++)
        serving_put(s, &(struct lw_message){.type = LW_MESSAGE_HOLDS, .holds.frame = frames[i]});
    serving_ask_for_package(s, welcome.package_compressed_size);
    serving_expect_silence(s);
    serving_publish(f, serving_make_snapshot(f, 8, 7));
    serving_expect_silence(s);
    serving_publish(f, serving_make_snapshot(f, 9, 8));
    serving_expect_frame(s, 9, 1);
    serving_expect_tiles(s, f->map.tile_count, 9);
    close(s);
    serving_end(f);
}

static void test_a_frame_that_is_not_yet(void **state) {
    (void)state;
    struct serving *f = serving_start(&(struct lw_server_desc){0});
    struct lw_message_welcome welcome;
    serving_publish(f, serving_make_snapshot(f, 7, 0));
    int s = serving_dial_again(f, &welcome);
    serving_put(s, &(struct lw_message){.type = LW_MESSAGE_HOLDS, .holds.frame = 7});
    serving_ask_for_package(s, welcome.package_compressed_size);
    serving_expect_frame(s, 7, 1);
    close(s);
    s = serving_dial_again(f, &welcome);
    serving_put(s, &(struct lw_message){.type = LW_MESSAGE_HOLDS, .holds.frame = 8});
    serving_expect_refusal(s, LW_REFUSAL_PROTOCOL);
    serving_end(f);
}

int main(void) {
    const struct CMUnitTest in_split_channel[] = {
        cmocka_unit_test(test_what_is_held_is_not_sent),
        cmocka_unit_test(test_who_knows_no_finishes_hears_of_none),
        cmocka_unit_test(test_finishes),
        cmocka_unit_test(test_finishes_wait_for_the_first_light),
        cmocka_unit_test(test_finishes_out_of_order),
    };
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_package_from_offset),      cmocka_unit_test(test_parts_of_the_package),
        cmocka_unit_test(test_what_is_held_is_not_sent), cmocka_unit_test(test_no_frame_before_the_held_one),
        cmocka_unit_test(test_a_frame_that_is_not_yet),
    };
    const int failed = cmocka_run_group_tests(tests, NULL, NULL);
    return failed + cmocka_run_group_tests(in_split_channel, serving_ask_for_split, NULL);
}
