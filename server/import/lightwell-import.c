/* lightwell-import: turns a scene file into a scene package (.lwscene), with lightmap UVs.
 * Flow:    a file in one of LW_SCENE_FORMAT_MAP, or builtin:NAME -> scene -> lightmap UVs -> package */
#include "common/base/atomic_file.h"
#include "common/base/clock.h"
#include "common/base/log.h"
#include "common/base/options.h"
#include "common/base/progress.h"
#include "common/builtin/builtin.h"
#include "common/lightmap/lightmap.h"
#include "common/open/import_spawn.h"
#include "common/scene/package.h"
#include "server/import/cage.h"
#include "server/import/far_out.h"
#include "server/import/finish_report.h"
#include "server/import/foreign/foreign.h"
#include "server/import/gltf/gltf.h"
#include "server/import/guard.h"
#include "server/import/images/environment_file.h"
#include "server/import/images/image_file.h"
#include "server/import/new_root.h"
#include "server/import/scene_format.h"

#include <errno.h>
#include <fcntl.h>
#include <jansson.h>
#include <limits.h>
#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <unistd.h>

#define PROGRAM      "lightwell-import"
#define TICK_MS      100
#define THREADS_MAX  1024
#define NAME_COLUMNS 28
#define TABLE_ROWS   40 /* rows that a terminal gets unasked */
#define SCALE_MIN    1e-6
#define SCALE_MAX    1e6

struct arguments {
    const char *scene;
    const char *output;
    const char *environment;
    const char *density_of;
    double texels_per_metre;
    double scale, read_seconds, import_seconds;
    int sides;     /* enum lw_foreign_sides */
    int materials; /* enum lw_import_spawn_materials */
    int log_format, log_level;
    int64_t picture_texels, texels_max, atlas_side_max, threads, failure_fd;
    bool json, report, lightmap_unused;
};

/* ---- progress of stages that cannot say how far they are ---- */

struct stage {
    struct lw_progress progress;
    pthread_mutex_t mutex;
    pthread_cond_t changed;
    bool ended, running;
    pthread_t thread;
};

static void *tick(void *context) {
    struct stage *stage = context;
    pthread_mutex_lock(&stage->mutex);
    while (!stage->ended) {
        struct timespec until;
        clock_gettime(CLOCK_REALTIME, &until);
        until.tv_nsec += TICK_MS * 1000000;
        until.tv_sec += until.tv_nsec / 1000000000;
        until.tv_nsec %= 1000000000;
        pthread_cond_timedwait(&stage->changed, &stage->mutex, &until);
        if (!stage->ended) lw_progress_step(&stage->progress, 0);
    }
    pthread_mutex_unlock(&stage->mutex);
    return NULL;
}

static void stage_begin(struct stage *stage, const char *name) {
    *stage = (struct stage){.mutex = PTHREAD_MUTEX_INITIALIZER, .changed = PTHREAD_COND_INITIALIZER};
    lw_progress_init(&stage->progress, name, 0);
    stage->running = pthread_create(&stage->thread, NULL, tick, stage) == 0; /* without: silent, not wrong */
}

static void stage_end(struct stage *stage) {
    pthread_mutex_lock(&stage->mutex);
    stage->ended = true;
    pthread_cond_signal(&stage->changed);
    pthread_mutex_unlock(&stage->mutex);
    if (stage->running) pthread_join(stage->thread, NULL);
    lw_progress_finish(&stage->progress);
}

/* ---- command line ---- */

_Static_assert(LW_IMAGE_FILE_TEXELS == 268435456u, "LW_IMPORT_SPAWN_PICTURES_HELP says it in digits");

