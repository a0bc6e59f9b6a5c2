/* load_options.h: the command line of lightwell-load as a load generator.
 * Threads: main() only. */
#ifndef LW_CLIENT_LOAD_LOAD_OPTIONS_H
#define LW_CLIENT_LOAD_LOAD_OPTIONS_H

#include "client/lib/access.h"

#include <stdint.h>

#define LW_LOAD_USERS_MAX 20000u /* one address has some 28,000 ports to connect from */

enum lw_load_path {
    LW_LOAD_EVERYTHING, /* no INTEREST: every tile of the scene */
    LW_LOAD_WALK,       /* tiles in view from a path through the scene */
    LW_LOAD_STILL,      /* tiles in view from one place, a different one for each user */
    LW_LOAD_TELEPORT    /* tiles in view from a place that jumps now and then */
};

enum lw_load_reader {
    LW_LOAD_FAST, /* reads all that has arrived */
    LW_LOAD_SLOW, /* reads at a rate */
    LW_LOAD_NEVER /* stops reading when the first frame has come */
};

struct lw_load_options {
    char host[256];
    uint16_t port;
    struct lw_access access;
    uint32_t users;
    double seconds; /* measured, from the last user's connect on */
    double ramp_hz; /* users that connect per second */
    enum lw_load_path path;
    enum lw_load_reader reader;
    double slow_bytes_hz; /* LW_LOAD_SLOW's rate: bytes per second */
    uint32_t odd_readers; /* users with that reader; the others read fast */
    double churn_hz;      /* users that leave, and are replaced, per second */
    bool reconnect;       /* users reconnect when they lose the connection */
    bool download;        /* every session downloads the scene package */
    bool decode_all;      /* every session decodes every tile */
    bool json;
    const char *series; /* file for the time series; NULL: none */
    int64_t seed;
    /* Limits; infinite or 0 where the option is not given. */
    double latency_max_ms, first_view_max_ms, frames_min_hz;
    int64_t errors_max;
};

/** Reads the command line. --help and --version print and set *out_done.
 * Errors: LW_USAGE naming the option and what it accepts. */
LW_MUST_CHECK enum lw_status lw_load_options_parse(int argc, char **argv, struct lw_load_options *out_options,
                                                   bool *out_done, struct lw_error *err);

#endif
