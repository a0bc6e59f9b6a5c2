#include "tests/support/support.h"

#include "common/base/waiting.h"
#include "common/tile/tile_codec.h"
#include "proto/message.h"

#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Bytes of protocol version 1 that must stay readable for ever, and bytes that must stay refused. Each file
 * is one framed message; LW_GOLDEN_WRITE=1 writes the valid ones again (then look at the difference: there
 * should be none). */

#define FOLDER "tests/golden/v1/"

static const uint8_t delta_payload[] = {2, 8, 0, 0, 0, 0x66, 0x48, 1, 0, 0}; /* one texel */
static const uint8_t tile_payload[] = {0x28, 0xb5, 0x2f, 0xfd, 0x20, 0x06, 0x31, 0,
                                       0,    0,    0,    0,    0x3c, 0x38, 0x34};
static const uint8_t direction_payload[] = {0x28, 0xb5, 0x2f, 0xfd, 0x20, 0x06, 0x31, 0,
                                            0,    0,    0,    0,    0x40, 0xbc, 0}; /* 2, -1, 0 */
static const struct lw_message_interest_tile seventeenth_objects[] = {{17, 0, 2}};
static const struct lw_message_interest_tile interest_tiles[] = {{0, 4, 0}, {17, 0, 35}};
static const struct lw_message_held held[] = {{17, 0, 2, 300}};
static const struct lw_message_held much_held[] = {{0, 4, 0, 1}, {17, 0, 35, 0x0123456789abcdef}};
static const struct lw_message_transform transforms[] = {
    {2, {{{1, 0, 0, 0.5f}, {0, 0, -1, 2}, {0, 1, 0, -3}}}}};
static const struct lw_message_light lights[] = {{1, {0, 2, 0}, {0, -1, 0}, {10, 20, 30}}};

static const uint32_t hidden[] = {3}, shown[] = {5, 6}, spares[] = {8, 9, 3}, added[] = {9},
                      added_two[] = {8, 9};
static const struct lw_message_material frame_materials[] = {{4, {0.5f, 0.25f, 1}, {0, 0, 2}}};
static const struct lw_scene_change two_changes[] = {{LW_SCENE_CHANGE_OBJECT_HIDE, 3, 0, {0}},
                                                     {LW_SCENE_CHANGE_LIGHT_INTENSITY, 1, 3, {10, 20, 40}}};
static const struct lw_scene_change every_change[] = {
    {LW_SCENE_CHANGE_OBJECT_TRANSFORM, 2, 12, {1, 0, 0, 0.5f, 0, 0, -1, 2, 0, 1, 0, -3}},
    {LW_SCENE_CHANGE_OBJECT_RESTORE, 2, 0, {0}},
    {LW_SCENE_CHANGE_OBJECT_HIDE, 2, 0, {0}},
    {LW_SCENE_CHANGE_OBJECT_SHOW, 2, 0, {0}},
    {LW_SCENE_CHANGE_LIGHT_INTENSITY, 1, 3, {10, 20, 40}},
    {LW_SCENE_CHANGE_LIGHT_POSITION, 1, 3, {0, 2, 0}},
    {LW_SCENE_CHANGE_LIGHT_DIRECTION, 1, 3, {0, -1, 0}},
    {LW_SCENE_CHANGE_LIGHT_RESTORE, 1, 0, {0}},
    {LW_SCENE_CHANGE_MATERIAL_BASE_COLOUR, 4, 3, {0.5f, 0.25f, 1}},
    {LW_SCENE_CHANGE_MATERIAL_EMISSION, 4, 3, {0, 0, 2}},
    {LW_SCENE_CHANGE_MATERIAL_RESTORE, 4, 0, {0}},
    {LW_SCENE_CHANGE_SKY, 0, 3, {0.25f, 0.5f, 1}},
    {LW_SCENE_CHANGE_SKY_RESTORE, 0, 0, {0}},
    {LW_SCENE_CHANGE_CLOCK_PAUSE, 0, 0, {0}},
    {LW_SCENE_CHANGE_CLOCK_PLAY, 0, 0, {0}},
    {LW_SCENE_CHANGE_CLOCK_SEEK, 0, 1, {12.5f}},
    {LW_SCENE_CHANGE_CLOCK_RATE, 0, 1, {-0.5f}},
    {LW_SCENE_CHANGE_RESET, 0, 0, {0}}};

static const struct lw_scene_change add_and_remove[] = {
    {LW_SCENE_CHANGE_OBJECT_ADD, 2, 12, {1, 0, 0, 0.5f, 0, 1, 0, 0, 0, 0, 1, -3}},
    {LW_SCENE_CHANGE_OBJECT_REMOVE, 3, 0, {0}}};

