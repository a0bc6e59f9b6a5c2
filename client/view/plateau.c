#include "client/view/plateau.h"

bool lw_plateau_note(struct lw_plateau *s, float error, double renewed, uint64_t now_ns) {
    if (!s->started) *s = (struct lw_plateau){error, renewed, now_ns, now_ns, true};
    if (error < LW_PLATEAU_FALL * s->least) {
        s->least = error;
        s->least_renewed = renewed;
        s->least_ns = now_ns;
    }
    const uint64_t waited_ns = now_ns - s->least_ns;
    return waited_ns >= LW_PLATEAU_MIN_NS && waited_ns >= s->least_ns - s->began_ns &&
           (renewed - s->least_renewed >= LW_PLATEAU_RENEWALS || waited_ns >= LW_PLATEAU_MAX_NS);
}
