/* atlas.h: the mip levels and tiles of an object's atlas, and the ids of tiles.
 * Threads: pure functions, [any].
 *
 * Level 0 is the atlas itself; each further level halves both sides, rounding up, until both are at most
 * LW_ATLAS_COARSEST. A tile is LW_TILE_SIDE texels square, cut off at the right and lower edge of its
 * level. */
#ifndef LW_COMMON_ATLAS_H
#define LW_COMMON_ATLAS_H

#include "common/scene/scene.h"

#define LW_TILE_SIDE        64u /* texels; the unit of change, of encoding and of interest */
#define LW_TILE_BLOCK       16u /* texels; the unit of solving */
#define LW_TILE_TEXELS_MAX  (LW_TILE_SIDE * LW_TILE_SIDE)
#define LW_ATLAS_COARSEST   16u /* texels */
#define LW_ATLAS_LEVELS_MAX 12u

/* The coarsest level that is free of mixed charts; coarser levels are placeholders until finer ones arrive
 * (common/lightmap/lightmap.h). */
#define LW_ATLAS_READ_MAX 2u
/* Views read a tile with more relative noise than this at level 2 (16 times the samples), or at level 1. The
 * server sends a tile that crosses one of these limits. */
#define LW_ATLAS_COARSE_NOISE 0.25f
#define LW_ATLAS_MIDDLE_NOISE 0.1f

/** The finest level at which views read a tile. error: its relative error; noise_shown: the share of it that
 * is left in the texels after the filter. */
static inline unsigned lw_atlas_noise_level_min(float error, float noise_shown) {
    const float noise = error * noise_shown;
    return noise <= LW_ATLAS_MIDDLE_NOISE ? 0 : noise > LW_ATLAS_COARSE_NOISE ? 2 : 1;
}

/** A tile of the whole scene: objects in order, levels from fine to coarse, rows, columns. */
typedef struct {
    uint32_t v;
} lw_tile_id;

struct lw_atlas_level {
    uint32_t width, height; /* texels */
    uint32_t tiles_x, tiles_y;
    uint32_t first_tile; /* within the object */
};

struct lw_atlas {
    uint32_t level_count, tile_count;
    struct lw_atlas_level level[LW_ATLAS_LEVELS_MAX];
};

/** Where a tile lies. */
struct lw_tile_place {
    uint32_t object, level, x, y; /* x, y: tile column and row within the level */
    uint32_t width, height;       /* texels */
};

/** The tiles of all objects of a scene. */
struct lw_atlas_map {
    uint32_t object_count, tile_count;
    struct lw_atlas *atlas;      /* per object */
    uint32_t *first_tile;        /* per object */
    struct lw_tile_place *place; /* per tile id */
};

#ifdef __cplusplus
extern "C" {
#endif

void lw_atlas_init(struct lw_atlas *atlas, uint32_t width, uint32_t height);

/** Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_atlas_map_init(struct lw_atlas_map *map, const struct lw_scene *scene);
void lw_atlas_map_finish(struct lw_atlas_map *map);

/** Id of a tile, or {UINT32_MAX} if there is no such place (safe for indices from outside). */
lw_tile_id lw_atlas_map_find(const struct lw_atlas_map *map, uint32_t object, uint32_t level, uint32_t x,
                             uint32_t y);
/** The same for a tile named by its number within the level, row * tiles_x + column, as on the wire. */
lw_tile_id lw_atlas_map_find_tile(const struct lw_atlas_map *map, uint32_t object, uint32_t level,
                                  uint32_t tile);
/** That number of a tile. id: of a tile of the map */
uint32_t lw_atlas_map_number(const struct lw_atlas_map *map, lw_tile_id id);

#ifdef __cplusplus
}
#endif

#endif
