/* process.h: our programs as a test runs them: beside the test's own program, with a time limit, stopped by
 * pid. Whatever a test leaves running is killed when its process ends, however that comes about. */
#ifndef LW_TESTS_PROCESS_H
#define LW_TESTS_PROCESS_H

#include "tests/support/support.h"

#include <stdbool.h>
#include <sys/types.h>

/** Seconds after which a test gives up a wait. It ends what hangs and judges nothing. It is under the time
 * limit of a test, so that the test can say what it waited for. */
#define LW_PROCESS_LIMIT_S 550u

/** A program that was started. Its output goes to files of the test's own folder. */
struct lw_process {
    pid_t pid; /* 0: it ended and was waited for */
    char out[128], err[128];
    char port_file[128]; /* lw_process_serve() only */
    uint16_t port;       /* lw_process_serve() only */
    const char *host;    /* the test's to set: where it listens; NULL: 127.0.0.1 */
    int in;              /* lw_process_serve_by_hand() only, until its end */
};

/** Starts a program of the build, or of the system by its whole path; `arguments` are words separated by
 * blanks. It finds no display but
 * lw_process_set_display()'s; $TMPDIR is lw_support_temporary("tmp"), made if it is not there,
 * $XDG_CACHE_HOME lw_support_temporary("caches"), and $LIGHTWELL_LOG_FORMAT text unless the test has set it.
 * Ends the test where it cannot be started. */
void lw_process_start(struct lw_process *process, const char *program, const char *arguments);

/** Path of a file beside the test's own program. */
void lw_process_find(char *path, size_t size, const char *file);

/** Path of the atrium's package, at half a texel a metre. The build makes it once: to unwrap the atrium takes
 * longer than to light it. */
const char *lw_process_atrium(void);

/** The display that programs find from now on; NULL, as at first: none. */
void lw_process_set_display(const char *display);

/** Starts lightwelld on a free port of 127.0.0.1, or on a --listen among the arguments, and waits until it
 * serves. Ends the test where the daemon ends instead. */
void lw_process_serve(struct lw_process *process, const char *arguments);

/** The same under --clock manual: frames come when lw_process_step() asks for them. */
void lw_process_serve_by_hand(struct lw_process *process, const char *arguments);
void lw_process_step(struct lw_process *process, unsigned frames);

/** Whether it has not ended yet. */
bool lw_process_runs(struct lw_process *process);

/** Waits for its end and returns its exit code, or minus the number of the signal that ended it. Ends the
 * test after limit_s. */
int lw_process_finish(struct lw_process *process, unsigned limit_s);

/** Waits until a condition holds. It is asked at first, each time that a program writes to its output or that
 * a file of the folder of lw_support_temporary() is made, renamed or removed, at the program's end, and each
 * 20 ms for what gives no event. The functions below wait the same way. False: the program has ended, and the
 * condition does not hold. */
bool lw_process_await(struct lw_process *process, bool (*is_so)(void *context), void *context);

/** Waits for a file in that folder. */
bool lw_process_await_file(struct lw_process *process, const char *path);

/** Waits until this stands on its stderr; ends the test where the program ends without it. */
void lw_process_await_text(struct lw_process *process, const char *text);

/** The same, until it stands there `times` times. */
void lw_process_await_texts(struct lw_process *process, const char *text, unsigned times);

/** A child of the process, or 0. */
pid_t lw_process_child_of(pid_t parent);

/** Its memory in use, or the test ends. */
long lw_process_resident_kb(pid_t pid);

/** Waits for `count` more frames of a lightwelld --json. */
void lw_process_await_frames(struct lw_process *process, unsigned count);

/** Sends a signal and finishes. */
int lw_process_stop(struct lw_process *process, int signal_number, unsigned limit_s);

/** Kills and forgets all that still run, and what they left in $TMPDIR: for a teardown after a test that
 * failed. */
void lw_process_kill_all(void);

/** A cmocka teardown that does the same. */
int lw_process_teardown(void **state);

/** Ends the test with what the program said on stderr unless it ended with the expected exit code. */
void lw_process_expect(const struct lw_process *process, int code, int expected);

/** Runs a program to its end. Ends the test with what it said on stderr unless its exit code is as expected.
 */
void lw_process_run(struct lw_process *process, const char *program, const char *arguments, int expected);

/** Ends a program by SIGTERM. Ends the test with what it said unless its exit code is 0. */
void lw_process_end(struct lw_process *process);

/** Runs a program to its end. Ends the test unless its exit code is as expected and it said one line on
 * stderr that contains `text`. */
void lw_process_refuses(const char *program, const char *arguments, int expected, const char *text,
                        unsigned limit_s);

/** The MB that light takes at least, as a lightwelld with --memory 1 says that refuses to start. */
unsigned lw_process_needed_mb(const char *arguments);

/** Its text so far on stdout, on stderr; the caller frees. */
char *lw_process_out(const struct lw_process *process);
char *lw_process_err(const struct lw_process *process);

/** Whether this stands on its stderr. */
bool lw_process_said(const struct lw_process *process, const char *text);

/** The number under a key of a line of JSON, or ends the test: there is none. */
double lw_process_number(const char *line, const char *key);

/** The same of the newest whole line on stdout, as lightwelld --json prints one a frame. Waits for the
 * first. */
double lw_process_newest(const struct lw_process *process, const char *key);

/** Ends the test unless nothing is left in the programs' $TMPDIR. */
void lw_process_left_nothing(void);

/** Sleeps. */
void lw_process_sleep_ms(unsigned ms);

#endif
