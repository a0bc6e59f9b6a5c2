/* tiles.h: what the solver keeps per level-0 tile and per texel: sums of light, their history, their noise.
 * Flow:    passes -> [tiles] -> publish
 * A tile is the unit of interest, of encoding and of sending. Its blocks of 16 x 16 texels are the units of
 * solving, of histories and of convergence.
 * Threads: a tile is written by the one worker that solves it; radiance is read by all after the barrier. */
#ifndef LW_STATE_TILES_H
#define LW_STATE_TILES_H

#include "common/tile/tile_channels.h"
#include "server/solve/state/cells.h"
#include "server/solve/state/change.h"
#include "server/solve/state/history.h"
#include "server/solve/surface/packets.h"
#include "server/solve/surface/texels.h"

/* Of estimates. */
enum { LW_TILES_DIRECT, LW_TILES_INDIRECT, LW_TILES_PARTS };
_Static_assert(LW_TILES_PARTS == LW_CHANGE_PARTS, "each has a memory");
enum {
    LW_TILES_ESTIMATE_DIRECT,
    LW_TILES_ESTIMATE_BOUNCES, /* and LW_CHANGE_* */
    LW_TILES_ESTIMATES = LW_TILES_ESTIMATE_BOUNCES + LW_CHANGE_ORDERS
};

/* Of bounce orders that tiles can hold. */
#define LW_TILES_BOUNCES_MAX 16u

/* Of a block; of a tile: that of its least settled block (docs/change.md has the diagram). */
enum lw_block_state {
    /* Its light has changed: it is solved, whatever its noise. */
    LW_BLOCK_STALE,
    /* It is solved until its noise is on target. */
    LW_BLOCK_SAMPLED,
    /* It needs no frame until its light changes: it is on target, hidden, or has no texels. */
    LW_BLOCK_CONVERGED
};

/* What a frame solves of a tile. */
enum lw_tile_work {
    LW_TILE_WORK_NONE,
    /* Invalidated blocks alone, which are shown at once. */
    LW_TILE_WORK_INVALIDATED,
    /* All blocks that have not converged. */
    LW_TILE_WORK_ALL
};

/* Sixteen by sixteen texels of a tile: the unit of solving, of histories and of convergence. */
struct lw_solve_block {
    uint32_t tile_id; /* lw_tile_id */
    /* texels; 0: nothing below means anything. */
    uint32_t covered_count;
    struct lw_packet *packet; /* of its covered texels */
    uint32_t packet_count;
    struct lw_region_parts parts; /* of its regions */
    uint32_t points_hash;         /* of which sample points its texels have */
    /* What a W/m^2 counts in each region, where light is compared with the block's: 1 in the part that has
     * least, and as much less elsewhere as there is more light. 1 throughout where there is one part. */
    float weight[LW_REGIONS];
    /* By parts, if there are several: luminance of E in the mean; what other layers add to it. */
    float part_luminance[LW_REGIONS], part_other[LW_REGIONS];
    enum lw_block_state state;
    bool due;             /* the frame under way solves it */
    bool unseen;          /* it was solved since it was last shown */
    uint64_t shown_frame; /* last frame that changed what is shown of it */
    /* Frames that solved it since the sequence began: where the random numbers go on. */
    uint32_t sample_count;
    struct lw_history direct, indirect;
    struct lw_change_block change;
    /* sum over its texels: of one frame's estimate, weighted luminance, about the running mean */
    double variance;
    double luminance; /* sum over its texels, of E */
    /* Luminance of E against which errors are measured: its own mean, or that of the room that it is in or of
     * the tile (regions.h), if that is more; and what other layers add to it (light_layers.h). Of several
     * parts that with the least. */
    float reference_luminance, other_luminance;
    /* reference_luminance when its bounce rays were last traced: what they hang on */
    float traced_luminance;
    float noise
        [LW_TILES_PARTS]; /* relative variances of one frame's estimates of a texel; < 0: not known yet */
    float error;          /* relative standard error of luminance */
};

/* A bit for each of a block's packets. */
static inline uint16_t lw_change_all_packets(const struct lw_solve_block *block) {
    return (uint16_t)((1u << block->packet_count) - 1);
}

/* Blocks of a full tile's side. */
#define LW_TILE_BLOCKS (LW_TILE_SIDE / LW_TILE_BLOCK)

/* What a tile's blocks say of its light together. */
struct lw_solve_light {
    uint32_t sample_count; /* the fewest of its blocks */
    float error;           /* relative standard error of luminance, over all its blocks */
    enum lw_block_state state;
    uint64_t solved_frame; /* last frame that showed one of its blocks */
    bool begins;           /* it is hidden no longer, and nothing of it has been shown since */
};

