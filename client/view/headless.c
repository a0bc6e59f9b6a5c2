#include "client/view/headless.h"

#include "client/gl/gl_offscreen.h"
#include "client/gl/gl_view.h"
#include "client/lib/package_cache.h"
#include "client/view/compose/antialias.h"
#include "client/view/compose/stage.h"
#include "client/view/export.h"
#include "client/view/plateau.h"
#include "common/base/clock.h"
#include "common/base/interrupt.h"
#include "common/base/log.h"
#include "common/base/progress.h"
#include "common/tile/tile_channels.h"

#include <inttypes.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>

#define POLL_MS            50u
#define CONNECT_TIMEOUT_MS 5000u
#define MOVES_NS           10000000000u /* things that have not moved for so long stand still */

static _Atomic bool stop;

static void on_signal(int number) {
    (void)number;
    stop = true;
}

static const struct lw_interrupt_phase dark = {.answer = "stopped before there was light; nothing is written",
                                               .ends = true};
static const struct lw_interrupt_phase waiting = {
    .answer = "stopping: writing what there is; Ctrl-C again ends it at once"};
static const struct lw_interrupt_phase writing = {
    .answer = "the picture is being written; Ctrl-C again ends it at once"};

struct headless {
    const struct lw_view_options *options;
    struct lw_client *client;
    uint64_t started_ns, deadline_ns;
    uint64_t welcomed_ns, waited_ns, compose_ns; /* moment, moment, duration */
    struct lw_stage stage;
    struct lw_compose_view view;
    struct lw_compose_report report;
    struct lw_antialias antialias;
    struct lw_gl_offscreen *offscreen; /* NULL: rays draw */
    struct lw_gl_view gl;
    struct lw_plateau plateau;
    bool at_plateau;                    /* things move, and the error that is shown falls no more */
    uint64_t moved_ns;                  /* when something moved last; 0: never */
    double time_s;                      /* the scene's time then */
    struct lw_client_stats stats;       /* as of the picture */
    struct lw_waiting_state server;     /* before its first light */
    struct lw_progress server_progress; /* within the stage of `server` */
    bool stopped;                       /* by a signal, before the wait was over */
    bool late;                          /* the wait took too long, but there is light */
    float *rgb;
};

static double ms_between(uint64_t from_ns, uint64_t to_ns) {
    return to_ns > from_ns ? (double)(to_ns - from_ns) * 1e-6 : 0.0;
}

static size_t pixel_count(const struct headless *h) { return (size_t)h->view.width * h->view.height; }

static enum lw_status connect_to_server(struct headless *h, struct lw_error *err) {
    unsigned limit_ms = CONNECT_TIMEOUT_MS;
    if (h->options->timeout_s * 1e3 < limit_ms) limit_ms = (unsigned)(h->options->timeout_s * 1e3);
    enum lw_status status =
        lw_client_create(&(struct lw_client_desc){.host = h->options->host,
                                                  .finer = LW_ATLAS_FINER_MAX,
                                                  .port = h->options->port,
                                                  .access = &h->options->access,
                                                  .name = "lightwell-view --headless",
                                                  .timeout_ms = limit_ms,
                                                  .cache_folder = h->options->cache_folder,
                                                  .wants_nothing = true,
                                                  .draws_direct = h->options->draws_direct,
                                                  .channel_features = LW_TILE_CHANNELS_DIRECTION,
                                                  .materials = true,
                                                  .watch = {.damaged = lw_package_cache_warn,
                                                            .unkept = lw_package_cache_warn_unkept}},
                         &h->client, err);
    h->welcomed_ns = lw_clock_ns();
    return status;
}

/* Takes the steps up to `done`. */
static void show_progress(struct lw_progress *progress, uint64_t done) {
    uint64_t so_far = atomic_load(&progress->done);
    lw_progress_step(progress, done > so_far ? done - so_far : 0);
}

static bool is_before_light(struct lw_waiting_state server) {
    return server.stage != LW_WAITING_UNKNOWN && server.stage != LW_WAITING_READY;
}

/* Until its first light the server's stages, as it says them; a server of our own shows them itself. */
static void show_wait(struct headless *h, struct lw_progress *progress, uint64_t done) {
    const struct lw_waiting_state now = lw_client_waiting(h->client);
    if (now.stage != h->server.stage && is_before_light(now))
        lw_progress_init(&h->server_progress, lw_waiting_text(now.stage), 100);
    else if (now.stage != h->server.stage && is_before_light(h->server)) /* its time begins with light */
        lw_progress_init(progress, progress->stage, progress->total);
    h->server = now;
    if (!is_before_light(now))
        show_progress(progress, done);
    else if (!h->options->scene)
        lw_progress_set(&h->server_progress, (uint64_t)lroundf(100 * now.share));
}

