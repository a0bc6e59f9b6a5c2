/* atlas.h: the mip levels and tiles of an object's atlas, and the ids of tiles.
 * Threads: [any]: pure functions, but for those that give or take ids of finer levels (fine_ids.h).
 *
 * Level 0 is the atlas itself; each further level halves both sides, rounding up, until both are at most
 * LW_ATLAS_COARSEST. A tile is LW_TILE_SIDE texels square, cut off at the right and lower edge of its
 * level.
 *
 * A map may have finer levels: LW_ATLAS_FINER + k is the atlas with both sides times 2^k, for k from 1 on.
 * Coordinates of level 0 times 2^k are those of that level. */
#ifndef LW_COMMON_ATLAS_H
#define LW_COMMON_ATLAS_H

#include "common/scene/scene.h"
#include "common/tile/fine_ids.h"

#define LW_TILE_SIDE        64u /* texels; the unit of change, of encoding and of interest */
#define LW_TILE_BLOCK       16u /* texels; the unit of solving */
#define LW_TILE_TEXELS_MAX  (LW_TILE_SIDE * LW_TILE_SIDE)
#define LW_ATLAS_COARSEST   16u /* texels */
#define LW_ATLAS_LEVELS_MAX 12u
#define LW_ATLAS_FINER      64u /* finer levels are numbered from the next number on, on the wire as well */
#define LW_ATLAS_FINER_MAX  4u  /* finer levels that a scene may have */
#define LW_ATLAS_FINER_ALL  6u  /* finer levels of its coarse scene */

/* The coarsest level that is free of mixed charts; coarser levels are placeholders until finer ones arrive
 * (common/lightmap/lightmap.h). */
#define LW_ATLAS_READ_MAX 2u
/* Views read a tile with more relative noise than this at level 2 (16 times the samples), or at level 1. The
 * server sends a tile that crosses one of these limits. */
#define LW_ATLAS_COARSE_NOISE 0.25f
#define LW_ATLAS_MIDDLE_NOISE 0.1f
/* Error of tiles that hold the light of coarser lightmaps for now, with any noise. Views read them at level
 * 2. Noise alone gives at most 1. */
#define LW_ATLAS_COARSE_ERROR 1.5f

/** The finest level at which views read a tile. error: its relative error; noise_shown: the share of it that
 * is left in the texels after the filter. */
static inline unsigned lw_atlas_noise_level_min(float error, float noise_shown) {
    const float noise = error * noise_shown;
    return noise <= LW_ATLAS_MIDDLE_NOISE ? 0 : noise > LW_ATLAS_COARSE_NOISE ? 2 : 1;
}

/** A tile of the whole scene: objects in order, levels from 0 on, rows, columns. The ids behind them are
 * given to tiles of finer levels while they are in use (fine_ids.h). */
typedef struct {
    uint32_t v;
} lw_tile_id;

struct lw_atlas_level {
    uint32_t width, height; /* texels */
    uint32_t tiles_x, tiles_y;
    uint32_t first_tile; /* among the object's, or among the names of its finer levels */
};

struct lw_atlas {
    uint32_t level_count, tile_count;
    struct lw_atlas_level level[LW_ATLAS_LEVELS_MAX];
    uint32_t finer_count, finer_tile_count;
    struct lw_atlas_level finer[LW_ATLAS_FINER_ALL]; /* finer[k - 1] is level LW_ATLAS_FINER + k */
};

/** Number of doublings by which a level is finer than level 0; 0: it is not finer. */
static inline uint32_t lw_atlas_finer(uint32_t level) {
    return level > LW_ATLAS_FINER ? level - LW_ATLAS_FINER : 0;
}
/** The base-2 logarithm of the side of a level's texels, in texels of level 0. */
static inline int lw_atlas_scale(uint32_t level) {
    return level > LW_ATLAS_FINER ? -(int)(level - LW_ATLAS_FINER) : (int)level;
}

/** The tiles of all objects of a scene. Tiles of finer levels have names, which count them in the order of
 * objects, levels, rows and columns. */
struct lw_atlas_map {
    uint32_t object_count;
    uint32_t tile_count;           /* ids; with those for tiles of finer levels, claimed or not */
    uint32_t plain_count;          /* tiles that are not of finer levels: those with the first ids */
    uint32_t finer_count;          /* finer levels of each atlas */
    struct lw_atlas *shape;        /* per mesh */
    const struct lw_atlas **atlas; /* per object: its mesh's */
    uint32_t *first_tile;          /* per object */
    uint64_t *first_finer;         /* per object: the first name of its finer levels */
    uint64_t fine_names;           /* tiles of finer levels, in all */
    struct lw_tile_place *place;   /* per tile id; of no texels where nobody has claimed it */
    struct lw_fine_ids *fine;      /* ids from plain_count on; NULL: there are none */
};

