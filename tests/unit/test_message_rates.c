#include "tests/support/support.h"

#include "server/serve/admission/message_rates.h"

#include <string.h>

#define SECOND_NS 1000000000ull
#define LIMIT_S   10u

static const struct lw_framing_header ping = {.type = LW_MESSAGE_PING, .body_size = 2};

static void test_burst_and_rate(void **state) {
    (void)state;
    struct lw_message_rates rates;
    uint64_t now_ns = 5 * SECOND_NS;
    lw_message_rates_init(&rates, now_ns);
    for (int i = 0; i < 60; i++) assert_false(lw_message_rates_count(&rates, ping, now_ns));
    assert_true(lw_message_rates_count(&rates, ping, now_ns)); /* one past the limit */
    const uint64_t pause_ns = SECOND_NS / 20 + LW_MESSAGE_RATES_PAUSE_MS * SECOND_NS / 1000;
    assert_true(lw_message_rates_wait(&rates, now_ns + pause_ns - 1000));
    assert_false(lw_message_rates_wait(&rates, now_ns += pause_ns + 1000));
    for (int i = 0; i < 5; i++) /* what came in meanwhile */
        assert_false(lw_message_rates_count(&rates, ping, now_ns));
    for (int i = 0; i < 200; i++) /* 20 a second */
        assert_false(lw_message_rates_count(&rates, ping, now_ns += SECOND_NS / 20 + 1000));
    /* others have buckets of their own */
    assert_true(lw_message_rates_count(&rates, ping, now_ns));
    assert_true(rates.left[LW_MESSAGE_RATES_ACK] == 1200);
}

/* Every kind has what the documents say at once, and waits one message past it. */
static void test_every_kind(void **state) {
    (void)state;
    static const struct {
        uint16_t type;
        unsigned at_once;
    } kinds[] = {{LW_MESSAGE_INTEREST, 60}, {LW_MESSAGE_PING, 60},     {LW_MESSAGE_PONG, 60},
                 {LW_MESSAGE_ACK, 1200},    {LW_MESSAGE_UPDATE, 8000}, {LW_MESSAGE_HOLDS, 512},
                 {LW_MESSAGE_ASK, 60}};
    for (size_t k = 0; k < sizeof kinds / sizeof *kinds; k++) {
        struct lw_message_rates rates;
        const struct lw_framing_header header = {.type = kinds[k].type};
        lw_message_rates_init(&rates, 0);
        for (unsigned i = 0; i < kinds[k].at_once; i++)
            assert_false(lw_message_rates_count(&rates, header, 0));
        assert_true(lw_message_rates_count(&rates, header, 0));
    }
}

static void test_bytes(void **state) {
    (void)state;
    struct lw_message_rates rates;
    const struct lw_framing_header large = {.type = LW_MESSAGE_PACKAGE_REQUEST,
                                            .body_size = LW_FRAMING_CLIENT_BODY_MAX};
    lw_message_rates_init(&rates, 0);
    unsigned count = 1;
    while (!lw_message_rates_count(&rates, large, 0)) count++;
    assert_int_equal(count, 1048576 / (LW_FRAMING_CLIENT_BODY_MAX + LW_FRAMING_HEADER_SIZE) + 1);
}

/* A session that may change the scene may say more; HOLDS counts by messages alone. */
static void test_trust_and_holds(void **state) {
    (void)state;
    struct lw_message_rates rates;
    lw_message_rates_init(&rates, 0);
    lw_message_rates_trust(&rates, true);
    unsigned count = 1;
    const struct lw_framing_header update = {.type = LW_MESSAGE_UPDATE,
                                             .body_size = LW_FRAMING_CLIENT_BODY_MAX};
    while (!lw_message_rates_count(&rates, update, 0)) count++;
    assert_int_equal(count, 8 * 1048576 / (LW_FRAMING_CLIENT_BODY_MAX + LW_FRAMING_HEADER_SIZE) + 1);
    lw_message_rates_init(&rates, 0);
    const struct lw_framing_header holds = {.type = LW_MESSAGE_HOLDS,
                                            .body_size = LW_FRAMING_CLIENT_BODY_MAX};
    for (count = 1; !lw_message_rates_count(&rates, holds, 0); count++) {
    }
    assert_int_equal(count, 512 + 1);
}

/* A message brings a frame and some bytes of its link's own with it; what there is beyond that is counted. */
static void test_what_is_no_message(void **state) {
    (void)state;
    static const struct {
        enum lw_message_rates_kind kind;
        unsigned at_once, brought;
    } kinds[] = {{LW_MESSAGE_RATES_FRAMES, 1000, 1}, {LW_MESSAGE_RATES_OVERHEAD, 32768, 40}};
    for (size_t k = 0; k < sizeof kinds / sizeof *kinds; k++) {
        struct lw_message_rates rates;
        const enum lw_message_rates_kind kind = kinds[k].kind;
        lw_message_rates_init(&rates, 0);
        assert_false(lw_message_rates_count_other(&rates, kind, kinds[k].at_once, 0));
        assert_false(lw_message_rates_count(&rates, ping, 0));
        assert_false(lw_message_rates_count_other(&rates, kind, kinds[k].brought, 0));
        assert_true(lw_message_rates_count_other(&rates, kind, 1, 0)); /* one past the limit */
        lw_message_rates_init(&rates, 0);
        lw_message_rates_trust(&rates, true);
        assert_false(lw_message_rates_count_other(&rates, kind, 8 * kinds[k].at_once, 0));
        assert_true(lw_message_rates_count_other(&rates, kind, 1, 0));
        lw_message_rates_init(&rates, 0);
        lw_message_rates_bound(&rates, kind, 5);
        assert_false(lw_message_rates_count_other(&rates, kind, 5, 0));
        assert_true(lw_message_rates_count_other(&rates, kind, 1, 0));
    }
}

static void test_judge(void **state) {
    (void)state;
    struct lw_message_rates rates;
    uint64_t now_ns = 0;
    const char *excess = NULL;
    lw_message_rates_init(&rates, now_ns);
    /* a burst every now and then is made good */
    for (int i = 0; i < 100; i++) {
        for (int p = 0; p < 120; p++) (void)!lw_message_rates_count(&rates, ping, now_ns);
        for (int t = 0; t < 40; t++) { /* 10 s: it waits for 3 of them */
            (void)!lw_message_rates_wait(&rates, now_ns += SECOND_NS / 4);
            assert_null(lw_message_rates_judge(&rates, SECOND_NS / 4, LIMIT_S * SECOND_NS));
        }
    }
    /* a session that goes on is refused with the reason, after the time that it may wait */
    int looks = 0;
    for (; !excess && looks < 1000; looks++) {
        while (!lw_message_rates_count(&rates, ping, now_ns)) {
        }
        now_ns += SECOND_NS / 4;
        excess = lw_message_rates_judge(&rates, SECOND_NS / 4, LIMIT_S * SECOND_NS);
    }
    assert_non_null(excess);
    assert_string_equal(excess, "more than 20 PING a second");
    assert_in_range(looks, 4 * LIMIT_S, 4 * LIMIT_S + 2);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_burst_and_rate),
        cmocka_unit_test(test_every_kind),
        cmocka_unit_test(test_bytes),
        cmocka_unit_test(test_trust_and_holds),
        cmocka_unit_test(test_what_is_no_message),
        cmocka_unit_test(test_judge),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
