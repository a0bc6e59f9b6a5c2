/* servers.h: where a client finds its light: at its last server, at the servers that this one announced,
 * and at the one that it was given.
 * Flow:    WELCOME -> [servers] -> the address of the next attempt
 * Threads: one thread at a time. */
#ifndef LIGHTWELL_SERVERS_H
#define LIGHTWELL_SERVERS_H

#include "common/base/status.h"

#include <stdint.h>

struct lw_servers {
    char *host; /* the next attempt's, or the session's */
    uint16_t port;
    char *first_host, *last_host; /* given; that it was with */
    uint16_t first_port, last_port;
    char *announced; /* addresses, apart by commas, as the last WELCOME has them; NULL: none */
    uint32_t tries;  /* since it was last with a server */
};

/** Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_servers_init(struct lw_servers *servers, const char *host, uint16_t port);
void lw_servers_finish(struct lw_servers *servers);

/** A server has welcomed us, and announces others, or none: NULL. Errors: LW_NO_MEMORY; then it is as if it
 * announced none. */
LW_MUST_CHECK enum lw_status lw_servers_found(struct lw_servers *servers, const char *announced);

/** Sets the address of the next attempt: its last server, then the announced ones, then the given one, and
 * again. Bad addresses are left out, and so are announced Unix sockets.
 * Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_servers_next(struct lw_servers *servers);

/** Whether the address is one that a server announced: if another scene is lit there, it is none of ours. */
bool lw_servers_is_announced(const struct lw_servers *servers);

#endif
