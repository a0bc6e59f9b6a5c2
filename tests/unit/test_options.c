#include "tests/support/support.h"

#include "common/base/options.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static struct values {
    bool animate, rate_given;
    const char *file, *out;
    int64_t bounces, seed;
    double range, rate;
    float sky[3];
    int clock;
    int64_t hidden;
} values;

static const struct lw_option table[] = {
    {.name = "animate", .help = "Play the animation.", .kind = LW_OPTION_FLAG, .value = &values.animate},
    {.name = "port-file",
     .argument = "FILE",
     .help = "Write the port here.",
     .kind = LW_OPTION_STRING,
     .value = &values.file},
    {.name = "bounces",
     .argument = "N",
     .help = "Indirect bounces (default {}).",
     .kind = LW_OPTION_INT,
     .value = &values.bounces,
     .min = 0,
     .max = 16},
    {.name = "seed",
     .argument = "N",
     .help = "Any number.",
     .kind = LW_OPTION_INT,
     .value = &values.seed,
     .min = -0x1p63,
     .max = 0x1p63},
    {.name = "tracing-range",
     .argument = "METRES|inf",
     .help = "Rays longer than this ask the probes instead of the scene, which is faster and a little less "
             "exact (default {}).",
     .kind = LW_OPTION_REAL,
     .value = &values.range,
     .min = 0.01,
     .max = (double)INFINITY},
    {.name = "frame-rate",
     .argument = "HZ",
     .help = "Frames a second.",
     .kind = LW_OPTION_REAL,
     .value = &values.rate,
     .min = 0.5,
     .max = 240,
     .given = &values.rate_given},
    {.name = "sky",
     .argument = "R,G,B",
     .help = "Radiance of the sky.",
     .kind = LW_OPTION_RGB,
     .value = values.sky,
     .min = 0,
     .max = 100},
    {.name = "clock",
     .argument = "real|step",
     .help = "What time follows.",
     .kind = LW_OPTION_CHOICE,
     .value = &values.clock},
    {.name = "o", .argument = "FILE", .help = "Output.", .kind = LW_OPTION_STRING, .value = &values.out},
    {.name = "between-our-own-programs",
     .argument = "N",
     .kind = LW_OPTION_INT,
     .value = &values.hidden,
     .min = 0,
     .max = 9},
};
static const char *positional[2];
static size_t positional_count;
static bool done;
static struct lw_error err;

/* Parses words separated by blanks; at least `min` positionals. */
static enum lw_status parse_min(const char *line, size_t min) {
    static char words[1024];
    char *argv[32] = {(char *)"tester"};
    int argc = 1;
    snprintf(words, sizeof words, "%s", line);
    for (char *word = strtok(words, " "); word; word = strtok(NULL, " ")) argv[argc++] = word;
    values = (struct values){.bounces = 2, .range = (double)INFINITY, .rate = 30, .clock = 1};
    err = (struct lw_error){0};
    const struct lw_options options = {
        .program = "tester",
        .synopsis = "SCENE [OPTIONS]",
        .about = "Lights a scene for everybody who looks at it, once; and this paragraph is long enough to "
                 "need wrapping.\n\nExamples:\n  tester a.glb --sky 1,1,1",
        .table = table,
        .count = sizeof table / sizeof *table,
        .positional = positional,
        .positional_min = min,
        .positional_max = 2};
    return lw_options_parse(&options, argc, argv, &positional_count, &done, &err);
}
static enum lw_status parse(const char *line) { return parse_min(line, 0); }

static void refused(const char *line, const char *text) {
    assert_int_equal(parse(line), LW_USAGE);
    assert_int_equal(err.status, LW_USAGE);
    assert_string_equal(err.text, text);
}

static void nothing_given_keeps_the_defaults(void **state) {
    (void)state;
    lw_support_ok(parse(""), &err);
    assert_int_equal(positional_count, 0);
    assert_int_equal(values.bounces, 2);
    assert_int_equal(values.clock, 1);
    assert_false(done || values.rate_given || values.animate);
}

