/* The real lightwelld over WebSocket: access, a session as over TCP, peers that misbehave. */
#include "tests/integration/web_case.h"
#include "tests/support/web_peer.h"

#include "common/base/clock.h"
#include "proto/message.h"
#include "proto/message_reader.h"

#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#define MESSAGES_MAX 4096u

static const struct lw_message hello = {
    .type = LW_MESSAGE_HELLO,
    .hello = {.version = LW_WIRE_VERSION, .features = LW_FEATURES_READ | LW_FEATURE_CONTROL, .name = "web"}};
static const struct lw_message request = {.type = LW_MESSAGE_PACKAGE_REQUEST};

/* ---- WebSocket ---- */

static unsigned upgrade(const char *path, const char *lines) {
    char all[1024];
    const int s = lw_web_peer_dial(web_case_port);
    snprintf(all, sizeof all, "Host: 127.0.0.1:%u\r\n%s", (unsigned)web_case_port, lines);
    const unsigned status = lw_web_peer_upgrade(s, path, all);
    close(s);
    return status;
}

#define PROTOCOL "Sec-WebSocket-Protocol: lightwell\r\n"

static void test_who_may_open(void **state) {
    (void)state;
    web_case_serve("--http-origin https://a.example,http://b.example:81");
    char own[128], other_port[128];
    snprintf(own, sizeof own, PROTOCOL "Origin: http://127.0.0.1:%u\r\n", (unsigned)web_case_port);
    snprintf(other_port, sizeof other_port, PROTOCOL "Origin: http://127.0.0.1:%u\r\n",
             (unsigned)web_case_port ^ 1u);
    assert_int_equal(upgrade("/ws", PROTOCOL), 101);
    assert_int_equal(upgrade("/ws", own), 101);
    assert_int_equal(upgrade("/ws", "Sec-WebSocket-Protocol: other, lightwell\r\n"), 101);
    assert_int_equal(upgrade("/ws", PROTOCOL "Origin: https://a.example\r\n"), 101);
    assert_int_equal(upgrade("/ws", PROTOCOL "Origin: http://B.example:81\r\n"), 101);
    assert_int_equal(upgrade("/ws", PROTOCOL "Origin: http://b.example\r\n"), 403);
    assert_int_equal(upgrade("/ws", PROTOCOL "Origin: http://evil.example\r\n"), 403);
    assert_int_equal(upgrade("/ws", PROTOCOL "Origin: null\r\n"), 403);
    assert_int_equal(upgrade("/ws", PROTOCOL "Origin: file://127.0.0.1\r\n"), 403);
    assert_int_equal(upgrade("/ws", other_port), 403); /* another program's page */
    assert_int_equal(upgrade("/ws", ""), 400);
    assert_int_equal(upgrade("/other", PROTOCOL), 404);
    assert_int_equal(upgrade("/", PROTOCOL), 404);
    assert_true(upgrade("/ws", "Sec-WebSocket-Protocol: other\r\n") != 101);
    const int s = lw_web_peer_dial(web_case_port);
    assert_int_equal(lw_web_peer_upgrade(s, "/ws", "Host: evil.example\r\n" PROTOCOL), 403);
    close(s);
    /* what a page may ask in place of the answer that its browser hides */
    char *why;
    assert_int_equal(web_case_ask("GET", "/ws", "Origin: http://evil.example\r\n", &why, NULL), 403);
    web_case_expect_header(why, "\r\naccess-control-allow-origin: *\r\n");
    web_case_expect_header(why, "--http-origin");
    free(why);
    assert_int_equal(web_case_ask("GET", "/ws", "Origin: https://a.example\r\n", &why, NULL), 426);
    web_case_expect_header(why, "\r\naccess-control-allow-origin: *\r\n");
    free(why);
    assert_int_equal(web_case_ask("GET", "/", "Origin: https://a.example\r\n", &why, NULL), 200);
    assert_null(strcasestr(why, "access-control"));
    free(why);
    const int h2 = lw_web_peer_dial(web_case_port);
    char *answer =
        lw_web_peer_ask(h2,
                        "GET /ws HTTP/1.1\r\nHost: localhost\r\nConnection: Upgrade, HTTP2-Settings\r\n"
                        "Upgrade: h2c\r\nHTTP2-Settings: AAMAAABkAAQAAP__\r\n\r\n",
                        false, NULL);
    assert_non_null(strstr(answer, " 404 "));
    free(answer);
    close(h2);
    web_case_stop();
}

