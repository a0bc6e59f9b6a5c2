#include "server/solve/state/checkpoint.h"

#include "common/base/checked_file.h"
#include "common/base/invariant.h"

#include <stdlib.h>
#include <string.h>
#include <xxhash.h>

static const struct lw_checked_file_kind kind = {{'l', 'w', 's', 'o', 'l', 'v', 'e', '\n'},
                                                 LW_CHECKPOINT_VERSION};

struct header {
    struct lw_checked_file_kind kind;
    uint32_t tile_count, texel_count, bounces;
    uint8_t key[LW_CHECKPOINT_KEY_SIZE];
    uint64_t covered;   /* which texels are: XXH3-64 of a byte each */
    uint64_t body_size; /* bytes between header and checksum */
};

/* What a tile remembers; which texels it has follows from its id. */
struct record {
    uint32_t id;
    float error;
    uint64_t solved_frame;
};

/* What a block does; in the order of the tiles' ids. Without gaps between its fields. */
struct block_record {
    double variance, luminance;
    struct lw_history direct, indirect;
    float staleness_direct;
    struct lw_vec3 staleness_indirect[LW_REGIONS];
    float light, noise[LW_TILES_PARTS], error;
    uint32_t frames, unseen;
    float standard_error, weight[LW_REGIONS];
};
_Static_assert(sizeof(struct block_record) == 128, "no padding, which would have any value");

/* ---- contents ---- */

#define PLANES_MAX                                                                                           \
    (3 * (3 + LW_TILES_BOUNCES_MAX) + 2 * LW_TILE_CHANNELS_MAX * LW_TILE_CHANNEL_PLANES_MAX + 9 + 4)

/* The planes that the next frame reads. Planes that it writes first (radiance, estimate) are left out. */
static uint32_t list_planes(const struct lw_tiles *tiles, float *out_plane[PLANES_MAX]) {
    uint32_t n = 0;
    for (int c = 0; c < 3; c++) {
        out_plane[n++] = tiles->direct[c];
        out_plane[n++] = tiles->indirect[c];
        out_plane[n++] = tiles->shown[LW_TILE_CHANNEL_FULL][c];
        for (uint32_t k = 0; k + 1 < tiles->bounces; k++) out_plane[n++] = tiles->order[k][c];
    }
    out_plane[n++] = tiles->mean;
    out_plane[n++] = tiles->spread;
    for (int c = 0; c < 3 && tiles->drawn[c]; c++) {
        out_plane[n++] = tiles->drawn[c];
        out_plane[n++] = tiles->shown[LW_TILE_CHANNEL_SPLIT][c];
    }
    if (tiles->split_mean) out_plane[n++] = tiles->split_mean, out_plane[n++] = tiles->split_spread;
    for (int k = 0; k < 3; k++) {
        for (int part = 0; part < LW_TILES_PARTS && tiles->moment[part][k]; part++)
            out_plane[n++] = tiles->moment[part][k];
        if (tiles->drawn_moment[k]) out_plane[n++] = tiles->drawn_moment[k];
    }
    for (uint32_t channel = LW_TILE_CHANNEL_IRRADIANCES; channel < lw_tile_channels()->count; channel++)
        for (uint32_t p = 0; p < lw_tile_channel_at(channel)->planes; p++) {
            if (tiles->shown[channel][p]) out_plane[n++] = tiles->shown[channel][p];
            if (tiles->sum[channel][p]) out_plane[n++] = tiles->sum[channel][p];
        }
    LW_INVARIANT(n <= PLANES_MAX);
    return n;
}

static struct header make_header(const uint8_t key[LW_CHECKPOINT_KEY_SIZE], const struct lw_tiles *tiles,
                                 const struct lw_checkpoint_part *part, uint32_t part_count) {
    float *plane[PLANES_MAX];
    struct header header = {.kind = kind,
                            .tile_count = tiles->level0_count,
                            .texel_count = tiles->texel_count,
                            .bounces = tiles->bounces,
                            .covered = XXH3_64bits(tiles->covered, tiles->texel_count)};
    memcpy(header.key, key, sizeof header.key);
    header.body_size = (uint64_t)tiles->level0_count * sizeof(struct record) +
                       (uint64_t)tiles->block_count * sizeof(struct block_record) +
                       (uint64_t)list_planes(tiles, plane) * tiles->texel_count * sizeof(float);
    for (uint32_t i = 0; i < part_count; i++) header.body_size += part[i].size;
    return header;
}

