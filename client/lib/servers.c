#include "client/lib/servers.h"

#include "common/base/invariant.h"
#include "common/base/options.h"

#include <stdlib.h>
#include <string.h>

#define HOST_SIZE 256

static bool set(char **host, uint16_t *port, const char *new_host, uint16_t new_port) {
    char *copy = strdup(new_host);
    if (!copy) return false;
    free(*host);
    *host = copy;
    *port = new_port;
    return true;
}

enum lw_status lw_servers_init(struct lw_servers *s, const char *host, uint16_t port) {
    *s = (struct lw_servers){0};
    if (set(&s->host, &s->port, host, port) && set(&s->first_host, &s->first_port, host, port) &&
        set(&s->last_host, &s->last_port, host, port))
        return LW_OK;
    lw_servers_finish(s);
    return LW_NO_MEMORY;
}

void lw_servers_finish(struct lw_servers *s) {
    free(s->host);
    free(s->first_host);
    free(s->last_host);
    free(s->announced);
    *s = (struct lw_servers){0};
}

enum lw_status lw_servers_found(struct lw_servers *s, const char *announced) {
    s->tries = 0;
    free(s->announced);
    s->announced = NULL;
    if (!set(&s->last_host, &s->last_port, s->host, s->port)) return LW_NO_MEMORY;
    if (announced && *announced && !(s->announced = strdup(announced))) return LW_NO_MEMORY;
    return LW_OK;
}

/* The announced address of this number; false: it is none. */
static bool read_announced(const struct lw_servers *s, uint32_t number, char host[HOST_SIZE],
                           uint16_t *out_port) {
    char text[HOST_SIZE + 8];
    const char *at = s->announced;
    for (; number && at; number--) at = (at = strchr(at, ',')) ? at + 1 : NULL;
    if (!at) return false;
    const size_t length = strcspn(at, ",");
    if (!length || length >= sizeof text || !strncmp(at, "unix:", 5)) return false;
    memcpy(text, at, length);
    text[length] = '\0';
    const char *colon = strrchr(text, ':'), *bracket = strrchr(text, ']');
    if (!colon || colon == text || (bracket && bracket > colon)) return false; /* it has host and port */
    return lw_options_address(text, host, HOST_SIZE, out_port, NULL) == LW_OK && *out_port;
}

static uint32_t count_announced(const struct lw_servers *s) {
    uint32_t count = s->announced != NULL;
    for (const char *at = s->announced; at && (at = strchr(at, ',')); at++) count++;
    return count;
}

/* 0: its last server; 1 to count_announced(): the announced ones, then the given one. */
static uint32_t turn_of(const struct lw_servers *s, uint32_t tries) {
    return tries % (count_announced(s) + 2);
}

enum lw_status lw_servers_next(struct lw_servers *s) {
    const uint32_t announced = count_announced(s);
    char host[HOST_SIZE];
    uint16_t port;
    while (turn_of(s, s->tries) && turn_of(s, s->tries) <= announced &&
           !read_announced(s, turn_of(s, s->tries) - 1, host, &port))
        s->tries++;
    const uint32_t turn = turn_of(s, s->tries++);
    LW_INVARIANT(turn <= announced + 1);
    const bool done = !turn               ? set(&s->host, &s->port, s->last_host, s->last_port)
                      : turn <= announced ? set(&s->host, &s->port, host, port)
                                          : set(&s->host, &s->port, s->first_host, s->first_port);
    return done ? LW_OK : LW_NO_MEMORY;
}

bool lw_servers_is_announced(const struct lw_servers *s) {
    if (!s->tries) return false;
    const uint32_t turn = turn_of(s, s->tries - 1);
    return turn && turn <= count_announced(s);
}
