#include "tests/support/support.h"

#include "server/serve/web/web_files.h"

#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

static const char *folder(const char *name) {
    static char path[4][300];
    static unsigned next;
    char *at = path[next++ % 4];
    snprintf(at, sizeof path[0], "%s", lw_support_temporary(name));
    assert_int_equal(mkdir(at, 0700), 0);
    return at;
}

static void write_in(const char *in, const char *name, const char *text) {
    char path[600];
    snprintf(path, sizeof path, "%s/%s", in, name);
    lw_support_write_file(path, text, strlen(text));
}

static void test_find(void **state) {
    (void)state;
    struct lw_web_files files;
    struct lw_error err = {0};
    const char *root = folder("root"), *inner = folder("root/inner");
    write_in(root, "index.html", "a");
    write_in(root, "same.js", "a");
    write_in(root, "Z.unknown", "b");
    write_in(root, ".secret", "c");
    write_in(inner, "index.html", "d");
    write_in(inner, "x.wasm", "");
    char link[600];
    snprintf(link, sizeof link, "%s/link", root);
    assert_int_equal(symlink("index.html", link), 0);
    lw_support_ok(lw_web_files_read(root, &files, &err), &err);
    assert_int_equal(files.count, 5);
    assert_int_equal(files.bytes, 4);
    static const struct {
        const char *path, *type, *text;
    } found[] = {{"/", "text/html; charset=utf-8", "a"},
                 {"/index.html", "text/html; charset=utf-8", "a"},
                 {"/same.js", "text/javascript; charset=utf-8", "a"},
                 {"/Z.unknown", "application/octet-stream", "b"},
                 {"/inner/", "text/html; charset=utf-8", "d"},
                 {"/inner/x.wasm", "application/wasm", ""}};
    for (size_t i = 0; i < sizeof found / sizeof *found; i++) {
        const struct lw_web_file *file = lw_web_files_find(&files, found[i].path);
        if (!file) fail_msg("no %s", found[i].path);
        assert_string_equal(file->type, found[i].type);
        assert_int_equal(file->size, strlen(found[i].text));
        assert_memory_equal(file->bytes, found[i].text, file->size);
        assert_int_equal(strlen(file->tag), 34);
    }
    assert_string_equal(lw_web_files_find(&files, "/")->tag, lw_web_files_find(&files, "/same.js")->tag);
    assert_string_not_equal(lw_web_files_find(&files, "/")->tag, lw_web_files_find(&files, "/inner/")->tag);
    static const char *const missing[] = {"",
                                          "index.html",
                                          "/inner",
                                          "/link",
                                          "/.secret",
                                          "/inner/../index.html",
                                          "//index.html",
                                          "/index.html/",
                                          "/INDEX.html",
                                          "/inner//"};
    for (size_t i = 0; i < sizeof missing / sizeof *missing; i++)
        if (lw_web_files_find(&files, missing[i])) fail_msg("found %s", missing[i]);
    lw_web_files_finish(&files);
    assert_null(lw_web_files_find(&files, "/"));
    char path[5000];
    memset(path, '/', sizeof path - 1);
    path[sizeof path - 1] = '\0';
    assert_null(lw_web_files_find(&files, path));
}

static void set_time(const char *in, const char *name, time_t modified_s) {
    char path[600];
    snprintf(path, sizeof path, "%s/%s", in, name);
    const struct timespec times[2] = {{.tv_sec = modified_s}, {.tv_sec = modified_s, .tv_nsec = 1}};
    assert_int_equal(utimensat(AT_FDCWD, path, times, 0), 0);
}

