/* The real lightwelld over HTTP and WebSocket: its files, access, a session as
 * over TCP, peers that misbehave. */
#include "tests/support/process.h"
#include "tests/support/web_peer.h"

#include "common/base/clock.h"
#include "proto/message.h"
#include "proto/message_reader.h"

#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#define LIMIT_S LW_PROCESS_LIMIT_S
#define RESTS                                                                                                \
    "builtin:cornell --texels-per-metre 8 --clock step --json --light whole --error 0.3 --http 127.0.0.1:0 "
#define SLOW_LIMIT_S     30u /* for what takes REQUEST_S, or a HELLO's time */
#define REQUEST_S        10u /* LW_WEB_SERVER_REQUEST_S */
#define ANSWER_S         20u /* LW_WEB_SERVER_ANSWER_S */
#define HEADER_MAX       8192u
#define HOST_MAX         299u /* LW_HTTP_ORIGIN_MAX - 1 */
#define LARGE_SIZE       (32u << 20)
#define REQUESTS_AT_ONCE 40u  /* LW_WEB_SERVER_REQUESTS_BURST */
#define CONNECTIONS      922u /* the own machine's: LW_WEB_SERVER_CONNECTIONS_MAX but for a tenth */
#define IN_ALL           1024u
#define WASM_SIZE        300000u
#define MESSAGES_MAX     4096u

static struct lw_process daemon_process;
static uint16_t web_port;

static void serve(const char *arguments) {
    char line[2048], text[16] = "";
    const char *port_file = lw_support_temporary("http-port");
    snprintf(line, sizeof line, RESTS "--http-port-file %s %s", port_file, arguments);
    lw_process_serve(&daemon_process, line);
    FILE *file = fopen(port_file, "re"); /* written before the one that lw_process_serve() waits for */
    assert_non_null(file);
    assert_non_null(fgets(text, sizeof text, file));
    fclose(file);
    web_port = (uint16_t)atoi(text);
    assert_true(web_port > 0);
}

static void stop(void) {
    const int code = lw_process_stop(&daemon_process, SIGTERM, LIMIT_S);
    if (code != 0) fail_msg("ended with %d: %s", code, lw_process_err(&daemon_process));
}

static int end_all(void **state) {
    (void)state;
    lw_process_kill_all();
    return 0;
}

/* A folder with an index, a page in a folder, and files that must not be served. */
static const char *make_root(void) {
    static char root[512];
    static uint8_t wasm[WASM_SIZE];
    char path[600];
    snprintf(root, sizeof root, "%s", lw_support_temporary("web"));
    mkdir(root, 0700);
    for (uint32_t i = 0; i < sizeof wasm; i++) wasm[i] = (uint8_t)(i * 2654435761u >> 24);
    snprintf(path, sizeof path, "%s/js", root);
    mkdir(path, 0700);
    snprintf(path, sizeof path, "%s/index.html", root);
    lw_support_write_file(path, "<p>index</p>", 12);
    snprintf(path, sizeof path, "%s/js/tiles.wasm", root);
    lw_support_write_file(path, wasm, sizeof wasm);
    snprintf(path, sizeof path, "%s/js/index.html", root);
    lw_support_write_file(path, "<p>inner</p>", 12);
    snprintf(path, sizeof path, "%s/js/main.js", root);
    lw_support_write_file(path, "let identity;", 13);
    snprintf(path, sizeof path, "%s/js/main.js.br", root);
    lw_support_write_file(path, "brotli", 6);
    snprintf(path, sizeof path, "%s/js/main.js.gz", root);
    lw_support_write_file(path, "gzip", 4);
    snprintf(path, sizeof path, "%s/.hidden", root);
    lw_support_write_file(path, "secret", 6);
    snprintf(path, sizeof path, "%s/link", root);
    (void)unlink(path);
    assert_int_equal(symlink("/etc/passwd", path), 0);
    snprintf(path, sizeof path, "%s/../outside", root);
    lw_support_write_file(path, "secret", 6);
    return root;
}

static void serve_root(const char *arguments) {
    char line[2048];
    snprintf(line, sizeof line, "--web-root %s %s", make_root(), arguments);
    serve(line);
}

/* ---- HTTP ---- */

/* The status of the answer to a request with a Host that is right. *out_answer may
 * be NULL; the caller frees it. */
