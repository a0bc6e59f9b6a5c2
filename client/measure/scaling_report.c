#include "client/measure/scaling_report.h"

#include "client/measure/gnuplot.h"
#include "client/measure/report_text.h"
#include "client/measure/scaling_run.h"

#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define LAG_TIMES 3.0 /* the error asked for: at least so much must light be off that is late */

/* ---- words ---- */

static void print_figure(FILE *f, const struct lw_scaling_figure *figure) {
    if (!isfinite(figure->mean))
        fprintf(f, "none");
    else if (figure->half > 0)
        fprintf(f, "%.3g ± %.2g", figure->mean, figure->half);
    else
        fprintf(f, "%.3g", figure->mean);
}

/* A note of the folder. */
static const char *get(const struct lw_scaling *x, const char *key) {
    const char *value = lw_measure_store_get(&x->base.store, key);
    return value ? value : "?";
}

static double mean_noise(const struct lw_scaling *x) {
    double sum = 0;
    for (uint32_t p = 0; p < LW_SCALING_PICTURES; p++)
        for (uint32_t eye = 0; eye < x->eyes; eye++) sum += x->reference[p][eye].noise;
    return sum / (LW_SCALING_PICTURES * x->eyes);
}

/* The error that a path tracer has for the cost of a point of the shared side: along its own points, by
 * logarithms. INFINITY: that does not pay for its cheapest picture; NAN: not known. */
static double paths_error_at(const struct lw_scaling_side *paths, double cost_s) {
    const struct lw_scaling_point *below = NULL, *above = NULL;
    for (uint32_t i = 0; i < paths->point_count; i++) {
        const struct lw_scaling_point *p = &paths->point[i];
        double c = lw_cost_total(&p->cost);
        if (c <= cost_s && (!below || c > lw_cost_total(&below->cost))) below = p;
        if (c > cost_s && (!above || c < lw_cost_total(&above->cost))) above = p;
    }
    if (!below && above) return (double)INFINITY;
    if (!below || !above || below->error <= 0 || above->error <= 0) return (double)NAN;
    double b = log(lw_cost_total(&below->cost)), a = log(lw_cost_total(&above->cost)),
           t = (log(cost_s) - b) / (a - b);
    return exp((1 - t) * log(below->error) + t * log(above->error));
}

/* ---- tables ---- */

static enum lw_status write_users_csv(const struct lw_scaling *x, struct lw_error *err) {
    struct lw_report_text text;
    enum lw_status status = lw_report_text_begin(&text, "scaling.csv", err);
    if (status != LW_OK) return status;
    fprintf(text.stream, "users,repeat,paths_cpu_s_per_frame,shared_cpu_s_per_frame,ratio");
    for (int s = 0; s < LW_STAGE_COUNT; s++)
        fprintf(text.stream, ",mean %s cpu_s", lw_stage_name((enum lw_stage)s));
    fprintf(text.stream, ",mean bytes\n");
    for (uint32_t c = 0; c < x->count_done; c++)
        for (uint32_t i = 0; i < x->repeats_done; i++) {
            const struct lw_scaling_count *count = &x->count[c];
            double paths = count->cost_s[LW_SCALING_PATHS][i], shared = count->cost_s[LW_SCALING_SHARED][i];
            fprintf(text.stream, "%u,%u,%.6g,%.6g,%.6g", count->users, i + 1, paths, shared, shared / paths);
            for (int s = 0; s < LW_STAGE_COUNT; s++) fprintf(text.stream, ",%.6g", count->cost.cpu_s[s]);
            fprintf(text.stream, ",%.6g\n", count->cost.bytes);
        }
    return lw_report_text_save(&text, x->options.base.folder, err);
}

static enum lw_status write_points_csv(const struct lw_scaling *x, struct lw_error *err) {
    struct lw_report_text text;
    enum lw_status status = lw_report_text_begin(&text, "settings.csv", err);
    if (status != LW_OK) return status;
    fprintf(text.stream,
            "side,samples,density,direct_samples,indirect_samples,target_error,relmse,cpu_s_per_frame\n");
    for (int s = 0; s < LW_SCALING_SIDES; s++)
        for (uint32_t i = 0; i < x->side[s].point_count; i++) {
            const struct lw_scaling_point *p = &x->side[s].point[i];
            fprintf(text.stream, "%s,%u,%g,%u,%u,%g,%.6g,%.6g\n", s == LW_SCALING_PATHS ? "paths" : "shared",
                    p->setting.samples, p->setting.density, p->setting.direct_samples,
                    p->setting.indirect_samples, p->setting.target_error, p->error, lw_cost_total(&p->cost));
        }
    return lw_report_text_save(&text, x->options.base.folder, err);
}

