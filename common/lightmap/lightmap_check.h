/* lightmap_check.h: measures a finished layout: texels covered, stretch, overlaps, texels of two places.
 * Flow:    lightmap UVs -> [check] -> report; also decides whether a file's own UVs may be used
 * Threads: pure functions, [any]. */
#ifndef LW_COMMON_LIGHTMAP_CHECK_H
#define LW_COMMON_LIGHTMAP_CHECK_H

#include "common/scene/scene.h"

/** Triangles in an atlas. */
struct lw_lightmap_map {
    const struct lw_mesh *mesh;       /* positions, materials */
    const uint32_t (*triangle)[3];    /* indices into uv */
    const struct lw_vec2 *uv;         /* texels */
    uint32_t uv_count, width, height; /* the front's */
};

/** Texels whose square overlaps a triangle. back: NULL, or per triangle whether its back counts too.
 * Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_lightmap_check_coverage(const struct lw_lightmap_map *map,
                                                        const uint8_t *back, uint64_t *out_covered);

/** Texture stretch of Sander et al. 2001, scaled so that 1 is an isometry: L2 over the mesh, and the
 * largest. */
void lw_lightmap_check_stretch(const struct lw_lightmap_map *map, float *out_rms, float *out_max);

/** See lw_lightmap_overlaps(). Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_lightmap_check_overlaps(const struct lw_lightmap_map *map,
                                                        uint64_t *out_texels);

/** See lw_lightmap_mixed(). Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_lightmap_check_mixed(const struct lw_lightmap_map *map, uint64_t *out_texels);

/** See lw_lightmap_coarsest(). Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_lightmap_check_coarsest(const struct lw_lightmap_map *map,
                                                        uint8_t *out_level);

#endif
