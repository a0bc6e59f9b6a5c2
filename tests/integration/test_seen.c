/* The real lightwelld under --light seen: it lights what its clients look at, and what lights that. */
#include "tests/support/process.h"

#include "client/lib/client.h"
#include "common/base/clock.h"
#include "common/base/log.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define LIMIT_S LW_PROCESS_LIMIT_S

/* Some fifty tiles that never converge, so that every frame tells its solved tiles. */
#define SEEN "--error 1e-6 --json --light seen "
/* The same by the wall clock, at rest. */
#define PREPARED "--freeze 0 --json --first-light whole "

#define CLIENTS_MAX 3
static struct lw_client *client[CLIENTS_MAX];

/* Two rooms: an object in one is hardly seen from the second. */
#define ROOMS "builtin:ajar --texels-per-metre 20 "

/* Frames come one by one, by next_frame(): a daemon that goes on while nobody reads what it says takes both
 * cores. */
static void serve_by_hand(struct lw_process *daemon, const char *arguments) {
    lw_process_serve_by_hand(daemon, arguments);
    lw_process_step(daemon, 1);
}

static int end_all(void **state) {
    (void)state;
    for (int i = 0; i < CLIENTS_MAX; i++) {
        lw_client_destroy(client[i]);
        client[i] = NULL;
    }
    lw_process_kill_all();
    return 0;
}

static void poll_all(void) {
    bool any = false;
    for (int i = 0; i < CLIENTS_MAX; i++) {
        struct lw_error err = {0};
        if (client[i]) lw_support_ok(lw_client_poll(client[i], any ? 0 : 5, &err), &err);
        any |= client[i] != NULL;
    }
}

struct solved {
    const struct lw_process *daemon;
    double frame;
};

static bool is_solved(void *context) {
    const struct solved *solved = context;
    poll_all();
    return lw_process_newest(solved->daemon, "frame") >= solved->frame;
}

/* Lets a daemon of serve_by_hand() solve a frame. */
static void next_frame(struct lw_process *daemon) {
    struct solved solved = {daemon, lw_process_newest(daemon, "frame") + 1};
    lw_process_step(daemon, 1);
    assert_true(lw_process_await(daemon, is_solved, &solved));
}

/* Until the daemon's next frame, or something arrives. */
static void wait_a_little(struct lw_process *daemon) {
    if (daemon->in) return next_frame(daemon);
    for (int i = 0; i < CLIENTS_MAX; i++)
        if (client[i]) return poll_all();
    lw_process_await_frames(daemon, 1);
}

static void join(struct lw_process *daemon, int i, bool wants_nothing) {
    struct lw_error err = {0};
    lw_support_ok(lw_client_create(&(struct lw_client_desc){.host = "127.0.0.1",
                                                            .port = daemon->port,
                                                            .name = "test_seen",
                                                            .timeout_ms = LIMIT_S * 1000,
                                                            .wants_nothing = wants_nothing},
                                   &client[i], &err),
                  &err);
    while (!lw_client_scene(client[i])) lw_support_ok(lw_client_poll(client[i], 100, &err), &err);
}

/* The finest tiles of one object. */
static uint32_t look_at(int i, uint32_t object) {
    const struct lw_atlas_map *map = lw_client_atlas_map(client[i]);
    lw_tile_id tile[256];
    uint32_t count = 0;
    for (uint32_t t = 0; t < map->tile_count; t++)
        if (map->place[t].object == object && map->place[t].level == 0 && count < 256)
            tile[count++] = (lw_tile_id){t};
    lw_support_ok(lw_client_want(client[i], tile, count), NULL);
    return count;
}

/* Polls until the daemon says so, for a frame after this. */
static void wait_for(struct lw_process *daemon, const char *key, double low, double high) {
    const double from = lw_process_newest(daemon, "frame");
    for (uint64_t end_ns = lw_clock_ns() + LIMIT_S * 1000000000ull;;) {
        wait_a_little(daemon);
        const double number = lw_process_newest(daemon, key);
        if (lw_process_newest(daemon, "frame") > from && number >= low && number <= high) return;
        if (lw_clock_ns() > end_ns) fail_msg("%s is %g, not in %g..%g", key, number, low, high);
    }
}