/* A coding that is missing, empty, not smaller or out of date is none. */
static void test_codings(void **state) {
    (void)state;
    static const struct {
        const char *name, *text;
        time_t modified_s;
    } made[] = {{"a.js", "a long text", 1000},   {"a.js.br", "br", 1000}, {"a.js.gz", "gzip", 1001},
                {"b.css", "a long text", 1000},  {"b.css.br", "br", 999}, {"b.css.gz", "gzip", 1000},
                {"c.wasm", "a long text", 1000}, {"c.wasm.br", "", 1000}, {"c.wasm.gz", "a long text", 1000},
                {"d.html", "a long text", 1000}, {"e.js.br", "br", 1000}, {"d.htmlx.br", "br", 1000}};
    struct lw_web_files files;
    struct lw_error err = {0};
    const char *root = folder("codings");
    for (size_t i = 0; i < sizeof made / sizeof *made; i++) {
        write_in(root, made[i].name, made[i].text);
        set_time(root, made[i].name, made[i].modified_s);
    }
    lw_support_ok(lw_web_files_read(root, &files, &err), &err);
    const struct lw_web_file *a = lw_web_files_find(&files, "/a.js");
    assert_int_equal(lw_web_files_codings(a), 1u << LW_CONTENT_CODING_BR | 1u << LW_CONTENT_CODING_GZIP);
    assert_ptr_equal(a->coded[LW_CONTENT_CODING_BR], lw_web_files_find(&files, "/a.js.br"));
    assert_memory_equal(a->coded[LW_CONTENT_CODING_GZIP]->bytes, "gzip", 4);
    assert_string_not_equal(a->tag, a->coded[LW_CONTENT_CODING_BR]->tag);
    assert_int_equal(lw_web_files_codings(lw_web_files_find(&files, "/b.css")), 1u << LW_CONTENT_CODING_GZIP);
    assert_int_equal(lw_web_files_codings(lw_web_files_find(&files, "/c.wasm")), 0);
    assert_int_equal(lw_web_files_codings(lw_web_files_find(&files, "/d.html")), 0);
    assert_null(lw_web_files_find(&files, "/e.js"));
    lw_web_files_finish(&files);
}

static void test_limits(void **state) {
    (void)state;
    struct lw_web_files files;
    struct lw_error err = {0};
    lw_support_fails(lw_web_files_read(lw_support_temporary("none"), &files, &err), LW_NO_INPUT, &err,
                     "none");
    char deep[300] = "deep";
    const char *last = folder(deep);
    for (unsigned i = 0; i < LW_WEB_FILES_DEPTH_MAX; i++) {
        strcat(deep, "/d");
        last = folder(deep);
    }
    write_in(last, "a", "a");
    err = (struct lw_error){0};
    lw_support_ok(lw_web_files_read(lw_support_temporary("deep"), &files, &err), &err);
    assert_int_equal(files.count, 1);
    lw_web_files_finish(&files);
    strcat(deep, "/d");
    folder(deep);
    err = (struct lw_error){0};
    lw_support_fails(lw_web_files_read(lw_support_temporary("deep"), &files, &err), LW_BAD_DATA, &err,
                     "deep");
    const char *many = folder("many");
    for (unsigned i = 0; i < LW_WEB_FILES_MAX; i++) {
        char name[20];
        snprintf(name, sizeof name, "%u", i);
        write_in(many, name, "a");
    }
    err = (struct lw_error){0};
    lw_support_ok(lw_web_files_read(many, &files, &err), &err);
    assert_int_equal(files.count, LW_WEB_FILES_MAX);
    lw_web_files_finish(&files);
    write_in(many, "more", "a");
    lw_support_fails(lw_web_files_read(many, &files, &err), LW_BAD_DATA, &err, "1000");
    const char *large = folder("large");
    char path[600];
    write_in(large, "a", "");
    write_in(large, "b", "x");
    snprintf(path, sizeof path, "%s/a", large);
    assert_int_equal(truncate(path, LW_WEB_FILES_BYTES_MAX - 1), 0);
    err = (struct lw_error){0};
    lw_support_ok(lw_web_files_read(large, &files, &err), &err);
    lw_web_files_finish(&files);
    assert_int_equal(truncate(path, LW_WEB_FILES_BYTES_MAX), 0);
    lw_support_fails(lw_web_files_read(large, &files, &err), LW_BAD_DATA, &err, "large/");
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_find), cmocka_unit_test(test_codings),
                                       cmocka_unit_test(test_limits)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
