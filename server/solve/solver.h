/* solver.h: the interface of every solver. A solver turns a scene and a pose into irradiance per texel.
 * Flow:    scene, pose -> [solver: direct, (probes, cells) x bounces, accumulate] -> tiles of E -> publish
 * Threads: one thread calls; the solver runs its own workers inside a call. */
#ifndef LW_SOLVE_SOLVER_H
#define LW_SOLVE_SOLVER_H

#include "common/scene/pose.h"
#include "common/tile/atlas.h"
#include "common/tile/tile_channels.h"
#include "server/solve/light_groups.h"
#include "server/solve/state/solver_terms.h"
#include "server/solve/surface/packed_albedo.h"

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
    struct lw_radiosity_terms radiosity; /* for the solver "radiosity"; others refuse non-zero values */
    struct lw_vpl_terms vpl;             /* for the solver "vpl"; others refuse non-zero values */
    uint32_t direct_samples;             /* per texel and frame, on area lights and sky */
    uint32_t indirect_samples;           /* per texel, bounce and frame */
    /* Relative standard error at which a tile converges; < 0: never. */
    float target_error;
    /* Number of frames after which a tile counts as converged; 0: no limit. */
    uint32_t frames_max;
    unsigned threads; /* 0: all */
    uint32_t seed;
    /* Lights and materials whose direct light SPLIT leaves out (client_lights.h); outlives the solver. NULL:
     * none. */
    const struct lw_client_lights *client_lights;
    /* Groups of lights with a layer each, so that another intensity costs no ray (light_groups.h); copied.
     * NULL: one layer. */
    const struct lw_light_groups *light_groups;
    /* Keeps where light comes from: the channels with `moment` (tile_channels.h). For the cell solver. */
    bool directions;
    /* Per object: clients get where its light comes from; outlives the solver. NULL: all. Others keep it
     * where they have a finish, for bounces. */
    const bool *directional;
    /* Every frame filters the shown planes (denoise.h). The sums stay unfiltered. */
    bool denoise;
    /* Budget of a frame: wall time; or work units, about the texels solved (adapt/budget.h), which give the
     * same bytes every time. At most one is set. Both 0: no limit. */
    double frame_budget_s, frame_budget_units;
    /* The ranks that light the scene together (adapt/ranks.h); outlives the solver. For the cell solver
     * without probes, layers and budgets of wall time. NULL: one rank. */
    const struct lw_ranks *ranks;
    /* Path of the plan log of the cell solver (adapt/plan_log.h). Layer k > 0 writes to path.k. NULL: none.
     * */
    const char *plan_log;
    /* Where an earlier start has saved which texels light reaches, and where this one does (geometry.h); for
     * creation alone. NULL: nowhere. */
    const struct lw_saved_texels *saved_texels;
    /* Tiles of finer levels (atlas.h) that the cell solver may hold at once; each takes some 1 MB. 0: it
     * solves level 0 alone, as other solvers and ranks do. */
    uint32_t fine_tiles;
    enum lw_fine_when fine_when;
    /* May be NULL. Once true, frame() returns LW_CLOSED within a tile, creation within a mesh. */
    const _Atomic bool *cancel;
    const _Atomic bool *finishing; /* may be NULL; once true, frames log their progress */
    /* May be NULL. While true, changes wait for the end of the frame: the frame defers light that may wait.
     * */
    const _Atomic bool *awaited;
    /* May be NULL. Gets the progress of creation and of the first frame (waiting.h); outlives the solver. */
    struct lw_waiting *waiting;
};

/** Whether frames have a budget. */
static inline bool lw_solver_desc_is_limited(const struct lw_solver_desc *desc) {
    return desc->frame_budget_s > 0 || desc->frame_budget_units > 0;
}
/** Whether the budget is one of units. */
static inline bool lw_solver_desc_counts(const struct lw_solver_desc *desc) {
    return desc->frame_budget_units > 0;
}
/** The budget: wall time in s, or units; 0: no limit. */
static inline double lw_solver_desc_budget(const struct lw_solver_desc *desc) {
    return desc->frame_budget_units > 0 ? desc->frame_budget_units : desc->frame_budget_s;
}

/** Work and cost of one frame. Times are wall time of the calling thread. */
struct lw_solver_stats {
    uint64_t rays_shadow, rays_bounce, rays_probe; /* in this frame */
    uint64_t pose_ns, direct_ns, probe_ns, scatter_ns, denoise_ns, weld_ns;
    uint64_t change_ns; /* verification */
    uint64_t texels_solved;
    double texels_left; /* estimate: texels times frames until all have converged */
    /* Level-0 tiles: */
    uint32_t tiles_solved, tiles_converged, tiles; /* in this frame, so far, in all */
    uint32_t tiles_interest;                       /* tiles of interest, with surface */
    uint32_t tiles_contributing; /* contributors, with surface: solved for the light that they send */
    uint32_t tiles_shown;        /* tiles with changed shown planes */
    uint32_t tiles_fine;         /* existing tiles of finer levels */
    uint32_t tiles_fine_wanted;  /* tiles of interest of finer levels */
    bool moved;                  /* the pose differs from that of the frame before */
    bool coarse;                 /* tiles are of a coarse scene (coarse_first.h) */
};

