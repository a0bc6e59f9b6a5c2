/* bench_latency: how long a change of the scene takes to reach a client, and to become the light that it leads to.
 *
 *     bench_latency [--updates N] [--settle S] [--frames N] [--daemon "OPTIONS"] [--json] [SCENE ["CAMERA COMMAND"...]]
 *
 * A lightwelld of its own with its default settings, its animation held, and one client on loopback that wants what a picture of
 * 1280 x 720 from that camera takes. Once the light rests, the client sends the change (a command of lightwellctl; the camera
 * is a name or as --camera of lightwell-view has it), waits until it rests again, undoes it by a reset, and so on. Both ways count.
 *
 * first tile: until the client has decoded a tile of the frame that shows the change, or of a later one, which the change touches.
 * 95 %: until p(E) = sum (E - E0)(E1' - E0') / sum (E1 - E0)(E1' - E0') reaches 0.95 over the texels that the picture shows, before
 * or after, all channels. E0 and E1 are the light at rest before and after; E0' and E1' the same of another round: were they
 * the same pictures, their noise would correlate with itself and count as change.
 *
 * The machine's load shows in CPU times: of the server's process, from the sending of the update on. */
#include "tests/bench/bench_setup.h"
#include "tests/support/process.h"

#include "client/control/ctl_command.h"
#include "client/view/stage.h"
#include "common/clock.h"
#include "common/log.h"
#include "common/options.h"

#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define WIDTH       1280u
#define HEIGHT      720u
#define FIRST_MS    100.0 /* targets */
#define SHARE_MS    500.0
#define SHARE       0.95
#define TOUCHED     0.01 /* relative root mean square by which the change moves what it touches */
#define REST_NS     1000000000u
#define LIMIT_NS    240000000000ull /* for the light to settle */
#define PATIENCE_NS 120000000000ull /* for the scene, for the first light, for an answer */
#define POLL_MS     100u
#define UPDATES_MAX 64u
#define CHANNELS    3u

/* What is done where there is nothing said: in the atrium a lamp moves, a vase moves by its width, the sun loses half. */
static const char *const atrium[] = {"lamp shift lantern 0.5 0 0", "vase shift amphora 0.6 0 0",
                                     "main light sun intensity 52 45 34.5"};

/* A moment after an update at which new tiles were there. */
struct moment {
    double ms, server_cpu_ms, client_cpu_ms;
    uint64_t frame, rays;
    double along; /* sum (E - E0)(E1' - E0') */
};

struct bench {
    const char *scene, *daemon_options;
    int64_t updates, frames;
    double settle_s;
    bool json;
    struct lw_process server;
    clockid_t server_clock;
    struct lw_client *client;
    struct lw_stage stage;
    struct lw_camera_view camera;
    float *picture; /* of WIDTH x HEIGHT; nobody looks at it */
    /* what is seen */
    uint8_t *shown; /* LW_TILE_TEXELS_MAX per tile */
    uint8_t *wanted;
    struct texel {
        lw_tile_id tile;
        uint32_t index; /* in its level */
    } * texel;
    size_t texel_count;
    float *before, *after, *along, *now; /* E0, E1, E1' - E0', E: CHANNELS per texel */
    uint64_t *version;                   /* of each tile, before the update */
    uint8_t *touched;                    /* by the change, per tile */
    struct moment *moment;
    size_t moment_count, moment_capacity;
};

/* What one update came to. */
struct outcome {
    bool undone; /* this was the way back */
    bool rested; /* the light did, before time was up */
    double first_frames, share_frames;
    struct moment first, share; /* share.ms < 0: never */
    double lowest;              /* of p after that */
    double rest_ms;
};

static void must(enum lw_status status, struct lw_error *err) {
    if (status != LW_OK) exit(lw_log_failure(err));
}

static void give_up(const char *what) {
    fprintf(stderr, "bench_latency: %s\n", what);
    exit(1);
}

static void *room(size_t count, size_t size) {
    void *p = calloc(count + 1, size);
    if (!p) give_up("no memory");
    return p;
}

static struct lw_client_stats poll_client(struct bench *b, unsigned ms) {
    struct lw_error err = {0};
    struct lw_client_stats stats;
    must(lw_client_poll(b->client, ms, &err), &err);
    lw_client_get_stats(b->client, &stats);
    return stats;
}

/* ---- what is seen ---- */