/* One end of a session, over either kind of link. */
struct peer {
    int socket;
    bool is_web;
    struct lw_message_reader reader;
    uint8_t *lent; /* to it */
    unsigned close_code;
    char close_reason[128];
};

static struct peer dial(bool is_web) {
    return (struct peer){.socket = is_web ? lw_web_peer_open(web_case_port)
                                          : lw_web_peer_dial(web_case_daemon.port),
                         .is_web = is_web,
                         .reader.body_max = LW_FRAMING_BODY_MAX};
}

static void hang_up(struct peer *p) {
    close(p->socket);
    lw_message_reader_clear(&p->reader);
    free(p->lent);
}

static void put_bytes(struct peer *p, const uint8_t *bytes, size_t size) {
    if (p->is_web)
        assert_true(lw_web_peer_write(p->socket, true, WEB_PEER_BINARY, bytes, size, size));
    else
        assert_int_equal(send(p->socket, bytes, size, MSG_NOSIGNAL), (ssize_t)size);
}

static void put(struct peer *p, const struct lw_message *message) {
    uint8_t *bytes;
    size_t size;
    lw_support_ok(lw_message_encode_alloc(message, &bytes, &size), NULL);
    put_bytes(p, bytes, size);
    free(bytes);
}

/* Reads the next bytes of the stream; false: there is no more. */
static bool read_more(struct peer *p) {
    struct lw_web_peer_frame frame = {0};
    lw_support_ok(lw_message_reader_keep(&p->reader), NULL);
    free(p->lent);
    p->lent = NULL;
    if (p->is_web) {
        if (!lw_web_peer_read(p->socket, &frame)) return false;
        if (frame.opcode == WEB_PEER_CLOSE) {
            p->close_code = frame.size >= 2 ? (unsigned)(frame.bytes[0] << 8 | frame.bytes[1]) : 1005;
            if (frame.size > 2)
                snprintf(p->close_reason, sizeof p->close_reason, "%s", (const char *)frame.bytes + 2);
            free(frame.bytes);
            return false;
        }
        assert_int_equal(frame.opcode, WEB_PEER_BINARY);
    } else {
        struct pollfd wait = {.fd = p->socket, .events = POLLIN};
        frame.bytes = malloc(65536);
        assert_non_null(frame.bytes);
        assert_int_equal(poll(&wait, 1, LIMIT_S * 1000), 1);
        const ssize_t size = recv(p->socket, frame.bytes, 65536, 0);
        if (size <= 0) {
            free(frame.bytes);
            return false;
        }
        frame.size = (size_t)size;
    }
    p->lent = frame.bytes;
    lw_message_reader_lend(&p->reader, frame.bytes, frame.size);
    return true;
}

/* The next message; false: the session is over. */
static bool get(struct peer *p, struct lw_framing_header *header, const uint8_t **body) {
    for (;;) {
        lw_support_ok(lw_message_reader_take(&p->reader, header, body, NULL), NULL);
        if (*body) return true;
        if (!read_more(p)) return false;
    }
}

static void expect_refusal(struct peer *p, enum lw_refusal code) {
    struct lw_framing_header header;
    const uint8_t *body;
    struct lw_message m;
    do {
        assert_true(get(p, &header, &body));
    } while (header.type != LW_MESSAGE_REFUSAL);
    lw_support_ok(lw_message_decode(header, body, &m, NULL), NULL);
    assert_int_equal(m.refusal.code, code);
    if (p->is_web) { /* the reason is the beginning of the text */
        char text[LW_MESSAGE_TEXT_MAX + 1];
        snprintf(text, sizeof text, "%s", m.refusal.text);
        assert_false(read_more(p));
        assert_int_equal(p->close_code, 4000 + code);
        assert_true(*p->close_reason && strncmp(text, p->close_reason, strlen(p->close_reason)) == 0);
    }
    lw_message_finish(&m);
    hang_up(p);
}

