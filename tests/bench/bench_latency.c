/* bench_latency: how long a change of the scene takes to reach a client, and to become the light that it leads to.
 *
 *     bench_latency [--updates N] [--settle S] [--frames N] [--daemon "OPTIONS"] [--truth FOLDER] [--json]
 *                   [SCENE ["CAMERA COMMAND"...]]
 *
 * A lightwelld of its own with its default settings, its animation held, and one client on loopback that wants what a picture of
 * 1280 x 720 from that camera takes. Once the light rests, the client sends the change (a command of lightwellctl; the camera
 * is a name or as --camera of lightwell-view has it), waits until it rests again, undoes it by a reset, and so on. Both ways count.
 *
 * first tile: until the client has decoded a tile of the frame that shows the change, or of a later one, which the change touches.
 * 95 %: until p(E) = sum d(E - E0) d(E1' - E0') / sum d(E1 - E0) d(E1' - E0') reaches 0.95 over squares of 4 x 4 texels of level 2,
 * all channels; d: sum over a square's texels that the picture shows, before or after, of what is in brackets times w. E0, E0', E1, E1' are the light of four more servers that never knew anything else than the state
 * before (0) and the state after (1), by two seeds: with one, the noise of E0 and E1 would count as change, and where a vase
 * moves most of what is seen does not change. w is one over the texel's mean light (plus the median's of all): else the
 * cages of lamps, some hundred texels a thousand times as bright as the rest and as noisy, would alone decide. What is over twice that
 * light is clipped: single texels of a first frame. So p is 0 for light that is settled before, 1 for light that is settled
 * after, whatever the server remembers. Agreement is the cosine of E1 - E0 and E1' - E0': where it is small, p is noise; more --fresh
 * frames help.
 *
 * --truth keeps those four servers' light in files, for runs of the same thing.
 *
 * The machine's load shows in CPU times: of the server's process, from the sending of the update on. */
#include "tests/bench/bench_setup.h"
#include "tests/support/process.h"

#include "client/control/ctl_command.h"
#include "client/view/stage.h"
#include "common/checked_file.h"
#include "common/clock.h"
#include "common/log.h"
#include "common/options.h"

#include <errno.h>
#include <float.h>
#include <inttypes.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <xxhash.h>

#define WIDTH         1280u
#define HEIGHT        720u
#define FIRST_MS      100.0 /* targets */
#define SHARE_MS      500.0
#define SHARE         0.95
#define TOUCHED       0.01 /* relative root mean square by which the change moves what it touches */
#define FRESH_OPTIONS "--clock manual --light whole --direct-samples 8 --indirect-samples 16"
#define LEVEL         LW_ATLAS_READ_MAX /* whose texels are judged */
#define SQUARE        4u /* texels, each way, that are judged together: what is noise in them is not change */
#define REST_NS       1000000000u
#define LIMIT_NS      240000000000ull /* for the light to settle */
#define PATIENCE_NS   120000000000ull /* for the scene, for the first light, for an answer */
#define POLL_MS       100u
#define UPDATES_MAX   64u
#define CHANNELS      3u

/* What is done where there is nothing said: in the atrium a lamp moves, a vase moves by its width, the sun loses half. */
static const char *const atrium[] = {"lamp shift lantern -1.5 0 0", "vase shift amphora 0.6 0 0",
                                     "main light sun intensity 52 45 34.5"};

/* What a server that never knew anything else sends of one state, and what the picture takes of it. */
struct fresh {
    float *light;    /* CHANNELS per texel */
    uint8_t *shown;  /* per texel: in the picture */
    uint8_t *wanted; /* per tile: by the picture */
};

/* In front of a fresh's arrays in its file. */
struct fresh_header {
    struct lw_checked_file_kind kind;
    uint64_t key;
};
static const struct lw_checked_file_kind fresh_kind = {{'l', 'w', 'f', 'r', 'e', 's', 'h', '\n'}, 1};

/* A state of the scene. */
struct state {
    const char *text;                     /* the camera and the command: the file's key has it */
    const struct lw_scene_change *change; /* that leads to it */
    bool undone;                          /* made and taken back */
};

