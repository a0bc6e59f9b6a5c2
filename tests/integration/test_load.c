/* The real lightwell-load against the real lightwelld. */
#include "tests/support/process.h"

#include "common/base/clock.h"

#include <jansson.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define LIMIT_S   LW_PROCESS_LIMIT_S
#define WINDOW_MS 1000 /* length of an interrupted run */

#define NEVER_RESTS                                                                                          \
    "builtin:cornell --texels-per-metre 8 --error 1e-6 --frame-rate 60 --threads 1 "                         \
    "--json "
#define ALL_OF_EACH_FRAME NEVER_RESTS "--codec half" /* what fills a link soon on a slow machine too */

static struct lw_process shared; /* a daemon of NEVER_RESTS, for all tests that leave it as it is */

static int serve_shared(void **state) {
    (void)state;
    lw_process_serve(&shared, NEVER_RESTS);
    return 0;
}

static int stop_shared(void **state) {
    (void)state;
    return lw_process_stop(&shared, SIGTERM, LIMIT_S);
}

static void start_load(struct lw_process *load, const struct lw_process *daemon, const char *arguments) {
    char all[256];
    snprintf(all, sizeof all, "127.0.0.1:%u %s", (unsigned)daemon->port, arguments);
    lw_process_start(load, "lightwell-load", all);
}

static json_t *report_of(const struct lw_process *load) {
    char *text = lw_process_out(load), *complaints = lw_process_err(load);
    json_error_t problem;
    json_t *report = json_loads(text, 0, &problem);
    if (!report) fail_msg("no report: %s in \"%s\"; it says \"%s\"", problem.text, text, complaints);
    free(complaints);
    free(text);
    return report;
}

static double number(const json_t *report, const char *key) {
    const json_t *value = json_object_get(report, key);
    if (!json_is_number(value)) fail_msg("%s is no number", key);
    return json_number_value(value);
}

static double time_of(const json_t *report, const char *key, const char *what) {
    return number(json_object_get(report, key), what);
}

static void expect_no_errors(const json_t *report) {
    const char *key;
    json_t *value, *errors = json_object_get(report, "errors");
    assert_int_equal(json_object_size(errors), 13);
    json_object_foreach(errors, key, value) {
        if (json_integer_value(value)) fail_msg("%d of error %s", (int)json_integer_value(value), key);
    }
}

static void expect_end(const json_t *report, const char *end) {
    assert_string_equal(json_string_value(json_object_get(report, "end")), end);
}

/* One run to its end. */
static json_t *load(const struct lw_process *daemon, const char *arguments) {
    struct lw_process load;
    start_load(&load, daemon, arguments);
    int code = lw_process_finish(&load, LIMIT_S);
    char *complaints = lw_process_err(&load);
    if (code != 0) fail_msg("exit code %d; it says: %s", code, complaints);
    free(complaints);
    return report_of(&load);
}

struct users {
    const struct lw_process *daemon;
    unsigned count;
};

static bool are_there(void *context) {
    const struct users *users = context;
    return lw_process_newest(users->daemon, "sessions") == users->count;
}

/* Until there are `count` users, and then for the window, which is real time, and some frames. */
static void wait_for_users(struct lw_process *daemon, unsigned count) {
    struct users users = {daemon, count};
    if (!lw_process_await(daemon, are_there, &users)) fail_msg("ended before there were %u users", count);
    lw_process_sleep_ms(WINDOW_MS);
    lw_process_await_frames(daemon, 10);
}

