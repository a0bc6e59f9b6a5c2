/* bench_stream: what the view of a walking client costs and how far it is off, second by second.
 *
 *     bench_stream [--frames N] [--hz HZ] [--motion light] [--width W] [--height H] [--links MBIT,...]
 *     [--slow S]
 *                  [--step-widest STEP] [--direct tiles|auto] [--csv FILE] SCENE...
 *
 * The scene is solved as lightwelld does by default, --hz frames for a second of the scene. For each frame
 * three things are kept: the publisher's snapshot, the camera, and the view of somebody who walks through the
 * scene (client/measure/sides/views.h), composed from the light before it is encoded. Then the snapshots are
 * handed, at their times, to the server that ships, and a client on loopback says what its view needs, as
 * viewers do, and composes what it has when the next frame is due: once for each of --links, the server's
 * limit in Mbit/s (0: none). Time runs --slow times slower there, and the limit is that much lower, so that
 * composing keeps pace.
 *   Mbit/s   of all that the client gets after the first second, by the scene's clock; peak: the largest
 *   whole second
 *   error    root of relMSE = mean((x - t)^2 / (t^2 + 0.01 mean(t^2))) over every third pixel, each way;
 *   after the first second
 *   joined   seconds until the error is for the first time under 0.05
 * The parts of the error come first, step by step from the newest light to what the client shows, each
 * in the same measure:
 *   level    of the newest light, but every tile is read at the level that its error asks for when it was
 *   last sent
 *   waiting  of light as it was last sent, uncoded: changes that are too small to be sent again
 *   coding   of the same light, decoded
 *   link     of what the client has, for each of --links: tiles that have not arrived, or that it did not ask
 *   for */
#include "client/lib/replica.h"
#include "client/measure/sides/views.h"
#include "client/view/compose/attention.h"
#include "client/view/compose/compose.h"
#include "client/view/lights/drawn_lights.h"
#include "common/base/clock.h"
#include "common/base/folders.h"
#include "common/scene/package.h"
#include "common/scene/scene_motion.h"
#include "common/tile/tile_codec.h"
#include "proto/framing.h"
#include "server/publish/levels.h"
#include "server/publish/publisher.h"
#include "server/serve/server.h"
#include "server/solve/filter/denoise.h"
#include "server/solve/solvers.h"
#include "tests/bench/bench_setup.h"

#include <limits.h>
#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define TARGET_ERROR 0.02f
#define LATTICE      3u /* distance in pixels, each way */
#define LINKS_MAX    16u
#define JOINED_ERROR 0.05
#define PACKAGE_S    60u

struct settings {
    struct lw_scene_open open;
    int64_t frames, width, height;
    int motion, direct;
    double hz, slow, step_widest;
    const char *links, *csv_path;
};

/* The steps from the newest light to that which has been sent; what the link adds comes after them. */
enum step { NEWEST = 0, LEVEL, WAITING, CODING, STEPS };

/* One moment, as the server has it. */
struct moment {
    struct lw_snapshot *snapshot;
    struct lw_camera_view camera;
    float *view;       /* the newest light's; lattice pixels * 3 */
    float *sent;       /* the same of all that has been sent */
    double off[STEPS]; /* how far each step is off the one before */
};

struct job {
    const struct settings *settings;
    struct lw_scene *scene;
    struct lw_pose pose;
    struct lw_atlas_map map;
    struct lw_client_lights drawn; /* by the client; nothing with --direct tiles */
    uint8_t *light_bits, *material_bits;
    size_t light_bytes, material_bytes;
    uint32_t channel;
    struct lw_levels *levels; /* per object */
    struct lw_client_tile *tile;
    struct lw_levels *sent_levels; /* as it was when it was last sent, uncoded */
    struct lw_replica *replica;    /* all that has been sent */
    uint8_t *package;
    size_t package_size;
    struct moment *moment;
    float *picture; /* width * height * 3 */
    FILE *csv;
    char cache[PATH_MAX]; /* folder of the client */
};

