#include "tests/support/serving.h"

#include "server/serve/server.h"

#include <pthread.h>
#include <unistd.h>

/* Forms of light, beside each other. */

/* Both channels, or one, of all tiles. */
static struct lw_snapshot *make_channels(const struct serving *f, uint64_t frame, uint64_t previous,
                                         uint32_t channels) {
    struct lw_snapshot *of[LW_TILE_CHANNEL_IRRADIANCES] = {0}, *snapshot = NULL;
    const uint32_t before = serving_channel;
    for (unsigned i = 0; i < LW_TILE_CHANNEL_IRRADIANCES; i++) {
        serving_channel = (uint32_t)i;
        if (channels >> i & 1) snapshot = of[i] = serving_make_snapshot(f, frame, previous);
    }
    serving_channel = before;
    for (unsigned i = 0; i < LW_TILE_CHANNEL_IRRADIANCES; i++) {
        if (!of[i] || of[i] == snapshot) continue;
        snapshot->tile[i] = of[i]->tile[i];
        of[i]->tile[i] = NULL;
        lw_snapshot_unref(of[i]);
    }
    snapshot->channels = channels;
    return snapshot;
}

static int dial_in(const struct serving *f, uint32_t as) {
    serving_channel = as;
    return serving_dial_and_stream(f);
}

static void expect_light_in(const struct serving *f, int s, uint32_t as, uint64_t frame) {
    serving_channel = as;
    serving_expect_light(f, s, frame);
}

static void wait_for_channels(const struct serving *f, uint32_t channels) {
    LW_SUPPORT_WAIT_UNTIL(lw_server_channels_taken(f->server) == channels);
}

/* Each client gets its own channel. The first client of a channel waits for it. */
static void test_channels_beside_each_other(void **state) {
    (void)state;
    enum { FULL = 1u << LW_TILE_CHANNEL_FULL, SPLIT = 1u << LW_TILE_CHANNEL_SPLIT };
    struct serving *f = serving_start(&(struct lw_server_desc){0});
    assert_int_equal(lw_server_channels_taken(f->server), 0);
    serving_publish(f, make_channels(f, 1, 0, FULL));
    int full = dial_in(f, LW_TILE_CHANNEL_FULL);
    expect_light_in(f, full, LW_TILE_CHANNEL_FULL, 1);
    assert_int_equal(lw_server_channels_taken(f->server), FULL);
    int split = dial_in(f, LW_TILE_CHANNEL_SPLIT);
    wait_for_channels(f, FULL | SPLIT);
    assert_int_equal(serving_stats_of(f).sessions_now, 2);
    assert_int_equal(serving_stats_of(f).sessions_drawing, 1);
    serving_expect_silence(split);
    serving_publish(f, make_channels(f, 2, 1, FULL | SPLIT));
    expect_light_in(f, split, LW_TILE_CHANNEL_SPLIT, 2);
    serving_channel = LW_TILE_CHANNEL_FULL;
    serving_expect_frame(full, 2, 2); /* as a difference: it had all of the one before */
    serving_expect_tiles(full, f->map.tile_count, 2);
    /* A snapshot leaves one channel out: its sessions keep their tiles, and a newcomer gets no old ones. */
    serving_publish(f, make_channels(f, 3, 2, FULL));
    serving_expect_frame(full, 3, 2);
    serving_expect_tiles(full, f->map.tile_count, 3);
    int late = dial_in(f, LW_TILE_CHANNEL_SPLIT);
    serving_expect_silence(split);
    serving_expect_silence(late);
    serving_publish(f, make_channels(f, 4, 3, FULL | SPLIT));
    expect_light_in(f, split, LW_TILE_CHANNEL_SPLIT, 4);
    expect_light_in(f, late, LW_TILE_CHANNEL_SPLIT, 4);
    serving_channel = LW_TILE_CHANNEL_FULL;
    serving_expect_frame(full, 4, 2);
    serving_expect_tiles(full, f->map.tile_count, 4);
    close(full);
    wait_for_channels(f, SPLIT);
    close(split);
    serving_wait_for_sessions(f, 1);
    assert_int_equal(lw_server_channels_taken(f->server), SPLIT);
    close(late);
    wait_for_channels(f, 0);
    assert_int_equal(serving_stats_of(f).sessions_drawing, 0);
    serving_end(f);
    serving_channel = LW_TILE_CHANNEL_FULL;
}

/* A client that has not asked for light takes no channel. */
static void test_a_form_is_taken_with_the_package(void **state) {
    (void)state;
    struct serving *f = serving_start(&(struct lw_server_desc){0});
    serving_channel = LW_TILE_CHANNEL_SPLIT;
    int s = serving_dial_and_greet(f);
    serving_expect_silence(s);
    assert_int_equal(lw_server_channels_taken(f->server), 0);
    serving_ask_for_package(s, 0);
    wait_for_channels(f, 1u << LW_TILE_CHANNEL_SPLIT);
    close(s);
    wait_for_channels(f, 0);
    serving_end(f);
    serving_channel = LW_TILE_CHANNEL_FULL;
}

/* A server without client lights takes the offer of nobody. */
static void test_no_client_lights(void **state) {
    (void)state;
    static const uint8_t none[] = {0, 0};
    for (int i = 0; i < 2; i++) {
        struct lw_server *server;
        struct serving *f = serving_start(&(struct lw_server_desc){0});
        struct lw_server_desc desc = {.host = "127.0.0.1",
                                      .atlas_map = &f->map,
                                      .package = f->package,
                                      .package_size = SERVING_PACKAGE_SIZE,
                                      .client_lights = i ? none : NULL,
                                      .client_lights_size = i ? sizeof none : 0};
        lw_server_stop(f->server);
        serving_join(f);
        lw_support_ok(lw_server_create(&desc, &server, NULL), NULL);
        f->server = server;
        assert_int_equal(pthread_create(&f->thread, NULL, serving_serve, f), 0);
        close(serving_dial_and_greet_with(f, LW_FEATURE_DRAWS)); /* which checks the accepted features */
        serving_end(f);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_channels_beside_each_other),
        cmocka_unit_test(test_a_form_is_taken_with_the_package),
        cmocka_unit_test(test_no_client_lights),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
