#include "tests/support/support.h"

#include "common/base/waiting.h"
#include "proto/message.h"

#include <float.h>
#include <stdlib.h>
#include <string.h>

#define FAR 0x123456789abcdef0u

/* ---- an allocator that fails on demand ---- */

void *__real_malloc(size_t size);
void *__real_calloc(size_t count, size_t size);
void *__wrap_malloc(size_t size);
void *__wrap_calloc(size_t count, size_t size);

static int allocations_left = -1; /* then the next one fails; -1: none fails */

static bool may_allocate(void) {
    if (allocations_left == 0) return false;
    if (allocations_left > 0) allocations_left--;
    return true;
}

void *__wrap_malloc(size_t size) { return may_allocate() ? __real_malloc(size) : NULL; }
void *__wrap_calloc(size_t count, size_t size) { return may_allocate() ? __real_calloc(count, size) : NULL; }

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

static void expect_text(const char *a, const char *b) { assert_string_equal(a ? a : "", b ? b : ""); }

static void expect_same_finish(const struct lw_message_package *a, const struct lw_message_package *b) {
    assert_int_equal(a->size, b->size);
    assert_int_equal(a->compressed_size, b->compressed_size);
    assert_int_equal(a->part_count, b->part_count);
    assert_memory_equal(&a->hash, &b->hash, sizeof a->hash);
    for (size_t i = 0; i < a->part_count; i++) {
        assert_int_equal(a->part_size[i], b->part_size[i]);
        assert_int_equal(a->part_compressed_size[i], b->part_compressed_size[i]);
        assert_memory_equal(&a->part_hash[i], &b->part_hash[i], sizeof a->part_hash[i]);
    }
}

