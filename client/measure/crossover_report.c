#include "client/measure/crossover_report.h"

#include "client/measure/crossover_analysis.h"
#include "client/measure/crossover_clock.h"
#include "client/measure/crossover_pictures.h"
#include "client/measure/crossover_references.h"
#include "client/measure/report.h"
#include "client/measure/sides/views.h"
#include "common/base/log.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static const double fixed_errors[] = {0.1, 0.02};
static const double sessions_s[] = {10, 60, 600};
static const enum lw_measure_coin own_coins[] = {LW_MEASURE_COIN_RELMSE, LW_MEASURE_COIN_FLIP};
#define COUNT(array) (sizeof(array) / sizeof *(array))

/* A picture of error over cost in each measure. */
static const struct {
    struct lw_report_plot plot;
    const char *axis;
} plots[LW_MEASURE_COIN_COUNT] = {
    [LW_MEASURE_COIN_RELMSE] = {{"relmse", 640, 480}, "relMSE"},
    [LW_MEASURE_COIN_RELMSE_SMALL] = {{"relmse_1e-4", 640, 480}, "relMSE, small epsilon"},
    [LW_MEASURE_COIN_RELMSE_TRIMMED] = {{"relmse_999", 640, 480}, "relMSE, 99.9 % of pixels"},
    [LW_MEASURE_COIN_FLIP] = {{"flip", 640, 480}, "FLIP"},
    [LW_MEASURE_COIN_FLICKER] = {{"flicker", 640, 480}, "flicker"}};

struct row {
    const struct lw_measure_store *store;
    struct lw_crossover_analysis a;
    const char *refusal; /* why nothing can be measured; NULL: it can */
};

/* ---- words ---- */

static const char *get(const struct row *r, const char *key, const char *otherwise) {
    return lw_measure_store_note(r->store, key, otherwise);
}

static struct lw_report_words interval(const struct lw_bootstrap_interval *i) {
    struct lw_report_words words = {"–"};
    const bool is_exact = isnan(i->low) || i->low == i->high;
    if (!isnan(i->value))
        snprintf(words.text, sizeof words.text, is_exact ? "%.3g" : "%.3g (%.3g to %.3g)", i->value, i->low,
                 i->high);
    return words;
}

static const char *coin_word(enum lw_measure_coin coin) {
    return coin == LW_MEASURE_COIN_FLIP ? "FLIP" : "relMSE";
}

/* Whether light that is a second late has so much more error that the row tests moving light. */
static bool tests_motion(const struct row *r, double error) {
    return isnan(r->a.late_error) || r->a.late_error >= LW_MEASURE_GATE_TIMES * error;
}

static bool is_static(const struct row *r) { return strcmp(get(r, "motion", ""), "static") == 0; }

/* The cost of all users is measured over the frames after a step, and the cost of one user after the step. So
 * the report has no ratio of the two. */
static bool has_ratios(const struct row *r) { return strcmp(get(r, "motion", ""), "lamp-switch") != 0; }

static struct lw_report_words ratio_of(const struct row *r, const struct lw_bootstrap_interval *ratio) {
    return interval(has_ratios(r) ? ratio : &(struct lw_bootstrap_interval){.value = (double)NAN});
}

/* The cache over an opponent. Ratios are not known where either is NULL. */
static struct lw_crossover_ratio compare(const struct lw_crossover_point *cache,
                                         const struct lw_crossover_point *opponent,
                                         enum lw_measure_coin coin) {
    if (cache && opponent) return lw_crossover_analysis_compare(cache, opponent, coin);
    return (struct lw_crossover_ratio){.r1.value = (double)NAN, .m.value = (double)NAN};
}

static struct lw_measure_unit unit_of(const struct lw_crossover_point *p) {
    struct lw_measure_unit unit = {.repeat = 0};
    memcpy(unit.renderer, p->renderer, sizeof unit.renderer);
    memcpy(unit.setting, p->setting, sizeof unit.setting);
    return unit;
}

