#include "tests/support/support.h"

#include "client/view/window/saved_picture.h"

#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

/* The picture that a window saves: two files, or none and a line. The limit of a file's size stands for a
 * full disk. */

#define SIDE 64u

static float rgb[SIDE * SIDE * 3];

static void limit_files(rlim_t bytes) {
    const struct rlimit limit = {bytes, RLIM_INFINITY};
    assert_int_equal(setrlimit(RLIMIT_FSIZE, &limit), 0);
}

static enum lw_status save(char name[LW_SAVED_PICTURE_NAME_SIZE], struct lw_error *err) {
    return lw_saved_picture_write(rgb, SIDE, SIDE, LW_TONEMAP_NONE, 0, name, err);
}

static void test_both_or_none(void **state) {
    (void)state;
    char name[LW_SAVED_PICTURE_NAME_SIZE] = "untouched";
    struct stat png, exr;
    char path[LW_SAVED_PICTURE_NAME_SIZE + 8];
    lw_support_ok(save(name, NULL), NULL);
    assert_int_equal(lw_support_files_in("."), 2);
    snprintf(path, sizeof path, "%s.png", name);
    assert_int_equal(stat(path, &png), 0);
    assert_int_equal(unlink(path), 0);
    snprintf(path, sizeof path, "%s.exr", name);
    assert_int_equal(stat(path, &exr), 0);
    assert_int_equal(unlink(path), 0);
    assert_true(exr.st_size > png.st_size);
    const off_t sizes[] = {0, png.st_size - 1, png.st_size, exr.st_size - 1};
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
        struct lw_error err = {0};
        snprintf(name, sizeof name, "untouched");
        limit_files((rlim_t)sizes[i]);
        const enum lw_status status = save(name, &err);
        limit_files(RLIM_INFINITY);
        lw_support_fails(status, LW_IO, &err, i < 2 ? ".png: File too large" : ".exr: File too large");
        assert_string_equal(name, "untouched");
        assert_int_equal(lw_support_files_in("."), 0);
    }
    lw_support_ok(save(name, NULL), NULL); /* with room again it goes on */
    assert_int_equal(lw_support_files_in("."), 2);
}

int main(void) {
    const char *folder = lw_support_temporary("pictures");
    signal(SIGXFSZ, SIG_IGN);
    for (uint32_t i = 0; i < SIDE * SIDE * 3; i++) rgb[i] = (float)(i % 7) * 0.1f;
    if (mkdir(folder, 0700) != 0 || chdir(folder) != 0) return 1;
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_both_or_none)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