/* The first surface behind a pixel, at the finest level that the picture reads there. */
static void show_hit(struct bench *b, const struct lw_hit16 *hits, unsigned i) {
    const struct lw_scene *scene = b->stage.scene;
    const struct lw_atlas_map *map = lw_client_atlas_map(b->client);
    const uint8_t *needed = lw_compose_needed(b->stage.compose);
    if (hits->object[i] == LW_TRACE_MISS) return;
    const struct lw_mesh *mesh = &scene->mesh[scene->object[hits->object[i]].mesh];
    struct lw_facet facet;
    lw_scene_facet(scene, mesh, hits->triangle[i], &facet);
    const float weight[3] = {1 - hits->u[i] - hits->v[i], hits->u[i], hits->v[i]};
    struct lw_vec2 uv = lw_scene_facet_mean(facet.lightmap_uv, weight);
    if (hits->back[i]) uv.y += (float)mesh->back_offset;
    for (uint32_t level = 0; level <= LW_COMPOSE_LEVEL_MAX; level++) {
        const uint32_t x = (uint32_t)uv.x >> level, y = (uint32_t)uv.y >> level;
        const lw_tile_id id =
            lw_atlas_map_find(map, hits->object[i], level, x / LW_TILE_SIDE, y / LW_TILE_SIDE);
        if (id.v == UINT32_MAX || !needed[id.v]) continue;
        b->shown[(size_t)id.v * LW_TILE_TEXELS_MAX + y % LW_TILE_SIDE * LW_TILE_SIDE + x % LW_TILE_SIDE] = 1;
        return;
    }
}

static void show_pixels(struct bench *b) {
    const struct lw_camera_plane plane = lw_camera_plane(&b->camera, WIDTH, HEIGHT);
    struct lw_ray16 rays = {.salt = 0};
    struct lw_hit16 hits;
    _Static_assert(WIDTH % LW_TRACE_WIDTH == 0, "rows are cut into whole packets");
    for (uint32_t y = 0; y < HEIGHT; y++)
        for (uint32_t x = 0; x < WIDTH; x += LW_TRACE_WIDTH) {
            for (uint32_t i = 0; i < LW_TRACE_WIDTH; i++)
                lw_trace_set_ray(&rays, i, b->camera.position,
                                 lw_camera_direction(&plane, (float)(x + i) + 0.5f, (float)y + 0.5f),
                                 INFINITY);
            lw_trace_closest16(b->stage.trace, LW_TRACE_VIEW | LW_TRACE_COHERENT, UINT16_MAX, &rays, &hits);
            for (unsigned i = 0; i < LW_TRACE_WIDTH; i++) show_hit(b, &hits, i);
        }
}

/* Adds what the picture takes now to what is wanted and shown. */
static void look(struct bench *b) {
    const uint32_t tiles = lw_client_atlas_map(b->client)->tile_count;
    const struct lw_compose_view view = {.camera = b->camera, .width = WIDTH, .height = HEIGHT};
    struct lw_compose_report report;
    struct lw_error err = {0};
    bool moved;
    must(lw_stage_follow(&b->stage, &moved, &err), &err);
    const struct lw_compose_source source = lw_compose_source_of(b->client);
    lw_compose_render(b->stage.compose, &source, &b->stage.pose, &view, b->picture, &report);
    lw_compose_survey(b->stage.compose, &source, &b->stage.pose, &view);
    const uint8_t *needed = lw_compose_needed(b->stage.compose),
                  *around = lw_compose_around(b->stage.compose);
    for (uint32_t t = 0; t < tiles; t++) b->wanted[t] |= (uint8_t)(needed[t] | around[t]);
    show_pixels(b);
    lw_tile_id *list = room(tiles, sizeof *list);
    size_t count = 0;
    for (uint32_t t = 0; t < tiles; t++)
        if (b->wanted[t]) list[count++] = (lw_tile_id){t};
    must(lw_client_want(b->client, list, count), &err);
    free(list);
}

