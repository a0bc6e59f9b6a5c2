#include "client/view/overlay.h"

#include <stdio.h>

#define ERROR_TOLD 0.5f /* the largest that is */

const char *const lw_overlay_keys[LW_OVERLAY_KEYS] = {
    "click       look around with the mouse",
    "W A S D     fly; E, Q: up and down",
    "Shift       fast; wheel: speed",
    "C           next camera of the scene",
    "1 to 9      that camera",
    "0           back to the first view",
    "F1          figures on and off",
    "H           these keys on and off",
    "Esc         free the mouse; again: quit",
};

void lw_overlay_state(const struct lw_overlay_state *state, char out[LW_OVERLAY_LINE_SIZE]) {
    const struct lw_compose_report *r = &state->report;
    const size_t size = LW_OVERLAY_LINE_SIZE;
    if (state->lost)
        snprintf(out, size, state->receiving ? "server is back: receiving" : "server gone: looking for it");
    else if (!state->lit)
        snprintf(out, size, "waiting for the first light");
    else if (!r->complete)
        snprintf(out, size, "%u of %u tiles to come", r->tiles_missing + r->tiles_unfinished,
                 r->tiles_needed);
    else if (r->converged)
        snprintf(out, size, "converged");
    else if (r->shown_error <= ERROR_TOLD)
        snprintf(out, size, "%s, error %.1f %%", r->good ? "good" : "sharpening",
                 (double)r->shown_error * 100.0);
    else
        snprintf(out, size, "sharpening");
}
