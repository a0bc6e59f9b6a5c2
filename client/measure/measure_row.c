#include "client/measure/measure_row.h"

#include "common/base/clock.h"
#include "common/base/file_read.h"
#include "common/scene/package.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

enum lw_status lw_measure_row_note(struct lw_measure_row *row, struct lw_error *err, const char *key,
                                   const char *format, ...) {
    char value[LW_MEASURE_NOTE_SIZE];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(value, sizeof value, format, arguments);
    va_end(arguments);
    return lw_measure_store_set(&row->store, key, value, err);
}

/* ---- what later runs must share ---- */

static enum lw_status bind(struct lw_measure_row *row, const char *key, char *value, struct lw_error *err) {
    lw_status_one_line(value);
    const char *before = lw_measure_store_get(&row->store, key);
    /* figures without a note of it may belong to another row */
    if (!before && row->store.expense_count)
        return lw_status_fail(err, LW_USAGE,
                              "%s holds a row that does not note its %s, here %s: choose another folder",
                              row->store.folder, key, value);
    if (before && strcmp(before, value) != 0)
        return lw_status_fail(err, LW_USAGE, "%s holds a row whose %s is %s, not %s: choose another folder",
                              row->store.folder, key, before, value);
    return lw_measure_store_set(&row->store, key, value, err);
}

enum lw_status lw_measure_row_bind(struct lw_measure_row *row, struct lw_error *err, const char *key,
                                   const char *format, ...) {
    char value[LW_MEASURE_NOTE_SIZE];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(value, sizeof value, format, arguments);
    va_end(arguments);
    return bind(row, key, value, err);
}

/* Binds properties in turn, until one fails. */
struct binder {
    struct lw_measure_row *row;
    enum lw_status status;
    struct lw_error *err;
};

static void bind_next(struct binder *b, const char *key, const char *format, ...) LW_PRINTF(3, 4);
static void bind_next(struct binder *b, const char *key, const char *format, ...) {
    char value[LW_MEASURE_NOTE_SIZE];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(value, sizeof value, format, arguments);
    va_end(arguments);
    if (b->status == LW_OK) b->status = bind(b->row, key, value, b->err);
}

static void bind_number(struct binder *b, const char *key, bool given, double value, const char *otherwise) {
    if (given)
        bind_next(b, key, "%.9g", value);
    else
        bind_next(b, key, "%s", otherwise);
}

static void bind_scene(struct binder *b, const struct lw_scene_open *open) {
    const float *sky = open->sky;
    bind_number(b, "texels per metre", open->texels_per_metre > 0, open->texels_per_metre, "the default's");
    bind_number(b, "atlas-max", open->atlas_side_max > 0, (double)open->atlas_side_max, "the default");
    bind_next(b, "density-of", "%s", open->density_of ? open->density_of : "none");
    bind_number(b, "max-texels", open->texels_max > 0, (double)open->texels_max, "the default");
    if (open->sky_given)
        bind_next(b, "sky", "%.9g,%.9g,%.9g", (double)sky[0], (double)sky[1], (double)sky[2]);
    else
        bind_next(b, "sky", "the scene's");
    bind_next(b, "environment", "%s", open->environment ? open->environment : "the scene's");
    bind_number(b, "sun-angle", open->sun_angle_given, open->sun_angle_deg, "the scene's");
}

static enum lw_status bind_options(struct lw_measure_row *row, struct lw_error *err) {
    const struct lw_measure_options *o = row->options;
    struct binder b = {.row = row, .err = err};
    bind_next(&b, "version", "%s", LW_VERSION);
    bind_next(&b, "scene", "%s", o->scene.path);
    bind_next(&b, "motion", "%s", lw_scene_motion_name(o->motion));
    bind_next(&b, "size", "%ux%u", o->width, o->height);
    bind_next(&b, "bounces", "%u", o->bounces);
    if (o->solver || lw_measure_store_get(&row->store, "solver"))
        bind_next(&b, "solver", "%s", o->solver ? o->solver : "the default");
    bind_next(&b, "seed", "%u", o->seed);
    bind_next(&b, "reference samples", "%u", o->reference_samples);
    bind_next(&b, "seconds", "%g", o->seconds);
    bind_scene(&b, &o->scene);
    return b.status;
}

/* What the scene holds once it is opened, by the package at density 1: the light and the lightmap too. */
static enum lw_status bind_content(struct lw_measure_row *row, struct lw_error *err) {
    const char *path = row->densities.package[0].path;
    uint8_t *bytes;
    size_t size;
    struct lw_package_hash hash;
    enum lw_status status = lw_file_read(path, LW_PACKAGE_SIZE_MAX, true, &bytes, &size, err);
    if (status != LW_OK) {
        lw_status_context(err, "%s", path);
        return status;
    }
    lw_package_hash(bytes, size, &hash);
    free(bytes);
    for (size_t i = 0; i < sizeof hash.bytes; i++) snprintf(row->content + 2 * i, 3, "%02x", hash.bytes[i]);
    return lw_measure_row_bind(row, err, "scene's content", "%s", row->content);
}

