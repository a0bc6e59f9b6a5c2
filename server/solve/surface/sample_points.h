/* sample_points.h: where on its texel a ray starts: up to eight points, spread over the part that is surface.
 * Flow:    lightmap triangles -> [sample_points] -> texels -> origins and normals of the passes' packets
 * Threads: built with the texels; then [any].
 *
 * One point per texel would make shadow edges as jagged as the texels, and a texel half under an object all
 * or nothing. Successive samples start at successive points, so that a texel's E tends to its mean over them.
 *
 * They are points of the (0,2)-sequence: whichever way a shadow's edge runs, its share is right to about
 * 1/8. A sample point lies on the lightmap's triangle there, raised by lw_scene_shadow_origin(). Points
 * of the square that no triangle of the chart covers are left out. They are never moved to its edge,
 * which may lie in the plane of the next wall. Further points of the sequence take their turn, so that a
 * narrow chart has eight as well. */
#ifndef LW_SURFACE_SAMPLE_POINTS_H
#define LW_SURFACE_SAMPLE_POINTS_H

#include "common/base/points16.h"
#include "common/scene/scene.h"
#include "common/trace/trace.h"
#include "server/solve/surface/packed_length.h"

#define LW_SAMPLE_POINTS_MAX 8u
/* Points of a texel's square of which the first eight on its chart are its sample points: a strip of an
 * eighth of a texel has as many. */
#define LW_SAMPLE_POINTS_SPOTS 64u

/** A sample point of a texel of the general form, in object space: 12 bytes. From the lowest bit of the first
 * word:
 * three times 16 bits  offset from the texel's position, signed; 32767 is its reach
 * twice 16             shading normal, octahedral (Meyer et al. 2010): off by under 5e-5
 * twice 8              the same of the face, on the side that is lit: off by under 0.02 */
struct lw_sample_points_packed {
    uint32_t word[3];
};

/** The plane of flat texels, in object space. Normals are in steps, as the words above have them. */
struct lw_sample_points_plane {
    struct lw_vec3 right, down; /* one texel along the columns and the rows of the atlas, m */
    struct lw_vec2 normal, geometric;
};

/** The sample points of a mesh's texels. Most texels are flat: their points lie on one plane with one normal,
 * and the texel's position is at the middle of its square. A point of a flat texel is the number of its spot,
 * 1 byte, and the plane serves many texels. Other texels have the general form. */
struct lw_sample_points {
    uint32_t *first; /* per texel and one more: its first sample point */
    uint32_t *form; /* per texel: LW_SAMPLE_POINTS_FLAT | its plane, or the number of flat points before it */
    uint8_t *spot;  /* per sample point: the number of its spot; of flat texels */
    struct lw_sample_points_packed *packed; /* sample points of the other texels */
    struct lw_sample_points_plane *plane;
    uint32_t packed_count, plane_count;
    /* Per texel, m in object space, packed (packed_length.h). reach: the largest offset. lift: how far rays
     * start off the surface for rounding. */
    uint16_t *reach, *lift;
};
#define LW_SAMPLE_POINTS_FLAT 0x80000000u

/** A sample point before it is packed. */
struct lw_sample_points_point {
    struct lw_vec3 origin, normal, geometric; /* object space */
    uint8_t spot;
};

/** A texel before its sample points are packed. */
struct lw_sample_points_texel {
    struct lw_vec3 position;    /* sample points are stored relative to it */
    struct lw_vec3 right, down; /* how its square lies in space, if it is flat */
    float largest;              /* the largest coordinate of its triangles, either sign */
    bool has_spots;             /* else it is too narrow for any: its one point is its position */
    uint32_t count;
    struct lw_sample_points_point point[LW_SAMPLE_POINTS_MAX];
    uint32_t near[2]; /* texels packed before, whose planes may be its own; or itself */
};

/** Where spot k of LW_SAMPLE_POINTS_SPOTS lies in a texel's unit square. The first eight are in the middle of
 * their eighths in both directions, those that follow of their 64ths. */
struct lw_vec2 lw_sample_points_spot(uint32_t k);

/** Room for texels, not for their points yet. Returns false without memory; finish the
 * sample points in any case. */
