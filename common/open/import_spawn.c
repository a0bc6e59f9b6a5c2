#include "common/open/import_spawn.h"

#include "common/base/clock.h"
#include "common/base/folders.h"
#include "common/base/log.h"
#include "common/base/program_path.h"
#include "common/base/sanitizer.h"
#include "common/scene/package.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <poll.h>
#include <spawn.h>
#include <stdio.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#define PROGRAM_NAME  "lightwell-import"
#define PACKAGE_NAME  "scene.lwscene"
#define NOBODY        65534
#define FAILURE_FD    3             /* where the importer writes its failure: its --failure-fd */
#define POLL_MS       50            /* how soon a cancellation is seen */
#define KILL_AFTER_NS 1000000000ull /* between SIGTERM and SIGKILL */

extern char **environ;

/* A running importer and what belongs to it. */
struct importer {
    const struct lw_import_spawn_desc *desc;
    char program[PATH_MAX];
    char folder[PATH_MAX];                        /* temporary; "" before it exists */
    char package[PATH_MAX + sizeof PACKAGE_NAME]; /* in it */
    pid_t pid;                                    /* 0: not running */
    int failure_fd;                               /* read end; -1: none */
    char failure[LW_ERROR_TEXT_SIZE];
    size_t failure_size;
};

/* ---- packages ---- */

static enum lw_status load_package(const struct lw_import_spawn_desc *desc, struct lw_scene **out_scene,
                                   struct lw_error *err) {
    if (desc->texels_per_metre > 0 || desc->density_of || desc->texels_max || desc->atlas_side_max)
        lw_log(LW_LOG_WARNING,
               "%s: a scene package has its lightmap already; --texels-per-metre, --density-of, --max-texels "
               "and --atlas-max are ignored",
               desc->scene);
    const enum lw_status status = lw_package_load(desc->scene, out_scene, err);
    if (!status && desc->materials == LW_IMPORT_SPAWN_MATT) lw_scene_drop_finishes(*out_scene);
    return status;
}

/* ---- the temporary folder ---- */

/* Where we are root, the importer shall be nobody: it becomes the user whose this folder is. */
static enum lw_status make_folder(struct importer *importer, struct lw_error *err) {
    enum lw_status status = lw_folders_make_temporary(importer->folder, sizeof importer->folder, err);
    if (status == LW_OK && geteuid() == 0 && chown(importer->folder, NOBODY, NOBODY) != 0)
        lw_log(LW_LOG_DEBUG, "%s stays root: %s", PROGRAM_NAME, strerror(errno));
    snprintf(importer->package, sizeof importer->package, "%s/%s", importer->folder, PACKAGE_NAME);
    return status;
}

/* ---- starting ---- */

static void find_program(struct importer *importer) {
    if (importer->desc->program)
        snprintf(importer->program, sizeof importer->program, "%s", importer->desc->program);
    else
        lw_program_path(PROGRAM_NAME, importer->program, sizeof importer->program);
}

/* An importer that root has started may already be nobody, and not root's to limit any more: before that, it
 * has limited itself (cage.h). */
static bool has_gone(int error) { return error == ESRCH || (error == EPERM && geteuid() == 0); }

static void limit_memory(const struct importer *importer) {
    uint64_t bytes = importer->desc->memory_max ? importer->desc->memory_max : LW_IMPORT_SPAWN_MEMORY_MAX;
    const struct rlimit limit = {bytes, bytes};
    if (LW_SANITIZER) return; /* a sanitizer's shadow alone reserves terabytes */
    if (prlimit(importer->pid, RLIMIT_AS, &limit, NULL) < 0 && !has_gone(errno))
        lw_log(LW_LOG_WARNING, "cannot limit the memory of %s: %s", PROGRAM_NAME, strerror(errno));
}

static int set_attributes(posix_spawnattr_t *attributes) {
    sigset_t none, defaults;
    sigemptyset(&none);
    sigemptyset(&defaults);
    const int signals[] = {SIGINT, SIGTERM, SIGHUP, SIGPIPE};
    for (size_t i = 0; i < sizeof signals / sizeof *signals; i++) sigaddset(&defaults, signals[i]);
    posix_spawnattr_setsigmask(attributes, &none);
    posix_spawnattr_setsigdefault(attributes, &defaults);
    return posix_spawnattr_setflags(attributes, POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF);
}

