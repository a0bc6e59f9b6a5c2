#include "tests/support/support.h"

#include "client/view/font.h"

#include <string.h>

#define WIDTH  64
#define HEIGHT 24
#define LEFT   3
#define TOP    4

/* Rows of the canvas, counted from the text's upper edge, that a text colours: the first and the last. */
static void rows_of(const char *text, int scale, int *first, int *last) {
    uint32_t pixel[WIDTH * HEIGHT] = {0};
    struct lw_font_canvas canvas = {.pixel = pixel, .width = WIDTH, .height = HEIGHT, .stride = WIDTH};
    lw_font_draw(&canvas, LEFT, TOP, scale, 7, text);
    *first = HEIGHT, *last = -1;
    for (int y = 0; y < HEIGHT; y++)
        for (int x = 0; x < WIDTH; x++) {
            if (!pixel[y * WIDTH + x]) continue;
            assert_true(x >= LEFT && x < LEFT + lw_font_width(text, scale));
            if (*first == HEIGHT) *first = y - TOP;
            *last = y - TOP;
        }
}

static void test_descenders_reach_below_the_line(void **state) {
    (void)state;
    const char *const plain[] = {"a", "x", "n", "o", "A", "H", "0", "9", ".", "d"};
    const char *const deep[] = {"g", "j", "p", "q", "y", ",", ";"};
    int first, last;
    for (size_t i = 0; i < sizeof plain / sizeof *plain; i++) {
        rows_of(plain[i], 1, &first, &last);
        assert_int_equal(last, LW_FONT_BASELINE - 1);
    }
    for (size_t i = 0; i < sizeof deep / sizeof *deep; i++) {
        rows_of(deep[i], 1, &first, &last);
        assert_true(last >= LW_FONT_BASELINE && last < LW_FONT_HEIGHT);
        rows_of(deep[i], 2, &first, &last); /* whole at any scale */
        assert_true(last >= 2 * LW_FONT_BASELINE + 1 && last < 2 * LW_FONT_HEIGHT);
    }
    /* a letter's body is as high as any other's: the descender comes on top of that */
    const char *const bodies[] = {"g", "p", "q", "y"};
    rows_of("x", 1, &first, &last);
    const int top = first;
    for (size_t i = 0; i < sizeof bodies / sizeof *bodies; i++) {
        rows_of(bodies[i], 1, &first, &last);
        assert_int_equal(first, top);
        assert_int_equal(last, LW_FONT_HEIGHT - 1);
    }
}

static void test_every_character_differs(void **state) {
    (void)state;
    uint32_t pixel[95][LW_FONT_WIDTH * LW_FONT_HEIGHT] = {0};
    for (int c = 0; c < 95; c++) {
        struct lw_font_canvas canvas = {
            .pixel = pixel[c], .width = LW_FONT_WIDTH, .height = LW_FONT_HEIGHT, .stride = LW_FONT_WIDTH};
        lw_font_draw(&canvas, 0, 0, 1, 7, (char[]){(char)(32 + c), 0});
        for (int b = 0; b < c; b++)
            if (memcmp(pixel[b], pixel[c], sizeof pixel[c]) == 0)
                fail_msg("'%c' looks like '%c'", 32 + c, 32 + b);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_descenders_reach_below_the_line),
        cmocka_unit_test(test_every_character_differs),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
