#include "client/measure/measure_options.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static enum lw_status read_size(const char *text, uint32_t width_min, uint32_t height_min,
                                struct lw_measure_options *out, struct lw_error *err) {
    const unsigned side_max = LW_MEASURE_OPTIONS_SIDE_MAX;
    unsigned width = 0, height = 0;
    int end = 0;
    if (sscanf(text, "%5ux%5u%n", &width, &height, &end) != 2 || text[end] || width < width_min ||
        height < height_min || width > side_max || height > side_max)
        return lw_status_fail(err, LW_USAGE, "--size: \"%s\" is no WxH with %ux%u to %ux%u pixels", text,
                              width_min, height_min, side_max, side_max);
    out->width = width;
    out->height = height;
    return LW_OK;
}

enum lw_status lw_measure_options_finish(const struct lw_measure_options_raw *raw, const char *scene,
                                         uint32_t width_min, uint32_t height_min, uint32_t samples_divisor,
                                         struct lw_measure_options *out, struct lw_error *err) {
    struct lw_measure_options o = raw->options;
    if (!o.folder)
        return lw_status_fail(err, LW_USAGE, "-o DIR is missing: where the tables and the report go");
    o.scene.path = scene;
    o.motion = (enum lw_scene_motion)raw->motion;
    o.bounces = (uint32_t)raw->bounces;
    o.seed = (uint32_t)raw->seed;
    o.repeats = (uint32_t)raw->repeats;
    o.reference_samples =
        ((uint32_t)raw->reference_samples + samples_divisor - 1) / samples_divisor * samples_divisor;
    enum lw_status status = read_size(raw->size, width_min, height_min, &o, err);
    if (status == LW_OK) *out = o;
    return status;
}

/* Exactly one of the outputs is there: counts, which are whole, or numbers. */
static enum lw_status read_list(const struct lw_measure_options_list *list, const char *text,
                                uint32_t *out_whole, double *out_any, uint32_t *out_count,
                                struct lw_error *err) {
    double last = 0;
    uint32_t count = 0;
    for (const char *at = text;; at++) {
        char *end;
        const double value = strtod(at, &end);
        /* strtod() takes blanks, hexadecimal digits and names, too */
        const size_t length = strspn(at, out_whole ? "0123456789" : "0123456789.e-");
        if (!length || end != at + length || (*end && *end != ','))
            return lw_status_fail(err, LW_USAGE, "%s: \"%s\" is no list of %s", list->option, text,
                                  out_whole ? "counts such as 1,2,4" : "numbers such as 0.5,1,2");
        if (!(value >= list->min && value <= list->max))
            return lw_status_fail(err, LW_USAGE, "%s: %.*s is not within %g..%g", list->option,
                                  (int)(end - at), at, list->min, list->max);
        if (list->grows && count && value <= last)
            return lw_status_fail(err, LW_USAGE, "%s: the numbers must grow", list->option);
        if (count == list->count_max)
            return lw_status_fail(err, LW_USAGE, "%s: over %u numbers", list->option, list->count_max);
        if (out_whole) out_whole[count] = (uint32_t)value;
        if (out_any) out_any[count] = value;
        last = value;
        count++;
        at = end;
        if (!*at) break;
    }
    *out_count = count;
    return LW_OK;
}

enum lw_status lw_measure_options_read_counts(const struct lw_measure_options_list *list, const char *text,
                                              uint32_t *out_value, uint32_t *out_count,
                                              struct lw_error *err) {
    return read_list(list, text, out_value, NULL, out_count, err);
}

enum lw_status lw_measure_options_read_numbers(const struct lw_measure_options_list *list, const char *text,
                                               double *out_value, uint32_t *out_count, struct lw_error *err) {
    return read_list(list, text, NULL, out_value, out_count, err);
}
