#include "tests/support/support.h"

#include "common/tls/tls_stream.h"
#include "server/serve/admission/address_places.h"
#include "server/serve/admission/message_rates.h"
#include "server/serve/admission/peer_log.h"
#include "server/serve/admission/server_limits.h"
#include "server/serve/admission/tokens.h"
#include "server/serve/sessions/updates.h"
#include "server/serve/transports/tls_context.h"
#include "server/serve/web/http_origin.h"
#include "server/serve/web/web_files.h"
#include "server/serve/web/web_server.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* The table of limits in docs/access.md says what the constants say, and has them all; so do sentences of
 * proto/wire_format.md. Each limit has a test at it and one past it, which is there. A row that is wrong is
 * printed as it should be. */

#define ROWS_MAX 64u

struct row {
    const char *limit; /* the first column */
    const char *test;  /* FILE:FUNCTION, of tests/ */
    char says[120];    /* the second column */
};

static struct row rows[ROWS_MAX];
static unsigned row_count;

/* A number as documents have it: 10,000. */
static const char *number(uint64_t n) {
    static char text[8][32];
    static unsigned next;
    char *at = text[next++ % 8];
    if (n >= 1000000)
        snprintf(at, 32, "%u,%03u,%03u", (unsigned)(n / 1000000), (unsigned)(n / 1000 % 1000),
                 (unsigned)(n % 1000));
    else if (n >= 1000)
        snprintf(at, 32, "%u,%03u", (unsigned)(n / 1000), (unsigned)(n % 1000));
    else
        snprintf(at, 32, "%u", (unsigned)n);
    return at;
}

static const char *size(uint64_t bytes) {
    static char text[8][32];
    static unsigned next;
    char *at = text[next++ % 8];
    if (bytes % (1u << 20) == 0)
        snprintf(at, 32, "%u MiB", (unsigned)(bytes >> 20));
    else if (bytes % 1024 == 0)
        snprintf(at, 32, "%u KiB", (unsigned)(bytes >> 10));
    else
        snprintf(at, 32, "%u bytes", (unsigned)bytes);
    return at;
}

static void add(const char *limit, const char *test, const char *format, ...) LW_PRINTF(3, 4);
static void add(const char *limit, const char *test, const char *format, ...) {
    assert_true(row_count < ROWS_MAX);
    struct row *row = &rows[row_count++];
    va_list args;
    va_start(args, format);
    vsnprintf(row->says, sizeof row->says, format, args);
    va_end(args);
    row->limit = limit;
    row->test = test;
}

static void add_rate(const char *limit, const char *test, unsigned rate_hz, unsigned burst) {
    if (rate_hz == burst)
        add(limit, test, "%s a second, as many at once", number(rate_hz));
    else
        add(limit, test, "%s a second, %s at once", number(rate_hz), number(burst));
}

static const struct {
    unsigned rate_hz, burst;
} rate[] = {
#define X(name, rate_hz, burst) [LW_MESSAGE_RATES_##name] = {rate_hz, burst},
    LW_MESSAGE_RATES_MAP(X)
#undef X
};

