#include "common/trace/trace.h"

#include "common/base/box.h"
#include "common/base/random.h"
#include "common/base/wide.h"
#include "common/trace/trace_context.h"
#include "common/trace/trace_isa.h"
#include "common/trace/trace_positions.h"

#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

/* All hits of one ray, the closest first. */
#define FOUND_MAX 32u
struct found {
    uint32_t count; /* more than FOUND_MAX: there are more */
    struct lw_trace_met met[FOUND_MAX];
};

/* Data of a geometry for filters. */
struct geometry {
    const struct lw_scene *scene;
    const struct lw_mesh *mesh;
    uint32_t object;
    bool mirrored; /* vertices were flattened through a mirroring transform: winding is reversed */
    bool has_alpha;
};

struct mover {
    uint32_t object;
    RTCScene scene;       /* the object alone, in object space */
    RTCGeometry instance; /* in the moving scene */
    bool hidden;          /* the instance is disabled */
    float facing[3][3];   /* sign(facing * Ng . dir) in world space tells front from back */
    struct lw_box box_os;
    struct lw_box box_ws; /* with room for rounding */
};

/* At most this many boxes enclose the moving objects; a ray that misses them all is not traced through the
 * second scene. More boxes cost every ray more than they save. */
#define BOXES_MAX 8u

/* The first scene, built again without the objects that left it. */
struct rebuild {
    pthread_t thread;
    RTCDevice device;
    RTCScene scene;
    enum RTCError error; /* Embree keeps one for each thread */
    atomic_bool ended;
};

struct lw_trace {
    const struct lw_scene *scene;
    RTCDevice device;
    RTCScene fixed;          /* the static objects, in world space */
    bool *left;              /* per object: it is a mover, but `fixed` has it still */
    struct rebuild *rebuild; /* while any is; else NULL */
    RTCScene moving;         /* an instance for each object that moves; NULL if none does */
    struct geometry *geometry;
    struct lw_trace_positions *positions; /* per mesh */
    uint32_t *mover_of_object;
    struct mover *mover;
    uint32_t mover_count;
    struct lw_box box[BOXES_MAX]; /* where movers are now */
    uint32_t box_count;
    bool tints; /* a material of the scene does */
    _Atomic int64_t memory_bytes;
};

static bool count_memory(void *user, ssize_t bytes, bool post) {
    (void)post;
    struct lw_trace *trace = user;
    trace->memory_bytes += bytes;
    return true;
}

static const struct lw_material *material_of(const struct geometry *g, uint32_t triangle) {
    return &g->scene->material[g->mesh->material[triangle]];
}

/* Embree's packets of runtime width are rows of `n` floats or words each; its own accessors are for C++
 * only. */
enum {
    RAY_ORG_X,
    RAY_ORG_Y,
    RAY_ORG_Z,
    RAY_DIR_X = 4,
    RAY_DIR_Y,
    RAY_DIR_Z,
    RAY_LANE, /* Embree's time, which nothing here moves by: the lane, in sixteenths */
    RAY_FAR,
    RAY_SALT = 10
};
enum { HIT_NG_X, HIT_NG_Y, HIT_NG_Z, HIT_U, HIT_V, HIT_TRIANGLE };

static float lane(const void *rows, unsigned row, unsigned n, unsigned i) {
    return ((const float *)rows)[row * n + i];
}
static uint32_t lane_word(const void *rows, unsigned row, unsigned n, unsigned i) {
    return ((const uint32_t *)rows)[row * n + i];
}

/* A number in [0, 1) that hangs on ray, surface and salt alone: never on the other rays of the packet. */
static float blend_choice(const struct geometry *g, const struct RTCRayN *rays, uint32_t triangle, unsigned n,
                          unsigned i) {
    uint32_t ray = 0;
    for (unsigned row = RAY_ORG_X; row <= RAY_ORG_Z; row++) {
        ray = lw_random_hash2(ray, lane_word(rays, row, n, i));
        ray = lw_random_hash2(ray, lane_word(rays, row + RAY_DIR_X, n, i));
    }
    return lw_random_unit(lw_random_hash4(ray, triangle, g->object, lane_word(rays, RAY_SALT, n, i)));
}

/* A filter may be given other packets than the caller's: the ray knows its lane. */
static void tint(const struct lw_trace_context *context, const struct lw_material *material,
                 const struct RTCRayN *rays, unsigned n, unsigned i) {
    const unsigned at = (unsigned)(16 * lane(rays, RAY_LANE, n, i));
    for (int c = 0; c < 3; c++) context->tint[c][at] *= material->tint[c];
}

/* Whether a surface point lets the ray pass: cut out by its mask, or transparent. */
static bool passes_alpha(const struct geometry *g, const struct lw_trace_context *context,
                         const struct RTCFilterFunctionNArguments *args, uint32_t triangle, unsigned i) {
    const struct lw_material *material = material_of(g, triangle);
    if (material->alpha_mode == LW_ALPHA_OPAQUE) return false;
    if (material->alpha_mode == LW_ALPHA_BLEND && (context->flags & LW_TRACE_VIEW)) return false;
    float alpha = lw_scene_alpha(g->scene, g->mesh, triangle, lane(args->hit, HIT_U, args->N, i),
                                 lane(args->hit, HIT_V, args->N, i));
    if (material->alpha_mode == LW_ALPHA_MASK) return alpha < material->alpha_cutoff;
    if (blend_choice(g, args->ray, triangle, args->N, i) < alpha) return false;
    if (context->tint && lw_material_tints(material)) tint(context, material, args->ray, args->N, i);
    return true;
}

