/* test_message_fields.c: what a decoder refuses of fields written here one by one: lengths, counts, codes. */
#include "tests/support/message_case.h"

#include "common/base/waiting.h"

#include <stdlib.h>
#include <string.h>

/* ---- bodies written by hand: what our own encoder refuses to write ---- */

static void put(struct message_case_body *b, const void *bytes, size_t size) {
    b->bytes = realloc(b->bytes, b->size + size + 1);
    assert_non_null(b->bytes);
    memcpy(b->bytes + b->size, bytes, size);
    b->size += size;
}

static void put_varint(struct message_case_body *b, uint64_t value) {
    do {
        uint8_t byte = (uint8_t)((value & 0x7f) | (value > 0x7f ? 0x80 : 0));
        put(b, &byte, 1);
        value >>= 7;
    } while (value);
}

static void put_number(struct message_case_body *b, unsigned field, uint64_t value) {
    put_varint(b, field << 3);
    put_varint(b, value);
}

static void put_float(struct message_case_body *b, unsigned field, float value) {
    put_varint(b, field << 3 | 5);
    put(b, &value, sizeof value);
}

static void put_list(struct message_case_body *b, unsigned field, const void *bytes, size_t size) {
    put_varint(b, field << 3 | 2);
    put_varint(b, size);
    put(b, bytes, size);
}

/* A list of `count` words of 4 bytes, all of them 0. */
static void put_zeros(struct message_case_body *b, unsigned field, size_t count) {
    void *zeros = calloc(count + 1, 4);
    put_list(b, field, zeros, 4 * count);
    free(zeros);
}

static void test_texts(void **state) {
    (void)state;
    static const struct {
        const char *text;
        bool fine;
    } cases[] = {
        {"plain", true},
        {"\xc2\xa0", true},         /* first after the C1 controls */
        {"\xed\x9f\xbf", true},     /* last before the surrogates */
        {"\xee\x80\x80", true},     /* first after them */
        {"\xf4\x8f\xbf\xbf", true}, /* last of all */
        {"\xf0\x90\x80\x80", true}, /* first of four bytes */
        {"line\nfeed", false},      /* would forge a line of the log */
        {"\x1b[2J", false},         /* would clear the screen */
        {"\x7f", false},
        {"\xe2\x80\xae", false},     /* U+202E: what follows reads backwards */
        {"a\xe2\x80\x8b", false},    /* U+200B: no width */
        {"\xe2\x80\xa8", false},     /* U+2028: a line ends */
        {"\xef\xbb\xbf", false},     /* U+FEFF */
        {"\xf3\xa0\x81\xbf", false}, /* U+E007F */
        {"\xe2\x80\xaf", true},      /* U+202F, the next one: a space */
        {"\xe2\x80\x8a", true},      /* U+200A, the one before */
        {"\xf3\xa0\x84\x80", true},  /* U+E0100 */
        {"\xc2\x9b", false},         /* the same as a C1 control */
        {"\x80", false},
        {"\xc0\xaf", false}, /* overlong */
        {"\xe0\x9f\xbf", false},
        {"\xf0\x8f\xbf\xbf", false},
        {"\xed\xa0\x80", false},     /* surrogate */
        {"\xf4\x90\x80\x80", false}, /* past the last */
        {"\xe2\x82", false},         /* cut off */
        {"\xff", false},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct message_case_body b = {0};
        put_list(&b, 3, cases[i].text, strlen(cases[i].text));
        message_case_expect(LW_MESSAGE_HELLO, &b, cases[i].fine ? NULL : "message HELLO: name is not UTF-8");
    }
    char longest[LW_MESSAGE_TEXT_MAX + 1];
    memset(longest, 'x', sizeof longest);
    for (unsigned over = 0; over < 2; over++) {
        struct message_case_body b = {0};
        put_list(&b, 3, longest, LW_MESSAGE_NAME_MAX + over);
        message_case_expect(LW_MESSAGE_HELLO, &b, over ? "name is over 64 bytes" : NULL);
        put_number(&b, 1, 1);
        put_list(&b, 2, longest, LW_MESSAGE_TEXT_MAX + over);
        message_case_expect(LW_MESSAGE_REFUSAL, &b, over ? "text is over 256 bytes" : NULL);
    }
}

