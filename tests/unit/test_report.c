#include "tests/support/support.h"

#include "client/measure/report.h"
#include "common/base/folders.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* What a print function writes. */
static char *text_of(void (*print)(struct lw_report *report, const void *context)) {
    const struct lw_report_file file = {"text", print};
    struct lw_error err = {0};
    char *text;
    size_t size;
    lw_support_ok(lw_report_print(&file, NULL, &text, &size, &err), &err);
    assert_int_equal(strlen(text), size);
    return text;
}

static void print_tables(struct lw_report *out, const void *context) {
    (void)context;
    lw_report_section(out, "Costs", "CPU s.");
    lw_report_cell(out, "%s | %s", "renderer", "all");
    lw_report_head(out, "one | lag");
    lw_report_row(out, "%s | %u | %.2f | %s", "raw", 2, 0.5, "");
    lw_report_cell(out, "cache");
    lw_report_number(out, 3);
    lw_report_number(out, (double)INFINITY);
    lw_report_number(out, (double)NAN);
    lw_report_end_row(out);
    lw_report_paragraph(out, "\n%u %%", 5);
    lw_report_head(out, "alone");
    lw_report_cell(out, "x");
    lw_report_head(out, NULL);
}

/* A head has as many columns as its titles, however they were added. */
static void a_table_has_a_rule_below_its_titles(void **state) {
    (void)state;
    char *text = text_of(print_tables);
    assert_string_equal(text, "## Costs\n\nCPU s.\n\n"
                              "| renderer | all | one | lag |\n|---|---|---|---|\n"
                              "| raw | 2 | 0.50 |  |\n| cache | 3 | – | – |\n\n5 %\n\n"
                              "| alone |\n|---|\n| x |\n|---|\n");
    free(text);
}

static void print_plots(struct lw_report *out, const void *context) {
    static const struct lw_report_plot plot[2] = {{"a", 6, 4}, {"b", 3, 2}};
    (void)context;
    for (int p = 0; p < 2; p++) {
        lw_report_plot(out, &plot[p]);
        lw_report_series(out, "first", "'%s.csv' using 1:%d", plot[p].name, 2);
        lw_report_series(out, "second", "'%s.csv' using 1:%d", plot[p].name, 3);
        lw_report_end_plot(out, &plot[p]);
    }
}

static void each_plot_has_its_own_series(void **state) {
    (void)state;
    char *text = text_of(print_plots);
    assert_non_null(strstr(text,
                           "set output 'a.png'\nplot 'a.csv' using 1:2 title 'first', 'a.csv' using 1:3 "
                           "title 'second'\nset terminal svg size 6,4 "));
    assert_non_null(strstr(text, "set output 'b.png'\nplot 'b.csv' using 1:2 title 'first', "));
    assert_non_null(strstr(text, "set output 'b.svg'\nreplot\nunset output\n"));
    free(text);
}

static void print_word(struct lw_report *out, const void *context) {
    fprintf(out->f, "%s", (const char *)context);
}

/* The file before the one that cannot be made is there, the one after it is not. */
static void files_are_saved_up_to_the_first_failure(void **state) {
    (void)state;
    static const struct lw_report_file files[] = {
        {"first", print_word}, {"nowhere/second", print_word}, {"third", print_word}};
    const char *folder = lw_support_temporary("saved");
    struct lw_error err = {0};
    char path[300];
    lw_support_ok(lw_folders_make(folder, &err), &err);
    lw_support_fails(lw_report_save(folder, files, 3, "word", &err), LW_CANNOT_CREATE, &err,
                     "nowhere/second");
    char *text = lw_support_read_text(folder, "first");
    assert_string_equal(text, "word");
    free(text);
    snprintf(path, sizeof path, "%s/third", folder);
    assert_null(fopen(path, "re"));
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(a_table_has_a_rule_below_its_titles),
                                       cmocka_unit_test(each_plot_has_its_own_series),
                                       cmocka_unit_test(files_are_saved_up_to_the_first_failure)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
