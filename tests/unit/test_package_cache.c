#include "tests/support/support.h"

#include "client/lib/package_cache.h"

#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#define OLD "00000000000000000000000000000000.lwscene"
#define NEW "ffffffffffffffffffffffffffffffff.lwpart"

static const uint8_t package[] = "light";

static char folder[160];

static const char *in_folder(const char *name) {
    static char path[320];
    snprintf(path, sizeof path, "%s/%s", folder, name);
    return path;
}

/* A sparse file of `size` bytes, last used `age_s` ago. */
static void put(const char *name, uint64_t size, time_t age_s) {
    lw_support_write_file(in_folder(name), "", 0);
    assert_int_equal(truncate(in_folder(name), (off_t)size), 0);
    const struct timespec used = {.tv_sec = time(NULL) - age_s};
    assert_int_equal(utimensat(AT_FDCWD, in_folder(name), (struct timespec[]){used, used}, 0), 0);
}

static bool is_there(const char *name) { return access(in_folder(name), F_OK) == 0; }

static struct lw_package_hash keep(void) {
    struct lw_package_hash hash;
    struct lw_error err = {0};
    lw_package_hash(package, sizeof package, &hash);
    lw_support_ok(
        lw_package_cache_write(folder, LW_PACKAGE_CACHE_PACKAGE, &hash, package, sizeof package, &err), &err);
    return hash;
}

static void expect_kept(const struct lw_package_hash *hash) {
    uint8_t *bytes;
    assert_int_equal(lw_package_cache_read(folder, LW_PACKAGE_CACHE_PACKAGE, hash, sizeof package, &bytes),
                     LW_PACKAGE_CACHE_FOUND);
    assert_memory_equal(bytes, package, sizeof package);
    free(bytes);
}

static int choose_folder(void **state) {
    static unsigned number;
    char name[32];
    (void)state;
    snprintf(name, sizeof name, "cache%u/in/it", number++);
    snprintf(folder, sizeof folder, "%s", lw_support_temporary(name));
    return 0;
}

static void what_is_kept_comes_back(void **state) {
    (void)state;
    const struct lw_package_hash hash = keep(), other = {{1}};
    uint8_t *bytes;
    expect_kept(&hash);
    assert_int_equal(lw_package_cache_read(folder, LW_PACKAGE_CACHE_PACKAGE, &other, sizeof package, &bytes),
                     LW_PACKAGE_CACHE_ABSENT);
    assert_int_equal(
        lw_package_cache_read(folder, LW_PACKAGE_CACHE_PACKAGE, &hash, sizeof package - 1, &bytes),
        LW_PACKAGE_CACHE_DAMAGED);
    assert_int_equal(lw_package_cache_read(folder, LW_PACKAGE_CACHE_PART, &hash, sizeof package, &bytes),
                     LW_PACKAGE_CACHE_ABSENT);
}

static void what_is_damaged_is_not_what_is_absent(void **state) {
    (void)state;
    const struct lw_package_hash hash = keep();
    uint8_t *bytes, wrong[sizeof package];
    char name[64];
    for (size_t i = 0; i < sizeof hash.bytes; i++) snprintf(name + 2 * i, 3, "%02x", hash.bytes[i]);
    snprintf(name + 2 * sizeof hash.bytes, 16, ".lwscene");
    memcpy(wrong, package, sizeof wrong);
    wrong[1] ^= 1; /* a bit of it */
    lw_support_write_file(in_folder(name), wrong, sizeof wrong);
    assert_int_equal(lw_package_cache_read(folder, LW_PACKAGE_CACHE_PACKAGE, &hash, sizeof package, &bytes),
                     LW_PACKAGE_CACHE_DAMAGED);
    assert_int_equal(unlink(in_folder(name)), 0);
    assert_int_equal(lw_package_cache_read(folder, LW_PACKAGE_CACHE_PACKAGE, &hash, sizeof package, &bytes),
                     LW_PACKAGE_CACHE_ABSENT);
    keep();
    expect_kept(&hash); /* it is written in its place */
}

static void what_was_not_used_for_longest_makes_room(void **state) {
    (void)state;
    struct lw_package_hash hash = keep();
    /* together exactly as much as there may be; more that does not count */
    put(OLD, LW_PACKAGE_CACHE_BYTES_MAX / 2, 1000);
    put(NEW, LW_PACKAGE_CACHE_BYTES_MAX / 2 - sizeof package, 500);
    put("mine.lwscene", LW_PACKAGE_CACHE_BYTES_MAX, 2000);
    put(OLD ".1-0.tmp", LW_PACKAGE_CACHE_BYTES_MAX, 2000);
    keep();
    assert_true(is_there(OLD) && is_there(NEW));
    put(NEW, LW_PACKAGE_CACHE_BYTES_MAX / 2 - sizeof package + 1, 500); /* one byte more */
    keep();
    assert_true(!is_there(OLD) && is_there(NEW) && is_there("mine.lwscene") && is_there(OLD ".1-0.tmp"));
    expect_kept(&hash);
    put(OLD, LW_PACKAGE_CACHE_BYTES_MAX + 1, 1000); /* all others go */
    put(NEW, 1, 500);
    keep();
    assert_true(!is_there(OLD) && is_there(NEW));
    expect_kept(&hash);
}

static void reading_counts_as_use(void **state) {
    (void)state;
    struct lw_package_hash hash = keep();
    char name[64];
    for (size_t i = 0; i < sizeof hash.bytes; i++) snprintf(name + 2 * i, 3, "%02x", hash.bytes[i]);
    snprintf(name + 2 * sizeof hash.bytes, 16, ".lwscene");
    const struct timespec long_ago = {.tv_sec = 1000};
    struct stat st;
    assert_int_equal(utimensat(AT_FDCWD, in_folder(name), (struct timespec[]){long_ago, long_ago}, 0), 0);
    expect_kept(&hash);
    assert_int_equal(stat(in_folder(name), &st), 0);
    assert_true(st.st_mtim.tv_sec > 1000);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup(what_is_kept_comes_back, choose_folder),
        cmocka_unit_test_setup(what_is_damaged_is_not_what_is_absent, choose_folder),
        cmocka_unit_test_setup(what_was_not_used_for_longest_makes_room, choose_folder),
        cmocka_unit_test_setup(reading_counts_as_use, choose_folder),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
