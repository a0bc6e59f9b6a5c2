#include "client/measure/measure_store.h"

#include "client/measure/report.h"
#include "common/base/folders.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define FIELDS    48u
#define PATH_SIZE 4096u

const char *lw_measure_coin_name(enum lw_measure_coin coin) {
    static const char *const name[] = {
#define X(tag, text, about) text,
        LW_MEASURE_COIN_MAP(X)
#undef X
    };
    return name[coin];
}

const char *lw_measure_coin_about(enum lw_measure_coin coin) {
    static const char *const about[] = {
#define X(tag, name, text) text,
        LW_MEASURE_COIN_MAP(X)
#undef X
    };
    return about[coin];
}

static const char *const extra_name[] = {
#define X(tag, name, about) name,
    LW_MEASURE_EXTRA_MAP(X)
#undef X
};

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

/* ---- text ---- */

static void path_of(const struct lw_measure_store *s, const char *name, char out[PATH_SIZE]) {
    snprintf(out, PATH_SIZE, "%s/%s", s->folder, name);
}

static void print_number(FILE *f, double x) {
    if (isnan(x))
        fprintf(f, ",");
    else
        fprintf(f, ",%.9g", x);
}

static void print_unit(FILE *f, const struct lw_measure_unit *unit) {
    fprintf(f, "%s,%s,%u", unit->renderer, unit->setting, unit->repeat);
}

/* The whole tables, of an empty store their heads alone. context: a store. */

static void print_samples(struct lw_report *out, const void *context) {
    const struct lw_measure_store *s = context;
    fprintf(out->f, "renderer,setting,repeat,view,frame");
    for (int c = 0; c < LW_MEASURE_COIN_COUNT; c++)
        fprintf(out->f, ",%s", lw_measure_coin_name((enum lw_measure_coin)c));
    fprintf(out->f, "\n");
    for (size_t i = 0; i < s->sample_count; i++) {
        const struct lw_measure_sample *sample = &s->sample[i];
        print_unit(out->f, &sample->unit);
        fprintf(out->f, ",%u,%u", sample->view, sample->frame);
        for (int c = 0; c < LW_MEASURE_COIN_COUNT; c++) print_number(out->f, sample->coin[c]);
        fprintf(out->f, "\n");
    }
}

static void print_expense(FILE *f, const struct lw_measure_expense *e) {
    print_unit(f, &e->unit);
    fprintf(f, ",%u,", e->users);
    if (e->view == LW_MEASURE_ALL || e->view == LW_MEASURE_SOME)
        fprintf(f, e->view == LW_MEASURE_ALL ? "all" : "some");
    else
        fprintf(f, "%u", e->view);
    fprintf(f, ",%u,%u", e->frames, e->samples);
    for (int s = 0; s < LW_STAGE_COUNT; s++) print_number(f, e->cpu_s[s]);
    for (int x = 0; x < LW_MEASURE_EXTRA_COUNT; x++) print_number(f, e->extra[x]);
    fprintf(f, "\n");
}

static void print_costs(struct lw_report *out, const void *context) {
    const struct lw_measure_store *s = context;
    fprintf(out->f, "renderer,setting,repeat,users,view,frames,samples");
    for (int stage = 0; stage < LW_STAGE_COUNT; stage++) {
        char name[40];
        snprintf(name, sizeof name, "%s", lw_stage_name((enum lw_stage)stage));
        for (char *c = name; *c; c++)
            if (*c == ' ') *c = '_';
        fprintf(out->f, ",%s_cpu_s", name);
    }
    for (int x = 0; x < LW_MEASURE_EXTRA_COUNT; x++) fprintf(out->f, ",%s", extra_name[x]);
    fprintf(out->f, "\n");
    for (size_t i = 0; i < s->expense_count; i++) print_expense(out->f, &s->expense[i]);
}

static void print_late(struct lw_report *out, const void *context) {
    const struct lw_measure_store *s = context;
    fprintf(out->f, "view,frame,late,relmse\n");
    for (const struct lw_measure_late *l = s->late; l < s->late + s->late_count; l++)
        fprintf(out->f, "%u,%u,%u,%.9g\n", l->view, l->frame, l->late, l->relmse);
}

static void print_notes(struct lw_report *out, const void *context) {
    const struct lw_measure_store *s = context;
    for (size_t i = 0; i < s->note_count; i++) fprintf(out->f, "%s,%s\n", s->note[i].key, s->note[i].value);
}

