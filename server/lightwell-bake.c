/* lightwell-bake.c: the solver used offline: lightmaps as files, for any engine.
 * Flow:    options -> scene -> solver -> frames until there is enough light -> EXRs, .glb, index.json
 * Threads: main; the solver's own workers inside a frame. */
#include "common/base/atomic_file.h"
#include "common/base/folders.h"
#include "common/base/interrupt.h"
#include "common/base/log.h"
#include "common/base/options.h"
#include "common/base/progress.h"
#include "common/base/wait_policy.h"
#include "common/builtin/builtin.h"
#include "common/light/client_lights.h"
#include "common/lightmap/lightmap.h"
#include "common/open/scene_open.h"
#include "common/scene/finish_package.h"
#include "common/scene/package.h"
#include "server/bake/bake.h"
#include "server/bake/bake_memory.h"
#include "server/bake/direction_maps.h"
#include "server/bake/glb_scene.h"
#include "server/bake/manifest.h"
#include "server/bake/map_names.h"
#include "server/bake/sides.h"
#include "server/probe_options.h"
#include "server/solve/solvers.h"

#include <errno.h>
#include <libgen.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define PROGRAM           "lightwell-bake"
#define DEFAULT_ERROR     0.02
#define DEFAULT_BOUNCES   4
#define DEFAULT_INTERVAL  180
#define STATE_NAME        ".lightwell-bake-state"
#define TILES_NAME        ".lightwell-bake-tiles"
#define DIRECTIONS_FOLDER "directions"
#define MANIFEST_NAME     "index.json"
#define NOISIEST_SHOWN    3
#define BOTH_SIDES_SHARE  0.1 /* share of an object's double-sided area: from here on it is named */

struct settings {
    struct lw_scene_open scene;
    const char *output, *gltf_out, *client_lights, *solver, *visibility;
    const struct lw_solvers_entry *entry; /* the solver's */
    int64_t samples, bounces, seed;
    double error, subdivide, vpl_near, time_s, limit_s, interval_s;
    struct lw_probe_options probes;
    bool samples_given, error_given, as_float, gltf_lights, gltf_split_sides, denoise, restart, indirect_only,
        keep_visibility, directional, direction_form_given;
    int convention, direction_form, sides, undersample;
    int64_t window, directions, vpl_lights, vpl_sets, memory_mb;
};

struct baker {
    struct settings settings;
    const struct lw_convention *convention;
    struct lw_scene *scene;
    struct lw_atlas_map atlas_map;
    struct lw_pose pose;
    struct lw_client_lights left_out; /* the maps lack their direct light; zeroed: nobody's */
    char *left_out_names;             /* NULL likewise; apart by commas */
    uint32_t channel;                 /* the maps' channel */
    struct lw_solver *solver;
    struct lw_bake_desc bake;
    struct lw_bake_result result;
    struct lw_map_names names;
    struct lw_manifest manifest;
    struct lw_glb_scene glb;
    char *state_path, *tiles_path, *map_folder;
    bool by_tile; /* texels at once would take too much memory */
    uint32_t maps_as_float;
    struct lw_sides sides;
    uint32_t one_sided_count; /* maps of which one side is shown though both matter */
    const char *one_sided;    /* the first one's object */
    struct noisy {
        const char *object;
        float error;
    } noisiest[NOISIEST_SHOWN]; /* falling */
};

/* A handler can reach nothing but globals. */
static _Atomic bool signalled;

static void on_signal(int number) {
    (void)number;
    signalled = true;
}

#define AGAIN   "; Ctrl-C again ends it at once"
#define NOTHING "stopped before the lighting began; nothing is written"
static const struct lw_interrupt_phase reading = {.answer = "stopping"};
static const struct lw_interrupt_phase preparing = {.answer = NOTHING, .ends = true};
static const struct lw_interrupt_phase lighting = {
    .answer = "stopping: finishing the samples under way, then writing the maps" AGAIN};
static const struct lw_interrupt_phase writing = {.answer = "the maps are lit, and being written" AGAIN};

/* ---- options ---- */

/* Options that decide a solver's samples. */
static struct lw_solver_desc solver_desc(const struct settings *s) {
    return (struct lw_solver_desc){.bounces = (uint32_t)s->bounces,
                                   LW_PROBE_OPTIONS_DESC(&s->probes),
                                   .radiosity = {.keeps_visibility = s->keep_visibility || s->visibility,
                                                 .visibility_path = s->visibility,
                                                 .undersample = (enum lw_undersample)s->undersample,
                                                 .subdivide = (float)s->subdivide,
                                                 .directions = (uint32_t)s->directions,
                                                 .window = (uint32_t)s->window},
                                   .vpl = {.lights = (uint32_t)s->vpl_lights,
                                           .sets = (uint32_t)s->vpl_sets,
                                           .near_m = (float)s->vpl_near},
                                   .direct_samples = 1,
                                   .indirect_samples = 1,
                                   .target_error = s->samples ? -1 : (float)s->error,
                                   .frames_max = (uint32_t)s->samples,
                                   .directions = s->directional,
                                   .threads = (unsigned)s->scene.threads,
                                   .finishing = &signalled,
                                   .seed = (uint32_t)s->seed};
}

