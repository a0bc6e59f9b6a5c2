#include "client/lib/package_cache.h"

#include "common/atomic_file.h"
#include "common/file_read.h"
#include "common/log.h"

#include <dirent.h>
#include <fcntl.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define HASH_LETTERS (2 * sizeof(struct lw_package_hash))

/* FOLDER/HASH.lwscene is the same file that lightwell-import writes. */
static const char *const suffix[] = {
    [LW_PACKAGE_CACHE_PACKAGE] = ".lwscene", [LW_PACKAGE_CACHE_PART] = ".lwpart"};

/* malloc'ed; NULL: no memory. */
static char *path_of(const char *folder, enum lw_package_cache_kind kind,
                     const struct lw_package_hash *hash) {
    char name[HASH_LETTERS + 1], *path;
    for (size_t i = 0; i < sizeof hash->bytes; i++) snprintf(name + 2 * i, 3, "%02x", hash->bytes[i]);
    return asprintf(&path, "%s/%s%s", folder, name, suffix[kind]) < 0 ? NULL : path;
}

enum lw_package_cache_found lw_package_cache_read(const char *folder, enum lw_package_cache_kind kind,
                                                  const struct lw_package_hash *hash, uint64_t size,
                                                  uint8_t **out_bytes) {
    char *path = path_of(folder, kind, hash);
    struct lw_package_hash found;
    uint8_t *bytes = NULL;
    size_t got;
    bool good = path && lw_file_read(path, size, true, &bytes, &got, NULL) == LW_OK && got == size;
    if (good) lw_package_hash(bytes, got, &found);
    good = good && memcmp(found.bytes, hash->bytes, sizeof found.bytes) == 0;
    if (good) {
        (void)utimensat(AT_FDCWD, path, NULL, 0); /* it is of use: others go first */
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

/* All that lie above a file; opening it says what is wrong with them. */
static void make_folders(char *path) {
    for (char *slash = path; (slash = strchr(slash + 1, '/'));) {
        *slash = '\0';
        (void)mkdir(path, 0777);
        *slash = '/';
    }
}

static bool is_ours(const char *name) {
    return strspn(name, "0123456789abcdef") == HASH_LETTERS &&
           (strcmp(name + HASH_LETTERS, suffix[LW_PACKAGE_CACHE_PACKAGE]) == 0 ||
            strcmp(name + HASH_LETTERS, suffix[LW_PACKAGE_CACHE_PART]) == 0);
}

/* Size of all that is kept in a folder; out_oldest: the name of the one that was used longest ago. */
static uint64_t survey(DIR *folder, char out_oldest[NAME_MAX + 1]) {
    struct timespec oldest = {0};
    uint64_t bytes = 0;
    *out_oldest = '\0';
    rewinddir(folder);
    for (struct dirent *entry; (entry = readdir(folder));) {
        struct stat st;
        if (!is_ours(entry->d_name) || fstatat(dirfd(folder), entry->d_name, &st, AT_SYMLINK_NOFOLLOW))
            continue;
        bytes += (uint64_t)st.st_size;
        const struct timespec used = st.st_mtim;
        if (*out_oldest &&
            (used.tv_sec > oldest.tv_sec || (used.tv_sec == oldest.tv_sec && used.tv_nsec >= oldest.tv_nsec)))
            continue;
        oldest = used;
        snprintf(out_oldest, NAME_MAX + 1, "%s", entry->d_name);
    }
    return bytes;
}

/* Makes room beside `newest`, the path of one that has just been written. */
static void remove_oldest(const char *folder_path, const char *newest) {
    char oldest[NAME_MAX + 1];
    DIR *folder = opendir(folder_path);
    while (folder && survey(folder, oldest) > LW_PACKAGE_CACHE_BYTES_MAX &&
           strcmp(oldest, strrchr(newest, '/') + 1) != 0)
        if (unlinkat(dirfd(folder), oldest, 0) != 0) break;
    if (folder) closedir(folder);
}

enum lw_status lw_package_cache_write(const char *folder, enum lw_package_cache_kind kind,
                                      const struct lw_package_hash *hash, const uint8_t *bytes, size_t size,
                                      struct lw_error *err) {
    char *path = path_of(folder, kind, hash);
    if (!path) return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    make_folders(path);
    enum lw_status status = lw_atomic_file_save(path, bytes, size, err);
    if (status == LW_OK) remove_oldest(folder, path);
    free(path);
    return status;
}