/* What verification has found of it that was not solved since: facts for the plan (adapt/plan.h). */
struct lw_solve_change {
    bool invalidated; /* the light of one of its blocks has changed */
    /* If so: mean square over those blocks of the share of light that has changed, at most 1. */
    float priority;
    uint32_t invalidated_count; /* texels of those blocks */
};

/* A tile: its place, which is of which texels, whose and where; its light; what the plan takes of it. */
struct lw_solve_tile {
    lw_tile_id id;
    uint32_t object, x, y, width, height; /* place in the object's level 0; tile column and row; texels */
    const struct lw_mesh_texels *mesh;
    uint32_t local, first;        /* first texel within the mesh; within the global numbering */
    struct lw_solve_block *block; /* row by row */
    uint32_t block_columns, block_rows;
    uint32_t covered_count;
    uint8_t wide_rooms;       /* (regions.h) */
    uint32_t changes;         /* of its object's texels, that its blocks know */
    uint32_t cell, owner;     /* where it stands; the rank that solves it, by the cell where it first stood */
    struct lw_vec3 centre_ws; /* of the sphere that holds all its texels, as the pose has it */
    float radius_m;
    struct lw_vec3 centre_os; /* the same in object space */
    float radius_os;
    /* as its object is: it counts as converged, and starts again when it is shown. */
    bool hidden;
    struct lw_solve_light light;
    struct lw_solve_change change;
};

struct lw_tiles {
    uint32_t count, id_count, bounces, texel_count; /* id_count: lw_tile_ids of the scene */
    struct lw_solve_tile *tile;                     /* in the order in which they are solved: by cell */
    uint32_t *slot_of_id; /* lw_tile_id -> index into tile, or UINT32_MAX for ids that are not level 0 */
    struct lw_solve_block *block; /* of all tiles, in the order of their ids */
    uint32_t block_count;
    struct lw_packet *packet; /* LW_PACKETS_MAX for each block */
    uint32_t *block_of_texel; /* index into block */
    uint8_t *region_of_texel; /* of its block (regions.h) */
    float *direct[3];         /* E of bounce 0 per texel, W/m^2 */
    float *indirect[3];       /* sum over bounces 1..N */
    /* Of direct, and of its last estimate, what client lights give. NULL: there are none. */
    float *drawn[3], *drawn_estimate[3];
    /* The means of channels that are no form of light: those have direct + indirect, SPLIT without what is
     * drawn. */
    float *sum[LW_TILE_CHANNELS_MAX][LW_TILE_CHANNEL_PLANES_MAX];
    /* What is shown, by channel: its sums as they were when it last was, filtered and welded. NULL: not one
     * of `channels`. */
    float *shown[LW_TILE_CHANNELS_MAX][LW_TILE_CHANNEL_PLANES_MAX];
    uint32_t channels;                     /* that there are (tile_channels.h) */
    float *order[LW_TILES_BOUNCES_MAX][3]; /* E of each bounce order 1..N alone (index 0: order 1) */
    /* What each texel sends out of bounce order 0..N-1, for the next one: 4 floats each, W/(m^2 sr). One
     * plane per order, so that what a tile sends stays while it is not solved. */
    float *radiance[LW_TILES_BOUNCES_MAX];
    /* Per region of each block, LW_REGIONS x block + region: by how much that differs, in the mean, from the
     * frame before. */
    struct lw_vec3 *radiance_change[LW_TILES_BOUNCES_MAX];
    float *estimate[LW_TILES_ESTIMATES]
                   [3];   /* E as the last frame in which a texel was solved had it by itself */
    float *mean, *spread; /* of the luminance of such estimates: running mean, sum of squared deviations */
    float *split_mean, *split_spread; /* the same without what is drawn; NULL as drawn is */
    /* That of the two by which errors are measured, always against all light: split_spread while no other
     * form is shown. What clients draw has no noise, and only enters bounces then. */
    const float *judged_spread;
    const uint8_t *covered;  /* the texels' own */
    const uint8_t *usable;   /* likewise */
    const uint32_t *side;    /* likewise */
    const uint32_t *changes; /* likewise, per object */
};

/** Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_tiles_init(struct lw_tiles *tiles, const struct lw_scene *scene,
                                           const struct lw_atlas_map *map, const struct lw_texels *texels,
                                           uint32_t bounces, int threads);
void lw_tiles_finish(struct lw_tiles *tiles);

/** Makes room for what client lights give, apart. Errors: LW_NO_MEMORY; finish the tiles then. */
LW_MUST_CHECK enum lw_status lw_tiles_part_drawn(struct lw_tiles *tiles);

/** The last frame that changed what is shown of any tile; 0: none has. */
uint64_t lw_tiles_last_solved(const struct lw_tiles *tiles);

