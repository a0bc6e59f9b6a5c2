/* test_message.c: a message of every type comes back from its bytes; bytes that are cut off or flipped
 * are refused or sound. */
#include "tests/support/failing_memory.h"
#include "tests/support/message_case.h"

#include "common/base/waiting.h"

#include <float.h>
#include <stdlib.h>
#include <string.h>

#define FAR 0x123456789abcdef0u

/* ---- one good message of every type ---- */

static const uint8_t bytes_of_data[] = {0, 1, 2, 3, 254, 255};
static const struct lw_message_interest_tile interest_tiles[] = {{1, 2, 3}, {UINT32_MAX, 0, 7}};
static const struct lw_message_held held[] = {{1, 2, 3, FAR}, {UINT32_MAX, 0, 7, 1}};
static const struct lw_message_transform transforms[] = {
    {0, {{{1, 2, 3, 4}, {5, 6, 7, 8}, {9, 10, 11, 12}}}},
    {4000000000u, {{{-1, 0, 0.5f, FLT_MAX}, {0, 0, 0, FLT_MIN}, {1e-40f, 0, 0, 0}}}}};
static const struct lw_message_light lights[] = {{3, {1, 2, 3}, {0, -1, 0}, {100, 200, 300}},
                                                 {0, {4, 5, 6}, {1, 0, 0}, {0, 0, 0}}};

static const uint32_t visible[] = {7, 0, UINT32_MAX};
static const struct lw_message_material materials[] = {{3, {0, 0.5f, 1}, {FLT_MAX, 0, 0}}, {4, {0}, {0}}};
/* Any numbers come through: the server answers wrong ones. */
static const struct lw_scene_change changes[] = {
    {LW_SCENE_CHANGE_OBJECT_TRANSFORM, 5, 12, {1, 0, 0, INFINITY, 0, 1, 0, -INFINITY, 0, 0, 1, FLT_MAX}},
    {LW_SCENE_CHANGE_CLOCK_PAUSE, 0, 0, {0}},
    {UINT32_MAX, UINT32_MAX, 2, {-1, FLT_MIN}}};
