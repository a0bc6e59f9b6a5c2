#include "tests/support/support.h"

#include "common/tile/tile_codec.h"
#include "server/publish/light_store.h"
#include "server/publish/saved_light.h"

#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <xxhash.h>

#define FRAME        41u
#define TARGET_ERROR 0.02f
#define CHANNELS                                                                                             \
    (1u << LW_TILE_CHANNEL_FULL | 1u << LW_TILE_CHANNEL_SPLIT | 1u << LW_TILE_CHANNEL_DIRECTION |            \
     1u << LW_TILE_CHANNEL_DIRECTION_SPLIT)

static const uint8_t key[LW_SAVED_LIGHT_KEY_SIZE] = "sixteen bytes..",
                     other_key[LW_SAVED_LIGHT_KEY_SIZE] = "and others";

struct world {
    struct lw_scene *scene;
    struct lw_atlas_map map;
    struct lw_snapshot *snapshot;
    const char *path;
};

static struct lw_blob *blob_of(const struct lw_message *message) {
    struct lw_blob *blob;
    lw_support_ok(lw_blob_from_message(message, &blob), NULL);
    return blob;
}

static struct lw_blob *tile_blob(uint32_t object, uint32_t channel, float error) {
    return blob_of(&(struct lw_message){.type = LW_MESSAGE_TILE,
                                        .tile = {.object = object,
                                                 .layer = channel,
                                                 .version = FRAME - 1,
                                                 .codec = LW_TILE_CODEC_HALF_ZSTD,
                                                 .scale = 1,
                                                 .bounces = 2,
                                                 .error = error,
                                                 .payload = (const uint8_t *)"light",
                                                 .payload_size = 5}});
}

/* A frame of two messages; light for all objects but the last. The first has all channels. */
static int init_world(void **state) {
    static struct world w;
    w = (struct world){.scene = lw_support_squares(3, 1), .path = lw_support_temporary("shown")};
    w.scene->mesh[0].atlas_width = w.scene->mesh[0].atlas_height = 64;
    lw_support_ok(lw_atlas_map_init(&w.map, w.scene), NULL);
    lw_support_ok(lw_snapshot_create(w.map.tile_count, CHANNELS, &w.snapshot), NULL);
    struct lw_message frame = {
        .type = LW_MESSAGE_FRAME,
        .frame = {.frame = FRAME, .rays_total = 1000, .server_cpu_ns = 2000, .time_s = 7}};
    struct lw_blob *one = blob_of(&frame);
    lw_support_ok(lw_blob_create(2 * one->size, &w.snapshot->frame_full), NULL);
    memcpy(w.snapshot->frame_full->bytes, one->bytes, one->size);
    memcpy(w.snapshot->frame_full->bytes + one->size, one->bytes, one->size);
    lw_blob_unref(one);
    w.snapshot->frame = FRAME;
    for (uint32_t o = 0; o < 2; o++) {
        const uint32_t id = lw_atlas_map_find(&w.map, o, 0, 0, 0).v;
        w.snapshot->tile[LW_TILE_CHANNEL_FULL][id] = (struct lw_snapshot_tile){
            .version = FRAME - 1, .blob = tile_blob(o, LW_TILE_CHANNEL_FULL, 0.01f + (float)o)};
    }
    for (uint32_t channel = LW_TILE_CHANNEL_SPLIT; channel <= LW_TILE_CHANNEL_DIRECTION_SPLIT; channel++)
        w.snapshot->tile[channel][lw_atlas_map_find(&w.map, 0, 0, 0, 0).v] =
            (struct lw_snapshot_tile){.version = FRAME - 1, .blob = tile_blob(0, channel, 0.01f)};
    *state = &w;
    return 0;
}

static int finish_world(void **state) {
    struct world *w = *state;
    lw_snapshot_unref(w->snapshot);
    lw_atlas_map_finish(&w->map);
    lw_scene_destroy(w->scene);
    return 0;
}

static void decode(const struct lw_blob *blob, struct lw_message *out_message, size_t *out_size) {
    struct lw_framing_header header;
    lw_support_ok(lw_framing_read_header(blob->bytes, LW_FRAMING_BODY_MAX, &header, NULL), NULL);
    lw_support_ok(lw_message_decode(header, blob->bytes + LW_FRAMING_HEADER_SIZE, out_message, NULL), NULL);
    *out_size = LW_FRAMING_HEADER_SIZE + header.body_size;
}

