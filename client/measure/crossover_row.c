#include "client/measure/crossover_row.h"

#include "client/measure/sides/views.h"
#include "common/clock.h"
#include "common/file_read.h"
#include "common/log.h"
#include "common/scene/package.h"

#include <errno.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

_Static_assert(LW_CROSSOVER_VIEWS == LW_FIXED_VIEWS_COUNT, "one user a view");

/* After the lamp has gone off: frames that are judged. */
static const uint32_t after_switch[] = {1, 2, 4, 8, 15, 30};

struct lw_camera_view lw_crossover_row_camera(const void *context, uint32_t user, uint64_t frame) {
    return lw_fixed_views_at(context, user, (double)(frame - 1) / LW_VIEWS_HZ);
}

struct lw_renderer_desc lw_crossover_row_side(struct lw_crossover_row *row) {
    const struct lw_crossover_options *o = row->options;
    return (struct lw_renderer_desc){.densities = &row->densities,
                                     .cameras = {.context = &row->views, .at = lw_crossover_row_camera},
                                     .width = o->base.width,
                                     .height = o->base.height,
                                     .stride = 1,
                                     .bounces = o->base.bounces,
                                     .threads = (unsigned)o->base.scene.threads,
                                     .denoise = true,
                                     .solver = o->base.solver};
}

/* ---- what the row is ---- */

static void lay_out(struct lw_crossover_row *row) {
    const struct lw_crossover_options *o = row->options;
    const uint32_t window = (uint32_t)fmax(2, round(o->base.seconds * LW_VIEWS_HZ));
    if (o->base.motion == LW_SCENE_MOTION_LAMP_SWITCH) { /* all that its step costs */
        const uint32_t before = (uint32_t)lroundf(LW_SCENE_MOTION_OFF_S * LW_VIEWS_HZ);
        for (size_t i = 0; i < sizeof after_switch / sizeof *after_switch; i++)
            row->judged[row->judged_count++] = before + after_switch[i];
        row->window = before + 1;
        return;
    }
    row->judged[0] = (uint32_t)lround(o->warm_s * LW_VIEWS_HZ) + 1;
    row->judged[1] = row->judged[0] + 1;
    row->judged_count = 2;
    row->window = row->judged[1] > window ? row->judged[1] - window + 1 : 1;
}

/* A property of the row that later runs must share. What is measured without a note of it may be of
 * another. */
static enum lw_status bind_note(struct lw_crossover_row *row, struct lw_error *err, const char *key,
                                const char *format, ...) LW_PRINTF(4, 5);
static enum lw_status bind_note(struct lw_crossover_row *row, struct lw_error *err, const char *key,
                                const char *format, ...) {
    struct lw_crossover_note note;
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(note.value, sizeof note.value, format, arguments);
    va_end(arguments);
    lw_status_one_line(note.value);
    const char *before = lw_crossover_store_get(&row->store, key);
    if (!before && row->store.expense_count)
        return lw_status_fail(err, LW_USAGE,
                              "%s holds a row that does not note its %s, here %s: choose another folder",
                              row->store.folder, key, note.value);
    if (before && strcmp(before, note.value) != 0)
        return lw_status_fail(err, LW_USAGE, "%s holds a row whose %s is %s, not %s: choose another folder",
                              row->store.folder, key, before, note.value);
    return lw_crossover_store_set(&row->store, key, note.value, err);
}

/* The options of opening a scene. */
static enum lw_status bind_scene(struct lw_crossover_row *row, struct lw_error *err) {
    const struct lw_scene_open *open = &row->options->base.scene;
    const float *sky = open->sky;
    enum lw_status status = open->atlas_side_max > 0
                                ? bind_note(row, err, "atlas-max", "%lld", (long long)open->atlas_side_max)
                                : bind_note(row, err, "atlas-max", "the default");
    if (status == LW_OK)
        status = bind_note(row, err, "density-of", "%s", open->density_of ? open->density_of : "none");
    if (status == LW_OK)
        status = open->texels_max > 0 ? bind_note(row, err, "max-texels", "%lld", (long long)open->texels_max)
                                      : bind_note(row, err, "max-texels", "the default");
    if (status == LW_OK)
        status = open->sky_given ? bind_note(row, err, "sky", "%.9g,%.9g,%.9g", (double)sky[0],
                                             (double)sky[1], (double)sky[2])
                                 : bind_note(row, err, "sky", "the scene's");
    if (status == LW_OK)
        status =
            bind_note(row, err, "environment", "%s", open->environment ? open->environment : "the scene's");
    if (status == LW_OK)
        status = open->sun_angle_given ? bind_note(row, err, "sun-angle", "%.9g", open->sun_angle_deg)
                                       : bind_note(row, err, "sun-angle", "the scene's");
    return status;
}