static json_t *json_figure(const struct lw_scaling_figure *f) {
    if (!isfinite(f->mean)) return json_null();
    return json_pack("{s:f, s:f}", "mean", f->mean, "half_width_95", f->half);
}

static json_t *json_cost(const struct lw_cost *cost) {
    json_t *object = json_object();
    for (int s = 0; s < LW_STAGE_COUNT; s++)
        json_object_set_new(object, lw_stage_name((enum lw_stage)s), json_real(cost->cpu_s[s]));
    return object;
}

static json_t *json_setting(const struct lw_scaling_side *side, const struct lw_setting *s) {
    if (side->traces) return json_pack("{s:i}", "samples", (int)s->samples);
    return json_pack("{s:f, s:i, s:i, s:f}", "density", s->density, "direct_samples", (int)s->direct_samples,
                     "indirect_samples", (int)s->indirect_samples, "target_error", s->target_error);
}

static json_t *json_side(const struct lw_scaling_side *side) {
    json_t *points = json_array();
    for (uint32_t i = 0; i < side->point_count; i++)
        json_array_append_new(points, json_pack("{s:o, s:f, s:f}", "setting",
                                                json_setting(side, &side->point[i].setting), "relmse",
                                                side->point[i].error, "cpu_s_per_frame",
                                                lw_cost_total(&side->point[i].cost)));
    return json_pack("{s:s, s:o}", "name", side->name, "points", points);
}

static enum lw_status write_json(const struct lw_scaling *x, struct lw_error *err) {
    json_t *counts = json_array(), *targets = json_array();
    for (uint32_t c = 0; c < x->count_done; c++) {
        json_t *paths = json_array(), *shared = json_array();
        for (uint32_t i = 0; i < x->repeats_done; i++) {
            json_array_append_new(paths, json_real(x->count[c].cost_s[LW_SCALING_PATHS][i]));
            json_array_append_new(shared, json_real(x->count[c].cost_s[LW_SCALING_SHARED][i]));
        }
        json_array_append_new(counts, json_pack("{s:i, s:o, s:o, s:o, s:o, s:f}", "users",
                                                (int)x->count[c].users, "paths_cpu_s", paths, "shared_cpu_s",
                                                shared, "ratio", json_figure(&x->count[c].ratio),
                                                "shared_stages_cpu_s", json_cost(&x->count[c].cost),
                                                "bytes_per_frame", x->count[c].cost.bytes));
    }
    for (uint32_t t = 0; t < x->target_count; t++)
        json_array_append_new(targets, json_pack("{s:f, s:i, s:i}", "relmse", x->target[t].error,
                                                 "paths_point", x->target[t].best[LW_SCALING_PATHS],
                                                 "shared_point", x->target[t].best[LW_SCALING_SHARED]));
    json_t *root = json_pack(
        "{s:s, s:s, s:s, s:I, s:s, s:s, s:i, s:i, s:i, s:f, s:o, s:f, s:s?, s:o, s:o, s:o, s:o, s:o, s:o, "
        "s:o, s:o}",
        "command", get(x, "command"), "scene", x->options.base.scene.path, "version", LW_VERSION, "triangles",
        (json_int_t)x->base.densities.triangles, "motion", lw_scene_motion_name(x->options.base.motion),
        "views", x->views ? lw_views_about(x->views) : "", "width", (int)x->options.base.width, "height",
        (int)x->options.base.height, "bounces", (int)x->options.base.bounces, "reference_noise",
        x->eyes ? mean_noise(x) : 0.0, "relmse_of_light_a_second_late",
        isfinite(x->lag_error) ? json_real(x->lag_error) : json_null(), "texels_per_metre",
        x->base.densities.texels_per_metre, "shortfall", x->shortfall, "targets", targets, "paths",
        json_side(&x->side[LW_SCALING_PATHS]), "shared", json_side(&x->side[LW_SCALING_SHARED]), "users",
        counts, "ratio_first", json_figure(&x->first_ratio), "marginal", json_figure(&x->marginal),
        "ratio_first_whole_scene", x->whole_done ? json_real(x->whole_ratio) : json_null(), "crossover_users",
        json_figure(&x->crossover));
    char *text =
        root ? json_dumps(root, JSON_INDENT(1) | JSON_PRESERVE_ORDER | JSON_REAL_PRECISION(8)) : NULL;
    enum lw_status status =
        text ? lw_report_text_write(x->options.base.folder, "scaling.json", text, strlen(text), err)
             : lw_status_fail(err, LW_NO_MEMORY, "no memory for scaling.json");
    free(text);
    json_decref(root);
    return status;
}

