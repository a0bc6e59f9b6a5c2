/* A stream of framed messages from any server, as two sessions of a load test take its tiles, in turn. */
#include "client/load/tile_check.h"

#include <stdlib.h>
#include <string.h>

static void require(bool condition) {
    if (!condition) abort();
}

/* One mesh of 100 x 70 texels, used twice: two levels of several tiles, two of one. */
static void init_map(struct lw_atlas_map *map) {
    struct lw_mesh mesh = {.atlas_width = 100, .atlas_height = 70};
    struct lw_object object[2] = {{.mesh = 0}, {.mesh = 0}};
    struct lw_scene scene = {.mesh = &mesh, .mesh_count = 1, .object = object, .object_count = 2};
    require(lw_atlas_map_init(map, &scene) == LW_OK);
}

static void check_tile(struct lw_tile_check *check, const struct lw_atlas_map *map,
                       const struct lw_message_tile *tile, uint64_t *known, struct lw_tile_held *held) {
    struct lw_tile_finding f;
    require(lw_tile_check_take(check, tile, known, held, &f) == LW_OK);
    if (f.verdict == LW_TILE_NOWHERE) return;
    require(f.id.v < map->tile_count);
    require(known[f.id.v] == (f.verdict == LW_TILE_GOOD ? tile->version : f.before));
    require(f.verdict != LW_TILE_GOOD || tile->version > f.before);
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size) {
    struct lw_atlas_map map;
    struct lw_tile_check *check;
    init_map(&map);
    require(lw_tile_check_create(&map, false, &check) == LW_OK);
    uint64_t *known = calloc(2 * (size_t)map.tile_count, sizeof *known);
    struct lw_tile_held *held; /* the second session's */
    require(known != NULL && lw_tile_held_create(&map, &held) == LW_OK);
    struct lw_framing_header header;
    for (size_t at = 0, turn = 0; size - at >= LW_FRAMING_HEADER_SIZE; turn++) {
        struct lw_message message;
        if (lw_framing_read_header(bytes + at, LW_FRAMING_BODY_MAX, &header, NULL) != LW_OK) break;
        at += LW_FRAMING_HEADER_SIZE;
        if (header.body_size > size - at) break;
        const uint8_t *body = bytes + at;
        at += header.body_size;
        if (lw_message_decode(header, body, &message, NULL) != LW_OK) continue;
        if (message.type == LW_MESSAGE_TILE)
            check_tile(check, &map, &message.tile, known + turn % 2 * map.tile_count, turn % 2 ? held : NULL);
        lw_message_finish(&message);
    }
    free(known);
    lw_tile_held_destroy(held);
    lw_tile_check_destroy(check);
    lw_atlas_map_finish(&map);
    return 0;
}
