#include "server/solve/surface/saved_texels.h"

#include "common/base/cache_folder.h"
#include "common/base/checked_file.h"
#include "common/base/invariant.h"

#include <stdlib.h>
#include <string.h>
#include <xxhash.h>
#include <zstd.h>

_Static_assert(LW_SAVED_TEXELS_KEY_SIZE == LW_CACHE_FOLDER_HASH_SIZE, "files are named by it");

#define FASTEST 1           /* a level of zstd: planes are mostly runs */
#define NOBODY  0x80000000u /* in the plane of sources: LW_TEXEL_NONE */

static const struct lw_checked_file_kind kind = {{'l', 'w', 't', 'e', 'x', 'e', 'l', '\n'},
                                                 LW_SAVED_TEXELS_VERSION};

/* In the order of the file. */
enum plane { COVERED, USABLE, WALLS, SIDE, SOURCE, PLANES };
static const size_t width[PLANES] = {1, 1, 1, sizeof(uint32_t), sizeof(uint32_t)}; /* bytes a texel */

struct header {
    struct lw_checked_file_kind kind;
    uint32_t texel_count;
    uint8_t key[LW_SAVED_TEXELS_KEY_SIZE];
    uint64_t hash; /* over the inputs that the texels are found from */
    uint64_t gone;
    uint64_t size[PLANES]; /* compressed */
};
_Static_assert(sizeof(struct header) == 32 + 16 + 8 * PLANES, "no padding, which would have any value");

/* Where things stand, which texels there are, and which kernels trace; shapes are part of the key. */
static uint64_t hash_of(const struct lw_texels *texels, const struct lw_pose *pose, const bool *stands,
                        const struct lw_trace *trace, XXH3_state_t *state) {
    const struct lw_scene *scene = texels->scene;
    const char *isa = lw_trace_isa(trace);
    XXH3_64bits_reset(state);
    XXH3_64bits_update(state, isa, strlen(isa));
    XXH3_64bits_update(state, stands, scene->object_count * sizeof *stands);
    XXH3_64bits_update(state, pose->object_hidden, scene->object_count * sizeof *pose->object_hidden);
    XXH3_64bits_update(state, pose->object_to_world, scene->object_count * sizeof *pose->object_to_world);
    for (uint32_t m = 0; m < scene->mesh_count; m++) {
        const struct lw_mesh_texels *mesh = &texels->mesh[m];
        XXH3_64bits_update(state, &mesh->texel_count, sizeof mesh->texel_count);
        if (!mesh->texel_count) continue;
        XXH3_64bits_update(state, mesh->covered, mesh->texel_count);
        XXH3_64bits_update(state, mesh->sample_points.first,
                           (mesh->texel_count + 1ul) * sizeof *mesh->sample_points.first);
    }
    return XXH3_64bits_digest(state);
}

static enum lw_status make_header(const struct lw_saved_texels *saved, const struct lw_texels *texels,
                                  const struct lw_pose *pose, const bool *stands,
                                  const struct lw_trace *trace, struct header *out_header) {
    XXH3_state_t *state = XXH3_createState();
    if (!state) return LW_NO_MEMORY;
    *out_header = (struct header){
        .kind = kind, .texel_count = texels->count, .hash = hash_of(texels, pose, stands, trace, state)};
    memcpy(out_header->key, saved->key, sizeof out_header->key);
    XXH3_freeState(state);
    return LW_OK;
}

/* ---- writing ---- */

/* A texel's source as its distance: mostly 0. */
static uint32_t *distances(const struct lw_texels *texels) {
    uint32_t *distance = malloc((texels->count + 1ul) * sizeof *distance);
    for (uint32_t i = 0; i < texels->count && distance; i++)
        distance[i] = texels->source[i] == LW_TEXEL_NONE ? NOBODY : texels->source[i] - i;
    return distance;
}

static enum lw_status compress(const void *plane, size_t size, void **out_bytes, uint64_t *out_size) {
    const size_t bound = ZSTD_compressBound(size);
    void *bytes = malloc(bound);
    if (!bytes) return LW_NO_MEMORY;
    const size_t written = ZSTD_compress(bytes, bound, plane, size, FASTEST);
    if (ZSTD_isError(written)) {
        free(bytes);
        return LW_NO_MEMORY;
    }
    *out_bytes = bytes;
    *out_size = written;
    return LW_OK;
}

