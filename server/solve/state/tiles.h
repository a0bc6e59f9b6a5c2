/* tiles.h: the solver's state per level-0 tile, block and texel: sums of light, their history, their noise.
 * Flow:    passes -> [tiles] -> publish
 * A tile is the unit of interest, encoding and sending. A block of 16 x 16 texels is the unit of solving,
 * history and convergence.
 * Threads: one worker solves and writes a tile. All workers read radiance after the barrier. */
#ifndef LW_STATE_TILES_H
#define LW_STATE_TILES_H

#include "common/tile/tile_channels.h"
#include "server/solve/state/cells.h"
#include "server/solve/state/change.h"
#include "server/solve/state/history.h"
#include "server/solve/state/packed_light.h"
#include "server/solve/surface/packets.h"
#include "server/solve/surface/texels.h"

/* Each part of an estimate has a history of its own. */
enum { LW_TILES_DIRECT, LW_TILES_INDIRECT, LW_TILES_PARTS };
_Static_assert(LW_TILES_PARTS == LW_CHANGE_PARTS, "each has a memory");
enum {
    LW_TILES_ESTIMATE_DIRECT,
    LW_TILES_ESTIMATE_BOUNCES, /* plus LW_CHANGE_FIRST or LW_CHANGE_LATER */
    LW_TILES_ESTIMATES = LW_TILES_ESTIMATE_BOUNCES + LW_CHANGE_ORDERS
};

/* Most bounce orders that tiles hold. */
#define LW_TILES_BOUNCES_MAX 16u

/* State of a block. A tile has the state of its least converged block. Diagram: docs/change.md. */
enum lw_block_state {
    LW_BLOCK_STALE,    /* its light has changed: frames solve it, whatever its noise */
    LW_BLOCK_SAMPLED,  /* frames solve it until its noise reaches the target */
    LW_BLOCK_CONVERGED /* no frame solves it until its light changes: on target, hidden, or without texels */
};

/* Which blocks of a tile a frame solves. */
enum lw_tile_work {
    LW_TILE_WORK_NONE,
    LW_TILE_WORK_INVALIDATED, /* invalidated blocks; the same frame shows them */
    LW_TILE_WORK_ALL          /* all blocks that have not converged */
};

/* Sixteen by sixteen texels of a tile. */
struct lw_solve_block {
    uint32_t tile_id;         /* lw_tile_id */
    uint32_t covered_count;   /* texels; the fields below mean nothing while it is 0 */
    struct lw_packet *packet; /* packets of its covered texels */
    uint32_t packet_count;
    struct lw_region_parts parts;
    uint32_t points_hash; /* hash over covered texels: which of their sample points are usable */
    /* Per region: weight of a W/m^2 in comparisons with the block's luminance. The darkest part has weight 1.
     * A brighter part has the inverse of its ratio to the darkest. A block of one part has weight 1. */
    float weight[LW_REGIONS];
    /* Per part, where there are several: mean luminance of E; luminance that other layers add. */
    float part_luminance[LW_REGIONS], part_other[LW_REGIONS];
    enum lw_block_state state;
    bool due;              /* the current frame solves it */
    bool unseen;           /* it was solved, and its new light was not shown yet */
    uint64_t shown_frame;  /* last frame that changed its shown planes */
    uint32_t sample_count; /* frames that solved it: the index into its random sequence */
    struct lw_history direct, indirect;
    struct lw_change_block change;
    /* Sum over texels: squared deviation of one frame's weighted luminance from the running mean. */
    double variance;
    double luminance; /* sum over texels of the luminance of E */
    /* The luminance that errors are relative to: the largest mean of block, room and tile (regions.h). The
     * darkest of several parts stands. other_luminance: what other layers add to it (light_layers.h). */
    float reference_luminance, other_luminance;
    float traced_luminance;      /* reference_luminance when its bounce rays were last traced */
    float noise[LW_TILES_PARTS]; /* relative variance of one frame's estimate of a texel; < 0: unknown */
    float error;                 /* relative standard error of luminance */
};

/* A set with all packets of a block, one bit each. */
static inline uint16_t lw_change_all_packets(const struct lw_solve_block *block) {
    return (uint16_t)((1u << block->packet_count) - 1);
}

