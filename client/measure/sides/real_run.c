#include "client/measure/sides/real_run.h"

#include "client/measure/sides/cache_renderer.h"
#include "client/measure/sides/lattice.h"
#include "client/measure/sides/per_user_renderer.h"
#include "client/measure/sides/views.h"
#include "common/base/clock.h"

#include <math.h>
#include <stdlib.h>
#include <time.h>

#define FIRST_LIGHT_S 300u

struct real_run {
    const struct lw_real_run_desc *desc;
    struct lw_daemon_child *daemon;
    struct lw_viewers viewers;
    float *rgb; /* one whole picture */
    uint64_t views;
    double age_sum_s;
};

/* All clients take in the data that has arrived, without waiting. */
static enum lw_status poll_all(struct real_run *r, struct lw_error *err) {
    if (r->desc->cancel && *r->desc->cancel) return lw_status_fail(err, LW_CLOSED, "interrupted");
    for (uint32_t user = 0; user < r->viewers.count; user++) {
        enum lw_status status = lw_client_poll(r->viewers.user[user].client, 0, err);
        if (status != LW_OK) return status;
    }
    return LW_OK;
}

static enum lw_status await_first_light(struct real_run *r, struct lw_error *err) {
    const uint64_t end_ns = lw_clock_ns() + FIRST_LIGHT_S * 1000000000ull;
    for (uint32_t user = 0; user < r->viewers.count;) {
        enum lw_status status = poll_all(r, err);
        if (status == LW_OK) status = lw_client_poll(r->viewers.user[user].client, 10, err);
        if (status != LW_OK) return status;
        if (lw_viewers_stats(&r->viewers, user).settled_frame) user++;
        if (lw_clock_ns() > end_ns)
            return lw_status_fail(err, LW_TIMED_OUT, "no light within %u s", FIRST_LIGHT_S);
    }
    return LW_OK;
}

/* Scene time at this moment, as the newest frame tells it. */
static double now_s(const struct real_run *r, uint32_t user) {
    const struct lw_client_stats stats = lw_viewers_stats(&r->viewers, user);
    return stats.time_s + 1e-9 * (double)stats.light_age_ns;
}

/* Composes a view with the camera of the moment at which that begins. */
static enum lw_status compose_view(struct real_run *r, uint32_t user, struct lw_real_picture *out_picture,
                                   struct lw_error *err) {
    enum lw_status status = poll_all(r, err);
    if (status == LW_OK) status = lw_viewers_follow(&r->viewers, err);
    if (status != LW_OK) return status;
    const uint64_t frame = 1 + (uint64_t)fmax(0, floor(now_s(r, user) * LW_VIEWS_HZ));
    const struct lw_renderer_cameras *cameras = &r->desc->side->cameras;
    const struct lw_camera_view camera = cameras->at(cameras->context, user, frame);
    status = lw_viewers_show(&r->viewers, user, &camera, r->rgb, err);
    if (status == LW_OK) status = lw_viewers_look(&r->viewers, user, &camera, lw_clock_ns(), err);
    if (status != LW_OK) return status;
    r->views++;
    const double age_s = 1e-9 * (double)lw_viewers_stats(&r->viewers, user).light_age_ns;
    r->age_sum_s += age_s;
    *out_picture = (struct lw_real_picture){
        .time_s = now_s(r, user), .view_frame = frame, .user = user, .light_age_s = age_s};
    return LW_OK;
}

/* Adds a picture. Returns its lattice, to be filled; NULL: no memory. */
static float *add_picture(struct lw_real_run *run, const struct lw_real_picture *picture,
                          const struct lw_renderer_desc *side, struct lw_error *err) {
    const size_t pixels = (size_t)(side->width / side->stride) * (side->height / side->stride);
    float *lattice = malloc(3 * pixels * sizeof *lattice);
    if (!lattice) {
        (void)lw_status_fail(err, LW_NO_MEMORY, "no memory for a picture");
        return NULL;
    }
    run->picture[run->picture_count] = *picture;
    run->picture[run->picture_count++].lattice = lattice;
    return lattice;
}

/* Whether a picture is to be kept: kept ones are spread over the measured time. */
static bool is_due(const struct lw_real_run *run, double passed_s, double seconds) {
    return run->picture_count < LW_REAL_RUN_PICTURES &&
           passed_s >= seconds * (2 * run->picture_count + 1) / (2 * LW_REAL_RUN_PICTURES);
}

/* Users look in turn, as often as the machine lets them; some of what they see is kept. */
static enum lw_status run_viewers(struct real_run *r, struct lw_real_run *run, struct lw_error *err) {
    const struct lw_real_run_desc *d = r->desc;
    const uint64_t began_ns = lw_clock_ns();
    const uint64_t frames = lw_viewers_stats(&r->viewers, 0).frames;
    const double cpu_s = lw_daemon_child_cpu_s(r->daemon);
    enum lw_status status = LW_OK;
    double passed_s = 0;
    while (status == LW_OK && passed_s < d->seconds) {
        struct lw_real_picture picture;
        status = compose_view(r, (uint32_t)(r->views % r->viewers.count), &picture, err);
        passed_s = 1e-9 * (double)(lw_clock_ns() - began_ns);
        if (status != LW_OK || !is_due(run, passed_s, d->seconds)) continue;
        float *lattice = add_picture(run, &picture, d->side, err);
        if (!lattice) return LW_NO_MEMORY;
        lw_lattice_pick(r->rgb, d->side->width, d->side->height, d->side->stride, lattice);
    }
    if (status != LW_OK) return status;
    run->frames_hz = (double)(lw_viewers_stats(&r->viewers, 0).frames - frames) / passed_s;
    run->views_hz = (double)r->views / passed_s;
    run->server_cpu_s = (lw_daemon_child_cpu_s(r->daemon) - cpu_s) / passed_s;
    run->light_age_s = r->age_sum_s / (double)r->views;
    return LW_OK;
}

