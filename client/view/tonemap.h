/* tonemap.h: linear radiance to 8-bit sRGB.
 * Flow:    compose -> [tonemap] -> PNG or window
 * Threads: lw_tonemap_init by one thread, then [any].
 * After:   Reinhard and others 2002 (global operator, log-average key); Narkowicz 2015 (fitted ACES curve);
 *          IEC 61966-2-1 (encoding). */
#ifndef LW_CLIENT_VIEW_TONEMAP_H
#define LW_CLIENT_VIEW_TONEMAP_H

#include "common/base/vec.h"

#include <stddef.h>
#include <stdint.h>

enum lw_tonemap_curve {
    LW_TONEMAP_REINHARD, /* luminance x becomes x / (1 + x); keeps the hue until a channel clips */
    LW_TONEMAP_ACES,     /* per channel */
    LW_TONEMAP_NONE      /* clips at 1 */
};
#define LW_TONEMAP_CHOICES "reinhard|aces|none" /* in the order of enum lw_tonemap_curve */

#define LW_TONEMAP_STOPS_MAX 60.0f

#define LW_TONEMAP_BINS 4096

struct lw_tonemap {
    enum lw_tonemap_curve curve;
    float scale;                         /* 2^stops */
    float threshold[256];                /* linear light from which on code i + 1 is nearer than code i */
    uint8_t first_code[LW_TONEMAP_BINS]; /* code at the lower end of each bin of linear light */
};

/** stops   exposure: light is multiplied by 2^stops first; clamped to +-LW_TONEMAP_STOPS_MAX */
void lw_tonemap_init(struct lw_tonemap *tonemap, enum lw_tonemap_curve curve, float stops);
/** Another exposure, cheaply. */
void lw_tonemap_set_stops(struct lw_tonemap *tonemap, float stops);

/** The curve alone, on light that is already exposed: linear, within [0, 1]. */
struct lw_vec3 lw_tonemap_apply(enum lw_tonemap_curve curve, struct lw_vec3 exposed);

/** Exposure in stops that puts the picture's log-average luminance at 0.18. Black pixels do not count, nor do
 * the darkest and the brightest few: a lamp or a sun patch does not blacken the room. 0 for a black
 * picture. */
float lw_tonemap_auto_stops(const float *rgb, size_t pixel_count);

/** Encodes pixels: 3 floats each in, pixel_bytes (3, or 4 with an opaque fourth) each out. Values that are
 * not finite are shown as black or white. */
void lw_tonemap_encode(const struct lw_tonemap *tonemap, const float *rgb, size_t pixel_count,
                       unsigned pixel_bytes, uint8_t *out_srgb);

#endif
