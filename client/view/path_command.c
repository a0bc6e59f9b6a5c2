#include "client/view/path_command.h"

#include "client/view/export.h"
#include "common/base/clock.h"
#include "common/base/interrupt.h"
#include "common/base/log.h"
#include "common/base/progress.h"

#include <inttypes.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Samples per pixel from one look at the error to the next. An even number, since both halves of the samples
 * get as many. */
#define STEP 4u
/* With fewer samples the estimated error is mostly noise itself. */
#define SAMPLES_MIN 16u

static _Atomic bool stop;

static void on_signal(int number) {
    (void)number;
    stop = true;
}

#define AGAIN   "; Ctrl-C again ends it at once"
#define NOTHING "stopped before the first sample; nothing is written"
static const struct lw_interrupt_phase reading = {.answer = "stopping"};
static const struct lw_interrupt_phase beginning = {.answer = NOTHING, .ends = true};
static const struct lw_interrupt_phase tracing = {.answer = "stopping: writing what has been traced" AGAIN};
static const struct lw_interrupt_phase writing = {.answer = "all is traced, and being written" AGAIN};

struct command {
    const struct lw_view_options *options;
    struct lw_scene *scene;
    struct lw_pose pose;
    struct lw_trace *trace;
    struct lw_lights lights;
    struct lw_path_trace *tracer;
    struct lw_guide *guide; /* NULL: none */
    struct lw_path_view view;
    struct lw_path_film film;
    float *undo; /* half of the film, as it was before a sample */
    struct lw_path_count count;
    double error; /* the film's */
    bool stopped; /* by a signal, before there was enough */
    uint64_t wall_ns, cpu_ns;
};

static size_t half_bytes(const struct lw_view_options *o) {
    return (size_t)o->width * o->height * 3 * sizeof(float);
}

static enum lw_status set_up_guide(struct command *c, struct lw_error *err) {
    struct lw_guide_desc desc = {.alpha = 0};
    /* An empty scene has no bounds, and nothing to guide: one cell is enough. */
    if (!lw_pose_bounds(&c->pose, c->scene, &desc.minimum_ws, &desc.maximum_ws))
        desc.minimum_ws = desc.maximum_ws = lw_vec3(0, 0, 0);
    enum lw_status status = lw_guide_create(&desc, &c->guide, err);
    if (status == LW_OK) c->view.guide = c->guide;
    return status;
}

static enum lw_status set_up(struct command *c, struct lw_error *err) {
    const struct lw_view_options *o = c->options;
    struct lw_scene_open open = o->path.open;
    open.cancel = &stop;
    open.lightmap_unused = true;
    enum lw_status status = lw_scene_open(&open, &c->scene, err);
    if (status != LW_OK) return status;
    lw_interrupt_enter(&beginning);
    if (stop) return LW_CLOSED;
    status = lw_pose_init(&c->pose, c->scene);
    if (status != LW_OK) return lw_status_fail(err, status, "no memory for the scene's pose");
    lw_pose_evaluate(&c->pose, c->scene, o->path.time_s);
    /* One moment only: nothing moves any more. Rays then meet one flat structure, where coherent packets are
     * safe. */
    memset(c->pose.node_moves, 0, c->scene->node_count * sizeof *c->pose.node_moves);
    status = lw_trace_create(c->scene, &c->pose, &c->trace, err);
    if (status != LW_OK) return status;
    status = lw_lights_init(&c->lights, c->scene, &c->pose);
    if (status != LW_OK) return lw_status_fail(err, status, "no memory for the lights");
    status = lw_view_options_camera(o, c->scene, &c->pose, c->trace, &c->view.camera, err);
    if (status != LW_OK) return status;
    c->view.bounces = o->path.bounces;
    c->view.seed = o->path.seed;
    c->view.pixel = o->path.pixel;
    c->view.part = o->path.part;
    c->view.cancel = &stop;
    status = lw_path_trace_create(&(struct lw_path_trace_desc){.scene = c->scene,
                                                               .trace = c->trace,
                                                               .lights = &c->lights,
                                                               .pose = &c->pose,
                                                               .threads = o->threads},
                                  &c->tracer, err);
    if (status == LW_OK && o->path.guide == LW_VIEW_GUIDE_LEARNED) status = set_up_guide(c, err);
    if (status != LW_OK) return status;
    c->undo = malloc(half_bytes(o));
    if (c->undo == NULL) return lw_status_fail(err, LW_NO_MEMORY, "no memory for the picture");
    return lw_path_film_init(&c->film, o->width, o->height, err);
}

static void tear_down(struct command *c) {
    lw_path_film_finish(&c->film);
    free(c->undo);
    lw_path_trace_destroy(c->tracer);
    lw_guide_destroy(c->guide);
    lw_lights_finish(&c->lights);
    lw_trace_destroy(c->trace);
    if (c->scene != NULL) lw_pose_finish(&c->pose);
    lw_scene_destroy(c->scene);
}

/* Estimate of the samples in all: an error falls at least with their root. */
static uint64_t foresee(const struct command *c) {
    const struct lw_view_path *path = &c->options->path;
    if (!(path->error > 0)) return path->samples;
    if (c->film.samples < SAMPLES_MIN) return 0;
    double ratio = c->error / path->error, all = c->film.samples * ratio * ratio;
    return all < path->samples ? (uint64_t)all : path->samples;
}