static unsigned ask(const char *method, const char *path, const char *lines, char **out_answer,
                    size_t *out_size) {
    char request[4096];
    unsigned status = 0;
    snprintf(request, sizeof request, "%s %s HTTP/1.1\r\nHost: 127.0.0.1:%u\r\n%s\r\n", method, path,
             (unsigned)web_port, lines);
    const int s = lw_web_peer_dial(web_port);
    char *answer = lw_web_peer_ask(s, request, strcmp(method, "HEAD") == 0, out_size);
    close(s);
    (void)sscanf(answer, "HTTP/1.%*u %u", &status);
    if (out_answer)
        *out_answer = answer;
    else
        free(answer);
    return status;
}

static const char *body_of(const char *answer) {
    const char *end = strstr(answer, "\r\n\r\n");
    assert_non_null(end);
    return end + 4;
}

static void expect_header(const char *answer, const char *line) {
    if (!strcasestr(answer, line)) fail_msg("no \"%s\" in: %s", line, answer);
}

static void test_files(void **state) {
    (void)state;
    serve_root("");
    char *answer, tag[200];
    size_t size, size_of_file;
    assert_int_equal(ask("GET", "/", "", &answer, NULL), 200);
    assert_string_equal(body_of(answer), "<p>index</p>");
    expect_header(answer, "\r\ncontent-type: text/html");
    expect_header(answer, "\r\nx-content-type-options: nosniff\r\n");
    expect_header(answer, "\r\ncontent-security-policy: default-src 'none'; script-src 'self'");
    expect_header(answer, "\r\ncache-control: no-cache\r\n");
    const char *etag = strcasestr(answer, "\r\netag: ");
    assert_non_null(etag);
    snprintf(tag, sizeof tag, "If-None-Match: %.34s\r\n", etag + 8);
    free(answer);
    assert_int_equal(ask("GET", "/", tag, &answer, NULL), 304);
    assert_string_equal(body_of(answer), "");
    free(answer);
    assert_int_equal(ask("GET", "/js/tiles.wasm", tag, &answer, &size), 200); /* another file's tag */
    expect_header(answer, "\r\ncontent-type: application/wasm\r\n");
    uint8_t *wasm = lw_support_read_file(lw_support_temporary("web/js/tiles.wasm"), &size_of_file);
    assert_int_equal(size, (size_t)(body_of(answer) - answer) + WASM_SIZE);
    assert_memory_equal(body_of(answer), wasm, WASM_SIZE);
    free(wasm);
    free(answer);
    assert_int_equal(ask("HEAD", "/js/tiles.wasm", "", &answer, NULL), 200);
    expect_header(answer, "\r\ncontent-length: 300000\r\n");
    assert_string_equal(body_of(answer), "");
    free(answer);
    assert_int_equal(ask("GET", "/js/", "", &answer, NULL), 200);
    assert_string_equal(body_of(answer), "<p>inner</p>");
    free(answer);
    stop();
}

/* A file comes in the coding that the client wants, if it is there; each coding is a representation of its
 * own. */
static void test_codings(void **state) {
    (void)state;
    static const struct {
        const char *path, *accept, *coding, *body;
    } wanted[] = {{"/js/main.js", "Accept-Encoding: gzip, deflate, br\r\n", "br", "brotli"},
                  {"/js/main.js", "Accept-Encoding: br;q=0.1, gzip\r\n", "gzip", "gzip"},
                  {"/js/main.js", "Accept-Encoding: deflate\r\nAccept-Encoding: gzip\r\n", "gzip", "gzip"},
                  {"/js/main.js", "Accept-Encoding: zstd\r\n", NULL, "let identity;"},
                  {"/js/main.js", "Accept-Encoding: br;q=7\r\n", NULL, "let identity;"},
                  {"/js/main.js", "", NULL, "let identity;"},
                  {"/js/", "Accept-Encoding: gzip, br\r\n", NULL, "<p>inner</p>"}};
    char tags[3][60], line[100], *answer;
    unsigned tag_count = 0;
    serve_root("");
    for (size_t i = 0; i < sizeof wanted / sizeof *wanted; i++) {
        assert_int_equal(ask("GET", wanted[i].path, wanted[i].accept, &answer, NULL), 200);
        assert_string_equal(body_of(answer), wanted[i].body);
        snprintf(line, sizeof line, "\r\ncontent-encoding: %s\r\n", wanted[i].coding ? wanted[i].coding : "");
        if (wanted[i].coding)
            expect_header(answer, line);
        else
            assert_null(strcasestr(answer, "content-encoding"));
        if (strcmp(wanted[i].path, "/js/main.js") == 0) {
            expect_header(answer, "\r\nvary: accept-encoding\r\n");
            expect_header(answer, "\r\ncontent-type: text/javascript");
        } else
            assert_null(strcasestr(answer, "vary:"));
        if (i == 0 || i == 1 || i == 3)
            snprintf(tags[tag_count++], sizeof tags[0], "If-None-Match: W/%.34s\r\n",
                     strcasestr(answer, "\r\netag: ") + 8);
        free(answer);
    }
    for (unsigned i = 0; i < tag_count; i++) { /* the first one is br's */
        snprintf(line, sizeof line, "Accept-Encoding: br\r\n%s", tags[i]);
        assert_int_equal(ask("GET", "/js/main.js", line, NULL, NULL), i == 0 ? 304 : 200);
    }
    assert_int_equal(ask("HEAD", "/js/main.js", "Accept-Encoding: gzip\r\n", &answer, NULL), 200);
    expect_header(answer, "\r\ncontent-length: 4\r\n");
    free(answer);
    assert_int_equal(ask("GET", "/js/main.js", "Accept-Encoding: *;q=0\r\n", NULL, NULL), 406);
    assert_int_equal(ask("GET", "/js/", "Accept-Encoding: br, identity;q=0\r\n", NULL, NULL), 406);
    stop();
}

