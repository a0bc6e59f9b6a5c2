/* The real lightwelld at SIGHUP: scene files and options that have changed, while clients look. */
#include "tests/support/process.h"

#include "client/include/lightwell/lightwell.h"
#include "common/base/clock.h"

#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define LIMIT_S LW_PROCESS_LIMIT_S

static struct lw_process daemon_process;
static struct lw_live *live;
static struct lw_live_error err;
static char scene_path[300], config_path[300];

static void write_config(const char *scene, const char *rest) {
    char text[600];
    const int length = snprintf(text, sizeof text, "scene = %s\nhttp = none\n%s", scene, rest);
    lw_support_write_file(config_path, text, (size_t)length);
}

/* What the importer makes of a scene, in the place of the scene file, at once. */
static void make_scene(const char *scene) {
    struct lw_process import;
    char line[900], fresh[320];
    snprintf(fresh, sizeof fresh, "%s.new", scene_path);
    snprintf(line, sizeof line, "%s -o %s --texels-per-metre 8", scene, fresh);
    lw_process_run(&import, "lightwell-import", line, 0);
    assert_int_equal(rename(fresh, scene_path), 0);
}

static int set_up(void **state) {
    (void)state;
    snprintf(scene_path, sizeof scene_path, "%s", lw_support_temporary("scene.lwscene"));
    snprintf(config_path, sizeof config_path, "%s", lw_support_temporary("lightwelld.conf"));
    return 0;
}

static int end_all(void **state) {
    lw_live_close(live);
    live = NULL;
    return lw_process_teardown(state);
}

static void serve(void) {
    char line[400];
    snprintf(line, sizeof line, "--config %s", config_path);
    lw_process_serve(&daemon_process, line);
}

static void open_live(uint32_t flags) {
    struct lw_live_desc desc = {
        .struct_size = sizeof desc, .port = daemon_process.port, .flags = flags, .name = "reload"};
    if (lw_live_open(&desc, &live, &err) != LW_LIVE_OK) fail_msg("%s", err.text);
}

/* The loop turns, and watches for signals, once it has welcomed somebody. */
static void await_loop(void) {
    open_live(LW_LIVE_WANTS_NOTHING);
    lw_live_close(live);
    live = NULL;
}

static void hang_up(void) { assert_int_equal(kill(daemon_process.pid, SIGHUP), 0); }

/* Until it has said a text `times` times on stderr. */
static void await_said(const char *text, unsigned times) {
    lw_process_await_texts(&daemon_process, text, times);
}

static struct lw_live_stats stats(void) {
    struct lw_live_stats s = {.struct_size = sizeof s};
    assert_int_equal(lw_live_get_stats(live, &s, &err), LW_LIVE_OK);
    return s;
}

/* Polls until there is light. Returns the number of objects, and how many times another scene came. */
static uint32_t await_light(unsigned *others) {
    *others = 0;
    for (uint64_t end_ns = lw_clock_ns() + LIMIT_S * 1000000000ull;;) {
        const enum lw_live_status status = lw_live_poll(live, 20, &err);
        if (status == LW_LIVE_OTHER_SCENE)
            ++*others;
        else if (status != LW_LIVE_OK)
            fail_msg("%s", err.text);
        if (lw_clock_ns() > end_ns) fail_msg("no light: %s", lw_process_err(&daemon_process));
        if (stats().has_light) break;
    }
    struct lw_live_scene scene = {.struct_size = sizeof scene};
    assert_int_equal(lw_live_get_scene(live, &scene, &err), LW_LIVE_OK);
    return scene.object_count;
}

/* Returns the number of the session that the client has now. What stats() says is of the last poll, and is
 * between two sessions at times. */
static uint64_t await_session(void) {
    for (uint64_t end_ns = lw_clock_ns() + LIMIT_S * 1000000000ull;;) {
        assert_int_equal(lw_live_poll(live, 20, &err), LW_LIVE_OK);
        if (stats().is_connected) return stats().session;
        assert_true(lw_clock_ns() < end_ns);
    }
}

static void stop(void) {
    lw_process_expect(&daemon_process, lw_process_stop(&daemon_process, SIGTERM, LIMIT_S), 0);
    lw_process_left_nothing();
}

/* A client of the library goes over to the file's new scene. A file that is damaged changes nothing, nor does
 * one that is written again with the same. */
static void test_scene_file(void **state) {
    (void)state;
    unsigned others;
    make_scene("builtin:cornell");
    write_config(scene_path, "light = whole\ncontrol-socket = none\n");
    serve();
    open_live(LW_LIVE_THREAD);
    const uint32_t before = await_light(&others);
    assert_int_equal(others, 0);
    const uint16_t port = daemon_process.port;

    make_scene(lw_support_source("tests/fuzz/corpus/fuzz_gltf/base.gltf"));
    hang_up();
    await_said("clients go over to", 1);
    uint32_t now = before;
    for (uint64_t end_ns = lw_clock_ns() + LIMIT_S * 1000000000ull; others == 0;) {
        assert_true(lw_clock_ns() < end_ns);
        others += lw_live_poll(live, 20, &err) == LW_LIVE_OTHER_SCENE;
    }
    unsigned again;
    now = await_light(&again);
    assert_int_equal(again, 0);
    assert_true(now != before);
    assert_int_equal(daemon_process.port, port);

    const uint64_t session = await_session();
    lw_support_write_file(scene_path, "no package at all", 17);
    hang_up();
    await_said("options and scene stay as they were", 1);
    assert_true(lw_process_runs(&daemon_process));
    assert_int_equal(await_session(), session);

    make_scene(lw_support_source("tests/fuzz/corpus/fuzz_gltf/base.gltf"));
    hang_up();
    await_said("is the same scene as before", 1);
    hang_up();
    await_said("options and scene are as before", 1);
    assert_int_equal(await_session(), session);
    stop();
}

