#include "tests/support/support.h"

#include "common/base/host_port.h"

static void names_and_ipv4_stand_as_they_are(void **state) {
    (void)state;
    char text[32];
    lw_host_port_format(text, sizeof text, "light.example", 4711);
    assert_string_equal(text, "light.example:4711");
    lw_host_port_format(text, sizeof text, "127.0.0.1", 65535);
    assert_string_equal(text, "127.0.0.1:65535");
}

static void ipv6_has_brackets(void **state) {
    (void)state;
    char text[32];
    lw_host_port_format(text, sizeof text, "::1", 80);
    assert_string_equal(text, "[::1]:80");
}

static void a_long_host_is_cut_within_the_buffer(void **state) {
    (void)state;
    char text[8] = "zzzzzzz";
    lw_host_port_format(text, 6, "light.example", 4711);
    assert_string_equal(text, "light");
    assert_int_equal(text[6], 'z');
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(names_and_ipv4_stand_as_they_are),
        cmocka_unit_test(ipv6_has_brackets),
        cmocka_unit_test(a_long_host_is_cut_within_the_buffer),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