/* A moment after an update at which new tiles were there. */
struct moment {
    double ms, server_cpu_ms, client_cpu_ms;
    uint64_t frame, rays;
    double along; /* sum (E - E0)(E1' - E0') */
};

struct bench {
    const char *scene, *daemon_options, *truth; /* truth: a folder, or NULL */
    int64_t updates, frames, fresh_frames;
    double settle_s;
    bool json;
    struct lw_process server;
    clockid_t server_clock;
    struct lw_client *client;
    struct lw_client *introduced; /* by a server that has ended: has the scene */
    struct lw_camera_view camera;
    struct lw_atlas_map map;
    /* per tile */
    uint8_t *wanted, *touched; /* by the picture; by the change */
    uint64_t *version;         /* before the update */
    /* texels of LEVEL, object by object, or of the coarsest level of objects that have fewer */
    size_t texel_count;
    size_t *first;    /* texel of each object */
    uint32_t *square; /* of each texel */
    size_t square_count;
    double *change[2], *progress; /* E1 - E0, E1' - E0' and E - E0: CHANNELS per square */
    uint8_t *shown;               /* in the picture */
    float *before[2], *after[2];  /* E0 and E0', E1 and E1': CHANNELS per texel */
    float *now;                   /* E */
    double agreement;
    float *weight, *most; /* w, 0 where nothing is shown; what E is clipped at */
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
    double start, end;          /* p before the update and when the light had settled */
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

/* ---- texels ---- */

static uint32_t level_of(const struct bench *b, uint32_t object) {
    const uint32_t levels = b->map.atlas[object].level_count;
    return levels > LEVEL ? LEVEL : levels - 1;
}

static void lay_out_squares(struct bench *b) {
    b->square = room(b->texel_count, sizeof *b->square);
    for (uint32_t o = 0; o < b->map.object_count; o++) {
        if (!b->map.atlas[o].level_count) continue;
        const struct lw_atlas_level *level = &b->map.atlas[o].level[level_of(b, o)];
        const uint32_t columns = (level->width + SQUARE - 1) / SQUARE;
        for (uint32_t y = 0; y < level->height; y++)
            for (uint32_t x = 0; x < level->width; x++)
                b->square[b->first[o] + (size_t)y * level->width + x] =
                    (uint32_t)b->square_count + y / SQUARE * columns + x / SQUARE;
        b->square_count += (size_t)columns * ((level->height + SQUARE - 1) / SQUARE);
    }
    double **plane[] = {&b->change[0], &b->change[1], &b->progress};
    for (size_t i = 0; i < sizeof plane / sizeof *plane; i++)
        *plane[i] = room(CHANNELS * b->square_count, sizeof **plane[i]);
}

static void lay_out(struct bench *b, const struct lw_scene *scene) {
    if (lw_atlas_map_init(&b->map, scene) != LW_OK) give_up("no memory");
    b->first = room(b->map.object_count, sizeof *b->first);
    for (uint32_t o = 0; o < b->map.object_count; o++) {
        b->first[o] = b->texel_count;
        if (!b->map.atlas[o].level_count) continue;
        const struct lw_atlas_level *level = &b->map.atlas[o].level[level_of(b, o)];
        b->texel_count += (size_t)level->width * level->height;
    }
    lay_out_squares(b);
    float **plane[] = {&b->before[0], &b->before[1], &b->after[0], &b->after[1],
                       &b->now,       &b->weight,    &b->most};
    for (size_t i = 0; i < sizeof plane / sizeof *plane; i++)
        *plane[i] = room(CHANNELS * b->texel_count, sizeof **plane[i]);
    b->shown = room(b->texel_count, sizeof *b->shown);
    b->wanted = room(b->map.tile_count, sizeof *b->wanted);
    b->touched = room(b->map.tile_count, sizeof *b->touched);
    b->version = room(b->map.tile_count, sizeof *b->version);
}

static void read_light(const struct bench *b, const struct lw_client *client, float *out) {
    for (uint32_t o = 0; o < b->map.object_count; o++) {
        if (!b->map.atlas[o].level_count) continue;
        const struct lw_client_level level = lw_client_get_level(client, o, level_of(b, o));
        memcpy(out + CHANNELS * b->first[o], level.rgb,
               (size_t)level.width * level.height * CHANNELS * sizeof *out);
    }
}

/* The first surface behind a pixel. */
static void show_hit(const struct bench *b, const struct lw_scene *scene, const struct lw_hit16 *hits,
                     unsigned i, uint8_t *shown) {
    const uint32_t o = hits->object[i];
    if (o == LW_TRACE_MISS || !b->map.atlas[o].level_count) return;
    const struct lw_mesh *mesh = &scene->mesh[scene->object[o].mesh];
    const uint32_t level = level_of(b, o);
    const float weight[3] = {1 - hits->u[i] - hits->v[i], hits->u[i], hits->v[i]};
    struct lw_facet facet;
    lw_scene_facet(scene, mesh, hits->triangle[i], &facet);
    struct lw_vec2 uv = lw_scene_facet_mean(facet.lightmap_uv, weight);
    if (hits->back[i]) uv.y += (float)mesh->back_offset;
    const struct lw_atlas_level *at = &b->map.atlas[o].level[level];
    const uint32_t x = (uint32_t)uv.x >> level, y = (uint32_t)uv.y >> level;
    if (x < at->width && y < at->height) shown[b->first[o] + (size_t)y * at->width + x] = 1;
}

static void show_pixels(const struct bench *b, const struct lw_stage *stage, uint8_t *shown) {
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
            lw_trace_closest16(stage->trace, LW_TRACE_VIEW | LW_TRACE_COHERENT, UINT16_MAX, &rays, &hits);
            for (unsigned i = 0; i < LW_TRACE_WIDTH; i++) show_hit(b, stage->scene, &hits, i, shown);
        }
}

