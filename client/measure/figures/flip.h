/* flip.h: the perceived difference of two alternating pictures, per pixel (LDR-FLIP).
 * Flow:    two display-referred pictures -> [flip] -> map of differences in [0, 1] -> mean
 * Threads: pure functions, [any].
 * After:   Andersson et al. 2020, "FLIP: A Difference Evaluator for Alternating Images" (with its erratum:
 *          luminance is divided by 116 before features are detected).
 *
 * Per pixel the difference of colours (contrast sensitivity, L*a*b*, Hunt effect, HyAB distance) is raised to
 * the power of 1 minus the difference of features (edges and points). The authors recommend the mean where
 * one number is wanted. */
#ifndef LW_CLIENT_MEASURE_FIGURES_FLIP_H
#define LW_CLIENT_MEASURE_FIGURES_FLIP_H

#include "common/base/status.h"

#include <stddef.h>
#include <stdint.h>

/** The authors' default: 0.7 m from a display that is 0.7 m and 3,840 pixels wide. */
#define LW_FLIP_PIXELS_PER_DEGREE     67.0f
#define LW_FLIP_PIXELS_PER_DEGREE_MIN 1.0f
#define LW_FLIP_PIXELS_PER_DEGREE_MAX 1000.0f

/** Compares two pictures.
 *
 * reference_rgb, test_rgb  width * height * 3, linear sRGB as a display shows it (after tone mapping), in
 *                          [0, 1]. Values out of range count as 0 or 1, NaN as 0.
 * pixels_per_degree        of the visual field, from LW_FLIP_PIXELS_PER_DEGREE_MIN to _MAX
 * out_map                  width * height; 0 where nobody sees a difference, at most 1
 * Borders                  pixels outside a picture are like the nearest one inside
 * Errors                   LW_USAGE: a side that is 0 or beyond LW_IMAGE_SIDE_MAX, pixels_per_degree out of
 *                          range; LW_NO_MEMORY (18 floats a pixel). out_map is untouched then. */
LW_MUST_CHECK enum lw_status lw_flip_map(const float *reference_rgb, const float *test_rgb, uint32_t width,
                                         uint32_t height, float pixels_per_degree, float *out_map,
                                         struct lw_error *err);

/** The mean of a map; 0 without a pixel.
 * left_out  a byte a pixel, not 0 where it does not count; NULL: all count */
double lw_flip_mean(const float *map, const uint8_t *left_out, size_t pixel_count);

#endif
