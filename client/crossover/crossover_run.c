#include "client/crossover/crossover_run.h"

#include "client/crossover/crossover_unit.h"
#include "client/measure/views.h"
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
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/utsname.h>
#include <time.h>
#include <unistd.h>

_Static_assert(LW_CROSSOVER_VIEWS == LW_FIXED_VIEWS_COUNT, "one user a view");

#define TEXELS_MAX 8e6 /* of the lightmaps that are tried: the server takes some 600 bytes for each */
#define PLANS_MAX  128u
#define GAIN_MIN   0.9 /* of the error with fewer samples: what more of them must at least bring */

/* Samples per texel and frame, and the error at which tiles rest. */
static const struct {
    uint32_t direct, indirect;
    double rest;
} rungs[] = {{1, 1, 0.2}, {1, 2, 0.02}};
#define RUNGS (sizeof rungs / sizeof *rungs)

/* After the lamp has gone off: frames that are judged. */
static const uint32_t after_switch[] = {1, 2, 4, 8, 15, 30};

/* ---- packages ---- */

/* Of this process and of those that it has waited for. */
static double all_cpu_s(void) {
    struct rusage usage;
    double sum = 1e-9 * (double)lw_clock_process_cpu_ns();
    if (getrusage(RUSAGE_CHILDREN, &usage) == 0)
        sum += (double)usage.ru_utime.tv_sec + (double)usage.ru_stime.tv_sec +
               1e-6 * (double)(usage.ru_utime.tv_usec + usage.ru_stime.tv_usec);
    return sum;
}

enum lw_status lw_crossover_run_package(struct lw_crossover_run *run, double density, const char **out_path,
                                        struct lw_error *err) {
    const uint32_t before = run->densities.package_count;
    const double began_s = all_cpu_s();
    enum lw_status status = lw_scene_densities_find(&run->densities, density, out_path, err);
    if (run->densities.package_count > before) run->build_cpu_s[before] = all_cpu_s() - began_s;
    return status;
}

double lw_crossover_run_build_cpu_s(const struct lw_crossover_run *run, double density) {
    for (uint32_t i = 0; i < run->densities.package_count; i++)
        if (run->densities.package[i].density == density) return run->build_cpu_s[i];
    return (double)NAN;
}

struct lw_camera_view lw_crossover_run_camera(const void *context, uint32_t user, uint64_t frame) {
    return lw_fixed_views_at(context, user, (double)(frame - 1) / LW_VIEWS_HZ);
}

void lw_crossover_run_picture_path(const char *folder, const char *kind, const struct lw_crossover_unit *unit,
                                   const char *ending, char *out, size_t size) {
    char name[2 * LW_CROSSOVER_NAME_SIZE + 2];
    snprintf(name, sizeof name, "%s-%s", unit->renderer, unit->setting);
    for (char *c = name; *c; c++)
        if (*c == ' ' || *c == '/') *c = '_';
    snprintf(out, size, "%s/pictures/%s-%s.%s", folder, kind, name, ending);
}

/* ---- what the row is ---- */

static void lay_out(struct lw_crossover_run *run) {
    const struct lw_crossover_options *o = run->options;
    const uint32_t window = (uint32_t)fmax(2, round(o->seconds * LW_VIEWS_HZ));
    if (o->motion == LW_SCENE_MOTION_LAMP_SWITCH) { /* all that its step costs */
        const uint32_t before = (uint32_t)lroundf(LW_SCENE_MOTION_OFF_S * LW_VIEWS_HZ);
        for (size_t i = 0; i < sizeof after_switch / sizeof *after_switch; i++)
            run->judged[run->judged_count++] = before + after_switch[i];
        run->window = before + 1;
        return;
    }
    run->judged[0] = (uint32_t)lround(o->warm_s * LW_VIEWS_HZ) + 1;
    run->judged[1] = run->judged[0] + 1;
    run->judged_count = 2;
    run->window = run->judged[1] > window ? run->judged[1] - window + 1 : 1;
}