/* Called for hits on geometry with alpha (all rays) and, as the context's filter, for every hit of view rays
 * that may meet backs. Ray and normal are both in the geometry's own space here, so their signs need no
 * transform. */
static void filter(const struct RTCFilterFunctionNArguments *args) {
    const struct geometry *g = args->geometryUserPtr;
    const struct lw_trace_context *context = (const struct lw_trace_context *)args->context;
    const bool cull = context->flags & LW_TRACE_VIEW;
    const unsigned n = args->N;
    for (unsigned i = 0; i < n; i++) {
        if (args->valid[i] != -1) continue;
        if (context->left && context->left[g->object]) {
            args->valid[i] = 0;
            continue;
        }
        uint32_t triangle = lane_word(args->hit, HIT_TRIANGLE, n, i);
        float dx = lane(args->ray, RAY_DIR_X, n, i), dy = lane(args->ray, RAY_DIR_Y, n, i),
              dz = lane(args->ray, RAY_DIR_Z, n, i);
        if (cull && !material_of(g, triangle)->double_sided) {
            float facing = dx * lane(args->hit, HIT_NG_X, n, i) + dy * lane(args->hit, HIT_NG_Y, n, i) +
                           dz * lane(args->hit, HIT_NG_Z, n, i);
            if ((facing > 0) != g->mirrored) {
                args->valid[i] = 0;
                continue;
            }
        }
        if (g->has_alpha && passes_alpha(g, context, args, triangle, i)) args->valid[i] = 0;
    }
}

/* Inserts a hit in front of farther ones. Hits at one distance keep the order in which Embree finds them. */
static void insert(struct found *found, struct lw_trace_met met) {
    if (found->count++ >= FOUND_MAX) return;
    uint32_t at = found->count - 1;
    for (; at > 0 && found->met[at - 1].t > met.t; at--) found->met[at] = found->met[at - 1];
    found->met[at] = met;
}

/* Notes a hit and lets the ray pass. Embree calls it after the geometry's own filter. */
static void note_hits(const struct RTCFilterFunctionNArguments *args) {
    const struct geometry *g = args->geometryUserPtr;
    const struct lw_trace_context *context = (const struct lw_trace_context *)args->context;
    const unsigned n = args->N;
    for (unsigned i = 0; i < n; i++) {
        if (args->valid[i] != -1) continue;
        args->valid[i] = 0;
        if (context->left && context->left[g->object]) continue;
        float facing = 0;
        for (unsigned c = 0; c < 3; c++)
            facing += lane(args->ray, RAY_DIR_X + c, n, i) * lane(args->hit, HIT_NG_X + c, n, i);
        insert(&context->found[(unsigned)(16 * lane(args->ray, RAY_LANE, n, i))],
               (struct lw_trace_met){.t = lane(args->ray, RAY_FAR, n, i),
                                     .object = g->object,
                                     .triangle = lane_word(args->hit, HIT_TRIANGLE, n, i),
                                     .back = (facing > 0) != g->mirrored});
    }
}

/* every_hit: whether backs are left out on geometry without alpha, too. */
static void init_context(struct lw_trace_context *context, const bool *left, unsigned flags, bool every_hit) {
    rtcInitIntersectContext(&context->rtc);
    context->flags = flags;
    context->left = left;
    context->tint = NULL;
    context->found = NULL;
    if (flags & LW_TRACE_COHERENT) context->rtc.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
    if (every_hit || left) context->rtc.filter = filter;
}

/* Objects that rays through `fixed` leave out. */
static const bool *left_of(const struct lw_trace *trace) { return trace->rebuild ? trace->left : NULL; }

static bool mesh_has_alpha(const struct lw_scene *scene, const struct lw_mesh *mesh) {
    for (uint32_t t = 0; t < mesh->triangle_count; t++)
        if (scene->material[mesh->material[t]].alpha_mode != LW_ALPHA_OPAQUE) return true;
    return false;
}

/* One object's triangles, its vertices moved through a transform. */
static enum lw_status attach_object(struct lw_trace *trace, RTCScene into, uint32_t object,
                                    const struct lw_affine *transform) {
    const struct lw_mesh *mesh = &trace->scene->mesh[trace->scene->object[object].mesh];
    const struct lw_trace_positions *distinct = &trace->positions[trace->scene->object[object].mesh];
    const uint32_t count = distinct->count ? distinct->count : mesh->vertex_count;
    RTCGeometry geometry = rtcNewGeometry(trace->device, RTC_GEOMETRY_TYPE_TRIANGLE);
    if (!geometry) return LW_NO_MEMORY;
    struct lw_vec3 *position = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                                       sizeof *position, count);
    if (!position) {
        rtcReleaseGeometry(geometry);
        return LW_NO_MEMORY;
    }
    const void *triangle = distinct->count ? (const void *)distinct->triangle : mesh->triangle;
    rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, triangle, 0,
                               sizeof *mesh->triangle, mesh->triangle_count);
    for (uint32_t i = 0; i < count; i++)
        position[i] = lw_affine_point(transform, mesh->position[distinct->count ? distinct->vertex[i] : i]);

    struct geometry *g = &trace->geometry[object];
    *g = (struct geometry){.scene = trace->scene,
                           .mesh = mesh,
                           .object = object,
                           .mirrored = lw_affine_determinant(transform) < 0,
                           .has_alpha = mesh_has_alpha(trace->scene, mesh)};
    rtcSetGeometryUserData(geometry, g);
    if (g->has_alpha) {
        rtcSetGeometryIntersectFilterFunction(geometry, filter);
        rtcSetGeometryOccludedFilterFunction(geometry, filter);
    }
    rtcCommitGeometry(geometry);
    rtcAttachGeometryByID(into, geometry, object);
    rtcReleaseGeometry(geometry);
    return LW_OK;
}

