/* test_package_files.c: a package as a file: a save succeeds as a whole, or leaves the old file. */
#include "tests/support/package_case.h"

#include "common/scene/package.h"

#include <signal.h>
#include <stdlib.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

static void files_keep_what_was_saved(void **state) {
    (void)state;
    struct lw_scene *scene = lw_support_everything(), *read;
    struct lw_error err = {0};
    const char *path = lw_support_temporary("saved.lwscene");
    for (int i = 0; i < 2; i++)
        lw_support_ok(lw_package_save(scene, path, &err), &err); /* the second replaces */
    lw_support_ok(lw_package_load(path, &read, &err), &err);
    package_case_expect_same_scene(scene, read);
    size_t size, file_size;
    uint8_t *bytes = package_case_write_sealed(scene, &size), *file = lw_support_read_file(path, &file_size);
    assert_int_equal(size, file_size);
    assert_memory_equal(bytes, file, size);
    free(file);
    free(bytes);
    lw_scene_destroy(read);
    lw_scene_destroy(scene);
}

static void files_that_cannot_be_are_named(void **state) {
    (void)state;
    struct lw_scene *scene = lw_support_everything(), *read = NULL;
    struct lw_error err = {0};
    enum lw_status status = lw_package_load("/nonexistent/a.lwscene", &read, &err);
    lw_support_fails(status, LW_NO_INPUT, &err, "/nonexistent/a.lwscene: No such file");
    err = (struct lw_error){0};
    status = lw_package_load("/tmp", &read, &err);
    lw_support_fails(status, LW_NO_INPUT, &err, "/tmp: not a regular file");
    const char *pipe_path = lw_support_temporary("pipe");
    assert_int_equal(mkfifo(pipe_path, 0600), 0);
    err = (struct lw_error){0};
    status = lw_package_load(pipe_path, &read, &err); /* and does not wait for a writer */
    lw_support_fails(status, LW_NO_INPUT, &err, "not a regular file");
    err = (struct lw_error){0};
    lw_support_ok(lw_package_save(scene, "/dev/null", &err), &err); /* and it stays a device */
    struct stat null;
    assert_int_equal(stat("/dev/null", &null), 0);
    assert_true(S_ISCHR(null.st_mode));
    err = (struct lw_error){0};
    status = lw_package_save(scene, "/nonexistent/b.lwscene", &err);
    lw_support_fails(status, LW_CANNOT_CREATE, &err, "/nonexistent/b.lwscene");
    const char *text_path = lw_support_temporary("text.lwscene");
    lw_support_write_file(text_path, "# an OBJ, say\n", 14);
    err = (struct lw_error){0};
    status = lw_package_load(text_path, &read, &err);
    lw_support_fails(status, LW_BAD_DATA, &err, "text.lwscene: not a scene package");
    assert_null(read);
    lw_scene_destroy(scene);
}

static void a_failed_save_leaves_the_old_file_and_nothing_else(void **state) {
    (void)state;
    const char *folder = lw_support_temporary("folder");
    assert_int_equal(mkdir(folder, 0700), 0);
    const char *path = lw_support_temporary("folder/scene.lwscene");
    struct lw_scene *scene = lw_support_squares(1, 1), *read;
    struct lw_error err = {0};
    lw_support_ok(lw_package_save(scene, path, &err), &err);
    scene->name = "newer";
    struct rlimit kept, small;
    assert_int_equal(getrlimit(RLIMIT_FSIZE, &kept), 0);
    small = kept;
    small.rlim_cur = 100; /* as a full disk: the first bytes are written, the rest are not */
    signal(SIGXFSZ, SIG_IGN);
    assert_int_equal(setrlimit(RLIMIT_FSIZE, &small), 0);
    enum lw_status status = lw_package_save(scene, path, &err);
    assert_int_equal(setrlimit(RLIMIT_FSIZE, &kept), 0);
    lw_support_fails(status, LW_IO, &err, "scene.lwscene");
    assert_int_equal(lw_support_files_in(folder), 1);
    err = (struct lw_error){0};
    lw_support_ok(lw_package_load(path, &read, &err), &err);
    assert_string_equal(read->name, "squares");
    lw_scene_destroy(read);
    lw_scene_destroy(scene);
}

static void a_stopped_save_leaves_the_old_file_and_nothing_else(void **state) {
    (void)state;
    const char *folder = lw_support_temporary("stopped");
    assert_int_equal(mkdir(folder, 0700), 0);
    const char *path = lw_support_temporary("stopped/scene.lwscene");
    struct lw_scene *scene = lw_support_squares(1, 1), *read;
    struct lw_error err = {0};
    volatile sig_atomic_t stop = 0;
    lw_support_ok(lw_package_save_stoppable(scene, path, &stop, &err), &err);
    assert_int_equal(chmod(path, 0604), 0);
    scene->name = "newer";
    stop = SIGTERM;
    lw_support_fails(lw_package_save_stoppable(scene, path, &stop, &err), LW_CLOSED, &err, "scene.lwscene");
    assert_int_equal(lw_support_files_in(folder), 1);
    err = (struct lw_error){0};
    lw_support_ok(lw_package_load(path, &read, &err), &err);
    assert_string_equal(read->name, "squares");
    lw_scene_destroy(read);
    /* what a killed writer left goes with the next, and the file's mode stays */
    lw_support_write_file(lw_support_temporary("stopped/scene.lwscene.77-0.tmp"), "half", 4);
    lw_support_ok(lw_package_save(scene, path, &err), &err);
    struct stat st;
    assert_int_equal(stat(path, &st), 0);
    assert_int_equal(st.st_mode & 0777, 0604);
    assert_int_equal(lw_support_files_in(folder), 1);
    lw_scene_destroy(scene);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(files_keep_what_was_saved),
        cmocka_unit_test(files_that_cannot_be_are_named),
        cmocka_unit_test(a_failed_save_leaves_the_old_file_and_nothing_else),
        cmocka_unit_test(a_stopped_save_leaves_the_old_file_and_nothing_else),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
