/* The real lightwelld, ended and started again with --keep. */
#include "tests/support/client_light.h"
#include "tests/support/process.h"

#include "client/lib/client.h"
#include "common/base/clock.h"
#include "common/base/log.h"
#include "common/base/sanitizer.h"
#include "common/base/vec.h"
#include "common/tile/tile_channels.h"

#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define LIMIT_S LW_PROCESS_LIMIT_S
#define TARGET  0.3f
#define CORNELL                                                                                              \
    "builtin:cornell --texels-per-metre 8 --clock step --json --light whole --error 0.3 --frame-rate 200 "
/* Behind its file's name. */
#define MOVING "--texels-per-metre 8 --clock step --json --light whole --frame-rate 200 "

struct run {
    struct lw_process daemon;
    struct lw_client *client;
};

static const char *folder;   /* the test's */
static bool asks_directions; /* who joins */

static void begin(struct run *run, const char *arguments) {
    char all[512];
    struct lw_error err = {0};
    snprintf(all, sizeof all, "%s --keep %s", arguments, folder);
    lw_process_serve(&run->daemon, all);
    lw_support_ok(
        lw_client_create(
            &(struct lw_client_desc){.host = "127.0.0.1",
                                     .port = run->daemon.port,
                                     .name = "test_keep",
                                     .control = true,
                                     .channel_features = asks_directions ? LW_TILE_CHANNELS_DIRECTION : 0,
                                     .timeout_ms = LIMIT_S * 1000},
            &run->client, &err),
        &err);
}

static void poll_once(struct run *run) {
    struct lw_error err = {0};
    enum lw_status status = lw_client_poll(run->client, 10, &err);
    if (status != LW_OK) lw_support_ok(status, &err);
}

/* Every tile is there, of this frame or a later one: versions are two a frame. */
static bool has_all(const struct lw_client *client, uint64_t frame) {
    const struct lw_atlas_map *map = lw_client_atlas_map(client);
    for (uint32_t i = 0; map && i < map->tile_count; i++)
        if (lw_client_get_tile(client, (lw_tile_id){i}).version < 2 * frame) return false;
    return map != NULL;
}

static float worst_error(const struct lw_client *client) {
    float worst = 0;
    for (uint32_t i = 0; i < lw_client_atlas_map(client)->tile_count; i++)
        worst = fmaxf(worst, lw_client_get_tile(client, (lw_tile_id){i}).error);
    return worst;
}

static float least_error(const struct lw_client *client) {
    float least = INFINITY;
    for (uint32_t i = 0; i < lw_client_atlas_map(client)->tile_count; i++)
        least = fminf(least, lw_client_get_tile(client, (lw_tile_id){i}).error);
    return least;
}

static void wait_for_all(struct run *run) {
    const uint64_t deadline_ns = lw_clock_ns() + LIMIT_S * 1000000000ull;
    while (!has_all(run->client, 1)) {
        poll_once(run);
        if (lw_clock_ns() > deadline_ns) fail_msg("no light within %u s", LIMIT_S);
    }
}

/* Until every tile that the client has counts as converged, and nothing is solved any more. */
static void wait_for_rest(struct run *run) {
    const uint64_t deadline_ns = lw_clock_ns() + LIMIT_S * 1000000000ull;
    wait_for_all(run);
    while (worst_error(run->client) > TARGET || lw_process_newest(&run->daemon, "tiles_solved") > 0) {
        poll_once(run);
        if (lw_clock_ns() > deadline_ns) fail_msg("not converged within %u s", LIMIT_S);
    }
}

/* The client leaves first: a server waits for those that do not take its goodbye. */
static void end(struct run *run) {
    lw_client_destroy(run->client);
    run->client = NULL;
    lw_process_end(&run->daemon);
}

static int choose_folder(void **state) {
    static unsigned number;
    static char path[256];
    char name[32];
    (void)state;
    asks_directions = false;
    snprintf(name, sizeof name, "kept%u", number++);
    snprintf(path, sizeof path, "%s", lw_support_temporary(name));
    folder = path;
    return 0;
}