static RTCScene new_scene(struct lw_trace *trace) {
    RTCScene scene = rtcNewScene(trace->device);
    /* Robust: rays through shared edges must not slip out of a closed room. */
    if (scene) rtcSetSceneFlags(scene, RTC_SCENE_FLAG_ROBUST | RTC_SCENE_FLAG_CONTEXT_FILTER_FUNCTION);
    return scene;
}

static struct lw_box box_of_mesh(const struct lw_mesh *mesh) {
    struct lw_box box = LW_BOX_EMPTY;
    for (uint32_t i = 0; i < mesh->vertex_count; i++) lw_box_add_point(&box, mesh->position[i]);
    return box;
}

/* Room on all sides: far more than Embree rounds by on the way into the instance's space and back, far less
 * than a mover. */
static struct lw_box box_with_room(struct lw_box box) {
    struct lw_vec3 most = lw_vec3_max(lw_vec3_max(box.high, lw_vec3_scale(box.low, -1)), lw_box_size(&box));
    float room = 1e-4f * fmaxf(most.x, fmaxf(most.y, most.z)) + 1e-20f;
    struct lw_vec3 by = lw_vec3(room, room, room);
    return (struct lw_box){lw_vec3_sub(box.low, by), lw_vec3_add(box.high, by)};
}

static void place_mover(struct mover *mover, const struct lw_pose *pose) {
    const struct lw_affine *t = &pose->object_to_world[mover->object];
    const bool hidden = pose->object_hidden[mover->object];
    if (hidden && !mover->hidden) rtcDisableGeometry(mover->instance);
    if (!hidden && mover->hidden) rtcEnableGeometry(mover->instance);
    mover->hidden = hidden;
    mover->box_ws = box_with_room(lw_box_moved(t, &mover->box_os));
    rtcSetGeometryTransform(mover->instance, 0, RTC_FORMAT_FLOAT3X4_ROW_MAJOR, t->m);
    rtcCommitGeometry(mover->instance);
    /* Ng . (M^-1 d) has the sign of (cofactors(M) Ng) . d times that of det M. */
    struct lw_vec3 x = lw_vec3(t->m[0][0], t->m[1][0], t->m[2][0]),
                   y = lw_vec3(t->m[0][1], t->m[1][1], t->m[2][1]),
                   z = lw_vec3(t->m[0][2], t->m[1][2], t->m[2][2]);
    float sign = lw_affine_determinant(t) < 0 ? -1.0f : 1.0f;
    const struct lw_vec3 column[3] = {lw_vec3_cross(y, z), lw_vec3_cross(z, x), lw_vec3_cross(x, y)};
    for (int j = 0; j < 3; j++) {
        mover->facing[0][j] = sign * column[j].x;
        mover->facing[1][j] = sign * column[j].y;
        mover->facing[2][j] = sign * column[j].z;
    }
}

/* More movers than boxes share them in the scene's order, where neighbours are mostly together. */
static void box_movers(struct lw_trace *trace) {
    uint32_t count = 0, n = 0;
    for (uint32_t i = 0; i < trace->mover_count; i++) count += !trace->mover[i].hidden;
    trace->box_count = count < BOXES_MAX ? count : BOXES_MAX;
    for (uint32_t b = 0; b < trace->box_count; b++) trace->box[b] = LW_BOX_EMPTY;
    for (uint32_t i = 0; i < trace->mover_count; i++) {
        if (trace->mover[i].hidden) continue;
        lw_box_add(&trace->box[(uint64_t)n++ * trace->box_count / count], &trace->mover[i].box_ws);
    }
}

static enum lw_status attach_mover(struct lw_trace *trace, struct mover *mover, const struct lw_pose *pose) {
    if (!trace->moving && !(trace->moving = new_scene(trace))) return LW_NO_MEMORY;
    mover->scene = new_scene(trace);
    if (!mover->scene) return LW_NO_MEMORY;
    enum lw_status status = attach_object(trace, mover->scene, mover->object, &LW_AFFINE_IDENTITY);
    if (status != LW_OK) return status;
    mover->box_os = box_of_mesh(&trace->scene->mesh[trace->scene->object[mover->object].mesh]);
    rtcCommitScene(mover->scene);
    mover->instance = rtcNewGeometry(trace->device, RTC_GEOMETRY_TYPE_INSTANCE);
    if (!mover->instance) return LW_NO_MEMORY;
    rtcSetGeometryInstancedScene(mover->instance, mover->scene);
    rtcSetGeometryTimeStepCount(mover->instance, 1);
    place_mover(mover, pose);
    rtcAttachGeometryByID(trace->moving, mover->instance, mover->object);
    return LW_OK;
}

static enum lw_status device_status(const struct lw_trace *trace, struct lw_error *err) {
    enum RTCError code = rtcGetDeviceError(trace->device);
    if (code == RTC_ERROR_NONE) return LW_OK;
    if (code == RTC_ERROR_OUT_OF_MEMORY)
        return lw_status_fail(err, LW_NO_MEMORY, "building the rays' structure");
    return lw_status_fail(err, LW_INTERNAL, "Embree reports error %d", (int)code);
}

