#include "tests/support/support.h"

#include "client/view/window/panel.h"

static void test_scale(void **state) {
    (void)state;
    assert_int_equal(lw_panel_scale(720, 720), 2);
    assert_int_equal(lw_panel_scale(720, 1440), 4); /* a dense screen: as large to the eye */
    assert_int_equal(lw_panel_scale(800, 1200), 3);
    assert_int_equal(lw_panel_scale(240, 240), 1); /* a small window */
    assert_int_equal(lw_panel_scale(0, 0), 1);
    assert_int_equal(lw_panel_scale(1, 16384), 16);
}

static void test_draws(void **state) {
    (void)state;
    struct lw_panel panel = {.scale = 2};
    struct lw_error err = {0};
    const char *const lines[] = {"one", "a longer line"};
    lw_support_ok(lw_panel_draw(&panel, lines, 2, -1, LW_PANEL_TEXT, &err), &err);
    const int width = panel.width, height = panel.height;
    int lit = 0;
    for (int i = 0; i < width * height; i++) lit += panel.pixel[i] == LW_PANEL_TEXT;
    assert_true(lit > 100 && lit < width * height / 2);
    lw_support_ok(lw_panel_draw(&panel, lines, 2, 2, LW_PANEL_TEXT, &err),
                  &err); /* with a bar, which is full */
    assert_true(panel.height > height && panel.width > width);
    panel.scale = 4;
    lw_support_ok(lw_panel_draw(&panel, lines, 2, -1, LW_PANEL_TEXT, &err), &err);
    assert_int_equal(panel.width, 2 * width);
    assert_int_equal(panel.height, 2 * height);
    lw_panel_finish(&panel);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_scale),
        cmocka_unit_test(test_draws),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
