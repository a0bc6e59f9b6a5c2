/* settling.h: tells when an error falls no more.
 * Threads: one thread at a time. */
#ifndef LW_CLIENT_VIEW_SETTLING_H
#define LW_CLIENT_VIEW_SETTLING_H

#include <stdbool.h>
#include <stdint.h>

#define LW_SETTLING_FALL   0.9f /* an error is less where it is under this share of the least so far */
#define LW_SETTLING_MIN_NS 5000000000ull /* how long it must not have been */

/* How often what is shown must have been renewed meanwhile: a server that is busy elsewhere is waited for, */
#define LW_SETTLING_RENEWALS 16.0
/* but no longer than this. */
#define LW_SETTLING_MAX_NS 30000000000u

/** A zeroed one has heard nothing. */
struct lw_settling {
    float least;
    double least_renewed;
    uint64_t began_ns, least_ns; /* of the first error, and of the least one */
    bool started;
};

/** Takes in an error, and how often what has it was renewed so far. Returns whether the error has not
 * fallen for LW_SETTLING_MIN_NS, for LW_SETTLING_RENEWALS (or LW_SETTLING_MAX_NS), and for as long again as
 * it has taken to fall there: the error of a mean falls to 0.71 in that time, so what has not fallen to 0.9
 * is held up by what moves. */
bool lw_settling_note(struct lw_settling *settling, float error, double renewed, uint64_t now_ns);

#endif
