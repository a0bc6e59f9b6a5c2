/* The real lightwelld and lightwell-relay: what a relay finds above itself, in its folder of packages and on
 * its clock, and lightwellctl through it. */
#include "tests/support/relays.h"

#include "common/base/random.h"

#include "common/base/sanitizer.h"

#include <dirent.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define CHAIN 16 /* relays that light may go through */
#define DAY_S 86400

#define ODD_TRIANGLES 400u

static struct lw_process server, other, relay[CHAIN];

static int end_all(void **state) {
    (void)state;
    lw_relays_end();
    memset(relay, 0, sizeof relay);
    server = other = (struct lw_process){.port = 0};
    return 0;
}

static const char *at(const struct lw_process *process) {
    static char text[64];
    snprintf(text, sizeof text, "127.0.0.1:%u", process->port);
    return text;
}

static void kill_it(struct lw_process *process) {
    assert_int_equal(lw_process_stop(process, SIGKILL, LW_PROCESS_LIMIT_S), -SIGKILL);
}

/* ---- lightwellctl ---- */

/* The caller frees the text. */
static char *ctl(const struct lw_process *of, const char *command) {
    char line[100];
    struct lw_process process;
    snprintf(line, sizeof line, "%s %s", at(of), command);
    lw_process_run(&process, "lightwellctl", line, 0);
    return lw_process_out(&process);
}

/* Operators need not know that a server is a relay. */
static void lightwellctl_works_through_a_relay(void **state) {
    (void)state;
    unsigned long long frame = 0;
    lw_process_serve(&server, LW_RELAYS_CORNELL);
    lw_relays_start(&relay[0], at(&server), "");
    lw_relays_join(0, server.port);
    lw_relays_join(1, relay[0].port);
    lw_relays_rest(&server);
    char *said = ctl(&relay[0], "status");
    assert_non_null(strstr(said, ": serving"));
    free(said);
    said = ctl(&relay[0], "hide #5");
    assert_int_equal(sscanf(said, "frame %llu", &frame), 1);
    free(said);
    lw_relays_rest(&server); /* the change is in light that a client of the daemon has, too */
    for (int i = 0; i < 2; i++) {
        assert_true(lw_relays_stats(i).frame >= frame);
        assert_true(lw_client_object_hidden(lw_relays_client[i], 5));
    }
    said = ctl(&relay[0], "stats --json");
    assert_int_equal((int)lw_process_number(said, "lightwell_passed_updates_total"), 1);
    free(said);
    assert_true(lw_relays_figure(&relay[0], "lightwell_passed_updates_total") == 1);
}

/* ---- packages ---- */

/* The only file of a folder. */
static void find_file(const char *folder, char *path, size_t size) {
    DIR *directory = opendir(folder);
    const struct dirent *entry;
    unsigned count = 0;
    assert_non_null(directory);
    while ((entry = readdir(directory)))
        if (*entry->d_name != '.') {
            snprintf(path, size, "%s/%s", folder, entry->d_name);
            count++;
        }
    closedir(directory);
    assert_int_equal(count, 1);
}

/* A scene of odd triangles, so that its package is larger than all else that comes: their corners are in no
 * order that a compressor finds. */
static const char *odd_scene(void) {
    static char path[300], text[60000];
    size_t at = 0;
    for (uint32_t i = 0; i < 3 * ODD_TRIANGLES; i++)
        at += (size_t)snprintf(text + at, sizeof text - at, "v %u.%03u %u.%03u %u.%03u\n", i % 7,
                               lw_random_hash2(i, 0) % 1000, i % 5, lw_random_hash2(i, 1) % 1000, i % 3,
                               lw_random_hash2(i, 2) % 1000);
    for (uint32_t i = 0; i < 3 * ODD_TRIANGLES; i += 3)
        at += (size_t)snprintf(text + at, sizeof text - at, "f %u %u %u\n", i + 1, i + 2, i + 3);
    assert_true(at < sizeof text - 1);
    snprintf(path, sizeof path, "%s", lw_support_temporary("odd.obj"));
    lw_support_write_file(path, text, at);
    return path;
}

static bool has_scene(void) { return lw_client_scene(lw_relays_client[1]) != NULL; }

/* Starts the relay; what it has received once a client of it, which wants no light, has the scene. */
static double received_by_start(const char *options) {
    lw_relays_start(&relay[0], at(&server), options);
    lw_relays_join_with(1, relay[0].port, (struct lw_client_desc){.wants_nothing = true});
    lw_relays_wait(has_scene);
    const double bytes = lw_relays_figure(&relay[0], "lightwell_upstream_received_bytes_total");
    lw_client_destroy(lw_relays_client[1]);
    lw_relays_client[1] = NULL;
    assert_int_equal(lw_process_stop(&relay[0], SIGTERM, LW_PROCESS_LIMIT_S), 0);
    return bytes;
}

static void packages_are_downloaded_once(void **state) {
    (void)state;
    char folder[200], options[300], path[500], line[500];
    size_t size;
    snprintf(folder, sizeof folder, "%s", lw_support_temporary("packages"));
    snprintf(options, sizeof options, "--cache %s", folder);
    snprintf(line, sizeof line, "%s --sky 1,1,1 --texels-per-metre 0.5 --bounces 0 --http none", odd_scene());
    lw_process_serve(&server, line);
    lw_relays_join(0, server.port);
    const double first = received_by_start(options), second = received_by_start(options);
    const double package = (double)lw_relays_stats(0).package_bytes;
    assert_true(package > 10000 && second < first - package / 2);
    /* a damaged file: a line says so, and the package comes again */
    find_file(folder, path, sizeof path);
    uint8_t *bytes = lw_support_read_file(path, &size);
    bytes[size / 2] ^= 1;
    lw_support_write_file(path, (const char *)bytes, size);
    free(bytes);
    const double third = received_by_start(options);
    assert_true(third > second + package / 2);
    assert_true(lw_process_said(&relay[0], "is damaged or cannot be read"));
    assert_true(received_by_start(options) < third - package / 2); /* it was mended */
    lw_process_left_nothing();
}

