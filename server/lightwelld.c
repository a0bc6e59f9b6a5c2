/* lightwelld.c: the daemon. Reads a scene, lights it frame by frame in one thread, serves it from another.
 * Threads: main is the loop [loop]; one solver thread [solver] simulates, solves and publishes. They share
 *          the server's hand-over and two flags, nothing else. */
#include "common/builtin/builtin.h"
#include "common/clock.h"
#include "common/folders.h"
#include "common/interrupt.h"
#include "common/light/client_lights.h"
#include "common/lightmap/lightmap.h"
#include "common/log.h"
#include "common/open/scene_open.h"
#include "common/options_config.h"
#include "common/scene/finish_package.h"
#include "common/scene/package.h"
#include "common/scene/scene_spares.h"
#include "common/scene/scene_state.h"
#include "common/tile/tile_codec.h"
#include "common/trace/trace.h"
#include "common/wait_policy.h"
#include "common/waiting.h"
#include "server/daemon_metrics.h"
#include "server/file_stamp.h"
#include "server/nats/nats_publisher.h"
#include "server/probe_options.h"
#include "server/publish/light_store.h"
#include "server/publish/publisher.h"
#include "server/serve/serve_options.h"
#include "server/serve/server.h"
#include "server/serve/service_notify.h"
#include "server/solve/coarse_first.h"
#include "server/solve/solvers.h"
#include "server/solve/surface/saved_texels.h"

#include <errno.h>
#include <jansson.h>
#include <malloc.h>
#include <math.h>
#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#define TARGET_ERROR 0.02f
#define BUDGET_MS    33 /* for a frame */
#define SOLVER_NICE  5  /* lower priority than the loop */
#define STALL_S      600.0
#define STALL_FIRST  6.0 /* times that, until first light: texels are placed, and rays' structure is built */
#define STATUS_MS    10000u
#define PREPARE_S    120.0
#define STOP_WAIT_S  3u        /* for the end of a frame */
#define DROP_WAIT_S  1u        /* for that of a scene that is being read, but will not be lit */
#define STEP_HZ      30        /* scene time advances by 1/30 s a frame under --clock step */
#define MAPPED_MIN   (1 << 18) /* bytes of an array that is mapped by itself */
/* A channel that no client takes any more is published for this long, since clients come back after a
 * broken link. */
#define CHANNEL_LINGERS_NS 10000000000u
/* A picture of one sample for each texel is blotched. So the first one that is shown has this many, or as
 * many as there are so long after the first. */
#define FIRST_ROUNDS 3
#define FIRST_NS     500000000u

enum clock_kind { CLOCK_REAL, CLOCK_STEP, CLOCK_MANUAL };
enum light_kind { LIGHT_WHOLE, LIGHT_SEEN };
enum first_kind { FIRST_COARSE, FIRST_WHOLE };
enum directional_kind { DIRECTIONAL_AUTO, DIRECTIONAL_ON, DIRECTIONAL_OFF };
enum codec_kind { CODEC_HALF, CODEC_DCT };

/* What makes no sense in a file or in the environment; variables that clients read. */
static const char *const command_only[] = {"config", "check-config", "print-config", NULL};
static const char *const client_variables[] = {"token", NULL};
/* What SIGHUP cannot change: addresses, files and clocks that the operator relies on. */
static const char *const fixed_keys[] = {"listen",
                                         "listen-unix",
                                         "port-file",
                                         "http",
                                         "http-port-file",
                                         "metrics",
                                         "metrics-port-file",
                                         "control-socket",
                                         "nats",
                                         "keep",
                                         "clock",
                                         "json",
                                         "frames",
                                         "log-format",
                                         NULL};

struct settings {
    struct lw_scene_open scene;
    struct lw_options_config config;
    char *printed; /* all options, as a file for --config */
    struct lw_serve_options serve;
    const char *nats; /* NULL: none */
    struct lw_nats_wire_address nats_address;
    const char *plan_log;
    const char *crossover_report;
    struct lw_cost_report renderers; /* of that report */
    const char *keep, *cache, *spares, *light_groups, *client_lights, *solver;
    const struct lw_solvers_entry *entry; /* of that name */
    int64_t bounces, direct_samples, indirect_samples, seed, frames, detail;
    int64_t detail_mb; /* -1: a share of the machine's */
    struct lw_probe_options probes;
    int denoise;
    double frame_rate, frame_budget_ms, frame_budget_units, freeze_s, error, tile_step, stall_s, prepare_s;
    bool animate, freeze, json;
    int clock, light, first, directional, codec, log_format, log_level;
    char default_cache[1024];
};

/* A thread that prepares what follows at SIGHUP. */
struct succession {
    pthread_t thread;
    bool runs;           /* it is to be joined */
    _Atomic bool ended;  /* it leaves next alone from now on, and does not relay */
    _Atomic bool relays; /* the server hands over to next's */
    bool only_scene;     /* no option has changed: a scene that is the same changes nothing */
    struct daemon *next;
    struct lw_server_sockets sockets;
};

struct daemon {
    struct settings settings;
    int argc;
    char **argv; /* as it was called */
    struct lw_file_stamp scene_stamp, environment_stamp;
    struct succession succession;
    struct lw_scene *scene;
    struct lw_scene_state state; /* of it, by updates: what is lit */
    uint8_t *package;
    size_t package_size;
    uint8_t *finishes; /* finish package; NULL: all is matt */
    size_t finishes_size;
    struct lw_atlas_map atlas_map;
    struct lw_pose pose;
    struct lw_light_groups light_groups;
    struct lw_client_lights client_lights;
    uint8_t *light_bits, *material_bits; /* the same for the WELCOME */
    bool *directional;                   /* per object: its tiles say where light comes from */
    bool has_directions;                 /* some object's do */
    struct lw_solver *solver;
    struct lw_publisher *publisher;
    struct lw_server *server;
    struct lw_nats_publisher *nats; /* NULL: none */
    pthread_t solver_thread;
    struct lw_light_store light_store; /* if --keep says so */
    _Atomic bool stopping;
    _Atomic bool cancel;            /* ends a frame under way */
    _Atomic bool lit;               /* the solver has had a frame */
    struct lw_waiting first_light;  /* how far that is */
    _Atomic uint64_t solver_due_ns; /* when the solver must have made progress; UINT64_MAX: it rests */
    _Atomic uint64_t frame_count;   /* that were solved */
    struct lw_error solver_error;   /* read after the thread is joined */
    bool told_stall, stops;         /* [loop] */
    struct lw_daemon_metrics metrics;
    const char *isa; /* of the rays' kernels */
    uint64_t started_ns, rays_total;
    uint64_t first; /* number of the first frame: 1, or after the frames of the saved light */
    struct {        /* until there is light */
        uint64_t lit_ns, frame_ns, texels; /* the end of the first frame, how long it took, what it solved */
        unsigned rounds;                   /* that all of the light has had (frames whose light is shown) */
    } young;
    uint64_t published; /* the last frame that was */
    bool moved;         /* something has moved since then */
    bool owes_snapshot; /* there was no memory for one */
    bool owes_channel;  /* nor for a channel that somebody takes */
    bool is_looked_at;  /* by some client */
    uint64_t interest;  /* the number of the list of interest that the solver has (lw_server_interest) */
    uint64_t published_interest; /* that of the newest snapshot */
    bool is_coarse;              /* tiles are of a coarse scene (coarse_first.h) */
    bool prepares;               /* all of the scene is solved, though nobody looks */
    uint64_t prepared_ns;        /* wall time for which it was */
    uint32_t channels;           /* that are shown and published: bit for each (tile_channels.h) */
    uint32_t channels_kept;      /* those of the saved light */
    uint64_t taken_ns[LW_TILE_CHANNELS_MAX]; /* when somebody last took it */
};

/* Signals before the loop watches for them: a handler can reach nothing but globals. */
static _Atomic bool signalled;

static void on_early_signal(int number) {
    (void)number;
    signalled = true;
}

/* The solver asks as well: that closes the gap between the last look at the flag and the loop's own
 * watchers. */
static bool should_stop(const struct daemon *d) { return d->stopping || signalled; }

/* Defaults choose nothing: a file of all options may hold those of other clocks and codecs. */
static uint32_t choices_of(const struct settings *s) {
    static const uint32_t clock[] = {LW_CHOICE_REAL, LW_CHOICE_STEP, LW_CHOICE_MANUAL};
    return LW_CHOICE_SERVED | s->entry->choice | clock[s->clock] |
           (s->codec == CODEC_DCT ? LW_CHOICE_DCT : LW_CHOICE_HALF) |
           (s->tile_step != (double)LW_PUBLISHER_STEP_WIDEST ? LW_CHOICE_STEP_WIDEST : 0) |
           (isfinite(s->frame_budget_ms) && s->frame_budget_ms != BUDGET_MS ? LW_CHOICE_BUDGET : 0) |
           (isfinite(s->frame_budget_units) ? LW_CHOICE_UNITS : 0) | (s->animate ? LW_CHOICE_ANIMATE : 0) |
           (s->freeze ? LW_CHOICE_FREEZE : 0);
}

/* What one option alone does not tell. */
static enum lw_status check(struct settings *s, struct lw_error *err) {
    enum lw_status status;
    if ((status = lw_solvers_find(s->solver, &s->entry, err)) != LW_OK) {
        lw_status_context(err, "--solver");
        return status;
    }
    if ((status = lw_combinations_check(choices_of(s), err)) != LW_OK) return status;
    status = lw_serve_options_check(&s->serve, err);
    if (status == LW_OK && s->nats &&
        (status = lw_nats_wire_address(s->nats, &s->nats_address, err)) != LW_OK)
        lw_status_context(err, "--nats");
    if (status != LW_OK || !s->crossover_report) return status;
    if ((status = lw_cost_report_read(s->crossover_report, &s->renderers, err)) != LW_OK)
        lw_status_context(err, "--crossover-report");
    return status;
}

