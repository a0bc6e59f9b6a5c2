#include "common/base/secret_file.h"

#include "common/base/file_read.h"

#include <errno.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#define CREDENTIAL "credential:"

/* Where a credential lies. */
static enum lw_status find_credential(const char *name, char *dst, size_t size, struct lw_error *err) {
    const char *folder = getenv("CREDENTIALS_DIRECTORY");
    if (!folder)
        return lw_status_fail(err, LW_NO_INPUT,
                              CREDENTIAL "%s: $CREDENTIALS_DIRECTORY is not set: systemd "
                                         "sets it for a unit that has LoadCredential=%s:FILE",
                              name, name);
    if (!*name || strchr(name, '/'))
        return lw_status_fail(err, LW_BAD_DATA, CREDENTIAL "%s is not the name of a credential", name);
    if ((size_t)snprintf(dst, size, "%s/%s", folder, name) >= size)
        return lw_status_fail(err, LW_NO_INPUT, CREDENTIAL "%s: its path is too long", name);
    return LW_OK;
}

static enum lw_status check_readers(const char *path, enum lw_secret_file_readers readers,
                                    struct lw_error *err) {
    const mode_t others = readers == LW_SECRET_FILE_OWNER ? 077 : readers == LW_SECRET_FILE_GROUP ? 07 : 0;
    struct stat info;
    if (stat(path, &info) < 0) return lw_status_fail(err, LW_NO_INPUT, "%s: %s", path, strerror(errno));
    if (!S_ISREG(info.st_mode) || !(info.st_mode & others)) return LW_OK;
    return lw_status_fail(err, LW_BAD_DATA, "%s: others can read or change it (mode %04o): chmod %s '%s'",
                          path, (unsigned)info.st_mode & 07777,
                          readers == LW_SECRET_FILE_OWNER ? "600" : "640", path);
}

enum lw_status lw_secret_file_read(const char *path, enum lw_secret_file_readers readers, uint64_t size_max,
                                   uint8_t **out_bytes, size_t *out_size, struct lw_error *err) {
    char credential[PATH_MAX];
    const bool is_credential = strncmp(path, CREDENTIAL, strlen(CREDENTIAL)) == 0;
    enum lw_status status =
        is_credential ? find_credential(path + strlen(CREDENTIAL), credential, sizeof credential, err)
                      : check_readers(path, readers, err);
    if (status != LW_OK) return status;
    struct lw_error cause = {0};
    uint8_t *bytes;
    size_t size;
    status = lw_file_read(is_credential ? credential : path, size_max, true, &bytes, &size, &cause);
    if (status != LW_OK) return lw_status_fail(err, status, "%s: %s", path, cause.text);
    uint8_t *ended = malloc(size + 1);
    if (ended) {
        memcpy(ended, bytes, size);
        ended[size] = 0;
    }
    lw_secret_file_free(bytes, size);
    if (!ended) return lw_status_fail(err, LW_NO_MEMORY, "%s: out of memory", path);
    *out_bytes = ended;
    *out_size = size;
    return LW_OK;
}

void lw_secret_file_free(uint8_t *bytes, size_t size) {
    if (bytes) explicit_bzero(bytes, size);
    free(bytes);
}
