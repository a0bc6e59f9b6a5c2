#include "client/load/path_contender.h"

#include "client/load/path_world.h"
#include "client/load/truth.h"
#include "client/view/svgf.h"
#include "common/clock.h"
#include "common/random.h"

#include <stdlib.h>

/* Frames that a filtered picture draws on: from here on it gets no better where something moves. */
#define FILTER_HISTORY 16u

/* What one of the shown users sees. */
struct screen {
    struct lw_path_film film;
    float *rgb;
    struct lw_gbuffer gbuffer; /* with the filter */
    struct lw_svgf *svgf;
};

struct path_contender {
    struct lw_contender base;
    struct lw_path_contender_desc desc;
    struct lw_path_world world;
    struct lw_setting setting;
    bool lattice;
    uint32_t seed, users, width, height; /* of the films */
    struct screen *screen;
    uint32_t screen_count;
};

static struct path_contender *self(struct lw_contender *contender) {
    return (struct path_contender *)contender; /* base comes first */
}

static void free_screens(struct path_contender *c) {
    for (uint32_t i = 0; i < c->screen_count; i++) {
        lw_path_film_finish(&c->screen[i].film);
        free(c->screen[i].rgb);
        lw_svgf_destroy(c->screen[i].svgf);
        lw_gbuffer_finish(&c->screen[i].gbuffer);
    }
    free(c->screen);
    c->screen = NULL;
    c->screen_count = 0;
}

static enum lw_status init_screen(struct path_contender *c, struct screen *screen, struct lw_error *err) {
    *screen = (struct screen){0};
    enum lw_status status = lw_path_film_init(&screen->film, c->width, c->height, err);
    if (status != LW_OK) return status;
    screen->rgb = calloc((size_t)c->width * c->height * 3, sizeof *screen->rgb);
    if (!screen->rgb) return lw_status_fail(err, LW_NO_MEMORY, "no memory for a picture");
    if (!c->desc.denoise) return LW_OK;
    status = lw_gbuffer_init(&screen->gbuffer,
                             &(struct lw_gbuffer_desc){.scene = c->desc.scene,
                                                       .trace = c->world.trace,
                                                       .width = c->width,
                                                       .height = c->height,
                                                       .threads = c->desc.threads},
                             err);
    if (status != LW_OK) return status;
    return lw_svgf_create(
        &(struct lw_svgf_desc){.width = c->width, .height = c->height, .threads = c->desc.threads},
        &screen->svgf, err);
}

static enum lw_status need_screens(struct path_contender *c, uint32_t count, struct lw_error *err) {
    struct screen *grown = count > c->screen_count ? realloc(c->screen, count * sizeof *grown) : c->screen;
    if (!grown) return lw_status_fail(err, LW_NO_MEMORY, "no memory for %u pictures", count);
    c->screen = grown;
    while (c->screen_count < count) {
        enum lw_status status = init_screen(c, &c->screen[c->screen_count++], err);
        if (status != LW_OK) return status;
    }
    return LW_OK;
}

static enum lw_status start(struct lw_contender *contender, const struct lw_setting *setting, bool lattice,
                            uint32_t seed, struct lw_error *err) {
    (void)err;
    struct path_contender *c = self(contender);
    c->setting = *setting;
    c->seed = seed;
    c->users = 0;
    c->lattice = lattice && !c->desc.denoise; /* the filter wants neighbours */
    c->width = c->desc.width / (c->lattice ? c->desc.stride : 1);
    c->height = c->desc.height / (c->lattice ? c->desc.stride : 1);
    return LW_OK;
}

static enum lw_status set_users(struct lw_contender *contender, uint32_t users, struct lw_error *err) {
    (void)err;
    self(contender)->users = users;
    return LW_OK;
}

/* How many paths a frame adds: those of the setting; where the picture rests, up to those in all. */
static uint32_t samples_now(const struct path_contender *c, const struct lw_path_film *film) {
    if (!c->desc.rests) return c->setting.samples;
    uint32_t left = c->setting.samples - film->samples, step = (c->setting.samples + 15) / 16;
    return left < step ? left : step;
}

