#include "client/paths/svgf.h"

#include "client/paths/reprojection.h"
#include "common/base/colour.h"
#include "common/base/wide.h"

#include <omp.h>
#include <stdlib.h>
#include <string.h>

/* Frames that a pixel's history counts as, at most: while anything changes, and while nothing does. */
#define HISTORY_MAX       32.0f
#define HISTORY_STILL_MAX 4096.0f
/* Histories shorter than this know their variance from the pixels around them; the first few frames overrate
 * it. */
#define HISTORY_SHORT      8.0f
#define HISTORY_VERY_SHORT 4.0f

/* Passes of 3 x 3 taps: they reach 31 pixels. Taps of 5 x 5 cost nearly three times as much and came out 5 %
 * worse. */
#define LEVELS       5u
#define SIGMA_LIGHT  3.0f   /* standard errors of luminance */
#define SIGMA_PLANE  1.0f   /* pixels' breadth off the tangent plane */
#define NORMAL_POWER 128.0f /* power of the cosine between normals */
#define ALBEDO_MIN   1e-3f  /* least albedo of a channel that tells light from reflection */

/* A history is shortened where the mean of the last few frames has left that of all of them, in standard
 * errors of the difference over 5 x 5 pixels, SPREAD_STEP apart: from the first on a little, from the second
 * on to the least. */
#define QUICK_MAX     4.0f /* frames of that mean */
#define SURPRISE_MIN  1.5f
#define SURPRISE_MAX  4.0f
#define HISTORY_LEAST 0.5f
#define SPREAD_RADIUS 4 /* pixels */
#define SPREAD_STEP   2

/* Differences of luminance that count as none, absolute and relative; weights below the smallest are none. */
#define ROUNDING_MIN   1e-6f
#define ROUNDING_SHARE 1e-4f
#define WEIGHT_MIN     1e-30f

#define STRANGE_WEIGHT 1e-4f /* weight of light of another surface, for a pixel that has no better */

#define CHUNK 256u /* pixels of a row whose sums stay in the first-level cache */

/* History of a pixel for the next frame. One cache line: it is read by where things were, not in order. */
struct past {
    _Alignas(64) float light[3];
    float moment[2]; /* means of luminance and of its square */
    float count;     /* frames behind those means; 0: none */
    struct lw_reprojection_surface at;
    float quick; /* mean of luminance over the last few frames */
    float unused;
};
_Static_assert(sizeof(struct past) == 64, "a cache line");

/* Light: radiance without emission and albedo, that is E/pi, and the variance of its luminance. */
struct light {
    float *rgb[3], *variance;
};

struct lw_svgf {
    uint32_t width, height;
    int threads;
    unsigned levels; /* passes over the picture */
    float emission;  /* whether it counts: 1 or 0 */
    bool started;
    struct lw_reprojection before; /* the frame before */
    struct past *past, *next;
    struct light light[2];
    float *count;
    float *memory;
};

enum lw_status lw_svgf_create(const struct lw_svgf_desc *desc, struct lw_svgf **out_svgf,
                              struct lw_error *err) {
    const size_t pixels = (size_t)desc->width * desc->height;
    struct lw_svgf *svgf = calloc(1, sizeof *svgf);
    if (svgf == NULL) goto fail;
    svgf->width = desc->width;
    svgf->height = desc->height;
    svgf->threads = desc->threads ? (int)desc->threads : omp_get_max_threads();
    svgf->levels = desc->time_alone ? 0 : LEVELS;
    svgf->emission = desc->reflected_alone ? 0 : 1;
    svgf->past = aligned_alloc(64, (pixels + 1) * sizeof *svgf->past);
    svgf->next = aligned_alloc(64, (pixels + 1) * sizeof *svgf->next);
    svgf->memory = calloc(9 * pixels + 1, sizeof *svgf->memory);
    if (!svgf->past || !svgf->next || !svgf->memory) goto fail;
    float *at = svgf->memory;
    for (int l = 0; l < 2; l++) {
        for (int c = 0; c < 3; c++, at += pixels) svgf->light[l].rgb[c] = at;
        svgf->light[l].variance = at, at += pixels;
    }
    svgf->count = at;
    *out_svgf = svgf;
    return LW_OK;
fail:
    lw_svgf_destroy(svgf);
    return lw_status_fail(err, LW_NO_MEMORY, "no memory to denoise pictures of %ux%u pixels", desc->width,
                          desc->height);
}