/* A property of the row that later runs must share. What is measured without a note of it may be of
 * another. */
static enum lw_status bind_row(struct lw_crossover_run *run, struct lw_error *err, const char *key,
                               const char *format, ...) LW_PRINTF(4, 5);
static enum lw_status bind_row(struct lw_crossover_run *run, struct lw_error *err, const char *key,
                               const char *format, ...) {
    struct lw_crossover_note note;
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(note.value, sizeof note.value, format, arguments);
    va_end(arguments);
    lw_status_one_line(note.value);
    const char *before = lw_crossover_store_get(&run->store, key);
    if (!before && run->store.expense_count)
        return lw_status_fail(err, LW_USAGE,
                              "%s holds a row that does not note its %s, here %s: choose another folder",
                              run->store.folder, key, note.value);
    if (before && strcmp(before, note.value) != 0)
        return lw_status_fail(err, LW_USAGE, "%s holds a row whose %s is %s, not %s: choose another folder",
                              run->store.folder, key, before, note.value);
    return lw_crossover_store_set(&run->store, key, note.value, err);
}

/* The options of opening a scene. */
static enum lw_status bind_scene(struct lw_crossover_run *run, struct lw_error *err) {
    const struct lw_scene_open *open = &run->options->scene;
    const float *sky = open->sky;
    enum lw_status status = open->atlas_side_max > 0
                                ? bind_row(run, err, "atlas-max", "%lld", (long long)open->atlas_side_max)
                                : bind_row(run, err, "atlas-max", "the default");
    if (status == LW_OK)
        status = open->texels_max > 0 ? bind_row(run, err, "max-texels", "%lld", (long long)open->texels_max)
                                      : bind_row(run, err, "max-texels", "the default");
    if (status == LW_OK)
        status = open->sky_given ? bind_row(run, err, "sky", "%.9g,%.9g,%.9g", (double)sky[0], (double)sky[1],
                                            (double)sky[2])
                                 : bind_row(run, err, "sky", "the scene's");
    if (status == LW_OK)
        status =
            bind_row(run, err, "environment", "%s", open->environment ? open->environment : "the scene's");
    if (status == LW_OK)
        status = open->sun_angle_given ? bind_row(run, err, "sun-angle", "%.9g", open->sun_angle_deg)
                                       : bind_row(run, err, "sun-angle", "the scene's");
    return status;
}

static enum lw_status bind(struct lw_crossover_run *run, struct lw_error *err) {
    const struct lw_crossover_options *o = run->options;
    enum lw_status status = bind_row(run, err, "version", LW_VERSION);
    if (status == LW_OK) status = bind_row(run, err, "scene", "%s", o->scene.path);
    if (status == LW_OK) status = bind_row(run, err, "motion", "%s", lw_scene_motion_name(o->motion));
    if (status == LW_OK) status = bind_row(run, err, "size", "%ux%u", o->width, o->height);
    if (status == LW_OK) status = bind_row(run, err, "bounces", "%u", o->bounces);
    if (status == LW_OK && (o->solver || lw_crossover_store_get(&run->store, "solver")))
        status = bind_row(run, err, "solver", "%s", o->solver ? o->solver : "the default");
    if (status == LW_OK) status = bind_row(run, err, "seed", "%u", o->seed);
    if (status == LW_OK) status = bind_row(run, err, "reference samples", "%u", o->reference_samples);
    if (status == LW_OK) status = bind_row(run, err, "warm", "%g", o->warm_s);
    if (status == LW_OK) status = bind_row(run, err, "seconds", "%g", o->seconds);
    if (status == LW_OK)
        status = bind_row(run, err, "texels per metre",
                          o->scene.texels_per_metre > 0 ? "%g" : "the default's", o->scene.texels_per_metre);
    return status == LW_OK ? bind_scene(run, err) : status;
}