static enum lw_status parse(int argc, char **argv, struct arguments *arguments, bool *out_done,
                            struct lw_error *err) {
    const struct lw_option table[] = {
        {.name = "o",
         .argument = "FILE",
         .help = "where to write the scene package (required)",
         .kind = LW_OPTION_STRING,
         .value = &arguments->output},
        {.name = "texels-per-metre",
         .argument = "D",
         .help = LW_LIGHTMAP_DENSITY_HELP,
         .kind = LW_OPTION_REAL,
         .value = &arguments->texels_per_metre,
         .min = LW_LIGHTMAP_DENSITY_MIN,
         .max = LW_LIGHTMAP_DENSITY_MAX},
        {.name = "density-of",
         .argument = "NAME=FACTOR,...",
         .help = LW_LIGHTMAP_DENSITY_OF_HELP,
         .kind = LW_OPTION_STRING,
         .value = &arguments->density_of},
        {.name = "max-texels",
         .argument = "N",
         .help = LW_LIGHTMAP_TEXELS_HELP,
         .kind = LW_OPTION_INT,
         .value = &arguments->texels_max,
         .min = 1,
         .max = LW_SCENE_TEXELS_MAX},
        {.name = "atlas-max",
         .argument = "N",
         .help = "largest side of a lightmap in texels; an object that needs more gets fewer per metre. "
                 "Default: " LW_LIGHTMAP_NUMBER(LW_LIGHTMAP_SIDE_DEFAULT) ".",
         .kind = LW_OPTION_INT,
         .value = &arguments->atlas_side_max,
         .min = LW_LIGHTMAP_SIDE_MIN,
         .max = LW_SCENE_ATLAS_SIDE_MAX},
        {.name = "scale",
         .argument = "S",
         .help =
             "scale all lengths by S, after the file's own unit: 0.01 for an OBJ in centimetres (default {})",
         .kind = LW_OPTION_REAL,
         .value = &arguments->scale,
         .min = SCALE_MIN,
         .max = SCALE_MAX},
        {.name = "sides",
         .argument = "auto|one|two",
         .help = "sides of surfaces in OBJ, PLY, FBX, Collada and STL, which mostly do not say. auto: one "
                 "side where a surface is closed or emits, else two{auto}",
         .kind = LW_OPTION_CHOICE,
         .value = &arguments->sides},
        {.name = "read-seconds",
         .argument = "S",
         .help = "processor time that the reader of OBJ, PLY, FBX, Collada and STL may take before it is "
                 "stopped (default: 20 and 10 per MiB of the file)",
         .kind = LW_OPTION_REAL,
         .value = &arguments->read_seconds,
         .min = 1,
         .max = 1e6},
        {.name = "picture-texels",
         .argument = "N",
         .help = LW_IMPORT_SPAWN_PICTURES_HELP,
         .kind = LW_OPTION_INT,
         .value = &arguments->picture_texels,
         .min = 1,
         .max = LW_IMAGE_FILE_TEXELS_MAX},
        {.name = "materials",
         .argument = LW_IMPORT_SPAWN_MATERIALS,
         .help = LW_IMPORT_SPAWN_MATERIALS_HELP,
         .kind = LW_OPTION_CHOICE,
         .value = &arguments->materials},
        {.name = "import-seconds",
         .argument = "S",
         .help = LW_IMPORT_SPAWN_SECONDS_HELP,
         .kind = LW_OPTION_REAL,
         .value = &arguments->import_seconds,
         .min = 1,
         .max = LW_IMPORT_SPAWN_SECONDS_MAX},
        {.name = "environment",
         .argument = "FILE.exr",
         .help = "equirectangular radiance around the scene, W/(m^2 sr): row 0 is up, the middle +X",
         .kind = LW_OPTION_STRING,
         .value = &arguments->environment},
        {.name = "threads",
         .argument = "N",
         .help = "threads to use (default: {}, all)",
         .kind = LW_OPTION_INT,
         .value = &arguments->threads,
         .min = 0,
         .max = THREADS_MAX},
        {.name = "report",
         .help = "show the table of lightmaps on stderr even where that is no terminal",
         .kind = LW_OPTION_FLAG,
         .value = &arguments->report},
        {.name = "json",
         .help = "write the report to stdout as JSON",
         .kind = LW_OPTION_FLAG,
         .value = &arguments->json},
        /* For programs that start this one: they do not look at the lightmaps, and want no warning about
         * them. */
        {.name = "lightmap-unused", .kind = LW_OPTION_FLAG, .value = &arguments->lightmap_unused},
        /* For programs that start this one: the reason of a failure goes to this descriptor, not to stderr,
         * and it ends when they end. */
        {.name = "failure-fd",
         .argument = "N",
         .kind = LW_OPTION_INT,
         .value = &arguments->failure_fd,
         .min = 3,
         .max = 1 << 20},
        /* The same: what they chose for their own lines. */
        {.name = "log-format",
         .argument = LW_LOG_FORMATS,
         .kind = LW_OPTION_CHOICE,
         .value = &arguments->log_format},
        {.name = "log-level",
         .argument = LW_LOG_LEVELS,
         .kind = LW_OPTION_CHOICE,
         .value = &arguments->log_level},
    };
    const struct lw_options options = {
        .program = PROGRAM,
        .synopsis = "SCENE -o FILE.lwscene [OPTIONS]",
        .about =
            "Turns a scene into a self-contained scene package with lightmap coordinates, which lightwelld "
            "lights. SCENE is glTF 2.0, OBJ, PLY, FBX, Collada or STL (" LW_SCENE_FORMAT_ENDINGS
            "), or builtin:cornell, builtin:ajar, builtin:atrium[-matt], builtin:city[:BLOCKS]. "
            "What is kept of each: docs/importing.md.\n"
            "Example: lightwell-import court.glb -o court.lwscene",
        .table = table,
        .count = sizeof table / sizeof *table,
        .positional = &arguments->scene,
        .positional_min = 1,
        .positional_max = 1,
    };
    if (lw_options_parse(&options, argc, argv, NULL, out_done, err) || *out_done) return err->status;
    if (!arguments->output)
        return lw_status_fail(err, LW_USAGE, "-o FILE is missing: say where to write the scene package");
    return LW_OK;
}

