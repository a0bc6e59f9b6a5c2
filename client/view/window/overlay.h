/* overlay.h: text of the window: progress of its picture, and its keys.
 * Flow:    client and composer's report -> [overlay] -> lines of text for the window
 * Threads: pure functions, [any]. */
#ifndef LW_CLIENT_VIEW_WINDOW_OVERLAY_H
#define LW_CLIENT_VIEW_WINDOW_OVERLAY_H

#include "client/view/compose/compose.h"
#include "common/base/waiting.h"

#define LW_OVERLAY_LINE_SIZE 64

/** The keys of the window, a line each. */
#define LW_OVERLAY_KEYS 16
extern const char *const lw_overlay_keys[LW_OVERLAY_KEYS];

struct lw_overlay_state {
    bool lost;                       /* the server is gone, */
    bool receiving;                  /* and back, with a scene that is on its way */
    bool lit;                        /* the first light is there; */
    struct lw_waiting_state waiting; /* until then: what the server does for it */
    struct lw_compose_report report;
};

/** Progress of the picture, in one line. While it sharpens: the share of the samples that a good picture
 * takes, once that says something: the estimate from the first few samples of any tile is an error near 100
 * %. */
void lw_overlay_state(const struct lw_overlay_state *state, char out[LW_OVERLAY_LINE_SIZE]);

#endif