/* An IPv6 address is no source of a policy: browsers leave such a one out, and warn. */
static void test_policy(void **state) {
    (void)state;
    static const struct {
        const char *host, *line;
    } hosts[] = {{"localhost:7781",
                  "; connect-src 'self' ws://localhost:7781 wss://localhost:7781 ws://b:2/ws "
                  "wss://c.example/light/ws; base-uri"},
                 {"[::1]:7781", "; connect-src 'self' ws://b:2/ws wss://c.example/light/ws; base-uri"}};
    char request[200];
    serve_root("--servers a:1,ws://b:2/ws,[::1]:3,wss://c.example/light/ws");
    for (size_t i = 0; i < sizeof hosts / sizeof *hosts; i++) {
        snprintf(request, sizeof request, "GET / HTTP/1.1\r\nHost: %s\r\n\r\n", hosts[i].host);
        const int s = lw_web_peer_dial(web_port);
        char *answer = lw_web_peer_ask(s, request, false, NULL);
        expect_header(answer, hosts[i].line);
        free(answer);
        close(s);
    }
    stop();
}

/* The longest list of servers has room in the headers of a page. */
static void test_policy_of_many_servers(void **state) {
    (void)state;
    char servers[1025] = "", options[1100], *answer;
    size_t size = 0;
    for (int i = 0; size + 40 < sizeof servers; i++)
        size += (size_t)snprintf(servers + size, sizeof servers - size, "%sws://relay%d.example.org:7781/ws",
                                 i ? "," : "", i);
    snprintf(options, sizeof options, "--servers %s", servers);
    serve_root(options);
    assert_int_equal(ask("GET", "/", "", &answer, NULL), 200);
    for (char *at = servers; (at = strchr(at, ',')); at++) *at = ' ';
    expect_header(answer, servers);
    expect_header(answer, "; frame-ancestors 'none'\r\n");
    free(answer);
    stop();
}

static void test_what_is_no_file(void **state) {
    (void)state;
    serve_root("");
    static const char *const paths[] = {"/nothing",
                                        "/js",
                                        "/index.html/",
                                        "/.hidden",
                                        "/link",
                                        "/../outside",
                                        "/js/../../outside",
                                        "/%2e%2e/outside",
                                        "/..%2foutside",
                                        "/js/%2e%2e/%2e%2e/outside",
                                        "//etc/passwd",
                                        "/%00/index.html",
                                        "/index.html%00",
                                        "/./.hidden",
                                        "/js/..%5c..%5coutside"};
    for (size_t i = 0; i < sizeof paths / sizeof *paths; i++) {
        char *answer;
        const unsigned status = ask("GET", paths[i], "", &answer, NULL);
        if (status < 400 && status != 0 && strcmp(body_of(answer), "<p>index</p>") != 0)
            fail_msg("%s: %s", paths[i], answer);
        if (strstr(answer, "secret") || strstr(answer, "root:")) fail_msg("%s: %s", paths[i], answer);
        free(answer);
    }
    assert_int_equal(ask("GET", "/nothing", "", NULL, NULL), 404);
    assert_int_equal(ask("GET", "/ws", "", NULL, NULL), 426);
    static const char *const methods[] = {"POST", "PUT", "DELETE", "OPTIONS", "PATCH"};
    for (size_t i = 0; i < sizeof methods / sizeof *methods; i++)
        assert_int_equal(ask(methods[i], "/", "", NULL, NULL), 405);
    assert_int_equal(ask("GET", "/", "Content-Length: 5\r\n\r\nhello", NULL, NULL), 400);
    assert_int_equal(ask("GET", "/", "Transfer-Encoding: chunked\r\n\r\n0\r\n\r\n", NULL, NULL), 400);
    assert_int_equal(ask("GET", "/", "", NULL, NULL), 200);
    stop();
}