static size_t lattice_pixels(const struct settings *s) {
    return ((size_t)s->width / LATTICE) * ((size_t)s->height / LATTICE);
}

static void take_lattice(const struct settings *s, const float *picture, float *out) {
    for (size_t y = 0; y < (size_t)s->height / LATTICE; y++)
        for (size_t x = 0; x < (size_t)s->width / LATTICE; x++, out += 3)
            memcpy(out,
                   picture + 3 * ((LATTICE * y + LATTICE / 2) * (size_t)s->width + LATTICE * x + LATTICE / 2),
                   3 * sizeof *out);
}

/* ---- light, as the server has it ---- */

static struct lw_client_level level_of(const struct lw_levels *levels, uint32_t level) {
    if (level >= levels->count) return (struct lw_client_level){0};
    return (struct lw_client_level){levels->level[level].width, levels->level[level].height,
                                    levels->level[level].value, NULL};
}

static struct lw_client_level own_level(const void *context, uint32_t object, uint32_t level) {
    return level_of(&((const struct job *)context)->levels[object], level);
}

static struct lw_client_tile own_tile(const void *context, lw_tile_id id) {
    return ((const struct job *)context)->tile[id.v];
}

static void take_light(struct job *job, const struct lw_solver *solver) {
    const struct lw_atlas_map *map = &job->map;
    for (uint32_t id = 0; id < map->tile_count; id++) {
        const struct lw_tile_place *place = &map->place[id];
        struct lw_solver_tile tile;
        job->tile[id] = (struct lw_client_tile){
            .version = 1, .bounces = 2, .error = lw_publisher_error(map, solver, (lw_tile_id){id}, NULL)};
        if (place->level) continue;
        solver->ops->read_tile(solver, (lw_tile_id){id}, &tile);
        lw_levels_load_tile(&job->levels[place->object], place, &tile);
    }
    for (uint32_t o = 0; o < map->object_count; o++)
        if (map->atlas[o]->tile_count) lw_levels_build(&job->levels[o]);
}

/* ---- light, as it has been sent ---- */

static struct lw_client_level sent_level(const void *context, uint32_t object, uint32_t level) {
    return level_of(&((const struct job *)context)->sent_levels[object], level);
}

static struct lw_client_tile sent_tile(const void *context, lw_tile_id id) {
    return lw_replica_get_tile(((const struct job *)context)->replica, id);
}

static struct lw_client_level coded_level(const void *context, uint32_t object, uint32_t level) {
    return lw_replica_get_level(((const struct job *)context)->replica, object, level);
}

static void copy_tile(const struct lw_levels *from, struct lw_levels *to, const struct lw_tile_place *place) {
    const struct lw_levels_image *image = &from->level[place->level];
    for (uint32_t y = 0; y < place->height; y++) {
        const size_t at = (size_t)(place->y * LW_TILE_SIDE + y) * image->width + place->x * LW_TILE_SIDE;
        memcpy(to->level[place->level].value + 3 * at, image->value + 3 * at,
               place->width * 3 * sizeof(float));
    }
}

static enum lw_status take_sent(struct job *job, const struct lw_snapshot *snapshot, struct lw_error *err) {
    for (uint32_t id = 0; id < snapshot->tile_count; id++) {
        const struct lw_snapshot_tile *tile = &snapshot->tile[job->channel][id];
        if (tile->version != lw_snapshot_version(snapshot->frame)) continue;
        const struct lw_tile_place *place = &job->map.place[id];
        copy_tile(&job->levels[place->object], &job->sent_levels[place->object], place);
        struct lw_framing_header header;
        struct lw_message message;
        enum lw_status status = lw_framing_read_header(tile->blob->bytes, LW_FRAMING_BODY_MAX, &header, err);
        if (status == LW_OK)
            status = lw_message_decode(header, tile->blob->bytes + LW_FRAMING_HEADER_SIZE, &message, err);
        if (status != LW_OK) return status;
        status = lw_replica_take_tile(job->replica, &message.tile, err);
        lw_message_finish(&message);
        if (status != LW_OK) return status;
    }
    return LW_OK;
}

