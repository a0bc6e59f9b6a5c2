/* The real lightwelld with clients that draw direct light beside clients that do not. */
#include "tests/support/client_light.h"
#include "tests/support/process.h"

#include "client/lib/client.h"
#include "common/base/clock.h"
#include "common/base/log.h"
#include "common/tile/tile_channels.h"
#include "common/tile/tile_dct.h"
#include "server/publish/publisher.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>

#define LIMIT_S LW_PROCESS_LIMIT_S
#define TARGET  0.3f
#define CORNELL                                                                                              \
    "builtin:cornell --texels-per-metre 8 --clock step --json --light whole --error 0.3 --frame-rate 200 "

enum { FULL, SPLIT, CLIENTS };
static struct lw_client *client[CLIENTS];
static struct lw_process server;
static bool asks_directions; /* who joins */

static int end_all(void **state) {
    (void)state;
    for (int i = 0; i < CLIENTS; i++) {
        lw_client_destroy(client[i]);
        client[i] = NULL;
    }
    lw_process_kill_all();
    return 0;
}

static void join(int i) {
    struct lw_error err = {0};
    lw_support_ok(
        lw_client_create(
            &(struct lw_client_desc){.host = "127.0.0.1",
                                     .port = server.port,
                                     .name = "test_two_channels",
                                     .draws_direct = i == SPLIT,
                                     .channel_features = asks_directions ? LW_TILE_CHANNELS_DIRECTION : 0,
                                     .control = true,
                                     .timeout_ms = LIMIT_S * 1000},
            &client[i], &err),
        &err);
}

static void leave(int i) {
    lw_client_destroy(client[i]);
    client[i] = NULL;
}

static void poll_all(void) {
    struct lw_error err = {0};
    for (int i = 0; i < CLIENTS; i++)
        if (client[i]) lw_support_ok(lw_client_poll(client[i], 5, &err), &err);
}

/* The client has every tile, converged, and the server has nothing left to send. */
static bool is_at_rest(int i) {
    struct lw_client_stats stats;
    lw_client_get_stats(client[i], &stats);
    return stats.frame && stats.settled_frame == stats.frame && client_light_is_whole(client[i], TARGET);
}

static void wait_for_rest(int i) {
    const uint64_t end_ns = lw_clock_ns() + LIMIT_S * 1000000000ull;
    while (!is_at_rest(i)) {
        poll_all();
        if (lw_clock_ns() > end_ns) fail_msg("not converged within %u s", LIMIT_S);
    }
}

/* Every channel, and nothing more is solved: a channel may have its last frame before another has. */
static void wait_for_the_last_frame(void) {
    const uint64_t end_ns = lw_clock_ns() + LIMIT_S * 1000000000ull;
    while (lw_process_newest(&server, "tiles_solved") > 0) {
        poll_all();
        if (lw_clock_ns() > end_ns) fail_msg("still solving after %d s", LIMIT_S);
    }
    for (int i = 0; i < CLIENTS; i++)
        if (client[i]) wait_for_rest(i);
}

static uint64_t tiles_of(int i) {
    struct lw_client_stats stats;
    lw_client_get_stats(client[i], &stats);
    return stats.tiles;
}

/* Light is counted once: what the second channel lacks is what the lamp, the only light, gives directly. */
static void full_is_split_and_what_is_drawn(void **state) {
    (void)state;
    double light[2][CLIENTS];
    for (int bounces = 0; bounces <= 2; bounces += 2) {
        char arguments[300];
        snprintf(arguments, sizeof arguments, CORNELL "--bounces %d", bounces);
        lw_process_serve(&server, arguments);
        lw_process_await_text(&server, "clients draw the direct light of 1 emissive material, if they can");
        for (int i = 0; i < CLIENTS; i++) join(i);
        for (int i = 0; i < CLIENTS; i++) wait_for_rest(i);
        for (int i = 0; i < CLIENTS; i++) light[bounces / 2][i] = client_light_total(client[i]);
        assert_null(lw_client_draws(client[FULL]));
        const struct lw_client_draws *draws = lw_client_draws(client[SPLIT]);
        uint32_t shining = 0, drawn = 0;
        for (uint32_t m = 0; m < draws->material_count; m++) {
            shining += lw_client_scene(client[SPLIT])->material[m].emission[0] > 0;
            drawn += draws->material[m];
        }
        assert_true(shining == 1 && drawn == 1);
        lw_process_await_frames(&server, 2); /* light may come before its frame's line */
        assert_true(lw_process_newest(&server, "sessions_drawing") == 1);
        lw_process_end(&server);
        for (int i = 0; i < CLIENTS; i++) leave(i);
    }
    print_message("direct light: full %.1f, split %.3f; with bounces: full %.1f, split %.1f\n",
                  light[0][FULL], light[0][SPLIT], light[1][FULL], light[1][SPLIT]);
    assert_true(light[0][FULL] > 0 && light[1][SPLIT] > 0.05 * light[1][FULL]);
    assert_true(light[0][SPLIT] < 1e-3 * light[0][FULL]);
    assert_true(fabs(light[1][FULL] - light[1][SPLIT] - light[0][FULL]) < 0.03 * light[1][FULL]);
}

