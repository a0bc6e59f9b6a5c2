#include "tests/support/serving.h"

#include "server/serve/server.h"
#include "tests/support/server_clock.h"

#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>

/* Tokens, the control socket, and what needs them. */

static const uint8_t view_token[LW_TOKEN_SIZE] = {1, 2, 3}, control_token[LW_TOKEN_SIZE] = {4, 5, 6},
                     no_token[LW_TOKEN_SIZE] = {1, 2, 3, 4};

/* Bytes in hex follow the role; either token may be NULL. */
static const char *write_tokens(const uint8_t *view, const uint8_t *control) {
    const char *path = lw_support_temporary("tokens");
    char text[400] = "# of a test\n", digits[LW_TOKEN_TEXT_SIZE];
    struct lw_token token;
    for (int i = 0; i < 2; i++) {
        const uint8_t *bytes = i ? control : view;
        if (!bytes) continue;
        memcpy(token.bytes, bytes, sizeof token.bytes);
        lw_token_format(&token, digits);
        const size_t length = strlen(text);
        snprintf(text + length, sizeof text - length, "%s %s\n", i ? "control" : "view", digits);
    }
    lw_support_write_file(path, text, strlen(text));
    assert_int_equal(chmod(path, 0600), 0);
    return path;
}

static void put_hello(int s, const uint8_t *token) {
    serving_put(s,
                &(struct lw_message){
                    .type = LW_MESSAGE_HELLO,
                    .hello = {.version = LW_WIRE_VERSION, .features = LW_FEATURE_CONTROL, .token = token}});
}

static int dial_with_token(const struct serving *f, const uint8_t *token, uint64_t features) {
    int s = serving_dial(f);
    struct lw_message m;
    put_hello(s, token);
    serving_expect(s, LW_MESSAGE_WELCOME, &m);
    assert_int_equal(m.welcome.features, features);
    lw_message_finish(&m);
    return s;
}

static void test_tokens(void **state) {
    (void)state;
    struct serving *f = serving_start_controlled_with(
        (struct lw_server_desc){.tokens = write_tokens(view_token, control_token)});
    int s = serving_dial(f);
    put_hello(s, NULL);
    serving_expect_refusal(s, LW_REFUSAL_TOKEN);
    s = serving_dial(f);
    put_hello(s, no_token);
    serving_expect_refusal(s, LW_REFUSAL_TOKEN);
    s = dial_with_token(f, view_token, 0);
    serving_update(s, 1, &serving_hide_1, 1);
    serving_expect_refusal(s, LW_REFUSAL_NOT_ALLOWED);
    s = dial_with_token(f, control_token, LW_FEATURE_CONTROL);
    serving_update(s, 1, &serving_hide_1, 1);
    free(serving_take(f, 1, 1, 1));
    close(s);
    serving_end(f);
}

/* One in twenty places is kept for those who may control; the own user's Unix socket takes none. */
static void test_places_are_kept_for_control(void **state) {
    (void)state;
    struct serving *f = serving_start_controlled_with((struct lw_server_desc){
        .tokens = write_tokens(view_token, control_token), .sessions_max = 40, .address_sessions_max = 40});
    int s[42];
    for (int i = 0; i < 38; i++) s[i] = dial_with_token(f, view_token, 0);
    int one_more = serving_dial(f);
    put_hello(one_more, view_token);
    serving_expect_refusal(one_more, LW_REFUSAL_FULL);
    LW_SUPPORT_WAIT_UNTIL(serving_stats_of(f).refused == 1);
    s[38] = dial_with_token(f, control_token, LW_FEATURE_CONTROL);
    for (s[39] = -1; s[39] < 0;) { /* the refused one's place becomes free when its link is closed */
        struct lw_message m;
        const int t = serving_dial(f);
        put_hello(t, control_token);
        assert_true(serving_get(t, &m));
        if (m.type == LW_MESSAGE_WELCOME)
            s[39] = t;
        else
            close(t), server_clock_step(SERVING_STEP_MS);
        lw_message_finish(&m);
    }
    one_more = serving_dial(f);
    put_hello(one_more, control_token);
    serving_expect_refusal(one_more, LW_REFUSAL_FULL);
    s[40] = serving_dial_and_control(f, false);
    s[41] = serving_dial_and_control(f, false);
    for (int i = 0; i < 42; i++) close(s[i]);
    serving_end(f);
}

static _Atomic unsigned reload_count;

static void reload_files(void *context) {
    struct serving **f = context;
    lw_server_reload((*f)->server);
    reload_count++;
}

static void expect_still_there(int s) {
    struct lw_message m;
    serving_put(s, &(struct lw_message){.type = LW_MESSAGE_PING, .ping.token = 1});
    serving_expect(s, LW_MESSAGE_PONG, &m);
    lw_message_finish(&m);
}

