#include "client/view/tonemap.h"

#include "common/base/colour.h"

#include <math.h>

/* Histogram for the automatic exposure: eighths of a stop around 1. */
#define HISTOGRAM_BINS     1024
#define HISTOGRAM_PER_STOP 8.0f
/* Share of lit pixels that the automatic exposure leaves out at either end. */
#define DARKEST_SHARE   0.05
#define BRIGHTEST_SHARE 0.10
#define KEY             0.18f

void lw_tonemap_init(struct lw_tonemap *tonemap, enum lw_tonemap_curve curve, float stops) {
    tonemap->curve = curve;
    lw_tonemap_set_stops(tonemap, stops);
    for (int i = 0; i < 255; i++) tonemap->threshold[i] = lw_colour_from_srgb(((float)i + 0.5f) / 255.0f);
    tonemap->threshold[255] = INFINITY;
    unsigned code = 0;
    for (int i = 0; i < LW_TONEMAP_BINS; i++) {
        while ((float)i / LW_TONEMAP_BINS >= tonemap->threshold[code]) code++;
        tonemap->first_code[i] = (uint8_t)code;
    }
}

void lw_tonemap_set_stops(struct lw_tonemap *tonemap, float stops) {
    tonemap->scale = exp2f(fminf(fmaxf(stops, -LW_TONEMAP_STOPS_MAX), LW_TONEMAP_STOPS_MAX));
}

/* K. Narkowicz, "ACES Filmic Tone Mapping Curve", 2015: a rational fit of the ACES reference and output
 * transforms. */
static float aces(float x) { return x * (2.51f * x + 0.03f) / (x * (2.43f * x + 0.59f) + 0.14f); }

/* The comparisons are false for NaN, which becomes 0. */
static float clamp01(float x) { return x > 0 ? (x < 1 ? x : 1.0f) : 0.0f; }
/* Far past white for every curve, and far from overflow in any of them. */
static float bounded(float x) { return x > 0 ? (x < 1e9f ? x : 1e9f) : 0.0f; }

struct lw_vec3 lw_tonemap_apply(enum lw_tonemap_curve curve, struct lw_vec3 exposed) {
    struct lw_vec3 c = lw_vec3(bounded(exposed.x), bounded(exposed.y), bounded(exposed.z));
    switch (curve) {
    case LW_TONEMAP_REINHARD:
        c = lw_vec3_scale(c, 1.0f / (1.0f + lw_colour_luminance(c)));
        break;
    case LW_TONEMAP_ACES:
        c = lw_vec3(aces(c.x), aces(c.y), aces(c.z));
        break;
    case LW_TONEMAP_NONE:
        break;
    }
    return lw_vec3(clamp01(c.x), clamp01(c.y), clamp01(c.z));
}

float lw_tonemap_auto_stops(const float *rgb, size_t pixel_count) {
    /* Counts, not sums of floats: the answer does not depend on the order of pixels. */
    size_t histogram[HISTOGRAM_BINS] = {0}, lit = 0;
    for (size_t i = 0; i < pixel_count; i++) {
        float luminance = lw_colour_luminance(lw_vec3(rgb[3 * i], rgb[3 * i + 1], rgb[3 * i + 2]));
        if (!(luminance > 1e-18f) || !isfinite(luminance)) continue;
        float bin = log2f(luminance) * HISTOGRAM_PER_STOP + HISTOGRAM_BINS / 2;
        histogram[bin < 0 ? 0 : bin < HISTOGRAM_BINS - 1 ? (int)bin : HISTOGRAM_BINS - 1]++;
        lit++;
    }
    if (lit == 0) return 0;
    double first = DARKEST_SHARE * (double)lit, last = (1.0 - BRIGHTEST_SHARE) * (double)lit;
    double below = 0, weight = 0, sum = 0;
    for (int i = 0; i < HISTOGRAM_BINS; i++) {
        double above = below + (double)histogram[i];
        double inside = fmin(above, last) - fmax(below, first);
        if (inside > 0) {
            weight += inside;
            sum += inside * ((i + 0.5 - HISTOGRAM_BINS / 2) / (double)HISTOGRAM_PER_STOP);
        }
        below = above;
    }
    return log2f(KEY) - (float)(sum / weight);
}

/* Nearest code, by table and exact thresholds: the same as rounding 255 * encode(l), without a power per
 * channel. */
static uint8_t encode(const struct lw_tonemap *tonemap, float linear) {
    if (linear >= 1.0f) return 255;
    unsigned code = tonemap->first_code[(unsigned)(linear * LW_TONEMAP_BINS)];
    while (linear >= tonemap->threshold[code]) code++;
    return (uint8_t)code;
}

void lw_tonemap_encode(const struct lw_tonemap *tonemap, const float *rgb, size_t pixel_count,
                       unsigned pixel_bytes, uint8_t *out_srgb) {
    for (size_t i = 0; i < pixel_count; i++) {
        struct lw_vec3 light = lw_vec3(rgb[3 * i], rgb[3 * i + 1], rgb[3 * i + 2]);
        struct lw_vec3 c = lw_tonemap_apply(tonemap->curve, lw_vec3_scale(light, tonemap->scale));
        uint8_t *pixel = out_srgb + i * pixel_bytes;
        pixel[0] = encode(tonemap, c.x);
        pixel[1] = encode(tonemap, c.y);
        pixel[2] = encode(tonemap, c.z);
        if (pixel_bytes == 4) pixel[3] = 255;
    }
}
