#include "client/measure/sides/cache_renderer.h"

#include "client/measure/sides/lattice.h"
#include "client/measure/sides/views.h"
#include "common/base/clock.h"

#include <stdlib.h>
#include <time.h>

#define FRAME_S 60u        /* for the tiles of a frame that is published */
#define TELL_NS 150000000u /* until a server knows a client's interest: 100 ms, and its way */

struct cache_renderer {
    struct lw_renderer base;
    struct lw_renderer_desc desc;
    struct lw_daemon_child *daemon;
    struct lw_daemon_report report; /* the last step's */
    double server_cpu_s;            /* the server process's, at the end of the last step */
    struct lw_viewers viewers;
    float **rgb; /* a whole picture for each shown user */
    uint32_t rgb_count;
};

static struct cache_renderer *self(struct lw_renderer *renderer) {
    return (struct cache_renderer *)renderer; /* base comes first */
}

static void stop(struct lw_renderer *renderer) {
    struct cache_renderer *c = self(renderer);
    lw_viewers_finish(&c->viewers);
    lw_daemon_child_stop(c->daemon);
    for (uint32_t i = 0; i < c->rgb_count; i++) free(c->rgb[i]);
    free(c->rgb);
    c->daemon = NULL;
    c->rgb = NULL;
    c->rgb_count = 0;
}

enum lw_status lw_cache_renderer_serve(const struct lw_renderer_desc *desc, const struct lw_setting *setting,
                                       uint32_t seed, bool real_clock, struct lw_daemon_child **out_daemon,
                                       struct lw_viewers *out_viewers, struct lw_error *err) {
    const char *package;
    enum lw_status status = lw_scene_densities_find(desc->densities, setting->density, &package, err);
    if (status != LW_OK) return status;
    status =
        lw_daemon_child_start(&(struct lw_daemon_child_desc){.package = package,
                                                             .bounces = desc->bounces,
                                                             .direct_samples = setting->direct_samples,
                                                             .indirect_samples = setting->indirect_samples,
                                                             .seed = seed,
                                                             .target_error = setting->target_error,
                                                             .threads = desc->threads,
                                                             .denoise = desc->denoise,
                                                             .solver = desc->solver,
                                                             .seen = !setting->whole,
                                                             .real_clock = real_clock},
                              out_daemon, err);
    if (status != LW_OK) return status;
    lw_viewers_init(out_viewers, lw_daemon_child_port(*out_daemon), desc->width, desc->height, desc->threads,
                    setting->whole, !desc->denoise);
    out_viewers->draws_direct = setting->draws;
    out_viewers->draws_by_gl = setting->by_gl;
    return LW_OK;
}

static enum lw_status start(struct lw_renderer *renderer, const struct lw_setting *setting, bool lattice,
                            uint32_t seed, struct lw_error *err) {
    (void)lattice; /* which level is read depends on a pixel's size */
    struct cache_renderer *c = self(renderer);
    c->report = (struct lw_daemon_report){0};
    c->server_cpu_s = 0;
    return lw_cache_renderer_serve(&c->desc, setting, seed, false, &c->daemon, &c->viewers, err);
}

static enum lw_status set_users(struct lw_renderer *renderer, uint32_t users, struct lw_error *err) {
    struct lw_viewers *viewers = &self(renderer)->viewers;
    const bool fewer = users <= viewers->count;
    enum lw_status status = lw_viewers_set_count(viewers, users, err);
    for (uint32_t user = 0; fewer && status == LW_OK && user < viewers->count; user++)
        status = lw_viewers_forget(viewers, user, err);
    return status;
}

/* All clients take in the published frame, one after another. One thread does it: its CPU time is theirs. */
static enum lw_status receive(struct cache_renderer *c, struct lw_cost *cost, struct lw_error *err) {
    for (uint32_t user = 0; user < c->viewers.count; user++) {
        const struct lw_client_stats before = lw_viewers_stats(&c->viewers, user);
        const uint64_t cpu_ns = lw_clock_thread_cpu_ns(), end_ns = lw_clock_ns() + FRAME_S * 1000000000ull;
        /* once in any case: without a new frame the client still has its interest to send */
        enum lw_status status = lw_client_poll(c->viewers.user[user].client, 0, err);
        if (status != LW_OK) return status;
        while (lw_viewers_stats(&c->viewers, user).settled_frame < c->report.published) {
            status = lw_client_poll(c->viewers.user[user].client, 100, err);
            if (status != LW_OK) return status;
            if (lw_clock_ns() > end_ns)
                return lw_status_fail(err, LW_TIMED_OUT, "a frame has not arrived in %u s", FRAME_S);
        }
        const struct lw_client_stats after = lw_viewers_stats(&c->viewers, user);
        const double decode_s = 1e-9 * (double)(after.decode_ns - before.decode_ns);
        const double all_s = 1e-9 * (double)(lw_clock_thread_cpu_ns() - cpu_ns);
        cost->cpu_s[LW_STAGE_DECODE] += decode_s < all_s ? decode_s : all_s;
        cost->cpu_s[LW_STAGE_RECEIVE] += decode_s < all_s ? all_s - decode_s : 0;
        cost->bytes += (double)(after.bytes - before.bytes);
    }
    return LW_OK;
}

