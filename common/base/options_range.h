/* options_range.h: the range of a number that an option takes.
 * Flow:    struct lw_option -> [options_range] -> options, options_manual
 * Threads: [any]. */
#ifndef LW_COMMON_BASE_OPTIONS_RANGE_H
#define LW_COMMON_BASE_OPTIONS_RANGE_H

#include "common/base/options.h"

/** A bound as a whole number, cut off at the ends of int64_t. */
int64_t lw_options_range_bound(double bound);

/** Text of the range, as errors have it: "from 1 to 16". */
void lw_options_range_write(const struct lw_option *option, char *out, size_t out_size);

/** The same for --help and the manual: it says where a real number may be inf. */
void lw_options_range_help(const struct lw_option *option, char *out, size_t out_size);

#endif