/* ---- at the opponents' own error ---- */

static const struct lw_crossover_point *filtered(const struct row *r, const char *name) {
    return lw_crossover_analysis_find(&r->a, name, NULL);
}

static void say_not_reached(FILE *f, const struct row *r, const struct lw_crossover_point *opponent,
                            enum lw_measure_coin coin) {
    const struct lw_crossover_point *best = lw_crossover_analysis_best(&r->a, coin);
    if (!best) {
        fprintf(f, "no setting of the cache is measured");
        return;
    }
    const struct lw_crossover_ratio ratio = compare(best, opponent, coin);
    fprintf(f, "**not reached**: the best is %s %.3g at %s", coin_word(coin), best->mean[coin].value,
            best->setting);
    if (has_ratios(r)) fprintf(f, ", for %s of its cost", interval(&ratio.r1).text);
    fprintf(f, " (error %s times its)", interval(&ratio.error).text);
}

/* Cost of the cache at an opponent's error. */
static void say_against(FILE *f, const struct row *r, const struct lw_crossover_point *opponent,
                        enum lw_measure_coin coin) {
    const struct lw_crossover_point *cache =
        lw_crossover_analysis_cheapest(&r->a, coin, opponent->mean[coin].value);
    if (!cache) {
        say_not_reached(f, r, opponent, coin);
        return;
    }
    const struct lw_crossover_ratio ratio = compare(cache, opponent, coin);
    fprintf(f, "r(1) = %s, m = %s (%s, %s %.3g)", ratio_of(r, &ratio.r1).text, ratio_of(r, &ratio.m).text,
            cache->setting, coin_word(coin), cache->mean[coin].value);
}

static void print_first_lines(const struct row *r, FILE *f, const char *bullet) {
    static const char *const names[] = {"svgf", "svgf-quarter"};
    for (size_t n = 0; n < COUNT(names); n++) {
        const struct lw_crossover_point *opponent = filtered(r, names[n]);
        for (size_t c = 0; opponent && c < COUNT(own_coins); c++) {
            fprintf(f, "%sat the error of %s, %s %.3g: ", bullet, names[n], coin_word(own_coins[c]),
                    opponent->mean[own_coins[c]].value);
            say_against(f, r, opponent, own_coins[c]);
            fprintf(f, "%s\n",
                    tests_motion(r, opponent->mean[LW_MEASURE_COIN_RELMSE].value) ? "" : " **(void)**");
        }
    }
}

static void print_gate(struct lw_report *out, const struct row *r) {
    if (is_static(r)) lw_report_paragraph(out, "Nothing moves: this row does not test motion.");
    if (is_static(r) || isnan(r->a.late_error)) return;
    fprintf(out->f,
            "Light that is a second late has relMSE %.3g in these views (nothing that shines, nothing that "
            "has moved).",
            r->a.late_error);
    for (uint32_t i = 0; i < r->a.point_count; i++) {
        const struct lw_crossover_point *p = &r->a.point[i];
        if (p->is_cache || tests_motion(r, p->mean[LW_MEASURE_COIN_RELMSE].value)) continue;
        fprintf(out->f,
                " That is under %g times the error of %s (%s): **void** there, the row does not test motion.",
                LW_MEASURE_GATE_TIMES, p->renderer, p->setting);
    }
    fprintf(out->f, "\n\n");
}

/* ---- tables ---- */

/* Whether any renderer has a figure above 0 in this measure: gnuplot fails on a plot without points. */
static bool has_curve(const struct row *r, enum lw_measure_coin coin) {
    for (uint32_t i = 0; i < r->a.point_count; i++)
        if (r->a.point[i].mean[coin].value > 0 && r->a.point[i].cost_s.value > 0) return true;
    return false;
}

/* Begins a line of a table. */
static void print_name(struct lw_report *out, const struct lw_crossover_point *p) {
    lw_report_cell(out, "%s, %s", p->renderer, p->setting);
}

