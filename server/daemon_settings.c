#include "server/daemon_settings.h"

#include "common/base/folders.h"
#include "common/base/log.h"
#include "common/builtin/builtin.h"
#include "server/publish/publisher.h"
#include "server/solve/combinations.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define BUDGET_MS    33 /* for a frame */
#define TARGET_ERROR 0.02f
#define OPTIONS_MAX  128u

/* Options that make no sense in a file or in the environment, and variables that clients read. */
static const char *const command_only[] = {"config", "check-config", "print-config", NULL};
static const char *const client_variables[] = {"token", NULL};
/* Options that SIGHUP cannot change: addresses, files and clocks that the operator relies on. */
static const char *const fixed_keys[] = {"listen",
                                         "listen-unix",
                                         "port-file",
                                         "http",
                                         "http-port-file",
                                         "metrics",
                                         "metrics-port-file",
                                         "control-socket",
                                         "nats",
                                         "ca",
                                         "tls-insecure",
                                         "keep",
                                         "clock",
                                         "json",
                                         "frames",
                                         "log-format",
                                         NULL};

/* Defaults choose nothing: a file of all options may hold those of other clocks and codecs. */
static uint32_t choices_of(const struct lw_daemon_settings *s) {
    static const uint32_t clock[] = {LW_CHOICE_REAL, LW_CHOICE_STEP, LW_CHOICE_MANUAL};
    return LW_CHOICE_SERVED | s->entry->choice | clock[s->clock] |
           (s->codec == LW_DAEMON_CODEC_DCT ? LW_CHOICE_DCT : LW_CHOICE_HALF) |
           (s->tile_step != (double)LW_PUBLISHER_STEP_WIDEST ? LW_CHOICE_STEP_WIDEST : 0) |
           (isfinite(s->frame_budget_ms) && s->frame_budget_ms != BUDGET_MS ? LW_CHOICE_BUDGET : 0) |
           (isfinite(s->frame_budget_units) ? LW_CHOICE_UNITS : 0) | (s->animate ? LW_CHOICE_ANIMATE : 0) |
           (s->freeze ? LW_CHOICE_FREEZE : 0);
}

/* Checks of several options together. */
static enum lw_status check(struct lw_daemon_settings *s, struct lw_error *err) {
    enum lw_status status;
    if ((status = lw_solvers_find(s->solver, &s->entry, err)) != LW_OK) {
        lw_status_context(err, "--solver");
        return status;
    }
    if ((status = lw_combinations_check(choices_of(s), err)) != LW_OK) return status;
    if (s->keep_changes && !s->keep)
        return lw_status_fail(err, LW_USAGE, "--keep-changes needs a folder: --keep FOLDER");
    status = lw_serve_options_check(&s->serve, err);
    if (status == LW_OK && s->nats &&
        (status = lw_nats_wire_address(s->nats, &s->nats_address, err)) != LW_OK)
        lw_status_context(err, "--nats");
    if (status == LW_OK && s->nats_trust.ca && s->nats_trust.trusts_all)
        return lw_status_fail(err, LW_USAGE, "--ca and --tls-insecure exclude each other");
    if (status == LW_OK && (s->nats_trust.ca || s->nats_trust.trusts_all) && !s->nats_address.tls)
        return lw_status_fail(err, LW_USAGE, "%s is for --nats tls://HOST:PORT",
                              s->nats_trust.ca ? "--ca" : "--tls-insecure");
    if (status != LW_OK || !s->crossover_report) return status;
    if ((status = lw_cost_report_read(s->crossover_report, &s->renderers, err)) != LW_OK)
        lw_status_context(err, "--crossover-report");
    return status;
}

static enum lw_status print_config(const struct lw_daemon_settings *s, struct lw_error *err) {
    const bool written = fputs(s->printed, stdout) >= 0 && fflush(stdout) == 0;
    return written ? LW_OK : lw_status_fail(err, LW_IO, "standard output: %s", strerror(errno));
}

/* ---- one row an option ---- */

/* Text of --help beside the rows. Solvers and built-in scenes list themselves. */
struct texts {
    char about[1024], solvers[192];
};

static void write_texts(struct texts *t) {
    char names[128];
    lw_solvers_list(names, sizeof names);
    snprintf(t->solvers, sizeof t->solvers, "what computes the light: %s", names);
    int length = snprintf(
        t->about, sizeof t->about,
        "Lights a scene once per frame for all who look at it, and streams the light to them.\n"
        "SCENE is any file that lightwell-import reads (glTF, OBJ, PLY, FBX, Collada, STL), a scene package "
        "(.lwscene), or built in:");
    for (unsigned i = 0; lw_builtin_name(i) && length > 0 && (size_t)length < sizeof t->about; i++)
        length += snprintf(t->about + length, sizeof t->about - (size_t)length, "\n  %s  %s",
                           lw_builtin_name(i), lw_builtin_about(i));
}

