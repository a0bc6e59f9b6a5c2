#include "common/scene/environment.h"

#include "common/base/cdf.h"
#include "common/base/colour.h"

#include <stdlib.h>

/* Luminance this little above the mean is rounding, or not worth a technique of its own. */
#define EXCESS_MIN 1e-3f
/* The density grows as 1 / sin towards the poles; this close to them, on 3e-10 sr, it stays finite. */
#define SINE_MIN 1e-5f

/* Where a direction lies in the picture, both within [0, 1]. Near the poles acos(y) would lose half the
 * digits. */
static struct lw_vec2 place_of(struct lw_vec3 d) {
    float u = 0.5f + atan2f(d.z, d.x) * (0.5f / LW_PI);
    float v = atan2f(sqrtf(d.x * d.x + d.z * d.z), d.y) * (1 / LW_PI);
    return (struct lw_vec2){fminf(fmaxf(u, 0), 1), fminf(fmaxf(v, 0), 1)};
}

static struct lw_vec3 texel(const struct lw_environment *e, uint32_t x, uint32_t y) {
    const float *rgb = e->rgb + 3 * ((size_t)y * e->width + x);
    return lw_vec3(rgb[0], rgb[1], rgb[2]);
}

static struct lw_vec3 mix(struct lw_vec3 a, struct lw_vec3 b, float t) {
    return lw_vec3_add(lw_vec3_scale(a, 1 - t), lw_vec3_scale(b, t));
}

/* The four texels about a place, and how far it is towards the second ones: around the sides, not over the
 * poles. */
struct footprint {
    uint32_t x0, y0, x1, y1;
    float fx, fy;
};

static struct footprint find_footprint(uint32_t width, uint32_t height, float across, float down) {
    struct footprint f;
    float x = across - 0.5f, y = fminf(fmaxf(down - 0.5f, 0), (float)(height - 1)), left = floorf(x);
    if (left < 0) left += (float)width;
    f.x0 = left < (float)width ? (uint32_t)left : 0;
    f.x1 = f.x0 + 1 < width ? f.x0 + 1 : 0;
    f.fx = x - floorf(x);
    f.y0 = (uint32_t)y;
    f.y1 = f.y0 + 1 < height ? f.y0 + 1 : f.y0;
    f.fy = y - (float)f.y0;
    return f;
}

struct lw_vec3 lw_environment_radiance(const struct lw_environment *e, struct lw_vec3 direction_ws) {
    if (!e->width) return lw_vec3(0, 0, 0);
    struct lw_vec2 place = place_of(direction_ws);
    const struct footprint f =
        find_footprint(e->width, e->height, place.x * (float)e->width, place.y * (float)e->height);
    return mix(mix(texel(e, f.x0, f.y0), texel(e, f.x1, f.y0), f.fx),
               mix(texel(e, f.x0, f.y1), texel(e, f.x1, f.y1), f.fx), f.fy);
}

struct lw_vec3 lw_scene_sky(const struct lw_scene *scene, struct lw_vec3 direction_ws) {
    const struct lw_vec3 sky = lw_vec3(scene->sky[0], scene->sky[1], scene->sky[2]);
    if (!scene->environment.width) return sky;
    return lw_vec3_add(sky, lw_environment_radiance(&scene->environment, direction_ws));
}

static float luminance(const struct lw_environment *e, uint32_t x, uint32_t y) {
    return lw_colour_luminance(texel(e, x, y));
}

/* Share of the sphere that a row of texels takes. */
static double band(uint32_t height, uint32_t y) {
    const double step = acos(-1.0) / height;
    return 0.5 * (cos(step * y) - cos(step * (y + 1)));
}

/* Weights to a cumulative distribution, in place. Its steps are multiples of 2^-24, as the numbers are that
 * will be looked up in it: so the probability of an entry is just the difference to the one before. */
static void accumulate(float *weight, uint32_t count, double sum) {
    double running = 0;
    uint32_t last = 0;
    for (uint32_t i = 0; i < count; i++) {
        if (weight[i] > 0) last = i;
        running += (double)weight[i];
        weight[i] = sum > 0 ? (float)(floor(fmin(running / sum, 1) * 0x1p24) * 0x1p-24) : 0;
    }
    for (uint32_t i = last; i < count; i++) weight[i] = 1;
}

