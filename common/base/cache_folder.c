#include "common/base/cache_folder.h"

#include <dirent.h>
#include <fcntl.h>
#include <limits.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define HASH_LETTERS (2 * LW_CACHE_FOLDER_HASH_SIZE)

char *lw_cache_folder_path(const char *folder, const uint8_t hash[LW_CACHE_FOLDER_HASH_SIZE],
                           const char *suffix) {
    char name[HASH_LETTERS + 1], *path;
    for (size_t i = 0; i < LW_CACHE_FOLDER_HASH_SIZE; i++) snprintf(name + 2 * i, 3, "%02x", hash[i]);
    return asprintf(&path, "%s/%s%s", folder, name, suffix) < 0 ? NULL : path;
}

void lw_cache_folder_make_above(char *path) {
    for (char *slash = path; (slash = strchr(slash + 1, '/'));) {
        *slash = '\0';
        (void)mkdir(path, 0777);
        *slash = '/';
    }
}

void lw_cache_folder_touch(const char *path) { (void)utimensat(AT_FDCWD, path, NULL, 0); }

static bool is_ours(const char *name, const char *const *suffix) {
    if (strspn(name, "0123456789abcdef") != HASH_LETTERS) return false;
    while (*suffix && strcmp(name + HASH_LETTERS, *suffix) != 0) suffix++;
    return *suffix != NULL;
}

/* Size of all that is kept in a folder; out_oldest: the name of the one that was used longest ago. */
static uint64_t survey(DIR *folder, const char *const *suffix, char out_oldest[NAME_MAX + 1]) {
    struct timespec oldest = {0};
    uint64_t bytes = 0;
    *out_oldest = '\0';
    rewinddir(folder);
    for (struct dirent *entry; (entry = readdir(folder));) {
        struct stat st;
        if (!is_ours(entry->d_name, suffix) ||
            fstatat(dirfd(folder), entry->d_name, &st, AT_SYMLINK_NOFOLLOW))
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

void lw_cache_folder_prune(const char *folder_path, const char *const *suffix, uint64_t bytes_max,
                           const char *newest) {
    char oldest[NAME_MAX + 1];
    DIR *folder = opendir(folder_path);
    while (folder && survey(folder, suffix, oldest) > bytes_max &&
           strcmp(oldest, strrchr(newest, '/') + 1) != 0)
        if (unlinkat(dirfd(folder), oldest, 0) != 0) break;
    if (folder) closedir(folder);
}