/* The messages of a session up to SETTLED. The WELCOME is checked here, and left out. */
static size_t take_session(struct peer *p, uint8_t **out_bytes) {
    size_t size = 0, capacity = 0;
    uint8_t *all = NULL;
    for (uint16_t type = 0; type != LW_MESSAGE_SETTLED;) {
        struct lw_framing_header header;
        const uint8_t *body;
        assert_true(get(p, &header, &body));
        type = header.type;
        if (type == LW_MESSAGE_WELCOME) {
            struct lw_message m;
            lw_support_ok(lw_message_decode(header, body, &m, NULL), NULL);
            assert_int_equal(m.welcome.features & LW_FEATURE_CONTROL, 0);
            lw_message_finish(&m);
            continue;
        }
        if (type == LW_MESSAGE_WAITING) continue; /* a later client may not have to wait */
        if (size + header.body_size + 2 > capacity) {
            capacity = 2 * (size + header.body_size + 2);
            all = realloc(all, capacity);
            assert_non_null(all);
        }
        memcpy(all + size, &header.type, 2);
        memcpy(all + size + 2, body, header.body_size);
        size += 2 + header.body_size;
    }
    *out_bytes = all;
    return size;
}

static bool is_at_rest(void *context) {
    (void)context;
    return lw_process_newest(&web_case_daemon, "tiles_solved") == 0;
}

static void wait_for_rest(void) { assert_true(lw_process_await(&web_case_daemon, is_at_rest, NULL)); }

/* Chunks, frame and tiles are the same bytes in the same order, however the messages are cut. */
static void test_same_as_tcp(void **state) {
    (void)state;
    web_case_serve("");
    wait_for_rest();
    uint8_t *over_tcp, *over_web;
    struct peer tcp = dial(false);
    put(&tcp, &hello);
    put(&tcp, &request);
    const size_t tcp_size = take_session(&tcp, &over_tcp);
    assert_true(tcp_size > 3000);
    hang_up(&tcp);
    for (int pieces = 0; pieces < 3; pieces++) {
        uint8_t *hello_bytes, *request_bytes, both[200];
        size_t hello_size, request_size;
        lw_support_ok(lw_message_encode_alloc(&hello, &hello_bytes, &hello_size), NULL);
        lw_support_ok(lw_message_encode_alloc(&request, &request_bytes, &request_size), NULL);
        const size_t size = hello_size + request_size;
        assert_true(size < sizeof both);
        memcpy(both, hello_bytes, hello_size);
        memcpy(both + hello_size, request_bytes, request_size);
        free(hello_bytes);
        free(request_bytes);
        struct peer web = dial(true);
        if (pieces == 0) /* two messages in one, between an empty one and a ping */
            assert_true(lw_web_peer_write(web.socket, true, WEB_PEER_BINARY, "", 0, 0));
        if (pieces == 0) put_bytes(&web, both, size);
        for (size_t i = 0; i < size && pieces == 1; i++) put_bytes(&web, both + i, 1);
        for (size_t i = 0; i < size && pieces == 2; i++) /* frames of one message */
            assert_true(lw_web_peer_write(web.socket, i + 1 == size, i ? WEB_PEER_MORE : WEB_PEER_BINARY,
                                          both + i, 1, 1));
        const size_t web_size = take_session(&web, &over_web);
        assert_int_equal(web_size, tcp_size);
        assert_memory_equal(over_web, over_tcp, tcp_size);
        free(over_web);
        hang_up(&web);
    }
    free(over_tcp);
    web_case_stop();
}

static void test_a_web_session_changes_nothing(void **state) {
    (void)state;
    web_case_serve("");
    static const struct lw_scene_change hide = {.kind = LW_SCENE_CHANGE_OBJECT_HIDE, .target = 1};
    struct peer web = dial(true);
    put(&web, &hello);
    put(&web, &(struct lw_message){.type = LW_MESSAGE_UPDATE, .update = {1, &hide, 1}});
    expect_refusal(&web, LW_REFUSAL_NOT_ALLOWED);
    web_case_stop();
}

