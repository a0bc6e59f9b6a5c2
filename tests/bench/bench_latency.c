/* bench_latency: how long a change of the scene takes to reach a client, and to become the light that it
 * leads to; or, by --walk, how far light trails behind steady movement.
 *
 *     bench_latency [--updates N] [--settle S] [--frames N] [--fresh N] [--daemon "OPTIONS"] [--reference
 *     FOLDER] [--json]
 *                   [SCENE ["CAMERA COMMAND"...]]
 *     bench_latency --walk [--times T,...] [the same options] [SCENE CAMERA]
 *
 * A lightwelld of its own with its default settings, its animation held, and one client on loopback that
 * wants what a picture of 1280 x 720 from that camera takes. Once the light has converged, the client sends
 * the change (a command of lightwellctl; the camera is a name or as --camera of lightwell-view has it), waits
 * until it has converged again, undoes it by a reset, and so on. Both ways count.
 *
 * first tile: until the client has decoded a tile of the frame that shows the change, or of a later one,
 * which the change touches. 95 %: until p(E) = sum d(E - E0) d(E1' - E0') / sum d(E1 - E0) d(E1' - E0')
 * reaches 0.95 over squares of 4 x 4 texels of level 2, all channels; d: sum of the values in brackets times
 * w over a square's texels that the picture shows, before or after. E0, E0', E1, E1' are the light of four
 * more servers that never knew anything else than the state before (0) and the state after (1), by two seeds:
 * with one, the noise of E0 and E1 would count as change, and where a vase moves most of the view does not
 * change. w is one over the texel's mean light (plus the median's of all): else the cages of lamps, some
 * hundred texels a thousand times as bright as the rest and as noisy, would alone decide. Light over twice
 * that light is clipped: single texels of a first frame. So p is 0 for light that is converged before, 1 for
 * light that is at rest after, whatever the server remembers. Agreement is the cosine of E1 - E0 and E1' -
 * E0': where it is small, p is noise; more --fresh frames help.
 *
 * --walk: the animation runs, by the real clock. For each time of the list and each pass of the animation's
 * loop (--updates), E is what the client has when the first frame at or after that time is all there; E1 is
 * right at that time, E0 a second of scene time before, both by servers whose animation is held there. So p
 * is the share of the last second's movement that is shown, and light of which all is equally late is 1 - p
 * seconds late. error: sum d(E - E1) d(E - E1') relative to sum d(E1 - E0) d(E1' - E0'): trail and noise of E
 * together, 1 for light a second old; "without noise" takes the two factors from different passes.
 *
 * --reference keeps those servers' light in files, for runs of the same thing.
 *
 * The machine's load shows in CPU times: of the server's process, from the sending of the update on. */
#include "tests/bench/bench_setup.h"
#include "tests/bench/latency_light.h"
#include "tests/bench/latency_walk.h"
#include "tests/support/process.h"

#include "client/control/ctl_command.h"
#include "common/base/clock.h"
#include "common/base/log.h"
#include "common/base/options.h"

#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define FIRST_MS    100.0 /* targets */
#define SHARE_MS    500.0
#define SHARE       0.95
#define TOUCHED     0.01 /* relative root mean square by which the change moves what it touches */
#define QUIET_NS    1000000000u
#define UPDATES_MAX 64u
#define WALK_CAMERA "lamp"  /* along the gallery where the atrium's lantern walks, ... */
#define WALK_TIMES  "5,6,7" /* ... towards it */

/* The default updates: in the atrium a lamp moves, a vase moves by its width, the sun
 * loses half. */
static const char *const atrium[] = {"lamp shift lantern -1.5 0 0", "vase shift amphora 0.6 0 0",
                                     "main light sun intensity 52 45 34.5"};

/* A moment after an update at which new tiles were there. */
struct moment {
    double ms, server_cpu_ms, client_cpu_ms;
    uint64_t frame, rays;
    double along; /* sum (E - E0)(E1' - E0') */
};