/* Options that can change do, with the control socket there again. Others get a warning. A mistake changes
 * nothing. */
static void test_options(void **state) {
    (void)state;
    unsigned others;
    write_config("builtin:cornell", "texels-per-metre = 8\nlight = whole\n");
    setenv("XDG_RUNTIME_DIR", lw_support_temporary("runtime"), 1);
    serve();
    open_live(LW_LIVE_THREAD);
    const uint32_t objects = await_light(&others);

    write_config("builtin:cornell", "texels-per-metre = 8\nlight = whole\nbounces = 1\njson = true\n");
    hang_up();
    await_said("json is as it was", 1);
    await_said("serving builtin:cornell", 2);
    for (uint64_t end_ns = lw_clock_ns() + LIMIT_S * 1000000000ull; stats().bounces != 1;) {
        assert_true(lw_clock_ns() < end_ns);
        assert_int_equal(lw_live_poll(live, 20, &err), LW_LIVE_OK); /* the scene is the same */
    }
    assert_int_equal(await_light(&others), objects);
    assert_int_equal(others, 0);
    assert_true(stats().session >= 2);

    struct lw_process ctl;
    char line[100];
    snprintf(line, sizeof line, "127.0.0.1:%u light lamp off", daemon_process.port);
    lw_process_start(&ctl, "lightwellctl", line);
    const int code = lw_process_finish(&ctl, LIMIT_S);
    char *said = lw_process_err(&ctl);
    if (code == 77) fail_msg("the control socket is not there again: %s", said);
    free(said);

    const uint64_t session = await_session();
    write_config("builtin:cornell", "texel-per-metre = 8\n");
    hang_up();
    await_said("options and scene stay as they were", 1);
    await_said("unknown key \"texel-per-metre\"", 1);
    write_config("builtin:cornell", "texels-per-metre = 8\nlight = whole\nbounces = 1\njson = true\n"
                                    "log-level = debug\n");
    hang_up();
    await_said("options and scene are as before", 1);
    assert_int_equal(await_session(), session);
    stop();
    unsetenv("XDG_RUNTIME_DIR");
}

static bool is_reading(void *context) {
    return lw_process_child_of(((struct lw_process *)context)->pid) != 0;
}

/* A stop while a large scene is being read, and while one hands over. */
static void test_stop_meanwhile(void **state) {
    (void)state;
    write_config("builtin:cornell", "texels-per-metre = 8\n");
    serve();
    await_loop();
    write_config("builtin:city", "");
    hang_up();
    assert_true(lw_process_await(&daemon_process, is_reading, &daemon_process));
    hang_up(); /* it hears to wait */
    await_said("are being read since the last SIGHUP", 1);
    stop();

    write_config("builtin:cornell", "texels-per-metre = 8\n");
    serve();
    await_loop();
    write_config("builtin:cornell", "texels-per-metre = 9\n");
    hang_up();
    await_said("clients go over to", 1);
    stop();
}

/* A load test that comes back finds another scene: it ends there, and nothing is an error. */
static void test_load_test_ends(void **state) {
    (void)state;
    struct lw_process load;
    char line[200];
    write_config("builtin:cornell", "texels-per-metre = 8\nlight = whole\n");
    serve();
    snprintf(line, sizeof line, "127.0.0.1:%u --users 3 --seconds %d --reconnect --json", daemon_process.port,
             LIMIT_S);
    lw_process_start(&load, "lightwell-load", line);
    await_said("\"lightwell-load\" joined", 3);
    write_config("builtin:cornell", "texels-per-metre = 9\nlight = whole\n");
    hang_up();
    lw_process_expect(&load, lw_process_finish(&load, LIMIT_S), 1);
    char *report = lw_process_out(&load);
    assert_non_null(strstr(report, "\"other_scene\""));
    free(report);
    char *said = lw_process_err(&load);
    if (strstr(said, "--max-errors")) fail_msg("%s", said);
    free(said);
    stop();
}

/* One that comes before the loop watches for it ends nobody. */
static void test_hangup_while_starting(void **state) {
    (void)state;
    write_config("builtin:cornell", "texels-per-metre = 8\n");
    serve(); /* its port is known, and its loop is about to begin */
    for (int i = 0; i < 20; i++) hang_up();
    await_loop();
    stop();
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_scene_file, set_up, end_all),
        cmocka_unit_test_setup_teardown(test_options, set_up, end_all),
        cmocka_unit_test_setup_teardown(test_load_test_ends, set_up, end_all),
        cmocka_unit_test_setup_teardown(test_hangup_while_starting, set_up, end_all),
        cmocka_unit_test_setup_teardown(test_stop_meanwhile, set_up, end_all),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