static void test_tokens_are_read_again(void **state) {
    (void)state;
    struct serving *f = NULL;
    f = serving_start_controlled_with((struct lw_server_desc){
        .tokens = write_tokens(view_token, control_token), .hooks = {.reload = reload_files, .context = &f}});
    int viewer = dial_with_token(f, view_token, 0),
        controller = dial_with_token(f, control_token, LW_FEATURE_CONTROL), s;
    write_tokens(no_token, control_token);
    kill(getpid(), SIGHUP);
    serving_expect_refusal(viewer, LW_REFUSAL_TOKEN); /* it has gone */
    expect_still_there(controller);
    s = serving_dial(f);
    put_hello(s, view_token);
    serving_expect_refusal(s, LW_REFUSAL_TOKEN);
    close(dial_with_token(f, no_token, 0));
    write_tokens(NULL, NULL); /* a file that cannot be used changes nothing */
    const unsigned before = reload_count;
    kill(getpid(), SIGHUP);
    LW_SUPPORT_WAIT_UNTIL(reload_count > before);
    expect_still_there(controller);
    s = dial_with_token(f, no_token, 0);
    write_tokens(control_token, no_token); /* roles have changed */
    kill(getpid(), SIGHUP);
    serving_expect_refusal(controller, LW_REFUSAL_TOKEN);
    serving_expect_refusal(s, LW_REFUSAL_TOKEN);
    close(dial_with_token(f, no_token, LW_FEATURE_CONTROL));
    serving_end(f);
}

static void test_the_control_socket(void **state) {
    (void)state;
    const char *path = lw_support_temporary("control.sock");
    struct serving *f =
        serving_start_controlled_with((struct lw_server_desc){.tokens = write_tokens(view_token, NULL)});
    struct stat info;
    assert_int_equal(stat(path, &info), 0);
    assert_int_equal(info.st_mode & 0777, 0600);
    close(serving_dial_and_control(f, false)); /* it needs no token */
    struct lw_server_desc desc = {.control_socket = path,
                                  .atlas_map = &f->map,
                                  .package = f->package,
                                  .package_size = SERVING_PACKAGE_SIZE};
    struct lw_server *second;
    struct lw_error err = {0};
    lw_support_fails(lw_server_create(&desc, &second, &err), LW_UNAVAILABLE, &err, "is there already");
    close(serving_dial_and_control(f, false)); /* it is still the first one's */
    serving_end(f);
    assert_int_equal(access(path, F_OK), -1);
    int left = socket(AF_UNIX, SOCK_STREAM, 0); /* as a server leaves it that was killed */
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    snprintf(address.sun_path, sizeof address.sun_path, "%s", path);
    assert_int_equal(bind(left, (struct sockaddr *)&address, sizeof address), 0);
    close(left);
    f = serving_start_controlled();
    close(serving_dial_and_control(f, false));
    serving_end(f);
    lw_support_write_file(path, "mine", 4); /* a file that is no socket stays */
    f = serving_start(&(struct lw_server_desc){0});
    err = (struct lw_error){0};
    lw_support_fails(lw_server_create(&desc, &second, &err), LW_UNAVAILABLE, &err, path);
    assert_int_equal(stat(path, &info), 0);
    assert_int_equal(info.st_size, 4);
    serving_end(f);
    unlink(path);
}

/* In a child that has become somebody else: 0 if it is refused as it should be. */
static int try_as_somebody_else(void) {
    struct lw_message m;
    if (setuid(65534) != 0) return 1;
    int s = serving_dial_locally();
    put_hello(s, NULL);
    if (!serving_get(s, &m) || m.type != LW_MESSAGE_REFUSAL) return 2;
    return m.refusal.code == LW_REFUSAL_NOT_ALLOWED ? 0 : 3;
}

static void test_the_control_socket_knows_its_user(void **state) {
    (void)state;
    if (geteuid() != 0) {
        print_message("skipped: only root can become another user\n");
        skip();
    }
    struct serving *f = serving_start_controlled();
    /* the file's permissions would keep it out: this tests the check behind them */
    const char *path = lw_support_temporary("control.sock");
    char folder[200];
    snprintf(folder, sizeof folder, "%.*s", (int)(strrchr(path, '/') - path), path);
    assert_int_equal(chmod(folder, 0755), 0);
    assert_int_equal(chmod(path, 0666), 0);
    const pid_t child = fork();
    if (child == 0) _exit(try_as_somebody_else());
    int status;
    assert_int_equal(waitpid(child, &status, 0), child);
    assert_true(WIFEXITED(status));
    assert_int_equal(WEXITSTATUS(status), 0);
    close(serving_dial_and_control(f, false));
    serving_end(f);
}

