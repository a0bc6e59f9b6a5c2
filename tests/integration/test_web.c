/* The real lightwelld over HTTP: its files, codings, policy and limits. */
#include "tests/integration/web_case.h"
#include "tests/support/web_peer.h"

#include "common/base/clock.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

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
    web_case_serve(line);
}

/* ---- HTTP ---- */

static const char *body_of(const char *answer) {
    const char *end = strstr(answer, "\r\n\r\n");
    assert_non_null(end);
    return end + 4;
}

static void test_files(void **state) {
    (void)state;
    serve_root("");
    char *answer, tag[200];
    size_t size, size_of_file;
    assert_int_equal(web_case_ask("GET", "/", "", &answer, NULL), 200);
    assert_string_equal(body_of(answer), "<p>index</p>");
    web_case_expect_header(answer, "\r\ncontent-type: text/html");
    web_case_expect_header(answer, "\r\nx-content-type-options: nosniff\r\n");
    web_case_expect_header(answer, "\r\ncontent-security-policy: default-src 'none'; script-src 'self'");
    web_case_expect_header(answer, "\r\ncache-control: no-cache\r\n");
    const char *etag = strcasestr(answer, "\r\netag: ");
    assert_non_null(etag);
    snprintf(tag, sizeof tag, "If-None-Match: %.34s\r\n", etag + 8);
    free(answer);
    assert_int_equal(web_case_ask("GET", "/", tag, &answer, NULL), 304);
    assert_string_equal(body_of(answer), "");
    free(answer);
    assert_int_equal(web_case_ask("GET", "/js/tiles.wasm", tag, &answer, &size),
                     200); /* another file's tag */
    web_case_expect_header(answer, "\r\ncontent-type: application/wasm\r\n");
    uint8_t *wasm = lw_support_read_file(lw_support_temporary("web/js/tiles.wasm"), &size_of_file);
    assert_int_equal(size, (size_t)(body_of(answer) - answer) + WASM_SIZE);
    assert_memory_equal(body_of(answer), wasm, WASM_SIZE);
    free(wasm);
    free(answer);
    assert_int_equal(web_case_ask("HEAD", "/js/tiles.wasm", "", &answer, NULL), 200);
    web_case_expect_header(answer, "\r\ncontent-length: 300000\r\n");
    assert_string_equal(body_of(answer), "");
    free(answer);
    assert_int_equal(web_case_ask("GET", "/js/", "", &answer, NULL), 200);
    assert_string_equal(body_of(answer), "<p>inner</p>");
    free(answer);
    web_case_stop();
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
        assert_int_equal(web_case_ask("GET", wanted[i].path, wanted[i].accept, &answer, NULL), 200);
        assert_string_equal(body_of(answer), wanted[i].body);
        snprintf(line, sizeof line, "\r\ncontent-encoding: %s\r\n", wanted[i].coding ? wanted[i].coding : "");
        if (wanted[i].coding)
            web_case_expect_header(answer, line);
        else
            assert_null(strcasestr(answer, "content-encoding"));
        if (strcmp(wanted[i].path, "/js/main.js") == 0) {
            web_case_expect_header(answer, "\r\nvary: accept-encoding\r\n");
            web_case_expect_header(answer, "\r\ncontent-type: text/javascript");
        } else
            assert_null(strcasestr(answer, "vary:"));
        if (i == 0 || i == 1 || i == 3)
            snprintf(tags[tag_count++], sizeof tags[0], "If-None-Match: W/%.34s\r\n",
                     strcasestr(answer, "\r\netag: ") + 8);
        free(answer);
    }
    for (unsigned i = 0; i < tag_count; i++) { /* the first one is br's */
        snprintf(line, sizeof line, "Accept-Encoding: br\r\n%s", tags[i]);
        assert_int_equal(web_case_ask("GET", "/js/main.js", line, NULL, NULL), i == 0 ? 304 : 200);
    }
    assert_int_equal(web_case_ask("HEAD", "/js/main.js", "Accept-Encoding: gzip\r\n", &answer, NULL), 200);
    web_case_expect_header(answer, "\r\ncontent-length: 4\r\n");
    free(answer);
    assert_int_equal(web_case_ask("GET", "/js/main.js", "Accept-Encoding: *;q=0\r\n", NULL, NULL), 406);
    assert_int_equal(web_case_ask("GET", "/js/", "Accept-Encoding: br, identity;q=0\r\n", NULL, NULL), 406);
    web_case_stop();
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
        const int s = lw_web_peer_dial(web_case_port);
        char *answer = lw_web_peer_ask(s, request, false, NULL);
        web_case_expect_header(answer, hosts[i].line);
        free(answer);
        close(s);
    }
    web_case_stop();
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
    assert_int_equal(web_case_ask("GET", "/", "", &answer, NULL), 200);
    for (char *at = servers; (at = strchr(at, ',')); at++) *at = ' ';
    web_case_expect_header(answer, servers);
    web_case_expect_header(answer, "; frame-ancestors 'none'\r\n");
    free(answer);
    web_case_stop();
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
        const unsigned status = web_case_ask("GET", paths[i], "", &answer, NULL);
        if (status < 400 && status != 0 && strcmp(body_of(answer), "<p>index</p>") != 0)
            fail_msg("%s: %s", paths[i], answer);
        if (strstr(answer, "secret") || strstr(answer, "root:")) fail_msg("%s: %s", paths[i], answer);
        free(answer);
    }
    assert_int_equal(web_case_ask("GET", "/nothing", "", NULL, NULL), 404);
    assert_int_equal(web_case_ask("GET", "/ws", "", NULL, NULL), 426);
    static const char *const methods[] = {"POST", "PUT", "DELETE", "OPTIONS", "PATCH"};
    for (size_t i = 0; i < sizeof methods / sizeof *methods; i++)
        assert_int_equal(web_case_ask(methods[i], "/", "", NULL, NULL), 405);
    assert_int_equal(web_case_ask("GET", "/", "Content-Length: 5\r\n\r\nhello", NULL, NULL), 400);
    assert_int_equal(web_case_ask("GET", "/", "Transfer-Encoding: chunked\r\n\r\n0\r\n\r\n", NULL, NULL),
                     400);
    assert_int_equal(web_case_ask("GET", "/", "", NULL, NULL), 200);
    web_case_stop();
}

