/* Files that other files name: only from their folder, by the kernel's rule and by the one for older
 * kernels. */
#include "tests/support/support.h"

#include "common/base/file_read.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

/* An older kernel, or the filter of an older container: openat2() is not there. */
static int no_openat2; /* errno; 0: it is there */

long __wrap_syscall(long number, long a, long b, long c, long d, long e, long f);
long __real_syscall(long number, long a, long b, long c, long d, long e, long f);
long __wrap_syscall(long number, long a, long b, long c, long d, long e, long f) {
    if (number != SYS_openat2 || !no_openat2) return __real_syscall(number, a, b, c, d, e, f);
    errno = no_openat2;
    return -1;
}

static char folder[256];

static void put(const char *name, const char *text) {
    char path[512];
    snprintf(path, sizeof path, "%s/%s", folder, name);
    lw_support_write_file(path, text, strlen(text));
}

static void put_link(const char *name, const char *target) {
    char path[512];
    snprintf(path, sizeof path, "%s/%s", folder, name);
    assert_int_equal(symlink(target, path), 0);
}

static int make_files(void **state) {
    (void)state;
    char inner[300];
    snprintf(folder, sizeof folder, "%s", lw_support_temporary("outer"));
    if (mkdir(folder, 0700) != 0) return -1;
    put("secret", "secret");
    snprintf(inner, sizeof inner, "%s/scene", folder);
    snprintf(folder, sizeof folder, "%s", inner);
    if (mkdir(folder, 0700) != 0) return -1;
    snprintf(inner, sizeof inner, "%s/maps", folder);
    if (mkdir(inner, 0700) != 0) return -1;
    put("a", "hello");
    put("maps/b", "hello");
    put_link("out", "../secret");
    put_link("above", "..");
    put_link("rooted", "/etc/passwd");
    put_link("near", "maps/b");
    put_link("maps/back", "../a");
    put_link("round", "round");
    return 0;
}

struct expected {
    const char *path;
    enum lw_status status;
    const char *text;
};

static void expect(const struct expected *files, size_t count) {
    for (size_t i = 0; i < count; i++) {
        struct lw_error err = {0};
        uint8_t *bytes = NULL;
        size_t size = 0;
        const enum lw_status status =
            lw_file_read_beneath(folder, files[i].path, 100, true, &bytes, &size, &err);
        if (status != files[i].status || (status && !strstr(err.text, files[i].text)))
            fail_msg("%s: %d, %s", files[i].path, (int)status, err.text);
        if (status == LW_OK) assert_true(size == 5 && memcmp(bytes, "hello", 5) == 0);
        free(bytes);
    }
}

static void links_stay_beneath(void **state) {
    (void)state;
    static const struct expected files[] = {
        {"a", LW_OK, ""},
        {"./a", LW_OK, ""},
        {"maps//b", LW_OK, ""},
        {"maps/../a", LW_OK, ""},
        {"near", LW_OK, ""},
        {"maps/back", LW_OK, ""},
        {"out", LW_BAD_DATA, "leads out of the folder"},
        {"above/secret", LW_BAD_DATA, "leads out of the folder"},
        {"../secret", LW_BAD_DATA, "leads out of the folder"},
        {"maps/../../secret", LW_BAD_DATA, "leads out of the folder"},
        {"rooted", LW_BAD_DATA, "leads out of the folder"},
        {"/etc/passwd", LW_BAD_DATA, "leads out of the folder"},
        {"round", LW_BAD_DATA, "leads out of the folder"},
        {"none", LW_NO_INPUT, "No such file"},
        {"maps", LW_BAD_DATA, "is not a regular file"},
        {"", LW_NO_INPUT, "No such file"},
    };
    no_openat2 = 0;
    expect(files, sizeof files / sizeof *files);
}

static void older_kernels_follow_no_link(void **state) {
    (void)state;
    char name[400] = "";
    memset(name, 'x', sizeof name - 1);
    const struct expected files[] = {
        {"a", LW_OK, ""},
        {"./a", LW_OK, ""},
        {"maps//b", LW_OK, ""},
        {"maps/../a", LW_BAD_DATA, "leads out of the folder"},
        {"near", LW_BAD_DATA, "leads out of the folder"},
        {"out", LW_BAD_DATA, "leads out of the folder"},
        {"above/secret", LW_NO_INPUT, "Not a directory"},
        {"../secret", LW_BAD_DATA, "leads out of the folder"},
        {"rooted", LW_BAD_DATA, "leads out of the folder"},
        {"/etc/passwd", LW_NO_INPUT, "No such file"}, /* read as etc/passwd below the folder */
        {"none/b", LW_NO_INPUT, "No such file"},
        {"maps", LW_BAD_DATA, "is not a regular file"},
        {"", LW_NO_INPUT, "No such file"},
        {name, LW_NO_INPUT, "File name too long"},
    };
    static const int errors[] = {ENOSYS, EPERM};
    for (size_t i = 0; i < 2; i++) {
        no_openat2 = errors[i];
        expect(files, sizeof files / sizeof *files);
    }
    no_openat2 = 0;
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(links_stay_beneath),
        cmocka_unit_test(older_kernels_follow_no_link),
    };
    return cmocka_run_group_tests(tests, make_files, NULL);
}