/* The status for headers of this size, with what every request has; 0: closed without an answer. */
static unsigned ask_with_headers_of(size_t size) {
    char request[3 * HEADER_MAX];
    unsigned status = 0;
    int length = snprintf(request, sizeof request, "GET / HTTP/1.1\r\nHost: localhost\r\nUser-Agent: ");
    memset(request + length, 'a', size - (size_t)length - 4);
    memcpy(request + size - 4, "\r\n\r\n", 5);
    const int s = lw_web_peer_dial(web_port);
    char *answer = lw_web_peer_ask(s, request, false, NULL);
    (void)sscanf(answer, "HTTP/1.%*u %u", &status);
    free(answer);
    close(s);
    return status;
}

/* libwebsockets counts what it keeps of the headers, some bytes less than what came. */
static void test_headers_have_a_limit(void **state) {
    (void)state;
    serve_root("");
    assert_int_equal(ask_with_headers_of(HEADER_MAX), 200);
    assert_int_equal(ask_with_headers_of(HEADER_MAX + 100), 0);
    assert_int_equal(ask_with_headers_of(2 * HEADER_MAX), 0);
    assert_int_equal(ask_with_headers_of(HEADER_MAX), 200);
    stop();
}

/* Who takes nothing of an answer gets no more of it after a time; who takes it slowly gets all. */
static void test_answers_are_taken(void **state) {
    (void)state;
    char path[600];
    enum { SILENT, SLOW, COUNT };
    snprintf(path, sizeof path, "%s/large", make_root());
    lw_support_write_file(path, "", 0);
    assert_int_equal(truncate(path, LARGE_SIZE), 0);
    serve_root("");
    int s[COUNT];
    size_t got[COUNT] = {0};
    static char bytes[1u << 16];
    for (int i = 0; i < COUNT; i++) {
        const int small = 65536;
        s[i] = lw_web_peer_dial(web_port);
        (void)setsockopt(s[i], SOL_SOCKET, SO_RCVBUF, &small, sizeof small);
        assert_true(lw_web_peer_put(s[i], "GET /large HTTP/1.1\r\nHost: localhost\r\n\r\n"));
    }
    for (unsigned i = 0; i < 2 * ANSWER_S; i++) { /* as long again as it may take nothing */
        lw_process_sleep_ms(1000);
        for (unsigned piece = 0; piece < 8; piece++) {
            const ssize_t n = recv(s[SLOW], bytes, sizeof bytes, 0);
            if (n > 0) got[SLOW] += (size_t)n;
        }
    }
    for (int i = 0; i < COUNT; i++) {
        for (ssize_t n; (n = recv(s[i], bytes, sizeof bytes, 0)) > 0 && got[i] < LARGE_SIZE;)
            got[i] += (size_t)n;
        close(s[i]);
    }
    assert_true(got[SILENT] < LARGE_SIZE);
    assert_true(got[SLOW] >= LARGE_SIZE);
    stop();
}

static unsigned ask_host(const char *host) {
    char request[1024];
    unsigned status = 0;
    snprintf(request, sizeof request, "GET / HTTP/1.1\r\n%s%s%s\r\n", host ? "Host: " : "", host ? host : "",
             host ? "\r\n" : "");
    const int s = lw_web_peer_dial(web_port);
    char *answer = lw_web_peer_ask(s, request, false, NULL);
    (void)sscanf(answer, "HTTP/1.%*u %u", &status);
    free(answer);
    close(s);
    return status;
}