/* What the scene holds once it is opened, by the package at density 1: the light and the lightmap too. */
static enum lw_status bind_content(struct lw_crossover_run *run, struct lw_error *err) {
    const char *path = run->densities.package[0].path;
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
    for (size_t i = 0; i < sizeof hash.bytes; i++) snprintf(run->content + 2 * i, 3, "%02x", hash.bytes[i]);
    return bind_row(run, err, "scene's content", "%s", run->content);
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

static enum lw_status note(struct lw_crossover_run *run, struct lw_error *err, const char *key,
                           const char *format, ...) LW_PRINTF(4, 5);
static enum lw_status note(struct lw_crossover_run *run, struct lw_error *err, const char *key,
                           const char *format, ...) {
    char value[400];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(value, sizeof value, format, arguments);
    va_end(arguments);
    return lw_crossover_store_set(&run->store, key, value, err);
}

static enum lw_status note_machine(struct lw_crossover_run *run, const char *command, struct lw_error *err) {
    char processor[200], day[32], commands[400];
    struct tm utc;
    const time_t now = time(NULL);
    read_processor(processor, sizeof processor);
    strftime(day, sizeof day, "%Y-%m-%d", gmtime_r(&now, &utc));
    snprintf(commands, sizeof commands, "%s", command);
    enum lw_status status = note(run, err, "command", "%s", commands);
    if (status == LW_OK)
        status = note(run, err, "machine", "%s; %ld processors; lightwell " LW_VERSION, processor,
                      sysconf(_SC_NPROCESSORS_ONLN));
    return status == LW_OK ? note(run, err, "day", "%s", day) : status;
}

static enum lw_status note_motion(struct lw_crossover_run *run, struct lw_error *err) {
    const struct lw_scene_motion_report *r = &run->densities.report;
    char text[300] = "";
    size_t at = 0;
    if (r->light) at += (size_t)snprintf(text + at, sizeof text - at, "light \"%.60s\" ", r->light);
    if (r->object) at += (size_t)snprintf(text + at, sizeof text - at, "object \"%.60s\" ", r->object);
    if (r->speed_m_s > 0)
        at += (size_t)snprintf(text + at, sizeof text - at, "%.3g m/s ", (double)r->speed_m_s);
    if (r->speed_deg_s > 0)
        at += (size_t)snprintf(text + at, sizeof text - at, "%.3g degrees/s ", (double)r->speed_deg_s);
    if (at) text[at - 1] = 0;
    return note(run, err, "mover", "%s", text);
}

static enum lw_status note_references(struct lw_crossover_run *run, struct lw_error *err) {
    const struct lw_crossover_references *t = &run->references;
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
    enum lw_status status = lw_crossover_store_set_late(&run->store, late, count, err);
    for (uint32_t v = 0; v < LW_CROSSOVER_VIEWS; v++)
        if (t->dark[v]) at += (size_t)snprintf(text + at, sizeof text - at, "%s%u", at ? " " : "", v);
    if (status == LW_OK) status = note(run, err, "dark views", "%s", text);
    if (status == LW_OK) status = note(run, err, "mean square", "%.6g", t->mean_square);
    if (status == LW_OK) status = note(run, err, "stops", "%.4g", (double)t->stops);
    return status == LW_OK ? note(run, err, "crop", "%u", t->side) : status;
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

static enum lw_status find_views(struct lw_crossover_run *run, struct lw_error *err) {
    struct lw_scene *scene;
    struct lw_scene_open open = run->options->scene;
    open.cancel = run->cancel;
    open.lightmap_unused = true;
    enum lw_status status = lw_scene_open(&open, &scene, err); /* as it is before anything is set moving */
    if (status != LW_OK) return status;
    status = lw_fixed_views_init(&run->views, scene, (unsigned)open.threads, err);
    lw_scene_destroy(scene);
    if (status == LW_OK) status = bind_row(run, err, "views' key", "%08x", hash_views(&run->views));
    return status == LW_OK
               ? note(run, err, "views", "%s", run->views.from_table ? "of the table" : "by the rule")
               : status;
}

static enum lw_status open_scene(struct lw_crossover_run *run, struct lw_error *err) {
    struct lw_scene_open open = run->options->scene;
    open.cancel = run->cancel;
    const double began_s = all_cpu_s();
    enum lw_status status = lw_scene_densities_init(&run->densities, &open, run->options->motion, err);
    run->build_cpu_s[0] = all_cpu_s() - began_s;
    if (status == LW_OK) status = bind_content(run, err);
    if (status == LW_OK)
        status = note(run, err, "triangles", "%llu", (unsigned long long)run->densities.triangles);
    if (status == LW_OK) status = note(run, err, "density", "%.4g", run->densities.texels_per_metre);
    return status == LW_OK ? note_motion(run, err) : status;
}

static enum lw_status make_folder(const char *folder, const char *name, struct lw_error *err) {
    char path[4096];
    snprintf(path, sizeof path, "%s/%s", folder, name);
    if (mkdir(path, 0777) < 0 && errno != EEXIST)
        return lw_status_fail(err, LW_CANNOT_CREATE, "%s: cannot make the folder: %s", path, strerror(errno));
    return LW_OK;
}

static enum lw_status prepare(struct lw_crossover_run *run, const char *command, struct lw_error *err) {
    const struct lw_crossover_options *o = run->options;
    enum lw_status status = lw_crossover_store_open(&run->store, o->folder, false, err);
    if (status == LW_OK) status = bind(run, err);
    if (status == LW_OK) status = make_folder(o->folder, "pictures", err);
    if (status == LW_OK) status = find_views(run, err);
    if (status == LW_OK) status = open_scene(run, err);
    if (status == LW_OK) status = note_machine(run, command, err); /* of a run that is not refused */
    if (status != LW_OK) return status;
    lay_out(run);
    lw_log(LW_LOG_INFO, "%s, %s: %llu triangles, twelve views %s", o->scene.path,
           lw_scene_motion_name(o->motion), (unsigned long long)run->densities.triangles,
           run->views.from_table ? "of the table" : "by the rule");
    status =
        lw_crossover_references_init(&run->references,
                                     &(struct lw_crossover_references_desc){
                                         .options = o,
                                         .scene = run->densities.scene,
                                         .content = run->content,
                                         .cameras = {.context = &run->views, .at = lw_crossover_run_camera},
                                         .folder = o->folder,
                                         .judged = run->judged,
                                         .judged_count = run->judged_count,
                                         .cancel = run->cancel},
                                     err);
    return status == LW_OK ? note_references(run, err) : status;
}

/* ---- units ---- */

static void plan_paths(const struct lw_crossover_options *o, struct lw_crossover_plan *plan,
                       uint32_t *count) {
    for (uint32_t i = 0; i < o->opponent_count; i++) {
        const bool filters = o->opponent[i] >= LW_PATH_RENDERER_SVGF;
        for (uint32_t p = 0; p < (filters ? 1 : o->paths_count) && *count < PLANS_MAX; p++) {
            struct lw_crossover_plan *next = &plan[(*count)++];
            const uint32_t paths = filters ? 1 : o->paths[p];
            *next = (struct lw_crossover_plan){.kind = o->opponent[i], .setting = {.samples = paths}};
            snprintf(next->unit.renderer, sizeof next->unit.renderer, "%s",
                     lw_path_renderer_name(o->opponent[i]));
            snprintf(next->unit.setting, sizeof next->unit.setting, "%u path%s", paths, paths > 1 ? "s" : "");
        }
    }
}

/* The samples that are tried at a density. */
static void plan_rungs(struct lw_crossover_plan *plan, uint32_t *count, uint32_t d, double density,
                       bool draws) {
    for (size_t r = 0; r < RUNGS && *count < PLANS_MAX; r++) {
        struct lw_crossover_plan *next = &plan[(*count)++];
        *next = (struct lw_crossover_plan){.is_cache = true,
                                           .unit = {.renderer = "cache"},
                                           .density = d,
                                           .rung = (uint32_t)r,
                                           .setting = {.density = density,
                                                       .draws = draws,
                                                       .direct_samples = rungs[r].direct,
                                                       .indirect_samples = rungs[r].indirect,
                                                       .rest_error = rungs[r].rest}};
        snprintf(next->unit.setting, sizeof next->unit.setting, "x%g %u+%u rest %g%s", density,
                 rungs[r].direct, rungs[r].indirect, rungs[r].rest, draws ? "" : " tiles");
    }
}

static enum lw_status plan_cache(struct lw_crossover_run *run, struct lw_crossover_plan *plan,
                                 uint32_t *count, struct lw_error *err) {
    const struct lw_crossover_options *o = run->options;
    char left_out[200] = "";
    size_t at = 0;
    for (uint32_t d = 0; d < o->density_count; d++) {
        const double density = o->density[d], texels = run->densities.texels * density * density;
        if (density > 1 && texels > TEXELS_MAX) {
            lw_log(LW_LOG_WARNING, "density x%g is not tried: %.3g million texels", density, 1e-6 * texels);
            at += (size_t)snprintf(left_out + at, sizeof left_out - at, "%sx%g (%.3g million texels)",
                                   at ? "; " : "", density, 1e-6 * texels);
            continue;
        }
        if (o->pixels) plan_rungs(plan, count, d, density, true);
        if (o->tiles) plan_rungs(plan, count, d, density, false);
    }
    return note(run, err, "densities left out", "%s", left_out);
}

/* Mean error of a unit of repeat 0 in a measure; NAN: it is not measured. */
static double error_of(const struct lw_crossover_run *run, const struct lw_crossover_unit *unit,
                       enum lw_crossover_coin coin) {
    double sum = 0;
    uint32_t count = 0;
    for (size_t i = 0; i < run->store.sample_count; i++) {
        const struct lw_crossover_sample *s = &run->store.sample[i];
        if (s->unit.repeat || strcmp(s->unit.renderer, unit->renderer) != 0 ||
            strcmp(s->unit.setting, unit->setting) != 0 || isnan(s->coin[coin]))
            continue;
        sum += s->coin[coin];
        count++;
    }
    return count ? sum / count : (double)NAN;
}

/* Whether more samples have gained nothing at a density below: at a denser one they cost four times as much.
 * By repeat 0 alone, so that all repeats, and a run that goes on, leave out the same. */
static bool cannot_help(const struct lw_crossover_run *run, const struct lw_crossover_plan *plan,
                        uint32_t count, const struct lw_crossover_plan *next) {
    for (uint32_t i = 0; next->is_cache && i + next->rung < count && next->rung; i++) {
        const struct lw_crossover_plan *few = &plan[i], *more = &plan[i + next->rung];
        if (!few->is_cache || few->density >= next->density || few->rung || more->rung != next->rung ||
            few->setting.draws != next->setting.draws)
            continue;
        const bool gains = !(error_of(run, &more->unit, LW_CROSSOVER_COIN_RELMSE) >
                             GAIN_MIN * error_of(run, &few->unit, LW_CROSSOVER_COIN_RELMSE)) ||
                           !(error_of(run, &more->unit, LW_CROSSOVER_COIN_FLIP) >
                             GAIN_MIN * error_of(run, &few->unit, LW_CROSSOVER_COIN_FLIP));
        if (!gains) return true;
    }
    return false;
}

/* A disk that takes no more and a user who asks to stop end the run; a renderer that fails does not. */
static bool ends_run(const struct lw_crossover_run *run, enum lw_status status) {
    return *run->cancel || status == LW_IO || status == LW_CANNOT_CREATE;
}

static enum lw_status measure_unit(struct lw_crossover_run *run, const struct lw_crossover_plan *plan,
                                   struct lw_error *first_failure, struct lw_error *err) {
    struct lw_error own = {0};
    if (lw_crossover_store_has(&run->store, &plan->unit)) return LW_OK;
    if (lw_clock_ns() >= run->end_ns) {
        run->units_missing++;
        return LW_OK;
    }
    enum lw_status status = lw_crossover_unit_measure(run, plan, &own);
    if (status == LW_OK) return lw_crossover_store_fail(&run->store, &plan->unit, NULL, err);
    run->units_missing++;
    if (ends_run(run, status)) {
        *err = own;
        return status;
    }
    lw_log(LW_LOG_WARNING, "repeat %u, %s, %s: not measured: %s", plan->unit.repeat + 1, plan->unit.renderer,
           plan->unit.setting, own.text);
    status = lw_crossover_store_fail(&run->store, &plan->unit, own.text, err);
    if (first_failure->status == LW_OK) *first_failure = own;
    return status;
}

/* Once for all repeats. */
static enum lw_status leave_out(struct lw_crossover_run *run, const struct lw_crossover_plan *plan,
                                struct lw_error *err) {
    const char *before = lw_crossover_store_get(&run->store, "samples left out");
    if (before && lw_crossover_store_lists(before, plan->unit.setting)) return LW_OK;
    lw_log(LW_LOG_INFO, "cache, %s: left out: such samples gained under %.0f %% at a lower density",
           plan->unit.setting, 100 * (1 - GAIN_MIN));
    return note(run, err, "samples left out", "%s%s%s", before ? before : "", before && *before ? "; " : "",
                plan->unit.setting);
}

static enum lw_status measure_units(struct lw_crossover_run *run, struct lw_error *err) {
    struct lw_crossover_plan plan[PLANS_MAX];
    struct lw_error first_failure = {0};
    uint32_t count = 0;
    plan_paths(run->options, plan, &count);
    enum lw_status status = plan_cache(run, plan, &count, err);
    for (uint32_t repeat = 0; status == LW_OK && repeat < run->options->repeats; repeat++)
        for (uint32_t i = 0; status == LW_OK && i < count; i++) {
            /* to and fro, so that no renderer comes always first after a pause */
            struct lw_crossover_plan next = plan[repeat % 2 ? count - 1 - i : i];
            if (cannot_help(run, plan, count, &next)) {
                status = leave_out(run, &next, err);
                continue;
            }
            next.unit.repeat = repeat;
            status = measure_unit(run, &next, &first_failure, err);
        }
    if (status != LW_OK) return status;
    if (first_failure.status != LW_OK) {
        *err = first_failure;
        return first_failure.status;
    }
    if (run->units_missing)
        return lw_status_fail(err, LW_TIMED_OUT,
                              "time is up: %u measurements are missing; the same command goes on with them",
                              run->units_missing);
    return LW_OK;
}

enum lw_status lw_crossover_run(struct lw_crossover_run *run, const struct lw_crossover_options *options,
                                const char *command, const volatile sig_atomic_t *cancel,
                                struct lw_error *err) {
    *run = (struct lw_crossover_run){.options = options,
                                     .cancel = cancel,
                                     .store = {.samples_file = -1, .costs_file = -1},
                                     .end_ns = UINT64_MAX};
    if (isfinite(options->minutes_max)) run->end_ns = lw_clock_ns() + (uint64_t)(60e9 * options->minutes_max);
    enum lw_status status = prepare(run, command, err);
    return status == LW_OK ? measure_units(run, err) : status;
}

void lw_crossover_run_finish(struct lw_crossover_run *run) {
    lw_crossover_references_finish(&run->references);
    lw_scene_densities_finish(&run->densities);
    lw_crossover_store_finish(&run->store);
}