static enum lw_status compress_all(const struct lw_texels *texels, void *out_bytes[PLANES],
                                   uint64_t out_size[PLANES]) {
    uint32_t *distance = distances(texels);
    const void *plane[PLANES] = {texels->covered, texels->usable, texels->walls, texels->side, distance};
    enum lw_status status = distance ? LW_OK : LW_NO_MEMORY;
    for (int p = 0; p < PLANES && status == LW_OK; p++)
        status = compress(plane[p], texels->count * width[p], &out_bytes[p], &out_size[p]);
    free(distance);
    return status;
}

static enum lw_status write_file(const char *path, const struct header *header, void *const bytes[PLANES],
                                 struct lw_error *err) {
    struct lw_checked_file_writer writer;
    enum lw_status status = lw_checked_file_write_begin(&writer, path, err);
    if (status != LW_OK) return status;
    writer.file.durable = false; /* first light does not wait for the disk */
    lw_checked_file_put(&writer, header, sizeof *header);
    for (int p = 0; p < PLANES; p++) lw_checked_file_put(&writer, bytes[p], header->size[p]);
    return lw_checked_file_write_end(&writer);
}

enum lw_status lw_saved_texels_save(const struct lw_saved_texels *saved,
                                    const struct lw_invalid_texels_found *found, const struct lw_trace *trace,
                                    struct lw_error *err) {
    static const char *const suffix[] = {LW_SAVED_TEXELS_SUFFIX, NULL};
    const struct lw_texels *texels = found->texels;
    void *bytes[PLANES] = {NULL};
    struct header header;
    LW_INVARIANT(texels->stands && found->count <= texels->count);
    char *path = lw_cache_folder_path(saved->folder, saved->key, LW_SAVED_TEXELS_SUFFIX);
    enum lw_status status =
        path ? make_header(saved, texels, found->pose, texels->stands, trace, &header) : LW_NO_MEMORY;
    if (status == LW_OK) status = compress_all(texels, bytes, header.size);
    if (status == LW_OK) {
        header.gone = found->count;
        lw_cache_folder_make_above(path);
        status = write_file(path, &header, bytes, err);
    } else
        lw_status_fail(err, status, "%u texels", texels->count);
    if (status == LW_OK) lw_cache_folder_prune(saved->folder, suffix, LW_SAVED_TEXELS_BYTES_MAX, path);
    for (int p = 0; p < PLANES; p++) free(bytes[p]);
    free(path);
    return status;
}

/* ---- reading ---- */

/* What a file says, until it is known to be right. */
struct loaded {
    uint8_t *covered, *usable, *walls, *filled;
    uint32_t *side, *source;
};

static void loaded_finish(struct loaded *loaded) {
    free(loaded->covered);
    free(loaded->usable);
    free(loaded->walls);
    free(loaded->filled);
    free(loaded->side);
    free(loaded->source);
}

static bool loaded_init(struct loaded *loaded, uint32_t count) {
    *loaded = (struct loaded){.covered = malloc(count + 1ul),
                              .usable = malloc(count + 1ul),
                              .walls = malloc(count + 1ul),
                              .filled = malloc(count + 1ul),
                              .side = malloc((count + 1ul) * sizeof *loaded->side),
                              .source = malloc((count + 1ul) * sizeof *loaded->source)};
    return loaded->covered && loaded->usable && loaded->walls && loaded->filled && loaded->side &&
           loaded->source;
}

static enum lw_status take_header(struct lw_checked_file_reader *reader, struct header *wanted) {
    struct header header;
    enum lw_status status = lw_checked_file_take(reader, &header, sizeof header);
    if (status != LW_OK) return status;
    uint64_t left = reader->left;
    for (int p = 0; p < PLANES; p++) {
        if (header.size[p] > left || header.size[p] > ZSTD_compressBound(wanted->texel_count * width[p]))
            return lw_status_fail(reader->err, LW_BAD_DATA, "%s: has a plane of %llu bytes", reader->path,
                                  (unsigned long long)header.size[p]);
        left -= header.size[p];
        wanted->size[p] = header.size[p];
    }
    wanted->gone = header.gone;
    if (memcmp(&header, wanted, sizeof header) != 0 || left || header.gone > header.texel_count)
        return lw_status_fail(reader->err, LW_BAD_DATA, "%s: is of other texels", reader->path);
    return LW_OK;
}

/* size: compressed, within the file; raw: of all of it */
static enum lw_status take_plane(struct lw_checked_file_reader *reader, size_t size, void *plane,
                                 size_t raw) {
    uint8_t *bytes = malloc(size + 1);
    if (!bytes) return lw_status_fail(reader->err, LW_NO_MEMORY, "%s: out of memory", reader->path);
    enum lw_status status = lw_checked_file_take(reader, bytes, size);
    if (status == LW_OK && ZSTD_decompress(plane, raw, bytes, size) != raw)
        status = lw_status_fail(reader->err, LW_BAD_DATA, "%s: holds a plane of another size", reader->path);
    free(bytes);
    return status;
}

