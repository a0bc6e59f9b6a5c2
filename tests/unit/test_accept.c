#include "tests/support/support.h"
#include "tests/support/web_peer.h"

#include "proto/message.h"
#include "server/serve/server.h"
#include "server/serve/sessions/turns.h"

#include <limits.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>
#include <uv.h>

/* Connections that come when there is no memory for them, or many at once: later ones are served. */

#define MANY    200
#define WAIT_MS 600000 /* ends what hangs */

static pthread_t loop;
static _Atomic int runs, callocs_to_fail, mallocs_to_fail;
static unsigned accepted, accepted_most; /* in a turn */

void *__real_malloc(size_t size);
void *__real_calloc(size_t count, size_t size);
int __real_uv_accept(uv_stream_t *listener, uv_stream_t *stream);
void __real_lw_turns_read_on(struct lw_session_shared *shared);

static bool fails(_Atomic int *left) {
    return runs && pthread_equal(pthread_self(), loop) && *left > 0 && (*left)-- > 0;
}

void *__wrap_malloc(size_t size);
void *__wrap_malloc(size_t size) { return fails(&mallocs_to_fail) ? NULL : __real_malloc(size); }

void *__wrap_calloc(size_t count, size_t size);
void *__wrap_calloc(size_t count, size_t size) {
    return fails(&callocs_to_fail) ? NULL : __real_calloc(count, size);
}

int __wrap_uv_accept(uv_stream_t *listener, uv_stream_t *stream);
int __wrap_uv_accept(uv_stream_t *listener, uv_stream_t *stream) {
    const int result = __real_uv_accept(listener, stream);
    if (result == 0 && ++accepted > accepted_most) accepted_most = accepted;
    return result;
}

/* once a turn */
void __wrap_lw_turns_read_on(struct lw_session_shared *shared);
void __wrap_lw_turns_read_on(struct lw_session_shared *shared) {
    accepted = 0;
    __real_lw_turns_read_on(shared);
}

/* ---- the server ---- */

static struct lw_server *server;
static struct lw_atlas_map map;
static struct lw_scene *scene;

static void *serve(void *unused) {
    (void)unused;
    loop = pthread_self();
    runs = 1;
    lw_support_ok(lw_server_run(server, NULL), NULL);
    return NULL;
}

static int create(void **state) {
    (void)state;
    static const uint8_t package[] = "package";
    struct lw_error err = {0};
    scene = lw_support_squares(1, 1);
    scene->mesh[0].atlas_width = scene->mesh[0].atlas_height = 16;
    lw_support_ok(lw_atlas_map_init(&map, scene), NULL);
    const struct lw_server_desc desc = {.host = "127.0.0.1",
                                        .http_host = "127.0.0.1",
                                        .control_socket = lw_support_temporary("control"),
                                        .atlas_map = &map,
                                        .package = package,
                                        .package_size = sizeof package,
                                        .bounces = 1,
                                        .target_error = 0.1f};
    lw_support_ok(lw_server_create(&desc, &server, &err), &err);
    callocs_to_fail = mallocs_to_fail = 0;
    accepted = accepted_most = 0;
    return 0;
}

static int destroy(void **state) {
    (void)state;
    runs = 0;
    lw_server_destroy(server);
    lw_atlas_map_finish(&map);
    lw_scene_destroy(scene);
    return 0;
}

static pthread_t begin(void) {
    pthread_t thread;
    assert_int_equal(pthread_create(&thread, NULL, serve, NULL), 0);
    LW_SUPPORT_WAIT_UNTIL(runs);
    return thread;
}

static void end(pthread_t thread) {
    lw_server_stop(server);
    assert_int_equal(pthread_join(thread, NULL), 0);
}

static void expect_closed(int s) {
    assert_true(lw_web_peer_closes(s, WAIT_MS));
    close(s);
}

static void say_hello(int s) {
    uint8_t *bytes;
    size_t size;
    const struct lw_message hello = {.type = LW_MESSAGE_HELLO,
                                     .hello = {.version = LW_WIRE_VERSION, .name = "test"}};
    lw_support_ok(lw_message_encode_alloc(&hello, &bytes, &size), NULL);
    assert_int_equal(send(s, bytes, size, MSG_NOSIGNAL), (ssize_t)size);
    free(bytes);
}

