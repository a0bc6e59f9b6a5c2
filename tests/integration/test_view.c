/* lightwell-view --headless against a real lightwelld. */
#include "tests/support/process.h"

#include "common/image/image.h"

#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define VIEW_LIMIT_S 120
#define STOP_LIMIT_S 30

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

static void test_complete_picture(void **state) {
    (void)state;
    char arguments[512];
    snprintf(arguments, sizeof arguments,
             "%s --headless --wait complete --timeout 60 --size 161x90 --json --out %s", address,
             lw_support_temporary("view.exr"));
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

static void test_failures(void **state) {
    (void)state;
    char arguments[512];
    snprintf(arguments, sizeof arguments, "%s --headless --json --camera-name nobody", address);
    view_fails(arguments, 64, "no camera \"nobody\"");
    snprintf(arguments, sizeof arguments, "%s --headless --json --wait converged --timeout 0.5", address);
    view_fails(arguments, 75, "--timeout");
    snprintf(arguments, sizeof arguments, "%s --headless --size 16x16 --wait first --out /nowhere/view.png",
             address);
    view_fails(arguments, 73, "/nowhere/view.png");
    view_fails("127.0.0.1:1 --headless --json", 69, "127.0.0.1:1");
    view_fails(address, 69, "no display: use --headless");
}

/* ---- --path-trace, which asks no server ---- */

static void test_path_trace(void **state) {
    (void)state;
    char arguments[512], exr[256];
    snprintf(exr, sizeof exr, "%s", lw_support_temporary("path.exr"));
    uint8_t *bytes[2];
    size_t size[2];
    for (int i = 0; i < 2; i++) {
        snprintf(arguments, sizeof arguments,
                 "--path-trace builtin:cornell --size 61x40 --spp 7 --bounces 1 --threads %d --json --out %s",
                 i + 1, exr);
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

/* A million samples would take hours: the first signal ends the tracing, and what is done is written. */
static void test_path_trace_is_stopped(void **state) {
    (void)state;
    char arguments[512], png[256];
    snprintf(png, sizeof png, "%s", lw_support_temporary("stopped.png"));
    snprintf(arguments, sizeof arguments,
             "--path-trace builtin:cornell --size 64x64 --spp 1000000 --json --out %s", png);
    lw_process_start(&view, "lightwell-view", arguments);
    char *err = NULL;
    for (int tenths = 0; tenths < 300; tenths++) { /* a progress line: it traces */
        usleep(100000);
        err = lw_process_err(&view);
        if (strstr(err, "tracing paths") != NULL) break;
        free(err);
        err = NULL;
    }
    assert_non_null(err);
    free(err);
    int code = lw_process_stop(&view, SIGINT, STOP_LIMIT_S);
    if (code != 0) fail_msg("ended with %d: %s", code, lw_process_err(&view));
    char *json = lw_process_out(&view);
    err = lw_process_err(&view);
    assert_non_null(strstr(json, "\"stopped\": true"));
    assert_non_null(strstr(err, "stopped: the picture has"));
    double samples = number_of(json, "samples");
    assert_true(samples >= 4 && samples < 1000000);
    size_t size;
    uint8_t *bytes = lw_support_read_file(png, &size);
    assert_memory_equal(bytes, "\x89PNG\r\n\x1a\n", 8);
    free(bytes);
    free(err);
    free(json);
}

static void test_path_trace_failures(void **state) {
    (void)state;
    view_fails("--path-trace /nowhere/room.glb --json", 66, "/nowhere/room.glb");
    view_fails("--path-trace builtin:cornell --size 8x8 --json --camera-name nobody", 64,
               "no camera \"nobody\"");
    view_fails("--path-trace builtin:cornell --size 8x8 --spp 1 --out /nowhere/view.png", 73,
               "/nowhere/view.png");
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_complete_picture),
        cmocka_unit_test(test_png),
        cmocka_unit_test(test_failures),
        cmocka_unit_test(test_path_trace),
        cmocka_unit_test(test_path_trace_to_an_error),
        cmocka_unit_test(test_path_trace_is_stopped),
        cmocka_unit_test(test_path_trace_failures),
    };
    return cmocka_run_group_tests(tests, start_daemon, stop_daemon);
}