static enum lw_status check(const struct settings *s, struct lw_error *err) {
    if (!s->output) return lw_status_fail(err, LW_USAGE, "-o DIR is missing: say where the maps shall go");
    if (s->samples_given && s->error_given)
        return lw_status_fail(err, LW_USAGE, "--samples and --error exclude each other");
    if (s->client_lights && !s->indirect_only)
        return lw_status_fail(err, LW_USAGE, "--client-lights is for --indirect-only");
    if ((s->gltf_lights || s->gltf_split_sides) && !s->gltf_out)
        return lw_status_fail(err, LW_USAGE, "--gltf-%s is for --gltf-out FILE.glb",
                              s->gltf_lights ? "lights" : "split-sides");
    if (s->gltf_split_sides && s->sides != LW_SIDES_AUTO)
        return lw_status_fail(err, LW_USAGE,
                              "--gltf-split-sides shows both sides: --sides has no use beside it");
    if (s->gltf_out) {
        const size_t length = strlen(s->gltf_out);
        if (length < 5 || strcasecmp(s->gltf_out + length - 4, ".glb") != 0)
            return lw_status_fail(err, LW_USAGE, "--gltf-out %s: the name must end in .glb", s->gltf_out);
    }
    return LW_OK;
}

static enum lw_status parse(struct settings *s, int argc, char **argv, bool *out_done, struct lw_error *err) {
    const char *scene[1] = {NULL};
    char about[2048], names[128], solvers[192];
    lw_solvers_list(names, sizeof names);
    snprintf(solvers, sizeof solvers, "what computes the light: %s", names);
    int length =
        snprintf(about, sizeof about,
                 "Lights a scene and writes one OpenEXR lightmap per object, with an index.json that says "
                 "which is whose.\n"
                 "It ends when every texel has its samples (--samples) or every tile its error (--error). "
                 "Ctrl-C ends it "
                 "earlier with the light so far; the same command then goes on where it stopped.\n"
                 "SCENE is anything that lightwell-import reads, a scene package (.lwscene), or built in:");
    for (unsigned i = 0; lw_builtin_name(i) && length > 0 && (size_t)length < sizeof about; i++)
        length += snprintf(about + length, sizeof about - (size_t)length, "\n  %s  %s", lw_builtin_name(i),
                           lw_builtin_about(i));
    if (length > 0 && (size_t)length < sizeof about)
        snprintf(
            about + length, sizeof about - (size_t)length,
            "\nExample: lightwell-bake room.glb -o room-maps --convention three --gltf-out room-lit.glb\n"
            "Exit codes are those of sysexits.h; 75 after Ctrl-C. How to load the maps: docs/baking.md");
    const struct lw_option table[] = {
        {"o", "DIR", "where the maps go; made if it is not there. Required", LW_OPTION_STRING, &s->output, 0,
         0, NULL},
        {"samples", "N", "rays per texel towards each kind of light, and bounce rays, instead of --error",
         LW_OPTION_INT, &s->samples, 1, 1e6, &s->samples_given},
        {"error", "E", "relative standard error that every tile of 64 x 64 texels gets under (default {})",
         LW_OPTION_REAL, &s->error, 1e-5, 1, &s->error_given},
        {"solver", "NAME", solvers, LW_OPTION_STRING, &s->solver, 0, 0, NULL},
        {"undersample", LW_UNDERSAMPLE_CHOICES,
         "radiosity: which texels of a window shoot for it: each (none{none|, default}), the first, one "
         "drawn "
         "for each sample, their mean",
         LW_OPTION_CHOICE, &s->undersample, 0, 0, NULL},
        {"window", "N",
         "radiosity: texels a side of such a window (default: 1/128 of the side of a square of all texels)",
         LW_OPTION_INT, &s->window, 1, LW_TILE_SIDE, NULL},
        {"subdivide", "T",
         "radiosity: squares of up to 16 x 16 texels shoot as one where half their difference in light and "
         "in normal is under T; 0.05 is usual",
         LW_OPTION_REAL, &s->subdivide, 1e-4, 1, NULL},
        {"directions", "N",
         "radiosity: look along N fixed directions about each normal, instead of at all texels",
         LW_OPTION_INT, &s->directions, 1, LW_RADIOSITY_DIRECTIONS_MAX, NULL},
        {"keep-visibility", NULL,
         "radiosity: keep a bit for each pair of texels: rays for one bounce only; at most 4 GiB",
         LW_OPTION_FLAG, &s->keep_visibility, 0, 0, NULL},
        {"visibility", "FILE",
         "the same, and keep them in FILE: a bake of the same shapes with other lights takes no bounce ray",
         LW_OPTION_STRING, &s->visibility, 0, 0, NULL},
        {"vpl-lights", "N",
         "vpl: points on surfaces that stand for the light which those reflect (default " LW_LIGHTMAP_NUMBER(
             LW_VPL_LIGHTS_DEFAULT) ")",
         LW_OPTION_INT, &s->vpl_lights, 1, LW_VPL_LIGHTS_MAX, NULL},
        {"vpl-sets", "T",
         "vpl: a sample is one of T sets of them (default " LW_LIGHTMAP_NUMBER(LW_VPL_SETS_DEFAULT) ")",
         LW_OPTION_INT, &s->vpl_sets, 1, LW_VPL_SETS_MAX, NULL},
        {"vpl-near", "METRES",
         "vpl: nearer than this they are not brighter (default: by the area that each stands for)",
         LW_OPTION_REAL, &s->vpl_near, 1e-6, 1e6, NULL},
        {"bounces", "N", "indirect bounces (default {})", LW_OPTION_INT, &s->bounces, 0,
         LW_SOLVER_BOUNCES_MAX, NULL},
        {"denoise", NULL, "filter the noise out of the maps; keeps each object's mean (default: off)",
         LW_OPTION_FLAG, &s->denoise, 0, 0, NULL},
        {"indirect-only", NULL,
         "leave out the direct light of lamps that the engine draws itself; --gltf-out keeps those lamps",
         LW_OPTION_FLAG, &s->indirect_only, 0, 0, NULL},
        {"client-lights", "lamps|auto|NAMES",
         "which: lamps, all suns, points and spots (default); auto: small emissive surfaces too; or names of "
         "lights and emissive materials, apart by commas",
         LW_OPTION_STRING, &s->client_lights, 0, 0, NULL},
        {"convention", LW_CONVENTION_CHOICES,
         "what a texel means: irradiance E{irradiance}; radiosity: albedo x E; three: E; godot: E/pi; "
         "babylon: albedo/pi x E",
         LW_OPTION_CHOICE, &s->convention, 0, 0, NULL},
        {"directional", NULL,
         "also write where light comes from, for normal maps and gloss: a vector a texel, in "
         "DIR/" DIRECTIONS_FOLDER " (docs/baking.md)",
         LW_OPTION_FLAG, &s->directional, 0, 0, NULL},
        {"direction-form", LW_DIRECTION_MAPS_CHOICES,
         "such directions for whom: own, the formula of docs/baking.md{own}; dominant: Unity's "
         "directional lightmaps; sh: Godot 4's. --directional is implied",
         LW_OPTION_CHOICE, &s->direction_form, 0, 0, &s->direction_form_given},
        {"float", NULL, "32-bit EXRs (default: 16-bit, but where that would lose light)", LW_OPTION_FLAG,
         &s->as_float, 0, 0, NULL},
        {"gltf-out", "FILE.glb", "also write the scene with lightmap coordinates and maps on its materials",
         LW_OPTION_STRING, &s->gltf_out, 0, 0, NULL},
        {"gltf-lights", NULL,
         "keep all lamps in that file (default: those whose light is in the maps are left out)",
         LW_OPTION_FLAG, &s->gltf_lights, 0, 0, NULL},
        {"gltf-split-sides", NULL,
         "write double-sided triangles there once for each side, so that each shows its own light",
         LW_OPTION_FLAG, &s->gltf_split_sides, 0, 0, NULL},
        {"sides", LW_SIDES_CHOICES,
         "whose light double-sided triangles show in that file: auto: the side that its cameras see, else "
         "the one with more light{auto}; front; back",
         LW_OPTION_CHOICE, &s->sides, 0, 0, NULL},
        {"time", "SECONDS", "moment of the scene's animation (default {})", LW_OPTION_REAL, &s->time_s, 0,
         1e9, NULL},
        {"time-limit", "SECONDS", "stop lighting after this time, with what is there (default: none)",
         LW_OPTION_REAL, &s->limit_s, 1e-3, 1e9, NULL},
        {"checkpoint", "SECONDS", "save the state this often (default {})", LW_OPTION_REAL, &s->interval_s,
         0.1, 1e9, NULL},
        {"restart", NULL, "do not go on with an unfinished bake in DIR; start again", LW_OPTION_FLAG,
         &s->restart, 0, 0, NULL},
        {"memory", "MB",
         "memory for texels and their light, at most (default: three quarters of the machine's); where they "
         "need more, tiles are lit one after another",
         LW_OPTION_INT, &s->memory_mb, 1, 1 << 24, NULL},
        {"seed", "N", "of all random numbers (default {})", LW_OPTION_INT, &s->seed, 0, UINT32_MAX, NULL},
        LW_PROBE_OPTIONS(&s->probes),
        LW_SCENE_OPEN_OPTIONS(&s->scene),
    };
    const struct lw_options options = {.program = PROGRAM,
                                       .synopsis = "SCENE -o DIR [OPTIONS]",
                                       .about = about,
                                       .table = table,
                                       .count = sizeof table / sizeof table[0],
                                       .positional = scene,
                                       .positional_min = 1,
                                       .positional_max = 1};
    enum lw_status status = lw_options_parse(&options, argc, argv, NULL, out_done, err);
    if (status != LW_OK || *out_done) return status;
    s->scene.path = scene[0];
    s->directional |= s->direction_form_given;
    if ((status = lw_solvers_find(s->solver, &s->entry, err)) != LW_OK) {
        lw_status_context(err, "--solver");
        return status;
    }
    const struct lw_solver_desc asked = solver_desc(s);
    status = s->entry->check(&asked, err);
    return status == LW_OK ? check(s, err) : status;
}