static const struct golden {
    const char *file;
    struct lw_message message;
} valid[] = {
    {"hello.bin", {.type = LW_MESSAGE_HELLO, .hello = {.version = 1, .name = "stranger"}}},
    {"hello_features.bin",
     {.type = LW_MESSAGE_HELLO, .hello = {.version = 1, .features = 1, .name = "stranger"}}},
    {"refusal_features.bin",
     {.type = LW_MESSAGE_REFUSAL, .refusal = {.code = LW_REFUSAL_FEATURES, .text = "tiles of codec 2"}}},
    {"welcome.bin",
     {.type = LW_MESSAGE_WELCOME,
      .welcome = {.version = 1,
                  .session = 42,
                  .name = "lightwelld 0.1.0",
                  .package_hash = {{0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 255}},
                  .package_size = 1000000,
                  .package_compressed_size = 300000,
                  .bounces = 2,
                  .target_error = 0.0625f}}},
    {"welcome_parts.bin",
     {.type = LW_MESSAGE_WELCOME,
      .welcome = {.version = 1,
                  .features = LW_FEATURE_PARTS,
                  .session = 42,
                  .name = "lightwelld 0.1.0",
                  .package_size = 1000000,
                  .package_compressed_size = 300000,
                  .part_size = (const uint64_t[]){600000, 400000},
                  .part_compressed_size = (const uint64_t[]){100000, 200000},
                  .part_hash = (const struct lw_package_hash[]){{{1, 2}}, {{3, 4}}},
                  .part_count = 2}}},
    {"package_request_held.bin",
     {.type = LW_MESSAGE_PACKAGE_REQUEST, .package_request = {65536, (const uint8_t[]){2}, 1}}},
    {"refusal.bin",
     {.type = LW_MESSAGE_REFUSAL,
      .refusal = {.code = LW_REFUSAL_FULL, .text = "the server has its 10000 sessions"}}},
    {"refusal_retry_after.bin",
     {.type = LW_MESSAGE_REFUSAL,
      .refusal = {.code = LW_REFUSAL_SHUTDOWN, .text = "the server ends", .retry_after_ms = 2000}}},
    {"refusal_unknown_code.bin",
     {.type = LW_MESSAGE_REFUSAL, .refusal = {.code = (enum lw_refusal)65535, .text = ""}}},
    {"package_request.bin", {.type = LW_MESSAGE_PACKAGE_REQUEST, .package_request.offset = 65536}},
    {"package_request_empty.bin", {.type = LW_MESSAGE_PACKAGE_REQUEST}},
    {"package_chunk.bin",
     {.type = LW_MESSAGE_PACKAGE_CHUNK, .package_chunk = {65536, tile_payload, sizeof tile_payload}}},
    {"interest_everything.bin", {.type = LW_MESSAGE_INTEREST, .interest = {.everything = true}}},
    {"interest_stand_ins.bin",
     {.type = LW_MESSAGE_INTEREST,
      .interest = {.stand_ins = true, .tile = seventeenth_objects, .tile_count = 1}}},
    {"interest_tiles.bin",
     {.type = LW_MESSAGE_INTEREST, .interest = {.tile = interest_tiles, .tile_count = 2}}},
    {"frame.bin",
     {.type = LW_MESSAGE_FRAME,
      .frame = {.frame = 300,
                .time_s = 12.5,
                .solve_ns = 16000000,
                .rays_total = 123456789,
                .tiles_solved = 77,
                .sky = {0.25f, 0.5f, 1},
                .transform = transforms,
                .transform_count = 1,
                .light = lights,
                .light_count = 1}}},
    {"frame_at_rest.bin", {.type = LW_MESSAGE_FRAME, .frame = {.frame = 1}}},
    {"tile.bin",
     {.type = LW_MESSAGE_TILE,
      .tile = {.object = 2,
               .level = 3,
               .version = 300,
               .codec = LW_TILE_CODEC_HALF_ZSTD,
               .scale = 4,
               .bounces = 2,
               .error = 0.125f,
               .payload = tile_payload,
               .payload_size = sizeof tile_payload}}},
    {"tile_delta.bin",
     {.type = LW_MESSAGE_TILE,
      .tile = {.object = 2,
               .level = 3,
               .version = 301,
               .codec = LW_TILE_CODEC_DCT,
               .scale = 0.125f,
               .bounces = 2,
               .error = 0.125f,
               .payload = delta_payload,
               .payload_size = sizeof delta_payload,
               .base = 300}}},
    {"frame_cpu.bin", {.type = LW_MESSAGE_FRAME, .frame = {.frame = 2, .server_cpu_ns = 1500000000}}},
    {"frame_base.bin", {.type = LW_MESSAGE_FRAME, .frame = {.frame = 7, .base = 5}}},
    {"frame_run.bin", {.type = LW_MESSAGE_FRAME, .frame = {.frame = 2, .run = 0x0123456789abcdef}}},
    {"hello_control.bin",
     {.type = LW_MESSAGE_HELLO,
      .hello = {.version = 1, .features = 1 | LW_FEATURE_CONTROL, .name = "stranger"}}},
    {"frame_state.bin",
     {.type = LW_MESSAGE_FRAME,
      .frame = {.frame = 3,
                .hidden = hidden,
                .hidden_count = 1,
                .shown = shown,
                .shown_count = 2,
                .material = frame_materials,
                .material_count = 1}}},
    {"update.bin", {.type = LW_MESSAGE_UPDATE, .update = {7, two_changes, 2}}},
    {"update_every_kind.bin", {.type = LW_MESSAGE_UPDATE, .update = {8, every_change, 18}}},
    {"update_empty.bin", {.type = LW_MESSAGE_UPDATE}},
    {"frame_spares.bin",
     {.type = LW_MESSAGE_FRAME,
      .frame = {.frame = 4,
                .hidden = spares,
                .hidden_count = 3,
                .spare_count = 2,
                .shown = shown,
                .shown_count = 1}}},
    {"update_add_remove.bin", {.type = LW_MESSAGE_UPDATE, .update = {8, add_and_remove, 2}}},
    {"updated_added.bin",
     {.type = LW_MESSAGE_UPDATED, .updated = {.request = 8, .frame = 301, .added = added, .added_count = 1}}},
    {"updated_added_two.bin",
     {.type = LW_MESSAGE_UPDATED,
      .updated = {.request = 9, .frame = 302, .added = added_two, .added_count = 2}}},
    {"updated.bin", {.type = LW_MESSAGE_UPDATED, .updated = {.request = 7, .frame = 300}}},
    {"updated_refused.bin",
     {.type = LW_MESSAGE_UPDATED,
      .updated =
          {.request = 8, .code = LW_SCENE_CHANGE_UNKNOWN_TARGET, .change = 1, .text = "no such light"}}},
    {"welcome_run.bin",
     {.type = LW_MESSAGE_WELCOME,
      .welcome = {.version = 1,
                  .features = 1 | LW_FEATURE_RESUME,
                  .session = 43,
                  .name = "lightwelld 0.1.0",
                  .package_hash = {{0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 255}},
                  .package_size = 1000000,
                  .package_compressed_size = 300000,
                  .bounces = 2,
                  .target_error = 0.0625f,
                  .run = 0xfedcba9876543210}}},
    {"hello_resume.bin",
     {.type = LW_MESSAGE_HELLO,
      .hello = {.version = 1, .features = 1 | LW_FEATURE_RESUME, .name = "stranger"}}},
    {"hello_rate_limit.bin",
     {.type = LW_MESSAGE_HELLO, .hello = {.version = 1, .name = "stranger", .rate_limit_bytes_hz = 125000}}},
    {"hello_token.bin",
     {.type = LW_MESSAGE_HELLO,
      .hello = {.version = 1,
                .features = LW_FEATURE_CONTROL,
                .name = "stranger",
                .token = (const uint8_t[]){0,    0x11, 0x22, 0x33, 0x44, 0x55, 0x66, 0x77, 0x88, 0x99, 0xaa,
                                           0xbb, 0xcc, 0xdd, 0xee, 0xff, 0,    1,    2,    3,    4,    5,
                                           6,    7,    8,    9,    10,   11,   12,   13,   14,   15}}}},
    {"hello_relay.bin",
     {.type = LW_MESSAGE_HELLO,
      .hello = {.version = 1,
                .features = LW_FEATURE_RESUME | LW_FEATURE_DCT,
                .name = "lightwell-relay 0.1.0",
                .relay = 0xfedcba9876543210}}},
    {"welcome_relays.bin",
     {.type = LW_MESSAGE_WELCOME,
      .welcome = {.version = 1,
                  .features = LW_FEATURE_RESUME | LW_FEATURE_DCT,
                  .session = 42,
                  .name = "lightwell-relay 0.1.0",
                  .package_hash = {{0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 255}},
                  .package_size = 1000000,
                  .package_compressed_size = 300000,
                  .run = 300,
                  .relays = (const uint64_t[]){17, 0xfedcba9876543210},
                  .relay_count = 2}}},
    {"welcome_servers.bin",
     {.type = LW_MESSAGE_WELCOME,
      .welcome = {.version = 1,
                  .features = LW_FEATURE_DCT,
                  .session = 42,
                  .name = "lightwelld 0.1.0",
                  .package_hash = {{0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 255}},
                  .package_size = 1000000,
                  .package_compressed_size = 300000,
                  .servers = "relay.example.org:7780,[2001:db8::1]:7780"}}},
    {"refusal_loop.bin",
     {.type = LW_MESSAGE_REFUSAL,
      .refusal = {.code = LW_REFUSAL_LOOP, .text = "this server's light comes through the relay that asks"}}},
    {"holds.bin", {.type = LW_MESSAGE_HOLDS, .holds = {held, 1, 0}}},
    {"holds_two.bin", {.type = LW_MESSAGE_HOLDS, .holds = {much_held, 2, 0}}},
    {"holds_frame.bin", {.type = LW_MESSAGE_HOLDS, .holds.frame = 300}},
    {"hello_draws.bin",
     {.type = LW_MESSAGE_HELLO,
      .hello = {.version = 1, .features = LW_FEATURE_DCT | LW_FEATURE_DRAWS, .name = "stranger"}}},
    {"welcome_draws.bin",
     {.type = LW_MESSAGE_WELCOME,
      .welcome = {.version = 1,
                  .features = LW_FEATURE_DCT | LW_FEATURE_DRAWS,
                  .session = 42,
                  .name = "lightwelld 0.1.0",
                  .package_hash = {{0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 255}},
                  .package_size = 1000000,
                  .package_compressed_size = 300000,
                  .bounces = 2,
                  .target_error = 0.0625f,
                  .client_lights = (const uint8_t[]){5, 2},
                  .client_lights_size = 2,
                  .client_materials = (const uint8_t[]){8},
                  .client_materials_size = 1}}},
    {"tile_split.bin",
     {.type = LW_MESSAGE_TILE,
      .tile = {.object = 2,
               .level = 3,
               .version = 300,
               .layer = LW_TILE_CHANNEL_SPLIT,
               .codec = LW_TILE_CODEC_HALF_ZSTD,
               .scale = 4,
               .bounces = 2,
               .error = 0.125f,
               .payload = tile_payload,
               .payload_size = sizeof tile_payload}}},
    {"hello_directions.bin",
     {.type = LW_MESSAGE_HELLO,
      .hello = {.version = 1, .features = LW_FEATURE_DCT | LW_FEATURE_DIRECTION, .name = "stranger"}}},
    {"welcome_directions.bin",
     {.type = LW_MESSAGE_WELCOME,
      .welcome = {.version = 1,
                  .features = LW_FEATURE_DCT | LW_FEATURE_DIRECTION,
                  .session = 42,
                  .name = "lightwelld 0.1.0",
                  .package_hash = {{0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 255}},
                  .package_size = 1000000,
                  .package_compressed_size = 300000,
                  .bounces = 2,
                  .target_error = 0.0625f}}},
    {"tile_direction.bin",
     {.type = LW_MESSAGE_TILE,
      .tile = {.object = 2,
               .level = 3,
               .version = 300,
               .layer = LW_TILE_CHANNEL_DIRECTION,
               .codec = LW_TILE_CODEC_HALF_ZSTD,
               .scale = 0.25f,
               .bounces = 2,
               .error = 0.125f,
               .payload = direction_payload,
               .payload_size = sizeof direction_payload}}},
    {"tile_direction_split.bin",
     {.type = LW_MESSAGE_TILE,
      .tile = {.object = 2,
               .level = 3,
               .version = 301,
               .layer = LW_TILE_CHANNEL_DIRECTION_SPLIT,
               .codec = LW_TILE_CODEC_DCT,
               .scale = 0.125f,
               .bounces = 2,
               .error = 0.125f,
               .payload = delta_payload,
               .payload_size = sizeof delta_payload,
               .base = 300}}},
    {"settled.bin", {.type = LW_MESSAGE_SETTLED, .settled = {300}}},
    {"ack.bin", {.type = LW_MESSAGE_ACK, .ack = {300}}},
    {"hello_operate.bin",
     {.type = LW_MESSAGE_HELLO,
      .hello = {.version = 1, .features = LW_FEATURE_CONTROL | LW_FEATURE_OPERATE, .name = "operator"}}},
    {"ask_stats.bin", {.type = LW_MESSAGE_ASK, .ask = {7, LW_ASK_STATS, 0}}},
    {"ask_drain.bin", {.type = LW_MESSAGE_ASK, .ask = {8, LW_ASK_DRAIN, 30000}}},
    {"report.bin",
     {.type = LW_MESSAGE_REPORT,
      .report = {7, LW_REPORT_DONE, (const uint8_t *)"lightwell_sessions 3\n", 21}}},
    {"report_empty.bin", {.type = LW_MESSAGE_REPORT, .report = {.request = 8}}},
    {"report_unknown.bin", {.type = LW_MESSAGE_REPORT, .report = {9, LW_REPORT_UNKNOWN, NULL, 0}}},
    {"waiting.bin", {.type = LW_MESSAGE_WAITING, .waiting = {LW_WAITING_LOOKING_INSIDE, 0.25f}}},
    {"waiting_none_done.bin", {.type = LW_MESSAGE_WAITING, .waiting = {LW_WAITING_PLACING_TEXELS, 0}}},
    {"waiting_ready.bin", {.type = LW_MESSAGE_WAITING, .waiting = {LW_WAITING_READY, 1}}},
    {"waiting_unknown_stage.bin", {.type = LW_MESSAGE_WAITING, .waiting = {65535, 0.5f}}},
    {"hello_materials.bin",
     {.type = LW_MESSAGE_HELLO,
      .hello = {.version = 1, .features = LW_FEATURE_PARTS | LW_FEATURE_MATERIALS, .name = "stranger"}}},
    {"welcome_finishes.bin",
     {.type = LW_MESSAGE_WELCOME,
      .welcome = {.version = 1,
                  .features = LW_FEATURE_MATERIALS,
                  .session = 42,
                  .name = "lightwelld 0.1.0",
                  .package_hash = {{0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 255}},
                  .package_size = 1000000,
                  .package_compressed_size = 300000,
                  .bounces = 2,
                  .target_error = 0.0625f,
                  .finish = {.hash = {{16, 17, 18, 19, 20, 21, 22, 23, 24, 25, 26, 27, 28, 29, 30, 254}},
                             .size = 3000,
                             .compressed_size = 1100,
                             .part_size = (const uint64_t[]){1000, 2000},
                             .part_compressed_size = (const uint64_t[]){300, 800},
                             .part_hash = (const struct lw_package_hash[]){{{1, 2}}, {{3, 4}}},
                             .part_count = 2}}}},
    {"welcome_finer.bin",
     {.type = LW_MESSAGE_WELCOME,
      .welcome = {.version = 1,
                  .features = LW_FEATURE_FINER,
                  .session = 42,
                  .name = "lightwelld 0.1.0",
                  .package_hash = {{0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 255}},
                  .package_size = 1000000,
                  .package_compressed_size = 300000,
                  .bounces = 2,
                  .target_error = 0.0625f,
                  .finer = 2}}},
    {"tile_gone.bin",
     {.type = LW_MESSAGE_TILE,
      .tile = {.object = 2,
               .level = LW_ATLAS_FINER + 2,
               .tile = 5,
               .version = 302,
               .codec = LW_TILE_CODEC_NONE,
               .scale = 1,
               .payload = (const uint8_t[]){0},
               .payload_size = 1}}},
    {"finish_request.bin", {.type = LW_MESSAGE_FINISH_REQUEST, .finish_request.offset = 65536}},
    {"finish_request_held.bin",
     {.type = LW_MESSAGE_FINISH_REQUEST, .finish_request = {0, (const uint8_t[]){2}, 1}}},
    {"finish_chunk.bin",
     {.type = LW_MESSAGE_FINISH_CHUNK, .finish_chunk = {300, tile_payload, sizeof tile_payload}}},
    {"ping.bin", {.type = LW_MESSAGE_PING, .ping = {0x0123456789abcdef}}},
    {"pong.bin", {.type = LW_MESSAGE_PONG, .pong = {0x0123456789abcdef}}},
};

