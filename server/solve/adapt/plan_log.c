#include "server/solve/adapt/plan_log.h"

#include "common/base/invariant.h"
#include "common/base/log.h"

#include <errno.h>
#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

#define TILES_MAX (1u << 24)

static const char *const stages[] = {"verify", "light", "show"};

struct lw_plan_log {
    FILE *file;
    struct lw_plan_fact *last; /* as written, by slot */
    uint32_t tiles;
    char *path;
};

/* ---- write ---- */

enum lw_status lw_plan_log_create(const char *path, uint32_t tiles, uint32_t ids,
                                  struct lw_plan_log **out_log, struct lw_error *err) {
    struct lw_plan_log *log = calloc(1, sizeof *log);
    if (log) *log = (struct lw_plan_log){.tiles = tiles, .path = strdup(path)};
    if (log) log->last = calloc(tiles + 1ul, sizeof *log->last);
    if (!log || !log->path || !log->last) {
        lw_plan_log_destroy(log);
        return lw_status_fail(err, LW_NO_MEMORY, "%s", path);
    }
    log->file = fopen(path, "w");
    if (!log->file) {
        enum lw_status status = lw_status_fail(err, LW_CANNOT_CREATE, "%s: %s", path, strerror(errno));
        lw_plan_log_destroy(log);
        return status;
    }
    fprintf(log->file, "lightwell plan log 1 %" PRIu32 " %" PRIu32 "\n", tiles, ids);
    *out_log = log;
    return LW_OK;
}

void lw_plan_log_destroy(struct lw_plan_log *log) {
    if (!log) return;
    if (log->file) fclose(log->file);
    free(log->last);
    free(log->path);
    free(log);
}

/* Whether there is a file that can be written to. */
static bool writes(struct lw_plan_log *log) {
    if (!log || !log->file) return false;
    if (!ferror(log->file)) return true;
    lw_log(LW_LOG_WARNING, "%s: no more can be written: the plan log ends here", log->path);
    fclose(log->file);
    log->file = NULL;
    return false;
}

void lw_plan_log_frame(struct lw_plan_log *log, uint64_t number) {
    if (writes(log)) fprintf(log->file, "frame %" PRIu64 "\n", number);
}

void lw_plan_log_event(struct lw_plan_log *log, const char *name) {
    if (writes(log)) fprintf(log->file, "%s\n", name);
}

void lw_plan_log_found(struct lw_plan_log *log, const struct lw_plan_found *found) {
    if (!writes(log)) return;
    fprintf(log->file, "found %d %d %" PRIu32 "\n", found->direct, found->invalidated, found->verified);
    fflush(log->file);
}

/* A bit for each yes or no of a fact. */
#define FLAGS(X) X(hidden, 0) X(contributes, 1) X(invalidated, 2) X(begins, 3) X(corrected, 4) X(unseen, 5)

static unsigned flags_of(const struct lw_plan_fact *f) {
#define X(name, bit) (unsigned)f->name << bit |
    return FLAGS(X) 0u;
#undef X
}

static void write_fact(FILE *file, uint32_t slot, const struct lw_plan_fact *f) {
    fprintf(file,
            "fact %" PRIu32 " %" PRIu32 " %" PRIu32 " %" PRIu32 " %" PRIu32 " %" PRIu32 " %" PRIu32
            " %a %a %a %" PRIu64 " %" PRIu64 " %u %u %u\n",
            slot, f->id.v, f->owner, f->object, f->covered_count, f->sample_count, f->invalidated_count,
            (double)f->priority, (double)f->importance, (double)f->distance_m, f->verify_work,
            f->correct_work, f->level, f->state, flags_of(f));
}

static void write_list(FILE *file, const struct lw_plan_list *list) {
    for (uint32_t i = 0; i < list->count; i++) {
        const struct lw_plan_entry *e = &list->entry[i];
        if (i == 0 || e->reason != list->entry[i - 1].reason)
            fprintf(file, "%splan %u", i ? "\n" : "", e->reason);
        fprintf(file, " %" PRIu32 "%s", e->id.v, e->part ? "/" : "");
    }
    if (list->count) fputc('\n', file);
}

void lw_plan_log_stage(struct lw_plan_log *log, enum lw_plan_stage stage, const struct lw_plan_input *in,
                       const struct lw_plan *plan) {
    const struct lw_budget *b = &in->budget;
    if (!writes(log)) return;
    LW_INVARIANT(in->count <= log->tiles);
    for (uint32_t i = 0; i < in->count; i++) {
        if (memcmp(&log->last[i], &in->fact[i], sizeof *in->fact) == 0) continue;
        memcpy(&log->last[i], &in->fact[i], sizeof *in->fact);
        write_fact(log->file, i, &in->fact[i]);
    }
    fprintf(log->file, "%s %u %u %u %u %d %d %d %" PRIu64 " %" PRIu64 " %a %d %d %d %d %" PRIu32 "\n",
            stages[stage], in->moves.moves, in->moves.began, in->moves.light_moves, in->moves.shone,
            b->limited, b->onset, b->yields, b->solve, b->verify, in->spent, in->everything, in->looked_at,
            in->lights_all, in->awaited, in->bounces);
    if (stage == LW_PLAN_STAGE_VERIFY) {
        write_list(log->file, &plan->verify);
        write_list(log->file, &plan->correct);
    } else {
        write_list(log->file, stage == LW_PLAN_STAGE_LIGHT ? &plan->solve : &plan->show);
    }
}