/* Returns how many there are. */
static size_t list_options(struct lw_daemon_settings *s, const char *solvers,
                           struct lw_option out_option[OPTIONS_MAX]) {
    const struct lw_option table[] = {
        LW_SERVE_OPTIONS(&s->serve),
        {"nats", "nats://HOST:PORT[/SCENE]",
         "also publish the light there for lightwell-relay, under the name SCENE (default \"scene\"). The "
         "nats-server needs JetStream. tls:// in place of nats:// connects by TLS (default: none)",
         LW_OPTION_STRING, &s->nats, 0, 0, NULL},
        {"ca", "FILE",
         "with --nats tls://...: a PEM file with the certificate of the nats-server to trust, or of "
         "its issuer (default: the issuers that the system believes)",
         LW_OPTION_STRING, &s->nats_trust.ca, 0, 0, NULL},
        {"tls-insecure", NULL,
         "with --nats tls://...: no check of certificates, for tests. An attacker on the way can read and "
         "change everything",
         LW_OPTION_FLAG, &s->nats_trust.trusts_all, 0, 0, NULL},
        LW_OPTIONS_CONFIG(&s->config),
        {"crossover-report", "FOLDER",
         "a folder that lightwell-load crossover has written: costs of renderers for each user, for the cost "
         "meter of /metrics (default none)",
         LW_OPTION_STRING, &s->crossover_report, 0, 0, NULL},
        {"solver", "NAME", solvers, LW_OPTION_STRING, &s->solver, 0, 0, NULL},
        {"bounces", "N", "indirect bounces (default {})", LW_OPTION_INT, &s->bounces, 0,
         LW_SOLVER_BOUNCES_MAX, NULL},
        LW_PROBE_OPTIONS(&s->probes),
        {"denoise", "off|on", "filter the noise out of what is shown (default {})", LW_OPTION_CHOICE,
         &s->denoise, 0, 0, NULL},
        {"direct-samples", "N", "rays per texel and frame towards lamps and sky (default {})", LW_OPTION_INT,
         &s->direct_samples, 1, 1024, NULL},
        {"indirect-samples", "N", "bounce rays per texel and frame (default {})", LW_OPTION_INT,
         &s->indirect_samples, 1, 1024, NULL},
        {"frame-rate", "HZ", "frames a second at most (default {})", LW_OPTION_REAL, &s->frame_rate, 0.01,
         1000, NULL},
        {"frame-budget-ms", "MS",
         "solving time of a frame, roughly; the rest of the work waits for the next frame. A short budget "
         "makes changes show sooner. inf: no limit. Under the real clock alone (default {})",
         LW_OPTION_REAL, &s->frame_budget_ms, 1, (double)INFINITY, NULL},
        {"frame-budget-units", "N",
         "solving work of a frame, roughly, counted in solved texels, so that runs are repeatable. Under the "
         "step and manual clocks alone (default {})",
         LW_OPTION_REAL, &s->frame_budget_units, 1, (double)INFINITY, NULL},
        {"detail", "N",
         "lightmaps near somebody are up to 2^N times finer, for clients that read finer levels (0 to 4; "
         "default {})",
         LW_OPTION_INT, &s->detail, 0, LW_ATLAS_FINER_MAX, NULL},
        {"memory", "MB",
         "memory for light, at most. If the lightmaps of the whole scene fit, the rest is for finer ones. If "
         "not, only what clients look at has the full density (default: 2000 for the lightmaps, or half of "
         "the machine's if that is less, and a 32nd of it, up to 805, for finer ones)",
         LW_OPTION_INT, &s->memory_mb, 1, 1 << 24, NULL},
        {"plan-log", "FILE",
         "write there what each frame verifies, solves and shows, and why, for bug reports; some kB a frame "
         "(default: none)",
         LW_OPTION_STRING, &s->plan_log, 0, 0, NULL},
        {"clock", "real|step|manual",
         "real: scene time is wall time{real}. step: 1/30 s of scene time a solved frame, repeatable. "
         "manual: like step; each line on stdin begins a frame, and its end stops the server",
         LW_OPTION_CHOICE, &s->clock, 0, 0, NULL},
        {"light", "whole|seen",
         "seen: solve the interest set of the clients, and the tiles that light it{seen}. whole: solve "
         "all "
         "tiles",
         LW_OPTION_CHOICE, &s->light, 0, 0, NULL},
        {"prepare", "SECONDS",
         "with --light seen: seconds of solving the whole scene while no client looks, so that the first "
         "client finds good light. After that nothing is solved until a client looks. Under the real clock "
         "alone (default {})",
         LW_OPTION_REAL, &s->prepare_s, 0, 1e9, NULL},
        {"light-groups", "NAMES",
         "lights with a layer of their own, which can be dimmed, recoloured and switched without a ray: "
         "names of lights, emissive materials or \"sky\", separated by commas; up to three groups, separated "
         "by semicolons. none: one layer for all (default: the lights that the animation changes)",
         LW_OPTION_STRING, &s->light_groups, 0, 0, NULL},
        {"client-lights", "auto|lamps|none|NAMES",
         "lights whose direct light clients draw at their pixels, if they can; the light of all others is in "
         "tiles. auto: what the scene's file says, else suns, points, spots and small emissive surfaces "
         "(default). lamps: the same without surfaces. none. NAMES: these lights and emissive materials, "
         "separated by commas",
         LW_OPTION_STRING, &s->client_lights, 0, 0, NULL},
        {"codec", "half|dct",
         "dct: tiles as exact as their noise allows{dct}. half: 16-bit floats, twenty to sixty times "
         "the bytes, for clients that read nothing else",
         LW_OPTION_CHOICE, &s->codec, 0, 0, NULL},
        {"tile-step", "STEP",
         "widest quantisation step of dct, in powers of two of light (default {}). Twice that: a third "
         "fewer bits, up to twice the error",
         LW_OPTION_REAL, &s->tile_step, (double)LW_PUBLISHER_STEP_MIN, 1, NULL},
        {"seed", "N", "seed of all random numbers (default {})", LW_OPTION_INT, &s->seed, 0, UINT32_MAX,
         NULL},
        {"animate", NULL, "run the scene's animation (default if it has one)", LW_OPTION_FLAG, &s->animate, 0,
         0, NULL},
        {"freeze", "SECONDS", "hold the animation at this time", LW_OPTION_REAL, &s->freeze_s, 0, 1e9,
         &s->freeze},
        {"error", "E", "relative error at which blocks converge (default {})", LW_OPTION_REAL, &s->error,
         1e-6, 1, NULL},
        {"frames", "N", "stop after this many frames (default: never)", LW_OPTION_INT, &s->frames, 1, 1e15,
         NULL},
        {"stall-limit", "SECONDS",
         "a frame that takes longer counts as a hang, and a service manager restarts the server (default "
         "{}; six times that until first light)",
         LW_OPTION_REAL, &s->stall_s, 0.001, 1e9, NULL},
        {"keep", "FOLDER",
         "keep the light in this folder over a restart: the light that clients saw, and the sums of a scene "
         "that never changed",
         LW_OPTION_STRING, &s->keep, 0, 0, NULL},
        {"keep-changes", NULL,
         "keep the changes that clients make to the scene in the folder of --keep. Each is written before it "
         "is answered, and the next run makes them again, after a kill, too",
         LW_OPTION_FLAG, &s->keep_changes, 0, 0, NULL},
        {"cache", "FOLDER",
         "keep results of searches in the scene there, so that the next start is sooner; \"\": nowhere "
         "(default "
         "$XDG_CACHE_HOME/lightwell or ~/.cache/lightwell)",
         LW_OPTION_STRING, &s->cache, 0, 0, NULL},
        {"directional", "auto|on|off",
         "tiles with the direction of their light, for normal maps and gloss. auto: for objects with a "
         "normal map, or with a roughness that is textured or under 0.6{auto}. on: for all objects",
         LW_OPTION_CHOICE, &s->directional, 0, 0, NULL},
        {"first-light", "coarse|whole",
         "coarse: under the real clock, show light of a quarter of the density first{coarse}. whole: show "
         "nothing before all detail is there",
         LW_OPTION_CHOICE, &s->first, 0, 0, NULL},
        {"spares", "MESH=N,...",
         "reserve N more objects of a mesh for lightwellctl add; N alone: of every mesh. A reserve takes the "
         "memory of its objects, and no ray (default: none; removed objects can be added again)",
         LW_OPTION_STRING, &s->spares, 0, 0, NULL},
        LW_LOG_OPTIONS(&s->log_format, &s->log_level),
        {"json", NULL, "print one JSON object per frame to stdout", LW_OPTION_FLAG, &s->json, 0, 0, NULL},
        {"plain-sky", NULL,
         "light a scene without any light by an even sky of 1 W/(m^2 sr), instead of refusing it",
         LW_OPTION_FLAG, &s->scene.plain_sky, 0, 0, NULL},
        LW_SCENE_OPEN_OPTIONS(&s->scene),
    };
    _Static_assert(sizeof table / sizeof *table <= OPTIONS_MAX, "room for all options");
    memcpy(out_option, table, sizeof table);
    return sizeof table / sizeof *table;
}