/* How far two views of a moment are apart, by the measure of `reference`. */
static double root_rel_mse(const float *x, const float *y, const float *reference, size_t count) {
    double square = 0, sum = 0;
    for (size_t i = 0; i < count; i++) square += (double)reference[i] * (double)reference[i];
    const double floor = 0.01 * square / (double)count + 1e-30;
    for (size_t i = 0; i < count; i++) {
        const double d = (double)x[i] - (double)y[i];
        sum += d * d / ((double)reference[i] * (double)reference[i] + floor);
    }
    return sqrt(sum / (double)count);
}

struct light {
    struct lw_solver *solver;
    struct lw_publisher *publisher;
    struct lw_trace *trace;
    struct lw_compose *compose;
    struct lw_views *views;
};

static void close_light(struct light *light) {
    lw_views_destroy(light->views);
    lw_compose_destroy(light->compose);
    lw_trace_destroy(light->trace);
    lw_publisher_destroy(light->publisher);
    if (light->solver) light->solver->ops->destroy(light->solver);
}

static enum lw_status open_light(struct job *job, struct light *light, struct lw_error *err) {
    const struct settings *s = job->settings;
    enum lw_status status = lw_trace_create(job->scene, &job->pose, &light->trace, err);
    if (status == LW_OK)
        status = lw_views_create(&(struct lw_views_desc){.scene = job->scene,
                                                         .trace = light->trace,
                                                         .kind = LW_VIEWS_WALK,
                                                         .users = 1,
                                                         .seed = 1,
                                                         .aspect = (float)s->width / (float)s->height},
                                 &light->views, err);
    if (status == LW_OK)
        status = lw_compose_create(&(struct lw_compose_desc){.scene = job->scene,
                                                             .map = &job->map,
                                                             .trace = light->trace,
                                                             .drawn = &job->drawn,
                                                             .pose = &job->pose,
                                                             .threads = (unsigned)s->open.threads},
                                   &light->compose, err);
    if (status == LW_OK)
        status = lw_solvers_create(NULL,
                                   &(struct lw_solver_desc){.scene = job->scene,
                                                            .atlas_map = &job->map,
                                                            .client_lights = &job->drawn,
                                                            .bounces = 2,
                                                            .tracing_range_m = INFINITY,
                                                            .direct_samples = 1,
                                                            .indirect_samples = 2,
                                                            .target_error = TARGET_ERROR,
                                                            .threads = (unsigned)s->open.threads,
                                                            .seed = 1,
                                                            .denoise = true},
                                   &job->pose, &light->solver, err);
    if (status == LW_OK)
        status = lw_publisher_create(&(struct lw_publisher_desc){.scene = job->scene,
                                                                 .atlas_map = &job->map,
                                                                 .solver = light->solver,
                                                                 .target_error = TARGET_ERROR,
                                                                 .noise_shown = LW_SOLVER_NOISE_SHOWN,
                                                                 .codec = LW_TILE_CODEC_DCT,
                                                                 .step_widest = (float)s->step_widest,
                                                                 .threads = (unsigned)s->open.threads},
                                     &light->publisher);
    if (status == LW_OK)
        status = lw_publisher_set_channels(light->publisher, lw_tile_channel_bit(job->channel));
    if (status == LW_OK)
        light->solver->ops->choose_channels(light->solver, lw_tile_channel_bit(job->channel));
    return status;
}

static struct lw_camera_view camera_at(const struct job *job, const struct light *light, uint64_t frame) {
    return lw_views_at(light->views, 0,
                       1 + (uint64_t)((double)(frame - 1) * LW_VIEWS_HZ / job->settings->hz));
}

