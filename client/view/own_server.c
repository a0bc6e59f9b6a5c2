#include "client/view/own_server.h"

#include "common/builtin/builtin.h"
#include "common/clock.h"
#include "common/folders.h"
#include "common/program_path.h"

#include <assert.h>
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
    const struct lw_scene_open *open;
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

/* What lightwelld is called with. */
struct command {
    char program[PATH_MAX];
    const char *word[40];
    char number[8][64]; /* that words point to */
    unsigned count, numbers;
};

static void add(struct command *c, const char *option, const char *value) {
    assert(c->count + 3 <= sizeof c->word / sizeof *c->word);
    c->word[c->count++] = option;
    if (value) c->word[c->count++] = value;
}

static void add_number(struct command *c, const char *option, double value) {
    assert(c->numbers < sizeof c->number / sizeof *c->number);
    char *text = c->number[c->numbers++];
    snprintf(text, sizeof *c->number, "%.17g", value);
    add(c, option, text);
}

static void make_command(struct command *c, const struct lw_own_server *s) {
    const struct lw_scene_open *open = s->open;
    c->count = c->numbers = 0;
    lw_program_path("lightwelld", c->program, sizeof c->program);
    add(c, c->program, open->path);
    add(c, "--listen", "127.0.0.1:0");
    add(c, "--port-file", s->port_file);
    add(c, "--log-format", "text");
    add(c, "--http", "none"); /* it is for this viewer */
    add(c, "--plain-sky", NULL);
    if (open->texels_per_metre > 0) add_number(c, "--texels-per-metre", open->texels_per_metre);
    if (open->density_of) add(c, "--density-of", open->density_of);
    if (open->texels_max > 0) add_number(c, "--max-texels", (double)open->texels_max);
    if (open->atlas_side_max > 0) add_number(c, "--atlas-max", (double)open->atlas_side_max);
    if (open->threads > 0) add_number(c, "--threads", (double)open->threads);
    if (open->import_seconds > 0) add_number(c, "--import-seconds", open->import_seconds);
    if (open->picture_texels > 0) add_number(c, "--picture-texels", (double)open->picture_texels);
    if (open->materials == LW_IMPORT_SPAWN_MATT) add(c, "--materials", "matt");
    if (open->environment) add(c, "--environment", open->environment);
    if (open->sun_angle_given) add_number(c, "--sun-angle", open->sun_angle_deg);
    if (open->sky_given) {
        char *text = c->number[c->numbers++];
        snprintf(text, sizeof *c->number, "%.9g,%.9g,%.9g", (double)open->sky[0], (double)open->sky[1],
                 (double)open->sky[2]);
        add(c, "--sky", text);
    }
    c->word[c->count] = NULL;
}

static enum lw_status spawn(struct lw_own_server *s, struct lw_error *err) {
    struct command command;
    int failure[2], error = 0;
    make_command(&command, s);
    if (pipe2(failure, O_CLOEXEC) < 0)
        return lw_status_fail(err, LW_OS, "cannot make a pipe: %s", strerror(errno));
    const pid_t parent = getpid(), pid = fork();
    if (pid == 0) become(command.program, (char *const *)command.word, failure[1], parent);
    if (pid < 0) error = errno;
    close(failure[1]);
    while (pid > 0 && read(failure[0], &error, sizeof error) < 0 && errno == EINTR) continue;
    close(failure[0]);
    if (pid > 0 && error) waitpid(pid, NULL, 0);
    if (error) return lw_status_fail(err, LW_OS, "cannot start %.300s: %s", command.program, strerror(error));
    s->pid = pid;
    return LW_OK;
}

static bool has_ended(struct lw_own_server *s) {
    if (s->pid && waitpid(s->pid, NULL, WNOHANG) == s->pid) s->pid = 0;
    return s->pid == 0;
}

enum lw_status lw_own_server_poll(struct lw_own_server *s, uint16_t *out_port, struct lw_error *err) {
    FILE *file = fopen(s->port_file, "re");
    unsigned port = 0;
    if (file) {
        if (fscanf(file, "%u", &port) != 1) port = 0;
        fclose(file);
    }
    if (!port && has_ended(s))
        return lw_status_fail(err, LW_UNAVAILABLE, "%.200s is not lit: its server has ended", s->open->path);
    *out_port = (uint16_t)port;
    return LW_OK;
}

enum lw_status lw_own_server_wait(struct lw_own_server *s, uint16_t *out_port, struct lw_error *err) {
    uint16_t port = 0;
    for (;;) {
        enum lw_status status = lw_own_server_poll(s, &port, err);
        if (status != LW_OK) return status;
        if (port) break;
        nanosleep(&(struct timespec){.tv_nsec = POLL_NS}, NULL);
    }
    *out_port = port;
    return LW_OK;
}

enum lw_status lw_own_server_start(const struct lw_scene_open *open, struct lw_own_server **out_server,
                                   struct lw_error *err) {
    const char *scene = open->path;
    if (strncmp(scene, LW_BUILTIN_PREFIX, strlen(LW_BUILTIN_PREFIX)) != 0 && access(scene, R_OK) != 0)
        return lw_status_fail(err, LW_NO_INPUT, "cannot open \"%.300s\": %s", scene, strerror(errno));
    struct lw_own_server *s = calloc(1, sizeof *s);
    if (s == NULL) return lw_status_fail(err, LW_NO_MEMORY, "no memory for a server");
    s->open = open;
    enum lw_status status = make_port_file(s, err);
    if (status == LW_OK) status = spawn(s, err);
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
