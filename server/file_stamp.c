#include "server/file_stamp.h"

#include <sys/stat.h>

struct lw_file_stamp lw_file_stamp(const char *path) {
    struct stat info;
    if (!path || stat(path, &info) != 0) return (struct lw_file_stamp){0};
    return (struct lw_file_stamp){info.st_dev, info.st_ino, (uint64_t)info.st_size,
                                  1000000000ull * (uint64_t)info.st_mtim.tv_sec +
                                      (uint64_t)info.st_mtim.tv_nsec};
}

bool lw_file_stamp_equal(const struct lw_file_stamp *a, const struct lw_file_stamp *b) {
    return a->device == b->device && a->number == b->number && a->size_bytes == b->size_bytes &&
           a->modified_ns == b->modified_ns;
}