/* ---- defaults ---- */

void lw_daemon_settings_init(struct lw_daemon_settings *s, const _Atomic bool *cancel) {
    *s = (struct lw_daemon_settings){
        .serve = LW_SERVE_OPTIONS_DEFAULTS,
        .bounces = 2,
        .detail = LW_ATLAS_FINER_MAX,
        .probes = {.tracing_range_m = (double)INFINITY},
        .direct_samples = 1,
        .indirect_samples = 2,
        .denoise = 1,
        .light = LW_DAEMON_LIGHT_SEEN,
        .codec = LW_DAEMON_CODEC_DCT,
        .tile_step = (double)LW_PUBLISHER_STEP_WIDEST,
        .frame_rate = 30,
        .frame_budget_ms = BUDGET_MS,
        .frame_budget_units = (double)INFINITY,
        .seed = 1,
        .stall_s = 600,
        .prepare_s = 120,
        .log_level = LW_LOG_INFO,
        .error = (double)TARGET_ERROR,
        .scene = {.sun_angle_deg = LW_SCENE_OPEN_SUN_DIAMETER_DEG, .cancel = cancel}};
    (void)lw_folders_cache(s->default_cache, sizeof s->default_cache);
    s->cache = s->default_cache;
}

void lw_daemon_settings_finish(struct lw_daemon_settings *s) {
    lw_options_config_finish(&s->config);
    free(s->printed);
}