static void expect_equal(const struct lw_message *a, const struct lw_message *b) {
    assert_int_equal(a->type, b->type);
    switch (a->type) {
    case LW_MESSAGE_HELLO:
        assert_int_equal(a->hello.version, b->hello.version);
        assert_int_equal(a->hello.features, b->hello.features);
        expect_text(a->hello.name, b->hello.name);
        assert_int_equal(a->hello.rate_limit_bytes_hz, b->hello.rate_limit_bytes_hz);
        assert_int_equal(a->hello.token != NULL, b->hello.token != NULL);
        if (a->hello.token) assert_memory_equal(a->hello.token, b->hello.token, LW_TOKEN_SIZE);
        break;
    case LW_MESSAGE_WELCOME:
        assert_int_equal(a->welcome.version, b->welcome.version);
        assert_int_equal(a->welcome.features, b->welcome.features);
        assert_int_equal(a->welcome.session, b->welcome.session);
        expect_text(a->welcome.name, b->welcome.name);
        assert_memory_equal(&a->welcome.package_hash, &b->welcome.package_hash, 16);
        assert_int_equal(a->welcome.package_size, b->welcome.package_size);
        assert_int_equal(a->welcome.package_compressed_size, b->welcome.package_compressed_size);
        assert_int_equal(a->welcome.bounces, b->welcome.bounces);
        assert_true(a->welcome.target_error == b->welcome.target_error);
        assert_true(a->welcome.noise_shown == b->welcome.noise_shown);
        assert_int_equal(a->welcome.run, b->welcome.run);
        assert_int_equal(a->welcome.client_lights_size, b->welcome.client_lights_size);
        assert_memory_equal(a->welcome.client_lights, b->welcome.client_lights,
                            a->welcome.client_lights_size);
        assert_int_equal(a->welcome.client_materials_size, b->welcome.client_materials_size);
        assert_memory_equal(a->welcome.client_materials, b->welcome.client_materials,
                            a->welcome.client_materials_size);
        expect_same_finish(&a->welcome.finish, &b->welcome.finish);
        break;
    case LW_MESSAGE_REFUSAL:
        assert_int_equal(a->refusal.code, b->refusal.code);
        expect_text(a->refusal.text, b->refusal.text);
        assert_int_equal(a->refusal.retry_after_ms, b->refusal.retry_after_ms);
        break;
    case LW_MESSAGE_PACKAGE_REQUEST:
    case LW_MESSAGE_FINISH_REQUEST:
        assert_int_equal(a->package_request.offset, b->package_request.offset);
        assert_int_equal(a->package_request.held_size, b->package_request.held_size);
        assert_memory_equal(a->package_request.held, b->package_request.held, a->package_request.held_size);
        break;
    case LW_MESSAGE_PACKAGE_CHUNK:
    case LW_MESSAGE_FINISH_CHUNK:
        assert_int_equal(a->package_chunk.offset, b->package_chunk.offset);
        assert_int_equal(a->package_chunk.size, b->package_chunk.size);
        assert_memory_equal(a->package_chunk.data, b->package_chunk.data, a->package_chunk.size);
        break;
    case LW_MESSAGE_INTEREST:
        assert_int_equal(a->interest.everything, b->interest.everything);
        assert_int_equal(a->interest.stand_ins, b->interest.stand_ins);
        assert_int_equal(a->interest.tile_count, b->interest.tile_count);
        for (size_t i = 0; i < a->interest.tile_count; i++)
            assert_memory_equal(&a->interest.tile[i], &b->interest.tile[i], sizeof a->interest.tile[i]);
        break;
    case LW_MESSAGE_FRAME:
        assert_int_equal(a->frame.frame, b->frame.frame);
        assert_true(a->frame.time_s == b->frame.time_s);
        assert_int_equal(a->frame.solve_ns, b->frame.solve_ns);
        assert_int_equal(a->frame.rays_total, b->frame.rays_total);
        assert_int_equal(a->frame.tiles_solved, b->frame.tiles_solved);
        assert_int_equal(a->frame.server_cpu_ns, b->frame.server_cpu_ns);
        assert_memory_equal(a->frame.sky, b->frame.sky, sizeof a->frame.sky);
        assert_int_equal(a->frame.transform_count, b->frame.transform_count);
        for (size_t i = 0; i < a->frame.transform_count; i++)
            assert_memory_equal(&a->frame.transform[i], &b->frame.transform[i], sizeof a->frame.transform[i]);
        assert_int_equal(a->frame.light_count, b->frame.light_count);
        for (size_t i = 0; i < a->frame.light_count; i++)
            assert_memory_equal(&a->frame.light[i], &b->frame.light[i], sizeof a->frame.light[i]);
        assert_int_equal(a->frame.hidden_count, b->frame.hidden_count);
        assert_int_equal(a->frame.spare_count, b->frame.spare_count);
        assert_int_equal(a->frame.shown_count, b->frame.shown_count);
        for (size_t i = 0; i < a->frame.hidden_count; i++)
            assert_int_equal(a->frame.hidden[i], b->frame.hidden[i]);
        for (size_t i = 0; i < a->frame.shown_count; i++)
            assert_int_equal(a->frame.shown[i], b->frame.shown[i]);
        assert_int_equal(a->frame.material_count, b->frame.material_count);
        for (size_t i = 0; i < a->frame.material_count; i++)
            assert_memory_equal(&a->frame.material[i], &b->frame.material[i], sizeof a->frame.material[i]);
        break;
    case LW_MESSAGE_UPDATE:
        assert_int_equal(a->update.request, b->update.request);
        assert_int_equal(a->update.change_count, b->update.change_count);
        for (size_t i = 0; i < a->update.change_count; i++)
            assert_memory_equal(&a->update.change[i], &b->update.change[i], sizeof a->update.change[i]);
        break;
    case LW_MESSAGE_HOLDS:
        assert_int_equal(a->holds.tile_count, b->holds.tile_count);
        assert_int_equal(a->holds.frame, b->holds.frame);
        for (size_t i = 0; i < a->holds.tile_count; i++) {
            assert_int_equal(a->holds.tile[i].object, b->holds.tile[i].object);
            assert_int_equal(a->holds.tile[i].level, b->holds.tile[i].level);
            assert_int_equal(a->holds.tile[i].tile, b->holds.tile[i].tile);
            assert_int_equal(a->holds.tile[i].version, b->holds.tile[i].version);
        }
        break;
    case LW_MESSAGE_UPDATED:
        assert_int_equal(a->updated.request, b->updated.request);
        assert_int_equal(a->updated.code, b->updated.code);
        assert_int_equal(a->updated.change, b->updated.change);
        expect_text(a->updated.text, b->updated.text);
        assert_int_equal(a->updated.frame, b->updated.frame);
        assert_int_equal(a->updated.added_count, b->updated.added_count);
        for (size_t i = 0; i < a->updated.added_count; i++)
            assert_int_equal(a->updated.added[i], b->updated.added[i]);
        break;
    case LW_MESSAGE_TILE:
        assert_int_equal(a->tile.object, b->tile.object);
        assert_int_equal(a->tile.level, b->tile.level);
        assert_int_equal(a->tile.tile, b->tile.tile);
        assert_int_equal(a->tile.version, b->tile.version);
        assert_int_equal(a->tile.layer, b->tile.layer);
        assert_int_equal(a->tile.codec, b->tile.codec);
        assert_true(a->tile.scale == b->tile.scale);
        assert_int_equal(a->tile.bounces, b->tile.bounces);
        assert_true(a->tile.error == b->tile.error);
        assert_int_equal(a->tile.payload_size, b->tile.payload_size);
        assert_true(a->tile.base == b->tile.base);
        assert_memory_equal(a->tile.payload, b->tile.payload, a->tile.payload_size);
        break;
    case LW_MESSAGE_ACK:
        assert_int_equal(a->ack.frame, b->ack.frame);
        break;
    case LW_MESSAGE_SETTLED:
        assert_int_equal(a->settled.frame, b->settled.frame);
        break;
    case LW_MESSAGE_WAITING:
        assert_int_equal(a->waiting.stage, b->waiting.stage);
        assert_true(a->waiting.share == b->waiting.share);
        break;
    case LW_MESSAGE_PING:
    case LW_MESSAGE_PONG:
        assert_int_equal(a->ping.token, b->ping.token);
        break;
    case LW_MESSAGE_ASK:
        assert_int_equal(a->ask.request, b->ask.request);
        assert_int_equal(a->ask.what, b->ask.what);
        assert_int_equal(a->ask.return_after_ms, b->ask.return_after_ms);
        break;
    case LW_MESSAGE_REPORT:
        assert_int_equal(a->report.request, b->report.request);
        assert_int_equal(a->report.code, b->report.code);
        assert_int_equal(a->report.size, b->report.size);
        if (a->report.size) assert_memory_equal(a->report.data, b->report.data, a->report.size);
        break;
    }
}

