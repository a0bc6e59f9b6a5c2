#include "client/measure/crossover_report.h"

#include "client/measure/crossover_analysis.h"
#include "client/measure/crossover_clock.h"
#include "client/measure/crossover_pictures.h"
#include "client/measure/crossover_references.h"
#include "client/measure/gnuplot.h"
#include "client/measure/report_text.h"
#include "client/measure/sides/views.h"
#include "common/base/log.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static const double fixed_errors[] = {0.1, 0.02};
static const double sessions_s[] = {10, 60, 600};
#define COUNT(array) (sizeof(array) / sizeof *(array))

/* A picture of error over cost in each measure. */
static const struct {
    const char *file, *axis;
} plot[LW_MEASURE_COIN_COUNT] = {
    [LW_MEASURE_COIN_RELMSE] = {"relmse", "relMSE"},
    [LW_MEASURE_COIN_RELMSE_SMALL] = {"relmse_1e-4", "relMSE, small epsilon"},
    [LW_MEASURE_COIN_RELMSE_TRIMMED] = {"relmse_999", "relMSE, 99.9 % of pixels"},
    [LW_MEASURE_COIN_FLIP] = {"flip", "FLIP"},
    [LW_MEASURE_COIN_FLICKER] = {"flicker", "flicker"}};

struct report {
    const struct lw_measure_store *store;
    struct lw_crossover_analysis a;
    FILE *f;
};

/* ---- words ---- */

static const char *get(const struct report *r, const char *key, const char *otherwise) {
    const char *value = lw_measure_store_get(r->store, key);
    return value && *value ? value : otherwise;
}

static void print_interval(FILE *f, const struct lw_bootstrap_interval *i) {
    if (isnan(i->value))
        fprintf(f, "–");
    else if (isnan(i->low) || i->low == i->high)
        fprintf(f, "%.3g", i->value);
    else
        fprintf(f, "%.3g (%.3g to %.3g)", i->value, i->low, i->high);
}

static const char *coin_word(enum lw_measure_coin coin) {
    return coin == LW_MEASURE_COIN_FLIP ? "FLIP" : "relMSE";
}

/* Whether light that is a second late has so much more error that the row tests moving light. */
static bool tests_motion(const struct report *r, double error) {
    return isnan(r->a.late_error) || r->a.late_error >= LW_CROSSOVER_GATE_TIMES * error;
}

static bool is_static(const struct report *r) { return strcmp(get(r, "motion", ""), "static") == 0; }

/* The cost of all users is measured over the frames after a step, and the cost of one user after the step. So
 * the report has no ratio of the two. */
static bool has_ratios(const struct report *r) { return strcmp(get(r, "motion", ""), "lamp-switch") != 0; }

static void print_ratio(const struct report *r, FILE *f, const struct lw_bootstrap_interval *ratio) {
    if (has_ratios(r))
        print_interval(f, ratio);
    else
        fprintf(f, "–");
}

/* ---- at the opponents' own error ---- */

static const struct lw_crossover_point *filtered(const struct report *r, const char *name) {
    return lw_crossover_analysis_find(&r->a, name, NULL);
}

static void say_not_reached(FILE *f, const struct report *r, const struct lw_crossover_point *opponent,
                            enum lw_measure_coin coin) {
    const struct lw_crossover_point *best = lw_crossover_analysis_best(&r->a, coin);
    if (!best) {
        fprintf(f, "no setting of the cache is measured");
        return;
    }
    const struct lw_crossover_ratio ratio = lw_crossover_analysis_compare(best, opponent, coin);
    fprintf(f, "**not reached**: the best is %s %.3g at %s", coin_word(coin), best->mean[coin].value,
            best->setting);
    if (has_ratios(r)) {
        fprintf(f, ", for ");
        print_interval(f, &ratio.r1);
        fprintf(f, " of its cost");
    }
    fprintf(f, " (error ");
    print_interval(f, &ratio.error);
    fprintf(f, " times its)");
}