/* ---- notes for the report ---- */

static void read_processor(char *out, size_t size) {
    char line[256];
    FILE *f = fopen("/proc/cpuinfo", "re");
    snprintf(out, size, "unknown processor");
    while (f && fgets(line, sizeof line, f)) {
        const char *colon = strchr(line, ':');
        if (strncmp(line, "model name", 10) != 0 || !colon) continue;
        line[strcspn(line, "\n")] = 0;
        snprintf(out, size, "%s", colon + 2);
        break;
    }
    if (f) fclose(f);
}

static enum lw_status note_machine(struct lw_measure_row *row, const char *command, struct lw_error *err) {
    char processor[200], day[32];
    struct tm utc;
    const time_t now = time(NULL);
    read_processor(processor, sizeof processor);
    strftime(day, sizeof day, "%Y-%m-%d", gmtime_r(&now, &utc));
    enum lw_status status = lw_measure_row_note(row, err, "command", "%s", command);
    if (status == LW_OK)
        status = lw_measure_row_note(row, err, "machine", "%s; %ld processors; lightwell " LW_VERSION,
                                     processor, sysconf(_SC_NPROCESSORS_ONLN));
    return status == LW_OK ? lw_measure_row_note(row, err, "day", "%s", day) : status;
}

static enum lw_status note_motion(struct lw_measure_row *row, struct lw_error *err) {
    const struct lw_scene_motion_report *r = &row->densities.report;
    char text[300] = "";
    size_t at = 0;
    if (r->light) at += (size_t)snprintf(text + at, sizeof text - at, "light \"%.60s\" ", r->light);
    if (r->object) at += (size_t)snprintf(text + at, sizeof text - at, "object \"%.60s\" ", r->object);
    if (r->speed_m_s > 0)
        at += (size_t)snprintf(text + at, sizeof text - at, "%.3g m/s ", (double)r->speed_m_s);
    if (r->speed_deg_s > 0)
        at += (size_t)snprintf(text + at, sizeof text - at, "%.3g degrees/s ", (double)r->speed_deg_s);
    if (at) text[at - 1] = 0;
    return lw_measure_row_note(row, err, "mover", "%s", text);
}

/* ---- the whole ---- */

enum lw_status lw_measure_row_open(struct lw_measure_row *row, const struct lw_measure_options *options,
                                   const _Atomic bool *cancel, struct lw_error *err) {
    *row = (struct lw_measure_row){.options = options, .cancel = cancel, .began_ns = lw_clock_ns()};
    enum lw_status status = lw_measure_store_open(&row->store, options->folder, false, err);
    return status == LW_OK ? bind_options(row, err) : status;
}

enum lw_status lw_measure_row_open_scene(struct lw_measure_row *row, const char *command,
                                         struct lw_error *err) {
    struct lw_scene_open open = row->options->scene;
    open.cancel = row->cancel;
    enum lw_status status = lw_scene_densities_init(&row->densities, &open, row->options->motion, err);
    if (status == LW_OK) status = bind_content(row, err);
    if (status == LW_OK)
        status =
            lw_measure_row_note(row, err, "triangles", "%llu", (unsigned long long)row->densities.triangles);
    if (status == LW_OK)
        status = lw_measure_row_note(row, err, "density", "%.4g", row->densities.texels_per_metre);
    if (status == LW_OK) status = note_motion(row, err);
    return status == LW_OK ? note_machine(row, command, err) : status;
}

void lw_measure_row_finish(struct lw_measure_row *row) {
    lw_scene_densities_finish(&row->densities);
    lw_measure_store_finish(&row->store);
}

struct lw_renderer_desc lw_measure_row_side(struct lw_measure_row *row,
                                            const struct lw_renderer_cameras *cameras) {
    const struct lw_measure_options *o = row->options;
    return (struct lw_renderer_desc){.densities = &row->densities,
                                     .cameras = *cameras,
                                     .width = o->width,
                                     .height = o->height,
                                     .stride = 1,
                                     .bounces = o->bounces,
                                     .threads = (unsigned)o->scene.threads,
                                     .denoise = true,
                                     .solver = o->solver};
}

enum lw_status lw_measure_row_check(const struct lw_measure_row *row, struct lw_error *err) {
    return *row->cancel ? lw_status_fail(err, LW_CLOSED, "interrupted") : LW_OK;
}