/* Decodes from memory of exactly that size, so that ASan sees a read past the end. */
static enum lw_status decode_exact(enum lw_message_type type, const uint8_t *body, size_t size,
                                   struct lw_message *out, struct lw_error *err) {
    uint8_t *exact = malloc(size ? size : 1);
    assert_non_null(exact);
    if (size) memcpy(exact, body, size);
    struct lw_framing_header header = {.body_size = (uint32_t)size, .type = (uint16_t)type};
    enum lw_status status = lw_message_decode(header, exact, out, err);
    free(exact); /* the decoded message must not point into it */
    return status;
}

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
        lw_support_ok(
            decode_exact(samples[i].type, bytes + LW_FRAMING_HEADER_SIZE, header.body_size, &back, &err),
            &err);
        expect_equal(&samples[i], &back);
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
                decode_exact(samples[i].type, bytes + LW_FRAMING_HEADER_SIZE, cut, &back, &err);
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
            enum lw_status status = decode_exact(samples[i].type, bytes + LW_FRAMING_HEADER_SIZE,
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

struct body {
    uint8_t *bytes;
    size_t size;
};

static void put(struct body *b, const void *bytes, size_t size) {
    b->bytes = realloc(b->bytes, b->size + size + 1);
    assert_non_null(b->bytes);
    memcpy(b->bytes + b->size, bytes, size);
    b->size += size;
}

static void put_varint(struct body *b, uint64_t value) {
    do {
        uint8_t byte = (uint8_t)((value & 0x7f) | (value > 0x7f ? 0x80 : 0));
        put(b, &byte, 1);
        value >>= 7;
    } while (value);
}

static void put_number(struct body *b, unsigned field, uint64_t value) {
    put_varint(b, field << 3);
    put_varint(b, value);
}

static void put_float(struct body *b, unsigned field, float value) {
    put_varint(b, field << 3 | 5);
    put(b, &value, sizeof value);
}

static void put_list(struct body *b, unsigned field, const void *bytes, size_t size) {
    put_varint(b, field << 3 | 2);
    put_varint(b, size);
    put(b, bytes, size);
}

/* A list of `count` words of 4 bytes, all of them 0. */
static void put_zeros(struct body *b, unsigned field, size_t count) {
    void *zeros = calloc(count + 1, 4);
    put_list(b, field, zeros, 4 * count);
    free(zeros);
}

/* Decodes and frees the body. text NULL: it must decode. */
static void expect_decode(enum lw_message_type type, struct body *b, const char *text) {
    struct lw_message m;
    struct lw_error err = {0};
    enum lw_status status = decode_exact(type, b->bytes, b->size, &m, &err);
    if (text) {
        lw_support_fails(status, LW_PROTOCOL, &err, text);
    } else {
        lw_support_ok(status, &err);
        lw_message_finish(&m);
    }
    free(b->bytes);
    *b = (struct body){0};
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
        struct body b = {0};
        put_list(&b, 3, cases[i].text, strlen(cases[i].text));
        expect_decode(LW_MESSAGE_HELLO, &b, cases[i].fine ? NULL : "message HELLO: name is not UTF-8");
    }
    char longest[LW_MESSAGE_TEXT_MAX + 1];
    memset(longest, 'x', sizeof longest);
    for (unsigned over = 0; over < 2; over++) {
        struct body b = {0};
        put_list(&b, 3, longest, LW_MESSAGE_NAME_MAX + over);
        expect_decode(LW_MESSAGE_HELLO, &b, over ? "name is over 64 bytes" : NULL);
        put_number(&b, 1, 1);
        put_list(&b, 2, longest, LW_MESSAGE_TEXT_MAX + over);
        expect_decode(LW_MESSAGE_REFUSAL, &b, over ? "text is over 256 bytes" : NULL);
    }
}

