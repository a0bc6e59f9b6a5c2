/* The real lightwelld under a service manager: what it tells the socket of $NOTIFY_SOCKET. */
#include "tests/support/process.h"

#include "common/base/clock.h"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#define LIMIT_S     LW_PROCESS_LIMIT_S
#define WATCHDOG_US "300000"
#define SCENE       "builtin:cornell --texels-per-metre 8 --light whole "

static struct lw_process daemon_process;
static int manager = -1; /* the manager's end */

/* is_abstract: in no folder. */
static void listen_as_manager(bool is_abstract) {
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    char name[100];
    if (is_abstract)
        snprintf(name, sizeof name, "@lightwell-test-service-%d", (int)getpid());
    else
        snprintf(name, sizeof name, "/tmp/lightwell-test-service-%d", (int)getpid());
    memcpy(address.sun_path, name, strlen(name));
    if (is_abstract) address.sun_path[0] = '\0';
    manager = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    assert_true(manager >= 0);
    unlink(name);
    assert_int_equal(bind(manager, (struct sockaddr *)&address,
                          (socklen_t)(offsetof(struct sockaddr_un, sun_path) + strlen(name))),
                     0);
    setenv("NOTIFY_SOCKET", name, 1);
    setenv("WATCHDOG_USEC", WATCHDOG_US, 1);
    unsetenv("WATCHDOG_PID");
}

static int end_all(void **state) {
    (void)state;
    lw_process_kill_all();
    if (manager >= 0) close(manager);
    manager = -1;
    const char *name = getenv("NOTIFY_SOCKET");
    if (name && *name == '/') unlink(name);
    return 0;
}

/* The next datagram, as text; false: none comes within a time. */
static bool hear(char *dst, size_t size, unsigned limit_ms) {
    struct pollfd ready = {.fd = manager, .events = POLLIN};
    if (poll(&ready, 1, (int)limit_ms) <= 0) return false;
    const ssize_t length = recv(manager, dst, size - 1, 0);
    assert_true(length > 0);
    dst[length] = '\0';
    return true;
}

/* Whether one of its lines begins so. */
static bool says(const char *text, const char *line) {
    for (const char *at = text; at; at = (at = strchr(at, '\n')) ? at + 1 : NULL)
        if (strncmp(at, line, strlen(line)) == 0) return true;
    return false;
}

/* Waits for a datagram with both lines; those before it are dropped. */
static void await(const char *line, const char *other) {
    char text[600] = "";
    for (const uint64_t end_ns = lw_clock_ns() + LIMIT_S * 1000000000ull; lw_clock_ns() < end_ns;)
        if (hear(text, sizeof text, 1000) && says(text, line) && says(text, other)) return;
    fail_msg("\"%s\" and \"%s\" never came; last: %s", line, other, text);
}

static void tells_its_life(bool is_abstract) {
    char text[600];
    listen_as_manager(is_abstract);
    lw_process_serve(&daemon_process, SCENE);
    assert_true(hear(text, sizeof text, LIMIT_S * 1000));
    if (!says(text, "READY=1") || !says(text, "STATUS=serving at 127.0.0.1:")) fail_msg("%s", text);
    await("STATUS=first light after ", "");
    for (int i = 0; i < 5; i++) await("WATCHDOG=1", "STATUS="); /* frames, sessions */
    await("WATCHDOG=1", "STATUS=");
    assert_true(hear(text, sizeof text, LIMIT_S * 1000));
    if (!strstr(text, " frames, 0 sessions")) fail_msg("%s", text);
    assert_int_equal(kill(daemon_process.pid, SIGTERM), 0);
    await("STOPPING=1", "");
    assert_int_equal(lw_process_finish(&daemon_process, LIMIT_S), 0);
    while (hear(text, sizeof text, 0)) assert_false(says(text, "READY=1"));
}

static void test_life(void **state) {
    (void)state;
    tells_its_life(false);
}

static void test_abstract_socket(void **state) {
    (void)state;
    tells_its_life(true);
}

/* A solver that waits for its next line rests: that is no hang. */
static void test_rest_is_no_hang(void **state) {
    (void)state;
    int input[2];
    char text[600];
    listen_as_manager(false);
    assert_int_equal(pipe2(input, O_CLOEXEC), 0);
    const int own_input = dup(STDIN_FILENO);
    assert_true(own_input >= 0);
    dup2(input[0], STDIN_FILENO);
    lw_process_serve(&daemon_process, SCENE "--clock manual --stall-limit 0.2");
    dup2(own_input, STDIN_FILENO);
    close(own_input);
    close(input[0]);
    assert_int_equal(write(input[1], "\n", 1), 1);
    await("STATUS=first light after ", "");
    for (int i = 0; i < 10; i++) { /* a second, at 100 ms each */
        assert_true(hear(text, sizeof text, LIMIT_S * 1000));
        if (!says(text, "WATCHDOG=1")) fail_msg("%s", text);
    }
    close(input[1]);
    await("STOPPING=1", "");
    assert_int_equal(lw_process_finish(&daemon_process, LIMIT_S), 0);
}

/* The loop lives, the solver takes too long: the manager is to hear no WATCHDOG. */
static void test_hang(void **state) {
    (void)state;
    char text[600];
    listen_as_manager(false);
    lw_process_serve(&daemon_process, "builtin:atrium-matt --light whole --stall-limit 0.001");
    await("STATUS=the solver has made no progress", "");
    assert_true(hear(text, sizeof text, LIMIT_S * 1000));
    if (says(text, "WATCHDOG=1") || !says(text, "STATUS=the solver has made no progress"))
        fail_msg("%s", text);
    lw_process_end(&daemon_process);
    char *said = lw_process_err(&daemon_process);
    if (!strstr(said, "error: the solver has made no progress within --stall-limit")) fail_msg("%s", said);
    free(said);
}

/* $WATCHDOG_USEC may be another process's, inherited. */
static void test_others_watchdog(void **state) {
    (void)state;
    char text[600];
    listen_as_manager(false);
    setenv("WATCHDOG_PID", "1", 1);
    lw_process_serve(&daemon_process, SCENE);
    await("STATUS=first light after ", "");
    if (hear(text, sizeof text, 1000)) fail_msg("%s", text); /* the next one is due after ten seconds */
    lw_process_end(&daemon_process);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(test_life, end_all),
        cmocka_unit_test_teardown(test_abstract_socket, end_all),
        cmocka_unit_test_teardown(test_rest_is_no_hang, end_all),
        cmocka_unit_test_teardown(test_hang, end_all),
        cmocka_unit_test_teardown(test_others_watchdog, end_all),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
