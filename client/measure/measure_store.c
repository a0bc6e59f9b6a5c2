#include "client/measure/measure_store.h"

#include "client/measure/report.h"
#include "common/base/folders.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define PATH_SIZE 4096u

static const struct {
    const char *name, *about;
} coins[] = {
#define X(tag, name, about) {name, about},
    LW_MEASURE_COIN_MAP(X)
#undef X
};

const char *lw_measure_coin_name(enum lw_measure_coin coin) { return coins[coin].name; }
const char *lw_measure_coin_about(enum lw_measure_coin coin) { return coins[coin].about; }

struct lw_measure_expense lw_measure_store_expense(const struct lw_measure_unit *unit, uint32_t users,
                                                   uint32_t view) {
    struct lw_measure_expense e = {.unit = *unit, .users = users, .view = view};
    for (int i = 0; i < LW_MEASURE_EXTRA_COUNT; i++) e.extra[i] = (double)NAN;
    return e;
}

struct lw_cost lw_measure_store_cost(const struct lw_measure_expense *e) {
    const double rays = e->extra[LW_MEASURE_EXTRA_RAYS], bytes = e->extra[LW_MEASURE_EXTRA_BYTES];
    struct lw_cost cost = {.rays = isnan(rays) ? 0 : rays, .bytes = isnan(bytes) ? 0 : bytes};
    memcpy(cost.cpu_s, e->cpu_s, sizeof cost.cpu_s);
    return cost;
}

double lw_measure_store_total(const struct lw_measure_expense *e) {
    const struct lw_cost cost = lw_measure_store_cost(e);
    return lw_cost_total(&cost);
}

void lw_measure_store_setting(const struct lw_setting *s, bool is_cache, char out[LW_MEASURE_NAME_SIZE]) {
    if (is_cache)
        snprintf(out, LW_MEASURE_NAME_SIZE, "x%g %u+%u rest %g%s%s%s", s->density, s->direct_samples,
                 s->indirect_samples, s->target_error, s->draws ? "" : " tiles", s->by_gl ? " gl" : "",
                 s->whole ? " whole" : "");
    else
        snprintf(out, LW_MEASURE_NAME_SIZE, "%u path%s", s->samples, s->samples > 1 ? "s" : "");
}

bool lw_measure_store_same(const struct lw_measure_unit *a, const struct lw_measure_unit *b) {
    return a->repeat == b->repeat && strcmp(a->renderer, b->renderer) == 0 &&
           strcmp(a->setting, b->setting) == 0;
}

/* ---- tables by their columns ---- */

/* REST: the last text of a line. It may hold commas and is cut to its size. KNOWN: a number, never empty. */
enum cell { TEXT, REST, COUNT, VIEW, NUMBER, KNOWN };

struct column {
    const char *name; /* its blanks become "_" */
    enum cell cell;
    size_t offset;  /* in the struct of a line */
    uint32_t limit; /* bytes of a text, or the first count that is too large */
};

#define COLUMN(line, name, field, cell, limit)                                                               \
    { name, cell, offsetof(struct line, field), limit }
#define UNIT(line)                                                                                           \
    COLUMN(line, "renderer", unit.renderer, TEXT, LW_MEASURE_NAME_SIZE),                                     \
        COLUMN(line, "setting", unit.setting, TEXT, LW_MEASURE_NAME_SIZE),                                   \
        COLUMN(line, "repeat", unit.repeat, COUNT, LW_MEASURE_REPEATS_MAX)

