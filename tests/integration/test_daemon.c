/* The real lightwelld, with clients of liblightwell: one solve serves all, and scenes move frame by frame. */
#include "tests/integration/daemon_case.h"
#include "tests/support/client_light.h"

#include "common/base/clock.h"
#include "common/base/log.h"
#include "common/scene/pose.h"

#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define SETTLED_LINES 10
#define PONGS_BYTES   100 /* answers to pings that may come in between; the smallest tile is larger */
#define MOVING        "--texels-per-metre 8 --clock step --json --light whole " /* behind its file's name */
#define ATRIUM        "builtin:atrium-matt --texels-per-metre 0.5 --clock step --json --light whole "
#define CITY          "builtin:city:1 --texels-per-metre 0.3 --clock step --json "

/* ---- what the daemon prints ---- */

/* The daemon's lines so far. The last one may be a half: it does not count. */
struct report {
    char *text;
    unsigned lines;
    const char **line;
};

static struct report read_report(const struct lw_process *daemon) {
    struct report report = {.text = lw_process_out(daemon)};
    unsigned capacity = 1;
    for (const char *c = report.text; *c; c++) capacity += *c == '\n';
    report.line = calloc(capacity, sizeof *report.line);
    assert_non_null(report.line);
    for (char *start = report.text, *end; (end = strchr(start, '\n')); start = end + 1) {
        *end = '\0';
        report.line[report.lines++] = start;
    }
    return report;
}

static void free_report(struct report *report) {
    free(report->line);
    free(report->text);
}

static double sum_of(const struct report *report, const char *key) {
    double sum = 0;
    for (unsigned i = 0; i < report->lines; i++) sum += lw_process_number(report->line[i], key);
    return sum;
}

static double last_of(const struct report *report, const char *key) {
    assert_true(report->lines > 0);
    return lw_process_number(report->line[report->lines - 1], key);
}

/* The number of the first frame that clients got, and how long after the first frame of all it was, s. */
static double first_published(const struct report *report, double *out_after_s) {
    for (unsigned i = 0; i < report->lines; i++) {
        const double frame = lw_process_number(report->line[i], "published");
        *out_after_s = lw_process_number(report->line[i], "time_s") -
                       lw_process_number(report->line[0], "time_s") +
                       1e-3 * lw_process_number(report->line[i], "frame_ms");
        if (frame > 0) return frame;
    }
    return 0;
}

/* ---- clients ---- */

/* Whether the daemon's last lines say that nothing is solved any more and that
 * all that was sent is `tiles`. */
static bool is_settled(const struct lw_process *daemon, uint64_t tiles) {
    struct report report = read_report(daemon);
    bool settled = report.lines >= SETTLED_LINES;
    for (unsigned i = 0; settled && i < SETTLED_LINES; i++) {
        const char *line = report.line[report.lines - 1 - i];
        settled = lw_process_number(line, "tiles_solved") == 0 &&
                  lw_process_number(line, "tiles_sent") == (double)tiles;
    }
    free_report(&report);
    return settled;
}

/* Until the daemon's light has converged and the clients from number `first` on, all that it
 * has, have all that it sent. */
static void await_all_light(const struct lw_process *daemon, unsigned first) {
    for (uint64_t deadline_ns = daemon_case_limit_ns();;) {
        uint64_t tiles = 0;
        for (unsigned i = first; i < daemon_case_viewers.count; i++) {
            assert_false(daemon_case_viewers.closed[i]);
            tiles += daemon_case_stats_of(daemon_case_viewers.client[i]).tiles;
        }
        if (tiles && is_settled(daemon, tiles)) return;
        if (lw_clock_ns() > deadline_ns) fail_msg("not converged within %u s", LIMIT_S);
        daemon_case_poll_all();
    }
}

static bool same_tiles(const struct lw_client *a, const struct lw_client *b) {
    const struct lw_atlas_map *map = lw_client_atlas_map(a);
    assert_int_equal(map->tile_count, lw_client_atlas_map(b)->tile_count);
    for (uint32_t i = 0; i < map->tile_count; i++) {
        struct lw_client_tile of_a = lw_client_get_tile(a, (lw_tile_id){i}),
                              of_b = lw_client_get_tile(b, (lw_tile_id){i});
        if (of_a.version != of_b.version || of_a.bounces != of_b.bounces || of_a.error != of_b.error)
            return false;
    }
    return true;
}

