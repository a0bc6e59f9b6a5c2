#include "tests/support/support.h"

#include "client/load/load_options.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define WORDS_MAX 20

static enum lw_status parse(const char *line, struct lw_load_options *out, struct lw_error *err) {
    static char text[512];
    static char program[] = "lightwell-load";
    char *argv[WORDS_MAX] = {program}, *rest = NULL;
    int argc = 1;
    bool done;
    *err = (struct lw_error){0};
    snprintf(text, sizeof text, "%s", line);
    for (char *word = strtok_r(text, " ", &rest); word; word = strtok_r(NULL, " ", &rest))
        argv[argc++] = word;
    return lw_load_options_parse(argc, argv, out, &done, err);
}

static void test_defaults(void **state) {
    (void)state;
    struct lw_load_options o;
    struct lw_error err;
    lw_support_ok(parse("", &o, &err), &err);
    assert_string_equal(o.host, "127.0.0.1");
    assert_int_equal(o.port, 7780);
    assert_int_equal(o.users, 100);
    assert_int_equal(o.path, LW_LOAD_EVERYTHING);
    assert_int_equal(o.reader, LW_LOAD_FAST);
    assert_int_equal(o.odd_readers, 0);
    assert_int_equal(o.errors_max, 0);
    assert_true(o.churn_hz == 0 && o.frames_min_hz == 0 && !o.download && !o.decode_all && !o.json);
    assert_true(isinf(o.latency_max_ms) && isinf(o.first_view_max_ms));
    assert_null(o.series);
}

static void test_values(void **state) {
    (void)state;
    struct lw_load_options o;
    struct lw_error err;
    lw_support_ok(
        parse("[::1]:99 --users 20000 --seconds 2.5 --ramp 10 --path teleport --reader slow:12.5 --churn 3 "
              "--max-latency-ms 50 --series s.csv",
              &o, &err),
        &err);
    assert_string_equal(o.host, "::1");
    assert_int_equal(o.port, 99);
    assert_int_equal(o.users, LW_LOAD_USERS_MAX);
    assert_int_equal(o.path, LW_LOAD_TELEPORT);
    assert_int_equal(o.reader, LW_LOAD_SLOW);
    assert_int_equal(o.odd_readers, o.users);
    assert_true(o.slow_bytes_hz == 12500 && o.ramp_hz == 10 && o.churn_hz == 3 && o.seconds == 2.5);
    assert_true(o.latency_max_ms == 50);
    assert_string_equal(o.series, "s.csv");
    lw_support_ok(parse("--users 10 --reader never --odd-readers 2", &o, &err), &err);
    assert_int_equal(o.reader, LW_LOAD_NEVER);
    assert_int_equal(o.odd_readers, 2);
}

static void test_refuses(void **state) {
    (void)state;
    static const char *const bad[][2] = {
        {"--users 0", "from 1 to 20000"},
        {"--users 20001", "from 1 to 20000"},
        {"--users 1000000", "from 1 to 20000"},
        {"--seconds 0", "--seconds"},
        {"--path run", "everything|walk|still|teleport"},
        {"--reader lazy", "none of fast, slow:KBPS, never"},
        {"--reader slow", "none of fast, slow:KBPS, never"},
        {"--reader slow:", "kilobytes per second"},
        {"--reader slow:0", "kilobytes per second"},
        {"--reader slow:1x", "kilobytes per second"},
        {"--reader slow:nan", "kilobytes per second"},
        {"--odd-readers 1", "--odd-readers works with"},
        {"--reader never --users 3 --odd-readers 4", "4 of 3 users"},
        {"::1", "[::1]:7780"},
        {"scene.glb", "lightwelld scene.glb"},
        {"a:1 b:2", "unexpected argument"},
        {"--ramp -1", "--ramp"},
    };
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        struct lw_load_options o = {.users = 12345};
        struct lw_error err;
        lw_support_fails(parse(bad[i][0], &o, &err), LW_USAGE, &err, bad[i][1]);
        assert_int_equal(o.users, 12345);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_defaults),
        cmocka_unit_test(test_values),
        cmocka_unit_test(test_refuses),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
