/* solver_pictures.h: pictures of what a solver shows after given times: the last light that it has by then.
 * Flow:    solver, frame by frame -> [view of its light] -> PNG
 * Threads: main() only. */
#ifndef LW_TESTS_SOLVER_PICTURES_H
#define LW_TESTS_SOLVER_PICTURES_H

#include "client/view/tonemap.h"
#include "tests/bench/bench_view.h"

#define SOLVER_PICTURES_MOMENTS 3u

struct solver_pictures {
    const struct lw_pose *pose;
    const char *folder;
    double moment_s[SOLVER_PICTURES_MOMENTS]; /* rising */
    uint32_t written;                         /* moments that the current solver has behind it */
    struct lw_trace *trace;
    struct lw_compose *compose;
    struct bench_view_light light;
    struct lw_compose_source source;
    struct lw_compose_view view;
    struct lw_tonemap tonemap;
    float *rgb; /* the last picture */
    uint8_t *srgb;
};

/** name: SCENE[@CAMERA]. The last moment is last_s, each one before it an eighth of the next. All pointers
 * outlive the pictures. Finish them in any case. Errors: LW_NO_MEMORY; those of bench_view_camera(). */
LW_MUST_CHECK enum lw_status solver_pictures_init(struct solver_pictures *pictures, const char *name,
                                                  const struct lw_scene *scene, const struct lw_pose *pose,
                                                  const struct lw_atlas_map *map, uint32_t bounces,
                                                  double last_s, const char *folder, struct lw_error *err);
/** A zeroed one is fine. */
void solver_pictures_finish(struct solver_pictures *pictures);

/** Writes FOLDER/truth.png, which sets the exposure of all that follow. Errors: lw_image_write_png()'s. */
LW_MUST_CHECK enum lw_status solver_pictures_truth(struct solver_pictures *pictures,
                                                   const struct lw_solver *solver, struct lw_error *err);

/** Begins with another solver: black. */
void solver_pictures_begin(struct solver_pictures *pictures);

/** A frame has ended after cpu_s: writes FOLDER/<number>-<moment>.png for the moments before that, with the
 * light of the frame before, then takes the light of this one. Errors: lw_image_write_png()'s. */
LW_MUST_CHECK enum lw_status solver_pictures_frame(struct solver_pictures *pictures,
                                                   const struct lw_solver *solver, uint32_t number,
                                                   double cpu_s, struct lw_error *err);

#endif
