#include "tests/support/support.h"

#include "common/base/status.h"

#include <string.h>

static void every_status_has_a_text_and_an_exit_code(void **state) {
    (void)state;
    for (int s = 0; s < LW_STATUS_COUNT; s++) {
        assert_true(strlen(lw_status_text((enum lw_status)s)) > 3);
        for (int other = 0; other < s; other++)
            assert_string_not_equal(lw_status_text((enum lw_status)s), lw_status_text((enum lw_status)other));
    }
    assert_int_equal(lw_status_exit_code(LW_OK), 0);
    assert_int_equal(lw_status_exit_code(LW_USAGE), 64);
    assert_int_equal(lw_status_exit_code(LW_BAD_DATA), 65);
    assert_int_equal(lw_status_exit_code(LW_CANNOT_CREATE), 73);
    for (int s = 1; s < LW_STATUS_COUNT; s++) {
        assert_in_range(lw_status_exit_code((enum lw_status)s), 64, 78);
    }
    /* a value from nowhere, as a peer might send: a text, and no success */
    assert_non_null(lw_status_text((enum lw_status)12345));
    assert_int_equal(lw_status_exit_code((enum lw_status)12345), 70);
    assert_int_equal(lw_status_exit_code((enum lw_status) - 1), 70);
}

static void the_first_cause_wins(void **state) {
    (void)state;
    struct lw_error err = {0};
    assert_int_equal(lw_status_fail(&err, LW_IO, "disk %d", 7), LW_IO);
    assert_int_equal(lw_status_fail(&err, LW_NO_MEMORY, "later"), LW_NO_MEMORY);
    assert_int_equal(err.status, LW_IO);
    assert_string_equal(err.text, "disk 7");
    assert_int_equal(lw_status_fail(NULL, LW_TIMED_OUT, "nobody asked"), LW_TIMED_OUT);
}

static void context_goes_in_front(void **state) {
    (void)state;
    struct lw_error err = {0};
    lw_status_context(&err, "nothing happened");
    assert_string_equal(err.text, "");
    (void)lw_status_fail(&err, LW_BAD_DATA, "bad count");
    lw_status_context(&err, "mesh %d", 3);
    lw_status_context(&err, "a.glb");
    assert_string_equal(err.text, "a.glb: mesh 3: bad count");
    assert_int_equal(err.status, LW_BAD_DATA);
    lw_status_context(NULL, "nobody");
}

static void long_texts_are_cut_and_keep_the_cause(void **state) {
    (void)state;
    char longer[2 * LW_ERROR_TEXT_SIZE];
    memset(longer, 'a', sizeof longer - 1);
    longer[sizeof longer - 1] = 0;
    struct lw_error err = {0};
    (void)lw_status_fail(&err, LW_IO, "the cause");
    lw_status_context(&err, "%s", longer);
    assert_int_equal(strlen(err.text), sizeof err.text - 1);
    assert_string_equal(err.text + strlen(err.text) - strlen("aa: the cause"), "aa: the cause");

    err = (struct lw_error){0};
    (void)lw_status_fail(&err, LW_IO, "%s", longer);
    assert_int_equal(strlen(err.text), sizeof err.text - 1);
    for (int i = 0; i < 3; i++) { /* no room at all: the cause stays */
        lw_status_context(&err, "context");
        assert_int_equal(err.text[0], 'a');
    }
    /* one character of room */
    for (size_t length = sizeof err.text - 8; length < sizeof err.text; length++) {
        err = (struct lw_error){0};
        (void)lw_status_fail(&err, LW_IO, "%.*s", (int)length, longer);
        lw_status_context(&err, "context");
        assert_true(strlen(err.text) < sizeof err.text);
        assert_true(err.text[strlen(err.text) - 1] == 'a');
    }
}

static void names_cannot_break_the_line_or_drive_the_terminal(void **state) {
    (void)state;
    struct lw_error err = {0};
    (void)lw_status_fail(&err, LW_BAD_DATA, "object \"%s\"", "a\nb\033[2J\x7f caf\xc3\xa9");
    assert_string_equal(err.text, "object \"a?b?[2J? caf\xc3\xa9\"");
    lw_status_context(&err, "file\r\t%s", "x");
    assert_string_equal(err.text, "file??x: object \"a?b?[2J? caf\xc3\xa9\"");
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_status_has_a_text_and_an_exit_code),
        cmocka_unit_test(the_first_cause_wins),
        cmocka_unit_test(context_goes_in_front),
        cmocka_unit_test(long_texts_are_cut_and_keep_the_cause),
        cmocka_unit_test(names_cannot_break_the_line_or_drive_the_terminal),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