/* The view of a moment by the light of each step. */
static enum lw_status compose_steps(struct job *job, const struct light *light, struct moment *moment) {
    static const struct {
        struct lw_client_level (*level)(const void *context, uint32_t object, uint32_t level);
        struct lw_client_tile (*tile)(const void *context, lw_tile_id id);
    } from[STEPS] = {
        {own_level, own_tile}, {own_level, sent_tile}, {sent_level, sent_tile}, {coded_level, sent_tile}};
    const struct settings *s = job->settings;
    const size_t values = lattice_pixels(s) * 3;
    const struct lw_compose_view view = {
        .camera = moment->camera, .width = (uint32_t)s->width, .height = (uint32_t)s->height};
    float *before = malloc(values * sizeof *before);
    moment->view = malloc(values * sizeof *moment->view);
    moment->sent = malloc(values * sizeof *moment->sent);
    if (!before || !moment->view || !moment->sent) {
        free(before);
        return LW_NO_MEMORY;
    }
    for (int step = NEWEST; step < STEPS; step++) {
        const struct lw_compose_source source = {
            .context = job,
            .level = from[step].level,
            .tile = from[step].tile,
            .sky = lw_vec3(job->pose.sky[0], job->pose.sky[1], job->pose.sky[2]),
            .bounces = 2,
            .target_error = TARGET_ERROR,
            .noise_shown = LW_SOLVER_NOISE_SHOWN};
        struct lw_compose_report report;
        lw_compose_render(light->compose, &source, &job->pose, &view, job->picture, &report);
        take_lattice(s, job->picture, moment->sent);
        if (step == NEWEST)
            memcpy(moment->view, moment->sent, values * sizeof *before);
        else
            moment->off[step] = root_rel_mse(moment->sent, before, moment->view, values);
        memcpy(before, moment->sent, values * sizeof *before);
    }
    free(before);
    return LW_OK;
}

static enum lw_status light_frame(struct job *job, struct light *light, uint64_t frame,
                                  struct lw_error *err) {
    const struct settings *s = job->settings;
    struct moment *moment = &job->moment[frame - 1];
    struct lw_solver_stats solve = {0};
    struct lw_publisher_stats publish;
    lw_pose_evaluate(&job->pose, job->scene, (double)(frame - 1) / s->hz);
    enum lw_status status = light->solver->ops->frame(light->solver, &job->pose, frame, &solve, err);
    if (status == LW_OK)
        status = lw_publisher_publish(light->publisher, &job->pose, frame, 0, 0, solve.tiles_solved,
                                      &moment->snapshot, &publish);
    if (status == LW_OK) status = lw_trace_set_pose(light->trace, &job->pose, err);
    if (status != LW_OK) return status;
    take_light(job, light->solver);
    if ((status = take_sent(job, moment->snapshot, err)) != LW_OK) return status;
    moment->camera = camera_at(job, light, frame);
    return compose_steps(job, light, moment);
}

/* ---- the client ---- */

struct client {
    struct lw_client *link;
    struct lw_pose pose;
    struct lw_trace *trace;
    struct lw_compose *compose;
    struct lw_client_lights drawn;
    struct lw_attention attention;
};

static void close_client(struct client *c) {
    lw_attention_finish(&c->attention);
    lw_compose_destroy(c->compose);
    lw_client_lights_finish(&c->drawn);
    lw_trace_destroy(c->trace);
    lw_pose_finish(&c->pose);
    lw_client_destroy(c->link);
}

static enum lw_status poll_until(struct client *c, uint64_t deadline_ns, struct lw_error *err) {
    for (uint64_t now_ns; (now_ns = lw_clock_ns()) < deadline_ns;) {
        enum lw_status status =
            lw_client_poll(c->link, (unsigned)((deadline_ns - now_ns) / 1000000u + 1), err);
        if (status != LW_OK) return status;
    }
    return LW_OK;
}

