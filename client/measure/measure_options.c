#include "client/measure/measure_options.h"

#include <stdio.h>

enum lw_status lw_measure_options_size(const char *text, uint32_t width_min, uint32_t height_min,
                                       uint32_t *out_width, uint32_t *out_height, struct lw_error *err) {
    const unsigned side_max = LW_MEASURE_OPTIONS_SIDE_MAX;
    unsigned width = 0, height = 0;
    int end = 0;
    if (sscanf(text, "%5ux%5u%n", &width, &height, &end) != 2 || text[end] || width < width_min ||
        height < height_min || width > side_max || height > side_max)
        return lw_status_fail(err, LW_USAGE, "--size: \"%s\" is no WxH with %ux%u to %ux%u pixels", text,
                              width_min, height_min, side_max, side_max);
    *out_width = width;
    *out_height = height;
    return LW_OK;
}
