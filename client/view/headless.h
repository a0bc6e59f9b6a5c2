/* headless.h: one view, rendered to a file.
 * Flow:    options -> client -> wait for the light -> compose -> tonemap -> file, report on stdout
 * Threads: main() only. */
#ifndef LW_CLIENT_VIEW_HEADLESS_H
#define LW_CLIENT_VIEW_HEADLESS_H

#include "client/view/view_options.h"

/** Connects, waits as the options say, renders, writes. The first SIGINT or SIGTERM ends the wait
 * (interrupt.h): the current picture is written if some of its light has come. Before any light it ends the
 * program at once.
 * out_stopped  whether a signal ended the wait.
 * Errors: LW_CANNOT_CREATE before anything else is done; the client's; LW_TIMED_OUT, naming the missing part;
 * LW_USAGE for an unknown camera; the image writer's. */
LW_MUST_CHECK enum lw_status lw_headless_run(const struct lw_view_options *options, bool *out_stopped,
                                             struct lw_error *err);

#endif