static const uint8_t some_token[LW_TOKEN_SIZE] = {0, 1, 2, 253, 254, 255};
static const struct lw_message samples[] = {
    {.type = LW_MESSAGE_HELLO, .hello = {1, 3, "Gerät 9 – ünïcode", FAR, NULL, 0}},
    {.type = LW_MESSAGE_HELLO, .hello = {0, 0, "", 0, NULL, FAR}},
    {.type = LW_MESSAGE_HELLO, .hello = {.version = 1, .token = some_token}},
    {.type = LW_MESSAGE_WELCOME,
     .welcome = {.version = 1,
                 .session = FAR,
                 .name = "lightwelld",
                 .package_hash = {{1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16}},
                 .package_size = LW_PACKAGE_SIZE_MAX,
                 .package_compressed_size = LW_MESSAGE_COMPRESSED_MAX,
                 .bounces = LW_MESSAGE_BOUNCES_MAX,
                 .target_error = 0.05f,
                 .noise_shown = 0.25f,
                 .run = FAR,
                 .client_lights = bytes_of_data,
                 .client_lights_size = sizeof bytes_of_data,
                 .client_materials = bytes_of_data,
                 .client_materials_size = 1}},
    {.type = LW_MESSAGE_WELCOME,
     .welcome = {.version = 1,
                 .features = LW_FEATURE_MATERIALS,
                 .package_size = 1,
                 .package_compressed_size = 1,
                 .finish = {.hash = {{16, 15, 14, 13, 12, 11, 10, 9, 8, 7, 6, 5, 4, 3, 2, 1}},
                            .size = LW_FINISH_PACKAGE_SIZE_MAX,
                            .compressed_size = 7,
                            .part_size = (const uint64_t[]){1, LW_FINISH_PACKAGE_SIZE_MAX - 1},
                            .part_compressed_size = (const uint64_t[]){3, 4},
                            .part_hash = (const struct lw_package_hash[]){{{1}}, {{2}}},
                            .part_count = 2}}},
    {.type = LW_MESSAGE_FINISH_REQUEST, .finish_request = {LW_MESSAGE_COMPRESSED_MAX, bytes_of_data, 6}},
    {.type = LW_MESSAGE_FINISH_CHUNK, .finish_chunk = {77777, bytes_of_data, sizeof bytes_of_data}},
    {.type = LW_MESSAGE_REFUSAL, .refusal = {.code = LW_REFUSAL_FULL, .text = "no more sessions"}},
    {.type = LW_MESSAGE_REFUSAL, .refusal = {.code = (enum lw_refusal)LW_MESSAGE_REFUSAL_MAX, .text = ""}},
    {.type = LW_MESSAGE_REFUSAL,
     .refusal = {.code = LW_REFUSAL_SHUTDOWN, .text = "", .retry_after_ms = LW_MESSAGE_RETRY_AFTER_MAX}},
    {.type = LW_MESSAGE_PACKAGE_REQUEST, .package_request.offset = LW_MESSAGE_COMPRESSED_MAX},
    {.type = LW_MESSAGE_PACKAGE_CHUNK, .package_chunk = {77777, bytes_of_data, sizeof bytes_of_data}},
    {.type = LW_MESSAGE_INTEREST, .interest = {.everything = true}},
    {.type = LW_MESSAGE_INTEREST, .interest = {.stand_ins = true, .tile = interest_tiles, .tile_count = 2}},
    {.type = LW_MESSAGE_INTEREST, .interest = {.stand_ins = true}},
    {.type = LW_MESSAGE_INTEREST, .interest = {.tile = interest_tiles, .tile_count = 2}},
    {.type = LW_MESSAGE_INTEREST},
    {.type = LW_MESSAGE_FRAME,
     .frame = {.frame = FAR,
               .time_s = 1e300,
               .solve_ns = FAR,
               .rays_total = FAR,
               .tiles_solved = 5,
               .sky = {1, 2, FLT_MAX},
               .transform = transforms,
               .transform_count = 2,
               .light = lights,
               .light_count = 2}},
    {.type = LW_MESSAGE_FRAME, .frame = {.frame = 1}},
    {.type = LW_MESSAGE_TILE,
     .tile = {1, 2, 3, FAR, 1, 1, 0x1p-20f, 2, 0.25f, bytes_of_data, sizeof bytes_of_data, FAR - 1}},
    {.type = LW_MESSAGE_ACK, .ack = {UINT64_MAX}},
    {.type = LW_MESSAGE_PING, .ping = {FAR}},
    {.type = LW_MESSAGE_PONG, .pong = {0}},
    {.type = LW_MESSAGE_FRAME, .frame = {.frame = 1, .server_cpu_ns = FAR}},
    {.type = LW_MESSAGE_SETTLED, .settled = {FAR}},
    {.type = LW_MESSAGE_FRAME,
     .frame = {.frame = 1,
               .hidden = visible,
               .hidden_count = 2,
               .shown = visible + 1,
               .shown_count = 2,
               .material = materials,
               .material_count = 2}},
    {.type = LW_MESSAGE_UPDATE, .update = {FAR, changes, 3}},
    {.type = LW_MESSAGE_UPDATE},
    {.type = LW_MESSAGE_UPDATED, .updated = {FAR, LW_SCENE_CHANGE_DEGENERATE, 3, "no volume", 0, NULL, 0}},
    {.type = LW_MESSAGE_UPDATED, .updated = {1, 0, 0, NULL, FAR, visible, 3}},
    {.type = LW_MESSAGE_FRAME, .frame = {.frame = 1, .hidden = visible, .hidden_count = 2, .spare_count = 2}},
    {.type = LW_MESSAGE_FRAME, .frame = {.frame = FAR, .base = FAR - 1}},
    {.type = LW_MESSAGE_ASK, .ask = {FAR, LW_ASK_STATS, 0}},
    {.type = LW_MESSAGE_ASK, .ask = {0, 77, LW_MESSAGE_RETRY_AFTER_MAX}},
    {.type = LW_MESSAGE_REPORT, .report = {FAR, LW_REPORT_DONE, bytes_of_data, sizeof bytes_of_data}},
    {.type = LW_MESSAGE_REPORT, .report = {1, LW_REPORT_UNKNOWN, NULL, 0}},
    {.type = LW_MESSAGE_WAITING, .waiting = {LW_WAITING_LOOKING_INSIDE, 0.42f}},
    {.type = LW_MESSAGE_WAITING, .waiting = {LW_MESSAGE_WAITING_STAGE_MAX, 1}},
    {.type = LW_MESSAGE_HOLDS, .holds = {held, 2, 0}},
    {.type = LW_MESSAGE_HOLDS, .holds = {held, 2, FAR}},
    {.type = LW_MESSAGE_HOLDS, .holds.frame = FAR},
    {.type = LW_MESSAGE_HOLDS},
};
#define SAMPLES (sizeof samples / sizeof *samples)

