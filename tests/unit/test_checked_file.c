#include "tests/support/support.h"

#include "common/base/checked_file.h"

#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static const struct lw_checked_file_kind kind = {"letters", 3}, other_kind = {"LETTERS", 3},
                                         other_version = {"letters", 4};

static enum lw_status begin(struct lw_checked_file_reader *reader, const char *path,
                            const struct lw_checked_file_kind *of, struct lw_error *err) {
    *err = (struct lw_error){0};
    return lw_checked_file_read_begin(reader, path, of, "letters", err);
}

/* A kind and `size` bytes that depend on their position. */
static void save(const char *path, size_t size) {
    struct lw_checked_file_writer writer;
    struct lw_error err = {0};
    uint8_t *bytes = malloc(size + 1);
    assert_non_null(bytes);
    for (size_t i = 0; i < size; i++) bytes[i] = (uint8_t)(i * 2654435761u >> 16);
    lw_support_ok(lw_checked_file_write_begin(&writer, path, &err), &err);
    lw_checked_file_put(&writer, &kind, sizeof kind);
    lw_checked_file_put(&writer, bytes, size / 3);
    lw_checked_file_put(&writer, bytes + size / 3, size - size / 3);
    assert_int_equal(access(path, F_OK), -1);
    lw_support_ok(lw_checked_file_write_end(&writer), &err);
    free(bytes);
}

static void what_was_written_comes_back(void **state) {
    (void)state;
    static const size_t sizes[] = {0, 1, (1 << 20) - sizeof kind, 1 << 20, 3 << 20 | 5};
    for (size_t s = 0; s < sizeof sizes / sizeof *sizes; s++) {
        const char *path = lw_support_temporary("whole");
        struct lw_checked_file_reader reader;
        struct lw_checked_file_kind found;
        struct lw_error err;
        uint8_t *bytes = malloc(sizes[s] + 1);
        assert_non_null(bytes);
        save(path, sizes[s]);
        lw_support_ok(begin(&reader, path, &kind, &err), &err);
        assert_int_equal(reader.left, sizeof kind + sizes[s]);
        lw_support_ok(lw_checked_file_take(&reader, &found, sizeof found), &err);
        assert_memory_equal(&found, &kind, sizeof kind);
        lw_support_ok(lw_checked_file_take(&reader, bytes, sizes[s]), &err);
        for (size_t i = 0; i < sizes[s]; i++) assert_int_equal(bytes[i], (uint8_t)(i * 2654435761u >> 16));
        /* the checksum is nobody's */
        lw_support_fails(lw_checked_file_take(&reader, bytes, 1), LW_BAD_DATA, &err, "ends too early");
        lw_checked_file_read_end(&reader);
        lw_checked_file_read_end(&reader);
        free(bytes);
        assert_int_equal(unlink(path), 0);
    }
}

static void refused(const char *path, const struct lw_checked_file_kind *of, const char *text) {
    struct lw_checked_file_reader reader;
    struct lw_error err;
    lw_support_fails(begin(&reader, path, of, &err), LW_BAD_DATA, &err, text);
    assert_memory_equal(err.text, path, strlen(path));
    lw_checked_file_read_end(&reader);
}

static void what_is_not_whole_is_refused(void **state) {
    (void)state;
    const char *path = lw_support_temporary("damaged");
    size_t size;
    save(path, 50);
    refused(path, &other_kind, "holds no letters");
    refused(path, &other_version, "has version 3, this program reads 4");
    uint8_t *bytes = lw_support_read_file(path, &size);
    for (size_t cut = 0; cut < size; cut++) {
        lw_support_write_file(path, bytes, cut);
        refused(path, &kind, "cut short");
    }
    lw_support_write_file(path, bytes, size + 1); /* a NUL follows */
    refused(path, &kind, "wrong checksum");
    for (size_t i = 0; i < size; i++) {
        bytes[i] ^= 0x10;
        lw_support_write_file(path, bytes, size);
        refused(path, &kind, i < 8 ? "holds no letters" : i < sizeof kind ? "has version" : "wrong checksum");
        bytes[i] ^= 0x10;
    }
    free(bytes);
    assert_int_equal(unlink(path), 0);
    assert_int_equal(mkfifo(path, 0600), 0);
    refused(path, &kind, "holds no letters");
    struct lw_checked_file_reader reader;
    struct lw_error err;
    lw_support_fails(begin(&reader, "/nonexistent/file", &kind, &err), LW_NO_INPUT, &err,
                     "/nonexistent/file: cannot");
    lw_checked_file_read_end(&reader);
}

static void what_fails_leaves_the_file_of_before(void **state) {
    (void)state;
    const char *path = lw_support_temporary("kept");
    struct lw_checked_file_writer writer;
    struct lw_checked_file_reader reader;
    struct lw_error err = {0};
    save(path, 10);
    lw_support_ok(lw_checked_file_write_begin(&writer, path, &err), &err);
    lw_checked_file_put(&writer, &kind, sizeof kind);
    writer.status = lw_status_fail(&err, LW_NO_MEMORY, "the caller's own");
    lw_checked_file_put(&writer, &kind, sizeof kind);
    lw_support_fails(lw_checked_file_write_end(&writer), LW_NO_MEMORY, &err, "the caller's own");
    lw_support_ok(begin(&reader, path, &kind, &err), &err);
    assert_int_equal(reader.left, sizeof kind + 10);
    lw_checked_file_read_end(&reader);
    err = (struct lw_error){0};
    lw_support_fails(lw_checked_file_write_begin(&writer, "/nonexistent/file", &err), LW_CANNOT_CREATE, &err,
                     "/nonexistent/file");
    err = (struct lw_error){0};
    lw_support_ok(lw_checked_file_write_begin(&writer, "/dev/full", &err), &err);
    lw_checked_file_put(&writer, &kind, sizeof kind);
    lw_support_fails(lw_checked_file_write_end(&writer), LW_IO, &err, "/dev/full");
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_was_written_comes_back),
        cmocka_unit_test(what_is_not_whole_is_refused),
        cmocka_unit_test(what_fails_leaves_the_file_of_before),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