/* ---- read ---- */

struct replay {
    const char *path;
    FILE *report;
    uint64_t only, line, frame, plans;
    uint32_t tiles, ids;
    struct lw_plan_fact *fact;
    struct lw_plan_memory memory;
    struct lw_plan plan;
    struct lw_plan_input in;                /* the last stage's; verify's, until found */
    const struct lw_plan_list *expected[2]; /* what the lines `plan` behind a stage are to say */
    uint32_t at;                            /* entries of these that were met */
};

static enum lw_status fail(const struct replay *r, struct lw_error *err, const char *what) {
    return lw_status_fail(err, LW_BAD_DATA, "%s:%" PRIu64 ": %s", r->path, r->line, what);
}

static bool read_fact(struct replay *r, const char *text) {
    struct lw_plan_fact f = {0};
    uint32_t slot, level, state, flags;
    double priority, importance, distance;
    if (sscanf(text,
               "fact %" SCNu32 " %" SCNu32 " %" SCNu32 " %" SCNu32 " %" SCNu32 " %" SCNu32 " %" SCNu32
               " %la %la %la %" SCNu64 " %" SCNu64 " %" SCNu32 " %" SCNu32 " %" SCNu32,
               &slot, &f.id.v, &f.owner, &f.object, &f.covered_count, &f.sample_count, &f.invalidated_count,
               &priority, &importance, &distance, &f.verify_work, &f.correct_work, &level, &state,
               &flags) != 15 ||
        slot >= r->tiles || f.id.v >= r->ids || level > UINT8_MAX || state > LW_BLOCK_CONVERGED)
        return false;
    f.priority = (float)priority;
    f.importance = (float)importance;
    f.distance_m = (float)distance;
    f.level = (uint8_t)level;
    f.state = (uint8_t)state;
#define X(name, bit) f.name = flags >> bit & 1;
    FLAGS(X)
#undef X
    r->fact[slot] = f;
    return true;
}

static bool read_input(struct replay *r, const char *text) {
    unsigned shone, limited, onset, yields, everything, looked_at, lights_all, awaited;
    struct lw_plan_input in = {.fact = r->fact, .count = r->tiles};
    if (sscanf(text, "%u %u %u %u %u %u %u %" SCNu64 " %" SCNu64 " %la %u %u %u %u %" SCNu32, &in.moves.moves,
               &in.moves.began, &in.moves.light_moves, &shone, &limited, &onset, &yields, &in.budget.solve,
               &in.budget.verify, &in.spent, &everything, &looked_at, &lights_all, &awaited,
               &in.bounces) != 15)
        return false;
    in.moves.shone = shone;
    in.budget.limited = limited;
    in.budget.onset = onset;
    in.budget.yields = yields;
    in.everything = everything;
    in.looked_at = looked_at;
    in.lights_all = lights_all;
    in.awaited = awaited;
    r->in = in;
    return true;
}

/* Prints how many entries of a list each reason has, and the entries for the frame that is asked for. */
static void tell(const struct replay *r, const char *name, const struct lw_plan_list *list) {
    uint32_t count[LW_PLAN_REASON_COUNT] = {0};
    if (!r->report || !list->count || (r->only && r->only != r->frame)) return;
    for (uint32_t i = 0; i < list->count; i++) count[list->entry[i].reason]++;
    fprintf(r->report, "frame %" PRIu64 ": %s", r->frame, name);
    for (int k = 0; k < LW_PLAN_REASON_COUNT; k++)
        if (count[k]) fprintf(r->report, ", %" PRIu32 " %s", count[k], lw_plan_reason_name(k));
    fputc('\n', r->report);
    for (uint32_t i = 0; r->only && i < list->count; i++) {
        const struct lw_plan_entry *e = &list->entry[i];
        fprintf(r->report, "    tile %" PRIu32 ": %s%s\n", e->id.v, lw_plan_reason_name(e->reason),
                e->part ? ", its invalidated blocks" : "");
    }
}

static void plan_stage(struct replay *r, enum lw_plan_stage stage) {
    r->plans++;
    r->at = 0;
    r->expected[0] = r->expected[1] = NULL;
    if (stage == LW_PLAN_STAGE_VERIFY) {
        lw_plan_verify(&r->memory, &r->in, &r->plan);
        r->expected[0] = &r->plan.verify;
        r->expected[1] = &r->plan.correct;
        tell(r, "verify", &r->plan.verify);
        tell(r, "correct", &r->plan.correct);
    } else if (stage == LW_PLAN_STAGE_LIGHT) {
        lw_plan_light(&r->memory, &r->in, &r->plan);
        r->expected[0] = &r->plan.solve;
        tell(r, "solve", &r->plan.solve);
    } else {
        lw_plan_show(&r->memory, &r->in, &r->plan);
        r->expected[0] = &r->plan.show;
        tell(r, "show", &r->plan.show);
    }
}