static enum lw_status receive_scene(struct headless *h, struct lw_error *err) {
    struct lw_progress progress;
    lw_progress_init(&progress, "receiving the scene", 1000);
    while (lw_client_scene(h->client) == NULL) {
        enum lw_status status = lw_client_poll(h->client, POLL_MS, err);
        if (status != LW_OK) {
            lw_status_context(err, "receiving the scene");
            return status;
        }
        float fraction = lw_client_package_progress(h->client);
        show_progress(&progress, (uint64_t)(fraction * 1000.0f));
        if (lw_clock_ns() > h->deadline_ns && lw_client_scene(h->client) == NULL)
            return lw_status_fail(err, LW_TIMED_OUT,
                                  "the scene has not arrived within %g s: %.0f %% of it is there (--timeout)",
                                  h->options->timeout_s, (double)fraction * 100.0);
    }
    lw_progress_finish(&progress);
    return LW_OK;
}

static enum lw_status set_interest(struct headless *h, struct lw_error *err) {
    return lw_stage_look(&h->stage, &h->view.camera, h->view.width, h->view.height, err);
}

static enum lw_status take_picture(struct headless *h, struct lw_error *err) {
    /* A camera of the scene may be carried by its animation. */
    enum lw_status status = lw_view_options_camera(h->options, h->stage.scene, &h->stage.pose, h->stage.trace,
                                                   &h->view.camera, err);
    if (status != LW_OK) return status;
    uint64_t start_ns = lw_clock_ns();
    if (h->gl.renderer != NULL) {
        status = lw_gl_view_take(&h->gl, &h->stage, 0, 0, NULL, err);
        if (status == LW_OK) status = lw_gl_view_survey(&h->gl, &h->stage, &h->view, &h->report, err);
        if (status != LW_OK) return status;
    } else {
        struct lw_compose_source source = lw_compose_source_of(h->stage.client);
        lw_compose_render(h->stage.compose, &source, &h->stage.pose, &h->view, h->rgb, &h->report);
    }
    h->compose_ns = lw_clock_ns() - start_ns;
    lw_client_get_stats(h->client, &h->stats);
    return set_interest(h, err);
}

static enum lw_status start_gl(struct headless *h, struct lw_error *err) {
    if (h->options->renderer != LW_VIEW_RENDERER_GL) return LW_OK;
    enum lw_status status = lw_gl_offscreen_create(&h->offscreen, err);
    if (status == LW_OK) status = lw_gl_view_init(&h->gl, &h->stage, true, err);
    if (status == LW_OK) lw_log(LW_LOG_INFO, "drawn by %s", lw_gl_renderer_name(h->gl.renderer));
    if (status != LW_OK) lw_status_context(err, "--renderer gl");
    return status;
}

/* The same picture with all its samples; without memory for them it stays as it is. */
static enum lw_status finish_picture(struct headless *h, struct lw_error *out_err) {
    const uint32_t samples = h->options->samples_per_pixel;
    struct lw_error err = {0};
    enum lw_status shown = lw_stage_show(&h->stage, h->options->show, &h->view, out_err);
    if (shown != LW_OK) return shown;
    if (h->gl.renderer != NULL) { /* nothing is in it yet */
        uint64_t began_ns = lw_clock_ns();
        enum lw_status status = lw_gl_view_average(&h->gl, &h->view, samples, h->rgb, out_err);
        h->compose_ns = lw_clock_ns() - began_ns;
        return status;
    }
    if (samples == 1 && h->options->show == LW_SHOW_ALL) return LW_OK;
    if (lw_antialias_reserve(&h->antialias, pixel_count(h), &err) != LW_OK) {
        lw_log(LW_LOG_WARNING, "%s: the picture has one", err.text);
        return LW_OK;
    }
    struct lw_compose_source source = lw_compose_source_of(h->stage.client);
    struct lw_compose_report report; /* the reported figures are of the picture that served the wait */
    uint64_t start_ns = lw_clock_ns();
    lw_antialias_render(&h->antialias, h->stage.compose, &source, &h->stage.pose, &h->view, samples, h->rgb,
                        &report);
    h->compose_ns = lw_clock_ns() - start_ns;
    return LW_OK;
}