/** A tile of level 0 or finer, planar and tile-contiguous. Valid until the next call on the solver. */
struct lw_solver_tile {
    const float *direct[3];   /* E of bounce 0, W/m^2 per channel; width*height each */
    const float *indirect[3]; /* sum over bounces 1..N */
    /* Shown planes by channel (tile_channels.h): the sums, filtered and welded as the desc says. NULL: the
     * channel is not shown (choose_channels()). */
    const float *shown[LW_TILE_CHANNELS_MAX][LW_TILE_CHANNEL_PLANES_MAX];
    const struct lw_packed_albedo *albedo; /* mean over each texel; NULL: of a finer level, unless for maps */
    const uint8_t *covered; /* 1: the texel has surface. NULL where `direct` is: the planes are not held */
    const uint8_t *filled;  /* 1: gutter with light and albedo of its chart; NULL: there is none */
    /* The chart that covers a texel, or reads it in bilinear look-ups (surface/texels.h); NULL: not known. */
    const uint32_t *chart;
    uint32_t width, height;
    uint32_t bounces;      /* number of indirect bounces in its light */
    uint32_t sample_count; /* number of frames in its means */
    float error;           /* estimated relative standard error, always relative to all light */
    uint64_t solved_frame; /* last frame that changed its shown planes; 0: none */
    bool converged;        /* it needs no frame until its light changes */
    bool has_surface;      /* a texel of it is covered */
};

/** Room for planes of one tile that its solver does not hold. */
#define LW_SOLVER_PLANES_MAX (3 + LW_TILE_CHANNELS_MAX * LW_TILE_CHANNEL_PLANES_MAX)
struct lw_solver_room {
    float plane[LW_SOLVER_PLANES_MAX][LW_TILE_TEXELS_MAX];
    uint8_t covered[LW_TILE_TEXELS_MAX], filled[LW_TILE_TEXELS_MAX];
};

struct lw_solver {
    const struct lw_solver_ops *ops;
};

struct lw_solver_ops {
    const char *name;
    /** Solves one frame at a pose. Converged tiles cost nothing unless the pose changed. The same desc, poses
     * and interest give the same bytes, at any thread count. Errors: LW_CLOSED if cancelled; LW_NO_MEMORY,
     * LW_INTERNAL. */
    enum lw_status (*frame)(struct lw_solver *solver, const struct lw_pose *pose, uint64_t frame,
                            struct lw_solver_stats *out_stats, struct lw_error *err);
    /** Sets the interest set. From the next frame on the solver solves it and its contributors (plan.h).
     * interest: per lw_tile_id, 0 or 1 + the finest level of interest; the call reads the entries of level 0,
     * and those of finer levels. Such tiles are made, as far as there is room: those with the lowest entry
     * above 0 first, among equal ones those of coarser levels.
     * NULL: everything, as in a new solver. Other tiles keep their sums: back in the interest set they go on
     * from them, cut to their staleness if something has moved. Errors: LW_NO_MEMORY; nothing changes
     * then. */
    enum lw_status (*set_interest)(struct lw_solver *solver, const uint8_t *interest, struct lw_error *err);
    /** Chooses the shown channels from the next frame on (tile_channels.h): a set of bits, not empty.
     * Channels that the solver does not hold are ignored; a new solver shows FULL, and so does one that
     * holds none of the set. The next frame makes the planes of a new channel for all tiles. The planes of a
     * dropped channel stay as they were. While SPLIT is shown alone, errors count its noise only, relative
     * to all light: converged tiles may have to go on when FULL is shown again. */
    void (*choose_channels)(struct lw_solver *solver, uint32_t channels);
    /** Filters the shown planes of every tile, between two frames, even if desc.denoise is off: for bakes,
     * which read tiles once. The sums stay unfiltered. Errors: LW_NO_MEMORY. */
    enum lw_status (*filter)(struct lw_solver *solver, struct lw_error *err);
    /** Lists the tiles of finer levels that have light, by id; until the next call on the solver. NULL: it
     * has none. Returns how many. */
    uint32_t (*list_fine)(const struct lw_solver *solver, const lw_tile_id **out_tile);
    /** Whether it holds a tile of a finer level, lit or not. NULL: it holds none. */
    bool (*holds_fine)(const struct lw_solver *solver, lw_tile_id tile);
    /** Reads a tile of level 0, or one that list_fine() lists. Where the solver does not hold its planes,
     * `direct` and `covered` are NULL. [any] between two frames */
    void (*read_tile)(const struct lw_solver *solver, lw_tile_id tile, struct lw_solver_tile *out_tile);
    /** Works out the planes of a tile that read_tile() has read without them. They lie in `room`. NULL: the
     * solver holds the planes of all tiles. [any] between two frames */
    void (*read_planes)(const struct lw_solver *solver, lw_tile_id tile, struct lw_solver_room *room,
                        struct lw_solver_tile *read_tile);
    /** Saves the state between two frames. key: 16 bytes that identify the scene, the pose and those fields
     * of the desc that decide samples. target_error, frames_max and threads may differ at load(). Errors: as
     * lw_checkpoint_save(). */
    enum lw_status (*save)(const struct lw_solver *solver, const char *path, const uint8_t key[16],
                           struct lw_error *err);
    /** Loads a saved state into a new solver, which then goes on bit for bit as the saved one would have.
     * *out_frames: number of frames of the saved solve. Errors: as lw_checkpoint_load(). */
    enum lw_status (*load)(struct lw_solver *solver, const char *path, const uint8_t key[16],
                           uint64_t *out_frames, struct lw_error *err);
    /** Bytes held, with the ray tracing structure. */
    size_t (*memory_bytes)(const struct lw_solver *solver);
    void (*destroy)(struct lw_solver *solver);
};

/** Reads a tile with its planes, which hold until the next frame or the next use of `room`. */
static inline void lw_solver_read_light(const struct lw_solver *solver, lw_tile_id id,
                                        struct lw_solver_room *room, struct lw_solver_tile *out_tile) {
    solver->ops->read_tile(solver, id, out_tile);
    if (!out_tile->direct[0]) solver->ops->read_planes(solver, id, room, out_tile);
}

#endif
