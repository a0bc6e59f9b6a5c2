/* priority.h: order in which a session gets the tiles that it lacks: by visible error, largest first.
 * Flow:    snapshots: how far each tile has moved -> [priority] -> order in which
 *          a session is sent what it lacks
 * Threads: [loop].
 *
 *   priority = relative error of what the session has, root mean square over the area it covers, x its age
 *   error^2  = sum of the squared changes since the version that the session has; the last few are remembered
 *
 * Squares are summed because most of a change is noise, which goes to and fro. A tile of a coarser level
 * covers more for as many bytes, and views read coarser levels as long as light is noisy. Age counts as much
 * as error, so that tiles which change alike take turns. By error alone, or error per byte, a tile that lags
 * would starve on a link that takes less than changes. */
#ifndef LW_SERVE_TILES_PRIORITY_H
#define LW_SERVE_TILES_PRIORITY_H

#include "common/tile/atlas.h"

#define LW_PRIORITY_KEPT    8u   /* versions of a tile whose changes are remembered */
#define LW_PRIORITY_LACKING 1.0f /* relative error of what stands in for a tile that a session never had */
#define LW_PRIORITY_BINS    512u /* four to an octave */

/* A tile that only stands in for finer tiles need not be the newest version. It is sent again when it differs
 * by this much, or is this old. */
#define LW_PRIORITY_STAND_IN_OFF    0.1f /* relative, root mean square */
#define LW_PRIORITY_STAND_IN_FRAMES 16u

struct lw_priority {
    const struct lw_atlas_map *atlas_map;
    struct lw_priority_tile {
        uint32_t count; /* versions so far; the last few are in the ring */
        uint64_t version[LW_PRIORITY_KEPT];
        float square[LW_PRIORITY_KEPT]; /* square of the change to the version */
    } * tile;
    /* For lists that are being put in order. */
    uint32_t *listed;
    uint16_t *bin;
    uint32_t listed_count;
};

/** atlas_map outlives it. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_priority_init(struct lw_priority *priority,
                                              const struct lw_atlas_map *atlas_map);
void lw_priority_finish(struct lw_priority *priority);

/* Versions are counted by their frames here (lw_snapshot_frame_of()). */

/** A tile has a new version. change: relative, root mean square, against the version
 * before; 0: not known, taken for 1. */
void lw_priority_note(struct lw_priority *priority, uint32_t tile, uint64_t version, float change);

/** Ends the history of a tile, whose id may be given to another. */
void lw_priority_forget(struct lw_priority *priority, uint32_t tile);

/** Priority of a tile's newest version for a session that has version `has` of it (0: none).
 * frame: the newest. An object's coarsest level counts more than all else, if it has none of it. */
float lw_priority_of(const struct lw_priority *priority, uint32_t tile, uint64_t has, uint64_t frame);

/** Whether a session that has version `has` of a tile, which only stands in for others, should be
 * sent its newest one, `version`. */
bool lw_priority_is_due_to_stand_in(const struct lw_priority *priority, uint32_t tile, uint64_t has,
                                    uint64_t version);

/** Puts tiles in order, by priority and equal ones (to a quarter of an octave) as they were listed: begin,
 * list each, end. out_tile: as many as were listed, atlas_map->tile_count at most. */
void lw_priority_list_begin(struct lw_priority *priority);
void lw_priority_list(struct lw_priority *priority, uint32_t tile, float value);
void lw_priority_list_end(const struct lw_priority *priority, uint32_t *out_tile);

#endif