/* ---- stages ---- */

/* Libraries decode its streams and pictures: should one crash, the process still ends with a line. */
static enum lw_status read_gltf(const struct arguments *arguments, struct lw_scene **out_scene,
                                struct lw_error *err) {
    const struct lw_guard_desc guard = {.scene = arguments->scene,
                                        .reader = "a decoder of its meshes or pictures",
                                        .failure_fd = (int)arguments->failure_fd};
    lw_guard_enter(&guard);
    enum lw_status status =
        lw_gltf_load(arguments->scene,
                     &(struct lw_gltf_options){.picture_texels = (uint64_t)arguments->picture_texels,
                                               .matt = arguments->materials == LW_IMPORT_SPAWN_MATT},
                     out_scene, err);
    lw_guard_leave();
    return status;
}

static enum lw_status read_file(const struct arguments *arguments, struct lw_scene **out_scene,
                                struct lw_error *err) {
    struct lw_foreign_desc foreign = {.path = arguments->scene,
                                      .sides = (enum lw_foreign_sides)arguments->sides,
                                      .read_seconds = arguments->read_seconds,
                                      .picture_texels = (uint64_t)arguments->picture_texels,
                                      .matt = arguments->materials == LW_IMPORT_SPAWN_MATT,
                                      .failure_fd = (int)arguments->failure_fd};
    enum lw_status status = lw_scene_format_of(arguments->scene, &foreign.format, err);
    if (status) return status;
    return foreign.format == LW_SCENE_FORMAT_GLTF ? read_gltf(arguments, out_scene, err)
                                                  : lw_foreign_load(&foreign, out_scene, err);
}

static bool is_builtin(const struct arguments *arguments) {
    return strncmp(arguments->scene, LW_BUILTIN_PREFIX, strlen(LW_BUILTIN_PREFIX)) == 0;
}