/* Written by hand, so that no encoder can refuse them: header and body in hex, and what the refusal says. */
static const struct {
    const char *file, *hex, *text;
} invalid[] = {
    {"invalid_header_too_long.bin", "01001000 0700 0000", "over the limit"},
    {"invalid_header_flags.bin", "00000000 0a00 0100", "flags"},
    {"invalid_type.bin", "00000000 ff00 0000", "unknown"},
    {"invalid_protobuf.bin", "01000000 0900 0000 ff", "is no protobuf"},
    {"invalid_wire_type.bin", "05000000 0900 0000 0d00000000", "wrong type"},
    {"invalid_hello_name.bin", "05000000 0100 0000 1a031b5b4a", "name is not UTF-8"},
    {"invalid_hello_token.bin", "05000000 0100 0000 2a03010203", "token is not 32 bytes"},
    {"invalid_welcome_parts.bin",
     "3e000000 0200 0000 0801 2a10 00000000000000000000000000000000 3009 3802 "
     "5a08 0800000000000000 6208 0200000000000000 6a10 00000000000000000000000000000000",
     "is not package_size in all"},
    {"invalid_welcome_parts_lengths.bin",
     "2c000000 0200 0000 0801 2a10 00000000000000000000000000000000 3009 3802 "
     "5a08 0800000000000000 6208 0200000000000000",
     "differ in length"},
    {"invalid_welcome_client_lights.bin",
     "1d000000 0200 0000 0801 2a10 00000000000000000000000000000000 3009 3802 7d00000080", "wrong type"},
    {"invalid_welcome_finish_parts.bin",
     "5a000000 0200 0000 0801 2a10 00000000000000000000000000000000 3009 3802 "
     "8a0110 00000000000000000000000000000000 900109 980102 "
     "a20108 0800000000000000 aa0108 0200000000000000 b20110 00000000000000000000000000000000",
     "is not finish_size in all"},
    {"invalid_welcome_finer.bin",
     "1b000000 0200 0000 0801 2a10 00000000000000000000000000000000 3009 3802 c80105", "finer is over 4"},
    {"invalid_welcome_finish_hash.bin",
     "1e000000 0200 0000 0801 2a10 00000000000000000000000000000000 3009 3802 900109 980102",
     "finish_hash is not 16 bytes"},
    {"invalid_welcome_finish_none.bin",
     "2b000000 0200 0000 0801 2a10 00000000000000000000000000000000 3009 3802 "
     "8a0110 00000000000000000000000000000000",
     "finish_hash is not 16 bytes, or there without"},
    {"invalid_welcome_relays.bin",
     "a4000000 0200 0000 0801 2a10 00000000000000000000000000000000 3009 3802 ba018801 "
     "0100000000000000 0200000000000000 0300000000000000 0400000000000000 0500000000000000 "
     "0600000000000000 0700000000000000 0800000000000000 0900000000000000 0a00000000000000 "
     "0b00000000000000 0c00000000000000 0d00000000000000 0e00000000000000 0f00000000000000 "
     "1000000000000000 1100000000000000",
     "relays has over 16 entries"},
    {"invalid_finish_chunk_empty.bin", "02000000 1400 0000 0801", "data"},
    {"invalid_ask_return_after.bin", "07000000 1000 0000 1002 18 81dddb01",
     "return_after_ms is over 3600000"},
    {"invalid_report_code.bin", "05000000 1100 0000 1001 1a0141", "data is there though it is refused"},
    {"invalid_refusal_code.bin", "00000000 0300 0000", "code"},
    {"invalid_refusal_retry_after.bin", "07000000 0300 0000 0804 1881dddb01", "retry_after_ms"},
    {"invalid_chunk_empty.bin", "02000000 0500 0000 0801", "data"},
    {"invalid_interest_lengths.bin", "06000000 0600 0000 120400000000", "differ in length"},
    {"invalid_interest_both.bin", "14000000 0600 0000 0801 120400000000 1a0400000000 220400000000",
     "everything"},
    {"invalid_frame_sky.bin", "02000000 0700 0000 0801", "sky is not 3 values"},
    {"invalid_frame_nan.bin", "10000000 0700 0000 0801 320c 0000c07f 00000000 00000000", "sky is not finite"},
    {"invalid_frame_transform.bin", "16000000 0700 0000 0801 320c 00000000 00000000 00000000 3a04 00000000",
     "12 values"},
    {"invalid_frame_material.bin", "17000000 0700 0000 0801 320c 00000000 00000000 00000000 820104 00000000",
     "3 values for each material"},
    {"invalid_frame_spares.bin",
     "1d000000 0700 0000 0801 320c 00000000 00000000 00000000 7208 0800000009000000 980103",
     "spares is over the length"},
    {"invalid_updated_added.bin", "0a000000 0e00 0000 0807 1008 3204 09000000", "though it is refused"},
    {"invalid_update_lengths.bin", "06000000 0d00 0000 120403000000", "differ in length"},
    {"invalid_update_values.bin", "12000000 0d00 0000 12040c000000 1a0400000000 220403000000", "shorter"},
    {"invalid_holds_lengths.bin", "12000000 0f00 0000 0a0411000000 120400000000 1a0402000000",
     "differ in length"},
    {"invalid_waiting_stage.bin", "05000000 1200 0000 15 0000803e", "stage is not in 1..65535"},
    {"invalid_waiting_share.bin", "07000000 1200 0000 0802 15 0000c03f", "share is not from 0 to 1"},
    {"invalid_settled.bin", "00000000 0c00 0000", "frame is 0"},
    {"invalid_tile_scale.bin", "06000000 0800 0000 2001 3001 5200", "scale"},
    {"invalid_tile_payload.bin", "09000000 0800 0000 2001 3001 3d00008040", "payload"},
};

