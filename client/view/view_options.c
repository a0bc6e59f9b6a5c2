#include "client/view/view_options.h"

#include "common/options.h"

#include <stdlib.h>
#include <string.h>
#include <strings.h>

#define DEFAULT_ADDRESS "127.0.0.1:7780"
#define SECONDS_MAX     1e6 /* eleven days */

/* What the table fills and nobody else sees. */
struct raw {
    const char *address, *camera, *size, *wait, *exposure;
    int64_t threads;
    int curve;
    bool size_given, wait_given, timeout_given;
};

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
    return lw_status_fail(err, LW_USAGE, "--wait: \"%.60s\" is none of first, complete, converged, seconds:S",
                          text);
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

static enum lw_status check_together(const struct lw_view_options *o, const struct raw *raw,
                                     struct lw_error *err) {
    if (raw->camera != NULL && o->camera_name != NULL)
        return lw_status_fail(err, LW_USAGE, "--camera and --camera-name exclude each other");
    if (o->headless && o->out == NULL && !o->json)
        return lw_status_fail(err, LW_USAGE, "--headless needs --out FILE.exr or FILE.png (or --json alone)");
    if (o->headless) return LW_OK;
    const char *only = o->out               ? "out"
                       : o->json            ? "json"
                       : raw->wait_given    ? "wait"
                       : raw->timeout_given ? "timeout"
                                            : NULL;
    if (only != NULL) return lw_status_fail(err, LW_USAGE, "--%s works with --headless only", only);
    return LW_OK;
}

static enum lw_status interpret(const struct raw *raw, struct lw_view_options *out, struct lw_error *err) {
    enum lw_status status = lw_options_address(raw->address, out->host, sizeof out->host, &out->port, err);
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
    out->threads = (unsigned)raw->threads;
    out->curve = (enum lw_tonemap_curve)raw->curve;
    return status == LW_OK ? check_together(out, raw, err) : status;
}

enum lw_status lw_view_options_parse(int argc, char **argv, struct lw_view_options *out_options,
                                     bool *out_done, struct lw_error *err) {
    struct lw_view_options o = {.timeout_s = 120};
    struct raw raw = {.address = DEFAULT_ADDRESS, .size = "1280x720", .wait = "complete", .exposure = "auto"};
    const struct lw_option table[] = {
        {.name = "headless",
         .help = "Render one view without a window, and leave.",
         .kind = LW_OPTION_FLAG,
         .value = &o.headless},
        {.name = "camera",
         .argument = "PX,PY,PZ:TX,TY,TZ:FOV",
         .help = "From a point (metres) towards another, with a vertical field of view in degrees.",
         .kind = LW_OPTION_STRING,
         .value = &raw.camera},
        {.name = "camera-name",
         .argument = "NAME",
         .help = "A camera of the scene (default: its first).",
         .kind = LW_OPTION_STRING,
         .value = &o.camera_name},
        {.name = "size",
         .argument = "WxH",
         .help = "Pixels, each side from 1 to 16384 (default 1280x720).",
         .kind = LW_OPTION_STRING,
         .value = &raw.size,
         .given = &raw.size_given},
        {.name = "wait",
         .argument = "first|complete|converged|seconds:S",
         .help = "What to wait for: any light at all; every tile of the view with all bounces (default); "
                 "with an error "
                 "below the server's target; or so many seconds.",
         .kind = LW_OPTION_STRING,
         .value = &raw.wait,
         .given = &raw.wait_given},
        {.name = "timeout",
         .argument = "SECONDS",
         .help = "Give up waiting (exit code 75) after so long (default 120).",
         .kind = LW_OPTION_REAL,
         .value = &o.timeout_s,
         .min = 0.1,
         .max = SECONDS_MAX,
         .given = &raw.timeout_given},
        {.name = "out",
         .argument = "FILE",
         .help = "FILE.exr: linear radiance, 32-bit float. FILE.png: tone mapped.",
         .kind = LW_OPTION_STRING,
         .value = &o.out},
        {.name = "json",
         .help = "Report times, counts and the mean colour on stdout.",
         .kind = LW_OPTION_FLAG,
         .value = &o.json},
        {.name = "tonemap",
         .argument = LW_TONEMAP_CHOICES,
         .help = "Tone curve (default reinhard).",
         .kind = LW_OPTION_CHOICE,
         .value = &raw.curve},
        {.name = "exposure",
         .argument = "STOPS|auto",
         .help = "Exposure in stops, or by the picture (default auto).",
         .kind = LW_OPTION_STRING,
         .value = &raw.exposure},
        {.name = "threads",
         .argument = "N",
         .help = "Threads that render (default 0: all).",
         .kind = LW_OPTION_INT,
         .value = &raw.threads,
         .min = 0,
         .max = 1024},
    };
    const struct lw_options options = {
        .program = "lightwell-view",
        .synopsis = "[HOST:PORT] [OPTIONS]",
        .about =
            "Shows the scene that a lightwelld lights (default " DEFAULT_ADDRESS
            "), in a window: click, then fly "
            "with mouse, W A S D, Q and E; C for the next camera; F1 for the figures; Esc to leave. With "
            "--headless it renders one view: lightwell-view --headless --camera-name main --out view.png",
        .table = table,
        .count = sizeof table / sizeof table[0],
        .positional = &raw.address,
        .positional_min = 0,
        .positional_max = 1};
    enum lw_status status = lw_options_parse(&options, argc, argv, NULL, out_done, err);
    if (status != LW_OK || *out_done) return status;
    status = interpret(&raw, &o, err);
    if (status == LW_OK) *out_options = o;
    return status;
}