static void every_kind_and_both_forms(void **state) {
    (void)state;
    lw_support_ok(
        parse("--bounces 16 a.glb --animate --seed=-5 --tracing-range 1.5e1 --frame-rate=.5 --sky 1,.25,1e2 "
              "--clock real -o x --port-file=a=b"),
        &err);
    assert_int_equal(values.bounces, 16);
    assert_int_equal(values.seed, -5);
    assert_true(values.animate && values.rate_given && values.range == 15 && values.rate == 0.5);
    assert_true(values.sky[0] == 1 && values.sky[1] == 0.25f && values.sky[2] == 100);
    assert_int_equal(values.clock, 0);
    assert_string_equal(values.out, "x");
    assert_string_equal(values.file, "a=b");
    assert_int_equal(positional_count, 1);
    assert_string_equal(positional[0], "a.glb");
    lw_support_ok(parse("-ox.y --port-file= --bounces 1 --bounces 3"), &err);
    assert_string_equal(values.out, "x.y");
    assert_string_equal(values.file, "");
    assert_int_equal(values.bounces, 3); /* the last counts */
}

static void whole_numbers_are_strict(void **state) {
    (void)state;
    static const char *const bad[] = {
        "x", "3x", "3.0", "1e1", "0x3", "-1", "17", "+", "-", "99999999999999999999", "nan"};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        char line[64], text[128];
        snprintf(line, sizeof line, "--bounces=%s", bad[i]);
        snprintf(text, sizeof text, "--bounces: \"%s\" is not a whole number from 0 to 16", bad[i]);
        refused(line, text);
        assert_int_equal(values.bounces, 2);
    }
    refused("--bounces=", "--bounces: \"\" is not a whole number from 0 to 16");
    lw_support_ok(parse("--bounces 0"), &err);
    /* the ends of int64, and one past them */
    lw_support_ok(parse("--seed 9223372036854775807"), &err);
    assert_true(values.seed == INT64_MAX);
    lw_support_ok(parse("--seed -9223372036854775808"), &err);
    assert_true(values.seed == INT64_MIN);
    assert_int_equal(parse("--seed 9223372036854775808"), LW_USAGE);
    assert_int_equal(parse("--seed -9223372036854775809"), LW_USAGE);
}

static void real_numbers_are_finite_unless_asked(void **state) {
    (void)state;
    static const char *const bad[] = {"x",   "1m",   "nan",   "NAN",  "-1",  "0",   "infinity",
                                      "INF", "-inf", "1e999", "0x10", "1,5", "--1", "."};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        char line[64], text[128];
        snprintf(line, sizeof line, "--tracing-range=%s", bad[i]);
        snprintf(text, sizeof text, "--tracing-range: \"%s\" is not a number from 0.01 up, or inf", bad[i]);
        refused(line, text);
    }
    lw_support_ok(parse("--tracing-range 5 --tracing-range inf"), &err);
    assert_true(isinf(values.range));
    refused("--frame-rate inf", "--frame-rate: \"inf\" is not a number from 0.5 to 240");
    refused("--frame-rate 0.4999", "--frame-rate: \"0.4999\" is not a number from 0.5 to 240");
    refused("--frame-rate 240.001", "--frame-rate: \"240.001\" is not a number from 0.5 to 240");
    assert_false(values.rate_given);
    lw_support_ok(parse("--frame-rate 240"), &err);
}

static void colours_are_three(void **state) {
    (void)state;
    static const char *const bad[] = {"1",       "1,2",    "1,2,",    "1,2,3,4", "1,,3",
                                      "1,2,nan", "1,2,-3", "1,2,101", ",,",      "1;2;3"};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        char line[64], text[128];
        snprintf(line, sizeof line, "--sky %s", bad[i]);
        snprintf(text, sizeof text, "--sky: \"%s\" is not three numbers R,G,B, each from 0 to 100", bad[i]);
        refused(line, text);
        assert_true(values.sky[0] == 0);
    }
}

static void choices_are_whole_words(void **state) {
    (void)state;
    static const char *const bad[] = {"rea", "real|step", "steps", "Real", "", "|"};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        char line[64], text[128];
        snprintf(line, sizeof line, "--clock=%s", bad[i]);
        snprintf(text, sizeof text, "--clock: \"%s\" is not one of real|step", bad[i]);
        refused(line, text);
    }
}