/* What the picture takes of what a client has now. */
static void look(const struct bench *b, struct lw_client *client, struct fresh *out) {
    const struct lw_compose_view view = {.camera = b->camera, .width = WIDTH, .height = HEIGHT};
    struct lw_compose_report report;
    struct lw_stage stage;
    struct lw_error err = {0};
    bool moved;
    must(lw_stage_init(&stage, client, 0, &err), &err);
    must(lw_stage_follow(&stage, &moved, &err), &err);
    const struct lw_compose_source source = lw_compose_source_of(client);
    float *picture = room((size_t)WIDTH * HEIGHT * 3, sizeof *picture);
    lw_compose_render(stage.compose, &source, &stage.pose, &view, picture, &report);
    lw_compose_survey(stage.compose, &source, &stage.pose, &view);
    const uint8_t *needed = lw_compose_needed(stage.compose), *around = lw_compose_around(stage.compose);
    for (uint32_t t = 0; t < b->map.tile_count; t++) out->wanted[t] = (uint8_t)(needed[t] | around[t]);
    show_pixels(b, &stage, out->shown);
    lw_stage_finish(&stage);
    free(picture);
}

/* ---- the change ---- */

/* How far light is from other light, square by square, relative to what is there. What is too bright by far to be light of before or
 * after is not taken for more than it can be. */
static void compare(const struct bench *b, const float *light, const float *other, double *out) {
    memset(out, 0, CHANNELS * b->square_count * sizeof *out);
    for (size_t i = 0; i < CHANNELS * b->texel_count; i++)
        out[CHANNELS * b->square[i / CHANNELS] + i % CHANNELS] +=
            (double)b->weight[i] * (double)(fminf(light[i], b->most[i]) - fminf(other[i], b->most[i]));
}

static double dot(const struct bench *b, const double *x, const double *y) {
    double sum = 0;
    for (size_t i = 0; i < CHANNELS * b->square_count; i++) sum += x[i] * y[i];
    return sum;
}

static double project(const struct bench *b, const float *light) {
    compare(b, light, b->before[0], b->progress);
    return dot(b, b->change[1], b->progress) / dot(b, b->change[1], b->change[0]);
}

