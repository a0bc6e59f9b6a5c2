#include "client/measure/crossover_analysis.h"

#include "client/measure/sides/views.h"
#include "common/base/log.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define SEED 20u /* for the bootstrap's draws */

/* ---- gathering ---- */

static struct lw_crossover_point *point_of(struct lw_crossover_analysis *a,
                                           const struct lw_measure_unit *unit) {
    for (uint32_t i = 0; i < a->point_count; i++)
        if (strcmp(a->point[i].renderer, unit->renderer) == 0 &&
            strcmp(a->point[i].setting, unit->setting) == 0)
            return &a->point[i];
    if (a->point_count == LW_CROSSOVER_POINTS_MAX) return NULL;
    struct lw_crossover_point *p = &a->point[a->point_count++];
    memcpy(p->renderer, unit->renderer, sizeof p->renderer);
    memcpy(p->setting, unit->setting, sizeof p->setting);
    p->is_cache = strcmp(unit->renderer, LW_MEASURE_CACHE) == 0;
    p->repeats = a->repeats;
    p->all = lw_measure_store_expense(unit, 0, LW_MEASURE_ALL);
    p->one = lw_measure_store_expense(unit, 1, LW_MEASURE_ALL);
    for (uint32_t i = 0; i < LW_MEASURE_VIEWS * LW_MEASURE_REPEATS_MAX; i++) {
        p->alone_s[i] = (double)NAN;
        for (int c = 0; c < LW_MEASURE_COIN_COUNT; c++) p->error[c][i] = (double)NAN;
    }
    for (uint32_t r = 0; r < LW_MEASURE_REPEATS_MAX; r++) p->all_s[r] = (double)NAN;
    return p;
}

static uint32_t cell_of(const struct lw_crossover_analysis *a, uint32_t view, uint32_t repeat) {
    return view * a->repeats + repeat;
}

/* A mean that grows; counts hold how many values each has. */
static void add_to_mean(double *mean, uint32_t *count, double value) {
    if (isnan(value)) return;
    *mean = *count ? *mean + (value - *mean) / (*count + 1) : value;
    ++*count;
}

struct counts {
    uint32_t cpu, extra[LW_MEASURE_EXTRA_COUNT];
};

static void add_expense(struct lw_measure_expense *mean, struct counts *counts,
                        const struct lw_measure_expense *e) {
    mean->users = e->users;
    mean->frames += e->frames;
    for (int s = 0; s < LW_STAGE_COUNT; s++)
        mean->cpu_s[s] += (e->cpu_s[s] - mean->cpu_s[s]) / (counts->cpu + 1);
    counts->cpu++;
    for (int x = 0; x < LW_MEASURE_EXTRA_COUNT; x++)
        add_to_mean(&mean->extra[x], &counts->extra[x], e->extra[x]);
}

static enum lw_status gather(struct lw_crossover_analysis *a, const struct lw_measure_store *s,
                             struct lw_error *err) {
    uint32_t(*frames)[LW_MEASURE_COIN_COUNT][LW_MEASURE_VIEWS * LW_MEASURE_REPEATS_MAX] =
        calloc(LW_CROSSOVER_POINTS_MAX, sizeof *frames);
    struct counts(*counts)[2] = calloc(LW_CROSSOVER_POINTS_MAX, sizeof *counts);
    enum lw_status status =
        frames && counts ? LW_OK : lw_status_fail(err, LW_NO_MEMORY, "no memory for figures");
    bool beyond = false;
    for (size_t i = 0; status == LW_OK && i < s->expense_count; i++) {
        const struct lw_measure_expense *e = &s->expense[i];
        struct lw_crossover_point *p = point_of(a, &e->unit);
        if (!p) {
            beyond = true;
            continue;
        }
        struct counts *of = counts[p - a->point];
        if (e->view == LW_MEASURE_ALL) {
            add_expense(&p->all, &of[0], e);
            if (p->is_cache) p->all_s[e->unit.repeat] = lw_measure_store_total(e);
        } else if (e->view < LW_MEASURE_VIEWS) {
            add_expense(&p->one, &of[1], e);
            p->alone_s[cell_of(a, e->view, e->unit.repeat)] = lw_measure_store_total(e);
        }
    }
    for (size_t i = 0; status == LW_OK && i < s->sample_count; i++) {
        const struct lw_measure_sample *sample = &s->sample[i];
        struct lw_crossover_point *p = point_of(a, &sample->unit);
        if (!p) continue;
        const uint32_t cell = cell_of(a, sample->view, sample->unit.repeat);
        p->there[cell] = 1;
        for (int c = 0; c < LW_MEASURE_COIN_COUNT; c++)
            add_to_mean(&p->error[c][cell], &frames[p - a->point][c][cell], sample->coin[c]);
    }
    if (beyond)
        lw_log(LW_LOG_WARNING,
               "%s: over %u settings: those that were measured later are left out of the report", s->folder,
               LW_CROSSOVER_POINTS_MAX);
    free(frames);
    free(counts);
    return status;
}