struct bench {
    int64_t updates, frames;
    double settle_s;
    bool json;
    struct latency_light light;
    struct lw_process server;
    clockid_t server_clock;
    struct lw_client *client;
    /* per tile */
    uint8_t *touched;  /* by the change */
    uint64_t *version; /* before the update */
    float *now;        /* E */
    struct moment *moment;
    size_t moment_count, moment_capacity;
};

/* What one update came to. */
struct outcome {
    bool undone;    /* this was the way back */
    bool converged; /* the light did, before time was up */
    double first_frames, share_frames;
    struct moment first, share; /* share.ms < 0: never */
    double lowest;              /* lowest p after that */
    double start, end;          /* p before the update and with converged light */
    double converged_ms;
};

/* ---- the change ---- */

/* Tiles that the change moves by more than a little, as far as they are shown: those of the level that is
 * read, and the finer ones below. */
static void find_touched(struct bench *b) {
    const struct latency_light *l = &b->light;
    for (uint32_t t = 0; t < l->map.tile_count; t++) {
        const struct lw_tile_place *place = &l->map.place[t];
        const uint32_t level = latency_light_level(l, place->object);
        b->touched[t] = 0;
        if (place->level > level || !l->wanted[t]) continue;
        const uint32_t width = l->map.atlas[place->object]->level[level].width, shift = level - place->level;
        double change = 0, whole = 0;
        for (uint32_t y = place->y * LW_TILE_SIDE >> shift;
             y < (place->y * LW_TILE_SIDE + place->height) >> shift; y++)
            for (uint32_t x = place->x * LW_TILE_SIDE >> shift;
                 x < (place->x * LW_TILE_SIDE + place->width) >> shift; x++) {
                const size_t texel = l->first[place->object] + (size_t)y * width + x;
                for (size_t i = LATENCY_CHANNELS * texel;
                     i < LATENCY_CHANNELS * (texel + 1) && l->pair->shown[texel]; i++) {
                    const double from = (double)l->pair->before[0][i], to = (double)l->pair->after[0][i];
                    change += (to - from) * (to - from);
                    whole += from * from;
                }
            }
        b->touched[t] = change > TOUCHED * TOUCHED * whole;
    }
}

/* The scene as --freeze 0 holds it: of that, what commands go on from. */
static void read_update(struct latency_light *l, const char *text, struct lw_scene_change *out_change) {
    char line[512];
    const char *word[LW_CTL_COMMAND_WORDS_MAX];
    size_t count;
    const struct lw_scene *scene = latency_light_scene(l);
    struct lw_pose pose;
    struct lw_error err = {0};
    latency_must(lw_pose_init(&pose, scene), &err);
    if ((size_t)snprintf(line, sizeof line, "%s", text) >= sizeof line)
        latency_give_up("an update is too long");
    latency_must(lw_ctl_command_split(line, word, &count, &err), &err);
    if (count < 2) latency_give_up("an update is a camera and a command: \"main hide amphora\"");
    if (strcmp(word[1], "add") == 0) latency_give_up("an update changes what is there: add does not");
    (void)latency_light_look_from(l, &pose, word[0]); /* the animation is held */
    struct lw_ctl_command_state state = {.scene = scene,
                                         .object_to_world = pose.object_to_world,
                                         .light = latency_room(scene->light_count, sizeof *state.light),
                                         .emission =
                                             latency_room(scene->material_count, sizeof *state.emission)};
    for (uint32_t i = 0; i < scene->light_count; i++)
        state.light[i] = (struct lw_client_light){pose.light[i].position_ws, pose.light[i].direction_ws,
                                                  pose.light[i].intensity};
    for (uint32_t m = 0; m < scene->material_count; m++) {
        const float *emission = scene->material[m].emission;
        const struct lw_vec3 own = lw_vec3(emission[0], emission[1], emission[2]);
        state.emission[m] = (struct lw_ctl_emission){own, own};
    }
    latency_must(lw_ctl_command_parse(&state, word + 1, count - 1, out_change, &err), &err);
    free(state.emission);
    free(state.light);
    lw_pose_finish(&pose);
}

