/* Frames and tiles from any server, for a replica of a small scene with a spare. The input is one thing
 * after another: a byte that says what (a frame, a tile, a new run of the server, the channels), two for the
 * length, a message's body. */
#include "tests/support/support.h"

#include "client/lib/replica.h"
#include "common/scene/scene_spares.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static void require(bool condition) {
    if (!condition) abort();
}

static void make_package(uint8_t **out_package, size_t *out_size) {
    struct lw_scene *scene = lw_support_everything();
    for (uint32_t i = 0; i < scene->mesh_count; i++)
        if (scene->mesh[i].atlas_width) { /* several tiles across and down, the last ones cut off */
            scene->mesh[i].atlas_width = 140;
            scene->mesh[i].atlas_height = 72;
        }
    require(lw_scene_spares_add(scene, "1", NULL) == LW_OK);
    require(lw_package_write(scene, out_package, out_size, NULL) == LW_OK);
    lw_scene_destroy(scene);
}

/* What a renderer reads is never worse than wrong: finite, and not negative. */
static void check_light(const struct lw_replica *r) {
    const struct lw_atlas_map *map = lw_replica_atlas_map(r);
    for (uint32_t o = 0; o < map->object_count; o++) {
        (void)lw_replica_object_hidden(r, o);
        for (uint32_t l = 0; l < map->atlas[o]->level_count; l++) {
            const struct lw_client_level level = lw_replica_get_level(r, o, l);
            for (size_t i = 0; i < 3 * (size_t)level.width * level.height; i++)
                require(level.rgb[i] >= 0 && isfinite(level.rgb[i]) &&
                        (!level.direction || isfinite(level.direction[i])));
        }
    }
    for (uint32_t t = 0; t < map->tile_count; t++) /* a tile of another run has no version of this one */
        require(lw_replica_version_of_run(r, (lw_tile_id){t}) <=
                lw_replica_get_tile(r, (lw_tile_id){t}).version);
}

static void decode_and_apply(struct lw_replica *r, struct lw_framing_header header, const uint8_t *body,
                             struct lw_message_memory *memory) {
    struct lw_message m;
    if (lw_message_decode_with(header, body, memory, &m, NULL) != LW_OK) return;
    struct lw_error err = {0};
    enum lw_status status = LW_OK;
    if (m.type == LW_MESSAGE_FRAME) status = lw_replica_take_frame(r, &m.frame, &err);
    if (m.type == LW_MESSAGE_TILE) status = lw_replica_take_tile(r, &m.tile, &err);
    require(status == LW_OK || (status == LW_PROTOCOL && err.status == LW_PROTOCOL && *err.text));
    lw_message_finish(&m);
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size) {
    static uint8_t *package;
    static size_t package_size;
    if (!package) make_package(&package, &package_size);
    struct lw_replica *r;
    struct lw_message_memory memory = {0};
    require(lw_replica_create(package, package_size, 0, &r, NULL) == LW_OK);
    for (size_t at = 0; size - at >= 3;) {
        const uint8_t kind = bytes[at];
        size_t length = bytes[at + 1] | (size_t)bytes[at + 2] << 8;
        at += 3;
        if (length > size - at) length = size - at;
        if (kind == 0 || kind == 1) {
            const enum lw_message_type type = kind ? LW_MESSAGE_TILE : LW_MESSAGE_FRAME;
            decode_and_apply(
                r, (struct lw_framing_header){.body_size = (uint32_t)length, .type = (uint16_t)type},
                bytes + at, &memory);
        } else if (kind == 2) {
            lw_replica_begin_run(r);
        } else if (kind == 3) {
            const uint32_t channel = length & 1 ? LW_TILE_CHANNEL_SPLIT : LW_TILE_CHANNEL_FULL;
            uint32_t channels = lw_tile_channel_bit(channel);
            if (length & 2) channels |= lw_tile_channel_bit(LW_TILE_CHANNEL_DIRECTION + channel);
            if (lw_replica_set_channels(r, channels, NULL) != LW_OK) abort();
        } else {
            break;
        }
        at += kind < 2 ? length : 0;
    }
    check_light(r);
    lw_message_memory_finish(&memory);
    lw_replica_destroy(r);
    return 0;
}