static bool same_light(const struct lw_client *a, const struct lw_client *b) {
    const struct lw_atlas_map *map = lw_client_atlas_map(a);
    for (uint32_t o = 0; o < map->object_count; o++)
        for (uint32_t l = 0; l < map->atlas[o]->level_count; l++) {
            struct lw_client_level of_a = lw_client_get_level(a, o, l), of_b = lw_client_get_level(b, o, l);
            assert_true(of_a.width > 0 && of_a.width == of_b.width && of_a.height == of_b.height);
            if (memcmp(of_a.rgb, of_b.rgb, sizeof(float) * 3 * of_a.width * of_a.height) != 0) return false;
        }
    return true;
}

/* ---- one solve for all ---- */

struct total {
    double rays, tiles_encoded;
};

/* All clients are there before the first frame. */
static struct total run_forty_frames(unsigned clients) {
    struct lw_process daemon;
    unsigned first = daemon_case_viewers.count;
    lw_process_serve_by_hand(&daemon,
                             "builtin:cornell --texels-per-metre 8 --json --light whole --error 1e-6 "
                             "--direct-samples 2 --indirect-samples 8 --frames 40");
    for (unsigned i = 0; i < clients; i++) daemon_case_join(&daemon);
    for (unsigned i = first; i < daemon_case_viewers.count; i++)
        for (uint64_t end_ns = daemon_case_limit_ns(); !lw_client_scene(daemon_case_viewers.client[i]);) {
            assert_int_equal(daemon_case_poll_all(), clients);
            assert_true(lw_clock_ns() < end_ns);
        }
    lw_process_step(&daemon, 40);
    for (uint64_t deadline_ns = daemon_case_limit_ns(); daemon_case_poll_all() > 0;)
        assert_true(lw_clock_ns() < deadline_ns);
    assert_int_equal(lw_process_finish(&daemon, LIMIT_S), 0);
    struct report report = read_report(&daemon);
    assert_int_equal(report.lines, 40);
    assert_int_equal(last_of(&report, "sessions"), clients);
    for (unsigned i = first; i < daemon_case_viewers.count; i++)
        assert_true(daemon_case_is_complete(daemon_case_viewers.client[i]));
    struct total total = {last_of(&report, "rays_total"), sum_of(&report, "tiles_encoded")};
    free_report(&report);
    return total;
}

static void one_solve_serves_all(void **state) {
    (void)state;
    struct total alone = run_forty_frames(1), together = run_forty_frames(32);
    assert_true(alone.rays > 1e5 && alone.tiles_encoded > 40);
    assert_true(alone.rays == together.rays);
    assert_true(alone.tiles_encoded == together.tiles_encoded);
}

/* Runs until the scene has converged and `clients` clients have it all; returns all rays traced. */
static double run_to_rest(const char *arguments, unsigned clients) {
    struct lw_process daemon;
    unsigned first = daemon_case_viewers.count;
    lw_process_serve(&daemon, arguments);
    for (unsigned i = 0; i < clients; i++) daemon_case_join(&daemon);
    await_all_light(&daemon, first);
    struct report report = read_report(&daemon);
    double rays = last_of(&report, "rays_total");
    free_report(&report);
    daemon_case_stop(&daemon);
    return rays;
}

static void all_see_the_same(void **state) {
    (void)state;
    double alone = run_to_rest(CONVERGES, 1), together = run_to_rest(CONVERGES, 32);
    assert_true(alone > 0 && alone == together);
    for (unsigned i = 0; i < daemon_case_viewers.count; i++) {
        assert_true(daemon_case_is_complete(daemon_case_viewers.client[i]));
        assert_true(same_tiles(daemon_case_viewers.client[0], daemon_case_viewers.client[i]));
        assert_true(same_light(daemon_case_viewers.client[0], daemon_case_viewers.client[i]));
    }
}

