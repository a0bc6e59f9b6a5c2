/* Addresses, subjects and payloads of NATS. */
#include "tests/support/support.h"

#include "proto/nats_wire.h"

#include <stdlib.h>
#include <string.h>

static void addresses(void **state) {
    (void)state;
    struct lw_nats_wire_address a;
    lw_support_ok(lw_nats_wire_address("nats://10.0.0.3:4222/atrium", &a, NULL), NULL);
    assert_string_equal(a.url, "nats://10.0.0.3:4222");
    assert_string_equal(a.name, "nats://10.0.0.3:4222/atrium");
    assert_string_equal(a.scene, "atrium");
    assert_string_equal(a.host, "10.0.0.3");
    assert_false(a.tls);
    lw_support_ok(lw_nats_wire_address("tls://user:secret@[2001:db8::1]:4222/a", &a, NULL), NULL);
    assert_string_equal(a.host, "2001:db8::1");
    assert_true(a.tls);
    lw_support_ok(lw_nats_wire_address("tls://host", &a, NULL), NULL);
    assert_string_equal(a.host, "host");
    assert_string_equal(a.url, "tls://host");
    assert_string_equal(a.scene, "scene");
    lw_support_ok(lw_nats_wire_address("nats://host/", &a, NULL), NULL);
    assert_string_equal(a.name, "nats://host/scene");
    /* a name has no password */
    lw_support_ok(lw_nats_wire_address("nats://user:secret@host:1/a-b_C9", &a, NULL), NULL);
    assert_string_equal(a.url, "nats://user:secret@host:1");
    assert_string_equal(a.name, "nats://host:1/a-b_C9");
    assert_true(lw_nats_wire_is_address("tls://x") && !lw_nats_wire_is_address("unix:/nats://"));
    char longest[400] = "nats://host/";
    memset(longest + strlen(longest), 'a', LW_NATS_WIRE_SCENE_MAX);
    lw_support_ok(lw_nats_wire_address(longest, &a, NULL), NULL);
    longest[strlen(longest)] = 'a'; /* one more */
    static const char *const bad[] = {"nats://",         "nats:///a",         "host:4222/a",
                                      "nats://host/a.b", "nats://host/*",     "nats://host/a/b",
                                      "nats://h ost",    "nats://host,other", "nats://user:sec/ret@host/a",
                                      "nats://:4222/a",  "nats://user@/a",    "tls://[::1:4222/a",
                                      "tls://[]:1/a"};
    for (size_t i = 0; i <= sizeof bad / sizeof *bad; i++) {
        struct lw_error err = {0};
        lw_support_fails(lw_nats_wire_address(i ? bad[i - 1] : longest, &a, &err), LW_USAGE, &err, "address");
    }
}

static void subjects(void **state) {
    (void)state;
    char subject[LW_NATS_WIRE_SUBJECT_SIZE], scene[LW_NATS_WIRE_SCENE_MAX + 1] = {0};
    lw_nats_wire_subject(subject, "atrium", "live.%u.%u.%u", 0u, 7u, 2u);
    assert_string_equal(subject, "lightwell.atrium.live.0.7.2");
    memset(scene, 'a', LW_NATS_WIRE_SCENE_MAX);
    lw_nats_wire_subject(subject, scene, "kept.%u.%u.%u.%u", UINT32_MAX, UINT32_MAX, UINT32_MAX, UINT32_MAX);
}

/* One irradiance, and channels that follow it; nothing else. */
static void forms_of_channels(void **state) {
    (void)state;
    const uint32_t full = 1u << LW_TILE_CHANNEL_FULL, split = 1u << LW_TILE_CHANNEL_SPLIT,
                   direction = 1u << LW_TILE_CHANNEL_DIRECTION,
                   direction_split = 1u << LW_TILE_CHANNEL_DIRECTION_SPLIT;
    assert_int_equal(lw_nats_wire_irradiance(full), LW_TILE_CHANNEL_FULL);
    assert_int_equal(lw_nats_wire_irradiance(split), LW_TILE_CHANNEL_SPLIT);
    assert_int_equal(lw_nats_wire_irradiance(full | direction), LW_TILE_CHANNEL_FULL);
    assert_int_equal(lw_nats_wire_irradiance(split | direction_split), LW_TILE_CHANNEL_SPLIT);
    const uint32_t bad[] = {0,
                            direction,
                            full | split,
                            full | direction_split,
                            split | direction | direction_split,
                            full | 1u << lw_tile_channels()->count,
                            UINT32_MAX};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
        assert_int_equal(lw_nats_wire_irradiance(bad[i]), UINT32_MAX);
}

/* A prefix and two messages; cut off at each byte it gives a status. */
static void payloads(void **state) {
    (void)state;
    const struct lw_message settled = {.type = LW_MESSAGE_SETTLED, .settled.frame = 300},
                            holds = {.type = LW_MESSAGE_HOLDS,
                                     .holds = {&(struct lw_message_held){1, 2, 3, 4}, 1, 0}};
    uint8_t bytes[200];
    size_t size = LW_NATS_WIRE_PREFIX_SIZE, written;
    lw_nats_wire_write_prefix(bytes, (struct lw_nats_wire_prefix){7, 0x0123456789abcdef});
    static const uint8_t expected[] = {'L',  'W',  'N',  '1',  7,    0,    0,    0,
                                       0xef, 0xcd, 0xab, 0x89, 0x67, 0x45, 0x23, 0x01};
    assert_memory_equal(bytes, expected, sizeof expected);
    lw_support_ok(lw_message_encode(&settled, bytes + size, sizeof bytes - size, &written), NULL);
    const size_t first = size += written;
    lw_support_ok(lw_message_encode(&holds, bytes + size, sizeof bytes - size, &written), NULL);
    size += written;
    for (size_t cut = 0; cut <= size; cut++) {
        uint8_t *copy = malloc(cut + 1); /* a sanitizer sees reads beyond the end */
        struct lw_nats_wire_prefix prefix;
        struct lw_nats_wire_reader reader;
        struct lw_message m;
        const uint8_t *raw = NULL;
        size_t raw_size;
        memcpy(copy, bytes, cut);
        enum lw_status status = lw_nats_wire_read_prefix(copy, cut, &prefix, &reader);
        assert_int_equal(status, cut < LW_NATS_WIRE_PREFIX_SIZE ? LW_PROTOCOL : LW_OK);
        size_t read = 0;
        while (status == LW_OK && (status = lw_nats_wire_read(&reader, &m, &raw, &raw_size)) == LW_OK &&
               raw) {
            assert_int_equal(m.type, read ? LW_MESSAGE_HOLDS : LW_MESSAGE_SETTLED);
            lw_message_finish(&m);
            read++;
        }
        const bool is_whole = cut == LW_NATS_WIRE_PREFIX_SIZE || cut == first || cut == size;
        assert_int_equal(status, is_whole ? LW_OK : LW_PROTOCOL);
        assert_int_equal(read, cut < first ? 0 : cut < size ? 1 : 2);
        free(copy);
    }
    bytes[3] = '2';
    struct lw_nats_wire_prefix prefix;
    struct lw_nats_wire_reader reader;
    assert_int_equal(lw_nats_wire_read_prefix(bytes, size, &prefix, &reader), LW_PROTOCOL);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(addresses),
        cmocka_unit_test(subjects),
        cmocka_unit_test(forms_of_channels),
        cmocka_unit_test(payloads),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
