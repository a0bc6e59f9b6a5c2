#include "client/view/shading/ambient.h"

#include "common/scene/environment.h"
#include "common/shading/microfacets.h"

#include <stdlib.h>
#include <string.h>

#define SIDE   LW_AMBIENT_SIDE
#define VALUES (3ul * SIDE * SIDE) /* per map */

/* The environment as a few even patches. */
#define COARSE_ROWS 32u
#define FINE_ROWS   64u
#define FINE_ALPHA  0.2f /* below it a mirror sees less than a coarse patch */

struct patch {
    struct lw_vec3 direction, radiance;
    float solid_angle;
};

struct patches {
    struct patch *patch;
    uint32_t count;
};

/* Mean radiance of a patch, from about as many places as it has texels, 8 x 8 at most. */
static struct lw_vec3 mean_radiance(const struct lw_environment *e, uint32_t x, uint32_t y, uint32_t rows) {
    const uint32_t texels = e->height / rows, steps = texels < 1 ? 1 : texels > 8 ? 8 : texels;
    struct lw_vec3 sum = {0, 0, 0};
    float weight = 0;
    for (uint32_t j = 0; j < steps; j++) {
        const float v = ((float)y + ((float)j + 0.5f) / (float)steps) / (float)rows, sine = sinf(LW_PI * v);
        for (uint32_t i = 0; i < steps; i++) {
            const float u = ((float)x + ((float)i + 0.5f) / (float)steps) / (float)(2 * rows);
            const float phi = 2 * LW_PI * (u - 0.5f);
            const struct lw_vec3 d = lw_vec3(sine * cosf(phi), cosf(LW_PI * v), sine * sinf(phi));
            sum = lw_vec3_mad(sum, lw_environment_radiance(e, d), sine);
            weight += sine;
        }
    }
    return lw_vec3_scale(sum, 1 / weight);
}

static bool cut_patches(const struct lw_environment *e, uint32_t rows, struct patches *out) {
    out->patch = malloc(2ul * rows * rows * sizeof *out->patch);
    out->count = 2 * rows * rows;
    if (!out->patch) return false;
#pragma omp parallel for schedule(static)
    for (uint32_t y = 0; y < rows; y++)
        for (uint32_t x = 0; x < 2 * rows; x++) {
            const float v = ((float)y + 0.5f) / (float)rows, sine = sinf(LW_PI * v),
                        phi = LW_PI * (((float)x + 0.5f) / (float)rows - 1);
            out->patch[2 * rows * y + x] =
                (struct patch){.direction = lw_vec3(sine * cosf(phi), cosf(LW_PI * v), sine * sinf(phi)),
                               .radiance = mean_radiance(e, x, y, rows),
                               .solid_angle = sine * LW_PI * LW_PI / (float)(rows * rows)};
        }
    return true;
}

/* The direction of a step of the map. */
static struct lw_vec3 direction_of(uint32_t i, uint32_t j) {
    const float x = 2 * (float)i / LW_AMBIENT_STEPS - 1, y = 2 * (float)j / LW_AMBIENT_STEPS - 1;
    const float z = 1 - fabsf(x) - fabsf(y), fold = z < 0 ? -z : 0;
    return lw_vec3_normalize(lw_vec3(x + (x < 0 ? fold : -fold), y + (y < 0 ? fold : -fold), z));
}

/* Radiance in a mirror that faces the eye: each facet mirrors about the eye's direction. */
static float weight_of(float cosine, float alpha) {
    const float half2 = 0.5f + 0.5f * cosine, d = 1 - half2 + alpha * alpha * half2; /* squares of cosines */
    return alpha * alpha / (d * d) * cosine;
}

/* alpha < 0: a matt surface */
static struct lw_vec3 gather(const struct patches *from, struct lw_vec3 about, float alpha) {
    struct lw_vec3 sum = {0, 0, 0};
    float all = 1e-20f;
    for (uint32_t k = 0; k < from->count; k++) {
        const struct patch *p = &from->patch[k];
        const float cosine = lw_vec3_dot(about, p->direction);
        if (!(cosine > 0)) continue;
        const float weight = p->solid_angle * (alpha < 0 ? cosine : weight_of(cosine, alpha));
        sum = lw_vec3_mad(sum, p->radiance, weight);
        all += weight;
    }
    return lw_vec3_scale(sum, 1 / all);
}