/* A channel that nobody took is there with the next frame, though nothing is solved any more. */
static void a_form_that_is_taken_late_comes_at_once(void **state) {
    (void)state;
    lw_process_serve(&server, CORNELL);
    join(FULL);
    wait_for_rest(FULL);
    wait_for_the_last_frame();
    const double rays = lw_process_newest(&server, "rays_total");
    const uint64_t tiles = tiles_of(FULL), joined_ns = lw_clock_ns();
    join(SPLIT);
    wait_for_rest(SPLIT);
    print_message("light after %.0f ms\n", 1e-6 * (double)(lw_clock_ns() - joined_ns));
    poll_all();
    lw_process_await_frames(&server, 2);
    assert_true(lw_process_newest(&server, "rays_total") == rays);
    assert_int_equal(tiles_of(FULL), tiles); /* what they have is as it was */
    /* and a client that comes back finds it still there */
    struct lw_error err = {0};
    const uint64_t before = tiles_of(SPLIT);
    assert_int_equal(shutdown(lw_client_descriptor(client[SPLIT]), SHUT_RDWR), 0);
    while (lw_client_poll(client[SPLIT], 10, &err) == LW_OK) {
    }
    err = (struct lw_error){0};
    lw_support_ok(lw_client_reconnect(client[SPLIT], &err), &err);
    wait_for_rest(SPLIT);
    assert_int_equal(tiles_of(SPLIT), before);
}

/* Error of a decoded component of a direction, root mean square over a tile, at most. */
#define CODED_ERROR                                                                                          \
    (LW_TILE_DCT_HOLD * LW_PUBLISHER_STEP_WIDEST * lw_tile_channel_at(LW_TILE_CHANNEL_DIRECTION)->step)

/* Counts the texels of level 0 whose light has a direction. */
static uint32_t count_directions(int i) {
    uint32_t known = 0;
    for (uint32_t o = 0; o < lw_client_atlas_map(client[i])->object_count; o++) {
        const struct lw_client_level level = lw_client_get_level(client[i], o, 0);
        for (uint32_t t = 0; level.direction && t < level.width * level.height; t++) {
            const float *direction = level.direction + 3 * (size_t)t;
            const float length = lw_vec3_length(lw_vec3(direction[0], direction[1], direction[2]));
            assert_true(length < 1 + 3 * CODED_ERROR);
            known += length > 0.2f;
        }
    }
    return known;
}

/* A client that asks for directions gets them in either irradiance. Another gets none. */
static void directions_for_who_asks(void **state) {
    (void)state;
    lw_process_serve(&server, CORNELL "--directional on");
    lw_process_await_text(&server, "light has a direction on 8 of 8 objects");
    for (asks_directions = false;; asks_directions = true) {
        for (int i = 0; i < CLIENTS; i++) join(i);
        for (int i = 0; i < CLIENTS; i++) wait_for_rest(i);
        for (int i = 0; i < CLIENTS; i++) {
            const uint32_t known = count_directions(i);
            print_message("%u texels\n", known);
            assert_true(asks_directions ? known > 1000 : known == 0);
            leave(i);
        }
        if (asks_directions) break;
    }
    lw_process_end(&server);
    lw_process_serve(&server, CORNELL "--directional off");
    join(FULL);
    wait_for_rest(FULL);
    assert_int_equal(count_directions(FULL), 0);
    asks_directions = false;
}

/* The same while a scene moves, by the real clock, and where only the interest set is lit. */
static void who_draws_joins_a_scene_that_moves(void **state) {
    (void)state;
    struct lw_client_stats stats;
    char arguments[600];
    snprintf(arguments, sizeof arguments, "%s --json", lw_process_atrium());
    lw_process_serve(&server, arguments);
    lw_process_await_text(&server,
                          "clients draw the direct light of 1 sun, 2 emissive materials, if they can");
    const uint64_t end_ns = lw_clock_ns() + LIMIT_S * 1000000000ull;
    for (int i = 0; i < CLIENTS; i++) {
        const uint64_t joined_ns = lw_clock_ns();
        join(i);
        do {
            poll_all();
            lw_client_get_stats(client[i], &stats);
            assert_true(lw_clock_ns() < end_ns);
        } while (!stats.first_ns);
        print_message("%s: light after %.0f ms, %.0f ms behind the scene\n", i == SPLIT ? "split" : "full",
                      1e-6 * (double)(stats.first_ns - joined_ns),
                      1e-6 * (double)(stats.first_ns - stats.package_ns));
    }
    leave(FULL);
    const uint64_t frame = stats.frame;
    while (stats.frame < frame + 30) { /* the lamp goes on, and so does its light */
        poll_all();
        lw_client_get_stats(client[SPLIT], &stats);
        assert_true(lw_clock_ns() < end_ns);
    }
    uint64_t newest = 0;
    for (uint32_t t = 0; t < lw_client_atlas_map(client[SPLIT])->tile_count; t++) {
        const uint64_t version = lw_client_get_tile(client[SPLIT], (lw_tile_id){t}).version;
        newest = version > newest ? version : newest;
    }
    assert_true(newest > 2 * frame); /* versions are two a frame */
}