/* Blocks along the side of a full tile. */
#define LW_TILE_BLOCKS (LW_TILE_SIDE / LW_TILE_BLOCK)

/* The light of a tile, summed up over its blocks. */
struct lw_solve_light {
    uint32_t sample_count; /* least of its blocks */
    float error;           /* relative standard error of luminance, over all blocks */
    enum lw_block_state state;
    uint64_t solved_frame; /* last frame that showed a block */
    bool begins;           /* its object was hidden, and no light was shown since it came back */
};

/* Changes that verification has found and no frame has solved yet: facts for the plan (adapt/plan.h). */
struct lw_solve_change {
    bool invalidated;           /* a block is invalidated: its light has changed */
    uint32_t invalidated_count; /* texels of invalidated blocks */
    float priority;             /* mean square over these texels: changed share of the light, at most 1 */
};

/* A tile. The fields up to `hidden` are its place: its texels, its owner, its position. */
struct lw_solve_tile {
    lw_tile_id id;
    uint32_t object, x, y, width, height; /* column and row in the object's level 0; size in texels */
    const struct lw_mesh_texels *mesh;
    uint32_t local, first;        /* first texel: of the mesh; of all texels */
    struct lw_solve_block *block; /* row by row */
    uint32_t block_columns, block_rows;
    uint32_t covered_count;
    /* A tile of a finer level (fine_tiles.h): x, y and size are those of its level, its mesh is an atlas of
     * its own, and these are the pairs of its filter. NULL: of level 0. */
    const uint8_t *fine_pair;
    uint32_t fine_slot;
    uint8_t wide_rooms;       /* (regions.h) */
    uint32_t changes;         /* lw_texels.changes of its object that its blocks have taken over */
    uint32_t cell, owner;     /* cell of its centre; the rank that solves it, by its first cell */
    struct lw_vec3 centre_ws; /* bounding sphere of its texels, at the current pose */
    float radius_m;
    struct lw_vec3 centre_os; /* the same in object space */
    float radius_os;
    bool hidden; /* its object is: the tile counts as converged, and starts again when the object is back */
    struct lw_solve_light light;
    struct lw_solve_change change;
};

struct lw_tiles {
    uint32_t count, id_count, bounces, texel_count; /* id_count: number of lw_tile_ids in the scene */
    /* texel_count, block_count, packet_count and level0_count are for level 0 alone. Texels, blocks, packets
     * and tiles of finer levels lie behind them in the arrays, up to the capacities. */
    uint32_t level0_count, capacity, texel_capacity, block_capacity;
    struct lw_solve_tile *tile;   /* sorted by cell: the order of solving */
    uint32_t *slot_of_id;         /* lw_tile_id -> index into tile, or UINT32_MAX: it is not solved as such */
    struct lw_solve_block *block; /* all tiles' blocks, by tile id */
    uint32_t block_count;
    /* The blocks' packets, one block after another. A block has room for those that its texels could fill. */
    struct lw_packet *packet;
    struct lw_change_packet *change_packet; /* a packet's gradients, for each packet */
    size_t packet_count, packet_capacity;
    uint32_t *block_of_texel; /* index into block */
    uint8_t *region_of_texel; /* (regions.h) */
    float *direct[3];         /* mean E of bounce 0 per texel, W/m^2 */
    float *indirect[3];       /* the sum of bounces 1..N */
    float *drawn[3];          /* the part of direct that client lights give; NULL: no client lights */
    /* Cosine moments (direction_form.h), W/m^2, of direct light without client lights and of bounces, by
     * part. NULL: not held. drawn_moment is that of client lights. */
    float *moment[LW_TILES_PARTS][3], *drawn_moment[3];
    bool *has_moments; /* per object */
    /* Means of the channels that are neither an irradiance nor its moment. FULL is direct + indirect; SPLIT
     * is FULL less drawn. */
    float *sum[LW_TILE_CHANNELS_MAX][LW_TILE_CHANNEL_PLANES_MAX];
    /* Shown planes by channel: the sums of the last frame that showed the block, filtered and welded. NULL:
     * the channel is not in `channels`. */
    float *shown[LW_TILE_CHANNELS_MAX][LW_TILE_CHANNEL_PLANES_MAX];
    uint32_t channels; /* channels that this solve holds (tile_channels.h) */
    /* Mean E of bounce order k + 1 alone. The last order is the rest of indirect, and has no planes. */
    float *order[LW_TILES_BOUNCES_MAX][3];
    /* Radiance that texels send out of bounce order k, W/(m^2 sr), packed. Each order has a plane of its own,
     * so that it stays while the tile is not solved. */
    uint64_t *radiance[LW_TILES_BOUNCES_MAX];
    /* [LW_REGIONS * block + region]: mean difference of this radiance from the frame before. */
    struct lw_vec3 *radiance_change[LW_TILES_BOUNCES_MAX];
    /* E of the last frame that solved the texel, alone, packed. drawn_estimate: the part of direct light that
     * client lights give; NULL where drawn is. */
    uint64_t *estimate[LW_TILES_ESTIMATES], *drawn_estimate;
    float *mean, *spread; /* luminance of these estimates: running mean, sum of squared deviations */
    float *split_mean, *split_spread; /* the same without client lights; NULL where drawn is */
    /* spread, or split_spread while SPLIT alone is shown: the light of client lights has no noise then.
     * Errors are relative to all light in both cases. */
    const float *judged_spread;
    /* Arrays of lw_texels: */
    const uint8_t *covered;
    const uint8_t *usable;
    const uint32_t *side;
    const uint32_t *changes; /* per object */
};

/** Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_tiles_init(struct lw_tiles *tiles, const struct lw_scene *scene,
                                           const struct lw_atlas_map *map, const struct lw_texels *texels,
                                           uint32_t bounces, int threads);
void lw_tiles_finish(struct lw_tiles *tiles);

/** Adds the planes that keep client lights apart, and the channels that need them. Errors: LW_NO_MEMORY;
 * finish the tiles then. */
LW_MUST_CHECK enum lw_status lw_tiles_part_drawn(struct lw_tiles *tiles);
/** Adds the planes of cosine moments, and their channels; after lw_tiles_part_drawn(). directional: as in
 * lw_solver_desc. Errors: LW_NO_MEMORY; finish the tiles then. */
LW_MUST_CHECK enum lw_status lw_tiles_hold_moments(struct lw_tiles *tiles, const struct lw_scene *scene,
                                                   const bool *directional);
/** Whether the moments of a tile are worked out. Else their planes stay 0, and take no memory there. */
static inline bool lw_tiles_has_moments(const struct lw_tiles *tiles, const struct lw_solve_tile *tile) {
    return tiles->moment[0][0] && tiles->has_moments[tile->object];
}
/** The channels of a set that a tile has light in. */
static inline uint32_t lw_tiles_channels_of(const struct lw_tiles *tiles, const struct lw_solve_tile *tile,
                                            uint32_t channels) {
    if (lw_tiles_has_moments(tiles, tile)) return channels;
    LW_TILE_CHANNELS_EACH (channel, channels)
        if (lw_tile_channel_at(channel)->moment) channels &= ~lw_tile_channel_bit(channel);
    return channels;
}

/** The last frame that changed shown planes of any tile; 0: none has. */
uint64_t lw_tiles_last_solved(const struct lw_tiles *tiles);

/** The channels of a set that the tiles hold; FULL if they hold none of them. */
static inline uint32_t lw_tiles_can_show(const struct lw_tiles *tiles, uint32_t channels) {
    channels &= tiles->channels;
    LW_TILE_CHANNELS_EACH (channel, channels)
        channels |= lw_tile_channel_bit(lw_tile_channel_at(channel)->follows);
    return channels ? channels : LW_TILE_CHANNELS_FULL;
}

/** Chooses judged_spread by the shown channels. Returns whether it changed: the variance of all blocks is
 * then summed again, and their errors are out of date until lw_estimates_judge(). */
bool lw_tiles_judge_channels(struct lw_tiles *tiles, uint32_t channels, int threads);

/** Sums the variance of all blocks again, from judged_spread. */
void lw_tiles_sum_variance(struct lw_tiles *tiles, int threads);

/** Bytes that the planes of a texel take; parts, moments: after lw_tiles_part_drawn(),
 * lw_tiles_hold_moments(). */
