#include "tests/bench/latency_walk.h"

#include "tests/bench/bench_setup.h"

#include "common/base/clock.h"

#include <signal.h>
#include <stdio.h>
#include <stdlib.h>

#define TIMES_MAX  64u
#define PASSES_MAX 64u
#define BACK_S     1.0 /* length of the movement that p is a share of */

/* What a client has of the first frame at or after a time. */
struct sight {
    double late_ms; /* the frame's scene time after the one that was asked for */
    double age_ms;  /* age of its light, when the client has decoded it */
    double share, error;
    double *residual[2]; /* by both seeds */
};

struct stop {
    double time_s;
    struct latency_pair pair;
    double agreement;
    double due_s;   /* scene time, not wrapped, of the next sight */
    uint64_t frame; /* awaited frame; 0: its time has not come */
    double late_s;  /* delay of that frame */
    size_t seen;
    struct sight sight[PASSES_MAX];
    double lasting; /* error that is the same in all passes: without their noise */
};

struct walk {
    struct latency_light *light;
    const struct latency_walk_desc *desc;
    double duration_s;
    size_t stop_count;
    struct stop *stop;
    float *now; /* the client's light */
};

/* ---- settings ---- */

static enum lw_status read_times(struct walk *w, struct lw_error *err) {
    const char *text = w->desc->times;
    for (;;) {
        char *end;
        const double time_s = strtod(text, &end);
        if (end == text || (*end && *end != ','))
            return lw_status_fail(err, LW_USAGE, "--times: numbers apart by commas are wanted, not '%s'",
                                  text);
        if (!(time_s >= 0 && time_s < w->duration_s))
            return lw_status_fail(err, LW_USAGE,
                                  "--times: the animation is from 0 to %g s, which %g is not in",
                                  w->duration_s, time_s);
        if (w->stop_count == TIMES_MAX)
            return lw_status_fail(err, LW_USAGE, "--times: more than %u", TIMES_MAX);
        w->stop[w->stop_count++].time_s = time_s;
        if (!*end) return LW_OK;
        text = end + 1;
    }
}

static enum lw_status check(struct walk *w, struct lw_error *err) {
    w->duration_s = (double)latency_light_scene(w->light)->duration_s;
    if (!(w->duration_s > 0))
        return lw_status_fail(err, LW_USAGE, "%s: has no animation, so that nothing walks", w->light->scene);
    if (w->desc->passes < 2 || w->desc->passes > PASSES_MAX)
        return lw_status_fail(err, LW_USAGE, "--updates: 2 to %u passes", PASSES_MAX);
    if (w->duration_s < BACK_S)
        return lw_status_fail(err, LW_USAGE,
                              "%s: its animation of %g s is over before there is a %g s before",
                              w->light->scene, w->duration_s, BACK_S);
    return read_times(w, err);
}

/* From one place all the time. */
static enum lw_status look_from(struct walk *w, struct lw_error *err) {
    struct lw_pose pose;
    enum lw_status status = lw_pose_init(&pose, latency_light_scene(w->light));
    if (status != LW_OK) return lw_status_fail(err, status, "pose");
    if (latency_light_look_from(w->light, &pose, w->desc->camera))
        status =
            lw_status_fail(err, LW_USAGE, "camera \"%s\" moves: say a place, as --camera of lightwell-view",
                           w->desc->camera);
    lw_pose_finish(&pose);
    return status;
}

static enum lw_status solve(struct walk *w, struct stop *stop, struct lw_error *err) {
    const double before_s = fmod(stop->time_s - BACK_S + w->duration_s, w->duration_s);
    char before[512], after[512];
    if ((size_t)snprintf(before, sizeof before, "%s at %.17g", w->desc->camera, before_s) >= sizeof before)
        latency_give_up("the camera's name is too long");
    snprintf(after, sizeof after, "%s at %.17g", w->desc->camera, stop->time_s);
    latency_light_solve(w->light, &(struct latency_state){.text = before, .time_s = before_s},
                        &(struct latency_state){.text = after, .time_s = stop->time_s}, &stop->pair);
    latency_light_judge(w->light, &stop->pair);
    stop->agreement = w->light->agreement;
    return stop->agreement > 0
               ? LW_OK
               : lw_status_fail(err, LW_USAGE,
                                "--times: %g: the picture shows nothing but noise that was not there %g s "
                                "before (agreement %.2f)",
                                stop->time_s, BACK_S, stop->agreement);
}