static void print_opponent(struct lw_report *out, const struct row *r, const struct lw_crossover_point *o,
                           enum lw_measure_coin coin) {
    const double error = o->mean[coin].value;
    const struct lw_crossover_point *cache = lw_crossover_analysis_cheapest(&r->a, coin, error),
                                    *best = cache ? cache : lw_crossover_analysis_best(&r->a, coin);
    const struct lw_crossover_ratio ratio = compare(cache, o, coin);
    lw_report_cell(out, "%s, %s | %s | %s | %s", o->renderer, o->setting, interval(&o->cost_s).text,
                   coin_word(coin), interval(&o->mean[coin]).text);
    lw_report_cell(out, cache ? "%s | %s" : "not reached: %s is best | %s", best ? best->setting : "none",
                   best ? interval(&best->mean[coin]).text : "");
    lw_report_cell(out, "%s | %s", ratio_of(r, &ratio.r1).text, ratio_of(r, &ratio.m).text);
    lw_report_cell(out,
                   !cache          ? "nowhere"
                   : has_ratios(r) ? "at %.3g of its cost"
                                   : "–",
                   lw_crossover_analysis_crossing(&r->a, coin, error) / o->cost_s.value);
    lw_report_end_row(out);
}

static void print_against(struct lw_report *out, const struct row *r) {
    lw_report_section(out, "At each opponent's own error", NULL);
    lw_report_head(
        out, "opponent | CPU s a frame | measure | its error | cache | its error | r(1) | m | curves cross");
    for (uint32_t i = 0; i < r->a.point_count; i++)
        for (size_t c = 0; !r->a.point[i].is_cache && c < COUNT(own_coins); c++)
            print_opponent(out, r, &r->a.point[i], own_coins[c]);
    fprintf(out->f, "\n");
    lw_report_paragraph(out, "Intervals are of 95 %%, by a paired bootstrap over views and repeats (%u).",
                        r->a.repeats);
}

static struct lw_report_words cost_of(const struct lw_crossover_point *p) {
    struct lw_report_words words = {"not reached"};
    if (p)
        snprintf(words.text, sizeof words.text, "%s%s%s: %.3g CPU s", p->is_cache ? "" : p->renderer,
                 p->is_cache ? "" : ", ", p->setting, p->cost_s.value);
    return words;
}

static void print_fixed(struct lw_report *out, const struct row *r) {
    const enum lw_measure_coin coin = LW_MEASURE_COIN_RELMSE;
    lw_report_section(out, "At fixed errors", NULL);
    lw_report_head(out, "relMSE | cheapest opponent | cheapest cache | r(1) | m");
    for (size_t i = 0; i < COUNT(fixed_errors); i++) {
        const struct lw_crossover_point *o = lw_crossover_analysis_opponent(&r->a, coin, fixed_errors[i]),
                                        *c = lw_crossover_analysis_cheapest(&r->a, coin, fixed_errors[i]);
        const struct lw_crossover_ratio ratio = compare(c, o, coin);
        lw_report_row(out, "%g%s | %s | %s | %s | %s", fixed_errors[i],
                      tests_motion(r, fixed_errors[i]) ? "" : " (void)", cost_of(o).text, cost_of(c).text,
                      ratio_of(r, &ratio.r1).text, ratio_of(r, &ratio.m).text);
    }
    fprintf(out->f, "\n");
}

