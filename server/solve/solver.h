/* solver.h: the interface that every solver implements. A solver turns a scene and a
 * pose into irradiance per texel.
 * Flow:    scene, pose -> [solver: direct, (probes, cells) x bounces, accumulate] -> tiles of E -> publish
 * Threads: one thread calls; the solver runs its own workers inside a call. */
#ifndef LW_SOLVE_SOLVER_H
#define LW_SOLVE_SOLVER_H

#include "common/scene/pose.h"
#include "common/tile/atlas.h"
#include "common/tile/tile_channels.h"
#include "server/solve/light_groups.h"
#include "server/solve/state/solver_terms.h"

#include <stdatomic.h>

#define LW_SOLVER_BOUNCES_MAX 16u

struct lw_client_lights;
struct lw_ranks;
struct lw_saved_texels;
struct lw_waiting;

/** Zero means default, where zero makes no sense as a value. */
struct lw_solver_desc {
    const struct lw_scene *scene;         /* outlives the solver */
    const struct lw_atlas_map *atlas_map; /* outlives the solver */
    uint32_t bounces;                     /* indirect; 0 is direct light only */
    float tracing_range_m;                /* > 0; INFINITY: no probes */
    float cell_size_m;                    /* 0: a quarter of the scene's longest side */
    float probe_spacing_m;                /* 0: some 1,000 probes over the scene's box */
    enum lw_probe_form_kind probe_form;
    enum lw_probe_projection probe_projection;
    struct lw_radiosity_terms radiosity; /* of the solver of that name; others refuse what is not zero */
    struct lw_vpl_terms vpl;             /* likewise */
    uint32_t direct_samples;             /* per texel and frame, on area lights and sky */
    uint32_t indirect_samples;           /* per texel, bounce and frame */
    /* relative standard error at which a tile converges; < 0: at none. */
    float target_error;
    /* frames after which a tile counts as converged in any case; 0: no limit. */
    uint32_t frames_max;
    unsigned threads; /* 0: all */
    uint32_t seed;
    /* Whose direct light can be left out of what is shown (client_lights.h); outlives
     * the solver. NULL: nobody's. */
    const struct lw_client_lights *client_lights;
    /* Groups of lights whose light is kept in layers, so that another intensity takes no ray
     * (light_groups.h); copied. NULL: one layer of all light as it is. */
    const struct lw_light_groups *light_groups;
    /* Filters what is shown, in every frame (denoise.h); direct and indirect stay as they are. */
    bool denoise;
    /* What a frame solves, about: wall time; or work, in texels solved (adapt/budget.h), which gives the same
     * bytes every time. Both 0: all that there is. At most one is set. */
    double frame_budget_s, frame_budget_units;
    /* Those that light the scene together (adapt/ranks.h); it outlives the solver. NULL: this one alone. Of
     * the cell solver, without probes, layers and budgets of wall time. */
    const struct lw_ranks *ranks;
    /* Of the cell solver: writes its plans there (adapt/plan_log.h), those of the second layer to path.1 and
     * so on. NULL: nowhere. */
    const char *plan_log;
    /* Where an earlier start has saved which texels light reaches, and where this one does (geometry.h); for
     * creation alone. NULL: nowhere. */
    const struct lw_saved_texels *saved_texels;
    /* Unless that is known, the cell solver looks inside objects in frames after the first ones, so that
     * first light is sooner; what changes so counts as a change of the scene. */
    bool looks_later;
    /* May be NULL; once true, a frame under way ends within a tile, creation within a mesh: LW_CLOSED */
    const _Atomic bool *cancel;
    const _Atomic bool *finishing; /* may be NULL; once true, frames say how far they are */
    /* May be NULL; while true, changes wait for the end of the frame under way, which
     * shows nothing that may wait. */
    const _Atomic bool *awaited;
    /* May be NULL; hears how far creation and the first frame are, up to LW_WAITING_FIRST_LIGHT (waiting.h).
     * It outlives the solver. */
    struct lw_waiting *waiting;
};

/** Whether frames end before all is done that there is. */
static inline bool lw_solver_desc_is_limited(const struct lw_solver_desc *desc) {
    return desc->frame_budget_s > 0 || desc->frame_budget_units > 0;
}
/** Whether the budget is one of units. */
static inline bool lw_solver_desc_counts(const struct lw_solver_desc *desc) {
    return desc->frame_budget_units > 0;
}
/** Wall time in s, or units; 0: no limit. */
static inline double lw_solver_desc_budget(const struct lw_solver_desc *desc) {
    return desc->frame_budget_units > 0 ? desc->frame_budget_units : desc->frame_budget_s;
}