/* ---- figures ---- */

/* The weighted mean of the known values; NAN: none is known. */
static double weighted(const double *value, const double *weight, uint32_t count) {
    double sum = 0, of = 0;
    for (uint32_t i = 0; i < count; i++)
        if (weight[i] > 0 && !isnan(value[i])) sum += weight[i] * value[i], of += weight[i];
    return of > 0 ? sum / of : (double)NAN;
}

struct mean_context {
    const double *value;
    uint32_t cells;
};

static double mean_of(const void *context, const double *weight) {
    const struct mean_context *c = context;
    return weighted(c->value, weight, c->cells);
}

static struct lw_bootstrap_interval interval_of(const struct lw_crossover_point *p, const double *value) {
    const struct lw_bootstrap_cells cells = {LW_MEASURE_VIEWS, p->repeats, p->there};
    const struct mean_context context = {value, LW_MEASURE_VIEWS * p->repeats};
    return lw_bootstrap(&cells, mean_of, &context, SEED);
}

static double find_late_error(const struct lw_measure_store *s) {
    const char *motion = lw_measure_store_get(s, "motion");
    double sum = 0;
    uint32_t count = 0;
    if (motion && strcmp(motion, "static") == 0) return (double)NAN;
    for (size_t i = 0; i < s->late_count; i++)
        if (s->late[i].late == LW_CROSSOVER_GATE_LATE && !isnan(s->late[i].relmse))
            sum += s->late[i].relmse, count++;
    return count ? sum / count : (double)NAN;
}

enum lw_status lw_crossover_analysis_init(struct lw_crossover_analysis *a, const struct lw_measure_store *s,
                                          struct lw_error *err) {
    *a = (struct lw_crossover_analysis){.repeats = 1};
    if (!s->expense_count) return lw_status_fail(err, LW_BAD_DATA, "%s: nothing is measured", s->folder);
    for (size_t i = 0; i < s->expense_count; i++)
        if (s->expense[i].unit.repeat >= a->repeats) a->repeats = s->expense[i].unit.repeat + 1;
    a->point = calloc(LW_CROSSOVER_POINTS_MAX, sizeof *a->point);
    if (!a->point) return lw_status_fail(err, LW_NO_MEMORY, "no memory for figures");
    enum lw_status status = gather(a, s, err);
    if (status != LW_OK) {
        lw_crossover_analysis_finish(a);
        return status;
    }
    a->late_error = find_late_error(s);
    for (uint32_t i = 0; i < a->point_count; i++) {
        struct lw_crossover_point *p = &a->point[i];
        for (int c = 0; c < LW_MEASURE_COIN_COUNT; c++) p->mean[c] = interval_of(p, p->error[c]);
        p->cost_s = interval_of(p, p->alone_s);
    }
    return LW_OK;
}

void lw_crossover_analysis_finish(struct lw_crossover_analysis *a) {
    free(a->point);
    *a = (struct lw_crossover_analysis){0};
}

