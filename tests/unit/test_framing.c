#include "tests/support/support.h"

#include "proto/framing.h"

#include <string.h>

static void test_bytes(void **state) {
    (void)state;
    uint8_t bytes[LW_FRAMING_HEADER_SIZE];
    lw_framing_write_header(
        bytes, (struct lw_framing_header){.body_size = 0x04030201, .type = 0x0605, .flags = 0x0807});
    const uint8_t expected[] = {1, 2, 3, 4, 5, 6, 7, 8};
    assert_memory_equal(bytes, expected, sizeof expected);
}

static void test_round_trip(void **state) {
    (void)state;
    const struct lw_framing_header header = {.body_size = 0xabcdef, .type = 0xfedc};
    uint8_t bytes[LW_FRAMING_HEADER_SIZE];
    struct lw_framing_header back;
    lw_framing_write_header(bytes, header);
    lw_support_ok(lw_framing_read_header(bytes, UINT32_MAX, &back, NULL), NULL);
    assert_int_equal(back.body_size, header.body_size);
    assert_int_equal(back.type, header.type); /* an unknown type is the caller's business */
    assert_int_equal(back.flags, 0);
}

static void test_body_limit(void **state) {
    (void)state;
    const uint32_t limits[] = {0, LW_FRAMING_CLIENT_BODY_MAX, LW_FRAMING_BODY_MAX};
    for (size_t i = 0; i < sizeof limits / sizeof *limits; i++) {
        uint8_t bytes[LW_FRAMING_HEADER_SIZE];
        struct lw_framing_header header = {.body_size = limits[i], .type = 1}, back = {0};
        struct lw_error err = {0};
        lw_framing_write_header(bytes, header);
        lw_support_ok(lw_framing_read_header(bytes, limits[i], &back, &err), &err);
        assert_int_equal(back.body_size, limits[i]);
        back.body_size = 77;
        header.body_size++;
        lw_framing_write_header(bytes, header);
        lw_support_fails(lw_framing_read_header(bytes, limits[i], &back, &err), LW_PROTOCOL, &err,
                         "over the limit");
        assert_int_equal(back.body_size, 77); /* outputs are untouched on failure */
    }
}

static void test_flags(void **state) {
    (void)state;
    for (unsigned bit = 0; bit < 16; bit++) {
        uint8_t bytes[LW_FRAMING_HEADER_SIZE];
        struct lw_framing_header back;
        struct lw_error err = {0};
        lw_framing_write_header(bytes, (struct lw_framing_header){.type = 1, .flags = (uint16_t)(1u << bit)});
        lw_support_fails(lw_framing_read_header(bytes, 100, &back, &err), LW_PROTOCOL, &err, "flags");
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_bytes),
        cmocka_unit_test(test_round_trip),
        cmocka_unit_test(test_body_limit),
        cmocka_unit_test(test_flags),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
