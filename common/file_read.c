#include "common/file_read.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

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
    /* O_NONBLOCK: a scene may name a FIFO, whose open() would wait forever */
    int file = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    if (file < 0) return lw_status_fail(err, LW_NO_INPUT, "%s", strerror(errno));
    enum lw_status status = read_open_file(file, size_max, whole, out_bytes, out_size, err);
    close(file);
    return status;
}