/* Texels per frame. */
static double solved_over(struct lw_process *daemon, unsigned frames) {
    double sum = 0;
    for (unsigned f = 0; f < frames; f++) {
        next_frame(daemon);
        sum += lw_process_newest(daemon, "texels_solved");
    }
    return sum / frames;
}

/* The largest objects that hold several tiles: the first and the second. */
static void find_objects(const struct lw_atlas_map *map, uint32_t out[2]) {
    uint32_t most[2] = {0};
    for (uint32_t o = 0; o < map->object_count; o++) {
        const uint32_t tiles = map->atlas[o]->level[0].tiles_x * map->atlas[o]->level[0].tiles_y;
        if (tiles > 20) continue; /* not one that is most of the scene */
        const int place = tiles > most[0] ? 0 : tiles > most[1] ? 1 : 2;
        if (place == 0) most[1] = most[0], out[1] = out[0];
        if (place < 2) most[place] = tiles, out[place] = o;
    }
    assert_true(most[1] >= 1);
}

/* Frames in which each contributor is solved at least once: fewer have more or less of them by chance. */
#define CYCLE 16

static void clients_come_and_go(void **state) {
    (void)state;
    struct lw_process daemon;
    char arguments[600];
    /* objects that hide one another and move */
    snprintf(arguments, sizeof arguments, "%s " SEEN "--animate", lw_process_atrium());
    serve_by_hand(&daemon, arguments);
    /* nobody looks: everything has been lit once, then nothing is */
    wait_for(&daemon, "tiles_solved", 0, 0);
    const double rays = lw_process_newest(&daemon, "rays_total");
    assert_true(rays > 0);
    for (int i = 0; i < 10; i++) next_frame(&daemon);
    assert_true(lw_process_newest(&daemon, "rays_total") == rays);
    /* one client, one wall */
    join(&daemon, 0, true);
    uint32_t object[2];
    find_objects(lw_client_atlas_map(client[0]), object);
    const double one = look_at(0, object[0]);
    wait_for(&daemon, "tiles_interest", 1, one);
    const double first = solved_over(&daemon, CYCLE);
    assert_true(lw_process_newest(&daemon, "tiles_contributing") > 0);
    /* a second one elsewhere; both see theirs change */
    join(&daemon, 1, true);
    const double both = one + look_at(1, object[1]);
    wait_for(&daemon, "tiles_interest", lw_process_newest(&daemon, "tiles_interest") + 1, both);
    const double second = solved_over(&daemon, CYCLE);
    /* somebody who wants everything */
    join(&daemon, 2, false);
    wait_for(&daemon, "tiles_contributing", 0, 0);
    const double all = solved_over(&daemon, 3);
    if (!(first < 0.7 * all && first < second && second < all))
        fail_msg("texels per frame: one wall %g, two %g, all %g", first, second, all);
    for (int i = 0; i < 2; i++) {
        const lw_tile_id tile = {lw_client_atlas_map(client[i])->first_tile[object[i]]};
        const uint64_t version = lw_client_get_tile(client[i], tile).version;
        for (uint64_t end_ns = lw_clock_ns() + LIMIT_S * 1000000000ull;
             lw_client_get_tile(client[i], tile).version == version;) {
            assert_true(lw_clock_ns() < end_ns);
            next_frame(&daemon);
        }
        const lw_tile_id other = {lw_client_atlas_map(client[i])->first_tile[object[1 - i]]};
        const struct lw_atlas *atlas = lw_client_atlas_map(client[i])->atlas[object[1 - i]];
        if (atlas->level_count > 1) assert_int_equal(lw_client_get_tile(client[i], other).version, 0);
        assert_true(lw_client_get_tile(client[i], (lw_tile_id){other.v + atlas->tile_count - 1}).version > 0);
    }
    /* they leave one by one */
    lw_client_destroy(client[2]);
    client[2] = NULL;
    wait_for(&daemon, "tiles_interest", 1, both);
    lw_client_destroy(client[1]);
    client[1] = NULL;
    wait_for(&daemon, "tiles_interest", 1, one);
    lw_client_destroy(client[0]);
    client[0] = NULL;
    wait_for(&daemon, "tiles_solved", 0, 0);
    assert_int_equal(lw_process_newest(&daemon, "tiles_interest"), 0);
    lw_process_end(&daemon);
}

