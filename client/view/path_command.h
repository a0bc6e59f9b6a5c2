/* path_command.h: lightwell-view --path-trace: one view, worked out without a server.
 * Flow:    options -> scene, pose, lights -> path_trace, until enough -> file, report on stdout
 * Threads: main() only. */
#ifndef LW_CLIENT_VIEW_PATH_COMMAND_H
#define LW_CLIENT_VIEW_PATH_COMMAND_H

#include "client/view/view_options.h"

/** Opens the scene, path traces the view, writes it. The first SIGINT or SIGTERM ends the tracing: what is done by then is
 * written; the second ends the program.
 * Errors: as lw_scene_open(); LW_USAGE for an unknown camera; LW_CLOSED if stopped before the first sample; the image
 * writer's. */
LW_MUST_CHECK enum lw_status lw_path_command_run(const struct lw_view_options *options, struct lw_error *err);

#endif
