/* plateau.h: finds when an error falls no more.
 * Threads: one thread at a time. */
#ifndef LW_CLIENT_VIEW_PLATEAU_H
#define LW_CLIENT_VIEW_PLATEAU_H

#include <stdbool.h>
#include <stdint.h>

#define LW_PLATEAU_FALL   0.9f /* an error has fallen if it is under this share of the least so far */
#define LW_PLATEAU_MIN_NS 5000000000ull /* for at least so long it must not have fallen */

/* The picture's tiles must be renewed this often meanwhile, since a server may be busy elsewhere; after
 * LW_PLATEAU_MAX_NS that no longer counts. */
#define LW_PLATEAU_RENEWALS 16.0
#define LW_PLATEAU_MAX_NS   30000000000u

/** A zeroed one has heard nothing. */
struct lw_plateau {
    float least;
    double least_renewed;
    uint64_t began_ns, least_ns; /* times of the first error and of the least one */
    bool started;
};

/** Takes in an error, and how often its tiles were renewed so far. Returns whether the error has come to
 * rest: it has not fallen for LW_PLATEAU_MIN_NS, nor for LW_PLATEAU_RENEWALS (or LW_PLATEAU_MAX_NS), nor
 * for as long as it took to fall to here. In the last half of the time the error of a mean falls to 0.71. An
 * error that has not fallen to 0.9 is kept up by movement. */
bool lw_plateau_note(struct lw_plateau *plateau, float error, double renewed, uint64_t now_ns);

#endif
