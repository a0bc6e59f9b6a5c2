/* crossover_references.h: the references of a row: converged crops of its views, at the judged frames and
 * before.
 * Flow:    scene, views -> [crossover_references: paths, or the files of an earlier run] -> two halves,
 *          emitters
 * Threads: one thread at a time; traces on several inside.
 *
 * Pixels are means over their squares (LW_PATH_PIXEL_BOX). Each view has LW_CROSSOVER_CROPS crops, one in
 * the left half and one in the right, at places that its number fixes. References of earlier light have a
 * quarter of the paths. Both halves of a reference are independent, so that no noise adds to errors
 * (view_error.h). */
#ifndef LW_CLIENT_MEASURE_CROSSOVER_REFERENCES_H
#define LW_CLIENT_MEASURE_CROSSOVER_REFERENCES_H

#include "client/measure/figures/view_error.h"
#include "client/measure/measure_options.h"
#include "client/measure/measure_store.h"
#include "client/measure/sides/path_world.h"

#define LW_CROSSOVER_CROPS       2u
#define LW_CROSSOVER_JUDGED_MAX  16u
#define LW_CROSSOVER_LATES       6u /* moments before the first judged one ... */
#define LW_CROSSOVER_LATE_FRAMES 5u /* ... so far apart; the first is a second before */

struct lw_crossover_crop {
    uint32_t x, y; /* pixels; multiples of 16 */
};

/** One view at one moment; its crops lie in a column. */
struct lw_crossover_reference {
    float *half[2]; /* means; crops * side * side * 3 */
    /* crops * side * side: as lw_reference_look(); LW_TRACE_MISS where it or a neighbour shines */
    uint32_t *object;
    uint8_t *left_out; /* late ones: 1 where a light is seen at either time, or another object; else NULL */
};

struct lw_crossover_references {
    uint32_t side; /* a crop's; a multiple of 16 */
    struct lw_crossover_crop crop[LW_MEASURE_VIEWS][LW_CROSSOVER_CROPS];
    uint32_t judged[LW_CROSSOVER_JUDGED_MAX], judged_count; /* frames, growing */
    struct lw_crossover_reference now[LW_CROSSOVER_JUDGED_MAX][LW_MEASURE_VIEWS];
    /* for judged[0]; oldest first */
    struct lw_crossover_reference late[LW_CROSSOVER_LATES][LW_MEASURE_VIEWS];
    bool dark[LW_MEASURE_VIEWS];
    uint32_t dark_count;
    /* over all judged references, or the ones a second before if that is more; pixels that do not shine */
    double mean_square;
    float stops; /* exposure at which they are shown */
};

struct lw_crossover_references_desc {
    const struct lw_measure_options *options;
    const struct lw_scene *scene;
    const char *content; /* tells scenes apart, their light and lightmaps too; goes into the files' heads */
    struct lw_renderer_cameras cameras;
    const char *folder; /* the row's: files go to its folder "reference" */
    const uint32_t *judged;
    uint32_t judged_count;
    const _Atomic bool *cancel;
};

/** The side of a crop, and the crops of a view, in pictures of this size, 64x32 or more. They fit into
 * their halves. */
uint32_t lw_crossover_references_side(uint32_t width, uint32_t height);
struct lw_crossover_crop lw_crossover_references_crop(uint32_t width, uint32_t height, uint32_t view,
                                                      uint32_t index);

/** Reads or traces all references. Finish it in any case.
 * Errors: LW_CLOSED if cancelled; LW_BAD_DATA where all views are black; LW_IO, LW_CANNOT_CREATE,
 *         LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_crossover_references_init(struct lw_crossover_references *references,
                                                          const struct lw_crossover_references_desc *desc,
                                                          struct lw_error *err);
void lw_crossover_references_finish(struct lw_crossover_references *references);

/** A crop of a reference, for view_error.h. */
struct lw_view_error_reference lw_crossover_references_of(const struct lw_crossover_references *references,
                                                          const struct lw_crossover_reference *reference,
                                                          uint32_t crop);

/** relMSE of a view's light of an earlier time, emitters left out: the mean of (l - t)^2 / (t^2 +
 * epsilon), by halves of both. NAN: no pixel counts. */
double lw_crossover_references_late_error(const struct lw_crossover_references *references, uint32_t late,
                                          uint32_t view);

/** Copies a view's crops out of a whole picture. out: crops * side * side * 3 floats. */
void lw_crossover_references_cut(const struct lw_crossover_references *references, uint32_t view,
                                 const float *rgb, uint32_t width, float *out);

#endif
