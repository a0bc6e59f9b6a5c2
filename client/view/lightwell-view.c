#include "client/view/export.h"
#include "client/view/headless.h"
#include "client/view/own_server.h"
#include "client/view/path_command.h"
#include "client/view/view_options.h"
#include "client/view/window/window.h"
#include "common/base/interrupt.h"
#include "common/base/log.h"
#include "common/base/wait_policy.h"

int main(int argc, char **argv) {
    lw_log_init("lightwell-view", LW_LOG_INFO);
    lw_wait_passively(argv);
    struct lw_view_options options;
    struct lw_error err = {0};
    bool done = false, stopped = false;
    enum lw_status status = lw_view_options_parse(argc, argv, &options, &done, &err);
    struct lw_own_server *server = NULL;
    /* a window starts the server of its scene itself, to show that it imports */
    const bool own = status == LW_OK && !done && options.scene && options.headless;
    if (own) status = lw_export_check(&options, &err);
    if (own && status == LW_OK) status = lw_own_server_start(&options.own, &server, &err);
    if (own && status == LW_OK) status = lw_own_server_wait(server, &options.port, &err);
    if (status == LW_OK && !done)
        status = options.path.open.path ? lw_path_command_run(&options, &stopped, &err)
                 : options.headless     ? lw_headless_run(&options, &stopped, &err)
                                        : lw_window_run(&options, &err);
    lw_own_server_stop(server);
    if (status != LW_OK) return lw_log_failure(&err);
    return stopped ? LW_INTERRUPT_EXIT_CODE : 0;
}