size_t lw_tiles_texel_bytes(uint32_t bounces, bool parts, bool moments);

/** Bytes held. */
size_t lw_tiles_memory_bytes(const struct lw_tiles *tiles);

/** Direct light without client lights, >= 0. */
static inline float lw_tiles_served(const struct lw_tiles *tiles, uint32_t c, uint32_t texel) {
    if (!tiles->drawn[c]) return tiles->direct[c][texel];
    const float served = tiles->direct[c][texel] - tiles->drawn[c][texel];
    return served > 0 ? served : 0;
}

static inline float lw_tiles_moment(const struct lw_tiles *tiles, uint32_t irradiance, uint32_t axis,
                                    uint32_t texel) {
    const float kept =
        tiles->moment[LW_TILES_DIRECT][axis][texel] + tiles->moment[LW_TILES_INDIRECT][axis][texel];
    const float *drawn = irradiance == LW_TILE_CHANNEL_FULL ? tiles->drawn_moment[axis] : NULL;
    return drawn ? kept + drawn[texel] : kept;
}

/** Mean E of the first bounce, and of all later bounces together. */
static inline float lw_tiles_first(const struct lw_tiles *tiles, uint32_t c, uint32_t texel) {
    return tiles->bounces > 1 ? tiles->order[0][c][texel] : tiles->indirect[c][texel];
}
static inline float lw_tiles_later(const struct lw_tiles *tiles, uint32_t c, uint32_t texel) {
    const float later = tiles->indirect[c][texel] - lw_tiles_first(tiles, c, texel);
    return later > 0 ? later : 0;
}

/** The mean of a texel in a plane of a channel, neither filtered nor welded. */
static inline float lw_tiles_sum(const struct lw_tiles *tiles, uint32_t channel, uint32_t plane,
                                 uint32_t texel) {
    if (lw_tile_channel_at(channel)->moment)
        return lw_tiles_moment(tiles, lw_tile_channel_at(channel)->follows, plane, texel);
    if (channel >= LW_TILE_CHANNEL_IRRADIANCES) return tiles->sum[channel][plane][texel];
    const float direct =
        channel == LW_TILE_CHANNEL_SPLIT ? lw_tiles_served(tiles, plane, texel) : tiles->direct[plane][texel];
    return direct + tiles->indirect[plane][texel];
}

/** E of the last frame that solved the texel, alone. which: LW_TILES_ESTIMATE_* */
static inline struct lw_vec3 lw_tiles_estimate(const struct lw_tiles *tiles, int which, uint32_t texel) {
    return lw_packed_light_unpack(tiles->estimate[which][texel], LW_PACKED_LIGHT_SIGNED);
}
static inline void lw_tiles_keep_estimate(struct lw_tiles *tiles, int which, uint32_t texel,
                                          struct lw_vec3 e) {
    tiles->estimate[which][texel] = lw_packed_light(e, LW_PACKED_LIGHT_SIGNED);
}
/** Its part that client lights give, if tiles->drawn is there. */
static inline struct lw_vec3 lw_tiles_drawn_estimate(const struct lw_tiles *tiles, uint32_t texel) {
    return lw_packed_light_unpack(tiles->drawn_estimate[texel], LW_PACKED_LIGHT_SIGNED);
}
static inline void lw_tiles_keep_drawn_estimate(struct lw_tiles *tiles, uint32_t texel, struct lw_vec3 e) {
    tiles->drawn_estimate[texel] = lw_packed_light(e, LW_PACKED_LIGHT_SIGNED);
}

/** What a texel sends out of a bounce order, W/(m^2 sr). */
static inline struct lw_vec3 lw_tiles_radiance(const struct lw_tiles *tiles, uint32_t bounce,
                                               uint32_t texel) {
    return lw_packed_light_unpack(tiles->radiance[bounce][texel], LW_PACKED_LIGHT_POSITIVE);
}

/** Blends an estimate into a mean. Skips an estimate that is not finite: the mean would never recover. */
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

/** Scales a moment by the change of its light's luminance. Where there was no light the moment stays 0, which
 * clients read as an even hemisphere. */
