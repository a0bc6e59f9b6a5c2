#include "common/shading/lobe_table.h"

#include "common/base/random.h"
#include "common/shading/microfacets.h"

#include <pthread.h>

#define SIDE    LW_LOBE_TABLE_SIDE
#define SAMPLES 1024u /* for an entry: 0.1 % off at most */

static struct lw_lobe_share table[SIDE][SIDE], mean[SIDE]; /* rows: roughness */
static uint32_t packed[SIDE][SIDE];
static pthread_once_t once = PTHREAD_ONCE_INIT;

/* By visible normals: F and the light's own masking are left to weigh. */
static struct lw_lobe_share integrate(float cosine, float alpha) {
    const struct lw_vec3 to_eye = lw_vec3(sqrtf(1 - cosine * cosine), 0, cosine);
    double a = 0, b = 0;
    for (uint32_t s = 0; s < SAMPLES; s++) {
        float u[2];
        lw_random_sobol2(s, 0, u);
        const struct lw_vec3 half = lw_microfacets_sample(to_eye, alpha, u);
        const struct lw_vec3 to_light = lw_microfacets_mirror(to_eye, half);
        if (!(to_light.z > 0)) continue;
        const float c = lw_microfacets_schlick(lw_vec3_dot(to_eye, half));
        const float seen = lw_microfacets_seen_again(to_eye.z, to_light.z, alpha);
        a += (double)((1 - c) * seen), b += (double)(c * seen);
    }
    return (struct lw_lobe_share){(float)(a / SAMPLES), (float)(b / SAMPLES)};
}

static uint32_t in_16_bits(float x) { return (uint32_t)lrintf(65535 * fminf(fmaxf(x, 0), 1)); }

static void fill(void) {
    for (int j = 0; j < SIDE; j++) {
        const float roughness = (float)j / (SIDE - 1), alpha = lw_microfacets_alpha(roughness);
        for (int i = 0; i < SIDE; i++) {
            const float t = (float)i / (SIDE - 1);
            table[j][i] = integrate(fmaxf(t * t, 1e-4f), alpha);
            packed[j][i] = in_16_bits(table[j][i].a) | in_16_bits(table[j][i].b) << 16;
        }
        /* 2 cos d(cos), cos = t^2: 4 t^3 dt, between the entries as the look-up has it */
        double a = 0, b = 0;
        const int steps = 16 * (SIDE - 1);
        for (int k = 0; k < steps; k++) {
            const float t = ((float)k + 0.5f) / (float)steps * (SIDE - 1);
            const int i = (int)t;
            const float share = t - (float)i, u = t / (SIDE - 1), weight = 4 * u * u * u / (float)steps;
            a += (double)(weight * (table[j][i].a + share * (table[j][i + 1].a - table[j][i].a)));
            b += (double)(weight * (table[j][i].b + share * (table[j][i + 1].b - table[j][i].b)));
        }
        mean[j] = (struct lw_lobe_share){(float)a, (float)b};
    }
}

static struct lw_lobe_share between(struct lw_lobe_share x, struct lw_lobe_share y, float t) {
    return (struct lw_lobe_share){x.a + t * (y.a - x.a), x.b + t * (y.b - x.b)};
}

/* Where a value in [0, 1] lies between entries; the second is there too. */
static int entry_of(float x, float *out_share) {
    const float at = fminf(fmaxf(x, 0), 1) * (SIDE - 1);
    const int i = at < SIDE - 2 ? (int)at : SIDE - 2;
    *out_share = at - (float)i;
    return i;
}

struct lw_lobe_share lw_lobe_table_at(float cosine, float roughness) {
    pthread_once(&once, fill);
    float x, y;
    const int i = entry_of(sqrtf(fmaxf(cosine, 0)), &x), j = entry_of(roughness, &y);
    return between(between(table[j][i], table[j][i + 1], x), between(table[j + 1][i], table[j + 1][i + 1], x),
                   y);
}

struct lw_lobe_share lw_lobe_table_mean(float roughness) {
    pthread_once(&once, fill);
    float y;
    const int j = entry_of(roughness, &y);
    return between(mean[j], mean[j + 1], y);
}

const struct lw_lobe_share *lw_lobe_table(void) {
    pthread_once(&once, fill);
    return table[0];
}

const uint32_t *lw_lobe_table_packed(void) {
    pthread_once(&once, fill);
    return packed[0];
}