enum lw_status lw_environment_importance_init(struct lw_environment_importance *importance,
                                              const struct lw_environment *e) {
    *importance = (struct lw_environment_importance){.width = e->width, .height = e->height};
    if (!e->width) return LW_OK;
    importance->row = calloc(e->height, sizeof *importance->row);
    importance->column = calloc((size_t)e->width * e->height, sizeof *importance->column);
    if (!importance->row || !importance->column) {
        lw_environment_importance_finish(importance);
        return LW_NO_MEMORY;
    }
    double mean = 0;
    for (uint32_t y = 0; y < e->height; y++) {
        double sum = 0;
        for (uint32_t x = 0; x < e->width; x++) sum += (double)luminance(e, x, y);
        mean += sum / e->width * band(e->height, y);
    }
    const float threshold = (float)mean * (1 + EXCESS_MIN);
    double excess = 0;
    for (uint32_t y = 0; y < e->height; y++) {
        float *column = importance->column + (size_t)y * e->width;
        double sum = 0;
        for (uint32_t x = 0; x < e->width; x++) {
            column[x] = fmaxf(0, luminance(e, x, y) - threshold);
            sum += (double)column[x];
        }
        accumulate(column, e->width, sum);
        double share = sum / e->width * band(e->height, y);
        importance->row[y] = (float)share;
        excess += share;
    }
    importance->mean = (float)mean;
    importance->excess = (float)excess;
    double sum = 0;
    for (uint32_t y = 0; y < e->height; y++) sum += (double)importance->row[y];
    accumulate(importance->row, e->height, sum);
    if (!(sum > 0)) importance->excess = 0;
    return LW_OK;
}

void lw_environment_importance_finish(struct lw_environment_importance *importance) {
    free(importance->column);
    free(importance->row);
    *importance = (struct lw_environment_importance){0};
}

/* Where in its entry a pick lies: uniform in [0, 1) again. */
static float rescaled_pick(const float *cdf, uint32_t i, float pick) {
    float below = i ? cdf[i - 1] : 0;
    return fminf((pick - below) / (cdf[i] - below), 0x1.fffffep-1f);
}

/* A tent of width 2 about 0, by its inverse distribution. */
static float tent(float u) { return u < 0.5f ? sqrtf(2 * u) - 1 : 1 - sqrtf(2 - 2 * u); }

/* Probability of a texel. */
static float texel_probability(const struct lw_environment_importance *importance, uint32_t x, uint32_t y) {
    return lw_cdf_probability(importance->row, y) *
           lw_cdf_probability(importance->column + (size_t)y * importance->width, x);
}

/* Density in the picture to density per solid angle: du dv = d omega / (2 pi^2 sin). */
static float density(const struct lw_environment_importance *importance, const struct footprint *f,
                     float sine) {
    float upper = texel_probability(importance, f->x0, f->y0) * (1 - f->fx) +
                  texel_probability(importance, f->x1, f->y0) * f->fx;
    float lower = texel_probability(importance, f->x0, f->y1) * (1 - f->fx) +
                  texel_probability(importance, f->x1, f->y1) * f->fx;
    float per_picture =
        (upper * (1 - f->fy) + lower * f->fy) * (float)importance->width * (float)importance->height;
    return per_picture / (2 * LW_PI * LW_PI * fmaxf(sine, SINE_MIN));
}

struct lw_vec3 lw_environment_importance_sample(const struct lw_environment_importance *importance, float u,
                                                float v, float *out_pdf) {
    const float width = (float)importance->width, height = (float)importance->height;
    uint32_t y = lw_cdf_choose(importance->row, importance->height, v);
    const float *column = importance->column + (size_t)y * importance->width;
    uint32_t x = lw_cdf_choose(column, importance->width, u);
    float in_row = rescaled_pick(importance->row, y, v), in_column = rescaled_pick(column, x, u);
    /* A tent about each texel, chosen by its probability, makes the bilinear density. What of the first row's
     * reaches over the pole is folded back, and makes the level part above its centres. */
    float across = (float)x + 0.5f + tent(in_column), down = fabsf((float)y + 0.5f + tent(in_row));
    if (down > height) down = 2 * height - down;
    float theta = LW_PI * down / height, angle = 2 * LW_PI * (across / width - 0.5f), sine = sinf(theta);
    struct footprint f = find_footprint(importance->width, importance->height, across, down);
    *out_pdf = density(importance, &f, sine);
    return lw_vec3(sine * cosf(angle), cosf(theta), sine * sinf(angle));
}

float lw_environment_importance_pdf(const struct lw_environment_importance *importance, struct lw_vec3 d) {
    if (!(importance->excess > 0)) return 0;
    struct lw_vec2 place = place_of(d);
    struct footprint f =
        find_footprint(importance->width, importance->height, place.x * (float)importance->width,
                       place.y * (float)importance->height);
    return density(importance, &f, sqrtf(d.x * d.x + d.z * d.z));
}
