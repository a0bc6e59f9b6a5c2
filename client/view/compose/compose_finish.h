/* compose_finish.h: the lanes of a packet that meet surfaces with a finish, shaded together.
 * Flow:    hits (take) -> [compose_finish: gloss_maps, gloss, mirror] (shade) -> radiance, mirrored rays
 * Threads: any rendering thread. */
#ifndef LW_CLIENT_VIEW_COMPOSE_COMPOSE_FINISH_H
#define LW_CLIENT_VIEW_COMPOSE_COMPOSE_FINISH_H

#include "client/view/compose/compose_look.h"

/* The lanes of a packet that have met surfaces with a finish. */
struct lw_compose_finished {
    struct lw_gloss16 gloss;
    struct lw_gloss_uv16 uv;
    float side[LW_TRACE_WIDTH];
    float e[3][LW_TRACE_WIDTH], direction[3][LW_TRACE_WIDTH];
    struct lw_gloss_corner mean[LW_TRACE_WIDTH];
    uint16_t lanes;
    uint16_t exact;                              /* lanes whose normals differ from the mean's */
    struct lw_place_point point[LW_TRACE_WIDTH]; /* from here on of those lanes alone */
    struct lw_vec3 base[LW_TRACE_WIDTH];         /* where the patch is not simple */
    struct lw_gloss_seen16 seen;
    struct lw_vec3 factor[LW_TRACE_WIDTH]; /* how much of the leaving light the eye sees */
    float weight[LW_TRACE_WIDTH];          /* the same without colour */
    struct lw_vec3 emission[LW_TRACE_WIDTH];
    int level[LW_TRACE_WIDTH];     /* e is read at it */
    float width_m[LW_TRACE_WIDTH]; /* what the ray stands for there */
};

/** Notes a hit for lw_compose_finish_shade(). f->lanes is 0 before a packet's first.
 * surface  its alpha and emission; its base where the patch is not simple */
void lw_compose_finish_take(struct lw_compose *compose, const struct lw_compose_packet *p,
                            const struct lw_compose_look *look, const struct lw_hit16 *hits, unsigned i,
                            const struct lw_surface *surface, float weight, struct lw_compose_finished *f);

/** Shades the lanes that were noted. */
void lw_compose_finish_shade(const struct lw_compose *compose, struct lw_compose_packet *p,
                             const struct lw_compose_look look[LW_TRACE_WIDTH],
                             struct lw_compose_finished *f);

#endif
