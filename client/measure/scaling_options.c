#include "client/measure/scaling_options.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

#define SIDE_MIN    16u
#define SAMPLES_MAX 65536u
#define REST_MIN    1e-4
#define REST_MAX    10.0

/* Defaults, of values and of their help. */
#define SIZE              "1280x720"
#define USERS             "1,2,4,8,16,32,64,128,256"
#define ERROR             "relmse:0.1"
#define SPREAD            0.5
#define DENSITY           1
#define TARGET_ERROR      0.02
#define SECONDS           2
#define REPEATS           3
#define REFERENCE_SAMPLES 256
#define TEXT              LW_MEASURE_OPTIONS_TEXT

static const struct lw_measure_options_list users_list = {.option = "--users",
                                                          .min = 1,
                                                          .max = LW_SCALING_USERS_MAX,
                                                          .grows = true,
                                                          .count_max = LW_SCALING_COUNTS_MAX};

/* Reads a whole number and moves *text behind it. */
static bool read_count(const char **text, uint64_t max, uint64_t *out) {
    char *end;
    if (**text < '0' || **text > '9') return false;
    errno = 0;
    unsigned long long value = strtoull(*text, &end, 10);
    if (errno || value > max) return false;
    *text = end;
    *out = value;
    return true;
}

static enum lw_status parse_error(const char *text, struct lw_scaling_options *o, struct lw_error *err) {
    static const char expected[] = "relmse:E with 0 < E <= 10, or match:SPP with 1..65536 paths per pixel";
    if (strncmp(text, "relmse:", 7) == 0) {
        char *end;
        o->error = strtod(text + 7, &end);
        if (end != text + 7 && !*end && o->error > 0 && o->error <= 10) return LW_OK;
    } else if (strncmp(text, "match:", 6) == 0) {
        const char *at = text + 6;
        uint64_t samples;
        if (read_count(&at, SAMPLES_MAX, &samples) && !*at && samples) {
            o->match_samples = (uint32_t)samples;
            o->error = 0;
            return LW_OK;
        }
    }
    return lw_status_fail(err, LW_USAGE, "--error: \"%s\" is not %s", text, expected);
}

/* Skips the character before a number, reads that and moves *text behind it. */
static bool read_real(const char **text, double min, double max, double *out) {
    char *end;
    const char *number = *text + 1;
    *out = strtod(number, &end);
    *text = end;
    return end != number && *out >= min && *out <= max;
}

/* "5:8+10@2,0.2": paths per pixel, direct and indirect samples per texel, density, target error. */
static enum lw_status parse_fixed(const char *text, struct lw_scaling_options *o, struct lw_error *err) {
    const char *at = text;
    uint64_t samples, direct, indirect;
    bool good = read_count(&at, 1024, &samples) && *at++ == ':' && read_count(&at, 1024, &direct) &&
                *at++ == '+' && read_count(&at, 1024, &indirect) && samples && direct && indirect;
    o->fixed_density = DENSITY;
    o->fixed_target_error = TARGET_ERROR;
    if (good && *at == '@')
        good =
            read_real(&at, LW_MEASURE_OPTIONS_DENSITY_MIN, LW_MEASURE_OPTIONS_DENSITY_MAX, &o->fixed_density);
    if (good && *at == ',') good = read_real(&at, REST_MIN, REST_MAX, &o->fixed_target_error);
    if (!good || *at)
        return lw_status_fail(
            err, LW_USAGE,
            "--settings: \"%s\" is no SPP:DIRECT+INDIRECT[@DENSITY][,REST] such as 1:1+1 or 5:8+10@2,0.1",
            text);
    o->fixed_samples = (uint32_t)samples;
    o->fixed_direct = (uint32_t)direct;
    o->fixed_indirect = (uint32_t)indirect;
    return LW_OK;
}

