#include "server/serve/service_notify.h"

#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

/* false: there is none, or no address that fits. A leading @ stands for the abstract namespace. */
static bool find_socket(struct sockaddr_un *out_address, socklen_t *out_size) {
    const char *path = getenv("NOTIFY_SOCKET");
    if (!path || (*path != '/' && *path != '@')) return false;
    const size_t length = strlen(path);
    if (length >= sizeof out_address->sun_path) return false;
    *out_address = (struct sockaddr_un){.sun_family = AF_UNIX};
    memcpy(out_address->sun_path, path, length);
    if (*path == '@') out_address->sun_path[0] = '\0';
    *out_size = (socklen_t)(offsetof(struct sockaddr_un, sun_path) + length);
    return true;
}

bool lw_service_notify_wanted(void) {
    struct sockaddr_un address;
    socklen_t size;
    return find_socket(&address, &size);
}

bool lw_service_notify(const char *format, ...) {
    struct sockaddr_un address;
    socklen_t size;
    char text[512];
    if (!find_socket(&address, &size)) return false;
    va_list args;
    va_start(args, format);
    const int length = vsnprintf(text, sizeof text, format, args);
    va_end(args);
    if (length < 0) return false;
    const size_t bytes = (size_t)length < sizeof text ? (size_t)length : sizeof text - 1;
    const int s = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    if (s < 0) return false;
    const bool sent = sendto(s, text, bytes, MSG_DONTWAIT | MSG_NOSIGNAL, (const struct sockaddr *)&address,
                             size) == (ssize_t)bytes;
    close(s);
    return sent;
}

unsigned lw_service_notify_watchdog_ms(void) {
    const char *usec = getenv("WATCHDOG_USEC"), *pid = getenv("WATCHDOG_PID");
    if (!usec || (pid && strtoll(pid, NULL, 10) != (long long)getpid())) return 0;
    const unsigned long long ms = strtoull(usec, NULL, 10) / 3000;
    return ms > 86400000 ? 86400000 : (unsigned)ms;
}