static enum lw_status build(struct lw_trace *trace, const struct lw_pose *pose) {
    const struct lw_scene *scene = trace->scene;
    trace->fixed = new_scene(trace);
    if (!trace->fixed) return LW_NO_MEMORY;
    for (uint32_t object = 0; object < scene->object_count; object++) {
        trace->mover_of_object[object] = UINT32_MAX;
        if (lw_pose_object_moves(pose, scene, object)) {
            trace->mover_of_object[object] = trace->mover_count;
            trace->mover[trace->mover_count++].object = object;
            continue;
        }
        enum lw_status status = attach_object(trace, trace->fixed, object, &pose->object_to_world[object]);
        if (status != LW_OK) return status;
    }
    rtcCommitScene(trace->fixed);
    for (uint32_t i = 0; i < trace->mover_count; i++) {
        enum lw_status status = attach_mover(trace, &trace->mover[i], pose);
        if (status != LW_OK) return status;
    }
    box_movers(trace);
    if (trace->moving) rtcCommitScene(trace->moving);
    return LW_OK;
}

static void *rebuild_in_thread(void *argument) {
    struct rebuild *rebuild = argument;
    rtcCommitScene(rebuild->scene);
    rebuild->error = rtcGetDeviceError(rebuild->device);
    rebuild->ended = true;
    return NULL;
}

static void rebuild_destroy(struct rebuild *rebuild) {
    if (!rebuild) return;
    if (rebuild->scene) rtcReleaseScene(rebuild->scene);
    free(rebuild);
}

/* NULL: there is no memory, or no thread. */
static struct rebuild *rebuild_start(struct lw_trace *trace) {
    struct rebuild *rebuild = calloc(1, sizeof *rebuild);
    if (!rebuild) return NULL;
    rebuild->device = trace->device;
    rebuild->scene = new_scene(trace);
    for (uint32_t object = 0; rebuild->scene && object < trace->scene->object_count; object++)
        if (trace->mover_of_object[object] == UINT32_MAX)
            rtcAttachGeometryByID(rebuild->scene, rtcGetGeometry(trace->fixed, object), object);
    if (rebuild->scene && pthread_create(&rebuild->thread, NULL, rebuild_in_thread, rebuild) == 0)
        return rebuild;
    rebuild_destroy(rebuild);
    return NULL;
}

/* Waits for the rebuild in progress, and takes it. */
static enum lw_status take_rebuild(struct lw_trace *trace) {
    struct rebuild *rebuild = trace->rebuild;
    if (!rebuild) return LW_OK;
    trace->rebuild = NULL;
    memset(trace->left, 0, trace->scene->object_count * sizeof *trace->left);
    pthread_join(rebuild->thread, NULL);
    rtcReleaseScene(trace->fixed);
    trace->fixed = rebuild->scene;
    rebuild->scene = NULL;
    const enum RTCError error = rebuild->error;
    rebuild_destroy(rebuild);
    return error == RTC_ERROR_NONE ? LW_OK : error == RTC_ERROR_OUT_OF_MEMORY ? LW_NO_MEMORY : LW_INTERNAL;
}

static bool becomes_mover(const struct lw_trace *trace, const struct lw_pose *pose, uint32_t object) {
    return trace->mover_of_object[object] == UINT32_MAX && pose->object_dynamic[object];
}

/* Objects that have become dynamic. */
static enum lw_status free_objects(struct lw_trace *trace, const struct lw_pose *pose, bool later) {
    const uint32_t before = trace->mover_count, objects = trace->scene->object_count;
    enum lw_status status = LW_OK;
    for (uint32_t object = 0; object < objects && status == LW_OK; object++)
        if (becomes_mover(trace, pose, object)) status = take_rebuild(trace); /* for earlier movers */
    for (uint32_t object = 0; object < objects && status == LW_OK; object++) {
        if (!becomes_mover(trace, pose, object)) continue;
        struct mover *mover = &trace->mover[trace->mover_count];
        mover->object = object;
        trace->mover_of_object[object] = trace->mover_count++;
        trace->left[object] = true;
        status = attach_mover(trace, mover, pose);
    }
    if (status != LW_OK || trace->mover_count == before) return status;
    if (later && (trace->rebuild = rebuild_start(trace))) return LW_OK;
    for (uint32_t object = 0; object < objects; object++) {
        if (trace->left[object]) rtcDetachGeometry(trace->fixed, object);
        trace->left[object] = false;
    }
    rtcCommitScene(trace->fixed);
    return LW_OK;
}

enum lw_status lw_trace_check_isa(const char **out_isa, struct lw_error *err) {
    RTCDevice device;
    enum lw_status status = lw_trace_isa_open(&device, err);
    if (status != LW_OK) return status;
    *out_isa = lw_trace_isa_of(device);
    rtcReleaseDevice(device);
    return LW_OK;
}