static void test_hosts(void **state) {
    (void)state;
    char longest[HOST_MAX + 2], names[HOST_MAX + 100];
    memset(longest, 'a', sizeof longest);
    longest[HOST_MAX] = '\0';
    snprintf(names, sizeof names, "--http-host light.example,Other.Example,%s", longest);
    serve_root(names);
    assert_int_equal(ask_host(longest), 200);
    longest[HOST_MAX] = 'a';
    longest[HOST_MAX + 1] = '\0';
    assert_int_equal(ask_host(longest), 403);
    assert_int_equal(ask_host("localhost"), 200);
    assert_int_equal(ask_host("localhost:99"), 200); /* a port that is forwarded */
    assert_int_equal(ask_host("127.0.0.1"), 200);
    assert_int_equal(ask_host("[::1]:7781"), 200);
    assert_int_equal(ask_host("LIGHT.example:80"), 200);
    assert_int_equal(ask_host("other.example"), 200);
    assert_int_equal(ask_host("evil.example"), 403);
    assert_int_equal(ask_host("light.example.evil.example"), 403);
    assert_int_equal(ask_host("localhost.evil.example"), 403);
    assert_int_equal(ask_host("10.0.0.1"), 403);
    assert_int_equal(ask_host("localhost:99 evil"), 403);
    assert_int_equal(ask_host(NULL), 403);
    stop();
}

/* The program has no client beside it here: a page says so. */
static void test_no_client(void **state) {
    (void)state;
    char *answer, line[600];
    const char *empty = lw_support_temporary("empty");
    assert_int_equal(mkdir(empty, 0700), 0);
    snprintf(line, sizeof line, "--web-root %s", empty);
    serve(line);
    assert_int_equal(ask("GET", "/", "", &answer, NULL), 200);
    assert_non_null(strstr(body_of(answer), "--web-root"));
    free(answer);
    assert_int_equal(ask("GET", "/index.html", "", NULL, NULL), 404);
    stop();
    struct lw_process other; /* one that was named must be there */
    snprintf(line, sizeof line, "builtin:cornell --listen 127.0.0.1:0 --http 127.0.0.1:0 --web-root %s/none",
             empty);
    lw_process_start(&other, "lightwelld", line);
    assert_int_equal(lw_process_finish(&other, LIMIT_S), 66);
    char *said = lw_process_err(&other);
    assert_non_null(strstr(said, "--web-root: "));
    free(said);
}

static void test_port_in_use(void **state) {
    (void)state;
    serve("");
    struct lw_process other;
    char line[256];
    snprintf(line, sizeof line, "builtin:cornell --listen 127.0.0.1:0 --http 127.0.0.1:%u",
             (unsigned)web_port);
    lw_process_start(&other, "lightwelld", line);
    assert_int_equal(lw_process_finish(&other, LIMIT_S), 69);
    char *said = lw_process_err(&other);
    assert_non_null(strstr(said, "choose another with --http HOST:PORT"));
    free(said);
    stop();
}

/* ---- WebSocket ---- */

static unsigned upgrade(const char *path, const char *lines) {
    char all[1024];
    const int s = lw_web_peer_dial(web_port);
    snprintf(all, sizeof all, "Host: 127.0.0.1:%u\r\n%s", (unsigned)web_port, lines);
    const unsigned status = lw_web_peer_upgrade(s, path, all);
    close(s);
    return status;
}

#define PROTOCOL "Sec-WebSocket-Protocol: lightwell\r\n"

