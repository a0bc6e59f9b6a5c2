#include "client/measure/scaling_measure.h"

#include "client/measure/scaling_run.h"
#include "client/measure/scaling_search.h"
#include "client/measure/scaling_users.h"
#include "client/measure/sides/cache_renderer.h"
#include "client/measure/sides/lattice.h"
#include "client/measure/sides/per_user_renderer.h"
#include "client/measure/sides/real_run.h"
#include "common/base/log.h"
#include "common/base/progress.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#define WARM_S      1
#define REAL_WARM_S 20 /* at most */
#define REAL_MORE_S 4
#define LAG_S       1.0 /* age of the light by which a row shows whether it tests motion */

/* ---- before ---- */

static enum lw_status set_views(struct lw_scaling *x, const struct lw_trace *trace, struct lw_error *err) {
    const struct lw_scaling_options *o = &x->options;
    const struct lw_views_desc desc = {.scene = x->base.densities.scene,
                                       .trace = trace,
                                       .kind = o->views,
                                       .users = o->users[o->user_counts - 1],
                                       .spread = (float)o->spread,
                                       .seed = o->base.seed,
                                       .aspect = (float)o->base.width / (float)o->base.height};
    return lw_views_create(&desc, &x->views, err);
}

static void lay_out(struct lw_scaling *x) {
    const uint32_t most = x->options.users[x->options.user_counts - 1];
    x->still = x->options.base.motion == LW_SCENE_MOTION_STATIC && lw_views_rest(x->views);
    x->warm_frames = WARM_S * LW_VIEWS_HZ;
    x->frames = (uint64_t)fmax(LW_SCALING_PICTURES, round(x->options.base.seconds * LW_VIEWS_HZ));
    for (uint32_t p = 0; p < LW_SCALING_PICTURES; p++)
        x->picture[p] = x->warm_frames + 1 + (2 * p + 1) * (x->frames - 1) / (2 * LW_SCALING_PICTURES);
    /* a picture that builds on others takes all frames before it, at full size: fewer eyes judge */
    const bool remembers = lw_path_renderer_remembers(x->options.opponent);
    const uint32_t eyes = remembers ? LW_SCALING_EYES / 2 : LW_SCALING_EYES;
    x->eyes = most < eyes ? most : eyes;
    x->stride = lw_lattice_stride(x->options.base.width, x->options.base.height);
    x->lattice_width = x->options.base.width / x->stride;
    x->lattice_height = x->options.base.height / x->stride;
}

static enum lw_status leave_out_dark(struct lw_scaling *x, struct lw_error *err) {
    const uint32_t views = LW_SCALING_PICTURES * x->eyes;
    for (uint32_t p = 0; p < LW_SCALING_PICTURES; p++)
        for (uint32_t eye = 0; eye < x->eyes; eye++)
            x->mean_square += x->reference[p][eye].mean_square / views;
    for (uint32_t p = 0; p < LW_SCALING_PICTURES; p++)
        for (uint32_t eye = 0; eye < x->eyes; eye++) {
            x->dark[p][eye] = lw_reference_is_dark(&x->reference[p][eye], x->mean_square);
            x->dark_count += x->dark[p][eye];
        }
    if (x->dark_count == views)
        return lw_status_fail(err, LW_BAD_DATA, "%s: users see no light", x->options.base.scene.path);
    if (x->dark_count)
        lw_log(LW_LOG_WARNING, "%u of %u views show next to nothing and are not judged", x->dark_count,
               views);
    return LW_OK;
}