enum lw_status lw_trace_create(const struct lw_scene *scene, const struct lw_pose *pose,
                               struct lw_trace **out_trace, struct lw_error *err) {
    struct lw_trace *trace = calloc(1, sizeof *trace);
    if (!trace) return lw_status_fail(err, LW_NO_MEMORY, "building the rays' structure");
    trace->scene = scene;
    for (uint32_t m = 0; m < scene->material_count; m++)
        trace->tints |= lw_material_tints(&scene->material[m]);
    const size_t count = scene->object_count ? scene->object_count : 1;
    trace->geometry = calloc(count, sizeof *trace->geometry);
    trace->mover_of_object = calloc(count, sizeof *trace->mover_of_object);
    trace->mover = calloc(count, sizeof *trace->mover);
    trace->left = calloc(count, sizeof *trace->left);
    enum lw_status status = LW_NO_MEMORY;
    if (!trace->geometry || !trace->mover_of_object || !trace->mover || !trace->left ||
        lw_trace_positions_list(scene, &trace->positions) != LW_OK) {
        lw_status_fail(err, status, "building the rays' structure");
        goto fail;
    }
    status = lw_trace_isa_open(&trace->device, err);
    if (status != LW_OK) goto fail;
    rtcSetDeviceMemoryMonitorFunction(trace->device, count_memory, trace);
    status = build(trace, pose);
    if (status != LW_OK) {
        lw_status_fail(err, status, "building the rays' structure");
        goto fail;
    }
    status = device_status(trace, err);
    if (status != LW_OK) goto fail;
    *out_trace = trace;
    return LW_OK;
fail:
    lw_trace_destroy(trace);
    return status;
}

void lw_trace_destroy(struct lw_trace *trace) {
    if (!trace) return;
    (void)take_rebuild(trace);
    for (uint32_t i = 0; trace->mover && i < trace->mover_count; i++) {
        if (trace->mover[i].instance) rtcReleaseGeometry(trace->mover[i].instance);
        if (trace->mover[i].scene) rtcReleaseScene(trace->mover[i].scene);
    }
    if (trace->moving) rtcReleaseScene(trace->moving);
    if (trace->fixed) rtcReleaseScene(trace->fixed);
    if (trace->device) rtcReleaseDevice(trace->device);
    lw_trace_positions_free(trace->positions, trace->scene);
    free(trace->left);
    free(trace->mover);
    free(trace->mover_of_object);
    free(trace->geometry);
    free(trace);
}

static enum lw_status take_pose(struct lw_trace *trace, const struct lw_pose *pose, bool later,
                                struct lw_error *err) {
    enum lw_status status = free_objects(trace, pose, later);
    if (status != LW_OK) return lw_status_fail(err, status, "building the rays' structure");
    if (trace->mover_count == 0) return LW_OK;
    for (uint32_t i = 0; i < trace->mover_count; i++) place_mover(&trace->mover[i], pose);
    box_movers(trace);
    rtcCommitScene(trace->moving);
    return device_status(trace, err);
}

enum lw_status lw_trace_set_pose(struct lw_trace *trace, const struct lw_pose *pose, struct lw_error *err) {
    enum lw_status status = lw_trace_take_rebuilt(trace, true, err);
    return status == LW_OK ? take_pose(trace, pose, false, err) : status;
}

enum lw_status lw_trace_set_pose_soon(struct lw_trace *trace, const struct lw_pose *pose,
                                      struct lw_error *err) {
    return take_pose(trace, pose, true, err);
}

enum lw_status lw_trace_take_rebuilt(struct lw_trace *trace, bool wait, struct lw_error *err) {
    if (!trace->rebuild || !(wait || trace->rebuild->ended)) return LW_OK;
    enum lw_status status = take_rebuild(trace);
    return status == LW_OK ? LW_OK : lw_status_fail(err, status, "building the rays' structure");
}

/* The end of a ray that meets nothing. Where packets of sixteen are not native, Embree 3.13 never reads
 * `valid`: it traces each lane whose ray ends at its beginning or later, and stops at an invalid one
 * (filterSOA of its kernels/bvh/bvh_intersector_stream_filters.cpp, which fills packets up with such rays
 * itself). */
#define EMPTY_FAR (-INFINITY)

static void load_rays(struct RTCRay16 *dst, const struct lw_ray16 *src, uint16_t active) {
    memcpy(dst->org_x, src->org_x, sizeof dst->org_x);
    memcpy(dst->org_y, src->org_y, sizeof dst->org_y);
    memcpy(dst->org_z, src->org_z, sizeof dst->org_z);
    memcpy(dst->dir_x, src->dir_x, sizeof dst->dir_x);
    memcpy(dst->dir_y, src->dir_y, sizeof dst->dir_y);
    memcpy(dst->dir_z, src->dir_z, sizeof dst->dir_z);
    memcpy(dst->tnear, src->t_near, sizeof dst->tnear);
    memcpy(dst->tfar, src->t_far, sizeof dst->tfar);
    for (int i = 0; i < 16; i++) dst->time[i] = (float)i / 16;
    memset(dst->mask, 0xff, sizeof dst->mask);
    memset(dst->flags, 0, sizeof dst->flags);
    for (int i = 0; i < 16; i++) dst->id[i] = src->salt;
    for (uint16_t rest = (uint16_t)~active; rest; rest &= (uint16_t)(rest - 1)) {
        const int i = __builtin_ctz(rest);
        dst->org_x[i] = dst->org_y[i] = dst->org_z[i] = dst->dir_x[i] = dst->dir_y[i] = 0;
        dst->dir_z[i] = 1;
        dst->tnear[i] = 0;
        dst->tfar[i] = EMPTY_FAR;
    }
}

static void empty_rest(const int valid[16], float tfar[16]) {
    for (int i = 0; i < 16; i++) tfar[i] = valid[i] ? tfar[i] : EMPTY_FAR;
}