static void list_texels(struct bench *b) {
    const struct lw_atlas_map *map = lw_client_atlas_map(b->client);
    b->texel_count = 0;
    for (size_t i = 0; i < (size_t)map->tile_count * LW_TILE_TEXELS_MAX; i++) b->texel_count += b->shown[i];
    b->texel = room(b->texel_count, sizeof *b->texel);
    size_t at = 0;
    for (size_t i = 0; i < (size_t)map->tile_count * LW_TILE_TEXELS_MAX; i++) {
        if (!b->shown[i]) continue;
        const lw_tile_id tile = {(uint32_t)(i / LW_TILE_TEXELS_MAX)};
        const struct lw_tile_place *place = &map->place[tile.v];
        const uint32_t in = (uint32_t)(i % LW_TILE_TEXELS_MAX),
                       y = place->y * LW_TILE_SIDE + in / LW_TILE_SIDE,
                       x = place->x * LW_TILE_SIDE + in % LW_TILE_SIDE;
        b->texel[at++] =
            (struct texel){tile, y * lw_client_get_level(b->client, place->object, place->level).width + x};
    }
    float **plane[] = {&b->before, &b->after, &b->along, &b->now};
    for (size_t i = 0; i < sizeof plane / sizeof *plane; i++)
        *plane[i] = room(CHANNELS * b->texel_count, sizeof **plane[i]);
}

static void free_texels(struct bench *b) {
    float **plane[] = {&b->before, &b->after, &b->along, &b->now};
    for (size_t i = 0; i < sizeof plane / sizeof *plane; i++) free(*plane[i]);
    free(b->texel);
    b->texel_count = 0;
}

static void read_light(const struct bench *b, float *out) {
    const struct lw_atlas_map *map = lw_client_atlas_map(b->client);
    uint32_t last = UINT32_MAX;
    const float *rgb = NULL;
    for (size_t i = 0; i < b->texel_count; i++) {
        if (b->texel[i].tile.v != last) {
            last = b->texel[i].tile.v;
            rgb = lw_client_get_level(b->client, map->place[last].object, map->place[last].level).rgb;
        }
        memcpy(out + CHANNELS * i, rgb + CHANNELS * b->texel[i].index, CHANNELS * sizeof *out);
    }
}

static double dot_difference(const struct bench *b, const float *to, const float *from, const float *along) {
    double sum = 0;
    for (size_t i = 0; i < CHANNELS * b->texel_count; i++)
        sum += ((double)to[i] - (double)from[i]) * (double)along[i];
    return sum;
}

/* Tiles that E1' and E0' tell apart by more than their noise. */
static void find_touched(struct bench *b, const float *from) {
    const uint32_t tiles = lw_client_atlas_map(b->client)->tile_count;
    double *change = room(2ul * tiles, sizeof *change), *whole = change + tiles;
    for (size_t i = 0; i < CHANNELS * b->texel_count; i++) {
        const uint32_t t = b->texel[i / CHANNELS].tile.v;
        change[t] += (double)b->along[i] * (double)b->along[i];
        whole[t] += (double)from[i] * (double)from[i];
    }
    for (uint32_t t = 0; t < tiles; t++) {
        const double floor = TOUCHED + (double)lw_client_get_tile(b->client, (lw_tile_id){t}).error;
        b->touched[t] = change[t] > floor * floor * whole[t];
    }
    free(change);
}

/* ---- updates ---- */

static double ms_since(uint64_t since_ns, uint64_t now_ns) { return 1e-6 * (double)(now_ns - since_ns); }