static size_t parse_hex(const char *hex, uint8_t *dst) {
    size_t size = 0;
    for (; *hex; hex++) {
        if (isspace((unsigned char)*hex)) continue;
        unsigned byte;
        assert_int_equal(sscanf(hex, "%2x", &byte), 1);
        dst[size++] = (uint8_t)byte;
        hex++;
    }
    return size;
}

static const char *path_of(const char *file) {
    static char relative[300];
    snprintf(relative, sizeof relative, FOLDER "%s", file);
    return lw_support_source(relative);
}

static enum lw_status decode(const uint8_t *bytes, size_t size, struct lw_message *out,
                             struct lw_error *err) {
    struct lw_framing_header header;
    assert_true(size >= LW_FRAMING_HEADER_SIZE);
    enum lw_status status = lw_framing_read_header(bytes, LW_FRAMING_BODY_MAX, &header, err);
    if (status != LW_OK) return status;
    assert_int_equal(header.body_size, size - LW_FRAMING_HEADER_SIZE);
    return lw_message_decode(header, bytes + LW_FRAMING_HEADER_SIZE, out, err);
}

static void test_valid(void **state) {
    (void)state;
    for (size_t i = 0; i < sizeof valid / sizeof *valid; i++) {
        uint8_t *ours;
        size_t our_size, size;
        lw_support_ok(lw_message_encode_alloc(&valid[i].message, &ours, &our_size), NULL);
        if (getenv("LW_GOLDEN_WRITE")) lw_support_write_file(path_of(valid[i].file), ours, our_size);
        uint8_t *bytes = lw_support_read_file(path_of(valid[i].file), &size), *again;
        struct lw_message m;
        struct lw_error err = {0};
        lw_support_ok(decode(bytes, size, &m, &err), &err);
        assert_int_equal(m.type, valid[i].message.type);
        /* what the file says, in today's bytes, is what the message says in today's bytes */
        lw_support_ok(lw_message_encode_alloc(&m, &again, &size), NULL);
        assert_int_equal(size, our_size);
        assert_memory_equal(again, ours, size);
        lw_message_finish(&m);
        free(again);
        free(bytes);
        free(ours);
    }
}