static int compare_floats(const void *a, const void *b) {
    const float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

static float median_of_light(const struct bench *b, const float *light) {
    float *all = room(CHANNELS * b->texel_count, sizeof *all);
    size_t count = 0;
    for (size_t i = 0; i < CHANNELS * b->texel_count; i++)
        if (b->shown[i / CHANNELS]) all[count++] = light[i];
    qsort(all, count, sizeof *all, compare_floats);
    const float median = all[count / 2];
    free(all);
    return median;
}

/* What light adds to a place counts by what is there. */
static void weigh(struct bench *b) {
    const float median = median_of_light(b, b->before[0]);
    for (size_t i = 0; i < CHANNELS * b->texel_count; i++) {
        const float mean = 0.25f * (b->before[0][i] + b->before[1][i] + b->after[0][i] + b->after[1][i]);
        b->weight[i] = b->shown[i / CHANNELS] ? 1 / (hypotf(mean, median) + FLT_MIN) : 0;
        b->most[i] = 2 * (mean + median);
    }
    for (int k = 0; k < 2; k++) compare(b, b->after[k], b->before[k], b->change[k]);
    b->agreement = dot(b, b->change[0], b->change[1]) /
                   (sqrt(dot(b, b->change[0], b->change[0]) * dot(b, b->change[1], b->change[1])) + DBL_MIN);
}

/* Tiles that the change moves by more than a little, as far as they are shown: those of LEVEL, and the finer ones below. */
static void find_touched(struct bench *b) {
    for (uint32_t t = 0; t < b->map.tile_count; t++) {
        const struct lw_tile_place *place = &b->map.place[t];
        const uint32_t level = level_of(b, place->object);
        b->touched[t] = 0;
        if (place->level > level || !b->wanted[t]) continue;
        const uint32_t width = b->map.atlas[place->object].level[level].width, shift = level - place->level;
        double change = 0, whole = 0;
        for (uint32_t y = place->y * LW_TILE_SIDE >> shift;
             y < (place->y * LW_TILE_SIDE + place->height) >> shift; y++)
            for (uint32_t x = place->x * LW_TILE_SIDE >> shift;
                 x < (place->x * LW_TILE_SIDE + place->width) >> shift; x++) {
                const size_t texel = b->first[place->object] + (size_t)y * width + x;
                for (size_t i = CHANNELS * texel; i < CHANNELS * texel + CHANNELS && b->shown[texel]; i++) {
                    const double from = (double)b->before[0][i], to = (double)b->after[0][i];
                    change += (to - from) * (to - from);
                    whole += from * from;
                }
            }
        b->touched[t] = change > TOUCHED * TOUCHED * whole;
    }
}

/* ---- light that knows one state alone ---- */

static struct lw_client *join(uint16_t port, bool wants_nothing) {
    struct lw_client *client;
    struct lw_error err = {0};
    must(lw_client_create(&(struct lw_client_desc){.host = "127.0.0.1",
                                                   .port = port,
                                                   .name = "bench_latency",
                                                   .wants_nothing = wants_nothing,
                                                   .control = true},
                          &client, &err),
         &err);
    return client;
}

static void poll_one(struct lw_client *client, unsigned ms, struct lw_client_stats *out_stats) {
    struct lw_error err = {0};
    must(lw_client_poll(client, ms, &err), &err);
    lw_client_get_stats(client, out_stats);
}

static void serve(const struct bench *b, const char *options, struct lw_process *out_server) {
    char arguments[1024];
    if ((size_t)snprintf(arguments, sizeof arguments, "%s --freeze 0 %s %s", b->scene, options,
                         b->daemon_options) >= sizeof arguments)
        give_up("--daemon is too long");
    lw_process_serve(out_server, arguments);
}

/* The scene as --freeze 0 holds it: of that, what commands go on from. */
static void read_update(struct bench *b, const struct lw_scene *scene, const char *text,
                        struct lw_scene_change *out_change) {
    char line[512];
    const char *word[LW_CTL_COMMAND_WORDS_MAX];
    size_t count;
    uint32_t camera;
    struct lw_pose pose;
    struct lw_error err = {0};
    must(lw_pose_init(&pose, scene), &err);
    lw_pose_evaluate(&pose, scene, 0);
    if ((size_t)snprintf(line, sizeof line, "%s", text) >= sizeof line) give_up("an update is too long");
    must(lw_ctl_command_split(line, word, &count, &err), &err);
    if (count < 2) give_up("an update is a camera and a command: \"main hide amphora\"");
    if (strchr(word[0], ':')) {
        must(lw_camera_parse(word[0], &b->camera, &err), &err);
    } else {
        must(lw_camera_find(scene, word[0], &camera, &err), &err);
        b->camera = lw_camera_of_scene(scene, &pose, camera);
    }
    struct lw_ctl_command_state state = {.scene = scene,
                                         .object_to_world = pose.object_to_world,
                                         .light = room(scene->light_count, sizeof *state.light)};
    for (uint32_t l = 0; l < scene->light_count; l++)
        state.light[l] = (struct lw_client_light){pose.light[l].position_ws, pose.light[l].direction_ws,
                                                  pose.light[l].intensity};
    must(lw_ctl_command_parse(&state, word + 1, count - 1, out_change, &err), &err);
    free(state.light);
    lw_pose_finish(&pose);
}

static const struct lw_scene_change reset = {.kind = LW_SCENE_CHANGE_RESET};

/* Hears of the scene from a server that nothing is wanted of. */
static void introduce(struct bench *b) {
    struct lw_process server;
    struct lw_client_stats stats;
    serve(b, "", &server);
    b->introduced = join(server.port, true);
    while (!lw_client_scene(b->introduced)) poll_one(b->introduced, POLL_MS, &stats);
    (void)lw_process_stop(&server, SIGTERM, 30);
    lay_out(b, lw_client_scene(b->introduced));
}

/* The light of a server to which the change is made before its first frame, and undone in the same moment if it is `undone`: what
 * was moved once is another object for rays, wherever it is. Frames begin with lines on our stdin, which is its. */
static void solve_fresh(const struct bench *b, const struct state *state, unsigned seed, struct fresh *out) {
    struct lw_process server;
    struct lw_client_stats stats = {0};
    struct lw_error err = {0};
    char options[128];
    int line[2];
    if (pipe(line) != 0 || dup2(line[0], STDIN_FILENO) < 0) give_up("no pipe");
    snprintf(options, sizeof options, FRESH_OPTIONS " --seed %u", seed);
    serve(b, options, &server);
    struct lw_client *client = join(server.port, false);
    while (!lw_client_scene(client)) poll_one(client, POLL_MS, &stats);
    must(lw_client_update(client, (struct lw_scene_change[]){*state->change, reset}, state->undone ? 2 : 1,
                          NULL, &err),
         &err);
    for (int i = 0; i < 3; i++) poll_one(client, POLL_MS, &stats); /* it hears of that */
    for (int64_t i = 0; i < b->fresh_frames; i++)
        if (write(line[1], "\n", 1) != 1) give_up("the server takes no frames");
    for (const uint64_t limit_ns = lw_clock_ns() + LIMIT_NS;
         stats.settled_frame < (uint64_t)b->fresh_frames;) {
        poll_one(client, POLL_MS, &stats);
        if (lw_clock_ns() > limit_ns) give_up("the light of one state does not come");
    }
    read_light(b, client, out->light);
    look(b, client, out);
    lw_client_destroy(client);
    close(line[1]);
    close(line[0]);
    (void)lw_process_stop(&server, SIGTERM, 30);
}

/* ---- kept in files ---- */

/* Of all that a fresh depends on, but for the server's own code. */
static uint64_t key_of(const struct bench *b, const struct state *state, unsigned seed) {
    char text[2048];
    const int length = snprintf(text, sizeof text, "%s\n%s\n%d\n%u\n%s\n%s\n%" PRId64 "\n%zu\n%" PRIu32,
                                b->scene, state->text, state->undone, seed, b->daemon_options, FRESH_OPTIONS,
                                b->fresh_frames, b->texel_count, b->map.tile_count);
    if (length < 0 || (size_t)length >= sizeof text)
        give_up("the scene's and the update's names are too long");
    return XXH3_64bits(text, (size_t)length);
}

static enum lw_status read_fresh(const struct bench *b, const char *path, uint64_t key, struct fresh *out,
                                 struct lw_error *err) {
    struct lw_checked_file_reader file;
    struct fresh_header header;
    enum lw_status status = lw_checked_file_read_begin(&file, path, &fresh_kind, "fresh light", err);
    if (status == LW_OK) status = lw_checked_file_take(&file, &header, sizeof header);
    if (status == LW_OK && header.key != key)
        status = lw_status_fail(
            err, LW_BAD_DATA, "%s: holds the light of something else (key %016" PRIx64 ")", path, header.key);
    if (status == LW_OK)
        status = lw_checked_file_take(&file, out->light, CHANNELS * b->texel_count * sizeof *out->light);
    if (status == LW_OK) status = lw_checked_file_take(&file, out->shown, b->texel_count);
    if (status == LW_OK) status = lw_checked_file_take(&file, out->wanted, b->map.tile_count);
    if (status == LW_OK && file.left)
        status = lw_status_fail(err, LW_BAD_DATA, "%s: has %" PRIu64 " bytes too many", path, file.left);
    lw_checked_file_read_end(&file);
    return status;
}

static enum lw_status write_fresh(const struct bench *b, const char *path, uint64_t key,
                                  const struct fresh *fresh, struct lw_error *err) {
    struct lw_checked_file_writer file;
    enum lw_status status = lw_checked_file_write_begin(&file, path, err);
    if (status != LW_OK) return status;
    lw_checked_file_put(&file, &(struct fresh_header){fresh_kind, key}, sizeof(struct fresh_header));
    lw_checked_file_put(&file, fresh->light, CHANNELS * b->texel_count * sizeof *fresh->light);
    lw_checked_file_put(&file, fresh->shown, b->texel_count);
    lw_checked_file_put(&file, fresh->wanted, b->map.tile_count);
    return lw_checked_file_write_end(&file);
}

static enum lw_status make_folder(const char *path, struct lw_error *err) {
    if ((mkdir(path, 0777) != 0 && errno != EEXIST) || access(path, W_OK | X_OK) != 0)
        return lw_status_fail(err, LW_CANNOT_CREATE, "--truth %s: %m", path);
    return LW_OK;
}

/* From its file, if there is one; otherwise solved, and kept if --truth says so. */
static void get_fresh(const struct bench *b, const struct state *state, unsigned seed, struct fresh *out) {
    char path[512];
    struct lw_error err = {0};
    if (!b->truth) {
        solve_fresh(b, state, seed, out);
        return;
    }
    const uint64_t key = key_of(b, state, seed);
    if ((size_t)snprintf(path, sizeof path, "%s/%016" PRIx64 ".fresh", b->truth, key) >= sizeof path)
        give_up("--truth is too long");
    if (access(path, F_OK) == 0) {
        must(read_fresh(b, path, key, out, &err), &err);
    } else {
        solve_fresh(b, state, seed, out);
        must(write_fresh(b, path, key, out, &err), &err);
    }
}

/* Its light, and what it shows and wants beside what is shown and wanted already. */
static void add_fresh(struct bench *b, const struct state *state, unsigned seed, float *out_light) {
    struct fresh fresh = {out_light, room(b->texel_count, sizeof *fresh.shown),
                          room(b->map.tile_count, sizeof *fresh.wanted)};
    get_fresh(b, state, seed, &fresh);
    for (size_t i = 0; i < b->texel_count; i++) b->shown[i] |= fresh.shown[i];
    for (uint32_t t = 0; t < b->map.tile_count; t++) b->wanted[t] |= fresh.wanted[t];
    free(fresh.shown);
    free(fresh.wanted);
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
    for (uint32_t t = 0; t < b->map.tile_count; t++) {
        const uint64_t version = lw_client_get_tile(b->client, (lw_tile_id){t}).version;
        if (b->touched[t] && version != b->version[t] && version >= frame) return true;
    }
    return false;
}

/* Whether the light counts as settled without having come to rest. Each frame forgets only so much of the light before. */
static bool is_over(const struct bench *b, uint64_t frames, uint64_t ns) {
    return (frames >= (uint64_t)b->frames && ns >= (uint64_t)(1e9 * b->settle_s)) || ns > LIMIT_NS;
}

/* Whether every tile that is wanted is there with all bounces, and no noisier than it is to be. */
static bool is_converged(const struct bench *b, const struct lw_client_stats *stats) {
    for (uint32_t t = 0; t < b->map.tile_count; t++) {
        const struct lw_client_tile tile = lw_client_get_tile(b->client, (lw_tile_id){t});
        if (b->wanted[t] &&
            (!tile.version || tile.bounces < stats->bounces || tile.error > stats->target_error))
            return false;
    }
    return true;
}

/* Sends an update and follows the light until it rests, or its frames are over. Fills b->moment. */
static struct outcome follow(struct bench *b, const struct lw_scene_change *change) {
    const uint32_t tiles = b->map.tile_count;
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
    while (!answered || (!outcome.rested && !is_over(b, frame - old.frame, now_ns - from.ns))) {
        poll_one(b->client, POLL_MS, &stats);
        const struct clocks now = clocks_now(b);
        struct moment moment = moment_at(&from, &now, &stats);
        now_ns = now.ns;
        answered |= lw_client_next_answer(b->client, &answer);
        if (answered && answer.code) give_up(answer.text);
        if (!answered && now_ns - from.ns > PATIENCE_NS) give_up("the server does not answer");
        if (stats.frame != frame) heard_ns = now_ns;
        frame = stats.frame;
        if (stats.tiles != tiles_then) {
            if (outcome.first.ms < 0 && answered && shows_change(b, answer.frame)) {
                outcome.first = moment;
                outcome.first_frames = (double)(moment.frame - old.frame);
            }
            read_light(b, b->client, b->now);
            moment.along = project(b, b->now);
            note(b, &moment);
        }
        tiles_then = stats.tiles;
        outcome.rested = answered && now_ns - heard_ns > REST_NS && is_converged(b, &stats);
    }
    outcome.rest_ms = ms_since(from.ns, heard_ns);
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
           "\"lowest_after\": %.4f, \"start\": %.4f, \"end\": %.4f,\n     \"progress\": [",
           o->share_frames, o->share.server_cpu_ms, o->share.client_cpu_ms,
           isfinite(o->lowest) ? o->lowest : 0.0, o->start, o->end);
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
    if (isfinite(o->lowest)) printf(" %.2f", o->lowest);
    printf(" | %.2f | %.2f | %.1f%s |\n", o->start, o->end, 1e-3 * o->rest_ms, o->rested ? "" : " and on");
    fflush(stdout);
}