static enum lw_status start(struct importer *importer, struct lw_error *err) {
    const struct lw_import_spawn_desc *desc = importer->desc;
    char density[64], most[32], side[32], threads[32], seconds[32], pictures[32], failure[32], level[32],
        environment[PATH_MAX + sizeof "--environment="];
    snprintf(density, sizeof density, "--texels-per-metre=%.9g", desc->texels_per_metre);
    snprintf(most, sizeof most, "--max-texels=%u", desc->texels_max);
    snprintf(side, sizeof side, "--atlas-max=%u", desc->atlas_side_max);
    snprintf(threads, sizeof threads, "--threads=%u", desc->threads);
    snprintf(seconds, sizeof seconds, "--import-seconds=%.9g", desc->import_seconds);
    snprintf(pictures, sizeof pictures, "--picture-texels=%u", desc->picture_texels);
    snprintf(failure, sizeof failure, "--failure-fd=%d", FAILURE_FD);
    if (desc->environment && strlen(desc->environment) >= PATH_MAX)
        return lw_status_fail(err, LW_NO_INPUT, "%.200s...: the path is too long", desc->environment);
    snprintf(environment, sizeof environment, "--environment=%s", desc->environment ? desc->environment : "");
    snprintf(level, sizeof level, "--log-level=%s", lw_log_level_name(lw_log_get_level()));
    const char *arguments[21] = {importer->program, "-o", importer->package, failure};
    size_t count = 4;
    if (lw_log_get_level() != LW_LOG_INFO) arguments[count++] = level;
    if (lw_log_get_format() == LW_LOG_JSON) arguments[count++] = "--log-format=json";
    if (desc->texels_per_metre > 0) arguments[count++] = density;
    if (desc->density_of) {
        arguments[count++] = "--density-of";
        arguments[count++] = desc->density_of;
    }
    if (desc->texels_max) arguments[count++] = most;
    if (desc->atlas_side_max) arguments[count++] = side;
    if (desc->threads) arguments[count++] = threads;
    if (desc->import_seconds > 0) arguments[count++] = seconds;
    if (desc->picture_texels) arguments[count++] = pictures;
    if (desc->materials == LW_IMPORT_SPAWN_MATT) arguments[count++] = "--materials=matt";
    if (desc->environment) arguments[count++] = environment;
    if (desc->lightmap_unused) arguments[count++] = "--lightmap-unused";
    arguments[count++] = "--";
    arguments[count++] = desc->scene;

    int ends[2];
    if (pipe2(ends, O_CLOEXEC) < 0)
        return lw_status_fail(err, LW_OS, "cannot open a pipe: %s", strerror(errno));
    posix_spawn_file_actions_t actions;
    posix_spawnattr_t attributes;
    posix_spawn_file_actions_init(&actions);
    posix_spawnattr_init(&attributes);
    int failed = set_attributes(&attributes);
    if (!failed) failed = posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
    if (!failed) failed = posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, "/dev/null", O_WRONLY, 0);
    if (!failed) failed = posix_spawn_file_actions_adddup2(&actions, ends[1], FAILURE_FD);
    if (!failed)
        failed = posix_spawnp(&importer->pid, importer->program, &actions, &attributes,
                              (char *const *)arguments, environ);
    posix_spawnattr_destroy(&attributes);
    posix_spawn_file_actions_destroy(&actions);
    close(ends[1]);
    importer->failure_fd = ends[0];
    if (failed) {
        importer->pid = 0;
        return lw_status_fail(err, LW_OS, "cannot start %.300s, which reads scenes: %s", importer->program,
                              strerror(failed));
    }
    limit_memory(importer);
    return LW_OK;
}

/* ---- waiting ---- */