static void put_welcome(struct message_case_body *b, size_t hash_size, uint64_t size,
                        uint64_t compressed_size, float target_error) {
    static const uint8_t hash[17];
    put_list(b, 5, hash, hash_size);
    put_number(b, 6, size);
    put_number(b, 7, compressed_size);
    put_float(b, 9, target_error);
}

static void test_welcome(void **state) {
    (void)state;
    struct message_case_body b = {0};
    put_welcome(&b, 16, LW_PACKAGE_SIZE_MAX, LW_MESSAGE_COMPRESSED_MAX, 0);
    put_number(&b, 8, LW_MESSAGE_BOUNCES_MAX);
    message_case_expect(LW_MESSAGE_WELCOME, &b, NULL);
    put_welcome(&b, 15, 1, 1, 0);
    message_case_expect(LW_MESSAGE_WELCOME, &b, "package_hash is not 16 bytes");
    put_welcome(&b, 17, 1, 1, 0);
    message_case_expect(LW_MESSAGE_WELCOME, &b, "package_hash is not 16 bytes");
    put_welcome(&b, 16, LW_PACKAGE_SIZE_MAX + 1, 1, 0);
    message_case_expect(LW_MESSAGE_WELCOME, &b, "package_size");
    put_welcome(&b, 16, 0, 1, 0);
    message_case_expect(LW_MESSAGE_WELCOME, &b, "package_size");
    put_welcome(&b, 16, 1, LW_MESSAGE_COMPRESSED_MAX + 1, 0);
    message_case_expect(LW_MESSAGE_WELCOME, &b, "package_compressed_size");
    put_welcome(&b, 16, 1, 0, 0);
    message_case_expect(LW_MESSAGE_WELCOME, &b, "package_compressed_size");
    put_welcome(&b, 16, 1, 1, -1);
    message_case_expect(LW_MESSAGE_WELCOME, &b, "target_error");
    put_welcome(&b, 16, 1, 1, NAN);
    message_case_expect(LW_MESSAGE_WELCOME, &b, "target_error");
    for (int i = 0; i < 3; i++) {
        put_welcome(&b, 16, 1, 1, 0);
        put_float(&b, 14, (const float[]){-0.1f, 1.1f, NAN}[i]);
        message_case_expect(LW_MESSAGE_WELCOME, &b, "noise_shown is not from 0 to 1");
    }
    put_welcome(&b, 16, 1, 1, 0);
    put_number(&b, 8, LW_MESSAGE_BOUNCES_MAX + 1);
    message_case_expect(LW_MESSAGE_WELCOME, &b, "bounces is over 64");
    for (size_t over = 0; over < 2; over++) { /* one bit for each that a scene may have */
        static const uint8_t bits[LW_SCENE_LIGHTS_MAX / 8 + 1];
        put_welcome(&b, 16, 1, 1, 0);
        put_list(&b, 15, bits, LW_SCENE_LIGHTS_MAX / 8 + over);
        message_case_expect(LW_MESSAGE_WELCOME, &b, over ? "client_lights is over 131072 bytes" : NULL);
        put_welcome(&b, 16, 1, 1, 0);
        put_list(&b, 16, bits, LW_SCENE_MATERIALS_MAX / 8 + over);
        message_case_expect(LW_MESSAGE_WELCOME, &b, over ? "client_materials is over 8192 bytes" : NULL);
    }
}

static void test_refusal_code(void **state) {
    (void)state;
    struct message_case_body b = {0};
    message_case_expect(LW_MESSAGE_REFUSAL, &b, "code is not in 1..65535");
    put_number(&b, 1, LW_MESSAGE_REFUSAL_MAX);
    message_case_expect(LW_MESSAGE_REFUSAL, &b, NULL);
    put_number(&b, 1, LW_MESSAGE_REFUSAL_MAX + 1);
    message_case_expect(LW_MESSAGE_REFUSAL, &b, "code is not in 1..65535");
    put_number(&b, 1, UINT32_MAX);
    message_case_expect(LW_MESSAGE_REFUSAL, &b, "code is not in 1..65535");
}