/** Chooses judged_spread by the channels that are shown, and sums the variance of blocks again
 * if it is another. Returns whether it is; their errors are those of before until lw_estimates_judge(). */
bool lw_tiles_judge_channels(struct lw_tiles *tiles, uint32_t channels, int threads);

/** Sums the variance of all blocks again, from judged_spread. */
void lw_tiles_sum_variance(struct lw_tiles *tiles, int threads);

/** Bytes held. */
size_t lw_tiles_memory_bytes(const struct lw_tiles *tiles);

/** Direct light that the server keeps in both forms: without what is drawn. Never less than none, whatever
 * rounding says. */
static inline float lw_tiles_served(const struct lw_tiles *tiles, uint32_t c, uint32_t texel) {
    if (!tiles->drawn[c]) return tiles->direct[c][texel];
    const float served = tiles->direct[c][texel] - tiles->drawn[c][texel];
    return served > 0 ? served : 0;
}

/** What a plane of a channel holds, neither filtered nor welded. */
static inline float lw_tiles_sum(const struct lw_tiles *tiles, uint32_t channel, uint32_t plane,
                                 uint32_t texel) {
    if (channel >= LW_LIGHT_FORM_COUNT) return tiles->sum[channel][plane][texel];
    const float direct =
        channel == LW_LIGHT_FORM_SPLIT ? lw_tiles_served(tiles, plane, texel) : tiles->direct[plane][texel];
    return direct + tiles->indirect[plane][texel];
}

/** Blends an estimate into a mean. One beyond float's range would stay there for good, and is left out. */
static inline void lw_tiles_blend(float *const dst[3], uint32_t texel, struct lw_vec3 value, float weight) {
    if (!lw_vec3_is_finite(value)) return;
    dst[0][texel] += (value.x - dst[0][texel]) * weight;
    dst[1][texel] += (value.y - dst[1][texel]) * weight;
    dst[2][texel] += (value.z - dst[2][texel]) * weight;
}

static inline void lw_tiles_store(float *const dst[3], uint32_t texel, struct lw_vec3 value) {
    dst[0][texel] = value.x;
    dst[1][texel] = value.y;
    dst[2][texel] = value.z;
}

/** Takes over texels->changes. A block of which other texels are covered, or other points of them usable, or
 * whose regions are others, starts from the beginning. */
void lw_tiles_recount(struct lw_tiles *tiles, int threads);

/** Shows the sums of the blocks of frame `frame` (shown_frame) as they are, in the given channels. */
void lw_tiles_show(struct lw_tiles *tiles, uint64_t frame, uint32_t channels, int threads);

#define LW_TILES_EACH_BLOCK(tile, block)                                                                     \
    for (struct lw_solve_block *block = (tile)->block, *const end_ = block + (tile)->block_columns *         \
                                                                                 (tile)->block_rows;         \
         block < end_; block++)

/* The texels of a tile's block at a column and row of its blocks; x, y: in the tile. */
#define LW_TILES_EACH_TEXEL(tile, column, row, x, y)                                                         \
    for (uint32_t y = (row)*LW_TILE_BLOCK; y < (tile)->height && y < ((row) + 1) * LW_TILE_BLOCK; y++)       \
        for (uint32_t x = (column)*LW_TILE_BLOCK; x < (tile)->width && x < ((column) + 1) * LW_TILE_BLOCK;   \
             x++)

/** The tile of an id of level 0. */
static inline struct lw_solve_tile *lw_tiles_at(const struct lw_tiles *tiles, lw_tile_id id) {
    return &tiles->tile[tiles->slot_of_id[id.v]];
}

/** The block of a tile that its texel (x, y) lies in. */
static inline struct lw_solve_block *lw_tiles_block(const struct lw_solve_tile *tile, uint32_t x,
                                                    uint32_t y) {
    return &tile->block[y / LW_TILE_BLOCK * tile->block_columns + x / LW_TILE_BLOCK];
}

/** Takes over, from tiles of the same scene, what a tile keeps of its light: sums, estimates, blocks, state.
 * */
void lw_tiles_take(struct lw_tiles *tiles, const struct lw_tiles *from, lw_tile_id id);
/** What it sends out of a bounce order. */
void lw_tiles_take_radiance(struct lw_tiles *tiles, const struct lw_tiles *from, lw_tile_id id,
                            uint32_t bounce);

/** Sums up a tile's blocks: its sample count, its state. */
void lw_tiles_sum_up(struct lw_solve_tile *tile);

/** Places every tile in the world and sorts them by cell. Hidden tiles count as converged. A tile that
 * is hidden no longer starts again, and is solved at once, whatever the interest: its sums are of old
 * light, or of another place. */
void lw_tiles_set_pose(struct lw_tiles *tiles, const struct lw_cells *cells, const struct lw_pose *pose);

#endif