/* ---- the report ---- */

static void print_head(const struct lw_scaling *x, FILE *f) {
    fprintf(f, "# Scaling run: %s\n\n    %s\n\n", x->options.base.scene.path, get(x, "command"));
    fprintf(f, "%s, %s.\n\n", get(x, "machine"), get(x, "day"));
    fprintf(f, "%llu triangles, %.3g lightmap texels per metre at density ×1, %u indirect bounces. ",
            (unsigned long long)x->base.densities.triangles, x->base.densities.texels_per_metre,
            x->options.base.bounces);
    fprintf(f, "Motion: %s", lw_scene_motion_name(x->options.base.motion));
    if (x->base.densities.report.light)
        fprintf(f, "; light \"%s\" was set moving, since none did", x->base.densities.report.light);
    if (x->base.densities.report.object)
        fprintf(f, "; object \"%s\" was set moving, since none did", x->base.densities.report.object);
    fprintf(f, ". Views: %s, spread %g, %u × %u pixels.\n\n", x->views ? lw_views_about(x->views) : "none",
            x->options.spread, x->options.base.width, x->options.base.height);
    fprintf(
        f,
        "Cost is CPU time per frame of 1/30 s, of all threads and processes of a side; error is relMSE "
        "against paths "
        "traced to convergence, at one pixel in %u of %u frames and %u user%s (the reference's own noise, "
        "%.2g, is taken out: "
        "`client/measure/figures/reference.h`). Opponent: %s (%s). The lightmaps are %s.%s\n\n",
        x->stride * x->stride, LW_SCALING_PICTURES, x->eyes, x->eyes > 1 ? "s" : "", mean_noise(x),
        lw_path_renderer_name(x->options.opponent), lw_path_renderer_about(x->options.opponent),
        x->options.denoise ? "filtered" : "not filtered",
        x->options.base.motion == LW_SCENE_MOTION_STATIC
            ? " Nothing moves in the scene: what the cache spends at the start is spread over all frames."
            : " The first second is not measured.");
}

/* Whether the views test moving light. They do not if light of a second ago has the same error. */
static void print_lag(const struct lw_scaling *x, FILE *f) {
    if (!isfinite(x->lag_error)) return;
    fprintf(f,
            " Light that is a second late has relMSE %.3g in these views (where they show the same at both "
            "moments, and nothing that shines).",
            x->lag_error);
    if (x->lag_error < LAG_TIMES * x->target[0].error)
        fprintf(f, " **That is under %g times the error asked for: this run does not test motion.**",
                LAG_TIMES);
}

/* Spread of an error over views, without that of random numbers. */
static void print_spread(const struct lw_scaling *x, FILE *f) {
    double least[LW_SCALING_SIDES], most[LW_SCALING_SIDES];
    for (int s = 0; s < LW_SCALING_SIDES; s++) {
        const int best = x->target[0].best[s];
        const struct lw_scaling_errors *errors = &x->side[s].point[best].errors;
        least[s] = (double)INFINITY;
        most[s] = -(double)INFINITY;
        for (uint32_t p = 0; p < LW_SCALING_PICTURES; p++)
            for (uint32_t eye = 0; eye < x->eyes; eye++) {
                if (!errors->judged[p][eye]) continue;
                least[s] = fmin(least[s], errors->of[p][eye]);
                most[s] = fmax(most[s], errors->of[p][eye]);
            }
    }
    if (!isfinite(least[0])) return;
    fprintf(f, " From view to view the path tracer's relMSE goes from %.3g to %.3g", least[0], most[0]);
    if (isfinite(least[1])) fprintf(f, ", the shared side's from %.3g to %.3g", least[1], most[1]);
    fprintf(f, ".");
}