static bool is_enough(const struct command *c) {
    const struct lw_view_path *path = &c->options->path;
    if (c->film.samples >= path->samples) return true;
    return path->error > 0 && c->film.samples >= SAMPLES_MIN && c->error <= path->error;
}

/* One more of every pixel; where a signal comes before that is done, of none. */
static void add_sample(struct command *c) {
    float *half = c->film.half[c->film.samples & 1u];
    memcpy(c->undo, half, half_bytes(c->options));
    if (!lw_path_trace_render(c->tracer, &c->view, 1, &c->film, &c->count))
        memcpy(half, c->undo, half_bytes(c->options));
    else if (c->guide)
        lw_guide_learn(c->guide, c->options->threads);
}

static void trace_until_enough(struct command *c) {
    struct lw_progress progress;
    const uint64_t start_ns = lw_clock_ns(), start_cpu_ns = lw_clock_process_cpu_ns();
    lw_progress_init(&progress, "tracing paths", foresee(c));
    while (!stop && !is_enough(c)) {
        add_sample(c);
        lw_interrupt_enter(&tracing);
        const uint32_t samples = c->film.samples;
        if (stop || samples % STEP == 0 || samples == c->options->path.samples)
            c->error = lw_path_film_error(&c->film);
        progress.total = foresee(c);
        lw_progress_step(&progress, samples - progress.done);
    }
    lw_interrupt_enter(&writing);
    c->stopped = !is_enough(c);
    if (c->stopped)
        lw_progress_stop(&progress);
    else
        lw_progress_finish(&progress);
    c->wall_ns = lw_clock_ns() - start_ns;
    c->cpu_ns = lw_clock_process_cpu_ns() - start_cpu_ns;
}

static enum lw_status print_report(const struct command *c, const float *rgb, struct lw_error *err) {
    const struct lw_path_count *n = &c->count;
    const double seconds = (double)c->wall_ns * 1e-9, cpu_seconds = (double)c->cpu_ns * 1e-9;
    double mean[3];
    lw_export_mean(rgb, (size_t)c->film.width * c->film.height, mean);
    char error[32] = "null"; /* one sample says nothing about its own error */
    if (isfinite(c->error)) snprintf(error, sizeof error, "%.6g", c->error);
    printf("{\"samples\": %u, \"bounces\": %u, \"error\": %s, \"target_error\": %.6g, \"stopped\": %s,\n",
           c->film.samples, c->view.bounces, error, c->options->path.error, c->stopped ? "true" : "false");
    printf(" \"seconds\": %.6f, \"cpu_seconds\": %.6f, \"paths\": %" PRIu64
           ", \"paths_per_cpu_second\": %.6g,\n",
           seconds, cpu_seconds, n->paths, cpu_seconds > 0 ? (double)n->paths / cpu_seconds : 0.0);
    printf(" \"rays_primary\": %" PRIu64 ", \"rays_shadow\": %" PRIu64 ", \"rays_bounce\": %" PRIu64 ",\n",
           n->rays_primary, n->rays_shadow, n->rays_bounce);
    printf(" \"guide\": \"%s\",\n", c->guide ? "learned" : "off");
    printf(" \"width\": %u, \"height\": %u, \"mean_rgb\": [%.9g, %.9g, %.9g]}\n", c->film.width,
           c->film.height, mean[0], mean[1], mean[2]);
    if (fflush(stdout) != 0) return lw_status_fail(err, LW_IO, "cannot write the report to stdout");
    return LW_OK;
}

static enum lw_status deliver(const struct command *c, struct lw_error *err) {
    const struct lw_view_options *o = c->options;
    float *rgb = malloc((size_t)o->width * o->height * 3 * sizeof *rgb);
    if (rgb == NULL) return lw_status_fail(err, LW_NO_MEMORY, "no memory for the picture");
    lw_path_film_resolve(&c->film, rgb);
    enum lw_status status = lw_export_picture(o, rgb, err);
    if (status == LW_OK && c->stopped)
        lw_log(LW_LOG_WARNING, "stopped: the picture has %u samples per pixel, an estimated error of %.3g",
               c->film.samples, c->error);
    if (status == LW_OK && !o->json)
        lw_log(LW_LOG_INFO,
               "%s: %ux%u, %u samples per pixel, estimated error %.3g, %.3g M paths per CPU second", o->out,
               o->width, o->height, c->film.samples, c->error,
               (double)c->count.paths / fmax(1, (double)c->cpu_ns) * 1e3);
    if (status == LW_OK && o->json) status = print_report(c, rgb, err);
    free(rgb);
    return status;
}

enum lw_status lw_path_command_run(const struct lw_view_options *options, bool *out_stopped,
                                   struct lw_error *err) {
    struct command c = {.options = options, .error = (double)INFINITY};
    enum lw_status status = lw_export_check(options, err);
    if (status != LW_OK) return status;
    lw_interrupt_watch(on_signal, &reading);
    status = set_up(&c, err);
    if (status == LW_OK) {
        trace_until_enough(&c);
        status = deliver(&c, err);
    }
    tear_down(&c);
    if (status == LW_CLOSED && stop) {
        lw_log(LW_LOG_INFO, NOTHING);
        c.stopped = true;
        status = LW_OK;
    }
    *out_stopped = c.stopped;
    return status;
}