static void put_welcome(struct body *b, size_t hash_size, uint64_t size, uint64_t compressed_size,
                        float target_error) {
    static const uint8_t hash[17];
    put_list(b, 5, hash, hash_size);
    put_number(b, 6, size);
    put_number(b, 7, compressed_size);
    put_float(b, 9, target_error);
}

static void test_welcome(void **state) {
    (void)state;
    struct body b = {0};
    put_welcome(&b, 16, LW_PACKAGE_SIZE_MAX, LW_MESSAGE_COMPRESSED_MAX, 0);
    put_number(&b, 8, LW_MESSAGE_BOUNCES_MAX);
    expect_decode(LW_MESSAGE_WELCOME, &b, NULL);
    put_welcome(&b, 15, 1, 1, 0);
    expect_decode(LW_MESSAGE_WELCOME, &b, "package_hash is not 16 bytes");
    put_welcome(&b, 17, 1, 1, 0);
    expect_decode(LW_MESSAGE_WELCOME, &b, "package_hash is not 16 bytes");
    put_welcome(&b, 16, LW_PACKAGE_SIZE_MAX + 1, 1, 0);
    expect_decode(LW_MESSAGE_WELCOME, &b, "package_size");
    put_welcome(&b, 16, 0, 1, 0);
    expect_decode(LW_MESSAGE_WELCOME, &b, "package_size");
    put_welcome(&b, 16, 1, LW_MESSAGE_COMPRESSED_MAX + 1, 0);
    expect_decode(LW_MESSAGE_WELCOME, &b, "package_compressed_size");
    put_welcome(&b, 16, 1, 0, 0);
    expect_decode(LW_MESSAGE_WELCOME, &b, "package_compressed_size");
    put_welcome(&b, 16, 1, 1, -1);
    expect_decode(LW_MESSAGE_WELCOME, &b, "target_error");
    put_welcome(&b, 16, 1, 1, NAN);
    expect_decode(LW_MESSAGE_WELCOME, &b, "target_error");
    for (int i = 0; i < 3; i++) {
        put_welcome(&b, 16, 1, 1, 0);
        put_float(&b, 14, (const float[]){-0.1f, 1.1f, NAN}[i]);
        expect_decode(LW_MESSAGE_WELCOME, &b, "noise_shown is not from 0 to 1");
    }
    put_welcome(&b, 16, 1, 1, 0);
    put_number(&b, 8, LW_MESSAGE_BOUNCES_MAX + 1);
    expect_decode(LW_MESSAGE_WELCOME, &b, "bounces is over 64");
    for (size_t over = 0; over < 2; over++) { /* one bit for each that a scene may have */
        static const uint8_t bits[LW_SCENE_LIGHTS_MAX / 8 + 1];
        put_welcome(&b, 16, 1, 1, 0);
        put_list(&b, 15, bits, LW_SCENE_LIGHTS_MAX / 8 + over);
        expect_decode(LW_MESSAGE_WELCOME, &b, over ? "client_lights is over 131072 bytes" : NULL);
        put_welcome(&b, 16, 1, 1, 0);
        put_list(&b, 16, bits, LW_SCENE_MATERIALS_MAX / 8 + over);
        expect_decode(LW_MESSAGE_WELCOME, &b, over ? "client_materials is over 8192 bytes" : NULL);
    }
}