/* ---- places ---- */

static enum lw_status out_of_memory(struct lw_error *err) {
    return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
}

/* Before the long work: what cannot be written should be known at once. */
static enum lw_status prepare_places(struct baker *b, struct lw_error *err) {
    const struct settings *s = &b->settings;
    struct stat st;
    if (mkdir(s->output, 0777) != 0 && errno != EEXIST)
        return lw_status_fail(err, LW_CANNOT_CREATE, "-o %s: %s", s->output,
                              errno == ENOENT ? "the folder that it shall be in is not there; make that first"
                                              : strerror(errno));
    if (stat(s->output, &st) != 0 || !S_ISDIR(st.st_mode))
        return lw_status_fail(err, LW_CANNOT_CREATE, "-o %s: is not a folder", s->output);
    if (access(s->output, W_OK | X_OK) != 0)
        return lw_status_fail(err, LW_CANNOT_CREATE, "-o %s: %s", s->output, strerror(errno));
    b->state_path = lw_folders_join(s->output, STATE_NAME);
    b->tiles_path = lw_folders_join(s->output, TILES_NAME);
    if (!b->state_path || !b->tiles_path) return out_of_memory(err);
    if (s->directional) {
        char *folder = lw_folders_join(s->output, DIRECTIONS_FOLDER);
        if (!folder) return out_of_memory(err);
        const bool made = mkdir(folder, 0777) == 0 || errno == EEXIST;
        free(folder);
        if (!made)
            return lw_status_fail(err, LW_CANNOT_CREATE, "-o %s: %s: %s", s->output, DIRECTIONS_FOLDER,
                                  strerror(errno));
    }
    if (!s->gltf_out) return LW_OK;
    enum lw_status status = lw_atomic_file_check(s->gltf_out, err);
    if (status != LW_OK) lw_status_context(err, "--gltf-out");
    return status;
}

