#include "client/view/compose/antialias.h"

#include <math.h>
#include <omp.h>
#include <stdlib.h>
#include <string.h>

#define BLOCK 4u /* pixels: the edges are listed block by block, so that packets of them stay together */

/* Neighbours contrast if they differ by more than this share of their sum, */
#define CONTRAST 0.2f
/* to which this share of the picture's mean is added: dark pixels are hardly seen. */
#define DARK_SHARE 0.05f

enum lw_status lw_antialias_reserve(struct lw_antialias *a, size_t pixel_count, struct lw_error *err) {
    if (pixel_count <= a->capacity) return LW_OK;
    float *sample = malloc(pixel_count * 3 * sizeof *sample);
    uint32_t *edge = malloc(pixel_count * sizeof *edge);
    /* a picture has no more bands of rows than pixels, and one of a single column has as many as rows /
     * BLOCK */
    uint32_t *row_edge = malloc((pixel_count / BLOCK + 2) * sizeof *row_edge);
    if (sample == NULL || edge == NULL || row_edge == NULL) {
        free(row_edge);
        free(edge);
        free(sample);
        return lw_status_fail(err, LW_NO_MEMORY, "no memory for more samples of %zu pixels", pixel_count);
    }
    lw_antialias_finish(a);
    *a = (struct lw_antialias){.capacity = pixel_count, .sample = sample, .edge = edge, .row_edge = row_edge};
    return LW_OK;
}

void lw_antialias_finish(struct lw_antialias *a) {
    free(a->row_edge);
    free(a->edge);
    free(a->sample);
    *a = (struct lw_antialias){0};
}

/* The radical inverse in base 2. */
static float inverse(uint32_t index) {
    index = index << 16 | index >> 16;
    index = (index & 0x00ff00ffu) << 8 | (index & 0xff00ff00u) >> 8;
    index = (index & 0x0f0f0f0fu) << 4 | (index & 0xf0f0f0f0u) >> 4;
    index = (index & 0x33333333u) << 2 | (index & 0xccccccccu) >> 2;
    index = (index & 0x55555555u) << 1 | (index & 0xaaaaaaaau) >> 1;
    return (float)(index >> 8) * 0x1p-24f;
}

void lw_antialias_offset(uint32_t index, uint32_t count, float *out_x, float *out_y) {
    /* The inverses of 0 to count - 1 have a mean below 1/2: all are moved by the difference. */
    double mean = 0;
    for (uint32_t i = 0; i < count; i++) mean += (double)inverse(i);
    *out_x = ((float)index + 0.5f) / (float)count - 0.5f;
    *out_y = inverse(index) - (float)(mean / count);
}

void lw_antialias_render(struct lw_antialias *a, struct lw_compose *compose,
                         const struct lw_compose_source *source, const struct lw_pose *pose,
                         const struct lw_compose_view *view, uint32_t samples, float *out_rgb,
                         struct lw_compose_report *out_report) {
    const size_t floats = (size_t)view->width * view->height * 3;
    const float scale = 1.0f / (float)samples;
    for (uint32_t k = 0; k < samples; k++) {
        struct lw_compose_view one = *view;
        struct lw_compose_report report;
        lw_antialias_offset(k, samples, &one.offset_x, &one.offset_y);
        one.sample = view->sample + k;
        one.samples = samples;
        float *rgb = k == 0 ? out_rgb : a->sample;
        lw_compose_render(compose, source, pose, &one, rgb, &report);
        if (k == 0)
            *out_report = report;
        else
            for (size_t i = 0; i < floats; i++) out_rgb[i] += rgb[i];
    }
    if (samples > 1)
        for (size_t i = 0; i < floats; i++) out_rgb[i] *= scale;
}

static bool contrast(const float *p, const float *q, float dark) {
    bool found = false;
    for (int c = 0; c < 3; c++) found |= fabsf(p[c] - q[c]) > CONTRAST * (p[c] + q[c] + dark);
    return found;
}

static bool is_edge(const float *rgb, uint32_t width, uint32_t height, uint32_t x, uint32_t y, float dark) {
    const float *p = rgb + 3 * ((size_t)y * width + x);
    const size_t row = 3 * (size_t)width;
    return (x > 0 && contrast(p, p - 3, dark)) || (x + 1 < width && contrast(p, p + 3, dark)) ||
           (y > 0 && contrast(p, p - row, dark)) || (y + 1 < height && contrast(p, p + row, dark));
}

/* Lists the edges of one band of rows. */
static uint32_t find_in_band(const float *rgb, uint32_t width, uint32_t height, uint32_t top, float dark,
                             uint32_t *out) {
    uint32_t count = 0;
    for (uint32_t left = 0; left < width; left += BLOCK)
        for (uint32_t y = top; y < top + BLOCK && y < height; y++)
            for (uint32_t x = left; x < left + BLOCK && x < width; x++)
                if (is_edge(rgb, width, height, x, y, dark)) out[count++] = y * width + x;
    return count;
}

void lw_antialias_find(struct lw_antialias *a, const float *rgb, uint32_t width, uint32_t height,
                       unsigned threads) {
    const uint32_t bands = (height + BLOCK - 1) / BLOCK;
    const size_t floats = (size_t)width * height * 3;
    const int workers = threads ? (int)threads : omp_get_max_threads();
    double sum = 0;
    for (size_t i = 0; i < floats; i++) sum += (double)rgb[i];
    const float dark = 2 * DARK_SHARE * (float)(sum / (double)floats);
#pragma omp parallel for schedule(dynamic, 4) num_threads(workers)
    for (uint32_t band = 0; band < bands; band++)
        a->row_edge[band] =
            find_in_band(rgb, width, height, band * BLOCK, dark, a->edge + (size_t)band * BLOCK * width);
    a->edge_count = 0;
    for (uint32_t band = 0; band < bands; band++) {
        memmove(a->edge + a->edge_count, a->edge + (size_t)band * BLOCK * width,
                a->row_edge[band] * sizeof *a->edge);
        a->edge_count += a->row_edge[band];
    }
}

void lw_antialias_refine(struct lw_antialias *a, struct lw_compose *compose,
                         const struct lw_compose_view *view, uint32_t samples, float *rgb) {
    const float scale = 1.0f / (float)(samples + 1);
    for (uint32_t k = 0; k < samples; k++) {
        struct lw_compose_view one = *view;
        lw_antialias_offset(k, samples, &one.offset_x, &one.offset_y);
        one.sample = view->sample + 1 + k;
        one.samples = samples + 1;
        lw_compose_render_more(compose, &one, a->edge, a->edge_count, a->sample);
        const float factor = k + 1 == samples ? scale : 1;
        for (size_t i = 0; i < a->edge_count; i++)
            for (size_t c = 0; c < 3; c++) {
                float *at = &rgb[3 * (size_t)a->edge[i] + c];
                *at = (*at + a->sample[3 * i + c]) * factor;
            }
    }
}

void lw_antialias_render_edges(struct lw_antialias *a, struct lw_compose *compose,
                               const struct lw_compose_source *source, const struct lw_pose *pose,
                               const struct lw_compose_view *view, uint32_t samples, unsigned threads,
                               float *out_rgb, struct lw_compose_report *out_report) {
    struct lw_compose_view centres = *view;
    centres.offset_x = centres.offset_y = 0;
    lw_compose_render(compose, source, pose, &centres, out_rgb, out_report);
    lw_antialias_find(a, out_rgb, view->width, view->height, threads);
    lw_antialias_refine(a, compose, &centres, samples, out_rgb);
}