static void test_refusal_code(void **state) {
    (void)state;
    struct body b = {0};
    expect_decode(LW_MESSAGE_REFUSAL, &b, "code is not in 1..65535");
    put_number(&b, 1, LW_MESSAGE_REFUSAL_MAX);
    expect_decode(LW_MESSAGE_REFUSAL, &b, NULL);
    put_number(&b, 1, LW_MESSAGE_REFUSAL_MAX + 1);
    expect_decode(LW_MESSAGE_REFUSAL, &b, "code is not in 1..65535");
    put_number(&b, 1, UINT32_MAX);
    expect_decode(LW_MESSAGE_REFUSAL, &b, "code is not in 1..65535");
}

static void test_package(void **state) {
    (void)state;
    struct body b = {0};
    put_number(&b, 1, LW_MESSAGE_COMPRESSED_MAX + 1);
    expect_decode(LW_MESSAGE_PACKAGE_REQUEST, &b, "offset is past the limit");
    expect_decode(LW_MESSAGE_PACKAGE_CHUNK, &b, "data is not 1..262144 bytes");
    put_zeros(&b, 2, LW_MESSAGE_CHUNK_MAX / 4);
    expect_decode(LW_MESSAGE_PACKAGE_CHUNK, &b, NULL);
    put_zeros(&b, 2, LW_MESSAGE_CHUNK_MAX / 4 + 1);
    expect_decode(LW_MESSAGE_PACKAGE_CHUNK, &b, "data is not 1..262144 bytes");
    put_number(&b, 1, LW_MESSAGE_COMPRESSED_MAX - 4);
    put_zeros(&b, 2, 1);
    expect_decode(LW_MESSAGE_PACKAGE_CHUNK, &b, NULL);
    put_number(&b, 1, LW_MESSAGE_COMPRESSED_MAX - 3);
    put_zeros(&b, 2, 1);
    expect_decode(LW_MESSAGE_PACKAGE_CHUNK, &b, "offset is past the limit");
    put_number(&b, 1, UINT64_MAX);
    put_zeros(&b, 2, 1);
    expect_decode(LW_MESSAGE_PACKAGE_CHUNK, &b, "offset is past the limit");
}

static void test_interest(void **state) {
    (void)state;
    struct body b = {0};
    for (size_t over = 0; over < 2; over++) {
        for (unsigned field = 2; field <= 4; field++) put_zeros(&b, field, LW_MESSAGE_INTEREST_MAX + over);
        assert_true(b.size <= LW_FRAMING_CLIENT_BODY_MAX);
        expect_decode(LW_MESSAGE_INTEREST, &b, over ? "tile has over 4096 entries" : NULL);
    }
    for (unsigned longer = 2; longer <= 4; longer++) {
        for (unsigned field = 2; field <= 4; field++) put_zeros(&b, field, field == longer ? 3 : 2);
        expect_decode(LW_MESSAGE_INTEREST, &b, "differ in length");
    }
    put_number(&b, 1, 1);
    for (unsigned field = 2; field <= 4; field++) put_zeros(&b, field, 1);
    expect_decode(LW_MESSAGE_INTEREST, &b, "everything");
    put_list(&b, 2, "abcde", 5); /* no whole number of words */
    expect_decode(LW_MESSAGE_INTEREST, &b, "does not decode");
}

static void test_holds(void **state) {
    (void)state;
    struct body b = {0};
    for (size_t over = 0; over < 2; over++) {
        for (unsigned field = 1; field <= 4; field++)
            put_zeros(&b, field, (field == 4 ? 2 : 1) * (LW_MESSAGE_HOLDS_MAX + over));
        assert_true(b.size <= LW_FRAMING_CLIENT_BODY_MAX);
        expect_decode(LW_MESSAGE_HOLDS, &b, over ? "tile has over 2048 entries" : NULL);
    }
    for (unsigned longer = 1; longer <= 4; longer++) {
        for (unsigned field = 1; field <= 4; field++)
            put_zeros(&b, field, (field == 4 ? 2 : 1) * (field == longer ? 3 : 2));
        expect_decode(LW_MESSAGE_HOLDS, &b, "differ in length");
    }
}