void lw_svgf_destroy(struct lw_svgf *svgf) {
    if (svgf == NULL) return;
    free(svgf->memory);
    free(svgf->next);
    free(svgf->past);
    free(svgf);
}

void lw_svgf_reset(struct lw_svgf *svgf) { svgf->started = false; }

/* One frame, as its rows see it. */
struct job {
    struct lw_svgf *svgf;
    const struct lw_gbuffer *gbuffer;
    const float *radiance;
    struct lw_reprojection before; /* the frame before */
};

static float luminance_of(const float rgb[3]) { return lw_colour_luminance(lw_vec3(rgb[0], rgb[1], rgb[2])); }

/* ---- over time ---- */

/* Irradiance at a pixel's surface: its radiance over its albedo. A channel that reflects nothing knows
 * nothing: it is taken to be as bright as the others. Black in all channels: false. */
static bool divide(const struct job *job, size_t at, float out[3]) {
    const struct lw_gbuffer_planes *g = &job->gbuffer->plane;
    float sum = 0, known = 0;
    for (int c = 0; c < 3; c++) {
        const float albedo = g->albedo[c][at];
        const float reflected = job->radiance[3 * at + (size_t)c] - job->svgf->emission * g->emission[c][at];
        out[c] = albedo >= ALBEDO_MIN ? reflected / albedo : 0;
        if (!isfinite(out[c])) out[c] = 0;
        if (albedo >= ALBEDO_MIN) sum += out[c], known += 1;
    }
    if (!(known > 0)) return false;
    for (int c = 0; c < 3; c++)
        if (!(g->albedo[c][at] >= ALBEDO_MIN)) out[c] = sum / known;
    return true;
}

static bool serves(const struct past *past, float dx, float dy, float depth, uint32_t object,
                   struct lw_vec3 normal) {
    return past->count > 0 && lw_reprojection_serves(&past->at, dx, dy, depth, object, normal);
}

static void add_past(struct past *sum, const struct past *past, float weight) {
    for (int c = 0; c < 3; c++) sum->light[c] += weight * past->light[c];
    for (int m = 0; m < 2; m++) sum->moment[m] += weight * past->moment[m];
    sum->quick += weight * past->quick;
    sum->count += weight * past->count;
}

/* Reads the history of a pixel into the first fields of `out`; its count is 0 where there is none. */
static void read_past(const struct job *job, size_t at, struct past *out) {
    const struct lw_svgf *svgf = job->svgf;
    const struct lw_gbuffer_planes *g = &job->gbuffer->plane;
    float x, y, depth, weights = 0;
    *out = (struct past){0};
    if (!svgf->started ||
        !lw_reprojection_find(&job->before, lw_gbuffer_load3(g->before, at), &x, &y, &depth))
        return;
    const struct lw_vec3 normal = lw_gbuffer_load3(g->normal, at);
    const int left = (int)floorf(x), top = (int)floorf(y);
    const float fx = x - (float)left, fy = y - (float)top;
    for (int i = 0; i < 4; i++) {
        const int px = left + (i & 1), py = top + (i >> 1);
        const float weight = ((i & 1) ? fx : 1 - fx) * ((i >> 1) ? fy : 1 - fy);
        if (px < 0 || py < 0 || px >= (int)svgf->width || py >= (int)svgf->height || !(weight > 1e-3f))
            continue;
        const struct past *past = &svgf->past[(size_t)py * svgf->width + (size_t)px];
        if (!serves(past, x - (float)px, y - (float)py, depth, g->object[at], normal)) continue;
        add_past(out, past, weight);
        weights += weight;
    }
    if (weights > 0.01f) {
        const float scale = 1 / weights;
        for (int c = 0; c < 3; c++) out->light[c] *= scale;
        for (int m = 0; m < 2; m++) out->moment[m] *= scale;
        out->quick *= scale;
        out->count *= scale;
    } else {
        *out = (struct past){0};
    }
}

