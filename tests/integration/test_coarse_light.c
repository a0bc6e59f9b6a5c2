/* A daemon's first light is coarse, and gives way to the light of the whole density. */
#include "tests/support/process.h"
#include "tests/support/support.h"

#include <signal.h>
#include <stdlib.h>
#include <string.h>

/* some 90,000 texels */
#define SCENE "builtin:cornell --texels-per-metre 60 --json"

/* What it says until `awaited`, stopped after that. out: its frames. Both to be freed. */
static char *serve_until(const char *arguments, const char *awaited, char **out) {
    struct lw_process daemon;
    lw_process_serve(&daemon, arguments);
    lw_process_await_text(&daemon, awaited);
    assert_int_equal(lw_process_stop(&daemon, SIGTERM, 20), 0);
    *out = lw_process_out(&daemon);
    return lw_process_err(&daemon);
}

static void detail_follows(void **state) {
    char *frames, *said = serve_until(SCENE, "all detail after", &frames);
    (void)state;
    const char *first = strstr(said, "first light after"), *coarse = strstr(said, ", coarse: ");
    assert_true(first && coarse && coarse > first && coarse < strchr(first, '\n'));
    const char *last_coarse = strstr(frames, "\"coarse\":1"), *whole = strstr(frames, "\"coarse\":0");
    assert_true(last_coarse && whole);
    for (const char *next; (next = strstr(last_coarse + 1, "\"coarse\":1"));) last_coarse = next;
    assert_true(last_coarse < whole);
    free(frames);
    free(said);
}

/* Asked for, or with frames counted, it begins with the whole density. */
static void others_begin_with_all_detail(void **state) {
    const char *const arguments[] = {SCENE " --first-light whole", SCENE " --frames 1000",
                                     SCENE " --clock step", "builtin:cornell --json"};
    (void)state;
    for (unsigned k = 0; k < sizeof arguments / sizeof *arguments; k++) {
        char *frames, *said = serve_until(arguments[k], "first light after", &frames);
        assert_null(strstr(said, "coarse"));
        assert_null(strstr(frames, "\"coarse\":1"));
        free(frames);
        free(said);
    }
}

/* Stopped while the solver of the whole density is built. */
static void it_stops_at_once(void **state) {
    char *frames, *said = serve_until(SCENE, "first light after", &frames);
    (void)state;
    assert_null(strstr(said, "ERROR"));
    free(frames);
    free(said);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(detail_follows, lw_process_teardown),
        cmocka_unit_test_teardown(others_begin_with_all_detail, lw_process_teardown),
        cmocka_unit_test_teardown(it_stops_at_once, lw_process_teardown),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