static void print_failures(struct lw_report *out, const void *context) {
    const struct lw_measure_store *s = context;
    for (size_t i = 0; i < s->failure_count; i++) {
        print_unit(out->f, &s->failure[i].unit);
        fprintf(out->f, ",%s\n", s->failure[i].text);
    }
}

/* ---- reading ---- */

/* One table while it is read. */
struct table {
    const struct lw_measure_store *store;
    const struct lw_report_file *file;
    char *bytes, *at; /* NULL: there is none */
    uint32_t line;
    char *field[FIELDS];
    uint32_t field_count;
    bool torn; /* its last line had no end */
};

static enum lw_status load(struct table *t, struct lw_error *err) {
    char path[PATH_SIZE];
    struct stat about;
    path_of(t->store, t->file->name, path);
    FILE *f = fopen(path, "re");
    if (!f && errno == ENOENT) return LW_OK;
    if (!f) return lw_status_fail(err, LW_NO_INPUT, "%s: %s", path, strerror(errno));
    const size_t size = fstat(fileno(f), &about) == 0 ? (size_t)about.st_size : 0;
    t->at = t->bytes = calloc(size + 1, 1);
    const bool good = t->bytes && fread(t->bytes, 1, size, f) <= size && !ferror(f);
    fclose(f);
    if (!t->bytes) return lw_status_fail(err, LW_NO_MEMORY, "no memory for %s", path);
    return good ? LW_OK : lw_status_fail(err, LW_IO, "%s: cannot read", path);
}

/* The next line, without its end; false: there is none. A line without an end was torn off. */
static bool next_line(struct table *t, char **out_line) {
    if (!t->at || !*t->at) return false;
    char *stop = strchr(t->at, '\n');
    if (!stop) {
        t->torn = true;
        return false;
    }
    *stop = 0;
    *out_line = t->at;
    t->at = stop + 1;
    t->line++;
    return true;
}

/* Splits at commas, into `most` fields: the last one takes the rest. */
static void split(struct table *t, char *line, uint32_t most) {
    t->field_count = 0;
    while (t->field_count < most) {
        t->field[t->field_count++] = line;
        char *comma = t->field_count < most ? strchr(line, ',') : NULL;
        if (!comma) return;
        *comma = 0;
        line = comma + 1;
    }
}

static enum lw_status bad_line(const struct table *t, const char *why, struct lw_error *err) {
    return lw_status_fail(err, LW_BAD_DATA, "%s/%s, line %u: %s", t->store->folder, t->file->name, t->line,
                          why);
}

static enum lw_status skip_head(struct table *t, struct lw_error *err) {
    static const struct lw_measure_store empty;
    char *head, *line;
    size_t size;
    enum lw_status status = lw_report_print(t->file, &empty, &head, &size, err);
    if (status != LW_OK) return status;
    bool same = true;
    if (size && next_line(t, &line)) {
        head[size - 1] = 0; /* the line's end */
        same = strcmp(head, line) == 0;
    }
    free(head);
    return same ? LW_OK : bad_line(t, "other columns than this version writes", err);
}

static bool read_count(const char *text, uint32_t *out) {
    char *stop;
    if (*text < '0' || *text > '9') return false;
    errno = 0;
    const unsigned long value = strtoul(text, &stop, 10);
    *out = (uint32_t)value;
    return !errno && !*stop && value < UINT32_MAX;
}

static bool read_number(const char *text, double *out) {
    char *stop;
    *out = *text ? strtod(text, &stop) : (double)NAN;
    return !*text || (!*stop && isfinite(*out));
}

static bool read_unit(char *const *field, struct lw_measure_unit *out) {
    if (strlen(field[0]) >= sizeof out->renderer || strlen(field[1]) >= sizeof out->setting) return false;
    snprintf(out->renderer, sizeof out->renderer, "%s", field[0]);
    snprintf(out->setting, sizeof out->setting, "%s", field[1]);
    return read_count(field[2], &out->repeat) && out->repeat < LW_MEASURE_REPEATS_MAX;
}

/* Room for one more in an array. */
static void *grown_array(void *array, size_t count, size_t size) {
    if (count & (count - 1)) return array; /* doubled at powers of two */
    return realloc(array, (count ? 2 * count : 1) * size);
}