static void test_package(void **state) {
    (void)state;
    struct message_case_body b = {0};
    put_number(&b, 1, LW_MESSAGE_COMPRESSED_MAX + 1);
    message_case_expect(LW_MESSAGE_PACKAGE_REQUEST, &b, "offset is past the limit");
    message_case_expect(LW_MESSAGE_PACKAGE_CHUNK, &b, "data is not 1..262144 bytes");
    put_zeros(&b, 2, LW_MESSAGE_CHUNK_MAX / 4);
    message_case_expect(LW_MESSAGE_PACKAGE_CHUNK, &b, NULL);
    put_zeros(&b, 2, LW_MESSAGE_CHUNK_MAX / 4 + 1);
    message_case_expect(LW_MESSAGE_PACKAGE_CHUNK, &b, "data is not 1..262144 bytes");
    put_number(&b, 1, LW_MESSAGE_COMPRESSED_MAX - 4);
    put_zeros(&b, 2, 1);
    message_case_expect(LW_MESSAGE_PACKAGE_CHUNK, &b, NULL);
    put_number(&b, 1, LW_MESSAGE_COMPRESSED_MAX - 3);
    put_zeros(&b, 2, 1);
    message_case_expect(LW_MESSAGE_PACKAGE_CHUNK, &b, "offset is past the limit");
    put_number(&b, 1, UINT64_MAX);
    put_zeros(&b, 2, 1);
    message_case_expect(LW_MESSAGE_PACKAGE_CHUNK, &b, "offset is past the limit");
}

static void test_interest(void **state) {
    (void)state;
    struct message_case_body b = {0};
    for (size_t over = 0; over < 2; over++) {
        for (unsigned field = 2; field <= 4; field++) put_zeros(&b, field, LW_MESSAGE_INTEREST_MAX + over);
        assert_true(b.size <= LW_FRAMING_CLIENT_BODY_MAX);
        message_case_expect(LW_MESSAGE_INTEREST, &b, over ? "tile has over 4096 entries" : NULL);
    }
    for (unsigned longer = 2; longer <= 4; longer++) {
        for (unsigned field = 2; field <= 4; field++) put_zeros(&b, field, field == longer ? 3 : 2);
        message_case_expect(LW_MESSAGE_INTEREST, &b, "differ in length");
    }
    put_number(&b, 1, 1);
    for (unsigned field = 2; field <= 4; field++) put_zeros(&b, field, 1);
    message_case_expect(LW_MESSAGE_INTEREST, &b, "everything");
    put_list(&b, 2, "abcde", 5); /* no whole number of words */
    message_case_expect(LW_MESSAGE_INTEREST, &b, "does not decode");
}

static void test_holds(void **state) {
    (void)state;
    struct message_case_body b = {0};
    for (size_t over = 0; over < 2; over++) {
        for (unsigned field = 1; field <= 4; field++)
            put_zeros(&b, field, (field == 4 ? 2 : 1) * (LW_MESSAGE_HOLDS_MAX + over));
        assert_true(b.size <= LW_FRAMING_CLIENT_BODY_MAX);
        message_case_expect(LW_MESSAGE_HOLDS, &b, over ? "tile has over 2048 entries" : NULL);
    }
    for (unsigned longer = 1; longer <= 4; longer++) {
        for (unsigned field = 1; field <= 4; field++)
            put_zeros(&b, field, (field == 4 ? 2 : 1) * (field == longer ? 3 : 2));
        message_case_expect(LW_MESSAGE_HOLDS, &b, "differ in length");
    }
}

static void put_frame(struct message_case_body *b, size_t transform_count, size_t transform_floats,
                      size_t light_count, const size_t light_floats[3]) {
    put_number(b, 1, 1);
    put_zeros(b, 6, 3);
    put_zeros(b, 7, transform_count);
    put_zeros(b, 8, transform_floats);
    put_zeros(b, 9, light_count);
    for (unsigned i = 0; i < 3; i++) put_zeros(b, 10 + i, light_floats[i]);
}