static const struct lw_scene_change reset = {.kind = LW_SCENE_CHANGE_RESET};

/* ---- updates ---- */

static double ms_since(uint64_t since_ns, uint64_t now_ns) { return 1e-6 * (double)(now_ns - since_ns); }

static void add_moment(struct bench *b, const struct moment *moment) {
    if (b->moment_count == b->moment_capacity) {
        b->moment_capacity = 2 * b->moment_capacity + 64;
        b->moment = realloc(b->moment, b->moment_capacity * sizeof *b->moment);
        if (!b->moment) latency_give_up("no memory");
    }
    b->moment[b->moment_count++] = *moment;
}

/* Where the client's and the server's clocks stand. */
struct clocks {
    uint64_t ns, server_cpu_ns, client_cpu_ns;
};
static struct clocks clocks_now(const struct bench *b) {
    return (struct clocks){lw_clock_ns(), lw_clock_read_ns(b->server_clock), lw_clock_process_cpu_ns()};
}
static struct moment moment_at(const struct clocks *from, const struct clocks *to,
                               const struct lw_client_stats *stats) {
    return (struct moment){.ms = ms_since(from->ns, to->ns),
                           .server_cpu_ms = ms_since(from->server_cpu_ns, to->server_cpu_ns),
                           .client_cpu_ms = ms_since(from->client_cpu_ns, to->client_cpu_ns),
                           .frame = stats->frame,
                           .rays = stats->rays_total};
}

/* A tile's version is the frame that it was encoded in. */
static bool shows_change(const struct bench *b, uint64_t frame) {
    for (uint32_t t = 0; t < b->light.map.tile_count; t++) {
        const uint64_t version = lw_client_get_tile(b->client, (lw_tile_id){t}).version;
        if (b->touched[t] && version != b->version[t] && version >= frame) return true;
    }
    return false;
}

/* Whether the light counts as at rest without full convergence. Each frame forgets only so much of the
 * light before. */
static bool is_over(const struct bench *b, uint64_t frames, uint64_t ns) {
    return (frames >= (uint64_t)b->frames && ns >= (uint64_t)(1e9 * b->settle_s)) || ns > LATENCY_LIMIT_NS;
}

/* Whether every tile that is wanted is there with all bounces, and no noisier than it is to be. */
static bool is_converged(const struct bench *b, const struct lw_client_stats *stats) {
    for (uint32_t t = 0; t < b->light.map.tile_count; t++) {
        const struct lw_client_tile tile = lw_client_get_tile(b->client, (lw_tile_id){t});
        if (b->light.wanted[t] &&
            (!tile.version || tile.bounces < stats->bounces || tile.error > stats->target_error))
            return false;
    }
    return true;
}

/* Sends an update and follows the light until it converges, or its frames are over. Fills b->moment. */
static struct outcome follow(struct bench *b, const struct lw_scene_change *change) {
    const uint32_t tiles = b->light.map.tile_count;
    struct lw_client_stats stats;
    struct lw_client_answer answer = {0};
    struct lw_error err = {0};
    struct outcome outcome = {.first.ms = -1, .share.ms = -1};
    bool answered = false;
    for (uint32_t t = 0; t < tiles; t++)
        b->version[t] = lw_client_get_tile(b->client, (lw_tile_id){t}).version;
    b->moment_count = 0;
    lw_client_get_stats(b->client, &stats);
    const struct lw_client_stats old = stats;
    const struct clocks from = clocks_now(b);
    uint64_t frame = stats.frame, tiles_then = stats.tiles, heard_ns = from.ns, now_ns = from.ns;
    latency_must(lw_client_update(b->client, change, 1, NULL, &err), &err);
    while (!answered || (!outcome.converged && !is_over(b, frame - old.frame, now_ns - from.ns))) {
        latency_light_poll(b->client, LATENCY_POLL_MS, &stats);
        const struct clocks now = clocks_now(b);
        struct moment moment = moment_at(&from, &now, &stats);
        now_ns = now.ns;
        answered |= lw_client_next_answer(b->client, &answer);
        if (answered && answer.code) latency_give_up(answer.text);
        if (!answered && now_ns - from.ns > LATENCY_PATIENCE_NS)
            latency_give_up("the server does not answer");
        if (stats.frame != frame) heard_ns = now_ns;
        frame = stats.frame;
        if (stats.tiles != tiles_then) {
            if (outcome.first.ms < 0 && answered && shows_change(b, answer.frame)) {
                outcome.first = moment;
                outcome.first_frames = (double)(moment.frame - old.frame);
            }
            latency_light_read(&b->light, b->client, b->now);
            moment.along = latency_light_share(&b->light, b->now);
            add_moment(b, &moment);
        }
        tiles_then = stats.tiles;
        outcome.converged = answered && now_ns - heard_ns > QUIET_NS && is_converged(b, &stats);
    }
    outcome.converged_ms = ms_since(from.ns, heard_ns);
    return outcome;
}

