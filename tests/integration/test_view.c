/* lightwell-view --headless against a real lightwelld, and --path-trace, both under signals. */
#include "tests/support/process.h"

#include "common/base/clock.h"
#include "common/image/image.h"

#include <arpa/inet.h>
#include <math.h>
#include <netinet/in.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#define VIEW_LIMIT_S LW_PROCESS_LIMIT_S
#define STOP_LIMIT_S LW_PROCESS_LIMIT_S

static struct lw_process server, view;
static char address[64];

static int run_view(const char *arguments) {
    lw_process_start(&view, "lightwell-view", arguments);
    return lw_process_finish(&view, VIEW_LIMIT_S);
}

/* Runs the viewer; it must end with `code` and say `said` in one line on stderr. */
static void view_fails(const char *arguments, int code, const char *said) {
    int got = run_view(arguments);
    char *err = lw_process_err(&view), *out = lw_process_out(&view);
    if (got != code || strstr(err, said) == NULL) fail_msg("\"%s\" ended with %d: %s", arguments, got, err);
    char *line = strstr(err, "error: ");
    assert_non_null(line);
    assert_string_equal(strchr(line, '\n'), "\n"); /* the last thing said, and only one line of it */
    assert_string_equal(out, "");
    free(out);
    free(err);
}

static int start_daemon(void **state) {
    (void)state;
    lw_process_serve(&server, "builtin:cornell --texels-per-metre 8");
    snprintf(address, sizeof address, "127.0.0.1:%u", server.port);
    return 0;
}

static int stop_daemon(void **state) {
    (void)state;
    int code = server.pid ? lw_process_stop(&server, SIGTERM, STOP_LIMIT_S) : 0;
    lw_process_kill_all();
    return code;
}

static double number_of(const char *json, const char *key) {
    char quoted[64];
    snprintf(quoted, sizeof quoted, "\"%s\": ", key);
    const char *at = strstr(json, quoted);
    if (at == NULL) fail_msg("no %s in %s", quoted, json);
    return atof(at + strlen(quoted));
}

/* Returns the mean of the picture's red. */
static double complete_picture(const char *options) {
    char arguments[512];
    snprintf(arguments, sizeof arguments,
             "%s --headless --wait complete --timeout 60 --size 161x90 --json --out %s%s", address,
             lw_support_temporary("view.exr"), options);
    int code = run_view(arguments);
    if (code != 0) fail_msg("ended with %d: %s", code, lw_process_err(&view));
    char *json = lw_process_out(&view);
    assert_non_null(strstr(json, "\"complete\": true"));
    assert_true(number_of(json, "tiles_used") > 0);
    assert_true(number_of(json, "tiles_missing") == 0);
    assert_true(number_of(json, "rays_total") > 0);
    assert_true(number_of(json, "package_ms") <= number_of(json, "first_ms"));
    assert_true(number_of(json, "first_ms") <= number_of(json, "complete_ms"));

    float *rgb;
    uint32_t width, height;
    struct lw_error err = {0};
    lw_support_ok(lw_image_read_exr(lw_support_temporary("view.exr"), &rgb, &width, &height, &err), &err);
    assert_int_equal(width, 161);
    assert_int_equal(height, 90);
    double sum = 0;
    for (size_t i = 0; i < (size_t)width * height * 3; i++) {
        assert_true(isfinite(rgb[i]) && rgb[i] >= 0);
        sum += (double)(i % 3 == 0 ? rgb[i] : 0);
    }
    const char *mean = strstr(json, "\"mean_rgb\": [");
    assert_non_null(mean);
    double reported = atof(strchr(mean, '[') + 1);
    assert_true(reported > 0 && fabs(sum / (width * height) - reported) < 1e-6 * reported);
    free(rgb);
    free(json);
    return reported;
}

static void test_complete_picture(void **state) {
    (void)state;
    complete_picture("");
}

/* By OpenGL the same, but for what the light has changed meanwhile; without OpenGL one line. */
static void test_gl(void **state) {
    (void)state;
    char arguments[256];
    snprintf(arguments, sizeof arguments, "%s --headless --renderer gl --json", address);
    setenv("__EGL_VENDOR_LIBRARY_DIRS", "/nowhere", 1);
    view_fails(arguments, 69, "--renderer gl: ");
    unsetenv("__EGL_VENDOR_LIBRARY_DIRS");
    const double by_rays = complete_picture(" --direct tiles"), by_gl = complete_picture(" --renderer gl");
    assert_true(lw_process_said(&view, "drawn by "));
    assert_true(fabs(by_rays - by_gl) < 0.1 * by_rays);
}