static void test_fifty_users(void **state) {
    (void)state;
    json_t *r =
        load(&shared, "--users 50 --seconds 4 --min-frames-per-s 0.01 --max-first-view-ms 500000 --json");
    expect_end(r, "time");
    expect_no_errors(r);
    assert_true(number(r, "welcomed") == 50 && number(r, "users_at_end") == 50);
    assert_true(number(r, "measured_s") >= 4);
    assert_true(time_of(r, "connect_ms", "count") == 50 && time_of(r, "first_view_ms", "count") == 50);
    assert_true(time_of(r, "first_view_ms", "p50") > 0);
    double frames = number(r, "frames_published");
    assert_true(frames >= 2 && number(r, "frames") <= 50 * (frames + 1));
    assert_true(number(r, "tiles") > 0 && number(r, "bytes") > 0);
    assert_true(number(r, "server_cpu_s") > 0 && number(r, "server_wall_s") > 0 &&
                number(r, "own_cpu_s") > 0);
    assert_true(number(r, "followed") == 1 && number(r, "kbit_in_a_second_p99") > 0);
    /* what all got was encoded once, so that little of it was decoded */
    assert_true(number(r, "tiles_decoded") < number(r, "tiles"));
    json_decref(r);
}

static void test_paths(void **state) {
    (void)state;
    static const char *const paths[] = {"walk --seconds 1.5", "still --seconds 1.5",
                                        "teleport --seconds 3.5"}; /* which stays for two */
    for (int i = 0; i < 3; i++) {
        char arguments[128];
        snprintf(arguments, sizeof arguments, "--users 10 --path %s --decode-all --json", paths[i]);
        json_t *r = load(&shared, arguments);
        expect_no_errors(r);
        assert_true(time_of(r, "first_view_ms", "count") == 10);
        if (i == 2) assert_true(time_of(r, "next_view_ms", "count") > 0);
        if (i == 1) assert_true(time_of(r, "next_view_ms", "count") == 0);
        json_decref(r);
    }
}

static void test_churn(void **state) {
    (void)state;
    json_t *r = load(&shared, "--users 20 --seconds 2 --churn 20 --download --json");
    expect_no_errors(r);
    assert_true(number(r, "left") >= 30 && number(r, "left") <= 40);
    assert_true(number(r, "asked") == 20 + number(r, "left"));
    assert_true(time_of(r, "download_ms", "count") > 0);
    json_decref(r);
}

/* A few slow readers among fast ones: nobody is lost, and the fast ones have their frames. */
static void test_slow_readers(void **state) {
    (void)state;
    struct lw_process daemon;
    lw_process_serve(&daemon, ALL_OF_EACH_FRAME);
    json_t *r = load(&daemon, "--users 10 --odd-readers 3 --reader slow:50 --seconds 2 --json");
    expect_no_errors(r);
    assert_true(number(r, "welcomed") == 10 && number(r, "users_at_end") == 10);
    assert_true(time_of(r, "first_view_ms", "count") == 7);
    assert_true(number(r, "frames_per_s_p1") > 0);
    json_decref(r);
    r = load(&daemon, "--users 3 --reader slow:50 --seconds 2 --json");
    expect_no_errors(r);
    /* the first read, before the clock ticks, is one fifth of a second's worth */
    assert_true(number(r, "bytes") <= 3 * 50e3 * (number(r, "measured_s") + 0.5));
    assert_true(number(r, "bytes") > 3 * 50e3 * 0.2 * number(r, "measured_s"));
    assert_true(number(r, "welcomed") == 3 && number(r, "users_at_end") == 3);
    json_decref(r);
    lw_process_end(&daemon);
}

/* The server drops who does not read after 15 s; the others do not notice. */
static void test_never_readers(void **state) {
    (void)state;
    struct lw_process daemon;
    char moving[256]; /* links are full once some 10 MB wait */
    snprintf(moving, sizeof moving, "%s --frame-rate 60 --threads 1 --codec half", lw_process_atrium());
    lw_process_serve(&daemon, moving);
    json_t *r = load(&daemon,
                     "--users 10 --odd-readers 3 --reader never --seconds 50 --min-frames-per-s 0.01 --json");
    expect_end(r, "time");
    expect_no_errors(r);
    assert_true(number(r, "stopped") == 3 && number(r, "dropped") == 3);
    assert_true(time_of(r, "drop_ms", "p50") >= 15000 && time_of(r, "drop_ms", "max") < 50000);
    assert_true(number(r, "users_at_end") == 7);
    json_decref(r);
    lw_process_end(&daemon);
}

