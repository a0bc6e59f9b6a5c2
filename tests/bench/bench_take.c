/* bench_take: what taking tiles in costs the thread that draws, and how soon a picture by OpenGL is there.
 *
 *     lightwelld builtin:atrium-matt &            (lit for a minute)
 *     bench_take [--budget-ms MS] [--tiles N] [--seconds S] [HOST:PORT]
 *
 * Connects as the window of lightwell-view does, draws its pictures by OpenGL without a window, 30 a second,
 * and prints one table in Markdown. For each picture: polling (messages, decoding), uploading with the tiles'
 * words and their average, both in CPU time of this thread and in wall time; medians, 99th percentiles and
 * maxima. Then when the package was there, the first light was drawn, and all of it: every tile of the view
 * with all bounces. */
#include "client/gl/gl_offscreen.h"
#include "client/gl/gl_view.h"
#include "client/paths/camera_default.h"
#include "client/view/compose/stage.h"
#include "client/view/window/seeker.h"
#include "common/base/clock.h"
#include "tests/bench/bench_setup.h"

#include <epoxy/gl.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#define PICTURES_MAX 100000
#define PICTURE_NS   33000000ull
#define SURVEY_NS    250000000ull

struct settings {
    double budget_ms, seconds;
    int64_t tiles;
};

struct series {
    double *ms;
    size_t count;
};

static int by_size(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return x < y ? -1 : x > y;
}

static void note(struct series *s, uint64_t ns) {
    if (s->count < PICTURES_MAX) s->ms[s->count++] = (double)ns * 1e-6;
}

static void print(const char *name, struct series *s) {
    qsort(s->ms, s->count, sizeof *s->ms, by_size);
    if (s->count == 0) return;
    printf("| %s | %.2f | %.2f | %.2f |\n", name, s->ms[s->count / 2], s->ms[s->count * 99 / 100],
           s->ms[s->count - 1]);
}

enum { POLL_CPU, POLL_WALL, TAKE_CPU, TAKE_WALL, BOTH_CPU, BOTH_WALL, SERIES };
static const char *const series_name[SERIES] = {
    "poll, CPU",    "poll, wall",           "upload, CPU",
    "upload, wall", "poll and upload, CPU", "poll and upload, wall"};

struct bench {
    struct lw_client *client;
    struct lw_stage stage;
    struct lw_gl_offscreen *offscreen;
    struct lw_gl_view gl;
    struct lw_compose_view view;
    struct lw_compose_report report;
    struct series series[SERIES];
    uint32_t tiles_max;
    uint64_t stage_cpu_ns, gl_cpu_ns; /* CPU time of the set-up */
    uint64_t package_ns, staged_ns, first_ns, complete_ns, surveyed_ns, tiles;
};

static enum lw_status set_up(struct bench *b, struct lw_error *err) {
    struct lw_client_stats stats;
    enum lw_status status = LW_OK;
    while (status == LW_OK && lw_client_scene(b->client) == NULL)
        status = lw_client_poll(b->client, 100, err);
    uint64_t cpu_ns = lw_clock_process_cpu_ns();
    if (status == LW_OK) status = lw_stage_init(&b->stage, b->client, 0, err);
    b->stage_cpu_ns = lw_clock_process_cpu_ns() - cpu_ns;
    cpu_ns = lw_clock_process_cpu_ns();
    if (status == LW_OK) status = lw_gl_view_init(&b->gl, &b->stage, false, err);
    b->gl_cpu_ns = lw_clock_process_cpu_ns() - cpu_ns;
    if (status != LW_OK) return status;
    lw_client_get_stats(b->client, &stats);
    b->package_ns = stats.package_ns;
    b->staged_ns = lw_clock_ns();
    const struct lw_scene *scene = b->stage.scene;
    b->view = (struct lw_compose_view){.width = 1280, .height = 720};
    b->view.camera = scene->camera_count > 0
                         ? lw_camera_of_scene(scene, &b->stage.pose, 0)
                         : lw_camera_default(scene, &b->stage.pose, b->stage.trace, 16.0f / 9);
    return LW_OK;
}