#define PUSH(array, count, value)                                                                            \
    (grow_into((void **)&(array), (count), sizeof *(array)) && ((array)[(count)++] = (value), true))

static bool grow_into(void **array, size_t count, size_t size) {
    void *grown = grown_array(*array, count, size);
    if (grown) *array = grown;
    return grown != NULL;
}

/* Each takes a line into the store. LW_BAD_DATA: it is none of the table; LW_NO_MEMORY. */

static enum lw_status take_sample(struct lw_measure_store *s, char *const *field, uint32_t count) {
    struct lw_measure_sample x;
    bool good = count == 5 + LW_MEASURE_COIN_COUNT && read_unit(field, &x.unit) &&
                read_count(field[3], &x.view) && read_count(field[4], &x.frame) && x.view < LW_MEASURE_VIEWS;
    for (uint32_t c = 0; good && c < LW_MEASURE_COIN_COUNT; c++) good = read_number(field[5 + c], &x.coin[c]);
    if (!good) return LW_BAD_DATA;
    return PUSH(s->sample, s->sample_count, x) ? LW_OK : LW_NO_MEMORY;
}

static bool read_view(const char *text, uint32_t *out) {
    const bool all = strcmp(text, "all") == 0, some = strcmp(text, "some") == 0;
    if (!all && !some) return read_count(text, out) && *out < LW_MEASURE_VIEWS;
    *out = all ? LW_MEASURE_ALL : LW_MEASURE_SOME;
    return true;
}

static enum lw_status take_expense(struct lw_measure_store *s, char *const *field, uint32_t count) {
    struct lw_measure_expense x;
    bool good = count == 7 + LW_STAGE_COUNT + LW_MEASURE_EXTRA_COUNT && read_unit(field, &x.unit) &&
                read_count(field[3], &x.users) && read_view(field[4], &x.view) &&
                read_count(field[5], &x.frames) && read_count(field[6], &x.samples);
    for (uint32_t i = 0; good && i < LW_STAGE_COUNT; i++)
        good = read_number(field[7 + i], &x.cpu_s[i]) && !isnan(x.cpu_s[i]);
    for (uint32_t i = 0; good && i < LW_MEASURE_EXTRA_COUNT; i++)
        good = read_number(field[7 + LW_STAGE_COUNT + i], &x.extra[i]);
    if (!good) return LW_BAD_DATA;
    return PUSH(s->expense, s->expense_count, x) ? LW_OK : LW_NO_MEMORY;
}

static enum lw_status take_late(struct lw_measure_store *s, char *const *field, uint32_t count) {
    struct lw_measure_late x;
    if (count != 4 || !read_count(field[0], &x.view) || x.view >= LW_MEASURE_VIEWS ||
        !read_count(field[1], &x.frame) || !read_count(field[2], &x.late) ||
        !read_number(field[3], &x.relmse))
        return LW_BAD_DATA;
    return PUSH(s->late, s->late_count, x) ? LW_OK : LW_NO_MEMORY;
}

static enum lw_status take_note(struct lw_measure_store *s, char *const *field, uint32_t count) {
    struct lw_measure_note x;
    if (count != 2 || strlen(field[0]) >= sizeof x.key) return LW_BAD_DATA;
    snprintf(x.key, sizeof x.key, "%s", field[0]);
    snprintf(x.value, sizeof x.value, "%s", field[1]);
    return PUSH(s->note, s->note_count, x) ? LW_OK : LW_NO_MEMORY;
}

static enum lw_status take_failure(struct lw_measure_store *s, char *const *field, uint32_t count) {
    struct lw_measure_failure x;
    if (count != 4 || !read_unit(field, &x.unit)) return LW_BAD_DATA;
    snprintf(x.text, sizeof x.text, "%s", field[3]);
    return PUSH(s->failure, s->failure_count, x) ? LW_OK : LW_NO_MEMORY;
}

enum kind { SAMPLES, COSTS, LATE, ROW, FAILURES, KINDS };

