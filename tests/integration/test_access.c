/* Access, with the real programs: tokens, the Unix socket. */
#include "tests/support/process.h"

#include "common/base/token.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static struct lw_process server;

/* Makes a token by lightwellctl; the file holds its line and nobody else may read it. */
static const char *make_token(const char *role, const char *name) {
    struct lw_process ctl;
    char arguments[40];
    snprintf(arguments, sizeof arguments, "token %s", role);
    lw_process_run(&ctl, "lightwellctl", arguments, 0);
    char *line = lw_process_out(&ctl);
    assert_int_equal(strlen(line), strlen(role) + 1 + 2 * LW_TOKEN_SIZE + 1);
    const char *path = lw_support_temporary(name);
    lw_support_write_file(path, line, strlen(line));
    assert_int_equal(chmod(path, 0600), 0);
    free(line);
    return path;
}

/* Both lines in the file of the server. */
static void serve_with_tokens(const char *view, const char *control) {
    const char *path = lw_support_temporary("tokens");
    FILE *file = fopen(path, "w");
    assert_non_null(file);
    const char *const part[] = {view, control};
    for (int i = 0; i < 2; i++) {
        size_t size;
        char *line = (char *)lw_support_read_file(part[i], &size);
        assert_int_equal(fwrite(line, 1, size, file), size);
        free(line);
    }
    assert_int_equal(fclose(file), 0);
    assert_int_equal(chmod(path, 0600), 0);
    char arguments[400];
    snprintf(arguments, sizeof arguments,
             "builtin:cornell --http none --freeze 0 --control-socket none --tokens %s", path);
    lw_process_serve(&server, arguments);
}

/* Runs it on the server's port; returns its exit code. token_file: or NULL. said: part of what
 * it says on stderr, or NULL. */
static int run(const char *program, const char *options, const char *token_file, const char *said) {
    struct lw_process process;
    char arguments[500];
    snprintf(arguments, sizeof arguments, "%u %s%s%s", server.port, options,
             token_file ? " --token-file " : "", token_file ? token_file : "");
    lw_process_start(&process, program, arguments);
    const int code = lw_process_finish(&process, LW_PROCESS_LIMIT_S);
    char *text = lw_process_err(&process);
    if (said && !strstr(text, said)) fail_msg("%s %s said %s", program, arguments, text);
    free(text);
    return code;
}

static void test_programs_with_tokens(void **state) {
    (void)state;
    char view[200], control[200];
    snprintf(view, sizeof view, "%s", make_token("view", "view"));
    snprintf(control, sizeof control, "%s", make_token("control", "control"));
    serve_with_tokens(view, control);
    assert_int_equal(run("lightwellctl", "status", NULL, "wants a token (--token-file, LIGHTWELL_TOKEN)"),
                     77);
    assert_int_equal(
        run("lightwellctl", "status", make_token("view", "other"), "the token is not one of this server's"),
        77);
    assert_int_equal(run("lightwellctl", "sky 1 1 1", view, "a token for control"), 69);
    assert_int_equal(run("lightwellctl", "sky 1 1 1", control, NULL), 0);
    assert_int_equal(run("lightwell-load", "--users 3 --seconds 1", NULL, "wants a token"), 77);
    assert_int_equal(run("lightwell-load", "--users 3 --seconds 1", view, NULL), 0);
    assert_int_equal(run("lightwell-view", "--headless --wait first --json", NULL, "wants a token"), 77);
    assert_int_equal(run("lightwell-view", "--headless --wait first --json", view, NULL), 0);
    size_t size;
    char *line = (char *)lw_support_read_file(view, &size);
    line[strlen("view ") + 2 * LW_TOKEN_SIZE] = 0;
    setenv("LIGHTWELL_TOKEN", line + strlen("view "), 1);
    assert_int_equal(run("lightwellctl", "status", NULL, NULL), 0);
    setenv("LIGHTWELL_TOKEN", "00", 1);
    assert_int_equal(run("lightwellctl", "status", NULL, "LIGHTWELL_TOKEN is not 64 hexadecimal digits"), 64);
    unsetenv("LIGHTWELL_TOKEN");
    char *log = lw_process_err(&server); /* which no token may reach */
    assert_null(strstr(log, line + strlen("view ")));
    free(log);
    free(line);
    assert_int_equal(chmod(view, 0644), 0);
    assert_int_equal(run("lightwellctl", "status", view, "--token-file: "), 65);
    lw_process_end(&server);
}

static void test_programs_by_the_control_socket(void **state) {
    (void)state;
    char path[200], arguments[300];
    snprintf(path, sizeof path, "%s", lw_support_temporary("control.sock"));
    setenv("XDG_RUNTIME_DIR", lw_support_temporary("runtime"), 1);
    assert_int_equal(mkdir(lw_support_temporary("runtime"), 0700), 0);
    lw_process_serve(&server, "builtin:cornell --http none --freeze 0");
    assert_int_equal(run("lightwellctl", "sky 1 1 1", NULL, NULL), 0); /* found by the port */
    lw_process_end(&server);
    snprintf(arguments, sizeof arguments, "builtin:cornell --http none --freeze 0 --control-socket %s", path);
    lw_process_serve(&server, arguments);
    assert_int_equal(run("lightwellctl", "sky 1 1 1", NULL, "a token for control"), 69);
    struct lw_process ctl;
    snprintf(arguments, sizeof arguments, "unix:%s sky 1 1 1", path);
    lw_process_run(&ctl, "lightwellctl", arguments, 0);
    lw_process_end(&server);
    assert_int_equal(rmdir(lw_support_temporary("runtime/lightwell")), 0); /* the socket has gone */
    assert_int_equal(rmdir(lw_support_temporary("runtime")), 0);
    lw_process_run(&ctl, "lightwellctl", arguments, 69);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(test_programs_with_tokens, lw_process_teardown),
        cmocka_unit_test_teardown(test_programs_by_the_control_socket, lw_process_teardown),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
