#include "server/publish/change_store.h"

#include "common/base/atomic_file.h"
#include "common/base/clock.h"
#include "common/base/folders.h"
#include "common/base/invariant.h"
#include "common/base/log.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <xxhash.h>

#define VERSION  1u
#define RETRY_NS 1000000000ull /* between two attempts without new changes */

struct header {
    char magic[8];
    uint32_t version, change_size;
    uint8_t key[LW_CHANGE_STORE_KEY_SIZE];
};

/* Before each list. */
struct list {
    uint32_t count, spare;
    uint64_t checksum; /* XXH3-64 of its changes */
};

static struct header header_of(const struct lw_change_store *store) {
    struct header header = {
        .magic = "lwchange", .version = VERSION, .change_size = sizeof(struct lw_scene_change)};
    memcpy(header.key, store->key, sizeof header.key);
    return header;
}

/* ---- reading ---- */

struct kept {
    struct lw_scene_change *change;
    size_t count;
};

/* *out_whole: false: the file ends before. Errors: LW_IO. */
static enum lw_status read_all(int file, void *bytes, size_t size, bool *out_whole) {
    *out_whole = true;
    for (size_t done = 0; done < size && *out_whole;) {
        const ssize_t got = read(file, (char *)bytes + done, size - done);
        if (got < 0 && errno == EINTR) continue;
        if (got < 0) return LW_IO;
        *out_whole = got > 0;
        done += (size_t)got;
    }
    return LW_OK;
}

/* *out_done: the list ends the file, or is not whole. left: bytes of the file behind the last list. */
static enum lw_status read_list(int file, uint64_t left, struct kept *kept, bool *out_done) {
    struct list list;
    bool whole;
    *out_done = true;
    if (left < sizeof list) return LW_OK;
    enum lw_status status = read_all(file, &list, sizeof list, &whole);
    if (status != LW_OK || !whole) return status;
    const size_t size = list.count * sizeof(struct lw_scene_change);
    if (list.count > LW_CHANGE_STORE_COUNT_MAX || size > left - sizeof list) return LW_OK;
    struct lw_scene_change *grown = realloc(kept->change, (kept->count + list.count + 1) * sizeof *grown);
    if (!grown) return LW_NO_MEMORY;
    kept->change = grown;
    status = read_all(file, grown + kept->count, size, &whole);
    if (status != LW_OK || !whole || XXH3_64bits(grown + kept->count, size) != list.checksum) return status;
    kept->count += list.count;
    *out_done = false;
    return LW_OK;
}

static enum lw_status read_lists(struct lw_change_store *store, uint64_t size, struct kept *kept,
                                 struct lw_error *err) {
    for (bool done = false; !done;) {
        const size_t before = kept->count;
        const enum lw_status status = read_list(store->file, size - store->bytes, kept, &done);
        if (status == LW_NO_MEMORY) return lw_status_fail(err, status, "%s: out of memory", store->path);
        if (status != LW_OK) return lw_status_fail(err, status, "%s: %s", store->path, strerror(errno));
        if (!done) store->bytes += sizeof(struct list) + (kept->count - before) * sizeof *kept->change;
    }
    if (store->bytes < size)
        lw_log(LW_LOG_WARNING, "%s: the last changes are not whole and are left out", store->path);
    store->bytes_at_first = sizeof(struct header); /* an old file is rewritten as soon as it is large */
    if (ftruncate(store->file, (off_t)store->bytes) == 0 &&
        lseek(store->file, (off_t)store->bytes, SEEK_SET) == (off_t)store->bytes)
        return LW_OK;
    return lw_status_fail(err, LW_IO, "%s: %s", store->path, strerror(errno));
}

/* ---- writing ---- */

static bool write_all(int file, const void *bytes, size_t size) {
    for (size_t done = 0; done < size;) {
        const ssize_t put = write(file, (const char *)bytes + done, size - done);
        if (put < 0 && errno == EINTR) continue;
        if (put < 0) return false;
        done += (size_t)put;
    }
    return true;
}

static struct list list_of(const struct lw_scene_change *change, size_t count) {
    LW_INVARIANT(count <= LW_CHANGE_STORE_COUNT_MAX);
    return (struct list){.count = (uint32_t)count, .checksum = XXH3_64bits(change, count * sizeof *change)};
}

static bool append_list(int file, const struct lw_scene_change *change, size_t count) {
    const struct list list = list_of(change, count);
    return write_all(file, &list, sizeof list) && write_all(file, change, count * sizeof *change);
}

static void close_file(struct lw_change_store *store) {
    if (store->file >= 0) close(store->file);
    store->file = -1;
}

