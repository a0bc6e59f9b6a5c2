#include "tests/bench/bench_setup.h"

#include "common/base/log.h"
#include "common/scene/scene_motion.h"

#include <assert.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#define OPTIONS_MAX 32u
#define SCENES_MAX  64u

int bench_main(const struct bench_program *program, int argc, char **argv) {
    struct lw_scene_open none = {0}, *open = program->open ? program->open : &none;
    const struct lw_option shared[] = {LW_SCENE_OPEN_OPTIONS(open)};
    const size_t shared_count = program->open ? sizeof shared / sizeof shared[0] : 0;
    struct lw_option table[OPTIONS_MAX];
    const char *scene[SCENES_MAX];
    char synopsis[64];
    size_t count = 0;
    bool done = false;
    assert(program->count + shared_count <= OPTIONS_MAX);
    if (program->count) memcpy(table, program->table, program->count * sizeof *table);
    memcpy(table + program->count, shared, shared_count * sizeof *table);
    snprintf(synopsis, sizeof synopsis, "[OPTIONS] %s%s", program->operand ? program->operand : "SCENE",
             program->runs_once ? "" : "...");
    const struct lw_options options = {.program = program->name,
                                       .synopsis = synopsis,
                                       .about = program->about,
                                       .table = table,
                                       .count = program->count + shared_count,
                                       .positional = scene,
                                       .positional_min = program->runs_once ? 0 : 1,
                                       .positional_max = program->runs_once ? 1 : SCENES_MAX};
    struct lw_error err = {0};
    lw_log_init(program->name, LW_LOG_WARNING);
    if (!open->sun_angle_given) open->sun_angle_deg = LW_SCENE_OPEN_SUN_DIAMETER_DEG;
    enum lw_status status = lw_options_parse(&options, argc, argv, &count, &done, &err);
    if (status == LW_OK && done) return 0;
    if (status == LW_OK && program->folder && *program->folder) mkdir(*program->folder, 0777);
    if (status == LW_OK && program->begin) status = program->begin(program->context, &err);
    if (status == LW_OK && program->heading) puts(program->heading);
    if (status == LW_OK && program->runs_once && !count) scene[count++] = program->by_default;
    for (size_t i = 0; status == LW_OK && i < count; i++)
        status = program->run(program->context, scene[i], &err);
    return status == LW_OK ? 0 : lw_log_failure(&err);
}

const char *bench_label(const char *scene, char *buffer, size_t size) {
    const char *slash = strrchr(scene, '/'), *base = slash ? slash + 1 : scene;
    snprintf(buffer, size, "%.*s", (int)strcspn(base, "@"), base);
    return buffer;
}

enum lw_status bench_open(const struct lw_scene_open *open, const char *name, int motion, double time_s,
                          struct lw_scene **out_scene, struct lw_pose *out_pose, struct lw_atlas_map *out_map,
                          struct lw_error *err) {
    struct lw_scene_open one = *open;
    struct lw_scene_motion_report report;
    char path[4096];
    const size_t length = strcspn(name, "@");
    if (length >= sizeof path) return lw_status_fail(err, LW_USAGE, "a path that long: %s", name);
    memcpy(path, name, length);
    path[length] = '\0';
    one.path = path;
    enum lw_status status = lw_scene_open(&one, out_scene, err);
    if (status == LW_OK && motion != BENCH_MOTION_OWN)
        status = lw_scene_motion_set(*out_scene, (enum lw_scene_motion)motion, &report, err);
    if (status != LW_OK) return status;
    if (out_map) status = lw_atlas_map_init(out_map, *out_scene);
    if (status == LW_OK) status = lw_pose_init(out_pose, *out_scene);
    if (status != LW_OK) return lw_status_fail(err, status, "setting up %s", path);
    lw_pose_evaluate(out_pose, *out_scene, time_s);
    return LW_OK;
}

void bench_close(struct lw_scene *scene, struct lw_pose *pose, struct lw_atlas_map *map) {
    if (map) lw_atlas_map_finish(map);
    lw_pose_finish(pose);
    lw_scene_destroy(scene);
}

static int compare_doubles(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

double bench_median(double *value, size_t count) {
    qsort(value, count, sizeof *value, compare_doubles);
    return value[count / 2];
}