static void test_round_trip(void **state) {
    (void)state;
    for (size_t i = 0; i < SAMPLES; i++) {
        uint8_t *bytes;
        size_t size;
        struct lw_framing_header header;
        struct lw_message back;
        struct lw_error err = {0};
        lw_support_ok(lw_message_encode_alloc(&samples[i], &bytes, &size), NULL);
        assert_int_equal(size, lw_message_size(&samples[i]));
        lw_support_ok(lw_framing_read_header(bytes, LW_FRAMING_BODY_MAX, &header, &err), &err);
        assert_int_equal(header.type, samples[i].type);
        assert_int_equal(header.body_size, size - LW_FRAMING_HEADER_SIZE);
        lw_support_ok(message_case_decode(samples[i].type, bytes + LW_FRAMING_HEADER_SIZE, header.body_size,
                                          &back, &err),
                      &err);
        message_case_expect_equal(&samples[i], &back);
        lw_message_finish(&back);
        lw_message_finish(&back); /* twice is fine */
        free(bytes);
    }
}

static void test_capacity(void **state) {
    (void)state;
    for (size_t i = 0; i < SAMPLES; i++) {
        size_t size = lw_message_size(&samples[i]), written = 0;
        uint8_t *exact = malloc(size);
        lw_support_ok(lw_message_encode(&samples[i], exact, size, &written), NULL);
        assert_int_equal(written, size);
        written = 7;
        assert_int_equal(lw_message_encode(&samples[i], exact, size - 1, &written), LW_INTERNAL);
        assert_int_equal(written, 7);
        free(exact);
    }
}

static void test_truncated(void **state) {
    (void)state;
    for (size_t i = 0; i < SAMPLES; i++) {
        uint8_t *bytes;
        size_t size, refused = 0;
        lw_support_ok(lw_message_encode_alloc(&samples[i], &bytes, &size), NULL);
        size -= LW_FRAMING_HEADER_SIZE;
        for (size_t cut = 0; cut < size; cut++) {
            /* a cut between two fields is a message with fewer fields, and may be fine */
            struct lw_message back = {.storage = NULL};
            struct lw_error err = {0};
            enum lw_status status =
                message_case_decode(samples[i].type, bytes + LW_FRAMING_HEADER_SIZE, cut, &back, &err);
            if (status == LW_OK) {
                lw_message_finish(&back);
                continue;
            }
            assert_int_equal(status, LW_PROTOCOL);
            assert_non_null(strstr(err.text, lw_message_name((uint16_t)samples[i].type)));
            assert_null(back.storage);
            refused++;
        }
        assert_true(size < 2 || refused > 0);
        free(bytes);
    }
}

static void test_flipped_bits(void **state) {
    (void)state;
    for (size_t i = 0; i < SAMPLES; i++) {
        uint8_t *bytes;
        size_t size;
        lw_support_ok(lw_message_encode_alloc(&samples[i], &bytes, &size), NULL);
        for (size_t bit = 8 * LW_FRAMING_HEADER_SIZE; bit < 8 * size; bit++) {
            bytes[bit / 8] ^= (uint8_t)(1u << (bit % 8));
            struct lw_message back;
            enum lw_status status = message_case_decode(samples[i].type, bytes + LW_FRAMING_HEADER_SIZE,
                                                        size - LW_FRAMING_HEADER_SIZE, &back, NULL);
            if (status == LW_OK) {
                assert_int_equal(lw_message_validate(&back, NULL), LW_OK);
                lw_message_finish(&back);
            } else {
                assert_int_equal(status, LW_PROTOCOL);
            }
            bytes[bit / 8] ^= (uint8_t)(1u << (bit % 8));
        }
        free(bytes);
    }
}