static const struct {
    struct lw_report_file file;
    const char *fault; /* text for a bad line */
    uint32_t fields;   /* the last one takes the rest of the line */
    enum lw_status (*take)(struct lw_measure_store *s, char *const *field, uint32_t count);
} tables[KINDS] = {{{"samples.csv", print_samples}, "not a sample", FIELDS, take_sample},
                   {{"costs.csv", print_costs}, "not a cost", FIELDS, take_expense},
                   {{"late.csv", print_late}, "not an error of late light", FIELDS, take_late},
                   {{"row.csv", print_notes}, "not KEY,VALUE", 2, take_note},
                   {{"failures.csv", print_failures}, "not a failure", 4, take_failure}};

static enum lw_status no_memory(enum kind kind, struct lw_error *err) {
    return lw_status_fail(err, LW_NO_MEMORY, "no memory for %s", tables[kind].file.name);
}

static enum lw_status save_table(const struct lw_measure_store *s, enum kind kind, struct lw_error *err) {
    return lw_report_save(s->folder, &tables[kind].file, 1, s, err);
}

static enum lw_status read_table(struct lw_measure_store *s, enum kind kind, bool *out_torn,
                                 struct lw_error *err) {
    struct table t = {.store = s, .file = &tables[kind].file};
    char *line;
    enum lw_status status = load(&t, err);
    if (status == LW_OK) status = skip_head(&t, err);
    while (status == LW_OK && next_line(&t, &line)) {
        split(&t, line, tables[kind].fields);
        status = tables[kind].take(s, t.field, t.field_count);
        if (status == LW_BAD_DATA)
            status = bad_line(&t, tables[kind].fault, err);
        else if (status != LW_OK)
            status = no_memory(kind, err);
    }
    *out_torn |= t.torn;
    free(t.bytes);
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
    path_of(s, tables[kind].file.name, path);
    *out_file = open(path, O_WRONLY | O_APPEND | O_CLOEXEC);
    if (*out_file < 0) return lw_status_fail(err, LW_CANNOT_CREATE, "%s: %s", path, strerror(errno));
    return LW_OK;
}

/* A table without lines has a head. */
static bool has_table(const struct lw_measure_store *s, enum kind kind) {
    char path[PATH_SIZE];
    struct stat about;
    path_of(s, tables[kind].file.name, path);
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
    char *bytes;
    size_t size;
    enum lw_status status = lw_report_print(&tables[kind].file, more, &bytes, &size, err);
    if (status != LW_OK) return status;
    if (!write_text(file, strchr(bytes, '\n') + 1))
        status = lw_status_fail(err, LW_IO, "%s/%s: cannot write: %s", more->folder, tables[kind].file.name,
                                strerror(errno));
    free(bytes);
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
    bool room = true;
    for (size_t i = 0; room && i < sample_count; i++) room = PUSH(s->sample, s->sample_count, sample[i]);
    for (size_t i = 0; room && i < expense_count; i++) room = PUSH(s->expense, s->expense_count, expense[i]);
    struct lw_measure_store more = *s; /* the new lines */
    if (samples) more.sample += samples;
    if (expenses) more.expense += expenses;
    more.sample_count -= samples;
    more.expense_count -= expenses;
    const enum lw_status status =
        room ? append(&more, err) : lw_status_fail(err, LW_NO_MEMORY, "no memory for what was measured");
    if (status != LW_OK) {
        s->sample_count = samples;
        s->expense_count = expenses;
    }
    return status;
}

enum lw_status lw_measure_store_set_late(struct lw_measure_store *s, const struct lw_measure_late *late,
                                         size_t count, struct lw_error *err) {
    s->late_count = 0;
    for (size_t i = 0; i < count; i++)
        if (!PUSH(s->late, s->late_count, late[i])) return no_memory(LATE, err);
    return save_table(s, LATE, err);
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
    } else if (!PUSH(s->note, s->note_count, note)) {
        return no_memory(ROW, err);
    }
    return save_table(s, ROW, err);
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
    if (why && !PUSH(s->failure, s->failure_count, failure)) return no_memory(FAILURES, err);
    return save_table(s, FAILURES, err);
}

void lw_measure_store_picture_path(const char *folder, const char *kind, const struct lw_measure_unit *unit,
                                   const char *ending, char *out, size_t size) {
    char name[2 * LW_MEASURE_NAME_SIZE + 2];
    snprintf(name, sizeof name, "%s-%s", unit->renderer, unit->setting);
    for (char *c = name; *c; c++)
        if (*c == ' ' || *c == '/') *c = '_';
    snprintf(out, size, "%s/pictures/%s-%s.%s", folder, kind, name, ending);
}
