#include "client/measure/crossover_options.h"

#include "client/measure/measure_options.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define WIDTH_MIN  64u /* two crops side by side */
#define HEIGHT_MIN 32u
#define PATHS_MAX  256u

/* Copies the next word of a list apart by commas and moves *text behind it; false: none is left. A word that
 * does not fit is cut, which makes it none that is known. */
static bool next_word(const char **text, char *out, size_t size) {
    if (!*text) return false;
    const size_t length = strcspn(*text, ",");
    snprintf(out, size, "%.*s", (int)length, *text);
    *text = (*text)[length] ? *text + length + 1 : NULL;
    return true;
}

static enum lw_status parse_opponents(const char *text, struct lw_crossover_options *o,
                                      struct lw_error *err) {
    char word[32];
    const char *at = text;
    for (o->opponent_count = 0; next_word(&at, word, sizeof word);) {
        int kind = 0;
        while (kind < LW_PATH_RENDERER_COUNT &&
               strcmp(word, lw_path_renderer_name((enum lw_path_renderer_kind)kind)) != 0)
            kind++;
        if (kind == LW_PATH_RENDERER_COUNT)
            return lw_status_fail(
                err, LW_USAGE,
                "--opponents: \"%s\" is none of raw, lights, reprojected, svgf, svgf-quarter, vpl", word);
        for (uint32_t i = 0; i < o->opponent_count; i++)
            if ((int)o->opponent[i] == kind)
                return lw_status_fail(err, LW_USAGE, "--opponents: %s is there twice", word);
        o->opponent[o->opponent_count++] = (enum lw_path_renderer_kind)kind;
    }
    return LW_OK;
}

static enum lw_status parse_paths(const char *text, struct lw_crossover_options *o, struct lw_error *err) {
    char word[32];
    const char *at = text;
    for (o->paths_count = 0; next_word(&at, word, sizeof word);) {
        char *end;
        const unsigned long paths = strtoul(word, &end, 10);
        if (*word < '1' || *word > '9' || *end || paths > PATHS_MAX ||
            o->paths_count == LW_CROSSOVER_PATHS_MAX)
            return lw_status_fail(err, LW_USAGE, "--paths: \"%s\" is no list of up to %u counts up to %u",
                                  text, LW_CROSSOVER_PATHS_MAX, PATHS_MAX);
        o->paths[o->paths_count++] = (uint32_t)paths;
    }
    return LW_OK;
}

static enum lw_status parse_densities(const char *text, struct lw_crossover_options *o,
                                      struct lw_error *err) {
    char word[32];
    const char *at = text;
    for (o->density_count = 0; next_word(&at, word, sizeof word);) {
        char *end;
        const double density = strtod(word, &end);
        if (end == word || *end ||
            !(density >= LW_MEASURE_OPTIONS_DENSITY_MIN && density <= LW_MEASURE_OPTIONS_DENSITY_MAX) ||
            o->density_count == LW_CROSSOVER_DENSITIES_MAX)
            return lw_status_fail(
                err, LW_USAGE, "--densities: \"%s\" is no list of up to %u numbers from %g to %g", text,
                LW_CROSSOVER_DENSITIES_MAX, LW_MEASURE_OPTIONS_DENSITY_MIN, LW_MEASURE_OPTIONS_DENSITY_MAX);
        if (o->density_count && density <= o->density[o->density_count - 1])
            return lw_status_fail(err, LW_USAGE, "--densities: they must grow");
        o->density[o->density_count++] = density;
    }
    return LW_OK;
}