static void print_head(const struct bench *b) {
    if (b->json)
        printf("{\"scene\": \"%s\", \"first_target_ms\": %.0f, \"share_target_ms\": %.0f, \"updates\": [",
               b->scene, FIRST_MS, SHARE_MS);
    else
        printf("%s\n\n", b->scene);
    fflush(stdout);
}

static void print_update(const struct bench *b, const char *update, bool first) {
    if (b->json)
        printf("%s\n  {\"update\": \"%s\", \"agreement\": %.4f, \"outcomes\": [", first ? "" : ",", update,
               b->agreement);
    else
        printf("| update | first tile, ms | frames | server CPU ms | 95 %%, ms | frames | server CPU ms | "
               "lowest "
               "after | p at first | p at last | rest, s |\n|---|---|---|---|---|---|---|---|---|---|---|\n");
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
        printf("\n%s: agreement %.2f; medians: first tile after %.0f ms, target %.0f: %s; 95 %% after %.0f "
               "ms, target "
               "%.0f: %s\n\n",
               update, b->agreement, first, FIRST_MS, first <= FIRST_MS ? "met" : "missed", share, SHARE_MS,
               share <= SHARE_MS ? "met" : "missed");
    }
    fflush(stdout);
}

/* ---- the whole ---- */

static void begin(struct bench *b) {
    struct lw_client_stats stats = {0};
    struct lw_error err = {0};
    serve(b, "", &b->server);
    if (clock_getcpuclockid(b->server.pid, &b->server_clock) != 0) give_up("the server has no clock");
    b->client = join(b->server.port, true);
    for (const uint64_t limit_ns = lw_clock_ns() + PATIENCE_NS; !stats.first_ns;) {
        poll_one(b->client, POLL_MS, &stats);
        if (lw_clock_ns() > limit_ns) give_up("no first light");
    }
    lw_tile_id *list = room(b->map.tile_count, sizeof *list);
    size_t count = 0;
    for (uint32_t t = 0; t < b->map.tile_count; t++)
        if (b->wanted[t]) list[count++] = (lw_tile_id){t};
    must(lw_client_want(b->client, list, count), &err);
    free(list);
    (void)follow(b, &reset);
}

