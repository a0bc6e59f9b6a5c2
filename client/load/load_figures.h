/* load_figures.h: counts and times of the sessions of a load test.
 * Flow:    sessions -> [load_figures] -> load_report
 * Threads: the loop's. */
#ifndef LW_CLIENT_LOAD_LOAD_FIGURES_H
#define LW_CLIENT_LOAD_LOAD_FIGURES_H

#include "common/base/histogram.h"

#include <stdbool.h>

/* Faults: name in JSON, text for people. */
#define LW_LOAD_FAULT_MAP(X)                                                                                 \
    X(CONNECT, "connect", "could not connect")                                                               \
    X(REFUSED, "refused", "were refused")                                                                    \
    X(LOST, "lost", "lost the connection")                                                                   \
    X(SILENCE, "silence", "heard nothing for 15 s")                                                          \
    X(MESSAGE, "message", "got a message that does not decode")                                              \
    X(ORDER, "order", "got a message out of order")                                                          \
    X(FRAME, "frame", "got a frame number that went back")                                                   \
    X(PACKAGE, "package", "got another scene package than the first user")                                   \
    X(PLACE, "place", "got a message about what the scene does not have")                                    \
    X(PAYLOAD, "payload", "got a tile that does not decode")                                                 \
    X(VERSION, "version", "got a tile that was not newer than what they had")                                \
    X(DIFFERENT, "different", "got other bytes than another user for the same version of a tile")            \
    X(SYSTEM, "system", "ran out of memory or descriptors on our side")

enum lw_load_fault {
#define X(name, key, text) LW_LOAD_FAULT_##name,
    LW_LOAD_FAULT_MAP(X)
#undef X
        LW_LOAD_FAULT_COUNT
};

/** Counts cover the whole run. Histograms marked `measured` have samples of the measured time alone
 * (`measuring`). Times are nanoseconds. */
struct lw_load_figures {
    bool measuring;
    uint64_t asked;         /* sessions that began to connect */
    uint64_t welcomed;      /* sessions that got a WELCOME */
    uint64_t refused, lost; /* sessions that ended before or after their WELCOME, not by our wish */
    uint64_t followed;      /* sessions that decoded and added up their light, deltas included */
    uint64_t left;          /* by churn */
    uint64_t broken;        /* sessions whose users reconnected, or tried to */
    uint64_t returned;      /* welcomed once more */
    uint64_t stopped;       /* never-readers that stopped reading */
    uint64_t dropped;       /* stopped sessions that the server closed */
    uint64_t fault[LW_LOAD_FAULT_COUNT];
    char first_fault[LW_LOAD_FAULT_COUNT][160]; /* the first of each kind, in detail; "" if there was none */

    uint64_t bytes, tiles, frames, settled; /* received */

    struct lw_histogram connect;    /* from connect to WELCOME */
    struct lw_histogram download;   /* from connect to the whole package, if every session downloads */
    struct lw_histogram first_view; /* from connect to every tile that was asked for */
    struct lw_histogram next_view;  /* from another INTEREST to the same */
    /* users that reconnected: every tile asked for, after the first WELCOME of this run of the server */
    struct lw_histogram served;
    struct lw_histogram drop; /* from the last read of a never-reader until it found itself dropped */
    /* measured: a tile's arrival after the first FRAME of its version to anyone */
    struct lw_histogram update;
    struct lw_histogram frame; /* measured: a FRAME's arrival, likewise */
    struct lw_histogram whole; /* measured: a SETTLED's arrival, likewise */
    struct lw_histogram age; /* measured: of a tile's light at arrival: its frame's solve_ns and the update */
    struct lw_histogram ping;         /* measured: PING to PONG */
    struct lw_histogram second_bytes; /* measured: received by a user in a second */
    struct lw_histogram rate_mhz;     /* measured: frames per 1000 s, one value a session */
};

#endif