/* Cost of the cache at an opponent's error. */
static void say_against(FILE *f, const struct report *r, const struct lw_crossover_point *opponent,
                        enum lw_measure_coin coin) {
    const struct lw_crossover_point *cache =
        lw_crossover_analysis_cheapest(&r->a, coin, opponent->mean[coin].value);
    if (!cache) {
        say_not_reached(f, r, opponent, coin);
        return;
    }
    const struct lw_crossover_ratio ratio = lw_crossover_analysis_compare(cache, opponent, coin);
    fprintf(f, "r(1) = ");
    print_ratio(r, f, &ratio.r1);
    fprintf(f, ", m = ");
    print_ratio(r, f, &ratio.m);
    fprintf(f, " (%s, %s %.3g)", cache->setting, coin_word(coin), cache->mean[coin].value);
}

static void print_first_lines(const struct report *r, FILE *f, const char *bullet) {
    static const char *const names[] = {"svgf", "svgf-quarter"};
    static const enum lw_measure_coin coins[] = {LW_MEASURE_COIN_RELMSE, LW_MEASURE_COIN_FLIP};
    for (size_t n = 0; n < COUNT(names); n++) {
        const struct lw_crossover_point *opponent = filtered(r, names[n]);
        for (size_t c = 0; opponent && c < COUNT(coins); c++) {
            fprintf(f, "%sat the error of %s, %s %.3g: ", bullet, names[n], coin_word(coins[c]),
                    opponent->mean[coins[c]].value);
            say_against(f, r, opponent, coins[c]);
            fprintf(f, "%s\n",
                    tests_motion(r, opponent->mean[LW_MEASURE_COIN_RELMSE].value) ? "" : " **(void)**");
        }
    }
}

static void print_gate(const struct report *r) {
    if (is_static(r)) {
        fprintf(r->f, "Nothing moves: this row does not test motion.\n\n");
        return;
    }
    if (isnan(r->a.late_error)) return;
    fprintf(
        r->f,
        "Light that is a second late has relMSE %.3g in these views (nothing that shines, nothing that has "
        "moved).",
        r->a.late_error);
    for (uint32_t i = 0; i < r->a.point_count; i++) {
        const struct lw_crossover_point *p = &r->a.point[i];
        if (p->is_cache || tests_motion(r, p->mean[LW_MEASURE_COIN_RELMSE].value)) continue;
        fprintf(r->f,
                " That is under %g times the error of %s (%s): **void** there, the row does not test motion.",
                LW_CROSSOVER_GATE_TIMES, p->renderer, p->setting);
    }
    fprintf(r->f, "\n\n");
}

/* ---- tables ---- */

/* Whether any renderer has a figure above 0 in this measure: gnuplot fails on a plot without points. */
static bool has_curve(const struct report *r, enum lw_measure_coin coin) {
    for (uint32_t i = 0; i < r->a.point_count; i++)
        if (r->a.point[i].mean[coin].value > 0 && r->a.point[i].cost_s.value > 0) return true;
    return false;
}

static void print_against(const struct report *r) {
    static const enum lw_measure_coin coins[] = {LW_MEASURE_COIN_RELMSE, LW_MEASURE_COIN_FLIP};
    fprintf(
        r->f,
        "## At each opponent's own error\n\n"
        "| opponent | CPU s a frame | measure | its error | cache | its error | r(1) | m | curves cross |\n"
        "|---|---|---|---|---|---|---|---|---|\n");
    for (uint32_t i = 0; i < r->a.point_count; i++) {
        const struct lw_crossover_point *o = &r->a.point[i];
        for (size_t c = 0; !o->is_cache && c < COUNT(coins); c++) {
            const double error = o->mean[coins[c]].value;
            const struct lw_crossover_point *cache = lw_crossover_analysis_cheapest(&r->a, coins[c], error);
            fprintf(r->f, "| %s, %s | ", o->renderer, o->setting);
            print_interval(r->f, &o->cost_s);
            fprintf(r->f, " | %s | ", coin_word(coins[c]));
            print_interval(r->f, &o->mean[coins[c]]);
            if (cache) {
                const struct lw_crossover_ratio ratio = lw_crossover_analysis_compare(cache, o, coins[c]);
                fprintf(r->f, " | %s | ", cache->setting);
                print_interval(r->f, &cache->mean[coins[c]]);
                fprintf(r->f, " | ");
                print_ratio(r, r->f, &ratio.r1);
                fprintf(r->f, " | ");
                print_ratio(r, r->f, &ratio.m);
                if (has_ratios(r))
                    fprintf(r->f, " | at %.3g of its cost |\n",
                            lw_crossover_analysis_crossing(&r->a, coins[c], error) / o->cost_s.value);
                else
                    fprintf(r->f, " | – |\n");
            } else {
                const struct lw_crossover_point *best = lw_crossover_analysis_best(&r->a, coins[c]);
                fprintf(r->f, " | not reached: %s is best | ", best ? best->setting : "none");
                if (best) print_interval(r->f, &best->mean[coins[c]]);
                fprintf(r->f, " | – | – | nowhere |\n");
            }
        }
    }
    fprintf(r->f, "\nIntervals are of 95 %%, by a paired bootstrap over views and repeats (%u).\n\n",
            r->a.repeats);
}

