#include "client/view/view_options.h"

#include "client/paths/camera_default.h"
#include "client/view/compose/antialias.h"
#include "common/base/options.h"

#include <stdlib.h>
#include <string.h>
#include <strings.h>

#define OWN_ADDRESS "127.0.0.1:0"
#define SECONDS_MAX 1e6 /* eleven days */

/* Values of the table that are used here alone. */
struct raw {
    struct lw_access_options access;
    const char *address, *camera, *size, *wait, *exposure;
    int64_t samples, bounces, seed, samples_per_pixel;
    int curve, pixel, guide, show, direct, renderer, mirrors;
    bool samples_given;
};

/* Options of one of the three ways to run: in a window, --headless, --path-trace. Options that are not named
 * here are of --path-trace alone. */
static const char *const of_every_way[] = {"camera",  "camera-name", "size",    "tonemap", "exposure",
                                           "threads", "show",        "version", NULL};
static const char *const of_a_server[] = {"headless", "wait", "timeout", "cache", "samples-per-pixel", NULL};
static const char *const of_viewers[] = {"direct", "renderer",     "mirrors", "token-file", "tls",
                                         "ca",     "tls-insecure", NULL}; /* --headless and the window */
static const char *const of_scenes[] = {
    "texels-per-metre", "density-of",  "max-texels", "atlas-max", "sky", "import-seconds",
    "picture-texels",   "environment", "sun-angle",  "materials", NULL}; /* where we open one */
static const char *const of_files[] = {"out", "json", NULL};             /* --headless and --path-trace */

static bool is_among(const char *name, const char *const *list) {
    for (; *list; list++)
        if (strcmp(name, *list) == 0) return true;
    return false;
}

static enum lw_status parse_number(const char *option, const char *text, double min, double max, double *out,
                                   struct lw_error *err) {
    char *end;
    double value = strtod(text, &end);
    if (end == text || *end != '\0' || !(value >= min && value <= max))
        return lw_status_fail(err, LW_USAGE, "--%s: \"%.60s\" is not a number from %g to %g", option, text,
                              min, max);
    *out = value;
    return LW_OK;
}

static enum lw_status parse_size(const char *text, struct lw_view_options *out, struct lw_error *err) {
    char *end = NULL;
    long side[2] = {0, 0};
    const char *at = text;
    for (int i = 0; i < 2; i++) {
        side[i] = *at >= '0' && *at <= '9' ? strtol(at, &end, 10) : 0;
        bool ends_well = side[i] > 0 && (i == 0 ? *end == 'x' : *end == '\0');
        if (!ends_well)
            return lw_status_fail(err, LW_USAGE, "--size: \"%.60s\" is not WxH in pixels, such as 1280x720",
                                  text);
        if (side[i] > (long)LW_VIEW_SIDE_MAX)
            return lw_status_fail(err, LW_USAGE, "--size: %s %ld is not from 1 to %u", i ? "height" : "width",
                                  side[i], LW_VIEW_SIDE_MAX);
        at = end + 1;
    }
    out->width = (uint32_t)side[0];
    out->height = (uint32_t)side[1];
    return LW_OK;
}

static enum lw_status parse_wait(const char *text, struct lw_view_options *out, struct lw_error *err) {
    static const char *const names[] = {[LW_VIEW_WAIT_FIRST] = "first",
                                        [LW_VIEW_WAIT_COMPLETE] = "complete",
                                        [LW_VIEW_WAIT_GOOD] = "good",
                                        [LW_VIEW_WAIT_CONVERGED] = "converged"};
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++)
        if (strcmp(text, names[i]) == 0) {
            out->wait = (enum lw_view_wait)i;
            return LW_OK;
        }
    if (strncmp(text, "seconds:", 8) == 0) {
        out->wait = LW_VIEW_WAIT_SECONDS;
        return parse_number("wait seconds", text + 8, 0, SECONDS_MAX, &out->wait_s, err);
    }
    return lw_status_fail(err, LW_USAGE,
                          "--wait: \"%.60s\" is none of first, complete, good, converged, seconds:S", text);
}

static enum lw_status parse_out(struct lw_view_options *out, struct lw_error *err) {
    if (out->out == NULL) return LW_OK;
    const char *suffix = strrchr(out->out, '.');
    if (suffix != NULL && strcasecmp(suffix, ".exr") == 0)
        out->format = LW_VIEW_EXR;
    else if (suffix != NULL && strcasecmp(suffix, ".png") == 0)
        out->format = LW_VIEW_PNG;
    else
        return lw_status_fail(err, LW_USAGE, "--out: \"%.300s\" ends in neither .exr nor .png", out->out);
    return LW_OK;
}

/* A scene in place of an address. */
static bool is_own(const struct raw *raw) { return raw->address && lw_scene_open_is_scene(raw->address); }

