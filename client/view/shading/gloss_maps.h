/* gloss_maps.h: the finishes of a packet's hits, read from their textures for all hits of a material at once.
 * Flow:    corners of the triangles that are met -> [gloss_maps] -> lw_gloss16 (gloss.h)
 * Threads: pure functions, [any].
 *
 * Textures that are read at the same texels, as most of a material are, share the search for them. */
#ifndef LW_CLIENT_VIEW_SHADING_GLOSS_MAPS_H
#define LW_CLIENT_VIEW_SHADING_GLOSS_MAPS_H

#include "client/view/shading/gloss.h"

typedef float lw_gloss_float4 __attribute__((vector_size(16)));

/** Vectors of a triangle's corner, or their mean at a hit. */
struct lw_gloss_corner {
    lw_gloss_float4 normal;  /* world space, any length; u of UV set 0 */
    lw_gloss_float4 tangent; /* where u of a normal map points, world space, any length; v of UV set 0 */
    lw_gloss_float4 second;  /* u and v of UV set 1; twice 0 */
};

/** The mean at a hit. weight: of the corners */
static inline struct lw_gloss_corner lw_gloss_maps_mean(const struct lw_gloss_corner corner[3],
                                                        const float weight[3]) {
    const float a = weight[0], b = weight[1], c = weight[2];
    const struct lw_gloss_corner mean = {
        .normal = a * corner[0].normal + b * corner[1].normal + c * corner[2].normal,
        .tangent = a * corner[0].tangent + b * corner[1].tangent + c * corner[2].tangent,
        .second = a * corner[0].second + b * corner[1].second + c * corner[2].second,
    };
    return mean;
}

/** Texture coordinates of a packet, of both sets. */
struct lw_gloss_uv16 {
    _Alignas(64) float u[2][LW_GLOSS_WIDTH], v[2][LW_GLOSS_WIDTH];
};

/** Sets *out to a surface without maps, and plain, tangent and *uv to the means at the hits. plain: times
 * side, unit. */
void lw_gloss_maps_begin(const struct lw_gloss_corner mean[LW_GLOSS_WIDTH], const float side[LW_GLOSS_WIDTH],
                         struct lw_gloss16 *out, struct lw_gloss_uv16 *uv);

/** Parts of a finish to read. */
enum {
    LW_GLOSS_MAPS_BUMPS = 1, /* the mesh has tangents */
    LW_GLOSS_MAPS_BASE = 2   /* base, too, by the material alone: without vertex colours */
};

/** Fills lanes with the finish of one material: all but plain, tangent, turn, side and to_eye.
 * what  LW_GLOSS_MAPS_ */
void lw_gloss_maps_take(struct lw_gloss16 *gloss, uint16_t lanes, const struct lw_scene *scene,
                        const struct lw_material *material, unsigned what, const struct lw_gloss_uv16 *uv);

#endif
