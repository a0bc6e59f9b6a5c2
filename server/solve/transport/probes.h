/* probes.h: radiance that arrives at points in mid-air, for bounce rays that reach the tracing range.
 * Flow:    pose -> [place: out of geometry, what each probe sees]
 *          rays -> [gather]
 *          radiance (bounce k-1) -> [project] -> [radiance] for bounce k
 *          in between: end of a ray -> [choose] -> which probe, in which direction
 * Threads: init, place, gather and project [solver], parallel inside; choose and radiance [any] in between.
 * After:   Vandersanden 2023, 3.4 and 3.6 (probes, distant-point projection); Majercik et al. 2019 (depth
 *          moments, blending by visibility); Majercik et al. 2021 (relocation, dead probes).
 *
 * A regular grid of its own, one probe near the middle of each box. A look-up picks one of the eight probes
 * around the ray's end, with the probability of its trilinear weight. It takes that probe with the
 * probability that it sees the end. In the mean this is the blend by visibility, for the price of one probe,
 * and a ray hit stays one word. Where no probe that was tried sees the end, the ray goes on in the scene. */
#ifndef LW_TRANSPORT_PROBES_H
#define LW_TRANSPORT_PROBES_H

#include "common/trace/trace.h"
#include "server/solve/state/cells.h"
#include "server/solve/state/checkpoint.h"
#include "server/solve/state/packed_light.h"
#include "server/solve/surface/wall_sides.h"
#include "server/solve/transport/probe_form.h"

#define LW_PROBES_RAYS    128u /* per probe and frame, a multiple of 16 */
#define LW_PROBES_DEFAULT 1000u
/* A smaller spacing than this allows is enlarged; fits LW_RAY_HIT_PROBE's 15 bits. */
#define LW_PROBES_MAX    (1u << 13)
#define LW_PROBES_PARTS  4u
#define LW_PROBES_UNSEEN UINT32_MAX /* what ask() says when no probe tried sees the point */

struct lw_probe {
    struct lw_vec3 position_ws;
    uint32_t age; /* times it has gathered since it was placed here: where its random numbers go on */
    /* Inside geometry with nowhere to go: never read, shoots no rays. */
    bool dead;
    bool gathered; /* has rays of this frame */
};

struct lw_probe_ray {
    struct lw_vec3 direction;
    uint32_t hit; /* the texel that it hit, or LW_RAY_HIT_NOTHING */
};

struct lw_probes_desc {
    const struct lw_scene *scene; /* outlives the probes */
    struct lw_vec3 minimum_ws, maximum_ws;
    float spacing_m; /* 0: so that there are some LW_PROBES_DEFAULT */
    uint32_t bounces, seed;
    enum lw_probe_form_kind form;
    enum lw_probe_projection projection;
};

struct lw_probes {
    struct lw_probes_desc desc;
    struct lw_cells grid;
    const struct lw_probe_form_ops *form;
    uint32_t count, alive;
    struct lw_probe *probe;
    struct lw_vec3 (*box_os)[2];  /* per mesh: bounds */
    struct lw_affine *placed_for; /* per object: where it was when the probes were placed */
    bool *hidden_for;             /* per object: whether it was hidden then */
    /* [probe][octahedral cell][5]: mean of distance and of its square, both cut off at depth_max_m.
     * Then the mean distance to seen surfaces, or to the scene's box. Then reciprocals of the least and of
     * the greatest distance, 0 for the sky. */
    float *depth;
    float depth_max_m;
    struct lw_probe_ray *ray; /* [probe][LW_PROBES_RAYS] */
    float *sum;               /* [bounce][probe][sum_floats]: running means */
    float *map; /* [bounce][probe][map_floats]: what bounce order `bounce` looks like from the probe */
};

/** Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_probes_init(struct lw_probes *probes, const struct lw_probes_desc *desc);
void lw_probes_finish(struct lw_probes *probes);

/** Places probes and looks around from each: all of them at first, later those that something that moved has
 * come near to or left. Returns rays traced. */
uint64_t lw_probes_place(struct lw_probes *probes, const struct lw_pose *pose, const struct lw_trace *trace,
                         int threads);

/** Traces this frame's rays: of every probe if `eager`, because light may change; else of those that are new
 * and of one in four of the others. frame: any count of frames. Returns rays traced. */
uint64_t lw_probes_gather(struct lw_probes *probes, const struct lw_wall_sides *sides, uint32_t frame,
                          bool eager, int threads);

/** Turns the radiance of bounce order `bounce` at the rays' ends into what probes see, blended
 * into a history of at most `history_max` + 1 gatherings. radiance: per texel of the global
 * numbering, W/(m^2 sr). */
void lw_probes_project(struct lw_probes *probes, uint32_t bounce, const uint64_t *radiance,
                       uint32_t history_max, int threads);

/** Chooses who knows what arrives at a point from a direction.
 *
 * random  a word of its own per ray
 * Returns the word of transport.h for a probe and a direction, or LW_PROBES_UNSEEN. */
uint32_t lw_probes_ask(const struct lw_probes *probes, struct lw_vec3 point_ws, struct lw_vec3 direction,
                       uint32_t random);

/** How far a probe sees a point, in [0, 1]: Chebyshev's bound on the part of its surroundings in that
 * direction that lies behind the point, sharpened; 0 for a dead probe. */
float lw_probes_visibility(const struct lw_probes *probes, uint32_t probe, struct lw_vec3 point_ws);

/** Radiance of bounce order `bounce` that reaches a probe from a direction; never negative. W/(m^2 sr) */
static inline struct lw_vec3 lw_probes_radiance(const struct lw_probes *probes, uint32_t bounce,
                                                uint32_t probe, struct lw_vec3 direction) {
    const struct lw_probe_form_ops *form = probes->form;
    return form->read(probes->map + ((size_t)bounce * probes->count + probe) * form->map_floats, direction);
}

/** What a frame reads of those before it. Returns LW_PROBES_PARTS. */
uint32_t lw_probes_list_parts(const struct lw_probes *probes,
                              struct lw_checkpoint_part out_part[LW_PROBES_PARTS]);

size_t lw_probes_memory_bytes(const struct lw_probes *probes);

#endif
