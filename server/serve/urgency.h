/* urgency.h: which of the tiles that a session lacks it should get first: those by which what it shows is furthest off.
 * Flow:    snapshots: how far each tile has moved -> [urgency] -> order in which a session is sent what it lacks
 * Threads: [loop].
 *
 * What counts is the square of the relative error, summed over pixels, since that is what views are judged by. The error of a tile
 * is how far it has moved since the version that the session has: the sum of the changes of its versions, of which the last
 * few are remembered. Its pixels are guessed by its texels: who looks wants the level whose texels are as large as pixels. */
#ifndef LW_SERVE_URGENCY_H
#define LW_SERVE_URGENCY_H

#include "common/tile/atlas.h"

#define LW_URGENCY_KEPT    8u    /* versions of a tile whose changes are remembered */
#define LW_URGENCY_LACKING 0.25f /* relative error of what stands in for a tile that a session never had */
#define LW_URGENCY_AGE_FRAMES                                                                                \
    16.0f                    /* a tile that was behind for so long counts twice: nothing waits for ever */
#define LW_URGENCY_BINS 512u /* four to an octave */

struct lw_urgency {
    const struct lw_atlas_map *atlas_map;
    struct lw_urgency_tile {
        uint32_t count; /* of versions so far; the last few are in the ring */
        uint64_t version[LW_URGENCY_KEPT];
        float moved[LW_URGENCY_KEPT]; /* sum of all changes up to that version */
    } * tile;
    /* For lists that are being put in order. */
    uint32_t *listed;
    uint16_t *bin;
    uint32_t listed_count;
};

/** atlas_map outlives it. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_urgency_init(struct lw_urgency *urgency,
                                             const struct lw_atlas_map *atlas_map);
void lw_urgency_finish(struct lw_urgency *urgency);

/** A tile has a new version. change: relative, root mean square, against the version before. */
void lw_urgency_note(struct lw_urgency *urgency, uint32_t tile, uint64_t version, float change);

/** How much it would help a session to get a tile, of which it has version `has` (0: none), in its newest version.
 * frame: the newest. A tile that it never had counts more the coarser it is, and an object's coarsest more than all else. */
float lw_urgency_of(const struct lw_urgency *urgency, uint32_t tile, uint64_t has, uint64_t frame);

/** Puts tiles in order, the most urgent first and equal ones (to a quarter of an octave) as they were listed: begin, list each,
 * end. out_tile: as many as were listed, atlas_map->tile_count at most. */
void lw_urgency_list_begin(struct lw_urgency *urgency);
void lw_urgency_list(struct lw_urgency *urgency, uint32_t tile, float value);
void lw_urgency_list_end(const struct lw_urgency *urgency, uint32_t *out_tile);

#endif