/* A lamp that a client draws is switched: both channels follow. */
static void both_channels_follow_changes(void **state) {
    (void)state;
    lw_process_serve(&server, CORNELL);
    for (int i = 0; i < CLIENTS; i++) join(i);
    for (int i = 0; i < CLIENTS; i++) wait_for_rest(i);
    double light[CLIENTS];
    for (int i = 0; i < CLIENTS; i++) light[i] = client_light_total(client[i]);
    struct lw_scene_change half = {.kind = LW_SCENE_CHANGE_MATERIAL_EMISSION, .value_count = 3};
    const struct lw_scene *scene = lw_client_scene(client[FULL]);
    for (uint32_t m = 0; m < scene->material_count; m++)
        for (int c = 0; scene->material[m].emission[0] > 0 && c < 3; c++) {
            half.target = m;
            half.value[c] = 0.5f * scene->material[m].emission[c];
        }
    struct lw_error err = {0};
    lw_support_ok(lw_client_update(client[FULL], &half, 1, NULL, &err), &err);
    const uint64_t end_ns = lw_clock_ns() + LIMIT_S * 1000000000ull;
    for (int i = 0; i < CLIENTS; i++)
        while (!is_at_rest(i) || fabs(client_light_total(client[i]) - 0.5 * light[i]) > 0.05 * light[i]) {
            poll_all();
            assert_true(lw_clock_ns() < end_ns);
        }
}

/* A session with a slow link gets all of it in the end. */
static void a_narrow_link_carries_the_second_channel(void **state) {
    (void)state;
    lw_process_serve(&server, CORNELL "--link-rate 0.3");
    join(SPLIT);
    wait_for_rest(SPLIT);
    assert_true(client_light_total(client[SPLIT]) > 0);
}

static void kept_light_is_there_in_both_channels(void **state) {
    (void)state;
    char arguments[500];
    double light[CLIENTS];
    snprintf(arguments, sizeof arguments, CORNELL "--keep %s", lw_support_temporary("two_channels"));
    lw_process_serve(&server, arguments);
    for (int i = 0; i < CLIENTS; i++) join(i);
    for (int i = 0; i < CLIENTS; i++) wait_for_rest(i);
    wait_for_the_last_frame();
    for (int i = 0; i < CLIENTS; i++) light[i] = client_light_total(client[i]);
    lw_process_end(&server);
    for (int i = 0; i < CLIENTS; i++) leave(i);
    lw_process_serve(&server, arguments);
    for (int i = 0; i < CLIENTS; i++) join(i);
    for (int i = 0; i < CLIENTS; i++) wait_for_rest(i);
    while (!lw_process_said(&server, "first light"))
        poll_all(); /* until then clients have the light of the last run */
    for (int i = 0; i < CLIENTS; i++) wait_for_rest(i);
    assert_true(lw_process_said(&server, "showing frame") && lw_process_said(&server, "going on after"));
    for (int i = 0; i < CLIENTS; i++)
        assert_true(fabs(client_light_total(client[i]) - light[i]) < 0.01 * light[i]);
    assert_true(lw_process_newest(&server, "rays_total") == 0);
    lw_process_end(&server);
    for (int i = 0; i < CLIENTS; i++) leave(i);
    /* the split irradiance is of other lights then */
    snprintf(arguments, sizeof arguments, CORNELL "--client-lights none --keep %s",
             lw_support_temporary("two_channels"));
    lw_process_serve(&server, arguments);
    join(SPLIT);
    wait_for_rest(SPLIT);
    lw_process_await_text(&server, "clients draw no direct light");
    assert_false(lw_process_said(&server, "showing frame"));
    assert_null(lw_client_draws(client[SPLIT]));
    assert_true(fabs(client_light_total(client[SPLIT]) - light[FULL]) < 0.05 * light[FULL]);
}

static void what_does_not_shine_is_named(void **state) {
    (void)state;
    lw_process_start(&server, "lightwelld", "builtin:cornell --listen 127.0.0.1:0 --client-lights nosuch");
    assert_int_equal(lw_process_finish(&server, LIMIT_S), 64);
    assert_true(lw_process_said(&server, "--client-lights") && lw_process_said(&server, "nosuch"));
}

int main(void) {
    lw_log_init("test_two_channels", LW_LOG_WARNING);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(full_is_split_and_what_is_drawn, end_all),
        cmocka_unit_test_teardown(directions_for_who_asks, end_all),
        cmocka_unit_test_teardown(a_form_that_is_taken_late_comes_at_once, end_all),
        cmocka_unit_test_teardown(who_draws_joins_a_scene_that_moves, end_all),
        cmocka_unit_test_teardown(both_channels_follow_changes, end_all),
        cmocka_unit_test_teardown(a_narrow_link_carries_the_second_channel, end_all),
        cmocka_unit_test_teardown(kept_light_is_there_in_both_channels, end_all),
        cmocka_unit_test_teardown(what_does_not_shine_is_named, end_all),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