static int end_all(void **state) {
    (void)state;
    lw_process_kill_all();
    return 0;
}

static void a_converged_scene_costs_no_ray_again(void **state) {
    (void)state;
    struct run run;
    begin(&run, CORNELL);
    wait_for_rest(&run);
    const double light = client_light_total(run.client), frames = lw_process_newest(&run.daemon, "published");
    assert_true(lw_process_newest(&run.daemon, "rays_total") > 1e4);
    end(&run);
    for (int again = 0; again < 2; again++) { /* restored light is kept again */
        begin(&run, CORNELL);
        wait_for_rest(&run);
        while (lw_process_newest(&run.daemon, "frame") < 3) poll_once(&run);
        assert_true(lw_process_said(&run.daemon, "showing frame") &&
                    lw_process_said(&run.daemon, "going on after"));
        assert_true(lw_process_newest(&run.daemon, "rays_total") == 0);
        assert_true(lw_process_newest(&run.daemon, "frame") >
                    frames); /* versions go on, since clients may hold any of them */
        assert_true(fabs(client_light_total(run.client) - light) < 0.01 * light);
        end(&run);
    }
}

/* Sum of directions over the texels of level 0; returns how many have one. */
static uint32_t sum_directions(const struct lw_client *client, struct lw_vec3 *out_sum) {
    uint32_t known = 0;
    *out_sum = lw_vec3(0, 0, 0);
    for (uint32_t o = 0; o < lw_client_atlas_map(client)->object_count; o++) {
        const struct lw_client_level level = lw_client_get_level(client, o, 0);
        for (uint32_t i = 0; level.direction && i < level.width * level.height; i++) {
            const float *r = level.direction + 3 * (size_t)i;
            *out_sum = lw_vec3_add(*out_sum, lw_vec3(r[0], r[1], r[2]));
            known += lw_vec3_length(lw_vec3(r[0], r[1], r[2])) > 0.2f;
        }
    }
    return known;
}

/* Where light comes from is kept with it: no ray is needed to say it again. */
static void directions_are_there_at_once(void **state) {
    (void)state;
    struct run run;
    struct lw_vec3 sum, again;
    asks_directions = true;
    begin(&run, CORNELL "--directional on");
    wait_for_rest(&run);
    const uint32_t known = sum_directions(run.client, &sum);
    assert_true(known > 1000);
    end(&run);
    begin(&run, CORNELL "--directional on");
    const uint64_t deadline_ns = lw_clock_ns() + LIMIT_S * 1000000000ull;
    wait_for_all(&run);
    while (sum_directions(run.client, &again) < known) {
        poll_once(&run);
        if (lw_clock_ns() > deadline_ns) fail_msg("not all directions within %u s", LIMIT_S);
    }
    while (lw_process_newest(&run.daemon, "frame") < 3) poll_once(&run);
    assert_true(lw_process_said(&run.daemon, "showing frame") &&
                lw_process_said(&run.daemon, "going on after"));
    assert_true(lw_process_newest(&run.daemon, "rays_total") == 0);
    assert_true(lw_vec3_length(lw_vec3_sub(again, sum)) < 0.01f * (float)known);
    end(&run);
}

/* What others changed ends with the server. Until there is light of the scene's own, clients see what they
 * saw, and hear that it is not converged. */
