#include "tests/support/support.h"

#include "server/serve/web/http_origin.h"

#include <string.h>

static void expect_name(const char *host, const char *expected) {
    char name[40];
    if (lw_http_origin_host_name(host, name, sizeof name) != (expected != NULL))
        fail_msg("\"%s\" is %sa host", host, expected ? "" : "not ");
    if (expected) assert_string_equal(name, expected);
}

static void test_host_names(void **state) {
    (void)state;
    expect_name("localhost", "localhost");
    expect_name("LocalHost:7781", "localhost");
    expect_name("127.0.0.1:1", "127.0.0.1");
    expect_name("[::1]", "::1");
    expect_name("[FE80::1]:65535", "fe80::1");
    expect_name("light_1.example-2.org", "light_1.example-2.org");
    static const char *const bad[] = {"",      ":80",    "[::1",    "::1", "[]",   "[x]",
                                      "a b",   "a/b",    "a@b",     "a:",  "a:x",  "a:123456",
                                      "a:80 ", "[::1]x", "[::1]80", "a,b", "a\tb", "\xc3\xa4",
                                      "a?b",   "a#b",    "a\\b",    "a'b", "a;b"};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) expect_name(bad[i], NULL);
    char longest[41] = "";
    memset(longest, 'a', 40);
    expect_name(longest, NULL); /* no room for the end */
    longest[39] = '\0';
    expect_name(longest, longest);
    static char too_long[2 * LW_HTTP_ORIGIN_MAX];
    memset(too_long, 'a', sizeof too_long - 1);
    expect_name(too_long, NULL);
}

static void test_loopback(void **state) {
    (void)state;
    assert_true(lw_http_origin_is_loopback("localhost"));
    assert_true(lw_http_origin_is_loopback("127.0.0.1"));
    assert_true(lw_http_origin_is_loopback("127.9.8.7"));
    assert_true(lw_http_origin_is_loopback("::1"));
    assert_true(lw_http_origin_is_loopback("0:0::1"));
    assert_false(lw_http_origin_is_loopback("128.0.0.1"));
    assert_false(lw_http_origin_is_loopback("127.0.0.1.example"));
    assert_false(lw_http_origin_is_loopback("localhost.example"));
    assert_false(lw_http_origin_is_loopback("127.1"));
    assert_false(lw_http_origin_is_loopback("0.0.0.0"));
    assert_false(lw_http_origin_is_loopback("::"));
}

static void test_same_origin(void **state) {
    (void)state;
    assert_true(lw_http_origin_is_same("http://a.example:7781", "a.example:7781"));
    assert_true(lw_http_origin_is_same("https://A.example", "a.EXAMPLE"));
    assert_true(lw_http_origin_is_same("HTTP://[::1]:80", "[::1]:80"));
    assert_false(lw_http_origin_is_same("http://a.example:7781", "a.example:7780"));
    assert_false(lw_http_origin_is_same("http://a.example", "a.example:7780"));
    assert_false(lw_http_origin_is_same("http://a.example.evil", "a.example"));
    assert_false(lw_http_origin_is_same("http://evil/a.example", "a.example"));
    assert_false(lw_http_origin_is_same("ftp://a.example", "a.example"));
    assert_false(lw_http_origin_is_same("null", "null"));
    assert_false(lw_http_origin_is_same("a.example", "a.example"));
    assert_false(lw_http_origin_is_same("http://", ""));
    assert_false(lw_http_origin_is_same("", ""));
}

static void test_lists(void **state) {
    (void)state;
    assert_true(lw_http_origin_is_listed("a", "A"));
    assert_true(lw_http_origin_is_listed("b,a.c", "a.c"));
    assert_true(lw_http_origin_is_listed("a.c,b", "a.c"));
    assert_false(lw_http_origin_is_listed("a.c,b", "a"));
    assert_false(lw_http_origin_is_listed("a.c,b", "a.c,b"));
    assert_false(lw_http_origin_is_listed("a,,b", ""));
    assert_false(lw_http_origin_is_listed("", ""));
    assert_false(lw_http_origin_is_listed(NULL, "a"));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_host_names),
        cmocka_unit_test(test_loopback),
        cmocka_unit_test(test_same_origin),
        cmocka_unit_test(test_lists),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