static void note_motion(struct headless *h, bool moved) {
    struct lw_client_stats stats;
    lw_client_get_stats(h->client, &stats);
    if (h->stage.scene->duration_s > 0 && stats.time_s != h->time_s) moved = true;
    if (moved) h->moved_ns = lw_clock_ns();
    h->time_s = stats.time_s;
}

/* The error of light at rest falls, if only by and by: it is waited for. So is light of the whole density. */
static void note_error(struct headless *h, const struct lw_compose_report *report) {
    if (h->moved_ns == 0 || lw_clock_ns() - h->moved_ns > MOVES_NS ||
        report->max_error >= LW_ATLAS_COARSE_ERROR) {
        h->plateau = (struct lw_plateau){0};
        h->at_plateau = false;
        return;
    }
    if (h->stats.first_ns != 0 && report->complete)
        h->at_plateau =
            lw_plateau_note(&h->plateau, report->shown_error,
                            (double)h->stats.tiles / fmax(1, report->tiles_needed), lw_clock_ns());
}

static bool serves_the_wait(const struct headless *h, const struct lw_compose_report *report) {
    if (h->stats.first_ns == 0) return false;
    const bool is_timed = h->options->wait == LW_VIEW_WAIT_FIRST || h->options->wait == LW_VIEW_WAIT_SECONDS;
    if (!is_timed && lw_client_finishes(h->client) == LW_CLIENT_FINISHES_COMING) return false;
    switch (h->options->wait) {
    case LW_VIEW_WAIT_FIRST:
        return true;
    case LW_VIEW_WAIT_COMPLETE:
        return report->complete;
    case LW_VIEW_WAIT_GOOD:
        return report->good || (report->complete && h->at_plateau);
    case LW_VIEW_WAIT_CONVERGED:
        return report->converged;
    case LW_VIEW_WAIT_SECONDS:
        return ms_between(h->started_ns, lw_clock_ns()) >= h->options->wait_s * 1e3;
    }
    return false;
}

static bool shows_light(const struct lw_compose_report *r) { return r->tiles_needed > r->tiles_missing; }

static uint32_t tiles_served(const struct headless *h, const struct lw_compose_report *r) {
    uint32_t lacking = r->tiles_missing + r->tiles_unfinished;
    if (h->options->wait == LW_VIEW_WAIT_CONVERGED && r->tiles_noisy > r->tiles_unfinished)
        lacking = r->tiles_missing + r->tiles_noisy;
    return r->tiles_needed > lacking ? r->tiles_needed - lacking : 0;
}

static enum lw_status fail_late(const struct headless *h, struct lw_error *err) {
    const struct lw_compose_report *r = &h->report;
    double limit_s = h->options->timeout_s;
    if (h->stats.first_ns == 0 && is_before_light(h->server)) {
        char line[LW_WAITING_LINE_SIZE];
        lw_waiting_line(h->server.stage, h->server.share, line);
        return lw_status_fail(err, LW_TIMED_OUT, "no light within %g s, the server is at: %s (--timeout)",
                              limit_s, line);
    }
    if (h->stats.first_ns == 0)
        return lw_status_fail(err, LW_TIMED_OUT,
                              "no first light of every object within %g s: %" PRIu64
                              " tiles have arrived (--timeout)",
                              limit_s, h->stats.tiles);
    if (r->tiles_missing + r->tiles_unfinished > 0)
        return lw_status_fail(
            err, LW_TIMED_OUT,
            "the view is not complete after %g s: of %u tiles %u are not there, %u lack bounces "
            "(--timeout)",
            limit_s, r->tiles_needed, r->tiles_missing, r->tiles_unfinished);
    if (h->options->wait == LW_VIEW_WAIT_GOOD)
        return lw_status_fail(
            err, LW_TIMED_OUT,
            "the view is not good after %g s: the error that is shown is %.1f %%, not yet %.1f "
            "%% (--timeout)",
            limit_s, 100 * (double)r->shown_error, 100 * (double)LW_COMPOSE_GOOD_ERROR);
    return lw_status_fail(
        err, LW_TIMED_OUT,
        "the view has not converged after %g s: of %u tiles %u have an error above %g, the worst %g "
        "(--timeout)",
        limit_s, r->tiles_needed, r->tiles_noisy, (double)h->stats.target_error, (double)r->max_error);
}

