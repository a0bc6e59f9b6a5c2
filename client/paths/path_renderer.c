#include "client/paths/path_renderer.h"

#include "client/paths/svgf.h"
#include "common/base/clock.h"
#include "common/base/colour.h"
#include "common/base/random.h"

#include <stdlib.h>

#define CLAMP_MEANS                                                                                          \
    10.0f /* over the picture's mean luminance: the most that a path brings from beyond its first hit */
#define GLANCE_SIDE 64u /* pixels of the picture whose mean counts before there is another */
#define STEP        2u  /* every STEP-th pixel of a quarter */

struct lw_path_renderer {
    struct lw_path_renderer_desc desc;
    struct lw_path_film film;
    float *rgb; /* the picture */
    struct lw_gbuffer gbuffer;
    struct lw_svgf *svgf;
    /* light that arrives by bounces, of a quarter of the pixels */
    struct quarter {
        struct lw_gbuffer gbuffer;
        struct lw_path_film film;
        struct lw_svgf *svgf;
        float *radiance; /* its pixels' */
        uint32_t turn;   /* which pixel of each square it has */
        float *rgb;      /* of all pixels */
    } quarter;
    struct lw_instant_radiosity *instant; /* for VPL */
    float mean; /* luminance of the last picture; 0: there is none, or it was black */
};

static const struct {
    const char *name, *about;
} words[] = {
#define X(tag, name, about) {name, about},
    LW_PATH_RENDERER_MAP(X)
#undef X
};

const char *lw_path_renderer_name(enum lw_path_renderer_kind kind) { return words[kind].name; }
const char *lw_path_renderer_about(enum lw_path_renderer_kind kind) { return words[kind].about; }
bool lw_path_renderer_remembers(enum lw_path_renderer_kind kind) {
    return kind >= LW_PATH_RENDERER_REPROJECTED;
}

static bool has_quarter(const struct lw_path_renderer *r) {
    return r->desc.kind == LW_PATH_RENDERER_SVGF_QUARTER;
}

static float *new_picture(uint32_t width, uint32_t height) {
    return calloc((size_t)width * height * 3, sizeof(float));
}

static enum lw_status no_memory(const struct lw_path_renderer *r, struct lw_error *err) {
    return lw_status_fail(err, LW_NO_MEMORY, "no memory for pictures of %ux%u pixels", r->desc.width,
                          r->desc.height);
}

static enum lw_status init_quarter(struct lw_path_renderer *r, struct lw_error *err) {
    struct quarter *q = &r->quarter;
    enum lw_status status = lw_gbuffer_init_thin(&q->gbuffer, &r->gbuffer, STEP, err);
    if (status != LW_OK) return status;
    const uint32_t width = q->gbuffer.width, height = q->gbuffer.height;
    status = lw_svgf_create(
        &(struct lw_svgf_desc){
            .width = width, .height = height, .threads = r->desc.threads, .reflected_alone = true},
        &q->svgf, err);
    if (status == LW_OK) status = lw_path_film_init(&q->film, width, height, err);
    if (status != LW_OK) return status;
    q->radiance = new_picture(width, height);
    q->rgb = new_picture(r->desc.width, r->desc.height);
    return q->radiance && q->rgb ? LW_OK : no_memory(r, err);
}

static void finish_quarter(struct quarter *q) {
    free(q->rgb);
    free(q->radiance);
    lw_path_film_finish(&q->film);
    lw_svgf_destroy(q->svgf);
    lw_gbuffer_finish(&q->gbuffer);
}