static enum lw_status need_pictures(struct cache_renderer *c, uint32_t count, struct lw_error *err) {
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

static uint64_t scene_ns(uint64_t frame) { return frame * 1000000000ull / LW_VIEWS_HZ; }

/* The user with whose eye a client sees: the shown user that the client serves, else its own user. */
static uint32_t eye_of(const struct cache_renderer *c, uint32_t user, const uint32_t *shown,
                       uint32_t shown_count) {
    for (uint32_t i = 0; i < shown_count; i++)
        if (shown[i] % c->viewers.count == user) return shown[i];
    return user;
}

/* A client sends its interest at most every 100 ms by the wall clock (client/lib/interest.h). It has just
 * sent an empty one: without this wait, shorter frames would all pass unlit. */
static enum lw_status await_interest(struct cache_renderer *c, struct lw_error *err) {
    enum lw_status status = LW_OK;
    for (uint64_t end_ns = lw_clock_ns() + TELL_NS; status == LW_OK && lw_clock_ns() < end_ns;) {
        nanosleep(&(struct timespec){.tv_nsec = 10000000}, NULL);
        for (uint32_t user = 0; user < c->viewers.count && status == LW_OK; user++)
            status = lw_client_poll(c->viewers.user[user].client, 0, err);
    }
    return status;
}

/* New clients set their interest. */
static enum lw_status set_first_interest(struct cache_renderer *c, uint64_t frame, const uint32_t *shown,
                                         uint32_t shown_count, struct lw_error *err) {
    enum lw_status status = LW_OK;
    bool any = false;
    for (uint32_t user = 0; user < c->viewers.count && status == LW_OK; user++) {
        if (c->viewers.user[user].looked_ns) continue;
        const uint32_t eye = eye_of(c, user, shown, shown_count);
        const struct lw_camera_view camera = c->desc.cameras.at(c->desc.cameras.context, eye, frame);
        status = lw_viewers_look(&c->viewers, user, &camera, scene_ns(frame), err);
        any = true;
    }
    return status == LW_OK && any && !c->viewers.wants_everything ? await_interest(c, err) : status;
}

static enum lw_status render_views(struct cache_renderer *c, uint64_t frame, const uint32_t *shown,
                                   uint32_t shown_count, struct lw_cost *cost, struct lw_error *err) {
    const double users = c->viewers.count;
    uint64_t began = lw_clock_process_cpu_ns();
    enum lw_status status = lw_viewers_follow(&c->viewers, err);
    uint64_t moved = lw_clock_process_cpu_ns();
    for (uint32_t i = 0; status == LW_OK && i < shown_count; i++) {
        struct lw_camera_view camera = c->desc.cameras.at(c->desc.cameras.context, shown[i], frame);
        const uint32_t user = shown[i] % c->viewers.count;
        status = lw_viewers_show(&c->viewers, user, &camera, c->rgb[i], err);
        if (status == LW_OK) status = lw_viewers_look(&c->viewers, user, &camera, scene_ns(frame), err);
    }
    uint64_t ended = lw_clock_process_cpu_ns();
    cost->cpu_s[LW_STAGE_COMPOSE] +=
        1e-9 * ((double)(moved - began) * users + (double)(ended - moved) * users / shown_count);
    return status;
}

static enum lw_status step(struct lw_renderer *renderer, uint64_t frame, const uint32_t *shown,
                           uint32_t shown_count, struct lw_cost *cost, struct lw_error *err) {
    struct cache_renderer *c = self(renderer);
    const struct lw_daemon_report before = c->report;
    enum lw_status status = set_first_interest(c, frame, shown, shown_count, err);
    if (status == LW_OK) status = lw_daemon_child_step(c->daemon, &c->report, err);
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
    /* what other threads of the server do, whatever frame it belongs to */
    const double server_cpu_s = lw_daemon_child_cpu_s(c->daemon),
                 reported_s = c->report.solve_cpu_s + c->report.publish_cpu_s + c->report.loop_cpu_s -
                              before.loop_cpu_s;
    if (c->server_cpu_s > 0) cost->cpu_s[LW_STAGE_BETWEEN] += server_cpu_s - c->server_cpu_s - reported_s;
    c->server_cpu_s = server_cpu_s;
    if (status == LW_OK) status = need_pictures(c, shown_count, err);
    if (status == LW_OK && shown_count) status = render_views(c, frame, shown, shown_count, cost, err);
    return status;
}

static void picture(const struct lw_renderer *renderer, uint32_t index, float *out_lattice) {
    const struct cache_renderer *c = (const struct cache_renderer *)renderer;
    lw_lattice_pick(c->rgb[index], c->desc.width, c->desc.height, c->desc.stride, out_lattice);
}

static void elsewhere(const struct lw_renderer *renderer, double *out_cpu_s, double *out_bytes) {
    const struct cache_renderer *c = (const struct cache_renderer *)renderer;
    *out_cpu_s = c->daemon ? lw_daemon_child_cpu_s(c->daemon) : 0;
    *out_bytes = c->daemon ? (double)lw_daemon_child_memory_bytes(c->daemon) : 0;
}

static void destroy(struct lw_renderer *renderer) {
    stop(renderer);
    free(self(renderer));
}

static const struct lw_renderer_ops ops = {.name = "shared cache",
                                           .start = start,
                                           .set_users = set_users,
                                           .step = step,
                                           .picture = picture,
                                           .elsewhere = elsewhere,
                                           .stop = stop,
                                           .destroy = destroy};

enum lw_status lw_cache_renderer_create(const struct lw_renderer_desc *desc,
                                        struct lw_renderer **out_renderer, struct lw_error *err) {
    struct cache_renderer *c = calloc(1, sizeof *c);
    if (!c) return lw_status_fail(err, LW_NO_MEMORY, "no memory for the shared cache");
    c->base = (struct lw_renderer){.ops = &ops, .history = UINT32_MAX};
    c->desc = *desc;
    *out_renderer = &c->base;
    return LW_OK;
}