static int by_id(const void *a, const void *b) {
    const struct record *x = a, *y = b;
    return (x->id > y->id) - (x->id < y->id);
}

/* ---- writing ---- */

/* Tiles of finer levels are made again. */
static void put_records(struct lw_checked_file_writer *writer, const struct lw_tiles *tiles) {
    struct record *record = calloc((size_t)tiles->level0_count + 1, sizeof *record);
    uint32_t count = 0;
    if (!record) {
        writer->status = lw_status_fail(writer->err, LW_NO_MEMORY, "%u tiles", tiles->level0_count);
        return;
    }
    for (uint32_t i = 0; i < tiles->count; i++)
        if (!tiles->tile[i].fine_pair)
            record[count++] = (struct record){.id = tiles->tile[i].id.v,
                                              .error = tiles->tile[i].light.error,
                                              .solved_frame = tiles->tile[i].light.solved_frame};
    LW_INVARIANT(count == tiles->level0_count);
    qsort(record, count, sizeof *record, by_id);
    for (uint32_t i = 1; i < count; i++)
        LW_INVARIANT_DEAR(record[i - 1].id < record[i].id); /* each tile once */
    lw_checked_file_put(writer, record, (size_t)count * sizeof *record);
    free(record);
}

static void put_blocks(struct lw_checked_file_writer *writer, const struct lw_tiles *tiles) {
    for (uint32_t i = 0; i < tiles->block_count; i++) {
        const struct lw_solve_block *block = &tiles->block[i];
        const struct lw_change_block *change = &block->change;
        struct block_record record = {
            .variance = block->variance,
            .luminance = block->luminance,
            .direct = block->direct,
            .indirect = block->indirect,
            .staleness_direct = change->staleness_direct,
            .light = block->reference_luminance,
            .noise = {block->noise[LW_TILES_DIRECT], block->noise[LW_TILES_INDIRECT]},
            .error = block->error,
            .frames = block->sample_count,
            .unseen = block->unseen,
            .standard_error = change->standard_error};
        memcpy(record.staleness_indirect, change->staleness_indirect, sizeof record.staleness_indirect);
        memcpy(record.weight, block->weight, sizeof record.weight);
        lw_checked_file_put(writer, &record, sizeof record);
    }
}

enum lw_status lw_checkpoint_save(const char *path, const uint8_t key[LW_CHECKPOINT_KEY_SIZE],
                                  const struct lw_tiles *tiles, const struct lw_checkpoint_part *part,
                                  uint32_t part_count, struct lw_error *err) {
    struct lw_checked_file_writer writer;
    enum lw_status status = lw_checked_file_write_begin(&writer, path, err);
    if (status != LW_OK) return status;
    const struct header header = make_header(key, tiles, part, part_count);
    lw_checked_file_put(&writer, &header, sizeof header);
    put_records(&writer, tiles);
    put_blocks(&writer, tiles);
    float *plane[PLANES_MAX];
    const uint32_t planes = list_planes(tiles, plane);
    for (uint32_t i = 0; i < planes; i++)
        lw_checked_file_put(&writer, plane[i], (size_t)tiles->texel_count * sizeof(float));
    for (uint32_t i = 0; i < part_count; i++) lw_checked_file_put(&writer, part[i].bytes, part[i].size);
    return lw_checked_file_write_end(&writer);
}

/* ---- reading ---- */