static void test_server_killed(void **state) {
    (void)state;
    struct lw_process daemon, load;
    lw_process_serve(&daemon, NEVER_RESTS);
    start_load(&load, &daemon, "--users 20 --seconds 600 --json");
    wait_for_users(&daemon, 20);
    assert_int_equal(lw_process_stop(&daemon, SIGKILL, LIMIT_S), -SIGKILL);
    assert_int_equal(lw_process_finish(&load, LIMIT_S), 1);
    json_t *r = report_of(&load);
    expect_end(r, "server_gone");
    assert_true(number(r, "lost") == 20);
    assert_true(number(r, "measured_s") > 0.5 && number(r, "frames") > 0);
    json_decref(r);
    assert_true(lw_process_said(&load, "the server is gone after"));
}

/* What a series says, line by line. */
struct series {
    unsigned lines, users_last, users_min; /* min: once all were there */
    double bytes, age_last_ms, age_max_ms;
};

static struct series read_series(const char *path, unsigned users) {
    struct series s = {.users_min = users};
    double before_s = 0, now_s, bytes, age_p50_ms, age_max_ms;
    char line[200];
    bool all_came = false;
    FILE *file = fopen(path, "re");
    assert_non_null(file);
    assert_non_null(fgets(line, sizeof line, file));
    assert_string_equal(line, "unix_s,users,bytes,age_p50_ms,age_max_ms\n");
    for (; fgets(line, sizeof line, file); s.lines++) {
        const int fields =
            sscanf(line, "%lf,%u,%lf,%lf,%lf", &now_s, &s.users_last, &bytes, &age_p50_ms, &age_max_ms);
        assert_true(fields == 5 || (fields == 3 && !all_came));
        assert_true(now_s >= before_s && s.users_last <= users);
        before_s = now_s;
        s.bytes += bytes;
        all_came |= s.users_last == users;
        if (!all_came) continue;
        assert_true(age_p50_ms >= 0 && age_max_ms >= 0.99 * age_p50_ms); /* a quantile is inexact by 1/128 */
        if (s.users_last < s.users_min) s.users_min = s.users_last;
        if (age_max_ms > s.age_max_ms) s.age_max_ms = age_max_ms;
        s.age_last_ms = age_max_ms;
    }
    fclose(file);
    assert_int_equal(unlink(path), 0);
    assert_true(all_came);
    return s;
}

/* The server is killed and started again: everybody comes back, once, and is served. The series shows it: no
 * users for a while, and light that ages until they are back. */
static void test_server_restarted(void **state) {
    (void)state;
    struct lw_process daemon, load;
    char again[256], options[300];
    const char *path = lw_support_temporary("series.csv");
    lw_process_serve(&daemon, NEVER_RESTS);
    snprintf(options, sizeof options, "--users 50 --seconds 600 --reconnect --json --series %s", path);
    snprintf(again, sizeof again, NEVER_RESTS "--listen 127.0.0.1:%u", (unsigned)daemon.port);
    start_load(&load, &daemon, options);
    wait_for_users(&daemon, 50);
    assert_int_equal(lw_process_stop(&daemon, SIGKILL, LIMIT_S), -SIGKILL);
    lw_process_sleep_ms(WINDOW_MS);
    lw_process_serve(&daemon, again);
    wait_for_users(&daemon, 50);
    assert_int_equal(lw_process_stop(&load, SIGINT, LIMIT_S), 1);
    json_t *r = report_of(&load);
    expect_end(r, "interrupted");
    expect_no_errors(r);
    assert_true(number(r, "broken") == 50 && number(r, "returned") == 50);
    assert_true(number(r, "welcomed") == 100 && number(r, "users_at_end") == 50 && number(r, "lost") == 0);
    assert_true(time_of(r, "served_ms", "count") == 50 && time_of(r, "first_view_ms", "count") == 50);
    const struct series s = read_series(path, 50);
    assert_true(s.lines > 10 && s.users_min == 0 && s.users_last == 50);
    assert_true(s.bytes > 0 && s.age_max_ms > WINDOW_MS && s.age_last_ms < s.age_max_ms);
    json_decref(r);
    lw_process_end(&daemon);
}

