#include "tests/support/support.h"

#include "server/serve/web/content_coding.h"

#define BR       LW_CONTENT_CODING_BR
#define GZIP     LW_CONTENT_CODING_GZIP
#define IDENTITY LW_CONTENT_CODING_IDENTITY
#define NONE     LW_CONTENT_CODING_NONE
#define BOTH     (1u << BR | 1u << GZIP)

struct case_of {
    const char *accept;
    unsigned available;
    enum lw_content_coding expected;
};

static void check(const struct case_of *cases, size_t count) {
    for (size_t i = 0; i < count; i++) {
        const enum lw_content_coding chosen = lw_content_coding_choose(cases[i].accept, cases[i].available);
        if (chosen != cases[i].expected)
            fail_msg("\"%s\" of %x: %d, not %d", cases[i].accept ? cases[i].accept : "(none)",
                     cases[i].available, (int)chosen, (int)cases[i].expected);
    }
}
#define CHECK(cases) check(cases, sizeof cases / sizeof *cases)

static void test_weights(void **state) {
    (void)state;
    static const struct case_of cases[] = {{NULL, BOTH, IDENTITY},
                                           {"", BOTH, IDENTITY},
                                           {"gzip, deflate, br, zstd", BOTH, BR},
                                           {"gzip, deflate, br", 1u << GZIP, GZIP},
                                           {"gzip, deflate, br", 0, IDENTITY},
                                           {"gzip", BOTH, GZIP},
                                           {"x-gzip", BOTH, GZIP},
                                           {"GZip;Q=0.5", BOTH, GZIP},
                                           {"br;q=0.5, gzip", BOTH, GZIP},
                                           {"br;q=0.501,gzip;q=0.5", BOTH, BR},
                                           {"br;q=0.5,gzip;q=0.501", BOTH, GZIP},
                                           {"br;q=0, gzip;q=0.000", BOTH, IDENTITY},
                                           {"br ; q=1.000 ,\tgzip", BOTH, BR},
                                           {",, gzip ,", BOTH, GZIP},
                                           {"br;q=1.", BOTH, BR},
                                           {"gzip;q=1, gzip;q=0", BOTH, IDENTITY}};
    CHECK(cases);
}

static void test_identity(void **state) {
    (void)state;
    static const struct case_of cases[] = {
        {"identity", BOTH, IDENTITY},
        {"identity, gzip", BOTH, GZIP}, /* equal weights: the smaller one */
        {"identity, gzip;q=0.9", BOTH, IDENTITY},
        {"identity;q=0.1, br;q=0.2", BOTH, BR},
        {"identity;q=0", BOTH, NONE},
        {"identity;q=0, gzip", BOTH, GZIP},
        {"identity;q=0, gzip", 0, NONE},
        {"*;q=0", BOTH, NONE},
        {"*;q=0, identity;q=0.1", BOTH, IDENTITY},
        {"*;q=0, gzip;q=0.1", BOTH, GZIP},
        {"*", BOTH, BR},
        {"*", 0, IDENTITY},
        {"br;q=0, *", BOTH, GZIP},
        {"gzip;q=0.5, *;q=0.1", BOTH, GZIP}};
    CHECK(cases);
}

static void test_unknown(void **state) {
    (void)state;
    static const struct case_of cases[] = {{"zstd", BOTH, IDENTITY},
                                           {"deflate, compress", BOTH, IDENTITY},
                                           {"brotli, gzipped, bro, b", BOTH, IDENTITY},
                                           {"zstd, gzip;q=0.1", BOTH, GZIP}};
    CHECK(cases);
}

/* Bytes that are no list of codings: the file as it is. */
static void test_malformed(void **state) {
    (void)state;
    static const struct case_of cases[] = {
        {"br;q=1.001", BOTH, IDENTITY}, {"br;q=2", BOTH, IDENTITY},      {"br;q=0.0001", BOTH, IDENTITY},
        {"br;q=-1", BOTH, IDENTITY},    {"br;q=", BOTH, IDENTITY},       {"br;q", BOTH, IDENTITY},
        {"br;", BOTH, IDENTITY},        {"br;level=11", BOTH, IDENTITY}, {"br;q=.5", BOTH, IDENTITY},
        {"br;q=1e0", BOTH, IDENTITY},   {"br;q=nan", BOTH, IDENTITY},    {";q=1", BOTH, IDENTITY},
        {"br gzip", BOTH, IDENTITY},    {"br;q=1;q=1", BOTH, IDENTITY},  {"br, \x80", BOTH, IDENTITY},
        {"\"br\"", BOTH, IDENTITY},     {"br=1", BOTH, IDENTITY},        {"br, gzip;q=1x", BOTH, IDENTITY}};
    CHECK(cases);
}

static void test_names(void **state) {
    (void)state;
    assert_string_equal(lw_content_coding_name(BR), "br");
    assert_string_equal(lw_content_coding_ending(BR), ".br");
    assert_string_equal(lw_content_coding_name(GZIP), "gzip");
    assert_string_equal(lw_content_coding_ending(GZIP), ".gz");
    assert_null(lw_content_coding_name(IDENTITY));
    assert_null(lw_content_coding_ending(NONE));
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_weights), cmocka_unit_test(test_identity),
                                       cmocka_unit_test(test_unknown), cmocka_unit_test(test_malformed),
                                       cmocka_unit_test(test_names)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