static void mistakes_are_named(void **state) {
    (void)state;
    refused("--bouncse 3", "unknown option --bouncse; did you mean --bounces?");
    refused("--frame=3", "unknown option --frame; did you mean --frame-rate?");
    refused("-bounces 3", "unknown option -bounces; did you mean --bounces?");
    refused("--hlep", "unknown option --hlep; did you mean --help?");
    refused("--quite-another-thing", "unknown option --quite-another-thing; --help lists the options");
    refused("-x", "unknown option -x; --help lists the options");
    refused("--o x", "unknown option --o; --help lists the options");
    refused("--animate=yes", "--animate takes no value");
    refused("--help=yes", "--help takes no value");
    refused("--bounces", "--bounces needs a value: a whole number from 0 to 16");
    refused("--port-file --animate", "--port-file needs a value: FILE");
    refused("-o", "-o needs a value: FILE");
    refused("a b c", "unexpected argument \"c\"; usage: tester SCENE [OPTIONS]");
    assert_int_equal(parse_min("a", 2), LW_USAGE);
    assert_non_null(strstr(err.text, "tester SCENE [OPTIONS]"));
    char line[900] = "--";
    memset(line + 2, 'a', 800); /* longer than any table's names */
    assert_int_equal(parse(line), LW_USAGE);
}

static void two_dashes_end_the_options(void **state) {
    (void)state;
    lw_support_ok(parse("-- --animate -x"), &err);
    assert_int_equal(positional_count, 2);
    assert_string_equal(positional[0], "--animate");
    assert_false(values.animate);
    lw_support_ok(parse("-"), &err);
    assert_string_equal(positional[0], "-");
}

/* ---- output on stdout
 * -------------------------------------------------------------------------------------- */

static char printed[1 << 14];

static enum lw_status parse_and_print(const char *line) {
    fflush(stdout);
    int saved = dup(STDOUT_FILENO);
    FILE *file = tmpfile();
    assert_non_null(file);
    dup2(fileno(file), STDOUT_FILENO);
    enum lw_status status = parse_min(line, 1);
    fflush(stdout);
    dup2(saved, STDOUT_FILENO);
    close(saved);
    rewind(file);
    size_t size = fread(printed, 1, sizeof printed - 1, file);
    printed[size] = 0;
    fclose(file);
    return status;
}

static void an_option_without_help_is_taken_and_not_listed(void **state) {
    (void)state;
    lw_support_ok(parse("a --between-our-own-programs 7"), &err);
    assert_int_equal(values.hidden, 7);
    refused("--between-our-own-program 7",
            "unknown option --between-our-own-program; --help lists the options");
}

static void help_is_made_from_the_table(void **state) {
    (void)state;
    lw_support_ok(parse_and_print("--help"), &err); /* the missing SCENE does not matter */
    assert_true(done);
    assert_memory_equal(printed, "Usage: tester SCENE [OPTIONS]\n\n", 31);
    assert_non_null(strstr(printed, "\nExamples:\n  tester a.glb --sky 1,1,1\n\nOptions:\n"));
    for (size_t i = 0; i < sizeof table / sizeof *table; i++) {
        if (!table[i].help) continue;
        char heading[64];
        snprintf(heading, sizeof heading, "\n  %s%s%s%s  ", table[i].name[1] ? "--" : "-", table[i].name,
                 table[i].argument ? " " : "", table[i].argument ? table[i].argument : "");
        assert_non_null(strstr(printed, heading));
    }
    assert_non_null(strstr(printed, "Indirect bounces (default 2). [from 0 to 16]\n"));
    assert_non_null(strstr(printed, "up, or inf]\n"));
    assert_null(strstr(printed, "own-programs"));
    assert_non_null(strstr(printed, "  --help"));
    assert_non_null(strstr(printed, "  --version"));
    for (char *line = strtok(printed, "\n"); line; line = strtok(NULL, "\n")) {
        assert_true(strlen(line) <= 80);
        assert_true(line[strlen(line) - 1] != ' ');
    }
    lw_support_ok(parse_and_print("-h"), &err);
    assert_true(done && strlen(printed) > 500);
}