static void test_who_may_open(void **state) {
    (void)state;
    serve("--http-origin https://a.example,http://b.example:81");
    char own[128], other_port[128];
    snprintf(own, sizeof own, PROTOCOL "Origin: http://127.0.0.1:%u\r\n", (unsigned)web_port);
    snprintf(other_port, sizeof other_port, PROTOCOL "Origin: http://127.0.0.1:%u\r\n",
             (unsigned)web_port ^ 1u);
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
    const int s = lw_web_peer_dial(web_port);
    assert_int_equal(lw_web_peer_upgrade(s, "/ws", "Host: evil.example\r\n" PROTOCOL), 403);
    close(s);
    /* what a page may ask in place of the answer that its browser hides */
    char *why;
    assert_int_equal(ask("GET", "/ws", "Origin: http://evil.example\r\n", &why, NULL), 403);
    expect_header(why, "\r\naccess-control-allow-origin: *\r\n");
    expect_header(why, "--http-origin");
    free(why);
    assert_int_equal(ask("GET", "/ws", "Origin: https://a.example\r\n", &why, NULL), 426);
    expect_header(why, "\r\naccess-control-allow-origin: *\r\n");
    free(why);
    assert_int_equal(ask("GET", "/", "Origin: https://a.example\r\n", &why, NULL), 200);
    assert_null(strcasestr(why, "access-control"));
    free(why);
    const int h2 = lw_web_peer_dial(web_port);
    char *answer =
        lw_web_peer_ask(h2,
                        "GET /ws HTTP/1.1\r\nHost: localhost\r\nConnection: Upgrade, HTTP2-Settings\r\n"
                        "Upgrade: h2c\r\nHTTP2-Settings: AAMAAABkAAQAAP__\r\n\r\n",
                        false, NULL);
    assert_non_null(strstr(answer, " 404 "));
    free(answer);
    close(h2);
    stop();
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
    return (struct peer){.socket =
                             is_web ? lw_web_peer_open(web_port) : lw_web_peer_dial(daemon_process.port),
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

static const struct lw_message hello = {
    .type = LW_MESSAGE_HELLO,
    .hello = {.version = LW_WIRE_VERSION, .features = LW_FEATURES_READ | LW_FEATURE_CONTROL, .name = "web"}};
static const struct lw_message request = {.type = LW_MESSAGE_PACKAGE_REQUEST};

/* The messages of a session up to SETTLED, without the WELCOME, which is looked at. */
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
    return lw_process_newest(&daemon_process, "tiles_solved") == 0;
}

static void wait_for_rest(void) { assert_true(lw_process_await(&daemon_process, is_at_rest, NULL)); }

/* Chunks, frame and tiles are the same bytes in the same order, however the messages are cut. */
static void test_same_as_tcp(void **state) {
    (void)state;
    serve("");
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
    stop();
}

static void test_a_web_session_changes_nothing(void **state) {
    (void)state;
    serve("");
    static const struct lw_scene_change hide = {.kind = LW_SCENE_CHANGE_OBJECT_HIDE, .target = 1};
    struct peer web = dial(true);
    put(&web, &hello);
    put(&web, &(struct lw_message){.type = LW_MESSAGE_UPDATE, .update = {1, &hide, 1}});
    expect_refusal(&web, LW_REFUSAL_NOT_ALLOWED);
    stop();
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
    serve(option);
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
    stop();
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
    serve("");
    struct peer good = dial(true);
    put(&good, &hello);

    struct peer web = dial(true);
    put_bytes(&web, (const uint8_t *)"GET / HTTP/1.1\r\n\r\n", 18);
    expect_refusal(&web, LW_REFUSAL_PROTOCOL);
    int s = lw_web_peer_open(web_port); /* text */
    assert_true(lw_web_peer_write(s, true, WEB_PEER_TEXT, "hello", 5, 5));
    assert_int_equal(close_code_after(s), 1003);
    web = dial(true); /* a frame of 4 EiB: its beginning is looked at as it comes */
    static uint8_t noise[20000];
    memset(noise, 0xff, sizeof noise);
    assert_true(lw_web_peer_write(web.socket, true, WEB_PEER_BINARY, noise, sizeof noise, 1ull << 62));
    expect_refusal(&web, LW_REFUSAL_PROTOCOL);
    s = lw_web_peer_open(web_port); /* a length that RFC 6455 has not */
    assert_true(lw_web_peer_write(s, true, WEB_PEER_BINARY, noise, 100, UINT64_MAX));
    assert_true(lw_web_peer_closes(s, LIMIT_S * 1000));
    close(s);
    s = lw_web_peer_open(web_port); /* a reserved kind of frame */
    assert_true(lw_web_peer_write(s, true, (enum web_peer_opcode)5, "x", 1, 1));
    assert_true(lw_web_peer_closes(s, LIMIT_S * 1000));
    close(s);
    s = lw_web_peer_open(web_port); /* a ping over the limit of 125 bytes */
    assert_true(lw_web_peer_write(s, true, WEB_PEER_PING, noise, 2000, 2000));
    assert_true(lw_web_peer_closes(s, LIMIT_S * 1000));
    close(s);
    s = lw_web_peer_open(web_port); /* going on with a message that did not begin */
    assert_true(lw_web_peer_write(s, true, WEB_PEER_MORE, "x", 1, 1));
    assert_true(lw_web_peer_closes(s, LIMIT_S * 1000));
    close(s);
    s = lw_web_peer_open(web_port); /* bytes that are no frames */
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
    s = lw_web_peer_open(web_port); /* a polite end */
    assert_true(lw_web_peer_write(s, true, WEB_PEER_CLOSE, "\x03\xe8", 2, 2));
    assert_int_equal(close_code_after(s), 1000);

    uint8_t *bytes; /* the server goes on */
    put(&good, &request);
    assert_true(take_session(&good, &bytes) > 0);
    free(bytes);
    hang_up(&good);
    stop();
}

/* Requests that never come to their end, WebSockets that never say HELLO; all at
 * once, as each takes its time. */
static void test_slow_peers(void **state) {
    (void)state;
    serve("");
    enum { SILENT, HALF, DRIP, KEPT, HELLO_LESS, COUNT };
    int s[COUNT];
    bool open[COUNT];
    for (int i = 0; i < COUNT; i++) {
        s[i] = i == HELLO_LESS ? lw_web_peer_open(web_port) : lw_web_peer_dial(web_port);
        open[i] = true;
    }
    assert_true(lw_web_peer_put(s[HALF], "GET / HTTP/1.1\r\nHost: localh"));
    char *answer = lw_web_peer_ask(s[KEPT], "GET / HTTP/1.1\r\nHost: localhost\r\n\r\n", false, NULL);
    assert_non_null(strstr(answer, " 200 "));
    free(answer);
    const char *drip = "GET / HTTP/1.1\r\nHost: localhost\r\nX-Pad: "
                       "aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa";
    unsigned left = COUNT;
    const uint64_t begin_ns = lw_clock_ns();
    for (uint64_t age_ns = 0; left && age_ns < SLOW_LIMIT_S * 1000000000ull;
         age_ns = lw_clock_ns() - begin_ns) {
        if (open[DRIP] && *drip) {
            const char piece[2] = {*drip++, 0};
            (void)lw_web_peer_put(s[DRIP], piece);
        }
        for (int p = 0; p < COUNT; p++)
            if (open[p] && lw_web_peer_closes(s[p], 500 / COUNT)) {
                open[p] = false;
                left--;
                if (age_ns < (REQUEST_S - 2) * 1000000000ull)
                    fail_msg("peer %d was closed after %.1f s", p, 1e-9 * (double)age_ns);
            }
    }
    for (int p = 0; p < COUNT; p++) {
        if (open[p]) fail_msg("peer %d is still there", p);
        close(s[p]);
    }
    stop();
}

static void test_connections_have_a_limit(void **state) {
    (void)state;
    struct rlimit limit;
    if (getrlimit(RLIMIT_NOFILE, &limit) == 0 && limit.rlim_cur < limit.rlim_max) {
        limit.rlim_cur = limit.rlim_max;
        (void)setrlimit(RLIMIT_NOFILE, &limit);
    }
    serve("");
    static int s[IN_ALL];
    for (unsigned i = 0; i < CONNECTIONS; i++) s[i] = lw_web_peer_dial(web_port);
    int more = lw_web_peer_dial(web_port);
    assert_true(lw_web_peer_closes(more, 2000));
    close(more);
    more = lw_web_peer_dial_from("127.0.0.2", web_port); /* another address has its own places */
    char *other = lw_web_peer_ask(more, "GET / HTTP/1.1\r\nHost: localhost\r\n\r\n", false, NULL);
    assert_non_null(strstr(other, " 200 "));
    free(other);
    for (unsigned i = CONNECTIONS; i + 1 < IN_ALL; i++) s[i] = lw_web_peer_dial_from("127.0.0.2", web_port);
    int last = lw_web_peer_dial_from("127.0.0.3", web_port); /* in all there are no more */
    assert_true(lw_web_peer_closes(last, 2000));
    close(last);
    for (unsigned i = CONNECTIONS; i + 1 < IN_ALL; i++) close(s[i]);
    close(more);
    close(s[0]);
    for (uint64_t end_ns = lw_clock_ns() + LIMIT_S * 1000000000ull;
         ;) { /* there is room again, for a session too */
        more = lw_web_peer_dial(web_port);
        char *answer = lw_web_peer_ask(more, "GET / HTTP/1.1\r\nHost: localhost\r\n\r\n", false, NULL);
        const bool served = strstr(answer, " 200 ");
        free(answer);
        close(more);
        if (served) break;
        assert_true(lw_clock_ns() < end_ns);
        lw_process_sleep_ms(10);
    }
    for (unsigned i = 1; i < CONNECTIONS; i++) close(s[i]);
    stop();
}

/* The server answers all requests up to the limit. One more gets the last answer, late. */
static void test_requests_without_end(void **state) {
    (void)state;
    serve_root("");
    const int s = lw_web_peer_dial(web_port);
    for (unsigned i = 0; i < REQUESTS_AT_ONCE; i++) {
        char *answer = lw_web_peer_ask(s, "GET /js/ HTTP/1.1\r\nHost: localhost\r\n\r\n", false, NULL);
        if (!strstr(answer, " 200 ")) fail_msg("request %u: %s", i, answer);
        free(answer);
    }
    static char many[200000]; /* all of these come before the first answer */
    for (char *at = many; at < many + sizeof many - 100;)
        at += sprintf(at, "GET / HTTP/1.1\r\nHost: localhost\r\nIf-None-Match: \"x\"\r\n\r\n");
    const uint64_t began_ns = lw_clock_ns();
    size_t size;
    char *answer = lw_web_peer_ask(s, many, true, &size);
    while (!strstr(answer, " 429 ")) { /* requests that the rate allows meanwhile */
        free(answer);
        assert_true(lw_clock_ns() - began_ns < LIMIT_S * 1000000000ull);
        answer = lw_web_peer_ask(s, "", true, &size);
        if (!size) fail_msg("closed without a word");
    }
    assert_true(lw_clock_ns() - began_ns > 900000000ull);
    expect_header(answer, "\r\nretry-after: 1\r\n");
    free(answer);
    assert_true(lw_web_peer_closes(s, LIMIT_S * 1000));
    close(s);
    assert_int_equal(ask("GET", "/", "", NULL, NULL), 200);
    stop();
}

/* Frames with nothing in them, and pings: the session is read no more, and refused after a time. */
static void test_frames_without_end(void **state) {
    (void)state;
    serve("");
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
            char *log = lw_process_err(&daemon_process);
            refused[k] = strstr(log, kinds[k].why);
            free(log);
            left -= refused[k];
        }
        lw_process_sleep_ms(50);
    }
    for (unsigned k = 0; k < KINDS; k++) hang_up(&peer[k]);
    stop();
}