static enum lw_status picture(struct bench *b, struct lw_error *err) {
    const uint64_t start_ns = lw_clock_ns(), start_cpu_ns = lw_clock_thread_cpu_ns();
    struct lw_client_stats stats;
    bool moved;
    uint32_t waiting;
    enum lw_status status = lw_client_poll(b->client, 0, err);
    const uint64_t polled_ns = lw_clock_ns(), polled_cpu_ns = lw_clock_thread_cpu_ns();
    if (status == LW_OK) status = lw_stage_follow(&b->stage, &moved, err);
    const uint64_t followed_ns = lw_clock_ns(), followed_cpu_ns = lw_clock_thread_cpu_ns();
    if (status == LW_OK)
        status = lw_gl_view_take(&b->gl, &b->stage, b->tiles_max, lw_clock_ns(), &waiting, err);
    const uint64_t taken_ns = lw_clock_ns(), taken_cpu_ns = lw_clock_thread_cpu_ns();
    if (status != LW_OK) return status;
    lw_client_get_stats(b->client, &stats);
    if (stats.tiles != b->tiles) { /* else there was nothing to take in */
        const uint64_t poll_ns = polled_ns - start_ns, poll_cpu_ns = polled_cpu_ns - start_cpu_ns,
                       take_ns = taken_ns - followed_ns, take_cpu_ns = taken_cpu_ns - followed_cpu_ns;
        note(&b->series[POLL_WALL], poll_ns);
        note(&b->series[POLL_CPU], poll_cpu_ns);
        note(&b->series[TAKE_WALL], take_ns);
        note(&b->series[TAKE_CPU], take_cpu_ns);
        note(&b->series[BOTH_WALL], poll_ns + take_ns);
        note(&b->series[BOTH_CPU], poll_cpu_ns + take_cpu_ns);
    }
    b->tiles = stats.tiles;
    status = lw_gl_renderer_draw(b->gl.renderer, &b->view, 1, err);
    glFinish();
    if (status == LW_OK && stats.first_ns != 0 && b->first_ns == 0) b->first_ns = lw_clock_ns();
    const bool surveys = b->complete_ns == 0 || lw_clock_ns() - b->surveyed_ns > SURVEY_NS;
    if (status == LW_OK && surveys) {
        status = lw_gl_view_survey(&b->gl, &b->stage, &b->view, &b->report, err);
        b->surveyed_ns = lw_clock_ns();
    }
    if (status == LW_OK && b->report.complete && waiting == 0 && b->complete_ns == 0)
        b->complete_ns = lw_clock_ns();
    if (status == LW_OK)
        status = lw_stage_look(&b->stage, &b->view.camera, b->view.width, b->view.height, err);
    return status;
}

static void report(struct bench *b) {
    printf("| of a picture that takes tiles in, ms | median | 99 %% | maximum |\n|---|---|---|---|\n");
    for (int i = 0; i < SERIES; i++) print(series_name[i], &b->series[i]);
    printf("\n%zu pictures took tiles in, %" PRIu64 " tiles; by %s\n", b->series[0].count, b->tiles,
           lw_gl_renderer_name(b->gl.renderer));
    printf("making ready: rays and composer %.0f CPU ms, OpenGL %.0f CPU ms\n",
           (double)b->stage_cpu_ns * 1e-6, (double)b->gl_cpu_ns * 1e-6);
    const double package = (double)b->package_ns * 1e-6;
    printf("after the package: ready to draw %.0f ms, first light drawn %.0f ms, all of it %.0f ms\n",
           (double)b->staged_ns * 1e-6 - package,
           b->first_ns ? (double)b->first_ns * 1e-6 - package : (double)NAN,
           b->complete_ns ? (double)b->complete_ns * 1e-6 - package : (double)NAN);
}

static enum lw_status run(void *context, const char *address, struct lw_error *err) {
    const struct settings *s = context;
    static struct bench b;
    char host[256];
    uint16_t port;
    enum lw_status status = lw_options_address(address, host, sizeof host, &port, err);
    b.tiles_max = (uint32_t)s->tiles;
    for (int i = 0; i < SERIES; i++) b.series[i].ms = malloc(PICTURES_MAX * sizeof *b.series[i].ms);
    if (status == LW_OK) status = lw_gl_offscreen_create(&b.offscreen, err);
    if (status == LW_OK)
        status = lw_client_create(&(struct lw_client_desc){.host = host,
                                                           .port = port,
                                                           .name = "bench_take",
                                                           .wants_nothing = true,
                                                           .budget_ns = (uint64_t)(s->budget_ms * 1e6)},
                                  &b.client, err);
    if (status == LW_OK) status = set_up(&b, err);
    const uint64_t end_ns = lw_clock_ns() + (uint64_t)(s->seconds * 1e9);
    while (status == LW_OK && lw_clock_ns() < end_ns) {
        const uint64_t next_ns = lw_clock_ns() + PICTURE_NS;
        status = picture(&b, err);
        const uint64_t now_ns = lw_clock_ns();
        if (now_ns < next_ns && b.complete_ns != 0)
            nanosleep(&(struct timespec){.tv_nsec = (long)(next_ns - now_ns)}, NULL);
    }
    if (status == LW_OK) report(&b);
    lw_gl_view_finish(&b.gl);
    lw_stage_finish(&b.stage);
    lw_client_destroy(b.client);
    lw_gl_offscreen_destroy(b.offscreen);
    for (int i = 0; i < SERIES; i++) free(b.series[i].ms);
    return status;
}

int main(int argc, char **argv) {
    struct settings s = {.budget_ms = (double)LW_SEEKER_BUDGET_NS * 1e-6, .seconds = 10, .tiles = 32};
    const struct lw_option table[] = {
        {"budget-ms", "MS", "a poll takes no message in after this (default 2)", LW_OPTION_REAL, &s.budget_ms,
         0.01, 1000, NULL},
        BENCH_INT("tiles", "that a picture takes over at most (default 32)", &s.tiles, 1, 100000),
        {"seconds", "S", "how long (default 10)", LW_OPTION_REAL, &s.seconds, 1, 1000, NULL}};
    return BENCH_MAIN(argc, argv, table, .name = "bench_take",
                      .about = "Measures what taking tiles in costs the thread that draws.",
                      .operand = "[HOST:PORT]", .context = &s, .runs_once = true,
                      .by_default = LW_OPTIONS_ADDRESS);
}