static void put_frame(struct body *b, size_t transform_count, size_t transform_floats, size_t light_count,
                      const size_t light_floats[3]) {
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
    struct body b = {0};
    put_frame(&b, T, 12 * T, L, (size_t[3]){3 * L, 3 * L, 3 * L});
    assert_true(b.size <= LW_FRAMING_BODY_MAX);
    expect_decode(LW_MESSAGE_FRAME, &b, NULL);
    put_frame(&b, T + 1, 12 * (T + 1), 0, none);
    expect_decode(LW_MESSAGE_FRAME, &b, "transform_object has over 8192 entries");
    put_frame(&b, 0, 0, L + 1, (size_t[3]){3 * (L + 1), 3 * (L + 1), 3 * (L + 1)});
    expect_decode(LW_MESSAGE_FRAME, &b, "light has over 8192 entries");
    put_frame(&b, 2, 23, 0, none);
    expect_decode(LW_MESSAGE_FRAME, &b, "12 values");
    put_frame(&b, 2, 25, 0, none);
    expect_decode(LW_MESSAGE_FRAME, &b, "12 values");
    for (int longer = 0; longer < 3; longer++) {
        size_t floats[3] = {6, 6, 6};
        floats[longer]++;
        put_frame(&b, 0, 0, 2, floats);
        expect_decode(LW_MESSAGE_FRAME, &b, "3 values for each light");
    }
    for (size_t sky = 0; sky < 5; sky++) {
        put_number(&b, 1, 1);
        put_zeros(&b, 6, sky);
        expect_decode(LW_MESSAGE_FRAME, &b, sky == 3 ? NULL : "sky is not 3 values");
    }
}

static void put_frame_state(struct body *b, size_t hidden, size_t shown, size_t materials_count,
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
    struct body b = {0};
    put_frame(&b, T, 12 * T, L, (size_t[3]){3 * L, 3 * L, 3 * L});
    put_zeros(&b, 14, V);
    put_zeros(&b, 15, V);
    put_zeros(&b, 16, M);
    put_zeros(&b, 17, 3 * M);
    put_zeros(&b, 18, 3 * M);
    assert_true(b.size <= LW_FRAMING_BODY_MAX); /* everything that may be in one, at its limit */
    expect_decode(LW_MESSAGE_FRAME, &b, NULL);
    put_frame_state(&b, V + 1, 0, 0, 0, 0);
    expect_decode(LW_MESSAGE_FRAME, &b, "hidden_object has over 8192 entries");
    put_frame_state(&b, 0, V + 1, 0, 0, 0);
    expect_decode(LW_MESSAGE_FRAME, &b, "shown_object has over 8192 entries");
    put_frame_state(&b, 0, 0, M + 1, 3 * (M + 1), 3 * (M + 1));
    expect_decode(LW_MESSAGE_FRAME, &b, "material has over 4096 entries");
    put_frame_state(&b, 0, 0, 2, 7, 6);
    expect_decode(LW_MESSAGE_FRAME, &b, "3 values for each material");
    put_frame_state(&b, 0, 0, 2, 6, 5);
    expect_decode(LW_MESSAGE_FRAME, &b, "3 values for each material");
    for (size_t spares = 0; spares < 4; spares++) {
        put_frame_state(&b, 2, 3, 0, 0, 0);
        put_number(&b, 19, spares);
        expect_decode(LW_MESSAGE_FRAME, &b, spares > 2 ? "spares is over the length of hidden_object" : NULL);
    }
    put_frame_state(&b, V, 0, 0, 0, 0);
    put_number(&b, 19, UINT32_MAX);
    expect_decode(LW_MESSAGE_FRAME, &b, "spares is over the length");
}