static void accumulate_row(const struct job *job, uint32_t y) {
    struct lw_svgf *svgf = job->svgf;
    const struct lw_gbuffer_planes *g = &job->gbuffer->plane;
    const struct light *light = &svgf->light[0];
    const float longest = job->gbuffer->still ? HISTORY_STILL_MAX : HISTORY_MAX;
    for (uint32_t x = 0; x < svgf->width; x++) {
        const size_t at = (size_t)y * svgf->width + x;
        struct past *next = &svgf->next[at];
        float now[3];
        if (g->object[at] == LW_TRACE_MISS || !divide(job, at, now)) {
            *next = (struct past){.at.object = LW_TRACE_MISS};
            for (int c = 0; c < 3; c++) light->rgb[c][at] = 0;
            light->variance[at] = 0;
            svgf->count[at] = 0;
            svgf->light[1].rgb[0][at] = svgf->light[1].rgb[1][at] = 0;
            continue;
        }
        read_past(job, at, next);
        next->count = (next->count < longest - 1 ? next->count : longest - 1) + 1;
        const float share = 1 / next->count, luminance = luminance_of(now);
        for (int c = 0; c < 3; c++) next->light[c] += share * (now[c] - next->light[c]);
        next->moment[0] += share * (luminance - next->moment[0]);
        next->moment[1] += share * (luminance * luminance - next->moment[1]);
        next->quick += (share > 1 / QUICK_MAX ? share : 1 / QUICK_MAX) * (luminance - next->quick);
        next->at = lw_reprojection_surface_of(g, at);
        for (int c = 0; c < 3; c++) light->rgb[c][at] = next->light[c];
        const float spread = next->moment[1] - next->moment[0] * next->moment[0];
        light->variance[at] = spread > 0 ? spread * share : 0;
        svgf->light[1].rgb[0][at] = next->quick - next->moment[0];
        svgf->light[1].rgb[1][at] = spread > 0 ? spread : 0;
        svgf->count[at] = next->count;
    }
}

/* ---- light that changes ---- */

/* One pixel of the spread, for a run of pixels: differences and variances add up where the object is the
 * same. */
LW_WIDE static void add_surprise(const uint32_t *object_p, const uint32_t *object_q, const float *difference,
                                 const float *variance, uint32_t count, float *restrict sum_difference,
                                 float *restrict sum_variance) {
    for (uint32_t i = 0; i < count; i++) {
        const bool same = object_p[i] == object_q[i];
        sum_difference[i] += same ? difference[i] : 0;
        sum_variance[i] += same ? variance[i] : 0;
    }
}

static void shorten(const struct lw_svgf *svgf, size_t at, float difference, float variance) {
    struct past *next = &svgf->next[at];
    /* A mean that takes in 1/n of each new frame has 1/(2n - 1) of a frame's variance. */
    const float standard =
        sqrtf(variance / (2 * QUICK_MAX - 1)) + ROUNDING_SHARE * fabsf(next->moment[0]) + ROUNDING_MIN;
    const float surprise = fabsf(difference) / standard;
    if (!(surprise > SURPRISE_MIN) || next->count <= QUICK_MAX) return;
    const float share = (surprise - SURPRISE_MIN) / (SURPRISE_MAX - SURPRISE_MIN);
    const float count = next->count + (HISTORY_LEAST - next->count) * (share < 1 ? share : 1);
    svgf->light[0].variance[at] *= next->count / count;
    svgf->count[at] = next->count = count;
}

