#include "tests/support/support.h"

#include "common/base/secret_file.h"
#include "server/serve/admission/tokens.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#define A "00112233445566778899aabbccddeeff00112233445566778899aabbccddeeff"
#define B "ffeeddccbbaa99887766554433221100ffeeddccbbaa998877665544332211FF"

static struct lw_token token_of(const char *text) {
    struct lw_token token;
    assert_true(lw_token_parse(text, strlen(text), &token));
    return token;
}

static void test_text(void **state) {
    (void)state;
    struct lw_token token, other;
    char text[LW_TOKEN_TEXT_SIZE];
    lw_token_format(&(struct lw_token){{0, 0x1f, 0xa0}}, text);
    assert_string_equal(text, "001fa00000000000000000000000000000000000000000000000000000000000");
    lw_support_ok(lw_token_make(&token, NULL), NULL);
    lw_support_ok(lw_token_make(&other, NULL), NULL);
    assert_memory_not_equal(token.bytes, other.bytes, sizeof token.bytes);
    lw_token_format(&token, text);
    assert_true(lw_token_parse(text, 64, &other));
    assert_memory_equal(token.bytes, other.bytes, sizeof token.bytes);
    assert_false(lw_token_parse(text, 63, &other));
    for (size_t i = 0; i < 64; i++) {
        const char was = text[i];
        for (const char *wrong = "g/:@G`{ "; *wrong; wrong++) {
            text[i] = *wrong;
            assert_false(lw_token_parse(text, 64, &other));
        }
        text[i] = was;
    }
}

static enum lw_status parse(const char *text, struct lw_tokens **out, struct lw_error *err) {
    *err = (struct lw_error){0};
    return lw_tokens_parse(text, strlen(text), out, err);
}

static void test_roles(void **state) {
    (void)state;
    struct lw_tokens *tokens;
    struct lw_error err;
    lw_support_ok(parse("# who may\n\n  view\t" A "\r\n"
                        "control " B,
                        &tokens, &err),
                  &err);
    struct lw_token a = token_of(A), b = token_of(B);
    assert_int_equal(tokens->count, 2);
    assert_int_equal(lw_tokens_role(tokens, a.bytes), LW_TOKENS_VIEW);
    assert_int_equal(lw_tokens_role(tokens, b.bytes), LW_TOKENS_CONTROL);
    assert_int_equal(lw_tokens_role(tokens, NULL), LW_TOKENS_NONE);
    for (size_t i = 0; i < LW_TOKEN_SIZE; i++) /* any byte counts */
        for (unsigned bit = 1; bit < 256; bit *= 2) {
            struct lw_token near = b;
            near.bytes[i] ^= (uint8_t)bit;
            assert_int_equal(lw_tokens_role(tokens, near.bytes), LW_TOKENS_NONE);
        }
    lw_tokens_destroy(tokens);
    lw_tokens_destroy(NULL);
}

static void test_wrong_lines(void **state) {
    (void)state;
    static const struct {
        const char *text, *says;
    } row[] = {{"", "holds no token"},
               {"# view " A "\n", "holds no token"},
               {"see " A, "line 1: a line is ROLE TOKEN"},
               {"views " A, "line 1: a line is ROLE TOKEN"},
               {A, "line 1: a line is ROLE TOKEN"},
               {"view", "64 hexadecimal"},
               {"\nview " A "0", "line 2: a token is 64 hexadecimal digits"},
               {"view " A " x", "more after"},
               {"view " A "\ncontrol " A, "line 2: another line has the same token"}};
    for (size_t i = 0; i < sizeof row / sizeof *row; i++) {
        struct lw_tokens *tokens = NULL;
        struct lw_error err;
        lw_support_fails(parse(row[i].text, &tokens, &err), LW_BAD_DATA, &err, row[i].says);
        assert_null(strstr(err.text, "0011")); /* a log must not have it */
        assert_null(tokens);
    }
}

static void test_the_number_is_bounded(void **state) {
    (void)state;
    char *text = malloc((LW_TOKENS_MAX + 1) * 80ul + 1), *at = text;
    assert_non_null(text);
    for (unsigned i = 0; i <= LW_TOKENS_MAX; i++) at += sprintf(at, "view %064x\n", i);
    struct lw_tokens *tokens;
    struct lw_error err;
    lw_support_fails(parse(text, &tokens, &err), LW_BAD_DATA, &err, "over 1024 tokens");
    at[-70] = 0;
    lw_support_ok(parse(text, &tokens, &err), &err);
    assert_int_equal(tokens->count, LW_TOKENS_MAX);
    lw_tokens_destroy(tokens);
    free(text);
}

