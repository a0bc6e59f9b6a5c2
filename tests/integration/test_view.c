/* lightwell-view --headless against a real lightwelld. */
#include "tests/support/process.h"

#include "common/image/image.h"

#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

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

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_complete_picture),
        cmocka_unit_test(test_png),
        cmocka_unit_test(test_failures),
    };
    return cmocka_run_group_tests(tests, start_daemon, stop_daemon);
}