/* "../maps/" from one existing folder to another; both absolute, links resolved. */
static char *relative_folder(const char *from, const char *to) {
    size_t i = 0, same = 0; /* bytes of whole components that both begin with */
    for (; from[i] && from[i] == to[i]; i++)
        if (from[i] == '/') same = i + 1;
    if ((!from[i] || from[i] == '/') && (!to[i] || to[i] == '/')) same = i;
    from += same;
    to += same;
    while (*from == '/') from++;
    while (*to == '/') to++;
    size_t ups = *from != 0;
    for (const char *c = from; *c; c++) ups += *c == '/';
    char *path = malloc(3 * ups + strlen(to) + 2), *end = path;
    if (!path) return NULL;
    while (ups--) end = stpcpy(end, "../");
    end = stpcpy(end, to);
    if (*to) strcpy(end, "/");
    return path;
}

static char *maps_from_glb(const struct settings *s) {
    char *copy = strdup(s->gltf_out);
    char *from = copy ? realpath(dirname(copy), NULL) : NULL, *to = realpath(s->output, NULL);
    char *path = from && to ? relative_folder(from, to) : NULL;
    free(copy);
    free(from);
    free(to);
    return path;
}

/* ---- scene and solver ---- */

/* Writes the hash of bytes that it frees. Returns the new length. */
static int print_hash(char *text, size_t size, int length, uint8_t *bytes, size_t byte_count) {
    struct lw_package_hash hash;
    lw_package_hash(bytes, byte_count, &hash);
    free(bytes);
    for (size_t i = 0; i < sizeof hash.bytes; i++)
        length += snprintf(text + length, size - (size_t)length, "%02x", hash.bytes[i]);
    return length;
}

/* Options that decide a sample's value. Options that decide when to stop are left out: a bake that continues
 * may have another target. */
static enum lw_status make_key(struct baker *b, struct lw_error *err) {
    const struct settings *s = &b->settings;
    uint8_t *package;
    size_t size;
    struct lw_package_hash hash;
    char text[704];
    enum lw_status status = lw_package_write(b->scene, &package, &size, err);
    if (status != LW_OK) return status;
    int length = print_hash(text, sizeof text, 0, package, size);
    if (lw_scene_has_finishes(b->scene)) {
        status = lw_finish_package_write(b->scene, &package, &size, err);
        if (status != LW_OK) return status;
        length = print_hash(text, sizeof text, length, package, size);
    }
    length += snprintf(
        text + length, sizeof text - (size_t)length,
        " " LW_VERSION " solver %s bounces %lld seed %lld range %a cell %a probes %d %a time %a "
        "denoise %d undersample %d window %lld directions %lld kept %d subdivide %a vpl %lld %lld %a "
        "directional %d by tile %d",
        s->entry->name, (long long)s->bounces, (long long)s->seed, s->probes.tracing_range_m,
        s->probes.cell_size_m, s->probes.form, s->probes.probe_spacing_m, s->time_s, s->denoise,
        s->undersample, (long long)s->window, (long long)s->directions, s->keep_visibility || s->visibility,
        s->subdivide, (long long)s->vpl_lights, (long long)s->vpl_sets, s->vpl_near, s->directional,
        b->by_tile);
    if (b->left_out_names) { /* which ones: no text is long enough for all names */
        lw_package_hash((const uint8_t *)b->left_out_names, strlen(b->left_out_names), &hash);
        length += snprintf(text + length, sizeof text - (size_t)length, " left out ");
        for (size_t i = 0; i < sizeof hash.bytes; i++)
            length += snprintf(text + length, sizeof text - (size_t)length, "%02x", hash.bytes[i]);
    }
    lw_package_hash((const uint8_t *)text, (size_t)length, &hash);
    memcpy(b->bake.key, hash.bytes, sizeof b->bake.key);
    return LW_OK;
}