const struct lw_crossover_point *lw_crossover_analysis_find(const struct lw_crossover_analysis *a,
                                                            const char *renderer, const char *setting) {
    for (uint32_t i = 0; i < a->point_count; i++)
        if (strcmp(a->point[i].renderer, renderer) == 0 &&
            (!setting || strcmp(a->point[i].setting, setting) == 0))
            return &a->point[i];
    return NULL;
}

static const struct lw_crossover_point *cheapest(const struct lw_crossover_analysis *a, bool cache,
                                                 enum lw_measure_coin coin, double error) {
    const struct lw_crossover_point *best = NULL;
    for (uint32_t i = 0; i < a->point_count; i++) {
        const struct lw_crossover_point *p = &a->point[i];
        if (p->is_cache != cache || isnan(p->cost_s.value) || !(p->mean[coin].value <= error)) continue;
        if (!best || p->cost_s.value < best->cost_s.value) best = p;
    }
    return best;
}

const struct lw_crossover_point *lw_crossover_analysis_cheapest(const struct lw_crossover_analysis *a,
                                                                enum lw_measure_coin coin, double error) {
    return cheapest(a, true, coin, error);
}

const struct lw_crossover_point *lw_crossover_analysis_opponent(const struct lw_crossover_analysis *a,
                                                                enum lw_measure_coin coin, double error) {
    return cheapest(a, false, coin, error);
}

const struct lw_crossover_point *lw_crossover_analysis_best(const struct lw_crossover_analysis *a,
                                                            enum lw_measure_coin coin) {
    const struct lw_crossover_point *best = NULL;
    for (uint32_t i = 0; i < a->point_count; i++) {
        const struct lw_crossover_point *p = &a->point[i];
        if (p->is_cache && !isnan(p->mean[coin].value) &&
            (!best || p->mean[coin].value < best->mean[coin].value))
            best = p;
    }
    return best;
}

/* ---- ratios ---- */

struct pair {
    const struct lw_crossover_point *cache, *opponent;
    enum lw_measure_coin coin;
};

static double r1_of(const void *context, const double *weight) {
    const struct pair *pair = context;
    double cache = 0, opponent = 0;
    for (uint32_t i = 0; i < LW_MEASURE_VIEWS * pair->cache->repeats; i++) {
        if (!(weight[i] > 0) || isnan(pair->cache->alone_s[i]) || isnan(pair->opponent->alone_s[i])) continue;
        cache += weight[i] * pair->cache->alone_s[i];
        opponent += weight[i] * pair->opponent->alone_s[i];
    }
    return opponent > 0 ? cache / opponent : (double)NAN;
}

/* C12 belongs to a repeat: it counts as often as that repeat's cells were drawn. C1 and A are of all cells
 * that have them: views differ less by the cache's cost of one more user than by anything of the opponent. */
static double m_of(const void *context, const double *weight) {
    const struct pair *pair = context;
    const uint32_t repeats = pair->cache->repeats, cells = LW_MEASURE_VIEWS * repeats;
    double all = 0, of = 0;
    for (uint32_t i = 0; i < cells; i++) {
        const double c12 = pair->cache->all_s[i % repeats];
        if (weight[i] > 0 && !isnan(c12)) all += weight[i] * c12, of += weight[i];
    }
    const double alone = weighted(pair->cache->alone_s, weight, cells),
                 opponent = weighted(pair->opponent->alone_s, weight, cells);
    return of > 0 && opponent > 0 ? (all / of - alone) / (LW_MEASURE_VIEWS - 1) / opponent : (double)NAN;
}

static double error_ratio_of(const void *context, const double *weight) {
    const struct pair *pair = context;
    double cache = 0, opponent = 0;
    for (uint32_t i = 0; i < LW_MEASURE_VIEWS * pair->cache->repeats; i++) {
        const double c = pair->cache->error[pair->coin][i], o = pair->opponent->error[pair->coin][i];
        if (weight[i] > 0 && !isnan(c) && !isnan(o)) cache += weight[i] * c, opponent += weight[i] * o;
    }
    return opponent > 0 ? cache / opponent : (double)NAN;
}