static enum lw_status read_scene(const struct arguments *arguments, struct lw_scene **out_scene,
                                 struct lw_error *err) {
    struct stage stage;
    struct lw_scene *scene;
    bool builtin = is_builtin(arguments);
    stage_begin(&stage, builtin ? "building the scene" : "reading the scene");
    enum lw_status status = builtin ? lw_builtin_build(arguments->scene, &scene, err)
                            : lw_package_is(arguments->scene) ? lw_package_load(arguments->scene, &scene, err)
                                                              : read_file(arguments, &scene, err);
    stage_end(&stage);
    if (status) return status;
    if (arguments->materials == LW_IMPORT_SPAWN_MATT) lw_scene_drop_finishes(scene); /* a package's, too */
    float s = (float)arguments->scale;
    const struct lw_affine place = {{{s, 0, 0, 0}, {0, s, 0, 0}, {0, 0, s, 0}}};
    for (uint32_t i = 0; i < scene->camera_count; i++) scene->camera[i].height_m *= s;
    if (s != 1 && lw_new_root_add(scene, "scale", &place, err)) {
        lw_status_context(err, "%s", arguments->scene);
        lw_scene_destroy(scene);
        return err->status;
    }
    /* before lightmaps are laid out for it, which may take an hour */
    if (!builtin && lw_package_check_size(scene, err)) {
        lw_status_context(err, "%s", arguments->scene);
        lw_scene_destroy(scene);
        return err->status;
    }
    if (arguments->environment && lw_environment_file_load(scene, arguments->environment, err)) {
        lw_scene_destroy(scene);
        return err->status;
    }
    *out_scene = scene;
    return LW_OK;
}

/* A package that is read to be written again, with an environment, has its lightmaps. */
static enum lw_status keep_lightmaps(const struct lw_scene *scene, struct lw_lightmap_report *report) {
    for (uint32_t i = 0; i < scene->mesh_count; i++)
        report[i] = (struct lw_lightmap_report){.mesh = i,
                                                .atlas_width = scene->mesh[i].atlas_width,
                                                .atlas_height = scene->mesh[i].atlas_height,
                                                .from_file = true};
    return LW_OK;
}

static enum lw_status build_lightmaps(const struct arguments *arguments, struct lw_scene *scene,
                                      struct lw_lightmap_report *report, struct lw_error *err) {
    const struct lw_lightmap_desc desc = {.texels_per_metre = (float)arguments->texels_per_metre,
                                          .density_of = arguments->density_of,
                                          .texels_max = (uint32_t)arguments->texels_max,
                                          .atlas_side_max = (uint32_t)arguments->atlas_side_max,
                                          .threads = (unsigned)arguments->threads};
    if (lw_package_is(arguments->scene)) return keep_lightmaps(scene, report);
    enum lw_status status = lw_lightmap_build(scene, &desc, report, err);
    if (status) lw_status_context(err, "%s", arguments->scene);
    return status;
}

/* A handler reaches nothing but globals. */
static volatile sig_atomic_t stopped_by; /* the signal; 0: none */

static void stop(int number) { stopped_by = number; }

/* A signal ends the program, as ever, but not before it has removed a half-written file. */
static enum lw_status write_package(const struct arguments *arguments, const struct lw_scene *scene,
                                    struct lw_error *err) {
    static const int signals[] = {SIGINT, SIGTERM, SIGHUP};
    for (size_t i = 0; i < sizeof signals / sizeof *signals; i++) {
        struct sigaction before;
        sigaction(signals[i], NULL, &before);
        if (before.sa_handler == SIG_DFL) /* nohup, for one, has it ignored */
            sigaction(signals[i], &(struct sigaction){.sa_handler = stop}, NULL);
    }
    struct stage stage;
    stage_begin(&stage, "writing the package");
    enum lw_status status = lw_package_save_stoppable(scene, arguments->output, &stopped_by, err);
    stage_end(&stage);
    for (size_t i = 0; i < sizeof signals / sizeof *signals; i++) {
        struct sigaction before;
        sigaction(signals[i], NULL, &before);
        if (before.sa_handler == stop) signal(signals[i], SIG_DFL);
    }
    if (stopped_by) raise(stopped_by);
    return status;
}

