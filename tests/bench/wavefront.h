/* wavefront.h: a plain path tracer that traces many paths stage by stage, to measure what that brings.
 * Flow:    N pixels -> rays from the eye -> [surfaces -> (sort) -> lamp rays -> bounce rays]... -> picture
 * Threads: create and destroy by one thread; one render at a time per struct wavefront.
 * After:   Laine, Karras and Aila 2013 (wavefronts in place of a megakernel).
 *
 * Every path has its own random numbers; light is that of lw_path_trace_render() with a view whose other
 * fields are 0, in the mean. A path keeps its place in the arrays; a queue has the numbers of those that go
 * on, and packets of 16 are filled in its order. With N = 16 the packets are what a megakernel has: 16 paths
 * of 4 x 4 pixels from start to end, with an empty lane for each path that has ended. */
#ifndef LW_TESTS_BENCH_WAVEFRONT_H
#define LW_TESTS_BENCH_WAVEFRONT_H

#include "client/view/camera.h"
#include "common/light/lights.h"
#include "common/trace/trace.h"

#define WAVEFRONT_SQUARE   4u /* pixels; width and height are multiples of it */
#define WAVEFRONT_SIDE_MAX 4096u

/** What the queue is sorted by before each bounce. */
enum wavefront_order {
    WAVEFRONT_UNSORTED,
    WAVEFRONT_BY_MATERIAL,  /* of the hit; before surfaces are read */
    WAVEFRONT_BY_NORMAL,    /* 3 bits an axis, then the place in Morton order; before rays to lamps */
    WAVEFRONT_BY_DIRECTION, /* octant of the bounce ray, then its start in Morton order; likewise */
    WAVEFRONT_ORDERS
};

/** Which packets get Embree's coherent flag. */
enum wavefront_coherent { WAVEFRONT_COHERENT_EYE, WAVEFRONT_COHERENT_LAMPS, WAVEFRONT_COHERENT_ALL };

struct wavefront_desc {
    const struct lw_scene *scene;
    const struct lw_trace *trace; /* of the same scene, at the same pose */
    const struct lw_lights *lights;
    const struct lw_pose *pose;
    struct lw_camera_view camera;
    uint32_t width, height; /* pixels; up to WAVEFRONT_SIDE_MAX */
    uint32_t bounces;       /* of indirect light */
    enum wavefront_coherent coherent;
};

struct wavefront;

/** What desc points to must outlive it. Errors: LW_NO_MEMORY; LW_BAD_DATA: the scene is empty. */
LW_MUST_CHECK enum lw_status wavefront_create(const struct wavefront_desc *desc, struct wavefront **out,
                                              struct lw_error *err);
void wavefront_destroy(struct wavefront *w);

/** Takes `paths` pixels at a time, at most all; of these sample after sample.
 * paths        a multiple of 16
 * picture      width * height * 3 floats, row 0 on top, W/(m^2 sr): added to, all samples
 * out_sort_ns  CPU time of this thread that went into sorting */
void wavefront_render(struct wavefront *w, uint32_t paths, enum wavefront_order by, uint32_t seed,
                      uint32_t samples, float *picture, uint64_t *out_sort_ns);

#endif