/* A package that a server with spares has sent: a map for what stands nowhere would be of no use. */
static enum lw_status refuse_spares(const struct baker *b, struct lw_error *err) {
    for (uint32_t o = 0; o < b->scene->object_count; o++)
        if (lw_scene_is_spare(b->scene, o))
            return lw_status_fail(
                err, LW_BAD_DATA,
                "%s: object %u \"%.60s\" is a server's spare, which stands nowhere: bake the scene "
                "that the server was given",
                b->settings.scene.path, o, b->scene->object[o].name);
    return LW_OK;
}

static void list_names(const struct baker *b, FILE *out) {
    const char *between = "";
    for (uint32_t l = 0; l < b->left_out.light_count; l++) {
        if (!b->left_out.light[l]) continue;
        fprintf(out, "%s%s", between, b->scene->light[l].name);
        between = ",";
    }
    for (uint32_t m = 0; m < b->left_out.material_count; m++) {
        if (!b->left_out.material[m]) continue;
        fprintf(out, "%s%s", between, b->scene->material[m].name);
        between = ",";
    }
}

/* Engines light scenes with lamps, and few with what emits: that stays in the maps unless it is asked for. */
static enum lw_status choose_left_out(struct baker *b, struct lw_error *err) {
    const struct settings *s = &b->settings;
    if (!s->indirect_only) return LW_OK;
    enum lw_status status = lw_client_lights_init(&b->left_out, b->scene, &b->pose,
                                                  s->client_lights ? s->client_lights : "lamps", err);
    if (status != LW_OK) return status;
    if (!lw_client_lights_any(&b->left_out))
        return lw_status_fail(
            err, LW_USAGE,
            "--indirect-only: %s has no lamp that an engine would draw; --client-lights says which "
            "lights and emissive materials are meant",
            s->scene.path);
    size_t size;
    FILE *out = open_memstream(&b->left_out_names, &size);
    if (!out) return out_of_memory(err);
    list_names(b, out);
    b->channel = LW_TILE_CHANNEL_SPLIT;
    return fclose(out) == 0 ? LW_OK : out_of_memory(err);
}

static struct lw_solver_desc solver_desc_of(const struct baker *b) {
    struct lw_solver_desc desc = solver_desc(&b->settings);
    desc.scene = b->scene;
    desc.atlas_map = &b->atlas_map;
    desc.client_lights = &b->left_out;
    return desc;
}

static enum lw_status read_scene(struct baker *b, struct lw_error *err) {
    enum lw_status status = lw_scene_open(&b->settings.scene, &b->scene, err);
    lw_interrupt_enter(&preparing);
    if (status == LW_OK && signalled) status = LW_CLOSED;
    if (status == LW_OK) status = refuse_spares(b, err);
    if (status != LW_OK) return status;
    if ((status = lw_atlas_map_init(&b->atlas_map, b->scene)) != LW_OK)
        return lw_status_fail(err, status, "tiles");
    if ((status = lw_pose_init(&b->pose, b->scene)) != LW_OK) return lw_status_fail(err, status, "poses");
    lw_pose_evaluate(&b->pose, b->scene, b->settings.time_s);
    if ((status = choose_left_out(b, err)) != LW_OK) return status;
    const struct lw_solver_desc desc = solver_desc_of(b);
    status = lw_bake_memory_choose(b->settings.entry, &desc, (uint64_t)b->settings.memory_mb * 1000000,
                                   &b->by_tile, err);
    if (status != LW_OK) return status;
    if ((status = make_key(b, err)) != LW_OK) return status;
    if ((status = lw_map_names_init(&b->names, b->scene)) != LW_OK) return out_of_memory(err);
    return LW_OK;
}

static enum lw_status create_solver(struct baker *b, struct lw_error *err) {
    const struct settings *s = &b->settings;
    struct lw_solver_desc desc = solver_desc_of(b);
    uint32_t channels = lw_tile_channel_bit(b->channel);
    if (s->directional) channels |= lw_tile_channel_bit(LW_TILE_CHANNEL_DIRECTION + b->channel);
    if (b->by_tile) {
        struct lw_tile_by_tile_desc how = {
            .path = b->tiles_path, .channels = channels, .has_albedo = b->convention->times_albedo};
        memcpy(how.key, b->bake.key, sizeof how.key);
        desc.denoise = s->denoise;
        return lw_tile_by_tile_create(s->entry, &desc, &b->pose, &how, &b->solver, err);
    }
    enum lw_status status = s->entry->create(&desc, &b->pose, &b->solver, err);
    if (status == LW_OK) b->solver->ops->choose_channels(b->solver, channels);
    return status;
}