static enum lw_status open_client(const struct job *job, uint16_t port, struct client *c,
                                  struct lw_error *err) {
    const struct lw_client_desc desc = {.host = "127.0.0.1",
                                        .port = port,
                                        .name = "bench_stream",
                                        .cache_folder = job->cache,
                                        .draws_direct = job->channel == LW_TILE_CHANNEL_SPLIT,
                                        .wants_nothing = true};
    enum lw_status status = lw_client_create(&desc, &c->link, err);
    for (uint64_t end_ns = lw_clock_ns() + PACKAGE_S * 1000000000ull;
         status == LW_OK && !lw_client_scene(c->link) && lw_clock_ns() < end_ns;)
        status = lw_client_poll(c->link, 100, err);
    if (status != LW_OK) return status;
    const struct lw_scene *scene = lw_client_scene(c->link);
    if (!scene) return lw_status_fail(err, LW_TIMED_OUT, "the scene has not arrived in %u s", PACKAGE_S);
    if ((status = lw_pose_init(&c->pose, scene)) != LW_OK) return status;
    if ((status = lw_trace_create(scene, &c->pose, &c->trace, err)) != LW_OK) return status;
    if ((status = lw_drawn_lights_init(&c->drawn, c->link)) != LW_OK) return status;
    status = lw_compose_create(&(struct lw_compose_desc){.scene = scene,
                                                         .map = lw_client_atlas_map(c->link),
                                                         .trace = c->trace,
                                                         .drawn = &c->drawn,
                                                         .pose = &c->pose,
                                                         .threads = (unsigned)job->settings->open.threads},
                               &c->compose, err);
    return status == LW_OK ? lw_attention_init(&c->attention, job->map.tile_count) : status;
}

static enum lw_status set_interest(const struct job *job, struct client *c,
                                   const struct lw_compose_view *view, uint64_t frame) {
    const struct lw_compose_source source = lw_compose_source_of(c->link);
    lw_compose_survey(c->compose, &source, &c->pose, view);
    lw_attention_list(&c->attention, lw_compose_around(c->compose), lw_compose_around(c->compose),
                      (uint64_t)((double)frame / job->settings->hz * 1e9));
    return lw_client_want(c->link, c->attention.list, c->attention.list_count);
}

static enum lw_status compose(const struct job *job, struct client *c, const struct lw_compose_view *view,
                              struct lw_error *err) {
    for (uint32_t o = 0; o < job->scene->object_count; o++)
        c->pose.object_to_world[o] = *lw_client_object_to_world(c->link, o);
    lw_drawn_lights_follow(&c->drawn, c->link, &c->pose);
    enum lw_status status = lw_trace_set_pose(c->trace, &c->pose, err);
    const struct lw_compose_source source = lw_compose_source_of(c->link);
    struct lw_compose_report report;
    if (status == LW_OK) lw_compose_render(c->compose, &source, &c->pose, view, job->picture, &report);
    return status;
}

/* ---- one link ---- */

struct figures {
    double *error, *link, *mbit; /* by frame */
};

static enum lw_status replay(const struct job *job, struct lw_server *server, struct client *c,
                             struct figures *out, struct lw_error *err) {
    const struct settings *s = job->settings;
    const uint64_t step_ns = (uint64_t)(1e9 * s->slow / s->hz);
    uint64_t due_ns = lw_clock_ns();
    unsigned late = 0;
    const size_t values = lattice_pixels(s) * 3;
    uint64_t bytes = 0;
    struct lw_client_stats stats;
    float *lattice = malloc(values * sizeof *lattice);
    enum lw_status status = lattice ? LW_OK : LW_NO_MEMORY;
    lw_client_get_stats(c->link, &stats);
    bytes = stats.bytes;
    for (uint32_t f = 0; status == LW_OK && f < s->frames; f++) {
        const struct lw_compose_view view = {
            .camera = job->moment[f].camera, .width = (uint32_t)s->width, .height = (uint32_t)s->height};
        const uint64_t now_ns = lw_clock_ns();
        late += now_ns > due_ns + step_ns / 4;
        due_ns = (now_ns > due_ns ? now_ns : due_ns) + step_ns;
        lw_server_publish(server, job->moment[f].snapshot);
        status = set_interest(job, c, &view, f + 1);
        if (status == LW_OK) status = poll_until(c, due_ns, err);
        if (status == LW_OK) status = compose(job, c, &view, err);
        if (status != LW_OK) break;
        take_lattice(s, job->picture, lattice);
        lw_client_get_stats(c->link, &stats);
        const struct moment *moment = &job->moment[f];
        out->error[f] = root_rel_mse(lattice, moment->view, moment->view, values);
        out->link[f] = root_rel_mse(lattice, moment->sent, moment->view, values);
        out->mbit[f] = 8e-6 * (double)(stats.bytes - bytes);
        bytes = stats.bytes;
    }
    free(lattice);
    if (late > s->frames / 10)
        fprintf(
            stderr,
            "bench_stream: %u of %lld frames were late by a quarter and more: --slow %g is too fast here\n",
            late, (long long)s->frames, s->slow);
    return status;
}