static void test_token_files_that_cannot_be_used(void **state) {
    (void)state;
    struct serving *f = serving_start(&(struct lw_server_desc){0});
    struct lw_server_desc desc = {
        .atlas_map = &f->map, .package = f->package, .package_size = SERVING_PACKAGE_SIZE};
    struct lw_server *server;
    struct lw_error err = {0};
    desc.tokens = write_tokens(view_token, NULL);
    assert_int_equal(chmod(desc.tokens, 0644), 0);
    lw_support_fails(lw_server_create(&desc, &server, &err), LW_BAD_DATA, &err, "--tokens: ");
    assert_non_null(strstr(err.text, "others can read"));
    serving_end(f);
}

static void test_updates_want_the_role(void **state) {
    (void)state;
    struct serving *f = serving_start_controlled();
    int s = serving_dial_and_greet(f); /* without the feature */
    serving_update(s, 1, &serving_hide_1, 1);
    serving_expect_refusal(s, LW_REFUSAL_NOT_ALLOWED);
    s = dial_with_token(f, NULL, 0); /* from this machine, but over TCP */
    serving_update(s, 1, &serving_hide_1, 1);
    serving_expect_refusal(s, LW_REFUSAL_NOT_ALLOWED);
    s = serving_dial_locally(); /* before hello */
    serving_update(s, 1, &serving_hide_1, 1);
    serving_expect_refusal(s, LW_REFUSAL_PROTOCOL);
    serving_end(f);
    f = serving_start(&(struct lw_server_desc){0}); /* a server without a scene takes up nothing */
    s = serving_dial(f);
    struct lw_message m, control = serving_hello;
    control.hello.features = LW_FEATURE_CONTROL;
    serving_put(s, &control);
    serving_expect(s, LW_MESSAGE_WELCOME, &m);
    assert_int_equal(m.welcome.features, 0);
    lw_message_finish(&m);
    serving_update(s, 1, &serving_hide_1, 1);
    serving_expect_refusal(s, LW_REFUSAL_NOT_ALLOWED);
    serving_end(f);
}

/* Over the server's own socket alone, and for sessions that offer it; an unknown question is answered,
 * too. */
static void test_operators_ask_over_the_socket(void **state) {
    (void)state;
    struct serving *f = serving_start_controlled();
    struct lw_message m, asker = serving_hello;
    const struct lw_message stats = {.type = LW_MESSAGE_ASK, .ask = {5, LW_ASK_STATS, 0}},
                            unknown = {.type = LW_MESSAGE_ASK, .ask = {6, 99, 0}};
    asker.hello.features |= LW_FEATURE_OPERATE;
    int s = serving_dial(f);
    serving_put(s, &asker);
    serving_expect(s, LW_MESSAGE_WELCOME, &m);
    assert_false(m.welcome.features & LW_FEATURE_OPERATE);
    lw_message_finish(&m);
    serving_put(s, &stats);
    serving_expect_refusal(s, LW_REFUSAL_NOT_ALLOWED);
    s = serving_dial_locally();
    serving_put(s, &serving_hello); /* does not say so */
    serving_expect(s, LW_MESSAGE_WELCOME, &m);
    lw_message_finish(&m);
    serving_put(s, &stats);
    serving_expect_refusal(s, LW_REFUSAL_NOT_ALLOWED);
    s = serving_dial_locally();
    serving_put(s, &asker);
    serving_expect(s, LW_MESSAGE_WELCOME, &m);
    assert_true(m.welcome.features & LW_FEATURE_OPERATE);
    lw_message_finish(&m);
    serving_put(s, &unknown);
    serving_expect(s, LW_MESSAGE_REPORT, &m);
    assert_int_equal(m.report.request, 6);
    assert_int_equal(m.report.code, LW_REPORT_UNKNOWN);
    lw_message_finish(&m);
    serving_put(s, &stats); /* this server has no pages */
    serving_expect(s, LW_MESSAGE_REPORT, &m);
    assert_int_equal(m.report.request, 5);
    assert_int_equal(m.report.code, LW_REPORT_UNKNOWN);
    lw_message_finish(&m);
    close(s);
    serving_end(f);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_updates_want_the_role),
        cmocka_unit_test(test_operators_ask_over_the_socket),
        cmocka_unit_test(test_tokens),
        cmocka_unit_test(test_places_are_kept_for_control),
        cmocka_unit_test(test_the_control_socket),
        cmocka_unit_test(test_the_control_socket_knows_its_user),
        cmocka_unit_test(test_tokens_are_read_again),
        cmocka_unit_test(test_token_files_that_cannot_be_used),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
