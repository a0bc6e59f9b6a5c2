/* direct_choice.h: the lights that may count within a screen tile.
 * Flow:    points of a tile, candidates -> [direct_choice] -> lists of lights, by their upper bounds
 * Threads: any worker. */
#ifndef LW_CLIENT_VIEW_LIGHTS_DIRECT_CHOICE_H
#define LW_CLIENT_VIEW_LIGHTS_DIRECT_CHOICE_H

#include "client/view/lights/direct_private.h"

struct lw_direct_region {
    struct lw_vec3 low, high, middle;
    float radius_m;
};

/** The box of a tile's active points. Returns whether there are any. */
bool lw_direct_choice_region(const struct lw_direct_tile *tile, struct lw_direct_region *out);

/* The lights that may count, by falling bounds. Lights beyond LW_DIRECT_TILE_LIGHTS_MAX share a ray. */
struct lw_direct_choice {
    uint32_t kept, count; /* lengths in work->order; lights from `kept` on share a ray */
    float rest;           /* sum of their bounds */
};

/** Fills work->bound and work->order. Without memory it chooses no light. */
struct lw_direct_choice lw_direct_choice_make(const struct lw_direct_pixels *direct,
                                              struct lw_direct_work *work,
                                              const struct lw_direct_region *region);

/** Whether a light has a size, so that it casts penumbras. */
bool lw_direct_choice_has_extent(const struct lw_direct_pixels *direct, uint32_t candidate);

/** Whether all of a region sees a light from much the same direction. */
bool lw_direct_choice_is_far(const struct lw_direct_candidates *candidates, uint32_t candidate,
                             const struct lw_direct_region *region);

#endif