/* `counts` changes of `each` values, and `values` values. */
static void put_update(struct body *b, size_t kinds, size_t targets, size_t counts, uint32_t each,
                       size_t values) {
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
    struct body b = {0};
    put_update(&b, C, C, C, V, C * V);
    put_number(&b, 1, UINT64_MAX);
    assert_true(b.size <= LW_FRAMING_CLIENT_BODY_MAX); /* the largest that a client may send */
    expect_decode(LW_MESSAGE_UPDATE, &b, NULL);
    put_update(&b, C + 1, C + 1, C + 1, 0, 0);
    expect_decode(LW_MESSAGE_UPDATE, &b, "kind has over 1024 entries");
    put_update(&b, 1, 1, 1, V + 1, V + 1);
    expect_decode(LW_MESSAGE_UPDATE, &b, "value_count is over 12");
    put_update(&b, 1, 1, 1, UINT32_MAX, V);
    expect_decode(LW_MESSAGE_UPDATE, &b, "value_count is over 12");
    put_update(&b, 2, 2, 2, 3, 5);
    expect_decode(LW_MESSAGE_UPDATE, &b, "value is shorter");
    put_update(&b, 2, 2, 2, 3, 7);
    expect_decode(LW_MESSAGE_UPDATE, &b, "value is longer");
    for (int i = 0; i < 3; i++) {
        put_update(&b, 2 + (i == 0), 2 + (i == 1), 2 + (i == 2), 0, 0);
        expect_decode(LW_MESSAGE_UPDATE, &b, "differ in length");
    }
}

static void test_updated_text(void **state) {
    (void)state;
    char text[LW_MESSAGE_TEXT_MAX + 1];
    memset(text, 'x', sizeof text);
    for (unsigned over = 0; over < 2; over++) {
        struct body b = {0};
        put_list(&b, 4, text, LW_MESSAGE_TEXT_MAX + over);
        expect_decode(LW_MESSAGE_UPDATED, &b, over ? "text is over 256 bytes" : NULL);
        put_zeros(&b, 6, LW_MESSAGE_CHANGES_MAX + over);
        expect_decode(LW_MESSAGE_UPDATED, &b, over ? "added has over 1024 entries" : NULL);
    }
    struct body b = {0};
    put_number(&b, 2, LW_SCENE_CHANGE_NO_SPARE);
    put_zeros(&b, 6, 1);
    expect_decode(LW_MESSAGE_UPDATED, &b, "added has entries though it is refused");
}

/* Through our own encoder too: a number that clients would refuse must not leave the server. */
static void expect_invalid(const struct lw_message *message, const char *text) {
    struct lw_error err = {0};
    size_t size = 0;
    static uint8_t bytes[LW_FRAMING_BODY_MAX];
    lw_support_fails(lw_message_validate(message, &err), LW_PROTOCOL, &err, text);
    assert_int_equal(lw_message_encode(message, bytes, sizeof bytes, &size), LW_INTERNAL);
    assert_int_equal(size, 0);
}

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
        expect_invalid(&m, "transform is not finite");
        m.frame.transform_count = 0;
        m.frame.light_count = 1;
        static const char *const field[] = {"light_position", "light_direction", "light_intensity"};
        for (int k = 0; k < 3; k++) {
            m.frame.light = &l[k];
            expect_invalid(&m, field[k]);
        }
        m.frame.light_count = 0;
        m.frame.sky[i] = bad[i];
        expect_invalid(&m, "sky");
        m.frame.sky[i] = -1;
        expect_invalid(&m, "sky");
        m.frame.sky[i] = 0;
        m.frame.time_s = (double)bad[i];
        expect_invalid(&m, "time_s");
    }
    const float bad_factor[] = {NAN, INFINITY, -1};
    for (int i = 0; i < 3; i++) {
        struct lw_message_material bad_material[2] = {materials[0], materials[0]};
        bad_material[0].base_colour[i] = bad_material[1].emission[i] = bad_factor[i];
        for (int k = 0; k < 2; k++)
            expect_invalid(
                &(struct lw_message){
                    .type = LW_MESSAGE_FRAME,
                    .frame = {.frame = 1, .material = &bad_material[k], .material_count = 1}},
                k ? "emission" : "base_colour");
    }
    struct lw_message m = {.type = LW_MESSAGE_FRAME};
    expect_invalid(&m, "frame is 0");
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
        expect_invalid(&m, "scale");
    }
    for (int i = 0; i < 3; i++) {
        struct lw_message m = good;
        m.tile.error = bad_error[i];
        expect_invalid(&m, "error");
    }
    struct lw_message m = good;
    m.tile.version = 0;
    expect_invalid(&m, "version is 0");
    m = good;
    m.tile.base = 1;
    expect_invalid(&m, "base_version is not under the version");
    m.tile.version = 2;
    assert_int_equal(lw_message_validate(&m, NULL), LW_OK);
    m = good;
    m.tile.bounces++;
    expect_invalid(&m, "bounces is over 64");
    m = good;
    m.tile.payload_size = 0;
    expect_invalid(&m, "payload");
    m.tile.payload_size = LW_MESSAGE_PAYLOAD_MAX;
    assert_int_equal(lw_message_validate(&m, NULL), LW_OK);
    m.tile.payload_size++;
    expect_invalid(&m, "payload");
    struct body b = {0}; /* a body of nothing */
    expect_decode(LW_MESSAGE_TILE, &b, "version is 0");
}