enum lw_status lw_scaling_options_parse(int argc, char **argv, struct lw_scaling_options *out_options,
                                        bool *out_done, struct lw_error *err) {
    struct lw_scaling_options o = {.spread = SPREAD};
    struct lw_measure_options_raw raw = {
        .options = {.scene = {.sun_angle_deg = LW_SCENE_OPEN_SUN_DIAMETER_DEG}, .seconds = SECONDS},
        .motion = LW_SCENE_MOTION_LIGHT,
        .size = SIZE,
        .bounces = LW_MEASURE_OPTIONS_BOUNCES,
        .seed = LW_MEASURE_OPTIONS_SEED,
        .repeats = REPEATS,
        .reference_samples = REFERENCE_SAMPLES};
    const char *scene[1] = {NULL}, *users = USERS, *error = ERROR, *fixed = NULL;
    int views = LW_VIEWS_WALK, light = 0, opponent = LW_PATH_RENDERER_SVGF, denoise = 1;
    _Static_assert(LW_PATH_RENDERER_COUNT == 6, "--opponent names them all, in order");
    const struct lw_option table[] = {
        {"users", "LIST", "user counts to measure, growing (default {})", LW_OPTION_STRING, &users, 0, 0,
         NULL},
        {"motion", LW_SCENE_MOTION_CHOICES,
         "what moves (default {}). Where nothing of the scene's own animation belongs to it, "
         "a light or an object is set moving",
         LW_OPTION_CHOICE, &raw.motion, 0, 0, NULL},
        {"views", "walk|centre",
         "users walk through the scene{walk}, or stand all over it and look at its centre", LW_OPTION_CHOICE,
         &views, 0, 0, NULL},
        {"spread", "S", "how far apart users are: 0 all in one place, 1 all over the scene (default {})",
         LW_OPTION_REAL, &o.spread, 0, 1, NULL},
        {"error", "relmse:E|match:SPP",
         "what both sides must reach: a mean relative square error (default {}), "
         "or what the path tracer reaches with SPP paths per pixel",
         LW_OPTION_STRING, &error, 0, 0, NULL},
        {"one-error", NULL,
         "search for that error alone, not for the curve over relMSE 0.5, 0.1 and 0.02 as well",
         LW_OPTION_FLAG, &o.one_error, 0, 0, NULL},
        {"settings", "SPP:D+I[@X][,R]",
         "no search: SPP paths per pixel against D direct and I indirect samples per texel, "
         "in lightmaps of X times the scene's default density (" TEXT(
             DENSITY) ") "
                      "that converge at an error of R (" TEXT(TARGET_ERROR) "), whatever their error",
         LW_OPTION_STRING, &fixed, 0, 0, NULL},
        {"light", "seen|whole|only-seen",
         "seen: the server lights the interest set and its contributors "
         "({seen|default; }with one run of the whole scene as well, which only-seen leaves out). "
         "whole: all of the scene",
         LW_OPTION_CHOICE, &light, 0, 0, NULL},
        {"opponent", "raw|lights|reprojected|svgf|svgf-quarter|vpl",
         "what each user would run instead. raw: paths. lights: paths with all lights at first hits and a "
         "clamp. "
         "reprojected: lights, with histories. svgf: reprojected, filtered over time and picture{svgf}. "
         "svgf-quarter: svgf with paths for a quarter of the pixels. vpl: svgf with bounces by the user's "
         "own "
         "virtual point lights",
         LW_OPTION_CHOICE, &opponent, 0, 0, NULL},
        {"denoise", "off|on", "filter the lightmaps (default {})", LW_OPTION_CHOICE, &denoise, 0, 0, NULL},
        {"seconds", "S", "measured scene time, after a second that is not measured (default {})",
         LW_OPTION_REAL, &raw.options.seconds, 0.2, 600, NULL},
        {"self-test", NULL, "a path tracer on both sides: r(1) must come out as 1", LW_OPTION_FLAG,
         &o.self_test, 0, 0, NULL},
        {"o", "DIR", "folder for report.md, scaling.csv, scaling.json and the plots", LW_OPTION_STRING,
         &raw.options.folder, 0, 0, NULL},
        LW_MEASURE_OPTIONS(&raw, "measurements of cost, each with other random numbers (default {})",
                           "paths per pixel of the reference (default {})", 2),
    };
    const struct lw_options options = {.program = "lightwell-load scaling",
                                       .synopsis = "SCENE -o DIR [OPTIONS]",
                                       .about =
                                           "Measures from how many users on one shared lightwelld is cheaper "
                                           "than a path tracer for each, at equal error, in CPU time, "
                                           "with everything counted.",
                                       .table = table,
                                       .count = sizeof table / sizeof table[0],
                                       .positional = scene,
                                       .positional_min = 1,
                                       .positional_max = 1};
    enum lw_status status = lw_options_parse(&options, argc, argv, NULL, out_done, err);
    if (status != LW_OK || *out_done) return status;
    o.views = (enum lw_views_kind)views;
    o.opponent = (enum lw_path_renderer_kind)opponent;
    o.denoise = denoise;
    o.whole = light == 1;
    o.look_whole = light == 0;
    status = lw_measure_options_finish(&raw, scene[0], SIDE_MIN, SIDE_MIN, 2 /* halves */, &o.base, err);
    if (status == LW_OK)
        status = lw_measure_options_read_counts(&users_list, users, o.users, &o.user_counts, err);
    if (status == LW_OK) status = parse_error(error, &o, err);
    if (status == LW_OK && fixed) status = parse_fixed(fixed, &o, err);
    if (status == LW_OK) *out_options = o;
    return status;
}