#ifdef __cplusplus
extern "C" {
#endif

/** qsort() comparison of two lw_tile_id: ascending. */
int lw_tile_id_compare(const void *left, const void *right);
/** Whether a list of ids in ascending order, of `count`, holds one. list: may be NULL where count is 0 */
bool lw_tile_id_is_in(const lw_tile_id *list, size_t count, lw_tile_id id);

void lw_atlas_init(struct lw_atlas *atlas, uint32_t width, uint32_t height);
/** Adds finer levels, `count` in all. */
void lw_atlas_refine(struct lw_atlas *atlas, uint32_t count);
/** A level by its number; NULL: there is none (safe for numbers from outside). */
const struct lw_atlas_level *lw_atlas_level(const struct lw_atlas *atlas, uint32_t level);

/** Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_atlas_map_init(struct lw_atlas_map *map, const struct lw_scene *scene);
/** The same with finer levels, at most LW_ATLAS_FINER_ALL. room: how many of their tiles may have ids at a
 * time, above 0. Errors: LW_NO_MEMORY, also for too many tiles. */
LW_MUST_CHECK enum lw_status lw_atlas_map_init_finer(struct lw_atlas_map *map, const struct lw_scene *scene,
                                                     uint32_t finer, uint32_t room);
void lw_atlas_map_finish(struct lw_atlas_map *map);

/** Number of tiles of finer levels that may have ids at a time: ids from plain_count on. */
static inline uint32_t lw_atlas_map_room(const struct lw_atlas_map *map) {
    return map->tile_count - map->plain_count;
}

/** Whether there is a tile, named as on the wire: by its number within the level, row * tiles_x + column
 * (safe for indices from outside). */
bool lw_atlas_map_has_tile(const struct lw_atlas_map *map, uint32_t object, uint32_t level, uint32_t tile);
/** Id of the first tile of a level that is there and not finer. */
uint32_t lw_atlas_map_first(const struct lw_atlas_map *map, uint32_t object, uint32_t level);
/** Id of a tile, or {UINT32_MAX} if there is no such place, or it is of a finer level and has no id (safe for
 * indices from outside). */
lw_tile_id lw_atlas_map_find(const struct lw_atlas_map *map, uint32_t object, uint32_t level, uint32_t x,
                             uint32_t y);
/** The same for a tile named as on the wire. */
lw_tile_id lw_atlas_map_find_tile(const struct lw_atlas_map *map, uint32_t object, uint32_t level,
                                  uint32_t tile);
/** The same, but a tile of a finer level gets an id: {UINT32_MAX} if there is no such place, or no id is
 * left. Threads: as lw_fine_ids_claim(). */
lw_tile_id lw_atlas_map_claim(const struct lw_atlas_map *map, uint32_t object, uint32_t level, uint32_t x,
                              uint32_t y);
lw_tile_id lw_atlas_map_claim_tile(const struct lw_atlas_map *map, uint32_t object, uint32_t level,
                                   uint32_t tile);
/** The same for a tile of a finer level by its name, below map->fine_names. */
lw_tile_id lw_atlas_map_claim_name(const struct lw_atlas_map *map, uint64_t name);
/** The name of a tile of a finer level, given as on the wire; UINT64_MAX: there is no such tile (safe for
 * indices from outside). Needs no id. */
uint64_t lw_atlas_map_name_tile(const struct lw_atlas_map *map, uint32_t object, uint32_t level,
                                uint32_t tile);
/** The name of a tile of a finer level that has an id. */
uint64_t lw_atlas_map_name(const struct lw_atlas_map *map, lw_tile_id id);
/** Whether an id has a tile. Free ids of finer levels have none. */
bool lw_atlas_map_is_used(const struct lw_atlas_map *map, lw_tile_id id);
/** Takes its id from a tile of a finer level. Threads: as lw_fine_ids_release(). */
void lw_atlas_map_release(const struct lw_atlas_map *map, lw_tile_id id);

/** The tile of level 0 below a tile of a finer level. */
lw_tile_id lw_atlas_map_below(const struct lw_atlas_map *map, lw_tile_id id);
/** The number of a tile within its level, as on the wire. id: of a tile of the map */
uint32_t lw_atlas_map_number(const struct lw_atlas_map *map, lw_tile_id id);

#ifdef __cplusplus
}
#endif

#endif