/* One mistyped name must not cost a scene: an input is not written over. A package may be: that is how an
 * old one gets a checksum. */
static enum lw_status check_output(const struct arguments *arguments, struct lw_error *err) {
    const char *const inputs[] = {arguments->scene, arguments->environment};
    struct stat output, input;
    if (stat(arguments->output, &output) != 0 || !S_ISREG(output.st_mode)) return LW_OK;
    for (size_t i = 0; i < sizeof inputs / sizeof *inputs; i++)
        if (inputs[i] && stat(inputs[i], &input) == 0 && input.st_dev == output.st_dev &&
            input.st_ino == output.st_ino && !lw_package_is(inputs[i]))
            return lw_status_fail(err, LW_USAGE,
                                  "-o %s would write over %s, which is read; name another file",
                                  arguments->output, i ? "the environment" : "the scene");
    return LW_OK;
}

/* ---- report ---- */

struct totals {
    uint64_t triangles, texels, texels_covered;
    double area;     /* m^2 */
    double coverage; /* mean over the objects' atlases, weighted by area */
    double stretch;  /* rms, weighted likewise */
};

static double mesh_area(const struct lw_mesh *mesh) {
    double area = 0;
    for (uint32_t t = 0; t < mesh->triangle_count; t++) {
        struct lw_vec3 a = mesh->position[mesh->triangle[t][0]];
        struct lw_vec3 ab = lw_vec3_sub(mesh->position[mesh->triangle[t][1]], a);
        struct lw_vec3 ac = lw_vec3_sub(mesh->position[mesh->triangle[t][2]], a);
        area += 0.5 * (double)lw_vec3_length(lw_vec3_cross(ab, ac));
    }
    return area;
}

/* Areas are those of the meshes: nodes may scale them. */
static enum lw_status sum_up(const struct lw_scene *scene, const struct lw_lightmap_report *report,
                             struct totals *out, struct lw_error *err) {
    *out = (struct totals){0};
    double squares = 0;
    uint32_t *uses =
        calloc(scene->mesh_count + 1ul, sizeof *uses); /* a mesh of many instances is measured once */
    if (!uses) return lw_status_fail(err, LW_NO_MEMORY, "out of memory for the report");
    for (uint32_t i = 0; i < scene->object_count; i++) uses[scene->object[i].mesh]++;
    for (uint32_t m = 0; m < scene->mesh_count; m++) {
        const struct lw_mesh *mesh = &scene->mesh[m];
        const struct lw_lightmap_report *r = &report[m];
        double area = uses[m] ? uses[m] * mesh_area(mesh) : 0;
        out->triangles += (uint64_t)uses[m] * mesh->triangle_count;
        out->texels += (uint64_t)uses[m] * r->atlas_width * r->atlas_height;
        out->texels_covered += (uint64_t)uses[m] * r->texels_covered;
        out->area += area;
        out->coverage += area * (double)r->coverage;
        squares += area * (double)r->stretch_rms * (double)r->stretch_rms;
    }
    free(uses);
    if (out->area > 0) {
        out->coverage /= out->area;
        out->stretch = sqrt(squares / out->area);
    }
    return LW_OK;
}

