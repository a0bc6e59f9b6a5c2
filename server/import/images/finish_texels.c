#include "server/import/images/finish_texels.h"

#include <math.h>
#include <string.h>

/* Lengths of normals, squared, in units of (2 byte - 255): 255 is 1. */
#define UNIT      65025
#define SHORT     (UNIT / 100) /* a tenth: no direction */
#define ROUNDING  512          /* slack for x and y that lie flat */
#define SLACK_MIN (UNIT * 94 / 100)
#define SLACK_MAX (UNIT * 106 / 100) /* within 3 % it is rounding: the file's bytes stay */

bool lw_finish_texels_opaque(const uint8_t *rgba, size_t texels) {
    uint8_t all = 255;
    for (size_t i = 0; i < texels; i++) all &= rgba[4 * i + 3];
    return all == 255;
}

void lw_finish_texels_cover(uint8_t *rgba, size_t texels) {
    for (size_t i = 0; i < texels; i++) rgba[4 * i + 3] = 255;
}

/* ---- normals ---- */

static uint8_t to_byte(float x) { return (uint8_t)(127.5f + 127.5f * fminf(fmaxf(x, -1), 1) + 0.5f); }

/* Returns whether it was no normal. */
static bool mend_normal(uint8_t texel[4]) {
    const int x = 2 * texel[0] - 255, y = 2 * texel[1] - 255, z = 2 * texel[2] - 255;
    const int flat = x * x + y * y, squared = flat + z * z;
    const bool odd = z < 0 || squared < SHORT;
    if (odd && flat > UNIT) texel[0] = texel[1] = 128;
    if (odd || (squared >= SLACK_MIN && squared <= SLACK_MAX && flat <= UNIT + ROUNDING)) return odd;
    const float length = sqrtf((float)squared);
    texel[0] = to_byte((float)x / length);
    texel[1] = to_byte((float)y / length);
    return false;
}

size_t lw_finish_texels_normal(uint8_t *rgba, size_t texels) {
    size_t odd = 0;
    for (size_t i = 0; i < texels; i++) {
        uint8_t *texel = rgba + 4 * i;
        odd += mend_normal(texel);
        texel[2] = lw_scene_normal_blue(texel[0], texel[1]);
        texel[3] = 255;
    }
    return odd;
}

bool lw_finish_texels_are_normals(const uint8_t *rgba, size_t texels) {
    uint64_t sum[3] = {0};
    for (size_t i = 0; i < texels; i++)
        for (int c = 0; c < 3; c++) sum[c] += rgba[4 * i + (size_t)c];
    const double n = (double)texels, r = (double)sum[0] / n, g = (double)sum[1] / n, b = (double)sum[2] / n;
    return fabs(r - 127.5) < 32 && fabs(g - 127.5) < 32 && b > 180;
}

/* ---- gloss ---- */

void lw_finish_texels_gloss(uint8_t *rgba, size_t texels, float glossiness, uint8_t *out_surface) {
    uint8_t roughness[256];
    for (int a = 0; a < 256; a++) roughness[a] = (uint8_t)(255 - glossiness * (float)a + 0.5f);
    for (size_t i = 0; i < texels; i++) {
        memcpy(out_surface + 4 * i, (const uint8_t[]){255, roughness[rgba[4 * i + 3]], 255, 255}, 4);
        rgba[4 * i + 3] = 255;
    }
}

/* ---- heights ---- */

static uint32_t beside(uint32_t i, int step, uint32_t size, uint8_t wrap) {
    if (i + 1 == size && step > 0) return wrap == LW_WRAP_REPEAT ? 0 : i;
    if (i == 0 && step < 0) return wrap == LW_WRAP_REPEAT ? size - 1 : 0;
    return i + (uint32_t)step;
}

static float height_of(const uint8_t *rgba, uint32_t width, uint32_t x, uint32_t y) {
    const uint8_t *texel = rgba + 4 * ((size_t)y * width + x);
    return (float)(texel[0] + texel[1] + texel[2]) * (1.0f / 765);
}

/* x is to the right; y is up, against the rows. */
void lw_finish_texels_height(const uint8_t *rgba, const struct lw_texture *texture, uint8_t *out) {
    const uint32_t w = texture->width, h = texture->height;
    const uint8_t s = texture->wrap_s, t = texture->wrap_t;
    const float slope = 0.5f * LW_FINISH_TEXELS_RELIEF * (float)(w > h ? w : h);
    for (uint32_t y = 0; y < h; y++)
        for (uint32_t x = 0; x < w; x++) {
            const float right = height_of(rgba, w, beside(x, 1, w, s), y),
                        left = height_of(rgba, w, beside(x, -1, w, s), y),
                        below = height_of(rgba, w, x, beside(y, 1, h, t)),
                        above = height_of(rgba, w, x, beside(y, -1, h, t));
            const struct lw_vec3 n =
                lw_vec3_normalize(lw_vec3((left - right) * slope, (below - above) * slope, 1));
            const uint8_t texel[4] = {to_byte(n.x), to_byte(n.y), to_byte(n.z), 255};
            memcpy(out + 4 * ((size_t)y * w + x), texel, 4);
        }
}

/* ---- two pictures ---- */

const uint8_t *lw_finish_texels_at(const struct lw_finish_texels_join *from, uint32_t x, uint32_t y,
                                   uint32_t width, uint32_t height) {
    const uint64_t row = (uint64_t)y * from->height / height, column = (uint64_t)x * from->width / width;
    return from->rgba + 4 * (row * from->width + column);
}
