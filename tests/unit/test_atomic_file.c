#include "tests/support/support.h"

#include "common/base/atomic_file.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static char folder[] = "/tmp/lw-atomic-XXXXXX";
static char path[sizeof folder + 16];

static int make_folder(void **state) {
    (void)state;
    if (!mkdtemp(folder)) return -1;
    snprintf(path, sizeof path, "%s/file", folder);
    return 0;
}

static int remove_folder(void **state) {
    (void)state;
    unlink(path);
    return rmdir(folder); /* fails if anything was left behind */
}

static void assert_holds(const char *text) {
    char found[64] = "";
    FILE *file = fopen(path, "r");
    assert_non_null(file);
    found[fread(found, 1, sizeof found - 1, file)] = 0;
    fclose(file);
    assert_string_equal(found, text);
}

static void write_whole(const char *text) {
    struct lw_atomic_file file;
    struct lw_error err = {0};
    lw_support_ok(lw_atomic_file_open(&file, path, &err), &err);
    lw_support_ok(lw_atomic_file_write(&file, text, strlen(text), &err), &err);
    lw_support_ok(lw_atomic_file_commit(&file, &err), &err);
}

static void a_file_appears_with_commit(void **state) {
    (void)state;
    struct lw_atomic_file file;
    struct lw_error err = {0};
    mode_t before = umask(027);
    lw_support_ok(lw_atomic_file_open(&file, path, &err), &err);
    umask(before);
    lw_support_ok(lw_atomic_file_write(&file, "hello", 5, &err), &err);
    lw_support_ok(lw_atomic_file_write(&file, " world", 6, &err), &err);
    lw_support_ok(lw_atomic_file_write_at(&file, "J", 1, 0, &err), &err);
    assert_int_equal(access(path, F_OK), -1);
    lw_support_ok(lw_atomic_file_commit(&file, &err), &err);
    assert_holds("Jello world");
    struct stat st;
    assert_int_equal(stat(path, &st), 0);
    assert_int_equal(st.st_mode & 0777, 0640); /* the user's umask decided */
    lw_atomic_file_abandon(&file);             /* harmless */
    assert_holds("Jello world");
}

static void an_abandoned_file_leaves_the_old_one(void **state) {
    (void)state;
    write_whole("old");
    struct lw_atomic_file file;
    struct lw_error err = {0};
    lw_support_ok(lw_atomic_file_open(&file, path, &err), &err);
    lw_support_ok(lw_atomic_file_write(&file, "new", 3, &err), &err);
    lw_atomic_file_abandon(&file);
    lw_atomic_file_abandon(&file);
    assert_holds("old");
    assert_int_equal(lw_support_files_in(folder), 1);
}

static void two_writers_do_not_mix(void **state) {
    (void)state;
    struct lw_atomic_file a, b;
    struct lw_error err = {0};
    lw_support_ok(lw_atomic_file_open(&a, path, &err), &err);
    lw_support_ok(lw_atomic_file_open(&b, path, &err), &err);
    lw_support_ok(lw_atomic_file_write(&a, "aaaa", 4, &err), &err);
    lw_support_ok(lw_atomic_file_write(&b, "bb", 2, &err), &err);
    lw_support_ok(lw_atomic_file_commit(&a, &err), &err);
    assert_holds("aaaa");
    lw_support_ok(lw_atomic_file_commit(&b, &err), &err);
    assert_holds("bb");
    assert_int_equal(lw_support_files_in(folder), 1);
}

static void a_place_that_goes_away_is_reported(void **state) {
    (void)state;
    char inner[sizeof path + 16], name[sizeof inner + 16];
    snprintf(inner, sizeof inner, "%s/inner", folder);
    snprintf(name, sizeof name, "%s/file", inner);
    assert_int_equal(mkdir(inner, 0700), 0);
    struct lw_atomic_file file;
    struct lw_error err = {0};
    lw_support_ok(lw_atomic_file_open(&file, name, &err), &err);
    assert_int_equal(unlink(file.temporary_path), 0);
    assert_int_equal(rmdir(inner), 0);
    assert_int_equal(lw_atomic_file_commit(&file, &err), LW_CANNOT_CREATE);
    assert_non_null(strstr(err.text, name));
    assert_int_equal(file.fd, -1);
}

static void touch(const char *name) {
    char full[sizeof folder + 64];
    snprintf(full, sizeof full, "%s/%s", folder, name);
    lw_support_write_file(full, "x", 1);
}

static void what_killed_writers_left_is_swept(void **state) {
    (void)state;
    static const char *const others[] = {"file.tmp",       "file.1.tmp",    "file.1-.tmp", "file.1-2.tmpx",
                                         "filex.1-2.tmp",  "afile.1-2.tmp", "file.-2.tmp", "file.1-2",
                                         "file.1-2.3.tmp", "file.a1-2.tmp"};
    write_whole("old");
    for (size_t i = 0; i < sizeof others / sizeof *others; i++) touch(others[i]);
    touch("file.1-0.tmp");
    touch("file.4194304-123.tmp");
    assert_int_equal(lw_atomic_file_sweep(path), 2);
    assert_int_equal(lw_support_files_in(folder), 1 + sizeof others / sizeof *others);
    assert_int_equal(lw_atomic_file_sweep(path), 0);
    for (size_t i = 0; i < sizeof others / sizeof *others; i++) {
        char full[sizeof folder + 64];
        snprintf(full, sizeof full, "%s/%s", folder, others[i]);
        assert_int_equal(unlink(full), 0);
    }
    assert_holds("old");
    assert_int_equal(lw_atomic_file_sweep("/nowhere/file"), 0);
}

