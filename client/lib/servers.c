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
    free(s->told);
    *s = (struct lw_servers){0};
}

enum lw_status lw_servers_found(struct lw_servers *s, const char *told) {
    s->tries = 0;
    free(s->told);
    s->told = NULL;
    if (!set(&s->last_host, &s->last_port, s->host, s->port)) return LW_NO_MEMORY;
    if (told && *told && !(s->told = strdup(told))) return LW_NO_MEMORY;
    return LW_OK;
}

/* The announced address of this number; false: it is none. */
static bool read_told(const struct lw_servers *s, uint32_t number, char host[HOST_SIZE], uint16_t *out_port) {
    char text[HOST_SIZE + 8];
    const char *at = s->told;
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

static uint32_t count_told(const struct lw_servers *s) {
    uint32_t count = s->told != NULL;
    for (const char *at = s->told; at && (at = strchr(at, ',')); at++) count++;
    return count;
}

/* 0: its last server; 1 to count_told(): the announced ones, then the given one. */
static uint32_t turn_of(const struct lw_servers *s, uint32_t tries) { return tries % (count_told(s) + 2); }

enum lw_status lw_servers_next(struct lw_servers *s) {
    const uint32_t told = count_told(s);
    char host[HOST_SIZE];
    uint16_t port;
    while (turn_of(s, s->tries) && turn_of(s, s->tries) <= told &&
           !read_told(s, turn_of(s, s->tries) - 1, host, &port))
        s->tries++;
    const uint32_t turn = turn_of(s, s->tries++);
    LW_INVARIANT(turn <= told + 1);
    const bool done = !turn          ? set(&s->host, &s->port, s->last_host, s->last_port)
                      : turn <= told ? set(&s->host, &s->port, host, port)
                                     : set(&s->host, &s->port, s->first_host, s->first_port);
    return done ? LW_OK : LW_NO_MEMORY;
}

bool lw_servers_is_told(const struct lw_servers *s) {
    if (!s->tries) return false;
    const uint32_t turn = turn_of(s, s->tries - 1);
    return turn && turn <= count_told(s);
}