static void print_errors(struct lw_report *out, const struct row *r) {
    lw_report_section(out, "Error", NULL);
    lw_report_cell(out, "renderer | CPU s a frame, one user");
    for (int c = 0; c < LW_MEASURE_COIN_COUNT; c++)
        lw_report_cell(out, "%s", lw_measure_coin_name((enum lw_measure_coin)c));
    lw_report_head(out, "lag, s");
    for (uint32_t i = 0; i < r->a.point_count; i++) {
        const struct lw_crossover_point *p = &r->a.point[i];
        print_name(out, p);
        lw_report_cell(out, "%s", interval(&p->cost_s).text);
        for (int c = 0; c < LW_MEASURE_COIN_COUNT; c++) lw_report_cell(out, "%s", interval(&p->mean[c]).text);
        lw_report_number(out, p->all.extra[LW_MEASURE_EXTRA_LAG]);
        lw_report_end_row(out);
    }
    fprintf(out->f, "\n");
    for (int c = 0; c < LW_MEASURE_COIN_COUNT; c++)
        fprintf(out->f, "* %s: %s\n", lw_measure_coin_name((enum lw_measure_coin)c),
                lw_measure_coin_about((enum lw_measure_coin)c));
    lw_report_paragraph(
        out, "* lag: the age of the light that fits the first judged frame best; – where none fits better");
    for (int c = 0; c < LW_MEASURE_COIN_COUNT; c++)
        if (has_curve(r, (enum lw_measure_coin)c))
            fprintf(out->f, "![%s over cost](%s.png)\n", plots[c].axis, plots[c].plot.name);
    fprintf(out->f, "\n");
}

/* A stage of both, or all: the cache's has two figures. */
static void print_stage(struct lw_report *out, bool is_cache, double one_s, double all_s) {
    if (one_s == 0 && all_s == 0)
        fprintf(out->f, " |"); /* no stage of this renderer */
    else
        lw_report_cell(out, is_cache ? "%.3g; %.3g" : "%.3g", 1e3 * one_s, 1e3 * all_s);
}

static void print_costs(struct lw_report *out, const struct row *r) {
    lw_report_section(out, "Cost",
                      "CPU ms a frame of 1/30 s, all threads and processes; with all twelve users "
                      "where two figures stand, the second.");
    lw_report_cell(out, "renderer");
    for (int s = 0; s < LW_STAGE_COUNT; s++) lw_report_cell(out, "%s", lw_stage_name((enum lw_stage)s));
    lw_report_head(out, "all | wall ms | Mrays | Mbit/s a user | server MB | client MB");
    for (uint32_t i = 0; i < r->a.point_count; i++) {
        const struct lw_crossover_point *p = &r->a.point[i];
        const double users = p->all.users ? p->all.users : 1;
        print_name(out, p);
        for (int s = 0; s < LW_STAGE_COUNT; s++)
            print_stage(out, p->is_cache, p->one.cpu_s[s], p->all.cpu_s[s]);
        print_stage(out, p->is_cache, lw_measure_store_total(&p->one), lw_measure_store_total(&p->all));
        lw_report_number(out, p->one.extra[LW_MEASURE_EXTRA_WALL] * 1e3);
        lw_report_number(out, p->one.extra[LW_MEASURE_EXTRA_RAYS] * 1e-6);
        lw_report_number(out, p->all.extra[LW_MEASURE_EXTRA_BYTES] * (8e-6 * LW_VIEWS_HZ / users));
        lw_report_number(out, p->all.extra[LW_MEASURE_EXTRA_SERVER_MEMORY] * 1e-6);
        lw_report_number(out, p->all.extra[LW_MEASURE_EXTRA_USER_MEMORY] * (1e-6 / users));
        lw_report_end_row(out);
    }
    fprintf(out->f, "\n");
    lw_report_paragraph(
        out, "Rays are the server's own; those of path renderers are not counted. A client's memory is the "
             "growth of this process over its users, who share one scene and one structure for rays. Cache, "
             "alone: after the other users have left.");
}

