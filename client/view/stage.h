/* stage.h: what a viewer needs around one client: the pose of what it received, the rays and the composer for it.
 * Flow:    client -> [stage] -> headless and window
 * Threads: one thread at a time. */
#ifndef LW_CLIENT_VIEW_STAGE_H
#define LW_CLIENT_VIEW_STAGE_H

#include "client/view/compose.h"
#include "lightwell/client.h"

struct lw_stage {
    struct lw_client *client; /* not owned */
    const struct lw_scene *scene;
    struct lw_pose pose;
    struct lw_trace *trace;
    struct lw_compose *compose;
    bool moves; /* some object can */
};

/** Builds a stage for a client whose scene is there. The client must outlive it. Zeroed on failure.
 * Errors: LW_NO_MEMORY; LW_INTERNAL. */
LW_MUST_CHECK enum lw_status lw_stage_init(struct lw_stage *stage, struct lw_client *client, unsigned threads,
                                           struct lw_error *err);
/** A zeroed stage is fine. */
void lw_stage_finish(struct lw_stage *stage);

/** Moves objects and cameras to where the client has them now.
 * out_moved   whether an object went anywhere
 * Errors: LW_NO_MEMORY; LW_INTERNAL. */
LW_MUST_CHECK enum lw_status lw_stage_follow(struct lw_stage *stage, bool *out_moved, struct lw_error *err);

/** The light that the client has received so far; good until its next poll. */
struct lw_compose_source lw_stage_source(const struct lw_stage *stage);

#endif