/* The default waits until little error is to be seen, and takes the mean of 16 places of each pixel. */
static void test_good_picture(void **state) {
    (void)state;
    char arguments[512];
    snprintf(arguments, sizeof arguments, "%s --headless --timeout 60 --size 161x90 --json --out %s", address,
             lw_support_temporary("good.exr"));
    int code = run_view(arguments);
    if (code != 0) fail_msg("ended with %d: %s", code, lw_process_err(&view));
    char *json = lw_process_out(&view);
    assert_non_null(strstr(json, "\"complete\": true"));
    assert_non_null(strstr(json, "\"good\": true"));
    assert_true(number_of(json, "shown_error") <= number_of(json, "good_error"));
    assert_true(number_of(json, "samples_per_pixel") == 16);
    free(json);
}

static void test_png(void **state) {
    (void)state;
    char arguments[512];
    snprintf(arguments, sizeof arguments,
             "%s --headless --wait first --timeout 60 --size 16x16 --tonemap aces --exposure 1 --out %s",
             address, lw_support_temporary("view.png"));
    assert_int_equal(run_view(arguments), 0);
    size_t size;
    uint8_t *png = lw_support_read_file(lw_support_temporary("view.png"), &size);
    char *out = lw_process_out(&view);
    assert_true(size > 8);
    assert_memory_equal(png, "\x89PNG\r\n\x1a\n", 8);
    assert_string_equal(out, ""); /* data only where asked for */
    free(out);
    free(png);
}

/* A wait that takes too long fails, and what there is by then is written. */
static void test_late(void **state) {
    (void)state;
    char arguments[512];
    struct lw_process slow;
    lw_process_serve(&slow, "builtin:cornell --texels-per-metre 8 --error 0.001 --frame-rate 2");
    const char *path = lw_support_temporary("late.png");
    snprintf(arguments, sizeof arguments,
             "127.0.0.1:%u --headless --wait converged --timeout 4 --size 64x36 --out %s", slow.port, path);
    assert_int_equal(run_view(arguments), 75);
    char *err = lw_process_err(&view);
    if (!strstr(err, "written as it is") || !strstr(err, "has not converged after 4 s")) fail_msg("%s", err);
    free(err);
    size_t size;
    uint8_t *png = lw_support_read_file(path, &size);
    assert_memory_equal(png, "\x89PNG\r\n\x1a\n", 8);
    free(png);
    snprintf(arguments, sizeof arguments,
             "127.0.0.1:%u --headless --wait good --timeout 0.2 --size 64x36 --json", slow.port);
    const int good = run_view(arguments);
    err = lw_process_err(&view);
    if (good != 0 && (good != 75 || !strstr(err, "(--timeout)"))) fail_msg("%d: %s", good, err);
    free(err);
    lw_process_end(&slow);
}

/* A server before its first light, held there by its clock: the wait says what it does. */
static void test_before_the_first_light(void **state) {
    (void)state;
    char arguments[512], png[256];
    struct lw_process held, waiting;
    lw_process_serve_by_hand(&held, "builtin:cornell --texels-per-metre 8 --light whole");
    snprintf(png, sizeof png, "%s", lw_support_temporary("first.png"));
    snprintf(arguments, sizeof arguments, "127.0.0.1:%u --headless --wait first --size 64x36 --out %s",
             held.port, png);
    lw_process_start(&waiting, "lightwell-view", arguments);
    lw_process_await_text(&waiting, "lightwell-view: looking inside objects: 100 %");
    snprintf(arguments, sizeof arguments,
             "127.0.0.1:%u --headless --wait first --size 64x36 --timeout 3 --out %s", held.port, png);
    assert_int_equal(run_view(arguments), 75);
    char *err = lw_process_err(&view);
    if (!strstr(err, "the scene has not arrived") && /* on a busy machine */
        !strstr(err, "no light within 3 s, the server is at: looking inside objects, 100 % (--timeout)"))
        fail_msg("%s", err);
    free(err);
    lw_process_step(&held, 1);
    assert_int_equal(lw_process_finish(&waiting, LW_PROCESS_LIMIT_S), 0);
    assert_int_equal(access(png, F_OK), 0);
    lw_process_end(&held);
}

