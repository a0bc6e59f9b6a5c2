/* gl_view.h: the viewer's renderer: pictures of the light that a stage's client has received, and their
 * interest sets.
 * Flow:    stage -> [gl_view] -> headless and window; what the picture needs -> stage's composer -> INTEREST
 * Threads: that of the context. */
#ifndef LW_CLIENT_GL_VIEW_H
#define LW_CLIENT_GL_VIEW_H

#include "client/gl/gl_renderer.h"
#include "client/view/compose/stage.h"

struct lw_gl_view {
    struct lw_gl_renderer *renderer; /* NULL: there is none */
    uint8_t *needed;                 /* per tile, of a survey */
    uint64_t *shown;
};

/** Makes a renderer for a stage in the current context. Zeroed on failure; the stage must outlive it.
 * exact: as of lw_gl_renderer_desc. Errors: as lw_gl_renderer_create(). */
LW_MUST_CHECK enum lw_status lw_gl_view_init(struct lw_gl_view *view, const struct lw_stage *stage,
                                             bool exact, struct lw_error *err);
/** A zeroed one is fine. */
void lw_gl_view_finish(struct lw_gl_view *view);

/** Takes over what the stage has, as lw_gl_renderer_take(). */
LW_MUST_CHECK enum lw_status lw_gl_view_take(struct lw_gl_view *view, const struct lw_stage *stage,
                                             uint32_t tiles_max, uint64_t now_ns, uint32_t *out_waiting,
                                             struct lw_error *err);

/** Finds out what a view needs, for lw_stage_look(), and how well the light that has arrived serves it.
 * Errors: as lw_gl_renderer_survey(). */
LW_MUST_CHECK enum lw_status lw_gl_view_survey(struct lw_gl_view *view, struct lw_stage *stage,
                                               const struct lw_compose_view *of,
                                               struct lw_compose_report *out_report, struct lw_error *err);

/** Draws a view as the mean of `samples` pictures through the places of lw_antialias_offset().
 * out_rgb   width * height * 3 floats, as of lw_compose_render()
 * Errors: as lw_gl_renderer_draw(). */
LW_MUST_CHECK enum lw_status lw_gl_view_average(struct lw_gl_view *view, const struct lw_compose_view *of,
                                                uint32_t samples, float *out_rgb, struct lw_error *err);

#endif