static void test_invalid(void **state) {
    (void)state;
    for (size_t i = 0; i < sizeof invalid / sizeof *invalid; i++) {
        uint8_t expected[200];
        size_t expected_size = parse_hex(invalid[i].hex, expected), size;
        if (getenv("LW_GOLDEN_WRITE"))
            lw_support_write_file(path_of(invalid[i].file), expected, expected_size);
        uint8_t *bytes = lw_support_read_file(path_of(invalid[i].file), &size);
        assert_int_equal(size, expected_size);
        assert_memory_equal(bytes, expected, size);
        struct lw_message m;
        struct lw_error err = {0};
        lw_support_fails(decode(bytes, size, &m, &err), LW_PROTOCOL, &err, invalid[i].text);
        free(bytes);
    }
}

/* No file that nobody reads. */
static void test_folder(void **state) {
    (void)state;
    assert_int_equal(lw_support_count_files(FOLDER),
                     sizeof valid / sizeof *valid + sizeof invalid / sizeof *invalid);
}

/* Reads the n-th hex listing of wire_format.md: hex digits up to the two spaces before the explanation. */
static size_t read_example(const char *document, unsigned n, uint8_t *dst) {
    const char *at = strstr(document, "## 8. Examples");
    assert_non_null(at);
    for (unsigned i = 0; i < 2 * n + 1; i++) { /* fences come in pairs */
        at = strstr(at, "```\n");
        assert_non_null(at);
        at += 4;
    }
    size_t size = 0;
    while (strncmp(at, "```", 3) != 0) {
        /* after the bytes of a line comes a word that is not two hex digits */
        for (const char *word = at; *word != '\n';) {
            while (*word == ' ') word++;
            size_t length = strcspn(word, " \n");
            if (length != 2 || !isxdigit((unsigned char)word[0]) || !isxdigit((unsigned char)word[1])) break;
            unsigned byte;
            assert_int_equal(sscanf(word, "%2x", &byte), 1);
            dst[size++] = (uint8_t)byte;
            word += length;
        }
        at = strchr(at, '\n') + 1;
    }
    return size;
}

