/* path_command.h: lightwell-view --path-trace: one view, worked out without a server.
 * Flow:    options -> scene, pose, lights -> path_trace, until enough -> file, report on stdout
 * Threads: main() only. */
#ifndef LW_CLIENT_VIEW_PATH_COMMAND_H
#define LW_CLIENT_VIEW_PATH_COMMAND_H

#include "client/view/view_options.h"

/** Opens the scene, path traces the view, writes it. The first SIGINT or SIGTERM ends the tracing
 * (interrupt.h): the samples that every pixel has are written. Before the first sample it may end the program
 * at once.
 * out_stopped  whether a signal kept it from taking all samples
 * Errors       LW_CANNOT_CREATE before anything else is done; as lw_scene_open(); LW_USAGE for an unknown
 *              camera; the image
 *              writer's */
LW_MUST_CHECK enum lw_status lw_path_command_run(const struct lw_view_options *options, bool *out_stopped,
                                                 struct lw_error *err);

#endif
