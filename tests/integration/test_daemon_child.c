/* The lightwelld that lightwell-load starts ends with it, whatever ends that. */
#include "tests/support/process.h"

#include "client/measure/sides/daemon_child.h"
#include "common/base/clock.h"

#include <errno.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#define LIMIT_S LW_PROCESS_LIMIT_S

static char package[256];
static bool parent_is_gone;

pid_t __real_getppid(void);
pid_t __wrap_getppid(void);
pid_t __wrap_getppid(void) { return parent_is_gone ? 1 : __real_getppid(); }

static int set_up(void **state) {
    (void)state;
    struct lw_process import;
    char arguments[400];
    snprintf(package, sizeof package, "%s", lw_support_temporary("scene.lwscene"));
    snprintf(arguments, sizeof arguments, "--texels-per-metre 6 -o %s builtin:cornell", package);
    lw_process_start(&import, "lightwell-import", arguments);
    assert_int_equal(lw_process_finish(&import, LIMIT_S), 0);
    setenv("TMPDIR", lw_support_temporary("tmp"), 1);
    /* an orphan becomes our child: so its end can be waited for */
    return prctl(PR_SET_CHILD_SUBREAPER, 1);
}

static struct lw_daemon_child_desc desc_of(bool real_clock) {
    return (struct lw_daemon_child_desc){.package = package,
                                         .bounces = 1,
                                         .direct_samples = 1,
                                         .indirect_samples = 1,
                                         .target_error = 1e-6,
                                         .threads = 1,
                                         .real_clock = real_clock};
}

/* A process that has started a server, and does nothing else. */
static pid_t start_owner(bool real_clock) {
    int ready[2];
    char byte = 0;
    assert_int_equal(pipe(ready), 0);
    const pid_t parent = getpid(), owner = fork();
    assert_true(owner >= 0);
    if (owner == 0) {
        const struct lw_daemon_child_desc desc = desc_of(real_clock);
        struct lw_daemon_child *child;
        prctl(PR_SET_PDEATHSIG, SIGKILL);
        if (getppid() != parent || lw_daemon_child_start(&desc, &child, NULL) != LW_OK ||
            write(ready[1], "+", 1) != 1)
            _exit(1);
        for (;;) pause();
    }
    close(ready[1]);
    if (read(ready[0], &byte, 1) != 1) fail_msg("there is no server");
    close(ready[0]);
    return owner;
}

static pid_t only_child_of(pid_t process) {
    char path[64];
    int child = 0;
    snprintf(path, sizeof path, "/proc/%d/task/%d/children", process, process);
    FILE *file = fopen(path, "re");
    if (!file || fscanf(file, "%d", &child) != 1) child = 0;
    if (file) fclose(file);
    assert_true(child > 1);
    return child;
}

static void expect_end(pid_t process) {
    struct lw_process server = {.pid = process};
    assert_int_equal(lw_process_finish(&server, LIMIT_S), 0); /* in order */
}

static void ends_with_who_is_killed(bool real_clock) {
    const pid_t owner = start_owner(real_clock), server = only_child_of(owner);
    assert_int_equal(kill(owner, SIGKILL), 0);
    assert_int_equal(waitpid(owner, NULL, 0), owner);
    expect_end(server);
    lw_process_left_nothing();
}

static void ends_under_the_real_clock(void **state) {
    (void)state;
    ends_with_who_is_killed(true);
}

static void ends_step_by_step(void **state) {
    (void)state;
    ends_with_who_is_killed(false);
}

/* The parent may end between the fork and the child's request for its signal. */
static void does_not_start_for_who_is_gone(void **state) {
    (void)state;
    const struct lw_daemon_child_desc desc = desc_of(true);
    struct lw_daemon_child *child = NULL;
    struct lw_error err = {0};
    parent_is_gone = true;
    enum lw_status status = lw_daemon_child_start(&desc, &child, &err);
    parent_is_gone = false;
    lw_daemon_child_stop(child);
    assert_int_equal(status, LW_OS);
    assert_non_null(strstr(err.text, "ended before it served"));
    lw_process_left_nothing();
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(ends_under_the_real_clock),
        cmocka_unit_test(ends_step_by_step),
        cmocka_unit_test(does_not_start_for_who_is_gone),
    };
    return cmocka_run_group_tests(tests, set_up, NULL);
}