static void *serve(void *context) {
    struct lw_error err = {0};
    if (lw_server_run(context, &err) != LW_OK) fprintf(stderr, "bench_stream: %s\n", err.text);
    return NULL;
}

static void print_link(const struct job *job, double link, const struct figures *f) {
    const struct settings *s = job->settings;
    const uint32_t second = (uint32_t)ceil(s->hz), frames = (uint32_t)s->frames;
    double mbit = 0, peak = 0, error = 0, of_link = 0, worst = 0, joined = (double)NAN;
    for (uint32_t i = 0; i < frames; i++) {
        if (isnan(joined) && f->error[i] < JOINED_ERROR) joined = (i + 1) / s->hz;
        if (job->csv)
            fprintf(job->csv, "%g,%.3f,%.5f,%.4f\n", link, (i + 1) / s->hz, f->mbit[i] * s->hz, f->error[i]);
        if (i < second) continue;
        mbit += f->mbit[i];
        error += f->error[i] * f->error[i];
        of_link += f->link[i] * f->link[i];
        worst = fmax(worst, f->error[i]);
        double window = 0;
        for (uint32_t k = i + 1 - second; k <= i; k++) window += f->mbit[k] * s->hz / second;
        if (i + 1 >= 2 * second) peak = fmax(peak, window);
    }
    char name[32] = "none";
    if (link > 0) snprintf(name, sizeof name, "%g Mbit/s", link);
    const double rest = frames - second;
    printf("| %s | %.2f | %.2f | %.4f | %.4f | %.4f | %.2g |\n", name, mbit * s->hz / rest, peak,
           sqrt(error / rest), worst, sqrt(of_link / rest), joined);
    fflush(stdout);
}

static enum lw_status run_link(struct job *job, double link, bool quiet, struct lw_error *err) {
    const struct settings *s = job->settings;
    struct figures figures = {calloc((size_t)s->frames, sizeof(double)),
                              calloc((size_t)s->frames, sizeof(double)),
                              calloc((size_t)s->frames, sizeof(double))};
    struct client client = {0};
    struct lw_server *server = NULL;
    pthread_t thread;
    enum lw_status status =
        lw_server_create(&(struct lw_server_desc){.host = "127.0.0.1",
                                                  .atlas_map = &job->map,
                                                  .package = job->package,
                                                  .package_size = job->package_size,
                                                  .bounces = 2,
                                                  .target_error = TARGET_ERROR,
                                                  .noise_shown = LW_SOLVER_NOISE_SHOWN,
                                                  .rate_limit_bytes_hz = (uint64_t)(link * 1e6 / 8 / s->slow),
                                                  .client_lights = job->light_bits,
                                                  .client_lights_size = job->light_bytes,
                                                  .client_materials = job->material_bits,
                                                  .client_materials_size = job->material_bytes,
                                                  .features = LW_FEATURE_DCT},
                         &server, err);
    if (status != LW_OK) return status;
    if (pthread_create(&thread, NULL, serve, server) != 0) return lw_status_fail(err, LW_OS, "a thread");
    status = open_client(job, lw_server_port(server), &client, err);
    if (status == LW_OK && !quiet) status = replay(job, server, &client, &figures, err);
    if (status == LW_OK && !quiet) print_link(job, link, &figures);
    lw_server_stop(server);
    pthread_join(thread, NULL);
    close_client(&client);
    lw_server_destroy(server);
    free(figures.error);
    free(figures.link);
    free(figures.mbit);
    return status;
}

/* ---- a scene ---- */