static void load_valid(int valid[16], uint16_t active) {
    for (int i = 0; i < 16; i++) valid[i] = active >> i & 1 ? -1 : 0;
}

/* Where the slabs of one axis begin and end; plain comparisons, which compilers make vectors of. */
LW_WIDE_INLINE void clip_to_slab(const float org[16], const float dir[16], float low, float high,
                                 float enter[16], float leave[16]) {
    for (int i = 0; i < 16; i++) {
        /* finite, so that 0 * infinity never comes up */
        float d = fabsf(dir[i]) > 1e-30f ? dir[i] : 1e-30f, inverse = 1 / d;
        float a = (low - org[i]) * inverse, b = (high - org[i]) * inverse;
        float first = a < b ? a : b, second = a < b ? b : a;
        enter[i] = enter[i] > first ? enter[i] : first;
        leave[i] = leave[i] < second ? leave[i] : second;
    }
}

/* Leaves those rays valid that reach a box of movers before they end; whether any does. */
LW_WIDE static bool reach_movers(const struct lw_trace *trace, const struct RTCRay16 *ray, int valid[16]) {
    int reach[16] = {0}, any = 0;
    for (uint32_t b = 0; b < trace->box_count; b++) {
        const struct lw_box *box = &trace->box[b];
        float enter[16], leave[16];
        memcpy(enter, ray->tnear, sizeof enter);
        memcpy(leave, ray->tfar, sizeof leave);
        clip_to_slab(ray->org_x, ray->dir_x, box->low.x, box->high.x, enter, leave);
        clip_to_slab(ray->org_y, ray->dir_y, box->low.y, box->high.y, enter, leave);
        clip_to_slab(ray->org_z, ray->dir_z, box->low.z, box->high.z, enter, leave);
        for (int i = 0; i < 16; i++) reach[i] |= enter[i] <= leave[i] ? -1 : 0;
    }
    for (int i = 0; i < 16; i++) any |= valid[i] &= reach[i];
    return any != 0;
}

/* For an object that moves: its normal is still in its own space. */
static bool mover_from_behind(const struct mover *mover, const struct RTCRayHit16 *rh, int i) {
    float nx = rh->hit.Ng_x[i], ny = rh->hit.Ng_y[i], nz = rh->hit.Ng_z[i];
    const float(*f)[3] = mover->facing;
    return (f[0][0] * nx + f[0][1] * ny + f[0][2] * nz) * rh->ray.dir_x[i] +
               (f[1][0] * nx + f[1][1] * ny + f[1][2] * nz) * rh->ray.dir_y[i] +
               (f[2][0] * nx + f[2][1] * ny + f[2][2] * nz) * rh->ray.dir_z[i] >
           0;
}

static void find_sides(const struct lw_trace *trace, const int valid[16], const struct RTCRayHit16 *rh,
                       uint8_t back[16]) {
    float along[16];
    for (int i = 0; i < 16; i++)
        along[i] = rh->hit.Ng_x[i] * rh->ray.dir_x[i] + rh->hit.Ng_y[i] * rh->ray.dir_y[i] +
                   rh->hit.Ng_z[i] * rh->ray.dir_z[i];
    for (int i = 0; i < 16; i++) {
        const uint32_t object = rh->hit.geomID[i];
        if (!valid[i]) continue;
        back[i] = 0;
        if (object == LW_TRACE_MISS) continue;
        const uint32_t mover = trace->mover_of_object[object];
        back[i] = mover == UINT32_MAX ? (along[i] > 0) != trace->geometry[object].mirrored
                                      : mover_from_behind(&trace->mover[mover], rh, i);
    }
}

/* Rays that are not valid keep what they have met. */
static void intersect_valid(const int valid[16], RTCScene scene, struct lw_trace_context *context,
                            struct RTCRayHit16 *rh) {
    float met[16];
    memcpy(met, rh->ray.tfar, sizeof met);
    empty_rest(valid, rh->ray.tfar);
    rtcIntersect16(valid, scene, &context->rtc, rh);
    for (int i = 0; i < 16; i++) rh->ray.tfar[i] = valid[i] ? rh->ray.tfar[i] : met[i];
}

/* Closest hits of the valid rays, with the side that each is met from. */
static void intersect(const struct lw_trace *trace, unsigned flags, bool every_hit, const int valid[16],
                      struct RTCRayHit16 *rh, uint8_t back[16]) {
    struct lw_trace_context context;
    _Alignas(64) int reach[16];
    init_context(&context, left_of(trace), flags, every_hit);
    intersect_valid(valid, trace->fixed, &context, rh);
    memcpy(reach, valid, sizeof reach);
    if (trace->moving && reach_movers(trace, &rh->ray, reach)) {
        init_context(&context, NULL, flags & ~(unsigned)LW_TRACE_COHERENT, every_hit);
        intersect_valid(reach, trace->moving, &context, rh);
    }
    find_sides(trace, valid, rh, back);
}

/* Whether a ray has met the back of a single-sided surface. */
static bool meets_plain_back(const struct lw_trace *trace, const struct RTCRayHit16 *rh,
                             const uint8_t back[16], int i) {
    return back[i] && !material_of(&trace->geometry[rh->hit.geomID[i]], rh->hit.primID[i])->double_sided;
}