static void print_fixed(const struct report *r) {
    const enum lw_measure_coin coin = LW_MEASURE_COIN_RELMSE;
    fprintf(r->f, "## At fixed errors\n\n| relMSE | cheapest opponent | cheapest cache | r(1) | m |\n"
                  "|---|---|---|---|---|\n");
    for (size_t i = 0; i < COUNT(fixed_errors); i++) {
        const struct lw_crossover_point *o = lw_crossover_analysis_opponent(&r->a, coin, fixed_errors[i]),
                                        *c = lw_crossover_analysis_cheapest(&r->a, coin, fixed_errors[i]);
        fprintf(r->f, "| %g%s | ", fixed_errors[i], tests_motion(r, fixed_errors[i]) ? "" : " (void)");
        if (o)
            fprintf(r->f, "%s, %s: %.3g CPU s | ", o->renderer, o->setting, o->cost_s.value);
        else
            fprintf(r->f, "not reached | ");
        if (c)
            fprintf(r->f, "%s: %.3g CPU s | ", c->setting, c->cost_s.value);
        else
            fprintf(r->f, "not reached | ");
        if (o && c) {
            const struct lw_crossover_ratio ratio = lw_crossover_analysis_compare(c, o, coin);
            print_ratio(r, r->f, &ratio.r1);
            fprintf(r->f, " | ");
            print_ratio(r, r->f, &ratio.m);
            fprintf(r->f, " |\n");
        } else {
            fprintf(r->f, "– | – |\n");
        }
    }
    fprintf(r->f, "\n");
}

static void print_errors(const struct report *r) {
    fprintf(r->f, "## Error\n\n| renderer | CPU s a frame, one user |");
    for (int c = 0; c < LW_MEASURE_COIN_COUNT; c++)
        fprintf(r->f, " %s |", lw_measure_coin_name((enum lw_measure_coin)c));
    fprintf(r->f, " lag, s |");
    lw_report_text_rule(r->f, LW_MEASURE_COIN_COUNT + 3);
    for (uint32_t i = 0; i < r->a.point_count; i++) {
        const struct lw_crossover_point *p = &r->a.point[i];
        fprintf(r->f, "| %s, %s | ", p->renderer, p->setting);
        print_interval(r->f, &p->cost_s);
        for (int c = 0; c < LW_MEASURE_COIN_COUNT; c++) {
            fprintf(r->f, " | ");
            print_interval(r->f, &p->mean[c]);
        }
        fprintf(r->f, " |");
        lw_report_text_number(r->f, p->all.extra[LW_MEASURE_EXTRA_LAG]);
        fprintf(r->f, "\n");
    }
    fprintf(r->f, "\n");
    for (int c = 0; c < LW_MEASURE_COIN_COUNT; c++)
        fprintf(r->f, "* %s: %s\n", lw_measure_coin_name((enum lw_measure_coin)c),
                lw_measure_coin_about((enum lw_measure_coin)c));
    fprintf(
        r->f,
        "* lag: the age of the light that fits the first judged frame best; – where none fits better\n\n");
    for (int c = 0; c < LW_MEASURE_COIN_COUNT; c++)
        if (has_curve(r, (enum lw_measure_coin)c))
            fprintf(r->f, "![%s over cost](%s.png)\n", plot[c].axis, plot[c].file);
    fprintf(r->f, "\n");
}

