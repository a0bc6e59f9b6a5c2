#include "server/solve/state/tile_file.h"

#include "common/base/invariant.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <xxhash.h>

#define VERSION 1u

struct header {
    char what[16];
    uint32_t version, tiles, planes, record_size;
    uint8_t key[LW_TILE_FILE_KEY_SIZE];
};

static const char what[16] = "lightwell tiles";

/* A record: the checksum of what follows, the tile up to its planes, the planes that are used. */
#define FIXED_SIZE offsetof(struct lw_tile_file_tile, plane)

static size_t tile_size(uint32_t planes) {
    return FIXED_SIZE + planes * sizeof(((struct lw_tile_file_tile *)0)->plane[0]);
}

static size_t record_size(uint32_t planes) { return sizeof(XXH64_hash_t) + tile_size(planes); }

static off_t has_at(uint32_t tile) { return (off_t)(sizeof(struct header) + tile); }

static off_t record_at(const struct lw_tile_file *file, uint32_t tile) {
    return has_at(file->tiles) + (off_t)tile * (off_t)record_size(file->planes);
}

static bool read_at(const struct lw_tile_file *file, void *bytes, size_t size, off_t at) {
    for (char *to = bytes; size;) {
        const ssize_t got = pread(file->descriptor, to, size, at);
        if (got < 0 && errno == EINTR) continue;
        if (got <= 0) return false;
        to += got, at += got, size -= (size_t)got;
    }
    return true;
}

static bool write_at(const struct lw_tile_file *file, const void *bytes, size_t size, off_t at) {
    for (const char *from = bytes; size;) {
        const ssize_t done = pwrite(file->descriptor, from, size, at);
        if (done < 0 && errno == EINTR) continue;
        if (done < 0) return false;
        from += done, at += done, size -= (size_t)done;
    }
    return true;
}

static bool has_header(const struct lw_tile_file *file, const struct header *header) {
    struct header there;
    return read_at(file, &there, sizeof there, 0) && memcmp(&there, header, sizeof there) == 0;
}

/* Takes over which tiles are there, or begins the file. */
static bool begin(struct lw_tile_file *file, const struct header *header) {
    if (has_header(file, header) && read_at(file, file->has, file->tiles, has_at(0))) {
        for (uint32_t t = 0; t < file->tiles; t++) file->count += file->has[t] != 0;
        return true;
    }
    memset(file->has, 0, file->tiles);
    return ftruncate(file->descriptor, 0) == 0 && write_at(file, header, sizeof *header, 0) &&
           write_at(file, file->has, file->tiles, has_at(0));
}

enum lw_status lw_tile_file_open(struct lw_tile_file *file, const char *path,
                                 const uint8_t key[LW_TILE_FILE_KEY_SIZE], uint32_t tiles, uint32_t planes,
                                 struct lw_error *err) {
    struct header header = {
        .version = VERSION, .tiles = tiles, .planes = planes, .record_size = (uint32_t)record_size(planes)};
    LW_INVARIANT(planes <= LW_TILE_FILE_PLANES_MAX);
    memcpy(header.what, what, sizeof what);
    memcpy(header.key, key, sizeof header.key);
    *file = (struct lw_tile_file){.tiles = tiles, .planes = planes};
    file->descriptor = open(path, O_RDWR | O_CREAT | O_CLOEXEC, 0666);
    if (file->descriptor < 0) {
        const int reason = errno;
        *file = (struct lw_tile_file){.path = NULL};
        return lw_status_fail(err, LW_CANNOT_CREATE, "%s: %s", path, strerror(reason));
    }
    file->path = strdup(path);
    file->has = malloc(tiles + 1ul);
    enum lw_status status = LW_OK;
    if (!file->path || !file->has)
        status = lw_status_fail(err, LW_NO_MEMORY, "%u tiles", tiles);
    else if (!begin(file, &header))
        status = lw_status_fail(err, LW_IO, "%s: %s", path, strerror(errno));
    if (status == LW_OK) return LW_OK;
    close(file->descriptor);
    free(file->path);
    free(file->has);
    *file = (struct lw_tile_file){.path = NULL};
    return status;
}

void lw_tile_file_close(struct lw_tile_file *file) {
    if (!file->path) return;
    close(file->descriptor);
    free(file->path);
    free(file->has);
    *file = (struct lw_tile_file){.path = NULL};
}

enum lw_status lw_tile_file_put(struct lw_tile_file *file, uint32_t tile, struct lw_tile_file_tile *from,
                                struct lw_error *err) {
    static const uint8_t there = 1;
    LW_INVARIANT(tile < file->tiles && from->texels <= LW_TILE_TEXELS_MAX);
    const off_t at = record_at(file, tile);
    const XXH64_hash_t hash = XXH3_64bits(from, tile_size(file->planes));
    if (!write_at(file, &hash, sizeof hash, at) ||
        !write_at(file, from, tile_size(file->planes), at + (off_t)sizeof hash) ||
        !write_at(file, &there, 1, has_at(tile)))
        return lw_status_fail(err, LW_IO, "%s: %s", file->path, strerror(errno));
    file->count += !file->has[tile];
    file->has[tile] = 1;
    return LW_OK;
}

enum lw_status lw_tile_file_get(const struct lw_tile_file *file, uint32_t tile, struct lw_tile_file_tile *out,
                                struct lw_error *err) {
    XXH64_hash_t hash;
    LW_INVARIANT(tile < file->tiles && file->has[tile]);
    const off_t at = record_at(file, tile);
    errno = 0;
    if (!read_at(file, &hash, sizeof hash, at) ||
        !read_at(file, out, tile_size(file->planes), at + (off_t)sizeof hash))
        return lw_status_fail(err, LW_IO, "%s: %s", file->path, errno ? strerror(errno) : "it is cut off");
    if (hash != XXH3_64bits(out, tile_size(file->planes)) || out->texels > LW_TILE_TEXELS_MAX)
        return lw_status_fail(err, LW_BAD_DATA, "%s: tile %u is damaged", file->path, tile);
    return LW_OK;
}

void lw_tile_file_forget(struct lw_tile_file *file, uint32_t tile) {
    file->count -= file->has[tile] != 0;
    file->has[tile] = 0;
}
