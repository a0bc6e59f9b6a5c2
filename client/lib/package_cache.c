#include "client/lib/package_cache.h"

#include "common/atomic_file.h"
#include "common/file_read.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

/* FOLDER/HASH.lwscene: the same file that lightwell-import writes. malloc'ed; NULL: no memory. */
static char *path_of(const char *folder, const struct lw_package_hash *hash) {
    char name[2 * sizeof hash->bytes + 1], *path;
    for (size_t i = 0; i < sizeof hash->bytes; i++) snprintf(name + 2 * i, 3, "%02x", hash->bytes[i]);
    return asprintf(&path, "%s/%s.lwscene", folder, name) < 0 ? NULL : path;
}

bool lw_package_cache_read(const char *folder, const struct lw_package_hash *hash, uint64_t size,
                           uint8_t **out_bytes) {
    char *path = path_of(folder, hash);
    struct lw_package_hash found;
    uint8_t *bytes = NULL;
    size_t got;
    bool good = path && lw_file_read(path, size, true, &bytes, &got, NULL) == LW_OK && got == size;
    free(path);
    if (good) lw_package_hash(bytes, got, &found);
    good = good && memcmp(found.bytes, hash->bytes, sizeof found.bytes) == 0;
    if (good)
        *out_bytes = bytes;
    else
        free(bytes);
    return good;
}

/* All that lie above a file; opening it says what is wrong with them. */
static void make_folders(char *path) {
    for (char *slash = path; (slash = strchr(slash + 1, '/'));) {
        *slash = '\0';
        (void)mkdir(path, 0777);
        *slash = '/';
    }
}

enum lw_status lw_package_cache_write(const char *folder, const struct lw_package_hash *hash,
                                      const uint8_t *bytes, size_t size, struct lw_error *err) {
    char *path = path_of(folder, hash);
    if (!path) return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    make_folders(path);
    enum lw_status status = lw_atomic_file_save(path, bytes, size, err);
    free(path);
    return status;
}