static enum lw_status print_config(const struct settings *s, struct lw_error *err) {
    const bool written = fputs(s->printed, stdout) >= 0 && fflush(stdout) == 0;
    return written ? LW_OK : lw_status_fail(err, LW_IO, "standard output: %s", strerror(errno));
}

static enum lw_status parse(struct settings *s, int argc, char **argv, bool *out_done, struct lw_error *err) {
    const char *scene[1] = {NULL};
    char about[1024], names[128], solvers[192];
    lw_solvers_list(names, sizeof names);
    snprintf(solvers, sizeof solvers, "what computes the light: %s", names);
    int length = snprintf(
        about, sizeof about,
        "Lights a scene once per frame for all who look at it, and streams the light to them.\n"
        "SCENE is any file that lightwell-import reads (glTF, OBJ, PLY, FBX, Collada, STL), a scene package "
        "(.lwscene), or built in:");
    for (unsigned i = 0; lw_builtin_name(i) && length > 0 && (size_t)length < sizeof about; i++)
        length += snprintf(about + length, sizeof about - (size_t)length, "\n  %s  %s", lw_builtin_name(i),
                           lw_builtin_about(i));
    const struct lw_option table[] = {
        LW_SERVE_OPTIONS(&s->serve),
        {"nats", "nats://HOST:PORT[/SCENE]",
         "also publish the light there, under the name SCENE (default \"scene\"), for lightwell-relay; the "
         "nats-server needs JetStream (default: none)",
         LW_OPTION_STRING, &s->nats, 0, 0, NULL},
        LW_OPTIONS_CONFIG(&s->config),
        {"crossover-report", "FOLDER",
         "a folder that lightwell-load crossover has written, for the cost meter of /metrics: what renderers "
         "for "
         "each user cost (default none)",
         LW_OPTION_STRING, &s->crossover_report, 0, 0, NULL},
        {"solver", "NAME", solvers, LW_OPTION_STRING, &s->solver, 0, 0, NULL},
        {"bounces", "N", "indirect bounces (default 2)", LW_OPTION_INT, &s->bounces, 0, LW_SOLVER_BOUNCES_MAX,
         NULL},
        LW_PROBE_OPTIONS(&s->probes),
        {"denoise", "off|on", "filter the noise out of what is shown (default on)", LW_OPTION_CHOICE,
         &s->denoise, 0, 0, NULL},
        {"direct-samples", "N", "rays per texel and frame towards lamps and sky (default 1)", LW_OPTION_INT,
         &s->direct_samples, 1, 1024, NULL},
        {"indirect-samples", "N", "bounce rays per texel and frame (default 2)", LW_OPTION_INT,
         &s->indirect_samples, 1, 1024, NULL},
        {"frame-rate", "HZ", "frames a second at most (default 30)", LW_OPTION_REAL, &s->frame_rate, 0.01,
         1000, NULL},
        {"frame-budget-ms", "MS",
         "wall time that a frame may take for solving, about, so that changes are heard of soon; what is "
         "left is for the "
         "next. inf: as long as it takes. Under the real clock alone (default 33)",
         LW_OPTION_REAL, &s->frame_budget_ms, 1, (double)INFINITY, NULL},
        {"frame-budget-units", "N",
         "work that a frame may do, about, as the texels that it solves if it does nothing else: a budget "
         "that "
         "is repeatable. Under the step and manual clocks alone (default inf)",
         LW_OPTION_REAL, &s->frame_budget_units, 1, (double)INFINITY, NULL},
        {"detail", "N",
         "lightmaps are up to 2^N times finer where somebody is near, for clients that can read such (0 to "
         "4; "
         "default 4)",
         LW_OPTION_INT, &s->detail, 0, LW_ATLAS_FINER_MAX, NULL},
        {"detail-memory", "MB",
         "memory for what is finer, at most (default: 1/32 of the machine's, up to 768)", LW_OPTION_INT,
         &s->detail_mb, -1, 1 << 20, NULL},
        {"plan-log", "FILE",
         "write there what each frame verifies, solves and shows, and why; for reports of faults. It grows "
         "by "
         "what changes, some kB a frame (default: none)",
         LW_OPTION_STRING, &s->plan_log, 0, 0, NULL},
        {"clock", "real|step|manual",
         "real: scene time is wall time (default). step: 1/30 s of scene time per solved frame, repeatable. "
         "manual: the same, and a frame begins with each line on stdin, whose end stops the server",
         LW_OPTION_CHOICE, &s->clock, 0, 0, NULL},
        {"light", "whole|seen", "seen: what clients look at and what lights it (default). whole: all of it",
         LW_OPTION_CHOICE, &s->light, 0, 0, NULL},
        {"prepare", "SECONDS",
         "with --light seen, light is made better for so long while nobody looks, all over the scene, so "
         "that "
         "who comes first finds it good; then nothing is solved until somebody does. Under the real clock "
         "alone (default 120)",
         LW_OPTION_REAL, &s->prepare_s, 0, 1e9, NULL},
        {"light-groups", "NAMES",
         "lights that have a layer of their own, so that to dim, recolour or switch them takes no ray: names "
         "of lights, "
         "emissive materials or \"sky\", apart by commas; up to three groups, apart by semicolons. none: one "
         "layer for all "
         "(default: what the scene's animation moves)",
         LW_OPTION_STRING, &s->light_groups, 0, 0, NULL},
        {"client-lights", "auto|lamps|none|NAMES",
         "lights whose direct light clients draw at their pixels, if they can; all others get it in tiles. "
         "auto: what the scene's file says, else suns, points, "
         "spots and small emissive surfaces (default). lamps: without the surfaces. none; or names of lights "
         "and "
         "emissive materials, apart by commas",
         LW_OPTION_STRING, &s->client_lights, 0, 0, NULL},
        {"codec", "half|dct",
         "dct: tiles as exact as their noise lets them be (default). half: 16-bit floats, twenty to "
         "sixty times the bytes, for clients that read nothing else",
         LW_OPTION_CHOICE, &s->codec, 0, 0, NULL},
        {"tile-step", "STEP",
         "dct's widest step, in powers of two of light (default 0.1); twice that: a third fewer bits, up "
         "to twice the error",
         LW_OPTION_REAL, &s->tile_step, (double)LW_PUBLISHER_STEP_MIN, 1, NULL},
        {"seed", "N", "of all random numbers (default 1)", LW_OPTION_INT, &s->seed, 0, UINT32_MAX, NULL},
        {"animate", NULL, "run the scene's animation (default if it has one)", LW_OPTION_FLAG, &s->animate, 0,
         0, NULL},
        {"freeze", "SECONDS", "hold the animation at this time", LW_OPTION_REAL, &s->freeze_s, 0, 1e9,
         &s->freeze},
        {"error", "E", "relative error at which blocks converge (default 0.02)", LW_OPTION_REAL, &s->error,
         1e-6, 1, NULL},
        {"frames", "N", "stop after this many frames (default: never)", LW_OPTION_INT, &s->frames, 1, 1e15,
         NULL},
        {"stall-limit", "SECONDS",
         "a frame that takes longer counts as a hang, which a service manager ends (default 600; six times "
         "that until first light)",
         LW_OPTION_REAL, &s->stall_s, 0.001, 1e9, NULL},
        {"keep", "FOLDER",
         "keep the light there over a restart: what was shown, and of a scene that never changed the sums as "
         "well",
         LW_OPTION_STRING, &s->keep, 0, 0, NULL},
        {"cache", "FOLDER",
         "keep there what is found once per scene, so that the next start need not look inside objects "
         "again; "
         "\"\": "
         "nowhere (default $XDG_CACHE_HOME/lightwell or ~/.cache/lightwell)",
         LW_OPTION_STRING, &s->cache, 0, 0, NULL},
        {"directional", "auto|on|off",
         "keep where light comes from, so that clients show normal maps and gloss by it. auto: of objects "
         "with a normal map, or whose roughness is textured or under 0.6 (default). on: of all objects",
         LW_OPTION_CHOICE, &s->directional, 0, 0, NULL},
        {"first-light", "coarse|whole",
         "coarse: under the real clock, a picture of a quarter of the density first, while all detail is "
         "prepared (default). whole: no light before that",
         LW_OPTION_CHOICE, &s->first, 0, 0, NULL},
        {"spares", "MESH=N,...",
         "keep room for N more objects of a mesh, for lightwellctl add; N alone is for every mesh. "
         "Costs the "
         "memory of as many objects, and no ray (default: none; what is removed can be added again)",
         LW_OPTION_STRING, &s->spares, 0, 0, NULL},
        LW_LOG_OPTIONS(&s->log_format, &s->log_level),
        {"json", NULL, "print one JSON object per frame to stdout", LW_OPTION_FLAG, &s->json, 0, 0, NULL},
        {"plain-sky", NULL,
         "where nothing shines in the scene, light it by an even sky of 1 W/(m^2 sr) instead of refusing it",
         LW_OPTION_FLAG, &s->scene.plain_sky, 0, 0, NULL},
        LW_SCENE_OPEN_OPTIONS(&s->scene),
    };
    const struct lw_options options = {.program = "lightwelld",
                                       .synopsis = "SCENE [OPTIONS]",
                                       .about = about,
                                       .table = table,
                                       .count = sizeof table / sizeof table[0],
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

static enum lw_status choose_client_lights(struct daemon *d, struct lw_error *err) {
    const struct lw_scene *scene = d->scene;
    struct lw_client_lights *client = &d->client_lights;
    enum lw_status status = lw_client_lights_init(client, scene, &d->pose, d->settings.client_lights, err);
    if (status != LW_OK) return status;
    d->light_bits = calloc(lw_client_lights_bytes(scene->light_count) + 1, 1);
    d->material_bits = calloc(lw_client_lights_bytes(scene->material_count) + 1, 1);
    if (!d->light_bits || !d->material_bits) return lw_status_fail(err, LW_NO_MEMORY, "client lights");
    lw_client_lights_write(client, d->light_bits, d->material_bits);
    return LW_OK;
}

/* Which objects' tiles say where light comes from. */
static enum lw_status choose_directional(struct daemon *d, struct lw_error *err) {
    const struct lw_scene *scene = d->scene;
    uint32_t count = 0;
    d->directional = calloc(scene->object_count + 1ul, sizeof *d->directional);
    if (!d->directional) return lw_status_fail(err, LW_NO_MEMORY, "directional objects");
    for (uint32_t o = 0; d->settings.directional != DIRECTIONAL_OFF && o < scene->object_count; o++)
        count += d->directional[o] =
            d->settings.directional == DIRECTIONAL_ON || lw_scene_object_has_bumps(scene, o);
    d->has_directions = count > 0;
    if (count) lw_log(LW_LOG_INFO, "light has a direction on %u of %u objects", count, scene->object_count);
    return LW_OK;
}

static unsigned count_suns(const struct daemon *d) {
    unsigned suns = 0;
    for (uint32_t l = 0; l < d->client_lights.light_count; l++)
        suns += d->client_lights.light[l] && d->scene->light[l].kind == LW_LIGHT_DIRECTIONAL;
    return suns;
}

static void tell_client_lights(const struct daemon *d) {
    const struct lw_client_lights *client = &d->client_lights;
    if (!lw_client_lights_any(client)) {
        lw_log(LW_LOG_INFO, "clients draw no direct light: all of it is in tiles");
        return;
    }
    const struct {
        const char *thing;
        unsigned count;
    } of[] = {{"sun", count_suns(d)},
              {"lamp", client->drawn_lights - count_suns(d)},
              {"emissive material", client->drawn_materials}};
    char text[128];
    int length = 0;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++)
        if (of[i].count)
            length += snprintf(text + length, sizeof text - (size_t)length, "%s%u %s%s", length ? ", " : "",
                               of[i].count, of[i].thing, of[i].count == 1 ? "" : "s");
    lw_log(LW_LOG_INFO, "clients draw the direct light of %s, if they can", text);
}

/* What a tile of a finer level takes, with its share of the publisher's; and of each layer of light. */
#define FINE_TILE_BYTES  (128u << 10)
#define FINE_LAYER_BYTES (1u << 20)

#define FINE_MEMORY_SHARE 32
#define FINE_MEMORY_MAX   (768ull << 20)

static uint32_t fine_tiles(const struct daemon *d) {
    const struct settings *s = &d->settings;
    const uint64_t machine = (uint64_t)sysconf(_SC_PHYS_PAGES) * (uint64_t)sysconf(_SC_PAGESIZE),
                   share = machine / FINE_MEMORY_SHARE < FINE_MEMORY_MAX ? machine / FINE_MEMORY_SHARE
                                                                         : FINE_MEMORY_MAX,
                   bytes = s->detail_mb < 0 ? share : (uint64_t)s->detail_mb << 20;
    const bool is_followed = s->light == LIGHT_SEEN && s->detail; /* else nobody asks the solver for tiles */
    return is_followed ? (uint32_t)(bytes / (FINE_TILE_BYTES + d->light_groups.count * FINE_LAYER_BYTES)) : 0;
}

/* How many tiles of finer levels may be listed by clients, or held, at a time. Every session that reads such
 * remembers what it has of each. */
#define FINE_IDS_MIN 4096u

static enum lw_status name_tiles(struct daemon *d, struct lw_error *err) {
    const uint32_t tiles = fine_tiles(d), ids = 2 * tiles > FINE_IDS_MIN ? 2 * tiles : FINE_IDS_MIN;
    const enum lw_status status = lw_atlas_map_init_finer(
        &d->atlas_map, d->scene, tiles ? (uint32_t)d->settings.detail : 0, tiles ? ids : 0);
    return status == LW_OK ? LW_OK : lw_status_fail(err, status, "tiles");
}

static enum lw_status read_scene(struct daemon *d, struct lw_error *err) {
    const struct settings *s = &d->settings;
    d->scene_stamp = lw_file_stamp(s->scene.path); /* before it is read: what changes meanwhile is seen */
    d->environment_stamp = lw_file_stamp(s->scene.environment);
    enum lw_status status = lw_scene_open(&s->scene, &d->scene, err);
    if (status != LW_OK) return status;
    if (s->spares && (status = lw_scene_spares_add(d->scene, s->spares, err)) != LW_OK) {
        lw_status_context(err, "--spares");
        return status;
    }
    status = lw_package_write(d->scene, &d->package, &d->package_size, err);
    if (status == LW_OK && lw_scene_has_finishes(d->scene))
        status = lw_finish_package_write(d->scene, &d->finishes, &d->finishes_size, err);
    if (status != LW_OK) return status;
    if ((status = lw_scene_state_init(&d->state, d->scene, s->freeze ? s->freeze_s : 0, s->freeze)) !=
            LW_OK ||
        (status = lw_pose_init(&d->pose, d->scene)) != LW_OK)
        return lw_status_fail(err, status, "poses");
    lw_scene_state_pose(&d->state, 0, &d->pose);
    status = lw_light_groups_init(&d->light_groups, d->scene, &d->pose, s->light_groups, err);
    if (status != LW_OK) {
        lw_status_context(err, "--light-groups");
        return status;
    }
    if ((status = name_tiles(d, err)) != LW_OK) return status;
    status = choose_client_lights(d, err);
    return status == LW_OK ? choose_directional(d, err) : status;
}

/* Share of a tile's noise that the solver's filter leaves. */
static float noise_shown(const struct settings *s) { return s->denoise == 1 ? LW_SOLVER_NOISE_SHOWN : 1; }

static enum lw_status solve_nothing(struct daemon *d, struct lw_error *err) {
    uint8_t *nothing = calloc((size_t)d->atlas_map.tile_count + 1, 1);
    if (!nothing) return lw_status_fail(err, LW_NO_MEMORY, "tiles");
    enum lw_status status = d->solver->ops->set_interest(d->solver, nothing, err);
    free(nothing);
    return status;
}

/* In hex; returns how many characters. */
static int print_hash(char *dst, const void *bytes, size_t size) {
    struct lw_package_hash hash;
    int length = 0;
    lw_package_hash(bytes, size, &hash);
    for (size_t i = 0; i < sizeof hash.bytes; i++) length += snprintf(dst + length, 3, "%02x", hash.bytes[i]);
    return length;
}

/* Under a hash of all that decides which texels light reaches: the scene, when, and this very program.
 * Another build of it may find others. */
static struct lw_saved_texels saved_texels(const struct daemon *d) {
    const struct settings *s = &d->settings;
    const struct lw_file_stamp program = lw_file_stamp("/proc/self/exe");
    struct lw_saved_texels saved = {.folder = s->cache};
    struct lw_package_hash hash;
    char text[256];
    int length = print_hash(text, d->package, d->package_size);
    length += snprintf(text + length, sizeof text - (size_t)length,
                       " " LW_VERSION " program %llu %llu freeze %d %a real %d",
                       (unsigned long long)program.size_bytes, (unsigned long long)program.modified_ns,
                       s->freeze, s->freeze ? s->freeze_s : 0, s->clock == CLOCK_REAL);
    lw_package_hash((const uint8_t *)text, (size_t)length, &hash);
    memcpy(saved.key, hash.bytes, sizeof saved.key);
    return saved;
}

/* Runs that are to be repeatable, or have frames counted, light the whole density at once. So do those that
 * have light to show from the last run. */
static bool is_coarse_first(const struct daemon *d) {
    const struct settings *s = &d->settings;
    return s->first == FIRST_COARSE && s->clock == CLOCK_REAL && !s->frames && !d->channels_kept &&
           s->entry->choice == LW_CHOICE_CELLS && lw_coarse_first_pays(d->scene);
}

static enum lw_status set_up_solver(struct daemon *d, struct lw_error *err) {
    const struct settings *s = &d->settings;
    const struct lw_saved_texels saved = saved_texels(d);
    const struct lw_solver_desc desc = {
        .scene = &d->state.scene,
        .atlas_map = &d->atlas_map,
        .client_lights = &d->client_lights,
        .light_groups = &d->light_groups,
        .directions = d->has_directions,
        .bounces = (uint32_t)s->bounces,
        LW_PROBE_OPTIONS_DESC(&s->probes),
        .denoise = s->denoise == 1,
        .direct_samples = (uint32_t)s->direct_samples,
        .indirect_samples = (uint32_t)s->indirect_samples,
        .target_error = (float)s->error,
        .threads = (unsigned)s->scene.threads,
        .seed = (uint32_t)s->seed,
        .frame_budget_s =
            s->clock == CLOCK_REAL && isfinite(s->frame_budget_ms) ? s->frame_budget_ms * 1e-3 : 0,
        .plan_log = s->plan_log,
        .frame_budget_units = isfinite(s->frame_budget_units) ? s->frame_budget_units : 0,
        .fine_tiles = fine_tiles(d),
        .saved_texels = *s->cache ? &saved : NULL,
        .cancel = &d->cancel,
        .waiting = &d->first_light,
        .awaited = s->clock == CLOCK_REAL ? lw_server_updates_wait(d->server) : NULL};
    enum lw_status status = is_coarse_first(d)
                                ? lw_coarse_first_create(s->entry, &desc, &d->pose, &d->solver, err)
                                : s->entry->create(&desc, &d->pose, &d->solver, err);
    if (status != LW_OK) return status;
    if (s->light == LIGHT_SEEN) { /* by nobody, to begin with */
        status = solve_nothing(d, err);
        if (status != LW_OK) return status;
    }
    status = lw_publisher_create(&(struct lw_publisher_desc){.scene = &d->state.scene,
                                                             .atlas_map = &d->atlas_map,
                                                             .solver = d->solver,
                                                             .target_error = (float)s->error,
                                                             .noise_shown = noise_shown(s),
                                                             .codec = s->codec == CODEC_DCT
                                                                          ? LW_TILE_CODEC_DCT
                                                                          : LW_TILE_CODEC_HALF_ZSTD,
                                                             .step_widest = (float)s->tile_step,
                                                             .directional = d->directional,
                                                             .threads = (unsigned)s->scene.threads},
                                 &d->publisher);
    return status == LW_OK ? LW_OK : lw_status_fail(err, status, "publisher");
}

struct frame_cost {
    uint64_t wall_ns, solve_cpu_ns, publish_cpu_ns;
    size_t changes; /* of the scene, made by updates */
};

/* CPU time of the solver's thread and its workers: of the process, less the loop. */
static uint64_t work_cpu_ns(const struct daemon *d) {
    struct lw_server_stats serve;
    lw_server_get_stats(d->server, &serve);
    return lw_clock_process_cpu_ns() - serve.loop_cpu_ns;
}

static void put_count(json_t *line, const char *key, uint64_t count) {
    json_object_set_new(line, key, json_integer((json_int_t)count));
}

static void put_ms(json_t *line, const char *key, uint64_t ns) {
    json_object_set_new(line, key, json_real(round((double)ns * 1e-3) * 1e-3));
}

static void print_frame(const struct daemon *d, uint64_t frame, const struct frame_cost *cost,
                        const struct lw_solver_stats *solve, const struct lw_publisher_stats *publish) {
    struct lw_server_stats serve;
    lw_server_get_stats(d->server, &serve);
    json_t *line = json_object();
    put_count(line, "frame", frame);
    put_count(line, "published", d->published);
    json_object_set_new(line, "time_s", json_real(round(d->pose.time_s * 1e6) * 1e-6));
    put_ms(line, "frame_ms", cost->wall_ns);
    put_ms(line, "pose_ms", solve->pose_ns);
    put_ms(line, "change_ms", solve->change_ns);
    put_ms(line, "direct_ms", solve->direct_ns);
    put_ms(line, "probe_ms", solve->probe_ns);
    put_ms(line, "scatter_ms", solve->scatter_ns);
    put_ms(line, "denoise_ms", solve->denoise_ns);
    put_ms(line, "weld_ms", solve->weld_ns);
    put_ms(line, "levels_ms", publish->levels_ns);
    put_ms(line, "encode_ms", publish->encode_ns);
    put_count(line, "rays_shadow", solve->rays_shadow);
    put_count(line, "rays_bounce", solve->rays_bounce);
    put_count(line, "rays_probe", solve->rays_probe);
    put_count(line, "rays_total", d->rays_total);
    put_count(line, "texels_solved", solve->texels_solved);
    put_count(line, "tiles_solved", solve->tiles_solved);
    put_count(line, "tiles_converged", solve->tiles_converged);
    put_count(line, "tiles", solve->tiles);
    put_count(line, "coarse", solve->coarse);
    put_count(line, "tiles_interest", solve->tiles_interest);
    put_count(line, "tiles_contributing", solve->tiles_contributing);
    put_count(line, "tiles_fine", solve->tiles_fine);
    put_count(line, "tiles_fine_wanted", solve->tiles_fine_wanted);
    put_count(line, "tiles_encoded", publish->tiles_encoded);
    put_count(line, "bytes_encoded", publish->bytes_encoded);
    put_count(line, "split_tiles_encoded", publish->split_tiles_encoded);
    put_count(line, "split_bytes_encoded", publish->split_bytes_encoded);
    put_count(line, "saturated", publish->saturated);
    put_count(line, "changes", cost->changes);
    put_count(line, "sessions", serve.sessions_now);
    put_count(line, "sessions_drawing", serve.sessions_drawing);
    put_count(line, "tiles_sent", serve.tiles_sent);
    put_count(line, "bytes_sent", serve.bytes_sent);
    put_ms(line, "solve_cpu_ms", cost->solve_cpu_ns);
    put_ms(line, "publish_cpu_ms", cost->publish_cpu_ns);
    put_ms(line, "loop_cpu_ms", serve.loop_cpu_ns);
    put_ms(line, "cpu_ms", lw_clock_process_cpu_ns());
    put_ms(line, "loop_lag_p99_ms", serve.loop_lag_p99_ns);
    put_ms(line, "loop_lag_max_ms", serve.loop_lag_max_ns);
    put_ms(line, "ack_p99_ms", serve.ack_p99_ns);
    put_count(line, "waiting_bytes", serve.waiting_bytes);
    put_count(line, "waiting_bytes_max", serve.waiting_bytes_max);
    put_count(line, "socket_bytes", serve.socket_bytes);
    if (json_dumpf(line, stdout, JSON_COMPACT | JSON_REAL_PRECISION(15)) == 0) putchar('\n');
    json_decref(line);
    fflush(stdout);
}

/* The time of the animation's clock, s: of the wall, or counted in frames. */
static double wall_time(const struct daemon *d, uint64_t frame) {
    if (d->settings.clock != CLOCK_REAL) return (double)(frame - d->first) / STEP_HZ;
    return (double)(lw_clock_ns() - d->started_ns) * 1e-9;
}

/* Makes the changes that have come for this frame and poses the scene. Returns how many updates there
 * were. */
static size_t simulate(struct daemon *d, uint64_t frame, size_t *out_change_count) {
    const double wall_s = wall_time(d, frame);
    struct lw_scene_change *change;
    size_t count = lw_server_take_updates(d->server, frame, &change, out_change_count);
    for (size_t i = 0; i < *out_change_count; i++) lw_scene_state_change(&d->state, &change[i], wall_s);
    free(change);
    lw_scene_state_pose(&d->state, wall_s, &d->pose);
    return count;
}

/* Sleeps in short pieces, so that a stop is heard within a tenth of a second. */
static void wait_until(const struct daemon *d, uint64_t deadline_ns) {
    for (uint64_t now; !should_stop(d) && (now = lw_clock_ns()) < deadline_ns;) {
        uint64_t rest = deadline_ns - now < 100000000u ? deadline_ns - now : 100000000u;
        nanosleep(&(struct timespec){.tv_sec = 0, .tv_nsec = (long)rest}, NULL);
    }
}

static bool wants_something(const struct daemon *d, const struct lw_server_interest *wanted) {
    for (uint32_t id = 0; !wanted->everything && id < d->atlas_map.tile_count; id++)
        if (wanted->levels[id]) return true;
    return wanted->everything;
}

/* Tells the solver what clients look at, if that has changed. */
static enum lw_status follow_clients(struct daemon *d, struct lw_error *err) {
    struct lw_server_interest wanted;
    if (d->settings.light != LIGHT_SEEN || !lw_server_take_interest(d->server, &wanted)) return LW_OK;
    d->is_looked_at = wants_something(d, &wanted);
    d->interest = wanted.number;
    d->prepares = false;
    enum lw_status status = d->solver->ops->set_interest(d->solver, wanted.levels, err);
    free(wanted.levels);
    return status;
}

/* While nobody looks, all of the scene is solved from the second frame on, until it has been for --prepare
 * seconds. */
static enum lw_status prepare(struct daemon *d, uint64_t frame, struct lw_error *err) {
    const struct settings *s = &d->settings;
    const bool wanted = s->light == LIGHT_SEEN && s->clock == CLOCK_REAL && frame > d->first &&
                        !d->is_looked_at && (double)d->prepared_ns < 1e9 * s->prepare_s;
    if (wanted == d->prepares || d->is_looked_at) return LW_OK;
    d->prepares = wanted;
    return wanted ? d->solver->ops->set_interest(d->solver, NULL, err) : solve_nothing(d, err);
}

/* The channels that clients take, and those that they took within CHANNEL_LINGERS_NS. Without clients, they
 * stay. Time is that of the scene's clock, since they decide what is solved, and runs must be
 * repeatable. */
static uint32_t choose_channels(struct daemon *d, uint64_t frame) {
    const uint32_t taken = lw_server_channels_taken(d->server);
    const uint64_t now_ns =
        d->settings.clock == CLOCK_REAL ? lw_clock_ns() : 1 + (uint64_t)(1e9 * wall_time(d, frame));
    uint32_t channels = taken;
    for (unsigned f = 0; f < LW_TILE_CHANNELS_MAX; f++) {
        if (taken >> f & 1) d->taken_ns[f] = now_ns;
        if (d->taken_ns[f] && now_ns - d->taken_ns[f] < CHANNEL_LINGERS_NS) channels |= d->channels & 1u << f;
    }
    return taken ? channels : d->channels;
}

/* Once light is shown, lack of memory for what more sessions want ends nothing: they wait, and each frame
 * tries again. True: they do, and *err is empty. */
static bool may_wait(const struct daemon *d, enum lw_status status, const char *what, bool *waits,
                     struct lw_error *err) {
    const bool waited = *waits;
    *waits = status == LW_NO_MEMORY && d->lit;
    if (*waits) *err = (struct lw_error){0};
    if (*waits && !waited)
        lw_log(LW_LOG_WARNING,
               "out of memory for %s: clients keep the light that they have until it is there", what);
    else if (waited && status == LW_OK)
        lw_log(LW_LOG_INFO, "there is memory for %s again", what);
    return *waits;
}

static enum lw_status show_channels(struct daemon *d, uint32_t channels, struct lw_error *err) {
    if (channels == d->channels) return LW_OK;
    enum lw_status status = lw_publisher_set_channels(d->publisher, channels);
    if (may_wait(d, status, "another form of the light", &d->owes_channel, err)) return LW_OK;
    if (status != LW_OK) return lw_status_fail(err, status, "publisher");
    d->solver->ops->show(d->solver, channels);
    d->channels = channels;
    return LW_OK;
}

/* Ids of tiles of finer levels are free again with a snapshot that knows the newest list of interest: one is
 * due where they run short. */
static bool owes_ids(const struct daemon *d) {
    const struct lw_atlas_map *map = &d->atlas_map;
    return map->fine && d->interest > d->published_interest &&
           lw_fine_ids_free_count(map->fine) < lw_atlas_map_room(map) / 4;
}

/* Whether relays listen by NATS. */
static bool has_relays(const struct daemon *d) {
    struct lw_nats_publisher_stats stats = {.relays = 0};
    if (d->nats) lw_nats_publisher_get_stats(d->nats, &stats);
    return stats.relays > 0;
}

/* Sessions need new transforms even if no tile in their interest set was solved, and a session that sent an
 * update waits for its frame. */
static bool has_news(struct daemon *d, const struct lw_solver_stats *solve, size_t updates) {
    struct lw_server_stats serve;
    lw_server_get_stats(d->server, &serve);
    d->moved |= solve->moved;
    return solve->tiles_shown > 0 || updates > 0 || (d->moved && (serve.sessions_now > 0 || has_relays(d))) ||
           owes_ids(d);
}

/* *out_snapshot: stays NULL where there is no memory for it now. */
static enum lw_status publish_frame(struct daemon *d, uint64_t frame, uint64_t solve_ns, uint64_t tiles_shown,
                                    struct lw_snapshot **out_snapshot, struct lw_publisher_stats *out_stats,
                                    struct lw_error *err) {
    const enum lw_status status = lw_publisher_publish(d->publisher, &d->pose, frame, solve_ns, d->rays_total,
                                                       tiles_shown, out_snapshot, out_stats);
    if (may_wait(d, status, "new light", &d->owes_snapshot, err)) return LW_OK;
    if (status != LW_OK)
        return lw_status_fail(err, status, "publishing frame %llu", (unsigned long long)frame);
    (*out_snapshot)->interest = d->published_interest = d->interest;
    lw_server_publish(d->server, *out_snapshot);
    if (d->nats) lw_nats_publisher_publish(d->nats, *out_snapshot);
    d->published = frame;
    d->moved = false;
    return LW_OK;
}

/* Whether the first light is held back, to be better soon. Who has changed the scene does not wait. */
static bool is_too_young(struct daemon *d, uint64_t frame, const struct lw_solver_stats *solve,
                         size_t updates) {
    const struct settings *s = &d->settings;
    const bool goes_on = s->light != LIGHT_SEEN || d->is_looked_at || s->prepare_s > 0;
    return s->clock == CLOCK_REAL && !d->lit && !d->channels_kept && !updates && goes_on &&
           solve->tiles_solved && d->young.rounds < FIRST_ROUNDS &&
           frame - d->first + 1 != (uint64_t)s->frames && lw_clock_ns() - d->young.lit_ns < FIRST_NS;
}

static void note_young(struct daemon *d, const struct lw_solver_stats *solve, uint64_t began_ns) {
    if (!d->young.rounds++) {
        d->young.lit_ns = lw_clock_ns();
        d->young.frame_ns = d->young.lit_ns - began_ns;
        d->young.texels = solve->texels_solved;
    }
}

static void tell_first_light(struct daemon *d, const struct lw_solver_stats *solve) {
    const double after_s = (double)(lw_clock_ns() - d->started_ns) * 1e-9;
    lw_log(LW_LOG_INFO, "first light after %.1f s%s: %u texels in %u tiles, %.1f M rays, frame %.0f ms",
           after_s, solve->coarse ? ", coarse" : "", (unsigned)d->young.texels, solve->tiles,
           (double)d->rays_total * 1e-6, (double)d->young.frame_ns * 1e-6);
    lw_service_notify("STATUS=first light after %.1f s", after_s);
    lw_daemon_metrics_first_light(&d->metrics, after_s);
    d->lit = true;
    lw_waiting_raise(&d->first_light, LW_WAITING_READY, 1, 1);
}

static uint64_t memory_bytes(const struct daemon *d) {
    return d->solver->ops->memory_bytes(d->solver) + lw_publisher_memory_bytes(d->publisher);
}

/* Says when coarse light gives way to the light of the whole density. */
static void tell_whole_light(struct daemon *d, const struct lw_solver_stats *solve) {
    if (d->is_coarse && !solve->coarse) {
        const double after_s = (double)(lw_clock_ns() - d->started_ns) * 1e-9;
        const uint64_t bytes = memory_bytes(d);
        lw_log(LW_LOG_INFO, "all detail after %.1f s: %u tiles; %.0f MB for the solve", after_s, solve->tiles,
               (double)bytes * 1e-6);
        lw_daemon_metrics_memory(&d->metrics, bytes);
        lw_daemon_metrics_whole_light(&d->metrics, after_s);
    }
    d->is_coarse = solve->coarse;
}

static enum lw_status run_frame(struct daemon *d, uint64_t frame, bool *out_rested, struct lw_error *err) {
    struct lw_solver_stats solve = {0};
    struct lw_publisher_stats publish = {0};
    struct lw_snapshot *snapshot = NULL;
    struct frame_cost cost = {0};
    uint64_t began = lw_clock_ns(), cpu_began = work_cpu_ns(d);
    const size_t updates = simulate(d, frame, &cost.changes);
    enum lw_status status = follow_clients(d, err);
    if (status == LW_OK) status = prepare(d, frame, err);
    const uint32_t channels_before = d->channels;
    if (status == LW_OK) status = show_channels(d, choose_channels(d, frame), err);
    if (status == LW_OK) status = d->solver->ops->frame(d->solver, &d->pose, frame, &solve, err);
    if (status != LW_OK) return status;
    uint64_t cpu_solved = work_cpu_ns(d);
    cost.solve_cpu_ns = cpu_solved - cpu_began;
    d->rays_total += solve.rays_shadow + solve.rays_bounce + solve.rays_probe;
    if (!d->lit && solve.tiles_shown) note_young(d, &solve, began);
    /* A frame in which nothing was solved and nothing moved gives no snapshot and no bytes, unless a session
     * has asked for a channel that was not published. */
    const bool news =
        !is_too_young(d, frame, &solve, updates) &&
        (has_news(d, &solve, updates) || !d->lit || d->owes_snapshot || (d->channels & ~channels_before));
    *out_rested = !news && !solve.tiles_solved;
    if (news) {
        status = publish_frame(d, frame, lw_clock_ns() - began, solve.tiles_shown, &snapshot, &publish, err);
        if (status != LW_OK) return status;
        *out_rested = d->owes_snapshot;
        cost.publish_cpu_ns = work_cpu_ns(d) - cpu_solved;
    }
    if (d->settings.keep) {
        lw_light_store_note(&d->light_store, snapshot, solve.tiles_solved > 0, solve.moved);
        if (!lw_light_store_save_sometimes(&d->light_store, d->solver))
            lw_daemon_metrics_save_failed(&d->metrics);
    }
    lw_snapshot_unref(snapshot);
    cost.wall_ns = lw_clock_ns() - began;
    if (d->prepares) d->prepared_ns += cost.wall_ns;
    if (news && !d->lit) tell_first_light(d, &solve);
    tell_whole_light(d, &solve);
    lw_daemon_metrics_frame(&d->metrics,
                            &(struct lw_daemon_metrics_frame){.number = frame,
                                                              .wall_ns = cost.wall_ns,
                                                              .solve_cpu_ns = cost.solve_cpu_ns,
                                                              .publish_cpu_ns = cost.publish_cpu_ns,
                                                              .changes = cost.changes,
                                                              .solve = &solve,
                                                              .publish = &publish});
    d->frame_count++;
    if (solve.tiles_solved || news)
        lw_log(LW_LOG_DEBUG, "frame %llu: %.1f ms, %u tiles solved, %u shown, %zu changes",
               (unsigned long long)frame, (double)cost.wall_ns * 1e-6, (unsigned)solve.tiles_solved,
               (unsigned)solve.tiles_shown, cost.changes);
    if (d->settings.json) print_frame(d, frame, &cost, &solve, &publish);
    return LW_OK;
}

/* ---- whether the solver makes progress ---- */

/* What begins now is done within the limit, or the solver hangs. */
static void expect_progress(struct daemon *d) {
    const double limit_s = d->settings.stall_s * (d->lit ? 1 : STALL_FIRST);
    d->solver_due_ns = lw_clock_ns() + (uint64_t)(limit_s * 1e9);
}

static void rest(struct daemon *d) { d->solver_due_ns = UINT64_MAX; }

/* [loop] */
static bool is_stalled(const struct daemon *d) { return lw_clock_ns() > d->solver_due_ns; }

/* [loop] A service manager starts a server again that does not say WATCHDOG=1. */
static void on_beat(void *context) {
    struct daemon *d = context;
    struct lw_server_stats serve;
    lw_server_get_stats(d->server, &serve);
    if (is_stalled(d)) {
        if (!d->told_stall) lw_log(LW_LOG_ERROR, "the solver has made no progress within --stall-limit");
        d->told_stall = true;
        lw_service_notify("STATUS=the solver has made no progress within --stall-limit");
        return;
    }
    d->told_stall = false;
    const unsigned long long frames = d->frame_count;
    const struct lw_waiting_state first_light = lw_waiting_read(&d->first_light);
    char waiting[LW_WAITING_LINE_SIZE];
    lw_waiting_line(first_light.stage, first_light.share, waiting);
    if (frames)
        lw_service_notify("WATCHDOG=1\nSTATUS=%llu frames, %llu sessions", frames,
                          (unsigned long long)serve.sessions_now);
    else
        lw_service_notify("WATCHDOG=1\nSTATUS=no light yet: %s; %llu sessions", waiting,
                          (unsigned long long)serve.sessions_now);
}

/* [loop] */
static void on_stopping(void *context) {
    struct daemon *d = context;
    d->stops = true;
    if (d->succession.relays)
        lw_service_notify("WATCHDOG=1\nSTATUS=going over to what has changed");
    else
        lw_service_notify("STOPPING=1\nWATCHDOG=1\nSTATUS=stopping");
}

/* [loop] Light of the last run is light, too. */
static bool on_page(void *context, const char *path, struct lw_server_page *out_page) {
    struct daemon *d = context;
    struct lw_server_stats serve;
    lw_server_get_stats(d->server, &serve);
    struct lw_nats_publisher_stats nats;
    if (d->nats) lw_nats_publisher_get_stats(d->nats, &nats);
    const struct lw_daemon_metrics_state state = {.nats = d->nats ? &nats : NULL,
                                                  .is_lit = d->lit || d->channels_kept,
                                                  .is_stalled = is_stalled(d),
                                                  .is_stopping = d->stops,
                                                  .first_light = lw_waiting_read(&d->first_light)};
    return lw_daemon_metrics_page(&d->metrics, path, &state, &serve, out_page);
}

static void on_reload(void *context);

static struct lw_server_hooks hooks_of(struct daemon *d) {
    struct lw_server_hooks hooks = {
        .context = d, .stopping = on_stopping, .reload = on_reload, .page = on_page};
    if (lw_service_notify_wanted()) {
        const unsigned watchdog_ms = lw_service_notify_watchdog_ms();
        hooks.beat = on_beat;
        hooks.beat_ms = watchdog_ms && watchdog_ms < STATUS_MS ? watchdog_ms : STATUS_MS;
    }
    return hooks;
}

/* Under the manual clock: whether another line came. Waits in short pieces, as wait_until(). */
static bool await_line(const struct daemon *d) {
    while (!should_stop(d)) {
        struct pollfd input = {.fd = STDIN_FILENO, .events = POLLIN};
        if (poll(&input, 1, 100) <= 0) continue;
        char c;
        ssize_t size = read(STDIN_FILENO, &c, 1);
        if (size == 0 || (size < 0 && errno != EINTR)) return false;
        if (size == 1 && c == '\n') return true;
    }
    return false;
}

/* solver: NULL in the middle of a frame */
static void save_light(struct daemon *d, const struct lw_solver *solver) {
    if (!d->settings.keep || lw_light_store_save(&d->light_store, solver, &d->solver_error) == LW_OK) return;
    lw_daemon_metrics_save_failed(&d->metrics);
}

static void solve_frames(struct daemon *d) {
    const struct settings *s = &d->settings;
    const uint64_t interval_ns = (uint64_t)(1e9 / s->frame_rate);
    bool rested = false;
    for (uint64_t frame = d->first; !should_stop(d) && (!s->frames || frame - d->first < (uint64_t)s->frames);
         frame++) {
        rest(d);
        if (s->clock == CLOCK_MANUAL && !await_line(d)) break;
        expect_progress(d);
        uint64_t began = lw_clock_ns();
        enum lw_status status = run_frame(d, frame, &rested, &d->solver_error);
        if (status != LW_OK) { /* LW_CLOSED, without an error: stopped in the middle of a frame */
            if (status == LW_CLOSED) save_light(d, NULL);
            return;
        }
        /* Under the step clock frames follow each other at once while there is work; at rest they keep the
         * pace. */
        if (s->clock == CLOCK_REAL || (s->clock == CLOCK_STEP && rested && !s->frames)) {
            rest(d);
            wait_until(d, began + interval_ns);
        }
    }
    expect_progress(d);
    save_light(d, d->solver);
}

/* Lowers the priority of the solver's thread; its workers inherit that. The loop's thread needs a core for
 * short moments only, but a new client waits for it. Linux has a priority for each thread; on systems with
 * one for the process, it stays. */
static void give_way(void) {
#if defined(__linux__)
    errno = 0;
    const int priority = getpriority(PRIO_PROCESS, 0);
    if (errno == 0) (void)setpriority(PRIO_PROCESS, 0, priority + SOLVER_NICE);
#endif
}

static void log_scene(const struct daemon *d, uint64_t bytes) {
    char finishes[40] = "";
    if (d->finishes_size)
        snprintf(finishes, sizeof finishes, " and %.1f MB of finishes", (double)d->finishes_size * 1e-6);
    lw_log(LW_LOG_INFO, "%s: %u objects, %u tiles; %.0f MB for the solve, package %.1f MB%s",
           d->settings.scene.path, d->scene->object_count, d->atlas_map.tile_count, (double)bytes * 1e-6,
           (double)d->package_size * 1e-6, finishes);
}

/* Texels and rays' structure are built while clients already get the scene package. */
static void *solve_in_thread(void *argument) {
    struct daemon *d = argument;
    give_way();
    if (d->solver || set_up_solver(d, &d->solver_error) == LW_OK) {
        lw_daemon_metrics_memory(&d->metrics, memory_bytes(d));
        log_scene(d, memory_bytes(d));
        d->first = 1;
        if (d->settings.keep) d->first += lw_light_store_resume(&d->light_store, &d->atlas_map, d->solver);
        if (!d->channels_kept || show_channels(d, d->channels_kept, &d->solver_error) == LW_OK)
            solve_frames(d);
    }
    rest(d);
    lw_server_stop(d->server);
    return NULL;
}

/* What to set, if that was too little memory. */
static void explain_memory(const struct daemon *d, struct lw_error *err) {
    uint64_t texels = 0, triangles = 0;
    struct rusage usage;
    if (err->status != LW_NO_MEMORY || getrusage(RUSAGE_SELF, &usage) != 0) return;
    for (uint32_t i = 0; i < d->atlas_map.tile_count; i++)
        if (d->atlas_map.place[i].level == 0)
            texels += (uint64_t)d->atlas_map.place[i].width * d->atlas_map.place[i].height;
    for (uint32_t o = 0; o < d->scene->object_count; o++)
        triangles += d->scene->mesh[d->scene->object[o].mesh].triangle_count;
    const struct lw_error cause = *err;
    *err = (struct lw_error){0};
    lw_status_fail(err, LW_NO_MEMORY,
                   "out of memory at %.0f MB (%s), with %llu texels and %llu triangles: fewer texels with "
                   "--max-texels %llu or --texels-per-metre, less for each with --light-groups none",
                   (double)usage.ru_maxrss * 1024e-6, cause.text, (unsigned long long)texels,
                   (unsigned long long)triangles, (unsigned long long)texels / 2);
}

/* CLOCK_REALTIME, as pthread_timedjoin_np() has it. */
static struct timespec in_seconds(unsigned seconds) {
    return (struct timespec){.tv_sec = (time_t)(lw_clock_read_ns(CLOCK_REALTIME) / 1000000000u) + seconds};
}

/* Saved light is of a whole frame: one that ends soon is waited for; a longer one is given up, and the light
 * of the frame before it is saved, without sums. */
static void join_solver(struct daemon *d) {
    const struct timespec until = in_seconds(STOP_WAIT_S);
    d->cancel = !d->settings.keep || !d->lit;
    if (pthread_timedjoin_np(d->solver_thread, NULL, &until) == 0) return;
    lw_log(LW_LOG_INFO, "the frame under way is given up: it takes longer than %u s", STOP_WAIT_S);
    d->cancel = true;
    pthread_join(d->solver_thread, NULL);
}

static enum lw_status serve(struct daemon *d, struct lw_error *err) {
    const struct settings *s = &d->settings;
    enum lw_status status = lw_serve_options_write_ports(&s->serve, d->server, err);
    if (status != LW_OK) return status;
    char address[LW_SERVE_OPTIONS_WHERE_SIZE];
    lw_serve_options_where(&s->serve, d->server, address, sizeof address);
    lw_log(LW_LOG_INFO, "serving %s at %s", s->scene.path, address);
    tell_client_lights(d);
    const char *name = strrchr(d->argv[0], '/'); /* the viewer lies beside it */
    lw_log(LW_LOG_INFO, "look at it: %.*slightwell-view %s     stop it: Ctrl-C",
           name ? (int)(name + 1 - d->argv[0]) : 0, d->argv[0], address);
    lw_serve_options_tell(&s->serve, d->server);
    expect_progress(d);
    if (pthread_create(&d->solver_thread, NULL, solve_in_thread, d) != 0) {
        lw_serve_options_remove_ports(&s->serve);
        return lw_status_fail(err, LW_OS, "cannot start the solver's thread");
    }
    lw_service_notify("READY=1\nSTATUS=serving at %s, no light yet", address);
    status = lw_server_run(d->server, err);
    d->stopping = true;
    join_solver(d);
    if (status == LW_OK && d->solver_error.status != LW_OK) {
        *err = d->solver_error;
        status = err->status;
        explain_memory(d, err);
    }
    if (!d->succession.relays) lw_serve_options_remove_ports(&s->serve);
    return status;
}

/* A hash of all that the shown light depends on: the scene before updates, and options. Options of
 * convergence, network and speed are not part of it. */
static void make_key(const struct daemon *d, uint8_t out_key[LW_SAVED_LIGHT_KEY_SIZE]) {
    const struct settings *s = &d->settings;
    struct lw_package_hash hash;
    char text[640];
    const char *groups = s->light_groups ? s->light_groups : "";
    int length = print_hash(text, d->package, d->package_size);
    if (d->finishes_size) length += print_hash(text + length, d->finishes, d->finishes_size);
    length += print_hash(text + length, groups, strlen(groups));
    length += print_hash(text + length, d->light_bits, lw_client_lights_bytes(d->scene->light_count));
    length += print_hash(text + length, d->material_bits, lw_client_lights_bytes(d->scene->material_count));
    length += snprintf(
        text + length, sizeof text - (size_t)length,
        " " LW_VERSION " solver %s bounces %lld samples %lld %lld seed %lld range %a cell %a probes %d %a "
        "denoise %d codec %d freeze %d %a directions %d",
        s->entry->name, (long long)s->bounces, (long long)s->direct_samples, (long long)s->indirect_samples,
        (long long)s->seed, s->probes.tracing_range_m, s->probes.cell_size_m, s->probes.form,
        s->probes.probe_spacing_m, s->denoise, s->codec, s->freeze, s->freeze_s, d->has_directions);
    lw_package_hash((const uint8_t *)text, (size_t)length, &hash);
    memcpy(out_key, hash.bytes, LW_SAVED_LIGHT_KEY_SIZE);
}

/* Clients get it as soon as the server runs, seconds before the solver has texels to light. */
static enum lw_status recall_light(struct daemon *d, struct lw_error *err) {
    uint8_t key[LW_SAVED_LIGHT_KEY_SIZE];
    make_key(d, key);
    enum lw_status status = lw_light_store_init(&d->light_store, d->settings.keep, key, err);
    if (status != LW_OK) {
        lw_status_context(err, "--keep");
        return status;
    }
    struct lw_snapshot *snapshot =
        lw_light_store_recall(&d->light_store, &d->atlas_map, (float)d->settings.error);
    if (!snapshot) return LW_OK;
    lw_server_publish(d->server, snapshot);
    if (d->nats) lw_nats_publisher_publish(d->nats, snapshot);
    d->published = snapshot->frame;
    d->channels_kept = snapshot->channels;
    lw_snapshot_unref(snapshot);
    return LW_OK;
}

/* sockets: of the server before; NULL: there was none */
static enum lw_status create_server(struct daemon *d, struct lw_server_sockets *sockets,
                                    struct lw_error *err) {
    struct settings *s = &d->settings;
    struct lw_server_desc desc = {.sockets = sockets,
                                  .atlas_map = &d->atlas_map,
                                  .package = d->package,
                                  .package_size = d->package_size,
                                  .finishes = d->finishes,
                                  .finishes_size = d->finishes_size,
                                  .bounces = (uint32_t)s->bounces,
                                  .channels =
                                      s->entry->channels & lw_tile_channels_held(false, d->has_directions),
                                  .target_error = (float)s->error,
                                  .noise_shown = noise_shown(s),
                                  .first_light = &d->first_light,
                                  .client_lights = d->light_bits,
                                  .client_lights_size = lw_client_lights_bytes(d->scene->light_count),
                                  .client_materials = d->material_bits,
                                  .client_materials_size = lw_client_lights_bytes(d->scene->material_count),
                                  .scene = d->scene,
                                  .hooks = hooks_of(d),
                                  .features = s->codec == CODEC_DCT ? LW_FEATURE_DCT : 0};
    lw_serve_options_fill(&s->serve, &desc);
    return lw_server_create(&desc, &d->server, err);
}

/* In the publisher's thread. */
static void on_relays_want(void *context, const struct lw_nats_publisher_wants *wants) {
    const struct daemon *d = context;
    if (!lw_server_set_outside(d->server, wants->channels, wants->everything, wants->tile, wants->tile_count))
        lw_log(LW_LOG_WARNING, "out of memory for what relays want: they get what was wanted before");
}

/* follows: a server before it has served: then a failure ends nothing. */
static enum lw_status join_nats(struct daemon *d, bool follows, struct lw_error *err) {
    const struct settings *s = &d->settings;
    struct lw_server_scene scene;
    struct lw_error cause = {0};
    if (!s->nats) return LW_OK;
    enum lw_status status = lw_server_get_scene(d->server, &scene);
    if (status != LW_OK) return lw_status_fail(err, status, "out of memory");
    status = lw_nats_publisher_create(
        &(struct lw_nats_publisher_desc){.address = &s->nats_address,
                                         .map = &d->atlas_map,
                                         .object_count = d->scene->object_count,
                                         .light_count = d->scene->light_count,
                                         .run = scene.run,
                                         .welcome = scene.welcome,
                                         .chunk = scene.chunk,
                                         .chunk_count = scene.chunk_count,
                                         .finish_chunk = scene.finish_chunk,
                                         .finish_chunk_count = scene.finish_chunk_count,
                                         .wants = on_relays_want,
                                         .context = d},
        &d->nats, &cause);
    lw_server_scene_finish(&scene);
    if (status == LW_OK)
        lw_log(LW_LOG_INFO, "relays find the light at %s", s->nats_address.name);
    else if (follows)
        lw_log(LW_LOG_ERROR, "relays find no light: --nats: %s", cause.text);
    else
        return lw_status_fail(err, status, "--nats: %s", cause.text);
    return LW_OK;
}

static enum lw_status run(struct daemon *d, struct lw_error *err) {
    const struct settings *s = &d->settings;
    d->started_ns = lw_clock_ns();
    lw_waiting_raise(&d->first_light, LW_WAITING_PLACING_TEXELS, 0, 0);
    const bool follows = d->server != NULL;
    if (!d->server) { /* it follows nobody */
        enum lw_status status = read_scene(d, err);
        if (status != LW_OK) return status;
        /* Binds the port before the long work, so that an address in use fails at once. */
        if ((status = create_server(d, NULL, err)) != LW_OK) return status;
    }
    enum lw_status status = join_nats(d, follows, err);
    if (status == LW_OK && s->keep) status = recall_light(d, err);
    if (status != LW_OK) return status;
    if (signalled) return lw_status_fail(err, LW_CLOSED, "%s: stopped before it was lit", s->scene.path);
    return serve(d, err);
}

static void init(struct daemon *d, int argc, char **argv) {
    *d = (struct daemon){
        .argc = argc,
        .argv = argv,
        .channels = 1u << LW_LIGHT_FORM_FULL,
        .succession = {.sockets = {-1, -1, -1}},
        .settings = {.serve = LW_SERVE_OPTIONS_DEFAULTS,
                     .bounces = 2,
                     .detail = LW_ATLAS_FINER_MAX,
                     .detail_mb = -1,
                     .probes = {.tracing_range_m = (double)INFINITY},
                     .direct_samples = 1,
                     .indirect_samples = 2,
                     .denoise = 1,
                     .light = LIGHT_SEEN,
                     .codec = CODEC_DCT,
                     .tile_step = (double)LW_PUBLISHER_STEP_WIDEST,
                     .frame_rate = 30,
                     .frame_budget_ms = BUDGET_MS,
                     .frame_budget_units = (double)INFINITY,
                     .seed = 1,
                     .stall_s = STALL_S,
                     .prepare_s = PREPARE_S,
                     .log_level = LW_LOG_INFO,
                     .error = (double)TARGET_ERROR,
                     .scene = {.sun_angle_deg = LW_SCENE_OPEN_SUN_DIAMETER_DEG, .cancel = &signalled}}};
    (void)lw_folders_cache(d->settings.default_cache, sizeof d->settings.default_cache);
    d->settings.cache = d->settings.default_cache;
}

static void finish(struct daemon *d) {
    lw_nats_publisher_destroy(d->nats); /* it uses the server */
    lw_server_destroy(d->server);
    lw_daemon_metrics_finish(&d->metrics);
    lw_light_store_finish(&d->light_store);
    lw_publisher_destroy(d->publisher);
    d->cancel = true; /* the solver of the whole density may still be built */
    if (d->solver) d->solver->ops->destroy(d->solver);
    lw_light_groups_finish(&d->light_groups);
    lw_client_lights_finish(&d->client_lights);
    free(d->light_bits);
    free(d->material_bits);
    free(d->directional);
    lw_pose_finish(&d->pose);
    lw_scene_state_finish(&d->state);
    lw_atlas_map_finish(&d->atlas_map);
    free(d->package);
    free(d->finishes);
    lw_scene_destroy(d->scene);
    lw_options_config_finish(&d->settings.config);
    free(d->settings.printed);
}

/* ---- what follows at SIGHUP ---- */

/* Another daemon is made beside this one, of options and scene as they are now: its scene is read and its
 * solver set up in a thread, while this one serves. Then the server hands over its sockets and tells its
 * clients to come back at once; they find the other. What fails leaves this one as it was. */

/* [loop] Tells what cannot change, and takes that from d. False: out of memory. */
static bool keep_fixed(const struct daemon *d, struct daemon *next, bool *out_changed) {
    char key[LW_OPTIONS_CONFIG_NAME_MAX];
    struct settings *s = &next->settings;
    const struct settings *old = &d->settings;
    *out_changed = false;
    for (size_t at = 0; lw_options_config_difference(old->printed, s->printed, &at, key);) {
        size_t k = 0;
        while (fixed_keys[k] && strcmp(fixed_keys[k], key) != 0) k++;
        if (fixed_keys[k])
            lw_log(LW_LOG_WARNING, "%s is as it was until lightwelld is started again", key);
        else if (strcmp(key, "log-level") != 0)
            *out_changed = true;
    }
    const struct {
        const char **to;
        const char *from;
    } text[] = {{&s->serve.listen, old->serve.listen},
                {&s->serve.listen_unix, old->serve.listen_unix},
                {&s->serve.port_file, old->serve.port_file},
                {&s->serve.http, old->serve.http},
                {&s->serve.http_port_file, old->serve.http_port_file},
                {&s->serve.metrics, old->serve.metrics},
                {&s->serve.metrics_port_file, old->serve.metrics_port_file},
                {&s->serve.control_socket, old->serve.control_socket},
                {&s->nats, old->nats},
                {&s->keep, old->keep}};
    for (size_t i = 0; i < sizeof text / sizeof *text; i++) {
        *text[i].to = text[i].from ? lw_options_config_keep(&s->config, text[i].from) : NULL;
        if (text[i].from && !*text[i].to) return false;
    }
    s->clock = old->clock;
    s->json = old->json;
    s->frames = old->frames;
    s->log_format = old->log_format;
    return check(s, &(struct lw_error){0}) == LW_OK; /* addresses are in their parts again */
}

/* A file of these forms is all of its scene; others may read files beside it. */
static bool is_one_file(const char *path) {
    const char *ending = strrchr(path, '.');
    return ending && (strcasecmp(ending, ".glb") == 0 || strcasecmp(ending, ".lwscene") == 0);
}

static bool scene_may_have_changed(const struct daemon *d) {
    const struct lw_scene_open *scene = &d->settings.scene;
    if (strncmp(scene->path, "builtin:", 8) == 0) return false;
    const struct lw_file_stamp now = lw_file_stamp(scene->path),
                               environment_now = lw_file_stamp(scene->environment);
    return !is_one_file(scene->path) || !lw_file_stamp_equal(&now, &d->scene_stamp) ||
           !lw_file_stamp_equal(&environment_now, &d->environment_stamp);
}

static bool are_same_bytes(const uint8_t *a, size_t a_size, const uint8_t *b, size_t b_size) {
    return a_size == b_size && (!a_size || memcmp(a, b, a_size) == 0);
}

static enum lw_status prepare_next(struct daemon *d, bool *out_same, struct lw_error *err) {
    struct daemon *next = d->succession.next;
    enum lw_status status = read_scene(next, err);
    if (status != LW_OK) return status;
    *out_same = d->succession.only_scene &&
                are_same_bytes(next->package, next->package_size, d->package, d->package_size) &&
                are_same_bytes(next->finishes, next->finishes_size, d->finishes, d->finishes_size);
    if (*out_same) return LW_OK;
    status = create_server(next, &d->succession.sockets, err);
    if (status == LW_OK) status = set_up_solver(next, err);
    return status;
}

static void *succeed(void *argument) {
    struct daemon *d = argument;
    struct lw_error err = {0};
    bool same = false;
    give_way();
    const enum lw_status status = prepare_next(d, &same, &err);
    if (status == LW_OK && !same) {
        lw_log(LW_LOG_INFO, "options and scene have changed: clients go over to %s",
               d->succession.next->settings.scene.path);
        d->succession.relays = true;
        lw_server_relay(d->server);
        return NULL;
    }
    if (status == LW_OK) d->scene_stamp = d->succession.next->scene_stamp;
    d->succession.ended = true; /* before the line: who reads it may send the next SIGHUP at once */
    if (status == LW_OK)
        lw_log(LW_LOG_INFO, "%s is the same scene as before", d->settings.scene.path);
    else if (status != LW_CLOSED)
        lw_log(LW_LOG_ERROR, "options and scene stay as they were: %s", err.text);
    return NULL;
}

static void drop_next(struct daemon *d) {
    lw_server_sockets_close(&d->succession.sockets);
    if (d->succession.next) finish(d->succession.next);
    free(d->succession.next);
    d->succession.next = NULL;
    d->succession.ended = false;
    d->succession.runs = false;
}

static enum lw_status begin_succession(struct daemon *d, struct lw_error *err) {
    struct succession *u = &d->succession;
    bool changed, done;
    struct daemon *next = u->next = malloc(sizeof *next);
    if (!next) return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    init(next, d->argc, d->argv);
    next->isa = d->isa;
    enum lw_status status = parse(&next->settings, d->argc, d->argv, &done, err);
    if (status != LW_OK) return status;
    if (!keep_fixed(d, next, &changed)) return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    lw_log_set_level((enum lw_log_level)next->settings.log_level);
    u->only_scene = !changed;
    if (!changed && !scene_may_have_changed(d)) {
        lw_log(LW_LOG_INFO, "options and scene are as before");
        drop_next(d);
        return LW_OK;
    }
    lw_daemon_metrics_init(&next->metrics, next->isa, next->settings.entry->name);
    next->metrics.renderers = next->settings.renderers;
    if ((status = lw_server_share_sockets(d->server, &u->sockets, err)) != LW_OK) return status;
    u->runs = pthread_create(&u->thread, NULL, succeed, d) == 0;
    return u->runs ? LW_OK : lw_status_fail(err, LW_OS, "cannot start a thread");
}

/* At SIGHUP, in the loop's thread. */
static void on_reload(void *context) {
    struct daemon *d = context;
    struct lw_error err = {0};
    lw_server_reload(d->server);
    if (d->succession.runs && !d->succession.ended) {
        lw_log(LW_LOG_WARNING,
               "options and scene are being read since the last SIGHUP: send another one later");
        return;
    }
    if (d->succession.runs) pthread_join(d->succession.thread, NULL);
    drop_next(d);
    if (begin_succession(d, &err) == LW_OK) return;
    lw_log(LW_LOG_ERROR, "options and scene stay as they were: %s", err.text);
    drop_next(d);
}

/* What follows d, which has served; NULL: nothing does. *out_left: the thread is still at work, and what it
 * works on must stay. */
static struct daemon *successor(struct daemon *d, bool served, bool *out_left) {
    struct succession *u = &d->succession;
    const bool follows = served && u->relays && !(d->server && lw_server_was_signalled(d->server));
    if (u->runs && !follows) {
        signalled = true; /* an import and a solver in the making end */
        u->next->cancel = true;
        const struct timespec until = in_seconds(1 + DROP_WAIT_S);
        *out_left = pthread_timedjoin_np(u->thread, NULL, &until) != 0;
        if (*out_left) return NULL;
    } else if (u->runs) {
        pthread_join(u->thread, NULL);
    }
    u->runs = false;
    if (!follows) {
        drop_next(d);
        return NULL;
    }
    lw_server_sockets_close(&u->sockets);
    return u->next;
}

/* Arrays of a scene, which are large, are mapped by themselves and go back to the system with it. The C
 * library would raise that threshold to 32 MB as such arrays are freed, and later scenes would leave the heap
 * in pieces. */
static void map_large_arrays(void) {
    mallopt(M_MMAP_THRESHOLD, MAPPED_MIN);
    mallopt(M_TRIM_THRESHOLD, 8 * MAPPED_MIN); /* what frames free is not given back each time */
}

int main(int argc, char **argv) {
    map_large_arrays();
    struct daemon *d = malloc(sizeof *d);
    struct lw_error err = {0};
    bool done = false, left = false;
    lw_log_init("lightwelld", LW_LOG_INFO);
    lw_wait_passively(argv);
    if (!d) return lw_log_failure(&(struct lw_error){.status = LW_NO_MEMORY});
    init(d, argc, argv);
    enum lw_status status = parse(&d->settings, argc, argv, &done, &err);
    if (status == LW_OK) { /* a mistake in the options is told as text */
        lw_log_init("lightwelld", (enum lw_log_level)d->settings.log_level);
        lw_log_set_format((enum lw_log_format)d->settings.log_format);
    }
    if (status == LW_OK && !done) status = lw_trace_check_isa(&d->isa, &err); /* before anybody is served */
    if (status == LW_OK && !done) {
        lw_interrupt_watch(on_early_signal, NULL);
        /* Until the loop watches for it: who asks to read again what is being read must not end us. A
         * terminal that closes still does. */
        if (!isatty(STDERR_FILENO)) signal(SIGHUP, SIG_IGN);
        lw_daemon_metrics_init(&d->metrics, d->isa, d->settings.entry->name);
        d->metrics.renderers = d->settings.renderers;
        status = run(d, &err);
        for (struct daemon *next; (next = successor(d, status == LW_OK, &left)) != NULL;) {
            finish(d);
            free(d);
            malloc_trim(0); /* else memory that each scene leaves free in pieces adds up */
            d = next;
            status = run(d, &err);
        }
        if (status == LW_CLOSED) status = LW_OK; /* stopped by a signal before it served */
        if (status == LW_OK) lw_log(LW_LOG_INFO, "stopped");
    }
    if (left) /* the process ends, and with it that thread */
        _exit(status == LW_OK ? 0 : lw_log_failure(&err));
    finish(d);
    free(d);
    return status == LW_OK ? 0 : lw_log_failure(&err);
}
