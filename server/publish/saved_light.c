#include "server/publish/saved_light.h"

#include "common/base/checked_file.h"
#include "common/base/invariant.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const struct lw_checked_file_kind kind = {{'l', 'w', 'k', 'e', 'p', 't', '\r', '\n'},
                                                 LW_SAVED_LIGHT_VERSION};

struct header {
    struct lw_checked_file_kind kind;
    uint32_t steady;
    uint32_t channels; /* bit for each that is kept, one at least */
    uint64_t frame;
    uint8_t key[LW_SAVED_LIGHT_KEY_SIZE];
};

/* ---- writing ---- */

static uint32_t kept_of(uint32_t channels) {
    for (uint32_t c = 0; c < lw_tile_channels()->count; c++)
        if (!lw_tile_channel_at(c)->kept) channels &= ~(1u << c);
    return channels;
}

enum lw_status lw_saved_light_save(const char *path, const uint8_t key[LW_SAVED_LIGHT_KEY_SIZE],
                                   const struct lw_snapshot *snapshot, bool steady, struct lw_error *err) {
    struct lw_checked_file_writer writer;
    LW_INVARIANT(snapshot->frame > 0 && kept_of(snapshot->channels)); /* nothing else is read back */
    enum lw_status status = lw_checked_file_write_begin(&writer, path, err);
    if (status != LW_OK) return status;
    struct header header = {
        .kind = kind, .steady = steady, .channels = kept_of(snapshot->channels), .frame = snapshot->frame};
    memcpy(header.key, key, sizeof header.key);
    lw_checked_file_put(&writer, &header, sizeof header);
    lw_checked_file_put(&writer, snapshot->frame_full->bytes, snapshot->frame_full->size);
    for (unsigned c = 0; c < LW_TILE_CHANNELS_MAX; c++)
        for (uint32_t i = 0; header.channels >> c & 1 && i < snapshot->tile_count; i++) {
            const struct lw_blob *blob = snapshot->tile[c][i].blob;
            LW_INVARIANT(snapshot->tile[c][i].version <= lw_snapshot_version(snapshot->frame));
            if (blob) lw_checked_file_put(&writer, blob->bytes, blob->size);
        }
    return lw_checked_file_write_end(&writer);
}

/* ---- reading ---- */

struct reader {
    const struct lw_atlas_map *map;
    float error_min; /* every tile's */
    struct lw_snapshot *snapshot;
};

static enum lw_status check_header(const struct header *header, const uint8_t key[LW_SAVED_LIGHT_KEY_SIZE],
                                   struct lw_error *err) {
    if (memcmp(header->key, key, LW_SAVED_LIGHT_KEY_SIZE) != 0)
        return lw_status_fail(err, LW_BAD_DATA,
                              "is of another scene, of other options or of another release");
    if (header->steady > 1 || !header->frame || !header->channels ||
        header->channels >> lw_tile_channels()->count)
        return lw_status_fail(err, LW_BAD_DATA, "has a header that makes no sense");
    return LW_OK;
}

/* One of several, perhaps: they are added to those before. */
static enum lw_status take_frame(struct reader *reader, struct lw_message *message, struct lw_error *err) {
    struct lw_snapshot *snapshot = reader->snapshot;
    if (message->frame.frame != snapshot->frame)
        return lw_status_fail(err, LW_BAD_DATA, "holds frame %llu as frame %llu",
                              (unsigned long long)message->frame.frame, (unsigned long long)snapshot->frame);
    message->frame.server_cpu_ns = message->frame.rays_total = 0;
    const size_t before = snapshot->frame_full ? snapshot->frame_full->size : 0;
    struct lw_blob *whole;
    enum lw_status status = lw_blob_create(before + lw_message_size(message), &whole);
    if (status != LW_OK) return lw_status_fail(err, status, "out of memory");
    if (before) memcpy(whole->bytes, snapshot->frame_full->bytes, before);
    size_t size;
    status = lw_message_encode(message, whole->bytes + before, whole->size - before, &size);
    if (status != LW_OK) {
        lw_blob_unref(whole);
        return lw_status_fail(err, status, "frame");
    }
    LW_INVARIANT(before + size == whole->size);
    lw_blob_unref(snapshot->frame_full);
    snapshot->frame_full = whole;
    return LW_OK;
}

static enum lw_status take_tile(struct reader *reader, struct lw_message *message, struct lw_error *err) {
    struct lw_message_tile *tile = &message->tile;
    struct lw_snapshot *snapshot = reader->snapshot;
    const uint32_t id = lw_atlas_map_find_tile(reader->map, tile->object, tile->level, tile->tile).v;
    if (lw_atlas_finer(tile->level)) return LW_OK; /* a new solver makes them again */
    if (tile->layer >= LW_TILE_CHANNELS_MAX || !lw_snapshot_has(snapshot, tile->layer))
        return lw_status_fail(err, LW_BAD_DATA, "holds a tile of layer %u, which it does not have",
                              tile->layer);
    if (id == UINT32_MAX || snapshot->tile[tile->layer][id].blob || tile->base ||
        tile->version > lw_snapshot_version(snapshot->frame))
        return lw_status_fail(err, LW_BAD_DATA,
                              "object %u, level %u, tile %u: there is none, or it came twice, or it "
                              "is of a later frame",
                              tile->object, tile->level, tile->tile);
    tile->error = fmaxf(tile->error, reader->error_min);
    struct lw_snapshot_tile *taken = &snapshot->tile[tile->layer][id];
    LW_INVARIANT(id < snapshot->tile_count);
    enum lw_status status = lw_blob_from_message(message, &taken->blob);
    if (status != LW_OK) return lw_status_fail(err, status, "a tile");
    taken->version = tile->version;
    return LW_OK;
}

