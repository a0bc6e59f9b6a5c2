#include "client/gl/gl_view.h"

#include "client/view/compose/antialias.h"

#include <stdlib.h>
#include <string.h>

enum lw_status lw_gl_view_init(struct lw_gl_view *view, const struct lw_stage *stage, bool exact,
                               struct lw_error *err) {
    const struct lw_atlas_map *map = lw_client_atlas_map(stage->client);
    *view = (struct lw_gl_view){0};
    view->needed = calloc(map->tile_count + 1ul, sizeof *view->needed);
    view->shown = calloc(map->tile_count + 1ul, sizeof *view->shown);
    enum lw_status status = LW_OK;
    if (!view->needed || !view->shown) status = lw_status_fail(err, LW_NO_MEMORY, "no memory for the view");
    if (status == LW_OK)
        status = lw_gl_renderer_create(&(struct lw_gl_renderer_desc){.scene = stage->scene,
                                                                     .map = map,
                                                                     .exact = exact,
                                                                     .drawn = &stage->drawn,
                                                                     .trace = stage->trace,
                                                                     .pose = &stage->pose},
                                       &view->renderer, err);
    if (status != LW_OK) lw_gl_view_finish(view);
    return status;
}

void lw_gl_view_finish(struct lw_gl_view *view) {
    lw_gl_renderer_destroy(view->renderer);
    free(view->shown);
    free(view->needed);
    *view = (struct lw_gl_view){0};
}

enum lw_status lw_gl_view_take(struct lw_gl_view *view, const struct lw_stage *stage, uint32_t tiles_max,
                               uint64_t now_ns, uint32_t *out_waiting, struct lw_error *err) {
    const struct lw_compose_source source = lw_compose_source_of(stage->client);
    return lw_gl_renderer_take(view->renderer, &source, &stage->pose, tiles_max, now_ns, out_waiting, err);
}

enum lw_status lw_gl_view_survey(struct lw_gl_view *view, struct lw_stage *stage,
                                 const struct lw_compose_view *of, struct lw_compose_report *out_report,
                                 struct lw_error *err) {
    const struct lw_compose_source source = lw_compose_source_of(stage->client);
    const uint32_t tile_count = lw_client_atlas_map(stage->client)->tile_count;
    uint64_t pixel_count;
    memset(view->needed, 0, tile_count * sizeof *view->needed);
    memset(view->shown, 0, tile_count * sizeof *view->shown);
    enum lw_status status =
        lw_gl_renderer_survey(view->renderer, of, view->needed, view->shown, &pixel_count, err);
    if (status != LW_OK) return status;
    lw_compose_note(stage->compose, view->needed, view->shown, pixel_count);
    lw_compose_check(stage->compose, &source, out_report);
    return LW_OK;
}

enum lw_status lw_gl_view_average(struct lw_gl_view *view, const struct lw_compose_view *of, uint32_t samples,
                                  float *out_rgb, struct lw_error *err) {
    const size_t count = 3ul * of->width * of->height;
    float *sample = samples > 1 ? malloc(count * sizeof *sample) : out_rgb;
    if (sample == NULL) return lw_status_fail(err, LW_NO_MEMORY, "no memory for the samples of a picture");
    if (samples > 1) memset(out_rgb, 0, count * sizeof *out_rgb);
    enum lw_status status = LW_OK;
    for (uint32_t i = 0; i < samples && status == LW_OK; i++) {
        struct lw_compose_view one = *of;
        lw_antialias_offset(i, samples, &one.offset_x, &one.offset_y);
        one.sample = i;
        status = lw_gl_renderer_draw(view->renderer, &one, 1, err);
        if (status == LW_OK) status = lw_gl_renderer_read(view->renderer, sample, err);
        for (size_t k = 0; k < count && status == LW_OK && samples > 1; k++)
            out_rgb[k] += sample[k] / (float)samples;
    }
    if (samples > 1) free(sample);
    return status;
}