/* Takes pictures until one serves the wait. What it needs is known from the picture itself, and may change
 * with every object that moves; while nothing arrives that the last one needed, none is taken. */
static enum lw_status wait_for_light(struct headless *h, struct lw_error *err) {
    bool judged_by_tiles = h->options->wait == LW_VIEW_WAIT_COMPLETE ||
                           h->options->wait == LW_VIEW_WAIT_GOOD ||
                           h->options->wait == LW_VIEW_WAIT_CONVERGED;
    struct lw_progress progress;
    enum lw_status status = take_picture(h, err); /* tells the server what it needs, too */
    h->time_s = h->stats.time_s;
    if (judged_by_tiles)
        lw_progress_init(&progress, "waiting for the light", h->report.tiles_needed);
    else
        lw_progress_init(&progress, "waiting for the light, tiles received", 0);
    while (status == LW_OK) {
        lw_client_get_stats(h->client, &h->stats);
        struct lw_compose_source source = lw_compose_source_of(h->stage.client);
        struct lw_compose_report report;
        lw_compose_check(h->stage.compose, &source, &report);
        note_error(h, &report);
        if (serves_the_wait(h, &report)) {
            status = take_picture(h, err);
            if (status != LW_OK || serves_the_wait(h, &h->report)) break;
        } else {
            h->report = report;
        }
        if (shows_light(&h->report)) lw_interrupt_enter(&waiting);
        if (stop) {
            h->stopped = true;
            status = take_picture(h, err);
            break;
        }
        show_wait(h, &progress, judged_by_tiles ? tiles_served(h, &h->report) : h->stats.tiles);
        if (lw_clock_ns() > h->deadline_ns) {
            h->late =
                shows_light(&h->report) && take_picture(h, err) == LW_OK && finish_picture(h, err) == LW_OK;
            lw_progress_stop(&progress);
            return fail_late(h, err);
        }
        bool moved;
        status = lw_client_poll(h->client, POLL_MS, err);
        if (status == LW_CLOSED && stop) {
            /* Ctrl-C has reached the server, too; what it has sent is still here */
            *err = (struct lw_error){0};
            status = LW_OK;
            continue;
        }
        if (status == LW_OK) status = lw_stage_follow(&h->stage, &moved, err);
        if (status == LW_OK) note_motion(h, moved);
        if (status == LW_OK) status = set_interest(h, err);
        if (status != LW_OK) lw_status_context(err, "waiting for the light");
    }
    h->waited_ns = lw_clock_ns();
    lw_interrupt_enter(&writing);
    if (status == LW_OK) status = finish_picture(h, err);
    if (h->stopped)
        lw_progress_stop(&progress);
    else if (status == LW_OK)
        lw_progress_finish(&progress);
    return status;
}

static enum lw_status print_report(const struct headless *h, struct lw_error *err) {
    const struct lw_client_stats *s = &h->stats;
    const struct lw_compose_report *r = &h->report;
    uint64_t from_ns = s->connected_ns;
    double mean[3];
    lw_export_mean(h->rgb, pixel_count(h), mean);
    printf("{\"connect_ms\": %.3f, \"package_ms\": %.3f, \"first_ms\": %.3f, \"complete_ms\": %.3f, "
           "\"compose_ms\": %.3f, \"light_age_ms\": %.3f,\n",
           ms_between(from_ns, h->welcomed_ns), ms_between(from_ns, s->package_ns),
           ms_between(from_ns, s->first_ns), ms_between(from_ns, h->waited_ns), (double)h->compose_ns * 1e-6,
           (double)s->light_age_ns * 1e-6);
    printf(" \"frame\": %" PRIu64 ", \"time_s\": %.6f, \"frames\": %" PRIu64 ", \"tiles\": %" PRIu64
           ", \"bytes\": %" PRIu64 ", \"package_bytes\": %" PRIu64 ", \"finish_bytes\": %" PRIu64
           ", \"rays_total\": %" PRIu64 ",\n",
           s->frame, s->time_s, s->frames, s->tiles, s->bytes, s->package_bytes, s->finish_bytes,
           s->rays_total);
    printf(" \"tiles_used\": %u, \"tiles_missing\": %u, \"tiles_unfinished\": %u, \"tiles_noisy\": %u, "
           "\"max_error\": %.6g, \"target_error\": %.6g, \"shown_error\": %.6g, \"good_error\": %.6g,\n",
           r->tiles_needed, r->tiles_missing, r->tiles_unfinished, r->tiles_noisy, (double)r->max_error,
           (double)s->target_error, (double)r->shown_error, (double)LW_COMPOSE_GOOD_ERROR);
    printf(" \"bounces\": %u, \"complete\": %s, \"good\": %s, \"settled\": %s, \"converged\": %s, "
           "\"stopped\": %s,\n",
           s->bounces, r->complete ? "true" : "false", r->good ? "true" : "false",
           h->at_plateau ? "true" : "false", r->converged ? "true" : "false", h->stopped ? "true" : "false");
    printf(" \"width\": %u, \"height\": %u, \"samples_per_pixel\": %u, \"mean_rgb\": [%.9g, %.9g, %.9g]}\n",
           h->view.width, h->view.height, h->options->samples_per_pixel, mean[0], mean[1], mean[2]);
    if (fflush(stdout) != 0) return lw_status_fail(err, LW_IO, "cannot write the report to stdout");
    return LW_OK;
}

