/* Tiles of finer levels through two relays in a row: whole programs, and clients at the daemon and behind.
 * The first relay has its light from the daemon, or through NATS. */
#include "tests/support/nats_case.h"
#include "tests/support/relays.h"

#include "common/base/clock.h"
#include "server/serve/admission/server_limits.h"
#include "tests/support/support.h"

#include <signal.h>
#include <stdio.h>
#include <string.h>

#define SCENE                                                                                                \
    "builtin:cornell --bounces 0 --frame-rate 100 --error 0.03 --light seen "                                \
    "--client-lights none --http none"

static struct lw_process server, relay[2];
static struct lw_nats_case nats;
static bool through_nats;

static int choose_nats(void **state) {
    (void)state;
    through_nats = true;
    return 0;
}

static int end_all(void **state) {
    (void)state;
    lw_relays_end();
    lw_nats_case_finish(&nats);
    through_nats = false;
    relay[0] = relay[1] = server = (struct lw_process){.port = 0};
    return 0;
}

static void join(int i, uint16_t port) {
    lw_relays_join_with(i, port, (struct lw_client_desc){.finer = LW_ATLAS_FINER_MAX, .wants_nothing = true});
}

static bool have_scenes(void) {
    for (int i = 0; i < LW_RELAYS_CLIENTS; i++)
        if (lw_relays_client[i] && !lw_client_atlas_map(lw_relays_client[i])) return false;
    return true;
}

static const struct lw_atlas_map *map_of(int i) { return lw_client_atlas_map(lw_relays_client[i]); }

/* Two tiles of the floor: by finer levels 1 and 2. */
static lw_tile_id fine_tile(int i, int which) {
    const lw_tile_id id = lw_atlas_map_claim_tile(map_of(i), 0, LW_ATLAS_FINER + 1 + (uint32_t)which, 0);
    assert_true(id.v != UINT32_MAX);
    return id;
}

static void want(int i, int count) {
    lw_tile_id tile[2];
    for (int k = 0; k < count; k++) tile[k] = fine_tile(i, k);
    lw_support_ok(lw_client_want(lw_relays_client[i], tile, (size_t)count), NULL);
}

static bool has_fine(int i, int which) {
    const lw_tile_id id = lw_atlas_map_find_tile(map_of(i), 0, LW_ATLAS_FINER + 1 + (uint32_t)which, 0);
    return id.v != UINT32_MAX && lw_client_get_tile(lw_relays_client[i], id).version;
}

/* Texels of the tile are the same with both. */
static bool is_same(int which) {
    const float *rgb[2];
    if (!has_fine(0, which) || !has_fine(1, which)) return false;
    for (int i = 0; i < 2; i++) {
        const lw_tile_id id = fine_tile(i, which);
        rgb[i] = lw_client_get_tile(lw_relays_client[i], id).rgb;
        if (lw_relays_stats(i).settled_frame != lw_relays_stats(0).frame) return false;
    }
    const struct lw_tile_place *place = &map_of(0)->place[fine_tile(0, which).v];
    return !memcmp(rgb[0], rgb[1], 3 * sizeof(float) * (size_t)place->width * place->height);
}

static bool are_same(void) { return is_same(0) && is_same(1); }
static bool first_is_same(void) { return is_same(0); }
static bool has_second(void) { return has_fine(1, 1); }
static bool has_first(void) { return has_fine(1, 0); }

static void start_first_relay(void) {
    char upstream[64];
    snprintf(upstream, sizeof upstream, "127.0.0.1:%u", server.port);
    lw_relays_start(&relay[0], through_nats ? lw_nats_case_address(&nats, "room") : upstream, "");
}

static void start(const char *options) {
    char upstream[64], line[400];
    if (through_nats && !lw_nats_case_is_possible()) skip();
    if (through_nats) lw_nats_case_start(&nats, &(struct lw_nats_case_desc){.host = NULL});
    snprintf(line, sizeof line, SCENE " %s %s %s", options, through_nats ? "--nats" : "",
             through_nats ? lw_nats_case_address(&nats, "room") : "");
    lw_process_serve(&server, line);
    start_first_relay();
    snprintf(upstream, sizeof upstream, "127.0.0.1:%u", relay[0].port);
    lw_relays_start(&relay[1], upstream, "");
}

static void wait_for_list(const struct lw_process *process, double tiles) {
    const uint64_t end_ns = lw_clock_ns() + LW_PROCESS_LIMIT_S * 1000000000ull;
    while (lw_relays_figure(process, "lightwell_interest_tiles") != tiles) {
        lw_relays_poll();
        assert_true(lw_clock_ns() < end_ns);
    }
}

/* Behind two relays a client has the same finer tiles as at the daemon. What it lists no more, no relay asks
 * for; listed again, it comes again. */