static void shorten_row(const struct job *job, uint32_t y) {
    const struct lw_svgf *svgf = job->svgf;
    const uint32_t *object = job->gbuffer->plane.object;
    const float *difference = svgf->light[1].rgb[0], *variance = svgf->light[1].rgb[1];
    const int width = (int)svgf->width, height = (int)svgf->height;
    for (int x = 0; x < width; x += (int)CHUNK) {
        const int count = width - x < (int)CHUNK ? width - x : (int)CHUNK;
        const size_t at = (size_t)y * svgf->width + (size_t)x;
        float sum_difference[CHUNK] = {0}, sum_variance[CHUNK] = {0};
        for (int dy = -SPREAD_RADIUS; dy <= SPREAD_RADIUS; dy += SPREAD_STEP)
            for (int dx = -SPREAD_RADIUS; dx <= SPREAD_RADIUS; dx += SPREAD_STEP) {
                const int row = (int)y + dy;
                if (row < 0 || row >= height) continue;
                const int first = x + dx < 0 ? -(x + dx) : 0,
                          end = x + count + dx > width ? width - dx - x : count;
                if (first >= end) continue;
                const size_t p = at + (size_t)first, q = (size_t)row * svgf->width + (size_t)(x + first + dx);
                add_surprise(object + p, object + q, difference + q, variance + q, (uint32_t)(end - first),
                             sum_difference + first, sum_variance + first);
            }
        for (int i = 0; i < count; i++) shorten(svgf, at + (size_t)i, sum_difference[i], sum_variance[i]);
    }
}

/* ---- variance of pixels that have just come into view ---- */

/* Weight of one pixel's light for another, in three parts that add up in the exponent: e^-x, cut off to reach
 * 0 at 4. */
static inline float falloff(float x) {
    float w = 1 - 0.25f * x;
    w = w > 0 ? w : 0;
    w *= w;
    return w * w;
}

static void estimate_variance(const struct job *job, uint32_t x, uint32_t y) {
    enum { RADIUS = 3 };
    const struct lw_svgf *svgf = job->svgf;
    const size_t at = (size_t)y * svgf->width + x;
    const struct past *centre = &svgf->next[at];
    float weights = 0, moment[2] = {0};
    for (int dy = -RADIUS; dy <= RADIUS; dy++)
        for (int dx = -RADIUS; dx <= RADIUS; dx++) {
            const int px = (int)x + dx, py = (int)y + dy;
            if (px < 0 || py < 0 || px >= (int)svgf->width || py >= (int)svgf->height) continue;
            const struct past *past = &svgf->next[(size_t)py * svgf->width + (size_t)px];
            if (past->at.object != centre->at.object) continue;
            const float off = past->at.depth - centre->at.depth - centre->at.slope[0] * (float)dx -
                              centre->at.slope[1] * (float)dy;
            const float cosine = past->at.normal[0] * centre->at.normal[0] +
                                 past->at.normal[1] * centre->at.normal[1] +
                                 past->at.normal[2] * centre->at.normal[2];
            const float weight =
                falloff(fabsf(off) * centre->at.apart / SIGMA_PLANE + NORMAL_POWER * (1 - cosine));
            weights += weight;
            for (int m = 0; m < 2; m++) moment[m] += weight * past->moment[m];
        }
    if (!(weights > 0)) return;
    const float mean = moment[0] / weights, variance = fmaxf(0, moment[1] / weights - mean * mean);
    /* Few samples often underestimate variance: the shorter the history, the more is added. */
    const float count = centre->count > 1 ? centre->count : 1;
    svgf->light[0].variance[at] = variance / count * fmaxf(1, HISTORY_VERY_SHORT / count);
}

static void estimate_row(const struct job *job, uint32_t y) {
    const struct lw_svgf *svgf = job->svgf;
    for (uint32_t x = 0; x < svgf->width; x++) {
        const float count = svgf->count[(size_t)y * svgf->width + x];
        if (count > 0 && count < HISTORY_SHORT) estimate_variance(job, x, y);
    }
}

/* ---- over the picture ---- */

/* The sums of a chunk of a row, and what each pixel of it knows by itself. */
struct sums {
    _Alignas(64) float weight[CHUNK], rgb[3][CHUNK], variance[CHUNK];
    float luminance[CHUNK], sharpness[CHUNK]; /* 1 / (sigma standard deviations) */
};

/* A tap: the pixels `offset` further on, for `count` pixels from `at` on; `first` of the sums. */
struct tap {
    size_t at, from;
    uint32_t first, count;
    float dx, dy, kernel;
};

