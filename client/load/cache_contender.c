#include "client/load/cache_contender.h"

#include "client/load/daemon_child.h"
#include "client/load/truth.h"
#include "client/view/compose.h"
#include "common/clock.h"

#include <stdlib.h>
#include <string.h>

#define JOIN_S  300u /* for the package, which waits for nothing but the link */
#define FRAME_S 60u  /* for the tiles of a frame that is published */

struct cache_contender {
    struct lw_contender base;
    struct lw_cache_contender_desc desc;
    struct lw_daemon_child *daemon;
    struct lw_daemon_report report; /* of the last step */
    struct lw_client **client;
    uint32_t client_count, client_capacity;

    /* of the first client's scene, for all */
    const struct lw_scene *scene;
    struct lw_pose pose;
    struct lw_trace *trace;
    struct lw_compose *compose;

    float **rgb; /* of the shown users; whole pictures */
    uint32_t rgb_count;
};

static struct cache_contender *self(struct lw_contender *contender) {
    return (struct cache_contender *)contender; /* base comes first */
}

static struct lw_client_stats stats_of(const struct lw_client *client) {
    struct lw_client_stats stats;
    lw_client_get_stats(client, &stats);
    return stats;
}

/* ---- beginning and end ---- */

static void stop(struct lw_contender *contender) {
    struct cache_contender *c = self(contender);
    lw_compose_destroy(c->compose);
    lw_trace_destroy(c->trace);
    if (c->scene) lw_pose_finish(&c->pose);
    while (c->client_count)
        lw_client_destroy(c->client[--c->client_count]); /* the first one's scene goes last */
    lw_daemon_child_stop(c->daemon);
    for (uint32_t i = 0; i < c->rgb_count; i++) free(c->rgb[i]);
    free(c->rgb);
    c->compose = NULL;
    c->trace = NULL;
    c->scene = NULL;
    c->daemon = NULL;
    c->rgb = NULL;
    c->rgb_count = 0;
}

static enum lw_status start(struct lw_contender *contender, const struct lw_setting *setting, bool lattice,
                            uint32_t seed, struct lw_error *err) {
    (void)lattice; /* which level is read depends on a pixel's size */
    struct cache_contender *c = self(contender);
    const char *package;
    enum lw_status status = c->desc.package(c->desc.context, setting->density, &package, err);
    if (status != LW_OK) return status;
    c->report = (struct lw_daemon_report){0};
    return lw_daemon_child_start(&(struct lw_daemon_child_desc){.package = package,
                                                                .bounces = c->desc.bounces,
                                                                .direct_samples = setting->direct_samples,
                                                                .indirect_samples = setting->indirect_samples,
                                                                .seed = seed,
                                                                .rest_error = setting->rest_error,
                                                                .threads = c->desc.threads,
                                                                .denoise = c->desc.denoise},
                                 &c->daemon, err);
}

/* What the first client brings is for all. */
static enum lw_status set_stage(struct cache_contender *c, struct lw_error *err) {
    const struct lw_scene *scene = lw_client_scene(c->client[0]);
    enum lw_status status = lw_pose_init(&c->pose, scene);
    if (status != LW_OK) return lw_status_fail(err, status, "no memory for the scene's pose");
    c->scene = scene;
    status = lw_trace_create(scene, &c->pose, &c->trace, err);
    if (status != LW_OK) return status;
    return lw_compose_create(&(struct lw_compose_desc){.scene = scene,
                                                       .map = lw_client_atlas_map(c->client[0]),
                                                       .trace = c->trace,
                                                       .threads = c->desc.threads},
                             &c->compose, err);
}

static enum lw_status join(struct cache_contender *c, struct lw_error *err) {
    struct lw_client *client;
    const struct lw_client_desc desc = {.host = "127.0.0.1",
                                        .port = lw_daemon_child_port(c->daemon),
                                        .name = "lightwell-load",
                                        .scene_of = c->client_count ? c->client[0] : NULL};
    enum lw_status status = lw_client_create(&desc, &client, err);
    if (status != LW_OK) return status;
    c->client[c->client_count++] = client;
    for (uint64_t end_ns = lw_clock_ns() + JOIN_S * 1000000000ull; !lw_client_scene(client);) {
        status = lw_client_poll(client, 100, err);
        if (status != LW_OK) return status;
        if (lw_clock_ns() > end_ns)
            return lw_status_fail(err, LW_TIMED_OUT, "the scene has not arrived in %u s", JOIN_S);
    }
    return c->client_count == 1 ? set_stage(c, err) : LW_OK;
}