static const struct column sample_columns[] = {
    UNIT(lw_measure_sample), COLUMN(lw_measure_sample, "view", view, COUNT, LW_MEASURE_VIEWS),
    COLUMN(lw_measure_sample, "frame", frame, COUNT, UINT32_MAX),
#define X(tag, name, about) COLUMN(lw_measure_sample, name, coin[LW_MEASURE_COIN_##tag], NUMBER, 0),
    LW_MEASURE_COIN_MAP(X)
#undef X
};
static const struct column cost_columns[] = {
    UNIT(lw_measure_expense),
    COLUMN(lw_measure_expense, "users", users, COUNT, UINT32_MAX),
    COLUMN(lw_measure_expense, "view", view, VIEW, LW_MEASURE_VIEWS),
    COLUMN(lw_measure_expense, "frames", frames, COUNT, UINT32_MAX),
    COLUMN(lw_measure_expense, "samples", samples, COUNT, UINT32_MAX),
#define X(tag, name, per_user) COLUMN(lw_measure_expense, name " cpu_s", cpu_s[LW_STAGE_##tag], KNOWN, 0),
    LW_STAGE_MAP(X)
#undef X
#define X(tag, name, about) COLUMN(lw_measure_expense, name, extra[LW_MEASURE_EXTRA_##tag], NUMBER, 0),
        LW_MEASURE_EXTRA_MAP(X)
#undef X
};
static const struct column late_columns[] = {COLUMN(lw_measure_late, "view", view, COUNT, LW_MEASURE_VIEWS),
                                             COLUMN(lw_measure_late, "frame", frame, COUNT, UINT32_MAX),
                                             COLUMN(lw_measure_late, "late", late, COUNT, UINT32_MAX),
                                             COLUMN(lw_measure_late, "relmse", relmse, NUMBER, 0)};
static const struct column note_columns[] = {
    COLUMN(lw_measure_note, NULL, key, TEXT, LW_MEASURE_NAME_SIZE),
    COLUMN(lw_measure_note, NULL, value, REST, LW_MEASURE_NOTE_SIZE)};
static const struct column failure_columns[] = {
    UNIT(lw_measure_failure), COLUMN(lw_measure_failure, NULL, text, REST, LW_ERROR_TEXT_SIZE)};

enum kind { SAMPLES, COSTS, LATE, ROW, FAILURES, KINDS };