static enum lw_status take_header(struct lw_checked_file_reader *reader, const struct header *wanted) {
    struct header header;
    enum lw_status status = lw_checked_file_take(reader, &header, sizeof header);
    if (status != LW_OK) return status;
    const bool same_texels = header.covered == wanted->covered;
    header.covered = wanted->covered;
    if (memcmp(&header, wanted, sizeof header) != 0 || reader->left != header.body_size)
        return lw_status_fail(reader->err, LW_BAD_DATA, "%s: is of another scene or of other options",
                              reader->path);
    if (!same_texels)
        return lw_status_fail(reader->err, LW_BAD_DATA,
                              "%s: has other texels covered, as objects stood elsewhere", reader->path);
    return LW_OK;
}

static enum lw_status take_records(struct lw_checked_file_reader *reader, struct lw_tiles *tiles) {
    LW_INVARIANT(tiles->count == tiles->level0_count); /* a new solver's */
    struct record *record = calloc((size_t)tiles->count + 1, sizeof *record);
    if (!record) return lw_status_fail(reader->err, LW_NO_MEMORY, "%u tiles", tiles->count);
    enum lw_status status = lw_checked_file_take(reader, record, (size_t)tiles->count * sizeof *record);
    for (uint32_t i = 0; i < tiles->count && status == LW_OK; i++) {
        struct lw_solve_tile *tile = &tiles->tile[i];
        const struct record *r =
            bsearch(&(struct record){.id = tile->id.v}, record, tiles->count, sizeof *record, by_id);
        if (!r) {
            status = lw_status_fail(reader->err, LW_BAD_DATA, "%s: lacks tile %u", reader->path, tile->id.v);
            break;
        }
        tile->light.error = r->error;
        tile->light.solved_frame = r->solved_frame;
    }
    free(record);
    return status;
}

static enum lw_status take_blocks(struct lw_checked_file_reader *reader, struct lw_tiles *tiles) {
    for (uint32_t i = 0; i < tiles->block_count; i++) {
        struct lw_solve_block *block = &tiles->block[i];
        struct block_record record;
        enum lw_status status = lw_checked_file_take(reader, &record, sizeof record);
        if (status != LW_OK) return status;
        block->variance = record.variance;
        block->luminance = record.luminance;
        block->direct = record.direct;
        block->indirect = record.indirect;
        block->change.staleness_direct = record.staleness_direct;
        block->change.standard_error = record.standard_error;
        memcpy(block->change.staleness_indirect, record.staleness_indirect, sizeof record.staleness_indirect);
        block->reference_luminance = record.light;
        memcpy(block->noise, record.noise, sizeof record.noise);
        memcpy(block->weight, record.weight, sizeof record.weight);
        block->error = record.error;
        block->sample_count = record.frames;
        block->unseen = record.unseen != 0;
    }
    return LW_OK;
}

static enum lw_status take_body(struct lw_checked_file_reader *reader, struct lw_tiles *tiles,
                                const struct lw_checkpoint_part *part, uint32_t part_count) {
    float *plane[PLANES_MAX];
    const uint32_t planes = list_planes(tiles, plane);
    enum lw_status status = take_records(reader, tiles);
    if (status == LW_OK) status = take_blocks(reader, tiles);
    for (uint32_t i = 0; i < planes && status == LW_OK; i++)
        status = lw_checked_file_take(reader, plane[i], (size_t)tiles->texel_count * sizeof(float));
    for (uint32_t i = 0; i < part_count && status == LW_OK; i++)
        status = lw_checked_file_take(reader, part[i].bytes, part[i].size);
    return status;
}

enum lw_status lw_checkpoint_load(const char *path, const uint8_t key[LW_CHECKPOINT_KEY_SIZE],
                                  struct lw_tiles *tiles, const struct lw_checkpoint_part *part,
                                  uint32_t part_count, struct lw_error *err) {
    struct lw_checked_file_reader reader;
    enum lw_status status = lw_checked_file_read_begin(&reader, path, &kind, "checkpoint", err);
    const struct header wanted = make_header(key, tiles, part, part_count);
    if (status == LW_OK) status = take_header(&reader, &wanted);
    if (status == LW_OK) status = take_body(&reader, tiles, part, part_count);
    lw_checked_file_read_end(&reader);
    return status;
}