/* Reads the bytes of the failure's text that have arrived. False at its end. */
static bool read_failure(struct importer *importer) {
    char rest[256];
    size_t room = sizeof importer->failure - 1 - importer->failure_size;
    ssize_t got = read(importer->failure_fd, room ? importer->failure + importer->failure_size : rest,
                       room ? room : sizeof rest);
    if (got > 0 && room) importer->failure_size += (size_t)got;
    return got > 0 || (got < 0 && (errno == EINTR || errno == EAGAIN));
}

static bool is_cancelled(const struct importer *importer) {
    return importer->desc->cancel && *importer->desc->cancel;
}

/* Waits for the importer's end; SIGTERM, then SIGKILL when cancelled. Returns its wait status, or -1. */
static int wait_for_end(struct importer *importer) {
    bool open = true, asked = false;
    uint64_t asked_ns = 0;
    for (;;) {
        int status;
        pid_t ended = waitpid(importer->pid, &status, WNOHANG);
        if (ended == importer->pid || (ended < 0 && errno != EINTR)) {
            while (open && read_failure(importer)) {
            }
            importer->pid = 0;
            return ended > 0 ? status : -1;
        }
        if (is_cancelled(importer)) {
            if (!asked) {
                kill(importer->pid, SIGTERM);
                asked_ns = lw_clock_ns();
                asked = true;
            } else if (lw_clock_ns() - asked_ns > KILL_AFTER_NS) {
                kill(importer->pid, SIGKILL);
            }
        }
        /* its end closes the pipe and wakes us; after that it is a matter of microseconds */
        struct pollfd end = {.fd = importer->failure_fd, .events = POLLIN};
        if (!open)
            nanosleep(&(struct timespec){.tv_nsec = 1000000}, NULL);
        else if (poll(&end, 1, POLL_MS) > 0)
            open = read_failure(importer);
    }
}

static enum lw_status status_of_exit(int code) {
    for (int status = LW_OK; status < LW_STATUS_COUNT; status++)
        if (lw_status_exit_code((enum lw_status)status) == code) return (enum lw_status)status;
    return LW_INTERNAL;
}

static enum lw_status await_result(struct importer *importer, struct lw_error *err) {
    int ended = wait_for_end(importer);
    if (is_cancelled(importer))
        return lw_status_fail(err, LW_CLOSED, "%s: the import was stopped", importer->desc->scene);
    if (ended < 0)
        return lw_status_fail(err, LW_OS, "%s: lost track of %s", importer->desc->scene, PROGRAM_NAME);
    if (WIFSIGNALED(ended)) {
        int number = WTERMSIG(ended);
        bool asked = number == SIGINT || number == SIGTERM || number == SIGHUP;
        return lw_status_fail(err, asked ? LW_CLOSED : LW_INTERNAL, "%s: %s was ended by signal %d (%s)",
                              importer->desc->scene, PROGRAM_NAME, number, strsignal(number));
    }
    enum lw_status status = status_of_exit(WEXITSTATUS(ended));
    if (status == LW_OK) return LW_OK;
    importer->failure[importer->failure_size] = 0;
    importer->failure[strcspn(importer->failure, "\n")] = 0;
    if (importer->failure[0]) return lw_status_fail(err, status, "%s", importer->failure);
    return lw_status_fail(err, status, "%s: %s ended with code %d (%s)", importer->desc->scene, PROGRAM_NAME,
                          WEXITSTATUS(ended), lw_status_text(status));
}

enum lw_status lw_import_spawn(const struct lw_import_spawn_desc *desc, struct lw_scene **out_scene,
                               struct lw_error *err) {
    if (lw_package_is(desc->scene) && !desc->environment) return load_package(desc, out_scene, err);
    struct importer importer = {.desc = desc, .failure_fd = -1};
    find_program(&importer);
    enum lw_status status = make_folder(&importer, err);
    if (status == LW_OK) status = start(&importer, err);
    if (status == LW_OK) status = await_result(&importer, err);
    if (status == LW_OK) status = lw_package_load(importer.package, out_scene, err);
    if (importer.failure_fd >= 0) close(importer.failure_fd);
    lw_folders_remove_temporary(importer.folder); /* with the unfinished files of a killed importer */
    return status;
}
