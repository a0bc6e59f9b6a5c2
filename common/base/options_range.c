#include "common/base/options_range.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>

int64_t lw_options_range_bound(double bound) {
    /* (double)INT64_MAX rounds up to 2^63, which does not convert back */
    if (bound >= 0x1p63) return INT64_MAX;
    return bound <= -0x1p63 ? INT64_MIN : (int64_t)bound;
}

static void write_number(char *out, size_t out_size, double value) {
    bool whole = value == floor(value) && fabs(value) < 1e15;
    snprintf(out, out_size, whole ? "%.0f" : "%.7g", value);
}

void lw_options_range_write(const struct lw_option *o, char *out, size_t out_size) {
    char min[32], max[32];
    write_number(min, sizeof min, o->min);
    write_number(max, sizeof max, o->max);
    if (o->kind == LW_OPTION_INT)
        snprintf(out, out_size, "from %" PRId64 " to %" PRId64, lw_options_range_bound(o->min),
                 lw_options_range_bound(o->max));
    else if (isinf(o->min) && isinf(o->max))
        snprintf(out, out_size, "of any size");
    else if (isinf(o->max))
        snprintf(out, out_size, "from %s up", min);
    else if (isinf(o->min))
        snprintf(out, out_size, "up to %s", max);
    else
        snprintf(out, out_size, "from %s to %s", min, max);
}

void lw_options_range_help(const struct lw_option *o, char *out, size_t out_size) {
    char range[96];
    lw_options_range_write(o, range, sizeof range);
    snprintf(out, out_size, "%s%s", range, o->kind == LW_OPTION_REAL && isinf(o->max) ? ", or inf" : "");
}
