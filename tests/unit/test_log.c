#include "tests/support/support.h"

#include "common/base/log.h"

#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

static char text[1 << 20]; /* what stderr received */
static int real_stderr, captured;

static int start_capture(void **state) {
    (void)state;
    char name[] = "/tmp/lw-log-XXXXXX";
    captured = mkstemp(name);
    if (captured < 0) return -1;
    unlink(name);
    real_stderr = dup(STDERR_FILENO);
    dup2(captured, STDERR_FILENO);
    return 0;
}

static const char *end_capture(void) {
    dup2(real_stderr, STDERR_FILENO);
    close(real_stderr);
    ssize_t size = pread(captured, text, sizeof text - 1, 0);
    close(captured);
    text[size > 0 ? size : 0] = 0;
    return text;
}

static void each_level_says_what_it_is(void **state) {
    (void)state;
    lw_log_init("tester", LW_LOG_DEBUG);
    lw_log(LW_LOG_ERROR, "a %d", 1);
    lw_log(LW_LOG_WARNING, "b");
    lw_log(LW_LOG_INFO, "c");
    lw_log(LW_LOG_DEBUG, "d");
    assert_string_equal(end_capture(),
                        "tester: error: a 1\ntester: warning: b\ntester: c\ntester: debug: d\n");
}

static void talk_beyond_the_level_is_silent(void **state) {
    (void)state;
    lw_log_init("tester", LW_LOG_WARNING);
    assert_true(lw_log_shows(LW_LOG_WARNING));
    assert_false(lw_log_shows(LW_LOG_INFO));
    lw_log(LW_LOG_INFO, "no");
    lw_log(LW_LOG_WARNING, "yes");
    assert_string_equal(end_capture(), "tester: warning: yes\n");
}

static void a_line_stays_one_line_and_bounded(void **state) {
    (void)state;
    lw_log_init("tester", LW_LOG_INFO);
    lw_log(LW_LOG_INFO, "a\nb\033[31m");
    char longer[5000];
    memset(longer, 'x', sizeof longer - 1);
    longer[sizeof longer - 1] = 0;
    lw_log(LW_LOG_INFO, "%s", longer);
    const char *out = end_capture();
    assert_memory_equal(out, "tester: a?b?[31m\n", 17);
    assert_true(strlen(out) < 17 + 1024);
    assert_ptr_equal(strchr(out + 17, '\n'), out + strlen(out) - 1);
}

static void a_failure_gives_its_exit_code(void **state) {
    (void)state;
    lw_log_init("tester", LW_LOG_INFO);
    struct lw_error none = {0}, err = {.status = LW_BAD_DATA, .text = "x.glb: bad"},
                    bare = {.status = LW_NO_MEMORY}, what = {.status = LW_NO_MEMORY, .text = "9 texels"},
                    failure = {.status = LW_NO_MEMORY, .text = "x.glb: out of memory"};
    int codes[] = {lw_log_failure(&none), lw_log_failure(&err), lw_log_failure(&bare), lw_log_failure(&what),
                   lw_log_failure(&failure)};
    assert_string_equal(end_capture(), "tester: error: x.glb: bad\ntester: error: out of memory\n"
                                       "tester: error: out of memory: 9 texels\n"
                                       "tester: error: x.glb: out of memory\n");
    assert_int_equal(codes[0], 0);
    assert_int_equal(codes[1], 65);
    assert_int_equal(codes[2], 71);
    assert_int_equal(codes[3], 71);
}

/* "time" apart, which is checked for its form. */
static const char *without_time(const char *line) {
    static const char form[] = "{\"time\":\"dddd-dd-ddTdd:dd:dd.dddZ\",";
    for (size_t i = 0; i < sizeof form - 1; i++)
        if (form[i] == 'd' && i > 8 ? line[i] < '0' || line[i] > '9' : line[i] != form[i])
            fail_msg("no time at the beginning of: %s", line);
    return line + sizeof form - 1;
}

static void json_has_one_object_a_line(void **state) {
    (void)state;
    lw_log_init("tester", LW_LOG_DEBUG);
    lw_log_set_format(LW_LOG_JSON);
    lw_log(LW_LOG_WARNING, "a \"quoted\" \\ name\nand \303\251, \xff, \355\240\200");
    const char *out = end_capture();
    lw_log_set_format(LW_LOG_TEXT);
    assert_string_equal(without_time(out), "\"level\":\"warning\",\"program\":\"tester\",\"message\":"
                                           "\"a \\\"quoted\\\" \\\\ name?and \303\251, ?, ???\"}\n");
}