/* A picture's references, and how far light of a second before is off them. */
static enum lw_status find_reference(struct lw_scaling *x, struct lw_path_world *world, uint32_t picture,
                                     double lag[LW_SCALING_EYES], struct lw_progress *progress,
                                     struct lw_error *err) {
    const double now_s = (double)(x->picture[picture] - 1) / LW_VIEWS_HZ;
    const size_t pixels = (size_t)x->lattice_width * x->lattice_height;
    const bool moves = x->options.base.motion != LW_SCENE_MOTION_STATIC;
    uint32_t *object = calloc(pixels * x->eyes, sizeof *object);
    enum lw_status status = object ? lw_path_world_set_time(world, now_s, err)
                                   : lw_status_fail(err, LW_NO_MEMORY, "no memory for views");
    for (uint32_t late = 0; late <= moves && status == LW_OK; late++) {
        if (late) status = lw_path_world_set_time(world, now_s - LAG_S, err);
        for (uint32_t eye = 0; eye < x->eyes && status == LW_OK; eye++) {
            const struct lw_camera_view camera = lw_views_at(x->views, eye, x->picture[picture]);
            struct lw_reference *reference = &x->reference[picture][eye];
            uint32_t *of_eye = object + pixels * eye;
            /* other seeds than any side's: the reference's noise must know nothing of theirs */
            const uint32_t seed = ~x->options.base.seed, samples = x->options.base.reference_samples;
            status = lw_measure_row_check(&x->base, err);
            if (status != LW_OK) break;
            if (late) {
                status = lw_reference_lag_error(reference, of_eye, world, &camera, samples, seed ^ 1,
                                                &lag[eye], err);
            } else {
                status = lw_reference_init(reference, world, &camera, x->lattice_width, x->lattice_height,
                                           samples, seed, err);
                if (status == LW_OK)
                    status =
                        lw_reference_look(world, &camera, x->lattice_width, x->lattice_height, of_eye, err);
            }
            lw_progress_step(progress, 1);
        }
    }
    free(object);
    return status;
}

static double mean_lag(const struct lw_scaling *x, const double lag[LW_SCALING_PICTURES][LW_SCALING_EYES]) {
    double sum = 0;
    if (x->options.base.motion == LW_SCENE_MOTION_STATIC) return (double)NAN;
    for (uint32_t p = 0; p < LW_SCALING_PICTURES; p++)
        for (uint32_t eye = 0; eye < x->eyes; eye++) sum += x->dark[p][eye] ? 0 : lag[p][eye];
    return sum / (LW_SCALING_PICTURES * x->eyes - x->dark_count);
}

static enum lw_status find_references(struct lw_scaling *x, struct lw_path_world *world,
                                      struct lw_error *err) {
    struct lw_progress progress;
    double lag[LW_SCALING_PICTURES][LW_SCALING_EYES] = {{0}};
    const bool moves = x->options.base.motion != LW_SCENE_MOTION_STATIC;
    enum lw_status status = LW_OK;
    x->lag_error = (double)NAN;
    lw_progress_init(&progress, "tracing the reference", LW_SCALING_PICTURES * x->eyes * (moves ? 2 : 1));
    for (uint32_t p = 0; p < LW_SCALING_PICTURES && status == LW_OK; p++)
        status = find_reference(x, world, p, lag[p], &progress, err);
    lw_progress_end(&progress, status == LW_OK);
    if (status == LW_OK) status = leave_out_dark(x, err);
    if (status == LW_OK) x->lag_error = mean_lag(x, lag);
    return status;
}

/* Views and references, from one scene for rays. */
static enum lw_status look_around(struct lw_scaling *x, struct lw_error *err) {
    const struct lw_measure_options *o = &x->options.base;
    struct lw_path_world world;
    enum lw_status status =
        lw_path_world_init(&world, x->base.densities.scene, o->bounces, (unsigned)o->scene.threads, err);
    if (status == LW_OK) status = set_views(x, world.trace, err);
    if (status == LW_OK) {
        lay_out(x);
        lw_log(LW_LOG_INFO, "%s: %llu triangles, %s", o->scene.path,
               (unsigned long long)x->base.densities.triangles, lw_views_about(x->views));
        status = find_references(x, &world, err);
    }
    lw_path_world_finish(&world);
    return status;
}

static struct lw_renderer_desc side_of(struct lw_scaling *x) {
    const struct lw_renderer_cameras cameras = lw_views_cameras(x->views);
    struct lw_renderer_desc side = lw_measure_row_side(&x->base, &cameras);
    side.stride = x->stride;
    side.still = x->still;
    side.denoise = x->options.denoise;
    return side;
}