static void test_examples_of_the_document(void **state) {
    (void)state;
    static const char *const file[] = {"hello.bin",
                                       "tile.bin",
                                       "tile_delta.bin",
                                       "settled.bin",
                                       "interest_stand_ins.bin",
                                       "ack.bin",
                                       "update.bin",
                                       "updated.bin",
                                       "update_add_remove.bin",
                                       "updated_added.bin",
                                       "hello_draws.bin",
                                       "welcome_draws.bin",
                                       "tile_split.bin",
                                       "holds.bin",
                                       "holds_frame.bin",
                                       "waiting.bin",
                                       "hello_materials.bin",
                                       "welcome_finishes.bin",
                                       "finish_request_held.bin",
                                       "hello_directions.bin",
                                       "welcome_directions.bin",
                                       "tile_direction.bin",
                                       "tile_direction_split.bin"};
    size_t size;
    char *document = (char *)lw_support_read_file(lw_support_source("proto/wire_format.md"), &size);
    for (unsigned i = 0; i < sizeof file / sizeof *file; i++) {
        uint8_t expected[200];
        size_t expected_size = read_example(document, i, expected);
        uint8_t *bytes = lw_support_read_file(path_of(file[i]), &size);
        assert_int_equal(size, expected_size);
        assert_memory_equal(bytes, expected, size);
        free(bytes);
    }
    free(document);
}

