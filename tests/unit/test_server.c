#include "tests/support/serving.h"

#include "common/base/clock.h"
#include "common/base/waiting.h"
#include "server/serve/server.h"
#include "tests/support/server_clock.h"

#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>
#include <zstd.h>

/* The life of a server: who joins, what it says before the first light, how it ends. */

/* ---- joining ---- */

static void test_join(void **state) {
    (void)state;
    struct serving *f = serving_start(&(struct lw_server_desc){0});
    serving_publish(f, serving_make_snapshot(f, 7, 0));
    int s = serving_dial(f);
    struct lw_message m;
    serving_put(s, &serving_hello);
    serving_expect(s, LW_MESSAGE_WELCOME, &m);
    struct lw_message_welcome welcome = m.welcome;
    assert_int_equal(welcome.version, LW_WIRE_VERSION);
    assert_int_equal(welcome.bounces, 2);
    assert_true(welcome.target_error == 0.05f);
    assert_int_equal(welcome.package_size, SERVING_PACKAGE_SIZE);
    assert_string_equal(welcome.name, "lightwelld " LW_VERSION);
    struct lw_package_hash hash;
    lw_package_hash(f->package, SERVING_PACKAGE_SIZE, &hash);
    assert_memory_equal(welcome.package_hash.bytes, hash.bytes, sizeof hash.bytes);
    lw_message_finish(&m);
    serving_expect_silence(s); /* nothing before it is asked for */
    serving_ask_for_package(s, 0);
    uint8_t *compressed = malloc(welcome.package_compressed_size), *package = malloc(SERVING_PACKAGE_SIZE);
    uint64_t at = 0;
    while (at < welcome.package_compressed_size) {
        serving_expect(s, LW_MESSAGE_PACKAGE_CHUNK, &m);
        assert_int_equal(m.package_chunk.offset, at);
        memcpy(compressed + at, m.package_chunk.data, m.package_chunk.size);
        at += m.package_chunk.size;
        lw_message_finish(&m);
    }
    assert_int_equal(ZSTD_decompress(package, SERVING_PACKAGE_SIZE, compressed, at), SERVING_PACKAGE_SIZE);
    assert_memory_equal(package, f->package, SERVING_PACKAGE_SIZE);
    free(compressed);
    free(package);
    serving_expect_frame(s, 7, 1);
    /* coarsest levels of all objects, then the next finer ones */
    for (uint32_t i = 0; i < f->map.tile_count; i++) {
        static const uint32_t level_of[13 * SERVING_OBJECTS] = {4, 4, 4, 3, 3, 3, 2, 2,
                                                                2, 1, 1, 1, 1, 1, 1, 0};
        serving_expect(s, LW_MESSAGE_TILE, &m);
        assert_int_equal(m.tile.level, level_of[i]);
        if (level_of[i] > 1) assert_int_equal(m.tile.object, i % SERVING_OBJECTS);
        assert_int_equal(m.tile.version, 7);
        lw_message_finish(&m);
    }
    serving_expect_silence(s);
    close(s);
    serving_end(f);
}

static void expect_waiting(int s, enum lw_waiting_stage stage, float share) {
    struct lw_message m;
    serving_expect(s, LW_MESSAGE_WAITING, &m);
    assert_int_equal(m.waiting.stage, stage);
    assert_true(m.waiting.share == share);
    lw_message_finish(&m);
}

/* Time for the server's next look, at which it may say more. */
static void pass_a_wait(void) { assert_true(server_clock_step(LW_SERVER_WAITING_MS)); }

/* A client that comes before the first light hears why there is none; a later one hears how far it is: now
 * and again, if there is news, until there is light. */
