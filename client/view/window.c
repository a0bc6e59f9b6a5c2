#include "client/view/window.h"
enum lw_status lw_window_run(const struct lw_view_options *options, struct lw_error *err) {
    (void)options;
    return lw_status_fail(err, LW_UNAVAILABLE, "no display: use --headless");
}