static unsigned lines_with(const char *text, const char *what) {
    unsigned count = 0;
    for (const char *at = text; (at = strstr(at, what)); at++) count++;
    return count;
}

/* A peer can neither fill the log nor write lines of its own into it. */
static void test_log(void **state) {
    (void)state;
    serve("");
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
    stop();
    char *said = lw_process_err(&daemon_process);
    if (!strstr(said, "\"x\\\") left: bye; session 7: \\\\\" joined")) fail_msg("%s", said);
    assert_in_range(lines_with(said, " refused: "), 20, 60 + 2 * LIMIT_S);
    free(said);
}

int main(int argc, char **argv) {
    const struct CMUnitTest long_tests[] = {cmocka_unit_test_teardown(test_answers_are_taken, end_all)};
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(test_files, end_all),
        cmocka_unit_test_teardown(test_codings, end_all),
        cmocka_unit_test_teardown(test_policy, end_all),
        cmocka_unit_test_teardown(test_policy_of_many_servers, end_all),
        cmocka_unit_test_teardown(test_what_is_no_file, end_all),
        cmocka_unit_test_teardown(test_headers_have_a_limit, end_all),
        cmocka_unit_test_teardown(test_hosts, end_all),
        cmocka_unit_test_teardown(test_no_client, end_all),
        cmocka_unit_test_teardown(test_port_in_use, end_all),
        cmocka_unit_test_teardown(test_who_may_open, end_all),
        cmocka_unit_test_teardown(test_same_as_tcp, end_all),
        cmocka_unit_test_teardown(test_a_web_session_changes_nothing, end_all),
        cmocka_unit_test_teardown(test_unless_it_has_a_token_for_control, end_all),
        cmocka_unit_test_teardown(test_misbehaviour, end_all),
        cmocka_unit_test_teardown(test_slow_peers, end_all),
        cmocka_unit_test_teardown(test_requests_without_end, end_all),
        cmocka_unit_test_teardown(test_frames_without_end, end_all),
        cmocka_unit_test_teardown(test_log, end_all),
        cmocka_unit_test_teardown(test_connections_have_a_limit, end_all),
    };
    (void)argv;
    if (argc > 1) return cmocka_run_group_tests(long_tests, NULL, NULL);
    return cmocka_run_group_tests(tests, NULL, NULL);
}
