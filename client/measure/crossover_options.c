#include "client/measure/crossover_options.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define WIDTH_MIN  64u /* two crops side by side */
#define HEIGHT_MIN 32u
#define PATHS_MAX  256u

/* Defaults, of values and of their help. */
#define SIZE              "640x360"
#define OPPONENTS         "svgf,svgf-quarter"
#define PATHS             "1"
#define DENSITIES         "0.25,0.5,1,2"
#define ALONE             3
#define WARM_S            2
#define SECONDS           0.4
#define REPEATS           2
#define REFERENCE_SAMPLES 128
#define TEXT              LW_MEASURE_OPTIONS_TEXT

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

static const struct lw_measure_options_list paths_list = {
    .option = "--paths", .min = 1, .max = PATHS_MAX, .count_max = LW_CROSSOVER_PATHS_MAX};
static const struct lw_measure_options_list densities_list = {.option = "--densities",
                                                              .min = LW_MEASURE_OPTIONS_DENSITY_MIN,
                                                              .max = LW_MEASURE_OPTIONS_DENSITY_MAX,
                                                              .grows = true,
                                                              .count_max = LW_CROSSOVER_DENSITIES_MAX};

enum lw_status lw_crossover_options_parse(int argc, char **argv, struct lw_crossover_options *out_options,
                                          bool *out_done, struct lw_error *err) {
    struct lw_crossover_options o = {.warm_s = WARM_S, .minutes_max = (double)INFINITY};
    struct lw_measure_options_raw raw = {
        .options = {.scene = {.sun_angle_deg = LW_SCENE_OPEN_SUN_DIAMETER_DEG}, .seconds = SECONDS},
        .motion = LW_SCENE_MOTION_LAMP_WALK,
        .size = SIZE,
        .bounces = LW_MEASURE_OPTIONS_BOUNCES,
        .seed = LW_MEASURE_OPTIONS_SEED,
        .repeats = REPEATS,
        .reference_samples = REFERENCE_SAMPLES};
    const char *scene[1] = {NULL}, *opponents = OPPONENTS, *paths = PATHS, *densities = DENSITIES;
    int direct = 0, renderer = 0;
    int64_t alone = ALONE;
    const struct lw_option table[] = {
        {"motion", LW_SCENE_MOTION_CHOICES, "what moves (default {})", LW_OPTION_CHOICE, &raw.motion, 0, 0,
         NULL},
        {"opponents", "LIST",
         "what each user would run instead, apart by commas: "
         "raw, lights, reprojected, svgf, svgf-quarter, vpl (default {})",
         LW_OPTION_STRING, &opponents, 0, 0, NULL},
        {"paths", "LIST",
         "paths per pixel and frame of opponents that do not filter (default {}); "
         "those that do have one",
         LW_OPTION_STRING, &paths, 0, 0, NULL},
        {"densities", "LIST",
         "densities of the cache's lightmaps, times the scene's default, growing (default {})",
         LW_OPTION_STRING, &densities, 0, 0, NULL},
        {"direct", "pixels|tiles|both",
         "the cache's users draw the direct light of sun and lamps at their pixels{pixels}, "
         "or tiles hold all light; or both are measured",
         LW_OPTION_CHOICE, &direct, 0, 0, NULL},
        {"renderer", "cpu|gl|both",
         "the cache's users draw by rays{cpu}, or by OpenGL, which counts what the CPU spends on it; "
         "or both are measured",
         LW_OPTION_CHOICE, &renderer, 0, 0, NULL},
        {"alone", "N", "views of each repeat that one user sees alone, for r(1) (default {})", LW_OPTION_INT,
         &alone, 1, LW_MEASURE_VIEWS, NULL},
        {"warm", "S", "scene time before the frames that are judged (default {})", LW_OPTION_REAL, &o.warm_s,
         1, 600, NULL},
        {"seconds", "S", "scene time over which cost is measured (default {})", LW_OPTION_REAL,
         &raw.options.seconds, 0.1, 1, NULL},
        {"minutes", "M", "begin nothing more after so long; what is missing is measured the next time",
         LW_OPTION_REAL, &o.minutes_max, 0.01, 1e6, NULL},
        {"real-clock", NULL,
         "measure also by the wall clock, each side at the rate that it attains: "
         "on an idle machine, some seconds a view",
         LW_OPTION_FLAG, &o.real_clock, 0, 0, NULL},
        {"report-only", NULL, "measure nothing: write the report of what DIR holds", LW_OPTION_FLAG,
         &o.report_only, 0, 0, NULL},
        {"o", "DIR",
         "folder of the tables, the references and the report; what it holds is not measured again",
         LW_OPTION_STRING, &raw.options.folder, 0, 0, NULL},
        LW_MEASURE_OPTIONS(&raw, "measurements, each with other random numbers (default {})",
                           "paths per pixel of the references (default {})", 8),
    };
    const struct lw_options options = {
        .program = "lightwell-load crossover",
        .synopsis = "SCENE -o DIR [OPTIONS]",
        .about = "Compares one shared lightwelld with what users would run instead, "
                 "from twelve fixed views of a scene: error in several measures, and all cost. "
                 "Says r(1) and m at the opponents' own error.",
        .table = table,
        .count = sizeof table / sizeof table[0],
        .positional = scene,
        .positional_min = 0,
        .positional_max = 1};
    enum lw_status status = lw_options_parse(&options, argc, argv, NULL, out_done, err);
    if (status != LW_OK || *out_done) return status;
    o.pixels = direct != 1;
    o.tiles = direct != 0;
    o.by_rays = renderer != 1;
    o.by_gl = renderer != 0;
    o.alone = (uint32_t)alone;
    status = lw_measure_options_finish(&raw, scene[0], WIDTH_MIN, HEIGHT_MIN,
                                       8 /* two halves, of a quarter as well */, &o.base, err);
    if (status == LW_OK && !scene[0] && !o.report_only)
        status = lw_status_fail(err, LW_USAGE, "SCENE is missing");
    if (status == LW_OK) status = parse_opponents(opponents, &o, err);
    if (status == LW_OK)
        status = lw_measure_options_read_counts(&paths_list, paths, o.paths, &o.paths_count, err);
    if (status == LW_OK)
        status =
            lw_measure_options_read_numbers(&densities_list, densities, o.density, &o.density_count, err);
    if (status == LW_OK) *out_options = o;
    return status;
}
