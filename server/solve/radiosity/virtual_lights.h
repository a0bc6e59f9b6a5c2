/* virtual_lights.h: points on surfaces that stand for the light which those reflect.
 * Flow:    direct light of patches, lamps, trace -> [virtual_lights] -> shooters of a radiosity pass
 * Threads: one thread.
 * After:   Keller 1997 (instant radiosity); Tonna 2019 (validity by occlusion from the parent, a bounded
 *          number shot again each frame, sets in turn).
 *
 * Lights come in paths of one light a bounce. The first of a path lies on a texel, chosen by the light that
 * it reflects: albedo x E x area, E being its direct light. Samples are stratified over all patches, as is
 * each set. Its parent is a lamp: the place on a lamp that a sample of all lamps finds from there. The next
 * lies where a cosine-weighted ray from its parent ends, and has the parent's flux times the albedo there.
 * When something has moved, a shadow ray to the parent decides whether a light stays. A lost light takes its
 * children with it, sends nothing, and is shot again, a bounded number a frame. A light that stays follows
 * its texel's light: flux = albedo x E x area / (P p), p as it was chosen. */
#ifndef LW_RADIOSITY_VIRTUAL_LIGHTS_H
#define LW_RADIOSITY_VIRTUAL_LIGHTS_H

#include "common/light/virtual_paths.h"
#include "server/solve/radiosity/shooters.h"

/** Beside its shooter. */
struct lw_virtual_light {
    uint32_t texel, object; /* texel: of the global numbering */
    uint32_t shots;         /* times that it was shot: where its random numbers go on */
    float e[3], scale;      /* first of a path: E of its texel, and flux over albedo x E */
    float sample[3];        /* first of a path: which place on which lamp; sample[0] < 0: none was found */
};

struct lw_virtual_lights {
    const struct lw_patches *patches;
    struct lw_virtual_paths paths;
    struct lw_shooter *shooter; /* per light; area 0 */
    struct lw_virtual_light *light;
    double *sum; /* per packet of patches and one more: light reflected by those before */
};

/** About `lights` of them, none shot yet. Errors: LW_NO_MEMORY; finish them then. */
LW_MUST_CHECK enum lw_status lw_virtual_lights_init(struct lw_virtual_lights *lights,
                                                    const struct lw_patches *patches, uint32_t count,
                                                    uint32_t bounces, uint32_t sets);
/** Zeroed ones are fine. */
void lw_virtual_lights_finish(struct lw_virtual_lights *lights);

/** Lights on objects that are elsewhere in another pose are lost. */
void lw_virtual_lights_leave(struct lw_virtual_lights *lights, const struct lw_pose *was,
                             const struct lw_pose *is);

/** What decides where lights are. */
struct lw_virtual_lights_shot {
    const struct lw_trace *trace;
    const struct lw_lights *lamps;
    float *const *direct; /* E per texel, W/m^2 */
    float largest_m;      /* largest coordinate of the scene */
    uint32_t seed, salt;
    bool checks;   /* something has moved: whose parent is hidden is lost */
    bool rotates;  /* lights that are not lost take turns, too */
    uint32_t most; /* shot at most, unless none has been yet */
};

/** Checks, shoots, and sets the flux of all. The patches are placed. Returns rays. */
uint64_t lw_virtual_lights_shoot(struct lw_virtual_lights *lights, const struct lw_virtual_lights_shot *shot);

/** The lights of a set, as shooters of a pass. */
static inline struct lw_shooters lw_virtual_lights_set(const struct lw_virtual_lights *lights, uint32_t set) {
    const uint32_t count = lw_virtual_paths_set_count(&lights->paths);
    return (struct lw_shooters){
        .patches = lights->patches, .shooter = lights->shooter + (size_t)set * count, .count = count};
}

size_t lw_virtual_lights_memory_bytes(const struct lw_virtual_lights *lights);

#endif
