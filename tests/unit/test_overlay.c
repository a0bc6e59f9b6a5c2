#include "tests/support/support.h"

#include "client/view/window/overlay.h"

#include <string.h>

static void assert_says(const struct lw_overlay_state *state, const char *expected) {
    char text[LW_OVERLAY_LINE_SIZE];
    lw_overlay_state(state, text);
    assert_string_equal(text, expected);
}

static void test_state(void **unused) {
    (void)unused;
    struct lw_overlay_state s = {0};
    assert_says(&s, "waiting for the first light");
    s.waiting = (struct lw_waiting_state){LW_WAITING_LOOKING_INSIDE, 0.42f};
    assert_says(&s, "looking inside objects, 42 %");
    s.waiting = (struct lw_waiting_state){LW_WAITING_READY, 1};
    assert_says(&s, "light is arriving");
    s.lit = true;
    s.report = (struct lw_compose_report){
        .tiles_needed = 90, .tiles_missing = 5, .tiles_unfinished = 7, .shown_error = 1};
    assert_says(&s, "light is arriving, 86 %");
    s.report.tiles_missing = s.report.tiles_needed;
    assert_says(&s, "light is arriving, 0 %");
    s.report = (struct lw_compose_report){.tiles_needed = 0, .shown_error = 1};
    assert_says(&s, "light is arriving, 0 %"); /* nothing is known of the view yet */
    s.report = (struct lw_compose_report){.tiles_needed = 90, .tiles_noisy = 9, .shown_error = 1};
    s.report.complete = true;
    assert_says(&s, "sharpening"); /* nothing is known of the error yet */
    s.report.shown_error = INFINITY;
    assert_says(&s, "sharpening");
    s.report.shown_error = NAN;
    assert_says(&s, "sharpening");
    s.report.shown_error = 0.123f;
    s.report.max_error = 1; /* one tile's error, perhaps a single pixel's */
    assert_says(&s, "sharpening, 4 %");
    s.report.shown_error = 0.029f;
    assert_says(&s, "sharpening, 80 %");
    s.report.shown_error = 0.0260001f;
    assert_says(&s, "sharpening, 99 %"); /* not 100 before it is */
    s.report.shown_error = 0.019f;
    s.report.good = true;
    assert_says(&s, "good, the last noise is fading");
    s.report.converged = true;
    assert_says(&s, "finished");
    s.lost = true;
    assert_says(&s, "server gone: looking for it");
    s.receiving = true;
    assert_says(&s, "server is back: receiving");
}

static void test_keys(void **unused) {
    (void)unused;
    for (int i = 0; i < LW_OVERLAY_KEYS; i++) {
        assert_true(strlen(lw_overlay_keys[i]) < LW_OVERLAY_LINE_SIZE);
        assert_null(strchr(lw_overlay_keys[i], '\n'));
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_state),
        cmocka_unit_test(test_keys),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