static void expect_welcome(int s) {
    uint8_t byte;
    say_hello(s);
    assert_int_equal(recv(s, &byte, 1, 0), 1);
    close(s);
}

static void expect_page(void) {
    const int s = lw_web_peer_dial(lw_server_http_port(server));
    char *answer = lw_web_peer_ask(s, "GET / HTTP/1.1\r\nHost: localhost\r\n\r\n", false, NULL);
    assert_non_null(strstr(answer, " 200 "));
    free(answer);
    close(s);
}

static int dial(void) { return lw_web_peer_dial(lw_server_port(server)); }

static int dial_locally(void) {
    struct sockaddr_un to = {.sun_family = AF_UNIX};
    snprintf(to.sun_path, sizeof to.sun_path, "%s", lw_support_temporary("control"));
    const int s = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    assert_int_equal(connect(s, (const struct sockaddr *)&to, sizeof to), 0);
    return s;
}

static void sessions_without_memory(int (*dial_one)(void)) {
    for (int at_once = 1; at_once <= 3; at_once++) {
        int s[3];
        callocs_to_fail = at_once;
        for (int i = 0; i < at_once; i++) s[i] = dial_one();
        for (int i = 0; i < at_once; i++) expect_closed(s[i]);
        assert_int_equal(callocs_to_fail, 0);
        expect_welcome(dial_one());
    }
}

static void test_no_memory_for_a_session(void **state) {
    (void)state;
    const pthread_t thread = begin();
    sessions_without_memory(dial);
    sessions_without_memory(dial_locally);
    end(thread);
}

/* Nobody's connection has any memory for a while, at any listener. */
static void test_no_memory_at_all(void **state) {
    (void)state;
    const pthread_t thread = begin();
    for (int round = 0; round < 3; round++) {
        callocs_to_fail = mallocs_to_fail = INT_MAX;
        const int s[] = {dial(), lw_web_peer_dial(lw_server_http_port(server)), dial_locally()};
        for (size_t i = 0; i < sizeof s / sizeof *s; i++) expect_closed(s[i]);
        callocs_to_fail = mallocs_to_fail = 0;
    }
    expect_welcome(dial());
    expect_welcome(dial_locally());
    expect_page();
    end(thread);
}

static void test_no_memory_for_http(void **state) {
    (void)state;
    const pthread_t thread = begin();
    for (int at_once = 1; at_once <= 3; at_once++) {
        int s[3];
        mallocs_to_fail = at_once;
        for (int i = 0; i < at_once; i++) s[i] = lw_web_peer_dial(lw_server_http_port(server));
        for (int i = 0; i < at_once; i++) expect_closed(s[i]);
        assert_int_equal(mallocs_to_fail, 0);
        expect_page();
    }
    callocs_to_fail = 1; /* the connection's allocation, once there is a descriptor */
    expect_closed(lw_web_peer_dial(lw_server_http_port(server)));
    expect_page();
    end(thread);
}

/* They wait in the system before the loop's first turn. */
static void test_many_at_once(void **state) {
    (void)state;
    static int s[MANY];
    for (int i = 0; i < MANY; i++) s[i] = lw_web_peer_dial(lw_server_port(server));
    for (int i = 0; i < MANY; i++) say_hello(s[i]);
    const pthread_t thread = begin();
    for (int i = 0; i < MANY; i++) {
        uint8_t byte;
        assert_int_equal(recv(s[i], &byte, 1, 0), 1);
        close(s[i]);
    }
    end(thread);
    assert_int_equal(accepted_most, LW_SERVER_TURN_CONNECTIONS);
}

int main(void) {
#define TEST(name) cmocka_unit_test_setup_teardown(name, create, destroy)
    const struct CMUnitTest tests[] = {
        TEST(test_no_memory_for_a_session),
        TEST(test_no_memory_for_http),
        TEST(test_no_memory_at_all),
        TEST(test_many_at_once),
    };
#undef TEST
    return cmocka_run_group_tests(tests, NULL, NULL);
}