static void help_says_defaults_whatever_is_given(void **state) {
    (void)state;
    lw_support_ok(parse_and_print("--bounces 5 --tracing-range 3 --help"), &err);
    assert_non_null(strstr(printed, "Indirect bounces (default 2). [from 0 to 16]\n"));
    assert_non_null(strstr(printed, "(default inf)."));
    lw_support_ok(parse_and_print("--bounces 5 --help=man"), &err);
    assert_non_null(strstr(printed, "Indirect bounces (default 2). [from 0 to 16]\n"));
}

static void version_is_one_line(void **state) {
    (void)state;
    lw_support_ok(parse_and_print("--version"), &err);
    assert_true(done);
    assert_string_equal(printed, "tester " LW_VERSION "\n");
}

/* ---- addresses
 * ------------------------------------------------------------------------------------------------ */

static void addresses_split(void **state) {
    (void)state;
    char host[16];
    uint16_t port = 0;
    err = (struct lw_error){0};
    lw_support_ok(lw_options_address("127.0.0.1:7780", host, sizeof host, &port, &err), &err);
    assert_string_equal(host, "127.0.0.1");
    assert_int_equal(port, 7780);
    lw_support_ok(lw_options_address("[::1]:0", host, sizeof host, &port, &err), &err);
    assert_string_equal(host, "::1");
    assert_int_equal(port, 0);
    lw_support_ok(lw_options_address("a-name-of-15-ch:65535", host, sizeof host, &port, &err), &err);
    assert_int_equal(port, 65535);
    lw_support_ok(lw_options_address("example.org", host, sizeof host, &port, &err), &err);
    assert_string_equal(host, "example.org");
    assert_int_equal(port, LW_OPTIONS_PORT);
    port = 0;
    lw_support_ok(lw_options_address("[::1]", host, sizeof host, &port, &err), &err);
    assert_string_equal(host, "::1");
    assert_int_equal(port, LW_OPTIONS_PORT);
    lw_support_ok(lw_options_address_or("[::1]", 5, host, sizeof host, &port, &err), &err);
    assert_int_equal(port, 5);
    lw_support_ok(lw_options_address("99", host, sizeof host, &port, &err), &err);
    assert_string_equal(host, LW_OPTIONS_HOST);
    assert_int_equal(port, 99);
    lw_support_ok(lw_options_address(":80", host, sizeof host, &port, &err), &err);
    assert_string_equal(host, LW_OPTIONS_HOST);
    assert_int_equal(port, 80);
    static const char *const bad[] = {"",
                                      ":",
                                      "65536",
                                      ":80x",
                                      "::",
                                      "host:",
                                      "host:x",
                                      "host:80x",
                                      "host:65536",
                                      "host:-1",
                                      "host:+1",
                                      "host: 1",
                                      "::1:80",
                                      "[]:80",
                                      "::1",
                                      "[]",
                                      "[::1",
                                      "[::1]80",
                                      "[::1:80",
                                      "]:80",
                                      "host:99999999999999999999",
                                      "a-name-of-16-chs:80"};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        err = (struct lw_error){0};
        strcpy(host, "kept");
        port = 7;
        if (lw_options_address(bad[i], host, sizeof host, &port, &err) != LW_USAGE)
            fail_msg("\"%s\" was taken", bad[i]);
        assert_string_equal(host, "kept");
        assert_int_equal(port, 7);
        assert_true(strstr(err.text, bad[i]) || strlen(bad[i]) > 15);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(nothing_given_keeps_the_defaults),
        cmocka_unit_test(every_kind_and_both_forms),
        cmocka_unit_test(whole_numbers_are_strict),
        cmocka_unit_test(real_numbers_are_finite_unless_asked),
        cmocka_unit_test(colours_are_three),
        cmocka_unit_test(choices_are_whole_words),
        cmocka_unit_test(mistakes_are_named),
        cmocka_unit_test(two_dashes_end_the_options),
        cmocka_unit_test(an_option_without_help_is_taken_and_not_listed),
        cmocka_unit_test(help_is_made_from_the_table),
        cmocka_unit_test(help_says_defaults_whatever_is_given),
        cmocka_unit_test(version_is_one_line),
        cmocka_unit_test(addresses_split),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