static enum lw_status take_messages(struct reader *reader, const uint8_t *at, size_t left,
                                    struct lw_error *err) {
    enum lw_status status = LW_OK;
    while (status == LW_OK && left) {
        struct lw_framing_header header;
        struct lw_message message;
        if (left < LW_FRAMING_HEADER_SIZE) return lw_status_fail(err, LW_BAD_DATA, "ends inside a message");
        if (lw_framing_read_header(at, LW_FRAMING_BODY_MAX, &header, err) != LW_OK) return LW_BAD_DATA;
        at += LW_FRAMING_HEADER_SIZE;
        left -= LW_FRAMING_HEADER_SIZE;
        if (header.body_size > left) return lw_status_fail(err, LW_BAD_DATA, "ends inside a message");
        status = lw_message_decode(header, at, &message, err);
        if (status != LW_OK) return status == LW_PROTOCOL ? LW_BAD_DATA : status;
        status = message.type == LW_MESSAGE_FRAME ? take_frame(reader, &message, err)
                 : message.type == LW_MESSAGE_TILE
                     ? take_tile(reader, &message, err)
                     : lw_status_fail(err, LW_BAD_DATA, "holds a message %s", lw_message_name(header.type));
        lw_message_finish(&message);
        at += header.body_size;
        left -= header.body_size;
    }
    return status;
}

static enum lw_status read_bytes(struct reader *reader, const uint8_t *bytes, size_t size,
                                 const uint8_t key[LW_SAVED_LIGHT_KEY_SIZE], struct lw_error *err) {
    struct header header;
    if (size < sizeof header) return lw_status_fail(err, LW_BAD_DATA, "has a header that is cut short");
    memcpy(&header, bytes, sizeof header);
    enum lw_status status = check_header(&header, key, err);
    if (status != LW_OK) return status;
    status = lw_snapshot_create(reader->map->tile_count, header.channels, &reader->snapshot);
    if (status != LW_OK) return lw_status_fail(err, status, "out of memory");
    reader->snapshot->frame = header.frame;
    if (header.steady) reader->error_min = 0;
    status = take_messages(reader, bytes + sizeof header, size - sizeof header, err);
    if (status != LW_OK) return status;
    if (!reader->snapshot->frame_full) return lw_status_fail(err, LW_BAD_DATA, "holds no frame");
    if (!header.steady) return LW_OK;
    status =
        lw_blob_from_message(&(struct lw_message){.type = LW_MESSAGE_SETTLED, .settled.frame = header.frame},
                             &reader->snapshot->settled);
    return status == LW_OK ? LW_OK : lw_status_fail(err, status, "out of memory");
}

/* All of a file but its checksum; malloc'ed. */
static enum lw_status load_bytes(const char *path, uint8_t **out_bytes, size_t *out_size,
                                 struct lw_error *err) {
    struct lw_checked_file_reader file;
    uint8_t *bytes = NULL;
    enum lw_status status = lw_checked_file_read_begin(&file, path, &kind, "kept light", err);
    const uint64_t size = file.left;
    if (status == LW_OK && size > LW_SAVED_LIGHT_SIZE_MAX)
        status = lw_status_fail(err, LW_BAD_DATA, "%s: has %llu bytes; the limit is %llu", path,
                                (unsigned long long)size, LW_SAVED_LIGHT_SIZE_MAX);
    if (status == LW_OK && !(bytes = malloc((size_t)size)))
        status = lw_status_fail(err, LW_NO_MEMORY, "%s: out of memory", path);
    if (status == LW_OK) status = lw_checked_file_take(&file, bytes, (size_t)size);
    lw_checked_file_read_end(&file);
    if (status == LW_OK) {
        *out_bytes = bytes;
        *out_size = (size_t)size;
    } else
        free(bytes);
    return status;
}

enum lw_status lw_saved_light_load(const char *path, const uint8_t key[LW_SAVED_LIGHT_KEY_SIZE],
                                   const struct lw_atlas_map *atlas_map, float target_error,
                                   struct lw_snapshot **out_snapshot, struct lw_error *err) {
    uint8_t *bytes;
    size_t size;
    struct reader reader = {.map = atlas_map, .error_min = 2 * target_error};
    enum lw_status status = load_bytes(path, &bytes, &size, err);
    if (status != LW_OK) return status;
    status = read_bytes(&reader, bytes, size, key, err);
    free(bytes);
    if (status == LW_OK) {
        *out_snapshot = reader.snapshot;
        return LW_OK;
    }
    lw_snapshot_unref(reader.snapshot);
    lw_status_context(err, "%s", path);
    return status;
}