static enum lw_status set_up_solver(struct baker *b, struct lw_error *err) {
    const struct settings *s = &b->settings;
    b->bake.atlas_map = &b->atlas_map;
    b->bake.pose = &b->pose;
    b->bake.samples = (uint32_t)s->samples;
    b->bake.error = (float)s->error;
    b->bake.limit_s = s->limit_s;
    b->bake.state_path = b->state_path;
    b->bake.tiles_path = b->tiles_path;
    b->bake.state_interval_s = s->interval_s;
    b->bake.stop = &signalled;
    if (s->restart) lw_bake_forget(&b->bake);
    enum lw_status status = create_solver(b, err);
    b->bake.solver = b->solver;
    return status;
}

/* Its progress is not known. Lines report its begin and its time. */
static enum lw_status filter(struct baker *b, struct lw_error *err) {
    struct lw_progress progress;
    lw_log(LW_LOG_INFO, "filtering the maps");
    lw_progress_init(&progress, "filtering", 0);
    enum lw_status status = b->solver->ops->filter(b->solver, err);
    if (status == LW_OK) lw_progress_finish(&progress);
    return status;
}

static enum lw_status solve(struct baker *b, struct lw_error *err) {
    uint64_t frames;
    enum lw_status status = lw_bake_resume(&b->bake, &frames, err);
    if (status != LW_OK) {
        lw_status_context(err, "cannot go on with an unfinished bake (--restart starts again)");
        return status;
    }
    if (frames) lw_log(LW_LOG_INFO, "going on after %llu samples", (unsigned long long)frames);
    lw_interrupt_enter(&lighting);
    status = lw_bake_run(&b->bake, frames, &b->result, err);
    lw_interrupt_enter(&writing);
    if (status == LW_OK && b->settings.denoise && !b->by_tile) status = filter(b, err);
    return status;
}

/* ---- writing ---- */

static void note_noise(struct baker *b, const struct lw_map *map) {
    struct noisy noisy = {b->scene->object[map->object].name, map->error_worst};
    for (int i = 0; i < NOISIEST_SHOWN; i++) {
        if (!(noisy.error > b->noisiest[i].error)) continue;
        const struct noisy moved = b->noisiest[i];
        b->noisiest[i] = noisy;
        noisy = moved;
    }
}

static enum lw_status write_exr(struct baker *b, const struct lw_map *map, bool half, struct lw_error *err) {
    char samples[16], error[24], back[16], time[32];
    snprintf(samples, sizeof samples, "%u", map->samples);
    snprintf(error, sizeof error, "%.4g", (double)map->error);
    snprintf(back, sizeof back, "%u", map->back_offset);
    snprintf(time, sizeof time, "%.9g", b->settings.time_s);
    const struct lw_image_attribute attribute[] = {{"units", b->convention->units},
                                                   {"quantity", b->convention->quantity},
                                                   {"convention", b->convention->name},
                                                   {"software", "lightwell " LW_VERSION},
                                                   {"object", b->scene->object[map->object].name},
                                                   {"scene", b->settings.scene.path},
                                                   {"sceneTime", time},
                                                   {"samples", samples},
                                                   {"error", error},
                                                   {"backOffset", back},
                                                   {"leftOut", b->left_out_names}};
    char *path = lw_folders_join(b->settings.output, b->names.file[map->object]);
    if (!path) return out_of_memory(err);
    enum lw_status status = lw_image_write_exr_with(
        path,
        &(struct lw_image_exr){.pixel = map->rgba,
                               .width = map->width,
                               .height = map->height,
                               .channels = 4,
                               .half = half,
                               .attribute = attribute,
                               .attribute_count =
                                   sizeof attribute / sizeof *attribute - (b->left_out_names ? 0 : 1)},
        err);
    free(path);
    return status;
}

/* The directions of an object's light in the form that was asked for. */
static enum lw_status build_directions(struct baker *b, const struct lw_map *irradiance,
                                       struct lw_map *out_map, struct lw_error *err) {
    const enum lw_direction_maps_kind kind = (enum lw_direction_maps_kind)b->settings.direction_form;
    struct lw_map normals = {0};
    enum lw_status status =
        lw_map_build_directions(out_map, b->scene, &b->atlas_map, b->solver, b->channel, irradiance, err);
    if (status != LW_OK) return status;
    if (kind != LW_DIRECTION_MAPS_OWN)
        status = lw_map_build_normals(&normals, b->scene, &b->atlas_map, &b->pose, b->solver,
                                      irradiance->object, err);
    if (status == LW_OK) status = lw_direction_maps_convert(out_map, kind, &normals, irradiance, err);
    lw_map_finish(&normals);
    if (status != LW_OK) lw_map_finish(out_map);
    return status;
}

static enum lw_status write_directions(struct baker *b, const struct lw_map *irradiance, const char *name,
                                       struct lw_error *err) {
    const struct lw_direction_maps_form *form =
        lw_direction_maps_get((enum lw_direction_maps_kind)b->settings.direction_form);
    struct lw_map map;
    enum lw_status status = build_directions(b, irradiance, &map, err);
    if (status != LW_OK) return status;
    const struct lw_image_attribute attribute[] = {{"units", form->units},
                                                   {"quantity", form->quantity},
                                                   {"directionForm", form->name},
                                                   {"axes", "world, as glTF has them: y up"},
                                                   {"software", "lightwell " LW_VERSION},
                                                   {"object", b->scene->object[map.object].name}};
    char *path = lw_folders_join(b->settings.output, name);
    status = path ? lw_image_write_exr_with(
                        path,
                        &(struct lw_image_exr){.pixel = map.rgba,
                                               .width = map.width,
                                               .height = map.height,
                                               .channels = 4,
                                               .half = map.fits_half && !b->settings.as_float,
                                               .attribute = attribute,
                                               .attribute_count = sizeof attribute / sizeof *attribute},
                        err)
                  : out_of_memory(err);
    free(path);
    lw_map_finish(&map);
    return status;
}

