/* drawn_lights.h: the lights whose direct light a client draws, as a composer takes them.
 * Flow:    client -> [drawn_lights] -> stage, viewers -> compose
 * Threads: those of the client. */
#ifndef LW_CLIENT_VIEW_LIGHTS_DRAWN_LIGHTS_H
#define LW_CLIENT_VIEW_LIGHTS_DRAWN_LIGHTS_H

#include "client/lib/client.h"
#include "common/light/client_lights.h"

/** Copies lw_client_draws() of a client that has its scene. Nothing to draw: a zeroed one. Errors:
 * LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_drawn_lights_init(struct lw_client_lights *drawn,
                                                  const struct lw_client *client);

/** Moves the client-drawn lights of a pose to where the newest frame has them. Returns whether
 * any changes. */
bool lw_drawn_lights_follow(const struct lw_client_lights *drawn, const struct lw_client *client,
                            struct lw_pose *pose);

#endif
