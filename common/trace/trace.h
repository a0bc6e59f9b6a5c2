/* trace.h: rays against the scene. The only user of Embree.
 * Flow:    scene, pose -> [trace] -> hits for the solve, the view and the path tracer
 * Threads: lw_trace_create/set_pose by one thread while nobody traces; closest and occluded [any] in between.
 *
 * Objects that never move are one flattened set of geometry; each object that moves is an instance of its own
 * in a second scene, so that a new pose costs an update of that alone. Rays go through the first, then
 * through the second those that come by a box around movers: the many triangles that stay cost no change of
 * space. An object that the pose calls dynamic for the first time leaves the one for the other, once: that
 * builds what stays anew, at once or in a thread. */
#ifndef LW_COMMON_TRACE_H
#define LW_COMMON_TRACE_H

#include "common/scene/pose.h"
#include "common/scene/scene.h"

#define LW_TRACE_WIDTH 16
#define LW_TRACE_MISS  UINT32_MAX

enum lw_trace_flags {
    /* Light: backs of single-sided surfaces stop the ray (and are black); BLEND surfaces stop it with
     * probability alpha, decided by a hash of ray, surface and the packet's salt. */
    LW_TRACE_LIGHT = 0,
    /* View: backs of single-sided surfaces are not there; every BLEND surface is a hit, for the caller to
     * blend. */
    LW_TRACE_VIEW = 1,
    LW_TRACE_COHERENT = 2 /* the rays of this packet run (nearly) parallel */
};

/** Sixteen rays, structure of arrays. 64-byte aligned. dir need not be unit; t is in units of its length. */
struct lw_ray16 {
    _Alignas(64) float org_x[16];
    float org_y[16], org_z[16];
    float dir_x[16], dir_y[16], dir_z[16];
    float t_near[16], t_far[16];
    /* number of the sample: the same ray with another salt meets another decision of BLEND surfaces */
    uint32_t salt;
};

/** Puts one ray into a packet; it starts at t = 0. */
static inline void lw_trace_set_ray(struct lw_ray16 *rays, uint32_t lane, struct lw_vec3 origin,
                                    struct lw_vec3 direction, float t_far) {
    rays->org_x[lane] = origin.x;
    rays->org_y[lane] = origin.y;
    rays->org_z[lane] = origin.z;
    rays->dir_x[lane] = direction.x;
    rays->dir_y[lane] = direction.y;
    rays->dir_z[lane] = direction.z;
    rays->t_near[lane] = 0;
    rays->t_far[lane] = t_far;
}

/* How far from its surface a light ray starts, in units of the last place of the largest coordinate at hand.
 * Points that are interpolated from a triangle and rays that start there miss that triangle, at any angle,
 * from 3 on: measured for still and moving triangles of 1 mm to 1 km, up to 1 km off the origin; 2 lets 1 ray
 * in 10^5 through, 1 one in 300. */
#define LW_TRACE_LIFT (6.0f * 0x1p-23f)

/** Lifts a point off its surface by more than rounding can move a hit.
 * geometric   unit normal of the face, world space, on the side that is lit
 * largest_m   the largest coordinate, either sign, of the point and of its triangle's corners, in world
 *             space and, times the scale, in object space: what rounding errors grow with. Too large a value
 *             only lifts more. */
static inline struct lw_vec3 lw_trace_lift(struct lw_vec3 point_ws, struct lw_vec3 geometric,
                                           float largest_m) {
    return lw_vec3_mad(point_ws, geometric, LW_TRACE_LIFT * largest_m + 1e-30f);
}

struct lw_hit16 {
    _Alignas(64) float t[16];
    float u[16], v[16];    /* barycentrics of the 2nd and 3rd vertex */
    uint32_t object[16];   /* LW_TRACE_MISS: nothing hit, the other fields are undefined */
    uint32_t triangle[16]; /* of the object's mesh */
    uint8_t back[16];      /* 1: met from behind (by winding, mirroring accounted for) */
};

struct lw_trace;

/** Checks LW_TRACE_ISA as lw_trace_create() does, before the work that leads there. [any] */
LW_MUST_CHECK enum lw_status lw_trace_check_isa(struct lw_error *err);

/** Builds the acceleration structure. scene must outlive it.
 * Same scene and pose: same structure, whatever the machine's thread count.
 * LW_TRACE_ISA in the environment (sse4.2, avx2, avx512) chooses the kernels' instruction set; without it
 * they use the best that the processor has.
 * Errors: LW_NO_MEMORY; LW_INTERNAL with Embree's message; of LW_TRACE_ISA: LW_USAGE for another name,
 * LW_UNAVAILABLE for a
 *         set that the processor lacks. */
LW_MUST_CHECK enum lw_status lw_trace_create(const struct lw_scene *scene, const struct lw_pose *pose,
                                             struct lw_trace **out_trace, struct lw_error *err);
void lw_trace_destroy(struct lw_trace *trace);

/** Moves the objects that move, hides and shows. Objects that have become dynamic since the pose before are
 * made movers, at the price of building what stays anew. Where an object is neither dynamic nor animated its
 * transform and whether it is hidden are not looked at.
 * Errors: LW_NO_MEMORY; LW_INTERNAL with Embree's message; then only lw_trace_destroy() makes sense. */
LW_MUST_CHECK enum lw_status lw_trace_set_pose(struct lw_trace *trace, const struct lw_pose *pose,
                                               struct lw_error *err);

/** The same, but what stays is built anew in a thread, so that an object's first movement takes no longer
 * than others. Until lw_trace_settle() takes what has been built, rays pass what has left, and cost more;
 * what they meet is the same. */
LW_MUST_CHECK enum lw_status lw_trace_set_pose_soon(struct lw_trace *trace, const struct lw_pose *pose,
                                                    struct lw_error *err);

/** Takes what a thread has built, if it has ended. wait: waits for it. Threads and errors as for
 * lw_trace_set_pose(). */
LW_MUST_CHECK enum lw_status lw_trace_settle(struct lw_trace *trace, bool wait, struct lw_error *err);

/** Closest hits of the rays whose bit is set in `active`; lanes that are not active become misses. */
void lw_trace_closest16(const struct lw_trace *trace, unsigned flags, uint16_t active,
                        const struct lw_ray16 *rays, struct lw_hit16 *out_hits);

/** Bit i set: something lies between t_near and t_far of active ray i. */
uint16_t lw_trace_occluded16(const struct lw_trace *trace, unsigned flags, uint16_t active,
                             const struct lw_ray16 *rays);

/** The instruction set that Embree took: "sse2", "sse4.2", "avx", "avx2", "avx512"; "native" on other
 * processors than x86-64. [any] */
const char *lw_trace_isa(const struct lw_trace *trace);

/** Bytes that Embree holds. [any] */
size_t lw_trace_memory_bytes(const struct lw_trace *trace);

#endif
