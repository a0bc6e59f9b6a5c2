#include "client/measure/sides/per_user_renderer.h"

#include "client/measure/sides/lattice.h"
#include "client/measure/sides/path_world.h"
#include "client/measure/sides/views.h"
#include "common/base/clock.h"
#include "common/base/random.h"

#include <stdlib.h>

/* Frames before a picture that are rendered for it: as many as a history counts where nothing else takes
 * noise away; with the filter over the picture, half of them differ by less than the views do. */
#define HISTORY          32u
#define HISTORY_FILTERED 16u

struct per_user_renderer {
    struct lw_renderer base;
    struct lw_renderer_desc desc;
    enum lw_path_renderer_kind kind;
    struct lw_path_world world;
    struct lw_setting setting;
    bool lattice;
    uint32_t seed, users, width, height; /* width and height of a picture */
    /* for each of the shown users */
    struct screen {
        struct lw_path_renderer *renderer;
        const float *rgb;
    } * screen;
    uint32_t screen_count;
};

static struct per_user_renderer *self(struct lw_renderer *renderer) {
    return (struct per_user_renderer *)renderer; /* base comes first */
}

static void free_screens(struct per_user_renderer *c) {
    for (uint32_t i = 0; i < c->screen_count; i++) lw_path_renderer_destroy(c->screen[i].renderer);
    free(c->screen);
    c->screen = NULL;
    c->screen_count = 0;
}

static enum lw_status init_screen(struct per_user_renderer *c, struct screen *screen, struct lw_error *err) {
    *screen = (struct screen){0};
    return lw_path_renderer_create(&(struct lw_path_renderer_desc){.kind = c->kind,
                                                                   .scene = c->world.scene,
                                                                   .trace = c->world.trace,
                                                                   .tracer = c->world.tracer,
                                                                   .lights = &c->world.lights,
                                                                   .width = c->width,
                                                                   .height = c->height,
                                                                   .bounces = c->desc.bounces,
                                                                   .threads = c->desc.threads},
                                   &screen->renderer, err);
}

static enum lw_status need_screens(struct per_user_renderer *c, uint32_t count, struct lw_error *err) {
    struct screen *grown = count > c->screen_count ? realloc(c->screen, count * sizeof *grown) : c->screen;
    if (!grown) return lw_status_fail(err, LW_NO_MEMORY, "no memory for %u pictures", count);
    c->screen = grown;
    while (c->screen_count < count) {
        enum lw_status status = init_screen(c, &c->screen[c->screen_count++], err);
        if (status != LW_OK) return status;
    }
    return LW_OK;
}

static enum lw_status start(struct lw_renderer *renderer, const struct lw_setting *setting, bool lattice,
                            uint32_t seed, struct lw_error *err) {
    (void)err;
    struct per_user_renderer *c = self(renderer);
    c->setting = *setting;
    c->seed = seed;
    c->users = 0;
    c->lattice = lattice && !lw_path_renderer_remembers(c->kind); /* which want neighbours */
    c->width = c->desc.width / (c->lattice ? c->desc.stride : 1);
    c->height = c->desc.height / (c->lattice ? c->desc.stride : 1);
    return LW_OK;
}

static enum lw_status set_users(struct lw_renderer *renderer, uint32_t users, struct lw_error *err) {
    (void)err;
    self(renderer)->users = users;
    return LW_OK;
}

/* Paths that a frame adds: those of the setting. In a still picture a sixteenth of them, until all exist. */
static uint32_t samples_now(const struct per_user_renderer *c, const struct screen *screen) {
    if (!c->desc.still || lw_path_renderer_remembers(c->kind)) return c->setting.samples;
    uint32_t left = c->setting.samples - lw_path_renderer_samples(screen->renderer),
             step = (c->setting.samples + 15) / 16;
    return left < step ? left : step;
}

/* Renders what a user sees. */
static void render(struct per_user_renderer *c, struct screen *screen, uint64_t frame, uint32_t user,
                   struct lw_path_frame_cost *cost) {
    const uint32_t samples = samples_now(c, screen);
    if (!samples) return;
    screen->rgb = lw_path_renderer_frame(
        screen->renderer,
        &(struct lw_path_frame){.pose = &c->world.pose,
                                .camera = c->desc.cameras.at(c->desc.cameras.context, user, frame),
                                .samples = samples,
                                .seed = lw_random_hash2(c->seed, user),
                                .number = (uint32_t)(frame - 1),
                                .still = c->desc.still},
        cost);
}

static enum lw_status step(struct lw_renderer *renderer, uint64_t frame, const uint32_t *shown,
                           uint32_t shown_count, struct lw_cost *cost, struct lw_error *err) {
    struct per_user_renderer *c = self(renderer);
    enum lw_status status = need_screens(c, shown_count, err);
    uint64_t began = lw_clock_process_cpu_ns();
    /* every user has a machine of his own, which moves the scene for him alone */
    if (status == LW_OK && !c->desc.still)
        status = lw_path_world_set_time(&c->world, (double)(frame - 1) / LW_VIEWS_HZ, err);
    if (status != LW_OK) return status;
    uint64_t moved = lw_clock_process_cpu_ns();
    struct lw_path_frame_cost rendered = {0};
    for (uint32_t i = 0; i < shown_count; i++) render(c, &c->screen[i], frame, shown[i], &rendered);
    double for_all = shown_count ? (double)c->users / shown_count : 0;
    cost->cpu_s[LW_STAGE_TRACE] += 1e-9 * (double)(moved - began) * c->users + rendered.trace_s * for_all;
    cost->cpu_s[LW_STAGE_FILTER] += rendered.filter_s * for_all;
    return LW_OK;
}

static void picture(const struct lw_renderer *renderer, uint32_t index, float *out_lattice) {
    const struct per_user_renderer *c = (const struct per_user_renderer *)renderer;
    lw_lattice_pick(c->screen[index].rgb, c->width, c->height, c->lattice ? 1 : c->desc.stride, out_lattice);
}

static void stop(struct lw_renderer *renderer) { free_screens(self(renderer)); }

static void destroy(struct lw_renderer *renderer) {
    struct per_user_renderer *c = self(renderer);
    free_screens(c);
    lw_path_world_finish(&c->world);
    free(c);
}

static const struct lw_renderer_ops ops = {.name = "path tracer",
                                           .start = start,
                                           .set_users = set_users,
                                           .step = step,
                                           .picture = picture,
                                           .stop = stop,
                                           .destroy = destroy};

enum lw_status lw_per_user_renderer_create(const struct lw_renderer_desc *desc,
                                           enum lw_path_renderer_kind kind, struct lw_renderer **out_renderer,
                                           struct lw_error *err) {
    struct per_user_renderer *c = calloc(1, sizeof *c);
    if (!c) return lw_status_fail(err, LW_NO_MEMORY, "no memory for the path tracer");
    const bool remembers = lw_path_renderer_remembers(kind);
    const uint32_t history = desc->still                            ? UINT32_MAX
                             : !remembers                           ? 0
                             : kind == LW_PATH_RENDERER_REPROJECTED ? HISTORY
                                                                    : HISTORY_FILTERED;
    c->base = (struct lw_renderer){.ops = &ops, .history = history, .keeps = desc->still || remembers};
    c->desc = *desc;
    c->kind = kind;
    enum lw_status status =
        lw_path_world_init(&c->world, desc->densities->scene, desc->bounces, desc->threads, err);
    if (status != LW_OK) {
        free(c);
        return status;
    }
    *out_renderer = &c->base;
    return LW_OK;
}