/* ---- bodies written by hand: what our own encoder refuses to write ---- */

static void test_frame_numbers(void **state) {
    (void)state;
    const float bad[] = {NAN, INFINITY, -INFINITY};
    for (int i = 0; i < 3; i++) {
        struct lw_message_transform t = transforms[0];
        struct lw_message_light l[3] = {lights[0], lights[0], lights[0]};
        t.object_to_world.m[i][3 - i] = bad[i];
        l[0].position_ws.x = l[1].direction_ws.y = l[2].intensity.z = bad[i];
        struct lw_message m = {.type = LW_MESSAGE_FRAME, .frame = {.frame = 1}};
        m.frame.transform = &t;
        m.frame.transform_count = 1;
        message_case_expect_invalid(&m, "transform is not finite");
        m.frame.transform_count = 0;
        m.frame.light_count = 1;
        static const char *const field[] = {"light_position", "light_direction", "light_intensity"};
        for (int k = 0; k < 3; k++) {
            m.frame.light = &l[k];
            message_case_expect_invalid(&m, field[k]);
        }
        m.frame.light_count = 0;
        m.frame.sky[i] = bad[i];
        message_case_expect_invalid(&m, "sky");
        m.frame.sky[i] = -1;
        message_case_expect_invalid(&m, "sky");
        m.frame.sky[i] = 0;
        m.frame.time_s = (double)bad[i];
        message_case_expect_invalid(&m, "time_s");
    }
    const float bad_factor[] = {NAN, INFINITY, -1};
    for (int i = 0; i < 3; i++) {
        struct lw_message_material bad_material[2] = {materials[0], materials[0]};
        bad_material[0].base_colour[i] = bad_material[1].emission[i] = bad_factor[i];
        for (int k = 0; k < 2; k++)
            message_case_expect_invalid(
                &(struct lw_message){
                    .type = LW_MESSAGE_FRAME,
                    .frame = {.frame = 1, .material = &bad_material[k], .material_count = 1}},
                k ? "emission" : "base_colour");
    }
    struct lw_message m = {.type = LW_MESSAGE_FRAME};
    message_case_expect_invalid(&m, "frame is 0");
}

static void test_tile_numbers(void **state) {
    (void)state;
    static const uint8_t payload[LW_MESSAGE_PAYLOAD_MAX + 1];
    const struct lw_message good = {.type = LW_MESSAGE_TILE,
                                    .tile = {.version = 1,
                                             .scale = 1,
                                             .bounces = LW_MESSAGE_BOUNCES_MAX,
                                             .payload = payload,
                                             .payload_size = 1}};
    assert_int_equal(lw_message_validate(&good, NULL), LW_OK);
    const float bad_scale[] = {0, -1, NAN, INFINITY}, bad_error[] = {-1, NAN, INFINITY};
    for (int i = 0; i < 4; i++) {
        struct lw_message m = good;
        m.tile.scale = bad_scale[i];
        message_case_expect_invalid(&m, "scale");
    }
    for (int i = 0; i < 3; i++) {
        struct lw_message m = good;
        m.tile.error = bad_error[i];
        message_case_expect_invalid(&m, "error");
    }
    struct lw_message m = good;
    m.tile.version = 0;
    message_case_expect_invalid(&m, "version is 0");
    m = good;
    m.tile.base = 1;
    message_case_expect_invalid(&m, "base_version is not under the version");
    m.tile.version = 2;
    assert_int_equal(lw_message_validate(&m, NULL), LW_OK);
    m = good;
    m.tile.bounces++;
    message_case_expect_invalid(&m, "bounces is over 64");
    m = good;
    m.tile.payload_size = 0;
    message_case_expect_invalid(&m, "payload");
    m.tile.payload_size = LW_MESSAGE_PAYLOAD_MAX;
    assert_int_equal(lw_message_validate(&m, NULL), LW_OK);
    m.tile.payload_size++;
    message_case_expect_invalid(&m, "payload");
    struct message_case_body b = {0}; /* a body of nothing */
    message_case_expect(LW_MESSAGE_TILE, &b, "version is 0");
}

