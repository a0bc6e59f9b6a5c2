#include "tests/support/message_case.h"

#include <stdlib.h>
#include <string.h>

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

void message_case_expect_equal(const struct lw_message *a, const struct lw_message *b) {
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
        assert_int_equal(a->frame.base, b->frame.base);
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

enum lw_status message_case_decode(enum lw_message_type type, const uint8_t *body, size_t size,
                                   struct lw_message *out, struct lw_error *err) {
    uint8_t *exact = malloc(size ? size : 1);
    assert_non_null(exact);
    if (size) memcpy(exact, body, size);
    struct lw_framing_header header = {.body_size = (uint32_t)size, .type = (uint16_t)type};
    enum lw_status status = lw_message_decode(header, exact, out, err);
    free(exact); /* the decoded message must not point into it */
    return status;
}

void message_case_expect(enum lw_message_type type, struct message_case_body *b, const char *text) {
    struct lw_message m;
    struct lw_error err = {0};
    enum lw_status status = message_case_decode(type, b->bytes, b->size, &m, &err);
    if (text) {
        lw_support_fails(status, LW_PROTOCOL, &err, text);
    } else {
        lw_support_ok(status, &err);
        lw_message_finish(&m);
    }
    free(b->bytes);
    *b = (struct message_case_body){0};
}

void message_case_expect_invalid(const struct lw_message *message, const char *text) {
    struct lw_error err = {0};
    size_t size = 0;
    static uint8_t bytes[LW_FRAMING_BODY_MAX];
    lw_support_fails(lw_message_validate(message, &err), LW_PROTOCOL, &err, text);
    assert_int_equal(lw_message_encode(message, bytes, sizeof bytes, &size), LW_INTERNAL);
    assert_int_equal(size, 0);
}
