#include "common/base/checked_file.h"

#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <xxhash.h>

#define CHUNK_BYTES ((size_t)1 << 20) /* they are still in the processor's cache when they are written */

enum lw_status lw_checked_file_write_begin(struct lw_checked_file_writer *writer, const char *path,
                                           struct lw_error *err) {
    XXH3_state_t *hash = XXH3_createState();
    if (!hash) return lw_status_fail(err, LW_NO_MEMORY, "%s: out of memory", path);
    XXH3_64bits_reset(hash);
    *writer = (struct lw_checked_file_writer){.hash = hash, .err = err};
    enum lw_status status = lw_atomic_file_open(&writer->file, path, err);
    writer->file.durable = true;
    if (status != LW_OK) XXH3_freeState(hash);
    return status;
}

void lw_checked_file_put(struct lw_checked_file_writer *writer, const void *bytes, size_t size) {
    for (size_t done = 0; done < size && writer->status == LW_OK; done += CHUNK_BYTES) {
        const uint8_t *chunk = (const uint8_t *)bytes + done;
        const size_t chunk_size = size - done < CHUNK_BYTES ? size - done : CHUNK_BYTES;
        XXH3_64bits_update(writer->hash, chunk, chunk_size);
        writer->status = lw_atomic_file_write(&writer->file, chunk, chunk_size, writer->err);
    }
}

enum lw_status lw_checked_file_write_end(struct lw_checked_file_writer *writer) {
    const uint64_t checksum = XXH3_64bits_digest(writer->hash);
    lw_checked_file_put(writer, &checksum, sizeof checksum);
    XXH3_freeState(writer->hash);
    if (writer->status == LW_OK) return lw_atomic_file_commit(&writer->file, writer->err);
    lw_atomic_file_abandon(&writer->file);
    return writer->status;
}

static enum lw_status check_kind(struct lw_checked_file_reader *reader,
                                 const struct lw_checked_file_kind *kind, const char *what) {
    struct lw_checked_file_kind found;
    struct stat st;
    uint64_t checksum;
    if (fstat(fileno(reader->file), &st) != 0 || !S_ISREG(st.st_mode) ||
        (uint64_t)st.st_size < sizeof found + sizeof checksum ||
        fread(&found, 1, sizeof found, reader->file) != sizeof found ||
        memcmp(found.magic, kind->magic, sizeof found.magic) != 0)
        return lw_status_fail(reader->err, LW_BAD_DATA, "%s: holds no %s, or is cut short", reader->path,
                              what);
    if (found.version != kind->version)
        return lw_status_fail(reader->err, LW_BAD_DATA, "%s: has version %u, this program reads %u",
                              reader->path, found.version, kind->version);
    reader->left = (uint64_t)st.st_size - sizeof checksum;
    return LW_OK;
}

/* Walks over the whole file, so that nothing of a damaged one is taken. */
static enum lw_status check_sum(struct lw_checked_file_reader *reader) {
    XXH3_state_t *hash = XXH3_createState();
    uint8_t *chunk = malloc(CHUNK_BYTES);
    const uint64_t size = reader->left;
    uint64_t checksum = 0;
    enum lw_status status = LW_OK;
    if (!hash || !chunk)
        status = lw_status_fail(reader->err, LW_NO_MEMORY, "%s: out of memory", reader->path);
    else
        XXH3_64bits_reset(hash);
    rewind(reader->file);
    while (status == LW_OK && reader->left) {
        const size_t part = reader->left < CHUNK_BYTES ? (size_t)reader->left : CHUNK_BYTES;
        status = lw_checked_file_take(reader, chunk, part);
        if (status == LW_OK) XXH3_64bits_update(hash, chunk, part);
    }
    reader->left = sizeof checksum;
    if (status == LW_OK) status = lw_checked_file_take(reader, &checksum, sizeof checksum);
    if (status == LW_OK && checksum != XXH3_64bits_digest(hash))
        status = lw_status_fail(reader->err, LW_BAD_DATA, "%s: is damaged or cut short (wrong checksum)",
                                reader->path);
    free(chunk);
    XXH3_freeState(hash);
    rewind(reader->file);
    reader->left = size;
    return status;
}

enum lw_status lw_checked_file_read_begin(struct lw_checked_file_reader *reader, const char *path,
                                          const struct lw_checked_file_kind *kind, const char *what,
                                          struct lw_error *err) {
    *reader = (struct lw_checked_file_reader){.path = path, .err = err};
    /* O_NONBLOCK: opening a FIFO would wait for ever */
    const int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    if (fd < 0) return lw_status_fail(err, LW_NO_INPUT, "%s: cannot open it: %m", path);
    reader->file = fdopen(fd, "rb");
    if (!reader->file) {
        close(fd);
        return lw_status_fail(err, LW_NO_MEMORY, "%s: out of memory", path);
    }
    enum lw_status status = check_kind(reader, kind, what);
    return status == LW_OK ? check_sum(reader) : status;
}

enum lw_status lw_checked_file_take(struct lw_checked_file_reader *reader, void *bytes, size_t size) {
    if (size > reader->left)
        return lw_status_fail(reader->err, LW_BAD_DATA, "%s: ends too early", reader->path);
    if (fread(bytes, 1, size, reader->file) != size)
        return lw_status_fail(reader->err, LW_IO, "%s: cannot read", reader->path);
    reader->left -= size;
    return LW_OK;
}

void lw_checked_file_read_end(struct lw_checked_file_reader *reader) {
    if (reader->file) fclose(reader->file);
    reader->file = NULL;
}
