#include "tests/support/serving.h"

#include "server/serve/server.h"
#include "server/serve/tiles/priority.h"
#include "tests/support/server_clock.h"

#include <pthread.h>
#include <stdlib.h>
#include <unistd.h>

/* What sessions are interested in, and stand-ins for it. */

/* Stand-ins: every object's coarsest level, and what covers the same as a listed tile on coarser ones. */
static void test_stand_ins(void **state) {
    (void)state;
    struct serving *f = serving_start(&(struct lw_server_desc){0});
    int s = serving_dial_and_greet(f);
    /* one twice; one before and one after those that it stands in for */
    const struct lw_message_interest_tile wanted[] = {{1, 3, 0}, {1, 0, 7}, {1, 0, 7}, {1, 1, 0}, {1, 2, 0}};
    serving_put(s, &(struct lw_message){.type = LW_MESSAGE_INTEREST,
                                        .interest = {.tile = wanted, .tile_count = 5, .stand_ins = true}});
    serving_ask_for_package(s, SERVING_PACKAGE_SIZE);
    serving_publish(f, serving_make_snapshot(f, 2, 0));
    struct lw_message m;
    do {
        assert_true(serving_get(s, &m));
        lw_message_finish(&m);
    } while (m.type != LW_MESSAGE_FRAME);
    /* three coarsest, levels 3 and 2 of object 1, both tiles of its level 1, one of level 0 */
    serving_expect_tiles(s, 3 + 2 + 2 + 1, 2);
    serving_expect_silence(s);
    serving_put(s, &(struct lw_message){.type = LW_MESSAGE_INTEREST, .interest = {.stand_ins = true}});
    serving_put(s, &(struct lw_message){.type = LW_MESSAGE_PING});
    serving_expect(s, LW_MESSAGE_PONG, &m); /* so it has been heard */
    lw_message_finish(&m);
    serving_publish(f, serving_make_snapshot(f, 4, 2));
    serving_expect_frame(s, 4, 2);
    serving_expect_tiles(s, 3, 4);
    serving_expect_silence(s);
    close(s);
    serving_end(f);
}

/* What views do not read is sent again once it is far off, or old; what they may read, with every version. */
static void test_stand_ins_wait(void **state) {
    (void)state;
    struct serving *f = serving_start(&(struct lw_server_desc){0});
    int s = serving_dial_and_greet(f);
    const struct lw_message_interest_tile wanted[] = {{1, 0, 7}};
    serving_put(s, &(struct lw_message){.type = LW_MESSAGE_INTEREST,
                                        .interest = {.tile = wanted, .tile_count = 1, .stand_ins = true}});
    serving_ask_for_package(s, SERVING_PACKAGE_SIZE);
    const uint64_t far = 3, old = far + 2 * LW_PRIORITY_STAND_IN_FRAMES; /* versions, two a frame */
    for (uint64_t frame = 1; frame <= old; frame++) {
        struct lw_snapshot *snapshot = serving_make_snapshot(f, frame, frame - 1);
        for (uint32_t t = 0; t < f->map.tile_count; t++)
            snapshot->tile[serving_channel][t].change =
                frame == far ? 2 * LW_PRIORITY_STAND_IN_OFF : LW_PRIORITY_STAND_IN_OFF / 10;
        serving_publish(f, snapshot);
        struct lw_message m;
        do {
            assert_true(serving_get(s, &m));
            lw_message_finish(&m);
        } while (m.type != LW_MESSAGE_FRAME);
        /* the tile itself and levels 1 and 2 above it, which views may read; level 3 and all coarsest */
        serving_expect_tiles(s, frame == 1 || frame == far || frame == old ? 3 + 1 + 3 : 3, frame);
        serving_expect_silence(s);
    }
    close(s);
    serving_end(f);
}

/* Waits for news of the interest sets, and expects `tiles` level-0 tiles in their union; UINT32_MAX:
 * everything. */
static void expect_wanted(const struct serving *f, uint32_t tiles) {
    struct lw_server_interest wanted;
    LW_SUPPORT_WAIT_UNTIL(lw_server_take_interest(f->server, &wanted));
    uint32_t count = 0;
    for (uint32_t t = 0; !wanted.everything && t < f->map.tile_count; t++) count += wanted.levels[t] > 0;
    assert_int_equal(wanted.everything ? UINT32_MAX : count, tiles);
    free(wanted.levels);
}

static void want(int s, const struct lw_message_interest_tile *tile, size_t count) {
    serving_put(s, &(struct lw_message){.type = LW_MESSAGE_INTEREST,
                                        .interest = {.tile = tile, .tile_count = count, .stand_ins = true}});
}

static void test_union_of_interest(void **state) {
    (void)state;
    struct serving *f = serving_start(&(struct lw_server_desc){0});
    struct lw_server_interest none;
    const struct lw_message_interest_tile corner[] = {{1, 0, 7}}, half[] = {{1, 1, 1}, {0, 0, 0}};
    assert_false(lw_server_take_interest(f->server, &none));
    int first = serving_dial_and_greet(f), second = serving_dial_and_greet(f),
        third = serving_dial_and_greet(f);
    want(first, corner, 1);
    serving_ask_for_package(first, SERVING_PACKAGE_SIZE);
    expect_wanted(f, 1);
    want(second, half, 2);
    serving_ask_for_package(second, SERVING_PACKAGE_SIZE);
    expect_wanted(f, 5); /* the half of 4 holds the corner */
    serving_ask_for_package(third, SERVING_PACKAGE_SIZE);
    expect_wanted(f, UINT32_MAX);
    close(third);
    expect_wanted(f, 5);
    close(second);
    expect_wanted(f, 1);
    want(first, NULL, 0);
    expect_wanted(f, 0);
    close(first);
    serving_end(f);
}