static enum lw_status set_sides(struct lw_scaling *x, struct lw_error *err) {
    const struct lw_renderer_desc desc = side_of(x);
    enum lw_status status = LW_OK;
    for (int s = 0; s < LW_SCALING_SIDES && status == LW_OK; s++) {
        struct lw_scaling_side *side = &x->side[s];
        side->traces = s == LW_SCALING_PATHS || x->options.self_test;
        side->name = side->traces ? lw_path_renderer_name(x->options.opponent) : "shared cache";
        status = side->traces ? lw_per_user_renderer_create(&desc, x->options.opponent, &side->renderer, err)
                              : lw_cache_renderer_create(&desc, &side->renderer, err);
    }
    return status;
}

/* ---- by the wall clock ---- */

/* Error of the chosen path tracer's picture of the same view and moment. */
static enum lw_status judge_paths(const struct lw_scaling *x, const struct lw_path_world *world,
                                  const struct lw_camera_view *camera, const struct lw_reference *reference,
                                  double *out_error, struct lw_error *err) {
    struct lw_path_film film;
    enum lw_status status = lw_path_film_init(&film, x->lattice_width, x->lattice_height, err);
    if (status != LW_OK) return status;
    lw_path_world_render(world, &(struct lw_path_view){.camera = *camera, .seed = x->options.base.seed},
                         x->chosen[LW_SCALING_PATHS].samples, &film);
    lw_path_film_resolve(&film, film.half[0]);
    *out_error = lw_reference_error(reference, film.half[0]);
    lw_path_film_finish(&film);
    return LW_OK;
}

static enum lw_status judge_real(struct lw_scaling *x, const struct lw_renderer_desc *side,
                                 const struct lw_real_run *real, struct lw_error *err) {
    struct lw_path_world world;
    enum lw_status status =
        lw_path_world_init(&world, x->base.densities.scene, side->bounces, side->threads, err);
    if (status != LW_OK) return status;
    uint32_t judged = 0;
    for (uint32_t p = 0; p < real->picture_count && status == LW_OK; p++) {
        const struct lw_real_picture *picture = &real->picture[p];
        struct lw_reference reference = {0};
        double paths_error = 0;
        status = lw_reference_init_real(&reference, &world, side, picture, x->options.base.reference_samples,
                                        ~x->options.base.seed, err);
        if (status == LW_OK && !lw_reference_is_dark(&reference, x->mean_square)) {
            const struct lw_camera_view camera = lw_views_at(x->views, picture->user, picture->view_frame);
            status = judge_paths(x, &world, &camera, &reference, &paths_error, err);
            x->real.error += lw_reference_error(&reference, picture->lattice);
            x->real.paths_error += paths_error;
            judged++;
        }
        lw_reference_finish(&reference);
    }
    x->real.error /= judged; /* NAN where all is dark */
    x->real.paths_error /= judged;
    lw_path_world_finish(&world);
    return status;
}

static enum lw_status measure_real(struct lw_scaling *x, struct lw_error *err) {
    const struct lw_renderer_desc side = side_of(x);
    struct lw_real_run real;
    enum lw_status status =
        lw_real_run(&(struct lw_real_run_desc){.side = &side,
                                               .setting = x->chosen[LW_SCALING_SHARED],
                                               .seed = x->options.base.seed,
                                               .seconds = x->options.base.seconds + REAL_MORE_S,
                                               .warm_s = REAL_WARM_S,
                                               .warm_cpu_s = x->warm_cpu_s,
                                               .users = x->count[0].users,
                                               .cancel = x->base.cancel},
                    &real, err);
    if (status != LW_OK) return status;
    x->real = (struct lw_scaling_real){.frames_hz = real.frames_hz,
                                       .views_hz = real.views_hz,
                                       .server_cpu_s = real.server_cpu_s,
                                       .light_age_s = real.light_age_s};
    status = judge_real(x, &side, &real, err);
    lw_real_run_finish(&real);
    return status;
}

