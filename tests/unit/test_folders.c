#include "tests/support/support.h"

#include "common/base/folders.h"

#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static void temporary_folders_are_where_the_user_wants_them(void **state) {
    (void)state;
    char path[PATH_MAX], file[PATH_MAX + 8];
    struct stat st;
    struct lw_error err = {0};
    assert_int_equal(mkdir(lw_support_temporary("there"), 0700), 0);
    setenv("TMPDIR", lw_support_temporary("there"), 1);
    lw_support_ok(lw_folders_make_temporary(path, sizeof path, &err), &err);
    assert_memory_equal(path, lw_support_temporary("there/"), strlen(lw_support_temporary("there/")));
    assert_int_equal(stat(path, &st), 0);
    assert_int_equal(st.st_mode & 0777, 0700);
    snprintf(file, sizeof file, "%s/file", path);
    lw_support_write_file(file, "", 0);
    lw_folders_remove_temporary(path);
    assert_int_equal(access(path, F_OK), -1);
    assert_int_equal(rmdir(lw_support_temporary("there")), 0); /* it is empty again */
    lw_folders_remove_temporary("");
    unsetenv("TMPDIR");
    assert_string_equal(lw_folders_temporary(), "/tmp");
    setenv("TMPDIR", "", 1);
    assert_string_equal(lw_folders_temporary(), "/tmp");
}

static void a_folder_is_made_once(void **state) {
    (void)state;
    struct lw_error err = {0};
    const char *folder = lw_support_temporary("made");
    lw_support_ok(lw_folders_make(folder, &err), &err);
    lw_support_ok(lw_folders_make(folder, &err), &err);
    lw_support_fails(lw_folders_make("/dev/null", &err), LW_CANNOT_CREATE, &err,
                     "/dev/null: cannot make the folder: Not a directory");
    err = (struct lw_error){0};
    lw_support_fails(lw_folders_make("/nonexistent/folder", &err), LW_CANNOT_CREATE, &err, "/nonexistent");
}

static void a_temporary_folder_that_cannot_be_made_is_reported(void **state) {
    (void)state;
    char path[PATH_MAX] = "before", small[20];
    struct lw_error err = {0};
    setenv("TMPDIR", "/nonexistent", 1);
    lw_support_fails(lw_folders_make_temporary(path, sizeof path, &err), LW_CANNOT_CREATE, &err,
                     "in /nonexistent: No such file");
    assert_string_equal(path, "");
    err = (struct lw_error){0};
    lw_support_fails(lw_folders_make_temporary(small, sizeof small, &err), LW_CANNOT_CREATE, &err,
                     "too long");
    assert_string_equal(small, "");
}

static void caches_are_where_the_desktop_keeps_them(void **state) {
    (void)state;
    char path[PATH_MAX];
    setenv("XDG_CACHE_HOME", "/caches", 1);
    setenv("HOME", "/home/me", 1);
    assert_true(lw_folders_cache(path, sizeof path));
    assert_string_equal(path, "/caches/lightwell");
    setenv("XDG_CACHE_HOME", "relative", 1); /* to be ignored, the specification says */
    assert_true(lw_folders_cache(path, sizeof path));
    assert_string_equal(path, "/home/me/.cache/lightwell");
    unsetenv("XDG_CACHE_HOME");
    assert_true(lw_folders_cache(path, 26));
    assert_string_equal(path, "/home/me/.cache/lightwell");
    assert_false(lw_folders_cache(path, 25));
    assert_string_equal(path, "");
    unsetenv("HOME");
    assert_false(lw_folders_cache(path, sizeof path));
    assert_string_equal(path, "");
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_folder_is_made_once),
        cmocka_unit_test(temporary_folders_are_where_the_user_wants_them),
        cmocka_unit_test(a_temporary_folder_that_cannot_be_made_is_reported),
        cmocka_unit_test(caches_are_where_the_desktop_keeps_them),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