/* Makes those rays valid again that have met what the view does not see; whether any has. */
static bool meet_backs(const struct lw_trace *trace, const struct lw_ray16 *rays, int valid[16],
                       struct RTCRayHit16 *rh, const uint8_t back[16]) {
    bool any = false;
    for (int i = 0; i < 16; i++) {
        valid[i] = 0;
        if (!meets_plain_back(trace, rh, back, i)) continue;
        valid[i] = -1;
        any = true;
        rh->ray.tfar[i] = rays->t_far[i];
        rh->hit.geomID[i] = rh->hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
    }
    return any;
}

static void take_hit(struct RTCRayHit16 *to, const struct RTCRayHit16 *from, int i) {
    to->ray.tfar[i] = from->ray.tfar[i];
    to->hit.u[i] = from->hit.u[i];
    to->hit.v[i] = from->hit.v[i];
    to->hit.primID[i] = from->hit.primID[i];
    to->hit.geomID[i] = from->hit.geomID[i];
}

/* Rounding error between two hits of one place, in t. */
static float uncertainty(struct lw_vec3 origin, struct lw_vec3 direction, float t) {
    return LW_TRACE_LIFT * (lw_vec3_max_abs(origin) / lw_vec3_length(direction) + t);
}

/* Two single-sided faces in one place that look opposite ways are a wall that is lit on both sides. Which of
 * them a ray meets is chance: of a back and a front the front counts. */
static void prefer_fronts(const struct lw_trace *trace, struct RTCRayHit16 *rh, uint8_t back[16]) {
    _Alignas(64) int again[16];
    _Alignas(64) struct RTCRayHit16 front = *rh;
    uint8_t front_back[16];
    bool any = false;
    for (int i = 0; i < 16; i++) {
        again[i] = 0;
        if (!meets_plain_back(trace, rh, back, i)) continue;
        const struct RTCRay16 *ray = &rh->ray;
        const float off = uncertainty(lw_vec3(ray->org_x[i], ray->org_y[i], ray->org_z[i]),
                                      lw_vec3(ray->dir_x[i], ray->dir_y[i], ray->dir_z[i]), ray->tfar[i]);
        again[i] = -1;
        any = true;
        front.ray.tnear[i] = fmaxf(rh->ray.tnear[i], rh->ray.tfar[i] - off);
        front.ray.tfar[i] = rh->ray.tfar[i] + off;
        front.hit.geomID[i] = front.hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
    }
    if (!any) return;
    intersect(trace, LW_TRACE_VIEW, true, again, &front, front_back);
    for (int i = 0; i < 16; i++) {
        if (!again[i] || front.hit.geomID[i] == RTC_INVALID_GEOMETRY_ID) continue;
        take_hit(rh, &front, i);
        back[i] = front_back[i];
    }
}

void lw_trace_closest16(const struct lw_trace *trace, unsigned flags, uint16_t active,
                        const struct lw_ray16 *rays, struct lw_hit16 *out_hits) {
    _Alignas(64) int valid[16];
    _Alignas(64) struct RTCRayHit16 rh;
    load_valid(valid, active);
    load_rays(&rh.ray, rays, active);
    memset(rh.hit.geomID, 0xff, sizeof rh.hit.geomID);
    memset(rh.hit.instID, 0xff, sizeof rh.hit.instID);
    memset(out_hits->back, 0, sizeof out_hits->back);
    /* A view mostly looks at fronts: a filter that asks of each hit costs a fifth more than to ask of the
     * last one, and to trace again where that is a back. */
    intersect(trace, flags, false, valid, &rh, out_hits->back);
    if (!(flags & LW_TRACE_VIEW)) prefer_fronts(trace, &rh, out_hits->back);
    if ((flags & LW_TRACE_VIEW) && meet_backs(trace, rays, valid, &rh, out_hits->back))
        intersect(trace, flags, true, valid, &rh, out_hits->back);

    memcpy(out_hits->t, rh.ray.tfar, sizeof out_hits->t);
    memcpy(out_hits->u, rh.hit.u, sizeof out_hits->u);
    memcpy(out_hits->v, rh.hit.v, sizeof out_hits->v);
    memcpy(out_hits->triangle, rh.hit.primID, sizeof out_hits->triangle);
    memcpy(out_hits->object, rh.hit.geomID,
           sizeof out_hits->object); /* geometries are attached by object index */
}

/* Notes all hits of a packet. */
static void find_all(const struct lw_trace *trace, uint16_t active, const struct lw_ray16 *rays,
                     struct found found[16]) {
    _Alignas(64) int valid[16];
    _Alignas(64) struct RTCRay16 ray;
    struct lw_trace_context context;
    for (int i = 0; i < 16; i++) found[i].count = 0;
    load_valid(valid, active);
    load_rays(&ray, rays, active);
    init_context(&context, left_of(trace), LW_TRACE_LIGHT, false);
    context.rtc.filter = note_hits;
    context.found = found;
    rtcOccluded16(valid, trace->fixed, &context.rtc, &ray);
    if (!trace->moving || !reach_movers(trace, &ray, valid)) return;
    context.left = NULL;
    empty_rest(valid, ray.tfar);
    rtcOccluded16(valid, trace->moving, &context.rtc, &ray);
}

static bool is_plain_back(const struct lw_trace *trace, const struct lw_trace_met *met) {
    return met->back && !material_of(&trace->geometry[met->object], met->triangle)->double_sided;
}