static void test_interrupted(void **state) {
    (void)state;
    struct lw_process load;
    start_load(&load, &shared, "--users 25 --seconds 600 --json"); /* no other test has 25 */
    wait_for_users(&shared, 25);
    assert_int_equal(lw_process_stop(&load, SIGINT, LIMIT_S), 1);
    json_t *r = report_of(&load);
    expect_end(r, "interrupted");
    assert_true(number(r, "welcomed") == 25 && number(r, "measured_s") > 0.5);
    expect_no_errors(r);
    json_decref(r);
}

static void expect_failure(const char *arguments, int exit_code, const char *text) {
    struct lw_process load;
    lw_process_start(&load, "lightwell-load", arguments);
    assert_int_equal(lw_process_finish(&load, LIMIT_S), exit_code);
    char *out = lw_process_out(&load), *complaints = lw_process_err(&load);
    assert_string_equal(out, "");
    if (!strstr(complaints, text) || strchr(complaints, '\n') != strrchr(complaints, '\n'))
        fail_msg("no line with \"%s\" alone: %s", text, complaints);
    free(out);
    free(complaints);
}

static void test_bad_input(void **state) {
    (void)state;
    expect_failure("127.0.0.1:1 --users 3", 69, "is lightwelld running?");
    expect_failure("127.0.0.1:1 --users 0", 64, "from 1 to 20000");
    expect_failure("127.0.0.1:1 --users 1000000", 64, "from 1 to 20000");
    expect_failure("nowhere.invalid:1", 68, "nowhere.invalid");
    char unwritable[100];
    snprintf(unwritable, sizeof unwritable, "127.0.0.1:%u --users 1 --series /nowhere/s.csv", shared.port);
    expect_failure(unwritable, 74, "--series: cannot write /nowhere/s.csv");
}

static void test_thresholds(void **state) {
    (void)state;
    struct lw_process load;
    start_load(&load, &shared, "--users 5 --seconds 1 --min-frames-per-s 100000 --max-first-view-ms 0");
    assert_int_equal(lw_process_finish(&load, LIMIT_S), 1);
    char *complaints = lw_process_err(&load), *out = lw_process_out(&load);
    assert_non_null(strstr(complaints, "--min-frames-per-s 100000 does not hold"));
    assert_non_null(strstr(complaints, "--max-first-view-ms 0 does not hold"));
    assert_null(strstr(complaints, "--max-errors"));
    assert_non_null(strstr(out, "5 asked, 5 welcomed, 0 refused, 0 lost"));
    assert_non_null(strstr(out, "errors       none"));
    free(complaints);
    free(out);
}

static int kill_all(void **state) {
    (void)state;
    lw_process_kill_all();
    return 0;
}

/* With an argument: the long test alone. Tests with a server of their own come last: what they leave running
 * where they fail is killed, and the shared one with it. */
int main(int argc, char **argv) {
    const struct CMUnitTest long_tests[] = {cmocka_unit_test_teardown(test_never_readers, kill_all)};
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_fifty_users), cmocka_unit_test(test_paths),
        cmocka_unit_test(test_churn),       cmocka_unit_test(test_interrupted),
        cmocka_unit_test(test_thresholds),  cmocka_unit_test(test_bad_input),
    };
    const struct CMUnitTest own_server_tests[] = {
        cmocka_unit_test_teardown(test_slow_readers, kill_all),
        cmocka_unit_test_teardown(test_server_killed, kill_all),
        cmocka_unit_test_teardown(test_server_restarted, kill_all),
    };
    (void)argv;
    if (argc > 1) return cmocka_run_group_tests(long_tests, NULL, NULL);
    return cmocka_run_group_tests(tests, serve_shared, stop_shared) +
           cmocka_run_group_tests(own_server_tests, NULL, NULL);
}