/* Whether a texel may be so: i of its mesh, from `first` on in the global numbering. */
static bool is_possible(const struct loaded *l, const struct lw_mesh_texels *mesh, uint32_t first,
                        uint32_t i) {
    const uint32_t at = first + i, source = l->source[at];
    const bool covered = l->covered[at];
    if (l->covered[at] > 1 || (covered && (!mesh->covered[i] || !l->usable[at]))) return false;
    if (l->usable[at] & ~lw_sample_points_all(&mesh->sample_points, i)) return false;
    if (l->walls[at] >= 2 * LW_TEXELS_WALL_NEAR) return false;
    if (covered || source == LW_TEXEL_NONE) return source == (covered ? at : LW_TEXEL_NONE);
    return source >= first && source - first < mesh->texel_count && l->covered[source] == 1;
}

static bool are_possible(const struct loaded *l, const struct lw_texels *texels) {
    for (uint32_t o = 0; o < texels->scene->object_count; o++) {
        const struct lw_mesh_texels *mesh = &texels->mesh[texels->scene->object[o].mesh];
        for (uint32_t i = 0; i < mesh->texel_count; i++)
            if (!is_possible(l, mesh, texels->first[o], i)) return false;
    }
    return true;
}

static enum lw_status take_planes(struct lw_checked_file_reader *reader, const struct header *header,
                                  const struct lw_texels *texels, struct loaded *loaded) {
    void *const plane[PLANES] = {loaded->covered, loaded->usable, loaded->walls, loaded->side,
                                 loaded->source};
    enum lw_status status = LW_OK;
    for (int p = 0; p < PLANES && status == LW_OK; p++)
        status = take_plane(reader, header->size[p], plane[p], texels->count * width[p]);
    if (status != LW_OK) return status;
    for (uint32_t i = 0; i < texels->count; i++) {
        loaded->source[i] = loaded->source[i] == NOBODY ? LW_TEXEL_NONE : loaded->source[i] + i;
        loaded->filled[i] = !loaded->covered[i] && loaded->source[i] != LW_TEXEL_NONE;
    }
    return are_possible(loaded, texels)
               ? LW_OK
               : lw_status_fail(reader->err, LW_BAD_DATA, "%s: has a texel that cannot be", reader->path);
}

static void take_over(struct lw_texels *texels, struct loaded *loaded, const bool *stands) {
    const struct loaded old = {.covered = texels->covered,
                               .usable = texels->usable,
                               .walls = texels->walls,
                               .filled = texels->filled,
                               .side = texels->side,
                               .source = texels->source};
    texels->covered = loaded->covered;
    texels->usable = loaded->usable;
    texels->walls = loaded->walls;
    texels->filled = loaded->filled;
    texels->side = loaded->side;
    texels->source = loaded->source;
    texels->stands = stands;
    *loaded = old;
}

enum lw_status lw_saved_texels_load(const struct lw_saved_texels *saved, struct lw_texels *texels,
                                    const struct lw_pose *pose, const bool *stands,
                                    const struct lw_trace *trace, uint64_t *out_count, struct lw_error *err) {
    struct lw_checked_file_reader reader;
    struct loaded loaded;
    struct header header;
    char *path = lw_cache_folder_path(saved->folder, saved->key, LW_SAVED_TEXELS_SUFFIX);
    if (!path) return lw_status_fail(err, LW_NO_MEMORY, "%s: out of memory", saved->folder);
    enum lw_status status = lw_checked_file_read_begin(&reader, path, &kind, "texels", err);
    if (status == LW_OK && make_header(saved, texels, pose, stands, trace, &header) != LW_OK)
        status = lw_status_fail(err, LW_NO_MEMORY, "%s: out of memory", path);
    if (status == LW_OK) status = take_header(&reader, &header);
    if (status == LW_OK) {
        status = loaded_init(&loaded, texels->count)
                     ? take_planes(&reader, &header, texels, &loaded)
                     : lw_status_fail(err, LW_NO_MEMORY, "%s: out of memory", path);
        if (status == LW_OK) take_over(texels, &loaded, stands);
        loaded_finish(&loaded);
    }
    lw_checked_file_read_end(&reader);
    if (status == LW_OK) {
        lw_cache_folder_touch(path);
        *out_count = header.gone;
    }
    free(path);
    return status;
}