enum lw_status lw_crossover_options_parse(int argc, char **argv, struct lw_crossover_options *out_options,
                                          bool *out_done, struct lw_error *err) {
    struct lw_crossover_options o = {.scene = {.sun_angle_deg = LW_SCENE_OPEN_SUN_DIAMETER_DEG},
                                     .warm_s = 2,
                                     .seconds = 0.4,
                                     .minutes_max = (double)INFINITY};
    const char *scene[1] = {NULL}, *size = "640x360", *opponents = "svgf,svgf-quarter", *paths = "1",
               *densities = "0.25,0.5,1,2";
    int motion = LW_SCENE_MOTION_LAMP_WALK, direct = 0, renderer = 0;
    int64_t bounces = 2, seed = 1, repeats = 2, reference = 128, alone = 3;
    const struct lw_option table[] = {
        {"motion", LW_SCENE_MOTION_CHOICES, "what moves (default lamp-walk)", LW_OPTION_CHOICE, &motion, 0, 0,
         NULL},
        {"opponents", "LIST",
         "what each user would run instead, apart by commas: raw, lights, reprojected, svgf, svgf-quarter, "
         "vpl (default svgf,svgf-quarter)",
         LW_OPTION_STRING, &opponents, 0, 0, NULL},
        {"paths", "LIST",
         "paths per pixel and frame of opponents that do not filter (default 1); those that do have one",
         LW_OPTION_STRING, &paths, 0, 0, NULL},
        {"densities", "LIST",
         "densities of the cache's lightmaps, times the scene's default, growing (default 0.25,0.5,1,2)",
         LW_OPTION_STRING, &densities, 0, 0, NULL},
        {"direct", "pixels|tiles|both",
         "the cache's users draw the direct light of sun and lamps at their pixels (default), or tiles hold "
         "all light; or both are measured",
         LW_OPTION_CHOICE, &direct, 0, 0, NULL},
        {"renderer", "cpu|gl|both",
         "the cache's users draw by rays (default), or by OpenGL, which counts what the CPU spends on it; or "
         "both are measured",
         LW_OPTION_CHOICE, &renderer, 0, 0, NULL},
        {"repeats", "N", "measurements, each with other random numbers (default 2)", LW_OPTION_INT, &repeats,
         1, LW_CROSSOVER_REPEATS_MAX, NULL},
        {"size", "WxH", "pixels of each view (default 640x360)", LW_OPTION_STRING, &size, 0, 0, NULL},
        {"alone", "N", "views of each repeat that one user sees alone, for r(1) (default 3)", LW_OPTION_INT,
         &alone, 1, LW_CROSSOVER_VIEWS, NULL},
        {"warm", "S", "scene time before the frames that are judged (default 2)", LW_OPTION_REAL, &o.warm_s,
         1, 600, NULL},
        {"seconds", "S", "scene time over which cost is measured (default 0.4)", LW_OPTION_REAL, &o.seconds,
         0.1, 1, NULL},
        {"solver", "NAME", "the server's solver, by a name that lightwelld --help lists (default: its own)",
         LW_OPTION_STRING, &o.solver, 0, 0, NULL},
        {"bounces", "N", "indirect bounces on both sides (default 2)", LW_OPTION_INT, &bounces, 0, 16, NULL},
        {"reference-samples", "N", "paths per pixel of the references (default 128)", LW_OPTION_INT,
         &reference, 8, 1 << 19, NULL},
        {"truth-samples", "N", NULL, LW_OPTION_INT, &reference, 8, 1 << 19, NULL}, /* its former name */
        {"seed", "N", "of all random numbers (default 1)", LW_OPTION_INT, &seed, 0, UINT32_MAX, NULL},
        {"minutes", "M", "begin nothing more after so long; what is missing is measured the next time",
         LW_OPTION_REAL, &o.minutes_max, 0.01, 1e6, NULL},
        {"real-clock", NULL,
         "measure also by the wall clock, each side at the rate that it attains: on an idle machine, some "
         "seconds a view",
         LW_OPTION_FLAG, &o.real_clock, 0, 0, NULL},
        {"report-only", NULL, "measure nothing: write the report of what DIR holds", LW_OPTION_FLAG,
         &o.report_only, 0, 0, NULL},
        {"o", "DIR",
         "folder of the tables, the references and the report; what it holds is not measured again",
         LW_OPTION_STRING, &o.folder, 0, 0, NULL},
        LW_SCENE_OPEN_OPTIONS(&o.scene),
    };
    const struct lw_options options = {
        .program = "lightwell-load crossover",
        .synopsis = "SCENE -o DIR [OPTIONS]",
        .about =
            "Compares one shared lightwelld with what users would run instead, from twelve fixed views of "
            "a scene: error in several measures, and all cost. Says r(1) and m at the opponents' own error.",
        .table = table,
        .count = sizeof table / sizeof table[0],
        .positional = scene,
        .positional_min = 0,
        .positional_max = 1};
    enum lw_status status = lw_options_parse(&options, argc, argv, NULL, out_done, err);
    if (status != LW_OK || *out_done) return status;
    o.scene.path = scene[0];
    o.motion = (enum lw_scene_motion)motion;
    o.pixels = direct != 1;
    o.tiles = direct != 0;
    o.by_rays = renderer != 1;
    o.by_gl = renderer != 0;
    o.bounces = (uint32_t)bounces;
    o.seed = (uint32_t)seed;
    o.repeats = (uint32_t)repeats;
    o.alone = (uint32_t)alone;
    o.reference_samples = ((uint32_t)reference + 7) / 8 * 8; /* two halves, of a quarter as well */
    if (!o.folder) return lw_status_fail(err, LW_USAGE, "-o DIR is missing: where tables and report go");
    if (!o.scene.path && !o.report_only) return lw_status_fail(err, LW_USAGE, "SCENE is missing");
    status = parse_opponents(opponents, &o, err);
    if (status == LW_OK) status = parse_paths(paths, &o, err);
    if (status == LW_OK) status = parse_densities(densities, &o, err);
    if (status == LW_OK)
        status = lw_measure_options_size(size, WIDTH_MIN, HEIGHT_MIN, &o.width, &o.height, err);
    if (status == LW_OK) *out_options = o;
    return status;
}
