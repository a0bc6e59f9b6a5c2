/* coarse_tiles.h: the light of a coarse scene (coarse_scene.h) as tiles of the whole density.
 * Flow:    tiles of a solver of the coarse scene -> [coarse_tiles] -> tiles of level 0 of the scene
 * Threads: update: one call at a time, workers inside; read: [any] between two updates.
 * Memory:  planes of each tile, if they are held: so the coarse scene's solver may go. Else they are worked
 *          out when a tile is read.
 *
 * Coarse texels are interpolated bilinearly, those of one chart among themselves, for coarse charts have no
 * gutters between them. The mean over a block of 4 x 4 texels is its coarse texel, so level 2 of the atlas is
 * the coarse atlas: views that read it see no light that the coarse solver did not put there. */
#ifndef LW_SOLVE_COARSE_TILES_H
#define LW_SOLVE_COARSE_TILES_H

#include "server/solve/coarse_scene.h"
#include "server/solve/solver.h"

/** Frames of a tile's own light before it takes the place of coarse light. With fewer it is blotched. */
#define LW_COARSE_TILES_FRAMES 8u

/** Whether a tile's own light, of whatever solver, is to be read in the place of coarse light. */
static inline bool lw_coarse_tiles_end(const struct lw_solver_tile *tile) {
    return tile->sample_count >= LW_COARSE_TILES_FRAMES || !tile->has_surface;
}

struct lw_coarse_tiles_tile;

struct lw_coarse_tiles {
    const struct lw_atlas_map *map, *coarse_map;
    struct lw_coarse_tiles_tile *tile; /* per id below map->plain_count; used are those of level 0 */
    uint32_t channels;
    bool holds_planes;
    int threads;
};

/** map, coarse_map: of the scene and of the coarse one; they outlive it. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_coarse_tiles_init(struct lw_coarse_tiles *tiles,
                                                  const struct lw_atlas_map *map,
                                                  const struct lw_atlas_map *coarse_map, bool holds_planes,
                                                  int threads);
/** A zeroed one is fine. */
void lw_coarse_tiles_finish(struct lw_coarse_tiles *tiles);

/** Takes over the light that has changed since the last update.
 * solver    the coarse scene's, between two frames
 * channels  that it shows
 * skipped   per id: whether the tile is left out, since nobody reads it; NULL: none is
 * Errors    LW_NO_MEMORY: some tiles have their light of before */
LW_MUST_CHECK enum lw_status lw_coarse_tiles_update(struct lw_coarse_tiles *tiles,
                                                    const struct lw_solver *solver, uint32_t channels,
                                                    const uint8_t *skipped);

/** The same for one tile. Errors: as that. */
LW_MUST_CHECK enum lw_status lw_coarse_tiles_update_one(struct lw_coarse_tiles *tiles,
                                                        const struct lw_solver *solver, uint32_t channels,
                                                        lw_tile_id id);

/** Reads a tile of level 0, as lw_solver_ops.read_tile(), after the first update. `direct` is all light, and
 * `indirect` is black; there is no albedo. The error is LW_ATLAS_COARSE_ERROR. */
void lw_coarse_tiles_read(const struct lw_coarse_tiles *tiles, lw_tile_id id,
                          struct lw_solver_tile *out_tile);
/** Reads planes as lw_solver_ops.read_planes() does. solver: the solver of the coarse scene, as it was at the
 * last update. */
void lw_coarse_tiles_read_planes(const struct lw_coarse_tiles *tiles, const struct lw_solver *solver,
                                 lw_tile_id id, struct lw_solver_room *room,
                                 struct lw_solver_tile *read_tile);

/** Frees the light of a tile that nobody reads any more. */
void lw_coarse_tiles_forget(struct lw_coarse_tiles *tiles, lw_tile_id id);

/** Bytes held. */
size_t lw_coarse_tiles_memory_bytes(const struct lw_coarse_tiles *tiles);

#endif
