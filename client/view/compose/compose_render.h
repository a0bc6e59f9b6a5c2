/* compose_render.h: the pixels of screen tiles and of lists: packets through all layers, with direct light
 * and what they mirror.
 * Flow:    camera -> rays -> [compose_render: hits, direct_tile] -> picture; what each tile shows of it
 * Threads: renders on compose->threads threads. */
#ifndef LW_CLIENT_VIEW_COMPOSE_COMPOSE_RENDER_H
#define LW_CLIENT_VIEW_COMPOSE_COMPOSE_RENDER_H

#include "client/view/compose/compose_private.h"

/** All pixels of a view.
 * direct  whether client-drawn lights are computed */
void lw_compose_render_tiles(struct lw_compose *compose, const struct lw_compose_view *view,
                             const struct lw_camera_plane *plane, bool direct, float *out_rgb);

/** The pixels of a list, as lw_compose_render_more() says. */
void lw_compose_render_list(struct lw_compose *compose, const struct lw_compose_view *view,
                            const struct lw_camera_plane *plane, const uint32_t *pixel, size_t pixel_count,
                            float *out_rgb);

#endif
