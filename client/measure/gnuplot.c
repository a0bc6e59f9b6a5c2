#include "client/measure/gnuplot.h"

#include "common/base/log.h"

#include <errno.h>
#include <spawn.h>
#include <string.h>
#include <sys/wait.h>

extern char **environ;

void lw_gnuplot_begin(FILE *f, const char *name, unsigned width, unsigned height) {
    fprintf(f, "set terminal pngcairo size %u,%u font 'sans,11'\nset output '%s.png'\n", width, height, name);
}

void lw_gnuplot_end(FILE *f, const char *name, unsigned width, unsigned height) {
    fprintf(f,
            "set terminal svg size %u,%u background 'white' font 'sans,14'\nset output '%s.svg'\nreplot\n"
            "unset output\n",
            width, height, name);
}

void lw_gnuplot_run(const char *folder, const char *script) {
    const char *const arguments[] = {"gnuplot", script, NULL};
    posix_spawn_file_actions_t actions;
    pid_t pid;
    int result = 0;
    posix_spawn_file_actions_init(&actions);
    int failed = posix_spawn_file_actions_addchdir_np(&actions, folder);
    if (!failed) failed = posix_spawnp(&pid, arguments[0], &actions, NULL, (char *const *)arguments, environ);
    posix_spawn_file_actions_destroy(&actions);
    if (!failed && waitpid(pid, &result, 0) < 0) failed = errno;
    if (failed)
        lw_log(LW_LOG_WARNING, "no plots: cannot run gnuplot: %s (%s in %s makes them)", strerror(failed),
               script, folder);
    else if (result != 0)
        lw_log(LW_LOG_WARNING, "no plots: gnuplot failed (%s in %s)", script, folder);
}