/* A sweep comes while somebody writes: the file is locked, so it stays. */
static void what_is_in_work_is_not_swept(void **state) {
    (void)state;
    struct lw_atomic_file file;
    struct lw_error err = {0};
    lw_support_ok(lw_atomic_file_open(&file, path, &err), &err);
    lw_support_ok(lw_atomic_file_write(&file, "new", 3, &err), &err);
    touch("file.1-0.tmp");
    assert_int_equal(lw_atomic_file_sweep(path), 1);
    assert_int_equal(access(file.temporary_path, F_OK), 0);
    file.durable = true;
    lw_support_ok(lw_atomic_file_commit(&file, &err), &err);
    assert_holds("new");
    assert_int_equal(lw_support_files_in(folder), 1);
}

static void the_mode_of_an_old_file_stays(void **state) {
    (void)state;
    static const mode_t modes[] = {0600, 0664, 0444, 0755};
    struct stat st;
    unlink(path);
    write_whole("first");
    for (size_t i = 0; i < sizeof modes / sizeof *modes; i++) {
        assert_int_equal(chmod(path, modes[i]), 0);
        write_whole("next");
        assert_int_equal(stat(path, &st), 0);
        assert_int_equal(st.st_mode & 07777, modes[i]);
    }
    if (geteuid()) return; /* only root gives files away */
    assert_int_equal(chown(path, 4321, 1234), 0);
    write_whole("last");
    assert_int_equal(stat(path, &st), 0);
    assert_true(st.st_uid == 4321 && st.st_gid == 1234);
    unlink(path);
}

static void a_stop_ends_a_file(void **state) {
    (void)state;
    volatile sig_atomic_t stop = 0;
    unlink(path);
    for (int at_commit = 0; at_commit < 2; at_commit++) {
        struct lw_atomic_file file;
        struct lw_error err = {0};
        stop = 0;
        lw_support_ok(lw_atomic_file_open(&file, path, &err), &err);
        file.stop = &stop;
        lw_support_ok(lw_atomic_file_write(&file, "new", 3, &err), &err);
        stop = 1;
        const enum lw_status status =
            at_commit ? lw_atomic_file_commit(&file, &err) : lw_atomic_file_write(&file, "er", 2, &err);
        lw_support_fails(status, LW_CLOSED, &err, "stopped before it was whole");
        lw_atomic_file_abandon(&file);
        assert_int_equal(lw_support_files_in(folder), 0);
    }
}

static void a_check_leaves_nothing(void **state) {
    (void)state;
    struct lw_error err = {0};
    lw_support_ok(lw_atomic_file_check("/dev/null", &err), &err);
    unlink(path);
    lw_support_ok(lw_atomic_file_check(path, &err), &err);
    assert_int_equal(lw_support_files_in(folder), 0);
    write_whole("old");
    lw_support_ok(lw_atomic_file_check(path, &err), &err);
    assert_holds("old");
    assert_int_equal(lw_support_files_in(folder), 1);

    lw_support_fails(lw_atomic_file_check(folder, &err), LW_CANNOT_CREATE, &err, "is a folder; name a file");
    char inner[sizeof path + 16], text[sizeof inner + 64];
    const char *const no_folder[] = {"missing", "file"}; /* not there; not one */
    for (int i = 0; i < 2; i++) {
        err = (struct lw_error){0};
        snprintf(inner, sizeof inner, "%s/%s/view.png", folder, no_folder[i]);
        snprintf(text, sizeof text, "there is no folder %s/%s; make it first", folder, no_folder[i]);
        lw_support_fails(lw_atomic_file_check(inner, &err), LW_CANNOT_CREATE, &err, text);
    }
}

/* A reader of the pipe must not see us come and go. */
static void a_check_leaves_pipes_alone(void **state) {
    (void)state;
    struct lw_error err = {0};
    unlink(path);
    assert_int_equal(mkfifo(path, 0600), 0);
    lw_support_ok(lw_atomic_file_check(path, &err), &err); /* nobody reads: an open() would wait */
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_file_appears_with_commit),
        cmocka_unit_test(an_abandoned_file_leaves_the_old_one),
        cmocka_unit_test(two_writers_do_not_mix),
        cmocka_unit_test(a_place_that_goes_away_is_reported),
        cmocka_unit_test(what_killed_writers_left_is_swept),
        cmocka_unit_test(what_is_in_work_is_not_swept),
        cmocka_unit_test(the_mode_of_an_old_file_stays),
        cmocka_unit_test(a_stop_ends_a_file),
        cmocka_unit_test(a_check_leaves_nothing),
        cmocka_unit_test(a_check_leaves_pipes_alone),
    };
    return cmocka_run_group_tests(tests, make_folder, remove_folder);
}