static void test_waiting_for_the_first_light(void **state) {
    (void)state;
    struct lw_waiting waiting = {0};
    struct serving *f = serving_start(&(struct lw_server_desc){.first_light = &waiting});
    const int none = serving_dial_and_greet(f); /* it wants no light */
    lw_waiting_raise(&waiting, LW_WAITING_PLACING_TEXELS, 0, 0);
    const int early = serving_dial_and_stream(f);
    expect_waiting(early, LW_WAITING_PLACING_TEXELS, 0);
    pass_a_wait();
    serving_expect_silence(early); /* no news */
    pass_a_wait();
    lw_waiting_raise(&waiting, LW_WAITING_LOOKING_INSIDE, 1, 4);
    expect_waiting(early, LW_WAITING_LOOKING_INSIDE, 0.25f);
    lw_waiting_raise(&waiting, LW_WAITING_LOOKING_INSIDE, 2, 4);
    assert_true(server_clock_step(0)); /* the server has looked, */
    serving_expect_silence(early);     /* so soon */
    lw_waiting_raise(&waiting, LW_WAITING_LOOKING_INSIDE, 3, 4);
    const int late = serving_dial_and_stream(f);
    expect_waiting(late, LW_WAITING_LOOKING_INSIDE, 0.75f);
    pass_a_wait();
    bool is_sent = false; /* perhaps of the half, too: the server may look in between */
    while (!is_sent) {
        struct lw_message m;
        serving_expect(early, LW_MESSAGE_WAITING, &m);
        is_sent = m.waiting.share == 0.75f;
        lw_message_finish(&m);
    }
    pass_a_wait();
    lw_waiting_raise(&waiting, LW_WAITING_FIRST_LIGHT, 1, 2);
    expect_waiting(early, LW_WAITING_FIRST_LIGHT, 0.5f);
    expect_waiting(late, LW_WAITING_FIRST_LIGHT, 0.5f);
    lw_waiting_raise(&waiting, LW_WAITING_READY, 1, 1);
    pass_a_wait();
    serving_expect_silence(early); /* nothing has been published yet */
    serving_publish(f, serving_make_snapshot(f, 7, 0));
    expect_waiting(early, LW_WAITING_READY, 1);
    serving_expect_light(f, early, 7);
    expect_waiting(late, LW_WAITING_READY, 1);
    serving_expect_light(f, late, 7);
    const int last = serving_dial_and_stream(f);
    serving_expect_light(f, last, 7); /* it never waits */
    pass_a_wait();
    serving_expect_silence(early);
    serving_expect_silence(last);
    serving_expect_silence(none);
    close(none);
    close(early);
    close(late);
    close(last);
    serving_end(f);
}

/* ---- many, full, stop ---- */

static void test_stop_while_sending(void **state) {
    (void)state;
    struct serving *f = serving_start(&(struct lw_server_desc){0});
    int slow = serving_dial_with_buffer(f, 4096), reading = serving_dial_and_greet(f),
        silent = serving_dial(f);
    serving_put(slow, &serving_hello);
    serving_ask_for_package(slow, 0);
    serving_wait_for_sessions(f, 2);
    serving_publish(f, serving_make_snapshot(f, 1, 0));
    const uint64_t start_ns = lw_clock_ns();
    lw_server_stop(f->server);
    serving_expect_refusal(reading, LW_REFUSAL_SHUTDOWN);
    serving_expect_refusal(silent, LW_REFUSAL_SHUTDOWN);
    while (server_clock_step(100)) /* does not wait for the one that does not read for long */
        assert_true(lw_clock_ns() - start_ns < 10000000000u);
    serving_join(f);
    close(slow);
    serving_discard(f);
}

static void test_stop_before_and_without_run(void **state) {
    (void)state;
    struct serving *f = serving_start(&(struct lw_server_desc){0});
    lw_server_stop(f->server);
    serving_join(f);
    struct lw_server_desc desc = {.host = "localhost",
                                  .atlas_map = &f->map,
                                  .package = f->package,
                                  .package_size = SERVING_PACKAGE_SIZE};
    struct lw_error err = {0};
    lw_support_ok(lw_server_create(&desc, &f->server, &err), &err);
    serving_publish(f, serving_make_snapshot(f, 1, 0));
    lw_server_stop(f->server);
    lw_server_destroy(f->server);
    lw_server_destroy(NULL);
    serving_discard(f);
}

/* At the end clients hear when to come back: as the owner says, or soon if
 * another server follows at once. */
static void test_stop_says_when_to_come_back(void **state) {
    (void)state;
    for (int relayed = 0; relayed < 2; relayed++) {
        struct serving *f = serving_start(&(struct lw_server_desc){.retry_after_ms = 1234});
        int s = serving_dial_and_greet(f), wrong = serving_dial(f);
        serving_put_bytes(wrong, "nonsense", 8);
        serving_expect_refusal(wrong, LW_REFUSAL_PROTOCOL);
        if (relayed)
            lw_server_relay(f->server);
        else
            lw_server_stop(f->server);
        serving_expect_refusal_after(s, LW_REFUSAL_SHUTDOWN, relayed ? LW_SERVER_RELAY_MS : 1234);
        serving_end(f);
    }
}