static enum lw_status choose_drawn(struct job *job, struct lw_error *err) {
    const struct lw_scene *scene = job->scene;
    enum lw_status status =
        lw_client_lights_init(&job->drawn, scene, &job->pose, job->settings->direct ? "auto" : "none", err);
    if (status != LW_OK) return status;
    job->channel = lw_client_lights_any(&job->drawn) ? LW_TILE_CHANNEL_SPLIT : LW_TILE_CHANNEL_FULL;
    job->light_bytes = lw_client_lights_bytes(scene->light_count);
    job->material_bytes = lw_client_lights_bytes(scene->material_count);
    job->light_bits = calloc(job->light_bytes + 1, 1);
    job->material_bits = calloc(job->material_bytes + 1, 1);
    if (!job->light_bits || !job->material_bits) return LW_NO_MEMORY;
    lw_client_lights_write(&job->drawn, job->light_bits, job->material_bits);
    return LW_OK;
}

static enum lw_status prepare(struct job *job, struct lw_error *err) {
    const struct settings *s = job->settings;
    job->levels = calloc((size_t)job->map.object_count + 1, sizeof *job->levels);
    job->tile = calloc((size_t)job->map.tile_count + 1, sizeof *job->tile);
    job->moment = calloc((size_t)s->frames, sizeof *job->moment);
    job->picture = malloc((size_t)(s->width * s->height) * 3 * sizeof *job->picture);
    job->sent_levels = calloc((size_t)job->map.object_count + 1, sizeof *job->sent_levels);
    if (!job->levels || !job->tile || !job->moment || !job->picture || !job->sent_levels) return LW_NO_MEMORY;
    for (uint32_t o = 0; o < job->map.object_count; o++) {
        enum lw_status status = lw_levels_init(&job->levels[o], job->channel, job->map.atlas[o]);
        if (status == LW_OK) status = lw_levels_init(&job->sent_levels[o], job->channel, job->map.atlas[o]);
        if (status != LW_OK) return status;
    }
    enum lw_status status = choose_drawn(job, err);
    if (status == LW_OK) status = lw_folders_make_temporary(job->cache, sizeof job->cache, err);
    if (status == LW_OK) status = lw_package_write(job->scene, &job->package, &job->package_size, err);
    if (status == LW_OK) status = lw_replica_create(job->package, job->package_size, 0, &job->replica, err);
    if (status == LW_OK)
        status = lw_replica_set_channels(job->replica, lw_tile_channel_bit(job->channel), NULL);
    return status;
}

static void print_steps(const struct job *job) {
    const struct settings *s = job->settings;
    const uint32_t second = (uint32_t)ceil(s->hz), frames = (uint32_t)s->frames;
    double off[STEPS] = {0};
    for (uint32_t i = second; i < frames; i++)
        for (int step = LEVEL; step < STEPS; step++)
            off[step] += job->moment[i].off[step] * job->moment[i].off[step] / (frames - second);
    printf("| level | waiting | coding |\n|---|---|---|\n| %.4f | %.4f | %.4f |\n\n", sqrt(off[LEVEL]),
           sqrt(off[WAITING]), sqrt(off[CODING]));
    printf("| link | mean Mbit/s | peak Mbit/s | error | largest error | link's | joined, s |\n"
           "|---|---|---|---|---|---|---|\n");
    fflush(stdout);
}

static enum lw_status light_all(struct job *job, struct lw_error *err) {
    struct light light = {0};
    enum lw_status status = open_light(job, &light, err);
    if (status == LW_OK)
        printf("%s; %lld frames, %g a second\n\n", lw_views_about(light.views),
               (long long)job->settings->frames, job->settings->hz);
    fflush(stdout);
    for (uint64_t f = 1; status == LW_OK && f <= (uint64_t)job->settings->frames; f++)
        status = light_frame(job, &light, f, err);
    close_light(&light);
    if (status == LW_OK) print_steps(job);
    return status;
}