static void test_frame_counts(void **state) {
    (void)state;
    const size_t none[3] = {0, 0, 0}, T = LW_MESSAGE_TRANSFORMS_MAX, L = LW_MESSAGE_LIGHTS_MAX;
    struct message_case_body b = {0};
    put_frame(&b, T, 12 * T, L, (size_t[3]){3 * L, 3 * L, 3 * L});
    assert_true(b.size <= LW_FRAMING_BODY_MAX);
    message_case_expect(LW_MESSAGE_FRAME, &b, NULL);
    put_frame(&b, T + 1, 12 * (T + 1), 0, none);
    message_case_expect(LW_MESSAGE_FRAME, &b, "transform_object has over 8192 entries");
    put_frame(&b, 0, 0, L + 1, (size_t[3]){3 * (L + 1), 3 * (L + 1), 3 * (L + 1)});
    message_case_expect(LW_MESSAGE_FRAME, &b, "light has over 8192 entries");
    put_frame(&b, 2, 23, 0, none);
    message_case_expect(LW_MESSAGE_FRAME, &b, "12 values");
    put_frame(&b, 2, 25, 0, none);
    message_case_expect(LW_MESSAGE_FRAME, &b, "12 values");
    for (int longer = 0; longer < 3; longer++) {
        size_t floats[3] = {6, 6, 6};
        floats[longer]++;
        put_frame(&b, 0, 0, 2, floats);
        message_case_expect(LW_MESSAGE_FRAME, &b, "3 values for each light");
    }
    for (size_t sky = 0; sky < 5; sky++) {
        put_number(&b, 1, 1);
        put_zeros(&b, 6, sky);
        message_case_expect(LW_MESSAGE_FRAME, &b, sky == 3 ? NULL : "sky is not 3 values");
    }
}

static void put_frame_state(struct message_case_body *b, size_t hidden, size_t shown, size_t materials_count,
                            size_t base_colours, size_t emissions) {
    put_number(b, 1, 1);
    put_zeros(b, 6, 3);
    put_zeros(b, 14, hidden);
    put_zeros(b, 15, shown);
    put_zeros(b, 16, materials_count);
    put_zeros(b, 17, base_colours);
    put_zeros(b, 18, emissions);
}

static void test_frame_state_counts(void **state) {
    (void)state;
    const size_t V = LW_MESSAGE_VISIBLE_MAX, M = LW_MESSAGE_MATERIALS_MAX, T = LW_MESSAGE_TRANSFORMS_MAX,
                 L = LW_MESSAGE_LIGHTS_MAX;
    struct message_case_body b = {0};
    put_frame(&b, T, 12 * T, L, (size_t[3]){3 * L, 3 * L, 3 * L});
    put_zeros(&b, 14, V);
    put_zeros(&b, 15, V);
    put_zeros(&b, 16, M);
    put_zeros(&b, 17, 3 * M);
    put_zeros(&b, 18, 3 * M);
    assert_true(b.size <= LW_FRAMING_BODY_MAX); /* everything that may be in one, at its limit */
    message_case_expect(LW_MESSAGE_FRAME, &b, NULL);
    put_frame_state(&b, V + 1, 0, 0, 0, 0);
    message_case_expect(LW_MESSAGE_FRAME, &b, "hidden_object has over 8192 entries");
    put_frame_state(&b, 0, V + 1, 0, 0, 0);
    message_case_expect(LW_MESSAGE_FRAME, &b, "shown_object has over 8192 entries");
    put_frame_state(&b, 0, 0, M + 1, 3 * (M + 1), 3 * (M + 1));
    message_case_expect(LW_MESSAGE_FRAME, &b, "material has over 4096 entries");
    put_frame_state(&b, 0, 0, 2, 7, 6);
    message_case_expect(LW_MESSAGE_FRAME, &b, "3 values for each material");
    put_frame_state(&b, 0, 0, 2, 6, 5);
    message_case_expect(LW_MESSAGE_FRAME, &b, "3 values for each material");
    for (size_t spares = 0; spares < 4; spares++) {
        put_frame_state(&b, 2, 3, 0, 0, 0);
        put_number(&b, 19, spares);
        message_case_expect(LW_MESSAGE_FRAME, &b,
                            spares > 2 ? "spares is over the length of hidden_object" : NULL);
    }
    put_frame_state(&b, V, 0, 0, 0, 0);
    put_number(&b, 19, UINT32_MAX);
    message_case_expect(LW_MESSAGE_FRAME, &b, "spares is over the length");
}

/* `counts` changes of `each` values, and `values` values. */
static void put_update(struct message_case_body *b, size_t kinds, size_t targets, size_t counts,
                       uint32_t each, size_t values) {
    uint32_t *count = calloc(counts + 1, sizeof *count);
    for (size_t i = 0; i < counts; i++) count[i] = each;
    put_zeros(b, 2, kinds);
    put_zeros(b, 3, targets);
    put_list(b, 4, count, counts * sizeof *count);
    put_zeros(b, 5, values);
    free(count);
}