static void finer_tiles_come_through_two_relays(void **state) {
    (void)state;
    start("--texels-per-metre 20");
    join(0, server.port);
    join(1, relay[1].port);
    lw_relays_wait(have_scenes);
    assert_int_equal(lw_client_finer(lw_relays_client[1]), lw_client_finer(lw_relays_client[0]));
    want(0, 2);
    want(1, 2);
    lw_relays_wait(are_same);
    const double limit = lw_relays_figure(&server, "lightwell_light_memory_limit_bytes"),
                 bytes = lw_relays_figure(&server, "lightwell_light_memory_bytes");
    assert_true(lw_relays_figure(&server, "lightwell_fine_tiles") >= 2);
    assert_true(lw_relays_figure(&server, "lightwell_wanted_fine_tiles") == 2);
    assert_true(bytes > 2.0 * (1 << 20) && bytes <= limit);
    want(1, 1);
    for (int i = 0; i < 2; i++) wait_for_list(&relay[i], 1);
    lw_relays_wait(first_is_same);
    want(1, 2);
    lw_relays_wait(are_same);
}

/* The relay above dies, and starts again: sessions stay, and so do finer tiles, or they come again. */
static void finer_tiles_outlive_the_relay_above(void **state) {
    (void)state;
    start("--texels-per-metre 20");
    join(0, server.port);
    join(1, relay[1].port);
    lw_relays_wait(have_scenes);
    want(0, 2);
    want(1, 2);
    lw_relays_wait(are_same);
    assert_int_equal(lw_process_stop(&relay[0], SIGKILL, LW_PROCESS_LIMIT_S), -SIGKILL);
    lw_process_await_text(&relay[1], "clients keep the light");
    start_first_relay();
    lw_process_await_text(&relay[1], "is there: light goes on");
    lw_relays_wait(are_same);
}

/* A client that lists every finer tile takes none from one that lists two. */
static void a_greedy_client_harms_nobody(void **state) {
    (void)state;
    static lw_tile_id all[LW_SESSION_FINE_MAX];
    char options[64];
    snprintf(options, sizeof options, "--texels-per-metre 36 --memory %u",
             lw_process_needed_mb(SCENE " --texels-per-metre 36") + 8); /* 8 MB for finer levels */
    start(options);
    join(0, relay[1].port);
    join(1, relay[1].port);
    join(2, relay[1].port);
    lw_relays_wait(have_scenes);
    for (int i = 0; i < 3; i += 2) { /* two of them, from either end of the scene */
        const struct lw_atlas_map *map = map_of(i);
        uint32_t count = 0;
        for (uint32_t o = 0; o < map->object_count; o++)
            for (uint32_t t = 0; count < LW_SESSION_FINE_MAX; t++) {
                const uint32_t object = i ? map->object_count - 1 - o : o;
                if (!lw_atlas_map_has_tile(map, object, LW_ATLAS_FINER + 4, t)) break;
                all[count++] = lw_atlas_map_claim_tile(map, object, LW_ATLAS_FINER + 4, t);
            }
        assert_int_equal(count, LW_SESSION_FINE_MAX);
        lw_support_ok(lw_client_want(lw_relays_client[i], all, count), NULL);
    }
    const uint64_t end_ns = lw_clock_ns() + LW_PROCESS_LIMIT_S * 1000000000ull;
    while (lw_relays_figure(&relay[1], "lightwell_interest_tiles") < 1.3 * LW_SESSION_FINE_MAX) {
        lw_relays_poll();
        assert_true(lw_clock_ns() < end_ns);
    }
    want(1, 2);
    lw_relays_wait(has_first);
    lw_relays_wait(has_second);
}

/* The daemon lights tiles that it hears of through NATS alone. What its own client changes while NATS is gone
 * comes once NATS is back, and nothing of before stays. */
static void finer_tiles_outlive_nats(void **state) {
    (void)state;
    struct lw_client_answer answer;
    start("--texels-per-metre 20");
    join(1, relay[1].port);
    lw_relays_wait(have_scenes);
    want(1, 2);
    lw_relays_wait(has_first);
    lw_relays_wait(has_second);
    lw_relays_join_with(
        0, server.port,
        (struct lw_client_desc){.finer = LW_ATLAS_FINER_MAX, .wants_nothing = true, .control = true});
    lw_relays_wait(have_scenes);
    want(0, 2);
    lw_relays_wait(are_same);
    lw_nats_case_kill(&nats);
    lw_process_await_text(&server, "is gone: its relays get no light");
    const struct lw_scene_change hide = {.kind = LW_SCENE_CHANGE_OBJECT_HIDE, .target = 5};
    lw_relays_update(0, &hide, &answer);
    assert_int_equal(answer.code, LW_SCENE_CHANGE_OK);
    assert_false(are_same());
    lw_nats_case_start(&nats, &(struct lw_nats_case_desc){.host = NULL});
    lw_process_await_text(&server, "is there again");
    lw_relays_wait(are_same);
}

#define THROUGH_NATS(test)                                                                                   \
    { #test "_through_nats", test, choose_nats, end_all, NULL }

int main(void) {
    const struct CMUnitTest tests[] = {
        THROUGH_NATS(finer_tiles_come_through_two_relays),
        THROUGH_NATS(finer_tiles_outlive_the_relay_above),
        THROUGH_NATS(a_greedy_client_harms_nobody),
        THROUGH_NATS(finer_tiles_outlive_nats),
        cmocka_unit_test_teardown(finer_tiles_come_through_two_relays, end_all),
        cmocka_unit_test_teardown(finer_tiles_outlive_the_relay_above, end_all),
        cmocka_unit_test_teardown(a_greedy_client_harms_nobody, end_all),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
