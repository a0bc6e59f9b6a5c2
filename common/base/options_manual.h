/* options_manual.h: what a table of options also gives: a manual page and completion for bash, at build time.
 * Flow:    struct lw_options -> PROGRAM --help=man, --help=bash -> stdout -> `make install`
 * Threads: main() only. */
#ifndef LW_COMMON_BASE_OPTIONS_MANUAL_H
#define LW_COMMON_BASE_OPTIONS_MANUAL_H

#include "common/base/options.h"

/** Prints a manual page (troff, section 1). A program "lightwell-load scaling" has the
 * page lightwell-load-scaling. */
void lw_options_manual_page(const struct lw_options *options);

/** Prints a function for bash that completes options, their choices and files: _lightwell_load_scaling for a
 * program "lightwell-load scaling". The main() of "lightwell-load" calls it for its own first word. */
void lw_options_manual_bash(const struct lw_options *options);

#endif