static enum lw_status init_memory(struct lw_path_renderer *r, struct lw_error *err) {
    const struct lw_path_renderer_desc *d = &r->desc;
    enum lw_status status = lw_path_film_init(&r->film, d->width, d->height, err);
    if (status != LW_OK) return status;
    r->rgb = new_picture(d->width, d->height);
    if (!r->rgb) return no_memory(r, err);
    if (!lw_path_renderer_remembers(d->kind)) return LW_OK;
    status = lw_gbuffer_init(&r->gbuffer,
                             &(struct lw_gbuffer_desc){.scene = d->scene,
                                                       .trace = d->trace,
                                                       .width = d->width,
                                                       .height = d->height,
                                                       .threads = d->threads},
                             err);
    if (status == LW_OK)
        status = lw_svgf_create(&(struct lw_svgf_desc){.width = d->width,
                                                       .height = d->height,
                                                       .threads = d->threads,
                                                       .time_alone = d->kind == LW_PATH_RENDERER_REPROJECTED},
                                &r->svgf, err);
    if (status == LW_OK && d->kind == LW_PATH_RENDERER_VPL)
        status = lw_instant_radiosity_create(&(struct lw_instant_radiosity_desc){.scene = d->scene,
                                                                                 .trace = d->trace,
                                                                                 .lights = d->lights,
                                                                                 .width = d->width,
                                                                                 .height = d->height,
                                                                                 .bounces = d->bounces,
                                                                                 .threads = d->threads,
                                                                                 .terms = d->vpl},
                                             &r->instant, err);
    return status == LW_OK && has_quarter(r) ? init_quarter(r, err) : status;
}

enum lw_status lw_path_renderer_create(const struct lw_path_renderer_desc *desc,
                                       struct lw_path_renderer **out_renderer, struct lw_error *err) {
    struct lw_path_renderer *r = calloc(1, sizeof *r);
    if (!r) return lw_status_fail(err, LW_NO_MEMORY, "no memory for a renderer");
    r->desc = *desc;
    enum lw_status status = init_memory(r, err);
    if (status == LW_OK)
        *out_renderer = r;
    else
        lw_path_renderer_destroy(r);
    return status;
}

void lw_path_renderer_destroy(struct lw_path_renderer *r) {
    if (!r) return;
    finish_quarter(&r->quarter);
    lw_instant_radiosity_destroy(r->instant);
    lw_svgf_destroy(r->svgf);
    lw_gbuffer_finish(&r->gbuffer);
    free(r->rgb);
    lw_path_film_finish(&r->film);
    free(r);
}

static float mean_luminance(const float *rgb, size_t pixels) {
    double sum = 0;
    for (size_t i = 0; i < pixels; i++)
        sum += (double)lw_colour_luminance(lw_vec3(rgb[3 * i], rgb[3 * i + 1], rgb[3 * i + 2]));
    return (float)(sum / (double)pixels);
}

/* The mean of a picture of few pixels; 0 without memory for it. */
static float glance(const struct lw_path_renderer *r, const struct lw_path_view *like,
                    struct lw_path_count *count) {
    struct lw_path_view view = *like;
    struct lw_path_film film;
    const uint32_t height = GLANCE_SIDE * r->desc.height / r->desc.width;
    if (lw_path_film_init(&film, GLANCE_SIDE, height ? height : 1, NULL) != LW_OK) return 0;
    lw_path_trace_render(r->desc.tracer, &view, 2, &film, count);
    lw_path_film_resolve(&film, film.half[0]);
    const float mean = mean_luminance(film.half[0], (size_t)film.width * film.height);
    lw_path_film_finish(&film);
    return mean;
}

static struct lw_path_view view_of(struct lw_path_renderer *r, const struct lw_path_frame *frame,
                                   struct lw_path_count *count) {
    const bool remembers = lw_path_renderer_remembers(r->desc.kind);
    struct lw_path_view view = {.camera = frame->camera,
                                .bounces = r->desc.bounces,
                                .pixel = LW_PATH_PIXEL_CENTRE,
                                .all_lights = r->desc.kind != LW_PATH_RENDERER_RAW};
    if (remembers) {
        /* what a filter averages, over time and neighbours, is one sample of the light */
        view.seed = frame->seed;
        view.first_sample = frame->number * frame->samples;
        view.pattern = LW_PATH_PATTERN_INTERLEAVED;
    } else {
        /* one sequence goes on while nothing moves; every other frame has its own */
        view.seed = lw_random_hash2(frame->seed, frame->still ? 0 : frame->number);
    }
    if (view.all_lights) view.clamp = CLAMP_MEANS * (r->mean > 0 ? r->mean : glance(r, &view, count));
    return view;
}

