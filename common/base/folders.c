#include "common/base/folders.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

const char *lw_folders_temporary(void) {
    const char *folder = getenv("TMPDIR");
    return folder && *folder ? folder : "/tmp";
}

enum lw_status lw_folders_make_temporary(char *out_path, size_t capacity, struct lw_error *err) {
    const char *parent = lw_folders_temporary();
    const int length = snprintf(out_path, capacity, "%s/lightwell-XXXXXX", parent);
    if (length > 0 && (size_t)length < capacity && mkdtemp(out_path)) return LW_OK;
    const char *reason = length > 0 && (size_t)length < capacity ? strerror(errno) : "its path is too long";
    *out_path = '\0';
    return lw_status_fail(err, LW_CANNOT_CREATE, "cannot create a temporary folder in %.200s: %s", parent,
                          reason);
}

void lw_folders_remove_temporary(const char *path) {
    if (!*path) return;
    DIR *folder = opendir(path);
    for (struct dirent *entry; folder && (entry = readdir(folder));)
        unlinkat(dirfd(folder), entry->d_name, 0);
    if (folder) closedir(folder);
    rmdir(path);
}

enum lw_status lw_folders_make(const char *path, struct lw_error *err) {
    struct stat about;
    int failed = mkdir(path, 0777) < 0 ? errno : 0;
    if (failed == EEXIST) failed = stat(path, &about) < 0 ? errno : S_ISDIR(about.st_mode) ? 0 : ENOTDIR;
    if (!failed) return LW_OK;
    return lw_status_fail(err, LW_CANNOT_CREATE, "%s: cannot make the folder: %s", path, strerror(failed));
}

bool lw_folders_cache(char *out_path, size_t capacity) {
    const char *caches = getenv("XDG_CACHE_HOME"), *home = getenv("HOME");
    const bool given = caches && *caches == '/';
    if (given || (home && *home == '/')) {
        const int length =
            snprintf(out_path, capacity, "%s%s/lightwell", given ? caches : home, given ? "" : "/.cache");
        if (length > 0 && (size_t)length < capacity) return true;
    }
    *out_path = '\0';
    return false;
}

char *lw_folders_join(const char *folder, const char *name) {
    const size_t size = strlen(folder) + strlen(name) + 2;
    char *path = malloc(size);
    if (path) snprintf(path, size, "%s/%s", folder, name);
    return path;
}