/* ---- the walk ---- */

/* Scene time of the newest frame that a client has heard of, not wrapped. */
struct scene_clock {
    double now_s, lap_s, last_s;
};
static void advance_clock(struct scene_clock *clock, double duration_s, double time_s) {
    if (time_s < clock->last_s) clock->lap_s += duration_s;
    clock->last_s = time_s;
    clock->now_s = clock->lap_s + time_s;
}

/* Judges the light of the first frame at or after the stop's time, once all of it is there. */
static void judge_stop(struct walk *w, struct stop *stop, const struct lw_client *client,
                       const struct lw_client_stats *stats, double now_s) {
    if (!stop->frame && now_s >= stop->due_s) {
        stop->frame = stats->frame;
        stop->late_s = now_s - stop->due_s;
    }
    if (!stop->frame || stats->settled_frame < stop->frame) return;
    const double age_ms = 1e-6 * (double)stats->light_age_ns;
    latency_light_read(w->light, client, w->now);
    latency_light_judge(w->light, &stop->pair);
    struct sight sight = {
        .late_ms = 1e3 * stop->late_s, .age_ms = age_ms, .share = latency_light_share(w->light, w->now)};
    for (unsigned k = 0; k < 2; k++) {
        sight.residual[k] =
            latency_room(LATENCY_CHANNELS * w->light->square_count, sizeof *sight.residual[k]);
        latency_light_residual(w->light, w->now, k, sight.residual[k]);
    }
    sight.error = latency_light_error(w->light, sight.residual[0], sight.residual[1]);
    stop->sight[stop->seen++] = sight;
    stop->due_s += w->duration_s;
    stop->frame = 0;
}

static void begin_passes(struct walk *w, double now_s) {
    for (size_t i = 0; i < w->stop_count; i++)
        w->stop[i].due_s =
            w->stop[i].time_s + w->duration_s * ceil((now_s - w->stop[i].time_s) / w->duration_s);
}

static bool is_done(const struct walk *w) {
    for (size_t i = 0; i < w->stop_count; i++)
        if (w->stop[i].seen < (size_t)w->desc->passes) return false;
    return true;
}

static void walk(struct walk *w) {
    struct lw_process server;
    struct lw_client *client;
    struct lw_client_stats stats;
    struct scene_clock clock = {0};
    latency_light_watch(w->light, "--animate", &server, &client);
    lw_client_get_stats(client, &stats);
    const uint64_t from_ns = lw_clock_ns(), frames = stats.frames;
    const uint64_t settle_ns = (uint64_t)(1e9 * w->desc->settle_s);
    const uint64_t limit_ns =
        settle_ns + LATENCY_PATIENCE_NS + (uint64_t)(1e9 * w->duration_s * (double)(w->desc->passes + 1));
    for (bool passes = false; !is_done(w);) {
        latency_light_poll(client, LATENCY_POLL_MS, &stats);
        advance_clock(&clock, w->duration_s, stats.time_s);
        const uint64_t waited_ns = lw_clock_ns() - from_ns;
        if (waited_ns > limit_ns) latency_give_up("the animation's frames do not come");
        if (!passes && waited_ns >= settle_ns && stats.frames - frames >= (uint64_t)w->desc->frames) {
            begin_passes(w, clock.now_s);
            passes = true;
        }
        for (size_t i = 0; i < w->stop_count && passes; i++)
            if (w->stop[i].seen < (size_t)w->desc->passes)
                judge_stop(w, &w->stop[i], client, &stats, clock.now_s);
    }
    lw_client_destroy(client);
    (void)lw_process_stop(&server, SIGTERM, LW_PROCESS_LIMIT_S);
}

/* The mean over pairs of different passes. */
static void find_lasting(struct walk *w, struct stop *stop) {
    double sum = 0;
    latency_light_judge(w->light, &stop->pair);
    for (size_t i = 0; i < stop->seen; i++)
        for (size_t k = 0; k < stop->seen; k++)
            if (i != k)
                sum += latency_light_error(w->light, stop->sight[i].residual[0], stop->sight[k].residual[1]);
    stop->lasting = sum / (double)(stop->seen * (stop->seen - 1));
}

