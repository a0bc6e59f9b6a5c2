/* fine_texels.h: the texels of one tile of a finer level (atlas.h), placed when somebody looks at it.
 * Flow:    lightmap coordinates times 2^k, texels of level 0 -> [fine_texels] -> texels of one tile
 * Threads: prepare: one thread; make: [any], once its object is prepared.
 *
 * They are rasterised, searched for hidden points and parted by walls as those of level 0 are, together with
 * some texels around the tile. Only near texels of level 0 that have lost points, or on which a wall stands,
 * are they searched: all others have every point. The result of a search is kept for when the tile is made
 * again (searched_tiles.h). */
#ifndef LW_SURFACE_FINE_TEXELS_H
#define LW_SURFACE_FINE_TEXELS_H

#include "server/solve/surface/hidden_points.h"

/** The texels of one tile, row by row. */
struct lw_fine_texels {
    struct lw_mesh_texels mesh; /* an atlas of the tile's size; without triangles */
    /* The fields of lw_texels of the same names, for these texels. A source is a texel of the tile, or
     * LW_TEXEL_NONE. */
    uint8_t *covered, *usable, *filled, *walls;
    uint32_t *side, *source;
    bool searched;   /* some of its texels were searched, by this call */
    bool remembered; /* the result of an earlier search was used */
};

struct lw_fine_texels_maker;

/** texels: outlive it. has_albedo: texels have their albedo, which takes as long again.
 * Bakes set it. They make each tile once, so that no search result is kept.
 * Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_fine_texels_maker_create(const struct lw_texels *texels, bool has_albedo,
                                                         struct lw_fine_texels_maker **out_maker);
/** NULL is fine. */
void lw_fine_texels_maker_destroy(struct lw_fine_texels_maker *maker);

/** Lists which triangles of an object's mesh lie where, unless they are listed. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_fine_texels_prepare(struct lw_fine_texels_maker *maker, uint32_t object);

/** Places the texels of a tile.
 * points  how hidden points are looked for (invalid_texels.h), of any texels
 * place   of a finer level
 * Errors  LW_NO_MEMORY; *out holds nothing then */
LW_MUST_CHECK enum lw_status lw_fine_texels_make(const struct lw_fine_texels_maker *maker,
                                                 const struct lw_hidden_points_search *points,
                                                 const struct lw_tile_place *place,
                                                 struct lw_fine_texels *out);
/** Keeps the result of the search of a tile that was made. One thread, while no tile is made. */
void lw_fine_texels_remember(struct lw_fine_texels_maker *maker, const struct lw_tile_place *place,
                             const struct lw_fine_texels *fine);
/** A zeroed one is fine. */
void lw_fine_texels_finish(struct lw_fine_texels *fine);

/** Bytes held by the lists of triangles and by results of searches. */
size_t lw_fine_texels_maker_memory_bytes(const struct lw_fine_texels_maker *maker);

#endif
