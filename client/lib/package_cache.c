#include "client/lib/package_cache.h"

#include "common/atomic_file.h"

#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

/* FOLDER/HASH.lwscene: the same file that lightwell-import writes. malloc'ed; NULL: no memory. */
static char *path_of(const char *folder, const struct lw_package_hash *hash) {
    char name[2 * sizeof hash->bytes + 1], *path;
    for (size_t i = 0; i < sizeof hash->bytes; i++) snprintf(name + 2 * i, 3, "%02x", hash->bytes[i]);
    return asprintf(&path, "%s/%s.lwscene", folder, name) < 0 ? NULL : path;
}

static bool read_all(int file, uint8_t *bytes, size_t size) {
    for (size_t got = 0; got < size;) {
        ssize_t n = read(file, bytes + got, size - got);
        if (n <= 0) return false;
        got += (size_t)n;
    }
    return true;
}

bool lw_package_cache_read(const char *folder, const struct lw_package_hash *hash, uint64_t size,
                           uint8_t **out_bytes) {
    char *path = path_of(folder, hash);
    const int file = path ? open(path, O_RDONLY | O_CLOEXEC) : -1;
    free(path);
    if (file < 0) return false;
    struct stat status;
    struct lw_package_hash found;
    uint8_t *bytes = NULL;
    /* its size first: what a server says must not make us allocate more than there is */
    bool good = fstat(file, &status) == 0 && S_ISREG(status.st_mode) && (uint64_t)status.st_size == size &&
                (bytes = malloc((size_t)size + 1)) && read_all(file, bytes, (size_t)size);
    close(file);
    if (good) lw_package_hash(bytes, (size_t)size, &found);
    good = good && memcmp(found.bytes, hash->bytes, sizeof found.bytes) == 0;
    if (good)
        *out_bytes = bytes;
    else
        free(bytes);
    return good;
}

enum lw_status lw_package_cache_write(const char *folder, const struct lw_package_hash *hash,
                                      const uint8_t *bytes, size_t size, struct lw_error *err) {
    char *path = path_of(folder, hash);
    if (!path) return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    (void)mkdir(folder, 0777); /* opening says what is wrong with it */
    enum lw_status status = lw_atomic_file_save(path, bytes, size, err);
    free(path);
    return status;
}