static enum lw_status warm(struct real_run *r, struct lw_error *err) {
    enum lw_status status = await_first_light(r, err);
    const double cpu_s = lw_daemon_child_cpu_s(r->daemon) + r->desc->warm_cpu_s;
    for (uint64_t end_ns = lw_clock_ns() + (uint64_t)(1e9 * r->desc->warm_s);
         status == LW_OK && lw_clock_ns() < end_ns && lw_daemon_child_cpu_s(r->daemon) < cpu_s;) {
        struct lw_real_picture ignored; /* looking is part of it: the interest follows from the view */
        status = compose_view(r, (uint32_t)(r->views % r->viewers.count), &ignored, err);
    }
    r->views = 0;
    r->age_sum_s = 0;
    return status;
}

enum lw_status lw_real_run(const struct lw_real_run_desc *desc, struct lw_real_run *out_run,
                           struct lw_error *err) {
    struct real_run r = {.desc = desc};
    struct lw_real_run run = {.picture_count = 0};
    r.rgb = malloc((size_t)desc->side->width * desc->side->height * 3 * sizeof *r.rgb);
    if (!r.rgb) return lw_status_fail(err, LW_NO_MEMORY, "no memory for a picture");
    enum lw_status status =
        lw_cache_renderer_serve(desc->side, &desc->setting, desc->seed, true, &r.daemon, &r.viewers, err);
    if (status == LW_OK) status = lw_viewers_set_count(&r.viewers, desc->users, err);
    if (status == LW_OK) status = warm(&r, err);
    if (status == LW_OK) status = run_viewers(&r, &run, err);
    lw_viewers_finish(&r.viewers);
    lw_daemon_child_stop(r.daemon);
    free(r.rgb);
    if (status == LW_OK)
        *out_run = run;
    else
        lw_real_run_finish(&run);
    return status;
}

/* ---- a renderer for one user ---- */

/* Waits for the next frame, of those that count from 1. */
static void await_frame(uint64_t began_ns, double first_s, uint64_t frame) {
    const double left_s =
        (double)(frame - 1) / LW_VIEWS_HZ - first_s - 1e-9 * (double)(lw_clock_ns() - began_ns);
    if (!(left_s > 0)) return;
    const struct timespec pause = {.tv_sec = (time_t)left_s,
                                   .tv_nsec = (long)(1e9 * (left_s - floor(left_s)))};
    nanosleep(&pause, NULL); /* if a signal ends it early, the frame is shown that much too soon */
}

static enum lw_status run_renderer(const struct lw_real_run_desc *d, struct lw_renderer *renderer,
                                   struct lw_real_run *run, struct lw_error *err) {
    enum lw_status status = LW_OK;
    const uint64_t began_ns = lw_clock_ns();
    double age_sum_s = 0, passed_s = 0;
    uint64_t views = 0, frame = 0;
    while (status == LW_OK && passed_s < d->warm_s + d->seconds) {
        if (d->cancel && *d->cancel) return lw_status_fail(err, LW_CLOSED, "interrupted");
        await_frame(began_ns, d->first_s, frame + 1);
        const double began_s = d->first_s + 1e-9 * (double)(lw_clock_ns() - began_ns);
        const uint64_t now = 1 + (uint64_t)floor(began_s * LW_VIEWS_HZ);
        frame = now > frame ? now : frame + 1;
        struct lw_cost cost = {0};
        status = renderer->ops->step(renderer, frame, &d->user, 1, &cost, err);
        passed_s = 1e-9 * (double)(lw_clock_ns() - began_ns);
        if (status != LW_OK || passed_s < d->warm_s) continue;
        struct lw_real_picture picture = {
            .time_s = d->first_s + passed_s, .view_frame = frame, .user = d->user};
        picture.light_age_s = picture.time_s - (double)(frame - 1) / LW_VIEWS_HZ;
        age_sum_s += picture.light_age_s;
        views++;
        if (!is_due(run, passed_s - d->warm_s, d->seconds)) continue;
        float *lattice = add_picture(run, &picture, d->side, err);
        if (!lattice) return LW_NO_MEMORY;
        renderer->ops->picture(renderer, 0, lattice);
    }
    run->views_hz = (double)views / (passed_s - d->warm_s);
    run->light_age_s = age_sum_s / (double)views;
    return status;
}

enum lw_status lw_real_run_paths(const struct lw_real_run_desc *desc, struct lw_real_run *out_run,
                                 struct lw_error *err) {
    struct lw_real_run run = {.picture_count = 0};
    struct lw_renderer *renderer;
    enum lw_status status = lw_per_user_renderer_create(desc->side, desc->kind, &renderer, err);
    if (status != LW_OK) return status;
    status = renderer->ops->start(renderer, &desc->setting, false, desc->seed, err);
    if (status == LW_OK) status = renderer->ops->set_users(renderer, 1, err);
    if (status == LW_OK) status = run_renderer(desc, renderer, &run, err);
    renderer->ops->destroy(renderer);
    if (status == LW_OK)
        *out_run = run;
    else
        lw_real_run_finish(&run);
    return status;
}

void lw_real_run_finish(struct lw_real_run *run) {
    for (uint32_t i = 0; i < run->picture_count; i++) free(run->picture[i].lattice);
    *run = (struct lw_real_run){0};
}