static void close_job(struct job *job) {
    for (int64_t f = 0; job->moment && f < job->settings->frames; f++) {
        lw_snapshot_unref(job->moment[f].snapshot);
        free(job->moment[f].view);
        free(job->moment[f].sent);
    }
    for (uint32_t o = 0; job->levels && o < job->map.object_count; o++) lw_levels_finish(&job->levels[o]);
    for (uint32_t o = 0; job->sent_levels && o < job->map.object_count; o++)
        lw_levels_finish(&job->sent_levels[o]);
    lw_replica_destroy(job->replica);
    lw_folders_remove_temporary(job->cache); /* with the package that the client has put there */
    free(job->moment);
    free(job->sent_levels);
    free(job->levels);
    free(job->tile);
    free(job->picture);
    free(job->package);
    free(job->light_bits);
    free(job->material_bits);
    lw_client_lights_finish(&job->drawn);
    bench_close(job->scene, &job->pose, &job->map);
}

static enum lw_status run(void *context, const char *scene, struct lw_error *err) {
    const struct settings *s = context;
    struct job job = {.settings = s};
    char label[64];
    printf("\n### %s\n\n", bench_label(scene, label, sizeof label));
    enum lw_status status = bench_open(&s->open, scene, s->motion ? LW_SCENE_MOTION_LIGHT : BENCH_MOTION_OWN,
                                       0, &job.scene, &job.pose, &job.map, err);
    if (status == LW_OK) status = prepare(&job, err);
    if (status == LW_OK && s->csv_path && !(job.csv = fopen(s->csv_path, "w")))
        status = lw_status_fail(err, LW_CANNOT_CREATE, "%s: %m", s->csv_path);
    if (job.csv) fprintf(job.csv, "link_mbit,seconds,mbit,error\n");
    if (status == LW_OK) status = light_all(&job, err);
    if (status == LW_OK)
        status = run_link(&job, 0, true, err); /* fetches the package, which is not measured */
    for (const char *at = s->links; status == LW_OK && at; at = strchr(at, ',') ? strchr(at, ',') + 1 : NULL)
        status = run_link(&job, atof(at), false, err);
    if (job.csv) fclose(job.csv);
    close_job(&job);
    return status == LW_OK ? LW_OK : lw_status_fail(err, status, "%s: %s", scene, lw_status_text(status));
}

int main(int argc, char **argv) {
    static struct settings s = {
        .frames = 60, .width = 1280, .height = 720, .hz = 10, .slow = 4, .links = "0,3,1"};
    const struct lw_option table[] = {
        BENCH_INT("frames", "frames that are solved (default 60)", &s.frames, 3, 10000),
        {"hz", "HZ", "of them for a second of the scene (default 10)", LW_OPTION_REAL, &s.hz, 0.1, 60, NULL},
        {"motion", "own|light", "what moves: as the scene says (default), or lamps alone", LW_OPTION_CHOICE,
         &s.motion, 0, 0, NULL},
        {"direct", "tiles|auto", "tiles hold all light (default), or the client draws sun and lamps",
         LW_OPTION_CHOICE, &s.direct, 0, 0, NULL},
        {"width", "PIXELS", "of the view (default 1280)", LW_OPTION_INT, &s.width, 16, 4096, NULL},
        {"height", "PIXELS", "of the view (default 720)", LW_OPTION_INT, &s.height, 16, 4096, NULL},
        {"links", "MBIT,...", "limits of the link, Mbit/s; 0: none (default 0,3,1)", LW_OPTION_STRING,
         &s.links, 0, 0, NULL},
        {"slow", "S", "how many times slower than the scene time runs on the link (default 4)",
         LW_OPTION_REAL, &s.slow, 0.1, 100, NULL},
        {"step-widest", "STEP", "of the codec, log2 (default: the publisher's)", LW_OPTION_REAL,
         &s.step_widest, 0, 2, NULL},
        {"csv", "FILE", "also write each frame there", LW_OPTION_STRING, &s.csv_path, 0, 0, NULL}};
    return BENCH_MAIN(argc, argv, table, .name = "bench_stream",
                      .about = "What a walking client's view costs and how far it is off.", .open = &s.open,
                      .context = &s);
}
