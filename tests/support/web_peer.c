#include "tests/support/web_peer.h"

#include "common/base/clock.h"
#include "tests/support/process.h"

#include <arpa/inet.h>
#include <errno.h>
#include <netinet/in.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/socket.h>
#include <unistd.h>

#define ASK_MS      50 /* whether to give up */
#define ANSWER_SIZE (4u << 20)

int lw_web_peer_dial(uint16_t port) { return lw_web_peer_dial_from("127.0.0.1", port); }

int lw_web_peer_dial_from(const char *own, uint16_t port) {
    const int s = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    struct sockaddr_in from = {.sin_family = AF_INET};
    assert_true(s >= 0);
    assert_int_equal(inet_pton(AF_INET, own, &from.sin_addr), 1);
    assert_int_equal(bind(s, (struct sockaddr *)&from, sizeof from), 0);
    struct sockaddr_in address = {
        .sin_family = AF_INET, .sin_port = htons(port), .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    assert_int_equal(connect(s, (struct sockaddr *)&address, sizeof address), 0);
    return s;
}

static bool put_bytes(int socket, const void *bytes, size_t size) {
    for (size_t sent = 0; sent < size;) {
        const ssize_t n = send(socket, (const char *)bytes + sent, size - sent, MSG_NOSIGNAL);
        if (n < 0 && errno == EINTR) continue;
        if (n <= 0) return false;
        sent += (size_t)n;
    }
    return true;
}

bool lw_web_peer_put(int socket, const char *text) { return put_bytes(socket, text, strlen(text)); }

static bool (*gives_up)(void *context);
static void *giver_up;

void lw_web_peer_give_up(bool (*is_time)(void *context), void *context) {
    gives_up = is_time;
    giver_up = context;
}

/* Returns 0 at the end of the stream. */
static size_t get_some(int socket, void *bytes, size_t size) {
    struct pollfd wait = {.fd = socket, .events = POLLIN};
    const uint64_t end_ns = lw_clock_ns() + LW_PROCESS_LIMIT_S * 1000000000ull;
    while (poll(&wait, 1, ASK_MS) != 1) {
        if (gives_up && gives_up(giver_up)) return 0;
        if (lw_clock_ns() > end_ns) fail_msg("nothing heard within %u s", LW_PROCESS_LIMIT_S);
    }
    const ssize_t n = recv(socket, bytes, size, 0);
    if (n < 0 && errno != ECONNRESET) fail_msg("recv: %s", strerror(errno));
    return n < 0 ? 0 : (size_t)n;
}

static bool get_bytes(int socket, void *bytes, size_t size) {
    for (size_t got = 0; got < size;) {
        const size_t n = get_some(socket, (char *)bytes + got, size - got);
        if (!n) return false;
        got += n;
    }
    return true;
}

/* Bytes of the whole answer, as far as it has been read; 0: its headers are not whole. */
static size_t whole_size(const char *answer, bool head) {
    const char *end = strstr(answer, "\r\n\r\n"), *length = strcasestr(answer, "\r\ncontent-length:");
    if (!end) return 0;
    const size_t headers = (size_t)(end - answer) + 4;
    return headers + (!head && length && length < end ? strtoul(length + 17, NULL, 10) : 0);
}

char *lw_web_peer_ask(int socket, const char *request, bool head, size_t *out_size) {
    char *answer = calloc(1, ANSWER_SIZE);
    assert_non_null(answer);
    (void)lw_web_peer_put(socket, request);
    size_t got = 0, whole = 0;
    while (!whole || got < whole) {
        const size_t n = get_some(socket, answer + got, ANSWER_SIZE - 1 - got);
        if (!n) break;
        got += n;
        whole = whole_size(answer, head);
    }
    if (out_size) *out_size = got;
    return answer;
}

unsigned lw_web_peer_upgrade(int socket, const char *path, const char *lines) {
    char request[2048], answer[4096] = "";
    snprintf(request, sizeof request,
             "GET %s HTTP/1.1\r\nConnection: keep-alive, Upgrade\r\nUpgrade: websocket\r\n"
             "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n%s\r\n",
             path, lines);
    (void)lw_web_peer_put(socket, request);
    for (size_t got = 0; got < sizeof answer - 1 && !strstr(answer, "\r\n\r\n"); got++)
        if (!get_some(socket, answer + got, 1)) break;
    unsigned status = 0;
    (void)sscanf(answer, "HTTP/1.%*u %u", &status);
    if (status == 101) { /* the answer to that key, RFC 6455, 1.3 */
        assert_non_null(strstr(answer, "s3pPLMBiTxaQ9kYGzzhZRbK+xOo="));
        assert_null(strcasestr(answer, "sec-websocket-extensions"));
    }
    return status;
}

int lw_web_peer_open(uint16_t port) {
    const int s = lw_web_peer_dial(port);
    char lines[128];
    snprintf(lines, sizeof lines, "Host: 127.0.0.1:%u\r\nSec-WebSocket-Protocol: lightwell\r\n",
             (unsigned)port);
    assert_int_equal(lw_web_peer_upgrade(s, "/ws", lines), 101);
    return s;
}

bool lw_web_peer_write(int socket, bool fin, enum web_peer_opcode opcode, const void *bytes, size_t size,
                       uint64_t size_said) {
    uint8_t header[14] = {(uint8_t)(fin << 7 | (unsigned)opcode)};
    const unsigned length_bytes = size_said < 126 ? 0 : size_said <= UINT16_MAX ? 2 : 8;
    header[1] = (uint8_t)(0x80 | (length_bytes == 0 ? (unsigned)size_said : length_bytes == 2 ? 126 : 127));
    for (unsigned i = 0; i < length_bytes; i++)
        header[2 + i] = (uint8_t)(size_said >> (8 * (length_bytes - 1 - i)));
    return put_bytes(socket, header, 2 + length_bytes + 4) && put_bytes(socket, bytes, size);
}

bool lw_web_peer_read(int socket, struct lw_web_peer_frame *out_frame) {
    uint8_t header[2], length[8];
    if (!get_bytes(socket, header, 2)) return false;
    assert_int_equal(header[1] & 0x80, 0); /* a server masks nothing */
    assert_int_equal(header[0] & 0x70, 0); /* no extension */
    uint64_t size = header[1];
    const unsigned length_bytes = size < 126 ? 0 : size == 126 ? 2 : 8;
    if (!get_bytes(socket, length, length_bytes)) return false;
    if (length_bytes) size = 0;
    for (unsigned i = 0; i < length_bytes; i++) size = size << 8 | length[i];
    assert_true(size <= 65536);
    *out_frame = (struct lw_web_peer_frame){.opcode = (enum web_peer_opcode)(header[0] & 15),
                                            .fin = header[0] & 0x80,
                                            .bytes = malloc(size + 1),
                                            .size = size};
    assert_non_null(out_frame->bytes);
    if (!get_bytes(socket, out_frame->bytes, size)) {
        free(out_frame->bytes);
        return false;
    }
    out_frame->bytes[size] = 0;
    return true;
}

bool lw_web_peer_closes(int socket, unsigned limit_ms) {
    const uint64_t end_ns = lw_clock_ns() + limit_ms * 1000000ull;
    for (;;) {
        const uint64_t now_ns = lw_clock_ns();
        struct pollfd wait = {.fd = socket, .events = POLLIN};
        char dropped[4096];
        if (now_ns >= end_ns || poll(&wait, 1, (int)((end_ns - now_ns) / 1000000) + 1) != 1) return false;
        if (recv(socket, dropped, sizeof dropped, 0) <= 0) return true;
    }
}