static enum lw_status set_users(struct lw_contender *contender, uint32_t users, struct lw_error *err) {
    struct cache_contender *c = self(contender);
    if (users > c->client_capacity) {
        struct lw_client **grown = realloc(c->client, users * sizeof *grown);
        if (!grown) return lw_status_fail(err, LW_NO_MEMORY, "no memory for %u clients", users);
        c->client = grown;
        c->client_capacity = users;
    }
    while (c->client_count > users) lw_client_destroy(c->client[--c->client_count]);
    while (c->client_count < users) {
        enum lw_status status = join(c, err);
        if (status != LW_OK) {
            lw_status_context(err, "user %u", c->client_count);
            return status;
        }
    }
    return LW_OK;
}

/* ---- a frame ---- */

/* All clients take in what was published, each in its turn; what one thread spends on it is what they spend. */
static enum lw_status receive(struct cache_contender *c, struct lw_cost *cost, struct lw_error *err) {
    for (uint32_t i = 0; i < c->client_count; i++) {
        struct lw_client *client = c->client[i];
        const struct lw_client_stats before = stats_of(client);
        const uint64_t cpu_ns = lw_clock_thread_cpu_ns(), end_ns = lw_clock_ns() + FRAME_S * 1000000000ull;
        while (stats_of(client).settled_frame < c->report.published) {
            enum lw_status status = lw_client_poll(client, 100, err);
            if (status != LW_OK) return status;
            if (lw_clock_ns() > end_ns)
                return lw_status_fail(err, LW_TIMED_OUT, "a frame has not arrived in %u s", FRAME_S);
        }
        const struct lw_client_stats after = stats_of(client);
        const double decode_s = 1e-9 * (double)(after.decode_ns - before.decode_ns);
        const double all_s = 1e-9 * (double)(lw_clock_thread_cpu_ns() - cpu_ns);
        cost->cpu_s[LW_STAGE_DECODE] += decode_s < all_s ? decode_s : all_s;
        cost->cpu_s[LW_STAGE_RECEIVE] += decode_s < all_s ? all_s - decode_s : 0;
        cost->bytes += (double)(after.bytes - before.bytes);
    }
    return LW_OK;
}

static struct lw_client_level client_level(const void *context, uint32_t object, uint32_t level) {
    return lw_client_get_level(context, object, level);
}

static struct lw_client_tile client_tile(const void *context, lw_tile_id tile) {
    return lw_client_get_tile(context, tile);
}

/* Objects are where the server says. */
static enum lw_status follow(struct cache_contender *c, struct lw_error *err) {
    bool moved = false;
    for (uint32_t o = 0; o < c->scene->object_count; o++) {
        const struct lw_affine *there = lw_client_object_to_world(c->client[0], o);
        moved |= memcmp(&c->pose.object_to_world[o], there, sizeof *there) != 0;
        c->pose.object_to_world[o] = *there;
    }
    return moved ? lw_trace_set_pose(c->trace, &c->pose, err) : LW_OK;
}

static enum lw_status need_pictures(struct cache_contender *c, uint32_t count, struct lw_error *err) {
    if (count <= c->rgb_count) return LW_OK;
    float **grown = realloc(c->rgb, count * sizeof *grown);
    if (!grown) return lw_status_fail(err, LW_NO_MEMORY, "no memory for %u pictures", count);
    c->rgb = grown;
    for (; c->rgb_count < count; c->rgb_count++) {
        c->rgb[c->rgb_count] = malloc((size_t)c->desc.width * c->desc.height * 3 * sizeof(float));
        if (!c->rgb[c->rgb_count]) return lw_status_fail(err, LW_NO_MEMORY, "no memory for a picture");
    }
    return LW_OK;
}

