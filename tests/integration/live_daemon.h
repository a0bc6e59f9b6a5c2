/* live_daemon.h: daemons that tests of lightwell.h look at. */
#ifndef LW_TESTS_LIVE_DAEMON_H
#define LW_TESTS_LIVE_DAEMON_H

#include "tests/integration/live_case.h"

#include <stdio.h>

/* Some fifty tiles of a room where a box and a lamp move; they never converge, so that every frame brings
 * light. Behind the file's name. */
#define NEVER_RESTS                                                                                          \
    "--texels-per-metre 40 --bounces 0 --denoise off --error 1e-6 --light seen --frame-rate 100 "            \
    "--return-after 0.01 "
#define RESTS "builtin:cornell --texels-per-metre 20 --clock step --error 0.5 --light whole "

/* Ends the session; what the daemon does goes on. */
static inline int end_session(void **state) {
    (void)state;
    lw_live_close(live);
    live = NULL;
    return 0;
}

/* One daemon for the tests that only look at a scene that holds still. */
static inline const struct lw_process *still_daemon(void) {
    static struct lw_process daemon;
    if (!daemon.pid)
        lw_process_serve(&daemon, "builtin:atrium-matt --texels-per-metre 2 --bounces 0 --denoise off "
                                  "--freeze 1 --error 0.5 --light seen");
    return &daemon;
}

static inline void serve_never_resting(struct lw_process *daemon, const char *more) {
    char arguments[512];
    snprintf(arguments, sizeof arguments, "%s " NEVER_RESTS "%s",
             lw_support_source("tests/support/moving.gltf"), more);
    lw_process_serve(daemon, arguments);
}

static inline void open_live(uint16_t port, uint32_t flags) {
    open_with(&(struct lw_live_desc){
        .struct_size = sizeof(struct lw_live_desc), .port = port, .flags = flags, .name = "test_live"});
}

#endif
