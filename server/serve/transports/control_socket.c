#include "server/serve/transports/control_socket.h"

#include "common/base/control_path.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

/* Whether it is a socket on which nobody listens any more. */
static bool is_left_over(const char *path) {
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    struct stat info;
    if (lstat(path, &info) < 0 || !S_ISSOCK(info.st_mode) || strlen(path) >= sizeof address.sun_path)
        return false;
    strcpy(address.sun_path, path);
    const int descriptor = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    if (descriptor < 0) return false;
    const bool refused =
        connect(descriptor, (struct sockaddr *)&address, sizeof address) < 0 && errno == ECONNREFUSED;
    close(descriptor);
    return refused;
}

enum lw_status lw_control_socket_bind(uv_pipe_t *pipe, const char *path, uint16_t port,
                                      struct lw_error *err) {
    char chosen[LW_CONTROL_PATH_SIZE];
    if (strcmp(path, "auto") == 0) {
        const enum lw_status status = lw_control_path_make(port, chosen, err);
        if (status != LW_OK) return status;
        path = chosen;
    }
    if (strlen(path) >= LW_CONTROL_PATH_SIZE) /* libuv would cut it */
        return lw_status_fail(err, LW_UNAVAILABLE, "%.200s: the path is too long for a socket", path);
    if (is_left_over(path)) (void)unlink(path);
    int result = uv_pipe_bind(pipe, path);
    if (result == UV_EADDRINUSE)
        return lw_status_fail(err, LW_UNAVAILABLE, "%s is there already: another lightwelld?", path);
    if (result == 0 && chmod(path, 0600) < 0) result = uv_translate_sys_error(errno);
    if (result < 0) return lw_status_fail(err, LW_UNAVAILABLE, "%s: %s", path, uv_strerror(result));
    return LW_OK;
}

struct lw_session_peer lw_control_socket_peer(int descriptor) {
    struct lw_session_peer peer = {.at.is_loopback = true, .is_local = true, .address = "Unix socket"};
    struct ucred from = {0};
    socklen_t size = sizeof from;
    if (getsockopt(descriptor, SOL_SOCKET, SO_PEERCRED, &from, &size) != 0) return peer;
    peer.may_control = peer.is_operator = from.uid == geteuid() || from.uid == 0;
    snprintf(peer.address, sizeof peer.address, "Unix socket, user %u, process %d", (unsigned)from.uid,
             (int)from.pid);
    return peer;
}