/* The year and day of the line's time are the system's. */
static void json_tells_the_time(void **state) {
    (void)state;
    char before[32], after[32];
    time_t now = time(NULL);
    strftime(before, sizeof before, "%Y-%m-%dT%H:%M", gmtime(&now));
    lw_log_init("tester", LW_LOG_INFO);
    lw_log_set_format(LW_LOG_JSON);
    lw_log(LW_LOG_INFO, "x");
    now = time(NULL);
    strftime(after, sizeof after, "%Y-%m-%dT%H:%M", gmtime(&now));
    const char *out = end_capture() + strlen("{\"time\":\"");
    lw_log_set_format(LW_LOG_TEXT);
    assert_true(memcmp(out, before, strlen(before)) == 0 || memcmp(out, after, strlen(after)) == 0);
}

static void json_is_bounded(void **state) {
    (void)state;
    lw_log_init("tester", LW_LOG_INFO);
    lw_log_set_format(LW_LOG_JSON);
    char longer[5000];
    memset(longer, '"', sizeof longer - 1);
    longer[sizeof longer - 1] = 0;
    lw_log(LW_LOG_INFO, "%s", longer);
    const char *out = end_capture();
    lw_log_set_format(LW_LOG_TEXT);
    const size_t size = strlen(out);
    assert_true(size > 1000 && size < 2400);
    assert_string_equal(out + size - 5, "\\\"\"}\n");
    size_t quotes = 0, backslashes = 0;
    for (const char *c = strstr(out, "\"message\":\"") + 11; *c; c++)
        quotes += *c == '"', backslashes += *c == '\\';
    assert_int_equal(quotes, backslashes + 1);
}

static void a_handlers_line_has_the_same_form(void **state) {
    (void)state;
    lw_log_init("tester", LW_LOG_INFO);
    lw_log_set_format(LW_LOG_JSON);
    lw_log_in_handler("stopping");
    const char *out = end_capture();
    lw_log_set_format(LW_LOG_TEXT);
    assert_string_equal(without_time(out),
                        "\"level\":\"info\",\"program\":\"tester\",\"message\":\"stopping\"}\n");
}

static void auto_is_json_where_there_is_no_terminal(void **state) {
    (void)state; /* stderr is a file */
    lw_log_set_format(LW_LOG_AUTO);
    const enum lw_log_format format = lw_log_get_format();
    lw_log_set_format(LW_LOG_TEXT);
    end_capture();
    assert_int_equal(format, LW_LOG_JSON);
}

enum { THREADS = 4, LINES = 500 };

static void *chatter(void *name) {
    for (int i = 0; i < LINES; i++)
        lw_log(LW_LOG_INFO, "%s%s%s%s", (char *)name, (char *)name, (char *)name, (char *)name);
    return NULL;
}

static void lines_of_threads_never_interleave(void **state) {
    (void)state;
    lw_log_init("tester", LW_LOG_INFO);
    char names[THREADS][2] = {"a", "b", "c", "d"};
    pthread_t threads[THREADS];
    for (int t = 0; t < THREADS; t++) pthread_create(&threads[t], NULL, chatter, names[t]);
    for (int t = 0; t < THREADS; t++) pthread_join(threads[t], NULL);
    end_capture();
    unsigned count = 0;
    for (char *line = strtok(text, "\n"); line; line = strtok(NULL, "\n"), count++) {
        assert_int_equal(strlen(line), strlen("tester: aaaa"));
        assert_memory_equal(line, "tester: ", 8);
        assert_true(line[8] == line[9] && line[8] == line[10] && line[8] == line[11]);
    }
    assert_int_equal(count, THREADS * LINES);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup(each_level_says_what_it_is, start_capture),
        cmocka_unit_test_setup(talk_beyond_the_level_is_silent, start_capture),
        cmocka_unit_test_setup(a_line_stays_one_line_and_bounded, start_capture),
        cmocka_unit_test_setup(a_failure_gives_its_exit_code, start_capture),
        cmocka_unit_test_setup(json_has_one_object_a_line, start_capture),
        cmocka_unit_test_setup(json_tells_the_time, start_capture),
        cmocka_unit_test_setup(json_is_bounded, start_capture),
        cmocka_unit_test_setup(a_handlers_line_has_the_same_form, start_capture),
        cmocka_unit_test_setup(auto_is_json_where_there_is_no_terminal, start_capture),
        cmocka_unit_test_setup(lines_of_threads_never_interleave, start_capture),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