struct flood_of_interest {
    int s;
    const struct lw_message_interest_tile *tile;
};

static void *change_mind(void *context) {
    const struct flood_of_interest *say = context;
    for (unsigned i = 0; i < 50; i++) want(say->s, say->tile, LW_MESSAGE_INTEREST_MAX - i);
    want(say->s, say->tile, 1);
    return NULL;
}

/* A client that changes its mind a thousand times between two frames is heard once, with its last word;
 * nobody else waits. */
static void test_flood_of_interest(void **state) {
    (void)state;
    struct serving *f = serving_start(&(struct lw_server_desc){0});
    int flood = serving_dial_and_greet(f), good = serving_dial_and_stream(f);
    static struct lw_message_interest_tile tile[LW_MESSAGE_INTEREST_MAX];
    for (uint32_t i = 0; i < LW_MESSAGE_INTEREST_MAX; i++)
        tile[i] = (struct lw_message_interest_tile){i % SERVING_OBJECTS, 0, i % 7};
    serving_ask_for_package(flood, SERVING_PACKAGE_SIZE);
    pthread_t sender; /* the server does not read on until time goes on */
    struct flood_of_interest say = {flood, tile};
    assert_int_equal(pthread_create(&sender, NULL, change_mind, &say), 0);
    serving_publish(f, serving_make_snapshot(f, 1, 0));
    serving_expect_light(f, good, 1);
    close(good);
    struct lw_server_interest wanted = {0};
    unsigned news = 0;
    for (uint32_t count = 0; count != 1;) { /* everything, then as it comes, then one tile */
        if (!lw_server_take_interest(f->server, &wanted)) {
            server_clock_step(SERVING_STEP_MS);
            continue;
        }
        count = wanted.everything ? UINT32_MAX : 0;
        for (uint32_t t = 0; !wanted.everything && t < f->map.tile_count; t++) count += wanted.levels[t] > 0;
        free(wanted.levels);
        assert_true(++news < 200);
    }
    assert_int_equal(pthread_join(sender, NULL), 0);
    close(flood);
    serving_end(f);
}

static void test_interest(void **state) {
    (void)state;
    struct serving *f = serving_start(&(struct lw_server_desc){0});
    int s = serving_dial_and_greet(f);
    const struct lw_message_interest_tile wanted[] = {{1, 0, 7}, {2, 4, 0}};
    serving_put(
        s, &(struct lw_message){.type = LW_MESSAGE_INTEREST, .interest = {.tile = wanted, .tile_count = 2}});
    serving_ask_for_package(s, SERVING_PACKAGE_SIZE);
    serving_publish(f, serving_make_snapshot(f, 1, 0));
    struct lw_message m;
    do {
        assert_true(serving_get(s, &m));
        lw_message_finish(&m);
    } while (m.type != LW_MESSAGE_FRAME);
    serving_expect(s, LW_MESSAGE_TILE, &m);
    assert_int_equal(m.tile.object, 2);
    assert_int_equal(m.tile.level, 4);
    lw_message_finish(&m);
    serving_expect(s, LW_MESSAGE_TILE, &m);
    assert_int_equal(m.tile.object, 1);
    assert_int_equal(m.tile.tile, 7);
    lw_message_finish(&m);
    serving_expect_silence(s);
    serving_put(s, &(struct lw_message){.type = LW_MESSAGE_INTEREST, .interest.everything = true});
    serving_expect_tiles(s, f->map.tile_count - 2, 1); /* what it has is not sent again */
    serving_put(s, &(struct lw_message){.type = LW_MESSAGE_INTEREST});
    serving_put(s, &(struct lw_message){.type = LW_MESSAGE_PING, .ping.token = SERVING_CLIENT_TOKEN});
    serving_expect(s, LW_MESSAGE_PONG, &m);
    assert_int_equal(m.pong.token, SERVING_CLIENT_TOKEN);
    lw_message_finish(&m);
    serving_publish(f, serving_make_snapshot(f, 2, 1));
    serving_expect_frame(s, 2, 2);
    serving_expect_silence(s); /* an empty list stops tiles */
    const struct lw_message_interest_tile unknown = {1, 0, 8};
    serving_put(s, &(struct lw_message){.type = LW_MESSAGE_INTEREST,
                                        .interest = {.tile = &unknown, .tile_count = 1}});
    serving_expect_refusal(s, LW_REFUSAL_PROTOCOL);
    serving_end(f);
}

int main(void) {
    const struct CMUnitTest in_split_channel[] = {
        cmocka_unit_test(test_stand_ins_wait),
    };
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_interest),          cmocka_unit_test(test_stand_ins),
        cmocka_unit_test(test_stand_ins_wait),    cmocka_unit_test(test_union_of_interest),
        cmocka_unit_test(test_flood_of_interest),
    };
    const int failed = cmocka_run_group_tests(tests, NULL, NULL);
    return failed + cmocka_run_group_tests(in_split_channel, serving_ask_for_split, NULL);
}
