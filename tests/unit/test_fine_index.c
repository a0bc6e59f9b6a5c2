/* Tiles of finer levels in snapshots, by name: an id is another tile's in a later snapshot. */
#include "tests/support/support.h"

#include "common/tile/tile_codec.h"
#include "server/nats/fine_index.h"

#define ROOM  4u
#define LEVEL (LW_ATLAS_FINER + 1)

static struct lw_scene *scene;
static struct lw_atlas_map map;
static struct lw_fine_index index_;

static int begin(void **state) {
    (void)state;
    scene = lw_support_squares(2, 1);
    for (uint32_t i = 0; i < scene->mesh_count; i++)
        scene->mesh[i].atlas_width = scene->mesh[i].atlas_height = 256;
    lw_support_ok(lw_atlas_map_init_finer(&map, scene, 1, ROOM), NULL);
    lw_fine_index_init(&index_, &map);
    return 0;
}

static int end(void **state) {
    (void)state;
    lw_fine_index_finish(&index_);
    lw_atlas_map_finish(&map);
    lw_scene_destroy(scene);
    return 0;
}

static uint64_t name_of(uint32_t object, uint32_t tile) {
    return lw_atlas_map_name_tile(&map, object, LEVEL, tile);
}

static struct lw_snapshot *make_snapshot(uint64_t frame) {
    struct lw_snapshot *snapshot;
    lw_support_ok(lw_snapshot_create(map.tile_count, 1, &snapshot), NULL);
    snapshot->frame = frame;
    return snapshot;
}

static void put(struct lw_snapshot *snapshot, uint32_t place, uint32_t object, uint32_t tile,
                uint64_t version) {
    static const uint8_t nothing = 0;
    const struct lw_message message = {.type = LW_MESSAGE_TILE,
                                       .tile = {.object = object,
                                                .level = LEVEL,
                                                .tile = tile,
                                                .version = version,
                                                .codec = LW_TILE_CODEC_NONE,
                                                .scale = 1,
                                                .payload = &nothing,
                                                .payload_size = 1}};
    struct lw_snapshot_tile *t = &snapshot->tile[0][map.plain_count + place];
    lw_support_ok(lw_blob_from_message(&message, &t->blob), NULL);
    t->version = version;
}

static void keep(struct lw_snapshot *snapshot, uint32_t place, const struct lw_snapshot *before) {
    const struct lw_snapshot_tile *was = &before->tile[0][map.plain_count + place];
    snapshot->tile[0][map.plain_count + place] =
        (struct lw_snapshot_tile){.version = was->version, .blob = lw_blob_ref(was->blob)};
}

static void ids_go_to_other_tiles(void **state) {
    (void)state;
    struct lw_snapshot *first = make_snapshot(5), *second = make_snapshot(6);
    put(first, 0, 0, 3, 10);
    put(first, 1, 1, 2, 8);
    put(first, 2, 1, 1, 10);
    lw_support_ok(lw_fine_index_follow(&index_, 0, NULL, first), NULL);
    assert_int_equal(lw_fine_index_find(&index_, name_of(0, 3)), map.plain_count);
    assert_int_equal(lw_fine_index_find(&index_, name_of(1, 2)), map.plain_count + 1);
    assert_int_equal(lw_fine_index_find(&index_, name_of(0, 0)), LW_FINE_INDEX_NONE);
    for (uint32_t i = 0; i < ROOM; i++) assert_int_equal(index_.tile[i].had, 0);
    put(second, 0, 1, 3, 12); /* another tile */
    keep(second, 1, first);
    put(second, 2, 1, 1, 12); /* a new version */
    put(second, 3, 1, 2, 6);  /* an old withdrawal of the tile at place 1 */
    lw_support_ok(lw_fine_index_follow(&index_, 0, first, second), NULL);
    assert_int_equal(index_.tile[0].had, 0); /* what relays have is none of its versions */
    assert_int_equal(index_.tile[0].name, name_of(1, 3));
    assert_int_equal(index_.tile[0].object, 1);
    assert_int_equal(index_.tile[0].level, LEVEL);
    assert_int_equal(index_.tile[1].had, 8);
    assert_int_equal(index_.tile[2].had, 10);
    assert_int_equal(lw_fine_index_find(&index_, name_of(0, 3)), LW_FINE_INDEX_NONE);
    assert_int_equal(lw_fine_index_find(&index_, name_of(1, 2)), map.plain_count + 1); /* the newest */
    lw_snapshot_unref(first);
    lw_snapshot_unref(second);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test_setup_teardown(ids_go_to_other_tiles, begin, end)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