/* p of each moment, 0 before the update: that reached SHARE first, and the lowest after it. */
static void find_share(struct bench *b, struct outcome *outcome, uint64_t old_frame) {
    outcome->lowest = (double)INFINITY;
    for (size_t i = 0; i < b->moment_count; i++) {
        if (outcome->undone) b->moment[i].along = 1 - b->moment[i].along;
        const struct moment *m = &b->moment[i];
        if (outcome->share.ms < 0 && m->along >= SHARE) {
            outcome->share = *m;
            outcome->share_frames = (double)(m->frame - old_frame);
        }
        if (outcome->share.ms >= 0) outcome->lowest = fmin(outcome->lowest, m->along);
        outcome->end = m->along;
    }
}

/* ---- output ---- */

static double median_of(const struct outcome *o, size_t count, double (*value)(const struct outcome *)) {
    double v[UPDATES_MAX];
    for (size_t i = 0; i < count; i++) v[i] = value(&o[i]);
    return bench_median(v, count);
}
/* What never came counts as later than everything. */
static double first_ms(const struct outcome *o) { return o->first.ms < 0 ? (double)INFINITY : o->first.ms; }
static double share_ms(const struct outcome *o) { return o->share.ms < 0 ? (double)INFINITY : o->share.ms; }

static json_t *json_outcome(const struct bench *b, const struct outcome *o) {
    json_t *progress = json_array();
    for (size_t i = 0; i < b->moment_count; i++)
        json_array_append_new(progress,
                              json_pack("[o, o, I]", latency_real(b->moment[i].ms),
                                        latency_real(b->moment[i].along), (json_int_t)b->moment[i].rays));
    return json_pack("{s:b, s:b, s:o, s:o, s:o, s:o, s:o, s:o, s:o, s:o, s:o, s:o, s:o, s:o}", "undone",
                     o->undone, "converged", o->converged, "converged_ms", latency_real(o->converged_ms),
                     "first_ms", latency_real(first_ms(o)), "first_frames", latency_real(o->first_frames),
                     "first_server_cpu_ms", latency_real(o->first.server_cpu_ms), "share_ms",
                     latency_real(share_ms(o)), "share_frames", latency_real(o->share_frames),
                     "share_server_cpu_ms", latency_real(o->share.server_cpu_ms), "share_client_cpu_ms",
                     latency_real(o->share.client_cpu_ms), "lowest_after",
                     latency_real(isfinite(o->lowest) ? o->lowest : 0), "start", latency_real(o->start),
                     "end", latency_real(o->end), "progress", progress);
}

static void print_cell(double ms, double frames, double cpu_ms) {
    if (isfinite(ms))
        printf(" %.0f | %.0f | %.0f |", ms, frames, cpu_ms);
    else
        printf(" never | | |");
}

