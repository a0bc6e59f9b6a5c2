/* comparison.h: the picture of a path tracer beside the one of the cache: of the same view, on a thread of
 * its own, and what the two differ by.
 * Flow:    stage, camera -> [comparison: path_trace on a thread] -> pixels over the window's picture
 * Threads: calls by one thread; traces on another, which works on several. */
#ifndef LW_CLIENT_VIEW_WINDOW_COMPARISON_H
#define LW_CLIENT_VIEW_WINDOW_COMPARISON_H

#include "client/view/compose/stage.h"
#include "client/view/tonemap.h"

#define LW_COMPARISON_SAMPLES_MAX 16384u /* per pixel: then it rests */

struct lw_comparison;

/** threads: that trace; 0: half of all. Errors: LW_NO_MEMORY; LW_OS. */
LW_MUST_CHECK enum lw_status lw_comparison_create(unsigned threads, struct lw_comparison **out_comparison,
                                                  struct lw_error *err);
/** NULL is fine. Must be destroyed before the scene of its stage is. */
void lw_comparison_destroy(struct lw_comparison *comparison);

/** Sets the picture to trace. Another picture than the last one begins again.
 * changed   something in the scene is not as in the last call
 * width, height   of the traced picture, from 1 on
 * Errors: LW_NO_MEMORY; what the thread had no memory for. */
LW_MUST_CHECK enum lw_status lw_comparison_follow(struct lw_comparison *comparison,
                                                  const struct lw_stage *stage,
                                                  const struct lw_camera_view *camera, uint32_t width,
                                                  uint32_t height, bool changed, struct lw_error *err);

/** The traced picture so far. */
struct lw_comparison_picture {
    const float *rgb; /* width * height * 3, W/(m^2 sr); until the next call of lw_comparison_take() */
    uint32_t width, height, samples; /* samples 0: nothing yet, and rgb is NULL */
    double error;                    /* relative, of its own noise; INFINITY: not known yet */
};
/** Takes the newest picture; returns whether it is another one than the last time. */
bool lw_comparison_take(struct lw_comparison *comparison, struct lw_comparison_picture *out_picture);

/** Fills 0xAARRGGBB pixels of a larger picture with columns left.. of the traced one, tone mapped, after a
 * white line.
 * out_argb   (out_width - left) * out_height */
void lw_comparison_wipe(const struct lw_comparison_picture *picture, enum lw_tonemap_curve curve, float stops,
                        uint32_t out_width, uint32_t out_height, uint32_t left, uint32_t *out_argb);

/** Fills pixels with how far another picture of the same view is off: the difference of luminances over the
 * traced one (and 1 % of its mean), in the colours of lw_show_ramp() from 0.1 % to 100 %.
 * other      other_width * other_height * 3, W/(m^2 sr)
 * Returns    the root of the mean of squares of that; NAN without pixels
 * Errors     none */
double lw_comparison_difference(const struct lw_comparison_picture *picture, const float *other,
                                uint32_t other_width, uint32_t other_height, uint32_t out_width,
                                uint32_t out_height, uint32_t *out_argb);

#endif
