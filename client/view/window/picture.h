/* picture.h: the pixels of the window: rendered small while something moves, sharpened while nothing does,
 * exposed smoothly.
 * Flow:    stage, camera -> compose -> [picture] -> RGBA for the screen
 * Threads: one thread at a time; works on several inside. */
#ifndef LW_CLIENT_VIEW_WINDOW_PICTURE_H
#define LW_CLIENT_VIEW_WINDOW_PICTURE_H

#include "client/view/compose/antialias.h"
#include "client/view/compose/stage.h"
#include "client/view/tonemap.h"

#define LW_PICTURE_SAMPLES_MAX 16u /* rays per pixel of a still picture */

struct lw_picture {
    uint32_t width_max, height_max;
    uint32_t width, height; /* the current picture's; 0: there is none */
    unsigned samples;       /* in it */
    float *sum;             /* the samples' sum */
    float *sample;
    struct lw_antialias antialias;
    unsigned edge_samples; /* more samples of the pixels at edges, in the first one */
    uint64_t edge_ns;      /* what they took in the last render */
    uint32_t *rgba;        /* bytes R, G, B, 255; width * height */
    struct lw_compose_report report;
    struct lw_tonemap tonemap;
    enum lw_show show;
    bool auto_exposure;
    float stops, stops_wanted;
    bool stops_known;
    unsigned threads; /* 0: all */
};

void lw_picture_init(struct lw_picture *picture, enum lw_tonemap_curve curve, bool auto_exposure, float stops,
                     unsigned threads);
void lw_picture_finish(struct lw_picture *picture);

/** Makes room for a window's pixels. The old picture is lost. Errors: LW_NO_MEMORY; the picture then
 * stays. */
LW_MUST_CHECK enum lw_status lw_picture_resize(struct lw_picture *picture, uint32_t width, uint32_t height,
                                               struct lw_error *err);

/** Renders one more sample of each pixel, or the first if the view, the light or the size is another.
 * fresh         something changed: start again
 * edge_time_ns about the time for more samples at the edges of the first picture; at least two samples, or
 * none */
void lw_picture_render(struct lw_picture *picture, struct lw_stage *stage,
                       const struct lw_camera_view *camera, uint32_t width, uint32_t height, bool fresh,
                       uint64_t edge_time_ns);

/** Lets the eye adapt for some seconds. Returns whether the exposure still changes visibly. */
bool lw_picture_adapt(struct lw_picture *picture, float seconds);

/** Fills rgba from the samples. */
void lw_picture_develop(struct lw_picture *picture);

#endif