static void changed_light_is_no_light_of_the_scene(void **state) {
    (void)state;
    struct run run;
    begin(&run, CORNELL);
    wait_for_rest(&run);
    const double light = client_light_total(run.client);
    end(&run);

    begin(&run, CORNELL);
    wait_for_rest(&run);
    const struct lw_scene_change dark = {.kind = LW_SCENE_CHANGE_MATERIAL_EMISSION, .value_count = 3};
    uint32_t lamp = 0;
    for (uint32_t m = 0; m < lw_client_scene(run.client)->material_count; m++)
        if (lw_client_scene(run.client)->material[m].emission[0] > 0) lamp = m;
    struct lw_scene_change change = dark;
    change.target = lamp;
    struct lw_error err = {0};
    lw_support_ok(lw_client_update(run.client, &change, 1, NULL, &err), &err);
    const uint64_t deadline_ns = lw_clock_ns() + LIMIT_S * 1000000000ull;
    while (client_light_total(run.client) > 0.1 * light) {
        poll_once(&run);
        assert_true(lw_clock_ns() < deadline_ns);
    }
    end(&run);

    begin(&run, CORNELL);
    wait_for_all(&run);
    if (client_light_total(run.client) < 0.1 * light) assert_true(least_error(run.client) >= 2 * TARGET);
    while (!lw_process_said(&run.daemon, "first light")) poll_once(&run);
    wait_for_rest(&run);
    assert_true(fabs(client_light_total(run.client) - light) < 0.01 * light);
    assert_true(lw_process_newest(&run.daemon, "rays_total") ==
                0); /* the sums of before are still there, and are right */
    end(&run);
}

/* ---- changes ---- */

static void expect_done(struct run *run, const struct lw_scene_change *change, size_t count) {
    struct lw_error err = {0};
    struct lw_client_answer answer;
    const uint64_t deadline_ns = lw_clock_ns() + LIMIT_S * 1000000000ull;
    lw_support_ok(lw_client_update(run->client, change, count, NULL, &err), &err);
    while (!lw_client_next_answer(run->client, &answer)) {
        poll_once(run);
        assert_true(lw_clock_ns() < deadline_ns);
    }
    assert_int_equal(answer.code, LW_SCENE_CHANGE_OK);
}

static void kill_it(struct run *run) {
    assert_int_equal(lw_process_stop(&run->daemon, SIGKILL, LIMIT_S), -SIGKILL);
    lw_client_destroy(run->client);
    run->client = NULL;
}

static void wait_for_first_light(struct run *run) {
    while (!lw_process_said(&run->daemon, "first light")) poll_once(run);
    wait_for_rest(run);
}

/* A daemon that is killed right after its answer goes on with the changes that it has answered. A reset takes
 * them back for good. */
static void what_was_answered_outlives_a_kill(void **state) {
    (void)state;
    struct run run;
    begin(&run, CORNELL "--keep-changes");
    wait_for_rest(&run);
    const double light = client_light_total(run.client);
    struct lw_scene_change change[] = {
        {.kind = LW_SCENE_CHANGE_MATERIAL_EMISSION, .value_count = 3},
        {.kind = LW_SCENE_CHANGE_OBJECT_HIDE, .target = 5},
    };
    for (uint32_t m = 0; m < lw_client_scene(run.client)->material_count; m++)
        if (lw_client_scene(run.client)->material[m].emission[0] > 0) change[0].target = m;
    expect_done(&run, change, 2);
    kill_it(&run);

    begin(&run, CORNELL "--keep-changes");
    assert_true(lw_process_said(&run.daemon, "as clients have changed it"));
    wait_for_first_light(&run);
    assert_true(lw_client_object_hidden(run.client, 5));
    assert_true(client_light_total(run.client) < 0.01 * light);
    expect_done(&run, &(struct lw_scene_change){.kind = LW_SCENE_CHANGE_RESET}, 1);
    kill_it(&run);

    begin(&run, CORNELL "--keep-changes");
    wait_for_first_light(&run);
    assert_false(lw_client_object_hidden(run.client, 5));
    assert_true(fabs(client_light_total(run.client) - light) < 0.02 * light);
    expect_done(&run, change, 2);
    end(&run);

    begin(&run, CORNELL); /* without the option the scene is as its file has it */
    wait_for_first_light(&run);
    assert_false(lw_client_object_hidden(run.client, 5));
    end(&run);
    lw_process_refuses("lightwelld", "builtin:cornell --keep-changes", 64, "--keep-changes needs a folder",
                       LIMIT_S);
}

/* ---- motion, options, failures ---- */