/* Traces what a user sees. */
static void trace(struct path_contender *c, struct screen *screen, uint64_t frame, uint32_t user) {
    struct lw_path_view view = {.camera = lw_views_at(c->desc.views, user, frame)};
    if (!c->desc.rests) lw_path_film_clear(&screen->film);
    const uint32_t samples = samples_now(c, &screen->film);
    if (!samples) return;
    if (c->desc.denoise) {
        /* what the filter averages, over time and neighbours, is one sample of the light */
        view.seed = lw_random_hash2(c->seed, user);
        view.first_sample = (uint32_t)(frame - 1) * c->setting.samples;
        view.pattern = LW_PATH_PATTERN_INTERLEAVED;
    } else {
        /* one sequence goes on while the picture rests; every other frame has its own */
        view.seed = lw_random_hash3(c->seed, c->desc.rests ? 0 : (uint32_t)frame, user);
    }
    lw_path_world_render(&c->world, &view, samples, &screen->film);
    lw_path_film_resolve(&screen->film, screen->rgb);
}

static void filter(struct path_contender *c, struct screen *screen, uint64_t frame, uint32_t user) {
    const struct lw_camera_view camera = lw_views_at(c->desc.views, user, frame);
    lw_gbuffer_render(&screen->gbuffer, &c->world.pose, &camera);
    lw_svgf_filter(screen->svgf, &screen->gbuffer, screen->rgb, screen->rgb);
}

static enum lw_status step(struct lw_contender *contender, uint64_t frame, const uint32_t *shown,
                           uint32_t shown_count, struct lw_cost *cost, struct lw_error *err) {
    struct path_contender *c = self(contender);
    enum lw_status status = need_screens(c, shown_count, err);
    uint64_t began = lw_clock_process_cpu_ns();
    /* every user has a machine of his own, which moves the scene for him alone */
    if (status == LW_OK && !c->desc.rests)
        status = lw_path_world_set_time(&c->world, (double)(frame - 1) / LW_VIEWS_HZ, err);
    if (status != LW_OK) return status;
    uint64_t moved = lw_clock_process_cpu_ns();
    for (uint32_t i = 0; i < shown_count; i++) trace(c, &c->screen[i], frame, shown[i]);
    uint64_t traced = lw_clock_process_cpu_ns();
    for (uint32_t i = 0; c->desc.denoise && i < shown_count; i++) filter(c, &c->screen[i], frame, shown[i]);
    uint64_t ended = lw_clock_process_cpu_ns();
    double for_all = shown_count ? (double)c->users / shown_count : 0;
    cost->cpu_s[LW_STAGE_TRACE] +=
        1e-9 * ((double)(moved - began) * c->users + (double)(traced - moved) * for_all);
    cost->cpu_s[LW_STAGE_FILTER] += 1e-9 * (double)(ended - traced) * for_all;
    return LW_OK;
}

static void picture(const struct lw_contender *contender, uint32_t index, float *out_lattice) {
    const struct path_contender *c = (const struct path_contender *)contender;
    lw_truth_pick(c->screen[index].rgb, c->width, c->height, c->lattice ? 1 : c->desc.stride, out_lattice);
}

static void stop(struct lw_contender *contender) { free_screens(self(contender)); }

static void destroy(struct lw_contender *contender) {
    struct path_contender *c = self(contender);
    free_screens(c);
    lw_path_world_finish(&c->world);
    free(c);
}

static const struct lw_contender_ops ops = {.name = "path tracer",
                                            .start = start,
                                            .set_users = set_users,
                                            .step = step,
                                            .picture = picture,
                                            .stop = stop,
                                            .destroy = destroy};

enum lw_status lw_path_contender_create(const struct lw_path_contender_desc *desc,
                                        struct lw_contender **out_contender, struct lw_error *err) {
    struct path_contender *c = calloc(1, sizeof *c);
    if (!c) return lw_status_fail(err, LW_NO_MEMORY, "no memory for the path tracer");
    c->base = (struct lw_contender){.ops = &ops,
                                    .history = desc->rests     ? UINT32_MAX
                                               : desc->denoise ? FILTER_HISTORY
                                                               : 0,
                                    .keeps = desc->rests || desc->denoise};
    c->desc = *desc;
    enum lw_status status = lw_path_world_init(&c->world, desc->scene, desc->bounces, desc->threads, err);
    if (status != LW_OK) {
        free(c);
        return status;
    }
    *out_contender = &c->base;
    return LW_OK;
}