static void threads_change_nothing_and_seeds_do(void **state) {
    (void)state;
    const char *common = CONVERGES "--tracing-range 1 --texels-per-metre 12 --seed 7 --threads ";
    char one[512], two[512];
    snprintf(one, sizeof one, "%s 1", common);
    snprintf(two, sizeof two, "%s 2", common);
    double rays_one = run_to_rest(one, 1), rays_two = run_to_rest(two, 1);
    assert_true(rays_one == rays_two);
    assert_true(same_tiles(daemon_case_viewers.client[0], daemon_case_viewers.client[1]));
    assert_true(same_light(daemon_case_viewers.client[0], daemon_case_viewers.client[1]));
    run_to_rest(CONVERGES "--tracing-range 1 --texels-per-metre 12 --seed 8", 1);
    assert_false(same_light(daemon_case_viewers.client[0], daemon_case_viewers.client[2]));
}

/* ---- converged ---- */

static void converged_light_costs_nothing(void **state) {
    (void)state;
    struct lw_process daemon;
    lw_process_serve(&daemon, CONVERGES "--frame-rate 60");
    struct lw_client *early = daemon_case_join(&daemon);
    await_all_light(&daemon, 0);
    struct lw_client_stats before = daemon_case_stats_of(early);
    const uint64_t began_ns = lw_clock_ns();
    struct report report = read_report(&daemon);
    unsigned lines = report.lines;
    double rays = last_of(&report, "rays_total"), tiles = last_of(&report, "tiles_sent"),
           bytes = last_of(&report, "bytes_sent");
    free_report(&report);
    for (const double frame = lw_process_newest(&daemon, "frame");
         lw_process_newest(&daemon, "frame") < frame + 10;) /* it goes on ... */
        daemon_case_poll_all();
    report = read_report(&daemon);
    const double elapsed_s = (double)(lw_clock_ns() - began_ns) * 1e-9;
    /* ... at the frame rate, not as fast as it can: frames are as far apart as that or farther */
    if (report.lines > lines + 2 + 60 * elapsed_s)
        fail_msg("%u frames in %.2f s", report.lines - lines, elapsed_s);
    for (unsigned i = lines; i < report.lines; i++) {
        assert_true(lw_process_number(report.line[i], "rays_total") == rays);
        assert_true(lw_process_number(report.line[i], "tiles_sent") == tiles);
        assert_true(lw_process_number(report.line[i], "bytes_sent") < bytes + PONGS_BYTES);
        assert_true(lw_process_number(report.line[i], "tiles_encoded") == 0);
    }
    assert_true(daemon_case_stats_of(early).bytes < before.bytes + PONGS_BYTES &&
                daemon_case_stats_of(early).tiles == before.tiles);
    free_report(&report);
    /* a late client gets the same */
    struct lw_client *late = daemon_case_join(&daemon);
    daemon_case_wait_complete(late);
    await_all_light(&daemon, 0);
    assert_true(same_tiles(early, late) && same_light(early, late));
    report = read_report(&daemon);
    assert_true(last_of(&report, "rays_total") == rays);
    free_report(&report);
    daemon_case_stop(&daemon);
}

/* ---- moving scenes ---- */

/* A client's transforms are those of its scene at the time of its newest frame. */
static void check_pose(const struct lw_client *client, struct lw_pose *pose) {
    const struct lw_scene *scene = lw_client_scene(client);
    lw_pose_evaluate(pose, scene, daemon_case_stats_of(client).time_s);
    for (uint32_t o = 0; o < scene->object_count; o++)
        assert_memory_equal(lw_client_object_to_world(client, o), &pose->object_to_world[o],
                            sizeof(struct lw_affine));
}

/* Waits until a client has heard of `count` more frames; checks each that it sees.
 * Returns how often something moved. */
static unsigned watch_frames(const struct lw_client *client, unsigned count, double step_s, double start_s) {
    struct lw_pose pose = {0};
    struct lw_affine *before = NULL;
    unsigned seen = 0, moved = 0;
    uint64_t frame = 0;
    for (uint64_t deadline_ns = daemon_case_limit_ns(); seen < count;) {
        assert_int_equal(daemon_case_poll_all(), daemon_case_viewers.count);
        if (lw_clock_ns() > deadline_ns) fail_msg("%u frames within %u s", seen, LIMIT_S);
        struct lw_client_stats stats = daemon_case_stats_of(client);
        if (stats.frame == frame) continue;
        frame = stats.frame;
        seen++;
        if (fabs(stats.time_s - start_s - (double)(frame - 1) * step_s) > 1e-9)
            fail_msg("frame %llu at %f s", (unsigned long long)frame, stats.time_s);
        const struct lw_scene *scene = lw_client_scene(client);
        size_t size = scene->object_count * sizeof *before;
        if (!before) {
            lw_support_ok(lw_pose_init(&pose, scene), NULL);
            assert_non_null(before = malloc(size));
        } else {
            moved += memcmp(before, lw_client_object_to_world(client, 0), size) != 0;
        }
        memcpy(before, lw_client_object_to_world(client, 0), size);
        check_pose(client, &pose);
    }
    free(before);
    lw_pose_finish(&pose);
    return moved;
}