static void print_costs(const struct report *r) {
    fprintf(r->f,
            "## Cost\n\nCPU ms a frame of 1/30 s, all threads and processes; with all twelve users where two "
            "figures stand, the second.\n\n| renderer |");
    for (int s = 0; s < LW_STAGE_COUNT; s++) fprintf(r->f, " %s |", lw_stage_name((enum lw_stage)s));
    fprintf(r->f, " all | wall ms | Mrays | Mbit/s a user | server MB | client MB |");
    lw_report_text_rule(r->f, LW_STAGE_COUNT + 7);
    for (uint32_t i = 0; i < r->a.point_count; i++) {
        const struct lw_crossover_point *p = &r->a.point[i];
        const double users = p->all.users ? p->all.users : 1;
        fprintf(r->f, "| %s, %s |", p->renderer, p->setting);
        for (int s = 0; s <= LW_STAGE_COUNT; s++) {
            const double one = s < LW_STAGE_COUNT ? p->one.cpu_s[s] : lw_measure_store_total(&p->one),
                         all = s < LW_STAGE_COUNT ? p->all.cpu_s[s] : lw_measure_store_total(&p->all);
            if (one == 0 && all == 0)
                fprintf(r->f, " |");
            else if (p->is_cache)
                fprintf(r->f, " %.3g; %.3g |", 1e3 * one, 1e3 * all);
            else
                fprintf(r->f, " %.3g |", 1e3 * one);
        }
        lw_report_text_number(r->f, p->one.extra[LW_MEASURE_EXTRA_WALL] * 1e3);
        lw_report_text_number(r->f, p->one.extra[LW_MEASURE_EXTRA_RAYS] * 1e-6);
        lw_report_text_number(r->f, p->all.extra[LW_MEASURE_EXTRA_BYTES] * (8e-6 * LW_VIEWS_HZ / users));
        lw_report_text_number(r->f, p->all.extra[LW_MEASURE_EXTRA_SERVER_MEMORY] * 1e-6);
        lw_report_text_number(r->f, p->all.extra[LW_MEASURE_EXTRA_USER_MEMORY] * (1e-6 / users));
        fprintf(r->f, "\n");
    }
    fprintf(r->f,
            "\nRays are the server's own; those of path renderers are not counted. A client's memory is the "
            "growth of this process over its users, who share one scene and one structure for rays. Cache, "
            "alone: after the other users have left.\n\n");
}

static void print_sessions(const struct report *r) {
    fprintf(r->f,
            "## With start-up\n\nCPU s a frame of a user, when start-up is spread over a session: package "
            "and import, the server's set-up, what its first frames cost beyond later ones, a client's rays. "
            "Opponents: their rays' structure.\n\n| renderer | start, CPU s |");
    for (size_t s = 0; s < COUNT(sessions_s); s++) fprintf(r->f, " %g s, 1 user | 12 users |", sessions_s[s]);
    lw_report_text_rule(r->f, 2 + 2 * COUNT(sessions_s));
    for (uint32_t i = 0; i < r->a.point_count; i++) {
        const struct lw_crossover_point *p = &r->a.point[i];
        const double start_s = (lw_crossover_analysis_session(p, 1, 1) - p->cost_s.value) *
                               LW_VIEWS_HZ; /* as if it lasted a second */
        fprintf(r->f, "| %s, %s |", p->renderer, p->setting);
        lw_report_text_number(r->f, start_s);
        for (size_t s = 0; s < COUNT(sessions_s); s++) {
            lw_report_text_number(r->f, lw_crossover_analysis_session(p, sessions_s[s], 1));
            lw_report_text_number(r->f, lw_crossover_analysis_session(p, sessions_s[s], LW_MEASURE_VIEWS));
        }
        fprintf(r->f, "\n");
    }
    fprintf(r->f, "\n");
}

static void print_clock(const struct report *r) {
    struct lw_crossover_clock c;
    bool headed = false;
    for (uint32_t i = 0; i < r->a.point_count; i++) {
        const struct lw_crossover_point *p = &r->a.point[i];
        if (!lw_crossover_clock_read(r->store, p->renderer, p->setting, &c)) continue;
        if (!headed)
            fprintf(r->f,
                    "## By the wall clock\n\nEach side at the rate that it attained on all cores, one user, "
                    "the server beside him; a picture is judged against light of the moment at which it was "
                    "ready. Few pictures, and whatever else the machine did counts: this says who is late, "
                    "not by how much anybody is better.\n\n| renderer | pictures a second | age of light, s "
                    "| relMSE | pictures judged |\n|---|---|---|---|---|\n");
        headed = true;
        fprintf(r->f, "| %s, %s | %.3g | %.2g | %.3g | %u |\n", p->renderer, p->setting, c.views_hz,
                c.light_age_s, c.relmse, c.pictures);
    }
    if (headed) fprintf(r->f, "\n");
}