static void test_failures(void **state) {
    (void)state;
    char arguments[512];
    snprintf(arguments, sizeof arguments, "%s --headless --json --camera-name nobody", address);
    view_fails(arguments, 64, "no camera \"nobody\"");
    /* before anybody is asked: there is no server */
    view_fails("127.0.0.1:1 --headless --wait first --out /nowhere/view.png", 73,
               "--out: /nowhere/view.png: there is no folder /nowhere");
    snprintf(arguments, sizeof arguments, "127.0.0.1:1 --headless --out %s",
             lw_support_temporary("folder.png"));
    assert_int_equal(mkdir(lw_support_temporary("folder.png"), 0700), 0);
    view_fails(arguments, 73, "is a folder");
    view_fails("room.glb --headless --json", 66, "cannot open \"room.glb\"");
    view_fails("builtin:city", 69, "no display: use --headless"); /* before it is imported */
    view_fails("builtin:cornell --headless --out /nowhere/view.png", 73, "there is no folder /nowhere");
    view_fails("127.0.0.1:1 --headless --json", 69, "127.0.0.1:1");
    view_fails(address, 69, "no display: use --headless");
}

/* A scene in place of an address: a server of the viewer's own, which ends with it. */
static void test_own_server(void **state) {
    (void)state;
    char arguments[512];
    snprintf(arguments, sizeof arguments,
             "builtin:cornell --headless --wait first --size 64x36 --json --out %s",
             lw_support_temporary("own.png"));
    const int code = run_view(arguments);
    char *err = lw_process_err(&view), *json = lw_process_out(&view);
    if (code != 0) fail_msg("ended with %d: %s", code, err);
    assert_non_null(strstr(err, "lightwelld: serving builtin:cornell"));
    assert_non_null(strstr(err, "lightwelld: stopped"));
    assert_true(number_of(json, "tiles_used") > 0);
    assert_int_equal(json[0], '{'); /* the server says nothing there */
    free(json);
    free(err);
}

static void write_square(const char *path) {
    static const char text[] = "v 0 0 0\nv 1 0 0\nv 1 0 -1\nv 0 0 -1\nf 1 2 3 4\n";
    lw_support_write_file(path, text, sizeof text - 1);
}

/* A scene in which nothing shines has a plain sky; options say how its server opens it. */
static void test_own_server_without_light(void **state) {
    (void)state;
    char arguments[512], scene[256];
    snprintf(scene, sizeof scene, "%s", lw_support_temporary("dark.obj"));
    write_square(scene);
    static const double sky[] = {1, 3};
    for (int i = 0; i < 2; i++) {
        snprintf(arguments, sizeof arguments,
                 "%s --headless --wait complete --size 32x18 --json --camera 0.5,1,-0.5:0.5,0,-0.5001:30%s",
                 scene, i ? " --sky 3,3,3 --texels-per-metre 9" : "");
        const int code = run_view(arguments);
        char *err = lw_process_err(&view), *json = lw_process_out(&view);
        if (code != 0) fail_msg("ended with %d: %s", code, err);
        assert_true((strstr(err, "nothing shines in it: lit by a plain sky") != NULL) == (i == 0));
        /* a square under an even sky L is as bright as its albedo, 0.8 or so, times that */
        const double red = atof(strchr(strstr(json, "\"mean_rgb\""), '[') + 1);
        if (!(red > 0.4 * sky[i] && red < sky[i])) fail_msg("%g: %s", red, json);
        free(json);
        free(err);
    }
}

/* ---- signals ---- */

/* Whether a process has a handler for SIGINT by now. */
static bool takes_signals(void *context) {
    const pid_t pid = ((struct lw_process *)context)->pid;
    char path[64], line[256];
    unsigned long long caught = 0;
    snprintf(path, sizeof path, "/proc/%d/status", (int)pid);
    FILE *file = fopen(path, "r");
    assert_non_null(file);
    while (fgets(line, sizeof line, file))
        if (sscanf(line, "SigCgt: %llx", &caught) == 1) break;
    fclose(file);
    return caught >> (SIGINT - 1) & 1;
}

/* Stops it by a signal; it must answer, and end with the code of those that were stopped. */
static void stop_view(int signal_number, const char *answer) {
    int code = lw_process_stop(&view, signal_number, STOP_LIMIT_S);
    char *err = lw_process_err(&view);
    if (code != 75 || !strstr(err, answer)) fail_msg("ended with %d: %s", code, err);
    free(err);
}

static void expect_png(const char *path) {
    size_t size;
    uint8_t *bytes = lw_support_read_file(path, &size);
    assert_true(size > 8);
    assert_memory_equal(bytes, "\x89PNG\r\n\x1a\n", 8);
    free(bytes);
}

