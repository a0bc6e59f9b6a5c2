/* test_options_value.c: values as text, and the defaults that help says. */
#include "tests/support/support.h"

#include "common/base/options_value.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static struct values {
    bool flag;
    int64_t whole;
    double real;
    const char *text;
    float colour[3];
    int choice;
} values;

enum { FLAG, WHOLE, REAL, TEXT, COLOUR, CHOICE, COUNT };

static const struct lw_option table[COUNT] = {
    [FLAG] = {"flag", NULL, "no place", LW_OPTION_FLAG, &values.flag, 0, 0, NULL},
    [WHOLE] = {"whole", "N", "a number (default {})", LW_OPTION_INT, &values.whole, -0x1p63, 0x1p63, NULL},
    [REAL] = {"real", "X", "(default {}; {} again)", LW_OPTION_REAL, &values.real, 0, (double)INFINITY, NULL},
    [TEXT] = {"text", "fast|slow:KBPS", "at once{fast}; or {slow:1|as slow as }that", LW_OPTION_STRING,
              &values.text, 0, 0, NULL},
    [COLOUR] = {"colour", "R,G,B", "{}", LW_OPTION_RGB, values.colour, 0, 9, NULL},
    [CHOICE] = {"choice", "half|dct|dct-fine",
                "half: floats{half}. dct: less{dct}. ({dct-fine|default; }best)", LW_OPTION_CHOICE,
                &values.choice, 0, 0, NULL},
};

static const struct lw_options options = {.program = "tester", .table = table, .count = COUNT};

typedef void writer(const struct lw_option *o, FILE *stream);

/* The text that a function writes; the caller frees. */
static char *written(writer *write, int option) {
    char *text = NULL;
    size_t size;
    FILE *stream = open_memstream(&text, &size);
    assert_non_null(stream);
    write(&table[option], stream);
    assert_int_equal(fclose(stream), 0);
    return text;
}

static void expect_help(int option, const char *expected) {
    char *text = written(lw_options_value_write_help, option);
    assert_string_equal(text, expected);
    free(text);
}

static void values_are_read_as_they_are_written(void **state) {
    (void)state;
    static const struct {
        int option;
        const char *text;
    } cases[] = {
        {FLAG, "true"},  {FLAG, "false"},      {WHOLE, "0"},     {WHOLE, "-9223372036854775807"},
        {REAL, "0.1"},   {REAL, "1e-06"},      {REAL, "inf"},    {REAL, "0.30000000000000004"},
        {REAL, "1000"},  {TEXT, ""},           {TEXT, "a b={}"}, {COLOUR, "0,0.25,3.1"},
        {CHOICE, "dct"}, {CHOICE, "dct-fine"}, {CHOICE, "half"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct lw_error err = {0};
        lw_support_ok(lw_options_set(&options, table[cases[i].option].name, cases[i].text, &err), &err);
        char *text = written(lw_options_value_write, cases[i].option);
        assert_string_equal(text, cases[i].text);
        free(text);
    }
}

static void a_float_is_as_short_as_a_person_writes_it(void **state) {
    (void)state;
    values.real = (double)0.02f;
    expect_help(REAL, "(default 0.02; 0.02 again)");
}

static void help_has_the_value_in_its_place(void **state) {
    (void)state;
    values = (struct values){.whole = 7, .real = (double)INFINITY, .colour = {1, 0.5f, 0}, .text = "fast"};
    expect_help(FLAG, "no place");
    expect_help(WHOLE, "a number (default 7)");
    expect_help(REAL, "(default inf; inf again)");
    expect_help(COLOUR, "1,0.5,0");
    values.whole = 8;
    expect_help(WHOLE, "a number (default 8)");
}

/* A word is the whole word: dct is no dct-fine. */
static void the_word_of_the_default_is_marked(void **state) {
    (void)state;
    static const char *const choices[] = {"half: floats (default). dct: less. (best)",
                                          "half: floats. dct: less (default). (best)",
                                          "half: floats. dct: less. (default; best)"};
    for (values.choice = 0; values.choice < 3; values.choice++) expect_help(CHOICE, choices[values.choice]);
    values.text = "fast";
    expect_help(TEXT, "at once (default); or that");
    values.text = "slow:1";
    expect_help(TEXT, "at once; or as slow as that");
    values.text = NULL;
    expect_help(TEXT, "at once; or that");
}

static void a_filled_table_keeps_what_it_was_filled_with(void **state) {
    (void)state;
    values = (struct values){.whole = 1, .text = "fast"};
    struct lw_option *filled = lw_options_value_fill(table, COUNT);
    assert_non_null(filled);
    values.whole = 2;
    assert_string_equal(filled[WHOLE].help, "a number (default 1)");
    assert_ptr_equal(filled[WHOLE].value, &values.whole);
    lw_options_value_free(filled, COUNT);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(values_are_read_as_they_are_written),
        cmocka_unit_test(a_float_is_as_short_as_a_person_writes_it),
        cmocka_unit_test(help_has_the_value_in_its_place),
        cmocka_unit_test(the_word_of_the_default_is_marked),
        cmocka_unit_test(a_filled_table_keeps_what_it_was_filled_with),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
