/* live_case.h: what the tests of lightwell.h share: one handle, its last error, and its end. For the one file
 * of a test program. */
#ifndef LW_TESTS_LIVE_CASE_H
#define LW_TESTS_LIVE_CASE_H

#include "client/include/lightwell/lightwell.h"
#include "common/base/clock.h"
#include "tests/support/process.h"
#include "tests/support/support.h"

#include <math.h>
#include <string.h>

#define LIMIT_S  LW_PROCESS_LIMIT_S
#define LIMIT_NS (LIMIT_S * 1000000000ull)

static struct lw_live *live;
static struct lw_live_error err;

static inline int end_all(void **state) {
    (void)state;
    lw_live_close(live);
    live = NULL;
    lw_process_kill_all();
    return 0;
}

static inline void ok(enum lw_live_status status) {
    if (status != LW_LIVE_OK) fail_msg("%s: %s", lw_live_status_text(status), err.text);
}

static inline void fails(enum lw_live_status status, enum lw_live_status expected, const char *text) {
    assert_int_equal(status, expected);
    assert_int_equal(err.status, expected);
    if (!strstr(err.text, text)) fail_msg("\"%s\" does not say \"%s\"", err.text, text);
    err = (struct lw_live_error){0};
}

static inline struct lw_live_stats stats(void) {
    struct lw_live_stats s = {.struct_size = sizeof s};
    ok(lw_live_get_stats(live, &s, &err));
    return s;
}

/** Opens it, and waits for light. */
static inline void open_with(const struct lw_live_desc *desc) {
    ok(lw_live_open(desc, &live, &err));
    const uint64_t end_ns = lw_clock_ns() + LIMIT_NS;
    while (!stats().has_light || !stats().settled_frame) {
        assert_true(lw_clock_ns() < end_ns);
        ok(lw_live_poll(live, 20, &err));
    }
}

/* Column by column, as OpenGL's. */
static inline struct lw_live_view view_of(const struct lw_live_camera *c, uint32_t width, uint32_t height) {
    const float up = 1 / tanf(c->fov_y / 2), right = up * (float)height / (float)width;
    struct lw_live_view view = {.struct_size = sizeof view, .width = width, .height = height};
    const float *axis[4] = {c->right_ws, c->up_ws, c->forward_ws, c->forward_ws},
                scale[4] = {right, up, 1, 1};
    for (int r = 0; r < 4; r++) {
        float at = 0;
        for (int k = 0; k < 3; k++) {
            view.view_projection[4 * k + r] = scale[r] * axis[r][k];
            at -= axis[r][k] * c->position_ws[k];
        }
        view.view_projection[12 + r] = scale[r] * at;
    }
    return view;
}

#endif
