#include "tests/support/support.h"

#include "server/serve/admission/address_rates.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <stdio.h>
#include <string.h>

static struct lw_address address(const char *text) {
    struct sockaddr_in v4 = {.sin_family = AF_INET, .sin_port = 5};
    struct sockaddr_in6 v6 = {.sin6_family = AF_INET6, .sin6_port = 5};
    if (inet_pton(AF_INET, text, &v4.sin_addr) == 1) return lw_address_of((struct sockaddr *)&v4);
    assert_int_equal(inet_pton(AF_INET6, text, &v6.sin6_addr), 1);
    return lw_address_of((struct sockaddr *)&v6);
}

static bool same(const char *a, const char *b) {
    const struct lw_address of_a = address(a), of_b = address(b);
    if (lw_address_equals(&of_a, &of_b))
        assert_int_equal(lw_address_hash(&of_a, 7), lw_address_hash(&of_b, 7));
    return lw_address_equals(&of_a, &of_b);
}

static void test_who_is_one(void **state) {
    (void)state;
    assert_true(same("10.0.0.1", "10.0.0.1"));
    assert_false(same("10.0.0.1", "10.0.0.2"));
    assert_true(same("10.0.0.1", "::ffff:10.0.0.1"));
    assert_false(same("::ffff:10.0.0.1", "::ffff:10.0.0.2"));
    assert_true(same("2001:db8:1:2::5", "2001:db8:1:2:3:4:5:6"));
    assert_false(same("2001:db8:1:2::5", "2001:db8:1:3::5"));
    assert_false(same("::1", "::2"));
    static const char *const own[] = {"127.0.0.1", "127.200.1.2", "::1", "::ffff:127.0.0.1"},
                             *const others[] = {"128.0.0.1", "10.127.0.1", "::2", "::ffff:10.0.0.1",
                                                "fe80::1"};
    for (size_t i = 0; i < sizeof own / sizeof *own; i++) assert_true(address(own[i]).is_loopback);
    for (size_t i = 0; i < sizeof others / sizeof *others; i++) assert_false(address(others[i]).is_loopback);
}

static void test_places(void **state) {
    (void)state;
    struct lw_address_places places = {.seed = 5};
    const struct lw_address a = address("10.0.0.1"), b = address("10.0.0.2");
    for (int i = 0; i < 3; i++) assert_int_equal(lw_address_places_take(&places, &a, 3), LW_OK);
    assert_int_equal(lw_address_places_take(&places, &a, 3), LW_UNAVAILABLE);
    assert_int_equal(lw_address_places_take(&places, &b, 3), LW_OK);
    lw_address_places_give(&places, &a);
    assert_int_equal(lw_address_places_take(&places, &a, 3), LW_OK);
    assert_int_equal(lw_address_places_take(&places, &a, 3), LW_UNAVAILABLE);
    for (int i = 0; i < 3; i++) lw_address_places_give(&places, &a);
    /* many, some of which share a bucket; an address without places leaves nothing */
    for (unsigned i = 0; i < 5000; i++) {
        char text[32];
        snprintf(text, sizeof text, "10.1.%u.%u", i / 250, i % 250);
        const struct lw_address one = address(text);
        assert_int_equal(lw_address_places_take(&places, &one, 1), LW_OK);
        assert_int_equal(lw_address_places_take(&places, &one, 1), LW_UNAVAILABLE);
        if (i % 2) lw_address_places_give(&places, &one);
    }
    lw_address_places_give(&places, &b);
    lw_address_places_finish(&places);
}

static void test_shares(void **state) {
    (void)state;
    const struct lw_address own = address("127.0.0.1"), other = address("10.0.0.1");
    assert_int_equal(lw_address_places_share(&own, 10000), 9000);
    assert_int_equal(lw_address_places_share(&other, 10000), 1000);
    assert_int_equal(lw_address_places_share(&own, 3), 3);
    assert_int_equal(lw_address_places_share(&other, 3), 1);
}

static void test_rates(void **state) {
    (void)state;
    static struct lw_address_rates rates = {.seed = 5};
    const struct lw_address a = address("10.0.0.1"), b = address("10.0.0.2");
    const uint64_t second_ns = 1000000000;
    uint64_t now_ns = 7 * second_ns;
    for (int i = 0; i < 100; i++) assert_true(lw_address_rates_allow(&rates, &a, 5, 100, now_ns));
    assert_false(lw_address_rates_allow(&rates, &a, 5, 100, now_ns));
    assert_true(lw_address_rates_allow(&rates, &b, 5, 100, now_ns));
    assert_false(lw_address_rates_allow(&rates, &a, 5, 100, now_ns += second_ns / 5 - 1000));
    assert_true(lw_address_rates_allow(&rates, &a, 5, 100, now_ns += 2000));
    for (int i = 0; i < 100; i++) /* a refusal uses no place */
        assert_true(lw_address_rates_allow(&rates, &a, 5, 100, now_ns += second_ns / 5 + 1000));
    /* more addresses than slots, each of which is new */
    for (unsigned i = 0; i < 2 * LW_ADDRESS_RATES_SLOTS; i++) {
        char text[32];
        snprintf(text, sizeof text, "10.1.%u.%u", i / 250, i % 250);
        const struct lw_address one = address(text);
        assert_true(lw_address_rates_allow(&rates, &one, 5, 1, now_ns));
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_who_is_one),
        cmocka_unit_test(test_places),
        cmocka_unit_test(test_shares),
        cmocka_unit_test(test_rates),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