/* The status for headers of this size, with what every request has; 0: closed without an answer. */
static unsigned ask_with_headers_of(size_t size) {
    char request[3 * HEADER_MAX];
    unsigned status = 0;
    int length = snprintf(request, sizeof request, "GET / HTTP/1.1\r\nHost: localhost\r\nUser-Agent: ");
    memset(request + length, 'a', size - (size_t)length - 4);
    memcpy(request + size - 4, "\r\n\r\n", 5);
    const int s = lw_web_peer_dial(web_case_port);
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
    web_case_stop();
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
        s[i] = lw_web_peer_dial(web_case_port);
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
    web_case_stop();
}

static unsigned ask_host(const char *host) {
    char request[1024];
    unsigned status = 0;
    snprintf(request, sizeof request, "GET / HTTP/1.1\r\n%s%s%s\r\n", host ? "Host: " : "", host ? host : "",
             host ? "\r\n" : "");
    const int s = lw_web_peer_dial(web_case_port);
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
    web_case_stop();
}

/* The program has no client beside it here: a page says so. */
static void test_no_client(void **state) {
    (void)state;
    char *answer, line[600];
    const char *empty = lw_support_temporary("empty");
    assert_int_equal(mkdir(empty, 0700), 0);
    snprintf(line, sizeof line, "--web-root %s", empty);
    web_case_serve(line);
    assert_int_equal(web_case_ask("GET", "/", "", &answer, NULL), 200);
    assert_non_null(strstr(body_of(answer), "--web-root"));
    free(answer);
    assert_int_equal(web_case_ask("GET", "/index.html", "", NULL, NULL), 404);
    web_case_stop();
    struct lw_process other; /* one that was named must be there */
    snprintf(line, sizeof line, "builtin:cornell --listen 127.0.0.1:0 --http 127.0.0.1:0 --web-root %s/none",
             empty);
    lw_process_start(&other, "lightwelld", line);
    assert_int_equal(lw_process_finish(&other, LIMIT_S), 66);
    assert_true(lw_process_said(&other, "--web-root: "));
}

static void test_port_in_use(void **state) {
    (void)state;
    web_case_serve("");
    struct lw_process other;
    char line[256];
    snprintf(line, sizeof line, "builtin:cornell --listen 127.0.0.1:0 --http 127.0.0.1:%u",
             (unsigned)web_case_port);
    lw_process_start(&other, "lightwelld", line);
    assert_int_equal(lw_process_finish(&other, LIMIT_S), 69);
    assert_true(lw_process_said(&other, "choose another with --http HOST:PORT"));
    web_case_stop();
}

/* ---- WebSocket ---- */

