#include "client/view/window/overlay.h"

#include <math.h>
#include <stdio.h>

_Static_assert(LW_WAITING_LINE_SIZE <= LW_OVERLAY_LINE_SIZE, "what is waited for fits into a line");

#define ERROR_TOLD 0.26f /* the largest that is shown: 1 % */

const char *const lw_overlay_keys[LW_OVERLAY_KEYS] = {
    "click       look around with the mouse",
    "W A S D     move; E, Q: up and down",
    "Shift       fast; wheel: speed",
    "M           fly, walk, orbit",
    "C           next camera of the scene",
    "1 to 9      that camera",
    "0           back to the first view",
    "T           a path tracer: beside, difference",
    "V           charts and parts of the light",
    "K           copy the camera as a command",
    "P           save the picture: PNG and EXR",
    "+ -         exposure; X: by the picture",
    "F1          figures on and off",
    "F11         full screen",
    "H           these keys on and off",
    "Esc         free the mouse; again: quit",
};

/* Never 100 before it is over. */
static unsigned percent(double share) { return (unsigned)fmin(fmax(100 * share, 0), 99); }

static unsigned percent_there(const struct lw_compose_report *r) {
    const unsigned lacking = r->tiles_missing + r->tiles_unfinished;
    return percent(lacking < r->tiles_needed ? 1 - (double)lacking / (double)r->tiles_needed : 0);
}

/* The share of a good picture's samples: the error of a mean falls by the root of their number. */
static unsigned percent_good(const struct lw_compose_report *r) {
    const double share = (double)LW_COMPOSE_GOOD_ERROR / (double)r->shown_error;
    return percent(share * share);
}

void lw_overlay_state(const struct lw_overlay_state *state, char out[LW_OVERLAY_LINE_SIZE]) {
    const struct lw_compose_report *r = &state->report;
    const size_t size = LW_OVERLAY_LINE_SIZE;
    if (state->lost)
        snprintf(out, size, state->receiving ? "server is back: receiving" : "server gone: looking for it");
    else if (!state->lit && state->waiting.stage == LW_WAITING_READY)
        snprintf(out, size, "light is arriving");
    else if (!state->lit)
        lw_waiting_line(state->waiting.stage, state->waiting.share, out);
    else if (!r->complete)
        snprintf(out, size, "light is arriving, %u %%", percent_there(r));
    else if (r->converged)
        snprintf(out, size, "finished");
    else if (r->good)
        snprintf(out, size, "good, the last noise is fading");
    else if (r->shown_error <= ERROR_TOLD)
        snprintf(out, size, "sharpening, %u %%", percent_good(r));
    else
        snprintf(out, size, "sharpening");
}