static inline void lw_tiles_scale_moment(float *const moment[3], uint32_t texel, float then, float now) {
    const float factor = then > 0 ? fmaxf(now, 0) / then : 0;
    for (uint32_t k = 0; k < 3; k++)
        if (moment[k][texel] != 0) moment[k][texel] = isfinite(factor) ? moment[k][texel] * factor : 0;
}

/** Takes over texels->changes. A block whose covered texels, usable sample points or regions have changed
 * starts again. */
void lw_tiles_recount(struct lw_tiles *tiles, int threads);

/** Shows the sums of the blocks of frame `frame` (shown_frame) as they are, in the given channels. */
void lw_tiles_show(struct lw_tiles *tiles, uint64_t frame, uint32_t channels, int threads);

#define LW_TILES_EACH_BLOCK(tile, block)                                                                     \
    for (struct lw_solve_block *block = (tile)->block, *const end_ = block + (tile)->block_columns *         \
                                                                                 (tile)->block_rows;         \
         block < end_; block++)

/* Texels (x, y) of a tile in its block at (column, row). */
#define LW_TILES_EACH_TEXEL(tile, column, row, x, y)                                                         \
    for (uint32_t y = (row)*LW_TILE_BLOCK; y < (tile)->height && y < ((row) + 1) * LW_TILE_BLOCK; y++)       \
        for (uint32_t x = (column)*LW_TILE_BLOCK; x < (tile)->width && x < ((column) + 1) * LW_TILE_BLOCK;   \
             x++)

/** The tile of an id of level 0, or of a finer one that is there. */
static inline struct lw_solve_tile *lw_tiles_at(const struct lw_tiles *tiles, lw_tile_id id) {
    return &tiles->tile[tiles->slot_of_id[id.v]];
}

/** The block that holds texel (x, y) of a tile. */
static inline struct lw_solve_block *lw_tiles_block(const struct lw_solve_tile *tile, uint32_t x,
                                                    uint32_t y) {
    return &tile->block[y / LW_TILE_BLOCK * tile->block_columns + x / LW_TILE_BLOCK];
}

/** Adds a tile of a finer level, which has no light yet. Then lw_tiles_set_pose() places it. The arrays of
 * lw_texels know its texels.
 * slot  of those that lw_texels has room for; its first texel is lw_tiles_fine_first()
 * mesh  an atlas of the tile's size; pair: of its filter. Both outlive the tile. */
void lw_tiles_add_fine(struct lw_tiles *tiles, lw_tile_id id, const struct lw_tile_place *place,
                       uint32_t slot, const struct lw_mesh_texels *mesh, const uint8_t *pair);
/** Takes it out again. The order of the tiles is another one until lw_tiles_set_pose(). */
void lw_tiles_remove_fine(struct lw_tiles *tiles, lw_tile_id id);

/** How many tiles of finer levels there is room for. */
static inline uint32_t lw_tiles_fine_slots(const struct lw_tiles *tiles) {
    return (tiles->texel_capacity - tiles->texel_count) / LW_TILE_TEXELS_MAX;
}
static inline uint32_t lw_tiles_fine_first(const struct lw_tiles *tiles, uint32_t slot) {
    return tiles->texel_count + slot * LW_TILE_TEXELS_MAX;
}
/** Whether a tile of any level is there. */
static inline bool lw_tiles_have(const struct lw_tiles *tiles, lw_tile_id id) {
    return tiles->slot_of_id[id.v] != UINT32_MAX;
}

/** Copies a tile's planes, blocks, light and change from tiles of the same scene. */
void lw_tiles_take(struct lw_tiles *tiles, const struct lw_tiles *from, lw_tile_id id);
/** Copies the radiance that it sends out of a bounce order. */
void lw_tiles_take_radiance(struct lw_tiles *tiles, const struct lw_tiles *from, lw_tile_id id,
                            uint32_t bounce);

/** Sets a tile's sample count and state from its blocks. */
void lw_tiles_sum_up(struct lw_solve_tile *tile);

/** Places every tile in the world and sorts them by cell. Hidden tiles count as converged. A tile whose
 * object is back starts again, since its sums are of old light or another place; it is invalidated with
 * priority 1. */
void lw_tiles_set_pose(struct lw_tiles *tiles, const struct lw_cells *cells, const struct lw_pose *pose);

#endif