static void test_unless_it_has_a_token_for_control(void **state) {
    (void)state;
    static const uint8_t token[LW_TOKEN_SIZE] = {0x12, 0xab};
    char text[LW_TOKEN_TEXT_SIZE], line[100], option[300];
    lw_token_format(&(const struct lw_token){{0x12, 0xab}}, text);
    snprintf(line, sizeof line, "control %s\n", text);
    const char *path = lw_support_temporary("tokens");
    lw_support_write_file(path, line, strlen(line));
    assert_int_equal(chmod(path, 0600), 0);
    snprintf(option, sizeof option, "--tokens %s", path);
    web_case_serve(option);
    struct peer web = dial(true);
    put(&web, &hello);
    expect_refusal(&web, LW_REFUSAL_TOKEN);
    struct lw_message with_token = hello, m;
    with_token.hello.token = token;
    web = dial(true);
    put(&web, &with_token);
    struct lw_framing_header header;
    const uint8_t *body;
    assert_true(get(&web, &header, &body));
    lw_support_ok(lw_message_decode(header, body, &m, NULL), NULL);
    assert_int_equal(m.type, LW_MESSAGE_WELCOME);
    assert_true(m.welcome.features & LW_FEATURE_CONTROL);
    lw_message_finish(&m);
    static const struct lw_scene_change hide = {.kind = LW_SCENE_CHANGE_OBJECT_HIDE, .target = 1};
    put(&web, &(struct lw_message){.type = LW_MESSAGE_UPDATE, .update = {1, &hide, 1}});
    assert_true(get(&web, &header, &body));
    assert_int_equal(header.type, LW_MESSAGE_UPDATED);
    hang_up(&web);
    web_case_stop();
}

/* Ours is 4,000 and more, libwebsockets' less. */
static unsigned close_code_after(int s) {
    struct lw_web_peer_frame frame;
    unsigned code = 0;
    while (!code && lw_web_peer_read(s, &frame)) {
        if (frame.opcode == WEB_PEER_CLOSE)
            code = frame.size >= 2 ? (unsigned)(frame.bytes[0] << 8 | frame.bytes[1]) : 1005;
        free(frame.bytes);
    }
    close(s);
    return code;
}

static void test_misbehaviour(void **state) {
    (void)state;
    web_case_serve("");
    struct peer good = dial(true);
    put(&good, &hello);

    struct peer web = dial(true);
    put_bytes(&web, (const uint8_t *)"GET / HTTP/1.1\r\n\r\n", 18);
    expect_refusal(&web, LW_REFUSAL_PROTOCOL);
    int s = lw_web_peer_open(web_case_port); /* text */
    assert_true(lw_web_peer_write(s, true, WEB_PEER_TEXT, "hello", 5, 5));
    assert_int_equal(close_code_after(s), 1003);
    web = dial(true); /* a frame of 4 EiB: its first bytes are checked as they come */
    static uint8_t noise[20000];
    memset(noise, 0xff, sizeof noise);
    assert_true(lw_web_peer_write(web.socket, true, WEB_PEER_BINARY, noise, sizeof noise, 1ull << 62));
    expect_refusal(&web, LW_REFUSAL_PROTOCOL);
    s = lw_web_peer_open(web_case_port); /* a length that RFC 6455 has not */
    assert_true(lw_web_peer_write(s, true, WEB_PEER_BINARY, noise, 100, UINT64_MAX));
    assert_true(lw_web_peer_closes(s, LIMIT_S * 1000));
    close(s);
    s = lw_web_peer_open(web_case_port); /* a reserved kind of frame */
    assert_true(lw_web_peer_write(s, true, (enum web_peer_opcode)5, "x", 1, 1));
    assert_true(lw_web_peer_closes(s, LIMIT_S * 1000));
    close(s);
    s = lw_web_peer_open(web_case_port); /* a ping over the limit of 125 bytes */
    assert_true(lw_web_peer_write(s, true, WEB_PEER_PING, noise, 2000, 2000));
    assert_true(lw_web_peer_closes(s, LIMIT_S * 1000));
    close(s);
    s = lw_web_peer_open(web_case_port); /* going on with a message that did not begin */
    assert_true(lw_web_peer_write(s, true, WEB_PEER_MORE, "x", 1, 1));
    assert_true(lw_web_peer_closes(s, LIMIT_S * 1000));
    close(s);
    s = lw_web_peer_open(web_case_port); /* bytes that are no frames */
    assert_int_equal(send(s, noise, sizeof noise, MSG_NOSIGNAL), (ssize_t)sizeof noise);
    assert_true(lw_web_peer_closes(s, LIMIT_S * 1000));
    close(s);
    for (int i = 0; i < 50; i++) { /* resets in the middle of a message */
        web = dial(true);
        put(&web, &hello);
        put(&web, &request);
        const struct linger at_once = {1, 0};
        (void)setsockopt(web.socket, SOL_SOCKET, SO_LINGER, &at_once, sizeof at_once);
        hang_up(&web);
    }
    s = lw_web_peer_open(web_case_port); /* a polite end */
    assert_true(lw_web_peer_write(s, true, WEB_PEER_CLOSE, "\x03\xe8", 2, 2));
    assert_int_equal(close_code_after(s), 1000);

    uint8_t *bytes; /* the server goes on */
    put(&good, &request);
    assert_true(take_session(&good, &bytes) > 0);
    free(bytes);
    hang_up(&good);
    web_case_stop();
}