static void test_the_file_is_bounded(void **state) {
    (void)state;
    const char *path = lw_support_temporary("tokens");
    char *text = malloc(LW_TOKENS_FILE_MAX + 1);
    struct lw_tokens *tokens;
    struct lw_error err = {0};
    assert_non_null(text);
    memset(text, '\n', LW_TOKENS_FILE_MAX + 1);
    memcpy(text, "view " A, sizeof "view " A - 1);
    lw_support_write_file(path, text, LW_TOKENS_FILE_MAX);
    assert_int_equal(chmod(path, 0600), 0);
    lw_support_ok(lw_tokens_read(path, &tokens, &err), &err);
    lw_tokens_destroy(tokens);
    lw_support_write_file(path, text, LW_TOKENS_FILE_MAX + 1);
    lw_support_fails(lw_tokens_read(path, &tokens, &err), LW_BAD_DATA, &err, "the limit is");
    assert_int_equal(remove(path), 0);
    free(text);
}

static void write_with_mode(const char *path, const char *text, mode_t mode) {
    lw_support_write_file(path, text, strlen(text));
    assert_int_equal(chmod(path, mode), 0);
}

static void test_files(void **state) {
    (void)state;
    const char *path = lw_support_temporary("tokens");
    struct lw_tokens *tokens;
    struct lw_error err = {0};
    lw_support_fails(lw_tokens_read(path, &tokens, &err), LW_NO_INPUT, &err, path);
    static const mode_t open_to_others[] = {0604, 0640, 0602, 0620, 0610, 0601, 0777};
    for (size_t i = 0; i < sizeof open_to_others / sizeof *open_to_others; i++) {
        write_with_mode(path, "view " A, open_to_others[i]);
        err = (struct lw_error){0};
        lw_support_fails(lw_tokens_read(path, &tokens, &err), LW_BAD_DATA, &err, "chmod 600");
    }
    write_with_mode(path, "view " A, 0400);
    err = (struct lw_error){0};
    lw_support_ok(lw_tokens_read(path, &tokens, &err), &err);
    lw_tokens_destroy(tokens);
    write_with_mode(path, "\n# mine\nview " A " \nview x", 0600);
    struct lw_token token, a = token_of(A);
    lw_support_ok(lw_token_read(path, &token, &err), &err); /* a client takes its line */
    assert_memory_equal(token.bytes, a.bytes, sizeof a.bytes);
    write_with_mode(path, "view", 0600);
    lw_support_fails(lw_token_read(path, &token, &err), LW_BAD_DATA, &err, path);
    uint8_t *bytes;
    size_t size;
    write_with_mode(path, "key", 0640);
    err = (struct lw_error){0};
    lw_support_ok(lw_secret_file_read(path, LW_SECRET_FILE_GROUP, 3, &bytes, &size, &err), &err);
    assert_int_equal(size, 3);
    assert_string_equal((char *)bytes, "key");
    lw_secret_file_free(bytes, size);
    lw_support_fails(lw_secret_file_read(path, LW_SECRET_FILE_GROUP, 2, &bytes, &size, &err), LW_BAD_DATA,
                     &err, "the limit is 2");
    write_with_mode(path, "key", 0644);
    err = (struct lw_error){0};
    lw_support_fails(lw_secret_file_read(path, LW_SECRET_FILE_GROUP, 3, &bytes, &size, &err), LW_BAD_DATA,
                     &err, "chmod 640");
}

static void test_credentials(void **state) {
    (void)state;
    const char *path = lw_support_temporary("tokens");
    char folder[300];
    snprintf(folder, sizeof folder, "%.*s", (int)(strrchr(path, '/') - path), path);
    write_with_mode(path, "view " A, 0440); /* systemd lets the unit's user read by a list, which shows so */
    struct lw_tokens *tokens;
    struct lw_error err = {0};
    unsetenv("CREDENTIALS_DIRECTORY");
    lw_support_fails(lw_tokens_read("credential:tokens", &tokens, &err), LW_NO_INPUT, &err,
                     "LoadCredential=");
    setenv("CREDENTIALS_DIRECTORY", folder, 1);
    err = (struct lw_error){0};
    lw_support_ok(lw_tokens_read("credential:tokens", &tokens, &err), &err);
    lw_tokens_destroy(tokens);
    lw_support_fails(lw_tokens_read("credential:../tokens", &tokens, &err), LW_BAD_DATA, &err,
                     "not the name");
    err = (struct lw_error){0};
    lw_support_fails(lw_tokens_read("credential:none", &tokens, &err), LW_NO_INPUT, &err, "credential:none");
    unsetenv("CREDENTIALS_DIRECTORY");
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_text),
        cmocka_unit_test(test_roles),
        cmocka_unit_test(test_wrong_lines),
        cmocka_unit_test(test_the_number_is_bounded),
        cmocka_unit_test(test_the_file_is_bounded),
        cmocka_unit_test(test_files),
        cmocka_unit_test(test_credentials),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