static enum lw_status bind(struct lw_crossover_row *row, struct lw_error *err) {
    const struct lw_crossover_options *o = row->options;
    enum lw_status status = bind_note(row, err, "version", LW_VERSION);
    if (status == LW_OK) status = bind_note(row, err, "scene", "%s", o->base.scene.path);
    if (status == LW_OK) status = bind_note(row, err, "motion", "%s", lw_scene_motion_name(o->base.motion));
    if (status == LW_OK) status = bind_note(row, err, "size", "%ux%u", o->base.width, o->base.height);
    if (status == LW_OK) status = bind_note(row, err, "bounces", "%u", o->base.bounces);
    if (status == LW_OK && (o->base.solver || lw_crossover_store_get(&row->store, "solver")))
        status = bind_note(row, err, "solver", "%s", o->base.solver ? o->base.solver : "the default");
    if (status == LW_OK) status = bind_note(row, err, "seed", "%u", o->base.seed);
    if (status == LW_OK) status = bind_note(row, err, "reference samples", "%u", o->base.reference_samples);
    if (status == LW_OK) status = bind_note(row, err, "warm", "%g", o->warm_s);
    if (status == LW_OK) status = bind_note(row, err, "seconds", "%g", o->base.seconds);
    if (status == LW_OK)
        status = bind_note(row, err, "texels per metre",
                           o->base.scene.texels_per_metre > 0 ? "%g" : "the default's",
                           o->base.scene.texels_per_metre);
    return status == LW_OK ? bind_scene(row, err) : status;
}

/* What the scene holds once it is opened, by the package at density 1: the light and the lightmap too. */
static enum lw_status bind_content(struct lw_crossover_row *row, struct lw_error *err) {
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
    return bind_note(row, err, "scene's content", "%s", row->content);
}

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

enum lw_status lw_crossover_row_note(struct lw_crossover_row *row, struct lw_error *err, const char *key,
                                     const char *format, ...) {
    char value[400];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(value, sizeof value, format, arguments);
    va_end(arguments);
    return lw_crossover_store_set(&row->store, key, value, err);
}

static enum lw_status note_machine(struct lw_crossover_row *row, const char *command, struct lw_error *err) {
    char processor[200], day[32], commands[400];
    struct tm utc;
    const time_t now = time(NULL);
    read_processor(processor, sizeof processor);
    strftime(day, sizeof day, "%Y-%m-%d", gmtime_r(&now, &utc));
    snprintf(commands, sizeof commands, "%s", command);
    enum lw_status status = lw_crossover_row_note(row, err, "command", "%s", commands);
    if (status == LW_OK)
        status = lw_crossover_row_note(row, err, "machine", "%s; %ld processors; lightwell " LW_VERSION,
                                       processor, sysconf(_SC_NPROCESSORS_ONLN));
    return status == LW_OK ? lw_crossover_row_note(row, err, "day", "%s", day) : status;
}

static enum lw_status note_motion(struct lw_crossover_row *row, struct lw_error *err) {
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
    return lw_crossover_row_note(row, err, "mover", "%s", text);
}

static enum lw_status note_references(struct lw_crossover_row *row, struct lw_error *err) {
    const struct lw_crossover_references *t = &row->references;
    struct lw_crossover_late late[LW_CROSSOVER_LATES * LW_CROSSOVER_VIEWS];
    char text[100] = "";
    size_t count = 0, at = 0;
    for (uint32_t l = 0; l < LW_CROSSOVER_LATES; l++)
        for (uint32_t v = 0; v < LW_CROSSOVER_VIEWS; v++)
            if (!t->dark[v])
                late[count++] =
                    (struct lw_crossover_late){.view = v,
                                               .frame = t->judged[0],
                                               .late = LW_CROSSOVER_LATE_FRAMES * (LW_CROSSOVER_LATES - l),
                                               .relmse = lw_crossover_references_late_error(t, l, v)};
    enum lw_status status = lw_crossover_store_set_late(&row->store, late, count, err);
    for (uint32_t v = 0; v < LW_CROSSOVER_VIEWS; v++)
        if (t->dark[v]) at += (size_t)snprintf(text + at, sizeof text - at, "%s%u", at ? " " : "", v);
    if (status == LW_OK) status = lw_crossover_row_note(row, err, "dark views", "%s", text);
    if (status == LW_OK) status = lw_crossover_row_note(row, err, "mean square", "%.6g", t->mean_square);
    if (status == LW_OK) status = lw_crossover_row_note(row, err, "stops", "%.4g", (double)t->stops);
    return status == LW_OK ? lw_crossover_row_note(row, err, "crop", "%u", t->side) : status;
}

