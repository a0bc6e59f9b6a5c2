/* stage.h: the state of a viewer with one client: the pose that it received, rays, a composer.
 * Flow:    client -> [stage] -> headless and window; interest set -> [stage] -> client
 * Threads: one thread at a time. */
#ifndef LW_CLIENT_VIEW_COMPOSE_STAGE_H
#define LW_CLIENT_VIEW_COMPOSE_STAGE_H

#include "client/lib/client.h"
#include "client/view/compose/attention.h"
#include "client/view/compose/compose.h"
#include "client/view/lights/drawn_lights.h"

struct lw_stage {
    struct lw_client *client; /* not owned */
    const struct lw_scene *scene;
    struct lw_pose pose;
    struct lw_trace *trace;
    struct lw_compose *compose;
    struct lw_client_lights drawn; /* the composer draws their direct light, if the client asked for that */
    uint64_t changed_frame;        /* lw_client_stats.changed_frame as of the last picture */
    struct lw_attention attention;
    uint64_t looked_ns;          /* when the interest set was last listed */
    struct lw_vec3 *tile_colour; /* the shown chart's; NULL: there was none */
    bool mirrors;                /* views have mirrors (compose.h): the caller chooses */
};

/** Builds a stage for a client whose scene is there. The client must outlive it. Zeroed on failure.
 * Errors: LW_NO_MEMORY; LW_INTERNAL. */
LW_MUST_CHECK enum lw_status lw_stage_init(struct lw_stage *stage, struct lw_client *client, unsigned threads,
                                           struct lw_error *err);
/** A zeroed stage is fine. */
void lw_stage_finish(struct lw_stage *stage);

/** Moves objects and cameras to where the client has them now, hides and shows.
 * out_moved   whether an object went anywhere, or materials or lights changed
 * Errors: LW_NO_MEMORY; LW_INTERNAL. */
LW_MUST_CHECK enum lw_status lw_stage_follow(struct lw_stage *stage, bool *out_moved, struct lw_error *err);

/** Sets the client's interest set: the tiles of the last picture, and those around it. Call it for every
 * picture: most calls do nothing. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_stage_look(struct lw_stage *stage, const struct lw_camera_view *camera,
                                           uint32_t width, uint32_t height, struct lw_error *err);

/** Sets the part of light, or the chart, that a view shows. A chart of tiles has their current colours, valid
 * until the next call. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_stage_show(struct lw_stage *stage, enum lw_show show,
                                           struct lw_compose_view *view, struct lw_error *err);

#endif