static void end(struct bench *b) {
    lw_client_destroy(b->client);
    (void)lw_process_stop(&b->server, SIGTERM, 30);
    memset(b->wanted, 0, b->map.tile_count);
    memset(b->shown, 0, b->texel_count);
}

static void measure(struct bench *b, const char *text, bool first) {
    struct lw_scene_change change;
    struct outcome outcome[UPDATES_MAX];
    struct lw_client_stats stats;
    read_update(b, lw_client_scene(b->introduced), text, &change);
    for (unsigned i = 0; i < 2; i++) {
        add_fresh(b, &(struct state){text, &change, true}, 2 + i, b->before[i]);
        add_fresh(b, &(struct state){text, &change, false}, 2 + i, b->after[i]);
    }
    weigh(b);
    find_touched(b);
    begin(b);
    print_update(b, text, first);
    for (int64_t i = 0; i < b->updates; i++) {
        const bool back = i % 2;
        lw_client_get_stats(b->client, &stats);
        read_light(b, b->client, b->now);
        const double p = project(b, b->now);
        outcome[i] = follow(b, back ? &reset : &change);
        outcome[i].undone = back;
        outcome[i].start = back ? 1 - p : p;
        find_share(b, &outcome[i], stats.frame);
        if (b->json)
            print_json_outcome(b, &outcome[i], i == 0);
        else
            print_outcome(text, &outcome[i]);
    }
    print_medians(b, text, outcome);
    end(b);
}

