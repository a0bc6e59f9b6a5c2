/* coarse_scene.h: a scene with lightmaps of a quarter of the density, for a first picture.
 * Flow:    scene -> [coarse_scene] -> coarse_first
 * Threads: one thread at a time; between two calls [any] may read.
 *
 * A texel of it is a block of 4 x 4 texels of the scene's own lightmaps. Such a block belongs to one chart
 * (common/lightmap/lightmap.h), so the coarse charts do not overlap either. */
#ifndef LW_SOLVE_COARSE_SCENE_H
#define LW_SOLVE_COARSE_SCENE_H

#include "common/tile/atlas.h"

#define LW_COARSE_SCENE_SHIFT 2u /* log2 of the side of a coarse texel, in texels of the scene */
#define LW_COARSE_SCENE_SIDE  (1u << LW_COARSE_SCENE_SHIFT)

struct lw_coarse_scene {
    struct lw_scene scene; /* shares all but meshes, materials and sky with the original */
    struct lw_atlas_map map;
    struct lw_mesh *mesh;
    struct lw_vec2 *uv; /* lightmap coordinates of all meshes */
};

/** original: outlives it; its meshes have lightmap coordinates. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_coarse_scene_init(struct lw_coarse_scene *coarse,
                                                  const struct lw_scene *original);
/** A zeroed one is fine. */
void lw_coarse_scene_finish(struct lw_coarse_scene *coarse);

/** The tile of level 0 of the coarse scene in which a tile of the original's level 0 or finer lies. map: the
 * coarse scene's */
lw_tile_id lw_coarse_scene_below(const struct lw_atlas_map *map, const struct lw_tile_place *place);

/** The key under which findings and light of the coarse scene are saved: another one than the scene's own. */
void lw_coarse_scene_key(const uint8_t key[16], uint8_t out_key[16]);

/** Texels of all objects' lightmaps, with surface or without. */
uint64_t lw_coarse_scene_count_texels(const struct lw_scene *scene);

/** Copies materials and sky, which updates change. variant: of `scene`, or of a scene like it */
void lw_coarse_scene_follow(struct lw_scene *variant, const struct lw_scene *scene);

#endif
