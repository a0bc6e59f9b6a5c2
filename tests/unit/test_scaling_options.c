#include "tests/support/support.h"

#include "client/measure/scaling_options.h"

static enum lw_status parse(const char *option, const char *value, struct lw_scaling_options *o,
                            struct lw_error *err) {
    char *argv[LW_SUPPORT_WORDS_MAX];
    const int argc = lw_support_command_line(argv, "scaling", option, value);
    bool done;
    return lw_scaling_options_parse(argc, argv, o, &done, err);
}

static void defaults(void **state) {
    (void)state;
    struct lw_scaling_options o;
    struct lw_error err = {0};
    lw_support_ok(parse(NULL, NULL, &o, &err), &err);
    assert_int_equal(o.user_counts, 9);
    assert_int_equal(o.users[8], 256);
    assert_int_equal(o.base.width, 1280);
    assert_int_equal(o.base.height, 720);
    assert_int_equal(o.base.motion, LW_SCENE_MOTION_LIGHT);
    assert_true(o.error == 0.1 && o.match_samples == 0);
}

static void values(void **state) {
    (void)state;
    struct lw_scaling_options o;
    struct lw_error err = {0};
    lw_support_ok(parse("--error", "match:5", &o, &err), &err);
    assert_true(o.match_samples == 5 && o.error == 0);
    lw_support_ok(parse("--settings", "5:8+10", &o, &err), &err);
    assert_true(o.fixed_samples == 5 && o.fixed_direct == 8 && o.fixed_indirect == 10 &&
                o.fixed_density == 1);
    lw_support_ok(parse("--settings", "1:1+2@0.5", &o, &err), &err);
    assert_true(o.fixed_samples == 1 && o.fixed_indirect == 2 && o.fixed_density == 0.5 &&
                o.fixed_target_error == 0.02);
    lw_support_ok(parse("--settings", "10:1+1@0.25,0.2", &o, &err), &err);
    assert_true(o.fixed_density == 0.25 && o.fixed_target_error == 0.2);
    lw_support_ok(parse("--settings", "10:1+1,0.5", &o, &err), &err);
    assert_true(o.fixed_density == 1 && o.fixed_target_error == 0.5);
    lw_support_ok(parse("--users", "3", &o, &err), &err);
    assert_true(o.user_counts == 1 && o.users[0] == 3);
    lw_support_ok(parse("--truth-samples", "7", &o, &err), &err);
    assert_int_equal(o.base.reference_samples, 8);
}

static void bad_values_are_named(void **state) {
    (void)state;
    static const struct {
        const char *option, *value, *text;
    } bad[] = {
        {"--users", "0", "--users: 0 is not within 1..4096"},
        {"--users", "1000000", "--users: 1000000 is not within"},
        {"--users", "2,1", "must grow"},
        {"--users", "1,,2", "no list of counts"},
        {"--users", "1;2", "no list of counts"},
        {"--users", "-1", "no list of counts"},
        {"--users", "", "no list of counts"},
        {"--error", "relmse:0", "--error"},
        {"--error", "relmse:nan", "--error"},
        {"--error", "relmse:0.1x", "--error"},
        {"--error", "match:0", "--error"},
        {"--error", "0.1", "--error"},
        {"--size", "1280", "--size"},
        {"--size", "8x8", "--size"},
        {"--size", "99999x99999", "--size"},
        {"--settings", "1:1", "--settings"},
        {"--settings", "0:1+1", "--settings"},
        {"--settings", "1:1+1@", "--settings"},
        {"--settings", "1:1+1@0", "--settings"},
        {"--settings", "1:1+1@nan", "--settings"},
        {"--settings", "1:1+1@2x", "--settings"},
        {"--settings", "1:1+1,", "--settings"},
        {"--settings", "1:1+1,0", "--settings"},
        {"--settings", "1:1+1,nan", "--settings"},
        {"--settings", "1:1+1,0.2@1", "--settings"},
        {"--motion", "fast", "--motion"},
        {"--seconds", "0", "--seconds"},
        {"--spread", "2", "--spread"},
        {"--repeats", "0", "--repeats"},
    };
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        struct lw_scaling_options o;
        struct lw_error err = {0};
        lw_support_fails(parse(bad[i].option, bad[i].value, &o, &err), LW_USAGE, &err, bad[i].text);
    }
    struct lw_scaling_options o;
    struct lw_error err = {0};
    char *argv[] = {(char *)"scaling", (char *)"builtin:cornell", NULL};
    bool done;
    lw_support_fails(lw_scaling_options_parse(2, argv, &o, &done, &err), LW_USAGE, &err, "-o DIR is missing");
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(defaults), cmocka_unit_test(values),
                                       cmocka_unit_test(bad_values_are_named)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