/* The entry of the stage's lists that comes next; NULL: there is none. */
static const struct lw_plan_entry *next_entry(struct replay *r) {
    uint32_t i = r->at++;
    for (int k = 0; k < 2 && r->expected[k]; k++) {
        if (i < r->expected[k]->count) return &r->expected[k]->entry[i];
        i -= r->expected[k]->count;
    }
    return NULL;
}

static enum lw_status compare_entries(struct replay *r, char *text, struct lw_error *err) {
    char *at = text;
    const unsigned long reason = strtoul(at, &at, 10);
    while (*at == ' ') {
        const unsigned long id = strtoul(at, &at, 10);
        const bool part = *at == '/';
        const struct lw_plan_entry *e = next_entry(r);
        if (part) at++;
        if (!e || e->id.v != id || e->reason != reason || e->part != part)
            return fail(r, err, "the plan that is made of this input is another");
    }
    return LW_OK;
}

/* Before another event: all entries of the last stage were met. */
static bool is_complete(struct replay *r) {
    uint32_t count = 0;
    for (int k = 0; k < 2 && r->expected[k]; k++) count += r->expected[k]->count;
    return r->at == count;
}

static enum lw_status take_line(struct replay *r, char *text, struct lw_error *err) {
    if (!strncmp(text, "plan ", 5)) return compare_entries(r, text + 5, err);
    if (!is_complete(r))
        return fail(r, err, "the plan before this line has fewer entries than its input gives");
    if (!strncmp(text, "fact ", 5)) return read_fact(r, text) ? LW_OK : fail(r, err, "no fact of a tile");
    for (int k = 0; k < 3; k++) {
        const size_t n = strlen(stages[k]);
        if (strncmp(text, stages[k], n) != 0 || text[n] != ' ') continue;
        if (!read_input(r, text + n)) return fail(r, err, "no input of a plan");
        plan_stage(r, k);
        return LW_OK;
    }
    struct lw_plan_found found;
    unsigned direct, invalidated;
    if (sscanf(text, "found %u %u %" SCNu32, &direct, &invalidated, &found.verified) == 3 &&
        found.verified <= r->plan.verify.count) {
        found.direct = direct;
        found.invalidated = invalidated;
        lw_plan_note_verified(&r->memory, &r->in, &r->plan, &found);
        return LW_OK;
    }
    if (sscanf(text, "frame %" SCNu64, &r->frame) == 1) return LW_OK;
    if (!strcmp(text, "move")) return lw_plan_note_move(&r->memory), LW_OK;
    if (!strcmp(text, "resume")) return lw_plan_resume(&r->memory), LW_OK;
    if (!strcmp(text, "review")) return lw_plan_review(&r->memory), LW_OK;
    return fail(r, err, "no event of a plan log");
}

static enum lw_status begin(struct replay *r, const char *text, struct lw_error *err) {
    if (sscanf(text, "lightwell plan log 1 %" SCNu32 " %" SCNu32, &r->tiles, &r->ids) != 2 ||
        r->tiles > TILES_MAX || r->ids > TILES_MAX)
        return fail(r, err, "no plan log of this version");
    r->fact = calloc(r->tiles + 1ul, sizeof *r->fact);
    if (!r->fact || lw_plan_init(&r->plan, r->tiles) != LW_OK ||
        lw_plan_memory_init(&r->memory, r->ids) != LW_OK)
        return lw_status_fail(err, LW_NO_MEMORY, "%s", r->path);
    return LW_OK;
}

enum lw_status lw_plan_log_replay(const char *path, FILE *report, uint64_t only, uint64_t *out_plans,
                                  struct lw_error *err) {
    struct replay r = {.path = path, .report = report, .only = only};
    FILE *file = fopen(path, "r");
    if (!file) return lw_status_fail(err, LW_NO_INPUT, "%s: %s", path, strerror(errno));
    char *text = NULL;
    size_t capacity = 0;
    ssize_t size;
    enum lw_status status = LW_OK;
    while (status == LW_OK && (size = getline(&text, &capacity, file)) > 0) {
        if (text[size - 1] != '\n') break; /* the writer was stopped within it */
        text[size - 1] = '\0';
        status = ++r.line == 1 ? begin(&r, text, err) : take_line(&r, text, err);
    }
    if (status == LW_OK && !r.line) status = fail(&r, err, "no plan log of this version");
    free(text);
    fclose(file);
    free(r.fact);
    lw_plan_finish(&r.plan);
    lw_plan_memory_finish(&r.memory);
    if (status == LW_OK) *out_plans = r.plans;
    return status;
}