LW_MUST_CHECK bool lw_sample_points_init(struct lw_sample_points *points, uint32_t texels);
/** Makes room for the points that points->first counts. Returns false without memory. */
LW_MUST_CHECK bool lw_sample_points_reserve(struct lw_sample_points *points, uint32_t texels);
void lw_sample_points_finish(struct lw_sample_points *points);

/** Packs the sample points of one texel; texels come in ascending order. Returns false without memory. */
LW_MUST_CHECK bool lw_sample_points_pack(struct lw_sample_points *points, uint32_t texel,
                                         const struct lw_sample_points_texel *from);
/** Takes all planes from other sample points: before the first lw_sample_points_copy() from them. Returns
 * false without memory. */
LW_MUST_CHECK bool lw_sample_points_take_planes(struct lw_sample_points *points,
                                                const struct lw_sample_points *from);
/** Copies those of a texel behind those that are there, and sets the first one of the next texel. Returns
 * false without memory. */
LW_MUST_CHECK bool lw_sample_points_copy(struct lw_sample_points *points, uint32_t texel,
                                         const struct lw_sample_points *from, uint32_t from_texel);

/** Gives back room for more points; none are packed or copied after it. */
void lw_sample_points_trim(struct lw_sample_points *points);

/** Bytes held, after lw_sample_points_trim(). */
size_t lw_sample_points_memory_bytes(const struct lw_sample_points *points, uint32_t texels);

/** A transform, made ready for many sample points. */
struct lw_sample_points_frame {
    struct lw_affine to_world;
    float normal[3][3];      /* cofactors: turns normals, keeping them outward under mirroring */
    float stretch, offset_m; /* bounds of what it does to coordinates */
};
void lw_sample_points_frame_init(struct lw_sample_points_frame *frame, const struct lw_affine *to_world);

/** Sixteen sample points, structure of arrays. */
struct lw_sample_points_lanes {
    struct lw_points16 at;        /* positions, then origins of rays */
    float gx[16], gy[16], gz[16]; /* normal of the face, unit */
    float lift[16];
};

/** Loads sample points into lanes: offsets in object space, normals still folded.
 * position  the texels' own, of the mesh
 * texel     within the mesh
 * point     of the texel: sample_points.first[texel] and behind it */
void lw_sample_points_load(const struct lw_sample_points *points, float *const position[3],
                           const uint32_t texel[16], const uint32_t point[16],
                           struct lw_sample_points_lanes *lanes);
/** Has what the load of a sample point reads fetched. */
static inline void lw_sample_points_prefetch(const struct lw_sample_points *points, uint32_t texel,
                                             uint32_t point) {
    const uint32_t form = points->form[texel];
    if (form & LW_SAMPLE_POINTS_FLAT)
        __builtin_prefetch(&points->spot[point]);
    else
        __builtin_prefetch(&points->packed[point - form]);
}

/** How far rays start off the surface in world space, m. lift: the same in object space. */
static inline float lw_sample_points_lift_m(const struct lw_sample_points_frame *frame, float lift) {
    return lift * frame->stretch + (LW_TRACE_LIFT * frame->offset_m + 1e-30f);
}

/** Brings loaded lanes to world space and lifts their origins off the surface. */
void lw_sample_points_to_world(const struct lw_sample_points_frame *frame,
                               struct lw_sample_points_lanes *lanes);

/** The mask of all sample points of a texel. */
static inline uint8_t lw_sample_points_all(const struct lw_sample_points *points, uint32_t texel) {
    return (uint8_t)((1u << (points->first[texel + 1] - points->first[texel])) - 1);
}

/** The sample point of a texel that sample number `sample` takes. usable: mask of its sample points, not
 * 0; turn: a random number that changes with sample / 8, so that no sample point always meets the same
 * part of a light's sequence. */
static inline uint32_t lw_sample_points_choose(uint8_t usable, uint32_t sample, uint32_t turn) {
    const uint32_t step = sample + (turn & (LW_SAMPLE_POINTS_MAX - 1));
    if (usable == UINT8_MAX) return step % LW_SAMPLE_POINTS_MAX;
    uint32_t skip = step % (uint32_t)__builtin_popcount(usable), mask = usable;
    while (skip--) mask &= mask - 1;
    return (uint32_t)__builtin_ctz(mask);
}

#endif