/* ---- preparing ---- */

/* Tells views of other tables apart, bit by bit (FNV-1a). */
static uint32_t hash_views(const struct lw_fixed_views *views) {
    uint32_t hash = 2166136261u;
    for (uint32_t v = 0; v < LW_CROSSOVER_VIEWS; v++)
        for (uint32_t moment = 0; moment < 2; moment++) {
            const struct lw_camera_view camera = lw_fixed_views_at(views, v, moment);
            const uint8_t *byte = (const uint8_t *)&camera; /* floats alone: nothing between them */
            for (size_t i = 0; i < sizeof camera; i++) hash = (hash ^ byte[i]) * 16777619u;
        }
    return hash;
}

static enum lw_status find_views(struct lw_crossover_row *row, struct lw_error *err) {
    struct lw_scene *scene;
    struct lw_scene_open open = row->options->base.scene;
    open.cancel = row->cancel;
    open.lightmap_unused = true;
    enum lw_status status = lw_scene_open(&open, &scene, err); /* as it is before anything is set moving */
    if (status != LW_OK) return status;
    status = lw_fixed_views_init(&row->views, scene, (unsigned)open.threads, err);
    lw_scene_destroy(scene);
    if (status == LW_OK) status = bind_note(row, err, "views' key", "%08x", hash_views(&row->views));
    return status == LW_OK ? lw_crossover_row_note(row, err, "views", "%s",
                                                   row->views.from_table ? "of the table" : "by the rule")
                           : status;
}

static enum lw_status open_scene(struct lw_crossover_row *row, struct lw_error *err) {
    struct lw_scene_open open = row->options->base.scene;
    open.cancel = row->cancel;
    enum lw_status status = lw_scene_densities_init(&row->densities, &open, row->options->base.motion, err);
    if (status == LW_OK) status = bind_content(row, err);
    if (status == LW_OK)
        status = lw_crossover_row_note(row, err, "triangles", "%llu",
                                       (unsigned long long)row->densities.triangles);
    if (status == LW_OK)
        status = lw_crossover_row_note(row, err, "density", "%.4g", row->densities.texels_per_metre);
    return status == LW_OK ? note_motion(row, err) : status;
}

static enum lw_status make_folder(const char *folder, const char *name, struct lw_error *err) {
    char path[4096];
    snprintf(path, sizeof path, "%s/%s", folder, name);
    if (mkdir(path, 0777) < 0 && errno != EEXIST)
        return lw_status_fail(err, LW_CANNOT_CREATE, "%s: cannot make the folder: %s", path, strerror(errno));
    return LW_OK;
}

enum lw_status lw_crossover_row_open(struct lw_crossover_row *row, const struct lw_crossover_options *o,
                                     const char *command, const _Atomic bool *cancel, struct lw_error *err) {
    *row = (struct lw_crossover_row){.options = o,
                                     .cancel = cancel,
                                     .began_ns = lw_clock_ns(),
                                     .store = {.samples_file = -1, .costs_file = -1}};
    enum lw_status status = lw_crossover_store_open(&row->store, o->base.folder, false, err);
    if (status == LW_OK) status = bind(row, err);
    if (status == LW_OK) status = make_folder(o->base.folder, "pictures", err);
    if (status == LW_OK) status = find_views(row, err);
    if (status == LW_OK) status = open_scene(row, err);
    if (status == LW_OK) status = note_machine(row, command, err); /* of a run that is not refused */
    if (status != LW_OK) return status;
    lay_out(row);
    lw_log(LW_LOG_INFO, "%s, %s: %llu triangles, twelve views %s", o->base.scene.path,
           lw_scene_motion_name(o->base.motion), (unsigned long long)row->densities.triangles,
           row->views.from_table ? "of the table" : "by the rule");
    status =
        lw_crossover_references_init(&row->references,
                                     &(struct lw_crossover_references_desc){
                                         .options = &o->base,
                                         .scene = row->densities.scene,
                                         .content = row->content,
                                         .cameras = {.context = &row->views, .at = lw_crossover_row_camera},
                                         .folder = o->base.folder,
                                         .judged = row->judged,
                                         .judged_count = row->judged_count,
                                         .cancel = row->cancel},
                                     err);
    return status == LW_OK ? note_references(row, err) : status;
}

void lw_crossover_row_finish(struct lw_crossover_row *row) {
    lw_crossover_references_finish(&row->references);
    lw_scene_densities_finish(&row->densities);
    lw_crossover_store_finish(&row->store);
}