/* Errors of the repeats, whose views differ: the shared side's, and the path tracer's for the same views. */
static void print_errors(const struct lw_scaling *x, FILE *f) {
    if (x->side[LW_SCALING_SHARED].traces || !isfinite(x->shared_error[0])) return;
    fprintf(f, " In the repeats");
    if (!x->options.whole) fprintf(f, ", with %u of the users", x->count[0].users);
    fprintf(f, ": ");
    for (uint32_t i = 0; i < x->repeats_done; i++) fprintf(f, "%s%.3g", i ? ", " : "", x->shared_error[i]);
    fprintf(f, ", where the path tracer has ");
    for (uint32_t i = 0; i < x->repeats_done; i++) fprintf(f, "%s%.3g", i ? ", " : "", x->paths_error[i]);
    fprintf(f, ".");
}

static void print_result(const struct lw_scaling *x, FILE *f) {
    if (x->shortfall) fprintf(f, "**No figures for counts of users: %s.**\n\n", x->shortfall);
    if (!x->repeats_done) return;
    char setting[2][160];
    for (int s = 0; s < LW_SCALING_SIDES; s++)
        lw_scaling_run_describe(&x->side[s], &x->chosen[s], setting[s], sizeof setting[s]);
    fprintf(f, "## Result\n\n");
    if (x->options.fixed_samples)
        fprintf(f, "At given settings: ");
    else
        fprintf(f, "At relMSE %.3g: ", x->target[0].error);
    fprintf(f, "%s (relMSE %.3g) against %s (relMSE %.3g), over the same %u views.", setting[0],
            x->chosen_error[0], setting[1], x->chosen_error[1],
            LW_SCALING_PICTURES * x->eyes - x->dark_count);
    if (x->dark_count) fprintf(f, " %u more show next to nothing, and are not judged.", x->dark_count);
    print_spread(x, f);
    print_errors(x, f);
    print_lag(x, f);
    fprintf(f, "\n\n");
    fprintf(f, "* one shared solve over path tracers, %u user%s: **r = ", x->count[0].users,
            x->count[0].users > 1 ? "s" : "");
    print_figure(f, &x->first_ratio);
    fprintf(f, "**\n");
    if (x->options.user_counts > 1) {
        fprintf(f, "* one more user over one more path tracer: **m = ");
        print_figure(f, &x->marginal);
        fprintf(f, "**\n");
        if (!isfinite(x->crossover.mean))
            fprintf(f,
                    "* sharing is **never** cheaper: another user costs as much as a path tracer, or more\n");
        else if (x->crossover.mean < 1)
            fprintf(f, "* sharing is cheaper from the **first** user on (the lines cross at ");
        else
            fprintf(f, "* sharing is cheaper from more than **");
        if (isfinite(x->crossover.mean)) {
            print_figure(f, &x->crossover);
            fprintf(f, x->crossover.mean < 1 ? ")\n" : "** users on\n");
        }
    }
    if (x->whole_done)
        fprintf(
            f,
            "* with all of the scene lit instead of the interest set and its contributors, once: r = %.3g "
            "(relMSE %.3g; the path tracer %.3g)\n",
            x->whole_ratio, x->whole_error, x->whole_paths_error);
    fprintf(f, "\nIntervals are of 95 %%, over %u repeats with random numbers of their own.",
            x->repeats_done);
    if (x->repeats_done < x->options.base.repeats)
        fprintf(f, " Interrupted: there were to be %u.", x->options.base.repeats);
    fprintf(f, "\n\n");
    fprintf(f, "| users | path tracers, CPU s | shared, CPU s | ratio |\n|---|---|---|---|\n");
    for (uint32_t c = 0; c < x->count_done; c++) {
        double cost[LW_SCALING_SIDES] = {0};
        for (int s = 0; s < LW_SCALING_SIDES; s++)
            for (uint32_t i = 0; i < x->repeats_done; i++)
                cost[s] += x->count[c].cost_s[s][i] / x->repeats_done;
        fprintf(f, "| %u | %.3g | %.3g | ", x->count[c].users, cost[0], cost[1]);
        print_figure(f, &x->count[c].ratio);
        fprintf(f, " |\n");
    }
    fprintf(f, "\n![CPU time over users](cost.png)\n\n");
}