static void test_a_wait_that_is_stopped_writes_what_there_is(void **state) {
    (void)state;
    char arguments[512], png[256];
    snprintf(png, sizeof png, "%s", lw_support_temporary("waited.png"));
    snprintf(arguments, sizeof arguments, "%s --headless --size 64x64 --wait seconds:1000 --json --out %s",
             address, png);
    lw_process_start(&view, "lightwell-view", arguments);
    lw_process_await_text(&view, "tiles received: ");
    stop_view(SIGINT, "stopping: writing what there is");
    char *json = lw_process_out(&view), *err = lw_process_err(&view);
    assert_non_null(strstr(json, "\"stopped\": true"));
    assert_true(number_of(json, "tiles_used") > number_of(json, "tiles_missing"));
    /* a line counts missing tiles, unless nothing is missing */
    assert_true((strstr(err, "warning: stopped: of ") != NULL) !=
                (strstr(json, "\"complete\": true") != NULL));
    assert_null(strstr(err, "done in"));
    expect_png(png);
    free(err);
    free(json);
}

/* Somebody who takes the connection and never says a word. */
static void test_a_wait_in_the_dark_that_is_stopped_writes_nothing(void **state) {
    (void)state;
    struct sockaddr_in name = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    socklen_t size = sizeof name;
    int listening = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    assert_int_equal(bind(listening, (struct sockaddr *)&name, sizeof name), 0);
    assert_int_equal(listen(listening, 1), 0);
    assert_int_equal(getsockname(listening, (struct sockaddr *)&name, &size), 0);
    char arguments[512], png[256];
    snprintf(png, sizeof png, "%s", lw_support_temporary("dark.png"));
    snprintf(arguments, sizeof arguments, "%u --headless --out %s", ntohs(name.sin_port), png);
    lw_process_start(&view, "lightwell-view", arguments);
    struct pollfd waiting = {.fd = listening, .events = POLLIN};
    assert_int_equal(poll(&waiting, 1, VIEW_LIMIT_S * 1000), 1);
    stop_view(SIGTERM, "stopped before there was light; nothing is written");
    assert_int_not_equal(access(png, F_OK), 0);
    close(listening);
}

/* ---- --path-trace, which asks no server ---- */

static void path_trace_by(const char *guide) {
    char arguments[512], exr[256];
    snprintf(exr, sizeof exr, "%s", lw_support_temporary("path.exr"));
    uint8_t *bytes[2];
    size_t size[2];
    for (int i = 0; i < 2; i++) {
        snprintf(
            arguments, sizeof arguments,
            "--path-trace builtin:cornell --size 61x40 --spp 7 --bounces 1 --threads %d --guide %s --json "
            "--out %s",
            i + 1, guide, exr);
        int code = run_view(arguments);
        if (code != 0) fail_msg("ended with %d: %s", code, lw_process_err(&view));
        bytes[i] = lw_support_read_file(exr, &size[i]);
    }
    assert_true(size[0] == size[1]);
    assert_memory_equal(bytes[0], bytes[1], size[0]);
    char *json = lw_process_out(&view);
    assert_true(number_of(json, "samples") == 7);
    assert_true(number_of(json, "paths") == 61 * 40 * 7);
    assert_true(number_of(json, "rays_primary") == 61 * 40 * 7);
    assert_true(number_of(json, "rays_shadow") > 0 && number_of(json, "rays_bounce") > 0);
    assert_true(number_of(json, "error") > 0 && number_of(json, "cpu_seconds") > 0);
    assert_non_null(strstr(json, "\"stopped\": false"));
    char said[64];
    snprintf(said, sizeof said, "\"guide\": \"%s\"", guide);
    assert_non_null(strstr(json, said));

    float *rgb;
    uint32_t width, height;
    struct lw_error err = {0};
    lw_support_ok(lw_image_read_exr(exr, &rgb, &width, &height, &err), &err);
    double sum = 0;
    for (size_t i = 0; i < 61 * 40; i++) sum += (double)rgb[3 * i];
    const char *mean = strstr(json, "\"mean_rgb\": [");
    assert_non_null(mean);
    double reported = atof(strchr(mean, '[') + 1);
    assert_true(width == 61 && height == 40 && reported > 0);
    assert_true(fabs(sum / (61 * 40) - reported) < 1e-6 * reported);
    free(rgb);
    free(json);
    free(bytes[0]);
    free(bytes[1]);
}

static void test_path_trace(void **state) {
    (void)state;
    path_trace_by("off");
    path_trace_by("learned");
}