static void moving_light_is_shown_until_there_is_more(void **state) {
    (void)state;
    struct run run;
    char moving[300];
    snprintf(moving, sizeof moving, "%s " MOVING, lw_support_source("tests/support/moving.gltf"));
    begin(&run, moving);
    wait_for_all(&run);
    while (lw_process_newest(&run.daemon, "frame") < 3) poll_once(&run);
    end(&run);
    const double last = lw_process_newest(&run.daemon, "frame");
    char path[512];
    snprintf(path, sizeof path, "%s/sums", folder);
    assert_int_equal(access(path, F_OK), -1);

    begin(&run, moving);
    wait_for_all(&run);
    assert_true(lw_process_said(&run.daemon, "showing frame"));
    while (!has_all(run.client, (uint64_t)last + 1)) poll_once(&run); /* all of it is replaced */
    assert_true(lw_process_newest(&run.daemon, "rays_total") > 0);
    end(&run);
}

static void other_options_light_afresh(void **state) {
    (void)state;
    struct run run;
    begin(&run, CORNELL);
    wait_for_rest(&run);
    end(&run);
    begin(&run, CORNELL "--bounces 1");
    wait_for_rest(&run);
    assert_true(lw_process_said(&run.daemon,
                                "of another scene, of other options or of another release; lighting afresh"));
    assert_false(lw_process_said(&run.daemon, "showing frame") || lw_process_said(&run.daemon, "going on"));
    assert_true(lw_process_newest(&run.daemon, "rays_total") > 0);
    end(&run);
}

static void a_folder_that_cannot_be_is_named(void **state) {
    (void)state;
    struct lw_process daemon;
    lw_process_start(&daemon, "lightwelld", "builtin:cornell --listen 127.0.0.1:0 --keep /dev/null/light");
    assert_int_equal(lw_process_finish(&daemon, LIMIT_S), 73);
    assert_true(lw_process_said(&daemon, "--keep: /dev/null/light: cannot make this folder"));
}

/* A frame that takes long does not keep a stop waiting: the light of the last whole one is saved, without
 * sums. How long that is is not waited for. */
static void a_long_frame_is_given_up(void **state) {
    (void)state;
    if (LW_SANITIZER) skip(); /* the shim is loaded before its library */
    struct run run;
    char path[512], shim[512];
    lw_process_find(shim, sizeof shim, "libfault_shim.so");
    setenv("LD_PRELOAD", shim, 1);
    setenv("FAULT_PROGRAM", "lightwelld", 1);
    setenv("FAULT_JOIN", "1", 1);
    begin(&run, "builtin:cornell --texels-per-metre 20 --threads 1 --indirect-samples 512 --light whole "
                "--frame-budget-ms inf --error 1e-6 --frame-rate 1000");
    unsetenv("LD_PRELOAD");
    wait_for_all(&run);
    end(&run);
    assert_true(lw_process_said(&run.daemon, "the frame under way is given up"));
    snprintf(path, sizeof path, "%s/shown", folder);
    assert_int_equal(access(path, F_OK), 0);
    snprintf(path, sizeof path, "%s/sums", folder);
    assert_int_equal(access(path, F_OK), -1);
}

static void two_servers_share_no_folder(void **state) {
    (void)state;
    struct run run;
    char arguments[400], text[300];
    begin(&run, CORNELL);
    snprintf(arguments, sizeof arguments, "builtin:cornell --listen 127.0.0.1:0 --http none --keep %s",
             folder);
    snprintf(text, sizeof text, "--keep: %s: another lightwelld keeps its light in this folder", folder);
    lw_process_refuses("lightwelld", arguments, 69, text, LIMIT_S);
    wait_for_all(&run); /* the first one does not mind */
    lw_client_destroy(run.client);
    assert_int_equal(lw_process_stop(&run.daemon, SIGKILL, LIMIT_S), -SIGKILL);
    begin(&run, CORNELL); /* a lock ends with its process, however that ends */
    end(&run);
}

static void light_that_cannot_be_kept_is_a_failure(void **state) {
    (void)state;
    struct run run;
    begin(&run, CORNELL);
    wait_for_all(&run);
    assert_int_equal(rmdir(folder), 0);
    lw_client_destroy(run.client);
    assert_int_equal(lw_process_stop(&run.daemon, SIGTERM, LIMIT_S), 74);
    assert_true(lw_process_said(&run.daemon, "error: the light is not kept: ") &&
                lw_process_said(&run.daemon, folder));
}

