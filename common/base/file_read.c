#include "common/base/file_read.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/openat2.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

/* O_NONBLOCK: a scene may name a FIFO, whose open() would wait forever */
#define OPEN_FLAGS    (O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY)
#define ATTEMPTS      8   /* while somebody moves folders about, the kernel cannot tell where ".." leads */
#define NAME_SIZE_MAX 256 /* one part of a path, with its NUL */

static enum lw_status read_open_file(int file, uint64_t size_max, bool whole, uint8_t **out_bytes,
                                     size_t *out_size, struct lw_error *err) {
    struct stat info;
    if (fstat(file, &info) < 0) return lw_status_fail(err, LW_IO, "%s", strerror(errno));
    if (!S_ISREG(info.st_mode)) return lw_status_fail(err, LW_BAD_DATA, "is not a regular file");
    uint64_t size = (uint64_t)info.st_size;
    if (size > size_max && whole)
        return lw_status_fail(err, LW_BAD_DATA, "has %llu bytes; the limit is %llu", (unsigned long long)size,
                              (unsigned long long)size_max);
    if (size > size_max) size = size_max;
    uint8_t *bytes = malloc(size ? size : 1);
    if (!bytes)
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory for %llu bytes", (unsigned long long)size);
    uint64_t done = 0;
    while (done < size) {
        ssize_t got = read(file, bytes + done, size - done);
        if (got < 0 && errno == EINTR) continue;
        if (got <= 0) {
            free(bytes);
            return lw_status_fail(err, LW_IO, "%s",
                                  got < 0 ? strerror(errno) : "became shorter while it was read");
        }
        done += (uint64_t)got;
    }
    *out_bytes = bytes;
    *out_size = size;
    return LW_OK;
}

enum lw_status lw_file_read(const char *path, uint64_t size_max, bool whole, uint8_t **out_bytes,
                            size_t *out_size, struct lw_error *err) {
    int file = open(path, OPEN_FLAGS);
    if (file < 0) return lw_status_fail(err, LW_NO_INPUT, "%s", strerror(errno));
    enum lw_status status = read_open_file(file, size_max, whole, out_bytes, out_size, err);
    close(file);
    return status;
}

/* Part by part, each of them no link. Ends with folder closed. */
static int open_by_parts(int folder, const char *path) {
    for (;;) {
        path += strspn(path, "/");
        const size_t length = strcspn(path, "/");
        char name[NAME_SIZE_MAX];
        const bool good = snprintf(name, sizeof name, "%.*s", (int)length, path) < (int)sizeof name;
        const bool last = !path[length + strspn(path + length, "/")], up = strcmp(name, "..") == 0;
        const int next =
            !good || up || !length
                ? -1
                : openat(folder, name, O_NOFOLLOW | O_CLOEXEC | (last ? OPEN_FLAGS : O_PATH | O_DIRECTORY));
        const int error = !good ? ENAMETOOLONG : up ? EXDEV : !length ? ENOENT : errno;
        close(folder);
        errno = error;
        if (next < 0 || last) return next;
        folder = next;
        path += length;
    }
}

static int open_beneath(const char *folder_path, const char *path) {
    const int folder = open(folder_path, O_PATH | O_DIRECTORY | O_CLOEXEC);
    if (folder < 0) return -1;
    const struct open_how how = {.flags = OPEN_FLAGS, .resolve = RESOLVE_BENEATH | RESOLVE_NO_MAGICLINKS};
    long file = -1;
    for (int i = 0; i < ATTEMPTS; i++) {
        file = syscall(SYS_openat2, folder, path, &how, sizeof how);
        if (file >= 0 || errno != EAGAIN) break;
    }
    /* EPERM: the filter of an older container does not know the call */
    if (file < 0 && (errno == ENOSYS || errno == EPERM)) return open_by_parts(folder, path);
    const int error = errno;
    close(folder);
    errno = error;
    return (int)file;
}

enum lw_status lw_file_read_beneath(const char *folder, const char *path, uint64_t size_max, bool whole,
                                    uint8_t **out_bytes, size_t *out_size, struct lw_error *err) {
    const int file = open_beneath(folder, path);
    if (file < 0 && (errno == EXDEV || errno == ELOOP))
        return lw_status_fail(err, LW_BAD_DATA, "leads out of the folder, by a link or an absolute path");
    if (file < 0) return lw_status_fail(err, LW_NO_INPUT, "%s", strerror(errno));
    enum lw_status status = read_open_file(file, size_max, whole, out_bytes, out_size, err);
    close(file);
    return status;
}