/* ---- parsing ---- */

enum lw_status lw_daemon_settings_parse(struct lw_daemon_settings *s, int argc, char **argv, bool *out_done,
                                        struct lw_error *err) {
    const char *scene[1] = {NULL};
    struct lw_option option[OPTIONS_MAX];
    struct texts texts;
    write_texts(&texts);
    const size_t count = list_options(s, texts.solvers, option);
    const struct lw_options options = {.program = "lightwelld",
                                       .synopsis = "SCENE [OPTIONS]",
                                       .about = texts.about,
                                       .table = option,
                                       .count = count,
                                       .positional = scene,
                                       .positional_min = 1,
                                       .positional_max = 1};
    s->config = (struct lw_options_config){
        .prefix = "LIGHTWELL", .positional = "scene", .command = command_only, .foreign = client_variables};
    enum lw_status status = lw_options_config_parse(&s->config, &options, argc, argv, out_done, err);
    if (status != LW_OK || *out_done) return status;
    s->scene.path = scene[0];
    if ((status = check(s, err)) != LW_OK) return status;
    *out_done = s->config.check || s->config.print;
    if (s->config.check) lw_log(LW_LOG_INFO, "the options are good");
    if (!(s->printed = lw_options_config_print(&s->config, &options)))
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    return s->config.print ? print_config(s, err) : LW_OK;
}

/* ---- what SIGHUP cannot change ---- */

static bool is_fixed(const char *key) {
    for (size_t k = 0; fixed_keys[k]; k++)
        if (strcmp(fixed_keys[k], key) == 0) return true;
    return false;
}

/* Copies an option's value. Texts live as long as `config`. False: out of memory. */
static bool copy_value(const struct lw_option *from, const struct lw_option *to,
                       struct lw_options_config *config) {
    const char *text;
    switch (from->kind) {
    case LW_OPTION_FLAG:
        *(bool *)to->value = *(const bool *)from->value;
        break;
    case LW_OPTION_INT:
        *(int64_t *)to->value = *(const int64_t *)from->value;
        break;
    case LW_OPTION_REAL:
        *(double *)to->value = *(const double *)from->value;
        break;
    case LW_OPTION_RGB:
        memcpy(to->value, from->value, 3 * sizeof(float));
        break;
    case LW_OPTION_CHOICE:
        *(int *)to->value = *(const int *)from->value;
        break;
    case LW_OPTION_STRING:
        text = *(const char *const *)from->value;
        *(const char **)to->value = text ? lw_options_config_keep(config, text) : NULL;
        return !text || *(const char **)to->value;
    }
    return true;
}

enum lw_status lw_daemon_settings_keep(struct lw_daemon_settings *s, const struct lw_daemon_settings *before,
                                       bool *out_changed, struct lw_error *err) {
    struct lw_option from[OPTIONS_MAX], to[OPTIONS_MAX];
    struct lw_daemon_settings old = *before; /* rows want pointers that may write */
    char key[LW_OPTIONS_CONFIG_NAME_MAX];
    *out_changed = false;
    for (size_t at = 0; lw_options_config_difference(before->printed, s->printed, &at, key);) {
        if (is_fixed(key))
            lw_log(LW_LOG_WARNING, "%s is as it was until lightwelld is started again", key);
        else if (strcmp(key, "log-level") != 0)
            *out_changed = true;
    }
    const size_t count = list_options(&old, "", from);
    (void)list_options(s, "", to);
    for (size_t i = 0; i < count; i++)
        if (is_fixed(to[i].name) && !copy_value(&from[i], &to[i], &s->config))
            return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    return check(s, err); /* addresses are in their parts again */
}