static void unfinished_saves_are_removed(void **state) {
    (void)state;
    static const char *const names[] = {"shown.1-0.tmp", "sums.4194304-12.tmp", "notes.1-0.tmp"};
    struct run run;
    char path[512];
    begin(&run, CORNELL);
    wait_for_all(&run);
    end(&run);
    for (int i = 0; i < 3; i++) {
        snprintf(path, sizeof path, "%s/%s", folder, names[i]);
        lw_support_write_file(path, "half", 4);
    }
    begin(&run, CORNELL);
    assert_true(lw_process_said(&run.daemon, "removed 2 unfinished files"));
    for (int i = 0; i < 3; i++) {
        snprintf(path, sizeof path, "%s/%s", folder, names[i]);
        assert_int_equal(access(path, F_OK), i == 2 ? 0 : -1); /* a file that is not ours stays */
    }
    end(&run);
}

/* Starts it, waits for light, ends it: whether which texels light reaches was known. */
static bool knows_texels(const char *cache, const char *clock) {
    struct lw_process daemon;
    char arguments[512];
    snprintf(arguments, sizeof arguments,
             "builtin:cornell --texels-per-metre 8 --frame-rate 200 --clock %s --cache %s", clock, cache);
    lw_process_serve(&daemon, arguments);
    lw_process_await_text(&daemon, "first light after");
    lw_process_await_text(&daemon, "lie inside or behind other objects");
    lw_process_end(&daemon);
    char *err = lw_process_err(&daemon);
    const bool knows = strstr(err, "known from an earlier start") != NULL;
    free(err);
    return knows;
}

/* Without --keep: the files of --cache. */
static void a_second_start_does_not_look_inside_objects(void **state) {
    char cache[256], command[512];
    (void)state;
    snprintf(cache, sizeof cache, "%s", lw_support_temporary("found/once"));
    assert_false(knows_texels(cache, "step"));
    assert_true(knows_texels(cache, "step"));
    snprintf(command, sizeof command, "for f in %s/*.lwtexels; do echo >>$f; done", cache);
    assert_int_equal(system(command), 0);
    assert_false(knows_texels(cache, "step")); /* looks again, and saves what it finds */
    assert_true(knows_texels(cache, "step"));
    assert_false(knows_texels("/proc/nowhere", "step")); /* cannot save it, and serves */
    assert_false(knows_texels(cache, "real"));           /* has a file of its own */
    assert_true(knows_texels(cache, "real"));
    assert_true(knows_texels(cache, "step"));
}

int main(void) {
    lw_log_init("test_keep", LW_LOG_WARNING);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(a_converged_scene_costs_no_ray_again, choose_folder, end_all),
        cmocka_unit_test_setup_teardown(directions_are_there_at_once, choose_folder, end_all),
        cmocka_unit_test_setup_teardown(changed_light_is_no_light_of_the_scene, choose_folder, end_all),
        cmocka_unit_test_setup_teardown(what_was_answered_outlives_a_kill, choose_folder, end_all),
        cmocka_unit_test_setup_teardown(moving_light_is_shown_until_there_is_more, choose_folder, end_all),
        cmocka_unit_test_setup_teardown(other_options_light_afresh, choose_folder, end_all),
        cmocka_unit_test_setup_teardown(a_folder_that_cannot_be_is_named, choose_folder, end_all),
        cmocka_unit_test_setup_teardown(a_long_frame_is_given_up, choose_folder, end_all),
        cmocka_unit_test_setup_teardown(two_servers_share_no_folder, choose_folder, end_all),
        cmocka_unit_test_setup_teardown(light_that_cannot_be_kept_is_a_failure, choose_folder, end_all),
        cmocka_unit_test_setup_teardown(unfinished_saves_are_removed, choose_folder, end_all),
        cmocka_unit_test_teardown(a_second_start_does_not_look_inside_objects, end_all),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
