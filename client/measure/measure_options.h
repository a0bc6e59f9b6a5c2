/* measure_options.h: option values that both comparisons read.
 * Threads: main() only. */
#ifndef LW_CLIENT_MEASURE_MEASURE_OPTIONS_H
#define LW_CLIENT_MEASURE_MEASURE_OPTIONS_H

#include "common/status.h"

#include <stdint.h>

#define LW_MEASURE_OPTIONS_SIDE_MAX    8192u /* pixels */
#define LW_MEASURE_OPTIONS_DENSITY_MIN 0.01  /* times a scene's default */
#define LW_MEASURE_OPTIONS_DENSITY_MAX 100.0

/** Reads the value of --size: "WxH" in pixels. Errors: LW_USAGE, naming the smallest and largest size. */
LW_MUST_CHECK enum lw_status lw_measure_options_size(const char *text, uint32_t width_min,
                                                     uint32_t height_min, uint32_t *out_width,
                                                     uint32_t *out_height, struct lw_error *err);

#endif