/* ---- by frame, by view, by age of light ---- */

static double mean_at(const struct report *r, const struct lw_crossover_point *p, uint32_t frame,
                      uint32_t view) {
    double sum = 0;
    uint32_t count = 0;
    for (size_t i = 0; i < r->store->sample_count; i++) {
        const struct lw_measure_sample *s = &r->store->sample[i];
        if (strcmp(s->unit.renderer, p->renderer) != 0 || strcmp(s->unit.setting, p->setting) != 0) continue;
        if ((frame != UINT32_MAX && s->frame != frame) || (view != UINT32_MAX && s->view != view)) continue;
        if (isnan(s->coin[LW_MEASURE_COIN_RELMSE])) continue;
        sum += s->coin[LW_MEASURE_COIN_RELMSE];
        count++;
    }
    return count ? sum / count : (double)NAN;
}

static int compare(const void *a, const void *b) {
    const uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;
    return (x > y) - (x < y);
}

/* The frames that are judged, growing. */
static uint32_t list_frames(const struct report *r, uint32_t out[LW_CROSSOVER_JUDGED_MAX]) {
    uint32_t count = 0;
    for (size_t i = 0; i < r->store->sample_count; i++) {
        uint32_t k = 0;
        while (k < count && out[k] != r->store->sample[i].frame) k++;
        if (k == count && count < LW_CROSSOVER_JUDGED_MAX) out[count++] = r->store->sample[i].frame;
    }
    qsort(out, count, sizeof *out, compare);
    return count;
}

static void print_by_frame(const struct report *r) {
    uint32_t frame[LW_CROSSOVER_JUDGED_MAX];
    const uint32_t count = list_frames(r, frame);
    if (count < 3) return;
    fprintf(r->f, "## After the step\n\nrelMSE by frame, the first being the one in which the lamp is "
                  "off.\n\n| renderer |");
    for (uint32_t k = 0; k < count; k++) fprintf(r->f, " %u |", frame[k] - frame[0] + 1);
    lw_report_text_rule(r->f, 1 + count);
    for (uint32_t i = 0; i < r->a.point_count; i++) {
        const struct lw_crossover_point *p = &r->a.point[i];
        fprintf(r->f, "| %s, %s |", p->renderer, p->setting);
        for (uint32_t k = 0; k < count; k++) lw_report_text_number(r->f, mean_at(r, p, frame[k], UINT32_MAX));
        fprintf(r->f, "\n");
    }
    fprintf(r->f, "\n");
}

static void print_by_view(const struct report *r) {
    fprintf(r->f,
            "## By view\n\nrelMSE; views go from dark to bright. The last column: light that is a second "
            "late.\n\n| view |");
    for (uint32_t i = 0; i < r->a.point_count; i++)
        fprintf(r->f, " %s, %s |", r->a.point[i].renderer, r->a.point[i].setting);
    fprintf(r->f, " late |");
    lw_report_text_rule(r->f, 2 + r->a.point_count);
    for (uint32_t v = 0; v < LW_MEASURE_VIEWS; v++) {
        double late = (double)NAN;
        for (size_t i = 0; i < r->store->late_count; i++)
            if (r->store->late[i].view == v && r->store->late[i].late == LW_CROSSOVER_GATE_LATE)
                late = r->store->late[i].relmse;
        fprintf(r->f, "| %u |", v);
        for (uint32_t i = 0; i < r->a.point_count; i++)
            lw_report_text_number(r->f, mean_at(r, &r->a.point[i], UINT32_MAX, v));
        lw_report_text_number(r->f, late);
        fprintf(r->f, "\n");
    }
    fprintf(r->f, "\n");
}

