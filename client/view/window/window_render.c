#include "client/view/window/window_render.h"

#include "client/view/window/saved_picture.h"
#include "client/view/window/window_panels.h"

#include <stdlib.h>

#define REST_AFTER_NS   200000000u /* without motion: then the picture sharpens */
#define SURVEY_EVERY_NS 250000000u
#define MSAA            4u
#define SAVED_SAMPLES   16u /* per pixel of a saved picture */
/* Tiles that OpenGL takes over for a picture: with the work of a poll that is under 4 ms (bench_take). */
#define TILES_A_PICTURE 32u

/* Updates the interest set, the report and the exposure, four times a second. */
static enum lw_status survey(struct lw_window *w, const struct lw_compose_view *view, struct lw_error *err) {
    const uint64_t now_ns = lw_clock_ns();
    w->unsurveyed = now_ns - w->surveyed_ns < SURVEY_EVERY_NS;
    if (w->unsurveyed) return LW_OK;
    w->surveyed_ns = now_ns;
    enum lw_status status = lw_gl_view_survey(&w->gl, &w->stage, view, &w->picture.report, err);
    if (status != LW_OK || !w->picture.auto_exposure) return status;
    if (lw_show_is_chart(w->picture.show)) return LW_OK;
    status = lw_gl_renderer_meter(w->gl.renderer, &w->picture.stops_wanted, err);
    if (!w->picture.stops_known) w->picture.stops = w->picture.stops_wanted;
    w->picture.stops_known = status == LW_OK;
    return status;
}

static enum lw_tonemap_curve curve_of(const struct lw_window *w) {
    return lw_show_is_chart(w->picture.show) ? LW_TONEMAP_NONE : w->options->curve;
}

static float stops_of(const struct lw_window *w) {
    return lw_show_is_chart(w->picture.show) ? 0 : w->picture.stops;
}

void lw_window_render_show_gl(struct lw_window *w) {
    lw_gl_renderer_show(w->gl.renderer, 0, curve_of(w), stops_of(w), w->width, w->height);
}

enum lw_status lw_window_render_gl(struct lw_window *w, float seconds, bool *out_busy, struct lw_error *err) {
    const uint64_t start_ns = lw_clock_ns();
    const bool at_rest = start_ns - w->moved_ns > REST_AFTER_NS;
    struct lw_picture *p = &w->picture;
    uint32_t width = w->width, height = w->height;
    if (!at_rest) lw_pace_size(&w->pace, w->width, w->height, &width, &height);
    const unsigned samples = width == w->width ? MSAA : 1;
    const bool render = w->stale || w->waiting > 0 || p->width != width || p->height != height ||
                        (w->unsurveyed && start_ns - w->surveyed_ns >= SURVEY_EVERY_NS);
    struct lw_compose_view view = {
        .camera = lw_flight_view(&w->steering.flight), .width = width, .height = height};
    enum lw_status status = LW_OK;
    if (render) {
        status = lw_stage_show(&w->stage, w->picture.show, &view, err);
        if (status == LW_OK)
            status = lw_gl_view_take(&w->gl, &w->stage, TILES_A_PICTURE, start_ns, &w->waiting, err);
        if (status == LW_OK) status = lw_gl_renderer_draw(w->gl.renderer, &view, samples, err);
        if (status == LW_OK) status = survey(w, &view, err);
        if (status != LW_OK) return status;
        w->stale = false;
        w->figures.pictures++;
        w->pictures++;
        p->width = width, p->height = height, p->samples = samples;
    }
    *out_busy = lw_picture_adapt(p, seconds) || render;
    if (!*out_busy) return LW_OK;
    lw_window_render_show_gl(w);
    glFinish(); /* else its cost is not known */
    if (render && samples == 1) lw_pace_note(&w->pace, (uint64_t)width * height, lw_clock_ns() - start_ns);
    if (render && samples > 1) /* without a GPU it costs two or three times as much */
        lw_pace_note(&w->pace, (uint64_t)width * height, (lw_clock_ns() - start_ns) / 2);
    return LW_OK;
}

bool lw_window_render_cpu(struct lw_window *w, float seconds) {
    uint64_t start_ns = lw_clock_ns();
    bool at_rest = start_ns - w->moved_ns > REST_AFTER_NS;
    uint32_t width = w->width, height = w->height;
    if (!at_rest) lw_pace_size(&w->pace, w->width, w->height, &width, &height);
    bool sharpen = w->picture.width != width || w->picture.height != height ||
                   (at_rest && w->picture.samples < LW_PICTURE_SAMPLES_MAX);
    bool render = w->stale || sharpen;
    if (render) {
        struct lw_camera_view camera = lw_flight_view(&w->steering.flight);
        /* at rest all pixels have more samples soon */
        const bool whole = width == w->width && height == w->height;
        const uint64_t edge_time_ns =
            !at_rest && whole ? lw_pace_spare_ns(&w->pace, (uint64_t)width * height) : 0;
        lw_picture_render(&w->picture, &w->stage, &camera, width, height, w->stale, edge_time_ns);
        w->stale = false;
        w->figures.pictures++;
        w->pictures++;
    }
    if (!lw_picture_adapt(&w->picture, seconds) && !render) return false;
    lw_picture_develop(&w->picture);
    lw_screen_take(&w->screen, w->picture.rgba, w->picture.width, w->picture.height);
    if (render) /* edges take the remaining time: they do not count */
        lw_pace_note(&w->pace, (uint64_t)width * height, lw_clock_ns() - start_ns - w->picture.edge_ns);
    return true;
}

/* Renders the current view at the window's size with all its samples. */
static enum lw_status render_whole(struct lw_window *w, float *rgb, struct lw_error *err) {
    struct lw_compose_view view = {
        .camera = lw_flight_view(&w->steering.flight), .width = w->width, .height = w->height};
    enum lw_status status = lw_stage_show(&w->stage, w->picture.show, &view, err);
    if (status != LW_OK) return status;
    if (w->gl.renderer != NULL) return lw_gl_view_average(&w->gl, &view, SAVED_SAMPLES, rgb, err);
    struct lw_antialias antialias = {0};
    status = lw_antialias_reserve(&antialias, (size_t)w->width * w->height, err);
    if (status != LW_OK) return status;
    const struct lw_compose_source source = lw_compose_source_of(w->stage.client);
    struct lw_compose_report report;
    lw_antialias_render(&antialias, w->stage.compose, &source, &w->stage.pose, &view, SAVED_SAMPLES, rgb,
                        &report);
    lw_antialias_finish(&antialias);
    return LW_OK;
}

enum lw_status lw_window_render_save(struct lw_window *w, struct lw_error *err) {
    char name[LW_SAVED_PICTURE_NAME_SIZE];
    float *rgb = malloc(sizeof *rgb * 3 * w->width * w->height);
    if (rgb == NULL) return lw_status_fail(err, LW_NO_MEMORY, "no memory for the picture");
    enum lw_status status = render_whole(w, rgb, err);
    if (status == LW_OK)
        status = lw_saved_picture_write(rgb, w->width, w->height, curve_of(w), stops_of(w), name, err);
    free(rgb);
    if (status == LW_OK) lw_window_panels_notify(w, "saved %s.png and .exr", name);
    w->stale = true; /* the renderer holds another picture now */
    return status;
}
