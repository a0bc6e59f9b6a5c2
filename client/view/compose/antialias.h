/* antialias.h: averages several samples over each pixel's square, for all pixels or at edges alone.
 * Flow:    compose -> [antialias] -> linear radiance, box-filtered
 * Threads: one thread at a time per lw_antialias; works on several inside. Same inputs, same bytes, at any
 * number.
 * After:   Whitted 1980 and Mitchell 1987 (more samples where neighbours contrast); Wong et al. 1997
 *          (Hammersley points). */
#ifndef LW_CLIENT_VIEW_COMPOSE_ANTIALIAS_H
#define LW_CLIENT_VIEW_COMPOSE_ANTIALIAS_H

#include "client/view/compose/compose.h"

#define LW_ANTIALIAS_SAMPLES_MAX 1024u

/* Default number of samples of a pixel at an edge, beside the one through its centre. Where surfaces have
 * textures, more samples are cheaper if all pixels have them (docs/lab/look.md). */
#define LW_ANTIALIAS_EDGE_SAMPLES 4u
/* About how many times a sample of a whole picture's pixels one at an edge costs: its packets meet more
 * triangles. */
#define LW_ANTIALIAS_EDGE_COST 2.5

/** Memory for pictures of one size, kept from one to the next. */
struct lw_antialias {
    size_t capacity;    /* pixels */
    float *sample;      /* each pixel's, or each edge pixel's */
    uint32_t *edge;     /* indices of the edge pixels */
    size_t edge_count;  /* in the last picture; those that contrast with a neighbour */
    uint32_t *row_edge; /* how many there are in each band of rows */
};

/** Room for pictures of up to pixel_count pixels. A zeroed antialias has none. Errors: LW_NO_MEMORY; the
 * memory then stays as it was. */
LW_MUST_CHECK enum lw_status lw_antialias_reserve(struct lw_antialias *antialias, size_t pixel_count,
                                                  struct lw_error *err);
/** A zeroed one is fine. */
void lw_antialias_finish(struct lw_antialias *antialias);

/** Place of sample `index` of `count` in its pixel, from the centre; pixels, within +-1/2. Their mean is
 * the centre, to 1/2^24; one alone is the centre itself. */
void lw_antialias_offset(uint32_t index, uint32_t count, float *out_x, float *out_y);

/** Renders a view as the mean of `samples` samples of every pixel.
 *
 * view        its offset is not read
 * samples     from 1 on; 1: lw_compose_render()
 * out_rgb     width * height * 3 floats, as of lw_compose_render()
 * out_report  of the first sample */
void lw_antialias_render(struct lw_antialias *antialias, struct lw_compose *compose,
                         const struct lw_compose_source *source, const struct lw_pose *pose,
                         const struct lw_compose_view *view, uint32_t samples, float *out_rgb,
                         struct lw_compose_report *out_report);

/** Finds the pixels of a picture that contrast with one of their four neighbours: antialias->edge,
 * edge_count. Room for the picture must be there. */
void lw_antialias_find(struct lw_antialias *antialias, const float *rgb, uint32_t width, uint32_t height,
                       unsigned threads);

/** Takes more samples of the pixels that lw_antialias_find() has found, right after lw_compose_render() has
 * rendered the view through the pixels' centres; each becomes the mean of all its samples.
 *
 * samples   beside the one in rgb; 0: rgb stays */
void lw_antialias_refine(struct lw_antialias *antialias, struct lw_compose *compose,
                         const struct lw_compose_view *view, uint32_t samples, float *rgb);

/** Renders a view through the centres of its pixels, then finds the edges and refines them.
 *
 * samples   of pixels at edges, beside the centre's
 * threads   for the search; 0: all */
void lw_antialias_render_edges(struct lw_antialias *antialias, struct lw_compose *compose,
                               const struct lw_compose_source *source, const struct lw_pose *pose,
                               const struct lw_compose_view *view, uint32_t samples, unsigned threads,
                               float *out_rgb, struct lw_compose_report *out_report);

#endif
