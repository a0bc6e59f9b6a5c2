#include "tests/support/serving.h"

#include "server/serve/server.h"
#include "tests/support/server_clock.h"

#include <semaphore.h>
#include <stdio.h>
#include <string.h>
#include <sys/ioctl.h>
#include <unistd.h>
#include <uv.h>

/* Peers that read slowly, never, or ask while light is on its way. */

/* ---- sharing and isolation ---- */

static void test_slow_reader(void **state) {
    (void)state;
    struct serving *f = serving_start(&(struct lw_server_desc){0});
    int slow = serving_dial_with_buffer(f, 4096);
    serving_put(slow, &serving_hello);
    serving_ask_for_package(slow, SERVING_PACKAGE_SIZE);
    serving_wait_for_sessions(f, 1);
    int fast = serving_dial_and_stream(f);
    const uint64_t frames = 30;
    for (uint64_t frame = 1; frame <= frames; frame++) {
        serving_publish(f, serving_make_snapshot(f, frame, frame - 1));
        serving_expect_frame(fast, frame, frame == 1 ? 1 : 2); /* at once: no time goes by */
        serving_expect_tiles(fast, f->map.tile_count, frame);
    }
    /* the slow one gets the newest in the end, and fewer tiles than there were: it skipped versions */
    struct lw_message m;
    uint64_t tiles = 0, newest[13 * SERVING_OBJECTS] = {0};
    for (uint32_t complete = 0; complete < f->map.tile_count;) {
        assert_true(serving_get(slow, &m));
        if (m.type == LW_MESSAGE_TILE) {
            uint32_t id = f->map.first_tile[m.tile.object] +
                          f->map.atlas[m.tile.object]->level[m.tile.level].first_tile + m.tile.tile;
            assert_true(m.tile.version > newest[id]);
            newest[id] = m.tile.version;
            complete += newest[id] == frames;
            tiles++;
        }
        lw_message_finish(&m);
    }
    assert_true(tiles < frames * f->map.tile_count / 2);
    close(slow);
    close(fast);
    serving_end(f);
}

static void test_stalled_reader_is_closed(void **state) {
    (void)state;
    struct serving *f = serving_start(&(struct lw_server_desc){.stall_timeout_ms = 1500});
    int slow = serving_dial_with_buffer(f, 4096), idle = serving_dial_and_stream(f);
    serving_put(slow, &serving_hello);
    serving_ask_for_package(slow, SERVING_PACKAGE_SIZE);
    serving_wait_for_sessions(f, 2);
    serving_publish(f, serving_make_snapshot(f, 1, 0));
    serving_expect_light(f, idle, 1);
    unsigned waited_ms = 0;
    for (; serving_stats_of(f).sessions_now == 2; waited_ms += 100) server_clock_step(100);
    assert_true(waited_ms >= 1500); /* or more: what the kernel acknowledges in its own time is progress */
    assert_int_equal(serving_stats_of(f).refused, 1);
    server_clock_step(1700);
    serving_expect_silence(idle); /* one that has nothing to get is not stalled */
    assert_int_equal(serving_stats_of(f).sessions_now, 1);
    uint8_t byte;
    while (serving_get_bytes(slow, &byte, 1)) {
    }
    close(slow);
    close(idle);
    serving_end(f);
}

/* A peer that reads on finds the refusal behind the bytes on the way. */
static void expect_timeout(bool while_held) {
    enum { STALL_MS = 600 };
    struct serving *f = serving_start(&(struct lw_server_desc){.stall_timeout_ms = STALL_MS});
    int slow = serving_dial_with_buffer(f, 4096);
    struct lw_message m;
    bool refused = false;
    serving_put(slow, &serving_hello);
    serving_ask_for_package(slow, SERVING_PACKAGE_SIZE);
    serving_wait_for_sessions(f, 1);
    serving_publish(f, serving_make_snapshot(f, 1, 0));
    while (serving_stats_of(f).sessions_now) server_clock_step(100);
    if (while_held) /* what it says makes no difference */
        serving_put(slow, &(struct lw_message){.type = LW_MESSAGE_PING});
    else
        while (server_clock_step(STALL_MS)) /* until its link, the only one, has been closed */
            ;
    while (serving_get(slow, &m)) {
        assert_false(refused);
        refused = m.type == LW_MESSAGE_REFUSAL;
        if (refused) assert_int_equal(m.refusal.code, LW_REFUSAL_TIMEOUT);
        lw_message_finish(&m);
        serving_is_paced = refused; /* then the server closes the link */
    }
    assert_true(refused);
    close(slow);
    serving_end(f);
}

static void test_a_stalled_reader_is_reported(void **state) {
    (void)state;
    expect_timeout(true);
    expect_timeout(false);
}

/* ---- whose turn it is ---- */

static _Atomic bool is_gated; /* writes with light in them wait for the test, each of them */
static sem_t at_gate, let_through;

int __real_uv_try_write(uv_stream_t *stream, const uv_buf_t buffer[], unsigned count);
int __wrap_uv_try_write(uv_stream_t *stream, const uv_buf_t buffer[], unsigned count);

int __wrap_uv_try_write(uv_stream_t *stream, const uv_buf_t buffer[], unsigned count) {
    size_t size = 0;
    for (unsigned i = 0; i < count; i++) size += buffer[i].len;
    if (is_gated && size >= SERVING_PAYLOAD_SIZE) {
        sem_post(&at_gate);
        sem_wait(&let_through);
        server_clock_move(10); /* the time of a write */
    }
    return __real_uv_try_write(stream, buffer, count);
}