/* The map as MOZ_lightmap wants it, irradiance whatever the convention of the EXRs. */
static enum lw_status add_to_glb(struct baker *b, const struct lw_map *map, const struct lw_map *irradiance,
                                 const struct lw_sides_shown *shown, struct lw_error *err) {
    uint8_t *rgb;
    float scale;
    if (lw_map_to_8_bit(irradiance, &rgb, &scale) != LW_OK) return out_of_memory(err);
    lw_glb_scene_add(&b->glb, map, shown, b->names.file[map->object], rgb, scale);
    free(rgb);
    return LW_OK;
}

static void note_sides(struct baker *b, const struct lw_map *map, const struct lw_sides_shown *shown) {
    if (!(shown->both_m2 > BOTH_SIDES_SHARE * shown->total_m2)) return;
    if (!b->one_sided_count++) b->one_sided = b->scene->object[map->object].name;
}

static enum lw_status write_map(struct baker *b, uint32_t object, struct lw_error *err) {
    struct lw_map map, irradiance = {0};
    struct lw_sides_shown shown = {0};
    enum lw_status status =
        lw_map_build(&map, b->scene, &b->atlas_map, b->solver, b->channel, object, b->convention, err);
    if (status != LW_OK) return status;
    const bool half = map.fits_half && !b->settings.as_float;
    b->maps_as_float += !map.fits_half;
    note_noise(b, &map);
    status = write_exr(b, &map, half, err);
    if (status == LW_OK && (b->settings.directional || b->settings.gltf_out))
        status = lw_map_build(&irradiance, b->scene, &b->atlas_map, b->solver, b->channel, object,
                              lw_convention_get(LW_CONVENTION_IRRADIANCE), err);
    char *directions =
        b->settings.directional ? lw_folders_join(DIRECTIONS_FOLDER, b->names.file[object]) : NULL;
    if (status == LW_OK && b->settings.directional)
        status = directions ? write_directions(b, &irradiance, directions, err) : out_of_memory(err);
    if (status == LW_OK) status = lw_sides_choose(&b->sides, &map, &shown, err);
    note_sides(b, &map, &shown);
    if (status == LW_OK && lw_manifest_add(&b->manifest, b->scene, &map, &shown, b->names.file[object],
                                           directions, half) != LW_OK)
        status = out_of_memory(err);
    free(directions);
    if (status == LW_OK && b->settings.gltf_out) status = add_to_glb(b, &map, &irradiance, &shown, err);
    lw_sides_release(&shown);
    lw_map_finish(&irradiance);
    lw_map_finish(&map);
    return status;
}

static const char *direction_form(const struct settings *s) {
    return s->directional ? lw_direction_maps_get((enum lw_direction_maps_kind)s->direction_form)->name
                          : NULL;
}

static enum lw_status begin_index(struct baker *b, struct lw_error *err) {
    const struct settings *s = &b->settings;
    const struct lw_manifest_desc desc = {.scene = b->scene,
                                          .scene_path = s->scene.path,
                                          .convention = b->convention,
                                          .result = &b->result,
                                          .time_s = s->time_s,
                                          .tracing_range_m = s->probes.tracing_range_m,
                                          .samples = (uint32_t)s->samples,
                                          .bounces = (uint32_t)s->bounces,
                                          .denoised = s->denoise,
                                          .direction_form = direction_form(s),
                                          .left_out = s->indirect_only ? &b->left_out : NULL,
                                          .seed = (uint32_t)s->seed,
                                          .error = (float)s->error};
    if (lw_manifest_init(&b->manifest, &desc) != LW_OK) return out_of_memory(err);
    if (!s->gltf_out) return LW_OK;
    b->map_folder = maps_from_glb(s);
    if (!b->map_folder) return lw_status_fail(err, LW_CANNOT_CREATE, "%s: %s", s->gltf_out, strerror(errno));
    enum lw_status status =
        lw_glb_scene_init(&b->glb, &(struct lw_glb_scene_desc){.scene = b->scene,
                                                               .convention = b->convention,
                                                               .map_folder = b->map_folder,
                                                               .direction_folder = DIRECTIONS_FOLDER,
                                                               .direction_form = direction_form(s),
                                                               .split_sides = s->gltf_split_sides,
                                                               .with_lights = s->gltf_lights,
                                                               .drawn = b->left_out.light});
    return status == LW_OK ? LW_OK : out_of_memory(err);
}

