/* reference.h: converged pictures of some frames and users, at some of their pixels, and how far others are
 * off them.
 * Flow:    scene, views -> [reference: paths] -> relMSE of a renderer's pictures
 * Threads: one thread at a time.
 *
 * The pixels are a lattice: every stride-th in either direction, in the middle of their stride x stride
 * square. A picture of width / stride x height / stride pixels with the same field of view has its pixel
 * centres there, if the stride is odd and divides both sides.
 *
 * A reference has two independent halves a and b, each a mean of as many paths. With t their mean,
 *     relMSE = mean((x - a)(x - b) / (t^2 + 0.01 mean(t^2))) over pixels and channels
 * has the expectation of mean((x - reference)^2 / ...): what noise is left in the reference adds none of its
 * own. */
#ifndef LW_CLIENT_MEASURE_REFERENCE_H
#define LW_CLIENT_MEASURE_REFERENCE_H

#include "client/measure/path_world.h"
#include "client/measure/views.h"

/** The largest odd stride up to 7 that divides both sides; 1 if there is none. */
uint32_t lw_reference_stride(uint32_t width, uint32_t height);

struct lw_reference {
    uint32_t width, height; /* of the lattice */
    float *half[2];         /* means; width * height * 3 */
    double mean_square;     /* of its values */
    double noise;           /* relMSE of the reference itself, estimated: what the halves' mean is off */
};

/** Traces a reference at the world's present moment. samples: even. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_reference_init(struct lw_reference *reference,
                                               const struct lw_path_world *world,
                                               const struct lw_camera_view *camera, uint32_t width,
                                               uint32_t height, uint32_t samples, uint32_t seed,
                                               struct lw_error *err);
/** A zeroed reference is fine. */
void lw_reference_finish(struct lw_reference *reference);

/** relMSE of a lattice picture; may be a little below 0 for one that is as good as the reference. */
double lw_reference_error(const struct lw_reference *reference, const float *rgb);

/** Whether it shows next to nothing, of the mean square that views of the scene have: any light at all would
 * be an error beyond measure there. */
bool lw_reference_is_dark(const struct lw_reference *reference, double mean_square);

/** Which object each pixel of a lattice shows at the world's present moment; LW_TRACE_MISS where it shines or
 * is the sky.
 * out_object  width * height. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_reference_look(const struct lw_path_world *world,
                                               const struct lw_camera_view *camera, uint32_t width,
                                               uint32_t height, uint32_t *out_object, struct lw_error *err);

/** relMSE of the light of another moment, which the world has been set to: what a picture that lags by so
 * long would be off, if it were right otherwise. Pixels count that show the same object at both moments, and
 * nothing that shines.
 * object   as lw_reference_look() has found it at the reference's moment
 * samples  even; seed  another than the reference's. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_reference_lag_error(const struct lw_reference *reference,
                                                    const uint32_t *object, const struct lw_path_world *world,
                                                    const struct lw_camera_view *camera, uint32_t samples,
                                                    uint32_t seed, double *out_error, struct lw_error *err);

/** Takes the lattice out of a whole picture. */
void lw_reference_pick(const float *rgb, uint32_t width, uint32_t height, uint32_t stride,
                       float *out_lattice);

#endif
