#include "client/control/ctl_figures.h"

#include "common/base/waiting.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* "NAME VALUE", where labels within NAME may hold blanks: the value follows the last one. False: no such
 * line. */
static bool read_line(char *line, struct lw_ctl_figure *out) {
    char *blank = strrchr(line, ' '), *end;
    if (!blank || blank == line) return false;
    *blank = '\0';
    out->name = line;
    out->value = strtod(blank + 1, &end);
    return end != blank + 1 && !*end;
}

enum lw_status lw_ctl_figures_read(struct lw_ctl_figures *figures, char *text, uint64_t as_of_ns,
                                   struct lw_error *err) {
    size_t lines = 1;
    for (const char *c = text; *c; c++) lines += *c == '\n';
    *figures = (struct lw_ctl_figures){
        .text = text, .figure = calloc(lines, sizeof *figures->figure), .as_of_ns = as_of_ns};
    if (!figures->figure) return lw_status_fail(err, LW_NO_MEMORY, "the figures");
    char *rest = text;
    for (char *line; (line = strsep(&rest, "\n")) != NULL;) {
        if (!*line || *line == '#') continue;
        if (!read_line(line, &figures->figure[figures->count]))
            return lw_status_fail(err, LW_PROTOCOL, "no figure: %.60s", line);
        figures->count++;
    }
    return LW_OK;
}

void lw_ctl_figures_finish(struct lw_ctl_figures *figures) {
    free(figures->figure);
    free(figures->text);
    *figures = (struct lw_ctl_figures){0};
}

double lw_ctl_figures_get(const struct lw_ctl_figures *figures, const char *name) {
    for (size_t i = 0; i < figures->count; i++)
        if (strcmp(figures->figure[i].name, name) == 0) return figures->figure[i].value;
    return 0;
}

/* ---- for people ---- */

struct writer {
    char *at;
    size_t room;
};

static void LW_PRINTF(2, 3) put(struct writer *w, const char *format, ...) {
    va_list args;
    va_start(args, format);
    const int length = vsnprintf(w->at, w->room, format, args);
    va_end(args);
    const size_t used = length < 0 ? 0 : (size_t)length < w->room ? (size_t)length : w->room - 1;
    w->at += used;
    w->room -= used;
}

/* "12.3 M", with a prefix by thousands. */
static void put_quantity(struct writer *w, double value, const char *unit) {
    static const char *const prefix[] = {"", "k", "M", "G", "T"};
    unsigned p = 0;
    for (; fabs(value) >= 999.5 && p < 4; p++) value /= 1000;
    put(w, value == floor(value) && p == 0 ? "%.0f %s%s" : "%.3g %s%s", value, prefix[p], unit);
}

static double rays(const struct lw_ctl_figures *f) {
    return lw_ctl_figures_get(f, "lightwell_rays_total{kind=\"shadow\"}") +
           lw_ctl_figures_get(f, "lightwell_rays_total{kind=\"bounce\"}") +
           lw_ctl_figures_get(f, "lightwell_rays_total{kind=\"probe\"}");
}

static double frames(const struct lw_ctl_figures *f) {
    return lw_ctl_figures_get(f, "lightwell_frame_duration_seconds_count");
}

/* "no: looking inside objects, 42 %". An older server has no such figure. */
static void put_ready(struct writer *w, const struct lw_ctl_figures *f) {
    const uint32_t stage = (uint32_t)fmax(lw_ctl_figures_get(f, "lightwell_waiting_stage"), 0);
    char waiting[LW_WAITING_LINE_SIZE];
    lw_waiting_line(stage, (float)lw_ctl_figures_get(f, "lightwell_waiting_share"), waiting);
    put(w, "ready      ");
    if (lw_ctl_figures_get(f, "lightwell_ready") > 0)
        put(w, "yes\n");
    else if (lw_ctl_figures_get(f, "lightwell_solver_stalled") > 0)
        put(w, "no: the solver makes no progress\n");
    else if (stage == LW_WAITING_UNKNOWN || stage >= LW_WAITING_READY)
        put(w, "no: no light yet, or stopping\n");
    else
        put(w, "no: %s\n", waiting);
}