/* ---- output ---- */

static double median_of(const struct sight *sight, size_t count, double (*value)(const struct sight *)) {
    double v[PASSES_MAX];
    for (size_t i = 0; i < count; i++) v[i] = value(&sight[i]);
    return bench_median(v, count);
}
static double share_of(const struct sight *s) { return s->share; }
static double error_of(const struct sight *s) { return s->error; }

static void print_table(const struct walk *w) {
    printf("%s from %s, an animation of %g s\n\n", w->light->scene, w->desc->camera, w->duration_s);
    printf("| time, s | pass | frame, ms after | age, ms | p | error | agreement "
           "|\n|---|---|---|---|---|---|---|\n");
    for (int64_t pass = 0; pass < w->desc->passes; pass++)
        for (size_t i = 0; i < w->stop_count; i++) {
            const struct stop *stop = &w->stop[i];
            const struct sight *sight = &stop->sight[pass];
            printf("| %g | %d | %.0f | %.0f | %.2f | %.2f | %.2f |\n", stop->time_s, (int)pass + 1,
                   sight->late_ms, sight->age_ms, sight->share, sight->error, stop->agreement);
        }
    printf("\n| time, s | median p | trail, s | median error | without noise | agreement "
           "|\n|---|---|---|---|---|---|\n");
    for (size_t i = 0; i < w->stop_count; i++) {
        const struct stop *stop = &w->stop[i];
        const double share = median_of(stop->sight, stop->seen, share_of);
        printf("| %g | %.2f | %.2f | %.2f | %.2f | %.2f |\n", stop->time_s, share, BACK_S * (1 - share),
               median_of(stop->sight, stop->seen, error_of), stop->lasting, stop->agreement);
    }
}

static void print_json(const struct walk *w) {
    json_t *times = json_array();
    for (size_t i = 0; i < w->stop_count; i++) {
        const struct stop *stop = &w->stop[i];
        json_t *passes = json_array();
        for (size_t k = 0; k < stop->seen; k++) {
            const struct sight *sight = &stop->sight[k];
            json_array_append_new(passes,
                                  json_pack("{s:o, s:o, s:o, s:o}", "late_ms", latency_real(sight->late_ms),
                                            "age_ms", latency_real(sight->age_ms), "p",
                                            latency_real(sight->share), "error", latency_real(sight->error)));
        }
        const double share = median_of(stop->sight, stop->seen, share_of),
                     error = median_of(stop->sight, stop->seen, error_of);
        json_array_append_new(times,
                              json_pack("{s:f, s:o, s:o, s:o, s:o, s:o}", "time_s", stop->time_s, "agreement",
                                        latency_real(stop->agreement), "p", latency_real(share), "error",
                                        latency_real(error), "without_noise", latency_real(stop->lasting),
                                        "passes", passes));
    }
    latency_print(json_pack("{s:s, s:s, s:f, s:o}", "scene", w->light->scene, "camera", w->desc->camera,
                            "duration_s", w->duration_s, "times", times));
}

void latency_walk(struct latency_light *light, const struct latency_walk_desc *desc) {
    struct walk w = {.light = light, .desc = desc};
    struct lw_error err = {0};
    w.stop = latency_room(TIMES_MAX, sizeof *w.stop);
    latency_must(check(&w, &err), &err);
    latency_must(look_from(&w, &err), &err);
    for (size_t i = 0; i < w.stop_count; i++) latency_must(solve(&w, &w.stop[i], &err), &err);
    w.now = latency_room(LATENCY_CHANNELS * light->texel_count, sizeof *w.now);
    walk(&w);
    for (size_t i = 0; i < w.stop_count; i++) find_lasting(&w, &w.stop[i]);
    (desc->json ? print_json : print_table)(&w);
    for (size_t i = 0; i < w.stop_count; i++) {
        for (size_t k = 0; k < w.stop[i].seen; k++)
            for (int seed = 0; seed < 2; seed++) free(w.stop[i].sight[k].residual[seed]);
        latency_pair_finish(&w.stop[i].pair);
    }
    free(w.stop);
    free(w.now);
}