static void print_sessions(struct lw_report *out, const struct row *r) {
    lw_report_section(
        out, "With start-up",
        "CPU s a frame of a user, when start-up is spread over a session: package and import, the server's "
        "set-up, what its first frames cost beyond later ones, a client's rays. Opponents: their rays' "
        "structure.");
    lw_report_cell(out, "renderer | start, CPU s");
    for (size_t s = 0; s < COUNT(sessions_s); s++)
        lw_report_cell(out, "%g s, 1 user | 12 users", sessions_s[s]);
    lw_report_head(out, NULL);
    for (uint32_t i = 0; i < r->a.point_count; i++) {
        const struct lw_crossover_point *p = &r->a.point[i];
        const double start_s = (lw_crossover_analysis_session(p, 1, 1) - p->cost_s.value) *
                               LW_VIEWS_HZ; /* as if it lasted a second */
        print_name(out, p);
        lw_report_number(out, start_s);
        for (size_t s = 0; s < COUNT(sessions_s); s++) {
            lw_report_number(out, lw_crossover_analysis_session(p, sessions_s[s], 1));
            lw_report_number(out, lw_crossover_analysis_session(p, sessions_s[s], LW_MEASURE_VIEWS));
        }
        lw_report_end_row(out);
    }
    fprintf(out->f, "\n");
}

static void print_clock(struct lw_report *out, const struct row *r) {
    struct lw_crossover_clock c;
    bool headed = false;
    for (uint32_t i = 0; i < r->a.point_count; i++) {
        const struct lw_crossover_point *p = &r->a.point[i];
        if (!lw_crossover_clock_read(r->store, p->renderer, p->setting, &c)) continue;
        if (!headed) {
            lw_report_section(
                out, "By the wall clock",
                "Each side at the rate that it attained on all cores, one user, the server beside him; a "
                "picture is judged against light of the moment at which it was ready. Few pictures, and "
                "whatever else the machine did counts: this says who is late, not by how much anybody is "
                "better.");
            lw_report_head(out, "renderer | pictures a second | age of light, s | relMSE | pictures judged");
        }
        headed = true;
        lw_report_row(out, "%s, %s | %.3g | %.2g | %.3g | %u", p->renderer, p->setting, c.views_hz,
                      c.light_age_s, c.relmse, c.pictures);
    }
    if (headed) fprintf(out->f, "\n");
}

/* ---- by frame, by view, by age of light ---- */

static double mean_at(const struct row *r, const struct lw_crossover_point *p, uint32_t view,
                      uint32_t frame) {
    struct lw_measure_unit unit = unit_of(p);
    unit.repeat = LW_MEASURE_ALL;
    return lw_measure_store_mean(r->store, &unit, view, frame, LW_MEASURE_COIN_RELMSE);
}

static int by_number(const void *a, const void *b) {
    const uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;
    return (x > y) - (x < y);
}

/* The frames that are judged, growing. */
static uint32_t list_frames(const struct row *r, uint32_t out[LW_CROSSOVER_JUDGED_MAX]) {
    uint32_t count = 0;
    for (size_t i = 0; i < r->store->sample_count; i++) {
        uint32_t k = 0;
        while (k < count && out[k] != r->store->sample[i].frame) k++;
        if (k == count && count < LW_CROSSOVER_JUDGED_MAX) out[count++] = r->store->sample[i].frame;
    }
    qsort(out, count, sizeof *out, by_number);
    return count;
}

static void print_by_frame(struct lw_report *out, const struct row *r) {
    uint32_t frame[LW_CROSSOVER_JUDGED_MAX];
    const uint32_t count = list_frames(r, frame);
    if (count < 3) return;
    lw_report_section(out, "After the step",
                      "relMSE by frame, the first being the one in which the lamp is off.");
    lw_report_cell(out, "renderer");
    for (uint32_t k = 0; k < count; k++) lw_report_cell(out, "%u", frame[k] - frame[0] + 1);
    lw_report_head(out, NULL);
    for (uint32_t i = 0; i < r->a.point_count; i++) {
        print_name(out, &r->a.point[i]);
        for (uint32_t k = 0; k < count; k++)
            lw_report_number(out, mean_at(r, &r->a.point[i], LW_MEASURE_ALL, frame[k]));
        lw_report_end_row(out);
    }
    fprintf(out->f, "\n");
}