/* A front in the same place as a back, from `first` on, as prefer_fronts() has it. */
static const struct lw_trace_met *front_or(const struct lw_trace *trace, const struct lw_ray16 *rays, int i,
                                           const struct found *found, uint32_t first) {
    const struct lw_trace_met *met = &found->met[first];
    if (!is_plain_back(trace, met)) return met;
    const float end = met->t + uncertainty(lw_vec3(rays->org_x[i], rays->org_y[i], rays->org_z[i]),
                                           lw_vec3(rays->dir_x[i], rays->dir_y[i], rays->dir_z[i]), met->t);
    for (uint32_t k = first + 1; k < found->count && found->met[k].t <= end; k++)
        if (!is_plain_back(trace, &found->met[k])) return &found->met[k];
    return met;
}

static void pick(const struct lw_trace *trace, const struct lw_ray16 *rays, int i, float gap,
                 const struct found *found, struct lw_trace_through *out) {
    float near = rays->t_near[i];
    out->count = 0;
    for (uint32_t k = 0; k < found->count && out->count < LW_TRACE_THROUGH_MAX; k++) {
        if (found->met[k].t < near) continue;
        const struct lw_trace_met *met = front_or(trace, rays, i, found, k);
        out->met[out->count++] = *met;
        near = met->t + gap;
    }
}

/* Traces from hit to hit: for rays with more than FOUND_MAX hits. */
static void step_through(const struct lw_trace *trace, uint16_t active, const struct lw_ray16 *rays,
                         const float gap[16], struct lw_trace_through out[16]) {
    struct lw_ray16 rest = *rays;
    struct lw_hit16 hits;
    for (int i = 0; i < 16; i++)
        if (active >> i & 1) out[i].count = 0;
    for (uint32_t k = 0; k < LW_TRACE_THROUGH_MAX && active; k++) {
        lw_trace_closest16(trace, LW_TRACE_LIGHT, active, &rest, &hits);
        for (int i = 0; i < 16; i++) {
            if (!(active >> i & 1)) continue;
            if (hits.object[i] == LW_TRACE_MISS) {
                active &= (uint16_t) ~(1u << i);
                continue;
            }
            out[i].met[out[i].count++] =
                (struct lw_trace_met){hits.t[i], hits.object[i], hits.triangle[i], hits.back[i] != 0};
            rest.t_near[i] = hits.t[i] + gap[i];
        }
    }
}

void lw_trace_through16(const struct lw_trace *trace, uint16_t active, const struct lw_ray16 *rays,
                        const float gap[16], struct lw_trace_through out[16]) {
    struct found found[16];
    uint16_t more = 0;
    find_all(trace, active, rays, found);
    for (int i = 0; i < 16; i++) {
        if (!(active >> i & 1)) continue;
        if (found[i].count > FOUND_MAX)
            more |= (uint16_t)(1u << i);
        else
            pick(trace, rays, i, gap[i], &found[i], &out[i]);
    }
    if (more) step_through(trace, more, rays, gap, out);
}

/* Bit i set: valid ray i has met something. */
static uint16_t occluded_lanes(const int valid[16], const float tfar[16]) {
    uint16_t lanes = 0;
    for (int i = 0; i < 16; i++)
        if (valid[i] && tfar[i] < 0) lanes |= (uint16_t)(1u << i);
    return lanes;
}

static uint16_t find_occluded(const struct lw_trace *trace, unsigned flags, uint16_t active,
                              const struct lw_ray16 *rays, float (*tint)[16]) {
    _Alignas(64) int valid[16];
    _Alignas(64) struct RTCRay16 ray;
    struct lw_trace_context context;
    const bool every_hit = flags & LW_TRACE_VIEW;
    load_valid(valid, active);
    load_rays(&ray, rays, active);
    init_context(&context, left_of(trace), flags, every_hit);
    context.tint = tint;
    rtcOccluded16(valid, trace->fixed, &context.rtc, &ray);
    uint16_t occluded = occluded_lanes(valid, ray.tfar);
    load_valid(valid, active & (uint16_t)~occluded);
    if (trace->moving && reach_movers(trace, &ray, valid)) {
        /* Without the coherent flag: in a scene with instances Embree 3.13.5's rtcOccluded16 with it does not
         * return for some packets (its loop over the octants of directions finds no ray in one and stays
         * there). */
        init_context(&context, NULL, flags & ~(unsigned)LW_TRACE_COHERENT, every_hit);
        context.tint = tint;
        empty_rest(valid, ray.tfar);
        rtcOccluded16(valid, trace->moving, &context.rtc, &ray);
        occluded |= occluded_lanes(valid, ray.tfar);
    }
    return occluded;
}

uint16_t lw_trace_occluded16(const struct lw_trace *trace, unsigned flags, uint16_t active,
                             const struct lw_ray16 *rays) {
    return find_occluded(trace, flags, active, rays, NULL);
}

uint16_t lw_trace_tinted16(const struct lw_trace *trace, unsigned flags, uint16_t active,
                           const struct lw_ray16 *rays, float out_tint[3][16]) {
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < 16; i++) out_tint[c][i] = 1;
    return find_occluded(trace, flags, active, rays, trace->tints ? out_tint : NULL);
}

bool lw_trace_tints(const struct lw_trace *trace) { return trace->tints; }

const char *lw_trace_isa(const struct lw_trace *trace) { return lw_trace_isa_of(trace->device); }

size_t lw_trace_memory_bytes(const struct lw_trace *trace) {
    int64_t bytes = trace->memory_bytes;
    return bytes > 0 ? (size_t)bytes : 0;
}