/* The example's tile says what the document says it does. */
static void test_tile_payload(void **state) {
    (void)state;
    struct lw_tile_codec *codec;
    float rgb[3];
    lw_support_ok(lw_tile_codec_create(&codec), NULL);
    lw_support_ok(lw_tile_codec_decode(codec, NULL, LW_TILE_CODEC_HALF_ZSTD, tile_payload,
                                       sizeof tile_payload, 4, 1, 1, NULL, rgb),
                  NULL);
    assert_true(rgb[0] == 4 && rgb[1] == 2 && rgb[2] == 1);
    static struct lw_tile_dct_coefficients coefficients; /* black */
    lw_support_ok(lw_tile_codec_decode_delta(codec, NULL, LW_TILE_CODEC_DCT, delta_payload,
                                             sizeof delta_payload, 0.125f, 1, 1, &coefficients, rgb),
                  NULL);
    for (int c = 0; c < 3; c++) assert_true(fabsf(rgb[c] - 0.125f) < 1e-6f);
    lw_tile_codec_destroy(codec);
}

/* The same payloads as directions: three planes of either sign. */
static void test_direction_payload(void **state) {
    (void)state;
    const struct lw_tile_channel *channel = lw_tile_channel_at(LW_TILE_CHANNEL_DIRECTION);
    struct lw_tile_codec *codec;
    float r[3];
    lw_support_ok(lw_tile_codec_create(&codec), NULL);
    lw_support_ok(lw_tile_codec_decode(codec, channel, LW_TILE_CODEC_HALF_ZSTD, direction_payload,
                                       sizeof direction_payload, 0.25f, 1, 1, NULL, r),
                  NULL);
    assert_true(r[0] == 0.5f && r[1] == -0.25f && r[2] == 0);
    assert_int_equal(lw_tile_codec_decode(codec, NULL, LW_TILE_CODEC_HALF_ZSTD, direction_payload,
                                          sizeof direction_payload, 0.25f, 1, 1, NULL, r),
                     LW_BAD_DATA); /* light has no sign */
    static struct lw_tile_dct_coefficients coefficients;
    lw_support_ok(lw_tile_codec_decode_delta(codec, channel, LW_TILE_CODEC_DCT, delta_payload,
                                             sizeof delta_payload, 0.125f, 1, 1, &coefficients, r),
                  NULL);
    assert_true(fabsf(r[0] - 0.125f) < 1e-6f && r[1] == 0 && r[2] == 0);
    lw_tile_codec_destroy(codec);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_valid),        cmocka_unit_test(test_invalid),
        cmocka_unit_test(test_folder),       cmocka_unit_test(test_examples_of_the_document),
        cmocka_unit_test(test_tile_payload), cmocka_unit_test(test_direction_payload),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