/** What one frame cost. Times are wall time of the calling thread. */
struct lw_solver_stats {
    uint64_t rays_shadow, rays_bounce, rays_probe; /* of this frame */
    uint64_t pose_ns, direct_ns, probe_ns, scatter_ns, denoise_ns, weld_ns;
    /* verification. */
    uint64_t change_ns;
    uint64_t texels_solved;
    /* Texels times frames until all have converged, if errors fall as they should. */
    double texels_left;
    /* level-0 tiles: of this frame; converged; in all. */
    uint32_t tiles_solved, tiles_converged, tiles;
    uint32_t tiles_interest,
        /* those with surface: of interest; solved for the light that they give. */
        tiles_contributing;
    uint32_t tiles_shown; /* whose light to be seen has changed */
    bool moved;           /* the pose is another than in the frame before */
};

/** One level-0 tile as the solver holds it: planar, tile-contiguous. Valid until
 * the next call on the solver. */
struct lw_solver_tile {
    const float *direct[3];   /* E of bounce 0, W/m^2 per channel; width*height each */
    const float *indirect[3]; /* sum over bounces 1..N */
    /* What is shown, by channel (tile_channels.h) and plane: of irradiance direct + indirect, filtered and
     * welded as the desc says. NULL: not shown (show()). */
    const float *shown[LW_TILE_CHANNELS_MAX][LW_TILE_CHANNEL_PLANES_MAX];
    const float *albedo[3]; /* mean over each texel */
    const uint8_t *covered; /* 1: a texel with surface; others hold 0 */
    const uint8_t *filled;  /* 1: a gutter, with the light and albedo of its chart; NULL: there are none */
    uint32_t width, height;
    uint32_t bounces;      /* indirect bounces that it holds */
    uint32_t sample_count; /* frames whose samples it holds */
    float error; /* relative standard error, estimated; of SPLIT alone (show()) against all light too */
    uint64_t solved_frame; /* last frame that changed what is shown of it; 0: never */
};

struct lw_solver {
    const struct lw_solver_ops *ops;
};

struct lw_solver_ops {
    const char *name;
    /** Solves one frame at a pose. Converged tiles cost nothing unless the pose changed. Same desc,
     * sequence of poses and of interest: same bytes, at any thread count. Errors: LW_CLOSED if
     * cancelled; LW_NO_MEMORY, LW_INTERNAL. */
    enum lw_status (*frame)(struct lw_solver *solver, const struct lw_pose *pose, uint64_t frame,
                            struct lw_solver_stats *out_stats, struct lw_error *err);
    /** Sets the interest set; from the next frame on it alone is solved, with its contributors (plan.h).
     * interest: per lw_tile_id, 0 or 1 + the finest level of interest; entries of level 0 are read, before it
     * returns; NULL: everything, as in a new solver. Tiles of no interest keep their sums. When they are of
     * interest again these count as far as they are right: in full if nothing has moved since. Errors:
     * LW_NO_MEMORY; nothing is changed then. */
    enum lw_status (*set_interest)(struct lw_solver *solver, const uint8_t *interest, struct lw_error *err);
    /** Says which channels are shown (tile_channels.h), from the next frame on: a set of bits, not empty;
     * of those that a solver does not have nothing is. A form of light that was not shown before is made of
     * everything in that frame, whether it solves anything or not; one that no longer is stays as it was.
     * FULL alone, to begin with; without client lights nothing else is ever shown. While SPLIT is shown
     * alone errors are those of its noise, against all light. Converged tiles for which that makes a
     * difference go on when FULL is shown again. */
    void (*show)(struct lw_solver *solver, uint32_t channels);
    /** Filters the noise out of every tile's light, between two frames and whatever the desc says of it: for
     * those who read once, at the end. The next frame begins from the sums as ever. Errors: LW_NO_MEMORY. */
    enum lw_status (*filter)(struct lw_solver *solver, struct lw_error *err);
    /** Reads a level-0 tile. */
    void (*read_tile)(const struct lw_solver *solver, lw_tile_id tile, struct lw_solver_tile *out_tile);
    /** Saves, between two frames, what the next one depends on. key: 16 bytes that name the
     * scene, the pose and what of the desc decides a sample; target_error, frames_max and threads
     * may be others when it is read.
     * Errors: as lw_checkpoint_save(). */
    enum lw_status (*save)(const struct lw_solver *solver, const char *path, const uint8_t key[16],
                           struct lw_error *err);
    /** Takes that into a new solver: frames then go on as if it had solved those before, bit for bit.
     * *out_frames: how many those were. Errors: as lw_checkpoint_load(). */
    enum lw_status (*load)(struct lw_solver *solver, const char *path, const uint8_t key[16],
                           uint64_t *out_frames, struct lw_error *err);
    /** Bytes held, rays' structure included. */
    size_t (*memory_bytes)(const struct lw_solver *solver);
    void (*destroy)(struct lw_solver *solver);
};

#endif