int main(int argc, char **argv) {
    const char *argument[1 + UPDATES_MAX] = {"builtin:atrium"};
    struct bench b = {.updates = 2, .settle_s = 20, .frames = 96, .fresh_frames = 12, .daemon_options = ""};
    struct lw_error err = {0};
    size_t count;
    bool done = false;
    const struct lw_option table[] = {
        {"updates", "N", "of each kind, every other one undoes the one before (default 2)", LW_OPTION_INT,
         &b.updates, 1, UPDATES_MAX, NULL},
        {"settle", "S", "seconds, and ...", LW_OPTION_REAL, &b.settle_s, 0.01, 240, NULL},
        {"frames", "N",
         "frames after which the light counts as settled, if it has not come to rest before (default: 20 and "
         "256)",
         LW_OPTION_INT, &b.frames, 1, 1e9, NULL},
        {"fresh", "N", "frames, of 8 times the rays, of the light to compare with (default 12)",
         LW_OPTION_INT, &b.fresh_frames, 1, 1e6, NULL},
        {"daemon", "OPTIONS", "for lightwelld, separated by blanks (default: none)", LW_OPTION_STRING,
         &b.daemon_options, 0, 0, NULL},
        {"truth", "FOLDER",
         "keep the light to compare with there, and take it from there where it was kept by a run of the "
         "same "
         "SCENE, CAMERA COMMAND, --fresh and --daemon (default: solve it in every run)",
         LW_OPTION_STRING, &b.truth, 0, 0, NULL},
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
    if (b.truth) must(make_folder(b.truth, &err), &err);
    introduce(&b);
    print_head(&b);
    for (size_t i = 0; i < updates; i++) measure(&b, update[i], i == 0);
    if (b.json) printf("]}\n");
    return 0;
}