static void fill_map(const struct lw_environment *e, const struct patches *coarse, const struct patches *fine,
                     uint32_t map, float *out) {
    const float roughness = (float)map / (LW_AMBIENT_LEVELS - 1), alpha = lw_microfacets_alpha(roughness);
#pragma omp parallel for schedule(static)
    for (uint32_t j = 0; j < SIDE; j++)
        for (uint32_t i = 0; i < SIDE; i++) {
            const struct lw_vec3 about = direction_of(i, j);
            const struct lw_vec3 seen = map == 0 ? lw_environment_radiance(e, about)
                                        : map == LW_AMBIENT_LEVELS
                                            ? gather(coarse, about, -1)
                                            : gather(alpha < FINE_ALPHA ? fine : coarse, about, alpha);
            float *to = out + 3 * (j * SIDE + i);
            to[0] = seen.x, to[1] = seen.y, to[2] = seen.z;
        }
}

enum lw_status lw_ambient_take(struct lw_ambient *ambient, const struct lw_environment *from) {
    if (from->width == 0) {
        lw_ambient_finish(ambient);
        return LW_OK;
    }
    if (ambient->rgb && ambient->of == from->rgb) return LW_OK;
    lw_ambient_finish(ambient);
    struct patches coarse = {0}, fine = {0};
    float *rgb = malloc(LW_AMBIENT_MAPS * VALUES * sizeof *rgb);
    const bool good = rgb && cut_patches(from, COARSE_ROWS, &coarse) && cut_patches(from, FINE_ROWS, &fine);
    for (uint32_t map = 0; good && map < LW_AMBIENT_MAPS; map++)
        fill_map(from, &coarse, &fine, map, rgb + map * VALUES);
    free(fine.patch);
    free(coarse.patch);
    if (!good) {
        free(rgb);
        return LW_NO_MEMORY;
    }
    *ambient = (struct lw_ambient){.rgb = rgb, .of = from->rgb};
    return LW_OK;
}

void lw_ambient_finish(struct lw_ambient *ambient) {
    free(ambient->rgb);
    *ambient = (struct lw_ambient){0};
}

/* Where a look-up lies: the first of four steps, and how far on. */
struct place {
    uint32_t first;
    float x, y;
};

static struct place place_of(struct lw_vec3 d) {
    const float scale = 1 / (fabsf(d.x) + fabsf(d.y) + fabsf(d.z) + 1e-30f);
    float x = d.x * scale, y = d.y * scale;
    if (d.z < 0) {
        const float folded = (1 - fabsf(y)) * (x < 0 ? -1.0f : 1.0f);
        y = (1 - fabsf(x)) * (y < 0 ? -1.0f : 1.0f), x = folded;
    }
    const float last = LW_AMBIENT_STEPS - 1, u = (0.5f + 0.5f * x) * LW_AMBIENT_STEPS,
                v = (0.5f + 0.5f * y) * LW_AMBIENT_STEPS;
    const float left = u > 0 ? (u < last ? (float)(int)u : last) : 0; /* NaN is 0 */
    const float top = v > 0 ? (v < last ? (float)(int)v : last) : 0;
    return (struct place){(uint32_t)top * SIDE + (uint32_t)left, u - left, v - top};
}

static struct lw_vec3 read_at(const float *map, const struct place *at) {
    const float *upper = map + 3ul * at->first, *lower = upper + 3ul * SIDE;
    float out[3];
    for (int c = 0; c < 3; c++) {
        const float a = upper[c] + at->x * (upper[c + 3] - upper[c]),
                    b = lower[c] + at->x * (lower[c + 3] - lower[c]);
        out[c] = a + at->y * (b - a);
    }
    return lw_vec3(out[0], out[1], out[2]);
}

struct lw_vec3 lw_ambient_mirrored(const struct lw_ambient *ambient, struct lw_vec3 direction,
                                   float roughness) {
    if (!ambient->rgb) return lw_vec3(0, 0, 0);
    const float most = LW_AMBIENT_LEVELS - 1, level = fminf(fmaxf(roughness, 0), 1) * most;
    const uint32_t k = level < most - 1 ? (uint32_t)level : LW_AMBIENT_LEVELS - 2;
    const struct place at = place_of(direction);
    const struct lw_vec3 sharp = read_at(ambient->rgb + k * VALUES, &at),
                         blurred = read_at(ambient->rgb + (k + 1) * VALUES, &at);
    return lw_vec3_mad(sharp, lw_vec3_sub(blurred, sharp), level - (float)k);
}

struct lw_vec3 lw_ambient_matt(const struct lw_ambient *ambient, struct lw_vec3 normal) {
    if (!ambient->rgb) return lw_vec3(0, 0, 0);
    const struct place at = place_of(normal);
    return read_at(ambient->rgb + LW_AMBIENT_LEVELS * VALUES, &at);
}
