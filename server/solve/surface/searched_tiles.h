/* searched_tiles.h: results of searches for hidden points in tiles of finer levels.
 * Flow:    texels of a tile, after a search -> [searched_tiles] -> the same texels, without one
 * Threads: find, restore: [any]; keep: one thread, while no other call runs.
 *
 * A search takes most of the time of making a tile. Its result is five arrays of 4,096 elements, which
 * compress to some 0.5 kB. It holds for as long as the texels of level 0 of its object stay as they are. The
 * results that were used last are kept. */
#ifndef LW_SURFACE_SEARCHED_TILES_H
#define LW_SURFACE_SEARCHED_TILES_H

#include "server/solve/surface/texels.h"

struct lw_searched_tiles;

/** Arrays of a tile's texels, row by row (fine_texels.h). */
struct lw_searched_texels {
    const struct lw_mesh_texels *mesh;
    uint8_t *covered, *usable, *filled, *walls;
    uint32_t *side, *source;
};

/** tiles_max, bytes_max: as many results at most. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_searched_tiles_create(uint32_t tiles_max, size_t bytes_max,
                                                      struct lw_searched_tiles **out_tiles);
/** NULL is fine. */
void lw_searched_tiles_destroy(struct lw_searched_tiles *tiles);

/** Whether a tile's result is here. changes: lw_texels.changes of its object. tiles: NULL: none is. */
bool lw_searched_tiles_find(const struct lw_searched_tiles *tiles, const struct lw_tile_place *place,
                            uint32_t changes);

/** Writes the result of a tile that is here into its texels, which have their size.
 * Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_searched_tiles_restore(const struct lw_searched_tiles *tiles,
                                                       const struct lw_tile_place *place,
                                                       const struct lw_searched_texels *texels);

/** Keeps the result of a tile, or notes that it was used. Without memory it keeps nothing. */
void lw_searched_tiles_keep(struct lw_searched_tiles *tiles, const struct lw_tile_place *place,
                            uint32_t changes, const struct lw_searched_texels *texels);

/** Bytes held. */
size_t lw_searched_tiles_memory_bytes(const struct lw_searched_tiles *tiles);

#endif
