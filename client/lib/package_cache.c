#include "client/lib/package_cache.h"

#include "common/base/atomic_file.h"
#include "common/base/cache_folder.h"
#include "common/base/file_read.h"
#include "common/base/log.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* FOLDER/HASH.lwscene is the same file that lightwell-import writes. */
static const char *const suffix[] = {
    [LW_PACKAGE_CACHE_PACKAGE] = ".lwscene", [LW_PACKAGE_CACHE_PART] = ".lwpart", NULL};
_Static_assert(sizeof(struct lw_package_hash) == LW_CACHE_FOLDER_HASH_SIZE, "files are named by it");

enum lw_package_cache_found lw_package_cache_read(const char *folder, enum lw_package_cache_kind kind,
                                                  const struct lw_package_hash *hash, uint64_t size,
                                                  uint8_t **out_bytes) {
    char *path = lw_cache_folder_path(folder, hash->bytes, suffix[kind]);
    struct lw_package_hash found;
    uint8_t *bytes = NULL;
    size_t got;
    bool good = path && lw_file_read(path, size, true, &bytes, &got, NULL) == LW_OK && got == size;
    if (good) lw_package_hash(bytes, got, &found);
    good = good && memcmp(found.bytes, hash->bytes, sizeof found.bytes) == 0;
    if (good) {
        lw_cache_folder_touch(path);
        *out_bytes = bytes;
    } else
        free(bytes);
    const bool is_there = path && access(path, F_OK) == 0;
    free(path);
    return good ? LW_PACKAGE_CACHE_FOUND : is_there ? LW_PACKAGE_CACHE_DAMAGED : LW_PACKAGE_CACHE_ABSENT;
}

void lw_package_cache_warn(void *context, const char *folder) {
    (void)context;
    lw_log(LW_LOG_WARNING, "a scene package in %s is damaged or cannot be read: it is downloaded again",
           folder);
}

void lw_package_cache_warn_unkept(void *context, const char *why) {
    (void)context;
    lw_log(LW_LOG_WARNING, "the scene package is not kept, and the next client downloads it again: %s", why);
}

enum lw_status lw_package_cache_write(const char *folder, enum lw_package_cache_kind kind,
                                      const struct lw_package_hash *hash, const uint8_t *bytes, size_t size,
                                      struct lw_error *err) {
    char *path = lw_cache_folder_path(folder, hash->bytes, suffix[kind]);
    if (!path) return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    lw_cache_folder_make_above(path);
    enum lw_status status = lw_atomic_file_save(path, bytes, size, err);
    if (status == LW_OK) lw_cache_folder_prune(folder, suffix, LW_PACKAGE_CACHE_BYTES_MAX, path);
    free(path);
    return status;
}