LW_WIDE static void add_tap(const struct lw_gbuffer_planes *g, const struct light *in, const struct tap *tap,
                            struct sums *restrict sums) {
    const uint32_t *object_p = g->object + tap->at, *object_q = g->object + tap->from;
    const float *depth_p = g->depth + tap->at, *depth_q = g->depth + tap->from;
    const float *slope_x = g->slope[0] + tap->at, *slope_y = g->slope[1] + tap->at,
                *apart = g->apart + tap->at;
    const float *nx_p = g->normal[0] + tap->at, *ny_p = g->normal[1] + tap->at,
                *nz_p = g->normal[2] + tap->at;
    const float *nx_q = g->normal[0] + tap->from, *ny_q = g->normal[1] + tap->from,
                *nz_q = g->normal[2] + tap->from;
    const float *red = in->rgb[0] + tap->from, *green = in->rgb[1] + tap->from,
                *blue = in->rgb[2] + tap->from;
    const float *variance = in->variance + tap->from;
    float *restrict sum_weight = sums->weight + tap->first, *restrict sum_variance =
                                                                sums->variance + tap->first;
    float *restrict sum_red = sums->rgb[0] + tap->first, *restrict sum_green = sums->rgb[1] + tap->first,
                    *restrict sum_blue = sums->rgb[2] + tap->first;
    const float *luminance = sums->luminance + tap->first, *sharpness = sums->sharpness + tap->first;
    const float dx = tap->dx, dy = tap->dy, kernel = tap->kernel;
    for (uint32_t i = 0; i < tap->count; i++) {
        const float off = depth_q[i] - depth_p[i] - slope_x[i] * dx - slope_y[i] * dy;
        const float cosine = nx_p[i] * nx_q[i] + ny_p[i] * ny_q[i] + nz_p[i] * nz_q[i];
        const float other = 0.2126f * red[i] + 0.7152f * green[i] + 0.0722f * blue[i];
        float x = fabsf(off) * apart[i] * (1 / SIGMA_PLANE) + NORMAL_POWER * (1 - cosine) +
                  fabsf(other - luminance[i]) * sharpness[i];
        float w = 1 - 0.25f * x;
        w = w > 0 ? w : 0;
        w *= w;
        w *= w * kernel;
        w = object_p[i] == object_q[i] ? w : 0;
        sum_weight[i] += w;
        sum_red[i] += w * red[i];
        sum_green[i] += w * green[i];
        sum_blue[i] += w * blue[i];
        sum_variance[i] += w * w * variance[i];
    }
}

/* Data of each pixel of a chunk. The variance is smoothed by 3 x 3, since few frames estimate it badly. */
LW_WIDE static void begin_sums(const struct lw_svgf *svgf, const struct light *in, uint32_t x, uint32_t y,
                               uint32_t count, struct sums *restrict sums) {
    const size_t row = (size_t)y * svgf->width;
    const float *middle = in->variance + row, *above = middle - (y > 0 ? svgf->width : 0),
                *below = middle + (y + 1 < svgf->height ? svgf->width : 0);
    float column[CHUNK + 2]; /* sums over three rows; one pixel more on either side */
    const uint32_t last = svgf->width - 1, end = x + count < last ? x + count : last;
    for (uint32_t i = 0; i < count; i++)
        column[i + 1] = 0.25f * (above[x + i] + below[x + i]) + 0.5f * middle[x + i];
    const uint32_t left = x > 0 ? x - 1 : 0;
    column[0] = 0.25f * (above[left] + below[left]) + 0.5f * middle[left];
    column[count + 1] = 0.25f * (above[end] + below[end]) + 0.5f * middle[end];
    const float *red = in->rgb[0] + row + x, *green = in->rgb[1] + row + x, *blue = in->rgb[2] + row + x;
    for (uint32_t i = 0; i < count; i++) {
        const float luminance = 0.2126f * red[i] + 0.7152f * green[i] + 0.0722f * blue[i];
        const float variance = 0.25f * (column[i] + column[i + 2]) + 0.5f * column[i + 1];
        sums->luminance[i] = luminance;
        sums->sharpness[i] =
            1 / (SIGMA_LIGHT * sqrtf(variance) + ROUNDING_MIN + ROUNDING_SHARE * fabsf(luminance));
        sums->weight[i] = sums->rgb[0][i] = sums->rgb[1][i] = sums->rgb[2][i] = sums->variance[i] = 0;
    }
}