static void test_fields(void **state) {
    (void)state;
    struct body b = {0};
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
        expect_decode(LW_MESSAGE_ACK, &b, over ? "has over 64 fields" : NULL);
    }
    put_float(&b, 1, 1);
    expect_decode(LW_MESSAGE_ACK, &b, "wrong type");
    for (unsigned group = 3; group < 8;
         group++) { /* groups are gone, 6 and 7 never were; 5 lacks its 4 bytes */
        put_varint(&b, 2 << 3 | group);
        expect_decode(LW_MESSAGE_ACK, &b, "is no protobuf");
    }
    put_varint(&b, 2 << 3 | 2);
    put_varint(&b, UINT64_MAX);
    expect_decode(LW_MESSAGE_ACK, &b, "is no protobuf");
    put(&b, "\x08\x80\x80\x80\x80\x80\x80\x80\x80\x80\x80\x01", 12); /* a varint of 11 bytes */
    expect_decode(LW_MESSAGE_ACK, &b, "is no protobuf");
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
        int needed = 0;
        for (; status != LW_OK; needed++) {
            assert_true(needed < 100);
            assert_null(bytes);
            allocations_left = needed;
            status = lw_message_encode_alloc(&samples[i], &bytes, &size);
            allocations_left = -1;
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
            allocations_left = needed;
            status = lw_message_decode(header, bytes + LW_FRAMING_HEADER_SIZE, &m, &err);
            allocations_left = -1;
            if (status == LW_OK) {
                expect_equal(&samples[i], &m);
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

static void test_waiting(void **state) {
    (void)state;
    const float bad[] = {NAN, INFINITY, -0.01f, 1.01f};
    struct lw_message m = {.type = LW_MESSAGE_WAITING, .waiting = {LW_WAITING_FIRST_LIGHT, 0}};
    lw_support_ok(lw_message_validate(&m, NULL), NULL);
    for (int i = 0; i < 4; i++) {
        m.waiting.share = bad[i];
        expect_invalid(&m, "share is not from 0 to 1");
    }
    m.waiting.share = 1;
    m.waiting.stage = LW_WAITING_UNKNOWN;
    expect_invalid(&m, "stage is not in 1..65535");
    m.waiting.stage = LW_MESSAGE_WAITING_STAGE_MAX + 1;
    expect_invalid(&m, "stage is not in 1..65535");
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
    expect_equal(&m, &read);
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
        cmocka_unit_test(test_round_trip),
        cmocka_unit_test(test_capacity),
        cmocka_unit_test(test_truncated),
        cmocka_unit_test(test_flipped_bits),
        cmocka_unit_test(test_texts),
        cmocka_unit_test(test_waiting),
        cmocka_unit_test(test_welcome),
        cmocka_unit_test(test_refusal_code),
        cmocka_unit_test(test_package),
        cmocka_unit_test(test_interest),
        cmocka_unit_test(test_frame_counts),
        cmocka_unit_test(test_frame_numbers),
        cmocka_unit_test(test_tile_numbers),
        cmocka_unit_test(test_fields),
        cmocka_unit_test(test_unknown_type),
        cmocka_unit_test(test_parts_of_finishes),
        cmocka_unit_test(test_memory_of_an_empty_list),
        cmocka_unit_test(test_memory_budget),
        cmocka_unit_test(test_out_of_memory),
        cmocka_unit_test(test_frame_state_counts),
        cmocka_unit_test(test_update_counts),
        cmocka_unit_test(test_updated_text),
        cmocka_unit_test(test_holds),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
