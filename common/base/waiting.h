/* waiting.h: why clients have no light yet: what a server does before its first light, and how much of it is
 * done.
 * Flow:    solver's progress -> [waiting] -> server -> WAITING -> client
 * Threads: a struct lw_waiting may be raised and read by [any]. */
#ifndef LW_COMMON_BASE_WAITING_H
#define LW_COMMON_BASE_WAITING_H

#include <stdatomic.h>
#include <stdint.h>

/* number, name, words for people, as the server's log has them. Numbers are forever: WAITING carries them. */
#define LW_WAITING_MAP(X)                                                                                    \
    X(0, UNKNOWN, "waiting for the first light")                                                             \
    X(1, PLACING_TEXELS, "placing texels")                                                                   \
    X(2, LOOKING_INSIDE, "looking inside objects")                                                           \
    X(3, FIRST_LIGHT, "first light")                                                                         \
    X(4, READY, "ready")

enum lw_waiting_stage {
#define X(number, name, text) LW_WAITING_##name = number,
    LW_WAITING_MAP(X)
#undef X
};
#define LW_WAITING_STAGE_COUNT 5u

/** Text of a stage. A stage of a newer server has the text of LW_WAITING_UNKNOWN. */
const char *lw_waiting_text(uint32_t stage);

/** The words and the share: "looking inside objects, 42 %". */
#define LW_WAITING_LINE_SIZE 40u
void lw_waiting_line(uint32_t stage, float share, char out[LW_WAITING_LINE_SIZE]);

struct lw_waiting_state {
    enum lw_waiting_stage stage;
    float share; /* the stage's, 0 to 1, in whole hundredths: 1 when all of it is done */
};

/** The progress so far. It only grows: a later stage follows an earlier one, a larger share a smaller one.
 * Zeroed to begin with. */
struct lw_waiting {
    _Atomic uint32_t word;
    uint32_t part, parts; /* lw_waiting_set_part() */
};

/** Sets the progress of a stage to `done` of `total` steps; total 0: the number of steps is not known. Less
 * progress than before changes nothing. waiting may be NULL. [any] */
void lw_waiting_raise(struct lw_waiting *waiting, enum lw_waiting_stage stage, uint64_t done, uint64_t total);

/** Shares of LW_WAITING_FIRST_LIGHT are those of part `part` of `parts` from now on. No thread may raise it
 * meanwhile. waiting may be NULL. */
void lw_waiting_set_part(struct lw_waiting *waiting, uint32_t part, uint32_t parts);

/** The progress so far. [any] */
struct lw_waiting_state lw_waiting_read(const struct lw_waiting *waiting);

#endif