/* Requests that never come to their end, WebSockets that never say HELLO; all at
 * once, as each takes its time. */
static void test_slow_peers(void **state) {
    (void)state;
    web_case_serve("");
    enum { SILENT, HALF, DRIP, KEPT, HELLO_LESS, COUNT };
    int s[COUNT];
    bool open[COUNT];
    for (int i = 0; i < COUNT; i++) {
        s[i] = i == HELLO_LESS ? lw_web_peer_open(web_case_port) : lw_web_peer_dial(web_case_port);
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
    web_case_stop();
}

static void test_connections_have_a_limit(void **state) {
    (void)state;
    struct rlimit limit;
    if (getrlimit(RLIMIT_NOFILE, &limit) == 0 && limit.rlim_cur < limit.rlim_max) {
        limit.rlim_cur = limit.rlim_max;
        (void)setrlimit(RLIMIT_NOFILE, &limit);
    }
    web_case_serve("");
    static int s[IN_ALL];
    for (unsigned i = 0; i < CONNECTIONS; i++) s[i] = lw_web_peer_dial(web_case_port);
    int more = lw_web_peer_dial(web_case_port);
    assert_true(lw_web_peer_closes(more, 2000));
    close(more);
    more = lw_web_peer_dial_from("127.0.0.2", web_case_port); /* another address has its own places */
    char *other = lw_web_peer_ask(more, "GET / HTTP/1.1\r\nHost: localhost\r\n\r\n", false, NULL);
    assert_non_null(strstr(other, " 200 "));
    free(other);
    for (unsigned i = CONNECTIONS; i + 1 < IN_ALL; i++)
        s[i] = lw_web_peer_dial_from("127.0.0.2", web_case_port);
    int last = lw_web_peer_dial_from("127.0.0.3", web_case_port); /* in all there are no more */
    assert_true(lw_web_peer_closes(last, 2000));
    close(last);
    for (unsigned i = CONNECTIONS; i + 1 < IN_ALL; i++) close(s[i]);
    close(more);
    close(s[0]);
    for (uint64_t end_ns = lw_clock_ns() + LIMIT_S * 1000000000ull;
         ;) { /* there is room again, for a session too */
        more = lw_web_peer_dial(web_case_port);
        char *answer = lw_web_peer_ask(more, "GET / HTTP/1.1\r\nHost: localhost\r\n\r\n", false, NULL);
        const bool served = strstr(answer, " 200 ");
        free(answer);
        close(more);
        if (served) break;
        assert_true(lw_clock_ns() < end_ns);
        lw_process_sleep_ms(10);
    }
    for (unsigned i = 1; i < CONNECTIONS; i++) close(s[i]);
    web_case_stop();
}

/* The server answers all requests up to the limit. One more gets the last answer, late. */
static void test_requests_without_end(void **state) {
    (void)state;
    serve_root("");
    const int s = lw_web_peer_dial(web_case_port);
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
    web_case_expect_header(answer, "\r\nretry-after: 1\r\n");
    free(answer);
    assert_true(lw_web_peer_closes(s, LIMIT_S * 1000));
    close(s);
    assert_int_equal(web_case_ask("GET", "/", "", NULL, NULL), 200);
    web_case_stop();
}

int main(int argc, char **argv) {
    const struct CMUnitTest long_tests[] = {
        cmocka_unit_test_teardown(test_answers_are_taken, lw_process_teardown),
    };
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(test_files, lw_process_teardown),
        cmocka_unit_test_teardown(test_codings, lw_process_teardown),
        cmocka_unit_test_teardown(test_policy, lw_process_teardown),
        cmocka_unit_test_teardown(test_policy_of_many_servers, lw_process_teardown),
        cmocka_unit_test_teardown(test_what_is_no_file, lw_process_teardown),
        cmocka_unit_test_teardown(test_headers_have_a_limit, lw_process_teardown),
        cmocka_unit_test_teardown(test_hosts, lw_process_teardown),
        cmocka_unit_test_teardown(test_no_client, lw_process_teardown),
        cmocka_unit_test_teardown(test_port_in_use, lw_process_teardown),
        cmocka_unit_test_teardown(test_slow_peers, lw_process_teardown),
        cmocka_unit_test_teardown(test_requests_without_end, lw_process_teardown),
        cmocka_unit_test_teardown(test_connections_have_a_limit, lw_process_teardown),
    };
    (void)argv;
    if (argc > 1) return cmocka_run_group_tests(long_tests, NULL, NULL);
    return cmocka_run_group_tests(tests, NULL, NULL);
}
