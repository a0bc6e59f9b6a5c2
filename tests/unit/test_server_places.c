#include "tests/support/serving.h"

#include "server/serve/server.h"
#include "tests/support/server_clock.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <signal.h>
#include <sys/socket.h>
#include <unistd.h>

/* Places: of all and of an address. */

/* ---- a peer ---- */

static int dial_from(const struct serving *f, const char *own) {
    int s = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    struct sockaddr_in from = {.sin_family = AF_INET}, to = {.sin_family = AF_INET,
                                                             .sin_port = htons(lw_server_port(f->server)),
                                                             .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    assert_int_equal(inet_pton(AF_INET, own, &from.sin_addr), 1);
    assert_int_equal(bind(s, (struct sockaddr *)&from, sizeof from), 0);
    assert_int_equal(connect(s, (struct sockaddr *)&to, sizeof to), 0);
    return s;
}

/* ---- many, full, stop ---- */

static void test_many_connects(void **state) {
    (void)state;
    enum { MANY = 300 };
    struct serving *f = serving_start(&(struct lw_server_desc){0});
    static int s[MANY];
    serving_publish(f, serving_make_snapshot(f, 1, 0));
    for (int i = 0; i < MANY; i++) s[i] = serving_dial_and_greet(f);
    assert_int_equal(serving_stats_of(f).sessions_now, MANY);
    for (int i = 0; i < MANY; i += 2) close(s[i]);
    serving_wait_for_sessions(f, MANY / 2);
    for (int i = 1; i < MANY; i += 2) close(s[i]);
    serving_wait_for_sessions(f, 0);
    assert_int_equal(serving_stats_of(f).sessions_total, MANY);
    serving_end(f);
}

static void test_full(void **state) {
    (void)state;
    struct serving *f = serving_start(&(struct lw_server_desc){.sessions_max = 3});
    int s[3];
    for (int i = 0; i < 3; i++) s[i] = serving_dial_and_greet(f);
    serving_expect_refusal(serving_dial(f), LW_REFUSAL_FULL);
    close(s[0]);
    serving_wait_for_sessions(f, 2);
    s[0] = serving_dial_and_greet(f); /* a place became free */
    for (int i = 0; i < 3; i++) close(s[i]);
    serving_end(f);
}

/* Dials until there is a place: one that was taken becomes free when its link is closed, a moment later. */
static int dial_until_welcome(const struct serving *f) {
    for (;; server_clock_step(SERVING_STEP_MS)) {
        struct lw_message m;
        const int s = serving_dial(f);
        serving_put(s, &serving_hello);
        const bool answered = serving_get(s, &m), welcomed = answered && m.type == LW_MESSAGE_WELCOME;
        if (answered) lw_message_finish(&m);
        if (welcomed) return s;
        close(s);
    }
}

static void test_an_address_has_its_places(void **state) {
    (void)state;
    struct serving *f =
        serving_start(&(struct lw_server_desc){.sessions_max = 20, .address_sessions_max = 3});
    int s[3];
    for (int i = 0; i < 3; i++) s[i] = serving_dial_and_greet(f);
    serving_expect_refusal(serving_dial(f), LW_REFUSAL_FULL);
    int other = dial_from(f, "127.0.0.2"); /* which has its own */
    struct lw_message m;
    serving_put(other, &serving_hello);
    serving_expect(other, LW_MESSAGE_WELCOME, &m);
    lw_message_finish(&m);
    serving_put_bytes(s[0], "nonsense", 8); /* a refused peer gives its place up once its link is closed */
    serving_expect_refusal(s[0], LW_REFUSAL_PROTOCOL);
    s[0] = dial_until_welcome(f);
    close(s[1]);
    serving_wait_for_sessions(f, 3);
    s[1] = serving_dial_and_greet(f);
    serving_expect_refusal(serving_dial(f), LW_REFUSAL_FULL);
    for (int i = 0; i < 3; i++) close(s[i]);
    close(other);
    serving_end(f);
    f = serving_start(&(struct lw_server_desc){.sessions_max = 20}); /* a tenth is kept for others */
    int many[18];
    for (int i = 0; i < 18; i++) many[i] = serving_dial_and_greet(f);
    serving_expect_refusal(serving_dial(f), LW_REFUSAL_FULL);
    other = dial_from(f, "127.0.0.2");
    serving_put(other, &serving_hello);
    serving_expect(other, LW_MESSAGE_WELCOME, &m);
    lw_message_finish(&m);
    for (int i = 0; i < 18; i++) close(many[i]);
    close(other);
    serving_end(f);
}

/* Refused peers that stay on the line have their places, and few lines without one: other peers
 * notice nothing. */
static void test_refused_ones_that_linger(void **state) {
    (void)state;
    enum { LINGERING = 1100 };
    struct serving *f =
        serving_start(&(struct lw_server_desc){.sessions_max = 40, .address_sessions_max = 20});
    static int lingering[LINGERING];
    for (int i = 0; i < LINGERING; i++) {
        lingering[i] = dial_from(f, "127.0.0.2");
        (void)send(lingering[i], "nonsense", 8, MSG_NOSIGNAL); /* some are closed by then */
        if (i % 100) continue;
        int s = serving_dial_and_greet(f);
        close(s);
        serving_wait_for_sessions(f, 0);
    }
    for (int i = 0; i < LINGERING; i++) close(lingering[i]);
    serving_end(f);
}

/* One address's connections without a place get a refusal as far as there is room, and are closed beyond
 * that. */
static void test_who_is_turned_away_is_refused(void **state) {
    (void)state;
    enum { MORE = LW_SERVER_ADDRESS_TURNED_AWAY_MAX + 1 };
    struct serving *f = serving_start(&(struct lw_server_desc){.sessions_max = 5, .address_sessions_max = 1});
    int one = serving_dial_and_greet(f), more[MORE], refused = 0;
    for (int i = 0; i < MORE; i++) more[i] = serving_dial(f);
    for (int i = 0; i < MORE; i++) {
        struct lw_message m;
        if (!serving_get(more[i], &m)) continue;
        assert_int_equal(m.type, LW_MESSAGE_REFUSAL);
        assert_int_equal(m.refusal.code, LW_REFUSAL_FULL);
        lw_message_finish(&m);
        refused++;
    }
    assert_in_range(refused, LW_SERVER_ADDRESS_TURNED_AWAY_MAX,
                    MORE); /* all where the first have gone by then */
    for (int i = 0; i < MORE; i++) close(more[i]);
    close(one);
    serving_end(f);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_many_connects),
        cmocka_unit_test(test_full),
        cmocka_unit_test(test_an_address_has_its_places),
        cmocka_unit_test(test_refused_ones_that_linger),
        cmocka_unit_test(test_who_is_turned_away_is_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