static void print_outcome(const char *update, const struct outcome *o) {
    printf("| %s%s |", update, o->undone ? ", undone" : "");
    print_cell(first_ms(o), o->first_frames, o->first.server_cpu_ms);
    print_cell(share_ms(o), o->share_frames, o->share.server_cpu_ms);
    if (isfinite(o->lowest)) printf(" %.2f", o->lowest);
    printf(" | %.2f | %.2f | %.1f%s |\n", o->start, o->end, 1e-3 * o->converged_ms,
           o->converged ? "" : " and on");
    fflush(stdout);
}

static void print_update(void) {
    printf("| update | first tile, ms | frames | server CPU ms | 95 %%, ms | frames | server CPU ms | "
           "lowest after | p at first | p at last | converged, s |\n"
           "|---|---|---|---|---|---|---|---|---|---|---|\n");
    fflush(stdout);
}

static void print_medians(const struct bench *b, const char *update, double first, double share) {
    printf("\n%s: agreement %.2f; medians: first tile after %.0f ms, target %.0f: %s; 95 %% after %.0f "
           "ms, target %.0f: %s\n\n",
           update, b->light.agreement, first, FIRST_MS, first <= FIRST_MS ? "met" : "missed", share, SHARE_MS,
           share <= SHARE_MS ? "met" : "missed");
    fflush(stdout);
}

/* ---- the whole ---- */

/* Returns the update as JSON, NULL where a table is printed instead. */
static json_t *measure(struct bench *b, const char *text) {
    struct latency_light *l = &b->light;
    struct latency_pair pair;
    struct lw_scene_change change;
    struct outcome outcome[UPDATES_MAX];
    struct lw_client_stats stats;
    read_update(l, text, &change);
    latency_light_solve(l, &(struct latency_state){.text = text, .change = &change, .undone = true},
                        &(struct latency_state){.text = text, .change = &change}, &pair);
    latency_light_judge(l, &pair);
    find_touched(b);
    latency_light_watch(l, "--freeze 0", &b->server, &b->client);
    if (clock_getcpuclockid(b->server.pid, &b->server_clock) != 0) latency_give_up("the server has no clock");
    (void)follow(b, &reset);
    json_t *outcomes = b->json ? json_array() : NULL;
    if (!b->json) print_update();
    for (int64_t i = 0; i < b->updates; i++) {
        const bool back = i % 2;
        lw_client_get_stats(b->client, &stats);
        latency_light_read(&b->light, b->client, b->now);
        const double p = latency_light_share(&b->light, b->now);
        outcome[i] = follow(b, back ? &reset : &change);
        outcome[i].undone = back;
        outcome[i].start = back ? 1 - p : p;
        find_share(b, &outcome[i], stats.frame);
        if (b->json)
            json_array_append_new(outcomes, json_outcome(b, &outcome[i]));
        else
            print_outcome(text, &outcome[i]);
    }
    const double first = median_of(outcome, (size_t)b->updates, first_ms),
                 share = median_of(outcome, (size_t)b->updates, share_ms);
    if (!b->json) print_medians(b, text, first, share);
    lw_client_destroy(b->client);
    (void)lw_process_stop(&b->server, SIGTERM, LW_PROCESS_LIMIT_S);
    memset(l->wanted, 0, l->map.tile_count);
    latency_pair_finish(&pair);
    return b->json ? json_pack("{s:s, s:o, s:o, s:o, s:o}", "update", text, "agreement",
                               latency_real(l->agreement), "outcomes", outcomes, "first_ms",
                               latency_real(first), "share_ms", latency_real(share))
                   : NULL;
}

static void measure_updates(struct bench *b, const char *const *update, size_t count) {
    b->touched = latency_room(b->light.map.tile_count, sizeof *b->touched);
    b->version = latency_room(b->light.map.tile_count, sizeof *b->version);
    b->now = latency_room(LATENCY_CHANNELS * b->light.texel_count, sizeof *b->now);
    json_t *updates = json_array();
    if (!b->json) printf("%s\n\n", b->light.scene);
    for (size_t i = 0; i < count; i++) {
        json_t *one = measure(b, update[i]);
        if (one) json_array_append_new(updates, one);
    }
    if (b->json)
        latency_print(json_pack("{s:s, s:f, s:f, s:O}", "scene", b->light.scene, "first_target_ms", FIRST_MS,
                                "share_target_ms", SHARE_MS, "updates", updates));
    json_decref(updates);
    free(b->touched);
    free(b->version);
    free(b->now);
    free(b->moment);
}