void lw_ctl_figures_table(const struct lw_ctl_figures *f, char *dst, size_t dst_size) {
    struct writer w = {dst, dst_size};
    const double count = frames(f), sum = lw_ctl_figures_get(f, "lightwell_frame_duration_seconds_sum");
    put_ready(&w, f);
    put(&w, "sessions   %.0f, of them %.0f draw direct light; %.0f so far, %.0f refusals\n",
        lw_ctl_figures_get(f, "lightwell_sessions"), lw_ctl_figures_get(f, "lightwell_drawing_sessions"),
        lw_ctl_figures_get(f, "lightwell_opened_sessions_total"),
        lw_ctl_figures_get(f, "lightwell_refusals_total"));
    put(&w, "frames     %.0f, newest %.0f, mean %.1f ms\n", count, lw_ctl_figures_get(f, "lightwell_frame"),
        count > 0 ? 1e3 * sum / count : 0);
    put(&w, "tiles      %.0f, of them %.0f converged, %.0f in the interest set\n",
        lw_ctl_figures_get(f, "lightwell_tiles"), lw_ctl_figures_get(f, "lightwell_converged_tiles"),
        lw_ctl_figures_get(f, "lightwell_interest_tiles"));
    put(&w, "rays       ");
    put_quantity(&w, rays(f), "");
    put(&w, "\nsent       ");
    put_quantity(&w, lw_ctl_figures_get(f, "lightwell_sent_bytes_total"), "B");
    put(&w, " in %.0f tiles; ", lw_ctl_figures_get(f, "lightwell_sent_tiles_total"));
    put_quantity(&w, lw_ctl_figures_get(f, "lightwell_waiting_bytes"), "B");
    put(&w, " wait\nmemory     ");
    put_quantity(&w, lw_ctl_figures_get(f, "process_resident_memory_bytes"), "B");
    put(&w, ", of them ");
    put_quantity(&w, lw_ctl_figures_get(f, "lightwell_solve_memory_bytes"), "B");
    put(&w, " for the solve\nCPU time   %.1f s: solve %.1f, publish %.1f, serve %.1f\n",
        lw_ctl_figures_get(f, "process_cpu_seconds_total"),
        lw_ctl_figures_get(f, "lightwell_cpu_seconds_total{stage=\"solve\"}"),
        lw_ctl_figures_get(f, "lightwell_cpu_seconds_total{stage=\"publish\"}"),
        lw_ctl_figures_get(f, "lightwell_cpu_seconds_total{stage=\"serve\"}"));
}

void lw_ctl_figures_line(const struct lw_ctl_figures *before, const struct lw_ctl_figures *now, char *dst,
                         size_t dst_size) {
    struct writer w = {dst, dst_size};
    const double elapsed_s = fmax(1e-9 * (double)(now->as_of_ns - before->as_of_ns), 1e-3);
    const double count = frames(now) - frames(before),
                 sum_s = lw_ctl_figures_get(now, "lightwell_frame_duration_seconds_sum") -
                         lw_ctl_figures_get(before, "lightwell_frame_duration_seconds_sum");
    put(&w, "sessions %.0f  frames %.1f/s", lw_ctl_figures_get(now, "lightwell_sessions"),
        fmax(count, 0) / elapsed_s);
    if (count > 0) put(&w, " of %.1f ms", 1e3 * sum_s / count);
    put(&w, "  rays ");
    put_quantity(&w, fmax(rays(now) - rays(before), 0) / elapsed_s, "/s");
    put(&w, "  sent ");
    put_quantity(&w,
                 fmax(lw_ctl_figures_get(now, "lightwell_sent_bytes_total") -
                          lw_ctl_figures_get(before, "lightwell_sent_bytes_total"),
                      0) /
                     elapsed_s,
                 "B/s");
    put(&w, "  waiting ");
    put_quantity(&w, lw_ctl_figures_get(now, "lightwell_waiting_bytes"), "B");
    put(&w, "  cores %.2f",
        fmax(lw_ctl_figures_get(now, "process_cpu_seconds_total") -
                 lw_ctl_figures_get(before, "process_cpu_seconds_total"),
             0) /
            elapsed_s);
}