static void test_update_counts(void **state) {
    (void)state;
    const size_t C = LW_MESSAGE_CHANGES_MAX, V = LW_SCENE_CHANGE_VALUES_MAX;
    struct message_case_body b = {0};
    put_update(&b, C, C, C, V, C * V);
    put_number(&b, 1, UINT64_MAX);
    assert_true(b.size <= LW_FRAMING_CLIENT_BODY_MAX); /* the largest that a client may send */
    message_case_expect(LW_MESSAGE_UPDATE, &b, NULL);
    put_update(&b, C + 1, C + 1, C + 1, 0, 0);
    message_case_expect(LW_MESSAGE_UPDATE, &b, "kind has over 1024 entries");
    put_update(&b, 1, 1, 1, V + 1, V + 1);
    message_case_expect(LW_MESSAGE_UPDATE, &b, "value_count is over 12");
    put_update(&b, 1, 1, 1, UINT32_MAX, V);
    message_case_expect(LW_MESSAGE_UPDATE, &b, "value_count is over 12");
    put_update(&b, 2, 2, 2, 3, 5);
    message_case_expect(LW_MESSAGE_UPDATE, &b, "value is shorter");
    put_update(&b, 2, 2, 2, 3, 7);
    message_case_expect(LW_MESSAGE_UPDATE, &b, "value is longer");
    for (int i = 0; i < 3; i++) {
        put_update(&b, 2 + (i == 0), 2 + (i == 1), 2 + (i == 2), 0, 0);
        message_case_expect(LW_MESSAGE_UPDATE, &b, "differ in length");
    }
}

static void test_updated_text(void **state) {
    (void)state;
    char text[LW_MESSAGE_TEXT_MAX + 1];
    memset(text, 'x', sizeof text);
    for (unsigned over = 0; over < 2; over++) {
        struct message_case_body b = {0};
        put_list(&b, 4, text, LW_MESSAGE_TEXT_MAX + over);
        message_case_expect(LW_MESSAGE_UPDATED, &b, over ? "text is over 256 bytes" : NULL);
        put_zeros(&b, 6, LW_MESSAGE_CHANGES_MAX + over);
        message_case_expect(LW_MESSAGE_UPDATED, &b, over ? "added has over 1024 entries" : NULL);
    }
    struct message_case_body b = {0};
    put_number(&b, 2, LW_SCENE_CHANGE_NO_SPARE);
    put_zeros(&b, 6, 1);
    message_case_expect(LW_MESSAGE_UPDATED, &b, "added has entries though it is refused");
}

static void test_fields(void **state) {
    (void)state;
    struct message_case_body b = {0};
    for (unsigned over = 0; over < 2;
         over++) { /* unknown fields of every wire type are ignored, up to a count */
        put_number(&b, 1, 5);
        for (unsigned i = 1; i < LW_MESSAGE_FIELDS_MAX + over; i++) switch (i % 4) {
            case 0:
                put_number(&b, 1000 + i, UINT64_MAX);
                break;
            case 1:
                put_float(&b, 1000 + i, NAN);
                break;
            case 2:
                put_list(&b, 1000 + i, "abc", 3);
                break;
            default:
                put_varint(&b, (1000 + i) << 3 | 1);
                put(&b, "12345678", 8);
            }
        message_case_expect(LW_MESSAGE_ACK, &b, over ? "has over 64 fields" : NULL);
    }
    put_float(&b, 1, 1);
    message_case_expect(LW_MESSAGE_ACK, &b, "wrong type");
    for (unsigned group = 3; group < 8;
         group++) { /* groups are gone, 6 and 7 never were; 5 lacks its 4 bytes */
        put_varint(&b, 2 << 3 | group);
        message_case_expect(LW_MESSAGE_ACK, &b, "is no protobuf");
    }
    put_varint(&b, 2 << 3 | 2);
    put_varint(&b, UINT64_MAX);
    message_case_expect(LW_MESSAGE_ACK, &b, "is no protobuf");
    put(&b, "\x08\x80\x80\x80\x80\x80\x80\x80\x80\x80\x80\x01", 12); /* a varint of 11 bytes */
    message_case_expect(LW_MESSAGE_ACK, &b, "is no protobuf");
}

