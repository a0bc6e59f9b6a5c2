/* local_server.h: a lightwelld that this program starts for itself, on a free port of 127.0.0.1.
 * Flow:    scene, options -> [local_server: lightwelld] -> port
 * Threads: one thread at a time. The server ends when the thread that has started it ends, in any way. Ctrl-C
 *          is for this program alone. */
#ifndef LW_CLIENT_VIEW_LOCAL_SERVER_H
#define LW_CLIENT_VIEW_LOCAL_SERVER_H

#include "common/base/status.h"

#include <limits.h>
#include <stdint.h>
#include <sys/types.h>

#define LW_LOCAL_SERVER_WORDS_MAX   48u
#define LW_LOCAL_SERVER_NUMBERS_MAX 8u

struct lw_local_server {
    pid_t pid; /* 0: it does not run */
    char program[PATH_MAX], port_file[PATH_MAX];
    const char *word[LW_LOCAL_SERVER_WORDS_MAX]; /* its command line's */
    char number[LW_LOCAL_SERVER_NUMBERS_MAX][64];
    unsigned words, numbers;
};

/** Begins its command line; it serves no page. The scene outlives the server. Finish it in any case.
 * Errors: LW_CANNOT_CREATE. */
LW_MUST_CHECK enum lw_status lw_local_server_init(struct lw_local_server *server, const char *scene,
                                                  struct lw_error *err);
/** Adds an option. value: NULL for a flag; outlives the server. */
void lw_local_server_option(struct lw_local_server *server, const char *option, const char *value);
void lw_local_server_number(struct lw_local_server *server, const char *option, double value);

/** Starts it.
 * in, out, log  file descriptors of its standard input, output and error; -1: those of this program
 * Errors        LW_OS if lightwelld, beside this program or in PATH, does not start */
LW_MUST_CHECK enum lw_status lw_local_server_start(struct lw_local_server *server, int in, int out, int log,
                                                   struct lw_error *err);

/** Its port; 0: it does not listen yet. */
uint16_t lw_local_server_port(const struct lw_local_server *server);
bool lw_local_server_has_ended(struct lw_local_server *server);

/** Ends it, by force after 5 s. A zeroed one is fine. */
void lw_local_server_finish(struct lw_local_server *server);

#endif
