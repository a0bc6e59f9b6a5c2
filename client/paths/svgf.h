/* svgf.h: takes the noise out of a path tracer's pictures as they come: over time, then over the picture.
 * Flow:    gbuffer, radiance of a few samples per pixel -> [svgf] -> radiance
 * Threads: one thread at a time per lw_svgf; works on several inside. Same inputs, same bytes, at any number.
 * After:   Schied et al. 2017 (spatiotemporal variance-guided filtering); Dammertz et al. 2010 (edge-avoiding
 *          a-trous).
 *
 * Light without noise passes unchanged. With a short history, light counts as noise, so that fresh shadow
 * edges are soft for some frames. While camera, objects and lights are still, the picture converges to the
 * mean of the samples; else a history counts as 32 frames at most. Samples should be of LW_PATH_PIXEL_CENTRE,
 * LW_PATH_PATTERN_INTERLEAVED, one seed, and first_sample = frame * samples. Each frame:
 *
 *     lw_path_trace_render(tracer, &view, samples, &film, NULL), then lw_path_film_resolve()
 *     lw_gbuffer_render(&gbuffer, pose, &view.camera);
 *     lw_svgf_filter(svgf, &gbuffer, radiance, out_rgb); */
#ifndef LW_CLIENT_PATHS_SVGF_H
#define LW_CLIENT_PATHS_SVGF_H

#include "client/paths/gbuffer.h"

struct lw_svgf_desc {
    uint32_t width, height; /* pixels */
    unsigned threads;       /* 0: all */
    bool time_alone;        /* histories are re-projected and averaged; the picture is not filtered */
    bool reflected_alone;   /* radiance, in and out, is without what surfaces emit */
};

struct lw_svgf;

/** Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_svgf_create(const struct lw_svgf_desc *desc, struct lw_svgf **out_svgf,
                                            struct lw_error *err);
void lw_svgf_destroy(struct lw_svgf *svgf);

/** Forgets all frames: the next one is the first. */
void lw_svgf_reset(struct lw_svgf *svgf);

/** Filters one frame. The history of the previous frame is looked up by gbuffer->plane.before and that
 * frame's camera.
 *
 * gbuffer   of this frame, of the same size
 * radiance  width * height * 3 floats, W/(m^2 sr), of paths through the centres of pixels; values that
 *           are not finite count as black
 * out_rgb   as many floats, finite and not negative; may be `radiance`
 * Cost      no allocation */
void lw_svgf_filter(struct lw_svgf *svgf, const struct lw_gbuffer *gbuffer, const float *radiance,
                    float *out_rgb);

/** Filters every step-th pixel of a picture and brings the light to all of them: each takes it from the four
 * nearest, as far as they lie on its surface, and has its own albedo and emission.
 *
 * thin      of this frame, of the filter's size: what lw_gbuffer_thin() took from `full`
 * radiance  of thin's pixels
 * out_rgb   full->width * full->height * 3 floats */
void lw_svgf_filter_thin(struct lw_svgf *svgf, const struct lw_gbuffer *thin, const struct lw_gbuffer *full,
                         const float *radiance, float *out_rgb);

#endif