/* Frames with nothing in them, and pings: the session is read no more, and refused after a time. */
static void test_frames_without_end(void **state) {
    (void)state;
    web_case_serve("");
    static const struct {
        uint8_t first;
        size_t size;
        const char *why;
    } kinds[] = {{0x82, 0, "more than 100 FRAMES"},
                 {0x89, 0, "more than 4096 OVERHEAD"},
                 {0x8a, 3, "more than 100 FRAMES"},
                 {0x8a, 0, "more than 4096 OVERHEAD"}};
    enum { KINDS = sizeof kinds / sizeof *kinds };
    static uint8_t many[1u << 16];
    struct peer peer[KINDS];
    size_t taken[KINDS] = {0};
    bool refused[KINDS] = {0};
    unsigned left = KINDS;
    for (unsigned k = 0; k < KINDS; k++) {
        peer[k] = dial(true);
        put(&peer[k], &hello);
        put(&peer[k], &request);
    }
    for (const uint64_t end_ns = lw_clock_ns() + LIMIT_S * 1000000000ull; left;) {
        assert_true(lw_clock_ns() < end_ns);
        for (unsigned k = 0; k < KINDS; k++) {
            if (refused[k]) continue;
            const size_t one = 6 + kinds[k].size, all = sizeof many / one * one;
            for (size_t i = 0; i < all; i++)
                many[i] = i % one == 0 ? kinds[k].first : i % one == 1 ? (uint8_t)(0x80 | kinds[k].size) : 0;
            const size_t from = taken[k] % one;
            const ssize_t n = send(peer[k].socket, many + from, all - from, MSG_NOSIGNAL | MSG_DONTWAIT);
            if (n > 0) taken[k] += (size_t)n;
            char *log = lw_process_err(&web_case_daemon);
            refused[k] = strstr(log, kinds[k].why);
            free(log);
            left -= refused[k];
        }
        lw_process_sleep_ms(50);
    }
    for (unsigned k = 0; k < KINDS; k++) hang_up(&peer[k]);
    web_case_stop();
}

static unsigned lines_with(const char *text, const char *what) {
    unsigned count = 0;
    for (const char *at = text; (at = strstr(at, what)); at++) count++;
    return count;
}

/* A peer can neither fill the log nor write lines of its own into it. */
static void test_log(void **state) {
    (void)state;
    web_case_serve("");
    struct lw_message liar = hello;
    liar.hello.name = "x\") left: bye; session 7: \\";
    struct peer p = dial(true);
    put(&p, &liar);
    struct lw_framing_header header;
    const uint8_t *body;
    assert_true(get(&p, &header, &body));
    hang_up(&p);
    for (int i = 0; i < 500; i++) {
        p = dial(false);
        put_bytes(&p, (const uint8_t *)"nonsense", 8);
        expect_refusal(&p, LW_REFUSAL_PROTOCOL);
    }
    web_case_stop();
    char *said = lw_process_err(&web_case_daemon);
    if (!strstr(said, "\"x\\\") left: bye; session 7: \\\\\" joined")) fail_msg("%s", said);
    assert_in_range(lines_with(said, " refused: "), 20, 60 + 2 * LIMIT_S);
    free(said);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(test_who_may_open, lw_process_teardown),
        cmocka_unit_test_teardown(test_same_as_tcp, lw_process_teardown),
        cmocka_unit_test_teardown(test_a_web_session_changes_nothing, lw_process_teardown),
        cmocka_unit_test_teardown(test_unless_it_has_a_token_for_control, lw_process_teardown),
        cmocka_unit_test_teardown(test_misbehaviour, lw_process_teardown),
        cmocka_unit_test_teardown(test_frames_without_end, lw_process_teardown),
        cmocka_unit_test_teardown(test_log, lw_process_teardown),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