/* Traces what bounces bring to the quarter. Its pixels take turns within their squares while anything moves;
 * in a still picture a history of many frames wants them in one place. */
static void trace_quarter(struct lw_path_renderer *r, const struct lw_path_view *like, uint32_t number,
                          uint32_t samples, struct lw_path_count *count) {
    static const uint8_t x[] = {0, 1, 1, 0}, y[] = {0, 1, 0, 1}; /* neighbours in time far apart */
    struct quarter *q = &r->quarter;
    struct lw_path_view view = *like;
    if (!r->gbuffer.still) q->turn = number % 4;
    lw_gbuffer_thin(&q->gbuffer, &r->gbuffer, x[q->turn], y[q->turn]);
    view.part = LW_PATH_PART_INDIRECT;
    view.first_hits = &q->gbuffer;
    lw_path_film_clear(&q->film);
    lw_path_trace_render(r->desc.tracer, &view, samples, &q->film, count);
    lw_path_film_resolve(&q->film, q->radiance);
}

static void add(float *rgb, const float *more, size_t values) {
    for (size_t i = 0; i < values; i++) rgb[i] += more[i];
}

const float *lw_path_renderer_frame(struct lw_path_renderer *r, const struct lw_path_frame *frame,
                                    struct lw_path_frame_cost *out_cost) {
    const bool remembers = lw_path_renderer_remembers(r->desc.kind);
    const size_t pixels = (size_t)r->desc.width * r->desc.height;
    const uint64_t began_ns = lw_clock_process_cpu_ns();
    struct lw_path_count count = {.rays_primary = remembers ? pixels : 0};
    struct lw_path_view view = view_of(r, frame, &count);
    if (remembers) lw_gbuffer_render(&r->gbuffer, frame->pose, &frame->camera);
    if (has_quarter(r)) {
        trace_quarter(r, &view, frame->number, frame->samples, &count);
        view.part = LW_PATH_PART_DIRECT;
    }
    if (r->instant) {
        count.rays_bounce +=
            lw_instant_radiosity_shade(r->instant, &r->gbuffer, frame->pose, frame->seed, frame->number);
        view.part = LW_PATH_PART_DIRECT;
    }
    if (remembers) view.first_hits = &r->gbuffer;
    if (remembers || !frame->still) lw_path_film_clear(&r->film);
    lw_path_trace_render(r->desc.tracer, &view, frame->samples, &r->film, &count);
    lw_path_film_resolve(&r->film, r->rgb);
    const uint64_t traced_ns = lw_clock_process_cpu_ns();
    if (remembers) lw_svgf_filter(r->svgf, &r->gbuffer, r->rgb, r->rgb);
    if (has_quarter(r)) {
        struct quarter *q = &r->quarter;
        lw_svgf_filter_thin(q->svgf, &q->gbuffer, &r->gbuffer, q->radiance, q->rgb);
        add(r->rgb, q->rgb, 3 * pixels);
    }
    if (r->instant) lw_instant_radiosity_add(r->instant, &r->gbuffer, r->rgb);
    if (view.all_lights) r->mean = mean_luminance(r->rgb, pixels);
    if (out_cost) {
        out_cost->trace_s += 1e-9 * (double)(traced_ns - began_ns);
        out_cost->filter_s += 1e-9 * (double)(lw_clock_process_cpu_ns() - traced_ns);
        out_cost->rays += count.rays_primary + count.rays_shadow + count.rays_bounce;
    }
    return r->rgb;
}

float lw_path_renderer_near_m(const struct lw_path_renderer *r) {
    return r->instant ? lw_instant_radiosity_near_m(r->instant) : 0;
}

uint32_t lw_path_renderer_samples(const struct lw_path_renderer *r) { return r->film.samples; }