static void show(struct cache_contender *c, uint64_t frame, uint32_t user, float *rgb) {
    const struct lw_client *client = c->client[user % c->client_count];
    const struct lw_client_stats stats = stats_of(client);
    const struct lw_compose_source source = {.context = client,
                                             .level = client_level,
                                             .tile = client_tile,
                                             .sky = lw_vec3(stats.sky[0], stats.sky[1], stats.sky[2]),
                                             .bounces = stats.bounces,
                                             .target_error = stats.target_error};
    const struct lw_compose_view view = {
        .camera = lw_views_at(c->desc.views, user, frame), .width = c->desc.width, .height = c->desc.height};
    struct lw_compose_report report;
    lw_compose_render(c->compose, &source, &c->pose, &view, rgb, &report);
}

static enum lw_status step(struct lw_contender *contender, uint64_t frame, const uint32_t *shown,
                           uint32_t shown_count, struct lw_cost *cost, struct lw_error *err) {
    struct cache_contender *c = self(contender);
    const struct lw_daemon_report before = c->report;
    enum lw_status status = lw_daemon_child_step(c->daemon, &c->report, err);
    if (status != LW_OK) return status;
    if (c->report.frame != frame)
        return lw_status_fail(err, LW_INTERNAL, "lightwelld is at frame %llu, we at %llu",
                              (unsigned long long)c->report.frame, (unsigned long long)frame);
    cost->cpu_s[LW_STAGE_SOLVE] += c->report.solve_cpu_s;
    cost->cpu_s[LW_STAGE_ENCODE] += c->report.publish_cpu_s;
    /* up to this frame's end, so most of it is for the frame before: over a sequence that is the same */
    cost->cpu_s[LW_STAGE_SEND] += c->report.loop_cpu_s - before.loop_cpu_s;
    cost->rays += c->report.rays - before.rays;
    status = receive(c, cost, err);
    if (status == LW_OK) status = need_pictures(c, shown_count, err);
    if (status != LW_OK || !shown_count) return status;
    uint64_t began = lw_clock_process_cpu_ns();
    status = follow(c, err);
    uint64_t moved = lw_clock_process_cpu_ns();
    for (uint32_t i = 0; status == LW_OK && i < shown_count; i++) show(c, frame, shown[i], c->rgb[i]);
    uint64_t ended = lw_clock_process_cpu_ns();
    cost->cpu_s[LW_STAGE_COMPOSE] += 1e-9 * ((double)(moved - began) * c->client_count +
                                             (double)(ended - moved) * c->client_count / shown_count);
    return status;
}

static void picture(const struct lw_contender *contender, uint32_t index, float *out_lattice) {
    const struct cache_contender *c = (const struct cache_contender *)contender;
    lw_truth_pick(c->rgb[index], c->desc.width, c->desc.height, c->desc.stride, out_lattice);
}

static void destroy(struct lw_contender *contender) {
    struct cache_contender *c = self(contender);
    stop(contender);
    free(c->client);
    free(c);
}

static const struct lw_contender_ops ops = {.name = "shared cache",
                                            .start = start,
                                            .set_users = set_users,
                                            .step = step,
                                            .picture = picture,
                                            .stop = stop,
                                            .destroy = destroy};

enum lw_status lw_cache_contender_create(const struct lw_cache_contender_desc *desc,
                                         struct lw_contender **out_contender, struct lw_error *err) {
    struct cache_contender *c = calloc(1, sizeof *c);
    if (!c) return lw_status_fail(err, LW_NO_MEMORY, "no memory for the shared cache");
    c->base = (struct lw_contender){.ops = &ops, .history = UINT32_MAX};
    c->desc = *desc;
    *out_contender = &c->base;
    return LW_OK;
}

struct lw_cache_frame lw_cache_contender_frame(const struct lw_contender *contender) {
    const struct cache_contender *c = (const struct cache_contender *)contender;
    return (struct lw_cache_frame){c->report.tiles_solved, c->report.tiles, c->report.texels_solved};
}
