/* lightwell-view --headless against a real lightwelld. */
#include "tests/support/support.h"

#include "common/image/image.h"

#include <fcntl.h>
#include <math.h>
#include <signal.h>
#include <spawn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#define WORDS_MAX 32
#define START_S   60

static char bin[512];
static pid_t daemon_pid;
static char address[64];

static void sleep_ms(long ms) { nanosleep(&(struct timespec){.tv_nsec = ms * 1000000}, NULL); }

/* Starts a program beside this one; its output goes to files of the test's own folder. No display. */
static pid_t start(const char *program, const char *arguments, const char *out, const char *err) {
    char path[600], line[1024], *argv[WORDS_MAX] = {path};
    char path_variable[] = "PATH=/usr/bin:/bin", *environment[] = {path_variable, NULL};
    int argc = 1;
    pid_t pid;
    snprintf(path, sizeof path, "%s/%s", bin, program);
    snprintf(line, sizeof line, "%s", arguments);
    for (char *word = strtok(line, " "); word && argc < WORDS_MAX - 1; word = strtok(NULL, " "))
        argv[argc++] = word;
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_addopen(&actions, 1, lw_support_temporary(out), O_WRONLY | O_CREAT | O_TRUNC,
                                     0600);
    posix_spawn_file_actions_addopen(&actions, 2, lw_support_temporary(err), O_WRONLY | O_CREAT | O_TRUNC,
                                     0600);
    int failed = posix_spawn(&pid, path, &actions, NULL, argv, environment);
    posix_spawn_file_actions_destroy(&actions);
    if (failed) fail_msg("cannot start %s: %s", path, strerror(failed));
    return pid;
}

static int finish(pid_t pid) {
    int status;
    assert_int_equal(waitpid(pid, &status, 0), pid);
    if (!WIFEXITED(status)) fail_msg("ended by signal %d", WTERMSIG(status));
    return WEXITSTATUS(status);
}

static char *text_of(const char *file) {
    size_t size;
    return (char *)lw_support_read_file(lw_support_temporary(file), &size);
}

static int run_view(const char *arguments) {
    return finish(start("lightwell-view", arguments, "out", "err"));
}

/* Runs the viewer; it must end with `code` and say `said` in one line on stderr. */
static void view_fails(const char *arguments, int code, const char *said) {
    int got = run_view(arguments);
    char *err = text_of("err"), *out = text_of("out");
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
    char arguments[512], *text = NULL;
    ssize_t length = readlink("/proc/self/exe", bin, sizeof bin - 1);
    assert_true(length > 0);
    bin[length] = '\0';
    *strrchr(bin, '/') = '\0';
    snprintf(arguments, sizeof arguments,
             "builtin:cornell --listen 127.0.0.1:0 --texels-per-metre 8 --port-file %s",
             lw_support_temporary("port"));
    daemon_pid = start("lightwelld", arguments, "daemon.out", "daemon.err");
    for (int i = 0; i < START_S * 20; i++, sleep_ms(50)) {
        if (access(lw_support_temporary("port"), R_OK) != 0) continue;
        text = text_of("port");
        if (strchr(text, '\n') != NULL) break;
        free(text);
        text = NULL;
    }
    if (text == NULL) fail_msg("lightwelld did not serve within %d s: %s", START_S, text_of("daemon.err"));
    snprintf(address, sizeof address, "127.0.0.1:%d", atoi(text));
    free(text);
    return 0;
}

static int stop_daemon(void **state) {
    (void)state;
    if (daemon_pid <= 0) return 0; /* it never started; signals to 0 would reach us all */
    kill(daemon_pid, SIGTERM);
    return finish(daemon_pid);
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
    if (code != 0) fail_msg("ended with %d: %s", code, text_of("err"));
    char *json = text_of("out");
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
    char *png = text_of("view.png"), *out = text_of("out");
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
