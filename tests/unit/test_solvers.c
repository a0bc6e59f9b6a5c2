#include "tests/support/support.h"

#include "server/solve/solvers.h"

#include <string.h>

static void test_every_name_is_found(void **state) {
    (void)state;
    const struct lw_solvers_entry *entry, *found;
    struct lw_error err = {0};
    char names[128];
    lw_solvers_list(names, sizeof names);
    unsigned count = 0;
    for (; (entry = lw_solvers_at(count)); count++) {
        lw_support_ok(lw_solvers_find(entry->name, &found, &err), &err);
        assert_ptr_equal(found, entry);
        assert_non_null(strstr(names, entry->name));
        assert_true(strlen(entry->about) > 0);
    }
    assert_true(count > 0);
    lw_support_ok(lw_solvers_find(NULL, &found, &err), &err);
    assert_ptr_equal(found, lw_solvers_at(0));
}

static void test_an_unknown_name_lists_those_there_are(void **state) {
    (void)state;
    const struct lw_solvers_entry *none = NULL;
    struct lw_solver *solver = NULL;
    struct lw_error err = {0};
    char names[128];
    lw_solvers_list(names, sizeof names);
    lw_support_fails(lw_solvers_find("voxels", &none, &err), LW_USAGE, &err, "\"voxels\"");
    assert_non_null(strstr(err.text, names));
    assert_null(none);
    err = (struct lw_error){0};
    lw_support_fails(lw_solvers_create("", &(struct lw_solver_desc){0}, NULL, &solver, &err), LW_USAGE, &err,
                     names);
    assert_null(solver);
}

static void test_a_list_is_cut_off(void **state) {
    (void)state;
    char few[4] = "xyz", none = 'x';
    lw_solvers_list(few, sizeof few);
    assert_int_equal(strlen(few), 3);
    lw_solvers_list(&none, 0);
    assert_int_equal(none, 'x');
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_every_name_is_found),
                                       cmocka_unit_test(test_an_unknown_name_lists_those_there_are),
                                       cmocka_unit_test(test_a_list_is_cut_off)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
