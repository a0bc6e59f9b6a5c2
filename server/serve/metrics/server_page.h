/* server_page.h: a page of the monitoring port: daemon_metrics -> server -> web_server. */
#ifndef LW_SERVE_METRICS_SERVER_PAGE_H
#define LW_SERVE_METRICS_SERVER_PAGE_H

#include <stddef.h>

/** A page of the monitoring port. */
struct lw_server_page {
    unsigned status;  /* HTTP status */
    const char *type; /* Content-Type; outlives the server */
    char *text;       /* the server free()s it */
    size_t size;      /* bytes */
};

#endif