LW_WIDE static void end_sums(const struct sums *restrict sums, uint32_t count, const struct light *out,
                             size_t at) {
    float *restrict red = out->rgb[0] + at, *restrict green = out->rgb[1] + at,
                    *restrict blue = out->rgb[2] + at, *restrict variance = out->variance + at;
    for (uint32_t i = 0; i < count; i++) {
        const float weight = sums->weight[i], scale = 1 / (weight > WEIGHT_MIN ? weight : WEIGHT_MIN);
        red[i] = sums->rgb[0][i] * scale;
        green[i] = sums->rgb[1][i] * scale;
        blue[i] = sums->rgb[2][i] * scale;
        variance[i] = sums->variance[i] * scale * scale;
    }
}

static void filter_chunk(const struct job *job, const struct light *in, const struct light *out, uint32_t x,
                         uint32_t y, int step) {
    static const float kernel[3] = {0.25f, 0.5f, 0.25f};
    const struct lw_svgf *svgf = job->svgf;
    const int width = (int)svgf->width, height = (int)svgf->height;
    const int count = width - (int)x < (int)CHUNK ? width - (int)x : (int)CHUNK;
    const size_t at = (size_t)y * svgf->width + x;
    struct sums sums;
    begin_sums(svgf, in, x, y, (uint32_t)count, &sums);
    for (int j = -1; j <= 1; j++) {
        const int dy = j * step, row = (int)y + dy;
        if (row < 0 || row >= height) continue;
        for (int k = -1; k <= 1; k++) {
            const int dx = k * step;
            int first = 0, end = count;
            if ((int)x + dx < 0) first = -((int)x + dx);
            if ((int)x + end + dx > width) end = width - dx - (int)x;
            if (first >= end) continue;
            const struct tap tap = {.at = at + (size_t)first,
                                    .from = (size_t)row * svgf->width + (size_t)((int)x + first + dx),
                                    .first = (uint32_t)first,
                                    .count = (uint32_t)(end - first),
                                    .dx = (float)dx,
                                    .dy = (float)dy,
                                    .kernel = kernel[j + 1] * kernel[k + 1]};
            add_tap(&job->gbuffer->plane, in, &tap, &sums);
        }
    }
    end_sums(&sums, (uint32_t)count, out, at);
}

static void filter_row(const struct job *job, unsigned level, uint32_t y) {
    struct lw_svgf *svgf = job->svgf;
    for (uint32_t x = 0; x < svgf->width; x += CHUNK)
        filter_chunk(job, &svgf->light[level & 1u], &svgf->light[~level & 1u], x, y, 1 << level);
}

/* Light as it leaves the filter. */
static const struct light *filtered_light(const struct lw_svgf *svgf) {
    return &svgf->light[svgf->levels & 1u];
}

static void deliver(const struct lw_svgf *svgf, const struct lw_gbuffer_planes *g, size_t at,
                    const float light[3], float *out_rgb) {
    for (int c = 0; c < 3; c++) {
        const float rgb = light[c] * g->albedo[c][at] + svgf->emission * g->emission[c][at];
        out_rgb[3 * at + (size_t)c] = rgb > 0 ? rgb : 0;
    }
}

static void deliver_row(const struct job *job, uint32_t y, float *out_rgb) {
    const struct light *light = filtered_light(job->svgf);
    const uint32_t width = job->svgf->width;
    for (size_t at = (size_t)y * width, end = at + width; at < end; at++)
        deliver(job->svgf, &job->gbuffer->plane, at,
                (const float[3]){light->rgb[0][at], light->rgb[1][at], light->rgb[2][at]}, out_rgb);
}