static void note(struct bench *b, const struct moment *moment) {
    if (b->moment_count == b->moment_capacity) {
        b->moment_capacity = 2 * b->moment_capacity + 64;
        b->moment = realloc(b->moment, b->moment_capacity * sizeof *b->moment);
        if (!b->moment) give_up("no memory");
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
    for (uint32_t t = 0; t < lw_client_atlas_map(b->client)->tile_count; t++) {
        const uint64_t version = lw_client_get_tile(b->client, (lw_tile_id){t}).version;
        if (b->touched[t] && version != b->version[t] && version >= frame) return true;
    }
    return false;
}

/* Whether the light counts as settled without having come to rest. Each frame forgets only so much of the light before. */
static bool is_over(const struct bench *b, uint64_t frames, uint64_t ns) {
    return (frames >= (uint64_t)b->frames && ns >= (uint64_t)(1e9 * b->settle_s)) || ns > LIMIT_NS;
}

static bool is_converged(const struct bench *b) {
    const struct lw_compose_source source = lw_compose_source_of(b->client);
    struct lw_compose_report report;
    lw_compose_check(b->stage.compose, &source, &report);
    return report.converged;
}

enum until { ANSWERED, SETTLED };

/* Sends an update and follows the light until it rests, or its frames are over. Fills b->moment. */
static struct outcome follow(struct bench *b, const struct lw_scene_change *change, enum until until) {
    const uint32_t tiles = lw_client_atlas_map(b->client)->tile_count;
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
    must(lw_client_update(b->client, change, 1, NULL, &err), &err);
    while (!answered ||
           (until == SETTLED && !outcome.rested && !is_over(b, frame - old.frame, now_ns - from.ns))) {
        stats = poll_client(b, POLL_MS);
        const struct clocks now = clocks_now(b);
        struct moment moment = moment_at(&from, &now, &stats);
        now_ns = now.ns;
        answered |= lw_client_next_answer(b->client, &answer);
        if (answered && answer.code) give_up(answer.text);
        if (!answered && now_ns - from.ns > PATIENCE_NS) give_up("the server does not answer");
        if (stats.frame != frame) heard_ns = now_ns;
        frame = stats.frame;
        if (stats.tiles != tiles_then && b->texel_count) {
            if (outcome.first.ms < 0 && answered && shows_change(b, answer.frame)) {
                outcome.first = moment;
                outcome.first_frames = (double)(moment.frame - old.frame);
            }
            read_light(b, b->now);
            moment.along = dot_difference(b, b->now, b->before, b->along);
            note(b, &moment);
        }
        tiles_then = stats.tiles;
        outcome.rested = answered && now_ns - heard_ns > REST_NS && is_converged(b);
    }
    outcome.rest_ms = ms_since(from.ns, heard_ns);
    return outcome;
}

/* p of each moment: that reached SHARE first, and the lowest after it. */
static void find_share(struct bench *b, struct outcome *outcome, uint64_t old_frame) {
    const double whole = dot_difference(b, b->after, b->before, b->along);
    outcome->lowest = 1;
    for (size_t i = 0; i < b->moment_count; i++) {
        b->moment[i].along /= whole;
        const struct moment *m = &b->moment[i];
        if (outcome->share.ms < 0 && m->along >= SHARE) {
            outcome->share = *m;
            outcome->share_frames = (double)(m->frame - old_frame);
        }
        if (outcome->share.ms >= 0 && m->along < outcome->lowest) outcome->lowest = m->along;
    }
}

static void turn_around(struct bench *b) {
    float *swap = b->before;
    b->before = b->after;
    b->after = swap;
    for (size_t i = 0; i < CHANNELS * b->texel_count; i++) b->along[i] = -b->along[i];
}

/* ---- what is printed ---- */

static double median_of(const struct outcome *o, size_t count, double (*value)(const struct outcome *)) {
    double v[UPDATES_MAX];
    for (size_t i = 0; i < count; i++) v[i] = value(&o[i]);
    return bench_median(v, count);
}
/* What never came counts as later than everything. */
static double first_ms(const struct outcome *o) { return o->first.ms < 0 ? (double)INFINITY : o->first.ms; }
static double share_ms(const struct outcome *o) { return o->share.ms < 0 ? (double)INFINITY : o->share.ms; }

static void print_json_number(double v) {
    if (isfinite(v))
        printf("%.4f", v);
    else
        printf("null");
}

static void print_json_outcome(const struct bench *b, const struct outcome *o, bool first) {
    printf("%s\n    {\"undone\": %s, \"rested\": %s, \"rest_ms\": %.1f, \"first_ms\": ", first ? "" : ",",
           o->undone ? "true" : "false", o->rested ? "true" : "false", o->rest_ms);
    print_json_number(first_ms(o));
    printf(", \"first_frames\": %.0f, \"first_server_cpu_ms\": %.1f, \"share_ms\": ", o->first_frames,
           o->first.server_cpu_ms);
    print_json_number(share_ms(o));
    printf(", \"share_frames\": %.0f, \"share_server_cpu_ms\": %.1f, \"share_client_cpu_ms\": %.1f, "
           "\"lowest_after\": %.4f,\n     \"progress\": [",
           o->share_frames, o->share.server_cpu_ms, o->share.client_cpu_ms, o->lowest);
    for (size_t i = 0; i < b->moment_count; i++)
        printf("%s[%.1f, %.4f, %llu]", i ? ", " : "", b->moment[i].ms, b->moment[i].along,
               (unsigned long long)b->moment[i].rays);
    printf("]}");
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
    printf(" %.2f | %.1f%s |\n", o->lowest, 1e-3 * o->rest_ms, o->rested ? "" : " and on");
    fflush(stdout);
}

static void print_head(const struct bench *b) {
    if (b->json)
        printf("{\"scene\": \"%s\", \"first_target_ms\": %.0f, \"share_target_ms\": %.0f, \"updates\": [",
               b->scene, FIRST_MS, SHARE_MS);
    else
        printf("%s\n\n| update | first tile, ms | frames | server CPU ms | 95 %%, ms | frames | server CPU "
               "ms | lowest "
               "after | rest, s |\n|---|---|---|---|---|---|---|---|---|\n",
               b->scene);
    fflush(stdout);
}

static void print_medians(const struct bench *b, const char *update, const struct outcome *o) {
    const size_t count = (size_t)b->updates;
    const double first = median_of(o, count, first_ms), share = median_of(o, count, share_ms);
    if (b->json) {
        printf("],\n   \"first_ms\": ");
        print_json_number(first);
        printf(", \"share_ms\": ");
        print_json_number(share);
        printf("}");
    } else {
        printf("| %s, median | %.0f | | | %.0f | | | | |\n", update, first, share);
        printf("| %s, target | %.0f: %s | | | %.0f: %s | | | | |\n", update, FIRST_MS,
               first <= FIRST_MS ? "met" : "missed", SHARE_MS, share <= SHARE_MS ? "met" : "missed");
    }
    fflush(stdout);
}

/* ---- the whole ---- */

static void begin(struct bench *b) {
    struct lw_error err = {0};
    char arguments[1024];
    if ((size_t)snprintf(arguments, sizeof arguments, "%s --freeze 0 %s", b->scene, b->daemon_options) >=
        sizeof arguments)
        give_up("--daemon is too long");
    lw_process_serve(&b->server, arguments);
    if (clock_getcpuclockid(b->server.pid, &b->server_clock) != 0) give_up("the server has no clock");
    must(lw_client_create(&(struct lw_client_desc){.host = "127.0.0.1",
                                                   .port = b->server.port,
                                                   .name = "bench_latency",
                                                   .wants_nothing = true,
                                                   .control = true},
                          &b->client, &err),
         &err);
    const uint64_t limit_ns = lw_clock_ns() + PATIENCE_NS;
    while (!poll_client(b, POLL_MS).first_ns)
        if (lw_clock_ns() > limit_ns) give_up("no first light");
    must(lw_stage_init(&b->stage, b->client, 0, &err), &err);
    const uint32_t tiles = lw_client_atlas_map(b->client)->tile_count;
    b->picture = room((size_t)WIDTH * HEIGHT * 3, sizeof *b->picture);
    b->shown = room((size_t)tiles * LW_TILE_TEXELS_MAX, sizeof *b->shown);
    b->wanted = room(tiles, sizeof *b->wanted);
    b->touched = room(tiles, sizeof *b->touched);
    b->version = room(tiles, sizeof *b->version);
}

static void end(struct bench *b) {
    lw_stage_finish(&b->stage);
    lw_client_destroy(b->client);
    free(b->picture);
    free(b->shown);
    free(b->wanted);
    free(b->touched);
    free(b->version);
    free(b->moment);
    (void)lw_process_stop(&b->server, SIGTERM, 30);
}

/* "CAMERA COMMAND..." */
static void read_update(struct bench *b, const char *text, struct lw_scene_change *out_change) {
    char line[512];
    const char *word[LW_CTL_COMMAND_WORDS_MAX];
    size_t count;
    uint32_t camera;
    struct lw_ctl_command_state state;
    struct lw_error err = {0};
    if ((size_t)snprintf(line, sizeof line, "%s", text) >= sizeof line) give_up("an update is too long");
    must(lw_ctl_command_split(line, word, &count, &err), &err);
    if (count < 2) give_up("an update is a camera and a command: \"main hide amphora\"");
    if (strchr(word[0], ':')) {
        must(lw_camera_parse(word[0], &b->camera, &err), &err);
    } else {
        must(lw_camera_find(b->stage.scene, word[0], &camera, &err), &err);
        b->camera = lw_camera_of_scene(b->stage.scene, &b->stage.pose, camera);
    }
    must(lw_ctl_command_state_init(&state, b->client), &err);
    must(lw_ctl_command_parse(&state, word + 1, count - 1, out_change, &err), &err);
    lw_ctl_command_state_finish(&state);
}

static const struct lw_scene_change reset = {.kind = LW_SCENE_CHANGE_RESET};

/* What is seen before and after; E0' and E1'. */
static void prepare(struct bench *b, const struct lw_scene_change *change) {
    const uint32_t tiles = lw_client_atlas_map(b->client)->tile_count;
    memset(b->wanted, 0, tiles);
    memset(b->shown, 0, (size_t)tiles * LW_TILE_TEXELS_MAX);
    b->texel_count = 0;
    (void)follow(b, &reset, ANSWERED); /* the last update may not have been undone */
    look(b);
    (void)follow(b, change, ANSWERED);
    look(b);
    list_texels(b);
    (void)follow(b, &reset, SETTLED);
    read_light(b, b->before);
    (void)follow(b, change, SETTLED);
    read_light(b, b->after);
    for (size_t i = 0; i < CHANNELS * b->texel_count; i++) b->along[i] = b->after[i] - b->before[i];
    find_touched(b, b->before);
}

static void measure(struct bench *b, const char *text, bool first) {
    struct lw_scene_change change;
    struct outcome outcome[UPDATES_MAX];
    struct lw_client_stats stats;
    read_update(b, text, &change);
    prepare(b, &change);
    (void)follow(b, &reset, SETTLED);
    read_light(b, b->before);
    if (b->json)
        printf("%s\n  {\"update\": \"%s\", \"texels\": %zu, \"outcomes\": [", first ? "" : ",", text,
               b->texel_count);
    for (int64_t i = 0; i < b->updates; i++) {
        const bool back = i % 2;
        lw_client_get_stats(b->client, &stats);
        outcome[i] = follow(b, back ? &reset : &change, SETTLED);
        outcome[i].undone = back;
        read_light(b, b->after);
        find_share(b, &outcome[i], stats.frame);
        if (b->json)
            print_json_outcome(b, &outcome[i], i == 0);
        else
            print_outcome(text, &outcome[i]);
        turn_around(b);
    }
    print_medians(b, text, outcome);
    free_texels(b);
}

int main(int argc, char **argv) {
    const char *argument[1 + UPDATES_MAX] = {"builtin:atrium"};
    struct bench b = {.updates = 4, .settle_s = 20, .frames = 256, .daemon_options = ""};
    struct lw_error err = {0};
    size_t count;
    bool done = false;
    const struct lw_option table[] = {
        {"updates", "N", "of each kind, every other one undoes the one before (default 4)", LW_OPTION_INT,
         &b.updates, 1, UPDATES_MAX, NULL},
        {"settle", "S", "seconds, and ...", LW_OPTION_REAL, &b.settle_s, 0.01, 240, NULL},
        {"frames", "N",
         "frames after which the light counts as settled, if it has not come to rest before (default: 20 and "
         "256)",
         LW_OPTION_INT, &b.frames, 1, 1e9, NULL},
        {"daemon", "OPTIONS", "for lightwelld, separated by blanks (default: none)", LW_OPTION_STRING,
         &b.daemon_options, 0, 0, NULL},
        {"json", NULL, "print one JSON object", LW_OPTION_FLAG, &b.json, 0, 0, NULL},
    };
    const struct lw_options options = {.program = "bench_latency",
                                       .synopsis = "[OPTIONS] [SCENE \"CAMERA COMMAND\"...]",
                                       .about =
                                           "How long a change of the scene takes to reach a client, and to "
                                           "become the light that it leads to.\n"
                                           "Without arguments: a lamp, a vase and the sun of builtin:atrium.",
                                       .table = table,
                                       .count = sizeof table / sizeof table[0],
                                       .positional = argument,
                                       .positional_max = sizeof argument / sizeof argument[0]};
    lw_log_init("bench_latency", LW_LOG_WARNING);
    must(lw_options_parse(&options, argc, argv, &count, &done, &err), &err);
    if (done) return 0;
    b.scene = argument[0];
    const char *const *update = count ? argument + 1 : atrium;
    const size_t updates = count ? count - 1 : sizeof atrium / sizeof *atrium;
    begin(&b);
    print_head(&b);
    for (size_t i = 0; i < updates; i++) measure(&b, update[i], i == 0);
    if (b.json) printf("]}\n");
    end(&b);
    return 0;
}
