/* view_error.h: errors of pictures against references, in several measures from the same frames.
 * Flow:    parts of views: references and pictures -> [view_error] -> relMSE, FLIP, flicker, lag
 * Threads: one thread at a time per sum.
 * After:   Andersson et al. 2020 (FLIP; client/measure/figures/flip.h).
 *
 * A reference has two independent halves a and b, each a mean of the same number of paths (reference.h). t
 * is their mean:
 *     relMSE  = mean((x - a)(x - b) / (t^2 + epsilon))
 *     flicker = mean(((x - x') - (a - a'))((x - x') - (b - b')) / (t^2 + epsilon)), ' one frame before
 * over pixels and channels. The noise of the reference adds nothing in the mean, so both may be a little
 * below 0 for a picture as good as the reference. FLIP has no such form: it compares with t, noise
 * included. An upper bound for that noise is the FLIP of one half, as the picture, against a reference of
 * the other half alone.
 *
 * The lag is the age of the light whose reference fits a picture best. References of the same camera at
 * several times are mixed linearly between two neighbours; the least relMSE is found exactly, not on a
 * grid. Two things limit it: light that does not change linearly between two times, and noise. While light
 * stands still all ages fit alike, so it should change all the time. A picture that mixes ages gets one
 * between them.
 *
 * All figures are means over all pixels added, of any view. */
#ifndef LW_CLIENT_MEASURE_FIGURES_VIEW_ERROR_H
#define LW_CLIENT_MEASURE_FIGURES_VIEW_ERROR_H

#include "client/view/tonemap.h"
#include "common/base/status.h"

#include <stddef.h>
#include <stdint.h>

#define LW_VIEW_ERROR_MOMENTS_MAX   64u
#define LW_VIEW_ERROR_FIXED_EPSILON 1e-4 /* (W/(m^2 sr))^2 */
#define LW_VIEW_ERROR_WORST_SHARE   1e-3 /* of all pixels, which the trimmed relMSE leaves out */

struct lw_view_error_desc {
    /* (W/(m^2 sr))^2, of relMSE, flicker and lag; usually 1 % of the mean square of all references. Where the
     * reference is black only 0 is right. */
    double epsilon;
    enum lw_tonemap_curve curve; /* how FLIP's display shows pictures */
    float stops;
    float pixels_per_degree;  /* 0: LW_FLIP_PIXELS_PER_DEGREE */
    double moment_distance_s; /* between the moments of references, for the lag */
};

/** The reference of a view, or of a part of it, at one time. */
struct lw_view_error_reference {
    uint32_t width, height;
    const float *half[2]; /* means; width * height * 3, W/(m^2 sr) */
    /* width * height; not 0: the pixel does not count (it emits light, say). NULL: all count. Pixels whose
     * reference is not finite never count. */
    const uint8_t *left_out;
};

/** relMSE alone, of a picture with halves of its own: the mean of (x0 - a)(x1 - b) / (t^2 + epsilon).
 * picture  two halves x0, x1; twice the same for a picture without noise of a reference's kind
 * Returns  NAN where no pixel counts */
double lw_view_error_relmse(const struct lw_view_error_reference *reference, const float *const picture[2],
                            double epsilon);

/** Sums over views and frames. Fields are inside. */
struct lw_view_error_sum {
    struct lw_view_error_desc desc;
    double relative, relative_fixed; /* squares, of all channels */
    double flip;
    uint64_t flip_count, not_finite;
    float *pixel; /* relative squared error of each pixel: mean of its channels */
    size_t pixel_count, pixel_capacity;
    double flicker;
    uint64_t flicker_count;
    uint32_t moment_count;                               /* 0: nothing added */
    double fit[LW_VIEW_ERROR_MOMENTS_MAX];               /* relative squares against each moment */
    double fit_of_neighbours[LW_VIEW_ERROR_MOMENTS_MAX]; /* products of a moment and the next */
    double change, change_noise_square; /* relative squares of light's change up to the last moment */
    uint64_t lag_count;
};

/** The figures of a sum; NAN where nothing was added. */
struct lw_view_error {
    double relmse;         /* with the desc's epsilon */
    double relmse_fixed;   /* with LW_VIEW_ERROR_FIXED_EPSILON */
    double relmse_trimmed; /* relmse without the worst LW_VIEW_ERROR_WORST_SHARE of all pixels */
    double flip;
    double flicker;
    double lag_s;          /* NAN also where light hardly changes: no age fits better than another */
    double lag_relmse;     /* at the best fit */
    double lag_relmse_now; /* at the last moment */
    uint64_t pixel_count;  /* pixels that relmse and flip cover */
    uint64_t not_finite;   /* values of pictures that are no numbers; they count as black */
};

/** Starts empty; holds no memory yet. */
void lw_view_error_init(struct lw_view_error_sum *sum, const struct lw_view_error_desc *desc);
/** A zeroed sum is fine. */
void lw_view_error_finish(struct lw_view_error_sum *sum);

/** Adds the pictures of a frame: relMSE in its forms, and FLIP.
 *
 * picture  width * height * 3, W/(m^2 sr)
 * Errors   LW_NO_MEMORY, LW_USAGE (a reference without pixels); the sum is unchanged then */
LW_MUST_CHECK enum lw_status lw_view_error_add(struct lw_view_error_sum *sum,
                                               const struct lw_view_error_reference *reference,
                                               const float *picture, struct lw_error *err);

/** Adds the step from a frame to the next one: flicker. Both references are of one size; pixels that either
 * leaves out do not count. */
void lw_view_error_add_step(struct lw_view_error_sum *sum, const struct lw_view_error_reference *before,
                            const float *picture_before, const struct lw_view_error_reference *reference,
                            const float *picture);

/** Adds a picture's fit to the light of several moments: lag.
 *
 * moment        references of the picture's camera, the oldest first, moment_distance_s apart, the last one
 *               of the picture's own moment. All have one size. Pixels that any leaves out do not count
 * moment_count  2 to LW_VIEW_ERROR_MOMENTS_MAX; the same in all calls of a sum */
void lw_view_error_add_lag(struct lw_view_error_sum *sum, const struct lw_view_error_reference *moment,
                           uint32_t moment_count, const float *picture);

/** The figures. Reorders the sum's pixels; more may be added afterwards. */
struct lw_view_error lw_view_error_of(struct lw_view_error_sum *sum);

#endif