/* Where there is no block yet, either. */
static void test_memory_of_an_empty_list(void **state) {
    (void)state;
    struct lw_message_memory memory = {0};
    struct lw_message got;
    struct lw_error err = {0};
    lw_support_ok(lw_message_decode_with((struct lw_framing_header){0, LW_MESSAGE_UPDATE, 0},
                                         (const uint8_t *)"", &memory, &got, &err),
                  &err);
    assert_int_equal(got.update.change_count, 0);
    lw_message_finish(&got);
    lw_message_memory_finish(&memory);
}

/* At the budget a message is read; one byte under what it asks for it is not. */
static void test_memory_budget(void **state) {
    (void)state;
    enum { TILES = 1000 };
    static struct lw_message_interest_tile tile[TILES];
    struct lw_message sent = {.type = LW_MESSAGE_INTEREST, .interest = {.tile = tile, .tile_count = TILES}},
                      got;
    struct lw_message_memory memory = {0};
    struct lw_framing_header header;
    struct lw_error err = {0};
    uint8_t *bytes;
    size_t size;
    lw_support_ok(lw_message_encode_alloc(&sent, &bytes, &size), NULL);
    lw_support_ok(lw_framing_read_header(bytes, LW_FRAMING_CLIENT_BODY_MAX, &header, &err), &err);
    const uint8_t *body = bytes + LW_FRAMING_HEADER_SIZE;
    lw_support_ok(lw_message_decode_with(header, body, &memory, &got, &err), &err);
    lw_message_finish(&got);
    memory.budget = memory.asked;
    assert_true(memory.asked > 12 * TILES && memory.asked < 8u << 20);
    lw_support_ok(lw_message_decode_with(header, body, &memory, &got, &err), &err);
    assert_int_equal(got.interest.tile_count, TILES);
    lw_message_finish(&got);
    memory.budget -= 16; /* memory is given in pieces of 16 bytes */
    lw_support_fails(lw_message_decode_with(header, body, &memory, &got, &err), LW_PROTOCOL, &err,
                     "bytes of memory to read");
    lw_message_memory_finish(&memory);
    free(bytes);
}

static void test_out_of_memory(void **state) {
    (void)state;
    for (size_t i = 0; i < SAMPLES; i++) {
        uint8_t *bytes = NULL;
        size_t size;
        enum lw_status status = LW_NO_MEMORY;
        unsigned needed = 0;
        for (; status != LW_OK; needed++) {
            assert_true(needed < 100);
            assert_null(bytes);
            failing_memory_all(needed);
            status = lw_message_encode_alloc(&samples[i], &bytes, &size);
            (void)failing_memory_end();
            assert_true(status == LW_OK || status == LW_NO_MEMORY);
        }
        assert_true(needed > 1);
        status = LW_NO_MEMORY;
        for (needed = 0; status != LW_OK; needed++) {
            struct lw_message m = {.storage = NULL};
            struct lw_error err = {0};
            struct lw_framing_header header = {.body_size = (uint32_t)(size - LW_FRAMING_HEADER_SIZE),
                                               .type = (uint16_t)samples[i].type};
            assert_true(needed < 100);
            failing_memory_all(needed);
            status = lw_message_decode(header, bytes + LW_FRAMING_HEADER_SIZE, &m, &err);
            (void)failing_memory_end();
            if (status == LW_OK) {
                message_case_expect_equal(&samples[i], &m);
                lw_message_finish(&m);
            } else {
                lw_support_fails(status, LW_NO_MEMORY, &err, "out of memory");
                assert_null(m.storage);
            }
        }
        assert_true(needed > 1);
        free(bytes);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_round_trip),
        cmocka_unit_test(test_capacity),
        cmocka_unit_test(test_truncated),
        cmocka_unit_test(test_flipped_bits),
        cmocka_unit_test(test_frame_numbers),
        cmocka_unit_test(test_tile_numbers),
        cmocka_unit_test(test_memory_of_an_empty_list),
        cmocka_unit_test(test_memory_budget),
        cmocka_unit_test(test_out_of_memory),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
