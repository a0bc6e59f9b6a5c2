#include "client/view/local_server.h"

#include "common/base/clock.h"
#include "common/base/folders.h"
#include "common/base/program_path.h"

#include <assert.h>
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#define STOP_NS 5000000000ull
#define POLL_NS 5000000l

/* ---- the command line ---- */

enum lw_status lw_local_server_init(struct lw_local_server *s, const char *scene, struct lw_error *err) {
    *s = (struct lw_local_server){.pid = 0};
    lw_program_path("lightwelld", s->program, sizeof s->program);
    snprintf(s->port_file, sizeof s->port_file, "%s/lightwell-port-XXXXXX", lw_folders_temporary());
    const int file = mkstemp(s->port_file);
    if (file < 0) {
        s->port_file[0] = 0;
        return lw_status_fail(err, LW_CANNOT_CREATE, "cannot create a temporary file: %s", strerror(errno));
    }
    close(file);
    lw_local_server_option(s, s->program, scene);
    lw_local_server_option(s, "--listen", "127.0.0.1:0");
    lw_local_server_option(s, "--port-file", s->port_file);
    lw_local_server_option(s, "--http", "none");
    return LW_OK;
}

void lw_local_server_option(struct lw_local_server *s, const char *option, const char *value) {
    assert(s->words + 3 <= LW_LOCAL_SERVER_WORDS_MAX); /* NULL ends them */
    s->word[s->words++] = option;
    if (value) s->word[s->words++] = value;
}

void lw_local_server_number(struct lw_local_server *s, const char *option, double value) {
    assert(s->numbers < LW_LOCAL_SERVER_NUMBERS_MAX);
    char *text = s->number[s->numbers++];
    snprintf(text, sizeof *s->number, "%.17g", value);
    lw_local_server_option(s, option, text);
}

/* ---- the process ---- */

/* In the child; what fails goes to `failure`. Only what signal handlers may call: other threads may hold any
 * lock. */
static _Noreturn void become(const struct lw_local_server *s, const int from[3], int failure, pid_t parent) {
    setpgid(0, 0);                     /* Ctrl-C is for our parent, who ends us when its work is kept */
    prctl(PR_SET_PDEATHSIG, SIGTERM);  /* whatever ends it, if only SIGKILL */
    if (getppid() != parent) _exit(1); /* it ended before */
    bool good = true;
    for (int to = 0; to < 3; to++) good = good && (from[to] < 0 || dup2(from[to], to) >= 0);
    if (good) execvp(s->program, (char *const *)s->word);
    const int error = errno;
    (void)!write(failure, &error, sizeof error);
    _exit(1);
}

/* posix_spawn() cannot bind the child's life to ours. */
enum lw_status lw_local_server_start(struct lw_local_server *s, int in, int out, int log,
                                     struct lw_error *err) {
    int failure[2], error = 0;
    if (pipe2(failure, O_CLOEXEC) < 0)
        return lw_status_fail(err, LW_OS, "cannot make a pipe: %s", strerror(errno));
    const pid_t parent = getpid(), pid = fork();
    if (pid == 0) become(s, (const int[]){in, out, log}, failure[1], parent);
    if (pid < 0) error = errno;
    close(failure[1]);
    while (pid > 0 && read(failure[0], &error, sizeof error) < 0 && errno == EINTR) continue;
    close(failure[0]);
    if (pid > 0 && error) waitpid(pid, NULL, 0);
    if (error) return lw_status_fail(err, LW_OS, "cannot start %.300s: %s", s->program, strerror(error));
    s->pid = pid;
    return LW_OK;
}

uint16_t lw_local_server_port(const struct lw_local_server *s) {
    FILE *file = fopen(s->port_file, "re");
    unsigned port = 0;
    if (file && fscanf(file, "%u", &port) != 1) port = 0;
    if (file) fclose(file);
    return (uint16_t)port;
}

bool lw_local_server_has_ended(struct lw_local_server *s) {
    if (s->pid && waitpid(s->pid, NULL, WNOHANG) == s->pid) s->pid = 0;
    return s->pid == 0;
}

void lw_local_server_finish(struct lw_local_server *s) {
    if (s->pid) kill(s->pid, SIGTERM);
    for (const uint64_t end_ns = lw_clock_ns() + STOP_NS; !lw_local_server_has_ended(s);) {
        if (lw_clock_ns() > end_ns) {
            kill(s->pid, SIGKILL);
            waitpid(s->pid, NULL, 0);
            break;
        }
        nanosleep(&(struct timespec){.tv_nsec = POLL_NS}, NULL);
    }
    if (s->port_file[0]) unlink(s->port_file);
    *s = (struct lw_local_server){.pid = 0};
}