static void add_rates(void) {
    static const char test[] = "unit/test_message_rates:test_every_kind";
    const unsigned of_bytes = LW_MESSAGE_RATES_BYTES;
#define RATE(limit, kind)                                                                                    \
    add_rate(limit, test, rate[LW_MESSAGE_RATES_##kind].rate_hz, rate[LW_MESSAGE_RATES_##kind].burst)
    RATE("INTEREST", INTEREST);
    RATE("PING, and PONG", PING);
    RATE("PING, and PONG", PONG);
    RATE("ACK", ACK);
    RATE("UPDATE", UPDATE);
    RATE("ASK", ASK);
    RATE("HOLDS", HOLDS);
#undef RATE
    assert_int_equal(LW_MESSAGE_RATES_COUNT, 10);
    add_rate("frames of a WebSocket, beyond one for each message",
             "unit/test_session:test_frames_without_messages", rate[LW_MESSAGE_RATES_FRAMES].rate_hz,
             rate[LW_MESSAGE_RATES_FRAMES].burst);
    add("bytes that TLS and WebSocket take for themselves, beyond 40 for each message",
        "unit/test_session:test_overhead", "%s a second, %s at once",
        size(rate[LW_MESSAGE_RATES_OVERHEAD].rate_hz), size(rate[LW_MESSAGE_RATES_OVERHEAD].burst));
    assert_int_equal(LW_MESSAGE_RATES_ENVELOPE, 40);
    add("pause of a peer that says too much", "unit/test_message_rates:test_burst_and_rate",
        "until there is room, and the bytes of %u ms", LW_MESSAGE_RATES_PAUSE_MS);
    add("bytes of all messages but HOLDS", "unit/test_message_rates:test_bytes",
        "%s a second, %s at once; %s times that for a session that may change the scene",
        size(rate[of_bytes].rate_hz), size(rate[of_bytes].burst),
        LW_MESSAGE_RATES_TRUST == 8 ? "eight" : "?");
    add("waiting for that", "unit/test_session:test_saying_too_much", "%u s, less the time within the rates",
        LW_SERVER_EXCESS_TIMEOUT_S);
}

static void add_places(void) {
    const struct lw_address own = {.is_loopback = true}, other = {.is_loopback = false};
    add("sessions", "unit/test_session:test_places", "%s", number(LW_SERVER_SESSIONS_MAX));
    add("with `--tokens`: of these, kept for tokens for control",
        "unit/test_server_access:test_places_are_kept_for_control", "1 in %u", LW_SERVER_KEPT_ONE_IN);
    add("sessions of one address (IPv6: of its first 64 bits), until their links are closed",
        "unit/test_session:test_places_of_an_address", "%s; of the own machine %s",
        number(lw_address_places_share(&other, LW_SERVER_SESSIONS_MAX)),
        number(lw_address_places_share(&own, LW_SERVER_SESSIONS_MAX)));
    const unsigned refill_s = LW_SERVER_CONNECTIONS_REFILL_S;
    add("new connections of one address", "unit/test_session:test_connecting_too_often",
        "%s at once, %u a second. From the own machine: %s, %u. At least %u, %u",
        number(lw_address_places_share(&other, LW_SERVER_SESSIONS_MAX)),
        lw_address_places_share(&other, LW_SERVER_SESSIONS_MAX) / refill_s,
        number(lw_address_places_share(&own, LW_SERVER_SESSIONS_MAX)),
        lw_address_places_share(&own, LW_SERVER_SESSIONS_MAX) / refill_s, LW_SERVER_CONNECTIONS_MIN,
        LW_SERVER_CONNECTIONS_MIN / refill_s);
    add("new connections of all in a turn of the loop, at each port", "unit/test_accept:test_many_at_once",
        "%u; by HTTPS %u", LW_SERVER_TURN_CONNECTIONS, LW_SERVER_TURN_HTTPS_CONNECTIONS);
    add("connections beyond these that get a refusal", "unit/test_session:test_turned_away",
        "%s; of one address %u", number(LW_SERVER_TURNED_AWAY_MAX), LW_SERVER_ADDRESS_TURNED_AWAY_MAX);
    add("sessions on the Unix socket", "unit/test_server_access:test_places_are_kept_for_control", "none");
}

static void add_times(void) {
    add("time to say HELLO, a TLS handshake included", "unit/test_session:test_hello_in_time",
        "%u s; %u s while only kept places are left", LW_SERVER_HELLO_TIMEOUT_S, LW_SERVER_CROWDED_HELLO_S);
    add("time from connecting to PACKAGE_REQUEST, unless it controls",
        "unit/test_session:test_package_in_time", "%u s", LW_SERVER_PACKAGE_TIMEOUT_S);
    add("silence", "unit/test_session:test_silence", "%u s: a PING; %u s", LW_SERVER_SILENCE_S / 2,
        LW_SERVER_SILENCE_S);
    add("bytes wait and the peer takes none, however slowly it decodes", "unit/test_session:test_stall",
        "%u s", LW_SERVER_STALL_TIMEOUT_S);
    add("time from a refusal to the close", "unit/test_session:test_who_was_slow_may_read_on",
        "%u s; of who took no byte %u s", LW_SERVER_LINGER_S, LW_SERVER_STALL_TIMEOUT_S);
}

static void add_messages(void) {
    add("bytes of one peer that the system keeps until they are read",
        "unit/test_server_readers:test_flood_of_messages", "%s", size(LW_SERVER_RECEIVE_SIZE));
    add("bytes read of one peer in a turn of the loop", "unit/test_server_readers:test_flood_of_messages",
        "%s", size(LW_SERVER_TURN_READ));
    add("the same of a WebSocket", "integration/test_web_sessions:test_frames_without_end", "%s",
        size(LW_SERVER_TURN_FRAMES_READ));
    add("dropped bytes of a refused peer", "unit/test_session:test_what_follows_a_refusal",
        "%s, and %u frames; then by the rates", size(LW_SERVER_DROPPED_MAX), LW_SERVER_DROPPED_FRAMES_MAX);
    add("messages handled of one peer in a turn", "unit/test_session:test_messages_of_a_turn", "%u",
        LW_SERVER_TURN_MESSAGES);
    add("body of a message", "unit/test_session:test_body", "%s", size(LW_FRAMING_CLIENT_BODY_MAX));
    add("fields in a body, a packed list counting as one", "unit/test_message_fields:test_fields", "%u",
        LW_MESSAGE_FIELDS_MAX);
    add("memory to read one message", "unit/test_session:test_memory_of_a_message", "%s",
        size(LW_SERVER_PARSE_MAX));
    add("tiles in an INTEREST; in a HOLDS", "unit/test_message_fields:test_interest", "%s; %s",
        number(LW_MESSAGE_INTEREST_MAX), number(LW_MESSAGE_HOLDS_MAX));
    add("changes in an UPDATE", "unit/test_message_fields:test_update_counts", "%s",
        number(LW_MESSAGE_CHANGES_MAX));
    add("UPDATEs that wait for a frame; changes in all of them",
        "unit/test_server_updates:test_a_thousand_updates_in_one_frame_keep_their_order", "%s; %s",
        number(LW_UPDATES_MAX), number(LW_UPDATES_CHANGES_MAX));
    add("answers to UPDATE and ASK that the peer does not read", "unit/test_session:test_answers", "%s",
        number(LW_SERVER_ANSWERS_MAX));
    add("token in HELLO", "unit/test_server_access:test_tokens", "one of the file's");
    add("tokens in the file; bytes of it", "unit/test_tokens:test_the_number_is_bounded", "%s; %s",
        number(LW_TOKENS_MAX), size(LW_TOKENS_FILE_MAX));
    add("bytes of a certificate with its issuers, and of a key", "unit/test_tls_stream:test_bad_files", "%s",
        size(LW_TLS_CONTEXT_FILE_MAX));
    add("name in HELLO", "unit/test_message_fields:test_texts",
        "%u bytes, without control and format characters; in the log in quotes", LW_MESSAGE_NAME_MAX);
    add("time of all TLS handshakes in a turn of the loop", "integration/test_tls:test_programs_by_tls",
        "%u ms", LW_SERVER_HANDSHAKES_MS);
    add("bytes of TLS itself that wait for a peer which reads none", "integration/test_tls:test_garbage",
        "%s", size(LW_SERVER_ASIDE_MAX));
    add("bytes to one peer in a second", "unit/test_server_tiles:test_rate_limits", "what its link takes");
    add("bytes that wait to be sent to one peer", "unit/test_session:test_bytes_that_wait", "%s",
        size(LW_SERVER_QUEUE_MAX));
    add("log lines about one address", "unit/test_peer_log:test_one_address",
        "%u a second, %u at once; of all %u a second", LW_PEER_LOG_HZ, LW_PEER_LOG_BURST, LW_PEER_LOG_ALL_HZ);
}

static void add_http(void) {
    const struct lw_address own = {.is_loopback = true}, other = {.is_loopback = false};
    add("HTTP: headers of a request", "integration/test_web:test_headers_have_a_limit", "%s",
        size(LW_WEB_SERVER_HEADER_MAX));
    add("HTTP: a Host, an Origin", "integration/test_web:test_hosts", "%u bytes", LW_HTTP_ORIGIN_MAX - 1);
    add("HTTP: time for a request to come, a TLS handshake included, and between two",
        "integration/test_web:test_slow_peers", "%u s", LW_WEB_SERVER_REQUEST_S);
    add("HTTP: time for each 64 KiB of an answer", "integration/test_web:test_answers_are_taken", "%u s",
        LW_WEB_SERVER_ANSWER_S);
    add("HTTP: requests on one connection", "integration/test_web:test_requests_without_end",
        "%u a second, %u at once", LW_WEB_SERVER_REQUESTS_HZ, LW_WEB_SERVER_REQUESTS_BURST);
    add("HTTP: connections that are no sessions", "integration/test_web:test_connections_have_a_limit",
        "%s; of one address %u, of the own machine %u", number(LW_WEB_SERVER_CONNECTIONS_MAX),
        lw_address_places_share(&other, LW_WEB_SERVER_CONNECTIONS_MAX),
        lw_address_places_share(&own, LW_WEB_SERVER_CONNECTIONS_MAX));
    add("HTTP: method, body", "integration/test_web:test_what_is_no_file", "GET and HEAD, none");
    add("HTTP: names of a Host, Origins of pages", "integration/test_web:test_hosts", "its own");
    add("HTTP: web root", "unit/test_web_files:test_limits", "%s files, %s, %u folders deep",
        number(LW_WEB_FILES_MAX), size(LW_WEB_FILES_BYTES_MAX), LW_WEB_FILES_DEPTH_MAX);
}

static void add_all(void) {
    row_count = 0;
    add_places();
    add_times();
    add_messages();
    add_rates();
    add_http();
}

/* ---- documents ---- */

static char *read_text(const char *path) {
    size_t unused;
    return (char *)lw_support_read_file(lw_support_source(path), &unused);
}

/* One cell of a line "| a | b | ...", without the spaces around it. */
static void cell_of(const char *line, unsigned column, char *out, size_t out_size) {
    const char *end = strchr(line, '\n'), *at = line + 1;
    *out = '\0';
    for (unsigned c = 0; at && at < end; c++) {
        const char *next = memchr(at, '|', (size_t)(end - at));
        if (!next) return;
        if (c == column) {
            while (*at == ' ') at++;
            size_t length = (size_t)(next - at);
            while (length && at[length - 1] == ' ') length--;
            if (length >= out_size) length = out_size - 1;
            memcpy(out, at, length);
            out[length] = '\0';
            return;
        }
        at = next + 1;
    }
}

static void test_access_document(void **state) {
    (void)state;
    char *text = read_text("docs/access.md"), *at = strstr(text, "\n## Limits\n"), limit[200], says[200];
    unsigned wrong = 0, seen[ROWS_MAX] = {0};
    add_all();
    assert_non_null(at);
    at = strstr(at, "\n| limit |");
    assert_non_null(at);
    at = strchr(strchr(at + 1, '\n') + 1, '\n') + 1; /* behind the head and its rule */
    for (; *at == '|'; at = strchr(at, '\n') + 1) {
        bool known = false;
        cell_of(at, 0, limit, sizeof limit);
        cell_of(at, 1, says, sizeof says);
        for (unsigned r = 0; r < row_count; r++) {
            if (strcmp(rows[r].limit, limit) != 0) continue;
            known = true;
            seen[r]++;
            if (strcmp(rows[r].says, says) == 0) continue;
            print_error("docs/access.md: | %s | %s | where the constants say\n    %s\n", limit, says,
                        rows[r].says);
            wrong++;
        }
        if (known) continue;
        print_error("docs/access.md: \"%s\" is not compared with a constant: add it here\n", limit);
        wrong++;
    }
    for (unsigned r = 0; r < row_count; r++)
        if (seen[r] != 1) {
            print_error("docs/access.md lacks | %s | %s |, or has it twice\n", rows[r].limit, rows[r].says);
            wrong++;
        }
    free(text);
    assert_int_equal(wrong, 0);
}

/* A document's text without the breaks of its lines. */
static char *read_sentences(const char *path) {
    char *text = read_text(path);
    for (char *c = text; *c; c++)
        if (*c == '\n') *c = ' ';
    return text;
}

static void expect_sentence(const char *text, const char *format, ...) LW_PRINTF(2, 3);
static void expect_sentence(const char *text, const char *format, ...) {
    char wanted[300];
    va_list args;
    va_start(args, format);
    vsnprintf(wanted, sizeof wanted, format, args);
    va_end(args);
    if (!strstr(text, wanted)) fail_msg("proto/wire_format.md does not say \"%s\"", wanted);
}

static void test_wire_format(void **state) {
    (void)state;
    char *text = read_sentences("proto/wire_format.md");
#define A_SECOND(kind) number(rate[LW_MESSAGE_RATES_##kind].rate_hz)
    expect_sentence(text, "%s bytes from server to client and %s bytes from client to server",
                    number(LW_FRAMING_BODY_MAX), number(LW_FRAMING_CLIENT_BODY_MAX));
    expect_sentence(text, "at most %u fields", LW_MESSAGE_FIELDS_MAX);
    expect_sentence(text, "for the operator's log; at most %u bytes", LW_MESSAGE_NAME_MAX);
    expect_sentence(text, "at most %s entries, lists of equal length; | | 4 |",
                    number(LW_MESSAGE_INTEREST_MAX));
    expect_sentence(text, "at most %s entries, lists of equal length; more go into another HOLDS",
                    number(LW_MESSAGE_HOLDS_MAX));
    expect_sentence(text, "from the table below; at most %s entries", number(LW_MESSAGE_CHANGES_MAX));
    expect_sentence(text, "once %s of them wait", number(LW_SERVER_ANSWERS_MAX));
    expect_sentence(text, "within %u s of connecting, else REFUSAL TIMEOUT", LW_SERVER_HELLO_TIMEOUT_S);
    expect_sentence(text, "or %u s where hardly any place is left", LW_SERVER_CROWDED_HELLO_S);
    expect_sentence(
        text,
        "beyond %s INTEREST, %s PING, %s PONG, %s ACK, %s UPDATE, %s ASK or %s HOLDS a second, or %s "
        "of all but HOLDS",
        A_SECOND(INTEREST), A_SECOND(PING), A_SECOND(PONG), A_SECOND(ACK), A_SECOND(UPDATE), A_SECOND(ASK),
        A_SECOND(HOLDS), size(rate[LW_MESSAGE_RATES_BYTES].rate_hz));
    expect_sentence(text,
                    "%s frames of a WebSocket more than messages, and %s that WebSocket and TLS take for "
                    "themselves beyond %u bytes a message",
                    A_SECOND(FRAMES), size(rate[LW_MESSAGE_RATES_OVERHEAD].rate_hz),
                    LW_MESSAGE_RATES_ENVELOPE);
    expect_sentence(text, "sends REFUSAL RATE to a client that goes on for %u s", LW_SERVER_EXCESS_TIMEOUT_S);
    expect_sentence(
        text,
        "has not heard a byte for %u s, and sends REFUSAL TIMEOUT after %u s. It does so, too, to a "
        "client that has sent no PACKAGE_REQUEST %u s after connecting",
        LW_SERVER_SILENCE_S / 2, LW_SERVER_SILENCE_S, LW_SERVER_PACKAGE_TIMEOUT_S);
    expect_sentence(text, "has taken no byte for %u s although", LW_SERVER_STALL_TIMEOUT_S);
    expect_sentence(
        text, "%s sessions, %s of one address", number(LW_SERVER_SESSIONS_MAX),
        number(lw_address_places_share(&(struct lw_address){{0}, false}, LW_SERVER_SESSIONS_MAX)));
#undef A_SECOND
    free(text);
}

static void test_tests_are_there(void **state) {
    (void)state;
    unsigned missing = 0;
    add_all();
    for (unsigned r = 0; r < row_count; r++) {
        char path[100], function[100];
        assert_int_equal(sscanf(rows[r].test, "%40[^:]:%80s", path, function), 2);
        char file[160], wanted[120];
        snprintf(file, sizeof file, "tests/%s.c", path);
        snprintf(wanted, sizeof wanted, "static void %s(", function);
        char *text = read_text(file);
        if (!strstr(text, wanted)) {
            print_error("%s: there is no %s in %s\n", rows[r].limit, function, file);
            missing++;
        }
        free(text);
    }
    assert_int_equal(missing, 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_access_document),
        cmocka_unit_test(test_wire_format),
        cmocka_unit_test(test_tests_are_there),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