/* With one user and with all of them; one column if that is the same. */
static void print_stages(const struct lw_scaling *x, FILE *f) {
    if (!x->repeats_done || x->side[LW_SCALING_SHARED].traces) return;
    const struct lw_scaling_count *last = &x->count[x->count_done - 1], *column[2] = {&x->count[0], last};
    const int columns = x->count_done > 1 ? 2 : 1;
    fprintf(f, "## Where the shared side's time goes\n\nCPU ms per frame.\n\n| stage |");
    for (int i = 0; i < columns; i++)
        fprintf(f, " %u user%s |", column[i]->users, column[i]->users > 1 ? "s" : "");
    lw_report_text_rule(f, 1 + (uint32_t)columns);
    for (int s = 0; s < LW_STAGE_COUNT; s++) {
        if (!(x->count[0].cost.cpu_s[s] > 0 || last->cost.cpu_s[s] > 0)) continue;
        fprintf(f, "| %s |", lw_stage_name((enum lw_stage)s));
        for (int i = 0; i < columns; i++) fprintf(f, " %.3g |", 1e3 * column[i]->cost.cpu_s[s]);
        fprintf(f, "\n");
    }
    fprintf(f, "\n%.3g Mbit/s per user at 30 frames a second; %.3g M rays per frame.\n\n",
            8e-6 * LW_VIEWS_HZ * last->cost.bytes / last->users, 1e-6 * last->cost.rays);
}

static void print_real(const struct lw_scaling *x, FILE *f) {
    const struct lw_scaling_real *r = &x->real;
    if (!r->done) return;
    fprintf(
        f,
        "## By the wall clock\n\nThe same with scene time as wall time, server and %u client%s on this "
        "machine: %.3g "
        "frames a second solved with %.3g CPU s per second, %.3g views a second composed, light %.0f ms "
        "old. relMSE against the reference of the moment at which a picture was ready: %.3g; %u path%s per "
        "pixel, "
        "unfiltered and without any lag, have %.3g there. These are other views than above, seconds "
        "later.\n\n",
        r->users, r->users > 1 ? "s" : "", r->frames_hz, r->server_cpu_s, r->views_hz, 1e3 * r->light_age_s,
        r->error, x->chosen[LW_SCALING_PATHS].samples, x->chosen[LW_SCALING_PATHS].samples > 1 ? "s" : "",
        r->paths_error);
}

static void print_targets(const struct lw_scaling *x, FILE *f) {
    fprintf(f,
            "## Error and cost\n\nThe cheapest setting of each side that reaches an error, for one user of "
            "%u:\n\n",
            x->eyes);
    fprintf(f, "| relMSE | path tracer | CPU s | shared | CPU s | ratio |\n|---|---|---|---|---|---|\n");
    for (uint32_t t = 0; t < x->target_count; t++) {
        double cost[LW_SCALING_SIDES] = {(double)NAN, (double)NAN};
        fprintf(f, "| %.3g |", x->target[t].error);
        for (int s = 0; s < LW_SCALING_SIDES; s++) {
            int best = x->target[t].best[s];
            char setting[160] = "not reached";
            if (best >= 0) {
                lw_scaling_run_describe(&x->side[s], &x->side[s].point[best].setting, setting,
                                        sizeof setting);
                cost[s] = lw_cost_total(&x->side[s].point[best].cost);
            }
            fprintf(f, " %s |", setting);
            lw_report_text_number(f, cost[s]);
        }
        lw_report_text_number(f, cost[1] / cost[0]);
        fprintf(f, "\n");
    }
    fprintf(f, "\n![Error over CPU time](error.png)\n\nAll settings that were tried. Beside the shared "
               "side's: the error of a path "
               "tracer for the same time, interpolated; no picture: less than its cheapest takes.\n\n| side "
               "| setting | relMSE | CPU s per frame | "
               "path tracer at that "
               "cost |\n|---|---|---|---|---|\n");
    for (int s = 0; s < LW_SCALING_SIDES; s++)
        for (uint32_t i = 0; i < x->side[s].point_count; i++) {
            const struct lw_scaling_point *p = &x->side[s].point[i];
            char setting[160];
            lw_scaling_run_describe(&x->side[s], &p->setting, setting, sizeof setting);
            fprintf(f, "| %s | %s | %.4g | %.4g | ", x->side[s].name, setting, p->error,
                    lw_cost_total(&p->cost));
            double equal = s == LW_SCALING_SHARED
                               ? paths_error_at(&x->side[LW_SCALING_PATHS], lw_cost_total(&p->cost))
                               : (double)NAN;
            if (isinf(equal))
                fprintf(f, "no picture |\n");
            else if (isfinite(equal))
                fprintf(f, "%.3g |\n", equal);
            else
                fprintf(f, " |\n");
        }
    fprintf(f, "\n");
}

