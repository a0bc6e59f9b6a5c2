#include "common/shading/tangent.h"

#define STEPS 32768.0f

uint16_t lw_tangent_encode(struct lw_vec3 normal, struct lw_vec3 tangent, bool mirrored) {
    struct lw_vec3 t, b;
    lw_vec3_frame(normal, &t, &b);
    const float angle = atan2f(lw_vec3_dot(tangent, b), lw_vec3_dot(tangent, t)); /* 0 for none */
    const int step = (int)lrintf(angle * (STEPS / (2 * LW_PI)));
    return (uint16_t)(((unsigned)step & 0x7fffu) | (mirrored ? LW_TANGENT_MIRRORED : 0));
}

#define QUARTER 8192 /* steps */

/* steps: the angle. By Taylor's series about the nearest quarter turn, 3e-7 off at most: a decoder runs
 * for every triangle that a picture meets. */
static void find_sine_and_cosine(int steps, float *out_sine, float *out_cosine) {
    const int quarters = (steps + QUARTER / 2) / QUARTER;
    const float x = (float)(steps - quarters * QUARTER) * (2 * LW_PI / STEPS), x2 = x * x;
    const float sine = x * (1 + x2 * (-1.0f / 6 + x2 * (1.0f / 120 - x2 * (1.0f / 5040))));
    const float cosine = 1 + x2 * (-0.5f + x2 * (1.0f / 24 + x2 * (-1.0f / 720 + x2 * (1.0f / 40320))));
    const float across = quarters & 1 ? cosine : sine, along = quarters & 1 ? -sine : cosine;
    *out_sine = quarters & 2 ? -across : across;
    *out_cosine = quarters & 2 ? -along : along;
}

struct lw_vec4 lw_tangent_decode(uint16_t code, struct lw_vec3 normal) {
    struct lw_vec3 t, b;
    float sine, cosine;
    lw_vec3_frame(normal, &t, &b);
    find_sine_and_cosine(code & 0x7fff, &sine, &cosine);
    const struct lw_vec3 tangent = lw_vec3_mad(lw_vec3_scale(t, cosine), b, sine);
    return (struct lw_vec4){tangent.x, tangent.y, tangent.z, code & LW_TANGENT_MIRRORED ? -1.0f : 1.0f};
}