static struct lw_snapshot *keep_and_load(const struct world *w, bool steady) {
    struct lw_error err = {0};
    struct lw_snapshot *again;
    lw_support_ok(lw_saved_light_save(w->path, key, w->snapshot, steady, &err), &err);
    lw_support_ok(lw_saved_light_load(w->path, key, &w->map, TARGET_ERROR, &again, &err), &err);
    return again;
}

static float error_of(const struct lw_snapshot *snapshot, uint32_t id) {
    struct lw_message tile;
    size_t size;
    decode(snapshot->tile[LW_TILE_CHANNEL_FULL][id].blob, &tile, &size);
    const float error = tile.tile.error;
    lw_message_finish(&tile);
    return error;
}

static void steady_light_comes_back_as_it_was(void **state) {
    const struct world *w = *state;
    struct lw_snapshot *again = keep_and_load(w, true);
    assert_int_equal(again->frame, FRAME);
    assert_non_null(again->settled);
    assert_null(again->frame_delta);
    assert_int_equal(again->channels, CHANNELS);
    LW_TILE_CHANNELS_EACH (f, CHANNELS)
        for (uint32_t i = 0; i < w->map.tile_count; i++) {
            const struct lw_snapshot_tile *is = &again->tile[f][i], *was = &w->snapshot->tile[f][i];
            assert_int_equal(is->version, was->version);
            assert_true(!is->blob == !was->blob);
            if (!is->blob) continue;
            assert_int_equal(is->blob->size, was->blob->size);
            assert_memory_equal(is->blob->bytes, was->blob->bytes, is->blob->size);
        }
    struct lw_message frame;
    size_t size;
    decode(again->frame_full, &frame, &size);
    assert_int_equal(again->frame_full->size, 2 * size);
    assert_true(frame.frame.frame == FRAME && frame.frame.time_s == 7);
    assert_true(frame.frame.rays_total == 0 &&
                frame.frame.server_cpu_ns == 0); /* this process has used none yet */
    lw_message_finish(&frame);
    lw_snapshot_unref(again);
}

static void other_light_does_not_count_as_converged(void **state) {
    const struct world *w = *state;
    struct lw_snapshot *again = keep_and_load(w, false);
    assert_null(again->settled);
    assert_true(error_of(again, lw_atlas_map_find(&w->map, 0, 0, 0, 0).v) == 2 * TARGET_ERROR);
    assert_true(error_of(again, lw_atlas_map_find(&w->map, 1, 0, 0, 0).v) == 1.01f);
    lw_snapshot_unref(again);
}

static void refused(const struct world *w, const uint8_t wanted_key[LW_SAVED_LIGHT_KEY_SIZE],
                    const char *text) {
    struct lw_error err = {0};
    struct lw_snapshot *again = NULL;
    lw_support_fails(lw_saved_light_load(w->path, wanted_key, &w->map, TARGET_ERROR, &again, &err),
                     LW_BAD_DATA, &err, text);
    assert_non_null(strstr(err.text, w->path));
    assert_null(again);
}

static void what_does_not_fit_is_refused(void **state) {
    const struct world *w = *state;
    struct lw_error err = {0};
    struct lw_snapshot *again;
    assert_int_equal(lw_saved_light_load("/nonexistent/shown", key, &w->map, TARGET_ERROR, &again, &err),
                     LW_NO_INPUT);
    lw_support_ok(lw_saved_light_save(w->path, key, w->snapshot, true, NULL), NULL);
    refused(w, other_key, "is of another scene, of other options or of another release");
    size_t size;
    uint8_t *bytes = lw_support_read_file(w->path, &size);
    for (size_t cut = 0; cut < size; cut++) {
        lw_support_write_file(w->path, bytes, cut);
        refused(w, key, "");
    }
    for (size_t i = 0; i < size; i++) {
        bytes[i] ^= 0x10;
        lw_support_write_file(w->path, bytes, size);
        refused(w, key, "");
        bytes[i] ^= 0x10;
    }
    free(bytes);
}

#define CHANNELS_AT 16 /* in a file's header, after kind and steady */