static void print_not_measured(const struct report *r) {
    const char *left_out = get(r, "densities left out", ""), *dark = get(r, "dark views", ""),
               *samples = get(r, "samples left out", "");
    if (*left_out) fprintf(r->f, "Densities that are not tried, for want of memory: %s.\n\n", left_out);
    if (*samples)
        fprintf(
            r->f,
            "Settings that are not tried, since such samples gained under 10 %% at a lower density: %s.\n\n",
            samples);
    if (*dark) fprintf(r->f, "Views that show next to nothing, and are not judged: %s.\n\n", dark);
    for (uint32_t i = 0; !is_static(r) && i < r->a.point_count; i++)
        if (r->a.point[i].is_cache && r->a.point[i].all.extra[LW_MEASURE_EXTRA_RAYS] == 0)
            fprintf(r->f,
                    "**The server traced no ray at %s while something moved:** its light stood still.\n\n",
                    r->a.point[i].setting);
    if (!r->store->failure_count) return;
    fprintf(r->f, "## What failed\n\n| renderer | repeat | why |\n|---|---|---|\n");
    for (size_t i = 0; i < r->store->failure_count; i++) {
        const struct lw_measure_failure *failure = &r->store->failure[i];
        fprintf(r->f, "| %s, %s | %u | %s |\n", failure->unit.renderer, failure->unit.setting,
                failure->unit.repeat + 1, failure->text);
    }
    fprintf(r->f, "\n");
}

/* ---- pictures ---- */

/* The setting with the least error, among all that cost no more than an opponent; else the cheapest. */
static const struct lw_crossover_point *at_equal_cost(const struct report *r,
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
    struct lw_crossover_strip *s = &strip[(*count)++];
    *s = (struct lw_crossover_strip){.title = title};
    snprintf(s->unit.renderer, sizeof s->unit.renderer, "%s", p->renderer);
    snprintf(s->unit.setting, sizeof s->unit.setting, "%s", p->setting);
}

static void print_pictures(const struct report *r) {
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
    fprintf(
        r->f,
        "## Pictures\n\nParts of the views at the first judged frame, at one exposure: the reference, %s, ",
        opponent->renderer);
    if (quarter && opponent != quarter) fprintf(r->f, "svgf-quarter, ");
    if (best) fprintf(r->f, "the cache at %s (%s), ", equal ? "equal error" : "its best", best->setting);
    if (same) fprintf(r->f, "the cache at equal cost (%s).", same->setting);
    fprintf(r->f, "\n\n![Strips](strips.png)\n\n");
    for (uint32_t i = 0; i < r->a.point_count; i++) {
        char path[4096];
        struct lw_measure_unit unit = {.repeat = 0};
        snprintf(unit.renderer, sizeof unit.renderer, "%s", r->a.point[i].renderer);
        snprintf(unit.setting, sizeof unit.setting, "%s", r->a.point[i].setting);
        lw_measure_store_picture_path(r->store->folder, "clip", &unit, "png", path, sizeof path);
        if (access(path, R_OK) == 0)
            fprintf(r->f, "* [clip: %s, %s](%s)\n", unit.renderer, unit.setting,
                    path + strlen(r->store->folder) + 1);
    }
    fprintf(r->f, "\n");
}

/* ---- files ---- */

static enum lw_status write_curves(struct report *r, struct lw_error *err) {
    struct lw_report_text text;
    enum lw_status status = lw_report_text_begin(&text, "curves.csv", err);
    if (status != LW_OK) return status;
    FILE *f = text.stream;
    fprintf(f, "renderer,setting,cpu_s");
    for (int c = 0; c < LW_MEASURE_COIN_COUNT; c++) {
        const char *coin = lw_measure_coin_name((enum lw_measure_coin)c);
        fprintf(f, ",%s,%s_low,%s_high", coin, coin, coin);
    }
    fprintf(f, "\n");
    for (uint32_t i = 0; i < r->a.point_count; i++) {
        const struct lw_crossover_point *p = &r->a.point[i];
        fprintf(f, "%s,%s,%.6g", p->renderer, p->setting, p->cost_s.value);
        for (int c = 0; c < LW_MEASURE_COIN_COUNT; c++)
            fprintf(f, ",%.6g,%.6g,%.6g", p->mean[c].value, p->mean[c].low, p->mean[c].high);
        fprintf(f, "\n");
    }
    return lw_report_text_save(&text, r->store->folder, err);
}