static void test_waiting(void **state) {
    (void)state;
    const float bad[] = {NAN, INFINITY, -0.01f, 1.01f};
    struct lw_message m = {.type = LW_MESSAGE_WAITING, .waiting = {LW_WAITING_FIRST_LIGHT, 0}};
    lw_support_ok(lw_message_validate(&m, NULL), NULL);
    for (int i = 0; i < 4; i++) {
        m.waiting.share = bad[i];
        message_case_expect_invalid(&m, "share is not from 0 to 1");
    }
    m.waiting.share = 1;
    m.waiting.stage = LW_WAITING_UNKNOWN;
    message_case_expect_invalid(&m, "stage is not in 1..65535");
    m.waiting.stage = LW_MESSAGE_WAITING_STAGE_MAX + 1;
    message_case_expect_invalid(&m, "stage is not in 1..65535");
}

/* A welcome with the most parts of both packages, and the most bits of client lights, fits a body. */
static void test_parts_of_finishes(void **state) {
    (void)state;
    static uint64_t ones[LW_MESSAGE_PARTS_MAX];
    static struct lw_package_hash hash[LW_MESSAGE_PARTS_MAX];
    static uint8_t bits[LW_MESSAGE_CLIENT_LIGHTS_MAX];
    for (size_t i = 0; i < LW_MESSAGE_PARTS_MAX; i++) ones[i] = 1;
    struct lw_message m = {.type = LW_MESSAGE_WELCOME,
                           .welcome = {.version = 1,
                                       .package_size = LW_MESSAGE_PARTS_MAX,
                                       .package_compressed_size = LW_MESSAGE_PARTS_MAX,
                                       .part_size = ones,
                                       .part_compressed_size = ones,
                                       .part_hash = hash,
                                       .part_count = LW_MESSAGE_PARTS_MAX,
                                       .client_lights = bits,
                                       .client_lights_size = sizeof bits,
                                       .client_materials = bits,
                                       .client_materials_size = LW_MESSAGE_CLIENT_MATERIALS_MAX,
                                       .finish = {.size = LW_MESSAGE_FINISH_PARTS_MAX,
                                                  .compressed_size = LW_MESSAGE_FINISH_PARTS_MAX,
                                                  .part_size = ones,
                                                  .part_compressed_size = ones,
                                                  .part_hash = hash,
                                                  .part_count = LW_MESSAGE_FINISH_PARTS_MAX}}};
    uint8_t *bytes;
    size_t size;
    struct lw_error err = {0};
    lw_support_ok(lw_message_encode_alloc(&m, &bytes, &size), NULL);
    struct lw_message read;
    lw_support_ok(lw_message_decode_whole(bytes, size, &read), NULL);
    message_case_expect_equal(&m, &read);
    lw_message_finish(&read);
    free(bytes);
    m.welcome.finish.part_count++;
    m.welcome.finish.size++;
    m.welcome.finish.compressed_size++;
    lw_support_fails(lw_message_validate(&m, &err), LW_PROTOCOL, &err,
                     "finish_part_size has over 8192 entries");
}

static void test_unknown_type(void **state) {
    (void)state;
    const uint16_t types[] = {0, LW_MESSAGE_FINISH_CHUNK + 1, UINT16_MAX};
    for (int i = 0; i < 3; i++) {
        struct lw_message m;
        struct lw_error err = {0};
        assert_null(lw_message_name(types[i]));
        enum lw_status status =
            lw_message_decode((struct lw_framing_header){.type = types[i]}, NULL, &m, &err);
        lw_support_fails(status, LW_PROTOCOL, &err, "unknown");
        m = (struct lw_message){.type = (enum lw_message_type)types[i]};
        err = (struct lw_error){0};
        lw_support_fails(lw_message_validate(&m, &err), LW_PROTOCOL, &err, "unknown");
    }
    for (uint16_t type = LW_MESSAGE_HELLO; type <= LW_MESSAGE_FINISH_CHUNK; type++)
        assert_non_null(lw_message_name(type));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_texts),
        cmocka_unit_test(test_waiting),
        cmocka_unit_test(test_welcome),
        cmocka_unit_test(test_refusal_code),
        cmocka_unit_test(test_package),
        cmocka_unit_test(test_interest),
        cmocka_unit_test(test_frame_counts),
        cmocka_unit_test(test_fields),
        cmocka_unit_test(test_unknown_type),
        cmocka_unit_test(test_parts_of_finishes),
        cmocka_unit_test(test_frame_state_counts),
        cmocka_unit_test(test_update_counts),
        cmocka_unit_test(test_updated_text),
        cmocka_unit_test(test_holds),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