static void print_by_view(struct lw_report *out, const struct row *r) {
    lw_report_section(out, "By view",
                      "relMSE; views go from dark to bright. The last column: light that is a second late.");
    lw_report_cell(out, "view");
    for (uint32_t i = 0; i < r->a.point_count; i++) print_name(out, &r->a.point[i]);
    lw_report_head(out, "late");
    for (uint32_t v = 0; v < LW_MEASURE_VIEWS; v++) {
        double late = (double)NAN;
        for (size_t i = 0; i < r->store->late_count; i++)
            if (r->store->late[i].view == v && r->store->late[i].late == LW_CROSSOVER_GATE_LATE)
                late = r->store->late[i].relmse;
        lw_report_cell(out, "%u", v);
        for (uint32_t i = 0; i < r->a.point_count; i++)
            lw_report_number(out, mean_at(r, &r->a.point[i], v, LW_MEASURE_ALL));
        lw_report_number(out, late);
        lw_report_end_row(out);
    }
    fprintf(out->f, "\n");
}

static void print_failures(struct lw_report *out, const struct row *r) {
    lw_report_section(out, "What failed", NULL);
    lw_report_head(out, "renderer | repeat | why");
    for (size_t i = 0; i < r->store->failure_count; i++) {
        const struct lw_measure_failure *failure = &r->store->failure[i];
        lw_report_row(out, "%s, %s | %u | %s", failure->unit.renderer, failure->unit.setting,
                      failure->unit.repeat + 1, failure->text);
    }
    fprintf(out->f, "\n");
}

static void print_not_measured(struct lw_report *out, const struct row *r) {
    const char *left_out = get(r, "densities left out", ""), *dark = get(r, "dark views", ""),
               *samples = get(r, "samples left out", "");
    if (*left_out)
        lw_report_paragraph(out, "Densities that are not tried, for want of memory: %s.", left_out);
    if (*samples)
        lw_report_paragraph(
            out, "Settings that are not tried, since such samples gained under 10 %% at a lower density: %s.",
            samples);
    if (*dark) lw_report_paragraph(out, "Views that show next to nothing, and are not judged: %s.", dark);
    for (uint32_t i = 0; !is_static(r) && i < r->a.point_count; i++)
        if (r->a.point[i].is_cache && r->a.point[i].all.extra[LW_MEASURE_EXTRA_RAYS] == 0)
            lw_report_paragraph(
                out, "**The server traced no ray at %s while something moved:** its light stood still.",
                r->a.point[i].setting);
    if (r->store->failure_count) print_failures(out, r);
}

/* ---- pictures ---- */

/* The setting with the least error, among all that cost no more than an opponent; else the cheapest. */
static const struct lw_crossover_point *at_equal_cost(const struct row *r,
                                                      const struct lw_crossover_point *opponent) {
    const struct lw_crossover_point *best = NULL, *least = NULL;
    for (uint32_t i = 0; i < r->a.point_count; i++) {
        const struct lw_crossover_point *p = &r->a.point[i];
        if (!p->is_cache || isnan(p->cost_s.value)) continue;
        if (!least || p->cost_s.value < least->cost_s.value) least = p;
        if (p->cost_s.value > opponent->cost_s.value) continue;
        if (!best || p->mean[LW_MEASURE_COIN_RELMSE].value < best->mean[LW_MEASURE_COIN_RELMSE].value)
            best = p;
    }
    return best ? best : least;
}

static void add_strip(struct lw_crossover_strip *strip, uint32_t *count, const struct lw_crossover_point *p,
                      const char *title) {
    if (!p || *count == LW_CROSSOVER_STRIP_MAX) return;
    strip[(*count)++] = (struct lw_crossover_strip){unit_of(p), title};
}

