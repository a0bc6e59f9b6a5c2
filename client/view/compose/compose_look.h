/* compose_look.h: one hit: its light, its point and normal, the radiance that leaves it towards the eye.
 * Flow:    hit, patch -> [compose_look] -> light of tiles, point, normal, radiance
 * Threads: any rendering thread. */
#ifndef LW_CLIENT_VIEW_COMPOSE_COMPOSE_LOOK_H
#define LW_CLIENT_VIEW_COMPOSE_COMPOSE_LOOK_H

#include "client/view/compose/compose_patch.h"

/* A hit, with all that is read of it on the way into the cache. */
struct lw_compose_look {
    const struct lw_compose_patch *patch; /* NULL: the ray met nothing */
    const struct lw_compose_object *object;
    float weight[3];
    struct lw_texture_quad texels;
    struct lw_vec2 uv;                     /* lightmap's */
    int finest;                            /* level that serves */
    int level;                             /* asked for */
    struct lw_compose_footprint footprint; /* in the level asked for */
};

/** Finds out what a hit is to be shaded from, and starts to fetch it. */
void lw_compose_look_at(const struct lw_compose *compose, struct lw_compose_patches *patches,
                        const struct lw_compose_packet *p, const struct lw_hit16 *hits, unsigned i,
                        struct lw_compose_look *out);

/** The tiles' light at a hit, whose tiles are marked as needed.
 * out_level  that it is read at; LW_ATLAS_LEVELS_MAX: none */
struct lw_compose_light lw_compose_look_light(struct lw_compose *compose, const struct lw_compose_look *look,
                                              int *out_level);

/** Radiance from a hit to the eye, of the parts of light that the view shows.
 * level      that e is read at
 * reflects   the albedo; set to the share of client-drawn light that it shows */
struct lw_vec3 lw_compose_look_leaving(const struct lw_compose *compose, const struct lw_compose_look *look,
                                       struct lw_vec3 emission, struct lw_vec3 reflected, struct lw_vec3 e,
                                       int level, struct lw_vec3 *reflects);

/** The point of a surface that a pixel shows, as rays of light start there. */
struct lw_place_point lw_compose_look_point(const struct lw_compose *compose,
                                            const struct lw_compose_look *look, const struct lw_hit16 *hits,
                                            unsigned i);

/** The normal of a surface's point, on the side that was met. */
struct lw_vec3 lw_compose_look_normal(const struct lw_compose *compose, const struct lw_compose_look *look,
                                      const struct lw_hit16 *hits, unsigned i);

#endif