static void note_reload(void *context) { *(_Atomic int *)context += 1; }

static void test_hangup_reloads(void **state) {
    (void)state;
    _Atomic int reloads = 0;
    struct serving *f = serving_start(
        &(struct lw_server_desc){.hooks = {.reload = note_reload, .context = (void *)&reloads}});
    close(serving_dial_and_greet(f)); /* it runs, and watches */
    for (int i = 1; i <= 2; i++) {
        kill(getpid(), SIGHUP);
        LW_SUPPORT_WAIT_UNTIL(atomic_load(&reloads) >= i);
    }
    close(serving_dial_and_greet(f));
    serving_end(f);
    assert_int_equal(reloads, 2);
}

static void test_signal(void **state) {
    (void)state;
    const int signals[] = {SIGINT, SIGTERM};
    for (int i = 0; i < 2; i++) {
        struct serving *f = serving_start(&(struct lw_server_desc){0});
        int s = serving_dial_and_greet(f); /* the loop runs, so it watches signals */
        kill(getpid(), signals[i]);
        serving_expect_refusal(s, LW_REFUSAL_SHUTDOWN);
        serving_join(f);
        serving_discard(f);
    }
}

static void test_address_errors(void **state) {
    (void)state;
    struct serving *f = serving_start(&(struct lw_server_desc){0});
    struct lw_server_desc desc = {.host = "127.0.0.1",
                                  .port = lw_server_port(f->server),
                                  .atlas_map = &f->map,
                                  .package = f->package,
                                  .package_size = SERVING_PACKAGE_SIZE};
    struct lw_server *second = NULL;
    struct lw_error err = {0};
    char expected[200];
    assert_int_equal(lw_server_create(&desc, &second, &err), LW_UNAVAILABLE);
    snprintf(expected, sizeof expected,
             "127.0.0.1:%u is already in use: another lightwelld? choose another with --listen HOST:PORT",
             (unsigned)desc.port);
    assert_string_equal(err.text, expected);
    err = (struct lw_error){0};
    desc.host = "192.0.2.1"; /* for documentation: nobody's address */
    assert_int_equal(lw_server_create(&desc, &second, &err), LW_UNAVAILABLE);
    assert_non_null(strstr(err.text, "192.0.2.1"));
    err = (struct lw_error){0};
    desc.host = "no such host";
    assert_int_equal(lw_server_create(&desc, &second, &err), LW_NO_HOST);
    assert_non_null(strstr(err.text, "no such host"));
    assert_null(second);
    serving_end(f);
}

/* A loop that spins looks at the clock all the time; one that waits, when a timer runs. */
static void test_an_idle_loop_waits(void **state) {
    (void)state;
    struct serving *f = serving_start(&(struct lw_server_desc){0});
    int s = serving_dial_and_stream(f);
    serving_publish(f, serving_make_snapshot(f, 1, 0));
    serving_expect_light(f, s, 1);
    uint64_t runs[2], readings[2];
    server_clock_count(&runs[0], &readings[0]);
    for (unsigned i = 0; i < 50; i++) server_clock_step(1);
    server_clock_count(&runs[1], &readings[1]);
    const double each = (double)(readings[1] - readings[0]) / (double)(runs[1] - runs[0]);
    print_message("%.1f readings a run\n", each);
    assert_true(each < 6);
    close(s);
    serving_end(f);
}

int main(void) {
    const struct CMUnitTest in_split_channel[] = {
        cmocka_unit_test(test_join),
        cmocka_unit_test(test_waiting_for_the_first_light),
    };
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_join),
        cmocka_unit_test(test_waiting_for_the_first_light),
        cmocka_unit_test(test_stop_while_sending),
        cmocka_unit_test(test_stop_before_and_without_run),
        cmocka_unit_test(test_stop_says_when_to_come_back),
        cmocka_unit_test(test_hangup_reloads),
        cmocka_unit_test(test_signal),
        cmocka_unit_test(test_address_errors),
        cmocka_unit_test(test_an_idle_loop_waits),
    };
    const int failed = cmocka_run_group_tests(tests, NULL, NULL);
    return failed + cmocka_run_group_tests(in_split_channel, serving_ask_for_split, NULL);
}
