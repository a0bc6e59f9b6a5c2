#include "client/view/own_server.h"

#include "common/builtin/builtin.h"
#include "common/clock.h"
#include "common/folders.h"
#include "common/program_path.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#define STOP_NS 5000000000ull
#define POLL_NS 20000000l

struct lw_own_server {
    pid_t pid;
    char port_file[PATH_MAX];
};

static enum lw_status make_port_file(struct lw_own_server *s, struct lw_error *err) {
    snprintf(s->port_file, sizeof s->port_file, "%s/lightwell-port-XXXXXX", lw_folders_temporary());
    const int file = mkstemp(s->port_file);
    if (file < 0) {
        s->port_file[0] = '\0';
        return lw_status_fail(err, LW_CANNOT_CREATE, "cannot create a temporary file: %s", strerror(errno));
    }
    close(file);
    return LW_OK;
}

/* In the child, with what signal handlers may call alone. Its stdout is not ours, which may be a report. */
static _Noreturn void become(const char *program, char *const *arguments, int failure, pid_t parent) {
    setpgid(0, 0);
    prctl(PR_SET_PDEATHSIG, SIGTERM);
    if (getppid() != parent) _exit(1); /* it has ended before */
    if (dup2(STDERR_FILENO, STDOUT_FILENO) >= 0) execvp(program, arguments);
    const int error = errno;
    (void)!write(failure, &error, sizeof error);
    _exit(1);
}

static enum lw_status spawn(struct lw_own_server *s, const char *scene, struct lw_error *err) {
    char program[PATH_MAX];
    int failure[2], error = 0;
    lw_program_path("lightwelld", program, sizeof program);
    const char *const arguments[] = {program, scene,         "--listen",   "127.0.0.1:0", "--log-format",
                                     "text",  "--port-file", s->port_file, NULL};
    if (pipe2(failure, O_CLOEXEC) < 0)
        return lw_status_fail(err, LW_OS, "cannot make a pipe: %s", strerror(errno));
    const pid_t parent = getpid(), pid = fork();
    if (pid == 0) become(program, (char *const *)arguments, failure[1], parent);
    if (pid < 0) error = errno;
    close(failure[1]);
    while (pid > 0 && read(failure[0], &error, sizeof error) < 0 && errno == EINTR) continue;
    close(failure[0]);
    if (pid > 0 && error) waitpid(pid, NULL, 0);
    if (error) return lw_status_fail(err, LW_OS, "cannot start %.300s: %s", program, strerror(error));
    s->pid = pid;
    return LW_OK;
}

static bool has_ended(struct lw_own_server *s) {
    if (s->pid && waitpid(s->pid, NULL, WNOHANG) == s->pid) s->pid = 0;
    return s->pid == 0;
}

/* As long as it takes to import the scene; it says how far it is. */
static enum lw_status await_port(struct lw_own_server *s, const char *scene, uint16_t *out_port,
                                 struct lw_error *err) {
    for (;;) {
        FILE *file = fopen(s->port_file, "re");
        unsigned port = 0;
        if (file) {
            if (fscanf(file, "%u", &port) != 1) port = 0;
            fclose(file);
        }
        if (port) {
            *out_port = (uint16_t)port;
            return LW_OK;
        }
        if (has_ended(s))
            return lw_status_fail(err, LW_UNAVAILABLE, "%.200s is not lit: its server has ended", scene);
        nanosleep(&(struct timespec){.tv_nsec = POLL_NS}, NULL);
    }
}

enum lw_status lw_own_server_start(const char *scene, struct lw_own_server **out_server, uint16_t *out_port,
                                   struct lw_error *err) {
    if (strncmp(scene, LW_BUILTIN_PREFIX, strlen(LW_BUILTIN_PREFIX)) != 0 && access(scene, R_OK) != 0)
        return lw_status_fail(err, LW_NO_INPUT, "cannot open \"%.300s\": %s", scene, strerror(errno));
    struct lw_own_server *s = calloc(1, sizeof *s);
    if (s == NULL) return lw_status_fail(err, LW_NO_MEMORY, "no memory for a server");
    enum lw_status status = make_port_file(s, err);
    if (status == LW_OK) status = spawn(s, scene, err);
    if (status == LW_OK) status = await_port(s, scene, out_port, err);
    if (status == LW_OK)
        *out_server = s;
    else
        lw_own_server_stop(s);
    return status;
}

void lw_own_server_stop(struct lw_own_server *s) {
    if (s == NULL) return;
    if (s->pid) kill(s->pid, SIGTERM);
    for (const uint64_t end_ns = lw_clock_ns() + STOP_NS; !has_ended(s);) {
        if (lw_clock_ns() > end_ns) {
            kill(s->pid, SIGKILL);
            waitpid(s->pid, NULL, 0);
            break;
        }
        nanosleep(&(struct timespec){.tv_nsec = POLL_NS}, NULL);
    }
    if (s->port_file[0]) unlink(s->port_file);
    free(s);
}