/* Handing a snapshot out takes a second; who asks for something meanwhile is not kept waiting for all of
 * it. */
static void test_questions_do_not_wait_for_a_snapshot(void **state) {
    (void)state;
    enum { READERS = 100 };
    struct serving *f = serving_start(&(struct lw_server_desc){0});
    struct lw_message m;
    int reader[READERS];
    for (int i = 0; i < READERS; i++) reader[i] = serving_dial_and_stream(f);
    int s = serving_dial_and_greet(f);
    assert_int_equal(sem_init(&at_gate, 0, 0) | sem_init(&let_through, 0, 0), 0);
    is_gated = true;
    serving_publish(f, serving_make_snapshot(f, 1, 0));
    sem_wait(&at_gate);
    serving_put(s, &(struct lw_message){.type = LW_MESSAGE_PING, .ping.token = SERVING_CLIENT_TOKEN});
    int newcomer = serving_dial(f);
    serving_put(newcomer, &serving_hello);
    for (int writes = 0; !serving_is_readable(s) || !serving_is_readable(newcomer); writes++) {
        assert_true(writes < READERS);
        sem_post(&let_through);
        sem_wait(&at_gate);
    }
    int without_light = 0;
    for (int i = 0; i < READERS; i++) {
        int there = 0;
        assert_int_equal(ioctl(reader[i], FIONREAD, &there), 0);
        without_light += there == 0;
    }
    is_gated = false;
    sem_post(&let_through);
    serving_expect(s, LW_MESSAGE_PONG, &m);
    lw_message_finish(&m);
    serving_expect(newcomer, LW_MESSAGE_WELCOME, &m);
    lw_message_finish(&m);
    assert_true(without_light > READERS / 2);
    for (int i = 0; i < READERS; i++) {
        serving_expect_frame(reader[i], 1, 1); /* nobody is forgotten for that */
        serving_expect_tiles(reader[i], f->map.tile_count, 1);
        close(reader[i]);
    }
    close(newcomer);
    close(s);
    serving_end(f);
}

/* ---- fairness ---- */

/* The refusal's text after what else was sent; its code must be this. */
static void take_refusal(int s, enum lw_refusal code, char text[LW_MESSAGE_TEXT_MAX + 1]) {
    struct lw_message m;
    *text = '\0';
    while (serving_get(s, &m)) {
        if (m.type == LW_MESSAGE_REFUSAL) {
            assert_int_equal(m.refusal.code, code);
            snprintf(text, LW_MESSAGE_TEXT_MAX + 1, "%s", m.refusal.text);
        }
        lw_message_finish(&m);
    }
    close(s);
}

/* Most of a flood is not read: it stays in the sockets of both sides. A peer that goes on is refused, with
 * why. */
static void test_flood_of_messages(void **state) {
    (void)state;
    static const struct {
        struct lw_message message;
        const char *name;
    } of[] = {{{.type = LW_MESSAGE_PING, .ping.token = 5}, "PING"},
              {{.type = LW_MESSAGE_PONG, .pong.token = 5}, "PONG"},
              {{.type = LW_MESSAGE_INTEREST, .interest.everything = true}, "INTEREST"},
              {{.type = LW_MESSAGE_ACK, .ack.frame = 1}, "ACK"}};
    struct serving *f = serving_start(&(struct lw_server_desc){.excess_timeout_ms = 1500});
    serving_publish(f, serving_make_snapshot(f, 1, 0));
    int good = serving_dial_and_stream(f);
    serving_expect_light(f, good, 1);
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        struct lw_blob *one = serving_blob_of(&of[i].message), *many;
        lw_support_ok(lw_blob_create(one->size * 4096, &many), NULL);
        for (size_t m = 0; m < 4096; m++) memcpy(many->bytes + m * one->size, one->bytes, one->size);
        int s = serving_dial_and_stream(f);
        serving_expect_light(f, s, 1);
        bool closed;
        size_t total = serving_flood(s, many, 0, &closed);
        assert_true(!closed && total < SERVING_FLOOD_MAX);
        struct lw_message m; /* others do not notice */
        serving_put(good,
                    &(struct lw_message){.type = LW_MESSAGE_PING, .ping.token = SERVING_CLIENT_TOKEN + i});
        serving_expect(good, LW_MESSAGE_PONG, &m);
        assert_int_equal(m.pong.token, SERVING_CLIENT_TOKEN + i);
        lw_message_finish(&m);
        for (unsigned step = 0; !closed && serving_stats_of(f).refused == i; step++) {
            assert_true(step < 25); /* steps of 100 ms */
            server_clock_step(100);
            total = serving_flood(s, many, total, &closed);
            assert_true(total < SERVING_FLOOD_MAX);
        }
        char text[LW_MESSAGE_TEXT_MAX + 1];
        take_refusal(s, LW_REFUSAL_RATE, text);
        if (!strstr(text, of[i].name)) fail_msg("a flood of %s: \"%s\"", of[i].name, text);
        lw_blob_unref(one);
        lw_blob_unref(many);
    }
    close(good);
    serving_end(f);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_slow_reader),
        cmocka_unit_test(test_stalled_reader_is_closed),
        cmocka_unit_test(test_a_stalled_reader_is_reported),
        cmocka_unit_test(test_questions_do_not_wait_for_a_snapshot),
        cmocka_unit_test(test_flood_of_messages),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
