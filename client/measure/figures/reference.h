/* reference.h: converged pictures of some frames and users, at some of their pixels, and errors against
 * them.
 * Flow:    scene, views -> [reference: paths] -> relMSE of a renderer's pictures
 * Threads: one thread at a time.
 *
 * The pixels are those of a lattice (lattice.h).
 *
 * A reference has two independent halves a and b, each a mean of the same number of paths. t is their
 * mean:
 *     relMSE = mean((x - a)(x - b) / (t^2 + 0.01 mean(t^2))) over pixels and channels
 * Its expectation is mean((x - reference)^2 / ...): the noise of the reference adds nothing. */
#ifndef LW_CLIENT_MEASURE_FIGURES_REFERENCE_H
#define LW_CLIENT_MEASURE_FIGURES_REFERENCE_H

#include "client/measure/sides/path_world.h"
#include "client/measure/sides/real_run.h"

#define LW_REFERENCE_FLOOR_SHARE 0.01 /* epsilon of relMSE, over the mean square of references */
#define LW_REFERENCE_DARK_SHARE                                                                              \
    1e-4 /* a view's mean square over that of all: a hundredth of the brightness */

struct lw_reference {
    uint32_t width, height; /* the lattice's */
    float *half[2];         /* means; width * height * 3 */
    double mean_square;     /* mean over its values */
    double noise;           /* relMSE of the mean of both halves, estimated */
};

/** Traces a reference at the world's current time. samples: even. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_reference_init(struct lw_reference *reference,
                                               const struct lw_path_world *world,
                                               const struct lw_camera_view *camera, uint32_t width,
                                               uint32_t height, uint32_t samples, uint32_t seed,
                                               struct lw_error *err);
/** Traces the reference of a picture by the wall clock: at the moment at which it was ready, from its
 * camera. The world goes to that moment. Errors: LW_NO_MEMORY, LW_INTERNAL. */
LW_MUST_CHECK enum lw_status lw_reference_init_real(struct lw_reference *reference,
                                                    struct lw_path_world *world,
                                                    const struct lw_renderer_desc *side,
                                                    const struct lw_real_picture *picture, uint32_t samples,
                                                    uint32_t seed, struct lw_error *err);
/** A zeroed reference is fine. */
void lw_reference_finish(struct lw_reference *reference);

/** relMSE of a lattice picture. It may be a little below 0 for a picture as good as the reference. */
double lw_reference_error(const struct lw_reference *reference, const float *rgb);

/** Whether it is nearly black. mean_square: the mean square of the scene's views. Any light would be a
 * huge relative error there. */
bool lw_reference_is_dark(const struct lw_reference *reference, double mean_square);

/** Finds the object of each lattice pixel at the world's current time; LW_TRACE_MISS where it emits light
 * or is the sky.
 * out_object  width * height. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_reference_look(const struct lw_path_world *world,
                                               const struct lw_camera_view *camera, uint32_t width,
                                               uint32_t height, uint32_t *out_object, struct lw_error *err);

/** relMSE of the light of another time, which the world has been set to. It is the error of a perfect
 * picture with that lag. Pixels count that show the same object at both times and emit no light.
 * object   from lw_reference_look() at the reference's time
 * samples  even; seed  not the reference's. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_reference_lag_error(const struct lw_reference *reference,
                                                    const uint32_t *object, const struct lw_path_world *world,
                                                    const struct lw_camera_view *camera, uint32_t samples,
                                                    uint32_t seed, double *out_error, struct lw_error *err);

#endif