static void report(const struct headless *h) {
    const struct lw_compose_report *r = &h->report;
    if (h->stopped && !r->complete)
        lw_log(LW_LOG_WARNING, "stopped: of %u tiles of the picture %u are not there, %u lack bounces",
               r->tiles_needed, r->tiles_missing, r->tiles_unfinished);
    if (h->options->json) return;
    if (!h->late && h->at_plateau && r->complete && !r->good)
        lw_log(LW_LOG_INFO,
               "the error that is shown falls no more: it is %.1f %%, above the %.1f %% that is good; "
               "--freeze holds "
               "a scene still",
               100 * (double)r->shown_error, 100 * (double)LW_COMPOSE_GOOD_ERROR);
    lw_log(LW_LOG_INFO, "%s: %ux%u, %u tiles, %s", h->options->out, h->view.width, h->view.height,
           r->tiles_needed,
           h->late        ? "written as it is"
           : r->converged ? "converged"
           : r->good      ? "good"
           : r->complete  ? "complete"
                          : "not yet complete");
}

enum lw_status lw_headless_run(const struct lw_view_options *options, bool *out_stopped,
                               struct lw_error *err) {
    struct headless h = {.options = options, .view = {.width = options->width, .height = options->height}};
    enum lw_status status = lw_export_check(options, err);
    if (status != LW_OK) return status;
    lw_interrupt_watch(on_signal, &dark);
    h.started_ns = lw_clock_ns();
    double patience_s = options->timeout_s + (options->wait == LW_VIEW_WAIT_SECONDS ? options->wait_s : 0.0);
    h.deadline_ns = h.started_ns + (uint64_t)(patience_s * 1e9);

    h.rgb = malloc(pixel_count(&h) * 3 * sizeof *h.rgb); /* at most 3 GiB by the limit of --size */
    if (h.rgb == NULL)
        return lw_status_fail(err, LW_NO_MEMORY, "no memory for a picture of %ux%u pixels", h.view.width,
                              h.view.height);
    bool moved;
    status = connect_to_server(&h, err);
    if (status == LW_OK) status = receive_scene(&h, err);
    if (status == LW_OK) status = lw_stage_init(&h.stage, h.client, options->threads, err);
    h.view.mirrors = h.stage.mirrors = options->mirrors && options->renderer != LW_VIEW_RENDERER_GL;
    if (status == LW_OK) status = lw_stage_follow(&h.stage, &moved, err);
    if (status == LW_OK) status = start_gl(&h, err);
    if (status == LW_OK) /* an unknown camera is reported before the wait */
        status =
            lw_view_options_camera(options, h.stage.scene, &h.stage.pose, h.stage.trace, &h.view.camera, err);
    if (status == LW_OK) status = wait_for_light(&h, err);
    if (status == LW_OK || h.late) {
        enum lw_status shown = lw_export_picture(options, h.rgb, err);
        if (shown == LW_OK && options->json) shown = print_report(&h, err);
        if (shown == LW_OK) report(&h);
        if (!h.late) status = shown;
    }
    *out_stopped = h.stopped;
    lw_antialias_finish(&h.antialias);
    lw_gl_view_finish(&h.gl);
    lw_gl_offscreen_destroy(h.offscreen);
    lw_stage_finish(&h.stage);
    lw_client_destroy(h.client);
    free(h.rgb);
    return status;
}
