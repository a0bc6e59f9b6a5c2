#include "client/measure/report.h"

#include "common/base/atomic_file.h"
#include "common/base/log.h"

#include <errno.h>
#include <math.h>
#include <spawn.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>

extern char **environ;

enum lw_status lw_report_print(const struct lw_report_file *file, const void *context, char **out_bytes,
                               size_t *out_size, struct lw_error *err) {
    char *bytes = NULL;
    size_t size = 0;
    struct lw_report report = {.f = open_memstream(&bytes, &size)};
    if (report.f) file->print(&report, context);
    if (!report.f || fclose(report.f) != 0) {
        free(bytes);
        return lw_status_fail(err, LW_NO_MEMORY, "no memory for %s", file->name);
    }
    *out_bytes = bytes;
    *out_size = size;
    return LW_OK;
}

enum lw_status lw_report_save(const char *folder, const struct lw_report_file *file, size_t count,
                              const void *context, struct lw_error *err) {
    enum lw_status status = LW_OK;
    for (size_t i = 0; status == LW_OK && i < count; i++) {
        char path[4096], *bytes = NULL;
        size_t size = 0;
        snprintf(path, sizeof path, "%s/%s", folder, file[i].name);
        status = lw_report_print(&file[i], context, &bytes, &size, err);
        if (status == LW_OK) status = lw_atomic_file_save(path, bytes, size, err);
        free(bytes);
    }
    return status;
}

/* ---- Markdown ---- */

void lw_report_section(struct lw_report *r, const char *title, const char *paragraph) {
    fprintf(r->f, "## %s\n\n", title);
    if (paragraph) lw_report_paragraph(r, "%s", paragraph);
}

void lw_report_paragraph(struct lw_report *r, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    vfprintf(r->f, format, arguments);
    va_end(arguments);
    fprintf(r->f, "\n\n");
}

void lw_report_origin(struct lw_report *r, const char *command, const char *machine, const char *day) {
    fprintf(r->f, "    %s\n\n%s, %s.", command, machine, day);
}

static void print_cells(struct lw_report *r, const char *format, va_list arguments) LW_PRINTF(2, 0);
static void print_cells(struct lw_report *r, const char *format, va_list arguments) {
    fprintf(r->f, r->columns ? " " : "| ");
    vfprintf(r->f, format, arguments);
    fprintf(r->f, " |");
    r->columns++;
    for (const char *at = format; (at = strchr(at, '|')); at++) r->columns++;
}

void lw_report_cell(struct lw_report *r, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    print_cells(r, format, arguments);
    va_end(arguments);
}

void lw_report_number(struct lw_report *r, double x) { lw_report_cell(r, isfinite(x) ? "%.3g" : "–", x); }

void lw_report_row(struct lw_report *r, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    print_cells(r, format, arguments);
    va_end(arguments);
    lw_report_end_row(r);
}

void lw_report_end_row(struct lw_report *r) {
    fprintf(r->f, "\n");
    r->columns = 0;
}

void lw_report_head(struct lw_report *r, const char *titles) {
    if (titles) lw_report_cell(r, "%s", titles);
    for (const char *at = titles; at && (at = strchr(at, '|')); at++) r->columns++;
    fprintf(r->f, "\n|");
    for (; r->columns; r->columns--) fprintf(r->f, "---|");
    fprintf(r->f, "\n");
}

/* ---- gnuplot scripts ---- */

void lw_report_script(struct lw_report *r, const char *key) {
    fprintf(r->f, "set datafile separator ','\nset logscale xy\nset grid\nset key %s\n", key);
}

void lw_report_plot(struct lw_report *r, const struct lw_report_plot *p) {
    fprintf(r->f, "set terminal pngcairo size %u,%u font 'sans,11'\nset output '%s.png'\n", p->width,
            p->height, p->name);
}

void lw_report_series(struct lw_report *r, const char *title, const char *format, ...) {
    va_list arguments;
    fprintf(r->f, r->series++ ? ", " : "plot ");
    va_start(arguments, format);
    vfprintf(r->f, format, arguments);
    va_end(arguments);
    fprintf(r->f, " title '%s'", title);
}

void lw_report_end_plot(struct lw_report *r, const struct lw_report_plot *p) {
    fprintf(r->f,
            "\nset terminal svg size %u,%u background 'white' font 'sans,14'\nset output '%s.svg'\nreplot\n"
            "unset output\n",
            p->width, p->height, p->name);
    r->series = 0;
}

void lw_report_run_gnuplot(const char *folder, const char *script) {
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
