/* draws.h: whose direct light the client draws: the WELCOME's bits, as indices of the scene once that is
 * there.
 * Flow:    WELCOME -> [draws] -> renderer
 * Threads: one thread at a time. */
#ifndef LIGHTWELL_DRAWS_H
#define LIGHTWELL_DRAWS_H

#include "client/lib/client.h"
#include "proto/message.h"

struct lw_draws {
    bool taken_up;                      /* the server took the feature up: tiles lack that light */
    bool has_scene;                     /* `of` holds */
    uint8_t *bits;                      /* the lights', then the materials', as in the WELCOME */
    size_t lights_size, materials_size; /* bytes */
    uint8_t *flags;                     /* what `of` points to */
    struct lw_client_draws of;
};

/** Begins a session; what the one before said is over. offered: the HELLO offered LW_FEATURE_DRAWS.
 * Errors: LW_PROTOCOL if the server takes up a feature that was not offered; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_draws_begin(struct lw_draws *draws, const struct lw_message_welcome *welcome,
                                            bool offered, struct lw_error *err);
/** The scene is there. Errors: LW_PROTOCOL for a light or material that it does not have; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_draws_set_scene(struct lw_draws *draws, const struct lw_scene *scene,
                                                struct lw_error *err);
/** A zeroed one is fine. */
void lw_draws_finish(struct lw_draws *draws);

#endif
