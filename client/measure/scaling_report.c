#include "client/measure/scaling_report.h"

#include "client/measure/report.h"
#include "client/measure/scaling_run.h"

#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define COUNT(array) (sizeof(array) / sizeof *(array))

/* ---- words ---- */

static struct lw_report_words figure(const struct lw_scaling_figure *figure) {
    struct lw_report_words words = {"none"};
    if (isfinite(figure->mean))
        snprintf(words.text, sizeof words.text, figure->half > 0 ? "%.3g ± %.2g" : "%.3g", figure->mean,
                 figure->half);
    return words;
}

static const char *plural(uint32_t count) { return count > 1 ? "s" : ""; }

/* A note of the folder. */
static const char *get(const struct lw_scaling *x, const char *key) {
    return lw_measure_store_note(&x->base.store, key, "?");
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

static void print_users_csv(struct lw_report *out, const void *context) {
    const struct lw_scaling *x = context;
    fprintf(out->f, "users,repeat,paths_cpu_s_per_frame,shared_cpu_s_per_frame,ratio");
    for (int s = 0; s < LW_STAGE_COUNT; s++)
        fprintf(out->f, ",mean %s cpu_s", lw_stage_name((enum lw_stage)s));
    fprintf(out->f, ",mean bytes\n");
    for (uint32_t c = 0; c < x->count_done; c++)
        for (uint32_t i = 0; i < x->repeats_done; i++) {
            const struct lw_scaling_count *count = &x->count[c];
            double paths = count->cost_s[LW_SCALING_PATHS][i], shared = count->cost_s[LW_SCALING_SHARED][i];
            fprintf(out->f, "%u,%u,%.6g,%.6g,%.6g", count->users, i + 1, paths, shared, shared / paths);
            for (int s = 0; s < LW_STAGE_COUNT; s++) fprintf(out->f, ",%.6g", count->cost.cpu_s[s]);
            fprintf(out->f, ",%.6g\n", count->cost.bytes);
        }
}

static void print_points_csv(struct lw_report *out, const void *context) {
    const struct lw_scaling *x = context;
    fprintf(out->f,
            "side,samples,density,direct_samples,indirect_samples,target_error,relmse,cpu_s_per_frame\n");
    for (int s = 0; s < LW_SCALING_SIDES; s++)
        for (uint32_t i = 0; i < x->side[s].point_count; i++) {
            const struct lw_scaling_point *p = &x->side[s].point[i];
            fprintf(out->f, "%s,%u,%g,%u,%u,%g,%.6g,%.6g\n", s == LW_SCALING_PATHS ? "paths" : "shared",
                    p->setting.samples, p->setting.density, p->setting.direct_samples,
                    p->setting.indirect_samples, p->setting.target_error, p->error, lw_cost_total(&p->cost));
        }
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

static void print_json(struct lw_report *out, const void *context) { fputs(context, out->f); }

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
    const struct lw_report_file file = {"scaling.json", print_json};
    enum lw_status status = text ? lw_report_save(x->options.base.folder, &file, 1, text, err)
                                 : lw_status_fail(err, LW_NO_MEMORY, "no memory for scaling.json");
    free(text);
    json_decref(root);
    return status;
}

/* ---- the report ---- */

static void print_head(struct lw_report *out, const struct lw_scaling *x) {
    const struct lw_measure_options *o = &x->options.base;
    const struct lw_scene_motion_report *moves = &x->base.densities.report;
    fprintf(out->f, "# Scaling run: %s\n\n", o->scene.path);
    lw_report_origin(out, get(x, "command"), get(x, "machine"), get(x, "day"));
    fprintf(
        out->f,
        "\n\n%llu triangles, %.3g lightmap texels per metre at density ×1, %u indirect bounces. Motion: %s",
        (unsigned long long)x->base.densities.triangles, x->base.densities.texels_per_metre, o->bounces,
        lw_scene_motion_name(o->motion));
    if (moves->light) fprintf(out->f, "; light \"%s\" was set moving, since none did", moves->light);
    if (moves->object) fprintf(out->f, "; object \"%s\" was set moving, since none did", moves->object);
    lw_report_paragraph(out, ". Views: %s, spread %g, %u × %u pixels.",
                        x->views ? lw_views_about(x->views) : "none", x->options.spread, o->width, o->height);
    lw_report_paragraph(
        out,
        "Cost is CPU time per frame of 1/30 s, of all threads and processes of a side; error is relMSE "
        "against paths traced to convergence, at one pixel in %u of %u frames and %u user%s (the reference's "
        "own noise, %.2g, is taken out: `client/measure/figures/reference.h`). Opponent: %s (%s). The "
        "lightmaps are %s.%s",
        x->stride * x->stride, LW_SCALING_PICTURES, x->eyes, plural(x->eyes), mean_noise(x),
        lw_path_renderer_name(x->options.opponent), lw_path_renderer_about(x->options.opponent),
        x->options.denoise ? "filtered" : "not filtered",
        o->motion == LW_SCENE_MOTION_STATIC
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
    if (x->lag_error < LW_MEASURE_GATE_TIMES * x->target[0].error)
        fprintf(f, " **That is under %g times the error asked for: this run does not test motion.**",
                LW_MEASURE_GATE_TIMES);
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

static void print_chosen(struct lw_report *out, const struct lw_scaling *x) {
    if (x->options.fixed_samples)
        fprintf(out->f, "At given settings: ");
    else
        fprintf(out->f, "At relMSE %.3g: ", x->target[0].error);
    fprintf(out->f, "%s (relMSE %.3g) against %s (relMSE %.3g), over the same %u views.",
            lw_scaling_run_describe(&x->side[0], &x->chosen[0]).text, x->chosen_error[0],
            lw_scaling_run_describe(&x->side[1], &x->chosen[1]).text, x->chosen_error[1],
            LW_SCALING_PICTURES * x->eyes - x->dark_count);
    if (x->dark_count) fprintf(out->f, " %u more show next to nothing, and are not judged.", x->dark_count);
    print_spread(x, out->f);
    print_errors(x, out->f);
    print_lag(x, out->f);
    fprintf(out->f, "\n\n");
}

static void print_ratios(const struct lw_scaling *x, FILE *f) {
    const double crossover = x->crossover.mean;
    fprintf(f, "* one shared solve over path tracers, %u user%s: **r = %s**\n", x->count[0].users,
            plural(x->count[0].users), figure(&x->first_ratio).text);
    if (x->options.user_counts > 1) {
        fprintf(f, "* one more user over one more path tracer: **m = %s**\n", figure(&x->marginal).text);
        fprintf(f,
                !isfinite(crossover)
                    ? "* sharing is **never** cheaper: another user costs as much as a path tracer, or more\n"
                : crossover < 1 ? "* sharing is cheaper from the **first** user on (the lines cross at %s)\n"
                                : "* sharing is cheaper from more than **%s** users on\n",
                figure(&x->crossover).text);
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
}

static void print_result(struct lw_report *out, const struct lw_scaling *x) {
    if (x->shortfall) lw_report_paragraph(out, "**No figures for counts of users: %s.**", x->shortfall);
    if (!x->repeats_done) return;
    lw_report_section(out, "Result", NULL);
    print_chosen(out, x);
    print_ratios(x, out->f);
    lw_report_head(out, "users | path tracers, CPU s | shared, CPU s | ratio");
    for (uint32_t c = 0; c < x->count_done; c++) {
        double cost[LW_SCALING_SIDES] = {0};
        for (int s = 0; s < LW_SCALING_SIDES; s++)
            for (uint32_t i = 0; i < x->repeats_done; i++)
                cost[s] += x->count[c].cost_s[s][i] / x->repeats_done;
        lw_report_row(out, "%u | %.3g | %.3g | %s", x->count[c].users, cost[0], cost[1],
                      figure(&x->count[c].ratio).text);
    }
    lw_report_paragraph(out, "\n![CPU time over users](cost.png)");
}

/* With one user and with all of them; one column if that is the same. */
static void print_stages(struct lw_report *out, const struct lw_scaling *x) {
    if (!x->repeats_done || x->side[LW_SCALING_SHARED].traces) return;
    const struct lw_scaling_count *last = &x->count[x->count_done - 1], *column[2] = {&x->count[0], last};
    const int columns = x->count_done > 1 ? 2 : 1;
    lw_report_section(out, "Where the shared side's time goes", "CPU ms per frame.");
    lw_report_cell(out, "stage");
    for (int i = 0; i < columns; i++)
        lw_report_cell(out, "%u user%s", column[i]->users, plural(column[i]->users));
    lw_report_head(out, NULL);
    for (int s = 0; s < LW_STAGE_COUNT; s++) {
        if (!(x->count[0].cost.cpu_s[s] > 0 || last->cost.cpu_s[s] > 0)) continue;
        lw_report_cell(out, "%s", lw_stage_name((enum lw_stage)s));
        for (int i = 0; i < columns; i++) lw_report_cell(out, "%.3g", 1e3 * column[i]->cost.cpu_s[s]);
        lw_report_end_row(out);
    }
    lw_report_paragraph(out, "\n%.3g Mbit/s per user at 30 frames a second; %.3g M rays per frame.",
                        8e-6 * LW_VIEWS_HZ * last->cost.bytes / last->users, 1e-6 * last->cost.rays);
}

static void print_real(struct lw_report *out, const struct lw_scaling *x) {
    const struct lw_scaling_real *r = &x->real;
    const uint32_t samples = x->chosen[LW_SCALING_PATHS].samples;
    if (!r->done) return;
    lw_report_section(out, "By the wall clock", NULL);
    lw_report_paragraph(
        out,
        "The same with scene time as wall time, server and %u client%s on this machine: %.3g frames a second "
        "solved with %.3g CPU s per second, %.3g views a second composed, light %.0f ms old. relMSE against "
        "the reference of the moment at which a picture was ready: %.3g; %u path%s per pixel, unfiltered and "
        "without any lag, have %.3g there. These are other views than above, seconds later.",
        r->users, plural(r->users), r->frames_hz, r->server_cpu_s, r->views_hz, 1e3 * r->light_age_s,
        r->error, samples, plural(samples), r->paths_error);
}

/* The cheapest settings that reach each error. */
static void print_targets(struct lw_report *out, const struct lw_scaling *x) {
    lw_report_section(out, "Error and cost", NULL);
    lw_report_paragraph(
        out, "The cheapest setting of each side that reaches an error, for one user of %u:", x->eyes);
    lw_report_head(out, "relMSE | path tracer | CPU s | shared | CPU s | ratio");
    for (uint32_t t = 0; t < x->target_count; t++) {
        double cost[LW_SCALING_SIDES] = {(double)NAN, (double)NAN};
        lw_report_cell(out, "%.3g", x->target[t].error);
        for (int s = 0; s < LW_SCALING_SIDES; s++) {
            const int best = x->target[t].best[s];
            const struct lw_scaling_point *p = best < 0 ? NULL : &x->side[s].point[best];
            if (p) cost[s] = lw_cost_total(&p->cost);
            lw_report_cell(out, "%s",
                           p ? lw_scaling_run_describe(&x->side[s], &p->setting).text : "not reached");
            lw_report_number(out, cost[s]);
        }
        lw_report_number(out, cost[1] / cost[0]);
        lw_report_end_row(out);
    }
    lw_report_paragraph(out, "\n![Error over CPU time](error.png)");
}

static void print_points(struct lw_report *out, const struct lw_scaling *x) {
    lw_report_paragraph(
        out,
        "All settings that were tried. Beside the shared side's: the error of a path tracer for the same "
        "time, interpolated; no picture: less than its cheapest takes.");
    lw_report_head(out, "side | setting | relMSE | CPU s per frame | path tracer at that cost");
    for (int s = 0; s < LW_SCALING_SIDES; s++)
        for (uint32_t i = 0; i < x->side[s].point_count; i++) {
            const struct lw_scaling_point *p = &x->side[s].point[i];
            const double cost_s = lw_cost_total(&p->cost),
                         equal = paths_error_at(&x->side[LW_SCALING_PATHS], cost_s);
            lw_report_cell(out, "%s | %s | %.4g | %.4g", x->side[s].name,
                           lw_scaling_run_describe(&x->side[s], &p->setting).text, p->error, cost_s);
            if (s == LW_SCALING_PATHS || isnan(equal))
                lw_report_cell(out, "%s", "");
            else
                lw_report_cell(out, isinf(equal) ? "no picture" : "%.3g", equal);
            lw_report_end_row(out);
        }
    fprintf(out->f, "\n");
}

static void print_notes(struct lw_report *out, const struct lw_scaling *x) {
    lw_report_section(out, "What is counted", NULL);
    fprintf(
        out->f,
        "* Path tracers: posing the scene and tracing every pixel, once per user. They share nothing, so "
        "that the cost of N users is N times the mean of %u of them; cost is linear in samples and is "
        "measured "
        "at 1 and 4.\n"
        "* Shared: the whole process of lightwelld (solve, encode, its network's thread), and of every "
        "client "
        "what receiving, decoding and composing a view takes. All clients are there; with over %u users the "
        "views of %u a frame, in turn, stand for all. Kernel time of the loopback is in send and receive.\n"
        "* Neither: start-up, import, showing a picture.\n",
        x->eyes, LW_SCALING_SHOWN_MAX, LW_SCALING_SHOWN_MAX);
}

static void print_markdown(struct lw_report *out, const void *context) {
    const struct lw_scaling *x = context;
    if (!x->eyes) return;
    print_head(out, x);
    print_result(out, x);
    print_stages(out, x);
    print_real(out, x);
    print_targets(out, x);
    print_points(out, x);
    print_notes(out, x);
}

/* ---- plots ---- */

static void print_plots(struct lw_report *out, const void *context) {
    static const struct lw_report_plot cost = {"cost", 720, 480}, error = {"error", 720, 480};
    const struct lw_scaling *x = context;
    lw_report_script(out, "top left");
    if (x->repeats_done) {
        lw_report_plot(out, &cost);
        fprintf(out->f, "set xlabel 'users'\nset ylabel 'CPU s per frame'\n");
        lw_report_series(out, "a path tracer each", "'scaling.csv' skip 1 using 1:3 with linespoints lw 2");
        lw_report_series(out, "shared", "'scaling.csv' skip 1 using 1:4 with linespoints lw 2");
        lw_report_end_plot(out, &cost);
    }
    lw_report_plot(out, &error);
    fprintf(out->f, "set xlabel 'CPU s per frame, one user'\nset ylabel 'relMSE'\nset key top right\n");
    lw_report_series(out, "path tracer",
                     "'settings.csv' skip 1 using (strcol(1) eq 'paths' ? $8 : NaN):7 with points pt 7");
    lw_report_series(out, "shared",
                     "'settings.csv' skip 1 using (strcol(1) eq 'shared' ? $8 : NaN):7 with points pt 5");
    lw_report_end_plot(out, &error);
}

enum lw_status lw_scaling_report_write(const struct lw_scaling *x, struct lw_error *err) {
    static const struct lw_report_file files[] = {{"scaling.csv", print_users_csv},
                                                  {"settings.csv", print_points_csv},
                                                  {"report.md", print_markdown},
                                                  {"scaling.gp", print_plots}};
    const char *folder = x->options.base.folder;
    enum lw_status status = lw_report_save(folder, files, COUNT(files), x, err);
    if (status == LW_OK) status = write_json(x, err);
    if (status == LW_OK && x->side[LW_SCALING_PATHS].point_count) lw_report_run_gnuplot(folder, "scaling.gp");
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