static const struct table {
    const char *name, *fault; /* file name; text for a bad line */
    bool has_head;
    const struct column *column;
    uint32_t column_count;
    size_t lines, line_count, line_size; /* offsets in the store; bytes */
} tables[KINDS] = {
#define TABLE(name, fault, has_head, field, columns)                                                         \
    {                                                                                                        \
        name, fault, has_head, columns, sizeof columns / sizeof *columns,                                    \
            offsetof(struct lw_measure_store, field), offsetof(struct lw_measure_store, field##_count),      \
            sizeof *((struct lw_measure_store *)NULL)->field                                                 \
    }
    TABLE("samples.csv", "not a sample", true, sample, sample_columns),
    TABLE("costs.csv", "not a cost", true, expense, cost_columns),
    TABLE("late.csv", "not an error of late light", true, late, late_columns),
    TABLE("row.csv", "not KEY,VALUE", false, note, note_columns),
    TABLE("failures.csv", "not a failure", false, failure, failure_columns)};

static void path_of(const struct lw_measure_store *s, enum kind kind, char out[PATH_SIZE]) {
    snprintf(out, PATH_SIZE, "%s/%s", s->folder, tables[kind].name);
}

/* Room for one more line; NULL: there is none. */
static void *make_room(struct lw_measure_store *s, enum kind kind) {
    void **lines = (void **)((char *)s + tables[kind].lines);
    const size_t count = *(size_t *)((char *)s + tables[kind].line_count), size = tables[kind].line_size;
    if (!(count & (count - 1))) { /* doubled at powers of two */
        void *grown = realloc(*lines, (count ? 2 * count : 1) * size);
        if (!grown) return NULL;
        *lines = grown;
    }
    return memset((char *)*lines + count * size, 0, size);
}

static void keep_line(struct lw_measure_store *s, enum kind kind) {
    ++*(size_t *)((char *)s + tables[kind].line_count);
}

static enum lw_status add_line(struct lw_measure_store *s, enum kind kind, const void *line,
                               struct lw_error *err) {
    void *room = make_room(s, kind);
    if (!room) return lw_status_fail(err, LW_NO_MEMORY, "no memory for %s", tables[kind].name);
    memcpy(room, line, tables[kind].line_size);
    keep_line(s, kind);
    return LW_OK;
}

/* ---- writing ---- */

static void print_cell(FILE *f, const struct column *c, const void *line) {
    const void *at = (const char *)line + c->offset;
    const double *number = at;
    const uint32_t *count = at;
    if (c->cell <= REST)
        fprintf(f, "%s", (const char *)at);
    else if (c->cell >= NUMBER && !isnan(*number))
        fprintf(f, "%.9g", *number);
    else if (c->cell == VIEW && *count >= LW_MEASURE_SOME)
        fprintf(f, *count == LW_MEASURE_ALL ? "all" : "some");
    else if (c->cell < NUMBER)
        fprintf(f, "%u", *count);
}

struct source {
    const struct lw_measure_store *store;
    enum kind kind;
};

static void print_table(struct lw_report *out, const void *context) {
    const struct source *source = context;
    const struct table *t = &tables[source->kind];
    const char *line = *(char *const *)((const char *)source->store + t->lines);
    const size_t count = *(const size_t *)((const char *)source->store + t->line_count);
    for (uint32_t c = 0; t->has_head && c < t->column_count; c++) {
        for (const char *n = t->column[c].name; *n; n++) fputc(*n == ' ' ? '_' : *n, out->f);
        fputc(c + 1 < t->column_count ? ',' : '\n', out->f);
    }
    for (size_t i = 0; i < count; i++, line += t->line_size)
        for (uint32_t c = 0; c < t->column_count; c++) {
            print_cell(out->f, &t->column[c], line);
            fputc(c + 1 < t->column_count ? ',' : '\n', out->f);
        }
}

static enum lw_status print(const struct lw_measure_store *s, enum kind kind, char **out_text,
                            struct lw_error *err) {
    const struct lw_report_file file = {tables[kind].name, print_table};
    size_t size;
    return lw_report_print(&file, &(struct source){s, kind}, out_text, &size, err);
}

static enum lw_status save_table(const struct lw_measure_store *s, enum kind kind, struct lw_error *err) {
    const struct lw_report_file file = {tables[kind].name, print_table};
    return lw_report_save(s->folder, &file, 1, &(struct source){s, kind}, err);
}

/* ---- reading ---- */

/* A table while it is read. */
struct reader {
    struct lw_measure_store *store;
    enum kind kind;
    char *bytes, *at; /* NULL: there is none */
    uint32_t line;
    bool torn; /* its last line had no end */
};

static enum lw_status load(struct reader *r, struct lw_error *err) {
    char path[PATH_SIZE];
    struct stat about;
    path_of(r->store, r->kind, path);
    FILE *f = fopen(path, "re");
    if (!f && errno == ENOENT) return LW_OK;
    if (!f) return lw_status_fail(err, LW_NO_INPUT, "%s: %s", path, strerror(errno));
    const size_t size = fstat(fileno(f), &about) == 0 ? (size_t)about.st_size : 0;
    r->at = r->bytes = calloc(size + 1, 1);
    const bool good = r->bytes && fread(r->bytes, 1, size, f) <= size && !ferror(f);
    fclose(f);
    if (!r->bytes) return lw_status_fail(err, LW_NO_MEMORY, "no memory for %s", path);
    return good ? LW_OK : lw_status_fail(err, LW_IO, "%s: cannot read", path);
}

/* The next line, without its end; false: there is none. A line without an end was torn off. */
static bool next_line(struct reader *r, char **out_line) {
    if (!r->at || !*r->at) return false;
    char *stop = strchr(r->at, '\n');
    r->torn = !stop;
    if (!stop) return false;
    *stop = 0;
    *out_line = r->at;
    r->at = stop + 1;
    r->line++;
    return true;
}

static enum lw_status bad_line(const struct reader *r, const char *why, struct lw_error *err) {
    return lw_status_fail(err, LW_BAD_DATA, "%s/%s, line %u: %s", r->store->folder, tables[r->kind].name,
                          r->line, why);
}

static enum lw_status skip_head(struct reader *r, struct lw_error *err) {
    static const struct lw_measure_store empty;
    char *head, *line;
    if (!tables[r->kind].has_head || !next_line(r, &line)) return LW_OK;
    enum lw_status status = print(&empty, r->kind, &head, err);
    if (status != LW_OK) return status;
    head[strlen(head) - 1] = 0; /* the line's end */
    if (strcmp(head, line) != 0) status = bad_line(r, "other columns than this version writes", err);
    free(head);
    return status;
}

static bool read_count(const char *text, uint32_t limit, uint32_t *out) {
    char *stop;
    if (*text < '0' || *text > '9') return false;
    errno = 0;
    const unsigned long value = strtoul(text, &stop, 10);
    *out = (uint32_t)value;
    return !errno && !*stop && value < limit;
}

static bool read_cell(const struct column *c, const char *text, void *at) {
    double *number = at;
    char *stop = NULL;
    if (c->cell <= REST) {
        snprintf(at, c->limit, "%s", text);
        return c->cell == REST || strlen(text) < c->limit;
    }
    if (c->cell < NUMBER) {
        const bool all = strcmp(text, "all") == 0, some = strcmp(text, "some") == 0;
        if (c->cell != VIEW || (!all && !some)) return read_count(text, c->limit, at);
        *(uint32_t *)at = all ? LW_MEASURE_ALL : LW_MEASURE_SOME;
        return true;
    }
    *number = *text ? strtod(text, &stop) : (double)NAN;
    return *text ? !*stop && isfinite(*number) : c->cell != KNOWN;
}

/* Reads all cells; false: the line is none of the table. */
static bool read_line(const struct table *t, char *text, char *line) {
    for (uint32_t c = 0; c < t->column_count; c++) {
        char *comma = t->column[c].cell == REST ? NULL : strchr(text, ',');
        if (!comma != (c + 1 == t->column_count)) return false;
        if (comma) *comma++ = 0;
        if (!read_cell(&t->column[c], text, line + t->column[c].offset)) return false;
        text = comma;
    }
    return true;
}

static enum lw_status read_table(struct lw_measure_store *s, enum kind kind, bool *out_torn,
                                 struct lw_error *err) {
    struct reader r = {.store = s, .kind = kind};
    char *text;
    enum lw_status status = load(&r, err);
    if (status == LW_OK) status = skip_head(&r, err);
    while (status == LW_OK && next_line(&r, &text)) {
        void *line = make_room(s, kind);
        if (!line)
            status = lw_status_fail(err, LW_NO_MEMORY, "no memory for %s", tables[kind].name);
        else if (!read_line(&tables[kind], text, line))
            status = bad_line(&r, tables[kind].fault, err);
        else
            keep_line(s, kind);
    }
    *out_torn |= r.torn;
    free(r.bytes);
    return status;
}

/* ---- units ---- */

bool lw_measure_store_has(const struct lw_measure_store *s, const struct lw_measure_unit *unit) {
    for (size_t i = 0; i < s->expense_count; i++) {
        const struct lw_measure_expense *e = &s->expense[i];
        if (e->view != LW_MEASURE_ALL || !lw_measure_store_same(&e->unit, unit)) continue;
        uint32_t samples = 0;
        for (size_t k = 0; k < s->sample_count; k++)
            samples += lw_measure_store_same(&s->sample[k].unit, unit);
        return samples == e->samples;
    }
    return false;
}

double lw_measure_store_mean(const struct lw_measure_store *s, const struct lw_measure_unit *unit,
                             uint32_t view, uint32_t frame, enum lw_measure_coin coin) {
    double sum = 0;
    uint32_t count = 0;
    for (const struct lw_measure_sample *x = s->sample; x < s->sample + s->sample_count; x++) {
        struct lw_measure_unit same = *unit;
        if (same.repeat == LW_MEASURE_ALL) same.repeat = x->unit.repeat;
        if (!lw_measure_store_same(&x->unit, &same) || isnan(x->coin[coin])) continue;
        if ((view != LW_MEASURE_ALL && x->view != view) || (frame != LW_MEASURE_ALL && x->frame != frame))
            continue;
        sum += x->coin[coin];
        count++;
    }
    return count ? sum / count : (double)NAN;
}

/* Takes out what no whole unit holds. Returns whether there was any. */
static bool drop_incomplete(struct lw_measure_store *s) {
    size_t samples = 0, expenses = 0;
    uint8_t *whole = malloc(s->sample_count + s->expense_count + 1);
    if (!whole) return false; /* they stay, and readers do not ask for them */
    for (size_t i = 0; i < s->sample_count; i++) whole[i] = lw_measure_store_has(s, &s->sample[i].unit);
    for (size_t i = 0; i < s->expense_count; i++)
        whole[s->sample_count + i] = lw_measure_store_has(s, &s->expense[i].unit);
    for (size_t i = 0; i < s->expense_count; i++)
        if (whole[s->sample_count + i]) s->expense[expenses++] = s->expense[i];
    for (size_t i = 0; i < s->sample_count; i++)
        if (whole[i]) s->sample[samples++] = s->sample[i];
    const bool dropped = samples < s->sample_count || expenses < s->expense_count;
    s->sample_count = samples;
    s->expense_count = expenses;
    free(whole);
    return dropped;
}

static enum lw_status open_to_append(const struct lw_measure_store *s, enum kind kind, int *out_file,
                                     struct lw_error *err) {
    char path[PATH_SIZE];
    path_of(s, kind, path);
    *out_file = open(path, O_WRONLY | O_APPEND | O_CLOEXEC);
    if (*out_file < 0) return lw_status_fail(err, LW_CANNOT_CREATE, "%s: %s", path, strerror(errno));
    return LW_OK;
}

/* A table without lines has a head. */
static bool has_table(const struct lw_measure_store *s, enum kind kind) {
    char path[PATH_SIZE];
    struct stat about;
    path_of(s, kind, path);
    return stat(path, &about) == 0 && about.st_size > 0;
}

enum lw_status lw_measure_store_open(struct lw_measure_store *s, const char *folder, bool read_only,
                                     struct lw_error *err) {
    struct stat about;
    bool torn = false;
    *s = (struct lw_measure_store){.samples_file = -1, .costs_file = -1};
    if ((size_t)snprintf(s->folder, sizeof s->folder, "%s", folder) >= sizeof s->folder)
        return lw_status_fail(err, LW_CANNOT_CREATE, "%.100s...: the name is too long", folder);
    if (read_only && stat(folder, &about) < 0)
        return lw_status_fail(err, LW_NO_INPUT, "%s: %s", folder, strerror(errno));
    enum lw_status status = read_only ? LW_OK : lw_folders_make(folder, err);
    for (enum kind k = 0; status == LW_OK && k < KINDS; k++) status = read_table(s, k, &torn, err);
    if (status != LW_OK) return status;
    const bool dropped = drop_incomplete(s);
    if (read_only) return LW_OK;
    const bool whole = !dropped && !torn && has_table(s, SAMPLES) && has_table(s, COSTS);
    if (!whole) status = save_table(s, SAMPLES, err);
    if (!whole && status == LW_OK) status = save_table(s, COSTS, err);
    if (status == LW_OK) status = open_to_append(s, SAMPLES, &s->samples_file, err);
    if (status == LW_OK) status = open_to_append(s, COSTS, &s->costs_file, err);
    return status;
}

void lw_measure_store_finish(struct lw_measure_store *s) {
    if (s->samples_file >= 0) close(s->samples_file);
    if (s->costs_file >= 0) close(s->costs_file);
    free(s->sample);
    free(s->expense);
    free(s->late);
    free(s->failure);
    free(s->note);
    *s = (struct lw_measure_store){.samples_file = -1, .costs_file = -1};
}

/* ---- appending ---- */

static bool write_text(int file, const char *text) {
    while (*text) {
        const ssize_t wrote = write(file, text, strlen(text));
        if (wrote < 0 && errno == EINTR) continue;
        if (wrote <= 0) return false;
        text += wrote;
    }
    return fsync(file) == 0 || errno == EINVAL; /* a device or a pipe has nothing to flush */
}

/* The lines of `more`, without the head. */
static enum lw_status append_table(const struct lw_measure_store *more, int file, enum kind kind,
                                   struct lw_error *err) {
    char *text;
    enum lw_status status = print(more, kind, &text, err);
    if (status != LW_OK) return status;
    if (!write_text(file, strchr(text, '\n') + 1))
        status = lw_status_fail(err, LW_IO, "%s/%s: cannot write: %s", more->folder, tables[kind].name,
                                strerror(errno));
    free(text);
    return status;
}

static enum lw_status append(const struct lw_measure_store *more, struct lw_error *err) {
    struct stat samples, costs;
    if (fstat(more->samples_file, &samples) < 0 || fstat(more->costs_file, &costs) < 0)
        return lw_status_fail(err, LW_IO, "%s: %s", more->folder, strerror(errno));
    enum lw_status status = append_table(more, more->samples_file, SAMPLES, err);
    if (status == LW_OK) status = append_table(more, more->costs_file, COSTS, err);
    if (status == LW_OK) return LW_OK;
    /* what remains all the same is found when the row is opened again */
    if (ftruncate(more->samples_file, samples.st_size) < 0) return status;
    if (ftruncate(more->costs_file, costs.st_size) < 0) return status;
    return status;
}

enum lw_status lw_measure_store_append(struct lw_measure_store *s, const struct lw_measure_sample *sample,
                                       size_t sample_count, const struct lw_measure_expense *expense,
                                       size_t expense_count, struct lw_error *err) {
    const size_t samples = s->sample_count, expenses = s->expense_count;
    enum lw_status status = LW_OK;
    for (size_t i = 0; status == LW_OK && i < sample_count; i++)
        status = add_line(s, SAMPLES, &sample[i], err);
    for (size_t i = 0; status == LW_OK && i < expense_count; i++)
        status = add_line(s, COSTS, &expense[i], err);
    struct lw_measure_store more = *s; /* the new lines */
    if (samples) more.sample += samples;
    if (expenses) more.expense += expenses;
    more.sample_count -= samples;
    more.expense_count -= expenses;
    if (status == LW_OK) status = append(&more, err);
    if (status == LW_OK) return LW_OK;
    s->sample_count = samples;
    s->expense_count = expenses;
    return status;
}

enum lw_status lw_measure_store_set_late(struct lw_measure_store *s, const struct lw_measure_late *late,
                                         size_t count, struct lw_error *err) {
    enum lw_status status = LW_OK;
    s->late_count = 0;
    for (size_t i = 0; status == LW_OK && i < count; i++) status = add_line(s, LATE, &late[i], err);
    return status == LW_OK ? save_table(s, LATE, err) : status;
}

const char *lw_measure_store_get(const struct lw_measure_store *s, const char *key) {
    for (size_t i = 0; i < s->note_count; i++)
        if (strcmp(s->note[i].key, key) == 0) return s->note[i].value;
    return NULL;
}

const char *lw_measure_store_note(const struct lw_measure_store *s, const char *key, const char *otherwise) {
    const char *value = lw_measure_store_get(s, key);
    return value && *value ? value : otherwise;
}

bool lw_measure_store_lists(const char *list, const char *entry) {
    const size_t size = strlen(entry);
    for (const char *at = list; at;) {
        const char *end = strstr(at, "; ");
        if ((end ? (size_t)(end - at) : strlen(at)) == size && memcmp(at, entry, size) == 0) return true;
        at = end ? end + 2 : NULL;
    }
    return false;
}

enum lw_status lw_measure_store_set(struct lw_measure_store *s, const char *key, const char *value,
                                    struct lw_error *err) {
    struct lw_measure_note note = {.key = ""};
    size_t at = 0;
    while (at < s->note_count && strcmp(s->note[at].key, key) != 0) at++;
    snprintf(note.key, sizeof note.key, "%s", key);
    snprintf(note.value, sizeof note.value, "%s", value);
    lw_status_one_line(note.value);
    if (at < s->note_count) {
        if (strcmp(s->note[at].value, note.value) == 0) return LW_OK;
        s->note[at] = note;
        return save_table(s, ROW, err);
    }
    const enum lw_status status = add_line(s, ROW, &note, err);
    return status == LW_OK ? save_table(s, ROW, err) : status;
}

enum lw_status lw_measure_store_fail(struct lw_measure_store *s, const struct lw_measure_unit *unit,
                                     const char *why, struct lw_error *err) {
    size_t kept = 0;
    const size_t before = s->failure_count;
    for (size_t i = 0; i < s->failure_count; i++)
        if (!lw_measure_store_same(&s->failure[i].unit, unit)) s->failure[kept++] = s->failure[i];
    s->failure_count = kept;
    if (!why && kept == before) return LW_OK;
    struct lw_measure_failure failure = {.unit = *unit};
    snprintf(failure.text, sizeof failure.text, "%s", why ? why : "");
    lw_status_one_line(failure.text);
    const enum lw_status status = why ? add_line(s, FAILURES, &failure, err) : LW_OK;
    return status == LW_OK ? save_table(s, FAILURES, err) : status;
}

void lw_measure_store_picture_path(const char *folder, const char *kind, const struct lw_measure_unit *unit,
                                   const char *ending, char *out, size_t size) {
    char name[2 * LW_MEASURE_NAME_SIZE + 2];
    snprintf(name, sizeof name, "%s-%s", unit->renderer, unit->setting);
    for (char *c = name; *c; c++)
        if (*c == ' ' || *c == '/') *c = '_';
    snprintf(out, size, "%s/pictures/%s-%s.%s", folder, kind, name, ending);
}