static enum lw_status write_all(struct baker *b, struct lw_error *err) {
    struct lw_progress progress;
    enum lw_status status = begin_index(b, err);
    if (status == LW_OK)
        status = lw_sides_init(&b->sides, b->scene, &b->pose, (enum lw_sides_choice)b->settings.sides, err);
    lw_progress_init(&progress, "writing maps", b->scene->object_count);
    for (uint32_t o = 0; status == LW_OK && o < b->scene->object_count; o++) {
        status = write_map(b, o, err);
        lw_progress_step(&progress, 1);
    }
    if (status == LW_OK)
        lw_progress_finish(&progress);
    else
        lw_progress_stop(&progress);
    if (status == LW_OK && b->settings.gltf_out)
        status = lw_glb_scene_write(&b->glb, b->settings.gltf_out, err);
    if (status != LW_OK) return status;
    char *path = lw_folders_join(b->settings.output, MANIFEST_NAME);
    if (!path) return out_of_memory(err);
    status = lw_manifest_write(&b->manifest, path, err);
    free(path);
    return status;
}

static void report(const struct baker *b) {
    const struct lw_bake_result *r = &b->result;
    const struct settings *s = &b->settings;
    lw_log(LW_LOG_INFO, "%u maps in %s (%s, %s)%s%s; %.0f s, %.1f M rays", b->names.count, s->output,
           b->convention->quantity, b->convention->units, s->gltf_out ? ", scene in " : "",
           s->gltf_out ? s->gltf_out : "", r->seconds, (double)r->rays * 1e-6);
    const uint32_t lamps = b->left_out.drawn_lights, materials = b->left_out.drawn_materials;
    if (s->indirect_only)
        lw_log(LW_LOG_INFO,
               "without the direct light of %u lamp%s and %u emissive material%s: the engine draws that",
               lamps, lamps == 1 ? "" : "s", materials, materials == 1 ? "" : "s");
    if (b->maps_as_float && !s->as_float)
        lw_log(LW_LOG_INFO, "%u of them with 32 bits: 16 would lose light", b->maps_as_float);
    if (b->one_sided_count && s->gltf_out && !s->gltf_split_sides)
        lw_log(
            LW_LOG_INFO,
            "%u double-sided objects show the light of one side in %s, though both matter (\"%.60s\" is one; "
            "both_sides in index.json): --gltf-split-sides shows both",
            b->one_sided_count, s->gltf_out, b->one_sided);
    if (!r->tiles_open) return;
    lw_log(LW_LOG_WARNING, "not finished: %u of %u tiles are short of %s %g; the same command goes on",
           r->tiles_open, r->tiles, s->samples ? "--samples" : "--error",
           s->samples ? (double)s->samples : s->error);
    for (int i = 0; i < NOISIEST_SHOWN && b->noisiest[i].error > 0; i++)
        lw_log(LW_LOG_INFO, "  noisiest: %.100s, error %.3g", b->noisiest[i].object,
               (double)b->noisiest[i].error);
}

/* ---- the program ---- */

static enum lw_status run(struct baker *b, struct lw_error *err) {
    b->convention = lw_convention_get((enum lw_convention_kind)b->settings.convention);
    enum lw_status status = prepare_places(b, err);
    if (status == LW_OK) status = read_scene(b, err);
    if (status == LW_OK) status = set_up_solver(b, err);
    if (status == LW_OK) status = solve(b, err);
    if (status == LW_OK) status = write_all(b, err);
    if (status != LW_OK) return status;
    if (!b->result.tiles_open) lw_bake_forget(&b->bake);
    report(b);
    return LW_OK;
}

static void finish_baker(struct baker *b) {
    if (b->glb.mesh) lw_glb_scene_finish(&b->glb);
    lw_manifest_finish(&b->manifest);
    lw_sides_finish(&b->sides);
    lw_map_names_finish(&b->names);
    if (b->solver) b->solver->ops->destroy(b->solver);
    lw_client_lights_finish(&b->left_out);
    free(b->left_out_names);
    lw_pose_finish(&b->pose);
    lw_atlas_map_finish(&b->atlas_map);
    lw_scene_destroy(b->scene);
    free(b->map_folder);
    free(b->state_path);
    free(b->tiles_path);
}

int main(int argc, char **argv) {
    struct baker b = {
        .settings = {.error = DEFAULT_ERROR,
                     .bounces = DEFAULT_BOUNCES,
                     .seed = 1,
                     .interval_s = DEFAULT_INTERVAL,
                     .probes = {.tracing_range_m = (double)INFINITY},
                     .scene = {.sun_angle_deg = LW_SCENE_OPEN_SUN_DIAMETER_DEG, .cancel = &signalled}}};
    struct lw_error err = {0};
    bool done = false;
    lw_log_init(PROGRAM, LW_LOG_INFO);
    lw_wait_passively(argv);
    enum lw_status status = parse(&b.settings, argc, argv, &done, &err);
    if (status == LW_OK && !done) {
        lw_interrupt_watch(on_signal, &reading);
        status = run(&b, &err);
        finish_baker(&b);
    }
    if (status == LW_CLOSED && signalled) {
        lw_log(LW_LOG_INFO, NOTHING);
        return LW_INTERRUPT_EXIT_CODE;
    }
    if (status != LW_OK) return lw_log_failure(&err);
    return b.result.stopped ? LW_INTERRUPT_EXIT_CODE : 0;
}