/* rows  how many objects to show at most */
static void print_table(const struct lw_scene *scene, const struct lw_lightmap_report *report,
                        const struct totals *totals, uint32_t rows) {
    fprintf(stderr, "%-*s %10s %11s %8s %8s %8s %8s  %s\n", NAME_COLUMNS, "object", "triangles", "atlas",
            "covered", "coverage", "stretch", "texels/m", "charts");
    for (uint32_t i = 0; i < scene->object_count && i < rows; i++) {
        const struct lw_lightmap_report *r = &report[scene->object[i].mesh];
        char name[NAME_COLUMNS + 1], atlas[32];
        snprintf(name, sizeof name, "%s", scene->object[i].name);
        for (char *c = name; *c; c++)
            if ((unsigned char)*c < 0x20 || *c == 0x7f) *c = '?';
        snprintf(atlas, sizeof atlas, "%ux%u", r->atlas_width, r->atlas_height);
        fprintf(stderr, "%-*s %10u %11s %8u %8.2f %8.2f %8.2f  %u%s%s\n", NAME_COLUMNS, name,
                scene->mesh[scene->object[i].mesh].triangle_count, atlas, r->texels_covered,
                (double)r->coverage, (double)r->stretch_rms, (double)r->texels_per_metre, r->chart_count,
                r->from_file ? ", from the file" : "", r->capped ? ", capped by --atlas-max" : "");
    }
    if (scene->object_count > rows)
        fprintf(stderr, "... and %u more; --report shows all\n", scene->object_count - rows);
    fprintf(stderr,
            "%u objects, %llu triangles, %llu texels, %llu covered; by area: coverage %.2f, stretch %.2f\n",
            scene->object_count, (unsigned long long)totals->triangles, (unsigned long long)totals->texels,
            (unsigned long long)totals->texels_covered, totals->coverage, totals->stretch);
}

static json_t *object_json(const struct lw_scene *scene, uint32_t object,
                           const struct lw_lightmap_report *report) {
    const struct lw_lightmap_report *r = &report[scene->object[object].mesh];
    return json_pack("{s:s, s:I, s:I, s:[I,I], s:I, s:I, s:f, s:f, s:f, s:f, s:b, s:b}", "name",
                     scene->object[object].name, "mesh", (json_int_t)scene->object[object].mesh, "triangles",
                     (json_int_t)scene->mesh[scene->object[object].mesh].triangle_count, "atlas",
                     (json_int_t)r->atlas_width, (json_int_t)r->atlas_height, "charts",
                     (json_int_t)r->chart_count, "texels_covered", (json_int_t)r->texels_covered, "coverage",
                     (double)r->coverage, "stretch_rms", (double)r->stretch_rms, "stretch_max",
                     (double)r->stretch_max, "texels_per_metre", (double)r->texels_per_metre, "from_file",
                     (int)r->from_file, "capped", (int)r->capped);
}

/* A path as JSON can hold it: file names may be any bytes, JSON is UTF-8. */
static json_t *path_json(const char *path) {
    json_t *text = json_string(path);
    char *copy = text ? NULL : strdup(path);
    if (!copy) return text;
    for (char *c = copy; *c; c++)
        if (*c & 0x80) *c = '?';
    text = json_string(copy);
    free(copy);
    return text;
}

static json_t *finishes_json(const struct lw_scene *scene) {
    struct lw_finish_report r;
    lw_finish_report_measure(scene, &r);
    return json_pack("{s:I, s:I, s:I, s:I, s:I, s:I, s:I, s:I}", "materials", (json_int_t)r.materials,
                     "normal_maps", (json_int_t)r.normal_maps, "normal_texels", (json_int_t)r.normal_texels,
                     "other_textures", (json_int_t)r.other_maps, "other_texels", (json_int_t)r.other_texels,
                     "tangents", (json_int_t)r.tangents, "normal_bytes", (json_int_t)r.normal_bytes,
                     "other_bytes", (json_int_t)r.other_bytes);
}

