#include "tests/bench/latency_light.h"

#include "client/view/compose/stage.h"
#include "common/base/checked_file.h"
#include "common/base/clock.h"
#include "common/base/log.h"

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
#define LEVEL         LW_ATLAS_READ_MAX
#define SQUARE        4u /* texels, each way, that are judged together: their noise is not change */
#define FRESH_OPTIONS "--clock manual --light whole --direct-samples 8 --indirect-samples 16"

/* What a server that never knew anything else sends of one state, and what the picture takes of it. */
struct fresh {
    float *light;    /* LATENCY_CHANNELS per texel */
    uint8_t *shown;  /* per texel: in the picture */
    uint8_t *wanted; /* per tile: by the picture */
};

/* In front of a fresh's arrays in its file. */
struct fresh_header {
    struct lw_checked_file_kind kind;
    uint64_t key;
};
static const struct lw_checked_file_kind fresh_kind = {{'l', 'w', 'f', 'r', 'e', 's', 'h', '\n'}, 1};

static const struct lw_scene_change reset = {.kind = LW_SCENE_CHANGE_RESET};

void latency_must(enum lw_status status, struct lw_error *err) {
    if (status != LW_OK) exit(lw_log_failure(err));
}

_Noreturn void latency_give_up(const char *what) {
    fprintf(stderr, "bench_latency: %s\n", what);
    exit(1);
}

json_t *latency_real(double x) { return isfinite(x) ? json_real(x) : json_null(); }

void latency_print(json_t *object) {
    char *text =
        object ? json_dumps(object, JSON_INDENT(1) | JSON_PRESERVE_ORDER | JSON_REAL_PRECISION(6)) : NULL;
    if (!text) latency_give_up("no memory for what is printed");
    puts(text);
    free(text);
    json_decref(object);
}

void *latency_room(size_t count, size_t size) {
    void *p = calloc(count + 1, size);
    if (!p) latency_give_up("no memory");
    return p;
}

/* ---- texels ---- */

uint32_t latency_light_level(const struct latency_light *l, uint32_t object) {
    const uint32_t levels = l->map.atlas[object]->level_count;
    return levels > LEVEL ? LEVEL : levels - 1;
}

static void lay_out_squares(struct latency_light *l) {
    l->square = latency_room(l->texel_count, sizeof *l->square);
    for (uint32_t o = 0; o < l->map.object_count; o++) {
        if (!l->map.atlas[o]->level_count) continue;
        const struct lw_atlas_level *level = &l->map.atlas[o]->level[latency_light_level(l, o)];
        const uint32_t columns = (level->width + SQUARE - 1) / SQUARE;
        for (uint32_t y = 0; y < level->height; y++)
            for (uint32_t x = 0; x < level->width; x++)
                l->square[l->first[o] + (size_t)y * level->width + x] =
                    (uint32_t)l->square_count + y / SQUARE * columns + x / SQUARE;
        l->square_count += (size_t)columns * ((level->height + SQUARE - 1) / SQUARE);
    }
    double **plane[] = {&l->change[0], &l->change[1], &l->progress};
    for (size_t i = 0; i < sizeof plane / sizeof *plane; i++)
        *plane[i] = latency_room(LATENCY_CHANNELS * l->square_count, sizeof **plane[i]);
}

static void lay_out(struct latency_light *l, const struct lw_scene *scene) {
    if (lw_atlas_map_init(&l->map, scene) != LW_OK) latency_give_up("no memory");
    l->first = latency_room(l->map.object_count, sizeof *l->first);
    for (uint32_t o = 0; o < l->map.object_count; o++) {
        l->first[o] = l->texel_count;
        if (!l->map.atlas[o]->level_count) continue;
        const struct lw_atlas_level *level = &l->map.atlas[o]->level[latency_light_level(l, o)];
        l->texel_count += (size_t)level->width * level->height;
    }
    lay_out_squares(l);
    l->weight = latency_room(LATENCY_CHANNELS * l->texel_count, sizeof *l->weight);
    l->most = latency_room(LATENCY_CHANNELS * l->texel_count, sizeof *l->most);
    l->wanted = latency_room(l->map.tile_count, sizeof *l->wanted);
}

void latency_light_read(const struct latency_light *l, const struct lw_client *client, float *out) {
    for (uint32_t o = 0; o < l->map.object_count; o++) {
        if (!l->map.atlas[o]->level_count) continue;
        const struct lw_client_level level = lw_client_get_level(client, o, latency_light_level(l, o));
        memcpy(out + LATENCY_CHANNELS * l->first[o], level.rgb,
               (size_t)level.width * level.height * LATENCY_CHANNELS * sizeof *out);
    }
}