static void test_path_trace_to_an_error(void **state) {
    (void)state;
    double samples[2];
    for (int i = 0; i < 2; i++) {
        char arguments[256];
        double error = i ? 0.05 : 0.2;
        snprintf(arguments, sizeof arguments, "--path-trace builtin:cornell --size 64x64 --error %g --json",
                 error);
        assert_int_equal(run_view(arguments), 0);
        char *json = lw_process_out(&view);
        assert_true(number_of(json, "error") <= error);
        samples[i] = number_of(json, "samples");
        free(json);
    }
    assert_true(samples[0] >= 16 && samples[1] > samples[0] && samples[1] < 1000);
}

/* A million samples take hours: the first signal ends the tracing, and the picture so far is written. */
static void test_path_trace_is_stopped(void **state) {
    (void)state;
    char arguments[512], png[256];
    snprintf(png, sizeof png, "%s", lw_support_temporary("stopped.png"));
    snprintf(arguments, sizeof arguments,
             "--path-trace builtin:cornell --size 64x64 --spp 1000000 --json --out %s", png);
    lw_process_start(&view, "lightwell-view", arguments);
    lw_process_await_text(&view, "tracing paths: ");
    stop_view(SIGINT, "stopping: writing what has been traced");
    char *json = lw_process_out(&view), *err = lw_process_err(&view);
    assert_non_null(strstr(json, "\"stopped\": true"));
    assert_non_null(strstr(err, "stopped: the picture has"));
    assert_non_null(strstr(err, "tracing paths: stopped at 0 % after"));
    assert_null(strstr(err, "done in"));
    const unsigned samples = (unsigned)number_of(json, "samples");
    assert_true(samples >= 1 && samples < 1000000);
    free(err);
    free(json);

    /* whole samples alone are in it: it is the picture of their number */
    char whole[256];
    snprintf(whole, sizeof whole, "%s", lw_support_temporary("whole.png"));
    snprintf(arguments, sizeof arguments, "--path-trace builtin:cornell --size 64x64 --spp %u --out %s",
             samples, whole);
    assert_int_equal(run_view(arguments), 0);
    size_t size[2];
    uint8_t *bytes[2] = {lw_support_read_file(png, &size[0]), lw_support_read_file(whole, &size[1])};
    assert_int_equal(size[0], size[1]);
    assert_memory_equal(bytes[0], bytes[1], size[0]);
    free(bytes[0]);
    free(bytes[1]);
}

/* At this size not even one sample is done when the signal comes: it does not wait for that. */
static void test_path_trace_is_stopped_before_its_first_sample(void **state) {
    (void)state;
    char arguments[512], png[256];
    snprintf(png, sizeof png, "%s", lw_support_temporary("never.png"));
    snprintf(arguments, sizeof arguments,
             "--path-trace builtin:cornell --size 2000x2000 --bounces 64 --spp 64 --out %s", png);
    lw_process_start(&view, "lightwell-view", arguments);
    assert_true(lw_process_await(&view, takes_signals, &view));
    stop_view(SIGINT, "stopped before the first sample; nothing is written");
    assert_int_not_equal(access(png, F_OK), 0);
    lw_process_left_nothing();
}

static void test_path_trace_failures(void **state) {
    (void)state;
    view_fails("--path-trace /nowhere/room.glb --json", 66, "/nowhere/room.glb");
    view_fails("--path-trace builtin:cornell --size 8x8 --json --camera-name nobody", 64,
               "no camera \"nobody\"");
    /* before the scene is read: there is none */
    view_fails("--path-trace /nowhere/room.glb --out /nowhere/view.png", 73,
               "--out: /nowhere/view.png: there is no folder /nowhere");
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_complete_picture),
        cmocka_unit_test(test_gl),
        cmocka_unit_test(test_good_picture),
        cmocka_unit_test(test_png),
        cmocka_unit_test(test_late),
        cmocka_unit_test(test_before_the_first_light),
        cmocka_unit_test(test_failures),
        cmocka_unit_test(test_own_server),
        cmocka_unit_test(test_own_server_without_light),
        cmocka_unit_test(test_a_wait_that_is_stopped_writes_what_there_is),
        cmocka_unit_test(test_a_wait_in_the_dark_that_is_stopped_writes_nothing),
        cmocka_unit_test(test_path_trace),
        cmocka_unit_test(test_path_trace_to_an_error),
        cmocka_unit_test(test_path_trace_is_stopped),
        cmocka_unit_test(test_path_trace_is_stopped_before_its_first_sample),
        cmocka_unit_test(test_path_trace_failures),
    };
    return cmocka_run_group_tests(tests, start_daemon, stop_daemon);
}