/* Refuses what the chosen way does not know. */
static enum lw_status check_way(const struct lw_view_options *o, bool own, const struct lw_option *table,
                                size_t count, struct lw_error *err) {
    const bool path = o->path.open.path != NULL;
    for (size_t i = 0; i < count; i++) {
        const char *name = table[i].name;
        if (!*table[i].given || is_among(name, of_every_way)) continue;
        if (is_among(name, of_scenes)) {
            if (path || own) continue;
            return lw_status_fail(err, LW_USAGE, "--%s works with a scene only: a server's has its own",
                                  name);
        }
        const bool viewer = is_among(name, of_viewers);
        const bool served = viewer || is_among(name, of_a_server), file = is_among(name, of_files);
        if (path && served)
            return lw_status_fail(err, LW_USAGE, "--%s is of no use with --path-trace, which asks no server",
                                  name);
        if (!path && !served && !file)
            return lw_status_fail(err, LW_USAGE, "--%s works with --path-trace only", name);
        if (!path && !o->headless && !viewer)
            return lw_status_fail(err, LW_USAGE, "--%s works with --headless%s only", name,
                                  file ? " and --path-trace" : "");
    }
    return LW_OK;
}

static enum lw_status check_together(const struct lw_view_options *o, const struct raw *raw,
                                     struct lw_error *err) {
    const bool path = o->path.open.path != NULL;
    if (raw->camera != NULL && o->camera_name != NULL)
        return lw_status_fail(err, LW_USAGE, "--camera and --camera-name exclude each other");
    if (path && raw->address != NULL)
        return lw_status_fail(err, LW_USAGE, "\"%.60s\" is of no use with --path-trace, which asks no server",
                              raw->address);
    if (path && raw->show > LW_SHOW_INDIRECT)
        return lw_status_fail(err, LW_USAGE, "--show %s is of no use with --path-trace, which has no tiles",
                              lw_show_name((enum lw_show)raw->show));
    if ((o->headless || path) && o->out == NULL && !o->json)
        return lw_status_fail(err, LW_USAGE, "--%s needs --out FILE.exr or FILE.png (or --json alone)",
                              path ? "path-trace" : "headless");
    return LW_OK;
}

static enum lw_status interpret(const struct raw *raw, struct lw_view_options *out, struct lw_error *err) {
    const char *address = raw->address ? raw->address : LW_OPTIONS_ADDRESS;
    if (is_own(raw)) {
        out->own = out->path.open;
        out->own.path = out->scene = raw->address;
        address = OWN_ADDRESS;
    }
    enum lw_status status = lw_access_address(address, out->host, sizeof out->host, &out->port, err);
    if (status == LW_OK && !out->scene) status = lw_access_read(&raw->access, &out->access, err);
    if (status == LW_OK && raw->camera != NULL) {
        status = lw_camera_parse(raw->camera, &out->camera, err);
        if (status != LW_OK) lw_status_context(err, "--camera");
        out->camera_given = true;
    }
    if (status == LW_OK) status = parse_size(raw->size, out, err);
    if (status == LW_OK) status = parse_wait(raw->wait, out, err);
    if (status == LW_OK) status = parse_out(out, err);
    out->auto_exposure = strcmp(raw->exposure, "auto") == 0;
    if (status == LW_OK && !out->auto_exposure) {
        double stops = 0;
        status = parse_number("exposure", raw->exposure, (double)-LW_TONEMAP_STOPS_MAX,
                              (double)LW_TONEMAP_STOPS_MAX, &stops, err);
        out->stops = (float)stops;
    }
    out->threads = (unsigned)out->path.open.threads;
    out->samples_per_pixel = (uint32_t)raw->samples_per_pixel;
    out->path.samples = (uint32_t)raw->samples;
    if (out->path.error > 0 && !raw->samples_given) out->path.samples = LW_PATH_FILM_SAMPLES_MAX;
    out->path.bounces = (uint32_t)raw->bounces;
    out->path.seed = (uint32_t)raw->seed;
    out->path.pixel = (enum lw_path_pixel)raw->pixel;
    out->path.guide = (enum lw_view_guide)raw->guide;
    out->show = (enum lw_show)raw->show;
    out->path.part = (enum lw_path_part)raw->show; /* the same, as far as paths know them */
    out->renderer = (enum lw_view_renderer)raw->renderer;
    out->mirrors =
        raw->mirrors == LW_VIEW_MIRRORS_ON || (raw->mirrors == LW_VIEW_MIRRORS_AUTO && out->headless);
    out->draws_direct = raw->direct == 0;
    out->curve = (enum lw_tonemap_curve)raw->curve;
    return status == LW_OK ? check_together(out, raw, err) : status;
}

