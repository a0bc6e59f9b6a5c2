/* path_film.h: the sums of a path tracer, in two independent halves.
 * Flow:    path_trace -> [path_film] -> linear radiance, and its estimated error
 * Threads: one thread at a time; path_trace writes disjoint pixels from several.
 *
 * Even samples go to the first half, odd ones to the second, each from a sequence of its own. So the
 * difference of the halves estimates the error of their mean without bias. The spread of the samples of one
 * low-discrepancy sequence does not. */
#ifndef LW_CLIENT_PATHS_PATH_FILM_H
#define LW_CLIENT_PATHS_PATH_FILM_H

#include "common/base/status.h"

#include <stdint.h>

#define LW_PATH_FILM_SAMPLES_MAX (1u << 20) /* per pixel: float sums lose 1e-5 by then */

struct lw_path_film {
    uint32_t width, height;
    uint32_t samples; /* per pixel, both halves together */
    float *half[2];   /* sums of radiance, width * height * 3 each; row 0 on top */
};

/** An empty film. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_path_film_init(struct lw_path_film *film, uint32_t width, uint32_t height,
                                               struct lw_error *err);
/** A zeroed film is fine. */
void lw_path_film_finish(struct lw_path_film *film);
/** Forgets all samples. */
void lw_path_film_clear(struct lw_path_film *film);

/** The mean of the samples. out_rgb: width * height * 3 floats, W/(m^2 sr); black without a sample. */
void lw_path_film_resolve(const struct lw_path_film *film, float *out_rgb);

/** The estimated relative error of the mean: the square root of relMSE = mean((x - t)^2 / (t^2 + 0.01
 * mean(t^2))) over all pixels and channels, with (x - t)^2 estimated from the halves and t by x. The floor of
 * 1 % keeps dark pixels from ruling the figure. INFINITY with fewer than 2 samples; 0 for a picture that is
 * black. */
double lw_path_film_error(const struct lw_path_film *film);

#endif