static enum lw_status print_json(const struct arguments *arguments, const struct lw_scene *scene,
                                 const struct lw_lightmap_report *report, const struct totals *totals,
                                 double seconds, struct lw_error *err) {
    json_t *objects = json_array();
    for (uint32_t i = 0; objects && i < scene->object_count; i++)
        json_array_append_new(objects, object_json(scene, i, report));
    struct stat package = {0};
    if (stat(arguments->output, &package) < 0) package.st_size = 0;
    json_t *root = json_pack(
        "{s:o, s:o, s:I, s:f, s:I, s:I, s:I, s:I, s:I, s:I, s:I, s:f, s:f, s:f, s:o, s:o}", "scene",
        path_json(arguments->scene), "package", path_json(arguments->output), "package_bytes",
        (json_int_t)package.st_size, "seconds", seconds, "triangles", (json_int_t)totals->triangles,
        "materials", (json_int_t)scene->material_count, "textures", (json_int_t)scene->texture_count,
        "lights", (json_int_t)scene->light_count, "cameras", (json_int_t)scene->camera_count, "texels",
        (json_int_t)totals->texels, "texels_covered", (json_int_t)totals->texels_covered, "coverage",
        totals->coverage, "stretch", totals->stretch, "duration_s", (double)scene->duration_s, "finishes",
        finishes_json(scene), "objects", objects);
    int failed = !root ? -1 : json_dumpf(root, stdout, JSON_INDENT(2) | JSON_REAL_PRECISION(6));
    json_decref(root);
    if (!failed) failed = printf("\n") < 0 || fflush(stdout) != 0;
    if (failed) return lw_status_fail(err, root ? LW_IO : LW_NO_MEMORY, "cannot write the report to stdout");
    return LW_OK;
}

static enum lw_status report_on(const struct arguments *arguments, const struct lw_scene *scene,
                                const struct lw_lightmap_report *report, double seconds,
                                struct lw_error *err) {
    struct totals totals;
    struct lw_finish_report finishes;
    if (sum_up(scene, report, &totals, err)) return err->status;
    lw_finish_report_measure(scene, &finishes);
    lw_finish_report_log(&finishes, arguments->scene);
    if (arguments->report)
        print_table(scene, report, &totals, UINT32_MAX);
    else if (!arguments->json && lw_log_is_drawn())
        print_table(scene, report, &totals, TABLE_ROWS);
    return arguments->json ? print_json(arguments, scene, report, &totals, seconds, err) : LW_OK;
}

/* ---- the program ---- */

/* One line for all, by the largest texels. */
static void warn_of_bound(const struct arguments *arguments, const struct lw_scene *scene,
                          const struct lw_lightmap_report *report) {
    uint32_t count = 0, coarsest = 0;
    for (uint32_t o = 0; o < scene->object_count; o++) {
        const struct lw_lightmap_report *r = &report[scene->object[o].mesh];
        if (!r->bounded) continue;
        if (!count++ || r->texels_per_metre < report[scene->object[coarsest].mesh].texels_per_metre)
            coarsest = o;
    }
    if (!count) return;
    const struct lw_lightmap_report *r = &report[scene->object[coarsest].mesh];
    lw_log(LW_LOG_WARNING,
           "%s: %.2g m texels (object \"%s\", the coarsest of %u): %.3g texels a metre were wanted, and %u "
           "texels in all are the most; set --max-texels or --texels-per-metre",
           arguments->scene, 1 / (double)r->texels_per_metre, scene->object[coarsest].name, count,
           (double)r->density_wanted, r->texels_max);
}

#ifdef LW_IMPORT_PROBE
void lw_import_probe(const char *scene, bool caged); /* tests/support/import_probe.c: tries to break out */
#define PROBE(arguments, caged) lw_import_probe((arguments)->scene, caged)
#else
#define PROBE(arguments, caged) (void)0
#endif

/* What killed importers left goes while the folder can still be searched. */
static void enter_cage(const struct arguments *arguments) {
    char target[PATH_MAX];
    if (!realpath(arguments->output, target)) snprintf(target, sizeof target, "%s", arguments->output);
    lw_atomic_file_sweep(target);
    PROBE(arguments, false);
    const unsigned missing =
        lw_cage_enter(&(struct lw_cage_desc){.scene = is_builtin(arguments) ? NULL : arguments->scene,
                                             .scene_alone = lw_package_is(arguments->scene),
                                             .environment = arguments->environment,
                                             .output = arguments->output,
                                             .kept = {(int)arguments->failure_fd, lw_guard_prepare()},
                                             .owner = arguments->failure_fd != 0,
                                             .memory_bytes = LW_IMPORT_SPAWN_MEMORY_MAX,
                                             .file_bytes = LW_PACKAGE_SIZE_MAX});
    static const char *const lacks[] = {
        [LW_CAGE_FILES] = "no Landlock: code that a broken scene smuggles in could reach other files",
        [LW_CAGE_CALLS] = "no seccomp: code that a broken scene smuggles in could reach the network",
        [LW_CAGE_FILES | LW_CAGE_CALLS] =
            "neither Landlock nor seccomp: code that a broken scene smuggles in could do what its user may"};
    if (missing) lw_log(LW_LOG_WARNING, "this system has %s", lacks[missing]);
    PROBE(arguments, true);
}