/* Rewrites the file with these changes alone. It replaces the old one as a whole. */
static enum lw_status begin_file(struct lw_change_store *store, const struct lw_scene_change *change,
                                 size_t count, struct lw_error *err) {
    const struct header header = header_of(store);
    const struct list list = list_of(change, count);
    const size_t list_size = count ? sizeof list : 0; /* without changes there is no list */
    struct lw_atomic_file file;
    close_file(store);
    enum lw_status status = lw_atomic_file_open(&file, store->path, err);
    if (status != LW_OK) return status;
    file.durable = true; /* it replaces changes that the disk may have */
    status = lw_atomic_file_write(&file, &header, sizeof header, err);
    if (status == LW_OK) status = lw_atomic_file_write(&file, &list, list_size, err);
    if (status == LW_OK) status = lw_atomic_file_write(&file, change, count * sizeof *change, err);
    if (status != LW_OK) {
        lw_atomic_file_abandon(&file);
        return status;
    }
    if ((status = lw_atomic_file_commit(&file, err)) != LW_OK) return status;
    store->file = open(store->path, O_WRONLY | O_APPEND | O_CLOEXEC);
    if (store->file < 0) return lw_status_fail(err, LW_IO, "%s: %s", store->path, strerror(errno));
    store->bytes = sizeof header + list_size + count * sizeof *change;
    store->bytes_at_first = store->bytes;
    return LW_OK;
}

static enum lw_status begin_from_state(struct lw_change_store *store, const struct lw_scene_state *state,
                                       double wall_s, struct lw_error *err) {
    struct lw_scene_change *change;
    size_t count;
    if (lw_scene_state_changes(state, wall_s, &change, &count) != LW_OK)
        return lw_status_fail(err, LW_NO_MEMORY, "%s: out of memory", store->path);
    enum lw_status status = begin_file(store, change, count, err);
    free(change);
    return status;
}

/* ---- the store ---- */

enum lw_status lw_change_store_open(struct lw_change_store *store, const char *folder,
                                    const uint8_t key[LW_CHANGE_STORE_KEY_SIZE],
                                    struct lw_scene_change **out_change, size_t *out_count,
                                    struct lw_error *err) {
    struct kept kept = {0};
    struct header found;
    struct stat st;
    *store = (struct lw_change_store){.file = -1, .path = lw_folders_join(folder, "changes")};
    if (!store->path) return lw_status_fail(err, LW_NO_MEMORY, "%s: out of memory", folder);
    memcpy(store->key, key, sizeof store->key);
    (void)lw_atomic_file_sweep(store->path);
    const struct header expected = header_of(store);
    store->file = open(store->path, O_RDWR | O_CLOEXEC);
    bool whole = false;
    enum lw_status status = LW_OK;
    if (store->file < 0 && errno != ENOENT)
        status = lw_status_fail(err, LW_CANNOT_CREATE, "%s: %s", store->path, strerror(errno));
    else if (store->file >= 0 &&
             (fstat(store->file, &st) != 0 || read_all(store->file, &found, sizeof found, &whole) != LW_OK))
        status = lw_status_fail(err, LW_IO, "%s: %s", store->path, strerror(errno));
    if (status == LW_OK && whole && S_ISREG(st.st_mode) && memcmp(&found, &expected, sizeof found) == 0) {
        store->bytes = sizeof found;
        status = read_lists(store, (uint64_t)st.st_size, &kept, err);
    } else if (status == LW_OK) {
        if (store->file >= 0)
            lw_log(LW_LOG_WARNING, "%s: holds no changes of this scene: they are dropped", store->path);
        status = begin_file(store, NULL, 0, err);
    }
    if (status == LW_OK) {
        *out_change = kept.change;
        *out_count = kept.count;
        return LW_OK;
    }
    free(kept.change);
    lw_change_store_finish(store);
    return status;
}

void lw_change_store_finish(struct lw_change_store *store) {
    if (store->path) close_file(store);
    free(store->path);
    *store = (struct lw_change_store){0};
}

/* Where a change sets the clock going, or stops it, its time belongs to it. */
static bool needs_time(const struct lw_scene_change *change, size_t count) {
    for (size_t i = count; i-- > 0;)
        if (change[i].kind == LW_SCENE_CHANGE_CLOCK_PAUSE || change[i].kind == LW_SCENE_CHANGE_CLOCK_PLAY ||
            change[i].kind == LW_SCENE_CHANGE_CLOCK_RATE)
            return true;
    return false;
}

static bool append(struct lw_change_store *store, const struct lw_scene_change *change, size_t count,
                   const struct lw_scene_state *state, double wall_s) {
    const struct lw_scene_change time = lw_scene_state_seek(state, wall_s);
    const bool timed = needs_time(change, count);
    if (store->file < 0 || store->bytes > LW_CHANGE_STORE_GROWN + 2 * store->bytes_at_first) return false;
    if (!append_list(store->file, change, count) || (timed && !append_list(store->file, &time, 1))) {
        close_file(store); /* nothing may follow a list that is not whole */
        return false;
    }
    store->bytes += (timed ? 2 : 1) * sizeof(struct list) + (count + timed) * sizeof *change;
    return true;
}

bool lw_change_store_add(struct lw_change_store *store, const struct lw_scene_change *change, size_t count,
                         const struct lw_scene_state *state, double wall_s) {
    struct lw_error err = {0};
    if (!count && store->file >= 0) return true;
    const uint64_t now_ns = lw_clock_ns();
    if (!count && now_ns - store->failed_ns < RETRY_NS) return true; /* the failed call returned false */
    const bool kept =
        append(store, change, count, state, wall_s) || begin_from_state(store, state, wall_s, &err) == LW_OK;
    if (!kept && !store->warned) lw_log(LW_LOG_WARNING, "changes of clients are not kept: %s", err.text);
    store->warned = !kept;
    store->failed_ns = now_ns;
    return kept;
}

void lw_change_store_discard(struct lw_change_store *store) { close_file(store); }
