/* settling.h: finds when an error falls no more.
 * Threads: one thread at a time. */
#ifndef LW_CLIENT_VIEW_SETTLING_H
#define LW_CLIENT_VIEW_SETTLING_H

#include <stdbool.h>
#include <stdint.h>

#define LW_SETTLING_FALL   0.9f /* an error has fallen if it is under this share of the least so far */
#define LW_SETTLING_MIN_NS 5000000000ull /* for at least so long it must not have fallen */

/* The picture's tiles must be renewed this often meanwhile, since a server may be busy elsewhere; after
 * LW_SETTLING_MAX_NS that no longer counts. */
#define LW_SETTLING_RENEWALS 16.0
#define LW_SETTLING_MAX_NS   30000000000u

/** A zeroed one has heard nothing. */
struct lw_settling {
    float least;
    double least_renewed;
    uint64_t began_ns, least_ns; /* times of the first error and of the least one */
    bool started;
};

/** Takes in an error, and how often its tiles were renewed so far. Returns whether the error has come to
 * rest: it has not fallen for LW_SETTLING_MIN_NS, nor for LW_SETTLING_RENEWALS (or LW_SETTLING_MAX_NS), nor
 * for as long as it took to fall to here. In that last time the error of a mean falls to 0.71; where it has
 * not even fallen to 0.9, movement keeps it up. */
bool lw_settling_note(struct lw_settling *settling, float error, double renewed, uint64_t now_ns);

#endif
