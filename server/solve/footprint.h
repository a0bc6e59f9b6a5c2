/* footprint.h: where on its texel a ray starts: up to eight places, spread over the part of the texel that is surface.
 * Flow:    lightmap triangles -> [footprint] -> texels -> origins and normals of the passes' packets
 * Threads: built with the texels; then [any].
 *
 * One place per texel would make shadow edges as jagged as the texels, and a texel half under an object all or nothing.
 * The rays of successive samples start at successive places, so that a texel's E tends to its mean over the places.
 * They are points of the (0,2)-sequence: whichever way a shadow's edge runs, its share is right to about 1/8. A place is
 * on the surface of the triangle that the lightmap has there, raised by lw_scene_shadow_origin(); points of the square that no
 * triangle of the chart covers are left out, never moved to its edge, which may lie in the plane of the next wall. */
#ifndef LW_SOLVE_FOOTPRINT_H
#define LW_SOLVE_FOOTPRINT_H

#include "common/scene/scene.h"
#include "common/trace/trace.h"

#define LW_FOOTPRINT_PLACES 8u

/** One place of a texel, in object space; 12 bytes, for they are many. */
struct lw_footprint_place {
    int16_t offset[3];    /* from the texel's position; 32767 is its reach */
    uint16_t normal[2];   /* shading normal, octahedral (Meyer et al. 2010): off by under 5e-5 */
    uint8_t geometric[2]; /* the same of the face, on the side that is lit: off by under 0.02 */
};

struct lw_footprint {
    uint32_t *first;                  /* per texel and one more: its first place */
    struct lw_footprint_place *place; /* of all texels */
    float *reach;                     /* per texel: the largest offset, m in object space */
    float *lift; /* per texel: how far rays start off the surface for rounding, m in object space */
};

/** A place before it is packed. */
struct lw_footprint_point {
    struct lw_vec3 origin, normal, geometric; /* object space */
};

/** Where place k of a texel lies in its unit square. */
static inline struct lw_vec2 lw_footprint_spot(uint32_t k) {
    static const uint8_t x[LW_FOOTPRINT_PLACES] = {1, 9, 5, 13, 3, 11, 7, 15},
                         y[LW_FOOTPRINT_PLACES] = {1, 9, 13, 5, 11, 3, 7, 15};
    return (struct lw_vec2){(float)x[k] / 16, (float)y[k] / 16};
}

/** Packs the places of one texel behind those that are there.
 * position    the texel's own; places are stored relative to it
 * largest     the largest coordinate of its triangles, either sign */
void lw_footprint_pack(struct lw_footprint *footprint, uint32_t texel, struct lw_vec3 position, float largest,
                       const struct lw_footprint_point *point, uint32_t count);

/** A transform, made ready for many places. */
struct lw_footprint_frame {
    struct lw_affine to_world;
    float normal[3][3];      /* cofactors: turns normals, keeping them outward under mirroring */
    float stretch, offset_m; /* bounds of what it does to coordinates */
};
void lw_footprint_frame_init(struct lw_footprint_frame *frame, const struct lw_affine *to_world);

/** Sixteen places, structure of arrays. */
struct lw_footprint_lanes {
    _Alignas(64) float x[LW_TRACE_WIDTH];
    float y[LW_TRACE_WIDTH], z[LW_TRACE_WIDTH];                       /* position, then the ray's origin */
    float nx[LW_TRACE_WIDTH], ny[LW_TRACE_WIDTH], nz[LW_TRACE_WIDTH]; /* shading normal, unit */
    float gx[LW_TRACE_WIDTH], gy[LW_TRACE_WIDTH], gz[LW_TRACE_WIDTH]; /* of the face, unit */
    float lift[LW_TRACE_WIDTH];
};

/* An even number of steps, so that the six axes, which most walls face, are exact. */
#define LW_FOOTPRINT_NORMAL_STEPS    65534.0f
#define LW_FOOTPRINT_GEOMETRIC_STEPS 254.0f

/** Loads one place into a lane: offsets in object space, normals still folded. position: the texel's own. */
static inline void lw_footprint_load(const struct lw_footprint *footprint, uint32_t texel, uint32_t place,
                                     struct lw_vec3 position, struct lw_footprint_lanes *lanes,
                                     uint32_t lane) {
    const struct lw_footprint_place *p = &footprint->place[footprint->first[texel] + place];
    const float step = footprint->reach[texel] * (1.0f / 32767);
    lanes->x[lane] = position.x + step * (float)p->offset[0];
    lanes->y[lane] = position.y + step * (float)p->offset[1];
    lanes->z[lane] = position.z + step * (float)p->offset[2];
    lanes->lift[lane] = footprint->lift[texel];
    lanes->nx[lane] = (float)p->normal[0], lanes->ny[lane] = (float)p->normal[1];
    lanes->gx[lane] = (float)p->geometric[0], lanes->gy[lane] = (float)p->geometric[1];
}
/** Brings loaded lanes to world space and lifts their origins off the surface. */
void lw_footprint_to_world(const struct lw_footprint_frame *frame, struct lw_footprint_lanes *lanes);

/** The place of a texel that sample number `sample` takes. usable: mask of its places, not 0; turn: a random number that
 * changes with sample / 8, so that no place always meets the same part of a light's sequence. */
static inline uint32_t lw_footprint_choose(uint8_t usable, uint32_t sample, uint32_t turn) {
    const uint32_t step = sample + (turn & (LW_FOOTPRINT_PLACES - 1));
    if (usable == UINT8_MAX) return step % LW_FOOTPRINT_PLACES;
    uint32_t skip = step % (uint32_t)__builtin_popcount(usable), mask = usable;
    while (skip--) mask &= mask - 1;
    return (uint32_t)__builtin_ctz(mask);
}

#endif