/* The first surface behind a pixel. */
static void show_hit(const struct latency_light *l, const struct lw_scene *scene, const struct lw_hit16 *hits,
                     unsigned i, uint8_t *shown) {
    const uint32_t o = hits->object[i];
    if (o == LW_TRACE_MISS || !l->map.atlas[o]->level_count) return;
    const struct lw_mesh *mesh = &scene->mesh[scene->object[o].mesh];
    const uint32_t level = latency_light_level(l, o);
    const float weight[3] = {1 - hits->u[i] - hits->v[i], hits->u[i], hits->v[i]};
    struct lw_facet facet;
    lw_scene_facet(scene, mesh, hits->triangle[i], &facet);
    struct lw_vec2 uv = lw_scene_facet_mean(facet.lightmap_uv, weight);
    if (hits->back[i]) uv.y += (float)mesh->back_offset;
    const struct lw_atlas_level *at = &l->map.atlas[o]->level[level];
    const uint32_t x = (uint32_t)uv.x >> level, y = (uint32_t)uv.y >> level;
    if (x < at->width && y < at->height) shown[l->first[o] + (size_t)y * at->width + x] = 1;
}

static void show_pixels(const struct latency_light *l, const struct lw_stage *stage, uint8_t *shown) {
    const struct lw_camera_plane plane = lw_camera_plane(&l->camera, WIDTH, HEIGHT);
    struct lw_ray16 rays = {.salt = 0};
    struct lw_hit16 hits;
    _Static_assert(WIDTH % LW_TRACE_WIDTH == 0, "rows are cut into whole packets");
    for (uint32_t y = 0; y < HEIGHT; y++)
        for (uint32_t x = 0; x < WIDTH; x += LW_TRACE_WIDTH) {
            for (uint32_t i = 0; i < LW_TRACE_WIDTH; i++)
                lw_trace_set_ray(&rays, i, l->camera.position,
                                 lw_camera_direction(&plane, (float)(x + i) + 0.5f, (float)y + 0.5f),
                                 INFINITY);
            lw_trace_closest16(stage->trace, LW_TRACE_VIEW | LW_TRACE_COHERENT, UINT16_MAX, &rays, &hits);
            for (unsigned i = 0; i < LW_TRACE_WIDTH; i++) show_hit(l, stage->scene, &hits, i, shown);
        }
}

/* What the picture takes of what a client has now. */
static void read_light_of(const struct latency_light *l, struct lw_client *client, struct fresh *out) {
    const struct lw_compose_view view = {.camera = l->camera, .width = WIDTH, .height = HEIGHT};
    struct lw_compose_report report;
    struct lw_stage stage;
    struct lw_error err = {0};
    bool moved;
    latency_must(lw_stage_init(&stage, client, 0, &err), &err);
    latency_must(lw_stage_follow(&stage, &moved, &err), &err);
    const struct lw_compose_source source = lw_compose_source_of(client);
    float *picture = latency_room((size_t)WIDTH * HEIGHT * 3, sizeof *picture);
    lw_compose_render(stage.compose, &source, &stage.pose, &view, picture, &report);
    lw_compose_survey(stage.compose, &source, &stage.pose, &view);
    const uint8_t *needed = lw_compose_needed(stage.compose), *around = lw_compose_around(stage.compose);
    for (uint32_t t = 0; t < l->map.tile_count; t++) out->wanted[t] = (uint8_t)(needed[t] | around[t]);
    show_pixels(l, &stage, out->shown);
    lw_stage_finish(&stage);
    free(picture);
}

/* ---- the change ---- */

/* How far light is from other light, square by square, relative to it. Light that is too bright by far
 * to be light of before or after is not taken for more than it can be. */
static void compare(const struct latency_light *l, const float *light, const float *other, double *out) {
    memset(out, 0, LATENCY_CHANNELS * l->square_count * sizeof *out);
    for (size_t i = 0; i < LATENCY_CHANNELS * l->texel_count; i++)
        out[LATENCY_CHANNELS * l->square[i / LATENCY_CHANNELS] + i % LATENCY_CHANNELS] +=
            (double)l->weight[i] * (double)(fminf(light[i], l->most[i]) - fminf(other[i], l->most[i]));
}