static void accumulate_and_filter(struct lw_svgf *svgf, const struct lw_gbuffer *gbuffer,
                                  const float *radiance, float *out_rgb) {
    const struct lw_reprojection now = lw_reprojection_of(gbuffer);
    const struct job job = {
        .svgf = svgf, .gbuffer = gbuffer, .radiance = radiance, .before = svgf->started ? svgf->before : now};
#pragma omp parallel num_threads(svgf->threads)
    {
#pragma omp for schedule(dynamic, 8)
        for (uint32_t y = 0; y < svgf->height; y++) accumulate_row(&job, y);
        if (!gbuffer->still) {
#pragma omp for schedule(dynamic, 8)
            for (uint32_t y = 0; y < svgf->height; y++) shorten_row(&job, y);
        }
        if (svgf->levels) {
#pragma omp for schedule(dynamic, 8)
            for (uint32_t y = 0; y < svgf->height; y++) estimate_row(&job, y);
        }
        for (unsigned level = 0; level < svgf->levels; level++) {
#pragma omp for schedule(dynamic, 8)
            for (uint32_t y = 0; y < svgf->height; y++) filter_row(&job, level, y);
        }
        if (out_rgb) {
#pragma omp for schedule(dynamic, 8)
            for (uint32_t y = 0; y < svgf->height; y++) deliver_row(&job, y, out_rgb);
        }
    }
    struct past *past = svgf->past;
    svgf->past = svgf->next;
    svgf->next = past;
    svgf->before = now;
    svgf->started = true;
}

void lw_svgf_filter(struct lw_svgf *svgf, const struct lw_gbuffer *gbuffer, const float *radiance,
                    float *out_rgb) {
    accumulate_and_filter(svgf, gbuffer, radiance, out_rgb);
}

/* ---- to all pixels of a picture of which every few were filtered ---- */

/* Weight of a lattice pixel for a pixel of the picture, apart from its distance. (dx, dy):
 * from the lattice's pixel to the picture's, in pixels of the lattice. A little is left on another surface:
 * where all four are on others, the nearest serve. */
static float kinship(const struct lw_gbuffer_planes *thin, size_t q, const struct lw_gbuffer_planes *full,
                     size_t p, float dx, float dy) {
    const float off = full->depth[p] - thin->depth[q] - thin->slope[0][q] * dx - thin->slope[1][q] * dy;
    const float cosine = full->normal[0][p] * thin->normal[0][q] + full->normal[1][p] * thin->normal[1][q] +
                         full->normal[2][p] * thin->normal[2][q];
    const float x = fabsf(off) * thin->apart[q] / SIGMA_PLANE + NORMAL_POWER * (1 - cosine);
    return (thin->object[q] == full->object[p] ? falloff(x) : 0) + STRANGE_WEIGHT;
}

static void spread_row(const struct lw_svgf *svgf, const struct lw_gbuffer *thin,
                       const struct lw_gbuffer *full, uint32_t y, float *out_rgb) {
    const struct light *light = filtered_light(svgf);
    const float scale = 1 / (float)thin->lattice.step;
    const float v = ((float)y - (float)thin->lattice.y) * scale;
    const int top = (int)floorf(v);
    for (uint32_t x = 0; x < full->width; x++) {
        const size_t at = (size_t)y * full->width + x;
        const float u = ((float)x - (float)thin->lattice.x) * scale;
        const int left = (int)floorf(u);
        float sum[3] = {0}, weights = 0;
        for (int i = 0; i < 4 && full->plane.object[at] != LW_TRACE_MISS; i++) {
            const int column = left + (i & 1), row = top + (i >> 1);
            if (column < 0 || row < 0 || column >= (int)thin->width || row >= (int)thin->height) continue;
            const float dx = u - (float)column, dy = v - (float)row;
            const size_t q = (size_t)row * thin->width + (size_t)column;
            if (!(svgf->count[q] > 0)) continue; /* nothing there, or black: it knows nothing of light */
            const float weight =
                (1 - fabsf(dx)) * (1 - fabsf(dy)) * kinship(&thin->plane, q, &full->plane, at, dx, dy);
            for (int c = 0; c < 3; c++) sum[c] += weight * light->rgb[c][q];
            weights += weight;
        }
        for (int c = 0; c < 3; c++) sum[c] /= weights > WEIGHT_MIN ? weights : 1;
        deliver(svgf, &full->plane, at, sum, out_rgb);
    }
}

void lw_svgf_filter_thin(struct lw_svgf *svgf, const struct lw_gbuffer *thin, const struct lw_gbuffer *full,
                         const float *radiance, float *out_rgb) {
    accumulate_and_filter(svgf, thin, radiance, NULL);
#pragma omp parallel for schedule(dynamic, 8) num_threads(svgf->threads)
    for (uint32_t y = 0; y < full->height; y++) spread_row(svgf, thin, full, y, out_rgb);
}