/* A room where a box and a lamp move. */
static void serve_moving(struct lw_process *daemon, const char *more) {
    char arguments[512];
    snprintf(arguments, sizeof arguments, "%s " MOVING "%s", lw_support_source("tests/support/moving.gltf"),
             more);
    lw_process_serve(daemon, arguments);
}

/* The first picture is that of three frames, or of as many as there are a second and a half after the first;
 * where there will be no more, of those that there are. */
static void the_first_light_has_several_frames(void **state) {
    (void)state;
    static const struct {
        const char *options;
        double frame;
    } light[] = {{"--prepare 1000", 3}, {"--light whole", 3}, {"--frames 2", 2}, {"--prepare 0", 1}};
    for (size_t i = 0; i < sizeof light / sizeof *light; i++) {
        struct lw_process daemon;
        char arguments[128];
        snprintf(arguments, sizeof arguments,
                 "builtin:cornell --texels-per-metre 8 --json --frame-budget-ms inf %s", light[i].options);
        lw_process_serve(&daemon, arguments);
        if (light[i].frame != 2) lw_process_await_frames(&daemon, 4);
        if (light[i].frame == 2)
            assert_int_equal(lw_process_finish(&daemon, LIMIT_S), 0);
        else
            daemon_case_stop(&daemon);
        struct report report = read_report(&daemon);
        double after_s;
        const double frame = first_published(&report, &after_s);
        if (!(frame == light[i].frame || (frame > 0 && frame < light[i].frame && after_s > 1.2)))
            fail_msg("%s: frame %g, after %g s", light[i].options, frame, after_s);
        free_report(&report);
    }
}

static void expect_frame_by_frame(struct lw_process *daemon) {
    struct lw_client *client = daemon_case_join(daemon);
    assert_int_equal(watch_frames(client, 10, 1.0 / 30, 0), 9);
    daemon_case_wait_complete(client);
    daemon_case_stop(daemon);
    struct report report = read_report(daemon);
    assert_true(report.lines >= 10);
    for (unsigned i = 0; i < report.lines; i++)
        assert_true(lw_process_number(report.line[i], "frame") == i + 1);
    free_report(&report);
}

static void a_scene_moves_frame_by_frame(void **state) {
    (void)state;
    struct lw_process daemon;
    serve_moving(&daemon, "");
    expect_frame_by_frame(&daemon);
}

static void the_atrium_moves_frame_by_frame(void **state) {
    (void)state;
    struct lw_process daemon;
    lw_process_serve(&daemon, ATRIUM);
    expect_frame_by_frame(&daemon);
}

/* Hundreds of objects, thousands of emitters, two spots that drive. */
static void the_city_moves_frame_by_frame(void **state) {
    (void)state;
    struct lw_process daemon;
    lw_process_serve(&daemon, CITY);
    struct lw_client *client = daemon_case_join(&daemon);
    assert_int_equal(watch_frames(client, 3, 1.0 / 30, 0), 2);
    daemon_case_wait_complete(client);
    assert_true(client_light_total(client) > 0);
    daemon_case_stop(&daemon);
}

static void a_frozen_scene_holds_still(void **state) {
    (void)state;
    struct lw_process daemon;
    serve_moving(&daemon, "--freeze 1.5 --error 1e-6");
    struct lw_client *client = daemon_case_join(&daemon);
    assert_int_equal(watch_frames(client, 5, 0, 1.5), 0);
    daemon_case_stop(&daemon);
}

/* ---- ways to solve ---- */