static void print_clips(struct lw_report *out, const struct row *r) {
    for (uint32_t i = 0; i < r->a.point_count; i++) {
        char path[4096];
        const struct lw_measure_unit unit = unit_of(&r->a.point[i]);
        lw_measure_store_picture_path(r->store->folder, "clip", &unit, "png", path, sizeof path);
        if (access(path, R_OK) == 0)
            fprintf(out->f, "* [clip: %s, %s](%s)\n", unit.renderer, unit.setting,
                    path + strlen(r->store->folder) + 1);
    }
    fprintf(out->f, "\n");
}

static void print_pictures(struct lw_report *out, const struct row *r) {
    struct lw_crossover_strip strip[LW_CROSSOVER_STRIP_MAX];
    uint32_t count = 0;
    struct lw_error err = {0};
    const struct lw_crossover_point *svgf = filtered(r, "svgf"), *quarter = filtered(r, "svgf-quarter"),
                                    *opponent = svgf ? svgf : quarter;
    for (uint32_t i = 0; !opponent && i < r->a.point_count; i++)
        if (!r->a.point[i].is_cache) opponent = &r->a.point[i];
    if (!opponent) return;
    const enum lw_measure_coin coin = LW_MEASURE_COIN_RELMSE;
    const struct lw_crossover_point *equal = lw_crossover_analysis_cheapest(&r->a, coin,
                                                                            opponent->mean[coin].value),
                                    *best = equal ? equal : lw_crossover_analysis_best(&r->a, coin),
                                    *same = at_equal_cost(r, opponent);
    add_strip(strip, &count, opponent, opponent->renderer);
    if (opponent != quarter) add_strip(strip, &count, quarter, "svgf-quarter");
    add_strip(strip, &count, best, equal ? "cache, equal error" : "cache, best");
    add_strip(strip, &count, same, "cache, equal cost");
    if (lw_crossover_pictures_write(r->store, strip, count, &err) != LW_OK) {
        lw_log(LW_LOG_WARNING, "no strips of pictures: %s", err.text);
        return;
    }
    lw_report_section(out, "Pictures", NULL);
    fprintf(out->f, "Parts of the views at the first judged frame, at one exposure: the reference, %s, ",
            opponent->renderer);
    if (quarter && opponent != quarter) fprintf(out->f, "svgf-quarter, ");
    if (best) fprintf(out->f, "the cache at %s (%s), ", equal ? "equal error" : "its best", best->setting);
    if (same) fprintf(out->f, "the cache at equal cost (%s).", same->setting);
    fprintf(out->f, "\n\n![Strips](strips.png)\n\n");
    print_clips(out, r);
}

/* ---- files ---- */

static void print_curves(struct lw_report *out, const void *context) {
    const struct row *r = context;
    fprintf(out->f, "renderer,setting,cpu_s");
    for (int c = 0; c < LW_MEASURE_COIN_COUNT; c++) {
        const char *coin = lw_measure_coin_name((enum lw_measure_coin)c);
        fprintf(out->f, ",%s,%s_low,%s_high", coin, coin, coin);
    }
    fprintf(out->f, "\n");
    for (uint32_t i = 0; i < r->a.point_count; i++) {
        const struct lw_crossover_point *p = &r->a.point[i];
        fprintf(out->f, "%s,%s,%.6g", p->renderer, p->setting, p->cost_s.value);
        for (int c = 0; c < LW_MEASURE_COIN_COUNT; c++)
            fprintf(out->f, ",%.6g,%.6g,%.6g", p->mean[c].value, p->mean[c].low, p->mean[c].high);
        fprintf(out->f, "\n");
    }
}