static enum lw_status run(const struct arguments *arguments, struct lw_error *err) {
    uint64_t started_ns = lw_clock_ns();
    struct lw_scene *scene = NULL;
    struct lw_lightmap_report *report = NULL;
    enum lw_status status = check_output(arguments, err);
    if (!status) enter_cage(arguments);
    if (!status)
        lw_guard_bound(&(struct lw_guard_desc){.scene = arguments->scene,
                                               .failure_fd = (int)arguments->failure_fd,
                                               .processor_s = arguments->import_seconds});
    if (!status) status = read_scene(arguments, &scene, err);
    if (status) return status;
    if (!lw_scene_has_light(scene))
        lw_log(LW_LOG_WARNING,
               "%s: has no light of its own: without --sky R,G,B or --environment FILE.exr it stays black",
               arguments->scene);
    report = calloc(scene->mesh_count + 1ul, sizeof *report);
    if (!report) status = lw_status_fail(err, LW_NO_MEMORY, "%s: out of memory", arguments->scene);
    if (!status) status = build_lightmaps(arguments, scene, report, err);
    if (!status && !arguments->lightmap_unused) warn_of_bound(arguments, scene, report);
    if (!status) status = lw_far_out_warn(scene, report, arguments->scene, err);
    if (!status) status = write_package(arguments, scene, err);
    if (!status)
        status = report_on(arguments, scene, report, (double)(lw_clock_ns() - started_ns) * 1e-9, err);
    free(report);
    lw_scene_destroy(scene);
    return status;
}

/* Hands the failure to the program that started us, which reports it once. */
static int hand_over(const struct lw_error *err, int failure_fd) {
    size_t size = strlen(err->text), done = 0;
    while (done < size) {
        ssize_t wrote = write(failure_fd, err->text + done, size - done);
        if (wrote < 0 && errno == EINTR) continue;
        if (wrote <= 0) return lw_log_failure(err); /* nobody listens */
        done += (size_t)wrote;
    }
    return lw_status_exit_code(err->status);
}

/* Ties our life to that of the program that started us. It may have ended before. Then there is no reader for
 * the report. */
static enum lw_status follow_starter(int failure_fd, struct lw_error *err) {
    signal(SIGPIPE, SIG_IGN);
    prctl(PR_SET_PDEATHSIG, SIGTERM);
    struct pollfd end = {.fd = failure_fd};
    if (poll(&end, 1, 0) == 1 && end.revents & POLLERR)
        return lw_status_fail(err, LW_CLOSED, "the program that started this one has ended");
    return LW_OK;
}

int main(int argc, char **argv) {
    struct lw_error err = {0};
    struct arguments arguments = {.scale = 1,
                                  .import_seconds = LW_IMPORT_SPAWN_SECONDS,
                                  .log_format = LW_LOG_TEXT,
                                  .log_level = LW_LOG_INFO};
    bool done = false;
    lw_log_init(PROGRAM, LW_LOG_INFO);
    enum lw_status status = parse(argc, argv, &arguments, &done, &err);
    lw_log_init(PROGRAM, (enum lw_log_level)arguments.log_level);
    lw_log_set_format((enum lw_log_format)arguments.log_format);
    if (status == LW_OK && arguments.failure_fd) status = follow_starter((int)arguments.failure_fd, &err);
    if (status == LW_OK && !done) status = run(&arguments, &err);
    if (status == LW_OK) return 0;
    return arguments.failure_fd ? hand_over(&err, (int)arguments.failure_fd) : lw_log_failure(&err);
}