static double light_with(const char *options, unsigned bounces) {
    struct lw_process daemon;
    char arguments[256];
    snprintf(arguments, sizeof arguments, CORNELL "--error 0.15 --frame-rate 300 %s", options);
    lw_process_serve(&daemon, arguments);
    struct lw_client *client = daemon_case_join(&daemon);
    await_all_light(&daemon, daemon_case_viewers.count - 1);
    assert_true(daemon_case_is_complete(client));
    assert_int_equal(daemon_case_stats_of(client).bounces, bounces);
    daemon_case_stop(&daemon);
    struct report report = read_report(&daemon);
    bool asks_probes = strstr(options, "--tracing-range 1") != NULL, bounces_at_all = bounces > 0;
    assert_int_equal(sum_of(&report, "rays_probe") > 0, asks_probes);
    assert_int_equal(sum_of(&report, "rays_bounce") > 0, bounces_at_all);
    free_report(&report);
    return client_light_total(client);
}

static void every_way_to_solve_serves(void **state) {
    (void)state;
    double traced = light_with("--tracing-range inf", 2), probed = light_with("--tracing-range 1", 2),
           direct = light_with("--bounces 0", 0), once = light_with("--bounces 1", 1);
    assert_true(direct > 0 && direct < 0.9 * once && once < 0.98 * traced);
    if (probed < 0.8 * traced || probed > 1.2 * traced)
        fail_msg("%g with probes, %g without", probed, traced);
}

/* ---- beside other programs ---- */

/* Whether a file of a process in /proc holds `text`. */
static bool proc_holds(const struct lw_process *process, const char *file, const char *text) {
    char path[64], content[65536];
    snprintf(path, sizeof path, "/proc/%d/%s", (int)process->pid, file);
    const int fd = open(path, O_RDONLY | O_CLOEXEC);
    assert_true(fd >= 0);
    size_t length = 0;
    for (ssize_t got; (got = read(fd, content + length, sizeof content - length)) > 0;) length += (size_t)got;
    close(fd);
    return memmem(content, length, text, strlen(text)) != NULL;
}

static void expect_waiting(const char *policy, const char *expected) {
    struct lw_process daemon;
    char variable[64];
    snprintf(variable, sizeof variable, "OMP_WAIT_POLICY=%s", expected);
    assert_int_equal(policy ? setenv("OMP_WAIT_POLICY", policy, 1) : unsetenv("OMP_WAIT_POLICY"), 0);
    lw_process_serve(&daemon, CONVERGES);
    assert_true(proc_holds(&daemon, "environ", variable));
    assert_true(proc_holds(&daemon, "comm", "lightwelld\n"));
    daemon_case_stop(&daemon);
}

static void idle_threads_sleep_unless_set_otherwise(void **state) {
    (void)state;
    const char *was = getenv("OMP_WAIT_POLICY");
    char *kept = was ? strdup(was) : NULL;
    expect_waiting(NULL, "passive");
    expect_waiting("active", "active");
    assert_int_equal(kept ? setenv("OMP_WAIT_POLICY", kept, 1) : unsetenv("OMP_WAIT_POLICY"), 0);
    free(kept);
}

int main(int argc, char **argv) {
    (void)argv;
    lw_log_init("test_daemon", LW_LOG_WARNING);
    const struct CMUnitTest long_tests[] = {
        cmocka_unit_test_teardown(the_atrium_moves_frame_by_frame, daemon_case_end_all),
        cmocka_unit_test_teardown(the_city_moves_frame_by_frame, daemon_case_end_all),
    };
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(the_first_light_has_several_frames, daemon_case_end_all),
        cmocka_unit_test_teardown(one_solve_serves_all, daemon_case_end_all),
        cmocka_unit_test_teardown(all_see_the_same, daemon_case_end_all),
        cmocka_unit_test_teardown(threads_change_nothing_and_seeds_do, daemon_case_end_all),
        cmocka_unit_test_teardown(converged_light_costs_nothing, daemon_case_end_all),
        cmocka_unit_test_teardown(a_scene_moves_frame_by_frame, daemon_case_end_all),
        cmocka_unit_test_teardown(a_frozen_scene_holds_still, daemon_case_end_all),
        cmocka_unit_test_teardown(every_way_to_solve_serves, daemon_case_end_all),
        cmocka_unit_test_teardown(idle_threads_sleep_unless_set_otherwise, daemon_case_end_all),
    };
    return argc > 1 ? cmocka_run_group_tests(long_tests, NULL, NULL)
                    : cmocka_run_group_tests(tests, NULL, NULL);
}
