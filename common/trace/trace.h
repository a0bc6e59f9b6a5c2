/* trace.h: rays against the scene. The only user of Embree.
 * Flow:    scene, pose -> [trace] -> hits for the solve, the view and the path tracer
 * Threads: lw_trace_create/set_pose by one thread while nobody traces; closest and occluded [any] in between.
 *
 * Static objects are one flattened scene. Each moving object is an instance in a second scene, so a new pose
 * updates that scene only. Every ray is traced through the first scene. Only rays that pass a box around
 * moving objects are traced through the second. An object that the pose calls dynamic for the first time
 * moves from the first scene to the second. Then the first scene is built again, at once or in a thread. */
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
    /* View: rays pass backs of single-sided surfaces; every BLEND surface is a hit, for the caller to
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
    /* number of the sample: it enters the hash that decides whether a BLEND surface stops the ray */
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

/* Distance from its surface at which a light ray starts, in units of the last place of the largest
 * coordinate. From 3 on no ray hits the triangle it starts on, at any angle: measured for static and moving
 * triangles of 1 mm to 1 km, up to 1 km from the origin. With 2, one ray in 10^5 does; with 1, one in 300. */
#define LW_TRACE_LIFT (6.0f * 0x1p-23f)
/** Share of the way to a point on a surface that has to be free: the surface itself would be in the way. */
#define LW_TRACE_SHORT 0.9999f

/** Lifts a point off its surface by more than rounding can move a hit.
 * geometric   unit normal of the face, world space, on the side that is lit
 * largest_m   the largest coordinate, either sign, of the point and of its triangle's corners, in world
 *             space and, times the scale, in object space: rounding errors grow with it. Too large a value
 *             only lifts more. */
static inline struct lw_vec3 lw_trace_lift(struct lw_vec3 point_ws, struct lw_vec3 geometric,
                                           float largest_m) {
    return lw_vec3_mad(point_ws, geometric, LW_TRACE_LIFT * largest_m + 1e-30f);
}

struct lw_hit16 {
    _Alignas(64) float t[16];
    float u[16], v[16];    /* barycentrics of the 2nd and 3rd vertex */
    uint32_t object[16];   /* LW_TRACE_MISS: nothing hit, the other fields are undefined */
    uint32_t triangle[16]; /* in the object's mesh */
    uint8_t back[16];      /* 1: met from behind (by winding, mirroring accounted for) */
};

/** Surfaces that one ray meets, in their order (lw_trace_through16()). */
#define LW_TRACE_THROUGH_MAX 12u
struct lw_trace_through {
    uint32_t count;
    struct lw_trace_met {
        float t;
        uint32_t object, triangle;
        bool back;
    } met[LW_TRACE_THROUGH_MAX];
};

struct lw_trace;

/** Checks LW_TRACE_ISA as lw_trace_create() does, before the work that leads there. *out_isa: what
 * lw_trace_isa() will say. [any] */
LW_MUST_CHECK enum lw_status lw_trace_check_isa(const char **out_isa, struct lw_error *err);

/** Builds the acceleration structure. scene must outlive it. The structure depends on scene and pose only,
 * not on the thread count. LW_TRACE_ISA in the environment (sse4.2, avx2, avx512) chooses the kernels'
 * instruction set; without it they use the best that the processor has.
 * Errors: LW_NO_MEMORY; LW_INTERNAL with Embree's message; of LW_TRACE_ISA: LW_USAGE for another name,
 * LW_UNAVAILABLE for a set that the processor lacks. */
LW_MUST_CHECK enum lw_status lw_trace_create(const struct lw_scene *scene, const struct lw_pose *pose,
                                             struct lw_trace **out_trace, struct lw_error *err);
void lw_trace_destroy(struct lw_trace *trace);

/** Applies transforms and visibility of a pose. An object that has become dynamic moves to the second scene,
 * and the first scene is built again. Transform and visibility of an object that is neither dynamic nor
 * animated are ignored.
 * Errors: LW_NO_MEMORY; LW_INTERNAL with Embree's message; then only lw_trace_destroy() may follow. */
LW_MUST_CHECK enum lw_status lw_trace_set_pose(struct lw_trace *trace, const struct lw_pose *pose,
                                               struct lw_error *err);

/** The same, but a thread builds the first scene again, so that an object's first movement takes no longer
 * than later ones. Until lw_trace_take_rebuilt() takes the new scene, a filter makes rays ignore the objects
 * that left the old one. Hits are the same; rays cost more. */
LW_MUST_CHECK enum lw_status lw_trace_set_pose_soon(struct lw_trace *trace, const struct lw_pose *pose,
                                                    struct lw_error *err);

/** Takes the scene that the thread has built, if it has ended. wait: waits for it. Threads and errors as for
 * lw_trace_set_pose(). */
LW_MUST_CHECK enum lw_status lw_trace_take_rebuilt(struct lw_trace *trace, bool wait, struct lw_error *err);

/** The material that a ray has met. It must have met something. */
static inline const struct lw_material *lw_trace_material(const struct lw_scene *scene,
                                                          const struct lw_hit16 *hits, uint32_t lane) {
    const struct lw_mesh *mesh = &scene->mesh[scene->object[hits->object[lane]].mesh];
    return &scene->material[mesh->material[hits->triangle[lane]]];
}

/** Closest hits of the rays whose bit is set in `active`; lanes that are not active become misses. */
void lw_trace_closest16(const struct lw_trace *trace, unsigned flags, uint16_t active,
                        const struct lw_ray16 *rays, struct lw_hit16 *out_hits);

/** The first LW_TRACE_THROUGH_MAX hits of each active ray: the closest one of light, then the closest one
 * that lies `gap` or more behind that, and so on. It costs less than as many calls of lw_trace_closest16().
 * A front that BLEND lets a ray pass takes no place of a back behind it.
 * gap   per ray, in units of t
 * out   per ray; of rays that are not active nothing is written */
void lw_trace_through16(const struct lw_trace *trace, uint16_t active, const struct lw_ray16 *rays,
                        const float gap[16], struct lw_trace_through out[16]);

/** Bit i set: something lies between t_near and t_far of active ray i. */
uint16_t lw_trace_occluded16(const struct lw_trace *trace, unsigned flags, uint16_t active,
                             const struct lw_ray16 *rays);

/** The same for light on its way: out_tint[c][i] is the factor of channel c for ray i, by the tints of the
 * BLEND surfaces that let it pass, 1 where there is none. It leaves out the light that they stop. */
uint16_t lw_trace_tinted16(const struct lw_trace *trace, unsigned flags, uint16_t active,
                           const struct lw_ray16 *rays, float out_tint[3][16]);

/** Whether any surface of the scene has a tint; without one lw_trace_tinted16() gives 1. [any] */
bool lw_trace_tints(const struct lw_trace *trace);

/** The instruction set that Embree took: "sse2", "sse4.2", "avx", "avx2", "avx512"; "native" on other
 * processors than x86-64. [any] */
const char *lw_trace_isa(const struct lw_trace *trace);

/** Bytes that Embree holds. [any] */
size_t lw_trace_memory_bytes(const struct lw_trace *trace);

#endif