/* From the notes of an earlier run, or measured. */
static enum lw_status run_by_the_clock(struct lw_scaling *x, struct lw_error *err) {
    struct lw_scaling_real *r = &x->real;
    char key[LW_MEASURE_NAME_SIZE], setting[LW_MEASURE_NAME_SIZE];
    lw_measure_store_setting(&x->chosen[LW_SCALING_SHARED], true, setting);
    snprintf(key, sizeof key, "clock %.57s", setting);
    const char *before = lw_measure_store_get(&x->base.store, key);
    enum lw_status status = LW_OK;
    if (!before || sscanf(before, "%lf,%lf,%lf,%lf,%lf,%lf", &r->frames_hz, &r->views_hz, &r->server_cpu_s,
                          &r->light_age_s, &r->error, &r->paths_error) != 6) {
        status = measure_real(x, err);
        if (status == LW_OK)
            status =
                lw_measure_row_note(&x->base, err, key, "%.6g,%.6g,%.6g,%.6g,%.6g,%.6g", r->frames_hz,
                                    r->views_hz, r->server_cpu_s, r->light_age_s, r->error, r->paths_error);
    }
    r->users = x->count[0].users;
    r->done = status == LW_OK;
    return status;
}

/* ---- the whole ---- */

/* Further options that the views and costs of users depend on. */
static enum lw_status bind(struct lw_scaling *x, struct lw_error *err) {
    const struct lw_scaling_options *o = &x->options;
    char users[200] = "";
    size_t at = 0;
    for (uint32_t c = 0; c < o->user_counts && at < sizeof users; c++)
        at += (size_t)snprintf(users + at, sizeof users - at, "%s%u", c ? "," : "", o->users[c]);
    enum lw_status status = lw_measure_row_bind(&x->base, err, "views", "%s, spread %g",
                                                o->views == LW_VIEWS_WALK ? "walk" : "centre", o->spread);
    if (status == LW_OK) status = lw_measure_row_bind(&x->base, err, "users", "%s", users);
    if (status == LW_OK)
        status = lw_measure_row_bind(&x->base, err, "opponent", "%s", lw_path_renderer_name(o->opponent));
    if (status == LW_OK)
        status = lw_measure_row_bind(&x->base, err, "lightmaps", "%s, %s",
                                     o->denoise ? "filtered" : "not filtered", o->whole ? "whole" : "seen");
    return status;
}

static enum lw_status measure(struct lw_scaling *x, const char *command, struct lw_error *err) {
    const struct lw_scaling_options *o = &x->options;
    enum lw_status status = bind(x, err);
    if (status == LW_OK) status = lw_measure_row_open_scene(&x->base, command, err);
    if (status == LW_OK) status = look_around(x, err);
    if (status == LW_OK) status = set_sides(x, err);
    if (status == LW_OK) status = lw_scaling_search(x, err);
    if (status == LW_OK) status = lw_scaling_users(x, err);
    return status == LW_OK && x->repeats_done && !o->self_test ? run_by_the_clock(x, err) : status;
}

enum lw_status lw_scaling_measure(const struct lw_scaling_options *options, const char *command,
                                  const _Atomic bool *cancel, struct lw_scaling *x, struct lw_error *err) {
    *x = (struct lw_scaling){.options = *options};
    enum lw_status status = lw_measure_row_open(&x->base, &x->options.base, cancel, err);
    if (status == LW_OK) status = measure(x, command, err);
    if (*cancel) {
        if (!x->repeats_done) x->shortfall = "interrupted";
        status = LW_OK; /* whatever the signal did to a side */
    }
    for (int s = 0; s < LW_SCALING_SIDES; s++) {
        if (x->side[s].point_count && x->side[s].point[0].later) { /* the deciding repeats were never made */
            x->side[s].point_count = 0;
            x->target[0].best[s] = -1;
        }
        if (x->side[s].renderer) x->side[s].renderer->ops->destroy(x->side[s].renderer);
        x->side[s].renderer = NULL;
    }
    return status;
}

void lw_scaling_finish(struct lw_scaling *x) {
    for (uint32_t p = 0; p < LW_SCALING_PICTURES; p++)
        for (uint32_t eye = 0; eye < LW_SCALING_EYES; eye++) lw_reference_finish(&x->reference[p][eye]);
    lw_views_destroy(x->views);
    lw_measure_row_finish(&x->base);
    *x = (struct lw_scaling){0};
}