static void print_plot(FILE *f, const struct report *r, enum lw_measure_coin coin) {
    const char *seen[LW_CROSSOVER_POINTS_MAX];
    const int column = 4 + 3 * (int)coin;
    uint32_t count = 0;
    for (uint32_t i = 0; i < r->a.point_count; i++) {
        uint32_t k = 0;
        while (k < count && strcmp(seen[k], r->a.point[i].renderer) != 0) k++;
        if (k == count) seen[count++] = r->a.point[i].renderer;
    }
    fprintf(f, "set ylabel '%s'\n", plot[coin].axis);
    lw_gnuplot_begin(f, plot[coin].file, 640, 480);
    fprintf(f, "plot ");
    for (uint32_t k = 0; k < count; k++)
        fprintf(f,
                "%s'curves.csv' skip 1 using (strcol(1) eq '%s' ? $3 : NaN):%d:%d:%d with yerrorbars pt 7 "
                "title '%s'",
                k ? ", " : "", seen[k], column, column + 1, column + 2, seen[k]);
    fprintf(f, "\n");
    lw_gnuplot_end(f, plot[coin].file, 640, 480);
}

static enum lw_status write_plots(struct report *r, struct lw_error *err) {
    struct lw_report_text text;
    enum lw_status status = lw_report_text_begin(&text, "crossover.gp", err);
    if (status != LW_OK) return status;
    FILE *f = text.stream;
    fprintf(f, "set datafile separator ','\nset logscale xy\nset grid\nset key top right\n"
               "set xlabel 'CPU s per frame, one user'\n");
    for (int c = 0; c < LW_MEASURE_COIN_COUNT; c++)
        if (has_curve(r, (enum lw_measure_coin)c)) print_plot(f, r, (enum lw_measure_coin)c);
    status = lw_report_text_save(&text, r->store->folder, err);
    if (status == LW_OK) lw_gnuplot_run(r->store->folder, "crossover.gp");
    return status;
}

static void print_head(const struct report *r) {
    fprintf(r->f, "# Crossover: %s, %s\n\n", get(r, "scene", "?"), get(r, "motion", "?"));
    print_first_lines(r, r->f, "* ");
    fprintf(r->f, "\n");
    if (!has_ratios(r))
        fprintf(r->f,
                "No r(1) and no m: what a step costs belongs to all users together, and this row is about "
                "the errors after it.\n\n");
    print_gate(r);
    fprintf(r->f, "    %s\n\n%s, %s. ", get(r, "command", "?"), get(r, "machine", "?"), get(r, "day", "?"));
    fprintf(
        r->f,
        "%s triangles, %s texels per metre at density ×1, %s bounces, %s pixels, references of %s paths a "
        "pixel, exposure 2^%s.",
        get(r, "triangles", "?"), get(r, "density", "?"), get(r, "bounces", "?"), get(r, "size", "?"),
        get(r, "reference samples", "?"), get(r, "stops", "?"));
    if (*get(r, "mover", "")) fprintf(r->f, " Moving: %s.", get(r, "mover", ""));
    fprintf(r->f,
            " Twelve fixed views %s; both sides are judged at the same frames, under the manual clock.\n\n",
            get(r, "views", "?"));
    print_not_measured(r);
}

enum lw_status lw_crossover_report_refuse(const struct lw_measure_store *store, const char *why,
                                          struct lw_error *err) {
    const struct report r = {.store = store};
    struct lw_report_text text;
    enum lw_status status = lw_report_text_begin(&text, "report.md", err);
    if (status != LW_OK) return status;
    fprintf(text.stream, "# Crossover: %s, %s\n\n**Not measured:** %s\n", get(&r, "scene", "?"),
            get(&r, "motion", "?"), why);
    return lw_report_text_save(&text, store->folder, err);
}

enum lw_status lw_crossover_report_write(const struct lw_measure_store *store, struct lw_error *err) {
    struct report r = {.store = store};
    struct lw_report_text text;
    enum lw_status status = lw_crossover_analysis_init(&r.a, store, err);
    if (status != LW_OK) return status;
    status = write_curves(&r, err);
    if (status == LW_OK) status = lw_report_text_begin(&text, "report.md", err);
    if (status == LW_OK) {
        r.f = text.stream;
        print_head(&r);
        print_against(&r);
        print_fixed(&r);
        print_errors(&r);
        print_pictures(&r);
        print_costs(&r);
        print_sessions(&r);
        print_clock(&r);
        print_by_frame(&r);
        print_by_view(&r);
        status = lw_report_text_save(&text, store->folder, err);
    }
    if (status == LW_OK) status = write_plots(&r, err);
    if (status == LW_OK) {
        printf("report: %s/report.md\n", store->folder);
        print_first_lines(&r, stdout, "");
    }
    lw_crossover_analysis_finish(&r.a);
    return status;
}
