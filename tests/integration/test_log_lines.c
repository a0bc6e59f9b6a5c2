/* The real lightwelld's lines: JSON where nobody looks at them, as many as are asked for, without secrets. */
#include "tests/support/process.h"

#include <jansson.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#define LIMIT_S LW_PROCESS_LIMIT_S
#define SCENE   "builtin:cornell --texels-per-metre 8 --light whole --frames 2 --http none "

static char *run(const char *arguments) {
    struct lw_process daemon;
    lw_process_serve(&daemon, arguments);
    lw_process_expect(&daemon, lw_process_finish(&daemon, LIMIT_S), 0);
    return lw_process_err(&daemon);
}

/* A scene file, so that the importer says something, too. */
static void test_json(void **state) {
    (void)state;
    char line[1024];
    snprintf(line, sizeof line,
             "%s --sky 1,1,1 --light whole --frames 2 --http none --log-format auto --log-level debug",
             lw_support_source("tests/fuzz/corpus/fuzz_gltf/base.gltf"));
    char *text = run(line);
    unsigned count = 0, debug = 0;
    bool stopped = false;
    for (char *at = strtok(text, "\n"); at; at = strtok(NULL, "\n"), count++) {
        json_error_t error;
        json_t *object = json_loads(at, JSON_REJECT_DUPLICATES, &error);
        if (!object) fail_msg("no JSON: %s: %s", error.text, at);
        assert_int_equal(json_object_size(object), 4);
        static const char *const keys[] = {"time", "level", "program", "message"};
        for (size_t i = 0; i < sizeof keys / sizeof *keys; i++)
            if (!json_is_string(json_object_get(object, keys[i]))) fail_msg("no %s in: %s", keys[i], at);
        stopped |= strcmp(json_string_value(json_object_get(object, "message")), "stopped") == 0;
        debug += strcmp(json_string_value(json_object_get(object, "level")), "debug") == 0;
        json_decref(object);
    }
    free(text);
    assert_true(count > 4 && stopped && debug >= 1);
}

static void test_level(void **state) {
    (void)state;
    char *text = run(SCENE "--log-format text --log-level warning --control-socket none");
    assert_string_equal(text, "");
    free(text);
}

/* Tokens, right and wrong ones, and the most talkative log. */
static void test_no_secrets(void **state) {
    (void)state;
    static const char right[] = "0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef";
    static const char wrong[] = "fedcba9876543210fedcba9876543210fedcba9876543210fedcba9876543210";
    char tokens[512], other[512], text[128], line[2048];
    snprintf(tokens, sizeof tokens, "%s", lw_support_temporary("tokens"));
    snprintf(text, sizeof text, "control %s\n", right);
    lw_support_write_file(tokens, text, strlen(text));
    snprintf(other, sizeof other, "%s", lw_support_temporary("other"));
    lw_support_write_file(other, wrong, strlen(wrong));
    assert_int_equal(chmod(tokens, 0600) | chmod(other, 0600), 0);

    struct lw_process daemon, ctl;
    snprintf(line, sizeof line,
             "builtin:cornell --texels-per-metre 8 --http none --log-level debug --control-socket none "
             "--tokens %s",
             tokens);
    lw_process_serve(&daemon, line);
    snprintf(line, sizeof line, "127.0.0.1:%u --token-file %s light lamp off", daemon.port, other);
    lw_process_run(&ctl, "lightwellctl", line, 77);
    snprintf(line, sizeof line, "127.0.0.1:%u --token-file %s list", daemon.port, tokens);
    lw_process_run(&ctl, "lightwellctl", line, 0);
    lw_process_expect(&daemon, lw_process_stop(&daemon, SIGTERM, LIMIT_S), 0);
    char *said = lw_process_err(&daemon);
    assert_non_null(strstr(said, "session 1"));
    /* not even a part of one */
    assert_null(strstr(said, "0123456789abcdef"));
    assert_null(strstr(said, "fedcba9876543210"));
    free(said);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(test_json, lw_process_teardown),
        cmocka_unit_test_teardown(test_level, lw_process_teardown),
        cmocka_unit_test_teardown(test_no_secrets, lw_process_teardown),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