/* The most that any frame says of a key. */
static double most(const struct lw_process *daemon, const char *key) {
    char *text = lw_process_out(daemon), *end = strrchr(text, '\n');
    double number = 0;
    if (end) *end = '\0';
    for (char *line = strtok(text, "\n"); end && line; line = strtok(NULL, "\n"))
        number = fmax(number, lw_process_number(line, key));
    free(text);
    return number;
}

static void a_viewer_asks_for_what_it_sees(void **state) {
    (void)state;
    struct lw_process daemon, viewer;
    char arguments[512];
    lw_process_serve(&daemon, ROOMS SEEN "--clock step --freeze 0");
    snprintf(arguments, sizeof arguments,
             "127.0.0.1:%u --headless --camera-name main --size 160x90 --wait complete --out %s --timeout %d",
             daemon.port, lw_support_temporary("seen.exr"), LIMIT_S);
    lw_process_start(&viewer, "lightwell-view", arguments);
    assert_int_equal(lw_process_finish(&viewer, LIMIT_S), 0);
    wait_for(&daemon, "tiles_solved", 0, 0);
    const double wanted = most(&daemon, "tiles_interest"), tiles = most(&daemon, "tiles");
    if (!(wanted > 0 && wanted < 0.8 * tiles)) fail_msg("%g of %g tiles", wanted, tiles);
    lw_process_end(&daemon);
}

/* By the wall clock it goes on until all is as good as asked for; for --prepare's seconds at most, but those
 * are of light that is made better. */
static void light_gets_better_before_anybody_looks(void **state) {
    (void)state;
    struct lw_process daemon;
    lw_process_serve(&daemon, "builtin:cornell --texels-per-metre 8 --error 0.1 --json --prepare 1000");
    wait_for(&daemon, "tiles_solved", 1, HUGE_VAL);
    const double tiles = lw_process_newest(&daemon, "tiles");
    wait_for(&daemon, "tiles_converged", tiles, tiles);
    wait_for(&daemon, "tiles_solved", 0, 0);
    lw_process_end(&daemon);
    lw_process_serve(&daemon, ROOMS PREPARED "--error 1e-6 --prepare 0.5");
    wait_for(&daemon, "tiles_solved", 1, HUGE_VAL);
    wait_for(&daemon, "tiles_solved", 0, 0);
    assert_true(lw_process_newest(&daemon, "tiles_converged") < lw_process_newest(&daemon, "tiles"));
    lw_process_end(&daemon);
}

/* The viewer's tiles are solved first, and alone; the rest of the time comes after them. */
static void preparing_makes_way(void **state) {
    (void)state;
    struct lw_process daemon;
    lw_process_serve(&daemon, ROOMS PREPARED "--error 1e-6 --prepare 1000");
    wait_for(&daemon, "tiles_solved", 1, HUGE_VAL);
    const double all = lw_process_newest(&daemon, "tiles_interest");
    join(&daemon, 0, true);
    uint32_t object[2];
    find_objects(lw_client_atlas_map(client[0]), object);
    const double one = look_at(0, object[0]);
    assert_true(one < all);
    wait_for(&daemon, "tiles_interest", 1, one);
    lw_client_destroy(client[0]);
    client[0] = NULL;
    wait_for(&daemon, "tiles_interest", all, all);
    wait_for(&daemon, "tiles_solved", 1, HUGE_VAL);
    lw_process_end(&daemon);
}

int main(void) {
    lw_log_init("test_seen", LW_LOG_WARNING);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(clients_come_and_go, end_all),
        cmocka_unit_test_teardown(a_viewer_asks_for_what_it_sees, end_all),
        cmocka_unit_test_teardown(light_gets_better_before_anybody_looks, end_all),
        cmocka_unit_test_teardown(preparing_makes_way, end_all),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