int main(int argc, char **argv) {
    const char *argument[1 + UPDATES_MAX] = {"builtin:atrium-matt"};
    struct bench b = {
        .updates = 2, .settle_s = 20, .frames = 96, .light = {.fresh_frames = 12, .daemon_options = ""}};
    const char *times = NULL;
    struct lw_error err = {0};
    size_t count;
    bool done = false, walk = false;
    const struct lw_option table[] = {
        {"updates", "N",
         "of each kind, every other one undoes the one before; with --walk: passes over the times (default "
         "2)",
         LW_OPTION_INT, &b.updates, 1, UPDATES_MAX, NULL},
        {"settle", "S", "seconds, and ...", LW_OPTION_REAL, &b.settle_s, 0.01, 240, NULL},
        {"frames", "N",
         "frames after which the light counts as settled, if it has not converged before; with --walk: "
         "after which passes "
         "begin (default: 20 and 96)",
         LW_OPTION_INT, &b.frames, 1, 1e9, NULL},
        {"fresh", "N", "frames, of 8 times the rays, of the light to compare with (default 12)",
         LW_OPTION_INT, &b.light.fresh_frames, 1, 1e6, NULL},
        {"walk", NULL,
         "how far the light trails behind while the scene's animation runs, in place of updates",
         LW_OPTION_FLAG, &walk, 0, 0, NULL},
        {"times", "T,...", "with --walk: when to look, scene seconds (default " WALK_TIMES ")",
         LW_OPTION_STRING, &times, 0, 0, NULL},
        {"daemon", "OPTIONS", "for lightwelld, separated by blanks (default: none)", LW_OPTION_STRING,
         &b.light.daemon_options, 0, 0, NULL},
        {"reference", "FOLDER",
         "keep the light to compare with there, and take it from there where a run of the same SCENE, "
         "CAMERA, COMMAND or time, --fresh and --daemon has kept it (default: solve it in every run)",
         LW_OPTION_STRING, &b.light.reference, 0, 0, NULL},
        {"json", NULL, "print one JSON object", LW_OPTION_FLAG, &b.json, 0, 0, NULL},
    };
    const struct lw_options options = {
        .program = "bench_latency",
        .synopsis = "[OPTIONS] [SCENE \"CAMERA COMMAND\"... | --walk SCENE CAMERA]",
        .about = "How long a change of the scene takes to reach a client, and to become the light that it "
                 "leads to.\n"
                 "Without arguments: a lamp, a vase and the sun of builtin:atrium-matt; with --walk alone "
                 "its lantern, from its camera " WALK_CAMERA ".",
        .table = table,
        .count = sizeof table / sizeof table[0],
        .positional = argument,
        .positional_max = sizeof argument / sizeof argument[0]};
    lw_log_init("bench_latency", LW_LOG_WARNING);
    latency_must(lw_options_parse(&options, argc, argv, &count, &done, &err), &err);
    if (done) return 0;
    if (walk && count != 0 && count != 2) latency_give_up("--walk wants a scene and a camera, or neither");
    if (times && !walk) latency_give_up("--times goes with --walk alone");
    b.light.scene = argument[0];
    latency_light_introduce(&b.light);
    if (walk)
        latency_walk(&b.light, &(struct latency_walk_desc){.camera = count ? argument[1] : WALK_CAMERA,
                                                           .times = times ? times : WALK_TIMES,
                                                           .passes = b.updates,
                                                           .frames = b.frames,
                                                           .settle_s = b.settle_s,
                                                           .json = b.json});
    else if (count)
        measure_updates(&b, argument + 1, count - 1);
    else
        measure_updates(&b, atrium, sizeof atrium / sizeof *atrium);
    latency_light_finish(&b.light);
    return 0;
}