struct lw_crossover_ratio lw_crossover_analysis_compare(const struct lw_crossover_point *cache,
                                                        const struct lw_crossover_point *opponent,
                                                        enum lw_measure_coin coin) {
    const struct pair pair = {cache, opponent, coin};
    uint8_t both[LW_MEASURE_VIEWS * LW_MEASURE_REPEATS_MAX];
    for (uint32_t i = 0; i < sizeof both; i++) both[i] = cache->there[i] && opponent->there[i];
    const struct lw_bootstrap_cells cells = {LW_MEASURE_VIEWS, cache->repeats, both};
    return (struct lw_crossover_ratio){.r1 = lw_bootstrap(&cells, r1_of, &pair, SEED),
                                       .m = lw_bootstrap(&cells, m_of, &pair, SEED),
                                       .error = lw_bootstrap(&cells, error_ratio_of, &pair, SEED)};
}

/* ---- sessions and curves ---- */

static double known(double x) { return isnan(x) ? 0 : x; }

double lw_crossover_analysis_session(const struct lw_crossover_point *p, double session_s, uint32_t users) {
    const double *x = p->all.extra, frames = session_s * LW_VIEWS_HZ;
    double server_s = known(x[LW_MEASURE_EXTRA_BUILD_CPU]), own_s = known(x[LW_MEASURE_EXTRA_JOIN_CPU]),
           steady_s = 0;
    if (isnan(p->cost_s.value)) return (double)NAN;
    if (!p->is_cache) return p->cost_s.value + known(x[LW_MEASURE_EXTRA_START_CPU]) / frames;
    for (int s = 0; s < LW_STAGE_COUNT; s++) /* what the server spends on a frame for all of its users */
        if (s <= LW_STAGE_SEND) steady_s += p->all.cpu_s[s];
    server_s +=
        known(x[LW_MEASURE_EXTRA_START_CPU]) +
        fmax(0, known(x[LW_MEASURE_EXTRA_WARM_CPU]) - known(x[LW_MEASURE_EXTRA_WARM_FRAMES]) * steady_s);
    /* frames between one user and twelve cost what lies on the line between them */
    const double c1 = p->cost_s.value, c12 = lw_measure_store_total(&p->all),
                 of_all = c1 + (c12 - c1) * (users - 1) / (LW_MEASURE_VIEWS - 1);
    return of_all / users + (server_s / users + own_s) / frames;
}

static int by_cost(const void *a, const void *b) {
    const struct lw_crossover_point *const *x = a, *const *y = b;
    return ((*x)->cost_s.value > (*y)->cost_s.value) - ((*x)->cost_s.value < (*y)->cost_s.value);
}

double lw_crossover_analysis_crossing(const struct lw_crossover_analysis *a, enum lw_measure_coin coin,
                                      double error) {
    const struct lw_crossover_point *sorted[LW_CROSSOVER_POINTS_MAX], *before = NULL;
    uint32_t count = 0;
    for (uint32_t i = 0; i < a->point_count; i++)
        if (a->point[i].is_cache && a->point[i].cost_s.value > 0 && a->point[i].mean[coin].value > 0)
            sorted[count++] = &a->point[i];
    qsort(sorted, count, sizeof *sorted, by_cost);
    for (uint32_t i = 0; i < count; i++) {
        const double e = sorted[i]->mean[coin].value;
        if (e > error) {
            if (!before || e < before->mean[coin].value) before = sorted[i];
            continue;
        }
        if (!before) return sorted[i]->cost_s.value;
        const double high = before->mean[coin].value, share = log(high / error) / log(high / e);
        return before->cost_s.value * pow(sorted[i]->cost_s.value / before->cost_s.value, share);
    }
    return (double)NAN;
}