enum lw_status lw_view_options_parse(int argc, char **argv, struct lw_view_options *out_options,
                                     bool *out_done, struct lw_error *err) {
    struct lw_view_options o = {.timeout_s = 120, .path.open.sun_angle_deg = LW_SCENE_OPEN_SUN_DIAMETER_DEG};
    struct raw raw = {.size = "1280x720",
                      .wait = "good",
                      .samples_per_pixel = LW_VIEW_SAMPLES_PER_PIXEL,
                      .exposure = "auto",
                      .samples = LW_VIEW_SPP,
                      .bounces = 2,
                      .seed = 1};
    struct lw_option table[] = {
        {.name = "headless",
         .help = "render one view without a window, and end",
         .kind = LW_OPTION_FLAG,
         .value = &o.headless},
        {.name = "camera",
         .argument = "PX,PY,PZ:TX,TY,TZ:FOV",
         .help = "from a point (metres) towards another, with a vertical field of view in degrees. 10m in "
                 "place of it: an orthographic view, 10 m high",
         .kind = LW_OPTION_STRING,
         .value = &raw.camera},
        {.name = "camera-name",
         .argument = "NAME",
         .help = "a camera of the scene (default: its first)",
         .kind = LW_OPTION_STRING,
         .value = &o.camera_name},
        {.name = "size",
         .argument = "WxH",
         .help = "pixels, each side from 1 to 16384 (default {})",
         .kind = LW_OPTION_STRING,
         .value = &raw.size},
        {.name = "wait",
         .argument = "first|complete|good|converged|seconds:S",
         .help = "what to wait for. first: any light. complete: every tile of the view with all bounces. "
                 "good: an estimated error that is good to look at, or that falls no more{good}. "
                 "converged: the error of every tile is below the server's target. seconds:S: S seconds",
         .kind = LW_OPTION_STRING,
         .value = &raw.wait},
        {.name = "timeout",
         .argument = "SECONDS",
         .help = "longest wait; then the picture is written as it is, with exit code 75 (default {})",
         .kind = LW_OPTION_REAL,
         .value = &o.timeout_s,
         .min = 0.1,
         .max = SECONDS_MAX},
        {.name = "samples-per-pixel",
         .argument = "N",
         .help = "samples of --headless over each pixel's square (default {}; 1: its centre)",
         .kind = LW_OPTION_INT,
         .value = &raw.samples_per_pixel,
         .min = 1,
         .max = LW_ANTIALIAS_SAMPLES_MAX},
        {.name = "cache",
         .argument = "FOLDER",
         .help = "keep scene packages there, so that none is downloaded twice (default: nowhere)",
         .kind = LW_OPTION_STRING,
         .value = &o.cache_folder},
        LW_ACCESS_OPTIONS(&raw.access),
        {.name = "direct",
         .argument = LW_VIEW_DIRECT_CHOICES,
         .help = "direct light of suns and lamps. auto: drawn here, with sharp shadows, where the server "
                 "leaves it to clients{auto}. tiles: as its tiles have it",
         .kind = LW_OPTION_CHOICE,
         .value = &raw.direct},
        {.name = "renderer",
         .argument = LW_VIEW_RENDERER_CHOICES,
         .help = "gl: OpenGL 3.3. cpu: rays on the CPU, the reference. auto: gl in a window where there is a "
                 "GPU, else cpu{auto}",
         .kind = LW_OPTION_CHOICE,
         .value = &raw.renderer},
        {.name = "mirrors",
         .argument = LW_VIEW_MIRRORS_CHOICES,
         .help = "smooth surfaces mirror the room, by rays, with --renderer cpu; pictures of polished floors "
                 "take up to three times as long. auto: with --headless{auto}",
         .kind = LW_OPTION_CHOICE,
         .value = &raw.mirrors},
        {.name = "out",
         .argument = "FILE",
         .help = "FILE.exr: linear radiance, 32-bit float. FILE.png: tone mapped",
         .kind = LW_OPTION_STRING,
         .value = &o.out},
        {.name = "json",
         .help = "report times, counts and the mean colour on stdout",
         .kind = LW_OPTION_FLAG,
         .value = &o.json},
        {.name = "tonemap",
         .argument = LW_TONEMAP_CHOICES,
         .help = "tone curve (default {})",
         .kind = LW_OPTION_CHOICE,
         .value = &raw.curve},
        {.name = "exposure",
         .argument = "STOPS|auto",
         .help = "exposure in stops. auto: by the picture{auto}",
         .kind = LW_OPTION_STRING,
         .value = &raw.exposure},
        {.name = "path-trace",
         .argument = "SCENE",
         .help = "path trace one view of a scene file, without a server, and end. --spp to --guide, --time "
                 "and --seed are for it",
         .kind = LW_OPTION_STRING,
         .value = &o.path.open.path},
        {.name = "spp",
         .argument = "N",
         .help = "samples per pixel (default {}; with --error, at most N)",
         .kind = LW_OPTION_INT,
         .value = &raw.samples,
         .min = 1,
         .max = LW_PATH_FILM_SAMPLES_MAX,
         .given = &raw.samples_given},
        {.name = "error",
         .argument = "E",
         .help = "end when the estimated relative error of the picture, the root of relMSE, is below E",
         .kind = LW_OPTION_REAL,
         .value = &o.path.error,
         .min = 1e-4,
         .max = 1},
        {.name = "bounces",
         .argument = "N",
         .help = "indirect bounces, as of lightwelld (default {})",
         .kind = LW_OPTION_INT,
         .value = &raw.bounces,
         .min = 0,
         .max = LW_PATH_TRACE_BOUNCES_MAX},
        {.name = "pixel",
         .argument = LW_VIEW_PIXEL_CHOICES,
         .help = "box: the mean over a pixel's square{box}. centre: what its centre sees, as "
                 "--headless shows it",
         .kind = LW_OPTION_CHOICE,
         .value = &raw.pixel},
        {.name = "guide",
         .argument = LW_VIEW_GUIDE_CHOICES,
         .help = "off: bounce rays by the surface alone{off}. learned: half of them by what earlier "
                 "samples have found, for rooms that indirect light lights",
         .kind = LW_OPTION_CHOICE,
         .value = &raw.guide},
        {.name = "show",
         .argument = LW_SHOW_CHOICES,
         .help = "all: all light{all}. direct: what shines, and the light of lamps that are drawn here. "
                 "indirect: the light of tiles, or by bounces with --path-trace. irradiance: what arrives. "
                 "The others are charts: of texels, of the age and error of tiles, of the level that is "
                 "read, of the interest set, and of the normals, roughness and metalness of surfaces",
         .kind = LW_OPTION_CHOICE,
         .value = &raw.show},
        {.name = "time",
         .argument = "SECONDS",
         .help = "moment of the scene's animation (default {})",
         .kind = LW_OPTION_REAL,
         .value = &o.path.time_s,
         .min = 0,
         .max = 1e9},
        {.name = "seed",
         .argument = "N",
         .help = "seed of all random numbers (default {})",
         .kind = LW_OPTION_INT,
         .value = &raw.seed,
         .min = 0,
         .max = UINT32_MAX},
        LW_SCENE_OPEN_OPTIONS(&o.path.open),
    };
    enum { COUNT = sizeof table / sizeof table[0] };
    bool given[COUNT] = {false};
    for (size_t i = 0; i < COUNT; i++)
        if (table[i].given == NULL) table[i].given = &given[i];
    const struct lw_options options = {
        .program = "lightwell-view",
        .synopsis = "[HOST:PORT | HOST | :PORT | SCENE | --path-trace SCENE] [OPTIONS]",
        .about =
            "Shows the scene that a lightwelld lights (default " LW_OPTIONS_ADDRESS
            "; HOST alone: its port 7780, PORT or :PORT alone: this machine; SCENE: a file or builtin:NAME, "
            "lit by "
            "a lightwelld of its own, by a plain sky if nothing shines in it), in a window, where H shows "
            "the "
            "keys. With "
            "--headless it renders one view: lightwell-view --headless --camera-name main --out view.png\n"
            "With --path-trace it works the light out by itself, slowly and exactly: "
            "lightwell-view --path-trace SCENE --error 0.02 --out reference.exr\n"
            "Ctrl-C writes what there is of either, and ends it with exit code 75. Exit codes are those of "
            "sysexits.h.",
        .table = table,
        .count = COUNT,
        .positional = &raw.address,
        .positional_min = 0,
        .positional_max = 1};
    enum lw_status status = lw_options_parse(&options, argc, argv, NULL, out_done, err);
    if (status != LW_OK || *out_done) return status;
    status = check_way(&o, is_own(&raw), table, COUNT, err);
    if (status == LW_OK) status = interpret(&raw, &o, err);
    if (status == LW_OK) *out_options = o;
    return status;
}

enum lw_status lw_view_options_camera(const struct lw_view_options *options, const struct lw_scene *scene,
                                      const struct lw_pose *pose, const struct lw_trace *trace,
                                      struct lw_camera_view *out_camera, struct lw_error *err) {
    if (options->camera_given) {
        *out_camera = options->camera;
        return LW_OK;
    }
    uint32_t camera = 0;
    if (options->camera_name != NULL) {
        enum lw_status status = lw_camera_find(scene, options->camera_name, &camera, err);
        if (status != LW_OK) return status;
    }
    if (camera < scene->camera_count)
        *out_camera = lw_camera_of_scene(scene, pose, camera);
    else
        *out_camera = lw_camera_default(scene, pose, trace, (float)options->width / (float)options->height);
    return LW_OK;
}
