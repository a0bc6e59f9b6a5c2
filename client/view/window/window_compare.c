#include "client/view/window/window_compare.h"

#include "client/view/window/window_panels.h"

#include <stdio.h>
#include <stdlib.h>

#define TRACED_SHARE 2 /* a traced picture has one pixel for this number of them, each way */

void lw_window_compare_stop(struct lw_window *w) {
    lw_comparison_destroy(w->comparison);
    w->comparison = NULL;
    w->traced = (struct lw_comparison_picture){0};
}

enum lw_status lw_window_compare_follow(struct lw_window *w, const struct lw_camera_view *camera,
                                        struct lw_error *err) {
    if (w->compare == LW_WINDOW_COMPARE_NONE) return LW_OK;
    enum lw_status status = LW_OK;
    if (w->comparison == NULL) status = lw_comparison_create(0, &w->comparison, err);
    if (status == LW_OK)
        status = lw_comparison_follow(w->comparison, &w->stage, camera, (w->width + 1) / TRACED_SHARE,
                                      (w->height + 1) / TRACED_SHARE, w->scene_changed, err);
    if (status != LW_OK) return status;
    w->scene_changed = false;
    if (lw_comparison_take(w->comparison, &w->traced)) w->redraw = true;
    return LW_OK;
}

static bool make_room_over(struct lw_window *w) {
    const size_t count = (size_t)w->width * w->height;
    if (w->over_width == w->width && w->over_height == w->height) return true;
    free(w->over);
    free(w->light);
    w->over = malloc(count * sizeof *w->over);
    w->light = malloc(3 * count * sizeof *w->light);
    w->over_width = w->over && w->light ? w->width : 0;
    w->over_height = w->height;
    return w->over_width != 0;
}

/* Copies the window's own picture into w->light. Returns whether there is one. */
static bool take_light(struct lw_window *w, uint32_t *out_width, uint32_t *out_height) {
    const struct lw_picture *p = &w->picture;
    struct lw_error err = {0};
    *out_width = p->width, *out_height = p->height;
    if (p->width == 0 || (size_t)p->width * p->height > (size_t)w->over_width * w->over_height) return false;
    if (w->gl.renderer != NULL) return lw_gl_renderer_read(w->gl.renderer, w->light, &err) == LW_OK;
    for (size_t i = 0; i < 3ul * p->width * p->height; i++) w->light[i] = p->sum[i] / (float)p->samples;
    return true;
}

void lw_window_compare_draw(struct lw_window *w) {
    const struct lw_comparison_picture *t = &w->traced;
    char text[2][96] = {"a path tracer begins", ""};
    int lines = 1;
    uint32_t width, height;
    if (w->compare == LW_WINDOW_COMPARE_NONE) return;
    if (t->samples > 0 && make_room_over(w)) {
        char noise[32] = "";
        if (isfinite(t->error)) snprintf(noise, sizeof noise, ", noise %.1f %%", 100 * t->error);
        snprintf(text[0], sizeof text[0], "paths: %u a pixel%s", t->samples, noise);
        if (w->compare == LW_WINDOW_COMPARE_SIDE_BY_SIDE) {
            const uint32_t left = (uint32_t)lrintf(w->wipe * (float)w->width);
            lw_comparison_wipe(t, w->options->curve, w->picture.stops, w->width, w->height, left, w->over);
            if (left < w->width)
                lw_screen_draw_panel(&w->screen, w->over, (int)(w->width - left), (int)w->height, (int)left,
                                     0);
        } else if (take_light(w, &width, &height)) {
            const double off =
                lw_comparison_difference(t, w->light, width, height, w->width, w->height, w->over);
            lw_screen_draw_panel(&w->screen, w->over, (int)w->width, (int)w->height, 0, 0);
            snprintf(text[1], sizeof text[1], "differs by %.1f %%: blue 0.1, green 3, red 100 %%", 100 * off);
            lines = 2;
        }
    }
    lw_window_panels_show(w, LW_WINDOW_PANELS_RIGHT, LW_WINDOW_PANELS_INSET,
                          (const char *const[]){text[0], text[1]}, lines, -1, LW_PANEL_TEXT);
}
