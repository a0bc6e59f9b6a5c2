/* tiles.h: what the solver keeps per level-0 tile and per texel: sums of light, their history, their noise.
 * Flow:    passes -> [tiles] -> publish
 * Threads: a tile is written by the one worker that solves it; radiance is read by all after the barrier. */
#ifndef LW_SOLVE_TILES_H
#define LW_SOLVE_TILES_H

#include "server/solve/cells.h"
#include "server/solve/packets.h"
#include "server/solve/solver.h"
#include "server/solve/texels.h"

/* Blocks of a full tile's side. */
#define LW_TILE_BLOCKS (LW_TILE_SIDE / LW_TILE_BLOCK)

struct lw_solve_tile {
    lw_tile_id id;
    uint32_t object, x, y, width, height; /* place in the object's level 0; tile column and row; texels */
    const struct lw_mesh_texels *mesh;
    uint32_t local, first;    /* first texel within the mesh; within the global numbering */
    struct lw_packet *packet; /* of all its blocks, row by row */
    uint32_t block_count;
    uint16_t
        packet_of_block[LW_TILE_BLOCKS * LW_TILE_BLOCKS + 1]; /* the first of each block, and their number */
    uint32_t cell;
    struct lw_vec3 centre_ws; /* of the sphere that holds all its texels, as the pose has it */
    float radius_m;
    struct lw_vec3 centre_os; /* the same in object space */
    float radius_os;
    uint32_t covered_count;
    uint32_t frames;  /* solved since the sequence began: where the random numbers go on */
    uint32_t history; /* frames that the sums stand for, capped while things move */
    uint32_t
        remembered; /* of these, how many the last frame's memory held: what the variance is divided by */
    float error;    /* relative standard error of luminance */
    bool resting;
    bool due;              /* the frame under way solves it (schedule.h) */
    bool shows;            /* what was solved is to be seen in this frame, not merely read by other tiles */
    bool unseen;           /* it was solved since it last did */
    uint32_t solved_tick;  /* of the schedule, when it was last solved */
    uint32_t solved_moves; /* frames in which something had moved by then */
    uint32_t still;        /* frames since a movement, not counting those that it slept through */
    float weight_direct, weight_indirect; /* with which this frame's estimates enter the means */
    uint32_t
        history_max; /* frames that indirect light may remember in this frame; UINT32_MAX if nothing ever moved */
    uint64_t solved_frame;
};

struct lw_tiles {
    uint32_t count, bounces, texel_count;
    struct lw_packet *packet;   /* of all tiles */
    struct lw_solve_tile *tile; /* in the order in which they are solved: by cell */
    uint32_t *slot_of_id; /* lw_tile_id -> index into tile, or UINT32_MAX for ids that are not level 0 */
    float *direct[3];     /* E of bounce 0 per texel, W/m^2 */
    float *indirect[3];   /* sum over bounces 1..N */
    float *light[3];      /* what is shown: direct + indirect, after the frame's finish; W/m^2 */
    float *order[LW_SOLVER_BOUNCES_MAX][3]; /* E of each bounce order 1..N alone (index 0: order 1) */
    /* What each texel sends out of bounce order 0..N-1, for the next one: 4 floats each, W/(m^2 sr). One plane per order,
     * so that what a tile sends stays while it is not solved. */
    float *radiance[LW_SOLVER_BOUNCES_MAX];
    float *estimate;        /* luminance of this frame's own estimate of E */
    float *mean, *spread;   /* of those estimates: running mean, sum of squared deviations */
    const uint8_t *covered; /* the texels' own */
};

/** Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_tiles_init(struct lw_tiles *tiles, const struct lw_scene *scene,
                                           const struct lw_atlas_map *map, const struct lw_texels *texels,
                                           uint32_t bounces, int threads);
void lw_tiles_finish(struct lw_tiles *tiles);

/** Counts anew what the texels cover; a tile that covers more or less than before starts from the beginning. */
void lw_tiles_recount(struct lw_tiles *tiles, int threads);

/** Gives gutters the light of the texels that stand for them; but those of `welded` (seams.h), which have their own. */
void lw_tiles_fill_gutters(struct lw_tiles *tiles, const struct lw_texels *texels, const uint8_t *welded,
                           int threads);

/** Places every tile in the world and sorts them by cell. */
void lw_tiles_set_pose(struct lw_tiles *tiles, const struct lw_cells *cells, const struct lw_pose *pose);

#endif
