#include "common/base/control_path.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define SYSTEM_FOLDER "/run/lightwell" /* also systemd's RuntimeDirectory=lightwell */

/* "": it does not fit, or there is none. */
static void user_folder(char *dst, size_t size) {
    const char *runtime = getenv("XDG_RUNTIME_DIR");
    const int length = runtime && *runtime == '/' ? snprintf(dst, size, "%s/lightwell", runtime) : 0;
    if (length <= 0 || (size_t)length >= size) *dst = '\0';
}

static void temporary_folder(char *dst, size_t size) {
    snprintf(dst, size, "/tmp/lightwell-%u", (unsigned)geteuid());
}

/* Whether this user owns it, and nobody else may write into it. */
static bool is_own(const char *folder) {
    struct stat info;
    return lstat(folder, &info) == 0 && S_ISDIR(info.st_mode) && info.st_uid == geteuid() &&
           !(info.st_mode & 022);
}

static bool join(const char *folder, uint16_t port, char out_path[LW_CONTROL_PATH_SIZE]) {
    return (size_t)snprintf(out_path, LW_CONTROL_PATH_SIZE, "%s/%u.sock", folder, (unsigned)port) <
           LW_CONTROL_PATH_SIZE;
}

enum lw_status lw_control_path_make(uint16_t port, char out_path[LW_CONTROL_PATH_SIZE],
                                    struct lw_error *err) {
    char folder[LW_CONTROL_PATH_SIZE];
    const char *given = getenv("RUNTIME_DIRECTORY"); /* several are apart by colons */
    if (given && *given == '/' && strcspn(given, ":") < sizeof folder) {
        snprintf(folder, sizeof folder, "%.*s", (int)strcspn(given, ":"), given);
    } else {
        user_folder(folder, sizeof folder);
        if (!*folder && geteuid() == 0) snprintf(folder, sizeof folder, "%s", SYSTEM_FOLDER);
        if (!*folder) temporary_folder(folder, sizeof folder);
    }
    if (mkdir(folder, 0700) < 0 && errno != EEXIST)
        return lw_status_fail(err, LW_CANNOT_CREATE, "%s: %s", folder, strerror(errno));
    if (!is_own(folder))
        return lw_status_fail(err, LW_CANNOT_CREATE, "%s: is not a folder of this user alone", folder);
    if (!join(folder, port, out_path))
        return lw_status_fail(err, LW_CANNOT_CREATE, "%s: the path is too long for a socket", folder);
    return LW_OK;
}

bool lw_control_path_find(uint16_t port, unsigned index, char out_path[LW_CONTROL_PATH_SIZE]) {
    char user[LW_CONTROL_PATH_SIZE], temporary[LW_CONTROL_PATH_SIZE];
    user_folder(user, sizeof user);
    temporary_folder(temporary, sizeof temporary);
    const char *const folder[] = {user, SYSTEM_FOLDER, is_own(temporary) ? temporary : ""};
    for (unsigned i = 0; i < sizeof folder / sizeof *folder; i++)
        if (*folder[i] && join(folder[i], port, out_path) && index-- == 0) return true;
    return false;
}
