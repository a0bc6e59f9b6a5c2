/* virtual_paths.h: paths of virtual point lights: lost paths, and the order in which paths are traced again.
 * Flow:    what moved, whose turn -> [virtual_paths: asks its owner for rays] -> states of lights
 * Threads: one thread.
 * After:   Tonna 2019 (validity by occlusion from the parent, a bounded number shot again each frame, sets in
 *          turn).
 *
 * A path has one light a bounce; light b of path p is number p x bounces + b. When something has moved, its
 * owner says for each light whether its parent, a lamp or the light before, still sees it. A lost light takes
 * its children with it, and is shot again, a bounded number a frame. Lights that are not lost take turns. */
#ifndef LW_COMMON_VIRTUAL_PATHS_H
#define LW_COMMON_VIRTUAL_PATHS_H

#include "common/base/status.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum lw_virtual_light_state {
    LW_VIRTUAL_LIGHT_LOST,  /* it waits to be shot */
    LW_VIRTUAL_LIGHT_ENDED, /* no light gets there: the ray met nothing that reflects */
    LW_VIRTUAL_LIGHT_LIT
};

struct lw_virtual_paths {
    uint32_t paths, bounces, sets; /* paths: a multiple of sets, set by set */
    uint8_t *state;                /* paths x bounces; enum lw_virtual_light_state */
    struct {
        uint32_t next, shot; /* path whose turn it is; whether all have been shot */
    } turn;
};

/** About `lights` of them, none shot yet: as many paths in each set, one at least. Without bounces there is
 * none. Errors: LW_NO_MEMORY; then there is nothing to finish. */
LW_MUST_CHECK enum lw_status lw_virtual_paths_init(struct lw_virtual_paths *paths, uint32_t lights,
                                                   uint32_t bounces, uint32_t sets);
/** Zeroed ones are fine. */
void lw_virtual_paths_finish(struct lw_virtual_paths *paths);

static inline uint32_t lw_virtual_paths_light(const struct lw_virtual_paths *paths, uint32_t path,
                                              uint32_t bounce) {
    return path * paths->bounces + bounce;
}

/** A path's number, whatever the sets: each set has every sets-th. */
static inline uint32_t lw_virtual_paths_number(const struct lw_virtual_paths *paths, uint32_t path) {
    const uint32_t per_set = paths->paths / paths->sets;
    return path / per_set + paths->sets * (path % per_set);
}

/** Lights of a set. */
static inline uint32_t lw_virtual_paths_set_count(const struct lw_virtual_paths *paths) {
    return paths->paths / paths->sets * paths->bounces;
}

static inline bool lw_virtual_paths_is_lit(const struct lw_virtual_paths *paths, uint32_t light) {
    return paths->state[light] == LW_VIRTUAL_LIGHT_LIT;
}

/** d0 by itself, m: nearer than that a light is not brighter. area_m2: of all surfaces. */
float lw_virtual_paths_near_m(const struct lw_virtual_paths *paths, double area_m2);

/** Loses a light and its descendants. */
void lw_virtual_paths_lose(struct lw_virtual_paths *paths, uint32_t path, uint32_t bounce);

/** Rays that the owner of the lights traces. */
struct lw_virtual_paths_rays {
    void *context;
    /** Whether its parent sees a light that is lit. */
    bool (*holds)(void *context, uint32_t path, uint32_t bounce);
    /** Shoots a light, from a lamp or from the one before, which is lit; whether it is lit. */
    bool (*shoot)(void *context, uint32_t path, uint32_t bounce);
};

/** Asks of each light whether it holds, and loses those that do not. */
void lw_virtual_paths_check(struct lw_virtual_paths *paths, const struct lw_virtual_paths_rays *rays);

/** Whether whole paths are lost. */
bool lw_virtual_paths_lack(const struct lw_virtual_paths *paths);

/** Shoots all lights the first time. Then it shoots the lost ones and, if it rotates, the lights whose turn
 * it is: at most `most` in all. */
void lw_virtual_paths_shoot(struct lw_virtual_paths *paths, const struct lw_virtual_paths_rays *rays,
                            bool rotates, uint32_t most);

#endif
