#include "client/view/window/picture.h"

#include "common/base/clock.h"

#include <omp.h>
#include <stdlib.h>
#include <string.h>

#define ADAPTATION_S   0.4f
#define SETTLED_STOPS  0.02f
#define METERED_PIXELS 40000u /* enough for a log average */
#define ROWS_PER_CHUNK 16u

void lw_picture_init(struct lw_picture *picture, enum lw_tonemap_curve curve, bool auto_exposure, float stops,
                     unsigned threads) {
    *picture = (struct lw_picture){.auto_exposure = auto_exposure,
                                   .stops = stops,
                                   .stops_wanted = stops,
                                   .stops_known = !auto_exposure,
                                   .threads = threads ? threads : (unsigned)omp_get_max_threads()};
    lw_tonemap_init(&picture->tonemap, curve, stops);
}

void lw_picture_finish(struct lw_picture *picture) {
    lw_antialias_finish(&picture->antialias);
    free(picture->rgba);
    free(picture->sample);
    free(picture->sum);
}

enum lw_status lw_picture_resize(struct lw_picture *picture, uint32_t width, uint32_t height,
                                 struct lw_error *err) {
    size_t count = (size_t)width * height;
    float *sum = malloc(count * 3 * sizeof *sum);
    float *sample = malloc(count * 3 * sizeof *sample);
    uint32_t *rgba = malloc(count * sizeof *rgba);
    struct lw_antialias antialias = {0};
    if (sum == NULL || sample == NULL || rgba == NULL ||
        lw_antialias_reserve(&antialias, count, err) != LW_OK) {
        free(rgba);
        free(sample);
        free(sum);
        return lw_status_fail(err, LW_NO_MEMORY, "no memory for a window of %ux%u pixels", width, height);
    }
    lw_picture_finish(picture);
    picture->antialias = antialias;
    picture->sum = sum;
    picture->sample = sample;
    picture->rgba = rgba;
    picture->width_max = width;
    picture->height_max = height;
    picture->width = picture->height = picture->samples = 0;
    return LW_OK;
}

/* The R2 sequence (Roberts 2018), starting at the pixel's centre. */
static float sample_offset(unsigned index, float step) {
    float x = 0.5f + step * (float)index;
    return x - floorf(x) - 0.5f;
}

static void meter(struct lw_picture *picture) {
    size_t count = (size_t)picture->width * picture->height, metered = 0;
    size_t step = count / METERED_PIXELS + 1;
    step += step % 2 == 0 && step > 1;                  /* odd: does not walk down one column */
    for (size_t i = 0; i < count; i += step, metered++) /* `sample` is free until the next render */
        memcpy(picture->sample + 3 * metered, picture->sum + 3 * i, 3 * sizeof *picture->sum);
    picture->stops_wanted = lw_tonemap_auto_stops(picture->sample, metered);
    if (!picture->stops_known) picture->stops = picture->stops_wanted;
    picture->stops_known = true;
}

/* More samples where the first one has edges, as many as there is time for. */
static void refine_edges(struct lw_picture *picture, struct lw_stage *stage,
                         const struct lw_compose_view *view, uint64_t sample_ns, uint64_t time_ns) {
    const uint64_t start_ns = lw_clock_ns();
    struct lw_antialias *a = &picture->antialias;
    lw_antialias_find(a, picture->sum, view->width, view->height, picture->threads);
    const uint64_t found_ns = lw_clock_ns();
    const double edge_ns = LW_ANTIALIAS_EDGE_COST * (double)sample_ns * (double)a->edge_count /
                           ((double)view->width * view->height),
                 left_ns = (double)time_ns - (double)(found_ns - start_ns);
    unsigned samples = 0;
    while (samples < LW_ANTIALIAS_EDGE_SAMPLES && edge_ns * (samples + 1) <= left_ns) samples++;
    if (samples < 2) samples = 0; /* one more is no better than the first */
    lw_antialias_refine(a, stage->compose, view, samples, picture->sum);
    picture->edge_samples = samples;
    picture->edge_ns = lw_clock_ns() - start_ns;
}

void lw_picture_render(struct lw_picture *picture, struct lw_stage *stage,
                       const struct lw_camera_view *camera, uint32_t width, uint32_t height, bool fresh,
                       uint64_t edge_time_ns) {
    struct lw_compose_source source = lw_compose_source_of(stage->client);
    if (fresh || width != picture->width || height != picture->height) picture->samples = 0;
    picture->width = width;
    picture->height = height;
    struct lw_compose_view view = {.camera = *camera,
                                   .width = width,
                                   .height = height,
                                   .sample = picture->samples,
                                   .offset_x = sample_offset(picture->samples, 0.75487767f),
                                   .offset_y = sample_offset(picture->samples, 0.56984029f)};
    struct lw_error err = {0};
    if (lw_stage_show(stage, picture->show, &view, &err) != LW_OK) view.show = LW_SHOW_ALL; /* no memory */
    size_t count = (size_t)width * height * 3;
    float *target = picture->samples == 0 ? picture->sum : picture->sample;
    struct lw_compose_report report;
    const uint64_t start_ns = lw_clock_ns();
    lw_compose_render(stage->compose, &source, &stage->pose, &view, target, &report);
    picture->edge_ns = 0;
    if (picture->samples == 0) {
        picture->report = report;
        picture->edge_samples = 0;
        if (edge_time_ns > 0) refine_edges(picture, stage, &view, lw_clock_ns() - start_ns, edge_time_ns);
        if (picture->auto_exposure && !lw_show_is_chart(picture->show)) meter(picture);
    } else {
        for (size_t i = 0; i < count; i++) picture->sum[i] += picture->sample[i];
    }
    picture->samples++;
}

bool lw_picture_adapt(struct lw_picture *picture, float seconds) {
    float way = picture->stops_wanted - picture->stops;
    if (fabsf(way) < SETTLED_STOPS) return false;
    picture->stops += way * (1.0f - expf(-seconds / ADAPTATION_S));
    return true;
}

void lw_picture_develop(struct lw_picture *picture) {
    if (picture->samples == 0) return;
    struct lw_tonemap tonemap = picture->tonemap;
    const bool chart = lw_show_is_chart(picture->show);
    if (chart) tonemap.curve = LW_TONEMAP_NONE;
    lw_tonemap_set_stops(&tonemap, (chart ? 0 : picture->stops) - log2f((float)picture->samples));
    uint32_t chunks = (picture->height + ROWS_PER_CHUNK - 1) / ROWS_PER_CHUNK;
#pragma omp parallel for schedule(dynamic) num_threads(picture->threads)
    for (uint32_t chunk = 0; chunk < chunks; chunk++) {
        uint32_t first = chunk * ROWS_PER_CHUNK, last = first + ROWS_PER_CHUNK;
        if (last > picture->height) last = picture->height;
        size_t at = (size_t)first * picture->width;
        lw_tonemap_encode(&tonemap, picture->sum + 3 * at, (size_t)(last - first) * picture->width, 4,
                          (uint8_t *)(picture->rgba + at));
    }
}