static double dot(const struct latency_light *l, const double *x, const double *y) {
    double sum = 0;
    for (size_t i = 0; i < LATENCY_CHANNELS * l->square_count; i++) sum += x[i] * y[i];
    return sum;
}

double latency_light_share(struct latency_light *l, const float *light) {
    compare(l, light, l->pair->before[0], l->progress);
    return dot(l, l->change[1], l->progress) / dot(l, l->change[1], l->change[0]);
}

void latency_light_residual(const struct latency_light *l, const float *light, unsigned seed, double *out) {
    compare(l, light, l->pair->after[seed], out);
}

double latency_light_error(const struct latency_light *l, const double *residual, const double *other) {
    return dot(l, residual, other) / dot(l, l->change[0], l->change[1]);
}

static int compare_floats(const void *a, const void *b) {
    const float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

static float median_of_light(const struct latency_light *l, const float *light) {
    float *all = latency_room(LATENCY_CHANNELS * l->texel_count, sizeof *all);
    size_t count = 0;
    for (size_t i = 0; i < LATENCY_CHANNELS * l->texel_count; i++)
        if (l->pair->shown[i / LATENCY_CHANNELS]) all[count++] = light[i];
    qsort(all, count, sizeof *all, compare_floats);
    const float median = all[count / 2];
    free(all);
    return median;
}

/* Light that is added to a place counts by the light there. */
static void weigh(struct latency_light *l) {
    const struct latency_pair *pair = l->pair;
    const float median = median_of_light(l, pair->before[0]);
    for (size_t i = 0; i < LATENCY_CHANNELS * l->texel_count; i++) {
        const float mean =
            0.25f * (pair->before[0][i] + pair->before[1][i] + pair->after[0][i] + pair->after[1][i]);
        l->weight[i] = pair->shown[i / LATENCY_CHANNELS] ? 1 / (hypotf(mean, median) + FLT_MIN) : 0;
        l->most[i] = 2 * (mean + median);
    }
}

void latency_light_judge(struct latency_light *l, const struct latency_pair *pair) {
    l->pair = pair;
    weigh(l);
    for (int k = 0; k < 2; k++) compare(l, pair->after[k], pair->before[k], l->change[k]);
    l->agreement = dot(l, l->change[0], l->change[1]) /
                   (sqrt(dot(l, l->change[0], l->change[0]) * dot(l, l->change[1], l->change[1])) + DBL_MIN);
}

/* ---- servers and clients ---- */

static struct lw_client *connect_client(uint16_t port, bool wants_nothing) {
    struct lw_client *client;
    struct lw_error err = {0};
    latency_must(lw_client_create(&(struct lw_client_desc){.host = "127.0.0.1",
                                                           .port = port,
                                                           .name = "bench_latency",
                                                           .wants_nothing = wants_nothing,
                                                           .control = true},
                                  &client, &err),
                 &err);
    return client;
}

void latency_light_poll(struct lw_client *client, unsigned ms, struct lw_client_stats *out_stats) {
    struct lw_error err = {0};
    latency_must(lw_client_poll(client, ms, &err), &err);
    lw_client_get_stats(client, out_stats);
}

void latency_light_serve(const struct latency_light *l, const char *options, struct lw_process *out_server) {
    char arguments[1024];
    if ((size_t)snprintf(arguments, sizeof arguments, "%s %s %s", l->scene, options, l->daemon_options) >=
        sizeof arguments)
        latency_give_up("--daemon is too long");
    lw_process_serve(out_server, arguments);
}

void latency_light_watch(const struct latency_light *l, const char *options, struct lw_process *out_server,
                         struct lw_client **out_client) {
    struct lw_client_stats stats = {0};
    struct lw_error err = {0};
    latency_light_serve(l, options, out_server);
    struct lw_client *client = connect_client(out_server->port, true);
    for (const uint64_t limit_ns = lw_clock_ns() + LATENCY_PATIENCE_NS; !stats.first_ns;) {
        latency_light_poll(client, LATENCY_POLL_MS, &stats);
        if (lw_clock_ns() > limit_ns) latency_give_up("no first light");
    }
    lw_tile_id *list = latency_room(l->map.tile_count, sizeof *list);
    size_t count = 0;
    for (uint32_t t = 0; t < l->map.tile_count; t++)
        if (l->wanted[t]) list[count++] = (lw_tile_id){t};
    latency_must(lw_client_want(client, list, count), &err);
    free(list);
    *out_client = client;
}

static enum lw_status make_folder(const char *path, struct lw_error *err) {
    if ((mkdir(path, 0777) != 0 && errno != EEXIST) || access(path, W_OK | X_OK) != 0)
        return lw_status_fail(err, LW_CANNOT_CREATE, "--reference %s: %m", path);
    return LW_OK;
}

void latency_light_introduce(struct latency_light *l) {
    struct lw_process server;
    struct lw_client_stats stats;
    struct lw_error err = {0};
    if (!l->reference) {
        snprintf(l->folder, sizeof l->folder, "%s", lw_support_temporary("reference"));
        l->reference = l->folder;
    }
    latency_must(make_folder(l->reference, &err), &err);
    latency_light_serve(l, "--freeze 0", &server);
    l->introduced = connect_client(server.port, true);
    while (!latency_light_scene(l)) latency_light_poll(l->introduced, LATENCY_POLL_MS, &stats);
    (void)lw_process_stop(&server, SIGTERM, LW_PROCESS_LIMIT_S);
    lay_out(l, latency_light_scene(l));
}

void latency_light_finish(struct latency_light *l) {
    lw_client_destroy(l->introduced);
    lw_atlas_map_finish(&l->map);
    free(l->first);
    free(l->square);
    free(l->wanted);
    for (int k = 0; k < 2; k++) free(l->change[k]);
    free(l->progress);
    free(l->weight);
    free(l->most);
    *l = (struct latency_light){0};
}

const struct lw_scene *latency_light_scene(const struct latency_light *l) {
    return lw_client_scene(l->introduced);
}

bool latency_light_look_from(struct latency_light *l, const struct lw_pose *pose, const char *camera) {
    struct lw_error err = {0};
    uint32_t index;
    if (strchr(camera, ':')) {
        latency_must(lw_camera_parse(camera, &l->camera, &err), &err);
        return false;
    }
    latency_must(lw_camera_find(latency_light_scene(l), camera, &index, &err), &err);
    l->camera = lw_camera_of_scene(latency_light_scene(l), pose, index);
    return pose->node_moves[latency_light_scene(l)->camera[index].node];
}

/* ---- fresh light ---- */

/* The light of a server to which the change is made before its first frame, and undone in the same moment if
 * it is `undone`: a moved object is another one for rays, wherever it is. Frames begin with lines on
 * our stdin, which is its. */
static void solve_fresh(const struct latency_light *l, const struct latency_state *state, unsigned seed,
                        struct fresh *out) {
    struct lw_process server;
    struct lw_client_stats stats = {0};
    struct lw_error err = {0};
    char options[128];
    int line[2];
    if (pipe(line) != 0 || dup2(line[0], STDIN_FILENO) < 0) latency_give_up("no pipe");
    snprintf(options, sizeof options, "--freeze %.17g " FRESH_OPTIONS " --seed %u", state->time_s, seed);
    latency_light_serve(l, options, &server);
    struct lw_client *client = connect_client(server.port, false);
    while (!lw_client_scene(client)) latency_light_poll(client, LATENCY_POLL_MS, &stats);
    if (state->change) {
        latency_must(lw_client_update(client, (struct lw_scene_change[]){*state->change, reset},
                                      state->undone ? 2 : 1, NULL, &err),
                     &err);
        for (int i = 0; i < 3; i++)
            latency_light_poll(client, LATENCY_POLL_MS, &stats); /* it hears of that */
    }
    for (int64_t i = 0; i < l->fresh_frames; i++)
        if (write(line[1], "\n", 1) != 1) latency_give_up("the server takes no frames");
    for (const uint64_t limit_ns = lw_clock_ns() + LATENCY_LIMIT_NS;
         stats.settled_frame < (uint64_t)l->fresh_frames;) {
        latency_light_poll(client, LATENCY_POLL_MS, &stats);
        if (lw_clock_ns() > limit_ns) latency_give_up("the light of one state does not come");
    }
    latency_light_read(l, client, out->light);
    read_light_of(l, client, out);
    lw_client_destroy(client);
    close(line[1]);
    close(line[0]);
    (void)lw_process_stop(&server, SIGTERM, LW_PROCESS_LIMIT_S);
}

/* ---- kept in files ---- */

/* Of all that a fresh depends on, but for the server's own code. */
static uint64_t key_of(const struct latency_light *l, const struct latency_state *state, unsigned seed) {
    char text[2048];
    const int length = snprintf(text, sizeof text, "%s\n%s\n%d\n%u\n%s\n%s\n%" PRId64 "\n%zu\n%" PRIu32,
                                l->scene, state->text, state->undone, seed, l->daemon_options, FRESH_OPTIONS,
                                l->fresh_frames, l->texel_count, l->map.tile_count);
    if (length < 0 || (size_t)length >= sizeof text)
        latency_give_up("the scene's and the update's names are too long");
    return XXH3_64bits(text, (size_t)length);
}

static enum lw_status read_fresh(const struct latency_light *l, const char *path, uint64_t key,
                                 struct fresh *out, struct lw_error *err) {
    struct lw_checked_file_reader file;
    struct fresh_header header;
    enum lw_status status = lw_checked_file_read_begin(&file, path, &fresh_kind, "fresh light", err);
    if (status == LW_OK) status = lw_checked_file_take(&file, &header, sizeof header);
    if (status == LW_OK && header.key != key)
        status = lw_status_fail(
            err, LW_BAD_DATA, "%s: holds the light of something else (key %016" PRIx64 ")", path, header.key);
    if (status == LW_OK)
        status =
            lw_checked_file_take(&file, out->light, LATENCY_CHANNELS * l->texel_count * sizeof *out->light);
    if (status == LW_OK) status = lw_checked_file_take(&file, out->shown, l->texel_count);
    if (status == LW_OK) status = lw_checked_file_take(&file, out->wanted, l->map.tile_count);
    if (status == LW_OK && file.left)
        status = lw_status_fail(err, LW_BAD_DATA, "%s: has %" PRIu64 " bytes too many", path, file.left);
    lw_checked_file_read_end(&file);
    return status;
}

static enum lw_status write_fresh(const struct latency_light *l, const char *path, uint64_t key,
                                  const struct fresh *fresh, struct lw_error *err) {
    struct lw_checked_file_writer file;
    enum lw_status status = lw_checked_file_write_begin(&file, path, err);
    if (status != LW_OK) return status;
    lw_checked_file_put(&file, &(struct fresh_header){fresh_kind, key}, sizeof(struct fresh_header));
    lw_checked_file_put(&file, fresh->light, LATENCY_CHANNELS * l->texel_count * sizeof *fresh->light);
    lw_checked_file_put(&file, fresh->shown, l->texel_count);
    lw_checked_file_put(&file, fresh->wanted, l->map.tile_count);
    return lw_checked_file_write_end(&file);
}

/* From its file, if there is one; otherwise solved, and kept. */
static void get_fresh(const struct latency_light *l, const struct latency_state *state, unsigned seed,
                      struct fresh *out) {
    char path[512];
    struct lw_error err = {0};
    const uint64_t key = key_of(l, state, seed);
    if ((size_t)snprintf(path, sizeof path, "%s/%016" PRIx64 ".fresh", l->reference, key) >= sizeof path)
        latency_give_up("--reference is too long");
    if (access(path, F_OK) == 0) {
        latency_must(read_fresh(l, path, key, out, &err), &err);
    } else {
        solve_fresh(l, state, seed, out);
        latency_must(write_fresh(l, path, key, out, &err), &err);
    }
}

static float *add_fresh(struct latency_light *l, const struct latency_state *state, unsigned seed,
                        uint8_t *shown) {
    struct fresh fresh = {latency_room(LATENCY_CHANNELS * l->texel_count, sizeof *fresh.light),
                          latency_room(l->texel_count, sizeof *fresh.shown),
                          latency_room(l->map.tile_count, sizeof *fresh.wanted)};
    get_fresh(l, state, seed, &fresh);
    for (size_t i = 0; i < l->texel_count; i++) shown[i] |= fresh.shown[i];
    for (uint32_t t = 0; t < l->map.tile_count; t++) l->wanted[t] |= fresh.wanted[t];
    free(fresh.shown);
    free(fresh.wanted);
    return fresh.light;
}

void latency_light_solve(struct latency_light *l, const struct latency_state *before,
                         const struct latency_state *after, struct latency_pair *out_pair) {
    out_pair->shown = latency_room(l->texel_count, sizeof *out_pair->shown);
    for (unsigned i = 0; i < 2; i++) {
        out_pair->before[i] = add_fresh(l, before, 2 + i, out_pair->shown);
        out_pair->after[i] = add_fresh(l, after, 2 + i, out_pair->shown);
    }
}

void latency_pair_finish(struct latency_pair *pair) {
    for (int i = 0; i < 2; i++) {
        free(pair->before[i]);
        free(pair->after[i]);
    }
    free(pair->shown);
    *pair = (struct latency_pair){0};
}
