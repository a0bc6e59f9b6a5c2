#include "common/base/atomic_file.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#define NAME_ATTEMPTS 100u
#define PART_BYTES    ((size_t)4 << 20) /* one write() at most: `stop` is read between two */

static enum lw_status fail(const struct lw_atomic_file *file, enum lw_status status, int error,
                           struct lw_error *err) {
    return lw_status_fail(err, status, "%s: %s", file->path, strerror(error));
}

static void release(struct lw_atomic_file *file) {
    if (file->fd >= 0) close(file->fd);
    free(file->temporary_path);
    free(file->path);
    *file = (struct lw_atomic_file){.fd = -1};
}

/* As open_temporary() names them: ".PID-N.tmp" after the name. */
static bool is_temporary_suffix(const char *suffix) {
    static const char digits[] = "0123456789";
    if (*suffix++ != '.') return false;
    const size_t pid = strspn(suffix, digits);
    if (!pid || suffix[pid] != '-') return false;
    suffix += pid + 1;
    const size_t number = strspn(suffix, digits);
    return number && strcmp(suffix + number, ".tmp") == 0;
}

/* A shared lock, which a descriptor for reading may take on every file system: the writer's keeps it away. */
static bool is_left(int folder, const char *name) {
    const int fd = openat(folder, name, O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
    const bool left = fd >= 0 && flock(fd, LOCK_SH | LOCK_NB) == 0;
    if (fd >= 0) close(fd);
    return left;
}

unsigned lw_atomic_file_sweep(const char *path) {
    const char *slash = strrchr(path, '/'), *name = slash ? slash + 1 : path;
    char *folder_path = slash ? strndup(path, (size_t)(slash - path) + 1) : strdup(".");
    DIR *folder = folder_path ? opendir(folder_path) : NULL;
    unsigned count = 0;
    for (const struct dirent *entry; folder && (entry = readdir(folder));)
        if (strncmp(entry->d_name, name, strlen(name)) == 0 &&
            is_temporary_suffix(entry->d_name + strlen(name)) && is_left(dirfd(folder), entry->d_name) &&
            unlinkat(dirfd(folder), entry->d_name, 0) == 0)
            count++;
    if (folder) closedir(folder);
    free(folder_path);
    return count;
}

/* Tells sweepers that this file is in work. False: one of them came between open() and here. */
static bool lock(int fd) {
    struct stat st;
    return flock(fd, LOCK_EX | LOCK_NB) != 0 || fstat(fd, &st) != 0 || st.st_nlink > 0;
}

/* old  the file that is to be replaced; NULL: there is none */
static int open_temporary(struct lw_atomic_file *file, const struct stat *old) {
    static _Atomic unsigned serial; /* two threads may write the same path */
    for (unsigned attempt = 0; attempt < NAME_ATTEMPTS; attempt++) {
        char *name;
        if (asprintf(&name, "%s.%ld-%u.tmp", file->path, (long)getpid(), atomic_fetch_add(&serial, 1)) < 0)
            return ENOMEM;
        /* O_EXCL: never through a link that somebody laid; 0666: the user's umask decides, unlike mkstemp */
        file->fd = open(name, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, old ? old->st_mode & 0777 : 0666);
        if (file->fd >= 0 && lock(file->fd)) {
            file->temporary_path = name;
            /* either may fail: only root gives files away, and some file systems have no modes */
            if (old && (fchown(file->fd, old->st_uid, old->st_gid) | fchmod(file->fd, old->st_mode & 0777)))
                errno = 0;
            return 0;
        }
        int error = file->fd >= 0 ? EEXIST : errno;
        if (file->fd >= 0) close(file->fd);
        file->fd = -1;
        free(name);
        if (error != EEXIST) return error;
    }
    return EEXIST;
}

/* Says which folder is missing: that is what people can mend. */
static enum lw_status fail_to_open(const struct lw_atomic_file *file, int error, struct lw_error *err) {
    const char *slash = strrchr(file->path, '/');
    if (error == EISDIR)
        return lw_status_fail(err, LW_CANNOT_CREATE, "%s: is a folder; name a file", file->path);
    if (slash && (error == ENOENT || error == ENOTDIR))
        return lw_status_fail(err, LW_CANNOT_CREATE, "%s: there is no folder %.*s; make it first", file->path,
                              (int)(slash - file->path), file->path);
    return fail(file, error == ENOMEM ? LW_NO_MEMORY : LW_CANNOT_CREATE, error, err);
}

enum lw_status lw_atomic_file_open(struct lw_atomic_file *file, const char *path, struct lw_error *err) {
    *file = (struct lw_atomic_file){.fd = -1};
    /* a link stays a link: write what it points to */
    file->path = realpath(path, NULL);
    if (!file->path) file->path = strdup(path);
    if (!file->path) return lw_status_fail(err, LW_NO_MEMORY, "%s: out of memory", path);
    int error = 0;
    struct stat st;
    bool exists = stat(file->path, &st) == 0;
    if (exists && S_ISDIR(st.st_mode))
        error = EISDIR;
    else if (exists && !S_ISREG(st.st_mode)) {
        file->fd = open(file->path, O_WRONLY | O_CLOEXEC);
        if (file->fd < 0) error = errno;
    } else
        error = open_temporary(file, exists ? &st : NULL);
    if (!error) return LW_OK;
    enum lw_status status = fail_to_open(file, error, err);
    release(file);
    return status;
}

enum lw_status lw_atomic_file_check(const char *path, struct lw_error *err) {
    struct stat st;
    struct lw_atomic_file file;
    /* a reader of a pipe would take our coming and going for all there is */
    if (stat(path, &st) == 0 && !S_ISREG(st.st_mode) && !S_ISDIR(st.st_mode)) {
        if (access(path, W_OK) == 0) return LW_OK;
        return lw_status_fail(err, LW_CANNOT_CREATE, "%s: %s", path, strerror(errno));
    }
    enum lw_status status = lw_atomic_file_open(&file, path, err);
    if (status == LW_OK) lw_atomic_file_abandon(&file);
    return status;
}

static enum lw_status check_stop(const struct lw_atomic_file *file, struct lw_error *err) {
    if (!file->stop || !*file->stop) return LW_OK;
    return lw_status_fail(err, LW_CLOSED, "%s: stopped before it was whole", file->path);
}

enum lw_status lw_atomic_file_write(struct lw_atomic_file *file, const void *bytes, size_t size,
                                    struct lw_error *err) {
    const char *at = bytes;
    while (size) {
        const enum lw_status status = check_stop(file, err);
        if (status != LW_OK) return status;
        ssize_t written = write(file->fd, at, size < PART_BYTES ? size : PART_BYTES);
        if (written < 0 && errno == EINTR) continue;
        if (written < 0) return fail(file, LW_IO, errno, err);
        at += written;
        size -= (size_t)written;
    }
    return LW_OK;
}

enum lw_status lw_atomic_file_write_at(struct lw_atomic_file *file, const void *bytes, size_t size,
                                       uint64_t offset_bytes, struct lw_error *err) {
    const char *at = bytes;
    while (size) {
        ssize_t written = pwrite(file->fd, at, size, (off_t)offset_bytes);
        if (written < 0 && errno == EINTR) continue;
        if (written < 0) return fail(file, LW_IO, errno, err);
        at += written;
        offset_bytes += (uint64_t)written;
        size -= (size_t)written;
    }
    return LW_OK;
}

/* Some file systems cannot, which is no failure to write. */
static bool synchronise(int fd) {
    return fsync(fd) == 0 || errno == EINVAL || errno == ENOTSUP || errno == EROFS;
}

/* The new name, too, is bytes that the disk may not have yet. */
static void synchronise_folder(const struct lw_atomic_file *file) {
    const char *slash = strrchr(file->path, '/');
    char *path = slash ? strndup(file->path, (size_t)(slash - file->path) + 1) : strdup(".");
    const int fd = path ? open(path, O_RDONLY | O_DIRECTORY | O_CLOEXEC) : -1;
    free(path);
    if (fd < 0) return; /* one may write in a folder that one may not read */
    (void)synchronise(fd);
    close(fd);
}

enum lw_status lw_atomic_file_commit(struct lw_atomic_file *file, struct lw_error *err) {
    const bool wait = file->durable && file->temporary_path;
    enum lw_status status = check_stop(file, err);
    if (status == LW_OK && wait && !synchronise(file->fd)) status = fail(file, LW_IO, errno, err);
    /* the lock goes with the descriptor: a sweeper that came before the rename would take the file away */
    int fd = file->temporary_path ? dup(file->fd) : -1;
    if (close(file->fd) && status == LW_OK) /* network file systems tell of a full disk only here */
        status = fail(file, LW_IO, errno, err);
    file->fd = fd;
    if (status == LW_OK && file->temporary_path && rename(file->temporary_path, file->path))
        status = fail(file, LW_CANNOT_CREATE, errno, err);
    if (status && file->temporary_path) unlink(file->temporary_path);
    if (status == LW_OK && wait) synchronise_folder(file);
    release(file);
    return status;
}

void lw_atomic_file_abandon(struct lw_atomic_file *file) {
    if (file->temporary_path) unlink(file->temporary_path);
    release(file);
}

enum lw_status lw_atomic_file_save(const char *path, const void *bytes, size_t size, struct lw_error *err) {
    struct lw_atomic_file file;
    enum lw_status status = lw_atomic_file_open(&file, path, err);
    if (status != LW_OK) return status;
    status = lw_atomic_file_write(&file, bytes, size, err);
    if (status == LW_OK) return lw_atomic_file_commit(&file, err);
    lw_atomic_file_abandon(&file);
    return status;
}