static void print_plot(struct lw_report *out, const struct row *r, enum lw_measure_coin coin) {
    const int column = 4 + 3 * (int)coin;
    fprintf(out->f, "set ylabel '%s'\n", plots[coin].axis);
    lw_report_plot(out, &plots[coin].plot);
    for (uint32_t i = 0; i < r->a.point_count; i++) {
        const char *renderer = r->a.point[i].renderer;
        if (filtered(r, renderer) != &r->a.point[i]) continue; /* the series is there already */
        lw_report_series(
            out, renderer,
            "'curves.csv' skip 1 using (strcol(1) eq '%s' ? $3 : NaN):%d:%d:%d with yerrorbars pt 7",
            renderer, column, column + 1, column + 2);
    }
    lw_report_end_plot(out, &plots[coin].plot);
}

static void print_plots(struct lw_report *out, const void *context) {
    const struct row *r = context;
    lw_report_script(out, "top right");
    fprintf(out->f, "set xlabel 'CPU s per frame, one user'\n");
    for (int c = 0; c < LW_MEASURE_COIN_COUNT; c++)
        if (has_curve(r, (enum lw_measure_coin)c)) print_plot(out, r, (enum lw_measure_coin)c);
}

static void print_head(struct lw_report *out, const struct row *r) {
    fprintf(out->f, "# Crossover: %s, %s\n\n", get(r, "scene", "?"), get(r, "motion", "?"));
    print_first_lines(r, out->f, "* ");
    fprintf(out->f, "\n");
    if (!has_ratios(r))
        lw_report_paragraph(out, "No r(1) and no m: what a step costs belongs to all users together, and "
                                 "this row is about the errors after it.");
    print_gate(out, r);
    lw_report_origin(out, get(r, "command", "?"), get(r, "machine", "?"), get(r, "day", "?"));
    fprintf(out->f,
            " %s triangles, %s texels per metre at density ×1, %s bounces, %s pixels, references of %s paths "
            "a pixel, exposure 2^%s.",
            get(r, "triangles", "?"), get(r, "density", "?"), get(r, "bounces", "?"), get(r, "size", "?"),
            get(r, "reference samples", "?"), get(r, "stops", "?"));
    if (*get(r, "mover", "")) fprintf(out->f, " Moving: %s.", get(r, "mover", ""));
    lw_report_paragraph(
        out, " Twelve fixed views %s; both sides are judged at the same frames, under the manual clock.",
        get(r, "views", "?"));
    print_not_measured(out, r);
}

static void print_markdown(struct lw_report *out, const void *context) {
    const struct row *r = context;
    print_head(out, r);
    print_against(out, r);
    print_fixed(out, r);
    print_errors(out, r);
    print_pictures(out, r);
    print_costs(out, r);
    print_sessions(out, r);
    print_clock(out, r);
    print_by_frame(out, r);
    print_by_view(out, r);
}

static void print_refusal(struct lw_report *out, const void *context) {
    const struct row *r = context;
    fprintf(out->f, "# Crossover: %s, %s\n\n**Not measured:** %s\n", get(r, "scene", "?"),
            get(r, "motion", "?"), r->refusal);
}

enum lw_status lw_crossover_report_refuse(const struct lw_measure_store *store, const char *why,
                                          struct lw_error *err) {
    static const struct lw_report_file file = {"report.md", print_refusal};
    return lw_report_save(store->folder, &file, 1, &(struct row){.store = store, .refusal = why}, err);
}

enum lw_status lw_crossover_report_write(const struct lw_measure_store *store, struct lw_error *err) {
    static const struct lw_report_file files[] = {
        {"curves.csv", print_curves}, {"report.md", print_markdown}, {"crossover.gp", print_plots}};
    struct row r = {.store = store};
    enum lw_status status = lw_crossover_analysis_init(&r.a, store, err);
    if (status != LW_OK) return status;
    status = lw_report_save(store->folder, files, COUNT(files), &r, err);
    if (status == LW_OK) {
        lw_report_run_gnuplot(store->folder, "crossover.gp");
        printf("report: %s/report.md\n", store->folder);
        print_first_lines(&r, stdout, "");
    }
    lw_crossover_analysis_finish(&r.a);
    return status;
}