static void print_notes(const struct lw_scaling *x, FILE *f) {
    fprintf(f,
            "## What is counted\n\n"
            "* Path tracers: posing the scene and tracing every pixel, once per user. They share nothing, so "
            "that the cost of N "
            "users is N times the mean of %u of them; cost is linear in samples and is measured at 1 and 4.\n"
            "* Shared: the whole process of lightwelld (solve, encode, its network's thread), and of every "
            "client what "
            "receiving, decoding and composing a view takes. All clients are there; with over %u users the "
            "views of %u "
            "a frame, in turn, stand for all. Kernel time of the loopback is in send and receive.\n"
            "* Neither: start-up, import, showing a picture.\n",
            x->eyes, LW_SCALING_SHOWN_MAX, LW_SCALING_SHOWN_MAX);
}

static enum lw_status write_markdown(const struct lw_scaling *x, struct lw_error *err) {
    struct lw_report_text text;
    enum lw_status status = lw_report_text_begin(&text, "report.md", err);
    if (status != LW_OK) return status;
    if (x->eyes) {
        print_head(x, text.stream);
        print_result(x, text.stream);
        print_stages(x, text.stream);
        print_real(x, text.stream);
        print_targets(x, text.stream);
        print_notes(x, text.stream);
    }
    return lw_report_text_save(&text, x->options.base.folder, err);
}

/* ---- plots ---- */

static void plot_both(FILE *f, const char *name, const char *commands) {
    lw_gnuplot_begin(f, name, 720, 480);
    fprintf(f, "%s", commands);
    lw_gnuplot_end(f, name, 720, 480);
}

static enum lw_status write_plots(const struct lw_scaling *x, struct lw_error *err) {
    struct lw_report_text text;
    enum lw_status status = lw_report_text_begin(&text, "scaling.gp", err);
    if (status != LW_OK) return status;
    fprintf(text.stream, "set datafile separator ','\nset logscale xy\nset grid\nset key top left\n");
    if (x->repeats_done)
        plot_both(text.stream, "cost",
                  "set xlabel 'users'\nset ylabel 'CPU s per frame'\n"
                  "plot 'scaling.csv' skip 1 using 1:3 with linespoints lw 2 title 'a path tracer each', "
                  "'scaling.csv' skip 1 using 1:4 with linespoints lw 2 title 'shared'\n");
    plot_both(
        text.stream, "error",
        "set xlabel 'CPU s per frame, one user'\nset ylabel 'relMSE'\nset key top right\n"
        "plot 'settings.csv' skip 1 using (strcol(1) eq 'paths' ? $8 : NaN):7 with points pt 7 title 'path "
        "tracer', "
        "'settings.csv' skip 1 using (strcol(1) eq 'shared' ? $8 : NaN):7 with points pt 5 title 'shared'\n");
    return lw_report_text_save(&text, x->options.base.folder, err);
}

enum lw_status lw_scaling_report_write(const struct lw_scaling *x, struct lw_error *err) {
    enum lw_status status = write_users_csv(x, err);
    if (status == LW_OK) status = write_points_csv(x, err);
    if (status == LW_OK) status = write_json(x, err);
    if (status == LW_OK) status = write_markdown(x, err);
    if (status == LW_OK) status = write_plots(x, err);
    if (status == LW_OK && x->side[LW_SCALING_PATHS].point_count)
        lw_gnuplot_run(x->options.base.folder, "scaling.gp");
    return status;
}

void lw_scaling_report_print(const struct lw_scaling *x) {
    printf("report: %s/report.md\n", x->options.base.folder);
    if (x->shortfall) printf("no figures for counts of users: %s\n", x->shortfall);
    if (!x->repeats_done) return;
    printf("r(%u) = %.4g +- %.2g\n", x->count[0].users, x->first_ratio.mean, x->first_ratio.half);
    if (x->options.user_counts < 2) return;
    printf("m = %.4g +- %.2g\n", x->marginal.mean, x->marginal.half);
    printf("crossover at %.4g +- %.2g users\n", x->crossover.mean, x->crossover.half);
}