/* ---- servers above ---- */

static void expect_light_of(const struct lw_process *daemon) {
    lw_relays_join(0, daemon->port);
    lw_relays_join(1, relay[0].port);
    lw_relays_expect_same();
    lw_client_destroy(lw_relays_client[0]);
    lw_relays_client[0] = NULL;
}

/* Two servers light different scenes. Clients see one scene at a time. A server that comes back takes
 * nobody away from the one that serves. */
static void servers_above_light_different_scenes(void **state) {
    (void)state;
    char upstreams[128], again[300];
    lw_process_serve(&server, LW_RELAYS_CORNELL);
    lw_process_serve(&other, LW_RELAYS_CORNELL " --texels-per-metre 4");
    snprintf(upstreams, sizeof upstreams, "127.0.0.1:%u,127.0.0.1:%u", server.port, other.port);
    lw_relays_start(&relay[0], upstreams, "");
    expect_light_of(&server);
    kill_it(&server);
    lw_process_await_text(&relay[0], "another scene now: clients go over to it");
    lw_relays_await_other_scene(1);
    expect_light_of(&other);
    snprintf(again, sizeof again, LW_RELAYS_CORNELL " --listen 127.0.0.1:%u", server.port);
    lw_process_serve(&server, again);
    lw_relays_poll(); /* the client of the relay is still there */
    lw_relays_join(0, other.port);
    lw_relays_expect_same();
    lw_client_destroy(lw_relays_client[0]);
    lw_relays_client[0] = NULL;
    kill_it(&other);
    lw_process_await_texts(&relay[0], "another scene now: clients go over to it", 2);
    lw_relays_await_other_scene(1);
    expect_light_of(&server);
}

/* Light goes through 16 relays. A further one is refused. */
static void a_chain_of_relays_has_an_end(void **state) {
    (void)state;
    struct lw_process further = {.port = 0};
    lw_process_serve(&server, LW_RELAYS_CORNELL);
    for (int i = 0; i < CHAIN; i++) lw_relays_start(&relay[i], at(i ? &relay[i - 1] : &server), "");
    lw_relays_join(0, server.port);
    lw_relays_join(1, relay[CHAIN - 1].port);
    lw_relays_expect_same();
    lw_process_start(&further, "lightwell-relay", at(&relay[CHAIN - 1]));
    lw_process_await_text(&further, "comes through 16 relays already");
    lw_relays_poll();
}

/* ---- clocks ---- */

/* Starts a relay whose wall clock jumps when the first client connects. */
static void start_with_jump(long seconds) {
    char path[512], text[32];
    lw_process_find(path, sizeof path, "libfault_shim.so");
    snprintf(text, sizeof text, "%ld", seconds);
    setenv("LD_PRELOAD", path, 1);
    setenv("FAULT_PROGRAM", "lightwell-relay", 1);
    setenv("FAULT_CLOCK", text, 1);
    lw_relays_start(&relay[0], at(&server), "");
    unsetenv("LD_PRELOAD");
}

static bool relay_is_lost(void) { return lw_relays_figure(&relay[0], "lightwell_upstream_lost_seconds") > 0; }

/* The age of light is counted from when the relay lost the server above, by a clock that nobody sets. */
static void a_wall_clock_apart_is_not_felt(void **state) {
    (void)state;
    if (LW_SANITIZER) skip(); /* the shim is loaded before its library */
    for (int ahead = 0; ahead < 2; ahead++) {
        const struct lw_scene_change hide = {.kind = LW_SCENE_CHANGE_OBJECT_HIDE, .target = 5};
        struct lw_client_answer answer;
        lw_process_serve(&server, LW_RELAYS_CORNELL);
        start_with_jump(ahead ? DAY_S : -DAY_S);
        lw_relays_join(0, server.port);
        lw_relays_join_with(1, relay[0].port, (struct lw_client_desc){.control = true});
        lw_relays_rest(&server);
        assert_true(lw_relays_figure(&relay[0], "lightwell_upstream_lost_seconds") == 0);
        lw_relays_await_in_tree(&server, 2, "127.0.0.1", relay[0].port, 1);
        lw_relays_update(1, &hide, &answer);
        assert_int_equal(answer.code, LW_SCENE_CHANGE_OK);
        lw_relays_rest(&server);
        lw_client_destroy(lw_relays_client[0]);
        lw_relays_client[0] = NULL;
        kill_it(&server);
        lw_relays_wait(relay_is_lost); /* light of before is not shown as current */
        assert_true(lw_relays_figure(&relay[0], "lightwell_upstream_lost_seconds") < DAY_S / 2);
        end_all(NULL);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(lightwellctl_works_through_a_relay, end_all),
        cmocka_unit_test_teardown(packages_are_downloaded_once, end_all),
        cmocka_unit_test_teardown(servers_above_light_different_scenes, end_all),
        cmocka_unit_test_teardown(a_chain_of_relays_has_an_end, end_all),
        cmocka_unit_test_teardown(a_wall_clock_apart_is_not_felt, end_all),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
