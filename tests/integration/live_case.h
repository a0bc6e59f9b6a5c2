/* live_case.h: what the tests of lightwell.h share: one handle, its last error, and its end. For the one file
 * of a test program. */
#ifndef LW_TESTS_LIVE_CASE_H
#define LW_TESTS_LIVE_CASE_H

#include "client/include/lightwell/lightwell.h"
#include "common/base/clock.h"
#include "tests/support/process.h"
#include "tests/support/support.h"

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

#endif