/* Behind a checksum that is right. */
static void what_is_written_wrongly_is_refused(void **state) {
    const struct world *w = *state;
    lw_support_ok(lw_saved_light_save(w->path, key, w->snapshot, true, NULL), NULL);
    size_t size;
    uint8_t *bytes = lw_support_read_file(w->path, &size);
    unsigned accepted = 0;
    for (size_t i = 0; i + sizeof(uint64_t) < size; i++)
        for (unsigned bit = 0; bit < 8; bit++) {
            struct lw_snapshot *again;
            bytes[i] ^= (uint8_t)(1u << bit);
            const uint64_t checksum = XXH3_64bits(bytes, size - sizeof checksum);
            memcpy(bytes + size - sizeof checksum, &checksum, sizeof checksum);
            lw_support_write_file(w->path, bytes, size);
            if (lw_saved_light_load(w->path, key, &w->map, TARGET_ERROR, &again, NULL) == LW_OK) {
                accepted++; /* other light, legal all the same */
                assert_non_null(again->frame_full);
                lw_snapshot_unref(again);
            }
            bytes[i] ^= (uint8_t)(1u << bit);
        }
    assert_true(accepted > 0 && accepted < 8 * size / 2);
    free(bytes);
    const uint32_t first = lw_atlas_map_find(&w->map, 0, 0, 0, 0).v,
                   second = lw_atlas_map_find(&w->map, 1, 0, 0, 0).v;
    lw_blob_unref(w->snapshot->tile[LW_TILE_CHANNEL_FULL][second].blob);
    w->snapshot->tile[LW_TILE_CHANNEL_FULL][second].blob =
        lw_blob_ref(w->snapshot->tile[LW_TILE_CHANNEL_FULL][first].blob);
    lw_support_ok(lw_saved_light_save(w->path, key, w->snapshot, true, NULL), NULL);
    refused(w, key, "it came twice");
    w->snapshot->channels = 1u << LW_TILE_CHANNEL_FULL;
    struct lw_snapshot_tile *tile = &w->snapshot->tile[LW_TILE_CHANNEL_FULL][second];
    lw_blob_unref(tile->blob);
    tile->blob = tile_blob(1, LW_TILE_CHANNEL_SPLIT, 0);
    lw_support_ok(lw_saved_light_save(w->path, key, w->snapshot, true, NULL), NULL);
    refused(w, key, "holds a tile of layer 1, which it does not have");
    bytes = lw_support_read_file(w->path, &size);
    memset(bytes + CHANNELS_AT, 0, sizeof(uint32_t)); /* a file without a channel: no writer makes one */
    const uint64_t checksum = XXH3_64bits(bytes, size - sizeof checksum);
    memcpy(bytes + size - sizeof checksum, &checksum, sizeof checksum);
    lw_support_write_file(w->path, bytes, size);
    free(bytes);
    refused(w, key, "has a header that makes no sense");
}

/* Whatever the number of its lock's descriptor: a daemon may be started without standard input. */
static void a_store_lets_its_folder_go(void **state) {
    (void)state;
    const char *folder = lw_support_temporary("store");
    struct lw_light_store store = {0};
    lw_light_store_finish(&store); /* a zeroed one has no lock */
    assert_true(fcntl(STDIN_FILENO, F_GETFD) >= 0);
    const int input = dup(STDIN_FILENO);
    close(STDIN_FILENO);
    for (int again = 0; again < 2; again++) {
        lw_support_ok(lw_light_store_init(&store, folder, key, NULL), NULL);
        assert_int_equal(store.lock, STDIN_FILENO);
        lw_light_store_finish(&store);
    }
    assert_int_equal(dup2(input, STDIN_FILENO), STDIN_FILENO);
    close(input);
    rmdir(folder);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(steady_light_comes_back_as_it_was, init_world, finish_world),
        cmocka_unit_test_setup_teardown(other_light_does_not_count_as_converged, init_world, finish_world),
        cmocka_unit_test_setup_teardown(what_does_not_fit_is_refused, init_world, finish_world),
        cmocka_unit_test_setup_teardown(what_is_written_wrongly_is_refused, init_world, finish_world),
        cmocka_unit_test(a_store_lets_its_folder_go),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
